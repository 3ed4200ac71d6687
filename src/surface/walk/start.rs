//! Where rays begin their walk: clipped to the surface's box and moved there in double precision.

use crate::surface::lanes::{LANES, LaneRays, SingleRay};
use crate::surface::lattice::Lattice;
use crate::surface::pyramid::Pyramid;

/// Rays as they are given: a packet's, or one.
pub(super) struct Given<const L: usize> {
    pub origin: [[f32; L]; 3],
    pub direction: [[f32; L]; 3],
    pub tnear: [f32; L],
    pub tfar: [f32; L],
    pub tolerance: [f32; L],
    pub tolerance_growth: f32,
    /// Bit per lane that holds a ray.
    pub active: u16,
}

impl Given<LANES> {
    #[inline(always)]
    pub(super) fn packet(rays: &LaneRays) -> Self {
        let LaneRays { origin, direction, tnear, tfar, tolerance, tolerance_growth, active } = *rays;
        Self { origin, direction, tnear, tfar, tolerance, tolerance_growth, active }
    }
}

impl Given<1> {
    #[inline(always)]
    pub(super) fn single(ray: &SingleRay) -> Self {
        Self {
            origin: ray.origin.map(|component| [component]),
            direction: ray.direction.map(|component| [component]),
            tnear: [ray.range[0]],
            tfar: [ray.range[1]],
            tolerance: [ray.tolerance],
            tolerance_growth: ray.tolerance_growth,
            active: 1,
        }
    }
}

/// What rays start over: the lattice, its bounds, and the least and greatest height (m).
#[derive(Clone, Copy)]
pub(super) struct Ground<'a> {
    pub lattice: &'a Lattice,
    pub pyramid: &'a Pyramid,
    pub range: [f64; 2],
}

/// Where some rays of a packet start, in the surface's own terms.
pub(super) struct Start<const L: usize> {
    /// Cell of the start: whole numbers.
    pub cell: [[f32; L]; 2],
    /// Offset within it, 0..1.
    pub offset: [[f32; L]; 2],
    /// Cells per t.
    pub slope: [[f32; L]; 2],
    /// Height (m), leading and trailing part.
    pub height: [[f32; L]; 2],
    /// Height in steps of the pyramid.
    pub step: [f32; L],
    /// Steps per t.
    pub rise: [f32; L],
    /// t of the start on the ray as given.
    pub base: [f64; L],
    /// Length of the walk, in t; negative for a ray that misses the surface's box.
    pub length: [f32; L],
    /// Tolerance at the start.
    pub tolerance: [f32; L],
    /// Positive where the ray entered the box from outside.
    pub entered: [f32; L],
}

impl Ground<'_> {
    /// Clips each ray to the surface's box and moves it there, in double precision. Loops over lanes, one plain
    /// expression each, that compilers turn into vectors.
    #[inline(always)]
    pub(super) fn start<const L: usize>(&self, rays: &Given<L>) -> Start<L> {
        let lattice = self.lattice;
        let inverse_width = [1.0 / lattice.width[0], 1.0 / lattice.width[1]];
        let (mut near, mut far) = ([0.0; L], [0.0; L]);
        let (mut origin, mut direction) = ([[0.0; L]; 3], [[0.0; L]; 3]);
        for lane in 0..L {
            near[lane] = f64::from(rays.tnear[lane]);
            far[lane] = f64::from(rays.tfar[lane]);
            origin[0][lane] = (f64::from(rays.origin[0][lane]) - lattice.corner[0]) * inverse_width[0];
            origin[1][lane] = (f64::from(rays.origin[2][lane]) - lattice.corner[1]) * inverse_width[1];
            origin[2][lane] = f64::from(rays.origin[1][lane]);
            direction[0][lane] = f64::from(rays.direction[0][lane]) * inverse_width[0];
            direction[1][lane] = f64::from(rays.direction[2][lane]) * inverse_width[1];
            direction[2][lane] = f64::from(rays.direction[1][lane]);
        }
        let tnear = near;
        let low = [lattice.domain[0][0], lattice.domain[0][1], self.range[0]];
        let high = [lattice.domain[1][0], lattice.domain[1][1], self.range[1]];
        for axis in 0..3 {
            clip(&mut near, &mut far, &origin[axis], &direction[axis], [low[axis], high[axis]]);
        }
        let mut start = Start {
            cell: [[0.0; L]; 2],
            offset: [[0.0; L]; 2],
            slope: [[0.0; L]; 2],
            height: [[0.0; L]; 2],
            step: [0.0; L],
            rise: [0.0; L],
            base: [0.0; L],
            length: [0.0; L],
            tolerance: [0.0; L],
            entered: [0.0; L],
        };
        for lane in 0..L {
            // Rounding of a slab's quotient: a few units in the last place, so that water at the very edge stays.
            let speed = direction[0][lane].abs() + direction[1][lane].abs() + f64::MIN_POSITIVE;
            let slack = 4.0 * f64::EPSILON * (near[lane].abs() + 1.0 / speed);
            let back = near[lane] - slack;
            let base = if back > tnear[lane] { back } else { tnear[lane] };
            let length = far[lane] - base;
            // Not finite: a ray that never leaves, because it is none.
            let meets = (0.0..f64::INFINITY).contains(&length);
            start.base[lane] = if meets { base } else { 0.0 };
            start.length[lane] = if meets { length as f32 } else { -1.0 };
            start.entered[lane] = (base - tnear[lane]) as f32;
        }
        for axis in 0..2 {
            let last = (lattice.cells[axis] - 1) as f64;
            for lane in 0..L {
                let at = origin[axis][lane] + start.base[lane] * direction[axis][lane];
                let cell = at.floor();
                let cell = if cell > 0.0 { cell } else { 0.0 };
                let cell = if cell < last { cell } else { last };
                start.cell[axis][lane] = cell as f32;
                start.offset[axis][lane] = (at - cell) as f32;
                start.slope[axis][lane] = direction[axis][lane] as f32;
            }
        }
        let mut plumb = false;
        for lane in 0..L {
            plumb |= (direction[0][lane] == 0.0) & (direction[1][lane] == 0.0) & (start.length[lane] >= 0.0);
        }
        if plumb {
            self.settle_plumb(rays.active, &mut start, &origin, &direction);
        }
        let inverse_step = 1.0 / self.pyramid.step;
        for lane in 0..L {
            let height = origin[2][lane] + start.base[lane] * direction[2][lane];
            let leading = height as f32;
            start.height[0][lane] = leading;
            start.height[1][lane] = (height - f64::from(leading)) as f32;
            start.step[lane] = ((height - self.pyramid.floor) * inverse_step) as f32;
            start.rise[lane] = (direction[2][lane] * inverse_step) as f32;
            start.tolerance[lane] = rays.tolerance[lane] + rays.tolerance_growth * start.base[lane] as f32;
        }
        start
    }

    /// Plumb rays stay in one cell: on a border, in one that has a patch.
    #[cold]
    fn settle_plumb<const L: usize>(
        &self,
        active: u16,
        start: &mut Start<L>,
        origin: &[[f64; L]; 3],
        direction: &[[f64; L]; 3],
    ) {
        for lane in (0..L).filter(|&lane| direction[0][lane] == 0.0 && direction[1][lane] == 0.0) {
            if start.length[lane] >= 0.0 && active >> lane & 1 == 1 {
                let at = [origin[0][lane], origin[1][lane]];
                let cell = self.lattice.closed_cell(at, [0, 1].map(|axis| start.cell[axis][lane] as usize));
                for axis in 0..2 {
                    start.cell[axis][lane] = cell[axis] as f32;
                    // Within the cell: a whole 1 would be the next one's 0.
                    let offset = (at[axis] - cell[axis] as f64).clamp(0.0, 1.0);
                    start.offset[axis][lane] = (offset as f32).min(1.0f32.next_down());
                }
            }
        }
    }
}

/// Clips the intervals `near..far` of each lane to a slab; the border belongs to it.
#[inline(always)]
fn clip<const L: usize>(
    near: &mut [f64; L],
    far: &mut [f64; L],
    origin: &[f64; L],
    direction: &[f64; L],
    [low, high]: [f64; 2],
) {
    for lane in 0..L {
        let d = direction[lane];
        // A ray along the slab: its quotients are infinite and say inside or outside, but for one that lies in a border,
        // 0 * inf. That one is inside.
        let inverse = if d == 0.0 { f64::INFINITY } else { 1.0 / d };
        let a = (low - origin[lane]) * inverse;
        let b = (high - origin[lane]) * inverse;
        let a = if a.is_nan() { f64::NEG_INFINITY } else { a };
        let b = if b.is_nan() { f64::INFINITY } else { b };
        let (least, most) = (if a < b { a } else { b }, if a < b { b } else { a });
        near[lane] = if least > near[lane] { least } else { near[lane] };
        far[lane] = if most < far[lane] { most } else { far[lane] };
    }
}
