//! The seam of the accelerators: batches of rays in, nearest hits or occlusion out.
//!
//! A batch is a structure of arrays, sized for a tile. Accelerators stand behind one trait and are chosen by name at
//! run time; whichever is chosen, the picture is the same.

use crate::surface::SolveCounts;

/// No part was hit.
pub const NO_PART: u32 = u32::MAX;

/// Rays in the scene's local frame (metres around the scene origin), one array per component.
///
/// A direction need not be of unit length; `t` counts its lengths.
#[derive(Clone, Debug, Default)]
pub struct RayBatch {
    /// Origins: x, y, z.
    pub origin: [Vec<f32>; 3],
    /// Directions: x, y, z.
    pub direction: [Vec<f32>; 3],
    /// Least t that counts.
    pub tnear: Vec<f32>,
    /// Greatest t that counts, inclusive.
    pub tfar: Vec<f32>,
    /// Tolerance of a surface hit (in t) at the origin.
    pub tolerance: Vec<f32>,
    /// Growth of the tolerance per unit of t, for the whole batch.
    pub tolerance_growth: f32,
}

impl RayBatch {
    /// Count of rays.
    pub fn len(&self) -> usize {
        self.tnear.len()
    }
    /// True for no rays.
    pub fn is_empty(&self) -> bool {
        self.tnear.is_empty()
    }
    /// Forgets the rays, keeps the memory.
    pub fn clear(&mut self) {
        for axis in self.origin.iter_mut().chain(self.direction.iter_mut()) {
            axis.clear();
        }
        self.tnear.clear();
        self.tfar.clear();
        self.tolerance.clear();
    }
    /// Appends one ray.
    pub fn push(&mut self, origin: glam::Vec3, direction: glam::Vec3, tnear: f32, tfar: f32, tolerance: f32) {
        for axis in 0..3 {
            self.origin[axis].push(origin[axis]);
            self.direction[axis].push(direction[axis]);
        }
        self.tnear.push(tnear);
        self.tfar.push(tfar);
        self.tolerance.push(tolerance);
    }
    /// Origin of ray `index`.
    pub fn origin(&self, index: usize) -> glam::Vec3 {
        glam::Vec3::new(self.origin[0][index], self.origin[1][index], self.origin[2][index])
    }
    /// Direction of ray `index`.
    pub fn direction(&self, index: usize) -> glam::Vec3 {
        glam::Vec3::new(self.direction[0][index], self.direction[1][index], self.direction[2][index])
    }
}

/// Nearest hits of a batch, one array per field, in the order of the rays.
#[derive(Clone, Debug, Default)]
pub struct HitBatch {
    /// Distance in lengths of the direction; +inf for a miss.
    pub t: Vec<f32>,
    /// Index of the part ([`crate::lower::Lowered::parts`]), [`NO_PART`] for a miss.
    pub part: Vec<u32>,
    /// Primitive within the part: patch, sphere, disc, triangle, side.
    pub primitive: Vec<u32>,
    /// First surface coordinate: within the patch (0..1 along x), or barycentric.
    pub u: Vec<f32>,
    /// Second surface coordinate: within the patch (0..1 along z), or barycentric.
    pub v: Vec<f32>,
    /// Geometric normal, not normalised, as the accelerator gave it: x, y, z.
    pub normal: [Vec<f32>; 3],
    /// The solver could not decide: counted, and reported to whoever asked.
    pub gave_up: Vec<bool>,
}

impl HitBatch {
    /// Makes room for `count` rays, all missing.
    pub fn reset(&mut self, count: usize) {
        fn fill<T: Clone>(values: &mut Vec<T>, count: usize, value: T) {
            values.clear();
            values.resize(count, value);
        }
        fill(&mut self.t, count, f32::INFINITY);
        fill(&mut self.part, count, NO_PART);
        fill(&mut self.primitive, count, 0);
        fill(&mut self.u, count, 0.0);
        fill(&mut self.v, count, 0.0);
        for axis in &mut self.normal {
            fill(axis, count, 0.0);
        }
        fill(&mut self.gave_up, count, false);
    }
}

/// What an accelerator says of itself.
#[derive(Clone, Debug, Default, serde::Serialize)]
pub struct AccelStats {
    /// Name, as in the scene file.
    pub name: String,
    /// Seconds to build.
    pub build_seconds: f64,
    /// Bytes held, without the scene's own arrays.
    pub bytes: u64,
    /// Primitives by kind.
    pub primitives: Vec<(String, u64)>,
}

/// An acceleration structure over lowered parts, ready to be asked from any thread.
pub trait Accelerator: Send + Sync {
    /// Nearest hit of each ray. `hits` is reset first. Adds the solver's work to `counts`.
    fn closest(&self, rays: &RayBatch, hits: &mut HitBatch, counts: &mut SolveCounts);
    /// Whether each ray hits anything at all. `occluded` is resized to the batch.
    fn occluded(&self, rays: &RayBatch, occluded: &mut Vec<bool>, counts: &mut SolveCounts);
    /// Name, memory, build time.
    fn stats(&self) -> AccelStats;
}
