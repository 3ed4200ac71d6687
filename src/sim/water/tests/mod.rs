//! What the water must do.

use super::*;
use crate::sim::analytic;
use crate::sim::trials::{each, run, smooth};

mod conservation;
mod extremes;
mod flows;
mod waves;

/// A repeatable number in 0..1.
fn random(seed: &mut u64) -> f64 {
    *seed = seed.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
    (*seed >> 11) as f64 / (1u64 << 53) as f64
}

/// A map of `nx` by `nz` square columns whose corner lies at 0, 0.
fn square(nx: usize, nz: usize, width: f64) -> Grid {
    Grid { nx, nz, width: [width; 2], origin: [0.5 * width; 2] }
}

fn bits(water: &Water) -> Vec<u64> {
    water.depth().iter().chain(&water.pipes()).map(|value| value.to_bits()).collect()
}

fn fastest(water: &Water) -> f64 {
    water.flow().iter().map(|[x, z]| x.hypot(*z)).fold(0.0, f64::max)
}
