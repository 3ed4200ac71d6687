//! The water itself on a path: how far light gets, where it is scattered, and the light that reaches it there.

use glam::Vec3;

use super::{
    super::{
        batches::{Asked, Carrier, PathState, Scratch},
        cryptomatte::Sight,
        film::Layer,
        world::World,
    },
    Purpose, bubbles,
    by_surface::Asker,
};
use crate::optics::{Phase, Step};

impl World<'_> {
    /// Takes a path through `reach` metres of water. False if it was scattered on the way: it goes on from there by itself.
    pub(super) fn pass_water(
        &self,
        carrier: &mut Carrier,
        origin: Vec3,
        direction: Vec3,
        reach: f32,
        scratch: &mut Scratch,
    ) -> bool {
        if !self.medium.scatters() && self.most_bubbles <= 0.0 {
            carrier.throughput *= self.medium.transmittance(reach);
            return true;
        }
        let numbers = self.numbers(carrier, Purpose::Murk, scratch);
        let u = [numbers[0], numbers[1]];
        let step = self.medium.sample_distance(carrier.throughput, u, reach);
        let end = if let Step::Scatter { distance, .. } = step { distance } else { reach };
        // Water and bubbles take their chances apart: whichever comes first.
        let bubble = self.meet_bubbles(carrier, origin, direction, end, scratch);
        let (distance, weight, phase) = match (bubble, step) {
            (Some((distance, albedo)), _) => match self.medium.sample_distance(carrier.throughput, u, distance) {
                // The same numbers go at least as far as the bubble.
                Step::Passed { weight } | Step::Scatter { weight, .. } => (distance, weight * albedo, bubbles::PHASE),
            },
            (None, Step::Scatter { distance, weight }) => (distance, weight, self.medium.phase),
            (None, Step::Passed { weight }) => {
                carrier.throughput *= weight;
                return true;
            }
        };
        let at = Carrier {
            throughput: carrier.throughput * weight,
            distance: carrier.distance + distance,
            layer: Some(match carrier.layer {
                None | Some(Layer::Refraction) => Layer::Volume,
                Some(layer) => layer,
            }),
            primary: false,
            sight: Sight::Over,
            ..*carrier
        };
        // A fog of the water's own hides what is behind it; only an eye in the water has that for its first sight.
        if let Sight::Direct(_) = carrier.sight {
            self.cover(carrier, self.things.water(), 1.0, scratch);
        }
        self.scatter(at, origin + distance * direction, direction, phase, [numbers[2], numbers[3]], scratch);
        false
    }

    /// A path scattered by the water at `position`: sun and lamps through the surface, and on by the phase function.
    fn scatter(
        &self,
        mut carrier: Carrier,
        position: Vec3,
        direction: Vec3,
        phase: Phase,
        u: [f32; 2],
        scratch: &mut Scratch,
    ) {
        if carrier.path.scattered >= self.limits.scattered {
            return self.spend(&carrier, scratch);
        }
        // Guides end where the water throws light back: seen from above it is a fog of its own colour.
        scratch.film.add_guide(carrier.place.pixel, carrier.guide, self.medium.albedo(), Vec3::ZERO);
        carrier.guide = 0.0;
        let layer = carrier.layer.unwrap_or(Layer::Volume);
        let value = |to_light: Vec3| phase.value(direction.dot(to_light));
        let asker = Asker {
            position,
            contact: None,
            carrier: &carrier,
            value: &value,
            layer,
            caustic_layer: layer,
            drops: None,
        };
        self.ask_sun_by_surface(&asker, scratch);
        self.ask_lamp(&asker, scratch);

        let [_, _, _, chance] = self.numbers(&carrier, Purpose::Way, scratch);
        let on = phase.sample(direction, u);
        let path = PathState {
            scattered: carrier.path.scattered + 1,
            from: position,
            density: value(on),
            asked: Asked { lamps: true, ..Asked::NONE },
            fresh: true,
            covered: false,
            behind_sheets: false,
            bow: 0.0,
            ..carrier.path
        };
        scratch.counts.scattered += 1;
        let tolerance = self.secondary_tolerance_at(carrier.distance);
        self.go_on(Carrier { path, ..carrier }, position, on, tolerance, chance, scratch);
    }
}
