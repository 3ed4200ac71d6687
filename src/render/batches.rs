//! Rays on their way, with what each carries: the queues that the integrator fills and empties, wave by wave.
//!
//! Structure of arrays where the accelerator reads, one record per ray where only shading does. Memory is kept between
//! tiles; nothing is allocated per ray once the queues have grown.

use glam::Vec3;

use super::film::{FilmTile, Layer};
use crate::{
    accel::{HitBatch, RayBatch},
    surface::SolveCounts,
};

/// Rays that were traced, by kind.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct RayCounts {
    /// From the camera.
    pub primary: u64,
    /// Mirrored by water.
    pub reflection: u64,
    /// Refracted by water.
    pub refraction: u64,
    /// Straight on through spray.
    pub transparency: u64,
    /// Towards the sun and lamps.
    pub shadow: u64,
}

impl RayCounts {
    /// All of them.
    pub fn total(&self) -> u64 {
        self.primary + self.reflection + self.refraction + self.transparency + self.shadow
    }
}

impl std::ops::AddAssign for RayCounts {
    fn add_assign(&mut self, other: Self) {
        self.primary += other.primary;
        self.reflection += other.reflection;
        self.refraction += other.refraction;
        self.transparency += other.transparency;
        self.shadow += other.shadow;
    }
}

/// What a ray carries.
#[derive(Clone, Copy, Debug)]
pub(super) struct Carrier {
    /// Share of the radiance at the ray's end that reaches the pixel's sample.
    pub(super) throughput: Vec3,
    /// Share of the pixel's denoising guides that this ray decides.
    pub(super) guide: f32,
    /// Metres travelled before this ray.
    pub(super) distance: f32,
    /// Pixel within the tile.
    pub(super) pixel: u32,
    /// Sample within the pixel.
    pub(super) sample: u32,
    /// What the camera's ray met first; `None` until it has met anything but spray.
    pub(super) layer: Option<Layer>,
    /// Reflections and refractions so far.
    pub(super) depth: u16,
    /// Spray passed so far.
    pub(super) passed: u16,
    /// It travels in water.
    pub(super) in_water: bool,
    /// It is the camera's own ray, not yet met with anything.
    pub(super) primary: bool,
    /// It is the first refracted ray, whose length the film notes.
    pub(super) notes_path: bool,
}

/// Rays of one wave.
#[derive(Debug, Default)]
pub(super) struct Wave {
    /// The rays.
    pub(super) rays: RayBatch,
    /// Their loads, in the same order.
    pub(super) carriers: Vec<Carrier>,
}

impl Wave {
    /// Forgets the rays, keeps the memory.
    pub(super) fn clear(&mut self) {
        self.rays.clear();
        self.carriers.clear();
    }
}

/// What a ray towards a light carries.
#[derive(Clone, Copy, Debug)]
pub(super) struct ShadowCarrier {
    /// Light that it adds if nothing stands in its way.
    pub(super) light: Vec3,
    /// Share of it that got through so far.
    pub(super) share: f32,
    /// Length (m) of water to assume if no surface ends the water on its way: that of a level surface.
    pub(super) level_path: f32,
    /// Metres from the eye to where it started.
    pub(super) distance: f32,
    /// Pixel within the tile.
    pub(super) pixel: u32,
    /// Layer that the light belongs to.
    pub(super) layer: Layer,
    /// Borders crossed so far.
    pub(super) crossed: u16,
    /// It travels in water.
    pub(super) in_water: bool,
    /// It was bent towards the refracted sun and must turn to the true one when it leaves the water.
    pub(super) bent: bool,
}

/// Rays towards lights.
#[derive(Debug, Default)]
pub(super) struct ShadowWave {
    /// The rays.
    pub(super) rays: RayBatch,
    /// Their loads, in the same order.
    pub(super) carriers: Vec<ShadowCarrier>,
}

impl ShadowWave {
    /// Forgets the rays, keeps the memory.
    pub(super) fn clear(&mut self) {
        self.rays.clear();
        self.carriers.clear();
    }
}

/// Everything that one thread keeps from tile to tile.
#[derive(Debug, Default)]
pub(super) struct Scratch {
    /// The tile's sums.
    pub(super) film: FilmTile,
    /// The wave being traced and the one being filled.
    pub(super) wave: Wave,
    /// Rays that shading asks for.
    pub(super) next: Wave,
    /// Rays towards lights being traced.
    pub(super) shadow: ShadowWave,
    /// Rays towards lights that go on.
    pub(super) next_shadow: ShadowWave,
    /// Answers.
    pub(super) hits: HitBatch,
    /// Rays traced.
    pub(super) counts: RayCounts,
    /// The solver's work.
    pub(super) solve: SolveCounts,
    /// Contributions dropped since they were not finite.
    pub(super) nonfinite: u64,
    /// Resolved pixels on their way to the film.
    pub(super) pixels: Vec<[f32; super::film::CHANNELS.len()]>,
}
