//! Inner loops by themselves, the same work for two instruments: time (criterion) and counted instructions (callgrind).

use std::hint::black_box;
use std::sync::Arc;

use super::plume::{self, PlumeRays};
use super::rivals;
use super::tracer::{Answers, Tracer};
use super::work::{self, Random, RayClass};
use super::{BenchError, measure};
use crate::accel::bsp::{Bsp, Plan};
use crate::accel::{Geometry, RayBatch};
use crate::scene::{ObjectsAccel, SolverKind};
use crate::simd::SimdLevel;
use crate::surface::kernels::{Stretches, polynomials};
use crate::surface::{Lattice, SolveCounts, SplineSurface};

/// Columns along each side of the water.
const SIDE: usize = 64;
/// Rays of one run.
const RAYS: usize = 4096;
/// Particles.
const PARTICLES: usize = 10_000;

/// One inner loop and how much it does in a run.
pub struct Kernel {
    /// `walk/order-3`: a group and a case.
    pub name: String,
    /// What one of its units is.
    pub unit: &'static str,
    /// Units in a run.
    pub units: usize,
    work: Box<dyn FnMut()>,
}

impl Kernel {
    fn new(name: impl Into<String>, unit: &'static str, units: usize, work: impl FnMut() + 'static) -> Self {
        Self { name: name.into(), unit, units, work: Box::new(work) }
    }
}

/// Runs a kernel once. A function that is never inlined, so that callgrind can collect in it alone.
#[inline(never)]
pub fn counted(kernel: &mut Kernel) {
    (kernel.work)();
}

/// Every kernel with an instruction set.
///
/// # Errors
/// The work cannot be made.
pub fn all(simd: SimdLevel) -> Result<Vec<Kernel>, BenchError> {
    let mut kernels = Vec::new();
    for order in 2..=4u32 {
        let lattice = work::surface([SIDE; 2], order)?;
        let stretches = stretches(&lattice);
        kernels.push(Kernel::new(format!("polynomials/order-{order}"), "ray", RAYS, move || {
            black_box(polynomials(&lattice, &stretches, simd));
        }));
    }
    let lattice = work::surface([SIDE; 2], 3)?;
    kernels.push(Kernel::new("pyramid/build", "column", SIDE * SIDE, move || {
        black_box(SplineSurface::new(lattice.clone(), SolverKind::default(), simd));
    }));
    for order in 3..=4u32 {
        let (surface, _) = rivals::spline(&work::surface([SIDE; 2], order)?, SolverKind::default(), simd);
        let incoherent = measure::sample(&work::rays(RayClass::Incoherent, &surface, RAYS as f64 / 1e6), RAYS);
        let ways = [
            ("walk", Tracer::Walk(surface.clone()), false),
            ("stream", Tracer::stream(&surface), false),
            ("stream-any", Tracer::stream(&surface), true),
            ("single", Tracer::One(surface), false),
        ];
        for (name, tracer, any) in ways {
            kernels.push(tracing(format!("{name}/order-{order}"), tracer, any, incoherent.clone()));
        }
    }
    let spheres = Arc::new(plume::spheres(PARTICLES));
    let rays = plume::rays(PlumeRays::Incoherent, &spheres, RAYS as f64 / 1e6);
    for kind in [ObjectsAccel::Bsp, ObjectsAccel::BspSah] {
        let plant =
            |spheres: &Arc<_>| Bsp::new(vec![(0, Geometry::Spheres(Arc::clone(spheres)))], Plan::new(kind, None, None));
        let tree = plant(&spheres)?;
        let name = kind.name();
        let spheres = spheres.clone();
        kernels.push(Kernel::new(format!("{name}/build"), "particle", PARTICLES, move || {
            black_box(Bsp::new(vec![(0, Geometry::Spheres(spheres.clone()))], Plan::new(kind, None, None)).is_ok());
        }));
        kernels.push(tracing(format!("{name}/closest"), Tracer::Seam(Box::new(tree)), false, rays.clone()));
    }
    Ok(kernels)
}

fn tracing(name: String, tracer: Tracer, any: bool, rays: RayBatch) -> Kernel {
    let (mut answers, mut counts) = (Answers::default(), SolveCounts::default());
    Kernel::new(name, "ray", rays.len(), move || {
        tracer.trace(any, &rays, &mut answers, &mut counts);
        black_box(&answers);
    })
}

/// Rays across cells, from side to side.
fn stretches(lattice: &Lattice) -> Stretches {
    let mut random = Random::new(51);
    let mut stretches = Stretches::default();
    for _ in 0..RAYS {
        stretches.cell.push([0, 1].map(|axis| (random.unit() * lattice.cells[axis] as f64) as usize));
        stretches.start.push([0.0, random.unit() as f32, random.within(-5.0, 5.0) as f32]);
        stretches.end.push([1.0, random.unit() as f32, random.within(-5.0, 5.0) as f32]);
    }
    stretches
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_kernel_has_its_own_name_and_runs() {
        let mut names = std::collections::HashSet::new();
        for mut kernel in all(SimdLevel::Portable).unwrap() {
            counted(&mut kernel);
            assert!(kernel.units > 1000, "{}", kernel.name);
            assert!(names.insert(kernel.name));
        }
        assert!(names.contains("walk/order-3") && names.contains("bsp/build") && names.contains("pyramid/build"));
    }
}
