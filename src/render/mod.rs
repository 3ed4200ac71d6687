//! Camera, sampler, film, tiles and integrators.
//!
//! In go lowered parts, an accelerator and the looks of sky, ground and spray; out comes an `output::Picture`.

mod batches;
mod camera;
pub mod caustics;
mod checkpoint;
mod cone;
mod contact;
mod cryptomatte;
mod deep;
mod error;
mod film;
mod framing;
mod job;
mod looks;
mod matte;
pub mod observer;
mod path;
mod path_tracer;
mod plan;
mod sampler;
mod shadow;
mod shares;
mod single_scattering;
mod spray;
mod tiles;
mod wave;
mod whitted;
mod world;

pub use batches::RayCounts;
pub use camera::{Camera, FILM_BACK_MM, Pose, concentric_disc};
pub use checkpoint::{Checkpoint, CheckpointError, Keeping};
pub use cryptomatte::Mattes;
pub use deep::render_deep;
pub use error::RenderError;
pub use film::{Layer, NOTHING, channels};
pub use framing::frame_points;
pub use job::{Job, Moment, RenderStats, Task, render_frame, render_part};
pub use looks::Looks;
pub use observer::Observer;
pub use path::CameraPath;
pub use path_tracer::PathCounts;
pub use plan::BLOCK;
pub use sampler::{Run, Sample, Sampler};
pub use shares::{around, tiles_of};
pub use tiles::{TILE, tiles};
pub use world::{GroundLook, Matter, SprayLook};

#[cfg(test)]
mod tests;
