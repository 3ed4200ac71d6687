//! Trials whose right answer is known in closed form: dam breaks, standing waves, a weir. Benchmarks print what tests bound.

use std::f64::consts::PI;

use super::{Forcing, Grid, Water, WaterSettings, analytic};

/// Water without friction.
pub(super) fn smooth() -> WaterSettings {
    WaterSettings { friction: 1.0, ..WaterSettings::default() }
}

/// One value for each column of a map, by the place of its centre.
pub(super) fn each(grid: &Grid, value: impl FnMut([f64; 2]) -> f64) -> Vec<f64> {
    (0..grid.count()).map(|column| grid.centre(column)).map(value).collect()
}

/// Runs for `seconds` in the largest steps.
pub(super) fn run(water: &mut Water, seconds: f64) {
    let mut time = 0.0;
    while time < seconds {
        let dt = water.largest_step().seconds.min(seconds - time);
        water.step(dt, &Forcing::default());
        time += dt;
    }
}

/// Period of a small standing wave of `modes` half waves along x and z in a closed basin, over the theory's.
pub fn period(count: [usize; 2], width: [f64; 2], modes: [u32; 2], cell_height: Option<f64>) -> f64 {
    let grid = Grid { nx: count[0], nz: count[1], width, origin: [0.5 * width[0], 0.5 * width[1]] };
    let size = [count[0] as f64 * width[0], count[1] as f64 * width[1]];
    let still = 0.1;
    let shape = each(&grid, |[x, z]| {
        (PI * f64::from(modes[0]) * x / size[0]).cos() * (PI * f64::from(modes[1]) * z / size[1]).cos()
    });
    let depth = shape.iter().map(|shape| still + 1e-5 * shape).collect();
    let mut water = Water::new(grid, vec![0.0; grid.count()], depth, WaterSettings { cell_height, ..smooth() });
    let amplitude = |water: &Water| -> f64 { water.depth().iter().zip(&shape).map(|(d, s)| (d - still) * s).sum() };
    let dt = water.largest_step().seconds;
    let (mut time, mut crossings, mut before) = (0.0, Vec::new(), amplitude(&water));
    while crossings.len() < 3 {
        water.step(dt, &Forcing::default());
        let after = amplitude(&water);
        if before * after < 0.0 {
            crossings.push(time + dt * before / (before - after));
        }
        (time, before) = (time + dt, after);
    }
    (crossings[2] - crossings[0]) / analytic::standing_wave_period(size, modes, still, 9.81)
}

/// Relative L1 error of the depth 1.2 s after a dam 1 m deep broke over water `right` m deep, in `count` columns along 20 m.
pub fn dam_break(count: usize, right: f64) -> f64 {
    let (length, time, width) = (20.0, 1.2, 20.0 / count as f64);
    let grid = Grid { nx: count, nz: 3, width: [width; 2], origin: [0.5 * (width - length), 0.0] };
    let depth = each(&grid, |[x, _]| if x < 0.0 { 1.0 } else { right });
    let mut water = Water::new(grid, vec![0.0; grid.count()], depth, smooth());
    run(&mut water, time);
    let exact = each(&grid, |[x, _]| match right {
        0.0 => analytic::ritter_dam_break(1.0, 9.81, x, time)[0],
        _ => analytic::stoker_dam_break(1.0, right, 9.81, x, time)[0],
    });
    let error: f64 = water.depth().iter().zip(&exact).map(|(depth, exact)| (depth - exact).abs()).sum();
    error / exact.iter().sum::<f64>()
}

/// Relative error of the discharge over a crest 1 m long and 0.5 m high, against critical flow under the same energy; columns
/// are `width` m wide.
///
/// # Panics
/// If the flow has not become steady.
pub fn weir(width: f64) -> f64 {
    let (upstream, crest, height, discharge) = (2.0, 1.0, 0.5, 0.1);
    let count = ((upstream + crest + 0.6) / width).round() as usize;
    let grid = Grid { nx: count, nz: 3, width: [width; 2], origin: [0.5 * width; 2] };
    let base = each(&grid, |[x, _]| match x {
        x if x < upstream => 0.0,
        x if x < upstream + crest => height,
        _ => -1.0,
    });
    let depth = base.iter().map(|base| if *base == 0.0 { height + 0.14 } else { 0.0 }).collect();
    let mut water = Water::new(grid, base, depth, WaterSettings { friction: 0.9999, ..smooth() });
    let mut time = 0.0;
    while time < 25.0 {
        let dt = water.largest_step().seconds;
        water.step(dt, &Forcing::default());
        for z in 0..3 {
            water.give(z * count, discharge * width * dt);
            water.set_depth(z * count + count - 1, 0.0);
        }
        time += dt;
    }
    let place = count + (0.5 * upstream / width) as usize;
    let crest = count + ((upstream + 0.5 * crest) / width) as usize;
    let flow = water.flow_at(crest)[0] * water.depth()[crest];
    assert!((flow / discharge - 1.0).abs() < 0.01, "not steady: {flow}");
    let head = water.top(place) - height + water.flow_at(place)[0].powi(2) / (2.0 * 9.81);
    discharge / analytic::weir_discharge(analytic::BROAD_CREST, 1.0, head, 9.81) - 1.0
}
