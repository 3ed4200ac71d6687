//! What every picture promises: layers that add up, the same bits however it is cut, stops that are honest.

use std::sync::{
    Mutex,
    atomic::{AtomicBool, Ordering},
};

use super::*;
use crate::output::Window;

/// Some of everything, 80 by 70 pixels, 5 samples, sun and a lamp.
pub(super) fn everything() -> Setup {
    let mut scene = Scene::default();
    scene.render.width = 80;
    scene.render.height = 70;
    scene.render.samples = 5;
    scene.camera.f_number = 8.0;
    scene.light = vec![crate::scene::Light::point([0.5, 1.5, 0.2], [0.4, 0.3, 0.2])];
    let droplets = Spheres {
        center: (0..60).map(|i| Vec3::new((i % 10) as f32 * 0.2 - 1.0, 0.3 + (i / 10) as f32 * 0.1, 0.4)).collect(),
        radius: (0..60).map(|i| 0.03 + 0.001 * i as f32).collect(),
    };
    let mut wavy = cuboid(Vec3::new(-2.0, -0.8, -2.0), Vec3::new(2.0, 0.0, 2.0));
    wavy.position[6].y += 0.3;
    let parts = vec![
        part("water", Material::Water, mesh(wavy)),
        part("terrain", Material::Ground, mesh(level(-0.7, 6.0))),
        part("spray", Material::Spray { first: 0 }, Shape::Spheres(Arc::new(droplets))),
        part("sphere_0", Material::Diffuse(Vec3::new(0.7, 0.3, 0.2)), ball(Vec3::new(-0.6, 0.1, -0.7), 0.5)),
    ];
    let mut setup = Setup::new(scene, parts, [2.6, 1.4, 2.2], [0.0, 0.1, 0.0]);
    setup.mattes = Mattes::ALL;
    let mist = super::mist::cloud(&[[0.9, 0.5, 0.8], [1.1, 0.7, 0.2], [-0.4, 0.2, 1.2]], 2e-3, 0.4);
    setup.matter = Flat { water: Some(0.0), bed: Some(-0.7), mist: Some(mist), ..Flat::default() };
    setup
}

#[test]
fn layers_add_up_to_the_beauty_and_all_are_used() {
    let (picture, stats) = everything().render();
    let layers = ["reflection", "refraction", "caustics", "spray", "mist", "terrain", "sky"];
    let groups = ["light_sun", "light_sky", "light_lamps"];
    for channel in ["R", "G", "B"] {
        for (index, &beauty) in samples(&picture, channel).iter().enumerate() {
            for set in [&layers[..], &groups[..]] {
                let sum: f32 = set.iter().map(|layer| samples(&picture, &format!("{layer}.{channel}"))[index]).sum();
                assert!((sum - beauty).abs() <= 1e-5 * beauty.max(1e-3), "pixel {index}: {sum} against {beauty}");
            }
        }
    }
    for layer in layers.into_iter().chain(groups) {
        assert!(samples(&picture, &format!("{layer}.G")).iter().any(|&value| value > 1e-3), "{layer} is black");
    }
    assert!(picture.channels.iter().all(|channel| channel.samples.iter().all(|value| value.is_finite())));
    let rays = stats.rays;
    assert_eq!(rays.primary, 80 * 70 * 5);
    assert!(rays.reflection > 0 && rays.refraction > 0 && rays.transparency > 0 && rays.shadow > 0);
    assert_eq!((stats.nonfinite, stats.tiles, stats.tiles_done), (0, 9, 9));
    assert!(picture.metadata.complete && picture.metadata.frame == 7);
    assert!(samples(&picture, "velocity.x").contains(&3.0));
    assert!(samples(&picture, "sampleCount").iter().all(|&count| count == 5.0));
}

#[test]
fn two_threads_make_the_same_bits_as_one() {
    let mut setup = everything();
    let (one, _) = setup.render();
    setup.threads = 2;
    let (two, stats) = setup.render();
    assert_eq!(stats.threads, 2);
    assert_eq!(one.channels, two.channels);
}

#[test]
fn crop_has_the_bits_of_the_full_frame_and_overscan_holds_it() {
    let mut setup = everything();
    let (full, _) = setup.render();
    for crop in [
        Window { x: 13, y: 7, width: 30, height: 41 },
        Window { x: 79, y: 69, width: 1, height: 1 },
        Window { x: -9, y: -4, width: 100, height: 80 },
    ] {
        setup.crop = Some(crop);
        let (part, _) = setup.render();
        assert_eq!((part.data, part.display), (crop, (80, 70)));
        for (whole, cut) in full.channels.iter().zip(&part.channels) {
            for y in 0..crop.height as i32 {
                for x in 0..crop.width as i32 {
                    let (at_x, at_y) = (x + crop.x, y + crop.y);
                    if (0..80).contains(&at_x) && (0..70).contains(&at_y) {
                        let expected = whole.samples[(at_y * 80 + at_x) as usize];
                        let got = cut.samples[(y * crop.width as i32 + x) as usize];
                        assert_eq!(got.to_bits(), expected.to_bits(), "{} at {at_x},{at_y}", whole.name);
                    }
                }
            }
        }
    }
    setup.crop = Some(Window { x: 0, y: 0, width: 0, height: 5 });
    let sky = Sky::build(&setup.scene.sky, &setup.scene.sun, Path::new(".")).unwrap();
    let (accelerator, path) = (setup.accelerator(&setup.lowered), setup.path());
    let moments =
        [Moment { time: 0.0, lowered: &setup.lowered, accelerator: &*accelerator, matter: &setup.matter, water: None }];
    let job = Job {
        scene: &setup.scene,
        moments: &moments,
        sky: &sky,
        path: &path,
        frame: 7,
        crop: setup.crop,
        threads: 1,
        mattes: Mattes::default(),
        aside: 0.0,
    };
    let result = render_frame(&job, &AtomicBool::new(false), &());
    assert!(matches!(result, Err(RenderError::EmptyWindow { width: 0, .. })));
}

/// Asks to stop after `limit` tiles and keeps what it was told.
struct Stopper<'a> {
    stop: &'a AtomicBool,
    limit: u64,
    told: Mutex<Vec<(u64, u64, u64)>>,
}

impl Observer for Stopper<'_> {
    fn tiles(&self, done: u64, total: u64, rays: u64) {
        self.told.lock().unwrap().push((done, total, rays));
        if done >= self.limit {
            self.stop.store(true, Ordering::Relaxed);
        }
    }

    fn time(&self, elapsed: f64, _limit: f64, rays: u64) {
        self.tiles((elapsed * 1000.0) as u64, u64::MAX, rays);
    }
}

#[test]
fn stopped_picture_says_so_and_leaves_the_rest_empty() {
    let setup = everything();
    let stop = AtomicBool::new(false);
    let watcher = Stopper { stop: &stop, limit: 4, told: Mutex::default() };
    let (part, stats) = setup.render_until(&stop, &watcher);
    let told = watcher.told.into_inner().unwrap();
    assert_eq!(told.iter().map(|told| (told.0, told.1)).collect::<Vec<_>>(), [(1, 9), (2, 9), (3, 9), (4, 9)]);
    assert_eq!(told[3].2, stats.rays.total());
    assert!(!part.metadata.complete);
    let (full, _) = setup.render();
    // Tiles are 32 pixels: the first row of three and one more are done, the others are 0 in alpha and everything else.
    for (whole, cut) in full.channels.iter().zip(&part.channels) {
        for (index, (&expected, &got)) in whole.samples.iter().zip(&cut.samples).enumerate() {
            let (x, y) = (index % 80, index / 80);
            let done = y < 32 || (y < 64 && x < 32);
            assert_eq!(got, if done { expected } else { 0.0 }, "{} at {x},{y}", whole.name);
        }
    }
}

#[test]
fn hidden_sky_leaves_alpha_open_but_still_lights() {
    let mut scene = uniform(1.0, 32);
    scene.sky.visible = false;
    let parts = vec![part("ball", Material::Diffuse(Vec3::ONE), ball(Vec3::ZERO, 0.5))];
    let (picture, _) = Setup::new(scene, parts, [0.0, 0.5, 3.0], [0.0; 3]).render();
    let (alpha, red) = (samples(&picture, "A"), samples(&picture, "R"));
    assert!(alpha.contains(&0.0) && alpha.contains(&1.0));
    for (alpha, red) in alpha.iter().zip(red) {
        // Premultiplied: the white ball under a uniform sky is exactly as bright as it is opaque.
        assert!((alpha - red).abs() < 1e-5);
    }
    assert_eq!(samples(&picture, "Z")[0], NOTHING);
}

#[test]
fn numbers_that_are_not_finite_never_reach_the_picture() {
    let mut setup = everything();
    setup.matter.albedo = Vec3::new(f32::NAN, f32::INFINITY, 0.5);
    setup.matter.spray.albedo = Vec3::splat(f32::INFINITY);
    let (picture, stats) = setup.render();
    assert!(stats.nonfinite > 0);
    assert!(picture.channels.iter().all(|channel| channel.samples.iter().all(|value| value.is_finite())));
    assert!(["R", "G", "B", "Z"].iter().all(|name| samples(&picture, name).iter().all(|&value| value >= 0.0)));
}

#[test]
fn more_samples_than_a_chunk_and_hundreds_of_coincident_droplets_end() {
    let mut scene = uniform(1.0, 1);
    scene.render.samples = 20_000;
    let droplets = Spheres { center: vec![Vec3::ZERO; 300], radius: vec![0.2; 300] };
    let parts = vec![part("spray", Material::Spray { first: 0 }, Shape::Spheres(Arc::new(droplets)))];
    let mut setup = Setup::new(scene, parts, [0.0, 0.0, 2.0], [0.0; 3]);
    setup.matter.spray = SprayLook { albedo: Vec3::ONE, opacity: 1e-4, share: 1.0, velocity: Vec3::ZERO };
    let (picture, _) = setup.render();
    // White droplets under a uniform sky of 1: in front of it, behind it or anything between, it stays 1.
    assert!((samples(&picture, "R")[0] - 1.0).abs() < 1e-3, "{}", samples(&picture, "R")[0]);
    assert!((samples(&picture, "A")[0] - 1.0).abs() < 1e-6);
}
