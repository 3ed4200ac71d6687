//! How many particles are near each one, and how near the nearest is: particles sorted by the cells of a grid.
//!
//! All are answered at once, cell by cell in the grid's order: what is next to a cell is found for all of its particles, by
//! steps from where it was for the cell before, and lies together in memory.

use std::ops::Range;

use glam::{IVec3, Vec3};
use rayon::prelude::*;

/// Neighbours after which no more are counted: a crowd is a crowd, and a million particles in one place end.
const MOST: u32 = 64;

/// Cells that are looked at one after the other; each such run searches for its first ones anew.
const RUN: usize = 1024;

/// What is around a particle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Nearness {
    /// Others within reach; 64 stands for that or more.
    pub count: u32,
    /// Distance (m) of the nearest of those counted; infinite without any.
    pub distance: f32,
}

const ALONE: Nearness = Nearness { count: 0, distance: f32::INFINITY };

/// A cell that holds particles.
#[derive(Clone, Copy, Debug)]
struct Cell {
    place: [i32; 3],
    /// Its first particle, in the order of the cells.
    first: u32,
}

/// What is around each particle (local frame, m) as far as `reach` (m). Without a reach nothing is near.
pub fn nearness(position: &[Vec3], reach: f32) -> Vec<Nearness> {
    let mut all = vec![ALONE; position.len()];
    if !(reach > 0.0 && reach.is_finite()) || position.is_empty() {
        return all;
    }
    // A cell is as wide as the reach.
    let at = |(index, place): (usize, &Vec3)| (cell(*place, reach).to_array(), index as u32);
    let mut sorted: Vec<([i32; 3], u32)> = position.par_iter().enumerate().map(at).collect();
    sorted.par_sort_unstable();
    let place: Vec<Vec3> = sorted.par_iter().map(|&(_, index)| position[index as usize]).collect();
    let begins = |&first: &usize| first == 0 || sorted[first].0 != sorted[first - 1].0;
    let cells: Vec<Cell> = (0..sorted.len())
        .into_par_iter()
        .filter(begins)
        .map(|first| Cell { place: sorted[first].0, first: first as u32 })
        .collect();
    let index: Vec<u32> = sorted.into_par_iter().map(|(_, index)| index).collect();
    let grid = Grid { place: &place, cells: &cells, reach };
    let runs = cells.len().div_ceil(RUN);
    let near: Vec<Vec<Nearness>> = (0..runs).into_par_iter().map(|run| grid.near(run * RUN)).collect();
    for (near, index) in near.into_iter().flatten().zip(index) {
        all[index as usize] = near;
    }
    all
}

struct Grid<'a> {
    /// Particles, cell by cell.
    place: &'a [Vec3],
    cells: &'a [Cell],
    reach: f32,
}

impl Grid<'_> {
    /// What is around the particles of a run of cells, in order.
    fn near(&self, start: usize) -> Vec<Nearness> {
        let end = (start + RUN).min(self.cells.len());
        let mut near = Vec::with_capacity(self.first(end) - self.first(start));
        // The first cell of each of nine columns along z that is not before the own one's lower neighbour.
        let mut low = [None; 9];
        for own in start..end {
            let place = IVec3::from_array(self.cells[own].place);
            let inside = self.first(own)..self.first(own + 1);
            // What lies in each column, before the own cell and behind it.
            let mut around: [Range<usize>; 18] = Default::default();
            for (column, low) in low.iter_mut().enumerate() {
                let [dx, dy] = [column as i32 / 3 - 1, column as i32 % 3 - 1];
                let [x, y] = [place.x.saturating_add(dx), place.y.saturating_add(dy)];
                let [first, last] = [-1, 1].map(|dz| [x, y, place.z.saturating_add(dz)]);
                let mut cell = low.unwrap_or_else(|| self.cells.partition_point(|cell| cell.place < first));
                while cell < self.cells.len() && self.cells[cell].place < first {
                    cell += 1;
                }
                *low = Some(cell);
                let mut beyond = cell;
                while beyond < self.cells.len() && self.cells[beyond].place <= last {
                    beyond += 1;
                }
                let [first, last] = [cell, beyond].map(|cell| self.first(cell));
                around[2 * column] = first..last.min(inside.start);
                around[2 * column + 1] = first.max(inside.end)..last;
            }
            for particle in inside.clone() {
                near.push(self.around(particle, &inside, &around));
            }
        }
        near
    }

    /// The first particle of a cell, or of those behind the last one.
    fn first(&self, cell: usize) -> usize {
        self.cells.get(cell).map_or(self.place.len(), |cell| cell.first as usize)
    }

    /// What is around a particle. Its own cell first: in a crowd that is enough.
    fn around(&self, particle: usize, inside: &Range<usize>, around: &[Range<usize>]) -> Nearness {
        let mut near = ALONE;
        let own = self.place[particle];
        for range in std::iter::once(inside).chain(around) {
            for other in range.clone() {
                if near.count == MOST {
                    return near;
                }
                let distance = own.distance(self.place[other]);
                if distance <= self.reach && other != particle {
                    near.count += 1;
                    near.distance = near.distance.min(distance);
                }
            }
        }
        near
    }
}

/// The cell of a place; beyond the integers' range, which no reach of a real drop needs, the last one.
fn cell(place: Vec3, width: f32) -> IVec3 {
    (place / width).floor().as_ivec3()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// What a search of all others finds: how many, and how near the nearest is.
    fn by_search_of_all(places: &[Vec3], index: usize, reach: f32) -> (usize, f32) {
        let others = places.iter().enumerate().filter(|&(other, _)| other != index);
        let near = others.map(|(_, other)| places[index].distance(*other)).filter(|&distance| distance <= reach);
        near.fold((0, f32::INFINITY), |(count, nearest), distance| (count + 1, nearest.min(distance)))
    }

    fn assert_found(places: &[Vec3], reach: f32) -> Result<(), TestCaseError> {
        let near = nearness(places, reach);
        prop_assert_eq!(near.len(), places.len());
        for (index, near) in near.into_iter().enumerate() {
            let (count, nearest) = by_search_of_all(places, index, reach);
            if count <= MOST as usize {
                prop_assert_eq!(near, Nearness { count: count as u32, distance: nearest });
            } else {
                prop_assert!(near.count == MOST && near.distance >= nearest && near.distance <= reach);
            }
        }
        Ok(())
    }

    #[test]
    fn neighbours_are_those_that_a_search_of_all_finds() {
        let place = |k: u32| {
            let [a, b, c, _] = sobol_burley::sample_4d(k, 0, 5);
            Vec3::new(a - 0.5, b - 0.5, c - 0.5) * 4.0
        };
        // In several runs of cells; many in each cell, and hardly any.
        let places: Vec<Vec3> = (0..3000).map(place).collect();
        assert_found(&places, 0.07).unwrap();
        assert_found(&places, 0.45).unwrap();
    }

    proptest! {
        #[test]
        fn neighbours_are_found_across_cells_in_crowds_and_far_apart(
            loose in prop::collection::vec(prop::array::uniform3(-3.0f32..3.0), 0..80),
            // On the cells' borders, several in one place.
            even in prop::collection::vec(prop::array::uniform3(-3i32..3), 0..150),
            far in prop::collection::vec(prop::array::uniform3(-1e9f32..1e9), 0..10),
        ) {
            let even = even.into_iter().map(|place| 0.5 * IVec3::from_array(place).as_vec3());
            let loose = loose.into_iter().chain(far).map(Vec3::from_array);
            let places: Vec<Vec3> = loose.chain(even).collect();
            assert_found(&places, 0.5)?;
        }
    }

    #[test]
    fn of_a_crowd_the_first_in_its_own_cell_are_counted() {
        // 100 in a cell and 100 in the one behind it: each is content with its own.
        let places: Vec<Vec3> = (0..200).map(|k| Vec3::new(0.1, 0.1, (k / 100) as f32 + 0.001 * k as f32)).collect();
        for (index, near) in nearness(&places, 1.0).into_iter().enumerate() {
            let cell = index / 100 * 100..index / 100 * 100 + 100;
            let counted = cell.filter(|&other| other != index).take(MOST as usize);
            let expected = counted.map(|other| places[index].distance(places[other])).fold(f32::INFINITY, f32::min);
            assert_eq!(near, Nearness { count: MOST, distance: expected });
        }
    }

    #[test]
    fn a_million_in_one_place_end() {
        let places = vec![Vec3::new(3.0, 1.0, 2.0); 1_000_000];
        assert!(nearness(&places, 0.01).iter().all(|near| *near == Nearness { count: MOST, distance: 0.0 }));
    }

    #[test]
    fn without_a_reach_and_at_the_end_of_numbers_nothing_breaks() {
        assert_eq!(nearness(&[Vec3::ZERO; 2], 0.0), [ALONE; 2]);
        assert_eq!(nearness(&[], 1.0), []);
        let far = [Vec3::splat(f32::MAX), Vec3::splat(f32::MAX), Vec3::splat(-f32::MAX)];
        let counts: Vec<u32> = nearness(&far, 1e-6).iter().map(|near| near.count).collect();
        assert_eq!(counts, [1, 1, 0]);
        assert_eq!(nearness(&[Vec3::NAN, Vec3::ZERO], 1.0), [ALONE; 2]);
    }
}
