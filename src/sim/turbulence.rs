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
    /// Both before this step.
    before: Vec<(f64, f64)>,
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
            before: Vec::new(),
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
        let gravity = water.settings().gravity;
        let Self { energy, air, before, flow, head } = self;
        water.flow_into(flow);
        before.clear();
        before.extend(energy.iter().copied().zip(air.iter().copied()));
        head.par_iter_mut().zip(flow.par_iter()).with_min_len(COLUMNS_PER_TASK).enumerate().for_each(
            |(column, (head, flow))| {
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
                // What stayed and what came in, and the head that inflowing water loses.
                let kept = water.kept(column);
                let (mut total, mut lost, mut came) = (kept, 0.0, 0.0);
                let (mut carried, mut carried_air) = (kept * before[column].0, kept * before[column].1);
                water.each_inflow(column, |near, volume| {
                    total += volume;
                    carried += volume * before[near].0;
                    carried_air += volume * before[near].1;
                    lost += volume * (mean.head[near] - mean.head[column]).max(0.0);
                    came += volume;
                });
                // A mean: its rounding may not leave the range.
                let carried = if total > 0.0 { carried / total } else { 0.0 };
                *air = if total > 0.0 { (carried_air / total).min(1.0) } else { 0.0 };
                let length = MIXING_LENGTH * depth;
                let strain = mean.strain(column);
                let lost = gravity * lost / ((depth * area).max(came) * dt);
                let impact = impacts.get(column).map_or(0.0, |joule| joule / (dt * DENSITY * depth * area));
                let gain = length * length * strain.powi(3) + lost + impact;
                *energy = (carried + dt * gain) / (1.0 + dt * DISSIPATION * carried.sqrt() / length);

                let lift = *energy - gravity * length - SURFACE_TENSION / (DENSITY * length);
                let in_rate = ENTRAINMENT * (2.0 * lift.max(0.0)).sqrt() / depth;
                if in_rate == 0.0 && *air == 0.0 {
                    return;
                }
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sim::{Forcing, WaterSettings};

    fn water(grid: Grid, base: impl Fn(usize) -> f64, depth: impl Fn(usize) -> f64, friction: f64) -> Water {
        let columns = 0..grid.count();
        let settings = WaterSettings { friction, ..WaterSettings::default() };
        Water::new(grid, columns.clone().map(base).collect(), columns.map(depth).collect(), settings)
    }

    fn oblong(nx: usize, nz: usize) -> Grid {
        Grid { nx, nz, width: [0.25, 0.4], origin: [3.0, -2.0] }
    }

    /// A pool of a depth that nothing moves, after a step so that its volumes are known.
    fn pool(depth: f64) -> Water {
        let mut water = water(oblong(3, 3), |_| 1.0, |_| depth, 0.995);
        water.step(0.001, &Forcing::default());
        water
    }

    #[test]
    fn still_water_is_calm_and_clear() {
        let grid = oblong(12, 9);
        let base = |column: usize| f64::from((column as u32).wrapping_mul(2_654_435_761) >> 24) / 256.0;
        let mut water = water(grid, base, |column| (0.9 - base(column)).max(0.0), 0.995);
        let mut turbulence = Turbulence::new(grid.count());
        for _ in 0..100 {
            water.step(0.005, &Forcing::default());
            turbulence.step(&water, 0.005, &[]);
        }
        for (name, map) in turbulence.maps(&water) {
            let greatest = map.iter().fold(0.0f32, |most, value| most.max(value.abs()));
            // Levels that differ by a rounding move at some 1e-16 m/s.
            assert!(greatest <= 1e-9, "{name}: {greatest:e}");
        }
        assert!(turbulence.aeration().iter().all(|air| *air == 0.0));
    }

    #[test]
    fn vorticity_and_strain_of_linear_flows_are_exact() {
        let grid = oblong(5, 4);
        let depth = vec![1.0; grid.count()];
        let check = |flow: &dyn Fn(f64, f64) -> [f64; 2], vorticity: f64, strain: f64| {
            let flow: Vec<_> =
                (0..grid.count()).map(|column| flow(grid.centre(column)[0], grid.centre(column)[1])).collect();
            let mean = Mean { grid, depth: &depth, flow: &flow, head: &[] };
            for column in 0..grid.count() {
                assert!((mean.vorticity(column) - vorticity).abs() < 1e-12);
                assert!((mean.strain(column) - strain).abs() < 1e-12);
            }
        };
        // Anticlockwise seen from above, north (-z) up: the eastern side moves north.
        check(&|x, z| [0.7 * z, -0.7 * x], 1.4, 0.0);
        check(&|_, z| [0.7 * z, 0.0], 0.7, 0.7);
        check(&|x, z| [0.7 * x, -0.7 * z], 0.0, 1.4);
        check(&|_, _| [3.0, -2.0], 0.0, 0.0);
        // Dry neighbours do not count: a stream between dry banks has one-sided differences or none.
        let flow: Vec<_> = (0..grid.count()).map(|column| [grid.centre(column)[1], 0.0]).collect();
        let mut banks = depth.clone();
        (0..grid.count()).filter(|column| column / 5 != 1).for_each(|column| banks[column] = 0.0);
        let mean = Mean { grid, depth: &banks, flow: &flow, head: &[] };
        assert_eq!((mean.vorticity(7), mean.vorticity(2)), (0.0, 0.0));
        (10..15).for_each(|column| banks[column] = 1.0);
        let mean = Mean { grid, depth: &banks, flow: &flow, head: &[] };
        assert!((mean.vorticity(7) - 1.0).abs() < 1e-12);
    }

    /// Energy at a time in a pool 0.5 m deep, from a start and with a power (W/kg).
    fn energy_after(time: f64, steps: usize, start: f64, power: f64) -> f64 {
        let water = pool(0.5);
        let dt = time / steps as f64;
        let mut turbulence = Turbulence::new(9);
        assert!(turbulence.set_state(&[vec![start; 9], vec![0.0; 9]].concat()));
        let impacts = [power * dt * DENSITY * 0.5 * water.grid().area(); 9];
        (0..steps).for_each(|_| turbulence.step(&water, dt, if power > 0.0 { &impacts } else { &[] }));
        turbulence.state()[4]
    }

    #[test]
    fn free_turbulence_decays_as_its_equation_says_to_first_order() {
        // dk/dt = -c k^(3/2) / l: k = k_0 / (1 + c sqrt(k_0) t / (2 l))².
        let length = MIXING_LENGTH * 0.5;
        let exact = 1.7 / (1.0 + DISSIPATION * 1.7f64.sqrt() * 0.4 / (2.0 * length)).powi(2);
        let errors = [20, 40, 80].map(|steps| (energy_after(0.4, steps, 1.7, 0.0) - exact).abs());
        assert!(errors[0] < 0.05 * exact, "{errors:?}");
        for pair in errors.windows(2) {
            assert!((pair[0] / pair[1] - 2.0).abs() < 0.1, "{errors:?}");
        }
    }

    #[test]
    fn falling_spray_keeps_up_the_turbulence_that_its_power_pays_for() {
        // In balance P = c k^(3/2) / l.
        let power = 6.0;
        let balance = (power * MIXING_LENGTH * 0.5 / DISSIPATION).powf(2.0 / 3.0);
        for steps in [100, 1000, 10_000] {
            assert!((energy_after(20.0, steps, 0.0, power) / balance - 1.0).abs() < 1e-6, "{steps}");
        }
        // On the way there: first order in the step.
        let [a, b, c] = [25, 50, 100].map(|steps| energy_after(0.25, steps, 0.0, power));
        assert!(((a - b) / (b - c) - 2.0).abs() < 0.2, "{a} {b} {c}");
    }

    #[test]
    fn bubbles_rise_out_of_still_water_in_its_depth_over_their_speed() {
        for depth in [0.05, 0.5, 3.0] {
            let water = pool(depth);
            for steps in [1, 10, 300] {
                let mut turbulence = Turbulence::new(9);
                assert!(turbulence.set_state(&[vec![0.0; 9], vec![0.8; 9]].concat()));
                let dt = depth / 0.25 / f64::from(steps);
                (0..steps).for_each(|_| turbulence.step(&water, dt, &[]));
                let air = turbulence.aeration()[4];
                assert!((air / (0.8 * (-1f64).exp()) - 1.0).abs() < 1e-12, "{depth} m in {steps} steps: {air}");
            }
        }
    }

    #[test]
    fn only_turbulence_that_beats_gravity_and_surface_tension_takes_in_air() {
        for depth in [0.02, 0.3] {
            let length = MIXING_LENGTH * depth;
            let least = 9.81 * length + SURFACE_TENSION / (DENSITY * length);
            let water = pool(depth);
            for (factor, foams) in [(0.99, false), (1.01, true)] {
                let mut turbulence = Turbulence::new(9);
                assert!(turbulence.set_state(&[vec![factor * least; 9], vec![0.0; 9]].concat()));
                turbulence.step(&water, 1e-7, &[]);
                assert_eq!(turbulence.aeration()[4] > 0.0, foams, "{depth} m, {factor}");
            }
        }
    }

    #[test]
    fn a_blob_of_air_moves_with_the_stream() {
        // A long even slope: far from its ends the water speeds up evenly, and all of it alike.
        let grid = Grid { nx: 240, nz: 3, width: [0.25, 0.25], origin: [0.0, 0.0] };
        let mut water = water(grid, |column| -0.02 * 0.25 * (column % 240) as f64, |_| 1.0, 1.0);
        let mut turbulence = Turbulence::new(grid.count());
        let blob = |column: usize| 0.7 * (-((column % 240) as f64 - 110.0).powi(2) / 18.0).exp();
        let air: Vec<f64> = (0..grid.count()).map(blob).collect();
        assert!(turbulence.set_state(&[vec![0.0; grid.count()], air].concat()));
        let centre = |turbulence: &Turbulence| {
            let air = turbulence.aeration();
            let sum: f64 = air.iter().sum();
            air.iter().enumerate().map(|(column, air)| air * grid.centre(column)[0]).sum::<f64>() / sum
        };
        let start = centre(&turbulence);
        let (dt, mut way) = (0.02, 0.0);
        for _ in 0..250 {
            water.step(dt, &Forcing::default());
            turbulence.step(&water, dt, &[]);
            way += water.flow_at(240 + 115)[0] * dt;
            assert!(turbulence.aeration().iter().all(|air| (0.0..=1.0).contains(air)));
        }
        assert!(way > 2.0, "{way}");
        let moved = centre(&turbulence) - start;
        assert!((moved / way - 1.0).abs() < 0.02, "{moved} {way}");
    }

    #[test]
    fn the_foot_of_a_fall_is_turbulent_and_white_and_the_pond_above_is_not() {
        let grid = Grid { nx: 40, nz: 5, width: [0.25, 0.25], origin: [0.0, 0.0] };
        let base = |column: usize| if column % 40 < 20 { 2.0 } else { 0.0 };
        let mut water = water(grid, base, |column| if column % 40 < 20 { 0.6 } else { 0.3 }, 0.995);
        let mut turbulence = Turbulence::new(grid.count());
        for _ in 0..300 {
            water.step(0.005, &Forcing::default());
            for row in 0..5 {
                water.set_depth(row * 40, 0.6);
                water.set_depth(row * 40 + 39, 0.3);
            }
            turbulence.step(&water, 0.005, &[]);
        }
        let row = 2 * 40;
        let (foot, pond) = (turbulence.speed(row + 20), turbulence.speed(row + 8));
        assert!(foot > 0.5 && foot > 5.0 * pond, "{foot} {pond}");
        // No faster than the fall itself.
        assert!(foot < (2.0 * 9.81 * 2.6f64).sqrt());
        let air = turbulence.aeration();
        assert!(air[row + 20] > 0.02 && air[row + 8] == 0.0, "{} {}", air[row + 20], air[row + 8]);
        // It is carried away downstream.
        assert!(air[row + 24] > 0.0);
    }

    #[test]
    fn the_maps_are_finite_whatever_happens() {
        let grid = oblong(7, 5);
        let base = |column: usize| [0.0, 1000.0, 3.0][column % 3];
        let mut water = water(grid, base, |column| [10.0, 1e-200, 0.0, 0.003][column % 4], 1.0);
        let mut turbulence = Turbulence::new(grid.count());
        for step in 0..200 {
            let dt = [1e-9, 0.5, 0.01, 50.0][step % 4];
            water.step(dt, &Forcing::default());
            turbulence.step(&water, dt, &vec![[0.0, 1e12, 1e-300][step % 3]; grid.count()]);
            for (name, map) in turbulence.maps(&water) {
                assert!(map.len() == grid.count() && map.iter().all(|value| value.is_finite()), "{name}, step {step}");
            }
            assert!(turbulence.aeration().iter().all(|air| (0.0..=1.0).contains(air)));
            assert!(turbulence.speeds().iter().all(|speed| *speed >= 0.0 && speed.is_finite()));
        }
    }

    #[test]
    fn a_state_goes_back_in_as_it_came_out() {
        let mut turbulence = Turbulence::new(2);
        assert!(turbulence.set_state(&[1.0, 2.0, 0.25, 0.5]));
        assert_eq!((turbulence.state(), turbulence.aeration()), (vec![1.0, 2.0, 0.25, 0.5], &[0.25, 0.5][..]));
        assert!((turbulence.speed(0) - (2.0f64 / 3.0).sqrt()).abs() < 1e-15);
        for wrong in
            [&[1.0, 2.0, 0.25][..], &[1.0, -2.0, 0.2, 0.5], &[1.0, 2.0, 0.25, 1.5], &[f64::NAN, 2.0, 0.25, 0.5]]
        {
            assert!(!turbulence.set_state(wrong));
            assert_eq!(turbulence.state(), [1.0, 2.0, 0.25, 0.5]);
        }
    }
}
