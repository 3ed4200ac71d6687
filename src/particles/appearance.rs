//! One particle's size, colour and opacity (the report's 3.1: size from volume, colour from speed, opacity from age).

use glam::Vec3;

use crate::scene;

/// Density of water (kg/m3), as the files mean it.
const DENSITY: f64 = 1000.0;

/// How a particle looks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Appearance {
    /// Linear Rec.709 albedo.
    pub albedo: Vec3,
    /// Share of light that it stops, through its middle, 0..1.
    pub opacity: f32,
    /// Factor on what it stops anywhere, 0..1: under 1 for what is drawn wider than it is.
    pub share: f32,
}

/// Radius (m) of a ball of `mass` kg of water, times `scale`: cbrt(3 m / 4 pi rho).
pub fn radius(mass: f64, scale: f64) -> f64 {
    // Divided first: 3 m would overflow for the largest numbers.
    (mass / (4.0 / 3.0 * std::f64::consts::PI * DENSITY)).cbrt() * scale
}

/// Mass (kg) of a ball of water of `radius` (m).
pub fn mass(radius: f64) -> f64 {
    4.0 / 3.0 * std::f64::consts::PI * DENSITY * radius.powi(3)
}

/// Colour from speed (m/s), opacity from age (s).
///
/// Fast, young spray is bright; it goes over to the slow colour as it slows or ages, and thins by 1/e per `fade_age`.
pub fn appearance(speed: f64, age: f64, particles: &scene::Particles) -> Appearance {
    let young = (-age / particles.fade_age).exp();
    let t = (speed / particles.fast_speed).clamp(0.0, 1.0);
    // Smoothstep: no kink at the speed from which all is fast.
    let fast = (t * t * (3.0 - 2.0 * t) * young) as f32;
    let color = |albedo: [f64; 3]| Vec3::from_array(albedo.map(|value| value as f32));
    Appearance {
        albedo: color(particles.slow_albedo).lerp(color(particles.fast_albedo), fast),
        opacity: (particles.opacity * young) as f32,
        share: 1.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_tonne_of_water_is_a_cubic_metre() {
        let r = radius(1000.0, 1.0);
        assert!((4.0 / 3.0 * std::f64::consts::PI * r.powi(3) - 1.0).abs() < 1e-12);
        assert!((radius(8000.0, 1.0) / r - 2.0).abs() < 1e-12);
        assert_eq!(radius(1000.0, 3.0), 3.0 * r);
        assert_eq!(radius(0.0, 1.0), 0.0);
        assert!((mass(radius(0.3, 1.0)) - 0.3).abs() < 1e-12);
        assert!(radius(f64::MAX, 1.0).is_finite());
    }

    #[test]
    fn fast_young_spray_is_bright_and_old_spray_thin() {
        let settings = scene::Particles::default();
        let color = |albedo: [f64; 3]| Vec3::from_array(albedo.map(|value| value as f32));
        let fast = appearance(settings.fast_speed, 0.0, &settings);
        assert!((fast.albedo - color(settings.fast_albedo)).length() < 1e-6);
        assert!((fast.opacity - settings.opacity as f32).abs() < 1e-7);
        let slow = appearance(0.0, 0.0, &settings);
        assert!((slow.albedo - color(settings.slow_albedo)).length() < 1e-6);
        let old = appearance(100.0, settings.fade_age, &settings);
        assert!((old.opacity - settings.opacity as f32 * (-1.0f32).exp()).abs() < 1e-6);
        assert!(old.albedo.x < fast.albedo.x && old.albedo.x > slow.albedo.x);
    }

    proptest! {
        #[test]
        fn any_speed_and_age_gives_shares(speed in 0.0f64..f64::MAX, age in 0.0f64..f64::MAX) {
            let look = appearance(speed, age, &scene::Particles::default());
            prop_assert!((0.0..=1.0).contains(&look.opacity));
            prop_assert!(look.albedo.min_element() >= 0.0 && look.albedo.max_element() <= 1.0);
        }
    }
}
