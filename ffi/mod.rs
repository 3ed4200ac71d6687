//! Foreign libraries, loaded at run time: all the unsafe code there is, but for `simd`.
//!
//! What leaves this room is safe to call; only the rooms that wrap a foreign library (images, accel, output, denoise) may name it.

pub(crate) mod embree;
pub(crate) mod oidn;
#[cfg(feature = "oiio")]
pub(crate) mod oiio;
#[cfg(feature = "oiio")]
pub(crate) mod oiio_texture;
mod search;
