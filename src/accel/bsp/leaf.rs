//! What lies in leaves: blocks of four primitives (of one curve) in structure-of-arrays form, and a ray's tests against them.
//!
//! Blocks repeat the scene's numbers in the order in which a walk meets them: the scene's own arrays would cost a ray a
//! cache line per primitive. Equal distances go to the higher number, whatever the order of the tests, as by brute force.

use glam::{BVec4A, DVec3, Vec3, Vec4};

use super::primitive::{Objects, Primitive};
use crate::math::RoundCone;

/// Primitives to a block: the lanes that every x86-64 and aarch64 processor has.
pub(super) const BLOCK: usize = 4;

/// What a leaf's blocks are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Spheres = 0,
    Discs = 1,
    Triangles = 2,
    /// Of more than one kind, or curves, for which a node's two bits have no name: the leaf names an entry of
    /// [`Leaves::mixed`].
    Mixed = 3,
}

/// A run of blocks: its first and their count.
pub(super) type Run = (u32, u32);

/// Four spheres; an unused lane has a squared radius of -1, which no distance is under.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct SphereBlock {
    center: [Vec4; 3],
    radius_squared: Vec4,
    number: [u32; BLOCK],
}

/// Four discs; unused as for spheres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct DiscBlock {
    center: [Vec4; 3],
    normal: [Vec4; 3],
    /// Those that face each ray's origin, whose normals are not read.
    facing: BVec4A,
    radius_squared: Vec4,
    number: [u32; BLOCK],
}

/// Four triangles; an unused lane's corners are one point, which no ray hits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct TriangleBlock {
    corner: [[Vec4; 3]; 3],
    number: [u32; BLOCK],
}

/// A curve, which is tested in double precision by itself.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct CurveBlock {
    ends: [Vec3; 2],
    radius: [f32; 2],
    number: u32,
}

/// The runs of a leaf's blocks, by kind: spheres, discs, triangles, curves.
pub(super) type Runs = [Run; 4];

/// The blocks of all leaves.
#[derive(Debug, Default, PartialEq)]
pub(super) struct Leaves {
    pub(super) spheres: Vec<SphereBlock>,
    pub(super) discs: Vec<DiscBlock>,
    pub(super) triangles: Vec<TriangleBlock>,
    pub(super) curves: Vec<CurveBlock>,
    pub(super) mixed: Vec<Runs>,
}

/// No number: fills a block's unused lanes.
pub(super) const UNUSED: u32 = u32::MAX;

/// Places one value per lane and axis.
fn set(lanes: &mut [Vec4; 3], lane: usize, value: Vec3) {
    for axis in 0..3 {
        lanes[axis][lane] = value[axis];
    }
}

impl Leaves {
    pub(super) fn bytes(&self) -> u64 {
        (size_of_val(&*self.spheres)
            + size_of_val(&*self.discs)
            + size_of_val(&*self.triangles)
            + size_of_val(&*self.curves)
            + size_of_val(&*self.mixed)) as u64
    }

    /// Blocks of each kind.
    pub(super) fn counts(&self) -> [usize; 4] {
        [self.spheres.len(), self.discs.len(), self.triangles.len(), self.curves.len()]
    }

    /// Appends a leaf's primitives; its kind, and its first block and their count.
    pub(super) fn push(&mut self, objects: &Objects, numbers: &[u32]) -> (Kind, Run) {
        let start = self.counts();
        let mut used = [0; 3];
        for &number in numbers {
            match objects.get(number) {
                Primitive::Sphere { center, radius } => {
                    let lane = used[0] % BLOCK;
                    used[0] += 1;
                    if lane == 0 {
                        self.spheres.push(SphereBlock::UNUSED);
                    }
                    if let Some(block) = self.spheres.last_mut() {
                        set(&mut block.center, lane, center);
                        block.radius_squared[lane] = radius * radius;
                        block.number[lane] = number;
                    }
                }
                primitive @ (Primitive::Disc { center, radius, .. } | Primitive::Facing { center, radius }) => {
                    let lane = used[1] % BLOCK;
                    used[1] += 1;
                    if lane == 0 {
                        self.discs.push(DiscBlock::UNUSED);
                    }
                    if let Some(block) = self.discs.last_mut() {
                        set(&mut block.center, lane, center);
                        match primitive {
                            Primitive::Disc { normal, .. } => set(&mut block.normal, lane, normal),
                            _ => block.facing.set(lane, true),
                        }
                        block.radius_squared[lane] = radius * radius;
                        block.number[lane] = number;
                    }
                }
                Primitive::Curve { ends, radius } => self.curves.push(CurveBlock { ends, radius, number }),
                Primitive::Triangle(corners) => {
                    let lane = used[2] % BLOCK;
                    used[2] += 1;
                    if lane == 0 {
                        self.triangles.push(TriangleBlock::UNUSED);
                    }
                    if let Some(block) = self.triangles.last_mut() {
                        for (to, corner) in block.corner.iter_mut().zip(corners) {
                            set(to, lane, corner);
                        }
                        block.number[lane] = number;
                    }
                }
            }
        }
        let end = self.counts();
        let runs: Runs = std::array::from_fn(|kind| (start[kind] as u32, (end[kind] - start[kind]) as u32));
        match runs {
            [run, (_, 0), (_, 0), (_, 0)] => (Kind::Spheres, run),
            [(_, 0), run, (_, 0), (_, 0)] => (Kind::Discs, run),
            [(_, 0), (_, 0), run, (_, 0)] => (Kind::Triangles, run),
            _ => {
                self.mixed.push(runs);
                (Kind::Mixed, (self.mixed.len() as u32 - 1, 1))
            }
        }
    }

    /// Appends the blocks of another; how far the first of each [`Kind`] moved.
    pub(super) fn append(&mut self, mut other: Self) -> [u32; 4] {
        let moved = self.counts().map(|count| count as u32);
        let [spheres, discs, triangles, _] = moved;
        let mixed = self.mixed.len() as u32;
        self.spheres.append(&mut other.spheres);
        self.discs.append(&mut other.discs);
        self.triangles.append(&mut other.triangles);
        self.curves.append(&mut other.curves);
        for runs in &mut other.mixed {
            for (run, moved) in runs.iter_mut().zip(moved) {
                run.0 += moved;
            }
        }
        self.mixed.append(&mut other.mixed);
        [spheres, discs, triangles, mixed]
    }

    /// The runs of blocks of a leaf.
    pub(super) fn runs(&self, kind: u32, run: Run) -> Runs {
        const NONE: Run = (0, 0);
        match kind {
            0 => [run, NONE, NONE, NONE],
            1 => [NONE, run, NONE, NONE],
            2 => [NONE, NONE, run, NONE],
            _ => self.mixed[run.0 as usize],
        }
    }

    /// Numbers in runs of blocks.
    pub(super) fn numbers(&self, runs: Runs) -> impl Iterator<Item = u32> {
        let [spheres, discs, triangles, curves] = runs.map(range);
        let spheres = self.spheres[spheres].iter().map(|block| block.number);
        let discs = self.discs[discs].iter().map(|block| block.number);
        let triangles = self.triangles[triangles].iter().map(|block| block.number);
        let curves = self.curves[curves].iter().map(|block| block.number);
        let blocks = spheres.chain(discs).chain(triangles).flatten().filter(|&number| number != UNUSED);
        blocks.chain(curves)
    }

    /// Whether these blocks, all of them, are those in another's runs.
    pub(super) fn same(&self, other: &Self, runs: Runs) -> bool {
        let [spheres, discs, triangles, curves] = runs.map(range);
        self.spheres == other.spheres[spheres]
            && self.discs == other.discs[discs]
            && self.triangles == other.triangles[triangles]
            && self.curves == other.curves[curves]
    }

    /// Moves the first sphere, for the tests of the check.
    #[cfg(test)]
    pub(super) fn damage(&mut self) {
        self.spheres[0].center[1][0] += 1.0;
    }

    /// Tests a leaf's blocks; true when something nearer was found.
    #[inline]
    pub(super) fn test<const ANY: bool>(&self, kind: u32, run: Run, ray: &LeafRay, best: &mut Best) -> bool {
        match kind {
            0 => each::<_, ANY>(&self.spheres[range(run)], |block| block.test(ray, best)),
            1 => each::<_, ANY>(&self.discs[range(run)], |block| block.test(ray, best)),
            2 => each::<_, ANY>(&self.triangles[range(run)], |block| block.test(ray, best)),
            _ => {
                let [spheres, discs, triangles, curves] = self.mixed[run.0 as usize];
                let mut found = each::<_, ANY>(&self.spheres[range(spheres)], |block| block.test(ray, best));
                if !(ANY && found) {
                    found |= each::<_, ANY>(&self.discs[range(discs)], |block| block.test(ray, best));
                }
                if !(ANY && found) {
                    found |= each::<_, ANY>(&self.triangles[range(triangles)], |block| block.test(ray, best));
                }
                if !(ANY && found) {
                    found |= each::<_, ANY>(&self.curves[range(curves)], |block| block.test(ray, best));
                }
                found
            }
        }
    }
}

fn range((start, count): Run) -> std::ops::Range<usize> {
    start as usize..(start + count) as usize
}

#[inline]
fn each<B, const ANY: bool>(blocks: &[B], mut test: impl FnMut(&B) -> bool) -> bool {
    let mut found = false;
    for block in blocks {
        found |= test(block);
        if ANY && found {
            return true;
        }
    }
    found
}

/// A ray, spread over the lanes of a block.
#[derive(Debug)]
pub(super) struct LeafRay {
    origin: [Vec4; 3],
    direction: [Vec4; 3],
    /// One over the direction's squared length.
    inverse_squared: Vec4,
    tnear: f32,
}

/// The nearest hit so far; at first the ray's end.
#[derive(Clone, Copy, Debug)]
pub(super) struct Best {
    pub(super) t: f32,
    /// The primitive's number plus one; 0 for none.
    pub(super) above: u32,
    pub(super) u: f32,
    pub(super) v: f32,
}

impl Best {
    /// Takes a hit that is nearer, or as near and of a higher number (a hit at the ray's very end counts).
    #[inline]
    fn offer(&mut self, t: f32, number: u32, u: f32, v: f32) -> bool {
        let above = number + 1;
        let taken = t < self.t || (t == self.t && above > self.above);
        if taken {
            *self = Self { t, above, u, v };
        }
        taken
    }
}

#[inline]
fn dot(a: [Vec4; 3], b: [Vec4; 3]) -> Vec4 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline]
fn cross(a: [Vec4; 3], b: [Vec4; 3]) -> [Vec4; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[inline]
fn sub(a: [Vec4; 3], b: [Vec4; 3]) -> [Vec4; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

#[inline]
fn add(a: [Vec4; 3], b: [Vec4; 3]) -> [Vec4; 3] {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

#[inline]
fn scale(a: [Vec4; 3], by: Vec4) -> [Vec4; 3] {
    a.map(|axis| axis * by)
}

/// Lanes whose bit is set, lowest first.
#[inline]
fn lanes(mask: BVec4A) -> impl Iterator<Item = usize> {
    let mut bits = mask.bitmask();
    std::iter::from_fn(move || {
        let lane = bits.trailing_zeros() as usize;
        bits &= bits.wrapping_sub(1);
        (lane < BLOCK).then_some(lane)
    })
}

impl LeafRay {
    #[inline]
    pub(super) fn new(origin: Vec3, direction: Vec3, tnear: f32) -> Self {
        let splat = |v: Vec3| [Vec4::splat(v.x), Vec4::splat(v.y), Vec4::splat(v.z)];
        let inverse_squared = Vec4::splat(1.0 / direction.length_squared());
        Self { origin: splat(origin), direction: splat(direction), inverse_squared, tnear }
    }
}

impl SphereBlock {
    const UNUSED: Self = Self { center: [Vec4::ZERO; 3], radius_squared: Vec4::NEG_ONE, number: [UNUSED; BLOCK] };

    /// The entry, or the exit where the entry lies outside the interval.
    #[inline]
    fn test(&self, ray: &LeafRay, best: &mut Best) -> bool {
        let to_center = sub(self.center, ray.origin);
        let middle = dot(to_center, ray.direction) * ray.inverse_squared;
        // The distance from the line is taken at its nearest point: |c|^2 - (c.d)^2 would cancel for far origins.
        let away = sub(to_center, scale(ray.direction, middle));
        let miss = dot(away, away);
        let hit = miss.cmple(self.radius_squared);
        if !hit.any() {
            return false;
        }
        let squared = ((self.radius_squared - miss) * ray.inverse_squared).to_array();
        let middle = middle.to_array();
        let mut found = false;
        for lane in lanes(hit) {
            let half = squared[lane].sqrt();
            let (entry, exit) = (middle[lane] - half, middle[lane] + half);
            let t = if entry >= ray.tnear { entry } else { exit };
            if t >= ray.tnear {
                found |= best.offer(t, self.number[lane], 0.0, 0.0);
            }
        }
        found
    }
}

impl DiscBlock {
    const UNUSED: Self = Self {
        center: [Vec4::ZERO; 3],
        normal: [Vec4::ZERO; 3],
        facing: BVec4A::FALSE,
        radius_squared: Vec4::NEG_ONE,
        number: [UNUSED; BLOCK],
    };

    #[inline]
    fn test(&self, ray: &LeafRay, best: &mut Best) -> bool {
        let to_center = sub(self.center, ray.origin);
        // A ray within the plane makes it infinite or NaN, and then the distance from the centre NaN, which no comparison accepts.
        let normal = [0, 1, 2].map(|axis| Vec4::select(self.facing, to_center[axis], self.normal[axis]));
        let t = dot(to_center, normal) / dot(ray.direction, normal);
        let away = sub(scale(ray.direction, t), to_center);
        // What faces the ray's origin is not met from within its ball.
        let outside = dot(to_center, to_center).cmpgt(self.radius_squared) | !self.facing;
        let hit = dot(away, away).cmple(self.radius_squared) & outside & t.cmpge(Vec4::splat(ray.tnear));
        let mut found = false;
        for lane in lanes(hit) {
            found |= best.offer(t[lane], self.number[lane], 0.0, 0.0);
        }
        found
    }
}

impl TriangleBlock {
    const UNUSED: Self = Self { corner: [[Vec4::ZERO; 3]; 3], number: [UNUSED; BLOCK] };

    /// Sides of the three edges in Plücker coordinates about the origin (Davidovič et al., 3D rasterization, 2012): two
    /// triangles find opposite numbers, bit for bit, for the edge that they share, so that no ray passes between them.
    #[inline]
    fn test(&self, ray: &LeafRay, best: &mut Best) -> bool {
        let [a, b, c] = self.corner.map(|corner| sub(corner, ray.origin));
        let side = |from: [Vec4; 3], to: [Vec4; 3]| dot(cross(sub(to, from), add(to, from)), ray.direction);
        // Weights of the corners a, b, c: each is the side of the edge across from it.
        let (wa, wb, wc) = (side(b, c), side(c, a), side(a, b));
        let zero = Vec4::ZERO;
        let above = wa.cmpge(zero) & wb.cmpge(zero) & wc.cmpge(zero);
        let below = wa.cmple(zero) & wb.cmple(zero) & wc.cmple(zero);
        let sum = wa + wb + wc;
        let hit = (above | below) & sum.cmpne(zero);
        if !hit.any() {
            return false;
        }
        let one = Vec4::ONE / sum;
        // The hit is a mean of the corners with weights of one sign, so that it stays between them even edge-on, where the
        // plane's equation would lose it.
        let depth = wa * dot(a, ray.direction) + wb * dot(b, ray.direction) + wc * dot(c, ray.direction);
        let t = depth * one * ray.inverse_squared;
        let (u, v) = (wb * one, wc * one);
        let mut found = false;
        for lane in lanes(hit & t.cmpge(Vec4::splat(ray.tnear))) {
            found |= best.offer(t[lane], self.number[lane], u[lane], v[lane]);
        }
        found
    }
}

impl CurveBlock {
    fn test(&self, ray: &LeafRay, best: &mut Best) -> bool {
        let first = |lanes: [Vec4; 3]| DVec3::new(lanes[0].x.into(), lanes[1].x.into(), lanes[2].x.into());
        let cone = RoundCone::new(self.ends.map(|end| end.as_dvec3()), self.radius.map(f64::from));
        let interval = [ray.tnear.into(), best.t.into()];
        let Some(hit) = cone.crossing(first(ray.origin), first(ray.direction), interval) else { return false };
        best.offer(hit.t as f32, self.number, hit.along as f32, 0.0)
    }
}
