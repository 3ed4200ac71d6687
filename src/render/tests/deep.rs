//! Deep pictures: spans that are known, and the flat picture that they make when they are flattened.

use super::*;
use crate::{
    output::DeepSample,
    scene::{DeepWater, Integrator},
};

/// The samples of the pixel in the middle.
fn middle(deep: &DeepPicture) -> Vec<DeepSample> {
    let (width, height) = (deep.data.width as usize, deep.data.height as usize);
    deep.pixel(height / 2 * width + width / 2).to_vec()
}

fn near(value: f32, expected: f64, room: f64) -> bool {
    (f64::from(value) - expected).abs() <= room
}

/// Half a ball of spray before half a wall, no sky: from 9 m off.
fn ball_and_wall(integrator: Integrator) -> Setup {
    let mut scene = uniform(0.7, 24);
    (scene.render.integrator, scene.render.samples, scene.camera.fov) = (integrator, 32, 20.0);
    (scene.sky.visible, scene.particles.softness) = (false, 0.0);
    (scene.sun.irradiance, scene.sun.elevation, scene.sun.azimuth) = (1.0, 30.0, 150.0);
    let wall = Triangles {
        position: vec![
            Vec3::new(-9.0, 0.4, -3.0),
            Vec3::new(9.0, 0.4, -3.0),
            Vec3::new(9.0, -9.0, -3.0),
            Vec3::new(-9.0, -9.0, -3.0),
        ],
        normal: Vec::new(),
        index: vec![[0, 2, 1], [0, 3, 2]],
    };
    let parts = vec![
        part("spray", Material::Spray { first: 0 }, ball(Vec3::ZERO, 1.0)),
        part("wall", Material::Diffuse(Vec3::new(0.5, 0.4, 0.3)), mesh(wall)),
    ];
    let mut setup = Setup::new(scene, parts, [0.0, 0.0, 9.0], [0.0; 3]);
    setup.matter.spray = SprayLook { albedo: Vec3::splat(0.8), opacity: 0.75, share: 1.0, velocity: Vec3::ZERO };
    setup
}

#[test]
fn a_ball_is_a_span_from_its_front_to_its_back_and_a_wall_a_step() {
    let (_, deep) = ball_and_wall(Integrator::Whitted).render_deep();
    let samples = middle(&deep);
    let (wall, ball) = samples.split_last().unwrap();
    let left = |depth: f32| ball.iter().fold(1.0, |left, sample| left * (1.0 - sample.alpha_before(depth)));
    // The pixel's samples are up to 0.2 m aside, where the ball is 0.02 m thinner on either side.
    assert!(
        ball.len() <= 3 && near(ball[0].front, 8.0, 0.02) && near(ball[ball.len() - 1].back, 10.0, 0.02),
        "{ball:?}"
    );
    assert!(near(left(9.0), 0.5, 0.01) && near(left(11.0), 0.25, 0.003), "half of the ball stops half: {ball:?}");
    assert!(near(wall.front, 12.0, 1e-3) && wall.back == wall.front && wall.alpha == 1.0);
    // Right of the ball and above the wall is nothing.
    assert!(deep.pixel(0).is_empty());
}

#[test]
fn flattened_it_is_the_flat_picture() {
    for integrator in [Integrator::Whitted, Integrator::Path] {
        for (color, motion) in [(true, false), (false, true)] {
            let mut setup = ball_and_wall(integrator);
            setup.scene.output.deep.color = color;
            if motion {
                let mut later = setup.lowered.clone();
                later.parts[0].shape = ball(Vec3::new(0.3, 0.1, 0.5), 1.0);
                setup.later.push(later);
            }
            setup.matter.mist = Some(super::mist::cloud(&[[0.4, 0.2, 2.0]], 2e-5, 0.4));
            let (flat, deep) = setup.render_deep();
            assert_eq!(deep.colored, color);
            let mut total = [0.0f64; 2];
            for index in 0..24 * 24 {
                let (alpha, light) = DeepSample::flatten(deep.pixel(index));
                // Paths take or leave mist by chance, the deep picture by its share.
                let room = if integrator == Integrator::Path { 0.35 } else { 2e-3 };
                let given = samples(&flat, "A")[index];
                assert!((alpha - given).abs() < room, "{integrator:?} {index}: {alpha} {given}");
                total[0] += f64::from(alpha);
                total[1] += f64::from(given);
                for (axis, name) in ["R", "G", "B"].into_iter().enumerate().filter(|_| color) {
                    let given = samples(&flat, name)[index];
                    assert!((light[axis] - given).abs() < 1e-3 * given.max(1.0), "{index}: {light:?} {given}");
                }
            }
            assert!((total[0] / total[1] - 1.0).abs() < 3e-3, "{integrator:?} {total:?}");
        }
    }
}

#[test]
fn mist_is_as_deep_as_its_grid_says_and_what_is_before_it_sees_none_of_it() {
    let mut scene = uniform(0.0, 8);
    (scene.camera.fov, scene.sky.visible) = (0.01, false);
    let mut setup = Setup::new(scene, Vec::new(), [0.0, 0.0, 9.0], [0.0; 3]);
    let place: Vec<[f64; 3]> = (0..40).map(|k| [0.01 * f64::from(k % 5), 0.0, 0.1 * f64::from(k) - 2.0]).collect();
    setup.matter.mist = Some(super::mist::cloud(&place, 4e-5, 0.4));
    let depth = setup.matter.mist.as_ref().unwrap().optical_depth(Vec3::new(0.0, 0.0, 9.0), Vec3::NEG_Z, 100.0);
    assert!((0.05..3.0).contains(&depth), "{depth}");
    setup.scene.output.deep.alpha_tolerance = 1e-3;
    let samples = middle(&setup.render_deep().1);
    let (alpha, _) = DeepSample::flatten(&samples);
    assert!(near(alpha, f64::from(1.0 - (-depth).exp()), 1e-3), "{alpha} {depth}");
    assert!(samples.len() < 24 && samples[0].front > 5.0 && samples.last().unwrap().back < 13.0, "{samples:?}");
    // Half-way in it is what the grid holds up to there.
    let half = setup.matter.mist.as_ref().unwrap().optical_depth(Vec3::new(0.0, 0.0, 9.0), Vec3::NEG_Z, 9.0);
    let left = samples.iter().fold(1.0, |left, sample| left * (1.0 - sample.alpha_before(9.0)));
    assert!(near(left, f64::from((-half).exp()), 0.01), "{left} {half}");
}

#[test]
fn water_is_a_surface_or_a_span_down_to_its_bed() {
    let setup = |water: DeepWater| {
        let mut scene = uniform(1.0, 8);
        scene.camera.fov = 0.01;
        scene.water.absorption = [0.3, 0.2, 0.1];
        scene.output.deep.water = water;
        let parts = vec![
            part("water", Material::Water, mesh(level(0.0, 50.0))),
            part("terrain", Material::Ground, mesh(level(-2.0, 50.0))),
        ];
        let mut setup = Setup::new(scene, parts, [0.0, 5.0, 0.001], [0.0; 3]);
        setup.matter = Flat { water: Some(0.0), bed: Some(-2.0), albedo: Vec3::splat(0.3), ..Flat::default() };
        middle(&setup.render_deep().1)
    };
    let front = setup(DeepWater::Front);
    assert!(front.len() == 1 && near(front[0].front, 5.0, 1e-3) && front[0].alpha == 1.0, "{front:?}");
    let span = setup(DeepWater::Span);
    let expected = 1.0 - [0.6f64, 0.4, 0.2].map(|depth| (-depth).exp()).iter().sum::<f64>() / 3.0;
    assert!(span.len() == 2 && near(span[0].front, 5.0, 1e-3) && near(span[0].back, 7.0, 1e-3), "{span:?}");
    assert!(near(span[0].alpha, expected, 1e-4) && near(span[1].front, 7.0, 1e-3) && span[1].alpha == 1.0, "{span:?}");
}

#[test]
fn a_visible_sky_stands_behind_all() {
    let setup = Setup::new(uniform(0.5, 4), Vec::new(), [0.0, 1.0, 0.0], [0.0, 2.0, -1.0]);
    let (flat, deep) = setup.render_deep();
    assert!(samples(&flat, "A").iter().all(|&alpha| alpha == 1.0));
    for index in 0..16 {
        let [sky] = deep.pixel(index) else { panic!("one sample") };
        assert_eq!((sky.front, sky.alpha), (1e10, 1.0));
    }
}
