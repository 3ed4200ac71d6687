//! Round curves: Embree and the trees held against brute force, over sizes from a micrometre to a hundred metres.

use std::sync::Arc;

use glam::Vec3;

use super::brute::Brute;
use super::testing::{Random, random_rays, random_scene};
use super::*;

fn trace(accel: &dyn Accelerator, rays: &RayBatch) -> (HitBatch, Vec<bool>) {
    let (mut hits, mut occluded) = (HitBatch::default(), Vec::new());
    accel.closest(rays, &mut hits, &mut SolveCounts::default());
    accel.occluded(rays, &mut occluded, &mut SolveCounts::default());
    (hits, occluded)
}

/// Curves of about `radius` (m) in a cube of half-width `scale`: long, short, of no length, one ball inside of the other,
/// tapering to a point, and some that cannot be hit.
fn curves(count: usize, scale: f32, radius: f32, random: &mut Random) -> Curves {
    let mut curves = Curves::default();
    for index in 0..count {
        let head = random.vector(scale);
        let wide = radius * (0.5 + random.unit());
        let (way, narrow) = match index % 8 {
            0 => (Vec3::ZERO, wide),
            1 => (Vec3::ZERO, 0.3 * wide),
            2 => (random.vector(0.2 * wide), 0.3 * wide),
            3 => (random.vector(30.0 * radius), 0.0),
            4 => (random.vector(3.0 * radius), 2.0 * wide),
            5 => (random.vector(0.5 * scale), wide),
            _ => (random.vector(10.0 * radius), 0.25 * wide),
        };
        let narrow = if index % 50 == 49 { f32::NAN } else { narrow };
        curves.ends.push([head, head + way]);
        curves.radius.push([wide, narrow]);
    }
    curves
}

/// Rays from `far` (m) away, aimed at points in and around curves; some begin inside, some end early.
fn aimed(curves: &Curves, count: usize, far: f32, random: &mut Random) -> RayBatch {
    let mut rays = RayBatch::default();
    for index in 0..count {
        let curve = index % curves.ends.len();
        let [head, tail] = curves.ends[curve];
        let target = head.lerp(tail, random.unit()) + random.vector(1.2 * curves.radius[curve][0]);
        let direction = random.vector(1.0).normalize_or(Vec3::X) * [1.0, 1e-2, 300.0][index % 3];
        let back = if index % 7 == 0 { 0.0 } else { far / direction.length() };
        let tfar = if index % 11 == 0 { back * random.unit() } else { f32::INFINITY };
        rays.push(target - back * direction, direction, 0.0, tfar, 0.0);
    }
    rays
}

#[test]
fn embree_and_trees_agree_with_brute_force_on_curves_of_any_size() {
    for (round, radius) in [1e-6, 1e-4, 1e-2, 1.0, 100.0_f32].into_iter().enumerate() {
        let mut random = Random(40 + round as u64);
        let scale = 40.0 * radius;
        let curves = Arc::new(curves(250, scale, radius, &mut random));
        let scene = vec![(6, Geometry::Curves(Arc::clone(&curves)))];
        let rays = aimed(&curves, 6000, 3.0 * scale, &mut random);
        let (truth, shadow) = trace(&Brute::new(scene.clone()), &rays);
        let accelerators: [(&str, Box<dyn Accelerator>); 3] = [
            ("embree", Box::new(EmbreeAccel::new(&scene).unwrap())),
            ("bsp", Box::new(Bsp::new(scene.clone(), Plan::new(ObjectsAccel::Bsp, None, None)).unwrap())),
            ("bsp-sah", Box::new(Bsp::new(scene.clone(), Plan::new(ObjectsAccel::BspSah, None, None)).unwrap())),
        ];
        for (name, accelerator) in accelerators {
            assert_eq!(accelerator.stats().primitives, [("curves".to_owned(), 250)]);
            let (ours, our_shadow) = trace(&*accelerator, &rays);
            let (mut hits, mut ties) = (0, 0);
            for index in 0..rays.len() {
                assert_eq!(shadow[index], truth.part[index] != NO_PART);
                assert_eq!(our_shadow[index], ours.part[index] != NO_PART, "{name}, {radius} m, ray {index}");
                if (ours.part[index], ours.primitive[index]) != (truth.part[index], truth.primitive[index]) {
                    ties += 1;
                    continue;
                }
                if truth.part[index] == NO_PART {
                    continue;
                }
                hits += 1;
                let (curve, speed) = (truth.primitive[index] as usize, rays.direction(index).length());
                assert!(curve % 50 != 49, "a curve without a radius was hit");
                let normal = |hits: &HitBatch| Vec3::from(hits.normal.each_ref().map(|axis| axis[index])).normalize();
                let (found, expected) = (normal(&ours), normal(&truth));
                let cosine = expected.dot(rays.direction(index) / speed).abs();
                // Places are within 5 scales, and numbers 24 bits: 16 roundings of those. Grazing hits lose a factor of
                // 1 / cos.
                let off = (ours.t[index] - truth.t[index]).abs() * speed * cosine.max(0.01) / scale;
                let bound = 16.0 * 5.0 * f32::EPSILON;
                assert!(off < bound, "{name}, {radius} m, ray {index}, curve {curve}: {off:e} scales, cosine {cosine}");
                // A tip has every normal.
                if cosine > 0.1 && curve % 8 != 3 {
                    assert!((found - expected).length() < 0.02, "{name}, {radius} m, ray {index}: {found} {expected}");
                    let [head, tail] = curves.ends[curve];
                    let [a, b] = curves.radius[curve];
                    let long = (tail - head).length() > 2.0 * a.max(b);
                    let apart = (ours.u[index] - truth.u[index]).abs();
                    assert!(!long || apart < 0.02, "{name}, {radius} m, ray {index}: u is off by {apart}");
                }
            }
            // Grazes, which the last bit decides, and two curves in one place.
            assert!(hits > 3000 && ties <= 6, "{name}, {radius} m: {hits} hits, {ties} differ");
        }
    }
}

#[test]
fn clusters_and_embrees_own_curves_are_hit_alike_where_these_are_sound() {
    let mut random = Random(77);
    let mut curves = Curves::default();
    for index in 0..300 {
        let head = random.vector(10.0);
        curves.ends.push([head, head + (1.0 + random.unit()) * random.vector(1.0).normalize_or(Vec3::Y)]);
        curves.radius.push([0.2, [0.2, 0.05][index % 2]]);
    }
    let rays = aimed(&curves, 3000, 30.0, &mut random);
    let scene = [(0, Geometry::Curves(Arc::new(curves)))];
    let (ours, embrees) = (EmbreeAccel::new(&scene).unwrap(), EmbreeAccel::with_points(&scene).unwrap());
    let ((ours, _), (embrees, _)) = (trace(&ours, &rays), trace(&embrees, &rays));
    let (mut hits, mut differ) = (0, 0);
    for index in 0..rays.len() {
        let speed = rays.direction(index).length();
        let same = ours.primitive[index] == embrees.primitive[index] && ours.part[index] == embrees.part[index];
        if same && ours.part[index] != NO_PART {
            hits += 1;
            differ += usize::from((ours.t[index] - embrees.t[index]).abs() * speed > 0.01);
        }
        differ += usize::from(!same);
    }
    assert!(hits > 1500 && differ < 15, "{hits} hits, {differ} differ");
}

#[test]
fn a_hit_on_a_curve_does_not_depend_on_the_rays_beside_it() {
    let mut random = Random(3);
    let mut scene = random_scene(5);
    scene.push((9, Geometry::Curves(Arc::new(curves(1500, 10.0, 0.3, &mut random)))));
    let accel = EmbreeAccel::new(&scene).unwrap();
    let rays = random_rays(1600, 6);
    let (together, shadow) = trace(&accel, &rays);
    let bits = |hits: &HitBatch, index: usize| {
        let normal = hits.normal.each_ref().map(|axis| axis[index].to_bits());
        (hits.t[index].to_bits(), hits.u[index].to_bits(), normal, hits.part[index], hits.primitive[index])
    };
    let mut found = 0;
    for index in 0..rays.len() {
        let mut alone = RayBatch::default();
        alone.push(
            rays.origin(index),
            rays.direction(index),
            rays.tnear[index],
            rays.tfar[index],
            rays.tolerance[index],
        );
        let (hit, hidden) = trace(&accel, &alone);
        assert_eq!(bits(&hit, 0), bits(&together, index), "{index}");
        assert_eq!(hidden[0], shadow[index], "{index}");
        found += usize::from(hit.part[0] == 9);
    }
    assert!(found > 100, "only {found} rays hit curves");
}

#[test]
fn curves_among_other_things_are_held_by_sound_trees() {
    let mut random = Random(8);
    let mut scene = random_scene(2);
    scene.truncate(3);
    scene.push((3, Geometry::Curves(Arc::new(curves(300, 10.0, 0.6, &mut random)))));
    let brute = Brute::new(scene.clone());
    let rays = random_rays(3000, 9);
    let truth = trace(&brute, &rays).0;
    assert!(truth.part.iter().filter(|&&part| part == 3).count() > 100);
    for kind in [ObjectsAccel::Bsp, ObjectsAccel::BspSah, ObjectsAccel::BspReport] {
        let tree = Bsp::new(scene.clone(), Plan::new(kind, None, None)).unwrap();
        assert_eq!(tree.check(), Ok(()), "{kind:?}");
        if kind == ObjectsAccel::BspReport {
            continue; // It misses what straddles.
        }
        let ours = trace(&tree, &rays).0;
        let differ = (0..rays.len())
            .filter(|&ray| (ours.part[ray], ours.primitive[ray]) != (truth.part[ray], truth.primitive[ray]));
        assert!(differ.count() <= 2, "{kind:?}");
    }
}

#[test]
fn a_hundred_thousand_curves_in_one_place_answer() {
    let ends = vec![[Vec3::ONE, Vec3::new(1.0, 2.0, 1.0)]; 100_000];
    let curves = Curves { radius: vec![[0.5, 0.25]; ends.len()], ends };
    let scene = vec![(0, Geometry::Curves(Arc::new(curves)))];
    let mut rays = RayBatch::default();
    rays.push(Vec3::new(1.0, -9.0, 1.0), Vec3::Y, 0.0, f32::INFINITY, 0.1);
    rays.push(Vec3::new(9.0, 1.0, -9.0), Vec3::Z, 0.0, f32::INFINITY, 0.1);
    let tree = Bsp::new(scene.clone(), Plan::new(ObjectsAccel::BspSah, None, None)).unwrap();
    for accelerator in [&EmbreeAccel::new(&scene).unwrap() as &dyn Accelerator, &tree] {
        let hits = trace(accelerator, &rays).0;
        assert!((hits.t[0] - 9.5).abs() < 1e-5, "{}", hits.t[0]);
        assert_eq!(hits.part[1], NO_PART);
    }
}
