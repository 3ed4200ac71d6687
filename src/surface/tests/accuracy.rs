//! The tolerance ladder, and the same hit at every width of the processor.

use super::super::referee;
use super::super::*;
use super::{rays, waves};
use crate::scene::SolverKind;
use crate::simd::SimdLevel;

/// Rays over `n` columns that meet the surface at a cosine of at least 0.1, with the referee's t: where they graze, the
/// rounding of the ray itself is more than any tolerance here.
fn steep(lattice: &Lattice, n: usize) -> Vec<((glam::Vec3, glam::Vec3), f64)> {
    let exact = |&(origin, direction): &(glam::Vec3, glam::Vec3)| {
        let (origin, direction) = (origin.as_dvec3(), direction.as_dvec3());
        let hit = referee::first_hit(lattice, origin, direction, [0.0, f64::INFINITY])?;
        let cell = [hit.patch as usize % lattice.cells[0], hit.patch as usize / lattice.cells[0]];
        let (_, slope) = lattice.evaluate(cell[0], cell[1], hit.uv[0], hit.uv[1]);
        let normal = glam::DVec3::new(-slope[0], 1.0, -slope[1]).normalize();
        (normal.dot(direction.normalize()).abs() >= 0.1).then_some(hit.t)
    };
    rays(n, 8000, 5).into_iter().filter_map(|ray| exact(&ray).map(|t| (ray, t))).collect()
}

#[test]
fn the_error_stays_under_the_tolerance_asked_for() {
    for order in 2..=4 {
        let lattice = waves(order, 30, false, 11);
        let steep = steep(&lattice, 30);
        assert!(steep.len() > 2000, "{}", steep.len());
        for solver in [SolverKind::Univariate, SolverKind::Newton, SolverKind::BezierClip] {
            let surface = SplineSurface::new(lattice.clone(), solver, SimdLevel::detect());
            let mut worst = Vec::new();
            for exponent in 2..=7 {
                let asked = 10f64.powi(-exponent);
                let mut most = 0.0f64;
                for chunk in steep.chunks(LANES) {
                    let mut packet = LaneRays::unbounded(&chunk.iter().map(|(ray, _)| *ray).collect::<Vec<_>>(), 0.0);
                    for (lane, ((_, direction), _)) in chunk.iter().enumerate() {
                        packet.tolerance[lane] = (asked / direction.as_dvec3().length()) as f32;
                    }
                    let mut hits = LaneHits::EMPTY;
                    surface.closest(&packet, &mut hits, &mut SolveCounts::default());
                    for (lane, ((_, direction), exact)) in chunk.iter().enumerate() {
                        assert_eq!(hits.hit >> lane & 1, 1, "{} order {order}", solver.name());
                        let length = direction.as_dvec3().length();
                        let error = (f64::from(hits.t[lane]) - exact).abs() * length;
                        // Single precision holds a patch's heights and the ray's within it to some ulps of a column or
                        // two; at this cosine ten times as much along the ray. And t itself to a few of its own.
                        let ulps = f64::from(f32::EPSILON) * (4.0 * exact * length + 40.0);
                        most = most.max(error / asked.max(ulps));
                    }
                }
                worst.push(most);
            }
            assert!(worst.iter().all(|&most| most <= 1.0), "{} order {order}: {worst:?}", solver.name());
        }
    }
}

#[test]
fn every_width_gives_the_same_hit() {
    for order in 2..=4 {
        let lattice = waves(order, 30, true, 3);
        let at = |level| SplineSurface::new(lattice.clone(), SolverKind::Univariate, level);
        let surfaces = SimdLevel::ALL.map(at);
        let (mut checked, mut other) = (0, 0);
        for chunk in rays(30, 8000, 8).chunks(LANES) {
            let packet = LaneRays::unbounded(chunk, 1e-6);
            let answers = surfaces.each_ref().map(|surface| {
                let mut hits = LaneHits::EMPTY;
                surface.closest(&packet, &mut hits, &mut SolveCounts::default());
                hits
            });
            for (lane, (_, direction)) in chunk.iter().enumerate() {
                let [first, rest @ ..] = &answers;
                for answer in rest {
                    checked += 1;
                    let hit = |hits: &LaneHits| hits.hit >> lane & 1 == 1;
                    let t = first.t[lane];
                    let apart = (answer.t[lane] - t).abs() * direction.length();
                    let same = hit(answer) == hit(first)
                        && (!hit(first)
                            || (answer.primitive[lane] == first.primitive[lane] && apart <= 1e-5 * (1.0 + t)));
                    other += u64::from(!same);
                }
            }
        }
        // Grazes and borders: another rounding, another side.
        assert!(other * 200 <= checked, "order {order}: {other} of {checked}");
    }
}
