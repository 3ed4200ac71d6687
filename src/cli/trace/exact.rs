//! Hits in double precision: a ray as it was given against a part as the files have it.
//!
//! The accelerator says which primitive a ray hits first and about where; here that hit is moved onto the primitive
//! itself: the spline over the files' own heights by Newton's method, everything else by its closed form. Nothing here
//! searches a scene.

use std::sync::Arc;

use glam::DVec3;

use crate::lower::{Curves, Discs, Environment, LoweredFrame, Shape, Spheres, Triangles};
use crate::scene::Surface;
use crate::state::Columns;
use crate::surface::{DisplacedSurface, Lattice, SplineSurface, basis, control, referee};
use crate::terrain::Mesh;

/// A ray around the scene origin. Its direction is the given one times a power of two that brings its largest component
/// to 1..2, so that neither tiny nor huge directions leave the range of single precision and no bit is lost.
#[derive(Clone, Copy, Debug)]
pub(super) struct LocalRay {
    /// Origin (m).
    pub(super) origin: DVec3,
    /// Direction, of a length from 1 to 2 sqrt(3).
    pub(super) direction: DVec3,
    /// The direction as given is this one times 2^exponent.
    exponent: i32,
}

impl LocalRay {
    /// From the files' frame; `direction` is finite and not zero.
    pub(super) fn new(origin: [f64; 3], direction: [f64; 3], scene_origin: DVec3) -> Self {
        let direction = DVec3::from_array(direction);
        let exponent = exponent(direction.abs().max_element());
        let scaled = direction.to_array().map(|component| scale(component, -exponent));
        Self { origin: DVec3::from_array(origin) - scene_origin, direction: scaled.into(), exponent }
    }

    /// t along the direction as given → along ours.
    pub(super) fn to_local(self, t: f64) -> f64 {
        scale(t, self.exponent)
    }

    /// t along our direction → along the one given. A hit so far in lengths of a tiny direction that no number holds it
    /// has the greatest finite t: it is still a hit.
    pub(super) fn to_given(self, t: f64) -> f64 {
        scale(t, -self.exponent).min(f64::MAX)
    }
}

/// The power of two at or below a positive number.
fn exponent(value: f64) -> i32 {
    let biased = |value: f64| (value.to_bits() >> 52) as i32;
    match biased(value) {
        // Denormals carry no exponent of their own.
        0 => biased(value * 2f64.powi(64)) - 64 - 1023,
        biased => biased - 1023,
    }
}

/// `value` times 2^exponent, in two steps: 2^1074 by itself is no number.
fn scale(value: f64, exponent: i32) -> f64 {
    let half = exponent / 2;
    value * 2f64.powi(half) * 2f64.powi(exponent - half)
}

/// A polished hit.
#[derive(Clone, Copy, Debug)]
pub(super) struct Polished {
    /// t along the local ray.
    pub(super) t: f64,
    /// Normal, not normalised.
    pub(super) normal: DVec3,
}

/// A part in double precision.
pub(super) enum Exact<'a> {
    /// The water or the bed.
    Spline(ExactSpline),
    /// The water with displaced control points, which is double precision by itself.
    Displaced(Arc<DisplacedSurface>),
    /// The water's walls: least and greatest x, z of the domain.
    Walls([[f64; 2]; 2]),
    /// Spheres that are single precision by themselves.
    Spheres(Arc<Spheres>),
    /// A sphere of the model file.
    Ball { center: DVec3, radius: f64 },
    /// Discs.
    Discs(Arc<Discs>),
    /// Round curves.
    Curves(Arc<Curves>),
    /// Triangles made from the water.
    Triangles(Arc<Triangles>),
    /// A mesh of a file and the scene origin.
    Mesh(&'a Mesh, DVec3),
}

impl<'a> Exact<'a> {
    /// Every part of a lowered frame, in its order.
    pub(super) fn parts(
        lowered: &LoweredFrame,
        environment: &'a Environment,
        columns: &Columns,
        settings: &Surface,
    ) -> Vec<Self> {
        let origin = lowered.lowered.origin;
        let parts = &lowered.lowered.parts;
        // The environment is lowered last: its spheres, then its meshes.
        let first_mesh = parts.len() - environment.meshes.len();
        let first_sphere = first_mesh - environment.spheres.len();
        let wet = control::wet(columns, settings.dry_threshold);
        let spline = |surface: &Arc<SplineSurface>, heights: &[f64]| {
            let heights = heights.iter().map(|height| height - origin.y).collect();
            ExactSpline { surface: Arc::clone(surface), heights, size: [columns.nx, columns.nz] }
        };
        let same = |surface: &Arc<SplineSurface>, other: &Option<Arc<SplineSurface>>| {
            other.as_ref().is_some_and(|other| Arc::ptr_eq(surface, other))
        };
        (0..)
            .zip(parts)
            .map(|(index, part)| match &part.shape {
                _ if index >= first_mesh => Self::Mesh(&environment.meshes[index - first_mesh].1, origin),
                _ if index >= first_sphere => {
                    let sphere = &environment.spheres[index - first_sphere];
                    Self::Ball { center: DVec3::from_array(sphere.center) - origin, radius: sphere.radius }
                }
                Shape::Surface(surface) if same(surface, &lowered.water) => {
                    let depth = control::dry_depth(columns, settings);
                    Self::Spline(spline(surface, &control::water_heights(columns, &wet, depth)))
                }
                Shape::Surface(surface) => Self::Spline(spline(surface, &columns.base)),
                Shape::Displaced(surface) => Self::Displaced(Arc::clone(surface)),
                Shape::Sides(_) => {
                    let corners = lowered.water.as_ref().map(|water| water.lattice());
                    Self::Walls(corners.map_or([[0.0; 2]; 2], |lattice| lattice.domain.map(|c| lattice.from_cell(c))))
                }
                Shape::Spheres(spheres) => Self::Spheres(Arc::clone(spheres)),
                Shape::Discs(discs) => Self::Discs(Arc::clone(discs)),
                Shape::Curves(curves) => Self::Curves(Arc::clone(curves)),
                Shape::Triangles(triangles) => Self::Triangles(Arc::clone(triangles)),
            })
            .collect()
    }

    /// The hit on `primitive` that the accelerator found at `t` with `normal`; `begin` is where it began to look.
    pub(super) fn polish(&self, ray: &LocalRay, begin: f64, t: f64, primitive: u32, normal: DVec3) -> Polished {
        let (o, d) = (ray.origin, ray.direction);
        let index = primitive as usize;
        let plane = |point: DVec3, normal: DVec3| {
            let exact = (point - o).dot(normal) / d.dot(normal);
            Polished { t: if exact.is_finite() { exact } else { t }, normal }
        };
        match self {
            Self::Spline(spline) => spline.polish(ray, t),
            Self::Displaced(surface) => {
                let reach = displaced_reach(surface);
                let range = [(t - reach).max(begin), t + reach];
                let hit = surface.first_hit(o, d, range);
                hit.map_or(Polished { t, normal }, |hit| Polished { t: hit.t, normal: hit.normal })
            }
            Self::Walls(domain) => {
                let axis = if normal.x != 0.0 { 0 } else { 2 };
                let end = usize::from(normal[axis] > 0.0);
                let exact = (domain[end][axis / 2] - o[axis]) / d[axis];
                Polished { t: if exact.is_finite() { exact } else { t }, normal }
            }
            Self::Spheres(spheres) => {
                let radius = f64::from(spheres.radius[index]);
                sphere(ray, begin, t, spheres.center[index].as_dvec3(), radius)
            }
            Self::Ball { center, radius } => sphere(ray, begin, t, *center, *radius),
            Self::Curves(curves) => {
                // Where single precision sees a graze and double precision does not, the graze stands.
                // From a point near the curve, as for spheres.
                let hit = curves.cone(index).crossing(o + d * t, d, [begin - t, f64::INFINITY]);
                hit.map_or(Polished { t, normal }, |hit| Polished { t: t + hit.t, normal: hit.normal })
            }
            Self::Discs(discs) => {
                let center = discs.center[index].as_dvec3();
                plane(center, discs.normal.as_ref().map_or(o - center, |normal| normal[index].as_dvec3()))
            }
            Self::Triangles(mesh) => {
                let [a, b, c] = mesh.index[index].map(|vertex| mesh.position[vertex as usize].as_dvec3());
                plane(a, (b - a).cross(c - a))
            }
            Self::Mesh(mesh, origin) => {
                let [a, b, c] = mesh.index[index].map(|vertex| mesh.position[vertex as usize] - *origin);
                plane(a, (b - a).cross(c - a))
            }
        }
    }
}

/// Furthest (in t) that single precision puts a hit off a displaced surface: a share of a column for grazing rays.
fn displaced_reach(surface: &DisplacedSurface) -> f64 {
    let width = surface.flat().lattice().width;
    0.02 * width[0].min(width[1]) + 16.0 * rounding(surface.flat().lattice())
}

/// [`ExactSpline::near_start`] for a displaced surface.
pub(super) fn near_displaced(surface: &DisplacedSurface, ray: &LocalRay) -> Option<NearStart> {
    let rounding = rounding(surface.flat().lattice());
    // It is the graph of a function, so that its height over the origin tells how near it is.
    let room = 64.0 * rounding;
    let below = surface.first_hit(ray.origin + DVec3::Y * room, DVec3::NEG_Y, [0.0, 2.0 * room])?;
    let value = below.t - room;
    let slope = [-below.normal.x / below.normal.y, -below.normal.z / below.normal.y];
    let lean = 1.0 + slope[0].abs() + slope[1].abs();
    if value.abs() > rounding * lean {
        return None;
    }
    let d = ray.direction;
    let rate = d.y - slope[0] * d.x - slope[1] * d.z;
    let clear = (rounding * lean / rate.abs()).min(displaced_reach(surface));
    // On the surface to double precision: subtracting `room` again leaves its last digits.
    if value.abs() <= 16.0 * f64::EPSILON * (room + ray.origin.abs().max_element()) {
        return Some(NearStart { hit: Some(Polished { t: 0.0, normal: below.normal }), clear });
    }
    let hit = surface.first_hit(ray.origin, d, [0.0, clear]);
    Some(NearStart { hit: hit.map(|hit| Polished { t: hit.t, normal: hit.normal }), clear })
}

/// Distance (m) by which single precision may misplace a point of a surface or of a ray near it.
fn rounding(lattice: &Lattice) -> f64 {
    let corners = lattice.domain.map(|corner| lattice.from_cell(corner));
    let farthest = corners.as_flattened().iter().chain(&lattice.extent).fold(0.0, |far: f64, c| far.max(c.abs()));
    // Origin, direction and heights are each rounded once, and the solver's sums a few times more.
    16.0 * f64::from(f32::EPSILON) * farthest
}

/// The near side of a sphere, or the far one for a ray that begins behind the near one.
fn sphere(ray: &LocalRay, begin: f64, t: f64, center: DVec3, radius: f64) -> Polished {
    let (o, d) = (ray.origin, ray.direction);
    let square = d.length_squared();
    // From a point near the sphere: the squares of a far origin would leave nothing of the radius.
    let from = o + d * t;
    let to_center = center - from;
    let closest = to_center.dot(d) / square;
    let across = (to_center - d * closest).length_squared();
    // Where single precision sees a graze and double precision does not, the point of closest approach is the graze.
    let half = ((radius * radius - across).max(0.0) / square).sqrt();
    let (near, far) = (t + (closest - half), t + (closest + half));
    let exact = if near >= begin { near } else { far };
    Polished { t: exact, normal: o + d * exact - center }
}

/// A spline over the files' own heights, in double precision.
pub(super) struct ExactSpline {
    surface: Arc<SplineSurface>,
    /// Control heights around the scene origin (m), index `z * nx + x`.
    heights: Vec<f64>,
    size: [usize; 2],
}

/// What a ray that begins near a spline does there.
#[derive(Clone, Copy, Debug)]
pub(super) struct NearStart {
    /// Where it crosses, if that is on the ray.
    pub(super) hit: Option<Polished>,
    /// From where on single precision can tell its sides apart.
    pub(super) clear: f64,
}

impl ExactSpline {
    /// Height (m) and slopes dy/dx, dy/dz at a local x, z, and whether a patch is there.
    fn evaluate(&self, x: f64, z: f64) -> (f64, [f64; 2], bool) {
        let lattice = self.surface.lattice();
        let (order, pad) = (lattice.order, lattice.order / 2);
        let at = lattice.to_cell(x, z);
        let cell = [0, 1].map(|axis| (at[axis].floor().max(0.0) as usize).min(lattice.cells[axis] - 1));
        let [(bu, du), (bv, dv)] = [0, 1].map(|axis| basis(order, at[axis] - cell[axis] as f64));
        let column = |a: usize, b: usize| {
            let [x, z] = [cell[0] + a, cell[1] + b];
            let row = z.saturating_sub(pad).min(self.size[1] - 1);
            self.heights[row * self.size[0] + x.saturating_sub(pad).min(self.size[0] - 1)]
        };
        // Relative to one of its heights: the weights add up to 1 only to within rounding, and level water stays level.
        let level = column(order / 2, order / 2);
        let (mut height, mut slope) = (0.0, [0.0; 2]);
        for b in 0..order {
            for a in 0..order {
                let above = column(a, b) - level;
                height += above * bu[a] * bv[b];
                slope[0] += above * du[a] * bv[b];
                slope[1] += above * bu[a] * dv[b];
            }
        }
        let within = [0, 1].iter().all(|&i| (lattice.domain[0][i]..=lattice.domain[1][i]).contains(&at[i]));
        let slope = [slope[0] / lattice.width[0], slope[1] / lattice.width[1]];
        (level + height, slope, within && lattice.exists(cell[0], cell[1]))
    }

    /// Height of the ray above the surface at t, its rate per t, and the slopes there.
    fn above(&self, ray: &LocalRay, t: f64) -> (f64, f64, [f64; 2]) {
        let at = ray.origin + ray.direction * t;
        let (height, slope, _) = self.evaluate(at.x, at.z);
        let d = ray.direction;
        (at.y - height, d.y - slope[0] * d.x - slope[1] * d.z, slope)
    }

    /// See [`rounding`].
    fn rounding(&self) -> f64 {
        rounding(self.surface.lattice())
    }

    /// Furthest (in t) that a hit is moved: a share of a column, and what single precision may be off by.
    fn reach(&self, slope: [f64; 2], rate: f64) -> f64 {
        let narrow = self.surface.lattice().width[0].min(self.surface.lattice().width[1]);
        let lean = 1.0 + slope[0].abs() + slope[1].abs();
        (self.rounding() * lean / rate.abs()).min(0.02 * narrow + 16.0 * self.rounding())
    }

    /// Newton along the ray from `t`; `None` where it leaves the neighbourhood, as at tangency.
    fn newton(&self, ray: &LocalRay, t: f64, reach: f64) -> Option<f64> {
        let mut here = t;
        let mut last = f64::INFINITY;
        for _ in 0..32 {
            let (value, rate, _) = self.above(ray, here);
            let step = value / rate;
            if value == 0.0 {
                return Some(here);
            }
            let moved = (here - step - t).abs();
            // Not a number where value and rate vanish together.
            if moved > reach || moved.is_nan() {
                return None;
            }
            // It converges by squares: steps that no longer shrink are rounding.
            if step.abs() >= last {
                return Some(here);
            }
            last = step.abs();
            here -= step;
        }
        Some(here)
    }

    fn polish(&self, ray: &LocalRay, t: f64) -> Polished {
        let narrow = self.surface.lattice().width[0].min(self.surface.lattice().width[1]);
        let (_, rate, slope) = self.above(ray, t);
        let reach = self.reach(slope, rate).max(0.02 * narrow);
        let t = self.newton(ray, t, reach).unwrap_or_else(|| {
            // Near tangency Newton may run to the other crossing of a pair, or away: bracket the first one instead.
            let range = [(t - reach).max(0.0), t + reach];
            let near = referee::first_hit(self.surface.lattice(), ray.origin, ray.direction, range);
            near.map_or(t, |hit| self.newton(ray, hit.t, reach).unwrap_or(hit.t))
        });
        self.at(ray, t)
    }

    fn at(&self, ray: &LocalRay, t: f64) -> Polished {
        let (_, _, slope) = self.above(ray, t);
        Polished { t, normal: DVec3::new(-slope[0], 1.0, -slope[1]) }
    }

    /// What a ray does that begins so near the surface that single precision cannot tell on which side; `None` for
    /// one that does not. On the surface to the last bit of double precision is a hit at 0.
    pub(super) fn near_start(&self, ray: &LocalRay) -> Option<NearStart> {
        let (_, _, exists) = self.evaluate(ray.origin.x, ray.origin.z);
        let (value, rate, slope) = self.above(ray, 0.0);
        let doubt = self.rounding() * (1.0 + slope[0].abs() + slope[1].abs());
        if !exists || value.abs() > doubt {
            return None;
        }
        let clear = self.reach(slope, rate);
        let crossing = if value == 0.0 { Some(0.0) } else { self.newton(ray, 0.0, clear) };
        Some(NearStart { hit: crossing.filter(|&t| t >= 0.0).map(|t| self.at(ray, t)), clear })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_of_any_length_scale_without_loss() {
        for length in [5e-324, 1e-310, 1e-30, 0.75, 1.0, 3.0, 1e30, 1e308] {
            let ray = LocalRay::new([0.0; 3], [length, -length, 0.0], DVec3::ZERO);
            assert!((1.0..2.0).contains(&ray.direction.x), "{length}: {}", ray.direction.x);
            assert_eq!(ray.direction.y, -ray.direction.x);
            assert_eq!(scale(ray.direction.x, ray.exponent), length);
            // There and back, for a t that neither way leaves the range of numbers.
            let t = if length < 1.0 { 4096.0 } else { 1.0 / 4096.0 };
            assert_eq!(ray.to_given(ray.to_local(t)), t, "{length}");
        }
    }

    #[test]
    fn a_hit_beyond_all_numbers_is_still_a_hit() {
        let ray = LocalRay::new([0.0; 3], [5e-324, 0.0, 0.0], DVec3::ZERO);
        assert_eq!(ray.to_given(8.0), f64::MAX);
    }

    #[test]
    fn displaced_water_is_polished_and_judged_in_double_precision_where_a_ray_begins() {
        use crate::scene::SolverKind;
        use crate::surface::SimdLevel;
        let heights: Vec<f64> = (0..49).map(|k| 0.3 * f64::from(k % 5) + 0.1 * f64::from(k / 7)).collect();
        let shifts: Vec<[f64; 2]> = (0..49).map(|k| if k == 24 { [0.2, -0.1] } else { [0.0; 2] }).collect();
        let lattice = Lattice::new(3, [7, 7], [0.5; 2], [1.0; 2], &heights, |_| true).unwrap();
        let flat = Arc::new(SplineSurface::new(lattice, SolverKind::Newton, SimdLevel::Portable));
        let surface = Arc::new(DisplacedSurface::new(flat, &heights, &shifts, SolverKind::Newton).unwrap());
        let down = DVec3::new(0.25, -1.0, 0.125);
        let from = DVec3::new(2.9, 4.0, 3.1);
        let hit = surface.first_hit(from, down, [0.0, 10.0]).unwrap();
        let ray = |origin: DVec3| LocalRay::new(origin.to_array(), down.to_array(), DVec3::ZERO);
        let polished =
            Exact::Displaced(Arc::clone(&surface)).polish(&ray(from), 0.0, hit.t + 3e-6, hit.patch, DVec3::Y);
        assert!((polished.t - hit.t).abs() < 1e-13, "{} {}", polished.t, hit.t);
        // Beginning a nanometre over the surface it is met there; a nanometre under it, not behind; far off, nothing is said.
        let on = from + down * hit.t;
        let over = near_displaced(&surface, &ray(on - down * 1e-9)).unwrap();
        assert!((over.hit.unwrap().t - 1e-9).abs() < 1e-13);
        assert!(near_displaced(&surface, &ray(on + down * 1e-9)).unwrap().hit.is_none());
        assert!(near_displaced(&surface, &ray(from)).is_none());
    }

    #[test]
    fn a_sphere_seen_from_afar_keeps_its_digits() {
        let ray = LocalRay::new([-1e6, 0.25, 0.0], [1.0, 0.0, 0.0], DVec3::ZERO);
        let exact = sphere(&ray, 0.0, 1e6 - 0.6, DVec3::ZERO, 1.0);
        let expected = 1e6 - (1.0 - 0.0625f64).sqrt();
        assert!((exact.t - expected).abs() <= 4.0 * f64::EPSILON * expected);
        let inside = sphere(&LocalRay::new([0.0; 3], [1.0, 0.0, 0.0], DVec3::ZERO), 0.0, 0.9, DVec3::ZERO, 1.0);
        assert_eq!((inside.t, inside.normal), (1.0, DVec3::X));
    }
}
