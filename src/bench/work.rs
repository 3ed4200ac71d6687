//! The measured work: a surface and classes of rays over it, the same for every rival.
//!
//! Lengths are columns of width 1, heights are above the wave field's mean, ray components are single precision, the
//! generator is seeded.

use std::f64::consts::TAU;

use glam::{DVec3, Vec3};

use crate::accel::RayBatch;
use crate::math::{STEP, scramble};
use crate::surface::{Lattice, LatticeError, SplineSurface};

/// A seeded stream of numbers (SplitMix64; Steele, Lea and Flood 2014).
#[derive(Clone, Debug)]
pub struct Random(u64);

impl Random {
    /// A stream of its own for each seed.
    pub fn new(seed: u64) -> Self {
        Self(seed)
    }
    /// Uniform in 0..1.
    pub fn unit(&mut self) -> f64 {
        let bits = scramble(self.0);
        self.0 = self.0.wrapping_add(STEP);
        (bits >> 11) as f64 / (1u64 << 53) as f64
    }
    /// Uniform between two values.
    pub fn within(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }
    /// Uniform on the unit sphere.
    pub fn direction(&mut self) -> DVec3 {
        let (y, turn) = (self.within(-1.0, 1.0), self.within(0.0, TAU));
        let r = (1.0 - y * y).sqrt();
        DVec3::new(r * turn.cos(), y, r * turn.sin())
    }
}

/// Wavy, noisy water over `size` columns of width 1; the domain is [0, nx] x [0, nz].
///
/// # Errors
/// The order is not 2, 3 or 4.
pub fn surface(size: [usize; 2], order: u32) -> Result<Lattice, LatticeError> {
    Lattice::new(order, size, [0.5, 0.5], [1.0, 1.0], &heights(size), |_| true)
}

/// Its heights, row by row.
pub fn heights(size: [usize; 2]) -> Vec<f64> {
    let mut random = Random::new(1);
    let wave =
        |x: f64, z: f64, kx: f64, kz: f64, length: f64, phase: f64| (TAU * (kx * x + kz * z) / length + phase).sin();
    (0..size[0] * size[1])
        .map(|k| {
            let (x, z) = ((k % size[0]) as f64 + 0.5, (k / size[0]) as f64 + 0.5);
            3.0 * wave(x, z, 0.8, 0.6, 100.0, 0.0)
                + 1.5 * wave(x, z, 0.3, -0.95, 37.0, 1.0)
                + 0.5 * wave(x, z, 0.9, -0.43, 13.0, 2.0)
                + 0.25 * wave(x, z, 0.1, 1.0, 7.0, 0.0)
                + random.within(-0.3, 0.3)
        })
        .collect()
}

/// A class of rays.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RayClass {
    /// A camera's, 1920x1080, in tiles of 4x4 pixels.
    Primary,
    /// Uniform directions from near the surface.
    Incoherent,
    /// Along the surface: near tangent planes, and from crest height.
    Grazing,
    /// The incoherent rays, any hit.
    Occlusion,
    /// From a regular grid of surface points towards a low sun, any hit.
    Sun,
}

impl RayClass {
    /// Every class, in the table's order.
    pub const ALL: [Self; 5] = [Self::Primary, Self::Incoherent, Self::Grazing, Self::Occlusion, Self::Sun];

    /// Name in tables and files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Primary => "primary",
            Self::Incoherent => "incoherent",
            Self::Grazing => "grazing",
            Self::Occlusion => "occlusion",
            Self::Sun => "sun",
        }
    }

    /// Whether any hit answers it.
    pub fn any_hit(self) -> bool {
        matches!(self, Self::Occlusion | Self::Sun)
    }
}

/// The rays of a class over the surface, `share` of the full count (0..1].
pub fn rays(class: RayClass, surface: &SplineSurface, share: f64) -> RayBatch {
    more_rays(class, surface, share, 0)
}

/// As [`rays`]; every `turn` after 0 draws others of the same class: pixels and grids are then shifted at random.
pub fn more_rays(class: RayClass, surface: &SplineSurface, share: f64, turn: u64) -> RayBatch {
    let size = surface.lattice().cells.map(|n| n as f64);
    let mut batch = RayBatch::default();
    let mut push = |origin: DVec3, direction: DVec3| {
        batch.push(origin.as_vec3(), direction.as_vec3(), 0.0, f32::INFINITY, 1e-6);
    };
    let count = |full: f64| (full * share).ceil() as usize;
    let seed = |own: u64| own + 1000 * turn;
    let mut shift = Random::new(seed(4));
    let mut shift = || if turn == 0 { 0.5 } else { shift.unit() };
    match class {
        RayClass::Primary => primary(size, share, &mut shift, push),
        RayClass::Incoherent | RayClass::Occlusion => {
            let mut random = Random::new(seed(2));
            for k in 0..count(1e6) {
                let (point, _) = on_surface(surface, &mut random);
                let lift = 0.2 + 15.0 * random.unit().powi(2);
                push(point + DVec3::Y * if k % 2 == 0 { lift } else { -lift }, random.direction());
            }
        }
        RayClass::Grazing => grazing(surface, size, count(5e5), seed(3), push),
        RayClass::Sun => {
            let towards =
                DVec3::new(12f64.to_radians().cos() * 0.8, 12f64.to_radians().sin(), 12f64.to_radians().cos() * 0.6);
            let side = count(1e6).isqrt().max(1);
            for k in 0..side * side {
                let mut place = |k: usize, size: f64| (k as f64 + shift()) / side as f64 * size;
                let (x, z) = (place(k % side, size[0]), place(k / side, size[1]));
                if let Some((y, _)) = surface.point(x, z) {
                    push(DVec3::new(x, y + 2e-3, z), towards);
                }
            }
        }
    }
    batch
}

/// A uniform point of the surface and its unit normal.
fn on_surface(surface: &SplineSurface, random: &mut Random) -> (DVec3, DVec3) {
    let size = surface.lattice().domain[1].map(|far| far - surface.lattice().domain[0][0]);
    loop {
        let (x, z) = (random.within(0.0, size[0]), random.within(0.0, size[1]));
        if let Some((y, slope)) = surface.point(x, z) {
            return (DVec3::new(x, y, z), DVec3::new(-slope[0], 1.0, -slope[1]).normalize());
        }
    }
}

/// Where the camera stands over a map of that size.
pub fn eye(size: [f64; 2]) -> DVec3 {
    let least = size[0].min(size[1]);
    DVec3::new(size[0] / 2.0, least / 4.0 + 5.0, -least / 5.0)
}

/// The rays of [`RayClass::Primary`], which need no surface.
pub fn camera_rays(size: [f64; 2], share: f64) -> RayBatch {
    let mut batch = RayBatch::default();
    primary(size, share, &mut || 0.5, |origin, direction| {
        batch.push(origin.as_vec3(), direction.as_vec3(), 0.0, f32::INFINITY, 1e-6);
    });
    batch
}

fn primary(size: [f64; 2], share: f64, shift: &mut dyn FnMut() -> f64, mut push: impl FnMut(DVec3, DVec3)) {
    let eye = eye(size);
    let forward = (DVec3::new(size[0] / 2.0, 0.0, size[1] / 2.0) - eye).normalize();
    let right = forward.cross(DVec3::Y).normalize();
    let up = right.cross(forward);
    // A share of the picture keeps the view and the tiles, with fewer pixels.
    let scale = share.sqrt();
    let side = |full: f64| ((full * scale / 4.0).round() as usize).max(1) * 4;
    let (width, height) = (side(1920.0), side(1080.0));
    let tangent = 25f64.to_radians().tan();
    for tile in 0..width / 4 * (height / 4) {
        let (left, top) = (tile % (width / 4) * 4, tile / (width / 4) * 4);
        for pixel in 0..16 {
            let (px, py) = ((left + pixel % 4) as f64 + shift(), (top + pixel / 4) as f64 + shift());
            let across = (2.0 * px / width as f64 - 1.0) * tangent * width as f64 / height as f64;
            let down = (2.0 * py / height as f64 - 1.0) * tangent;
            push(eye, (forward + right * across - up * down).normalize());
        }
    }
}

/// Half within +-2e-3 of tangent planes, 20 columns before the contact; half from near the highest point at slopes of
/// 0 to -0.03.
fn grazing(surface: &SplineSurface, size: [f64; 2], count: usize, seed: u64, mut push: impl FnMut(DVec3, DVec3)) {
    let mut random = Random::new(seed);
    let highest = (0..200_000)
        .map(|_| on_surface(surface, &mut random).0)
        .max_by(|a, b| a.y.total_cmp(&b.y))
        .unwrap_or(DVec3::ZERO);
    for k in 0..count {
        if k % 2 == 0 {
            let (point, normal) = on_surface(surface, &mut random);
            let along = random.direction().cross(normal).normalize();
            push(point - along * 20.0 + normal * random.within(-2e-3, 2e-3), along);
        } else {
            let turn = random.within(0.0, TAU);
            let origin = DVec3::new(
                random.within(0.0, size[0]),
                highest.y + random.within(-0.5, 0.1),
                random.within(0.0, size[1]),
            );
            push(origin, DVec3::new(turn.cos(), -0.03 * random.unit(), turn.sin()).normalize());
        }
    }
}

/// Rays that aim to slip through: plumb and slanted, through borders and corners of columns, from both sides.
pub fn border_rays(size: [usize; 2], count: usize, seed: u64) -> Vec<(Vec3, Vec3)> {
    let mut random = Random::new(seed);
    (0..count)
        .map(|k| {
            let mut x = random.within(1.0, size[0] as f64 - 1.0);
            let mut z = random.within(1.0, size[1] as f64 - 1.0);
            // Columns' corners lie at whole numbers, their centres (corners of order 2 and 4) at halves.
            let snap = |value: f64, half: bool| if half { value.floor() + 0.5 } else { value.floor() };
            match k % 3 {
                0 => (x, z) = (snap(x, k % 2 == 0), snap(z, k % 2 == 0)),
                1 => x = snap(x, k % 2 == 0),
                _ => z = snap(z, k % 2 == 0),
            }
            let down = if k % 4 < 2 { -1.0 } else { 1.0 };
            let lean = match k % 8 {
                0 | 2 => DVec3::ZERO,
                1 => DVec3::X,
                3 => DVec3::Z * 0.5,
                _ => DVec3::new(random.within(-2.0, 2.0), 0.0, random.within(-2.0, 2.0)),
            };
            let direction = DVec3::new(lean.x, down, lean.z);
            let target = DVec3::new(x, 0.0, z);
            // All waves lie within 6 of the mean: start from 8 above or below, so that the ray must cross.
            ((target - direction * 8.0).as_vec3(), direction.as_vec3())
        })
        .collect()
}
