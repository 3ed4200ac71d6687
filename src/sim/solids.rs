//! What spray bounces off besides the ground: the spheres and panels of the model file, met by a particle's whole path, so
//! that none is passed through at any speed or step.
//!
//! A path is a parabola. Against a sphere it gives a polynomial of degree four in time, whose first root is isolated in
//! Bernstein form; against the plane of a triangle a quadratic. Particles are points here. Meshes are not met.

use glam::DVec3;

use super::SimError;
use crate::math::{Bernstein, Root};
use crate::{state, terrain};

/// How far a point is kept off a surface, in units in the last place of the greatest number at hand.
///
/// A dozen roundings lie between a point and its distance from a surface; with five times that, the side on which a point
/// lies can always be told. A kilometre from the origin it is 1.4e-11 m.
const MARGIN: f64 = 64.0 * f64::EPSILON;

/// Margins within which a point in a sphere counts as just outside. What is kept off one of two surfaces gets into the other
/// by up to the cosine of the angle between them, and out again, and in: the sum is the margin over 1 - cosine, a thousand
/// of them in a wedge of 2.5 degrees.
const BAND: f64 = 1024.0;

/// Part of a flight between two events: start + velocity t + acceleration t² / 2 (the latter upward) for `duration`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Path {
    pub(super) start: DVec3,
    pub(super) velocity: DVec3,
    pub(super) acceleration: f64,
    pub(super) duration: f64,
}

impl Path {
    /// Position (m) at a time (s).
    pub(super) fn at(&self, time: f64) -> DVec3 {
        self.start + self.velocity * time + DVec3::Y * (0.5 * self.acceleration * time * time)
    }

    /// Velocity (m/s) at a time (s).
    pub(super) fn velocity_at(&self, time: f64) -> DVec3 {
        self.velocity + DVec3::Y * (self.acceleration * time)
    }

    /// Least and greatest coordinates over the whole path.
    fn bounds(&self) -> [DVec3; 2] {
        let end = self.at(self.duration);
        let (low, mut high) = (self.start.min(end), self.start.max(end));
        let summit = -self.velocity.y / self.acceleration;
        if self.acceleration < 0.0 && summit > 0.0 && summit < self.duration {
            high.y = high.y.max(self.at(summit).y);
        }
        [low, high]
    }
}

/// Where a path meets a solid.
#[derive(Clone, Copy, Debug)]
pub(super) struct Contact {
    /// When (s from the path's start).
    pub(super) time: f64,
    /// The place, on the free side of the surface by a rounding's margin.
    pub(super) place: DVec3,
    /// Unit normal of the surface towards that side.
    pub(super) normal: DVec3,
}

/// Spheres, met from outside, and two-sided panels.
#[derive(Clone, Debug, Default)]
pub struct Solids {
    shapes: Vec<Shape>,
    /// Least and greatest coordinates of each shape.
    boxes: Vec<[DVec3; 2]>,
    bins: Bins,
}

#[derive(Clone, Copy, Debug)]
enum Shape {
    Sphere { centre: DVec3, radius: f64 },
    Triangle { corners: [DVec3; 3], normal: DVec3 },
}

impl Solids {
    /// The spheres and panels of a model; its meshes are left out.
    ///
    /// # Errors
    /// A panel without area, a radius that is not a positive number.
    pub fn new(model: &state::Model) -> Result<Self, SimError> {
        let mut shapes = Vec::new();
        for sphere in &model.spheres {
            let centre = DVec3::from_array(sphere.center);
            // The same promise as the renderer asks for: what it refuses, spray does not bounce off.
            terrain::ball(sphere, centre).map_err(SimError::Solid)?;
            shapes.push(Shape::Sphere { centre, radius: sphere.radius });
        }
        for panel in &model.panels {
            // Cut as the renderer cuts it, so that spray bounces off what is seen.
            let mesh = terrain::panel(panel).map_err(SimError::Solid)?;
            for index in mesh.index {
                let corners = index.map(|corner| mesh.position[corner as usize]);
                let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize_or_zero();
                // Three corners in a line are half of a panel whose other half has all the area.
                if normal != DVec3::ZERO {
                    shapes.push(Shape::Triangle { corners, normal });
                }
            }
        }
        let boxes: Vec<[DVec3; 2]> = shapes.iter().map(Shape::bounds).collect();
        let bins = Bins::new(&boxes);
        Ok(Self { shapes, boxes, bins })
    }

    /// Whether there is nothing to bounce off.
    pub fn is_empty(&self) -> bool {
        self.shapes.is_empty()
    }

    /// The first surface that a path meets; the one listed first where two are met at once.
    pub(super) fn first_contact(&self, path: &Path) -> Option<Contact> {
        if self.shapes.is_empty() {
            return None;
        }
        let [low, high] = path.bounds();
        let mut first: Option<(f64, usize, Contact)> = None;
        self.bins.each([low.x, low.z], [high.x, high.z], |index| {
            let [least, greatest] = self.boxes[index];
            if low.cmpgt(greatest).any() || high.cmplt(least).any() {
                return;
            }
            if let Some(contact) = self.shapes[index].contact(path) {
                // A shape may stand in several bins and bins come in any order: equal times go by index.
                if first.is_none_or(|(time, other, _)| (contact.time, index) < (time, other)) {
                    first = Some((contact.time, index, contact));
                }
            }
        });
        first.map(|(_, _, contact)| contact)
    }

    /// How deep (m) a point lies within the spheres; 0 outside.
    #[cfg(test)]
    pub(super) fn depth_within(&self, point: DVec3) -> f64 {
        self.shapes.iter().fold(0.0, |depth: f64, shape| match shape {
            Shape::Sphere { centre, radius } => depth.max(radius - point.distance(*centre)),
            Shape::Triangle { .. } => depth,
        })
    }
}

impl Shape {
    fn bounds(&self) -> [DVec3; 2] {
        let [low, high] = match *self {
            Self::Sphere { centre, radius } => [centre - DVec3::splat(radius), centre + DVec3::splat(radius)],
            Self::Triangle { corners: [a, b, c], .. } => [a.min(b).min(c), a.max(b).max(c)],
        };
        let margin = DVec3::splat(2.0 * MARGIN * low.abs().max(high.abs()).max_element());
        [low - margin, high + margin]
    }

    fn contact(&self, path: &Path) -> Option<Contact> {
        match *self {
            Self::Sphere { centre, radius } => sphere_contact(centre, radius, path),
            Self::Triangle { corners, normal } => triangle_contact(corners, normal, path),
        }
    }
}

/// The first entry into a sphere. A path that starts inside leaves freely, as spray that a boulder's column sheds must.
fn sphere_contact(centre: DVec3, radius: f64, path: &Path) -> Option<Contact> {
    let margin = MARGIN * (centre.abs().max_element() + radius);
    let mut start = path.start - centre;
    let distance = start.length();
    if distance < radius - BAND * margin {
        return None;
    }
    if distance < radius + margin {
        start *= (radius + margin) / distance;
    }
    // Met a little before the margin is used up, so that a panel close by is not crossed by being pushed out of it.
    let met = radius + 0.75 * margin;
    let (speed, fall, span) = (path.velocity, path.acceleration, path.duration);
    // |start + speed t + fall t² / 2|² - met², in powers of t / span.
    let length = start.length();
    let power = [
        (length - met) * (length + met),
        2.0 * start.dot(speed) * span,
        (speed.length_squared() + start.y * fall) * span.powi(2),
        fall * speed.y * span.powi(3),
        0.25 * fall * fall * span.powi(4),
    ];
    let [c0, c1, c2, c3, c4] = power;
    let outside = Bernstein::new(&[
        c0,
        c0 + c1 / 4.0,
        c0 + c1 / 2.0 + c2 / 6.0,
        c0 + 0.75 * c1 + 0.5 * c2 + 0.25 * c3,
        c0 + c1 + c2 + c3 + c4,
    ]);
    // To the last place of the time: what the place is off the sphere by is then a rounding of the path.
    let (Root::At(share) | Root::Touch(share)) = outside.first_root(f64::EPSILON) else { return None };
    let time = share * span;
    let out = path.at(time) - centre;
    let normal = out.try_normalize()?;
    Some(Contact { time, place: centre + normal * (radius + margin), normal })
}

/// The first passage through a triangle, from either side.
///
/// What is met are two triangles, a margin before either side of it: a point is then never pushed out by more than a
/// rounding, and so not through another panel that stands at a sharp angle to this one.
fn triangle_contact(corners: [DVec3; 3], facing: DVec3, path: &Path) -> Option<Contact> {
    let extent = corners.iter().fold(0.0, |most: f64, corner| most.max(corner.abs().max_element()));
    let margin = MARGIN * extent.max(path.start.abs().max_element());
    let (height, rate, bend) =
        (facing.dot(path.start - corners[0]), facing.dot(path.velocity), 0.5 * facing.y * path.acceleration);
    // What a rounding leaves of a speed along the surface takes no one into it.
    let rate = if rate.abs() > 16.0 * f64::EPSILON * path.velocity.length() { rate } else { 0.0 };
    let side = if height == 0.0 { -rate.signum() } else { height.signum() };
    // A parabola comes to the plane from the side that it starts on, and, past the triangle's edge, back from the other.
    let near = [(side * height - margin).max(0.0), side * rate, side * bend];
    let far = [-side * height - margin, -side * rate, -side * bend];
    for (clearance, normal) in [(near, facing * side), (far, facing * -side)] {
        // It is behind the plane only after it has gone towards it.
        if clearance[0] < 0.0 && clearance[1] <= 0.0 {
            continue;
        }
        let Some(time) = first_fall(clearance, path.duration) else { continue };
        let point = path.at(time);
        // Edges belong to both triangles that share them, so that none slips between.
        let within = (0..3).all(|k| {
            let edge = corners[(k + 1) % 3] - corners[k];
            facing.dot(edge.cross(point - corners[k])) >= -margin * edge.length()
        });
        if within {
            let place = point + normal * (margin - normal.dot(point - corners[0]));
            return Some(Contact { time, place, normal });
        }
    }
    None
}

/// The first time of [0, span] at which a clearance c0 + c1 t + c2 t² is used up and not growing.
///
/// A clearance that is gone at the start but grows is one that was just left: then the next time it is used up.
pub(super) fn first_fall([c0, c1, c2]: [f64; 3], span: f64) -> Option<f64> {
    let falls = c1 < 0.0 || (c1 == 0.0 && c2 <= 0.0);
    if c0 <= 0.0 && falls && (c0 < 0.0 || c1 < 0.0 || c2 < 0.0) {
        return Some(0.0);
    }
    // Most flights end here: a path that bends downward and ends above stays above.
    if c2 <= 0.0 && c0 + (c1 + c2 * span) * span > 0.0 {
        return None;
    }
    let discriminant = c1 * c1 - 4.0 * c0 * c2;
    let root = if c0 <= 0.0 {
        if !(c2 < 0.0) {
            return None;
        }
        if discriminant < 0.0 {
            // It turns round before it is out.
            return Some(0.0);
        }
        (c1 + discriminant.sqrt()) / (-2.0 * c2)
    } else {
        if c1 >= 0.0 && c2 >= 0.0 || !(discriminant > 0.0) {
            return None;
        }
        if c1 > 0.0 { (c1 + discriminant.sqrt()) / (-2.0 * c2) } else { 2.0 * c0 / (discriminant.sqrt() - c1) }
    };
    (root <= span).then_some(root.max(0.0))
}

/// Which shapes stand where in plan: equal rectangles over all of them.
#[derive(Clone, Debug, Default)]
struct Bins {
    low: [f64; 2],
    size: [f64; 2],
    count: [usize; 2],
    /// Where each bin's shapes begin, and one more.
    begin: Vec<u32>,
    shape: Vec<u32>,
}

impl Bins {
    fn new(boxes: &[[DVec3; 2]]) -> Self {
        if boxes.is_empty() {
            return Self::default();
        }
        let all = boxes
            .iter()
            .fold([DVec3::INFINITY, DVec3::NEG_INFINITY], |all, one| [all[0].min(one[0]), all[1].max(one[1])]);
        // As many bins as shapes leave about one of each in the other.
        let side = (boxes.len() as f64).sqrt().ceil().min(256.0);
        let low = [all[0].x, all[0].z];
        let size = [(all[1].x - low[0]) / side, (all[1].z - low[1]) / side];
        let mut bins = Self { low, size, count: [side as usize; 2], begin: Vec::new(), shape: Vec::new() };
        let mut lists = vec![Vec::new(); bins.count[0] * bins.count[1]];
        for (index, [low, high]) in boxes.iter().enumerate() {
            bins.each_bin([low.x, low.z], [high.x, high.z], |bin| lists[bin].push(index as u32));
        }
        for list in lists {
            bins.begin.push(bins.shape.len() as u32);
            bins.shape.extend(list);
        }
        bins.begin.push(bins.shape.len() as u32);
        bins
    }

    fn each_bin(&self, low: [f64; 2], high: [f64; 2], mut visit: impl FnMut(usize)) {
        // Saturating casts keep far and infinite places in the outermost bins.
        let place = |axis: usize, value: f64| {
            let place = (value - self.low[axis]) / self.size[axis];
            (place as usize).min(self.count[axis] - 1)
        };
        for z in place(1, low[1])..=place(1, high[1]) {
            for x in place(0, low[0])..=place(0, high[0]) {
                visit(z * self.count[0] + x);
            }
        }
    }

    fn each(&self, low: [f64; 2], high: [f64; 2], mut visit: impl FnMut(usize)) {
        self.each_bin(low, high, |bin| {
            for &shape in &self.shape[self.begin[bin] as usize..self.begin[bin + 1] as usize] {
                visit(shape as usize);
            }
        });
    }
}
