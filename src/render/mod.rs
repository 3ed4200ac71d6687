//! Camera, sampler, film, tiles and integrators.
//!
//! In go lowered parts, an accelerator and the looks of sky, ground and spray; out comes an `output::Picture`.

mod camera;
mod error;
mod film;
mod framing;
mod observer;
mod path;
mod sampler;
mod tiles;

pub use camera::{Camera, FILM_BACK_MM, Pose, concentric_disc};
pub use error::RenderError;
pub use film::{CHANNELS, Layer, NOTHING};
pub use framing::frame_points;
pub use observer::Observer;
pub use path::CameraPath;
pub use sampler::{Sample, Sampler};
pub use tiles::{TILE, tiles};
