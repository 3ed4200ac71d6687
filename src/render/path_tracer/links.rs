//! Links: the ways from a path's events to lights, traced with the wave, each adding its light if nothing stops it.
//!
//! Ground, objects and water stop a link, spray lets 1 - opacity of it through, mist its transmittance. A link by way of the
//! water's surface is two legs: to the surface, and on from there to the light.
//!
//! Sheets of spray are thin, and what leaves them goes on much as it came: the sun's light, and that of lamps that are
//! points, goes straight through, less Fresnel's share at each border and what the water between absorbs. Searching the
//! bent way, as for the columns' smooth surface, is not possible on triangles; chance would meet the sun once in 10^5.

use glam::Vec3;

use super::super::{
    batches::{Carrier, Scratch},
    contact::Contact,
    film::{Layer, Place},
    world::World,
};
use crate::{
    accel::{NO_PART, RayBatch},
    lower::{Material, Shape},
};

/// Light of which less than this share got through spray counts as stopped: under half's rounding of the light it is part
/// of.
const LEAST_SHARE: f32 = 1.0 / 2048.0;

/// Droplets' borders on a leg after which it counts as stopped.
const CROSSINGS: u16 = 64;

/// What a link carries.
#[derive(Clone, Copy, Debug)]
pub(in crate::render) struct Link {
    /// Light that it adds if nothing stands in its way.
    pub(super) light: Vec3,
    pub(super) place: Place,
    pub(super) layer: Layer,
    pub(super) group: u16,
    /// Metres from the eye to where it started.
    pub(super) distance: f32,
    /// The event that it started from, whose numbers are its own as well.
    pub(super) event: u16,
    /// Its leg under way is in water.
    pub(super) in_water: bool,
    /// Where it goes on after its first leg: origin, direction, reach.
    pub(super) then: Option<(Vec3, Vec3, f32)>,
    pub(super) crossed: u16,
    pub(super) share: f32,
    /// It goes straight through sheets of spray.
    pub(super) through_sheets: bool,
}

impl Link {
    /// One from a carrier's event, without light so far.
    pub(super) fn new(carrier: &Carrier) -> Self {
        Self {
            light: Vec3::ZERO,
            place: carrier.place,
            layer: Layer::Terrain,
            group: 0,
            distance: carrier.distance,
            event: carrier.path.event,
            in_water: carrier.in_water,
            then: None,
            crossed: 0,
            share: 1.0,
            through_sheets: false,
        }
    }
}

/// Links under way.
#[derive(Debug, Default)]
pub(in crate::render) struct Links {
    pub(super) rays: RayBatch,
    pub(super) loads: Vec<Link>,
}

impl Links {
    pub(in crate::render) fn clear(&mut self) {
        self.rays.clear();
        self.loads.clear();
    }
}

impl World<'_> {
    /// Queues a link's next leg; nothing to add, nothing to trace.
    pub(super) fn push_link(&self, origin: Vec3, direction: Vec3, reach: f32, link: Link, scratch: &mut Scratch) {
        if link.light.max_element() > 0.0 && reach > 0.0 {
            // Shining balls stand in the accelerator's way of no one: they are met here.
            if self.lamp_on_the_way(origin, direction, reach).is_some() {
                return;
            }
            scratch.links.rays.push(origin, direction, 0.0, reach, self.secondary_tolerance_at(link.distance));
            scratch.links.loads.push(link);
        } else if !link.light.is_finite() {
            scratch.film.add(link.place, link.layer, link.group, link.light);
        }
    }

    /// Traces all queued links to their ends.
    pub(in crate::render) fn trace_links(&self, scratch: &mut Scratch) {
        while !scratch.links.rays.is_empty() {
            scratch.counts.shadow += scratch.links.rays.len() as u64;
            scratch.links.rays.tolerance_growth = self.secondary_tolerance[1];
            scratch.next_links.clear();
            if self.may_thin {
                self.accelerator.closest(&scratch.links.rays, &mut scratch.hits, &mut scratch.solve);
                for index in 0..scratch.links.loads.len() {
                    if scratch.hits.part[index] == NO_PART {
                        self.leg_done(index, scratch);
                    } else {
                        self.meet_on_link(index, scratch);
                    }
                }
            } else {
                self.accelerator.occluded(&scratch.links.rays, &mut scratch.occluded, &mut scratch.solve);
                for index in 0..scratch.links.loads.len() {
                    if !scratch.occluded[index] {
                        self.leg_done(index, scratch);
                    }
                }
            }
            std::mem::swap(&mut scratch.links, &mut scratch.next_links);
        }
    }

    /// A leg that nothing stands in the way of but what is left of mist.
    fn leg_done(&self, index: usize, scratch: &mut Scratch) {
        let mut link = scratch.links.loads[index];
        link.share *= self.past_mist(&link, index, scratch.links.rays.tfar[index], scratch);
        match link.then.take() {
            Some((origin, direction, reach)) => {
                let tolerance = self.secondary_tolerance_at(link.distance);
                scratch.next_links.rays.push(origin, direction, 0.0, reach, tolerance);
                // The light that is sought by way of the surface is in the air.
                scratch.next_links.loads.push(Link { in_water: false, ..link });
            }
            None => scratch.film.add(link.place, link.layer, link.group, link.light * link.share),
        }
    }

    /// Spray thins a link, all else ends it.
    fn meet_on_link(&self, index: usize, scratch: &mut Scratch) {
        let part = &self.lowered.parts[scratch.hits.part[index] as usize];
        let mut link = scratch.links.loads[index];
        let through = link.through_sheets && matches!(part.material, Material::Sheet);
        if !(through || matches!(part.material, Material::Spray { .. })) {
            return;
        }
        let (origin, direction) = (scratch.links.rays.origin(index), scratch.links.rays.direction(index));
        let (t, reach) = (scratch.hits.t[index], scratch.links.rays.tfar[index]);
        let given = Vec3::from_array(std::array::from_fn(|axis| scratch.hits.normal[axis][index]));
        let primitive = scratch.hits.primitive[index];
        let place = [scratch.hits.u[index], scratch.hits.v[index]];
        let contact = Contact::new(part, primitive, place, origin, direction, t, given);
        link.share *= self.past_mist(&link, index, t, scratch);
        let cosine = direction.dot(contact.normal);
        if let Material::Spray { first } = part.material {
            // A ball is met twice, on the way in and on the way out, and counts once.
            if cosine <= 0.0 || matches!(part.shape, Shape::Discs(_)) {
                // Towards a light, a link is as narrow as a line.
                let look = self.spray_look(part, first + primitive, primitive, &contact, direction, 0.0);
                link.share *= 1.0 - look.opacity;
            }
        } else {
            // Unbent: both borders take the reflectance at the angle in air.
            link.share *= 1.0 - self.water.reflectance(cosine.abs(), false);
            if link.in_water {
                link.light *= self.medium.transmittance(t - scratch.links.rays.tnear[index]);
            }
            link.in_water = cosine <= 0.0;
        }
        link.crossed += 1;
        if link.share < LEAST_SHARE || link.crossed > CROSSINGS {
            return;
        }
        link.distance += t - scratch.links.rays.tnear[index];
        let (start, tnear) = Self::behind(part, &contact, origin, direction, t);
        // The end stays where it is.
        let end = if tnear > 0.0 { reach } else { reach - t };
        let tolerance = self.secondary_tolerance_at((link.distance - tnear).max(0.0));
        scratch.next_links.rays.push(start, direction, tnear, end, tolerance);
        scratch.next_links.loads.push(link);
    }
}
