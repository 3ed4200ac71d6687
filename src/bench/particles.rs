//! Structures over spray against each other: spheres and discs in Embree, the handwritten trees, brute force.
//!
//! Ratios are to `bsp`. Answers are held against brute force up to 100,000 particles and against Embree beyond: a hit that
//! the other does not have, or at another place, by more than single precision's rounding.

use std::io::Write;
use std::sync::Arc;

use super::measure::{self, Rival, Turn};
use super::plume::{self, PlumeRays};
use super::rows::Row;
use super::sheet::{Sheet, number};
use super::tracer::{Answers, Tracer};
use super::{BenchError, Settings};
use crate::accel::embree::EmbreeAccel;
use crate::accel::{self, Accelerator, Geometry, NO_PART, RayBatch};
use crate::lower::{Discs, Lowered, Material, Part, Shape, Spheres};
use crate::scene::{Accel, ObjectsAccel};
use crate::simd::SimdLevel;
use crate::surface::SolveCounts;

/// Beyond this, brute force takes too long.
const MOST_FOR_BRUTE: usize = 100_000;

/// Runs the tables and prints them as they grow.
///
/// # Errors
/// Embree is missing, memory ran out, or a file of rows cannot be written.
pub fn run(settings: &Settings, out: &mut impl Write) -> Result<(), BenchError> {
    let mut sheet = Sheet::new(settings, out)?;
    let by_default: &[usize] =
        if settings.quick { &[2_800, 100_000] } else { &[2_800, 100_000, 1_000_000, 10_000_000] };
    let counts = if settings.particles.is_empty() { by_default } else { &settings.particles };
    for &count in counts {
        one_count(count, settings, &mut sheet)?;
    }
    sheet.say(
        "Answers are held against brute force up to 100,000 particles, beyond against Embree, whatever the shape.",
    )?;
    sheet.plot(settings, super::plot::particles)
}

/// One structure over one shape.
struct Held {
    shape: &'static str,
    rival: Rival,
}

/// Everyone, the baseline first.
fn rivals(spheres: &Arc<Spheres>, discs: &Arc<Discs>, simd: SimdLevel) -> Result<Vec<Held>, BenchError> {
    let count = spheres.center.len();
    // The baseline first; then as the scene's keys list them.
    let mut kinds = vec![ObjectsAccel::Bsp];
    kinds.extend(ObjectsAccel::ALL.into_iter().filter(|kind| *kind != ObjectsAccel::Bsp));
    let mut held = Vec::new();
    for (shape, name) in [(Shape::Spheres(spheres.clone()), "spheres"), (Shape::Discs(discs.clone()), "discs")] {
        for &kind in kinds.iter().filter(|kind| **kind != ObjectsAccel::Brute || count <= MOST_FOR_BRUTE) {
            let part = Part { name: "spray".to_owned(), material: Material::Spray { first: 0 }, shape: shape.clone() };
            let lowered = Lowered { parts: vec![part], ..Lowered::default() };
            let accel = accel::build(&lowered, &Accel { objects: kind, ..Accel::default() }, simd)?;
            let stats = accel.stats();
            let brute = kind == ObjectsAccel::Brute;
            let most_rays = if brute { (20_000_000 / count.max(1)).clamp(64, 4096) } else { usize::MAX };
            held.push(Held { shape: name, rival: rival(kind.name(), Tracer::Seam(accel), &stats, most_rays) });
        }
    }
    // Embree's own spheres and discs, which the clusters behind `embree` are to beat.
    for (shape, geometry) in
        [("spheres", Geometry::Spheres(spheres.clone())), ("discs", Geometry::Discs(discs.clone()))]
    {
        let points = Arc::new(EmbreeAccel::with_points(&[(0, geometry)])?);
        let stats = points.stats();
        held.push(Held { shape, rival: rival("embree-points", Tracer::Packets(points.clone()), &stats, usize::MAX) });
        held.push(Held { shape, rival: rival("embree-points", Tracer::Singles(points), &stats, usize::MAX) });
    }
    Ok(held)
}

fn rival(name: &str, tracer: Tracer, stats: &accel::AccelStats, most_rays: usize) -> Rival {
    Rival {
        name: name.to_owned(),
        solver: String::new(),
        simd: String::new(),
        order: 0,
        tracer,
        build_ms: stats.build_seconds * 1e3,
        bytes: stats.bytes as f64,
        most_rays,
    }
}

fn one_count(count: usize, settings: &Settings, sheet: &mut Sheet) -> Result<(), BenchError> {
    let spheres = Arc::new(plume::spheres(count));
    let discs = Arc::new(plume::discs(&spheres));
    let held = rivals(&spheres, &discs, settings.simd)?;
    let referee = |shape: &str| {
        let name = if count <= MOST_FOR_BRUTE { ObjectsAccel::Brute.name() } else { ObjectsAccel::Embree.name() };
        held.iter().position(|held| held.rival.name == name && held.shape == shape && held.rival.tracer.batch())
    };
    let all: Vec<&Rival> = held.iter().map(|held| &held.rival).collect();
    sheet.say(&format!("\n{count} particles; ratios to bsp over spheres"))?;
    for class in PlumeRays::ALL {
        let any = class == PlumeRays::Occlusion;
        let rays = plume::rays(class, &spheres, settings.share());
        let batches = Arc::new(measure::split(&rays));
        let turns: Vec<Turn> = all.iter().map(|rival| Turn::new(rival, &batches, settings.threads)).collect();
        let speeds = measure::in_turns(&turns, any, settings);
        // Brute force in double precision takes about 10 ns a test.
        let tests = if settings.quick { 20_000_000 } else { 200_000_000 };
        let most = if count <= MOST_FOR_BRUTE { tests / count.max(1) } else { usize::MAX };
        let sample = measure::sample(&rays, settings.checked().min(most));
        let truths =
            ["spheres", "discs"].map(|shape| (shape, referee(shape).map(|k| answers(&all[k].tracer, any, &sample))));
        sheet.table(&[class.name(), "Mray/s", "ratio", "lost", "false", "wrong", "bytes each", "build ms"])?;
        for (held, speed) in held.iter().zip(speeds) {
            let truth = truths.iter().find(|(shape, _)| *shape == held.shape).and_then(|(_, truth)| truth.as_ref());
            // Brute force would only agree with itself.
            let truth = truth.filter(|_| held.rival.name != ObjectsAccel::Brute.name());
            let [lost, false_hits, wrong] = truth.map_or([0; 3], |truth| {
                differences(&answers(&held.rival.tracer, any, &sample), truth, any, sample.len())
            });
            let bytes = held.rival.bytes / count.max(1) as f64;
            let row = Row {
                bench: "particles".to_owned(),
                columns: super::size_name(plume::MAP),
                accel: held.rival.name.clone(),
                shape: held.shape.to_owned(),
                batch: held.rival.tracer.batch(),
                rays: class.name().to_owned(),
                mrays_per_s: speed.mrays_per_s,
                ratio: speed.ratio,
                checked: sample.len() as u64,
                lost,
                false_hits,
                wrong,
                build_ms: held.rival.build_ms,
                particles: count,
                bytes_per_particle: bytes,
                threads: settings.threads,
                ..Row::default()
            };
            let single = if held.rival.tracer.batch() { "" } else { " x1" };
            let mut cells = vec![format!("{} {}{single}", held.rival.name, held.shape)];
            cells.extend([number(speed.mrays_per_s), number(speed.ratio)]);
            cells.extend([lost, false_hits, wrong].map(|count| count.to_string()));
            cells.extend([number(bytes), number(held.rival.build_ms)]);
            sheet.row(&cells, row)?;
        }
    }
    Ok(())
}

fn answers(tracer: &Tracer, any: bool, rays: &RayBatch) -> Answers {
    let mut answers = Answers::default();
    tracer.trace(any, rays, &mut answers, &mut SolveCounts::default());
    answers
}

/// Rays that lose a hit, invent one, or hit elsewhere, against another's answers.
fn differences(ours: &Answers, theirs: &Answers, any: bool, count: usize) -> [u64; 3] {
    let hit = |answers: &Answers, index: usize| {
        if any { answers.occluded[index] } else { answers.hits.part[index] != NO_PART }
    };
    let mut differ = [0; 3];
    for index in 0..count {
        match (hit(ours, index), hit(theirs, index)) {
            (false, true) => differ[0] += 1,
            (true, false) => differ[1] += 1,
            // Positions are up to 500 columns and rounded to 24 bits: 3e-5; a graze loses a few digits more.
            (true, true) if !any && (ours.hits.t[index] - theirs.hits.t[index]).abs() > 1e-2 => differ[2] += 1,
            _ => {}
        }
    }
    differ
}
