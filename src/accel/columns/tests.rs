//! The walk against the referee: right where the report could be right, wrong where it had to be.

use glam::{DVec3, Vec3};

use super::super::testing::Random;
use super::super::{NO_PART, build};
use super::*;
use crate::lower::{Lowered, Material};
use crate::scene::{Accel, WaterAccel};
use crate::simd::SimdLevel;
use crate::surface::{Lattice, Sides, SplineSurface};

/// Waves of a height (m) over n x n columns of 1 m with (0, 0) in a corner; a column is absent where `present` says so.
fn waves(n: usize, height: f64, present: impl Fn(usize) -> bool) -> SplineSurface {
    let mut random = Random(3);
    let heights: Vec<f64> = (0..n * n)
        .map(|k| {
            let (x, z) = ((k % n) as f64, (k / n) as f64);
            height * ((0.3 * x + 0.2 * z).sin() + 0.3 * (0.9 * x - 0.4 * z).cos() + 0.2 * f64::from(random.unit()))
        })
        .collect();
    let lattice = Lattice::new(3, [n, n], [0.5, 0.5], [1.0, 1.0], &heights, present).unwrap();
    SplineSurface::new(lattice, SolverKind::default(), SimdLevel::Portable)
}

fn lowered(shapes: Vec<Shape>) -> Lowered {
    let part = |shape| Part { name: String::new(), material: Material::Water, shape };
    Lowered { parts: shapes.into_iter().map(part).collect(), ..Lowered::default() }
}

fn columns(surface: &Arc<SplineSurface>) -> Columns {
    let scene = lowered(vec![Shape::Surface(Arc::clone(surface))]);
    Columns::new((0..).zip(&scene.parts)).unwrap()
}

/// `count` rays towards points within the surface's square of side n.
fn rays(n: usize, count: usize, from: impl Fn(&mut Random, Vec3) -> (Vec3, Vec3)) -> RayBatch {
    let mut random = Random(8);
    let mut rays = RayBatch::default();
    for _ in 0..count {
        let point = Vec3::new(random.unit(), 0.0, random.unit()) * n as f32;
        let (origin, direction) = from(&mut random, point);
        rays.push(origin, direction, 0.0, f32::INFINITY, 1e-5);
    }
    rays
}

fn from_above(random: &mut Random, point: Vec3) -> (Vec3, Vec3) {
    let direction = random.vector(0.5) - Vec3::Y;
    (point - 9.0 * direction, direction)
}

fn along_the_surface(random: &mut Random, point: Vec3) -> (Vec3, Vec3) {
    let direction = random.vector(1.0) * Vec3::new(1.0, 0.05, 1.0);
    (point + Vec3::Y * (0.8 + random.unit()), direction)
}

fn trace(accel: &dyn Accelerator, rays: &RayBatch) -> (HitBatch, Vec<bool>) {
    let (mut hits, mut occluded) = (HitBatch::default(), Vec::new());
    accel.closest(rays, &mut hits, &mut SolveCounts::default());
    accel.occluded(rays, &mut occluded, &mut SolveCounts::default());
    (hits, occluded)
}

fn audit(surface: &SplineSurface, rays: &RayBatch, hits: &HitBatch) -> Audit {
    let mut audit = Audit::default();
    for index in 0..rays.len() {
        let (origin, direction) = (rays.origin(index).as_dvec3(), rays.direction(index).as_dvec3());
        let range = [rays.tnear[index], rays.tfar[index]].map(f64::from);
        let answer = (hits.part[index] != NO_PART).then(|| f64::from(hits.t[index]));
        audit.check(surface.lattice(), origin, direction, range, answer);
    }
    audit
}

#[test]
fn gentle_water_from_above_is_found() {
    let surface = Arc::new(waves(40, 0.3, |_| true));
    let rays = rays(40, 4000, from_above);
    let (hits, occluded) = trace(&columns(&surface), &rays);
    let audit = audit(&surface, &rays, &hits);
    assert!(audit.hits > 3000, "{audit:?}");
    assert!(audit.lost + audit.false_hits + audit.wrong <= audit.rays / 1000, "{audit:?}");
    for index in (0..rays.len()).filter(|&index| hits.part[index] != NO_PART) {
        assert!(occluded[index]);
        let point = rays.origin(index) + hits.t[index] * rays.direction(index);
        let there = surface.patch_point(hits.primitive[index], hits.u[index], hits.v[index]);
        assert!(there.position.distance(point) < 1e-4, "{point} is not at {}", there.position);
        let normal = Vec3::from(hits.normal.each_ref().map(|axis| axis[index])).normalize();
        assert!(normal.distance(there.normal) < 1e-4);
    }
}

#[test]
fn rays_along_waves_are_lost_and_misplaced_as_the_report_lost_them() {
    let surface = Arc::new(waves(40, 1.0, |_| true));
    let rays = rays(40, 20_000, along_the_surface);
    let columns = columns(&surface);
    let (hits, _) = trace(&columns, &rays);
    let all = audit(&surface, &rays, &hits);
    assert!(all.lost + all.wrong > 20, "{all:?}");
    assert!(all.lost + all.wrong < all.hits / 5, "an opponent, not a straw man: {all:?}");
    // Asked twice (closest and any): the sampled count is of both.
    let told = columns.audit().unwrap();
    assert!(told.rays > 60 && told.rays < 400, "about one in 256 of 40,000: {told:?}");
    assert!(told.hits > 20 && told.lost + told.false_hits + told.wrong < told.hits / 3, "{told:?}");
}

#[test]
fn rays_pass_through_empty_regions() {
    let surface = Arc::new(waves(30, 0.3, |k| (k % 30 / 6 + k / 30 / 6) % 2 == 0));
    let lattice = surface.lattice();
    let rays = rays(30, 4000, from_above);
    let (hits, _) = trace(&columns(&surface), &rays);
    let audit = audit(&surface, &rays, &hits);
    assert!(audit.hits > 1000 && audit.hits < 3600, "{audit:?}");
    // At the borders of empty regions a guess that was moved may find a root that its ray does not pass.
    assert!(audit.lost + audit.false_hits + audit.wrong <= audit.rays / 100, "{audit:?}");
    for index in (0..rays.len()).filter(|&index| hits.part[index] != NO_PART) {
        let patch = hits.primitive[index] as usize;
        assert!(lattice.exists(patch % lattice.cells[0], patch / lattice.cells[0]), "ray {index}");
    }
}

#[test]
fn a_guess_over_an_empty_region_moves_to_the_nearest_patch() {
    // Water in the west only: x < 5 exists, so does the next column. The root of this ray's first step lies east of it.
    let surface = Arc::new(waves(12, 0.4, |k| k % 12 < 4));
    let lattice = surface.lattice();
    assert!(lattice.exists(4, 6) && !lattice.exists(5, 6));
    let origin = DVec3::new(4.9, 3.0, 6.5);
    let target = newton::Target::new(lattice, origin, DVec3::NEG_Y);
    let root = target.root([3, 6], 1e-9, 1, &mut 0).unwrap();
    assert_eq!(root.cell, [4, 6]);
    // Over the empty region itself there is nothing to be found, from near it or from its midst.
    let target = newton::Target::new(lattice, DVec3::new(7.5, 3.0, 6.5), DVec3::NEG_Y);
    assert!(target.root([4, 6], 1e-9, 1, &mut 0).is_none());
    assert!(target.root([9, 6], 1e-9, 1, &mut 0).is_none());
}

#[test]
fn a_singular_guess_is_moved_the_same_way_each_time() {
    // A flat surface and a ray in its plane's direction: every Jacobian is singular.
    let flat = Lattice::new(3, [6, 6], [0.5; 2], [1.0; 2], &[0.0; 36], |_| true).unwrap();
    let target = newton::Target::new(&flat, DVec3::new(-1.0, 0.5, 2.0), DVec3::X);
    let mut steps = 0;
    assert!(target.root([2, 2], 1e-6, 7, &mut steps).is_none());
    assert_eq!(steps, 5, "at most five steps");
    let surface = Arc::new(waves(40, 1.0, |_| true));
    let all = rays(40, 2000, along_the_surface);
    let (first, second) = (columns(&surface), columns(&surface));
    let together = trace(&first, &all).0;
    for index in (0..all.len()).rev() {
        let mut alone = RayBatch::default();
        alone.push(all.origin(index), all.direction(index), 0.0, f32::INFINITY, 1e-5);
        let hit = trace(&second, &alone).0;
        assert_eq!((hit.t[0].to_bits(), hit.primitive[0]), (together.t[index].to_bits(), together.primitive[index]));
    }
    assert_eq!(first.audit(), second.audit(), "the sample is chosen by the rays alone");
}

#[test]
fn flat_water_is_hit_from_anywhere_and_missed_beside_it() {
    let flat = Lattice::new(3, [9, 7], [0.5; 2], [1.0; 2], &[0.7; 63], |_| true).unwrap();
    let surface = Arc::new(SplineSurface::new(flat, SolverKind::default(), SimdLevel::Portable));
    let columns = columns(&surface);
    let above = rays(7, 3000, from_above);
    let (hits, _) = trace(&columns, &above);
    for index in 0..above.len() {
        let t = (0.7 - above.origin[1][index]) / above.direction[1][index];
        let point = above.origin(index) + t * above.direction(index);
        let inside = |place: f32, size: f32| place > 0.001 && place < size - 0.001;
        if inside(point.x, 9.0) && inside(point.z, 7.0) {
            assert!((hits.t[index] - t).abs() < 1e-4, "ray {index}: {} for {t}", hits.t[index]);
        } else if point.x < -0.001 || point.z < -0.001 || point.z > 7.001 {
            assert_eq!(hits.part[index], NO_PART, "ray {index}");
        }
    }
}

#[test]
fn another_solver_is_refused_and_walls_answer_for_themselves() {
    let lattice = waves(12, 0.3, |_| true).lattice().clone();
    let newton = SplineSurface::new(lattice, SolverKind::Newton, SimdLevel::Portable);
    let settings = Accel { water: WaterAccel::Columns, ..Accel::default() };
    let scene = lowered(vec![Shape::Surface(Arc::new(newton))]);
    let error =
        build(&scene, &settings, SimdLevel::Portable).err().expect("newton is not the report's solver").to_string();
    assert!(error.starts_with("part 0: surface.solver is \"newton\", but accel.water = \"columns\""), "{error}");

    let water = Arc::new(waves(12, 0.3, |_| true));
    let mut bed = water.lattice().clone();
    bed.heights.fill(-3.0);
    bed.extent = [-3.0; 2];
    let bed = Arc::new(SplineSurface::new(bed, SolverKind::default(), SimdLevel::Portable));
    let sides = Arc::new(Sides::new(Arc::clone(&water), Some(Arc::clone(&bed))));
    let scene = lowered(vec![Shape::Surface(Arc::clone(&water)), Shape::Sides(sides), Shape::Surface(bed)]);
    let accel = build(&scene, &settings, SimdLevel::Portable).unwrap();
    assert_eq!(accel.stats().name, "columns");
    assert!(accel.stats().bytes >= 2 * 144 * 8);
    let mut rays = RayBatch::default();
    // Against a wall from outside; down on the water; up from the ground's other side.
    rays.push(Vec3::new(-5.0, -1.5, 6.0), Vec3::X, 0.0, f32::INFINITY, 1e-5);
    rays.push(Vec3::new(6.0, 5.0, 6.0), Vec3::NEG_Y, 0.0, f32::INFINITY, 1e-5);
    rays.push(Vec3::new(6.0, -5.0, 6.0), Vec3::Y, 0.0, f32::INFINITY, 1e-5);
    let (hits, occluded) = trace(accel.as_ref(), &rays);
    assert_eq!((hits.part.as_slice(), occluded.as_slice()), (&[1, 0, 2][..], &[true; 3][..]));
    assert!((hits.t[2] - 2.0).abs() < 1e-5);
}

#[test]
fn a_ray_that_leaves_the_water_does_not_meet_the_place_it_leaves() {
    let water = Arc::new(waves(12, 0.3, |_| true));
    let (height, _) = water.point(6.2, 5.7).unwrap();
    let scene = lowered(vec![Shape::Surface(water)]);
    let accel = build(&scene, &Accel { water: WaterAccel::Columns, ..Accel::default() }, SimdLevel::Portable).unwrap();
    let mut rays = RayBatch::default();
    for up in [0.3, 1.0] {
        rays.push(Vec3::new(6.2, height as f32, 5.7), Vec3::new(0.1, up, 0.0), 0.0, f32::INFINITY, 1e-5);
    }
    assert_eq!(trace(accel.as_ref(), &rays).1, [false; 2]);
}
