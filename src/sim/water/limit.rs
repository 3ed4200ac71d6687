//! Volume: what the pipes ask for, cut down to what each column holds, and moved; and what moves with it.
//!
//! Three passes, each over all columns, so that no order of columns or threads shows in the result.

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
}

impl Water {
    /// Volume (m3) that stayed in a column during the last step.
    pub fn kept(&self, column: usize) -> f64 {
        self.kept[column]
    }

    /// Visits the neighbours that gave a column water in the last step: their index and the volume (m3).
    #[inline(always)]
    pub fn each_inflow(&self, column: usize, mut visit: impl FnMut(usize, f64)) {
        let layout = &self.layout;
        let here = layout.padded_index(column);
        for &(family, shift, is_tail) in PAIRS.iter().flatten() {
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
