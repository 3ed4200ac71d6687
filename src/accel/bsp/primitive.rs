//! The primitives of a tree: their numbers, their boxes, and their boxes cut to a cell.
//!
//! Boxes are rounded outward: a point of a primitive is never outside of its box.

use glam::{DVec3, Vec3};

use super::super::{AccelError, Geometry};
use crate::math::RoundCone;

/// Numbers that fit: a leaf counts its blocks in 28 bits, nodes count their children in 30, a hit its number plus one in 32.
const MOST: u64 = 1 << 27;

/// A box along the axes, closed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::accel) struct Aabb {
    pub(in crate::accel) low: Vec3,
    pub(in crate::accel) high: Vec3,
}

impl Aabb {
    pub(in crate::accel) const EMPTY: Self = Self { low: Vec3::INFINITY, high: Vec3::NEG_INFINITY };

    pub(in crate::accel) fn union(self, other: Self) -> Self {
        Self { low: self.low.min(other.low), high: self.high.max(other.high) }
    }
    pub(in crate::accel) fn is_empty(self) -> bool {
        !self.low.cmple(self.high).all()
    }
    pub(super) fn intersection(self, other: Self) -> Self {
        Self { low: self.low.max(other.low), high: self.high.min(other.high) }
    }
    /// Below and above a plane.
    pub(super) fn split(self, axis: usize, place: f32) -> [Self; 2] {
        let mut halves = [self, self];
        halves[0].high[axis] = place;
        halves[1].low[axis] = place;
        halves
    }
    /// Half of the surface (m²).
    pub(in crate::accel) fn half_area(self) -> f32 {
        let size = self.high - self.low;
        size.x * size.y + size.y * size.z + size.z * size.x
    }
    /// From double precision, one single step outward: rounding to the nearest is off by half a step at most.
    fn outward(low: DVec3, high: DVec3) -> Self {
        let step = |value: DVec3, next: fn(f32) -> f32| Vec3::from(value.as_vec3().to_array().map(next));
        Self { low: step(low, f32::next_down), high: step(high, f32::next_up) }
    }
}

/// One primitive by value.
#[derive(Clone, Copy, Debug)]
pub(in crate::accel) enum Primitive {
    Sphere {
        center: Vec3,
        radius: f32,
    },
    Disc {
        center: Vec3,
        radius: f32,
        normal: Vec3,
    },
    /// A disc that faces each ray's origin.
    Facing {
        center: Vec3,
        radius: f32,
    },
    Curve {
        ends: [Vec3; 2],
        radius: [f32; 2],
    },
    Triangle([Vec3; 3]),
}

impl Primitive {
    /// A box around it; `None` for what no ray can hit.
    ///
    /// A triangle's grows by `pad` (see [`Objects::pad`]).
    pub(in crate::accel) fn bounds(&self, pad: f64) -> Option<Aabb> {
        let bounds = match *self {
            Self::Sphere { center, radius } | Self::Facing { center, radius } => {
                let reach = DVec3::splat(radius.into());
                (radius > 0.0).then(|| Aabb::outward(center.as_dvec3() - reach, center.as_dvec3() + reach))?
            }
            Self::Disc { center, radius, normal } => {
                let n = normal.as_dvec3();
                let across = DVec3::new(n.y.hypot(n.z), n.z.hypot(n.x), n.x.hypot(n.y)) / n.length();
                // Some roundings of 2^-53 each, so that the box holds where centre and reach cancel.
                let reach = across * f64::from(radius) * (1.0 + 16.0 * f64::EPSILON);
                let usable = radius > 0.0 && normal != Vec3::ZERO && normal.is_finite();
                usable.then(|| Aabb::outward(center.as_dvec3() - reach, center.as_dvec3() + reach))?
            }
            Self::Curve { ends, radius } => {
                let [head, tail] = [0, 1].map(|end| {
                    let (center, reach) = (ends[end].as_dvec3(), DVec3::splat(radius[end].into()));
                    [center - reach, center + reach]
                });
                let usable = radius[0] >= 0.0 && radius[1] >= 0.0 && radius[0].max(radius[1]) > 0.0;
                usable.then(|| Aabb::outward(head[0].min(tail[0]), head[1].max(tail[1])))?
            }
            Self::Triangle(corners) => {
                let [a, b, c] = corners.map(|corner| corner.as_dvec3());
                let finite = corners.iter().all(|corner| corner.is_finite());
                finite.then(|| Aabb::outward(a.min(b).min(c) - pad, a.max(b).max(c) + pad))?
            }
        };
        (bounds.low.is_finite() && bounds.high.is_finite()).then_some(bounds)
    }

    /// A box around what lies in a cell, within `bounds` and the cell; `None` if nothing does.
    pub(super) fn cut(&self, bounds: Aabb, cell: Aabb, pad: f64) -> Option<Aabb> {
        let within = match *self {
            Self::Sphere { center, radius } | Self::Facing { center, radius } => sphere_in(center, radius, cell)?,
            Self::Disc { .. } | Self::Curve { .. } => cell,
            Self::Triangle(corners) => triangle_in(corners, cell, pad)?,
        };
        let within = within.intersection(bounds).intersection(cell);
        (!within.is_empty()).then_some(within)
    }

    /// Geometric normal at a hit, not normalised ([`super::HitBatch`]).
    pub(super) fn normal(&self, origin: Vec3, direction: Vec3, t: f32) -> Vec3 {
        match *self {
            // From the centre rather than from the hit's place, which would lose its last bits far from zero.
            Self::Sphere { center, .. } => t * direction - (center - origin),
            Self::Disc { normal, .. } => normal,
            Self::Facing { center, .. } => origin - center,
            Self::Curve { ends, radius } => {
                let (origin, direction) = (origin.as_dvec3(), direction.as_dvec3());
                let cone = RoundCone::new(ends.map(|end| end.as_dvec3()), radius.map(f64::from));
                let point = origin + f64::from(t) * direction;
                (point - cone.ball_under(point).0).as_vec3()
            }
            Self::Triangle([a, b, c]) => (b - a).cross(c - a),
        }
    }
}

/// The box of a sphere's part in a cell: every point of it is at least as far from the centre, along each axis, as the
/// cell is, which leaves less of the radius for the other two.
fn sphere_in(center: Vec3, radius: f32, cell: Aabb) -> Option<Aabb> {
    let center = center.as_dvec3();
    let away = (cell.low.as_dvec3() - center).max(center - cell.high.as_dvec3()).max(DVec3::ZERO);
    let away = away * away;
    // Outward by more than the few roundings of this function.
    let radius = f64::from(radius) * (1.0 + 16.0 * f64::EPSILON);
    let left = DVec3::splat(radius * radius - away.element_sum()) + away;
    if left.min_element() < 0.0 {
        return None;
    }
    let reach = DVec3::new(left.x.sqrt(), left.y.sqrt(), left.z.sqrt()) * (1.0 + 16.0 * f64::EPSILON);
    Some(Aabb::outward(center - reach, center + reach))
}

/// The box of a triangle's part in a cell, both grown by `pad`: Sutherland and Hodgman, Reentrant polygon clipping, 1974.
fn triangle_in(corners: [Vec3; 3], cell: Aabb, pad: f64) -> Option<Aabb> {
    // Each of six planes adds one corner at most.
    let mut polygon = [DVec3::ZERO; 9];
    let mut count = 3;
    for (to, corner) in polygon.iter_mut().zip(corners) {
        *to = corner.as_dvec3();
    }
    for axis in 0..3 {
        for (sign, place) in [(1.0, f64::from(cell.low[axis]) - pad), (-1.0, f64::from(cell.high[axis]) + pad)] {
            let (from, from_count) = (polygon, count);
            count = 0;
            for k in 0..from_count {
                let (here, next) = (from[k], from[(k + 1) % from_count]);
                let (inside, next_inside) = (sign * (here[axis] - place), sign * (next[axis] - place));
                let mut push = |point| {
                    polygon[count] = point;
                    count += 1;
                };
                if inside >= 0.0 {
                    push(here);
                }
                if (inside < 0.0) != (next_inside < 0.0) {
                    push(here + (next - here) * (inside / (inside - next_inside)));
                }
            }
        }
    }
    let (low, high) = polygon[..count]
        .iter()
        .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), &point| (low.min(point), high.max(point)));
    (count > 0).then(|| Aabb::outward(low - pad, high + pad))
}

/// Every primitive of some geometry, numbered through.
pub(super) struct Objects {
    geometry: Vec<(u32, Geometry)>,
    /// The number of each geometry's first primitive, then the count of all.
    first: Vec<u32>,
    /// What triangles' boxes grow by (m).
    ///
    /// Two triangles share an edge; beside it, single precision may give a ray to the one whose side it is not on. The edge
    /// test's error is under 8 units of 2^-24 of the distance to the edge (its three vertices, differences, products and sums
    /// each add one half to one), so that boxes grown by that much are visited by every ray which begins no farther from the
    /// triangles than they reach across.
    pad: f64,
}

impl Objects {
    /// Takes geometry that [`super::super::check`] has passed.
    pub(super) fn new(geometry: Vec<(u32, Geometry)>) -> Result<Self, AccelError> {
        let (mut first, mut count) = (vec![0], 0_u64);
        let mut reach = Aabb::EMPTY;
        for (part, geometry) in &geometry {
            count += match geometry {
                Geometry::Lanes(_) => return Err(AccelError::Surface { part: *part }),
                Geometry::Spheres(spheres) => spheres.center.len(),
                Geometry::Discs(discs) => discs.center.len(),
                Geometry::Curves(curves) => curves.ends.len(),
                Geometry::Triangles(mesh) => {
                    for &place in mesh.position.iter().filter(|place| place.is_finite()) {
                        reach = reach.union(Aabb { low: place, high: place });
                    }
                    mesh.index.len()
                }
            } as u64;
            if count > MOST {
                return Err(AccelError::TooMany { count, most: MOST });
            }
            first.push(count as u32);
        }
        let across = if reach.is_empty() { 0.0 } else { (reach.high.as_dvec3() - reach.low.as_dvec3()).length() };
        Ok(Self { geometry, first, pad: across * f64::from(f32::EPSILON) * 4.0 })
    }

    pub(super) fn geometry(&self) -> &[(u32, Geometry)] {
        &self.geometry
    }

    pub(super) fn count(&self) -> u32 {
        self.first[self.geometry.len()]
    }

    pub(super) fn pad(&self) -> f64 {
        self.pad
    }

    /// Which geometry a number belongs to, and which of its primitives it is.
    fn place(&self, number: u32) -> (usize, usize) {
        let geometry = self.first.partition_point(|&first| first <= number) - 1;
        (geometry, (number - self.first[geometry]) as usize)
    }

    /// Part and primitive of a number, as hits name them.
    pub(super) fn name(&self, number: u32) -> (u32, u32) {
        let (geometry, index) = self.place(number);
        (self.geometry[geometry].0, index as u32)
    }

    pub(super) fn get(&self, number: u32) -> Primitive {
        let (geometry, index) = self.place(number);
        match &self.geometry[geometry].1 {
            Geometry::Spheres(spheres) => {
                Primitive::Sphere { center: spheres.center[index], radius: spheres.radius[index] }
            }
            Geometry::Discs(discs) => {
                let (center, radius) = (discs.center[index], discs.radius[index]);
                match &discs.normal {
                    Some(normal) => Primitive::Disc { center, radius, normal: normal[index] },
                    None => Primitive::Facing { center, radius },
                }
            }
            Geometry::Curves(curves) => Primitive::Curve { ends: curves.ends[index], radius: curves.radius[index] },
            Geometry::Triangles(mesh) => {
                Primitive::Triangle(mesh.index[index].map(|corner| mesh.position[corner as usize]))
            }
            Geometry::Lanes(_) => unreachable!("Objects::new refuses surfaces"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::testing::Random;
    use super::*;

    /// Points of a primitive, seeded.
    fn points(primitive: &Primitive, random: &mut Random) -> Vec<DVec3> {
        (0..200)
            .map(|_| match *primitive {
                Primitive::Sphere { center, radius } | Primitive::Facing { center, radius } => {
                    center.as_dvec3() + random.vector(1.0).as_dvec3().normalize_or(DVec3::X) * f64::from(radius)
                }
                Primitive::Disc { center, radius, normal } => {
                    let along = random.vector(1.0).as_dvec3().cross(normal.as_dvec3()).normalize_or(DVec3::ZERO);
                    center.as_dvec3() + along * f64::from(radius)
                }
                Primitive::Curve { ends, radius } => {
                    let s = f64::from(random.unit());
                    let mix = |a: f32, b: f32| f64::from(a) + s * (f64::from(b) - f64::from(a));
                    let center = ends[0].as_dvec3().lerp(ends[1].as_dvec3(), s);
                    center + random.vector(1.0).as_dvec3().normalize_or(DVec3::X) * mix(radius[0], radius[1])
                }
                Primitive::Triangle(corners) => {
                    let [a, b, c] = corners.map(|corner| corner.as_dvec3());
                    let (u, v) = (f64::from(random.unit()), f64::from(random.unit()));
                    let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
                    a + (b - a) * u + (c - a) * v
                }
            })
            .collect()
    }

    fn holds(bounds: Aabb, point: DVec3) -> bool {
        // The sampled points themselves are rounded to 2^-53.
        let slack = DVec3::splat(1e-12);
        bounds.low.as_dvec3().cmple(point + slack).all() && bounds.high.as_dvec3().cmpge(point - slack).all()
    }

    #[test]
    fn boxes_and_cut_boxes_hold_their_primitive_and_cutting_pays() {
        let mut random = Random(5);
        let (mut dropped, mut smaller, mut uncut) = ([0; 4], [0.0; 4], [0.0; 4]);
        for _ in 0..300 {
            let (center, radius) = (random.vector(100.0), 0.1 + random.unit());
            let normal = random.vector(1.0);
            let near = |random: &mut Random| center + random.vector(1.0);
            let corners = [near(&mut random), near(&mut random), near(&mut random)];
            let primitives = [
                Primitive::Sphere { center, radius },
                Primitive::Disc { center, radius, normal },
                Primitive::Triangle(corners),
                Primitive::Curve { ends: [center, center + random.vector(2.0)], radius: [radius, 0.3 * radius] },
            ];
            let (a, b) = (center + random.vector(1.5), center + random.vector(1.5));
            let cell = Aabb { low: a.min(b), high: a.max(b) };
            for (kind, primitive) in primitives.iter().enumerate() {
                let bounds = primitive.bounds(1e-5).unwrap();
                let cut = primitive.cut(bounds, cell, 1e-5);
                let plain = bounds.intersection(cell);
                if !plain.is_empty() {
                    dropped[kind] += i32::from(cut.is_none());
                    uncut[kind] += f64::from(plain.half_area());
                    smaller[kind] += cut.map_or(0.0, |cut| f64::from(cut.half_area()));
                }
                for point in points(primitive, &mut random) {
                    assert!(holds(bounds, point), "{primitive:?} {point}");
                    if holds(cell, point) {
                        assert!(cut.is_some_and(|cut| holds(cut, point)), "{primitive:?} {cell:?} {cut:?} {point}");
                    }
                }
            }
        }
        assert!(dropped[0] > 5 && dropped[1] == 0 && dropped[2] > 10, "{dropped:?}");
        assert!(smaller[0] < 0.95 * uncut[0] && smaller[2] < 0.8 * uncut[2], "{smaller:?} of {uncut:?}");
    }

    #[test]
    fn what_no_ray_can_hit_has_no_box() {
        let (center, normal) = (Vec3::ONE, Vec3::Y);
        for primitive in [
            Primitive::Sphere { center, radius: 0.0 },
            Primitive::Sphere { center, radius: f32::NAN },
            Primitive::Sphere { center: Vec3::INFINITY, radius: 1.0 },
            Primitive::Disc { center, radius: -1.0, normal },
            Primitive::Disc { center, radius: 1.0, normal: Vec3::ZERO },
            Primitive::Disc { center, radius: 1.0, normal: Vec3::NAN },
            Primitive::Triangle([center, Vec3::NAN, center]),
            Primitive::Curve { ends: [center, Vec3::NAN], radius: [1.0; 2] },
            Primitive::Curve { ends: [center; 2], radius: [0.0; 2] },
            Primitive::Curve { ends: [center; 2], radius: [1.0, -1.0] },
        ] {
            assert_eq!(primitive.bounds(0.0), None, "{primitive:?}");
        }
        let point = Primitive::Triangle([center; 3]).bounds(0.0).unwrap();
        assert!(point.low.cmplt(center).all() && point.high.cmpgt(center).all());
    }
}
