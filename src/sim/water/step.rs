//! The flow in the pipes: what a step makes of their velocities, and the volume that they then ask for.
//!
//! A pipe's velocity obeys d eta / dt = (Q_head - Q_tail) / (rho l) - friction, Q = rho g H + rho v^2 / 2 + E (the report,
//! appendix A). What its columns can give of the volume asked for is the business of `limit`.
//!
//! # Dynamic pressure
//!
//! The difference of rho v^2 / 2 alone is right for flow without rotation only: the whole acceleration of moving water is
//! (v . grad) v = grad(v^2 / 2) + curl v x v (Lamb), and without the second term a stream is pushed sideways out of its
//! own bed, into the slow water beside it. So a pipe's velocity is carried by the flow, upwind, between like pipes:
//!
//! l h A d eta_p / dt = sum over the 8 neighbours of inflow_b (eta_b - eta_p),
//!
//! where the inflow from the like pipe at neighbour b is the mean of the flows into the pipe's two ends. Where the flow
//! slows down, inflow is measured as volume over the mean depth, which conserves momentum, so that bores run at the right
//! speed; where it speeds up, as the velocity itself, which along a stream is exactly the report's difference of
//! rho v^2 / 2 (Stelling and Duinmeijer, A staggered conservative scheme for every Froude number in rapidly varied shallow
//! water flows, 2003; for one axis: the sum over like pipes of eight neighbours is ours). Each new velocity is a mean of
//! old ones plus what pressure adds: carrying cannot make any pipe faster than the fastest was.

use super::layout::{DENSITY, FAMILIES, Layout, MARGIN, OFFSETS, PipeRow, columns, pipes};
use super::{Forcing, Water};
use crate::simd::{self, Kernel, Simd, SimdLevel};
use rayon::prelude::*;

/// Columns that a kernel handles at a time: its intermediate rows stay in the first level of cache.
const BLOCK: usize = 128;

/// Fewer columns than this are not worth a second thread.
const PARALLEL_FROM: usize = 4096;

/// The greater of two numbers. Unlike `f64::max` it does not look for what is not a number, which costs half the speed.
#[inline(always)]
pub(super) fn greater(a: f64, b: f64) -> f64 {
    if a > b { a } else { b }
}

/// Whether a map of so many columns is worth more than one thread, and has it.
pub(super) fn is_parallel(count: usize) -> bool {
    count >= PARALLEL_FROM && rayon::current_num_threads() > 1
}

/// The column of a row that allows the shortest step.
#[derive(Clone, Copy, Default)]
pub(super) struct Fastest {
    /// Columns that a wave crosses in a second.
    pub rate: f64,
    pub column: usize,
    pub speed: f64,
}

/// The fastest column of row `z`; rate 0 where all are dry.
pub(super) fn fastest(
    eta: &[f64],
    layout: &Layout,
    z: usize,
    depth: &[f64],
    gravity: f64,
    [dx, dz]: [f64; 2],
) -> Fastest {
    let stride = layout.stride;
    let [cos_x, cos_z] = layout.direction[2];
    let mut worst = Fastest::default();
    for x in (0..layout.nx).step_by(BLOCK) {
        let width = BLOCK.min(layout.nx - x);
        let depth = &depth[z * layout.nx + x..][..width];
        let at = |family, shift, row| pipes(eta, stride, row, family, x, shift, width);
        let (e, w, s, n) = (at(0, 0, z + 1), at(0, -1, z + 1), at(1, 0, z + 1), at(1, 0, z));
        let (se, nw, sw, ne) = (at(2, 0, z + 1), at(2, -1, z), at(3, 0, z + 1), at(3, 1, z));
        let mut rates = [0.0; BLOCK];
        let mut greatest = 0.0f64;
        for i in 0..width {
            let diagonal = greater(greater(se[i].abs(), nw[i].abs()), greater(sw[i].abs(), ne[i].abs()));
            let along_x = greater(greater(e[i].abs(), w[i].abs()), diagonal * cos_x);
            let along_z = greater(greater(s[i].abs(), n[i].abs()), diagonal * cos_z);
            let wave = (gravity * depth[i]).sqrt();
            let rate = (along_x + wave) / dx + (along_z + wave) / dz;
            rates[i] = if depth[i] > 0.0 { rate } else { 0.0 };
            greatest = greater(rates[i], greatest);
        }
        if greatest > worst.rate {
            let i = rates[..width].iter().position(|&rate| rate == greatest).unwrap_or(0);
            let around = [e[i], w[i], s[i], n[i], se[i], nw[i], sw[i], ne[i]];
            let flow = around.into_iter().fold(0.0f64, |fastest, velocity| fastest.max(velocity.abs()));
            let column = z * layout.nx + x + i;
            worst = Fastest { rate: greatest, column, speed: flow + (gravity * depth[i]).sqrt() };
        }
    }
    worst
}

/// What all rows of a step share.
pub(super) struct Rows<'a> {
    pub(super) stride: usize,
    pub(super) nx: usize,
    pub(super) top: &'a [f64],
    pub(super) base: &'a [f64],
    /// Empty when nothing presses.
    pub(super) pressure: &'a [f64],
    pub(super) shedding: &'a [u8],
    /// Depth of still water poured into each column; empty for none.
    pub(super) given: &'a [f64],
    /// Velocity, volume moved, and volume moved for each metre of height, as the last step left them.
    pub(super) eta: &'a [f64],
    pub(super) moved: &'a [f64],
    pub(super) sweep: &'a [f64],
    pub(super) layout: &'a Layout,
    /// Acceleration for each metre of head, times the time it acts.
    pub(super) drive: [f64; FAMILIES],
    /// Velocity of the columns.
    pub(super) velocity: [&'a [f64]; 2],
    /// Empty where the bed is smooth.
    pub(super) drag: &'a [f64],
    pub(super) area: f64,
    pub(super) dt: f64,
    pub(super) last_step: f64,
    pub(super) keep: f64,
}

impl Water {
    /// One step of `dt` seconds (above 0).
    ///
    /// Any `dt` is safe: depths never fall below 0 and volume is conserved to rounding, since a column whose pipes ask for
    /// more than it holds gives all of them the same share, and slows them to what they got. Beyond
    /// [`Self::largest_step`] the flow is no longer true.
    ///
    /// Panics on a `dt` that is not finite and above 0, on pressures that are not finite, and on forcing of another length.
    pub fn step(&mut self, dt: f64, forcing: &Forcing) {
        assert!(dt > 0.0 && dt.is_finite(), "a step of {dt} s");
        let count = self.grid.count();
        for length in [forcing.pressure.len(), forcing.shedding.len()] {
            assert!(length == 0 || length == count, "forcing of {length} columns for a map of {count}");
        }
        self.press(forcing.pressure);
        let parallel = is_parallel(count);
        self.refresh_columns(parallel);
        let mut next_cells = self.prepare_cells();
        let gravity = self.settings.gravity;
        let (keep, time) = friction(self.settings.friction, self.settings.reference_step, dt);
        let layout = &self.layout;
        let (before, level) = (&self.pipes, SimdLevel::detect());
        let rows = Rows {
            stride: layout.stride,
            nx: layout.nx,
            top: &self.top,
            base: &self.wall,
            pressure: if forcing.pressure.is_empty() { &[] } else { &self.pressure },
            shedding: forcing.shedding,
            given: if self.is_given { &self.given } else { &[] },
            eta: &before.eta,
            moved: &before.moved,
            sweep: &before.sweep,
            layout,
            drive: layout.length.map(|length| gravity * time / length),
            drag: &self.drag,
            velocity: [&self.velocity[0], &self.velocity[1]],
            area: layout.area,
            dt,
            last_step: self.last_step,
            keep,
        };
        match (&self.cells, &mut next_cells) {
            (Some(cells), Some([eta, moved])) => cells.step(&rows, [eta, moved], &mut self.next, parallel),
            _ => self.next.each_row(layout, parallel, |row, out| {
                simd::dispatch(level, FlowRow { rows: &rows, row, out });
            }),
        }
        std::mem::swap(&mut self.pipes, &mut self.next);
        if let (Some(cells), Some(made)) = (&mut self.cells, next_cells) {
            cells.put_next(made);
        }
        if std::mem::take(&mut self.is_given) {
            self.given.fill(0.0);
        }
        self.last_step = dt;
        self.move_volume(dt, parallel);
    }

    /// Room for every cell of the water, and the fields that their next flow is made in.
    fn prepare_cells(&mut self) -> Option<[Vec<f64>; 2]> {
        let cells = self.cells.as_mut()?;
        cells.make_room(&self.layout, self.depth.iter().fold(0.0, |deepest, &depth| greater(depth, deepest)));
        Some(cells.take_next())
    }

    /// External pressure as metres of water.
    fn press(&mut self, pressure: &[f64]) {
        assert!(pressure.iter().all(|pressure| pressure.is_finite()), "external pressures are finite");
        let metre = DENSITY * self.settings.gravity;
        for (z, row) in pressure.chunks_exact(self.layout.nx).enumerate() {
            let place = self.layout.padded(0, z);
            for (to, from) in self.pressure[place..].iter_mut().zip(row) {
                *to = from / metre;
            }
        }
    }
}

/// Share of a pipe's velocity that is left after `dt`, and the time (s) that a steady push then counts for.
///
/// The report multiplies by `friction` each step of `reference`. That is the decay exp(-rate t); solved exactly over any
/// `dt`, a push a adds a (1 - exp(-rate dt)) / rate, so that terminal speeds do not depend on the step either.
fn friction(friction: f64, reference: f64, dt: f64) -> (f64, f64) {
    let rate = -friction.ln() / reference;
    let exponent = rate * dt;
    if exponent == 0.0 {
        (1.0, dt)
    } else if exponent.is_finite() {
        ((-exponent).exp(), -(-exponent).exp_m1() / rate)
    } else {
        (0.0, 0.0)
    }
}

/// Calls `work` for each row of `field`, in parallel where that pays: every row has its own output, so the bits do not
/// depend on who makes them.
pub(super) fn each_row<T: Send>(
    field: &mut [T],
    chunk: usize,
    parallel: bool,
    work: impl Fn(usize, &mut [T]) + Sync + Send,
) {
    if parallel {
        field.par_chunks_mut(chunk).enumerate().for_each(|(z, row)| work(z, row));
    } else {
        field.chunks_mut(chunk).enumerate().for_each(|(z, row)| work(z, row));
    }
}

/// The same for two fields with equal rows.
pub(super) fn each_row_of_two<T: Send>(
    first: &mut [T],
    second: &mut [T],
    chunk: usize,
    parallel: bool,
    work: impl Fn(usize, &mut [T], &mut [T]) + Sync + Send,
) {
    if parallel {
        let rows = first.par_chunks_mut(chunk).zip(second.par_chunks_mut(chunk));
        rows.enumerate().for_each(|(z, (first, second))| work(z, first, second));
    } else {
        let rows = first.chunks_mut(chunk).zip(second.chunks_mut(chunk));
        rows.enumerate().for_each(|(z, (first, second))| work(z, first, second));
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

/// Bits of `Forcing::shedding` that close a family's pipe at its owner and at its other end.
const CLOSED_BY: [[u8; 2]; FAMILIES] = [[1, 2], [4, 8], [1 | 4, 2 | 8], [2 | 4, 1 | 8]];

/// Whether the column that gives sheds spray over a face of this pipe.
pub(super) fn is_shedding(rows: &Rows, row: usize, x: usize, family: usize, velocity: f64) -> bool {
    let (at_head, [dx, dz]) = (velocity > 0.0, OFFSETS[family]);
    let donor_x = if at_head { x } else { x.wrapping_add_signed(dx) };
    let donor_z = if at_head { row - 1 } else { row.wrapping_add_signed(dz) - 1 };
    // Outside the map there is no water.
    let mask = if donor_x < rows.nx { rows.shedding.get(donor_z * rows.nx + donor_x) } else { None };
    mask.is_some_and(|mask| mask & CLOSED_BY[family][usize::from(!at_head)] != 0)
}

/// Height (m) over which a pipe is open if its donor sheds spray over that face: its overlap with the receiver's water.
fn shed_height(rows: &Rows, row: usize, x: usize, family: usize, velocity: f64) -> Option<f64> {
    if !is_shedding(rows, row, x, family, velocity) {
        return None;
    }
    let [dx, dz] = OFFSETS[family];
    let head = row * rows.stride + MARGIN + x;
    let tail = head.wrapping_add_signed(dz * rows.stride as isize + dx);
    Some((rows.top[head].min(rows.top[tail]) - rows.base[head].max(rows.base[tail])).max(0.0))
}

/// Head (m) that drives water through a pipe of this length, from the tops at both ends and the sill between them.
///
/// Tops count down to the sill only: a dry neighbour that stands higher pulls nothing. What lies lower is a fall f off the
/// sill. Down a slope as steep as S = f / length the ground pushes water forward with g S / (1 + S^2): all of g S where it
/// is gentle, so that thin water runs down a hillside as fast as deep, and nothing at a cliff, where water falls but is not
/// pushed away from the rock, however deep the pool below lies.
#[inline(always)]
pub(super) fn driving_head(head: f64, tail: f64, sill: f64, length: f64) -> f64 {
    let level = greater(head, sill) - greater(tail, sill);
    let fall = greater(sill - tail, 0.0) - greater(sill - head, 0.0);
    level + fall * (length * length) / (length * length + fall * fall)
}

/// Mean velocity of what flows in from two columns, by the volumes that flow in (where negative, none does).
#[inline(always)]
pub(super) fn carried(moved: [f64; 2], velocity: [f64; 2]) -> f64 {
    let [head, tail] = [greater(moved[0], 0.0), greater(moved[1], 0.0)];
    if head + tail > 0.0 { (velocity[0] * head + velocity[1] * tail) / (head + tail) } else { 0.0 }
}

impl Rows<'_> {
    /// Share of a velocity that the bed's drag leaves: v' = v - dt drag v'^2, solved for v', so that no step is too long.
    /// Across the stream the speed of the column that gives still counts.
    #[inline(always)]
    pub(super) fn slowed(&self, velocity: f64, head: usize, tail: usize) -> f64 {
        let donor = if velocity > 0.0 { head } else { tail };
        let (along_x, along_z) = (self.velocity[0][donor], self.velocity[1][donor]);
        let speed = greater(velocity.abs(), (along_x * along_x + along_z * along_z).sqrt());
        2.0 / (1.0 + (1.0 + 4.0 * self.dt * self.drag[donor] * speed).sqrt())
    }
}

/// New velocities of one row's pipes, and the volumes (m3) that they ask for.
struct FlowRow<'a> {
    rows: &'a Rows<'a>,
    row: usize,
    out: PipeRow<'a>,
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
    for x in (0..rows.nx).step_by(BLOCK) {
        let width = BLOCK.min(rows.nx - x);
        let wet = is_wet(rows, row, x, width);
        for family in 0..FAMILIES {
            let place = family * rows.stride + MARGIN + x;
            let eta = &mut out.eta[place..][..width];
            let moved = &mut out.moved[place..][..width];
            let sweep = &mut out.sweep[place..][..width];
            if wet {
                flow_block(rows, row, x, family, eta, moved, sweep);
            } else {
                eta.fill(0.0);
                moved.fill(0.0);
                sweep.fill(0.0);
            }
            if wet && !rows.shedding.is_empty() {
                for i in 0..width {
                    if let Some(height) = shed_height(rows, row, x + i, family, eta[i]) {
                        moved[i] = sweep[i] * height;
                        if height == 0.0 {
                            (eta[i], sweep[i]) = (0.0, 0.0);
                        }
                    }
                }
            }
        }
    }
}

#[inline(always)]
fn flow_block(rows: &Rows, row: usize, x: usize, family: usize, eta: &mut [f64], moved: &mut [f64], sweep: &mut [f64]) {
    let (stride, width, [dx, dz]) = (rows.stride, eta.len(), OFFSETS[family]);
    let tail = row.wrapping_add_signed(dz);
    let old = pipes(rows.eta, stride, row, family, x, 0, width);
    let (top_head, base_head) =
        (columns(rows.top, stride, row, x, 0, width), columns(rows.base, stride, row, x, 0, width));
    let (top_tail, base_tail) =
        (columns(rows.top, stride, tail, x, dx, width), columns(rows.base, stride, tail, x, dx, width));

    // One over the volume that a pipe lies in: the mean depth of its two columns.
    let mut per_volume = [0.0; BLOCK];
    let per_volume = &mut per_volume[..width];
    let per_area = 1.0 / rows.area;
    for i in 0..width {
        let depths = (top_head[i] - base_head[i]) + (top_tail[i] - base_tail[i]);
        per_volume[i] = if depths > 0.0 { per_area / depths } else { 0.0 };
    }

    let (mut gain, mut share) = ([[0.0; BLOCK]; FAMILIES], [[0.0; BLOCK]; FAMILIES]);
    for from in 0..FAMILIES {
        let (gain, share) = (&mut gain[from][..width], &mut share[from][..width]);
        carry_block(rows, row, x, family, from, old, per_volume, gain, share);
    }

    let mut poured = [0.0; BLOCK];
    let poured = &mut poured[..width];
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
    let mut head = [0.0; BLOCK];
    let head = &mut head[..width];
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
    let mut velocity = [0.0; BLOCK];
    let velocity = &mut velocity[..width];
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
        sweep[i] = eta[i] * (section[i] * dt);
        moved[i] = sweep[i] * height;
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
    let (sweep_in_head, sweep_out_head) = (at(rows.sweep, from, -dx, -dz), at(rows.sweep, from, 0, 0));
    let (sweep_in_tail, sweep_out_tail) =
        (at(rows.sweep, from, tail_x - dx, tail_z - dz), at(rows.sweep, from, tail_x, tail_z));
    let half_per_area = 0.5 / rows.area;
    let mut shut = 0u64;
    for i in 0..width {
        let speed = old[i].abs();
        let slow = (moved_in_head[i] + moved_in_tail[i]) * per_volume[i];
        let fast = (sweep_in_head[i] + sweep_in_tail[i]) * half_per_area;
        let inflow = greater(if speed > before[i].abs() { fast } else { slow }, 0.0);
        let inflow = if before[i] == 0.0 { 0.0 } else { inflow };
        let slow = (moved_out_head[i] + moved_out_tail[i]) * per_volume[i];
        let fast = (sweep_out_head[i] + sweep_out_tail[i]) * half_per_area;
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
            (before[i], 1.0, [moved_in_head[i], moved_in_tail[i]], [sweep_in_head[i], sweep_in_tail[i]]),
            (after[i], -1.0, [moved_out_head[i], moved_out_tail[i]], [sweep_out_head[i], sweep_out_tail[i]]),
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
