//! How much air each column of a map takes in, from flow, pressure and heights at one instant.
//!
//! After Ihmsen, Akinci, Akinci and Teschner, Unified spray, foam and air bubbles for particle-based fluids, 2012: potentials
//! for trapped air and wave crests, scaled by the energy of motion, each clamped between two limits. Particles become columns:
//! what they tell from neighbours' velocities is here the flow's divergence; the report's section 2.4 adds vorticity and pressure.

use crate::scene::{FoamLimits, FoamRate};
use crate::state::Columns;
use rayon::prelude::*;

/// Weight of a column of water one metre deep and one square metre wide (Pa/m), as the frames' pressure has it.
const WEIGHT: f64 = 9810.0;
/// Mass of water (kg/m3).
const DENSITY: f64 = 1000.0;
/// The least cosine between the flow and the slope that it runs down for a crest to count (Ihmsen et al. 2012, eq. 7).
const FORWARD: f64 = 0.6;
/// Columns that one task takes.
pub(super) const COLUMNS_PER_TASK: usize = 4096;

/// The water of one instant, borrowed. Index `z * nx + x`.
#[derive(Clone, Copy, Debug)]
pub struct WaterMap<'a> {
    /// Columns along x and z.
    pub count: [usize; 2],
    /// Width of a column along x and z (m).
    pub width: [f64; 2],
    /// Height of the ground (m).
    pub base: &'a [f64],
    /// Height of the water's upper side (m).
    pub top: &'a [f64],
    /// Pressure at the ground (Pa above air); empty for the water's own weight.
    pub pressure: &'a [f64],
    /// Velocity along x and z (m/s).
    pub flow: &'a [[f64; 2]],
    /// Power that falling spray brings to each column's water (W/kg); empty for none.
    pub impact: &'a [f64],
    /// Depth (m) under which a column is dry.
    pub dry_threshold: f64,
}

/// What each potential is before its limits.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Measures {
    /// -div u where the flow converges (1/s), at least 0.
    pub convergence: f64,
    /// |curl u| (1/s).
    pub vorticity: f64,
    /// Loss of total pressure along the flow over density, and what falling spray loses (W/kg), at least 0.
    pub pressure: f64,
    /// Curvature of a crest whose flow runs down its front (1/m), at least 0.
    pub crest: f64,
    /// u^2 / 2 (J/kg).
    pub energy: f64,
    /// Depth (m).
    pub depth: f64,
}

impl<'a> WaterMap<'a> {
    /// The water of a frame.
    pub fn of(columns: &'a Columns, dry_threshold: f64) -> Self {
        Self {
            count: [columns.nx, columns.nz],
            width: columns.width,
            base: &columns.base,
            top: &columns.top,
            // A frame's pressure may be missing and is 0 everywhere then: the water still weighs something.
            pressure: if columns.pressure.iter().all(|&pressure| pressure == 0.0) { &[] } else { &columns.pressure },
            flow: &columns.flow,
            impact: &[],
            dry_threshold,
        }
    }

    /// Whether a column holds water.
    #[inline]
    pub fn wet(&self, column: usize) -> bool {
        self.top[column] - self.base[column] > self.dry_threshold
    }

    /// The wet neighbours along an axis, towards lesser and greater coordinates.
    #[inline]
    pub(super) fn beside(&self, column: usize, axis: usize) -> [Option<usize>; 2] {
        let [nx, nz] = self.count;
        let (place, count, stride) = if axis == 0 { (column % nx, nx, 1) } else { (column / nx, nz, nx) };
        let before = (place > 0).then(|| column - stride);
        let after = (place + 1 < count).then(|| column + stride);
        [before, after].map(|near| near.filter(|&near| self.wet(near)))
    }

    /// Derivative along an axis: central over wet neighbours, one-sided beside a bank, 0 between two.
    #[inline]
    fn derivative<const N: usize>(&self, column: usize, axis: usize, of: impl Fn(usize) -> [f64; N]) -> [f64; N] {
        let [before, after] = self.beside(column, axis);
        let steps = f64::from(u8::from(before.is_some()) + u8::from(after.is_some()));
        if steps == 0.0 {
            return [0.0; N];
        }
        let (low, high) = (of(before.unwrap_or(column)), of(after.unwrap_or(column)));
        std::array::from_fn(|part| (high[part] - low[part]) / (steps * self.width[axis]))
    }

    /// Total pressure over density (J/kg): piezometric head and velocity head.
    fn total(&self, column: usize) -> f64 {
        let [x, z] = self.flow[column];
        let head = match self.pressure.get(column) {
            Some(&pressure) => pressure + WEIGHT * self.base[column],
            None => WEIGHT * self.top[column],
        };
        head / DENSITY + 0.5 * (x * x + z * z)
    }

    /// What there is to take air in at a column; all 0 where it is dry.
    pub fn measures(&self, column: usize) -> Measures {
        if !self.wet(column) {
            return Measures::default();
        }
        let flow = self.flow[column];
        let here = |column: usize| {
            let [x, z] = self.flow[column];
            [x, z, self.total(column), self.top[column]]
        };
        let (along_x, along_z) = (self.derivative(column, 0, here), self.derivative(column, 1, here));
        let speed = (flow[0] * flow[0] + flow[1] * flow[1]).sqrt();
        let (slope_x, slope_z) = (along_x[3], along_z[3]);
        let slope = (slope_x * slope_x + slope_z * slope_z).sqrt();
        // Down the slope is where the upward normal leans to.
        let forward = -(flow[0] * slope_x + flow[1] * slope_z) >= FORWARD * speed * slope && speed * slope > 0.0;
        Measures {
            convergence: (-(along_x[0] + along_z[1])).max(0.0),
            vorticity: (along_z[0] - along_x[1]).abs(),
            pressure: (-(flow[0] * along_x[2] + flow[1] * along_z[2])).max(0.0)
                + self.impact.get(column).copied().unwrap_or(0.0),
            crest: if forward { self.curvature(column).max(0.0) } else { 0.0 },
            energy: 0.5 * speed * speed,
            depth: self.top[column] - self.base[column],
        }
    }

    /// Minus the Laplacian of the top (1/m), over the axes on which both neighbours are wet.
    fn curvature(&self, column: usize) -> f64 {
        let top = self.top[column];
        (0..2)
            .map(|axis| match self.beside(column, axis) {
                [Some(before), Some(after)] => {
                    (2.0 * top - self.top[before] - self.top[after]) / (self.width[axis] * self.width[axis])
                }
                _ => 0.0,
            })
            .sum()
    }

    /// Foam that forms in each column (share of its area in a second).
    ///
    /// depth * (energy * (rates of convergence, vorticity, crest) + rate of pressure), every measure clamped by its limits as
    /// I = clamp((x - min) / (max - min)). Lost pressure is a power: the energy of motion is in it already.
    /// *Source*: Ihmsen et al. 2012, eqs. 1 and 8.
    pub fn production(&self, limits: &FoamLimits, rate: &FoamRate) -> Vec<f32> {
        let columns = 0..self.flow.len();
        let production = |column: usize| {
            let found = self.measures(column);
            let moving = rate.convergence * share(found.convergence, limits.convergence)
                + rate.vorticity * share(found.vorticity, limits.vorticity)
                + rate.crest * share(found.crest, limits.crest);
            let sum =
                share(found.energy, limits.energy) * moving + rate.pressure * share(found.pressure, limits.pressure);
            (share(found.depth, limits.depth) * sum) as f32
        };
        columns.into_par_iter().with_min_len(COLUMNS_PER_TASK).map(production).collect()
    }
}

/// Turns the energy (J) that each column got from spray in `dt` seconds into a power for each mass of its water (W/kg).
pub fn impact_power(energy: &mut [f64], water: &WaterMap, dt: f64) {
    let area = water.width[0] * water.width[1];
    for (column, energy) in energy.iter_mut().enumerate() {
        let depth = water.top[column] - water.base[column];
        *energy = if water.wet(column) { *energy / (dt * DENSITY * depth * area) } else { 0.0 };
    }
}

/// Ihmsen's clamp: 0 at the first limit, 1 at the second.
fn share(value: f64, [least, most]: [f64; 2]) -> f64 {
    ((value - least) / (most - least)).clamp(0.0, 1.0)
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// Water 1 m deep with a flow by place (m).
    pub(in crate::foam) fn water(count: [usize; 2], width: f64, flow: impl Fn(f64, f64) -> [f64; 2]) -> Columns {
        let [nx, nz] = count;
        let place = |column: usize| ((column % nx) as f64 * width, (column / nx) as f64 * width);
        Columns {
            origin: [10.0, -5.0],
            width: [width; 2],
            nx,
            nz,
            base: vec![0.0; nx * nz],
            top: vec![1.0; nx * nz],
            pressure: vec![WEIGHT; nx * nz],
            flow: (0..nx * nz).map(|column| flow(place(column).0, place(column).1)).collect(),
        }
    }

    fn produced(columns: &Columns) -> Vec<f32> {
        WaterMap::of(columns, 0.001).production(&FoamLimits::default(), &FoamRate::default())
    }

    #[test]
    fn still_water_and_even_flow_make_no_foam() {
        for flow in [[0.0, 0.0], [4.0, -2.0]] {
            let mut columns = water([12, 9], 0.25, |_, _| flow);
            // A bed that is no plane under a level surface.
            (0..108)
                .for_each(|i| columns.base[i] = 0.3 * f64::from((i as u32).wrapping_mul(2_654_435_761) >> 24) / 256.0);
            columns.pressure = columns.base.iter().map(|base| WEIGHT * (1.0 - base)).collect();
            assert!(produced(&columns).iter().all(|&rate| rate == 0.0), "{flow:?}");
        }
    }

    #[test]
    fn measures_of_linear_flows_are_exact() {
        let at = |columns: &Columns| WaterMap::of(columns, 0.001).measures(5 * 12 + 6);
        let vortex = at(&water([12, 9], 0.25, |x, z| [3.0 * z, -3.0 * x]));
        assert!((vortex.vorticity - 6.0).abs() < 1e-12 && vortex.convergence < 1e-12);
        let sink = at(&water([12, 9], 0.25, |x, z| [5.0 - 2.0 * x, 1.0 - 1.5 * z]));
        assert!((sink.convergence - 3.5).abs() < 1e-12 && sink.vorticity < 1e-12);
        assert_eq!(
            at(&water([12, 9], 0.25, |x, _| [1.0 + 2.0 * x, 0.0])).convergence,
            0.0,
            "air is not trapped by divergence"
        );
        // Total pressure falls by g * 0.1 m/m at 2 m/s.
        let mut chute = water([12, 9], 0.25, |_, _| [2.0, 0.0]);
        (0..108).for_each(|i| chute.top[i] = 3.0 - 0.1 * 0.25 * (i % 12) as f64);
        chute.pressure = chute.top.iter().map(|top| WEIGHT * top).collect();
        assert!((at(&chute).pressure - 2.0 * 9.81 * 0.1).abs() < 1e-9);
        chute.pressure = vec![0.0; 108];
        assert!((at(&chute).pressure - 2.0 * 9.81 * 0.1).abs() < 1e-9, "without a pressure in the frame, by weight");
    }

    #[test]
    fn vortices_convergence_and_falling_pressure_make_foam() {
        for flow in [|x: f64, z: f64| [8.0 * (z - 1.0), -8.0 * (x - 1.5)], |x: f64, _: f64| [9.0 - 5.0 * x, 0.0]] {
            let columns = water([12, 9], 0.25, flow);
            assert!(produced(&columns)[2 * 12 + 2] > 0.1);
        }
        // A bore: fast and shallow meets slow and deep.
        let mut bore = water([12, 9], 0.25, |x, _| if x < 1.5 { [3.0, 0.0] } else { [1.0, 0.0] });
        (0..108).for_each(|i| bore.top[i] = if i % 12 < 6 { 0.3 } else { 0.6 });
        bore.pressure = bore.top.iter().map(|top| WEIGHT * top).collect();
        let rate = produced(&bore);
        assert!(rate[4 * 12 + 5] > 1.0 && rate[4 * 12 + 2] == 0.0 && rate[4 * 12 + 10] == 0.0);
    }

    #[test]
    fn spray_that_falls_in_makes_foam_by_its_power() {
        let columns = water([12, 9], 0.25, |_, _| [0.0; 2]);
        let map = WaterMap::of(&columns, 0.001);
        let mut impact = vec![0.0; 108];
        // 20 W/kg in a column of 62.5 kg, for a tenth of a second.
        impact[40] = 20.0 * 62.5 * 0.1;
        impact_power(&mut impact, &map, 0.1);
        assert!((impact[40] - 20.0).abs() < 1e-9);
        let rate = WaterMap { impact: &impact, ..map }.production(&FoamLimits::default(), &FoamRate::default());
        assert!(rate[40] > 1.0 && rate[41] == 0.0);
    }

    #[test]
    fn only_the_front_of_a_running_crest_counts() {
        let crest = |direction: f64| {
            let mut columns = water([24, 5], 0.1, |_, _| [2.0 * direction, 0.0]);
            (0..120).for_each(|i| columns.top[i] = 1.0 + 0.2 * (-(((i % 24) as f64 - 12.0) / 3.0).powi(2)).exp());
            columns
        };
        let at = |columns: &Columns, x: usize| WaterMap::of(columns, 0.001).measures(2 * 24 + x).crest;
        let (east, west) = (crest(1.0), crest(-1.0));
        assert!(at(&east, 13) > 2.0 && at(&east, 11) == 0.0);
        assert!(at(&west, 11) > 2.0 && at(&west, 13) == 0.0);
        assert_eq!(at(&east, 18), 0.0, "its foot is hollow");
        assert!(produced(&east)[2 * 24 + 13] > 0.5);
    }

    #[test]
    fn dry_columns_and_films_make_none_and_banks_are_no_walls() {
        let mut columns = water([12, 9], 0.25, |x, z| [8.0 * z, -8.0 * x]);
        (0..108).filter(|i| i % 12 < 4).for_each(|i| columns.top[i] = 0.0005);
        (0..108).filter(|i| i % 12 > 8).for_each(|i| columns.top[i] = 0.009);
        let rate = produced(&columns);
        for row in 0..9 {
            assert!((0..4).chain(9..12).all(|x| rate[row * 12 + x] == 0.0));
        }
        let even = {
            let mut columns = water([12, 9], 0.25, |_, _| [3.0, 0.0]);
            (0..108).filter(|i| i / 12 < 4).for_each(|i| (columns.top[i], columns.flow[i]) = (0.0, [0.0; 2]));
            columns
        };
        assert!(produced(&even).iter().all(|&rate| rate == 0.0), "a stream beside a dry bank is not sheared by it");
    }
}
