//! `[render]` and `[[light]]`: how many samples, how light is followed, and what shines besides sun and sky.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Representation, Scene};

/// How light is followed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Integrator {
    /// Whitted 1980: mirror, refraction, shadows; free of noise.
    #[default]
    Whitted,
    /// Path tracing: all light, through rough water and murky water too, with noise.
    Path,
}

/// Sun and lamps focused by the water's surface, by name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Caustics {
    /// Every way from the light to a point by way of the exact spline, found by Newton: exact and free of noise.
    Manifold,
    /// The sun's light carried down by beams through the surface's cells (Watt 1990): fast, for the bed.
    Beams,
    /// Only what paths find by themselves; Whitted's sun shines as through a level surface.
    Off,
}

/// Reconstruction filters by name.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum PixelFilter {
    /// Blackman-Harris.
    #[default]
    BlackmanHarris,
    /// The pixel's own square.
    Box,
}

/// `[render]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Render {
    /// Pixels across.
    #[schemars(range(min = 1, max = 65536))]
    pub width: u32,
    /// Pixels down.
    #[schemars(range(min = 1, max = 65536))]
    pub height: u32,
    /// Samples per pixel.
    #[schemars(range(min = 1, max = 65536))]
    pub samples: u32,
    /// Go on beyond `samples` until a pixel's standard error is this share of its luminance (and a tenth of a white
    /// card's); by default every pixel has `samples`.
    #[schemars(range(min = 0.0001, max = 10.0))]
    pub noise: Option<f64>,
    /// Go on beyond `samples` until so many seconds have passed for a frame; pixels end with about equal counts.
    #[schemars(range(min = 0.001, max = 1000000000.0))]
    pub seconds: Option<f64>,
    /// Most samples per pixel when `noise` or `seconds` decides.
    #[schemars(range(min = 1, max = 65536))]
    pub max_samples: u32,
    /// `whitted` or `path`.
    pub integrator: Integrator,
    /// `manifold`, `beams` or `off`; by default `manifold` for `path` and `off` for `whitted`. The first two need the
    /// plain spline as the surface's representation, not displaced.
    pub caustics: Option<Caustics>,
    /// Searches of `manifold` per pixel for what the camera sees at first sight, shared out among its `samples`, each for as
    /// many times the light; by default every sample makes its own. Those after first sight grow fewer in the same way.
    #[schemars(range(min = 1, max = 65536))]
    pub caustic_samples: Option<u32>,
    /// Width, in columns, of the smallest part of the surface that `manifold` looks into by itself: two ways to a light that
    /// are nearer to each other may be missed, and are counted.
    #[schemars(range(min = 0.000001, max = 1.0))]
    pub caustic_accuracy: f64,
    /// Whether light that the surface mirrors onto what stands above it is found by `manifold` too. A wavy surface has
    /// hundreds of glints for one point of a bank: without this they are left to chance, which rough water serves well.
    pub mirrored_caustics: bool,
    /// Cells of the beams' map per column and axis.
    #[schemars(range(min = 1, max = 64))]
    pub beam_samples: u32,
    /// Seed of every sequence.
    pub seed: u32,
    /// How often light may be reflected or refracted on its way.
    #[schemars(range(min = 0, max = 1000))]
    pub depth: u32,
    /// How many diffuse things (ground, objects, spray, foam) a path may meet before what it meets counts as black.
    #[schemars(range(min = 0, max = 1000))]
    pub diffuse_depth: u32,
    /// How often the water, or mist, may scatter a path before it counts as black.
    #[schemars(range(min = 0, max = 100000))]
    pub volume_depth: u32,
    /// Greatest radiance that one path may add to a pixel after its first diffuse or scattering event; by default there
    /// is no limit. What it takes away is reported.
    #[schemars(range(min = 0.001, max = 1000000000.0))]
    pub clamp: Option<f64>,
    /// `blackman-harris` or `box`.
    pub filter: PixelFilter,
    /// Width of the filter in pixels.
    #[schemars(range(min = 0.1, max = 16.0))]
    pub filter_width: f64,
    /// Most memory, as `512M` or `2G`, for what is kept of textures that are read piece by piece (.tx, and .exr and .tif with
    /// mip levels, where OpenImageIO is built in); what exceeds it is read again. All others are held whole.
    pub texture_memory: String,
}
impl Default for Render {
    fn default() -> Self {
        Self {
            width: 1280,
            height: 720,
            samples: 16,
            noise: None,
            seconds: None,
            max_samples: 1024,
            integrator: Integrator::Whitted,
            caustics: None,
            caustic_samples: None,
            caustic_accuracy: 0.01,
            mirrored_caustics: false,
            beam_samples: 4,
            seed: 0,
            depth: 8,
            diffuse_depth: 4,
            volume_depth: 64,
            clamp: None,
            filter: PixelFilter::BlackmanHarris,
            filter_width: 3.3,
            texture_memory: "1G".to_owned(),
        }
    }
}

impl Render {
    /// Most samples that a pixel may have.
    pub fn most_samples(&self) -> u32 {
        let most = if self.noise.is_some() || self.seconds.is_some() { self.max_samples } else { self.samples };
        most.max(self.samples).max(1)
    }
}

impl Scene {
    /// How sun and lamps come through the surface: unless said, exactly for paths through a plain spline.
    pub fn caustics(&self) -> Caustics {
        let plain = self.surface.representation == Representation::Spline && self.surface.displacement.is_none();
        self.render.caustics.unwrap_or(match self.render.integrator {
            Integrator::Path if plain => Caustics::Manifold,
            Integrator::Path | Integrator::Whitted => Caustics::Off,
        })
    }
}

/// `[[light]]`: a lamp, a point or a ball.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Light {
    /// Position (m).
    #[schemars(inner(range(min = -1000000000000.0, max = 1000000000000.0)))]
    pub position: [f64; 3],
    /// Radiant intensity (power per steradian): red, green, blue.
    #[schemars(inner(range(min = 0.0, max = 1000000000000.0)))]
    pub intensity: [f64; 3],
    /// Radius (m) of the shining ball; 0 is a point. Whitted takes every lamp for a point.
    #[serde(default)]
    #[schemars(range(min = 0.0, max = 1000000.0))]
    pub radius: f64,
    /// Its light group: the layer `light_<group>`, letters, digits and underscores.
    #[serde(default = "lamps")]
    pub group: String,
}

impl Light {
    /// A point at `position` (m) of this radiant intensity, in the group `lamps`.
    pub fn point(position: [f64; 3], intensity: [f64; 3]) -> Self {
        Self { position, intensity, radius: 0.0, group: lamps() }
    }
}

/// The light group of lamps that name none.
fn lamps() -> String {
    "lamps".to_owned()
}
