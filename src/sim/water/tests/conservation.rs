//! No water is made or lost.

use super::*;

/// A repeatable number in 0..1.
pub(super) fn random(seed: &mut u64) -> f64 {
    *seed = seed.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
    (*seed >> 11) as f64 / (1u64 << 53) as f64
}

#[test]
fn a_violent_flood_over_cliffs_and_dry_beds_loses_no_water_in_10_000_steps() {
    let grid = Grid { nx: 17, nz: 13, width: [0.5, 0.5], origin: [0.0; 2] };
    let mut seed = 7;
    let base: Vec<f64> =
        (0..grid.count()).map(|_| if random(&mut seed) < 0.2 { 40.0 } else { random(&mut seed) }).collect();
    let depth: Vec<f64> =
        (0..grid.count()).map(|_| if random(&mut seed) < 0.4 { 0.0 } else { 20.0 * random(&mut seed) }).collect();
    for friction in [1.0, 0.995] {
        let mut water =
            Water::new(grid, base.clone(), depth.clone(), WaterSettings { friction, ..WaterSettings::default() });
        let before = water.volume();
        for step in 0..10_000 {
            // Now and then far too long a step.
            let dt = water.largest_step().seconds * if step % 97 == 0 { 50.0 } else { 1.0 };
            water.step(dt, &Forcing::default());
            assert!(water.depth().iter().all(|depth| *depth >= 0.0), "step {step}");
        }
        assert!((water.volume() / before - 1.0).abs() < 1e-12, "{} of {before}", water.volume());
        assert!(water.flow().iter().flatten().all(|speed| speed.abs() < 30.0));
    }
}
