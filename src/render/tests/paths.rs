//! What the path tracer must get right: closed forms, and agreement with what is computed in another way.

use super::*;
use crate::{
    optics::{Sun, fresnel},
    scene::{Caustics, Integrator, Light},
};

/// A uniform sky and paths without limits that matter.
fn paths(sky: f64, size: u32, samples: u32) -> Scene {
    let mut scene = uniform(sky, size);
    scene.render.integrator = Integrator::Path;
    scene.render.samples = samples;
    scene.render.depth = 200;
    scene.render.diffuse_depth = 200;
    scene.render.volume_depth = 10_000;
    scene.water.absorption = [0.0; 3];
    scene.accel = Accel { water: WaterAccel::Stream, ..Accel::default() };
    scene
}

/// The mean of green, and its standard error from the picture's own variances.
fn measured(picture: &Picture) -> (f64, f64) {
    let variances = samples(picture, "variance");
    let error = variances.iter().map(|&v| f64::from(v)).sum::<f64>().sqrt() / variances.len() as f64;
    (mean(picture, "G"), error)
}

fn assert_mean(picture: &Picture, expected: f64, room: f64) {
    let (mean, error) = measured(picture);
    assert!((mean - expected).abs() <= room + 3.5 * error, "{mean} +- {error}, not {expected}");
}

#[test]
fn furnace_with_smooth_water_in_it_is_uniform() {
    let mut scene = paths(0.7, 24, 16);
    scene.water.roughness = 0.0;
    let water = mesh(cuboid(Vec3::new(-1.0, -0.6, -1.3), Vec3::new(1.1, 0.6, 0.9)));
    let setup = Setup::new(scene, vec![part("water", Material::Water, water)], [3.0, 2.2, 4.0], [0.0; 3]);
    let (picture, stats) = setup.render();
    // Every path of clear, smooth water ends in the same sky with its full weight.
    assert!((mean(&picture, "G") - 0.7).abs() < 0.7e-3);
    assert!(stats.rays.refraction + stats.rays.reflection > 500 && stats.nonfinite == 0, "{:?}", stats.rays);
}

#[test]
fn furnace_with_murky_water_and_white_things_is_uniform() {
    let mut scene = paths(0.7, 24, 256);
    scene.water.roughness = 0.0;
    scene.water.scattering = [1.5, 1.0, 0.5];
    let water = mesh(cuboid(Vec3::new(-1.0, -0.6, -1.3), Vec3::new(1.1, 0.6, 0.9)));
    let parts = vec![
        part("water", Material::Water, water),
        part("sphere_0", Material::Diffuse(Vec3::ONE), ball(Vec3::new(0.1, 0.5, 0.0), 0.4)),
        part("sphere_1", Material::Diffuse(Vec3::ONE), ball(Vec3::new(-1.4, 0.2, 0.5), 0.4)),
    ];
    let (picture, stats) = Setup::new(scene, parts, [3.0, 2.2, 4.0], [0.0; 3]).render();
    assert_mean(&picture, 0.7, 0.7e-3);
    assert!(stats.rays.scattered > 1000 && stats.rays.diffuse > 1000, "{:?}", stats.rays);
}

#[test]
fn rough_water_loses_under_a_percent() {
    let mut scene = paths(1.0, 24, 64);
    scene.water.roughness = 0.05;
    let water = mesh(cuboid(Vec3::new(-1.0, -0.6, -1.3), Vec3::new(1.1, 0.6, 0.9)));
    let setup = Setup::new(scene, vec![part("water", Material::Water, water)], [3.0, 2.2, 4.0], [0.0; 3]);
    let (mean, _) = measured(&setup.render().0);
    assert!((0.985..=1.002).contains(&mean), "{mean}");
}

#[test]
fn sun_sky_and_lamps_on_a_card_are_their_irradiance() {
    for radius in [0.0, 0.8] {
        let mut scene = paths(0.5, 16, 64);
        scene.sun = crate::scene::Sun { elevation: 40.0, azimuth: 80.0, irradiance: 2.0, color: Some([1.0; 3]) };
        scene.camera.fov = 1.0;
        let lamp = Light { radius, ..Light::point([0.0, 3.0, 0.0], [5.0; 3]) };
        scene.light = vec![lamp, Light::point([4.0, 3.0, 0.0], [8.0; 3])];
        let parts = vec![part("card", Material::Diffuse(Vec3::splat(0.5)), mesh(level(0.0, 1000.0)))];
        let setup = Setup::new(scene, parts, [0.5, 2.0, 5.0], [0.0; 3]);
        let sun = 2.0 * 40.0_f64.to_radians().sin();
        let lamps = 5.0 / 9.0 + 8.0 * 3.0 / 125.0;
        // A ball overhead hides its share of the sky.
        let sky = 0.5 * std::f64::consts::PI * (1.0 - radius * radius / 9.0);
        let expected = 0.5 / std::f64::consts::PI * (sun + sky + lamps);
        // The picture is 14 cm wide at the card: the lamps' light varies by under a percent over it.
        assert_mean(&setup.render().0, expected, 0.004 * expected);
    }
}

#[test]
fn the_sun_through_flat_water_is_fresnel_snell_and_beer_lambert() {
    for (roughness, room) in [(0.0, 2e-3), (0.03, 5e-3)] {
        let mut scene = paths(0.0, 12, 64);
        scene.camera.fov = 2.0;
        scene.water.roughness = roughness;
        scene.water.absorption = [0.2; 3];
        scene.sun = crate::scene::Sun { elevation: 50.0, azimuth: 70.0, irradiance: 2.0, color: Some([1.0; 3]) };
        scene.render.diffuse_depth = 1;
        let water = waves(32, 1.0, |_, _| 0.0);
        let parts = vec![
            part("water", Material::Water, Shape::Surface(Arc::clone(&water))),
            part("terrain", Material::Ground, mesh(level(-1.5, 400.0))),
        ];
        let mut setup = Setup::new(scene, parts, [0.0, 3.0, 3.0], [0.0, 0.0, 0.0]);
        setup.matter = Flat { water: Some(0.0), bed: Some(-1.5), albedo: Vec3::splat(0.4), ..Flat::default() };
        setup.water = Some(water);
        let (picture, _) = setup.render();
        let (n, sine_sun) = (1.333_f64, 50.0_f64.to_radians().sin());
        let below = |cosine: f64| (1.0 - (1.0 - cosine * cosine) / (n * n)).sqrt();
        let through = |cosine: f64| 1.0 - f64::from(fresnel::reflectance_exact(cosine as f32, 1.0, n as f32));
        let view = 3.0_f64 / 18.0_f64.sqrt();
        let sun = 2.0 * sine_sun * through(sine_sun) * (-0.2 * 1.5 / below(sine_sun)).exp();
        let expected = 0.4 / std::f64::consts::PI * sun * through(view) / (n * n) * (-0.2 * 1.5 / below(view)).exp();
        let got = mean(&picture, "caustics.G");
        assert!((got / expected - 1.0).abs() < room, "roughness {roughness}: {got}, not {expected}");
    }
}

/// Wavy water over a level bed, seen from above.
fn wavy(mut scene: Scene) -> Setup {
    scene.camera.fov = 20.0;
    let water = waves(24, 0.25, |x, z| 0.06 * (2.1 * x + 0.4).sin() * (1.7 * z).cos());
    let parts = vec![
        part("water", Material::Water, Shape::Surface(Arc::clone(&water))),
        part("terrain", Material::Ground, mesh(level(-1.2, 400.0))),
    ];
    let mut setup = Setup::new(scene, parts, [0.0, 3.0, 1.0], [0.0, 0.0, 0.0]);
    setup.matter = Flat { water: Some(0.0), bed: Some(-1.2), albedo: Vec3::splat(0.6), ..Flat::default() };
    setup.water = Some(water);
    setup
}

fn same_mean(a: &Picture, b: &Picture, most: f64, what: &str) {
    let ((a, a_error), (b, b_error)) = (measured(a), measured(b));
    let error = (a_error * a_error + b_error * b_error).sqrt();
    assert!(error < most * a, "{what}: {a} +- {a_error} says little");
    assert!((a - b).abs() < 3.5 * error + 2e-3 * a, "{what}: {a} +- {a_error} against {b} +- {b_error}");
}

#[test]
fn caustics_are_what_paths_find_by_chance() {
    // A rough surface, so that paths find the sun through it by asking there; a shining ball through a smooth one.
    let mut sunny = paths(0.0, 16, 1024);
    sunny.water.roughness = 0.12;
    sunny.sun = crate::scene::Sun { elevation: 55.0, azimuth: 70.0, irradiance: 3.0, color: Some([1.0; 3]) };
    sunny.render.diffuse_depth = 1;
    let mut lamp = paths(0.0, 16, 1024);
    lamp.water.roughness = 0.0;
    lamp.water.scattering = [0.15; 3];
    lamp.water.asymmetry = 0.0;
    lamp.render.volume_depth = 1;
    lamp.render.diffuse_depth = 1;
    lamp.light = vec![Light { radius: 0.9, ..Light::point([0.6, 3.2, -0.8], [20.0; 3]) }];
    // Chance meets a lobe of a few degrees seldom: the sun's mean is known to a few percent only.
    for (name, scene, most) in [("sun", sunny, 0.08), ("ball", lamp, 0.03)] {
        let render = |caustics: Caustics| {
            let mut scene = scene.clone();
            scene.render.caustics = Some(caustics);
            wavy(scene).render().0
        };
        same_mean(&render(Caustics::Manifold), &render(Caustics::Off), most, name);
    }
}

#[test]
fn accelerators_and_solvers_make_the_same_picture() {
    let mut scene = paths(0.6, 20, 64);
    scene.render.diffuse_depth = 2;
    scene.render.depth = 4;
    scene.sun = crate::scene::Sun { elevation: 55.0, azimuth: 70.0, irradiance: 3.0, color: Some([1.0; 3]) };
    scene.water.scattering = [0.2; 3];
    let pictures: Vec<Picture> = [WaterAccel::Brute, WaterAccel::Embree, WaterAccel::Stream]
        .into_iter()
        .map(|water| {
            let mut scene = scene.clone();
            scene.accel.water = water;
            wavy(scene).render().0
        })
        .collect();
    for picture in &pictures[1..] {
        same_mean(&pictures[0], picture, 0.06, "accelerator");
    }
}

#[test]
fn error_falls_with_the_root_of_samples() {
    let mut scene = paths(0.6, 8, 1);
    scene.render.diffuse_depth = 2;
    // Sky alone: at the folds of a light's caustic single samples have no variance to speak of a law for.
    scene.water.scattering = [0.4; 3];
    let render = |samples: u32, seed: u32| {
        let mut scene = scene.clone();
        scene.render.samples = samples;
        scene.render.seed = seed;
        scene.render.filter = crate::scene::PixelFilter::Box;
        wavy(scene).render().0
    };
    let truth = render(2048, 9);
    let error = |samples: u32| {
        let picture = render(samples, 1);
        let pairs = super::samples(&picture, "G").iter().zip(super::samples(&truth, "G"));
        (pairs.map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>() / 64.0).sqrt()
    };
    let (few, some, many) = (error(2), error(16), error(128));
    assert!(some < few / 8.0_f64.sqrt() * 1.7 && many < few / 8.0 * 1.9, "{few} {some} {many}");
}

#[test]
fn the_sun_s_disc_is_seen_in_smooth_water_as_bright_as_its_reflectance() {
    // A long lens at the mirror image of the sun.
    let mut scene = paths(0.0, 24, 16);
    scene.water.roughness = 0.0;
    scene.camera.fov = 1.0;
    scene.sun = crate::scene::Sun { elevation: 30.0, azimuth: 0.0, irradiance: 1.0, color: Some([1.0; 3]) };
    let sun = Sun::build(&scene.sun, &scene.sky);
    let parts = vec![part("water", Material::Water, mesh(level(0.0, 1e4)))];
    let (sin, cos) = 30.0_f64.to_radians().sin_cos();
    let (picture, _) = Setup::new(scene, parts, [0.0, 10.0 * sin, 10.0 * cos], [0.0; 3]).render();
    let reflectance = fresnel::reflectance_exact(sin as f32, 1.0, 1.333);
    let brightest = samples(&picture, "reflection.G").iter().copied().fold(0.0, f32::max);
    // The reflectance grows by 3 % from the picture's middle to the disc's lower edge.
    assert!((brightest / (reflectance * sun.disc_radiance.y) - 1.0).abs() < 0.04, "{brightest}");
    // The whole disc: radiance times its solid angle.
    let pixel = (1.0_f64.to_radians() / 24.0).powi(2);
    let total = mean(&picture, "reflection.G") * 576.0 * pixel;
    assert!((total / f64::from(reflectance) - 1.0).abs() < 0.03, "{total} of {reflectance}");
}

#[test]
fn a_hundred_random_scenes_have_no_pixel_that_is_not_light() {
    use crate::math::scramble;
    for seed in 0..100_u64 {
        let random = |index: u64| (scramble(seed * 64 + index) >> 40) as f64 / f64::from(1 << 24);
        // Extremes as often as what is between.
        let pick = |index: u64, values: &[f64]| values[(random(index) * values.len() as f64) as usize];
        let mut scene = paths(pick(0, &[0.0, 0.5, 1e6]), 8, 4);
        scene.render.diffuse_depth = pick(1, &[0.0, 2.0, 8.0]) as u32;
        scene.render.volume_depth = 40;
        scene.render.caustics = Some([Caustics::Manifold, Caustics::Beams, Caustics::Off][(random(2) * 3.0) as usize]);
        scene.render.beam_samples = 2;
        scene.render.mirrored_caustics = random(20) < 0.5;
        scene.water.roughness = pick(3, &[0.0, 1e-4, 0.03, 1.0]);
        scene.water.ior = pick(4, &[1.0, 1.333, 4.0]);
        scene.water.absorption = [pick(5, &[0.0, 0.3, 1e6]), 0.1, 0.0];
        scene.water.scattering = [pick(6, &[0.0, 0.5, 1e4]), pick(7, &[0.0, 1.0]), 0.2];
        scene.water.asymmetry = pick(8, &[-0.99, 0.0, 0.99]);
        scene.sun.irradiance = pick(9, &[0.0, 2.2, 1e9]);
        scene.sun.elevation = pick(10, &[-5.0, 0.0, 0.1, 40.0, 90.0]);
        let radius = pick(11, &[0.0, 1e-6, 0.5, 50.0]);
        let height = pick(12, &[-1.0, 0.0, 0.05, 3.0]);
        scene.light = vec![Light { radius, ..Light::point([0.1, height, 0.2], [pick(13, &[0.0, 10.0, 1e12]); 3]) }];
        let water = waves(8, 0.3, |x, z| pick(14, &[0.0, 0.05, 5.0]) * (2.0 * x + z).sin());
        let parts = vec![
            part("water", Material::Water, Shape::Surface(Arc::clone(&water))),
            part("terrain", Material::Ground, mesh(level(pick(15, &[0.0, -1.0, -1e-6]) as f32, 40.0))),
            part(
                "spray",
                Material::Spray { first: 0 },
                ball(Vec3::new(0.0, 0.1, 0.0), pick(16, &[1e-6, 0.1, 2.0]) as f32),
            ),
        ];
        let mut setup = Setup::new(scene, parts, [0.5, pick(17, &[-0.5, 0.02, 3.0]), 1.0], [0.0; 3]);
        setup.matter = Flat { water: Some(0.0), bed: Some(-1.0), albedo: Vec3::splat(0.9), ..Flat::default() };
        setup.water = Some(water);
        let (picture, stats) = setup.render();
        for channel in picture.channels.iter().filter(|c| !c.name.starts_with(['N', 'P', 'd', 'v', 'f', 'b'])) {
            let bad = channel.samples.iter().find(|value| !(value.is_finite() && **value >= 0.0));
            assert!(bad.is_none(), "scene {seed}: {} is {bad:?}", channel.name);
        }
        assert_eq!(stats.nonfinite, 0, "scene {seed}");
    }
}

#[test]
fn both_integrators_agree_where_both_are_exact() {
    let water = waves(48, 0.15, |x, z| 0.05 * (2.1 * x + 0.7 * z).sin() + 0.04 * (1.8 * z - 0.9 * x).cos());
    let build = |scene: Scene, albedo: f32| {
        let parts = vec![
            part("water", Material::Water, Shape::Surface(Arc::clone(&water))),
            part("terrain", Material::Ground, mesh(level(-1.2, 300.0))),
            part("sphere_0", Material::Diffuse(Vec3::splat(albedo)), ball(Vec3::new(0.4, 1.0, -0.6), 0.5)),
        ];
        let mut setup = Setup::new(scene, parts, [0.3, 1.1, 3.0], [0.0, 0.2, 0.0]);
        setup.matter = Flat { water: Some(0.0), bed: Some(-1.2), albedo: Vec3::splat(albedo), ..Flat::default() };
        setup.water = Some(Arc::clone(&water));
        setup
    };
    let mut mirrors = paths(0.0, 24, 64);
    mirrors.water.roughness = 0.0;
    mirrors.water.absorption = [0.3; 3];
    mirrors.render.depth = 40;
    let mut sky = mirrors.clone();
    sky.sky.kind = SkyKind::Analytic;
    // One bounce of the sun on ball and bed, by way of the waves as well. They are so dark that what the surface returns to
    // the bed, which Whitted estimates, is nothing. In the water's mirror the sun is a disc for paths and a highlight for
    // Whitted: that is not compared.
    let mut sun = mirrors.clone();
    sun.render.diffuse_depth = 1;
    sun.render.caustics = Some(Caustics::Manifold);
    sun.sun = crate::scene::Sun { elevation: 55.0, azimuth: 200.0, irradiance: 2.0, color: Some([1.0; 3]) };
    let all = &["G"][..];
    for (case, scene, albedo, layers) in
        [("sky", sky, 0.0, all), ("sun", sun, 0.002, &["terrain.G", "refraction.G", "caustics.G"][..])]
    {
        let [path, whitted] = [Integrator::Path, Integrator::Whitted].map(|integrator| {
            let mut scene = scene.clone();
            scene.render.integrator = integrator;
            build(scene, albedo).render().0
        });
        let [of_path, of_whitted] =
            [&path, &whitted].map(|picture| layers.iter().map(|layer| mean(picture, layer)).sum::<f64>());
        let error = measured(&path).1.hypot(measured(&whitted).1);
        assert!(of_whitted > 1e-4, "{case}: {of_whitted}");
        assert!(
            (of_path - of_whitted).abs() < 1e-3 * of_whitted + 3.0 * error,
            "{case}: {of_path}, not {of_whitted}, +- {error}"
        );
    }
}
