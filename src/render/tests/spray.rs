//! Pictures of particles from a frame on: what is thinned covers as much, what moves and is born covers its share, crowds end.

use super::*;
use crate::{
    lower::{self, Environment, LoweredFrame, View},
    particles::Spray,
    scene::{DropMatter, Integrator, ParticleRepresentation},
    state::{self, Columns, Frame, Particles},
};

/// A ball's mass (kg).
fn mass(radius: f64) -> f64 {
    crate::particles::mass(radius)
}

/// A frame of particles over dry ground that is not drawn.
fn frame(particles: Particles) -> Frame {
    let columns = Columns::level([-1.0; 2], [1.0; 2], [3, 3], -10.0, -10.0);
    Frame { columns, particles, ..Frame::default() }
}

/// A furnace of radiance 1 seen from `EYE`, in which white, opaque things have a radiance of 1 as well.
fn furnace(size: u32, samples: u32) -> Scene {
    let mut scene = uniform(1.0, size);
    (scene.terrain.visible, scene.water.visible) = (false, false);
    (scene.particles.opacity, scene.particles.fade_age) = (1.0, 1e9);
    scene.render.samples = samples;
    scene.render.integrator = Integrator::Whitted;
    scene.camera.fov = 20.0;
    scene.accel = Accel::default();
    scene
}

const EYE: [f64; 3] = [0.0, 0.0, 20.0];

/// The moments of a picture, seen from the eye around one origin.
fn lowered(scene: &Scene, frames: &[Frame]) -> Vec<LoweredFrame> {
    let pixel_angle = scene.camera.fov.to_radians() / f64::from(scene.render.height);
    let view = View { eye: EYE.into(), pixel_angle };
    let lower = |frame: &Frame| {
        lower::lower_within(None, DVec3::ZERO, scene, frame, &Environment::default(), Some(view), SimdLevel::detect())
    };
    frames.iter().map(|frame| lower(frame).unwrap()).collect()
}

/// A picture of such moments, in which every particle is white.
fn picture(scene: &Scene, moments: Vec<LoweredFrame>) -> (Picture, RenderStats) {
    let mut parts = moments.into_iter();
    let first = parts.next().unwrap();
    let mut setup = Setup::new(scene.clone(), first.lowered.parts, EYE, [0.0; 3]);
    setup.later = parts.map(|moment| moment.lowered).collect();
    setup.matter.mist = first.mist.as_deref().cloned();
    setup.matter.spray = SprayLook { albedo: Vec3::ONE, opacity: 1.0, share: 1.0, velocity: Vec3::ZERO };
    setup.threads = 2;
    setup.render()
}

/// Particles at rest.
fn still(position: Vec<[f64; 3]>, radius: f64) -> Particles {
    let count = position.len();
    Particles {
        position,
        velocity: vec![[0.0; 3]; count],
        mass: vec![mass(radius); count],
        age: vec![0.0; count],
        id: Some((0..count as u64).collect()),
    }
}

#[test]
fn a_thinned_cloud_covers_as_much_as_the_full_one() {
    // A pixel is a tenth of a metre wide there, and a ball's radius a thirtieth of that.
    let place = |k: u32| {
        let [x, y, z, _] = sobol_burley::sample_4d(k, 0, 3);
        [f64::from(x) * 6.6 - 3.3, f64::from(y) * 6.6 - 3.3, f64::from(z) - 0.5]
    };
    let count = 65_536;
    let places = (0..count).map(place).collect();
    let frame = frame(Particles { velocity: vec![[3.0, 0.0, 0.0]; count as usize], ..still(places, 0.003) });
    for representation in
        [ParticleRepresentation::Spheres, ParticleRepresentation::Billboards, ParticleRepresentation::Streamlines]
    {
        let mut scene = furnace(72, 256);
        scene.particles.representation = representation;
        // All are opaque here: none may be widened for its own thinness.
        scene.particles.least_width = 0.0;
        let mut light = |least: f64| {
            scene.particles.least_pixels = least;
            let moments = lowered(&scene, std::slice::from_ref(&frame));
            let thinning = moments[0].thinning;
            assert_eq!((thinning.found, thinning.drawn < 40_000), (65_536, least > 0.0), "{thinning:?}");
            mean(&picture(&scene, moments).0, "spray.G")
        };
        let (full, thin) = (light(0.0), light(0.045));
        assert!(full > 0.02 && (thin / full - 1.0).abs() < 0.01, "{representation:?}: {thin} for {full}");
    }
}

#[test]
fn a_row_of_streaks_closes_up_and_covers_as_much() {
    // 21 strands, 3 cm apart, each of 0.2 m; a pixel is 7 mm wide there.
    let places = (0..21).map(|k| [0.03 * f64::from(k) - 0.3, -0.1, 0.0]).collect();
    let frame = frame(Particles { velocity: vec![[0.0, -10.0, 0.0]; 21], ..still(places, 0.012) });
    let mut scene = furnace(96, 256);
    (scene.camera.fov, scene.particles.representation) = (2.0, ParticleRepresentation::Streamlines);
    (scene.particles.taper, scene.particles.least_opacity) = (1.0, 0.0);
    let mut row = |merging: f64| {
        scene.particles.merging = merging;
        let moment = lowered(&scene, std::slice::from_ref(&frame)).remove(0);
        let share = moment.spray.appearance(10).share;
        let mut setup = Setup::new(scene.clone(), moment.lowered.parts, EYE, [0.0; 3]);
        setup.matter.spray = SprayLook { albedo: Vec3::ONE, opacity: 0.5, share, velocity: Vec3::ZERO };
        let (picture, stats) = setup.render();
        assert_eq!(stats.nonfinite, 0);
        let channel = picture.channels.iter().find(|channel| channel.name == "spray.G").unwrap();
        // Between the strands' ends, within the outermost of the row.
        let across: Vec<f64> =
            (20..76).map(|x| (40..56).map(|y| f64::from(channel.samples[y * 96 + x])).sum::<f64>() / 16.0).collect();
        let middle = across.iter().sum::<f64>() / 56.0;
        let variance = across.iter().map(|value| (value / middle - 1.0).powi(2)).sum::<f64>() / 56.0;
        (mean(&picture, "spray.G"), variance)
    };
    let ((hairs, apart), (veil, even)) = (row(0.0), row(0.4));
    assert!(apart > 0.3 && even < apart / 50.0, "a variance of {even} for {apart}");
    assert!(hairs > 0.01 && (veil / hairs - 1.0).abs() < 0.02, "{veil} for {hairs}");
}

#[test]
fn a_ball_that_moves_covers_what_its_chords_say() {
    // Sideways by 3 m while the shutter is open, in 64 moments, before an orthographic enough eye.
    let (radius, way, steps) = (0.5, 3.0, 64);
    let mut ball = still(vec![[-0.5 * way, 0.0, 0.0]], radius);
    ball.velocity = vec![[way * 24.0, 0.0, 0.0]];
    let (now, next) = (frame(ball.clone()), frame(Particles { age: vec![1.0], ..ball }));
    let mut scene = furnace(96, 256);
    scene.camera.motion_steps = steps;
    let share = |step: u32| (f64::from(step) + 0.5) / f64::from(steps);
    let frames: Vec<Frame> = (0..steps).map(|step| state::between(&now, &next, share(step), 24.0).unwrap()).collect();
    let (picture, _) = picture(&scene, lowered(&scene, &frames));
    let width = 2.0 * 20.0 * 10f64.to_radians().tan();
    // What an eye at 20 m sees of it is wider by 1 / sqrt(1 - (r / d)^2).
    let seen = radius / (1.0 - (radius / 20.0_f64).powi(2)).sqrt();
    let area = std::f64::consts::PI * seen * seen / (width * width);
    let whole = mean(&picture, "spray.G");
    assert!((whole / area - 1.0).abs() < 0.01, "{whole} for {area}");
    // Along each row: the share of the way during which the ball's chord lies over the pixel.
    let values = samples(&picture, "spray.G");
    let pixel = width / 96.0;
    let mut worst = 0.0f64;
    for y in 40..56 {
        let height = (f64::from(y) + 0.5 - 48.0) * pixel;
        let half = (seen * seen - height * height).max(0.0).sqrt();
        for x in 0..96 {
            let place = (f64::from(x) + 0.5 - 48.0) * pixel;
            let covered = (place + half).min(0.5 * way) - (place - half).max(-0.5 * way);
            let expected = (covered / way).clamp(0.0, 1.0);
            let got = f64::from(values[(y * 96 + x) as usize]);
            // Within a pixel the chord's ends pass, and moments are a 64th of the way apart.
            worst = worst.max((got - expected).abs());
        }
    }
    assert!(worst < 0.04, "{worst}");
}

#[test]
fn a_drop_born_half_way_through_the_shutter_covers_half() {
    let mut scene = furnace(32, 64);
    let steps = 8;
    scene.camera.motion_steps = steps;
    let cover = |age: f64| {
        let born = Particles { age: vec![age], ..still(vec![[0.0; 3]], 1.0) };
        let nobody = Particles { id: Some(Vec::new()), ..Particles::default() };
        let before = if age < 1.0 / 24.0 { nobody } else { still(vec![[0.0; 3]], 1.0) };
        let (now, next) = (frame(before), frame(born));
        let share = |step: u32| (f64::from(step) + 0.5) / f64::from(steps);
        let frames: Vec<Frame> =
            (0..steps).map(|step| state::between(&now, &next, share(step), 24.0).unwrap()).collect();
        mean(&picture(&scene, lowered(&scene, &frames)).0, "spray.G")
    };
    let (whole, half) = (cover(1.0), cover(0.5 / 24.0));
    assert!(whole > 0.05 && (half / whole - 0.5).abs() < 0.01, "{half} of {whole}");
}

#[test]
fn mist_that_moves_sideways_has_its_motion_in_pixels() {
    let place = |k: i32| [k % 12, k / 12 % 12, k / 144].map(|step| 0.25 * (f64::from(step) - 5.5));
    let cloud = Particles { velocity: vec![[6.0, -3.0, 0.0]; 1728], ..still((0..1728).map(place).collect(), 0.05) };
    for integrator in [Integrator::Whitted, Integrator::Path] {
        let mut scene = furnace(48, 16);
        scene.render.integrator = integrator;
        scene.particles.representation = ParticleRepresentation::Mist;
        (scene.particles.mist_share, scene.particles.mist_width) = (1.0, 0.5);
        let (dense, stats) = picture(&scene, lowered(&scene, &[frame(cloud.clone())]));
        assert_eq!(stats.nonfinite, 0);
        let value = |picture: &Picture, name: &str| f64::from(samples(picture, name)[24 * 48 + 24]);
        let depth = value(&dense, "Z");
        assert!((17.0..20.0).contains(&depth), "{depth}");
        // Pixels of a metre at that depth, by frames.
        let scale = 24.0 / (10f64.to_radians().tan() * depth) / 24.0;
        for (name, expected) in [
            ("forward.u", 6.0 * scale),
            ("forward.v", -3.0 * scale),
            ("backward.u", -6.0 * scale),
            ("backward.v", 3.0 * scale),
            ("velocity.x", 6.0),
        ] {
            let got = value(&dense, name);
            assert!((got / expected - 1.0).abs() < 0.02, "{integrator:?}: {name} is {got}, not {expected}");
        }
        // A veil is no first thing.
        scene.particles.mist_share = 1e-6;
        let (thin, _) = picture(&scene, lowered(&scene, &[frame(cloud.clone())]));
        assert!(mean(&thin, "mist.G") > 0.0 && value(&thin, "Z") == 1e10 && value(&thin, "velocity.x") == 0.0);
    }
}

const ALL: [ParticleRepresentation; 6] = [
    ParticleRepresentation::Spheres,
    ParticleRepresentation::Billboards,
    ParticleRepresentation::Streamlines,
    ParticleRepresentation::Mist,
    ParticleRepresentation::Surface,
    ParticleRepresentation::Auto,
];

#[test]
fn a_million_particles_in_one_place_end_in_a_picture_whatever_they_are_drawn_as() {
    let count = 1_000_000;
    let mut crowd = still(vec![[0.1, 0.2, 0.3]; count], 0.4);
    crowd.velocity.fill([3.0, -2.0, 1.0]);
    let frame = frame(crowd);
    for representation in ALL {
        let mut scene = furnace(12, 4);
        scene.particles.representation = representation;
        let moments = lowered(&scene, std::slice::from_ref(&frame));
        let alone = moments[0].spray.len() + usize::from(moments[0].mist.is_some());
        assert_eq!(alone, 1, "{representation:?}");
        let (picture, stats) = picture(&scene, moments);
        assert_eq!(stats.nonfinite, 0);
        assert!(picture.channels.iter().flat_map(|channel| &channel.samples).all(|value| value.is_finite()));
        let seen = mean(&picture, "spray.G") + mean(&picture, "mist.G") + mean(&picture, "reflection.G");
        // A drop by itself is no sheet.
        assert!(seen > 1e-3 || representation == ParticleRepresentation::Surface, "{representation:?}: {seen}");
    }
}

#[test]
fn particles_of_any_size_weight_and_age_leave_every_pixel_a_number() {
    let radii = [1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 0.1, 1.0, 10.0, 100.0];
    let mut all = Particles::default();
    for (k, &radius) in radii.iter().enumerate() {
        // From a metre off to right around the eye, at rest and fast, new and as old as files may say.
        for (age, velocity) in [(0.0, [0.0; 3]), (f64::MAX, [1e4, -3.0, 1e-20])] {
            all.position.push([k as f64 - 4.0, 0.3, if radius > 5.0 { -200.0 } else { 0.0 }]);
            all.velocity.push(velocity);
            all.mass.push(mass(radius));
            all.age.push(age);
        }
    }
    for mass in [0.0, f64::MIN_POSITIVE, 1e-300] {
        all.position.push([0.0; 3]);
        all.velocity.push([0.0; 3]);
        all.mass.push(mass);
        all.age.push(0.0);
    }
    all.position.push(EYE);
    all.velocity.push([0.0; 3]);
    all.mass.push(mass(1e-3));
    all.age.push(0.0);
    let frame = frame(all);
    for representation in ALL {
        for matter in [DropMatter::Diffuse, DropMatter::Water] {
            let mut scene = furnace(12, 4);
            (scene.particles.representation, scene.particles.matter) = (representation, matter);
            scene.particles.size_spread = 0.5;
            // The widest and the narrowest are eight digits apart: no one grid joins them.
            if representation == ParticleRepresentation::Surface {
                let told = lower::lower(&scene, &frame, &Environment::default(), None, SimdLevel::detect());
                assert!(told.is_ok() || told.unwrap_err().to_string().contains("particles.sheet"));
                continue;
            }
            let (picture, stats) = picture(&scene, lowered(&scene, std::slice::from_ref(&frame)));
            assert_eq!(stats.nonfinite, 0, "{representation:?} {matter:?}");
            assert!(picture.channels.iter().flat_map(|channel| &channel.samples).all(|value| value.is_finite()));
        }
    }
    let spray = Spray::build(&frame.particles, &crate::scene::Particles::default(), DVec3::ZERO);
    assert_eq!(spray.without_size, 3, "no mass, or none that single precision knows a radius of");
}
