//! How many samples a pixel gets, what the shutter sees, and that neither depends on threads or crops.

use super::*;
use crate::{output::Window, scene::Integrator};

/// Half of the picture is a plain sky, half a noisy thing under a small bright lamp.
fn uneven() -> Setup {
    let mut scene = uniform(0.5, 40);
    scene.render.integrator = Integrator::Path;
    scene.render.samples = 8;
    scene.render.max_samples = 256;
    scene.light = vec![crate::scene::Light { radius: 0.3, ..crate::scene::Light::point([0.5, 1.0, 0.0], [2.0; 3]) }];
    let parts = vec![
        part("card", Material::Diffuse(Vec3::splat(0.8)), mesh(level(0.0, 1.0))),
        part("sphere_0", Material::Diffuse(Vec3::splat(0.6)), ball(Vec3::new(-0.4, 0.3, 0.2), 0.3)),
    ];
    Setup::new(scene, parts, [0.0, 1.0, 3.0], [0.0, 0.8, 0.0])
}

#[test]
fn noise_sets_the_samples_of_each_pixel() {
    let render = |noise: f64| {
        let mut setup = uneven();
        setup.scene.render.noise = Some(noise);
        setup.render()
    };
    let (rough, coarse_stats) = render(0.1);
    let (fine, fine_stats) = render(0.02);
    assert!(fine_stats.samples > 2 * coarse_stats.samples);
    for (picture, noise) in [(&rough, 0.1), (&fine, 0.02)] {
        let counts = samples(picture, "sampleCount");
        // A plain sky is known after the first look.
        assert_eq!(counts[20], 8.0);
        let luminance = |index: usize| {
            crate::optics::luminance(Vec3::from_array(["R", "G", "B"].map(|name| samples(picture, name)[index])))
        };
        for (index, &variance) in samples(picture, "variance").iter().enumerate() {
            let error = variance.sqrt() / (luminance(index) + 0.1);
            assert!(error <= 1.001 * noise || counts[index] == 256.0, "pixel {index}: {error} of {noise}");
        }
    }
}

#[test]
fn adaptive_pictures_do_not_depend_on_threads_or_crops() {
    let mut setup = uneven();
    setup.scene.render.noise = Some(0.05);
    let whole = setup.render().0;
    setup.threads = 3;
    let threaded = setup.render().0;
    let bits = |picture: &Picture| {
        picture.channels.iter().flat_map(|c| c.samples.iter().map(|s| s.to_bits())).collect::<Vec<_>>()
    };
    assert!(bits(&whole) == bits(&threaded));
    let crop = Window { x: 7, y: 11, width: 25, height: 20 };
    setup.crop = Some(crop);
    let part = setup.render().0;
    for (cut, whole) in part.channels.iter().zip(&whole.channels) {
        for (index, &value) in cut.samples.iter().enumerate() {
            let (x, y) = (7 + index % 25, 11 + index / 25);
            assert_eq!(value.to_bits(), whole.samples[y * 40 + x].to_bits(), "{} at {x},{y}", whole.name);
        }
    }
}

#[test]
fn time_limits_are_kept_and_leave_whole_pictures() {
    let mut setup = uneven();
    setup.scene.render.seconds = Some(0.3);
    setup.scene.render.max_samples = 65_536;
    let (picture, stats) = setup.render();
    assert!(picture.metadata.complete && stats.passes > 2, "{} passes", stats.passes);
    assert!(samples(&picture, "sampleCount").iter().all(|&count| count >= 1.0));
    // Every pixel goes on until the time is over, or the samples are.
    let total: f64 = samples(&picture, "sampleCount").iter().map(|&count| f64::from(count)).sum();
    assert_eq!(total as u64, stats.samples);
}

#[test]
fn a_limit_that_is_not_reached_gives_the_bits_of_none() {
    let mut setup = uneven();
    setup.scene.render.max_samples = 8;
    let free = setup.render().0;
    setup.scene.render.seconds = Some(1e6);
    let limited = setup.render().0;
    for (a, b) in free.channels.iter().zip(&limited.channels).filter(|(a, _)| a.name == "G" || a.name == "sampleCount")
    {
        for (&a, &b) in a.samples.iter().zip(&b.samples) {
            // Sums in passes round as they are grouped.
            assert!((a - b).abs() <= 1e-5 * a.abs(), "{a} {b}");
        }
    }
}

#[test]
fn the_shutter_sees_every_moment_alike() {
    // A black card that covers half of the picture at the first of two moments and nothing at the second.
    let mut scene = uniform(1.0, 16);
    scene.render.samples = 8;
    let card = |y: f32| {
        let mut card = level(y, 50.0);
        card.position.iter_mut().for_each(|corner| corner.x += 50.0);
        vec![part("card", Material::Diffuse(Vec3::ZERO), mesh(card))]
    };
    let mut setup = Setup::new(scene, card(0.0), [0.0, 5.0, 0.01], [0.0; 3]);
    setup.later = vec![Lowered { origin: DVec3::ZERO, parts: card(-1e4) }];
    let (picture, _) = setup.render();
    let right = samples(&picture, "G")[8 * 16 + 14];
    let left = samples(&picture, "G")[8 * 16 + 1];
    assert!((right - 0.5).abs() < 0.02 && (left - 1.0).abs() < 1e-3, "{right} {left}");
    assert!(samples(&picture, "sampleCount").iter().all(|&count| count == 8.0));
}
