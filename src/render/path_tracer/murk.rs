//! The water itself on a path: how far light gets, where it is scattered, and the light that reaches it there.

use glam::Vec3;

use super::{
    super::{
        batches::{Asked, Carrier, PathState, Scratch},
        cryptomatte::Sight,
        film::Layer,
        wave::Arrival,
        world::World,
    },
    Purpose, bubbles,
    by_surface::Asker,
};
use crate::{
    lower::Material,
    optics::{Phase, Step},
};

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

    /// Takes from what is seen through the water the share that `reach` metres of it scatter.
    ///
    /// Not the share of paths that get through: absorption takes paths away as well, and hides nothing.
    pub(super) fn thin_by_murk(&self, carrier: &mut Carrier, reach: f32) {
        if self.sees_through_water(carrier) {
            let unscattered = (-reach * self.medium.scattering).exp();
            carrier.sight = carrier.sight.times(unscattered.element_sum() / 3.0);
        }
    }

    /// What a path would have met that the water scattered on its way is seen through the water all the same, as far as
    /// [`World::thin_by_murk`] has left it: so its matte has no noise. A bubble does hide it.
    pub(super) fn cover_behind_murk(
        &self,
        arrival: &Arrival,
        origin: Vec3,
        direction: Vec3,
        reach: f32,
        scratch: &mut Scratch,
    ) {
        let Arrival { carrier, part, seen, .. } = arrival;
        if !self.sees_through_water(carrier) {
            return;
        }
        // The same numbers as on the path's way: it meets the same bubble.
        if self.meet_bubbles(carrier, origin, direction, reach, scratch).is_some() {
            return;
        }
        let opacity = match part.material {
            Material::Spray { .. } => self.matte(arrival).map_or(0.0, |matte| matte.opacity),
            _ => 1.0,
        };
        self.cover(carrier, *seen, opacity, scratch);
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
