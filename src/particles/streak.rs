//! Streaks: each particle as the round stroke that it draws while the shutter is open.
//!
//! A stroke is straight. A drop falls along a parabola, which over a time T leaves its chord by g T^2 / 8 at most: half a
//! millimetre in 1/50 s, under the drops' own size. Strokes are where the water is: from the particle back along its
//! velocity. How they are lit is not here.

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::Spray;
use crate::{math::RoundCone, scene};

/// Newton steps to a radius: from above, on a convex curve, each squares the error; the first ones halve a large one.
const STEPS: usize = 32;

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

/// One particle's streak: ends, radii, share.
struct Streak {
    ends: [Vec3; 2],
    radius: [f32; 2],
    share: f32,
}

impl Streak {
    const NONE: Self = Self { ends: [Vec3::ZERO; 2], radius: [0.0; 2], share: 0.0 };

    /// From `position` back along `velocity` for `seconds`, holding the water of a ball of `radius`.
    ///
    /// `eye` is where it is seen from (m) and the width of a pixel (radians): what is narrower than `least_width` of them
    /// there is widened, and its opacity lowered by what its outline grows, so that as much light is stopped.
    fn new(
        [position, velocity]: [DVec3; 2],
        radius: f64,
        seconds: f64,
        settings: &scene::Particles,
        eye: Option<(DVec3, f64)>,
    ) -> Option<Self> {
        let ends = [position, position - velocity * seconds];
        let head = head_radius(radius, (ends[1] - ends[0]).length(), settings.taper);
        let thin = [head, settings.taper * head];
        let (mut wide, mut share) = (thin, 1.0);
        if let Some((eye, pixel_angle)) = eye {
            let to_eye = eye - (ends[0] + ends[1]) * 0.5;
            let least = 0.5 * settings.least_width * pixel_angle * to_eye.length();
            wide = thin.map(|radius| radius.max(least));
            if wide != thin {
                let towards = to_eye.normalize_or(DVec3::Y);
                let outline = |radius| RoundCone::new(ends, radius).outline(towards);
                share = (outline(thin) / outline(wide)).min(1.0);
            }
        }
        let streak =
            Self { ends: ends.map(|end| end.as_vec3()), radius: wide.map(|radius| radius as f32), share: share as f32 };
        let finite =
            streak.ends.iter().all(|end| end.is_finite()) && streak.radius.iter().all(|radius| radius.is_finite());
        finite.then_some(streak)
    }
}

/// The streaks of `seconds` (s) of flight, seen from `eye` (local frame, m) with pixels of so many radians, if from
/// anywhere.
pub fn streaks(spray: &Spray, settings: &scene::Particles, seconds: f64, eye: Option<(DVec3, f64)>) -> Streaks {
    let streak = |index: usize| {
        let flight = [spray.position[index].as_dvec3(), spray.velocity[index].as_dvec3()];
        Streak::new(flight, spray.radius[index].into(), seconds, settings, eye)
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
