//! Bézier clipping (Nishita, Sederberg and Kakimoto, "Ray Tracing Trimmed Rational Surface Patches", 1990; Sederberg and
//! Nishita, "Curve Intersection Using Bézier Clipping", 1990): of a stretch only the part is kept over which the convex
//! hull of its control polygon meets zero, again and again. Where that keeps more than four fifths, the stretch may hold
//! several roots and is halved, nearer half first.
//!
//! For a height function the two clips of a patch, in u and in v, are one along the ray: its polynomial is clipped.
//!
//! *First root:* what is cut away is free of roots, by the hull property; a hit is given only for a stretch with one sign
//! variation, or at a border between stretches of different sign. *At tangency* the hull keeps meeting zero from one
//! side: the stretch shrinks to where rounding decides (some 1e-8 of it). If the polynomial's rounded values change their
//! sign there, that is the hit; if the ends still agree at double precision's resolution, the answer is *gave up*.

use super::{PatchRay, RaySolver, Solve, ray_polynomial};
use crate::math::Bernstein;

/// A clip that keeps more than this share of a stretch is replaced by a halving (Nishita et al. 1990).
const KEEPS: f64 = 0.8;
/// Shortest stretch, as a share of the whole: below it the ends are as good as one number.
const SHORTEST: f64 = 8.0 * f64::EPSILON;

/// Clipping of the ray's polynomial.
#[derive(Clone, Copy, Debug)]
pub(in crate::surface) struct BezierClip;

impl RaySolver for BezierClip {
    fn first_hit(self, ray: &PatchRay, tolerance: f64, iterations: &mut u64) -> Solve {
        let polynomial = ray_polynomial(ray);
        let largest = polynomial.coefficients().iter().fold(0.0f64, |most, c| most.max(c.abs()));
        // De Casteljau's sums lose a few units in the last place at each level of the degree, and again at each cut.
        let rounding = 16.0 * f64::EPSILON * largest;
        first_within(&polynomial, [0.0, 1.0], tolerance, rounding, iterations)
    }
}

/// The first root of `whole`, which is the ray's polynomial over `range` rescaled to 0..1.
fn first_within(whole: &Bernstein, range: [f64; 2], tolerance: f64, rounding: f64, iterations: &mut u64) -> Solve {
    let (mut polynomial, [mut start, mut end]) = (*whole, range);
    let ends = |polynomial: &Bernstein| {
        let c = polynomial.coefficients();
        [c[0], c[c.len() - 1]]
    };
    let [side, far] = ends(whole);
    loop {
        *iterations += 1;
        let [first, last] = ends(&polynomial);
        // What was cut away has no root: a sign that changed on the way is a root at the cut itself.
        if first == 0.0 || side * first < 0.0 {
            return Solve::Hit(start);
        }
        let variations = polynomial.variations();
        if variations == 0 {
            return if last == 0.0 || side * far < 0.0 { Solve::Hit(end) } else { Solve::Miss };
        }
        let width = end - start;
        if variations == 1 && width <= tolerance {
            return Solve::Hit(start + width * first / (first - last));
        }
        if width <= SHORTEST {
            // Ends of different sign prove a root here; equal ends prove nothing either way.
            return if first * last <= 0.0 { Solve::Hit(0.5 * (start + end)) } else { Solve::GaveUp };
        }
        let [low, high] = hull_on_axis(&polynomial, rounding);
        if high - low > KEEPS {
            let middle = 0.5 * (start + end);
            let (left, right) = polynomial.split(0.5);
            return match first_within(&left, [start, middle], tolerance, rounding, iterations) {
                Solve::Miss if ends(&left)[1] * ends(&right)[0] < 0.0 => Solve::Hit(middle),
                Solve::Miss => match first_within(&right, [middle, end], tolerance, rounding, iterations) {
                    Solve::Miss if side * far < 0.0 => Solve::Hit(end),
                    answer => answer,
                },
                answer => answer,
            };
        }
        let (kept, _) = polynomial.split(high);
        polynomial = if high > 0.0 { kept.split(low / high).1 } else { kept };
        (start, end) = (start + width * low, start + width * high);
    }
}

/// The part of 0..1 over which the convex hull of the points (k / degree, c_k), thickened by `rounding`, meets zero.
///
/// The polynomial has coefficients of both signs, so that there is such a part.
fn hull_on_axis(polynomial: &Bernstein, rounding: f64) -> [f64; 2] {
    let c = polynomial.coefficients();
    let degree = (c.len() - 1) as f64;
    let (mut low, mut high) = (1.0f64, 0.0f64);
    // A side of the hull that crosses zero joins a point above with one below, and so does every chord that is no side:
    // the outermost crossings of all chords are the hull's own.
    for (i, &a) in c.iter().enumerate() {
        if a.abs() <= rounding {
            let place = i as f64 / degree;
            (low, high) = (low.min(place), high.max(place));
        }
        for (j, &b) in c.iter().enumerate().skip(i + 1) {
            if a * b < 0.0 {
                let (x, y) = (i as f64 / degree, j as f64 / degree);
                // Nearer to the left with less of what lies left, nearer to the right with less of what lies right.
                let cross = |a: f64, b: f64| x + (y - x) * (a / (a + b)).clamp(0.0, 1.0);
                let (a, b) = (a.abs(), b.abs());
                low = low.min(cross((a - rounding).max(0.0), b + rounding));
                high = high.max(cross(a + rounding, (b - rounding).max(0.0)));
            }
        }
    }
    [low.max(0.0), high.min(1.0)]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn solve(coefficients: &[f64], tolerance: f64) -> (Solve, u64) {
        let mut steps = 0;
        (first_within(&Bernstein::new(coefficients), [0.0, 1.0], tolerance, 1e-15, &mut steps), steps)
    }

    #[test]
    fn the_hull_meets_zero_where_its_sides_do() {
        // Points (0, 1), (1/2, -1), (1, 1): the hull's lower sides cross at 1/4 and 3/4.
        assert_eq!(hull_on_axis(&Bernstein::new(&[1.0, -1.0, 1.0]), 0.0), [0.25, 0.75]);
        // Thickened it reaches further, never less.
        let [low, high] = hull_on_axis(&Bernstein::new(&[1.0, -1.0, 1.0]), 0.1);
        assert!(low < 0.25 && high > 0.75);
    }

    #[test]
    fn clipping_converges_by_squares() {
        // 1 - s - s^2 + s^3 / 2 in Bernstein form.
        let (answer, steps) = solve(&[1.0, 2.0 / 3.0, 0.0, -0.5], 1e-14);
        let Solve::Hit(s) = answer else { panic!("{answer:?}") };
        assert!((1.0 - s - s * s + 0.5 * s * s * s).abs() < 1e-13, "{s}");
        assert!(steps <= 8, "{steps} steps");
    }

    #[test]
    fn the_first_of_a_close_pair_is_found_and_a_touch_is_no_hit_elsewhere() {
        // (s - 0.3) (s - 0.3 - gap), then the square alone.
        let pair = |a: f64, b: f64| [a * b, a * b - 0.5 * (a + b), (1.0 - a) * (1.0 - b)];
        for gap in [0.4, 1e-2, 1e-4, 1e-6] {
            let (answer, _) = solve(&pair(0.3, 0.3 + gap), 1e-2);
            assert!(matches!(answer, Solve::Hit(s) if (s - 0.3).abs() <= 1e-2), "gap {gap}: {answer:?}");
        }
        // What double precision cannot tell from a touch is a hit at the touch or given up, never one elsewhere.
        let touch = solve(&[0.25, -0.25, 0.25], 1e-3).0;
        assert!(matches!(touch, Solve::Hit(s) if (s - 0.5).abs() < 1e-7) || touch == Solve::GaveUp, "{touch:?}");
        assert_eq!(solve(&[0.25, -0.2499, 0.25], 1e-3).0, Solve::Miss);
    }
}
