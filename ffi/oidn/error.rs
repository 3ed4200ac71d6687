//! What can go wrong between us and Open Image Denoise: not found, too old, a call that failed.

use std::path::PathBuf;

use crate::ffi::search::list;

/// An error of Open Image Denoise or of finding it.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum OidnError {
    /// No place held a library that loads.
    #[error(
        "no Open Image Denoise 2 library found; tried:{}\nget it with `make denoiser`, install your system's (Fedora: \
         oidn, Homebrew: open-image-denoise), or name one by WHITEWATER_OIDN",
        list(tried)
    )]
    NotFound {
        /// Each place with the reason why it did not serve, in the order of the search.
        tried: Vec<(PathBuf, String)>,
    },
    /// The library speaks another version of the interface.
    #[error("{}: Open Image Denoise {found} does not serve; 2.0.0 or newer of version 2 is needed", library.display())]
    Version {
        /// The library.
        library: PathBuf,
        /// Its version, as `1.4.3`.
        found: String,
    },
    /// A call failed.
    #[error("{}: {call} failed: {code}{}", library.display(), if message.is_empty() { String::new() } else { format!(": {message}") })]
    Call {
        /// The library.
        library: PathBuf,
        /// The function.
        call: &'static str,
        /// The name of the error.
        code: String,
        /// The library's own words.
        message: String,
    },
}
