//! Camera, sampler, film, tiles and integrators.
//!
//! In go lowered parts, an accelerator and the looks of sky, ground and spray; out comes an `output::Picture`.

mod batches;
mod camera;
pub mod caustics;
mod contact;
mod error;
mod film;
mod framing;
mod job;
mod looks;
pub mod observer;
mod path;
mod sampler;
mod shadow;
mod tiles;
mod whitted;
mod world;

pub use batches::RayCounts;
pub use camera::{Camera, FILM_BACK_MM, Pose, concentric_disc};
pub use error::RenderError;
pub use film::{CHANNELS, Layer, NOTHING};
pub use framing::frame_points;
pub use job::{Job, RenderStats, render_frame};
pub use looks::Looks;
pub use observer::Observer;
pub use path::CameraPath;
pub use sampler::{Sample, Sampler};
pub use tiles::{TILE, tiles};
pub use world::{GroundLook, Matter, SprayLook};

#[cfg(test)]
mod tests;
