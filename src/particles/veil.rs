//! Streaks whose neighbours move alike are one sheet of water seen through its strands: how wide each is drawn so that they
//! close up into a veil.
//!
//! Lines through one flow are read as a surface where they lie closer than they are wide (M. Zöckler, D. Stalling, H.-C. Hege,
//! 1996, draw them so dense). Here what is missing of that density is made up by width, and the opacity falls by what the
//! width grows, in `streak`: no light is stopped that was not.

use glam::Vec3;

use super::{
    Spray,
    classes::rise,
    nearest::{MOST, Nearest, nearest},
};

/// A streak's radius by twice the distance between strands. In a row that is 1.2 distances, in a curtain of many on each line
/// 0.8 or more: soft profiles (1 - x^2)^(3/2) of either add up to the same within 6 % anywhere. Of a half they would leave gaps.
const RADIUS: f32 = 0.6;

/// Spacings by the streak's length over which strands stop being one sheet: what is farther apart than it is long is drops,
/// and at no spacing is a streak made wider than half of its length.
const APART: [f32; 2] = [0.4, 1.0];

/// Another streak: how far (m), how much it moves alike (0..1), and how much of it is a streak at all.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Neighbour {
    distance: f32,
    alike: f32,
    share: f32,
}

/// Twice the distance (m) between strands, from neighbours in ascending order, and the part of all neighbours so near that
/// moves alike: the D by which the sum of alike · (1 - distance / D), where that is positive, is 1.
///
/// One on either side makes it twice their distance; a single one, or none that moves alike, makes none. It goes evenly with
/// all that it is made of, whoever is the third or the fourth.
fn spacing(neighbours: &[Neighbour]) -> Option<(f32, f32)> {
    let (mut alike, mut sum) = (0.0, 0.0);
    for (k, neighbour) in neighbours.iter().enumerate() {
        alike += neighbour.alike;
        sum += neighbour.alike * neighbour.distance;
        let spacing = sum / (alike - 1.0);
        let next = neighbours.get(k + 1).map_or(f32::INFINITY, |next| next.distance);
        if alike > 1.0 && spacing <= next {
            let weight = |other: &Neighbour| other.share * (1.0 - other.distance / spacing).max(0.0);
            let all: f32 = neighbours.iter().map(weight).sum();
            return (spacing > 0.0 && spacing.is_finite() && all > 0.0).then(|| (spacing, (1.0 / all).min(1.0)));
        }
    }
    None
}

/// Radius (m) of a streak of so much length (m) among its neighbours, 0 for one that is on its own.
fn radius(neighbours: &[Neighbour], length: f32) -> f32 {
    let Some((spacing, kindred)) = spacing(neighbours) else { return 0.0 };
    // Where as many go another way, streams cross: no sheet.
    let together = (2.0 * kindred - 1.0).max(0.0);
    RADIUS * spacing * together * (1.0 - rise(spacing / length, APART[0], APART[1]))
}

/// Radius (m) that each particle's streak is to be drawn with to close up with its neighbours; 0 where it stays as it is.
///
/// `merging` is the difference of two velocities, by the speed, from which on they have nothing to do with each other; from half
/// of it down they are alike. A streak shows `length(index)` (m) of flight; `share` is how much of each particle is one at all,
/// none for all of each.
pub fn veils(spray: &Spray, share: &[f32], merging: f32, length: impl Fn(usize) -> f32 + Sync) -> Vec<f32> {
    let mut veils = vec![0.0; spray.len()];
    let streaks: Vec<usize> = match share {
        [] => (0..spray.len()).collect(),
        share => (0..spray.len()).filter(|&index| share[index] > 0.0).collect(),
    };
    let places: Vec<Vec3> = streaks.iter().map(|&index| spray.position[index]).collect();
    let judge = |own: usize, near: &Nearest| {
        let velocity = spray.velocity[streaks[own]];
        let mut neighbours = [Neighbour { distance: 0.0, alike: 0.0, share: 0.0 }; MOST];
        let squares = near.squares();
        for (neighbour, &(square, other)) in neighbours.iter_mut().zip(squares) {
            let other = streaks[other as usize];
            let share = share.get(other).copied().unwrap_or(1.0);
            let alike =
                1.0 - rise(velocity.distance(spray.velocity[other]) / velocity.length(), 0.5 * merging, merging);
            // What is no number says nothing.
            let alike = if alike > 0.0 { alike * share } else { 0.0 };
            *neighbour = Neighbour { distance: square.sqrt(), alike, share };
        }
        radius(&neighbours[..squares.len()], length(streaks[own]))
    };
    let found = nearest(&places, |own| APART[1] * length(streaks[own]), judge);
    for (index, veil) in streaks.into_iter().zip(found) {
        veils[index] = veil;
    }
    veils
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::{
        math::scramble,
        particles::{Streaks, streaks},
        scene, state,
    };

    const SECONDS: f64 = 0.02;

    fn spray(position: Vec<[f64; 3]>, velocity: Vec<[f64; 3]>) -> Spray {
        let count = position.len();
        let ball = 4.0 / 3.0 * std::f64::consts::PI * 1000.0 * 0.004_f64.powi(3);
        let particles =
            state::Particles { position, velocity, mass: vec![ball; count], age: vec![0.0; count], id: None };
        Spray::build(&particles, &scene::Particles::default(), DVec3::ZERO)
    }

    fn veils_of(spray: &Spray, merging: f32) -> Vec<f32> {
        veils(spray, &[], merging, |index| spray.velocity[index].length() * SECONDS as f32)
    }

    /// A curtain of strands 3 cm apart that fall 0.2 m, seen square from 4 m with pixels of 4 mm: as they are, and closed up.
    fn curtain(velocity: impl Fn(usize) -> [f64; 3]) -> (Spray, [Streaks; 2]) {
        let place = |k: usize| [0.03 * (k % 33) as f64 - 0.48, 0.03 * (k / 33) as f64 - 0.3, 0.0];
        let mut spray = spray((0..33 * 21).map(place).collect(), (0..33 * 21).map(velocity).collect());
        let settings = scene::Particles { least_opacity: 0.0, taper: 0.5, ..scene::Particles::default() };
        let eye = Some((DVec3::new(0.0, 0.0, 4.0), 0.001));
        let apart = streaks(&spray, &settings, SECONDS, eye);
        let wide = veils_of(&spray, 0.2);
        spray.set_veils(wide);
        let closed = streaks(&spray, &settings, SECONDS, eye);
        (spray, [apart, closed])
    }

    /// Light that gets through along z, by each of a grid's places across the middle strands; soft balls of finer drops.
    fn through(streaks: &Streaks, opacity: f64) -> Vec<f64> {
        let place = |k: usize| DVec3::new(-0.15 + 0.001 * (k % 300) as f64, -0.03 + 0.01 * (k / 300) as f64, 0.0);
        let passes = |at: DVec3| {
            let mut clear = 1.0;
            for (k, ends) in streaks.ends.iter().enumerate() {
                let [head, tail] = ends.map(|end| end.as_dvec3());
                let along = ((at - head).dot(tail - head) / (tail - head).length_squared()).clamp(0.0, 1.0);
                let [wide, narrow] = streaks.radius[k].map(f64::from);
                let x = at.distance(head.lerp(tail, along)) / (wide + along * (narrow - wide));
                if x < 1.0 {
                    let own = 1.0 - (1.0 - opacity).powf((1.0 - x * x).powf(1.5));
                    clear *= 1.0 - f64::from(streaks.share[k]) * own;
                }
            }
            clear
        };
        (0..300 * 7).map(|k| passes(place(k))).collect()
    }

    fn mean_and_deviation(values: &[f64]) -> (f64, f64) {
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        (mean, (values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / values.len() as f64).sqrt())
    }

    #[test]
    fn a_row_of_strands_that_fall_together_becomes_an_even_veil() {
        let (_, [apart, closed]) = curtain(|_| [0.0, -10.0, 0.0]);
        let [(open, hairs), (veil, even)] = [&apart, &closed].map(|streaks| mean_and_deviation(&through(streaks, 0.9)));
        // Strands that hide each other hide less: the veil, whose parts overlap, may stop a little more than the hairs, one before
        // the other, do.
        assert!(hairs > 0.1 && even < hairs / 8.0, "{even} for {hairs}");
        assert!(veil <= open && open - veil < 0.15, "{veil} for {open}");
        // With little in each, nothing hides anything, and the light is the same, but for what soft round ends stop less by area
        // than the rest does.
        let [(open, hairs), (veil, even)] =
            [&apart, &closed].map(|streaks| mean_and_deviation(&through(streaks, 0.01)));
        assert!(((1.0 - veil) / (1.0 - open) - 1.0).abs() < 0.06, "{veil} for {open}");
        assert!(even < hairs / 8.0, "{even} for {hairs}");
    }

    #[test]
    fn strands_are_widened_to_what_lies_between_them_and_keep_their_light() {
        let (spray, [apart, closed]) = curtain(|_| [0.0, -10.0, 0.0]);
        let middle = 10 * 33 + 16;
        // Four at one distance have 4/3 of it for their spacing.
        assert!((spray.veil(middle) - 4.0 / 3.0 * RADIUS * 0.03).abs() < 1e-5, "{}", spray.veil(middle));
        let area = |streaks: &Streaks, k: usize| {
            let radius = streaks.radius[k].map(f64::from);
            let length = f64::from(streaks.ends[k][0].distance(streaks.ends[k][1]));
            // Seen square: within the perspective of a fortieth of a radian, which is the same for both.
            f64::from(streaks.share[k]) * crate::math::discs_outline(radius, length)
        };
        for k in 0..spray.len() {
            assert!(closed.radius[k][0] >= apart.radius[k][0]);
            let ratio = area(&closed, k) / area(&apart, k);
            assert!((ratio - 1.0).abs() < 0.01, "{k}: {ratio}");
        }
        assert!(closed.radius[middle][0] > 2.0 * apart.radius[middle][0] && closed.share[middle] < 0.5);
    }

    #[test]
    fn strangers_pairs_and_those_far_apart_stay_as_they_are() {
        let away = |k: usize| {
            let turn = (scramble(k as u64) >> 40) as f64 / f64::from(1 << 24) * std::f64::consts::TAU;
            [10.0 * turn.cos(), 10.0 * turn.sin(), if k.is_multiple_of(2) { 8.0 } else { -8.0 }]
        };
        let (spray, [apart, closed]) = curtain(away);
        let touched = (0..spray.len()).filter(|&k| closed.radius[k] != apart.radius[k]).count();
        assert!(touched * 50 < spray.len(), "{touched} of {}", spray.len());
        // Every other one rises.
        let (_, [apart, closed]) =
            curtain(|k| [0.0, if (k % 33 + k / 33).is_multiple_of(2) { 10.0 } else { -10.0 }, 0.0]);
        assert_eq!(apart, closed);
        let fall = vec![[0.0, -10.0, 0.0]; 4];
        let row = |step: f64| (0..4).map(|k| [step * f64::from(k), 0.0, 0.0]).collect::<Vec<_>>();
        assert_eq!(veils_of(&self::spray(row(0.02)[..2].to_vec(), fall[..2].to_vec()), 0.2), [0.0; 2]);
        assert_eq!(veils_of(&self::spray(row(0.21), fall.clone()), 0.2), [0.0; 4]);
        assert!(veils_of(&self::spray(row(0.02), fall), 0.2).iter().all(|&radius| radius > 0.0));
    }

    #[test]
    fn nothing_pops_as_strands_part_turn_and_stop_being_streaks() {
        let at = |gap: f64, turn: f64, share: f32| {
            let place = |k: i32| [gap * f64::from(k % 7), gap * f64::from(k / 7), 0.001 * f64::from(k * k % 5)];
            let velocity = |k: i32| [if k % 2 == 0 { 10.0 * turn } else { 0.0 }, -10.0, 0.0];
            let spray = spray((0..49).map(place).collect(), (0..49).map(velocity).collect());
            let shares: Vec<f32> = (0..49).map(|k| if k % 3 == 0 { share } else { 1.0 }).collect();
            veils(&spray, &shares, 0.2, |index| spray.velocity[index].length() * SECONDS as f32)
        };
        let steady = |of: &dyn Fn(f64) -> Vec<f32>| {
            let mut last = of(0.0);
            for step in 1..=1000 {
                let now = of(f64::from(step) / 1000.0);
                let change = now.iter().zip(&last).map(|(now, last)| (now - last).abs()).fold(0.0, f32::max);
                // Some hundredths of the widest, in a thousandth of the way.
                assert!(change < 0.002, "{step}: {change}");
                last = now;
            }
            last
        };
        assert!(at(0.02, 0.0, 1.0).iter().all(|&radius| radius > 0.005));
        assert_eq!(steady(&|t| at(0.02 + 0.2 * t, 0.0, 1.0)), [0.0; 49]);
        steady(&|t| at(0.02, 0.25 * t, 1.0));
        steady(&|t| at(0.02, 0.0, 1.0 - 0.999 * t as f32));
    }

    #[test]
    fn crowds_rest_and_the_ends_of_numbers_give_numbers() {
        let mut position = vec![[1.0, 2.0, 3.0]; 400];
        let mut velocity: Vec<[f64; 3]> = (0..400).map(|k| [0.0, -10.0 - 1e-4 * f64::from(k), 0.0]).collect();
        for (k, speed) in [0.0, 1e-30, 1e10, 3e38, 3e38, 3e38].into_iter().enumerate() {
            position.extend([[1.0, 2.0, 3.0 + 0.01 * k as f64], [3e38; 3], [-3e38; 3]]);
            velocity.extend([[speed, 0.0, 0.0]; 3]);
        }
        let spray = spray(position, velocity);
        for merging in [1e-30, 0.2, 2.0] {
            let all = veils_of(&spray, merging);
            assert!(all.iter().all(|radius| radius.is_finite() && *radius >= 0.0));
            // In one place nothing is in between.
            assert!(all[..400].iter().all(|&radius| radius < 1e-6), "{merging}");
        }
    }

    #[test]
    fn the_same_bits_by_any_count_of_threads() {
        let share = |k: u64| (scramble(k) >> 40) as f64 / f64::from(1 << 24);
        let place = |k: u64| [share(3 * k), share(3 * k + 1), 0.2 * share(3 * k + 2)];
        let velocity = |k: u64| [share(k ^ 1 << 40), -10.0, share(k ^ 2 << 40)];
        let spray = spray((0..20_000).map(place).collect(), (0..20_000).map(velocity).collect());
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        let all = veils_of(&spray, 0.2);
        assert!(all == pool.install(|| veils_of(&spray, 0.2)) && all.iter().any(|&radius| radius > 0.0));
    }
}
