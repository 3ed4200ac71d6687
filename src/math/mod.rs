//! Intervals, Bernstein polynomials, sequences and warps. Knows nothing of water.

mod bernstein;
mod scramble;

pub use bernstein::{Bernstein, MAX_DEGREE, Root};
pub use scramble::{STEP, finish, scramble};
