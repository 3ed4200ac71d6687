//! Intervals, Bernstein polynomials, sequences and warps. Knows nothing of water.

mod bernstein;

pub use bernstein::{Bernstein, MAX_DEGREE, Root};
