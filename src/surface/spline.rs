//! The spline surface as a thing to evaluate and to intersect.

use std::slice;

use glam::Vec3;

use super::lattice::Lattice;
use super::pyramid::Pyramid;
use super::solve::{PerLane, RayAtATime, Univariate};
use super::walk::{SingleWalk, Walk};
use super::{LANES, LaneHits, LaneRays, LaneSurface, SingleAnswer, SingleRay, SolveCounts, SurfacePoint};
use crate::scene::SolverKind;
use crate::simd::{SimdLevel, dispatch, dispatch_single, portable};

/// Packets of a stream that share their lanes at a time: enough that lanes rarely idle, few enough to stay in cache.
const BLOCK: usize = 32;

/// A B-spline height function over a map of columns, with its bounds and its solver.
#[derive(Clone, Debug)]
pub struct SplineSurface {
    lattice: Lattice,
    pyramid: Pyramid,
    range: Option<[f64; 2]>,
    solver: SolverKind,
    simd: SimdLevel,
}

impl SplineSurface {
    /// A surface over a lattice, with a solver by name and an instruction set.
    pub fn new(lattice: Lattice, solver: SolverKind, simd: SimdLevel) -> Self {
        let pyramid = Pyramid::build(&lattice, simd);
        let range = pyramid.range();
        Self { lattice, pyramid, range, solver, simd }
    }

    /// The control heights.
    pub fn lattice(&self) -> &Lattice {
        &self.lattice
    }

    /// The instruction set that it is solved with.
    pub(crate) fn simd(&self) -> SimdLevel {
        self.simd
    }

    /// The solver's name.
    pub fn solver(&self) -> SolverKind {
        self.solver
    }

    /// Point and upward normal of patch `patch` at `u`, `v` (each 0..1).
    pub fn patch_point(&self, patch: u32, u: f32, v: f32) -> SurfacePoint {
        let (i, j) = (patch as usize % self.lattice.cells[0], patch as usize / self.lattice.cells[0]);
        let (height, slope) = self.lattice.evaluate(i, j, f64::from(u), f64::from(v));
        let [x, z] = self.lattice.from_cell([i as f64 + f64::from(u), j as f64 + f64::from(v)]);
        let normal = Vec3::new(-slope[0] as f32, 1.0, -slope[1] as f32).normalize();
        SurfacePoint { position: Vec3::new(x as f32, height as f32, z as f32), normal }
    }

    /// Cell of a local x, z within the domain and the place in it; `None` outside, or where no patch exists.
    fn locate(&self, x: f64, z: f64) -> Option<([usize; 2], [f64; 2])> {
        let mut at = self.lattice.to_cell(x, z);
        let mut cell = [0; 2];
        for axis in 0..2 {
            let [low, high] = [self.lattice.domain[0][axis], self.lattice.domain[1][axis]];
            // A place on the domain's edge, computed from it, comes back within a few units in the last place.
            let offset = (self.lattice.corner[axis] / self.lattice.width[axis]).abs();
            let room = 8.0 * f64::EPSILON * (offset + at[axis].abs() + 1.0);
            if !(low - room..=high + room).contains(&at[axis]) {
                return None;
            }
            at[axis] = at[axis].clamp(low, high);
            cell[axis] = (at[axis] as usize).min(self.lattice.cells[axis] - 1);
        }
        let cell = self.lattice.closed_cell(at, cell);
        let place = [at[0] - cell[0] as f64, at[1] - cell[1] as f64];
        self.lattice.exists(cell[0], cell[1]).then_some((cell, place))
    }

    /// Height at x, z of the local frame; `None` outside the domain or where no patch exists.
    pub fn height(&self, x: f32, z: f32) -> Option<f32> {
        self.point(f64::from(x), f64::from(z)).map(|(height, _)| height as f32)
    }

    /// Height (m) and slopes dy/dx, dy/dz at x, z of the local frame, in double precision.
    pub fn point(&self, x: f64, z: f64) -> Option<(f64, [f64; 2])> {
        let (cell, place) = self.locate(x, z)?;
        Some(self.lattice.evaluate(cell[0], cell[1], place[0], place[1]))
    }

    /// Least and greatest x and z of the domain: `[x0, z0], [x1, z1]`.
    pub fn domain(&self) -> ([f32; 2], [f32; 2]) {
        let [low, high] = self.lattice.domain.map(|corner| self.lattice.from_cell(corner).map(|c| c as f32));
        (low, high)
    }

    /// Least and greatest height of any patch (m), padded outward; `None` where no patch exists.
    pub fn height_range(&self) -> Option<[f64; 2]> {
        self.range
    }

    /// As many `hits` as packets, all missing; at most [`BLOCK`] packets, with one growth of the tolerance.
    fn walk<const ANY: bool, const N: usize, const G: usize>(
        &self,
        rays: &[LaneRays],
        hits: &mut [LaneHits],
        counts: &mut SolveCounts,
    ) {
        let Some(range) = self.range else { return };
        let (lattice, pyramid) = (&self.lattice, &self.pyramid);
        macro_rules! walk {
            ($solver:expr, $K:literal, $D:literal) => {
                Walk::<_, $K, $D, ANY, N, G> { lattice, pyramid, range, solver: $solver, rays, hits, counts }
            };
        }
        match (RayAtATime::of(self.solver), lattice.order) {
            (None, 2) => dispatch(self.simd, walk!(Univariate, 2, 2)),
            (None, 3) => dispatch(self.simd, walk!(Univariate, 3, 4)),
            (None, _) => dispatch(self.simd, walk!(Univariate, 4, 6)),
            // These work a ray at a time: wide lanes would only idle.
            (Some(solver), 2) => portable(walk!(PerLane(solver), 2, 2)),
            (Some(solver), 3) => portable(walk!(PerLane(solver), 3, 4)),
            (Some(solver), _) => portable(walk!(PerLane(solver), 4, 6)),
        }
    }

    fn walk_single<const ANY: bool>(&self, ray: &SingleRay, counts: &mut SolveCounts) -> SingleAnswer {
        let Some(range) = self.range else { return SingleAnswer::Miss };
        let (lattice, pyramid) = (&self.lattice, &self.pyramid);
        macro_rules! walk {
            ($solver:expr, $K:literal, $D:literal) => {
                SingleWalk::<_, $K, $D, ANY> { lattice, pyramid, range, solver: $solver, ray, counts }
            };
        }
        match (RayAtATime::of(self.solver), lattice.order) {
            (None, 2) => dispatch_single(self.simd, walk!(Univariate, 2, 2)),
            (None, 3) => dispatch_single(self.simd, walk!(Univariate, 3, 4)),
            (None, _) => dispatch_single(self.simd, walk!(Univariate, 4, 6)),
            (Some(solver), 2) => dispatch_single(self.simd, walk!(PerLane(solver), 2, 2)),
            (Some(solver), 3) => dispatch_single(self.simd, walk!(PerLane(solver), 3, 4)),
            (Some(solver), _) => dispatch_single(self.simd, walk!(PerLane(solver), 4, 6)),
        }
    }
}

impl LaneSurface for SplineSurface {
    fn bounds(&self) -> [Vec3; 2] {
        let Some(range) = self.range else { return [Vec3::ZERO; 2] };
        let [low, high] = self.lattice.domain.map(|corner| self.lattice.from_cell(corner));
        // Outward by one unit in the last place: the conversion to single precision may have gone inward.
        [
            Vec3::new((low[0] as f32).next_down(), (range[0] as f32).next_down(), (low[1] as f32).next_down()),
            Vec3::new((high[0] as f32).next_up(), (range[1] as f32).next_up(), (high[1] as f32).next_up()),
        ]
    }

    fn closest(&self, rays: &LaneRays, hits: &mut LaneHits, counts: &mut SolveCounts) {
        hits.hit = 0;
        hits.gave_up = 0;
        self.walk::<false, LANES, 1>(slice::from_ref(rays), slice::from_mut(hits), counts);
    }

    fn occluded(&self, rays: &LaneRays, counts: &mut SolveCounts) -> u16 {
        let mut hits = LaneHits::EMPTY;
        self.walk::<true, LANES, 1>(slice::from_ref(rays), slice::from_mut(&mut hits), counts);
        hits.hit
    }

    fn closest_stream(&self, rays: &[LaneRays], hits: &mut [LaneHits], counts: &mut SolveCounts) {
        for (rays, hits) in rays.chunks(BLOCK).zip(hits.chunks_mut(BLOCK)) {
            for hits in &mut *hits {
                hits.hit = 0;
                hits.gave_up = 0;
            }
            self.walk::<false, { BLOCK * LANES }, 2>(rays, hits, counts);
        }
    }

    fn occluded_stream(&self, rays: &[LaneRays], hits: &mut [LaneHits], counts: &mut SolveCounts) {
        for (rays, hits) in rays.chunks(BLOCK).zip(hits.chunks_mut(BLOCK)) {
            for hits in &mut *hits {
                hits.hit = 0;
                hits.gave_up = 0;
            }
            self.walk::<true, { BLOCK * LANES }, 2>(rays, hits, counts);
        }
    }

    fn single(&self, ray: &SingleRay, any: bool, counts: &mut SolveCounts) -> SingleAnswer {
        if any { self.walk_single::<true>(ray, counts) } else { self.walk_single::<false>(ray, counts) }
    }

    fn bytes(&self) -> u64 {
        self.pyramid.bytes() + self.lattice.cells.iter().product::<usize>() as u64 / 8
    }
}
