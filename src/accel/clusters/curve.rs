//! Up to sixteen round curves, and the test of rays against them, in the lanes as in [`super::cluster`].
//!
//! A curve is the hull of its two balls ([`crate::math::RoundCone`], whose expressions these are in single precision): a
//! line's stay in it reaches from the first crossing of either ball or of the cone between them to the last. Embree's own
//! round curves lose those without length, those with one ball inside of the other, and all under a millimetre, where
//! fourth powers of lengths leave single precision.

use glam::{DVec3, Vec3};

use super::WIDTH;
use super::build::Record;
use super::cluster::{Cluster, Rays, dot, less, loaded, splat};
use crate::lower::Curves;
use crate::math::RoundCone;
use crate::simd::Simd;

/// Round curves.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(super) struct CurveCluster {
    /// Balls around the curves.
    center: [[f32; WIDTH]; 3],
    reach: [f32; WIDTH],
    head: [[f32; WIDTH]; 3],
    tail: [[f32; WIDTH]; 3],
    radius: [[f32; WIDTH]; 2],
    /// Unit, from head to tail; with a length of 0, any.
    axis: [[f32; WIDTH]; 3],
    length: [f32; WIDTH],
    /// What the radius falls by per metre of axis.
    lean: [f32; WIDTH],
    number: [u32; WIDTH],
}

/// Curves in lanes, or one in all of them.
struct Lanes<S: Simd> {
    center: [S::F; 3],
    reach: S::F,
    head: [S::F; 3],
    tail: [S::F; 3],
    radius: [S::F; 2],
    axis: [S::F; 3],
    length: S::F,
    lean: S::F,
}

/// The ball around a curve: its middle, and how far the curve reaches from there.
pub(super) fn ball_around(curves: &Curves, index: usize) -> (Vec3, f32) {
    let ([head, tail], [a, b]) = (curves.ends[index].map(|end| end.as_dvec3()), curves.radius[index]);
    let middle = (head + tail) * 0.5;
    (middle.as_vec3(), ((head - middle).length() + f64::from(a.max(b))) as f32)
}

impl CurveCluster {
    // A radius that is not a number is never reached.
    const NONE: Self = Self {
        center: [[0.0; WIDTH]; 3],
        reach: [f32::NAN; WIDTH],
        head: [[0.0; WIDTH]; 3],
        tail: [[0.0; WIDTH]; 3],
        radius: [[f32::NAN; WIDTH]; 2],
        axis: [[0.0; WIDTH]; 3],
        length: [0.0; WIDTH],
        lean: [0.0; WIDTH],
        number: [0; WIDTH],
    };

    /// Takes curve `record.number`.
    pub(super) fn put(&mut self, slot: usize, record: &Record, curves: &Curves) {
        let index = record.number as usize;
        let ([mut head, mut tail], mut radius) = (curves.ends[index], curves.radius[index]);
        let between = tail.as_dvec3() - head.as_dvec3();
        let (fall, length) = (f64::from(radius[0]) - f64::from(radius[1]), between.length());
        // One ball inside of the other: the greater one is all.
        let cone = length > fall.abs();
        if !cone {
            let greater = usize::from(fall < 0.0);
            (head, tail) = ([head, tail][greater], [head, tail][greater]);
            radius = [radius[greater]; 2];
        }
        let axis = if cone { between / length } else { DVec3::X };
        for k in 0..3 {
            self.center[k][slot] = record.center[k];
            self.head[k][slot] = head[k];
            self.tail[k][slot] = tail[k];
            self.axis[k][slot] = axis[k] as f32;
        }
        for end in 0..2 {
            self.radius[end][slot] = radius[end];
        }
        self.reach[slot] = record.radius;
        self.length[slot] = if cone { length as f32 } else { 0.0 };
        self.lean[slot] = if cone { (fall / length) as f32 } else { 0.0 };
        self.number[slot] = record.number;
    }

    fn cone(&self, slot: usize) -> RoundCone {
        let end = |axes: &[[f32; WIDTH]; 3]| Vec3::from(axes.each_ref().map(|axis| axis[slot])).as_dvec3();
        let radius = self.radius.each_ref().map(|radius| f64::from(radius[slot]));
        RoundCone::new([end(&self.head), end(&self.tail)], radius)
    }
}

/// A line's first and last crossing so far.
struct Stay<S: Simd> {
    entry: S::F,
    exit: S::F,
}

impl<S: Simd> Stay<S> {
    /// Adds crossings where they are ones.
    #[inline(always)]
    fn add(&mut self, s: S, is: S::M, first: S::F, last: S::F) {
        self.entry = s.min(s.select(is, first, s.splat(f32::INFINITY)), self.entry);
        self.exit = s.max(s.select(is, last, s.splat(f32::NEG_INFINITY)), self.exit);
    }

    #[inline(always)]
    fn add_ball(&mut self, s: S, to_center: [S::F; 3], radius: S::F, rays: &Rays<S>) {
        let middle = dot(s, to_center, rays.direction) * rays.inverse_squared;
        let away = along(s, rays.direction, s.splat(0.0) - middle, to_center);
        let miss = dot(s, away, away);
        let squared = radius * radius;
        let half = s.sqrt(s.max((squared - miss) * rays.inverse_squared, s.splat(0.0)));
        self.add(s, s.le(miss, squared), middle - half, middle + half);
    }
}

/// `from` + `by` times `direction`.
#[inline(always)]
fn along<S: Simd>(s: S, direction: [S::F; 3], by: S::F, from: [S::F; 3]) -> [S::F; 3] {
    [s.fma(direction[0], by, from[0]), s.fma(direction[1], by, from[1]), s.fma(direction[2], by, from[2])]
}

/// The entry, or the exit where the entry lies before the interval.
#[inline(always)]
fn test<S: Simd>(s: S, curve: &Lanes<S>, rays: &Rays<S>) -> (S::M, S::F) {
    let zero = s.splat(0.0);
    // The ball around it first: most curves of a cluster are far from the line. Its own rounding, a few parts of its
    // radius and place, must not cost a curve.
    let to_middle = less::<S>(curve.center, rays.origin);
    let middle = dot(s, to_middle, rays.direction) * rays.inverse_squared;
    let away = along(s, rays.direction, zero - middle, to_middle);
    let size = s.abs(curve.center[0])
        + s.abs(curve.center[1])
        + s.abs(curve.center[2])
        + s.abs(to_middle[0])
        + s.abs(to_middle[1])
        + s.abs(to_middle[2]);
    let reach = s.fma(curve.reach + size, s.splat(8.0 * f32::EPSILON), curve.reach);
    let near = s.le(dot(s, away, away), reach * reach);
    if s.none(near) {
        return (near, zero);
    }

    let mut stay = Stay { entry: s.splat(f32::INFINITY), exit: s.splat(f32::NEG_INFINITY) };
    let to_head = less::<S>(curve.head, rays.origin);
    let [a, b] = curve.radius;
    stay.add_ball(s, to_head, a, rays);
    stay.add_ball(s, less::<S>(curve.tail, rays.origin), b, rays);

    // As `RoundCone::crossing`: from where line and axis are nearest each other, within the ball around the curve. NaN of
    // parallel ones leaves the interval's beginning.
    let lean = curve.lean;
    let square = s.splat(1.0) - lean * lean;
    let rate = dot(s, rays.direction, curve.axis);
    let across_rate = along(s, curve.axis, zero - rate, rays.direction);
    let across_squared = dot(s, across_rate, across_rate);
    let room = curve.reach * s.sqrt(rays.inverse_squared);
    let shift = s.min(s.max(dot(s, to_head, across_rate) / across_squared, middle - room), middle + room);
    let point = along(s, rays.direction, shift, [zero - to_head[0], zero - to_head[1], zero - to_head[2]]);
    let x = dot(s, point, curve.axis);
    let across = along(s, curve.axis, zero - x, point);
    let high = a - lean * x;
    let qa = square * across_squared - lean * lean * rate * rate;
    let qb = square * dot(s, across, across_rate) + lean * high * rate;
    let qc = square * dot(s, across, across) - high * high;
    let under = qb * qb - qa * qc;
    let root = s.sqrt(s.max(under, zero));
    let q = zero - (qb + s.flip_by_sign(root, qb));
    let crosses = near & s.le(zero, under);
    let scale = s.splat(1.0) / (curve.length * square);
    for step in [q / qa, qc / q] {
        // Not a number or infinite where there is no cone, or no crossing: which no comparison accepts.
        let place = (x + rate * step - a * lean) * scale;
        let t = shift + step;
        stay.add(s, crosses & s.le(zero, place) & s.le(place, s.splat(1.0)), t, t);
    }
    let t = s.select(s.le(rays.tnear, stay.entry), stay.entry, stay.exit);
    (near & s.le(stay.entry, stay.exit) & s.le(rays.tnear, t), t)
}

impl Cluster for CurveCluster {
    const EMPTY: Self = Self::NONE;

    #[inline(always)]
    fn hits<S: Simd>(&self, s: S, from: usize, ray: &Rays<S>) -> (S::M, S::F) {
        let curve = Lanes {
            center: loaded(s, &self.center, from),
            reach: s.load(&self.reach[from..]),
            head: loaded(s, &self.head, from),
            tail: loaded(s, &self.tail, from),
            radius: [s.load(&self.radius[0][from..]), s.load(&self.radius[1][from..])],
            axis: loaded(s, &self.axis, from),
            length: s.load(&self.length[from..]),
            lean: s.load(&self.lean[from..]),
        };
        test(s, &curve, ray)
    }
    #[inline(always)]
    fn hits_on<S: Simd>(&self, s: S, slot: usize, rays: &Rays<S>) -> (S::M, S::F) {
        let curve = Lanes {
            center: splat(s, &self.center, slot),
            reach: s.splat(self.reach[slot]),
            head: splat(s, &self.head, slot),
            tail: splat(s, &self.tail, slot),
            radius: [s.splat(self.radius[0][slot]), s.splat(self.radius[1][slot])],
            axis: splat(s, &self.axis, slot),
            length: s.splat(self.length[slot]),
            lean: s.splat(self.lean[slot]),
        };
        test(s, &curve, rays)
    }
    #[inline(always)]
    fn center(&self) -> &[[f32; WIDTH]; 3] {
        &self.center
    }
    #[inline(always)]
    fn radius(&self) -> &[f32; WIDTH] {
        &self.reach
    }
    #[inline(always)]
    fn number(&self, slot: usize) -> u32 {
        self.number[slot]
    }
    fn normal(&self, slot: usize, origin: Vec3, direction: Vec3, t: f32) -> Vec3 {
        let point = origin.as_dvec3() + f64::from(t) * direction.as_dvec3();
        (point - self.cone(slot).ball_under(point).0).as_vec3()
    }
    fn along(&self, slot: usize, origin: Vec3, direction: Vec3, t: f32) -> f32 {
        self.cone(slot).along(origin.as_dvec3() + f64::from(t) * direction.as_dvec3()) as f32
    }
}
