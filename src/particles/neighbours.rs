//! How many particles are near each one, and how near the nearest is: particles sorted by the cells of a grid.

use glam::{IVec3, Vec3};
use rayon::prelude::*;

/// Neighbours after which no more are counted: a crowd is a crowd, and a million particles in one place end.
const MOST: u32 = 64;

/// What is around a particle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Nearness {
    /// Others within reach; 64 stands for that or more.
    pub count: u32,
    /// Distance (m) of the nearest of those counted; infinite without any.
    pub distance: f32,
}

/// Particles by the cell that they are in; a cell is as wide as the reach.
#[derive(Clone, Debug)]
pub struct Neighbours<'a> {
    position: &'a [Vec3],
    reach: f32,
    /// Cell and particle, sorted.
    sorted: Vec<([i32; 3], u32)>,
}

impl<'a> Neighbours<'a> {
    /// Sorts particles (local frame, m), which have neighbours as far as `reach` (m). Without a reach nothing is near.
    pub fn new(position: &'a [Vec3], reach: f32) -> Self {
        let mut sorted = Vec::new();
        if reach > 0.0 && reach.is_finite() {
            sorted = (0..).zip(position).map(|(index, &place)| (cell(place, reach).to_array(), index)).collect();
            sorted.par_sort_unstable();
        }
        Self { position, reach, sorted }
    }

    /// What is around particle `index`.
    pub fn near(&self, index: usize) -> Nearness {
        let mut near = Nearness { count: 0, distance: f32::INFINITY };
        if self.sorted.is_empty() {
            return near;
        }
        let own = cell(self.position[index], self.reach);
        // Its own cell first: in a crowd that is enough.
        self.visit(index, [own.to_array(); 2], None, &mut near);
        for dx in -1..=1 {
            for dy in -1..=1 {
                // Cells along z lie one after the other.
                let column = [own.x.saturating_add(dx), own.y.saturating_add(dy)];
                let ends = [-1, 1].map(|dz| [column[0], column[1], own.z.saturating_add(dz)]);
                self.visit(index, ends, Some(own.to_array()), &mut near);
            }
        }
        near
    }

    /// Counts those in the cells from one to another, but for one cell.
    fn visit(&self, index: usize, [first, last]: [[i32; 3]; 2], but: Option<[i32; 3]>, near: &mut Nearness) {
        let start = self.sorted.partition_point(|(cell, _)| *cell < first);
        for &(cell, other) in &self.sorted[start..] {
            if cell > last || near.count == MOST {
                return;
            }
            let distance = self.position[index].distance(self.position[other as usize]);
            if Some(cell) != but && other as usize != index && distance <= self.reach {
                near.count += 1;
                near.distance = near.distance.min(distance);
            }
        }
    }
}

/// The cell of a place; beyond the integers' range, which no reach of a real drop needs, the last one.
fn cell(place: Vec3, width: f32) -> IVec3 {
    (place / width).floor().as_ivec3()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neighbours_are_those_that_a_search_of_all_finds() {
        let places: Vec<Vec3> = (0..400)
            .map(|k| {
                let [a, b, c, _] = sobol_burley::sample_4d(k, 0, 5);
                Vec3::new(a - 0.5, b - 0.5, c - 0.5) * 4.0
            })
            .collect();
        let reach = 0.45;
        let neighbours = Neighbours::new(&places, reach);
        for (index, place) in places.iter().enumerate() {
            let others = places.iter().enumerate().filter(|&(other, _)| other != index);
            let distances: Vec<f32> = others.map(|(_, other)| place.distance(*other)).filter(|&d| d <= reach).collect();
            let nearest = distances.iter().copied().fold(f32::INFINITY, f32::min);
            let expected = Nearness { count: distances.len() as u32, distance: nearest };
            assert_eq!(neighbours.near(index), expected);
        }
    }

    #[test]
    fn a_million_in_one_place_end() {
        let places = vec![Vec3::new(3.0, 1.0, 2.0); 1_000_000];
        let neighbours = Neighbours::new(&places, 0.01);
        assert_eq!(neighbours.near(123_456), Nearness { count: MOST, distance: 0.0 });
    }

    #[test]
    fn without_a_reach_and_at_the_end_of_numbers_nothing_breaks() {
        assert_eq!(Neighbours::new(&[Vec3::ZERO; 2], 0.0).near(0).count, 0);
        let far = [Vec3::splat(f32::MAX), Vec3::splat(f32::MAX), Vec3::splat(-f32::MAX)];
        assert_eq!(Neighbours::new(&far, 1e-6).near(0).count, 1);
        assert_eq!(Neighbours::new(&far, 1e-6).near(2).count, 0);
    }
}
