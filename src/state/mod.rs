//! The simulation's files: `model.state`, `time###.state` as text and as NPZ.
//!
//! Everything here is double precision in the file's own frame; nothing is recentred or repaired.

/// One time step.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Frame {
    /// Time (s).
    pub time: f64,
    /// The body of water.
    pub columns: Columns,
    /// The spray.
    pub particles: Particles,
    /// Arrays of an NPZ that are not ours: kept out of the way, named by `inspect`.
    pub extra: Vec<ExtraArray>,
}

/// An array that a frame carries and we do not read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ExtraArray {
    /// Its name in the archive.
    pub name: String,
    /// Its shape.
    pub shape: Vec<u64>,
    /// Its numpy type string, as `<f4`.
    pub dtype: String,
}

/// A map of columns. Index `z * nx + x`; row 0 is the northern edge (least z).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Columns {
    /// x, z of the centre of column (0, 0) (m).
    pub origin: [f64; 2],
    /// dx, dz of every column (m), positive.
    pub width: [f64; 2],
    /// Columns along x, at least 3.
    pub nx: usize,
    /// Columns along z, at least 3.
    pub nz: usize,
    /// Height of the terrain (m).
    pub base: Vec<f64>,
    /// Height of the water's upper side (m).
    pub top: Vec<f64>,
    /// Pressure above air (Pa).
    pub pressure: Vec<f64>,
    /// Depth-averaged velocity, x and z (m/s).
    pub flow: Vec<[f64; 2]>,
}

/// Spray, one array per field.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Particles {
    /// x, y, z (m).
    pub position: Vec<[f64; 3]>,
    /// Velocity (m/s).
    pub velocity: Vec<[f64; 3]>,
    /// Mass of water (kg).
    pub mass: Vec<f64>,
    /// Time since it broke free (s).
    pub age: Vec<f64>,
    /// Stable identities, where the file has them.
    pub id: Option<Vec<u64>>,
}

/// What does not move.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Model {
    /// Quadrilaterals.
    pub panels: Vec<Panel>,
    /// Spheres.
    pub spheres: Vec<Sphere>,
    /// Paths of meshes, relative to the model file, as written.
    pub meshes: Vec<String>,
}

/// A quadrilateral, corners counter-clockwise seen from outside.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Panel {
    /// Corners (m).
    pub corners: [[f64; 3]; 4],
    /// Linear Rec.709 albedo.
    pub albedo: [f64; 3],
}

/// A sphere.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sphere {
    /// Centre (m).
    pub center: [f64; 3],
    /// Radius (m).
    pub radius: f64,
    /// Linear Rec.709 albedo.
    pub albedo: [f64; 3],
}
