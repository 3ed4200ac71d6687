//! Why parts do not make a picture.

use std::path::PathBuf;

use crate::output::OutputError;
use crate::render::CheckpointError;

/// Why parts do not make a picture.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum MergeError {
    /// A part cannot be read.
    #[error(transparent)]
    Picture(#[from] OutputError),
    /// A checkpoint cannot be read, or does not fit the others.
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    /// A part that does not go with the others.
    #[error("{path} {what}")]
    Unfit {
        /// The part.
        path: PathBuf,
        /// What it has, and what was expected.
        what: String,
    },
    /// Nothing to join.
    #[error("there is nothing to join; expected at least one part")]
    Nothing,
    /// Parts are missing.
    #[error(
        "{missing} of {tiles} tiles are missing, the first at {x},{y}{samples}; expected every part of the picture, or --partial"
    )]
    Missing {
        /// Tiles that are not there, or not with all their samples.
        missing: usize,
        /// Tiles of the whole picture.
        tiles: usize,
        /// Left of the first that is missing.
        x: i32,
        /// Top of the first that is missing.
        y: i32,
        /// Which samples of it are there, if some are.
        samples: String,
    },
}
