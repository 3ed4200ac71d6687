//! Air: what sunlight becomes on its way through Rayleigh, aerosol and ozone, at any elevation of the sun.
//!
//! One scattering is integrated along the view ray through spherical layers; all further ones come from a small table
//! (Hillaire, A Scalable and Production Ready Sky and Atmosphere Rendering Technique, 2020). Preetham's formulas (1999,
//! `sky::preetham`) end at the horizon and turn negative or wrong for low suns, where this one has a twilight. The aerosol
//! follows Preetham's turbidity (its appendix A.1, Angstrom's law). Lengths are kilometres, the sun above the air has an
//! irradiance of 1 in each channel.

use std::f32::consts::PI;

use glam::Vec3;
use rayon::prelude::*;

/// Radius of the ground (km).
const GROUND: f32 = 6360.0;
/// Height at which the air ends (km).
const TOP: f32 = 100.0;
/// Scale heights of air and aerosol (km).
const RAYLEIGH_HEIGHT: f32 = 8.0;
const AEROSOL_HEIGHT: f32 = 1.2;
/// Rayleigh scattering at the ground (1/km) for Rec.709 primaries (Hillaire 2020, table 1).
const RAYLEIGH: Vec3 = Vec3::new(5.802e-3, 13.558e-3, 33.1e-3);
/// Ozone's absorption at its peak, 25 km up (1/km; the same table).
const OZONE: Vec3 = Vec3::new(0.650e-3, 1.881e-3, 0.085e-3);
/// Effective wavelengths of the primaries (micrometres), for Angstrom's law.
const WAVELENGTH: Vec3 = Vec3::new(0.68, 0.55, 0.44);
/// Angstrom's exponent (Preetham 1999, A.1).
const ANGSTROM: f32 = 1.3;
/// Share of what meets an aerosol droplet that goes on (a clean continental aerosol).
const AEROSOL_ALBEDO: f32 = 0.93;
/// Mean cosine of aerosol scattering.
const AEROSOL_FORWARD: f32 = 0.8;
/// Sunlight above the air, relative to white (a black body of 5778 K in Rec.709, green at 1).
pub(super) const SUNLIGHT: Vec3 = Vec3::new(1.134, 1.0, 0.934);
/// Height of the eye (km): a lookout, so that the ground dissolves into haze before the horizon as it does in life.
const EYE: f32 = 0.1;

/// Steps along a view ray; quadratically spaced, so the first is metres long.
const VIEW_STEPS: usize = 40;
/// Sizes of the tables: cosines by heights.
const TRANSMITTANCE_SIZE: (usize, usize) = (128, 32);
const SCATTERED_SIZE: (usize, usize) = (24, 12);

/// Air over ground, with its tables.
#[derive(Clone, Debug)]
pub(super) struct Atmosphere {
    /// Aerosol extinction at the ground (1/km).
    aerosol: Vec3,
    ground_albedo: Vec3,
    /// Transmittance to the top, by height and by cosine above the local horizon.
    transmittance: Table,
}

/// Air with all orders of scattering, ready for view rays.
#[derive(Clone, Debug)]
pub(super) struct LitAtmosphere {
    air: Atmosphere,
    /// Mean radiance from second and later scatterings, by height and by the sun's cosine.
    scattered: Table,
}

/// What a view ray gathers.
#[derive(Clone, Copy, Debug)]
pub(super) struct View {
    /// Light scattered into the ray.
    pub(super) scattered: Vec3,
    /// Share that is left of what lies behind; only for rays that meet the ground.
    pub(super) ground: Option<Vec3>,
}

/// What air does to light at one height (1/km).
#[derive(Clone, Copy)]
struct Medium {
    rayleigh: Vec3,
    aerosol: Vec3,
    extinction: Vec3,
}

impl Atmosphere {
    /// Air of a turbidity over ground of an albedo.
    pub(super) fn new(turbidity: f32, ground_albedo: Vec3) -> Self {
        let beta = (0.04608 * turbidity - 0.04586).max(0.0);
        let depth = beta * WAVELENGTH.map(|wavelength| wavelength.powf(-ANGSTROM));
        let mut air = Self { aerosol: depth / AEROSOL_HEIGHT, ground_albedo, transmittance: Table::default() };
        let (columns, rows) = TRANSMITTANCE_SIZE;
        air.transmittance = Table::build(columns, rows, |u, v| {
            let radius = GROUND + TOP * v * v;
            let horizon = horizon_cosine(radius);
            air.integrate_transmittance(radius, horizon + (1.0 - horizon) * u * u)
        });
        air
    }

    /// Share of sunlight that reaches the ground from an elevation (radians), the sun taken as a point.
    pub(super) fn sun_transmittance(&self, elevation: f32) -> Vec3 {
        self.to_top(GROUND, elevation.sin())
    }

    fn medium(&self, height: f32) -> Medium {
        let rayleigh = RAYLEIGH * (-height / RAYLEIGH_HEIGHT).exp();
        let aerosol = self.aerosol * (-height / AEROSOL_HEIGHT).exp();
        // Ozone: a tent from 10 to 40 km.
        let ozone = OZONE * (1.0 - (height - 25.0).abs() / 15.0).max(0.0);
        Medium { rayleigh, aerosol: aerosol * AEROSOL_ALBEDO, extinction: rayleigh + aerosol + ozone }
    }

    fn integrate_transmittance(&self, radius: f32, cosine: f32) -> Vec3 {
        const STEPS: usize = 64;
        let length = distance_to(GROUND + TOP, radius, cosine);
        let mut depth = Vec3::ZERO;
        for step in 0..STEPS {
            let edge = |step: usize| (step as f32 / STEPS as f32).powi(2) * length;
            let (a, b) = (edge(step), edge(step + 1));
            depth += self.medium(height_along(radius, cosine, 0.5 * (a + b))).extinction * (b - a);
        }
        (-depth).exp()
    }

    /// Transmittance from a point to the top of the air; the ground is not looked for.
    fn to_top(&self, radius: f32, cosine: f32) -> Vec3 {
        let horizon = horizon_cosine(radius);
        let u = ((cosine - horizon) / (1.0 - horizon)).clamp(0.0, 1.0).sqrt();
        let v = ((radius - GROUND) / TOP).clamp(0.0, 1.0).sqrt();
        self.transmittance.at(u, v)
    }

    /// Sunlight at a point: transmittance times the share of the disc above the point's horizon.
    fn sunlight(&self, radius: f32, cosine: f32) -> Vec3 {
        let horizon = horizon_cosine(radius);
        // The disc sinks over its diameter; near the horizon a difference of cosines is one of angles.
        let half = super::SUN_ANGULAR_RADIUS;
        let t = ((cosine - horizon + half) / (2.0 * half)).clamp(0.0, 1.0);
        if t == 0.0 { Vec3::ZERO } else { self.to_top(radius, cosine) * (t * t * (3.0 - 2.0 * t)) }
    }

    /// Adds up all later scatterings for every height of the sun.
    pub(super) fn light(self) -> LitAtmosphere {
        let (columns, rows) = SCATTERED_SIZE;
        let scattered =
            Table::build(columns, rows, |u, v| self.later_scatterings(GROUND + TOP * v * v, sun_cosine_from_table(u)));
        LitAtmosphere { air: self, scattered }
    }

    /// Mean radiance at a point from all scatterings but the first, which are taken as isotropic (Hillaire 2020, eq. 5-10).
    fn later_scatterings(&self, radius: f32, sun_cosine: f32) -> Vec3 {
        const DIRECTIONS: usize = 32;
        const STEPS: usize = 20;
        let sun = Vec3::new((1.0 - sun_cosine * sun_cosine).max(0.0).sqrt(), sun_cosine, 0.0);
        // Just inside the air at both ends, so that every ray has a length.
        let radius = radius.clamp(GROUND + 0.01, GROUND + TOP - 0.01);
        let (mut second, mut transfer) = (Vec3::ZERO, Vec3::ZERO);
        for index in 0..DIRECTIONS {
            // Fibonacci sphere.
            let y = 1.0 - (2 * index + 1) as f32 / DIRECTIONS as f32;
            let phi = index as f32 * 2.399_963_2;
            let side = (1.0 - y * y).sqrt();
            let direction = Vec3::new(side * phi.cos(), y, side * phi.sin());
            let path = Path::new(radius, y);
            let mut through = Vec3::ONE;
            for (a, b) in path.steps::<STEPS>() {
                let (medium, at, cosine) = self.along(radius, direction, sun, 0.5 * (a + b));
                let left = (-medium.extinction * (b - a)).exp();
                let scattering = medium.rayleigh + medium.aerosol;
                let share = through * scattering * (Vec3::ONE - left) / medium.extinction;
                second += share * self.sunlight(at, cosine) / (4.0 * PI);
                transfer += share;
                through *= left;
            }
            if path.meets_ground {
                let point = Vec3::Y * radius + direction * path.length;
                let cosine = point.normalize().dot(sun);
                second += through * self.ground_albedo / PI * cosine.max(0.0) * self.sunlight(GROUND, cosine);
            }
        }
        let count = DIRECTIONS as f32;
        second / count / (Vec3::ONE - transfer / count)
    }

    /// Medium, radius and the sun's cosine at distance `t` along a ray from (0, radius, 0).
    fn along(&self, radius: f32, direction: Vec3, sun: Vec3, t: f32) -> (Medium, f32, f32) {
        let height = height_along(radius, direction.y, t);
        let up = (Vec3::Y * radius + direction * t).normalize();
        (self.medium(height), GROUND + height, up.dot(sun))
    }
}

impl LitAtmosphere {
    /// Light that reaches the eye from a unit direction, the sun standing at a unit direction.
    pub(super) fn view(&self, direction: Vec3, sun: Vec3) -> View {
        let radius = GROUND + EYE;
        let path = Path::new(radius, direction.y);
        let cosine = direction.dot(sun);
        let (rayleigh, aerosol) = (rayleigh_phase(cosine), aerosol_phase(cosine));
        let (mut sum, mut through) = (Vec3::ZERO, Vec3::ONE);
        for (a, b) in path.steps::<VIEW_STEPS>() {
            let (medium, at, sun_cosine) = self.air.along(radius, direction, sun, 0.5 * (a + b));
            let left = (-medium.extinction * (b - a)).exp();
            let first = (medium.rayleigh * rayleigh + medium.aerosol * aerosol) * self.air.sunlight(at, sun_cosine);
            let later = (medium.rayleigh + medium.aerosol) * self.scattered(at, sun_cosine);
            sum += through * (first + later) * (Vec3::ONE - left) / medium.extinction;
            through *= left;
        }
        View { scattered: sum, ground: path.meets_ground.then_some(through) }
    }

    fn scattered(&self, radius: f32, sun_cosine: f32) -> Vec3 {
        let v = ((radius - GROUND) / TOP).clamp(0.0, 1.0).sqrt();
        self.scattered.at(sun_cosine_to_table(sun_cosine), v)
    }
}

/// Where a ray from inside the air ends.
struct Path {
    length: f32,
    meets_ground: bool,
}

impl Path {
    fn new(radius: f32, cosine: f32) -> Self {
        let meets_ground = cosine < horizon_cosine(radius);
        let length = if meets_ground {
            // The nearer root, by its stable form: c / (b + sqrt(b^2 - c)) with b = -r cos > 0.
            let b = -radius * cosine;
            let c = (radius - GROUND) * (radius + GROUND);
            c / (b + (b * b - c).max(0.0).sqrt())
        } else {
            distance_to(GROUND + TOP, radius, cosine)
        };
        Self { length, meets_ground }
    }

    /// Quadratically spaced steps as pairs of edges.
    fn steps<const COUNT: usize>(&self) -> impl Iterator<Item = (f32, f32)> {
        let length = self.length;
        (0..COUNT).map(move |step| {
            let edge = |step: usize| (step as f32 / COUNT as f32).powi(2) * length;
            (edge(step), edge(step + 1))
        })
    }
}

/// Distance from inside a sphere to its surface.
fn distance_to(sphere: f32, radius: f32, cosine: f32) -> f32 {
    let b = radius * cosine;
    let c = (sphere - radius) * (sphere + radius);
    let root = (b * b + c).max(0.0).sqrt();
    // Of the two equal forms the one without cancellation.
    if b > 0.0 { c / (b + root) } else { root - b }
}

/// Height above ground (km) after `t` along a ray; differences of squares keep metres at planetary radii.
fn height_along(radius: f32, cosine: f32, t: f32) -> f32 {
    let start = radius - GROUND;
    let far = (radius * radius + 2.0 * radius * cosine * t + t * t).max(0.0).sqrt();
    (start + t * (2.0 * radius * cosine + t) / (far + radius)).clamp(0.0, TOP)
}

/// Cosine of the zenith angle at which the ground ends, seen from a radius.
fn horizon_cosine(radius: f32) -> f32 {
    -(((radius - GROUND).max(0.0) * (radius + GROUND)).sqrt() / radius)
}

/// The table of later scatterings is finest around the horizon, where a setting sun changes most.
fn sun_cosine_to_table(cosine: f32) -> f32 {
    0.5 + 0.5 * cosine.signum() * cosine.abs().min(1.0).sqrt()
}
fn sun_cosine_from_table(u: f32) -> f32 {
    let s = 2.0 * u - 1.0;
    s * s.abs()
}

fn rayleigh_phase(cosine: f32) -> f32 {
    3.0 / (16.0 * PI) * (1.0 + cosine * cosine)
}

/// Cornette and Shanks 1992.
fn aerosol_phase(cosine: f32) -> f32 {
    let g = AEROSOL_FORWARD;
    let g2 = g * g;
    let base = (1.0 + g2 - 2.0 * g * cosine).max(1e-4);
    3.0 / (8.0 * PI) * (1.0 - g2) * (1.0 + cosine * cosine) / ((2.0 + g2) * base * base.sqrt())
}

/// A small table over the unit square, values at its grid points, linear between.
#[derive(Clone, Debug, Default)]
struct Table {
    columns: usize,
    rows: usize,
    values: Vec<Vec3>,
}

impl Table {
    fn build(columns: usize, rows: usize, value: impl Fn(f32, f32) -> Vec3 + Sync) -> Self {
        let values = (0..columns * rows)
            .into_par_iter()
            .map(|index| {
                let u = (index % columns) as f32 / (columns - 1) as f32;
                let v = (index / columns) as f32 / (rows - 1) as f32;
                value(u, v)
            })
            .collect();
        Self { columns, rows, values }
    }

    fn at(&self, u: f32, v: f32) -> Vec3 {
        let (x, y) = (u * (self.columns - 1) as f32, v * (self.rows - 1) as f32);
        let (column, row) = ((x as usize).min(self.columns - 2), (y as usize).min(self.rows - 2));
        let (fx, fy) = (x - column as f32, y - row as f32);
        let corner = row * self.columns + column;
        let top = self.values[corner].lerp(self.values[corner + 1], fx);
        let bottom = self.values[corner + self.columns].lerp(self.values[corner + self.columns + 1], fx);
        top.lerp(bottom, fy)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn phase_functions_scatter_all_light_somewhere() {
        for phase in [rayleigh_phase, aerosol_phase] {
            let n = 20_000;
            let sum: f64 = (0..n).map(|i| f64::from(phase(-1.0 + 2.0 * (i as f32 + 0.5) / n as f32))).sum();
            assert!((sum * 2.0 / f64::from(n) * std::f64::consts::TAU - 1.0).abs() < 1e-3);
        }
    }

    #[test]
    fn the_zenith_depth_is_that_of_the_layers() {
        // Exponential layers integrate to scale height times extinction, the tent to 15 km of its peak.
        let air = Atmosphere::new(3.0, Vec3::ZERO);
        let depth = RAYLEIGH * RAYLEIGH_HEIGHT + air.aerosol * AEROSOL_HEIGHT + OZONE * 15.0;
        let t = air.sun_transmittance(std::f32::consts::FRAC_PI_2);
        assert!((t - (-depth).exp()).abs().max_element() < 2e-3, "{t} {}", (-depth).exp());
    }

    #[test]
    fn low_sun_is_redder_and_weaker() {
        let air = Atmosphere::new(3.0, Vec3::ZERO);
        let mut last = Vec3::ONE;
        for elevation in [90.0f32, 60.0, 35.0, 15.0, 5.0, 1.0, 0.0] {
            let t = air.sun_transmittance(elevation.to_radians());
            assert!(t.cmplt(last).all(), "{elevation}");
            assert!(t.x > t.y && t.y > t.z && t.z > 0.0);
            assert!(t.x / t.z >= last.x / last.z);
            last = t;
        }
    }

    #[test]
    fn heights_along_a_ray_match_double_precision() {
        for (cosine, t) in [(0.0f32, 30.0f32), (1.0, 50.0), (-0.001, 12.0), (0.3, 90.0), (-0.0056, 0.01)] {
            let start = f64::from(GROUND + EYE);
            let (c, d) = (f64::from(cosine), f64::from(t));
            let exact = (start * start + 2.0 * start * c * d + d * d).sqrt() - f64::from(GROUND);
            let ours = f64::from(height_along(GROUND + EYE, cosine, t));
            // 6360.1 itself is rounded to 0.5 m; the rest is relative.
            assert!((ours - exact).abs() < 1e-5 * exact + 1e-6, "{cosine} {t}: {ours} {exact}");
        }
    }

    #[test]
    fn no_air_scatters_more_than_it_gets() {
        // Over black ground the light scattered down and the sunlight left cannot exceed what comes in from above.
        let sun = Vec3::new(0.0, 1.0, 0.0);
        let lit = Atmosphere::new(3.0, Vec3::ZERO).light();
        let mut down = Vec3::ZERO;
        let n = 64;
        for i in 0..n {
            let y = ((i as f32 + 0.5) / n as f32).sqrt();
            down += lit.view(Vec3::new((1.0 - y * y).sqrt(), y, 0.0), sun).scattered * PI / n as f32;
        }
        let total = down + lit.air.sun_transmittance(std::f32::consts::FRAC_PI_2);
        assert!(total.max_element() < 1.0 && total.min_element() > 0.6, "{total}");
    }
}
