//! The sun: a disc of 0.533 degrees, its direction, colour and irradiance. The sky around it is in `sky`.

use glam::Vec3;

use crate::scene;

use super::{
    atmosphere::{Atmosphere, SUNLIGHT},
    luminance,
};

/// Half of 0.533 degrees, in radians.
pub const SUN_ANGULAR_RADIUS: f32 = 0.533 / 2.0 * (std::f32::consts::PI / 180.0);

/// The sun as the renderer needs it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sun {
    /// Unit vector towards its centre.
    pub direction: Vec3,
    /// Irradiance on a card that faces it; 0 below the horizon, in part while the disc is cut by it.
    pub irradiance: Vec3,
    /// Radiance of the disc: irradiance over the disc's solid angle (6.8e-5 sr).
    pub disc_radiance: Vec3,
    /// Cosine of the disc's angular radius: a direction d looks into the disc where d . direction >= this.
    pub cos_radius: f32,
    /// Two unit vectors that span the disc.
    spanned_by: [Vec3; 2],
    /// 1 - cos of the disc's angular radius, to all digits.
    rim: f32,
    /// 1 over the disc's solid angle.
    pdf: f32,
}

impl Sun {
    /// The sun of a scene; its default colour is that of sunlight through `sky`'s air.
    pub fn build(sun: &scene::Sun, sky: &scene::Sky) -> Self {
        let elevation = sun.elevation.to_radians();
        let visible = visible_share(elevation);
        let color = match sun.color {
            Some(color) => Vec3::new(color[0] as f32, color[1] as f32, color[2] as f32),
            // While the disc is cut by the horizon its light has the colour of its upper part.
            None => {
                Atmosphere::new(sky.turbidity as f32, Vec3::ZERO).sun_transmittance(elevation.max(0.0) as f32)
                    * SUNLIGHT
            }
        };
        let scale = luminance(color);
        let color = if scale > 0.0 { color / scale } else { Vec3::ZERO };
        let irradiance = color * (sun.irradiance * visible) as f32;
        let direction = direction(sun.elevation, sun.azimuth);
        Self {
            direction,
            irradiance,
            disc_radiance: irradiance / solid_angle() as f32,
            cos_radius: f64::from(SUN_ANGULAR_RADIUS).cos() as f32,
            spanned_by: direction.any_orthonormal_pair().into(),
            // By the half angle: the difference itself would keep four digits.
            rim: 2.0 * (SUN_ANGULAR_RADIUS / 2.0).sin().powi(2),
            pdf: 1.0 / solid_angle() as f32,
        }
    }

    /// A unit direction into the disc, even over its solid angle; its density is [`Sun::pdf`].
    ///
    /// On the rim itself, rounding may leave the direction outside of what [`Sun::contains`] takes.
    #[inline]
    pub fn sample(&self, u: [f32; 2]) -> Vec3 {
        let [across, along] = self.spanned_by;
        let fall = self.rim * u[0];
        let side = (fall * (2.0 - fall)).sqrt();
        let (sin, cos) = (std::f32::consts::TAU * u[1]).sin_cos();
        ((1.0 - fall) * self.direction + side * (cos * across + sin * along)).normalize()
    }

    /// Density (1/sr) of the directions that [`Sun::sample`] gives: 1 over the disc's solid angle.
    #[inline]
    pub fn pdf(&self) -> f32 {
        self.pdf
    }

    /// True where a unit direction looks into the disc.
    #[inline]
    pub fn contains(&self, direction: Vec3) -> bool {
        // Chord instead of cosine: 1 - cos of the disc is 1e-5, a cosine in single precision would blur its edge by 1 %.
        (direction - self.direction).length_squared() <= 2.0 * self.rim
    }
}

/// Unit direction of an elevation above the horizon and an azimuth from north, eastward (degrees).
pub fn direction(elevation: f64, azimuth: f64) -> Vec3 {
    let (sin_elevation, cos_elevation) = elevation.to_radians().sin_cos();
    let (sin_azimuth, cos_azimuth) = azimuth.to_radians().sin_cos();
    glam::DVec3::new(sin_azimuth * cos_elevation, sin_elevation, -cos_azimuth * cos_elevation).as_vec3()
}

/// Solid angle of the disc (sr). 1 - cos by its half angle: the plain difference keeps four digits in single precision.
fn solid_angle() -> f64 {
    std::f64::consts::TAU * 2.0 * (f64::from(SUN_ANGULAR_RADIUS) / 2.0).sin().powi(2)
}

/// Share of the disc's area above the horizon.
fn visible_share(elevation: f64) -> f64 {
    let h = (elevation / f64::from(SUN_ANGULAR_RADIUS)).clamp(-1.0, 1.0);
    // Area of a unit disc above a chord at -h: (acos(-h) + h sqrt(1 - h^2)) / pi.
    ((-h).acos() + h * (1.0 - h * h).sqrt()) / std::f64::consts::PI
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(elevation: f64) -> Sun {
        Sun::build(&scene::Sun { elevation, ..Default::default() }, &scene::Sky::default())
    }

    #[test]
    fn azimuth_runs_from_north_eastward() {
        for (azimuth, expected) in [(0.0, -Vec3::Z), (90.0, Vec3::X), (180.0, Vec3::Z), (270.0, -Vec3::X)] {
            assert!((direction(0.0, azimuth) - expected).length() < 1e-6, "{azimuth}");
        }
        assert_eq!(direction(90.0, 12.0).y, 1.0);
    }

    #[test]
    fn the_default_sun_is_gently_warm_and_of_luminance_one() {
        let sun = at(35.0);
        assert!((luminance(sun.irradiance) - 2.2).abs() < 1e-5);
        assert!(sun.irradiance.x > sun.irradiance.y && sun.irradiance.y > sun.irradiance.z);
        assert!(sun.irradiance.x < 3.0 * sun.irradiance.z);
    }

    #[test]
    fn a_given_colour_is_scaled_to_luminance_one() {
        let sun = scene::Sun { color: Some([8.0, 8.0, 8.0]), irradiance: 1.5, ..Default::default() };
        assert!((Sun::build(&sun, &scene::Sky::default()).irradiance - Vec3::splat(1.5)).abs().max_element() < 1e-6);
        let black = scene::Sun { color: Some([0.0; 3]), ..sun };
        assert_eq!(Sun::build(&black, &scene::Sky::default()).irradiance, Vec3::ZERO);
    }

    #[test]
    fn the_disc_holds_the_irradiance() {
        let sun = at(50.0);
        let solid_angle = sun.irradiance / sun.disc_radiance;
        assert!((solid_angle - Vec3::splat(6.796e-5)).abs().max_element() < 1e-8, "{solid_angle}");
        let side = sun.direction.any_orthonormal_vector();
        for (angle, inside) in [(0.0f32, true), (0.265, true), (0.268, false), (90.0, false), (180.0, false)] {
            let (s, c) = angle.to_radians().sin_cos();
            assert_eq!(sun.contains(sun.direction * c + side * s), inside, "{angle}");
        }
    }

    #[test]
    fn drawn_directions_fill_the_disc_evenly() {
        for elevation in [35.0, 90.0, 0.0] {
            let sun = at(elevation);
            let (mut outside, mut inner, mut east, side) = (0, 0, 0, 300);
            let across = sun.direction.any_orthonormal_vector();
            for i in 0..side * side {
                let u = [(i % side) as f32 + 0.5, (i / side) as f32 + 0.5].map(|x| x / side as f32);
                let d = sun.sample(u);
                assert!((d.length() - 1.0).abs() < 1e-6);
                outside += u32::from(!sun.contains(d));
                inner += u32::from((d - sun.direction).length() < 0.5 * SUN_ANGULAR_RADIUS);
                east += u32::from(d.dot(across) > 0.0);
            }
            // A quarter of the disc's area lies within half its radius, half of it on either side.
            let share = |count: u32| f64::from(count) / (side * side) as f64;
            assert!(outside == 0 && (share(inner) - 0.25).abs() < 5e-3 && (share(east) - 0.5).abs() < 5e-3);
            // Radiance over density is the irradiance.
            assert!((sun.disc_radiance / sun.pdf() - sun.irradiance).abs().max_element() < 1e-5 * sun.irradiance.x);
        }
    }

    #[test]
    fn it_sets_over_its_own_diameter() {
        assert_eq!(at(-0.267).irradiance, Vec3::ZERO);
        assert_eq!(at(-90.0).irradiance, Vec3::ZERO);
        assert!((luminance(at(0.0).irradiance) - 1.1).abs() < 1e-5);
        assert!((luminance(at(0.267).irradiance) - 2.2).abs() < 1e-5);
    }
}
