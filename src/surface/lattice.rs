//! Control heights of a uniform B-spline over a map of columns, with the phantom edge, in the scene's local frame.
//!
//! On a uniform grid x(u) and z(v) are exactly linear, so the surface is a height function and a *patch* is a cell of a
//! regular grid. For order 3 a cell is one column's footprint; for orders 2 and 4 it lies between four column centres,
//! and the cells at the edge are cut in half by the domain.

/// Why a lattice cannot be built.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum LatticeError {
    /// Orders other than 2, 3, 4.
    #[error("surface.order is {0}; expected 2, 3 or 4")]
    Order(u32),
    /// A height that single precision cannot hold.
    #[error("column ({x}, {z}) has the height {height} m above the scene origin; expected less than 1e18 m")]
    Height {
        /// Column along x.
        x: usize,
        /// Column along z.
        z: usize,
        /// Height in the local frame.
        height: f64,
    },
    /// Too many columns for 32-bit patch numbers.
    #[error("{nx} x {nz} columns; expected at most 2^30 patches")]
    Columns {
        /// Columns along x.
        nx: usize,
        /// Columns along z.
        nz: usize,
    },
}

/// A map of control heights, padded by the phantom edge.
#[derive(Clone, Debug)]
pub struct Lattice {
    /// 2, 3 or 4.
    pub order: usize,
    /// Cells (patches) along x and z.
    pub cells: [usize; 2],
    /// Local x, z of cell coordinate 0 (m).
    pub corner: [f64; 2],
    /// Width of a cell along x and z (m).
    pub width: [f64; 2],
    /// Least and greatest cell coordinate of the domain, x and z.
    pub domain: [[f64; 2]; 2],
    /// Heights (m), row by row: the window of cell (i, j) starts at `j * stride + i` and is order x order.
    pub heights: Vec<f32>,
    /// Heights per row.
    pub stride: usize,
    /// Least and greatest control height (m): the whole surface lies between.
    pub extent: [f64; 2],
    /// One bit per cell: whether its patch exists.
    exists: Vec<u64>,
}

impl Lattice {
    /// From control heights `height[z * nx + x]` (m, local frame) over column centres.
    ///
    /// *Shape:* `first_center` is the local x, z of the centre of column (0, 0); `present` tells for each column
    /// whether a patch that leans on it exists (wet columns of the water, all of the bed).
    /// *Errors:* see [`LatticeError`].
    pub fn new(
        order: u32,
        size: [usize; 2],
        first_center: [f64; 2],
        width: [f64; 2],
        height: &[f64],
        present: impl Fn(usize) -> bool,
    ) -> Result<Self, LatticeError> {
        if !(2..=4).contains(&order) {
            return Err(LatticeError::Order(order));
        }
        let order = order as usize;
        let [nx, nz] = size;
        if nx.saturating_add(8).saturating_mul(nz.saturating_add(8)) > 1 << 30 {
            return Err(LatticeError::Columns { nx, nz });
        }
        for (index, &height) in height.iter().enumerate() {
            // Squares and products of four heights stay finite below this.
            if !height.is_finite() || height.abs() >= 1e18 {
                return Err(LatticeError::Height { x: index % nx, z: index / nx, height });
            }
        }
        // Order 3: cells are footprints, window i-1..=i+1. Orders 2 and 4: cells lie between centres, one more of them.
        let odd = order == 3;
        let cells = [nx, nz].map(|n| if odd { n } else { n + 1 });
        let pad = order / 2;
        let stride = cells[0] + order - 1;
        let rows = cells[1] + order - 1;
        let mut heights = Vec::with_capacity(stride * rows);
        for row in 0..rows {
            let z = row.saturating_sub(pad).min(nz - 1);
            let line = &height[z * nx..(z + 1) * nx];
            heights.extend((0..stride).map(|column| line[column.saturating_sub(pad).min(nx - 1)] as f32));
        }
        let extent = heights.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], &height| {
            [low.min(f64::from(height)), high.max(f64::from(height))]
        });
        let lead = if odd { 0.5 } else { 1.0 };
        let corner = [first_center[0] - lead * width[0], first_center[1] - lead * width[1]];
        let margin = lead - 0.5;
        let domain = [[margin, margin], [margin + nx as f64, margin + nz as f64]];
        let mut lattice = Self { order, cells, corner, width, domain, heights, stride, extent, exists: Vec::new() };
        lattice.exists = lattice.mark(size, pad, present);
        Ok(lattice)
    }

    /// A bit per cell whose window holds a present column.
    fn mark(&self, [nx, nz]: [usize; 2], pad: usize, present: impl Fn(usize) -> bool) -> Vec<u64> {
        let [cx, cz] = self.cells;
        // Counts along x of the last `order` columns, then the same along z: two passes instead of order^2 looks.
        let near_x: Vec<bool> = (0..nz)
            .flat_map(|z| {
                let present = &present;
                (0..cx).map(move |i| {
                    (i..i + self.order).any(|column| present(z * nx + column.saturating_sub(pad).min(nx - 1)))
                })
            })
            .collect();
        let mut bits = vec![0u64; (cx * cz).div_ceil(64)];
        for j in 0..cz {
            for i in 0..cx {
                if (j..j + self.order).any(|row| near_x[row.saturating_sub(pad).min(nz - 1) * cx + i]) {
                    let patch = j * cx + i;
                    bits[patch / 64] |= 1 << (patch % 64);
                }
            }
        }
        bits
    }

    /// Whether the patch of cell (i, j) exists.
    pub fn exists(&self, i: usize, j: usize) -> bool {
        let patch = j * self.cells[0] + i;
        self.exists[patch / 64] >> (patch % 64) & 1 == 1
    }

    /// The cell that answers for a place: the one it lies in, or where that has no patch, one with a patch that it
    /// borders on to within single precision's rounding. So patches are closed: their borders belong to them.
    pub(super) fn closed_cell(&self, at: [f64; 2], cell: [usize; 2]) -> [usize; 2] {
        if self.exists(cell[0], cell[1]) {
            return cell;
        }
        let mut candidates = [[cell[0]; 2], [cell[1]; 2]];
        for axis in 0..2 {
            let room = f64::from(f32::EPSILON) * (at[axis].abs() + 1.0);
            let place = at[axis] - cell[axis] as f64;
            if place <= room {
                candidates[axis][1] = cell[axis].saturating_sub(1);
            } else if place >= 1.0 - room {
                candidates[axis][1] = (cell[axis] + 1).min(self.cells[axis] - 1);
            }
        }
        let neighbours = [(1, 0), (0, 1), (1, 1)].map(|(a, b)| [candidates[0][a], candidates[1][b]]);
        neighbours.into_iter().find(|&[i, j]| self.exists(i, j)).unwrap_or(cell)
    }

    /// The order x order control heights of cell (i, j): `[row along z][column along x]`, unused entries zero.
    pub fn window(&self, i: usize, j: usize) -> [[f64; 4]; 4] {
        let mut window = [[0.0; 4]; 4];
        for (b, row) in window.iter_mut().enumerate().take(self.order) {
            for (a, slot) in row.iter_mut().enumerate().take(self.order) {
                *slot = f64::from(self.heights[(j + b) * self.stride + i + a]);
            }
        }
        window
    }

    /// Cell coordinates of a local x, z.
    pub fn to_cell(&self, x: f64, z: f64) -> [f64; 2] {
        [(x - self.corner[0]) / self.width[0], (z - self.corner[1]) / self.width[1]]
    }

    /// Local x, z of cell coordinates.
    pub fn from_cell(&self, cell: [f64; 2]) -> [f64; 2] {
        [self.corner[0] + cell[0] * self.width[0], self.corner[1] + cell[1] * self.width[1]]
    }

    /// Height and slopes dy/dx, dy/dz (per metre) at cell coordinates within cell (i, j).
    pub fn evaluate(&self, i: usize, j: usize, u: f64, v: f64) -> (f64, [f64; 2]) {
        let window = self.window(i, j);
        let (bu, du) = basis(self.order, u);
        let (bv, dv) = basis(self.order, v);
        let (mut height, mut along_u, mut along_v) = (0.0, 0.0, 0.0);
        for b in 0..self.order {
            for a in 0..self.order {
                height += window[b][a] * bu[a] * bv[b];
                along_u += window[b][a] * du[a] * bv[b];
                along_v += window[b][a] * bu[a] * dv[b];
            }
        }
        (height, [along_u / self.width[0], along_v / self.width[1]])
    }
}

/// Values and derivatives of the uniform B-spline basis of an order (2, 3, 4) at u within a cell, 0..1.
///
/// *Source:* de Boor, A Practical Guide to Splines, 1978, for uniform knots.
pub fn basis(order: usize, u: f64) -> ([f64; 4], [f64; 4]) {
    let w = 1.0 - u;
    match order {
        2 => ([w, u, 0.0, 0.0], [-1.0, 1.0, 0.0, 0.0]),
        3 => ([0.5 * w * w, 0.5 + u * w, 0.5 * u * u, 0.0], [-w, w - u, u, 0.0]),
        _ => (
            [
                w * w * w / 6.0,
                2.0 / 3.0 - u * u * (1.0 - 0.5 * u),
                2.0 / 3.0 - w * w * (1.0 - 0.5 * w),
                u * u * u / 6.0,
            ],
            [-0.5 * w * w, u * (1.5 * u - 2.0), -w * (1.5 * w - 2.0), 0.5 * u * u],
        ),
    }
}

/// One row of order `order` from B-spline heights to Bézier heights over the cell.
pub fn to_bezier(order: usize, h: [f64; 4]) -> [f64; 4] {
    match order {
        2 => h,
        3 => [0.5 * (h[0] + h[1]), h[1], 0.5 * (h[1] + h[2]), 0.0],
        _ => [
            (h[0] + 4.0 * h[1] + h[2]) / 6.0,
            (2.0 * h[1] + h[2]) / 3.0,
            (h[1] + 2.0 * h[2]) / 3.0,
            (h[1] + 4.0 * h[2] + h[3]) / 6.0,
        ],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ramp(order: u32) -> Lattice {
        let height: Vec<f64> = (0..35).map(|k| 2.0 * f64::from(k % 7) + 0.5 * f64::from(k / 7)).collect();
        Lattice::new(order, [7, 5], [10.0, -5.0], [2.0, 4.0], &height, |_| true).unwrap()
    }

    #[test]
    fn basis_sums_to_one_and_its_derivative_to_zero() {
        for order in 2..=4 {
            for k in 0..=20 {
                let (value, slope) = basis(order, f64::from(k) / 20.0);
                assert!((value.iter().sum::<f64>() - 1.0).abs() < 1e-15);
                assert!(slope.iter().sum::<f64>().abs() < 1e-15);
                assert!(value.iter().all(|&b| b >= 0.0));
            }
        }
    }

    #[test]
    fn a_plane_is_reproduced_inside_for_every_order() {
        // Column (3, 2) has its centre at x = 16, z = 3 and the height 7; slopes 1 and 1/8 per metre.
        for order in 2..=4 {
            let lattice = ramp(order);
            let cell = lattice.to_cell(16.5, 2.5);
            let (i, j) = (cell[0].floor(), cell[1].floor());
            let (height, slope) = lattice.evaluate(i as usize, j as usize, cell[0] - i, cell[1] - j);
            assert!((height - (7.0 + 0.5 - 0.5 / 8.0)).abs() < 1e-12, "order {order}: {height}");
            assert!((slope[0] - 1.0).abs() < 1e-12 && (slope[1] - 0.125).abs() < 1e-12);
        }
    }

    #[test]
    fn domain_is_every_columns_whole_footprint() {
        for order in 2..=4 {
            let lattice = ramp(order);
            assert_eq!(lattice.from_cell(lattice.domain[0]), [9.0, -7.0]);
            assert_eq!(lattice.from_cell(lattice.domain[1]), [23.0, 13.0]);
        }
    }

    #[test]
    fn bezier_heights_are_the_same_curve() {
        let h = [1.0, -2.0, 4.0, 0.5];
        for order in 2..=4 {
            let bezier = to_bezier(order, h);
            for k in 0..=10 {
                let u = f64::from(k) / 10.0;
                let spline: f64 = basis(order, u).0.iter().zip(h).map(|(b, h)| b * h).sum();
                let mut row = bezier;
                for level in (1..order).rev() {
                    for a in 0..level {
                        row[a] += u * (row[a + 1] - row[a]);
                    }
                }
                assert!((row[0] - spline).abs() < 1e-14);
            }
        }
    }

    #[test]
    fn patches_exist_only_near_present_columns() {
        let lattice = Lattice::new(3, [9, 9], [0.0; 2], [1.0; 2], &[0.0; 81], |index| index == 4 * 9 + 4).unwrap();
        let count = (0..81).filter(|&k| lattice.exists(k % 9, k / 9)).count();
        assert_eq!(count, 9);
        assert!(lattice.exists(3, 5) && !lattice.exists(2, 4));
    }

    #[test]
    fn refusals_name_the_column() {
        let mut heights = vec![0.0; 9];
        heights[5] = 1e19;
        let error = Lattice::new(3, [3, 3], [0.0; 2], [1.0; 2], &heights, |_| true).unwrap_err();
        assert_eq!(error, LatticeError::Height { x: 2, z: 1, height: 1e19 });
        assert_eq!(
            Lattice::new(5, [3, 3], [0.0; 2], [1.0; 2], &[0.0; 9], |_| true).unwrap_err(),
            LatticeError::Order(5)
        );
    }
}
