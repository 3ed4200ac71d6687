//! The Whitted integrator: what a hit adds, and what follows from it. `wave` traces, `single_scattering` looks through mist.
//!
//! T. Whitted, An improved illumination model for shaded display, 1980, with absorption, direct light through the
//! surface (`shadow`) and the sun's image on the water. Radiance in water is n^2 times that in air along a refracted
//! ray (Snell's invariant L / n^2), so throughput is divided by n^2 on the way in and multiplied on the way out.
//!
//! *No energy is lost*: a ray that is not followed, since its depth is spent or its throughput is under half's rounding,
//! adds the sky's radiance in its direction instead.

use glam::Vec3;

use super::{
    batches::{Carrier, Scratch, ShadowCarrier},
    contact::Contact,
    cryptomatte::Sight,
    film::Layer,
    matte::{Matte, PASSES},
    shadow::Receiver,
    wave::Arrival,
    world::{SKY, SUN, World},
};
use crate::{
    foam::FoamLook,
    lower::{Material, Shape},
    optics::{
        absorb::transmittance,
        fresnel::{reflect, refract},
        highlight,
    },
};

/// Throughput under which a ray is not followed: half's rounding (11 bits) of a pixel as bright as what the ray would see.
pub(super) const LEAST_THROUGHPUT: f32 = 1.0 / 2048.0;

enum Kind {
    Reflection,
    Refraction,
    /// Origin, least t and tolerance of the ray that goes on.
    Transparency((Vec3, f32, f32)),
}

impl World<'_> {
    /// A ray that met nothing.
    pub(super) fn escape(&self, mut carrier: Carrier, origin: Vec3, direction: Vec3, scratch: &mut Scratch) {
        self.look_through_mist(&mut carrier, origin, direction, f32::INFINITY, scratch);
        let film = &mut scratch.film;
        film.add_guide(carrier.place.pixel, carrier.guide, Vec3::ONE, Vec3::ZERO);
        if carrier.in_water {
            // Water without an end: clear channels still see the sky's light, n^2 denser.
            let light = self.sky_over(&carrier, direction)
                * self.density()
                * transmittance(self.water.absorption, f32::INFINITY);
            film.add(carrier.place, carrier.layer.unwrap_or(Layer::Sky), SKY, carrier.throughput * light);
            return;
        }
        let Some(layer) = carrier.layer else {
            // Only the camera's own rays see the sun's disc: on water it is the highlight's matter.
            if self.sky_visible {
                let disc = if self.sun.contains(direction) { self.sun.disc_radiance } else { Vec3::ZERO };
                film.add(carrier.place, Layer::Sky, SKY, carrier.throughput * self.sky_over(&carrier, direction));
                film.add(carrier.place, Layer::Sky, SUN, carrier.throughput * disc);
            } else {
                film.add_uncovered(carrier.place.pixel, carrier.throughput.x);
            }
            return;
        };
        film.add(carrier.place, layer, SKY, carrier.throughput * self.sky_over(&carrier, direction));
    }

    /// What a ray that met nothing sees of the sky.
    #[inline]
    fn sky_over(&self, carrier: &Carrier, direction: Vec3) -> Vec3 {
        self.sky.mean_radiance(direction, carrier.cone.angle)
    }

    /// A ray that met something: absorption on its way, the film's data, then light by material.
    pub(super) fn arrive(&self, mut arrival: Arrival, scratch: &mut Scratch) {
        self.note_arrival(&mut arrival, scratch);
        let Arrival { carrier, origin, direction, t, part, .. } = &mut arrival;
        let (t, water) = (*t, matches!(part.material, Material::Water | Material::Sheet));
        if carrier.in_water {
            carrier.throughput *= transmittance(self.water.absorption, t);
        }
        self.look_through_mist(carrier, *origin, *direction, t, scratch);
        carrier.distance += t;
        if arrival.is_inner() {
            self.pass_inner(&arrival, scratch);
        } else if water {
            if arrival.carrier.primary {
                self.offer_water(&arrival, scratch);
            }
            let open = arrival.carrier.in_water || matches!(arrival.part.shape, Shape::Sides(_));
            if open || self.shade_foam(&mut arrival, scratch) {
                self.shade_water(&arrival, scratch);
            }
        } else {
            self.shade_matte(&arrival, scratch);
        }
    }

    /// Density of radiance in water against air, n^2.
    #[inline]
    pub(super) fn density(&self) -> f32 {
        self.water.ior * self.water.ior
    }

    /// The foam that a ray along `direction`, `distance` metres from the eye, sees on the water.
    pub(super) fn foam_at(&self, contact: &Contact, direction: Vec3, distance: f32) -> Option<FoamLook> {
        // A pixel lies stretched over a slanted surface: the footprint has the same area.
        let cosine = direction.dot(contact.normal).abs().max(f32::EPSILON);
        let footprint = distance * self.camera.pixel_angle() as f32 / cosine.sqrt();
        self.matter.foam(contact.position, footprint)
    }

    /// Foam on the water as seen from the air: `cover` of it is a diffuse layer, the rest is left for the water below. False
    /// if nothing is left.
    fn shade_foam(&self, arrival: &mut Arrival, scratch: &mut Scratch) -> bool {
        let Arrival { carrier, direction, contact, .. } = arrival;
        let Some(foam) = self.foam_at(contact, *direction, carrier.distance) else { return true };
        // What would not be followed below is taken for foam, so that it keeps its share of light.
        let below = carrier.throughput.max_element() * (1.0 - foam.cover);
        let cover = if below < LEAST_THROUGHPUT { 1.0 } else { foam.cover };
        let layer = carrier.layer.unwrap_or(Layer::Foam);
        if carrier.primary {
            scratch.film.add_foam(carrier.place.pixel, cover);
        }
        let normal = contact.shading;
        scratch.film.add_guide(carrier.place.pixel, carrier.guide * cover, foam.albedo, normal);
        let weight = carrier.throughput * foam.albedo * (cover * std::f32::consts::FRAC_1_PI);
        scratch.film.add(carrier.place, layer, SKY, weight * self.sky.irradiance(normal));
        let receiver = Receiver {
            contact,
            normal,
            facing: Some(contact.normal),
            line: None,
            drops: None,
            weight,
            in_water: false,
            depth: 0.0,
            distance: carrier.distance,
            place: carrier.place,
            layer,
        };
        self.ask_for_light(&receiver, scratch);
        carrier.sight = self.cover(carrier, self.things.foam_on(arrival.seen), cover, scratch);
        carrier.throughput *= 1.0 - cover;
        carrier.guide *= 1.0 - cover;
        cover < 1.0
    }

    fn shade_water(&self, arrival: &Arrival, scratch: &mut Scratch) {
        let Arrival { carrier, direction, contact, .. } = arrival;
        let look = &self.water;
        let from_water = carrier.in_water;
        let side = |normal: Vec3| if from_water { -normal } else { normal };
        let normal = side(contact.shading);
        let cosine = (-direction.dot(normal)).clamp(0.0, 1.0);
        let (eta_from, eta_to) = if from_water { (look.ior, 1.0) } else { (1.0, look.ior) };
        let refracted = refract(*direction, normal, eta_from, eta_to);
        let reflectance = if refracted.is_some() { look.reflectance(cosine, from_water) } else { 1.0 };
        let reflected = reflect(*direction, normal);

        // The report's diffuse share of the surface itself takes from what would have gone in.
        let diffuse = look.diffuse * (1.0 - reflectance);
        let reflection_layer = carrier.layer.unwrap_or(Layer::Reflection);
        let refraction_layer = carrier.layer.unwrap_or(Layer::Refraction);

        scratch.film.add_guide(carrier.place.pixel, carrier.guide * reflectance, Vec3::ONE, contact.shading);
        if !from_water {
            self.add_highlight(arrival, reflection_layer, scratch);
            if diffuse.max_element() > 0.0 {
                let weight = carrier.throughput * diffuse * std::f32::consts::FRAC_1_PI;
                scratch.film.add(carrier.place, reflection_layer, SKY, weight * self.sky.irradiance(normal));
                let receiver = Receiver {
                    contact,
                    normal,
                    facing: Some(side(contact.normal)),
                    line: None,
                    drops: None,
                    weight,
                    in_water: false,
                    depth: 0.0,
                    distance: carrier.distance,
                    place: carrier.place,
                    layer: reflection_layer,
                };
                self.ask_for_light(&receiver, scratch);
            }
        }

        // One ray stands for all that the ripples send on. Half of their normals lie within alpha of the surface's (GGX), their
        // mirrored rays within twice that on either side, and less across by the cosine: as round as that is wide.
        let ripples = self.water.alpha.map_or(0.0, |alpha| 2.0 * alpha * cosine.sqrt());
        let bend = self.bend(arrival) + if self.has_images { ripples } else { 0.0 };
        let beyond = self.cover_water(carrier, arrival.seen, scratch);
        let child = Carrier { depth: carrier.depth + 1, primary: false, sight: Sight::Over, ..*carrier };
        // Inside, the mirror must not lose light: the report's specular factor is meant for what the eye sees from outside.
        let mirror = if from_water { Vec3::ONE } else { look.specular };
        let mirrored = Carrier {
            throughput: carrier.throughput * mirror * reflectance,
            guide: 0.0,
            layer: Some(reflection_layer),
            cone: carrier.cone.mirrored(carrier.distance, bend),
            ..child
        };
        self.spawn(mirrored, reflected, contact, Kind::Reflection, scratch);

        if let Some(refracted) = refracted {
            self.add_sun_through(arrival, refraction_layer, scratch);
            let density = if from_water { self.density() } else { 1.0 / self.density() };
            let through = Carrier {
                throughput: carrier.throughput * (Vec3::splat(1.0 - reflectance) - diffuse) * density,
                guide: carrier.guide * (1.0 - reflectance),
                layer: Some(refraction_layer),
                cone: carrier.cone.refracted(carrier.distance, bend, eta_to / eta_from),
                in_water: !from_water,
                within: arrival.beyond(),
                notes_path: carrier.primary && !from_water,
                // Where the eye looks in, all of the sample is what lies there; where it looks out, Fresnel's share.
                sight: if carrier.layer.is_none() { beyond } else { beyond.times(1.0 - reflectance) },
                ..child
            };
            self.spawn(through, refracted, contact, Kind::Refraction, scratch);
        }
    }

    /// The sun's mirror image on the water, seen from the air.
    fn add_highlight(&self, arrival: &Arrival, layer: Layer, scratch: &mut Scratch) {
        let Arrival { carrier, direction, contact, .. } = arrival;
        let (to_eye, to_sun) = (-*direction, self.sun.direction);
        let lobe = self.water.lobe.radiance(contact.shading, to_eye, to_sun);
        if lobe <= 0.0 || contact.normal.dot(to_sun) <= 0.0 {
            return;
        }
        let share = lobe * self.water.reflectance(highlight::half_cosine(to_eye, to_sun), false);
        self.add_sunlight(carrier, share * self.water.specular, layer, contact, scratch);
    }

    /// The sun's image seen through the surface from below: the same ripples, refracting.
    ///
    /// *Source*: B. Walter et al., Microfacet models for refraction through rough surfaces, 2007, eq. 21 (without
    /// shadowing, which is 1 to a percent at these roughnesses), times the cosine at the sun.
    fn add_sun_through(&self, arrival: &Arrival, layer: Layer, scratch: &mut Scratch) {
        let Arrival { carrier, direction, contact, .. } = arrival;
        let Some(alpha) = self.water.alpha.filter(|_| carrier.in_water) else { return };
        let (to_eye, to_sun) = (-*direction, self.sun.direction);
        if contact.normal.dot(to_sun) <= 0.0 {
            return;
        }
        // Half vector on the air's side: h = -(n_water to_eye + to_sun), turned up.
        let sum = self.water.ior * to_eye + to_sun;
        let half = if sum.dot(contact.shading) < 0.0 { -sum } else { sum }.normalize_or(contact.shading);
        let (eye_half, sun_half) = (to_eye.dot(half), to_sun.dot(half));
        if eye_half >= 0.0 || sun_half <= 0.0 {
            return;
        }
        let alpha2 = alpha * alpha;
        let cos_half = half.dot(contact.shading);
        let width = cos_half * cos_half * alpha2 + contact.shading.cross(half).length_squared();
        let distribution = alpha2 / (std::f32::consts::PI * width * width);
        let through = 1.0 - self.water.reflectance(sun_half, false);
        let eye_cosine = to_eye.dot(contact.shading).abs().max(f32::MIN_POSITIVE);
        let denominator = self.water.ior * eye_half + sun_half;
        // Radiance in water per irradiance in air: the n^2 of the denser side is in eq. 21's numerator.
        let lobe =
            -eye_half * sun_half / eye_cosine * self.density() * through * distribution / (denominator * denominator);
        self.add_sunlight(carrier, Vec3::splat(lobe), layer, contact, scratch);
    }

    /// Adds `share` (1/sr) of the sun's irradiance to a sample, shadowed unless that cannot be seen.
    fn add_sunlight(&self, carrier: &Carrier, share: Vec3, layer: Layer, contact: &Contact, scratch: &mut Scratch) {
        let light = carrier.throughput * share * self.sun.irradiance;
        if light.max_element() <= 0.0 {
            return;
        }
        // Under half's rounding of a white card in the same sun, a shadow does not show: it is added as if free.
        if (carrier.throughput * share).max_element() < LEAST_THROUGHPUT * std::f32::consts::FRAC_1_PI {
            scratch.film.add(carrier.place, layer, SUN, light);
            return;
        }
        let shadow = ShadowCarrier::in_air(light, carrier.distance, carrier.place, layer, SUN);
        self.push_shadow(contact, self.sun.direction, f32::INFINITY, shadow, scratch);
    }

    /// Queues a ray, or ends it with the sky's radiance.
    fn spawn(&self, carrier: Carrier, direction: Vec3, contact: &Contact, kind: Kind, scratch: &mut Scratch) {
        let brightest = carrier.throughput.max_element();
        if carrier.depth > self.depth || brightest < LEAST_THROUGHPUT {
            if brightest > 0.0 {
                let density = if carrier.in_water { self.density() } else { 1.0 };
                let light = carrier.throughput * self.sky_over(&carrier, direction) * density;
                scratch.film.add(carrier.place, carrier.layer.unwrap_or(Layer::Sky), SKY, light);
            }
            scratch.film.add_guide(carrier.place.pixel, carrier.guide, Vec3::ONE, Vec3::ZERO);
            return;
        }
        let tolerance = self.secondary_tolerance_at(carrier.distance);
        let mut start = (contact.leave(direction), 0.0, tolerance);
        match kind {
            Kind::Reflection => scratch.counts.reflection += 1,
            Kind::Refraction => scratch.counts.refraction += 1,
            Kind::Transparency(behind) => {
                scratch.counts.transparency += 1;
                start = behind;
            }
        }
        let (origin, tnear, tolerance) = start;
        scratch.next.rays.push(origin, direction, tnear, f32::INFINITY, tolerance);
        scratch.next.carriers.push(carrier);
    }

    fn shade_matte(&self, arrival: &Arrival, scratch: &mut Scratch) {
        let Arrival { carrier, direction, contact, .. } = arrival;
        let Some(mut matte) = self.matte(arrival) else {
            // From inside a droplet: its share was taken on the way in.
            let on = Carrier { passed: carrier.passed + 1, ..*carrier };
            self.spawn(on, *direction, contact, Kind::Transparency(self.behind_arrival(arrival)), scratch);
            return;
        };
        // What would not be followed is taken for spray, so that it keeps its share of light.
        let behind = carrier.throughput.max_element() * (1.0 - matte.opacity);
        if behind < LEAST_THROUGHPUT || carrier.passed >= PASSES {
            matte.opacity = 1.0;
        }
        let Matte { albedo, normal, facing, line, sky_view, opacity, velocity, own_layer, depth, drops } = matte;
        if carrier.primary {
            self.offer(arrival, normal, velocity, 0.0, scratch);
        }
        scratch.film.add_guide(carrier.place.pixel, carrier.guide * opacity, albedo, normal);
        let sight = self.cover(carrier, arrival.seen, opacity, scratch);

        let layer = carrier.layer.unwrap_or(own_layer);
        let mut weight = carrier.throughput * albedo * (opacity * std::f32::consts::FRAC_1_PI);
        if carrier.in_water {
            weight *= self.returned_light(albedo, depth);
        }
        let ambient = match &line {
            _ if carrier.in_water => self.ambient_below(normal, depth),
            // The sky's irradiance is of degree two in the normal.
            Some(line) => line.mean(normal, |normal| self.sky.irradiance(normal)),
            None => self.sky.irradiance(normal),
        };
        scratch.film.add(carrier.place, layer, SKY, weight * ambient * sky_view);
        let direct_layer =
            if carrier.in_water && carrier.layer == Some(Layer::Refraction) { Layer::Caustics } else { layer };
        let receiver = Receiver {
            contact,
            normal,
            facing,
            line,
            drops,
            weight,
            in_water: carrier.in_water,
            depth,
            distance: carrier.distance,
            place: carrier.place,
            layer: direct_layer,
        };
        self.ask_for_light(&receiver, scratch);

        if opacity < 1.0 {
            let behind = Carrier {
                throughput: carrier.throughput * (1.0 - opacity),
                guide: carrier.guide * (1.0 - opacity),
                passed: carrier.passed + 1,
                primary: false,
                sight,
                ..*carrier
            };
            self.spawn(behind, *direction, contact, Kind::Transparency(self.behind_arrival(arrival)), scratch);
        }
    }

    /// Sky light on a card under water: what a level surface lets in, absorbed on its mean way down. It comes from within
    /// a narrow cone about the vertical, so a tilted card sees it as one turned from a level one by half its tilt.
    fn ambient_below(&self, normal: Vec3, depth: f32) -> Vec3 {
        let look = &self.water;
        let level = self.sky.irradiance(Vec3::Y) * look.diffuse_transmittance;
        let (from_above, from_bed) = (0.5 + 0.5 * normal.y, 0.5 - 0.5 * normal.y);
        level * transmittance(look.absorption, look.diffuse_path * depth) * (from_above + self.bed_albedo * from_bed)
    }

    /// Gain of a bed's light from what the surface above sends back down to it, over and over: 1 / (1 - albedo r T^2).
    fn returned_light(&self, albedo: Vec3, depth: f32) -> Vec3 {
        let look = &self.water;
        let round_trip = transmittance(look.absorption, 2.0 * look.diffuse_path * depth);
        Vec3::ONE / (Vec3::ONE - albedo * look.diffuse_return * round_trip)
    }
}
