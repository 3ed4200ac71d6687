//! Particles → clusters of up to sixteen neighbours → nodes of sixteen children, from the top down.
//!
//! Each cut is where the surface-area heuristic is least, counting clusters rather than particles, so that clusters are
//! full (Wald, On fast construction of SAH-based bounding volume hierarchies, 2007: centres in bins; few particles are
//! sorted instead). A node cuts whichever of its children is the largest until it has sixteen.

use glam::{Vec3, Vec3A};
use rayon::prelude::*;

use super::super::bsp::primitive::Aabb;
use super::{CLUSTER, Node, WIDTH};

/// A particle on its way into a cluster.
#[derive(Clone, Copy, Debug)]
pub(super) struct Record {
    pub(super) center: Vec3,
    pub(super) radius: f32,
    pub(super) number: u32,
}

/// Nodes under which cuts follow the heuristic; deeper ones halve, so that depth is bounded whatever the particles do.
const FREE_DEPTH: u32 = 12;
/// Nodes on the way to a cluster, at most. A node that halves leaves a sixteenth of its particles, rounded to whole
/// clusters, to each child: 2^32 are 16 within eight.
pub(super) const MOST_DEPTH: u32 = FREE_DEPTH + 8;
/// Bins along an axis.
const BINS: usize = 16;
/// Particles that are sorted rather than counted in bins.
const SORTED: usize = 64;
/// Particles for which another thread is worth while.
const PARALLEL: usize = 1 << 13;

/// Units in the last place by which boxes grow, of their sphere's radius and place.
///
/// What a test computes of a hit may lie this far outside of its particle: the test's roundings along an axis are a few
/// parts in 2^24 of the way along it, which the walk allows for, and a few parts of the radius, and of the coordinates in
/// these boxes' own subtraction.
pub(super) const PAD: f32 = 8.0 * f32::EPSILON;

/// A tree over some of the particles.
pub(super) struct Tree<C> {
    pub(super) nodes: Vec<Node>,
    pub(super) clusters: Vec<C>,
    pub(super) bounds: Aabb,
}

/// How clusters are filled, and exact boxes.
#[derive(Clone, Copy)]
struct Shapes<'a, C> {
    group: &'a (dyn Fn(&[Record]) -> C + Sync),
    bounds: &'a (dyn Fn(&Record) -> Option<Aabb> + Sync),
}

/// The tree over all records, which are brought into its order.
pub(super) fn build<C: Copy + Send>(
    records: &mut [Record],
    group: &(dyn Fn(&[Record]) -> C + Sync),
    bounds: &(dyn Fn(&Record) -> Option<Aabb> + Sync),
) -> Tree<C> {
    let mut tree = Tree { nodes: Vec::new(), clusters: Vec::new(), bounds: Aabb::EMPTY };
    if !records.is_empty() {
        tree.bounds = tree.grow(records, 0, Shapes { group, bounds });
    }
    tree
}

impl<C: Copy + Send> Tree<C> {
    /// Adds the node over some records and all below it; returns its box.
    fn grow(&mut self, records: &mut [Record], depth: u32, shapes: Shapes<'_, C>) -> Aabb {
        let at = self.nodes.len();
        self.nodes.push(Node::EMPTY);
        let large = records.len() > PARALLEL;
        let children = split_to_width(records, depth >= FREE_DEPTH);
        let mut bounds = Aabb::EMPTY;
        let mut place = |tree: &mut Self, slot: usize, (child, of): (u32, Aabb)| {
            bounds = bounds.union(of);
            let node = &mut tree.nodes[at];
            node.child[slot] = child;
            for axis in 0..3 {
                node.planes[axis][0][slot] = of.low[axis];
                node.planes[axis][1][slot] = of.high[axis];
            }
        };
        if large {
            let trees: Vec<_> = children
                .into_par_iter()
                .map(|records| {
                    let mut tree = Self { nodes: Vec::new(), clusters: Vec::new(), bounds: Aabb::EMPTY };
                    let root = tree.child(records, depth, shapes);
                    (tree, root)
                })
                .collect();
            for (slot, (tree, (child, of))) in trees.into_iter().enumerate() {
                let child = self.append(tree, child);
                place(self, slot, (child, of));
            }
        } else {
            for (slot, records) in children.into_iter().enumerate() {
                let child = self.child(records, depth, shapes);
                place(self, slot, child);
            }
        }
        bounds
    }

    /// A child over some records: its number and its box.
    fn child(&mut self, records: &mut [Record], depth: u32, shapes: Shapes<'_, C>) -> (u32, Aabb) {
        if records.len() > WIDTH {
            let number = self.nodes.len() as u32;
            return (number, self.grow(records, depth + 1, shapes));
        }
        let number = self.clusters.len() as u32 | CLUSTER;
        self.clusters.push((shapes.group)(records));
        let bounds = records.iter().fold(Aabb::EMPTY, |bounds, record| {
            let exact = (shapes.bounds)(record).unwrap_or(Aabb::EMPTY);
            let pad = Vec3::splat(record.radius * PAD) + record.center.abs() * PAD;
            bounds.union(Aabb { low: exact.low - pad, high: exact.high + pad })
        });
        (number, bounds)
    }

    /// Takes over another tree's nodes and clusters; returns a child of it by its new number.
    fn append(&mut self, mut other: Self, child: u32) -> u32 {
        let (nodes, clusters) = (self.nodes.len() as u32, self.clusters.len() as u32);
        let moved = |child: u32| if child & CLUSTER != 0 { child + clusters } else { child + nodes };
        for node in &mut other.nodes {
            for (slot, child) in node.child.iter_mut().enumerate() {
                // A slot without a box has no child to move.
                if node.planes[0][0][slot] <= node.planes[0][1][slot] {
                    *child = moved(*child);
                }
            }
        }
        self.nodes.append(&mut other.nodes);
        self.clusters.append(&mut other.clusters);
        moved(child)
    }
}

/// Where records are cut, and half the surface of what lies on either side (m²).
struct Cut {
    at: usize,
    area: [f32; 2],
}

/// The records as up to sixteen groups, none empty, none larger than it need be.
fn split_to_width(records: &mut [Record], halve: bool) -> Vec<&mut [Record]> {
    let mut groups = Vec::with_capacity(WIDTH);
    // The first has no rival, so its area does not matter.
    groups.push((0.0, records));
    while groups.len() < WIDTH {
        let open = (0..groups.len()).filter(|&k| groups[k].1.len() > WIDTH);
        // Below the free depth the most numerous is cut, which bounds what is left.
        let size = |k: usize| if halve { groups[k].1.len() as f32 } else { groups[k].0 };
        let Some(largest) = open.max_by(|&a, &b| size(a).total_cmp(&size(b))) else { break };
        let (_, records) = groups.swap_remove(largest);
        let cut = if halve { halved(records) } else { cut(records) };
        let (low, high) = records.split_at_mut(cut.at);
        groups.push((cut.area[0], low));
        groups.push((cut.area[1], high));
    }
    groups.into_iter().map(|(_, records)| records).collect()
}

fn around(record: &Record) -> Box3 {
    let (center, radius) = (Vec3A::from(record.center), Vec3A::splat(record.radius));
    Box3 { low: center - radius, high: center + radius }
}

/// A box in vector registers: growing boxes is most of the building's work.
#[derive(Clone, Copy)]
struct Box3 {
    low: Vec3A,
    high: Vec3A,
}

impl Box3 {
    const EMPTY: Self = Self { low: Vec3A::INFINITY, high: Vec3A::NEG_INFINITY };

    fn union(self, other: Self) -> Self {
        Self { low: self.low.min(other.low), high: self.high.max(other.high) }
    }
    fn of(records: &[Record]) -> Self {
        records.iter().fold(Self::EMPTY, |bounds, record| bounds.union(around(record)))
    }
    /// Half of the surface (m²).
    fn half_area(self) -> f32 {
        let size = self.high - self.low;
        size.x * size.y + size.y * size.z + size.z * size.x
    }
}

/// Clusters that some particles fill.
fn clusters(count: usize) -> f32 {
    count.div_ceil(WIDTH) as f32
}

/// Brings records into order for the best cut, with something on both sides of it.
fn cut(records: &mut [Record]) -> Cut {
    if records.len() <= SORTED { cut_sorted(records) } else { cut_binned(records).unwrap_or_else(|| halved(records)) }
}

/// In the middle of the axis along which the centres reach farthest, at whole clusters.
fn halved(records: &mut [Record]) -> Cut {
    let centers = centers(records);
    let axis = largest((centers.high - centers.low).into());
    let at = (records.len() / 2).next_multiple_of(WIDTH).min(records.len() - 1);
    records.select_nth_unstable_by(at, |a, b| along(a, b, axis));
    let (low, high) = records.split_at(at);
    Cut { at, area: [Box3::of(low).half_area(), Box3::of(high).half_area()] }
}

fn along(a: &Record, b: &Record, axis: usize) -> std::cmp::Ordering {
    a.center[axis].total_cmp(&b.center[axis]).then(a.number.cmp(&b.number))
}

fn largest(size: Vec3) -> usize {
    if size.x >= size.y && size.x >= size.z {
        0
    } else if size.y >= size.z {
        1
    } else {
        2
    }
}

fn centers(records: &[Record]) -> Box3 {
    records.iter().fold(Box3::EMPTY, |bounds, record| {
        let center = Vec3A::from(record.center);
        bounds.union(Box3 { low: center, high: center })
    })
}

/// Every cut along every axis.
fn cut_sorted(records: &mut [Record]) -> Cut {
    let count = records.len();
    let mut best = (f32::INFINITY, 0, Cut { at: count / 2, area: [0.0; 2] });
    let mut right = [0.0; SORTED];
    for axis in 0..3 {
        records.sort_unstable_by(|a, b| along(a, b, axis));
        let mut bounds = Box3::EMPTY;
        for k in (1..count).rev() {
            bounds = bounds.union(around(&records[k]));
            right[k] = bounds.half_area();
        }
        let mut bounds = Box3::EMPTY;
        for k in 1..count {
            bounds = bounds.union(around(&records[k - 1]));
            let area = [bounds.half_area(), right[k]];
            let cost = area[0] * clusters(k) + area[1] * clusters(count - k);
            if cost < best.0 {
                best = (cost, axis, Cut { at: k, area });
            }
        }
    }
    if best.1 != 2 {
        records.sort_unstable_by(|a, b| along(a, b, best.1));
    }
    best.2
}

/// Between bins; `None` where no cut leaves something on both sides.
fn cut_binned(records: &mut [Record]) -> Option<Cut> {
    let centers = centers(records);
    // A place in bins; what rounding puts behind the last is in the last.
    let scale = Vec3A::splat(BINS as f32 * (1.0 - f32::EPSILON)) / (centers.high - centers.low);
    let places = |record: &Record| ((Vec3A::from(record.center) - centers.low) * scale).to_array();
    let bin = |place: f32| (place as usize).min(BINS - 1);
    let mut bins = [[(0_usize, Box3::EMPTY); BINS]; 3];
    for record in records.iter() {
        let bounds = around(record);
        for (bins, place) in bins.iter_mut().zip(places(record)) {
            let bin = &mut bins[bin(place)];
            *bin = (bin.0 + 1, bin.1.union(bounds));
        }
    }
    let mut best: Option<(f32, usize, usize, [f32; 2])> = None;
    for (axis, bins) in bins.iter().enumerate() {
        let mut right = [(0, Box3::EMPTY); BINS];
        let mut sum = (0, Box3::EMPTY);
        for k in (1..BINS).rev() {
            sum = (sum.0 + bins[k].0, sum.1.union(bins[k].1));
            right[k] = sum;
        }
        let mut left = (0, Box3::EMPTY);
        for k in 1..BINS {
            left = (left.0 + bins[k - 1].0, left.1.union(bins[k - 1].1));
            if left.0 == 0 || right[k].0 == 0 {
                continue;
            }
            let area = [left.1.half_area(), right[k].1.half_area()];
            let cost = area[0] * clusters(left.0) + area[1] * clusters(right[k].0);
            if best.is_none_or(|best| cost < best.0) {
                best = Some((cost, axis, k, area));
            }
        }
    }
    let (_, axis, first, area) = best?;
    Some(Cut { at: partition(records, |record| bin(places(record)[axis]) < first), area })
}

/// Brings the records of the left side to the front; returns how many there are.
fn partition(records: &mut [Record], left: impl Fn(&Record) -> bool) -> usize {
    let (mut front, mut back) = (0, records.len());
    while front < back {
        if left(&records[front]) {
            front += 1;
        } else {
            back -= 1;
            records.swap(front, back);
        }
    }
    front
}
