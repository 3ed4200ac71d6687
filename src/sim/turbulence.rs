//! Vorticity, turbulence and aeration per column, from flow and pressure (the report's section 2.4), for foam.
//!
//! The energy k of the turbulence (J/kg) is carried with the water, fed by what the mean flow loses and drained by its own
//! eddies: the one-equation model of Prandtl (1945; Pope, Turbulent Flows, 2000, section 10.3) averaged over the depth. The
//! share of air is carried too, fed where turbulence throws up the surface against gravity and surface tension (Hirt, Flow
//! Science FSI-03-TN61, 2003) and drained as bubbles rise. Neither acts back on the water.

use rayon::prelude::*;

use super::{Grid, Water};

/// Density of water (kg/m3).
const DENSITY: f64 = 1000.0;
/// Surface tension of water against air (N/m).
const SURFACE_TENSION: f64 = 0.073;
/// Mixing length over depth: the mean of κ y sqrt(1 - y / h) over the depth is κ h 4/15, with κ = 0.41 (Nezu and Rodi,
/// Open-channel flow measurements with a laser Doppler anemometer, 1986).
const MIXING_LENGTH: f64 = 0.41 * 4.0 / 15.0;
/// Dissipation is this times k^(3/2) / l. Prandtl's model agrees with the law of the wall where it is 0.55 cubed (Pope 2000,
/// eq. 10.40 and following).
const DISSIPATION: f64 = 0.55 * 0.55 * 0.55;
/// Share of the eddies' speed at which air is taken in (Hirt 2003).
const ENTRAINMENT: f64 = 0.5;
/// Speed (m/s) at which bubbles of 2 to 10 mm rise (Clift, Grace and Weber, Bubbles, Drops and Particles, 1978, figure 7.3).
const BUBBLE_RISE: f64 = 0.25;

/// Columns that one task takes.
const COLUMNS_PER_TASK: usize = 4096;

/// Turbulence and air in the columns of one map.
#[derive(Clone, Debug)]
pub struct Turbulence {
    /// Energy of turbulence (J/kg).
    energy: Vec<f64>,
    /// Share of air in the volume.
    air: Vec<f64>,
    /// Energy as carried, before this step's gains and losses.
    carried: Vec<f64>,
    scratch: Vec<f64>,
    flow: Vec<[f64; 2]>,
    /// Energy of the mean flow for each weight of water: top and velocity head (m).
    head: Vec<f64>,
}

impl Turbulence {
    /// Calm, clear water in a number of columns.
    pub fn new(columns: usize) -> Self {
        Self {
            energy: vec![0.0; columns],
            air: vec![0.0; columns],
            carried: Vec::new(),
            scratch: Vec::new(),
            flow: vec![[0.0; 2]; columns],
            head: vec![0.0; columns],
        }
    }

    /// `dt` seconds, after the water's own step, whose moved volumes carry both.
    ///
    /// *Shape*: `impacts` is the energy of motion (J) that each column got from spray in the step, or empty for none.
    ///
    /// *Method*: first order. dk/dt = P - c k^(3/2) / l with c = 0.166 and l = 0.109 h, the loss implicit, so that k stays
    /// positive for any step. P (W/kg) is the sum of l² |S|³ (the horizontal strain's work on a mixing length), of g times
    /// the head that water loses on entering from a neighbour with a higher one (what a bore, a fall or the bed's friction
    /// dissipates), and of what spray brings. Air: dα/dt = (1 - α) w / h - α w_r / h, exactly for what w is at the step's end;
    /// w = 0.5 sqrt(2 (k - g l - σ / (ρ l))) where that is real, w_r = 0.25 m/s. In still water α thus decays with the time
    /// constant h / w_r. A column thinner than the capillary length, 2.7 mm, holds neither: its surface is smoothed
    /// faster than any eddy in it turns.
    ///
    /// # Panics
    /// If the map has another number of columns.
    pub fn step(&mut self, water: &Water, dt: f64, impacts: &[f64]) {
        let columns = water.grid().count();
        assert_eq!(self.energy.len(), columns, "the turbulence's map is the water's");
        assert!(impacts.is_empty() || impacts.len() == columns, "one impact per column");
        water.carry(&mut self.energy, &mut self.scratch);
        water.carry(&mut self.air, &mut self.scratch);
        let gravity = water.settings().gravity;
        let Self { energy, air, carried, flow, head, .. } = self;
        carried.clone_from(energy);
        flow.par_iter_mut().zip(head.par_iter_mut()).with_min_len(COLUMNS_PER_TASK).enumerate().for_each(
            |(column, (flow, head))| {
                *flow = water.flow_at(column);
                *head = water.top(column) + (flow[0] * flow[0] + flow[1] * flow[1]) / (2.0 * gravity);
            },
        );
        let mean = Mean { grid: *water.grid(), depth: water.depth(), flow, head };
        let film = (SURFACE_TENSION / (DENSITY * gravity)).sqrt();
        let area = water.grid().area();
        energy.par_iter_mut().zip(air.par_iter_mut()).with_min_len(COLUMNS_PER_TASK).enumerate().for_each(
            |(column, (energy, air))| {
                let depth = mean.depth[column];
                if !(depth >= film) {
                    (*energy, *air) = (0.0, 0.0);
                    return;
                }
                let length = MIXING_LENGTH * depth;
                let strain = mean.strain(column);
                // Head that inflowing water loses, times the share of the column that came in.
                let (mut lost, mut came) = (0.0, 0.0);
                water.each_inflow(column, |near, volume| {
                    lost += volume * (mean.head[near] - mean.head[column]).max(0.0);
                    came += volume;
                });
                let lost = gravity * lost / ((depth * area).max(came) * dt);
                let impact = impacts.get(column).map_or(0.0, |joule| joule / (dt * DENSITY * depth * area));
                let gain = length * length * strain.powi(3) + lost + impact;
                let before = carried[column];
                *energy = (before + dt * gain) / (1.0 + dt * DISSIPATION * before.sqrt() / length);

                let lift = *energy - gravity * length - SURFACE_TENSION / (DENSITY * length);
                let in_rate = ENTRAINMENT * (2.0 * lift.max(0.0)).sqrt() / depth;
                let out_rate = BUBBLE_RISE / depth;
                let balance = in_rate / (in_rate + out_rate);
                // Both ends and the factor lie in 0..1; so does what lies between, but for a rounding.
                *air = (balance + (*air - balance) * (-(in_rate + out_rate) * dt).exp()).clamp(0.0, 1.0);
            },
        );
    }

    /// Root mean square of one component of the turbulent velocity (m/s) in a column: sqrt(2 k / 3).
    pub fn speed(&self, column: usize) -> f64 {
        (2.0 / 3.0 * self.energy[column]).sqrt()
    }

    /// [`Self::speed`] of every column.
    pub fn speeds(&self) -> Vec<f64> {
        (0..self.energy.len()).map(|column| self.speed(column)).collect()
    }

    /// Share of air (0..1) in each column.
    pub fn aeration(&self) -> &[f64] {
        &self.air
    }

    /// The three maps of a frame, index `z * nx + x`, 0 in dry columns: `vorticity` (1/s), the curl's upward component
    /// ∂v_x/∂z - ∂v_z/∂x, positive anticlockwise seen from above with north up; `turbulence` (m/s), as [`Self::speed`];
    /// `aeration` (0..1).
    pub fn maps(&self, water: &Water) -> [(&'static str, Vec<f32>); 3] {
        let flow = water.flow();
        let mean = Mean { grid: *water.grid(), depth: water.depth(), flow: &flow, head: &[] };
        let columns = 0..self.energy.len();
        // What single precision cannot hold is written as the greatest that it can: no map has infinities.
        let single = |value: f64| value.clamp(f64::from(f32::MIN), f64::from(f32::MAX)) as f32;
        [
            ("vorticity", columns.clone().map(|column| single(mean.vorticity(column))).collect()),
            ("turbulence", columns.clone().map(|column| single(self.speed(column))).collect()),
            ("aeration", columns.map(|column| single(self.air[column])).collect()),
        ]
    }

    /// All that the next step depends on: the energies, then the shares of air.
    pub fn state(&self) -> Vec<f64> {
        [&self.energy[..], &self.air].concat()
    }

    /// Goes on from a state; false, and nothing changed, if it is not one of this map.
    #[must_use]
    pub fn set_state(&mut self, state: &[f64]) -> bool {
        let columns = self.energy.len();
        if state.len() != 2 * columns {
            return false;
        }
        let (energy, air) = state.split_at(columns);
        if !energy.iter().all(|k| *k >= 0.0 && k.is_finite()) || !air.iter().all(|share| (0.0..=1.0).contains(share)) {
            return false;
        }
        self.energy.copy_from_slice(energy);
        self.air.copy_from_slice(air);
        true
    }
}

/// The mean flow and its differences.
struct Mean<'a> {
    grid: Grid,
    depth: &'a [f64],
    flow: &'a [[f64; 2]],
    head: &'a [f64],
}

impl Mean<'_> {
    fn wet(&self, column: usize) -> bool {
        self.depth[column] > 0.0
    }

    /// The wet neighbours of a column along an axis, towards lesser and greater coordinates.
    fn beside(&self, column: usize, axis: usize) -> [Option<usize>; 2] {
        let (place, count, stride) = match axis {
            0 => (column % self.grid.nx, self.grid.nx, 1),
            _ => (column / self.grid.nx, self.grid.nz, self.grid.nx),
        };
        let before = (place > 0).then(|| column - stride);
        let after = (place + 1 < count).then(|| column + stride);
        [before, after].map(|near| near.filter(|near| self.wet(*near)))
    }

    /// The velocity's derivative along an axis (1/s): central over wet neighbours, one-sided beside a bank, 0 between two.
    fn derivative(&self, column: usize, axis: usize) -> [f64; 2] {
        let [before, after] = self.beside(column, axis);
        let steps = f64::from(u8::from(before.is_some()) + u8::from(after.is_some()));
        if steps == 0.0 {
            return [0.0; 2];
        }
        let (before, after) = (self.flow[before.unwrap_or(column)], self.flow[after.unwrap_or(column)]);
        [0, 1].map(|part| (after[part] - before[part]) / (steps * self.grid.width[axis]))
    }

    fn vorticity(&self, column: usize) -> f64 {
        if !self.wet(column) {
            return 0.0;
        }
        self.derivative(column, 1)[0] - self.derivative(column, 0)[1]
    }

    /// |S| = sqrt(2 S_ij S_ij) of the horizontal strain rate (1/s).
    fn strain(&self, column: usize) -> f64 {
        let ([x_x, z_x], [x_z, z_z]) = (self.derivative(column, 0), self.derivative(column, 1));
        let shear = x_z + z_x;
        (2.0 * (x_x * x_x + z_z * z_z) + shear * shear).sqrt()
    }
}
