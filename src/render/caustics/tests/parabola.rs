//! The caustic under a parabolic crest, y = -b x², which order 3 holds exactly: counts of solutions, folds, profile and
//! energy under a sun of 0.533 degrees against the one-dimensional closed form.
//!
//! *The closed form.* Light along -w through (x, S(x)) with the normal N = (-S', 1, 0) goes on along the refracted d, in
//! closed form, to X(x) = x + (S + D) d_x / -d_y on the bed at -D. All is the same along z. The sun's irradiance on the
//! bed is the flux N·w T dx over the width dX that it lands on: E(X) = Σ T N·w / |dX/dx| over all x with X(x) = X. Folds
//! are where dX/dx = 0, and between them X is monotone, so that bisection finds each x.

use glam::{DVec3, Vec3};

use super::{super::*, WATER, connect, surface};
use crate::optics::fresnel::reflectance_exact;

/// Curvature of the crest is 2 b.
const B: f64 = 0.8;
/// Half width (m) of the water that is looked at; the parabola ends past it.
const REACH: f64 = 1.45;
/// The sun's angular radius.
const SUN: f64 = 0.5 * 0.533 * std::f64::consts::PI / 180.0;

fn crest() -> Manifold {
    let width = 0.05;
    // The control heights of x² lie h²/4 under it.
    Manifold::new(&surface(3, [61, 9], [width, 0.4], |x, _| -B * (x * x - 0.25 * width * width)))
}

fn height(x: f64) -> f64 {
    -B * x * x
}

/// The refracted direction at x.
fn refracted(w: DVec3, x: f64) -> DVec3 {
    let ratio = 1.0 / f64::from(WATER);
    let normal = DVec3::new(2.0 * B * x, 1.0, 0.0).normalize();
    let cosine = w.dot(normal);
    let inside = (1.0 - ratio * ratio * (1.0 - cosine * cosine)).sqrt();
    -ratio * w + (ratio * cosine - inside) * normal
}

/// Where the light through x lands.
fn landing(w: DVec3, depth: f64, x: f64) -> f64 {
    let d = refracted(w, x);
    x - (height(x) + depth) * d.x / d.y
}

/// dX/dx, by differences of the closed form: to 1e-9.
fn stretch(w: DVec3, depth: f64, x: f64) -> f64 {
    let step = 1e-5;
    (landing(w, depth, x + step) - landing(w, depth, x - step)) / (2.0 * step)
}

fn bisect(mut low: f64, mut high: f64, f: impl Fn(f64) -> f64) -> f64 {
    let sign = f(low) > 0.0;
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if (f(middle) > 0.0) == sign { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

/// Places where X turns back.
fn folds(w: DVec3, depth: f64) -> Vec<f64> {
    let steps = 1000;
    let at = |k: usize| REACH * (2.0 * k as f64 / steps as f64 - 1.0);
    (0..steps)
        .filter(|&k| (stretch(w, depth, at(k)) > 0.0) != (stretch(w, depth, at(k + 1)) > 0.0))
        .map(|k| bisect(at(k), at(k + 1), |x| stretch(w, depth, x)))
        .collect()
}

/// Flux per metre of surface.
fn flux(w: DVec3, x: f64) -> f64 {
    let normal = DVec3::new(2.0 * B * x, 1.0, 0.0);
    let cosine = normal.dot(w) / normal.length();
    (1.0 - f64::from(reflectance_exact(cosine as f32, 1.0, WATER))) * normal.dot(w)
}

/// Places that send light to X: one per monotone stretch that reaches it.
fn sources(w: DVec3, depth: f64, folds: &[f64], to: f64) -> Vec<f64> {
    let mut ends = vec![-REACH];
    ends.extend_from_slice(folds);
    ends.push(REACH);
    let off = |x: f64| landing(w, depth, x) - to;
    ends.windows(2)
        .filter(|pair| (off(pair[0]) > 0.0) != (off(pair[1]) > 0.0))
        .map(|pair| bisect(pair[0], pair[1], off))
        .collect()
}

/// Irradiance at X by the manifold, from a sun of irradiance 1 all in the direction w.
fn irradiance(manifold: &Manifold, w: DVec3, depth: f64, to: f64, doubts: &mut u64) -> f64 {
    let from = Vec3::new(to as f32, -depth as f32, 0.0);
    let (found, counts) = connect(manifold, from, Event::Refraction, Target::Direction(w.as_vec3()), [0.0; 2]);
    *doubts += counts.gave_up;
    let n2 = WATER * WATER;
    found
        .iter()
        .map(|c| {
            let through = 1.0 - reflectance_exact(c.to_light.dot(c.facet), 1.0, WATER);
            f64::from(through * n2 * c.direction.y * c.spread)
        })
        .sum()
}

/// Directions of the sun's disc with weights that sum to one: exact for smooth functions of the angle across the crest
/// (Gauss and Chebyshev's second kind, whose weight is the disc's chord), two points along it.
fn disc(count: usize) -> Vec<(DVec3, f64)> {
    (1..=count)
        .flat_map(|k| {
            let angle = k as f64 * std::f64::consts::PI / (count as f64 + 1.0);
            let (t, chord) = (angle.cos(), angle.sin());
            let weight = chord * chord / (count as f64 + 1.0);
            [-1.0, 1.0].map(|side| (DVec3::new(SUN * t, 1.0, side * SUN * chord / 3f64.sqrt()).normalize(), weight))
        })
        .collect()
}

#[test]
fn one_solution_above_the_cusp_and_three_between_the_folds() {
    let manifold = crest();
    // Rays by the crest meet at n / ((n - 1) 2 b) = 2.50 m.
    assert!(folds(DVec3::Y, 2.45).is_empty());
    for depth in [1.0, 2.0, 2.45, 2.7, 3.2, 4.0] {
        let folds = folds(DVec3::Y, depth);
        assert_eq!(folds.len(), if depth < 2.5 { 0 } else { 2 });
        for k in -50..=50 {
            let to = 0.004 * f64::from(k);
            let expected = sources(DVec3::Y, depth, &folds, to);
            let from = Vec3::new(to as f32, -depth as f32, 0.0);
            let (found, counts) = connect(&manifold, from, Event::Refraction, Target::Direction(Vec3::Y), [0.0; 2]);
            assert_eq!((found.len(), counts.gave_up), (expected.len(), 0), "{depth} m down, {to} m out");
            for x in expected {
                assert!(found.iter().any(|c| (f64::from(c.surface.x) - x).abs() < 3e-6), "{depth} {to}: {x} {found:?}");
            }
        }
    }
}

#[test]
fn folds_lie_where_the_closed_form_turns_back() {
    let manifold = crest();
    for depth in [2.6, 2.8, 3.2, 3.6, 4.0] {
        for fold in folds(DVec3::Y, depth) {
            let edge = landing(DVec3::Y, depth, fold);
            let count = |to: f64| {
                let from = Vec3::new(to as f32, -depth as f32, 0.0);
                connect(&manifold, from, Event::Refraction, Target::Direction(Vec3::Y), [0.0; 2]).0.len()
            };
            // Where the manifold's count falls from three to one.
            let measured = bisect(0.9 * edge, 1.1 * edge, |to| count(to) as f64 - 2.0);
            let off = (measured - edge).abs();
            eprintln!("depth {depth}: fold at {edge:.7} m, off by {off:.1e} m");
            assert_eq!((count(0.9 * edge), count(1.1 * edge)), (3, 1));
            // Single precision's spacing at the bed.
            assert!(off < 1e-6, "depth {depth}: {measured} for {edge}");
        }
    }
}

#[test]
fn profile_under_a_sun_of_half_a_degree_is_the_closed_forms() {
    let manifold = crest();
    let disc = disc(48);
    for depth in [2.0, 3.2] {
        let branches: Vec<_> = disc.iter().map(|&(w, _)| folds(w, depth)).collect();
        let (mut worst, mut brightest, mut doubts) = (0.0f64, 0.0f64, 0);
        for k in -40..=40 {
            // Off any lattice of the directions' folds.
            let to = 0.003_17 * f64::from(k) + 0.000_123;
            let (mut expected, mut found) = (0.0, 0.0);
            for (&(w, weight), folds) in disc.iter().zip(&branches) {
                for x in sources(w, depth, folds, to) {
                    expected += weight * flux(w, x) / stretch(w, depth, x).abs();
                }
                found += weight * irradiance(&manifold, w, depth, to, &mut doubts);
            }
            worst = worst.max((found / expected - 1.0).abs());
            brightest = brightest.max(found);
        }
        eprintln!("depth {depth}: profile off by {worst:.1e} at most, brightest {brightest:.2} suns");
        assert_eq!(doubts, 0);
        assert!(worst < 0.01, "depth {depth}: off by {worst}");
    }
}

#[test]
fn energy_under_the_crest_is_what_its_water_lets_in() {
    let manifold = crest();
    let disc = disc(24);
    let (depth, half) = (3.2, 0.3);
    let (mut arrived, mut expected, mut doubts) = (0.0, 0.0, 0);
    for &(w, weight) in &disc {
        // From fold to fold, in the angle whose cosine the place is: that takes the folds' square roots away, and the
        // midpoint rule is then exact to many digits.
        let mut ends: Vec<f64> = folds(w, depth).into_iter().map(|x| landing(w, depth, x)).collect();
        ends.extend([-half, half]);
        ends.retain(|end| end.abs() <= half);
        ends.sort_by(f64::total_cmp);
        let steps = 32;
        for pair in ends.windows(2) {
            let (middle, reach) = (0.5 * (pair[0] + pair[1]), 0.5 * (pair[1] - pair[0]));
            for k in 0..steps {
                let angle = (f64::from(k) + 0.5) * std::f64::consts::PI / f64::from(steps);
                let width = reach * angle.sin() * std::f64::consts::PI / f64::from(steps);
                arrived += weight * width * irradiance(&manifold, w, depth, middle - reach * angle.cos(), &mut doubts);
            }
        }
        // Flux through the water whose light lands there, forward: no root is looked for.
        let parts = 20_000;
        for k in 0..parts {
            let x = REACH * (2.0 * (f64::from(k) + 0.5) / f64::from(parts) - 1.0);
            if landing(w, depth, x).abs() < half {
                expected += weight * flux(w, x) * 2.0 * REACH / f64::from(parts);
            }
        }
    }
    let off = arrived / expected - 1.0;
    eprintln!("energy {arrived:.5} W/m for {expected:.5}: {off:.1e}, {doubts} given up");
    // What is left: the forward sum's ends, a step of 1.5e-4 m in 2 m, and single precision beside the folds.
    assert!(off.abs() < 1e-3, "{arrived} for {expected}");
}
