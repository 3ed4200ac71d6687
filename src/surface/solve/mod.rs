//! The seam of the solvers: lanes of rays, each against one patch, within one stretch of t.
//!
//! A solver answers for every lane: hit (and where), miss, or *gave up*. It is handed the sign that the ray carried into
//! the patch, so that a walk from patch to patch cannot slip through a seam: a ray that comes in above the surface and
//! stands below it at the patch's border has hit it there.

mod clip;
mod newton;
mod polynomial;
mod reference;
pub(crate) mod report;
mod univariate;

pub(super) use clip::BezierClip;
pub(super) use newton::Newton;
pub(super) use polynomial::{lane_polynomial, ray_polynomial};
pub(super) use reference::Reference;
use report::Report;
pub(super) use univariate::Univariate;

use super::SolveCounts;
use crate::scene::SolverKind;
use crate::simd::Simd;

/// Lanes of rays against a patch each, over t in [start, start + length].
///
/// Heights are metres above one of the window's own control heights; u and v are 0..1 within the cell.
#[derive(Clone, Copy)]
pub(super) struct Segment<S: Simd, const K: usize> {
    /// Control heights: `[row along z][column along x]`.
    pub window: [[S::F; K]; K],
    /// u at both ends.
    pub u: [S::F; 2],
    /// v at both ends.
    pub v: [S::F; 2],
    /// The ray's height at both ends.
    pub y: [S::F; 2],
    /// +1 where the ray came in above the surface, -1 below, 0 unknown.
    pub above: S::F,
    /// Length of the stretch, in t.
    pub length: S::F,
    /// Tolerance, in t.
    pub tolerance: S::F,
    /// Lanes that ask.
    pub mask: S::M,
}

/// What a solver says.
#[derive(Clone, Copy)]
pub(super) struct Answer<S: Simd> {
    /// Lanes that hit.
    pub hit: S::M,
    /// Where, as a share of the stretch, 0..1.
    pub s: S::F,
    /// Lanes for which neither hit nor miss could be shown; they are not in `hit`.
    pub gave_up: S::M,
    /// Side of the surface on which the ray leaves, for lanes that missed.
    pub above: S::F,
}

/// A solver: one of these per name.
///
/// `K` is the spline's order, `D` = 2 (K - 1) the degree along the ray.
pub(super) trait PatchSolver: Copy + Send + Sync {
    /// The first hit of each lane; with `ANY`, whether there is one (its place is then of no account).
    fn solve<S: Simd, const K: usize, const D: usize, const ANY: bool>(
        self,
        simd: S,
        segment: &Segment<S, K>,
        counts: &mut SolveCounts,
    ) -> Answer<S>;
}

/// One ray against one patch in double precision, for solvers that work a ray at a time.
#[derive(Clone, Copy, Debug)]
pub(super) struct PatchRay {
    /// Order.
    pub order: usize,
    /// Control heights, relative.
    pub window: [[f64; 4]; 4],
    /// u, v at both ends.
    pub u: [f64; 2],
    /// v at both ends.
    pub v: [f64; 2],
    /// Height at both ends.
    pub y: [f64; 2],
}

/// What a single-ray solver says of a stretch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Solve {
    /// First hit, as a share of the stretch.
    Hit(f64),
    /// None, proven.
    Miss,
    /// Could not decide.
    GaveUp,
}

/// A solver that works a ray at a time, in double precision.
pub(super) trait RaySolver: Copy + Send + Sync {
    /// Whether the side of the surface is carried from patch to patch, so that no ray slips through a border.
    const CARRIES_SIGN: bool = true;
    /// The first hit; `tolerance` is a share of the stretch.
    fn first_hit(self, ray: &PatchRay, tolerance: f64, iterations: &mut u64) -> Solve;
}

/// The single-ray solvers by name, as one type: what a walk costs around them does not matter, and one walk compiled is
/// enough for all.
#[derive(Clone, Copy, Debug)]
pub(super) enum RayAtATime {
    /// See [`Newton`].
    Newton,
    /// See [`Report`].
    Report,
    /// See [`BezierClip`].
    BezierClip,
    /// See [`Reference`].
    Reference,
}

impl RayAtATime {
    /// The solver of a name; `None` for the one that has lanes of its own.
    pub(super) fn of(solver: SolverKind) -> Option<Self> {
        match solver {
            SolverKind::Univariate => None,
            SolverKind::Newton => Some(Self::Newton),
            SolverKind::Report => Some(Self::Report),
            SolverKind::BezierClip => Some(Self::BezierClip),
            SolverKind::Reference => Some(Self::Reference),
        }
    }
}

impl RaySolver for RayAtATime {
    fn first_hit(self, ray: &PatchRay, tolerance: f64, iterations: &mut u64) -> Solve {
        match self {
            Self::Newton => Newton.first_hit(ray, tolerance, iterations),
            Self::Report => Report.first_hit(ray, tolerance, iterations),
            Self::BezierClip => BezierClip.first_hit(ray, tolerance, iterations),
            Self::Reference => Reference.first_hit(ray, tolerance, iterations),
        }
    }
}

/// Any single-ray solver as a lane solver.
#[derive(Clone, Copy)]
pub(super) struct PerLane<R>(pub R);

impl<R: RaySolver> PatchSolver for PerLane<R> {
    #[inline(always)]
    fn solve<S: Simd, const K: usize, const D: usize, const ANY: bool>(
        self,
        simd: S,
        segment: &Segment<S, K>,
        counts: &mut SolveCounts,
    ) -> Answer<S> {
        let lanes = |value: S::F| {
            let mut array = [0.0f32; 16];
            simd.store(value, &mut array);
            array
        };
        let window: [[[f32; 16]; K]; K] = segment.window.map(|row| row.map(lanes));
        let ends = |pair: [S::F; 2]| pair.map(lanes);
        let (u, v, y) = (ends(segment.u), ends(segment.v), ends(segment.y));
        let (above, length, tolerance) = (lanes(segment.above), lanes(segment.length), lanes(segment.tolerance));
        let (mut s, mut leaving) = ([0.0f32; 16], [0.0f32; 16]);
        let (mut hit, mut gave_up) = (0u32, 0u32);
        let mask = simd.bits(segment.mask);
        for lane in (0..S::LANES).filter(|lane| mask >> lane & 1 == 1) {
            let mut ray = PatchRay {
                order: K,
                window: [[0.0; 4]; 4],
                u: [0, 1].map(|end| f64::from(u[end][lane])),
                v: [0, 1].map(|end| f64::from(v[end][lane])),
                y: [0, 1].map(|end| f64::from(y[end][lane])),
            };
            for b in 0..K {
                for a in 0..K {
                    ray.window[b][a] = f64::from(window[b][a][lane]);
                }
            }
            if R::CARRIES_SIGN {
                let polynomial = ray_polynomial(&ray);
                let (first, last) = (polynomial.coefficients()[0], polynomial.coefficients()[D]);
                leaving[lane] = if last < 0.0 { -1.0 } else { 1.0 };
                // A sign that does not continue the one carried in is a hit on the border itself.
                if first == 0.0 || f64::from(above[lane]) * first < 0.0 {
                    hit |= 1 << lane;
                    continue;
                }
            }
            let share = f64::from(tolerance[lane]) / f64::from(length[lane]).max(f64::MIN_POSITIVE);
            match self.0.first_hit(&ray, share.clamp(1e-15, 1.0), &mut counts.iterations) {
                Solve::Hit(at) => {
                    hit |= 1 << lane;
                    s[lane] = at as f32;
                }
                Solve::Miss => {}
                Solve::GaveUp => gave_up |= 1 << lane,
            }
        }
        Answer {
            hit: simd.from_bits(hit),
            s: simd.load(&s),
            gave_up: simd.from_bits(gave_up),
            above: simd.load(&leaving),
        }
    }
}
