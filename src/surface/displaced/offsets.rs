//! Columns → how far each control point of the water is moved sideways (the report's section 2.4).
//!
//! *Adhesion:* wet columns beside dry ones are held back by the bank, against the flow. *Shear:* columns are moved along
//! the flow, by how much faster it is than around them. Both are bounded so that the surface cannot fold over.

use crate::scene::Displacement;
use crate::state::Columns;

/// Greatest displacement along an axis, as a share of a column's width there: less than a quarter.
///
/// In columns the surface's ground plan is (u, v) plus a spline of the displacements. Neighbouring displacements differ
/// by at most twice this share m along either axis, and a spline's slope lies between the differences of its control
/// points. So two points whose larger coordinate differs by d come nearer by at most 2 m d along each axis of change,
/// 4 m d in all: with m < 1/4 no two points fall together, the plan is never folded, and its determinant is at least
/// 1 - 4 m.
pub const MOST: f64 = 0.24;

/// Standard gravity (m/s^2).
const GRAVITY: f64 = 9.80665;

/// Displacements along x and z (m) of all columns, index `z * nx + x`, for a spline of an order.
///
/// Dry columns stay, and so do the `order / 2` outermost rows and columns of the domain: what lies on its boundary leans
/// on these alone, and the side walls keep fitting.
pub fn displacements(columns: &Columns, wet: &[bool], settings: &Displacement, order: u32) -> Vec<[f64; 2]> {
    let (nx, nz) = (columns.nx, columns.nz);
    let mut all = vec![[0.0; 2]; nx * nz];
    let edge = order as usize / 2;
    for z in edge..nz.saturating_sub(edge) {
        for x in edge..nx.saturating_sub(edge) {
            let index = z * nx + x;
            if wet[index] {
                all[index] = bounded(moved(columns, wet, settings, index), columns.width);
            }
        }
    }
    all
}

/// What both effects ask for (m), unbounded, of a wet column that has eight neighbours.
fn moved(columns: &Columns, wet: &[bool], settings: &Displacement, index: usize) -> [f64; 2] {
    let (nx, flow) = (columns.nx, columns.flow[index]);
    let rows = [index - nx, index, index + nx];
    let around = rows.iter().flat_map(|&row| [row - 1, row, row + 1]).filter(|&other| other != index);
    let (mut sum, mut count) = ([0.0; 2], 0.0);
    for other in around.filter(|&other| wet[other]) {
        sum = [0, 1].map(|axis| sum[axis] + columns.flow[other][axis]);
        count += 1.0;
    }
    // Banks stand still and are no part of the stream: what they do to it is adhesion.
    let mean = if count > 0.0 { sum.map(|s| s / count) } else { flow };
    let beside_dry = count < 8.0;
    let depth = columns.top[index] - columns.base[index];
    // Still water is not held back; at the speed of its own waves (Froude number 1) and above, by the whole share.
    let speed = flow[0].hypot(flow[1]).max((GRAVITY * depth.max(0.0)).sqrt());
    [0, 1].map(|axis| {
        let held =
            if beside_dry && speed > 0.0 { settings.adhesion * columns.width[axis] * flow[axis] / speed } else { 0.0 };
        settings.shear * (flow[axis] - mean[axis]) - held
    })
}

/// Shortened, in its direction, to less than [`MOST`] of a column along both axes.
fn bounded(shift: [f64; 2], width: [f64; 2]) -> [f64; 2] {
    let share = (shift[0] / width[0]).abs().max((shift[1] / width[1]).abs());
    if share > MOST { shift.map(|s| s * (MOST / share)) } else { shift }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A stream along x, 12 x 9 columns of 2 m x 1 m and 1 m deep, dry in the two northern rows, faster in the middle.
    fn stream() -> (Columns, Vec<bool>) {
        let (nx, nz) = (12, 9);
        let mut columns = Columns { width: [2.0, 1.0], nx, nz, ..Columns::default() };
        for z in 0..nz {
            for _ in 0..nx {
                columns.base.push(0.0);
                columns.top.push(if z < 2 { 0.0 } else { 1.0 });
                columns.flow.push([if z == 5 { 3.0 } else { 1.0 }, 0.0]);
            }
        }
        let wet = columns.top.iter().map(|&top| top > 0.0).collect();
        (columns, wet)
    }

    #[test]
    fn edges_are_held_back_and_only_they() {
        let (columns, wet) = stream();
        let all = displacements(&columns, &wet, &Displacement { adhesion: 0.2, shear: 0.0 }, 3);
        let at = |x: usize, z: usize| all[z * 12 + x];
        // Froude number 1 / sqrt(9.80665) of a column of 2 m.
        let held = 0.2 * 2.0 / GRAVITY.sqrt();
        assert!((at(5, 2)[0] + held).abs() < 1e-12 && at(5, 2)[1] == 0.0, "{:?}", at(5, 2));
        assert_eq!((at(5, 1), at(5, 3), at(5, 5)), ([0.0; 2], [0.0; 2], [0.0; 2]));
    }

    #[test]
    fn faster_water_runs_ahead_of_its_neighbours_and_they_lag() {
        let (columns, wet) = stream();
        let all = displacements(&columns, &wet, &Displacement { adhesion: 0.0, shear: 0.1 }, 3);
        let at = |x: usize, z: usize| all[z * 12 + x][0];
        // The fast row has two of eight neighbours as fast as itself; beside it three of eight are faster.
        assert!((at(5, 5) - 0.1 * 2.0 * 6.0 / 8.0).abs() < 1e-12);
        assert!((at(5, 4) + 0.1 * 2.0 * 3.0 / 8.0).abs() < 1e-12);
        assert_eq!(at(5, 7), 0.0);
    }

    #[test]
    fn still_water_and_the_domains_edge_stay() {
        let (mut columns, wet) = stream();
        let settings = Displacement { adhesion: 0.24, shear: 100.0 };
        for (order, edge) in [(2, 1), (3, 1), (4, 2)] {
            let all = displacements(&columns, &wet, &settings, order);
            for (index, shift) in all.iter().enumerate() {
                let (x, z) = (index % 12, index / 12);
                let outer = x.min(11 - x).min(z.min(8 - z)) < edge;
                assert!(!outer || *shift == [0.0; 2], "order {order}: ({x}, {z}) moved by {shift:?}");
                assert!(shift[0].abs() <= MOST * 2.0 + 1e-12 && shift[1].abs() <= MOST + 1e-12);
            }
            assert!(all.iter().any(|shift| shift[0].abs() > 0.4), "order {order}: the bound is reached");
        }
        columns.flow.fill([0.0; 2]);
        assert!(displacements(&columns, &wet, &settings, 3).iter().all(|shift| *shift == [0.0; 2]));
    }
}
