//! A patch as a Bézier net of 3-D points: its values, slopes, parts and hulls. Knows nothing of rays or columns.

use glam::DVec3;

use crate::surface::lattice::to_bezier;

/// Control points of a patch of degree 1 to 3 along both axes: `[row along v][column along u]`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Net {
    /// Degree along both axes.
    pub(super) degree: usize,
    /// Points; entries past the degree are of no account.
    pub(super) points: [[DVec3; 4]; 4],
}

impl Net {
    /// From the `order` x `order` control points of a uniform B-spline's cell.
    pub(super) fn from_spline(order: usize, window: &[[DVec3; 4]; 4]) -> Self {
        let mut net = Self { degree: order - 1, points: [[DVec3::ZERO; 4]; 4] };
        for axis in 0..3 {
            let rows: [[f64; 4]; 4] = std::array::from_fn(|b| to_bezier(order, window[b].map(|point| point[axis])));
            for a in 0..order {
                let column = to_bezier(order, std::array::from_fn(|b| rows[b][a]));
                for b in 0..order {
                    net.points[b][a][axis] = column[b];
                }
            }
        }
        net
    }

    /// Every control point through a function that keeps lines straight.
    pub(super) fn map(&self, to: impl Fn(DVec3) -> DVec3) -> Self {
        Self { degree: self.degree, points: self.points.map(|row| row.map(&to)) }
    }

    /// All control points.
    pub(super) fn iter(&self) -> impl Iterator<Item = DVec3> {
        let n = self.degree;
        self.points.into_iter().take(n + 1).flat_map(move |row| row.into_iter().take(n + 1))
    }

    /// Least and greatest corner of the control points: the patch lies between.
    pub(super) fn hull(&self) -> [DVec3; 2] {
        self.iter().fold([DVec3::INFINITY, DVec3::NEG_INFINITY], |[low, high], p| [low.min(p), high.max(p)])
    }

    /// Point, slope along u and slope along v (de Casteljau's algorithm).
    pub(super) fn value(&self, u: f64, v: f64) -> [DVec3; 3] {
        let n = self.degree;
        let along = |row: &[DVec3; 4], s: f64| {
            let mut row = *row;
            for level in (2..=n).rev() {
                for k in 0..level {
                    row[k] = row[k] + (row[k + 1] - row[k]) * s;
                }
            }
            [row[0] + (row[1] - row[0]) * s, (row[1] - row[0]) * n as f64]
        };
        let (mut values, mut slopes) = ([DVec3::ZERO; 4], [DVec3::ZERO; 4]);
        for b in 0..=n {
            [values[b], slopes[b]] = along(&self.points[b], u);
        }
        let [point, along_v] = along(&values, v);
        [point, along(&slopes, v)[0], along_v]
    }

    /// The net with u and v exchanged.
    fn turned(&self) -> Self {
        let points = std::array::from_fn(|b| std::array::from_fn(|a| self.points[a][b]));
        Self { degree: self.degree, points }
    }

    /// The part over `range` of one axis (0: u, 1: v), rescaled to 0..1; the range may reach outside 0..1.
    pub(super) fn part(&self, axis: usize, range: [f64; 2]) -> Self {
        if axis == 1 {
            return self.turned().part(0, range).turned();
        }
        let n = self.degree;
        let mut part = *self;
        for row in &mut part.points {
            // Blossom: the k-th point of the part takes k arguments from the far end, the others from the near one.
            let whole = *row;
            for (k, slot) in row.iter_mut().enumerate().take(n + 1) {
                let mut points = whole;
                for level in 0..n {
                    let s = range[usize::from(level >= n - k)];
                    for a in 0..n - level {
                        points[a] = points[a] + (points[a + 1] - points[a]) * s;
                    }
                }
                *slot = points[0];
            }
        }
        part
    }

    /// Control vectors of the slope along an axis (0: u, 1: v).
    pub(super) fn slopes(&self, axis: usize) -> impl Iterator<Item = DVec3> {
        let (n, points) = (self.degree, self.points);
        (0..=n).flat_map(move |other| {
            (0..n).map(move |k| {
                let [from, to] = if axis == 0 {
                    [points[other][k], points[other][k + 1]]
                } else {
                    [points[k][other], points[k + 1][other]]
                };
                (to - from) * n as f64
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surface::lattice::basis;
    use crate::surface::tests::Random;

    fn window(random: &mut Random) -> [[DVec3; 4]; 4] {
        [0; 4].map(|_| [0; 4].map(|_| DVec3::new(random.next(), random.next(), random.next())))
    }

    #[test]
    fn a_net_is_the_splines_patch_and_its_parts_are_parts_of_it() {
        let mut random = Random(1);
        for order in 2..=4 {
            let window = window(&mut random);
            let net = Net::from_spline(order, &window);
            let part = net.part(0, [0.25, 0.75]).part(1, [-0.5, 1.25]);
            for k in 0..20 {
                let (u, v) = (f64::from(k) / 19.0, random.next());
                let ((bu, du), (bv, dv)) = (basis(order, u), basis(order, v));
                let sum = |x: &[f64; 4], z: &[f64; 4]| {
                    let terms = (0..order).flat_map(|b| (0..order).map(move |a| (a, b)));
                    terms.fold(DVec3::ZERO, |sum, (a, b)| sum + window[b][a] * x[a] * z[b])
                };
                let [point, along_u, along_v] = net.value(u, v);
                assert!((point - sum(&bu, &bv)).length() < 1e-14);
                assert!((along_u - sum(&du, &bv)).length() < 1e-13);
                assert!((along_v - sum(&bu, &dv)).length() < 1e-13);
                let [inside, inside_u, _] = part.value(u, v);
                let [expected, expected_u, _] = net.value(0.25 + 0.5 * u, -0.5 + 1.75 * v);
                assert!((inside - expected).length() < 1e-13);
                assert!((inside_u - 0.5 * expected_u).length() < 1e-13);
            }
        }
    }

    #[test]
    fn the_hull_and_the_slopes_hold_the_patch() {
        let mut random = Random(2);
        for order in 2..=4 {
            let net = Net::from_spline(order, &window(&mut random));
            let [low, high] = net.hull();
            let most = |axis| net.slopes(axis).map(|slope| slope.x).fold(f64::NEG_INFINITY, f64::max);
            for _ in 0..100 {
                let [point, along_u, along_v] = net.value(random.next(), random.next());
                assert!(point.cmpge(low).all() && point.cmple(high).all());
                assert!(along_u.x <= most(0) + 1e-12 && along_v.x <= most(1) + 1e-12);
            }
        }
    }
}
