//! Pictures of spray whose light is known: billboards that turn to every ray and what is on them, and drops that scatter
//! sun and lamps in their own way.

use super::*;
use crate::{
    lower::{Curves, Discs, Spheres},
    optics::{Phase, Sun},
    scene::{Integrator, Light},
};

const BOTH: [(Integrator, u32); 2] = [(Integrator::Whitted, 16), (Integrator::Path, 256)];

fn billboards(center: &[Vec3], radius: f32, normal: Option<Vec3>) -> Part {
    let normal = normal.map(|normal| vec![normal.normalize(); center.len()]);
    let discs = Discs { center: center.to_vec(), radius: vec![radius; center.len()], normal };
    part("spray", Material::Spray { first: 0 }, Shape::Discs(Arc::new(discs)))
}

/// Spray that is black: it stops the light behind it and gives none.
fn black(opacity: f32) -> SprayLook {
    SprayLook { albedo: Vec3::ZERO, opacity, share: 1.0, velocity: Vec3::ZERO }
}

/// How much of the light of all pixels is gone, counted in pixels.
fn missing(setup: impl Fn(bool) -> Setup) -> f64 {
    let [with, without] = [true, false].map(|there| setup(there).render().0);
    let gone = |(with, without): (&f32, &f32)| 1.0 - f64::from(*with) / f64::from(*without);
    samples(&with, "G").iter().zip(samples(&without, "G")).map(gone).sum()
}

const DISC: Vec3 = Vec3::new(0.0, 3.0, 0.0);

/// A billboard in the sky as it is seen in still water from (6, 2, 0), or without water from that point's mirror image.
fn in_water(mirrored: bool, normal: Option<Vec3>, opacity: f32, texture: Option<fn([f32; 2]) -> Texel>) -> f64 {
    missing(|there| {
        let mut scene = uniform(1.0, 48);
        (scene.camera.fov, scene.water.roughness, scene.water.absorption) = (7.0, 0.0, [1.0; 3]);
        scene.render.samples = 16;
        let mut parts = Vec::new();
        let mut view = ([6.0, -2.0, 0.0], [0.0, 3.0, 0.0]);
        if mirrored {
            parts.push(part("water", Material::Water, mesh(level(0.0, 100.0))));
            view = ([6.0, 2.0, 0.0], [0.0, -3.0, 0.0]);
        }
        if there {
            parts.push(billboards(&[DISC], 0.3, normal));
        }
        let mut setup = Setup::new(scene, parts, view.0, view.1);
        (setup.matter.spray, setup.matter.texture) = (black(opacity), texture);
        setup
    })
}

#[test]
fn a_soft_ball_stops_what_the_drops_on_each_way_through_it_stop() {
    let ball = |softness: f64, streak: bool, share: f32| {
        missing(|there| {
            let mut scene = uniform(1.0, 64);
            (scene.camera.fov, scene.render.samples, scene.particles.softness) = (3.0, 64, softness);
            let (center, radius) = (vec![Vec3::ZERO], vec![0.2]);
            let shape = if streak {
                Shape::Curves(Arc::new(Curves { ends: vec![[Vec3::ZERO; 2]], radius: vec![[0.2; 2]] }))
            } else {
                Shape::Spheres(Arc::new(Spheres { center, radius }))
            };
            let parts = if there { vec![part("spray", Material::Spray { first: 0 }, shape)] } else { Vec::new() };
            let mut setup = Setup::new(scene, parts, [0.0, 0.0, 10.0], [0.0; 3]);
            setup.matter.spray = SprayLook { share, ..black(0.9) };
            setup
        })
    };
    let hard = ball(0.0, false, 1.0);
    // Over a disc of radius 1 the half chord c is met with density 2 c: the mean of 1 - (1 - 0.9)^(c^3), by midpoints.
    let steps = 10_000_u32;
    let c = |k: u32| (f64::from(k) + 0.5) / f64::from(steps);
    let stopped: f64 =
        (0..steps).map(|k| (1.0 - 0.1_f64.powf(c(k).powi(3))) * 2.0 * c(k)).sum::<f64>() / f64::from(steps);
    for streak in [false, true] {
        let soft = ball(1.0, streak, 1.0);
        assert!((soft / hard / (stopped / 0.9) - 1.0).abs() < 0.01, "{streak}: {soft} of {hard}");
        // What is drawn wider is as soft, and stops its share.
        let faint = ball(1.0, streak, 0.25);
        assert!((faint / soft - 0.25).abs() < 0.003, "{streak}: {faint} of {soft}");
    }
}

#[test]
fn a_billboard_in_still_water_is_as_large_as_from_the_mirrored_eye() {
    let direct = in_water(false, None, 1.0, None);
    assert!(direct > 150.0, "{direct}");
    // A disc square to the line from afar L stops the lines that pass its centre within r / sqrt(1 + r^2 / L^2); mirrored
    // rays begin at the water, nearer than the eye: 0.3 % at this size.
    let mirrored = in_water(true, None, 1.0, None);
    assert!((mirrored / direct - 1.0).abs() < 0.01, "{mirrored} {direct}");
    // One that faces the eye itself turns its edge to the water.
    let fixed = in_water(true, Some(Vec3::new(6.0, 2.0, 0.0) - DISC), 1.0, None);
    assert!(fixed < 0.92 * direct, "{fixed} {direct}");
}

#[test]
fn a_texture_cuts_holes_and_thins_in_mirrors_as_well() {
    let inner = |[x, y]: [f32; 2]| Texel { color: Vec3::ONE, alpha: if x * x + y * y < 0.25 { 0.5 } else { 0.0 } };
    // Right of its middle; from the mirrored eye as well.
    let right = |[x, _]: [f32; 2]| Texel { color: Vec3::ONE, alpha: f32::from(u8::from(x > 0.0)) };
    for mirrored in [false, true] {
        let whole = in_water(mirrored, None, 1.0, None);
        let thin = in_water(mirrored, None, 0.8, Some(inner));
        assert!((thin / whole - 0.8 * 0.5 * 0.25).abs() < 3e-3, "{mirrored}: {thin} of {whole}");
        let half = in_water(mirrored, None, 1.0, Some(right));
        assert!((half / whole - 0.5).abs() < 0.02, "{mirrored}: {half} of {whole}");
    }
}

#[test]
fn alphas_in_a_row_multiply_though_the_discs_lie_in_each_others_balls() {
    let row: Vec<Vec3> = (0..3_u8).map(|k| Vec3::new(0.0, 0.0, 0.1 * f32::from(k))).collect();
    let texture: fn([f32; 2]) -> Texel = |_| Texel { color: Vec3::ONE, alpha: 0.5 };
    let left = 0.6_f64.powi(3);
    for (integrator, samples) in BOTH {
        for normal in [None, Some(Vec3::Z)] {
            let mut scene = uniform(1.0, 16);
            (scene.render.integrator, scene.render.samples, scene.camera.fov) = (integrator, samples, 1.0);
            let mut setup = Setup::new(scene, vec![billboards(&row, 1.0, normal)], [0.0, 0.0, 9.0], [0.0; 3]);
            (setup.matter.spray, setup.matter.texture) = (black(0.8), Some(texture));
            let seen = mean(&setup.render().0, "G");
            assert!((seen / left - 1.0).abs() < 0.02, "{integrator:?} {normal:?}: {seen}");

            // The same between a lamp and a card.
            let light = |opacity: f32| {
                let mut scene = uniform(0.0, 8);
                (scene.render.integrator, scene.render.samples, scene.camera.fov) = (integrator, 16, 1.0);
                scene.light = vec![Light::point([0.0, 6.0, 0.0], [5.0; 3])];
                let level: Vec<Vec3> = row.iter().map(|place| Vec3::new(0.0, 4.0 + place.z, 0.0)).collect();
                let parts = vec![
                    part("card", Material::Diffuse(Vec3::splat(0.5)), mesh(super::level(0.0, 10.0))),
                    billboards(&level, 1.0, normal.map(|_| Vec3::Y)),
                ];
                let mut setup = Setup::new(scene, parts, [0.0, 1.0, 6.0], [0.0; 3]);
                (setup.matter.spray, setup.matter.texture) = (black(opacity), Some(texture));
                mean(&setup.render().0, "G")
            };
            let (clear, thinned) = (light(0.0), light(0.8));
            assert!(
                clear > 1e-3 && (thinned / clear / left - 1.0).abs() < 0.02,
                "{integrator:?}: {thinned} of {clear}"
            );
        }
    }
}

#[test]
fn a_billboard_does_not_shade_itself() {
    // Lit from the side: its own disc, seen from a point of it, lies between that and the lamp.
    for (integrator, samples) in BOTH {
        let seen = |normal: Option<Vec3>| {
            let mut scene = uniform(0.0, 16);
            (scene.render.integrator, scene.render.samples, scene.camera.fov) = (integrator, samples, 10.0);
            scene.light = vec![Light::point([40.0, 0.0, 40.0], [1000.0; 3])];
            let parts = vec![billboards(&[Vec3::ZERO], 1.0, normal)];
            let mut setup = Setup::new(scene, parts, [0.0, 0.0, 12.0], [0.0; 3]);
            setup.matter.spray = SprayLook { albedo: Vec3::ONE, opacity: 1.0, share: 1.0, velocity: Vec3::ZERO };
            mean(&setup.render().0, "G")
        };
        let (facing, fixed) = (seen(None), seen(Some(Vec3::Z)));
        assert!(fixed > 0.01 && (facing / fixed - 1.0).abs() < 0.02, "{integrator:?}: {facing} {fixed}");
    }
}

const RADIUS: f32 = 4e-4;

/// One ball of drops, which fills the picture, seen along -z.
fn drops(integrator: Integrator, samples: u32, share: f64) -> Setup {
    let mut scene = uniform(0.0, 8);
    (scene.render.integrator, scene.render.samples, scene.camera.fov) = (integrator, samples, 0.02);
    scene.particles.rainbow = share;
    let parts = vec![part("spray", Material::Spray { first: 0 }, ball(Vec3::ZERO, 1.0))];
    let mut setup = Setup::new(scene, parts, [0.0, 0.0, 9.0], [0.0; 3]);
    setup.matter.spray = SprayLook { albedo: Vec3::splat(0.8), opacity: 1.0, share: 1.0, velocity: Vec3::ZERO };
    (setup.matter.drop_radius, setup.matter.rainbow) = (Some(RADIUS), Some(Rainbow::build(0.1)));
    setup
}

#[test]
fn drops_scatter_the_sun_by_angle_and_color_in_both_integrators() {
    use std::f32::consts::FRAC_1_PI;
    for (integrator, samples) in BOTH {
        // Behind the eye at the bow and beside it; across; in front of it, through the drop.
        for (elevation, azimuth) in [(41.7, 180.0), (40.0, 180.0), (30.0, 180.0), (5.0, 100.0), (20.0, 5.0)] {
            for share in [0.0, 0.5, 1.0] {
                let mut setup = drops(integrator, samples, share);
                (setup.scene.sun.elevation, setup.scene.sun.azimuth) = (elevation, azimuth);
                setup.scene.sun.irradiance = 2.0;
                let sun = Sun::build(&setup.scene.sun, &setup.scene.sky);
                let (plain, share) = (sun.direction.z.max(0.0) * FRAC_1_PI, share as f32);
                let own = setup.matter.rainbow.as_ref().unwrap().refracted(RADIUS, -sun.direction.z);
                let expected = 0.8 * sun.irradiance * ((1.0 - share) * plain + share * own);
                let (picture, stats) = setup.render();
                assert_eq!(stats.nonfinite, 0);
                for (axis, name) in ["R", "G", "B"].into_iter().enumerate() {
                    let seen = mean(&picture, name);
                    let off = (seen - f64::from(expected[axis])).abs();
                    assert!(
                        off <= 0.01 * f64::from(expected.max_element()),
                        "{integrator:?} {elevation} {share} {name}: {seen} {expected}"
                    );
                }
            }
        }
    }
}

#[test]
fn a_wide_lamp_met_by_chance_gives_the_plain_share_alone() {
    // Wide enough that a good part of it would be found by chance.
    let (place, radius) = (Vec3::new(3.0, 0.0, 5.0), 2.0_f32);
    for share in [0.0, 0.5, 1.0] {
        let mut setup = drops(Integrator::Path, 1024, share);
        let lamp = Light { radius: f64::from(radius), ..Light::point([3.0, 0.0, 5.0], [7.0; 3]) };
        setup.scene.light = vec![lamp];
        let rainbow = setup.matter.rainbow.clone().unwrap();
        let to = place - Vec3::Z;
        let radiance = 7.0 / (std::f32::consts::PI * radius * radius);
        let height = 1.0 - (1.0 - radius * radius / to.length_squared()).sqrt();
        let (across, along) = to.normalize().any_orthonormal_pair();
        let (mut own, count) = (Vec3::ZERO, 100_000);
        for index in 0..count {
            let [u, v, ..] = sobol_burley::sample_4d(index, 0, 5);
            let (cos, turn) = (1.0 - height * u, std::f32::consts::TAU * v);
            let sin = (1.0 - cos * cos).max(0.0).sqrt();
            let way = cos * to.normalize() + sin * (across * turn.cos() + along * turn.sin());
            own += rainbow.refracted(RADIUS, -way.z) / count as f32;
        }
        own *= radiance * std::f32::consts::TAU * height;
        let plain = 7.0 / to.length_squared() * to.normalize().z * std::f32::consts::FRAC_1_PI;
        let expected = 0.8 * ((1.0 - share as f32) * plain + share as f32 * own);
        let picture = setup.render().0;
        for (axis, name) in ["R", "G", "B"].into_iter().enumerate() {
            let seen = mean(&picture, name);
            let off = (seen / f64::from(expected[axis]) - 1.0).abs();
            assert!(off < 0.02, "{share} {name}: {seen} {expected}");
        }
    }
}

#[test]
fn mist_scatters_the_sun_as_its_droplets_do() {
    for (integrator, samples) in BOTH {
        for (elevation, azimuth) in [(40.5, 180.0), (20.0, 5.0)] {
            let seen = |share: f64| {
                let mut scene = uniform(0.0, 8);
                (scene.render.integrator, scene.render.samples, scene.camera.fov) = (integrator, samples, 0.1);
                (scene.sun.elevation, scene.sun.azimuth, scene.sun.irradiance) = (elevation, azimuth, 1.0);
                (scene.particles.rainbow, scene.particles.droplet_radius) = (share, 5e-5);
                let sun = Sun::build(&scene.sun, &scene.sky);
                let mut setup = Setup::new(scene, Vec::new(), [0.0, 0.0, 9.0], [0.0; 3]);
                setup.matter.mist = Some(super::mist::cloud(&[[0.0; 3]], 2e-6, 0.5));
                setup.matter.rainbow = Some(Rainbow::build(0.1));
                (["R", "G", "B"].map(|name| mean(&setup.render().0, name)), sun, setup.matter.rainbow)
            };
            let ((plain, ..), (own, sun, rainbow)) = (seen(0.0), seen(1.0));
            let cosine = -sun.direction.z;
            let gain = rainbow.unwrap().scattered(5e-5, cosine) / Phase::HenyeyGreenstein { g: 0.85 }.value(cosine);
            for axis in 0..3 {
                let off = (own[axis] / plain[axis] / f64::from(gain[axis]) - 1.0).abs();
                assert!(plain[axis] > 1e-8 && off < 0.03, "{integrator:?} {elevation}: {own:?} {plain:?} {gain}");
            }
        }
    }
}

#[test]
fn a_drop_of_water_bends_and_dims_what_is_seen_through_it_as_a_sphere_does() {
    const N: f32 = 1.333;
    for aside in [0.0_f32, 0.3, 0.6, 0.86, 0.95] {
        // Entry and exit at one pair of angles; the way inside is 2 cos(refracted), the whole turn 2 (incident - refracted).
        let incident = aside.asin();
        let refracted = (aside / N).asin();
        let way = |turn: f32| Vec3::new(-turn.sin(), 0.0, -turn.cos());
        let inside = 2.0 * refracted.cos();
        let out = Vec3::new(aside, 0.0, incident.cos()) + inside * way(incident - refracted);
        let passed = 1.0 - crate::optics::fresnel::reflectance_exact(incident.cos(), 1.0, N);
        let radius = 0.05_f32;
        let seen = |turn: f32| {
            let mut scene = uniform(0.0, 8);
            (scene.render.integrator, scene.render.samples) = (Integrator::Path, 256);
            (scene.camera.fov, scene.water.roughness, scene.water.absorption) = (0.02, 0.0, [0.5, 0.2, 0.1]);
            let lamp = (out + 6.0 * way(turn)).as_dvec3().to_array();
            scene.light = vec![Light { radius: f64::from(radius), ..Light::point(lamp, [1.0; 3]) }];
            let eye = glam::DVec3::new(f64::from(aside), 0.0, 9.0);
            let parts = vec![part("spray", Material::Sheet, ball(Vec3::ZERO, 1.0))];
            let picture = Setup::new(scene, parts, eye.to_array(), [eye.x, 0.0, 0.0]).render().0;
            ["R", "G", "B"].map(|name| mean(&picture, name) as f32)
        };
        let turn = 2.0 * (incident - refracted);
        let (there, beside) = (seen(turn), seen(turn + 3.0 * radius / 6.0));
        let radiance = 1.0 / (std::f32::consts::PI * radius * radius);
        for ((there, beside), absorption) in there.into_iter().zip(beside).zip([0.5, 0.2, 0.1_f32]) {
            let expected = radiance * passed * passed * (-absorption * inside).exp();
            assert!((there / expected - 1.0).abs() < 0.02, "{aside}: {there}, not {expected}");
            // What is left there is what the drop mirrored inside first.
            assert!(beside < 0.01 * expected, "{aside}: {beside} beside {expected}");
        }
    }
}
