//! Bubbles under foam: extinction that falls off with depth and varies with the foam above, walked collision by collision.

use glam::Vec3;

use super::{
    super::{
        batches::{Carrier, Scratch},
        world::World,
    },
    Purpose,
};
use crate::{
    math::{STEP, scramble},
    optics::{Collision, Phase, delta_track, ratio_track},
};

/// Into which directions bubbles scatter: mostly on, as large spheres of a lesser index do (mean cosine about 0.85;
/// A. Kokhanovsky, Optical properties of bubbles, 2003).
pub(super) const PHASE: Phase = Phase::HenyeyGreenstein { g: 0.85 };

/// Uniform numbers without an end, for walks of unknown length.
pub(super) struct Numbers(u64);

impl Numbers {
    /// Those that belong to two numbers and a salt.
    pub(super) fn new(seed: [f32; 2], salt: u32) -> Self {
        let [a, b] = seed.map(f32::to_bits);
        Self(scramble(u64::from(a) << 32 | u64::from(b)).wrapping_add(u64::from(salt)))
    }

    pub(super) fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_add(STEP);
        // 24 bits fill single precision's 0..1 evenly.
        (scramble(self.0) >> 40) as f32 * (1.0 / 16_777_216.0)
    }
}

impl World<'_> {
    /// Numbers of their own for a carrier's walk; `salt` keeps the walks of one event apart.
    fn walk_numbers(&self, carrier: &Carrier, salt: u32, scratch: &Scratch) -> Numbers {
        let [a, b, ..] = self.numbers(carrier, Purpose::Cover, scratch);
        Numbers::new([a, b], salt)
    }

    /// Extinction of bubbles (1/m) and albedo at a point in the water.
    fn bubbles_at(&self, point: Vec3) -> (f32, f32) {
        let Some(aeration) = self.matter.bubbles(point.x, point.z) else { return (0.0, 0.0) };
        let depth = self.matter.water_level(point.x, point.z).map_or(0.0, |level| (level - point.y).max(0.0));
        (aeration.extinction * (-depth / aeration.depth).exp(), aeration.albedo)
    }

    /// Where a path collides with a bubble within `limit` metres, and the albedo there.
    pub(super) fn meet_bubbles(
        &self,
        carrier: &Carrier,
        origin: Vec3,
        direction: Vec3,
        limit: f32,
        scratch: &mut Scratch,
    ) -> Option<(f32, f32)> {
        if self.most_bubbles <= 0.0 {
            return None;
        }
        let mut numbers = self.walk_numbers(carrier, 0, scratch);
        let extinction = |t: f32| Vec3::splat(self.bubbles_at(origin + t * direction).0.min(self.most_bubbles));
        match delta_track(Vec3::ONE, self.most_bubbles, extinction, &mut || numbers.next(), limit) {
            // All channels alike: weights are 1.
            Ok(Collision::At { distance, .. }) => Some((distance, self.bubbles_at(origin + distance * direction).1)),
            Ok(Collision::Passed { .. }) => None,
            Err(_) => {
                scratch.paths.endless += 1;
                None
            }
        }
    }

    /// Share of light that bubbles leave over `distance` metres.
    pub(super) fn past_bubbles(
        &self,
        carrier: &Carrier,
        origin: Vec3,
        direction: Vec3,
        distance: f32,
        salt: u32,
        scratch: &mut Scratch,
    ) -> f32 {
        if self.most_bubbles <= 0.0 {
            return 1.0;
        }
        let mut numbers = self.walk_numbers(carrier, salt, scratch);
        let extinction = |t: f32| Vec3::splat(self.bubbles_at(origin + t * direction).0.min(self.most_bubbles));
        match ratio_track(self.most_bubbles, extinction, &mut || numbers.next(), distance) {
            Ok(left) => left.x,
            Err(_) => {
                scratch.paths.endless += 1;
                1.0
            }
        }
    }
}
