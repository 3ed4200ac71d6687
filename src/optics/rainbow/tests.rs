//! The bows where they are seen in the sky, their colours, and where all of the light goes.

use std::sync::LazyLock;

use super::super::luminance;
use super::*;

/// Drops whose radii scatter by a tenth.
static RAINBOW: LazyLock<Rainbow> = LazyLock::new(|| Rainbow::build(0.1));

fn cosine(degrees: f64) -> f32 {
    degrees.to_radians().cos() as f32
}

/// Angle (degrees) between two where something is greatest.
fn brightest([from, to]: [f64; 2], of: impl Fn(f64) -> f32) -> f64 {
    let count = 1000;
    let angle = |index: usize| from + (to - from) * index as f64 / count as f64;
    (0..=count).map(angle).max_by(|&a, &b| of(a).total_cmp(&of(b))).unwrap()
}

#[test]
fn the_integral_over_the_sphere_is_one_in_every_color() {
    let rainbow = &*RAINBOW;
    for radius in [1e-6, 3e-6, 1e-5, 5e-5, 2.3e-4, 1e-3, 4e-3, 0.1] {
        for which in [Rainbow::refracted, Rainbow::scattered] {
            let cells = 200_000;
            let mut whole = DVec3::ZERO;
            for cell in 0..cells {
                let angle = (f64::from(cell) + 0.5) / f64::from(cells) * PI;
                let area = TAU * angle.sin() * PI / f64::from(cells);
                // Single precision of a cosine near 1 is coarse; the table itself is asked by angle.
                whole += which(rainbow, radius, angle.cos() as f32).as_dvec3() * area;
            }
            assert!((whole - 1.0).abs().max_element() < 5e-3, "{radius}: {whole}");
        }
    }
}

#[test]
fn the_first_bow_is_138_degrees_away_red_outside() {
    let rainbow = &*RAINBOW;
    for radius in [6e-4, 1e-3, 2e-3, 1e-2] {
        let at = |angle: f64| rainbow.refracted(radius, cosine(angle));
        let bow = brightest([132.0, 150.0], |angle| luminance(at(angle)));
        assert!((bow - 137.9).abs() < 0.5, "{radius}: {bow}");
        let [red, green, blue] = [0, 1, 2].map(|axis| brightest([132.0, 150.0], |angle| at(angle)[axis]));
        assert!(red < green && green < blue && blue - red > 0.5, "{radius}: {red} {green} {blue}");
    }
}

#[test]
fn the_second_bow_has_its_colors_reversed_and_between_both_it_is_dark() {
    let rainbow = &*RAINBOW;
    let at = |angle: f64| rainbow.refracted(1e-3, cosine(angle));
    let bright = |angle: f64| luminance(at(angle));
    let bow = brightest([120.0, 132.0], bright);
    assert!((bow - 128.6).abs() < 1.0, "{bow}");
    let [red, green, blue] = [0, 1, 2].map(|axis| brightest([120.0, 132.0], |angle| at(angle)[axis]));
    assert!(red > green && green > blue && red - blue > 1.0, "{red} {green} {blue}");
    // Alexander's band: darker than inside of the first bow and outside of the second.
    let band = bright(133.5);
    assert!(band < 0.5 * bright(145.0) && band < 0.8 * bright(123.0), "{band}");
    let first = bright(brightest([132.0, 150.0], bright));
    assert!(bright(bow) < 0.5 * first && band < 0.1 * first, "{} {first}", bright(bow));
}

#[test]
fn a_fog_bow_is_broad_white_and_nearer_to_the_antisolar_point() {
    let rainbow = &*RAINBOW;
    let of = |radius: f32| move |angle: f64| rainbow.refracted(radius, cosine(angle));
    let width = |radius: f32| {
        let at = |angle: f64| luminance(of(radius)(angle));
        let peak = at(brightest([132.0, 155.0], at));
        let count = 4000;
        let above = (0..count).filter(|&k| at(130.0 + 40.0 * f64::from(k) / f64::from(count)) > 0.7 * peak).count();
        40.0 * above as f64 / f64::from(count)
    };
    let at = of(1e-5);
    let bow = brightest([132.0, 155.0], |angle| luminance(at(angle)));
    assert!((142.0..=145.0).contains(&bow), "{bow}");
    assert!(width(1e-5) > 3.0 * width(1e-3), "{} {}", width(1e-5), width(1e-3));
    let colorful = |color: Vec3| (color.max_element() - color.min_element()) / color.max_element();
    let most = |radius: f32| {
        let at = of(radius);
        (0..100).map(|k| colorful(at(137.0 + 0.08 * f64::from(k)))).fold(0.0, f32::max)
    };
    assert!(colorful(at(bow)) < 0.15 && most(1e-5) < 0.5 * most(1e-3), "{} {}", most(1e-5), most(1e-3));
}

#[test]
fn small_drops_have_supernumeraries_that_a_spread_of_sizes_hides() {
    let (one, many) = (Rainbow::build(0.0), Rainbow::build(0.3));
    let ripples = |rainbow: &Rainbow| {
        let at = |k: usize| luminance(rainbow.refracted(1.2e-4, cosine(141.0 + 0.05 * k as f64)));
        (1..200)
            .filter(|&k| at(k) > at(k - 1) && at(k) > 1.001 * at(k + 1).min(at(k - 1)) && at(k) >= at(k + 1))
            .count()
    };
    assert!(ripples(&one) > ripples(&many), "{} {}", ripples(&one), ripples(&many));
}

#[test]
fn light_that_is_diffracted_goes_on_within_a_cone_that_narrows_with_the_drop() {
    let rainbow = Rainbow::build(0.0);
    let forward = |radius: f32| rainbow.scattered(radius, 1.0).y;
    assert!(forward(1e-4) > 10.0 * forward(1e-5));
    // No narrower than the sun: half of all light in the disc's own solid angle, and no more.
    let disc = PI * f64::from(SUN_ANGULAR_RADIUS).powi(2);
    assert!((f64::from(forward(5e-3)) * disc / 0.5 - 1.0).abs() < 0.2, "{}", f64::from(forward(5e-3)) * disc);
    // Alexander's band is what the drop's face mirrors: Fresnel's reflectance at half the angle left, over 4 pi.
    let mirrored = {
        let outside = 0.5 * (180.0_f64 - 133.5).to_radians();
        let inside = (outside.sin() / 1.334).asin();
        let squared = |a: f64, b: f64| ((a - b) / (a + b)).powi(2);
        let across = squared(outside.cos(), 1.334 * inside.cos());
        0.5 * (across + squared(1.334 * outside.cos(), inside.cos())) / (4.0 * PI)
    };
    let band = f64::from(rainbow.refracted(5e-3, cosine(133.5)).y);
    assert!((0.9..1.3).contains(&(band / mirrored)), "{band} {mirrored}");
    // Seen from the side a large drop is what geometric optics says.
    let (all, own) = (rainbow.scattered(1e-3, cosine(60.0)), rainbow.refracted(1e-3, cosine(60.0)));
    assert!((all / (0.5 * own) - 1.0).abs().max_element() < 1e-2, "{all} {own}");
}
