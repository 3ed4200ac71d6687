//! Rays aimed at borders, corners and flat water, from both sides: each must hit.

use std::io::Write;

use rayon::prelude::*;

use super::work::{self, Random};
use super::{BenchError, Settings};
use crate::scene::SolverKind;
use crate::surface::{LANES, LaneHits, LaneRays, LaneSurface, Lattice, SolveCounts, SplineSurface};

/// Counts rays that pass through a surface which they must cross, over `count` rays.
pub fn leaks(surface: &SplineSurface, size: [usize; 2], count: usize, seed: u64) -> u64 {
    let chunk = 16_384;
    (0..count.div_ceil(chunk))
        .into_par_iter()
        .map(|block| {
            let rays = work::border_rays(size, chunk.min(count - block * chunk), seed + block as u64);
            let mut leaked = 0;
            for packet in rays.chunks(LANES) {
                let lanes = LaneRays::unbounded(packet, 1e-5);
                let mut hits = LaneHits::EMPTY;
                let mut counts = SolveCounts::default();
                surface.closest(&lanes, &mut hits, &mut counts);
                let any = surface.occluded(&lanes, &mut counts);
                // A slanted ray may leave over the domain's edge before it reaches the water: no leak.
                for (lane, (origin, direction)) in packet.iter().enumerate() {
                    let bounds = surface.bounds();
                    let crosses = [bounds[0].y, bounds[1].y].iter().all(|&y| {
                        let t = (y - origin.y) / direction.y;
                        let at = *origin + *direction * t;
                        (0.0..=size[0] as f32).contains(&at.x) && (0.0..=size[1] as f32).contains(&at.z)
                    });
                    leaked += u64::from(crosses && (hits.hit >> lane & 1 == 0 || any >> lane & 1 == 0));
                }
            }
            leaked
        })
        .sum()
}

/// Waves, flat water and steps, every order; 10 million rays in all (200,000 with `quick`).
///
/// # Errors
/// [`BenchError::Leaks`] if any ray passed.
pub fn run(settings: &Settings, out: &mut impl Write) -> Result<(), BenchError> {
    let total = if settings.quick { 200_000 } else { 10_000_000 };
    let size = [64, 64];
    let mut random = Random::new(5);
    let steps: Vec<f64> = (0..size[0] * size[1]).map(|_| random.within(-5.0, 5.0)).collect();
    let mut leaked = 0;
    writeln!(out, "{:<10}{:>6}{:>12}{:>9}", "water", "order", "rays", "leaked")?;
    for order in 2..=4 {
        let flat = Lattice::new(order, size, [0.5; 2], [1.0; 2], &vec![0.25; size[0] * size[1]], |_| true)?;
        let rough = Lattice::new(order, size, [0.5; 2], [1.0; 2], &steps, |_| true)?;
        for (name, lattice) in [("waves", work::surface(size, order)?), ("flat", flat), ("rough", rough)] {
            let surface = SplineSurface::new(lattice, SolverKind::Univariate, settings.simd);
            let count = total / 9;
            let found = leaks(&surface, size, count, u64::from(order) << 32);
            writeln!(out, "{name:<10}{order:>6}{count:>12}{found:>9}")?;
            out.flush()?;
            leaked += found;
        }
    }
    if leaked == 0 { Ok(()) } else { Err(BenchError::Leaks(leaked)) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::SimdLevel;

    #[test]
    fn no_ray_leaks_at_any_width() {
        for simd in SimdLevel::ALL {
            let settings = Settings { quick: true, simd, threads: 1, sizes: Vec::new(), csv: None, json: None };
            run(&settings, &mut std::io::sink()).unwrap();
        }
    }
}
