//! Embree behind the seam: parts become geometry whose identity is the part's index, batches become packets of 16.
//!
//! Packets always go through rtcIntersect16/rtcOccluded16 (8 or 4 wide on narrower processors), the last one masked, so
//! that a ray's bits do not depend on how many rays came with it. Spheres (front hit, else the back one) and discs are
//! held in clusters of our own, one user primitive per part; Embree's own points are there for benchmarks.

use std::sync::Arc;
use std::time::Instant;

use glam::Vec3;

use super::clusters;
use super::lanes::{IDENTITY, LaneGeometry, LanePayload};
use super::order::Slab;
use super::{AccelError, AccelStats, Accelerator, Geometry, HitBatch, NO_PART, RayBatch, count_primitives};
use crate::ffi::embree::{
    CommittedScene, Device, INVALID_GEOMETRY, Ray, Ray16, RayHit, RayHit16, SceneBuilder, Valid16,
};
use crate::simd::SimdLevel;
use crate::surface::{LANES, SolveCounts};

// A miss needs no translation.
const _: () = assert!(NO_PART == INVALID_GEOMETRY);

/// Who holds spheres and discs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Particles {
    /// Clusters of sixteen, as user geometry.
    Clusters,
    /// Embree.
    Points,
}

/// An Embree scene over parts.
pub struct EmbreeAccel {
    scene: CommittedScene<LanePayload>,
    device: Device,
    build_seconds: f64,
    /// Held by user geometry: surfaces and clusters.
    own_bytes: u64,
    /// The surfaces' common slab, if there are any: rays over it are ordered by their run.
    slab: Option<Slab>,
    primitives: Vec<(String, u64)>,
}

impl std::fmt::Debug for EmbreeAccel {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.debug_struct("EmbreeAccel").field("primitives", &self.primitives).finish_non_exhaustive()
    }
}

impl EmbreeAccel {
    /// Builds over geometry, each with the index that its hits carry as their part.
    ///
    /// Uses as many threads as the current rayon pool has. Spheres, discs and triangles are copied; surfaces are shared.
    ///
    /// # Errors
    /// Embree is missing or unsuitable, geometry has an index out of range, or memory ran out.
    pub fn new(geometry: &[(u32, Geometry)]) -> Result<Self, AccelError> {
        Self::with_settings(geometry, Particles::Clusters, rayon::current_num_threads(), "")
    }

    /// As [`EmbreeAccel::new`], with spheres and discs as Embree's own points: a rival of benchmarks. Its packets and its
    /// single rays differ in the last bits of t.
    ///
    /// # Errors
    /// As [`EmbreeAccel::new`].
    pub fn with_points(geometry: &[(u32, Geometry)]) -> Result<Self, AccelError> {
        Self::with_settings(geometry, Particles::Points, rayon::current_num_threads(), "")
    }

    fn with_settings(
        geometry: &[(u32, Geometry)],
        particles: Particles,
        threads: usize,
        settings: &str,
    ) -> Result<Self, AccelError> {
        let start = Instant::now();
        super::check(geometry)?;
        let device = Device::new(threads, settings)?;
        let mut builder = SceneBuilder::new(&device)?;
        let simd = SimdLevel::detect();
        let mut own_bytes = 0;
        let mut corners: Option<[Vec3; 2]> = None;
        for (part, geometry) in geometry {
            match geometry {
                Geometry::Lanes(surface) => {
                    own_bytes += surface.bytes();
                    let [low, high] = surface.bounds();
                    corners = Some(corners.map_or([low, high], |[l, h]| [l.min(low), h.max(high)]));
                    builder.user(*part, Arc::new(LaneGeometry(Arc::clone(surface))))?;
                }
                Geometry::Spheres(spheres) if particles == Particles::Points => {
                    builder.spheres(*part, &spheres.center, &spheres.radius)?;
                }
                Geometry::Discs(discs) if particles == Particles::Points => {
                    builder.discs(*part, &discs.center, &discs.radius, &discs.normal)?;
                }
                Geometry::Spheres(spheres) => {
                    let cloud = clusters::of_spheres(spheres, simd);
                    own_bytes += cloud.bytes();
                    builder.user(*part, Arc::new(LaneGeometry(cloud)))?;
                }
                Geometry::Discs(discs) => {
                    let cloud = clusters::of_discs(discs, simd);
                    own_bytes += cloud.bytes();
                    builder.user(*part, Arc::new(LaneGeometry(cloud)))?;
                }
                Geometry::Triangles(mesh) => builder.triangles(*part, &mesh.position, &mesh.index)?,
            }
        }
        let scene = builder.commit()?;
        let slab = corners.and_then(|[low, high]| Slab::new(low, high));
        let primitives = count_primitives(geometry);
        Ok(Self { scene, device, build_seconds: start.elapsed().as_secs_f64(), own_bytes, slab, primitives })
    }

    /// As [`Accelerator::closest`], but one ray at a time through rtcIntersect1: the baseline of benchmarks, not for
    /// pictures (triangles may differ from packets in the last bits).
    pub fn closest_single(&self, rays: &RayBatch, hits: &mut HitBatch, counts: &mut SolveCounts) {
        hits.reset(rays.len());
        let mut payload = LanePayload { tolerance_growth: rays.tolerance_growth, ..LanePayload::EMPTY };
        let mut packet = Packet::EMPTY;
        for index in 0..rays.len() {
            if index % LANES == 0 {
                packet.load(rays, None, index);
            }
            let lane = index % LANES;
            if packet.valid.0[lane] == 0 {
                continue;
            }
            payload.tolerance[0] = rays.tolerance[index];
            payload.gave_up = 0;
            let mut single = RayHit::default();
            let (origin, direction) = (rays.origin(index), rays.direction(index));
            [single.ray.org_x, single.ray.org_y, single.ray.org_z] = origin.to_array();
            [single.ray.dir_x, single.ray.dir_y, single.ray.dir_z] = direction.to_array();
            single.ray.tnear = rays.tnear[index];
            single.ray.tfar = rays.tfar[index];
            single.ray.mask = u32::MAX;
            single.hit.geomID = INVALID_GEOMETRY;
            self.scene.intersect1(&mut single, &mut payload);
            hits.gave_up[index] = payload.gave_up != 0;
            if single.hit.geomID != INVALID_GEOMETRY {
                hits.t[index] = single.ray.tfar;
                hits.part[index] = single.hit.geomID;
                hits.primitive[index] = single.hit.primID;
                hits.u[index] = single.hit.u;
                hits.v[index] = single.hit.v;
                hits.normal[0][index] = single.hit.Ng_x;
                hits.normal[1][index] = single.hit.Ng_y;
                hits.normal[2][index] = single.hit.Ng_z;
            }
        }
        *counts += payload.counts;
    }

    /// As [`Accelerator::occluded`], but one ray at a time through rtcOccluded1: the baseline of benchmarks.
    pub fn occluded_single(&self, rays: &RayBatch, occluded: &mut Vec<bool>, counts: &mut SolveCounts) {
        occluded.clear();
        occluded.resize(rays.len(), false);
        let mut payload = LanePayload { tolerance_growth: rays.tolerance_growth, ..LanePayload::EMPTY };
        for (index, occluded) in occluded.iter_mut().enumerate() {
            payload.tolerance[0] = rays.tolerance[index];
            let mut ray = Ray::default();
            [ray.org_x, ray.org_y, ray.org_z] = rays.origin(index).to_array();
            [ray.dir_x, ray.dir_y, ray.dir_z] = rays.direction(index).to_array();
            ray.tnear = rays.tnear[index];
            ray.tfar = rays.tfar[index];
            ray.mask = u32::MAX;
            self.scene.occluded1(&mut ray, &mut payload);
            *occluded = ray.tfar == f32::NEG_INFINITY;
        }
        *counts += payload.counts;
    }
}

/// Sixteen rays on their way into Embree.
struct Packet {
    valid: Valid16,
    any: bool,
    ray: Ray16,
    tolerance: [f32; LANES],
}

impl Packet {
    const EMPTY: Self = Self {
        valid: Valid16([0; LANES]),
        any: false,
        ray: Ray16 {
            org_x: [0.0; LANES],
            org_y: [0.0; LANES],
            org_z: [0.0; LANES],
            tnear: [0.0; LANES],
            dir_x: [0.0; LANES],
            dir_y: [0.0; LANES],
            dir_z: [0.0; LANES],
            time: [0.0; LANES],
            tfar: [0.0; LANES],
            mask: [u32::MAX; LANES],
            id: IDENTITY,
            flags: [0; LANES],
        },
        tolerance: [0.0; LANES],
    };

    /// Takes the rays from `start` on, in the order given if there is one. Lanes behind the batch's end, and rays that
    /// are no rays (see [`RayBatch`]), stay out.
    fn load(&mut self, rays: &RayBatch, order: Option<&[u32]>, start: usize) {
        let ray = &mut self.ray;
        ray.org_x = sixteen(&rays.origin[0], order, start);
        ray.org_y = sixteen(&rays.origin[1], order, start);
        ray.org_z = sixteen(&rays.origin[2], order, start);
        ray.dir_x = sixteen(&rays.direction[0], order, start);
        ray.dir_y = sixteen(&rays.direction[1], order, start);
        ray.dir_z = sixteen(&rays.direction[2], order, start);
        ray.tnear = sixteen(&rays.tnear, order, start);
        ray.tfar = sixteen(&rays.tfar, order, start);
        self.tolerance = sixteen(&rays.tolerance, order, start);
        let mut any = 0;
        for lane in 0..LANES {
            // Bitwise, without branches, so that the compiler keeps it in vectors. Lanes behind the end have a zero
            // direction from `sixteen`.
            let finite = (ray.org_x[lane].abs() < f32::INFINITY)
                & (ray.org_y[lane].abs() < f32::INFINITY)
                & (ray.org_z[lane].abs() < f32::INFINITY)
                & (ray.dir_x[lane].abs() < f32::INFINITY)
                & (ray.dir_y[lane].abs() < f32::INFINITY)
                & (ray.dir_z[lane].abs() < f32::INFINITY);
            let somewhere = (ray.dir_x[lane] != 0.0) | (ray.dir_y[lane] != 0.0) | (ray.dir_z[lane] != 0.0);
            let interval = (ray.tnear[lane] >= 0.0)
                & (ray.tnear[lane] < ray.tfar[lane])
                & (self.tolerance[lane] >= 0.0)
                & (self.tolerance[lane] < f32::INFINITY);
            self.valid.0[lane] = -i32::from(finite & somewhere & interval);
            any |= self.valid.0[lane];
        }
        self.any = any != 0;
    }
}

/// Sixteen values from `start` on, in the order given if there is one; zero behind the end.
#[inline]
fn sixteen(values: &[f32], order: Option<&[u32]>, start: usize) -> [f32; LANES] {
    let mut out = [0.0; LANES];
    match order {
        Some(order) => {
            for (out, &ray) in out.iter_mut().zip(&order[start..]) {
                *out = values[ray as usize];
            }
        }
        None => {
            let rest = &values[start..];
            match rest.first_chunk() {
                Some(all) => return *all,
                None => out[..rest.len()].copy_from_slice(rest),
            }
        }
    }
    out
}

/// The other way: as many of the sixteen as there are places.
#[inline]
fn store<T: Copy>(to: &mut [T], order: Option<&[u32]>, start: usize, from: &[T; LANES]) {
    match order {
        Some(order) => {
            for (&value, &ray) in from.iter().zip(&order[start..]) {
                to[ray as usize] = value;
            }
        }
        None => {
            let rest = &mut to[start..];
            match rest.first_chunk_mut() {
                Some(all) => *all = *from,
                None => {
                    let count = rest.len();
                    rest.copy_from_slice(&from[..count]);
                }
            }
        }
    }
}

impl Accelerator for EmbreeAccel {
    fn closest(&self, rays: &RayBatch, hits: &mut HitBatch, counts: &mut SolveCounts) {
        let count = rays.len();
        hits.resize(count);
        let mut payload = LanePayload { tolerance_growth: rays.tolerance_growth, ..LanePayload::EMPTY };
        let mut packet = Packet::EMPTY;
        let order = self.slab.and_then(|slab| slab.order(rays));
        let order = order.as_deref();
        for start in (0..count).step_by(LANES) {
            packet.load(rays, order, start);
            // Zeros where Embree writes nothing; "no geometry" is what tells a miss.
            let mut found = RayHit16 { ray: packet.ray, ..RayHit16::default() };
            found.hit.geomID = [INVALID_GEOMETRY; LANES];
            payload.gave_up = 0;
            if packet.any {
                payload.tolerance = packet.tolerance;
                self.scene.intersect16(&packet.valid, &mut found, &mut payload);
            }
            let hit = &found.hit;
            let mut t = found.ray.tfar;
            for lane in 0..LANES {
                t[lane] = if hit.geomID[lane] == INVALID_GEOMETRY { f32::INFINITY } else { t[lane] };
            }
            store(&mut hits.t, order, start, &t);
            store(&mut hits.part, order, start, &hit.geomID);
            store(&mut hits.primitive, order, start, &hit.primID);
            store(&mut hits.u, order, start, &hit.u);
            store(&mut hits.v, order, start, &hit.v);
            store(&mut hits.normal[0], order, start, &hit.Ng_x);
            store(&mut hits.normal[1], order, start, &hit.Ng_y);
            store(&mut hits.normal[2], order, start, &hit.Ng_z);
            let gave_up = payload.gave_up;
            store(&mut hits.gave_up, order, start, &std::array::from_fn(|lane| gave_up >> lane & 1 != 0));
        }
        *counts += payload.counts;
    }

    fn occluded(&self, rays: &RayBatch, occluded: &mut Vec<bool>, counts: &mut SolveCounts) {
        let count = rays.len();
        occluded.resize(count, false);
        let mut payload = LanePayload { tolerance_growth: rays.tolerance_growth, ..LanePayload::EMPTY };
        let mut packet = Packet::EMPTY;
        let order = self.slab.and_then(|slab| slab.order(rays));
        let order = order.as_deref();
        for start in (0..count).step_by(LANES) {
            packet.load(rays, order, start);
            let mut asked = packet.ray;
            if packet.any {
                payload.tolerance = packet.tolerance;
                self.scene.occluded16(&packet.valid, &mut asked, &mut payload);
            }
            // A lane that did not ask may have come with a tfar of -inf.
            let valid = &packet.valid.0;
            let hit = std::array::from_fn(|lane| (asked.tfar[lane] == f32::NEG_INFINITY) & (valid[lane] != 0));
            store(occluded, order, start, &hit);
        }
        *counts += payload.counts;
    }

    fn stats(&self) -> AccelStats {
        AccelStats {
            name: "embree".to_owned(),
            build_seconds: self.build_seconds,
            bytes: self.device.memory() + self.own_bytes,
            primitives: self.primitives.clone(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::{Plane, Random, random_rays, random_scene};
    use super::*;
    use crate::lower::Spheres;
    use glam::Vec3;

    fn trace(accel: &EmbreeAccel, rays: &RayBatch) -> (HitBatch, SolveCounts) {
        let (mut hits, mut counts) = (HitBatch::default(), SolveCounts::default());
        accel.closest(rays, &mut hits, &mut counts);
        (hits, counts)
    }

    fn plane() -> Vec<(u32, Geometry)> {
        vec![(3, Geometry::Lanes(Arc::new(Plane::default())))]
    }

    /// Every field's bits, for comparing exactly.
    fn bits(hits: &HitBatch, index: usize) -> [u32; 9] {
        let normal = hits.normal.each_ref().map(|axis| axis[index].to_bits());
        let place = [hits.t[index], hits.u[index], hits.v[index]].map(f32::to_bits);
        let [x, y, z] = normal;
        [place[0], place[1], place[2], x, y, z, hits.part[index], hits.primitive[index], hits.gave_up[index].into()]
    }

    #[test]
    fn callbacks_carry_rays_tolerances_counts_and_doubt() {
        for settings in ["", "isa=avx2", "isa=avx", "isa=sse4.2"] {
            let accel = EmbreeAccel::with_settings(&plane(), Particles::Clusters, 1, settings).unwrap();
            for count in [1, 4, 15, 16, 17, 40] {
                let mut rays = RayBatch { tolerance_growth: 0.5, ..RayBatch::default() };
                for index in 0..count {
                    // Straight down from height index + 1; every third ray ends above the plane.
                    let height = index as f32 + 1.0;
                    let tfar = if index % 3 == 2 { 0.5 } else { f32::INFINITY };
                    let tolerance = if index % 5 == 4 { Plane::DOUBT } else { 0.25 + index as f32 };
                    rays.push(Vec3::new(index as f32, height, 7.0), Vec3::NEG_Y, 0.0, tfar, tolerance);
                }
                let (hits, counts) = trace(&accel, &rays);
                let (mut occluded, mut more) = (Vec::new(), SolveCounts::default());
                accel.occluded(&rays, &mut occluded, &mut more);
                for index in 0..count {
                    let doubt = index % 5 == 4;
                    let hit = index % 3 != 2 && !doubt;
                    let place = format!("{settings}, {index} of {count}");
                    assert_eq!(hits.gave_up[index], doubt, "{place}");
                    assert_eq!(occluded[index], hit, "{place}");
                    assert_eq!(hits.part[index], if hit { 3 } else { NO_PART }, "{place}");
                    assert_eq!(hits.t[index], if hit { index as f32 + 1.0 } else { f32::INFINITY }, "{place}");
                    if hit {
                        // The plane answers with what it was given: x as primitive, tolerance as u, growth as v.
                        assert_eq!(hits.primitive[index], index as u32, "{place}");
                        assert_eq!(hits.u[index], rays.tolerance[index], "{place}");
                        assert_eq!(hits.v[index], 0.5, "{place}");
                        assert_eq!(hits.normal.each_ref().map(|axis| axis[index]), [0.0, 2.0, 0.0], "{place}");
                    }
                }
                assert_eq!(counts.patches, count as u64, "{settings}");
                assert_eq!(more.patches, count as u64, "{settings}");
                assert_eq!(counts.gave_up, count as u64 / 5, "{settings}");
            }
        }
    }

    #[test]
    fn single_rays_answer_as_packets_do() {
        let accel = EmbreeAccel::new(&plane()).unwrap();
        let mut rays = RayBatch::default();
        for index in 0..20_u8 {
            let x = f32::from(index);
            let tolerance = if index == 7 { Plane::DOUBT } else { x };
            rays.push(Vec3::new(x, 1.0, 0.0), Vec3::new(0.1, -1.0, 0.0), 0.0, 100.0, tolerance);
        }
        rays.push(Vec3::NAN, Vec3::NEG_Y, 0.0, 1.0, 0.1);
        let (packets, counts) = trace(&accel, &rays);
        let (mut single, mut single_counts) = (HitBatch::default(), SolveCounts::default());
        accel.closest_single(&rays, &mut single, &mut single_counts);
        assert_eq!(counts, single_counts);
        for index in 0..rays.len() {
            assert_eq!(bits(&packets, index), bits(&single, index), "{index}");
        }
    }

    #[test]
    fn what_is_no_ray_misses() {
        let accel = EmbreeAccel::new(&plane()).unwrap();
        let (o, d) = (Vec3::Y, Vec3::NEG_Y);
        let mut rays = RayBatch::default();
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            rays.push(Vec3::new(bad, 1.0, 0.0), d, 0.0, 9.0, 0.1);
            rays.push(o, Vec3::new(bad, -1.0, 0.0), 0.0, 9.0, 0.1);
            rays.push(o, d, bad, 9.0, 0.1);
            rays.push(o, d, 0.0, 9.0, bad);
        }
        rays.push(o, d, 0.0, f32::NAN, 0.1);
        rays.push(o, d, 0.0, f32::NEG_INFINITY, 0.1);
        rays.push(o, d, -1.0, 9.0, 0.1);
        rays.push(o, d, 2.0, 1.0, 0.1);
        rays.push(o, d, 1.0, 1.0, 0.1);
        rays.push(o, d, 0.0, 9.0, -0.1);
        rays.push(o, Vec3::ZERO, 0.0, 9.0, 0.1);
        let misses = rays.len();
        rays.push(o, d, 1.0, 1.0_f32.next_up(), 0.0); // The shortest ray, on the plane.
        let (hits, counts) = trace(&accel, &rays);
        let mut occluded = Vec::new();
        accel.occluded(&rays, &mut occluded, &mut SolveCounts::default());
        for index in 0..misses {
            assert_eq!(bits(&hits, index), [f32::INFINITY.to_bits(), 0, 0, 0, 0, 0, NO_PART, 0, 0], "{index}");
            assert!(!occluded[index], "{index}");
        }
        assert_eq!((hits.t[misses], hits.part[misses], occluded[misses]), (1.0, 3, true));
        assert_eq!(counts.patches, 1, "only the one true ray reaches the solver");
    }

    #[test]
    fn an_empty_scene_misses() {
        let accel = EmbreeAccel::new(&[]).unwrap();
        let rays = random_rays(20, 1);
        let (hits, _) = trace(&accel, &rays);
        assert!(hits.part.iter().all(|&part| part == NO_PART) && hits.t.iter().all(|&t| t == f32::INFINITY));
        let empty = vec![
            (0, Geometry::Spheres(Arc::default())),
            (1, Geometry::Discs(Arc::default())),
            (2, Geometry::Triangles(Arc::default())),
        ];
        let accel = EmbreeAccel::new(&empty).unwrap();
        let mut occluded = Vec::new();
        accel.occluded(&rays, &mut occluded, &mut SolveCounts::default());
        assert_eq!(occluded, [false; 20]);
        assert!(accel.stats().primitives.is_empty());
    }

    #[test]
    fn a_hit_does_not_depend_on_the_rays_beside_it() {
        let accel = EmbreeAccel::new(&random_scene(5)).unwrap();
        let rays = random_rays(1600, 6);
        let (together, _) = trace(&accel, &rays);
        let mut found = 0;
        for index in 0..rays.len() {
            let mut alone = RayBatch::default();
            let (tnear, tfar) = (rays.tnear[index], rays.tfar[index]);
            alone.push(rays.origin(index), rays.direction(index), tnear, tfar, rays.tolerance[index]);
            let (hit, _) = trace(&accel, &alone);
            assert_eq!(bits(&hit, 0), bits(&together, index), "{index}");
            found += usize::from(hit.part[0] != NO_PART);
        }
        assert!(found > 400, "only {found} rays hit anything");
    }

    #[test]
    fn a_hit_does_not_depend_on_the_threads_that_built() {
        // Enough for Embree to build in parallel; every sphere is there three times, so that ties could show the order.
        let mut random = Random(7);
        let mut spheres = Spheres::default();
        for index in 0..60_000 {
            let center = random.vector(10.0);
            spheres.center.push(if index % 3 == 0 { center } else { spheres.center[index - index % 3] });
            spheres.radius.push(0.05);
        }
        let scene = [(0, Geometry::Spheres(Arc::new(spheres)))];
        let rays = random_rays(4000, 8);
        let build = |threads| EmbreeAccel::with_settings(&scene, Particles::Points, threads, "").unwrap();
        let one = trace(&build(1), &rays).0;
        for threads in [1, 2, 5, 5, 5] {
            let other = trace(&build(threads), &rays).0;
            for index in 0..rays.len() {
                assert_eq!(bits(&one, index), bits(&other, index), "ray {index}, {threads} threads");
            }
        }
    }

    #[test]
    fn clusters_and_embrees_own_points_are_hit_alike() {
        let mut scene = random_scene(12);
        scene.retain(|(_, geometry)| matches!(geometry, Geometry::Spheres(_) | Geometry::Discs(_)));
        let (ours, points) = (EmbreeAccel::new(&scene).unwrap(), EmbreeAccel::with_points(&scene).unwrap());
        let rays = random_rays(4000, 13);
        let ((ours, _), (points, _)) = (trace(&ours, &rays), trace(&points, &rays));
        let (mut hits, mut edges) = (0, 0);
        for index in 0..rays.len() {
            if (ours.part[index], ours.primitive[index]) != (points.part[index], points.primitive[index]) {
                edges += 1;
            } else if ours.part[index] != NO_PART {
                hits += 1;
                assert!((ours.t[index] - points.t[index]).abs() < 0.01 * (1.0 + points.t[index]), "ray {index}");
            }
        }
        assert!(hits > 1000 && edges <= 3, "{hits} hits, {edges} differ");
    }

    #[test]
    fn a_million_spheres_in_one_point_build_and_answer() {
        let count = 1_000_000;
        let spheres = Spheres { center: vec![Vec3::ONE; count], radius: vec![0.5; count] };
        let accel = EmbreeAccel::new(&[(0, Geometry::Spheres(Arc::new(spheres)))]).unwrap();
        let mut rays = RayBatch::default();
        rays.push(Vec3::new(1.0, 1.0, -9.0), Vec3::Z, 0.0, f32::INFINITY, 0.1);
        rays.push(Vec3::new(9.0, 1.0, -9.0), Vec3::Z, 0.0, f32::INFINITY, 0.1);
        let (hits, _) = trace(&accel, &rays);
        assert_eq!((hits.t[0], hits.part[1]), (9.5, NO_PART));
        let stats = accel.stats();
        assert!(stats.build_seconds < 10.0, "{} s to build", stats.build_seconds);
        assert!(stats.bytes > 16_000_000, "memory is not counted: {} bytes", stats.bytes);
    }

    #[test]
    fn memory_returns_when_a_scene_goes() {
        let spheres = Spheres { center: vec![Vec3::ONE; 10_000], radius: vec![0.5; 10_000] };
        let accel = EmbreeAccel::with_points(&[(0, Geometry::Spheres(Arc::new(spheres)))]).unwrap();
        let device = accel.device.clone();
        let held = device.memory();
        drop(accel);
        assert!(device.memory() < held / 2, "{} of {held} bytes are still held", device.memory());
    }

    #[test]
    fn flat_water_among_objects_loses_no_ray() {
        let mut scene = random_scene(9);
        scene.retain(|(_, geometry)| !matches!(geometry, Geometry::Lanes(_)));
        let objects = EmbreeAccel::new(&scene).unwrap();
        scene.extend(plane());
        let accel = EmbreeAccel::new(&scene).unwrap();
        let mut rays = random_rays(20_000, 10);
        rays.tolerance.fill(0.0);
        let ((all, _), (without, _)) = (trace(&accel, &rays), trace(&objects, &rays));
        let mut on_plane = 0;
        for index in 0..rays.len() {
            let t = -rays.origin[1][index] / rays.direction[1][index];
            if t >= 0.0 && t <= rays.tfar[index] && t < without.t[index] {
                assert_eq!((all.part[index], all.t[index]), (3, t), "{index}");
                on_plane += 1;
            }
        }
        assert!(on_plane > 2000, "only {on_plane} rays meet the plane");
    }
}
