//! Random numbers: where in a pixel and on the lens each sample falls, and what decides its way through the scene. All
//! are low-discrepancy, and a function of the pixel and the sample alone.
//!
//! One Owen-scrambled Sobol sequence serves a square block of pixels: the pixels along a Z-curve take consecutive runs of
//! it, so that neighbours share out what one of them lacks, and the error between pixels is blue noise (A. Ahmed,
//! P. Wonka, Screen-space blue-noise diffusion of Monte Carlo sampling error via hierarchical ordering of pixels, 2020).
//! The sequence's own shuffle permutes the Z-curve at every level, for every set of dimensions anew. Blocks lie on the
//! full frame's grid.
//!
//! Filter importance sampling (M. Ernst, M. Stamminger, G. Greiner, 2006): samples are placed by the filter's own
//! density, so each weighs 1 and belongs to one pixel only. Crops and tiles therefore agree to the bit.

use glam::DVec2;

use crate::scene::{PixelFilter, Render};

/// Steps of the filter's inverse distribution; linear between them, an error under a thousandth of a pixel.
const TABLE: usize = 4096;

/// Samples of every pixel of a picture.
#[derive(Clone, Debug)]
pub struct Sampler {
    seed: u32,
    samples: u32,
    /// A pixel's run of the sequence is 2^run samples long, a block 2^side pixels wide.
    run: u32,
    side: u32,
    /// Offsets from the pixel's centre (pixels) at equal steps of the filter's distribution.
    offsets: Vec<f64>,
}

/// A pixel's part of its block's sequence.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Run {
    first: u32,
    seed: u32,
}

/// Length of the sequence (crate `sobol_burley`), as a power of two.
const LENGTH: u32 = 16;

/// One sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Raster point (pixels, y down, of the full frame).
    pub raster: DVec2,
    /// Point of the unit square that picks a point of the lens.
    pub lens: DVec2,
}

impl Sampler {
    /// Sampler for the filter, count of samples and seed of `render`.
    pub fn new(render: &Render) -> Self {
        let half = render.filter_width / 2.0;
        let offsets = match render.filter {
            // The pixel's own square is a filter of width 1, whatever `filter_width` says of the other.
            PixelFilter::Box => vec![-0.5, 0.5],
            PixelFilter::BlackmanHarris => inverse_distribution(|x| blackman_harris(x / half), half),
        };
        let samples = render.most_samples();
        let run = samples.next_power_of_two().trailing_zeros().min(LENGTH);
        Self { seed: render.seed, samples, run, side: (LENGTH - run) / 2, offsets }
    }

    /// Length of a pixel's run of the sequence, as a power of two. Samples of one length are the same samples.
    pub fn run_length(&self) -> u32 {
        self.run
    }

    /// Most samples of a pixel.
    pub fn samples(&self) -> u32 {
        self.samples
    }

    /// The numbers of the pixel at `x`, `y` of the full frame (either may be negative: overscan).
    pub fn run(&self, x: i32, y: i32) -> Run {
        let low = |value: i32| value.cast_unsigned() & ((1 << self.side) - 1);
        Run {
            first: (z_order(low(x)) | z_order(low(y)) << 1) << self.run,
            seed: pixel_seed(x >> self.side, y >> self.side, self.seed),
        }
    }

    /// Four numbers in 0..1 for sample `index` of a pixel: set 0 places it in the pixel and on the lens, the others are
    /// free. Each set is stratified in itself.
    ///
    /// *Source*: B. Burley, Practical hash-based Owen scrambling, 2020 (crate `sobol_burley`).
    #[inline]
    pub fn numbers(run: Run, index: u32, set: u32) -> [f32; 4] {
        // Beyond the sequence's own dimensions the first ones serve again under another seed.
        let sets = sobol_burley::NUM_DIMENSION_SETS_4D;
        let seed = run.seed.wrapping_add((set / sets).wrapping_mul(0x9e37_79b9));
        sobol_burley::sample_4d(run.first + index, set % sets, seed)
    }

    /// Sample `index` of the pixel at `x`, `y` of the full frame, whose numbers are `run`.
    ///
    /// A single sample has no average to make: it takes the pixel's middle and the lens' middle.
    pub fn sample(&self, x: i32, y: i32, run: Run, index: u32) -> Sample {
        let corner = DVec2::new(f64::from(x), f64::from(y));
        if self.samples == 1 {
            return Sample { raster: corner + DVec2::splat(0.5), lens: DVec2::splat(0.5) };
        }
        let [u, v, lens_u, lens_v] = Self::numbers(run, index, 0).map(f64::from);
        let offset = DVec2::new(self.offset(u), self.offset(v));
        Sample { raster: corner + DVec2::splat(0.5) + offset, lens: DVec2::new(lens_u, lens_v) }
    }

    fn offset(&self, share: f64) -> f64 {
        let place = share * (self.offsets.len() - 1) as f64;
        let step = (place as usize).min(self.offsets.len() - 2);
        let fraction = place - step as f64;
        self.offsets[step] * (1.0 - fraction) + self.offsets[step + 1] * fraction
    }
}

/// Four-term Blackman-Harris window over -1..1 (F. Harris, 1978, table 1, -92 dB).
fn blackman_harris(x: f64) -> f64 {
    let angle = std::f64::consts::PI * (x + 1.0);
    0.35875 - 0.48829 * angle.cos() + 0.14128 * (2.0 * angle).cos() - 0.01168 * (3.0 * angle).cos()
}

/// Offsets at equal steps of the distribution whose density is `weight` over -half..half.
fn inverse_distribution(weight: impl Fn(f64) -> f64, half: f64) -> Vec<f64> {
    // Midpoint sums, 16 to a step: the window's derivatives vanish at both ends, so they converge very fast.
    let cells = 16 * TABLE;
    let width = 2.0 * half / cells as f64;
    let mut sums = vec![0.0];
    for cell in 0..cells {
        sums.push(sums[cell] + weight(-half + (cell as f64 + 0.5) * width).max(0.0));
    }
    let total = sums[cells];
    (0..=TABLE)
        .map(|step| {
            let wanted = total * step as f64 / TABLE as f64;
            let cell = sums.partition_point(|&sum| sum < wanted).clamp(1, cells) - 1;
            let inside = sums[cell + 1] - sums[cell];
            let fraction = if inside > 0.0 { (wanted - sums[cell]) / inside } else { 0.5 };
            -half + (cell as f64 + fraction) * width
        })
        .collect()
}

/// The bits of a number below 256, one place apart: half of a Z-curve's index (G. Morton, 1966).
fn z_order(value: u32) -> u32 {
    let value = (value | value << 4) & 0x0f0f;
    let value = (value | value << 2) & 0x3333;
    (value | value << 1) & 0x5555
}

/// A hash of a block and the render's seed: the finaliser of MurmurHash3 (A. Appleby) over each in turn.
fn pixel_seed(x: i32, y: i32, seed: u32) -> u32 {
    fn finalise(mut hash: u32) -> u32 {
        hash = (hash ^ (hash >> 16)).wrapping_mul(0x85eb_ca6b);
        hash = (hash ^ (hash >> 13)).wrapping_mul(0xc2b2_ae35);
        hash ^ (hash >> 16)
    }
    // The odd constant is 2^32 over the golden ratio: it keeps pixel (0,0) of seed 0 from hashing to 0.
    let hash = finalise(seed.wrapping_add(0x9e37_79b9));
    let hash = finalise(hash ^ x.cast_unsigned());
    finalise(hash.wrapping_mul(0x9e37_79b1) ^ y.cast_unsigned())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sampler(samples: u32, filter: PixelFilter) -> Sampler {
        Sampler::new(&Render { samples, filter, ..Render::default() })
    }

    fn place(sampler: &Sampler, x: i32, y: i32, index: u32) -> Sample {
        sampler.sample(x, y, sampler.run(x, y), index)
    }

    #[test]
    fn offsets_follow_the_filter() {
        let sampler = sampler(4096, PixelFilter::BlackmanHarris);
        let half = Render::default().filter_width / 2.0;
        let offsets: Vec<f64> = (0..4096).map(|index| place(&sampler, 7, -3, index).raster.x - 7.5).collect();
        // Moments against sums over the window itself.
        let moment = |power: i32| {
            let cells = 100_000;
            let (mut sum, mut total) = (0.0, 0.0);
            for cell in 0..cells {
                let x = -1.0 + 2.0 * (f64::from(cell) + 0.5) / f64::from(cells);
                sum += blackman_harris(x) * (x * half).powi(power);
                total += blackman_harris(x);
            }
            sum / total
        };
        for power in 1..=4 {
            let mean = offsets.iter().map(|x| x.powi(power)).sum::<f64>() / 4096.0;
            assert!((mean - moment(power)).abs() < 2e-3, "moment {power}: {mean} against {}", moment(power));
        }
        assert!(offsets.iter().all(|x| x.abs() <= half));
    }

    #[test]
    fn box_filter_stays_in_its_pixel_evenly() {
        let sampler = sampler(256, PixelFilter::Box);
        let mut cells = [0; 16];
        for index in 0..256 {
            let place = place(&sampler, 3, 4, index).raster - DVec2::new(3.0, 4.0);
            assert!(place.x >= 0.0 && place.x < 1.0 && place.y >= 0.0 && place.y < 1.0);
            cells[(place.x * 4.0) as usize * 4 + (place.y * 4.0) as usize] += 1;
        }
        // A Sobol net of 256 points puts exactly 16 into each of 16 squares, scrambled or not.
        assert_eq!(cells, [16; 16]);
    }

    #[test]
    fn pixels_and_seeds_differ() {
        let sampler = sampler(16, PixelFilter::Box);
        let other = Sampler::new(&Render { samples: 16, filter: PixelFilter::Box, seed: 1, ..Render::default() });
        let place = |sampler: &Sampler, x: i32, y: i32| place(sampler, x, y, 0).raster - DVec2::new(x.into(), y.into());
        assert_ne!(place(&sampler, 0, 0), place(&sampler, 1, 0));
        assert_ne!(place(&sampler, 1, 0), place(&sampler, 0, 1));
        assert_ne!(place(&sampler, 5, 5), place(&other, 5, 5));
        assert_eq!(place(&sampler, 5, 5), place(&sampler, 5, 5));
    }

    #[test]
    fn single_sample_is_the_middle() {
        let sample = place(&sampler(1, PixelFilter::BlackmanHarris), 4, 9, 0);
        assert_eq!((sample.raster, sample.lens), (DVec2::new(4.5, 9.5), DVec2::splat(0.5)));
    }

    #[test]
    fn neighbours_share_out_what_one_of_them_lacks() {
        // 4 samples of each of 4x4 aligned pixels are 64 consecutive points: every dimension's 64 strata hold one each, and
        // the first two dimensions' 8x8 cells.
        let sampler = sampler(4, PixelFilter::Box);
        for (x0, y0, set) in [(0, 0, 0), (64, -8, 3), (-4, 12, 70)] {
            let (mut strata, mut cells) = ([[0; 64]; 4], [0; 64]);
            for pixel in 0..16 {
                let run = sampler.run(x0 + pixel % 4, y0 + pixel / 4);
                for index in 0..4 {
                    let numbers = Sampler::numbers(run, index, set);
                    cells[(numbers[0] * 8.0) as usize * 8 + (numbers[1] * 8.0) as usize] += 1;
                    for (strata, number) in strata.iter_mut().zip(numbers) {
                        strata[(number * 64.0) as usize] += 1;
                    }
                }
            }
            assert_eq!(strata, [[1; 64]; 4], "{x0} {y0} {set}");
            assert!(set > 0 || cells == [1; 64], "{x0} {y0}: {cells:?}");
        }
    }

    #[test]
    fn error_between_pixels_is_blue() {
        // A mean of a step function, one number per sample: white noise has equal energy in coarse and fine differences,
        // here the mean over 4x4 pixels must be far better than of 16 independent ones.
        let sampler = sampler(4, PixelFilter::Box);
        let value = |x: i32, y: i32| {
            let run = sampler.run(x, y);
            (0..4).map(|index| f64::from(Sampler::numbers(run, index, 5)[2] < 0.37)).sum::<f64>() / 4.0 - 0.37
        };
        let (mut fine, mut coarse) = (0.0, 0.0);
        for block in 0..64 {
            let (x0, y0) = (block % 8 * 4, block / 8 * 4);
            let values: Vec<f64> = (0..16).map(|pixel| value(x0 + pixel % 4, y0 + pixel / 4)).collect();
            fine += values.iter().map(|value| value * value).sum::<f64>() / 16.0;
            coarse += (values.iter().sum::<f64>() / 16.0).powi(2);
        }
        assert!(coarse < fine / 16.0 / 4.0, "{coarse} {fine}");
    }
}
