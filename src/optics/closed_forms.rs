//! What the parts of this room say together, against textbook results. A part's own closed forms stand beside it.

use glam::Vec3;

use super::testing::{Mean, Uniform, unit};
use super::{Interface, Medium, Phase, fresnel};

const WATER: f32 = 1.333;

/// Shares of light that a slab of water, level and smooth on both sides, sends back and lets through: every path followed
/// by the interface's own bounces until what is left of it would not be seen.
fn slab(cosine: f32, medium: Medium, thickness: f32) -> [Vec3; 2] {
    let interface = Interface { alpha: 0.0, ior: WATER };
    let mut sums = [Vec3::ZERO; 2];
    // Where the light came from as seen from its point, whether that is in water, whether the point is the lower side.
    let mut paths = vec![(unit(cosine, 0.3), false, false, Vec3::ONE)];
    while let Some((back, in_water, below, weight)) = paths.pop() {
        let normal = if in_water == below { Vec3::Y } else { -Vec3::Y };
        let facet = interface.facet(normal, back, [0.5, 0.5]);
        let (from, to) = if in_water { (WATER, 1.0) } else { (1.0, WATER) };
        let share = fresnel::reflectance_exact(back.dot(facet), from, to);
        let mirrored = interface.reflect(normal, back, facet).map(|bounce| (bounce, share, in_water));
        let bent = interface.refract(normal, back, facet, in_water).map(|bounce| (bounce, 1.0 - share, !in_water));
        for (bounce, share, inside) in [mirrored, bent].into_iter().flatten() {
            let carried = weight * share * bounce.weight;
            if !inside {
                sums[usize::from(bounce.direction.y < 0.0)] += carried;
            } else if carried.max_element() > 1e-9 {
                let left = medium.transmittance(thickness / bounce.direction.y.abs());
                paths.push((-bounce.direction, true, bounce.direction.y < 0.0, carried * left));
            }
        }
    }
    sums
}

#[test]
fn a_slab_of_two_interfaces_is_the_sum_of_its_series() {
    let clear = Medium { absorption: Vec3::ZERO, scattering: Vec3::ZERO, phase: Phase::PureWater };
    let tinted = Medium { absorption: Vec3::new(0.34, 0.05, 0.0), ..clear };
    for cosine in [1.0f32, 0.7, 0.3, 0.1] {
        for (medium, thickness) in [(clear, 1.0f32), (tinted, 0.5), (tinted, 8.0)] {
            let [back, through] = slab(cosine, medium, thickness);
            let below = (1.0 - (1.0 - cosine * cosine) / (WATER * WATER)).sqrt();
            let r = f64::from(fresnel::reflectance_exact(cosine, 1.0, WATER));
            for channel in 0..3 {
                // Incoherent series (Born and Wolf 1.6.4, intensities): T = (1 - r)^2 t / (1 - r^2 t^2), R = r + r t T.
                let t = (-f64::from(medium.absorption[channel] * thickness / below)).exp();
                let passed = (1.0 - r).powi(2) * t / (1.0 - r * r * t * t);
                let returned = r + r * t * passed;
                assert!((f64::from(through[channel]) - passed).abs() < 1e-5, "{cosine} {channel}: {through} {passed}");
                assert!((f64::from(back[channel]) - returned).abs() < 1e-5, "{cosine} {channel}: {back} {returned}");
            }
        }
        // Without absorption: R = 2 r / (1 + r), and nothing is lost.
        let [back, through] = slab(cosine, clear, 1.0);
        let r = fresnel::reflectance_exact(cosine, 1.0, WATER);
        assert!((back.x - 2.0 * r / (1.0 + r)).abs() < 1e-5 && (back.x + through.x - 1.0).abs() < 1e-5, "{cosine}");
    }
}

/// Mean reflectance of a level surface for uniform light from the air: 2 times the integral of R(m) m over m.
fn diffuse_reflectance() -> f64 {
    let steps = 20_000;
    (0..steps)
        .map(|step| {
            let cosine = (f64::from(step) + 0.5) / f64::from(steps);
            2.0 * cosine * f64::from(fresnel::reflectance_exact(cosine as f32, 1.0, WATER)) / f64::from(steps)
        })
        .sum()
}

#[test]
fn under_a_flat_surface_a_uniform_sky_gives_what_is_not_reflected() {
    // Walsh's closed form (J. Walsh, The reflection factor of a polished glass surface for diffused light, 1926).
    let n = f64::from(WATER);
    let (n2, sum) = (n * n, n + 1.0);
    let walsh = 0.5
        + (n - 1.0) * (3.0 * n + 1.0) / (6.0 * sum * sum)
        + n2 * (n2 - 1.0).powi(2) / (n2 + 1.0).powi(3) * ((n - 1.0) / sum).ln()
        - 2.0 * n2 * n * (n2 + 2.0 * n - 1.0) / ((n2 + 1.0) * (n2 * n2 - 1.0))
        + 8.0 * n2 * n2 * (n2 * n2 + 1.0) / ((n2 + 1.0) * (n2 * n2 - 1.0).powi(2)) * n.ln();
    assert!((diffuse_reflectance() - walsh).abs() < 1e-5, "{} {walsh}", diffuse_reflectance());
    assert!((walsh - 0.0665).abs() < 1e-3);
    // From below, along refracted rays: radiance n^2 in Snell's window, mirrored darkness around it.
    for (alpha, allowed) in [(0.0, 0.0), (0.01, 1e-3), (0.05, 8e-3)] {
        let interface = Interface { alpha, ior: WATER };
        let (mut random, mut lit) = (Uniform::new(40), Mean::default());
        for _ in 0..100_000 {
            // Drawn by the cosine: each counts pi.
            let [u, v] = random.two();
            let eye = unit((1.0 - u).sqrt(), std::f32::consts::TAU * v);
            let facet = interface.facet(Vec3::Y, eye, random.two());
            // The eye looks up from under the surface: all upside down.
            let radiance = match interface.refract(Vec3::Y, eye, facet, true) {
                Some(bounce) => {
                    let through = 1.0 - fresnel::reflectance_exact(eye.dot(facet), WATER, 1.0);
                    bounce.weight * through * WATER * WATER
                }
                None => 0.0,
            };
            lit.add(std::f64::consts::PI * f64::from(radiance));
        }
        let truth = std::f64::consts::PI * (1.0 - walsh);
        assert!(
            (lit.value() - truth).abs() < 3.5 * lit.error() + allowed * truth,
            "{alpha}: {} +- {} {truth}",
            lit.value(),
            lit.error()
        );
    }
}
