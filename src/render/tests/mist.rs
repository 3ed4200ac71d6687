//! Mist in pictures: furnaces, one scattering of the sun, and both integrators side by side.

use super::*;
use crate::{
    mist::{MistSettings, cross_section},
    optics::Phase,
    output::Window,
    scene::Integrator,
};

/// The mist of particles of `mass` kg each, of clouds of a width (m), in droplets of 50 micrometres.
pub(super) fn cloud(position: &[[f64; 3]], mass: f64, width: f64) -> Mist {
    let settings = MistSettings { droplet_radius: 5e-5, width, scale: 1.0 };
    Mist::build(position, &vec![mass; position.len()], &settings, DVec3::ZERO).unwrap()
}

/// Deviation of the clouds of a block, and their distance.
const STEP: f64 = 0.125;

/// Clouds of a block along an axis.
const BLOCK: i32 = 16;

/// A block of mist, even but for its borders, with an optical depth of `depth` across its middle.
fn block(depth: f64) -> Mist {
    let place = |index: i32| (f64::from(index) - 0.5 * f64::from(BLOCK - 1)) * STEP;
    let cells = (0..BLOCK).flat_map(|z| (0..BLOCK).flat_map(move |y| (0..BLOCK).map(move |x| [x, y, z])));
    let position: Vec<[f64; 3]> = cells.map(|cell| cell.map(place)).collect();
    // Across the middle a square metre has one column of clouds per square of the step.
    let mass = depth * STEP * STEP / f64::from(BLOCK) / cross_section(1.0, 5e-5);
    cloud(&position, mass, 2.0 * STEP)
}

fn scene(integrator: Integrator, sky: f64, size: u32, samples: u32) -> Scene {
    let mut scene = uniform(sky, size);
    scene.render.integrator = integrator;
    scene.render.samples = samples;
    scene.render.volume_depth = 10_000;
    scene
}

fn in_mist(scene: Scene, mist: Mist) -> Setup {
    let mut setup = Setup::new(scene, Vec::new(), [0.2, 0.3, 4.0], [0.0; 3]);
    setup.matter.mist = Some(mist);
    setup
}

/// The mean of green, and its standard error.
fn measured(picture: &Picture) -> (f64, f64) {
    let variances = samples(picture, "variance");
    let error = variances.iter().map(|&v| f64::from(v)).sum::<f64>().sqrt() / variances.len() as f64;
    (mean(picture, "G"), error)
}

#[test]
fn a_furnace_of_mist_is_uniform() {
    for depth in [0.5, 6.0] {
        for integrator in [Integrator::Path, Integrator::Whitted] {
            let (picture, stats) = in_mist(scene(integrator, 0.7, 24, 64), block(depth)).render();
            let (mean_green, error) = measured(&picture);
            assert!((mean_green - 0.7).abs() < 2e-3 + 3.5 * error, "{integrator:?} {depth}: {mean_green} +- {error}");
            assert!(mean(&picture, "mist.G") > 0.05 && stats.nonfinite == 0);
            assert_eq!(stats.rays.scattered > 1000, integrator == Integrator::Path);
            if integrator == Integrator::Whitted {
                // Without noise: each pixel by itself.
                assert!(samples(&picture, "G").iter().all(|value| (value - 0.7).abs() < 2e-3));
            }
        }
    }
}

#[test]
fn the_furnace_holds_with_water_and_white_things_in_the_mist() {
    let mut scene = scene(Integrator::Path, 0.7, 20, 256);
    scene.render.depth = 200;
    scene.render.diffuse_depth = 200;
    scene.water.absorption = [0.0; 3];
    scene.water.roughness = 0.0;
    let water = mesh(cuboid(Vec3::new(-0.9, -0.6, -0.9), Vec3::new(0.9, 0.0, 0.9)));
    let parts = vec![
        part("water", Material::Water, water),
        part("sphere_0", Material::Diffuse(Vec3::ONE), ball(Vec3::new(0.1, 0.5, 0.0), 0.4)),
    ];
    let mut setup = Setup::new(scene, parts, [0.2, 0.8, 3.0], [0.0; 3]);
    setup.matter.mist = Some(block(1.5));
    let (mean_green, error) = measured(&setup.render().0);
    assert!((mean_green - 0.7).abs() < 2e-3 + 3.5 * error, "{mean_green} +- {error}");
}

#[test]
fn the_sun_scattered_once_is_its_integral() {
    let depth = 0.3;
    // Density across the block, of 1 inside, and what is left of the view and of the sun on the way.
    let profile = |z: f64| {
        let part = |index: i32| (z / STEP - f64::from(index) + 0.5 * f64::from(BLOCK - 1)).powi(2);
        (0..BLOCK).map(|index| (-0.5 * part(index)).exp()).sum::<f64>() / std::f64::consts::TAU.sqrt()
    };
    let extinction = depth / (f64::from(BLOCK) * STEP);
    let (mut seen, mut scattered, steps) = (0.0, 0.0, 4000);
    for step in 0..steps {
        let (z, dz) = (-2.0 + 4.0 * (f64::from(step) + 0.5) / f64::from(steps), 4.0 / f64::from(steps));
        let own = extinction * profile(z) * dz;
        scattered += own * (-seen - 0.5 * own - 0.5 * depth * profile(z)).exp();
        seen += own;
    }
    assert!((seen - depth).abs() < 1e-4);
    let across = f64::from(Phase::HenyeyGreenstein { g: 0.85 }.value(0.0));
    let expected = 2.0 * across * scattered;
    for (integrator, samples) in [(Integrator::Whitted, 4), (Integrator::Path, 1024)] {
        let mut scene = scene(integrator, 0.0, 12, samples);
        scene.render.volume_depth = 1;
        // The eye looks along z, the sun stands overhead.
        scene.sun = crate::scene::Sun { elevation: 90.0, azimuth: 0.0, irradiance: 2.0, color: Some([1.0; 3]) };
        scene.camera.fov = 2.0;
        let mut setup = Setup::new(scene, Vec::new(), [0.0, 0.0, 6.0], [0.0; 3]);
        setup.matter.mist = Some(block(depth));
        let (picture, _) = setup.render();
        let (mean_green, error) = measured(&picture);
        assert!(error < 0.02 * expected, "{integrator:?}: {mean_green} +- {error} says little");
        // Four points of a ray do not see how thin the block's borders are: they are a percent off.
        let room = if integrator == Integrator::Whitted { 0.012 } else { 0.005 } * expected + 3.5 * error;
        assert!((mean_green - expected).abs() < room, "{integrator:?}: {mean_green} +- {error}, not {expected}");
        assert!((mean(&picture, "mist.G") / mean_green - 1.0).abs() < 1e-6);
        assert!((mean(&picture, "light_sun.G") / mean_green - 1.0).abs() < 1e-6);
    }
}

#[test]
fn both_integrators_agree_about_thin_mist() {
    let mut means = Vec::new();
    for (integrator, samples) in [(Integrator::Whitted, 4), (Integrator::Path, 512)] {
        let mut scene = scene(integrator, 0.0, 16, samples);
        scene.sky.kind = SkyKind::Analytic;
        scene.sun = crate::scene::Sun { elevation: 30.0, azimuth: 20.0, irradiance: 2.2, color: Some([1.0; 3]) };
        scene.light = vec![crate::scene::Light::point([0.5, 2.0, 0.2], [0.5; 3])];
        let parts = vec![part("sphere_0", Material::Diffuse(Vec3::splat(0.2)), ball(Vec3::new(0.0, 0.0, -1.2), 0.6))];
        let mut setup = Setup::new(scene, parts, [0.2, 0.3, 4.0], [0.0; 3]);
        setup.matter.mist = Some(block(0.08));
        let (picture, _) = setup.render();
        means.push(["mist.R", "mist.G", "mist.B", "terrain.G"].map(|channel| mean(&picture, channel)));
    }
    for (whitted, path) in means[0].iter().zip(means[1]) {
        // What is scattered twice is a few percent, and so is what the ball hides of the sky: for Whitted the phase
        // function's peak sees nothing but the ball behind it, which is narrower than the peak.
        assert!(*whitted > 1e-3 && (whitted / path - 1.0).abs() < 0.12, "{means:?}");
    }
}

#[test]
fn mist_dims_what_is_behind_it_and_what_it_shades() {
    // Without light of its own: a dark sky, the sun on a card that is seen past the mist, or that lies in its shade.
    let card = |eye: [f64; 3], look_at: [f64; 3], mist: Option<Mist>, integrator: Integrator| {
        let mut scene = scene(integrator, 0.0, 8, 256);
        scene.sun = crate::scene::Sun { elevation: 90.0, azimuth: 0.0, irradiance: 2.0, color: Some([1.0; 3]) };
        scene.camera.fov = 1.0;
        scene.render.diffuse_depth = 1;
        // What mist scatters onto the card is left out: it is more than a half of what it takes.
        scene.render.volume_depth = 0;
        let parts = vec![part("card", Material::Diffuse(Vec3::splat(0.5)), mesh(level(-2.0, 50.0)))];
        let mut setup = Setup::new(scene, parts, eye, look_at);
        setup.matter.mist = mist;
        mean(&setup.render().0, "terrain.G")
    };
    let depth = 0.7f64;
    for integrator in [Integrator::Whitted, Integrator::Path] {
        // From aside, below the block, onto the card in its shade.
        let [clear, shaded] =
            [None, Some(block(depth))].map(|mist| card([6.0, -1.5, 0.0], [0.0, -2.0, 0.0], mist, integrator));
        assert!((clear - 1.0 / std::f64::consts::PI).abs() < 2e-3, "{clear}");
        assert!((shaded / clear / (-depth).exp() - 1.0).abs() < 0.03, "{integrator:?}: {shaded} of {clear}");
    }
}

#[test]
fn a_path_through_mist_has_the_same_bits_however_the_picture_is_cut() {
    let mut setup = super::promises::everything();
    setup.scene.render.integrator = Integrator::Path;
    let (full, stats) = setup.render();
    assert!(mean(&full, "mist.G") > 1e-3 && stats.rays.scattered > 100);
    setup.threads = 2;
    assert_eq!(setup.render().0.channels, full.channels);
    let crop = Window { x: 31, y: 7, width: 20, height: 41 };
    setup.crop = Some(crop);
    let (part, _) = setup.render();
    for (whole, cut) in full.channels.iter().zip(&part.channels) {
        for (index, got) in cut.samples.iter().enumerate() {
            let (x, y) = (index as i32 % 20 + crop.x, index as i32 / 20 + crop.y);
            assert_eq!(got.to_bits(), whole.samples[(y * 80 + x) as usize].to_bits(), "{} {x},{y}", whole.name);
        }
    }
}
