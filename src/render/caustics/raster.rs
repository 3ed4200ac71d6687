//! Triangles of light spread over a map by exact area, band by band: what `beams` draws with.
//!
//! Every texel gets the share of a triangle's flux that the triangle's area within it has, so that nothing is lost between
//! texels and no triangle is too thin or too small to count. Bands of rows are filled in parallel, each in the order of
//! the triangles: the same bits at any count of threads.

use rayon::prelude::*;

/// Rows of a band: few enough for many threads, enough that triangles seldom lie in two.
const BAND: usize = 16;

/// Area (texels) under which a triangle's flux goes to one texel whole: shares of less, differences of coordinates to some
/// 1e-12 of a texel, would not sum to one within single precision.
const LEAST_AREA: f64 = 1e-9;

/// Light over three corners: x, z in texels, height in metres.
#[derive(Clone, Copy, Debug)]
pub(super) struct Beam {
    pub(super) corners: [[f64; 3]; 3],
    /// Flux by channel, to spread evenly over the triangle.
    pub(super) flux: [f64; 3],
}

/// Sums of one texel: flux by channel, and their sum times height.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Texel {
    pub(super) flux: [f64; 3],
    pub(super) moment: f64,
}

/// Spreads rows of beams over a map of `size` texels.
pub(super) fn spread(rows: &[Vec<Beam>], size: [usize; 2]) -> Vec<Texel> {
    let depth = |beam: &Beam| beam.corners.map(|corner| corner[1]);
    let ranges: Vec<[f64; 2]> = rows
        .iter()
        .map(|row| {
            row.iter()
                .flat_map(depth)
                .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], z| [low.min(z), high.max(z)])
        })
        .collect();
    let mut map = vec![Texel::default(); size[0] * size[1]];
    map.par_chunks_mut(BAND * size[0]).enumerate().for_each(|(band, texels)| {
        let first = band * BAND;
        let (low, high) = (first as f64, (first + texels.len() / size[0]) as f64);
        for (row, range) in rows.iter().zip(&ranges) {
            if range[1] < low || range[0] > high {
                continue;
            }
            for beam in row {
                let z = depth(beam);
                if z.iter().any(|&z| z >= low) && z.iter().any(|&z| z <= high) {
                    add(beam, texels, size[0], first);
                }
            }
        }
    });
    map
}

/// Adds a beam to the rows of a band that starts at row `first`.
fn add(beam: &Beam, texels: &mut [Texel], width: usize, first: usize) {
    let rows = texels.len() / width;
    let [a, b, c] = beam.corners;
    let cross = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1]);
    let area = 0.5 * cross.abs();
    if !(area >= LEAST_AREA) {
        let middle: [f64; 3] = std::array::from_fn(|k| (a[k] + b[k] + c[k]) / 3.0);
        let (x, z) = (middle[0].floor(), middle[1].floor() - first as f64);
        if (0.0..width as f64).contains(&x) && (0.0..rows as f64).contains(&z) {
            put(&mut texels[z as usize * width + x as usize], beam, 1.0, middle[2]);
        }
        return;
    }
    // The height of the triangle's plane.
    let slope_x = ((b[2] - a[2]) * (c[1] - a[1]) - (c[2] - a[2]) * (b[1] - a[1])) / cross;
    let slope_z = ((c[2] - a[2]) * (b[0] - a[0]) - (b[2] - a[2]) * (c[0] - a[0])) / cross;
    let least = |axis: usize| a[axis].min(b[axis]).min(c[axis]);
    let greatest = |axis: usize| a[axis].max(b[axis]).max(c[axis]);
    let index = |value: f64, most: usize| value.floor().clamp(0.0, most as f64 - 1.0) as usize;
    let offset = first as f64;
    if greatest(0) < 0.0 || least(0) > width as f64 {
        return;
    }
    for row in index(least(1) - offset, rows)..=index(greatest(1) - offset, rows) {
        let z = (first + row) as f64;
        let mut strip = Polygon::triangle(a, b, c);
        strip.keep(1, z, 1.0);
        strip.keep(1, z + 1.0, -1.0);
        if strip.count < 3 {
            continue;
        }
        let (mut left, mut right) = (f64::INFINITY, f64::NEG_INFINITY);
        for corner in &strip.corners[..strip.count] {
            (left, right) = (left.min(corner[0]), right.max(corner[0]));
        }
        for column in index(left, width)..=index(right, width) {
            let mut part = strip;
            part.keep(0, column as f64, 1.0);
            part.keep(0, column as f64 + 1.0, -1.0);
            let share = part.area() / area;
            if share > 0.0 {
                let middle = part.middle();
                let height = a[2] + slope_x * (middle[0] - a[0]) + slope_z * (middle[1] - a[1]);
                put(&mut texels[row * width + column], beam, share, height);
            }
        }
    }
}

fn put(texel: &mut Texel, beam: &Beam, share: f64, height: f64) {
    let mut sum = 0.0;
    for channel in 0..3 {
        let flux = share * beam.flux[channel];
        texel.flux[channel] += flux;
        sum += flux;
    }
    texel.moment += sum * height;
}

/// A convex polygon: a triangle cut by four lines has seven corners at most.
#[derive(Clone, Copy)]
struct Polygon {
    corners: [[f64; 2]; 8],
    count: usize,
}

impl Polygon {
    fn triangle(a: [f64; 3], b: [f64; 3], c: [f64; 3]) -> Self {
        let mut corners = [[0.0; 2]; 8];
        for (slot, corner) in corners.iter_mut().zip([a, b, c]) {
            *slot = [corner[0], corner[1]];
        }
        Self { corners, count: 3 }
    }

    /// Keeps what lies above (`side` 1) or below (-1) a value along an axis (Sutherland and Hodgman 1974).
    fn keep(&mut self, axis: usize, value: f64, side: f64) {
        let mut kept = Self { corners: [[0.0; 2]; 8], count: 0 };
        for k in 0..self.count {
            let (here, next) = (self.corners[k], self.corners[(k + 1) % self.count]);
            let (inside, after) = (side * (here[axis] - value), side * (next[axis] - value));
            if inside >= 0.0 {
                kept.push(here);
            }
            if (inside >= 0.0) != (after >= 0.0) {
                let t = inside / (inside - after);
                let mut cut = std::array::from_fn(|k| here[k] + t * (next[k] - here[k]));
                cut[axis] = value;
                kept.push(cut);
            }
        }
        *self = kept;
    }

    fn push(&mut self, corner: [f64; 2]) {
        // Rounding may cut a corner twice; an eighth corner is the most that four cuts make of it.
        if self.count < self.corners.len() {
            self.corners[self.count] = corner;
            self.count += 1;
        }
    }

    fn area(&self) -> f64 {
        let origin = self.corners[0];
        let mut sum = 0.0;
        for k in 1..self.count.max(2) - 1 {
            let (a, b) = (self.corners[k], self.corners[k + 1]);
            sum += (a[0] - origin[0]) * (b[1] - origin[1]) - (b[0] - origin[0]) * (a[1] - origin[1]);
        }
        0.5 * sum.abs()
    }

    fn middle(&self) -> [f64; 2] {
        let mut sum = [0.0; 2];
        for corner in &self.corners[..self.count] {
            sum = [sum[0] + corner[0], sum[1] + corner[1]];
        }
        sum.map(|value| value / self.count as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flux_is_shared_by_area_and_none_is_lost() {
        // A triangle of area 8 over whole and cut texels, one that is a line, one that is a point, one half outside.
        let beam = |corners: [[f64; 2]; 3], flux: f64| Beam {
            corners: corners.map(|[x, z]| [x, z, 0.5 * x]),
            flux: [flux, 2.0 * flux, 0.0],
        };
        let inside = [
            beam([[1.0, 1.0], [5.0, 1.0], [1.0, 5.0]], 8.0),
            beam([[2.0, 17.5], [6.0, 17.5], [4.0, 17.5]], 3.0),
            beam([[7.25, 20.25]; 3], 4.0),
        ];
        let rows = vec![inside.to_vec(), vec![beam([[-2.0, 30.0], [2.0, 30.0], [0.0, 32.0]], 6.0)]];
        let map = spread(&rows, [10, 40]);
        let at = |x: usize, z: usize| map[z * 10 + x];
        assert!((at(1, 1).flux[0] - 1.0).abs() < 1e-12 && (at(4, 1).flux[1] - 1.0).abs() < 1e-12);
        assert!((at(1, 1).moment - 3.0 * 0.75).abs() < 1e-12);
        assert_eq!((at(7, 20).flux[0], at(4, 17).flux[0]), (4.0, 3.0));
        let sum: f64 = map.iter().map(|texel| texel.flux[0]).sum();
        assert!((sum - 18.0).abs() < 1e-12, "{sum}");
    }
}
