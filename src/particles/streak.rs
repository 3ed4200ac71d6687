//! Streaks: each particle as the round stroke that it draws while the shutter is open.
//!
//! A stroke is straight. A drop falls along a parabola, which over a time T leaves its chord by g T^2 / 8 at most: half a
//! millimetre in 1/50 s, under the drops' own size. Strokes are where the water is: from the particle back along its
//! velocity. How they are lit is not here.

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::{
    Spray,
    classes::rise,
    detail::strengthened,
    seed::{Purpose, uniform},
};
use crate::math::{RoundCone, discs_outline};
use crate::scene;

/// Newton steps to a radius: from above, on a convex curve, each squares the error; the first ones halve a large one.
const STEPS: usize = 32;

/// Radii (pixels) over which a streak begins to close up with its neighbours: one of half a pixel is drawn as wide anyway.
const VEIL_PIXELS: [f32; 2] = [0.5, 1.5];

/// The streaks of a spray, one array per field, in the order of its particles.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Streaks {
    /// Centres of head and tail (m): the particle, and where it was.
    pub ends: Vec<[Vec3; 2]>,
    /// Radii (m) of head and tail; 0 for what was left out.
    pub radius: Vec<[f32; 2]>,
    /// Factor on the particle's opacity, 0..1: under 1 where the streak was widened.
    pub share: Vec<f32>,
    /// Streaks left out because they reach beyond single precision.
    pub out_of_range: u64,
}

/// Radius (m) of the head of a streak of `length` (m) that holds the water of a ball of `radius` (m), its tail's being
/// `taper` times that.
///
/// At no length it is the ball's own; far beyond, it falls with the square root of the length.
fn head_radius(radius: f64, length: f64, taper: f64) -> f64 {
    let volume = 4.0 / 3.0 * std::f64::consts::PI * radius.powi(3);
    let mut head = radius;
    for _ in 0..STEPS {
        let cone = RoundCone::new([DVec3::ZERO, DVec3::X * length], [head, taper * head]);
        let next = head - (cone.volume() - volume) / cone.volume_rate(taper);
        // It comes down to the root: what no longer falls is there, to rounding. Nothing else is under it.
        if !(next > 0.0 && next < head) {
            break;
        }
        head = next;
    }
    head
}

/// One particle's streak: ends, radii, share, and how much of that it would have if no pixel were too wide for it.
struct Streak {
    ends: [Vec3; 2],
    radius: [f32; 2],
    share: f32,
    seen: f64,
}

/// A particle's size as a streak.
#[derive(Clone, Copy)]
struct Size {
    /// Of its ball (m).
    radius: f64,
    /// Factor on the outline, for one that stands for others as well.
    cover: f64,
    /// Radius (m) by which it closes up with its neighbours; 0 on its own.
    veil: f64,
}

/// Both ends as an eye sees them.
struct Seen {
    /// Metres from the eye along the line to the streak's middle.
    depth: [f64; 2],
    /// Apart, in a plane one metre before the eye.
    apart: f64,
}

impl Seen {
    fn new(ends: [DVec3; 2], eye: DVec3) -> Self {
        let to_middle = (ends[0] + ends[1]) * 0.5 - eye;
        let (distance, forward) = (to_middle.length(), to_middle.normalize_or_zero());
        let depth = ends.map(|end| (end - eye).dot(forward));
        // A streak that begins beside the eye or behind it has no place in a plane before it: there it is taken as one
        // far away, all of it as near as its middle.
        if depth[0].min(depth[1]) > 1e-3 * distance {
            let places = [(ends[0] - eye) / depth[0], (ends[1] - eye) / depth[1]];
            return Self { depth, apart: (places[1] - places[0]).length() };
        }
        Self { depth: [distance; 2], apart: (ends[1] - ends[0]).cross(forward).length() / distance }
    }

    /// Radii in the same ratio whose outline is `cover` times as large.
    fn widened(&self, radius: [f64; 2], cover: f64) -> [f64; 2] {
        let wanted = cover * self.outline(radius);
        let area = |factor: f64| self.outline(radius.map(|radius| factor * radius));
        // Between the growth of a long streak's outline, with its width, and a ball's, with the square of that.
        let [mut low, mut high] = if cover > 1.0 { [cover.sqrt(), cover] } else { [cover, cover.sqrt()] };
        // Halved to single precision's rounding of the radii.
        for _ in 0..24 {
            let middle = 0.5 * (low + high);
            if area(middle) < wanted {
                low = middle;
            } else {
                high = middle;
            }
        }
        radius.map(|radius| high * radius)
    }

    /// Area that it covers of that plane (m2).
    fn outline(&self, radius: [f64; 2]) -> f64 {
        discs_outline([radius[0] / self.depth[0], radius[1] / self.depth[1]], self.apart)
    }
}

impl Streak {
    const NONE: Self = Self { ends: [Vec3::ZERO; 2], radius: [0.0; 2], share: 0.0, seen: 0.0 };

    /// From `position` back along `velocity` for `seconds`, holding the water of a ball of `radius`.
    ///
    /// `eye` is where it is seen from (m) and the width of a pixel (radians): what is narrower than `least_width` of them
    /// there is widened, and its opacity lowered by what its outline grows, so that as much light is stopped. One that
    /// stands for others as well is drawn so much wider; one that closes up with its neighbours is drawn as wide as that asks
    /// for, on the same terms, where a pixel is narrower than what lies between them.
    fn new(
        [position, velocity]: [DVec3; 2],
        Size { radius, cover, veil }: Size,
        seconds: f64,
        settings: &scene::Particles,
        eye: Option<(DVec3, f64)>,
    ) -> Option<Self> {
        let ends = [position, position - velocity * seconds];
        let head = head_radius(radius, (ends[1] - ends[0]).length(), settings.taper);
        let thin = [head, settings.taper * head];
        let (mut wide, mut share, mut whole) = (thin, 1.0, 1.0);
        if let Some((eye, pixel_angle)) = eye {
            let seen = Seen::new(ends, eye);
            let least = 0.5 * settings.least_width * pixel_angle;
            let own = if cover == 1.0 { thin } else { seen.widened(thin, cover) };
            let closed = Self::closed(own, veil * cover.sqrt(), pixel_angle * (seen.depth[0] + seen.depth[1]) * 0.5);
            wide = [closed[0].max(least * seen.depth[0]), closed[1].max(least * seen.depth[1])];
            if wide != thin {
                let outline = seen.outline(wide);
                share = (cover * seen.outline(thin) / outline).min(1.0);
                whole = (seen.outline(closed) / outline).min(1.0);
            }
        }
        let streak = Self {
            ends: ends.map(|end| end.as_vec3()),
            radius: wide.map(|radius| radius as f32),
            share: share as f32,
            seen: whole,
        };
        let finite =
            streak.ends.iter().all(|end| end.is_finite()) && streak.radius.iter().all(|radius| radius.is_finite());
        finite.then_some(streak)
    }

    /// Radii in the same ratio of which the head's is a `veil`'s (m), if that is more, where a pixel is `pixel` (m) wide: what
    /// no pixel shows apart is closed up already.
    fn closed(own: [f64; 2], veil: f64, pixel: f64) -> [f64; 2] {
        if !(veil > 0.0) {
            return own;
        }
        let shown = f64::from(rise((veil / pixel) as f32, VEIL_PIXELS[0], VEIL_PIXELS[1]));
        let factor = (veil * shown / own[0]).max(1.0);
        own.map(|radius| factor * radius)
    }
}

/// The streaks of `seconds` (s) of flight, or of each particle's part of them ([`Spray::stretch`]), seen from `eye` (local frame, m) with pixels of so many radians, if from
/// anywhere.
pub fn streaks(spray: &Spray, settings: &scene::Particles, seconds: f64, eye: Option<(DVec3, f64)>) -> Streaks {
    let streak = |index: usize| {
        let flight = [spray.position[index].as_dvec3(), spray.velocity[index].as_dvec3()];
        let [radius, cover, veil] = [spray.radius[index], spray.cover(index), spray.veil(index)].map(f64::from);
        let shown = seconds * f64::from(spray.stretch(index));
        let streak = Streak::new(flight, Size { radius, cover, veil }, shown, settings, eye)?;
        let chance = uniform(spray.seed(index), Purpose::Faint);
        // What is faint for being wide among its neighbours is so for all of them: a veil has no grain.
        let factor = strengthened(streak.seen, settings.least_opacity, chance);
        let share = (f64::from(streak.share) * factor) as f32;
        Some(if factor > 0.0 { Streak { share, ..streak } } else { Streak::NONE })
    };
    let all: Vec<Option<Streak>> = (0..spray.len()).into_par_iter().map(streak).collect();
    let mut streaks =
        Streaks { out_of_range: all.iter().filter(|streak| streak.is_none()).count() as u64, ..Streaks::default() };
    for streak in all {
        let streak = streak.unwrap_or(Streak::NONE);
        streaks.ends.push(streak.ends);
        streaks.radius.push(streak.radius);
        streaks.share.push(streak.share);
    }
    streaks
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;
    use crate::state;

    fn spray(position: Vec<[f64; 3]>, velocity: Vec<[f64; 3]>, mass: Vec<f64>) -> Spray {
        let age = vec![0.0; mass.len()];
        let particles = state::Particles { position, velocity, mass, age, id: None };
        Spray::build(&particles, &scene::Particles::default(), DVec3::ZERO)
    }

    fn settings(taper: f64, least_width: f64) -> scene::Particles {
        scene::Particles { taper, least_width, least_opacity: 0.0, ..scene::Particles::default() }
    }

    /// Solid angle (sr) of a cone from `eye`, by rays through a grid across it.
    fn solid_angle(eye: DVec3, ends: [DVec3; 2], radius: [f64; 2]) -> f64 {
        let cone = RoundCone::new(ends, radius);
        let middle = (ends[0] + ends[1]) * 0.5;
        let reach = (ends[0] - middle).length() + radius[0].max(radius[1]);
        let forward = middle - eye;
        // Turned, so that no edge lies along the grid.
        let (right, up) = forward.normalize().any_orthonormal_pair();
        let (sine, cosine) = 0.5_f64.sin_cos();
        let (right, up) = (right * cosine + up * sine, up * cosine - right * sine);
        let (steps, distance) = (1200, forward.length());
        let place = |k: i32| ((f64::from(k) + 0.5) / f64::from(steps) - 0.5) * 2.0 * reach;
        let cell = (2.0 * reach / f64::from(steps)).powi(2);
        let hits = (0..steps * steps).filter(|k| {
            let direction = forward + right * place(k % steps) + up * place(k / steps);
            cone.crossing(eye, direction, [0.0, f64::INFINITY]).is_some()
        });
        hits.count() as f64 * cell / (distance * distance)
    }

    #[test]
    fn a_streak_holds_the_water_of_its_drop() {
        for taper in [0.0, 0.25, 1.0] {
            for radius in [1e-6, 1e-3, 0.05, 100.0] {
                let mut last = radius;
                for length in [0.0, 1e-9, 0.3 * radius, radius, 10.0 * radius, 1e6 * radius] {
                    let head = head_radius(radius, length, taper);
                    let cone = RoundCone::new([DVec3::ZERO, DVec3::X * length], [head, taper * head]);
                    let expected = 4.0 / 3.0 * PI * radius.powi(3);
                    assert!((cone.volume() / expected - 1.0).abs() < 1e-9, "{taper} {radius} {length}: {head}");
                    assert!(head > 0.0 && head <= last, "longer streaks are thinner");
                    last = head;
                }
            }
        }
        assert_eq!(head_radius(0.2, 0.0, 0.25), 0.2);
    }

    #[test]
    fn streaks_reach_back_along_the_flight_and_rest_is_a_ball() {
        let spray = spray(vec![[1.0, 2.0, 3.0]; 2], vec![[10.0, -5.0, 0.0], [0.0; 3]], vec![0.01; 2]);
        let streaks = streaks(&spray, &settings(0.25, 1.0), 0.02, None);
        assert_eq!(streaks.ends[0], [Vec3::new(1.0, 2.0, 3.0), Vec3::new(0.8, 2.1, 3.0)]);
        assert!(streaks.radius[0][0] < spray.radius[0] && streaks.radius[0][1] == 0.25 * streaks.radius[0][0]);
        assert_eq!(streaks.ends[1], [Vec3::new(1.0, 2.0, 3.0); 2]);
        assert_eq!(streaks.radius[1][0], spray.radius[1]);
        assert_eq!((streaks.share, streaks.out_of_range), (vec![1.0; 2], 0));
    }

    #[test]
    fn a_streak_from_the_side_covers_a_capsule() {
        let spray = spray(vec![[0.0, 0.0, 0.0]], vec![[8.0, 0.0, 0.0]], vec![0.02]);
        let streaks = streaks(&spray, &settings(1.0, 0.0), 0.05, None);
        let (length, radius) = (0.4, f64::from(streaks.radius[0][0]));
        let ends = streaks.ends[0].map(|end| end.as_dvec3());
        // From a kilometre, so that the outline is the side's.
        let area = solid_angle(DVec3::new(-0.2, 0.0, 1000.0), ends, [radius; 2]) * 1e6;
        let expected = 2.0 * radius * length + PI * radius * radius;
        assert!((area / expected - 1.0).abs() < 3e-3, "{area} for {expected}");
    }

    #[test]
    fn widened_streaks_stop_as_much_light_as_thin_ones() {
        let (eye, pixel) = (DVec3::new(0.0, 1.0, 9.0), 0.05);
        let place = |k: i32| [f64::from(k % 3) - 1.0, f64::from(k % 5) - 1.0, f64::from(k % 4) - 2.0];
        let velocity = |k: i32| [f64::from(k % 2) * 20.0, -f64::from(k % 4) * 9.0, f64::from(k % 3) * 30.0];
        let spray = spray((0..8).map(place).collect(), (0..8).map(velocity).collect(), vec![0.004; 8]);
        let [thin, wide] = [0.0, 1.0].map(|width| streaks(&spray, &settings(0.25, width), 0.04, Some((eye, pixel))));
        let covered = |streaks: &Streaks| -> f64 {
            let one = |k: usize| {
                let ends = streaks.ends[k].map(|end| end.as_dvec3());
                f64::from(streaks.share[k]) * solid_angle(eye, ends, streaks.radius[k].map(f64::from))
            };
            (0..streaks.share.len()).into_par_iter().map(one).sum()
        };
        assert!(thin.share.iter().all(|&share| share == 1.0));
        for (share, radius) in wide.share.iter().zip(&wide.radius) {
            assert!(*share < 0.5 && radius[1] > 0.5 * 0.05 * 6.0, "{share} {radius:?}");
        }
        let (thin, wide) = (covered(&thin), covered(&wide));
        assert!((wide / thin - 1.0).abs() < 0.01, "{wide} for {thin}");
    }

    #[test]
    fn a_streak_that_stands_for_others_covers_as_much_as_all_of_them() {
        let (eye, pixel) = (DVec3::new(0.0, 1.0, 9.0), 0.05);
        let velocity: Vec<[f64; 3]> = (0..6).map(|k| [f64::from(k) * 9.0, -f64::from(k % 4), 3.0]).collect();
        let plain = spray(vec![[0.5, 0.2, -1.0]; 6], velocity, vec![0.004; 6]);
        let mut wide = plain.clone();
        wide.thin(vec![7.0; 6]);
        for width in [0.0, 0.3, 1.0] {
            let [one, many] =
                [&plain, &wide].map(|spray| streaks(spray, &settings(0.25, width), 0.04, Some((eye, pixel))));
            let covered = |streaks: &Streaks, k: usize| {
                let ends = streaks.ends[k].map(|end| end.as_dvec3());
                f64::from(streaks.share[k]) * solid_angle(eye, ends, streaks.radius[k].map(f64::from))
            };
            for k in 0..6 {
                let ratio = covered(&many, k) / covered(&one, k);
                assert!((ratio / 7.0 - 1.0).abs() < 0.01, "{width} pixels, {k}: {ratio}");
            }
        }
    }

    #[test]
    fn nothing_that_files_may_hold_makes_a_streak_that_is_no_number() {
        let mut particles = state::Particles {
            position: vec![[0.0; 3]; 8],
            velocity: vec![[0.0; 3], [1.0; 3], [3e38; 3], [1e-30; 3], [1e10; 3], [1.0; 3], [1.0; 3], [1e5; 3]],
            mass: vec![1.0, 0.0, 1.0, 1e-12, 1.0, 1e12, 1e-300, 4e9],
            age: vec![0.0, 0.0, 0.0, f64::INFINITY, 0.0, 0.0, f64::MAX, 0.0],
            id: None,
        };
        particles.position[5] = [3e38; 3];
        for (taper, width, seconds) in [(0.25, 1.0, 0.02), (0.0, 0.0, 0.0), (1.0, 100.0, 1000.0)] {
            for eye in [None, Some((DVec3::ZERO, 1e-3)), Some((DVec3::new(1.0, -2.0, 5.0), 1e-3))] {
                let spray = Spray::build(&particles, &settings(taper, width), DVec3::ZERO);
                let streaks = streaks(&spray, &settings(taper, width), seconds, eye);
                let left_out = streaks.radius.iter().filter(|radius| radius[0] == 0.0).count() as u64;
                assert_eq!(left_out, streaks.out_of_range, "{streaks:?}");
                assert!(left_out <= 1 && (seconds < 1.0) == (left_out == 0), "{streaks:?}");
                for k in 0..spray.len() {
                    assert!(streaks.ends[k].iter().all(|end| end.is_finite()));
                    assert!(streaks.radius[k].iter().all(|&radius| radius >= 0.0 && radius.is_finite()));
                    assert!((0.0..=1.0).contains(&streaks.share[k]));
                }
                let mut spray = spray;
                spray.set_shares(0, &streaks.share);
                assert!((0..spray.len()).all(|k| (0.0..=1.0).contains(&spray.appearance(k).opacity)));
            }
        }
    }
}
