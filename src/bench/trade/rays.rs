//! Dials of a ray against the water: x is the time of a ray, y the error of its t against the referee, in columns.
//!
//! The error is over rays whose crossing is the referee's; those that lose it, or land on another wave, are counted apart.

use std::sync::Arc;

use crate::accel::Accelerator;
use crate::accel::RayBatch;
use crate::accel::embree::EmbreeAccel;
use crate::bench::measure::{self, Rival, Turn};
use crate::bench::rows::Row;
use crate::bench::sheet::{Sheet, number};
use crate::bench::tracer::Tracer;
use crate::bench::work::{self, RayClass};
use crate::bench::{BenchError, Settings, rivals, size_name};
use crate::scene::SolverKind;
use crate::surface::{Lattice, SplineSurface};

/// What is asked for along a ray, in columns.
const TOLERANCES: [f32; 7] = [1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7];
/// Samples of a column along each side.
const SAMPLES: [u32; 5] = [1, 2, 4, 8, 16];
/// What the other dials ask for: single precision's end, at these sizes.
const FINE: f32 = 1e-6;

/// One place of one dial.
struct Point {
    dial: String,
    setting: String,
    value: f64,
    tolerance: f32,
    rival: Rival,
}

/// Lattices by order, from 2.
type Lattices = [Lattice; 3];

/// A dial: all its points.
type Dial = fn(&Lattices, &Settings) -> Result<Vec<Point>, BenchError>;

/// Every dial. The first point of the first is what ratios are to.
const DIALS: &[Dial] = &[tolerances, orders, precision, triangles, grids, subdivisions];

fn order(lattices: &Lattices, order: usize) -> &Lattice {
    &lattices[order - 2]
}

fn stream(lattice: &Lattice, solver: SolverKind, settings: &Settings) -> Rival {
    let (surface, ms) = rivals::spline(lattice, solver, settings.simd);
    rivals::of_spline("stream", &surface, settings, Tracer::stream(&surface), ms)
}

/// Every solver, from a coarse preview to the last bit.
fn tolerances(lattices: &Lattices, settings: &Settings) -> Result<Vec<Point>, BenchError> {
    let point = |solver: SolverKind, tolerance: f32| Point {
        dial: format!("tolerance, {}", solver.name()),
        setting: format!("{tolerance:e}"),
        value: tolerance.into(),
        tolerance,
        rival: stream(order(lattices, 3), solver, settings),
    };
    Ok(SolverKind::ALL.into_iter().flat_map(|solver| TOLERANCES.map(|tolerance| point(solver, tolerance))).collect())
}

/// Orders 2 to 4, each against its own surface: what smoothness costs.
fn orders(lattices: &Lattices, settings: &Settings) -> Result<Vec<Point>, BenchError> {
    let point = |lattice: &Lattice| Point {
        dial: "order".to_owned(),
        setting: lattice.order.to_string(),
        value: lattice.order as f64,
        tolerance: FINE,
        rival: stream(lattice, SolverKind::default(), settings),
    };
    Ok(lattices.iter().map(point).collect())
}

/// Single precision in lanes against double precision, a ray at a time.
fn precision(lattices: &Lattices, settings: &Settings) -> Result<Vec<Point>, BenchError> {
    let point = |setting: &str, value, solver| Point {
        dial: "precision".to_owned(),
        setting: setting.to_owned(),
        value,
        tolerance: 1e-7,
        rival: stream(order(lattices, 3), solver, settings),
    };
    Ok(vec![point("single", 32.0, SolverKind::default()), point("double", 64.0, SolverKind::Reference)])
}

/// Another way to hold the surface in Embree, by samples a column.
fn held(
    name: &str,
    lattice: &Lattice,
    settings: &Settings,
    build: impl Fn(&SplineSurface, u32) -> Result<Arc<EmbreeAccel>, BenchError>,
) -> Result<Vec<Point>, BenchError> {
    let (surface, _) = rivals::spline(lattice, SolverKind::default(), settings.simd);
    SAMPLES
        .into_iter()
        .map(|samples| {
            let accel = build(&surface, samples)?;
            let stats = accel.stats();
            let rival = Rival {
                name: name.to_owned(),
                solver: String::new(),
                simd: String::new(),
                order: lattice.order as u32,
                tracer: Tracer::Packets(accel),
                build_ms: stats.build_seconds * 1e3,
                bytes: stats.bytes as f64,
                most_rays: usize::MAX,
            };
            let setting = format!("{samples}x{samples}");
            Ok(Point { dial: name.to_owned(), setting, value: samples.into(), tolerance: FINE, rival })
        })
        .collect()
}

fn triangles(lattices: &Lattices, settings: &Settings) -> Result<Vec<Point>, BenchError> {
    held("triangles", order(lattices, 3), settings, |surface, n| Ok(rivals::triangles(surface, n)?.0))
}

fn grids(lattices: &Lattices, settings: &Settings) -> Result<Vec<Point>, BenchError> {
    held("grid", order(lattices, 3), settings, |surface, n| Ok(Arc::new(EmbreeAccel::grid(surface, n)?)))
}

/// Catmull-Clark's limit is the spline of order 4: that is what it is held against.
fn subdivisions(lattices: &Lattices, settings: &Settings) -> Result<Vec<Point>, BenchError> {
    held("subdivision", order(lattices, 4), settings, |surface, n| Ok(Arc::new(EmbreeAccel::subdivision(surface, n)?)))
}

pub(super) fn run(size: [usize; 2], settings: &Settings, sheet: &mut Sheet) -> Result<(), BenchError> {
    let lattices: Lattices = [work::surface(size, 2)?, work::surface(size, 3)?, work::surface(size, 4)?];
    let mut points = Vec::new();
    for dial in DIALS {
        points.extend(dial(&lattices, settings)?);
    }
    let (plain, _) = rivals::spline(&lattices[1], SolverKind::default(), settings.simd);
    let rays = work::rays(RayClass::Incoherent, &plain, settings.share());
    let within = |tolerance: f32| {
        let mut rays = rays.clone();
        rays.tolerance.fill(tolerance);
        rays
    };
    let mut by_tolerance: Vec<(f32, Arc<Vec<RayBatch>>)> = Vec::new();
    let turns: Vec<Turn> = points
        .iter()
        .map(|point| {
            let known = by_tolerance.iter().position(|(tolerance, _)| *tolerance == point.tolerance);
            let known = known.unwrap_or_else(|| {
                by_tolerance.push((point.tolerance, Arc::new(measure::split(&within(point.tolerance)))));
                by_tolerance.len() - 1
            });
            Turn::new(&point.rival, &by_tolerance[known].1, settings.threads)
        })
        .collect();
    let speeds = measure::in_turns(&turns, false, settings);
    drop(turns);

    let name = size_name(size);
    sheet.say(&format!(
        "\n{name} columns, incoherent rays: error of t in columns. (Subdivision reaches half a column past the domain's edge, and is held \
         against order 4: its false hits lie there.)"
    ))?;
    sheet.table(&[
        "dial",
        "setting",
        "ns a ray",
        "rms",
        "max",
        "lost",
        "false",
        "wrong",
        "tangent",
        "bytes per column",
    ])?;
    for (point, speed) in points.iter().zip(speeds) {
        let rival = &point.rival;
        let lattice = order(&lattices, rival.order as usize);
        let sample = measure::sample(&within(point.tolerance), settings.checked());
        let checked = measure::check(&[(rival, lattice)], false, &sample)[0];
        let audit = checked.audit;
        let row = Row {
            bench: "trade".to_owned(),
            columns: name.clone(),
            rays: RayClass::Incoherent.name().to_owned(),
            mrays_per_s: speed.mrays_per_s,
            ratio: speed.ratio,
            dial: point.dial.clone(),
            setting: point.setting.clone(),
            value: point.value,
            seconds: 1e-6 / speed.mrays_per_s,
            bytes_per_column: rival.bytes / (size[0] * size[1]) as f64,
            threads: settings.threads,
            ..measure::row(rival, &checked)
        };
        let mut cells = vec![point.dial.clone(), point.setting.clone(), number(1e9 * row.seconds)];
        cells.extend([number(row.error_rms), number(row.error_max)]);
        cells.extend([audit.lost, audit.false_hits, audit.wrong, audit.tangent].map(|count| count.to_string()));
        cells.push(number(row.bytes_per_column));
        sheet.row(&cells, row)?;
    }
    Ok(())
}
