//! Planted roots: a point of a patch first, then a ray through it, mostly one that nearly touches the surface there. A
//! solver that promises must find it, or an earlier true root.

use glam::{DVec3, Vec3};
use proptest::prelude::*;

use super::super::audit::Audit;
use super::super::lattice::basis;
use super::super::solve::{BezierClip, Newton, PatchRay, RaySolver, Reference, Solve, ray_polynomial};
use super::super::*;
use crate::scene::SolverKind;
use crate::simd::SimdLevel;

/// Control heights of 5x5 columns, a place in the middle, a level direction (turn), and by how much the ray's slope
/// differs from the surface's: down to a millionth of a column per column, where the two roots nearly meet.
#[derive(Clone, Debug)]
struct Plant {
    order: u32,
    heights: Vec<f64>,
    place: [f64; 2],
    turn: f64,
    lean: f64,
}

fn plant() -> impl Strategy<Value = Plant> {
    let lean = (-6.0..0.5f64, any::<bool>()).prop_map(|(size, up)| 10f64.powf(size) * if up { 1.0 } else { -1.0 });
    (2..=4u32, proptest::collection::vec(-1.5..1.5f64, 25), [0.02..0.98f64, 0.02..0.98], 0.0..6.3f64, lean)
        .prop_map(|(order, heights, place, turn, lean)| Plant { order, heights, place, turn, lean })
}

impl Plant {
    /// The patch alone, in double precision: no rounding between the root and the solver. Returns the root's share too.
    fn patch_ray(&self) -> (PatchRay, f64) {
        let order = self.order as usize;
        let mut window = [[0.0; 4]; 4];
        for b in 0..order {
            for a in 0..order {
                window[b][a] = self.heights[5 * b + a];
            }
        }
        let [u, v] = self.place;
        let ((bu, du), (bv, dv)) = (basis(order, u), basis(order, v));
        let sum = |x: &[f64; 4], z: &[f64; 4]| -> f64 {
            (0..order).flat_map(|b| (0..order).map(move |a| (a, b))).map(|(a, b)| window[b][a] * x[a] * z[b]).sum()
        };
        let (height, along_u, along_v) = (sum(&bu, &bv), sum(&du, &bv), sum(&bu, &dv));
        let (across, along) = self.turn.sin_cos();
        let rise = along * along_u + across * along_v + self.lean;
        // From where the ray comes over the cell to where it leaves it.
        let reach = |place: f64, speed: f64| {
            let (a, b) = (-place / speed, (1.0 - place) / speed);
            [a.min(b), a.max(b)]
        };
        let ([near_u, far_u], [near_v, far_v]) = (reach(u, along), reach(v, across));
        let (near, far) = (near_u.max(near_v), far_u.min(far_v));
        let ends = |at: f64, speed: f64| [at + near * speed, at + far * speed];
        let ray = PatchRay { order, window, u: ends(u, along), v: ends(v, across), y: ends(height, rise) };
        (ray, -near / (far - near))
    }

    /// The whole surface and a ray through the point in its middle patch, rounded to single precision.
    fn surface_ray(&self) -> (Lattice, Vec3, Vec3) {
        let lattice = Lattice::new(self.order, [5, 5], [0.5; 2], [1.0; 2], &self.heights, |_| true).unwrap();
        let (height, slope) = lattice.evaluate(2, 2, self.place[0], self.place[1]);
        let [x, z] = lattice.from_cell(self.place.map(|place| 2.0 + place));
        let (across, along) = self.turn.sin_cos();
        let direction = DVec3::new(along, along * slope[0] + across * slope[1] + self.lean, across);
        let origin = DVec3::new(x, height, z) - 3.0 * direction;
        (lattice, origin.as_vec3(), direction.as_vec3())
    }
}

fn finds<R: RaySolver>(name: &str, solver: R, plant: &Plant) -> Result<(), TestCaseError> {
    let (ray, root) = plant.patch_ray();
    let polynomial = ray_polynomial(&ray);
    // Of a root whose slope is `lean`, rounding leaves this much unknown; near a double one, the root of it.
    let unknown = (1e-14 / plant.lean.abs()).clamp(1e-12, 1e-7);
    match solver.first_hit(&ray, 1e-12, &mut 0) {
        Solve::Hit(s) => {
            prop_assert!(s <= root + 10.0 * unknown, "{name}: {s} after the planted {root}");
            prop_assert!(polynomial.value(s).abs() < 1e-11, "{name}: {s} is no root: {}", polynomial.value(s));
        }
        answer => prop_assert!(false, "{name}: {answer:?} with a root at {root}"),
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(4000))]

    #[test]
    fn a_planted_root_is_found_in_its_patch(plant in plant()) {
        finds("newton", Newton, &plant)?;
        finds("bezier-clip", BezierClip, &plant)?;
        finds("reference", Reference, &plant)?;
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    #[test]
    fn a_planted_root_is_found_on_the_surface(plants in proptest::collection::vec(plant(), LANES)) {
        for plant in plants {
            let (lattice, origin, direction) = plant.surface_ray();
            for solver in SolverKind::ALL.into_iter().filter(|solver| solver.is_certain()) {
                let surface = SplineSurface::new(lattice.clone(), solver, SimdLevel::detect());
                let mut hits = LaneHits::EMPTY;
                let rays = LaneRays::unbounded(&[(origin, direction)], 1e-6);
                surface.closest(&rays, &mut hits, &mut SolveCounts::default());
                let answer = (hits.hit == 1).then(|| f64::from(hits.t[0]));
                let mut audit = Audit::default();
                audit.check(&lattice, origin.as_dvec3(), direction.as_dvec3(), [0.0, f64::INFINITY], answer);
                let what = solver.name();
                prop_assert_eq!((audit.lost, audit.false_hits, audit.wrong), (0, 0, 0), "{}", what);
                // Rounding of the ray moves it off by less than this: then there must be a hit at all.
                if plant.lean.abs() > 1e-2 {
                    prop_assert!(answer.is_some_and(|t| t < 3.001), "{}: {:?}", what, answer);
                }
            }
        }
    }
}
