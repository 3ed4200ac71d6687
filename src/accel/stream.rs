//! Splines without Embree: whole batches go through the surfaces' own walk, whose lanes are refilled as rays finish.
//!
//! It serves surfaces only; everything else of the water's axis goes to the objects' accelerator.

use std::sync::Arc;

use super::block::Block;
use super::{AccelError, AccelStats, Accelerator, Geometry, HitBatch, NO_PART, RayBatch};
use crate::surface::{LaneSurface, SolveCounts};

/// Surfaces with their parts' indices.
pub struct Stream {
    surfaces: Vec<(u32, Arc<dyn LaneSurface>)>,
}

impl Stream {
    /// Over one surface, as part 0.
    pub fn alone(surface: Arc<dyn LaneSurface>) -> Self {
        Self { surfaces: vec![(0, surface)] }
    }

    /// Takes the surfaces as they are: their bounds were built with them.
    ///
    /// # Errors
    /// Geometry that is not a surface.
    pub(super) fn new(geometry: &[(u32, Geometry)]) -> Result<Self, AccelError> {
        let surfaces = geometry.iter().map(|(part, geometry)| match geometry {
            Geometry::Lanes(surface) => Ok((*part, Arc::clone(surface))),
            _ => Err(AccelError::NoSurface { part: *part }),
        });
        Ok(Self { surfaces: surfaces.collect::<Result<_, _>>()? })
    }
}

impl Accelerator for Stream {
    fn closest(&self, rays: &RayBatch, hits: &mut HitBatch, counts: &mut SolveCounts) {
        hits.reset(rays.len());
        let mut block = Block::EMPTY;
        for start in Block::starts(rays.len()) {
            block.load(rays, start);
            for (part, surface) in &self.surfaces {
                block.closest(*part, surface.as_ref(), hits, counts);
            }
        }
        debug_assert!(hits.part.iter().zip(&hits.t).all(|(&part, &t)| (part == NO_PART) == (t == f32::INFINITY)));
    }

    fn occluded(&self, rays: &RayBatch, occluded: &mut Vec<bool>, counts: &mut SolveCounts) {
        occluded.clear();
        occluded.resize(rays.len(), false);
        let mut block = Block::EMPTY;
        for start in Block::starts(rays.len()) {
            block.load(rays, start);
            for (_, surface) in &self.surfaces {
                block.occluded(surface.as_ref(), occluded, counts);
            }
        }
    }

    fn stats(&self) -> AccelStats {
        AccelStats {
            name: "stream".to_owned(),
            build_seconds: 0.0,
            bytes: self.surfaces.iter().map(|(_, surface)| surface.bytes()).sum(),
            primitives: vec![("surfaces".to_owned(), self.surfaces.len() as u64)],
        }
    }
}
