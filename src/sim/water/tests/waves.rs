//! Speeds of waves and bores against closed forms.

use super::*;
use crate::sim::trials::{dam_break, period};
use std::f64::consts::PI;

#[test]
fn standing_waves_swing_in_time_along_axes_and_diagonals() {
    // Square and oblong columns. Wrong weights of the diagonals would change all speeds: without the diagonal pipes, or with
    // whole ones beside whole axial ones, by over 15 %.
    for width in [[0.1, 0.1], [0.1, 0.3], [0.25, 0.1]] {
        for modes in [[1, 0], [0, 1], [1, 1], [2, 1]] {
            let ratio = period([24, 24], width, modes, None);
            assert!((ratio - 1.0).abs() < 0.005, "{width:?} {modes:?}: {ratio}");
        }
    }
    // The error is that of the nine-point Laplacian: four times less with twice the columns.
    let [coarse, fine] = [10, 20].map(|n| period([n, n], [0.1; 2], [1, 1], None) - 1.0);
    assert!((coarse / fine - 4.0).abs() < 0.3, "{coarse} {fine}");
    let divided = period([12, 12], [0.1; 2], [1, 1], Some(0.03));
    assert!((divided - 1.0).abs() < 0.01, "{divided}");
}

#[test]
fn a_wave_in_a_channel_across_the_columns_swings_in_time() {
    // A channel at 45 degrees with stepped banks, 12 columns wide: what runs along it are the diagonal pipes.
    let n = 60;
    let grid = square(n, n, 0.1);
    let along = |[x, z]: [f64; 2]| (x + z) / 2f64.sqrt();
    let across = |[x, z]: [f64; 2]| (x - z) / 2f64.sqrt();
    let [from, to] = [1.5, 6.5];
    let inside = |place: [f64; 2]| along(place) > from && along(place) < to && across(place).abs() < 0.85;
    let base = each(&grid, |place| if inside(place) { 0.0 } else { 5.0 });
    let shape = each(&grid, |place| if inside(place) { (PI * (along(place) - from) / (to - from)).cos() } else { 0.0 });
    let depth = base.iter().zip(&shape).map(|(b, s)| if *b == 0.0 { 0.1 + 1e-5 * s } else { 0.0 }).collect();
    let mut water = Water::new(grid, base, depth, smooth());
    let swing = |water: &Water| -> f64 { water.depth().iter().zip(&shape).map(|(d, s)| (d - 0.1) * s).sum() };
    let dt = water.largest_step().seconds;
    let (mut time, mut crossings, mut before) = (0.0, Vec::new(), swing(&water));
    while crossings.len() < 3 {
        water.step(dt, &Forcing::default());
        let after = swing(&water);
        if before * after < 0.0 {
            crossings.push(time + dt * before / (before - after));
        }
        (time, before) = (time + dt, after);
    }
    let ratio = (crossings[2] - crossings[0]) / analytic::standing_wave_period([to - from, 1.0], [1, 0], 0.1, 9.81);
    assert!((ratio - 1.0).abs() < 0.03, "{ratio}");
}

#[test]
fn a_dam_break_comes_nearer_to_stoker_and_ritter_with_more_columns() {
    for (right, bound) in [(0.5, 0.007), (0.1, 0.02), (0.0, 0.03)] {
        let [coarse, fine] = [100, 200].map(|count| dam_break(count, right));
        assert!(coarse < bound && fine < 0.7 * coarse, "bed under {right} m: {coarse} {fine}");
    }
}

#[test]
fn a_round_dam_break_stays_round() {
    let grid = Grid { nx: 81, nz: 81, width: [0.1; 2], origin: [-4.0; 2] };
    let depth = each(&grid, |[x, z]| if x.hypot(z) < 1.2 { 1.0 } else { 0.3 });
    let mut water = Water::new(grid, vec![0.0; grid.count()], depth, smooth());
    run(&mut water, 0.8);
    let depth = |x: f64, z: f64| {
        let (x, z) = ((x + 4.0) / 0.1, (z + 4.0) / 0.1);
        let (i, j) = (x.floor(), z.floor());
        let at = |a: f64, b: f64| water.depth()[(j + b) as usize * 81 + (i + a) as usize];
        let row = |b: f64| at(0.0, b) + (x - i) * (at(1.0, b) - at(0.0, b));
        row(0.0) + (z - j) * (row(1.0) - row(0.0))
    };
    let fronts: Vec<f64> = [0.0f64, 15.0, 22.5, 30.0, 45.0]
        .into_iter()
        .map(|angle| {
            let (sin, cos) = angle.to_radians().sin_cos();
            let mut radius = 3.9;
            while depth(radius * cos, radius * sin) < 0.33 {
                radius -= 0.005;
            }
            radius
        })
        .collect();
    let (least, most) = fronts.iter().fold((9.0f64, 0.0f64), |(a, b), r| (a.min(*r), b.max(*r)));
    assert!(least > 2.5 && most / least < 1.01, "{fronts:?}");
}
