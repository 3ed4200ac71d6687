//! Where the water stands: for every place the level of the nearest water, and the depth there.
//!
//! Made once per frame from the columns; asked per shading point by one bilinear look.

use glam::DVec3;
use rayon::prelude::*;

use crate::state;

/// Passes of smoothing over dry columns: enough to wear off the creases where two waters are equally near.
const SMOOTHING: usize = 12;

/// Levels and depths over the columns' centres, in the local frame.
#[derive(Clone, Debug)]
pub struct Waterline {
    grid: Grid,
    /// Height of the nearest water (local m), by column; empty when no column is wet.
    level: Vec<f32>,
    /// Metres of water in the column.
    depth: Vec<f32>,
}

impl Waterline {
    /// From a frame's columns; those with less than `dry_threshold` metres of water are dry.
    pub fn build(columns: &state::Columns, dry_threshold: f64, origin: DVec3) -> Self {
        let (nx, nz) = (columns.nx, columns.nz);
        let grid = Grid::new(columns, origin);
        let wet: Vec<bool> =
            columns.top.iter().zip(&columns.base).map(|(top, base)| top - base >= dry_threshold).collect();
        let depth =
            (0..nx * nz).map(|i| if wet[i] { (columns.top[i] - columns.base[i]) as f32 } else { 0.0 }).collect();
        let Some(nearest) = nearest_wet(&wet, nx, nz, columns.width) else {
            return Self { grid, level: Vec::new(), depth };
        };
        let mut level: Vec<f32> = nearest.iter().map(|&from| (columns.top[from as usize] - origin.y) as f32).collect();
        let mut smooth = level.clone();
        for _ in 0..SMOOTHING {
            smooth.par_chunks_mut(nx).enumerate().for_each(|(z, row)| {
                for (x, out) in row.iter_mut().enumerate() {
                    if !wet[z * nx + x] {
                        let (left, right) = (x.saturating_sub(1), (x + 1).min(nx - 1));
                        let (north, south) = (z.saturating_sub(1), (z + 1).min(nz - 1));
                        *out = 0.25
                            * (level[z * nx + left]
                                + level[z * nx + right]
                                + level[north * nx + x]
                                + level[south * nx + x]);
                    }
                }
            });
            std::mem::swap(&mut level, &mut smooth);
        }
        Self { grid, level, depth }
    }

    /// Height (local m) of the nearest water at a local place; `None` when there is none anywhere.
    #[inline]
    pub fn level(&self, x: f32, z: f32) -> Option<f32> {
        (!self.level.is_empty()).then(|| self.grid.at(&self.level, x, z))
    }

    /// Metres that a local point stands above (+) or below (-) the nearest water; +inf when there is none.
    #[inline]
    pub fn height_above(&self, position: glam::Vec3) -> f32 {
        self.level(position.x, position.z).map_or(f32::INFINITY, |level| position.y - level)
    }

    /// Metres of water in the columns around a local place.
    #[inline]
    pub fn depth(&self, x: f32, z: f32) -> f32 {
        self.grid.at(&self.depth, x, z)
    }
}

/// For each column the index of a nearest wet one, or `None` when all are dry.
///
/// Two sweeps of Danielsson's eight-neighbour propagation (1980): exact but for rare ties off by a fraction of a column.
fn nearest_wet(wet: &[bool], nx: usize, nz: usize, width: [f64; 2]) -> Option<Vec<u32>> {
    const NONE: u32 = u32::MAX;
    if !wet.contains(&true) {
        return None;
    }
    let mut from: Vec<u32> = wet.iter().enumerate().map(|(i, &wet)| if wet { i as u32 } else { NONE }).collect();
    let distance = |x: usize, z: usize, source: u32| {
        if source == NONE {
            return f64::INFINITY;
        }
        let (sx, sz) = (source as usize % nx, source as usize / nx);
        let (dx, dz) = (width[0] * (x as f64 - sx as f64), width[1] * (z as f64 - sz as f64));
        dx * dx + dz * dz
    };
    let take = |from: &mut [u32], x: usize, z: usize, other: usize| {
        let candidate = from[other];
        let here = z * nx + x;
        if candidate != from[here] && distance(x, z, candidate) < distance(x, z, from[here]) {
            from[here] = candidate;
        }
    };
    let row = |from: &mut [u32], z: usize, other: Option<usize>| {
        if let Some(other) = other {
            for x in 0..nx {
                for ox in x.saturating_sub(1)..=(x + 1).min(nx - 1) {
                    take(from, x, z, other * nx + ox);
                }
            }
        }
        for x in 1..nx {
            take(from, x, z, z * nx + x - 1);
        }
        for x in (0..nx - 1).rev() {
            take(from, x, z, z * nx + x + 1);
        }
    };
    for z in 0..nz {
        row(&mut from, z, z.checked_sub(1));
    }
    for z in (0..nz).rev() {
        row(&mut from, z, (z + 1 < nz).then_some(z + 1));
    }
    Some(from)
}

/// Where columns lie in the local frame, and values between their centres.
#[derive(Clone, Debug)]
pub(super) struct Grid {
    start: [f32; 2],
    per_metre: [f32; 2],
    nx: usize,
    nz: usize,
}

impl Grid {
    pub(super) fn new(columns: &state::Columns, origin: DVec3) -> Self {
        Self {
            start: [(columns.origin[0] - origin.x) as f32, (columns.origin[1] - origin.z) as f32],
            per_metre: columns.width.map(|width| (1.0 / width) as f32),
            nx: columns.nx,
            nz: columns.nz,
        }
    }

    /// Bilinear between column centres; outside them the edge's value.
    #[inline]
    pub(super) fn at(&self, values: &[f32], x: f32, z: f32) -> f32 {
        let u = ((x - self.start[0]) * self.per_metre[0]).clamp(0.0, (self.nx - 1) as f32);
        let v = ((z - self.start[1]) * self.per_metre[1]).clamp(0.0, (self.nz - 1) as f32);
        let (column, row) = ((u as usize).min(self.nx - 2), (v as usize).min(self.nz - 2));
        let (fu, fv) = (u - column as f32, v - row as f32);
        let corner = row * self.nx + column;
        let north = values[corner] + (values[corner + 1] - values[corner]) * fu;
        let south = values[corner + self.nx] + (values[corner + self.nx + 1] - values[corner + self.nx]) * fu;
        north + (south - north) * fv
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    /// A plane of dry ground at height 5 with the given wet columns filled to their levels.
    fn columns(nx: usize, nz: usize, wet: &[(usize, usize, f64)]) -> state::Columns {
        let mut columns = state::Columns::level([100.0, 200.0], [2.0, 2.0], [nx, nz], 5.0, 5.0);
        for &(x, z, level) in wet {
            columns.base[z * nx + x] = 1.0;
            columns.top[z * nx + x] = level;
        }
        columns
    }

    #[test]
    fn wet_columns_have_their_own_level_and_depth() {
        let origin = DVec3::new(100.0, 1.0, 200.0);
        let line = Waterline::build(&columns(10, 6, &[(3, 2, 4.0), (4, 2, 4.5)]), 1e-3, origin);
        assert_eq!(line.level(6.0, 4.0), Some(3.0));
        assert_eq!(line.level(7.0, 4.0), Some(3.25));
        assert_eq!(line.depth(6.0, 4.0), 3.0);
        assert_eq!(line.depth(18.0, 10.0), 0.0);
        assert_eq!(line.height_above(Vec3::new(6.0, 4.0, 4.0)), 1.0);
    }

    #[test]
    fn dry_ground_takes_the_nearest_waters_level() {
        // Two waters, 40 columns apart.
        let line =
            Waterline::build(&columns(61, 5, &[(10, 2, 2.0), (50, 2, 4.0)]), 1e-3, DVec3::new(100.0, 0.0, 200.0));
        let level = |x: usize| line.level(2.0 * x as f32, 4.0).unwrap();
        assert!((level(2) - 2.0).abs() < 1e-6);
        assert!((level(20) - 2.0).abs() < 1e-2);
        assert!((level(40) - 4.0).abs() < 1e-2);
        assert!(level(30) > 2.2 && level(30) < 3.8, "smooth between: {}", level(30));
        // Beyond the map the edge goes on.
        assert_eq!(line.level(-1e9, 4.0), line.level(0.0, 4.0));
    }

    #[test]
    fn sweeps_find_nearest_columns_as_brute_force_does() {
        let (nx, nz) = (37, 29);
        let wet: Vec<bool> = (0..nx * nz).map(|i| (i * 7919 + i * i * 31) % 97 == 0).collect();
        let width = [1.0, 1.7];
        let nearest = nearest_wet(&wet, nx, nz, width).unwrap();
        for i in 0..nx * nz {
            let to = |j: usize| {
                let d = [(i % nx) as f64 - (j % nx) as f64, (i / nx) as f64 - (j / nx) as f64];
                (d[0] * width[0]).hypot(d[1] * width[1])
            };
            let best = (0..nx * nz).filter(|&j| wet[j]).map(to).fold(f64::INFINITY, f64::min);
            assert!(to(nearest[i] as usize) <= best + 0.3, "{i}");
        }
    }

    #[test]
    fn no_water_is_far_above_everything() {
        let line = Waterline::build(&columns(5, 4, &[]), 1e-3, DVec3::ZERO);
        assert_eq!(line.level(1.0, 1.0), None);
        assert_eq!(line.height_above(Vec3::ZERO), f32::INFINITY);
        assert_eq!(line.depth(0.0, 0.0), 0.0);
        // A film under the threshold is no water.
        let film = Waterline::build(&columns(5, 4, &[(1, 1, 1.0005)]), 1e-3, DVec3::ZERO);
        assert_eq!(film.level(1.0, 1.0), None);
    }
}
