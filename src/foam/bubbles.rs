//! Foam from particles that lie under the surface: what is below it comes up and stays.
//!
//! A bubble at depth d counts by exp(-d / aeration depth), as the bubbles below foam thin out downward; the share of a column
//! that so many bubbles cover, each wherever it likes, is 1 - exp(-their area over the column's) (Poisson). How bubbles are
//! drawn under water is not here.

use super::FoamState;
use crate::particles::radius;
use crate::scene;
use crate::state::{Columns, Particles};

impl FoamState {
    /// Adds the foam of a frame's particles under its water's surface, each `foam.bubbles` times as wide in area as the ball of
    /// its mass and `scale`. What cannot be drawn (no mass, out of single precision) is left out.
    pub fn add_bubbles(&mut self, columns: &Columns, particles: &Particles, settings: &scene::Foam, scale: f64) {
        assert_eq!(self.count(), [columns.nx, columns.nz], "foam of another map");
        if settings.bubbles == 0.0 {
            return;
        }
        let mut area = vec![0.0f64; columns.nx * columns.nz];
        for (position, &mass) in particles.position.iter().zip(&particles.mass) {
            let Some(shares) = around(columns, [position[0], position[2]]) else { continue };
            let level: f64 = shares.iter().map(|&(column, share)| share * columns.top[column]).sum();
            let base: f64 = shares.iter().map(|&(column, share)| share * columns.base[column]).sum();
            let depth = level - position[1];
            let size = radius(mass, scale);
            if depth >= 0.0 && position[1] >= base && size.is_finite() {
                let cover = std::f64::consts::PI * size * size * (-depth / settings.aeration_depth).exp();
                for (column, share) in shares {
                    area[column] += share * cover;
                }
            }
        }
        let column = settings.bubbles / (columns.width[0] * columns.width[1]);
        self.cover(&area.iter().map(|area| (-area * column).exp() as f32).collect::<Vec<_>>());
    }
}

/// The four columns whose centres are around a place (x, z), with their bilinear shares; `None` outside of the map.
fn around(columns: &Columns, place: [f64; 2]) -> Option<[(usize, f64); 4]> {
    let count = [columns.nx, columns.nz];
    let mut near = [(0, 0.0); 2];
    for axis in 0..2 {
        let at = (place[axis] - columns.origin[axis]) / columns.width[axis];
        // Each column goes half a width beyond its centre.
        if !(at >= -0.5 && at <= count[axis] as f64 - 0.5) {
            return None;
        }
        let at = at.clamp(0.0, (count[axis] - 1) as f64);
        let first = (at as usize).min(count[axis] - 2);
        near[axis] = (first, at - first as f64);
    }
    let [(i, u), (j, v)] = near;
    let column = j * columns.nx + i;
    Some([
        (column, (1.0 - u) * (1.0 - v)),
        (column + 1, u * (1.0 - v)),
        (column + columns.nx, (1.0 - u) * v),
        (column + columns.nx + 1, u * v),
    ])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn water() -> Columns {
        Columns::level([10.0, 20.0], [0.5, 0.25], [4, 5], 0.0, 1.0)
    }

    /// A ball of a centimetre's radius at each place.
    fn balls(position: &[[f64; 3]]) -> Particles {
        let mass = 4.0 / 3.0 * std::f64::consts::PI * 1e-6 * 1000.0;
        let count = position.len();
        Particles {
            position: position.to_vec(),
            velocity: vec![[0.0; 3]; count],
            mass: vec![mass; count],
            age: vec![0.0; count],
            id: None,
        }
    }

    fn density(position: &[[f64; 3]], settings: &scene::Foam) -> Vec<f32> {
        let mut state = FoamState::new([4, 5], [0.5, 0.25], 0.0, 2.0);
        state.add_bubbles(&water(), &balls(position), settings, 1.0);
        state.density().to_vec()
    }

    #[test]
    fn bubbles_cover_what_so_many_discs_anywhere_do() {
        let settings = scene::Foam { bubbles: 1.0, ..Default::default() };
        let at_surface = vec![[10.5, 1.0, 20.25]; 100];
        let expected = 1.0 - (-100.0 * std::f64::consts::PI * 1e-4 / 0.125).exp();
        let covered = density(&at_surface, &settings);
        assert!((f64::from(covered[5]) - expected).abs() < 1e-6, "{} {expected}", covered[5]);
        assert_eq!(covered.iter().filter(|&&density| density > 0.0).count(), 1);
        // At one aeration depth each counts for 1/e.
        let below = vec![[10.5, 1.0 - settings.aeration_depth, 20.25]; 100];
        let expected = 1.0 - (-100.0 * std::f64::consts::PI * 1e-4 / 0.125 / std::f64::consts::E).exp();
        assert!((f64::from(density(&below, &settings)[5]) - expected).abs() < 1e-6);
    }

    #[test]
    fn what_is_in_the_air_in_the_ground_outside_or_not_wanted_makes_no_foam() {
        let settings = scene::Foam { bubbles: 1.0, ..Default::default() };
        let elsewhere = [[10.5, 1.01, 20.25], [10.5, -0.1, 20.25], [9.7, 0.9, 20.0], [10.5, 0.9, f64::NAN]];
        assert!(density(&elsewhere, &settings).iter().all(|&density| density == 0.0));
        let none = scene::Foam { bubbles: 0.0, ..Default::default() };
        assert!(density(&[[10.5, 1.0, 20.25]], &none).iter().all(|&density| density == 0.0));
    }

    #[test]
    fn foam_that_is_there_already_is_covered_no_twice() {
        let settings = scene::Foam { bubbles: 1e9, ..Default::default() };
        let mut state = FoamState::new([4, 5], [0.5, 0.25], 0.0, 2.0);
        for _ in 0..2 {
            state.add_bubbles(&water(), &balls(&[[10.5, 1.0, 20.25]]), &settings, 1.0);
            assert_eq!(state.density()[5], 1.0);
        }
    }
}
