//! Phase functions: into which directions a scattering event sends light. How often light scatters is in `medium`.
//!
//! All are functions of the angle of deflection alone, so they hold in both directions of time, and each is drawn exactly:
//! density and value are the same number, and weights are 1.

use std::f32::consts::{PI, TAU};

use glam::Vec3;

use crate::scene;

/// (1 - d) / (1 + d) for water's depolarisation ratio d = 0.09 (A. Morel, Optical properties of pure water and pure sea
/// water, 1974): what a right angle has less than forward and backward.
const ANISOTROPY: f32 = 0.835;

/// How a medium scatters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Phase {
    /// L. Henyey and J. Greenstein, Diffuse radiation in the galaxy, 1941.
    HenyeyGreenstein {
        /// Mean cosine of the deflection, -1 to 1 (exclusive); near 0.92 for natural waters (Petzold 1972).
        g: f32,
    },
    /// A sum of two of these (G. Kattawar, A three-parameter analytic phase function, 1975).
    TwoLobe {
        /// Mean cosine of the first lobe.
        forward: f32,
        /// Mean cosine of the second lobe, negative for light that is sent back.
        backward: f32,
        /// Share of the second lobe, 0 to 1.
        share: f32,
    },
    /// Fluctuations of the water's own density: 1 + 0.835 cos^2 (Morel 1974).
    PureWater,
}

impl Phase {
    /// The phase function of a scene's water.
    pub fn from_scene(water: &scene::Water) -> Self {
        let g = water.asymmetry as f32;
        match water.phase {
            scene::PhaseKind::HenyeyGreenstein => Self::HenyeyGreenstein { g },
            scene::PhaseKind::TwoLobe => {
                Self::TwoLobe { forward: g, backward: water.back_asymmetry as f32, share: water.back_share as f32 }
            }
            scene::PhaseKind::Pure => Self::PureWater,
        }
    }

    /// Density (1/sr) of a deflection; `cosine` is between the ways before and after, 1 for light that goes on.
    #[inline]
    pub fn value(self, cosine: f32) -> f32 {
        let cosine = cosine.clamp(-1.0, 1.0);
        match self {
            Self::HenyeyGreenstein { g } => henyey_greenstein(g, cosine),
            Self::TwoLobe { forward, backward, share } => {
                (1.0 - share) * henyey_greenstein(forward, cosine) + share * henyey_greenstein(backward, cosine)
            }
            Self::PureWater => (1.0 + ANISOTROPY * cosine * cosine) / (4.0 * PI * (1.0 + ANISOTROPY / 3.0)),
        }
    }

    /// A unit direction of travel after scattering; `incoming` is the unit direction of travel before. Its density is
    /// [`Phase::value`] of the cosine between them.
    #[inline]
    pub fn sample(self, incoming: Vec3, u: [f32; 2]) -> Vec3 {
        // 1 - cos, not cos: forward peaks are narrower than a cosine near 1 can tell.
        let fall = match self {
            Self::HenyeyGreenstein { g } => henyey_greenstein_fall(g, u[0]),
            // One number picks the lobe, and what is left of it the angle.
            Self::TwoLobe { forward, backward, share } => {
                if u[0] < share {
                    henyey_greenstein_fall(backward, (u[0] / share).min(1.0))
                } else {
                    henyey_greenstein_fall(forward, ((u[0] - share) / (1.0 - share)).min(1.0))
                }
            }
            Self::PureWater => 1.0 - pure_water_cosine(u[0]),
        };
        let fall = fall.clamp(0.0, 2.0);
        let side = (fall * (2.0 - fall)).sqrt();
        let (sin, cos) = (TAU * u[1]).sin_cos();
        let (across, along) = incoming.any_orthonormal_pair();
        ((1.0 - fall) * incoming + side * (cos * across + sin * along)).normalize()
    }

    /// Mean cosine of the deflection.
    pub fn mean_cosine(self) -> f32 {
        match self {
            Self::HenyeyGreenstein { g } => g,
            Self::TwoLobe { forward, backward, share } => (1.0 - share) * forward + share * backward,
            Self::PureWater => 0.0,
        }
    }
}

#[inline]
fn henyey_greenstein(g: f32, cosine: f32) -> f32 {
    // 1 + g^2 - 2 g cos, written so that a narrow peak keeps its digits.
    let square = (1.0 - g) * (1.0 - g) + 2.0 * g * (1.0 - cosine);
    (1.0 - g) * (1.0 + g) / (4.0 * PI * square * square.sqrt())
}

/// 1 - cos of a deflection for a uniform number; 2 at u = 0, 0 at u = 1.
///
/// The usual inversion, cos = (1 + g^2 - ((1 - g^2) / (1 + g x))^2) / 2 g with x = 2 u - 1, multiplied out: the division by
/// g goes, so that g = 0 is no special case, and so does the difference of near equals.
#[inline]
fn henyey_greenstein_fall(g: f32, u: f32) -> f32 {
    let x = 2.0 * u - 1.0;
    let below = 1.0 + g * x;
    2.0 * (1.0 - u) * (1.0 - g) * (1.0 - g) * (2.0 + g + g * x) / (2.0 * below * below)
}

/// Cosine of a deflection in pure water for a uniform number: the only real root of k c^3 / 3 + c = (2 u - 1)(1 + k / 3).
#[inline]
fn pure_water_cosine(u: f32) -> f32 {
    let (k, right) = (ANISOTROPY, (2.0 * u - 1.0) * (1.0 + ANISOTROPY / 3.0));
    // Depressed cubic with a positive linear term: one real root, by the hyperbolic sine of a third.
    (2.0 / k.sqrt() * ((1.5 * k.sqrt() * right).asinh() / 3.0).sinh()).clamp(-1.0, 1.0)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::testing::{Mean, Uniform, unit};
    use super::*;

    fn all() -> Vec<Phase> {
        let mut all: Vec<_> =
            [-0.9, -0.3, 0.0, 1e-4, 0.5, 0.92, 0.99].into_iter().map(|g| Phase::HenyeyGreenstein { g }).collect();
        all.push(Phase::TwoLobe { forward: 0.92, backward: -0.5, share: 0.1 });
        all.push(Phase::TwoLobe { forward: 0.8, backward: -0.2, share: 0.0 });
        all.push(Phase::TwoLobe { forward: 0.8, backward: -0.2, share: 1.0 });
        all.push(Phase::PureWater);
        all
    }

    /// Integral of the value times `weight` of the cosine over the sphere; cells crowd at both ends.
    fn integral(phase: Phase, weight: impl Fn(f64) -> f64) -> f64 {
        let cells = 20_000;
        (0..cells)
            .map(|cell| {
                let edge = |cell: i32| {
                    let s = 2.0 * f64::from(cell) / f64::from(cells) - 1.0;
                    // Dense near +-1: 1 - cos falls with the cube of what is left.
                    s.signum() * (1.0 - (1.0 - s.abs()).powi(3))
                };
                let (a, b) = (edge(cell), edge(cell + 1));
                let middle = 0.5 * (a + b);
                f64::from(phase.value(middle as f32)) * weight(middle) * (b - a) * std::f64::consts::TAU
            })
            .sum()
    }

    #[test]
    fn values_add_up_to_one_and_have_their_mean_cosine() {
        for phase in all() {
            assert!((integral(phase, |_| 1.0) - 1.0).abs() < 1e-3, "{phase:?}: {}", integral(phase, |_| 1.0));
            let mean = integral(phase, |cosine| cosine);
            assert!((mean - f64::from(phase.mean_cosine())).abs() < 1e-3, "{phase:?}: {mean}");
        }
    }

    #[test]
    fn samples_follow_the_value() {
        for phase in all() {
            let mut random = Uniform::new(21);
            let incoming = unit(-0.3, 2.0);
            let (mut cosine, mut square) = (Mean::default(), Mean::default());
            let (mut sphere, mut side) = (Mean::default(), Mean::default());
            for _ in 0..100_000 {
                let out = phase.sample(incoming, random.two());
                assert!((out.length() - 1.0).abs() < 1e-6);
                let c = f64::from(out.dot(incoming));
                cosine.add(c);
                square.add(c * c);
                // One over the density, kept to a band of deflections where it is not enormous: the band's solid angle.
                let band = (0.0..0.8).contains(&c);
                sphere.add(if band { 1.0 / f64::from(phase.value(c as f32)) } else { 0.0 });
                side.add(f64::from(out.dot(incoming.any_orthonormal_vector())));
            }
            assert!(cosine.agrees(f64::from(phase.mean_cosine()), 4.0), "{phase:?}: {}", cosine.value());
            assert!((square.value() - integral(phase, |c| c * c)).abs() < 4.0 * square.error() + 1e-3, "{phase:?}");
            assert!(sphere.agrees(0.8 * std::f64::consts::TAU, 4.0), "{phase:?}: {}", sphere.value());
            assert!(side.agrees(0.0, 4.0) || side.value().abs() < 4.0 * side.error(), "{phase:?}");
        }
    }

    #[test]
    fn numbers_and_cosines_are_each_others_inverse() {
        // The share of light deflected by more than an angle is u itself: exact inversion, both for peaks and the cubic.
        for phase in all().into_iter().filter(|phase| !matches!(phase, Phase::TwoLobe { .. })) {
            for step in 1..20 {
                let u = step as f32 / 20.0;
                let out = phase.sample(Vec3::Y, [u, 0.3]);
                let bound = f64::from(out.y);
                let below = integral(phase, |cosine| f64::from(u8::from(cosine < bound)));
                assert!((below - f64::from(u)).abs() < 3e-3, "{phase:?} {u}: {below}");
            }
        }
    }

    #[test]
    fn a_fiftieth_of_what_water_scatters_goes_back() {
        // Petzold's b_b / b is 0.0183 (0.01829 b + 0.00006 1/m in Premoze and Ashikhmin 2001).
        let back = integral(Phase::from_scene(&scene::Water::default()), |cosine| f64::from(u8::from(cosine < 0.0)));
        assert!((back - 0.018).abs() < 5e-4, "{back}");
        assert!((integral(Phase::PureWater, |cosine| f64::from(u8::from(cosine < 0.0))) - 0.5).abs() < 1e-4);
    }

    proptest! {
        #[test]
        fn no_number_gives_anything_but_directions(
            g in -0.99f32..=0.99, back in -0.99f32..=0.99, share in 0.0f32..=1.0, u in 0.0f32..1.0, v in 0.0f32..1.0,
            cosine in -1.1f32..1.1, up in -1.0f32..=1.0,
        ) {
            let two = Phase::TwoLobe { forward: g, backward: back, share };
            for phase in [Phase::HenyeyGreenstein { g }, two, Phase::PureWater] {
                prop_assert!(phase.value(cosine).is_finite() && phase.value(cosine) > 0.0);
                for u in [u, 0.0, 1.0 - 0.5 * f32::EPSILON] {
                    let out = phase.sample(unit(up, v), [u, v]);
                    prop_assert!((out.length() - 1.0).abs() < 1e-6);
                }
            }
        }
    }
}
