//! A hit made exact: the point on the shape itself, its normals, and how far a new ray must start from it.
//!
//! What the surface looks like there is in `whitted`.

use glam::Vec3;

use crate::lower::{Part, Shape};

/// A point of a shape that a ray met.
#[derive(Clone, Copy, Debug)]
pub(super) struct Contact {
    /// Position in the local frame (m), on the shape to within rounding.
    pub(super) position: Vec3,
    /// Unit geometric normal, upward or outward.
    pub(super) normal: Vec3,
    /// Unit normal to shade with, on the same side.
    pub(super) shading: Vec3,
    /// Distance (m) off the shape that rounding may have moved the position by, with room for the accelerator's own.
    pub(super) error: f32,
}

/// Units in the last place of the largest coordinate by which positions and hits may be off: three or so for the
/// evaluation here, as many for the subtraction and products inside an accelerator, doubled.
const ULPS: f32 = 12.0 * f32::EPSILON;

impl Contact {
    /// The contact of the ray from `origin` along `direction` at `t` with primitive `primitive` of `part` at `u`, `v`.
    /// `given` is the accelerator's normal, any length.
    #[inline]
    pub(super) fn new(
        part: &Part,
        primitive: u32,
        [u, v]: [f32; 2],
        origin: Vec3,
        direction: Vec3,
        t: f32,
        given: Vec3,
    ) -> Self {
        let along = origin + t * direction;
        let index = primitive as usize;
        match &part.shape {
            Shape::Surface(surface) => {
                let point = surface.patch_point(primitive, u, v);
                Self::on(point.position, point.normal, point.normal, largest(point.position))
            }
            Shape::Displaced(surface) => {
                let point = surface.patch_point(primitive, u, v);
                Self::on(point.position, point.normal, point.normal, largest(point.position))
            }
            // A wall is known by its normal alone; the rounding of the ray's own length stays in its position.
            Shape::Sides(_) => {
                let normal = given.normalize_or(Vec3::Y);
                Self::on(along, normal, normal, largest(along).max(largest(origin)))
            }
            Shape::Spheres(spheres) => {
                let center = spheres.center[index];
                let normal = (along - center).normalize_or(-direction);
                let position = center + spheres.radius[index] * normal;
                Self::on(position, normal, normal, largest(position))
            }
            Shape::Discs(discs) => {
                let (center, radius) = (discs.center[index], discs.radius[index]);
                let axis = discs.normal.as_ref().map(|normal| normal[index]);
                let faces_ray = axis.is_none();
                let axis = axis.unwrap_or_else(|| (origin - center).normalize_or(-direction));
                let offset = along - center;
                let mut offset = offset - axis * offset.dot(axis);
                if faces_ray {
                    // No ray from within the ball meets the disc: where it was met is, after rounding as well.
                    let room = radius * (1.0 - 8.0 * f32::EPSILON) - 4.0 * f32::EPSILON * largest(center);
                    offset = offset.clamp_length_max(room.max(0.0));
                }
                // A billboard stands for a ball: it is shaded as the half that faces the eye.
                let out = offset / radius;
                let shading = (out + axis * (1.0 - out.length_squared()).max(0.0).sqrt()).normalize_or(axis);
                let contact = Self::on(center + offset, axis, shading, largest(center));
                if faces_ray { Self { error: 0.0, ..contact } } else { contact }
            }
            Shape::Curves(curves) => {
                // Moved onto the ball that the curve touches there, in double precision: radii may be far under the
                // last digit of a far hit's place.
                let along = origin.as_dvec3() + f64::from(t) * direction.as_dvec3();
                let (center, radius) = curves.cone(index).ball_under(along);
                let normal = (along - center).normalize_or(-direction.as_dvec3());
                let position = (center + radius * normal).as_vec3();
                let normal = normal.as_vec3();
                Self::on(position, normal, normal, largest(position))
            }
            Shape::Triangles(triangles) => {
                let corners = triangles.index[index].map(|corner| corner as usize);
                let [a, b, c] = corners.map(|corner| triangles.position[corner]);
                let position = a * (1.0 - u - v) + b * u + c * v;
                let normal = (b - a).cross(c - a).normalize_or(given.normalize_or(Vec3::Y));
                let shading = if triangles.normal.is_empty() {
                    normal
                } else {
                    let [a, b, c] = corners.map(|corner| triangles.normal[corner]);
                    let smooth = (a * (1.0 - u - v) + b * u + c * v).normalize_or(normal);
                    if smooth.dot(normal) < 0.0 { -smooth } else { smooth }
                };
                Self::on(position, normal, shading, largest(a).max(largest(b)).max(largest(c)))
            }
        }
    }

    #[inline]
    fn on(position: Vec3, normal: Vec3, shading: Vec3, magnitude: f32) -> Self {
        // At the very origin a position still needs some room: the least normal number times the same count.
        Self { position, normal, shading, error: ULPS * magnitude.max(f32::MIN_POSITIVE) }
    }

    /// Where a ray along `direction` starts so that it does not meet this contact again: off the shape on the side that
    /// it leaves to.
    #[inline]
    pub(super) fn leave(&self, direction: Vec3) -> Vec3 {
        let side = if direction.dot(self.normal) < 0.0 { -self.error } else { self.error };
        self.position + side * self.normal
    }
}

fn largest(point: Vec3) -> f32 {
    point.abs().max_element()
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::lower::{Curves, Material, Spheres, Triangles};

    fn part(shape: Shape) -> Part {
        Part { name: "thing".into(), material: Material::Spray { first: 0 }, shape }
    }

    #[test]
    fn sphere_hits_lie_on_the_sphere_though_the_ray_came_from_far() {
        let center = Vec3::new(3.0, 1.0, -2.0);
        let sphere = part(Shape::Spheres(Arc::new(Spheres { center: vec![center], radius: vec![0.01] })));
        let direction = Vec3::new(0.6, -0.48, 0.64);
        // The hit is off by the rounding of a kilometre, and the contact is not.
        let contact = Contact::new(&sphere, 0, [0.0; 2], center - 1000.0 * direction, direction, 999.9901, Vec3::ZERO);
        assert!(((contact.position - center).length() - 0.01).abs() < 1e-6);
        assert!((contact.normal + direction).length() < 2e-2);
        assert!(contact.error > 0.0 && contact.error < 1e-5);
        let outside = contact.leave(contact.normal);
        assert!((outside - center).length() > 0.01);
        assert!((contact.leave(direction) - center).length() < 0.01);
    }

    #[test]
    fn curve_hits_lie_on_the_curve_though_the_ray_came_from_far() {
        let ends = [Vec3::new(3.0, 1.0, -2.0), Vec3::new(3.0, 1.2, -2.0)];
        let curve = part(Shape::Curves(Arc::new(Curves { ends: vec![ends], radius: vec![[0.01, 0.005]] })));
        let direction = Vec3::new(0.6, -0.48, 0.64);
        let target = Vec3::new(3.0, 1.1, -2.0);
        let contact = Contact::new(&curve, 0, [0.5, 0.0], target - 1000.0 * direction, direction, 999.9901, Vec3::ZERO);
        let across = (contact.position - target) * Vec3::new(1.0, 0.0, 1.0);
        assert!((across.length() - 0.0075).abs() < 2e-4, "{contact:?}");
        // The cone narrows upward: its normal rises by the fall of the radius.
        assert!((contact.normal.y - 0.025).abs() < 1e-3 && contact.normal.is_normalized());
        assert!(contact.normal.dot(direction) < -0.5 && contact.error < 1e-5);
    }

    #[test]
    fn triangle_hits_interpolate_corners_and_keep_normals_on_one_side() {
        let triangles = Triangles {
            position: vec![Vec3::ZERO, Vec3::new(0.0, 0.0, 2.0), Vec3::new(2.0, 0.0, 0.0)],
            normal: vec![Vec3::new(0.6, 0.8, 0.0), Vec3::Y, Vec3::Y],
            index: vec![[0, 1, 2]],
        };
        let flat = part(Shape::Triangles(Arc::new(triangles)));
        let origin = Vec3::new(0.5, 4.0, 1.0);
        let contact = Contact::new(&flat, 0, [0.5, 0.25], origin, Vec3::NEG_Y, 4.0, Vec3::NEG_Y);
        assert!((contact.position - Vec3::new(0.5, 0.0, 1.0)).length() < 1e-6);
        assert_eq!(contact.normal, Vec3::Y);
        assert!(contact.shading.x > 0.0 && contact.shading.is_normalized());
        assert!(contact.leave(Vec3::new(1.0, 1e-6, 0.0)).y > 0.0);
    }

    #[test]
    fn rays_that_leave_a_spline_hit_do_not_meet_it_again_in_place() {
        use crate::{
            accel::{self, HitBatch, NO_PART, RayBatch},
            lower::Lowered,
            scene::{Accel, SolverKind, WaterAccel},
            surface::{Lattice, SimdLevel, SolveCounts, SplineSurface},
        };
        // Columns of 5 cm, near the scene origin and two kilometres off.
        for shift in [0.0, 2000.0] {
            let (count, width) = (40, 0.05);
            let height: Vec<f64> = (0..count * count)
                .map(|i| ((i % count) as f64 * 0.7).sin() * 0.04 + ((i / count) as f64 * 0.4).cos() * 0.05)
                .collect();
            let lattice = Lattice::new(3, [count; 2], [shift; 2], [width; 2], &height, |_| true).unwrap();
            let surface = Arc::new(SplineSurface::new(lattice, SolverKind::Univariate, SimdLevel::detect()));
            let lowered = Lowered {
                parts: vec![Part { material: Material::Water, ..part(Shape::Surface(surface)) }],
                ..Lowered::default()
            };
            let settings = Accel { water: WaterAccel::Brute, ..Accel::default() };
            let accelerator = accel::build(&lowered, &settings, SimdLevel::detect()).unwrap();
            let (mut rays, mut hits, mut counts) = (RayBatch::default(), HitBatch::default(), SolveCounts::default());
            rays.tolerance_growth = 1e-5;
            for index in 0..4000_u32 {
                let [a, b, c, d] = sobol_burley::sample_4d(index, 0, 1);
                let target = Vec3::new(shift as f32 + 0.1 + 1.7 * a, 0.0, shift as f32 + 0.1 + 1.7 * b);
                let towards = Vec3::new(2.0 * c - 1.0, -0.3 - d, 1.0 - 2.0 * d).normalize();
                rays.push(target - 3.0 * towards, towards, 0.0, f32::INFINITY, 0.0);
            }
            accelerator.closest(&rays, &mut hits, &mut counts);
            let mut leaving = RayBatch { tolerance_growth: 1e-5, ..RayBatch::default() };
            for i in 0..rays.len() {
                if hits.part[i] == NO_PART {
                    continue;
                }
                let (origin, direction) = (rays.origin(i), rays.direction(i));
                let place = [hits.u[i], hits.v[i]];
                let contact =
                    Contact::new(&lowered.parts[0], hits.primitive[i], place, origin, direction, hits.t[i], Vec3::Y);
                for new in [direction, direction - 2.0 * direction.dot(contact.normal) * contact.normal] {
                    // A tenth off the tangent plane: waves may rightly meet a flatter ray at once.
                    if new.dot(contact.normal).abs() > 0.1 {
                        leaving.push(contact.leave(new), new, 0.0, f32::INFINITY, 3e-5);
                    }
                }
            }
            assert!(leaving.len() > 6000);
            accelerator.closest(&leaving, &mut hits, &mut counts);
            // From a tenth off the tangent plane, at curvatures of 8 per metre, the next true crossing is over a
            // centimetre away.
            let again = hits.t.iter().filter(|&&t| t < 0.01).count();
            assert_eq!(again, 0, "of {} rays, {shift} m off", leaving.len());
        }
    }
}
