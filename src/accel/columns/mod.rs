//! Splines as the report traced them (sections 2.3.1 and 2.3.2): its walk over the columns and its own Newton solver,
//! with the rays that these lose and misplace.
//!
//! An opponent, kept as it was: `walk` looks for guesses row by row, `newton` follows them. A share of the rays is traced
//! again by the double-precision referee, so that a picture comes with the count of what is wrong in it. The side walls
//! of the water answer for themselves; everything else of the water's axis goes to the objects' accelerator.

mod newton;
#[cfg(test)]
mod tests;
mod walk;

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

pub use walk::ColumnWalk;

use super::brute::Brute;
use super::{AccelError, AccelStats, Accelerator, Geometry, HitBatch, RayBatch};
use crate::lower::{Part, Shape};
use crate::scene::SolverKind;
use crate::surface::audit::Audit;
use crate::surface::{LaneSurface, SolveCounts};

/// Surfaces with their parts' indices, walked column by column; walls as they are.
pub(super) struct Columns {
    every: Brute,
    audit: Arc<Mutex<Audit>>,
    build_seconds: f64,
    bytes: u64,
}

/// Whether the walk can stand for a surface that names this solver.
///
/// It has a solver of its own, the report's. The default (nothing else was asked for) and `report` both mean that one;
/// any other name asks for something that the walk does not do.
fn takes(solver: SolverKind) -> bool {
    solver == SolverKind::default() || solver == SolverKind::Report
}

impl Columns {
    /// Takes the parts that [`serves`] names.
    ///
    /// # Errors
    /// A surface names a solver that is neither the default nor the report's.
    pub(super) fn new<'a>(parts: impl Iterator<Item = (u32, &'a Part)>) -> Result<Self, AccelError> {
        let start = Instant::now();
        let audit = Arc::<Mutex<Audit>>::default();
        let mut every = Vec::new();
        let mut bytes = 0;
        for (index, part) in parts {
            let geometry = match &part.shape {
                Shape::Surface(surface) if takes(surface.solver()) => {
                    let walk = ColumnWalk::new(Arc::clone(surface)).audited(Arc::clone(&audit));
                    bytes += walk.bytes();
                    Geometry::Lanes(Arc::new(walk))
                }
                Shape::Surface(surface) => {
                    return Err(AccelError::Solver { part: index, solver: surface.solver().name() });
                }
                shape => shape.into(),
            };
            every.push((index, geometry));
        }
        Ok(Self { every: Brute::new(every), audit, build_seconds: start.elapsed().as_secs_f64(), bytes })
    }
}

/// Whether the walk serves a part: a spline, or the walls, which need no structure.
pub(super) fn serves(part: &Part) -> bool {
    matches!(part.shape, Shape::Surface(_) | Shape::Sides(_))
}

impl Accelerator for Columns {
    fn closest(&self, rays: &RayBatch, hits: &mut HitBatch, counts: &mut SolveCounts) {
        self.every.closest(rays, hits, counts);
    }

    fn occluded(&self, rays: &RayBatch, occluded: &mut Vec<bool>, counts: &mut SolveCounts) {
        self.every.occluded(rays, occluded, counts);
    }

    fn stats(&self) -> AccelStats {
        AccelStats {
            name: "columns".to_owned(),
            build_seconds: self.build_seconds,
            bytes: self.bytes,
            ..self.every.stats()
        }
    }

    fn audit(&self) -> Option<Audit> {
        // Counts are whole numbers: those of a thread that died are as good as any.
        Some(*self.audit.lock().unwrap_or_else(PoisonError::into_inner))
    }
}
