//! Steps over blocks of the pyramid and down into them: what sixteen lanes do until they stand at a patch.

use super::Walk;
use super::per_axis;
use crate::simd::Simd;
use crate::surface::lattice::Lattice;
use crate::surface::pyramid::{DIGITS, HOLE, MOST, Pyramid};
use crate::surface::solve::PatchSolver;

/// The rays that one vector's lanes walk.
#[derive(Clone, Copy)]
pub(super) struct Lanes<S: Simd> {
    /// Cell of the start.
    pub base_cell: [S::I; 2],
    /// Place within it.
    pub offset: [S::F; 2],
    /// Cells per t.
    pub slope: [S::F; 2],
    /// Height of the start (m), leading and trailing part.
    pub height: [S::F; 2],
    /// Height of the start in steps of the pyramid.
    pub step: S::F,
    /// Steps per t.
    pub rise: S::F,
    /// Length of the walk, in t.
    pub end: S::F,
    /// Tolerance at the start, in t.
    pub tolerance: S::F,
    /// Metres up per t.
    pub vertical: S::F,
    /// Place among the waiting.
    pub ray: S::F,
    /// t per step.
    pub inverse_rise: S::F,
    /// Whether the ray runs towards greater x, z, or along the border.
    pub forward: [S::M; 2],
    /// 0 forward, 1 backward.
    pub back: [S::I; 2],
    /// t per cell, finite.
    pub inverse: [S::F; 2],
    /// Where it is now.
    pub cell: [S::I; 2],
    /// Digits dropped on the level it is on.
    pub level: S::I,
    /// How far it has come.
    pub t: S::F,
    /// Side of the surface: +1 above, -1 below, 0 unknown.
    pub above: S::F,
    /// Lanes that have a ray.
    pub active: S::M,
    /// Lanes that stand at a patch.
    pub waiting: S::M,
    /// t at which they leave it.
    pub leave: S::F,
    /// Whether they do so across x.
    pub crosses_x: S::M,
}

impl<S: Simd> Lanes<S> {
    #[inline(always)]
    pub(super) fn empty(s: S) -> Self {
        let (zero, int_zero, none) = (s.splat(0.0), s.splat_int(0), s.from_bits(0));
        Self {
            base_cell: [int_zero; 2],
            offset: [zero; 2],
            slope: [zero; 2],
            height: [zero; 2],
            step: zero,
            rise: zero,
            end: zero,
            tolerance: zero,
            vertical: zero,
            ray: zero,
            inverse_rise: zero,
            forward: [none; 2],
            back: [int_zero; 2],
            inverse: [zero; 2],
            cell: [int_zero; 2],
            level: int_zero,
            t: zero,
            above: zero,
            active: none,
            waiting: none,
            leave: zero,
            crosses_x: none,
        }
    }
}

/// What all lanes share.
pub(super) struct Grid<S: Simd> {
    /// The last cell along x and z.
    pub last_cell: [S::I; 2],
    /// The coarsest level.
    pub top_level: S::I,
    /// From level to level.
    pub digits: S::I,
}

impl<S: Simd> Grid<S> {
    #[inline(always)]
    pub(super) fn new(s: S, lattice: &Lattice, pyramid: &Pyramid) -> Self {
        Self {
            last_cell: per_axis!(axis => s.splat_int(lattice.cells[axis] as i32 - 1)),
            top_level: s.splat_int(pyramid.top as i32),
            digits: s.splat_int(DIGITS as i32),
        }
    }
    /// Lanes whose cell lies outside the grid.
    #[inline(always)]
    pub(super) fn outside(&self, s: S, cell: &[S::I; 2]) -> S::M {
        // The sign bit of any of them.
        let beyond = (self.last_cell[0] - cell[0]) | cell[0] | (self.last_cell[1] - cell[1]) | cell[1];
        s.gt_int(s.splat_int(0), beyond)
    }
}

impl<P: PatchSolver, const K: usize, const D: usize, const ANY: bool, const N: usize, const G: usize>
    Walk<'_, P, K, D, ANY, N, G>
{
    /// One step of each lane that does not stand at a patch: over a block, or down into it.
    #[inline(always)]
    pub(super) fn step<S: Simd>(&self, s: S, grid: &Grid<S>, lanes: &mut Lanes<S>) {
        let pyramid = self.pyramid;
        let (one, int_zero, int_one) = (s.splat(1.0), s.splat_int(0), s.splat_int(1));
        let stepping = lanes.active & !lanes.waiting;
        let block = per_axis!(axis => s.shift_right(lanes.cell[axis], lanes.level));
        let index = s.lookup(&pyramid.start, lanes.level) + block[1] * s.lookup(&pyramid.row, lanes.level) + block[0];
        let word = s.gather(&pyramid.words, index, stepping);
        // While bounds are on their way: where each lane leaves its block, and the cell beyond.
        let size = s.shift_left(int_one, lanes.level);
        let within = size - int_one;
        let least = per_axis!(axis => s.and_not(lanes.cell[axis], within));
        let border = per_axis!(axis => s.select_int(lanes.forward[axis], least[axis] + size, least[axis]));
        let exit = per_axis!(axis => {
            (s.to_float(border[axis] - lanes.base_cell[axis]) - lanes.offset[axis]) * lanes.inverse[axis]
        });
        let to = s.max(s.min(s.min(exit[0], exit[1]), lanes.end), lanes.t);
        let (y0, y1) = (s.fma(lanes.t, lanes.rise, lanes.step), s.fma(to, lanes.rise, lanes.step));
        let (y_low, y_high) = (s.min(y0, y1), s.max(y0, y1));
        let coarse = s.gt_int(lanes.level, int_zero);
        let x_first = s.le(exit[0], exit[1]);

        let low = s.to_float(word & s.splat_int(MOST as i32));
        let high = s.to_float(s.shift_right(word, s.splat_int(16)));
        let whole = s.eq_int(word & s.splat_int(HOLE as i32), int_zero);
        // A block without patch has its least above all there is, and no ray there.
        let overlaps = s.le(low, y_high) & s.le(y_low, high) & stepping;
        let over = s.lt(high, y0);

        // Down: on to where the ray enters the block's slab, and one level finer.
        let down = overlaps & coarse;
        let moves = down & (over | s.lt(y0, low));
        let bound = s.select(over, high, low);
        let enter = s.min(s.max((bound - lanes.step) * lanes.inverse_rise, lanes.t), to);
        // Passed over, or under; over a hole there is no side.
        let skip = stepping & !overlaps;
        let goes = skip | moves;
        let side = s.select(over, one, s.splat(-1.0));
        lanes.above = s.select(goes, s.select(whole, side, s.splat(0.0)), lanes.above);
        let at = s.select(moves, enter, to);
        let across = [x_first, !x_first];
        let mut next = [int_zero; 2];
        for axis in 0..2 {
            let most = s.min_int(least[axis] + within, grid.last_cell[axis]);
            let place = s.floor_int(s.fma(at, lanes.slope[axis], lanes.offset[axis])) + lanes.base_cell[axis];
            let inside = s.max_int(s.min_int(place, most), least[axis]);
            next[axis] = s.select_int(skip & across[axis], border[axis] - lanes.back[axis], inside);
        }
        let up = lanes.level + grid.digits;
        let changed = (next[0] ^ lanes.cell[0]) | (next[1] ^ lanes.cell[1]);
        let stays = s.eq_int(s.shift_right(changed, up), int_zero);
        let climbed = s.select_int(stays, lanes.level, s.min_int(up, grid.top_level));
        let level = s.select_int(skip, climbed, lanes.level);
        lanes.level = s.select_int(down, lanes.level - grid.digits, level);
        lanes.cell = per_axis!(axis => s.select_int(goes, next[axis], lanes.cell[axis]));
        let finished = skip & (s.le(lanes.end, to) | grid.outside(s, &lanes.cell));
        lanes.active = lanes.active & !finished;
        lanes.t = s.select(goes, at, lanes.t);
        let arrives = overlaps & !coarse;
        lanes.waiting = lanes.waiting | arrives;
        lanes.leave = s.select(arrives, to, lanes.leave);
        lanes.crosses_x = (lanes.crosses_x & !arrives) | (x_first & arrives);
    }
}
