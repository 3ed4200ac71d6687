//! Whether a tree is well formed: what every tree must hold whatever rule planted it, proved from the tree alone.
//!
//! It shares nothing with the planting but a primitive's box, and asks of every leaf whether it holds what lies in it.

use super::leaf::{Leaves, Runs};
use super::primitive::{Aabb, Primitive};
use super::{Bsp, Node, Rule};

/// Steps along a triangle's edge from which its points are taken.
const STEPS: u32 = 8;

/// What is wrong with a tree.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Flaw {
    /// Children that are not there.
    #[error("node {node}: children from {children} on, expected two of {count} nodes")]
    Children {
        /// The node.
        node: u32,
        /// Its first child.
        children: u32,
        /// Nodes that there are.
        count: usize,
    },
    /// A node on two ways, or on none.
    #[error("node {node} is reached {times} times, expected once")]
    Reached {
        /// The node.
        node: usize,
        /// On so many ways.
        times: u32,
    },
    /// A plane that does not part its cell in two.
    #[error("node {node}: plane {place} on axis {axis}, expected between {low} and {high}")]
    Plane {
        /// The node.
        node: u32,
        /// Its axis.
        axis: usize,
        /// The plane.
        place: f32,
        /// The cell's lower side.
        low: f32,
        /// The cell's upper side.
        high: f32,
    },
    /// A node too deep.
    #[error("node {node} lies under {depth} planes, expected at most {most}")]
    Depth {
        /// The node.
        node: u32,
        /// Its depth.
        depth: u32,
        /// The most there may be.
        most: u32,
    },
    /// Blocks that are not there, not this leaf's alone, or no leaf's.
    #[error("blocks of kind {kind}: number {block} is held by {times} leaves, expected one")]
    Blocks {
        /// 0 spheres, 1 discs, 2 triangles, 3 curves.
        kind: usize,
        /// The block.
        block: usize,
        /// So many leaves hold it.
        times: u32,
    },
    /// A block that does not repeat the scene's numbers.
    #[error("leaf {leaf}: its blocks differ from the scene's primitives")]
    Copy {
        /// The leaf.
        leaf: u32,
    },
    /// A primitive that a leaf should hold.
    #[error("leaf {leaf} lacks primitive {primitive} of part {part}, which lies in it")]
    Missing {
        /// The leaf.
        leaf: u32,
        /// The part.
        part: u32,
        /// The primitive.
        primitive: u32,
    },
    /// A primitive that a leaf should not hold, or not twice.
    #[error("leaf {leaf} holds primitive {primitive} of part {part}, which does not lie in it or is there already")]
    Foreign {
        /// The leaf.
        leaf: u32,
        /// The part.
        part: u32,
        /// The primitive.
        primitive: u32,
    },
    /// A primitive that is held too often or never.
    #[error("{times} leaves hold primitive {primitive} of part {part}")]
    Held {
        /// The part.
        part: u32,
        /// The primitive.
        primitive: u32,
        /// So many leaves hold it.
        times: u32,
    },
}

/// What is counted on the way.
struct Counted {
    nodes: Vec<u32>,
    blocks: [Vec<u32>; 4],
    primitives: Vec<u32>,
}

impl Bsp {
    /// Proves the tree well formed; takes some hundred times as long as building it.
    ///
    /// Every plane parts its cell, so that children partition their parent's box; every node is reached once and within
    /// the depth; every block belongs to one leaf and repeats the scene; every leaf holds what lies in its cell (with
    /// `bsp-report`, what has its centre there, and each primitive once), no primitive twice and none from elsewhere.
    ///
    /// # Errors
    /// The first flaw found.
    pub fn check(&self) -> Result<(), Flaw> {
        let kinds = self.leaves.counts();
        let mut counted = Counted {
            nodes: vec![0; self.nodes.len()],
            blocks: kinds.map(|count| vec![0; count]),
            primitives: vec![0; self.objects.count() as usize],
        };
        let usable = |&number: &u32| self.objects.get(number).bounds(self.objects.pad()).is_some();
        let all: Vec<u32> = (0..self.objects.count()).filter(usable).collect();
        self.check_node(0, self.bounds, 0, all.clone(), &mut counted)?;
        if let Some((node, &times)) = counted.nodes.iter().enumerate().find(|&(_, &times)| times != 1) {
            return Err(Flaw::Reached { node, times });
        }
        for (kind, blocks) in counted.blocks.iter().enumerate() {
            if let Some((block, &times)) = blocks.iter().enumerate().find(|&(_, &times)| times != 1) {
                return Err(Flaw::Blocks { kind, block, times });
            }
        }
        for number in all {
            let times = counted.primitives[number as usize];
            if times == 0 || (times > 1 && self.plan.rule == Rule::Report) {
                let (part, primitive) = self.objects.name(number);
                return Err(Flaw::Held { part, primitive, times });
            }
        }
        Ok(())
    }

    /// Checks a node and what is under it; `inside` are the primitives that lie in its cell.
    fn check_node(
        &self,
        node: u32,
        cell: Aabb,
        depth: u32,
        mut inside: Vec<u32>,
        counted: &mut Counted,
    ) -> Result<(), Flaw> {
        counted.nodes[node as usize] += 1;
        if depth > self.depth {
            return Err(Flaw::Depth { node, depth, most: self.depth });
        }
        inside.retain(|&number| self.lies_in(number, cell));
        let here = self.nodes[node as usize];
        if here.is_leaf() {
            return self.check_leaf(node, here, cell, &inside, counted);
        }
        let (axis, place, children) = (here.tag() as usize, here.place(), here.children());
        // A child before its parent would lead in a circle.
        if children <= node || children as usize + 1 >= self.nodes.len() {
            return Err(Flaw::Children { node, children, count: self.nodes.len() });
        }
        let (low, high) = (cell.low[axis], cell.high[axis]);
        if !(low < place && place < high) {
            return Err(Flaw::Plane { node, axis, place, low, high });
        }
        let [below, above] = cell.split(axis, place);
        self.check_node(children, below, depth + 1, inside.clone(), counted)?;
        self.check_node(children + 1, above, depth + 1, inside, counted)
    }

    fn check_leaf(&self, leaf: u32, node: Node, cell: Aabb, inside: &[u32], counted: &mut Counted) -> Result<(), Flaw> {
        let runs: Runs = self.leaves.runs(node.kind(), (node.value, node.count()));
        for (kind, (start, count)) in runs.into_iter().enumerate() {
            for block in start as usize..(start + count) as usize {
                let times = counted.blocks[kind].get_mut(block).ok_or(Flaw::Blocks { kind, block, times: 1 })?;
                *times += 1;
            }
        }
        let mut numbers: Vec<u32> = self.leaves.numbers(runs).collect();
        let mut fresh = Leaves::default();
        fresh.push(&self.objects, &numbers);
        if !fresh.same(&self.leaves, runs) {
            return Err(Flaw::Copy { leaf });
        }
        numbers.sort_unstable();
        for (k, &number) in numbers.iter().enumerate() {
            counted.primitives[number as usize] += 1;
            if (k > 0 && numbers[k - 1] == number) || !self.may_lie_in(number, cell) {
                let (part, primitive) = self.objects.name(number);
                return Err(Flaw::Foreign { leaf, part, primitive });
            }
        }
        if let Some(&number) = inside.iter().find(|number| numbers.binary_search(number).is_err()) {
            let (part, primitive) = self.objects.name(number);
            return Err(Flaw::Missing { leaf, part, primitive });
        }
        Ok(())
    }

    /// A primitive's whole box.
    fn whole(&self, number: u32) -> Aabb {
        self.objects.get(number).bounds(self.objects.pad()).unwrap_or(Aabb::EMPTY)
    }

    /// Whether a leaf with this cell must hold a primitive: it has a part inside, not on the cell's faces alone.
    fn lies_in(&self, number: u32, cell: Aabb) -> bool {
        let whole = self.whole(number);
        if self.plan.rule == Rule::Report {
            let center = 0.5 * whole.low + 0.5 * whole.high;
            return cell.low.cmplt(center).all() && center.cmplt(cell.high).all();
        }
        if !(whole.low.cmplt(cell.high).all() && cell.low.cmplt(whole.high).all()) {
            return false;
        }
        match self.objects.get(number) {
            Primitive::Sphere { center, radius } if self.plan.rule == Rule::Heuristic => {
                let center = center.as_dvec3();
                let nearest = center.clamp(cell.low.as_dvec3(), cell.high.as_dvec3());
                nearest.distance_squared(center) < f64::from(radius) * f64::from(radius)
            }
            Primitive::Triangle([a, b, c]) if self.plan.rule == Rule::Heuristic => {
                let step = |count: u32| f64::from(count) / f64::from(STEPS);
                let inside = |u: u32, v: u32| {
                    let [a, b, c] = [a, b, c].map(|corner| corner.as_dvec3());
                    let point = a + (b - a) * step(u) + (c - a) * step(v);
                    cell.low.as_dvec3().cmplt(point).all() && point.cmplt(cell.high.as_dvec3()).all()
                };
                (0..=STEPS).any(|u| (0..=STEPS - u).any(|v| inside(u, v)))
            }
            _ => true,
        }
    }

    /// Whether a leaf with this cell may hold a primitive: it touches the cell.
    fn may_lie_in(&self, number: u32, cell: Aabb) -> bool {
        let whole = self.whole(number);
        if self.plan.rule == Rule::Report {
            let center = 0.5 * whole.low + 0.5 * whole.high;
            return cell.low.cmple(center).all() && center.cmple(cell.high).all();
        }
        !whole.intersection(cell).is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::testing::random_scene;
    use super::super::Plan;
    use super::*;
    use crate::scene::ObjectsAccel;

    fn tree(kind: ObjectsAccel) -> Bsp {
        let mut scene = random_scene(1);
        scene.truncate(3);
        Bsp::new(scene, Plan::new(kind, None, None)).unwrap()
    }

    /// A leaf that holds something.
    fn leaf(tree: &Bsp) -> usize {
        tree.nodes.iter().position(|node| node.is_leaf() && node.count() > 0).unwrap()
    }

    #[test]
    fn every_kind_of_damage_is_found() {
        for kind in [ObjectsAccel::Bsp, ObjectsAccel::BspSah, ObjectsAccel::BspReport] {
            let damaged = |damage: &dyn Fn(&mut Bsp)| {
                let mut tree = tree(kind);
                assert_eq!(tree.check(), Ok(()), "{kind:?}");
                damage(&mut tree);
                tree.check().unwrap_err()
            };
            let flaw = damaged(&|tree| tree.nodes[0] = Node::plane(0, tree.bounds.high.x, 1));
            assert!(matches!(flaw, Flaw::Plane { node: 0, axis: 0, .. }), "{flaw}");
            let flaw = damaged(&|tree| tree.nodes[0] = Node::plane(0, tree.nodes[0].place(), 0));
            assert!(matches!(flaw, Flaw::Children { node: 0, children: 0, .. }), "{flaw}");
            let flaw = damaged(&|tree| tree.nodes.push(Node::EMPTY));
            assert!(matches!(flaw, Flaw::Reached { times: 0, .. }), "{flaw}");
            let flaw = damaged(&|tree| tree.depth = 3);
            assert!(matches!(flaw, Flaw::Depth { depth: 4, most: 3, .. }), "{flaw}");
            // A plane that moved: the leaves beside it no longer fit their cells.
            let flaw = damaged(&|tree| {
                let (root, low) = (tree.nodes[0], tree.bounds.low[tree.nodes[0].tag() as usize]);
                let place = 0.5 * root.place() + 0.5 * low;
                tree.nodes[0] = Node::plane(root.tag() as usize, place, root.children());
            });
            assert!(matches!(flaw, Flaw::Missing { .. } | Flaw::Foreign { .. } | Flaw::Plane { .. }), "{flaw}");
            let flaw = damaged(&|tree| {
                let at = leaf(tree);
                tree.nodes[at] = Node::EMPTY;
            });
            assert!(matches!(flaw, Flaw::Missing { .. }), "{flaw}");
            let flaw = damaged(&|tree| tree.leaves.damage());
            assert!(matches!(flaw, Flaw::Copy { .. }), "{flaw}");
        }
    }
}
