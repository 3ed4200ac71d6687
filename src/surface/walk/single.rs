//! The walk of a ray that comes alone: the same steps as the lanes', one at a time and with branches, since nothing waits
//! beside it.

use super::patch::slopes;
use super::start::{Given, Ground, Start};
use super::{ENTRY_LEVEL, INSIDE_LEVEL, per_axis};
use crate::simd::{Kernel, Simd};
use crate::surface::SolveCounts;
use crate::surface::lanes::{SingleAnswer, SingleHit, SingleRay};
use crate::surface::lattice::Lattice;
use crate::surface::pyramid::{DIGITS, HOLE, MOST, Pyramid};
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

impl<P: PatchSolver, const K: usize, const D: usize, const ANY: bool> Kernel for SingleWalk<'_, P, K, D, ANY> {
    type Output = SingleAnswer;
    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> SingleAnswer {
        let ground = Ground { lattice: self.lattice, pyramid: self.pyramid, range: self.range };
        let start = ground.start(&Given::single(self.ray));
        if start.length[0] < 0.0 { SingleAnswer::Miss } else { self.walk(s, &start) }
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
    #[inline(always)]
    fn walk<S: Simd>(mut self, s: S, start: &Start<1>) -> SingleAnswer {
        let (lattice, pyramid) = (self.lattice, self.pyramid);
        let end = start.length[0];
        let origin = per_axis!(axis => start.cell[axis][0] as i32);
        let offset = per_axis!(axis => start.offset[axis][0]);
        let slope = per_axis!(axis => start.slope[axis][0]);
        let forward = per_axis!(axis => slope[axis] >= 0.0);
        // Finite, so that a ray that stands on a border gets no NaN from it.
        let inverse = per_axis!(axis => {
            if slope[axis] == 0.0 { f32::MAX } else { (1.0 / slope[axis]).clamp(-f32::MAX, f32::MAX) }
        });
        let top = pyramid.top as i32;
        let mut level = (if start.entered[0] > 0.0 { ENTRY_LEVEL } else { INSIDE_LEVEL }).min(top);
        let mut cell = origin;
        let (mut t, mut y0, mut above) = (0.0f32, start.step[0], 0.0f32);
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
            let y1 = first(s, s.fma(s.splat(to), s.splat(start.rise[0]), s.splat(start.step[0])));
            let (y_low, y_high) = if y0 < y1 { (y0, y1) } else { (y1, y0) };
            let (low, high) = ((word & MOST) as f32, (word >> 16) as f32);
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
        start: &Start<1>,
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
                let cells = start.cell[axis][0] - cell[axis] as f32;
                fma(t, start.slope[axis][0], cells) + start.offset[axis][0]
            })
        };
        let up = |t: f32| (fma(t, self.ray.direction[1], start.height[0][0]) - reference) + start.height[1][0];
        let (from, there) = (along(t), along(to));
        let segment = Segment::<S, K> {
            window,
            u: [s.splat(from[0]), s.splat(there[0])],
            v: [s.splat(from[1]), s.splat(there[1])],
            y: [s.splat(up(t)), s.splat(up(to))],
            above: s.splat(above),
            length: s.splat(to - t),
            tolerance: s.splat(fma(self.ray.tolerance_growth, t, start.tolerance[0])),
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
            let distance = start.base[0] + f64::from(fma(share, to - t, t));
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
