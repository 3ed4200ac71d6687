//! A deep picture: what the flat picture's own camera samples meet along their straight ways, until nothing is left to be
//! seen.
//!
//! Balls and streaks are spans from where a ray enters them to where it leaves, mist a span for each of its grid's bricks that a
//! ray crosses, by its exact optical depth: nothing is stepped. Water is opaque at its surface, or a span down to the bed along
//! the straight line; ground and objects are opaque, and so is a visible sky behind all. `visibility` makes a pixel's samples
//! of them.

mod visibility;

use std::ops::ControlFlow;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use glam::Vec3;

use self::visibility::{Event, KINDS, Kind, Tolerance, deep_samples};
use super::{
    Job, Observer, RenderError,
    contact::Contact,
    cryptomatte::Names,
    sampler::Sampler,
    tiles,
    world::{Shared, World},
};
use crate::{
    accel::{HitBatch, NO_PART, RayBatch},
    lower::{Material, Shape},
    output::{DeepPicture, DeepSample, Picture, Window},
    scene::{Caustics, DeepWater},
    surface::SolveCounts,
};

/// Depth (m) of the sky, where it is to be seen.
const SKY: f32 = 1e10;

/// What is left to be seen under which a way ends: half of it rounds to nothing beside an alpha of 1 in half.
const LEAST: f32 = 1.0 / 4096.0;

/// Hits after which a way ends as if it had met a wall: the flat picture follows fewer.
const HITS: u32 = 1024;

/// A camera sample under way.
struct Way {
    sample: u32,
    pixel: u32,
    origin: Vec3,
    direction: Vec3,
    /// Metres from the eye to the ray's own origin.
    behind: f32,
    tnear: f32,
    left: f32,
    hits: u32,
    /// Where it entered balls that it has not left yet: part, particle, planar depth, opacity.
    within: Vec<(u32, u32, f32, f32)>,
    /// Where it entered water: planar depth, and metres from the eye.
    water: Option<(f32, f32)>,
}

/// Memory of a thread.
#[derive(Default)]
struct Scratch {
    ways: Vec<Way>,
    rays: RayBatch,
    hits: HitBatch,
    solve: SolveCounts,
    events: Vec<Vec<Event>>,
}

/// Renders the deep picture that belongs to a flat one of the same job: the same pixels, and of each the same samples.
///
/// Colour, if asked for (`output.deep.color`), is the flat picture's: what spray, mist and the rest have of it is given out along
/// the samples of each, by what they stop. When `stop` becomes true the rest of the pixels stay empty, and the picture says
/// that it is not complete.
///
/// *Errors*: those of [`super::render_frame`].
pub fn render_deep(
    job: &Job,
    flat: &Picture,
    stop: &AtomicBool,
    observer: &dyn Observer,
) -> Result<DeepPicture, RenderError> {
    if job.moments.is_empty() {
        return Err(RenderError::NoMoment);
    }
    // Straight ways meet no caustics: nothing is built for them.
    let mut scene = job.scene.clone();
    scene.render.caustics = Some(Caustics::Off);
    let settings = &scene.output.deep;
    let shared = Shared::new(&scene, job.sky);
    let mut names = Names::default();
    let worlds = job
        .moments
        .iter()
        .map(|moment| World::new(&scene, &shared, moment, job.sky, job.camera(moment.time), &mut names));
    let worlds: Vec<World> = worlds.collect::<Result<_, _>>()?;
    let tolerance = Tolerance { alpha: settings.alpha_tolerance as f32, depth: settings.depth_tolerance as f32 };
    let data = flat.data;
    let light = settings.color.then(|| Light::of(flat));
    let counts = flat.channel("sampleCount").map(|channel| &channel.samples[..]);
    let windows = tiles::tiles(data);
    let total = windows.len() as u64;
    let (done, rays) = (AtomicU64::new(0), AtomicU64::new(0));
    let pixels: Mutex<Vec<Vec<DeepSample>>> = Mutex::new(vec![Vec::new(); data.area()]);
    tiles::for_each(&windows, job.threads, stop, Scratch::default, |window, scratch| {
        let index = |pixel: u32| {
            let (x, y) = ((pixel % window.width) as i32 + window.x, (pixel / window.width) as i32 + window.y);
            (y - data.y) as usize * data.width as usize + (x - data.x) as usize
        };
        let count = |pixel: u32| counts.map_or(scene.render.samples, |counts| counts[index(pixel)] as u32);
        let traced = follow(&worlds, *window, &count, scratch, settings.water);
        let found: Vec<Vec<DeepSample>> = (0..window.width * window.height)
            .map(|pixel| {
                let light = light.as_ref().map(|light| light.at(index(pixel)));
                deep_samples(&mut scratch.events[pixel as usize], count(pixel), tolerance, light)
            })
            .collect();
        {
            // Poisoned only if another thread panicked, and then that panic is on its way to the caller anyway.
            let mut pixels = pixels.lock().unwrap_or_else(|poison| poison.into_inner());
            for (pixel, samples) in found.into_iter().enumerate() {
                pixels[index(pixel as u32)] = samples;
            }
        }
        let rays = rays.fetch_add(traced, Ordering::Relaxed) + traced;
        observer.tiles(done.fetch_add(1, Ordering::Relaxed) + 1, total, rays);
    })?;
    let pixels = pixels.into_inner().unwrap_or_else(|poison| poison.into_inner());
    let mut first = Vec::with_capacity(pixels.len() + 1);
    let mut samples = Vec::with_capacity(pixels.iter().map(Vec::len).sum());
    for pixel in pixels {
        first.push(samples.len() as u64);
        samples.extend(pixel);
    }
    first.push(samples.len() as u64);
    let mut metadata = flat.metadata.clone();
    metadata.cryptomattes.clear();
    metadata.complete &= done.into_inner() == total;
    Ok(DeepPicture {
        display: flat.display,
        data,
        first,
        samples,
        colored: settings.color,
        state: settings.state,
        metadata,
    })
}

/// Follows all samples of a tile's pixels; each pixel's events are in the scratch then. Returns the rays that it took.
fn follow(
    worlds: &[World],
    window: Window,
    count: &impl Fn(u32) -> u32,
    scratch: &mut Scratch,
    water: DeepWater,
) -> u64 {
    let pixels = window.width * window.height;
    scratch.events.iter_mut().for_each(Vec::clear);
    scratch.events.resize_with(pixels as usize, Vec::new);
    let mut traced = 0;
    for (moment, world) in worlds.iter().enumerate() {
        let sampler: &Sampler = &worlds[0].sampler;
        // A row at a time: as many rays as fill every lane, few enough to stay in a cache.
        for row in 0..window.height {
            scratch.ways.clear();
            for pixel in row * window.width..(row + 1) * window.width {
                let (x, y) = (window.x + (pixel % window.width) as i32, window.y + row as i32);
                let run = sampler.run(x, y);
                for sample in (moment as u32..count(pixel)).step_by(worlds.len()) {
                    let at = sampler.sample(x, y, run, sample);
                    let (origin, direction) = world.camera.ray(at.raster, at.lens, world.lowered.origin);
                    let water = world.eye_in_water.then_some((0.0, 0.0));
                    scratch.ways.push(Way {
                        sample,
                        pixel,
                        origin,
                        direction,
                        behind: 0.0,
                        tnear: 0.0,
                        left: 1.0,
                        hits: 0,
                        within: Vec::new(),
                        water,
                    });
                }
            }
            while !scratch.ways.is_empty() {
                traced += scratch.ways.len() as u64;
                world.deep_wave(scratch, water);
            }
        }
    }
    traced
}

impl World<'_> {
    /// Takes all ways to what they meet next; those that end there are gone.
    fn deep_wave(&self, scratch: &mut Scratch, water: DeepWater) {
        let Scratch { ways, rays, hits, solve, events } = scratch;
        rays.clear();
        for way in ways.iter() {
            let tolerance = if way.hits == 0 { self.tolerance[0] } else { self.secondary_tolerance_at(way.behind) };
            rays.push(way.origin, way.direction, way.tnear, f32::INFINITY, tolerance);
        }
        rays.tolerance_growth = self.tolerance[1];
        self.accelerator.closest(rays, hits, solve);
        let mut index = 0;
        ways.retain_mut(|way| {
            let found = (hits.part[index] != NO_PART).then(|| {
                let part = &self.lowered.parts[hits.part[index] as usize];
                let given = Vec3::from_array(std::array::from_fn(|axis| hits.normal[axis][index]));
                let place = [hits.u[index], hits.v[index]];
                let t = hits.t[index];
                let contact = Contact::new(part, hits.primitive[index], place, way.origin, way.direction, t, given);
                Found { part: hits.part[index], primitive: hits.primitive[index], t, contact }
            });
            index += 1;
            self.deep_step(way, found, &mut events[way.pixel as usize], water)
        });
    }

    /// Planar depth (m) of a point, at least 0.
    fn deep_depth(&self, point: Vec3) -> f32 {
        (self.camera.depth(self.lowered.origin + point.as_dvec3()) as f32).max(0.0)
    }

    /// What a way meets, or that it meets nothing; false where it ends.
    fn deep_step(&self, way: &mut Way, found: Option<Found>, events: &mut Vec<Event>, water: DeepWater) -> bool {
        let reach = found.as_ref().map_or(f32::INFINITY, |found| found.t);
        let Way { sample, .. } = *way;
        let mut note = |kind: Kind, front: f32, back: f32, alpha: f32| {
            if alpha > 0.0 {
                events.push(Event { sample, kind, front, back: back.max(front), alpha });
            }
        };
        if let Some(mist) = self.mist.filter(|_| way.water.is_none()) {
            let start = way.origin + way.tnear * way.direction;
            mist.bricks(start, way.direction, reach - way.tnear, |_, [from, to]| {
                let piece = start + from * way.direction;
                let alpha = -(-mist.optical_depth(piece, way.direction, to - from)).exp_m1();
                let [front, back] = [from, to].map(|t| self.deep_depth(start + t * way.direction));
                note(Kind::Mist, front, back, alpha);
                way.left *= 1.0 - alpha;
                if way.left < LEAST { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
            });
        }
        // What it is still in ends where the way does.
        let Some(found) = found else {
            if self.sky_visible {
                note(Kind::Solid, SKY, SKY, 1.0);
            }
            return false;
        };
        let Found { part: number, primitive, t, contact } = found;
        let part = &self.lowered.parts[number as usize];
        let depth = self.deep_depth(contact.position);
        let outward = way.direction.dot(contact.normal) > 0.0;
        let distance = way.behind + t;
        let ends = match &part.material {
            Material::Spray { first } => {
                let flat = matches!(part.shape, Shape::Discs(_));
                // Where it leaves a ball, the span is known.
                match way.within.iter().position(|&(part, particle, ..)| (part, particle) == (number, primitive)) {
                    Some(index) if outward && !flat => {
                        let (.., front, opacity) = way.within.swap_remove(index);
                        note(Kind::Spray, front, depth, opacity);
                    }
                    // It began inside: there is no span, and what it has passed stops nothing.
                    _ if outward && !flat => {}
                    _ => {
                        let width = self.pixel_cone().width(distance);
                        let look = self.spray_look(part, first + primitive, primitive, &contact, way.direction, width);
                        let opacity = look.opacity;
                        // What is flat, or lets nothing through, is a surface.
                        if flat || opacity >= 1.0 {
                            note(Kind::Spray, depth, depth, opacity);
                        } else {
                            way.within.push((number, primitive, depth, opacity));
                        }
                        way.left *= 1.0 - opacity;
                    }
                }
                way.left < LEAST
            }
            Material::Water | Material::Sheet => match (water, way.water) {
                (DeepWater::Front, _) => {
                    note(Kind::Solid, depth, depth, 1.0);
                    true
                }
                (DeepWater::Span, _) if !outward => {
                    way.water = Some((depth, distance));
                    false
                }
                (DeepWater::Span, entered) => {
                    let (front, since) = entered.unwrap_or((depth, distance));
                    let alpha = self.deep_water_alpha(distance - since);
                    note(Kind::Solid, front, depth, alpha);
                    way.left *= 1.0 - alpha;
                    way.water = None;
                    way.left < LEAST
                }
            },
            Material::Ground | Material::Diffuse(_) | Material::VertexColours(_) | Material::Images { .. } => {
                if let Some((front, since)) = way.water {
                    note(Kind::Solid, front, depth, self.deep_water_alpha(distance - since));
                }
                note(Kind::Solid, depth, depth, 1.0);
                true
            }
        };
        way.hits += 1;
        if ends || way.hits >= HITS {
            for (.., front, opacity) in way.within.drain(..) {
                note(Kind::Spray, front, depth, opacity);
            }
            // What is left after so much is a wall.
            if !ends || way.left < LEAST {
                note(Kind::Solid, depth, depth, 1.0);
            }
            return false;
        }
        let (origin, tnear) = Self::behind(part, &contact, way.origin, way.direction, t);
        if origin != way.origin {
            way.behind = distance;
        }
        (way.origin, way.tnear) = (origin, tnear);
        true
    }

    /// What the water stops over so many metres: the mean over red, green and blue.
    fn deep_water_alpha(&self, distance: f32) -> f32 {
        (1.0 - self.medium.transmittance(distance).element_sum() / 3.0).clamp(0.0, 1.0)
    }
}

/// What a way has met.
struct Found {
    part: u32,
    primitive: u32,
    t: f32,
    contact: Contact,
}

/// The flat picture's light by kind.
struct Light<'a> {
    beauty: [&'a [f32]; 3],
    spray: [&'a [f32]; 3],
    mist: [&'a [f32]; 3],
}

impl<'a> Light<'a> {
    fn of(flat: &'a Picture) -> Self {
        let layer =
            |names: [&str; 3]| names.map(|name| flat.channel(name).map_or(&[][..], |channel| &channel.samples[..]));
        Self {
            beauty: layer(["R", "G", "B"]),
            spray: layer(["spray.R", "spray.G", "spray.B"]),
            mist: layer(["mist.R", "mist.G", "mist.B"]),
        }
    }

    fn at(&self, index: usize) -> [[f32; 3]; KINDS] {
        let at = |layer: &[&[f32]; 3]| layer.map(|channel| channel.get(index).copied().unwrap_or(0.0));
        let (spray, mist, beauty) = (at(&self.spray), at(&self.mist), at(&self.beauty));
        let mut kinds = [[0.0; 3]; KINDS];
        kinds[Kind::Solid as usize] = std::array::from_fn(|axis| beauty[axis] - spray[axis] - mist[axis]);
        kinds[Kind::Spray as usize] = spray;
        kinds[Kind::Mist as usize] = mist;
        kinds
    }
}
