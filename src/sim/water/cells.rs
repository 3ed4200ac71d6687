//! Columns divided in cells: slabs of one height through the whole map, each with flow of its own (Mould and Yang 1997).
//!
//! A pipe joins cells that overlap. Where a cell stands above its neighbour's water its pipe leads to the air, and is
//! pushed by what lies over the middle of the exposed part: the top of a step falls over it while its foot stands still.
//! Water moves up and down within a column at once, since a column is always full from its bed to its top; only the flow
//! along the ground differs from cell to cell. A cell that fills anew moves like the one below it.
//!
//! Cells are counted from the slab that holds the higher of a pipe's two beds, so that memory grows with the water's depth
//! and not with the landform's relief. The flow of all cells together is what the rest of `water` sees.

use super::layout::{FAMILIES, Layout, MARGIN, OFFSETS, PipeRow, Pipes};
use super::rows::greater;
use super::step::{Rows, carried, driving_head, is_shedding};
use rayon::prelude::*;

/// Cells of a pipe at most; the topmost holds all that stands above it. 64 of them take 16 KiB for each column.
const MOST_CELLS: usize = 64;

/// The flow of every cell: one pipe row of each cell of a row of columns after another.
#[derive(Clone, Debug)]
pub(super) struct Cells {
    height: f64,
    count: usize,
    pub eta: Vec<f64>,
    pub moved: Vec<f64>,
    next_eta: Vec<f64>,
    next_moved: Vec<f64>,
}

/// One pipe: what its cells have in common.
struct Pipe {
    row: usize,
    x: usize,
    family: usize,
    head: usize,
    tail: usize,
    /// Number of the slab that holds the sill, the higher of the two beds (m).
    first: f64,
    sill: f64,
}

impl Cells {
    pub(super) fn new(height: f64) -> Self {
        Self { height, count: 0, eta: vec![], moved: vec![], next_eta: vec![], next_moved: vec![] }
    }

    fn row_length(&self, layout: &Layout) -> usize {
        self.count * FAMILIES * layout.stride
    }

    /// Makes room for water of this depth (m); cells that were there keep their flow.
    pub(super) fn make_room(&mut self, layout: &Layout, deepest: f64) {
        // Water from a sill upwards lies in one slab more than its depth fills.
        let needed = ((deepest / self.height).floor() as usize).saturating_add(2).min(MOST_CELLS);
        if needed <= self.count {
            return;
        }
        let before = self.row_length(layout);
        self.count = needed;
        let row = self.row_length(layout);
        let grown = |old: &[f64]| {
            let mut field = vec![0.0; row * layout.rows];
            if before > 0 {
                for (to, from) in field.chunks_exact_mut(row).zip(old.chunks_exact(before)) {
                    to[..before].copy_from_slice(from);
                }
            }
            field
        };
        (self.eta, self.moved) = (grown(&self.eta), grown(&self.moved));
        (self.next_eta, self.next_moved) = (self.eta.clone(), self.moved.clone());
    }

    /// Puts back the flow of every cell, one field after the other; false if they make no whole cells.
    pub(super) fn restore(&mut self, layout: &Layout, fields: &[f64]) -> bool {
        let cell = 2 * FAMILIES * layout.stride * layout.rows;
        if !fields.len().is_multiple_of(cell) || fields.len() / cell > MOST_CELLS {
            return false;
        }
        self.count = fields.len() / cell;
        let (eta, moved) = fields.split_at(fields.len() / 2);
        (self.eta, self.moved) = (eta.to_vec(), moved.to_vec());
        (self.next_eta, self.next_moved) = (eta.to_vec(), moved.to_vec());
        true
    }

    fn place(&self, stride: usize, row: usize, cell: usize, family: usize, x: usize) -> usize {
        ((row * self.count + cell) * FAMILIES + family) * stride + MARGIN + x
    }

    fn pipe(&self, rows: &Rows, row: usize, x: usize, family: usize) -> Pipe {
        let [dx, dz] = OFFSETS[family];
        let head = row * rows.stride + MARGIN + x;
        let tail = head.wrapping_add_signed(dz * rows.stride as isize + dx);
        let sill = greater(rows.base[head], rows.base[tail]);
        Pipe { row, x, family, head, tail, first: (sill / self.height).floor(), sill }
    }

    /// One of the fields in the cell of another pipe at the same height as `cell` of `pipe`; 0 where it has none.
    fn beside(&self, rows: &Rows, field: &[f64], pipe: &Pipe, cell: usize, family: usize, shift: [isize; 2]) -> f64 {
        let (x, row) = (pipe.x.wrapping_add_signed(shift[0]), pipe.row.wrapping_add_signed(shift[1]));
        let [dx, dz] = OFFSETS[family];
        let head = (row * rows.stride + MARGIN).wrapping_add(x);
        let tail = head.wrapping_add_signed(dz * rows.stride as isize + dx);
        let first = (greater(rows.base[head], rows.base[tail]) / self.height).floor();
        let cell = cell as f64 + pipe.first - first;
        if cell < 0.0 || cell >= self.count as f64 {
            return 0.0;
        }
        field[((row * self.count + cell as usize) * FAMILIES + family) * rows.stride + (head - row * rows.stride)]
    }

    /// The flow of all cells of one row of columns, and their sum.
    pub(super) fn flow_row(&self, rows: &Rows, row: usize, eta: &mut [f64], moved: &mut [f64], out: PipeRow) {
        for family in 0..FAMILIES {
            for x in 0..rows.nx {
                let total = family * rows.stride + MARGIN + x;
                let pipe = self.pipe(rows, row, x, family);
                let (mut fastest, mut volume, mut below) = (0.0f64, 0.0, 0.0);
                for cell in 0..self.count {
                    let place = self.place(rows.stride, 0, cell, family, x);
                    let old = self.eta[self.place(rows.stride, row, cell, family, x)];
                    let old = if old == 0.0 { below } else { old };
                    below = old;
                    let (velocity, height) = self.flow(rows, &pipe, cell, old);
                    let section = rows.layout.sections(row)[total];
                    eta[place] = velocity;
                    moved[place] = velocity * (section * rows.dt) * height;
                    volume += moved[place];
                    fastest = if velocity.abs() > fastest.abs() { velocity } else { fastest };
                }
                out.eta[total] = fastest;
                out.moved[total] = volume;
            }
        }
    }

    /// New velocity (m/s) of one cell of a pipe, and the height (m) over which it is open.
    fn flow(&self, rows: &Rows, pipe: &Pipe, cell: usize, old: f64) -> (f64, f64) {
        let (top_head, top_tail) = (rows.top[pipe.head], rows.top[pipe.tail]);
        let slab = (pipe.first + cell as f64) * self.height;
        let floor = greater(slab, pipe.sill);
        let ceiling = if cell + 1 == self.count { f64::INFINITY } else { slab + self.height };
        let (level_head, level_tail) = (greater(top_head, pipe.sill), greater(top_tail, pipe.sill));
        let (high, low) = (level_head.max(level_tail), level_head.min(level_tail));
        if high <= floor {
            return (0.0, 0.0);
        }
        // Against water the whole difference pushes, against air what stands over the middle.
        let against_water = (low.min(ceiling) - floor).max(0.0);
        let (from, to) = (low.max(floor), high.min(ceiling));
        let against_air = (to - from).max(0.0);
        let exposed = (high - 0.5 * (from + to)) * if level_head > level_tail { 1.0 } else { -1.0 };
        // What the ground adds where it falls away below the sill pushes all cells alike.
        let length = rows.layout.length[pipe.family];
        let fall = driving_head(top_head, top_tail, pipe.sill, length) - (level_head - level_tail);
        let push =
            (level_head - level_tail) * against_water + if against_air > 0.0 { exposed * against_air } else { 0.0 };
        let mut head = fall + push / (against_water + against_air);
        if !rows.pressure.is_empty() {
            head += rows.pressure[pipe.head] - rows.pressure[pipe.tail];
        }

        let carried = self.carried(rows, pipe, cell, old, slab, ceiling);
        let mut velocity = rows.keep * carried + rows.drive[pipe.family] * head;
        if !rows.drag.is_empty() {
            velocity *= rows.slowed(velocity, pipe.head, pipe.tail);
        }
        let mut donor = if velocity > 0.0 { top_head } else { top_tail };
        if is_shedding(rows, pipe.row, pipe.x, pipe.family, velocity) {
            donor = top_head.min(top_tail);
        }
        let height = (donor.min(ceiling) - floor).max(0.0);
        (if height > 0.0 { velocity } else { 0.0 }, height)
    }

    /// What the flow in this slab makes of a cell's velocity: as in `step`, with the cell's share of both columns as volume.
    fn carried(&self, rows: &Rows, pipe: &Pipe, cell: usize, old: f64, slab: f64, ceiling: f64) -> f64 {
        let filled = |column: usize| (rows.top[column].min(ceiling) - rows.base[column].max(slab)).max(0.0);
        let depths = filled(pipe.head) + filled(pipe.tail);
        let per_volume = if depths > 0.0 { 1.0 / (rows.area * depths) } else { 0.0 };
        let half_per_area = 0.5 / rows.area;
        let [tail_x, tail_z] = OFFSETS[pipe.family];
        let cosine = rows.layout.direction[pipe.family];
        let column = |shift: [isize; 2], end: usize| {
            let place = end.wrapping_add_signed(shift[1] * rows.stride as isize + shift[0]);
            rows.velocity[0][place] * cosine[0] + rows.velocity[1][place] * cosine[1]
        };
        let (mut gain, mut share) = ([0.0; 2], [0.0; 2]);
        // Still water that was poured in is spread over all cells.
        let whole = |column: usize| rows.top[column] - rows.base[column];
        let whole = whole(pipe.head) + whole(pipe.tail);
        let still = match rows.given {
            given if !given.is_empty() && whole > 0.0 => (given[pipe.head] + given[pipe.tail]) / whole,
            _ => 0.0,
        };
        for from in 0..FAMILIES {
            let [dx, dz] = OFFSETS[from];
            let mut sides = [[0.0; 2]; 2];
            for (side, (sign, shift)) in sides.iter_mut().zip([(1.0, [-dx, -dz]), (-1.0, [dx, dz])]) {
                // The pipes of `from` between this pipe's ends and their neighbours on this side belong to the lesser.
                let owner = if sign > 0.0 { shift } else { [0, 0] };
                let ends = [owner, [owner[0] + tail_x, owner[1] + tail_z]];
                let moved = ends.map(|end| sign * self.beside(rows, &self.moved, pipe, cell, from, end));
                if moved[0] + moved[1] == 0.0 {
                    continue;
                }
                let sweep = ends.map(|end| {
                    let row = pipe.row.wrapping_add_signed(end[1]);
                    let place = (from * rows.stride + MARGIN + pipe.x).wrapping_add_signed(end[0]);
                    let section = rows.layout.sections(row)[place] * rows.last_step;
                    sign * self.beside(rows, &self.eta, pipe, cell, from, end) * section
                });
                let mut velocity = self.beside(rows, &self.eta, pipe, cell, pipe.family, shift);
                if velocity == 0.0 {
                    velocity = carried(moved, [column(shift, pipe.head), column(shift, pipe.tail)]);
                }
                let (slow, fast) = ((moved[0] + moved[1]) * per_volume, (sweep[0] + sweep[1]) * half_per_area);
                let inflow = greater(if old.abs() > velocity.abs() { fast } else { slow }, 0.0);
                *side = [inflow * (velocity - old), inflow];
            }
            gain[from / 2] += sides[0][0] + sides[1][0];
            share[from / 2] += sides[0][1] + sides[1][1];
        }
        let (gain, share) = ((gain[0] + gain[1]) - still * old, (share[0] + share[1]) + still);
        old + gain / greater(share, 1.0)
    }

    /// One step of every cell into `out`, the sum of each pipe.
    pub(super) fn step(&self, rows: &Rows, next: [&mut [f64]; 2], out: &mut Pipes, parallel: bool) {
        let (layout, chunk) = (rows.layout, self.row_length(rows.layout));
        let total = FAMILIES * layout.stride;
        let [eta, moved] = next.map(|field| &mut field[chunk..chunk * (layout.nz + 1)]);
        let inner = total..total * (layout.nz + 1);
        let (all_eta, all_moved) = (&mut out.eta[inner.clone()], &mut out.moved[inner]);
        if parallel {
            let cells = eta.par_chunks_mut(chunk).zip(moved.par_chunks_mut(chunk));
            let pipes = all_eta.par_chunks_mut(total).zip(all_moved.par_chunks_mut(total));
            cells.zip(pipes).enumerate().for_each(|(z, ((cell_eta, cell_moved), (eta, moved)))| {
                self.flow_row(rows, z + 1, cell_eta, cell_moved, PipeRow { eta, moved });
            });
        } else {
            let cells = eta.chunks_mut(chunk).zip(moved.chunks_mut(chunk));
            let pipes = all_eta.chunks_mut(total).zip(all_moved.chunks_mut(total));
            cells.zip(pipes).enumerate().for_each(|(z, ((cell_eta, cell_moved), (eta, moved)))| {
                self.flow_row(rows, z + 1, cell_eta, cell_moved, PipeRow { eta, moved });
            });
        }
    }

    /// The fields that the next step is made in.
    pub(super) fn take_next(&mut self) -> [Vec<f64>; 2] {
        [std::mem::take(&mut self.next_eta), std::mem::take(&mut self.next_moved)]
    }

    /// Takes those fields as the flow, and what was the flow as the next step's.
    pub(super) fn put_next(&mut self, [eta, moved]: [Vec<f64>; 2]) {
        self.next_eta = std::mem::replace(&mut self.eta, eta);
        self.next_moved = std::mem::replace(&mut self.moved, moved);
    }

    /// Cuts the flow of every cell to the share of the column that gives on the whole: `moved` is the sum of the cells.
    pub(super) fn scale(&mut self, layout: &Layout, moved: &[f64], share: &[f64]) {
        let chunk = self.row_length(layout);
        let rows = self.eta.chunks_exact_mut(chunk).zip(self.moved.chunks_exact_mut(chunk)).enumerate();
        for (row, (eta, cell_moved)) in rows.take(layout.nz + 1).skip(1) {
            if (row..row + 2).all(|row| share[row * layout.stride..][..layout.stride].iter().all(|&share| share >= 1.0))
            {
                continue;
            }
            for (family, offset) in OFFSETS.into_iter().enumerate() {
                for x in 0..layout.nx {
                    let head = row * layout.stride + MARGIN + x;
                    let gives = if moved[layout.pipe(head, family)] > 0.0 { head } else { layout.moved(head, offset) };
                    for cell in 0..self.count {
                        let place = (cell * FAMILIES + family) * layout.stride + MARGIN + x;
                        eta[place] *= share[gives];
                        cell_moved[place] *= share[gives];
                    }
                }
            }
        }
    }
}
