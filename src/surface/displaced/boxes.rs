//! Boxes around patches, four to one from level to level: what a ray does not meet is skipped whole.

use glam::DVec3;

/// Least and greatest corner, rounded outward; empty (least above greatest) where there is no patch.
type Box6 = [[f32; 3]; 2];

const EMPTY: Box6 = [[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]];

/// A quadtree of boxes over a grid of patches.
#[derive(Clone, Debug)]
pub(super) struct Boxes {
    /// Finest first; each level's width, then its boxes row by row.
    levels: Vec<(usize, Vec<Box6>)>,
}

impl Boxes {
    /// Over `cells` patches; `around` gives the box of a patch (m), or nothing where there is none. All boxes are padded
    /// by `pad` (m).
    pub(super) fn build(cells: [usize; 2], pad: f64, around: impl Fn(usize, usize) -> Option<[DVec3; 2]>) -> Self {
        let outward = |[low, high]: [DVec3; 2]| {
            // The conversion to single precision may go inward by half a unit in the last place.
            [
                (low - pad).to_array().map(|c| (c as f32).next_down()),
                (high + pad).to_array().map(|c| (c as f32).next_up()),
            ]
        };
        let finest = (0..cells[0] * cells[1])
            .map(|patch| around(patch % cells[0], patch / cells[0]).map_or(EMPTY, outward))
            .collect();
        let mut levels: Vec<(usize, Vec<Box6>)> = vec![(cells[0], finest)];
        loop {
            let (width, boxes) = &levels[levels.len() - 1];
            let (width, height) = (*width, boxes.len() / *width);
            if width * height == 1 {
                return Self { levels };
            }
            let size = [width.div_ceil(2), height.div_ceil(2)];
            let mut above = vec![EMPTY; size[0] * size[1]];
            for (index, one) in boxes.iter().enumerate() {
                let whole = &mut above[index / width / 2 * size[0] + index % width / 2];
                for axis in 0..3 {
                    whole[0][axis] = whole[0][axis].min(one[0][axis]);
                    whole[1][axis] = whole[1][axis].max(one[1][axis]);
                }
            }
            levels.push((size[0], above));
        }
    }

    /// The box around everything; empty if there is nothing.
    pub(super) fn whole(&self) -> Box6 {
        self.levels[self.levels.len() - 1].1[0]
    }

    /// Bytes held.
    pub(super) fn bytes(&self) -> u64 {
        self.levels.iter().map(|(_, boxes)| size_of_val(&boxes[..]) as u64).sum()
    }

    /// Visits the patches whose boxes a ray meets within `range`, nearest box first. `visit` gets the cell and the t of
    /// entry, and says up to where (t) the rest still matters.
    pub(super) fn walk(&self, ray: &BoxRay, range: [f64; 2], mut visit: impl FnMut([usize; 2], f64) -> f64) {
        let mut far = range[1];
        let top = self.levels.len() - 1;
        let mut stack: Vec<(f64, usize, [usize; 2])> = Vec::with_capacity(4 * self.levels.len());
        stack.extend(ray.enter(&self.whole(), range).map(|t| (t, top, [0; 2])));
        while let Some((enter, level, [i, j])) = stack.pop() {
            if enter > far {
                continue;
            }
            if level == 0 {
                far = far.min(visit([i, j], enter));
                continue;
            }
            let (width, boxes) = &self.levels[level - 1];
            let height = boxes.len() / width;
            let first = stack.len();
            for (a, b) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                let [i, j] = [2 * i + a, 2 * j + b];
                if i < *width && j < height {
                    let enter = ray.enter(&boxes[j * width + i], [range[0], far]);
                    stack.extend(enter.map(|t| (t, level - 1, [i, j])));
                }
            }
            // Last in, first out: the nearest last. Equal ones keep the order of the grid.
            stack[first..].sort_by(|a, b| b.0.total_cmp(&a.0));
        }
    }
}

/// A ray as boxes are asked about it.
pub(super) struct BoxRay {
    origin: DVec3,
    inverse: DVec3,
}

impl BoxRay {
    pub(super) fn new(origin: DVec3, direction: DVec3) -> Self {
        Self { origin, inverse: direction.recip() }
    }

    /// Where the ray enters a box within `range`; `None` if it misses it.
    fn enter(&self, [low, high]: &Box6, range: [f64; 2]) -> Option<f64> {
        let [mut near, mut far] = range;
        for axis in 0..3 {
            let (a, b) = (f64::from(low[axis]) - self.origin[axis], f64::from(high[axis]) - self.origin[axis]);
            let inverse = self.inverse[axis];
            if inverse.is_infinite() {
                if !(a <= 0.0 && 0.0 <= b) {
                    return None;
                }
                continue;
            }
            let (a, b) = (a * inverse, b * inverse);
            near = near.max(a.min(b));
            far = far.min(a.max(b));
        }
        // Rounding of the quotients, far less than the boxes' own padding unless the ray comes from very far.
        (near <= far + 4.0 * f64::EPSILON * far.abs() && low[0] <= high[0]).then_some(near)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patches_are_visited_from_near_to_far_and_holes_left_out() {
        let around = |i: usize, j: usize| {
            let low = DVec3::new(i as f64, 0.0, j as f64);
            (i != 3).then_some([low, low + 1.0])
        };
        let boxes = Boxes::build([9, 5], 1e-6, around);
        let ray = BoxRay::new(DVec3::new(20.0, 0.5, 2.5), DVec3::NEG_X);
        let mut seen = Vec::new();
        boxes.walk(&ray, [0.0, 100.0], |[i, j], enter| {
            assert!((enter - (19.0 - i as f64)).abs() < 1e-5);
            seen.push([i, j]);
            100.0
        });
        assert_eq!(seen, [8, 7, 6, 5, 4, 2, 1, 0].map(|i| [i, 2]));
        // What says that nothing further matters ends the walk.
        let mut count = 0;
        boxes.walk(&ray, [0.0, 100.0], |_, enter| {
            count += 1;
            enter
        });
        assert!(count <= 2);
        assert_eq!(boxes.whole()[1], [9.000001, 1.000001, 5.000001].map(|c: f64| (c as f32).next_up()));
    }
}
