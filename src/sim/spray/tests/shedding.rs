//! Single faces: when they shed, how much, and what they shed.

use glam::DVec3;

use super::super::shed::{FACES, Weir};
use super::*;

/// A 3x3 map whose middle column stands over a drop towards one face, with walls at its other sides.
fn ledge(face: usize, depth: f64) -> (Grid, Water) {
    let grid = oblong(3, 3);
    let [dx, dz] = FACES[face].1;
    let base = move |x: usize, z: usize| {
        let step = [x as isize - 1, z as isize - 1];
        if step == [0, 0] {
            2.0
        } else if step == [dx, dz] {
            -50.0
        } else {
            30.0
        }
    };
    (grid, water(grid, base, move |x, z| if (x, z) == (1, 1) { depth } else { 0.0 }))
}

/// The discharge (m3/s) of the face of [`ledge`] at a depth.
fn discharge(face: usize, depth: f64) -> f64 {
    let breadth = if face < 2 { 0.75 } else { 0.5 };
    2.0 / 3.0 * breadth * depth.powf(1.5) * (2.0 * GRAVITY).sqrt()
}

/// Sheds for some time at a depth that is held; what it shed (m3) as the column counts it.
fn run(spray: &mut Spray, water: &mut Water, depth: f64, dt: f64, steps: usize, turbulence: &[f64]) -> f64 {
    let mut lost = 0.0;
    for _ in 0..steps {
        spray.shed(water, dt, &[false; 9], turbulence);
        lost += water.set_depth(4, depth);
        spray.fly(water, dt, &[false; 9]);
    }
    lost
}

#[test]
fn a_steady_ledge_sheds_the_discharge_of_a_weir() {
    for face in 0..4 {
        for coefficient in [1.0, 0.58] {
            let (grid, mut water) = ledge(face, 0.4);
            let settings = SpraySettings { discharge: coefficient, ..SpraySettings::default() };
            let mut spray = spray(&settings, &state::Model::default(), grid);
            let lost = run(&mut spray, &mut water, 0.4, 0.001, 500, &[]);
            let expected = coefficient * discharge(face, 0.4) * 0.5;
            assert!((lost - expected).abs() <= spray.volume(), "face {face}: {lost} {expected}");
            // What the columns lost is in the particles.
            assert!((spray.mass() / 1000.0 / lost - 1.0).abs() < 1e-12);
            assert_eq!(spray.shedding()[4], FACES[face].0);
            assert_eq!(spray.shedding().iter().map(|bits| u32::from(*bits)).sum::<u32>(), u32::from(FACES[face].0));
            let state = spray.state();
            let full = 1000.0 * spray.volume();
            assert!(state.mass.iter().all(|mass| (mass / full - 1.0).abs() < 1e-9));
            assert_eq!(spray.counts().shed, state.mass.len() as u64);
        }
    }
}

#[test]
fn the_particles_do_not_depend_on_the_step() {
    let particles = |steps: usize| {
        let (grid, mut water) = ledge(0, 0.4);
        let mut spray = spray(&SpraySettings::default(), &state::Model::default(), grid);
        run(&mut spray, &mut water, 0.4, 0.05 / steps as f64, steps, &[]);
        spray.state()
    };
    let coarse = particles(1);
    assert!(coarse.mass.len() > 20, "{}", coarse.mass.len());
    for steps in [2, 7, 50] {
        let fine = particles(steps);
        // The same ones, where they would be: each broke free at its own moment, not at a step's end.
        assert_eq!(fine.id, coarse.id);
        for index in 0..fine.id.len() {
            let [one, other] = [&coarse, &fine].map(|state| DVec3::from_array(state.position[index]));
            assert!(one.distance(other) < 1e-10, "{steps} steps, particle {index}: {one} {other}");
            assert!((coarse.age[index] - fine.age[index]).abs() < 1e-10);
        }
    }
}

#[test]
fn the_last_particle_of_an_event_is_what_remains() {
    let (grid, mut water) = ledge(2, 0.4);
    let mut spray = spray(&SpraySettings::default(), &state::Model::default(), grid);
    run(&mut spray, &mut water, 0.4, 0.001, 37, &[]);
    let due = discharge(2, 0.4) * 0.037;
    let whole = (due / spray.volume()).floor();
    assert_eq!(spray.len() as f64, whole);
    // The water before it rises: the crest stands no longer free.
    water.set_depth(7, 52.4);
    let before = water.depth()[4];
    spray.shed(&mut water, 0.001, &[false; 9], &[]);
    let state = spray.state();
    assert_eq!(state.mass.len() as f64, whole + 1.0);
    let rest = state.mass.last().unwrap() / 1000.0;
    assert!((rest - (due - whole * spray.volume())).abs() < 1e-12, "{rest}");
    assert!(((before - water.depth()[4]) * grid.area() - rest).abs() < 1e-15);
    assert_eq!(spray.shedding(), [0; 9]);
    // And that was all.
    spray.shed(&mut water, 10.0, &[false; 9], &[]);
    assert_eq!(spray.len(), state.mass.len());
}

#[test]
fn a_column_gives_no_more_than_it_has() {
    let (grid, mut water) = ledge(1, 0.4);
    let mut spray = spray(&SpraySettings::default(), &state::Model::default(), grid);
    let volume = water.volume();
    for _ in 0..50 {
        spray.shed(&mut water, 30.0, &[false; 9], &[]);
    }
    // The first step emptied it, and its last particle was what was left.
    assert!(water.depth()[4] >= 0.0 && water.depth()[4] < 1e-12, "{}", water.depth()[4]);
    assert!((spray.mass() / 1000.0 / volume - 1.0).abs() < 1e-12);
    let small = spray.state().mass.iter().filter(|mass| **mass < 999.999 * spray.volume()).count();
    assert!(small <= 2, "{small}");
}

#[test]
fn the_threshold_is_a_share_of_the_depth_before_the_crest() {
    let weir = Weir { gravity: GRAVITY, threshold: 0.78, least_height: 0.05, discharge: 1.0 };
    for before in [0.1, 1.0, 7.0] {
        let breaks = |over: f64| weir.face([0.0, before + over], [0.0, before]).breaks;
        assert!(breaks(0.781 * before) && !breaks(0.779 * before), "{before}");
    }
    // Ground before it that is dry is no depth: any crest breaks that is high enough.
    assert!(weir.face([0.0, 0.051], [0.0, 0.0]).breaks && !weir.face([0.0, 0.049], [0.0, 0.0]).breaks);
    // What stands free ends at the column's own bed.
    let face = weir.face([3.0, 0.5], [0.0, 1.0]);
    assert_eq!((face.sill, face.exposed), (3.0, 0.5));
    // A dry column sheds nothing, however high.
    assert!(!weir.face([3.0, 0.0], [0.0, 1.0]).breaks);

    // And so in a spray, either side of it.
    for (over, sheds) in [(0.77, false), (0.79, true)] {
        let grid = oblong(3, 3);
        let mut water = water(grid, |_, _| 0.0, |x, _| if x == 0 { 1.0 + over } else { 1.0 });
        let mut spray = spray(&SpraySettings::default(), &state::Model::default(), grid);
        spray.shed(&mut water, 1e-4, &[false; 9], &[]);
        assert_eq!(spray.shedding(), [u8::from(sheds), 0, 0, u8::from(sheds), 0, 0, u8::from(sheds), 0, 0]);
    }
}

#[test]
fn vertical_speed_is_that_of_a_fall_or_climb() {
    let weir = Weir { gravity: GRAVITY, threshold: 0.78, least_height: 0.0, discharge: 1.0 };
    let (speed, run) = (2.0, 0.5);
    // Level with what is behind: straight on.
    assert_eq!(weir.turn(speed, [0.0, 1.0], [0.0, 1.0], run), [-0.0, speed]);
    // Water that came down 0.3 m.
    let [up, along] = weir.turn(speed, [0.0, 1.0], [0.0, 1.3], run);
    assert!((up + (2.0 * GRAVITY * 0.3f64).sqrt()).abs() < 1e-14 && along == speed);
    // Water that climbed 0.1 m: v² = u² - 2 g s, along the slope.
    let [up, along] = weir.turn(speed, [0.0, 1.0], [0.0, 0.9], run);
    assert!((up * up + along * along - (4.0 - 2.0 * GRAVITY * 0.1)).abs() < 1e-13);
    assert!((up / along - 0.1 / run).abs() < 1e-14 && up > 0.0);
    // More than its speed can climb.
    assert_eq!(weir.turn(speed, [0.0, 1.0], [0.0, 0.7], run), [0.0, 0.0]);
    // A ledge behind: only the depth on it falls as one body; a dry cliff behind gives no speed.
    let [up, _] = weir.turn(speed, [0.0, 1.0], [20.0, 0.2], run);
    assert!((up + (2.0 * GRAVITY * 0.2f64).sqrt()).abs() < 1e-14);
    assert_eq!(weir.turn(speed, [0.0, 1.0], [1000.0, 0.0], run), [0.0, speed]);
    // A pool below the own bed behind: nothing climbed from there.
    assert_eq!(weir.turn(speed, [5.0, 1.0], [0.0, 2.0], run), [0.0, speed]);

    // And so for a whole crest: behind (west) 0.3 m higher.
    let grid = oblong(3, 3);
    let depth = |x: usize, z: usize| if z == 1 { [1.3, 1.0, 0.0][x] } else { 0.0 };
    let base = |x: usize, z: usize| if z == 1 { [0.0, 0.0, -50.0][x] } else { 30.0 };
    let mut water = water(grid, base, depth);
    let mut spray = spray(&SpraySettings::default(), &state::Model::default(), grid);
    spray.shed(&mut water, 0.002, &[false; 9], &[]);
    assert!(!spray.is_empty());
    let expected = [2.0 / 3.0 * (2.0 * GRAVITY).sqrt(), -(2.0 * GRAVITY * 0.3f64).sqrt(), 0.0];
    for velocity in spray.state().velocity {
        assert!(DVec3::from_array(velocity).distance(DVec3::from_array(expected)) < 1e-13, "{velocity:?}");
    }
}

#[test]
fn spray_goes_with_the_flow_around_but_never_back() {
    for face in 0..4 {
        let [dx, dz] = FACES[face].1;
        let normal = DVec3::new(dx as f64, 0.0, dz as f64);
        for speed in [0.7, -0.7] {
            let (grid, mut water) = ledge(face, 0.4);
            let pipes = vec![speed; water.pipes().len()];
            assert!(water.set_pipes(&pipes));
            // Of the nine columns the middle one alone is wet.
            let [x, z] = water.flow_at(4);
            let flow = DVec3::new(x, 0.0, z).normalize_or_zero();
            let mut spray = spray(&SpraySettings::default(), &state::Model::default(), grid);
            spray.shed(&mut water, 0.01, &[false; 9], &[]);
            let way = DVec3::from_array(spray.state().velocity[0]).normalize();
            let expected = if flow.dot(normal) > 0.0 { flow } else { normal };
            assert!(way.distance(expected) < 1e-14, "face {face}, {speed}: {way} {expected}");
        }
    }
}

#[test]
fn spray_is_born_all_over_the_face_and_before_it() {
    for face in 0..4 {
        let (grid, mut water) = ledge(face, 0.4);
        let mut spray = spray(&SpraySettings::default(), &state::Model::default(), grid);
        // Banks at both ends slope across the face; here only the places before they matter.
        spray.shed(&mut water, 0.3, &[false; 9], &[]);
        let state = spray.state();
        let [dx, dz] = FACES[face].1;
        let before = 4usize.wrapping_add_signed(dz * 3 + dx);
        let mut heights = [0; 4];
        for place in &state.position {
            assert_eq!(grid.column_at([place[0], place[2]]), Some(before));
            assert!((2.0..=2.4).contains(&place[1]));
            let around = super::super::surroundings::Surroundings {
                grid,
                base: water.base(),
                depth: water.depth(),
                sink: &[],
                solids: &Solids::default(),
            };
            assert!(place[1] >= around.ground(DVec3::from_array(*place)) - 1e-12, "in the bank");
            heights[((place[1] - 2.0) / 0.1001) as usize] += 1;
        }
        assert!(heights.iter().all(|count| *count > state.mass.len() / 8), "{heights:?}");
    }
    // Without banks, all along it too.
    let grid = oblong(3, 3);
    let mut water = water(grid, |x, _| if x == 2 { -50.0 } else { 0.0 }, |x, _| if x == 1 { 0.4 } else { 0.0 });
    let mut spray = spray(&SpraySettings::default(), &state::Model::default(), grid);
    spray.shed(&mut water, 0.3, &[false; 9], &[]);
    let mut bins = [0; 9];
    let [low, _] = grid.extent();
    let state = spray.state();
    let east: Vec<_> = state.position.iter().filter(|place| place[0] > grid.centre(1)[0]).collect();
    for place in &east {
        bins[((place[2] - low[1]) / 0.25) as usize] += 1;
    }
    assert!(bins.iter().all(|count| *count > east.len() / 18), "{bins:?}");
}

#[test]
fn turbulence_spreads_directions_at_no_energy() {
    let velocities = |turbulence: &[f64]| {
        let (grid, mut water) = ledge(0, 0.4);
        let mut spray = spray(&SpraySettings::default(), &state::Model::default(), grid);
        spray.shed(&mut water, 0.5, &[false; 9], turbulence);
        spray.state().velocity.into_iter().map(DVec3::from_array).collect::<Vec<_>>()
    };
    let calm = velocities(&[]);
    let speed = calm[0].length();
    assert!(calm.len() > 200 && calm.iter().all(|velocity| *velocity == calm[0]));
    for gust in [0.1, 1.0, 100.0] {
        let spread = velocities(&[gust; 9]);
        assert_eq!(spread.len(), calm.len());
        let mut across = DVec3::ZERO;
        for velocity in &spread {
            assert!((velocity.length() / speed - 1.0).abs() < 1e-14);
            assert!(velocity.x >= 0.0, "never back");
            across += *velocity * *velocity / spread.len() as f64;
        }
        if gust == 0.1 {
            // While small, each component across the way has the turbulence's own rms.
            assert!((across.y.sqrt() / gust - 1.0).abs() < 0.15 && (across.z.sqrt() / gust - 1.0).abs() < 0.15);
        }
    }
}

#[test]
fn no_more_than_most_and_then_the_pipes_are_open() {
    let (grid, mut water) = ledge(0, 0.4);
    let settings = SpraySettings { most: 10, ..SpraySettings::default() };
    let mut spray = spray(&settings, &state::Model::default(), grid);
    let volume = spray.volume();
    let lost = run(&mut spray, &mut water, 0.4, 0.01, 50, &[]);
    assert_eq!(spray.len(), 10);
    assert!((lost / (10.0 * volume) - 1.0).abs() < 1e-9);
    assert_eq!(spray.shedding(), [0; 9]);
    let due = (discharge(0, 0.4) * 0.5 / volume).floor() as u64;
    assert_eq!(spray.counts().shed + spray.counts().refused, due);
    // None at all is a number too.
    let (grid, mut water) = ledge(0, 0.4);
    let mut none = super::spray(&SpraySettings { most: 0, ..settings }, &state::Model::default(), grid);
    assert_eq!(run(&mut none, &mut water, 0.4, 0.01, 5, &[]), 0.0);
    assert_eq!((none.len(), none.shedding()), (0, &[0; 9][..]));
}

#[test]
fn spray_that_is_switched_off_and_sinks_shed_nothing() {
    let (grid, mut water) = ledge(0, 0.4);
    let off = SpraySettings { enabled: false, ..SpraySettings::default() };
    let mut calm = spray(&off, &state::Model::default(), grid);
    calm.shed(&mut water, 1.0, &[false; 9], &[]);
    let mut over_sink = spray(&SpraySettings::default(), &state::Model::default(), grid);
    over_sink.shed(&mut water, 1.0, &[true; 9], &[]);
    for spray in [calm, over_sink] {
        assert!(spray.is_empty() && spray.shedding().iter().all(|bits| *bits == 0));
    }
    assert_eq!(water.depth()[4], 0.4);
}
