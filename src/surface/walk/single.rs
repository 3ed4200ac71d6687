//! The walk of a ray that comes alone: the same steps as the lanes', one at a time and with branches, since nothing waits
//! beside it.

use super::patch::slopes;
use super::{ENTRY_LEVEL, INSIDE_LEVEL, per_axis};
use crate::simd::{Kernel, Simd};
use crate::surface::SolveCounts;
use crate::surface::lanes::{SingleAnswer, SingleHit, SingleRay};
use crate::surface::lattice::Lattice;
use crate::surface::pyramid::{DIGITS, HOLE, Pyramid};
use crate::surface::solve::{PatchSolver, Segment};

/// One ray against one surface.
pub(in crate::surface) struct SingleWalk<'a, P, const K: usize, const D: usize, const ANY: bool> {
    pub lattice: &'a Lattice,
    pub pyramid: &'a Pyramid,
    pub range: [f64; 2],
    pub solver: P,
    pub ray: &'a SingleRay,
    pub counts: &'a mut SolveCounts,
}

/// Where the ray starts, as [`super::start::Start`].
struct Place {
    base: f64,
    end: f32,
    entered: bool,
    cell: [i32; 2],
    offset: [f32; 2],
    slope: [f32; 2],
    height: [f32; 2],
    step: f32,
    rise: f32,
    tolerance: f32,
}

impl<P: PatchSolver, const K: usize, const D: usize, const ANY: bool> Kernel for SingleWalk<'_, P, K, D, ANY> {
    type Output = SingleAnswer;
    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> SingleAnswer {
        match self.start() {
            Some(start) => self.walk(s, &start),
            None => SingleAnswer::Miss,
        }
    }
}

/// The first lane.
#[inline(always)]
fn first<S: Simd>(s: S, value: S::F) -> f32 {
    let mut lanes = [0.0; 16];
    s.store(value, &mut lanes);
    lanes[0]
}

impl<P: PatchSolver, const K: usize, const D: usize, const ANY: bool> SingleWalk<'_, P, K, D, ANY> {
    /// Clips the ray to the surface's box and moves it there, in double precision; `None` for one that misses it.
    #[inline(always)]
    fn start(&self) -> Option<Place> {
        let (lattice, ray) = (self.lattice, self.ray);
        let tnear = f64::from(ray.range[0]);
        let (mut near, mut far) = (tnear, f64::from(ray.range[1]));
        let inverse_width = per_axis!(axis => 1.0 / lattice.width[axis]);
        let origin = per_axis!(axis => (f64::from(ray.origin[2 * axis]) - lattice.corner[axis]) * inverse_width[axis]);
        let direction = per_axis!(axis => f64::from(ray.direction[2 * axis]) * inverse_width[axis]);
        let (up, rise) = (f64::from(ray.origin[1]), f64::from(ray.direction[1]));
        for axis in 0..2 {
            clip(
                &mut near,
                &mut far,
                origin[axis],
                direction[axis],
                [lattice.domain[0][axis], lattice.domain[1][axis]],
            );
        }
        clip(&mut near, &mut far, up, rise, self.range);
        // As for lanes: a few units in the last place of a slab's quotient.
        let speed = direction[0].abs() + direction[1].abs() + f64::MIN_POSITIVE;
        let back = near - 4.0 * f64::EPSILON * (near.abs() + 1.0 / speed);
        let base = if back > tnear { back } else { tnear };
        let length = far - base;
        if !(0.0..f64::INFINITY).contains(&length) {
            return None;
        }
        let at = per_axis!(axis => origin[axis] + base * direction[axis]);
        // The conversion saturates, and truncates what is then clamped to 0.
        let mut cell = per_axis!(axis => (at[axis] as i32).min(lattice.cells[axis] as i32 - 1).max(0));
        let mut offset = per_axis!(axis => (at[axis] - f64::from(cell[axis])) as f32);
        if direction == [0.0; 2] {
            // A plumb ray stays in one cell: on a border, in one that has a patch.
            let closed = lattice.closed_cell(origin, cell.map(|cell| cell as usize));
            cell = closed.map(|cell| cell as i32);
            offset = per_axis!(axis => {
                ((origin[axis] - closed[axis] as f64).clamp(0.0, 1.0) as f32).min(1.0f32.next_down())
            });
        }
        let height = up + base * rise;
        let leading = height as f32;
        let inverse_step = 1.0 / self.pyramid.step;
        Some(Place {
            base,
            end: length as f32,
            entered: base > tnear,
            cell,
            offset,
            slope: direction.map(|slope| slope as f32),
            height: [leading, (height - f64::from(leading)) as f32],
            step: ((height - self.pyramid.floor) * inverse_step) as f32,
            rise: (rise * inverse_step) as f32,
            tolerance: ray.tolerance + ray.tolerance_growth * base as f32,
        })
    }

    #[inline(always)]
    fn walk<S: Simd>(mut self, s: S, start: &Place) -> SingleAnswer {
        let (lattice, pyramid) = (self.lattice, self.pyramid);
        let &Place { end, cell: origin, offset, slope, .. } = start;
        let forward = per_axis!(axis => slope[axis] >= 0.0);
        // Finite, so that a ray that stands on a border gets no NaN from it.
        let inverse = per_axis!(axis => {
            if slope[axis] == 0.0 { f32::MAX } else { (1.0 / slope[axis]).clamp(-f32::MAX, f32::MAX) }
        });
        let top = pyramid.top as i32;
        let mut level = (if start.entered { ENTRY_LEVEL } else { INSIDE_LEVEL }).min(top);
        let mut cell = origin;
        let (mut t, mut y0, mut above) = (0.0f32, start.step, 0.0f32);
        loop {
            let block = per_axis!(axis => cell[axis] >> level);
            let entry = level as usize & 15;
            let word = pyramid.words[(pyramid.start[entry] + block[1] * pyramid.row[entry] + block[0]) as usize];
            let size = 1 << level;
            let least = per_axis!(axis => cell[axis] & !(size - 1));
            let border = per_axis!(axis => least[axis] + if forward[axis] { size } else { 0 });
            let exit = per_axis!(axis => ((border[axis] - origin[axis]) as f32 - offset[axis]) * inverse[axis]);
            let x_first = exit[0] <= exit[1];
            let out = if x_first { exit[0] } else { exit[1] };
            let out = if out < end { out } else { end };
            let to = if out > t { out } else { t };
            let y1 = first(s, s.fma(s.splat(to), s.splat(start.rise), s.splat(start.step)));
            let (y_low, y_high) = if y0 < y1 { (y0, y1) } else { (y1, y0) };
            let (low, high) = ((word & 0x7fff) as f32, (word >> 16) as f32);
            if (low <= y_high) & (y_low <= high) {
                if level > 0 {
                    level -= DIGITS as i32;
                    continue;
                }
                match self.solve(s, start, cell, [t, to], above) {
                    Ok(side) => above = side,
                    Err(answer) => return answer,
                }
            } else {
                // Passed over, or under; over a hole there is no side.
                above = if word & HOLE != 0 {
                    0.0
                } else if y0 > high {
                    1.0
                } else {
                    -1.0
                };
            }
            if to >= end {
                return SingleAnswer::Miss;
            }
            let across = per_axis!(axis => (axis == 0) == x_first);
            let old = cell;
            for axis in 0..2 {
                let beyond = border[axis] - i32::from(!forward[axis]);
                let inside = if level == 0 {
                    cell[axis]
                } else {
                    let most = (least[axis] + size - 1).min(lattice.cells[axis] as i32 - 1);
                    let place = first(s, s.fma(s.splat(to), s.splat(slope[axis]), s.splat(offset[axis])));
                    (place.floor() as i32 + origin[axis]).min(most).max(least[axis])
                };
                cell[axis] = if across[axis] { beyond } else { inside };
            }
            let changed = (cell[0] ^ old[0]) | (cell[1] ^ old[1]);
            if changed >> (level + DIGITS as i32) != 0 {
                level = (level + DIGITS as i32).min(top);
            }
            let outside = |axis: usize| cell[axis] as u32 >= lattice.cells[axis] as u32;
            if outside(0) | outside(1) {
                return SingleAnswer::Miss;
            }
            t = to;
            y0 = y1;
        }
    }

    /// Solves the patch of `cell` over `range`: the side on which the ray leaves it, or the answer.
    #[inline(always)]
    fn solve<S: Simd>(
        &mut self,
        s: S,
        start: &Place,
        cell: [i32; 2],
        range: [f32; 2],
        above: f32,
    ) -> Result<f32, SingleAnswer> {
        let lattice = self.lattice;
        self.counts.patches += 1;
        let corner = cell[1] as usize * lattice.stride + cell[0] as usize;
        let rows = &lattice.heights[corner..][..(K - 1) * lattice.stride + K];
        let reference = rows[(K / 2) * lattice.stride + K / 2];
        let mut window = [[s.splat(0.0); K]; K];
        for b in 0..K {
            for a in 0..K {
                window[b][a] = s.splat(rows[b * lattice.stride + a] - reference);
            }
        }
        let [t, to] = range;
        let fma = |a: f32, b: f32, c: f32| first(s, s.fma(s.splat(a), s.splat(b), s.splat(c)));
        let along = |t: f32| {
            per_axis!(axis => {
                let cells = (start.cell[axis] - cell[axis]) as f32;
                fma(t, start.slope[axis], cells) + start.offset[axis]
            })
        };
        let up = |t: f32| (fma(t, self.ray.direction[1], start.height[0]) - reference) + start.height[1];
        let (from, there) = (along(t), along(to));
        let segment = Segment::<S, K> {
            window,
            u: [s.splat(from[0]), s.splat(there[0])],
            v: [s.splat(from[1]), s.splat(there[1])],
            y: [s.splat(up(t)), s.splat(up(to))],
            above: s.splat(above),
            length: s.splat(to - t),
            tolerance: s.splat(fma(self.ray.tolerance_growth, t, start.tolerance)),
            mask: s.from_bits(1),
        };
        let answer = self.solver.solve::<S, K, D, ANY>(s, &segment, self.counts);
        if s.bits(answer.hit) & 1 == 1 {
            if ANY {
                let nothing = SingleHit { t: 0.0, primitive: 0, uv: [0.0; 2], normal: [0.0; 3] };
                return Err(SingleAnswer::Hit(nothing));
            }
            let share = first(s, answer.s);
            let uv = per_axis!(axis => fma(share, there[axis] - from[axis], from[axis]).clamp(0.0, 1.0));
            let (along_u, along_v) = slopes::<S, K>(s, &segment.window, s.splat(uv[0]), s.splat(uv[1]));
            let distance = start.base + f64::from(fma(share, to - t, t));
            return Err(SingleAnswer::Hit(SingleHit {
                t: distance.min(f64::from(self.ray.range[1])) as f32,
                primitive: cell[1] as u32 * lattice.cells[0] as u32 + cell[0] as u32,
                uv,
                normal: [
                    first(s, along_u) * (-1.0 / lattice.width[0]) as f32,
                    1.0,
                    first(s, along_v) * (-1.0 / lattice.width[1]) as f32,
                ],
            }));
        }
        if s.bits(answer.gave_up) & 1 == 1 {
            self.counts.gave_up += 1;
            return Err(SingleAnswer::GaveUp);
        }
        Ok(first(s, answer.above))
    }
}

/// As for lanes.
#[inline(always)]
fn clip(near: &mut f64, far: &mut f64, origin: f64, direction: f64, [low, high]: [f64; 2]) {
    // A ray along the slab: its quotients are infinite and say inside or outside, but for one that lies in a border,
    // 0 * inf. That one is inside.
    let inverse = if direction == 0.0 { f64::INFINITY } else { 1.0 / direction };
    let (a, b) = ((low - origin) * inverse, (high - origin) * inverse);
    let a = if a.is_nan() { f64::NEG_INFINITY } else { a };
    let b = if b.is_nan() { f64::INFINITY } else { b };
    let (least, most) = if a < b { (a, b) } else { (b, a) };
    *near = if least > *near { least } else { *near };
    *far = if most < *far { most } else { *far };
}
