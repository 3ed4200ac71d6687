//! The two-plane Newton iteration of Martin, Cohen, Fish and Shirley, "Practical Ray Tracing of Trimmed NURBS Surfaces",
//! 2000: the ray is the meeting of two planes, and (u, v) is driven until the surface point lies on both.
//!
//! We depart from it where it can only hope. Guesses come from the patch's Bézier hull along the ray, subdivided: where
//! its control polygon first crosses zero. A root is accepted as the first one only when the stretch before it is proven
//! free of roots by its sign variations and the sign changes around it; a stretch that neither converges nor can be
//! cleared is halved. What is left undecided at double precision's resolution is *gave up*, and so is what lies behind.
//!
//! *At tangency* the Jacobian is singular: the step is refused, and subdivision decides.

use super::{PatchRay, RaySolver, Solve, ray_polynomial};
use crate::math::Bernstein;
use crate::surface::lattice::basis;

/// Newton steps for one guess: it squares its error, so what has not settled by then will not.
const STEPS: usize = 10;
/// Shortest stretch, as a share of the whole: below it the ends are as good as one number.
const SHORTEST: f64 = 8.0 * f64::EPSILON;

/// Martin et al.'s solver with proof of the first root.
#[derive(Clone, Copy, Debug)]
pub(in crate::surface) struct Newton;

impl RaySolver for Newton {
    fn first_hit(self, ray: &PatchRay, tolerance: f64, iterations: &mut u64) -> Solve {
        first_within(ray, &ray_polynomial(ray), [0.0, 1.0], tolerance, iterations)
    }
}

/// The first root of `polynomial`, which is the ray's over `range` rescaled to 0..1.
fn first_within(
    ray: &PatchRay,
    polynomial: &Bernstein,
    range: [f64; 2],
    tolerance: f64,
    iterations: &mut u64,
) -> Solve {
    let coefficients = polynomial.coefficients();
    let last = coefficients[coefficients.len() - 1];
    if polynomial.variations() == 0 && last != 0.0 && coefficients[0] != 0.0 {
        return Solve::Miss;
    }
    let [start, end] = range;
    let guess = start + (end - start) * polygon_crossing(coefficients);
    if let Some(root) = two_plane_newton(ray, guess, tolerance, iterations)
        && (start..=end).contains(&root)
        && is_first(polynomial, (root - start) / (end - start), tolerance / (end - start))
    {
        return Solve::Hit(root);
    }
    if end - start <= SHORTEST {
        // Ends of different sign prove a root here; equal ends prove nothing either way.
        return if coefficients[0] * last <= 0.0 { Solve::Hit(0.5 * (start + end)) } else { Solve::GaveUp };
    }
    let middle = 0.5 * (start + end);
    let (left, right) = polynomial.split(0.5);
    match first_within(ray, &left, [start, middle], tolerance, iterations) {
        Solve::Miss => first_within(ray, &right, [middle, end], tolerance, iterations),
        // Whatever lies behind a doubt, it is not certain to be the first.
        found => found,
    }
}

/// Whether the first root of `polynomial` in 0..1 lies within `tolerance` of `root`: none before, and a change of sign
/// around it.
///
/// Newton's iteration ends where its steps are short. That may be beside a place where the surface only comes near the
/// ray, or at the second of two roots.
fn is_first(polynomial: &Bernstein, root: f64, tolerance: f64) -> bool {
    let (before, after) = ((root - tolerance).max(0.0), (root + tolerance).min(1.0));
    let (clear, _) = polynomial.split(before);
    (before == 0.0 || clear.variations() == 0) && polynomial.value(before) * polynomial.value(after) <= 0.0
}

/// Where the control polygon first crosses zero, 0..1: the guess.
fn polygon_crossing(coefficients: &[f64]) -> f64 {
    let degree = (coefficients.len() - 1) as f64;
    for (k, pair) in coefficients.windows(2).enumerate() {
        if pair[0] == 0.0 {
            return k as f64 / degree;
        }
        if pair[0] * pair[1] < 0.0 {
            return (k as f64 + pair[0] / (pair[0] - pair[1])) / degree;
        }
    }
    0.5
}

/// Drives (u, v) onto both planes of the ray from the ray's own point at `guess`; the root as a share of the stretch.
///
/// The planes are those of the paper for a ray in (x, y, z) = (u, height, v): one holds the ray and the vertical, the
/// other the ray and the level direction across it.
fn two_plane_newton(ray: &PatchRay, guess: f64, tolerance: f64, iterations: &mut u64) -> Option<f64> {
    let direction = [ray.u[1] - ray.u[0], ray.y[1] - ray.y[0], ray.v[1] - ray.v[0]];
    let origin = [ray.u[0], ray.y[0], ray.v[0]];
    let level = direction[0].hypot(direction[2]);
    let (mut u, mut v) = (ray.u[0] + guess * direction[0], ray.v[0] + guess * direction[2]);
    // A plumb ray has no level direction of its own; any serves.
    let across = if level > 0.0 { [-direction[2] / level, direction[0] / level] } else { [1.0, 0.0] };
    // Plane 1: normal (across_u, 0, across_v). Plane 2: normal = direction x (across_u, 0, across_v).
    let second =
        [direction[1] * across[1], direction[2] * across[0] - direction[0] * across[1], -direction[1] * across[0]];
    let scale = (second[0] * second[0] + second[1] * second[1] + second[2] * second[2]).sqrt();
    let along = direction[0] * direction[0] + direction[1] * direction[1] + direction[2] * direction[2];
    if scale == 0.0 || along == 0.0 {
        return None;
    }
    let second = second.map(|n| n / scale);
    let mut last_step = f64::INFINITY;
    for _ in 0..STEPS {
        *iterations += 1;
        let (height, along_u, along_v) = surface(ray, u, v);
        let from = [u - origin[0], height - origin[1], v - origin[2]];
        let f = from[0] * across[0] + from[2] * across[1];
        let g = from[0] * second[0] + from[1] * second[1] + from[2] * second[2];
        let (g_u, g_v) = (second[0] + second[1] * along_u, second[2] + second[1] * along_v);
        let determinant = across[0] * g_v - across[1] * g_u;
        let size = g_u.hypot(g_v);
        // Singular to rounding: the tangent plane holds the ray.
        if determinant.abs() <= 1e-12 * size || !determinant.is_finite() {
            return None;
        }
        let (du, dv) = ((f * g_v - g * across[1]) / determinant, (g * across[0] - f * g_u) / determinant);
        u -= du;
        v -= dv;
        // Beyond the cell's neighbourhood this polynomial piece says nothing of the surface.
        if !(-1.0..=2.0).contains(&u) || !(-1.0..=2.0).contains(&v) {
            return None;
        }
        let (height, ..) = surface(ray, u, v);
        let share =
            ((u - origin[0]) * direction[0] + (height - origin[1]) * direction[1] + (v - origin[2]) * direction[2])
                / along;
        let step = (share - last_step).abs();
        last_step = share;
        if step <= tolerance * 0.1 {
            return Some(share);
        }
    }
    None
}

/// Height and slopes in u and v of the patch.
pub(super) fn surface(ray: &PatchRay, u: f64, v: f64) -> (f64, f64, f64) {
    let ((bu, du), (bv, dv)) = (basis(ray.order, u), basis(ray.order, v));
    let (mut height, mut along_u, mut along_v) = (0.0, 0.0, 0.0);
    for b in 0..ray.order {
        for a in 0..ray.order {
            height += ray.window[b][a] * bu[a] * bv[b];
            along_u += ray.window[b][a] * du[a] * bv[b];
            along_v += ray.window[b][a] * bu[a] * dv[b];
        }
    }
    (height, along_u, along_v)
}
