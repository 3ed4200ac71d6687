//! Where light scatters, and how much is left of it, in a medium whose density varies along a ray.
//!
//! Free of bias whatever the density, as long as it stays under the majorant that the caller gives; a density over it is an
//! error, never a silent bias. What is the same everywhere needs none of this: `medium` has closed forms.

use glam::Vec3;

use super::OpticsError;

/// Where a path collides, or that it passes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Collision {
    /// It collides; the caller multiplies by the albedo there to go on with what is scattered.
    At {
        /// Metres from the start.
        distance: f32,
        /// Factor on the path's throughput: its mean is extinction times transmittance, over the density of distances.
        weight: Vec3,
    },
    /// It reaches the end.
    Passed {
        /// Factor on the path's throughput; its mean (0 for collisions) is the transmittance.
        weight: Vec3,
    },
}

/// Draws the next collision within `limit` metres (delta tracking: E. Woodcock et al., 1965).
///
/// `extinction` gives the coefficients (1/m) at a distance, `majorant` (1/m) is at least as large as any of them. The three
/// channels share one walk: a tentative collision is real with the probability that the light still under way, by channel,
/// gives it, and weights make up for the rest (P. Kutz et al., Spectral and decomposition tracking for rendering
/// heterogeneous volumes, 2017, section 5.1, history-aware). The sum of `throughput` times weight never changes on the way. `random`
/// gives uniform numbers in 0..1, two for every tentative collision.
///
/// # Errors
/// An extinction outside of 0 to `majorant`, or a walk without an end: more than 2^24 steps of mean length, an infinite `limit` among them.
pub fn delta_track(
    throughput: Vec3,
    majorant: f32,
    extinction: impl Fn(f32) -> Vec3,
    random: &mut dyn FnMut() -> f32,
    limit: f32,
) -> Result<Collision, OpticsError> {
    let mut weight = Vec3::ONE;
    let mut walk = Walk::new(majorant, limit)?;
    // A path that carries nothing is walked as if it were white: its weights are right for any.
    let light = if throughput.abs().max_element() > 0.0 { throughput.abs() } else { Vec3::ONE };
    while let Some(distance) = walk.next(random()) {
        let share = walk.share(extinction(distance), distance)?;
        let carried = light * weight;
        let real = carried.dot(share) / carried.element_sum();
        if random() < real {
            return Ok(Collision::At { distance, weight: weight * share / real });
        }
        // real is under 1 here, since random numbers are.
        weight *= (Vec3::ONE - share) / (1.0 - real);
    }
    Ok(Collision::Passed { weight })
}

/// Estimates the share of light left after `limit` metres (ratio tracking: J. Novak et al., Residual ratio tracking for
/// estimating attenuation in participating media, 2014).
///
/// Its mean is the transmittance; each estimate lies in 0 to 1. Arguments as of [`delta_track`], one random number for every
/// tentative collision.
///
/// # Errors
/// As [`delta_track`].
pub fn ratio_track(
    majorant: f32,
    extinction: impl Fn(f32) -> Vec3,
    random: &mut dyn FnMut() -> f32,
    limit: f32,
) -> Result<Vec3, OpticsError> {
    let mut left = Vec3::ONE;
    let mut walk = Walk::new(majorant, limit)?;
    while let Some(distance) = walk.next(random()) {
        left *= Vec3::ONE - walk.share(extinction(distance), distance)?;
        if left == Vec3::ZERO {
            break;
        }
    }
    Ok(left)
}

/// Tentative collisions, evenly distributed by the majorant.
struct Walk {
    majorant: f32,
    limit: f32,
    distance: f32,
}

impl Walk {
    fn new(majorant: f32, limit: f32) -> Result<Self, OpticsError> {
        // After 2^24 mean steps single precision cannot tell one step further from the place itself.
        let mean_steps = if majorant == 0.0 { 0.0 } else { majorant * limit };
        if majorant >= 0.0 && mean_steps <= 2.0 / f32::EPSILON {
            Ok(Self { majorant, limit, distance: 0.0 })
        } else {
            Err(OpticsError::EndlessWalk { majorant, limit })
        }
    }

    fn next(&mut self, u: f32) -> Option<f32> {
        if self.majorant == 0.0 {
            return None;
        }
        self.distance -= (-u).ln_1p() / self.majorant;
        (self.distance < self.limit).then_some(self.distance)
    }

    /// Extinction as a share of the majorant.
    fn share(&self, extinction: Vec3, distance: f32) -> Result<Vec3, OpticsError> {
        if extinction.cmpge(Vec3::ZERO).all() && extinction.cmple(Vec3::splat(self.majorant)).all() {
            return Ok(extinction / self.majorant);
        }
        Err(OpticsError::OverMajorant { extinction: extinction.to_array(), distance, majorant: self.majorant })
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::{Mean, Uniform};
    use super::*;

    /// Density that falls with distance as exp(-x / 2), scaled by channel; and its optical depth.
    const SCALE: Vec3 = Vec3::new(0.9, 0.3, 0.02);
    fn profile(distance: f32) -> Vec3 {
        SCALE * (-distance / 2.0).exp()
    }
    fn depth(limit: f64) -> [f64; 3] {
        SCALE.to_array().map(|scale| f64::from(scale) * 2.0 * (1.0 - (-limit / 2.0).exp()))
    }

    fn transmittances(
        majorant: f32,
        limit: f32,
        count: usize,
        extinction: impl Fn(f32) -> Vec3 + Copy,
    ) -> ([Mean; 3], [Mean; 3]) {
        let mut random = Uniform::new(u64::from(limit.to_bits()));
        let (mut by_ratio, mut by_delta) = ([Mean::default(); 3], [Mean::default(); 3]);
        for _ in 0..count {
            let left = ratio_track(majorant, extinction, &mut || random.one(), limit).unwrap();
            let collision =
                delta_track(Vec3::new(1.0, 0.7, 0.4), majorant, extinction, &mut || random.one(), limit).unwrap();
            let passed = if let Collision::Passed { weight } = collision { weight } else { Vec3::ZERO };
            for channel in 0..3 {
                by_ratio[channel].add(f64::from(left[channel]));
                by_delta[channel].add(f64::from(passed[channel]));
            }
        }
        (by_ratio, by_delta)
    }

    #[test]
    fn an_exponential_density_has_its_closed_optical_depth() {
        for limit in [0.5f32, 2.0, 12.0] {
            for majorant in [0.9, 2.5] {
                let (ratio, delta) = transmittances(majorant, limit, 40_000, profile);
                let truth = depth(f64::from(limit)).map(|depth| (-depth).exp());
                for channel in 0..3 {
                    // 36 comparisons: one in a hundred of such sets has a larger deviation than 3.5 in one of them.
                    for (name, mean) in [("ratio", ratio[channel]), ("delta", delta[channel])] {
                        assert!(
                            mean.agrees(truth[channel], 3.5),
                            "{name} {limit} {majorant} {channel}: {} +- {}, truth {}",
                            mean.value(),
                            mean.error(),
                            truth[channel]
                        );
                    }
                    assert!(ratio[channel].error() <= delta[channel].error() * 1.01);
                }
            }
        }
    }

    #[test]
    fn a_density_that_does_not_vary_is_beer_lambert() {
        let extinction = Vec3::new(0.5, 0.2, 0.0);
        let (ratio, delta) = transmittances(0.5, 3.0, 40_000, |_| extinction);
        for channel in 0..3 {
            let truth = f64::from(-3.0 * extinction[channel]).exp();
            assert!(ratio[channel].agrees(truth, 3.0) && delta[channel].agrees(truth, 3.0), "{channel}");
        }
        assert_eq!(ratio[2].error(), 0.0);
    }

    #[test]
    fn collisions_lie_where_light_is_lost_and_weights_stay_small() {
        // The mean of weight times g(distance) is the integral of g times extinction times transmittance: for g = 1, all
        // that is lost; for g = distance, by quadrature.
        let (limit, light) = (6.0f32, Vec3::new(0.2, 1.0, 3.0));
        let mut random = Uniform::new(77);
        let (mut lost, mut place) = ([Mean::default(); 3], [Mean::default(); 3]);
        for _ in 0..60_000 {
            let collision = delta_track(light, 0.9, profile, &mut || random.one(), limit).unwrap();
            let (distance, weight) = match collision {
                Collision::At { distance, weight } => (distance, weight),
                Collision::Passed { weight } => {
                    assert!(((light * weight).element_sum() / light.element_sum() - 1.0).abs() < 1e-3);
                    (0.0, Vec3::ZERO)
                }
            };
            assert!((light * weight).element_sum() <= light.element_sum() * 1.001);
            for channel in 0..3 {
                lost[channel].add(f64::from(weight[channel]));
                place[channel].add(f64::from(weight[channel] * distance));
            }
        }
        for channel in 0..3 {
            let steps = 10_000;
            let truth: f64 = (0..steps)
                .map(|step| {
                    let x = (f64::from(step) + 0.5) / f64::from(steps) * f64::from(limit);
                    let sigma = f64::from(SCALE[channel]) * (-x / 2.0).exp();
                    x * sigma * (-depth(x)[channel]).exp() * f64::from(limit) / f64::from(steps)
                })
                .sum();
            let all = 1.0 - (-depth(f64::from(limit))[channel]).exp();
            assert!(lost[channel].agrees(all, 3.5), "{channel}: {} {all}", lost[channel].value());
            assert!(place[channel].agrees(truth, 3.5), "{channel}: {} {truth}", place[channel].value());
        }
    }

    #[test]
    fn what_cannot_be_walked_is_an_error() {
        let mut random = Uniform::new(1);
        let thick = delta_track(Vec3::ONE, 0.1, |_| Vec3::splat(0.2), &mut || random.one(), 1e3);
        assert!(matches!(thick, Err(OpticsError::OverMajorant { .. })), "{thick:?}");
        for extinction in [Vec3::new(0.0, -1e-6, 0.0), Vec3::new(f32::NAN, 0.0, 0.0)] {
            let told = ratio_track(0.1, |_| extinction, &mut || random.one(), 1e3).unwrap_err().to_string();
            assert!(told.contains("0.1"), "{told}");
        }
        for (majorant, limit) in [(1.0, f32::INFINITY), (f32::NAN, 1.0), (-1.0, 1.0), (1.0, f32::NAN), (f32::MAX, 1e30)]
        {
            let told = ratio_track(majorant, |_| Vec3::ZERO, &mut || random.one(), limit);
            assert!(matches!(told, Err(OpticsError::EndlessWalk { .. })), "{majorant} {limit}: {told:?}");
        }
        // Clear water has no collisions, however far.
        assert_eq!(ratio_track(0.0, |_| Vec3::ZERO, &mut || random.one(), f32::INFINITY).unwrap(), Vec3::ONE);
    }
}
