//! Pictures of streaks whose light is known: thin ones lit as lines, thick ones as round.

use super::*;
use crate::lower::Curves;

/// Nine short streaks of any direction, far enough apart not to touch.
fn streaks(radius: f32) -> Shape {
    let mut curves = Curves::default();
    for k in 0..9_u8 {
        let head = Vec3::new(f32::from(k % 3) * 6.6 - 6.6, f32::from(k / 3) * 6.6 - 6.6, 0.0);
        let way =
            Vec3::new(f32::from(k % 2) - 0.5, f32::from(k % 5) - 2.0, f32::from(k % 4) - 1.5).normalize_or(Vec3::Y);
        curves.ends.push([head, head + 1.2 * way]);
        curves.radius.push([radius, 0.5 * radius]);
    }
    Shape::Curves(Arc::new(curves))
}

fn setup(integrator: crate::scene::Integrator, radius: f32, samples: u32) -> Setup {
    let mut scene = uniform(0.7, 24);
    scene.render.integrator = integrator;
    scene.render.samples = samples;
    let mut setup = Setup::new(
        scene,
        vec![part("streaks", Material::Spray { first: 0 }, streaks(radius))],
        [0.0, 0.0, 30.0],
        [0.0; 3],
    );
    setup.matter.spray = SprayLook { albedo: Vec3::ONE, opacity: 1.0, share: 1.0, velocity: Vec3::ZERO };
    setup
}

/// The share of the picture that is not the sky's.
fn spray_layer(picture: &Picture) -> f64 {
    mean(picture, "spray.G")
}

#[test]
fn white_streaks_in_a_furnace_throw_back_the_sky_and_no_more() {
    use crate::scene::Integrator::{Path, Whitted};
    // A pixel sees 0.9 m there: lines, the mixture, and round.
    for radius in [0.1, 0.5, 1.3, 2.0] {
        for (integrator, samples) in [(Whitted, 4), (Path, 64)] {
            let setup = setup(integrator, radius, samples);
            let (picture, stats) = setup.render();
            let whole = mean(&picture, "G");
            assert!((whole / 0.7 - 1.0).abs() < 5e-3, "{integrator:?}, {radius} m: {whole}");
            assert!(spray_layer(&picture) > 5e-4, "{integrator:?}, {radius} m: nothing was met");
            assert_eq!(stats.nonfinite, 0);
        }
    }
}

#[test]
fn light_through_a_streak_is_thinned_once() {
    // One wide streak between a lamp overhead and a card.
    for integrator in [crate::scene::Integrator::Whitted, crate::scene::Integrator::Path] {
        let light = |opacity: f32| {
            let mut scene = uniform(0.0, 8);
            scene.render.integrator = integrator;
            scene.render.samples = 16;
            (scene.camera.fov, scene.particles.softness) = (1.0, 0.0);
            scene.light = vec![crate::scene::Light::point([0.0, 6.0, 0.0], [5.0; 3])];
            let curves =
                Curves { ends: vec![[Vec3::new(-1.0, 4.0, 0.0), Vec3::new(1.0, 4.0, 0.0)]], radius: vec![[0.5, 0.4]] };
            let parts = vec![
                part("card", Material::Diffuse(Vec3::splat(0.5)), mesh(level(0.0, 10.0))),
                part("streaks", Material::Spray { first: 0 }, Shape::Curves(Arc::new(curves))),
            ];
            let mut setup = Setup::new(scene, parts, [0.0, 1.0, 6.0], [0.0; 3]);
            setup.matter.spray = SprayLook { albedo: Vec3::ZERO, opacity, share: 1.0, velocity: Vec3::ZERO };
            mean(&setup.render().0, "G")
        };
        let (clear, thinned) = (light(0.0), light(0.7));
        assert!(clear > 1e-3 && (thinned / clear - 0.3).abs() < 0.01, "{integrator:?}: {thinned} of {clear}");
    }
}
