//! Mattes of small scenes whose coverage is known: a disc over half a pixel, things seen through others, what is summed up.

use super::*;
use crate::{
    output::cryptomatte::{RANKS, channels, id},
    scene::{Integrator, PixelFilter},
};

const BOTH: [Integrator; 2] = [Integrator::Whitted, Integrator::Path];

/// What a name covers of every pixel in a set of mattes.
fn matte(picture: &Picture, layer: &str, name: &str) -> Vec<f32> {
    let names = channels(layer);
    let channel = |index: usize| samples(picture, &names[index]);
    let wanted = id(name).to_bits();
    let mut sum = vec![0.0; channel(0).len()];
    for rank in 0..RANKS {
        for (index, (found, coverage)) in channel(2 * rank).iter().zip(channel(2 * rank + 1)).enumerate() {
            if found.to_bits() == wanted {
                sum[index] += coverage;
            }
        }
    }
    sum
}

fn average(values: &[f32]) -> f64 {
    values.iter().map(|&value| f64::from(value)).sum::<f64>() / values.len() as f64
}

/// What all ranks cover of every pixel.
fn covered(picture: &Picture, layer: &str) -> Vec<f32> {
    let names = channels(layer);
    let count = samples(picture, &names[0]).len();
    (0..count).map(|index| names.iter().skip(1).step_by(2).map(|name| samples(picture, name)[index]).sum()).collect()
}

fn with_mattes(scene: Scene, parts: Vec<Part>, eye: [f64; 3]) -> Setup {
    let mut setup = Setup::new(scene, parts, eye, [0.0; 3]);
    setup.mattes = Mattes::ALL;
    setup
}

/// A ball whose outline is a disc in the middle of a pixel that has half of the pixel's area.
fn ball_over_half_a_pixel() -> Setup {
    let mut scene = uniform(1.0, 1);
    scene.render.filter = PixelFilter::Box;
    scene.render.samples = 4096;
    scene.camera.fov = 20.0;
    let half = 10.0_f64.to_radians().tan();
    // pi r^2 = (2 half)^2 / 2 on the film, a metre before the eye; the outline of a ball is where rays touch it.
    let on_film = half * (2.0 / std::f64::consts::PI).sqrt();
    let radius = 10.0 * on_film.atan().sin();
    let parts =
        vec![part("sphere_0", Material::Diffuse(Vec3::splat(0.5)), ball(Vec3::new(0.0, 0.0, 0.0), radius as f32))];
    with_mattes(scene, parts, [0.0, 0.0, 10.0])
}

#[test]
fn a_ball_over_half_a_pixel_covers_half_of_it() {
    for integrator in BOTH {
        let mut setup = ball_over_half_a_pixel();
        setup.scene.render.integrator = integrator;
        let (picture, _) = setup.render();
        assert!((matte(&picture, "CryptoObject", "sphere_0")[0] - 0.5).abs() < 2e-3);
        assert!((matte(&picture, "CryptoMaterial", "diffuse")[0] - 0.5).abs() < 2e-3);
        assert_eq!(covered(&picture, "CryptoBed"), [0.0]);
        // The sky is nobody: the second rank is empty.
        assert_eq!([samples(&picture, "CryptoObject00.b")[0], samples(&picture, "CryptoObject00.a")[0]], [0.0; 2]);
        // A ball that is there for half of the exposure covers a quarter.
        setup.later = vec![Lowered { origin: DVec3::ZERO, parts: Vec::new() }];
        let (picture, _) = setup.render();
        assert!((matte(&picture, "CryptoObject", "sphere_0")[0] - 0.25).abs() < 2e-3);
    }
}

#[test]
fn spray_that_lets_light_through_shares_the_pixel_with_what_is_behind() {
    for (integrator, room) in [(Integrator::Whitted, 1e-6), (Integrator::Path, 0.02)] {
        let mut scene = uniform(1.0, 8);
        scene.render.integrator = integrator;
        scene.render.samples = 64;
        (scene.camera.fov, scene.particles.softness) = (5.0, 0.0);
        let parts = vec![
            part("spray", Material::Spray { first: 0 }, ball(Vec3::ZERO, 1.0)),
            part("panel_0", Material::Diffuse(Vec3::splat(0.5)), mesh(level(-3.0, 50.0))),
        ];
        let mut setup = with_mattes(scene, parts, [0.0, 9.0, 0.1]);
        setup.matter.spray.opacity = 0.7;
        let (picture, _) = setup.render();
        for (layer, front, back) in [("CryptoObject", "spray", "panel_0"), ("CryptoMaterial", "spray", "diffuse")] {
            let shares = [front, back].map(|name| average(&matte(&picture, layer, name)));
            assert!((shares[0] - 0.7).abs() < room && (shares[1] - 0.3).abs() < room, "{layer}: {shares:?}");
        }
    }
}

#[test]
fn the_bed_is_what_is_seen_through_the_water_and_foam_hides_it() {
    for (integrator, room) in [(Integrator::Whitted, 1e-6), (Integrator::Path, 0.02)] {
        let mut scene = uniform(1.0, 8);
        scene.render.integrator = integrator;
        scene.render.samples = 64;
        scene.camera.fov = 20.0;
        let water = waves(9, 4.0, |_, _| 0.0);
        let parts = vec![
            part("water", Material::Water, Shape::Surface(water)),
            part("terrain", Material::Ground, mesh(level(-1.0, 500.0))),
            part("sphere_0", Material::Diffuse(Vec3::splat(0.5)), ball(Vec3::new(0.0, 1.5, 0.0), 0.2)),
        ];
        let mut setup = with_mattes(scene, parts, [0.0, 4.0, 0.2]);
        setup.matter = Flat { water: Some(0.0), bed: Some(-1.0), ..Flat::default() };
        let (clear, _) = setup.render();
        let [water, ball] = ["water", "sphere_0"].map(|name| average(&matte(&clear, "CryptoObject", name)));
        // The ball is small in the middle of the picture; all else is water.
        assert!(ball > 0.02 && ball < 0.2 && (water + ball - 1.0).abs() < 1e-6, "{ball} {water}");
        let bed = average(&matte(&clear, "CryptoBed", "terrain"));
        assert!((bed - water).abs() < 1e-6 && matte(&clear, "CryptoBed", "sphere_0").iter().all(|&share| share == 0.0));
        assert_eq!(clear.metadata.cryptomattes.len(), 3);

        setup.matter.foam = Some(FoamLook { cover: 0.4, albedo: Vec3::splat(0.9), density: 0.4 });
        let (foamy, _) = setup.render();
        // Foam is of the water, and a material of its own.
        assert!((average(&matte(&foamy, "CryptoObject", "water")) - water).abs() < 1e-6);
        let [foam, clear] = ["foam", "water"].map(|name| average(&matte(&foamy, "CryptoMaterial", name)));
        let bed = average(&matte(&foamy, "CryptoBed", "terrain"));
        for (found, expected) in [(foam, 0.4 * water), (clear, 0.6 * water), (bed, 0.6 * water)] {
            assert!((found - expected).abs() < room, "{integrator:?}: {found} against {expected}");
        }
    }
}

#[test]
fn what_the_water_scatters_hides_the_bed_and_what_it_absorbs_does_not() {
    for absorption in [0.0, 0.8] {
        let mut scene = uniform(1.0, 8);
        (scene.render.integrator, scene.render.samples, scene.camera.fov) = (Integrator::Path, 16, 0.5);
        (scene.water.absorption, scene.water.scattering) = ([absorption, 0.5 * absorption, 0.0], [0.3; 3]);
        scene.water.roughness = 0.0;
        let parts = vec![
            part("water", Material::Water, Shape::Surface(waves(9, 4.0, |_, _| 0.0))),
            part("terrain", Material::Ground, mesh(level(-2.0, 500.0))),
        ];
        let mut setup = with_mattes(scene, parts, [0.0, 4.0, 0.01]);
        setup.matter = Flat { water: Some(0.0), bed: Some(-2.0), ..Flat::default() };
        let (picture, _) = setup.render();
        // Straight down through two metres; every pixel by itself: there is no noise in it.
        for bed in matte(&picture, "CryptoBed", "terrain") {
            assert!((f64::from(bed) - (-0.6_f64).exp()).abs() < 1e-4, "absorption {absorption}: {bed}");
        }
    }
}

#[test]
fn coverage_adds_up_to_all_that_is_not_sky() {
    for integrator in BOTH {
        let mut setup = super::promises::everything();
        setup.mattes = Mattes::ALL;
        setup.scene.render.integrator = integrator;
        setup.scene.sky.visible = false;
        let (picture, _) = setup.render();
        let alpha = samples(&picture, "A");
        // One more rank would hold them all: the pool has a bed, a ball, spray, mist and the water.
        for layer in ["CryptoObject", "CryptoMaterial"] {
            for (index, (sum, alpha)) in covered(&picture, layer).iter().zip(alpha).enumerate() {
                assert!((sum - alpha).abs() < 1e-5, "{integrator:?} {layer} {index}: {sum} against {alpha}");
            }
        }
        assert!(alpha.iter().any(|&alpha| alpha < 1.0) && alpha.contains(&1.0));
        // Nothing is seen through the water where there is none.
        let water = matte(&picture, "CryptoObject", "water");
        for (bed, water) in covered(&picture, "CryptoBed").iter().zip(water) {
            assert!(*bed <= water + 1e-5 || integrator == Integrator::Path, "{bed} {water}");
        }
        for (layer, name) in [
            ("CryptoObject", "water"),
            ("CryptoObject", "terrain"),
            ("CryptoObject", "spray"),
            ("CryptoObject", "mist"),
            ("CryptoObject", "sphere_0"),
            ("CryptoMaterial", "ground"),
            ("CryptoMaterial", "mist"),
            ("CryptoBed", "terrain"),
            ("CryptoBed", "sphere_0"),
        ] {
            assert!(matte(&picture, layer, name).iter().any(|&share| share > 0.1), "{integrator:?} {layer} {name}");
            let set = picture.metadata.cryptomattes.iter().find(|set| set.layer == layer);
            assert!(set.is_some_and(|set| set.names.iter().any(|known| known == name)));
        }
        // Every id is in its manifest.
        for set in &picture.metadata.cryptomattes {
            let known: Vec<u32> = set.names.iter().map(|name| id(name).to_bits()).chain([0]).collect();
            for name in channels(&set.layer).iter().step_by(2) {
                assert!(samples(&picture, name).iter().all(|found| known.contains(&found.to_bits())));
            }
        }
        // Whether mattes are asked for changes nothing else.
        setup.mattes = Mattes::default();
        let (without, _) = setup.render();
        assert!(without.metadata.cryptomattes.is_empty());
        for channel in &without.channels {
            assert!(samples(&picture, &channel.name) == channel.samples, "{}", channel.name);
        }
    }
}

#[test]
fn a_lamp_that_is_seen_is_a_thing_of_its_group() {
    let mut scene = uniform(1.0, 8);
    scene.render.integrator = Integrator::Path;
    scene.camera.fov = 10.0;
    let mut lamp = crate::scene::Light::point([0.0; 3], [1.0; 3]);
    lamp.radius = 3.0;
    scene.light = vec![lamp];
    let setup = with_mattes(scene, Vec::new(), [0.0, 0.0, 9.0]);
    let (picture, _) = setup.render();
    assert!(matte(&picture, "CryptoObject", "light_lamps").iter().all(|&share| share == 1.0));
    assert!(matte(&picture, "CryptoMaterial", "light").iter().all(|&share| share == 1.0));
}

#[test]
fn an_eye_in_murky_water_sees_water() {
    let mut scene = uniform(1.0, 8);
    scene.render.integrator = Integrator::Path;
    scene.render.samples = 64;
    scene.water.absorption = [0.0; 3];
    scene.water.scattering = [1.0; 3];
    scene.camera.fov = 5.0;
    let parts = vec![
        part("water", Material::Water, mesh(cuboid(Vec3::new(-50.0, -50.0, -50.0), Vec3::new(50.0, 0.0, 50.0)))),
        part("terrain", Material::Ground, mesh(level(-9.0, 40.0))),
    ];
    let mut setup = with_mattes(scene, parts, [0.0, -8.0, 0.01]);
    setup.look_at = [0.0, -9.0, 0.0];
    setup.matter = Flat { water: Some(0.0), bed: Some(-9.0), ..Flat::default() };
    let (picture, _) = setup.render();
    let [water, bed] = ["water", "terrain"].map(|name| average(&matte(&picture, "CryptoObject", name)));
    // Over a metre at 1/m a share of 1/e gets to the bed.
    assert!((bed - (-1.0_f64).exp()).abs() < 0.03 && (water + bed - 1.0).abs() < 1e-6, "{bed} {water}");
    assert!(covered(&picture, "CryptoBed").iter().all(|&share| share == 0.0));
}
