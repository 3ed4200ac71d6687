//! A ray's way through a tree: near child first, far children on a small stack, done when the rest begins behind the hit.
//!
//! A leaf is visited whenever the ray passes through its closed cell: distances to planes are taken with bounds of their
//! rounding, outward, so that no ray slips between two cells.

use glam::Vec3;

use super::super::RayBatch;
use super::leaf::{Best, LeafRay};
use super::{Bsp, MOST_DEPTH};

/// What a hit is made of.
#[derive(Clone, Copy, Debug)]
pub(super) struct Hit {
    pub(super) t: f32,
    pub(super) number: u32,
    pub(super) u: f32,
    pub(super) v: f32,
}

/// A distance to a plane is (place - origin) * (1 / direction): three roundings and a fourth by this factor itself, each of at
/// most u = 2^-24, so that 1 ± 8 u bounds them with as much to spare for their products.
const ROUNDINGS: f32 = 4.0 * f32::EPSILON;

/// A ray as the walk wants it.
struct Walk {
    /// Fourth entries pad to a power of two, so that an axis needs no check.
    origin: [f32; 4],
    /// One over the direction, rounded towards zero and away from it; NaN where a single precision number cannot hold it.
    inverse_low: [f32; 4],
    inverse_high: [f32; 4],
    /// Which child the ray meets first.
    first: [u32; 4],
    leaf: LeafRay,
    /// What the ray's t was multiplied by.
    scale: f32,
}

/// A power of two that brings a direction's length near 1; 1 where its square can be divided by as it is.
fn scale(direction: Vec3) -> f32 {
    let largest = direction.abs().max_element();
    // Squares of 2^±40 and their inverses are far from either end of single precision.
    if (2f32.powi(-40)..=2f32.powi(40)).contains(&largest) {
        return 1.0;
    }
    // The exponent of a number below 2^-126 reads as -127, which is near enough.
    let exponent = (largest.to_bits() >> 23) as i32 - 127;
    2f32.powi(exponent.clamp(-126, 126))
}

impl Walk {
    #[inline]
    fn new(origin: Vec3, direction: Vec3, tnear: f32, scale: f32) -> Self {
        let direction = if scale == 1.0 { direction } else { direction / scale };
        let mut walk = Self {
            origin: [origin.x, origin.y, origin.z, 0.0],
            inverse_low: [0.0; 4],
            inverse_high: [0.0; 4],
            first: [0; 4],
            leaf: LeafRay::new(origin, direction, tnear),
            scale,
        };
        for axis in 0..3 {
            let inverse = 1.0 / direction[axis];
            // Infinity is right for a zero: a plane beside the ray is met never, one through it (NaN) always. For anything
            // else it is an overflow, and NaN says: visit both sides.
            let inverse = if direction[axis] == 0.0 || inverse.is_normal() { inverse } else { f32::NAN };
            walk.inverse_low[axis] = inverse * (1.0 - ROUNDINGS);
            walk.inverse_high[axis] = inverse * (1.0 + ROUNDINGS);
            walk.first[axis] = u32::from(direction[axis].is_sign_negative());
        }
        walk
    }

    /// Where the ray enters and leaves the closed box, within an interval; `None` if it does not.
    #[inline]
    fn clip(&self, low: Vec3, high: Vec3, tnear: f32, tfar: f32) -> Option<(f32, f32)> {
        let (mut enter, mut leave) = (tnear, tfar);
        for axis in 0..3 {
            let (near, far) = if self.first[axis] == 0 { (low, high) } else { (high, low) };
            // Behind the origin the bounds are the wrong way round, and do not matter: t is not negative.
            let near = (near[axis] - self.origin[axis]) * self.inverse_low[axis];
            let far = (far[axis] - self.origin[axis]) * self.inverse_high[axis];
            // NaN (see above) changes nothing.
            enter = if near > enter { near } else { enter };
            leave = if far < leave { far } else { leave };
        }
        (enter <= leave).then_some((enter, leave))
    }
}

/// A child to come back to: where the ray enters it, and where it leaves.
#[derive(Clone, Copy, Debug)]
struct Later {
    node: u32,
    enter: f32,
    leave: f32,
}

/// Room for the children that wait, kept from ray to ray.
#[derive(Debug)]
pub(super) struct Stack([Later; MOST_DEPTH as usize]);

impl Stack {
    pub(super) const EMPTY: Self = Self([Later { node: 0, enter: 0.0, leave: 0.0 }; MOST_DEPTH as usize]);
}

impl Bsp {
    /// The nearest hit of a ray of a batch.
    #[inline]
    pub(super) fn first_hit(&self, rays: &RayBatch, index: usize, stack: &mut Stack) -> Option<Hit> {
        self.walk::<false>(rays, index, stack)
    }

    /// Whether a ray of a batch hits anything.
    #[inline]
    pub(super) fn any_hit(&self, rays: &RayBatch, index: usize, stack: &mut Stack) -> bool {
        self.walk::<true>(rays, index, stack).is_some()
    }

    #[inline]
    fn walk<const ANY: bool>(&self, rays: &RayBatch, index: usize, stack: &mut Stack) -> Option<Hit> {
        let direction = rays.direction(index);
        let scale = scale(direction);
        let (tnear, tfar) = (rays.tnear[index] * scale, rays.tfar[index] * scale);
        let ray = Walk::new(rays.origin(index), direction, tnear, scale);
        let (mut enter, mut leave) = ray.clip(self.bounds.low, self.bounds.high, tnear, tfar)?;
        let mut best = Best { t: tfar, above: 0, u: 0.0, v: 0.0 };
        let Stack(later) = stack;
        let mut waiting = 0;
        let mut at = 0;
        loop {
            let node = self.nodes[at as usize];
            if !node.is_leaf() {
                let axis = node.tag() as usize;
                let away = node.place() - ray.origin[axis];
                // The interval in which the plane is met. Both signs are exact, so that a plane behind the origin stays there.
                let (low, high) = (away * ray.inverse_low[axis], away * ray.inverse_high[axis]);
                let first = ray.first[axis];
                let children = node.children();
                if high < enter {
                    at = children + (first ^ 1);
                } else if low > leave {
                    at = children + first;
                } else {
                    // NaN keeps the whole interval for both.
                    let far =
                        Later { node: children + (first ^ 1), enter: if low > enter { low } else { enter }, leave };
                    later[waiting] = far;
                    waiting += 1;
                    at = children + first;
                    leave = if high < leave { high } else { leave };
                }
                continue;
            }
            if self.leaves.test::<ANY>(node.kind(), (node.value, node.count()), &ray.leaf, &mut best) && ANY {
                break;
            }
            // Cells come in the order of their entries: the first behind the hit ends the walk.
            let Some(next) = waiting.checked_sub(1).map(|top| later[top]).filter(|next| next.enter <= best.t) else {
                break;
            };
            waiting -= 1;
            at = next.node;
            enter = next.enter;
            leave = if best.t < next.leave { best.t } else { next.leave };
        }
        (best.above != 0).then(|| Hit { t: best.t / ray.scale, number: best.above - 1, u: best.u, v: best.v })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn planes_are_met_within_their_bounds() {
        let mut random = super::super::super::testing::Random(9);
        for _ in 0..20_000 {
            let (origin, direction, place) = (random.vector(1e4), random.vector(1.0), random.vector(1e4));
            let walk = Walk::new(origin, direction, 0.0, 1.0);
            for axis in 0..3 {
                let exact = (f64::from(place[axis]) - f64::from(origin[axis])) / f64::from(direction[axis]);
                let away = place[axis] - origin[axis];
                let (low, high) = (away * walk.inverse_low[axis], away * walk.inverse_high[axis]);
                if exact >= 0.0 {
                    assert!(f64::from(low) <= exact && exact <= f64::from(high), "{exact} in {low}..{high}");
                    assert!(f64::from(high) - f64::from(low) <= 2e-6 * exact);
                } else {
                    assert!(low < 0.0 && high < 0.0);
                }
            }
        }
    }

    #[test]
    fn a_box_is_entered_on_its_faces_edges_and_corners() {
        let (low, high) = (Vec3::new(-1.0, 2.0, 0.3), Vec3::new(1.0, 2.0, 0.7));
        let clip = |origin: Vec3, direction: Vec3| {
            Walk::new(origin, direction, 0.0, scale(direction)).clip(low, high, 0.0, f32::INFINITY)
        };
        for (origin, direction) in [
            // Along the flat box, from a corner, from within, through an edge.
            (Vec3::new(-3.0, 2.0, 0.5), Vec3::X),
            (Vec3::new(-3.0, 2.0, 0.3), Vec3::new(1.0, -0.0, 0.0)),
            (high, Vec3::Y),
            (Vec3::new(0.0, 2.0, 0.5), Vec3::NEG_Z),
            (Vec3::new(0.0, 3.0, 1.7), Vec3::new(0.0, -1.0, -1.0)),
        ] {
            assert!(clip(origin, direction).is_some(), "{origin} {direction}");
        }
        for (origin, direction) in [
            (Vec3::new(-3.0, 2.0_f32.next_up(), 0.5), Vec3::X),
            (Vec3::new(0.0, 3.0, 0.5), Vec3::Y),
            (Vec3::new(0.0, 3.0, 1.8), Vec3::new(0.0, -1.0, -1.0)),
        ] {
            assert!(clip(origin, direction).is_none(), "{origin} {direction}");
        }
    }

    #[test]
    fn directions_of_any_length_are_brought_near_one() {
        for length in [f32::MIN_POSITIVE / 1024.0, 1e-30, 1e-3, 1.0, 1e30, f32::MAX] {
            let direction = Vec3::new(0.0, length, 0.3 * length);
            let scaled = direction / scale(direction);
            let squared = scaled.length_squared();
            assert!(squared.is_normal() && squared.recip().is_normal(), "{length}: {scaled}");
        }
        assert_eq!(scale(Vec3::new(0.1, 3.0, 200.0)), 1.0);
    }
}
