//! The simulation's speed: milliseconds a step by phase, over sizes of the map; and its errors against closed forms.
//!
//! The work: a sloping valley with rough ground, half of it under running water, and 5 particles over each 8 columns
//! (100,000 at 400x400) that are put back in the air before every step, so that no size has spray that another has not.

use std::io::Write;
use std::sync::atomic::AtomicBool;

use super::rows::Row;
use super::sheet::{Sheet, number};
use super::{BenchError, Settings};
use crate::scene::{Landform, LandformKind, Simulation, SpraySettings};
use crate::sim::{Simulator, SimulatorState, prepare, trials};

/// Width of a column (m).
const WIDTH: f64 = 0.25;
/// Time between frames (s): one step each, as far as the waves allow.
const FRAME: f64 = 1.0 / 240.0;

/// Milliseconds a step: all, water, spray, turbulence.
type Times = [f64; 4];

/// Runs the table and prints it as it grows.
///
/// # Errors
/// The map cannot be made, the simulation fails, or a file of rows cannot be written.
pub fn run(settings: &Settings, out: &mut impl Write) -> Result<(), BenchError> {
    let mut sheet = Sheet::new(settings, out)?;
    let heads = ["columns", "wet", "particles", "steps/s", "ms a step", "water", "spray", "turbulence", "ns a column"];
    sheet.table(&heads)?;
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(settings.threads)
        .build()
        .map_err(|error| BenchError::Internal(error.to_string()))?;
    for &size in &settings.sizes {
        let columns = size[0] * size[1];
        let particles = columns * 5 / 8;
        let (times, wet) = pool.install(|| measure(size, particles, settings.quick))?;
        let [all, water, spray, turbulence] = times;
        let each = all * 1e6 / columns as f64;
        let mut cells = vec![super::size_name(size), format!("{:.0}%", wet * 100.0), particles.to_string()];
        cells.extend([1e3 / all, all, water, spray, turbulence, each].map(number));
        let row = Row {
            bench: "sim".to_owned(),
            columns: format!("{}x{}", size[0], size[1]),
            particles,
            ms_per_step: all,
            water_ms: water,
            spray_ms: spray,
            turbulence_ms: turbulence,
            threads: settings.threads,
            ..Row::default()
        };
        sheet.row(&cells, row)?;
    }
    errors(settings.quick, &mut sheet)
}

/// Errors against closed forms, and how they fall as columns become smaller.
fn errors(quick: bool, sheet: &mut Sheet) -> Result<(), BenchError> {
    let order = |errors: &[f64]| match errors {
        [.., coarse, fine] => format!("{:.2}", (coarse / fine).abs().log2()),
        _ => String::new(),
    };
    let row = |sheet: &mut Sheet, name: &str, errors: &[f64]| {
        let mut cells = vec![name.to_owned()];
        cells.extend((0..4).map(|k| errors.get(k).map_or_else(String::new, |error| format!("{:.3}", error * 100.0))));
        cells.push(order(errors));
        let finest = errors.last().map_or(0.0, |error| error.abs());
        let row = Row { bench: "sim-errors".to_owned(), dial: name.to_owned(), error_max: finest, ..Row::default() };
        sheet.row(&cells, row)
    };
    let finer = if quick { 2 } else { 4 };
    sheet.say("\nErrors in %, each with columns half as wide as the one before, and the last order of convergence.")?;
    sheet.table(&["against closed forms", "coarse", "1/2", "1/4", "1/8", "order"])?;
    for (name, right) in [
        ("dam break over 0.5 m (Stoker), L1 of depth", 0.5),
        ("dam break over 0.1 m (Stoker)", 0.1),
        ("dam break over a dry bed (Ritter)", 0.0),
    ] {
        let errors: Vec<f64> = (0..finer).map(|level| trials::dam_break(50 << level, right)).collect();
        row(sheet, name, &errors)?;
    }
    for (name, modes) in [
        ("period of a standing wave along x", [1, 0]),
        ("along z", [0, 1]),
        ("along a diagonal", [1, 1]),
        ("across it, two half waves by one", [2, 1]),
    ] {
        let period =
            |level: usize| trials::period([10 << level; 2], [0.1 / f64::from(1u32 << level); 2], modes, None) - 1.0;
        row(sheet, name, &(0..finer.min(3)).map(period).collect::<Vec<_>>())?;
    }
    let weirs: Vec<f64> = (0..finer.min(3)).map(|level| trials::weir(0.2 / f64::from(1u32 << level))).collect();
    row(sheet, "discharge over a broad crest, 5 columns and up", &weirs)?;
    Ok(())
}

/// Medians over the steps, and the share of columns that are wet.
fn measure([nx, nz]: [usize; 2], particles: usize, quick: bool) -> Result<(Times, f64), BenchError> {
    let scene = Simulation {
        manning: 0.03,
        terrain: Landform {
            kind: LandformKind::Valley,
            columns: Some([nx as u32, nz as u32]),
            width: Some([WIDTH; 2]),
            slope: 0.02,
            relief: 3.0,
            detail: 0.1,
            ..Landform::default()
        },
        water: crate::scene::InitialWater { depth: Some(0.3), ..Default::default() },
        // What breaks free by itself would differ from size to size.
        spray: SpraySettings { volume: Some(6.5e-5), most: 0, ..SpraySettings::default() },
        ..Simulation::default()
    };
    let failed = |error: crate::sim::SimError| BenchError::Internal(error.to_string());
    let setup = prepare(&scene, std::path::Path::new(".")).map_err(failed)?;
    let top: Vec<f64> = setup.base.iter().zip(&setup.depth).map(|(base, depth)| base + depth).collect();
    let mut simulator = Simulator::new(setup, &scene, FRAME).map_err(failed)?;
    let stop = AtomicBool::new(false);
    let mut times: [Vec<f64>; 4] = Default::default();
    let rounds = if quick { 11 } else { 51 };
    let mut wet = 0.0;
    for round in 0..rounds {
        let mut state = simulator.state();
        wet = state.depth.iter().filter(|depth| **depth > 1e-3).count() as f64 / state.depth.len() as f64;
        throw(&mut state, &top, [nx, nz], particles);
        if !simulator.resume(state) {
            return Err(BenchError::Internal("the simulation does not take its own state back".to_owned()));
        }
        let before = simulator.work();
        let time = simulator.time() + FRAME;
        let _ = simulator.advance_to(time, &stop, &mut |_| {}).map_err(failed)?;
        let work = simulator.work();
        let phases = work.seconds - before.seconds;
        let steps = (work.steps - before.steps).max(1) as f64;
        // The first warms caches and threads.
        if round > 0 {
            let parts = [phases.water, phases.spray, phases.turbulence].map(|seconds| seconds * 1e3 / steps);
            let all = parts.iter().sum::<f64>();
            for (times, value) in times.iter_mut().zip([all, parts[0], parts[1], parts[2]]) {
                times.push(value);
            }
        }
    }
    Ok((times.map(|mut values| super::median(&mut values)), wet))
}

/// Puts particles into the air, evenly over the map: over every eighth of the columns' places, up to 2 m above the start's
/// water, upward and downstream.
fn throw(state: &mut SimulatorState, top: &[f64], [nx, nz]: [usize; 2], particles: usize) {
    let Some(spray) = &mut state.spray else { return };
    // Additive recurrences with irrational steps: even in any number of points (Roberts 2018).
    let share = |index: usize, step: f64| (0.5 + index as f64 * step).fract();
    let place = |index: usize| [share(index, 0.754_877_666), share(index, 0.569_840_291)];
    spray.position = (0..particles)
        .map(|index| {
            let [u, v] = place(index);
            let (x, z) = (u * nx as f64, v * nz as f64);
            let column = (z as usize).min(nz - 1) * nx + (x as usize).min(nx - 1);
            [(x - 0.5) * WIDTH, top[column] + 0.1 + 2.0 * share(index, 0.618_033_989), (z - 0.5) * WIDTH]
        })
        .collect();
    spray.velocity = (0..particles).map(|index| [2.0 * share(index, 0.3), 1.0, share(index, 0.7) - 0.5]).collect();
    spray.mass = vec![0.065; particles];
    spray.first_mass = vec![0.065; particles];
    spray.age = vec![0.0; particles];
    spray.id = (0..particles as u64).collect();
    spray.next_id = particles as u64;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_small_map_is_measured_with_its_particles() {
        let (times, wet) = measure([24, 16], 240, true).unwrap();
        assert!(times.iter().all(|time| *time >= 0.0) && times[0] > 0.0);
        assert!(wet > 0.2, "{wet}");
    }
}
