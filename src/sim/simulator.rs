//! One simulation: what happens in a step and in which order, how long steps are, and what a frame shows of it.
//!
//! The order of a step: forces, water, what is poured in, spray breaking free, spray flying, columns that keep their height, turbulence.
//! Files are not written here; `checkpoint` keeps what frames do not.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use rayon::prelude::*;
use serde::Serialize;

use super::foam::CarriedFoam;
use super::ledger::{Balance, Ledger};
use super::spray::{Spray, SprayCounts, SprayState};
use super::turbulence::Turbulence;
use super::{Forcing, Setup, SimError, Solids, Water, WaterSettings};
use crate::scene;
use crate::state::{Columns, Frame};

/// Mass of water (kg/m3), as the frames' format has it.
const DENSITY: f64 = 1000.0;

/// Seconds of wall clock by phase.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Phases {
    /// Columns and pipes, sources and sinks.
    pub water: f64,
    /// Particles.
    pub spray: f64,
    /// Turbulence, aeration and foam.
    pub turbulence: f64,
}

impl std::ops::Sub for Phases {
    type Output = Self;

    fn sub(self, other: Self) -> Self {
        Self {
            water: self.water - other.water,
            spray: self.spray - other.spray,
            turbulence: self.turbulence - other.turbulence,
        }
    }
}

/// What was done since the simulator was made.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Work {
    /// Steps.
    pub steps: u64,
    /// The shortest of them (s); infinite before the first.
    pub least_step: f64,
    /// The longest (s).
    pub greatest_step: f64,
    /// Where the time went.
    pub seconds: Phases,
}

/// Where a simulation is, told after each step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moment {
    /// Simulated time (s).
    pub time: f64,
    /// Steps since the simulator was made.
    pub steps: u64,
    /// Particles now.
    pub particles: usize,
}

/// How [`Simulator::advance_to`] ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[must_use]
pub enum Advance {
    /// At the time that was asked for.
    Reached,
    /// Somewhere before it, because it was told to stop.
    Stopped,
}

/// Every bit that the next step depends on, besides the setup.
#[derive(Clone, Debug, PartialEq)]
pub struct SimulatorState {
    /// Simulated time (s).
    pub time: f64,
    /// Depth of each column (m).
    pub depth: Vec<f64>,
    /// Velocity in each pipe (m/s), in the water's own order.
    pub pipes: Vec<f64>,
    /// The spray, if the scene has any.
    pub spray: Option<SprayState>,
    /// Turbulence and aeration, in their own order.
    pub turbulence: Vec<f64>,
    /// Foam, in its own order; empty without.
    pub foam: Vec<f64>,
    /// What entered and left.
    pub ledger: Ledger,
}

/// A simulation under way.
pub struct Simulator {
    setup: Setup,
    water: Water,
    spray: Option<Spray>,
    turbulence: Turbulence,
    foam: Option<CarriedFoam>,
    ledger: Ledger,
    time: f64,
    /// The longest step that the scene allows (s).
    longest: f64,
    /// Seconds from one frame to the next, and how many steps they may take.
    frame: f64,
    most_steps: u32,
    /// Columns that spray leaves by.
    sink: Vec<bool>,
    /// External pressure (Pa) on each column; empty for none.
    pressure: Vec<f64>,
    /// Turbulent velocity (m/s) in each column.
    speeds: Vec<f64>,
    work: Work,
}

impl Simulator {
    /// A simulation at its start, `settings.settle` seconds before frame 0. `frame` is the time between frames (s).
    ///
    /// Columns that keep their height have it from the start.
    ///
    /// # Errors
    /// A frame that would take too many steps at the longest step of the scene.
    pub fn new(setup: Setup, settings: &scene::Simulation, frame: f64) -> Result<Self, SimError> {
        let longest = settings.step.unwrap_or(f64::INFINITY);
        let steps = (frame / longest).ceil();
        if steps > f64::from(settings.most_steps) {
            return Err(SimError::StepTooShort { step: longest, frame, steps, most: settings.most_steps });
        }
        let water_settings = WaterSettings {
            gravity: settings.gravity,
            friction: settings.friction,
            reference_step: settings.reference_step,
            manning: settings.manning,
            cell_height: settings.cell_height,
            courant: settings.courant,
        };
        let grid = setup.grid;
        let water = Water::new(grid, setup.base.clone(), setup.depth.clone(), water_settings);
        let spray = match settings.spray.enabled {
            false => None,
            true => {
                let solids = Solids::new(&setup.solids)?;
                Some(Spray::new(&settings.spray, settings.gravity, u64::from(settings.seed), solids, grid))
            }
        };
        let mut sink = vec![false; grid.count()];
        for held in &setup.held {
            sink[held.column] |= held.sink;
        }
        let mut ledger = Ledger::default();
        ledger.book(water.volume());
        let mut this = Self {
            turbulence: Turbulence::new(grid.count()),
            foam: None,
            water,
            spray,
            ledger,
            // Not its negative, which without settling would be -0.
            time: 0.0 - settings.settle,
            longest,
            frame,
            most_steps: settings.most_steps,
            sink,
            pressure: Vec::new(),
            speeds: vec![0.0; grid.count()],
            work: Work { least_step: f64::INFINITY, ..Work::default() },
            setup,
        };
        this.hold(this.time);
        Ok(this)
    }

    /// The same with foam, in columns deeper than `dry_threshold` (m).
    pub fn with_foam(mut self, settings: &scene::Foam, dry_threshold: f64) -> Self {
        self.foam = Some(CarriedFoam::new(settings, dry_threshold, &self.setup.grid, self.time));
        self
    }

    /// Simulated time (s); frame 0 is at 0.
    pub fn time(&self) -> f64 {
        self.time
    }

    /// What was done since [`Simulator::new`].
    pub fn work(&self) -> Work {
        self.work
    }

    /// How spray came and went.
    pub fn counts(&self) -> SprayCounts {
        self.spray.as_ref().map(Spray::counts).unwrap_or_default()
    }

    /// How many particles there are.
    pub fn particles(&self) -> usize {
        self.spray.as_ref().map_or(0, Spray::len)
    }

    /// The account of all water.
    pub fn balance(&self) -> Balance {
        let [particles, left] = self.spray.as_ref().map_or([0.0; 2], |spray| [spray.mass(), spray.left()]);
        self.ledger.balance(self.water.volume(), particles / DENSITY, left / DENSITY)
    }

    /// Takes steps until `time` (s). Which steps depends on nothing but the state and `time`. `stop` is looked at before
    /// each; the state that it leaves is sound, but at no frame's time.
    ///
    /// # Errors
    /// Waves so fast that a frame would take too many steps; a state that is no longer finite.
    pub fn advance_to(
        &mut self,
        time: f64,
        stop: &AtomicBool,
        observe: &mut dyn FnMut(Moment),
    ) -> Result<Advance, SimError> {
        while self.time < time {
            if stop.load(Ordering::Relaxed) {
                return Ok(Advance::Stopped);
            }
            let (step, last) = self.next_step(time - self.time)?;
            self.step(step);
            // Set, not added: no rounding of the steps before it shows in a frame's time.
            self.time = if last { time } else { self.time + step };
            if let (true, Some(foam)) = (last, &mut self.foam) {
                foam.settle(&self.water, &self.sink, self.time);
            }
            observe(Moment { time: self.time, steps: self.work.steps, particles: self.particles() });
        }
        self.check_finite()?;
        Ok(Advance::Reached)
    }

    /// The next step (s) of those that fill `remaining` evenly, and whether it is the last of them.
    fn next_step(&self, remaining: f64) -> Result<(f64, bool), SimError> {
        let largest = self.water.largest_step();
        let limit = largest.seconds.min(self.longest);
        let steps = self.frame / limit;
        // Written so that a speed which is no number is refused too.
        if !(limit > 0.0 && steps <= f64::from(self.most_steps)) {
            let (nx, speed) = (self.setup.grid.nx, largest.speed);
            let column = [largest.column % nx, largest.column / nx];
            return Err(SimError::TooManySteps { time: self.time, column, speed, steps, most: self.most_steps });
        }
        let limit = limit.min(self.frame);
        let count = (remaining / limit).ceil().max(1.0);
        Ok((remaining / count, count == 1.0))
    }

    /// One step from the present time.
    fn step(&mut self, dt: f64) {
        let clock = Instant::now();
        self.press();
        let shedding = self.spray.as_ref().map_or(&[][..], Spray::shedding);
        self.water.step(dt, &Forcing { pressure: &self.pressure, shedding });
        self.pour(dt);
        let watered = Instant::now();
        if let Some(spray) = &mut self.spray {
            self.speeds.iter_mut().enumerate().for_each(|(column, speed)| *speed = self.turbulence.speed(column));
            spray.shed(&mut self.water, dt, &self.sink, &self.speeds);
            spray.fly(&mut self.water, dt, &self.sink);
        }
        // After the spray, which takes water from columns and gives it to others.
        self.hold(self.time + dt);
        let sprayed = Instant::now();
        // After the spray, whose impacts it needs: so they are no state of their own.
        let impacts = self.spray.as_ref().map_or(&[][..], Spray::impacts);
        self.turbulence.step(&self.water, dt, impacts);
        if let Some(foam) = &mut self.foam {
            foam.step(&self.water, impacts, &self.sink, dt);
        }
        let work = &mut self.work;
        work.steps += 1;
        work.least_step = work.least_step.min(dt);
        work.greatest_step = work.greatest_step.max(dt);
        work.seconds.water += (watered - clock).as_secs_f64();
        work.seconds.spray += (sprayed - watered).as_secs_f64();
        work.seconds.turbulence += sprayed.elapsed().as_secs_f64();
    }

    /// Gathers the external pressure at the present time: the scene's and that of spray in the water.
    fn press(&mut self) {
        self.pressure.clear();
        let spray = self.spray.as_ref().map_or(&[][..], Spray::pressure);
        let time = self.time;
        let mut active = self.setup.pressures.iter().filter(|pressed| pressed.begin <= time && time < pressed.end);
        let first = active.next();
        if spray.is_empty() && first.is_none() {
            return;
        }
        self.pressure.extend_from_slice(spray);
        self.pressure.resize(self.setup.grid.count(), 0.0);
        for pressed in first.into_iter().chain(active) {
            for &column in &pressed.columns {
                self.pressure[column] += pressed.pascal;
            }
        }
    }

    /// Rain and inflows of a step that begins at the present time; one that begins or ends within it counts in part.
    fn pour(&mut self, dt: f64) {
        let seconds = |begin: f64, end: f64| {
            let (begin, end) = (begin.max(self.time), end.min(self.time + dt));
            // The whole step is dt itself, not what rounding leaves of it.
            if begin == self.time && end == self.time + dt { dt } else { (end - begin).max(0.0) }
        };
        let rain = self.setup.rain_rate * seconds(f64::NEG_INFINITY, self.setup.rain_end) * self.setup.grid.area();
        if rain > 0.0 {
            let columns = self.setup.grid.count();
            for column in 0..columns {
                self.water.give(column, rain);
            }
            self.ledger.book(rain * columns as f64);
        }
        for inflow in &self.setup.inflows {
            let volume = inflow.rate * seconds(inflow.begin, inflow.end);
            if volume > 0.0 {
                let each = volume / inflow.columns.len() as f64;
                for &column in &inflow.columns {
                    self.water.give(column, each);
                }
                self.ledger.book(volume);
            }
        }
    }

    /// Gives the columns that keep their height at `time` that height; the ledger says what it took.
    fn hold(&mut self, time: f64) {
        for held in &self.setup.held {
            if held.begin <= time && time < held.end {
                self.ledger.book(self.water.set_depth(held.column, held.depth));
            }
        }
    }

    fn check_finite(&self) -> Result<(), SimError> {
        match self.water.depth().iter().position(|depth| !depth.is_finite()) {
            None => Ok(()),
            Some(i) => {
                let nx = self.setup.grid.nx;
                Err(SimError::NotFinite { time: self.time, column: [i % nx, i / nx] })
            }
        }
    }

    /// What a frame shows of the present. What balances the mass and lies in space is in double precision; pressure,
    /// flow, velocity and age are rounded to single, so that archives hold half of their bytes and text the same numbers.
    pub fn frame(&mut self) -> Frame {
        self.press();
        let Setup { grid, base, .. } = &self.setup;
        let columns = 0..grid.count();
        let external = |column: usize| self.pressure.get(column).copied().unwrap_or(0.0);
        let water = &self.water;
        let columns = Columns {
            origin: grid.origin,
            width: grid.width,
            nx: grid.nx,
            nz: grid.nz,
            base: base.clone(),
            top: columns.clone().map(|column| water.top(column)).collect(),
            pressure: columns
                .clone()
                .into_par_iter()
                .map(|column| single(water.pressure_at_base(column, external(column))))
                .collect(),
            flow: columns.into_par_iter().map(|column| water.flow_at(column).map(single)).collect(),
        };
        let mut particles = self.spray.as_ref().map(Spray::particles).unwrap_or_default();
        particles.velocity.as_flattened_mut().iter_mut().for_each(|velocity| *velocity = single(*velocity));
        particles.age.iter_mut().for_each(|age| *age = single(*age));
        Frame { time: self.time, columns, particles, extra: Vec::new() }
    }

    /// The maps that a frame carries besides; what they mean is in [`crate::state::maps`].
    pub fn maps(&self) -> Vec<(&'static str, Vec<f32>)> {
        let mut maps = self.turbulence.maps(&self.water).to_vec();
        maps.extend(self.foam.iter().flat_map(CarriedFoam::arrays));
        maps
    }

    /// All that the next step depends on.
    pub fn state(&self) -> SimulatorState {
        SimulatorState {
            time: self.time,
            depth: self.water.depth().to_vec(),
            pipes: self.water.pipes(),
            spray: self.spray.as_ref().map(Spray::state),
            turbulence: self.turbulence.state(),
            foam: self.foam.as_ref().map(CarriedFoam::state).unwrap_or_default(),
            ledger: self.ledger,
        }
    }

    /// Goes on from a state of a simulation of the same setup; false, which leaves this in no state to go on, if it is none.
    #[must_use]
    pub fn resume(&mut self, state: SimulatorState) -> bool {
        let count = self.setup.grid.count();
        let fits = state.depth.len() == count
            && state.depth.iter().all(|depth| *depth >= 0.0 && depth.is_finite())
            && state.spray.is_some() == self.spray.is_some();
        if !fits || !self.water.set_pipes(&state.pipes) || !self.turbulence.set_state(&state.turbulence) {
            return false;
        }
        if let (Some(spray), Some(state)) = (&mut self.spray, state.spray)
            && !spray.set_state(state)
        {
            return false;
        }
        if !self.foam.as_mut().map_or(state.foam.is_empty(), |foam| foam.set_state(&state.foam)) {
            return false;
        }
        for (column, depth) in state.depth.into_iter().enumerate() {
            self.water.set_depth(column, depth);
        }
        (self.time, self.ledger) = (state.time, state.ledger);
        true
    }
}

/// Rounded to single precision.
fn single(value: f64) -> f64 {
    f64::from(value as f32)
}
