//! The lace of foam: meshes of filaments at five scales, as one Gaussian field whose statistics are known exactly.
//!
//! Each scale is the difference of distances to the two nearest points of a jittered lattice (S. Worley, A cellular texture
//! basis function, 1996), 0 on the filaments between cells, bent by a slow warp, and turned into a standard normal variable by
//! its own distribution. A sum of such fields with weights whose squares add up to 1 is standard normal again: so a threshold
//! covers a share that is known, however scales and layers are mixed (E. Heitz and F. Neyret, High-performance by-example noise
//! using a histogram-preserving blending operator, 2018), and what a pixel cannot resolve becomes a wider, softer threshold.

use std::sync::LazyLock;

use glam::Vec2;

/// Size and weight of each scale, relative to the pattern's; the squares of the weights add up to 1. No size is a whole
/// multiple of another.
const SCALES: [(f32, f32); 5] =
    [(6.91, 0.321), (2.63, 0.4515), (1.0, 0.6421), (1.0 / 2.37, 0.4214), (1.0 / 5.61, 0.3211)];
/// Cosine and sine of the golden angle, by which each lattice is turned against the one before.
const TURN: Vec2 = Vec2::new(-0.737_369, 0.675_490);
/// Share of its cell within which a lattice's point lies: the two nearest are then (all but always) among 3 x 3 cells.
const JITTER: f32 = 0.9;
/// How far the warp bends a filament, in cells.
const WARP: f32 = 0.45;

/// The field over a plane at some scale; `u` in meshes of the pattern's own scale, `footprint` likewise. The resolved part of the
/// standard normal field, and its variance (the square of what is left of each weight).
pub(super) fn lace(u: Vec2, footprint: f32, seed: u32) -> (f32, f32) {
    let (mut sum, mut variance) = (0.0, 0.0);
    let mut turn = Vec2::X;
    for (index, (size, weight)) in SCALES.into_iter().enumerate() {
        let visible = weight * visibility(footprint / size);
        if visible == 0.0 {
            break;
        }
        turn = turn.rotate(TURN);
        let seed = mix(seed ^ (index as u32).wrapping_mul(0x9e37_79b9));
        let place = turn.rotate(u) / size;
        let bent = place + WARP * warp(0.7 * place, seed);
        sum += visible * DISTRIBUTION.normal(mesh(bent, seed));
        variance += visible * visible;
    }
    (sum, variance)
}

/// Grain of single bubbles: 1 on a bubble's crown, 0 between bubbles, 1/2 where a footprint (in bubbles) hides them.
pub(super) fn bubbles(u: Vec2, footprint: f32, seed: u32) -> f32 {
    let visible = visibility(footprint);
    if visible == 0.0 {
        return 0.5;
    }
    let [first, _] = nearest(u, seed);
    // The mean of a squared distance over a cell of unit area is near 0.2; it is bounded by about 1.
    0.5 + visible * (0.5 - (2.0 * first * first).min(1.0) - GRAIN_MEAN)
}

/// Mean of 1/2 - min(2 f^2, 1), f the distance to the nearest point: found by [`DISTRIBUTION`]'s way of sampling.
const GRAIN_MEAN: f32 = 0.096;

/// How much of a pattern of unit size survives averaging over a footprint: all at a quarter, none at a whole cell.
fn visibility(footprint: f32) -> f32 {
    let t = ((1.0 - footprint) / 0.75).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// A well-mixed word (MurmurHash3's finaliser).
fn mix(mut h: u32) -> u32 {
    h ^= h >> 16;
    h = h.wrapping_mul(0x85eb_ca6b);
    h ^= h >> 13;
    h = h.wrapping_mul(0xc2b2_ae35);
    h ^ (h >> 16)
}

fn hash(x: i32, z: i32, seed: u32) -> u32 {
    mix((x as u32).wrapping_mul(0x8da6_b343) ^ (z as u32).wrapping_mul(0xd816_3841) ^ seed)
}

/// Two numbers of 0..1 from a word.
fn pair(word: u32) -> Vec2 {
    Vec2::new((word & 0xffff) as f32, (word >> 16) as f32) / 65536.0
}

/// Distances to the two nearest points of the lattice.
fn nearest(u: Vec2, seed: u32) -> [f32; 2] {
    let cell = u.floor();
    let (place, [x, z]) = (u - cell, [cell.x as i32, cell.y as i32]);
    let mut found = [f32::INFINITY; 2];
    for dz in -1..=1 {
        for dx in -1..=1 {
            let jitter = JITTER * (pair(hash(x.wrapping_add(dx), z.wrapping_add(dz), seed)) - 0.5);
            let offset = Vec2::new(dx as f32 + 0.5, dz as f32 + 0.5) + jitter - place;
            let square = offset.length_squared();
            if square < found[0] {
                found = [square, found[0]];
            } else if square < found[1] {
                found[1] = square;
            }
        }
    }
    found.map(f32::sqrt)
}

/// 0 on the filaments between cells, growing towards their points.
fn mesh(u: Vec2, seed: u32) -> f32 {
    let [first, second] = nearest(u, seed);
    second - first
}

/// A smooth field of vectors of length up to about 1, independent of the lattice with the same seed.
fn warp(u: Vec2, seed: u32) -> Vec2 {
    let cell = u.floor();
    let (f, [x, z]) = (u - cell, [cell.x as i32, cell.y as i32]);
    let t = f * f * f * (f * (f * 6.0 - 15.0) + 10.0);
    let at = |dx: i32, dz: i32| 2.0 * pair(hash(x.wrapping_add(dx), z.wrapping_add(dz), !seed)) - 1.0;
    at(0, 0).lerp(at(1, 0), t.x).lerp(at(0, 1).lerp(at(1, 1), t.x), t.y)
}

/// From the value of [`mesh`] to the standard normal variable of the same rank, high on filaments.
struct Distribution {
    /// Over the square root of the value, which spreads out the filaments.
    normal: Vec<f32>,
    most: f32,
}

/// Steps of the table.
const STEPS: usize = 512;
/// Samples behind it: the rank of a value is then known to 1/500 (1 / sqrt(4 n)), and better for being evenly spread.
const SAMPLES: u32 = 1 << 16;

static DISTRIBUTION: LazyLock<Distribution> = LazyLock::new(|| {
    let mut values: Vec<f32> = spread(SAMPLES).map(|u| mesh(u, 0x5eed)).collect();
    values.sort_by(f32::total_cmp);
    let most = values[values.len() - 1];
    let count = values.len() as f64;
    let normal = (0..=STEPS)
        .map(|step| {
            let value = most * (step as f32 / STEPS as f32).powi(2);
            let below = values.partition_point(|&other| other < value) as f64;
            -normal_quantile(((below + 0.5) / (count + 1.0)) as f32)
        })
        .collect();
    Distribution { normal, most }
});

/// Points spread evenly over 256 x 256 cells (M. Roberts' R2 sequence, 2018).
fn spread(count: u32) -> impl Iterator<Item = Vec2> {
    (0..count).map(|i| {
        let at = |step: f64| ((f64::from(i) * step).fract() * 256.0) as f32;
        Vec2::new(at(0.754_877_666_246_692_7), at(0.569_840_290_998_053_2))
    })
}

impl Distribution {
    fn normal(&self, value: f32) -> f32 {
        let at = (value / self.most).clamp(0.0, 1.0).sqrt() * STEPS as f32;
        let step = (at as usize).min(STEPS - 1);
        let part = at - step as f32;
        self.normal[step] + part * (self.normal[step + 1] - self.normal[step])
    }
}

/// Share of a standard normal variable that lies below `x`, to 1e-6.
///
/// *Source*: Abramowitz and Stegun, Handbook of mathematical functions, 1964, 7.1.26.
pub(super) fn normal_share(x: f32) -> f32 {
    let z = x.abs() * std::f32::consts::FRAC_1_SQRT_2;
    let t = 1.0 / (1.0 + 0.327_591_1 * z);
    let series = t * (0.254_829_6 + t * (-0.284_496_74 + t * (1.421_413_7 + t * (-1.453_152 + t * 1.061_405_4))));
    let tail = 0.5 * series * (-z * z).exp();
    if x < 0.0 { tail } else { 1.0 - tail }
}

/// The value below which a share `p` of a standard normal variable lies, to 1e-6; infinite at 0 and 1.
///
/// *Source*: M. J. Wichura, Algorithm AS 241: the percentage points of the normal distribution, 1988 (PPND7).
pub(super) fn normal_quantile(p: f32) -> f32 {
    let q = p - 0.5;
    if q.abs() <= 0.425 {
        let r = 0.180_625 - q * q;
        let upper = ((59.109_375 * r + 159.291_14) * r + 50.434_27) * r + 3.387_133;
        let lower = ((67.187_56 * r + 78.757_76) * r + 17.895_17) * r + 1.0;
        return q * upper / lower;
    }
    let tail = if q < 0.0 { p } else { 1.0 - p };
    if tail <= 0.0 {
        return f32::INFINITY.copysign(q);
    }
    let r = (-tail.ln()).sqrt();
    let size = if r <= 5.0 {
        let r = r - 1.6;
        (((0.170_238_2 * r + 1.306_728_5) * r + 2.756_815_4) * r + 1.423_437_3)
            / ((0.120_211_33 * r + 0.737_001_64) * r + 1.0)
    } else {
        let r = r - 5.0;
        (((0.017_337_203 * r + 0.428_682_9) * r + 3.081_226_4) * r + 6.657_905)
            / ((0.012_258_203 * r + 0.241_978_95) * r + 1.0)
    };
    size.copysign(q)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_normal_distribution_and_its_inverse_agree_with_tables() {
        for (p, x) in [(0.5, 0.0), (0.841_344_8, 1.0), (0.977_249_87, 2.0), (0.001_349_898, -3.0), (0.975, 1.959_964)] {
            assert!((normal_share(x) - p).abs() < 1e-6, "{x}");
            assert!((normal_quantile(p) - x).abs() < 2e-5, "{p}: {}", normal_quantile(p));
        }
        assert_eq!((normal_quantile(0.0), normal_quantile(1.0)), (f32::NEG_INFINITY, f32::INFINITY));
        assert!((normal_quantile(1e-12) + 7.034_484).abs() < 1e-4);
    }

    #[test]
    fn the_lace_is_standard_normal_at_any_seed() {
        for seed in [1, 77, 0xdead_beef] {
            let values: Vec<f32> = spread(40_000).map(|u| lace(u, 0.0, seed).0).collect();
            let count = values.len() as f32;
            let mean = values.iter().sum::<f32>() / count;
            let variance = values.iter().map(|value| (value - mean).powi(2)).sum::<f32>() / count;
            assert!(mean.abs() < 0.02 && (variance - 1.0).abs() < 0.03, "{mean} {variance}");
            for bound in [-1.0, 0.0, 1.0, 2.0] {
                let share = values.iter().filter(|&&value| value < bound).count() as f32 / count;
                assert!((share - normal_share(bound)).abs() < 0.012, "{bound}: {share}");
            }
        }
    }

    #[test]
    fn what_a_footprint_hides_leaves_the_variance() {
        let mut before = 1.01;
        for footprint in [0.0, 0.1, 0.2, 0.4, 0.8, 2.0, 7.0] {
            let (sum, variance) = lace(Vec2::new(3.3, -7.1), footprint, 5);
            assert!(variance <= before && (footprint < 6.95 || (sum, variance) == (0.0, 0.0)));
            before = variance;
        }
        assert!((lace(Vec2::ONE, 0.0, 5).1 - 1.0).abs() < 1e-3);
    }

    #[test]
    fn the_grain_keeps_its_mean_and_its_range() {
        let values: Vec<f32> = spread(20_000).map(|u| bubbles(u, 0.0, 3)).collect();
        let mean = values.iter().sum::<f32>() / values.len() as f32;
        assert!((mean - 0.5).abs() < 0.01, "{mean}");
        assert!(values.iter().all(|value| (-0.1..=1.1).contains(value)));
        assert_eq!(bubbles(Vec2::new(0.3, 0.4), 1.0, 3), 0.5);
    }
}
