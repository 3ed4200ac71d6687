//! Flat water, where everything has a closed form, and what is no question at all.

use glam::Vec3;

use super::{super::*, WATER, connect, surface};
use crate::optics::fresnel::refract;

fn unit(elevation: f32, azimuth: f32) -> Vec3 {
    Vec3::new(elevation.cos() * azimuth.cos(), elevation.sin(), elevation.cos() * azimuth.sin())
}

fn close(a: f32, b: f32, share: f32) -> bool {
    (a - b).abs() <= share * b.abs()
}

#[test]
fn the_sun_under_flat_water_stands_where_snell_puts_it() {
    for order in 2..=4 {
        let manifold = Manifold::new(&surface(order, [60, 40], [0.1, 0.15], |_, _| 0.3));
        for k in 0..60 {
            let (elevation, azimuth) = (0.1 + 0.024 * k as f32, 0.7 * k as f32);
            let sun = unit(elevation, azimuth);
            let from = Vec3::new(0.01 * k as f32 - 0.3, -1.0 - 0.01 * k as f32, 0.2);
            let (found, counts) = connect(&manifold, from, Event::Refraction, Target::Direction(sun), [0.0; 2]);
            assert_eq!((found.len(), counts.gave_up), (1, 0), "order {order}, sun {sun}");
            let connection = found[0];
            let up = -refract(-sun, Vec3::Y, 1.0, WATER).unwrap();
            let distance = (0.3 - from.y) / up.y;
            assert!((connection.surface - (from + distance * up)).length() < 2e-6);
            assert!((connection.direction - up).length() < 1e-6 && close(connection.distance, distance, 1e-6));
            assert_eq!((connection.normal, connection.facet), (Vec3::Y, Vec3::Y));
            assert!((connection.to_light - sun).length() < 2e-7);
            assert_eq!(connection.light_distance, f32::INFINITY);
            // Radiance n² denser in a cone n² narrower, by the cosines: dΩ_w sin θ_w … = n² dΩ cos.
            let expected = sun.y / (WATER * WATER * up.y);
            assert!(close(connection.spread, expected, 2e-5), "{} for {expected}", connection.spread);
        }
    }
}

#[test]
fn a_lamp_over_flat_water_has_the_spread_of_both_legs() {
    let manifold = Manifold::new(&surface(3, [60, 60], [0.1, 0.1], |_, _| 0.0));
    for k in 0..40 {
        let (depth, height, reach) = (0.5 + 0.03 * k as f32, 0.4 + 0.05 * k as f32, 0.04 * k as f32);
        let from = Vec3::new(0.02, -depth, 0.01);
        let lamp = Vec3::new(0.02 + reach, height, 0.01);
        let (found, counts) = connect(&manifold, from, Event::Refraction, Target::Point(lamp), [0.0; 2]);
        assert_eq!((found.len(), counts.gave_up), (1, 0));
        let c = found[0];
        let (sin_w, sin_a) = ((1.0 - c.direction.y.powi(2)).sqrt(), (1.0 - c.to_light.y.powi(2)).sqrt());
        assert!((WATER * sin_w - sin_a).abs() < 2e-6);
        assert!((c.surface + c.light_distance * c.to_light - lamp).length() < 3e-6);
        assert!((from + c.distance * c.direction - c.surface).length() < 3e-6);
        // Independent: reach(θ) = depth tan θ_w + height tan θ_a. In the plane of incidence and across it.
        let (cw, ca) = (f64::from(c.direction.y), f64::from(c.to_light.y));
        let n = f64::from(WATER);
        let (depth, height) = (f64::from(depth), f64::from(height));
        // Across the beam at the lamp, per angle at the point, in the plane: (depth/cw² + height n cw/ca³) ca.
        let in_plane = (depth / (cw * cw) + height * n * cw / (ca * ca * ca)) * ca;
        // And across the plane: a turn about the vertical through the point by dφ = dω / sin θ_w moves by reach dφ.
        let sideways = depth / cw + height / ca * n;
        let expected = 1.0 / (in_plane * sideways);
        assert!(close(c.spread, expected as f32, 1e-4), "{} for {expected}", c.spread);
    }
}

#[test]
fn flat_water_mirrors_sun_and_lamp_once() {
    let manifold = Manifold::new(&surface(3, [60, 60], [0.1, 0.1], |_, _| 0.0));
    let from = Vec3::new(-0.3, 0.7, 0.2);
    let sun = unit(0.9, 0.5);
    let (found, counts) = connect(&manifold, from, Event::Reflection, Target::Direction(sun), [0.0; 2]);
    assert_eq!((found.len(), counts.gave_up), (1, 0));
    assert!((found[0].direction - Vec3::new(sun.x, -sun.y, sun.z)).length() < 1e-6);
    assert!(close(found[0].spread, 1.0, 1e-5));
    let lamp = Vec3::new(1.0, 1.2, -0.4);
    let (found, counts) = connect(&manifold, from, Event::Reflection, Target::Point(lamp), [0.0; 2]);
    assert_eq!((found.len(), counts.gave_up), (1, 0));
    let path = (lamp - Vec3::new(from.x, -from.y, from.z)).length();
    assert!(close(found[0].distance + found[0].light_distance, path, 1e-6));
    assert!(close(found[0].spread, 1.0 / (path * path), 1e-5));
}

#[test]
fn light_does_not_come_through_the_wrong_side() {
    let manifold = Manifold::new(&surface(3, [30, 30], [0.1, 0.1], |_, _| 0.0));
    let sun = unit(1.0, 0.0);
    let below = Vec3::new(0.0, -0.4, 0.0);
    for (from, event, target) in [
        (below, Event::Reflection, Target::Direction(sun)),
        (-below, Event::Refraction, Target::Direction(sun)),
        (below, Event::Refraction, Target::Direction(Vec3::new(sun.x, -sun.y, sun.z))),
        (below, Event::Refraction, Target::Point(Vec3::new(0.3, -1.0, 0.0))),
        (-below, Event::Reflection, Target::Point(Vec3::new(0.3, -1.0, 0.0))),
        // Beyond the water's end.
        (Vec3::new(2.5, -0.4, 0.0), Event::Refraction, Target::Direction(Vec3::Y)),
    ] {
        let (found, counts) = connect(&manifold, from, event, target, [0.0; 2]);
        assert_eq!((found.len(), counts.gave_up), (0, 0), "{from} {event:?} {target:?}");
    }
}
