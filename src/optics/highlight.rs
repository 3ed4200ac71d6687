//! The sun's mirror image on water, smeared by ripples too small to be in the surface.
//!
//! A lobe is asked for the radiance that it sends to the eye per unit of irradiance on a card that faces the sun. The
//! Fresnel factor (at the angle between eye and half vector) is the caller's, so that both reflectance formulas serve.

use glam::Vec3;

use crate::scene;

use super::SUN_ANGULAR_RADIUS;

/// A lobe by name, ready to be evaluated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Lobe {
    /// GGX of this roughness, the sun's disc folded in.
    Ggx {
        /// Roughness (alpha).
        alpha: f32,
    },
    /// Phong of this exponent.
    Phong {
        /// Exponent.
        exponent: f32,
    },
    /// No highlight.
    None,
}

impl Lobe {
    /// The lobe that a scene asks for.
    pub fn new(water: &scene::Water) -> Self {
        match water.highlight {
            scene::Highlight::Ggx => Self::Ggx { alpha: alpha_with_disc(water.roughness as f32, SUN_ANGULAR_RADIUS) },
            scene::Highlight::Phong => Self::Phong { exponent: water.phong_exponent as f32 },
            scene::Highlight::None => Self::None,
        }
    }

    /// Radiance towards the eye per unit sun irradiance (1/sr), without Fresnel.
    ///
    /// All three are unit vectors away from the surface point; 0 when eye or sun is not above the surface.
    #[inline]
    pub fn radiance(self, normal: Vec3, to_eye: Vec3, to_sun: Vec3) -> f32 {
        match self {
            Self::Ggx { alpha } => ggx(normal, to_eye, to_sun, alpha),
            Self::Phong { exponent } => phong(normal, to_eye, to_sun, exponent),
            Self::None => 0.0,
        }
    }
}

/// Cosine between the eye and the microfacet that mirrors the sun into it: Fresnel's incident cosine for a highlight.
#[inline]
pub fn half_cosine(to_eye: Vec3, to_sun: Vec3) -> f32 {
    // |v + l|^2 = 2 + 2 v.l, and (v + l).v = 1 + v.l.
    (0.5 * (1.0 + to_eye.dot(to_sun))).max(0.0).sqrt()
}

/// Roughness that a disc of light of this angular radius adds to `alpha`.
///
/// A uniform disc of radius r has a variance of r^2/4 per axis, its half vectors r^2/16; a lobe of roughness alpha has
/// slopes of variance alpha^2/2 (Beckmann's, whose core GGX shares). Adding variances gives alpha^2 + r^2/8.
#[inline]
pub fn alpha_with_disc(alpha: f32, radius: f32) -> f32 {
    (alpha * alpha + radius * radius / 8.0).sqrt()
}

/// GGX lobe with height-correlated Smith masking: f_r cos(sun), without Fresnel (1/sr).
///
/// Source: Walter et al., Microfacet Models for Refraction through Rough Surfaces, 2007, eq. 20 and 33; Heitz,
/// Understanding the Masking-Shadowing Function, 2014, eq. 99.
#[inline]
pub fn ggx(normal: Vec3, to_eye: Vec3, to_sun: Vec3, alpha: f32) -> f32 {
    let (cos_eye, cos_sun) = (normal.dot(to_eye), normal.dot(to_sun));
    if cos_eye <= 0.0 || cos_sun <= 0.0 {
        return 0.0;
    }
    let half = (to_eye + to_sun).normalize_or_zero();
    let cos_half = normal.dot(half);
    let alpha2 = alpha * alpha;
    // 1 - cos^2 from the cross product: near the peak the plain difference would lose all its digits.
    let sin2 = normal.cross(half).length_squared();
    let width = cos_half * cos_half * alpha2 + sin2;
    let distribution = alpha2 / (std::f32::consts::PI * width * width);
    // G2 / (4 cos_eye cos_sun) = 1 / (2 (s_eye + s_sun)): no division by a vanishing cosine.
    let smith = |a: f32, b: f32| a * (alpha2 + (1.0 - alpha2) * b * b).sqrt();
    let visibility = 0.5 / (smith(cos_sun, cos_eye) + smith(cos_eye, cos_sun));
    distribution * visibility * cos_sun
}

/// Phong's lobe as the report used it, with the factor that keeps its energy at or under 1 (1/sr).
///
/// Source: Phong 1975; Lafortune and Willems, Using the Modified Phong Reflectance Model, 1994: (n + 2) / 2 pi.
#[inline]
pub fn phong(normal: Vec3, to_eye: Vec3, to_sun: Vec3, exponent: f32) -> f32 {
    let (cos_eye, cos_sun) = (normal.dot(to_eye), normal.dot(to_sun));
    if cos_eye <= 0.0 || cos_sun <= 0.0 {
        return 0.0;
    }
    let mirrored = 2.0 * cos_sun * normal - to_sun;
    let cosine = mirrored.dot(to_eye).clamp(0.0, 1.0);
    (exponent + 2.0) / std::f32::consts::TAU * cosine.powf(exponent) * cos_sun
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::f32::consts::TAU as TURN;

    fn unit(cos_theta: f32, phi: f32) -> Vec3 {
        let sine = (1.0 - cos_theta * cos_theta).max(0.0).sqrt();
        Vec3::new(sine * phi.cos(), cos_theta, sine * phi.sin())
    }

    /// Share of the light from one direction that the lobe sends out: integral of f_r cos(sun) cos(eye) / cos(sun).
    ///
    /// Midpoints of a polar grid around the mirror direction, squared so that narrow lobes are met finely.
    fn energy(lobe: Lobe, cos_sun: f32) -> f64 {
        let sun = unit(cos_sun, 0.0);
        let mirror = Vec3::new(-sun.x, sun.y, -sun.z);
        let frame = glam::Quat::from_rotation_arc(Vec3::Y, mirror);
        let (rings, spokes) = (600, 180);
        let mut sum = 0.0;
        for ring in 0..rings {
            let edge = |i: i32| (f64::from(i) / f64::from(rings)).powi(3) * std::f64::consts::PI;
            let (inner, outer) = (edge(ring), edge(ring + 1));
            let solid = (inner.cos() - outer.cos()) * std::f64::consts::TAU / f64::from(spokes);
            let theta = 0.5 * (inner + outer) as f32;
            for spoke in 0..spokes {
                let phi = (spoke as f32 + 0.5) / spokes as f32 * std::f32::consts::TAU;
                let eye = frame * unit(theta.cos(), phi);
                if eye.y > 0.0 {
                    sum += f64::from(lobe.radiance(Vec3::Y, eye, sun) * eye.y) * solid;
                }
            }
        }
        sum / f64::from(cos_sun)
    }

    #[test]
    fn a_narrow_lobe_keeps_all_energy_and_none_makes_any() {
        for alpha in [0.005f32, 0.03, 0.1, 0.3, 1.0] {
            for cos_sun in [1.0f32, 0.8, 0.4, 0.1] {
                let e = energy(Lobe::Ggx { alpha }, cos_sun);
                assert!(e < 1.003, "alpha {alpha} cos {cos_sun}: {e}");
                // Single scattering loses only what a second bounce would have brought back.
                if alpha <= 0.03 && cos_sun >= 0.4 {
                    assert!(e > 0.99, "alpha {alpha} cos {cos_sun}: {e}");
                }
            }
        }
        for exponent in [1.0f32, 20.0, 1000.0, 20000.0] {
            for cos_sun in [1.0f32, 0.7, 0.2] {
                let e = energy(Lobe::Phong { exponent }, cos_sun);
                assert!(e < 1.003, "n {exponent} cos {cos_sun}: {e}");
            }
            assert!((energy(Lobe::Phong { exponent }, 1.0) - 1.0).abs() < 0.003);
        }
        assert_eq!(energy(Lobe::None, 0.5), 0.0);
    }

    #[test]
    fn projected_microfacets_cover_the_surface_once() {
        // Normalisation of the distribution: integral of D cos(half) = 1, D read off at eye = sun = half.
        for alpha in [0.02f32, 0.1, 0.5] {
            let mut sum = 0.0;
            let n = 4000;
            for i in 0..n {
                let t = |i: i32| (f64::from(i) / f64::from(n)).powi(3) * std::f64::consts::FRAC_PI_2;
                let (a, b) = (t(i), t(i + 1));
                let c = (0.5 * (a + b)).cos() as f32;
                let h = unit(c, 0.0);
                let smith = 2.0 * c * (alpha * alpha + (1.0 - alpha * alpha) * c * c).sqrt();
                let d = ggx(Vec3::Y, h, h, alpha) / c / 0.5 * smith;
                sum += f64::from(d * c) * (a.cos() - b.cos()) * std::f64::consts::TAU;
            }
            assert!((sum - 1.0).abs() < 2e-3, "{alpha}: {sum}");
        }
    }

    #[test]
    fn the_peak_lies_in_the_mirror_direction() {
        let sun = unit(0.6, 0.4);
        let mirror = Vec3::new(-sun.x, sun.y, -sun.z);
        for lobe in [Lobe::new(&scene::Water::default()), Lobe::Phong { exponent: 1000.0 }] {
            let peak = lobe.radiance(Vec3::Y, mirror, sun);
            for phi in 0..8 {
                let off = (mirror + 0.05 * unit(0.2, phi as f32)).normalize();
                assert!(lobe.radiance(Vec3::Y, off, sun) < peak);
            }
            assert_eq!(lobe.radiance(Vec3::Y, mirror, -sun), 0.0);
            assert_eq!(lobe.radiance(Vec3::Y, -mirror, sun), 0.0);
        }
    }

    #[test]
    fn the_half_cosine_is_that_of_the_half_vector() {
        let (a, b) = (unit(0.3, 0.1), unit(0.8, 2.0));
        assert!((half_cosine(a, b) - (a + b).normalize().dot(a)).abs() < 1e-6);
        assert_eq!(half_cosine(a, -a), 0.0);
    }

    #[test]
    fn a_disc_widens_a_smooth_lobe_and_hardly_a_rough_one() {
        assert!(alpha_with_disc(0.0, SUN_ANGULAR_RADIUS) > 0.001);
        assert!((alpha_with_disc(0.03, SUN_ANGULAR_RADIUS) / 0.03 - 1.0).abs() < 2e-3);
    }

    #[test]
    fn a_mirror_of_water_still_shows_the_suns_own_disc() {
        // Roughness 0: the lobe is the disc's, and a unit of irradiance over its solid angle is about its peak.
        let lobe = Lobe::new(&scene::Water { roughness: 0.0, ..Default::default() });
        let sun = unit(0.6, 0.4);
        let peak = lobe.radiance(Vec3::Y, Vec3::new(-sun.x, sun.y, -sun.z), sun);
        let disc = 1.0 / (std::f32::consts::PI * SUN_ANGULAR_RADIUS * SUN_ANGULAR_RADIUS);
        assert!(peak.is_finite() && peak > 0.5 * disc && peak < 5.0 * disc, "{peak} {disc}");
        assert!((energy(lobe, 0.8) - 1.0).abs() < 5e-3, "{}", energy(lobe, 0.8));
    }

    proptest! {
        #[test]
        fn ggx_is_reciprocal_and_finite(a in -1.0f32..1.0, b in -1.0f32..1.0, phi in 0.0f32..TURN, alpha in 1e-4f32..1.0) {
            let (eye, sun) = (unit(a, 0.0), unit(b, phi));
            let out = ggx(Vec3::Y, eye, sun, alpha);
            prop_assert!(out.is_finite() && out >= 0.0);
            if a > 0.01 && b > 0.01 {
                let back = ggx(Vec3::Y, sun, eye, alpha);
                prop_assert!((out * a - back * b).abs() <= 1e-3 * (out * a).max(1e-6));
            }
        }
        #[test]
        fn phong_is_finite(a in -1.0f32..1.0, b in -1.0f32..1.0, phi in 0.0f32..TURN, n in 1.0f32..1e6) {
            let out = phong(Vec3::Y, unit(a, 0.0), unit(b, phi), n);
            prop_assert!(out.is_finite() && out >= 0.0);
        }
    }
}
