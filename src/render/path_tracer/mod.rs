//! The path tracer: one way of light per camera's sample, chosen at random, weighed so that the mean is right.
//!
//! J. Kajiya, The rendering equation, 1986; lights that are asked for and lights that are met by chance share their
//! contribution by the balance heuristic (E. Veach and L. Guibas, Optimally combining sampling techniques, 1995). Sun and
//! lamps that reach a diffuse thing or a point in the water by way of the water's surface are found by `caustics`; those
//! rays that would find them by chance leave them alone then. `wave` traces; what a hit adds is in `border` (the water's
//! surface), `matte` (everything diffuse), `murk` (the water itself) and `mist` (the air's); `links` are the ways to lights,
//! `by_surface` those that the water's surface bends.

mod border;
mod bubbles;
mod by_surface;
mod lamps;
mod links;
mod matte;
mod mist;
mod murk;

use glam::Vec3;

pub(super) use by_surface::Asker;
pub(super) use links::Links;

use links::Link;

use super::{
    batches::{Asked, Carrier, PathState, Scratch},
    film::{Layer, Place},
    sampler::Sampler,
    wave::Arrival,
    world::{Lamp, SKY, SUN, World},
};
use crate::lower::Material;

/// Events after which a path's survival is left to chance.
const CERTAIN_EVENTS: u16 = 4;

/// What path tracing counted.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct PathCounts {
    /// Contributions that `render.clamp` has cut.
    pub clamped: u64,
    /// Luminance that it took from all samples.
    pub clamped_luminance: f64,
    /// Ways through bubbles that were too long to be walked; they count as clear.
    pub endless: u64,
    /// Paths that ended since a depth of `[render]` was spent.
    pub spent: u64,
    /// Ways found, and cells searched, by the caustics.
    pub manifold: super::caustics::ManifoldCounts,
}

impl std::ops::AddAssign for PathCounts {
    fn add_assign(&mut self, other: Self) {
        self.clamped += other.clamped;
        self.clamped_luminance += other.clamped_luminance;
        self.endless += other.endless;
        self.spent += other.spent;
        self.manifold += other.manifold;
    }
}

/// What a set of random numbers is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Purpose {
    /// What to do, where to go, and whether to go on.
    Way,
    /// Points of the sun and of the sky.
    Sky,
    /// A lamp and a point of it.
    Lamp,
    /// Facets of the surface for caustics of the sun and of the lamp.
    Facet,
    /// How far to go in the water.
    Murk,
    /// Foam or water.
    Cover,
    /// How far to go in mist.
    Mist,
    /// Curves along which a caustic's light is averaged, and places that stand for it.
    Fold,
}

/// Sets of numbers that an event has.
const PURPOSES: u32 = 8;

/// Share of a way's contribution that one of two ways of finding it may claim (the balance heuristic).
#[inline]
fn share(own: f32, other: f32) -> f32 {
    if own.is_infinite() { 1.0 } else { own / (own + other) }
}

impl World<'_> {
    /// Four random numbers of a carrier's next event.
    #[inline]
    fn numbers(&self, carrier: &Carrier, purpose: Purpose, scratch: &Scratch) -> [f32; 4] {
        self.numbers_of(carrier.place, carrier.path.event, purpose, scratch)
    }

    /// Those of an event of a camera's sample.
    #[inline]
    fn numbers_of(&self, place: Place, event: u16, purpose: Purpose, scratch: &Scratch) -> [f32; 4] {
        let sample = scratch.samples[place.path as usize];
        Sampler::numbers(sample.run, sample.sample, 1 + PURPOSES * u32::from(event) + purpose as u32)
    }

    /// Adds light to a carrier's sample, cut by `render.clamp` where that applies.
    #[inline]
    fn add_light(&self, carrier: &Carrier, layer: Layer, group: u16, light: Vec3, scratch: &mut Scratch) {
        let light = self.clamped(&carrier.path, light, scratch);
        scratch.film.add(carrier.place, layer, group, light);
    }

    #[inline]
    fn clamped(&self, path: &PathState, light: Vec3, scratch: &mut Scratch) -> Vec3 {
        let Some(limit) = self.limits.clamp.filter(|_| path.is_later()) else {
            return light;
        };
        let brightest = light.max_element();
        if brightest <= limit || !light.is_finite() {
            return light;
        }
        let cut = light * (limit / brightest);
        scratch.paths.clamped += 1;
        scratch.paths.clamped_luminance += f64::from(crate::optics::luminance(light - cut));
        cut
    }

    /// A ray that met nothing.
    pub(super) fn path_escape(&self, mut carrier: Carrier, origin: Vec3, direction: Vec3, scratch: &mut Scratch) {
        let lamp = self.lamp_on_the_way(origin, direction, f32::INFINITY);
        let reach = lamp.map_or(f32::INFINITY, |(_, t)| t);
        if !self.pass(&mut carrier, origin, direction, reach, scratch) {
            return;
        }
        if let Some((lamp, _)) = lamp {
            self.meet_lamp(&carrier, lamp, direction, scratch);
            return;
        }
        scratch.film.add_guide(carrier.place.pixel, carrier.guide, Vec3::ONE, Vec3::ZERO);
        let density = if carrier.in_water { self.density() } else { 1.0 };
        let throughput = carrier.throughput * density;
        if carrier.layer.is_none() && !self.sky_visible {
            scratch.film.add_uncovered(carrier.place.pixel, carrier.throughput.x);
            return;
        }
        let layer = carrier.layer.unwrap_or(Layer::Sky);
        // Where the sky was asked for as well, both ways of finding it must see the same one.
        let sky = if carrier.path.asked.sky {
            self.sky.radiance(direction)
        } else {
            self.sky.mean_radiance(direction, carrier.cone.angle)
        };
        let by_chance =
            if carrier.path.asked.sky { share(carrier.path.density, self.sky_density(direction)) } else { 1.0 };
        self.add_light(&carrier, layer, SKY, throughput * sky * by_chance, scratch);
        if !carrier.path.covered && !carrier.path.behind_sheets && self.sun.contains(direction) {
            let by_chance = if carrier.path.asked.sun { share(carrier.path.density, self.sun.pdf()) } else { 1.0 };
            let by_chance = by_chance * (1.0 - carrier.path.bow);
            self.add_light(&carrier, layer, SUN, throughput * self.sun.disc_radiance * by_chance, scratch);
        }
    }

    /// Takes a path through `reach` metres of water or air. False if it was scattered on the way: it goes on from there by
    /// itself.
    fn pass(&self, carrier: &mut Carrier, origin: Vec3, direction: Vec3, reach: f32, scratch: &mut Scratch) -> bool {
        if carrier.in_water {
            self.pass_water(carrier, origin, direction, reach, scratch)
        } else {
            self.pass_mist(carrier, origin, direction, reach, scratch)
        }
    }

    /// Density (1/sr) with which events ask for the sky in a direction.
    fn sky_density(&self, direction: Vec3) -> f32 {
        self.sky_sampler.map_or(0.0, |sampler| sampler.pdf(direction))
    }

    /// A ray that met something.
    pub(super) fn path_arrive(&self, mut arrival: Arrival, scratch: &mut Scratch) {
        self.note_arrival(&mut arrival, scratch);
        let Arrival { carrier, origin, direction, t, part, .. } = &mut arrival;
        let (origin, direction, t) = (*origin, *direction, *t);
        let water = matches!(part.material, Material::Water | Material::Sheet);
        let lamp = self.lamp_on_the_way(origin, direction, t);
        let reach = lamp.map_or(t, |(_, t)| t);
        self.thin_by_murk(carrier, reach);
        if !self.pass(carrier, origin, direction, reach, scratch) {
            if lamp.is_none() && !water {
                self.cover_behind_murk(&arrival, origin, direction, reach, scratch);
            }
            return;
        }
        if let Some((lamp, _)) = lamp {
            self.meet_lamp(carrier, lamp, direction, scratch);
            return;
        }
        carrier.distance += t;
        if arrival.is_inner() {
            self.pass_inner(&arrival, scratch);
        } else if water {
            if arrival.carrier.primary {
                self.offer_water(&arrival, scratch);
            }
            if !self.path_foam(&arrival, scratch) {
                self.path_border(&arrival, scratch);
            }
        } else {
            self.path_matte(&arrival, scratch);
        }
    }

    /// The first shining ball that a ray meets before `reach`, and where.
    pub(super) fn lamp_on_the_way(&self, origin: Vec3, direction: Vec3, reach: f32) -> Option<(&Lamp, f32)> {
        let mut nearest = None;
        let mut reach = reach;
        for lamp in self.lamps.iter().filter(|lamp| lamp.radius > 0.0) {
            let to = lamp.position - origin;
            let along = to.dot(direction);
            let aside = (to - along * direction).length_squared();
            let half = lamp.radius * lamp.radius - aside;
            // From inside its own ball nothing of a lamp is seen.
            if half > 0.0 && to.length_squared() > lamp.radius * lamp.radius {
                let t = along - half.sqrt();
                if t > 0.0 && t < reach {
                    reach = t;
                    nearest = Some((lamp, t));
                }
            }
        }
        nearest
    }

    fn meet_lamp(&self, carrier: &Carrier, lamp: &Lamp, direction: Vec3, scratch: &mut Scratch) {
        scratch.film.add_guide(carrier.place.pixel, carrier.guide, Vec3::ONE, -direction);
        self.cover(carrier, self.things.lamp(lamp.index), 1.0, scratch);
        if carrier.path.covered {
            return;
        }
        let by_chance = if carrier.path.asked.lamps {
            share(carrier.path.density, self.lamp_density(lamp, carrier.path.from))
        } else {
            1.0
        };
        let density = if carrier.in_water { self.density() } else { 1.0 };
        let light = carrier.throughput * lamp.radiance() * (density * by_chance * (1.0 - carrier.path.bow));
        self.add_light(carrier, carrier.layer.unwrap_or(Layer::Terrain), lamp.group, light, scratch);
    }

    /// Ends a path whose depth is spent: what it has come to is as if it were black, however its light would be found.
    fn spend(&self, carrier: &Carrier, scratch: &mut Scratch) {
        scratch.paths.spent += 1;
        scratch.film.add_guide(carrier.place.pixel, carrier.guide, Vec3::ONE, Vec3::ZERO);
    }

    /// Queues a path's next ray, unless chance ends it.
    fn go_on(
        &self,
        mut carrier: Carrier,
        origin: Vec3,
        direction: Vec3,
        tolerance: f32,
        chance: f32,
        scratch: &mut Scratch,
    ) {
        let survival = if carrier.path.event < CERTAIN_EVENTS {
            1.0
        } else {
            // In water throughput is n^2 lower for a light that is n^2 denser.
            carrier.throughput.max_element() * if carrier.in_water { self.density() } else { 1.0 }
        };
        if !(chance < survival) || !(carrier.throughput.max_element() > 0.0) {
            scratch.film.add_guide(carrier.place.pixel, carrier.guide, Vec3::ONE, Vec3::ZERO);
            return;
        }
        carrier.throughput /= survival.min(1.0);
        carrier.path.event += 1;
        carrier.primary = false;
        scratch.next.rays.push(origin, direction, 0.0, f32::INFINITY, tolerance);
        scratch.next.carriers.push(carrier);
    }
}

impl Asked {
    /// Sun, sky and lamps.
    const ALL: Self = Self { sun: true, sky: true, lamps: true };
    /// None.
    const NONE: Self = Self { sun: false, sky: false, lamps: false };
}
