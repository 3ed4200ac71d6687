//! The water's surface on a path: foam or clear, mirrored or refracted, and the sun's image on it.

use glam::Vec3;

use super::{
    super::{
        batches::{Asked, Carrier, PathState, Scratch},
        cryptomatte::Sight,
        film::Layer,
        wave::Arrival,
        world::{SUN, World},
    },
    Link, Purpose, share,
};
use crate::lower::{Material, Shape};

impl World<'_> {
    /// What the water's surface does to a path. The camera's own rays take both ways, all others one by chance.
    pub(super) fn path_border(&self, arrival: &Arrival, scratch: &mut Scratch) {
        let Arrival { carrier, direction, contact, .. } = arrival;
        let beyond = self.cover_water(carrier, arrival.seen, scratch);
        if carrier.depth >= self.depth {
            return self.spend(carrier, scratch);
        }
        let [pick, u, v, chance] = self.numbers(carrier, Purpose::Way, scratch);
        let from_water = carrier.in_water;
        let normal = if from_water { -contact.shading } else { contact.shading };
        let to_eye = -*direction;
        let facet = self.interface.facet(normal, to_eye, [u, v]);
        let reflectance = self.water.reflectance(to_eye.dot(facet).clamp(0.0, 1.0), from_water);
        let mirrored = self.interface.reflect(normal, to_eye, facet);
        let refracted = self.interface.refract(normal, to_eye, facet, from_water);

        let both = carrier.primary && carrier.layer.is_none();
        scratch.film.add_guide(carrier.place.pixel, carrier.guide * reflectance, Vec3::ONE, contact.shading);
        let reflection_layer = carrier.layer.unwrap_or(Layer::Reflection);
        let refraction_layer = carrier.layer.unwrap_or(Layer::Refraction);
        // What the caustics find from where the path was diffuse: mirrored light in the air, refracted light in the water.
        // Walls are no part of the spline: what comes by them is found by chance.
        let found = carrier.path.fresh && self.manifold.is_some() && matches!(arrival.part.shape, Shape::Surface(_));
        let (mirror_covered, through_covered) = (found && !from_water && self.mirrored, found && from_water);

        let behind_sheets = matches!(arrival.part.material, Material::Sheet)
            && (carrier.path.fresh && !from_water || carrier.path.behind_sheets);
        let asks = !self.interface.is_smooth();
        if asks {
            self.ask_for_sun_image(arrival, normal, [mirror_covered, through_covered || behind_sheets], both, scratch);
        }
        let asked = Asked { sun: asks, ..Asked::NONE };
        let state = |density: f32, covered: bool| PathState {
            from: contact.position,
            density,
            asked,
            covered,
            fresh: false,
            behind_sheets: false,
            bow: 0.0,
            ..carrier.path
        };
        let child = Carrier { depth: carrier.depth + 1, sight: Sight::Over, ..*carrier };
        let tolerance = self.secondary_tolerance_at(carrier.distance);
        // Ripples are drawn by chance here: only the surface itself widens a ray.
        let bend = self.bend(arrival);
        let eta = if from_water { self.water.ior.recip() } else { self.water.ior };
        let mirror = both || pick < reflectance;
        if let Some(bounce) = mirrored.filter(|_| mirror && reflectance > 0.0) {
            let weight = bounce.weight * if both { reflectance } else { 1.0 };
            let density = bounce.pdf * if both { 1.0 } else { reflectance };
            let carrier = Carrier {
                throughput: carrier.throughput * weight,
                guide: 0.0,
                layer: Some(reflection_layer),
                cone: carrier.cone.mirrored(carrier.distance, bend),
                path: state(density, mirror_covered),
                ..child
            };
            scratch.counts.reflection += 1;
            self.go_on(carrier, contact.leave(bounce.direction), bounce.direction, tolerance, chance, scratch);
        }
        let through = both || !mirror;
        match refracted.filter(|_| through && reflectance < 1.0) {
            Some(bounce) => {
                let radiance = if from_water { self.density() } else { 1.0 / self.density() };
                let weight = bounce.weight * radiance * if both { 1.0 - reflectance } else { 1.0 };
                let density = bounce.pdf * if both { 1.0 } else { 1.0 - reflectance };
                let guide = carrier.guide * (1.0 - reflectance);
                // Behind spray one of the two ways was chosen by chance, which must not count against what lies below.
                let by_chance = !both && carrier.layer.is_none();
                let carrier = Carrier {
                    sight: if by_chance { beyond.times((1.0 - reflectance).recip()) } else { beyond },
                    throughput: carrier.throughput * weight,
                    guide: if both { guide } else { guide / (1.0 - reflectance) },
                    layer: Some(refraction_layer),
                    cone: carrier.cone.refracted(carrier.distance, bend, eta),
                    in_water: !from_water,
                    within: arrival.beyond(),
                    notes_path: carrier.primary && !from_water,
                    path: PathState { behind_sheets, ..state(density, through_covered) },
                    ..child
                };
                scratch.counts.refraction += 1;
                self.go_on(carrier, contact.leave(bounce.direction), bounce.direction, tolerance, chance, scratch);
            }
            None if through => {
                let lost = carrier.guide * (1.0 - reflectance);
                scratch.film.add_guide(carrier.place.pixel, lost, Vec3::ONE, Vec3::ZERO);
            }
            None => {}
        }
    }

    /// Asks for the sun's image on rough water, mirrored and refracted.
    fn ask_for_sun_image(
        &self,
        arrival: &Arrival,
        normal: Vec3,
        covered: [bool; 2],
        both: bool,
        scratch: &mut Scratch,
    ) {
        let Arrival { carrier, direction, contact, .. } = arrival;
        if self.sun.irradiance.max_element() <= 0.0 {
            return;
        }
        let [u, v, ..] = self.numbers(carrier, Purpose::Sky, scratch);
        let to_sun = self.sun.sample([u, v]);
        let to_eye = -*direction;
        let from_water = carrier.in_water;
        // The sun shines from the air's side: onto the eye's side, or through from the other.
        if contact.normal.dot(to_sun) <= 0.0 || covered[usize::from(from_water)] {
            return;
        }
        let (evaluation, layer) = if from_water {
            (self.interface.evaluate_refraction(normal, to_eye, to_sun, true), Layer::Refraction)
        } else {
            (self.interface.evaluate_reflection(normal, to_eye, to_sun), Layer::Reflection)
        };
        if evaluation.value <= 0.0 {
            return;
        }
        let reflectance = self.water.reflectance(evaluation.cosine, from_water);
        let (factor, radiance) = if from_water { (1.0 - reflectance, self.density()) } else { (reflectance, 1.0) };
        let density = evaluation.pdf * if both { 1.0 } else { factor };
        let asked = share(self.sun.pdf(), density);
        let light = carrier.throughput * self.sun.irradiance * (evaluation.value * factor * radiance * asked);
        let link = Link {
            light: self.clamped(&carrier.path, light, scratch),
            layer: carrier.layer.unwrap_or(layer),
            group: SUN,
            in_water: false,
            ..Link::new(carrier)
        };
        self.push_link(contact.leave(to_sun), to_sun, f32::INFINITY, link, scratch);
    }
}
