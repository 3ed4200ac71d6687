//! Where precision ends: errors and lost rays against scale, offset, distance and steepness.
//!
//! The waves of the other benchmarks, with one thing at a time pushed to extremes. The referee gets each ray as it was
//! rounded to single precision, so what is measured is what a tracer adds to that rounding.

use std::io::Write;
use std::sync::Arc;

use glam::DVec3;

use super::measure::{self, Rival};
use super::rows::Row;
use super::sheet::{Sheet, number};
use super::tracer::Tracer;
use super::work::{self, Random};
use super::{BenchError, Settings, rivals, size_name};
use crate::accel::embree::EmbreeAccel;
use crate::accel::{Geometry, RayBatch};
use crate::scene::SolverKind;
use crate::surface::Lattice;

/// What is pushed, and how far.
#[derive(Clone, Copy, Debug)]
struct Axis {
    name: &'static str,
    unit: &'static str,
    values: &'static [f64],
}

const AXES: [Axis; 4] = [
    Axis { name: "scale", unit: "m a column", values: &[1e-3, 1e-2, 0.1, 1.0, 10.0, 100.0, 1e3] },
    Axis { name: "offset", unit: "columns", values: &[0.0, 10.0, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7] },
    Axis { name: "distance", unit: "columns", values: &[1.0, 10.0, 1e2, 1e3, 1e4, 1e5, 1e6] },
    Axis { name: "steepness", unit: "times the heights", values: &[0.01, 0.1, 1.0, 10.0, 100.0, 1e3] },
];

/// One place on one axis; the others are at rest.
#[derive(Clone, Copy, Debug)]
struct Place {
    scale: f64,
    offset: f64,
    distance: Option<f64>,
    steepness: f64,
}

impl Place {
    fn new(axis: &Axis, value: f64) -> Self {
        let mut place = Self { scale: 1.0, offset: 0.0, distance: None, steepness: 1.0 };
        match axis.name {
            "scale" => place.scale = value,
            "offset" => place.offset = value,
            "distance" => place.distance = Some(value),
            _ => place.steepness = value,
        }
        place
    }

    fn lattice(&self, size: [usize; 2], order: u32) -> Result<Lattice, BenchError> {
        let factor = self.scale * self.steepness;
        let heights: Vec<f64> = work::heights(size).into_iter().map(|height| height * factor).collect();
        let center = [(self.offset + 0.5) * self.scale; 2];
        Ok(Lattice::new(order, size, center, [self.scale; 2], &heights, |_| true)?)
    }

    /// Rays at uniform points of the surface: from up to 15 columns away in any direction, or from `distance` above.
    fn rays(&self, lattice: &Lattice, count: usize) -> RayBatch {
        let mut random = Random::new(31);
        let mut batch = RayBatch::default();
        for _ in 0..count {
            let cell = [0, 1].map(|axis| random.within(lattice.domain[0][axis], lattice.domain[1][axis]));
            let [i, j] = [0, 1].map(|axis| (cell[axis] as usize).min(lattice.cells[axis] - 1));
            let (y, _) = lattice.evaluate(i, j, cell[0] - i as f64, cell[1] - j as f64);
            let [x, z] = lattice.from_cell(cell);
            let mut towards = random.direction();
            let away = match self.distance {
                None => 0.2 + 15.0 * random.unit().powi(2),
                Some(distance) => {
                    // No lower than 30 degrees: from far away, a lower eye would look through all the waves between.
                    towards.y = -towards.y.abs().max(0.5);
                    towards = towards.normalize();
                    distance
                }
            };
            let origin = DVec3::new(x, y, z) - towards * (away * self.scale);
            let tolerance = (1e-6 * self.scale) as f32;
            batch.push(origin.as_vec3(), towards.as_vec3(), 0.0, f32::INFINITY, tolerance);
        }
        batch
    }
}

/// The default solver through Embree and by itself, every other by itself, and triangles.
fn contestants(lattice: &Lattice, settings: &Settings) -> Result<Vec<Rival>, BenchError> {
    let simd = settings.simd;
    let mut contestants = Vec::new();
    for solver in SolverKind::ALL {
        let (surface, ms) = rivals::spline(lattice, solver, simd);
        if solver == SolverKind::default() {
            let embree = EmbreeAccel::new(&[(0, Geometry::Lanes(surface.clone()))])?;
            contestants.push(rivals::of_spline("embree", &surface, settings, Tracer::Packets(Arc::new(embree)), ms));
        }
        contestants.push(rivals::of_spline("stream", &surface, settings, Tracer::stream(&surface), ms));
    }
    let (surface, _) = rivals::spline(lattice, SolverKind::default(), simd);
    contestants.extend(rivals::baselines(&surface)?.into_iter().skip(1).take(1));
    Ok(contestants)
}

/// Runs the tables and prints them as they grow.
///
/// # Errors
/// Embree is missing, memory ran out, or a file of rows cannot be written.
pub fn run(settings: &Settings, out: &mut impl Write) -> Result<(), BenchError> {
    let mut sheet = Sheet::new(settings, out)?;
    let count = settings.audit.or(settings.rays).unwrap_or(if settings.quick { 2_000 } else { 50_000 });
    for &size in &settings.sizes {
        for axis in &AXES {
            let head = format!("{} ({})", axis.name, axis.unit);
            sheet.say(&format!(
                "\n{}: {} columns, {count} rays; errors of t in columns",
                axis.name,
                size_name(size)
            ))?;
            sheet.table(&[&head, "value", "rms", "max", "lost", "false", "wrong", "tangent", "gave up"])?;
            for &value in axis.values {
                one_place(axis, value, size, count, settings, &mut sheet)?;
            }
        }
    }
    sheet.plot(settings, super::plot::extremes)
}

fn one_place(
    axis: &Axis,
    value: f64,
    size: [usize; 2],
    count: usize,
    settings: &Settings,
    sheet: &mut Sheet,
) -> Result<(), BenchError> {
    let place = Place::new(axis, value);
    let lattice = place.lattice(size, 3)?;
    let rays = place.rays(&lattice, count);
    let contestants = contestants(&lattice, settings)?;
    let pairs: Vec<(&Rival, &Lattice)> = contestants.iter().map(|rival| (rival, &lattice)).collect();
    for (rival, checked) in contestants.iter().zip(measure::check(&pairs, false, &rays)) {
        let audit = checked.audit;
        let row = Row {
            bench: "extremes".to_owned(),
            columns: size_name(size),
            rays: "incoherent".to_owned(),
            dial: axis.name.to_owned(),
            setting: format!("{} {}", number(value), axis.unit),
            value,
            bytes_per_column: rival.bytes / (size[0] * size[1]) as f64,
            threads: settings.threads,
            ..measure::row(rival, &checked)
        };
        let mut cells = vec![rival.title(), number(value), number(row.error_rms), number(row.error_max)];
        let counts = [audit.lost, audit.false_hits, audit.wrong, audit.tangent, checked.gave_up];
        cells.extend(counts.map(|count| count.to_string()));
        sheet.row(&cells, row)?;
    }
    Ok(())
}
