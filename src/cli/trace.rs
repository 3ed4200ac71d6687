//! `whitewater trace`: the answers to single rays of a file, polished in double precision (docs/formats.md, section 2).
//!
//! Each ray is looked up by the scene's accelerator and solver in single precision around the scene origin, from near
//! the scene's box on; what is hit is then moved onto it in double precision, against the ray as given. Reading,
//! writing and polishing are in the folder beside.
//!
//! *Where rays begin:* `t = 0` counts. A ray that begins on a spline surface to the last bit of double precision hits it
//! at 0, whichever way it goes; one that begins beside it is judged in double precision, however near that is.
//! Billboards face each ray (those that would face an eye have none here and are traced as spheres), streaks have
//! their own width; a tessellation by screen error takes its fixed count.

mod answers;
mod exact;
mod rays;

use std::ops::Range;

use glam::DVec3;
use rayon::prelude::*;

use self::answers::Answer;
use self::exact::{Exact, LocalRay};
use self::rays::Rays;
use super::args::TraceArgs;
use super::errors::{CliError, Outcome};
use super::load;
use crate::accel::{self, Accelerator, HitBatch, NO_PART, RayBatch};
use crate::lower::{self, LoweredFrame, Shape};
use crate::scene;
use crate::surface::{LaneSurface, SolveCounts};

/// Rays that one thread takes at a time.
const CHUNK: usize = 4096;
/// How often a ray is sent on that finds only what lies behind its beginning, by single precision's rounding.
const PASSES: usize = 4;
/// What a frame may have by docs/formats.md, whether this one has it or not.
const ALWAYS_KNOWN: [&str; 5] = ["water", "water_sides", "terrain", "spray", "streaks"];

/// Runs the command.
///
/// # Errors
/// The scene, its files or the rays are wrong; `--only` names what is not there; the answers cannot be written.
pub fn run(arguments: &TraceArgs) -> Result<Outcome, CliError> {
    let simd = arguments.simd.level()?;
    let mut loaded = scene::load(&arguments.scene.scene, &arguments.overrides())?;
    // The walls of the ground are for pictures: questions are answered by what the format names.
    loaded.scene.terrain.sides = false;
    let rays = rays::read(&arguments.rays).map_err(anyhow::Error::from)?;
    let settings = &loaded.scene;
    let frames = load::frames(&loaded)?;
    let state = load::frame(&loaded, &frames, arguments.frame.unwrap_or(frames.first()))?;
    let environment = load::environment(&loaded, &frames)?;
    let mut lowered = lower::lower(settings, &state, &environment, None, simd).map_err(anyhow::Error::from)?;
    let exact = Exact::parts(&lowered, &environment, &state.columns, &settings.surface);
    let exact = choose(arguments.only.as_deref(), &mut lowered, exact)?;

    let threads = arguments.threads.or(std::thread::available_parallelism().ok()).map_or(1, std::num::NonZero::get);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().map_err(anyhow::Error::from)?;
    let answers = pool.install(|| -> Result<Vec<Answer>, CliError> {
        let accelerator = accel::build(&lowered.lowered, &settings.accel, simd).map_err(anyhow::Error::from)?;
        let narrow = state.columns.width[0].min(state.columns.width[1]);
        let tracer = Tracer {
            rays: &rays,
            origin: lowered.lowered.origin,
            // Polishing squares a distance this small.
            tolerance: settings.surface.tolerance.unwrap_or(1e-6 * narrow),
            bounds: bounds(&lowered),
            accelerator: &*accelerator,
            exact: &exact,
        };
        let count = rays.origin.len();
        let chunks: Vec<Vec<Answer>> = (0..count.div_ceil(CHUNK))
            .into_par_iter()
            .map(|chunk| tracer.answer(chunk * CHUNK..count.min((chunk + 1) * CHUNK)))
            .collect();
        Ok(chunks.concat())
    })?;
    let names: Vec<String> = lowered.lowered.parts.iter().map(|part| part.name.clone()).collect();
    answers::write(&arguments.output, &answers, &names).map_err(anyhow::Error::from)?;
    Ok(Outcome::Done)
}

/// Leaves the parts that `--only` names.
fn choose<'a>(
    only: Option<&[String]>,
    lowered: &mut LoweredFrame,
    exact: Vec<Exact<'a>>,
) -> Result<Vec<Exact<'a>>, CliError> {
    let Some(only) = only else { return Ok(exact) };
    let parts = std::mem::take(&mut lowered.lowered.parts);
    let there: Vec<&str> = parts.iter().map(|part| part.name.as_str()).collect();
    let known = |name: &&String| there.contains(&name.as_str()) || ALWAYS_KNOWN.contains(&name.as_str());
    if let Some(unknown) = only.iter().find(|name| !known(name)) {
        return Err(anyhow::anyhow!("--only: there is no `{unknown}`; expected some of {}", there.join(", ")).into());
    }
    let (parts, exact) = parts.into_iter().zip(exact).filter(|(part, _)| only.contains(&part.name)).unzip();
    lowered.lowered.parts = parts;
    Ok(exact)
}

/// A box around all parts, in the local frame (m); `None` without parts.
fn bounds(lowered: &LoweredFrame) -> Option<[DVec3; 2]> {
    let mut all: Option<[DVec3; 2]> = None;
    let mut add = |low: DVec3, high: DVec3| {
        all = Some(all.map_or([low, high], |[least, most]| [least.min(low), most.max(high)]));
    };
    for part in &lowered.lowered.parts {
        match &part.shape {
            Shape::Surface(surface) => {
                let [low, high] = surface.bounds();
                add(low.as_dvec3(), high.as_dvec3());
            }
            Shape::Displaced(surface) => {
                let [low, high] = surface.bounds();
                add(low.as_dvec3(), high.as_dvec3());
            }
            Shape::Sides(sides) => {
                let [low, high] = sides.bounds();
                add(low.as_dvec3(), high.as_dvec3());
            }
            Shape::Spheres(spheres) => {
                for (center, &radius) in spheres.center.iter().zip(&spheres.radius) {
                    let (center, radius) = (center.as_dvec3(), DVec3::splat(radius.into()));
                    add(center - radius, center + radius);
                }
            }
            Shape::Discs(discs) => {
                for (center, &radius) in discs.center.iter().zip(&discs.radius) {
                    let (center, radius) = (center.as_dvec3(), DVec3::splat(radius.into()));
                    add(center - radius, center + radius);
                }
            }
            Shape::Curves(curves) => {
                let ends = curves.ends.iter().flatten().zip(curves.radius.iter().flatten());
                for (center, &radius) in ends {
                    let (center, radius) = (center.as_dvec3(), DVec3::splat(radius.into()));
                    add(center - radius, center + radius);
                }
            }
            Shape::Triangles(mesh) => {
                for position in &mesh.position {
                    add(position.as_dvec3(), position.as_dvec3());
                }
            }
        }
    }
    // Room for the rounding of single precision on all sides, also of what has no thickness.
    all.map(|[low, high]| {
        let room = DVec3::splat(1e-3 * (high - low).length() + 1e-6 * low.abs().max(high.abs()).max_element());
        [low - room, high + room]
    })
}

/// A ray on its way through the accelerator.
struct Query {
    index: usize,
    ray: LocalRay,
    /// From where it is traced, in t of the local ray.
    start: f64,
    /// From where hits count.
    begin: f64,
    /// Where it leaves the box.
    end: f64,
}

/// Everything that answering reads.
struct Tracer<'a> {
    rays: &'a Rays,
    origin: DVec3,
    /// Of the solver (m along the ray).
    tolerance: f64,
    bounds: Option<[DVec3; 2]>,
    accelerator: &'a dyn Accelerator,
    exact: &'a [Exact<'a>],
}

impl Tracer<'_> {
    /// The answers to some rays, in their order.
    fn answer(&self, chunk: Range<usize>) -> Vec<Answer> {
        let first = chunk.start;
        let mut answers = vec![Answer::MISS; chunk.len()];
        let mut queries: Vec<Query> = chunk.filter_map(|index| self.ask(index, &mut answers[index - first])).collect();
        let (mut batch, mut hits) = (RayBatch::default(), HitBatch::default());
        for _ in 0..PASSES {
            if queries.is_empty() {
                break;
            }
            batch.clear();
            for query in &queries {
                self.push(query, &mut batch);
            }
            self.accelerator.closest(&batch, &mut hits, &mut SolveCounts::default());
            let mut again = Vec::new();
            for (lane, query) in queries.into_iter().enumerate() {
                let answer = &mut answers[query.index - first];
                answer.gave_up |= hits.gave_up[lane];
                if hits.part[lane] == NO_PART {
                    continue;
                }
                let found = query.start + f64::from(hits.t[lane]);
                let normal = DVec3::from_array([0, 1, 2].map(|axis| f64::from(hits.normal[axis][lane])));
                let part = hits.part[lane] as usize;
                let polished = self.exact[part].polish(&query.ray, query.begin, found, hits.primitive[lane], normal);
                if polished.t < 0.0 {
                    // Rounding alone put it before the ray's beginning: look behind it.
                    let step = (found - polished.t).max(f64::from(f32::EPSILON) * self.extent());
                    let start = found + 2.0 * step;
                    again.push(Query { start, begin: start, ..query });
                } else {
                    self.keep(answer, query.index, &query.ray, part, polished);
                }
            }
            queries = again;
        }
        answers
    }

    /// Greatest distance across the box (m).
    fn extent(&self) -> f64 {
        self.bounds.map_or(0.0, |[low, high]| (high - low).length())
    }

    /// Greatest t of a ray as given.
    fn tmax(&self, index: usize) -> f64 {
        self.rays.tmax.as_ref().map_or(f64::INFINITY, |tmax| tmax[index])
    }

    /// What to ask the accelerator about a ray; nothing for one that misses the box, or is answered where it begins.
    fn ask(&self, index: usize, answer: &mut Answer) -> Option<Query> {
        let [low, high] = self.bounds?;
        let ray = LocalRay::new(self.rays.origin[index], self.rays.direction[index], self.origin);
        let (mut near, mut far) = (0.0f64, f64::INFINITY);
        for axis in 0..3 {
            let (o, d) = (ray.origin[axis], ray.direction[axis]);
            if d == 0.0 {
                if !(low[axis]..=high[axis]).contains(&o) {
                    return None;
                }
                continue;
            }
            let (a, b) = ((low[axis] - o) / d, (high[axis] - o) / d);
            near = near.max(a.min(b));
            far = far.min(a.max(b));
        }
        // Written so that what is no number, from origins beyond all scenes, misses too. The box has room to spare, so
        // that nothing in it lies at a tmax before it.
        if !(near <= far && near <= ray.to_local(self.tmax(index))) {
            return None;
        }
        // A ray from nearby keeps its beginning, which single precision often holds exactly.
        let moved = near * ray.direction.length() > 4.0 * self.extent();
        let mut start = if moved { near } else { 0.0 };
        let mut first: Option<(usize, exact::Polished)> = None;
        for (part, exact) in self.exact.iter().enumerate() {
            let beside = match exact {
                Exact::Spline(spline) => spline.near_start(&ray),
                Exact::Displaced(surface) => exact::near_displaced(surface, &ray),
                _ => None,
            };
            if let Some(beside) = beside {
                start = start.max(beside.clear);
                if let Some(hit) = beside.hit.filter(|hit| first.is_none_or(|(_, other)| hit.t < other.t)) {
                    first = Some((part, hit));
                }
            }
        }
        if let Some((part, hit)) = first {
            self.keep(answer, index, &ray, part, hit);
            return None;
        }
        Some(Query { index, ray, start, begin: 0.0, end: far })
    }

    /// Rounds a query to single precision.
    fn push(&self, query: &Query, batch: &mut RayBatch) {
        let ray = &query.ray;
        let origin = (ray.origin + ray.direction * query.start).as_vec3();
        let speed = ray.direction.length();
        // Not to tmax: whether a hit lies within it is for double precision to say, and where the solver ends its last
        // stretch would show in the hit's last bits.
        let tfar = ((query.end - query.start).max(0.0) + self.extent() / 1024.0) as f32;
        batch.push(origin, ray.direction.as_vec3(), 0.0, tfar, (self.tolerance / speed) as f32);
    }

    /// Takes a polished hit as the answer, unless it lies beyond the ray's end.
    fn keep(&self, answer: &mut Answer, index: usize, ray: &LocalRay, part: usize, hit: exact::Polished) {
        let t = ray.to_given(hit.t.abs());
        if t <= self.tmax(index) {
            answer.t = t;
            answer.normal = hit.normal.normalize_or_zero().as_vec3().to_array();
            answer.object = part as i32;
        }
    }
}
