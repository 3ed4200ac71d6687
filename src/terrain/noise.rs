//! Gradient noise in octaves, anchored in the world: continuous, deterministic, filtered by the size of a pixel.
//!
//! Source: Perlin, Improving Noise, 2002 (quintic fade), with hashed gradients instead of a table, so that nothing repeats
//! within 2^32 cells, and with its analytic derivative.

use glam::{DVec3, Vec3};

/// Octaves at most: with a step of 2.1 from the coarsest, the finest is 1/800 of it.
const MOST: usize = 10;
/// Ratio of wavelengths from octave to octave; no whole number, so that lattices never line up.
const STEP: f64 = 2.1;

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

/// A sum of octaves over space.
#[derive(Clone, Debug)]
pub(super) struct Field {
    octaves: [Octave; MOST],
}

impl Field {
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

    /// Sum of octaves `first..last` at a local position, each `gain` of the one before; about -1..1, mean 0.
    ///
    /// Octaves finer than `footprint` (m) fade into their mean.
    #[inline]
    pub(super) fn value(&self, position: Vec3, footprint: f32, first: usize, last: usize, gain: f32) -> f32 {
        self.with_slope(position, footprint, first, last, gain).0
    }

    /// As [`value`](Self::value), and beside it the sum's gradient weighted so that every octave is equally steep: the slope of a
    /// relief whose bumps are as high as they are wide times a constant.
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
            let turned =
                Vec3::new(cos * position.x - sin * position.z, position.y, sin * position.x + cos * position.z);
            let (value, g) = gradient_noise(turned * octave.frequency + octave.rest, octave.cell, octave.seed);
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
        let y = height * octave.frequency + octave.rest.y;
        let low = y.floor();
        let cell = octave.cell[1].wrapping_add(low as i32);
        let at = |cell: i32| (hash(cell, 17, 71, octave.seed) >> 8) as f32 * (2.0 / 16_777_216.0) - 1.0;
        let f = y - low;
        let t = f * f * (3.0 - 2.0 * f);
        visible * (at(cell) + (at(cell.wrapping_add(1)) - at(cell)) * t)
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

/// A well-mixed word from a lattice point (the finaliser of MurmurHash3 over a linear combination).
#[inline]
fn hash(x: i32, y: i32, z: i32, seed: u32) -> u32 {
    let mut h = (x as u32).wrapping_mul(0x8da6_b343)
        ^ (y as u32).wrapping_mul(0xd816_3841)
        ^ (z as u32).wrapping_mul(0xcb1a_b31f);
    h = (h ^ seed).wrapping_mul(0x85eb_ca6b);
    h ^= h >> 13;
    h = h.wrapping_mul(0xc2b2_ae35);
    h ^ (h >> 16)
}

/// Noise and its gradient (per cell) at a place relative to lattice point `cell`; value within -1..1.
#[inline]
fn gradient_noise(place: Vec3, cell: [i32; 3], seed: u32) -> (f32, Vec3) {
    let low = place.floor();
    let f = place - low;
    let base = [0, 1, 2].map(|axis| cell[axis].wrapping_add(low[axis] as i32));
    let fade = f * f * f * (f * (f * 6.0 - 15.0) + 10.0);
    let dfade = 30.0 * f * f * (f * (f - 2.0) + 1.0);
    let (mut sum, mut slope) = (0.0, Vec3::ZERO);
    for corner in 0..8 {
        let at = [corner & 1, corner >> 1 & 1, corner >> 2];
        let h = hash(base[0].wrapping_add(at[0]), base[1].wrapping_add(at[1]), base[2].wrapping_add(at[2]), seed);
        // A gradient in the cube -1..1 from three times ten bits.
        let unit = |bits: u32| (bits & 1023) as f32 * (2.0 / 1023.0) - 1.0;
        let gradient = Vec3::new(unit(h), unit(h >> 10), unit(h >> 20));
        let offset = Vec3::new(at[0] as f32, at[1] as f32, at[2] as f32);
        let value = gradient.dot(f - offset);
        let pick =
            |axis: usize| if at[axis] == 1 { (fade[axis], dfade[axis]) } else { (1.0 - fade[axis], -dfade[axis]) };
        let ((wx, dx), (wy, dy), (wz, dz)) = (pick(0), pick(1), pick(2));
        let weight = wx * wy * wz;
        sum += weight * value;
        slope += weight * gradient + value * Vec3::new(dx * wy * wz, wx * dy * wz, wx * wy * dz);
    }
    (sum, slope)
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
            assert!((a.value(p, 0.0, 0, 8, 0.5) - b.value(q, 0.0, 0, 8, 0.5)).abs() < 0.02, "{i}");
            assert!((a.layer(2, p.y, 0.0) - b.layer(2, q.y, 0.0)).abs() < 1e-3);
        }
    }

    #[test]
    fn it_has_mean_zero_and_fades_to_it_under_wide_footprints() {
        let field = Field::new(1.0, DVec3::ZERO, 9);
        let (mut sum, mut squares) = (0.0, 0.0);
        for i in 0..20_000 {
            let p = Vec3::new(i as f32 * 0.731, i as f32 * 0.117, i as f32 * 0.377);
            let value = field.value(p, 0.0, 0, 1, 0.5);
            sum += value;
            squares += value * value;
            assert_eq!(field.value(p, 1.0, 0, 8, 0.5), 0.0);
            assert!(field.value(p, 0.2, 0, 8, 0.5).abs() <= 1.5);
        }
        assert!((sum / 20_000.0).abs() < 0.01);
        assert!(squares / 20_000.0 > 0.02);
    }

    proptest! {
        #[test]
        fn slopes_are_those_of_the_values(x in -50.0f32..50.0, y in -50.0f32..50.0, z in -50.0f32..50.0) {
            let field = Field::new(2.0, DVec3::new(1.3, 0.2, -7.0), 1);
            let p = Vec3::new(x, y, z);
            let (_, slope) = field.with_slope(p, 0.0, 0, 1, 1.0);
            for axis in [Vec3::X, Vec3::Y, Vec3::Z] {
                let e = 5e-3;
                let numeric = (field.value(p + e * axis, 0.0, 0, 1, 1.0) - field.value(p - e * axis, 0.0, 0, 1, 1.0)) / (2.0 * e);
                // The slope counts per cell (2 m).
                prop_assert!((numeric * 2.0 - slope.dot(axis)).abs() < 0.03, "{} {}", numeric * 2.0, slope.dot(axis));
            }
        }

        #[test]
        fn it_is_continuous_and_bounded_anywhere(x in -1e6f32..1e6, y in -1e4f32..1e4, z in -1e6f32..1e6, size in 1e-3f64..1e4) {
            let field = Field::new(size, DVec3::new(1e6, 0.0, -3e6), 5);
            let value = field.value(Vec3::new(x, y, z), 0.0, 0, 10, 0.5);
            prop_assert!(value.is_finite() && value.abs() < 3.0);
        }
    }
}
