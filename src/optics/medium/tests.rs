//! Distances against closed forms, weights' bounds, and daylight's attenuation by a random walk.

use glam::Vec3;
use proptest::prelude::*;

use super::super::{
    fresnel,
    testing::{Mean, Uniform},
};
use super::*;
use crate::scene::{WaterPreset, diffuse_attenuation};

fn medium(absorption: Vec3, scattering: Vec3) -> Medium {
    Medium { absorption, scattering, phase: Phase::HenyeyGreenstein { g: 0.92 } }
}

fn preset(preset: WaterPreset) -> Medium {
    let values = preset.coefficients().unwrap();
    let water =
        scene::Water { absorption: values.absorption, scattering: values.scattering, ..scene::Water::default() };
    Medium::from_scene(&water)
}

#[test]
fn a_scene_gives_its_coefficients() {
    let clear = Medium::from_scene(&scene::Water::default());
    assert!(!clear.scatters() && clear.extinction() == Vec3::new(0.34, 0.05, 0.009));
    assert_eq!(clear.phase, Phase::HenyeyGreenstein { g: 0.92 });
    let water = scene::Water {
        scattering: [0.1, 0.2, 0.0],
        phase: scene::PhaseKind::TwoLobe,
        asymmetry: 0.8,
        back_asymmetry: -0.3,
        back_share: 0.25,
        ..scene::Water::default()
    };
    let murky = Medium::from_scene(&water);
    assert_eq!(murky.phase, Phase::TwoLobe { forward: 0.8, backward: -0.3, share: 0.25 });
    assert!((murky.extinction() - Vec3::new(0.44, 0.25, 0.009)).abs().max_element() < 1e-7);
    assert!((murky.albedo() - Vec3::new(0.1 / 0.44, 0.8, 0.0)).abs().max_element() < 1e-6);
}

#[test]
fn a_column_that_only_absorbs_is_beer_lambert_without_noise() {
    let clear = medium(Vec3::new(0.34, 0.05, 0.0), Vec3::ZERO);
    for (limit, u) in [(10.0, [0.3, 0.9]), (0.0, [0.9, 0.1]), (f32::INFINITY, [0.5, 0.5])] {
        let Step::Passed { weight } = clear.sample_distance(Vec3::ONE, u, limit) else { panic!("nothing scatters") };
        assert_eq!(weight, clear.transmittance(limit));
    }
    let left = clear.transmittance(10.0);
    assert!((left - Vec3::new((-3.4f32).exp(), (-0.5f32).exp(), 1.0)).abs().max_element() < 1e-6);
}

#[test]
fn what_passes_and_what_scatters_is_what_the_closed_forms_say() {
    let murky = medium(Vec3::new(0.34, 0.05, 0.009), Vec3::new(0.2, 0.0, 0.5));
    for throughput in [Vec3::ONE, Vec3::new(1.0, 0.01, 0.2), Vec3::new(0.0, 0.0, 3.0), Vec3::ZERO] {
        for limit in [0.7f32, 4.0, f32::INFINITY] {
            let mut random = Uniform::new(31);
            let (mut passed, mut scattered, mut far) =
                ([Mean::default(); 3], [Mean::default(); 3], [Mean::default(); 3]);
            for _ in 0..60_000 {
                let step = murky.sample_distance(throughput, random.two(), limit);
                let (through, weight, distance) = match step {
                    Step::Passed { weight } => (weight, Vec3::ZERO, 0.0),
                    Step::Scatter { distance, weight } => (Vec3::ZERO, weight, distance),
                };
                assert!(distance < limit);
                for channel in 0..3 {
                    passed[channel].add(f64::from(through[channel]));
                    scattered[channel].add(f64::from(weight[channel]));
                    far[channel].add(f64::from(weight[channel] * distance));
                }
            }
            for channel in 0..3 {
                // A channel without light may be without density.
                if throughput != Vec3::ZERO && throughput[channel] == 0.0 {
                    continue;
                }
                let (b, c) = (f64::from(murky.scattering[channel]), f64::from(murky.extinction()[channel]));
                let length = f64::from(limit);
                let left = (-c * length).exp();
                let tail = if limit.is_finite() { length * left } else { 0.0 };
                let truths = [left, b / c * (1.0 - left), b / c * ((1.0 - left) / c - tail)];
                for (mean, truth) in [passed[channel], scattered[channel], far[channel]].into_iter().zip(truths) {
                    assert!(
                        mean.agrees(truth, 4.0) || (truth == 0.0 && mean.value() == 0.0),
                        "{throughput} {limit} {channel}: {} +- {} {truth}",
                        mean.value(),
                        mean.error()
                    );
                }
            }
        }
    }
}

#[test]
fn a_clear_channel_reaches_the_end_of_a_world_without_end() {
    let half = medium(Vec3::ZERO, Vec3::new(0.5, 0.0, 0.0));
    let (mut random, mut passed) = (Uniform::new(2), Mean::default());
    for _ in 0..10_000 {
        passed.add(match half.sample_distance(Vec3::ONE, random.two(), f32::INFINITY) {
            Step::Passed { weight } => {
                assert_eq!(weight.x, 0.0);
                f64::from(weight.y)
            }
            Step::Scatter { .. } => 0.0,
        });
    }
    assert!(passed.agrees(1.0, 4.0), "{}", passed.value());
}

#[test]
fn single_scattering_of_a_slab_is_the_analytic_integral() {
    // A slab lit from straight above, seen from above at a slant (Chandrasekhar 1950, chapter III): per unit of irradiance,
    // albedo * phase / (cos + 1) * (1 - exp(-depth (1 + 1 / cos))) by the way down and the way back.
    let murky = medium(Vec3::new(0.3, 0.1, 0.02), Vec3::new(0.2, 0.3, 0.4));
    let (thickness, cosine) = (2.5f32, 0.4f32);
    let phase = murky.phase.value(-cosine);
    let mut random = Uniform::new(6);
    let mut seen = [Mean::default(); 3];
    for _ in 0..60_000 {
        // From the eye: a ray slanted down, a point on it, and the light straight above.
        let light = match murky.sample_distance(Vec3::ONE, random.two(), thickness / cosine) {
            Step::Scatter { distance, weight } => weight * phase * murky.transmittance(distance * cosine),
            Step::Passed { .. } => Vec3::ZERO,
        };
        for channel in 0..3 {
            seen[channel].add(f64::from(light[channel]));
        }
    }
    for channel in 0..3 {
        let (b, c) = (f64::from(murky.scattering[channel]), f64::from(murky.extinction()[channel]));
        let m = f64::from(cosine);
        let truth = b / c * f64::from(phase) / (m + 1.0) * (1.0 - (-c * f64::from(thickness) * (1.0 + 1.0 / m)).exp());
        assert!(
            seen[channel].agrees(truth, 3.5),
            "{channel}: {} +- {} {truth}",
            seen[channel].value(),
            seen[channel].error()
        );
    }
}

/// Rate at which light from straight above dims under a level surface, from there to `depth`, by a random walk.
fn walked_attenuation(grey: Medium, depth: f32) -> f64 {
    const WATER: f32 = 1.333;
    let mut random = Uniform::new(12);
    let (mut top, mut bottom) = (0.0f64, 0.0f64);
    for _ in 0..20_000 {
        let (mut height, mut direction, mut weight) = (0.0f32, -Vec3::Y, 1.0f32);
        top += 1.0;
        while weight > 1e-4 {
            let step = grey.sample_distance(Vec3::ONE, random.two(), f32::INFINITY);
            let Step::Scatter { distance, weight: share } = step else { unreachable!("the water has no end") };
            let next = height + distance * direction.y;
            if next > 0.0 {
                // To the surface, where it leaves or comes back; then a new draw: distances have no memory.
                weight *= fresnel::reflectance_exact(direction.y, WATER, 1.0);
                (height, direction.y) = (0.0, -direction.y);
                top += f64::from(weight);
                continue;
            }
            if height > -depth && next <= -depth {
                bottom += f64::from(weight);
            }
            height = next;
            // Light from far under the plane hardly comes back to it.
            if height < -1.5 * depth {
                break;
            }
            weight *= share.x;
            direction = grey.phase.sample(direction, random.two());
        }
    }
    (top / bottom).ln() / f64::from(depth)
}

#[test]
fn daylight_dims_as_the_tables_say() {
    for (name, channel) in [(WaterPreset::JerlovIii, 1), (WaterPreset::Jerlov5c, 2), (WaterPreset::Harbour, 1)] {
        let water = preset(name);
        let (a, b) = (water.absorption[channel], water.scattering[channel]);
        let grey = medium(Vec3::splat(a), Vec3::splat(b));
        let kirk = diffuse_attenuation(f64::from(a), f64::from(b));
        // To the depth of 1 %.
        let walked = walked_attenuation(grey, (100f64.ln() / kirk) as f32);
        assert!((walked / kirk - 1.0).abs() < 0.05, "{name:?} {channel}: {walked} {kirk}");
        // Neither absorption nor extinction would do.
        assert!(kirk > 1.1 * f64::from(a) && kirk < 0.7 * f64::from(a + b), "{name:?}: {a} {b} {kirk}");
    }
}

proptest! {
    #[test]
    fn weights_are_numbers_and_bounded(
        absorption in prop::array::uniform3(prop_oneof![Just(0.0f32), 0.0f32..2.0, 0.0f32..1e6]),
        scattering in prop::array::uniform3(prop_oneof![Just(0.0f32), 0.0f32..2.0, 0.0f32..1e6]),
        throughput in prop::array::uniform3(prop_oneof![Just(0.0f32), 0.0f32..2.0, 0.0f32..1e-30, 0.0f32..1e30]),
        limit in prop_oneof![Just(0.0f32), Just(f32::INFINITY), 0.0f32..1e3, Just(f32::MAX)],
        u in prop::array::uniform2(prop_oneof![0.0f32..1.0, Just(0.0), Just(1.0 - 0.5 * f32::EPSILON)]),
    ) {
        let murky = medium(Vec3::from_array(absorption), Vec3::from_array(scattering));
        let throughput = Vec3::from_array(throughput);
        let weight = match murky.sample_distance(throughput, u, limit) {
            Step::Passed { weight } => weight,
            Step::Scatter { distance, weight } => {
                prop_assert!(distance.is_finite() && distance >= 0.0 && distance < limit);
                weight
            }
        };
        prop_assert!(weight.is_finite() && weight.min_element() >= 0.0, "{weight}");
        if throughput != Vec3::ZERO {
            let most = throughput.max_element();
            prop_assert!((throughput / most * weight).max_element() <= 2.0 * (throughput / most).element_sum() * 1.001);
        }
    }
}
