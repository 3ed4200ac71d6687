//! Planting a tree: where planes go, which side keeps what, when to stop.
//!
//! The surface-area heuristic is Goldsmith and Salmon's (1987) and MacDonald and Booth's (1990); a sweep over the sides of
//! the primitives' boxes where they are few, bins of starts and ends where they are many (Shevtsov, Soupikov and Kapustin
//! 2007); straddlers are cut to their side's cell (Havran's perfect splits, 2000). Forks run in parallel, but where a tree
//! forks depends on the primitives alone: it is the same at any number of threads.

use super::leaf::Leaves;
use super::primitive::{Aabb, Objects};
use super::{MOST_REFERENCES, Node, Rule};

/// A step down costs this many tests of a primitive. Tests come four at a time from one run of memory, where a step waits
/// for its node: over 100,000 spheres 10 to 16 are fastest, 3 costs a tenth of that speed and 1 half.
const STEP_COST: f32 = 10.0;
/// A plane that leaves one side empty costs this much of what the heuristic says: rays through nothing are cheap, which
/// their share of the surface understates.
const EMPTY_SIDE: f32 = 0.8;
/// Up to so many primitives every side of every box is a candidate; above, the bins' borders.
const SWEEP: usize = 64;
/// Bins along an axis.
const BINS: usize = 32;
/// More primitives than this fork, up to a depth that keeps every processor busy; each fork copies its tree once.
const FORK: usize = 4096;
const FORK_DEPTH: u32 = 6;

/// A tree as it was planted.
#[derive(Debug)]
pub(super) struct Tree {
    pub(super) bounds: Aabb,
    pub(super) nodes: Vec<Node>,
    pub(super) leaves: Leaves,
    pub(super) straddlers: u64,
}

/// A primitive in a cell: its number and the box of what there is of it.
#[derive(Clone, Copy)]
struct Reference {
    bounds: Aabb,
    number: u32,
}

/// What a plane was chosen by.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Plane {
    axis: usize,
    place: f32,
}

struct Planter<'a> {
    objects: &'a Objects,
    rule: Rule,
    depth: u32,
    leaf: usize,
}

/// A part of the tree; its root is node 0.
#[derive(Default)]
struct Grove {
    nodes: Vec<Node>,
    leaves: Leaves,
    /// Numbers of primitives that reach out of a leaf, once per leaf.
    reaching: Vec<u32>,
}

/// Plants a tree of at most `depth` planes over a leaf, which splits boxes of more than `leaf` primitives.
pub(super) fn build(objects: &Objects, rule: Rule, depth: u32, leaf: u32) -> Tree {
    let references: Vec<Reference> = (0..objects.count())
        .filter_map(|number| objects.get(number).bounds(objects.pad()).map(|bounds| Reference { bounds, number }))
        .collect();
    let bounds = references.iter().fold(Aabb::EMPTY, |all, reference| all.union(reference.bounds));
    let planter = Planter { objects, rule, depth, leaf: leaf as usize };
    let mut grove = Grove { nodes: vec![Node::EMPTY], ..Grove::default() };
    if !references.is_empty() {
        let budget = MOST_REFERENCES * references.len() as u64;
        planter.grow(&mut grove, 0, references, bounds, 0, budget);
    }
    grove.reaching.sort_unstable();
    grove.reaching.dedup();
    Tree { bounds, nodes: grove.nodes, leaves: grove.leaves, straddlers: grove.reaching.len() as u64 }
}

impl Planter<'_> {
    /// Makes node `at` of what lies in a cell; `budget` references at most may lie under it.
    fn grow(&self, grove: &mut Grove, at: usize, all: Vec<Reference>, cell: Aabb, depth: u32, budget: u64) {
        let plane = if depth < self.depth && all.len() > self.leaf { self.plane(&all, cell) } else { None };
        let sides = plane.map(|plane| (plane, self.divide(&all, cell, plane)));
        // Where every primitive straddles, halves are no smaller than the whole; planes would only multiply them.
        let divided = sides.filter(|(_, [below, above])| {
            let (below, above) = (below.len(), above.len());
            (below < all.len() || above < all.len()) && (below + above) as u64 <= budget
        });
        let Some((Plane { axis, place }, [below, above])) = divided else {
            self.leaf(grove, at, &all, cell);
            return;
        };
        let total = all.len();
        drop(all);
        let halves = cell.split(axis, place);
        // In proportion: what one side does not use is not lent to the other, so that both may grow at once.
        let share = budget * below.len() as u64 / ((below.len() + above.len()) as u64).max(1);
        let budgets = [share, budget - share];
        let children = grove.nodes.len();
        grove.nodes[at] = Node::plane(axis, place, children as u32);
        grove.nodes.extend([Node::EMPTY; 2]);
        if total > FORK && depth < FORK_DEPTH {
            let new = |side: Vec<Reference>, half: usize| {
                let mut grove = Grove { nodes: vec![Node::EMPTY], ..Grove::default() };
                self.grow(&mut grove, 0, side, halves[half], depth + 1, budgets[half]);
                grove
            };
            let (below, above) = rayon::join(|| new(below, 0), || new(above, 1));
            grove.graft(children, below);
            grove.graft(children + 1, above);
        } else {
            self.grow(grove, children, below, halves[0], depth + 1, budgets[0]);
            self.grow(grove, children + 1, above, halves[1], depth + 1, budgets[1]);
        }
    }

    fn leaf(&self, grove: &mut Grove, at: usize, all: &[Reference], cell: Aabb) {
        let mut numbers: Vec<u32> = all.iter().map(|reference| reference.number).collect();
        // Like with like, and the same leaf whatever order the planes left.
        numbers.sort_unstable();
        let (kind, (start, count)) = grove.leaves.push(self.objects, &numbers);
        grove.nodes[at] = Node::leaf(kind, start, count);
        grove.reaching.extend(numbers.into_iter().filter(|&number| {
            let whole = self.objects.get(number).bounds(self.objects.pad());
            whole.is_some_and(|whole| whole.intersection(cell) != whole)
        }));
    }

    fn plane(&self, all: &[Reference], cell: Aabb) -> Option<Plane> {
        match self.rule {
            Rule::Report | Rule::Middle => middle(cell),
            Rule::Heuristic => {
                let best = if all.len() <= SWEEP { sweep(all, cell) } else { binned(all, cell) };
                best.filter(|&(_, cost)| cost < all.len() as f32).map(|(plane, _)| plane)
            }
        }
    }

    /// What lies below a plane and what above.
    fn divide(&self, all: &[Reference], cell: Aabb, Plane { axis, place }: Plane) -> [Vec<Reference>; 2] {
        let mut sides = [Vec::with_capacity(all.len() / 2), Vec::with_capacity(all.len() / 2)];
        let halves = cell.split(axis, place);
        for &reference in all {
            let Reference { bounds, number } = reference;
            let (low, high) = (bounds.low[axis], bounds.high[axis]);
            if self.rule == Rule::Report {
                let center = 0.5 * low + 0.5 * high;
                sides[usize::from(center >= place)].push(reference);
            } else if high <= place {
                sides[0].push(reference);
            } else if low >= place {
                sides[1].push(reference);
            } else if self.rule == Rule::Middle {
                sides[0].push(reference);
                sides[1].push(reference);
            } else {
                let primitive = self.objects.get(number);
                for (side, half) in sides.iter_mut().zip(halves) {
                    let cut = primitive.cut(bounds, half, self.objects.pad());
                    side.extend(cut.map(|bounds| Reference { bounds, number }));
                }
            }
        }
        sides
    }
}

impl Grove {
    /// Takes another grove; its root becomes node `at`.
    fn graft(&mut self, at: usize, other: Self) {
        let moved = self.leaves.append(other.leaves);
        // The other's node 1 comes to lie at the end of these.
        let shift = self.nodes.len() as u32 - 1;
        let mut nodes = other.nodes.into_iter().map(|node| {
            if node.is_leaf() {
                Node { value: node.value + moved[node.kind() as usize], ..node }
            } else {
                Node::plane(node.tag() as usize, node.place(), node.children() + shift)
            }
        });
        if let Some(root) = nodes.next() {
            self.nodes[at] = root;
        }
        self.nodes.extend(nodes);
        self.reaching.extend(other.reaching);
    }
}

/// The plane across the middle of the longest side; `None` where single precision has no number between the ends.
fn middle(cell: Aabb) -> Option<Plane> {
    let axis = (cell.high - cell.low).max_position();
    let place = 0.5 * cell.low[axis] + 0.5 * cell.high[axis];
    inside(cell, axis, place).then_some(Plane { axis, place })
}

/// Whether a plane leaves something of a cell on both sides.
fn inside(cell: Aabb, axis: usize, place: f32) -> bool {
    cell.low[axis] < place && place < cell.high[axis]
}

/// Least cost so far.
struct Cheapest {
    cell: Aabb,
    one_over_area: f32,
    best: Option<(Plane, f32)>,
}

impl Cheapest {
    /// `None` for a cell without area, in which no side's share can be told.
    fn new(cell: Aabb) -> Option<Self> {
        let one_over_area = 1.0 / cell.half_area();
        (one_over_area > 0.0 && one_over_area.is_finite()).then_some(Self { cell, one_over_area, best: None })
    }

    /// Offers a plane with what would lie below and above it.
    fn offer(&mut self, plane: Plane, below: usize, above: usize) {
        if !inside(self.cell, plane.axis, plane.place) {
            return;
        }
        let [share_below, share_above] =
            self.cell.split(plane.axis, plane.place).map(|half| half.half_area() * self.one_over_area);
        let tests = share_below * below as f32 + share_above * above as f32;
        let bonus = if below == 0 || above == 0 { EMPTY_SIDE } else { 1.0 };
        let cost = bonus * (STEP_COST + tests);
        if self.best.is_none_or(|(_, least)| cost < least) {
            self.best = Some((plane, cost));
        }
    }
}

/// The cheapest of the planes at every side of every box, and its cost in tests.
fn sweep(all: &[Reference], cell: Aabb) -> Option<(Plane, f32)> {
    let mut cheapest = Cheapest::new(cell)?;
    let (mut lows, mut highs) = ([0.0; SWEEP], [0.0; SWEEP]);
    let (lows, highs) = (&mut lows[..all.len()], &mut highs[..all.len()]);
    for axis in 0..3 {
        for ((low, high), reference) in lows.iter_mut().zip(highs.iter_mut()).zip(all) {
            (*low, *high) = (reference.bounds.low[axis], reference.bounds.high[axis]);
        }
        lows.sort_unstable_by(f32::total_cmp);
        highs.sort_unstable_by(f32::total_cmp);
        // Below a plane lies what begins before it, above it what does not end by it.
        let (mut begun, mut ended) = (0, 0);
        while ended < all.len() {
            let place = if begun < all.len() { lows[begun].min(highs[ended]) } else { highs[ended] };
            let below = begun;
            while ended < all.len() && highs[ended] <= place {
                ended += 1;
            }
            while begun < all.len() && lows[begun] <= place {
                begun += 1;
            }
            cheapest.offer(Plane { axis, place }, below, all.len() - ended);
        }
    }
    cheapest.best
}

/// The cheapest of the planes between bins and of those that cut off empty space, and its cost in tests.
fn binned(all: &[Reference], cell: Aabb) -> Option<(Plane, f32)> {
    let mut cheapest = Cheapest::new(cell)?;
    let size = cell.high - cell.low;
    let scale = glam::Vec3::splat(BINS as f32) / size;
    let (mut begin, mut end) = ([[0_usize; BINS]; 3], [[0_usize; BINS]; 3]);
    let mut within = Aabb::EMPTY;
    for reference in all {
        let Aabb { low, high } = reference.bounds;
        within = within.union(reference.bounds);
        let (first, last) = ((low - cell.low) * scale, (high - cell.low) * scale);
        for axis in 0..3 {
            // A cast takes what is below the cell, or NaN in a cell without extent, to 0.
            begin[axis][(first[axis] as usize).min(BINS - 1)] += 1;
            end[axis][(last[axis] as usize).min(BINS - 1)] += 1;
        }
    }
    for axis in 0..3 {
        cheapest.offer(Plane { axis, place: within.low[axis] }, 0, all.len());
        cheapest.offer(Plane { axis, place: within.high[axis] }, all.len(), 0);
        let (mut below, mut ended) = (0, 0);
        for bin in 1..BINS {
            below += begin[axis][bin - 1];
            ended += end[axis][bin - 1];
            let place = cell.low[axis] + size[axis] * (bin as f32 / BINS as f32);
            cheapest.offer(Plane { axis, place }, below, all.len() - ended);
        }
    }
    cheapest.best
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::super::super::testing::Random;
    use super::*;

    fn boxes(count: usize, seed: u64) -> Vec<Reference> {
        let mut random = Random(seed);
        (0..)
            .take(count)
            .map(|number| {
                let (low, size) = (random.vector(10.0), Vec3::splat(1.0) + random.vector(0.9));
                Reference { bounds: Aabb { low, high: low + size }, number }
            })
            .collect()
    }

    #[test]
    fn a_sweep_finds_the_cheapest_plane_and_bins_come_near_it() {
        let cell = Aabb { low: Vec3::splat(-12.0), high: Vec3::splat(14.0) };
        for seed in 0..20 {
            let all = boxes(SWEEP, seed);
            // Every candidate, counted anew.
            let mut least = f32::INFINITY;
            for axis in 0..3 {
                for place in all.iter().flat_map(|one| [one.bounds.low[axis], one.bounds.high[axis]]) {
                    let below = all.iter().filter(|one| one.bounds.low[axis] < place).count();
                    let above = all.iter().filter(|one| one.bounds.high[axis] > place).count();
                    let mut one = Cheapest::new(cell).unwrap();
                    one.offer(Plane { axis, place }, below, above);
                    least = least.min(one.best.unwrap().1);
                }
            }
            let (_, swept) = sweep(&all, cell).unwrap();
            let (plane, found) = binned(&all, cell).unwrap();
            assert_eq!(swept, least, "seed {seed}");
            assert!(found >= least && found < 1.1 * least, "seed {seed}: {found} for {least}");
            assert!(inside(cell, plane.axis, plane.place));
        }
    }

    #[test]
    fn empty_space_is_cut_off_where_it_pays() {
        // Everything in one corner of the cell: the first plane leaves the rest empty.
        let cell = Aabb { low: Vec3::splat(-100.0), high: Vec3::splat(20.0) };
        for count in [20, 200] {
            let all = boxes(count, 3);
            let (plane, _) = if count <= SWEEP { sweep(&all, cell) } else { binned(&all, cell) }.unwrap();
            assert!(all.iter().all(|one| one.bounds.low[plane.axis] >= plane.place), "{count}: {plane:?}");
        }
    }

    #[test]
    fn cells_too_thin_to_split_are_left() {
        let flat = Aabb { low: Vec3::ONE, high: Vec3::new(1.0, 1.0, 1.0_f32.next_up()) };
        assert_eq!(middle(flat), None);
        assert!(sweep(&boxes(5, 1), flat).is_none() && binned(&boxes(5, 1), flat).is_none());
    }
}
