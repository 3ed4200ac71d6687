//! A packet of rays as the walk wants it, and the beam around rays that travel alike.

use super::WIDTH;
use crate::simd::Simd;
use crate::surface::{LANES, LaneRays};

/// A distance to a plane is (place - origin) * (1 / direction): three roundings and a fourth by this factor itself, each of
/// at most u = 2^-24; a test's own roundings along an axis are four more. 1 ± 16 u bounds them.
const ROUNDINGS: f32 = 8.0 * f32::EPSILON;

/// How wide rays that go together may fan out, in parts of the way they have gone: a node's box is about a sixteenth as
/// wide as its parent, and a beam much wider than a cluster would only collect clusters that few of its rays meet.
const WIDEST: f32 = 1.0 / 24.0;

/// Rays whose directions' largest component is near one, by a power of two.
pub(super) struct Packet {
    pub(super) origin: [[f32; LANES]; 3],
    pub(super) direction: [[f32; LANES]; 3],
    /// One over the direction, rounded towards zero and away from it; NaN where single precision cannot hold it.
    pub(super) inverse: [[[f32; LANES]; 2]; 3],
    pub(super) inverse_squared: [f32; LANES],
    pub(super) tnear: [f32; LANES],
    pub(super) tfar: [f32; LANES],
    /// What each ray's t was multiplied by.
    pub(super) scale: [f32; LANES],
}

/// A power of two that brings a direction's largest component near 1; 1 where its square can be divided by as it is.
fn scale(largest: f32) -> f32 {
    // Squares of 2^±40 and their inverses are far from either end of single precision.
    if (2f32.powi(-40)..=2f32.powi(40)).contains(&largest) {
        return 1.0;
    }
    // The exponent of a number below 2^-126 reads as -127, which is near enough.
    let exponent = (largest.to_bits() >> 23) as i32 - 127;
    2f32.powi(exponent.clamp(-126, 126))
}

impl Packet {
    #[inline(always)]
    pub(super) fn new<S: Simd>(s: S, rays: &LaneRays) -> Self {
        let mut packet = Self {
            origin: rays.origin,
            direction: rays.direction,
            inverse: [[[0.0; LANES]; 2]; 3],
            inverse_squared: [0.0; LANES],
            tnear: rays.tnear,
            tfar: rays.tfar,
            scale: [1.0; LANES],
        };
        packet.bring_near_one(s, rays.active);
        let one = s.splat(1.0);
        let (zero, infinity) = (s.splat(0.0), s.splat(f32::INFINITY));
        for from in (0..LANES).step_by(S::LANES) {
            let mut squared = zero;
            for axis in 0..3 {
                let direction = s.load(&packet.direction[axis][from..]);
                squared = s.fma(direction, direction, squared);
                let inverse = one / direction;
                // Infinity is right for a zero: a plane beside the ray is met never, one through it (NaN) always. For
                // anything else it is an overflow, and NaN says: this axis cannot tell.
                let overflow = s.lt(zero, s.abs(direction)) & !s.lt(s.abs(inverse), infinity);
                let inverse = s.select(overflow, s.splat(f32::NAN), inverse);
                s.store(inverse * s.splat(1.0 - ROUNDINGS), &mut packet.inverse[axis][0][from..]);
                s.store(inverse * s.splat(1.0 + ROUNDINGS), &mut packet.inverse[axis][1][from..]);
            }
            s.store(one / squared, &mut packet.inverse_squared[from..]);
        }
        packet
    }

    /// Scales the rays whose directions are far from one, which few are.
    #[inline(always)]
    fn bring_near_one<S: Simd>(&mut self, s: S, active: u16) {
        let mut near = 0;
        for from in (0..LANES).step_by(S::LANES) {
            let mut largest = s.splat(0.0);
            for axis in 0..3 {
                largest = s.max(s.abs(s.load(&self.direction[axis][from..])), largest);
            }
            let inside = s.le(s.splat(2f32.powi(-40)), largest) & s.le(largest, s.splat(2f32.powi(40)));
            near |= s.bits(inside) << from;
        }
        if u32::from(active) & !near == 0 {
            return;
        }
        for lane in (0..LANES).filter(|lane| active >> lane & 1 == 1) {
            let largest = self.direction.iter().fold(0.0, |largest, axis| axis[lane].abs().max(largest));
            let scale = scale(largest);
            for axis in &mut self.direction {
                axis[lane] /= scale;
            }
            self.tnear[lane] *= scale;
            self.tfar[lane] *= scale;
            self.scale[lane] = scale;
        }
    }
}

/// What holds all rays of a packet: intervals of their numbers.
pub(super) struct Beam {
    /// Origins, least and greatest, per axis.
    pub(super) origin: [[f32; 2]; 3],
    /// Least and greatest of each of a packet's inverse directions: `[axis][which][least, greatest]`.
    pub(super) inverse: [[[f32; 2]; 2]; 3],
    /// 1 where the rays go down the axis.
    pub(super) sign: [usize; 3],
    pub(super) tnear: f32,
}

/// Least and greatest of the active lanes, in steps that compilers turn into vectors.
#[inline(always)]
fn extremes(values: &[f32; LANES], active: u16) -> [f32; 2] {
    let (mut least, mut greatest) = (*values, *values);
    if active != u16::MAX {
        // Lanes that do not ask must not widen it.
        let first = values[active.trailing_zeros() as usize];
        for lane in 0..LANES {
            let value = if active >> lane & 1 == 1 { values[lane] } else { first };
            (least[lane], greatest[lane]) = (value, value);
        }
    }
    let mut width = LANES / 2;
    while width > 0 {
        for lane in 0..width {
            let (a, b) = (least[lane + width], greatest[lane + width]);
            least[lane] = if a < least[lane] { a } else { least[lane] };
            greatest[lane] = if b > greatest[lane] { b } else { greatest[lane] };
        }
        width /= 2;
    }
    [least[0], greatest[0]]
}

impl Beam {
    /// The beam around all active rays; `None` where they are too few or do not travel alike. `size` is that of what
    /// they travel through (m).
    #[inline(always)]
    pub(super) fn new(packet: &Packet, active: u16, size: f32) -> Option<Self> {
        if active.count_ones() < 4 {
            return None;
        }
        let (mut direction, mut origin, mut sign) = ([[0.0; 2]; 3], [[0.0; 2]; 3], [0; 3]);
        let (mut fan, mut length, mut base) = (0.0_f32, 0.0_f32, 0.0_f32);
        for axis in 0..3 {
            direction[axis] = extremes(&packet.direction[axis], active);
            origin[axis] = extremes(&packet.origin[axis], active);
            let [least, greatest] = direction[axis];
            if !(least * greatest > 0.0) {
                return None;
            }
            sign[axis] = usize::from(least < 0.0);
            fan = fan.max(greatest - least);
            length = length.max(greatest.abs().min(least.abs()));
            base = base.max(origin[axis][1] - origin[axis][0]);
        }
        if !(fan <= WIDEST * length && base <= WIDEST * size) {
            return None;
        }
        let mut inverse = [[[0.0; 2]; 2]; 3];
        let mut finite = true;
        for axis in 0..3 {
            for which in 0..2 {
                inverse[axis][which] = extremes(&packet.inverse[axis][which], active);
                finite &= inverse[axis][which][0].is_finite() & inverse[axis][which][1].is_finite();
            }
        }
        if finite { Some(Self { origin, inverse, sign, tnear: extremes(&packet.tnear, active)[0] }) } else { None }
    }
}

// A packet's lanes are a node's children.
const _: () = assert!(LANES == WIDTH);
