//! What each particle physically is: a drop, a streak, mist, part of a sheet of water, or a bubble.
//!
//! Judged by its size, its speed, how close its neighbours are, and whether water stands above it. All limits are soft: a
//! particle that changes belongs to two classes for a while, so that nothing pops between frames. How a class is drawn is
//! not here.

use glam::Vec3;
use rayon::prelude::*;

use crate::scene;

use super::neighbours::{Nearness, nearness};

/// What a particle can be.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Class {
    /// A drop by itself.
    Drop,
    /// A drop that flies farther, while the shutter is open, than it is wide.
    Streak,
    /// Drops too small to be told apart.
    Mist,
    /// Water that hangs together.
    Sheet,
    /// Air under water.
    Bubble,
}

impl Class {
    /// All of them, in the order of their names in files.
    pub const ALL: [Self; 5] = [Self::Drop, Self::Streak, Self::Mist, Self::Sheet, Self::Bubble];

    /// The name that parts and mattes have.
    pub fn name(self) -> &'static str {
        match self {
            Self::Drop => "spray",
            Self::Streak => "streaks",
            Self::Mist => "mist",
            Self::Sheet => "sheet",
            Self::Bubble => "bubbles",
        }
    }

    /// Whether a particle of such a share in the class is drawn in it.
    pub fn holds(self, share: f32) -> bool {
        self != Self::Mist && share > 0.0
    }
}

/// Share of a particle in each class, in the order of [`Class::ALL`]; they add up to 1.
pub type Shares = [f32; 5];

/// Shares under this are nothing, and what they would have is the largest class's: a 64th cannot be seen in a fade.
const LEAST_SHARE: f32 = 1.0 / 64.0;

/// What is judged, one array per field (metres, seconds).
#[derive(Clone, Copy, Debug)]
pub struct Judged<'a> {
    /// Centres in the local frame.
    pub position: &'a [Vec3],
    /// Velocities.
    pub velocity: &'a [Vec3],
    /// Radii.
    pub radius: &'a [f32],
    /// Seconds that the shutter is open.
    pub exposure: f32,
}

/// Shares of every particle. `depth` is how far (m) a place lies under the water's surface; 0 or less above it.
///
/// Neighbours are found within [`scene::Classes::reach`] mean radii, in O(n log n).
pub fn shares(particles: &Judged, settings: &scene::Classes, depth: impl Fn(Vec3) -> f32 + Sync) -> Vec<Shares> {
    let reach = settings.reach as f32 * mean_radius(particles.radius);
    let near = nearness(particles.position, reach);
    near.into_par_iter()
        .enumerate()
        .map(|(index, near)| {
            let (position, radius) = (particles.position[index], particles.radius[index]);
            let flown = particles.velocity[index].length() * particles.exposure;
            judge(radius, flown, depth(position), near, settings)
        })
        .collect()
}

/// The radius of a drop of the mean volume (m); 0 without particles.
pub fn mean_radius(radius: &[f32]) -> f32 {
    if radius.is_empty() {
        return 0.0;
    }
    // Relative to the largest: the cube of a metre-wide ball and of a micrometre's differ by 18 digits.
    let largest = radius.iter().copied().fold(0.0, f32::max);
    let sum: f64 = radius.iter().map(|&r| f64::from(r / largest).powi(3)).sum();
    largest * (sum / radius.len() as f64).cbrt() as f32
}

/// 0 below `low`, 1 above `high`, without a kink in between.
pub(super) fn rise(value: f32, low: f32, high: f32) -> f32 {
    let t = ((value - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// Shares of one particle of a radius, that flies so far while the shutter is open, so deep under water (all m).
fn judge(radius: f32, flown: f32, depth: f32, near: Nearness, settings: &scene::Classes) -> Shares {
    let fine = settings.mist_radius as f32;
    // What lies under the surface by its own width is a bubble altogether.
    let bubble = rise(depth / radius.max(f32::MIN_POSITIVE), 0.0, 1.0);
    // Drops that touch are water; three radii apart they are drops again.
    let crowd = settings.sheet_neighbours as f32;
    let close = 1.0 - rise(near.distance / radius.max(f32::MIN_POSITIVE), 2.0, 3.0);
    let sheet = rise(near.count as f32, 0.5 * crowd, crowd) * close * rise(radius, 0.5 * fine, fine);
    let mist = 1.0 - rise(radius, 0.5 * fine, fine);
    let streak = rise(flown / (2.0 * radius).max(f32::MIN_POSITIVE), 1.0, 2.0);
    let mut shares = [0.0; 5];
    let mut left = 1.0;
    for (class, share) in [(Class::Bubble, bubble), (Class::Mist, mist), (Class::Sheet, sheet), (Class::Streak, streak)]
    {
        // A share that is no number says nothing.
        let share = if share > 0.0 { left * share.min(1.0) } else { 0.0 };
        shares[class as usize] = share;
        left -= share;
    }
    shares[Class::Drop as usize] = left;
    settle(shares)
}

/// Gives shares that cannot be seen to the largest.
fn settle(mut shares: Shares) -> Shares {
    let largest = (0..shares.len()).fold(0, |best, class| if shares[class] > shares[best] { class } else { best });
    let mut others = 0.0;
    for (class, share) in shares.iter_mut().enumerate() {
        if class != largest {
            if *share < LEAST_SHARE {
                *share = 0.0;
            }
            others += *share;
        }
    }
    shares[largest] = 1.0 - others;
    shares
}

/// Makes what a particle is of drop, streak and bubble one: a streak if it is any of one, else what it is most of. Returns the
/// part of its flight that the streak is drawn along, so that it grows out of the drop or bubble.
///
/// All three are bright matter. Drawn as each of them by its share, a particle on its way would be a ball with a tail through
/// it.
pub fn drawn_once(shares: &mut Shares) -> f32 {
    let [drop, streak, bubble] = [Class::Drop, Class::Streak, Class::Bubble].map(|class| shares[class as usize]);
    let whole = drop + streak + bubble;
    let one = match streak > 0.0 {
        true => Class::Streak,
        false if drop >= bubble => Class::Drop,
        false => Class::Bubble,
    };
    for class in [Class::Drop, Class::Streak, Class::Bubble] {
        shares[class as usize] = if class == one { whole } else { 0.0 };
    }
    if streak > 0.0 { streak / whole } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const ALONE: Nearness = Nearness { count: 0, distance: f32::INFINITY };
    const CROWDED: Nearness = Nearness { count: 40, distance: 0.001 };

    fn class(radius: f32, flown: f32, depth: f32, near: Nearness) -> Class {
        let shares = judge(radius, flown, depth, near, &scene::Classes::default());
        let of = Class::ALL.into_iter().max_by(|&a, &b| shares[a as usize].total_cmp(&shares[b as usize])).unwrap();
        assert!(shares[of as usize] > 0.99, "{shares:?}");
        of
    }

    #[test]
    fn particles_are_what_they_physically_are() {
        let fine = scene::Classes::default().mist_radius as f32;
        assert_eq!(class(4.0 * fine, 0.0, -1.0, ALONE), Class::Drop);
        assert_eq!(class(4.0 * fine, 40.0 * fine, -1.0, ALONE), Class::Streak);
        assert_eq!(class(0.2 * fine, 0.0, -1.0, ALONE), Class::Mist);
        assert_eq!(class(4.0 * fine, 0.0, -1.0, CROWDED), Class::Sheet);
        assert_eq!(class(4.0 * fine, 0.0, 1.0, CROWDED), Class::Bubble);
        // Many within reach, but none that touches: drops.
        assert_eq!(class(4.0 * fine, 0.0, -1.0, Nearness { count: 40, distance: 16.0 * fine }), Class::Drop);
    }

    #[test]
    fn nothing_pops_as_a_particle_grows_speeds_up_and_dives() {
        let settings = scene::Classes::default();
        let fine = settings.mist_radius as f32;
        let at = |step: usize| {
            let t = step as f32 / 4000.0;
            let near = Nearness { count: (t * 60.0) as u32, distance: fine * (4.0 - 4.0 * t) };
            judge(fine * (0.3 + 2.0 * t), 8.0 * fine * t, fine * (6.0 * t - 4.0), near, &settings)
        };
        for step in 0..4000 {
            let (a, b) = (at(step), at(step + 1));
            for class in 0..5 {
                // Counts go by ones: a sixth of the way of one limit, by a third at most where it is steepest.
                assert!((a[class] - b[class]).abs() < 0.3, "{step}: {a:?} {b:?}");
            }
        }
    }

    #[test]
    fn a_cloud_of_all_kinds_is_told_apart() {
        let fine = scene::Classes::default().mist_radius as f32;
        let r = 3.0 * fine;
        let mut position: Vec<Vec3> =
            (0..1000).map(|k| 1.9 * r * Vec3::new((k % 10) as f32, (k / 10 % 10) as f32, (k / 100) as f32)).collect();
        position.extend([Vec3::splat(5.0), Vec3::new(0.0, -3.0, 0.0)]);
        let velocity = vec![Vec3::ZERO; position.len()];
        let radius = vec![r; position.len()];
        let judged = Judged { position: &position, velocity: &velocity, radius: &radius, exposure: 0.02 };
        let shares = shares(&judged, &scene::Classes::default(), |place| -1.0 - place.y);
        assert!(shares[555][Class::Sheet as usize] > 0.99, "{:?}", shares[555]);
        assert!(shares[1000][Class::Drop as usize] > 0.99);
        assert!(shares[1001][Class::Bubble as usize] > 0.99);
    }

    #[test]
    fn a_streak_grows_out_of_its_drop() {
        let settings = scene::Classes::default();
        let radius = 4.0 * settings.mist_radius as f32;
        let (mut last, mut grown) = (0.0, 0);
        for step in 0..3000 {
            let flown = 2.0 * radius * step as f32 / 1000.0;
            let mut shares = judge(radius, flown, -1.0, ALONE, &settings);
            let stretch = drawn_once(&mut shares);
            let [drop, streak] = [Class::Drop, Class::Streak].map(|class| shares[class as usize]);
            assert!((drop == 0.0) != (streak == 0.0) && (drop + streak - 1.0).abs() < 1e-5, "{shares:?}");
            let length = if streak > 0.0 { stretch * flown } else { 0.0 };
            assert!((0.0..0.08 * radius).contains(&(length - last)), "{flown}: {last} to {length}");
            last = length;
            grown += usize::from(streak > 0.0 && stretch < 1.0);
        }
        let mut diving = judge(radius, 6.0 * radius, 0.5 * radius, ALONE, &settings);
        assert_eq!((drawn_once(&mut diving), diving), (0.5, [0.0, 1.0, 0.0, 0.0, 0.0]));
        let mut still = judge(radius, 0.0, 0.75 * radius, ALONE, &settings);
        assert_eq!((drawn_once(&mut still), still), (1.0, [0.0, 0.0, 0.0, 0.0, 1.0]));
        assert!(grown > 500 && (last - 5.998 * radius).abs() < 1e-3 * radius, "{grown}, {last}");
    }

    proptest! {
        #[test]
        fn shares_add_up_to_one(
            radius in 1e-6f32..100.0, flown in 0.0f32..1e30, depth in -1e30f32..1e30, count in 0u32..1000, distance in 0.0f32..1e30,
        ) {
            let shares = judge(radius, flown, depth, Nearness { count, distance }, &scene::Classes::default());
            prop_assert!((shares.iter().sum::<f32>() - 1.0).abs() < 1e-5);
            prop_assert!(shares.iter().all(|share| (0.0..=1.0).contains(share)));
        }
    }
}
