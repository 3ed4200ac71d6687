//! The few nearest particles of each one, however far apart they are: a tree that halves space where it halves the particles
//! (J. Bentley, Multidimensional binary search trees used for associative searching, 1975).
//!
//! Which of them are alike is not here, and neither are counts within one reach: `neighbours` has those, by a grid.

use glam::Vec3;
use rayon::prelude::*;

/// Neighbours that are looked for.
pub(super) const MOST: usize = 8;

/// Particles that are searched one after the other: below, a further plane costs more than it spares.
const LEAF: usize = 8;

/// Particles from which on both halves are sorted at once.
const SHARED: usize = 4096;

/// Particles that one thread asks for at a time.
const RUN: usize = 1024;

/// Reach (m) beyond which nothing is looked for: squares of it are single precision's still.
const FARTHEST: f32 = 1e18;

/// The nearest others of a particle: their squared distances (m²), ascending, and their numbers.
#[derive(Clone, Copy, Debug)]
pub(super) struct Nearest {
    found: [(f32, u32); MOST],
    count: usize,
    /// Square of what the next one must not be beyond.
    worst: f32,
}

impl Nearest {
    fn new(reach: f32) -> Self {
        let reach = if reach > 0.0 { reach.min(FARTHEST) } else { -1.0 };
        Self { found: [(f32::INFINITY, 0); MOST], count: 0, worst: reach * reach.abs() }
    }

    fn add(&mut self, square: f32, index: u32) {
        let full = self.count == MOST;
        if !(square <= self.worst) || full && square >= self.found[MOST - 1].0 {
            return;
        }
        let mut place = if full { MOST - 1 } else { self.count };
        while place > 0 && self.found[place - 1].0 > square {
            self.found[place] = self.found[place - 1];
            place -= 1;
        }
        self.found[place] = (square, index);
        self.count = (self.count + 1).min(MOST);
        if self.count == MOST {
            self.worst = self.found[MOST - 1].0;
        }
    }

    /// Squared distance (m2) and number of each, the nearest first.
    pub(super) fn squares(&self) -> &[(f32, u32)] {
        &self.found[..self.count]
    }
}

/// Particles in the order of the tree: that in the middle of a range divides it.
struct Tree {
    place: Vec<Vec3>,
    index: Vec<u32>,
    /// Axis across which the particle in the middle of a range divides it.
    axis: Vec<u8>,
}

impl Tree {
    fn new(position: &[Vec3]) -> Self {
        let mut sorted: Vec<(Vec3, u32)> = position.iter().copied().zip(0..).collect();
        let mut axis = vec![0; sorted.len()];
        divide(&mut sorted, &mut axis);
        let (place, index) = sorted.into_iter().unzip();
        Self { place, index, axis }
    }

    fn search(&self, own: usize, [start, end]: [usize; 2], nearest: &mut Nearest) {
        let from = self.place[own];
        let mut look = |at: usize| {
            if at != own {
                nearest.add(from.distance_squared(self.place[at]), self.index[at]);
            }
        };
        if end - start <= LEAF {
            (start..end).for_each(look);
            return;
        }
        let middle = start + (end - start) / 2;
        look(middle);
        let axis = usize::from(self.axis[middle]);
        let beyond = from[axis] - self.place[middle][axis];
        let (low, high) = ([start, middle], [middle + 1, end]);
        let (near, far) = if beyond < 0.0 { (low, high) } else { (high, low) };
        self.search(own, near, nearest);
        // Of a crowd in one place enough is enough: those across are no nearer.
        let square = beyond * beyond;
        if square < nearest.worst || nearest.count < MOST && square <= nearest.worst {
            self.search(own, far, nearest);
        }
    }
}

/// Puts the middle particle along the widest axis in the middle, what lies below it before and the rest behind, and so on.
fn divide(sorted: &mut [(Vec3, u32)], axes: &mut [u8]) {
    if sorted.len() <= LEAF {
        return;
    }
    let first = sorted[0].0;
    let (low, high) = sorted.iter().fold((first, first), |(low, high), (place, _)| (low.min(*place), high.max(*place)));
    // Halves, since the whole of single precision's range is none of its numbers.
    let axis = (0.5 * high - 0.5 * low).max_position();
    let middle = sorted.len() / 2;
    // Of equal places the numbers decide, so that the order is one whatever the sorting is.
    sorted.select_nth_unstable_by(middle, |a, b| a.0[axis].total_cmp(&b.0[axis]).then(a.1.cmp(&b.1)));
    axes[middle] = axis as u8;
    let shared = sorted.len() >= SHARED;
    let ((low, rest), (low_axes, rest_axes)) = (sorted.split_at_mut(middle), axes.split_at_mut(middle));
    let (high, high_axes) = (&mut rest[1..], &mut rest_axes[1..]);
    if shared {
        rayon::join(|| divide(low, low_axes), || divide(high, high_axes));
    } else {
        divide(low, low_axes);
        divide(high, high_axes);
    }
}

/// Asks for each particle (local frame, m) what `of` makes of the nearest others within `reach(index)` (m), in O(n log n).
pub(super) fn nearest<T: Copy + Default + Send>(
    position: &[Vec3],
    reach: impl Fn(usize) -> f32 + Sync,
    of: impl Fn(usize, &Nearest) -> T + Sync,
) -> Vec<T> {
    let tree = Tree::new(position);
    let count = position.len();
    // In the tree's order, in which those that are asked for one after the other lie together.
    let run = |start: usize| -> Vec<T> {
        (start..(start + RUN).min(count))
            .map(|own| {
                let index = tree.index[own] as usize;
                let mut nearest = Nearest::new(reach(index));
                if nearest.worst >= 0.0 {
                    tree.search(own, [0, count], &mut nearest);
                }
                of(index, &nearest)
            })
            .collect()
    };
    let runs: Vec<Vec<T>> = (0..count.div_ceil(RUN)).into_par_iter().map(|number| run(number * RUN)).collect();
    let mut all = vec![T::default(); count];
    for (value, &index) in runs.into_iter().flatten().zip(&tree.index) {
        all[index as usize] = value;
    }
    all
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn squares(places: &[Vec3], reach: f32) -> Vec<[f32; MOST]> {
        nearest(
            places,
            |_| reach,
            |index, nearest| {
                let mut found = [f32::INFINITY; MOST];
                for (k, &(square, other)) in nearest.squares().iter().enumerate() {
                    assert!(
                        other as usize != index && places[index].distance_squared(places[other as usize]) == square
                    );
                    found[k] = square;
                }
                found
            },
        )
    }

    fn by_search_of_all(places: &[Vec3], index: usize, reach: f32) -> [f32; MOST] {
        let others = (0..places.len()).filter(|&other| other != index);
        let mut near: Vec<f32> = others.map(|other| places[index].distance_squared(places[other])).collect();
        near.retain(|&square| square <= reach * reach);
        near.sort_unstable_by(f32::total_cmp);
        near.resize(MOST, f32::INFINITY);
        std::array::from_fn(|k| near[k])
    }

    proptest! {
        #[test]
        fn the_nearest_are_those_that_a_search_of_all_finds(
            loose in prop::collection::vec(prop::array::uniform3(-3.0f32..3.0), 0..150),
            // Several in one place, and on one plane.
            even in prop::collection::vec(prop::array::uniform3(-2i32..2), 0..150),
            far in prop::collection::vec(prop::array::uniform3(-1e9f32..1e9), 0..10),
            reach in prop::sample::select(vec![0.1f32, 1.0, 30.0, 1e12]),
        ) {
            let even = even.into_iter().map(|place| glam::IVec3::from_array(place).as_vec3());
            let places: Vec<Vec3> = loose.into_iter().chain(far).map(Vec3::from_array).chain(even).collect();
            for (index, found) in squares(&places, reach).into_iter().enumerate() {
                prop_assert_eq!(found, by_search_of_all(&places, index, reach));
            }
        }
    }

    #[test]
    fn many_are_found_in_runs_and_by_any_count_of_threads() {
        let place = |k: u32| Vec3::from_slice(&sobol_burley::sample_4d(k, 0, 9)[..3]);
        let places: Vec<Vec3> = (0..20_000).map(place).collect();
        let found = squares(&places, 0.05);
        for index in (0..places.len()).step_by(97) {
            assert_eq!(found[index], by_search_of_all(&places, index, 0.05));
        }
        let numbers = || nearest(&places, |_| 0.05, |_, nearest| nearest.found.map(|(_, other)| other));
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        assert_eq!(numbers(), pool.install(numbers));
    }

    #[test]
    fn crowds_and_the_ends_of_numbers_end() {
        let million = vec![Vec3::new(3.0, 1.0, 2.0); 1_000_000];
        assert!(squares(&million, 0.1).iter().all(|found| *found == [0.0; MOST]));
        assert!(squares(&[], 1.0).is_empty());
        let far = [Vec3::splat(f32::MAX), Vec3::splat(f32::MAX), Vec3::splat(-f32::MAX), Vec3::ZERO];
        let found = squares(&far, f32::MAX);
        assert_eq!(found[0], by_search_of_all(&far[..2], 0, 1.0));
        assert_eq!(found[3], [f32::INFINITY; MOST]);
        for reach in [0.0, -1.0, f32::NAN] {
            assert_eq!(squares(&million[..3], reach), [[f32::INFINITY; MOST]; 3]);
        }
    }
}
