//! Fine spray as a medium: a frame's particles as soft clouds of droplets, gathered in a sparse grid of extinction, and the
//! ways of light through it.
//!
//! `kernel` says what a particle is worth, `build` fills the grid, `bricks` holds it and finds what a ray crosses,
//! `tracking` walks light through it. `vdb` reads a file's density, `volume` makes a grid of it, and `sum` walks light
//! through both. Into which directions mist scatters, and the light that reaches it, are the
//! integrators' matter.

mod bricks;
mod build;
mod grid;
mod kernel;
mod sum;
#[cfg(test)]
mod tests;
mod tracking;
mod vdb;
mod volume;
#[cfg(test)]
mod volume_tests;

pub use grid::Grid;
pub use kernel::cross_section;
pub use volume::{Volume, VolumeError};

/// Bytes that one moment's mist may take: a twelfth of a machine with 24 GB, 700,000 bricks.
pub const BUDGET: u64 = 2 << 30;

/// Greatest extinction (1/m) of a mist: light ends in a 1e-20th of a metre, and no product of two such overflows.
const DENSEST: f64 = 1e18;

/// Why a mist cannot be built.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum MistError {
    /// The grid would take more than the budget.
    #[error(
        "the mist of {particles} particles takes at least {bytes} bytes in voxels of {voxel} m (a quarter of \
         particles.mist_width); expected at most {budget} bytes: raise particles.mist_width"
    )]
    TooLarge {
        /// Particles in it.
        particles: u64,
        /// Bytes that the grid needs at least.
        bytes: u64,
        /// Bytes that it may take.
        budget: u64,
        /// Width of a voxel (m).
        voxel: f64,
    },
    /// Light would not get anywhere in it.
    #[error(
        "the mist's extinction reaches {extinction:e} 1/m; expected at most {DENSEST:e} 1/m: raise \
         particles.droplet_radius or particles.mist_width"
    )]
    TooDense {
        /// The greatest extinction (1/m).
        extinction: f64,
    },
}

/// What a mist is made of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MistSettings {
    /// Radius of the droplets (m).
    pub droplet_radius: f64,
    /// Width of a particle's cloud (m): two standard deviations of a Gaussian, four voxels.
    pub width: f64,
    /// Factor on the radius of the ball that a particle's water would fill.
    pub scale: f64,
}

impl MistSettings {
    /// What a scene says of it.
    pub fn from_scene(particles: &crate::scene::Particles) -> Self {
        Self { droplet_radius: particles.droplet_radius, width: particles.mist_width, scale: particles.scale }
    }
}

/// Particles as a mist takes them, in the files' frame, one array per field.
#[derive(Clone, Copy, Debug)]
pub struct Droplets<'a> {
    /// Places (m).
    pub position: &'a [[f64; 3]],
    /// Velocities (m/s); none for mist that stands still.
    pub velocity: &'a [[f64; 3]],
    /// Water (kg).
    pub mass: &'a [f64],
}

/// Extinction of a frame's mist in the local frame (m): values at the voxels' corners, linear along each axis between them; the
/// sum of its grids.
#[derive(Clone, Debug, Default)]
pub struct Mist {
    /// That of the particles, that of a file; a mist has either or both.
    grids: Vec<Grid>,
    /// Particles in it.
    pub particles: u64,
    /// Particles left out because they hold no water (no mass, or a scale of 0).
    pub without_mass: u64,
    /// Particles left out because their place or mass is no finite number, or 2^30 voxels or more from the scene's origin.
    pub out_of_range: u64,
}

impl Mist {
    /// The same mist and another grid's.
    pub fn and(mut self, grid: Grid) -> Self {
        self.grids.push(grid);
        self
    }

    /// Whether there is none anywhere.
    pub fn is_empty(&self) -> bool {
        self.grids.iter().all(|grid| grid.bricks.is_empty())
    }

    /// Bytes held.
    pub fn bytes(&self) -> u64 {
        self.grids.iter().map(Grid::bytes).sum()
    }

    /// Least width of a voxel (m); 0 where there is none.
    pub fn voxel(&self) -> f32 {
        self.grids.iter().map(Grid::voxel).reduce(f32::min).unwrap_or(0.0)
    }
}
