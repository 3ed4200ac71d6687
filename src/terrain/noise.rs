//! Gradient noise in octaves, anchored in the world: continuous, deterministic, filtered by the size of a pixel.
//!
//! Source: Perlin, Improving Noise, 2002 (quintic fade), with hashed gradients instead of a table, so that nothing repeats
//! within 2^32 cells, and with its analytic derivative.

use glam::{DVec3, Vec3};

/// Octaves at most: with a step of 2.1 from the coarsest, the finest is 1/800 of it.
const MOST: usize = 10;
/// Ratio of wavelengths from octave to octave; no whole number, so that lattices never line up.
const STEP: f64 = 2.1;
/// Root mean square of one octave over a plan: sqrt(8 A B V), with A and B the integrals over a cell of w^2 x^2 and w^2,
/// w = 1 - fade(x), and V = 1/3 the variance of a corner's gradient along an axis.
pub(super) const PLAN_RMS: f64 = 0.1763;

/// One frequency of a field.
#[derive(Clone, Copy, Debug)]
struct Octave {
    /// Cells per metre.
    frequency: f32,
    /// Cosine and sine of the lattice's turn about the vertical.
    turn: [f32; 2],
    /// Whole cells and the rest at the local origin: keeps the pattern in place wherever the local frame lies.
    cell: [i32; 3],
    rest: Vec3,
    seed: u32,
}

impl Octave {
    /// Place on the lattice, relative to `cell`.
    #[inline]
    fn place(&self, position: Vec3) -> Vec3 {
        let [cos, sin] = self.turn;
        let turned = Vec3::new(cos * position.x - sin * position.z, position.y, sin * position.x + cos * position.z);
        turned * self.frequency + self.rest
    }
}

/// A sum of octaves over space.
#[derive(Clone, Debug)]
pub(super) struct Field {
    octaves: [Octave; MOST],
}

impl Field {
    /// Octaves that there are.
    pub(super) const MOST: usize = MOST;

    /// A field whose coarsest cells are `size` metres wide, for a local frame around `origin`.
    pub(super) fn new(size: f64, origin: DVec3, seed: u32) -> Self {
        let octave = |index: usize| {
            let frequency = STEP.powi(index as i32) / size;
            // The golden angle never brings two of ten lattices into line.
            let (sin, cos) = (2.399_963 * index as f64 + f64::from(seed)).sin_cos();
            let turned = DVec3::new(cos * origin.x - sin * origin.z, origin.y, sin * origin.x + cos * origin.z);
            let place = turned * frequency;
            // Beyond i64 the cells wrap: the pattern is then merely another one.
            let cell = place.floor().to_array().map(|value| value as i64 as i32);
            Octave {
                frequency: frequency as f32,
                turn: [cos as f32, sin as f32],
                cell,
                rest: (place - place.floor()).as_vec3(),
                seed: seed.wrapping_mul(0x9e37_79b9).wrapping_add(index as u32),
            }
        };
        Self { octaves: std::array::from_fn(octave) }
    }

    /// How many octaves, from the coarsest, have cells of at least `cell` metres.
    pub(super) fn octaves_down_to(&self, cell: f64) -> usize {
        self.octaves.iter().take_while(|octave| 1.0 >= cell * f64::from(octave.frequency)).count()
    }

    /// Sum of octaves `first..last` over the plan (x, z) of a local position, each `gain` of the one before; about -1..1, mean 0.
    ///
    /// Octaves finer than `footprint` (m) fade into their mean. Half the price of [`with_slope`](Self::with_slope).
    #[inline]
    pub(super) fn plan(&self, position: Vec3, footprint: f32, first: usize, last: usize, gain: f32) -> f32 {
        let (mut sum, mut amplitude) = (0.0, 1.0);
        for octave in &self.octaves[first..last] {
            let visible = visibility(1.0, footprint * octave.frequency);
            if visible == 0.0 {
                break;
            }
            let place = octave.place(position);
            sum += visible * amplitude * plan_noise(place.x, place.z, [octave.cell[0], octave.cell[2]], octave.seed);
            amplitude *= gain;
        }
        sum
    }

    /// Sum of octaves in space, and beside it their gradients with equal weight: the slope of a relief whose bumps are as
    /// high as they are wide, times a constant.
    #[inline]
    pub(super) fn with_slope(
        &self,
        position: Vec3,
        footprint: f32,
        first: usize,
        last: usize,
        gain: f32,
    ) -> (f32, Vec3) {
        let (mut sum, mut slope, mut amplitude) = (0.0, Vec3::ZERO, 1.0);
        for octave in &self.octaves[first..last] {
            let visible = visibility(1.0, footprint * octave.frequency);
            if visible == 0.0 {
                break;
            }
            let [cos, sin] = octave.turn;
            let (value, g) = gradient_noise(octave.place(position), octave.cell, octave.seed);
            sum += visible * amplitude * value;
            slope += visible * Vec3::new(cos * g.x + sin * g.z, g.y, cos * g.z - sin * g.x);
            amplitude *= gain;
        }
        (sum, slope)
    }

    /// One octave of noise over height alone, for beds of rock; -1..1, mean 0.
    #[inline]
    pub(super) fn layer(&self, octave: usize, height: f32, footprint: f32) -> f32 {
        let octave = &self.octaves[octave];
        let visible = visibility(1.0, footprint * octave.frequency);
        if visible == 0.0 {
            return 0.0;
        }
        let (low, f) = split(height * octave.frequency + octave.rest.y);
        let [below, above] = products(octave.cell[1], low, BY_Y).map(|product| signed(mix(product ^ !octave.seed)));
        let t = f * f * (3.0 - 2.0 * f);
        visible * (below + (above - below) * t)
    }
}

/// How much of a pattern of this cell size survives averaging over a footprint: all of it at a quarter, none at a whole cell.
///
/// A cell is about half a wavelength, so that nothing finer than two footprints is left to alias.
#[inline]
fn visibility(cell: f32, footprint: f32) -> f32 {
    let t = ((cell - footprint) / (0.75 * cell)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// A well-mixed word from the products of a lattice point's coordinates (MurmurHash3's finaliser).
#[inline]
fn mix(products: u32) -> u32 {
    let mut h = products.wrapping_mul(0x85eb_ca6b);
    h ^= h >> 13;
    h = h.wrapping_mul(0xc2b2_ae35);
    h ^ (h >> 16)
}

/// Whole cell below a place and the way into it; std's floor is a call where the processor's own is not assumed.
#[inline]
fn split(place: f32) -> (i32, f32) {
    let whole = place as i32;
    let low = whole.wrapping_sub(i32::from(place < whole as f32));
    // Beyond 2^24 cells from the local origin no fraction is left: the clamp keeps such places finite.
    (low, (place - low as f32).clamp(0.0, 1.0))
}

/// Products of a coordinate and its successor with an odd constant.
#[inline]
fn products(cell: i32, low: i32, by: u32) -> [u32; 2] {
    let first = (cell.wrapping_add(low) as u32).wrapping_mul(by);
    [first, first.wrapping_add(by)]
}

const BY_X: u32 = 0x8da6_b343;
const BY_Y: u32 = 0xd816_3841;
const BY_Z: u32 = 0xcb1a_b31f;

/// A number in -1..1 from ten bits.
#[inline]
fn signed(bits: u32) -> f32 {
    (bits & 1023) as i32 as f32 * (2.0 / 1023.0) - 1.0
}

/// Quintic fade and its derivative.
#[inline]
fn fade(f: f32) -> (f32, f32) {
    (f * f * f * (f * (f * 6.0 - 15.0) + 10.0), 30.0 * f * f * (f * (f - 2.0) + 1.0))
}

/// Noise over a plane at a place relative to lattice point `cell`.
#[inline]
fn plan_noise(x: f32, z: f32, cell: [i32; 2], seed: u32) -> f32 {
    let ((lx, fx), (lz, fz)) = (split(x), split(z));
    let (hx, hz) = (products(cell[0], lx, BY_X), products(cell[1], lz, BY_Z));
    let corner = |i: usize, j: usize| {
        let h = mix(hx[i] ^ hz[j] ^ seed);
        signed(h) * (fx - i as f32) + signed(h >> 10) * (fz - j as f32)
    };
    let ((wx, _), (wz, _)) = (fade(fx), fade(fz));
    let north = corner(0, 0) + (corner(1, 0) - corner(0, 0)) * wx;
    let south = corner(0, 1) + (corner(1, 1) - corner(0, 1)) * wx;
    north + (south - north) * wz
}

/// Noise and its gradient (per cell) at a place relative to lattice point `cell`; value within -1.5..1.5.
#[inline]
fn gradient_noise(place: Vec3, cell: [i32; 3], seed: u32) -> (f32, Vec3) {
    let ((lx, fx), (ly, fy), (lz, fz)) = (split(place.x), split(place.y), split(place.z));
    let (hx, hy, hz) = (products(cell[0], lx, BY_X), products(cell[1], ly, BY_Y), products(cell[2], lz, BY_Z));
    // Each corner: its gradient, and the value that this gradient has here.
    let corner = |i: usize, j: usize, k: usize| {
        let h = mix(hx[i] ^ hy[j] ^ hz[k] ^ seed);
        let g = Vec3::new(signed(h), signed(h >> 10), signed(h >> 20));
        g.extend(g.x * (fx - i as f32) + g.y * (fy - j as f32) + g.z * (fz - k as f32))
    };
    let ((wx, dx), (wy, dy), (wz, dz)) = (fade(fx), fade(fy), fade(fz));
    // Interpolating gradients and values together; each step also keeps the difference, whose w is the change of weight.
    let edge = |j, k| {
        let (a, b) = (corner(0, j, k), corner(1, j, k));
        (a + (b - a) * wx, b.w - a.w)
    };
    let (e00, e10, e01, e11) = (edge(0, 0), edge(1, 0), edge(0, 1), edge(1, 1));
    let face =
        |a: (glam::Vec4, f32), b: (glam::Vec4, f32)| (a.0 + (b.0 - a.0) * wy, b.0.w - a.0.w, a.1 + (b.1 - a.1) * wy);
    let (near, far) = (face(e00, e10), face(e01, e11));
    let all = near.0 + (far.0 - near.0) * wz;
    let weights = Vec3::new(
        dx * (near.2 + (far.2 - near.2) * wz),
        dy * (near.1 + (far.1 - near.1) * wz),
        dz * (far.0.w - near.0.w),
    );
    (all.w, all.truncate() + weights)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn the_pattern_stays_in_the_world_when_the_local_frame_moves() {
        let far = DVec3::new(500_123.4, 31.0, 4_200_321.7);
        let (a, b) = (Field::new(5.0, far, 3), Field::new(5.0, far + DVec3::new(10.0, -2.0, 7.0), 3));
        for i in 0..50 {
            let p = Vec3::new(i as f32 * 0.37, (i as f32).sin(), i as f32 * -0.21);
            let q = p - Vec3::new(10.0, -2.0, 7.0);
            assert!((a.plan(p, 0.0, 0, 8, 0.5) - b.plan(q, 0.0, 0, 8, 0.5)).abs() < 0.02, "{i}");
            assert!((a.with_slope(p, 0.0, 0, 8, 0.5).0 - b.with_slope(q, 0.0, 0, 8, 0.5).0).abs() < 0.02, "{i}");
            assert!((a.layer(2, p.y, 0.0) - b.layer(2, q.y, 0.0)).abs() < 1e-3);
        }
    }

    #[test]
    fn it_has_mean_zero_and_fades_to_it_under_wide_footprints() {
        let field = Field::new(1.0, DVec3::ZERO, 9);
        let (mut sum, mut squares) = (0.0, 0.0);
        for i in 0..20_000 {
            let p = Vec3::new(i as f32 * 0.731, i as f32 * 0.117, i as f32 * 0.377);
            for value in [field.plan(p, 0.0, 0, 1, 0.5), field.with_slope(p, 0.0, 0, 1, 0.5).0] {
                sum += value;
                squares += value * value;
            }
            assert_eq!(field.plan(p, 1.0, 0, 8, 0.5), 0.0);
            assert_eq!(field.with_slope(p, 1.0, 0, 8, 0.5), (0.0, Vec3::ZERO));
        }
        assert!((sum / 40_000.0).abs() < 0.01);
        assert!(squares / 40_000.0 > 0.02);
    }

    #[test]
    fn an_octave_is_as_strong_as_its_constant_says() {
        let field = Field::new(1.0, DVec3::ZERO, 4);
        // A step that no cell has in common with: each fraction of a cell is met.
        let value = |i: usize| {
            f64::from(field.plan(Vec3::new((i % 400) as f32, 0.0, (i / 400) as f32) * 0.618_034, 0.0, 0, 1, 1.0))
        };
        let squares: f64 = (0..160_000).map(|i| value(i).powi(2)).sum();
        assert!(((squares / 160_000.0).sqrt() / PLAN_RMS - 1.0).abs() < 0.01);
        assert_eq!([1.0, 0.48, 0.47, 0.2].map(|cell| field.octaves_down_to(cell)), [1, 1, 2, 3]);
        assert_eq!([1.01, 1e-9].map(|cell| field.octaves_down_to(cell)), [0, MOST]);
    }

    proptest! {
        #[test]
        fn slopes_are_those_of_the_values(x in -50.0f32..50.0, y in -50.0f32..50.0, z in -50.0f32..50.0) {
            let field = Field::new(2.0, DVec3::new(1.3, 0.2, -7.0), 1);
            let p = Vec3::new(x, y, z);
            let (_, slope) = field.with_slope(p, 0.0, 0, 1, 1.0);
            let value = |p| field.with_slope(p, 0.0, 0, 1, 1.0).0;
            for axis in [Vec3::X, Vec3::Y, Vec3::Z] {
                let e = 5e-3;
                let numeric = (value(p + e * axis) - value(p - e * axis)) / (2.0 * e);
                // The slope counts per cell (2 m).
                prop_assert!((numeric * 2.0 - slope.dot(axis)).abs() < 0.03, "{} {}", numeric * 2.0, slope.dot(axis));
            }
        }

        #[test]
        fn it_is_continuous_and_bounded_anywhere(x in -1e6f32..1e6, y in -1e4f32..1e4,
            z in -1e6f32..1e6, size in 1e-3f64..1e4) {
            let field = Field::new(size, DVec3::new(1e6, 0.0, -3e6), 5);
            let p = Vec3::new(x, y, z);
            let (value, slope) = field.with_slope(p, 0.0, 0, 10, 0.5);
            prop_assert!(slope.is_finite() && value.abs() < 3.0 && field.plan(p, 0.0, 0, 10, 0.5).abs() < 3.0);
            // Next to any cell border the value goes on.
            let here = Vec3::new(x.round(), y.round(), z.round()) * 1e-3;
            let unit = Field::new(1.0, DVec3::ZERO, 5);
            let step = unit.plan(here + Vec3::splat(1e-5), 0.0, 0, 1, 1.0) - unit.plan(here - Vec3::splat(1e-5), 0.0, 0, 1, 1.0);
            prop_assert!(step.abs() < 1e-3);
        }
    }
}
