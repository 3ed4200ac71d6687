//! Files' mist against closed forms, against what OpenVDB says of the same files, and against what is broken.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use glam::{DMat3, DVec3, IVec3, Vec3};

use super::vdb::{CELL, Contents};
use super::*;
use crate::math::scramble;
use crate::scene::{self, UpAxis};

fn file(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/volumes").join(name)
}

fn settings(grid: &str) -> scene::Mist {
    scene::Mist { grid: grid.to_owned(), ..scene::Mist::default() }
}

fn volume(name: &str, grid: &str) -> Volume {
    Volume::read(&file(name), &settings(grid)).unwrap_or_else(|error| panic!("{error}"))
}

fn mist_at(volume: &Volume, seconds: f64, origin: DVec3) -> Mist {
    Mist::default().and(volume.at(seconds, origin, BUDGET).unwrap())
}

fn still(name: &str, grid: &str) -> Mist {
    mist_at(&volume(name, grid), 0.0, DVec3::ZERO)
}

/// A block of cells, each value by its voxel.
fn cells(low: i32, high: i32, value: impl Fn(DVec3) -> f64) -> Contents {
    let mut cells = Vec::new();
    for place in (low..high).flat_map(|z| (low..high).flat_map(move |y| (low..high).map(move |x| IVec3::new(x, y, z))))
    {
        let at = |index: usize| IVec3::new(index as i32 % 8, index as i32 / 8 % 8, index as i32 / 64) + 8 * place;
        let values: [f32; CELL] = std::array::from_fn(|index| value(at(index).as_dvec3()) as f32);
        cells.push((place, values));
    }
    Contents { cells, axes: DMat3::from_diagonal(DVec3::splat(0.1)), start: DVec3::ZERO, velocity: None }
}

struct Random(u64);
impl Random {
    fn one(&mut self) -> f32 {
        self.0 += 1;
        (scramble(self.0) >> 40) as f32 / (1 << 24) as f32
    }
    fn direction(&mut self) -> Vec3 {
        loop {
            let point = 2.0 * Vec3::new(self.one(), self.one(), self.one()) - 1.0;
            if (0.1..1.0).contains(&point.length()) {
                return point.normalize();
            }
        }
    }
}

/// Extinction times volume (m2) of all of a mist of voxels of 0.1 m around a middle: rays a voxel apart add up to the sum.
fn whole(mist: &Mist, middle: Vec3) -> f64 {
    let mut sum = 0.0;
    for x in -40..40 {
        for y in -40..40 {
            let origin = middle + Vec3::new((x as f32 + 0.37) * 0.1, (y as f32 + 0.61) * 0.1, 9.0);
            sum += f64::from(mist.optical_depth(origin, Vec3::NEG_Z, 18.0));
        }
    }
    sum * 0.01
}

/// Middle of the ball in the files of one ball (m).
const MIDDLE: Vec3 = Vec3::new(2.2, 3.2, 4.2);

/// Sum of the ball's values times a voxel's volume.
fn ball() -> f64 {
    let mut sum = 0.0;
    for (x, y, z) in (-7i32..8).flat_map(|x| (-7..8).flat_map(move |y| (-7..8).map(move |z| (x, y, z)))) {
        let squared = x * x + y * y + z * z;
        sum += if squared <= 49 { 12.0 * (f64::from(-squared) / 8.0).exp() } else { 0.0 };
    }
    sum * 1e-3
}

#[test]
fn all_codings_of_one_ball_are_read_alike_and_whole() {
    let plain = still("plain.vdb", "density");
    let mut random = Random(1);
    let points: Vec<Vec3> = (0..500).map(|_| MIDDLE + 0.6 * random.direction() * random.one()).collect();
    for (name, least) in [("plain.vdb", 0.0), ("zip.vdb", 0.0), ("blosc.vdb", 0.0), ("half.vdb", 6e-3)] {
        let mist = still(name, "density");
        assert!((mist.extinction(MIDDLE) - 12.0).abs() < 1e-4, "{name}");
        for &point in &points {
            let (got, expected) = (mist.extinction(point), plain.extinction(point));
            assert!((got - expected).abs() <= least, "{name}: {got}, not {expected} at {point}");
        }
        let whole = whole(&mist, MIDDLE);
        assert!((whole / ball() - 1.0).abs() < 1e-3, "{name}: {whole}");
        assert!((mist.velocity(MIDDLE) - Vec3::new(3.0, 0.0, -1.0)).length() < 2e-3, "{name}");
        assert!((mist.voxel() - 0.1).abs() < 1e-6);
    }
}

#[test]
fn a_box_has_its_optical_depth_along_each_of_its_turned_and_stretched_axes() {
    let mut settings = settings("density");
    settings.extinction = 1.5;
    let volume = Volume::read(&file("others.vdb"), &settings).unwrap();
    // Far from the files' zero, where single precision has no voxels left.
    for origin in [DVec3::ZERO, DVec3::new(3.0, 1.0, -2.0)] {
        let mist = mist_at(&volume, 0.0, origin);
        let (sine, cosine) = (30.0f64.to_radians()).sin_cos();
        let turned = |p: DVec3| DVec3::new(cosine * p.x - sine * p.y, sine * p.x + cosine * p.y, p.z);
        let middle = turned(DVec3::new(1.0, 2.3, 1.15)) + DVec3::new(0.0, 5.0, 0.0) - origin;
        for (axis, voxels, width) in [(DVec3::X, 29.0, 0.1), (DVec3::Y, 24.0, 0.2), (DVec3::Z, 24.0, 0.1)] {
            let direction = turned(axis);
            let expected = 1.5 * 2.0 * voxels * width;
            let start = (middle - 20.0 * direction).as_vec3();
            let got = mist.optical_depth(start, direction.as_vec3(), f32::INFINITY);
            assert!((f64::from(got) / expected - 1.0).abs() < 1e-4, "{axis}: {got}, not {expected}");
        }
        // Askew through the middle of a wide slab: by the cosine.
        let askew = turned(DVec3::new(0.5, 0.0, 1.0).normalize());
        let got = mist.optical_depth((middle - 20.0 * askew).as_vec3(), askew.as_vec3(), f32::INFINITY);
        assert!((f64::from(got) / (1.5 * 2.0 * 2.4 * 1.25f64.sqrt()) - 1.0).abs() < 1e-4, "{got}");
        assert_eq!(mist.extinction((middle + turned(DVec3::X) * 1.6).as_vec3()), 0.0);
        assert!((mist.greatest() - 3.0).abs() < 1e-5);
    }
    let mist = still("others.vdb", "large");
    let depth = mist.optical_depth(Vec3::new(-9.0, 40.3, 70.1), Vec3::X, f32::INFINITY);
    assert!((depth / 1.28 - 1.0).abs() < 1e-4, "{depth}");
}

#[test]
fn optical_depth_of_a_gaussian_is_the_closed_forms() {
    // A deviation of 9 voxels: interpolation between them widens it by 1/6 of a voxel squared, 0.2 % of a column.
    let (peak, deviation) = (3.0, 0.9);
    let contents = cells(-6, 6, |p| {
        let squared = (p * 0.1).length_squared();
        if squared < 20.0 { peak * (-0.5 * squared / (deviation * deviation)).exp() } else { 0.0 }
    });
    let volume = Volume::of(contents, Path::new("made"), &settings("density")).unwrap();
    let origin = DVec3::new(0.2, -0.1, 0.3);
    let mist = mist_at(&volume, 0.0, origin);
    let mut random = Random(4);
    for _ in 0..40 {
        let direction = random.direction();
        let aside = direction.cross(random.direction()) * random.one() - origin.as_vec3();
        let got = mist.optical_depth(aside - 9.0 * direction, direction, f32::INFINITY);
        let from = (aside + origin.as_vec3()).reject_from(direction).as_dvec3().length_squared();
        let expected = peak * deviation * std::f64::consts::TAU.sqrt() * (-0.5 * from / (deviation * deviation)).exp();
        assert!((f64::from(got) / expected - 1.0).abs() < 0.005, "{got}, not {expected}");
    }
}

#[test]
fn the_axis_that_points_up_is_the_one_that_is_named() {
    let up = scene::Mist { up: UpAxis::Z, ..settings("density") };
    let mist = mist_at(&Volume::read(&file("plain.vdb"), &up).unwrap(), 0.0, DVec3::ZERO);
    // North is against south.
    let place = Vec3::new(MIDDLE.x, MIDDLE.z, -MIDDLE.y);
    assert!((mist.extinction(place) - 12.0).abs() < 1e-4 && mist.extinction(MIDDLE) == 0.0);
    assert!((mist.velocity(place) - Vec3::new(3.0, -1.0, 0.0)).length() < 1e-5);
}

#[test]
fn what_moves_is_where_its_velocity_has_taken_it_and_nothing_of_it_is_lost() {
    let volume = volume("plain.vdb", "density");
    let velocity = Vec3::new(3.0, 0.0, -1.0);
    let first = mist_at(&volume, 0.0, DVec3::ZERO);
    // A whole count of voxels, parts of one, out of the velocities' own grid, and before.
    for seconds in [0.1f32, 0.0173, 1.0, -0.05] {
        let moved = mist_at(&volume, f64::from(seconds), DVec3::ZERO);
        let way = seconds * velocity;
        let whole = whole(&moved, MIDDLE + way);
        assert!((whole / ball() - 1.0).abs() < 2e-3, "{seconds}: {whole}, not {}", ball());
        let mut random = Random(7);
        for _ in 0..200 {
            let point = MIDDLE + 0.7 * random.direction() * random.one();
            let (got, expected) = (moved.extinction(point + way), first.extinction(point));
            assert!((got - expected).abs() < 2e-3, "{seconds}: {got}, not {expected} at {point}");
        }
        assert!((moved.velocity(MIDDLE + way) - velocity).length() < 1e-4);
    }
    let settings = scene::Mist { velocity_scale: 0.0, ..settings("density") };
    let held = Volume::read(&file("plain.vdb"), &settings).unwrap();
    assert!(held.held(8) == held.held(1) && held.held(1) < volume.held(1) && volume.held(1) < volume.held(8));
    assert_eq!(mist_at(&held, 0.5, DVec3::ZERO).extinction(MIDDLE), first.extinction(MIDDLE));
    assert_eq!(mist_at(&held, 0.5, DVec3::ZERO).velocity(MIDDLE), Vec3::ZERO);
}

#[test]
fn what_turns_is_bent_as_each_voxel_flies() {
    // Half as wide along y as along x; it turns about z at 2 radians a second and rises.
    let density = |p: DVec3| {
        let scaled = (p / DVec3::new(0.9, 0.45, 0.9)).length_squared();
        if scaled < 20.0 { 3.0 * (-0.5 * scaled).exp() } else { 0.0 }
    };
    let mut contents = cells(-6, 6, |voxel| density(voxel * 0.1));
    let mut velocity = openvdb::Vec3SGrid::new(openvdb::math::Vec3([0.0; 3]));
    // Only where there is some mist.
    for (place, values) in &contents.cells {
        for (index, _) in values.iter().enumerate().filter(|(_, value)| **value > 0.0) {
            let index = index as i32;
            let at = 8 * *place + IVec3::new(index % 8, index / 8 % 8, index / 64);
            let value = [-0.2 * at.y as f32, 0.2 * at.x as f32, 5.0];
            velocity.set_value(&openvdb::Coord(at.to_array()), openvdb::math::Vec3(value));
        }
    }
    velocity.set_transform(openvdb::Transform::linear(0.1));
    contents.velocity = Some(vdb::Velocity::Single(velocity));
    let volume = Volume::of(contents, Path::new("made"), &settings("density")).unwrap();
    let seconds = 0.05;
    let mist = mist_at(&volume, seconds, DVec3::new(0.0, 0.0, 0.3));
    let turned = DMat3::from_cols(DVec3::new(1.0, 0.1, 0.0), DVec3::new(-0.1, 1.0, 0.0), DVec3::Z).inverse();
    let mut random = Random(2);
    let mut worst = 0.0f64;
    for _ in 0..2000 {
        let here = (1.5 * random.direction() * random.one()).as_dvec3() + DVec3::Z * 0.25;
        let expected = density(turned * (here - DVec3::Z * 0.25));
        let got = f64::from(mist.extinction(here.as_vec3() - Vec3::Z * 0.3));
        worst = worst.max((got - expected).abs());
    }
    // What interpolation between voxels takes from a Gaussian of 4.5 of them, twice; unmoved, a point is off by 0.2.
    assert!(worst < 0.06, "{worst}");
    let place = Vec3::new(0.5, 0.0, 0.25 - 0.3);
    let expected = Vec3::new(0.0, 1.0, 5.0);
    assert!((mist.velocity(place) - expected).length() < 0.9, "{}", mist.velocity(place));
    let told = volume.at(1e9, DVec3::ZERO, BUDGET).unwrap_err();
    assert!(matches!(told, VolumeError::TooLarge { .. }), "{told}");
    // One that does not may go anywhere.
    assert!(self::volume("plain.vdb", "density").at(1e9, DVec3::ZERO, BUDGET).is_ok());
}

#[test]
fn particles_and_a_file_stop_together_what_both_stop() {
    let settings = MistSettings { droplet_radius: 5e-5, width: 0.3, scale: 1.0 };
    let place: Vec<[f64; 3]> = (0..6).map(|k| [2.0 + 0.1 * f64::from(k), 3.2, 4.3 - 0.02 * f64::from(k)]).collect();
    let own = Mist::build(&place, &[0.002; 6], &settings, DVec3::ZERO).unwrap();
    let file = still("blosc.vdb", "density");
    let both = own.clone().and(volume("blosc.vdb", "density").at(0.0, DVec3::ZERO, BUDGET).unwrap());
    assert_eq!(both.bytes(), own.bytes() + file.bytes());
    let mut random = Random(3);
    for ray in 0..12 {
        let direction = random.direction();
        let origin = MIDDLE + 0.2 * random.direction() - 3.0 * direction;
        let reach = if ray % 2 == 0 { f32::INFINITY } else { 3.1 };
        let parts = [&own, &file].map(|mist| mist.optical_depth(origin, direction, reach));
        let depth = both.optical_depth(origin, direction, reach);
        assert!((depth - parts[0] - parts[1]).abs() < 1e-5 * depth && parts[0].min(parts[1]) > 0.0, "{parts:?}");

        let wanted = [0.1, 0.5, 0.9, 1.1].map(|share| share * depth);
        let mut places = Vec::new();
        both.places(origin, direction, reach, &wanted, |place| places.push(place));
        assert_eq!(places.len(), 3);
        for (place, wanted) in places.iter().zip(wanted) {
            let got = both.optical_depth(origin, direction, *place);
            assert!((got - wanted).abs() < 5e-4 * depth, "{got}, not {wanted} of {depth}");
        }

        let (mut sum, mut last) = (0.0, 0.0);
        both.bricks(origin, direction, reach, |most, [from, to]| {
            assert!(from >= last && to > from, "{last} {from} {to}");
            last = to;
            sum += both.optical_depth(origin + from * direction, direction, to - from);
            let middle = 0.5 * (from + to);
            assert!(both.extinction(origin + middle * direction) <= most && most <= both.greatest());
            ControlFlow::Continue(())
        });
        assert!((sum / depth - 1.0).abs() < 1e-3, "{sum} of {depth}");

        let (count, truth) = (4000, f64::from((-depth).exp()));
        let (mut left, mut passed) = (0.0, 0.0);
        for _ in 0..count {
            left += f64::from(both.transmittance(origin, direction, reach, &mut || random.one()));
            let hit = both.collide(origin, direction, reach, &mut || random.one());
            passed += f64::from(hit.is_none());
            assert!(hit.is_none_or(|hit| hit < reach && both.extinction(origin + hit * direction) > 0.0));
        }
        let error = (truth * (1.0 - truth) / f64::from(count)).sqrt();
        for mean in [left, passed] {
            let mean = mean / f64::from(count);
            assert!((mean - truth).abs() < 4.0 * error + 1e-4, "{mean}, not {truth}");
        }
    }
    // By what each stops at a point.
    let point = MIDDLE + Vec3::new(0.0, 0.0, 0.05);
    let share = file.extinction(point) / both.extinction(point);
    assert!((0.1..0.9).contains(&share), "{share}");
    assert!((both.velocity(point) - share * Vec3::new(3.0, 0.0, -1.0)).length() < 1e-4);
    assert_eq!(both.velocity(Vec3::splat(90.0)), Vec3::ZERO);
}

#[test]
fn what_is_no_mist_is_refused_with_its_place_and_what_was_expected() {
    let others = file("others.vdb");
    let read = |grid: &str, velocity: Option<&str>| {
        let settings = scene::Mist { velocity: velocity.map(str::to_owned), ..settings(grid) };
        Volume::read(&others, &settings).unwrap_err().to_string()
    };
    for (grid, velocity, expected) in [
        (
            "smoke",
            None,
            "has no grid `smoke` (mist.grid); expected one of `density` (double), `large` (float), `count`",
        ),
        ("count", None, "the grid `count` (mist.grid) holds int32; expected float or double"),
        ("nan", None, "the grid `nan`: its voxel [1, 2, 3] is NaN; expected a density of 0 or more"),
        ("negative", None, "the grid `negative`: its voxel [3, 2, 1] is -0.5; expected a density of 0 or more"),
        ("filled", None, "the grid `filled`: its background is 1; expected 0"),
        ("seen", None, "the grid `seen`: its transform is NonlinearFrustumMap; expected a linear one"),
        ("density", Some("fast"), "the grid `fast`: its voxel [0, 0, 0] is [0, inf, 0]; expected three finite numbers"),
        ("density", Some("large"), "the grid `large` (mist.velocity) holds float; expected vec3s or vec3d"),
        ("density", Some("wind"), "has no grid `wind` (mist.velocity); expected one of"),
    ] {
        let told = read(grid, velocity);
        assert!(told.contains(expected) && told.contains("others.vdb"), "{told}");
    }
    let dense = scene::Mist { extinction: 1e9, ..settings("density") };
    let mut contents = cells(0, 1, |_| 1e15);
    contents.cells[0].1[9] = 1e30;
    let told = Volume::of(contents, Path::new("made"), &dense).unwrap_err().to_string();
    assert!(told.contains("mist.extinction"), "{told}");
    let small = vdb::read(&others, &settings("large"), 1 << 20).unwrap_err();
    assert!(matches!(small, VolumeError::TooLarge { bytes, .. } if bytes > 1 << 20), "{small}");
    let told = Volume::read(Path::new("none.vdb"), &settings("density")).unwrap_err().to_string();
    assert!(told.contains("none.vdb") && told.contains("OpenVDB"), "{told}");
    let told = Volume::read(Path::new(file!()), &settings("density")).unwrap_err().to_string();
    assert!(told.contains("not a VDB file"), "{told}");
}

#[test]
fn broken_files_are_refused_or_read_as_finite_mist() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("broken.vdb");
    let mut random = Random(11);
    let mut refused = 0;
    for name in ["plain.vdb", "zip.vdb", "blosc.vdb", "half.vdb"] {
        let whole = std::fs::read(file(name)).unwrap();
        for attempt in 0..60 {
            let mut bytes = whole.clone();
            let place = |random: &mut Random, count: usize| ((random.one() * count as f32) as usize).min(count - 1);
            if attempt % 4 == 0 {
                bytes.truncate(place(&mut random, whole.len()));
            } else {
                // Most of a file is masks: its head, too, is to be hit.
                let within = if attempt % 2 == 0 { 600 } else { whole.len() };
                for _ in 0..4 {
                    let at = place(&mut random, within);
                    bytes[at] = (random.one() * 256.0) as u8;
                }
            }
            std::fs::write(&path, &bytes).unwrap();
            match Volume::read(&path, &settings("density")) {
                Err(told) => refused += i32::from(told.to_string().contains("broken.vdb")),
                Ok(volume) => {
                    let greatest = mist_at(&volume, 0.0, DVec3::ZERO).greatest();
                    assert!(greatest.is_finite() && greatest >= 0.0);
                }
            }
        }
    }
    assert!(refused > 60, "{refused}");
}
