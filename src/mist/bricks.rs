//! The sparse grid: bricks of 8x8x8 voxels where there is mist, a tree of tables that finds them, and the cells that a ray
//! crosses.
//!
//! Lengths are in voxels but for distances along a ray, which are in metres. The tree has as many levels as it takes to keep its
//! root small: none for what lies together, a few where a lone particle is kilometres away, so that a ray never steps
//! through more than a few thousand empty cells.

use std::{collections::HashMap, ops::ControlFlow};

use glam::{IVec3, Vec3};

/// Voxels of a brick along an axis, and children of a table.
pub(super) const SIDE: i32 = 8;

/// Corners of a brick's voxels along an axis: those on its far sides are the next brick's as well, so that a brick is
/// interpolated by itself.
pub(super) const CORNERS: usize = SIDE as usize + 1;

/// Corners of a brick.
pub(super) const VALUES: usize = CORNERS * CORNERS * CORNERS;

/// Bytes that a brick takes.
pub(super) const BRICK_BYTES: u64 =
    (VALUES * size_of::<f32>() + size_of::<f32>() + size_of::<IVec3>() + size_of::<Vec3>()) as u64;

/// Cells of the root at most.
const ROOT: i64 = 1 << 15;

/// No child.
const NONE: u32 = u32::MAX;

/// Children of a cell, x fastest.
type Table = [u32; (SIDE * SIDE * SIDE) as usize];

/// Bricks and what finds them.
#[derive(Clone, Debug, Default)]
pub(super) struct Bricks {
    /// Places, in bricks.
    place: Vec<IVec3>,
    /// Greatest value of each brick.
    most: Vec<f32>,
    /// Values at the corners, x fastest, brick by brick.
    values: Vec<f32>,
    /// Mean velocity of each brick (m/s).
    velocity: Vec<Vec3>,
    /// Tables of each level above the bricks.
    levels: Vec<Vec<Table>>,
    /// Places of the root's first cell and their count, in cells of the highest level.
    low: IVec3,
    count: IVec3,
    root: Vec<u32>,
    /// Bounds of all bricks (voxels).
    bounds: [Vec3; 2],
}

/// A ray in voxels, with distances in metres.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ray {
    origin: Vec3,
    direction: Vec3,
    inverse: Vec3,
}

impl Ray {
    #[cfg(test)]
    pub(super) fn new(origin: Vec3, direction: Vec3, voxel: f32) -> Self {
        Self::in_voxels(origin / voxel, direction / voxel)
    }

    /// From an origin (voxels), by so many voxels to a metre.
    pub(super) fn in_voxels(origin: Vec3, direction: Vec3) -> Self {
        Self { origin, direction, inverse: direction.recip() }
    }

    #[inline]
    fn at(&self, t: f32) -> Vec3 {
        self.origin + t * self.direction
    }

    /// Where along an axis a plane is met; nowhere if the ray runs along it.
    #[inline]
    fn plane(&self, axis: usize, place: f32) -> f32 {
        if self.direction[axis] == 0.0 { f32::INFINITY } else { (place - self.origin[axis]) * self.inverse[axis] }
    }

    /// The part of 0..reach within a box; `None` if there is none.
    fn clip(&self, [low, high]: [Vec3; 2], reach: f32) -> Option<[f32; 2]> {
        let (mut start, mut end) = (0.0f32, reach);
        for axis in 0..3 {
            if self.direction[axis] == 0.0 {
                if !(self.origin[axis] >= low[axis] && self.origin[axis] <= high[axis]) {
                    return None;
                }
                continue;
            }
            let (a, b) = (self.plane(axis, low[axis]), self.plane(axis, high[axis]));
            start = start.max(a.min(b));
            end = end.min(a.max(b));
        }
        (start < end).then_some([start, end])
    }

    /// Calls `visit` with each cell of `size` voxels among `count` from `low` on that the ray crosses from `start` to `end`,
    /// and where it enters and leaves it, in order (J. Amanatides and A. Woo, A fast voxel traversal algorithm, 1987).
    #[inline]
    fn cells(
        &self,
        [low, count]: [IVec3; 2],
        size: f32,
        [start, end]: [f32; 2],
        mut visit: impl FnMut(IVec3, [f32; 2]) -> ControlFlow<()>,
    ) -> ControlFlow<()> {
        let last = low + count - IVec3::ONE;
        // Rounding may leave a point on a border on either side of it: the next border is then behind, and met at once.
        let mut cell = (self.at(start) / size).floor().as_ivec3().clamp(low, last);
        let step = IVec3::new(sign(self.direction.x), sign(self.direction.y), sign(self.direction.z));
        let border = |cell: IVec3, axis: usize| self.plane(axis, (cell[axis] + step[axis].max(0)) as f32 * size);
        let mut next = Vec3::new(border(cell, 0), border(cell, 1), border(cell, 2));
        let mut from = start;
        loop {
            let axis = if next.x <= next.y && next.x <= next.z {
                0
            } else if next.y <= next.z {
                1
            } else {
                2
            };
            let to = next[axis].clamp(from, end);
            if to > from {
                visit(cell, [from, to])?;
            }
            // Not a number is not under the end, either.
            if !(next[axis] < end) {
                return ControlFlow::Continue(());
            }
            from = to;
            cell[axis] += step[axis];
            if cell[axis] < low[axis] || cell[axis] > last[axis] {
                return ControlFlow::Continue(());
            }
            next[axis] = border(cell, axis);
        }
    }
}

fn sign(value: f32) -> i32 {
    i32::from(value > 0.0) - i32::from(value < 0.0)
}

/// Index of a cell among `count`, x fastest.
#[inline]
fn index(cell: IVec3, count: IVec3) -> usize {
    ((cell.z * count.y + cell.y) * count.x + cell.x) as usize
}

const TABLE: IVec3 = IVec3::splat(SIDE);

impl Bricks {
    /// Bricks at `place` (in bricks, no two alike) with their `values` and mean velocities.
    pub(super) fn new(place: Vec<IVec3>, values: Vec<f32>, velocity: Vec<Vec3>) -> Self {
        if place.is_empty() {
            return Self::default();
        }
        let most = values.chunks_exact(VALUES).map(|brick| brick.iter().copied().fold(0.0, f32::max)).collect();
        let bounds = bounds(&place);
        let mut cells = place.clone();
        let mut levels = Vec::new();
        let (low, count) = loop {
            let [low, high] = bounds_of(&cells);
            let count = (high - low).as_i64vec3() + glam::I64Vec3::ONE;
            // One by one first: three widths of millions of bricks overflow their product.
            if count.max_element() <= ROOT && count.x * count.y * count.z <= ROOT {
                break (low, count.as_ivec3());
            }
            let (parents, tables) = parents(&cells);
            levels.push(tables);
            cells = parents;
        };
        let mut root = vec![NONE; index(IVec3::ZERO.with_z(count.z), count)];
        for (child, cell) in cells.iter().enumerate() {
            root[index(*cell - low, count)] = child as u32;
        }
        Self { place, most, values, velocity, levels, low, count, root, bounds }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.place.is_empty()
    }

    /// Places, in bricks.
    pub(super) fn places(&self) -> &[IVec3] {
        &self.place
    }

    pub(super) fn bytes(&self) -> u64 {
        let tables: usize = self.levels.iter().map(|tables| size_of_val(tables.as_slice())).sum();
        self.place.len() as u64 * BRICK_BYTES + (tables + size_of_val(self.root.as_slice())) as u64
    }

    /// Greatest value of a brick.
    #[inline]
    pub(super) fn most(&self, brick: u32) -> f32 {
        self.most[brick as usize]
    }

    /// Mean velocity (m/s) of a brick.
    #[inline]
    pub(super) fn velocity(&self, brick: u32) -> Vec3 {
        self.velocity[brick as usize]
    }

    /// Greatest value of all.
    pub(super) fn greatest(&self) -> f32 {
        self.most.iter().copied().fold(0.0, f32::max)
    }

    /// The brick of a point (voxels).
    pub(super) fn find(&self, point: Vec3) -> Option<u32> {
        let [low, high] = self.bounds;
        // Not a number lies in no box.
        if !(point.cmpge(low).all() && point.cmple(high).all()) {
            return None;
        }
        let brick = (point / SIDE as f32).floor().as_ivec3();
        let cell = (brick >> (3 * self.levels.len() as i32)) - self.low;
        if cell.cmplt(IVec3::ZERO).any() || cell.cmpge(self.count).any() {
            return None;
        }
        let mut child = self.root[index(cell, self.count)];
        for (level, tables) in self.levels.iter().enumerate().rev() {
            let table = tables.get(child as usize)?;
            child = table[index(brick >> (3 * level as i32) & (SIDE - 1), TABLE)];
        }
        (child != NONE).then_some(child)
    }

    /// Calls `visit` with each brick that a ray crosses before `reach` metres, and where, in order, until it breaks.
    pub(super) fn crossed(
        &self,
        ray: &Ray,
        reach: f32,
        visit: &mut impl FnMut(u32, [f32; 2]) -> ControlFlow<()>,
    ) -> ControlFlow<()> {
        match ray.clip(self.bounds, reach) {
            Some(part) => self.descend(ray, self.levels.len(), [self.low, self.count], &self.root, part, visit),
            None => ControlFlow::Continue(()),
        }
    }

    fn descend(
        &self,
        ray: &Ray,
        level: usize,
        [low, count]: [IVec3; 2],
        table: &[u32],
        part: [f32; 2],
        visit: &mut impl FnMut(u32, [f32; 2]) -> ControlFlow<()>,
    ) -> ControlFlow<()> {
        let size = (SIDE as f32).powi(level as i32 + 1);
        ray.cells([low, count], size, part, |cell, part| {
            let child = table[index(cell - low, count)];
            match level.checked_sub(1) {
                _ if child == NONE => ControlFlow::Continue(()),
                None => visit(child, part),
                Some(below) => {
                    let table = &self.levels[below][child as usize];
                    self.descend(ray, below, [cell * SIDE, TABLE], table, part, visit)
                }
            }
        })
    }

    /// Calls `visit` with where a ray enters and leaves each voxel of a brick between two distances, in order.
    pub(super) fn voxels(
        &self,
        ray: &Ray,
        brick: u32,
        part: [f32; 2],
        mut visit: impl FnMut([f32; 2]) -> ControlFlow<()>,
    ) -> ControlFlow<()> {
        ray.cells([self.place[brick as usize] * SIDE, TABLE], 1.0, part, |_, part| visit(part))
    }

    /// The number of the first corner of a brick's voxel around a point (voxels), and how far from it the point lies, 0..1.
    #[inline]
    fn corner(&self, brick: u32, point: Vec3) -> (usize, Vec3) {
        let place = (self.place[brick as usize] * SIDE).as_vec3();
        let local = (point - place).clamp(Vec3::ZERO, Vec3::splat(SIDE as f32));
        let voxel = local.floor().min(Vec3::splat(SIDE as f32 - 1.0));
        let [x, y, z] = voxel.to_array().map(|place| place as usize);
        (brick as usize * VALUES + (z * CORNERS + y) * CORNERS + x, local - voxel)
    }

    /// The value at a point (voxels) of a brick.
    #[inline]
    pub(super) fn value(&self, brick: u32, point: Vec3) -> f32 {
        let (first, share) = self.corner(brick, point);
        let value = |dy: usize, dz: usize| {
            let at = first + (dz * CORNERS + dy) * CORNERS;
            let (low, high) = (self.values[at], self.values[at + 1]);
            low + share.x * (high - low)
        };
        let between = |low: f32, high: f32, share: f32| low + share * (high - low);
        let near = between(value(0, 0), value(1, 0), share.y);
        let far = between(value(0, 1), value(1, 1), share.y);
        // Rounding alone would leave the range.
        between(near, far, share.z).clamp(0.0, self.most[brick as usize])
    }

    /// What the corners of a brick's voxel around a point (voxels) have, linear between them; `values` has one of each corner.
    pub(super) fn between(&self, values: &[Vec3], brick: u32, point: Vec3) -> Vec3 {
        let (first, share) = self.corner(brick, point);
        let row = |dy: usize, dz: usize| {
            let at = first + (dz * CORNERS + dy) * CORNERS;
            values[at].lerp(values[at + 1], share.x)
        };
        row(0, 0).lerp(row(1, 0), share.y).lerp(row(0, 1).lerp(row(1, 1), share.y), share.z)
    }

    /// The value where a ray is, `t` metres on, in a brick.
    #[inline]
    pub(super) fn value_on(&self, ray: &Ray, brick: u32, t: f32) -> f32 {
        self.value(brick, ray.at(t))
    }
}

fn bounds_of(cells: &[IVec3]) -> [IVec3; 2] {
    cells.iter().fold([IVec3::MAX, IVec3::MIN], |[low, high], &cell| [low.min(cell), high.max(cell)])
}

fn bounds(place: &[IVec3]) -> [Vec3; 2] {
    let [low, high] = bounds_of(place);
    [(low * SIDE).as_vec3(), ((high + IVec3::ONE) * SIDE).as_vec3()]
}

/// The cells one level higher, in the order of their first children, and their tables.
fn parents(cells: &[IVec3]) -> (Vec<IVec3>, Vec<Table>) {
    let (mut parents, mut tables) = (Vec::new(), Vec::<Table>::new());
    let mut known = HashMap::new();
    for (child, &cell) in cells.iter().enumerate() {
        let parent = cell >> 3;
        let table = *known.entry(parent).or_insert_with(|| {
            parents.push(parent);
            tables.push([NONE; (SIDE * SIDE * SIDE) as usize]);
            tables.len() - 1
        });
        tables[table][index(cell & (SIDE - 1), TABLE)] = child as u32;
    }
    (parents, tables)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Bricks at the given places; each is full of its own number.
    fn filled(place: Vec<IVec3>) -> Bricks {
        let values = (0..place.len()).flat_map(|brick| [brick as f32 + 1.0; VALUES]).collect();
        let velocity = vec![Vec3::ZERO; place.len()];
        Bricks::new(place, values, velocity)
    }

    fn scattered(far: bool) -> Vec<IVec3> {
        let mut place: Vec<IVec3> =
            (0..60).map(|i| IVec3::new(i * 7 % 11 - 5, i * 5 % 9 - 4, i * 3 % 13 - 6)).collect();
        place.sort_by_key(|place| place.to_array());
        place.dedup();
        if far {
            place.push(IVec3::new(1 << 20, -3, 4));
            place.push(IVec3::new(-(1 << 26), 1 << 26, 1 << 25));
        }
        place
    }

    #[test]
    fn every_brick_is_found_and_nothing_else() {
        for far in [false, true] {
            let place = scattered(far);
            let bricks = filled(place.clone());
            assert_eq!(bricks.levels.is_empty(), !far);
            for (brick, place) in place.iter().enumerate() {
                let middle = (place.as_vec3() + 0.5) * SIDE as f32;
                assert_eq!(bricks.find(middle), Some(brick as u32), "{place}");
                assert_eq!(bricks.value(brick as u32, middle), brick as f32 + 1.0);
            }
            let mut missing = 0;
            for i in 0..1000 {
                let cell = IVec3::new(i % 10 - 5, i / 10 % 10 - 5, i / 100 - 5);
                let known = place.contains(&cell);
                missing += u32::from(!known);
                assert_eq!(bricks.find((cell.as_vec3() + 0.5) * SIDE as f32).is_some(), known, "{cell}");
            }
            assert!(missing > 500);
            for value in [f32::NAN, f32::INFINITY, -1e30] {
                assert_eq!(bricks.find(Vec3::new(value, 0.0, 0.0)), None);
            }
        }
    }

    #[test]
    fn a_ray_crosses_the_bricks_that_it_is_in_in_order() {
        for far in [false, true] {
            let bricks = filled(scattered(far));
            for i in 0..300 {
                let [a, b, c, d] = sobol_burley::sample_4d(i, 0, 5);
                let [e, ..] = sobol_burley::sample_4d(i, 1, 5);
                let origin = 160.0 * Vec3::new(a - 0.5, b - 0.5, c - 0.5);
                let mut direction = Vec3::new(d - 0.5, e - 0.5, a - c).normalize();
                // Along axes and planes as well.
                if i % 5 == 0 {
                    direction = Vec3::new(direction.x.signum(), 0.0, 0.0);
                } else if i % 7 == 0 {
                    direction = direction.with_y(0.0).normalize();
                }
                // Half a metre to a voxel.
                let ray = Ray::new(origin * 0.5, direction, 0.5);
                let (mut seen, mut at) = (Vec::new(), 0.0);
                let _ = bricks.crossed(&ray, 60.0, &mut |brick, [start, end]| {
                    assert!(start >= at && end > start && end <= 60.0);
                    at = end;
                    let middle = ray.at(0.5 * (start + end)) / SIDE as f32;
                    let outside = (middle - bricks.place[brick as usize].as_vec3() - 0.5).abs().max_element() - 0.5;
                    assert!(outside < 1e-4, "{outside}");
                    seen.push((brick, end - start));
                    ControlFlow::Continue(())
                });
                // Against many points along it.
                let (mut inside, steps) = (0, 20_000);
                for step in 0..steps {
                    let t = (step as f32 + 0.5) * 60.0 / steps as f32;
                    inside += u32::from(bricks.find(ray.at(t)).is_some());
                }
                let length: f32 = seen.iter().map(|seen| seen.1).sum();
                assert!((length - inside as f32 * 60.0 / steps as f32).abs() < 0.05, "ray {i}: {length}, {inside}");
            }
        }
    }

    #[test]
    fn voxels_cut_a_brick_without_gaps() {
        let bricks = filled(vec![IVec3::new(-1, 0, 0)]);
        let ray = Ray::new(Vec3::new(-9.0, 0.3, 1.0), Vec3::new(0.8, 0.48, 0.36), 1.0);
        let mut parts = Vec::new();
        let _ = bricks.crossed(&ray, f32::INFINITY, &mut |brick, part| {
            let mut at = part[0];
            let flow = bricks.voxels(&ray, brick, part, |[start, end]| {
                assert_eq!(start, at);
                at = end;
                parts.push(end - start);
                ControlFlow::Continue(())
            });
            assert_eq!(at, part[1]);
            flow
        });
        assert!(parts.len() > 10 && parts.iter().all(|part| *part <= 1.25 + 1e-5), "{parts:?}");
    }
}
