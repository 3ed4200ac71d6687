//! Where the columns stand: one rectangle of equal columns, index `z * nx + x` as in the files.

/// A map of columns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grid {
    /// Columns along x.
    pub nx: usize,
    /// Columns along z.
    pub nz: usize,
    /// Width of a column along x and z (m).
    pub width: [f64; 2],
    /// x, z of the centre of column (0, 0) (m).
    pub origin: [f64; 2],
}

impl Grid {
    /// How many columns there are.
    pub fn count(&self) -> usize {
        self.nx * self.nz
    }

    /// Footprint of one column (m2).
    pub fn area(&self) -> f64 {
        self.width[0] * self.width[1]
    }

    /// x, z of a column's centre (m).
    pub fn centre(&self, column: usize) -> [f64; 2] {
        let (x, z) = (column % self.nx, column / self.nx);
        [self.origin[0] + x as f64 * self.width[0], self.origin[1] + z as f64 * self.width[1]]
    }

    /// The column whose footprint holds a point; a border belongs to the column at its greater side. `None` outside the map.
    pub fn column_at(&self, point: [f64; 2]) -> Option<usize> {
        let place = |axis: usize, count: usize| {
            let place = ((point[axis] - self.origin[axis]) / self.width[axis] + 0.5).floor();
            (place >= 0.0 && place < count as f64).then_some(place as usize)
        };
        Some(place(1, self.nz)? * self.nx + place(0, self.nx)?)
    }

    /// Least and greatest x and z of the whole map (m).
    pub fn extent(&self) -> [[f64; 2]; 2] {
        let low = [0, 1].map(|axis| self.origin[axis] - 0.5 * self.width[axis]);
        [low, [low[0] + self.nx as f64 * self.width[0], low[1] + self.nz as f64 * self.width[1]]]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_column_holds_its_centre_and_its_lesser_borders() {
        let grid = Grid { nx: 4, nz: 3, width: [0.5, 2.0], origin: [-3.0, 10.0] };
        for column in 0..grid.count() {
            let [x, z] = grid.centre(column);
            assert_eq!(grid.column_at([x, z]), Some(column));
            assert_eq!(grid.column_at([x - 0.25, z - 1.0]), Some(column));
        }
        assert_eq!(grid.extent(), [[-3.25, 9.0], [-1.25, 15.0]]);
        for outside in [[-3.26, 10.0], [-1.25, 10.0], [-2.0, 8.9], [-2.0, 15.0], [f64::NAN, 10.0]] {
            assert_eq!(grid.column_at(outside), None);
        }
        assert_eq!((grid.count(), grid.area()), (12, 1.0));
    }
}
