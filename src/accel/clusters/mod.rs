//! Spheres, discs and round curves in groups of up to sixteen neighbours, tested at once, under a tree whose nodes have sixteen children.
//!
//! A cloud of particles answers packets of rays as a surface does, so that it stands in Embree's scene as one primitive.
//! `build` groups the particles, `cluster` tests a group, `ray` prepares a packet, `walk` takes it through the tree: rays
//! that travel alike go together, others one after the other with sixteen boxes or particles in the lanes. A ray's answer
//! is the same bits either way (`walk` says why).

mod build;
mod cluster;
mod curve;
mod ray;
#[cfg(test)]
mod tests;
mod walk;

use std::sync::Arc;

use glam::Vec3;

use self::build::Record;
use self::cluster::{Cluster, DiscCluster, FacingCluster, SphereCluster};
use self::curve::CurveCluster;
use self::walk::{Found, Walk};
use super::bsp::primitive::{Aabb, Primitive};
use crate::lower::{Curves, Discs, Spheres};
use crate::simd::{SimdLevel, dispatch};
use crate::surface::{LANES, LaneHits, LaneRays, LaneSurface, SolveCounts};

/// Children of a node, particles of a cluster.
const WIDTH: usize = 16;

/// Sixteen children and their boxes: nothing is cut in half by a cache line.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
struct Node {
    /// Least and greatest x, y, z of each child; the least above the greatest where there is none.
    planes: [[[f32; WIDTH]; 2]; 3],
    /// A node's number, or with [`CLUSTER`] a cluster's.
    child: [u32; WIDTH],
}

/// Marks a child that is a cluster.
const CLUSTER: u32 = 1 << 31;

impl Node {
    const EMPTY: Self =
        Self { planes: [[[f32::INFINITY; WIDTH], [f32::NEG_INFINITY; WIDTH]]; 3], child: [CLUSTER; WIDTH] };
}

/// Groups spheres. What no ray can hit is left out; runs in the current rayon pool, with the same result at any size.
pub(super) fn of_spheres(spheres: &Spheres, simd: SimdLevel) -> Arc<dyn LaneSurface> {
    let bounds = |record: &Record| Primitive::Sphere { center: record.center, radius: record.radius }.bounds(0.0);
    let group = |records: &[Record]| {
        let mut cluster = SphereCluster::EMPTY;
        for (slot, record) in records.iter().enumerate() {
            cluster.put(slot, record);
        }
        cluster
    };
    Arc::new(Cloud::new(&spheres.center, &spheres.radius, &group, &bounds, simd))
}

/// Groups discs, as [`of_spheres`].
pub(super) fn of_discs(discs: &Discs, simd: SimdLevel) -> Arc<dyn LaneSurface> {
    let Some(normals) = &discs.normal else { return of_facing(discs, simd) };
    let bounds = |record: &Record| {
        let normal = normals[record.number as usize];
        Primitive::Disc { center: record.center, radius: record.radius, normal }.bounds(0.0)
    };
    let group = |records: &[Record]| {
        let mut cluster = DiscCluster::EMPTY;
        for (slot, record) in records.iter().enumerate() {
            cluster.put(slot, record, normals[record.number as usize]);
        }
        cluster
    };
    Arc::new(Cloud::new(&discs.center, &discs.radius, &group, &bounds, simd))
}

/// Groups discs that face each ray's origin: anywhere in their balls.
fn of_facing(discs: &Discs, simd: SimdLevel) -> Arc<dyn LaneSurface> {
    let bounds = |record: &Record| Primitive::Facing { center: record.center, radius: record.radius }.bounds(0.0);
    let group = |records: &[Record]| {
        let mut cluster = FacingCluster(SphereCluster::EMPTY);
        for (slot, record) in records.iter().enumerate() {
            cluster.0.put(slot, record);
        }
        cluster
    };
    Arc::new(Cloud::new(&discs.center, &discs.radius, &group, &bounds, simd))
}

/// Groups round curves, as [`of_spheres`].
pub(super) fn of_curves(curves: &Curves, simd: SimdLevel) -> Arc<dyn LaneSurface> {
    let bounds = |record: &Record| {
        let index = record.number as usize;
        Primitive::Curve { ends: curves.ends[index], radius: curves.radius[index] }.bounds(0.0)
    };
    let group = |records: &[Record]| {
        let mut cluster = CurveCluster::EMPTY;
        for (slot, record) in records.iter().enumerate() {
            cluster.put(slot, record, curves);
        }
        cluster
    };
    let (center, reach): (Vec<_>, Vec<_>) =
        (0..curves.ends.len()).map(|index| curve::ball_around(curves, index)).unzip();
    Arc::new(Cloud::new(&center, &reach, &group, &bounds, simd))
}

/// Particles of one kind and the tree over them.
#[derive(Debug)]
struct Cloud<C> {
    /// The root first.
    nodes: Vec<Node>,
    clusters: Vec<C>,
    bounds: Aabb,
    simd: SimdLevel,
}

impl<C: Cluster> Cloud<C> {
    fn new(
        center: &[Vec3],
        radius: &[f32],
        group: &(dyn Fn(&[Record]) -> C + Sync),
        bounds: &(dyn Fn(&Record) -> Option<Aabb> + Sync),
        simd: SimdLevel,
    ) -> Self {
        let record = |(number, (&center, &radius))| Record { center, radius, number };
        let particles = (0..).zip(center.iter().zip(radius)).map(record);
        let mut records: Vec<Record> = particles.filter(|record| bounds(record).is_some()).collect();
        let tree = build::build(&mut records, group, bounds);
        Self { nodes: tree.nodes, clusters: tree.clusters, bounds: tree.bounds, simd }
    }

    fn walk<const ANY: bool>(&self, rays: &LaneRays) -> Found {
        let mut found = Found::NONE;
        if rays.active != 0 && !self.clusters.is_empty() {
            dispatch(self.simd, Walk::<C, ANY> { cloud: self, rays, found: &mut found });
        }
        found
    }
}

impl<C: Cluster> LaneSurface for Cloud<C> {
    fn bounds(&self) -> [Vec3; 2] {
        // An empty cloud has an inside-out box, which is never asked.
        [self.bounds.low, self.bounds.high]
    }

    fn closest(&self, rays: &LaneRays, hits: &mut LaneHits, _counts: &mut SolveCounts) {
        let found = self.walk::<false>(rays);
        hits.hit = found.hit;
        hits.gave_up = 0;
        for lane in (0..LANES).filter(|lane| found.hit >> lane & 1 == 1) {
            let vector = |axes: &[[f32; LANES]; 3]| Vec3::from(axes.each_ref().map(|axis| axis[lane]));
            let cluster = &self.clusters[found.at[lane] as usize / WIDTH];
            let slot = found.at[lane] as usize % WIDTH;
            let t = found.t[lane];
            let normal = cluster.normal(slot, vector(&rays.origin), vector(&rays.direction), t);
            hits.t[lane] = t;
            hits.primitive[lane] = cluster.number(slot);
            hits.u[lane] = cluster.along(slot, vector(&rays.origin), vector(&rays.direction), t);
            hits.v[lane] = 0.0;
            for axis in 0..3 {
                hits.normal[axis][lane] = normal[axis];
            }
        }
    }

    fn occluded(&self, rays: &LaneRays, _counts: &mut SolveCounts) -> u16 {
        self.walk::<true>(rays).hit
    }

    fn bytes(&self) -> u64 {
        (size_of_val(self.nodes.as_slice()) + size_of_val(self.clusters.as_slice())) as u64
    }
}
