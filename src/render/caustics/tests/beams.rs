//! Beams: energy, what stops them, and the manifold as their referee.

use std::sync::Arc;

use glam::Vec3;

use super::{super::*, WATER, connect, surface};
use crate::accel;
use crate::lower::{Lowered, Material, Part, Shape, Triangles};
use crate::optics::fresnel::reflectance_exact;
use crate::scene::{Accel, ObjectsAccel, WaterAccel};
use crate::surface::{SimdLevel, SplineSurface};

const DEPTH: f32 = 1.2;

fn gentle(columns: usize) -> SplineSurface {
    surface(4, [columns; 2], [0.1; 2], |x, z| 0.022 * (4.0 * x + z).sin() + 0.02 * (5.0 * z - x).sin())
}

fn rectangle(height: f32, x: [f32; 2], z: [f32; 2]) -> Shape {
    let position = vec![
        Vec3::new(x[0], height, z[0]),
        Vec3::new(x[0], height, z[1]),
        Vec3::new(x[1], height, z[1]),
        Vec3::new(x[1], height, z[0]),
    ];
    Shape::Triangles(Arc::new(Triangles { position, normal: Vec::new(), index: vec![[0, 1, 2], [0, 2, 3]] }))
}

/// A map of the water over a wide flat bed, with further things.
fn map(water: SplineSurface, sun: Vec3, resolution: u32, things: Vec<Shape>) -> BeamMap {
    let water = Arc::new(water);
    let part = |material, shape| Part { name: String::new(), material, shape };
    let mut parts = vec![
        part(Material::Water, Shape::Surface(Arc::clone(&water))),
        part(Material::Diffuse(Vec3::ONE), rectangle(-DEPTH, [-20.0, 20.0], [-20.0, 20.0])),
    ];
    parts.extend(things.into_iter().map(|shape| part(Material::Diffuse(Vec3::ONE), shape)));
    let lowered = Lowered { parts, ..Lowered::default() };
    let settings = Accel { water: WaterAccel::Brute, objects: ObjectsAccel::Brute, ..Accel::default() };
    let accelerator = accel::build(&lowered, &settings, SimdLevel::detect()).unwrap();
    let reflectance = |cosine: f32| reflectance_exact(cosine, 1.0, WATER);
    let sun = BeamSun {
        direction: sun,
        irradiance: Vec3::new(1.0, 2.0, 3.0),
        ior: WATER,
        attenuation: Vec3::ZERO,
        reflectance: &reflectance,
        clear: &|_| 1.0,
    };
    BeamMap::build(&water, &lowered, &*accelerator, &sun, resolution).unwrap()
}

#[test]
fn flat_water_lights_the_bed_evenly_and_shade_is_dark() {
    let sun = Vec3::new(0.2, 0.9, 0.1).normalize();
    let through = (1.0 - reflectance_exact(sun.y, 1.0, WATER)) * sun.y;
    // A board over the water's west, and one in the water.
    let shade = rectangle(1.0, [-9.0, 0.0], [-9.0, 9.0]);
    let sunk = rectangle(-0.4, [0.9, 1.3], [-0.2, 0.2]);
    let map = map(surface(3, [30; 2], [0.1; 2], |_, _| 0.0), sun, 2, vec![shade, sunk]);
    // The shade's edge moves by the sun's slant, less under water.
    let up = -crate::optics::fresnel::refract(-sun, Vec3::Y, 1.0, WATER).unwrap();
    let edge = -sun.x / sun.y - DEPTH * up.x / up.y;
    for k in 0..40 {
        let x = -1.3 + 0.06 * k as f32;
        let light = map.irradiance(Vec3::new(x, -DEPTH, 0.7), Vec3::Y);
        let expected = if x < edge { 0.0 } else { through };
        // Within a beam's width of the edge the shade is soft, and east of the domain's own slant no light arrives.
        if (x - edge).abs() > 0.16 && x < 1.2 {
            assert!((light - expected * Vec3::new(1.0, 2.0, 3.0)).abs().max_element() < 2e-4, "{x}: {light}");
        }
    }
    let slope = Vec3::new(0.6, 0.8, 0.0);
    let bed = Vec3::new(0.5, -DEPTH, 0.7);
    assert!((map.irradiance(bed, slope).x - 0.8 * through).abs() < 2e-4);
    assert_eq!(map.irradiance(bed, Vec3::NEG_Y), Vec3::ZERO);
    assert_eq!(map.irradiance(bed + 0.5 * Vec3::Y, Vec3::Y), Vec3::ZERO, "nothing landed at that height");
    assert!((map.irradiance(bed + 0.03 * Vec3::Y, Vec3::Y).x - through).abs() < 2e-4, "a tile on the bed");
    // The sunk board has its own light; what lies in its shade on the bed is not lit by it.
    assert!((map.irradiance(Vec3::new(1.1, -0.4, 0.0), Vec3::Y).x - through).abs() < 2e-4);
    assert_eq!(map.irradiance(Vec3::new(1.1, -DEPTH, 0.0), Vec3::Y), Vec3::ZERO);
}

#[test]
fn beams_agree_with_the_manifold() {
    let sun = Vec3::new(0.25, 0.9, -0.15).normalize();
    let water = gentle(40);
    let manifold = Manifold::new(&water);
    let map = map(water, sun, 4, Vec::new());
    let (mut mean, mut expected_mean, mut worst, mut contrast) = (0.0, 0.0, 0.0f32, [f32::MAX, 0.0f32]);
    for k in 0..900 {
        let bed = Vec3::new(0.08 * (k % 30) as f32 - 1.2, -DEPTH, 0.08 * (k / 30) as f32 - 1.2);
        let (found, _) = connect(&manifold, bed, Event::Refraction, Target::Direction(sun), [0.0; 2]);
        let expected: f32 = found
            .iter()
            .map(|c| {
                let through = 1.0 - reflectance_exact(c.to_light.dot(c.facet), 1.0, WATER);
                through * WATER * WATER * c.direction.y * c.spread
            })
            .sum();
        let light = map.irradiance(bed, Vec3::Y).x;
        assert_eq!(found.len(), 1, "these waves are too gentle for folds");
        worst = worst.max((light / expected - 1.0).abs());
        contrast = [contrast[0].min(expected), contrast[1].max(expected)];
        mean += light;
        expected_mean += expected;
    }
    let off = mean / expected_mean - 1.0;
    eprintln!("beams: mean off by {off:.1e}, a point by {worst:.1e} at most, light from {contrast:?}");
    assert!(contrast[1] > 1.5 * contrast[0]);
    assert!(off.abs() < 0.01 && worst < 0.03, "mean {off}, point {worst}");
}

#[test]
fn all_light_that_lands_is_on_the_map_at_any_count_of_threads() {
    let sun = Vec3::new(0.1, 0.95, 0.05).normalize();
    let build = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        // Folds and all; the bed within the domain catches everything but what leaves by its edges.
        pool.install(|| {
            map(surface(3, [20; 2], [0.1; 2], |x, z| 0.05 * (9.0 * x).sin() * (8.0 * z).cos()), sun, 3, vec![])
        })
    };
    let (one, many) = (build(1), build(3));
    assert_eq!(one.landed(), many.landed());
    for k in 0..400 {
        let bed = Vec3::new(0.1 * (k % 20) as f32 - 0.95, -DEPTH, 0.1 * (k / 20) as f32 - 0.95);
        assert_eq!(one.irradiance(bed, Vec3::Y), many.irradiance(bed, Vec3::Y));
    }
    let landed = one.landed();
    assert!(landed.x > 0.8 * 4.0 * 0.95 * 0.97 && landed.x < 4.0 * 0.98, "{landed}");
    assert_eq!(one.solve().gave_up, 0);
    assert!((landed.y - 2.0 * landed.x).abs() < 1e-6);
}

#[test]
fn no_beams_and_too_many_are_refused() {
    let water = gentle(4);
    let lowered = Lowered::default();
    let accelerator = accel::build(&lowered, &Accel::default(), SimdLevel::detect()).unwrap();
    let sun = BeamSun {
        direction: Vec3::Y,
        irradiance: Vec3::ONE,
        ior: WATER,
        attenuation: Vec3::ZERO,
        reflectance: &|_| 0.0,
        clear: &|_| 1.0,
    };
    for resolution in [0, 1 << 20] {
        let error = BeamMap::build(&water, &lowered, &*accelerator, &sun, resolution).unwrap_err();
        assert_eq!(error, BeamError::Resolution { resolution, columns: 16 });
    }
}
