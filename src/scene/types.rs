//! The scene as plain data: what the TOML file says, with every default filled in.
//!
//! These types and those of `simulation` are the only list of keys: the reader, the JSON Schema and the nearest-key hints are made from them.
//! Angles are degrees and lengths metres, as a person would write them.
//! Every number has a range, wide enough for any scene and narrow enough that no product of a few overflows single precision.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Billboard, Classes, Deep, DropMatter, Foam, Light, Mist, Render, Sheet, Simulation, SizeSpreads, Water};

/// A whole scene file.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Scene {
    /// The simulation's frames.
    pub frames: Frames,
    /// What stands in the water and around it.
    pub environment: Environment,
    /// How the water's surface is represented and intersected.
    pub surface: Surface,
    /// What water does to light.
    pub water: Water,
    /// Where water is white.
    pub foam: Foam,
    /// Spray.
    pub particles: Particles,
    /// Mist from files.
    pub mist: Mist,
    /// The look of the bed and the banks.
    pub terrain: Terrain,
    /// The eye.
    pub camera: Camera,
    /// What is seen where nothing is hit, and what lights from all around.
    pub sky: Sky,
    /// The sun.
    pub sun: Sun,
    /// Lamps.
    pub light: Vec<Light>,
    /// Size, samples, integrator.
    pub render: Render,
    /// Acceleration structures by name.
    pub accel: Accel,
    /// How pictures are written.
    pub output: Output,
    /// How the frames are made.
    pub simulation: Option<Simulation>,
}

/// `[frames]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Frames {
    /// Pattern of the frames' names, relative to the scene file; `###` is the frame number in any count of digits.
    pub files: String,
    /// Frames per second.
    #[schemars(range(min = 0.001, max = 100000.0))]
    pub fps: f64,
}
impl Default for Frames {
    fn default() -> Self {
        Self { files: String::new(), fps: 24.0 }
    }
}

/// `[environment]`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Environment {
    /// The static file; by default `model.state` beside the frames, if there is one.
    pub model: Option<String>,
    /// Further meshes (.glb .gltf .obj .ply), relative to the scene file.
    pub meshes: Vec<String>,
}

/// How the water's surface is drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Representation {
    /// Flat quadrilaterals between column centres, as the report's section 2.1.
    Quads,
    /// The spline, sampled into triangles.
    Tessellated,
    /// The exact spline.
    #[default]
    Spline,
}

impl Representation {
    /// The name a scene file uses.
    pub fn name(self) -> &'static str {
        match self {
            Self::Quads => "quads",
            Self::Tessellated => "tessellated",
            Self::Spline => "spline",
        }
    }
}

/// Ray/patch solvers by name.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum SolverKind {
    /// One polynomial along the ray in Bernstein form, bracketed: finds every first crossing, the fastest.
    #[default]
    Univariate,
    /// The two-plane Newton iteration of Martin et al. 2000, guessed from subdivided Bezier hulls, proven the first or
    /// given up: also for points displaced sideways.
    Newton,
    /// The report's section 2.3.1, to compare with: five steps from the patch's middle. It loses rays.
    Report,
    /// Bezier clipping (Nishita et al. 1990), proven the first or given up: also for points displaced sideways.
    BezierClip,
    /// Double precision, every root bracketed: the slow referee of the others, also for points displaced sideways.
    Reference,
}
impl SolverKind {
    /// Every solver, for tests and benchmarks.
    pub const ALL: [Self; 5] = [Self::Univariate, Self::Newton, Self::Report, Self::BezierClip, Self::Reference];
    /// The name a scene file uses.
    pub fn name(self) -> &'static str {
        match self {
            Self::Univariate => "univariate",
            Self::Newton => "newton",
            Self::Report => "report",
            Self::BezierClip => "bezier-clip",
            Self::Reference => "reference",
        }
    }
    /// Whether it serves a surface whose control points are displaced sideways. `univariate` needs x and z linear in the
    /// spline's parameters, and the report's solver a ray's stretch over one column; displaced points give neither.
    pub fn takes_displaced(self) -> bool {
        match self {
            Self::Newton | Self::BezierClip | Self::Reference => true,
            Self::Univariate | Self::Report => false,
        }
    }
    /// Whether every first hit that double precision can tell from a graze is found: not what the report's solver
    /// promises.
    pub fn is_certain(self) -> bool {
        self != Self::Report
    }
}

/// `[surface.displacement]`: the water's control points moved sideways (the report's section 2.4).
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Displacement {
    /// How far wet columns beside dry ones are held back, against the flow: share of a column's width, reached where the
    /// flow is as fast as its own waves.
    #[schemars(range(min = 0.0, max = 0.24))]
    pub adhesion: f64,
    /// How far columns run ahead of the wet ones around them, or lag: metres per m/s of difference in flow (s). No column
    /// is moved by more than 0.24 of its width.
    #[schemars(range(min = 0.0, max = 1000.0))]
    pub shear: f64,
}
impl Displacement {
    /// Whether no point is moved.
    pub fn is_none(&self) -> bool {
        self.adhesion == 0.0 && self.shear == 0.0
    }
}

/// `[surface]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Surface {
    /// Order of the B-spline: 2, 3 or 4 (degree 1, 2, 3).
    #[schemars(range(min = 2, max = 4))]
    pub order: u32,
    /// `spline`, `quads` or `tessellated`.
    pub representation: Representation,
    /// `univariate`, `newton`, `report`, `bezier-clip` or `reference`.
    pub solver: SolverKind,
    /// Metres along the ray within which a hit is found; by default from the pixel's footprint.
    #[schemars(range(min = 0.0, max = 1000000.0))]
    pub tolerance: Option<f64>,
    /// The same in pixels, used where `tolerance` is not set.
    #[schemars(range(min = 0.000001, max = 100.0))]
    pub accuracy: f64,
    /// Factor on either for reflected, refracted and shadow rays: what they see is seen bent and faint.
    #[schemars(range(min = 1.0, max = 10000.0))]
    pub secondary_accuracy: f64,
    /// A column with less water than this (m) is dry.
    #[schemars(range(min = 0.0, max = 1000000.0))]
    pub dry_threshold: f64,
    /// How far under the base a dry column's control point lies (m); by default 0.05 of the smaller column width.
    #[schemars(range(min = 0.0, max = 1000000.0))]
    pub dry_depth: Option<f64>,
    /// Samples per column and axis of the tessellated representation.
    #[schemars(range(min = 1, max = 64))]
    pub samples: u32,
    /// Tessellate adaptively until the error on screen is under this many pixels, instead of a fixed count.
    #[schemars(range(min = 0.001, max = 100.0))]
    pub screen_error: Option<f64>,
    /// Control points moved sideways: `adhesion` along banks, `shear` along the flow.
    pub displacement: Displacement,
}
impl Default for Surface {
    fn default() -> Self {
        Self {
            order: 3,
            representation: Representation::Spline,
            solver: SolverKind::Univariate,
            tolerance: None,
            accuracy: 0.02,
            secondary_accuracy: 4.0,
            dry_threshold: 0.001,
            dry_depth: None,
            samples: 8,
            screen_error: None,
            displacement: Displacement::default(),
        }
    }
}

/// How spray is drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum ParticleRepresentation {
    /// Spheres of the particle's own volume.
    #[default]
    Spheres,
    /// Discs that face the eye.
    Billboards,
    /// One surface around drops that are close together, of the water's own matter.
    Surface,
    /// What each particle physically is: drops, sheets of water, bubbles.
    Auto,
    /// Round curves along what each particle flies while the shutter is open.
    Streamlines,
    /// Clouds of fine droplets: a medium in the air.
    Mist,
    /// Not at all.
    None,
}

/// `[particles]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Particles {
    /// `spheres`, `billboards`, `streamlines`, `mist`, `surface`, `auto` or `none`.
    pub representation: ParticleRepresentation,
    /// `diffuse`, or `water`: drops that reflect and refract as the water does.
    pub matter: DropMatter,
    /// Factor on every radius.
    #[schemars(range(min = 0.0, max = 1000000.0))]
    pub scale: f64,
    /// Spread of the radii about what the masses say: the deviation of their logarithm; the water stays the same in the mean.
    #[schemars(range(min = 0.0, max = 2.0))]
    pub size_spread: f64,
    /// The same for each class.
    pub size_spreads: SizeSpreads,
    /// Of particles with a smaller radius (pixels) some are drawn, wider, for all; 0 draws all.
    #[schemars(range(min = 0.0, max = 100.0))]
    pub least_pixels: f64,
    /// Albedo of slow or old spray.
    #[schemars(inner(range(min = 0.0, max = 1.0)))]
    pub slow_albedo: [f64; 3],
    /// Albedo of fast, young spray.
    #[schemars(inner(range(min = 0.0, max = 1.0)))]
    pub fast_albedo: [f64; 3],
    /// Speed (m/s) at which spray counts as fast.
    #[schemars(range(min = 0.001, max = 1000000.0))]
    pub fast_speed: f64,
    /// Opacity of young spray.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub opacity: f64,
    /// 1: balls and streaks are of finer drops, most of them in the middle, and stop less light towards their edges; 0: as much
    /// everywhere.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub softness: f64,
    /// Age (s) by which opacity has fallen to 1/e.
    #[schemars(range(min = 0.001, max = 1000000000.0))]
    pub fade_age: f64,
    /// What `auto` goes by.
    pub classes: Classes,
    /// How `surface` joins particles.
    pub sheet: Sheet,
    /// Seconds of flight that a streak shows; by default the time that the shutter is open, or a moment's part of it, with
    /// motion blur, and 1/50 s without.
    #[schemars(range(min = 0.0, max = 1000.0))]
    pub streak: Option<f64>,
    /// Radius of a streak's tail, as a share of its head's.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub taper: f64,
    /// Streaks whose neighbours' velocities differ by less than half of this (by the speed) are drawn as wide as the distance
    /// between them, and let as much more light through, so that they close up; from this on they have nothing to do with each
    /// other; 0: never.
    #[schemars(range(min = 0.0, max = 2.0))]
    pub merging: f64,
    /// Streaks narrower than this (pixels) are drawn as wide, and let as much more light through.
    #[schemars(range(min = 0.0, max = 100.0))]
    pub least_width: f64,
    /// Of streaks that would let through more than all but this share of the light, since they are drawn wider than they are,
    /// some are drawn for all, with this share; 0: never.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub least_opacity: f64,
    /// Radius (m) of the droplets that a particle's water is in as mist: extinction is 3 m / (2 rho radius) square metres.
    #[schemars(range(min = 0.000001, max = 100.0))]
    pub droplet_radius: f64,
    /// Share of a particle's water that is in those droplets, where all particles are drawn as mist; the rest is not drawn.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub mist_share: f64,
    /// Width (m) of a particle's cloud as mist: two standard deviations, four voxels of the grid.
    #[schemars(range(min = 0.001, max = 10000.0))]
    pub mist_width: f64,
    /// Discs that stand for particles.
    pub billboard: Billboard,
    /// Share of the light of sun and lamps that spray and mist scatter as drops of water do, by angle and colour, instead of
    /// by their plain phase functions.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub rainbow: f64,
    /// Standard deviation of the radii of drops that a rainbow is made by, as a share of each particle's.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub rainbow_spread: f64,
}
impl Default for Particles {
    fn default() -> Self {
        Self {
            representation: ParticleRepresentation::Auto,
            matter: DropMatter::Diffuse,
            scale: 1.0,
            size_spread: 0.0,
            size_spreads: SizeSpreads::default(),
            least_pixels: 0.25,
            slow_albedo: [0.72, 0.80, 0.84],
            fast_albedo: [0.94, 0.96, 0.97],
            fast_speed: 4.0,
            opacity: 0.9,
            softness: 1.0,
            fade_age: 2.0,
            classes: Classes::default(),
            sheet: Sheet::default(),
            streak: None,
            taper: 0.25,
            merging: 0.4,
            least_width: 1.0,
            least_opacity: 0.5,
            droplet_radius: 5e-5,
            mist_share: 0.002,
            mist_width: 0.25,
            billboard: Billboard::default(),
            rainbow: 0.0,
            rainbow_spread: 0.1,
        }
    }
}

/// How the ground is coloured.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Ground {
    /// Rock by slope, sand and wet darkening by the waterline, grass above.
    #[default]
    Natural,
    /// One albedo.
    Plain,
}

/// What is outside of the ground's image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum TextureWrap {
    /// The same again.
    #[default]
    Repeat,
    /// Its outermost pixels.
    Clamp,
    /// The ground without it.
    Once,
}

/// `[terrain]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Terrain {
    /// `natural` or `plain`.
    pub ground: Ground,
    /// Albedo of plain ground.
    #[schemars(inner(range(min = 0.0, max = 1.0)))]
    pub albedo: [f64; 3],
    /// Metres over which the natural ground's pattern repeats its coarsest detail; by default 20 column widths.
    #[schemars(range(min = 0.001, max = 1000000000.0))]
    pub detail: Option<f64>,
    /// An image (.png, .jpg, .exr, .hdr; .tx where OpenImageIO is built in) laid over the ground from above, relative to the
    /// scene file: its albedo, its upper edge in the north. What it leaves transparent has the ground's own colour.
    pub texture: Option<String>,
    /// What of the ground it covers once: x and z of its north-western and of its south-eastern corner (m); by default all columns.
    #[schemars(inner(range(min = -1000000000000.0, max = 1000000000000.0)))]
    pub texture_extent: Option<[f64; 4]>,
    /// `repeat`, `clamp` or `once`: what is beyond.
    pub texture_wrap: TextureWrap,
    /// Whether the bed is there at all.
    pub visible: bool,
    /// Whether the ground is closed by upright walls at the domain's edge, like a block cut out of the land.
    pub sides: bool,
}
impl Default for Terrain {
    fn default() -> Self {
        Self {
            ground: Ground::Natural,
            albedo: [0.3, 0.28, 0.24],
            detail: None,
            texture: None,
            texture_extent: None,
            texture_wrap: TextureWrap::Repeat,
            visible: true,
            sides: true,
        }
    }
}

/// One key of a camera path.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CameraKey {
    /// Frame number at which the camera is here.
    #[schemars(range(min = -1000000000.0, max = 1000000000.0))]
    pub frame: f64,
    /// Eye (m).
    #[schemars(inner(range(min = -1000000000000.0, max = 1000000000000.0)))]
    pub eye: [f64; 3],
    /// Point looked at (m).
    #[schemars(inner(range(min = -1000000000000.0, max = 1000000000000.0)))]
    pub look_at: [f64; 3],
    /// Vertical field of view (degrees); by default the camera's.
    #[serde(default)]
    #[schemars(range(min = 0.01, max = 179.0))]
    pub fov: Option<f64>,
}

/// `[camera]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Camera {
    /// Eye (m); by default framed on the water.
    #[schemars(inner(range(min = -1000000000000.0, max = 1000000000000.0)))]
    pub eye: Option<[f64; 3]>,
    /// Point looked at (m); by default framed on the water.
    #[schemars(inner(range(min = -1000000000000.0, max = 1000000000000.0)))]
    pub look_at: Option<[f64; 3]>,
    /// Up.
    #[schemars(inner(range(min = -1000000000000.0, max = 1000000000000.0)))]
    pub up: [f64; 3],
    /// Vertical field of view (degrees).
    #[schemars(range(min = 0.01, max = 179.0))]
    pub fov: f64,
    /// f-number of the thin lens (24 mm film back, height); 0 is a pinhole.
    #[schemars(range(min = 0.0, max = 1000000.0))]
    pub f_number: f64,
    /// Distance between two eyes (m), for a stereo pair; by default there is one eye.
    #[schemars(range(min = 0.000001, max = 1000000.0))]
    pub stereo: Option<f64>,
    /// A pixel's width by its height: 2 for anamorphic pictures that are shown twice as wide.
    #[schemars(range(min = 0.01, max = 100.0))]
    pub pixel_aspect: f64,
    /// Distance in focus (m); by default the distance to `look_at`.
    #[schemars(range(min = 0.000001, max = 1000000000000.0))]
    pub focus: Option<f64>,
    /// Exposure time in fractions of a frame (recorded in the picture); the shutter opens at the frame's own time.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub shutter: f64,
    /// Moments of the exposure at which water, spray and camera are taken; 1 is no motion blur.
    #[schemars(range(min = 1, max = 64))]
    pub motion_steps: u32,
    /// A path: keys by frame, smooth in position and direction.
    pub key: Vec<CameraKey>,
}
impl Default for Camera {
    fn default() -> Self {
        Self {
            eye: None,
            look_at: None,
            up: [0.0, 1.0, 0.0],
            fov: 40.0,
            f_number: 0.0,
            stereo: None,
            pixel_aspect: 1.0,
            focus: None,
            shutter: 0.5,
            motion_steps: 1,
            key: Vec::new(),
        }
    }
}

/// What surrounds the scene.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum SkyKind {
    /// An analytic daylight sky for the sun's place.
    #[default]
    Analytic,
    /// The same by the formulas of Preetham, Shirley and Smits (1999), to compare with: no twilight.
    Preetham,
    /// Two textures: sky above, ground below (the report's 4.3, filtered).
    Skybox,
    /// A latitude-longitude image (.hdr or .exr).
    Latlong,
    /// One radiance everywhere.
    Constant,
}

/// `[sky]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Sky {
    /// `analytic`, `preetham`, `skybox`, `latlong` or `constant`.
    pub kind: SkyKind,
    /// Whether the camera sees it; if not, A is 0 there. It lights the scene either way.
    pub visible: bool,
    /// Radiance of the constant sky.
    #[schemars(inner(range(min = 0.0, max = 1000000000.0)))]
    pub radiance: [f64; 3],
    /// Factor on whatever the sky is.
    #[schemars(range(min = 0.0, max = 1000000.0))]
    pub scale: f64,
    /// Haze of the analytic sky, and of Preetham's (his turbidity).
    #[schemars(range(min = 1.7, max = 10.0))]
    pub turbidity: f64,
    /// Albedo of the ground below the analytic sky's horizon, and below that of Preetham's.
    #[schemars(inner(range(min = 0.0, max = 1.0)))]
    pub ground_albedo: [f64; 3],
    /// The latlong image, relative to the scene file.
    pub image: Option<String>,
    /// The skybox's upper texture, relative to the scene file.
    pub above: Option<String>,
    /// The skybox's lower texture, relative to the scene file.
    pub below: Option<String>,
    /// Turn of the image about the vertical (degrees, eastward).
    #[schemars(range(min = -1000000.0, max = 1000000.0))]
    pub rotation: f64,
}
impl Default for Sky {
    fn default() -> Self {
        Self {
            kind: SkyKind::Analytic,
            visible: true,
            radiance: [1.0; 3],
            scale: 1.0,
            turbidity: 3.0,
            ground_albedo: [0.24, 0.22, 0.18],
            image: None,
            above: None,
            below: None,
            rotation: 0.0,
        }
    }
}

/// `[sun]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Sun {
    /// Degrees above the horizon.
    #[schemars(range(min = -90.0, max = 90.0))]
    pub elevation: f64,
    /// Degrees from north, eastward.
    #[schemars(range(min = -1000000.0, max = 1000000.0))]
    pub azimuth: f64,
    /// Irradiance on a card that faces it.
    #[schemars(range(min = 0.0, max = 1000000000.0))]
    pub irradiance: f64,
    /// Colour (scaled to a luminance of 1); by default from the sun's elevation.
    #[schemars(inner(range(min = 0.0, max = 1000000000.0)))]
    pub color: Option<[f64; 3]>,
}
impl Default for Sun {
    fn default() -> Self {
        Self { elevation: 35.0, azimuth: 130.0, irradiance: 2.2, color: None }
    }
}

/// Accelerators of the water, its sides and the bed, by name.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum WaterAccel {
    /// Embree 4.
    #[default]
    Embree,
    /// Our own walk over whole batches without Embree, sixteen rays at a time, lanes refilled.
    Stream,
    /// Column by column with the report's own solver, as its sections 2.3.1 and 2.3.2: loses and misplaces rays.
    Columns,
    /// Everything against everything.
    Brute,
}
impl WaterAccel {
    /// Whether it serves a surface whose control points are displaced sideways: what walks columns by their place on the
    /// ground does not, since displaced patches reach over their columns' borders.
    pub fn takes_displaced(self) -> bool {
        match self {
            Self::Embree | Self::Stream | Self::Brute => true,
            Self::Columns => false,
        }
    }
}

/// Accelerators of spray, meshes, panels and spheres, by name.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum ObjectsAccel {
    /// Embree 4.
    #[default]
    Embree,
    /// Boxes halved across their longest side; what a plane cuts is kept on both sides.
    Bsp,
    /// Planes where the surface-area heuristic finds them cheapest.
    BspSah,
    /// As `bsp`, but everything is kept only on its centre's side, as the report's section 3.2.1: rays may miss the rest.
    BspReport,
    /// Everything against everything.
    Brute,
}
impl ObjectsAccel {
    /// Every accelerator, for tests and benchmarks.
    pub const ALL: [Self; 5] = [Self::Embree, Self::Bsp, Self::BspSah, Self::BspReport, Self::Brute];
    /// The name a scene file uses.
    pub fn name(self) -> &'static str {
        match self {
            Self::Embree => "embree",
            Self::Bsp => "bsp",
            Self::BspSah => "bsp-sah",
            Self::BspReport => "bsp-report",
            Self::Brute => "brute",
        }
    }
}

/// `[accel]`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Accel {
    /// For the water, its sides and the bed.
    pub water: WaterAccel,
    /// For spray, meshes, panels and spheres.
    pub objects: ObjectsAccel,
    /// Most planes between the whole box and a leaf, for the `bsp` kinds; by default 20, and for `bsp-sah` 8 + 1.3 log2 of
    /// the objects.
    #[schemars(range(min = 0, max = 60))]
    pub bsp_depth: Option<u32>,
    /// A box with no more objects than this is not split, for the `bsp` kinds; by default 8, and for `bsp-sah` 4.
    #[schemars(range(min = 1, max = 1000000))]
    pub bsp_leaf: Option<u32>,
}

/// Who writes EXR files.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Writer {
    /// The crate `exr`.
    #[default]
    Exr,
    /// OpenImageIO, where it is built in.
    Oiio,
}

/// Lossless and lossy compression of EXR parts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Compression {
    /// ZIP over 16 lines, one part.
    #[default]
    Zip,
    /// ZIP over single lines, one part.
    Zips,
    /// PIZ wavelets, one part.
    Piz,
    /// DWAA 45 for colour, ZIP for data: several parts.
    Dwaa,
    /// None.
    None,
}

/// Primaries of scene-linear colours.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Colorspace {
    /// Those of Rec.709, in which everything is rendered.
    #[default]
    Rec709,
    /// AP1, as ACEScg has them.
    Acescg,
}

/// Whose names the channels of EXR have.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Profile {
    /// Those of docs/formats.md, section 3, which are Nuke's where Nuke has any.
    #[default]
    Nuke,
    /// Blender's: `ViewLayer.Combined.R`, `ViewLayer.Depth.Z` ...
    Blender,
}

/// From scene-linear to a display.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum View {
    /// A filmic curve, then sRGB.
    #[default]
    Filmic,
    /// Clipped, then sRGB.
    Srgb,
    /// A fit of the Academy's (ACES) transforms, then sRGB.
    Aces,
}

/// `[output]`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Output {
    /// `exr` or `oiio`.
    pub writer: Writer,
    /// `zip`, `zips`, `piz`, `dwaa` or `none`.
    pub compression: Compression,
    /// `rec709` or `acescg`: primaries of the colours of EXR.
    pub colorspace: Colorspace,
    /// `filmic`, `srgb` or `aces`, for PNG, JPEG and BMP.
    pub view: View,
    /// Stops of exposure for PNG, JPEG and BMP.
    #[schemars(range(min = -100.0, max = 100.0))]
    pub exposure: f64,
    /// Whose names the channels of EXR have: `nuke` or `blender`.
    pub profile: Profile,
    /// Pixels beyond the frame: a share of it on each side (`5%`) or a count (`64px`).
    pub overscan: Option<String>,
    /// Recorded in the file.
    pub owner: Option<String>,
    /// Recorded in the file.
    pub comments: Option<String>,
    /// The deep picture.
    pub deep: Deep,
}
