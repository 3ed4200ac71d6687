//! Random numbers by counter: a number is a function of seed, particle and purpose. There is no state to keep, so they
//! are the same at any thread count and after any resumption.
//!
//! The mixer is SplitMix64's (Steele, Lea and Flood 2014, Fast splittable pseudorandom number generators).

use crate::math::{STEP, finish};

/// What a particle's number is for: no two purposes share a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Purpose {
    /// Place along the face.
    Along = 1,
    /// Height in the face.
    Height = 2,
    /// Moment at which it broke free.
    Moment = 3,
    /// Turbulent velocity along x, y, z.
    GustX = 4,
    /// See [`Purpose::GustX`].
    GustY = 5,
    /// See [`Purpose::GustX`].
    GustZ = 6,
}

/// A number of [0, 1), uniform over the multiples of 2^-53.
pub(super) fn uniform(seed: u64, id: u64, purpose: Purpose) -> f64 {
    // Odd factors are one to one on 64 bits, and a finisher lies between any two, so that no line of ids meets a line of purposes.
    let start = finish(seed.wrapping_add(1).wrapping_mul(STEP));
    let bits = finish(finish(start ^ id.wrapping_mul(0xd134_2543_de82_ef95)) ^ purpose as u64);
    (bits >> 11) as f64 * 2f64.powi(-53)
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: [Purpose; 6] =
        [Purpose::Along, Purpose::Height, Purpose::Moment, Purpose::GustX, Purpose::GustY, Purpose::GustZ];

    #[test]
    fn numbers_are_uniform_and_purposes_are_independent() {
        const COUNT: u64 = 20_000;
        for seed in [0, 1, u64::MAX] {
            for (index, &one) in ALL.iter().enumerate() {
                let mut bins = [0u32; 16];
                for id in 0..COUNT {
                    let value = uniform(seed, id, one);
                    assert!((0.0..1.0).contains(&value));
                    bins[(value * 16.0) as usize] += 1;
                }
                let expected = COUNT as f64 / 16.0;
                let chi: f64 = bins.iter().map(|&n| (f64::from(n) - expected).powi(2) / expected).sum();
                // 15 degrees of freedom: 44.3 is passed once in ten thousand.
                assert!(chi < 44.3, "seed {seed}, purpose {one:?}: {chi}");
                for &other in &ALL[index + 1..] {
                    let product: f64 =
                        (0..COUNT).map(|id| (uniform(seed, id, one) - 0.5) * (uniform(seed, id, other) - 0.5)).sum();
                    // The sum's standard deviation is sqrt(COUNT) / 12; four and a half of them.
                    assert!(product.abs() < 4.5 * (COUNT as f64).sqrt() / 12.0, "{one:?} {other:?}: {product}");
                }
            }
        }
    }

    #[test]
    fn seeds_and_neighbouring_particles_differ() {
        assert_ne!(uniform(0, 0, Purpose::Along), uniform(1, 0, Purpose::Along));
        assert_ne!(uniform(0, 0, Purpose::Along), uniform(0, 1, Purpose::Along));
        assert_ne!(uniform(0, u64::MAX, Purpose::Along), uniform(0, u64::MAX - 1, Purpose::Along));
    }
}
