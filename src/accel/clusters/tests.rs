//! Clusters against brute force, together against alone, and the tree against what every tree must hold.

use super::super::brute::Brute;
use super::super::testing::{Random, random_rays};
use super::super::{Accelerator, Geometry, HitBatch, NO_PART, RayBatch};
use super::build::MOST_DEPTH;
use super::ray::{Beam, Packet};
use super::*;
use crate::simd::{Kernel, Simd};

/// Clouds of spheres and discs of many sizes, in clumps, some of them twice, within 12 m of the origin.
fn particles(count: usize, seed: u64) -> (Spheres, Discs) {
    let mut random = Random(seed);
    let (mut spheres, mut discs) = (Spheres::default(), Discs::default());
    let clumps: Vec<Vec3> = (0..20).map(|_| random.vector(10.0)).collect();
    for index in 0..count {
        let center = match index % 10 {
            9 => spheres.center[index / 2],
            _ => clumps[index % 20] + random.vector(2.0) * random.unit(),
        };
        spheres.center.push(center);
        spheres.radius.push(if index % 20 == 0 { 0.8 } else { 0.05 + 0.2 * random.unit() });
    }
    discs.center.clone_from(&spheres.center);
    discs.radius.clone_from(&spheres.radius);
    discs.normal = Some((0..count).map(|_| random.vector(1.0).normalize_or(Vec3::Y)).collect());
    (spheres, discs)
}

/// All kinds as clouds and as geometry, on every instruction set.
fn clouds(count: usize, seed: u64) -> Vec<(String, Arc<dyn LaneSurface>, Geometry)> {
    let (spheres, discs) = particles(count, seed);
    let (spheres, discs) = (Arc::new(spheres), Arc::new(discs));
    let mut clouds = Vec::new();
    for level in SimdLevel::ALL.into_iter().filter(|level| level.is_available()) {
        let name = |kind| format!("{kind}, {}", level.name());
        clouds.push((name("spheres"), of_spheres(&spheres, level), Geometry::Spheres(Arc::clone(&spheres))));
        let curves = Arc::new(Curves {
            ends: spheres
                .center
                .iter()
                .zip(discs.normal.iter().flatten())
                .map(|(&head, &way)| [head, head + 0.5 * way])
                .collect(),
            radius: spheres.radius.iter().map(|&radius| [0.5 * radius, 0.1 * radius]).collect(),
        });
        clouds.push((name("curves"), of_curves(&curves, level), Geometry::Curves(curves)));
        clouds.push((name("discs"), of_discs(&discs, level), Geometry::Discs(Arc::clone(&discs))));
        let facing = Arc::new(Discs { normal: None, ..Discs::clone(&discs) });
        clouds.push((name("facing discs"), of_discs(&facing, level), Geometry::Discs(facing)));
    }
    clouds
}

/// Packets of 4x4 pixels that look at the origin from afar, as many to a side.
fn looks(from: Vec3, side: usize) -> RayBatch {
    let forward = -from.normalize();
    let right = forward.any_orthonormal_vector();
    let up = right.cross(forward);
    let size = 6.0 / from.length();
    let mut rays = RayBatch::default();
    for tile in 0..side * side {
        for pixel in 0..16 {
            let x = (tile % side * 4 + pixel % 4) as f32 / (2 * side) as f32 - 1.0;
            let y = (tile / side * 4 + pixel / 4) as f32 / (2 * side) as f32 - 1.0;
            rays.push(from, forward + size * (x * right + y * up), 0.0, f32::INFINITY, 0.0);
        }
    }
    rays
}

fn packet(rays: &RayBatch, start: usize, active: u16) -> LaneRays {
    let mut packet = LaneRays { active, ..LaneRays::EMPTY };
    for lane in 0..LANES {
        for axis in 0..3 {
            packet.origin[axis][lane] = rays.origin[axis][start + lane];
            packet.direction[axis][lane] = rays.direction[axis][start + lane];
        }
        packet.tnear[lane] = rays.tnear[start + lane];
        packet.tfar[lane] = rays.tfar[start + lane];
    }
    packet
}

/// The bits of a lane's answer; `None` for a miss.
fn bits(hits: &LaneHits, lane: usize) -> Option<[u32; 5]> {
    let normal = hits.normal.each_ref().map(|axis| axis[lane].to_bits());
    (hits.hit >> lane & 1 == 1).then_some([
        hits.t[lane].to_bits(),
        hits.primitive[lane],
        normal[0],
        normal[1],
        normal[2],
    ])
}

fn closest(cloud: &dyn LaneSurface, rays: &LaneRays) -> LaneHits {
    let mut hits = LaneHits::EMPTY;
    cloud.closest(rays, &mut hits, &mut SolveCounts::default());
    hits
}

#[test]
fn every_instruction_set_finds_what_brute_force_finds() {
    for (name, cloud, geometry) in clouds(1500, 1) {
        let mut rays = random_rays(3200, 2);
        let coherent = looks(Vec3::new(5.0, 30.0, 9.0), 12);
        for index in 0..coherent.len() {
            rays.push(coherent.origin(index), coherent.direction(index), 0.0, f32::INFINITY, 0.0);
        }
        let mut truth = HitBatch::default();
        Brute::new(vec![(0, geometry)]).closest(&rays, &mut truth, &mut SolveCounts::default());
        let (mut hits_seen, mut edges) = (0, 0);
        for start in (0..rays.len()).step_by(LANES) {
            let asked = packet(&rays, start, u16::MAX);
            let hits = closest(cloud.as_ref(), &asked);
            assert_eq!(cloud.occluded(&asked, &mut SolveCounts::default()), hits.hit, "{name}");
            for lane in 0..LANES {
                let index = start + lane;
                let found = hits.hit >> lane & 1 == 1;
                // A graze within rounding, or two particles in one place.
                let (t, exact) = (hits.t[lane], truth.t[index]);
                if found != (truth.part[index] != NO_PART) || (found && (t - exact).abs() > 1e-3 * (1.0 + exact)) {
                    edges += 1;
                } else if found && hits.primitive[lane] == truth.primitive[index] {
                    hits_seen += 1;
                    let normal = Vec3::from(hits.normal.each_ref().map(|axis| axis[lane]));
                    let expected = Vec3::from(truth.normal.each_ref().map(|axis| axis[index]));
                    assert!((normal - expected).length() <= 0.02 * expected.length(), "{name}: {normal} {expected}");
                }
            }
        }
        assert!(hits_seen > 400 && edges <= 3, "{name}: {hits_seen} hits, {edges} edges");
    }
}

#[test]
fn a_ray_finds_the_same_bits_alone_in_a_beam_and_among_strangers() {
    for (name, cloud, _) in clouds(3000, 3) {
        let mut found = 0;
        for from in [Vec3::new(9.0, 25.0, -14.0), Vec3::new(-3e4, 5e4, 2e4), Vec3::new(0.4, 0.3, 0.2)] {
            let rays = looks(from, 12);
            for start in (0..rays.len()).step_by(LANES) {
                let together = closest(cloud.as_ref(), &packet(&rays, start, u16::MAX));
                let some = closest(cloud.as_ref(), &packet(&rays, start, 0b0110_1101_0011_0101));
                // The same rays with others of another tile between them: no beam.
                let mut mixed = packet(&rays, start, u16::MAX);
                let other = packet(&rays, (start + 16 * 37) % rays.len(), u16::MAX);
                for lane in (1..LANES).step_by(2) {
                    for axis in 0..3 {
                        mixed.direction[axis][lane] = -other.direction[axis][lane];
                    }
                }
                let mixed = closest(cloud.as_ref(), &mixed);
                for lane in 0..LANES {
                    let alone = closest(cloud.as_ref(), &packet(&rays, start, 1 << lane));
                    assert_eq!(bits(&together, lane), bits(&alone, lane), "{name} from {from}, ray {}", start + lane);
                    if 0b0110_1101_0011_0101 >> lane & 1 == 1 {
                        assert_eq!(bits(&some, lane), bits(&alone, lane), "{name} from {from}, ray {}", start + lane);
                    } else {
                        assert_eq!(bits(&some, lane), None);
                    }
                    if lane % 2 == 0 {
                        assert_eq!(bits(&mixed, lane), bits(&alone, lane), "{name} from {from}, ray {}", start + lane);
                    }
                    found += usize::from(bits(&alone, lane).is_some());
                }
            }
        }
        assert!(found > 1500, "{name}: {found}");
    }
}

/// Whether a packet travels as a beam.
struct IsBeam<'a>(&'a LaneRays);
impl Kernel for IsBeam<'_> {
    type Output = bool;
    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> bool {
        Beam::new(&Packet::new(s, self.0), self.0.active, 24.0).is_some()
    }
}

#[test]
fn a_cameras_rays_are_a_beam_and_strangers_are_not() {
    let level = SimdLevel::detect();
    let beams = |rays: &RayBatch| {
        (0..rays.len()).step_by(LANES).filter(|&start| dispatch(level, IsBeam(&packet(rays, start, u16::MAX)))).count()
    };
    let camera = looks(Vec3::new(9.0, 25.0, -14.0), 16);
    assert!(beams(&camera) > 200, "{} of 256", beams(&camera));
    assert_eq!(beams(&random_rays(1600, 4)), 0);
    assert!(!dispatch(level, IsBeam(&packet(&camera, 0, 0b111))), "three rays are better off alone");
}

#[test]
fn directions_of_any_length_and_intervals_of_any_kind_are_answered() {
    let spheres = Spheres { center: vec![Vec3::new(0.0, 0.0, 5.0), Vec3::new(0.0, 0.0, 9.0)], radius: vec![1.0; 2] };
    let cloud = of_spheres(&spheres, SimdLevel::detect());
    let ask = |direction: Vec3, tnear: f32, tfar: f32| {
        let mut rays = LaneRays::unbounded(&[(Vec3::ZERO, direction)], 0.0);
        (rays.tnear[0], rays.tfar[0]) = (tnear, tfar);
        let hits = closest(cloud.as_ref(), &rays);
        (hits.hit == 1).then(|| (hits.t[0], hits.primitive[0]))
    };
    for length in [1e-30, 1e-3, 1.0, 3e8, 1e37_f32] {
        let (t, primitive) = ask(Vec3::Z * length, 0.0, f32::INFINITY).unwrap_or_else(|| panic!("{length}"));
        assert_eq!(primitive, 0);
        assert!((t * length - 4.0).abs() < 1e-5, "{length}: {t}");
    }
    assert_eq!(ask(Vec3::Z, 4.5, f32::INFINITY), Some((6.0, 0)), "from within: the exit");
    assert_eq!(ask(Vec3::Z, 7.0, f32::INFINITY), Some((8.0, 1)));
    assert_eq!(ask(Vec3::Z, 0.0, 4.0), Some((4.0, 0)), "the end counts");
    assert_eq!(ask(Vec3::Z, 0.0, 3.99), None);
    assert_eq!(ask(Vec3::Z, 10.5, 20.0), None);
}

#[test]
fn what_no_ray_can_hit_is_left_out_and_numbers_stay() {
    let (x, nan) = (Vec3::X, f32::NAN);
    let spheres = Spheres { center: vec![9.0 * x, x * nan, 3.0 * x, 5.0 * x], radius: vec![0.0, 1.0, nan, 0.5] };
    let hits =
        closest(of_spheres(&spheres, SimdLevel::detect()).as_ref(), &LaneRays::unbounded(&[(Vec3::ZERO, x)], 0.0));
    assert_eq!((hits.hit, hits.primitive[0], hits.t[0]), (1, 3, 4.5));
    let discs = Discs { center: vec![x, 2.0 * x], radius: vec![1.0; 2], normal: Some(vec![Vec3::ZERO, x]) };
    let hits = closest(of_discs(&discs, SimdLevel::detect()).as_ref(), &LaneRays::unbounded(&[(Vec3::ZERO, x)], 0.0));
    assert_eq!((hits.hit, hits.primitive[0], hits.t[0]), (1, 1, 2.0));
    let nothing = of_spheres(&Spheres::default(), SimdLevel::detect());
    assert_eq!(closest(nothing.as_ref(), &LaneRays::unbounded(&[(Vec3::ZERO, x)], 0.0)).hit, 0);
    assert!(nothing.bounds()[0].x > nothing.bounds()[1].x);
}

/// The cloud itself, of some spheres.
fn tree(spheres: &Spheres) -> Cloud<SphereCluster> {
    let bounds = |record: &Record| Primitive::Sphere { center: record.center, radius: record.radius }.bounds(0.0);
    let group = |records: &[Record]| {
        let mut cluster = SphereCluster::EMPTY;
        for (slot, record) in records.iter().enumerate() {
            cluster.put(slot, record);
        }
        cluster
    };
    Cloud::new(&spheres.center, &spheres.radius, &group, &bounds, SimdLevel::detect())
}

/// Counts each sphere that is reached and checks its boxes on the way; returns the depth.
fn check(cloud: &Cloud<SphereCluster>, spheres: &Spheres, node: u32, bounds: Aabb, seen: &mut [u32]) -> u32 {
    let node = &cloud.nodes[node as usize];
    let mut depth = 0;
    for slot in 0..WIDTH {
        let side = |side: usize| Vec3::from(node.planes.each_ref().map(|axis| axis[side][slot]));
        let inner = Aabb { low: side(0), high: side(1) };
        if inner.is_empty() {
            continue;
        }
        assert!(bounds.low.cmple(inner.low).all() && inner.high.cmple(bounds.high).all());
        let child = node.child[slot];
        if child & CLUSTER == 0 {
            depth = depth.max(check(cloud, spheres, child, inner, seen));
            continue;
        }
        let cluster = &cloud.clusters[(child & !CLUSTER) as usize];
        for slot in (0..WIDTH).filter(|&slot| !cluster.radius()[slot].is_nan()) {
            let number = cluster.number(slot) as usize;
            seen[number] += 1;
            let (center, radius) = (spheres.center[number], spheres.radius[number]);
            assert!(inner.low.cmple(center - radius).all() && inner.high.cmpge(center + radius).all());
        }
    }
    depth + 1
}

#[test]
fn trees_hold_every_particle_once_in_nested_boxes() {
    let mut random = Random(6);
    let one_place = Spheres { center: vec![Vec3::ONE; 40_000], radius: vec![0.5; 40_000] };
    // Each a millionth nearer to a point than the last: no cut in bins leaves more than a few on one side.
    let closing: Vec<Vec3> = (0..3000).map(|k| Vec3::splat(1e9 * 0.97_f32.powi(k))).collect();
    let closing = Spheres { radius: closing.iter().map(|place| 1e-3 * place.x).collect(), center: closing };
    let line = Spheres { center: (0..5000).map(|_| Vec3::X * random.unit()).collect(), radius: vec![1e-4; 5000] };
    for spheres in [particles(30_000, 7).0, one_place, closing, line, particles(17, 8).0, particles(1, 9).0] {
        let cloud = tree(&spheres);
        let count = spheres.center.len();
        let mut seen = vec![0; count];
        let depth = check(&cloud, &spheres, 0, cloud.bounds, &mut seen);
        assert!(seen.iter().all(|&times| times == 1), "{count}");
        assert!(depth <= MOST_DEPTH, "{count}: {depth} deep");
        if count > 1000 {
            // The scene's own arrays take 16 bytes more.
            assert!(cloud.bytes() <= 40 * count as u64, "{} bytes for {count}", cloud.bytes());
        }
    }
}

#[test]
fn trees_are_the_same_at_any_number_of_threads() {
    let (spheres, _) = particles(40_000, 10);
    let build = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| tree(&spheres))
    };
    let one = build(1);
    for threads in [2, 3] {
        let other = build(threads);
        assert_eq!(format!("{:?}{:?}", one.nodes, one.clusters), format!("{:?}{:?}", other.nodes, other.clusters));
    }
}
