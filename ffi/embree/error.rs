//! What can go wrong between us and Embree: not found, not usable, a call that failed, geometry that cannot be given.

use std::path::PathBuf;

use crate::ffi::search::list;

/// An error of Embree or of finding it.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum EmbreeError {
    /// No place held a library that loads.
    #[error(
        "no Embree 4 library found; tried:{}\nget it with `make build`, install your system's Embree 4.3 or newer \
         (Debian: libembree4-4, Fedora and Homebrew: embree), or name one by WHITEWATER_EMBREE",
        list(tried)
    )]
    NotFound {
        /// Each place with the reason why it did not serve, in the order of the search.
        tried: Vec<(PathBuf, String)>,
    },
    /// The library is of a version whose structures are laid out differently.
    #[error("{}: Embree {found} is too old; 4.3.0 or newer of Embree 4 is needed", library.display())]
    Version {
        /// The library.
        library: PathBuf,
        /// Its version, as `4.2.0`.
        found: String,
    },
    /// The library was compiled without something that pictures depend on.
    #[error("{}: this Embree was built {what}, which changes or loses hits; use another build", library.display())]
    Build {
        /// The library.
        library: PathBuf,
        /// What it was built with or without.
        what: &'static str,
    },
    /// A set-up call failed.
    #[error("Embree's {call} failed: {code}{}", if message.is_empty() { String::new() } else { format!(": {message}") })]
    Call {
        /// The function.
        call: &'static str,
        /// Embree's name for the error.
        code: String,
        /// Embree's own words.
        message: String,
    },
    /// Geometry that would make Embree read outside its buffers, or that it cannot count.
    #[error("geometry {geometry}: {what} is {value}, expected {expected}")]
    Geometry {
        /// Its identity in the scene.
        geometry: u32,
        /// What is wrong.
        what: String,
        /// The value found.
        value: u64,
        /// What would have been right.
        expected: String,
    },
}
