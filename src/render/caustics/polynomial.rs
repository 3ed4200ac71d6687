//! Heights over a part of a patch as a polynomial: its derivatives, and how much they differ over the part.
//!
//! In double precision for `search`, in single for the sixteen at once of `screen`.

use std::ops::{Add, Mul, Sub};

use crate::surface::Lattice;

/// What both precisions can do.
pub(super) trait Real:
    Copy + PartialEq + From<f32> + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self>
{
    /// Magnitude.
    fn magnitude(self) -> Self;
}

impl Real for f32 {
    #[inline(always)]
    fn magnitude(self) -> Self {
        self.abs()
    }
}

impl Real for f64 {
    #[inline(always)]
    fn magnitude(self) -> Self {
        self.abs()
    }
}

/// Height and its derivatives along α and β.
#[derive(Clone, Copy, Debug)]
pub(super) struct Jet<T> {
    pub(super) height: T,
    pub(super) first: [T; 2],
    pub(super) second: [[T; 2]; 2],
}

/// Heights as a polynomial of α and β: `[a][b]` belongs to αᵃ βᵇ.
#[derive(Clone, Copy, Debug)]
pub(super) struct Polynomial<T, const K: usize>(pub(super) [[T; K]; K]);

impl<const K: usize> Polynomial<f64, K> {
    /// A patch about its middle, in patch widths.
    #[inline(always)]
    pub(super) fn of_patch(lattice: &Lattice, i: usize, j: usize) -> Self {
        let mut coefficients = [[0.0; K]; K];
        let mut rows = [[0.0; K]; K];
        for b in 0..K {
            let heights = &lattice.heights[(j + b) * lattice.stride + i..][..K];
            rows[b] = powers(std::array::from_fn(|a| f64::from(heights[a])));
        }
        for a in 0..K {
            coefficients[a] = powers(std::array::from_fn(|b| rows[b][a]));
        }
        Self(coefficients)
    }

    #[inline(always)]
    pub(super) fn jet(&self, [x, y]: [f64; 2]) -> Jet<f64> {
        // Every column's value and derivatives along β, then the same along α.
        let columns: [[f64; 3]; K] = std::array::from_fn(|a| horner(&self.0[a], y));
        let [height, first_a, second_a] = horner(&columns.map(|column| column[0]), x);
        let [first_b, mixed, _] = horner(&columns.map(|column| column[1]), x);
        let [second_b, ..] = horner(&columns.map(|column| column[2]), x);
        Jet { height, first: [first_a, first_b], second: [[second_a, mixed], [mixed, second_b]] }
    }
}

impl<T: Real, const K: usize> Polynomial<T, K> {
    /// The same over the part of half widths `half` around (x, y), from -1 to 1.
    #[inline(always)]
    pub(super) fn over(&self, [x, y]: [T; 2], half: [T; 2]) -> Self {
        let mut p = self.0;
        // Most cells are whole patches.
        let moved = x != T::from(0.0) || y != T::from(0.0);
        for start in 0..if moved { K - 1 } else { 0 } {
            for k in (start..K - 1).rev() {
                for b in 0..K {
                    p[k][b] = p[k][b] + x * p[k + 1][b];
                }
            }
        }
        for start in 0..if moved { K - 1 } else { 0 } {
            for k in (start..K - 1).rev() {
                for a in 0..K {
                    p[a][k] = p[a][k] + y * p[a][k + 1];
                }
            }
        }
        let mut along = T::from(1.0);
        for a in 0..K {
            let mut scale = along;
            for b in 0..K {
                p[a][b] = p[a][b] * scale;
                scale = scale * half[1];
            }
            along = along * half[0];
        }
        Self(p)
    }

    #[inline(always)]
    pub(super) fn jet_at_middle(&self) -> Jet<T> {
        let p = &self.0;
        let (aa, bb) = if K > 2 {
            (T::from(2.0) * p[2.min(K - 1)][0], T::from(2.0) * p[0][2.min(K - 1)])
        } else {
            (T::from(0.0), T::from(0.0))
        };
        Jet { height: p[0][0], first: [p[1][0], p[0][1]], second: [[aa, p[1][1]], [p[1][1], bb]] }
    }

    /// Most that height, first and second derivatives differ by, over the cell, from what they are at its middle.
    #[inline(always)]
    pub(super) fn ranges(&self) -> Jet<T> {
        let none = T::from(0.0);
        let mut ranges = Jet { height: none, first: [none; 2], second: [[none; 2]; 2] };
        for a in 0..K {
            for b in 0..K {
                let size = self.0[a][b].magnitude();
                let (x, y) = (T::from(a as f32), T::from(b as f32));
                if a + b > 0 {
                    ranges.height = ranges.height + size;
                }
                if a + b > 1 {
                    ranges.first[0] = ranges.first[0] + x * size;
                    ranges.first[1] = ranges.first[1] + y * size;
                }
                if a + b > 2 {
                    ranges.second[0][0] = ranges.second[0][0] + x * (x - T::from(1.0)) * size;
                    ranges.second[1][1] = ranges.second[1][1] + y * (y - T::from(1.0)) * size;
                    ranges.second[0][1] = ranges.second[0][1] + x * y * size;
                }
            }
        }
        ranges.second[1][0] = ranges.second[0][1];
        ranges
    }
}

/// Value, first and second derivative of a polynomial.
#[inline(always)]
fn horner<const K: usize>(p: &[f64; K], x: f64) -> [f64; 3] {
    let (mut value, mut first, mut half_second) = (p[K - 1], 0.0, 0.0);
    for k in (0..K - 1).rev() {
        half_second = half_second * x + first;
        first = first * x + value;
        value = value * x + p[k];
    }
    [value, first, 2.0 * half_second]
}

/// B-spline heights to powers of the place from the middle of the span, in spans.
#[inline(always)]
fn powers<const K: usize>(h: [f64; K]) -> [f64; K] {
    let mut p = [0.0; K];
    match *h.as_slice() {
        [a, b] => p.copy_from_slice(&[0.5 * (a + b), b - a]),
        [a, b, c] => p.copy_from_slice(&[0.125 * (a + c) + 0.75 * b, 0.5 * (c - a), 0.5 * (a + c) - b]),
        [a, b, c, d] => p.copy_from_slice(&[
            (a + d) / 48.0 + 23.0 / 48.0 * (b + c),
            0.125 * (d - a) + 0.625 * (c - b),
            0.25 * (a + d - b - c),
            (d - a) / 6.0 + 0.5 * (b - c),
        ]),
        // Lattices have no other orders.
        _ => {}
    }
    p
}
