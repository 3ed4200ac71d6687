//! The trees held against brute force: random scenes, rays that graze planes and ends, scenes that are hardly one.

use std::collections::BTreeSet;
use std::sync::Arc;

use glam::Vec3;

use super::super::brute::Brute;
use super::super::testing::{Random, random_rays, random_scene};
use super::*;
use crate::lower::{Discs, Spheres, Triangles};

const RIGHT: [ObjectsAccel; 2] = [ObjectsAccel::Bsp, ObjectsAccel::BspSah];
const KINDS: [ObjectsAccel; 3] = [ObjectsAccel::Bsp, ObjectsAccel::BspSah, ObjectsAccel::BspReport];

fn planted(kind: ObjectsAccel, scene: &[(u32, Geometry)]) -> Bsp {
    let tree = Bsp::new(scene.to_vec(), Plan::new(kind, None, None)).unwrap();
    assert_eq!(tree.check(), Ok(()), "{kind:?}");
    tree
}

fn trace(accel: &dyn Accelerator, rays: &RayBatch) -> (HitBatch, Vec<bool>) {
    // What was there before must not show through.
    let (mut hits, mut occluded) = (HitBatch::default(), vec![true; 3]);
    hits.resize(5);
    hits.gave_up.fill(true);
    hits.u.fill(7.0);
    accel.closest(rays, &mut hits, &mut SolveCounts::default());
    accel.occluded(rays, &mut occluded, &mut SolveCounts::default());
    (hits, occluded)
}

fn objects(seed: u64) -> Vec<(u32, Geometry)> {
    let mut scene = random_scene(seed);
    scene.truncate(3);
    scene
}

fn spheres(center: Vec<Vec3>, radius: f32) -> Vec<(u32, Geometry)> {
    let radius = vec![radius; center.len()];
    vec![(4, Geometry::Spheres(Arc::new(Spheres { center, radius })))]
}

/// Rays along axes, between planes and within them, from centres and from corners of triangles, of any length and interval.
fn awkward_rays(tree: &Bsp, seed: u64) -> RayBatch {
    let mut random = Random(seed);
    let mut rays = RayBatch::default();
    let planes: Vec<Node> = tree.nodes.iter().copied().filter(|node| !node.is_leaf()).take(300).collect();
    let axes = [Vec3::X, Vec3::Y, Vec3::Z, Vec3::NEG_X, Vec3::NEG_Y, Vec3::new(-0.0, 0.0, -1.0)];
    for k in 0..3000 {
        let mut origin = random.vector(12.0);
        if !planes.is_empty() {
            // On one plane, or on two.
            for plane in [planes[k % planes.len()], planes[k * 7 % planes.len()]].iter().take(1 + k % 2) {
                origin[plane.tag() as usize] = plane.place();
            }
        }
        if k % 5 == 0 {
            let number = k as u32 % tree.objects.count();
            origin = match tree.objects.get(number) {
                primitive::Primitive::Sphere { center, .. } => center,
                primitive::Primitive::Disc { center, normal, .. } => center + 0.5 * normal,
                primitive::Primitive::Facing { center, radius } => center + 0.5 * radius * Vec3::X,
                primitive::Primitive::Curve { ends, .. } => ends[0],
                primitive::Primitive::Triangle(corners) => corners[0] + random.vector(0.5),
            };
        }
        let mut direction = axes[k % 6] + if k % 4 == 0 { random.vector(1.0) } else { Vec3::ZERO };
        direction *= [1.0, 1e-3, 1e4, 1e-18, 3e14][k % 7 % 5];
        let length = direction.length();
        let tnear = if k % 3 == 0 { 4.0 * random.unit() / length } else { 0.0 };
        let tfar = if k % 11 < 4 { tnear + 6.0 * random.unit() / length } else { f32::INFINITY };
        rays.push(origin, direction, tnear, tfar, 0.0);
    }
    rays
}

/// Compares with brute force; rays that differ, and hits by part.
fn differences(tree: &Bsp, brute: &Brute, rays: &RayBatch) -> (Vec<usize>, [u32; 3]) {
    let ((ours, shadow), (truth, _)) = (trace(tree, rays), trace(brute, rays));
    let (mut differ, mut hits) = (Vec::new(), [0; 3]);
    for index in 0..rays.len() {
        let place = format!("ray {index}");
        assert!(!ours.gave_up[index]);
        assert_eq!(shadow[index], ours.part[index] != NO_PART, "{place}: occlusion and nearest hit");
        let part = truth.part[index];
        if (ours.part[index], ours.primitive[index]) != (part, truth.primitive[index]) {
            differ.push(index);
            continue;
        }
        if part == NO_PART {
            assert_eq!((ours.t[index], ours.u[index]), (f32::INFINITY, 0.0), "{place}");
            continue;
        }
        hits[part as usize % 3] += 1;
        let normal = |hits: &HitBatch| Vec3::from(hits.normal.each_ref().map(|axis| axis[index]));
        let (found, expected) = (normal(&ours), normal(&truth));
        // As Embree is held against brute force: positions within 25 m, 24 bits, less the cosine.
        let direction = rays.direction(index);
        let speed = direction.as_dvec3().length();
        let cosine = expected.as_dvec3().normalize().dot(direction.as_dvec3() / speed).abs();
        let bound = 64.0 * 25.0 * f64::from(f32::EPSILON) / speed / cosine.max(0.01);
        assert!(f64::from((ours.t[index] - truth.t[index]).abs()) <= bound, "{place}: t");
        assert!((found - expected).length() <= 0.01 * expected.length(), "{place}: {found} for {expected}");
        assert!((ours.u[index] - truth.u[index]).abs() < 0.01, "{place}: u");
        assert!((ours.v[index] - truth.v[index]).abs() < 0.01, "{place}: v");
    }
    (differ, hits)
}

#[test]
fn right_trees_agree_with_brute_force() {
    for kind in RIGHT {
        let (mut seen, mut differ) = ([0; 3], 0);
        for seed in 0..4 {
            let scene = objects(seed);
            let (tree, brute) = (planted(kind, &scene), Brute::new(scene));
            for rays in [random_rays(3000, 100 + seed), awkward_rays(&tree, seed)] {
                let (rays_that_differ, hits) = differences(&tree, &brute, &rays);
                // A graze: an edge decided by the last bit.
                differ += rays_that_differ.len();
                (0..3).for_each(|part| seen[part] += hits[part]);
            }
        }
        assert!(seen.iter().all(|&count| count > 1000), "{kind:?}: hits by part {seen:?}");
        assert!(differ <= 3, "{kind:?}: {differ} rays hit other things");
    }
}

/// Primitives that reach out of the leaf that holds them, from the tree itself.
fn reaching(tree: &Bsp) -> BTreeSet<(u32, u32)> {
    let mut reaching = BTreeSet::new();
    let mut todo = vec![(0, tree.bounds)];
    while let Some((at, cell)) = todo.pop() {
        let node = tree.nodes[at as usize];
        if node.is_leaf() {
            for number in tree.leaves.numbers(tree.leaves.runs(node.kind(), (node.value, node.count()))) {
                let whole = tree.objects.get(number).bounds(tree.objects.pad()).unwrap();
                if whole.low.cmplt(cell.low).any() || cell.high.cmplt(whole.high).any() {
                    reaching.insert(tree.objects.name(number));
                }
            }
        } else {
            let [below, above] = cell.split(node.tag() as usize, node.place());
            todo.extend([(node.children(), below), (node.children() + 1, above)]);
        }
    }
    reaching
}

#[test]
fn the_reports_tree_misses_straddlers_and_nothing_else() {
    let mut missed = 0;
    for seed in 0..3 {
        let scene = objects(seed);
        let tree = planted(ObjectsAccel::BspReport, &scene);
        let straddlers = reaching(&tree);
        assert_eq!(tree.straddlers(), straddlers.len() as u64);
        assert_eq!(tree.stats().primitives.last(), Some(&("straddlers".to_owned(), straddlers.len() as u64)));
        let brute = Brute::new(scene);
        let rays = random_rays(3000, seed);
        let truth = trace(&brute, &rays).0;
        for index in differences(&tree, &brute, &rays).0 {
            missed += 1;
            let first = (truth.part[index], truth.primitive[index]);
            assert!(straddlers.contains(&first), "ray {index} should have hit {first:?}");
        }
    }
    assert!(missed > 100, "{missed} rays differ: the scene has straddlers by the hundred");

    // Small spheres far apart, none across a plane: the report's case.
    let center = (0..64).map(|k| Vec3::new((k % 4) as f32, (k / 4 % 4) as f32, (k / 16) as f32)).collect();
    let scene = spheres(center, 0.2);
    let tree = planted(ObjectsAccel::BspReport, &scene);
    assert_eq!(tree.straddlers(), 0);
    assert!(differences(&tree, &Brute::new(scene), &random_rays(3000, 7)).0.is_empty());
}

#[test]
fn a_tree_is_the_same_at_any_number_of_threads() {
    let mut random = Random(3);
    let mut scene = objects(2);
    scene.extend(spheres((0..20_000).map(|_| random.vector(10.0)).collect(), 0.05));
    for kind in KINDS {
        let tree = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| Bsp::new(scene.clone(), Plan::new(kind, None, None)).unwrap())
        };
        let (one, three) = (tree(1), tree(3));
        assert!(one.nodes.len() > 1000);
        assert_eq!(one.nodes, three.nodes, "{kind:?}");
        assert_eq!(one.leaves, three.leaves, "{kind:?}");
        assert_eq!(one.straddlers, three.straddlers);
        assert_eq!(one.check(), Ok(()), "{kind:?}: groves were grafted");
    }
}

#[test]
fn scenes_that_are_hardly_one_are_held() {
    let line = (0..500).map(|k| Vec3::new(k as f32 * 0.01, 0.0, 0.0)).collect();
    let flat = (0..400).map(|k| Vec3::new((k % 20) as f32 * 0.3 - 3.0, 1.0, (k / 20) as f32 * 0.3 - 3.0));
    let (flat, count): (Vec<_>, _) = (flat.collect(), 400);
    let discs = Discs { normal: Some(vec![Vec3::Y; count]), radius: vec![0.2; count], center: flat };
    let wide = Triangles {
        position: vec![Vec3::new(-9.0, 0.5, -9.0), Vec3::new(9.0, 0.5, -9.0), Vec3::new(0.0, 0.5, 9.0)],
        normal: Vec::new(),
        index: vec![[0, 1, 2]; 300],
    };
    let thin = Triangles {
        position: vec![Vec3::ZERO, Vec3::X, 2.0 * Vec3::X, Vec3::Y, Vec3::NAN],
        normal: Vec::new(),
        index: vec![[0, 1, 2], [0, 0, 0], [0, 1, 3], [0, 1, 4]],
    };
    let broken = Spheres {
        center: vec![Vec3::ZERO, Vec3::NAN, Vec3::INFINITY, Vec3::ONE],
        radius: vec![-1.0, 1.0, 1.0, f32::NAN],
    };
    let scenes = [
        ("nothing", vec![]),
        ("empty parts", spheres(vec![], 1.0)),
        ("nothing usable", vec![(0, Geometry::Spheres(Arc::new(broken)))]),
        ("one", spheres(vec![Vec3::ONE], 2.0)),
        ("all identical", spheres(vec![Vec3::ONE; 1000], 2.0)),
        ("identical, wide", vec![(2, Geometry::Triangles(Arc::new(wide)))]),
        ("thin", vec![(2, Geometry::Triangles(Arc::new(thin)))]),
        ("a line", spheres(line, 0.02)),
        ("coplanar", vec![(1, Geometry::Discs(Arc::new(discs)))]),
    ];
    for (name, scene) in scenes {
        for kind in RIGHT {
            let tree = planted(kind, &scene);
            let references: u32 = tree.nodes.iter().filter(|node| node.is_leaf()).map(|node| node.count()).sum();
            assert!(references <= 8 * tree.objects.count(), "{name}, {kind:?}: {references} blocks");
            let brute = Brute::new(scene.clone());
            let mut rays = random_rays(500, 1);
            for x in [-1.0, -0.0, 0.0, 0.3, 1.0, 4.99] {
                for direction in [Vec3::NEG_Y, Vec3::Y, Vec3::X, Vec3::Z, Vec3::new(0.0, -1.0, 1e-3)] {
                    rays.push(Vec3::new(x, 0.5, 0.01) - 3.0 * direction, direction, 0.0, f32::INFINITY, 0.0);
                }
            }
            let (differ, hits) = differences(&tree, &brute, &rays);
            assert!(differ.len() <= 1, "{name}, {kind:?}: {differ:?}");
            let empty = ["nothing", "empty parts", "nothing usable"].contains(&name);
            assert_eq!(hits.iter().sum::<u32>() == 0, empty, "{name}: {hits:?}");
        }
        planted(ObjectsAccel::BspReport, &scene);
    }
}

#[test]
fn far_from_zero_and_very_large_or_small_the_same_things_are_hit() {
    for (offset, size) in [(1e6, 500.0), (0.0, 1e-6), (0.0, 1e9), (3e4, 1.0)] {
        let mut random = Random(8);
        let offset = Vec3::new(offset, 0.0, -offset);
        let center: Vec<Vec3> = (0..600).map(|_| offset + random.vector(10.0 * size)).collect();
        let scene = spheres(center, 0.7 * size);
        let mut rays = RayBatch::default();
        for _ in 0..2000 {
            rays.push(offset + random.vector(12.0 * size), random.vector(1.0), 0.0, f32::INFINITY, 0.0);
        }
        let (truth, _) = trace(&Brute::new(scene.clone()), &rays);
        for kind in RIGHT {
            let (ours, _) = trace(&planted(kind, &scene), &rays);
            let differ = (0..rays.len()).filter(|&k| ours.primitive[k] != truth.primitive[k]).count();
            assert!(differ <= 2, "{kind:?} at {offset}: {differ} rays");
            assert!(truth.part.iter().filter(|&&part| part != NO_PART).count() > 500);
        }
    }
}

/// A wavy sheet of triangles over 20 x 20 m.
fn sheet(side: u32) -> Triangles {
    let step = 20.0 / side as f32;
    let place = |k: u32| {
        let (x, z) = ((k % (side + 1)) as f32 * step - 10.0, (k / (side + 1)) as f32 * step - 10.0);
        Vec3::new(x, 0.3 * (x + 0.5 * z).sin(), z)
    };
    let corners = |k: u32| {
        let a = k / side * (side + 1) + k % side;
        [[a, a + side + 1, a + 1], [a + 1, a + side + 1, a + side + 2]]
    };
    Triangles {
        position: (0..(side + 1) * (side + 1)).map(place).collect(),
        normal: Vec::new(),
        index: (0..side * side).flat_map(corners).collect(),
    }
}

#[test]
fn no_ray_slips_between_cells_or_triangles() {
    let mesh = sheet(32);
    let mut random = Random(4);
    let mut rays = RayBatch::default();
    for k in 0..60_000 {
        // Points of edges, away from the sheet's border; every fourth a corner; half of the rays straight down, where edges
        // along x and z lie in the trees' own planes.
        let triangle = mesh.index[random.0 as usize % mesh.index.len()];
        let [a, b, c] = triangle.map(|corner| mesh.position[corner as usize]);
        let along = if k % 4 == 0 { 0.0 } else { random.unit() };
        let target = [a + (b - a) * along, b + (c - b) * along, c + (a - c) * along][k % 3];
        if target.x.abs() > 9.5 || target.z.abs() > 9.5 {
            continue;
        }
        let from =
            if k % 2 == 0 { target + 5.0 * Vec3::Y } else { target + Vec3::new(0.0, 6.0, 0.0) + random.vector(5.0) };
        rays.push(from, target - from, 0.0, f32::INFINITY, 0.0);
    }
    let scene = vec![(0, Geometry::Triangles(Arc::new(mesh)))];
    for kind in RIGHT {
        for leaf in [1, 4] {
            let tree = Bsp::new(scene.clone(), Plan::new(kind, None, Some(leaf))).unwrap();
            assert_eq!(tree.check(), Ok(()));
            let (hits, shadow) = trace(&tree, &rays);
            let through = (0..rays.len()).filter(|&k| hits.part[k] == NO_PART || !shadow[k]).count();
            assert_eq!(through, 0, "{kind:?} of {} rays", rays.len());
        }
    }
}

#[test]
fn depth_and_leaves_are_as_asked() {
    let scene = objects(1);
    for kind in KINDS {
        for (depth, leaf) in [(0, 1), (3, 1), (60, 1), (20, 1000)] {
            let tree = Bsp::new(scene.clone(), Plan::new(kind, Some(depth), Some(leaf))).unwrap();
            // The check holds the tree to its depth.
            assert_eq!(tree.check(), Ok(()));
            assert_eq!(tree.nodes.len() == 1, depth == 0 || leaf == 1000, "{kind:?} {depth} {leaf}");
        }
    }
}

#[test]
fn what_is_no_ray_hits_nothing_and_ends_are_inclusive() {
    let scene = spheres(vec![Vec3::ZERO], 1.0);
    let origin = Vec3::new(0.0, 0.0, -3.0);
    for kind in KINDS {
        let tree = planted(kind, &scene);
        let mut rays = RayBatch::default();
        for (direction, tnear, tfar) in [
            (Vec3::ZERO, 0.0, 9.0),
            (Vec3::new(0.0, f32::NAN, 1.0), 0.0, 9.0),
            (Vec3::Z, -1.0, 9.0),
            (Vec3::Z, 5.0, 5.0),
            (Vec3::Z, f32::NAN, 9.0),
            (Vec3::Z, 0.0, 2.0_f32.next_down()),
            (Vec3::Z, 4.0_f32.next_up(), 9.0),
            // And those that are, and hit.
            (Vec3::Z, 0.0, 2.0),
            (Vec3::Z, 2.0, 9.0),
            (Vec3::Z, 2.0_f32.next_up(), 4.0),
            (Vec3::Z, 4.0, 9.0),
        ] {
            rays.push(origin, direction, tnear, tfar, 0.0);
        }
        let (hits, occluded) = trace(&tree, &rays);
        assert_eq!(hits.t[7..], [2.0, 2.0, 4.0, 4.0]);
        assert!(hits.t[..7].iter().all(|&t| t == f32::INFINITY) && !occluded[..7].contains(&true));
        assert!(occluded[7..].iter().all(|&hit| hit));
    }
}

#[test]
fn surfaces_are_refused_and_stats_are_filled_in() {
    let error = Bsp::new(random_scene(1), Plan::new(ObjectsAccel::Bsp, None, None)).unwrap_err().to_string();
    assert_eq!(error, "part 3 is a surface, expected spheres, discs, curves or triangles");
    for kind in KINDS {
        let stats = planted(kind, &objects(1)).stats();
        assert_eq!(stats.name, kind.name());
        // Each primitive once at the least: 20 to 40 bytes.
        assert!(stats.bytes > 900 * 20 && stats.bytes < 900 * 2000 && stats.build_seconds > 0.0, "{stats:?}");
        assert_eq!(stats.primitives[..3].iter().map(|kind| kind.1).sum::<u64>(), 900);
    }
}
