//! Spray: the water that broke free of the columns, as particles, until it falls back into them (appendix A of the report).
//!
//! `shed` says when and where particles break free, `flight` what happens to one of them, `surroundings` what it can meet,
//! `random` where its numbers come from. Here are the store, the step over all particles and what others ask of it.
//! Mass is exact: what the columns lose the particles have, and what particles lose a column has or left the map.

mod flight;
mod random;
mod shed;
mod surroundings;
#[cfg(test)]
mod tests;

use glam::DVec3;
use rayon::prelude::*;
use serde::Serialize;

use super::solids::Solids;
use super::{Grid, Water};
use crate::scene::SpraySettings;
use crate::state;
use flight::{DENSITY, Drop, Fate, Gift, Rules};
use shed::Weir;
use surroundings::Surroundings;

/// Particles that one task flies. The tasks' sums are added in order, so that the number of threads shows nowhere.
const PARTICLES_PER_TASK: usize = 1024;

/// Every bit that the next step depends on. One value for each particle, in the order in which they broke free; one for
/// each column.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SprayState {
    /// x, y, z of each particle (m).
    pub position: Vec<[f64; 3]>,
    /// Velocity (m/s).
    pub velocity: Vec<[f64; 3]>,
    /// Mass (kg).
    pub mass: Vec<f64>,
    /// Mass when it broke free (kg).
    pub first_mass: Vec<f64>,
    /// Time since then (s).
    pub age: Vec<f64>,
    /// A number of its own.
    pub id: Vec<u64>,
    /// What went over each column's four faces (east, west, south, north) and is in no particle yet (m3).
    pub demand: Vec<[f64; 4]>,
    /// The faces that add to it, as the bits of `shedding`.
    pub gathering: Vec<u8>,
    /// The faces that shed: bits east 1, west 2, south 4, north 8.
    pub shedding: Vec<u8>,
    /// Pressure of the particles in each column (Pa).
    pub pressure: Vec<f64>,
    /// Energy of motion that each column got from particles in the last step (J).
    pub impacts: Vec<f64>,
    /// Id of the next particle.
    pub next_id: u64,
    /// What left the map (kg).
    pub left: f64,
    /// How particles came and went.
    pub counts: SprayCounts,
}

/// How spray came and went since the beginning.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct SprayCounts {
    /// Particles that broke free.
    pub shed: u64,
    /// Particles that the columns took up.
    pub absorbed: u64,
    /// Particles that left the map over a sink.
    pub left: u64,
    /// Particles that stayed in the columns because there were too many.
    pub refused: u64,
}

/// The spray of one map.
#[derive(Clone, Debug)]
pub struct Spray {
    grid: Grid,
    seed: u64,
    enabled: bool,
    /// Volume of a particle (m3).
    volume: f64,
    most: usize,
    weir: Weir,
    rules: Rules,
    solids: Solids,
    state: SprayState,
    /// Faces that are due in this step.
    due: Vec<u8>,
    /// How many particles were there before this step.
    born: usize,
    /// Whether any column has pressure.
    presses: bool,
    /// What each task hands out; kept, to allocate once.
    tasks: Vec<Task>,
}

/// What comes out of one task of particles.
#[derive(Clone, Debug, Default)]
struct Task {
    gifts: Vec<Gift>,
    absorbed: u64,
    gone: u64,
    left: f64,
}

impl Spray {
    /// No particles yet, over a map of columns.
    ///
    /// *Units*: gravity in m/s2. Without `settings.volume` a particle is a ball whose radius is a tenth of a column's smaller
    /// width; without `settings.least_height` a crest is at least as high as a particle.
    pub fn new(settings: &SpraySettings, gravity: f64, seed: u64, solids: Solids, grid: Grid) -> Self {
        let width = grid.width[0].min(grid.width[1]);
        let volume = settings.volume.unwrap_or(4.0 / 3.0 * std::f64::consts::PI * (0.1 * width).powi(3));
        let diameter = 2.0 * flight::radius(volume * DENSITY);
        let columns = grid.count();
        let state = SprayState {
            demand: vec![[0.0; 4]; columns],
            gathering: vec![0; columns],
            shedding: vec![0; columns],
            pressure: vec![0.0; columns],
            impacts: vec![0.0; columns],
            ..SprayState::default()
        };
        Self {
            grid,
            seed,
            enabled: settings.enabled,
            volume,
            most: settings.most as usize,
            weir: Weir {
                gravity,
                threshold: settings.threshold,
                least_height: settings.least_height.unwrap_or(diameter),
                discharge: settings.discharge,
            },
            rules: Rules { gravity, restitution: settings.restitution, absorption_time: settings.absorption_time },
            solids,
            state,
            due: vec![0; columns],
            born: 0,
            presses: false,
            tasks: Vec::new(),
        }
    }

    /// Lets all particles fly for `dt` seconds, and the columns have what falls into them.
    ///
    /// *Shape*: `sink` one per column; particles that fall into a sink's columns leave the map.
    ///
    /// # Panics
    /// If the map is not the water's, or `sink` has not one flag per column.
    pub fn fly(&mut self, water: &mut Water, dt: f64, sink: &[bool]) {
        assert_eq!(water.grid(), &self.grid, "the spray's map is the water's");
        assert_eq!(sink.len(), self.grid.count(), "one flag per column");
        if std::mem::take(&mut self.presses) {
            self.state.pressure.fill(0.0);
            self.state.impacts.fill(0.0);
        }
        let count = self.state.mass.len();
        if count == 0 {
            return;
        }
        let solids = std::mem::take(&mut self.solids);
        let around = Surroundings { grid: self.grid, base: water.base(), depth: water.depth(), sink, solids: &solids };
        self.tasks.resize_with(count.div_ceil(PARTICLES_PER_TASK).max(self.tasks.len()), Task::default);
        let (rules, born) = (self.rules, self.born);
        let SprayState { position, velocity, mass, first_mass, age, .. } = &mut self.state;
        let chunks = position
            .par_chunks_mut(PARTICLES_PER_TASK)
            .zip(velocity.par_chunks_mut(PARTICLES_PER_TASK))
            .zip(mass.par_chunks_mut(PARTICLES_PER_TASK))
            .zip(first_mass.par_chunks(PARTICLES_PER_TASK))
            .zip(age.par_chunks_mut(PARTICLES_PER_TASK))
            .zip(self.tasks.par_iter_mut());
        chunks.enumerate().for_each(|(chunk, (((((position, velocity), mass), first_mass), age), task))| {
            task.gifts.clear();
            (task.absorbed, task.gone, task.left) = (0, 0, 0.0);
            for index in 0..mass.len() {
                // A new particle's age says when in this step, or a little before, it broke free.
                let new = chunk * PARTICLES_PER_TASK + index >= born;
                let time = if new { dt + age[index] } else { dt };
                let mut drop = Drop {
                    position: DVec3::from_array(position[index]),
                    velocity: DVec3::from_array(velocity[index]),
                    mass: mass[index],
                    first_mass: first_mass[index],
                };
                if new {
                    // Born on a bank, it may lie a rounding under it.
                    drop.position.y = drop.position.y.max(around.ground(drop.position));
                }
                match drop.fly(&around, &rules, time, |gift| task.gifts.push(gift)) {
                    Fate::Flies => {}
                    Fate::Absorbed => task.absorbed += 1,
                    Fate::Left => {
                        task.gone += 1;
                        task.left += drop.mass;
                        drop.mass = 0.0;
                    }
                }
                age[index] = if new { time } else { age[index] + dt };
                (position[index], velocity[index]) = (drop.position.to_array(), drop.velocity.to_array());
                mass[index] = drop.mass;
            }
        });
        self.solids = solids;
        self.settle(water, dt, count);
        self.born = self.state.mass.len();
    }

    /// Hands out what the tasks gathered, in their order, and drops the particles that are no more.
    fn settle(&mut self, water: &mut Water, dt: f64, count: usize) {
        let state = &mut self.state;
        let mut gone = 0;
        for task in &self.tasks[..count.div_ceil(PARTICLES_PER_TASK)] {
            for gift in &task.gifts {
                water.give(gift.column, gift.mass / DENSITY);
                state.pressure[gift.column] += gift.impulse / (self.grid.area() * dt);
                state.impacts[gift.column] += gift.energy;
                self.presses = true;
            }
            state.left += task.left;
            state.counts.absorbed += task.absorbed;
            state.counts.left += task.gone;
            gone += task.absorbed + task.gone;
        }
        if gone > 0 {
            let alive = |index: &usize| state.mass[*index] > 0.0;
            let mut kept = 0;
            for index in (0..count).filter(alive).collect::<Vec<_>>() {
                state.position[kept] = state.position[index];
                state.velocity[kept] = state.velocity[index];
                state.mass[kept] = state.mass[index];
                state.first_mass[kept] = state.first_mass[index];
                state.age[kept] = state.age[index];
                state.id[kept] = state.id[index];
                kept += 1;
            }
            state.truncate(kept);
        }
    }

    /// The faces that shed, for the water's next step: bits east 1, west 2, south 4, north 8 per column.
    pub fn shedding(&self) -> &[u8] {
        &self.state.shedding
    }

    /// Pressure (Pa) of the particles in each column, averaged over the last step; empty if none had any.
    pub fn pressure(&self) -> &[f64] {
        if self.presses { &self.state.pressure } else { &[] }
    }

    /// Energy of motion (J) that each column got from particles in the last step; empty if none had any.
    pub fn impacts(&self) -> &[f64] {
        if self.presses { &self.state.impacts } else { &[] }
    }

    /// How many particles there are.
    pub fn len(&self) -> usize {
        self.state.mass.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.state.mass.is_empty()
    }

    /// Volume (m3) of a whole particle.
    pub fn volume(&self) -> f64 {
        self.volume
    }

    /// Mass of all particles (kg), by a compensated sum in their order.
    pub fn mass(&self) -> f64 {
        let (mut sum, mut lost) = (0.0f64, 0.0);
        for &mass in &self.state.mass {
            // Neumaier's sum: what an addition rounds off is added at the end.
            let total = sum + mass;
            lost += if sum >= mass { (sum - total) + mass } else { (mass - total) + sum };
            sum = total;
        }
        sum + lost
    }

    /// Mass that left the map over sinks (kg).
    pub fn left(&self) -> f64 {
        self.state.left
    }

    /// How particles came and went.
    pub fn counts(&self) -> SprayCounts {
        self.state.counts
    }

    /// The particles as a frame holds them.
    pub fn particles(&self) -> state::Particles {
        state::Particles {
            position: self.state.position.clone(),
            velocity: self.state.velocity.clone(),
            mass: self.state.mass.clone(),
            // Before its first flight a particle may be about to break free within the step.
            age: self.state.age.iter().map(|age| age.max(0.0)).collect(),
            id: Some(self.state.id.clone()),
        }
    }

    /// All that the next step depends on, after a flight.
    pub fn state(&self) -> SprayState {
        self.state.clone()
    }

    /// Goes on from a state; false, and nothing changed, if it is not one of this map or its arrays differ in length.
    #[must_use]
    pub fn set_state(&mut self, state: SprayState) -> bool {
        let (particles, columns) = (state.mass.len(), self.grid.count());
        let fits =
            [state.position.len(), state.velocity.len(), state.first_mass.len(), state.age.len(), state.id.len()]
                .iter()
                .all(|length| *length == particles)
                && [state.gathering.len(), state.shedding.len(), state.pressure.len(), state.impacts.len()]
                    .iter()
                    .all(|length| *length == columns)
                && state.demand.len() == columns;
        let numbers = |values: &[f64]| values.iter().all(|value| value.is_finite());
        let sound = numbers(state.position.as_flattened())
            && numbers(state.velocity.as_flattened())
            && state.mass.iter().chain(&state.first_mass).all(|mass| mass.is_finite() && *mass > 0.0)
            && numbers(&state.age)
            && numbers(state.demand.as_flattened())
            && numbers(&state.pressure)
            && numbers(&state.impacts);
        if !(fits && sound) {
            return false;
        }
        self.born = particles;
        self.presses = state.pressure.iter().chain(&state.impacts).any(|value| *value != 0.0);
        self.state = state;
        true
    }
}

impl SprayState {
    /// Keeps the first particles.
    fn truncate(&mut self, count: usize) {
        self.position.truncate(count);
        self.velocity.truncate(count);
        self.mass.truncate(count);
        self.first_mass.truncate(count);
        self.age.truncate(count);
        self.id.truncate(count);
    }
}
