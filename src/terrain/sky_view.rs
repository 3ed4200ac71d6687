//! How much of the sky each column of ground sees past the land around it.
//!
//! Horizons are scanned in sixteen directions over whole columns; beyond the last step the land is taken as open. An
//! approximation for ambient light: the bed's own shadows are traced, these are not.

use glam::DVec3;
use rayon::prelude::*;

use crate::state;

use super::waterline::Grid;

/// Directions as whole steps of columns, one of each opposite pair per entry.
const DIRECTIONS: [(isize, isize); 16] = [
    (1, 0),
    (2, 1),
    (1, 1),
    (1, 2),
    (0, 1),
    (-1, 2),
    (-1, 1),
    (-2, 1),
    (-1, 0),
    (-2, -1),
    (-1, -1),
    (-1, -2),
    (0, -1),
    (1, -2),
    (1, -1),
    (2, -1),
];
/// Multiples of a step that are looked at: near ones all, far ones sparsely.
const STEPS: [isize; 9] = [1, 2, 3, 4, 6, 9, 13, 19, 28];

/// Share of the sky seen from each column, 0..1.
#[derive(Clone, Debug)]
pub struct SkyView {
    grid: Grid,
    share: Vec<f32>,
}

impl SkyView {
    /// From the heights of the bed.
    ///
    /// The share is weighted by the cosine with up: 1 on open ground, near 0 in a shaft.
    pub fn build(columns: &state::Columns, origin: DVec3) -> Self {
        let (nx, nz) = (columns.nx, columns.nz);
        // Relative to one height, so that single precision keeps its millimetres at any altitude.
        let reference = columns.base.first().copied().unwrap_or(0.0);
        let height: Vec<f32> = columns.base.iter().map(|base| (base - reference) as f32).collect();
        let weight = azimuth_weights(columns.width);
        let mut share = vec![0.0f32; nx * nz];
        share.par_chunks_mut(nx).enumerate().for_each_init(
            || vec![0.0f32; nx],
            |slope, (z, row)| {
                for (&(dx, dz), &weight) in DIRECTIONS.iter().zip(&weight) {
                    slope.fill(0.0);
                    let length = (dx as f64 * columns.width[0]).hypot(dz as f64 * columns.width[1]);
                    for step in STEPS {
                        let (ox, oz) = (dx * step, z as isize + dz * step);
                        if oz < 0 || oz >= nz as isize || ox.unsigned_abs() >= nx {
                            break;
                        }
                        let per_metre = (1.0 / (length * step as f64)) as f32;
                        // Columns x for which x + ox is on the map.
                        let (low, high) = ((-ox).max(0) as usize, (nx as isize - ox.max(0)) as usize);
                        let here = &height[z * nx + low..z * nx + high];
                        let other = (oz as usize * nx) as isize + ox;
                        let there = &height[(other + low as isize) as usize..(other + high as isize) as usize];
                        for ((slope, here), there) in slope[low..high].iter_mut().zip(here).zip(there) {
                            *slope = slope.max((there - here) * per_metre);
                        }
                    }
                    // Above a horizon of slope s a wedge of sky holds cos^2 of its angle: 1 / (1 + s^2).
                    for (share, slope) in row.iter_mut().zip(slope.iter()) {
                        *share += weight / (1.0 + slope * slope);
                    }
                }
            },
        );
        Self { grid: Grid::new(columns, origin), share }
    }

    /// Share of the sky seen at a local place.
    #[inline]
    pub fn at(&self, x: f32, z: f32) -> f32 {
        self.grid.at(&self.share, x, z)
    }
}

/// Share of the circle that each direction stands for: half the way to both neighbours. Sums to 1.
fn azimuth_weights(width: [f64; 2]) -> [f32; 16] {
    let angle = DIRECTIONS.map(|(dx, dz)| (dz as f64 * width[1]).atan2(dx as f64 * width[0]));
    std::array::from_fn(|i| {
        let gap = (angle[(i + 1) % 16] - angle[(i + 15) % 16]).rem_euclid(std::f64::consts::TAU);
        (0.5 * gap / std::f64::consts::TAU) as f32
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn land(nx: usize, nz: usize, width: [f64; 2], height: impl Fn(f64, f64) -> f64) -> state::Columns {
        let base: Vec<f64> =
            (0..nx * nz).map(|i| height((i % nx) as f64 * width[0], (i / nx) as f64 * width[1])).collect();
        state::Columns { origin: [0.0; 2], width, nx, nz, top: base.clone(), base, ..Default::default() }
    }

    #[test]
    fn level_ground_and_summits_see_all_of_it() {
        let flat = SkyView::build(&land(9, 7, [1.0, 1.0], |_, _| 4000.0), DVec3::ZERO);
        let cone = SkyView::build(&land(41, 41, [1.0, 1.0], |x, z| -(x - 20.0).hypot(z - 20.0)), DVec3::ZERO);
        assert!((flat.at(3.3, 2.2) - 1.0).abs() < 1e-6);
        assert!((cone.at(20.0, 20.0) - 1.0).abs() < 1e-6);
    }

    #[test]
    fn the_foot_of_a_funnel_sees_the_cosine_squared() {
        // Walls of slope 1 all around: horizon at 45 degrees, cos^2 = 1/2, whatever the columns' shape.
        for width in [[1.0, 1.0], [1.0, 3.0]] {
            let columns = land(41, 41, width, |x, z| (x - 20.0 * width[0]).hypot(z - 20.0 * width[1]));
            let view = SkyView::build(&columns, DVec3::ZERO);
            let share = view.at(20.0 * width[0] as f32, 20.0 * width[1] as f32);
            assert!((share - 0.5).abs() < 1e-3, "{share}");
        }
    }

    #[test]
    fn a_cliff_hides_half_and_a_shaft_nearly_all() {
        let cliff = SkyView::build(&land(60, 60, [1.0, 1.0], |x, _| if x > 30.0 { 1000.0 } else { 0.0 }), DVec3::ZERO);
        let foot = cliff.at(30.0, 30.0);
        assert!((foot - 0.5).abs() < 0.08, "{foot}");
        assert!((cliff.at(50.0, 30.0) - 1.0).abs() < 1e-6);
        let shaft = SkyView::build(
            &land(21, 21, [1.0, 1.0], |x, z| if x == 10.0 && z == 10.0 { -100.0 } else { 0.0 }),
            DVec3::ZERO,
        );
        assert!(shaft.at(10.0, 10.0) < 0.01);
    }

    #[test]
    fn weights_share_the_circle() {
        for width in [[1.0, 1.0], [0.1, 10.0], [90.0, 30.0]] {
            let weight = azimuth_weights(width);
            assert!((weight.iter().sum::<f32>() - 1.0).abs() < 1e-5);
            assert!(weight.iter().all(|&w| w > 0.0));
        }
    }

    #[test]
    fn a_large_map_takes_little_time_and_stays_a_share() {
        let columns = land(400, 400, [0.25, 0.25], |x, z| (x * 1.3).sin() * (z * 0.7).cos() * 3.0);
        let start = std::time::Instant::now();
        let view = SkyView::build(&columns, DVec3::ZERO);
        let seconds = start.elapsed().as_secs_f64();
        assert!(view.share.iter().all(|share| (0.0..=1.000_01).contains(share)));
        assert!(view.share.iter().any(|&share| share < 0.8));
        // Measured at 20 ms on two cores; the limit leaves room for a busy machine.
        assert!(seconds < 1.0, "{seconds} s");
        println!("sky view of 400 x 400 columns: {:.1} ms", seconds * 1e3);
    }
}
