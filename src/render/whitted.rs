//! The Whitted integrator, breadth-first: trace a wave of rays, shade every hit, queue what follows, repeat.
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
    film::{Layer, Nearest},
    shadow::Receiver,
    world::World,
};
use crate::{
    accel::NO_PART,
    lower::{Material, Part, Shape},
    optics::{
        absorb::transmittance,
        fresnel::{reflect, refract},
        highlight,
    },
    output::Window,
};

/// Rays of a chunk: enough to fill every lane, few enough to stay in a processor's cache.
const CHUNK: u32 = 16_384;

/// Throughput under which a ray is not followed: half's rounding (11 bits) of a pixel as bright as what the ray would see.
const LEAST_THROUGHPUT: f32 = 1.0 / 2048.0;

/// Spray that a ray passes before it takes the next for opaque; a ball counts twice, in and out.
const PASSES: u16 = 64;

/// A ray that ended, and where.
struct Arrival<'a> {
    carrier: Carrier,
    direction: Vec3,
    /// Metres of the ray.
    t: f32,
    part: &'a Part,
    primitive: u32,
    place: [f32; 2],
    contact: Contact,
}

enum Kind {
    Reflection,
    Refraction,
    Transparency,
}

impl World<'_> {
    /// Renders the pixels of `window` into the scratch's film.
    ///
    /// A pixel's samples are always in one chunk, or in chunks cut by sample alone, so that its sums are made in the same
    /// order whatever tile or crop it is in.
    pub(super) fn render_tile(&self, window: Window, scratch: &mut Scratch) {
        scratch.film.reset(window);
        let samples = self.sampler.samples();
        let pixels = window.width * window.height;
        let pixels_per_chunk = (CHUNK / samples).max(1);
        let mut pixel = 0;
        while pixel < pixels {
            let end = (pixel + pixels_per_chunk).min(pixels);
            let mut sample = 0;
            while sample < samples {
                let sample_end = (sample + CHUNK).min(samples);
                self.generate(window, pixel..end, sample..sample_end, scratch);
                self.run(scratch);
                sample = sample_end;
            }
            pixel = end;
        }
    }

    fn generate(
        &self,
        window: Window,
        pixels: std::ops::Range<u32>,
        samples: std::ops::Range<u32>,
        scratch: &mut Scratch,
    ) {
        scratch.wave.clear();
        // A camera under water looks through a port: in it, light has the density of air again.
        let throughput = Vec3::splat(if self.eye_in_water { 1.0 / self.density() } else { 1.0 });
        for pixel in pixels {
            let x = window.x + (pixel % window.width) as i32;
            let y = window.y + (pixel / window.width) as i32;
            for sample in samples.clone() {
                let place = self.sampler.sample(x, y, sample);
                let (origin, direction) = self.camera.ray(place.raster, place.lens, self.lowered.origin);
                scratch.wave.rays.push(origin, direction, 0.0, f32::INFINITY, self.tolerance[0]);
                scratch.wave.carriers.push(Carrier {
                    throughput,
                    guide: 1.0,
                    distance: 0.0,
                    pixel,
                    sample,
                    layer: None,
                    depth: 0,
                    passed: 0,
                    in_water: self.eye_in_water,
                    primary: true,
                    notes_path: false,
                });
            }
        }
        scratch.counts.primary += scratch.wave.rays.len() as u64;
    }

    /// Follows the wave until nothing is left of it.
    fn run(&self, scratch: &mut Scratch) {
        let mut growth = self.tolerance[1];
        while !scratch.wave.rays.is_empty() {
            scratch.wave.rays.tolerance_growth = growth;
            growth = self.secondary_tolerance[1];
            self.accelerator.closest(&scratch.wave.rays, &mut scratch.hits, &mut scratch.solve);
            scratch.next.clear();
            scratch.shadow.clear();
            for index in 0..scratch.wave.rays.len() {
                let carrier = scratch.wave.carriers[index];
                let direction = scratch.wave.rays.direction(index);
                if scratch.hits.part[index] == NO_PART {
                    self.escape(&carrier, direction, scratch);
                    continue;
                }
                let part = &self.lowered.parts[scratch.hits.part[index] as usize];
                let primitive = scratch.hits.primitive[index];
                let place = [scratch.hits.u[index], scratch.hits.v[index]];
                let t = scratch.hits.t[index];
                let given = Vec3::from_array(std::array::from_fn(|axis| scratch.hits.normal[axis][index]));
                let origin = scratch.wave.rays.origin(index);
                let contact = Contact::new(part, primitive, place, origin, direction, t, given);
                self.arrive(Arrival { carrier, direction, t, part, primitive, place, contact }, scratch);
            }
            self.trace_shadows(scratch);
            std::mem::swap(&mut scratch.wave, &mut scratch.next);
        }
    }

    /// A ray that met nothing.
    fn escape(&self, carrier: &Carrier, direction: Vec3, scratch: &mut Scratch) {
        let film = &mut scratch.film;
        film.add_guide(carrier.pixel, carrier.guide, Vec3::ONE, Vec3::ZERO);
        if carrier.in_water {
            // Water without an end: clear channels still see the sky's light, n^2 denser.
            let light =
                self.sky.radiance(direction) * self.density() * transmittance(self.water.absorption, f32::INFINITY);
            film.add(carrier.pixel, carrier.layer.unwrap_or(Layer::Sky), carrier.throughput * light);
            return;
        }
        let Some(layer) = carrier.layer else {
            // Only the camera's own rays see the sun's disc: on water it is the highlight's matter.
            if self.sky_visible {
                let disc = if self.sun.contains(direction) { self.sun.disc_radiance } else { Vec3::ZERO };
                film.add(carrier.pixel, Layer::Sky, carrier.throughput * (self.sky.radiance(direction) + disc));
            } else {
                film.add_uncovered(carrier.pixel, carrier.throughput.x);
            }
            return;
        };
        film.add(carrier.pixel, layer, carrier.throughput * self.sky.radiance(direction));
    }

    /// A ray that met something: absorption on its way, the film's data, then light by material.
    fn arrive(&self, mut arrival: Arrival, scratch: &mut Scratch) {
        let Arrival { direction, t, part, contact, .. } = arrival;
        let water = matches!(part.material, Material::Water);
        // Which side of the water's surface is met says what the ray came through, whatever was thought before.
        if water {
            arrival.carrier.in_water = direction.dot(contact.normal) > 0.0;
        }
        let carrier = &mut arrival.carrier;
        if carrier.notes_path {
            scratch.film.note_path(carrier.pixel, carrier.sample, t);
            carrier.notes_path = false;
        }
        if carrier.in_water {
            carrier.throughput *= transmittance(self.water.absorption, t);
        }
        carrier.distance += t;
        if water {
            if carrier.primary {
                let depth = match self.matter.bed_level(contact.position.x, contact.position.z) {
                    Some(bed) => (contact.position.y - bed).max(0.0),
                    None => 0.0,
                };
                self.offer(&arrival, contact.shading, Vec3::ZERO, depth, scratch);
            }
            let open = arrival.carrier.in_water || matches!(arrival.part.shape, Shape::Sides(_));
            if open || self.shade_foam(&mut arrival, scratch) {
                self.shade_water(&arrival, scratch);
            }
        } else {
            self.shade_diffuse(&arrival, scratch);
        }
    }

    fn offer(&self, arrival: &Arrival, normal: Vec3, velocity: Vec3, water_depth: f32, scratch: &mut Scratch) {
        let position = arrival.contact.position;
        let depth = self.camera.depth(self.lowered.origin + position.as_dvec3()) as f32;
        let nearest =
            Nearest { depth, sample: arrival.carrier.sample, position, normal, velocity, water_depth, water_path: 0.0 };
        scratch.film.offer(arrival.carrier.pixel, nearest);
    }

    /// Density of radiance in water against air, n^2.
    #[inline]
    fn density(&self) -> f32 {
        self.water.ior * self.water.ior
    }

    /// Foam on the water as seen from the air: `cover` of it is a diffuse layer, the rest is left for the water below. False
    /// if nothing is left.
    fn shade_foam(&self, arrival: &mut Arrival, scratch: &mut Scratch) -> bool {
        let Arrival { carrier, direction, contact, .. } = arrival;
        // A pixel lies stretched over a slanted surface: the footprint has the same area.
        let cosine = direction.dot(contact.normal).abs().max(f32::EPSILON);
        let footprint = carrier.distance * self.camera.pixel_angle() as f32 / cosine.sqrt();
        let Some(foam) = self.matter.foam(contact.position, footprint) else { return true };
        // What would not be followed below is taken for foam, so that it keeps its share of light.
        let below = carrier.throughput.max_element() * (1.0 - foam.cover);
        let cover = if below < LEAST_THROUGHPUT { 1.0 } else { foam.cover };
        let layer = carrier.layer.unwrap_or(Layer::Foam);
        if carrier.primary {
            scratch.film.add_foam(carrier.pixel, cover);
        }
        let normal = contact.shading;
        scratch.film.add_guide(carrier.pixel, carrier.guide * cover, foam.albedo, normal);
        let weight = carrier.throughput * foam.albedo * (cover * std::f32::consts::FRAC_1_PI);
        scratch.film.add(carrier.pixel, layer, weight * self.sky.irradiance(normal));
        let receiver = Receiver {
            contact,
            normal,
            facing: Some(contact.normal),
            weight,
            in_water: false,
            depth: 0.0,
            distance: carrier.distance,
            pixel: carrier.pixel,
            layer,
        };
        self.ask_for_light(&receiver, scratch);
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

        scratch.film.add_guide(carrier.pixel, carrier.guide * reflectance, Vec3::ONE, contact.shading);
        if !from_water {
            self.add_highlight(arrival, reflection_layer, scratch);
            if diffuse.max_element() > 0.0 {
                let weight = carrier.throughput * diffuse * std::f32::consts::FRAC_1_PI;
                scratch.film.add(carrier.pixel, reflection_layer, weight * self.sky.irradiance(normal));
                let receiver = Receiver {
                    contact,
                    normal,
                    facing: Some(side(contact.normal)),
                    weight,
                    in_water: false,
                    depth: 0.0,
                    distance: carrier.distance,
                    pixel: carrier.pixel,
                    layer: reflection_layer,
                };
                self.ask_for_light(&receiver, scratch);
            }
        }

        let child = Carrier { depth: carrier.depth + 1, primary: false, ..*carrier };
        // Inside, the mirror must not lose light: the report's specular factor is meant for what the eye sees from outside.
        let mirror = if from_water { Vec3::ONE } else { look.specular };
        let mirrored = Carrier {
            throughput: carrier.throughput * mirror * reflectance,
            guide: 0.0,
            layer: Some(reflection_layer),
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
                in_water: !from_water,
                notes_path: carrier.primary && !from_water,
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
            scratch.film.add(carrier.pixel, layer, light);
            return;
        }
        let shadow = ShadowCarrier {
            light,
            share: 1.0,
            level_path: 0.0,
            distance: carrier.distance,
            pixel: carrier.pixel,
            layer,
            crossed: 0,
            in_water: false,
            bent: false,
        };
        self.push_shadow(contact, self.sun.direction, f32::INFINITY, shadow, scratch);
    }

    /// Queues a ray, or ends it with the sky's radiance.
    fn spawn(&self, carrier: Carrier, direction: Vec3, contact: &Contact, kind: Kind, scratch: &mut Scratch) {
        let brightest = carrier.throughput.max_element();
        if carrier.depth > self.depth || brightest < LEAST_THROUGHPUT {
            if brightest > 0.0 {
                let density = if carrier.in_water { self.density() } else { 1.0 };
                let light = carrier.throughput * self.sky.radiance(direction) * density;
                scratch.film.add(carrier.pixel, carrier.layer.unwrap_or(Layer::Sky), light);
            }
            scratch.film.add_guide(carrier.pixel, carrier.guide, Vec3::ONE, Vec3::ZERO);
            return;
        }
        match kind {
            Kind::Reflection => scratch.counts.reflection += 1,
            Kind::Refraction => scratch.counts.refraction += 1,
            Kind::Transparency => scratch.counts.transparency += 1,
        }
        let origin = contact.leave(direction);
        scratch.next.rays.push(origin, direction, 0.0, f32::INFINITY, self.secondary_tolerance_at(carrier.distance));
        scratch.next.carriers.push(carrier);
    }

    fn shade_diffuse(&self, arrival: &Arrival, scratch: &mut Scratch) {
        let Arrival { carrier, direction, part, primitive, contact, .. } = arrival;
        let towards_viewer = |normal: Vec3| if direction.dot(normal) > 0.0 { -normal } else { normal };
        let mut normal = if direction.dot(contact.normal) > 0.0 { -contact.shading } else { contact.shading };
        let mut facing = Some(towards_viewer(contact.normal));
        let (mut sky_view, mut opacity, mut velocity) = (1.0, 1.0, Vec3::ZERO);
        let mut own_layer = Layer::Terrain;
        let depth = if carrier.in_water { self.depth_at(contact.position) } else { 0.0 };
        let albedo = match &part.material {
            Material::Ground => {
                let footprint = carrier.distance * self.camera.pixel_angle() as f32;
                let look = self.matter.ground(contact.position, contact.shading, depth, footprint);
                normal = if direction.dot(contact.normal) > 0.0 { -look.normal } else { look.normal };
                sky_view = look.sky_view;
                look.albedo
            }
            Material::Spray => {
                let ball = matches!(part.shape, Shape::Spheres(_));
                if ball && direction.dot(contact.normal) > 0.0 && carrier.passed < PASSES {
                    // From inside a droplet: its share was taken on the way in.
                    let on = Carrier { passed: carrier.passed + 1, ..*carrier };
                    self.spawn(on, *direction, contact, Kind::Transparency, scratch);
                    return;
                }
                let look = self.matter.spray(*primitive);
                own_layer = Layer::Spray;
                velocity = look.velocity;
                let behind = carrier.throughput.max_element() * (1.0 - look.opacity);
                // What would not be followed is taken for spray, so that it keeps its share of light.
                opacity = if behind < LEAST_THROUGHPUT || carrier.passed >= PASSES { 1.0 } else { look.opacity };
                if !ball {
                    facing = None;
                }
                look.albedo
            }
            Material::Diffuse(albedo) => *albedo,
            Material::VertexColours(colours) => self.vertex_colour(arrival, colours),
            // Water has a shading of its own.
            Material::Water => return,
        };
        if carrier.primary {
            self.offer(arrival, normal, velocity, 0.0, scratch);
        }
        scratch.film.add_guide(carrier.pixel, carrier.guide * opacity, albedo, normal);

        let layer = carrier.layer.unwrap_or(own_layer);
        let mut weight = carrier.throughput * albedo * (opacity * std::f32::consts::FRAC_1_PI);
        if carrier.in_water {
            weight *= self.returned_light(albedo, depth);
        }
        let ambient = if carrier.in_water { self.ambient_below(normal, depth) } else { self.sky.irradiance(normal) };
        scratch.film.add(carrier.pixel, layer, weight * ambient * sky_view);
        let direct_layer =
            if carrier.in_water && carrier.layer == Some(Layer::Refraction) { Layer::Caustics } else { layer };
        let receiver = Receiver {
            contact,
            normal,
            facing,
            weight,
            in_water: carrier.in_water,
            depth,
            distance: carrier.distance,
            pixel: carrier.pixel,
            layer: direct_layer,
        };
        self.ask_for_light(&receiver, scratch);

        if opacity < 1.0 {
            let behind = Carrier {
                throughput: carrier.throughput * (1.0 - opacity),
                guide: carrier.guide * (1.0 - opacity),
                passed: carrier.passed + 1,
                primary: false,
                ..*carrier
            };
            self.spawn(behind, *direction, contact, Kind::Transparency, scratch);
        }
    }

    fn vertex_colour(&self, arrival: &Arrival, colours: &[Vec3]) -> Vec3 {
        let Shape::Triangles(triangles) = &arrival.part.shape else { return Vec3::ZERO };
        let [a, b, c] = triangles.index[arrival.primitive as usize].map(|corner| colours[corner as usize]);
        let [u, v] = arrival.place;
        a * (1.0 - u - v) + b * u + c * v
    }

    /// Depth (m) of a point under the water's surface above it; 0 where the water's height is not known.
    fn depth_at(&self, position: Vec3) -> f32 {
        self.matter.water_level(position.x, position.z).map_or(0.0, |level| (level - position.y).max(0.0))
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
