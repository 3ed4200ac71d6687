//! Rays aimed at borders, corners and flat water, from both sides: each must hit.

use std::io::Write;

use rayon::prelude::*;

use super::rows::Row;
use super::sheet::Sheet;
use super::work::{self, Random};
use super::{BenchError, Settings, size_name};
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

/// Waves, flat water and steps, every order, every kernel: 100 million rays through each (200,000 with `quick`).
///
/// # Errors
/// [`BenchError::Leaks`] if any ray passed.
pub fn run(settings: &Settings, out: &mut impl Write) -> Result<(), BenchError> {
    let total = settings.rays.unwrap_or(if settings.quick { 200_000 } else { 100_000_000 });
    let size = settings.sizes.first().copied().unwrap_or([64, 64]);
    let mut random = Random::new(5);
    let steps: Vec<f64> = (0..size[0] * size[1]).map(|_| random.within(-5.0, 5.0)).collect();
    let mut leaked = 0;
    let mut sheet = Sheet::new(settings, out)?;
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(settings.threads)
        .build()
        .map_err(|error| BenchError::Internal(error.to_string()))?;
    sheet.table(&["water", "order", "kernel", "rays", "leaked"])?;
    for &simd in &settings.kernels {
        for order in 2..=4 {
            let flat = Lattice::new(order, size, [0.5; 2], [1.0; 2], &vec![0.25; size[0] * size[1]], |_| true)?;
            let rough = Lattice::new(order, size, [0.5; 2], [1.0; 2], &steps, |_| true)?;
            for (name, lattice) in [("waves", work::surface(size, order)?), ("flat", flat), ("rough", rough)] {
                let surface = SplineSurface::new(lattice, SolverKind::Univariate, simd);
                let count = total.div_ceil(9);
                let found = pool.install(|| leaks(&surface, size, count, u64::from(order) << 32));
                leaked += found;
                let row = Row {
                    bench: "leaks".to_owned(),
                    columns: size_name(size),
                    order,
                    accel: "walk".to_owned(),
                    solver: SolverKind::Univariate.name().to_owned(),
                    simd: simd.name().to_owned(),
                    batch: true,
                    rays: name.to_owned(),
                    checked: count as u64,
                    lost: found,
                    threads: settings.threads,
                    ..Row::default()
                };
                let cells = [order.to_string(), simd.name().to_owned(), count.to_string(), found.to_string()];
                sheet.row(&[&[name.to_owned()], &cells[..]].concat(), row)?;
            }
        }
    }
    if leaked == 0 { Ok(()) } else { Err(BenchError::Leaks(leaked)) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_ray_leaks_at_any_width() {
        let settings = Settings { quick: true, ..Settings::default() };
        run(&settings, &mut std::io::sink()).unwrap();
    }

    #[test]
    fn a_hole_is_found() {
        // One dry column among its neighbours leaves no patch there only if all that lean on it are dry.
        let holed = Lattice::new(3, [64; 2], [0.5; 2], [1.0; 2], &vec![0.0; 64 * 64], |k| k % 64 < 40).unwrap();
        let surface = SplineSurface::new(holed, SolverKind::Univariate, Settings::default().simd);
        assert!(leaks(&surface, [64; 2], 1000, 1) > 100);
    }
}
