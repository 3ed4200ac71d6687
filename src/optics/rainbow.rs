//! How a drop of water scatters sunlight: the rainbow, the fog bow, the dark band, and what goes straight on, as a table over
//! angle and radius.
//!
//! Geometric optics and Fresnel's equations for the energy of every way through the drop; G. Airy's integral (On the
//! intensity of light in the neighbourhood of a caustic, 1838) for how the two bows spread it; Fraunhofer's diffraction for
//! what passes by. Averaged over wavelengths, the sun's disc and the sizes of drops. Where it is asked for is not here.

mod airy;

use std::f64::consts::{PI, TAU};

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::SUN_ANGULAR_RADIUS;
use airy::Airy;

/// Angles of the table: the middles of as many equal bins between 0 and 180 degrees. The sun's disc is five of them wide.
const BINS: usize = 1800;

/// Width of a bin (radians).
const WIDTH: f64 = PI / BINS as f64;

/// Radii of the table to a factor of ten: neighbours differ by a tenth, which moves a bow by less than a tenth of its width.
const TO_TEN: f64 = 24.0;

/// Least and greatest radius (m) of the table. Under the least Airy's theory does not hold; over the greatest the bow is as
/// wide as the sun and colour make it, and that of a larger drop is the same.
const RADII: [f64; 2] = [2e-6, 5e-3];

/// Wavelengths: neighbours' bows are 0.07 degrees apart, less than a bin.
const COLORS: usize = 24;

/// Ways through the drop that are followed one by one: what is left after eight reflections is under 1e-5 of the light.
const WAYS: u32 = 9;

/// Strips of the drop's face on which rays fall.
const STRIPS: usize = 4000;

/// How a drop of water scatters the sun's light, by angle, radius and colour.
///
/// All functions are densities (1/sr) over the sphere for unpolarised light, per channel of linear Rec.709, of which each
/// is 1 in all for light that is white. They are averages over the sun's disc: the cosine is that of its middle.
#[derive(Clone, Debug)]
pub struct Rainbow {
    /// What meets the drop, radius by radius, angle by angle.
    refracted: Vec<Vec3>,
    /// What passes by and is diffracted.
    diffracted: Vec<Vec3>,
    radii: usize,
}

/// One wavelength.
struct Color {
    /// Metres.
    wavelength: f64,
    /// Index of refraction of water.
    ior: f64,
    /// Shares of it in red, green and blue.
    weight: DVec3,
}

/// A bow of one wavelength before diffraction: its energy is A / sqrt(t) at t radians from the caustic.
struct Bow {
    /// Radians from forward.
    place: f64,
    /// +1 where the lit side is that of greater angles.
    side: f64,
    /// A of each bin.
    amplitude: Vec<f64>,
    energy: f64,
    /// H. van de Hulst's h: the wave behind the drop is h u^3 / 3 a^2 ahead at u from the caustic ray.
    cubic: f64,
}

impl Rainbow {
    /// Makes the table; `spread` is the standard deviation of drops' radii as a share of each.
    pub fn build(spread: f64) -> Self {
        let colors = colors();
        let airy = Airy::new();
        let disc = Disc::new();
        let hats = hats();
        let (mut plain, mut bows) = (vec![DVec3::ZERO; BINS], Vec::new());
        for color in &colors {
            bows.push(color.ways(&mut plain));
        }
        let step = std::f64::consts::LN_10 / TO_TEN;
        let radii = ((RADII[1] / RADII[0]).ln() / step).round() as usize + 1;
        let one = |index: usize| {
            let radius = RADII[0] * (step * index as f64).exp();
            let (mut refracted, mut diffracted) = (plain.clone(), vec![DVec3::ZERO; BINS]);
            for (color, bows) in colors.iter().zip(&bows) {
                let size = TAU * radius / color.wavelength;
                for bow in bows {
                    bow.diffract(size, &airy, color.weight, &mut refracted);
                }
                diffract_forward(size, &airy, color.weight, &mut diffracted);
            }
            [refracted, diffracted].map(|energy| disc.smooth(&energy, &hats))
        };
        let tables: Vec<[Vec<DVec3>; 2]> = (0..radii).into_par_iter().map(one).collect();
        let mixed = |which: usize| {
            let row = |index: usize| mixed_sizes(&tables, which, index, spread / step);
            (0..radii).flat_map(row).collect()
        };
        Self { refracted: mixed(0), diffracted: mixed(1), radii }
    }

    /// Of light that meets a drop of `radius` (m) itself, reflected or refracted: for what stops light by its outline.
    /// `cosine` is between the ways before and after, 1 for light that goes on.
    #[inline]
    pub fn refracted(&self, radius: f32, cosine: f32) -> Vec3 {
        self.at(&self.refracted, radius, cosine)
    }

    /// Of all light that a drop of `radius` (m) takes out of a beam, twice its outline's: what meets it and as much that is
    /// diffracted, nearly all of it forward.
    #[inline]
    pub fn scattered(&self, radius: f32, cosine: f32) -> Vec3 {
        0.5 * (self.at(&self.refracted, radius, cosine) + self.at(&self.diffracted, radius, cosine))
    }

    fn at(&self, table: &[Vec3], radius: f32, cosine: f32) -> Vec3 {
        let row = ((f64::from(radius) / RADII[0]).log10() * TO_TEN).clamp(0.0, (self.radii - 1) as f64);
        let angle = f64::from(cosine.clamp(-1.0, 1.0)).acos();
        let bin = (angle / WIDTH - 0.5).clamp(0.0, (BINS - 1) as f64);
        let (r, b) = ((row as usize).min(self.radii - 2), (bin as usize).min(BINS - 2));
        let along = |r: usize| table[r * BINS + b].lerp(table[r * BINS + b + 1], (bin - b as f64) as f32);
        along(r).lerp(along(r + 1), (row - r as f64) as f32)
    }
}

/// Wavelengths of visible light with water's index and their colours.
fn colors() -> Vec<Color> {
    let [violet, red] = [0.4_f64, 0.7];
    // A. Cauchy's formula through 1.343 and 1.331: water at 20 degrees (G. Hale and M. Querry, Optical constants of water in
    // the 200-nm to 200-um wavelength region, 1973).
    let falling = (1.343 - 1.331) / (violet.powi(-2) - red.powi(-2));
    let least = 1.331 - falling * red.powi(-2);
    let mut colors: Vec<Color> = (0..COLORS)
        .map(|index| {
            let micrometres = violet + (red - violet) * (index as f64 + 0.5) / COLORS as f64;
            let ior = least + falling / micrometres.powi(2);
            Color { wavelength: 1e-6 * micrometres, ior, weight: rec709(1e3 * micrometres) }
        })
        .collect();
    let white: DVec3 = colors.iter().map(|color| color.weight).sum();
    for color in &mut colors {
        color.weight /= white;
    }
    colors
}

/// Linear Rec.709 of a wavelength (nm): the standard observer as sums of Gaussians (C. Wyman, P.-P. Sloan, P. Shirley,
/// Simple analytic approximations to the CIE XYZ color matching functions, 2013), then ITU-R BT.709's primaries.
fn rec709(wavelength: f64) -> DVec3 {
    let lobe = |middle: f64, below: f64, above: f64| {
        let t = (wavelength - middle) / if wavelength < middle { below } else { above };
        (-0.5 * t * t).exp()
    };
    let x = 1.056 * lobe(599.8, 37.9, 31.0) + 0.362 * lobe(442.0, 16.0, 26.7) - 0.065 * lobe(501.1, 20.4, 26.2);
    let y = 0.821 * lobe(568.8, 46.9, 40.5) + 0.286 * lobe(530.9, 16.3, 31.1);
    let z = 1.217 * lobe(437.0, 11.8, 36.0) + 0.681 * lobe(459.0, 26.0, 13.8);
    DVec3::new(
        3.2406 * x - 1.5372 * y - 0.4986 * z,
        -0.9689 * x + 1.8758 * y + 0.0415 * z,
        0.0557 * x - 0.2040 * y + 1.0570 * z,
    )
}

/// Solid angle (sr) of a bin.
fn solid_angle(bin: usize) -> f64 {
    let edge = |bin: usize| bin as f64 * WIDTH;
    // By products: the difference of cosines would lose its digits at both ends.
    2.0 * TAU * (0.5 * (edge(bin) + edge(bin + 1))).sin() * (0.5 * WIDTH).sin()
}

/// Adds energy to the bins between two angles, evenly.
fn deposit(bins: &mut [f64], [a, b]: [f64; 2], energy: f64) {
    let (low, high) = (a.min(b) / WIDTH, a.max(b) / WIDTH);
    let last = BINS - 1;
    let (first, end) = ((low as usize).min(last), (high as usize).min(last));
    if first == end {
        bins[first] += energy;
        return;
    }
    let per_bin = energy / (high - low);
    for (bin, to) in bins.iter_mut().enumerate().take(end + 1).skip(first) {
        *to += per_bin * (high.min(bin as f64 + 1.0) - low.max(bin as f64)).max(0.0);
    }
}

impl Color {
    /// Follows all ways through the drop: what makes no bow is added to `plain`; the first and the second bow come back.
    fn ways(&self, plain: &mut [DVec3]) -> [Bow; 2] {
        let mut energy = vec![vec![0.0; BINS]; WAYS as usize];
        let angles = |b: f64| (b.min(1.0).asin(), (b.min(1.0) / self.ior).asin());
        // Deflection of the ray that is inside p times: reflection outside is 0.
        let deflection = |p: u32, (outside, inside): (f64, f64)| {
            (f64::from(p) - 1.0) * PI + 2.0 * outside - 2.0 * f64::from(p) * inside
        };
        let folded = |angle: f64| {
            let turned = angle.rem_euclid(TAU);
            turned.min(TAU - turned)
        };
        for strip in 0..STRIPS {
            let edge = |strip: usize| strip as f64 / STRIPS as f64;
            let [near, middle, far] = [edge(strip), 0.5 * (edge(strip) + edge(strip + 1)), edge(strip + 1)].map(angles);
            let face = edge(strip + 1).powi(2) - edge(strip).powi(2);
            let (co, ci) = (middle.0.cos(), middle.1.cos());
            // Fresnel's reflectances across and along.
            let squared = |a: f64, b: f64| ((a - b) / (a + b)).powi(2);
            for reflectance in [squared(co, self.ior * ci), squared(self.ior * co, ci)] {
                let mut left = (1.0 - reflectance).powi(2);
                for p in 0..WAYS {
                    let share = if p == 0 { reflectance } else { left };
                    if p > 0 {
                        left *= reflectance;
                    }
                    let ends = [deflection(p, near), deflection(p, far)].map(folded);
                    deposit(&mut energy[p as usize], ends, 0.5 * share * face);
                }
            }
        }
        for (p, energy) in energy.iter().enumerate() {
            if p != 2 && p != 3 {
                for (to, energy) in plain.iter_mut().zip(energy) {
                    *to += self.weight * *energy;
                }
            }
        }
        [2, 3].map(|p| {
            let (n2, p2) = (self.ior * self.ior, f64::from(p * p));
            // R. Descartes: the ray of least deflection.
            let least = ((n2 - 1.0) / (p2 - 1.0)).sqrt().acos();
            let place = deflection(p, angles(least.sin()));
            let cubic = (p2 - 1.0).powi(2) / p2 * ((p2 - n2) / (n2 - 1.0).powi(3)).sqrt();
            let side = if place.rem_euclid(TAU) < PI { 1.0 } else { -1.0 };
            Bow::new(folded(place), side, &energy[p as usize], cubic)
        })
    }
}

impl Bow {
    fn new(place: f64, side: f64, energy: &[f64], cubic: f64) -> Self {
        let mut bow = Self { place, side, amplitude: vec![0.0; BINS], energy: energy.iter().sum(), cubic };
        for (bin, amplitude) in bow.amplitude.iter_mut().enumerate() {
            let [near, far] = sides(place, side, bin);
            if near >= 0.0 {
                *amplitude = energy[bin] / (2.0 * (far.sqrt() - near.sqrt()));
            }
        }
        // In the caustic's own bin and on the dark side there is no such law: the nearest that holds goes on.
        let caustic = (place / WIDTH) as usize;
        let next = bow.amplitude[if side > 0.0 { caustic + 1 } else { caustic - 1 }];
        for (bin, amplitude) in bow.amplitude.iter_mut().enumerate() {
            if sides(place, side, bin)[0] < 0.0 {
                *amplitude = next;
            }
        }
        bow
    }

    /// Adds its energy as a drop of this size (circumference in wavelengths) spreads it.
    ///
    /// A / sqrt(t) becomes 2 pi A sqrt(k) Ai^2(-k t) with k = (size^2 / h)^(1/3), which far on the lit side has its mean
    /// (H. van de Hulst, Light scattering by small particles, 1957, 13.2).
    fn diffract(&self, size: f64, airy: &Airy, weight: DVec3, to: &mut [DVec3]) {
        let k = (size * size / self.cubic).cbrt();
        let energy = |bin: usize| {
            let [near, far] = sides(self.place, self.side, bin);
            // Airy's function is nothing so far on the dark side.
            if -k * far > Airy::DARK {
                return 0.0;
            }
            self.amplitude[bin] * TAU / k.sqrt() * (airy.square_below(-k * near) - airy.square_below(-k * far))
        };
        let whole: f64 = (0..BINS).map(energy).sum();
        let scale = weight * (self.energy / whole);
        for (bin, to) in to.iter_mut().enumerate() {
            *to += scale * energy(bin);
        }
    }
}

/// Both ends of a bin, as radians on the lit side of a caustic; the nearer to the dark first.
fn sides(place: f64, side: f64, bin: usize) -> [f64; 2] {
    let ends = [bin, bin + 1].map(|edge| side * (edge as f64 * WIDTH - place));
    if side > 0.0 { ends } else { [ends[1], ends[0]] }
}

/// Adds the light that passes by a drop of this size: the share within a cone is 1 - J0^2 - J1^2 (Lord Rayleigh, 1881).
fn diffract_forward(size: f64, airy: &Airy, weight: DVec3, to: &mut [DVec3]) {
    let within = |edge: usize| airy.encircled(size * (edge as f64 * WIDTH).sin());
    let half = BINS / 2;
    let whole = within(half);
    let mut below = 0.0;
    for (bin, to) in to.iter_mut().enumerate().take(half) {
        let above = within(bin + 1);
        *to += weight * ((above - below) / whole);
        below = above;
    }
}

/// Integral over the sphere of the piecewise linear function that is 1 in the middle of a bin and 0 in that of all others.
fn hats() -> Vec<f64> {
    let mut hats = vec![0.0; BINS];
    let fine = 8;
    for step in 0..BINS * fine {
        let (a, b) = (step as f64 / fine as f64, (step + 1) as f64 / fine as f64);
        let middle = 0.5 * (a + b);
        let area = 2.0 * TAU * (middle * WIDTH).sin() * (0.5 * (b - a) * WIDTH).sin();
        let place = (middle - 0.5).clamp(0.0, (BINS - 1) as f64);
        let bin = (place as usize).min(BINS - 2);
        let share = place - bin as f64;
        hats[bin] += area * (1.0 - share);
        hats[bin + 1] += area * share;
    }
    hats
}

/// The sun's disc: how much of it is how many bins away from its middle.
struct Disc {
    /// For each bin, shares of the bins from three below to three above.
    share: Vec<[f64; 7]>,
}

impl Disc {
    fn new() -> Self {
        let (rings, turns) = (8, 24);
        let radius = f64::from(SUN_ANGULAR_RADIUS);
        let share = (0..BINS)
            .map(|bin| {
                let (sin, cos) = ((bin as f64 + 0.5) * WIDTH).sin_cos();
                let mut share = [0.0; 7];
                for point in 0..rings * turns {
                    let ring = ((f64::from(point / turns) + 0.5) / f64::from(rings)).sqrt() * radius;
                    let turn = (f64::from(point % turns) + 0.5) / f64::from(turns) * PI;
                    let angle = (cos * ring.cos() + sin * ring.sin() * turn.cos()).clamp(-1.0, 1.0).acos();
                    let away = (angle / WIDTH).floor() - bin as f64;
                    share[(away + 3.0).clamp(0.0, 6.0) as usize] += 1.0 / f64::from(rings * turns);
                }
                share
            })
            .collect();
        Self { share }
    }

    /// Energies of bins → densities as the whole disc gives them, 1 in all over the sphere. What Rec.709 cannot hold (it
    /// would be less than no red) becomes 0.
    fn smooth(&self, energy: &[DVec3], hats: &[f64]) -> Vec<DVec3> {
        let density: Vec<DVec3> = energy.iter().enumerate().map(|(bin, energy)| *energy / solid_angle(bin)).collect();
        let mut smooth: Vec<DVec3> = (0..BINS)
            .map(|bin| {
                let at = |away: usize| density[(bin + away).saturating_sub(3).min(BINS - 1)];
                let mean: DVec3 = self.share[bin].iter().enumerate().map(|(away, share)| at(away) * *share).sum();
                mean.max(DVec3::ZERO)
            })
            .collect();
        let whole: DVec3 = smooth.iter().zip(hats).map(|(value, hat)| *value * *hat).sum();
        for value in &mut smooth {
            *value /= whole;
        }
        smooth
    }
}

/// The table of radius `index` for drops whose radii scatter around it: a Gaussian of so many rows' deviation.
fn mixed_sizes(tables: &[[Vec<DVec3>; 2]], which: usize, index: usize, deviation: f64) -> Vec<Vec3> {
    let reach = (3.0 * deviation).ceil() as usize;
    let rows = index.saturating_sub(reach)..(index + reach + 1).min(tables.len());
    let weight = |row: usize| match row.abs_diff(index) {
        0 => 1.0,
        away => (-0.5 * (away as f64 / deviation).powi(2)).exp(),
    };
    let whole: f64 = rows.clone().map(weight).sum();
    let mut mixed = vec![DVec3::ZERO; BINS];
    for row in rows {
        let weight = weight(row) / whole;
        for (to, value) in mixed.iter_mut().zip(&tables[row][which]) {
            *to += *value * weight;
        }
    }
    mixed.into_iter().map(|value| value.as_vec3()).collect()
}

#[cfg(test)]
mod tests;
