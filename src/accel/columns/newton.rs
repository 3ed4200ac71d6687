//! The report's Newton solver (section 2.3.1, after Martin, Cohen, Fish and Shirley 2000): the ray as the meeting of two
//! planes, and (u, v) driven until the surface's point lies on both.
//!
//! As the report had it: one guess, at most five steps, no proof that a root is the first, and no stop where the distance
//! grows (the report's section says why). (u, v) range over the whole surface, so a root may lie columns away from its
//! guess. At tangency the Jacobian is singular; the guess is then moved a little, at random.

use glam::DVec3;

use crate::math::scramble;
use crate::surface::Lattice;
use crate::surface::report_solver::{JITTER_TOLERANCE, MAX_ITER};

/// A point of the surface on the ray.
pub(super) struct Root {
    /// In lengths of the direction.
    pub(super) t: f64,
    /// Patch.
    pub(super) cell: [usize; 2],
    /// Place within it, 0..1.
    pub(super) place: [f64; 2],
    /// dy/dx, dy/dz.
    pub(super) slope: [f64; 2],
}

/// A ray over a surface, as two planes.
pub(super) struct Target<'a> {
    lattice: &'a Lattice,
    origin: DVec3,
    direction: DVec3,
    /// Unit normals of the planes, both through the ray.
    planes: [DVec3; 2],
}

impl<'a> Target<'a> {
    pub(super) fn new(lattice: &'a Lattice, origin: DVec3, direction: DVec3) -> Self {
        let size = direction.abs();
        let first = if size.x > size.y && size.x > size.z {
            DVec3::new(direction.y, -direction.x, 0.0)
        } else {
            DVec3::new(0.0, direction.z, -direction.y)
        };
        let planes = [first.normalize(), first.cross(direction).normalize()];
        Self { lattice, origin, direction, planes }
    }

    /// The root that is found from a cell's middle; `None` if none is.
    ///
    /// `tolerance` is the report's `ROOT_TOLERANCE`: the sum of the distances from both planes (m) at which a point counts
    /// as on the ray. The report names no value; here it is the scene's.
    pub(super) fn root(&self, cell: [usize; 2], tolerance: f64, seed: u64, iterations: &mut u64) -> Option<Root> {
        // Finer than its t can be told in single precision, or its place in double, a root cannot be had.
        let [low, high] = self.lattice.extent;
        let finest = 8.0 * f64::EPSILON * (self.origin.length() + low.abs() + high.abs());
        let mut random = seed;
        let mut at = cell.map(|index| index as f64 + 0.5);
        for step in 0..=MAX_ITER {
            let (cell, place) = self.out_of_empty_regions(at)?;
            let (height, slope) = self.lattice.evaluate(cell[0], cell[1], place[0], place[1]);
            at = [cell[0] as f64 + place[0], cell[1] as f64 + place[1]];
            let [x, z] = self.lattice.from_cell(at);
            let away = DVec3::new(x, height, z) - self.origin;
            let [f, g] = self.planes.map(|plane| plane.dot(away));
            let t = away.dot(self.direction) / self.direction.length_squared();
            let rounding = 0.5 * f64::from(f32::EPSILON) * away.length() + finest;
            if f.abs() + g.abs() <= tolerance.max(rounding) {
                return Some(Root { t, cell, place, slope });
            }
            if step == MAX_ITER {
                break;
            }
            *iterations += 1;
            let [width, depth] = self.lattice.width;
            let (along_u, along_v) =
                (DVec3::new(width, slope[0] * width, 0.0), DVec3::new(0.0, slope[1] * depth, depth));
            let [fu, gu] = self.planes.map(|plane| plane.dot(along_u));
            let [fv, gv] = self.planes.map(|plane| plane.dot(along_v));
            let determinant = fu * gv - fv * gu;
            if determinant.abs() <= 4.0 * f64::EPSILON * ((fu * gv).abs() + (fv * gu).abs()) {
                for axis in &mut at {
                    random = scramble(random);
                    *axis += JITTER_TOLERANCE * (random as f64 / u64::MAX as f64 * 2.0 - 1.0);
                }
                continue;
            }
            at[0] -= (f * gv - g * fv) / determinant;
            at[1] -= (g * fu - f * gu) / determinant;
        }
        None
    }

    /// The cell and the place in it for a guess. One over null control points, or off the surface, is moved to the nearest
    /// patch among its neighbours; where there is none, no hit is assumed near it.
    fn out_of_empty_regions(&self, mut at: [f64; 2]) -> Option<([usize; 2], [f64; 2])> {
        if !at.iter().all(|place| place.is_finite()) {
            return None;
        }
        let mut cell = [0; 2];
        for axis in 0..2 {
            at[axis] = at[axis].clamp(self.lattice.domain[0][axis], self.lattice.domain[1][axis]);
            cell[axis] = (at[axis] as usize).min(self.lattice.cells[axis] - 1);
        }
        let within = |cell: [usize; 2]| [0, 1].map(|axis| (at[axis] - cell[axis] as f64).clamp(0.0, 1.0));
        if self.lattice.exists(cell[0], cell[1]) {
            return Some((cell, within(cell)));
        }
        let near = |axis: usize| cell[axis].saturating_sub(1)..(cell[axis] + 2).min(self.lattice.cells[axis]);
        let neighbours = near(1).flat_map(|j| near(0).map(move |i| [i, j])).filter(|&[i, j]| self.lattice.exists(i, j));
        let distance = |cell: [usize; 2]| {
            let place = within(cell);
            (0..2).map(|axis| (cell[axis] as f64 + place[axis] - at[axis]).powi(2)).sum::<f64>()
        };
        let nearest = neighbours.min_by(|&a, &b| distance(a).total_cmp(&distance(b)))?;
        Some((nearest, within(nearest)))
    }
}
