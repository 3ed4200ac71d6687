//! Foam carried with the flow from instant to instant: its density, and the coordinates that its pattern is drawn in.
//!
//! The density moves in finite volumes (flux form, second order, limited), so that what leaves one column enters the next and
//! foam gathers where the flow converges. The coordinates move backwards along the flow: F. Neyret, Advected textures, 2003.

use rayon::prelude::*;

use super::potential::{COLUMNS_PER_TASK, WaterMap};
use crate::state::StoredFoam;

/// Layers of texture coordinates, each half a renewal after the other.
pub const LAYERS: usize = StoredFoam::LAYERS;
/// Columns that the density may cross in one sweep: with both its faces losing as much, a column keeps something.
const COURANT: f32 = 0.5;
/// Columns that a path may be long before it is followed in pieces.
const PATH: f32 = 2.0;
/// Columns that foam may cross in one step. Faster water (the width of a map in a frame) carries it this far.
const FARTHEST: f32 = 64.0;

/// Foam on a map of columns at one instant. Index `z * nx + x`.
#[derive(Clone, Debug, PartialEq)]
pub struct FoamState {
    count: [usize; 2],
    width: [f64; 2],
    /// Seconds.
    time: f64,
    /// Seconds between two starts of a layer.
    renewal: f64,
    /// Share of each column's area under foam, 0..1.
    density: Vec<f32>,
    /// What to add to x and z (m) to get to where the water was when the layer started.
    offset: [Vec<[f32; 2]>; LAYERS],
}

impl FoamState {
    /// No foam, and a pattern at rest.
    pub fn new(count: [usize; 2], width: [f64; 2], time: f64, renewal: f64) -> Self {
        let columns = count[0] * count[1];
        Self {
            count,
            width,
            time,
            // As a frame holds it, so that what is stored goes on to the same bits.
            renewal: f64::from(renewal as f32),
            density: vec![0.0; columns],
            offset: [0; LAYERS].map(|_| vec![[0.0; 2]; columns]),
        }
    }

    /// The foam that a frame of this time carries.
    ///
    /// # Panics
    /// If the arrays are not of this map: their reader has checked that.
    pub fn stored(count: [usize; 2], width: [f64; 2], time: f64, stored: StoredFoam) -> Self {
        let columns = count[0] * count[1];
        let StoredFoam { density, offset, renewal } = stored;
        assert!(density.len() == columns && offset.iter().all(|layer| layer.len() == columns), "one foam per column");
        Self { count, width, time, renewal, density, offset }
    }

    /// The arrays that a frame carries.
    pub fn to_stored(&self) -> StoredFoam {
        StoredFoam { density: self.density.clone(), offset: self.offset.clone(), renewal: self.renewal }
    }

    /// Columns along x and z.
    pub fn count(&self) -> [usize; 2] {
        self.count
    }

    /// Width of a column (m).
    pub fn width(&self) -> [f64; 2] {
        self.width
    }

    /// The instant (s).
    pub fn time(&self) -> f64 {
        self.time
    }

    /// Sets the instant to what it was meant to be, where steps that were added up miss it by a rounding.
    pub fn set_time(&mut self, time: f64) {
        self.time = time;
    }

    /// Share of each column's area under foam, 0..1.
    pub fn density(&self) -> &[f32] {
        &self.density
    }

    /// Covers every column anew: of what is free, the given share stays free.
    pub(super) fn cover(&mut self, free: &[f32]) {
        for (density, free) in self.density.iter_mut().zip(free) {
            *density = 1.0 - (1.0 - *density) * free;
        }
    }

    /// The coordinates' offsets of a layer (m).
    pub fn offset(&self, layer: usize) -> &[[f32; 2]] {
        &self.offset[layer]
    }

    /// How often a layer has started by now, and the share of its renewal that has passed since.
    pub fn phase(&self, layer: usize) -> (i64, f64) {
        phase(self.time, self.renewal, layer)
    }

    /// Takes the coordinates of another state of the same map, with its renewal.
    pub fn take_offsets(&mut self, other: FoamState) {
        assert_eq!(self.count, other.count, "coordinates of another map");
        (self.offset, self.renewal) = (other.offset, other.renewal);
    }

    /// Takes the foam out of columns.
    pub fn clear(&mut self, which: impl Fn(usize) -> bool) {
        self.density
            .iter_mut()
            .enumerate()
            .filter(|(column, _)| which(*column))
            .for_each(|(_, density)| *density = 0.0);
    }

    /// `dt` seconds in the flow of `water`, with `production` (1/s) in each column.
    ///
    /// *Density*: carried, then dd/dt = p (1 - d) - d / lifetime, exactly for a constant p, then at most 1: what converges
    /// on closed foam is lost. Dry columns hold none, and nothing crosses the map's edge. Elsewhere mass is kept to rounding.
    /// *Coordinates*: midpoint rule backwards, bilinear over wet columns; a layer that starts anew within the step is moved
    /// by the rest of it. A dry column has the mean of the wet ones around it, so that no pattern is torn at a bank.
    /// Water that crosses more than 64 columns in the step carries foam over 64.
    ///
    /// # Panics
    /// If the map is another one.
    pub fn step(&mut self, water: &WaterMap, production: &[f32], lifetime: f64, dt: f64) {
        let columns = self.density.len();
        assert!(water.count == self.count && production.len() == columns, "the foam's map is the water's");
        let flow = &Crossed::new(water, dt);
        self.carry_density(flow);
        let decay = 1.0 / lifetime;
        let (density, wet) = (&mut self.density, &flow.wet);
        density.par_iter_mut().with_min_len(COLUMNS_PER_TASK).enumerate().for_each(|(column, density)| {
            let gain = f64::from(production[column]);
            if !wet[column] {
                *density = 0.0;
                return;
            }
            if gain == 0.0 && *density == 0.0 {
                return;
            }
            let balance = gain / (gain + decay);
            let after = balance + (f64::from(*density) - balance) * (-(gain + decay) * dt).exp();
            // Less than one's last place cannot be told from none.
            *density = if after < f64::from(f32::EPSILON) { 0.0 } else { after.min(1.0) as f32 };
        });
        for layer in 0..LAYERS {
            let (before, _) = phase(self.time, self.renewal, layer);
            let (after, passed) = phase(self.time + dt, self.renewal, layer);
            let mut share = 1.0;
            if before != after {
                self.offset[layer].fill([0.0; 2]);
                share = (passed * self.renewal / dt).min(1.0) as f32;
            }
            self.carry_offset(layer, flow, share);
        }
        self.time += dt;
    }

    fn carry_density(&mut self, flow: &Crossed) {
        if self.density.iter().all(|&density| density == 0.0) {
            return;
        }
        let sweeps = (flow.farthest / COURANT).ceil().max(1.0) as usize;
        let share = 1.0 / sweeps as f32;
        let mut next = vec![0.0; self.density.len()];
        for sweep in 0..sweeps {
            // Turn about, so that neither axis is always first.
            for axis in [sweep % 2, 1 - sweep % 2] {
                flow.sweep(axis, share, &self.density, &mut next);
                std::mem::swap(&mut self.density, &mut next);
            }
        }
    }

    fn carry_offset(&mut self, layer: usize, flow: &Crossed, share: f32) {
        let pieces = (flow.farthest * share / PATH).ceil().max(1.0) as usize;
        let share = share / pieces as f32;
        let width = self.width.map(|width| width as f32);
        let mut next = vec![[0.0; 2]; self.density.len()];
        for _ in 0..pieces {
            let offset = &mut self.offset[layer];
            next.par_iter_mut().with_min_len(COLUMNS_PER_TASK).enumerate().for_each(|(column, next)| {
                if !flow.wet[column] {
                    return;
                }
                let place = [(column % flow.count[0]) as f32, (column / flow.count[0]) as f32];
                let back = |by: [f32; 2], share: f32| [place[0] - share * by[0], place[1] - share * by[1]];
                let middle = flow.between(&flow.crossed, back(flow.crossed[column], 0.5 * share), column);
                let from = flow.between(offset, back(middle, share), column);
                *next = [0, 1].map(|axis| from[axis] - share * middle[axis] * width[axis]);
            });
            offset.par_iter_mut().with_min_len(COLUMNS_PER_TASK).enumerate().for_each(|(column, offset)| {
                *offset = if flow.wet[column] { next[column] } else { flow.around(&next, column).unwrap_or(*offset) };
            });
        }
    }
}

/// How often layer `layer` has started by `time`, and the share of `renewal` that has passed since.
fn phase(time: f64, renewal: f64, layer: usize) -> (i64, f64) {
    let cycle = time / renewal + layer as f64 / LAYERS as f64;
    let whole = cycle.floor();
    (whole as i64, cycle - whole)
}

/// The flow of one step as columns crossed.
struct Crossed {
    count: [usize; 2],
    wet: Vec<bool>,
    crossed: Vec<[f32; 2]>,
    /// Most columns crossed along an axis.
    farthest: f32,
}

impl Crossed {
    fn new(water: &WaterMap, dt: f64) -> Self {
        let far = f64::from(FARTHEST);
        let crossed = |column: usize| {
            if !water.wet(column) {
                return [0.0; 2];
            }
            [0, 1].map(|axis| (water.flow[column][axis] * dt / water.width[axis]).clamp(-far, far) as f32)
        };
        let columns = 0..water.flow.len();
        let crossed: Vec<_> = columns.clone().map(crossed).collect();
        let farthest = crossed.as_flattened().iter().fold(0.0f32, |most, crossed| most.max(crossed.abs()));
        Self { count: water.count, wet: columns.map(|column| water.wet(column)).collect(), crossed, farthest }
    }

    /// One sweep along an axis over `share` of the step. Flux form with the monotonised central limiter (van Leer 1977).
    fn sweep(&self, axis: usize, share: f32, density: &[f32], next: &mut [f32]) {
        let [nx, nz] = self.count;
        let (count, stride) = if axis == 0 { (nx, 1) } else { (nz, nx) };
        // What crosses the face between `low` and the column after it; `place` is low's along the axis.
        let flux = |low: usize, place: usize| -> f32 {
            let high = low + stride;
            if !(self.wet[low] && self.wet[high]) {
                return 0.0;
            }
            let courant = 0.5 * share * (self.crossed[low][axis] + self.crossed[high][axis]);
            let (up, down, behind) = if courant >= 0.0 {
                (low, high, (place > 0).then(|| low - stride))
            } else {
                (high, low, (place + 2 < count).then_some(high + stride))
            };
            let slope = match behind {
                Some(behind) if self.wet[behind] => limited(density[up] - density[behind], density[down] - density[up]),
                _ => 0.0,
            };
            courant * (density[up] + 0.5 * (1.0 - courant.abs()) * slope)
        };
        next.par_iter_mut().with_min_len(COLUMNS_PER_TASK).enumerate().for_each(|(column, next)| {
            let place = if axis == 0 { column % nx } else { column / nx };
            let into = if place > 0 { flux(column - stride, place - 1) } else { 0.0 };
            let out = if place + 1 < count { flux(column, place) } else { 0.0 };
            // The scheme keeps its sign; its rounding may not.
            *next = (density[column] + into - out).max(0.0);
        });
    }

    /// Bilinear over the wet columns around a place; the value of `column` where there is none.
    fn between(&self, values: &[[f32; 2]], place: [f32; 2], column: usize) -> [f32; 2] {
        let [nx, nz] = self.count;
        let at = [place[0].clamp(0.0, (nx - 1) as f32), place[1].clamp(0.0, (nz - 1) as f32)];
        let cell = [(at[0] as usize).min(nx - 2), (at[1] as usize).min(nz - 2)];
        let [x, z] = [at[0] - cell[0] as f32, at[1] - cell[1] as f32];
        let first = cell[1] * nx + cell[0];
        let corners = [
            (first, (1.0 - x) * (1.0 - z)),
            (first + 1, x * (1.0 - z)),
            (first + nx, (1.0 - x) * z),
            (first + nx + 1, x * z),
        ];
        let (mut sum, mut total) = ([0.0; 2], 0.0);
        for (corner, weight) in corners {
            if self.wet[corner] {
                total += weight;
                sum = [0, 1].map(|axis| sum[axis] + weight * values[corner][axis]);
            }
        }
        if total > 0.0 { sum.map(|sum| sum / total) } else { values[column] }
    }

    /// The mean of the wet columns around one.
    fn around(&self, values: &[[f32; 2]], column: usize) -> Option<[f32; 2]> {
        let [nx, nz] = self.count;
        let (x, z) = (column % nx, column / nx);
        let (mut sum, mut total) = ([0.0; 2], 0.0);
        for row in z.saturating_sub(1)..(z + 2).min(nz) {
            for near in row * nx + x.saturating_sub(1)..row * nx + (x + 2).min(nx) {
                if self.wet[near] {
                    total += 1.0;
                    sum = [0, 1].map(|axis| sum[axis] + values[near][axis]);
                }
            }
        }
        (total > 0.0).then(|| sum.map(|sum| sum / total))
    }
}

/// The monotonised central slope of two differences: 0 at an extremum.
#[inline]
fn limited(behind: f32, ahead: f32) -> f32 {
    if behind * ahead <= 0.0 {
        return 0.0;
    }
    let least = (2.0 * behind.abs()).min(2.0 * ahead.abs()).min(0.5 * (behind + ahead).abs());
    least.copysign(ahead)
}

#[cfg(test)]
mod tests {
    use super::super::potential::tests::water;
    use super::*;
    use crate::state::Columns;

    const FOREVER: f64 = 1e30;

    fn blob(columns: &Columns, at: [f64; 2], size: f64) -> FoamState {
        let mut foam = FoamState::new([columns.nx, columns.nz], columns.width, 0.0, 4.0);
        for (column, density) in foam.density.iter_mut().enumerate() {
            let x = (column % columns.nx) as f64 * columns.width[0] - at[0];
            let z = (column / columns.nx) as f64 * columns.width[1] - at[1];
            *density = (0.8 * (-(x * x + z * z) / (size * size)).exp()) as f32;
        }
        foam
    }

    fn mass(foam: &FoamState) -> f64 {
        foam.density.iter().map(|&density| f64::from(density)).sum()
    }

    fn centre(foam: &FoamState) -> [f64; 2] {
        [0, 1].map(|axis| {
            let sum: f64 = (0..foam.density.len())
                .map(|column| {
                    let place = [column % foam.count[0], column / foam.count[0]][axis] as f64 * foam.width[axis];
                    f64::from(foam.density[column]) * place
                })
                .sum();
            sum / mass(foam)
        })
    }

    #[test]
    fn an_even_flow_carries_foam_at_its_speed_and_loses_none() {
        for (flow, dt, steps) in [([1.5, 0.6], 0.01, 200), ([1.5, 0.6], 1.0 / 24.0, 48), ([6.0, 2.4], 0.125, 4)] {
            let columns = water([60, 40], 0.125, |_, _| flow);
            let mut foam = blob(&columns, [1.5, 1.5], 0.5);
            let (start, before, top) = (centre(&foam), mass(&foam), 0.8);
            let none = vec![0.0; 2400];
            (0..steps).for_each(|_| foam.step(&WaterMap::of(&columns, 0.001), &none, FOREVER, dt));
            let time = dt * f64::from(steps);
            let end = centre(&foam);
            for axis in 0..2 {
                let moved = end[axis] - start[axis];
                assert!((moved / (flow[axis] * time) - 1.0).abs() < 0.01, "{flow:?} axis {axis}: {moved}");
            }
            assert!((mass(&foam) / before - 1.0).abs() < 1e-4, "{} of {before}", mass(&foam));
            let highest = foam.density.iter().fold(0.0f32, |most, &density| most.max(density));
            assert!(highest > 0.75 * top && highest <= 1.0, "smeared to {highest}");
            // The coordinates lead back to where the water was: those of the first layer since time 0.
            let middle = foam.offset[0][20 * 60 + 30];
            if time < 4.0 {
                assert!((0..2).all(|axis| (f64::from(middle[axis]) + flow[axis] * time).abs() < 1e-3), "{middle:?}");
            }
        }
    }

    #[test]
    fn foam_gathers_where_the_flow_converges_and_its_mass_stays() {
        let columns = water([40, 10], 0.25, |x, _| [if x < 5.0 { 1.0 } else { -1.0 }, 0.0]);
        let mut foam = FoamState::new([40, 10], columns.width, 0.0, 2.0);
        foam.density.fill(0.05);
        let before = mass(&foam);
        let none = vec![0.0; 400];
        (0..40).for_each(|_| foam.step(&WaterMap::of(&columns, 0.001), &none, FOREVER, 0.025));
        assert!((mass(&foam) / before - 1.0).abs() < 1e-4);
        assert!(foam.density[5 * 40 + 20] > 0.15 && foam.density[5 * 40] < 0.02);
        // Saturated: never above 1.
        foam.density.fill(0.9);
        (0..40).for_each(|_| foam.step(&WaterMap::of(&columns, 0.001), &none, FOREVER, 0.025));
        assert!(foam.density.iter().all(|density| (0.0..=1.0).contains(density)));
    }

    #[test]
    fn foam_dies_to_a_share_of_one_over_e_in_its_lifetime() {
        let columns = water([6, 5], 0.25, |_, _| [0.0; 2]);
        for steps in [1, 7, 100] {
            let mut foam = FoamState::new([6, 5], columns.width, 0.0, 2.0);
            foam.density.fill(0.6);
            (0..steps).for_each(|_| foam.step(&WaterMap::of(&columns, 0.001), &[0.0; 30], 2.5, 2.5 / f64::from(steps)));
            let share = f64::from(foam.density[14]) / 0.6;
            assert!((share / (-1f64).exp() - 1.0).abs() < 1e-4, "{steps}: {share}");
        }
        // With air coming in, to the balance p / (p + 1 / lifetime).
        let mut foam = FoamState::new([6, 5], columns.width, 0.0, 2.0);
        (0..100).for_each(|_| foam.step(&WaterMap::of(&columns, 0.001), &[0.4; 30], 2.5, 0.5));
        assert!((foam.density[14] - 0.5).abs() < 1e-5);
    }

    #[test]
    fn dry_columns_hold_no_foam_and_let_none_through() {
        let mut columns = water([20, 9], 0.25, |_, _| [1.0, 0.0]);
        (0..180).filter(|i| i % 20 == 10).for_each(|i| columns.top[i] = 0.0);
        let mut foam = blob(&columns, [1.0, 1.0], 0.6);
        foam.clear(|column| column % 20 > 9);
        (0..100).for_each(|_| foam.step(&WaterMap::of(&columns, 0.001), &[0.0; 180], FOREVER, 0.1));
        assert!((0..180).filter(|i| i % 20 >= 10).all(|i| foam.density[i] == 0.0));
        assert!(foam.density[4 * 20 + 9] > 0.1);
        // Beside the bank, the pattern's coordinates go on into the dry.
        assert!(foam.offset[0][4 * 20 + 10][0] < 0.0);
    }

    #[test]
    fn layers_start_anew_in_turn() {
        let columns = water([6, 5], 0.25, |_, _| [1.0, -0.5]);
        let mut foam = FoamState::new([6, 5], columns.width, 0.0, 2.0);
        for step in 1..=70 {
            foam.step(&WaterMap::of(&columns, 0.001), &[0.0; 30], 2.5, 0.1);
            for layer in 0..LAYERS {
                let (_, passed) = foam.phase(layer);
                let since = (passed * 2.0).min(0.1 * f64::from(step));
                let offset = foam.offset[layer][14];
                assert!(
                    (f64::from(offset[0]) + since).abs() < 1e-4 && (f64::from(offset[1]) - 0.5 * since).abs() < 1e-4
                );
            }
        }
        let phases = [0, 1].map(|layer| foam.phase(layer).1);
        assert!(((phases[0] - phases[1]).abs() - 0.5).abs() < 1e-9);
    }

    #[test]
    fn mad_flows_leave_the_foam_sound() {
        let mut columns = water([20, 9], 0.25, |x, z| [1e200 * (x - 2.0), -1e9 * z]);
        columns.flow[33] = [f64::MAX, f64::MIN];
        let mut foam = blob(&columns, [1.0, 1.0], 0.6);
        for dt in [1e-9, 0.04, 1e6] {
            foam.step(&WaterMap::of(&columns, 0.001), &[1e30; 180], 0.001, dt);
            assert!(foam.density.iter().all(|density| (0.0..=1.0).contains(density)));
            assert!(foam.offset.iter().flatten().flatten().all(|offset| offset.is_finite()));
        }
    }
}
