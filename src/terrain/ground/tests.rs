//! What the ground must keep to wherever it is asked.

use super::*;
use proptest::prelude::*;
use std::f32::consts::TAU as TURN;

fn natural(width: f64) -> Ground {
    Ground::build(&scene::Terrain::default(), width, DVec3::new(1234.5, 10.0, -777.0))
}

fn at(position: Vec3, normal: Vec3, height: f32) -> GroundPoint {
    GroundPoint { position, normal, height_above_water: height, water_depth: (-height).max(0.0) }
}

/// Mean albedo of many places of one kind.
fn mean(ground: &Ground, normal: Vec3, height: f32) -> Vec3 {
    let count = 4000;
    let place = |i: i32| Vec3::new(i as f32 * 0.731, 0.3 * (i % 50) as f32, i as f32 * 0.377);
    (0..count).map(|i| ground.albedo(&at(place(i), normal, height), 0.0)).sum::<Vec3>() / count as f32
}

#[test]
fn plain_ground_is_plain() {
    let terrain = scene::Terrain { ground: scene::Ground::Plain, albedo: [0.1, 0.2, 0.3], ..Default::default() };
    let ground = Ground::build(&terrain, 1.0, DVec3::ZERO);
    let point = at(Vec3::new(3.0, 1.0, 2.0), Vec3::new(0.6, 0.8, 0.0), -0.1);
    assert_eq!(ground.look(&point, 0.0), (Vec3::new(0.1, 0.2, 0.3), point.normal));
    assert_eq!(ground.albedo(&point, 1.0), Vec3::new(0.1, 0.2, 0.3));
    assert_eq!(ground.bump(&point, 1.0), point.normal);
}

#[test]
fn grass_grows_high_and_level_sand_lies_low_and_steep_ground_is_rock() {
    for width in [0.25, 90.0] {
        let ground = natural(width);
        let meadow = mean(&ground, Vec3::Y, 1e4);
        // Green among dry grass and bare soil: greener than any of the other grounds, and far from grey.
        assert!(meadow.y > 0.9 * meadow.x && meadow.y > 1.8 * meadow.z, "{width}: {meadow}");
        let shore = 0.06 * (20.0 * width as f32).powf(0.6);
        let beach = mean(&ground, Vec3::Y, 0.9 * shore.max(0.6));
        assert!(beach.x > beach.y && beach.y > beach.z && beach.y < 0.9 * beach.x, "{width}: {beach}");
        let cliff = mean(&ground, Vec3::new(0.8, 0.6, 0.0), 1e4);
        assert!(cliff.z > 0.7 * cliff.x && cliff.z > 2.0 * meadow.z, "{width}: {cliff}");
    }
}

#[test]
fn what_water_reaches_is_dark() {
    let ground = natural(0.25);
    // Just above the waterline; what lies under it is darkened by the surface that the renderer puts over it.
    let (wet, dry) = (mean(&ground, Vec3::Y, 0.005), mean(&ground, Vec3::Y, 0.25));
    assert!(wet.y < 0.75 * dry.y, "{wet} {dry}");
    // The law itself: white stays nearly white but for the film's own mirror, mid grey halves.
    assert!((super::wet(Vec3::ONE) - Vec3::splat(0.934)).abs().max_element() < 1e-3);
    assert!((super::wet(Vec3::splat(0.3)).x - 0.1718).abs() < 1e-3);
    // Without any water in the scene nothing is wet.
    assert!(mean(&ground, Vec3::Y, f32::INFINITY).is_finite());
}

#[test]
fn a_wide_pixel_sees_the_mean_and_no_bumps() {
    let ground = natural(0.25);
    let first = ground.look(&at(Vec3::ZERO, Vec3::Y, 50.0), 100.0);
    for i in 1..50 {
        let point = at(Vec3::new(i as f32 * 7.3, 0.0, i as f32 * -3.1), Vec3::Y, 50.0);
        assert_eq!(ground.look(&point, 100.0), first);
    }
    assert_eq!(first.1, Vec3::Y);
    // And that mean is the mean, as far as borders between materials let it.
    let mean = mean(&ground, Vec3::Y, 50.0);
    assert!((first.0 - mean).abs().max_element() < 0.35 * mean.max_element(), "{} {mean}", first.0);
}

#[test]
fn neighbouring_points_look_alike_at_a_pixels_scale() {
    // Steps of a fifth of the footprint: no jump, so nothing to flicker.
    let ground = natural(0.25);
    let footprint = 0.02;
    let mut last = None;
    for i in 0..5000 {
        let position = Vec3::new(i as f32 * footprint * 0.2, 0.0, 3.0 + i as f32 * footprint * 0.05);
        let albedo = ground.albedo(&at(position, Vec3::Y, 0.3), footprint);
        if let Some(last) = last {
            assert!((albedo - last as Vec3).abs().max_element() < 0.05, "{i}: {last} {albedo}");
        }
        last = Some(albedo);
    }
}

#[test]
fn the_ground_belongs_to_the_world_and_not_to_the_local_frame() {
    let terrain = scene::Terrain::default();
    let here = DVec3::new(5e5, 20.0, 4e6);
    let shift = DVec3::new(3.0, 1.0, -8.0);
    let (a, b) = (Ground::build(&terrain, 0.25, here), Ground::build(&terrain, 0.25, here + shift));
    for i in 0..100 {
        let p = Vec3::new(i as f32 * 0.13, 0.4, i as f32 * -0.07);
        let one = a.albedo(&at(p, Vec3::Y, 0.4), 0.01);
        let other = b.albedo(&at(p - shift.as_vec3(), Vec3::Y, 0.4), 0.01);
        assert!((one - other).abs().max_element() < 0.01, "{i}: {one} {other}");
    }
}

proptest! {
    #[test]
    fn albedos_are_natural_and_normals_unit_anywhere(
        x in -1e5f32..1e5, y in -1e4f32..1e4, z in -1e5f32..1e5, tilt in 0.0f32..1.5, turn in 0.0f32..TURN,
        height in prop_oneof![-10f32..10.0, Just(f32::INFINITY), Just(f32::MAX), Just(f32::MIN)],
        footprint in prop_oneof![0.0f32..10.0, Just(f32::INFINITY), Just(1e-30)], width in 1e-3f64..1e4,
    ) {
        let normal = Vec3::new(tilt.sin() * turn.cos(), tilt.cos(), tilt.sin() * turn.sin());
        let (albedo, bumped) = natural(width).look(&at(Vec3::new(x, y, z), normal, height), footprint);
        prop_assert!(albedo.min_element() > 0.004 && albedo.max_element() < 0.6, "{albedo}");
        prop_assert!((bumped.length() - 1.0).abs() < 1e-5);
        prop_assert!(bumped.dot(normal) > 0.2, "{}", bumped.dot(normal));
    }
}
