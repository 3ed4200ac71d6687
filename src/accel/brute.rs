//! Everything against everything: the referee that other accelerators are measured by.
//!
//! Spheres, discs, curves and triangles are tested in double precision, one after the other; surfaces answer packets of sixteen
//! rays themselves. Hits follow Embree's conventions for u, v and normals ([`super::HitBatch`]).

use glam::DVec3;

use super::{AccelStats, Accelerator, Geometry, HitBatch, RayBatch, count_primitives};
use crate::math::RoundCone;
use crate::surface::{LANES, LaneHits, LaneRays, LaneSurface, SolveCounts};

/// No structure at all.
pub(super) struct Brute {
    geometry: Vec<(u32, Geometry)>,
}

/// One ray in double precision; `tfar` shrinks to the nearest hit.
struct Ray {
    origin: DVec3,
    direction: DVec3,
    tnear: f64,
    tfar: f64,
}

/// A hit on one primitive.
struct Hit {
    t: f64,
    u: f64,
    v: f64,
    normal: DVec3,
}

impl Brute {
    /// Takes geometry that [`super::check`] has passed.
    pub(super) fn new(geometry: Vec<(u32, Geometry)>) -> Self {
        Self { geometry }
    }
}

/// Whether ray `index` is one at all (see [`RayBatch`]).
pub(super) fn is_ray(rays: &RayBatch, index: usize) -> bool {
    let (tnear, tolerance) = (rays.tnear[index], rays.tolerance[index]);
    let interval = tnear >= 0.0 && tnear < rays.tfar[index];
    let direction = rays.direction(index);
    rays.origin(index).is_finite()
        && direction.is_finite()
        && direction != glam::Vec3::ZERO
        && interval
        && (0.0..f32::INFINITY).contains(&tolerance)
}

/// Rays `start..` as lanes, each ending at `tfar`.
fn lanes(rays: &RayBatch, start: usize, tfar: impl Fn(usize) -> f32) -> LaneRays {
    let mut packet = LaneRays { tolerance_growth: rays.tolerance_growth, ..LaneRays::EMPTY };
    for lane in 0..LANES.min(rays.len() - start) {
        let index = start + lane;
        if !is_ray(rays, index) {
            continue;
        }
        for axis in 0..3 {
            packet.origin[axis][lane] = rays.origin[axis][index];
            packet.direction[axis][lane] = rays.direction[axis][index];
        }
        packet.tnear[lane] = rays.tnear[index];
        packet.tfar[lane] = tfar(index);
        packet.tolerance[lane] = rays.tolerance[index];
        packet.active |= 1 << lane;
    }
    packet
}

fn surface_closest(
    surface: &dyn LaneSurface,
    part: u32,
    rays: &RayBatch,
    hits: &mut HitBatch,
    counts: &mut SolveCounts,
) {
    for start in (0..rays.len()).step_by(LANES) {
        let packet = lanes(rays, start, |index| rays.tfar[index].min(hits.t[index]));
        let mut found = LaneHits::EMPTY;
        surface.closest(&packet, &mut found, counts);
        for lane in (0..LANES).filter(|lane| packet.active >> lane & 1 != 0) {
            let index = start + lane;
            hits.gave_up[index] |= found.gave_up >> lane & 1 != 0;
            if found.hit >> lane & 1 != 0 {
                hits.t[index] = found.t[lane];
                hits.part[index] = part;
                hits.primitive[index] = found.primitive[lane];
                hits.u[index] = found.u[lane];
                hits.v[index] = found.v[lane];
                for axis in 0..3 {
                    hits.normal[axis][index] = found.normal[axis][lane];
                }
            }
        }
    }
}

/// The entry of a sphere, or its exit where the entry lies outside the interval.
fn sphere(ray: &Ray, center: DVec3, radius: f64) -> Option<Hit> {
    let to_center = center - ray.origin;
    let squared = ray.direction.length_squared();
    let middle = to_center.dot(ray.direction) / squared;
    // The distance from the line is taken at its nearest point: |c|^2 - (c.d)^2 would cancel for far origins.
    let miss = (to_center - middle * ray.direction).length_squared();
    let half = ((radius * radius - miss) / squared).sqrt(); // NaN for a miss, which no comparison below accepts.
    let inside = |t: f64| t >= ray.tnear && t <= ray.tfar;
    let t = [middle - half, middle + half].into_iter().find(|&t| radius > 0.0 && inside(t))?;
    Some(Hit { t, u: 0.0, v: 0.0, normal: t * ray.direction - to_center })
}

fn disc(ray: &Ray, center: DVec3, radius: f64, normal: DVec3) -> Option<Hit> {
    let t = (center - ray.origin).dot(normal) / ray.direction.dot(normal);
    let away = ray.origin + t * ray.direction - center;
    (radius > 0.0 && t >= ray.tnear && t <= ray.tfar && away.length_squared() <= radius * radius).then_some(Hit {
        t,
        u: 0.0,
        v: 0.0,
        normal,
    })
}

/// A disc square to the line from the ray's origin to its centre, unless the origin is within its ball.
fn facing(ray: &Ray, center: DVec3, radius: f64) -> Option<Hit> {
    let normal = ray.origin - center;
    if normal.length_squared() > radius * radius { disc(ray, center, radius, normal) } else { None }
}

fn curve(ray: &Ray, cone: &RoundCone) -> Option<Hit> {
    let hit = cone.crossing(ray.origin, ray.direction, [ray.tnear, ray.tfar])?;
    Some(Hit { t: hit.t, u: hit.along, v: 0.0, normal: hit.normal })
}

/// Möller and Trumbore, Fast, minimum storage ray/triangle intersection, 1997.
fn triangle(ray: &Ray, corners: [DVec3; 3]) -> Option<Hit> {
    let (first, second) = (corners[1] - corners[0], corners[2] - corners[0]);
    let across = ray.direction.cross(second);
    let determinant = first.dot(across);
    let from_corner = ray.origin - corners[0];
    let u = from_corner.dot(across) / determinant;
    let turned = from_corner.cross(first);
    let v = ray.direction.dot(turned) / determinant;
    let t = second.dot(turned) / determinant;
    // A zero determinant makes them infinite or NaN, which fails one of these.
    (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t >= ray.tnear && t <= ray.tfar).then(|| Hit {
        t,
        u,
        v,
        normal: first.cross(second),
    })
}

/// Calls `found` with each nearer hit than the last; stops when it says so.
fn visit(geometry: &Geometry, ray: &mut Ray, mut found: impl FnMut(usize, &Hit) -> bool) {
    let mut offer = |ray: &mut Ray, index: usize, hit: Option<Hit>| {
        let Some(hit) = hit else { return false };
        ray.tfar = hit.t;
        found(index, &hit)
    };
    match geometry {
        Geometry::Lanes(_) => {}
        Geometry::Spheres(spheres) => {
            for (index, (center, &radius)) in spheres.center.iter().zip(&spheres.radius).enumerate() {
                let hit = sphere(ray, center.as_dvec3(), radius.into());
                if offer(ray, index, hit) {
                    return;
                }
            }
        }
        Geometry::Discs(discs) => {
            for (index, (center, &radius)) in discs.center.iter().zip(&discs.radius).enumerate() {
                let (center, radius) = (center.as_dvec3(), radius.into());
                let hit = match &discs.normal {
                    Some(normal) => disc(ray, center, radius, normal[index].as_dvec3()),
                    None => facing(ray, center, radius),
                };
                if offer(ray, index, hit) {
                    return;
                }
            }
        }
        Geometry::Curves(curves) => {
            for index in (0..curves.ends.len()).filter(|&index| curves.is_sound(index)) {
                let hit = curve(ray, &curves.cone(index));
                if offer(ray, index, hit) {
                    return;
                }
            }
        }
        Geometry::Triangles(mesh) => {
            for (index, corners) in mesh.index.iter().enumerate() {
                let hit = triangle(ray, corners.map(|corner| mesh.position[corner as usize].as_dvec3()));
                if offer(ray, index, hit) {
                    return;
                }
            }
        }
    }
}

fn ray(rays: &RayBatch, index: usize, tfar: f32) -> Ray {
    Ray {
        origin: rays.origin(index).as_dvec3(),
        direction: rays.direction(index).as_dvec3(),
        tnear: rays.tnear[index].into(),
        tfar: tfar.into(),
    }
}

impl Accelerator for Brute {
    fn closest(&self, rays: &RayBatch, hits: &mut HitBatch, counts: &mut SolveCounts) {
        hits.reset(rays.len());
        for (part, geometry) in &self.geometry {
            if let Geometry::Lanes(surface) = geometry {
                surface_closest(surface.as_ref(), *part, rays, hits, counts);
                continue;
            }
            for index in (0..rays.len()).filter(|&index| is_ray(rays, index)) {
                let mut ray = ray(rays, index, rays.tfar[index].min(hits.t[index]));
                visit(geometry, &mut ray, |primitive, hit| {
                    hits.t[index] = hit.t as f32;
                    hits.part[index] = *part;
                    hits.primitive[index] = primitive as u32;
                    hits.u[index] = hit.u as f32;
                    hits.v[index] = hit.v as f32;
                    for axis in 0..3 {
                        hits.normal[axis][index] = hit.normal[axis] as f32;
                    }
                    false
                });
            }
        }
    }

    fn occluded(&self, rays: &RayBatch, occluded: &mut Vec<bool>, counts: &mut SolveCounts) {
        occluded.clear();
        occluded.resize(rays.len(), false);
        for (_, geometry) in &self.geometry {
            if let Geometry::Lanes(surface) = geometry {
                for start in (0..rays.len()).step_by(LANES) {
                    let packet = lanes(rays, start, |index| rays.tfar[index]);
                    let hit = surface.occluded(&packet, counts) & packet.active;
                    for lane in (0..LANES).filter(|lane| hit >> lane & 1 != 0) {
                        occluded[start + lane] = true;
                    }
                }
                continue;
            }
            for index in (0..rays.len()).filter(|&index| is_ray(rays, index)) {
                let mut ray = ray(rays, index, rays.tfar[index]);
                visit(geometry, &mut ray, |_, _| {
                    occluded[index] = true;
                    true
                });
            }
        }
    }

    fn stats(&self) -> AccelStats {
        AccelStats {
            name: "brute".to_owned(),
            build_seconds: 0.0,
            bytes: 0,
            primitives: count_primitives(&self.geometry),
        }
    }
}
