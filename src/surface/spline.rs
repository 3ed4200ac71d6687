//! The spline surface as a thing to evaluate and to intersect.

use glam::Vec3;

use super::{LaneHits, LaneRays, LaneSurface, SolveCounts, SurfacePoint};

/// A B-spline height function over a map of columns, with its bounds and its solver.
#[derive(Debug)]
pub struct SplineSurface {}

impl SplineSurface {
    /// Point and upward normal of patch `patch` at `u`, `v` (each 0..1).
    pub fn patch_point(&self, _patch: u32, _u: f32, _v: f32) -> SurfacePoint {
        SurfacePoint { position: Vec3::ZERO, normal: Vec3::Y }
    }
    /// Height at x, z of the local frame; `None` outside the domain or where no patch exists.
    pub fn height(&self, _x: f32, _z: f32) -> Option<f32> {
        None
    }
    /// Least and greatest x and z of the domain: `[x0, z0], [x1, z1]`.
    pub fn domain(&self) -> ([f32; 2], [f32; 2]) {
        ([0.0; 2], [0.0; 2])
    }
}

impl LaneSurface for SplineSurface {
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
