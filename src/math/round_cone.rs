//! The round cone: the convex hull of two balls, in double precision. What a tapered, round-ended stroke fills.
//!
//! Ray crossings, the ball under a surface point, volume, and the outline of two balls. It is what Embree calls a round
//! linear curve. Who draws with it is not here.

use std::f64::consts::{FRAC_PI_2, PI};

use glam::DVec3;

/// The hull of two balls. A ball inside of the other adds nothing; two balls in one place are the greater one.
#[derive(Clone, Copy, Debug)]
pub struct RoundCone {
    start: DVec3,
    /// Unit, from the first centre to the second; any where they coincide.
    axis: DVec3,
    length: f64,
    radius: [f64; 2],
    /// What the radius falls by per metre of axis, -1..1: sine of the half angle of the cone between the balls.
    lean: f64,
}

/// Where a ray crosses a round cone's surface.
#[derive(Clone, Copy, Debug)]
pub struct Crossing {
    /// In lengths of the direction.
    pub t: f64,
    /// The ball that is touched there: 0 the first, 1 the second, between them the one with its centre there.
    pub along: f64,
    /// From that ball's centre to the point: outward, not of unit length.
    pub normal: DVec3,
}

impl RoundCone {
    /// Of centres (m) and radii (m, finite, not negative).
    pub fn new(ends: [DVec3; 2], radius: [f64; 2]) -> Self {
        let between = ends[1] - ends[0];
        let length = between.length();
        let fall = radius[0] - radius[1];
        if length > fall.abs() {
            return Self { start: ends[0], axis: between / length, length, radius, lean: fall / length };
        }
        let greater = usize::from(fall < 0.0);
        Self { start: ends[greater], axis: DVec3::X, length: 0.0, radius: [radius[greater]; 2], lean: 0.0 }
    }

    /// Where the ray enters within `[tnear, tfar]`; where it leaves, if it enters before that.
    pub fn crossing(&self, origin: DVec3, direction: DVec3, [tnear, tfar]: [f64; 2]) -> Option<Crossing> {
        let [entry, exit] = self.interval(origin, direction)?;
        let (t, along) = [entry, exit].into_iter().find(|&(t, _)| t >= tnear && t <= tfar)?;
        // Differences first: the point itself would lose the last digits of a small radius far from zero.
        let normal = (origin - self.start) + t * direction - self.axis * (self.length * along);
        Some(Crossing { t, along, normal })
    }

    /// Entry and exit of the whole line, each t with the ball that it touches.
    ///
    /// The hull is convex, and is the union of its two balls and the frustum that touches both: the line's stay in it
    /// reaches from the first crossing of any of the three to the last.
    fn interval(&self, origin: DVec3, direction: DVec3) -> Option<[(f64, f64); 2]> {
        let squared = direction.length_squared();
        let mut stay: Option<[(f64, f64); 2]> = None;
        let mut add = |t: f64, along: f64| {
            let [first, last] = stay.unwrap_or([(t, along); 2]);
            stay = Some([if t < first.0 { (t, along) } else { first }, if t > last.0 { (t, along) } else { last }]);
        };
        let from_start = origin - self.start;
        for (along, radius) in [(0.0, self.radius[0]), (1.0, self.radius[1])] {
            let to_center = self.axis * (self.length * along) - from_start;
            let middle = to_center.dot(direction) / squared;
            // The distance from the line is taken at its nearest point: |c|^2 - (c.d)^2 would cancel for far origins.
            let miss = (to_center - middle * direction).length_squared();
            let half = ((radius * radius - miss) / squared).sqrt();
            if half >= 0.0 {
                add(middle - half, along);
                add(middle + half, along);
            }
        }
        if self.length > 0.0 {
            self.frustum(from_start, direction, squared, &mut add);
        }
        stay
    }

    /// Crossings of the cone that touches both balls, between the circles of touch.
    ///
    /// With x along the axis, y from it, k the lean and a the first radius: (1 - k^2) y^2 = (a - k x)^2, as a point at
    /// distance r from the centre of the ball of radius r, square to the cone, has x = s l + r k, y = r sqrt(1 - k^2).
    fn frustum(&self, from_start: DVec3, direction: DVec3, squared: f64, add: &mut impl FnMut(f64, f64)) {
        let (axis, lean) = (self.axis, self.lean);
        let square = 1.0 - lean * lean;
        let along_rate = direction.dot(axis);
        let across_rate = direction - along_rate * axis;
        // From where line and axis are nearest each other, but not from beyond the cone's own neighbourhood, where
        // nearly parallel ones meet: the squares of a far point would leave nothing of the radius.
        let nearest = -from_start.dot(across_rate) / across_rate.length_squared();
        let middle = (axis * (0.5 * self.length) - from_start).dot(direction) / squared;
        let reach = (0.5 * self.length + self.radius[0].max(self.radius[1])) / squared.sqrt();
        let shift = if nearest.is_finite() { nearest.clamp(middle - reach, middle + reach) } else { middle };
        let point = from_start + shift * direction;
        let x = point.dot(axis);
        let across = point - x * axis;
        let high = self.radius[0] - lean * x;
        let a = square * across_rate.length_squared() - lean * lean * along_rate * along_rate;
        let b = square * across.dot(across_rate) + lean * high * along_rate;
        let c = square * across.length_squared() - high * high;
        let root = (b * b - a * c).sqrt(); // NaN for a miss, which no comparison below accepts.
        let q = -(b + root.copysign(b));
        for step in [q / a, c / q] {
            let along = (x + along_rate * step - self.radius[0] * lean) / (self.length * square);
            if step.is_finite() && (0.0..=1.0).contains(&along) {
                add(shift + step, along);
            }
        }
    }

    /// Which ball's surface is nearest to a point, of all between the two: from 0, the first, to 1.
    pub fn along(&self, point: DVec3) -> f64 {
        let from_start = point - self.start;
        let x = from_start.dot(self.axis);
        let y = (from_start - x * self.axis).length();
        if self.length > 0.0 {
            ((x - y * self.lean / (1.0 - self.lean * self.lean).sqrt()) / self.length).clamp(0.0, 1.0)
        } else {
            0.0
        }
    }

    /// Centre and radius of the ball whose surface is nearest to a point: of all balls between the two.
    pub fn ball_under(&self, point: DVec3) -> (DVec3, f64) {
        let along = self.along(point);
        let radius = self.radius[0] + (self.radius[1] - self.radius[0]) * along;
        (self.start + self.axis * (self.length * along), radius)
    }

    /// Volume (m3): two parts of balls and a frustum.
    pub fn volume(&self) -> f64 {
        let ([a, b], k) = (self.radius, self.lean);
        let square = 1.0 - k * k;
        let frustum = self.length * square * square * (a * a + a * b + b * b);
        PI / 3.0 * (frustum + a.powi(3) * (2.0 + 3.0 * k - k.powi(3)) + b.powi(3) * (2.0 - 3.0 * k + k.powi(3)))
    }

    /// What the volume grows by per metre of both radii growing in proportion to `[1, taper]` (m2): the surface, each
    /// piece of it moved by what its ball grows.
    pub fn volume_rate(&self, taper: f64) -> f64 {
        let ([a, b], k) = (self.radius, self.lean);
        let balls = a * a * (1.0 + k) + taper * b * b * (1.0 - k);
        // Circles a..b of the frustum's surface, each growing by its share of 1..taper.
        let frustum = self.length * (1.0 - k * k) * (2.0 * a + 2.0 * b * taper + a * taper + b) / 6.0;
        2.0 * PI * (balls + frustum)
    }
}

/// Area of the hull of two discs in a plane, of these radii and so far apart.
pub fn discs_outline([a, b]: [f64; 2], apart: f64) -> f64 {
    let fall = a - b;
    if apart <= fall.abs() {
        return PI * a.max(b).powi(2);
    }
    let lean = (fall / apart).asin();
    let side = (apart * apart - fall * fall).sqrt();
    (a + b) * side + a * a * (FRAC_PI_2 + lean) + b * b * (FRAC_PI_2 - lean)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Points in a lattice over a box around the cone, and whether each is in one of many balls along the axis.
    fn counted(cone: &RoundCone, steps: i32) -> f64 {
        let low = cone.start.min(cone.start + cone.axis * cone.length) - cone.radius[0].max(cone.radius[1]);
        let high = cone.start.max(cone.start + cone.axis * cone.length) + cone.radius[0].max(cone.radius[1]);
        let cell = (high - low) / f64::from(steps);
        let mut inside = 0;
        for k in 0..steps.pow(3) {
            let at = DVec3::new(f64::from(k % steps), f64::from(k / steps % steps), f64::from(k / steps / steps));
            let point = low + (at + 0.5) * cell;
            inside += i32::from((0..=64).any(|s| {
                let s = f64::from(s) / 64.0;
                let radius = cone.radius[0] + (cone.radius[1] - cone.radius[0]) * s;
                (point - cone.start - cone.axis * (cone.length * s)).length() <= radius
            }));
        }
        f64::from(inside) * cell.element_product()
    }

    fn cones() -> [RoundCone; 5] {
        let end = DVec3::new(1.0, 0.5, -0.25);
        [
            RoundCone::new([DVec3::ZERO, end], [0.3, 0.3]),
            RoundCone::new([DVec3::ZERO, end], [0.5, 0.1]),
            RoundCone::new([end, DVec3::ZERO], [0.0, 0.6]),
            RoundCone::new([DVec3::ONE, DVec3::ONE], [0.4, 0.2]),
            RoundCone::new([DVec3::ZERO, end], [0.2, 2.0]),
        ]
    }

    #[test]
    fn volume_and_its_growth_are_those_of_the_points_inside() {
        for cone in cones() {
            let expected = counted(&cone, 60);
            assert!((cone.volume() / expected - 1.0).abs() < 0.02, "{cone:?}: {} for {expected}", cone.volume());
        }
        for (radius, taper) in [(0.3, 0.2), (0.3, 1.0), (0.1, 0.0)] {
            let cone = |radius| RoundCone::new([DVec3::ZERO, DVec3::X], [radius, taper * radius]);
            let step = 1e-5;
            let rate = (cone(radius + step).volume() - cone(radius - step).volume()) / (2.0 * step);
            assert!((cone(radius).volume_rate(taper) / rate - 1.0).abs() < 1e-7, "{radius} {taper}");
        }
    }

    #[test]
    fn crossings_lie_on_the_nearest_ball_and_the_outline_is_what_rays_hit() {
        let direction = DVec3::new(0.2, -1.0, 0.4);
        let unit = direction.normalize();
        let (across, along) = unit.any_orthonormal_pair();
        for cone in cones() {
            let (mut hits, steps) = (0, 400);
            for k in 0..steps * steps {
                let (u, v) = (f64::from(k % steps), f64::from(k / steps));
                let place = |w: f64| ((w + 0.5) / f64::from(steps) - 0.5) * 8.0;
                let origin = across * place(u) + along * place(v) - 50.0 * unit;
                let Some(hit) = cone.crossing(origin, direction, [0.0, f64::INFINITY]) else { continue };
                hits += 1;
                let point = origin + hit.t * direction;
                let (center, radius) = cone.ball_under(point);
                assert!(((point - center).length() - radius).abs() < 1e-6, "{cone:?} {point}");
                assert!((hit.normal - (point - center)).length() < 1e-4, "{cone:?} {point}");
                assert!(hit.normal.dot(direction) < 1e-9);
                // From inside it is left; behind it there is nothing.
                let exit = cone.crossing(point, direction, [1e-9, f64::INFINITY]).map_or(0.0, |exit| exit.t);
                assert!(cone.crossing(point, direction, [exit + 1e-6, f64::INFINITY]).is_none(), "{cone:?} {point}");
            }
            let area = f64::from(hits) * (8.0 / f64::from(steps)).powi(2);
            let outline = discs_outline(cone.radius, cone.length * cone.axis.cross(unit).length());
            assert!((area / outline - 1.0).abs() < 0.005, "{cone:?}: {area}");
        }
    }

    #[test]
    fn along_its_axis_and_through_its_tip_a_cone_is_crossed_once() {
        let cone = RoundCone::new([DVec3::ZERO, DVec3::X], [0.5, 0.0]);
        let from = |origin: DVec3, direction: DVec3| cone.crossing(origin, direction, [0.0, 9.0]).map(|hit| hit.t);
        assert_eq!(from(DVec3::new(-2.0, 0.0, 0.0), DVec3::X), Some(1.5));
        assert!((from(DVec3::new(3.0, 0.0, 0.0), DVec3::NEG_X).unwrap() - 2.0).abs() < 1e-9);
        assert_eq!(from(DVec3::new(0.0, 0.0, 0.0), DVec3::NEG_X), Some(0.5));
        assert_eq!(from(DVec3::new(3.0, 0.6, 0.0), DVec3::NEG_X), None);
    }
}
