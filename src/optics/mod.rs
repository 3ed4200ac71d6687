//! Fresnel, absorption, highlights, sky and sun: what light does at a point, and what comes from far away.
//!
//! Pure functions over plain data; nothing here traces a ray. Directions are unit vectors in the scene's frame
//! (x east, y up, z south), radiance is scene-linear Rec.709 in the units of the default daylight, under which a
//! horizontal white card has a radiance of 1.

pub mod absorb;
mod atmosphere;
mod environment;
pub mod fresnel;
pub mod highlight;
mod irradiance;
mod sky;
mod sun;

use std::path::PathBuf;

pub use irradiance::Irradiance;
pub use sky::Sky;
pub use sun::{SUN_ANGULAR_RADIUS, Sun, direction};

/// What can be wrong with a sky.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum OpticsError {
    /// The kind of sky needs an image and the scene names none.
    #[error("sky.kind = \"{kind}\" needs an image: set sky.{key}")]
    NoImage {
        /// The kind of sky.
        kind: &'static str,
        /// The key that would name it.
        key: &'static str,
    },
    /// The image cannot be read.
    #[error("{path}: the sky's image cannot be read: {reason}", path = path.display())]
    Image {
        /// The file.
        path: PathBuf,
        /// What the reader said.
        reason: String,
    },
    /// The image holds a number that is not one.
    #[error("{path}: pixel ({x}, {y}) of the sky's image is {value:?}; expected finite numbers", path = path.display())]
    NotFinite {
        /// The file.
        path: PathBuf,
        /// Column, from the left.
        x: usize,
        /// Row, from the top.
        y: usize,
        /// What stands there.
        value: [f32; 3],
    },
    /// The image is larger than any sky needs to be.
    #[error("{path}: the sky's image claims {width} x {height} pixels; at most {limit} are read", path = path.display())]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// Columns that it claims.
        width: usize,
        /// Rows that it claims.
        height: usize,
        /// Most pixels that are read.
        limit: usize,
    },
}

/// Relative luminance of a linear Rec.709 colour (ITU-R BT.709-6, 3.2).
#[inline]
pub fn luminance(color: glam::Vec3) -> f32 {
    color.dot(glam::Vec3::new(0.2126, 0.7152, 0.0722))
}
