//! What any sky must keep to.

use super::super::sun::direction;
use super::*;
use crate::scene;

fn build(sky: &scene::Sky, sun: &scene::Sun) -> Sky {
    Sky::build(sky, sun, Path::new("")).unwrap()
}

fn directions(count: usize) -> impl Iterator<Item = Vec3> {
    (0..count).map(move |i| {
        let y = 1.0 - 2.0 * (i as f32 + 0.5) / count as f32;
        let side = (1.0 - y * y).sqrt();
        let phi = i as f32 * 2.399_963;
        Vec3::new(side * phi.cos(), y, side * phi.sin())
    })
}

/// Irradiance of a level card by brute force, from nothing but `radiance`.
fn level_card(sky: &Sky) -> Vec3 {
    let (n, m) = (400, 400);
    let mut sum = glam::DVec3::ZERO;
    for i in 0..n {
        // Equal steps of sin^2 give equal weights in the cosine-weighted integral.
        let y2 = (f64::from(i) + 0.5) / f64::from(n);
        let (y, side) = (y2.sqrt() as f32, (1.0 - y2).sqrt() as f32);
        for j in 0..m {
            let phi = (j as f32 + 0.5) / m as f32 * std::f32::consts::TAU;
            sum += sky.radiance(Vec3::new(side * phi.cos(), y, side * phi.sin())).as_dvec3();
        }
    }
    (sum * std::f64::consts::PI / f64::from(n * m)).as_vec3()
}

#[test]
fn default_daylight_gives_a_level_white_card_a_radiance_of_one() {
    let (sky, sun) = (scene::Sky::default(), scene::Sun::default());
    let light = Sun::build(&sun, &sky);
    let built = build(&sky, &sun);
    let direct = light.irradiance * light.direction.y;
    let fitted = (built.irradiance(Vec3::Y) + direct) / std::f32::consts::PI;
    assert!((fitted - Vec3::ONE).abs().max_element() < 1e-5, "{fitted}");
    let traced = (level_card(&built) + direct) / std::f32::consts::PI;
    assert!((traced - Vec3::ONE).abs().max_element() < 1e-3, "{traced}");
    assert!((built.average_up() * std::f32::consts::PI - built.irradiance(Vec3::Y)).length() < 1e-6);
}

#[test]
fn the_default_sky_is_blue_overhead_light_at_the_horizon_and_glows_around_the_sun() {
    let sun = scene::Sun::default();
    let sky = build(&scene::Sky::default(), &sun);
    let zenith = sky.radiance(Vec3::Y);
    assert!(zenith.z > 2.0 * zenith.x && zenith.z > 1.3 * zenith.y, "{zenith}");
    let horizon = sky.radiance(direction(1.0, sun.azimuth + 120.0));
    assert!(horizon.y > 1.5 * zenith.y && horizon.z < 1.3 * horizon.x, "{horizon}");
    let near = sky.radiance(direction(sun.elevation + 3.0, sun.azimuth));
    assert!(near.y > 4.0 * sky.radiance(direction(sun.elevation, sun.azimuth + 90.0)).y);
}

#[test]
fn any_sun_and_haze_gives_finite_light_that_dies_smoothly_into_the_night() {
    for turbidity in [1.7, 3.0, 10.0] {
        let sky = scene::Sky { turbidity, ..Default::default() };
        let mut last = Vec3::splat(f32::INFINITY);
        for elevation in [90.0, 60.0, 35.0, 10.0, 1.0, 0.0, -0.3, -2.0, -6.0, -12.0, -18.0, -45.0, -90.0] {
            let built = build(&sky, &scene::Sun { elevation, ..Default::default() });
            for d in directions(600).chain([Vec3::X, Vec3::Z, -Vec3::X, -Vec3::Z, Vec3::Y, -Vec3::Y]) {
                let radiance = built.radiance(d);
                assert!(
                    radiance.is_finite() && radiance.min_element() >= 0.0,
                    "{turbidity} {elevation} {d}: {radiance}"
                );
                let irradiance = built.irradiance(d);
                assert!(irradiance.is_finite() && irradiance.min_element() >= 0.0);
            }
            let up = built.average_up();
            if elevation <= 35.0 {
                assert!(up.cmple(last).all(), "{turbidity} {elevation}: {up} after {last}");
            }
            last = up;
        }
        assert!(last.max_element() < 1e-6);
    }
    // A quarter of a degree of sinking changes twilight by less than a fifth: no step.
    let at = |elevation| build(&scene::Sky::default(), &scene::Sun { elevation, ..Default::default() }).average_up().y;
    for elevation in [1.0, 0.0, -1.0, -3.0] {
        let ratio = at(elevation - 0.25) / at(elevation);
        assert!(ratio < 1.0 && ratio > 0.8, "{elevation}: {ratio}");
    }
}

#[test]
fn the_table_has_no_seams() {
    let sun = scene::Sun { elevation: 20.0, azimuth: 33.0, ..Default::default() };
    let sky = build(&scene::Sky::default(), &sun);
    for azimuth in [33.0, 213.0, 0.0, 180.0] {
        for elevation in [-60.0, -1.0, 0.0, 1.0, 30.0, 89.9, 90.0] {
            let (a, b) = (direction(elevation, azimuth - 1e-4), direction(elevation, azimuth + 1e-4));
            let (a, b) = (sky.radiance(a), sky.radiance(b));
            assert!((a - b).abs().max_element() <= 1e-3 * a.max_element(), "{azimuth} {elevation}: {a} {b}");
        }
    }
    // Across the horizon: a hundredth of a degree is a small step in brightness, so that no line shows.
    for azimuth in [33.0, 120.0, 213.0] {
        for step in -300..300 {
            let e = f64::from(step) / 100.0;
            let (a, b) = (sky.radiance(direction(e, azimuth)).y, sky.radiance(direction(e + 0.01, azimuth)).y);
            assert!((a / b).ln().abs() < 0.03, "{azimuth} {e}: {a} {b}");
        }
    }
    // Rows meet at the zenith whatever the azimuth.
    let zenith = sky.radiance(Vec3::Y);
    for azimuth in 0..12 {
        let near = sky.radiance(direction(89.999, f64::from(azimuth) * 30.0));
        assert!((near - zenith).abs().max_element() < 1e-3 * zenith.max_element());
    }
}

#[test]
fn the_far_ground_has_the_radiance_of_its_albedo_in_the_light_there_is() {
    let sky = scene::Sky::default();
    let sun = scene::Sun::default();
    let built = build(&sky, &sun);
    let light = Sun::build(&sun, &sky);
    let lit = built.irradiance(Vec3::Y) + light.irradiance * light.direction.y;
    let albedo = Vec3::from_array(sky.ground_albedo.map(|a| a as f32));
    let down = built.radiance(-Vec3::Y);
    // Straight down 100 m of hazy air lie between.
    assert!((down - albedo * lit / std::f32::consts::PI).abs().max_element() < 0.02, "{down}");
    let bright = build(&scene::Sky { ground_albedo: [0.8; 3], ..sky }, &sun);
    assert!(bright.radiance(-Vec3::Y).x > 2.5 * down.x);
}

#[test]
fn scale_multiplies_every_kind() {
    let sun = scene::Sun::default();
    for kind in [scene::SkyKind::Analytic, scene::SkyKind::Preetham, scene::SkyKind::Constant] {
        let one = build(&scene::Sky { kind, ..Default::default() }, &sun);
        let three = build(&scene::Sky { kind, scale: 3.0, ..Default::default() }, &sun);
        for d in directions(50) {
            assert!((three.radiance(d) - 3.0 * one.radiance(d)).abs().max_element() < 1e-5);
            assert!((three.irradiance(d) - 3.0 * one.irradiance(d)).abs().max_element() < 1e-4);
        }
    }
}

#[test]
fn a_constant_sky_is_constant() {
    let sky = scene::Sky { kind: scene::SkyKind::Constant, radiance: [0.5, 1.0, 2.0], ..Default::default() };
    let built = build(&sky, &scene::Sun::default());
    for d in directions(50) {
        assert_eq!(built.radiance(d), Vec3::new(0.5, 1.0, 2.0));
        assert_eq!(built.irradiance(d), Vec3::new(0.5, 1.0, 2.0) * std::f32::consts::PI);
    }
}

/// A panorama whose colours say where they are: red north, green east, blue south, white west; black below the horizon.
fn compass(path: &Path, flip: bool) {
    let colors = [[255, 0, 0], [0, 255, 0], [0, 0, 255], [255, 255, 255]];
    image::RgbImage::from_fn(64, 32, |x, y| {
        let below = (y >= 16) != flip;
        // Columns within 45 degrees of each direction; north straddles the seam.
        image::Rgb(if below { [0; 3] } else { colors[((x + 8) / 16 % 4) as usize] })
    })
    .save(path)
    .unwrap();
}

#[test]
fn a_latlong_image_has_north_at_its_left_edge_and_turns_eastward() {
    let folder = tempfile::tempdir().unwrap();
    compass(&folder.path().join("compass.png"), false);
    let expected = [Vec3::X, Vec3::Y, Vec3::Z, Vec3::ONE];
    for (rotation, shift) in [(0.0, 0), (90.0, 1), (-90.0, 3), (450.0, 1)] {
        let scene_sky = scene::Sky {
            kind: scene::SkyKind::Latlong,
            image: Some("compass.png".into()),
            rotation,
            ..Default::default()
        };
        let sky = Sky::build(&scene_sky, &scene::Sun::default(), folder.path()).unwrap();
        for quarter in 0..4 {
            let seen = sky.radiance(direction(30.0, 90.0 * ((quarter + shift) % 4) as f64));
            assert!((seen - expected[quarter]).abs().max_element() < 1e-3, "{rotation} {quarter}: {seen}");
        }
        assert!(sky.radiance(direction(-30.0, 10.0)).max_element() < 1e-6);
        let level = level_card(&sky);
        assert!((sky.irradiance(Vec3::Y) - level).abs().max_element() < 0.06, "{} {level}", sky.irradiance(Vec3::Y));
        // A card that faces the red quarter gets more red than one that turns its back to it.
        let (to, from) = (direction(0.0, 90.0 * shift as f64), direction(0.0, 90.0 * (shift + 2) as f64));
        assert!(sky.irradiance(to).x > 1.2 * sky.irradiance(from).x);
    }
}

#[test]
fn a_skybox_puts_one_texture_above_and_one_below_with_its_poles_overhead() {
    let folder = tempfile::tempdir().unwrap();
    compass(&folder.path().join("above.png"), false);
    compass(&folder.path().join("below.png"), true);
    let scene_sky = scene::Sky {
        kind: scene::SkyKind::Skybox,
        above: Some("above.png".into()),
        below: Some("below.png".into()),
        ..Default::default()
    };
    let sky = Sky::build(&scene_sky, &scene::Sun::default(), folder.path()).unwrap();
    for elevation in [80.0, 30.0, -30.0, -80.0] {
        assert!((sky.radiance(direction(elevation, 90.0)) - Vec3::Y).abs().max_element() < 1e-3, "{elevation}");
    }
    // Filtered: between two colours lies their mixture.
    let edge = sky.radiance(direction(30.0, 45.0));
    assert!((edge - Vec3::new(0.5, 0.5, 0.0)).abs().max_element() < 0.02, "{edge}");
    for (normal, sign) in [(Vec3::Y, 1.0), (-Vec3::Y, -1.0)] {
        let lit = sky.irradiance(normal).x;
        assert!((lit - std::f32::consts::FRAC_PI_2).abs() < 0.1, "{sign}: {lit}");
    }
}

#[test]
fn images_that_are_not_there_are_named() {
    let sun = scene::Sun::default();
    let latlong = scene::Sky { kind: scene::SkyKind::Latlong, ..Default::default() };
    assert!(Sky::build(&latlong, &sun, Path::new("")).unwrap_err().to_string().contains("sky.image"));
    let skybox = scene::Sky { kind: scene::SkyKind::Skybox, above: Some("no-such.png".into()), ..Default::default() };
    let error = Sky::build(&skybox, &sun, Path::new("some/folder")).unwrap_err().to_string();
    assert!(error.contains("no-such.png") && error.contains("folder"), "{error}");
}

#[test]
fn preethams_sky_is_as_bright_as_the_other_and_has_its_ground() {
    let (sky, sun) = (scene::Sky { kind: scene::SkyKind::Preetham, ..Default::default() }, scene::Sun::default());
    let (built, light) = (build(&sky, &sun), Sun::build(&sun, &sky));
    let level = level_card(&built) + light.irradiance * light.direction.y;
    assert!((level / std::f32::consts::PI - 1.0).abs().max_element() < 2e-3, "{level}");
    // Blue overhead, brighter towards the sun, light at the horizon.
    let zenith = built.radiance(Vec3::Y);
    assert!(zenith.z > 1.3 * zenith.x, "{zenith}");
    let at = |elevation, turn| built.radiance(direction(elevation, sun.azimuth + turn)).y;
    assert!(at(sun.elevation + 4.0, 0.0) > 2.0 * at(sun.elevation, 90.0) && at(20.0, 0.0) > 1.5 * at(20.0, 180.0));
    assert!(at(0.5, 90.0) > 1.2 * zenith.y);
    // The ground under it has its albedo's radiance, without air between.
    let lit = built.irradiance(Vec3::Y) + light.irradiance * light.direction.y;
    let albedo = Vec3::from_array(sky.ground_albedo.map(|a| a as f32));
    let down = built.radiance(direction(-30.0, 10.0));
    assert!((down - albedo * lit / std::f32::consts::PI).abs().max_element() < 2e-3, "{down}");
    for turbidity in [1.7, 3.0, 10.0] {
        for elevation in [90.0, 35.0, 3.0, 0.0, -1.0, -12.0, -60.0] {
            let sky = scene::Sky { turbidity, ..sky.clone() };
            let built = build(&sky, &scene::Sun { elevation, ..Default::default() });
            for d in directions(400).chain([Vec3::X, -Vec3::Z, Vec3::Y, -Vec3::Y]) {
                let radiance = built.radiance(d);
                assert!(
                    radiance.is_finite() && radiance.min_element() >= 0.0,
                    "{turbidity} {elevation} {d}: {radiance}"
                );
            }
        }
    }
}

/// A sky of an image: stripes and squares of several sizes, with a bright sun.
fn image_sky(folder: &Path, name: &str) -> scene::Sky {
    let path = folder.join(name);
    exr::prelude::write_rgb_file(&path, 128, 64, |x, y| {
        let checker = ((x / 2 + y / 2) % 2) as f32;
        let sun = if (40..43).contains(&x) && (12..15).contains(&y) { 300.0 } else { 0.0 };
        (checker + sun, 0.5 + 0.3 * (y as f32 * 0.1).sin(), 0.01 * x as f32)
    })
    .unwrap();
    scene::Sky { kind: scene::SkyKind::Latlong, image: Some(path.to_str().unwrap().into()), ..scene::Sky::default() }
}

#[test]
fn a_mean_over_cones_keeps_the_light_of_the_whole_and_a_narrow_one_is_a_point() {
    let folder = tempfile::tempdir().unwrap();
    let sky = build(&image_sky(folder.path(), "sky.exr"), &scene::Sun::default());
    let count = 200_000;
    let all = |angle: f32| {
        directions(count).map(|d| sky.mean_radiance(d, angle).as_dvec3()).sum::<glam::DVec3>() / count as f64
    };
    let points = directions(count).map(|d| sky.radiance(d).as_dvec3()).sum::<glam::DVec3>() / count as f64;
    for angle in [0.0, 0.01, 0.05, 0.2] {
        let ratio = all(angle) / points;
        assert!((ratio - glam::DVec3::ONE).abs().max_element() < 0.02, "{angle}: {ratio}");
    }
    assert!(directions(1000).all(|d| sky.mean_radiance(d, 0.0) == sky.radiance(d)));
    for d in [Vec3::Y, -Vec3::Y, Vec3::new(1e-20, 1.0, 0.0)] {
        for angle in [0.0, 1e-3, 1.0, 7.0] {
            assert!(sky.mean_radiance(d, angle).is_finite(), "{d} {angle}");
        }
    }
}

#[cfg(feature = "oiio")]
#[test]
fn a_sky_that_is_read_piece_by_piece_sends_the_same_light() {
    let folder = tempfile::tempdir().unwrap();
    let whole = image_sky(folder.path(), "sky.exr");
    let tx = folder.path().join("sky.tx");
    crate::images::make_texture(&folder.path().join("sky.exr"), &tx).unwrap();
    let pieces = scene::Sky { image: Some(tx.to_str().unwrap().into()), ..whole.clone() };
    for rotation in [0.0, 33.0] {
        let [whole, pieces] =
            [&whole, &pieces].map(|sky| build(&scene::Sky { rotation, ..sky.clone() }, &scene::Sun::default()));
        for d in directions(2000) {
            let (a, b) = (whole.radiance(d), pieces.radiance(d));
            assert!(((a - b).abs() / (0.1 + a)).max_element() < 0.05, "{d}: {a} {b}");
            let (a, b) = (whole.irradiance(d), pieces.irradiance(d));
            assert!(((a - b).abs() / (0.1 + a)).max_element() < 0.05, "{d}: {a} {b}");
        }
        let [a, b] = [&whole, &pieces].map(SkySampler::new);
        let apart = directions(2000).filter(|&d| (a.pdf(d) / b.pdf(d) - 1.0).abs() > 0.1).count();
        assert!(apart < 100, "{apart}");
    }
}
