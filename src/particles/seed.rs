//! One number per particle that stays with it from frame to frame: what is drawn by chance (its size, whether it stands for its
//! neighbours as well) is drawn by it, so that nothing flickers.
//!
//! What is drawn by it is not here.

use crate::math::scramble;
use crate::{scene, state};

/// Width (s) of the steps of time in which births are told apart. Ages in files are single precision: after a hundred
/// seconds they are wrong by 4e-6 s, so that one particle in a thousand changes its seed in such a frame, far fewer at first.
const BIRTH: f64 = 1.0 / 128.0;

/// Width (m) of the squares in which births are told apart, on the same terms: 30 m/s over ten seconds are known within
/// 2e-5 m.
const ORIGIN: f64 = 1.0 / 16.0;

/// Where the steps begin: frames, steps of simulations and their grids fall on round numbers, borders do not.
const ASIDE: f64 = 0.381_966;

/// What a number is drawn for: each is as good as independent of the others.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Purpose {
    /// Its size among those of its kind.
    Size = 1,
    /// Whether it is drawn when many are too small to be.
    Detail = 2,
    /// Whether it is drawn when many are too faint to be.
    Faint = 3,
    /// What its texture looks like.
    Texture = 4,
}

/// The seed of particle `index` of a frame at `time` (s).
///
/// By its `id` where the file has them. Else by what does not change in flight: its mass, when it broke free (time less age),
/// and from where, along x and z alone, along which nothing pulls (place less velocity times age). A particle that bounces, or
/// loses mass in the water, becomes another one by that; those of one mass that break free within 1/128 s and 1/16 m are one and the same.
pub fn seed(particles: &state::Particles, index: usize, time: f64) -> u32 {
    let word = match &particles.id {
        Some(id) => id[index],
        None => {
            let age = particles.age[index];
            let step = |value: f64, width: f64| (value / width + ASIDE).floor().to_bits();
            let from = [0, 2].map(|axis| particles.position[index][axis] - particles.velocity[index][axis] * age);
            let birth = scramble(step(time - age, BIRTH) ^ scramble(particles.mass[index].to_bits()));
            scramble(scramble(step(from[0], ORIGIN) ^ birth) ^ step(from[1], ORIGIN))
        }
    };
    (scramble(word) >> 32) as u32
}

/// A uniform number, above 0 and under 1, for a purpose.
pub fn uniform(seed: u32, purpose: Purpose) -> f64 {
    let number = scramble(u64::from(seed) | (purpose as u64) << 32) >> 32;
    (number as f64 + 0.5) / (1u64 << 32) as f64
}

/// One of several uniform numbers, 0 or more and under 1, for a purpose.
pub(super) fn several(seed: u32, purpose: Purpose, which: u32) -> f32 {
    let number = scramble(u64::from(seed) | (purpose as u64) << 32 | u64::from(which) << 40);
    // The upper 24 bits, which single precision holds.
    (number >> 40) as f32 / (1u32 << 24) as f32
}

/// A number of the normal distribution of mean 0 and deviation 1 (G. Box and M. Muller, A note on the generation of random
/// normal deviates, 1958).
fn normal(seed: u32, purpose: Purpose) -> f64 {
    let number = scramble(u64::from(seed) | (purpose as u64) << 32);
    let [radial, turn] = [number >> 32, number & 0xffff_ffff].map(|part| (part as f64 + 0.5) / (1u64 << 32) as f64);
    (-2.0 * radial.ln()).sqrt() * (std::f64::consts::TAU * turn).cos()
}

/// Factor on a particle's radius where radii are spread log-normally with a deviation `spread` of their logarithm.
///
/// The mean of its cube is 1: that of exp(3 (m + s z)) is exp(3 m + 9 s^2 / 2), so that m is -3 s^2 / 2.
pub fn size_factor(seed: u32, spread: f64) -> f64 {
    if spread == 0.0 {
        return 1.0;
    }
    (spread * normal(seed, Purpose::Size) - 1.5 * spread * spread).exp()
}

/// Deviation of the radii's logarithm in each class, in the order of [`Class::ALL`](super::Class::ALL). A sheet joins drops of one
/// size, the mean one's: of them it is the plain one.
pub fn size_spreads(settings: &scene::Particles) -> [f64; 5] {
    let scene::SizeSpreads { spray, streaks, mist, bubbles } = settings.size_spreads;
    [spray, streaks, mist, None, bubbles].map(|spread| spread.unwrap_or(settings.size_spread))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Drops of one spring, in single precision as files have them, `time` seconds after the first frame; those of a row broke
    /// free together.
    fn flight(count: u32, time: f64) -> state::Particles {
        let mut particles = state::Particles::default();
        for k in 0..count {
            let share = |salt: u64| (scramble(u64::from(k) ^ salt << 40) >> 40) as f64 / f64::from(1 << 24);
            let born = f64::from(k / 10) / 240.0 - 3.0;
            let age = time - born;
            let velocity = [6.0 * share(1) - 3.0, 4.0 * share(2) - 9.81 * age, 6.0 * share(3) - 3.0];
            let from = [500_000.0 + 0.3 * f64::from(k % 10), 2.0, 40.0 * share(4)];
            let fall = 0.5 * 9.81 * age * age;
            let single = |value: f64| f64::from(value as f32);
            particles.position.push([
                from[0] + velocity[0] * age,
                from[1] + velocity[1] * age + fall,
                from[2] + velocity[2] * age,
            ]);
            particles.velocity.push(velocity.map(single));
            particles.mass.push(single(0.01));
            particles.age.push(single(age));
        }
        particles
    }

    #[test]
    fn a_seed_stays_with_its_particle_in_flight() {
        let seeds = |frame: u32| -> Vec<u32> {
            let time = f64::from(frame) / 24.0;
            let particles = flight(2000, time);
            (0..2000).map(|index| seed(&particles, index, time)).collect()
        };
        let first = seeds(0);
        for frame in 1..24 {
            let changed = seeds(frame).iter().zip(&first).filter(|(now, then)| now != then).count();
            assert!(changed <= 4, "{changed} of 2000 have another seed in frame {frame}");
        }
        let mut different = first;
        different.sort_unstable();
        different.dedup();
        assert!(different.len() > 1990, "{} seeds of 2000", different.len());
    }

    #[test]
    fn a_file_s_own_numbers_win_and_neighbours_differ() {
        let mut particles = flight(1000, 0.0);
        particles.id = Some((7..1007).collect());
        let before: Vec<u32> = (0..1000).map(|index| seed(&particles, index, 0.0)).collect();
        particles.position.reverse();
        particles.mass.fill(3.0);
        let after: Vec<u32> = (0..1000).map(|index| seed(&particles, index, 9.0)).collect();
        assert_eq!(before, after);
        // Numbers in a row are spread evenly: of ten parts each has its tenth.
        for purpose in [Purpose::Size, Purpose::Detail] {
            for part in 0..10 {
                let within = |seed: &&u32| (uniform(**seed, purpose) * 10.0) as u32 == part;
                let count = before.iter().filter(within).count();
                assert!((70..130).contains(&count), "{purpose:?}: {count} of 1000 in part {part}");
            }
        }
    }

    #[test]
    fn sizes_are_spread_log_normally_about_the_same_water() {
        let count = 200_000;
        for spread in [0.1, 0.3, 0.5] {
            let factors: Vec<f64> = (0..count).map(|k| size_factor((scramble(k) >> 32) as u32, spread)).collect();
            let mean = |of: &dyn Fn(f64) -> f64| factors.iter().map(|&factor| of(factor)).sum::<f64>() / count as f64;
            let volume = mean(&|factor| factor.powi(3));
            assert!((volume - 1.0).abs() < 0.01, "{spread}: {volume}");
            let middle = mean(&f64::ln);
            let deviation = mean(&|factor| (factor.ln() - middle).powi(2)).sqrt();
            assert!((middle + 1.5 * spread * spread).abs() < 0.003 && (deviation / spread - 1.0).abs() < 0.01);
        }
        assert_eq!(size_factor(77, 0.0), 1.0);
    }

    #[test]
    fn a_class_without_a_spread_of_its_own_has_that_of_all() {
        let size_spreads = scene::SizeSpreads { streaks: Some(0.4), bubbles: Some(0.0), ..Default::default() };
        let settings = scene::Particles { size_spread: 0.2, size_spreads, ..Default::default() };
        assert_eq!(super::size_spreads(&settings), [0.2, 0.4, 0.2, 0.2, 0.0]);
    }

    #[test]
    fn no_file_gives_a_seed_without_a_number() {
        let particles = state::Particles {
            position: vec![[1e300; 3], [0.0; 3]],
            velocity: vec![[1e300; 3], [1e300; 3]],
            mass: vec![0.0, f64::MAX],
            age: vec![f64::MAX, 0.0],
            id: None,
        };
        for index in 0..2 {
            let own = seed(&particles, index, 1e300);
            assert!((0.0..1.0).contains(&uniform(own, Purpose::Detail)));
            assert!(size_factor(own, 2.0) > 0.0 && size_factor(own, 2.0).is_finite());
        }
    }
}
