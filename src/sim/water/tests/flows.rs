//! Steady flows: crests, slopes, friction, rivers.

use super::*;
use crate::sim::trials::weir;
use crate::sim::water::layout::OFFSETS;

#[test]
fn a_broad_crest_passes_critical_flow() {
    let [coarse, fine] = [0.2, 0.1].map(weir);
    assert!(coarse.abs() < 0.12 && fine.abs() < 0.04, "{coarse} {fine}");
}

#[test]
fn friction_does_not_depend_on_the_step() {
    // A channel under a steady difference of pressure would need a loop; a slope with water as deep everywhere is one while
    // its ends are far: v = g s (1 - exp(-k t)) / k, k = -ln(0.995) / 0.01 s.
    let (slope, seconds) = (0.05, 2.0);
    let rate = -(0.995f64.ln()) / 0.01;
    let exact = 9.81 * slope * (1.0 - (-rate * seconds).exp()) / rate;
    for steps in [20, 100, 1000] {
        let grid = square(60, 3, 1.0);
        let base = each(&grid, |[x, _]| 10.0 - slope * x);
        let mut water = Water::new(grid, base, vec![0.1; grid.count()], WaterSettings::default());
        for _ in 0..steps {
            water.step(seconds / f64::from(steps), &Forcing::default());
        }
        let [x, z] = water.flow_at(60 + 30);
        assert!((x / exact - 1.0).abs() < 1e-6 && z.abs() < 1e-9, "{steps} steps: {x} for {exact}");
    }
    // No friction at all, and so much that nothing moves.
    for (friction, least, most) in [(1.0, 0.98, 0.982), (0.0, 0.0, 0.0)] {
        let grid = square(60, 3, 1.0);
        let base = each(&grid, |[x, _]| 10.0 - slope * x);
        let mut water = Water::new(grid, base, vec![0.1; grid.count()], WaterSettings { friction, ..smooth() });
        for _ in 0..100 {
            water.step(0.02, &Forcing::default());
        }
        assert!((least..=most).contains(&water.flow_at(60 + 30)[0]), "{friction}: {:?}", water.flow_at(90));
    }
}

#[test]
fn a_rough_bed_lets_manning_s_speed_pass_in_every_direction() {
    // v = h^(2/3) sqrt(s) / n, also in steps so long that the drag would turn the flow round if it were not solved for.
    for (direction, steps) in [([1.0, 0.0], 400), ([0.6, 0.8], 400), ([1.0, 0.0], 40)] {
        let grid = square(41, 41, 10.0);
        let base = each(&grid, |[x, z]| 10.0 - 0.01 * (x * direction[0] + z * direction[1]));
        let settings = WaterSettings { manning: 0.06, ..smooth() };
        let mut water = Water::new(grid, base, vec![0.1; grid.count()], settings);
        for _ in 0..steps {
            water.step(40.0 / f64::from(steps), &Forcing::default());
        }
        let column = 20 * 41 + 20;
        let exact = water.depth()[column].powf(2.0 / 3.0) * 0.1 / 0.06;
        let [x, z] = water.flow_at(column);
        assert!((x.hypot(z) / exact - 1.0).abs() < 0.01, "{direction:?}: {x} {z} for {exact}");
        assert!((x * direction[1] - z * direction[0]).abs() < 0.01 * exact);
    }
}

#[test]
fn a_stream_is_not_pushed_out_of_its_bed() {
    // Fast water beside slow water under one level surface goes on as it is: all of it runs straight. The difference of
    // v^2 / 2 alone would push the fast water sideways until the surface stands v^2 / 2 g lower there: 0.2 m here.
    let (nx, nz) = (120, 21);
    let grid = square(nx, nz, 0.5);
    let speed = |z: usize| if z.abs_diff(10) < 4 { 2.0 } else { 0.5 };
    let mut water = Water::new(grid, vec![0.0; grid.count()], vec![1.0; grid.count()], smooth());
    let layout = Layout::new(&grid);
    water.last_step = 0.01;
    for (family, offset) in OFFSETS.into_iter().enumerate() {
        for z in 0..nz {
            for x in 0..nx {
                let (end_x, end_z) = (x as isize + offset[0], z as isize + offset[1]);
                if !(0..nx as isize).contains(&end_x) || !(0..nz as isize).contains(&end_z) {
                    continue;
                }
                let mean = 0.5 * (speed(z) + speed(end_z as usize));
                let pipe = layout.pipe(layout.padded(x, z), family);
                water.pipes.eta[pipe] = mean * layout.direction[family][0];
                let section = layout.sections(z + 1)[family * layout.stride + layout.padded(x, 0) % layout.stride];
                water.pipes.moved[pipe] = water.pipes.eta[pipe] * section * water.last_step;
            }
        }
    }
    let flow = |water: &Water, z: usize| water.flow_at(z * nx + nx / 2);
    assert!((flow(&water, 10)[0] - 2.0).abs() < 1e-9 && (flow(&water, 2)[0] - 0.5).abs() < 1e-9);
    run(&mut water, 1.5);
    for z in 0..nz {
        let [_, across] = flow(&water, z);
        assert!((water.depth()[z * nx + nx / 2] - 1.0).abs() < 0.01 && across.abs() < 0.02, "row {z}: {across}");
    }
    assert!(flow(&water, 10)[0] > 1.9 && flow(&water, 2)[0] < 0.6, "{:?} {:?}", flow(&water, 10), flow(&water, 2));
}

#[test]
fn a_river_over_rough_ground_and_cliffs_stays_as_fast_as_its_fall_allows() {
    // 10,000 steps without any friction, also at twice the usual Courant number: the greatest fall is 6.6 m, that is 11 m/s.
    for (courant, steps) in [(0.4, 10_000), (0.8, 2_000)] {
        let (nx, nz) = (30, 20);
        let grid = square(nx, nz, 0.25);
        let seed = &mut 1;
        let base = each(&grid, |[x, z]| {
            let cliff = if random(seed) < 0.03 { 5.0 } else { 0.0 } - if x > 4.0 { 2.0 } else { 0.0 };
            20.0 - 0.05 * x + 0.15 * (z - 2.5).abs() + 0.3 * random(seed) + cliff
        });
        let mut water = Water::new(grid, base, vec![0.0; grid.count()], WaterSettings { courant, ..smooth() });
        let (mut time, mut out, mut volume) = (0.0, 0.0, 0.0);
        for step in 0..steps {
            let dt = water.largest_step().seconds.min(0.02);
            water.step(dt, &Forcing::default());
            for z in 8..12 {
                water.give(z * nx, 0.1 * dt);
            }
            for z in 0..nz {
                out -= water.set_depth(z * nx + nx - 1, 0.0);
            }
            time += dt;
            if step >= steps / 2 {
                assert!(fastest(&water) < 11.0, "step {step}: {}", fastest(&water));
                volume = water.volume();
            }
        }
        assert!((out + volume - 0.4 * time).abs() < 1e-9 * out, "{out} {volume} {time}");
        assert!(out > volume, "it runs off: {out} {volume}");
    }
}

#[test]
fn odd_and_even_columns_do_not_part() {
    // A checkerboard on running water must fade, not grow.
    let grid = square(40, 20, 0.5);
    let base = each(&grid, |[x, _]| 10.0 - 0.05 * x);
    let odd = |column: usize| if (column % 40 + column / 40).is_multiple_of(2) { 1.0 } else { -1.0 };
    let depth = (0..grid.count()).map(|column| 0.5 + 0.01 * odd(column)).collect();
    let mut water = Water::new(grid, base, depth, smooth());
    let part = |water: &Water| -> f64 {
        let inner = |column: &usize| (10..30).contains(&(column % 40)) && (5..15).contains(&(column / 40));
        (0..800).filter(inner).map(|column| odd(column) * water.depth()[column]).sum::<f64>().abs() / 200.0
    };
    assert!((part(&water) - 0.01).abs() < 1e-12);
    let mut most = 0.0f64;
    for step in 0..100 {
        water.step(water.largest_step().seconds, &Forcing::default());
        if step >= 60 {
            most = most.max(part(&water));
        }
    }
    assert!(most < 0.005, "{most}");
}
