//! Regions of a scene → columns: those whose centres lie in every shape that the region names.

use crate::scene::{Body, Edge, PressedRegion, Sink, Source};

use super::{Grid, SimError};

/// The shapes of one region, and the key that it was written under.
#[derive(Clone, Debug)]
pub(super) struct Region {
    pub(super) key: String,
    rectangle: Option<[f64; 4]>,
    circle: Option<[f64; 3]>,
    edge: Option<Edge>,
}

macro_rules! region_of {
    ($($table:ty, $name:literal;)*) => {$(
        impl From<(usize, &$table)> for Region {
            fn from((index, table): (usize, &$table)) -> Self {
                let key = format!("simulation.{}.{index}", $name);
                Self { key, rectangle: table.rectangle, circle: table.circle, edge: table.edge }
            }
        }
    )*};
}
region_of! { Body, "water.body"; Source, "source"; Sink, "sink"; PressedRegion, "pressure"; }

impl Region {
    /// The region's columns, in rising order.
    ///
    /// A shape's border belongs to it. An edge is its side's outermost row of columns.
    ///
    /// # Errors
    /// A region without a shape, or one that no column's centre lies in.
    pub(super) fn columns(&self, grid: &Grid) -> Result<Vec<usize>, SimError> {
        if self.rectangle.is_none() && self.circle.is_none() && self.edge.is_none() {
            return Err(self.wrong("a region without a shape", "rectangle, circle or edge"));
        }
        // Each axis by itself first: a small region on a large map costs little.
        let axis = |axis: usize, count: usize, low: Edge, high: Edge| -> Vec<usize> {
            let within = |&index: &usize| {
                let centre = grid.origin[axis] + index as f64 * grid.width[axis];
                let rectangle = self.rectangle.is_none_or(|corners| {
                    let (a, b) = (corners[axis], corners[axis + 2]);
                    (a.min(b)..=a.max(b)).contains(&centre)
                });
                let circle = self.circle.is_none_or(|circle| (centre - circle[axis]).abs() <= circle[2]);
                let low = self.edge != Some(low) || index == 0;
                let high = self.edge != Some(high) || index + 1 == count;
                rectangle && circle && low && high
            };
            (0..count).filter(within).collect()
        };
        let xs = axis(0, grid.nx, Edge::West, Edge::East);
        let zs = axis(1, grid.nz, Edge::North, Edge::South);
        let in_circle = |column: &usize| {
            self.circle.is_none_or(|[x, z, radius]| {
                let [cx, cz] = grid.centre(*column);
                (cx - x).powi(2) + (cz - z).powi(2) <= radius * radius
            })
        };
        let columns = zs.iter().flat_map(|z| xs.iter().map(move |x| z * grid.nx + x));
        let columns: Vec<usize> = columns.filter(in_circle).collect();
        if columns.is_empty() {
            let ([x0, z0], [x1, z1]) = (grid.centre(0), grid.centre(grid.count() - 1));
            let expected = format!("at least one column's centre in it; they lie in x {x0} to {x1}, z {z0} to {z1}");
            return Err(self.wrong(format!("no column lies in {}", self.shown()), expected));
        }
        Ok(columns)
    }

    /// An error about this region.
    pub(super) fn wrong(&self, found: impl Into<String>, expected: impl Into<String>) -> SimError {
        SimError::Setting { key: self.key.clone(), found: found.into(), expected: expected.into() }
    }

    fn shown(&self) -> String {
        let rectangle = self.rectangle.map(|rectangle| format!("rectangle {rectangle:?}"));
        let circle = self.circle.map(|circle| format!("circle {circle:?}"));
        let edge = self.edge.map(|edge| format!("edge {edge:?}").to_lowercase());
        [rectangle, circle, edge].into_iter().flatten().collect::<Vec<_>>().join(" and ")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GRID: Grid = Grid { nx: 5, nz: 4, width: [1.0, 2.0], origin: [10.0, 0.0] };

    fn region(rectangle: Option<[f64; 4]>, circle: Option<[f64; 3]>, edge: Option<Edge>) -> Region {
        Region::from((3, &Sink { rectangle, circle, edge, ..Sink::default() }))
    }

    fn columns(rectangle: Option<[f64; 4]>, circle: Option<[f64; 3]>, edge: Option<Edge>) -> Vec<usize> {
        region(rectangle, circle, edge).columns(&GRID).unwrap()
    }

    #[test]
    fn columns_lie_in_every_shape_that_is_given() {
        assert_eq!(columns(Some([11.0, 2.0, 12.0, 4.0]), None, None), [6, 7, 11, 12]);
        // Any two opposite corners.
        assert_eq!(columns(Some([12.4, 4.9, 10.6, 1.1]), None, None), [6, 7, 11, 12]);
        assert_eq!(columns(None, Some([12.0, 2.0, 1.0]), None), [6, 7, 8]);
        assert_eq!(columns(None, Some([12.0, 2.0, 2.0]), None), [2, 5, 6, 7, 8, 9, 12]);
        assert_eq!(columns(None, None, Some(Edge::North)), [0, 1, 2, 3, 4]);
        assert_eq!(columns(None, None, Some(Edge::East)), [4, 9, 14, 19]);
        assert_eq!(columns(None, None, Some(Edge::South)), [15, 16, 17, 18, 19]);
        assert_eq!(columns(None, None, Some(Edge::West)), [0, 5, 10, 15]);
        assert_eq!(columns(Some([0.0, 1.0, 99.0, 5.0]), Some([10.0, 0.0, 3.0]), Some(Edge::West)), [5]);
    }

    #[test]
    fn a_region_without_columns_names_its_key_and_where_columns_are() {
        let error = region(Some([0.0, 0.0, 9.9, 9.0]), None, Some(Edge::West)).columns(&GRID).unwrap_err().to_string();
        for word in ["simulation.sink.3", "rectangle [0.0, 0.0, 9.9, 9.0] and edge west", "x 10 to 14, z 0 to 6"] {
            assert!(error.contains(word), "{error}");
        }
        let error = region(None, None, None).columns(&GRID).unwrap_err().to_string();
        assert!(error.contains("without a shape"), "{error}");
    }
}
