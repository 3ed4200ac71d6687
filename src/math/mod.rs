//! Intervals, Bernstein polynomials, round cones, sequences and warps. Knows nothing of water.

mod bernstein;
mod round_cone;
mod scramble;

pub use bernstein::{Bernstein, MAX_DEGREE, Root};
pub use round_cone::{Crossing, RoundCone, discs_outline};
pub use scramble::{STEP, finish, scramble};
