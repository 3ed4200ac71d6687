//! Single particles: parabolas, bounces, absorption.

use glam::DVec3;

use super::*;

/// Flies one particle over a dry map and gives its position and velocity.
fn fly_one(spray: &mut Spray, water: &mut Water, start: ([f64; 3], [f64; 3]), dt: f64, steps: usize) -> [DVec3; 2] {
    put(spray, 0.001, &[start]);
    let sink = vec![false; water.grid().count()];
    for _ in 0..steps {
        spray.fly(water, dt, &sink);
    }
    let state = spray.state();
    assert_eq!(state.mass.len(), 1, "the particle is still there");
    [DVec3::from_array(state.position[0]), DVec3::from_array(state.velocity[0])]
}

fn bouncy(restitution: f64) -> SpraySettings {
    SpraySettings { restitution, ..SpraySettings::default() }
}

#[test]
fn a_flight_is_a_parabola_to_rounding_for_any_step() {
    let grid = Grid { nx: 60, nz: 40, width: [0.5, 0.75], origin: [-3.0, 12.0] };
    let mut water = water(grid, |_, _| -200.0, |_, _| 0.0);
    let mut spray = spray(&SpraySettings::default(), &state::Model::default(), grid);
    let (start, velocity) = (DVec3::new(1.0, 4.0, 20.0), DVec3::new(2.5, 7.0, -1.25));
    for (dt, steps) in [(3.0, 1), (0.3, 10), (0.01, 300), (0.001, 3000)] {
        let [position, speed] = fly_one(&mut spray, &mut water, (start.to_array(), velocity.to_array()), dt, steps);
        let time = 3.0;
        let exact = start + velocity * time + DVec3::NEG_Y * (0.5 * GRAVITY * time * time);
        // A rounding of each of the terms at each step.
        let rounding = 50.0 * f64::EPSILON * (steps as f64);
        assert!(position.distance(exact) <= rounding, "{steps} steps: {:e}", position.distance(exact));
        assert!(speed.distance(velocity - DVec3::Y * (GRAVITY * time)) <= rounding);
    }
    assert_eq!(spray.particles().age, vec![spray.state().age[0]]);
    assert!((spray.state().age[0] - 3.0).abs() < 1e-9);
}

#[test]
fn a_dropped_particle_rises_to_the_square_of_its_restitution_whatever_the_step() {
    let grid = oblong(6, 5);
    let mut water = water(grid, |_, _| 2.0, |_, _| 0.0);
    let mut spray = spray(&bouncy(0.5), &state::Model::default(), grid);
    let fall = (2.0 * 5.0 / GRAVITY).sqrt();
    let rise = 0.5 * fall;
    for steps in [1, 2, 7, 1000] {
        let time = fall + rise;
        let [position, velocity] =
            fly_one(&mut spray, &mut water, ([-2.0, 7.0, 13.0], [0.25, 0.0, 0.0]), time / steps as f64, steps);
        assert!((position.y - (2.0 + 0.25 * 5.0)).abs() < 1e-11, "{steps}: {position}");
        assert!(velocity.y.abs() < 1e-11);
        // What goes along the ground is kept.
        assert!((velocity.x - 0.25).abs() < 1e-13 && (position.x - (-2.0 + 0.25 * time)).abs() < 1e-12);
    }
}

#[test]
fn a_slope_turns_speed_about_its_normal() {
    let grid = oblong(9, 5);
    // Falls eastward by a half: every patch is the same plane.
    let slope = |x: usize| -0.5 * 0.5 * x as f64;
    let mut water = water(grid, |x, _| slope(x), |_, _| 0.0);
    let mut spray = spray(&bouncy(0.4), &state::Model::default(), grid);
    let normal = DVec3::new(0.5, 1.0, 0.0).normalize();
    // On the ground already, going in: after no time, only turned.
    let start = DVec3::new(-2.0, -0.5, 13.0);
    let velocity = DVec3::new(3.0, -20.0, 1.0);
    let [_, after] = fly_one(&mut spray, &mut water, (start.to_array(), velocity.to_array()), 1e-9, 1);
    let across = velocity.dot(normal);
    let expected = velocity - normal * (1.4 * across);
    assert!(after.distance(expected) < 1e-7, "{after} {expected}");
}

#[test]
fn a_particle_that_would_not_rise_by_its_radius_soaks_in() {
    let grid = oblong(5, 5);
    let radius = super::super::flight::radius(0.001);
    // Speeds after the bounce that lift it by just over and just under its radius.
    for (factor, stays) in [(1.01, true), (0.99, false)] {
        let mut water = water(grid, |_, _| 1.0, |_, _| 0.0);
        let mut spray = spray(&bouncy(0.5), &state::Model::default(), grid);
        let down = -factor * (2.0 * GRAVITY * radius).sqrt() / 0.5;
        put(&mut spray, 0.001, &[([-2.0, 1.0, 13.5], [0.0, down, 0.0])]);
        spray.fly(&mut water, 1e-4, &[false; 25]);
        assert_eq!(spray.len() == 1, stays);
        let column = grid.column_at([-2.0, 13.5]).unwrap();
        let expected = if stays { 0.0 } else { 1e-6 / grid.area() };
        assert!((water.depth()[column] - expected).abs() < 1e-18);
        assert_eq!(spray.counts().absorbed, u64::from(!stays));
    }
}

#[test]
fn water_that_soaks_in_never_climbs() {
    // A cliff between columns 1 and 2: the ground's ramp reaches half a column into the upper one's footprint.
    let grid = oblong(5, 3);
    let mut water = water(grid, |x, _| if x < 2 { 10.0 } else { 0.0 }, |_, _| 0.0);
    let mut spray = spray(&bouncy(0.0), &state::Model::default(), grid);
    // Halfway down, and over the upper column's half of it.
    let point = [grid.centre(1)[0] + 0.2, 7.0, grid.centre(1)[1]];
    put(&mut spray, 0.001, &[(point, [0.0, -0.001, 0.0])]);
    for _ in 0..200 {
        spray.fly(&mut water, 0.01, &[false; 15]);
    }
    assert!(spray.is_empty());
    assert!(water.depth()[..2].iter().all(|depth| *depth == 0.0), "nothing on the cliff");
    assert!((water.volume() - 1e-6).abs() < 1e-20);
}

#[test]
fn water_on_a_cliff_is_a_film_that_nothing_climbs_by() {
    // As above, but the upper columns are wet: what strikes the cliff below them falls on, and its water comes to the foot.
    let grid = oblong(5, 3);
    let mut water = water(grid, |x, _| if x < 2 { 10.0 } else { 0.0 }, |x, _| if x < 2 { 0.3 } else { 0.1 });
    let upper =
        |water: &Water| (0..15).filter(|column| column % 5 < 2).map(|column| water.depth()[column]).sum::<f64>();
    let before = upper(&water);
    let mut spray = spray(&bouncy(0.3), &state::Model::default(), grid);
    let [x, z] = grid.centre(1);
    let particles: Vec<_> =
        (0..40).map(|k| ([x + 0.24, 7.0, z + 0.01 * f64::from(k)], [-2.0, 0.1 * f64::from(k), 0.0])).collect();
    put(&mut spray, 0.001, &particles);
    for _ in 0..400 {
        spray.fly(&mut water, 0.01, &[false; 15]);
    }
    assert_eq!((spray.len(), spray.counts().absorbed), (0, 40));
    assert_eq!(upper(&water), before);
}

#[test]
fn water_shallower_than_a_particle_does_not_hold_it() {
    let grid = oblong(5, 5);
    let radius = super::super::flight::radius(0.001);
    for (depth, held) in [(0.9 * radius, false), (1.1 * radius, true)] {
        let mut water = water(grid, |_, _| 0.0, |_, _| depth);
        let mut spray = spray(&bouncy(0.5), &state::Model::default(), grid);
        put(&mut spray, 0.001, &[([-2.0, 1.0, 13.5], [0.0, -5.0, 0.0])]);
        spray.fly(&mut water, 0.3, &[false; 25]);
        // It bounces off the ground in both, and dissolves on its way in the deeper.
        assert!(spray.state().velocity[0][1] > -1.0);
        assert_eq!(spray.mass() < 0.001, held, "{depth}");
        assert_eq!(spray.pressure().is_empty(), !held);
    }
}

#[test]
fn what_slides_in_a_sheet_of_water_makes_no_energy() {
    // A slope of one half under a sheet of 0.2 m: gravity along the slope acts on what is in it, up or down.
    let grid = oblong(40, 5);
    let settings = SpraySettings { absorption_time: 1e3, ..bouncy(0.5) };
    let mut water = water(grid, |x, _| -0.25 * x as f64, |_, _| 0.2);
    let mut spray = spray(&settings, &state::Model::default(), grid);
    let slope = DVec3::new(1.0, -0.5, 0.0).normalize();
    let start = DVec3::new(7.0, -5.0 + 0.1, 13.5);
    put(&mut spray, 0.001, &[(start.to_array(), (-slope * 3.0).to_array())]);
    let energy = |state: &SprayState| {
        0.5 * DVec3::from_array(state.velocity[0]).length_squared() + GRAVITY * state.position[0][1]
    };
    let first = energy(&spray.state());
    for step in 0..1000 {
        spray.fly(&mut water, 0.001, &[false; 200]);
        let now = energy(&spray.state());
        // Up through the sheet's depth it is borne for nothing, as it sinks for nothing; but not up the slope.
        assert!(now <= first + GRAVITY * 0.2, "step {step}: {now} after {first}");
    }
    // Up for some 0.7 s and down again, about as a ball on a smooth slope: where it touches the bed it stops and starts anew.
    let time = 1.0;
    let pull = GRAVITY * 0.5 / 1.25f64.sqrt();
    let way = 0.5 * pull * time * time - 3.0 * time;
    let moved = (DVec3::from_array(spray.state().position[0]) - start).dot(slope);
    assert!((moved - way).abs() < 0.2, "{moved} {way}");
}

#[test]
fn a_pool_is_level_over_an_uneven_bed() {
    // Bases differ by more than half a metre under water that stands at 1 m: it is met at 1 m everywhere.
    let grid = oblong(8, 8);
    let mut numbers = Numbers(40);
    let base: Vec<f64> = (0..64).map(|_| numbers.between(0.0, 0.7)).collect();
    let pool = water(grid, |x, z| base[z * 8 + x], |x, z| 1.0 - base[z * 8 + x]);
    let mut spray = spray(&bouncy(0.3), &state::Model::default(), grid);
    let [low, high] = grid.extent();
    for _ in 0..200 {
        let (x, z) = (numbers.between(low[0], high[0]), numbers.between(low[1], high[1]));
        for (height, wet) in [(1.0 + 1e-9, false), (1.0 - 1e-9, true)] {
            put(&mut spray, 0.001, &[([x, height, z], [0.0; 3])]);
            spray.fly(&mut pool.clone(), 1e-6, &[false; 64]);
            assert_eq!(spray.mass() < 0.001, wet, "{x} {height} {z}");
        }
    }
}

#[test]
fn a_sphere_turns_back_what_comes_from_outside_at_any_speed() {
    let grid = Grid { nx: 40, nz: 40, width: [1.0, 1.0], origin: [-20.0, -20.0] };
    let center = DVec3::new(1.5, 30.0, -2.5);
    let model = state::Model { spheres: vec![sphere(center.to_array(), 3.0)], ..state::Model::default() };
    let solids = Solids::new(&model).unwrap();
    let (mut numbers, mut hits) = (Numbers(0), 0);
    for round in 0..400 {
        let start = center + DVec3::from_array(numbers.vector(-1.0, 1.0)).normalize() * numbers.between(3.5, 8.0);
        // Towards some point well inside.
        let aim = center + DVec3::from_array(numbers.vector(-1.0, 1.0));
        let speed = 10f64.powf(numbers.between(0.0, 3.0));
        let velocity = (aim - start).normalize() * speed;
        let path = crate::sim::solids::Path { start, velocity, acceleration: 0.0, duration: 20.0 / speed };
        let contact = solids.first_contact(&path).expect("aimed at it");
        assert!(contact.normal.dot(velocity) < 0.0 && (contact.normal.length() - 1.0).abs() < 1e-14);
        assert!((contact.place.distance(center) - 3.0).abs() < 1e-12);
        assert!(contact.place.distance(path.at(contact.time)) < 1e-10, "the place is on the path");

        // The bounce itself, on the parabola that gravity makes of it: it may miss when it is slow.
        let path = crate::sim::solids::Path { acceleration: -GRAVITY, ..path };
        let Some(contact) = solids.first_contact(&path) else { continue };
        hits += 1;
        let mut water = water(grid, |_, _| -1e4, |_, _| 0.0);
        let mut spray = spray(&bouncy(0.3), &model, grid);
        let before = path.velocity_at(contact.time);
        let dt = contact.time * (1.0 + 1e-9);
        let [position, after] = fly_one(&mut spray, &mut water, (start.to_array(), velocity.to_array()), dt, 1);
        let expected = before - contact.normal * (1.3 * before.dot(contact.normal));
        assert!(after.distance(expected) < 1e-6 * before.length(), "round {round}: {after} {expected}");
        assert!(solids.depth_within(position) <= 0.0);

        // A step of ten seconds through it and far beyond: it does not come out on the other side of where it went in.
        let [position, _] = fly_one(&mut spray, &mut water, (start.to_array(), velocity.to_array()), 10.0, 1);
        assert!(solids.depth_within(position) < 1e-11);
    }
    assert!(hits > 300, "{hits}");
}

#[test]
fn a_dropped_particle_stands_on_a_sphere_as_on_the_ground() {
    // Head on, where the bounce has a closed form: it rises to the square of its restitution.
    let grid = oblong(20, 20);
    let model = state::Model { spheres: vec![sphere([0.0, 5.0, 15.0], 1.0)], ..state::Model::default() };
    let mut water = water(grid, |_, _| -10.0, |_, _| 0.0);
    let mut spray = spray(&bouncy(0.6), &model, grid);
    let fall = (2.0 * 4.0 / GRAVITY).sqrt();
    for steps in [1, 3, 50] {
        let time = 1.6 * fall;
        let [position, velocity] =
            fly_one(&mut spray, &mut water, ([0.0, 10.0, 15.0], [0.0; 3]), time / steps as f64, steps);
        assert!((position.y - (6.0 + 0.36 * 4.0)).abs() < 1e-10, "{steps}: {position}");
        assert!(velocity.length() < 1e-10);
    }
}

#[test]
fn a_panel_turns_back_both_sides() {
    let grid = oblong(20, 20);
    // Leaning, not planar to rounding, and away from the origin.
    let corners = [[0.0, 0.0, 14.0], [0.5, 4.0, 14.0], [0.5, 4.0, 18.0], [0.0, 0.0, 18.0]];
    let model = state::Model { panels: vec![panel(corners)], ..state::Model::default() };
    let solids = Solids::new(&model).unwrap();
    let normal = DVec3::new(4.0, -0.5, 0.0).normalize();
    for side in [-1.0, 1.0] {
        for speed in [1.0, 30.0, 1000.0] {
            let start = DVec3::new(0.25, 2.0, 16.1) + normal * (0.3 * side);
            let velocity = -normal * (speed * side) + DVec3::Z * (0.1 * speed);
            let path = crate::sim::solids::Path { start, velocity, acceleration: -GRAVITY, duration: 1.0 };
            let contact = solids.first_contact(&path).expect("it flies through");
            assert!((contact.normal - normal * side).length() < 1e-14);
            assert!(contact.normal.dot(contact.place - DVec3::from_array(corners[0])) > 0.0, "on its own side");

            let mut water = water(grid, |_, _| -1e4, |_, _| 0.0);
            let mut spray = spray(&bouncy(0.25), &model, grid);
            let before = path.velocity_at(contact.time);
            let dt = contact.time * (1.0 + 1e-9);
            let [position, after] = fly_one(&mut spray, &mut water, (start.to_array(), velocity.to_array()), dt, 1);
            let expected = before - normal * (1.25 * before.dot(normal));
            assert!(after.distance(expected) < 1e-6 * speed, "{after} {expected}");
            assert!((position - DVec3::from_array(corners[0])).dot(normal) * side > 0.0);
        }
    }
}

#[test]
fn a_closed_box_of_panels_loses_nothing_at_a_kilometre_a_second() {
    let grid = oblong(20, 20);
    let (low, high) = ([-1.0, 3.0, 14.0], [2.0, 5.0, 19.0]);
    let corner = |index: usize| [0, 1, 2].map(|axis| if index >> axis & 1 == 0 { low[axis] } else { high[axis] });
    let faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let model = state::Model { panels: faces.map(|face| panel(face.map(corner))).to_vec(), ..state::Model::default() };
    for restitution in [0.0, 0.3, 1.0] {
        let mut water = water(grid, |_, _| 0.0, |_, _| 0.0);
        let mut spray = spray(&bouncy(restitution), &model, grid);
        let mut numbers = Numbers(10);
        let particles: Vec<_> = (0..300)
            .map(|_| {
                let place = [0, 1, 2].map(|axis| numbers.between(low[axis] + 1e-6, high[axis] - 1e-6));
                (place, numbers.vector(-1000.0, 1000.0))
            })
            .collect();
        put(&mut spray, 0.001, &particles);
        let energy = |spray: &Spray| {
            let state = spray.state();
            let each = state.position.iter().zip(&state.velocity);
            each.map(|(p, v)| 0.5 * DVec3::from_array(*v).length_squared() + GRAVITY * p[1]).sum::<f64>()
        };
        let mut last = energy(&spray);
        for step in 0..60 {
            spray.fly(&mut water, if step % 2 == 0 { 0.05 } else { 0.001 }, &[false; 400]);
            assert_eq!(spray.len(), 300);
            for place in &spray.state().position {
                for axis in 0..3 {
                    assert!(low[axis] <= place[axis] && place[axis] <= high[axis], "step {step}: {place:?}");
                }
            }
            let now = energy(&spray);
            assert!(now <= last * (1.0 + 1e-12), "restitution {restitution}, step {step}: {now} after {last}");
            last = now;
        }
    }
}

#[test]
fn what_falls_in_a_trough_of_panels_stays_above_them() {
    let grid = Grid { nx: 20, nz: 20, width: [0.5, 0.5], origin: [-5.0, -5.0] };
    for half_width in [3.0, 1.0, 0.2] {
        // A V along z, 4 m deep, closed at its ends by the map's edges.
        let wall = |x: f64| panel([[0.0, 1.0, -5.25], [x, 5.0, -5.25], [x, 5.0, 4.75], [0.0, 1.0, 4.75]]);
        let model = state::Model { panels: vec![wall(half_width), wall(-half_width)], ..state::Model::default() };
        let mut water = water(grid, |_, _| 0.0, |_, _| 0.0);
        let mut spray = spray(&bouncy(0.3), &model, grid);
        let mut numbers = Numbers(60);
        let particles: Vec<_> = (0..200)
            .map(|_| {
                let x = numbers.between(-0.5, 0.5) * half_width;
                ([x, 5.0, numbers.between(-5.0, 4.5)], [0.0, numbers.between(-30.0, 0.0), numbers.between(-1.0, 1.0)])
            })
            .collect();
        put(&mut spray, 0.001, &particles);
        for step in 0..400 {
            spray.fly(&mut water, 0.01, &[false; 400]);
            for place in &spray.state().position {
                let floor = 1.0 + 4.0 / half_width * place[0].abs();
                assert!(place[1] >= floor - 1e-11, "step {step}: {place:?} under {floor}");
            }
        }
        assert_eq!(spray.len(), 200);
    }
}

#[test]
fn a_rough_ground_with_boulders_is_never_entered_and_no_energy_made() {
    let grid = oblong(16, 12);
    let mut numbers = Numbers(20);
    let heights: Vec<f64> = (0..grid.count()).map(|_| numbers.between(0.0, 1.5)).collect();
    let mut spheres = Vec::new();
    for _ in 0..25 {
        let place = [numbers.between(-3.0, 4.5), numbers.between(0.0, 1.5), numbers.between(12.0, 20.0)];
        spheres.push(sphere(place, numbers.between(0.2, 0.9)));
    }
    let model = state::Model { spheres, ..state::Model::default() };
    let solids = Solids::new(&model).unwrap();
    let mut water = water(grid, |x, z| heights[z * grid.nx + x], |_, _| 0.0);
    let mut spray = spray(&bouncy(0.4), &model, grid);
    let particles: Vec<_> = (0..500)
        .map(|_| {
            let place = [numbers.between(-3.2, 4.7), numbers.between(3.0, 6.0), numbers.between(11.7, 20.5)];
            (place, numbers.vector(-20.0, 20.0))
        })
        .collect();
    put(&mut spray, 1e-3, &particles);
    let [low, high] = grid.extent();
    let mut before: std::collections::HashMap<u64, f64> = std::collections::HashMap::new();
    for step in 0..300 {
        spray.fly(&mut water, 0.02, &vec![false; grid.count()]);
        let state = spray.state();
        let around = super::super::surroundings::Surroundings {
            grid,
            base: water.base(),
            depth: water.depth(),
            sink: &[],
            solids: &solids,
        };
        for index in 0..state.mass.len() {
            let place = DVec3::from_array(state.position[index]);
            assert!(place.x >= low[0] && place.x <= high[0] && place.z >= low[1] && place.z <= high[1]);
            assert!(place.y >= around.ground(place), "step {step}: under the ground");
            assert!(solids.depth_within(place) < 1e-11, "step {step}: {} in a boulder", solids.depth_within(place));
            let energy = 0.5 * DVec3::from_array(state.velocity[index]).length_squared() + GRAVITY * place.y;
            let last = before.insert(state.id[index], energy).unwrap_or(f64::INFINITY);
            assert!(energy <= last + 1e-10, "step {step}: {energy} after {last}");
        }
    }
    assert!(spray.counts().absorbed > 100, "most came to rest: {:?}", spray.counts());
    let volume = (spray.mass() + spray.left()) / 1000.0 + water.volume();
    assert!((volume / (500.0 * 1e-6) - 1.0).abs() < 1e-12);
}

#[test]
fn the_edges_of_the_map_are_mirrors_but_over_a_sink() {
    let grid = oblong(8, 6);
    let [low, high] = grid.extent();
    for speed in [3.0, 1000.0] {
        let mut water = water(grid, |_, _| -1e5, |_, _| 0.0);
        let mut spray = spray(&bouncy(0.3), &state::Model::default(), grid);
        let start = [-1.0, 5.0, 13.0];
        // Some 115 reflections at the greater speed.
        let dt = 0.3;
        let [position, velocity] = fly_one(&mut spray, &mut water, (start, [-speed, 0.0, 0.6 * speed]), dt, 1);
        // Unfolded: the mirrored paths are straight lines.
        let unfold = |start: f64, speed: f64, low: f64, high: f64| {
            let (span, way) = (high - low, start - low + speed * dt);
            let folded = way.rem_euclid(2.0 * span);
            let back = folded > span;
            (low + if back { 2.0 * span - folded } else { folded }, if back { -speed } else { speed })
        };
        let (x, along_x) = unfold(start[0], -speed, low[0], high[0]);
        let (z, along_z) = unfold(start[2], 0.6 * speed, low[1], high[1]);
        assert!((position.x - x).abs() < 1e-9 && (position.z - z).abs() < 1e-9, "{position} {x} {z}");
        assert_eq!((velocity.x, velocity.z), (along_x, along_z));

        let sink: Vec<bool> = (0..grid.count()).map(|column| column % grid.nx == 0).collect();
        put(&mut spray, 0.001, &[(start, [-speed, 0.0, 0.0])]);
        spray.fly(&mut water, dt * 5.0, &sink);
        assert!(spray.is_empty());
        assert_eq!((spray.left(), spray.counts().left), (0.001, 1));
    }
}

#[test]
fn a_particle_leaves_where_it_falls_in_a_sink() {
    let grid = oblong(5, 5);
    for depth in [0.0, 2.0] {
        let mut water = water(grid, |_, _| 0.0, |_, _| depth);
        let mut spray = spray(&bouncy(0.3), &state::Model::default(), grid);
        put(&mut spray, 0.002, &[([-2.0, 3.0, 13.5], [0.0; 3])]);
        let volume = water.volume();
        for _ in 0..100 {
            spray.fly(&mut water, 0.01, &[true; 25]);
        }
        assert_eq!((spray.len(), spray.left(), water.volume()), (0, 0.002, volume));
        assert!(spray.pressure().is_empty());
    }
}

#[test]
fn an_impact_presses_with_its_momentum_for_the_time_it_takes() {
    let grid = oblong(5, 5);
    let settings = SpraySettings { absorption_time: 0.2, ..SpraySettings::default() };
    let (mass, speed) = (0.5, 8.0);
    for steps in [40, 400, 4000] {
        let mut water = water(grid, |_, _| 0.0, |_, _| 20.0);
        let mut spray = spray(&settings, &state::Model::default(), grid);
        // At the surface, going down: in the water from the first moment.
        put(&mut spray, mass, &[([-2.0, 20.0, 13.5], [0.0, -speed, 0.0])]);
        let column = grid.column_at([-2.0, 13.5]).unwrap();
        let dt = 2.0 / steps as f64;
        let (mut impulse, mut energy, mut half_time) = (0.0, 0.0, None);
        let top = water.top(column);
        for step in 0..steps {
            let before = water.top(column);
            spray.fly(&mut water, dt, &[false; 25]);
            let pressure = spray.pressure().get(column).copied().unwrap_or(0.0);
            if step == 0 {
                // Momentum at m v / τ and weight, averaged over the step.
                let decay = (1.0 - (-dt / 0.2f64).exp()) * 0.2 / dt;
                let force = decay * (mass * speed / 0.2 + mass * GRAVITY);
                assert!((pressure * grid.area() / force - 1.0).abs() < 1e-3, "{pressure}");
                // Never more of a rise in a step than what a 0.2 s decay gives.
                assert!(water.top(column) - before <= 1.001 * mass / 1000.0 / grid.area() * dt / 0.2);
            }
            impulse += pressure * grid.area() * dt;
            energy += spray.impacts().get(column).copied().unwrap_or(0.0);
            if half_time.is_none() && spray.mass() <= 0.5 * mass {
                half_time = Some((step + 1) as f64 * dt);
            }
        }
        assert!(spray.is_empty());
        // All its momentum, and its weight for τ on average (99 % of it: the last is swallowed at once).
        let expected = mass * speed + mass * GRAVITY * 0.2 * 0.99;
        assert!((impulse / expected - 1.0).abs() < 0.01, "{impulse} {expected}");
        assert!((energy / (0.5 * mass * speed * speed) - 1.0).abs() < 1e-9, "{energy}");
        assert!((half_time.unwrap() - 0.2 * 2f64.ln()).abs() <= dt, "{half_time:?}");
        assert!((water.top(column) - top - mass / 1000.0 / grid.area()).abs() < 1e-13);
    }
}

#[test]
fn a_fast_particle_meets_a_sheet_of_water_thinner_than_its_step() {
    // 30 m in one step, through 20 cm of water: it must be in the water on its way, not only at its end.
    let grid = oblong(5, 5);
    let mut water = water(grid, |_, _| 0.0, |_, _| 0.2);
    let mut spray = spray(&bouncy(1.0), &state::Model::default(), grid);
    put(&mut spray, 0.01, &[([-2.0, 15.0, 13.5], [0.0, -300.0, 0.0])]);
    spray.fly(&mut water, 0.1, &[false; 25]);
    let column = grid.column_at([-2.0, 13.5]).unwrap();
    // Down through 20 cm with hardly any drag; the bed stops it there for the rest of the step: 63 % in a tenth of a second.
    let speed = (300.0 * 300.0 + 2.0 * GRAVITY * 14.8f64).sqrt();
    let fall = (speed - 300.0) / GRAVITY;
    let given = 0.01 * (1.0 - (-(0.1 - fall) / 0.1f64).exp());
    assert_eq!(spray.state().velocity[0], [0.0; 3]);
    assert!(((0.01 - spray.mass()) / given - 1.0).abs() < 1e-4, "{} {given}", 0.01 - spray.mass());
    assert!(spray.pressure()[column] > 0.0);
}

#[test]
fn drag_is_stokes() {
    // A mist droplet of 50 micrometres is stopped by 6 π μ r v: its speed falls by e in 2 ρ r² / (9 μ).
    let grid = oblong(5, 5);
    let settings = SpraySettings { absorption_time: 1e5, ..SpraySettings::default() };
    let mut water = water(grid, |_, _| 0.0, |_, _| 5.0);
    let mut spray = spray(&settings, &state::Model::default(), grid);
    let radius: f64 = 5e-5;
    let mass = 1000.0 * 4.0 / 3.0 * std::f64::consts::PI * radius.powi(3);
    put(&mut spray, mass, &[([-2.0, 3.0, 13.5], [0.3, 0.0, 0.0])]);
    let time = 2.0 * 1000.0 * radius * radius / (9.0 * 1.002e-3);
    spray.fly(&mut water, time, &[false; 25]);
    let state = spray.state();
    assert!((state.velocity[0][0] / (0.3 * (-1f64).exp()) - 1.0).abs() < 1e-6);
    assert!(((state.position[0][0] + 2.0) / (0.3 * time * (1.0 - (-1f64).exp())) - 1.0).abs() < 1e-6);
    assert_eq!(state.position[0][1], 3.0, "it neither sinks nor rises");
}

#[test]
fn nothing_is_ever_not_a_number() {
    // A 3x3 map with a cliff, boulders that overlap its ground and one another, a sliver of a panel, empty and full columns.
    let grid = Grid { nx: 3, nz: 3, width: [0.1, 4.0], origin: [1e6, -1e6] };
    let [low, high] = grid.extent();
    let middle = grid.centre(4);
    let sliver = panel([
        [middle[0], 0.0, middle[1]],
        [middle[0], 500.0, middle[1]],
        [middle[0], 1000.0, middle[1]],
        [middle[0] + 1e-9, 500.0, middle[1]],
    ]);
    let spheres = vec![
        sphere([middle[0], 0.0, middle[1]], 2.0),
        sphere([middle[0], 0.5, middle[1]], 2.0),
        sphere([middle[0], 1000.0, middle[1]], 1e-6),
    ];
    let model = state::Model { spheres, panels: vec![sliver], ..state::Model::default() };
    let base = |x: usize, _| if x == 0 { 1000.0 } else { 0.0 };
    let depth = |x: usize, z: usize| [0.0, 1e-200, 3.0][(x + z) % 3];
    for restitution in [0.0, 0.5, 1.0] {
        let mut water = water(grid, base, depth);
        let mut spray = spray(&bouncy(restitution), &model, grid);
        let xs = [low[0], grid.centre(0)[0], low[0] + 0.1, middle[0], low[0] + 0.2, high[0]];
        let zs = [low[1], grid.centre(0)[1], low[1] + 4.0, middle[1], low[1] + 8.0, high[1]];
        let mut particles = Vec::new();
        for &x in &xs {
            for &z in &zs {
                for y in [-5.0, 0.0, 2.0, 3.0, 500.0, 1000.0, 1e9] {
                    for velocity in
                        [[0.0; 3], [0.0, -1e3, 0.0], [1e3, 0.0, -1e3], [-1e30, 1e30, 1e30], [1e-300, -1e-300, 0.0]]
                    {
                        particles.push(([x, y, z], velocity));
                    }
                }
            }
        }
        put(&mut spray, 0.01, &particles);
        let total = water.volume() + spray.mass() / 1000.0;
        for dt in [1e-9, 0.01, 100.0, 0.5, 1e-300] {
            spray.fly(&mut water, dt, &[false; 9]);
            let state = spray.state();
            let finite = |values: &[[f64; 3]]| values.as_flattened().iter().all(|value| value.is_finite());
            assert!(finite(&state.position) && finite(&state.velocity), "step {dt}");
            for [x, _, z] in &state.position {
                assert!(*x >= low[0] && *x <= high[0] && *z >= low[1] && *z <= high[1]);
            }
            assert!(spray.pressure().iter().chain(spray.impacts()).all(|value| value.is_finite()));
            let now = water.volume() + spray.mass() / 1000.0;
            assert!((now / total - 1.0).abs() < 1e-12);
        }
    }
}

#[test]
fn panels_without_area_and_spheres_without_radius_are_refused() {
    let flat = panel([[0.0; 3], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0], [3.0, 0.0, 0.0]]);
    assert!(Solids::new(&state::Model { panels: vec![flat], ..state::Model::default() }).is_err());
    for radius in [0.0, -1.0, f64::NAN] {
        let model = state::Model { spheres: vec![sphere([0.0; 3], radius)], ..state::Model::default() };
        let error = Solids::new(&model).unwrap_err();
        assert!(error.to_string().starts_with("the model: "), "{error}");
    }
    assert!(Solids::new(&state::Model::default()).unwrap().is_empty());
}
