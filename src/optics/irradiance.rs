//! Light from all around, reduced to nine numbers per channel: irradiance for any normal without a loop.
//!
//! Source: Ramamoorthi and Hanrahan, An Efficient Representation for Irradiance Environment Maps, 2001. Two departures:
//! every cell of the map is integrated exactly (so that a constant sky gives exactly pi times its radiance), and what nine
//! terms leave out is put right for the normals straight up and straight down, where most of a landscape looks.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use glam::{DVec3, Vec3};

/// Irradiance of a distant environment on a card of any direction.
#[derive(Clone, Debug, PartialEq)]
pub struct Irradiance {
    /// Factors of 1, x, y, z, xy, yz, zx, x^2 - z^2, y^2 of the normal.
    factor: [Vec3; 9],
}

impl Irradiance {
    /// The same radiance from everywhere.
    pub fn constant(radiance: Vec3) -> Self {
        let mut factor = [Vec3::ZERO; 9];
        factor[0] = radiance * std::f32::consts::PI;
        Self { factor }
    }

    /// Integrates a latitude-longitude map of `columns` x `rows` cells, each of one radiance.
    ///
    /// Row 0 starts at the zenith, column 0 starts in the north and goes eastward; rows span equal elevations.
    pub fn from_map(columns: usize, rows: usize, radiance: impl Fn(usize, usize) -> Vec3) -> Self {
        let around: Vec<[f64; 5]> = (0..columns)
            .map(|column| {
                let (a, b) = (TAU * column as f64 / columns as f64, TAU * (column + 1) as f64 / columns as f64);
                let double = |f: fn(f64) -> f64| 0.5 * (f(2.0 * b) - f(2.0 * a));
                // Integrals of 1, sin, cos, sin 2a, cos 2a over the cell's azimuths.
                [b - a, a.cos() - b.cos(), b.sin() - a.sin(), -double(f64::cos), double(f64::sin)]
            })
            .collect();
        // Real spherical harmonics up to l = 2 as plain polynomials; the factors come at the end.
        let mut moment = [DVec3::ZERO; 9];
        let (mut up, mut down) = (DVec3::ZERO, DVec3::ZERO);
        for row in 0..rows {
            let edge = |row: usize| FRAC_PI_2 - PI * row as f64 / rows as f64;
            let (y1, y0) = (edge(row).sin(), edge(row + 1).sin());
            let c = |y: f64| (1.0 - y * y).max(0.0).sqrt();
            let first = |f: &dyn Fn(f64) -> f64| f(y1) - f(y0);
            let one = y1 - y0;
            let y = first(&|y| 0.5 * y * y);
            let y2 = first(&|y| y * y * y / 3.0);
            let side = first(&|y| 0.5 * (y * c(y) + y.asin()));
            let side_y = first(&|y| -c(y).powi(3) / 3.0);
            let side2 = one - y2;
            let above = 0.5 * (y1.max(0.0).powi(2) - y0.max(0.0).powi(2));
            let below = 0.5 * (y0.min(0.0).powi(2) - y1.min(0.0).powi(2));
            for (column, [width, sin, cos, sin2, cos2]) in around.iter().copied().enumerate() {
                let light = radiance(column, row).as_dvec3();
                // x = side sin(azimuth), z = -side cos(azimuth).
                let weight = [
                    width * one,
                    side * sin,
                    width * y,
                    -side * cos,
                    side_y * sin,
                    -side_y * cos,
                    -0.5 * side2 * sin2,
                    -side2 * cos2,
                    width * (3.0 * y2 - one),
                ];
                for (sum, weight) in moment.iter_mut().zip(weight) {
                    *sum += weight * light;
                }
                up += width * above * light;
                down += width * below * light;
            }
        }
        Self::from_moments(moment, up, down)
    }

    /// From integrals of L times 1, x, y, z, xy, yz, zx, x^2 - z^2, 3 y^2 - 1, and the exact irradiance up and down.
    fn from_moments(moment: [DVec3; 9], up: DVec3, down: DVec3) -> Self {
        // E(n) = sum of A_l Y_lm(n) times the integral of L Y_lm, with A = pi, 2 pi / 3, pi / 4 (eq. 8) and Y's own
        // norms: 1/4pi, 3/4pi, 15/4pi, 15/16pi, 5/16pi.
        let mut factor = [DVec3::ZERO; 9];
        factor[0] = moment[0] * 0.25;
        for axis in 1..4 {
            factor[axis] = moment[axis] * 0.5;
        }
        for pair in 4..7 {
            factor[pair] = moment[pair] * (15.0 / 16.0);
        }
        factor[7] = moment[7] * (15.0 / 64.0);
        let zonal = moment[8] * (5.0 / 64.0);
        factor[0] -= zonal;
        factor[8] = 3.0 * zonal;
        let missing_up = up - (factor[0] + factor[2] + factor[8]);
        let missing_down = down - (factor[0] - factor[2] + factor[8]);
        factor[2] += 0.5 * (missing_up - missing_down);
        factor[8] += 0.5 * (missing_up + missing_down);
        Self { factor: factor.map(|f| f.as_vec3()) }
    }

    /// Irradiance on a card whose unit normal is `n`: the integral of radiance times cosine over its hemisphere.
    ///
    /// Exact for n up and down; elsewhere within the few per cent of the nine-term fit. Never negative.
    #[inline]
    pub fn at(&self, n: Vec3) -> Vec3 {
        let f = &self.factor;
        let sum = f[0]
            + f[1] * n.x
            + f[2] * n.y
            + f[3] * n.z
            + f[4] * (n.x * n.y)
            + f[5] * (n.y * n.z)
            + f[6] * (n.z * n.x)
            + f[7] * (n.x * n.x - n.z * n.z)
            + f[8] * (n.y * n.y);
        // Nine terms ring below zero opposite to one small bright source.
        sum.max(Vec3::ZERO)
    }

    /// The same light, `factor` times as strong.
    pub(super) fn scaled(mut self, factor: Vec3) -> Self {
        for value in &mut self.factor {
            *value *= factor;
        }
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn normals() -> impl Iterator<Item = Vec3> {
        (0..200).map(|i| {
            let y = 1.0 - 2.0 * (i as f32 + 0.5) / 200.0;
            let side = (1.0 - y * y).sqrt();
            let phi = i as f32 * 2.399_963;
            Vec3::new(side * phi.cos(), y, side * phi.sin())
        })
    }

    #[test]
    fn a_constant_sky_gives_pi_times_its_radiance_for_every_normal() {
        let radiance = Vec3::new(1.0, 0.25, 3.0);
        for (columns, rows) in [(1, 1), (1, 2), (3, 5), (64, 32)] {
            let map = Irradiance::from_map(columns, rows, |_, _| radiance);
            for n in normals() {
                let expected = std::f32::consts::PI * radiance;
                assert!(
                    (map.at(n) - expected).abs().max_element() < 2e-6 * expected.max_element(),
                    "{columns}x{rows} {n}"
                );
                assert_eq!(Irradiance::constant(radiance).at(n), expected);
            }
        }
    }

    #[test]
    fn light_of_first_degree_is_exact() {
        // L = 1 + (a . d): E(n) = pi + 2 pi / 3 (a . n), for a map fine enough that cells hardly vary.
        let a = Vec3::new(0.3, -0.4, 0.2);
        let (columns, rows) = (256, 128);
        let map = Irradiance::from_map(columns, rows, |column, row| {
            let azimuth = (column as f32 + 0.5) / columns as f32 * std::f32::consts::TAU;
            let elevation = (0.5 - (row as f32 + 0.5) / rows as f32) * std::f32::consts::PI;
            let (s, c) = elevation.sin_cos();
            Vec3::splat(1.0 + a.dot(Vec3::new(c * azimuth.sin(), s, -c * azimuth.cos())))
        });
        for n in normals() {
            let expected = std::f32::consts::PI * (1.0 + 2.0 / 3.0 * a.dot(n));
            assert!((map.at(n).x - expected).abs() < 1e-3, "{n}: {} {expected}", map.at(n).x);
        }
    }

    #[test]
    fn light_of_second_degree_is_exact() {
        // L = Q(d) of trace 0: E(n) = pi / 4 Q(n). Every product of two axes gets its turn.
        let forms: [fn(Vec3) -> f32; 5] =
            [|d| d.x * d.y, |d| d.y * d.z, |d| d.z * d.x, |d| d.x * d.x - d.z * d.z, |d| 3.0 * d.y * d.y - 1.0];
        let (columns, rows) = (256, 128);
        for (index, form) in forms.into_iter().enumerate() {
            let map = Irradiance::from_map(columns, rows, |column, row| {
                let azimuth = (column as f32 + 0.5) / columns as f32 * std::f32::consts::TAU;
                let elevation = (0.5 - (row as f32 + 0.5) / rows as f32) * std::f32::consts::PI;
                let (s, c) = elevation.sin_cos();
                Vec3::splat(2.0 + form(Vec3::new(c * azimuth.sin(), s, -c * azimuth.cos())))
            });
            for n in normals() {
                let expected = std::f32::consts::PI * (2.0 + 0.25 * form(n));
                assert!((map.at(n).x - expected).abs() < 2e-3, "form {index} {n}");
            }
        }
    }

    #[test]
    fn half_a_sky_is_exact_up_and_down_and_near_elsewhere() {
        // Radiance 1 above the horizon only: E(n) = pi (1 + n.y) / 2.
        let map = Irradiance::from_map(8, 64, |_, row| if row < 32 { Vec3::ONE } else { Vec3::ZERO });
        assert!((map.at(Vec3::Y).x - std::f32::consts::PI).abs() < 1e-6);
        assert!(map.at(-Vec3::Y).x.abs() < 1e-6);
        for n in normals() {
            let expected = std::f32::consts::PI * (1.0 + n.y) / 2.0;
            assert!((map.at(n).x - expected).abs() < 0.03 * std::f32::consts::PI, "{n}");
        }
    }

    #[test]
    fn one_bright_spot_never_gives_negative_light() {
        let map = Irradiance::from_map(
            64,
            32,
            |column, row| if (column, row) == (5, 9) { Vec3::splat(1e4) } else { Vec3::ZERO },
        );
        for n in normals() {
            assert!(map.at(n).min_element() >= 0.0);
        }
    }
}
