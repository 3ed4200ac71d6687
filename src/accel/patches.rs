//! Embree's own ways to hold a smooth surface, for benchmarks: a grid of samples, and Catmull-Clark subdivision.
//!
//! Both answer as parts of number 0 and serve no scene: a renderer that wants triangles has `surface.representation`.

use std::time::Instant;

use glam::Vec3;

use super::{AccelError, EmbreeAccel};
use crate::ffi::embree::{Device, EmbreeError, SceneBuilder};
use crate::surface::SplineSurface;

impl EmbreeAccel {
    /// The surface's samples, `samples` x `samples` quadrilaterals per cell, as one Embree GRID.
    ///
    /// Every cell is taken to exist.
    ///
    /// # Errors
    /// More than 32,767 vertices along a side, Embree is missing, or memory ran out.
    pub fn grid(surface: &SplineSurface, samples: u32) -> Result<Self, AccelError> {
        let lattice = surface.lattice();
        let n = samples.max(1) as usize;
        let place = |axis: usize, k: usize| {
            let cell = (k / n).min(lattice.cells[axis] - 1);
            let at = (k as f64 / n as f64).clamp(lattice.domain[0][axis], lattice.domain[1][axis]);
            (cell, (at - cell as f64) as f32)
        };
        let size = lattice.cells.map(|cells| cells * n + 1);
        let mut position = Vec::with_capacity(size[0] * size[1]);
        for b in 0..size[1] {
            let (j, v) = place(1, b);
            for a in 0..size[0] {
                let (i, u) = place(0, a);
                position.push(surface.patch_point((j * lattice.cells[0] + i) as u32, u, v).position);
            }
        }
        Self::build(|builder| builder.grid(0, &position, size.map(|side| side as u32)))
    }

    /// The control heights as a Catmull-Clark surface, cut `level` times along each edge. The limit is the lattice's own
    /// surface for order 4, and another one for orders 2 and 3.
    ///
    /// # Errors
    /// As [`Self::grid`].
    pub fn subdivision(surface: &SplineSurface, level: u32) -> Result<Self, AccelError> {
        let lattice = surface.lattice();
        let rows = lattice.heights.len() / lattice.stride;
        // Control point (a, b) lies above cell coordinates a - lead, b - lead.
        let lead = lattice.order as f64 / 2.0 - 1.0;
        let position: Vec<Vec3> = (0..lattice.heights.len())
            .map(|k| {
                let cell = [k % lattice.stride, k / lattice.stride].map(|index| index as f64 - lead);
                let [x, z] = lattice.from_cell(cell);
                Vec3::new(x as f32, lattice.heights[k], z as f32)
            })
            .collect();
        Self::build(|builder| builder.subdivision(0, &position, [lattice.stride as u32, rows as u32], level as f32))
    }

    fn build(
        add: impl FnOnce(&mut SceneBuilder<super::lanes::LanePayload>) -> Result<(), EmbreeError>,
    ) -> Result<Self, AccelError> {
        let start = Instant::now();
        let device = Device::new(rayon::current_num_threads(), "")?;
        let mut builder = SceneBuilder::new(&device)?;
        add(&mut builder)?;
        Ok(Self::committed(builder.commit()?, device, start))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accel::{Accelerator, HitBatch, NO_PART, RayBatch};
    use crate::scene::SolverKind;
    use crate::surface::{Lattice, SimdLevel, SolveCounts};

    /// Largest |dt| of rays straight down and aslant, and how many missed.
    fn error(accel: &EmbreeAccel, surface: &SplineSurface) -> f32 {
        let mut rays = RayBatch::default();
        for k in 0..400 {
            let (x, z) = (0.6 + (k % 20) as f32 * 0.53, 0.6 + (k / 20) as f32 * 0.53);
            rays.push(Vec3::new(x, 9.0, z), Vec3::NEG_Y, 0.0, f32::INFINITY, 1e-6);
        }
        let mut hits = HitBatch::default();
        accel.closest(&rays, &mut hits, &mut SolveCounts::default());
        (0..rays.len())
            .map(|index| {
                assert_ne!(hits.part[index], NO_PART, "ray {index}");
                let height = surface.height(rays.origin[0][index], rays.origin[2][index]).unwrap();
                (9.0 - hits.t[index] - height).abs()
            })
            .fold(0.0, f32::max)
    }

    fn surface(order: u32) -> SplineSurface {
        let heights: Vec<f64> = (0..144).map(|k| (f64::from(k) * 1.3).sin()).collect();
        let lattice = Lattice::new(order, [12, 12], [0.5; 2], [1.0; 2], &heights, |_| true).unwrap();
        SplineSurface::new(lattice, SolverKind::Univariate, SimdLevel::Portable)
    }

    #[test]
    fn finer_grids_come_nearer_to_every_spline() {
        for order in 2..=4 {
            let surface = surface(order);
            let [coarse, fine] = [2, 16].map(|samples| error(&EmbreeAccel::grid(&surface, samples).unwrap(), &surface));
            assert!(fine < 5e-3 && fine < 0.1 * coarse, "order {order}: {coarse} {fine}");
        }
    }

    #[test]
    fn subdivision_is_the_bicubic_spline() {
        let surface = surface(4);
        let [coarse, fine] = [2, 16].map(|level| error(&EmbreeAccel::subdivision(&surface, level).unwrap(), &surface));
        assert!(fine < 5e-3 && fine < 0.1 * coarse, "{coarse} {fine}");
    }
}
