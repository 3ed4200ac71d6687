//! Where columns and pipes lie in memory, and how wide a pipe is.
//!
//! Working fields carry a margin (two dry columns at both ends of a row, one row before the first, two behind the last)
//! whose base is higher than any water: walls then need no branch. Pipes of one row lie together, its four families one
//! after another. Nothing here moves water.

use crate::sim::Grid;
use rayon::prelude::*;

/// Families of pipes: towards the neighbour at the east, south, south-east and south-west of the owner.
pub(super) const FAMILIES: usize = 4;

/// Columns and rows from a pipe's owner to its other end, by family.
pub(super) const OFFSETS: [[isize; 2]; FAMILIES] = [[1, 0], [0, 1], [1, 1], [-1, 1]];

/// Dry columns at each end of a row: a pipe's neighbours reach two columns from its owner.
pub(super) const MARGIN: usize = 2;

/// Height (m) of the base outside the map: greater than any water, small enough for its square to be finite.
pub(super) const WALL: f64 = 1e150;

/// Density of water (kg/m3).
pub(super) const DENSITY: f64 = 1000.0;

/// Sizes that follow from the map alone.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Layout {
    /// Columns along x and z, without margin.
    pub nx: usize,
    /// Rows, without margin.
    pub nz: usize,
    /// Columns of a row with its margins.
    pub stride: usize,
    /// Rows with margins, one before and two behind.
    pub rows: usize,
    /// Footprint of a column (m2).
    pub area: f64,
    /// Length of a pipe by family (m).
    pub length: [f64; FAMILIES],
    /// Cross-section of a pipe for each metre of its height (m), away from the map's walls.
    pub section: [f64; FAMILIES],
    /// The same for every pipe of a row, one family after another, by how many of the map's walls the row lies along.
    sections: [Vec<f64>; 3],
    /// Cosines of the angle between a pipe and the x and z axes.
    pub direction: [[f64; 2]; FAMILIES],
}

impl Layout {
    /// Sections are such that waves run at sqrt(g h) along every direction: with conductance k = section / length,
    /// k_x + 2 k_d = dz / dx and k_z + 2 k_d = dx / dz. The diagonal share is then free; a sixth of the lesser of the two
    /// makes the pipes of square columns the nine-point Laplacian, whose leading error is the same in every direction
    /// (Patra and Karttunen, Stencils with isotropic discretization error for differential operators, 2006).
    pub(super) fn new(grid: &Grid) -> Self {
        let [dx, dz] = grid.width;
        let diagonal = (dz / dx).min(dx / dz) / 6.0;
        let conductance = [dz / dx - 2.0 * diagonal, dx / dz - 2.0 * diagonal, diagonal, diagonal];
        let across = (dx * dx + dz * dz).sqrt();
        let length = [dx, dz, across, across];
        let section = [0, 1, 2, 3].map(|family| conductance[family] * length[family]);
        let stride = grid.nx + 2 * MARGIN;
        // A wall is a mirror. The diagonal pipe that would lead through it leads to the image of the column that the axial
        // pipe along the wall leads to, so that pipe takes its share; without this, water would run slower along the walls.
        let sections = [0, 1, 2].map(|walls| {
            let mut sections = vec![0.0; FAMILIES * stride];
            for x in 0..grid.nx {
                let ends = usize::from(x == 0) + usize::from(x + 1 == grid.nx);
                for family in 0..FAMILIES {
                    let beside = [walls, ends, 0, 0][family] as f64 * diagonal * length[family];
                    sections[family * stride + MARGIN + x] = section[family] + beside;
                }
            }
            sections
        });
        Self {
            nx: grid.nx,
            nz: grid.nz,
            stride,
            rows: grid.nz + 3,
            area: grid.area(),
            length,
            section,
            sections,
            direction: [[1.0, 0.0], [0.0, 1.0], [dx / across, dz / across], [-dx / across, dz / across]],
        }
    }

    /// Cross-sections (m for each metre of height) of the pipes of a row, counted with the margin.
    #[inline(always)]
    pub(super) fn sections(&self, row: usize) -> &[f64] {
        &self.sections[usize::from(row == 1) + usize::from(row == self.nz)]
    }

    /// Place of column (x, z) in a field with margins.
    pub(super) fn padded(&self, x: usize, z: usize) -> usize {
        (z + 1) * self.stride + MARGIN + x
    }

    /// Place of column `z * nx + x` in a field with margins.
    pub(super) fn padded_index(&self, column: usize) -> usize {
        self.padded(column % self.nx, column / self.nx)
    }

    /// Values of a field with margins.
    pub(super) fn padded_count(&self) -> usize {
        self.stride * self.rows
    }

    /// Place of the pipe of a family that belongs to the column at `padded`.
    pub(super) fn pipe(&self, padded: usize, family: usize) -> usize {
        (padded / self.stride * FAMILIES + family) * self.stride + padded % self.stride
    }

    /// `padded` moved by whole columns and rows.
    pub(super) fn moved(&self, padded: usize, [x, z]: [isize; 2]) -> usize {
        padded.wrapping_add_signed(z * self.stride as isize + x)
    }
}

/// `width` values of a row of columns with margins, `shift` columns from `x` (both without margin).
#[inline(always)]
pub(super) fn columns(field: &[f64], stride: usize, row: usize, x: usize, shift: isize, width: usize) -> &[f64] {
    &field[(row * stride + MARGIN + x).wrapping_add_signed(shift)..][..width]
}

/// `width` values of one family of a row of pipes.
#[inline(always)]
pub(super) fn pipes(
    field: &[f64],
    stride: usize,
    row: usize,
    family: usize,
    x: usize,
    shift: isize,
    width: usize,
) -> &[f64] {
    &field[((row * FAMILIES + family) * stride + MARGIN + x).wrapping_add_signed(shift)..][..width]
}

/// What the pipes hold, each field as long as all pipes.
#[derive(Clone, Debug)]
pub(super) struct Pipes {
    /// Velocity (m/s), positive away from the owner.
    pub eta: Vec<f64>,
    /// Volume (m3) that the last step moved.
    pub moved: Vec<f64>,
}

/// One row of [`Pipes`], to be written.
pub(super) struct PipeRow<'a> {
    pub eta: &'a mut [f64],
    pub moved: &'a mut [f64],
}

impl Pipes {
    /// Still ones.
    pub(super) fn new(layout: &Layout) -> Self {
        let still = vec![0.0; layout.padded_count() * FAMILIES];
        Self { eta: still.clone(), moved: still }
    }

    /// Calls `work` with each row's number (counted with the margin) and its pipes, in parallel if asked: every row has its
    /// own output, so the bits do not depend on who makes it.
    pub(super) fn each_row(&mut self, layout: &Layout, parallel: bool, work: impl Fn(usize, PipeRow) + Sync + Send) {
        let chunk = FAMILIES * layout.stride;
        let inner = chunk..chunk * (layout.nz + 1);
        let (eta, moved) = (&mut self.eta[inner.clone()], &mut self.moved[inner]);
        if parallel {
            let rows = eta.par_chunks_mut(chunk).zip(moved.par_chunks_mut(chunk));
            rows.enumerate().for_each(|(z, (eta, moved))| work(z + 1, PipeRow { eta, moved }));
        } else {
            let rows = eta.chunks_mut(chunk).zip(moved.chunks_mut(chunk));
            rows.enumerate().for_each(|(z, (eta, moved))| work(z + 1, PipeRow { eta, moved }));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sections_give_the_same_wave_speed_in_every_direction() {
        for width in [[1.0, 1.0], [0.25, 0.25], [1.0, 2.0], [3.0, 0.5]] {
            let layout = Layout::new(&Grid { nx: 4, nz: 4, width, origin: [0.0; 2] });
            // Sum of section * length * (e . n)^2 over the four families must be the footprint for every n: the flow
            // through the pipes of a plane slope is then the flow down that slope.
            for angle in 0..16 {
                let normal = (f64::from(angle) * 0.2).sin_cos();
                let sum: f64 = (0..FAMILIES)
                    .map(|family| {
                        let [x, z] = layout.direction[family];
                        layout.section[family] * layout.length[family] * (x * normal.0 + z * normal.1).powi(2)
                    })
                    .sum();
                assert!((sum / layout.area - 1.0).abs() < 1e-14, "{width:?} {angle}: {sum}");
            }
        }
        let square = Layout::new(&Grid { nx: 4, nz: 4, width: [0.5; 2], origin: [0.0; 2] });
        let [axial, _, diagonal, _] = square.section;
        assert!((axial + 2f64.sqrt() * diagonal - 0.5).abs() < 1e-15);
    }

    #[test]
    fn places_agree_between_columns_and_pipes() {
        let layout = Layout::new(&Grid { nx: 5, nz: 3, width: [1.0; 2], origin: [0.0; 2] });
        let mut field = vec![0.0; layout.padded_count() * FAMILIES];
        let owner = layout.padded(3, 1);
        assert_eq!(layout.padded_index(8), owner);
        field[layout.pipe(owner, 2)] = 1.0;
        assert_eq!(pipes(&field, layout.stride, 2, 2, 0, 0, 5), [0.0, 0.0, 0.0, 1.0, 0.0]);
        assert_eq!(pipes(&field, layout.stride, 2, 2, 1, 2, 2), [1.0, 0.0]);
        assert_eq!(layout.moved(owner, [-1, 1]), layout.padded(2, 2));
    }
}
