//! Ways to trace the water against each other: rays per second as ratios to one baseline, errors against the referee.
//!
//! The baseline is the obvious alternative: the same surface as 8x8 quadrilaterals per column in Embree triangles, one
//! ray a call. Rivals take turns round by round; each figure is the median over the rounds, each ratio the median of the
//! rounds' own ratios, so that a machine whose speed drifts does not bend them.

use std::hint::black_box;
use std::io::Write;
use std::sync::Arc;
use std::time::Instant;

use super::rows::{Row, Rows};
use super::work::{self, RayClass};
use super::{BenchError, Settings, median};
use crate::accel::embree::EmbreeAccel;
use crate::accel::{Accelerator, Geometry, HitBatch, NO_PART, RayBatch};
use crate::lower::Triangles;
use crate::scene::SolverKind;
use crate::simd::SimdLevel;
use crate::surface::audit::Audit;
use crate::surface::{
    LANES, LaneHits, LaneRays, LaneSurface, SingleAnswer, SingleRay, SolveCounts, SplineSurface, tessellate,
};

/// Rays in one call of a batch: a tile's worth.
const BATCH: usize = 4096;

/// Something that answers rays.
struct Rival {
    name: &'static str,
    solver: &'static str,
    simd: &'static str,
    batch: bool,
    tracer: Tracer,
    build_ms: f64,
    bytes: f64,
}

enum Tracer {
    Embree(EmbreeAccel),
    /// The surface alone, without Embree around it.
    Alone(Arc<SplineSurface>),
    /// The same, its lanes refilled.
    Stream(Arc<SplineSurface>),
    /// The same, a ray at a time.
    One(Arc<SplineSurface>),
}

/// Answers of a class: t, or 0 / inf for any-hit.
fn trace(
    rival: &Rival,
    any: bool,
    batches: &[RayBatch],
    hits: &mut HitBatch,
    occluded: &mut Vec<bool>,
    mut each: impl FnMut(&HitBatch, &[bool]),
) -> SolveCounts {
    let mut counts = SolveCounts::default();
    for rays in batches {
        match (&rival.tracer, any, rival.batch) {
            (Tracer::Embree(embree), false, true) => embree.closest(rays, hits, &mut counts),
            (Tracer::Embree(embree), false, false) => embree.closest_single(rays, hits, &mut counts),
            (Tracer::Embree(embree), true, true) => embree.occluded(rays, occluded, &mut counts),
            (Tracer::Embree(embree), true, false) => embree.occluded_single(rays, occluded, &mut counts),
            (Tracer::Stream(surface), ..) => stream(surface, any, rays, hits, occluded, &mut counts),
            (Tracer::One(surface), ..) => one_by_one(surface, any, rays, hits, occluded, &mut counts),
            (Tracer::Alone(surface), ..) => alone(surface, any, rays, hits, occluded, &mut counts),
        }
        each(hits, occluded);
    }
    counts
}

/// A surface asked directly, packet by packet.
pub fn alone(
    surface: &SplineSurface,
    any: bool,
    rays: &RayBatch,
    hits: &mut HitBatch,
    occluded: &mut Vec<bool>,
    counts: &mut SolveCounts,
) {
    hits.reset(rays.len());
    occluded.clear();
    occluded.resize(rays.len(), false);
    for start in (0..rays.len()).step_by(LANES) {
        let count = LANES.min(rays.len() - start);
        let mut packet = LaneRays { tolerance_growth: rays.tolerance_growth, ..LaneRays::EMPTY };
        for axis in 0..3 {
            packet.origin[axis][..count].copy_from_slice(&rays.origin[axis][start..start + count]);
            packet.direction[axis][..count].copy_from_slice(&rays.direction[axis][start..start + count]);
        }
        packet.tnear[..count].copy_from_slice(&rays.tnear[start..start + count]);
        packet.tfar[..count].copy_from_slice(&rays.tfar[start..start + count]);
        packet.tolerance[..count].copy_from_slice(&rays.tolerance[start..start + count]);
        packet.active = (u32::MAX >> (32 - count)) as u16;
        if any {
            let answer = surface.occluded(&packet, counts);
            for lane in 0..count {
                occluded[start + lane] = answer >> lane & 1 == 1;
            }
        } else {
            let mut found = LaneHits::EMPTY;
            surface.closest(&packet, &mut found, counts);
            for lane in (0..count).filter(|lane| found.hit >> lane & 1 == 1) {
                hits.t[start + lane] = found.t[lane];
                hits.part[start + lane] = 0;
            }
        }
    }
}

pub fn stream(
    surface: &SplineSurface,
    any: bool,
    rays: &RayBatch,
    hits: &mut HitBatch,
    occluded: &mut Vec<bool>,
    counts: &mut SolveCounts,
) {
    const BLOCK: usize = 32;
    let mut packets = [LaneRays::EMPTY; BLOCK];
    let mut found = [LaneHits::EMPTY; BLOCK];
    if any {
        occluded.clear();
        occluded.resize(rays.len(), false);
    } else {
        hits.reset(rays.len());
    }
    for block in (0..rays.len()).step_by(BLOCK * LANES) {
        let total = (rays.len() - block).min(BLOCK * LANES);
        let used = total.div_ceil(LANES);
        for (packet, start) in packets[..used].iter_mut().zip((block..).step_by(LANES)) {
            let count = LANES.min(rays.len() - start);
            for axis in 0..3 {
                packet.origin[axis][..count].copy_from_slice(&rays.origin[axis][start..start + count]);
                packet.direction[axis][..count].copy_from_slice(&rays.direction[axis][start..start + count]);
            }
            packet.tnear[..count].copy_from_slice(&rays.tnear[start..start + count]);
            packet.tfar[..count].copy_from_slice(&rays.tfar[start..start + count]);
            packet.tolerance[..count].copy_from_slice(&rays.tolerance[start..start + count]);
            packet.tolerance_growth = rays.tolerance_growth;
            packet.active = (u32::MAX >> (32 - count)) as u16;
        }
        if any {
            surface.occluded_stream(&packets[..used], &mut found[..used], counts);
            for index in 0..total {
                occluded[block + index] = found[index / LANES].hit >> (index % LANES) & 1 == 1;
            }
        } else {
            surface.closest_stream(&packets[..used], &mut found[..used], counts);
            for index in 0..total {
                let (hits_of, lane) = (&found[index / LANES], index % LANES);
                if hits_of.hit >> lane & 1 == 1 {
                    hits.t[block + index] = hits_of.t[lane];
                    hits.part[block + index] = 0;
                }
            }
        }
    }
}

pub fn one_by_one(
    surface: &SplineSurface,
    any: bool,
    rays: &RayBatch,
    hits: &mut HitBatch,
    occluded: &mut Vec<bool>,
    counts: &mut SolveCounts,
) {
    hits.reset(rays.len());
    occluded.clear();
    occluded.resize(rays.len(), false);
    for index in 0..rays.len() {
        let ray = SingleRay {
            origin: rays.origin(index).to_array(),
            direction: rays.direction(index).to_array(),
            range: [rays.tnear[index], rays.tfar[index]],
            tolerance: rays.tolerance[index],
            tolerance_growth: rays.tolerance_growth,
        };
        if let SingleAnswer::Hit(hit) = surface.single(&ray, any, counts) {
            occluded[index] = any;
            hits.t[index] = hit.t;
            hits.part[index] = 0;
        }
    }
}

fn embree(geometry: Geometry) -> Result<(EmbreeAccel, f64, f64), BenchError> {
    let start = Instant::now();
    let embree = EmbreeAccel::new(&[(0, geometry)])?;
    let milliseconds = start.elapsed().as_secs_f64() * 1e3;
    let bytes = embree.stats().bytes as f64;
    Ok((embree, milliseconds, bytes))
}

/// The baseline first, then ours.
fn rivals(lattice: &crate::surface::Lattice, simd: SimdLevel) -> Result<Vec<Rival>, BenchError> {
    let spline = |solver, level| {
        let lattice = lattice.clone();
        let start = Instant::now();
        let surface = Arc::new(SplineSurface::new(lattice, solver, level));
        (surface, start.elapsed().as_secs_f64() * 1e3)
    };
    let (plain, _) = spline(SolverKind::Univariate, simd);
    let start = Instant::now();
    let mesh = tessellate::uniform(&plain, 8)?;
    let triangles = Triangles { position: mesh.position, normal: Vec::new(), index: mesh.index };
    let tessellation_ms = start.elapsed().as_secs_f64() * 1e3;
    let (baseline, commit_ms, bytes) = embree(Geometry::Triangles(Arc::new(triangles)))?;
    let mut rivals = vec![Rival {
        name: "triangles",
        solver: "",
        simd: "",
        batch: false,
        tracer: Tracer::Embree(baseline),
        build_ms: tessellation_ms + commit_ms,
        bytes,
    }];
    let cases = [(SolverKind::Univariate, true), (SolverKind::Univariate, false), (SolverKind::Newton, true)];
    for (solver, batch) in cases {
        let (surface, bounds_ms) = spline(solver, simd);
        let (accel, commit_ms, bytes) = embree(Geometry::Lanes(surface))?;
        rivals.push(Rival {
            name: "embree",
            solver: solver.name(),
            simd: if solver == SolverKind::Univariate { simd.name() } else { "" },
            batch,
            tracer: Tracer::Embree(accel),
            build_ms: bounds_ms + commit_ms,
            bytes,
        });
    }
    let (surface, bounds_ms) = spline(SolverKind::Univariate, simd);
    let bytes = surface.bytes() as f64;
    rivals.push(Rival {
        name: "stream",
        solver: "univariate",
        simd: simd.name(),
        batch: true,
        tracer: Tracer::Stream(surface),
        build_ms: bounds_ms,
        bytes,
    });
    let (surface, bounds_ms) = spline(SolverKind::Univariate, simd);
    let bytes = surface.bytes() as f64;
    rivals.push(Rival {
        name: "stream",
        solver: "univariate",
        simd: simd.name(),
        batch: false,
        tracer: Tracer::One(surface),
        build_ms: bounds_ms,
        bytes,
    });
    let (surface, bounds_ms) = spline(SolverKind::Univariate, simd);
    let bytes = surface.bytes() as f64;
    rivals.push(Rival {
        name: "walk",
        solver: "univariate",
        simd: simd.name(),
        batch: true,
        tracer: Tracer::Alone(surface),
        build_ms: bounds_ms,
        bytes,
    });
    Ok(rivals)
}

/// Runs the table and prints it as it grows.
///
/// # Errors
/// Embree is missing, memory ran out, or a file of rows cannot be written.
pub fn run(settings: &Settings, out: &mut impl Write) -> Result<(), BenchError> {
    let mut rows = Rows::new(settings.csv.as_deref(), settings.json.as_deref())?;
    writeln!(
        out,
        "{}; {} thread(s); ratios to 8x8 Embree triangles per column, one ray a call",
        rows.machine(),
        settings.threads
    )?;
    for &size in &settings.sizes {
        let lattice = work::surface(size, 3)?;
        let rivals = rivals(&lattice, settings.simd)?;
        let Tracer::Alone(surface) = &rivals[rivals.len() - 1].tracer else {
            return Err(BenchError::Internal("the last rival is the surface alone".to_owned()));
        };
        let columns = (size[0] * size[1]) as f64;
        writeln!(out, "\n{}x{} columns, order 3", size[0], size[1])?;
        writeln!(
            out,
            "{:<38}{:>11}{:>9}{:>9}{:>7}{:>7}{:>7}{:>8}{:>9}",
            "", "rays", "Mray/s", "ratio", "lost", "false", "wrong", "tangent", "gave up"
        )?;
        for class in RayClass::ALL {
            let share = if settings.quick { 0.1 } else { 1.0 };
            let rays = work::rays(class, surface, share);
            let batches = split(&rays);
            let (rates, ratios) = measure(&rivals, class, &batches, rays.len(), settings);
            for (index, rival) in rivals.iter().enumerate() {
                let (audit, counts) = audit(rival, class, &batches, &lattice, settings);
                let row = Row {
                    bench: "surface".to_owned(),
                    columns: format!("{}x{}", size[0], size[1]),
                    order: 3,
                    accel: rival.name.to_owned(),
                    solver: rival.solver.to_owned(),
                    simd: rival.simd.to_owned(),
                    batch: rival.batch,
                    rays: class.name().to_owned(),
                    mrays_per_s: rates[index],
                    ratio: ratios[index],
                    checked: audit.rays,
                    lost: audit.lost,
                    false_hits: audit.false_hits,
                    wrong: audit.wrong,
                    tangent: audit.tangent,
                    gave_up: counts.gave_up,
                    bytes_per_column: rival.bytes / columns,
                    build_ms: rival.build_ms,
                    threads: settings.threads,
                    ..Row::default()
                };
                let what = format!("{} {} {}", row.accel, row.solver, if row.batch { "x16" } else { "x1" });
                writeln!(
                    out,
                    "{:<38}{:>11}{:>9.2}{:>9.2}{:>7}{:>7}{:>7}{:>8}{:>9}",
                    what,
                    row.rays,
                    row.mrays_per_s,
                    row.ratio,
                    row.lost,
                    row.false_hits,
                    row.wrong,
                    row.tangent,
                    row.gave_up
                )?;
                out.flush()?;
                rows.push(row)?;
            }
        }
        writeln!(out)?;
        for rival in &rivals {
            writeln!(
                out,
                "{:<38}{:>10.2} bytes per column above the heights, built in {:.1} ms",
                format!("{} {} {}", rival.name, rival.solver, if rival.batch { "x16" } else { "x1" }),
                rival.bytes / columns,
                rival.build_ms
            )?;
        }
    }
    writeln!(
        out,
        "\nErrors are per {} checked rays of each class; tangent: see the audit's definition.",
        checked(settings)
    )?;
    Ok(())
}

fn checked(settings: &Settings) -> usize {
    if settings.quick { 10_000 } else { 100_000 }
}

fn split(rays: &RayBatch) -> Vec<RayBatch> {
    (0..rays.len())
        .step_by(BATCH)
        .map(|start| {
            let mut batch = RayBatch { tolerance_growth: rays.tolerance_growth, ..RayBatch::default() };
            for index in start..rays.len().min(start + BATCH) {
                batch.push(
                    rays.origin(index),
                    rays.direction(index),
                    rays.tnear[index],
                    rays.tfar[index],
                    rays.tolerance[index],
                );
            }
            batch
        })
        .collect()
}

/// Median rates (Mray/s) and ratios to the first rival.
fn measure(
    rivals: &[Rival],
    class: RayClass,
    batches: &[RayBatch],
    count: usize,
    settings: &Settings,
) -> (Vec<f64>, Vec<f64>) {
    let rounds = if settings.quick { 3 } else { 7 };
    let mut rates = vec![Vec::new(); rivals.len()];
    let mut ratios = vec![Vec::new(); rivals.len()];
    for round in 0..=rounds {
        let mut baseline = 1.0;
        for (index, rival) in rivals.iter().enumerate() {
            let seconds = timed(rival, class, batches, settings.threads);
            let rate = count as f64 / seconds / 1e6;
            if index == 0 {
                baseline = rate;
            }
            // The first round warms caches and clocks.
            if round > 0 {
                rates[index].push(rate);
                ratios[index].push(rate / baseline);
            }
        }
    }
    let medians = |values: Vec<Vec<f64>>| values.into_iter().map(|mut v| median(&mut v)).collect();
    (medians(rates), medians(ratios))
}

fn timed(rival: &Rival, class: RayClass, batches: &[RayBatch], threads: usize) -> f64 {
    let start = Instant::now();
    std::thread::scope(|scope| {
        for thread in 0..threads {
            let share = &batches[batches.len() * thread / threads..batches.len() * (thread + 1) / threads];
            scope.spawn(move || {
                let (mut hits, mut occluded) = (HitBatch::default(), Vec::new());
                black_box(trace(rival, class.any_hit(), share, &mut hits, &mut occluded, |_, _| {}));
            });
        }
    });
    start.elapsed().as_secs_f64()
}

/// Errors over an even sample of the rays.
fn audit(
    rival: &Rival,
    class: RayClass,
    batches: &[RayBatch],
    lattice: &crate::surface::Lattice,
    settings: &Settings,
) -> (Audit, SolveCounts) {
    use rayon::prelude::*;
    let total: usize = batches.iter().map(RayBatch::len).sum();
    let stride = (total / checked(settings)).max(1);
    let results: Vec<(Audit, SolveCounts)> = batches
        .par_iter()
        .map(|rays| {
            let (mut hits, mut occluded, mut audit) = (HitBatch::default(), Vec::new(), Audit::default());
            let counts = trace(
                rival,
                class.any_hit(),
                std::slice::from_ref(rays),
                &mut hits,
                &mut occluded,
                |hits, occluded| {
                    for index in (0..rays.len()).step_by(stride) {
                        let (origin, direction) = (rays.origin(index).as_dvec3(), rays.direction(index).as_dvec3());
                        let range = [f64::from(rays.tnear[index]), f64::from(rays.tfar[index])];
                        if class.any_hit() {
                            audit.check_any(lattice, origin, direction, range, occluded[index]);
                        } else {
                            let answer = (hits.part[index] != NO_PART).then(|| f64::from(hits.t[index]));
                            audit.check(lattice, origin, direction, range, answer);
                        }
                    }
                },
            );
            (audit, counts)
        })
        .collect();
    results.into_iter().fold(Default::default(), |(mut audit, mut counts), (a, c)| {
        audit += a;
        counts += c;
        (audit, counts)
    })
}
