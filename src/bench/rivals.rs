//! Who is held against whom over the water: the list that a new accelerator or solver adds one line to.

use std::sync::Arc;
use std::time::Instant;

use super::measure::Rival;
use super::tracer::Tracer;
use super::{BenchError, Settings};
use crate::accel::embree::EmbreeAccel;
use crate::accel::{self, Accelerator, Geometry};
use crate::lower::{Lowered, Material, Part, Shape, Triangles};
use crate::scene::{Accel, SolverKind, WaterAccel};
use crate::simd::SimdLevel;
use crate::surface::{LaneSurface, Lattice, SplineSurface, tessellate};

/// Rays that are timed at most, for a count of columns; 0 leaves it out.
type MostRays = fn(usize) -> usize;

/// Accelerators of the water that are asked as the renderer asks them, with the rays that they are timed over at most
/// for a count of columns (0: left out). Embree and the splines' own walk are asked in more ways, below.
const THROUGH_THE_SEAM: &[(WaterAccel, MostRays)] = &[
    (WaterAccel::Columns, |_| usize::MAX),
    // Every patch for every ray: as many rays as make four million patches; beyond that, none would be answered in time.
    (WaterAccel::Brute, |columns| if columns > 200_000 { 0 } else { (4_000_000 / columns).clamp(16, 4096) }),
];

/// Rays that solvers which work one ray at a time are timed over.
fn few(settings: &Settings) -> usize {
    if settings.quick { 2_000 } else { 20_000 }
}

/// Whether a solver has kernels of its own for 16 rays.
pub(super) fn is_wide(solver: SolverKind) -> bool {
    solver == SolverKind::Univariate
}

/// A surface and how long its bounds took (ms).
pub(super) fn spline(lattice: &Lattice, solver: SolverKind, simd: SimdLevel) -> (Arc<SplineSurface>, f64) {
    let lattice = lattice.clone();
    let start = Instant::now();
    let surface = Arc::new(SplineSurface::new(lattice, solver, simd));
    (surface, start.elapsed().as_secs_f64() * 1e3)
}

/// The surface as triangles, `samples` x `samples` quadrilaterals a column, and how long both took (ms).
///
/// # Errors
/// The mesh or the structure cannot be made.
pub(super) fn triangles(surface: &SplineSurface, samples: u32) -> Result<(Arc<EmbreeAccel>, f64), BenchError> {
    let start = Instant::now();
    let mesh = tessellate::uniform(surface, samples)?;
    let triangles = Triangles { position: mesh.position, normal: Vec::new(), index: mesh.index };
    let accel = EmbreeAccel::new(&[(0, Geometry::Triangles(Arc::new(triangles)))])?;
    Ok((Arc::new(accel), start.elapsed().as_secs_f64() * 1e3))
}

/// An accelerator of the seam over one surface.
///
/// # Errors
/// It cannot be built.
pub(super) fn seam(surface: Arc<SplineSurface>, water: WaterAccel) -> Result<Box<dyn Accelerator>, BenchError> {
    let part = Part { name: "water".to_owned(), material: Material::Water, shape: Shape::Surface(surface) };
    let lowered = Lowered { parts: vec![part], ..Lowered::default() };
    Ok(accel::build(&lowered, &Accel { water, ..Accel::default() }, SimdLevel::detect())?)
}

/// A rival that is a spline's: with its solver, its instruction set and its order.
pub(super) fn of_spline(
    name: &str,
    surface: &SplineSurface,
    settings: &Settings,
    tracer: Tracer,
    build_ms: f64,
) -> Rival {
    let solver = surface.solver();
    Rival {
        name: name.to_owned(),
        solver: solver.name().to_owned(),
        simd: if is_wide(solver) { settings.simd.name().to_owned() } else { String::new() },
        order: surface.lattice().order as u32,
        tracer,
        build_ms,
        bytes: surface.bytes() as f64,
        most_rays: if is_wide(solver) { usize::MAX } else { few(settings) },
    }
}

/// Triangles in Embree: one ray a call, which is the baseline; sixteen; and sixteen said to lie side by side.
///
/// # Errors
/// The mesh or the structure cannot be made.
pub(super) fn baselines(surface: &SplineSurface) -> Result<Vec<Rival>, BenchError> {
    let columns = surface.lattice().cells.iter().product::<usize>();
    // Beyond this, 128 triangles a column do not fit in memory: about 90 bytes each.
    let (name, samples) = if columns <= 200_000 { ("triangles", 8) } else { ("triangles-1x1", 1) };
    let (accel, build_ms) = triangles(surface, samples)?;
    let bytes = accel.stats().bytes as f64;
    let rival = |name: String, tracer| Rival {
        name,
        solver: String::new(),
        simd: String::new(),
        order: surface.lattice().order as u32,
        tracer,
        build_ms,
        bytes,
        most_rays: usize::MAX,
    };
    let coherent = Arc::new(accel.coherent());
    Ok(vec![
        rival(name.to_owned(), Tracer::Singles(accel.clone())),
        rival(name.to_owned(), Tracer::Packets(accel)),
        rival(format!("{name}-coherent"), Tracer::Packets(coherent)),
    ])
}

/// Our own over one lattice: the default solver in every way; with `all`, every other solver and accelerator too.
///
/// # Errors
/// A structure cannot be made.
pub(super) fn ours(lattice: &Lattice, settings: &Settings, all: bool) -> Result<Vec<Rival>, BenchError> {
    let mut rivals = Vec::new();
    let default = SolverKind::default();
    let others = SolverKind::ALL.into_iter().filter(|solver| all && *solver != default);
    for solver in std::iter::once(default).chain(others) {
        let (surface, bounds_ms) = spline(lattice, solver, settings.simd);
        let embree = Arc::new(EmbreeAccel::new(&[(0, Geometry::Lanes(surface.clone()))])?);
        let stats = embree.stats();
        let mut add = |name: &str, tracer, ms| rivals.push(of_spline(name, &surface, settings, tracer, ms));
        let embree_ms = bounds_ms + stats.build_seconds * 1e3;
        add("embree", Tracer::Packets(embree.clone()), embree_ms);
        add("stream", Tracer::stream(&surface), bounds_ms);
        if solver == default {
            add("embree", Tracer::Singles(embree), embree_ms);
            add("stream", Tracer::One(surface.clone()), bounds_ms);
            add("walk", Tracer::Walk(surface.clone()), bounds_ms);
        }
        for rival in rivals.iter_mut().filter(|rival| rival.name == "embree") {
            rival.bytes = stats.bytes as f64;
        }
    }
    if all {
        let (surface, bounds_ms) = spline(lattice, default, settings.simd);
        let columns = lattice.cells.iter().product();
        for &(water, most) in THROUGH_THE_SEAM.iter().filter(|(_, most)| most(columns) > 0) {
            let accel = seam(surface.clone(), water)?;
            let stats = accel.stats();
            let ms = bounds_ms + stats.build_seconds * 1e3;
            let mut rival = of_spline(&stats.name, &surface, settings, Tracer::Seam(accel), ms);
            rival.bytes = stats.bytes as f64;
            rival.most_rays = most(columns);
            // These ask solvers of their own: the referee's, and the report's.
            match water {
                WaterAccel::Brute => (rival.solver, rival.simd) = (String::new(), String::new()),
                WaterAccel::Columns => (rival.solver, rival.simd) = ("report".to_owned(), String::new()),
                WaterAccel::Embree | WaterAccel::Stream => {}
            }
            rivals.push(rival);
        }
    }
    Ok(rivals)
}
