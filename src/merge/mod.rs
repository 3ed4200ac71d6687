//! Parts of one picture, rendered apart, → the picture. Tiles are put side by side to the bit; ranges of samples are joined to
//! the bit from checkpoints, and from finished pictures weighted by how many samples each has.
//!
//! What a checkpoint's sums are is the renderer's matter; here is which parts fit together.

mod error;
mod pictures;
mod samples;

use std::path::PathBuf;

pub use error::MergeError;

use crate::output::{self, Encoding, Picture};
use crate::render::Checkpoint;

/// A picture made of parts.
#[derive(Clone, Debug)]
pub struct Merged {
    /// The picture.
    pub picture: Picture,
    /// How its parts were written; `None` of checkpoints.
    pub encoding: Option<Encoding>,
}

/// Joins EXR files, or checkpoints, of parts of one picture, in any order.
///
/// With `partial`, what no part has is left 0, and the picture says that it is not complete.
///
/// *Errors*: [`MergeError`]; each names the file, what it has and what was expected.
pub fn merge(paths: &[PathBuf], partial: bool) -> Result<Merged, MergeError> {
    let checkpoints = paths.iter().filter(|path| Checkpoint::is_one(path)).count();
    if checkpoints == 0 {
        let parts = paths.iter().map(|path| pictures::read(path)).collect::<Result<Vec<_>, _>>()?;
        let encoding = paths.first().map(|path| output::encoding_of(path)).transpose()?;
        return Ok(Merged { picture: pictures::join(&parts, partial)?, encoding });
    }
    if let Some(picture) = paths.iter().find(|path| !Checkpoint::is_one(path)) {
        return Err(MergeError::Unfit {
            path: picture.clone(),
            what: "is no checkpoint, and other parts are; expected parts of one kind".to_owned(),
        });
    }
    let parts: Vec<(PathBuf, Checkpoint)> =
        paths.iter().map(|path| Ok((path.clone(), Checkpoint::load(path)?))).collect::<Result<_, MergeError>>()?;
    Ok(Merged { picture: Checkpoint::join(&parts, partial)?, encoding: None })
}
