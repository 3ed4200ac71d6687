//! Single steps of the solvers, by themselves, for benchmarks: nothing here is asked by a renderer.

use super::lattice::Lattice;
use super::solve::{Segment, lane_polynomial};
use crate::simd::{Kernel, Simd, SimdLevel, dispatch};

/// Rays against one patch each: the windows' cells and both ends of every stretch.
#[derive(Clone, Debug, Default)]
pub struct Stretches {
    /// Cell of the patch.
    pub cell: Vec<[usize; 2]>,
    /// u and v (0..1 within the cell) and the ray's height (m), at the start.
    pub start: Vec<[f32; 3]>,
    /// The same at the end.
    pub end: Vec<[f32; 3]>,
}

struct Polynomials<'a> {
    lattice: &'a Lattice,
    stretches: &'a Stretches,
}

impl Polynomials<'_> {
    #[inline(always)]
    fn of_order<S: Simd, const K: usize, const D: usize>(&self, simd: S) -> f32 {
        let Stretches { cell, start, end } = self.stretches;
        let mut sum = simd.splat(0.0);
        for first in (0..cell.len() / S::LANES).map(|packet| packet * S::LANES) {
            let end_of = |ends: &[[f32; 3]], axis: usize| {
                let mut lanes = [0.0; 16];
                for lane in 0..S::LANES {
                    lanes[lane] = ends[first + lane][axis];
                }
                simd.load(&lanes)
            };
            let mut window = [[simd.splat(0.0); K]; K];
            for b in 0..K {
                for a in 0..K {
                    let mut lanes = [0.0; 16];
                    for lane in 0..S::LANES {
                        let [i, j] = cell[first + lane];
                        lanes[lane] = self.lattice.heights[(j + b) * self.lattice.stride + i + a];
                    }
                    window[b][a] = simd.load(&lanes);
                }
            }
            let one = simd.splat(1.0);
            let segment = Segment::<S, K> {
                window,
                u: [end_of(start, 0), end_of(end, 0)],
                v: [end_of(start, 1), end_of(end, 1)],
                y: [end_of(start, 2), end_of(end, 2)],
                above: one,
                length: one,
                tolerance: one,
                mask: simd.from_bits(u32::MAX),
            };
            for coefficient in lane_polynomial::<S, K, D>(simd, &segment) {
                sum = sum + coefficient;
            }
        }
        let mut lanes = [0.0; 16];
        simd.store(sum, &mut lanes);
        lanes.iter().sum()
    }
}

impl Kernel for Polynomials<'_> {
    type Output = f32;
    #[inline(always)]
    fn run<S: Simd>(self, simd: S) -> f32 {
        match self.lattice.order {
            2 => self.of_order::<S, 2, 2>(simd),
            3 => self.of_order::<S, 3, 4>(simd),
            _ => self.of_order::<S, 4, 6>(simd),
        }
    }
}

/// Makes the polynomial of height above the surface along every stretch, in whole packets; the sum of all coefficients.
pub fn polynomials(lattice: &Lattice, stretches: &Stretches, simd: SimdLevel) -> f32 {
    dispatch(simd, Polynomials { lattice, stretches })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plane_under_a_level_ray_is_one_number_at_every_width_and_order() {
        for order in 2..=4u32 {
            let lattice = Lattice::new(order, [4, 4], [0.5; 2], [1.0; 2], &[0.5; 16], |_| true).unwrap();
            let stretches = Stretches {
                cell: (0..16).map(|k| [k % 4, k / 4]).collect(),
                start: vec![[0.0, 0.25, 2.0]; 16],
                end: vec![[1.0, 0.75, 2.0]; 16],
            };
            for simd in SimdLevel::ALL {
                // 1.5 above everywhere: each of 2 (order - 1) + 1 coefficients, of 16 rays.
                let expected = 1.5 * (2 * (order - 1) + 1) as f32 * 16.0;
                let sum = polynomials(&lattice, &stretches, simd);
                assert!((sum - expected).abs() < 1e-3, "order {order}, {}: {sum}", simd.name());
            }
        }
    }
}
