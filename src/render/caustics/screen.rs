//! Sixteen parts of a cell at once, in single precision: the two tests of `search` that prove a part empty.
//!
//! Where water focuses, most of a search is spent on parts of which nothing can be said but that they are empty: they are
//! thrown away here before any is looked at in double precision. Rounding is room on top of `search`'s bounds: what is
//! thrown away has no root in exact arithmetic either. The loop over parts is a plain one that the compiler turns into
//! vectors.

use super::{polynomial::Polynomial, search::Light};

/// Parts along each axis.
pub(super) const SIDE: usize = 4;
/// Parts of a cell.
const LANES: usize = SIDE * SIDE;

/// Room for the rounding of sums of some twenty terms, as a share of their sizes, ten times over.
const ROOM: f32 = 1e-5;

/// The same for a comparison's larger side. Cells reach over their borders by less.
const OVER: f32 = 1.0 + 1e-4;

/// A cell as the test wants it.
pub(super) struct Screen<'p, const K: usize> {
    /// Heights over the cell, from -1 to 1.
    pub(super) polynomial: &'p Polynomial<f64, K>,
    /// Half widths of the cell (m).
    pub(super) half: [f64; 2],
    /// The point relative to the cell's middle at its own height.
    pub(super) from: [f64; 3],
    /// The light, relative to the same where it is a place.
    pub(super) light: Light,
    /// Index on the point's side.
    pub(super) ior: f64,
    /// Added to the slopes.
    pub(super) tilt: [f64; 2],
}

/// A way from a part's middle, and how much it turns over the part.
struct Way {
    direction: [f32; 3],
    /// Its weight over its length.
    pull: f32,
    sine: f32,
    /// Most that it turns by, with its weight.
    chord: f32,
}

impl Way {
    #[inline(always)]
    fn new(to: [f32; 3], weight: f32, radius: f32) -> Self {
        let inverse = 1.0 / dot(to, to).sqrt();
        let sine = radius * inverse;
        let chord = weight * sine * (1.0 + 0.414_22 * sine * sine);
        Self { direction: [to[0] * inverse, to[1] * inverse, to[2] * inverse], pull: weight * inverse, sine, chord }
    }
}

#[inline(always)]
fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

impl<const K: usize> Screen<'_, K> {
    /// Bits of the parts, row by row, that may hold a root.
    #[inline(always)]
    pub(super) fn survivors(&self) -> u16 {
        let (at_infinity, light) = match self.light {
            Light::Direction(to) => (true, to.as_vec3().to_array()),
            Light::Point(place) => (false, place.as_vec3().to_array()),
        };
        let mut p = Polynomial([[0.0f32; K]; K]);
        for a in 0..K {
            for b in 0..K {
                p.0[a][b] = self.polynomial.0[a][b] as f32;
            }
        }
        // Heights are taken from the cell's middle.
        p.0[0][0] = 0.0;
        let n = self.ior as f32;
        let from = [self.from[0] as f32, self.from[1] as f32, self.from[2] as f32];
        let whole = [self.half[0] as f32, self.half[1] as f32];
        let half = [whole[0] / SIDE as f32, whole[1] / SIDE as f32];
        let tilt = [self.tilt[0] as f32 * half[0], self.tilt[1] as f32 * half[1]];
        let far_share = if at_infinity { 0.0 } else { 1.0 };
        let mut kept = [0u32; LANES];
        for lane in 0..LANES {
            let x = ((lane % SIDE) as f32 * 2.0 + 1.0) / SIDE as f32 - 1.0;
            let y = ((lane / SIDE) as f32 * 2.0 + 1.0) / SIDE as f32 - 1.0;
            let p = p.over([x, y], [1.0 / SIDE as f32; 2]);
            let (jet, ranges) = (p.jet_at_middle(), p.ranges());
            let place = [x * whole[0], jet.height, y * whole[1]];
            let radius = (half[0] * half[0] + half[1] * half[1] + ranges.height * ranges.height).sqrt();
            let near = Way::new([from[0] - place[0], from[1] - place[1], from[2] - place[2]], n, radius);
            let to_light =
                [light[0] - far_share * place[0], light[1] - far_share * place[1], light[2] - far_share * place[2]];
            let far = Way::new(to_light, 1.0, far_share * radius);
            let far_pull = far_share * far.pull;
            let h = [
                n * near.direction[0] + far.direction[0],
                n * near.direction[1] + far.direction[1],
                n * near.direction[2] + far.direction[2],
            ];
            let tangents = [[half[0], jet.first[0], 0.0], [0.0, jet.first[1], half[1]]];
            let tilted = [[half[0], jet.first[0] + tilt[0], 0.0], [0.0, jet.first[1] + tilt[1], half[1]]];
            let chord = near.chord + far.chord;
            let length = [dot(tangents[0], tangents[0]).sqrt(), dot(tangents[1], tangents[1]).sqrt()];
            let tilted_length = [dot(tilted[0], tilted[0]).sqrt(), dot(tilted[1], tilted[1]).sqrt()];
            let f = [dot(h, tilted[0]), dot(h, tilted[1])];
            let f_room = [ROOM * (n + 1.0) * tilted_length[0], ROOM * (n + 1.0) * tilted_length[1]];
            // The Jacobian at the middle, and most that it differs by over the part, rounding included.
            let (mut j, mut d) = ([[0.0f32; 2]; 2], [[0.0f32; 2]; 2]);
            for i in 0..2 {
                for k in 0..2 {
                    let (bend, range) = (jet.second[i][k], ranges.second[i][k]);
                    j[i][k] = h[1] * bend;
                    d[i][k] = h[1].abs() * range + chord * (bend.abs() + range) + ROOM * (n + 1.0) * bend.abs();
                    for (way, pull) in [(&near, near.pull), (&far, far_pull)] {
                        let growth = way.sine / (1.0 - way.sine);
                        let turned = way.sine * tilted_length[i] * length[k]
                            + ranges.first[i] * length[k]
                            + ranges.first[k] * tilted_length[i]
                            + ranges.first[i] * ranges.first[k];
                        let across = dot(tilted[i], tangents[k])
                            - dot(way.direction, tilted[i]) * dot(way.direction, tangents[k]);
                        j[i][k] -= pull * across;
                        let room = ROOM * tilted_length[i] * length[k];
                        d[i][k] += pull * ((1.0 + growth) * turned + growth * across.abs() + room);
                    }
                }
            }
            let determinant = (j[0][0] * j[1][1] - j[0][1] * j[1][0]).abs();
            let adjugate = [[j[1][1], -j[0][1]], [-j[1][0], j[0][0]]];
            let mut empty = false;
            for i in 0..2 {
                let most = j[i][0].abs() + d[i][0] + j[i][1].abs() + d[i][1];
                empty |= f[i].abs() > OVER * most + f_room[i];
                let [a, b] = adjugate[i];
                let doubt = a.abs() * (d[0][0] + d[0][1] + f_room[0]) + b.abs() * (d[1][0] + d[1][1] + f_room[1]);
                empty |= (a * f[0] + b * f[1]).abs() > OVER * (determinant + doubt);
            }
            // Too near for a bound, or no number: anything may be.
            let bounded = (near.sine < 0.5) & (far.sine < 0.5);
            kept[lane] = u32::from(!(empty & bounded)) << lane;
        }
        kept.iter().sum::<u32>() as u16
    }
}
