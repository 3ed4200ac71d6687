//! The referee: every root of the ray's polynomial bracketed in double precision.

use super::{PatchRay, RaySolver, Solve, ray_polynomial};
use crate::math::Root;

/// Double precision, every root bracketed by sign variations; a touch within rounding counts as a hit.
#[derive(Clone, Copy, Debug)]
pub(in crate::surface) struct Reference;

impl RaySolver for Reference {
    fn first_hit(self, ray: &PatchRay, tolerance: f64, iterations: &mut u64) -> Solve {
        *iterations += 1;
        match ray_polynomial(ray).first_root(tolerance.min(1e-12)) {
            Root::At(s) | Root::Touch(s) => Solve::Hit(s),
            Root::None => Solve::Miss,
        }
    }
}
