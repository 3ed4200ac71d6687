//! Foam carried along in a simulation: when it moves, where it leaves, and its state between two frames.
//!
//! What makes it and how it moves is the room `foam`; here is only the pace. Foam does not act back on anything.

use super::{Grid, Water};
use crate::foam::{FoamState, WaterMap, potential::impact_power};
use crate::scene;
use crate::state::StoredFoam;

/// Columns that the fastest water may cross before foam is moved: each move costs, and blurs the pattern's coordinates a
/// little, so several of the water's steps go into one.
const CROSSED: f64 = 0.5;

/// The foam of a simulation.
#[derive(Clone, Debug)]
pub(super) struct CarriedFoam {
    settings: scene::Foam,
    dry_threshold: f64,
    foam: FoamState,
    /// Seconds since the foam was last moved.
    pending: f64,
    /// Energy (J) that each column got from spray since then.
    impacts: Vec<f64>,
    top: Vec<f64>,
    flow: Vec<[f64; 2]>,
}

impl CarriedFoam {
    /// None yet, at `time` (s).
    pub(super) fn new(settings: &scene::Foam, dry_threshold: f64, grid: &Grid, time: f64) -> Self {
        Self {
            foam: FoamState::new([grid.nx, grid.nz], grid.width, time, settings.renewal),
            settings: settings.clone(),
            dry_threshold,
            pending: 0.0,
            impacts: vec![0.0; grid.count()],
            top: vec![0.0; grid.count()],
            flow: vec![[0.0; 2]; grid.count()],
        }
    }

    /// After a step of `dt` seconds of the water: moves the foam if the water has gone far enough. `impacts` is the energy (J)
    /// that each column got from spray, or empty for none.
    pub(super) fn step(&mut self, water: &Water, impacts: &[f64], sink: &[bool], dt: f64) {
        self.pending += dt;
        self.impacts.iter_mut().zip(impacts).for_each(|(sum, impact)| *sum += impact);
        water.flow_into(&mut self.flow);
        let width = water.grid().width;
        let crossed = |flow: &[f64; 2]| (flow[0].abs() / width[0]).max(flow[1].abs() / width[1]);
        let fastest = self.flow.iter().map(crossed).fold(0.0, f64::max);
        if fastest * (self.pending + dt) > CROSSED {
            self.advance(water, sink);
        }
    }

    /// Moves the foam to the present, which is exactly `time`: so every frame shows it, whatever the pace.
    pub(super) fn settle(&mut self, water: &Water, sink: &[bool], time: f64) {
        if self.pending > 0.0 {
            water.flow_into(&mut self.flow);
            self.advance(water, sink);
        }
        self.foam.set_time(time);
    }

    fn advance(&mut self, water: &Water, sink: &[bool]) {
        self.top.iter_mut().enumerate().for_each(|(column, top)| *top = water.top(column));
        let map = WaterMap {
            count: self.foam.count(),
            width: self.foam.width(),
            base: water.base(),
            top: &self.top,
            // The water's own weight: what presses on it from outside moves it, and shows in its flow.
            pressure: &[],
            flow: &self.flow,
            impact: &[],
            dry_threshold: self.dry_threshold,
        };
        impact_power(&mut self.impacts, &map, self.pending);
        let production =
            WaterMap { impact: &self.impacts, ..map }.production(&self.settings.limits, &self.settings.rate);
        self.foam.step(&map, &production, self.settings.lifetime, self.pending);
        self.pending = 0.0;
        self.impacts.fill(0.0);
        // Water leaves by the sinks, and foam with it.
        self.foam.clear(|column| sink[column]);
    }

    /// What a frame carries of it.
    pub(super) fn arrays(&self) -> Vec<(&'static str, Vec<f32>)> {
        self.foam.to_stored().arrays()
    }

    /// All that the next step depends on: times, impacts, densities, offsets.
    pub(super) fn state(&self) -> Vec<f64> {
        let StoredFoam { density, offset, .. } = self.foam.to_stored();
        let values = density.into_iter().chain(offset.into_iter().flatten().flatten());
        let times = [self.foam.time(), self.pending].into_iter();
        times.chain(self.impacts.iter().copied()).chain(values.map(f64::from)).collect()
    }

    /// Goes on from a state; false, and nothing changed, if it is not one of this map.
    #[must_use]
    pub(super) fn set_state(&mut self, state: &[f64]) -> bool {
        let [nx, nz] = self.foam.count();
        let columns = nx * nz;
        if state.len() != 2 + columns * (2 + 2 * StoredFoam::LAYERS) || !state.iter().all(|value| value.is_finite()) {
            return false;
        }
        let (impacts, rest) = state[2..].split_at(columns);
        let single: Vec<f32> = rest.iter().map(|&value| value as f32).collect();
        let (density, offsets) = single.split_at(columns);
        if !density.iter().all(|density| (0.0..=1.0).contains(density)) || state[1] < 0.0 {
            return false;
        }
        let (pairs, _) = offsets.as_chunks();
        let mut layers = pairs.chunks_exact(columns);
        let offset = [0; StoredFoam::LAYERS].map(|_| layers.next().map(<[_]>::to_vec).unwrap_or_default());
        let stored = StoredFoam { density: density.to_vec(), offset, renewal: self.foam.to_stored().renewal };
        self.foam = FoamState::stored(self.foam.count(), self.foam.width(), state[0], stored);
        self.pending = state[1];
        self.impacts.copy_from_slice(impacts);
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sim::{Forcing, WaterSettings};

    fn grid() -> Grid {
        Grid { nx: 40, nz: 6, width: [0.25, 0.25], origin: [0.0, 0.0] }
    }

    fn run(base: impl Fn(usize) -> f64, depth: impl Fn(usize) -> f64, steps: usize) -> (CarriedFoam, Water) {
        let columns = 0..grid().count();
        let (base, depth) = (columns.clone().map(base).collect(), columns.map(depth).collect());
        let mut water = Water::new(grid(), base, depth, WaterSettings::default());
        let mut foam = CarriedFoam::new(&scene::Foam::default(), 0.001, &grid(), 0.0);
        let sink = vec![false; grid().count()];
        for _ in 0..steps {
            water.step(0.005, &Forcing::default());
            foam.step(&water, &[], &sink, 0.005);
        }
        foam.settle(&water, &sink, 0.005 * steps as f64);
        (foam, water)
    }

    #[test]
    fn a_dam_that_breaks_is_white_at_its_front_and_a_pond_is_not() {
        let (dam, _) = run(|_| 0.0, |column| if column % 40 < 12 { 1.5 } else { 0.2 }, 120);
        let most = dam.foam.density().iter().fold(0.0f32, |most, &density| most.max(density));
        assert!(most > 0.2, "{most}");
        let (pond, _) = run(|column| 0.01 * (column % 7) as f64, |column| 1.0 - 0.01 * (column % 7) as f64, 120);
        assert!(pond.foam.density().iter().all(|&density| density == 0.0));
        assert_eq!(pond.foam.time(), 0.6);
    }

    #[test]
    fn foam_leaves_by_sinks() {
        let (mut foam, water) = run(|_| 0.0, |column| if column % 40 < 12 { 1.5 } else { 0.2 }, 120);
        let sink: Vec<bool> = (0..grid().count()).map(|column| foam.foam.density()[column] > 0.1).collect();
        assert!(sink.contains(&true));
        foam.step(&water, &[], &sink, 1.0);
        assert!((0..sink.len()).all(|column| !sink[column] || foam.foam.density()[column] == 0.0));
    }

    #[test]
    fn a_state_goes_back_in_as_it_came_out() {
        let (mut foam, water) = run(|_| 0.0, |column| if column % 40 < 12 { 1.5 } else { 0.2 }, 100);
        foam.pending = 0.25;
        let state = foam.state();
        let mut other = CarriedFoam::new(&scene::Foam::default(), 0.001, &grid(), 0.0);
        assert!(other.set_state(&state));
        let sink = vec![false; grid().count()];
        foam.step(&water, &[], &sink, 0.1);
        other.step(&water, &[], &sink, 0.1);
        assert_eq!(foam.foam, other.foam);
        let changed = |index: usize, value: f64| {
            let mut state = state.clone();
            state[index] = value;
            state
        };
        for wrong in
            [changed(2 + 240, 1.5), changed(2 + 240, -0.1), changed(1, -1.0), changed(0, f64::NAN), state[1..].to_vec()]
        {
            assert!(!other.set_state(&wrong));
        }
    }
}
