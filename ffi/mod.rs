//! Foreign libraries, loaded at run time: all the unsafe code there is, but for `simd`.

#[cfg(feature = "oiio")]
pub(crate) mod oiio;
