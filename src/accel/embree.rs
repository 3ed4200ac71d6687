//! Embree behind the seam: parts become geometry whose identity is the part's index, batches become packets of 16.
//!
//! Packets always go through rtcIntersect16/rtcOccluded16 (8 or 4 wide on narrower processors), the last one masked, so
//! that a ray's bits do not depend on how many rays came with it. Where a packet reaches a surface's box, the callback
//! notes it, and the surface is asked once for a block of packets (see `block`): its solver's lanes are then refilled, and
//! what Embree has found by itself ends the rays. Spheres and round curves (front hit, else the back one) and discs are
//! held in clusters of our own, one user primitive per part; Embree's own points and curves are there for benchmarks.

use std::sync::Arc;
use std::time::Instant;

use super::block::{BLOCK, Block};
use super::clusters;
use super::lanes::{IDENTITY, LaneGeometry, LanePayload};
use super::{AccelError, AccelStats, Accelerator, Geometry, HitBatch, NO_PART, RayBatch, count_primitives};
use crate::ffi::embree::{
    CommittedScene, Device, INVALID_GEOMETRY, Ray, Ray16, RayHit, RayHit16, SceneBuilder, Valid16,
};
use crate::simd::SimdLevel;
use crate::surface::{LANES, LaneRays, LaneSurface, SolveCounts};

// A miss needs no translation.
const _: () = assert!(NO_PART == INVALID_GEOMETRY);

/// Who holds spheres, discs and curves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Particles {
    /// Clusters of sixteen, as user geometry, with an instruction set.
    Clusters(SimdLevel),
    /// Embree.
    Points,
}

/// An Embree scene over parts; clones share it.
#[derive(Clone)]
pub struct EmbreeAccel {
    scene: CommittedScene<LanePayload>,
    device: Device,
    build_seconds: f64,
    /// What stands behind callbacks, surfaces and clusters, in the order in which they number themselves.
    surfaces: Vec<(u32, Arc<dyn LaneSurface>)>,
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
    /// Uses as many threads as the current rayon pool has. Spheres, discs, curves and triangles are copied; surfaces are shared.
    ///
    /// # Errors
    /// Embree is missing or unsuitable, geometry has an index out of range, or memory ran out.
    pub fn new(geometry: &[(u32, Geometry)]) -> Result<Self, AccelError> {
        Self::with_simd(geometry, SimdLevel::detect())
    }

    /// As [`EmbreeAccel::new`], with an instruction set for clusters of particles.
    ///
    /// # Errors
    /// As [`EmbreeAccel::new`].
    pub fn with_simd(geometry: &[(u32, Geometry)], simd: SimdLevel) -> Result<Self, AccelError> {
        Self::with_settings(geometry, Particles::Clusters(simd), rayon::current_num_threads(), "")
    }

    /// As [`EmbreeAccel::new`], with spheres, discs and curves as Embree's own: a rival of benchmarks. Its packets and its
    /// single rays differ in the last bits of t, and it loses curves that are short, or thinner than a millimetre.
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
        let mut surfaces: Vec<(u32, Arc<dyn LaneSurface>)> = Vec::new();
        let mut user = |builder: &mut SceneBuilder<LanePayload>, part, surface: Arc<dyn LaneSurface>| {
            let number = surfaces.len();
            surfaces.push((part, Arc::clone(&surface)));
            builder.user(part, Arc::new(LaneGeometry { number, surface }))
        };
        for (part, geometry) in geometry {
            match geometry {
                Geometry::Lanes(surface) => {
                    user(&mut builder, *part, Arc::clone(surface))?;
                }
                Geometry::Spheres(spheres) => match particles {
                    Particles::Clusters(simd) => user(&mut builder, *part, clusters::of_spheres(spheres, simd))?,
                    Particles::Points => builder.spheres(*part, &spheres.center, &spheres.radius)?,
                },
                Geometry::Discs(discs) => match (particles, &discs.normal) {
                    (Particles::Clusters(simd), _) => user(&mut builder, *part, clusters::of_discs(discs, simd))?,
                    (Particles::Points, Some(normal)) => {
                        builder.discs(*part, &discs.center, &discs.radius, normal)?;
                    }
                    // Embree's own turn to a ray's direction, not to its origin.
                    (Particles::Points, None) => {
                        user(&mut builder, *part, clusters::of_discs(discs, SimdLevel::detect()))?;
                    }
                },
                Geometry::Curves(curves) => match particles {
                    Particles::Clusters(simd) => user(&mut builder, *part, clusters::of_curves(curves, simd))?,
                    Particles::Points => {
                        let sound = (0..curves.ends.len()).map(|index| curves.is_sound(index));
                        builder.curves(*part, &curves.ends, &curves.radius, sound)?;
                    }
                },
                Geometry::Triangles(mesh) => builder.triangles(*part, &mesh.position, &mesh.index)?,
            }
        }
        let scene = builder.commit()?;
        let primitives = count_primitives(geometry);
        Ok(Self { scene, device, build_seconds: start.elapsed().as_secs_f64(), surfaces, primitives })
    }

    /// Over a scene of Embree's own geometry.
    pub(super) fn committed(scene: CommittedScene<LanePayload>, device: Device, start: Instant) -> Self {
        let build_seconds = start.elapsed().as_secs_f64();
        Self { scene, device, build_seconds, surfaces: Vec::new(), primitives: Vec::new() }
    }

    /// The same scene, told that rays of a packet lie side by side: Embree then walks them together. For benchmarks; a
    /// renderer's batches hold both kinds.
    pub fn coherent(&self) -> Self {
        Self { scene: self.scene.coherent(), ..self.clone() }
    }

    /// As [`Accelerator::closest`], but one ray at a time through rtcIntersect1: the baseline of benchmarks, not for
    /// pictures (triangles may differ from packets in the last bits).
    pub fn closest_single(&self, rays: &RayBatch, hits: &mut HitBatch, counts: &mut SolveCounts) {
        hits.reset(rays.len());
        let mut payload = LanePayload { tolerance_growth: rays.tolerance_growth, ..LanePayload::SOLVING };
        let mut block = Box::new(Block::EMPTY);
        for index in 0..rays.len() {
            let within = index % (BLOCK * LANES);
            if within == 0 {
                block.load(rays, index);
            }
            if block.packets[within / LANES].active >> (within % LANES) & 1 == 0 {
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
        let mut payload = LanePayload { tolerance_growth: rays.tolerance_growth, ..LanePayload::SOLVING };
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
    ray: Ray16,
}

impl Packet {
    const EMPTY: Self = Self {
        valid: Valid16([0; LANES]),
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
    };

    /// Takes a packet's rays; lanes that are not active stay out.
    fn load(&mut self, rays: &LaneRays) {
        let ray = &mut self.ray;
        [ray.org_x, ray.org_y, ray.org_z] = rays.origin;
        [ray.dir_x, ray.dir_y, ray.dir_z] = rays.direction;
        ray.tnear = rays.tnear;
        ray.tfar = rays.tfar;
        for lane in 0..LANES {
            self.valid.0[lane] = -i32::from(rays.active >> lane & 1);
        }
    }
}

/// As many of the sixteen as there are places.
#[inline]
fn store<T: Copy>(to: &mut [T], start: usize, from: &[T; LANES]) {
    let rest = &mut to[start..];
    match rest.first_chunk_mut() {
        Some(all) => *all = *from,
        None => {
            let count = rest.len();
            rest.copy_from_slice(&from[..count]);
        }
    }
}

impl EmbreeAccel {
    /// Asks each surface for the lanes whose packets have reached its box; `ask` gets the surface's number and the block
    /// with those lanes active, which it may make fewer.
    fn surfaces(&self, block: &mut Block, reached: &[Vec<u16>], mut ask: impl FnMut(usize, &mut Block)) {
        let mut open = [u16::MAX; BLOCK];
        for number in 0..self.surfaces.len() {
            let mut any = 0;
            for (packet, (reached, open)) in block.packets.iter_mut().zip(reached.iter().zip(open)) {
                packet.active = reached[number] & open;
                any |= packet.active;
            }
            if any == 0 {
                continue;
            }
            let before: [u16; BLOCK] = std::array::from_fn(|packet| block.packets[packet].active);
            ask(number, block);
            for packet in 0..block.used {
                open[packet] &= !(before[packet] & !block.packets[packet].active);
            }
        }
    }
}

impl Accelerator for EmbreeAccel {
    fn closest(&self, rays: &RayBatch, hits: &mut HitBatch, counts: &mut SolveCounts) {
        hits.resize(rays.len());
        let mut query = LanePayload::deferring(self.surfaces.len());
        let mut reached = vec![vec![0; self.surfaces.len()]; BLOCK];
        let (mut packet, mut block) = (Packet::EMPTY, Box::new(Block::EMPTY));
        for start in Block::starts(rays.len()) {
            block.load(rays, start);
            for (index, start) in (0..block.used).zip((start..).step_by(LANES)) {
                packet.load(&block.packets[index]);
                // Zeros where Embree writes nothing; "no geometry" is what tells a miss.
                let mut found = RayHit16 { ray: packet.ray, ..RayHit16::default() };
                found.hit.geomID = [INVALID_GEOMETRY; LANES];
                query.reached.fill(0);
                if block.packets[index].active != 0 {
                    self.scene.intersect16(&packet.valid, &mut found, &mut query);
                }
                reached[index].copy_from_slice(&query.reached);
                let hit = &found.hit;
                let mut t = found.ray.tfar;
                for lane in 0..LANES {
                    t[lane] = if hit.geomID[lane] == INVALID_GEOMETRY { f32::INFINITY } else { t[lane] };
                }
                block.packets[index].tfar = found.ray.tfar;
                store(&mut hits.t, start, &t);
                store(&mut hits.part, start, &hit.geomID);
                store(&mut hits.primitive, start, &hit.primID);
                store(&mut hits.u, start, &hit.u);
                store(&mut hits.v, start, &hit.v);
                store(&mut hits.normal[0], start, &hit.Ng_x);
                store(&mut hits.normal[1], start, &hit.Ng_y);
                store(&mut hits.normal[2], start, &hit.Ng_z);
                store(&mut hits.gave_up, start, &[false; LANES]);
            }
            self.surfaces(&mut block, &reached, |number, block| {
                let (part, surface) = &self.surfaces[number];
                block.closest(*part, surface.as_ref(), hits, counts);
            });
        }
    }

    fn occluded(&self, rays: &RayBatch, occluded: &mut Vec<bool>, counts: &mut SolveCounts) {
        occluded.resize(rays.len(), false);
        let mut query = LanePayload::deferring(self.surfaces.len());
        let mut reached = vec![vec![0; self.surfaces.len()]; BLOCK];
        let (mut packet, mut block) = (Packet::EMPTY, Box::new(Block::EMPTY));
        for start in Block::starts(rays.len()) {
            block.load(rays, start);
            for (index, start) in (0..block.used).zip((start..).step_by(LANES)) {
                let active = block.packets[index].active;
                packet.load(&block.packets[index]);
                let mut asked = packet.ray;
                query.reached.fill(0);
                if active != 0 {
                    self.scene.occluded16(&packet.valid, &mut asked, &mut query);
                }
                // A lane that did not ask may have come with a tfar of -inf.
                let mut hit = [false; LANES];
                for lane in 0..LANES {
                    hit[lane] = (asked.tfar[lane] == f32::NEG_INFINITY) & (active >> lane & 1 == 1);
                }
                let open = (0..LANES).fold(0, |open, lane| open | u16::from(!hit[lane]) << lane);
                for (to, from) in reached[index].iter_mut().zip(&query.reached) {
                    *to = from & open;
                }
                store(occluded, start, &hit);
            }
            self.surfaces(&mut block, &reached, |number, block| {
                block.occluded(self.surfaces[number].1.as_ref(), occluded, counts);
            });
        }
    }

    fn stats(&self) -> AccelStats {
        AccelStats {
            name: "embree".to_owned(),
            build_seconds: self.build_seconds,
            bytes: self.device.memory() + self.surfaces.iter().map(|(_, surface)| surface.bytes()).sum::<u64>(),
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
            let accel = EmbreeAccel::with_settings(&plane(), Particles::Points, 1, settings).unwrap();
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
    fn rays_said_to_lie_side_by_side_hit_the_same() {
        let accel = EmbreeAccel::new(&random_scene(2)).unwrap();
        let rays = random_rays(2000, 3);
        let (plain, coherent) = (trace(&accel, &rays).0, trace(&accel.coherent(), &rays).0);
        assert!(plain.part.iter().filter(|&&part| part != NO_PART).count() > 400);
        assert_eq!(plain.part, coherent.part);
        assert_eq!(plain.primitive, coherent.primitive);
        assert_eq!(plain.t, coherent.t);
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
