//! The report's way to a guess (section 2.3.2): the box of the whole surface, then row after row of columns, along x or z
//! by the ray's main direction; in each row the columns under the ray, first to last.
//!
//! A column is tried where the ray passes between the least and the greatest control height around it. Its middle is the
//! guess, and whatever root Newton's iteration finds from there is taken as the first hit, wherever it lies.

use std::sync::{Arc, Mutex, PoisonError};

use glam::{DVec3, Vec3};

use super::newton::{Root, Target};
use crate::math::scramble;
use crate::surface::audit::Audit;
use crate::surface::report_solver::OWN;
use crate::surface::{LANES, LaneHits, LaneRays, LaneSurface, Lattice, SolveCounts, SplineSurface};

/// One ray in this many is traced again by the referee, which takes some twenty times as long: the count costs a tenth.
const SAMPLE: u64 = 256;

/// A surface that is walked column by column.
#[derive(Clone, Debug)]
pub struct ColumnWalk {
    surface: Arc<SplineSurface>,
    /// Least and greatest control height around each cell (m); `None` where no patch exists, a null control point.
    bounds: Vec<Option<[f32; 2]>>,
    audit: Option<Arc<Mutex<Audit>>>,
}

/// A ray in double precision.
struct Line {
    origin: DVec3,
    direction: DVec3,
    range: [f64; 2],
    /// In t, at the origin and per unit of t.
    tolerance: [f64; 2],
    /// The ray's own numbers, mixed: what is random about it starts here.
    seed: u64,
}

impl Line {
    fn new(rays: &LaneRays, lane: usize) -> Self {
        let vector = |axes: &[[f32; LANES]; 3]| DVec3::from(axes.each_ref().map(|axis| f64::from(axis[lane])));
        let numbers = rays.origin.iter().chain(&rays.direction).map(|axis| u64::from(axis[lane].to_bits()));
        Self {
            origin: vector(&rays.origin),
            direction: vector(&rays.direction),
            range: [rays.tnear[lane].into(), rays.tfar[lane].into()],
            tolerance: [rays.tolerance[lane].into(), rays.tolerance_growth.into()],
            seed: numbers.fold(0, |seed, number| scramble(seed ^ number)),
        }
    }
}

/// A ray's way over the cells.
struct Way {
    /// Cell coordinates of the origin, and cells per t.
    at: [f64; 2],
    slope: [f64; 2],
    /// t at which the ray enters and leaves the surface's box.
    range: [f64; 2],
}

impl Way {
    /// `None` for a ray that misses the box.
    fn new(lattice: &Lattice, line: &Line) -> Option<Self> {
        let at = lattice.to_cell(line.origin.x, line.origin.z);
        let slope = [line.direction.x / lattice.width[0], line.direction.z / lattice.width[1]];
        let [mut near, mut far] = line.range;
        let sides = |axis: usize| [lattice.domain[0][axis], lattice.domain[1][axis]];
        for (place, speed, [low, high]) in [
            (at[0], slope[0], sides(0)),
            (at[1], slope[1], sides(1)),
            (line.origin.y, line.direction.y, lattice.extent),
        ] {
            if speed == 0.0 {
                if !(low..=high).contains(&place) {
                    return None;
                }
                continue;
            }
            let (a, b) = ((low - place) / speed, (high - place) / speed);
            near = near.max(a.min(b));
            far = far.min(a.max(b));
        }
        (near <= far && far.is_finite()).then_some(Self { at, slope, range: [near, far] })
    }

    /// The cell along an axis at t.
    fn cell(&self, lattice: &Lattice, axis: usize, t: f64) -> usize {
        // Never negative behind the clamp, and far below 2^53.
        (self.at[axis] + t * self.slope[axis]).floor().clamp(0.0, (lattice.cells[axis] - 1) as f64) as usize
    }

    /// Calls `visit` with each cell between two places along an axis and the t at which the ray enters and leaves it;
    /// stops at the first that answers.
    fn along<T>(
        &self,
        lattice: &Lattice,
        axis: usize,
        [mut enter, far]: [f64; 2],
        mut visit: impl FnMut(usize, [f64; 2]) -> Option<T>,
    ) -> Option<T> {
        let (mut cell, last) = (self.cell(lattice, axis, enter), self.cell(lattice, axis, far));
        let forward = self.slope[axis] > 0.0;
        loop {
            let border = (cell + usize::from(forward)) as f64;
            // Rounding may put the border a little outside the stretch.
            let leave =
                if cell == last { far } else { ((border - self.at[axis]) / self.slope[axis]).max(enter).min(far) };
            let found = visit(cell, [enter, leave]);
            if found.is_some() || cell == last {
                return found;
            }
            cell = if forward { cell + 1 } else { cell - 1 };
            enter = leave;
        }
    }
}

impl ColumnWalk {
    /// Prepares the bounds of every column.
    pub fn new(surface: Arc<SplineSurface>) -> Self {
        let lattice = surface.lattice();
        let [nx, nz] = lattice.cells;
        let around = |i: usize, j: usize| {
            let rows = lattice.heights[j * lattice.stride..].chunks(lattice.stride).take(lattice.order);
            let heights = rows.flat_map(|row| &row[i..i + lattice.order]);
            heights.fold([f32::INFINITY, f32::NEG_INFINITY], |[low, high], &h| [low.min(h), high.max(h)])
        };
        let bounds = (0..nx * nz)
            .map(|patch| {
                let (i, j) = (patch % nx, patch / nx);
                lattice.exists(i, j).then(|| around(i, j))
            })
            .collect();
        Self { surface, bounds, audit: None }
    }

    /// Adds to these counts for one ray in [`SAMPLE`], chosen by the ray's own numbers.
    pub(super) fn audited(self, audit: Arc<Mutex<Audit>>) -> Self {
        Self { audit: Some(audit), ..self }
    }

    /// What the report takes as the first hit.
    fn first(&self, line: &Line, counts: &mut SolveCounts) -> Option<Root> {
        let lattice = self.surface.lattice();
        let way = Way::new(lattice, line)?;
        let target = Target::new(lattice, line.origin, line.direction);
        let main = usize::from(way.slope[1].abs() > way.slope[0].abs());
        let speed = line.direction.length();
        // Heights along the ray are sums of two numbers no greater than these.
        let room = 4.0 * f64::EPSILON * (line.origin.y.abs() + (way.range[1] * line.direction.y).abs());
        way.along(lattice, main, way.range, |row, stretch| {
            way.along(lattice, 1 - main, stretch, |column, [enter, leave]| {
                let cell = if main == 0 { [row, column] } else { [column, row] };
                let [low, high] = self.bounds[cell[1] * lattice.cells[0] + cell[0]]?.map(f64::from);
                let ends = [enter, leave].map(|t| line.origin.y + t * line.direction.y);
                if ends[0].min(ends[1]) > high + room || ends[0].max(ends[1]) < low - room {
                    return None;
                }
                counts.patches += 1;
                let tolerance = (line.tolerance[0] + line.tolerance[1] * enter) * speed;
                let seed = line.seed ^ (cell[1] * lattice.cells[0] + cell[0]) as u64;
                let root = target.root(cell, tolerance, seed, &mut counts.iterations)?;
                (root.t >= line.range[0] && root.t <= line.range[1]).then_some(root)
            })
        })
    }

    /// The first hit of one lane, with the referee's opinion where it is asked.
    fn answer(&self, rays: &LaneRays, lane: usize, any: bool, counts: &mut SolveCounts) -> Option<Root> {
        let mut line = Line::new(rays, lane);
        // No sign tells the surface that a ray leaves from one that it meets: as in ray tracers of that day, what lies too
        // near the start does not count.
        let [width, depth] = self.surface.lattice().width;
        line.range[0] += (OWN * width.min(depth) / line.direction.length()).max(2.0 * line.tolerance[0]);
        let root = self.first(&line, counts);
        if let Some(audit) = self.audit.as_ref().filter(|_| line.seed.is_multiple_of(SAMPLE)) {
            let mut one = Audit::default();
            let (lattice, Line { origin, direction, range, .. }) = (self.surface.lattice(), line);
            if any {
                one.check_any(lattice, origin, direction, range, root.is_some());
            } else {
                one.check(lattice, origin, direction, range, root.as_ref().map(|root| root.t));
            }
            *audit.lock().unwrap_or_else(PoisonError::into_inner) += one;
        }
        root
    }
}

impl LaneSurface for ColumnWalk {
    fn bounds(&self) -> [Vec3; 2] {
        self.surface.bounds()
    }

    fn closest(&self, rays: &LaneRays, hits: &mut LaneHits, counts: &mut SolveCounts) {
        hits.hit = 0;
        hits.gave_up = 0;
        for lane in (0..LANES).filter(|lane| rays.active >> lane & 1 == 1) {
            let Some(root) = self.answer(rays, lane, false, counts) else { continue };
            hits.hit |= 1 << lane;
            // Rounding to single precision must not carry a hit past the ray's ends.
            hits.t[lane] = (root.t as f32).clamp(rays.tnear[lane], rays.tfar[lane]);
            hits.primitive[lane] = (root.cell[1] * self.surface.lattice().cells[0] + root.cell[0]) as u32;
            hits.u[lane] = root.place[0] as f32;
            hits.v[lane] = root.place[1] as f32;
            let normal = [-root.slope[0], 1.0, -root.slope[1]];
            for axis in 0..3 {
                hits.normal[axis][lane] = normal[axis] as f32;
            }
        }
    }

    fn occluded(&self, rays: &LaneRays, counts: &mut SolveCounts) -> u16 {
        (0..LANES)
            .filter(|&lane| rays.active >> lane & 1 == 1 && self.answer(rays, lane, true, counts).is_some())
            .fold(0, |hit, lane| hit | 1 << lane)
    }

    fn bytes(&self) -> u64 {
        size_of_val(self.bounds.as_slice()) as u64
    }
}
