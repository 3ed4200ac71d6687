//! Mist against sums of Gaussians, and against itself walked in other ways.

use std::ops::ControlFlow;

use glam::{DVec3, Vec3};

use super::*;
use crate::math::scramble;

const SETTINGS: MistSettings = MistSettings { droplet_radius: 5e-5, width: 0.25, scale: 1.0 };

/// Uniform numbers in 0..1.
struct Random(u64);

impl Random {
    fn one(&mut self) -> f64 {
        self.0 += 1;
        (scramble(self.0) >> 40) as f64 / f64::from(1 << 24)
    }
    fn point(&mut self, half: f64) -> [f64; 3] {
        [0; 3].map(|_| half * (2.0 * self.one() - 1.0))
    }
    fn direction(&mut self) -> DVec3 {
        loop {
            let point = DVec3::from_array(self.point(1.0));
            if (0.1..1.0).contains(&point.length()) {
                return point.normalize();
            }
        }
    }
}

fn build(position: &[[f64; 3]], mass: f64) -> Mist {
    Mist::build(position, &vec![mass; position.len()], &SETTINGS, DVec3::ZERO).unwrap()
}

/// Clouds all over a cube.
fn cube(count: usize, half: f64, mass: f64) -> (Vec<[f64; 3]>, Mist) {
    let mut random = Random(5);
    let position: Vec<_> = (0..count).map(|_| random.point(half)).collect();
    let mist = build(&position, mass);
    (position, mist)
}

/// Optical depth of Gaussian clouds along a whole line.
fn column(position: &[[f64; 3]], mass: f64, origin: DVec3, direction: DVec3) -> f64 {
    let deviation = 0.5 * SETTINGS.width;
    let one = cross_section(mass, SETTINGS.droplet_radius) / (std::f64::consts::TAU * deviation * deviation);
    let aside = |place: &[f64; 3]| (DVec3::from_array(*place) - origin).cross(direction).length_squared();
    position.iter().map(|place| one * (-0.5 * aside(place) / (deviation * deviation)).exp()).sum()
}

#[test]
fn optical_depth_of_many_clouds_is_that_of_gaussians() {
    let (position, mist) = cube(3000, 0.8, 1e-4);
    assert_eq!(mist.particles, 3000);
    let mut random = Random(99);
    let mut all = [0.0; 2];
    for ray in 0..40 {
        let target = DVec3::from_array(random.point(0.5));
        // Along axes, too, where nothing evens out along the way.
        let direction = if ray % 4 == 0 { DVec3::AXES[ray / 4 % 3] } else { random.direction() };
        let origin = target - 5.0 * direction;
        let expected = column(&position, 1e-4, origin, direction);
        let got = f64::from(mist.optical_depth(origin.as_vec3(), direction.as_vec3(), f32::INFINITY));
        assert!((got / expected - 1.0).abs() < 0.005, "{direction}: {got}, not {expected}");
        all[0] += got;
        all[1] += expected;
    }
    assert!((all[0] / all[1] - 1.0).abs() < 0.001, "{all:?}");
}

#[test]
fn every_particle_has_its_whole_cross_section_wherever_it_lies() {
    let mut random = Random(1);
    for _ in 0..5 {
        let mist = build(&[random.point(3.0)], 1e-3);
        // Rays a voxel apart: linear interpolation adds up to the corners' sum, from any place.
        let (voxel, [u, v]) = (f64::from(mist.voxel()), [random.one(), random.one()]);
        let mut sum = 0.0;
        for x in -80..80 {
            for y in -80..80 {
                let origin = DVec3::new((f64::from(x) + u) * voxel, (f64::from(y) + v) * voxel, 9.0);
                sum += f64::from(mist.optical_depth(origin.as_vec3(), Vec3::NEG_Z, 18.0));
            }
        }
        let total = sum * voxel * voxel;
        assert!((total / cross_section(1e-3, SETTINGS.droplet_radius) - 1.0).abs() < 1e-4, "{total}");
    }
}

#[test]
fn transmittance_and_collisions_have_the_mean_that_quadrature_gives() {
    // Thin: by tentative collisions. Middling: by both ways. Thick: voxel by voxel.
    for mass in [2e-5, 1e-3, 0.02] {
        let (_, mist) = cube(12, 0.6, mass);
        let mut random = Random(17);
        for ray in 0..6 {
            let direction = random.direction().as_vec3();
            let origin = 0.3 * random.direction().as_vec3() - 2.0 * direction;
            let reach = if ray % 2 == 0 { f32::INFINITY } else { 2.1 };
            let truth = f64::from(-mist.optical_depth(origin, direction, reach)).exp();
            let half = f64::from(-mist.optical_depth(origin, direction, reach.min(2.0))).exp();
            let count = 20_000;
            let (mut ratio, mut squares, mut passed, mut passed_half) = (0.0, 0.0, 0.0, 0.0);
            for _ in 0..count {
                let left = f64::from(mist.transmittance(origin, direction, reach, &mut || random.one() as f32));
                assert!((0.0..=1.0).contains(&left));
                ratio += left;
                squares += left * left;
                let place = mist.collide(origin, direction, reach, &mut || random.one() as f32);
                assert!(place.is_none_or(|place| place > 0.0 && place < reach));
                passed += f64::from(place.is_none());
                passed_half += f64::from(place.is_none_or(|place| place >= 2.0));
            }
            let n = f64::from(count);
            let error = ((squares / n - (ratio / n).powi(2)).max(0.0) / n).sqrt();
            assert!((ratio / n - truth).abs() <= 4.0 * error + 1e-5, "{mass} {ray}: {} not {truth}", ratio / n);
            for (passed, truth) in [(passed, truth), (passed_half, half)] {
                let error = (truth * (1.0 - truth) / n).sqrt();
                assert!((passed / n - truth).abs() <= 4.0 * error + 1e-5, "{mass} {ray}: {} not {truth}", passed / n);
            }
        }
    }
}

#[test]
fn places_are_where_their_optical_depth_is() {
    for mass in [1e-5, 1e-3, 1.0] {
        let (_, mist) = cube(40, 0.6, mass);
        let mut random = Random(3);
        for _ in 0..20 {
            let direction = random.direction().as_vec3();
            let origin = -2.0 * direction;
            let all = mist.optical_depth(origin, direction, f32::INFINITY);
            let wanted = [0.01, 0.3, 0.31, 0.8, 0.999, 1.5].map(|share| share * all);
            let mut places = Vec::new();
            mist.places(origin, direction, f32::INFINITY, &wanted, |place| places.push(place));
            assert_eq!(places.len(), 5, "what lies beyond is nowhere");
            for (place, wanted) in places.iter().zip(wanted) {
                let got = mist.optical_depth(origin, direction, *place);
                assert!((got - wanted).abs() < 2e-4 * all, "{got}, not {wanted} of {all}");
            }
        }
    }
}

#[test]
fn no_point_is_denser_than_its_brick_says_and_bricks_cover_all() {
    let (_, mist) = cube(30, 1.5, 1e-3);
    let mut random = Random(8);
    for _ in 0..40 {
        let direction = random.direction().as_vec3();
        let origin = random.direction().as_vec3() - 3.0 * direction;
        let mut parts = Vec::new();
        mist.bricks(origin, direction, 6.0, |most, part| {
            parts.push((most, part));
            ControlFlow::Continue(())
        });
        for step in 0..1000 {
            let t = 6.0 * (step as f32 + 0.5) / 1000.0;
            let here = mist.extinction(origin + t * direction);
            let inside = parts.iter().filter(|(_, [start, end])| t > start - 1e-4 && t < end + 1e-4);
            let most = inside.map(|(most, _)| *most).fold(0.0, f32::max);
            assert!(here <= most && most <= mist.greatest(), "{here} {most}");
        }
    }
    assert!(mist.greatest() > 0.0);
}

#[test]
fn the_grid_has_the_same_bits_at_any_count_of_threads() {
    let build = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let mist = pool.install(|| cube(2000, 2.0, 1e-4).1);
        let mut random = Random(4);
        (0..2000).map(|_| mist.extinction(DVec3::from_array(random.point(2.2)).as_vec3()).to_bits()).collect::<Vec<_>>()
    };
    let one = build(1);
    assert_eq!(one, build(3));
    assert!(one.iter().filter(|bits| **bits != 0).count() > 1000);
}

#[test]
fn what_is_no_droplet_is_counted_and_what_lies_far_off_is_found() {
    let nan = f64::NAN;
    let position =
        [[0.0; 3], [nan, 0.0, 0.0], [0.0, f64::INFINITY, 0.0], [1.0, 0.0, 0.0], [1e300, 0.0, 0.0], [-3e6, 2e6, 5e6]];
    let mist = Mist::build(&position, &[1e-3, 1.0, 1.0, 0.0, 1.0, 1e-3], &SETTINGS, DVec3::ZERO).unwrap();
    assert_eq!((mist.particles, mist.without_mass, mist.out_of_range), (2, 1, 3));
    assert!(mist.bytes() < 1 << 20, "{}", mist.bytes());
    let near = mist.optical_depth(Vec3::new(0.0, 0.0, 9.0), Vec3::NEG_Z, f32::INFINITY);
    assert!((f64::from(near) / column(&position[..1], 1e-3, DVec3::Z, DVec3::Z) - 1.0).abs() < 0.06, "{near}");
    let far = Vec3::new(-3e6, 2e6, 5e6);
    assert!(mist.optical_depth(Vec3::ZERO, far.normalize(), f32::INFINITY) > near / 2.0);
    assert!(mist.extinction(far) > 0.0);
    let none = Mist::build(&position[..1], &[1.0], &MistSettings { scale: 0.0, ..SETTINGS }, DVec3::ZERO).unwrap();
    assert!(none.is_empty() && none.without_mass == 1 && none.greatest() == 0.0);
    assert_eq!(none.optical_depth(Vec3::ZERO, Vec3::X, f32::INFINITY), 0.0);
    assert_eq!(none.extinction(Vec3::ZERO), 0.0);
}

#[test]
fn a_million_particles_in_one_place_are_a_cloud_a_million_times_as_dense() {
    let place = [0.3, -0.2, 0.1];
    let (one, all) = (build(&[place], 1e-3), build(&vec![place; 1_000_000], 1e-3));
    assert!((all.greatest() / one.greatest() / 1e6 - 1.0).abs() < 1e-5);
    let mut random = Random(6);
    for _ in 0..200 {
        // Light ends in the cloud's border, in few steps.
        let hit = all.collide(Vec3::new(0.3, -0.2, 4.0), Vec3::NEG_Z, f32::INFINITY, &mut || random.one() as f32);
        assert!(hit.is_some_and(|hit| (3.4..3.7).contains(&hit)), "{hit:?}");
        let left = all.transmittance(Vec3::new(0.3, -0.2, 4.0), Vec3::NEG_Z, 9.0, &mut || random.one() as f32);
        assert_eq!(left, 0.0);
    }
}

#[test]
fn mist_moves_as_the_mean_of_what_stops_light_there() {
    // Two streams a metre apart, and between them one cloud of each.
    let position = [[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [0.1, 0.2, 0.3], [3.1, 0.1, 0.2], [6.0; 3], [6.0; 3]];
    let velocity = [[4.0, 0.0, 0.0], [0.0, -2.0, 1.0], [4.0, 0.0, 0.0], [0.0, -2.0, 1.0], [9.0, 0.0, 0.0], [0.0; 3]];
    let mass = [1e-3, 1e-3, 2e-3, 5e-3, 1e-3, 2e-3];
    let moving = |velocity: &[[f64; 3]]| {
        let droplets = Droplets { position: &position, velocity, mass: &mass };
        Mist::build_within(&droplets, &SETTINGS, DVec3::ZERO, BUDGET).unwrap()
    };
    let mist = moving(&velocity);
    for (place, expected) in [(position[0], velocity[0]), (position[3], velocity[1]), ([6.0; 3], [3.0, 0.0, 0.0])] {
        let got = mist.velocity(DVec3::from_array(place).as_vec3());
        assert!((got.as_dvec3() - DVec3::from_array(expected)).length() < 1e-5, "{got} at {place:?}");
    }
    assert_eq!(mist.velocity(Vec3::splat(100.0)), Vec3::ZERO);
    assert_eq!(moving(&[]).velocity(Vec3::ZERO), Vec3::ZERO);
    let mut wild = velocity;
    wild[4] = [1e300, 0.0, 0.0];
    assert_eq!(moving(&wild).out_of_range, 1);
}

/// A mist of a megabyte at most.
fn within(position: &[[f64; 3]]) -> Result<Mist, MistError> {
    let mass = vec![1.0; position.len()];
    Mist::build_within(&Droplets { position, velocity: &[], mass: &mass }, &SETTINGS, DVec3::ZERO, 1 << 20)
}

#[test]
fn what_would_take_too_much_is_refused_by_name() {
    let position: Vec<_> = (0..1000).map(|i| [f64::from(i) * 5.0, 0.0, 0.0]).collect();
    let told = within(&position).unwrap_err();
    assert!(matches!(told, MistError::TooLarge { particles: 1000, .. }), "{told}");
    assert!(told.to_string().contains("particles.mist_width") && told.to_string().contains("1048576"), "{told}");
    // Few enough to be counted one by one, too many with what they reach.
    let told = within(&position[..200]).unwrap_err();
    assert!(matches!(told, MistError::TooLarge { bytes, .. } if bytes > 1 << 20), "{told}");
    let told = Mist::build(&position[..1], &[1e30], &SETTINGS, DVec3::ZERO).unwrap_err();
    assert!(matches!(told, MistError::TooDense { .. }) && told.to_string().contains("droplet_radius"), "{told}");
    // The finest clouds and the coarsest.
    for width in [1e-3, 1e4] {
        let mist = Mist::build(&position[..1], &[1.0], &MistSettings { width, ..SETTINGS }, DVec3::ZERO).unwrap();
        assert!(mist.greatest() > 0.0 && mist.greatest().is_finite());
    }
}
