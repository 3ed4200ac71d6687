//! The water and the bed as height functions: uniform B-splines over the columns.

pub mod audit;
mod brute;
pub mod control;
pub mod displaced;
pub mod kernels;
mod lanes;
mod lattice;
mod pyramid;
pub mod quads;
pub mod referee;
mod sides;
mod solve;
mod spline;
pub mod tessellate;
mod walk;

pub use brute::BruteSurface;
pub use displaced::{BruteDisplaced, DisplacedSurface};
pub use lanes::{LANES, LaneHits, LaneRays, LaneSurface, SingleAnswer, SingleHit, SingleRay, SurfacePoint};
pub use lattice::{Lattice, LatticeError, basis, to_bezier};
pub use sides::Sides;
pub(crate) use solve::report as report_solver;
pub use spline::SplineSurface;

/// Whoever builds a surface names its instruction set.
pub use crate::simd::SimdLevel;

/// Work and doubt of the solvers, summed over a batch.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct SolveCounts {
    /// Patches that a ray was solved against.
    pub patches: u64,
    /// Steps of the iteration.
    pub iterations: u64,
    /// Rays for which a solver could not decide between hit and miss.
    pub gave_up: u64,
}

impl std::ops::AddAssign for SolveCounts {
    fn add_assign(&mut self, other: Self) {
        self.patches += other.patches;
        self.iterations += other.iterations;
        self.gave_up += other.gave_up;
    }
}

#[cfg(test)]
mod tests;
