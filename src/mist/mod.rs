//! Fine spray as a medium: a frame's particles as soft clouds of droplets, gathered in a sparse grid of extinction, and the
//! ways of light through it.
//!
//! `kernel` says what a particle is worth, `build` fills the grid, `bricks` holds it and finds what a ray crosses,
//! `tracking` walks light through it. Into which directions mist scatters, and the light that reaches it, are the
//! integrators' matter.

mod bricks;
mod build;
mod kernel;
#[cfg(test)]
mod tests;
mod tracking;

use bricks::Bricks;

pub use kernel::cross_section;

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

/// Extinction of a frame's mist in the local frame (m): values at the voxels' corners, linear along each axis between them.
#[derive(Clone, Debug)]
pub struct Mist {
    /// Width of a voxel (m).
    voxel: f32,
    bricks: Bricks,
    /// Particles in it.
    pub particles: u64,
    /// Particles left out because they hold no water (no mass, or a scale of 0).
    pub without_mass: u64,
    /// Particles left out because their place or mass is no finite number, or 2^30 voxels or more from the scene's origin.
    pub out_of_range: u64,
}

impl Mist {
    /// Whether there is none anywhere.
    pub fn is_empty(&self) -> bool {
        self.bricks.is_empty()
    }

    /// Bytes held.
    pub fn bytes(&self) -> u64 {
        self.bricks.bytes()
    }

    /// Width of a voxel (m).
    pub fn voxel(&self) -> f32 {
        self.voxel
    }
}
