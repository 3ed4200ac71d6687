//! Diffuse things on a path: ground, objects, spray, foam. Every light is asked for, and the path goes on by the cosine.

use std::f32::consts::FRAC_1_PI;

use glam::Vec3;

use super::{
    super::{
        batches::{Asked, Carrier, PathState, Scratch},
        cryptomatte::Sight,
        film::Layer,
        matte::{Matte, PASSES},
        wave::Arrival,
        world::{SKY, SUN, World},
    },
    Link, Purpose,
    by_surface::Asker,
    share,
};
use crate::lower::Shape;

impl World<'_> {
    /// A path that met something diffuse: it passes with the chance that it is let through, or is thrown back.
    pub(super) fn path_matte(&self, arrival: &Arrival, scratch: &mut Scratch) {
        let Arrival { carrier, direction, .. } = arrival;
        let [pick, u, v, chance] = self.numbers(carrier, Purpose::Way, scratch);
        let matte = self.matte(arrival);
        let opaque = matte.filter(|matte| pick < matte.opacity || carrier.passed >= PASSES);
        let Some(matte) = opaque else {
            if let Some(look) = matte.filter(|_| carrier.primary) {
                self.offer(arrival, look.normal, look.velocity, 0.0, scratch);
            }
            // Straight on: the last event's density and the lights that it asked for still stand.
            let on = Carrier { passed: carrier.passed + 1, primary: false, ..*carrier };
            let on = Carrier { path: PathState { event: on.path.event + 1, ..on.path }, ..on };
            scratch.counts.transparency += 1;
            let (origin, tnear, tolerance) = self.behind_arrival(arrival);
            scratch.next.rays.push(origin, *direction, tnear, f32::INFINITY, tolerance);
            scratch.next.carriers.push(on);
            return;
        };
        if carrier.primary {
            self.offer(arrival, matte.normal, matte.velocity, 0.0, scratch);
        }
        self.cover(carrier, arrival.seen, 1.0, scratch);
        self.throw_back(arrival, &matte, [u, v, chance], scratch);
    }

    /// Foam on the water, from above or below: true if that is what the path has met, by the chance of its cover.
    pub(super) fn path_foam(&self, arrival: &Arrival, scratch: &mut Scratch) -> bool {
        let Arrival { carrier, direction, contact, .. } = arrival;
        if !matches!(arrival.part.shape, Shape::Surface(_)) {
            return false;
        }
        let Some(foam) = self.foam_at(contact, *direction, carrier.distance) else { return false };
        if carrier.primary {
            scratch.film.add_foam(carrier.place.pixel, foam.cover);
        }
        if self.numbers(carrier, Purpose::Cover, scratch)[0] >= foam.cover {
            return false;
        }
        let side = if carrier.in_water { -1.0 } else { 1.0 };
        let matte = Matte {
            albedo: foam.albedo,
            normal: side * contact.shading,
            facing: Some(side * contact.normal),
            line: None,
            sky_view: 1.0,
            opacity: 1.0,
            velocity: Vec3::ZERO,
            own_layer: Layer::Foam,
            depth: 0.0,
            drops: None,
        };
        let [_, u, v, chance] = self.numbers(carrier, Purpose::Way, scratch);
        self.cover(carrier, self.things.foam_on(arrival.seen), 1.0, scratch);
        self.throw_back(arrival, &matte, [u, v, chance], scratch);
        true
    }

    /// Light on a diffuse thing, and the path's way on from it.
    pub(super) fn throw_back(&self, arrival: &Arrival, matte: &Matte, [u, v, chance]: [f32; 3], scratch: &mut Scratch) {
        let Arrival { carrier, contact, .. } = arrival;
        if u32::from(carrier.path.diffuse) >= self.limits.diffuse {
            return self.spend(carrier, scratch);
        }
        scratch.film.add_guide(carrier.place.pixel, carrier.guide, matte.albedo, matte.normal);
        let layer = carrier.layer.unwrap_or(matte.own_layer);
        let carrier = Carrier {
            guide: 0.0,
            layer: Some(layer),
            throughput: carrier.throughput * matte.albedo,
            sight: Sight::Over,
            ..*carrier
        };
        let first = !carrier.path.is_later();
        let caustic_layer =
            if carrier.in_water && first && layer == Layer::Refraction { Layer::Caustics } else { layer };
        let asked = if carrier.in_water {
            self.ask_below(arrival, matte, &carrier, [layer, caustic_layer], scratch)
        } else {
            self.ask_above(arrival, matte, &carrier, layer, scratch)
        };

        let (local, mut density) = cosine_hemisphere([u, v]);
        let mut normal = matte.normal;
        if let Some(line) = &matte.line {
            // No streak is foam, whose numbers these are.
            let [choice, turn, ..] = self.numbers(&carrier, Purpose::Cover, scratch);
            normal = line.turned(normal, [choice, turn]);
        }
        let (across, along) = normal.any_orthonormal_pair();
        let direction = (local.x * across + local.z * along + local.y * normal).normalize();
        if matte.line.is_some() {
            density = matte.cosine(direction) * FRAC_1_PI;
        }
        if matte.facing.is_some_and(|facing| facing.dot(direction) <= 0.0) {
            return;
        }
        let path = PathState {
            diffuse: carrier.path.diffuse + 1,
            from: contact.position,
            density,
            asked,
            fresh: true,
            covered: false,
            behind_sheets: false,
            bow: matte.drops.and(self.bow).map_or(0.0, |bow| bow.share),
            ..carrier.path
        };
        let tolerance = self.secondary_tolerance_at(carrier.distance);
        scratch.counts.diffuse += 1;
        self.go_on(Carrier { path, ..carrier }, contact.leave(direction), direction, tolerance, chance, scratch);
    }

    /// Sun, sky and lamps on a diffuse thing in the air.
    fn ask_above(
        &self,
        arrival: &Arrival,
        matte: &Matte,
        carrier: &Carrier,
        layer: Layer,
        scratch: &mut Scratch,
    ) -> Asked {
        let contact = &arrival.contact;
        let [su, sv, ku, kv] = self.numbers(carrier, Purpose::Sky, scratch);
        let ask = |direction: Vec3,
                   density: f32,
                   radiance: Vec3,
                   (bow, drops): (f32, Vec3),
                   group: u16,
                   scratch: &mut Scratch| {
            let value = matte.cosine(direction) * FRAC_1_PI;
            if (value > 0.0 || drops != Vec3::ZERO) && density > 0.0 {
                let scattered = Vec3::splat((1.0 - bow) * value * share(density, value)) + drops;
                let light = carrier.throughput * radiance * scattered / density;
                let light = self.clamped(&carrier.path, light, scratch);
                let link = Link { light, layer, group, through_sheets: group == SUN, ..Link::new(carrier) };
                self.push_link(contact.leave(direction), direction, f32::INFINITY, link, scratch);
            }
        };
        if self.sun.irradiance.max_element() > 0.0 {
            // The whole disc's mean is in the table: by the middle's direction, wherever on the disc is asked.
            let bow = self.bow(matte.drops.as_ref(), self.sun.direction);
            ask(self.sun.sample([su, sv]), self.sun.pdf(), self.sun.disc_radiance, bow, SUN, scratch);
        }
        if let Some((direction, density)) = self.sky_sampler.map(|sampler| sampler.sample([ku, kv])) {
            ask(direction, density, self.sky.radiance(direction), (0.0, Vec3::ZERO), SKY, scratch);
        }
        self.ask_on_matte(arrival, matte, carrier, [layer; 2], scratch);
        Asked::ALL
    }

    /// Sun and lamps through the surface on a diffuse thing under water, and lamps in the water.
    fn ask_below(
        &self,
        arrival: &Arrival,
        matte: &Matte,
        carrier: &Carrier,
        [layer, caustic_layer]: [Layer; 2],
        scratch: &mut Scratch,
    ) -> Asked {
        self.ask_on_matte(arrival, matte, carrier, [layer, caustic_layer], scratch);
        Asked { lamps: true, ..Asked::NONE }
    }
}

impl World<'_> {
    /// Lamps, and the sun by way of the surface.
    fn ask_on_matte(
        &self,
        arrival: &Arrival,
        matte: &Matte,
        carrier: &Carrier,
        [layer, caustic_layer]: [Layer; 2],
        scratch: &mut Scratch,
    ) {
        let contact = &arrival.contact;
        let value = |direction: Vec3| matte.cosine(direction) * FRAC_1_PI;
        let asker = Asker {
            position: contact.leave(matte.facing.unwrap_or(matte.normal)),
            contact: Some(contact),
            carrier,
            value: &value,
            layer,
            caustic_layer,
            drops: matte.drops,
        };
        self.ask_lamp(&asker, scratch);
        match &self.beams {
            Some(beams) if carrier.in_water => {
                let light = carrier.throughput * FRAC_1_PI * beams.irradiance(contact.position, matte.normal);
                self.add_light(carrier, caustic_layer, SUN, light, scratch);
            }
            _ => self.ask_sun_by_surface(&asker, scratch),
        }
    }
}

/// A direction about the y axis with density cosine / pi, and that density (Malley's method).
fn cosine_hemisphere(u: [f32; 2]) -> (Vec3, f32) {
    let disc = super::super::concentric_disc(glam::DVec2::new(u[0].into(), u[1].into())).as_vec2();
    let y = (1.0 - disc.length_squared()).max(0.0).sqrt();
    (Vec3::new(disc.x, y, disc.y), y * FRAC_1_PI)
}
