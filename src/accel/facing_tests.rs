//! Discs that face each ray's origin: every accelerator against brute force, and what they are for rays from afar and from
//! within.

use std::sync::Arc;

use glam::Vec3;

use super::brute::Brute;
use super::testing::{Random, random_rays};
use super::*;

fn trace(accel: &dyn Accelerator, rays: &RayBatch) -> (HitBatch, Vec<bool>) {
    let (mut hits, mut occluded) = (HitBatch::default(), Vec::new());
    accel.closest(rays, &mut hits, &mut SolveCounts::default());
    accel.occluded(rays, &mut occluded, &mut SolveCounts::default());
    (hits, occluded)
}

/// Facing discs (part 0) among as many fixed ones (part 1).
fn scene(count: usize, scale: f32, seed: u64) -> Vec<(u32, Geometry)> {
    let mut random = Random(seed);
    let mut discs = |normal: bool| {
        let center = (0..count).map(|_| random.vector(10.0 * scale)).collect();
        let radius = (0..count).map(|_| (0.1 + random.unit()) * scale).collect();
        let normal = normal.then(|| (0..count).map(|_| random.vector(1.0).normalize_or(Vec3::Y)).collect());
        Geometry::Discs(Arc::new(Discs { center, radius, normal }))
    };
    vec![(0, discs(false)), (1, discs(true))]
}

#[test]
fn all_accelerators_agree_on_discs_that_face_each_ray() {
    for (round, scale) in [1e-3, 1.0, 100.0_f32].into_iter().enumerate() {
        let scene = scene(300, scale, 70 + round as u64);
        let mut rays = random_rays(4000, 80 + round as u64);
        for origin in &mut rays.origin {
            origin.iter_mut().for_each(|value| *value *= scale);
        }
        rays.tfar.iter_mut().for_each(|value| *value *= scale);
        let (truth, dark) = trace(&Brute::new(scene.clone()), &rays);
        assert!(truth.part.iter().filter(|&&part| part == 0).count() > 400);
        let bsp = |kind| Bsp::new(scene.clone(), Plan::new(kind, None, None)).unwrap();
        let all: [(&str, Box<dyn Accelerator>); 4] = [
            ("clusters", Box::new(EmbreeAccel::new(&scene).unwrap())),
            ("points", Box::new(EmbreeAccel::with_points(&scene).unwrap())),
            ("bsp", Box::new(bsp(ObjectsAccel::Bsp))),
            ("bsp-sah", Box::new(bsp(ObjectsAccel::BspSah))),
        ];
        for (name, accel) in &all {
            let (hits, occluded) = trace(accel.as_ref(), &rays);
            let mut edges = 0;
            for index in 0..rays.len() {
                let same = hits.part[index] == truth.part[index]
                    && hits.primitive[index] == truth.primitive[index]
                    && occluded[index] == dark[index];
                if !same {
                    edges += 1;
                } else if hits.part[index] == 0 {
                    let (t, exact) = (hits.t[index], truth.t[index]);
                    assert!((t - exact).abs() <= 1e-3 * (scale + exact), "{name}: {t} {exact}");
                    let normal = |hits: &HitBatch| Vec3::from(hits.normal.each_ref().map(|axis| axis[index]));
                    assert!((normal(&hits) - normal(&truth)).length() <= 1e-4 * normal(&truth).length(), "{name}");
                }
            }
            assert!(edges <= 3, "{name}, {scale}: {edges} differ");
        }
    }
}

#[test]
fn a_facing_disc_fills_the_same_cone_from_everywhere_and_nothing_from_within() {
    let (center, radius) = (Vec3::new(3.0, -1.0, 2.0), 0.7);
    let discs = Discs { center: vec![center], radius: vec![radius], normal: None };
    let scene = vec![(0, Geometry::Discs(Arc::new(discs)))];
    let all: [Box<dyn Accelerator>; 3] = [
        Box::new(EmbreeAccel::new(&scene).unwrap()),
        Box::new(Bsp::new(scene.clone(), Plan::new(ObjectsAccel::BspSah, None, None)).unwrap()),
        Box::new(Brute::new(scene)),
    ];
    let mut random = Random(90);
    for accel in &all {
        let mut rays = RayBatch::default();
        let (mut within, mut met) = (Vec::new(), Vec::new());
        for _ in 0..2000 {
            let way = random.vector(1.0).normalize_or(Vec3::Y);
            let far = 2.5 * radius;
            let across = way.any_orthonormal_vector();
            // On the line from a point far away, to just inside and just outside of the disc's rim.
            for (share, hit) in [(0.0, true), (0.999, true), (1.001, false)] {
                let direction = center + share * radius * across - (center + far * way);
                rays.push(center + far * way, direction, 0.0, f32::INFINITY, 0.0);
                within.push(false);
                met.push(hit);
            }
            // From inside of the ball, and on from a hit on the disc.
            let inside = center + 0.99 * radius * random.unit() * way;
            rays.push(inside, random.vector(1.0), 0.0, f32::INFINITY, 0.0);
            within.push(true);
            met.push(false);
        }
        rays.push(center, Vec3::X, 0.0, f32::INFINITY, 0.0);
        within.push(true);
        met.push(false);
        let (hits, occluded) = trace(accel.as_ref(), &rays);
        for index in 0..rays.len() {
            assert!(!hits.t[index].is_nan());
            assert_eq!(hits.part[index] == 0, met[index], "ray {index}, within: {}", within[index]);
            assert_eq!(occluded[index], met[index]);
            if met[index] {
                assert!((hits.t[index] - 1.0).abs() < 1e-4);
            }
        }
        // The same ray beyond its hit meets it no more.
        let mut beyond = RayBatch::default();
        for index in (0..rays.len()).filter(|&index| met[index]) {
            let tnear = hits.t[index].next_up();
            beyond.push(rays.origin(index), rays.direction(index), tnear, f32::INFINITY, 0.0);
        }
        let (again, _) = trace(accel.as_ref(), &beyond);
        assert!(again.part.iter().all(|&part| part == NO_PART));
    }
}
