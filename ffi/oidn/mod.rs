//! Open Image Denoise 2 as safe types: a device on the processor, and its filter for ray-traced pictures.
//!
//! The library is found and loaded at run time ([`loader`]); the few functions of its plain C interface that are needed
//! are written down by hand in [`bindings`]. What is filtered with what belongs to `denoise`.

mod bindings;
mod device;
mod error;
mod loader;

pub(crate) use device::{Device, Images};
pub use error::OidnError;
