//! Whole steps, with the water under the spray.

use super::*;
use crate::sim::Forcing;

/// A stream over a ledge into a pool, with boulders at its foot and a sink at its end.
struct Fall {
    water: Water,
    spray: Spray,
    sink: Vec<bool>,
    /// What came in over the source and went out through the sink (m3).
    entered: f64,
}

impl Fall {
    fn new(nx: usize, nz: usize) -> Self {
        let grid = Grid { nx, nz, width: [0.25, 0.25], origin: [0.0, 0.0] };
        let lip = nx / 3;
        let water = super::water(
            grid,
            |x, _| if x < lip { 2.0 } else { -0.01 * x as f64 },
            |x, _| if x < lip { 0.3 } else { 0.4 },
        );
        let foot = grid.centre(lip + 1);
        let spheres = vec![sphere([foot[0], 0.2, 1.0], 0.3), sphere([foot[0] + 0.4, 0.0, 2.0], 0.5)];
        let plank =
            panel([[foot[0], 1.0, 0.0], [foot[0] + 1.0, 0.8, 0.0], [foot[0] + 1.0, 0.8, 1.0], [foot[0], 1.0, 1.0]]);
        let model = state::Model { spheres, panels: vec![plank], ..state::Model::default() };
        let spray = super::spray(&SpraySettings { volume: Some(4e-4), ..SpraySettings::default() }, &model, grid);
        let sink = (0..grid.count()).map(|column| column % nx == nx - 1).collect();
        Self { water, spray, sink, entered: 0.0 }
    }

    fn step(&mut self, dt: f64) {
        let (shedding, pressure) = (self.spray.shedding(), self.spray.pressure());
        self.water.step(dt, &Forcing { pressure, shedding });
        let nx = self.water.grid().nx;
        for column in (0..self.water.grid().count()).filter(|column| column % nx == 0) {
            self.entered += self.water.set_depth(column, 0.3);
        }
        for column in (0..self.sink.len()).filter(|column| self.sink[*column]) {
            self.entered += self.water.set_depth(column, 0.1);
        }
        self.spray.shed(&mut self.water, dt, &self.sink, &[]);
        self.spray.fly(&mut self.water, dt, &self.sink);
    }

    fn volume(&self) -> f64 {
        self.water.volume() + (self.spray.mass() + self.spray.left()) / 1000.0
    }
}

#[test]
fn no_mass_is_made_or_lost_over_thousands_of_steps() {
    let mut fall = Fall::new(24, 12);
    let start = fall.volume();
    for step in 0..4000 {
        fall.step(0.003);
        if step % 200 == 0 {
            let defect = (fall.volume() - start - fall.entered) / start;
            assert!(defect.abs() < 1e-12, "step {step}: {defect:e}");
        }
    }
    let counts = fall.spray.counts();
    assert!(counts.shed > 3000 && counts.absorbed > 3000, "{counts:?}");
    assert_eq!(counts.shed, counts.absorbed + counts.left + fall.spray.len() as u64);
    assert!((fall.volume() - start - fall.entered).abs() / start < 1e-12);
    // Most of it is whole particles: the fall does not flicker.
    assert!(fall.spray.len() > 50, "{}", fall.spray.len());
}

#[test]
fn threads_and_resumption_show_nowhere() {
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            // Enough columns and particles for several tasks of each.
            let mut fall = Fall::new(160, 120);
            for _ in 0..60 {
                fall.step(0.004);
            }
            assert!(fall.spray.len() > 2048, "{}", fall.spray.len());
            let state = fall.spray.state();
            let depth = fall.water.depth().to_vec();
            (state, depth)
        })
    };
    let one = run(1);
    for threads in [2, 3] {
        let other = run(threads);
        assert!(one.0 == other.0 && one.1 == other.1, "{threads} threads");
    }

    let mut fall = Fall::new(24, 12);
    (0..400).for_each(|_| fall.step(0.003));
    let mut again = Fall::new(24, 12);
    again.water = fall.water.clone();
    assert!(again.spray.set_state(fall.spray.state()));
    for _ in 0..100 {
        fall.step(0.003);
        again.step(0.003);
    }
    assert_eq!(fall.spray.state(), again.spray.state());
    assert_eq!(fall.water.depth(), again.water.depth());
}

#[test]
fn a_state_of_another_map_or_a_damaged_one_is_refused() {
    let mut fall = Fall::new(24, 12);
    (0..200).for_each(|_| fall.step(0.003));
    let good = fall.spray.state();
    assert!(!good.mass.is_empty());
    assert!(!Fall::new(12, 12).spray.set_state(good.clone()));
    let damage: [fn(&mut SprayState); 5] = [
        |state| state.mass[0] = f64::NAN,
        |state| state.first_mass[0] = 0.0,
        |state| state.age.push(0.0),
        |state| state.position[0][1] = f64::INFINITY,
        |state| state.demand[3][2] = f64::NAN,
    ];
    for damage in damage {
        let mut state = good.clone();
        damage(&mut state);
        assert!(!fall.spray.set_state(state));
        assert_eq!(fall.spray.state(), good, "nothing changed");
    }
}
