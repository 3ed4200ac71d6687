//! Means over the sun's disc: the same as those of single directions, with far less spread, and no bias where curves end,
//! turn or meet others.

use glam::Vec3;

use super::{super::*, WATER, connect, surface};
use crate::optics::SUN_ANGULAR_RADIUS;

const SUN: Disc = Disc { direction: Vec3::new(0.4, 0.866_025_4, 0.3), radius: SUN_ANGULAR_RADIUS };

/// Waves whose crests focus light some two metres below.
fn waves(order: u32) -> Manifold {
    let wave = |x: f64, z: f64, [kx, kz, length, phase]: [f64; 4]| {
        (std::f64::consts::TAU * (kx * x + kz * z) / length + phase).sin()
    };
    Manifold::new(&surface(order, [128; 2], [0.05; 2], |x, z| {
        0.020 * wave(x, z, [0.8, 0.6, 1.3, 0.0])
            + 0.014 * wave(x, z, [-0.4, 0.9165, 0.83, 1.0])
            + 0.007 * wave(x, z, [0.97, -0.243, 0.47, 2.0])
    }))
}

/// Directions spread evenly over the disc (Fibonacci's spiral).
fn directions(count: usize) -> impl Iterator<Item = Vec3> {
    let sun = SUN.direction.normalize();
    let (across, along) = sun.any_orthonormal_pair();
    (0..count).map(move |k| {
        let radius = SUN.radius * ((k as f32 + 0.5) / count as f32).sqrt();
        let angle = (k as f64 * 2.399_963_229_728_653) % std::f64::consts::TAU;
        let (sin, cos) = (angle as f32).sin_cos();
        (radius.cos() * sun + radius.sin() * (cos * across + sin * along)).normalize()
    })
}

/// Mean, variance and greatest of something.
#[derive(Default, Debug)]
struct Moments {
    values: Vec<f64>,
}

impl Moments {
    fn mean(&self) -> f64 {
        self.values.iter().sum::<f64>() / self.values.len() as f64
    }

    fn variance(&self) -> f64 {
        let mean = self.mean();
        self.values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / self.values.len() as f64
    }

    fn error(&self) -> f64 {
        (self.variance() / self.values.len() as f64).sqrt()
    }

    fn greatest(&self) -> f64 {
        self.values.iter().copied().fold(0.0, f64::max)
    }
}

/// What a level card at `from` has of single directions, and of their means.
fn moments(manifold: &Manifold, from: Vec3, event: Event, tilt: [f32; 2], count: usize) -> [Moments; 2] {
    let disc = Disc { direction: SUN.direction.normalize(), ..SUN };
    let mut moments = <[Moments; 2]>::default();
    for (k, direction) in directions(count).enumerate() {
        let (found, _) = connect(manifold, from, event, Target::Direction(direction), tilt);
        // Two sequences that know nothing of the spiral.
        let u = [2.0f64.sqrt(), 3.0f64.sqrt()].map(|root| (root * k as f64).fract() as f32);
        let card = |c: &Connection| f64::from(c.spread * c.direction.y.abs());
        moments[0].values.push(found.iter().map(card).sum());
        let average = |c: &Connection| manifold.average(from, event, &disc, WATER, tilt, u, *c);
        moments[1].values.push(found.iter().flat_map(average).flatten().map(|c| card(&c)).sum());
    }
    moments
}

/// Points below (above) the waves, and both moments of each.
fn survey(manifold: &Manifold, height: f32, event: Event, tilt: [f32; 2], count: usize) -> Vec<[Moments; 2]> {
    let place = |k: usize, root: f64| 2.0 * ((root * k as f64).fract() as f32 - 0.5);
    (0..150)
        .map(|k| Vec3::new(place(k, 5.0f64.sqrt()), height, place(k, 7.0f64.sqrt())))
        .map(|from| moments(manifold, from, event, tilt, count))
        .collect()
}

fn total(survey: &[[Moments; 2]], which: usize, of: impl Fn(&Moments) -> f64) -> f64 {
    survey.iter().map(|both| of(&both[which])).sum::<f64>() / survey.len() as f64
}

#[test]
fn means_are_those_of_single_directions_with_less_variance() {
    for (order, height, event, tilt) in [
        (3, -4.0, Event::Refraction, [0.0; 2]),
        (4, -3.0, Event::Refraction, [0.02, -0.03]),
        (3, 2.0, Event::Reflection, [0.0; 2]),
    ] {
        let survey = survey(&waves(order), height, event, tilt, 1500);
        let case = format!("order {order} at {height} m, {event:?}");
        let mut followed = 0;
        for [single, averaged] in &survey {
            let (difference, room) = (averaged.mean() - single.mean(), single.error().hypot(averaged.error()));
            // Rare bright ones make single directions' own error too small: six of it.
            assert!(difference.abs() <= 6.0 * room + 2e-3 * single.mean(), "{case}: {difference} against {room}");
            followed += usize::from(single.values != averaged.values);
        }
        assert!(followed > 5, "{case}: {followed}");
        let [before, after] = [0, 1].map(|which| total(&survey, which, Moments::mean));
        assert!((after / before - 1.0).abs() < 0.01, "{case}: {before} and {after}");
        let [before, after] = [0, 1].map(|which| total(&survey, which, Moments::variance));
        assert!(after < 0.8 * before, "{case}: variance {before} and {after}");
        let [before, after] = [0, 1].map(|which| survey.iter().map(|both| both[which].greatest()).fold(0.0, f64::max));
        assert!(after < 0.8 * before, "{case}: at most {before} and {after}");
    }
}

#[test]
fn a_stand_in_obeys_the_law_and_looks_into_the_disc() {
    let manifold = waves(3);
    let disc = Disc { direction: SUN.direction.normalize(), ..SUN };
    let mut stand_ins = 0;
    for k in 0..200 {
        let from = Vec3::new(0.01 * k as f32 - 1.0, -4.0, 0.3);
        for direction in directions(20) {
            let (found, _) = connect(&manifold, from, Event::Refraction, Target::Direction(direction), [0.0; 2]);
            for single in found {
                for c in manifold.average(from, Event::Refraction, &disc, WATER, [0.0; 2], [0.3, 0.6], single) {
                    let Some(c) = c else { continue };
                    if c.to_light == single.to_light {
                        continue;
                    }
                    stand_ins += 1;
                    assert!(c.to_light.angle_between(disc.direction) <= disc.radius * 1.001, "{c:?}");
                    // n d + w is along the normal.
                    let h = (c.to_light - WATER * c.direction).normalize();
                    assert!(h.dot(c.facet).abs() > 1.0 - 1e-5 && c.spread.is_finite() && c.spread > 0.0, "{c:?}");
                    assert!((from + c.direction * c.distance - c.surface).length() < 1e-4, "{c:?}");
                }
            }
        }
    }
    assert!(stand_ins > 100, "{stand_ins}");
}

#[test]
fn light_that_is_spread_stays_as_it_is() {
    let manifold = waves(3);
    let disc = Disc { direction: SUN.direction.normalize(), ..SUN };
    let from = Vec3::new(0.2, -0.3, 0.1);
    let (found, _) = connect(&manifold, from, Event::Refraction, Target::Direction(disc.direction), [0.0; 2]);
    assert!(!found.is_empty());
    for single in found {
        let both = manifold.average(from, Event::Refraction, &disc, WATER, [0.0; 2], [0.3, 0.6], single);
        assert_eq!(both, [Some(single), None]);
    }
}
