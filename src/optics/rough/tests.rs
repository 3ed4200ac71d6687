//! Densities against integrals, weights against evaluations, energy, the limit of smoothness, and hostile input.

use std::f32::consts::PI;

use glam::{DVec3, Vec3};
use proptest::prelude::*;

use super::super::testing::{Mean, Uniform, directions, unit};
use super::*;

const WATER: f32 = 1.333;

fn water(alpha: f32) -> Interface {
    Interface { alpha, ior: WATER }
}

/// Unit normal of a facet of these slopes on a surface of this normal.
fn tilt(normal: Vec3, slopes: [f32; 2]) -> Vec3 {
    let (across, along) = normal.any_orthonormal_pair();
    (normal + slopes[0] * across + slopes[1] * along).normalize()
}

/// Share of drawn facets whose bounce comes to nothing, by kind.
fn lost(interface: Interface, eye: Vec3, from_water: bool) -> [f64; 2] {
    let side = 400;
    let mut lost = [0u32; 2];
    for i in 0..side {
        for j in 0..side {
            let u = [(i as f32 + 0.5) / side as f32, (j as f32 + 0.5) / side as f32];
            let facet = interface.facet(Vec3::Y, eye, u);
            lost[0] += u32::from(interface.reflect(Vec3::Y, eye, facet).is_none());
            lost[1] += u32::from(interface.refract(Vec3::Y, eye, facet, from_water).is_none());
        }
    }
    lost.map(|count| f64::from(count) / f64::from(side * side))
}

#[test]
fn densities_add_up_to_one_but_for_what_is_lost() {
    for from_water in [false, true] {
        for alpha in [0.1, 0.3, 0.8] {
            for cosine in [1.0, 0.7, 0.3, 0.1] {
                let (interface, eye) = (water(alpha), unit(cosine, 0.4));
                let count = 200_000;
                let mut sums = [0.0; 2];
                for light in directions(count) {
                    sums[0] += f64::from(interface.evaluate_reflection(Vec3::Y, eye, light).pdf);
                    sums[1] += f64::from(interface.evaluate_refraction(Vec3::Y, eye, light, from_water).pdf);
                }
                let lost = lost(interface, eye, from_water);
                for kind in 0..2 {
                    let total = sums[kind] * 4.0 * std::f64::consts::PI / count as f64 + lost[kind];
                    assert!(
                        (total - 1.0).abs() < 5e-3,
                        "alpha {alpha}, cosine {cosine}, from water {from_water}, kind {kind}: {total} (lost {lost:?})"
                    );
                }
            }
        }
    }
}

#[test]
fn a_bounce_is_what_its_evaluation_says() {
    let mut random = Uniform::new(5);
    let mut compared = [0; 2];
    for alpha in [1e-3, 0.03, 0.3, 1.0] {
        // What rounding of the directions does to the facet, raised to the power by which D falls in its tails.
        let allowed = 1e-3 + 4.0 * 7.0 * f32::EPSILON / alpha;
        for from_water in [false, true] {
            for _ in 0..5000 {
                let normal = unit(2.0 * random.one() - 1.0, 6.3 * random.one());
                let eye = (normal + 0.99 * unit(2.0 * random.one() - 1.0, 6.3 * random.one())).normalize();
                let interface = water(alpha);
                let facet = interface.facet(normal, eye, random.two());
                assert!((facet.length() - 1.0).abs() < 1e-6 && facet.dot(normal) >= 0.0);
                // Near grazing the facet's own cosine is made of rounding.
                if eye.dot(normal) < 0.05 || facet.dot(eye) < 0.05 {
                    continue;
                }
                let reflected = interface.reflect(normal, eye, facet);
                let refracted = interface.refract(normal, eye, facet, from_water);
                if let Some(bounce) = reflected {
                    let evaluation = interface.evaluate_reflection(normal, eye, bounce.direction);
                    assert!((evaluation.pdf / bounce.pdf - 1.0).abs() < allowed, "{bounce:?} {evaluation:?}");
                    assert!((evaluation.value / evaluation.pdf / bounce.weight - 1.0).abs() < 1e-3);
                    assert!((evaluation.cosine - facet.dot(eye)).abs() < 1e-4);
                    compared[0] += 1;
                }
                if let Some(bounce) = refracted {
                    let evaluation = interface.evaluate_refraction(normal, eye, bounce.direction, from_water);
                    // Where light leaves along the facet, Snell's law itself amplifies the rounding.
                    if -bounce.direction.dot(facet) > 0.1 && -bounce.direction.dot(normal) > 0.1 {
                        assert!(
                            (evaluation.pdf / bounce.pdf - 1.0).abs() < 10.0 * allowed,
                            "{bounce:?} {evaluation:?} {alpha}"
                        );
                        assert!((evaluation.value / evaluation.pdf / bounce.weight - 1.0).abs() < 1e-2);
                        compared[1] += 1;
                    }
                }
            }
        }
    }
    assert!(compared.iter().all(|&count| count > 15_000), "{compared:?}");
}

/// Light that comes back from a uniform surrounding of radiance 1, both sides, radiance's n^2 taken out.
fn furnace(interface: Interface, eye: Vec3, from_water: bool) -> Mean {
    let mut random = Uniform::new(17);
    let mut mean = Mean::default();
    for _ in 0..20_000 {
        let facet = interface.facet(Vec3::Y, eye, random.two());
        let (from, to) = if from_water { (WATER, 1.0) } else { (1.0, WATER) };
        let share = fresnel::reflectance_exact(facet.dot(eye), from, to);
        let reflected = interface.reflect(Vec3::Y, eye, facet).map_or(0.0, |bounce| bounce.weight * share);
        let refracted =
            interface.refract(Vec3::Y, eye, facet, from_water).map_or(0.0, |bounce| bounce.weight * (1.0 - share));
        mean.add(f64::from(reflected + refracted));
    }
    mean
}

#[test]
fn a_white_furnace_comes_back_nearly_whole_and_never_more() {
    for from_water in [false, true] {
        for alpha in [0.0, 0.01, 0.03, 0.1, 0.2, 0.3] {
            for cosine in [1.0, 0.8, 0.6, 0.4, 0.3, 0.1, 0.02] {
                let energy = furnace(water(alpha), unit(cosine, 1.0), from_water).value();
                assert!(energy <= 1.0 + 1e-6, "{alpha} {cosine} {from_water}: {energy}");
                // What is missing are further bounces among facets, which are not followed: steep ones, seen flat, send light
                // down again, and in water steep ones mirror all of it, through their neighbours.
                let least = match (from_water, alpha, cosine) {
                    (_, ..=0.03, 0.3..) => 0.99,
                    (false, ..=0.1, 0.3..) => 0.97,
                    (false, ..=0.2, 0.6..) => 0.98,
                    (false, _, 0.6..) => 0.96,
                    (false, _, _) => 0.89,
                    (true, ..=0.1, 0.6..) => 0.96,
                    (true, ..=0.2, 0.8..) => 0.93,
                    (true, _, _) => 0.72,
                };
                assert!(energy >= least, "{alpha} {cosine} {from_water}: {energy} under {least}");
            }
        }
    }
}

#[test]
fn the_furnace_is_the_integral_of_evaluations() {
    // The same energy without any drawing: value and Fresnel over all directions.
    for from_water in [false, true] {
        for (alpha, cosine) in [(0.2, 0.8), (0.3, 0.4)] {
            let (interface, eye) = (water(alpha), unit(cosine, 1.0));
            let (from, to) = if from_water { (WATER, 1.0) } else { (1.0, WATER) };
            let count = 200_000;
            let mut sum = 0.0;
            for light in directions(count) {
                let up = interface.evaluate_reflection(Vec3::Y, eye, light);
                let down = interface.evaluate_refraction(Vec3::Y, eye, light, from_water);
                sum += f64::from(up.value * fresnel::reflectance_exact(up.cosine, from, to));
                sum += f64::from(down.value * (1.0 - fresnel::reflectance_exact(down.cosine, from, to)));
            }
            let energy = sum * 4.0 * std::f64::consts::PI / count as f64;
            let drawn = furnace(interface, eye, from_water);
            assert!(
                (energy - drawn.value()).abs() < 3.0 * drawn.error() + 3e-3,
                "{alpha} {from_water}: {energy} {drawn:?}"
            );
        }
    }
}

#[test]
fn light_and_eye_may_change_places() {
    let mut random = Uniform::new(3);
    let mut met = [0; 2];
    for _ in 0..20_000 {
        let interface = water(0.02 + random.one());
        let (eye, light) =
            (unit(0.05 + 0.95 * random.one(), 6.3 * random.one()), unit(0.05 + 0.95 * random.one(), 1.0));
        let there = interface.evaluate_reflection(Vec3::Y, eye, light).value * eye.y;
        let back = interface.evaluate_reflection(Vec3::Y, light, eye).value * light.y;
        assert!((there - back).abs() <= 2e-3 * there.max(1e-6), "{there} {back}");
        met[0] += 1;
        // Through the border the values differ by the squares of the indices (Veach 1997, eq. 5.14).
        let light = -light;
        let there = interface.evaluate_refraction(Vec3::Y, eye, light, false);
        let back = interface.evaluate_refraction(-Vec3::Y, light, eye, true);
        let (a, b) = (there.value * eye.y / (WATER * WATER), back.value * -light.y);
        assert!((a - b).abs() <= 1e-2 * a.max(1e-6), "{a} {b}");
        met[1] += u32::from(there.value > 0.0);
        // The facet's cosine beyond is the other one's before it: Fresnel agrees as well.
        if there.value > 0.0 && there.cosine > 0.05 && back.cosine > 0.05 {
            let (one, two) = (
                fresnel::reflectance_exact(there.cosine, 1.0, WATER),
                fresnel::reflectance_exact(back.cosine, WATER, 1.0),
            );
            assert!((one - two).abs() < 1e-3, "{one} {two}");
        }
    }
    assert!(met[1] > 3000, "{met:?}");
}

#[test]
fn the_smoother_the_nearer_to_a_mirror() {
    let (eye, normal) = (unit(0.6, 0.3), Vec3::Y);
    let smooth = water(0.0);
    assert!(smooth.is_smooth() && smooth.facet(normal, eye, [0.3, 0.9]) == normal);
    let mirrored = smooth.reflect(normal, eye, normal).unwrap();
    let bent = smooth.refract(normal, eye, normal, false).unwrap();
    assert_eq!((mirrored.weight, bent.weight, mirrored.pdf), (1.0, 1.0, f32::INFINITY));
    assert!((mirrored.direction - Vec3::new(-eye.x, eye.y, -eye.z)).length() < 1e-6);
    assert_eq!(Some(bent.direction), fresnel::refract(-eye, normal, 1.0, WATER));
    assert_eq!(smooth.evaluate_reflection(normal, eye, mirrored.direction), Evaluation::default());
    assert_eq!(smooth.evaluate_refraction(normal, eye, bent.direction, false), Evaluation::default());
    for alpha in [1e-4, 1e-3, 1e-2] {
        let rough = water(alpha);
        assert!(!rough.is_smooth());
        let (mut far, mut off) = (0, 0.0f32);
        let mut random = Uniform::new(1);
        for _ in 0..2000 {
            let facet = rough.facet(normal, eye, random.two());
            let one = rough.reflect(normal, eye, facet).unwrap();
            let two = rough.refract(normal, eye, facet, false).unwrap();
            far += u32::from((one.direction - mirrored.direction).length() > 20.0 * alpha);
            far += u32::from((two.direction - bent.direction).length() > 20.0 * alpha);
            off = off.max(1.0 - one.weight).max(1.0 - two.weight);
        }
        // P(slope > 10 alpha) is 1 %.
        assert!(far < 60, "{alpha}: {far}");
        assert!(off < 3.0 * alpha, "{alpha}: weights down to 1 - {off}");
    }
    // No bending, no lobe; and what is no number is no lobe either.
    assert!(Interface { alpha: 0.5, ior: 1.0 }.is_smooth());
    assert!(water(f32::NAN).is_smooth());
    let scene_water = |roughness| Interface::from_scene(&crate::scene::Water { roughness, ..Default::default() });
    assert!(scene_water(0.0).is_smooth() && scene_water(0.03) == water(0.03));
    let nothing = Interface { alpha: 0.5, ior: 1.0 };
    assert!((nothing.refract(normal, eye, normal, true).unwrap().direction + eye).length() < 1e-6);
}

#[test]
fn beyond_the_critical_angle_all_is_mirrored() {
    let eye = unit(0.5, 0.0);
    assert!(water(0.0).refract(Vec3::Y, eye, Vec3::Y, true).is_none());
    assert!(water(0.0).reflect(Vec3::Y, eye, Vec3::Y).is_some());
}

#[test]
fn slopes_follow_their_distribution() {
    for alpha in [0.05f32, 0.4] {
        let interface = water(alpha);
        let mut random = Uniform::new(8);
        // Against D by the integral of a bump over solid angle.
        let bump = |facet: Vec3| f64::from((facet.dot(Vec3::Y) - 0.9).max(0.0)) * f64::from(1.0 + 0.5 * facet.x);
        let (mut drawn, mut median) = (Mean::default(), Mean::default());
        for _ in 0..200_000 {
            let (slopes, weight) = interface.slopes(random.two());
            let facet = tilt(Vec3::Y, slopes);
            assert!((weight - 1.0 / facet.y).abs() < 1e-4 * weight, "{weight} {facet}");
            drawn.add(bump(facet) * f64::from(weight));
            // Half of the facets are flatter than alpha.
            median.add(f64::from(u8::from(slopes[0].hypot(slopes[1]) < alpha)));
        }
        let mut integral = 0.0;
        let rings = 4000;
        for ring in 0..rings {
            let cosine = 0.9 + 0.1 * (f64::from(ring) + 0.5) / f64::from(rings);
            let (a2, c2) = (f64::from(alpha).powi(2), cosine * cosine);
            let d = a2 / (std::f64::consts::PI * (c2 * a2 + 1.0 - c2).powi(2));
            integral += d * (cosine - 0.9) * 0.1 / f64::from(rings) * std::f64::consts::TAU;
        }
        assert!(drawn.agrees(integral, 3.5), "{alpha}: {} {integral} {}", drawn.value(), drawn.error());
        assert!(median.agrees(0.5, 3.5), "{alpha}: {}", median.value());
    }
    assert_eq!(water(0.0).slopes([0.2, 0.7]), ([0.0; 2], 1.0));
}

#[test]
fn the_mean_facet_stands_on_the_seen_side() {
    // A plane's projected area is its facets': the integral of D max(0, facet . eye) is cos(eye) / G1.
    for (alpha, cosine) in [(0.3f32, 0.2f32), (0.1, 0.9), (1.0, 0.5)] {
        let (interface, eye) = (water(alpha), unit(cosine, 2.0));
        let mut sum = DVec3::ZERO;
        let count = 300_000;
        for facet in directions(count).filter(|facet| facet.y > 0.0) {
            let seen = facet.dot(eye).max(0.0);
            sum += facet.as_dvec3() * f64::from(interface.visible(Vec3::Y, cosine, facet) * seen);
        }
        let expected = sum * f64::from(4.0 * PI) / count as f64;
        let (mut random, mut drawn) = (Uniform::new(4), DVec3::ZERO);
        let draws = 100_000;
        for _ in 0..draws {
            drawn += interface.facet(Vec3::Y, eye, random.two()).as_dvec3() / f64::from(draws);
        }
        assert!((expected - drawn).length() < 6e-3, "{alpha} {cosine}: {expected} {drawn}");
    }
}

fn any_unit() -> impl Strategy<Value = Vec3> {
    (-1.0f32..=1.0, 0.0f32..6.3).prop_map(|(cosine, azimuth)| unit(cosine, azimuth).normalize())
}

/// From level with the surface to straight above it, often within rounding of either; a little below as well.
fn any_eye() -> impl Strategy<Value = f32> {
    prop_oneof![-1e-6f32..=1.0, Just(0.0), Just(1.0), -1e-7f32..1e-6, -0.3f32..0.0, (1.0f32 - 1e-6)..=1.0]
}

fn any_share() -> impl Strategy<Value = f32> {
    prop_oneof![0.0f32..1.0, Just(0.0), Just(1.0 - 0.5 * f32::EPSILON), 0.0f32..1e-6]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(4000))]

    #[test]
    fn no_input_gives_anything_but_numbers(
        normal in any_unit(), cosine in any_eye(), azimuth in 0.0f32..6.3, light in any_unit(),
        alpha in prop_oneof![0.0f32..=1.0, Just(0.0), 0.0f32..1e-3, Just(1.0)],
        ior in prop_oneof![1.0f32..=4.0, Just(1.0), 1.0f32..1.00001],
        u in (any_share(), any_share()), from_water in any::<bool>(),
    ) {
        let interface = Interface { alpha, ior };
        let eye = (glam::Quat::from_rotation_arc(Vec3::Y, normal) * unit(cosine, azimuth)).normalize();
        let facet = interface.facet(normal, eye, [u.0, u.1]);
        prop_assert!((facet.length() - 1.0).abs() < 1e-5 && facet.dot(normal) >= -1e-6, "{facet}");
        for (bounce, side) in [
            (interface.reflect(normal, eye, facet), 1.0),
            (interface.refract(normal, eye, facet, from_water), -1.0),
        ] {
            let Some(bounce) = bounce else { continue };
            prop_assert!((bounce.direction.length() - 1.0).abs() < 1e-5);
            prop_assert!(side * bounce.direction.dot(normal) > 0.0);
            prop_assert!((0.0..=1.0).contains(&bounce.weight), "{bounce:?}");
            prop_assert!(bounce.pdf > 0.0 && (interface.is_smooth() || bounce.pdf.is_finite()), "{bounce:?}");
        }
        for evaluation in [
            interface.evaluate_reflection(normal, eye, light),
            interface.evaluate_refraction(normal, eye, light, from_water),
            interface.evaluate_refraction(normal, eye, -eye, from_water),
            interface.evaluate_reflection(normal, eye, -eye),
            interface.evaluate_reflection(normal, normal, normal),
        ] {
            prop_assert!(evaluation.value.is_finite() && evaluation.value >= 0.0, "{evaluation:?}");
            prop_assert!(evaluation.pdf.is_finite() && evaluation.pdf >= 0.0, "{evaluation:?}");
            prop_assert!((0.0..=1.0).contains(&evaluation.cosine), "{evaluation:?}");
        }
        let (slopes, weight) = interface.slopes([u.0, u.1]);
        prop_assert!(weight >= 1.0 && weight.is_finite() && slopes.iter().all(|slope| slope.is_finite()));
        prop_assert!((tilt(normal, slopes).length() - 1.0).abs() < 1e-5);
    }
}
