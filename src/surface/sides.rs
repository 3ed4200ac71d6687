//! The body of water's walls at the domain's edge: between bed and surface, exact, never tessellated.

use std::sync::Arc;

use glam::Vec3;

use super::{LaneHits, LaneRays, LaneSurface, SolveCounts, SplineSurface};

/// The four walls; primitive 0 west, 1 east, 2 north, 3 south.
#[derive(Debug)]
pub struct Sides {
    /// The water's surface.
    pub water: Arc<SplineSurface>,
    /// The bed.
    pub bed: Arc<SplineSurface>,
}

impl LaneSurface for Sides {
    fn bounds(&self) -> [Vec3; 2] {
        [Vec3::ZERO; 2]
    }
    fn closest(&self, _rays: &LaneRays, _hits: &mut LaneHits, _counts: &mut SolveCounts) {}
    fn occluded(&self, _rays: &LaneRays, _counts: &mut SolveCounts) -> u16 {
        0
    }
    fn bytes(&self) -> u64 {
        0
    }
}
