//! Both integrators, breadth-first: trace a wave of rays, hand every end to the integrator, which queues what follows, and
//! repeat. Which pixels get samples, and how many, is decided here too.

use glam::Vec3;

use super::{
    batches::{CameraSample, Carrier, PathState, Scratch},
    contact::Contact,
    cryptomatte::Seen,
    film::{FilmTile, Nearest, Place},
    plan::Plan,
    sampler::Sampler,
    world::World,
};
use crate::{
    accel::NO_PART,
    lower::{Material, Part},
    output::Window,
    scene::Integrator,
};

/// Rays of a chunk: enough to fill every lane, few enough to stay in a processor's cache.
const CHUNK: u32 = 16_384;

/// A ray that ended, and where.
pub(super) struct Arrival<'a> {
    pub(super) carrier: Carrier,
    /// Where it has been taken to before.
    pub(super) origin: Vec3,
    pub(super) direction: Vec3,
    /// Metres from there.
    pub(super) t: f32,
    /// The ray's own origin and t, which are the same unless it has passed billboards that turn to it.
    pub(super) whole: (Vec3, f32),
    pub(super) part: &'a Part,
    pub(super) primitive: u32,
    pub(super) place: [f32; 2],
    pub(super) contact: Contact,
    /// What it is to Cryptomatte.
    pub(super) seen: Seen,
}

impl Arrival<'_> {
    /// Which of the two waters the ray has met, as [`Carrier::within`] counts them.
    #[inline]
    pub(super) fn body(&self) -> Option<usize> {
        match self.part.material {
            Material::Water => Some(0),
            Material::Sheet => Some(1),
            _ => None,
        }
    }

    /// [`Carrier::within`] beyond what was met.
    #[inline]
    pub(super) fn beyond(&self) -> [bool; 2] {
        let mut within = self.carrier.within;
        if let Some(body) = self.body() {
            within[body] = !within[body];
        }
        within
    }

    /// Whether there is water on both sides: the one that was met ends or begins inside of the other.
    #[inline]
    pub(super) fn is_inner(&self) -> bool {
        self.body().is_some_and(|body| self.carrier.within[1 - body])
    }
}

impl World<'_> {
    /// Takes a ray straight on through a border with the same water on both sides.
    pub(super) fn pass_inner(&self, arrival: &Arrival, scratch: &mut Scratch) {
        let Arrival { carrier, direction, contact, .. } = arrival;
        if carrier.passed == u16::MAX {
            scratch.paths.spent += 1;
            return;
        }
        let path = PathState { event: carrier.path.event.saturating_add(1), ..carrier.path };
        let on = Carrier { within: arrival.beyond(), passed: carrier.passed + 1, path, ..*carrier };
        let tolerance = self.secondary_tolerance_at(carrier.distance);
        scratch.next.rays.push(contact.leave(*direction), *direction, 0.0, f32::INFINITY, tolerance);
        scratch.next.carriers.push(on);
    }

    /// What every arrival tells: on which side of the water's surface the ray was, whatever was thought before, and how
    /// long the first refracted ray is.
    pub(super) fn note_arrival(&self, arrival: &mut Arrival, scratch: &mut Scratch) {
        if let Some(body) = arrival.body() {
            let carrier = &mut arrival.carrier;
            carrier.within[body] = arrival.direction.dot(arrival.contact.normal) > 0.0;
            carrier.in_water = carrier.within != [false; 2];
        }
        let carrier = &mut arrival.carrier;
        if carrier.notes_path {
            let sample = scratch.samples[carrier.place.path as usize].sample;
            scratch.film.note_path(carrier.place.pixel, sample, arrival.t);
            carrier.notes_path = false;
        }
    }

    /// Offers the water that a camera's ray has met to the film, with its depth.
    pub(super) fn offer_water(&self, arrival: &Arrival, scratch: &mut Scratch) {
        let contact = &arrival.contact;
        let bed = self.matter.bed_level(contact.position.x, contact.position.z);
        let depth = bed.map_or(0.0, |bed| (contact.position.y - bed).max(0.0));
        self.offer(arrival, contact.shading, Vec3::ZERO, depth, scratch);
    }

    /// Offers what a camera's ray has met to the film: shading normal, velocity (m/s), depth of the water (m).
    pub(super) fn offer(
        &self,
        arrival: &Arrival,
        normal: Vec3,
        velocity: Vec3,
        water_depth: f32,
        scratch: &mut Scratch,
    ) {
        let position = arrival.contact.position;
        let depth = self.camera.depth(self.lowered.origin + position.as_dvec3()) as f32;
        let sample = scratch.samples[arrival.carrier.place.path as usize].sample;
        let nearest = Nearest { depth, sample, position, normal, velocity, water_depth, water_path: 0.0 };
        scratch.film.offer(arrival.carrier.place.pixel, nearest);
    }
}

/// A frame ready to be rendered: the moments of its shutter, and when a pixel has had enough.
pub(super) struct Frame<'a> {
    /// One world per moment; sample i belongs to moment i modulo their count.
    pub(super) moments: Vec<World<'a>>,
    /// When a pixel has had enough.
    pub(super) plan: Plan,
}

/// Luminance that the relative error counts on top of a pixel's own: a tenth of a white card in daylight. Noise in what
/// is darker does not show.
const FLOOR: f64 = 0.1;

/// Whether every pixel of a tile has had what it gets by `plan` in all. Under a time limit any sample is enough.
pub(super) fn is_done(plan: &Plan, total: &FilmTile) -> bool {
    let window = total.window;
    (0..window.width * window.height).all(|pixel| {
        let samples = total.samples(pixel);
        match plan.noise {
            _ if plan.first < plan.least => samples >= plan.first,
            Some(noise) if samples < plan.most => samples >= plan.least && total.relative_error(pixel, FLOOR) <= noise,
            Some(_) => true,
            None => samples >= plan.least,
        }
    })
}

impl Frame<'_> {
    fn sampler(&self) -> &Sampler {
        &self.moments[0].sampler
    }

    /// Renders the samples of `range` of the pixels of the film's tile that have had every sample before and are not
    /// good enough yet. True if there was any.
    ///
    /// The range's sums are made by themselves and then joined to the tile's, so that ranges that were rendered elsewhere
    /// join to the same bits.
    ///
    /// A pixel's samples of a range are always in one chunk, or in chunks cut by sample alone, so that its sums are made
    /// in the same order whatever tile or crop it is in.
    pub(super) fn render(&self, range: std::ops::Range<u32>, scratch: &mut Scratch) -> bool {
        let window = scratch.total.window;
        let mut active = std::mem::take(&mut scratch.active);
        active.clear();
        let open = |pixel: &u32| {
            self.plan.range[0] + scratch.total.samples(*pixel) == range.start
                && (range.start < self.plan.least
                    || self.plan.noise.is_none_or(|noise| scratch.total.relative_error(*pixel, FLOOR) > noise))
        };
        active.extend((0..window.width * window.height).filter(open));
        if !active.is_empty() {
            scratch.film.reset_as(&scratch.total);
        }
        let step = self.moments.len() as u32;
        let per_chunk = (CHUNK / (range.end - range.start)).max(1);
        for pixels in active.chunks(per_chunk as usize) {
            let mut start = range.start;
            while start < range.end {
                let end = range.end.min(start + CHUNK);
                for (moment, world) in self.moments.iter().enumerate() {
                    let first = start + (moment as u32 + step - start % step) % step;
                    scratch.samples.clear();
                    for &pixel in pixels {
                        let [x, y] = place(window, pixel);
                        let run = self.sampler().run(x, y);
                        let samples = (first..end).step_by(step as usize);
                        scratch.samples.extend(samples.map(|sample| CameraSample { pixel, sample, run }));
                    }
                    world.follow(scratch);
                }
                start = end;
            }
        }
        let any = !active.is_empty();
        if any {
            scratch.total.join(&scratch.film);
        }
        scratch.active = active;
        any
    }
}

/// Raster place of a tile's pixel in the full frame.
fn place(window: Window, pixel: u32) -> [i32; 2] {
    [window.x + (pixel % window.width) as i32, window.y + (pixel / window.width) as i32]
}

impl World<'_> {
    /// Sends out the camera's samples and follows everything until nothing is left.
    fn follow(&self, scratch: &mut Scratch) {
        scratch.wave.clear();
        let window = scratch.film.window;
        // A camera under water looks through a port: in it, light has the density of air again.
        let throughput = Vec3::splat(if self.eye_in_water { 1.0 / self.density() } else { 1.0 });
        for (path, camera_sample) in scratch.samples.iter().enumerate() {
            let CameraSample { pixel, sample, run } = *camera_sample;
            let [x, y] = place(window, pixel);
            let at = self.sampler.sample(x, y, run, sample);
            let (origin, direction) = self.camera.ray(at.raster, at.lens, self.lowered.origin);
            scratch.wave.rays.push(origin, direction, 0.0, f32::INFINITY, self.tolerance[0]);
            scratch.wave.carriers.push(Carrier::camera(
                throughput,
                Place { pixel, path: path as u32 },
                self.eye_in_water,
                self.pixel_cone(),
            ));
        }
        scratch.counts.primary += scratch.wave.rays.len() as u64;
        scratch.film.begin(scratch.samples.len());
        self.run(scratch);
        let Scratch { film, samples, .. } = scratch;
        film.end(samples.iter().map(|sample| sample.pixel));
    }

    fn run(&self, scratch: &mut Scratch) {
        let mut growth = self.tolerance[1];
        while !scratch.wave.rays.is_empty() {
            scratch.wave.rays.tolerance_growth = growth;
            growth = self.secondary_tolerance[1];
            self.accelerator.closest(&scratch.wave.rays, &mut scratch.hits, &mut scratch.solve);
            scratch.next.clear();
            scratch.shadow.clear();
            scratch.links.clear();
            for index in 0..scratch.wave.rays.len() {
                let carrier = scratch.wave.carriers[index];
                let (origin, direction) = (scratch.wave.rays.origin(index), scratch.wave.rays.direction(index));
                let hit = scratch.hits.part[index];
                let begin = scratch.wave.rays.tnear[index];
                let start = origin + begin * direction;
                if hit == NO_PART {
                    match self.integrator {
                        Integrator::Whitted => self.escape(carrier, start, direction, scratch),
                        Integrator::Path => self.path_escape(carrier, start, direction, scratch),
                    }
                    continue;
                }
                let part = &self.lowered.parts[hit as usize];
                let primitive = scratch.hits.primitive[index];
                let place = [scratch.hits.u[index], scratch.hits.v[index]];
                let t = scratch.hits.t[index];
                let given = Vec3::from_array(std::array::from_fn(|axis| scratch.hits.normal[axis][index]));
                let contact = Contact::new(part, primitive, place, origin, direction, t, given);
                let seen = self.things.part(hit as usize);
                let arrival = Arrival {
                    carrier,
                    origin: start,
                    direction,
                    t: t - begin,
                    whole: (origin, t),
                    part,
                    primitive,
                    place,
                    contact,
                    seen,
                };
                match self.integrator {
                    Integrator::Whitted => self.arrive(arrival, scratch),
                    Integrator::Path => self.path_arrive(arrival, scratch),
                }
            }
            self.trace_shadows(scratch);
            self.trace_links(scratch);
            std::mem::swap(&mut scratch.wave, &mut scratch.next);
        }
    }
}
