//! What the accelerators' tests share: a surface of known answers, seeded scenes and rays.

use std::sync::Arc;

use glam::Vec3;

use super::{Geometry, RayBatch};
use crate::lower::{Discs, Spheres, Triangles};
use crate::surface::{LaneHits, LaneRays, LaneSurface, SolveCounts};

/// The plane y = 0 as a surface. Its hits tell what it was asked with: x of the origin as primitive, the tolerance as u,
/// its growth as v. A tolerance of [`Plane::DOUBT`] makes it give up.
#[derive(Debug, Default)]
pub(super) struct Plane {}

impl Plane {
    pub(super) const DOUBT: f32 = 1e6;
}

impl LaneSurface for Plane {
    fn bounds(&self) -> [Vec3; 2] {
        [Vec3::new(-1e6, 0.0, -1e6), Vec3::new(1e6, 0.0, 1e6)]
    }

    fn closest(&self, rays: &LaneRays, hits: &mut LaneHits, counts: &mut SolveCounts) {
        (hits.hit, hits.gave_up) = (0, 0);
        for lane in (0..16).filter(|lane| rays.active >> lane & 1 != 0) {
            counts.patches += 1;
            if rays.tolerance[lane] == Self::DOUBT {
                counts.gave_up += 1;
                hits.gave_up |= 1 << lane;
                continue;
            }
            let t = -rays.origin[1][lane] / rays.direction[1][lane];
            if t >= rays.tnear[lane] && t <= rays.tfar[lane] {
                hits.hit |= 1 << lane;
                hits.t[lane] = t;
                hits.primitive[lane] = rays.origin[0][lane] as u32;
                hits.u[lane] = rays.tolerance[lane];
                hits.v[lane] = rays.tolerance_growth;
                for (axis, component) in [0.0, 2.0, 0.0].into_iter().enumerate() {
                    hits.normal[axis][lane] = component;
                }
            }
        }
    }

    fn occluded(&self, rays: &LaneRays, counts: &mut SolveCounts) -> u16 {
        let mut hits = LaneHits::EMPTY;
        self.closest(rays, &mut hits, counts);
        hits.hit
    }

    fn bytes(&self) -> u64 {
        0
    }
}

/// Uniform numbers from a seed: a 64-bit linear congruential generator (Knuth's MMIX constants), its upper bits.
pub(super) struct Random(pub(super) u64);

impl Random {
    /// Uniform in 0..1.
    pub(super) fn unit(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 40) as f32 / (1_u64 << 24) as f32
    }

    /// Uniform in a cube of half-width `scale`.
    pub(super) fn vector(&mut self, scale: f32) -> Vec3 {
        let mut axis = || (self.unit() * 2.0 - 1.0) * scale;
        Vec3::new(axis(), axis(), axis())
    }
}

/// Spheres (part 0), discs (1), triangles (2) and the plane (3) within 10 m of the origin.
pub(super) fn random_scene(seed: u64) -> Vec<(u32, Geometry)> {
    let mut random = Random(seed);
    let count = 300;
    let center = |random: &mut Random| (0..count).map(|_| random.vector(10.0)).collect::<Vec<_>>();
    let radius = |random: &mut Random| (0..count).map(|_| 0.1 + random.unit()).collect::<Vec<_>>();
    let spheres = Spheres { center: center(&mut random), radius: radius(&mut random) };
    let normal = (0..count).map(|_| random.vector(1.0).normalize_or(Vec3::Y)).collect();
    let discs = Discs { center: center(&mut random), radius: radius(&mut random), normal: Some(normal) };
    let mut mesh = Triangles::default();
    for index in 0..count {
        let corner = random.vector(10.0);
        mesh.position.extend([corner, corner + random.vector(2.0), corner + random.vector(2.0)]);
        mesh.index.push([3 * index, 3 * index + 1, 3 * index + 2]);
    }
    vec![
        (0, Geometry::Spheres(Arc::new(spheres))),
        (1, Geometry::Discs(Arc::new(discs))),
        (2, Geometry::Triangles(Arc::new(mesh))),
        (3, Geometry::Lanes(Arc::new(Plane::default()))),
    ]
}

/// Rays from within 12 m of the origin into any direction, of lengths around 1; some end early.
pub(super) fn random_rays(count: usize, seed: u64) -> RayBatch {
    let mut random = Random(seed);
    let mut rays = RayBatch::default();
    for index in 0..count {
        let tfar = if index % 4 == 0 { 5.0 * random.unit() } else { f32::INFINITY };
        let (origin, direction) = (random.vector(12.0), random.vector(1.0));
        rays.push(origin, direction, 0.0, tfar, 1e-3);
    }
    rays
}
