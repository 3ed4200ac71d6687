//! The sun: a disc of 0.533 degrees, its direction, colour and irradiance. The sky around it is in `sky`.

use glam::Vec3;

use crate::scene;

use super::{atmosphere::Atmosphere, luminance};

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
}

impl Sun {
    /// The sun of a scene; its default colour is that of sunlight through `sky`'s air.
    pub fn build(sun: &scene::Sun, sky: &scene::Sky) -> Self {
        let elevation = sun.elevation.to_radians();
        let visible = visible_share(elevation);
        let color = match sun.color {
            Some(color) => Vec3::new(color[0] as f32, color[1] as f32, color[2] as f32),
            // While the disc is cut by the horizon its light has the colour of its upper part.
            None => Atmosphere::new(sky.turbidity as f32, Vec3::ZERO).sun_transmittance(elevation.max(0.0) as f32),
        };
        let scale = luminance(color);
        let color = if scale > 0.0 { color / scale } else { Vec3::ZERO };
        let irradiance = color * (sun.irradiance * visible) as f32;
        let radius = f64::from(SUN_ANGULAR_RADIUS);
        // 1 - cos by its half angle: the plain difference keeps four digits only in single precision.
        let solid_angle = std::f64::consts::TAU * 2.0 * (radius / 2.0).sin().powi(2);
        Self {
            direction: direction(sun.elevation, sun.azimuth),
            irradiance,
            disc_radiance: irradiance / solid_angle as f32,
            cos_radius: radius.cos() as f32,
        }
    }

    /// True where a unit direction looks into the disc.
    #[inline]
    pub fn contains(&self, direction: Vec3) -> bool {
        // Chord instead of cosine: 1 - cos of the disc is 1e-5, a cosine in single precision would blur its edge by 1 %.
        let radius = 2.0 * (SUN_ANGULAR_RADIUS / 2.0).sin();
        (direction - self.direction).length_squared() <= radius * radius
    }
}

/// Unit direction of an elevation above the horizon and an azimuth from north, eastward (degrees).
pub fn direction(elevation: f64, azimuth: f64) -> Vec3 {
    let (sin_elevation, cos_elevation) = elevation.to_radians().sin_cos();
    let (sin_azimuth, cos_azimuth) = azimuth.to_radians().sin_cos();
    glam::DVec3::new(sin_azimuth * cos_elevation, sin_elevation, -cos_azimuth * cos_elevation).as_vec3()
}

/// Share of the disc's area above the horizon.
fn visible_share(elevation: f64) -> f64 {
    let h = (elevation / f64::from(SUN_ANGULAR_RADIUS)).clamp(-1.0, 1.0);
    // Area of a unit disc above a chord at -h: (acos(-h) + h sqrt(1 - h^2)) / pi.
    ((-h).acos() + h * (1.0 - h * h).sqrt()) / std::f64::consts::PI
}
