//! Fresnel, rough surfaces, absorption, scattering, highlights, sky and sun: what light does at a point or along a ray, and
//! what comes from far away.
//!
//! Pure functions over plain data; nothing here traces a ray. Directions are unit vectors in the scene's frame
//! (x east, y up, z south), radiance is scene-linear Rec.709 in the units of the default daylight, under which a
//! horizontal white card has a radiance of 1.

pub mod absorb;
mod atmosphere;
#[cfg(test)]
mod closed_forms;
mod environment;
pub mod fresnel;
pub mod highlight;
mod irradiance;
pub mod medium;
pub mod phase;
mod rainbow;
pub mod rough;
mod sky;
mod sun;
#[cfg(test)]
mod testing;
pub mod tracking;

use std::path::PathBuf;

pub use irradiance::Irradiance;
pub use medium::{Medium, Step};
pub use phase::Phase;
pub use rainbow::Rainbow;
pub use rough::{Bounce, Evaluation, Interface};
pub use sky::{Sky, SkySampler};
pub use sun::{SUN_ANGULAR_RADIUS, Sun, direction};
pub use tracking::{Collision, delta_track, ratio_track};

/// What can be wrong with a sky, or with a medium that is asked for.
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
    #[error("the sky's image {0}")]
    Image(#[from] crate::images::Unreadable),
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
    /// A medium is denser than the bound that it is walked with, or its density is no density.
    #[error("extinction {extinction:?} 1/m at {distance} m; expected 0 to {majorant} 1/m, the majorant of the walk")]
    OverMajorant {
        /// What the medium said (1/m).
        extinction: [f32; 3],
        /// Where (m).
        distance: f32,
        /// The bound (1/m).
        majorant: f32,
    },
    /// A walk through a medium would not come to an end.
    #[error(
        "a walk of {limit} m by a majorant of {majorant} 1/m does not end; expected finite numbers, and steps that single \
         precision can tell apart"
    )]
    EndlessWalk {
        /// The bound (1/m).
        majorant: f32,
        /// How far (m).
        limit: f32,
    },
}

/// Relative luminance of a linear Rec.709 colour (ITU-R BT.709-6, 3.2).
#[inline]
pub fn luminance(color: glam::Vec3) -> f32 {
    color.dot(glam::Vec3::new(0.2126, 0.7152, 0.0722))
}
