//! Mist on a path through the air: where it scatters, the light that reaches it there, and what mist leaves of links.

use glam::Vec3;

use super::{
    super::{
        batches::{Asked, Carrier, PathState, Scratch},
        film::Layer,
        single_scattering::PHASE,
        world::{SKY, SUN, World},
    },
    Link, Purpose,
    bubbles::Numbers,
    by_surface::Asker,
    share,
};
use crate::math::scramble;

impl World<'_> {
    /// Takes a path through `reach` metres of air. False if mist has scattered it on the way: it goes on from there by itself.
    pub(super) fn pass_mist(
        &self,
        carrier: &Carrier,
        origin: Vec3,
        direction: Vec3,
        reach: f32,
        scratch: &mut Scratch,
    ) -> bool {
        let Some(mist) = self.mist else { return true };
        let [first, second, a, b] = self.numbers(carrier, Purpose::Mist, scratch);
        // The first collision decides most: it gets the well-spread numbers.
        let (mut best, mut rest) = ([first, second].into_iter(), Numbers::new([a, b], 0));
        let mut random = || best.next().unwrap_or_else(|| rest.next());
        let Some(distance) = mist.collide(origin, direction, reach, &mut random) else { return true };
        let at = Carrier {
            distance: carrier.distance + distance,
            layer: Some(carrier.layer.unwrap_or(Layer::Mist)),
            primary: false,
            ..*carrier
        };
        let position = origin + distance * direction;
        if carrier.primary {
            scratch.film.add_mist(carrier.place.pixel, 1.0, position, mist.velocity(position));
        }
        let sight = self.cover(&at, self.things.mist(), 1.0, scratch);
        let at = Carrier { sight, ..at };
        self.scatter_in_mist(at, position, direction, scratch);
        false
    }

    /// A path scattered by mist at `position`: sun, sky and lamps, and on by the phase function. Droplets absorb nothing.
    fn scatter_in_mist(&self, mut carrier: Carrier, position: Vec3, direction: Vec3, scratch: &mut Scratch) {
        if carrier.path.scattered >= self.limits.scattered {
            return self.spend(&carrier, scratch);
        }
        scratch.film.add_guide(carrier.place.pixel, carrier.guide, Vec3::ONE, Vec3::ZERO);
        carrier.guide = 0.0;
        let layer = carrier.layer.unwrap_or(Layer::Mist);
        let value = |to_light: Vec3| PHASE.value(direction.dot(to_light));
        let drops = self.mist_drops(direction);
        let ask = |to_light: Vec3,
                   density: f32,
                   radiance: Vec3,
                   (bow, drops): (f32, Vec3),
                   group: u16,
                   scratch: &mut Scratch| {
            if density > 0.0 {
                let value = value(to_light);
                let scattered = Vec3::splat((1.0 - bow) * value * share(density, value)) + drops;
                let light = carrier.throughput * radiance * scattered / density;
                let light = self.clamped(&carrier.path, light, scratch);
                let link = Link { light, layer, group, through_sheets: group == SUN, ..Link::new(&carrier) };
                self.push_link(position, to_light, f32::INFINITY, link, scratch);
            }
        };
        let [su, sv, ku, kv] = self.numbers(&carrier, Purpose::Sky, scratch);
        if self.sun.irradiance.max_element() > 0.0 {
            let bow = self.bow(drops.as_ref(), self.sun.direction);
            ask(self.sun.sample([su, sv]), self.sun.pdf(), self.sun.disc_radiance, bow, SUN, scratch);
        }
        if let Some((to_sky, density)) = self.sky_sampler.map(|sampler| sampler.sample([ku, kv])) {
            ask(to_sky, density, self.sky.radiance(to_sky), (0.0, Vec3::ZERO), SKY, scratch);
        }
        let asker =
            Asker { position, contact: None, carrier: &carrier, value: &value, layer, caustic_layer: layer, drops };
        self.ask_lamp(&asker, scratch);
        self.ask_sun_by_surface(&asker, scratch);

        let [_, u, v, chance] = self.numbers(&carrier, Purpose::Way, scratch);
        let on = PHASE.sample(direction, [u, v]);
        let path = PathState {
            scattered: carrier.path.scattered + 1,
            from: position,
            density: value(on),
            asked: Asked::ALL,
            fresh: true,
            covered: false,
            behind_sheets: false,
            bow: self.bow.map_or(0.0, |bow| bow.share),
            ..carrier.path
        };
        scratch.counts.scattered += 1;
        let tolerance = self.secondary_tolerance_at(carrier.distance);
        self.go_on(Carrier { path, ..carrier }, position, on, tolerance, chance, scratch);
    }

    /// Share of a link's light that mist leaves up to `reach` metres of its leg under way, the `index`th.
    pub(super) fn past_mist(&self, link: &Link, index: usize, reach: f32, scratch: &Scratch) -> f32 {
        let Some(mist) = self.mist.filter(|_| !link.in_water) else { return 1.0 };
        let direction = scratch.links.rays.direction(index);
        let begin = scratch.links.rays.tnear[index];
        let (origin, reach) = (scratch.links.rays.origin(index) + begin * direction, (reach - begin).max(0.0));
        let [_, _, a, b] = self.numbers_of(link.place, link.event, Purpose::Mist, scratch);
        // An event has several links, and a link several legs: each walks by numbers of its own.
        let way = u64::from(direction.x.to_bits()) << 32 | u64::from(direction.z.to_bits());
        let salt = scramble(way ^ u64::from(link.crossed) << 48 ^ u64::from(link.then.is_some())) as u32;
        let mut numbers = Numbers::new([a, b], salt | 1);
        mist.transmittance(origin, direction, reach, &mut || numbers.next())
    }
}
