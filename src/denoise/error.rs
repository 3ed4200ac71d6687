//! Why a picture could not be denoised.

use crate::ffi::oidn::OidnError;

/// An error of this room.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DenoiseError {
    /// The library is missing, does not serve, or failed.
    #[error(transparent)]
    Library(#[from] OidnError),
    /// The picture lacks the beauty or a guide.
    #[error("denoising needs the channel `{name}`, which the picture does not have")]
    NoChannel {
        /// The channel.
        name: String,
    },
    /// A channel that does not cover the data window.
    #[error("channel `{name}` has {samples} samples; expected {expected}, one for each pixel of the data window")]
    ChannelSize {
        /// The channel.
        name: String,
        /// How many it has.
        samples: usize,
        /// How many pixels there are.
        expected: usize,
    },
    /// A number that is none.
    #[error("channel `{name}` is {value} at pixel {x},{y}; expected finite numbers")]
    NonFinite {
        /// The channel.
        name: String,
        /// Pixel of the full frame, to the right.
        x: i32,
        /// Pixel of the full frame, down.
        y: i32,
        /// The value.
        value: f32,
    },
    /// The picture has a layer `noisy` already.
    #[error("the picture has a layer `noisy`: it has been denoised already")]
    Twice,
}
