//! The report's own solver (its section 2.3.1), as it was: two planes through the ray, Newton from the patch's middle.
//!
//! It loses rays by nature, and that is kept: nothing brackets the iteration, a root that it does not reach is a miss, a
//! root that is not the first passes for the first, and no sign is carried from patch to patch. The benchmark counts what
//! it loses, invents and misplaces. For pictures take another.
//!
//! *At tangency* the Jacobian is singular or nearly so: the guess jumps a short way at random, seeded by the ray's own
//! numbers, so that the same ray always jumps the same way.

use super::newton::surface;
use super::{PatchRay, RaySolver, Solve};
use crate::math::{STEP, scramble};

/// The report's MAX_ITER: steps for one guess.
pub(crate) const MAX_ITER: usize = 5;
/// The report's JITTER_TOLERANCE: the furthest that a guess with a singular Jacobian jumps, in columns along each axis.
/// The report gives no figure; Martin et al. 2000 jump by up to a tenth of the patch.
pub(crate) const JITTER_TOLERANCE: f64 = 0.1;

/// The report's solver.
#[derive(Clone, Copy, Debug)]
pub(in crate::surface) struct Report;

impl RaySolver for Report {
    const CARRIES_SIGN: bool = false;

    /// `tolerance` (a share of the stretch) is the report's ROOT_TOLERANCE: the sum of the distances to the two planes,
    /// in lengths of the stretch.
    fn first_hit(self, ray: &PatchRay, tolerance: f64, iterations: &mut u64) -> Solve {
        let direction = [ray.u[1] - ray.u[0], ray.y[1] - ray.y[0], ray.v[1] - ray.v[0]];
        let origin = [ray.u[0], ray.y[0], ray.v[0]];
        let square: f64 = direction.iter().map(|d| d * d).sum();
        let Some(planes) = planes(direction) else { return Solve::Miss };
        let close = tolerance * square.sqrt();
        let mut random = Jitter::new(ray);
        let (mut u, mut v) = (0.5, 0.5);
        for _ in 0..MAX_ITER {
            *iterations += 1;
            let (height, along_u, along_v) = surface(ray, u, v);
            let from = [u - origin[0], height - origin[1], v - origin[2]];
            let [f, g] = planes.map(|normal| (0..3).map(|axis| normal[axis] * from[axis]).sum::<f64>());
            if f.abs() + g.abs() <= close {
                let s = (0..3).map(|axis| direction[axis] * from[axis]).sum::<f64>() / square;
                let here = [u, v, s].iter().all(|place| (0.0..=1.0).contains(place));
                return if here && !is_own(ray, s, tolerance) { Solve::Hit(s) } else { Solve::Miss };
            }
            let [[f_u, f_v], [g_u, g_v]] =
                planes.map(|normal| [normal[0] + normal[1] * along_u, normal[2] + normal[1] * along_v]);
            let determinant = f_u * g_v - f_v * g_u;
            // Singular to double precision's rounding.
            if determinant.abs() <= f64::EPSILON * (f_u.hypot(f_v) * g_u.hypot(g_v)) {
                u += JITTER_TOLERANCE * random.next();
                v += JITTER_TOLERANCE * random.next();
                continue;
            }
            u -= (f * g_v - g * f_v) / determinant;
            v -= (g * f_u - f * g_u) / determinant;
        }
        Solve::Miss
    }
}

/// A root nearer than this to the start of a ray, in columns (here: in stretches, none of which is longer than a column's
/// diagonal), is the place that the ray leaves: a hundred times what single precision makes of a position ten columns away.
pub(crate) const OWN: f64 = 1e-4;

/// Whether a root is where the ray begins: no sign tells the surface that a ray leaves from one that it meets, so, as in ray
/// tracers of that day, what lies too near the start does not count. A ray that comes over the patch's border begins
/// elsewhere.
fn is_own(ray: &PatchRay, s: f64, tolerance: f64) -> bool {
    let inside = [ray.u[0], ray.v[0]].iter().all(|place| (1e-5..1.0 - 1e-5).contains(place));
    inside && s <= OWN.max(2.0 * tolerance)
}

/// Unit normals of two planes that meet in a ray (Martin et al. 2000, section 2.3): the first holds the axis to which the
/// direction leans least of two, the second stands upright on it.
fn planes(d: [f64; 3]) -> Option<[[f64; 3]; 2]> {
    let first =
        if d[0].abs() > d[1].abs() && d[0].abs() > d[2].abs() { [d[1], -d[0], 0.0] } else { [0.0, d[2], -d[1]] };
    let second =
        [first[1] * d[2] - first[2] * d[1], first[2] * d[0] - first[0] * d[2], first[0] * d[1] - first[1] * d[0]];
    let unit = |n: [f64; 3]| {
        let length = n.iter().map(|c| c * c).sum::<f64>().sqrt();
        (length > 0.0).then(|| n.map(|c| c / length))
    };
    Some([unit(first)?, unit(second)?])
}

/// Numbers in -1..1 from a ray's own (SplitMix64; Steele, Lea and Flood 2014).
struct Jitter(u64);

impl Jitter {
    fn new(ray: &PatchRay) -> Self {
        let numbers = ray.u.iter().chain(&ray.v).chain(&ray.y);
        let mut jitter = Self(0);
        for number in numbers {
            jitter.0 ^= number.to_bits();
            jitter.0 = jitter.bits();
        }
        jitter
    }

    fn bits(&mut self) -> u64 {
        let bits = scramble(self.0);
        self.0 = self.0.wrapping_add(STEP);
        bits
    }

    fn next(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A patch of order 3 that is the plane y = slope (u - 1/2).
    fn slanting(slope: f64) -> PatchRay {
        let row = [-slope, 0.0, slope, 0.0];
        PatchRay { order: 3, window: [row; 4], u: [0.25, 0.75], v: [0.5, 0.5], y: [1.0, -1.0] }
    }

    #[test]
    fn a_plane_is_hit_where_algebra_says() {
        let ray = slanting(0.5);
        // Height 1 - 2 s over a plane that rises from -1/8 by 1/4: they meet at s = 1/2.
        let mut steps = 0;
        let Solve::Hit(s) = Report.first_hit(&ray, 1e-12, &mut steps) else { panic!("a hit") };
        assert!((s - 0.5).abs() < 1e-12 && steps <= 3, "{s} after {steps}");
    }

    #[test]
    fn five_steps_are_all_it_takes_and_a_root_beyond_them_is_lost() {
        // A cusp-like crease far from the middle: the ray crosses it twice, Newton from the middle finds neither in time
        // or not the first.
        let window = [[0.0, 0.0, 40.0, 0.0]; 4];
        let ray = PatchRay { order: 3, window, u: [0.0, 1.0], v: [0.5, 0.5], y: [0.05, 0.0501] };
        let mut steps = 0;
        let answer = Report.first_hit(&ray, 1e-12, &mut steps);
        assert!(steps <= MAX_ITER as u64);
        // 20 u^2 = 0.05: the only crossing is at u = 0.05.
        assert!(matches!(answer, Solve::Miss), "{answer:?}");
        assert!(
            matches!(super::super::Newton.first_hit(&ray, 1e-12, &mut steps), Solve::Hit(s) if (s - 0.05).abs() < 1e-3)
        );
    }

    #[test]
    fn the_place_that_a_ray_leaves_is_no_hit() {
        // On the plane at u = 1/4 and steeper than it.
        let leaving = PatchRay { y: [-0.125, 1.0], ..slanting(0.5) };
        assert_eq!(Report.first_hit(&leaving, 1e-9, &mut 0), Solve::Miss);
        // The same over the patch's border: there it may be a hit.
        let crossing = PatchRay { u: [0.0, 0.5], y: [-0.25, 1.0], ..slanting(0.5) };
        assert!(matches!(Report.first_hit(&crossing, 1e-9, &mut 0), Solve::Hit(_)));
    }

    #[test]
    fn the_jitter_is_the_rays_own() {
        // Level in the middle and a level ray above it: the Jacobian at the first guess is singular.
        let row = [1.0, 0.0, 1.0, 0.0];
        let ray = |y: f64| PatchRay { order: 3, window: [row; 4], u: [0.0, 1.0], v: [0.5, 0.5], y: [y, y] };
        let solve = |y| {
            let mut steps = 0;
            (Report.first_hit(&ray(y), 1e-12, &mut steps), steps)
        };
        assert_eq!(solve(0.4), solve(0.4));
        let (first, second) = (Jitter::new(&ray(0.4)).next(), Jitter::new(&ray(0.41)).next());
        assert!(first != second && first.abs() <= 1.0);
    }
}
