//! Water as a medium: what a metre of it absorbs and scatters, and where along a ray light scatters next.
//!
//! The same everywhere; what varies from place to place is walked by `tracking`. Directions after scattering are
//! `phase`'s, the coefficients of named waters stand with the scene's keys.

use glam::Vec3;

use crate::scene;

use super::{absorb::transmittance, phase::Phase};

/// A homogeneous medium.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Medium {
    /// Share of light absorbed per metre.
    pub absorption: Vec3,
    /// Share of light scattered per metre.
    pub scattering: Vec3,
    /// Into which directions.
    pub phase: Phase,
}

/// What happens to a path along a ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Step {
    /// It scatters on its way.
    Scatter {
        /// Metres from the start.
        distance: f32,
        /// Factor on the path's throughput: scattering times transmittance over density.
        weight: Vec3,
    },
    /// It reaches the end.
    Passed {
        /// Factor on the path's throughput: transmittance over probability.
        weight: Vec3,
    },
}

impl Medium {
    /// The medium of a scene's water.
    pub fn from_scene(water: &scene::Water) -> Self {
        let color = |values: [f64; 3]| Vec3::from_array(values.map(|value| value as f32));
        Self {
            absorption: color(water.absorption),
            scattering: color(water.scattering),
            phase: Phase::from_scene(water),
        }
    }

    /// Share of light that leaves a ray per metre, one way or the other.
    #[inline]
    pub fn extinction(&self) -> Vec3 {
        self.absorption + self.scattering
    }

    /// Share of what leaves a ray that is scattered; 0 where nothing leaves it.
    #[inline]
    pub fn albedo(&self) -> Vec3 {
        let share = |scattered: f32, all: f32| if all > 0.0 { scattered / all } else { 0.0 };
        let (s, e) = (self.scattering, self.extinction());
        Vec3::new(share(s.x, e.x), share(s.y, e.y), share(s.z, e.z))
    }

    /// Whether it scatters at all.
    #[inline]
    pub fn scatters(&self) -> bool {
        self.scattering.max_element() > 0.0
    }

    /// Share of light that is left after `distance` metres.
    #[inline]
    pub fn transmittance(&self, distance: f32) -> Vec3 {
        transmittance(self.extinction(), distance)
    }

    /// Draws where a path scatters next, or that it reaches `limit` (metres, infinite as well) before.
    ///
    /// One channel's extinction draws the distance; the weight divides by the density that all three together have for it
    /// (the balance heuristic over channels: A. Wilkie et al., Hero wavelength spectral sampling, 2014). A channel is picked
    /// by `throughput` times albedo for one half and by `throughput` alone for the other: the first keeps weights of
    /// scattering small, the second those of passing, and no channel that carries light is ever left without density. So
    /// the product of throughput and weight stays within twice the sum of the throughput. A medium that only absorbs takes no chances: it
    /// passes, with its transmittance.
    #[inline]
    pub fn sample_distance(&self, throughput: Vec3, u: [f32; 2], limit: f32) -> Step {
        if !self.scatters() {
            return Step::Passed { weight: self.transmittance(limit) };
        }
        let extinction = self.extinction();
        let share = self.channels(throughput);
        let channel = if u[0] < share.x {
            0
        } else if u[0] < share.x + share.y || share.z == 0.0 {
            1
        } else {
            2
        };
        // By rounding u may end in a channel that is never meant to be picked: its neighbour takes it.
        let channel = if share[channel] > 0.0 { channel } else { share.max_position() };
        // A clear channel goes any distance.
        let distance = if extinction[channel] > 0.0 { -(-u[1]).ln_1p() / extinction[channel] } else { f32::INFINITY };
        if distance < limit {
            let left = transmittance(extinction, distance);
            let density = share.dot(extinction * left);
            Step::Scatter { distance, weight: self.scattering * left / density }
        } else {
            let left = self.transmittance(limit);
            Step::Passed { weight: left / share.dot(left) }
        }
    }

    /// Probability of each channel to draw a distance.
    #[inline]
    fn channels(&self, throughput: Vec3) -> Vec3 {
        // Shares of the largest first: sums of throughputs may overflow, or vanish.
        let most = throughput.abs().max_element();
        let light = if most > 0.0 && most.is_finite() { throughput.abs() / most } else { Vec3::ONE };
        let even = light / light.element_sum();
        let scattered = light * self.albedo();
        let sum = scattered.element_sum();
        if sum > 0.0 { 0.5 * (even + scattered / sum) } else { even }
    }
}

#[cfg(test)]
mod tests;
