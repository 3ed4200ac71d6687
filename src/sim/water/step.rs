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

use super::flow::FlowRow;
use super::layout::{DENSITY, FAMILIES, Layout, MARGIN, OFFSETS};
use super::rows::{greater, is_parallel};
use super::{Forcing, Water};
use crate::simd::{self, SimdLevel};

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
    /// Velocity and volume moved, as the last step left them.
    pub(super) eta: &'a [f64],
    pub(super) moved: &'a [f64],
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
        self.move_volume(parallel);
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
pub(super) fn shed_height(rows: &Rows, row: usize, x: usize, family: usize, velocity: f64) -> Option<f64> {
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
