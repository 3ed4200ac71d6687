//! Volume: what the pipes ask for, cut down to what each column holds, and moved; and what moves with it.
//!
//! Three passes, each over all columns, so that no order of columns or threads shows in the result.

use rayon::prelude::*;

use super::Water;
use super::layout::{FAMILIES, Layout, MARGIN, OFFSETS, PipeRow, columns, pipes};
use super::rows::{each_row, each_row_of_two, greater};

/// A column's pipes: family, the shift to the owner, and whether the column is its tail; in pairs that mirror each other.
pub(super) const PAIRS: [[(usize, [isize; 2], bool); 2]; FAMILIES] = [
    [(0, [0, 0], false), (0, [-1, 0], true)],
    [(1, [0, 0], false), (1, [0, -1], true)],
    [(2, [0, 0], false), (2, [-1, -1], true)],
    [(3, [0, 0], false), (3, [1, -1], true)],
];

/// Columns that one task carries things into.
const COLUMNS_PER_TASK: usize = 4096;

/// Part of its water that a column gives at most: eight products and their sum are rounded, so a share of 1 could ask for
/// some 9 units in the last place too much.
const GIVES: f64 = 1.0 - 16.0 * f64::EPSILON;

impl Water {
    /// Moves the volumes in `moved` as far as the columns can give them.
    pub(super) fn move_volume(&mut self, parallel: bool) {
        let (stride, nx, area) = (self.layout.stride, self.layout.nx, self.layout.area);
        let layout = &self.layout;
        let inner = self.layout.nz + 1;

        let (moved, depth) = (&self.pipes.moved, &self.depth);
        each_row(&mut self.share[stride..inner * stride], stride, parallel, |z, share| {
            let (share, depth) = (&mut share[MARGIN..][..nx], &depth[z * nx..][..nx]);
            share_row(moved, stride, z + 1, depth, area, share);
        });

        let share = &self.share;
        if let Some(cells) = &mut self.cells {
            cells.scale(layout, &self.pipes.moved, share);
        }
        self.pipes.each_row(layout, parallel, |row, pipes| {
            if (row..row + 2).any(|row| share[row * stride..][..stride].iter().any(|&share| share < 1.0)) {
                scale_row(share, layout, row, pipes);
            }
        });

        let moved = &self.pipes.moved;
        each_row_of_two(&mut self.depth, &mut self.kept, nx, parallel, |z, depth, kept| {
            gather_row(moved, stride, z + 1, area, depth, kept);
        });
        let (depth, base) = (&self.depth, &self.base);
        each_row(&mut self.top[stride..inner * stride], stride, parallel, |z, top| {
            let (depth, base) = (&depth[z * nx..][..nx], &base[z * nx..][..nx]);
            let top = &mut top[MARGIN..][..nx];
            for i in 0..nx {
                top[i] = base[i] + depth[i];
            }
        });
    }

    /// Carries what is dissolved in the water as the last step moved it: each volume takes its column's value along, and a
    /// column's new value is the mean of what stayed and what came in. Nothing is made or lost, and no new extremes arise;
    /// a column that nothing is left in gets 0. Water given to or taken from columns since that step changes no value.
    ///
    /// `values`: one for each column. `scratch` is made as long; keep it, to allocate once.
    pub fn carry(&self, values: &mut [f64], scratch: &mut Vec<f64>) {
        let layout = &self.layout;
        assert_eq!(values.len(), self.grid.count(), "one value for each column");
        scratch.clear();
        scratch.extend_from_slice(values);
        let before: &[f64] = scratch;
        values.par_iter_mut().with_min_len(COLUMNS_PER_TASK).enumerate().for_each(|(column, value)| {
            let kept = self.kept[column];
            // A column that nothing stayed in and nothing came into is dry, and most of a valley is.
            if kept <= 0.0 && self.depth[column] <= 0.0 {
                *value = 0.0;
                return;
            }
            let here = layout.padded_index(column);
            let (mut volume, mut sum) = ([0.0; FAMILIES], [0.0; FAMILIES]);
            for (pair, pipes) in PAIRS.iter().enumerate() {
                for &(family, shift, is_tail) in pipes {
                    let owner = layout.moved(here, shift);
                    let moved = self.pipes.moved[layout.pipe(owner, family)];
                    let inflow = if is_tail { moved } else { -moved }.max(0.0);
                    if inflow > 0.0 {
                        let [dx, dz] = OFFSETS[family];
                        let (dx, dz) = if is_tail { (-dx, -dz) } else { (dx, dz) };
                        let from = column.wrapping_add_signed(dz * layout.nx as isize + dx);
                        volume[pair] += inflow;
                        sum[pair] += inflow * before[from];
                    }
                }
            }
            let total = kept + ((volume[0] + volume[1]) + (volume[2] + volume[3]));
            let sum = kept * before[column] + ((sum[0] + sum[1]) + (sum[2] + sum[3]));
            *value = if total > 0.0 { sum / total } else { 0.0 };
        });
    }
}

impl Water {
    /// Volume (m3) that stayed in a column during the last step.
    pub fn kept(&self, column: usize) -> f64 {
        self.kept[column]
    }

    /// Visits the neighbours that gave a column water in the last step: their index and the volume (m3).
    pub fn each_inflow(&self, column: usize, mut visit: impl FnMut(usize, f64)) {
        let layout = &self.layout;
        let here = layout.padded_index(column);
        for (family, shift, is_tail) in PAIRS.into_iter().flatten() {
            let moved = self.pipes.moved[layout.pipe(layout.moved(here, shift), family)];
            let inflow = if is_tail { moved } else { -moved };
            if inflow > 0.0 {
                let [dx, dz] = OFFSETS[family].map(|offset| if is_tail { -offset } else { offset });
                visit(column.wrapping_add_signed(dz * layout.nx as isize + dx), inflow);
            }
        }
    }
}

/// What each column of a row can give of what its pipes ask for, 0..1.
#[inline(always)]
fn share_row(moved: &[f64], stride: usize, row: usize, depth: &[f64], area: f64, share: &mut [f64]) {
    let width = depth.len();
    let at = |(family, [dx, dz], _): (usize, [isize; 2], bool)| {
        pipes(moved, stride, row.wrapping_add_signed(dz), family, 0, dx, width)
    };
    let [[e, w], [s, n], [se, nw], [sw, ne]] = PAIRS.map(|pair| pair.map(at));
    for i in 0..width {
        let out = |head: f64, tail: f64| greater(head, 0.0) + greater(-tail, 0.0);
        let asked = (out(e[i], w[i]) + out(s[i], n[i])) + (out(se[i], nw[i]) + out(sw[i], ne[i]));
        let held = depth[i] * area * GIVES;
        share[i] = if asked > held { held / asked } else { 1.0 };
    }
}

/// Cuts the volumes and velocities of one row's pipes to the share of the column that gives.
fn scale_row(share: &[f64], layout: &Layout, row: usize, out: PipeRow) {
    let (stride, nx) = (layout.stride, layout.nx);
    for (family, [dx, dz]) in OFFSETS.into_iter().enumerate() {
        let place = family * stride + MARGIN;
        let (eta, moved) = (&mut out.eta[place..][..nx], &mut out.moved[place..][..nx]);
        let head = columns(share, stride, row, 0, 0, nx);
        let tail = columns(share, stride, row.wrapping_add_signed(dz), 0, dx, nx);
        for i in 0..nx {
            let share = if moved[i] > 0.0 { head[i] } else { tail[i] };
            eta[i] *= share;
            moved[i] *= share;
        }
    }
}

/// New depths of one row, and the volume that stayed in each column.
#[inline(always)]
fn gather_row(moved: &[f64], stride: usize, row: usize, area: f64, depth: &mut [f64], kept: &mut [f64]) {
    let width = depth.len();
    let at = |(family, [dx, dz], _): (usize, [isize; 2], bool)| {
        pipes(moved, stride, row.wrapping_add_signed(dz), family, 0, dx, width)
    };
    let [[e, w], [s, n], [se, nw], [sw, ne]] = PAIRS.map(|pair| pair.map(at));
    for i in 0..width {
        let out = |head: f64, tail: f64| greater(head, 0.0) + greater(-tail, 0.0);
        let given = (out(e[i], w[i]) + out(s[i], n[i])) + (out(se[i], nw[i]) + out(sw[i], ne[i]));
        let into = |head: f64, tail: f64| greater(-head, 0.0) + greater(tail, 0.0);
        let taken = (into(e[i], w[i]) + into(s[i], n[i])) + (into(se[i], nw[i]) + into(sw[i], ne[i]));
        kept[i] = greater(depth[i] * area - given, 0.0);
        let left = depth[i] + (taken - given) / area;
        // Less than any sum of water can tell from nothing, and before products of it underflow.
        depth[i] = if left < 1e-200 { 0.0 } else { left };
    }
}
