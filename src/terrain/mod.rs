//! The ground and what stands on it: its colour, where the water meets it, how much sky it sees, meshes and solids.
//!
//! The bed's shape is a surface of its own (the surface room); here is its look, and the shapes of everything else. Height
//! maps and landforms are where a simulation's bed comes from.

mod albedo_image;
mod ground;
mod ground_texture;
mod height_map;
mod landform;
mod mesh;
mod noise;
mod sky_view;
mod solid;
mod waterline;

use std::path::PathBuf;

pub use ground::{Ground, GroundPoint};
pub use ground_texture::{GroundTexture, PlacedTexture};
pub use height_map::{HeightMap, Reading};
pub use landform::{LARGEST_NUMBER_OF_COLUMNS, land};
pub use mesh::{DEFAULT_ALBEDO, Mesh, MeshAlbedo, MeshImages, load_mesh};
pub use sky_view::SkyView;
pub use solid::{Ball, ball, panel};
pub use waterline::Waterline;

/// What can be wrong with meshes, solids, height maps and landforms.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TerrainError {
    /// The file's ending names no format that is read.
    #[error("{path}: not a kind of mesh that is read; expected .obj, .gltf, .glb or .ply", path = path.display())]
    UnknownFormat {
        /// The file.
        path: PathBuf,
    },
    /// The file cannot be read or understood.
    #[error("{path}: the mesh cannot be read: {reason}", path = path.display())]
    Mesh {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// The file holds no triangle.
    #[error("{path}: the mesh holds no triangles ({vertices} vertices); expected at least one", path = path.display())]
    Empty {
        /// The file.
        path: PathBuf,
        /// Vertices that it does hold.
        vertices: usize,
    },
    /// A number is not one, or a colour is no share.
    #[error("{path}: {what} of vertex {vertex} is {value:?}; expected {expected}", path = path.display())]
    Vertex {
        /// The file.
        path: PathBuf,
        /// Position, normal or albedo.
        what: &'static str,
        /// Which vertex, in the order of the loaded mesh.
        vertex: usize,
        /// What it holds.
        value: [f64; 3],
        /// What it should hold.
        expected: &'static str,
    },
    /// A triangle names a vertex that is not there.
    #[error("{path}: triangle {triangle} names vertex {index}; the mesh has {vertices}", path = path.display())]
    Index {
        /// The file.
        path: PathBuf,
        /// Which triangle.
        triangle: usize,
        /// The vertex that it names.
        index: u32,
        /// How many there are.
        vertices: usize,
    },
    /// The image of the ground cannot be read, or could not be read any more.
    #[error("terrain.texture: {0}")]
    Texture(#[from] crate::images::Unreadable),
    /// A panel whose corners span nothing.
    #[error("panel {corners:?} has no area; expected four corners, counter-clockwise seen from outside")]
    FlatPanel {
        /// Its corners (m).
        corners: [[f64; 3]; 4],
    },
    /// A sphere without a size.
    #[error("sphere at {center:?} has radius {radius}; expected a finite number above 0")]
    Sphere {
        /// Its centre (m).
        center: [f64; 3],
        /// Its radius (m).
        radius: f64,
    },
    /// The file's ending names no height map that is read.
    #[error(
        "{path}: not a kind of height map that is read; expected .tif (GeoTIFF), .png (16 bit), .exr, .asc (ESRI ASCII grid), \
         .npz or .state",
        path = path.display()
    )]
    UnknownMap {
        /// The file.
        path: PathBuf,
    },
    /// The system could not open or read a file.
    #[error("{path}: cannot be read: {source}", path = path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// A height map holds something wrong, or something that is not read.
    #[error("{path}: {place}: {found}; expected {expected}", path = path.display())]
    Map {
        /// The file.
        path: PathBuf,
        /// Where in it.
        place: String,
        /// What stands there.
        found: String,
        /// What should.
        expected: String,
    },
    /// A frame that should serve as a height map.
    #[error(transparent)]
    Frame(#[from] crate::state::StateError),
    /// Samples without data.
    #[error(
        "{path}: no data in {count} of {samples} samples, the first at column {}, row {}; expected a height in each: \
         crop the map to a part without holes, or fill them",
        first[0], first[1], path = path.display()
    )]
    Holes {
        /// The file.
        path: PathBuf,
        /// How many have none.
        count: usize,
        /// Of how many.
        samples: usize,
        /// Column and row of the first, counted from 0 in the whole map.
        first: [usize; 2],
    },
    /// A part of a map that it does not have.
    #[error(
        "{path}: crop {crop:?}: expected first column, first row, last column, last row within {nx} x {nz} samples",
        path = path.display()
    )]
    Crop {
        /// The file.
        path: PathBuf,
        /// The part.
        crop: [usize; 4],
        /// Samples along x.
        nx: usize,
        /// Samples along z.
        nz: usize,
    },
    /// Neither the file nor the scene says how far the samples are apart.
    #[error("{path}: the file does not say how far its samples are apart; expected simulation.terrain.spacing", path = path.display())]
    NoSpacing {
        /// The file.
        path: PathBuf,
    },
    /// A picture whose samples are not metres.
    #[error(
        "{path}: the samples of a PNG are no heights by themselves; expected what black and white stand for, \
         simulation.terrain.heights (of a map of depths, simulation.water.depths)",
        path = path.display()
    )]
    NoHeights {
        /// The file.
        path: PathBuf,
    },
    /// Keys of a landform that do not fit together, or do not fit its map.
    #[error("simulation.terrain.{key}: {found}; expected {expected}")]
    Landform {
        /// The key under `simulation.terrain`.
        key: &'static str,
        /// What it says.
        found: String,
        /// What would fit.
        expected: String,
    },
}
