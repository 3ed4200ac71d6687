//! How wide a ray is: a cone from the pixel on, for what textures are averaged over.
//!
//! Ray differentials (H. Igehy, Tracing ray differentials, 1999) reduced to one width and one angle that is the same all around
//! (T. Akenine-Möller et al., Improved shader and texture level of detail using ray cones, 2021). What happens to it at the
//! water follows from how much the normal turns over what the cone covers there.

use glam::Vec3;

use super::contact::Contact;
use crate::lower::{Part, Shape, Triangles};

/// A cone about a ray, from edge to edge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Cone {
    /// By how much it grows (m per metre travelled).
    pub(super) angle: f32,
    /// Its width (m) where no metre has been travelled, if it had always had this angle.
    start: f32,
}

impl Cone {
    /// That of a pixel of a pinhole.
    pub(super) fn pixel(angle: f32) -> Self {
        Self { angle, start: 0.0 }
    }

    /// Width (m) so many metres after the eye.
    #[inline]
    pub(super) fn width(&self, distance: f32) -> f32 {
        // It never narrows, but for rounding.
        (self.start + self.angle * distance).max(0.0)
    }

    /// As wide at a distance, but of another angle from there.
    #[inline]
    fn turned(self, distance: f32, angle: f32) -> Self {
        Self { angle, start: self.width(distance) - angle * distance }
    }

    /// Mirrored at a distance, by a surface whose normal turns by `bend` over what the cone covers.
    #[inline]
    pub(super) fn mirrored(self, distance: f32, bend: f32) -> Self {
        self.turned(distance, self.angle + 2.0 * bend)
    }

    /// Refracted at a distance into what is `eta` times as dense to light, to first order in the angles about the normal.
    #[inline]
    pub(super) fn refracted(self, distance: f32, bend: f32, eta: f32) -> Self {
        self.turned(distance, (self.angle + (eta - 1.0).abs() * bend) / eta)
    }

    /// What a cone covers of a flat surface: two vectors across it, the first along the ray.
    pub(super) fn spans(&self, distance: f32, direction: Vec3, normal: Vec3) -> [Vec3; 2] {
        let width = self.width(distance);
        let cosine = direction.dot(normal);
        let across = normal.cross(direction).normalize_or(normal.any_orthonormal_vector());
        let along = across.cross(normal);
        // A ray that only grazes covers all there is; the texture knows that end.
        [along * (width / cosine.abs().max(f32::EPSILON)), across * width]
    }
}

/// By how much the normal of smooth water turns over what a cone of `width` (m) covers of it: root mean square over all
/// directions on it, and the area that is covered as if it were round. 0 for what is flat.
pub(super) fn bend(
    part: &Part,
    primitive: u32,
    place: [f32; 2],
    contact: &Contact,
    direction: Vec3,
    width: f32,
) -> f32 {
    let curvature = match &part.shape {
        Shape::Surface(surface) => of_patch(place, |u, v| {
            let point = surface.patch_point(primitive, u, v);
            (point.position, point.normal)
        }),
        Shape::Displaced(surface) => of_patch(place, |u, v| {
            let point = surface.patch_point(primitive, u, v);
            (point.position, point.normal)
        }),
        Shape::Spheres(spheres) => spheres.radius[primitive as usize].recip(),
        Shape::Triangles(triangles) => of_triangle(triangles, primitive),
        Shape::Sides(_) | Shape::Discs(_) | Shape::Curves(_) => 0.0,
    };
    let cosine = direction.dot(contact.normal).abs().max(f32::EPSILON);
    // Beyond a right angle the cone sees everything anyway.
    let bend = curvature * width / cosine.sqrt();
    if bend.is_finite() { bend.min(std::f32::consts::FRAC_PI_2) } else { 0.0 }
}

/// Curvature (1/m) of a patch: by how much its normal turns over a 64th of it, which single precision tells well.
fn of_patch([u, v]: [f32; 2], point: impl Fn(f32, f32) -> (Vec3, Vec3)) -> f32 {
    const STEP: f32 = 1.0 / 64.0;
    let inward = |place: f32| if place < 0.5 { place + STEP } else { place - STEP };
    let here = point(u, v);
    root_mean_square([point(inward(u), v), point(u, inward(v))].map(|there| turn(here, there)))
}

fn of_triangle(triangles: &Triangles, primitive: u32) -> f32 {
    if triangles.normal.is_empty() {
        return 0.0;
    }
    let corners = triangles.index[primitive as usize].map(|corner| corner as usize);
    let [a, b, c] = corners.map(|corner| (triangles.position[corner], triangles.normal[corner].normalize_or_zero()));
    root_mean_square([turn(a, b), turn(b, c), turn(c, a)])
}

/// Turn of the normal to a metre of way between two points.
fn turn(here: (Vec3, Vec3), there: (Vec3, Vec3)) -> f32 {
    let way = (there.0 - here.0).length();
    if way > 0.0 { (there.1 - here.1).length() / way } else { 0.0 }
}

fn root_mean_square<const N: usize>(values: [f32; N]) -> f32 {
    (values.into_iter().map(|value| value * value).sum::<f32>() / N as f32).sqrt()
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::super::tests::{ball, level, mesh, part, waves};
    use super::*;
    use crate::lower::Material;

    #[test]
    fn a_cone_grows_with_the_way_and_turns_where_it_is_mirrored_or_refracted() {
        let pixel = Cone::pixel(0.001);
        assert_eq!(pixel.width(20.0), 20.0 * 0.001);
        let mirrored = pixel.mirrored(20.0, 0.05);
        assert!((mirrored.width(20.0) - 0.02).abs() < 1e-6 && (mirrored.width(21.0) - 0.121).abs() < 1e-6);
        // Level water narrows it by Snell, and gives it back on the way out.
        let below = pixel.refracted(20.0, 0.0, 1.333);
        assert!((below.width(21.333) - 0.021).abs() < 1e-6);
        assert!((below.refracted(21.333, 0.0, 1.0 / 1.333).angle - 0.001).abs() < 1e-8);
    }

    #[test]
    fn on_the_ground_it_is_stretched_by_the_slant() {
        let cone = Cone::pixel(0.01);
        let direction = Vec3::new(3.0, -4.0, 0.0).normalize();
        let [along, across] = cone.spans(10.0, direction, Vec3::Y);
        assert!((along.length() - 0.125).abs() < 1e-6 && along.normalize().x.abs() > 0.9999, "{along}");
        assert!((across.length() - 0.1).abs() < 1e-6 && across.normalize().z.abs() > 0.9999, "{across}");
        let [along, across] = cone.spans(10.0, -Vec3::Y, Vec3::Y);
        assert!((along.length() - 0.1).abs() < 1e-6 && (across.length() - 0.1).abs() < 1e-6);
        assert!(cone.spans(1.0, Vec3::X, Vec3::Y)[0].is_finite());
    }

    #[test]
    fn the_bend_is_the_curvature_by_the_width() {
        let contact = |position: Vec3| Contact { position, normal: Vec3::Y, shading: Vec3::Y, error: 0.0 };
        let down = -Vec3::Y;
        let ball = part("ball", Material::Water, ball(Vec3::ZERO, 0.5));
        assert!((bend(&ball, 0, [0.0; 2], &contact(Vec3::new(0.0, 0.5, 0.0)), down, 0.01) - 0.02).abs() < 1e-6);
        let flat = part("flat", Material::Water, mesh(level(0.0, 1.0)));
        assert_eq!(bend(&flat, 0, [0.2; 2], &contact(Vec3::ZERO), down, 0.01), 0.0);
        // y = x^2 / 4: a spline of order 3 is that parabola, of curvature 1/2 along x, in its middle.
        let surface = waves(9, 0.25, |x, _| 0.25 * x * x);
        let trough = part("trough", Material::Water, Shape::Surface(Arc::clone(&surface)));
        let cells = surface.lattice().cells;
        let middle = (cells[0] / 2 + cells[1] / 2 * cells[0]) as u32;
        let seen = bend(&trough, middle, [0.5; 2], &contact(Vec3::ZERO), down, 0.01);
        assert!((seen - 0.005 * std::f32::consts::FRAC_1_SQRT_2).abs() < 1e-4, "{seen}");
        // A slanting ray covers more, everything at most.
        let slanting = bend(&trough, middle, [0.5; 2], &contact(Vec3::ZERO), Vec3::new(0.0, -0.25, 0.968), 0.01);
        assert!((slanting / seen - 2.0).abs() < 1e-3);
        assert!(bend(&ball, 0, [0.0; 2], &contact(Vec3::Y), Vec3::X, 1e9) <= 1.6);
    }
}
