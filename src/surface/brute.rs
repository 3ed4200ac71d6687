//! Every ray against every patch, in double precision: no pyramid, no walk, nothing to go wrong but time. The opponent
//! that the fast walk is held against in whole pictures, and `accel.water = "brute"`.

use std::sync::Arc;

use glam::{DVec3, Vec3};

use super::referee::{self, RefereeHit};
use super::{LANES, LaneHits, LaneRays, LaneSurface, SolveCounts, SplineSurface};

/// A spline surface without any acceleration.
#[derive(Clone, Debug)]
pub struct BruteSurface(pub Arc<SplineSurface>);

impl BruteSurface {
    /// The first hit of one lane over all patches.
    fn first(&self, rays: &LaneRays, lane: usize, counts: &mut SolveCounts) -> Option<RefereeHit> {
        let vector = |axes: &[[f32; LANES]; 3]| {
            DVec3::new(f64::from(axes[0][lane]), f64::from(axes[1][lane]), f64::from(axes[2][lane]))
        };
        let (origin, direction) = (vector(&rays.origin), vector(&rays.direction));
        let range = [f64::from(rays.tnear[lane]), f64::from(rays.tfar[lane])];
        let lattice = self.0.lattice();
        let mut first: Option<RefereeHit> = None;
        for j in 0..lattice.cells[1] {
            for i in (0..lattice.cells[0]).filter(|&i| lattice.exists(i, j)) {
                let range = [range[0], first.map_or(range[1], |hit| hit.t)];
                if let Some((hit, solved)) = referee::patch_hit(lattice, [i, j], origin, direction, range) {
                    counts.patches += u64::from(solved);
                    if let Some(hit) = hit
                        && first.is_none_or(|nearest| hit.t < nearest.t)
                    {
                        first = Some(hit);
                    }
                }
            }
        }
        first
    }
}

impl LaneSurface for BruteSurface {
    fn bounds(&self) -> [Vec3; 2] {
        self.0.bounds()
    }

    fn closest(&self, rays: &LaneRays, hits: &mut LaneHits, counts: &mut SolveCounts) {
        hits.hit = 0;
        hits.gave_up = 0;
        for lane in (0..LANES).filter(|lane| rays.active >> lane & 1 == 1) {
            let Some(hit) = self.first(rays, lane, counts) else { continue };
            hits.hit |= 1 << lane;
            // Rounding to single precision must not carry a hit past the ray's end.
            hits.t[lane] = (hit.t as f32).min(rays.tfar[lane]);
            hits.primitive[lane] = hit.patch;
            hits.u[lane] = hit.uv[0] as f32;
            hits.v[lane] = hit.uv[1] as f32;
            let normal = self.0.patch_point(hit.patch, hits.u[lane], hits.v[lane]).normal;
            for axis in 0..3 {
                hits.normal[axis][lane] = normal[axis];
            }
        }
    }

    fn occluded(&self, rays: &LaneRays, counts: &mut SolveCounts) -> u16 {
        (0..LANES)
            .filter(|&lane| rays.active >> lane & 1 == 1 && self.first(rays, lane, counts).is_some())
            .fold(0, |hit, lane| hit | 1 << lane)
    }

    fn bytes(&self) -> u64 {
        0
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::Random;
    use super::*;
    use crate::scene::SolverKind;
    use crate::simd::SimdLevel;
    use crate::surface::Lattice;

    #[test]
    fn the_walk_finds_what_brute_force_finds() {
        for order in 2..=4 {
            let mut random = Random(order.into());
            let heights: Vec<f64> = (0..144).map(|_| 2.0 * random.next()).collect();
            let present: Vec<bool> = (0..144).map(|_| random.next() > 0.2).collect();
            let lattice = Lattice::new(order, [12, 12], [0.5; 2], [1.0; 2], &heights, |k| present[k]).unwrap();
            let surface = Arc::new(SplineSurface::new(lattice, SolverKind::Univariate, SimdLevel::detect()));
            let brute = BruteSurface(Arc::clone(&surface));
            let mut found = 0;
            for _ in 0..200 {
                let mut rays = LaneRays { active: u16::MAX, ..LaneRays::EMPTY };
                for lane in 0..LANES {
                    for axis in 0..3 {
                        rays.origin[axis][lane] = (12.0 * random.next()) as f32;
                        rays.direction[axis][lane] = (2.0 * random.next() - 1.0) as f32;
                    }
                    rays.origin[1][lane] = (6.0 * random.next() - 2.0) as f32;
                    rays.tfar[lane] = 50.0;
                    rays.tolerance[lane] = 1e-6;
                }
                let (mut ours, mut theirs) = (LaneHits::EMPTY, LaneHits::EMPTY);
                let mut counts = SolveCounts::default();
                surface.closest(&rays, &mut ours, &mut counts);
                brute.closest(&rays, &mut theirs, &mut counts);
                assert_eq!(ours.hit, theirs.hit, "order {order}");
                assert_eq!(brute.occluded(&rays, &mut counts), theirs.hit);
                for lane in (0..LANES).filter(|lane| ours.hit >> lane & 1 == 1) {
                    found += 1;
                    let off = (ours.t[lane] - theirs.t[lane]).abs();
                    assert!(off < 1e-3, "order {order}: {} {}", ours.t[lane], theirs.t[lane]);
                }
            }
            assert!(found > 500, "order {order}: {found}");
        }
    }
}
