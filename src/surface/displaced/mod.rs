//! The water with control points that are displaced sideways: adhesion along edges, shear along the flow (the report's
//! section 2.4, there a thing to come).
//!
//! x and z are no longer linear in the spline's parameters, so that nothing of the height function's solvers applies: a
//! patch is a Bézier patch of 3-D points, rays are solved one at a time in double precision (`solve`, `clip`), and the
//! patches stand in a quadtree of boxes (`boxes`) that is walked front to back. Displacements are bounded (`offsets`) so
//! that the surface stays the graph of a function, with an upper and a lower side.
//!
//! Whoever asks the water's height at a place (framing, wet banks, depth) goes on asking the undisplaced spline, which is
//! right to within the displacement.

mod boxes;
mod clip;
mod net;
mod offsets;
mod solve;

pub use offsets::{MOST, displacements};

use std::sync::Arc;

use glam::{DVec3, Vec3};

use self::boxes::{BoxRay, Boxes};
use self::net::Net;
use self::solve::{Method, Question};
use super::{LANES, LaneHits, LaneRays, LaneSurface, Lattice, SolveCounts, SplineSurface, SurfacePoint};
use crate::scene::SolverKind;

/// Every patch reaches this much further than its border (in columns), so that rays aimed at the border meet one or both:
/// far more than double precision's rounding, far less than anyone can ask for in single precision.
const OVERLAP: f64 = 1e-9;
/// Room around the boxes of patches, as a share of a column: more than the overlap and all rounding.
const PAD: f64 = 1e-6;

/// A solver that displaced points are too much for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("surface.solver is {}, which takes no points displaced sideways; expected newton, bezier-clip or reference", solver.name())]
pub struct DisplacedError {
    /// The solver.
    pub solver: SolverKind,
}

/// A hit in double precision.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DisplacedHit {
    /// Distance in lengths of the direction.
    pub t: f64,
    /// Patch, numbered as the undisplaced surface's.
    pub patch: u32,
    /// Parameters within the patch, 0..1.
    pub uv: [f64; 2],
    /// Upward normal, not normalised.
    pub normal: DVec3,
}

/// A B-spline surface over a map of columns whose control points are 3-D.
#[derive(Clone, Debug)]
pub struct DisplacedSurface {
    flat: Arc<SplineSurface>,
    /// Control points as (displacement along x, height, displacement along z) in m, laid out as the lattice's heights.
    points: Vec<[f64; 3]>,
    boxes: Boxes,
    method: Method,
}

impl DisplacedSurface {
    /// The surface `flat` with its columns' control points moved.
    ///
    /// *Shape:* `heights` (m, local frame) and `shifts` (along x and z, m) have one entry per column, index `z * nx + x`;
    /// a shift is under [`MOST`] of a column's width along each axis.
    ///
    /// # Errors
    /// The solver cannot: see [`DisplacedError`].
    ///
    /// # Panics
    /// If there are not as many entries as columns, or a shift is too long: the surface would fold over.
    pub fn new(
        flat: Arc<SplineSurface>,
        heights: &[f64],
        shifts: &[[f64; 2]],
        solver: SolverKind,
    ) -> Result<Self, DisplacedError> {
        let method = match solver {
            SolverKind::Newton => Method::Newton,
            SolverKind::BezierClip => Method::Clip,
            SolverKind::Reference => Method::Halve,
            SolverKind::Univariate | SolverKind::Report => return Err(DisplacedError { solver }),
        };
        let lattice = flat.lattice();
        let (order, pad) = (lattice.order, lattice.order / 2);
        let [nx, nz] = lattice.cells.map(|cells| if order == 3 { cells } else { cells - 1 });
        assert!(heights.len() == nx * nz && shifts.len() == nx * nz, "one height and one shift for each column");
        let most = |shift: &[f64; 2]| (0..2).all(|axis| shift[axis].abs() <= MOST * lattice.width[axis] * (1.0 + 1e-9));
        assert!(shifts.iter().all(most), "shifts are under a quarter of a column");
        let rows = lattice.heights.len() / lattice.stride;
        let points = (0..rows * lattice.stride)
            .map(|index| {
                // The phantom edge repeats the outermost columns, as the lattice's own.
                let (column, row) = (index % lattice.stride, index / lattice.stride);
                let index = row.saturating_sub(pad).min(nz - 1) * nx + column.saturating_sub(pad).min(nx - 1);
                [shifts[index][0], heights[index], shifts[index][1]]
            })
            .collect();
        let mut surface =
            Self { boxes: Boxes::build([1, 1], 0.0, |_, _| None), points, method, flat: Arc::clone(&flat) };
        let room = PAD * lattice.width[0].min(lattice.width[1]);
        surface.boxes = Boxes::build(lattice.cells, room, |i, j| {
            lattice.exists(i, j).then(|| {
                let (net, base) = surface.patch(i, j);
                net.hull().map(|corner| corner + base)
            })
        });
        Ok(surface)
    }

    /// The undisplaced surface.
    pub fn flat(&self) -> &Arc<SplineSurface> {
        &self.flat
    }

    fn lattice(&self) -> &Lattice {
        self.flat.lattice()
    }

    /// Patch (i, j) around a point of its own, and that point in the local frame: far from the origin nothing is lost.
    fn patch(&self, i: usize, j: usize) -> (Net, DVec3) {
        let lattice = self.lattice();
        let (order, width) = (lattice.order, lattice.width);
        let point = |a: usize, b: usize| self.points[(j + b) * lattice.stride + i + a];
        let level = point(order / 2, order / 2)[1];
        let window = std::array::from_fn(|b| {
            std::array::from_fn(|a| {
                if a >= order || b >= order {
                    return DVec3::ZERO;
                }
                // Column centres in cell coordinates: 0 and 1 for order 2, -1/2 to 3/2 for 3, -1 to 2 for 4.
                let place = |index: usize| index as f64 - 0.5 * (order as f64 - 2.0);
                let [x, y, z] = point(a, b);
                DVec3::new(place(a) * width[0] + x, y - level, place(b) * width[1] + z)
            })
        });
        let [x, z] = lattice.from_cell([i as f64, j as f64]);
        (Net::from_spline(order, &window), DVec3::new(x, level, z))
    }

    /// The parameters of cell (i, j) that lie in the domain, with the overlap.
    fn domain(&self, i: usize, j: usize) -> [[f64; 2]; 2] {
        let lattice = self.lattice();
        [0, 1].map(|axis| {
            let cell = [i, j][axis] as f64;
            let [low, high] = [lattice.domain[0][axis] - cell, lattice.domain[1][axis] - cell];
            [low.max(0.0) - OVERLAP, high.min(1.0) + OVERLAP]
        })
    }

    /// Point and upward normal of patch `patch` at `u`, `v` (each 0..1).
    pub fn patch_point(&self, patch: u32, u: f32, v: f32) -> SurfacePoint {
        let cells = self.lattice().cells[0];
        let (net, base) = self.patch(patch as usize % cells, patch as usize / cells);
        let [point, along_u, along_v] = net.value(f64::from(u), f64::from(v));
        let normal = along_v.cross(along_u).normalize_or(DVec3::Y);
        SurfacePoint { position: (base + point).as_vec3(), normal: normal.as_vec3() }
    }

    /// The first hit of a ray with t in the closed `range`, to double precision; a touch within rounding counts.
    ///
    /// *Frame:* the local frame, m; t in lengths of `direction`.
    pub fn first_hit(&self, origin: DVec3, direction: DVec3, range: [f64; 2]) -> Option<DisplacedHit> {
        let ray = Ray { origin, direction, range, tolerance: [0.0; 2] };
        self.first(&ray, Method::Halve, &mut SolveCounts::default()).ok().flatten()
    }

    /// The first hit of a ray over all patches that it meets; an error where a solver could not decide.
    fn first(&self, ray: &Ray, method: Method, counts: &mut SolveCounts) -> Result<Option<DisplacedHit>, Doubt> {
        let mut search = Search::new(self, *ray, method);
        self.boxes.walk(&BoxRay::new(ray.origin, ray.direction), ray.range, |cell, enter| {
            search.ask(cell, enter, counts);
            search.far()
        });
        search.answer()
    }

    /// Answers the lanes of a packet by a way to the first hit.
    fn lanes(
        rays: &LaneRays,
        hits: &mut LaneHits,
        counts: &mut SolveCounts,
        mut first: impl FnMut(&Ray, &mut SolveCounts) -> Result<Option<DisplacedHit>, Doubt>,
    ) {
        (hits.hit, hits.gave_up) = (0, 0);
        let active = rays.active & rays.sound();
        for lane in (0..LANES).filter(|lane| active >> lane & 1 == 1) {
            match first(&Ray::of_lane(rays, lane), counts) {
                Ok(None) => {}
                Ok(Some(hit)) => {
                    hits.hit |= 1 << lane;
                    // Rounding to single precision must not carry a hit past the ray's end.
                    hits.t[lane] = (hit.t as f32).min(rays.tfar[lane]);
                    hits.primitive[lane] = hit.patch;
                    [hits.u[lane], hits.v[lane]] = hit.uv.map(|c| c as f32);
                    for axis in 0..3 {
                        hits.normal[axis][lane] = hit.normal[axis] as f32;
                    }
                }
                Err(Doubt) => {
                    hits.gave_up |= 1 << lane;
                    counts.gave_up += 1;
                }
            }
        }
    }
}

/// A solver could not decide.
struct Doubt;

/// A ray in double precision.
#[derive(Clone, Copy)]
struct Ray {
    origin: DVec3,
    direction: DVec3,
    range: [f64; 2],
    /// At t = 0, and its growth with t.
    tolerance: [f64; 2],
}

impl Ray {
    fn of_lane(rays: &LaneRays, lane: usize) -> Self {
        let vector = |axes: &[[f32; LANES]; 3]| DVec3::from_array([0, 1, 2].map(|axis| f64::from(axes[axis][lane])));
        Self {
            origin: vector(&rays.origin),
            direction: vector(&rays.direction),
            range: [f64::from(rays.tnear[lane]), f64::from(rays.tfar[lane])],
            tolerance: [f64::from(rays.tolerance[lane]), f64::from(rays.tolerance_growth)],
        }
    }
}

/// The search of one ray through patches, in any order.
struct Search<'a> {
    surface: &'a DisplacedSurface,
    ray: Ray,
    method: Method,
    hit: Option<DisplacedHit>,
    doubt: f64,
}

impl<'a> Search<'a> {
    fn new(surface: &'a DisplacedSurface, ray: Ray, method: Method) -> Self {
        Self { surface, ray, method, hit: None, doubt: f64::INFINITY }
    }

    /// From where on (t) nothing matters any more.
    fn far(&self) -> f64 {
        self.hit.map_or(self.ray.range[1], |hit| hit.t).min(self.doubt)
    }

    /// Asks patch `cell`, whose box the ray enters at `enter`.
    fn ask(&mut self, [i, j]: [usize; 2], enter: f64, counts: &mut SolveCounts) {
        let (net, base) = self.surface.patch(i, j);
        // From the box on: a far origin costs no accuracy.
        let start = self.ray.origin + self.ray.direction * enter;
        let question = Question {
            origin: start - base,
            direction: self.ray.direction,
            range: [self.ray.range[0] - enter, self.far() - enter],
            tolerance: self.ray.tolerance[0] + self.ray.tolerance[1] * enter,
            domain: self.surface.domain(i, j),
        };
        counts.patches += 1;
        let answer = solve::first_root(&net, &question, self.method, &mut counts.iterations);
        self.doubt = self.doubt.min(enter + answer.doubt);
        let Some(root) = answer.root else { return };
        let t = enter + root.t;
        if self.hit.is_none_or(|hit| t < hit.t) {
            let [_, along_u, along_v] = net.value(root.u, root.v);
            self.hit = Some(DisplacedHit {
                t: t.clamp(self.ray.range[0], self.ray.range[1]),
                patch: (j * self.surface.lattice().cells[0] + i) as u32,
                uv: [root.u, root.v].map(|place| place.clamp(0.0, 1.0)),
                normal: along_v.cross(along_u),
            });
        }
    }

    /// What lies before every doubt is certain.
    fn answer(self) -> Result<Option<DisplacedHit>, Doubt> {
        match self.hit {
            Some(hit) if hit.t <= self.doubt => Ok(Some(hit)),
            None if self.doubt == f64::INFINITY => Ok(None),
            _ => Err(Doubt),
        }
    }
}

impl LaneSurface for DisplacedSurface {
    fn bounds(&self) -> [Vec3; 2] {
        let whole = self.boxes.whole();
        if whole[0][0] > whole[1][0] { [Vec3::ZERO; 2] } else { whole.map(Vec3::from_array) }
    }

    fn closest(&self, rays: &LaneRays, hits: &mut LaneHits, counts: &mut SolveCounts) {
        Self::lanes(rays, hits, counts, |ray, counts| self.first(ray, self.method, counts));
    }

    fn occluded(&self, rays: &LaneRays, counts: &mut SolveCounts) -> u16 {
        let mut hits = LaneHits::EMPTY;
        self.closest(rays, &mut hits, counts);
        hits.hit
    }

    fn bytes(&self) -> u64 {
        self.boxes.bytes() + size_of_val(&self.points[..]) as u64
    }
}

/// A displaced surface without its boxes: every ray against every patch, by halving to the end.
#[derive(Clone, Debug)]
pub struct BruteDisplaced(pub Arc<DisplacedSurface>);

impl LaneSurface for BruteDisplaced {
    fn bounds(&self) -> [Vec3; 2] {
        self.0.bounds()
    }

    fn closest(&self, rays: &LaneRays, hits: &mut LaneHits, counts: &mut SolveCounts) {
        let lattice = self.0.lattice();
        let middle = lattice.domain.map(|corner| lattice.from_cell(corner));
        let middle = DVec3::new(
            0.5 * (middle[0][0] + middle[1][0]),
            0.5 * (lattice.extent[0] + lattice.extent[1]),
            0.5 * (middle[0][1] + middle[1][1]),
        );
        DisplacedSurface::lanes(rays, hits, counts, |ray, counts| {
            // A far origin is moved near the surface, as the boxes do it for the walk.
            let enter = (middle - ray.origin).dot(ray.direction) / ray.direction.length_squared();
            let enter = enter.clamp(ray.range[0], ray.range[1]);
            let mut search = Search::new(&self.0, *ray, Method::Halve);
            for j in 0..lattice.cells[1] {
                for i in (0..lattice.cells[0]).filter(|&i| lattice.exists(i, j)) {
                    search.ask([i, j], enter, counts);
                }
            }
            search.answer()
        });
    }

    fn occluded(&self, rays: &LaneRays, counts: &mut SolveCounts) -> u16 {
        let mut hits = LaneHits::EMPTY;
        self.closest(rays, &mut hits, counts);
        hits.hit
    }

    fn bytes(&self) -> u64 {
        self.0.points.len() as u64 * 24
    }
}

#[cfg(test)]
mod tests;
