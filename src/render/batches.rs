//! Rays on their way, with what each carries: the queues that the integrator fills and empties, wave by wave.
//!
//! Structure of arrays where the accelerator reads, one record per ray where only shading does. Memory is kept between
//! tiles; nothing is allocated per ray once the queues have grown.

use glam::Vec3;

use super::{
    PathCounts,
    caustics::Connection,
    cone::Cone,
    cryptomatte::Sight,
    film::{FilmTile, Layer, Place},
    path_tracer::Links,
    sampler::Run,
};
use crate::{
    accel::{HitBatch, RayBatch},
    output::Window,
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
    /// On from diffuse things.
    pub diffuse: u64,
    /// On from where the water has scattered light.
    pub scattered: u64,
    /// Towards the sun, the sky and lamps.
    pub shadow: u64,
}

impl RayCounts {
    /// All of them.
    pub fn total(&self) -> u64 {
        self.primary
            + self.reflection
            + self.refraction
            + self.transparency
            + self.diffuse
            + self.scattered
            + self.shadow
    }
}

impl std::ops::AddAssign for RayCounts {
    fn add_assign(&mut self, other: Self) {
        self.primary += other.primary;
        self.reflection += other.reflection;
        self.refraction += other.refraction;
        self.transparency += other.transparency;
        self.diffuse += other.diffuse;
        self.scattered += other.scattered;
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
    /// How wide it is.
    pub(super) cone: Cone,
    /// Pixel and camera's sample that its light belongs to.
    pub(super) place: Place,
    /// What the camera's ray met first; `None` until it has met anything but spray.
    pub(super) layer: Option<Layer>,
    /// Reflections and refractions so far.
    pub(super) depth: u16,
    /// Spray passed so far.
    pub(super) passed: u16,
    /// It travels in water: in the columns', or in that joined from spray.
    pub(super) in_water: bool,
    /// Which of the two it is in; it may be in both.
    pub(super) within: [bool; 2],
    /// It is the camera's own ray, not yet met with anything.
    pub(super) primary: bool,
    /// It is the first refracted ray, whose length the film notes.
    pub(super) notes_path: bool,
    /// What it still decides of the sample's mattes.
    pub(super) sight: Sight,
    /// What only the path tracer reads.
    pub(super) path: PathState,
}

/// What a path remembers of its last event, for the weights of the next.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct PathState {
    /// Events so far: the sets of random numbers that are used up.
    pub(super) event: u16,
    /// Times that it has left a diffuse thing.
    pub(super) diffuse: u16,
    /// Times that it was scattered in the water.
    pub(super) scattered: u32,
    /// Where the last event was (m).
    pub(super) from: Vec3,
    /// Density (1/sr) with which the direction was chosen; infinite where there was no choice.
    pub(super) density: f32,
    /// Lights that the last event has asked for by itself, and that a ray must weigh against that when it meets them.
    pub(super) asked: Asked,
    /// Nothing but air or water since it left a diffuse thing or was scattered.
    pub(super) fresh: bool,
    /// Sun and lamps along this ray are the caustics' matter.
    pub(super) covered: bool,
    /// Nothing but sheets of water since it left a diffuse thing or mist in the air: links have brought the sun through them.
    pub(super) behind_sheets: bool,
    /// Share of sun and lamps that the last event has found by asking alone: drops' own way of scattering.
    pub(super) bow: f32,
}

/// Lights that an event has sent a ray of its own to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Asked {
    pub(super) sun: bool,
    pub(super) sky: bool,
    pub(super) lamps: bool,
}

impl PathState {
    /// Whether something diffuse, or the water itself, has thrown the path on before.
    #[inline]
    pub(super) fn is_later(&self) -> bool {
        self.diffuse > 0 || self.scattered > 0
    }
}

impl Carrier {
    /// A ray from the eye, as wide as a pixel's.
    pub(super) fn camera(throughput: Vec3, place: Place, in_water: bool, cone: Cone) -> Self {
        Self {
            throughput,
            guide: 1.0,
            distance: 0.0,
            cone,
            place,
            layer: None,
            depth: 0,
            passed: 0,
            in_water,
            within: [in_water, false],
            primary: true,
            notes_path: false,
            sight: Sight::Direct(1.0),
            path: PathState { density: f32::INFINITY, ..PathState::default() },
        }
    }
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
    /// Pixel and camera's sample that its light belongs to.
    pub(super) place: Place,
    /// Layer that the light belongs to.
    pub(super) layer: Layer,
    /// Light group that it belongs to.
    pub(super) group: u16,
    /// Borders crossed so far.
    pub(super) crossed: u16,
    /// It travels in water.
    pub(super) in_water: bool,
    /// It was bent towards the refracted sun and must turn to the true one when it leaves the water.
    pub(super) bent: bool,
}

impl ShadowCarrier {
    /// One in the air, from a place to which the eye's light has come `distance` metres.
    pub(super) fn in_air(light: Vec3, distance: f32, place: Place, layer: Layer, group: u16) -> Self {
        Self {
            light,
            share: 1.0,
            level_path: 0.0,
            distance,
            place,
            layer,
            group,
            crossed: 0,
            in_water: false,
            bent: false,
        }
    }
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

/// One of the camera's samples under way.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct CameraSample {
    /// Pixel within the tile.
    pub(super) pixel: u32,
    /// Sample within the pixel.
    pub(super) sample: u32,
    /// The pixel's numbers.
    pub(super) run: Run,
}

/// Everything that one thread keeps from tile to tile.
#[derive(Debug, Default)]
pub(super) struct Scratch {
    /// The sums of the samples under way.
    pub(super) film: FilmTile,
    /// The tile's sums so far.
    pub(super) total: FilmTile,
    /// The same block by block, where they are to be joined to others later.
    pub(super) blocks: Vec<FilmTile>,
    /// Pixels of the tile that get more samples.
    pub(super) active: Vec<u32>,
    /// The camera's samples of the chunk under way.
    pub(super) samples: Vec<CameraSample>,
    /// The wave being traced and the one being filled.
    pub(super) wave: Wave,
    /// Rays that shading asks for.
    pub(super) next: Wave,
    /// Rays towards lights being traced.
    pub(super) shadow: ShadowWave,
    /// Rays towards lights that go on.
    pub(super) next_shadow: ShadowWave,
    /// Ways from paths to lights being traced.
    pub(super) links: Links,
    /// Ways to lights that go on.
    pub(super) next_links: Links,
    /// What stops them.
    pub(super) occluded: Vec<bool>,
    /// Ways to lights by the surface, of one event.
    pub(super) connections: Vec<Connection>,
    /// Answers.
    pub(super) hits: HitBatch,
    /// Rays traced.
    pub(super) counts: RayCounts,
    /// The solver's work.
    pub(super) solve: SolveCounts,
    /// What the path tracer counted.
    pub(super) paths: PathCounts,
    /// Samples of the tiles that were tallied.
    pub(super) taken: u64,
    /// Contributions dropped since they were not finite.
    pub(super) nonfinite: u64,
    /// Resolved pixels on their way to the film.
    pub(super) pixels: Vec<f32>,
}

impl Scratch {
    /// Starts with a tile, from the sums of its blocks of samples if it has any.
    pub(super) fn start(&mut self, window: Window, groups: usize, blocks: Option<Vec<FilmTile>>) {
        self.total.reset(window, groups);
        self.blocks = blocks.unwrap_or_default();
        for block in &self.blocks {
            self.total.join(block);
        }
    }

    /// What is kept of the tile: its sums, or if they are to stay apart those of its blocks of samples.
    pub(super) fn kept(&self, apart: bool) -> &[FilmTile] {
        if apart { &self.blocks } else { std::slice::from_ref(&self.total) }
    }

    /// Counts what the film says of a tile that is done.
    pub(super) fn tally(&mut self) {
        self.nonfinite += self.total.nonfinite;
        self.taken += self.total.all_samples();
    }
}
