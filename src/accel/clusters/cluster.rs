//! Up to sixteen spheres, discs or curves, one array per field, and the test of rays against them.
//!
//! The test is one expression for both ways of asking: one ray against particles in lanes, or one particle against rays in
//! lanes. So both find the same bits. Hits follow Embree's conventions, as everywhere ([`super::super::HitBatch`]).

use glam::Vec3;

use super::WIDTH;
use super::build::Record;
use crate::simd::Simd;

/// A ray per lane, or one in all of them, its direction's length near one.
#[derive(Clone, Copy)]
pub(super) struct Rays<S: Simd> {
    pub(super) origin: [S::F; 3],
    pub(super) direction: [S::F; 3],
    /// One over the square of the direction's length.
    pub(super) inverse_squared: S::F,
    pub(super) tnear: S::F,
}

/// Particles of one kind.
pub(super) trait Cluster: Copy + Send + Sync + 'static {
    /// No particles.
    const EMPTY: Self;
    /// A ray's hits on the particles from `from` on: which, and where.
    fn hits<S: Simd>(&self, s: S, from: usize, ray: &Rays<S>) -> (S::M, S::F);
    /// The rays' hits on one particle: which, and where.
    fn hits_on<S: Simd>(&self, s: S, slot: usize, rays: &Rays<S>) -> (S::M, S::F);
    /// Centres of balls around the particles.
    fn center(&self) -> &[[f32; WIDTH]; 3];
    /// Radii of these balls.
    fn radius(&self) -> &[f32; WIDTH];
    /// A particle's number in the scene's arrays.
    fn number(&self, slot: usize) -> u32;
    /// Geometric normal at a hit, not normalised.
    fn normal(&self, slot: usize, origin: Vec3, direction: Vec3, t: f32) -> Vec3;
    /// First surface coordinate of a hit.
    fn along(&self, _slot: usize, _origin: Vec3, _direction: Vec3, _t: f32) -> f32 {
        0.0
    }
}

/// Spheres.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(super) struct SphereCluster {
    center: [[f32; WIDTH]; 3],
    radius: [f32; WIDTH],
    number: [u32; WIDTH],
}

/// Discs that face each ray's origin, kept as the balls that hold them.
#[derive(Clone, Copy, Debug)]
#[repr(transparent)]
pub(super) struct FacingCluster(pub(super) SphereCluster);

/// Oriented discs.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(super) struct DiscCluster {
    center: [[f32; WIDTH]; 3],
    radius: [f32; WIDTH],
    normal: [[f32; WIDTH]; 3],
    number: [u32; WIDTH],
}

#[inline(always)]
pub(super) fn dot<S: Simd>(s: S, a: [S::F; 3], b: [S::F; 3]) -> S::F {
    s.fma(a[0], b[0], s.fma(a[1], b[1], a[2] * b[2]))
}

#[inline(always)]
pub(super) fn less<S: Simd>(a: [S::F; 3], b: [S::F; 3]) -> [S::F; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// The entry, or the exit where the entry lies before the interval.
#[inline(always)]
fn sphere<S: Simd>(s: S, center: [S::F; 3], radius: S::F, rays: &Rays<S>) -> (S::M, S::F) {
    let zero = s.splat(0.0);
    let to_center = less::<S>(center, rays.origin);
    let middle = dot(s, to_center, rays.direction) * rays.inverse_squared;
    // The distance from the line is taken at its nearest point: |c|^2 - (c.d)^2 would cancel for far origins.
    let back = zero - middle;
    let away = [
        s.fma(rays.direction[0], back, to_center[0]),
        s.fma(rays.direction[1], back, to_center[1]),
        s.fma(rays.direction[2], back, to_center[2]),
    ];
    let miss = dot(s, away, away);
    let squared = radius * radius;
    let hit = s.le(miss, squared);
    if s.none(hit) {
        return (hit, zero);
    }
    let half = s.sqrt((squared - miss) * rays.inverse_squared);
    let (entry, exit) = (middle - half, middle + half);
    let t = s.select(s.le(rays.tnear, entry), entry, exit);
    (hit & s.le(rays.tnear, t), t)
}

#[inline(always)]
fn disc<S: Simd>(s: S, center: [S::F; 3], radius: S::F, normal: [S::F; 3], rays: &Rays<S>) -> (S::M, S::F) {
    let to_center = less::<S>(center, rays.origin);
    // A ray within the plane makes it infinite or NaN, and then the distance from the centre NaN, which no comparison accepts.
    let t = dot(s, to_center, normal) / dot(s, rays.direction, normal);
    let away = [
        rays.direction[0] * t - to_center[0],
        rays.direction[1] * t - to_center[1],
        rays.direction[2] * t - to_center[2],
    ];
    (s.le(dot(s, away, away), radius * radius) & s.le(rays.tnear, t), t)
}

/// A disc square to the line from the ray's origin to its centre. Origins within the ball do not meet it: one on the disc
/// itself, from which a ray is sent on, is within.
#[inline(always)]
fn facing<S: Simd>(s: S, center: [S::F; 3], radius: S::F, rays: &Rays<S>) -> (S::M, S::F) {
    let to_center = less::<S>(center, rays.origin);
    let squared = dot(s, to_center, to_center);
    // A ray square to the line makes it infinite, and the distance from the centre as well; one that goes away, negative.
    let t = squared / dot(s, rays.direction, to_center);
    let away = [
        rays.direction[0] * t - to_center[0],
        rays.direction[1] * t - to_center[1],
        rays.direction[2] * t - to_center[2],
    ];
    let within = radius * radius;
    (s.le(dot(s, away, away), within) & s.lt(within, squared) & s.le(rays.tnear, t), t)
}

/// Vectors of the particles (or rays) from `from` on.
#[inline(always)]
pub(super) fn loaded<S: Simd>(s: S, axes: &[[f32; WIDTH]; 3], from: usize) -> [S::F; 3] {
    [s.load(&axes[0][from..]), s.load(&axes[1][from..]), s.load(&axes[2][from..])]
}

/// One particle's (or ray's) vector in every lane.
#[inline(always)]
pub(super) fn splat<S: Simd>(s: S, axes: &[[f32; WIDTH]; 3], slot: usize) -> [S::F; 3] {
    [s.splat(axes[0][slot]), s.splat(axes[1][slot]), s.splat(axes[2][slot])]
}

impl SphereCluster {
    pub(super) fn put(&mut self, slot: usize, record: &Record) {
        for axis in 0..3 {
            self.center[axis][slot] = record.center[axis];
        }
        self.radius[slot] = record.radius;
        self.number[slot] = record.number;
    }
}

impl DiscCluster {
    pub(super) fn put(&mut self, slot: usize, record: &Record, normal: Vec3) {
        for axis in 0..3 {
            self.center[axis][slot] = record.center[axis];
            self.normal[axis][slot] = normal[axis];
        }
        self.radius[slot] = record.radius;
        self.number[slot] = record.number;
    }
}

impl Cluster for SphereCluster {
    // A radius that is not a number is never reached.
    const EMPTY: Self = Self { center: [[0.0; WIDTH]; 3], radius: [f32::NAN; WIDTH], number: [0; WIDTH] };

    #[inline(always)]
    fn hits<S: Simd>(&self, s: S, from: usize, ray: &Rays<S>) -> (S::M, S::F) {
        sphere(s, loaded(s, &self.center, from), s.load(&self.radius[from..]), ray)
    }
    #[inline(always)]
    fn hits_on<S: Simd>(&self, s: S, slot: usize, rays: &Rays<S>) -> (S::M, S::F) {
        sphere(s, splat(s, &self.center, slot), s.splat(self.radius[slot]), rays)
    }
    #[inline(always)]
    fn center(&self) -> &[[f32; WIDTH]; 3] {
        &self.center
    }
    #[inline(always)]
    fn radius(&self) -> &[f32; WIDTH] {
        &self.radius
    }
    #[inline(always)]
    fn number(&self, slot: usize) -> u32 {
        self.number[slot]
    }
    fn normal(&self, slot: usize, origin: Vec3, direction: Vec3, t: f32) -> Vec3 {
        // From the centre rather than from the hit's place, which would lose its last bits far from zero.
        t * direction - (Vec3::from(self.center.each_ref().map(|axis| axis[slot])) - origin)
    }
}

impl Cluster for FacingCluster {
    const EMPTY: Self = Self(SphereCluster::EMPTY);

    #[inline(always)]
    fn hits<S: Simd>(&self, s: S, from: usize, ray: &Rays<S>) -> (S::M, S::F) {
        facing(s, loaded(s, &self.0.center, from), s.load(&self.0.radius[from..]), ray)
    }
    #[inline(always)]
    fn hits_on<S: Simd>(&self, s: S, slot: usize, rays: &Rays<S>) -> (S::M, S::F) {
        facing(s, splat(s, &self.0.center, slot), s.splat(self.0.radius[slot]), rays)
    }
    #[inline(always)]
    fn center(&self) -> &[[f32; WIDTH]; 3] {
        &self.0.center
    }
    #[inline(always)]
    fn radius(&self) -> &[f32; WIDTH] {
        &self.0.radius
    }
    #[inline(always)]
    fn number(&self, slot: usize) -> u32 {
        self.0.number[slot]
    }
    fn normal(&self, slot: usize, origin: Vec3, _direction: Vec3, _t: f32) -> Vec3 {
        origin - Vec3::from(self.0.center.each_ref().map(|axis| axis[slot]))
    }
}

impl Cluster for DiscCluster {
    const EMPTY: Self =
        Self { center: [[0.0; WIDTH]; 3], radius: [f32::NAN; WIDTH], normal: [[0.0; WIDTH]; 3], number: [0; WIDTH] };

    #[inline(always)]
    fn hits<S: Simd>(&self, s: S, from: usize, ray: &Rays<S>) -> (S::M, S::F) {
        disc(s, loaded(s, &self.center, from), s.load(&self.radius[from..]), loaded(s, &self.normal, from), ray)
    }
    #[inline(always)]
    fn hits_on<S: Simd>(&self, s: S, slot: usize, rays: &Rays<S>) -> (S::M, S::F) {
        disc(s, splat(s, &self.center, slot), s.splat(self.radius[slot]), splat(s, &self.normal, slot), rays)
    }
    #[inline(always)]
    fn center(&self) -> &[[f32; WIDTH]; 3] {
        &self.center
    }
    #[inline(always)]
    fn radius(&self) -> &[f32; WIDTH] {
        &self.radius
    }
    #[inline(always)]
    fn number(&self, slot: usize) -> u32 {
        self.number[slot]
    }
    fn normal(&self, slot: usize, _origin: Vec3, _direction: Vec3, _t: f32) -> Vec3 {
        Vec3::from(self.normal.each_ref().map(|axis| axis[slot]))
    }
}
