//! Sun and lamps that reach a point by way of the water's surface: refracted into the water, or mirrored off it.
//!
//! Irradiance across a connection is E T n^2 spread of the sun (intensity for a lamp), with the reflectance in place of
//! T n^2 where it is mirrored (`caustics`). Ripples tilt the surface that a connection is sought on by a facet of their
//! own distribution (T. Zeltner, I. Georgiev, W. Jakob, Specular manifold sampling, 2020, section 5). Near the folds of the
//! sun's caustics a connection's light is averaged over the disc.

use glam::Vec3;

use super::{
    super::{
        batches::{Carrier, Scratch},
        caustics::{Connection, Disc, Event, Target},
        contact::Contact,
        film::Layer,
        spray::Drops,
        world::{Lamp, SUN, World},
    },
    Link, Purpose,
};
use crate::optics::SUN_ANGULAR_RADIUS;

/// Of so many searches for light by way of the surface one is made, at most, where a path has been diffuse before: its
/// light is spread out by then, and a search costs as much as many rays.
const LATER: f32 = 4.0;

/// Where light is asked for, and what becomes of it.
pub(in crate::render) struct Asker<'a> {
    pub(in crate::render) position: Vec3,
    /// The diffuse thing that asks; `None` for a point in the water.
    pub(in crate::render) contact: Option<&'a Contact>,
    pub(in crate::render) carrier: &'a Carrier,
    /// Share (1/sr) of light from a direction that goes on along the path, cosine included.
    pub(in crate::render) value: &'a dyn Fn(Vec3) -> f32,
    pub(in crate::render) layer: Layer,
    /// Drops that scatter light in their own way, where it comes straight.
    pub(in crate::render) drops: Option<Drops>,
    /// Layer of light that the surface bends.
    pub(in crate::render) caustic_layer: Layer,
}

impl Asker<'_> {
    /// Where a ray along `direction` starts.
    pub(super) fn leave(&self, direction: Vec3) -> Vec3 {
        self.contact.map_or(self.position, |contact| contact.leave(direction))
    }

    fn event(&self) -> Event {
        if self.carrier.in_water { Event::Refraction } else { Event::Reflection }
    }
}

impl World<'_> {
    /// The sun by way of the surface.
    pub(in crate::render) fn ask_sun_by_surface(&self, asker: &Asker, scratch: &mut Scratch) {
        if self.manifold.is_none() || self.sun.irradiance.max_element() <= 0.0 {
            return;
        }
        let [u, v, ..] = self.numbers(asker.carrier, Purpose::Sky, scratch);
        let target = Target::Direction(self.sun.sample([u, v]));
        let irradiance = self.sun.irradiance;
        let disc = Disc { direction: self.sun.direction, radius: SUN_ANGULAR_RADIUS };
        self.ask_by_surface(asker, target, Some(&disc), &|_| irradiance, SUN, 0, scratch);
    }

    /// A lamp in the air by way of the surface.
    pub(super) fn ask_lamp_by_surface(&self, asker: &Asker, lamp: &Lamp, u: [f32; 2], scratch: &mut Scratch) {
        if lamp.in_water {
            return;
        }
        // A ball shines from points all over it, each by the cosine there: four times the mean over the half that is seen.
        let out = sphere(u);
        let intensity = lamp.intensity * self.lamps.len() as f32;
        let strength = |to_light: Vec3| {
            if lamp.radius > 0.0 { intensity * (4.0 * (-to_light).dot(out).max(0.0)) } else { intensity }
        };
        let target = Target::Point(lamp.position + lamp.radius * out);
        self.ask_by_surface(asker, target, None, &strength, lamp.group, 2, scratch);
    }

    /// Whether a path searches, and for how many times the light.
    ///
    /// At first sight, `render.caustic_samples` of every `render.samples` do, evenly spread. Later on it is left to chance:
    /// as many at most, one in [`LATER`] at most, and the fewer the less of the light is left to reach the eye.
    fn searches(&self, carrier: &Carrier, facet: usize, scratch: &Scratch) -> Option<f32> {
        let [all, searches] = self.limits.searches;
        let spared = all as f32 / searches.min(all) as f32;
        if carrier.path.is_later() {
            let left = carrier.throughput.max_element() * if carrier.in_water { self.density() } else { 1.0 };
            let chance = left.min(1.0) / spared.max(LATER);
            return (self.numbers(carrier, Purpose::Cover, scratch)[1 + facet / 2] < chance).then_some(1.0 / chance);
        }
        let (all, searches) = (u64::from(all), u64::from(searches.min(all)));
        let place = u64::from(scratch.samples[carrier.place.path as usize].sample) % all;
        ((place + 1) * searches / all > place * searches / all).then_some(spared)
    }

    /// Every way from a light to the asker. `strength` is the irradiance (for a point: the intensity) along a direction to
    /// the light; `facet` says which of the event's numbers tilt the surface. Light of a `disc` that the target was drawn
    /// from is averaged where it comes together.
    fn ask_by_surface(
        &self,
        asker: &Asker,
        target: Target,
        disc: Option<&Disc>,
        strength: &dyn Fn(Vec3) -> Vec3,
        group: u16,
        facet: usize,
        scratch: &mut Scratch,
    ) {
        let Some(manifold) = &self.manifold else { return };
        let Asker { position, carrier, value, caustic_layer: layer, .. } = *asker;
        let Some(times) = self.searches(carrier, facet, scratch) else { return };
        let event = asker.event();
        if event == Event::Reflection && !self.mirrored {
            return;
        }
        let tilt = if self.interface.is_smooth() {
            [0.0; 2]
        } else {
            let numbers = self.numbers(carrier, Purpose::Facet, scratch);
            self.interface.slopes([numbers[facet], numbers[facet + 1]]).0
        };
        let tolerance = self.secondary_tolerance_at(carrier.distance);
        let mut found = std::mem::take(&mut scratch.connections);
        let counts = &mut scratch.paths.manifold;
        let finest = self.limits.caustic_tolerance;
        manifold.connect(position, event, target, self.water.ior, tilt, finest, &mut found, counts);
        let numbers = self.numbers(carrier, Purpose::Fold, scratch);
        let averaged = |connection: &Connection| match disc {
            Some(disc) => {
                let u = [numbers[0], numbers[1]];
                manifold.average(position, event, disc, self.water.ior, tilt, u, *connection)
            }
            None => [Some(*connection), None],
        };
        for (index, connection) in found.iter().flat_map(averaged).flatten().enumerate() {
            let value = value(connection.direction);
            if value <= 0.0 {
                continue;
            }
            let reflectance = self.water.reflectance(connection.to_light.dot(connection.facet).clamp(0.0, 1.0), false);
            let through = match event {
                Event::Refraction => (1.0 - reflectance) * self.density(),
                Event::Reflection => reflectance,
            };
            let mut light =
                carrier.throughput * strength(connection.to_light) * (value * through * connection.spread * times);
            if carrier.in_water {
                let Connection { direction, distance, .. } = connection;
                let salt = 2 + 2 * index as u32 + (facet as u32 / 2);
                light *= self.medium.transmittance(distance)
                    * self.past_bubbles(carrier, position, direction, distance, salt, scratch);
            }
            if let Some(foam) = self.matter.foam(connection.surface, 0.0) {
                light *= 1.0 - foam.cover;
            }
            let light = self.clamped(&carrier.path, light, scratch);
            let link = Link { light, layer, group, ..Link::new(carrier) };
            self.push_connection(position, &connection, link, tolerance, scratch);
        }
        scratch.connections = found;
    }

    /// Queues both legs of a connection. The first ends short of the surface and the second starts off it, by what the
    /// tracer's tolerance and rounding may move either.
    fn push_connection(&self, from: Vec3, connection: &Connection, link: Link, tolerance: f32, scratch: &mut Scratch) {
        let rounding = 12.0 * f32::EPSILON * connection.surface.abs().max_element();
        let margin = 2.0 * (tolerance + self.secondary_tolerance[1] * connection.distance) + rounding;
        // Flatter than a degree, and for points nearer than the margin, a leg of half the length asks for what it can.
        let slant = connection.direction.dot(connection.normal).abs().max(0.02);
        let reach = connection.distance - margin / slant;
        let start = connection.surface + connection.normal * margin;
        let to = connection.light_distance * (1.0 - 4.0 * f32::EPSILON);
        let link = Link { then: Some((start, connection.to_light, to)), ..link };
        self.push_link(from, connection.direction, reach.max(0.5 * connection.distance), link, scratch);
    }
}

/// A direction, all alike.
fn sphere([u, v]: [f32; 2]) -> Vec3 {
    let y = 1.0 - 2.0 * u;
    let side = (1.0 - y * y).max(0.0).sqrt();
    let (sin, cos) = (std::f32::consts::TAU * v).sin_cos();
    Vec3::new(side * cos, y, side * sin)
}
