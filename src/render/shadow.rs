//! Direct light: which lights a point asks for, and the chain of hits on the way to each.
//!
//! Ground and objects stop light, spray lets 1 - opacity of it through, mist its transmittance, water crossings cost Fresnel's share and what
//! the water on the way absorbs. Rays from under water towards the sun are bent once, as under a level surface, unless
//! caustics are asked for: then `caustics` finds where the waves focus the sun, as it does for paths.

use glam::Vec3;

use super::{
    batches::{Carrier, Scratch, ShadowCarrier},
    contact::Contact,
    film::{Layer, Place},
    matte::{Line, cosine},
    path_tracer::Asker,
    spray::Drops,
    world::{SUN, World},
};
use crate::{
    accel::NO_PART,
    lower::{Material, Shape},
    optics::absorb::transmittance,
};

/// A ray through more borders than this counts as stopped: each droplet has two, and behind thirty-two of them little
/// light is left.
const CROSSINGS: u16 = 64;

/// Light of which less than this share got through counts as stopped: under half's rounding of the light it is part of.
const LEAST_SHARE: f32 = 1.0 / 2048.0;

/// A diffuse point that asks for light.
pub(super) struct Receiver<'a> {
    pub(super) contact: &'a Contact,
    /// Unit normal to shade with, towards the viewer.
    pub(super) normal: Vec3,
    /// Unit geometric normal towards the viewer; `None` for what light reaches from both sides.
    pub(super) facing: Option<Vec3>,
    /// It is a streak too thin to be seen as round.
    pub(super) line: Option<Line>,
    /// It is a drop in the air.
    pub(super) drops: Option<Drops>,
    /// Share of radiance that reaches the sample, albedo and 1/pi included.
    pub(super) weight: Vec3,
    pub(super) in_water: bool,
    /// Depth (m) under the level water surface.
    pub(super) depth: f32,
    /// Metres from the eye.
    pub(super) distance: f32,
    pub(super) place: Place,
    pub(super) layer: Layer,
}

impl Receiver<'_> {
    /// As [`super::matte::Matte::cosine`].
    fn cosine(&self, direction: Vec3) -> f32 {
        cosine(self.normal, self.facing, self.line.as_ref(), direction)
    }
}

impl World<'_> {
    /// Queues the rays that bring sun and lamps to a diffuse point.
    pub(super) fn ask_for_light(&self, receiver: &Receiver, scratch: &mut Scratch) {
        let mut carrier = ShadowCarrier {
            in_water: receiver.in_water,
            ..ShadowCarrier::in_air(Vec3::ZERO, receiver.distance, receiver.place, receiver.layer, SUN)
        };
        if receiver.in_water {
            if self.manifold.is_some() {
                self.ask_for_caustics(receiver, scratch);
            } else if let Some(sun) = &self.sun_below {
                let cosine = receiver.cosine(sun.direction);
                if cosine > 0.0 {
                    let bent = ShadowCarrier {
                        light: receiver.weight * sun.irradiance * cosine,
                        level_path: receiver.depth / sun.direction.y,
                        bent: true,
                        ..carrier
                    };
                    self.push_shadow(receiver.contact, sun.direction, f32::INFINITY, bent, scratch);
                }
            }
        } else {
            let gain = self.gain(receiver, self.sun.direction);
            if gain != Vec3::ZERO && self.sun.irradiance.max_element() > 0.0 {
                carrier.light = receiver.weight * self.sun.irradiance * gain;
                self.push_shadow(receiver.contact, self.sun.direction, f32::INFINITY, carrier, scratch);
            }
        }
        for lamp in &self.lamps {
            let to_lamp = lamp.position - receiver.contact.position;
            let distance = to_lamp.length();
            let direction = to_lamp / distance;
            let gain = self.gain(receiver, direction);
            if gain != Vec3::ZERO {
                carrier.group = lamp.group;
                carrier.light = receiver.weight * lamp.intensity * gain / (distance * distance);
                // The lamp is a point: nothing at its very place stands in the way.
                let reach = distance * (1.0 - 4.0 * f32::EPSILON);
                self.push_shadow(receiver.contact, direction, reach, carrier, scratch);
            }
        }
    }

    /// Radiance against irradiance, times pi: the cosine, in part what drops scatter.
    fn gain(&self, receiver: &Receiver, to_light: Vec3) -> Vec3 {
        let (bow, drops) = self.bow(receiver.drops.as_ref(), to_light);
        Vec3::splat((1.0 - bow) * receiver.cosine(to_light)) + std::f32::consts::PI * drops
    }

    /// The sun as the water's surface focuses it on a diffuse point under water.
    fn ask_for_caustics(&self, receiver: &Receiver, scratch: &mut Scratch) {
        if let Some(beams) = &self.beams {
            let light = receiver.weight * beams.irradiance(receiver.contact.position, receiver.normal);
            scratch.film.add(receiver.place, receiver.layer, SUN, light);
            return;
        }
        let carrier = Carrier {
            distance: receiver.distance,
            ..Carrier::camera(receiver.weight, receiver.place, receiver.in_water, self.pixel_cone())
        };
        let value = |direction: Vec3| receiver.cosine(direction);
        let asker = Asker {
            position: receiver.contact.leave(receiver.facing.unwrap_or(receiver.normal)),
            contact: Some(receiver.contact),
            carrier: &carrier,
            value: &value,
            layer: receiver.layer,
            caustic_layer: receiver.layer,
            drops: None,
        };
        self.ask_sun_by_surface(&asker, scratch);
    }

    /// Queues one ray towards a light.
    pub(super) fn push_shadow(
        &self,
        contact: &Contact,
        direction: Vec3,
        reach: f32,
        carrier: ShadowCarrier,
        scratch: &mut Scratch,
    ) {
        self.push_shadow_from(contact.leave(direction), direction, reach, carrier, scratch);
    }

    /// Queues one ray towards a light from a point that is on nothing.
    pub(super) fn push_shadow_from(
        &self,
        origin: Vec3,
        direction: Vec3,
        reach: f32,
        carrier: ShadowCarrier,
        scratch: &mut Scratch,
    ) {
        scratch.shadow.rays.push(origin, direction, 0.0, reach, self.secondary_tolerance_at(carrier.distance));
        scratch.shadow.carriers.push(carrier);
    }

    /// Follows all queued shadow rays to their ends and adds what arrives.
    pub(super) fn trace_shadows(&self, scratch: &mut Scratch) {
        while !scratch.shadow.rays.is_empty() {
            scratch.shadow.rays.tolerance_growth = self.secondary_tolerance[1];
            scratch.counts.shadow += scratch.shadow.rays.len() as u64;
            self.accelerator.closest(&scratch.shadow.rays, &mut scratch.hits, &mut scratch.solve);
            scratch.next_shadow.clear();
            for index in 0..scratch.shadow.rays.len() {
                self.follow_shadow(index, scratch);
            }
            std::mem::swap(&mut scratch.shadow, &mut scratch.next_shadow);
        }
    }

    fn follow_shadow(&self, index: usize, scratch: &mut Scratch) {
        let mut carrier = scratch.shadow.carriers[index];
        let (t, part) = (scratch.hits.t[index], scratch.hits.part[index]);
        let reach = scratch.shadow.rays.tfar[index];
        let (origin, mut direction) = (scratch.shadow.rays.origin(index), scratch.shadow.rays.direction(index));
        let begin = scratch.shadow.rays.tnear[index];
        let begun = origin + begin * direction;
        if part == NO_PART {
            if !carrier.in_water {
                carrier.share *= self.clear_of_mist(begun, direction, (reach - begin).max(0.0));
            }
            let path = match (carrier.in_water, carrier.bent) {
                (false, _) => 0.0,
                (true, true) => carrier.level_path,
                (true, false) => reach,
            };
            let light = carrier.light * carrier.share * transmittance(self.water.absorption, path);
            scratch.film.add(carrier.place, carrier.layer, carrier.group, light);
            return;
        }
        let part = &self.lowered.parts[part as usize];
        let given = Vec3::from_array(std::array::from_fn(|axis| scratch.hits.normal[axis][index]));
        let primitive = scratch.hits.primitive[index];
        let place = [scratch.hits.u[index], scratch.hits.v[index]];
        let contact = Contact::new(part, primitive, place, origin, direction, t, given);
        let outward = direction.dot(contact.normal) > 0.0;
        match &part.material {
            Material::Water | Material::Sheet => {
                if outward {
                    carrier.light *= transmittance(self.water.absorption, t);
                } else {
                    carrier.share *= self.clear_of_mist(begun, direction, t - begin);
                }
                if carrier.bent {
                    // The beam's own losses at the surface are in its irradiance already.
                    direction = self.sun.direction;
                    carrier.bent = false;
                } else {
                    // Unbent: both directions of the crossing take the reflectance at the angle in air.
                    carrier.share *= 1.0 - self.water.reflectance(direction.dot(contact.normal).abs(), false);
                }
                carrier.in_water = !outward;
            }
            Material::Spray { first } => {
                if !carrier.in_water {
                    carrier.share *= self.clear_of_mist(begun, direction, t - begin);
                }
                // A ball is met twice, on the way in and on the way out, and counts once.
                if !outward || matches!(part.shape, Shape::Discs(_)) {
                    // Towards a light, a ray is as narrow as a line.
                    let look = self.spray_look(part, first + primitive, primitive, &contact, direction, 0.0);
                    carrier.share *= 1.0 - look.opacity;
                }
            }
            Material::Ground | Material::Diffuse(_) | Material::VertexColours(_) | Material::Images { .. } => return,
        }
        carrier.crossed += 1;
        if carrier.share < LEAST_SHARE || carrier.crossed > CROSSINGS {
            return;
        }
        carrier.distance += t - begin;
        let (start, tnear) = Self::behind(part, &contact, origin, direction, t);
        // The end stays where it is.
        let end = if tnear > 0.0 { reach } else { reach - t };
        let tolerance = self.secondary_tolerance_at((carrier.distance - tnear).max(0.0));
        let next = &mut scratch.next_shadow;
        next.rays.push(start, direction, tnear, end, tolerance);
        next.carriers.push(carrier);
    }
}
