//! The state of every pixel of a picture under way, in one file: from it the picture goes on to the same bits.
//!
//! What the file holds, and that it is whole, is `file`'s matter; when it is written, `keeper`'s; how the pictures of
//! several become one, `join`'s. What a film's sums are is known to the film alone.

mod file;
mod join;
mod keeper;

use std::path::PathBuf;
use std::time::Duration;

pub use file::Checkpoint;
pub(super) use file::Header;
pub(super) use keeper::Keeper;

/// Where and how often the state of a picture is kept, and whose it is.
#[derive(Clone, Debug)]
pub struct Keeping {
    /// The file.
    pub path: PathBuf,
    /// Time between two of its versions.
    pub every: Duration,
    /// Go on from the file if it is there; otherwise it is replaced.
    pub resume: bool,
    /// Write it once more when the picture is done, to be refined or joined later.
    pub keep: bool,
    /// A hash of all that pixels depend on, but for what the renderer knows: frame, window, samples, noise.
    pub identity: String,
    /// What a picture's metadata say that the renderer does not know: the scene's hash.
    pub scene_hash: String,
    /// Owner.
    pub owner: Option<String>,
    /// Comments.
    pub comments: Option<String>,
}

/// Why a checkpoint cannot be used.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum CheckpointError {
    /// It cannot be read.
    #[error("could not read the checkpoint {path}: {reason}")]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        reason: String,
    },
    /// It is something else.
    #[error("{path} is not a checkpoint of a render; expected a file that begins with `whitewater render checkpoint`")]
    NotOne {
        /// The file.
        path: PathBuf,
    },
    /// It is of another version.
    #[error(
        "the checkpoint {path} is of version {found}; expected {expected}, the version of this program; render without \
         --resume to begin anew"
    )]
    Version {
        /// The file.
        path: PathBuf,
        /// Its version.
        found: String,
        /// Ours.
        expected: String,
    },
    /// It is not as it was written.
    #[error("the checkpoint {path} is damaged: {what}; render without --resume to begin anew")]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        what: String,
    },
    /// It is of another picture.
    #[error("the checkpoint {path} is of another picture: {what}; render without --resume to begin anew")]
    Other {
        /// The file.
        path: PathBuf,
        /// What differs.
        what: String,
    },
    /// Several do not make one picture.
    #[error("{path}: {what}")]
    Join {
        /// The file.
        path: PathBuf,
        /// What keeps it from being joined.
        what: String,
    },
}
