//! The clear sky of A. Preetham, P. Shirley and B. Smits, A practical analytic model for daylight, 1999.
//!
//! Perez' formula with coefficients fitted to turbidity, for luminance and for both chromaticities. Made for suns above
//! the horizon and turbidities of about 2 to 6: what it says beyond is drawn as it says it, but never negative.

use glam::{DMat3, DVec3, Vec3};

/// A sky for one turbidity and elevation of the sun.
#[derive(Clone, Copy, Debug)]
pub(super) struct Preetham {
    /// Coefficients A to E of luminance, x and y.
    perez: [[f64; 5]; 3],
    /// Value at the zenith over Perez' formula there: luminance (kcd/m^2), x, y.
    scale: [f64; 3],
}

/// Slopes and offsets of Perez' coefficients by turbidity (appendix A.2): luminance, x, y.
const PEREZ: [[(f64, f64); 5]; 3] = [
    [(0.1787, -1.4630), (-0.3554, 0.4275), (-0.0227, 5.3251), (0.1206, -2.5771), (-0.0670, 0.3703)],
    [(-0.0193, -0.2592), (-0.0665, 0.0008), (-0.0004, 0.2125), (-0.0641, -0.8989), (-0.0033, 0.0452)],
    [(-0.0167, -0.2608), (-0.0950, 0.0092), (-0.0079, 0.2102), (-0.0441, -1.6537), (-0.0109, 0.0529)],
];

/// Chromaticities x and y at the zenith: rows are powers 2 to 0 of turbidity, columns powers 3 to 0 of the sun's angle from
/// the zenith (appendix A.2).
const ZENITH: [[[f64; 4]; 3]; 2] = [
    [[0.00166, -0.00375, 0.00209, 0.0], [-0.02903, 0.06377, -0.03202, 0.00394], [0.11693, -0.21196, 0.06052, 0.25886]],
    [[0.00275, -0.00610, 0.00317, 0.0], [-0.04214, 0.08970, -0.04153, 0.00516], [0.15346, -0.26756, 0.06670, 0.26688]],
];

impl Preetham {
    /// The sky for a turbidity and an elevation of the sun (degrees).
    pub(super) fn new(turbidity: f64, sun_elevation: f64) -> Self {
        // From the zenith.
        let sun = (90.0 - sun_elevation).to_radians();
        let chi = (4.0 / 9.0 - turbidity / 120.0) * (std::f64::consts::PI - 2.0 * sun);
        // Under 0 once the sun is far below the horizon, 17 degrees at turbidity 3: night.
        let luminance = ((4.0453 * turbidity - 4.9710) * chi.tan() - 0.2155 * turbidity + 2.4192).max(0.0);
        // The polynomials are fits for suns above the horizon: a lower sun's colours are those of a level one.
        let level = sun.min(std::f64::consts::FRAC_PI_2);
        let chromaticity = ZENITH.map(|rows| {
            rows.into_iter().fold(0.0, |sum, row| {
                sum * turbidity + row.into_iter().fold(0.0, |sum, coefficient| sum * level + coefficient)
            })
        });
        let perez = PEREZ.map(|row| row.map(|(slope, offset)| slope * turbidity + offset));
        let zenith = [luminance, chromaticity[0], chromaticity[1]];
        let scale = std::array::from_fn(|index| zenith[index] / formula(&perez[index], 1.0, sun.cos()));
        Self { perez, scale }
    }

    /// Radiance from a direction above the horizon: linear Rec.709, its luminance in kcd/m^2.
    ///
    /// `height` is the cosine with the zenith, at least 0; `toward_sun` the cosine with the sun.
    pub(super) fn radiance(&self, height: f32, toward_sun: f32) -> Vec3 {
        let [luminance, x, y]: [f64; 3] = std::array::from_fn(|index| {
            self.scale[index] * formula(&self.perez[index], f64::from(height), f64::from(toward_sun))
        });
        if !(luminance > 0.0 && y > 0.0) {
            return Vec3::ZERO;
        }
        to_rec709(luminance, x, y).max(DVec3::ZERO).as_vec3()
    }
}

/// Perez' formula: gradation towards the horizon times the glow around the sun.
fn formula(&[a, b, c, d, e]: &[f64; 5], height: f64, toward_sun: f64) -> f64 {
    let toward_sun = toward_sun.clamp(-1.0, 1.0);
    // b is negative: at the horizon, height 0, the first exponential is 0.
    (1.0 + a * (b / height.max(0.0)).exp()) * (1.0 + c * (d * toward_sun.acos()).exp() + e * toward_sun * toward_sun)
}

/// Luminance and chromaticities → linear Rec.709 (IEC 61966-2-1, the inverse of its matrix to XYZ).
fn to_rec709(luminance: f64, x: f64, y: f64) -> DVec3 {
    let from_xyz =
        DMat3::from_cols_array_2d(&[[3.2406, -0.9689, 0.0557], [-1.5372, 1.8758, -0.2040], [-0.4986, 0.0415, 1.0570]]);
    from_xyz * DVec3::new(x / y, 1.0, (1.0 - x - y) / y) * luminance
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optics::luminance;

    #[test]
    fn the_zenith_has_the_published_luminance_and_colour() {
        // Worked out apart from appendix A.2: turbidity 2, sun at 45 degrees: chi = (4/9 - 1/60) pi / 2 = 0.671952,
        // tan 0.795436, luminance 3.1196 * 0.795436 - 0.431 + 2.4192; x and y by the polynomials.
        let sky = Preetham::new(2.0, 45.0);
        let zenith = sky.radiance(1.0, 45f32.to_radians().sin());
        assert!((luminance(zenith) - 4.469_64).abs() < 2e-3, "{}", luminance(zenith));
        let (x, y) = (0.240_952, 0.243_722);
        let expected = to_rec709(4.469_64, x, y).as_vec3();
        assert!((zenith - expected).abs().max_element() < 1e-3 * expected.z, "{zenith} {expected}");
        // White is white.
        let white = to_rec709(2.0, 0.3127, 0.3290);
        assert!((white - 2.0).abs().max_element() < 2e-3, "{white}");
    }

    #[test]
    fn it_glows_around_the_sun_and_at_the_horizon() {
        let sky = Preetham::new(3.0, 35.0);
        let at = |height: f32, toward: f32| luminance(sky.radiance(height, toward));
        let up = 35f32.to_radians().sin();
        assert!(at(up, 1.0) > 2.0 * at(up, 0.5) && at(up, 0.99) < at(up, 1.0));
        assert!(at(0.0, 0.0) > 1.2 * at(1.0, 0.0));
    }

    #[test]
    fn no_sun_and_no_haze_makes_it_negative_or_infinite() {
        for turbidity in [1.7, 2.0, 3.0, 6.0, 10.0] {
            for elevation in [90.0, 45.0, 10.0, 0.0, -5.0, -20.0, -90.0] {
                let sky = Preetham::new(turbidity, elevation);
                for height in [0.0f32, 1e-7, 0.01, 0.3, 1.0] {
                    for toward in [-1.0f32, -0.3, 0.0, 0.9, 1.0, 1.000_001] {
                        let radiance = sky.radiance(height, toward);
                        assert!(radiance.is_finite() && radiance.min_element() >= 0.0, "{turbidity} {elevation}");
                        let night = elevation <= -20.0 && turbidity >= 3.0;
                        assert!(!night || radiance == Vec3::ZERO, "night at {elevation}: {radiance}");
                    }
                }
            }
        }
    }
}
