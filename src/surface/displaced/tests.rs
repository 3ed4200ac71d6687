//! The displaced surface against the height function where nothing is displaced, against itself solved otherwise, and
//! against rays that aim to slip through.

use super::*;
use crate::simd::SimdLevel;
use crate::surface::Sides;
use crate::surface::audit::Audit;
use crate::surface::control::{self, tests::lake};
use crate::surface::tests::{Random, rays};

const SOLVERS: [SolverKind; 3] = [SolverKind::Newton, SolverKind::BezierClip, SolverKind::Reference];

/// Waves over n x n columns of 1 m with the first heights in single precision, every fifth column absent where asked;
/// shifts of up to `share` of a column but at the edge.
fn build(order: u32, n: usize, dry: bool, share: f64, solver: SolverKind) -> DisplacedSurface {
    let mut random = Random(17 + u64::from(order));
    let present: Vec<bool> = (0..n * n).map(|_| !dry || random.next() > 0.3).collect();
    let heights: Vec<f64> = (0..n * n)
        .map(|k| {
            let (x, z) = ((k % n) as f64, (k / n) as f64);
            let height = (0.4 * x + 0.3 * z).sin() + 0.3 * (0.9 * x - 0.5 * z).cos() + 0.4 * random.next();
            f64::from(height as f32)
        })
        .collect();
    let edge = order as usize / 2;
    let shifts: Vec<[f64; 2]> = (0..n * n)
        .map(|k| {
            let inner = [k % n, k / n].iter().all(|&c| (edge..n - edge).contains(&c));
            let mut shift = || if inner { share * random.within(-1.0, 1.0) } else { 0.0 };
            [shift(), shift()]
        })
        .collect();
    let lattice = Lattice::new(order, [n, n], [0.5; 2], [1.0; 2], &heights, |k| present[k]).unwrap();
    let flat = Arc::new(SplineSurface::new(lattice, SolverKind::Univariate, SimdLevel::detect()));
    DisplacedSurface::new(flat, &heights, &shifts, solver).unwrap()
}

fn closest(surface: &dyn LaneSurface, packet: &LaneRays) -> LaneHits {
    let mut hits = LaneHits::EMPTY;
    surface.closest(packet, &mut hits, &mut SolveCounts::default());
    hits
}

#[test]
fn without_displacement_it_is_the_height_function() {
    for order in 2..=4 {
        for solver in SOLVERS {
            let surface = build(order, 14, true, 0.0, solver);
            let lattice = surface.lattice().clone();
            let (mut audit, mut compared, mut gave_up) = (Audit::default(), 0, 0);
            for chunk in rays(14, 1600, 4).chunks(LANES) {
                let packet = LaneRays::unbounded(chunk, 1e-6);
                let (ours, theirs) = (closest(&surface, &packet), closest(&**surface.flat(), &packet));
                gave_up += ours.gave_up.count_ones();
                for (lane, (origin, direction)) in chunk.iter().enumerate() {
                    let answer = (ours.hit >> lane & 1 == 1).then(|| f64::from(ours.t[lane]));
                    // Along a border between a patch and none, the height function takes the patch only for plumb rays.
                    let on_border = [origin.x, origin.z]
                        .iter()
                        .zip([direction.x, direction.z])
                        .any(|(place, speed)| speed == 0.0 && (2.0 * place).fract() == 0.0);
                    if !on_border {
                        audit.check(&lattice, origin.as_dvec3(), direction.as_dvec3(), [0.0, f64::INFINITY], answer);
                    }
                    let both = ours.hit & theirs.hit;
                    if both >> lane & 1 == 1 && ours.primitive[lane] == theirs.primitive[lane] {
                        let normal =
                            |hits: &LaneHits| Vec3::from_array([0, 1, 2].map(|a| hits.normal[a][lane])).normalize();
                        let cosine = normal(&theirs).dot(direction.normalize()).abs();
                        if cosine > 0.05 && (ours.t[lane] - theirs.t[lane]).abs() < 1e-3 {
                            compared += 1;
                            let off = (ours.u[lane] - theirs.u[lane]).abs().max((ours.v[lane] - theirs.v[lane]).abs());
                            let room = 1e-5 / cosine * (1.0 + 1e-3 * origin.length());
                            assert!(off < room, "{} order {order}: {off}", solver.name());
                            assert!((normal(&ours) - normal(&theirs)).length() < 10.0 * room);
                        }
                    }
                }
            }
            let what = format!("{} order {order}", solver.name());
            assert_eq!((audit.lost, audit.false_hits, audit.wrong), (0, 0, 0), "{what}: {audit:?}");
            assert!(compared > 400 && gave_up <= 2, "{what}: {compared} compared, {gave_up} gave up");
        }
    }
}

#[test]
fn solvers_agree_on_displaced_points_with_and_without_boxes() {
    for order in 2..=4 {
        let surfaces = SOLVERS.map(|solver| Arc::new(build(order, 12, true, 0.24, solver)));
        let brute = BruteDisplaced(Arc::clone(&surfaces[0]));
        let (mut hit, mut differs) = (0, 0);
        for chunk in rays(12, 800, 21).chunks(LANES) {
            let packet = LaneRays::unbounded(chunk, 1e-6);
            let truth = closest(&brute, &packet);
            for surface in &surfaces {
                let ours = closest(&**surface, &packet);
                assert_eq!(surface.occluded(&packet, &mut SolveCounts::default()), ours.hit);
                for lane in 0..chunk.len() {
                    let both = (ours.hit >> lane & 1, truth.hit >> lane & 1);
                    hit += u32::from(both == (1, 1));
                    let near = (ours.t[lane] - truth.t[lane]).abs() <= 1e-5 * (1.0 + truth.t[lane]);
                    differs += u32::from(both.0 != both.1 || (both == (1, 1) && !near));
                }
            }
        }
        assert!(hit > 900, "order {order}: {hit}");
        // Grazes within single precision of a touch may fall either way.
        assert!(differs <= 2, "order {order}: {differs} of {hit}");
    }
}

#[test]
fn a_planted_root_is_found_or_an_earlier_one() {
    for order in 2..=4 {
        for solver in SOLVERS {
            let surface = build(order, 7, false, 0.24, solver);
            let mut random = Random(5);
            for _ in 0..1500 {
                let (net, base) = surface.patch(3, 3);
                let (u, v) = (random.within(0.02, 0.98), random.within(0.02, 0.98));
                let [point, along_u, along_v] = net.value(u, v);
                // From a tangent direction, leaning out by down to a hundred-thousandth.
                let turn = random.within(0.0, 6.3);
                let lean = 10f64.powf(random.within(-5.0, 0.5)) * if random.next() < 0.5 { 1.0 } else { -1.0 };
                let direction = along_u * turn.cos() + along_v * turn.sin() + DVec3::Y * lean;
                let origin = base + point - direction * 2.0;
                let ray = Ray { origin, direction, range: [0.0, f64::INFINITY], tolerance: [1e-9, 0.0] };
                let what = format!("{} order {order} lean {lean:e}", solver.name());
                let Ok(Some(hit)) = surface.first(&ray, surface.method, &mut SolveCounts::default()) else {
                    panic!("{what}: lost")
                };
                assert!(hit.t <= 2.0 + 1e-8 + 1e-13 / lean.abs(), "{what}: {} after the planted root", hit.t);
                let cells = surface.lattice().cells[0];
                let (net, base) = surface.patch(hit.patch as usize % cells, hit.patch as usize / cells);
                let off = base + net.value(hit.uv[0], hit.uv[1])[0] - (origin + direction * hit.t);
                // The normal keeps its side: the surface is nowhere folded.
                assert!(off.length() < 1e-7 && hit.normal.y > 0.0, "{what}: {off} from the surface");
            }
        }
    }
}

#[test]
fn no_ray_slips_between_patches() {
    for order in 2..=4 {
        for solver in SOLVERS {
            let surface = build(order, 10, false, 0.24, solver);
            let mut random = Random(9);
            let packets = if solver == SolverKind::Reference { 40 } else { 400 };
            for _ in 0..packets {
                let mut chunk = Vec::new();
                for lane in 0..LANES {
                    let (i, j) = (1 + (random.next() * 8.0) as usize, 1 + (random.next() * 8.0) as usize);
                    // Corners, borders along v, borders along u.
                    let (u, v) = [(0.0, 0.0), (0.0, random.next()), (random.next(), 1.0)][lane % 3];
                    let (net, base) = surface.patch(i, j);
                    let target = base + net.value(u, v)[0];
                    let up = if lane % 2 == 0 { -1.0 } else { 1.0 };
                    // Steeper than any slope here: it crosses once, and no crest (a crease of order 2) is grazed.
                    let lean = if lane % 5 == 0 { 0.0 } else { 0.15 };
                    let direction = DVec3::new(lean * random.within(-1.0, 1.0), up, lean * random.within(-1.0, 1.0));
                    // All waves lie within 2 m: from 4 m above or below the ray must cross.
                    chunk.push(((target - direction * 4.0).as_vec3(), direction.as_vec3()));
                }
                let packet = LaneRays::unbounded(&chunk, 1e-6);
                let hits = closest(&surface, &packet);
                for (lane, (origin, direction)) in chunk.iter().enumerate() {
                    let crosses = hits.hit >> lane & 1 == 1 && (hits.t[lane] - 4.0).abs() < 1e-3;
                    assert!(crosses, "{} order {order}: {origin} {direction}", solver.name());
                }
            }
        }
    }
}

#[test]
fn a_surface_that_only_comes_near_is_not_hit_and_one_that_touches_is_not_missed_in_silence() {
    // A ridge along z at height 1/2 in the middle of five columns (order 3: half of the crest's 1).
    let heights: Vec<f64> = (0..25).map(|k| if k % 5 == 2 { 1.0 } else { 0.0 }).collect();
    let lattice = Lattice::new(3, [5, 5], [0.5; 2], [1.0; 2], &heights, |_| true).unwrap();
    let crest = lattice.evaluate(2, 2, 0.5, 0.5).0;
    let flat = Arc::new(SplineSurface::new(lattice, SolverKind::Univariate, SimdLevel::Portable));
    let mut shifts = vec![[0.0; 2]; 25];
    shifts[12] = [0.0, 0.2];
    for solver in SOLVERS {
        let surface = DisplacedSurface::new(Arc::clone(&flat), &heights, &shifts, solver).unwrap();
        let solve = |height: f64| {
            let origin = DVec3::new(-1.0, height, 2.5);
            let ray = Ray { origin, direction: DVec3::X, range: [0.0, 100.0], tolerance: [1e-6, 0.0] };
            surface.first(&ray, surface.method, &mut SolveCounts::default())
        };
        for above in [1e-2, 1e-5, 1e-9] {
            assert!(matches!(solve(crest + above), Ok(None)), "{} {above}", solver.name());
            let Ok(Some(hit)) = solve(crest - above) else { panic!("{} {above}", solver.name()) };
            assert!((hit.t - 3.5).abs() < 2.0 * above.sqrt() + 1e-6, "{} {above}: {}", solver.name(), hit.t);
        }
        let touch = solve(crest);
        assert!(!matches!(touch, Ok(None)) || solver != SolverKind::Reference, "{}", solver.name());
    }
}

#[test]
fn the_body_of_water_stays_closed() {
    for order in 2..=4 {
        let mut columns = lake();
        columns.flow = (0..64).map(|k| [1.0 + (k % 3) as f64, 0.5 * (k % 5) as f64]).collect();
        let displacement = crate::scene::Displacement { adhesion: 0.24, shear: 0.3 };
        let settings = crate::scene::Surface { order, solver: SolverKind::Newton, displacement, ..Default::default() };
        let build = |lattice| Arc::new(SplineSurface::new(lattice, SolverKind::Univariate, SimdLevel::detect()));
        let flat = build(control::water(&columns, &settings, [0.0; 3]).unwrap().unwrap());
        let bed = build(control::bed(&columns, &settings, [0.0; 3]).unwrap());
        let water = control::displaced_water(&flat, &columns, &settings, [0.0; 3]).unwrap();
        assert!(water.points.iter().any(|point| point[0].abs() > 0.05 || point[2].abs() > 0.05));
        let sides = Sides::new(flat, Some(bed.clone()));
        let mut random = Random(order.into());
        let mut inside = 0;
        while inside < 6000 {
            let (x, z) = (random.within(0.0, 8.0), random.within(0.0, 8.0));
            // The displaced surface's own height: it is the graph of a function.
            let top = water.first_hit(DVec3::new(x, 9.0, z), DVec3::NEG_Y, [0.0, 20.0]).map(|hit| 9.0 - hit.t);
            let (Some(top), Some((bottom, _))) = (top, bed.point(x, z)) else { continue };
            let y = bottom + (top - bottom) * random.next();
            if y < bottom + 1e-3 || y > top - 1e-3 {
                continue;
            }
            inside += 1;
            let (rise, turn) = (random.within(-1.0, 1.0), random.within(0.0, std::f64::consts::TAU));
            let level = (1.0f64 - rise * rise).sqrt();
            let mut direction = DVec3::new(level * turn.cos(), rise, level * turn.sin());
            // One in four aims at an edge between a wall and the water.
            if inside % 4 == 0 {
                let edge = random.within(0.0, 8.0);
                let height = water.flat.point(0.0, edge).map_or(0.5, |(height, _)| height);
                direction = DVec3::new(-x, height - y, edge - z);
            }
            let rays = LaneRays::unbounded(&[(DVec3::new(x, y, z).as_vec3(), direction.as_vec3())], 1e-6);
            let counts = &mut SolveCounts::default();
            let closed = water.occluded(&rays, counts) | bed.occluded(&rays, counts) | sides.occluded(&rays, counts);
            assert_eq!(closed, 1, "order {order}: {rays:?}");
        }
    }
}

#[test]
fn solvers_of_height_functions_are_refused_by_name() {
    let flat = Arc::clone(build(3, 7, false, 0.0, SolverKind::Newton).flat());
    let refused = DisplacedSurface::new(flat, &[0.0; 49], &[[0.0; 2]; 49], SolverKind::Report).unwrap_err();
    assert!(refused.to_string().starts_with("surface.solver is report"), "{refused}");
    for solver in SolverKind::ALL {
        assert_eq!(solver.takes_displaced(), SOLVERS.contains(&solver));
    }
}
