//! The referee of all solvers and accelerators: a plain walk from cell to cell in double precision, every root of every
//! patch bracketed. Slow, simple, and shares nothing with the fast walk but the lattice.

use glam::DVec3;

use super::lattice::Lattice;
use super::solve::{PatchRay, ray_polynomial};
use crate::math::{Bernstein, Root};

/// A first hit in double precision.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RefereeHit {
    /// Distance in lengths of the direction.
    pub t: f64,
    /// Patch: cell along z times cells along x, plus cell along x.
    pub patch: u32,
    /// Place within the patch, 0..1.
    pub uv: [f64; 2],
    /// The ray only touches here, to within double precision.
    pub touch: bool,
}

/// A ray's stretch over one cell.
struct Stretch {
    cell: [usize; 2],
    t: [f64; 2],
}

/// The part of `range` over a rectangle of cell coordinates and within the heights that there are; `None` for none.
fn clip(
    lattice: &Lattice,
    [low, high]: [[f64; 2]; 2],
    origin: DVec3,
    direction: DVec3,
    range: [f64; 2],
) -> Option<[f64; 2]> {
    let at = lattice.to_cell(origin.x, origin.z);
    let slope = [direction.x / lattice.width[0], direction.z / lattice.width[1]];
    // Heights end every ray that the rectangle does not; a little room keeps water at either extreme.
    let heights = [lattice.extent[0] - 1.0, lattice.extent[1] + 1.0];
    let slabs =
        [(at[0], slope[0], [low[0], high[0]]), (at[1], slope[1], [low[1], high[1]]), (origin.y, direction.y, heights)];
    let [mut near, mut far] = range;
    for (place, speed, [low, high]) in slabs {
        if speed == 0.0 {
            if !(low..=high).contains(&place) {
                return None;
            }
        } else {
            let (a, b) = ((low - place) / speed, (high - place) / speed);
            near = near.max(a.min(b));
            far = far.min(a.max(b));
        }
    }
    (near <= far && far.is_finite()).then_some([near, far])
}

/// The cells under a ray within `t`, in order.
fn stretches(lattice: &Lattice, origin: DVec3, direction: DVec3, t: [f64; 2]) -> Vec<Stretch> {
    let at = lattice.to_cell(origin.x, origin.z);
    let slope = [direction.x / lattice.width[0], direction.z / lattice.width[1]];
    let Some([near, far]) = clip(lattice, lattice.domain, origin, direction, t) else { return Vec::new() };
    let clamp = |axis: usize, place: f64| place.floor().clamp(0.0, (lattice.cells[axis] - 1) as f64);
    let mut cell = [0, 1].map(|axis| clamp(axis, at[axis] + near * slope[axis]));
    if slope == [0.0; 2] {
        // A plumb ray stays in one cell: on a border, in one that has a patch.
        cell = lattice.closed_cell(at, cell.map(|c| c as usize)).map(|c| c as f64);
    }
    let mut here = near;
    let mut out = Vec::new();
    loop {
        let border = |axis: usize| match slope[axis] {
            s if s > 0.0 => (cell[axis] + 1.0 - at[axis]) / s,
            s if s < 0.0 => (cell[axis] - at[axis]) / s,
            _ => f64::INFINITY,
        };
        let (bx, bz) = (border(0), border(1));
        let next = bx.min(bz).min(far).max(here);
        out.push(Stretch { cell: cell.map(|c| c as usize), t: [here, next] });
        if bx.min(bz) >= far {
            return out;
        }
        let axis = usize::from(bz < bx);
        cell[axis] += slope[axis].signum();
        if cell[axis] < 0.0 || cell[axis] >= lattice.cells[axis] as f64 {
            return out;
        }
        here = next;
    }
}

/// Height of the ray above the surface over a stretch.
fn polynomial(lattice: &Lattice, origin: DVec3, direction: DVec3, stretch: &Stretch) -> (Bernstein, PatchRay) {
    let at = lattice.to_cell(origin.x, origin.z);
    let slope = [direction.x / lattice.width[0], direction.z / lattice.width[1]];
    let place = |axis: usize| stretch.t.map(|t| at[axis] - stretch.cell[axis] as f64 + t * slope[axis]);
    let mut window = lattice.window(stretch.cell[0], stretch.cell[1]);
    let level = window[1][1];
    for row in &mut window {
        for height in row {
            *height -= level;
        }
    }
    let y = stretch.t.map(|t| origin.y - level + t * direction.y);
    let ray = PatchRay { order: lattice.order, window, u: place(0), v: place(1), y };
    (ray_polynomial(&ray), ray)
}

/// The first hit of a ray with `t` in the closed range, every root bracketed.
///
/// *Frame:* the lattice's local frame, metres. *Accuracy:* a few units in the last place of double precision.
pub fn first_hit(lattice: &Lattice, origin: DVec3, direction: DVec3, t: [f64; 2]) -> Option<RefereeHit> {
    let mut carried = 0.0;
    for stretch in stretches(lattice, origin, direction, t) {
        if !lattice.exists(stretch.cell[0], stretch.cell[1]) {
            carried = 0.0;
            continue;
        }
        let (polynomial, ray) = polynomial(lattice, origin, direction, &stretch);
        let coefficients = polynomial.coefficients();
        let hit = |s: f64, touch: bool| {
            let along = |ends: [f64; 2]| (ends[0] + s * (ends[1] - ends[0])).clamp(0.0, 1.0);
            Some(RefereeHit {
                t: stretch.t[0] + s * (stretch.t[1] - stretch.t[0]),
                patch: (stretch.cell[1] * lattice.cells[0] + stretch.cell[0]) as u32,
                uv: [along(ray.u), along(ray.v)],
                touch,
            })
        };
        if carried * coefficients[0] < 0.0 {
            return hit(0.0, false);
        }
        match polynomial.first_root(1e-15) {
            Root::At(s) => return hit(s, false),
            Root::Touch(s) => return hit(s, true),
            Root::None => carried = coefficients[coefficients.len() - 1].signum(),
        }
    }
    None
}

/// The first hit with one patch alone, and whether its polynomial had to be solved; `None` where the ray does not pass
/// over the cell within `range`.
pub(super) fn patch_hit(
    lattice: &Lattice,
    cell: [usize; 2],
    origin: DVec3,
    direction: DVec3,
    range: [f64; 2],
) -> Option<(Option<RefereeHit>, bool)> {
    let axes = [0, 1];
    let low = axes.map(|axis| (cell[axis] as f64).max(lattice.domain[0][axis]));
    let high = axes.map(|axis| (cell[axis] as f64 + 1.0).min(lattice.domain[1][axis]));
    let [near, far] = clip(lattice, [low, high], origin, direction, range)?;
    let (polynomial, ray) = polynomial(lattice, origin, direction, &Stretch { cell, t: [near, far] });
    let (s, touch) = match polynomial.first_root(1e-15) {
        Root::At(s) => (s, false),
        Root::Touch(s) => (s, true),
        Root::None => return Some((None, polynomial.variations() > 0)),
    };
    let along = |ends: [f64; 2]| (ends[0] + s * (ends[1] - ends[0])).clamp(0.0, 1.0);
    let patch = (cell[1] * lattice.cells[0] + cell[0]) as u32;
    let hit = RefereeHit { t: near + s * (far - near), patch, uv: [along(ray.u), along(ray.v)], touch };
    Some((Some(hit), true))
}

/// Whether the surface stays within `distance` (m, vertical) of the ray over all of `t`: then two answers at its ends
/// are both right, and the ray is tangent for practical purposes.
pub fn stays_within(lattice: &Lattice, origin: DVec3, direction: DVec3, t: [f64; 2], distance: f64) -> bool {
    stretches(lattice, origin, direction, t)
        .iter()
        .filter(|stretch| lattice.exists(stretch.cell[0], stretch.cell[1]))
        .all(|stretch| {
            let (polynomial, _) = polynomial(lattice, origin, direction, stretch);
            polynomial.coefficients().iter().all(|c| c.abs() <= distance)
        })
}

/// Least height of the ray above the surface over `t`, with its sign kept: bounds a near miss.
pub fn closest_approach(lattice: &Lattice, origin: DVec3, direction: DVec3, t: [f64; 2]) -> f64 {
    let mut least = f64::INFINITY;
    for stretch in stretches(lattice, origin, direction, t) {
        if lattice.exists(stretch.cell[0], stretch.cell[1]) {
            let (polynomial, _) = polynomial(lattice, origin, direction, &stretch);
            // The best of 33 places, then of 33 around it, twice: a touch is a parabola, whose foot a single round misses by
            // up to a thousandth of its curvature.
            let (mut start, mut end) = (0.0, 1.0);
            for _ in 0..3 {
                let at = |k: u32| start + (end - start) * f64::from(k) / 32.0;
                let height = |k: &u32| polynomial.value(at(*k)).abs();
                let best = (0..=32u32).min_by(|a, b| height(a).total_cmp(&height(b))).unwrap_or(0);
                least = least.min(height(&best));
                (start, end) = (at(best.saturating_sub(1)), at((best + 1).min(32)));
            }
        }
    }
    least
}

/// A hit moved onto the surface in double precision: Newton along the ray from `t`, within the patch's own polynomial.
///
/// The ray is the one given, not the rounded one that an accelerator saw. Returns the polished t, or `t` itself where
/// the slope along the ray vanishes (tangency) or the step would leave the neighbourhood of the hit.
pub fn polish(lattice: &Lattice, origin: DVec3, direction: DVec3, t: f64) -> f64 {
    let slope = [direction.x / lattice.width[0], direction.z / lattice.width[1]];
    let per_t = slope[0].abs().max(slope[1].abs()).max(direction.y.abs() / lattice.width[0].min(lattice.width[1]));
    let at = lattice.to_cell(origin.x, origin.z);
    let mut here = t;
    for _ in 0..6 {
        let place = [0, 1].map(|axis| at[axis] + here * slope[axis]);
        let cell = [0, 1].map(|axis| (place[axis].floor().max(0.0) as usize).min(lattice.cells[axis] - 1));
        let (height, gradient) =
            lattice.evaluate(cell[0], cell[1], place[0] - cell[0] as f64, place[1] - cell[1] as f64);
        let value = origin.y + here * direction.y - height;
        let rate = direction.y - gradient[0] * direction.x - gradient[1] * direction.z;
        let next = here - value / rate;
        // A hit is known to about a hundredth of a column; a longer step means a slope along the ray near zero.
        if !next.is_finite() || (next - t).abs() * per_t > 0.01 {
            return t;
        }
        if (next - here).abs() <= f64::EPSILON * next.abs() {
            return next;
        }
        here = next;
    }
    here
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn plane_is_hit_where_algebra_says() {
        for order in 2..=4 {
            let heights: Vec<f64> = (0..100).map(|k| 0.5 * f64::from(k % 10)).collect();
            let lattice = Lattice::new(order, [10, 10], [0.0; 2], [2.0; 2], &heights, |_| true).unwrap();
            // y = x / 4 inside; from (5, 10, 9) straight down and at a slant.
            let down = first_hit(&lattice, DVec3::new(5.0, 10.0, 9.0), DVec3::NEG_Y, [0.0, f64::INFINITY]).unwrap();
            assert!((down.t - 8.75).abs() < 1e-12, "order {order}: {}", down.t);
            let slant =
                first_hit(&lattice, DVec3::new(4.0, 5.0, 9.0), DVec3::new(2.0, -1.0, 0.0), [0.0, 100.0]).unwrap();
            assert!((slant.t - 4.0 / 1.5).abs() < 1e-12);
        }
    }

    #[test]
    fn polish_reaches_the_referees_answer() {
        let heights: Vec<f64> = (0..400).map(|k| (f64::from(k) * 0.7).sin()).collect();
        let lattice = Lattice::new(3, [20, 20], [0.0; 2], [1.0; 2], &heights, |_| true).unwrap();
        let (origin, direction) = (DVec3::new(3.3, 6.0, 4.1), DVec3::new(0.4, -0.5, 0.3));
        let hit = first_hit(&lattice, origin, direction, [0.0, 1e9]).unwrap();
        assert!((polish(&lattice, origin, direction, hit.t + 1e-4) - hit.t).abs() < 1e-12);
    }
}
