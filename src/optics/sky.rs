//! What comes from a direction in which nothing stands: the sky, its haze and the far ground, without the sun's disc.
//!
//! Five kinds behind one type. The two that are formulas are scaled per channel so that under the default sun and sky a
//! horizontal white card has a radiance of exactly 1; other settings change them as the air itself would.

use std::{path::Path, sync::OnceLock};

use glam::Vec3;
use rayon::prelude::*;

use crate::images::TextureMemory;
use crate::scene;

use super::{Irradiance, OpticsError, Sun, atmosphere::Atmosphere, environment::LatLong};

mod preetham;
mod sampling;

use preetham::Preetham;
pub use sampling::SkySampler;

/// A sky of any kind, ready to be asked from any thread.
#[derive(Clone, Debug)]
pub struct Sky {
    kind: Kind,
    /// Factor on whatever `kind` says; the irradiance has it already.
    scale: f32,
    irradiance: Irradiance,
}

#[derive(Clone, Debug)]
enum Kind {
    Constant(Vec3),
    Analytic(Dome),
    LatLong { image: LatLong, turn: f32 },
    Skybox { above: LatLong, below: LatLong, turn: f32 },
}

impl Sky {
    /// Builds the sky of a scene; `directory` is where its images' paths start.
    ///
    /// # Errors
    /// An image that is not named, missing, damaged, too large or not finite.
    pub fn build(sky: &scene::Sky, sun: &scene::Sun, directory: &Path) -> Result<Self, OpticsError> {
        Self::build_within(&TextureMemory::default(), sky, sun, directory)
    }

    /// As [`Sky::build`], with memory that is shared with other textures.
    ///
    /// # Errors
    /// As there.
    pub fn build_within(
        memory: &TextureMemory,
        sky: &scene::Sky,
        sun: &scene::Sun,
        directory: &Path,
    ) -> Result<Self, OpticsError> {
        let scale = sky.scale as f32;
        let turn = (sky.rotation / 360.0).rem_euclid(1.0) as f32;
        let read = |name: &Option<String>, kind: &'static str, key: &'static str| match name {
            Some(name) => LatLong::read(&directory.join(name), memory),
            None => Err(OpticsError::NoImage { kind, key }),
        };
        let (kind, irradiance) = match sky.kind {
            scene::SkyKind::Constant => {
                let radiance = Vec3::from_array(sky.radiance.map(|value| value as f32));
                (Kind::Constant(radiance), Irradiance::constant(radiance))
            }
            scene::SkyKind::Analytic => {
                let (dome, irradiance) = Dome::build(Air::Layers, sky, sun);
                (Kind::Analytic(dome), irradiance)
            }
            scene::SkyKind::Preetham => {
                let (dome, irradiance) = Dome::build(Air::Preetham, sky, sun);
                (Kind::Analytic(dome), irradiance)
            }
            scene::SkyKind::Latlong => {
                let image = read(&sky.image, "latlong", "image")?;
                let irradiance = integrate(&image, &image, turn);
                (Kind::LatLong { image, turn }, irradiance)
            }
            scene::SkyKind::Skybox => {
                let above = read(&sky.above, "skybox", "above")?;
                let below = read(&sky.below, "skybox", "below")?;
                let irradiance = integrate(&above, &below, turn);
                (Kind::Skybox { above, below, turn }, irradiance)
            }
        };
        let sky = Self { kind, scale, irradiance: irradiance.scaled(Vec3::splat(scale)) };
        sky.check().map(|()| sky)
    }

    /// Radiance from a unit direction, without the sun's disc.
    #[inline]
    pub fn radiance(&self, direction: Vec3) -> Vec3 {
        let radiance = match &self.kind {
            Kind::Constant(radiance) => *radiance,
            Kind::Analytic(dome) => dome.radiance(direction),
            Kind::LatLong { image, turn } => {
                let (u, v) = place(direction);
                image.at(u - turn, v)
            }
            // The report's 4.3 with y up: the ray's y decides which texture, and each is a whole latitude-longitude map
            // of which its own half is seen, so that filtering at the horizon stays within one texture.
            Kind::Skybox { above, below, turn } => {
                let (u, v) = place(direction);
                if direction.y >= 0.0 { above.at(u - turn, v) } else { below.at(u - turn, v) }
            }
        };
        radiance * self.scale
    }

    /// Mean radiance over a round cone about a unit direction, `angle` (radians) from edge to edge, without the sun's disc.
    ///
    /// Only what an image shows is averaged: formulas are smooth over any cone that a pixel has.
    #[inline]
    pub fn mean_radiance(&self, direction: Vec3, angle: f32) -> Vec3 {
        let (image, turn) = match &self.kind {
            Kind::Constant(_) | Kind::Analytic(_) => return self.radiance(direction),
            Kind::LatLong { image, turn } => (image, turn),
            Kind::Skybox { above, below, turn } => (if direction.y >= 0.0 { above } else { below }, turn),
        };
        let (u, v) = place(direction);
        // Meridians draw together towards the poles; about one of them the cone spans all.
        let side = (direction.x * direction.x + direction.z * direction.z).sqrt();
        let across = (angle * (0.5 * std::f32::consts::FRAC_1_PI) / side).min(1.0);
        let down = (angle * std::f32::consts::FRAC_1_PI).min(1.0);
        image.mean(u - turn, v, [across, down]) * self.scale
    }

    /// Whether it shows an image, with detail that a cone may average.
    pub fn is_image(&self) -> bool {
        matches!(self.kind, Kind::LatLong { .. } | Kind::Skybox { .. })
    }

    /// What went wrong first in any look at its images so far; the light of that look is missing.
    ///
    /// # Errors
    /// That.
    pub fn check(&self) -> Result<(), OpticsError> {
        let failure = match &self.kind {
            Kind::Constant(_) | Kind::Analytic(_) => None,
            Kind::LatLong { image, .. } => image.failure(),
            Kind::Skybox { above, below, .. } => above.failure().or_else(|| below.failure()),
        };
        failure.map_or(Ok(()), Err)
    }

    /// Irradiance on a card of a unit normal, from the whole sky and far ground, without the sun.
    #[inline]
    pub fn irradiance(&self, normal: Vec3) -> Vec3 {
        self.irradiance.at(normal)
    }

    /// Mean radiance of the upper hemisphere, weighted by the cosine with up: what a level card sees.
    #[inline]
    pub fn average_up(&self) -> Vec3 {
        self.irradiance(Vec3::Y) / std::f32::consts::PI
    }
}

/// Texture place of a unit direction: u = azimuth / 360 (north 0, eastward), v = 0 at the zenith, 1 at the nadir.
#[inline]
fn place(direction: Vec3) -> (f32, f32) {
    let azimuth = direction.x.atan2(-direction.z) * (0.5 / std::f32::consts::PI);
    (azimuth, 0.5 - elevation(direction) * std::f32::consts::FRAC_1_PI)
}

/// Elevation (radians) of a unit direction; atan2 keeps its digits where asin loses them, near the zenith.
#[inline]
fn elevation(direction: Vec3) -> f32 {
    direction.y.atan2((direction.x * direction.x + direction.z * direction.z).sqrt())
}

/// Irradiance of one or two latitude-longitude images, turned eastward by `turn` of a full turn.
fn integrate(above: &LatLong, below: &LatLong, turn: f32) -> Irradiance {
    if std::ptr::eq(above, below) && turn == 0.0 {
        return above.irradiance();
    }
    // Turned images do not share cells with the map, and two textures may differ in size: take four looks per cell of the
    // finer one.
    let columns = above.width().max(below.width()).max(8);
    let rows = (above.height().max(below.height()).max(4)).next_multiple_of(2);
    Irradiance::from_map(columns, rows, |column, row| {
        let image = if row < rows / 2 { above } else { below };
        let mut sum = Vec3::ZERO;
        for (dx, dy) in [(0.25, 0.25), (0.75, 0.25), (0.25, 0.75), (0.75, 0.75)] {
            sum += image.look((column as f32 + dx) / columns as f32 - turn, (row as f32 + dy) / rows as f32);
        }
        sum * 0.25
    })
}

/// Whose formula gives the light of clear air.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Air {
    /// Scattering through layers, at any elevation of the sun.
    Layers,
    /// Preetham, Shirley and Smits 1999.
    Preetham,
}

/// A sky that is a formula, tabulated: symmetric about the sun's meridian, rows crowded at the horizon.
#[derive(Clone, Debug)]
struct Dome {
    /// Radiance by row (zenith first), then by azimuth from the sun, 0 to 180 degrees.
    values: Vec<Vec3>,
    /// Horizontal unit vector towards the sun: x, z.
    toward: [f32; 2],
}

const DOME_COLUMNS: usize = 97;
const DOME_ROWS: usize = 193;

/// Elevation (radians) of a row's place -1 (nadir) .. 1 (zenith): near the horizon 0.01 degrees apart.
fn row_elevation(s: f32) -> f32 {
    s * s.abs() * std::f32::consts::FRAC_PI_2
}

impl Dome {
    fn build(air: Air, sky: &scene::Sky, sun: &scene::Sun) -> (Self, Irradiance) {
        let scale = daylight_scale(air);
        let albedo = Vec3::from_array(sky.ground_albedo.map(|value| value as f32));
        let (mut dome, ground) = Self::air(air, sky.turbidity, albedo, sun.elevation);
        let heading = sun.azimuth.to_radians();
        dome.toward = [heading.sin() as f32, -heading.cos() as f32];
        for value in &mut dome.values {
            *value *= scale;
        }
        // The far ground is lit by the sun and by what is above; nothing below the horizon counts for the latter.
        let from_above = dome.integrate().at(Vec3::Y);
        let sunlight = Sun::build(sun, sky);
        let lit = from_above + sunlight.irradiance * sunlight.direction.y.max(0.0);
        let radiance = albedo * lit / std::f32::consts::PI;
        for (value, through) in dome.values.iter_mut().zip(ground) {
            *value += through * radiance;
        }
        let irradiance = dome.integrate();
        (dome, irradiance)
    }

    /// Scattered light alone in the air's own units, and beside it the transmittance to the ground.
    fn air(air: Air, turbidity: f64, albedo: Vec3, sun_elevation: f64) -> (Self, Vec<Vec3>) {
        let sun = super::sun::direction(sun_elevation, 90.0);
        match air {
            Air::Layers => {
                let air = Atmosphere::new(turbidity as f32, albedo).light();
                Self::tabulate(|direction| {
                    let view = air.view(direction, sun);
                    (view.scattered, view.ground.unwrap_or(Vec3::ZERO))
                })
            }
            // The formula has no air below the horizon: the ground is seen as it is.
            Air::Preetham => {
                let perez = Preetham::new(turbidity, sun_elevation);
                Self::tabulate(|direction| match direction.y >= 0.0 {
                    true => (perez.radiance(direction.y, direction.dot(sun)), Vec3::ZERO),
                    false => (Vec3::ZERO, Vec3::ONE),
                })
            }
        }
    }

    /// The table of two colours of a direction, the sun standing in the east.
    fn tabulate(colors: impl Fn(Vec3) -> (Vec3, Vec3) + Sync) -> (Self, Vec<Vec3>) {
        let (values, ground) = (0..DOME_ROWS * DOME_COLUMNS)
            .into_par_iter()
            .map(|index| {
                let (row, column) = (index / DOME_COLUMNS, index % DOME_COLUMNS);
                let (y, side) = row_elevation(1.0 - 2.0 * row as f32 / (DOME_ROWS - 1) as f32).sin_cos();
                let (sin, cos) = (column as f32 / (DOME_COLUMNS - 1) as f32 * std::f32::consts::PI).sin_cos();
                colors(Vec3::new(side * cos, y, side * sin))
            })
            .unzip();
        (Self { values, toward: [1.0, 0.0] }, ground)
    }

    fn integrate(&self) -> Irradiance {
        const COLUMNS: usize = 128;
        const ROWS: usize = 128;
        Irradiance::from_map(COLUMNS, ROWS, |column, row| {
            let azimuth = (column as f32 + 0.5) / COLUMNS as f32 * std::f32::consts::TAU;
            let (y, side) = ((0.5 - (row as f32 + 0.5) / ROWS as f32) * std::f32::consts::PI).sin_cos();
            self.radiance(Vec3::new(side * azimuth.sin(), y, -side * azimuth.cos()))
        })
    }

    #[inline]
    fn radiance(&self, direction: Vec3) -> Vec3 {
        let along = direction.x * self.toward[0] + direction.z * self.toward[1];
        let across = direction.x * self.toward[1] - direction.z * self.toward[0];
        let azimuth = across.abs().atan2(along) * std::f32::consts::FRAC_1_PI;
        let height = elevation(direction) * std::f32::consts::FRAC_2_PI;
        let s = height.abs().sqrt().copysign(height);
        let x = azimuth * (DOME_COLUMNS - 1) as f32;
        let y = (1.0 - s) * (0.5 * (DOME_ROWS - 1) as f32);
        let (column, row) = ((x as usize).min(DOME_COLUMNS - 2), (y as usize).min(DOME_ROWS - 2));
        let (fx, fy) = (x - column as f32, y - row as f32);
        let corner = row * DOME_COLUMNS + column;
        let upper = self.values[corner].lerp(self.values[corner + 1], fx);
        let lower = self.values[corner + DOME_COLUMNS].lerp(self.values[corner + DOME_COLUMNS + 1], fx);
        upper.lerp(lower, fy)
    }
}

/// Per channel, what turns the air's own units into ours: the default sun and sky give a level card irradiance pi.
fn daylight_scale(air: Air) -> Vec3 {
    static LAYERS: OnceLock<Vec3> = OnceLock::new();
    static PREETHAM: OnceLock<Vec3> = OnceLock::new();
    let scale = match air {
        Air::Layers => &LAYERS,
        Air::Preetham => &PREETHAM,
    };
    *scale.get_or_init(|| {
        let (sky, sun) = (scene::Sky::default(), scene::Sun::default());
        let albedo = Vec3::from_array(sky.ground_albedo.map(|value| value as f32));
        let (dome, _) = Dome::air(air, sky.turbidity, albedo, sun.elevation);
        let direct = Sun::build(&sun, &sky);
        let wanted = Vec3::splat(std::f32::consts::PI) - direct.irradiance * direct.direction.y;
        wanted / dome.integrate().at(Vec3::Y)
    })
}

#[cfg(test)]
mod look;
#[cfg(test)]
mod tests;
