//! The ground and what stands on it: its colour, where the water meets it, how much sky it sees, meshes and solids.
//!
//! The bed's shape is a surface of its own (the surface room); here is its look, and the shapes of everything else.

mod ground;
mod mesh;
mod noise;
mod sky_view;
mod solid;
mod waterline;

use std::path::PathBuf;

pub use ground::{Ground, GroundPoint};
pub use mesh::{DEFAULT_ALBEDO, Mesh, MeshAlbedo, load_mesh};
pub use sky_view::SkyView;
pub use solid::{Ball, ball, panel};
pub use waterline::Waterline;

/// What can be wrong with meshes and solids.
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
}
