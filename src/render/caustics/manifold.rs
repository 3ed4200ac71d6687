//! All places of the spline surface that refract or reflect a light to a point, by Newton's iteration on its exact second
//! derivatives, and the exact factor by which light comes together there.
//!
//! *The equations.* The surface is s(x, z) = (x, S, z) with tangents t₁ = (1, S_x, 0), t₂ = (0, S_z, 1) and the upward
//! normal N = (-S_x, 1, -S_z). With the unit vectors d from s to the point, r away, and w from s to the light, and the
//! index n on the point's side (1 in air), light goes by s where its optical path n r - w·s, or n r + r_l for a lamp r_l
//! away, does not change to first order (Fermat): F_i = h·t_i = 0 with h = n d + w. That is the law of refraction, n sin
//! = sin, or of reflection, but for sides: d must be below the surface (above it) and w above. As ∂d/∂s = -(I - d dᵀ)/r,
//!
//! J_ij = ∂F_i/∂x_j = h_y S_ij - n/r t_i·(I - d dᵀ) t_j - [1/r_l t_i·(I - w wᵀ) t_j, for a lamp].
//!
//! *The spread.* Moving the light by dw across w at a fixed point moves the solution by dx = -J⁻¹ (dw·t_i), and the linear
//! map dw → (dw·t₁, dw·t₂) has the determinant |(t₁ × t₂)·w| = |N·w|. The patch dx dz is seen from the point under
//! |N·d| dx dz / r². So |dΩ_from/dΩ_light| = |N·d| |N·w| / (r² |det J|), and for a lamp, where dw = dl/r_l besides
//! the term in J, that over r_l². On flat water straight down this is 1/n². At a fold det J = 0.
//!
//! *Tilted facets* (the offset normals of Zeltner et al. 2020): ripples too small for the spline lean its normal by slopes
//! τ, and the law holds with t'₁ = (1, S_x + τ_x, 0), t'₂ alike: F_i = h·t'_i, J_ij = h_y S_ij - n/r t'_i·(I - d dᵀ) t_j …
//! (only the place moves along the true tangents), and the spread has |N·d| |N'·w|.
//!
//! *Source:* T. Zeltner, I. Georgiev, W. Jakob, Specular manifold sampling for rendering high-frequency caustics and
//! glints, 2020, for Newton on the manifold; B. Wang, M. Hašan, L.-Q. Yan, Path cuts: efficient rendering of pure specular
//! light transport, 2020, for finding all solutions by interval pruning. Here the intervals are centred forms on the
//! spline itself (`bounds`, `search`) in place of hierarchies over triangles.

use glam::Vec3;

use super::{
    Connection, Event, ManifoldCounts, Target,
    bounds::{Bounds, LANES, Probe, SIDE},
    search::{self, Light, Query},
};
use crate::{
    simd::{self, Kernel, Simd, SimdLevel},
    surface::{Lattice, SplineSurface},
};

/// Coordinates (m) from which on squares leave single precision's range.
const FARTHEST: f32 = 1e15;

/// A surface, with what it takes to find connections fast.
#[derive(Clone, Debug)]
pub struct Manifold {
    pub(super) lattice: Lattice,
    bounds: Bounds,
    simd: SimdLevel,
}

/// Boxes of a level that are still to be looked into.
#[derive(Clone, Copy, Debug, Default)]
struct Pending {
    block: [usize; 2],
    /// Bits of the boxes.
    left: u16,
}

/// Levels that a lattice may have: four times as many columns for each.
const MOST_LEVELS: usize = 32;

/// A query through all levels, with the widest instructions of the processor. No sum is contracted or reordered: they do
/// not show in the bits.
struct Descent<'m, 'q, 'a, const K: usize, const POINT: bool> {
    manifold: &'m Manifold,
    probe: Probe,
    query: &'q mut Query<'a>,
}

impl Manifold {
    /// A copy of the surface's control heights, under a pyramid of their bounds in height and slope.
    pub fn new(surface: &SplineSurface) -> Self {
        let lattice = surface.lattice();
        Self { lattice: lattice.clone(), bounds: Bounds::new(lattice), simd: surface.simd() }
    }

    /// Finds all places of the surface that send light from `target` to `from`; `found` is cleared first. Their order
    /// depends on nothing but the arguments.
    ///
    /// `ior` is the water's index, `tilt` is added to the slopes along x and z of the surface's normals. A part of the
    /// surface narrower than `tolerance` (m; at least single precision's spacing at the point) is not divided any more.
    ///
    /// *Units and frame:* local frame, metres, y up.
    ///
    /// *Accuracy:* positions to single precision, found in double. Solutions in pairs nearer to each other than the
    /// tolerance (within about tolerance² times the curvature from a fold), a point on the surface itself, and a focus
    /// that gathers whole areas cannot be settled: what is found there is kept and `counts.gave_up` grows by one. So it
    /// does, with nothing found, for arguments that are not finite, a direction that is not of unit length to 1e-3, and
    /// an index that is not positive. Where several patches meet, a solution counts once.
    pub fn connect(
        &self,
        from: Vec3,
        event: Event,
        target: Target,
        ior: f32,
        tilt: [f32; 2],
        tolerance: f32,
        found: &mut Vec<Connection>,
        counts: &mut ManifoldCounts,
    ) {
        found.clear();
        counts.queries += 1;
        let (light, place) = match target {
            Target::Direction(to) | Target::Point(to) => (to, matches!(target, Target::Point(_))),
        };
        // Not >, so that what is no number does not pass.
        let fits = |vector: Vec3| vector.abs().max_element() <= FARTHEST && !vector.is_nan();
        let unit = place || (light.length() - 1.0).abs() < 1e-3;
        let numbers = ior > 0.0 && ior <= FARTHEST && tilt.iter().all(|t| t.abs() <= FARTHEST) && !tolerance.is_nan();
        if !(fits(from) && fits(light) && unit && numbers) {
            counts.gave_up += 1;
            return;
        }
        let direction = light.as_dvec3();
        let light = if place { Light::Point(direction) } else { Light::Direction(direction.normalize()) };
        let index = match event {
            Event::Refraction => ior,
            Event::Reflection => 1.0,
        };
        let spacing =
            f32::EPSILON * from.abs().max_element().max(self.lattice.width[0].min(self.lattice.width[1]) as f32);
        let mut query = Query::new(
            from.as_dvec3(),
            event,
            light,
            f64::from(index),
            tilt.map(f64::from),
            f64::from(tolerance.max(spacing)),
            found,
            counts,
        );
        let to_light = match light {
            Light::Direction(to) => to,
            Light::Point(place) => place - query.from,
        };
        let probe = Probe { ior: index, light: to_light.as_vec3().to_array(), tilt };
        macro_rules! descend {
            ($order:literal, $point:literal) => {
                simd::dispatch(self.simd, Descent::<$order, $point> { manifold: self, probe, query: &mut query })
            };
        }
        match (self.lattice.order, place) {
            (2, false) => descend!(2, false),
            (2, true) => descend!(2, true),
            (3, false) => descend!(3, false),
            (3, true) => descend!(3, true),
            (_, false) => descend!(4, false),
            (_, true) => descend!(4, true),
        }
        let unsettled = query.unsettled;
        counts.gave_up += u64::from(unsettled);
        counts.solutions += found.len() as u64;
    }
}

impl<const K: usize, const POINT: bool> Kernel for Descent<'_, '_, '_, K, POINT> {
    type Output = ();

    /// Searches what the boxes of every level leave, in the order of their places within each block.
    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let bounds = &self.manifold.bounds;
        let mut level = bounds.levels() - 1;
        let mut pending = [Pending::default(); MOST_LEVELS];
        pending[level] = self.look([0; 2], level);
        loop {
            let Pending { block, left } = pending[level];
            if left == 0 {
                level += 1;
                if level == bounds.levels() {
                    return;
                }
                continue;
            }
            pending[level].left = left & (left - 1);
            let lane = left.trailing_zeros() as usize;
            debug_assert!(lane < LANES);
            let inner = [block[0] * SIDE + lane % SIDE, block[1] * SIDE + lane / SIDE];
            if level == 0 {
                search::patch::<K>(&self.manifold.lattice, inner, self.query);
            } else {
                level -= 1;
                pending[level] = self.look(inner, level);
            }
        }
    }
}

impl<const K: usize, const POINT: bool> Descent<'_, '_, '_, K, POINT> {
    /// What is left of a block's boxes.
    #[inline(always)]
    fn look(&self, block: [usize; 2], level: usize) -> Pending {
        let Self { manifold: Manifold { lattice, bounds, .. }, probe, query } = self;
        // A box of this level is as many patches wide.
        let box_width = SIDE.pow(level as u32) as f64;
        let first = block.map(|b| (b * SIDE) as f64 * box_width + 0.5 * box_width);
        let [x, z] = lattice.from_cell(first);
        let corner = [(x - query.from.x) as f32, -query.from.y as f32, (z - query.from.z) as f32];
        let half = lattice.width.map(|width| (0.5 * box_width * width) as f32);
        Pending { block, left: bounds.survivors::<POINT>(level, block, corner, half, probe) }
    }
}
