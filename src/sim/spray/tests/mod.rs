//! Tests of the spray: `flight` of single particles, `shedding` of single faces, `whole` steps with the water.

mod flight;
mod shedding;
mod whole;

use crate::scene::SpraySettings;
use crate::sim::solids::Solids;
use crate::sim::{Grid, Spray, SprayState, Water, WaterSettings};
use crate::state;

const GRAVITY: f64 = 9.81;

/// A map with its origin off zero and columns that are not square.
fn oblong(nx: usize, nz: usize) -> Grid {
    Grid { nx, nz, width: [0.5, 0.75], origin: [-3.0, 12.0] }
}

fn water(grid: Grid, base: impl Fn(usize, usize) -> f64, depth: impl Fn(usize, usize) -> f64) -> Water {
    let each = |value: &dyn Fn(usize, usize) -> f64| {
        (0..grid.count()).map(|column| value(column % grid.nx, column / grid.nx)).collect()
    };
    Water::new(grid, each(&base), each(&depth), WaterSettings { gravity: GRAVITY, ..WaterSettings::default() })
}

fn spray(settings: &SpraySettings, model: &state::Model, grid: Grid) -> Spray {
    Spray::new(settings, GRAVITY, 7, Solids::new(model).unwrap(), grid)
}

/// Puts particles of a mass (kg) into a spray.
fn put(spray: &mut Spray, mass: f64, particles: &[([f64; 3], [f64; 3])]) {
    let state = SprayState {
        position: particles.iter().map(|(position, _)| *position).collect(),
        velocity: particles.iter().map(|(_, velocity)| *velocity).collect(),
        mass: vec![mass; particles.len()],
        first_mass: vec![mass; particles.len()],
        age: vec![0.0; particles.len()],
        id: (0..particles.len() as u64).collect(),
        next_id: particles.len() as u64,
        ..spray.state()
    };
    assert!(spray.set_state(state));
}

fn sphere(center: [f64; 3], radius: f64) -> state::Sphere {
    state::Sphere { center, radius, albedo: [0.5; 3] }
}

fn panel(corners: [[f64; 3]; 4]) -> state::Panel {
    state::Panel { corners, albedo: [0.5; 3] }
}

/// Seeded numbers of [0, 1), for places to try.
struct Numbers(u64);

impl Numbers {
    fn next(&mut self) -> f64 {
        self.0 += 1;
        super::random::uniform(99, self.0, super::random::Purpose::Along)
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + self.next() * (high - low)
    }

    fn vector(&mut self, low: f64, high: f64) -> [f64; 3] {
        [0; 3].map(|_| self.between(low, high))
    }
}
