//! Handwritten binary space partitions over spheres, discs, curves and triangles, traced one ray at a time without Embree.
//!
//! Three ways to plant one tree: the report's (section 3.2.1), the same with right answers, and one that places its planes
//! by the surface-area heuristic. `build` plants, `walk` asks, `leaf` tests what lies in a leaf, `check` proves a tree
//! well formed, `primitive` knows the boxes. Intersections are single precision (a
//! curve's double) and follow Embree's conventions.

mod build;
mod check;
mod leaf;
pub(super) mod primitive;
#[cfg(test)]
mod tests;
mod walk;

use std::time::Instant;

use self::leaf::Leaves;
use self::primitive::{Aabb, Objects};
use self::walk::Stack;
use super::{AccelError, AccelStats, Accelerator, Geometry, HitBatch, NO_PART, RayBatch, brute, count_primitives};
pub use check::Flaw;

use crate::scene::ObjectsAccel;
use crate::surface::SolveCounts;

/// Planes on the way to a leaf that a walk's stack has room for.
const MOST_DEPTH: u32 = 60;
/// References to primitives that a tree may hold, as a multiple of the primitives: bounds memory where many overlap.
const MOST_REFERENCES: u64 = 8;

/// How a tree is planted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Rule {
    /// In the middle of the longest side; each primitive on the side of its centre alone.
    Report,
    /// In the middle of the longest side; straddlers on both sides.
    Middle,
    /// Where the surface-area heuristic is least; straddlers on both sides, cut to each.
    Heuristic,
}

/// What a tree is built by: its kind, its greatest depth and the size of its leaves.
#[derive(Clone, Copy, Debug)]
pub struct Plan {
    rule: Rule,
    depth: Option<u32>,
    leaf: u32,
}

impl Plan {
    /// The plan of an accelerator: `bsp`, `bsp-report`, or by the heuristic for any other.
    ///
    /// `depth` planes at most lie over a leaf; by default 20, where a million equal leaves hold the report's scenes many
    /// times over, and 8 + 1.3 log2 n by the heuristic, whose leaves differ in depth (Havran, Heuristic Ray Shooting
    /// Algorithms, 2000; the constants are Pharr, Jakob and Humphreys's). A box with at most `leaf` primitives is not
    /// split; by default 8, and 4 by the heuristic, one block, which it would not split anyway.
    pub fn new(kind: ObjectsAccel, depth: Option<u32>, leaf: Option<u32>) -> Self {
        let (rule, depth, least) = match kind {
            ObjectsAccel::BspReport => (Rule::Report, depth.or(Some(20)), 8),
            ObjectsAccel::Bsp => (Rule::Middle, depth.or(Some(20)), 8),
            _ => (Rule::Heuristic, depth, 4),
        };
        Self { rule, depth, leaf: leaf.unwrap_or(least).max(1) }
    }

    /// The depth for a count of primitives.
    fn depth(&self, count: u32) -> u32 {
        self.depth.unwrap_or_else(|| (8.0 + 1.3 * f64::from(count.max(1)).log2()) as u32).min(MOST_DEPTH)
    }

    fn name(&self) -> &'static str {
        match self.rule {
            Rule::Report => ObjectsAccel::BspReport.name(),
            Rule::Middle => ObjectsAccel::Bsp.name(),
            Rule::Heuristic => ObjectsAccel::BspSah.name(),
        }
    }
}

/// A node in eight bytes.
///
/// `word`'s two lowest bits are the plane's axis, or 3 for a leaf. A plane: `value` is the bits of its place, the rest of
/// `word` the first of its two children, which lie side by side (below, above). A leaf: two bits of what it holds
/// ([`leaf::Kind`]), then a count of blocks from `value` on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Node {
    value: u32,
    word: u32,
}

impl Node {
    const LEAF: u32 = 3;
    const EMPTY: Self = Self { value: 0, word: Self::LEAF };

    fn plane(axis: usize, place: f32, children: u32) -> Self {
        Self { value: place.to_bits(), word: children << 2 | axis as u32 }
    }
    fn leaf(kind: leaf::Kind, start: u32, count: u32) -> Self {
        Self { value: start, word: count << 4 | (kind as u32) << 2 | Self::LEAF }
    }
    #[inline]
    fn tag(self) -> u32 {
        self.word & 3
    }
    #[inline]
    fn is_leaf(self) -> bool {
        self.tag() == Self::LEAF
    }
    #[inline]
    fn place(self) -> f32 {
        f32::from_bits(self.value)
    }
    #[inline]
    fn children(self) -> u32 {
        self.word >> 2
    }
    #[inline]
    fn kind(self) -> u32 {
        self.word >> 2 & 3
    }
    #[inline]
    fn count(self) -> u32 {
        self.word >> 4
    }
}

/// A tree over spheres, discs, curves and triangles.
pub struct Bsp {
    objects: Objects,
    plan: Plan,
    /// Planes over the deepest leaf, at most.
    depth: u32,
    bounds: Aabb,
    /// The root first.
    nodes: Vec<Node>,
    leaves: Leaves,
    straddlers: u64,
    build_seconds: f64,
}

impl std::fmt::Debug for Bsp {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter
            .debug_struct("Bsp")
            .field("plan", &self.plan)
            .field("nodes", &self.nodes.len())
            .finish_non_exhaustive()
    }
}

impl Bsp {
    /// Builds over geometry, each with the index that its hits carry as their part.
    ///
    /// Runs in the current rayon pool; the tree is the same at any number of threads. What no ray can hit (a radius that
    /// is not positive, a disc without a normal, a coordinate that is not finite) is left out.
    ///
    /// # Errors
    /// Arrays do not fit each other, there is a surface among them, or there are more than 2^27 primitives.
    pub fn new(geometry: Vec<(u32, Geometry)>, plan: Plan) -> Result<Self, AccelError> {
        let start = Instant::now();
        super::check(&geometry)?;
        let objects = Objects::new(geometry)?;
        let depth = plan.depth(objects.count());
        let tree = build::build(&objects, plan.rule, depth, plan.leaf);
        if tree.straddlers > 0 && plan.rule == Rule::Report {
            let (straddlers, count) = (tree.straddlers, objects.count());
            tracing::warn!("bsp-report: {straddlers} of {count} objects reach over a plane; rays may miss what does");
        }
        Ok(Self {
            plan,
            depth,
            bounds: tree.bounds,
            nodes: tree.nodes,
            leaves: tree.leaves,
            straddlers: tree.straddlers,
            build_seconds: start.elapsed().as_secs_f64(),
            objects,
        })
    }

    /// Primitives that reach out of a leaf which holds them: those that `bsp-report` may miss, those that the others hold
    /// more than once.
    pub fn straddlers(&self) -> u64 {
        self.straddlers
    }
}

impl Accelerator for Bsp {
    fn closest(&self, rays: &RayBatch, hits: &mut HitBatch, _counts: &mut SolveCounts) {
        hits.resize(rays.len());
        let mut stack = Stack::EMPTY;
        for index in 0..rays.len() {
            let hit = if brute::is_ray(rays, index) { self.first_hit(rays, index, &mut stack) } else { None };
            hits.gave_up[index] = false;
            let Some(hit) = hit else {
                hits.t[index] = f32::INFINITY;
                hits.part[index] = NO_PART;
                hits.primitive[index] = 0;
                (hits.u[index], hits.v[index]) = (0.0, 0.0);
                for axis in &mut hits.normal {
                    axis[index] = 0.0;
                }
                continue;
            };
            hits.t[index] = hit.t;
            (hits.part[index], hits.primitive[index]) = self.objects.name(hit.number);
            (hits.u[index], hits.v[index]) = (hit.u, hit.v);
            let normal = self.objects.get(hit.number).normal(rays.origin(index), rays.direction(index), hit.t);
            for axis in 0..3 {
                hits.normal[axis][index] = normal[axis];
            }
        }
    }

    fn occluded(&self, rays: &RayBatch, occluded: &mut Vec<bool>, _counts: &mut SolveCounts) {
        occluded.clear();
        let mut stack = Stack::EMPTY;
        let mut hit = |index| brute::is_ray(rays, index) && self.any_hit(rays, index, &mut stack);
        occluded.extend((0..rays.len()).map(&mut hit));
    }

    fn stats(&self) -> AccelStats {
        let mut primitives = count_primitives(self.objects.geometry());
        if self.plan.rule == Rule::Report {
            primitives.push(("straddlers".to_owned(), self.straddlers));
        }
        AccelStats {
            name: self.plan.name().to_owned(),
            build_seconds: self.build_seconds,
            bytes: (self.nodes.len() * size_of::<Node>()) as u64 + self.leaves.bytes(),
            primitives,
        }
    }
}
