//! `[simulation]`: everything that `whitewater simulate` reads, as plain data. Part of the list of keys in `types`.
//!
//! Heights and places are metres in the simulation's own frame (x east, z south, y up), the frame of the files it writes.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// `[simulation]`: how the frames of this scene are made.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Simulation {
    /// Seconds from the first frame to the last; `simulate --frames` wins.
    #[schemars(range(min = 0.0, max = 1000000.0))]
    pub duration: f64,
    /// Seconds that pass before frame 0, so that it shows running water.
    #[schemars(range(min = 0.0, max = 1000000.0))]
    pub settle: f64,
    /// The longest time step (s); shorter ones are taken where waves would outrun it.
    #[schemars(range(min = 0.000001, max = 1000.0))]
    pub step: Option<f64>,
    /// Share of a column that the fastest wave may cross in a step.
    #[schemars(range(min = 0.01, max = 0.8))]
    pub courant: f64,
    /// Steps that one frame may take at most; more are an error that says which column asks for them.
    #[schemars(range(min = 1, max = 1000000000))]
    pub most_steps: u32,
    /// Acceleration due to gravity (m/s2).
    #[schemars(range(min = 0.001, max = 1000.0))]
    pub gravity: f64,
    /// Share of a pipe's flow that is left after `reference_step` (the report's 0.995).
    #[schemars(range(min = 0.0, max = 1.0))]
    pub friction: f64,
    /// The time step (s) that `friction` belongs to.
    #[schemars(range(min = 0.000001, max = 1000000.0))]
    pub reference_step: f64,
    /// Manning's roughness of the bed (s/m^(1/3)); 0 leaves bed friction out, as the report does.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub manning: f64,
    /// Height (m) of the cells that columns are divided in (Mould and Yang 1997); by default a column is one cell.
    #[schemars(range(min = 0.001, max = 1000000.0))]
    pub cell_height: Option<f64>,
    /// Seed of everything random.
    pub seed: u32,
    /// A model file whose spheres and panels the spray bounces off; copied to `model.state` beside the frames.
    pub model: Option<String>,
    /// The ground under the water.
    pub terrain: Landform,
    /// Water at the start.
    pub water: InitialWater,
    /// Columns that water comes from.
    pub source: Vec<Source>,
    /// Columns that water leaves by.
    pub sink: Vec<Sink>,
    /// External pressure on the water.
    pub pressure: Vec<PressedRegion>,
    /// Water that breaks free.
    pub spray: SpraySettings,
    /// Whether foam is made as `[foam]` says, carried from step to step, and written in the frames (NPZ; text has no place for it).
    pub foam: bool,
}
impl Default for Simulation {
    fn default() -> Self {
        Self {
            duration: 2.0,
            settle: 0.0,
            step: None,
            courant: 0.4,
            most_steps: 100_000,
            gravity: 9.81,
            friction: 0.995,
            reference_step: 0.01,
            manning: 0.0,
            cell_height: None,
            seed: 0,
            model: None,
            terrain: Landform::default(),
            water: InitialWater::default(),
            source: Vec::new(),
            sink: Vec::new(),
            pressure: Vec::new(),
            spray: SpraySettings::default(),
            foam: false,
        }
    }
}

/// Landforms by name.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum LandformKind {
    /// A height map from `file`.
    File,
    /// A plane that falls eastward by `slope`.
    #[default]
    Plane,
    /// A winding valley that falls eastward by `slope`.
    Valley,
}

/// `[simulation.terrain]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Landform {
    /// `file`, `plane` or `valley`.
    pub kind: LandformKind,
    /// A height map: .tif (GeoTIFF), .png (16 bit), .exr (channel Y, Z or R), .asc (ESRI ASCII grid), .npz or .state (array `base`), relative to the scene file.
    pub file: Option<String>,
    /// Part of the height map to take, in its samples: first column, first row, last column, last row.
    #[schemars(inner(range(min = 0, max = 1000000)))]
    pub crop: Option<[u32; 4]>,
    /// Metres between the height map's samples, x and z, where the file does not say (or instead of what it says).
    #[schemars(inner(range(min = 0.000001, max = 1000000.0)))]
    pub spacing: Option<[f64; 2]>,
    /// Heights (m) of an image's black and white; samples of a .tif or .exr are metres without it.
    #[schemars(inner(range(min = -1000000.0, max = 1000000.0)))]
    pub heights: Option<[f64; 2]>,
    /// Factor on a height map's plan.
    #[schemars(range(min = 0.000001, max = 1000000.0))]
    pub scale: f64,
    /// Factor on a height map's heights; by default that on its plan.
    #[schemars(range(min = 0.0, max = 1000000.0))]
    pub vertical_scale: Option<f64>,
    /// Columns along x and z, taken from the middle of the height map; by default one for each of its samples, 80 by 20 without one.
    #[schemars(inner(range(min = 3, max = 32768)))]
    pub columns: Option<[u32; 2]>,
    /// Width of a column (m), x and z; by default the height map over its columns, 0.25 without one.
    #[schemars(inner(range(min = 0.000001, max = 1000000.0)))]
    pub width: Option<[f64; 2]>,
    /// x and z of the centre of column (0, 0).
    #[schemars(inner(range(min = -1000000000.0, max = 1000000000.0)))]
    pub origin: [f64; 2],
    /// Height of the lowest column's base (m); by default as the map says, 0 at a plane's western edge and on the floor of a valley's.
    #[schemars(range(min = -1000000.0, max = 1000000.0))]
    pub lowest: Option<f64>,
    /// Root mean square (m) of the fractal detail that is laid over the landform, all its octaves together.
    #[schemars(range(min = 0.0, max = 100000.0))]
    pub detail: f64,
    /// Wavelength (m) of the coarsest detail; by default the spacing of the height map's samples, 8 columns without one.
    #[schemars(range(min = 0.000001, max = 1000000.0))]
    pub detail_size: Option<f64>,
    /// Amplitude of each octave of detail to that of the one before, whose waves are 2.1 times as long.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub detail_gain: f64,
    /// Fall of a plane or valley, metres per metre eastward.
    #[schemars(range(min = -10.0, max = 10.0))]
    pub slope: f64,
    /// Height (m) of a valley's sides over its floor.
    #[schemars(range(min = 0.0, max = 100000.0))]
    pub relief: f64,
    /// Width (m) of a valley's floor; by default a third of the landform's width.
    #[schemars(range(min = 0.0, max = 1000000.0))]
    pub floor: Option<f64>,
    /// Share of the landform's width that a valley winds to each side.
    #[schemars(range(min = 0.0, max = 0.5))]
    pub meander: f64,
    /// Steps in the ground, facing east.
    pub ledge: Vec<Ledge>,
}
impl Default for Landform {
    fn default() -> Self {
        Self {
            kind: LandformKind::Plane,
            file: None,
            crop: None,
            spacing: None,
            heights: None,
            scale: 1.0,
            vertical_scale: None,
            columns: None,
            width: None,
            origin: [0.0; 2],
            lowest: None,
            detail: 0.0,
            detail_size: None,
            detail_gain: 0.5,
            slope: 0.0,
            relief: 2.0,
            floor: None,
            meander: 0.15,
            ledge: Vec::new(),
        }
    }
}

/// `[[simulation.terrain.ledge]]`: the ground east of `at` lies `drop` lower.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Ledge {
    /// x where it stands (m).
    #[schemars(range(min = -1000000000.0, max = 1000000000.0))]
    pub at: f64,
    /// How far the ground drops (m); negative for a step up.
    #[schemars(range(min = -100000.0, max = 100000.0))]
    pub drop: f64,
    /// Metres over which it drops; 0 for a cliff.
    #[schemars(range(min = 0.0, max = 1000000.0))]
    pub run: f64,
}

/// `[simulation.water]`: several of these add up to the highest.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct InitialWater {
    /// Height (m) up to which the ground is filled.
    #[schemars(range(min = -1000000.0, max = 1000000.0))]
    pub level: Option<f64>,
    /// The same depth (m) everywhere.
    #[schemars(range(min = 0.0, max = 1000000.0))]
    pub depth: Option<f64>,
    /// A map of depths (m), in any of the forms of a height map, as many samples as columns.
    pub depth_map: Option<String>,
    /// Heights (m) of an image's black and white in `depth_map`.
    #[schemars(inner(range(min = 0.0, max = 1000000.0)))]
    pub depths: Option<[f64; 2]>,
    /// Rain (mm per hour).
    #[schemars(range(min = 0.0, max = 100000000.0))]
    pub rain: f64,
    /// When the rain ends (s; frame 0 is at 0, settling before it).
    #[schemars(range(min = -1000000.0, max = 1000000.0))]
    pub rain_end: Option<f64>,
    /// Bodies of water, each in its own region.
    pub body: Vec<Body>,
}

/// A side of the map.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Edge {
    /// Row 0.
    North,
    /// The last column.
    East,
    /// The last row.
    South,
    /// Column 0.
    West,
}

/// `[[simulation.water.body]]`: a region's columns are those whose centres lie in all the shapes that it names.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Body {
    /// x0, z0, x1, z1 (m).
    #[schemars(inner(range(min = -1000000000.0, max = 1000000000.0)))]
    pub rectangle: Option<[f64; 4]>,
    /// x, z, radius (m).
    #[schemars(inner(range(min = -1000000000.0, max = 1000000000.0)))]
    pub circle: Option<[f64; 3]>,
    /// The outermost columns of one side.
    pub edge: Option<Edge>,
    /// Height (m) up to which it is filled.
    #[schemars(range(min = -1000000.0, max = 1000000.0))]
    pub level: Option<f64>,
    /// Depth (m), where no level is given.
    #[schemars(range(min = 0.0, max = 1000000.0))]
    pub depth: Option<f64>,
}

/// `[[simulation.source]]`: columns that keep a level or depth, or get a discharge.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Source {
    /// x0, z0, x1, z1 (m).
    #[schemars(inner(range(min = -1000000000.0, max = 1000000000.0)))]
    pub rectangle: Option<[f64; 4]>,
    /// x, z, radius (m).
    #[schemars(inner(range(min = -1000000000.0, max = 1000000000.0)))]
    pub circle: Option<[f64; 3]>,
    /// The outermost columns of one side.
    pub edge: Option<Edge>,
    /// Height (m) that the water keeps where the ground is lower.
    #[schemars(range(min = -1000000.0, max = 1000000.0))]
    pub level: Option<f64>,
    /// Depth (m) that the water keeps.
    #[schemars(range(min = 0.0, max = 1000000.0))]
    pub depth: Option<f64>,
    /// Water that is poured in, m3/s over the whole region.
    #[schemars(range(min = 0.0, max = 1000000000.0))]
    pub discharge: Option<f64>,
    /// When it begins (s); by default it is always there.
    #[schemars(range(min = -1000000.0, max = 1000000.0))]
    pub begin: Option<f64>,
    /// When it ends (s).
    #[schemars(range(min = -1000000.0, max = 1000000.0))]
    pub end: Option<f64>,
}

/// `[[simulation.sink]]`: columns that keep a low level or depth, by default no water at all.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Sink {
    /// x0, z0, x1, z1 (m).
    #[schemars(inner(range(min = -1000000000.0, max = 1000000000.0)))]
    pub rectangle: Option<[f64; 4]>,
    /// x, z, radius (m).
    #[schemars(inner(range(min = -1000000000.0, max = 1000000000.0)))]
    pub circle: Option<[f64; 3]>,
    /// The outermost columns of one side.
    pub edge: Option<Edge>,
    /// Height (m) that the water keeps.
    #[schemars(range(min = -1000000.0, max = 1000000.0))]
    pub level: Option<f64>,
    /// Depth (m) that the water keeps, where no level is given.
    #[schemars(range(min = 0.0, max = 1000000.0))]
    pub depth: Option<f64>,
}

/// `[[simulation.pressure]]`: the E of the report's equation for pressure.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct PressedRegion {
    /// x0, z0, x1, z1 (m).
    #[schemars(inner(range(min = -1000000000.0, max = 1000000000.0)))]
    pub rectangle: Option<[f64; 4]>,
    /// x, z, radius (m).
    #[schemars(inner(range(min = -1000000000.0, max = 1000000000.0)))]
    pub circle: Option<[f64; 3]>,
    /// The outermost columns of one side.
    pub edge: Option<Edge>,
    /// Pressure above air's (Pa).
    #[schemars(range(min = -100000000.0, max = 100000000.0))]
    pub pascal: f64,
    /// When it begins (s); by default it is always there.
    #[schemars(range(min = -1000000.0, max = 1000000.0))]
    pub begin: Option<f64>,
    /// When it ends (s).
    #[schemars(range(min = -1000000.0, max = 1000000.0))]
    pub end: Option<f64>,
}

/// `[simulation.spray]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct SpraySettings {
    /// Whether water breaks free at all.
    pub enabled: bool,
    /// Volume of a particle (m3); by default a ball of a fifth of a column's width.
    #[schemars(range(min = 1e-12, max = 1000000.0))]
    pub volume: Option<f64>,
    /// A crest is unstable where it is higher than this share of the depth before it.
    #[schemars(range(min = 0.0, max = 1000.0))]
    pub threshold: f64,
    /// The least height (m) of a crest that sheds spray; by default a particle's diameter.
    #[schemars(range(min = 0.0, max = 1000000.0))]
    pub least_height: Option<f64>,
    /// The weir's discharge coefficient: 1 as in the report, 0.58 for a real broad crest.
    #[schemars(range(min = 0.0, max = 10.0))]
    pub discharge: f64,
    /// Share of the speed across ground, spheres and panels that is left after a bounce.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub restitution: f64,
    /// Seconds in which a particle that fell in the water gives it 63 % of its mass.
    #[schemars(range(min = 0.000001, max = 1000000.0))]
    pub absorption_time: f64,
    /// Particles at most; beyond them crests stay in the columns.
    #[schemars(range(min = 0, max = 100000000))]
    pub most: u32,
}
impl Default for SpraySettings {
    fn default() -> Self {
        Self {
            enabled: true,
            volume: None,
            threshold: 0.78,
            least_height: None,
            discharge: 1.0,
            restitution: 0.3,
            absorption_time: 0.1,
            most: 1_000_000,
        }
    }
}
