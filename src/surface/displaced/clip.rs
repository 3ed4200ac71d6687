//! One round of Bézier clipping in two dimensions (Nishita, Sederberg and Kakimoto, "Ray Tracing Trimmed Rational Surface
//! Patches", 1990, section 3): a piece seen along the ray is cut, first in u, then in v, to where the hull of its
//! distances to a line through the ray can vanish.

use glam::DVec2;

use super::net::Net;
use super::solve::{Piece, SMALLEST};

/// A cut that keeps more than this share of a piece is replaced by a halving (the paper's figure).
pub(super) const KEEPS: f64 = 0.8;

/// Least share that a cut keeps: clipping converges by squares, and would leap from a piece too large for a proof of its
/// root to one with no digits left for it.
const LEAST: f64 = 1.0 / 1024.0;

/// The part of a piece that may hold a root, cut along both axes; `None` if no part does.
pub(super) fn both(piece: &Piece, rounding: f64) -> Option<Piece> {
    (0..2).try_fold(*piece, |piece, axis| {
        let range = range(&piece.net, axis, rounding)?;
        // An axis without digits left stays; the other may have some.
        Some(if piece.widths()[axis] > SMALLEST { piece.part(axis, no_less(range)) } else { piece })
    })
}

/// A range widened to [`LEAST`].
fn no_less([low, high]: [f64; 2]) -> [f64; 2] {
    let room = (0.5 * (LEAST - (high - low))).max(0.0);
    [(low - room).max(0.0), (high + room).min(1.0)]
}

/// The range of one axis (0: u, 1: v) over which distances to a line can vanish.
fn range(net: &Net, axis: usize, rounding: f64) -> Option<[f64; 2]> {
    let n = net.degree;
    let point = |along: usize, other: usize| {
        let p = if axis == 0 { net.points[other][along] } else { net.points[along][other] };
        DVec2::new(p.x, p.y)
    };
    // The line runs as the piece does across the axis, so that distances change along the axis most of all.
    let line = (point(0, n) - point(0, 0)) + (point(n, n) - point(n, 0));
    let line = line.try_normalize().unwrap_or(DVec2::X);
    let (mut low, mut high) = ([f64::INFINITY; 4], [f64::NEG_INFINITY; 4]);
    for along in 0..=n {
        for other in 0..=n {
            let distance = line.perp_dot(point(along, other));
            low[along] = low[along].min(distance - rounding);
            high[along] = high[along].max(distance + rounding);
        }
    }
    where_it_vanishes(&low[..=n], &high[..=n])
}

/// Where the convex hull of the upright strokes from (k / n, low_k) to (k / n, high_k) meets zero.
fn where_it_vanishes(low: &[f64], high: &[f64]) -> Option<[f64; 2]> {
    let place = |k: usize| k as f64 / (low.len() - 1) as f64;
    let (mut first, mut last) = (f64::INFINITY, f64::NEG_INFINITY);
    let mut meet = |s: f64| (first, last) = (first.min(s), last.max(s));
    for i in 0..low.len() {
        if low[i] <= 0.0 && high[i] >= 0.0 {
            meet(place(i));
        }
        for j in (0..low.len()).filter(|&j| j != i) {
            // Every chord from a point below zero to one above; the hull's sides are among them.
            for below in [low[i], high[i]].into_iter().filter(|&d| d < 0.0) {
                for above in [low[j], high[j]].into_iter().filter(|&d| d > 0.0) {
                    meet(place(i) + (place(j) - place(i)) * (below / (below - above)));
                }
            }
        }
    }
    (first <= last).then_some([first, last])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_hull_of_strokes_meets_zero_where_its_sides_do() {
        assert_eq!(where_it_vanishes(&[1.0, -1.0, 1.0], &[1.0, -1.0, 1.0]), Some([0.25, 0.75]));
        assert_eq!(where_it_vanishes(&[-1.0, 1.0], &[1.0, 3.0]), Some([0.0, 0.5]));
        assert_eq!(where_it_vanishes(&[0.5, 1.0], &[2.0, 3.0]), None);
        assert_eq!(where_it_vanishes(&[-2.0, -1.0], &[-1.0, -0.5]), None);
    }
}
