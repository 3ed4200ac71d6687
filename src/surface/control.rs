//! Columns → control heights of the water and of the bed.
//!
//! A dry column's control height is the lower of `base - dry_depth` and the lowest water level among its wet neighbours
//! (of eight). So a rising bank cuts a level water surface, and a front on falling ground dives into it; the report put
//! it "slightly below the base", which lets water climb steep banks. The bed is the same kind of surface over the bases,
//! so that water neither floats above it nor stands proud of it by a difference of representation.

use std::sync::Arc;

use super::displaced::{self, DisplacedError, DisplacedSurface};
use super::lattice::{Lattice, LatticeError};
use super::spline::SplineSurface;
use crate::scene;
use crate::state::Columns;

/// Which columns hold water: `top - base` is at least the threshold (m).
pub fn wet(columns: &Columns, dry_threshold: f64) -> Vec<bool> {
    columns.top.iter().zip(&columns.base).map(|(top, base)| top - base >= dry_threshold).collect()
}

/// Control heights of the water in the files' frame (m), index `z * nx + x`.
pub fn water_heights(columns: &Columns, wet: &[bool], dry_depth: f64) -> Vec<f64> {
    let (nx, nz) = (columns.nx, columns.nz);
    let mut heights = columns.top.clone();
    for index in (0..nx * nz).filter(|&index| !wet[index]) {
        let (x, z) = (index % nx, index / nx);
        let mut height = columns.base[index] - dry_depth;
        for neighbour_z in z.saturating_sub(1)..(z + 2).min(nz) {
            for neighbour_x in x.saturating_sub(1)..(x + 2).min(nx) {
                let neighbour = neighbour_z * nx + neighbour_x;
                if wet[neighbour] {
                    height = height.min(columns.top[neighbour]);
                }
            }
        }
        heights[index] = height;
    }
    heights
}

/// How far under the base a dry column's control point lies (m): the scene's key, or 0.05 of the smaller width.
pub fn dry_depth(columns: &Columns, settings: &scene::Surface) -> f64 {
    settings.dry_depth.unwrap_or(0.05 * columns.width[0].min(columns.width[1]))
}

/// The water's lattice around `origin` (x, y, z of the local frame's zero, m); `None` if every column is dry.
///
/// # Errors
/// See [`LatticeError`].
pub fn water(columns: &Columns, settings: &scene::Surface, origin: [f64; 3]) -> Result<Option<Lattice>, LatticeError> {
    let wet = wet(columns, settings.dry_threshold);
    if !wet.contains(&true) {
        return Ok(None);
    }
    let heights = water_heights(columns, &wet, dry_depth(columns, settings));
    lattice(columns, settings.order, &heights, origin, |index| wet[index]).map(Some)
}

/// The water with its control points displaced as the scene says; `flat` is [`water`] as a surface.
///
/// # Errors
/// The scene's solver takes no displaced points.
pub fn displaced_water(
    flat: &Arc<SplineSurface>,
    columns: &Columns,
    settings: &scene::Surface,
    origin: [f64; 3],
) -> Result<DisplacedSurface, DisplacedError> {
    let wet = wet(columns, settings.dry_threshold);
    let heights = water_heights(columns, &wet, dry_depth(columns, settings));
    let heights: Vec<f64> = heights.iter().map(|height| height - origin[1]).collect();
    let shifts = displaced::displacements(columns, &wet, &settings.displacement, settings.order);
    DisplacedSurface::new(Arc::clone(flat), &heights, &shifts, settings.solver)
}

/// The bed's lattice around `origin`; it is never displaced.
///
/// # Errors
/// See [`LatticeError`].
pub fn bed(columns: &Columns, settings: &scene::Surface, origin: [f64; 3]) -> Result<Lattice, LatticeError> {
    lattice(columns, settings.order, &columns.base, origin, |_| true)
}

fn lattice(
    columns: &Columns,
    order: u32,
    heights: &[f64],
    origin: [f64; 3],
    present: impl Fn(usize) -> bool,
) -> Result<Lattice, LatticeError> {
    let local: Vec<f64> = heights.iter().map(|height| height - origin[1]).collect();
    let first = [columns.origin[0] - origin[0], columns.origin[1] - origin[2]];
    Lattice::new(order, [columns.nx, columns.nz], first, columns.width, &local, present)
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// A level lake (top 1.0) in a bowl, with a steep bank in the east and falling ground in the south.
    pub(in crate::surface) fn lake() -> Columns {
        let (nx, nz) = (8, 8);
        let mut columns = Columns { origin: [0.5, 0.5], width: [1.0, 1.0], nx, nz, ..Columns::default() };
        for z in 0..nz {
            for x in 0..nx {
                let base: f64 = match (x, z) {
                    (6.., _) => 5.0,
                    (_, 7) => -2.0,
                    _ => 0.0,
                };
                columns.base.push(base);
                columns.top.push(if base == 0.0 { 1.0 } else { base });
            }
        }
        columns.pressure = vec![0.0; nx * nz];
        columns.flow = vec![[0.0; 2]; nx * nz];
        columns
    }

    #[test]
    fn a_rising_bank_keeps_the_water_level_and_a_front_dives() {
        let columns = lake();
        let wet = wet(&columns, 1e-3);
        let heights = water_heights(&columns, &wet, 0.05);
        assert_eq!(heights[3 * 8 + 6], 1.0, "a dry bank beside the lake takes the lake's level");
        assert_eq!(heights[3 * 8 + 7], 4.95, "further up there is no wet neighbour");
        assert_eq!(heights[7 * 8 + 3], -2.05, "on lower ground the surface dives under the base");
        assert_eq!(heights[3 * 8 + 3], 1.0);
    }

    #[test]
    fn water_ends_under_the_bed() {
        let columns = lake();
        for order in 2..=4 {
            let settings = scene::Surface { order, ..Default::default() };
            let water = water(&columns, &settings, [0.0; 3]).unwrap().unwrap();
            let bed = bed(&columns, &settings, [0.0; 3]).unwrap();
            // Along the outline of the existing patches the water lies under the bed.
            let exists = |i: i64, j: i64| {
                (0..water.cells[0] as i64).contains(&i)
                    && (0..water.cells[1] as i64).contains(&j)
                    && water.exists(i as usize, j as usize)
            };
            let mut outline = 0;
            for j in 0..water.cells[1] {
                for i in 0..water.cells[0] {
                    let (a, b) = (i as i64, j as i64);
                    if exists(a, b) && i + 1 < water.cells[0] && !exists(a + 1, b) {
                        outline += 1;
                        for k in 0..=10 {
                            let v = f64::from(k) / 10.0;
                            assert!(water.evaluate(i, j, 1.0, v).0 < bed.evaluate(i, j, 1.0, v).0);
                        }
                    }
                }
            }
            assert!(order == 4 || outline > 0, "order {order}");
        }
    }

    #[test]
    fn dry_land_has_no_water() {
        let mut columns = lake();
        columns.top = columns.base.clone();
        assert!(water(&columns, &scene::Surface::default(), [0.0; 3]).unwrap().is_none());
    }
}
