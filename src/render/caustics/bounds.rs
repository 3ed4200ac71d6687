//! Which patches can send light to a point at all: a pyramid of boxes in height and slope, 4 x 4 to a block, and the test
//! that throws boxes away. What is left goes to `search`.
//!
//! *The test.* Light from s reaches the point where h = n d + w has no part along the tangents: F = h_x + p h_y = 0 with
//! the slope p, and the same along z. Over a box around c with half extents e, d(s) differs from d(c) by its first
//! derivative, -(I - d dᵀ) / R, and by at most 1/√3 (ρ / (R - ρ))² more: the second derivative of x / |x| along a unit
//! vector is at most 2/√3 / |x|² long. So |F| at the centre beyond what the box and its range of slopes can make up for
//! is proof that no light comes from it. No division by h, so nothing is special at grazing light.

use crate::surface::{Lattice, to_bezier};

/// Blocks are this many boxes wide.
pub(super) const SIDE: usize = 4;
/// Boxes of a block.
pub(super) const LANES: usize = SIDE * SIDE;

/// 1/√3, up.
const REMAINDER: f32 = 0.577_351;

/// Room for rounding, against magnitudes of order 1: some sixteen operations of half an ulp, ten times over.
const ROOM: f32 = 1e-5;

/// Sixteen boxes: middle and half of their range in height (m) and in the slopes along x and z.
#[derive(Clone, Debug)]
pub(super) struct Block {
    height: [[f32; LANES]; 2],
    slope: [[[f32; LANES]; 2]; 2],
}

impl Block {
    /// A half range below any other: no test keeps such a box.
    const NOTHING: f32 = -1e30;

    const EMPTY: Self = Self { height: [[0.0; LANES]; 2], slope: [[[0.0; LANES], [Self::NOTHING; LANES]]; 2] };
}

/// All blocks of one level, row by row.
#[derive(Clone, Debug)]
struct Level {
    blocks: Vec<Block>,
    /// Blocks along x.
    row: usize,
}

/// Least and greatest height and slopes of something; `None` where nothing is.
type Ranges = Option<[[f64; 2]; 3]>;

/// The pyramid; its last level is one block.
#[derive(Clone, Debug)]
pub(super) struct Bounds {
    levels: Vec<Level>,
}

/// The optics of a query as the test wants them: everything relative to the point, in single precision.
#[derive(Clone, Copy, Debug)]
pub(super) struct Probe {
    /// Index of refraction on the point's side.
    pub(super) ior: f32,
    /// Unit vector to the light, or the light's place relative to the point (m).
    pub(super) light: [f32; 3],
    /// Added to the slopes.
    pub(super) tilt: [f32; 2],
}

impl Bounds {
    pub(super) fn new(lattice: &Lattice) -> Self {
        let [nx, nz] = lattice.cells;
        let mut size = [nx, nz];
        let mut ranges: Vec<Ranges> = (0..nx * nz).map(|patch| patch_ranges(lattice, patch % nx, patch / nx)).collect();
        let mut levels = Vec::new();
        loop {
            let above = size.map(|n| n.div_ceil(SIDE));
            let mut level = Level { blocks: vec![Block::EMPTY; above[0] * above[1]], row: above[0] };
            let mut united: Vec<Ranges> = vec![None; above[0] * above[1]];
            for j in 0..size[1] {
                for i in 0..size[0] {
                    let Some(range) = ranges[j * size[0] + i] else { continue };
                    let block = j / SIDE * above[0] + i / SIDE;
                    level.blocks[block].put(j % SIDE * SIDE + i % SIDE, &range);
                    united[block] = Some(match united[block] {
                        None => range,
                        Some(other) => {
                            std::array::from_fn(|k| [range[k][0].min(other[k][0]), range[k][1].max(other[k][1])])
                        }
                    });
                }
            }
            levels.push(level);
            if above == [1, 1] {
                return Self { levels };
            }
            (size, ranges) = (above, united);
        }
    }

    /// Levels; the last is the top.
    pub(super) fn levels(&self) -> usize {
        self.levels.len()
    }

    /// Bits of the boxes of a block (row by row) that may send light to the point.
    ///
    /// `corner` is the middle of the first box in x and z and the height 0, relative to the point (m); `half` are the
    /// boxes' half widths.
    #[inline(always)]
    pub(super) fn survivors<const POINT: bool>(
        &self,
        level: usize,
        place: [usize; 2],
        corner: [f32; 3],
        half: [f32; 2],
        probe: &Probe,
    ) -> u16 {
        let level = &self.levels[level];
        let block = &level.blocks[place[1] * level.row + place[0]];
        let [ex, ez] = half;
        let n = probe.ior;
        let mut kept = [0u32; LANES];
        for lane in 0..LANES {
            let ey = block.height[1][lane];
            let x = corner[0] + (lane % SIDE) as f32 * 2.0 * ex;
            let y = corner[1] + block.height[0][lane];
            let z = corner[2] + (lane / SIDE) as f32 * 2.0 * ez;
            let radius = (ex * ex + ey * ey + ez * ez).sqrt();
            // From the box to the point, and to the light.
            let near = Ray::new([-x, -y, -z], radius);
            let far = if POINT {
                Ray::new([probe.light[0] - x, probe.light[1] - y, probe.light[2] - z], radius)
            } else {
                Ray { direction: probe.light, inverse: 0.0, chord: 0.0, rest: 0.0, inside: false }
            };
            let h: [f32; 3] = std::array::from_fn(|axis| n * near.direction[axis] + far.direction[axis]);
            let chord = n * near.chord + far.chord;
            let rest = n * near.rest + far.rest;
            let mut keep = true;
            for axis in 0..2 {
                let p = block.slope[axis][0][lane] + probe.tilt[axis];
                let ep = block.slope[axis][1][lane];
                let along = if axis == 0 { h[0] } else { h[2] };
                let first =
                    n * near.first(axis, p, [ex, ey, ez]) + if POINT { far.first(axis, p, [ex, ey, ez]) } else { 0.0 };
                let most = first + rest * (1.0 + p.abs()) + ep * (h[1].abs() + chord);
                let room = ROOM * (most.abs() + (n + 1.0) * (1.0 + p.abs()));
                // An empty box has a range below anything, which room, made from its size, must not outdo.
                keep &= !((along + p * h[1]).abs() > most + room) && ep >= 0.0;
            }
            let near_by = (near.inside | far.inside) && block.slope[0][1][lane] >= 0.0;
            kept[lane] = u32::from(keep | near_by) << lane;
        }
        kept.iter().sum::<u32>() as u16
    }
}

/// The way from a box to a point, and how it changes over the box.
struct Ray {
    direction: [f32; 3],
    /// One over the distance.
    inverse: f32,
    /// Most that the direction changes by.
    chord: f32,
    /// Most that it changes by beyond the first derivative.
    rest: f32,
    /// The point is in the box's sphere or hardly outside: anything may be.
    inside: bool,
}

impl Ray {
    #[inline(always)]
    fn new(to: [f32; 3], radius: f32) -> Self {
        let inverse = 1.0 / (to[0] * to[0] + to[1] * to[1] + to[2] * to[2]).sqrt();
        let sine = radius * inverse;
        let gap = sine / (1.0 - sine);
        Self {
            direction: to.map(|component| component * inverse),
            inverse,
            // 2 sin(α/2) = sin α / cos(α/2), and 1 / cos(α/2) is convex in sin² α: below its chord up to √2 at 1.
            chord: sine * (1.0 + 0.414_22 * sine * sine),
            rest: REMAINDER * gap * gap,
            inside: !(sine < 0.9),
        }
    }

    /// Most that the direction's part along the tangent (1, p, 0) or (0, p, 1) changes by, to first order.
    #[inline(always)]
    fn first(&self, axis: usize, p: f32, e: [f32; 3]) -> f32 {
        let d = self.direction;
        let (along, across) = if axis == 0 { (0, 2) } else { (2, 0) };
        let k = d[along] + p * d[1];
        let sum =
            (1.0 - k * d[along]).abs() * e[along] + (p - k * d[1]).abs() * e[1] + (k * d[across]).abs() * e[across];
        sum * self.inverse
    }
}

impl Block {
    fn put(&mut self, lane: usize, ranges: &[[f64; 2]; 3]) {
        for (k, &[low, high]) in ranges.iter().enumerate() {
            let middle = (0.5 * (low + high)) as f32;
            // Up to the far end as seen from the rounded middle, and one ulp for the rounding of that.
            let half = ((high - f64::from(middle)).max(f64::from(middle) - low) as f32).max(0.0).next_up();
            let slot = if k == 0 { &mut self.height } else { &mut self.slope[k - 1] };
            slot[0][lane] = middle;
            slot[1][lane] = half;
        }
    }
}

/// Ranges of a patch from its Bézier points in height and their differences, which hold it.
fn patch_ranges(lattice: &Lattice, i: usize, j: usize) -> Ranges {
    if !lattice.exists(i, j) {
        return None;
    }
    let order = lattice.order;
    let window = lattice.window(i, j);
    let rows: [[f64; 4]; 4] = std::array::from_fn(|b| to_bezier(order, window[b]));
    let columns: [[f64; 4]; 4] =
        std::array::from_fn(|a| to_bezier(order, [rows[0][a], rows[1][a], rows[2][a], rows[3][a]]));
    let mut ranges = [[f64::INFINITY, f64::NEG_INFINITY]; 3];
    let mut widen = |k: usize, value: f64| ranges[k] = [ranges[k][0].min(value), ranges[k][1].max(value)];
    let degree = (order - 1) as f64;
    for a in 0..order {
        for b in 0..order {
            widen(0, columns[a][b]);
            if a + 1 < order {
                widen(1, degree * (columns[a + 1][b] - columns[a][b]) / lattice.width[0]);
            }
            if b + 1 < order {
                widen(2, degree * (columns[a][b + 1] - columns[a][b]) / lattice.width[1]);
            }
        }
    }
    // Rounding of the conversion, and of the evaluation that must stay inside: a few ulp of the heights.
    let ulp = 16.0 * f64::EPSILON * window.iter().flatten().fold(0.0, |most: f64, height| most.max(height.abs()));
    let pads = [ulp, ulp * degree / lattice.width[0], ulp * degree / lattice.width[1]];
    Some(std::array::from_fn(|k| [ranges[k][0] - pads[k], ranges[k][1] + pads[k]]))
}
