//! Scenes whose radiance is known in closed form.

use super::*;
use crate::optics::{Sun, fresnel};

/// Unit vector towards a sun.
fn towards_sun(elevation: f64, azimuth: f64) -> Vec3 {
    let sun = crate::scene::Sun { elevation, azimuth, ..crate::scene::Sun::default() };
    Sun::build(&sun, &crate::scene::Sky::default()).direction
}

fn lossless(scene: &mut Scene) {
    scene.water.absorption = [0.0; 3];
}

fn assert_all(picture: &Picture, name: &str, expected: f32, tolerance: f32) {
    for (index, &value) in samples(picture, name).iter().enumerate() {
        assert!((value - expected).abs() <= tolerance * expected, "{name} of pixel {index}: {value}, not {expected}");
    }
}

#[test]
fn white_furnace_closed_water_returns_the_sky() {
    for (eye, look_at) in [([3.0, 2.2, 4.0], [0.0; 3]), ([2.5, -1.0, 0.3], [0.0; 3]), ([0.2, 3.0, 0.1], [0.0; 3])] {
        for fresnel in [crate::scene::Fresnel::Exact, crate::scene::Fresnel::Schlick] {
            let mut scene = uniform(0.7, 24);
            lossless(&mut scene);
            scene.water.fresnel = fresnel;
            let water = mesh(cuboid(Vec3::new(-1.0, -0.6, -1.3), Vec3::new(1.1, 0.6, 0.9)));
            let (picture, stats) =
                Setup::new(scene, vec![part("water", Material::Water, water)], eye, look_at).render();
            for name in ["R", "G", "B"] {
                assert_all(&picture, name, 0.7, 1e-3);
            }
            assert_eq!(stats.nonfinite, 0);
            assert!(stats.rays.refraction > 500, "the water is in the picture: {:?}", stats.rays);
        }
    }
}

#[test]
fn white_furnace_lone_ball_of_water_and_lone_white_sphere() {
    let mut scene = uniform(2.5, 24);
    lossless(&mut scene);
    let at = Vec3::new(100.0, 20.0, -300.0);
    let view = ([101.0, 20.5, -297.0], [100.0, 20.0, -300.0]);
    for material in [Material::Water, Material::Diffuse(Vec3::ONE)] {
        let parts = vec![part("ball", material, ball(at, 0.9))];
        let (picture, _) = Setup::new(scene.clone(), parts, view.0, view.1).render();
        assert_all(&picture, "G", 2.5, 1e-3);
    }
}

#[test]
fn white_furnace_eye_in_lossless_water_sees_the_sky() {
    let mut scene = uniform(1.0, 16);
    lossless(&mut scene);
    let water = mesh(cuboid(Vec3::splat(-2.0), Vec3::splat(2.0)));
    let mut setup = Setup::new(scene, vec![part("water", Material::Water, water)], [0.1, 0.3, 0.2], [1.0, 1.4, 0.5]);
    setup.matter.water = Some(2.0);
    let (picture, _) = setup.render();
    assert_all(&picture, "R", 1.0, 1e-3);
}

#[test]
fn white_bed_under_lossless_water_is_invisible() {
    // Uniform sky, white bed: what goes in comes out, so the water must not show: n^2 and the light that the surface
    // returns to the bed have to cancel exactly. The picture stays well inside the squares' rims.
    let mut scene = uniform(1.0, 16);
    lossless(&mut scene);
    scene.camera.fov = 30.0;
    let parts = vec![
        part("water", Material::Water, mesh(level(0.0, 500.0))),
        part("terrain", Material::Ground, mesh(level(-1.0, 500.0))),
    ];
    let mut setup = Setup::new(scene, parts, [0.0, 2.0, 3.0], [0.0; 3]);
    setup.matter = Flat { water: Some(0.0), bed: Some(-1.0), albedo: Vec3::ONE, ..Flat::default() };
    assert_all(&setup.render().0, "G", 1.0, 1e-3);
}

#[test]
fn level_water_over_a_bed_is_fresnel_snell_and_beer_lambert() {
    let (sky, ior, depth, albedo) = (0.8_f32, 1.4_f32, 1.7_f32, 0.35_f32);
    let absorption = [0.4_f32, 0.1, 0.02];
    for elevation in [12.0_f64, 35.0, 70.0] {
        let mut scene = uniform(f64::from(sky), 1);
        scene.water.ior = f64::from(ior);
        scene.water.absorption = absorption.map(f64::from);
        scene.water.highlight = crate::scene::Highlight::None;
        scene.sun = crate::scene::Sun { elevation: 50.0, azimuth: 70.0, irradiance: 2.0, color: Some([1.0; 3]) };
        scene.render.samples = 1;
        let parts = vec![
            part("water", Material::Water, mesh(level(0.0, 40.0))),
            part("terrain", Material::Ground, mesh(level(-depth, 40.0))),
        ];
        let (height, run) = elevation.to_radians().sin_cos();
        let mut setup = Setup::new(scene, parts, [run, height, 0.0], [0.0; 3]);
        setup.matter = Flat { water: Some(0.0), bed: Some(-depth), albedo: Vec3::splat(albedo), ..Flat::default() };
        let (picture, _) = setup.render();

        // By hand, in double precision.
        let (n, sky, depth, albedo) = (f64::from(ior), f64::from(sky), f64::from(depth), f64::from(albedo));
        let snell = |cosine: f64| (1.0 - (1.0 - cosine * cosine) / (n * n)).sqrt();
        let reflectance = |cosine: f64| {
            let below = snell(cosine);
            let (s, p) = ((cosine - n * below) / (cosine + n * below), (n * cosine - below) / (n * cosine + below));
            (s * s + p * p) / 2.0
        };
        let view = height;
        let path = depth / snell(view);
        let sun_cosine = 50.0_f64.to_radians().sin();
        let steps = 20_000;
        let (mut through, mut cosines) = (0.0, 0.0);
        for step in 0..steps {
            let cosine = (f64::from(step) + 0.5) / f64::from(steps);
            let share = (1.0 - reflectance(cosine)) * 2.0 * cosine / f64::from(steps);
            through += share;
            cosines += share * snell(cosine);
        }
        let mean_path = through / cosines;
        let mut reflection = 0.0;
        for (channel, a) in ["R", "G", "B"].into_iter().zip(absorption.map(f64::from)) {
            let attenuate = |length: f64| (-a * length).exp();
            let gain = 1.0 / (1.0 - albedo * (1.0 - through / (n * n)) * attenuate(2.0 * mean_path * depth));
            let out = attenuate(path) * (1.0 - reflectance(view)) / (n * n) * albedo * gain;
            reflection = reflectance(view) * sky;
            let refraction = out * sky * through * attenuate(mean_path * depth);
            let sun_irradiance = 2.0 * (1.0 - reflectance(sun_cosine)) * sun_cosine;
            let caustics = out / std::f64::consts::PI * sun_irradiance * attenuate(depth / snell(sun_cosine));
            for (layer, expected) in [
                (format!("reflection.{channel}"), reflection),
                (format!("refraction.{channel}"), refraction),
                (format!("caustics.{channel}"), caustics),
                (channel.to_owned(), reflection + refraction + caustics),
            ] {
                let got = f64::from(samples(&picture, &layer)[0]);
                assert!((got - expected).abs() < 2e-4 * expected, "{layer} at {elevation}: {got}, not {expected}");
            }
        }
        assert!(reflection > 0.0);
        assert!((f64::from(samples(&picture, "water.path")[0]) - path).abs() < 1e-4);
        assert!((f64::from(samples(&picture, "water.depth")[0]) - depth).abs() < 1e-6);
        assert!((samples(&picture, "Z")[0] - 1.0).abs() < 1e-5);
        assert_eq!(samples(&picture, "N.y")[0], 1.0);
        // The guides: the mirrored share is white, the rest is the bed.
        let r = reflectance(view);
        assert!((f64::from(samples(&picture, "albedo.G")[0]) - (r + (1.0 - r) * albedo)).abs() < 1e-4);
    }
}

#[test]
fn sunlit_card_in_shade_and_out_of_it() {
    let mut scene = uniform(0.3, 1);
    scene.sun = crate::scene::Sun { elevation: 40.0, azimuth: 90.0, irradiance: 3.0, color: Some([1.0; 3]) };
    scene.render.samples = 1;
    let ground = part("terrain", Material::Diffuse(Vec3::splat(0.5)), mesh(level(0.0, 50.0)));
    let towards = towards_sun(40.0, 90.0);
    let open = 0.5 * (0.3 + 3.0 * 40.0_f32.to_radians().sin() / std::f32::consts::PI);
    let value = |occluder: Option<Part>| {
        let mut scene = scene.clone();
        scene.water.absorption = [0.5; 3];
        let parts = std::iter::once(ground.clone()).chain(occluder).collect();
        let mut setup = Setup::new(scene, parts, [0.0, 1.0, 2.0], [0.0; 3]);
        setup.matter.spray.opacity = 0.4;
        samples(&setup.render().0, "terrain.G")[0]
    };
    let close = |got: f32, expected: f32| assert!((got - expected).abs() < 1e-4 * expected, "{got}, not {expected}");
    close(value(None), open);
    let ambient = 0.5 * 0.3;
    close(value(Some(part("rock", Material::Diffuse(Vec3::ONE), ball(4.0 * towards, 0.5)))), ambient);
    // One droplet takes its opacity once, though the ray meets it on the way in and on the way out.
    close(
        value(Some(part("spray", Material::Spray { first: 0 }, ball(4.0 * towards, 0.5)))),
        ambient + (open - ambient) * 0.6,
    );
    // A slab of water across the beam costs two crossings and its absorption.
    let slab = mesh(cuboid(Vec3::new(1.0, -50.0, -60.0), Vec3::new(1.5, 80.0, 60.0)));
    let crossing = 1.0 - fresnel::reflectance_exact(towards.x, 1.0, 1.333);
    let share = crossing * crossing * (-0.25 / towards.x).exp();
    close(value(Some(part("water", Material::Water, slab))), ambient + (open - ambient) * share);
}

#[test]
fn lamp_falls_with_the_square_of_its_distance() {
    let mut scene = uniform(0.0, 1);
    scene.render.samples = 1;
    scene.light = vec![crate::scene::Light::point([1.5, 2.0, 0.0], [10.0, 5.0, 1.0])];
    let parts = vec![part("panel_0", Material::Diffuse(Vec3::splat(0.6)), mesh(level(0.0, 50.0)))];
    let (picture, _) = Setup::new(scene, parts, [0.0, 1.0, 2.0], [0.0; 3]).render();
    let expected = 0.6 / std::f32::consts::PI * 10.0 * (2.0 / 2.5) / 6.25;
    assert!((samples(&picture, "R")[0] - expected).abs() < 1e-5 * expected);
    assert!((samples(&picture, "terrain.B")[0] - expected / 10.0).abs() < 1e-5 * expected);
}

#[test]
fn highlight_carries_the_mirrored_sun() {
    // Looking along the mirror direction of the sun, and integrated over the picture: the lobe returns Fresnel's share of
    // the sun's irradiance.
    let mut scene = uniform(0.0, 96);
    scene.sun = crate::scene::Sun { elevation: 60.0, azimuth: 180.0, irradiance: 1.0, color: Some([1.0; 3]) };
    scene.render.samples = 4;
    scene.camera.fov = 60.0;
    let (height, run) = 60.0_f64.to_radians().sin_cos();
    let parts = vec![part("water", Material::Water, mesh(level(0.0, 1000.0)))];
    let setup = Setup::new(scene, parts, [0.0, height, -run], [0.0; 3]);
    let (picture, stats) = setup.render();
    let camera = Camera::new(setup.path().pose(7.0), (96, 96), 0.0);
    let mut sum = 0.0;
    for (index, &value) in samples(&picture, "reflection.R").iter().enumerate() {
        let raster = glam::DVec2::new((index % 96) as f64 + 0.5, (index / 96) as f64 + 0.5);
        let direction = camera.direction(raster);
        // Solid angle of the pixel: angle^2 cos^3 over the plane at depth 1.
        let solid = camera.pixel_angle().powi(2) / direction.length().powi(3);
        // Flux out per area and per area of the card facing the sun.
        sum += f64::from(value) * solid * (-direction.normalize().y) / height;
    }
    let expected = f64::from(fresnel::reflectance_exact(height as f32, 1.0, 1.333));
    assert!((sum - expected).abs() < 0.05 * expected, "{sum}, not {expected}");
    assert!(stats.rays.shadow > 0);
}

#[test]
fn sun_through_the_surface_carries_the_refracted_sun() {
    // The same from below: radiance in water over n^2, integrated over the picture, is the beam that came through.
    let mut scene = uniform(0.0, 96);
    scene.water.absorption = [0.0; 3];
    // The lobe is about a pixel wide.
    scene.render.samples = 64;
    scene.sun = crate::scene::Sun { elevation: 55.0, azimuth: 180.0, irradiance: 1.0, color: Some([1.0; 3]) };
    scene.camera.fov = 50.0;
    let below = fresnel::refract(-towards_sun(55.0, 180.0), Vec3::Y, 1.0, 1.333).unwrap();
    let eye = below.as_dvec3();
    let parts = vec![part("water", Material::Water, mesh(level(0.0, 1000.0)))];
    let mut setup = Setup::new(scene, parts, eye.to_array(), [0.0; 3]);
    setup.matter = Flat { water: Some(0.0), bed: Some(-10.0), ..Flat::default() };
    let (picture, _) = setup.render();
    let camera = Camera::new(setup.path().pose(7.0), (96, 96), 0.0);
    let mut sum = 0.0;
    for (index, &value) in samples(&picture, "refraction.R").iter().enumerate() {
        let raster = glam::DVec2::new((index % 96) as f64 + 0.5, (index / 96) as f64 + 0.5);
        let direction = camera.direction(raster);
        let solid = camera.pixel_angle().powi(2) / direction.length().powi(3);
        sum += f64::from(value) * 1.333 * 1.333 * solid * direction.normalize().y;
    }
    let cosine = 55.0_f64.to_radians().sin();
    let expected = cosine * (1.0 - f64::from(fresnel::reflectance_exact(cosine as f32, 1.0, 1.333)));
    assert!((sum - expected).abs() < 0.05 * expected, "{sum}, not {expected}");
}

#[test]
fn foam_is_a_diffuse_share_of_the_water_and_leaves_the_rest_as_it_was() {
    for (irradiance, cover) in [(0.0, 0.4), (0.0, 1.0), (2.2, 0.4)] {
        let mut scene = uniform(1.0, 16);
        lossless(&mut scene);
        scene.camera.fov = 30.0;
        scene.sun.irradiance = irradiance;
        (scene.sun.elevation, scene.sun.azimuth) = (40.0, 90.0);
        scene.water.highlight = crate::scene::Highlight::None;
        let parts = vec![
            part("water", Material::Water, mesh(level(0.0, 500.0))),
            part("terrain", Material::Ground, mesh(level(-1.0, 500.0))),
        ];
        let mut setup = Setup::new(scene, parts, [0.0, 2.0, 3.0], [0.0; 3]);
        setup.matter = Flat { water: Some(0.0), bed: Some(-1.0), albedo: Vec3::ONE, ..Flat::default() };
        let (without, _) = setup.render();
        let look = FoamLook { cover, albedo: Vec3::new(0.9, 0.8, 0.7), density: cover };
        setup.matter.foam = Some(look);
        let (with, _) = setup.render();
        let sun = Sun::build(&setup.scene.sun, &setup.scene.sky);
        let light = Vec3::ONE + sun.irradiance * sun.direction.y * std::f32::consts::FRAC_1_PI;
        for (channel, light) in ["R", "G", "B"].into_iter().zip((cover * look.albedo * light).to_array()) {
            assert_all(&with, &format!("foam.{channel}"), light, 1e-5);
            let [beauty, before] = [&with, &without].map(|picture| samples(picture, channel));
            for (beauty, before) in beauty.iter().zip(before) {
                // Rays that are too faint to follow see the sky in place of what they would have met.
                assert!((beauty - light - (1.0 - cover) * before).abs() < 2e-3, "{beauty} {light} {before}");
            }
        }
        assert_all(&with, "mask.foam", cover, 1e-6);
        assert!(samples(&without, "mask.foam").iter().chain(samples(&without, "foam.G")).all(|&value| value == 0.0));
    }
}

#[test]
fn water_inside_of_water_has_no_border() {
    use crate::scene::Integrator;
    // Straight down through the middle of a box, and through the same box made of two that overlap by half a metre.
    let whole = [(Material::Water, [-1.0, 0.2])];
    let overlapping = [(Material::Water, [-1.0, 0.0]), (Material::Sheet, [-0.5, 0.2])];
    let drop = [(Material::Sheet, [-1.0, 0.2])];
    for (integrator, room) in [(Integrator::Whitted, 1e-5), (Integrator::Path, 4e-3)] {
        let look = |boxes: &[(Material, [f32; 2])]| {
            let mut scene = uniform(0.6, 16);
            scene.camera.fov = 2.0;
            scene.render.integrator = integrator;
            scene.render.samples = 64;
            scene.water.roughness = 0.0;
            scene.water.absorption = [0.4, 0.2, 0.1];
            let parts = boxes.iter().enumerate().map(|(index, (material, [low, high]))| {
                let half = 0.8 + 0.1 * index as f32;
                let mesh = mesh(cuboid(Vec3::new(-half, *low, -half), Vec3::new(half, *high, half)));
                part(["water", "sheet"][index], material.clone(), mesh)
            });
            let setup = Setup::new(scene, parts.collect(), [0.05, 6.0, 0.02], [0.0; 3]);
            let (picture, stats) = setup.render();
            (["R", "G", "B"].map(|name| mean(&picture, name)), stats)
        };
        let (expected, _) = look(&whole);
        assert!(expected[0] < 0.5 && expected[0] > 0.2, "{expected:?}");
        for boxes in [&overlapping[..], &drop[..]] {
            let (seen, stats) = look(boxes);
            assert_eq!(stats.nonfinite, 0);
            for channel in 0..3 {
                assert!((seen[channel] / expected[channel] - 1.0).abs() < room, "{integrator:?} {seen:?} {expected:?}");
            }
        }
    }
}

#[test]
fn the_sun_shines_straight_through_sheets_for_both_integrators() {
    use crate::scene::Integrator;
    let cosine = 60.0_f64.to_radians().sin() as f32;
    let crossing = 1.0 - fresnel::reflectance_exact(cosine, 1.0, 1.333);
    let sheet = |low: f32, high: f32| mesh(cuboid(Vec3::new(-500.0, low, -500.0), Vec3::new(500.0, high, 500.0)));
    for integrator in [Integrator::Whitted, Integrator::Path] {
        let mut scene = uniform(0.0, 16);
        scene.render.integrator = integrator;
        scene.render.samples = 64;
        scene.camera.fov = 30.0;
        scene.water.absorption = [0.4, 0.2, 0.1];
        scene.sun = crate::scene::Sun { elevation: 60.0, azimuth: 180.0, irradiance: 2.0, color: Some([1.0; 3]) };
        // The eye is between the ground and the sheet, so that no border is on its own way.
        let parts = vec![
            part("sheet", Material::Sheet, sheet(3.0, 3.5)),
            part("terrain", Material::Ground, mesh(level(0.0, 500.0))),
        ];
        let mut setup = Setup::new(scene, parts, [0.0, 2.0, 3.0], [0.0; 3]);
        setup.matter = Flat { bed: Some(0.0), albedo: Vec3::splat(0.5), ..Flat::default() };
        let (picture, _) = setup.render();
        let absorbed = [0.4, 0.2, 0.1].map(|absorption: f32| (-absorption * 0.5 / cosine).exp());
        for (channel, absorbed) in ["R", "G", "B"].into_iter().zip(absorbed) {
            let expected = 0.5 * std::f32::consts::FRAC_1_PI * 2.0 * cosine * crossing * crossing * absorbed;
            let seen = mean(&picture, channel) as f32;
            // Paths also bring what the lit ground sends up and the sheet mirrors back: within a tenth and a bit.
            let most = if integrator == Integrator::Path { 1.15 } else { 1.002 };
            assert!(seen > 0.998 * expected && seen < most * expected, "{integrator:?} {channel}: {seen} {expected}");
        }
    }
}
