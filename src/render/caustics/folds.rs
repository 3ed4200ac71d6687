//! Light of the sun's disc near the folds of a caustic, where single directions of it have no bounded variance.
//!
//! *The trouble.* A direction w, drawn from the disc, finds a place u of the surface with the density |∂w/∂u| / Ω, and what
//! it brings is divided by that. Towards a fold the density falls to 0 as the square root of the distance: the mean of the
//! square is a logarithm without end, and a rare sample is hundreds of times too bright.
//!
//! *The way out.* With w = (p, b) across the disc, places where b stays the same are a curve of the surface. Where much light
//! comes together on it ([`FOCUS`]), the whole piece where that is so, and that sees the disc, is followed: light through it
//! is ∫ g dl / |∇b|, with the point's solid angle g per area, and a fold is nothing special to that. A draw finds the piece
//! if its p is among the piece's. So the integral over their range, shared among the m places of the piece that
//! have this very p, has the mean of what single directions bring. One place, drawn by what it brings, stands for all.
//!
//! A curve of constant b cannot be followed where ∇b = 0: on a fold that b alone crosses. So light is divided by (m·p̂)² and
//! (m·b̂)² between curves of constant b and of constant p, with m the direction across the disc in which w changes least.

use glam::{DVec2, DVec3, Vec3};

use super::{Connection, Event, Manifold, polynomial::Polynomial};
use crate::surface::Lattice;

/// Spread over which light is averaged: a card then has some four times what it would have under flat water. With less, more
/// of the noise goes and more of the time. It decides on noise alone: means are the same by any.
const FOCUS: f64 = 2.0;

/// Steps after which a piece is not followed any more, by far more than it takes to cross the disc: closed curves end so.
const MOST_STEPS: usize = 256;

/// Length of a step in the change of w, in radii of the disc, where w changes most.
const STEP: f64 = 0.5;

/// Halvings of the last step, which ends a piece: to 1/512 of a radius of the disc, far under the rule's own error.
const HALVINGS: usize = 8;

/// Steps of Newton's iteration back to the curve: it starts off it by the square of a step.
const CORRECTIONS: usize = 2;

/// A disc in the sky: a unit vector to its middle, and its angular radius (radians).
#[derive(Clone, Copy, Debug)]
pub struct Disc {
    /// Unit vector to its middle.
    pub direction: Vec3,
    /// Angular radius (radians).
    pub radius: f32,
}

/// A place that light goes by to a point, from wherever the law says.
#[derive(Clone, Copy)]
struct Place {
    at: DVec2,
    height: f64,
    normal: DVec3,
    facet: DVec3,
    /// Unit vector to the point.
    to_point: DVec3,
    distance: f64,
    to_light: DVec3,
    /// Across the disc, in its radii.
    w: DVec2,
    /// How w changes along x and z (1/m).
    change: [DVec2; 2],
    /// Solid angle at the point per horizontal area (1/m²).
    solid_angle: f64,
    /// As of a connection.
    spread: f64,
}

impl Place {
    /// How p (0) or b (1) changes along x and z.
    fn gradient(&self, of: usize) -> DVec2 {
        DVec2::new(self.change[0][of], self.change[1][of])
    }

    /// Square of the part along p (0) or b (1) of the direction in which w changes least.
    fn share(&self, of: usize) -> f64 {
        let [p, b] = [self.gradient(0), self.gradient(1)];
        let (pp, pb, bb) = (p.length_squared(), p.dot(b), b.length_squared());
        // The eigenvector of the smaller eigenvalue, by twice its angle.
        let (cosine, sine) = (bb - pp, -2.0 * pb);
        let length = cosine.hypot(sine);
        let turned = if length > 0.0 { cosine / length } else { 0.0 };
        0.5 * (1.0 + if of == 0 { turned } else { -turned })
    }

    fn connection(&self, spread: f64) -> Connection {
        Connection {
            surface: DVec3::new(self.at.x, self.height, self.at.y).as_vec3(),
            normal: self.normal.normalize().as_vec3(),
            facet: self.facet.normalize().as_vec3(),
            direction: (-self.to_point).as_vec3(),
            distance: self.distance as f32,
            to_light: self.to_light.as_vec3(),
            light_distance: f32::INFINITY,
            spread: spread as f32,
        }
    }
}

impl Manifold {
    /// What a connection to a direction drawn evenly from `disc` brings, averaged over the disc where much comes together:
    /// one or two others in its place. `from`, `event`, `ior` and `tilt` are what [`Manifold::connect`] was asked with; `u`
    /// are two random numbers, which connections may share.
    ///
    /// *Accuracy:* means over the draws are those of the connections themselves but for the rule of trapezoids over steps
    /// of half a radius of the disc, some 1e-3 of what is averaged. Where a curve is closed, or goes on and on, its
    /// part of the connection stays as it is.
    pub fn average(
        &self,
        from: Vec3,
        event: Event,
        disc: &Disc,
        ior: f32,
        tilt: [f32; 2],
        u: [f32; 2],
        connection: Connection,
    ) -> [Option<Connection>; 2] {
        let itself = [Some(connection), None];
        if f64::from(connection.spread) <= FOCUS {
            return itself;
        }
        let centre = disc.direction.as_dvec3();
        let (across, along) = centre.any_orthonormal_pair();
        let (sin, cos) = (std::f64::consts::TAU * f64::from(u[0])).sin_cos();
        let scale = 1.0 / f64::from(disc.radius).sin();
        let law = Law {
            lattice: &self.lattice,
            from: from.as_dvec3(),
            event,
            axes: [scale * (cos * across + sin * along), scale * (cos * along - sin * across)],
            ior: if event == Event::Refraction { f64::from(ior) } else { 1.0 },
            tilt: tilt.map(f64::from),
        };
        let at = connection.surface.as_dvec3();
        let Some(place) = law.place(DVec2::new(at.x, at.z)) else { return itself };
        [0, 1].map(|across| {
            let Some(piece) = Piece::follow(&law, across, place) else {
                let spread = connection.spread * place.share(across) as f32;
                return Some(Connection { spread, ..connection });
            };
            // w is in radii of the disc: over their square, its areas are solid angles.
            piece.stand_in(&law, f64::from(u[1]), scale * scale)
        })
    }
}

/// What light must obey.
struct Law<'a> {
    lattice: &'a Lattice,
    from: DVec3,
    event: Event,
    /// Vectors whose products with a direction are its place across the disc, in radii.
    axes: [DVec3; 2],
    ior: f64,
    tilt: [f64; 2],
}

impl Law<'_> {
    /// Light by way of a place; `None` where none can go by it.
    fn place(&self, at: DVec2) -> Option<Place> {
        let lattice = self.lattice;
        let coordinates = lattice.to_cell(at.x, at.y);
        let [low, high] = lattice.domain;
        if !(0..2).all(|axis| coordinates[axis] >= low[axis] && coordinates[axis] < high[axis]) {
            return None;
        }
        let cell = coordinates.map(|coordinate| coordinate as usize);
        if !lattice.exists(cell[0], cell[1]) {
            return None;
        }
        let within = [0, 1].map(|axis| coordinates[axis] - cell[axis] as f64 - 0.5);
        let jet = match lattice.order {
            2 => Polynomial::<f64, 2>::of_patch(lattice, cell[0], cell[1]).jet(within),
            3 => Polynomial::<f64, 3>::of_patch(lattice, cell[0], cell[1]).jet(within),
            _ => Polynomial::<f64, 4>::of_patch(lattice, cell[0], cell[1]).jet(within),
        };
        let slope = [0, 1].map(|axis| jet.first[axis] / lattice.width[axis]);
        let to_point = self.from - DVec3::new(at.x, jet.height, at.y);
        let distance = to_point.length();
        let to_point = to_point / distance;
        let normal = DVec3::new(-slope[0], 1.0, -slope[1]);
        let facet = normal - DVec3::new(self.tilt[0], 0.0, self.tilt[1]);
        let side = if self.event == Event::Refraction { -1.0 } else { 1.0 };
        if !(side * normal.dot(to_point) > 0.0 && side * facet.dot(to_point) > 0.0) {
            return None;
        }
        // n d + w is along the facet's normal, and w is of unit length and above.
        let (n, unit) = (self.ior, facet.normalize());
        let cosine = n * to_point.dot(unit);
        let square = cosine * cosine - n * n + 1.0;
        if !(square > 0.0) {
            return None;
        }
        let to_light = (cosine + square.sqrt()) * unit - n * to_point;
        if !(normal.dot(to_light) > 0.0) {
            return None;
        }
        let up = n * to_point.y + to_light.y;
        let tangents = [DVec3::new(1.0, slope[0], 0.0), DVec3::new(0.0, slope[1], 1.0)];
        let tilted = [tangents[0] + DVec3::Y * self.tilt[0], tangents[1] + DVec3::Y * self.tilt[1]];
        let mut j = [[0.0; 2]; 2];
        for i in 0..2 {
            for k in 0..2 {
                let second = jet.second[i][k] / (lattice.width[i] * lattice.width[k]);
                let across = tilted[i].dot(tangents[k]) - to_point.dot(tilted[i]) * to_point.dot(tangents[k]);
                j[i][k] = up * second - n / distance * across;
            }
        }
        // dw·t'ᵢ = -Jᵢₖ and dw·w = 0, by the dual basis of t'₁, t'₂ and w; t'₁ × t'₂ is -facet.
        let volume = -facet.dot(to_light);
        let duals = [tilted[1].cross(to_light) / volume, to_light.cross(tilted[0]) / volume];
        let change = [0, 1].map(|k| {
            let dw = -(j[0][k] * duals[0] + j[1][k] * duals[1]);
            DVec2::from(self.axes.map(|axis| axis.dot(dw)))
        });
        let w = DVec2::from(self.axes.map(|axis| axis.dot(to_light)));
        let solid_angle = normal.dot(to_point).abs() / (distance * distance);
        let density = (j[0][0] * j[1][1] - j[0][1] * j[1][0]).abs() / facet.dot(to_light);
        let (height, spread) = (jet.height, solid_angle / density);
        Some(Place { at, height, normal, facet, to_point, distance, to_light, w, change, solid_angle, spread })
    }

    /// The place near `start` where p (0) or b (1) is `held`; `None` where that is not on a piece any more.
    fn next(&self, of: usize, held: f64, start: DVec2) -> Option<Place> {
        let mut place = self.place(start)?;
        for _ in 0..CORRECTIONS {
            let gradient = place.gradient(of);
            let square = gradient.length_squared();
            if !(square > 0.0) {
                return None;
            }
            place = self.place(place.at - gradient * ((place.w[of] - held) / square))?;
        }
        (place.spread > FOCUS && place.w.length_squared() <= 1.0).then_some(place)
    }
}

/// A node of a piece: a place, and what light comes by there per length.
#[derive(Clone, Copy)]
struct Node {
    at: DVec2,
    /// p along the piece, and its derivative.
    p: f64,
    rise: f64,
    light: f64,
    /// Metres to the next node.
    length: f64,
}

/// The piece of a curve on which p (0) or b (1) is held.
struct Piece {
    of: usize,
    held: f64,
    nodes: Vec<Node>,
    /// All light, Σ light · length.
    light: f64,
    /// Least and greatest of the other coordinate.
    range: [f64; 2],
    /// Places that have the same one as the start.
    alike: f64,
}

impl Piece {
    /// Follows the curve through a place to both ends; `None` if that takes too many steps. `across` is the one of p (0) and
    /// b (1) that changes.
    fn follow(law: &Law, across: usize, start: Place) -> Option<Self> {
        let of = 1 - across;
        let held = start.w[of];
        let mut piece = Self { of, held, nodes: Vec::new(), light: 0.0, range: [start.w[across]; 2], alike: 1.0 };
        let mut steps = MOST_STEPS;
        let backward = piece.side(law, start, -1.0, &mut steps)?;
        let forward = piece.side(law, start, 1.0, &mut steps)?;
        // From one end to the other; the start is in both.
        piece.nodes = backward.into_iter().rev().chain(forward.into_iter().skip(1)).collect();
        for k in 1..piece.nodes.len() {
            let length = piece.nodes[k].at.distance(piece.nodes[k - 1].at);
            piece.nodes[k - 1].length = length;
            piece.light += 0.5 * length * (piece.nodes[k - 1].light + piece.nodes[k].light);
        }
        Some(piece)
    }

    fn node(&self, place: &Place) -> (Node, DVec2) {
        let gradient = place.gradient(self.of);
        let steep = gradient.length();
        let tangent = DVec2::new(-gradient.y, gradient.x) / steep;
        let across = 1 - self.of;
        let light = place.solid_angle * place.share(across) / steep;
        let rise = place.gradient(across).dot(tangent);
        (Node { at: place.at, p: place.w[across], rise, light, length: 0.0 }, tangent)
    }

    /// Nodes from the start to one end.
    fn side(&mut self, law: &Law, start: Place, sign: f64, steps: &mut usize) -> Option<Vec<Node>> {
        let (first, mut tangent) = self.node(&start);
        if !(first.light.is_finite() && tangent.is_finite()) {
            return None;
        }
        let mut nodes = Vec::with_capacity(16);
        nodes.push(first);
        let mut place = start;
        let mut above = sign * first.rise > 0.0;
        while *steps > 0 {
            *steps -= 1;
            let last = *nodes.last()?;
            let steepest = place.change[0].length_squared() + place.change[1].length_squared();
            let longest = 0.5 * law.lattice.width[0].min(law.lattice.width[1]);
            let step = (STEP / steepest.sqrt()).min(longest);
            let reach = |length: f64| law.next(self.of, self.held, last.at + sign * length * tangent);
            let mut ends = false;
            let next = reach(step).or_else(|| {
                ends = true;
                let (mut low, mut width, mut best) = (0.0, step, None);
                for _ in 0..HALVINGS {
                    width *= 0.5;
                    if let Some(place) = reach(low + width) {
                        low += width;
                        best = Some(place);
                    }
                }
                best
            });
            let Some(next) = next else { return Some(nodes) };
            let (node, next_tangent) = self.node(&next);
            if !(node.light.is_finite() && next_tangent.is_finite()) {
                return None;
            }
            let mut seen = [node.p; 2];
            if (last.rise > 0.0) != (node.rise > 0.0) {
                // Turned in between: the parabola with both slopes.
                let length = node.at.distance(last.at) * sign;
                seen[0] = last.p + 0.5 * length * last.rise * last.rise / (last.rise - node.rise);
            }
            for p in seen {
                self.range = [self.range[0].min(p), self.range[1].max(p)];
                let now = p > first.p;
                self.alike += f64::from(u8::from(now != above));
                above = now;
            }
            nodes.push(node);
            if ends {
                return Some(nodes);
            }
            (place, tangent) = (next, next_tangent);
        }
        None
    }

    /// One place of the piece, drawn by the light that it brings, with all of it.
    fn stand_in(&self, law: &Law, u: f64, per_area: f64) -> Option<Connection> {
        let width = self.range[1] - self.range[0];
        let spread = self.light / (width * self.alike) * per_area;
        let mut left = u * self.light;
        for pair in self.nodes.windows(2) {
            let light = 0.5 * pair[0].length * (pair[0].light + pair[1].light);
            if left < light {
                let at = pair[0].at.lerp(pair[1].at, left / light);
                let place = law.next(self.of, self.held, at).or_else(|| law.place(pair[0].at))?;
                return (spread as f32).is_finite().then(|| place.connection(spread));
            }
            left -= light;
        }
        None
    }
}
