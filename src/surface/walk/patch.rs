//! Patches that lanes stand at: solved, found hits kept, the others sent on; at the end, hits as their caller wants them.

use super::per_axis;
use super::step::{Grid, Lanes};
use super::{AT, PATCH, PLACE, Queue, Walk};
use crate::simd::Simd;
use crate::surface::lanes::LANES;
use crate::surface::solve::{PatchSolver, Segment};

impl<P: PatchSolver, const K: usize, const D: usize, const ANY: bool, const N: usize, const G: usize>
    Walk<'_, P, K, D, ANY, N, G>
{
    /// Solves the patches that lanes stand at, and sends those that miss on.
    #[inline(always)]
    pub(super) fn solve<S: Simd>(&mut self, s: S, grid: &Grid<S>, lanes: &mut Lanes<S>, queue: &mut Queue<N>) {
        let lattice = self.lattice;
        let int_one = s.splat_int(1);
        let waiting = lanes.waiting;
        let Lanes { t, leave, cell, base_cell, slope, offset, height, vertical, .. } = *lanes;
        self.counts.patches += u64::from(s.bits(waiting).count_ones());
        let corner = cell[1] * s.splat_int(lattice.stride as i32) + cell[0];
        let mut window = s.gather_window::<K>(&lattice.heights, lattice.stride, corner, waiting);
        let reference = window[K / 2][K / 2];
        for row in &mut window {
            for height in row {
                *height = *height - reference;
            }
        }
        let cells = per_axis!(axis => s.to_float(base_cell[axis] - cell[axis]));
        let from = per_axis!(axis => s.fma_exact(t, slope[axis], cells[axis]) + offset[axis]);
        let to = per_axis!(axis => s.fma_exact(leave, slope[axis], cells[axis]) + offset[axis]);
        let heights = [
            (s.fma_exact(t, vertical, height[0]) - reference) + height[1],
            (s.fma_exact(leave, vertical, height[0]) - reference) + height[1],
        ];
        let segment = Segment {
            window,
            u: [from[0], to[0]],
            v: [from[1], to[1]],
            y: heights,
            above: lanes.above,
            length: leave - t,
            tolerance: s.fma(s.splat(self.rays[0].tolerance_growth), t, lanes.tolerance),
            mask: waiting,
        };
        let answer = self.solver.solve::<S, K, D, ANY>(s, &segment, self.counts);
        let hits = answer.hit & waiting;
        if s.any(hits) {
            let count = queue.hits;
            s.compress(lanes.ray, hits, &mut queue.found[0][count..]);
            if !ANY {
                s.compress(s.fma(answer.s, segment.length, t), hits, &mut queue.found[AT][count..]);
                for axis in 0..2 {
                    let ends = [segment.u, segment.v][axis];
                    let place = s.fma(answer.s, ends[1] - ends[0], ends[0]);
                    s.compress(place, hits, &mut queue.found[PLACE + axis][count..]);
                    s.compress(s.to_float(cell[axis]), hits, &mut queue.found[PATCH + axis][count..]);
                }
            }
            queue.hits += s.bits(hits).count_ones() as usize;
        }
        let doubtful = answer.gave_up & waiting;
        if s.any(doubtful) {
            self.doubt(s, queue, lanes.ray, doubtful);
        }
        lanes.active = lanes.active & !hits & !doubtful;

        // On to the next patch.
        let missed = waiting & lanes.active;
        lanes.waiting = s.from_bits(0);
        lanes.above = s.select(missed, answer.above, lanes.above);
        let across = [lanes.crosses_x, !lanes.crosses_x];
        let next = per_axis!(axis => {
            let beyond = s.select_int(lanes.forward[axis], cell[axis] + int_one, cell[axis] - int_one);
            s.select_int(missed & across[axis], beyond, cell[axis])
        });
        let changed = (next[0] ^ cell[0]) | (next[1] ^ cell[1]);
        let stays = s.eq_int(s.shift_right(changed, grid.digits), s.splat_int(0));
        lanes.level = s.select_int(stays, lanes.level, s.min_int(grid.digits, grid.top_level));
        lanes.cell = next;
        lanes.t = s.select(missed, leave, lanes.t);
        lanes.active = lanes.active & !(missed & (s.le(lanes.end, leave) | grid.outside(s, &lanes.cell)));
    }

    /// Notes the rays for which the solver gave up.
    #[cold]
    fn doubt<S: Simd>(&mut self, s: S, queue: &Queue<N>, ray: S::F, doubtful: S::M) {
        let mut rays = [0.0; LANES];
        s.store(ray, &mut rays);
        let doubtful = s.bits(doubtful);
        for lane in (0..S::LANES).filter(|lane| doubtful >> lane & 1 == 1) {
            let ray = queue.number[rays[lane] as usize];
            self.hits[ray / LANES].gave_up |= 1 << (ray % LANES);
            self.counts.gave_up += 1;
        }
    }

    /// Writes the hits as the packets' caller wants them.
    #[inline(always)]
    pub(super) fn record<S: Simd>(&mut self, s: S, queue: &Queue<N>) {
        if ANY {
            for &ray in &queue.found[0][..queue.hits] {
                let ray = queue.number[ray as usize];
                self.hits[ray / LANES].hit |= 1 << (ray % LANES);
            }
            return;
        }
        let (zero, one) = (s.splat(0.0), s.splat(1.0));
        for first in (0..queue.hits).step_by(S::LANES) {
            let count = S::LANES.min(queue.hits - first);
            let mask = s.from_bits(((1u64 << count) - 1) as u32);
            let [u, v] = per_axis!(axis => {
                s.min(s.max(s.expand(&queue.found[PLACE + axis][first..], mask, zero), zero), one)
            });
            let cell = per_axis!(axis => s.floor_int(s.expand(&queue.found[PATCH + axis][first..], mask, zero)));
            let corner = cell[1] * s.splat_int(self.lattice.stride as i32) + cell[0];
            let window = s.gather_window::<K>(&self.lattice.heights, self.lattice.stride, corner, mask);
            let (along_u, along_v) = slopes::<S, K>(s, &window, u, v);
            let patch = cell[1] * s.splat_int(self.lattice.cells[0] as i32) + cell[0];
            let mut patches = [0i32; LANES];
            let mut fields = [[0.0f32; LANES]; 4];
            s.store_int(patch, &mut patches);
            s.store(u, &mut fields[0]);
            s.store(v, &mut fields[1]);
            s.store(along_u * s.splat((-1.0 / self.lattice.width[0]) as f32), &mut fields[2]);
            s.store(along_v * s.splat((-1.0 / self.lattice.width[1]) as f32), &mut fields[3]);
            for lane in 0..count {
                let waited = queue.found[0][first + lane] as usize;
                let ray = queue.number[waited];
                let (packet, to) = (ray / LANES, ray % LANES);
                let far = f64::from(self.rays[packet].tfar[to]);
                let hits = &mut self.hits[packet];
                hits.hit |= 1 << to;
                hits.t[to] = (queue.base[waited] + f64::from(queue.found[AT][first + lane])).min(far) as f32;
                hits.primitive[to] = patches[lane] as u32;
                hits.u[to] = fields[0][lane];
                hits.v[to] = fields[1][lane];
                hits.normal[0][to] = fields[2][lane];
                hits.normal[1][to] = 1.0;
                hits.normal[2][to] = fields[3][lane];
            }
        }
    }
}

/// Slopes of the patch per unit of u and v.
#[inline(always)]
pub(in crate::surface) fn slopes<S: Simd, const K: usize>(
    s: S,
    window: &[[S::F; K]; K],
    u: S::F,
    v: S::F,
) -> (S::F, S::F) {
    let ((bu, du), (bv, dv)) = (lane_basis::<S, K>(s, u), lane_basis::<S, K>(s, v));
    let (mut along_u, mut along_v) = (s.splat(0.0), s.splat(0.0));
    for b in 0..K {
        let (mut value, mut slope) = (s.splat(0.0), s.splat(0.0));
        for a in 0..K {
            value = s.fma(window[b][a], bu[a], value);
            slope = s.fma(window[b][a], du[a], slope);
        }
        along_u = s.fma(slope, bv[b], along_u);
        along_v = s.fma(value, dv[b], along_v);
    }
    (along_u, along_v)
}

/// [`crate::surface::basis`] in lanes.
#[inline(always)]
fn lane_basis<S: Simd, const K: usize>(s: S, u: S::F) -> ([S::F; K], [S::F; K]) {
    let one = s.splat(1.0);
    let w = one - u;
    let half = s.splat(0.5);
    let zero = s.splat(0.0);
    let (value, slope) = match K {
        2 => ([w, u, zero, zero], [zero - one, one, zero, zero]),
        3 => ([half * w * w, s.fma(u, w, half), half * u * u, zero], [zero - w, w - u, u, zero]),
        _ => {
            let sixth = s.splat(1.0 / 6.0);
            let two_thirds = s.splat(2.0 / 3.0);
            let (one_and_half, two) = (s.splat(1.5), s.splat(2.0));
            (
                [
                    sixth * w * w * w,
                    two_thirds - u * u * (one - half * u),
                    two_thirds - w * w * (one - half * w),
                    sixth * u * u * u,
                ],
                [zero - half * w * w, u * (one_and_half * u - two), zero - w * (one_and_half * w - two), half * u * u],
            )
        }
    };
    let (mut values, mut slopes) = ([zero; K], [zero; K]);
    // Registers, not memory: a loop of known length leaves them there.
    #[allow(clippy::manual_memcpy)]
    for index in 0..K {
        values[index] = value[index];
        slopes[index] = slope[index];
    }
    (values, slopes)
}
