//! The innermost loops of a step: the flow in one row of pipes after another. What they solve is told in `step`.

use super::layout::{FAMILIES, MARGIN, OFFSETS, PipeRow, columns, pipes};
use super::rows::greater;
use super::step::{Rows, carried, driving_head, shed_height};
use crate::simd::{Kernel, Simd};

/// Columns that a kernel handles at a time: its intermediate rows stay in the first level of cache.
pub(super) const BLOCK: usize = 128;

/// What is known of a block on the way; made once for each row.
struct Scratch {
    per_volume: [f64; BLOCK],
    gain: [[f64; BLOCK]; FAMILIES],
    share: [[f64; BLOCK]; FAMILIES],
    poured: [f64; BLOCK],
    head: [f64; BLOCK],
    velocity: [f64; BLOCK],
}

impl Scratch {
    #[inline(always)]
    fn new() -> Self {
        let none = [0.0; BLOCK];
        let (gain, share) = ([none; FAMILIES], [none; FAMILIES]);
        Self { per_volume: none, gain, share, poured: none, head: none, velocity: none }
    }
}

/// Whether any of a block's columns, or those at the other ends of its pipes, holds water.
#[inline(always)]
fn is_wet(rows: &Rows, row: usize, x: usize, width: usize) -> bool {
    (row..row + 2).any(|row| {
        let top = columns(rows.top, rows.stride, row, x, -1, width + 2);
        let base = columns(rows.base, rows.stride, row, x, -1, width + 2);
        let mut wet = false;
        for i in 0..width + 2 {
            wet |= top[i] > base[i];
        }
        wet
    })
}

/// Makes new velocities of one row's pipes, and the volumes (m3) that they ask for.
pub(super) struct FlowRow<'a> {
    pub rows: &'a Rows<'a>,
    pub row: usize,
    pub out: PipeRow<'a>,
}

impl Kernel for FlowRow<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        flow_row(self.rows, self.row, self.out);
    }
}

#[inline(always)]
fn flow_row(rows: &Rows, row: usize, out: PipeRow) {
    let mut scratch = Scratch::new();
    for x in (0..rows.nx).step_by(BLOCK) {
        let width = BLOCK.min(rows.nx - x);
        let wet = is_wet(rows, row, x, width);
        for family in 0..FAMILIES {
            let place = family * rows.stride + MARGIN + x;
            let eta = &mut out.eta[place..][..width];
            let moved = &mut out.moved[place..][..width];
            if wet {
                flow_block(rows, row, x, family, eta, moved, &mut scratch);
            } else {
                eta.fill(0.0);
                moved.fill(0.0);
            }
            if wet && !rows.shedding.is_empty() {
                let section = &rows.layout.sections(row)[place..][..width];
                for i in 0..width {
                    if let Some(height) = shed_height(rows, row, x + i, family, eta[i]) {
                        moved[i] = eta[i] * (section[i] * rows.dt) * height;
                        if height == 0.0 {
                            eta[i] = 0.0;
                        }
                    }
                }
            }
        }
    }
}

#[inline(always)]
fn flow_block(
    rows: &Rows,
    row: usize,
    x: usize,
    family: usize,
    eta: &mut [f64],
    moved: &mut [f64],
    scratch: &mut Scratch,
) {
    let (stride, width, [dx, dz]) = (rows.stride, eta.len(), OFFSETS[family]);
    let tail = row.wrapping_add_signed(dz);
    let old = pipes(rows.eta, stride, row, family, x, 0, width);
    let (top_head, base_head) =
        (columns(rows.top, stride, row, x, 0, width), columns(rows.base, stride, row, x, 0, width));
    let (top_tail, base_tail) =
        (columns(rows.top, stride, tail, x, dx, width), columns(rows.base, stride, tail, x, dx, width));

    // One over the volume that a pipe lies in: the mean depth of its two columns.
    let per_volume = &mut scratch.per_volume[..width];
    let per_area = 1.0 / rows.area;
    for i in 0..width {
        let depths = (top_head[i] - base_head[i]) + (top_tail[i] - base_tail[i]);
        per_volume[i] = if depths > 0.0 { per_area / depths } else { 0.0 };
    }

    for from in 0..FAMILIES {
        let (gain, share) = (&mut scratch.gain[from][..width], &mut scratch.share[from][..width]);
        carry_block(rows, row, x, family, from, old, per_volume, gain, share);
    }

    let poured = &mut scratch.poured[..width];
    if !rows.given.is_empty() {
        // Still water that was poured in makes up a part of the pipe's.
        let (at_head, at_tail) =
            (columns(rows.given, stride, row, x, 0, width), columns(rows.given, stride, tail, x, dx, width));
        for i in 0..width {
            poured[i] = (at_head[i] + at_tail[i]) * (per_volume[i] * rows.area);
        }
    }

    let section = &rows.layout.sections(row)[family * stride + MARGIN + x..][..width];
    let (drive, keep, dt) = (rows.drive[family], rows.keep, rows.dt);
    let head = &mut scratch.head[..width];
    let length = rows.layout.length[family];
    for i in 0..width {
        head[i] = driving_head(top_head[i], top_tail[i], greater(base_head[i], base_tail[i]), length);
    }
    if !rows.pressure.is_empty() {
        let (at_head, at_tail) =
            (columns(rows.pressure, stride, row, x, 0, width), columns(rows.pressure, stride, tail, x, dx, width));
        for i in 0..width {
            head[i] += at_head[i] - at_tail[i];
        }
    }
    let velocity = &mut scratch.velocity[..width];
    let gain = scratch.gain.each_ref().map(|gain| &gain[..width]);
    let share = scratch.share.each_ref().map(|share| &share[..width]);
    for i in 0..width {
        // Axes and diagonals are summed apart, so that a mirrored map gives the mirrored bits.
        let gained = (gain[0][i] + gain[1][i]) + (gain[2][i] + gain[3][i]) - poured[i] * old[i];
        let shared = (share[0][i] + share[1][i]) + (share[2][i] + share[3][i]) + poured[i];
        // More inflow than the pipe holds: it takes on the velocity of what flows in.
        let carried = old[i] + gained / greater(shared, 1.0);
        velocity[i] = keep * carried + drive * head[i];
    }
    if !rows.drag.is_empty() {
        let head = row * stride + MARGIN + x;
        let tail = (tail * stride + MARGIN + x).wrapping_add_signed(dx);
        for i in 0..width {
            velocity[i] *= rows.slowed(velocity[i], head + i, tail + i);
        }
    }
    for i in 0..width {
        let sill = greater(base_head[i], base_tail[i]);
        let donor = if velocity[i] > 0.0 { top_head[i] } else { top_tail[i] };
        let height = greater(donor - sill, 0.0);
        eta[i] = if height > 0.0 { velocity[i] } else { 0.0 };
        moved[i] = eta[i] * (section[i] * dt) * height;
    }
}

/// What the flow through the pipes of family `from` carries into those of `family`: the velocity that it adds, and the part
/// of the pipe's water that it makes up.
#[inline(always)]
fn carry_block(
    rows: &Rows,
    row: usize,
    x: usize,
    family: usize,
    from: usize,
    old: &[f64],
    per_volume: &[f64],
    gain: &mut [f64],
    share: &mut [f64],
) {
    let (stride, width) = (rows.stride, old.len());
    let ([tail_x, tail_z], [dx, dz]) = (OFFSETS[family], OFFSETS[from]);
    let at = |field, family, x_shift: isize, z_shift: isize| {
        pipes(field, stride, row.wrapping_add_signed(z_shift), family, x, x_shift, width)
    };
    let (before, after) = (at(rows.eta, family, -dx, -dz), at(rows.eta, family, dx, dz));
    // Pipes of `from` that end and begin at this pipe's head, and at its tail.
    let (moved_in_head, moved_out_head) = (at(rows.moved, from, -dx, -dz), at(rows.moved, from, 0, 0));
    let (moved_in_tail, moved_out_tail) =
        (at(rows.moved, from, tail_x - dx, tail_z - dz), at(rows.moved, from, tail_x, tail_z));
    let (eta_in_head, eta_out_head) = (at(rows.eta, from, -dx, -dz), at(rows.eta, from, 0, 0));
    let (eta_in_tail, eta_out_tail) =
        (at(rows.eta, from, tail_x - dx, tail_z - dz), at(rows.eta, from, tail_x, tail_z));
    let section = |x_shift: isize, z_shift: isize| {
        let sections = rows.layout.sections(row.wrapping_add_signed(z_shift));
        &sections[(from * stride + MARGIN + x).wrapping_add_signed(x_shift)..][..width]
    };
    let (section_in_head, section_out_head) = (section(-dx, -dz), section(0, 0));
    let (section_in_tail, section_out_tail) = (section(tail_x - dx, tail_z - dz), section(tail_x, tail_z));
    let half_per_area = 0.5 * rows.last_step / rows.area;
    let mut shut = 0u64;
    for i in 0..width {
        let speed = old[i].abs();
        let slow = (moved_in_head[i] + moved_in_tail[i]) * per_volume[i];
        let fast = (eta_in_head[i] * section_in_head[i] + eta_in_tail[i] * section_in_tail[i]) * half_per_area;
        let inflow = greater(if speed > before[i].abs() { fast } else { slow }, 0.0);
        let inflow = if before[i] == 0.0 { 0.0 } else { inflow };
        let slow = (moved_out_head[i] + moved_out_tail[i]) * per_volume[i];
        let fast = (eta_out_head[i] * section_out_head[i] + eta_out_tail[i] * section_out_tail[i]) * half_per_area;
        let backflow = greater(-if speed > after[i].abs() { fast } else { slow }, 0.0);
        let backflow = if after[i] == 0.0 { 0.0 } else { backflow };
        gain[i] = inflow * (before[i] - old[i]) + backflow * (after[i] - old[i]);
        share[i] = inflow + backflow;
        shut |= u64::from(before[i] == 0.0) | u64::from(after[i] == 0.0);
    }
    if shut == 0 {
        return;
    }

    // A pipe that stands exactly still is shut, by a wall or a dry neighbour, and says nothing of what flows in beside it.
    // That has the velocity of the columns that it comes from: along a wall the stream's, out of a side channel its own.
    let cosine = rows.layout.direction[family];
    let velocity = |shift_x: isize, shift_z: isize| {
        let row = row.wrapping_add_signed(shift_z);
        let [along_x, along_z] = rows.velocity.map(|field| columns(field, stride, row, x, shift_x, width));
        move |i: usize| along_x[i] * cosine[0] + along_z[i] * cosine[1]
    };
    let (head_before, tail_before) = (velocity(-dx, -dz), velocity(tail_x - dx, tail_z - dz));
    let (head_after, tail_after) = (velocity(dx, dz), velocity(tail_x + dx, tail_z + dz));
    for i in 0..width {
        let (mut gained, mut shared) = ([0.0; 2], [0.0; 2]);
        let sides = [
            (
                before[i],
                1.0,
                [moved_in_head[i], moved_in_tail[i]],
                [eta_in_head[i] * section_in_head[i], eta_in_tail[i] * section_in_tail[i]],
            ),
            (
                after[i],
                -1.0,
                [moved_out_head[i], moved_out_tail[i]],
                [eta_out_head[i] * section_out_head[i], eta_out_tail[i] * section_out_tail[i]],
            ),
        ];
        let columns = [[head_before(i), tail_before(i)], [head_after(i), tail_after(i)]];
        for (side, (like, sign, moved, sweep)) in sides.into_iter().enumerate() {
            if like == 0.0 {
                let velocity = carried(moved.map(|moved| sign * moved), columns[side]);
                let slow = (moved[0] + moved[1]) * per_volume[i];
                let fast = (sweep[0] + sweep[1]) * half_per_area;
                shared[side] = greater(sign * if old[i].abs() > velocity.abs() { fast } else { slow }, 0.0);
                gained[side] = shared[side] * (velocity - old[i]);
            }
        }
        gain[i] += gained[0] + gained[1];
        share[i] += shared[0] + shared[1];
    }
}
