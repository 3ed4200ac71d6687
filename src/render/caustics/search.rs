//! All places of one patch that send light to a point: its polynomial, the law of refraction over a part of it with proven
//! bounds, and the search by exclusion, contraction, halving and Newton's iteration. The equations are in `manifold`.
//!
//! A part (cell) of the patch has coordinates (α, β) in [-1, 1]². With F and its Jacobian J at the middle and |J(α, β) - J|
//! ≤ D over the cell, entry by entry, and Y = adj J (so that Y J = det J):
//! no root lies in the cell if |F|ᵢ > Σⱼ (|J| + D)ᵢⱼ or |Y F|ᵢ > |det J| + Σⱼ (|Y| D)ᵢⱼ for some i; with
//! κ = max Σⱼ (|Y| D)ᵢⱼ / |det J| < 1 there is at most one, within κ of -Y F / det J (Krawczyk's operator, 1969). The
//! second test does not need det J ≠ 0: on a fold both rows of Y are the direction that J does not move F in, and F in
//! that direction is what decides. Where these say nothing, `reach` may: it knows of no Jacobian, only where rays of all of
//! the cell's slopes and heights go.

use glam::DVec3;

use super::{
    Connection, Event, ManifoldCounts,
    polynomial::{Jet, Polynomial},
    screen::{self, Screen},
};
use crate::surface::Lattice;

/// Cells are closed and reach over their borders by this share of a patch, so that rounding on either side of a border
/// loses no root; what is found there twice is dropped. Far over f64's rounding divided by any determinant that gets here,
/// and about what single precision can tell apart.
const BORDER: f64 = 1e-7;

/// Roots on borders that are remembered to be dropped when found again.
const BORDER_ROOTS: usize = 32;

/// κ below which Newton's iteration is used: two Jacobians of the cell then differ by at most 2κ / (1 - κ) = 2/3, so that
/// every step comes closer.
const NEWTON: f64 = 0.25;

/// κ below which the cell shrinks around the root; above, halving it is as good.
const CONTRACT: f64 = 0.6;

/// A step of this share of a patch is the last: Newton's next would be its square.
const LAST_STEP: f64 = 1e-9;

/// Cells of one patch after which its rest is given up: an ordinary patch takes one to five, one with a fold through the
/// point some fifty. Only where whole areas focus on the point are there more.
const MOST_CELLS: u32 = 1024;

/// Cells whose parts may wait: one for every halving, of which single precision has 24 before two places are one, and some
/// that have shrunk in between.
const MOST_WAITING: usize = 32;

/// The light of a query.
#[derive(Clone, Copy, Debug)]
pub(super) enum Light {
    Direction(DVec3),
    Point(DVec3),
}

impl Light {
    #[inline(always)]
    fn moved(self, by: DVec3) -> Self {
        match self {
            Self::Direction(to) => Self::Direction(to),
            Self::Point(place) => Self::Point(place - by),
        }
    }
}

/// One query, in double precision.
pub(super) struct Query<'a> {
    pub(super) from: DVec3,
    pub(super) event: Event,
    pub(super) light: Light,
    /// Index on the point's side.
    pub(super) ior: f64,
    pub(super) tilt: [f64; 2],
    /// Width (m) of a cell that is not halved any more.
    pub(super) tolerance: f64,
    pub(super) found: &'a mut Vec<Connection>,
    pub(super) counts: &'a mut ManifoldCounts,
    pub(super) unsettled: bool,
    border: [[f64; 2]; BORDER_ROOTS],
    border_count: usize,
    /// Cells still to be searched; the last comes first.
    waiting: [Waiting; MOST_WAITING],
}

impl<'a> Query<'a> {
    #[inline(always)]
    pub(super) fn new(
        from: DVec3,
        event: Event,
        light: Light,
        ior: f64,
        tilt: [f64; 2],
        tolerance: f64,
        found: &'a mut Vec<Connection>,
        counts: &'a mut ManifoldCounts,
    ) -> Self {
        let (border, waiting) = ([[0.0; 2]; BORDER_ROOTS], [Waiting::NONE; MOST_WAITING]);
        let (unsettled, border_count) = (false, 0);
        Self { from, event, light, ior, tilt, tolerance, found, counts, unsettled, border, border_count, waiting }
    }

    /// Whether a root on a border, in cell coordinates of the whole lattice, is met for the first time.
    #[inline(always)]
    fn is_new(&mut self, at: [f64; 2]) -> bool {
        let met = &self.border[..self.border_count.min(BORDER_ROOTS)];
        if met.iter().any(|other| (0..2).all(|axis| (other[axis] - at[axis]).abs() <= 4.0 * BORDER)) {
            return false;
        }
        self.border[self.border_count % BORDER_ROOTS] = at;
        self.border_count += 1;
        self.unsettled |= self.border_count > BORDER_ROOTS;
        true
    }
}

/// Part of a patch: middle and half widths, in patch widths from the patch's middle.
#[derive(Clone, Copy, Debug)]
struct Cell {
    middle: [f64; 2],
    half: [f64; 2],
}

impl Cell {
    const NONE: Self = Self { middle: [0.0; 2], half: [0.0; 2] };
}

/// Parts of a cell that wait to be searched.
#[derive(Clone, Copy, Debug)]
struct Waiting {
    whole: Cell,
    /// The part of the patch that a cell answers for: the cell itself, or what it was before it shrank.
    leaf: Option<Cell>,
    /// How many parts the cell has along each axis.
    split: [usize; 2],
    /// Bits of those that wait, row by row.
    left: u16,
}

impl Waiting {
    const NONE: Self = Self { whole: Cell::NONE, leaf: None, split: [1; 2], left: 0 };

    /// The first part that waits, and what it answers for; it does not wait any more.
    #[inline(always)]
    fn next(&mut self) -> (Cell, Cell) {
        let lane = self.left.trailing_zeros() as usize;
        self.left &= self.left.wrapping_sub(1);
        let place = [lane % self.split[0], lane / self.split[0]];
        let mut part = self.whole;
        for axis in 0..2 {
            let share = 1.0 / self.split[axis] as f64;
            part.middle[axis] += part.half[axis] * (share * (2 * place[axis] + 1) as f64 - 1.0);
            part.half[axis] *= share;
        }
        (part, self.leaf.unwrap_or(part))
    }
}

/// What becomes of a cell.
enum Verdict {
    /// No root is in it.
    Empty,
    /// One root at most; the number is κ.
    Newton(f64),
    /// All roots are in a part of it.
    Shrunk(Cell),
    /// Nothing is known.
    Open,
}

/// Both equations and their Jacobian at one place, in α and β.
struct Law {
    /// Unit vector to the point and one over the distance.
    to_point: DVec3,
    inverse: f64,
    /// The same to the light; 0 for one at infinity.
    to_light: DVec3,
    light_inverse: f64,
    half: DVec3,
    tangents: [DVec3; 2],
    tilted: [DVec3; 2],
    f: [f64; 2],
    j: [[f64; 2]; 2],
}

impl Law {
    #[inline(always)]
    fn determinant(&self) -> f64 {
        self.j[0][0] * self.j[1][1] - self.j[0][1] * self.j[1][0]
    }

    /// adj J · F.
    #[inline(always)]
    fn adjugate_f(&self) -> [f64; 2] {
        let ([f, g], [[a, b], [c, d]]) = (self.f, self.j);
        [d * f - b * g, a * g - c * f]
    }
}

/// tᵢ · (I - d dᵀ) tⱼ
#[inline(always)]
fn across(d: DVec3, a: DVec3, b: DVec3) -> f64 {
    a.dot(b) - d.dot(a) * d.dot(b)
}

/// A patch being searched.
struct Patch<'q, 'a, const K: usize> {
    query: &'q mut Query<'a>,
    polynomial: Polynomial<f64, K>,
    cell: [usize; 2],
    /// Local x, z of its middle (m).
    middle: [f64; 2],
    width: [f64; 2],
    /// The point and the light relative to the middle, at height 0.
    from: DVec3,
    light: Light,
    cells: u32,
}

/// Appends every place of a patch that sends light to the query's point.
#[inline(always)]
pub(super) fn patch<const K: usize>(lattice: &Lattice, cell: [usize; 2], query: &mut Query) {
    let width = lattice.width;
    let mut part = Cell { middle: [0.0; 2], half: [0.5; 2] };
    for axis in 0..2 {
        // The domain's edge cuts patches of even order in half.
        let low = (lattice.domain[0][axis] - cell[axis] as f64).max(0.0);
        let high = (lattice.domain[1][axis] - cell[axis] as f64).min(1.0);
        part.middle[axis] = 0.5 * (low + high) - 0.5;
        part.half[axis] = 0.5 * (high - low);
        if !(high > low) {
            return;
        }
    }
    let middle = lattice.from_cell([cell[0] as f64 + 0.5, cell[1] as f64 + 0.5]);
    let shift = DVec3::new(middle[0], 0.0, middle[1]);
    let mut patch = Patch::<K> {
        polynomial: Polynomial::of_patch(lattice, cell[0], cell[1]),
        from: query.from - shift,
        light: query.light.moved(shift),
        query,
        cell,
        middle,
        width,
        cells: 0,
    };
    patch.search(part);
    let cells = u64::from(patch.cells);
    patch.query.counts.cells += cells;
}

impl<const K: usize> Patch<'_, '_, K> {
    #[inline(always)]
    fn law(&self, cell: &Cell, [x, y]: [f64; 2], jet: &Jet<f64>) -> Law {
        let half: [f64; 2] = std::array::from_fn(|axis| cell.half[axis] * self.width[axis]);
        let at = |axis: usize, t: f64| (cell.middle[axis] + t * cell.half[axis]) * self.width[axis];
        let place = DVec3::new(at(0, x), jet.height, at(1, y));
        let to_point = self.from - place;
        let inverse = 1.0 / to_point.length();
        let to_point = to_point * inverse;
        let (to_light, light_inverse) = match self.light {
            Light::Direction(to) => (to, 0.0),
            Light::Point(light) => {
                let to = light - place;
                let inverse = 1.0 / to.length();
                (to * inverse, inverse)
            }
        };
        let n = self.query.ior;
        let h = n * to_point + to_light;
        let tilt: [f64; 2] = std::array::from_fn(|axis| self.query.tilt[axis] * half[axis]);
        let tangents = [DVec3::new(half[0], jet.first[0], 0.0), DVec3::new(0.0, jet.first[1], half[1])];
        let tilted = [tangents[0] + DVec3::Y * tilt[0], tangents[1] + DVec3::Y * tilt[1]];
        let mut j = [[0.0; 2]; 2];
        for i in 0..2 {
            for k in 0..2 {
                j[i][k] = h.y * jet.second[i][k] - n * inverse * across(to_point, tilted[i], tangents[k]);
                if light_inverse > 0.0 {
                    j[i][k] -= light_inverse * across(to_light, tilted[i], tangents[k]);
                }
            }
        }
        let f = [h.dot(tilted[0]), h.dot(tilted[1])];
        Law { to_point, inverse, to_light, light_inverse, half: h, tangents, tilted, f, j }
    }

    /// Most that the Jacobian differs by, over the cell, from what it is at the middle; `None` if the point or the light
    /// is too near for a bound.
    #[inline(always)]
    fn change(&self, law: &Law, jet: &Jet<f64>, ranges: &Jet<f64>, radius: f64) -> Option<[[f64; 2]; 2]> {
        let n = self.query.ior;
        let lengths = law.tangents.map(DVec3::length);
        let tilted = law.tilted.map(DVec3::length);
        let mut change = [[0.0; 2]; 2];
        let mut chord = 0.0;
        for (weight, direction, inverse) in [(n, law.to_point, law.inverse), (1.0, law.to_light, law.light_inverse)] {
            if inverse == 0.0 {
                continue;
            }
            let sine = radius * inverse;
            if !(sine < 0.5) {
                return None;
            }
            chord += weight * sine * (1.0 + 0.414_22 * sine * sine);
            // 1/r grows to 1/(R - ρ), and the projection I - d dᵀ turns by at most sin α.
            let growth = sine / (1.0 - sine);
            for i in 0..2 {
                for k in 0..2 {
                    let (a, b) = (ranges.first[i], ranges.first[k]);
                    let turned = sine * tilted[i] * lengths[k] + a * lengths[k] + b * tilted[i] + a * b;
                    let here = across(direction, law.tilted[i], law.tangents[k]).abs();
                    change[i][k] += weight * inverse * ((1.0 + growth) * turned + growth * here);
                }
            }
        }
        for i in 0..2 {
            for k in 0..2 {
                let range = ranges.second[i][k];
                change[i][k] += law.half.y.abs() * range + chord * (jet.second[i][k].abs() + range);
            }
        }
        Some(change)
    }

    /// Searches `whole` and its parts, one after the other.
    #[inline(always)]
    fn search(&mut self, whole: Cell) {
        self.query.waiting[0] = Waiting { whole, left: 1, ..Waiting::NONE };
        let mut count = 1;
        while count > 0 {
            let waiting = &mut self.query.waiting[count - 1];
            let (cell, leaf) = waiting.next();
            count -= usize::from(waiting.left == 0);
            self.cells += 1;
            if self.cells > MOST_CELLS {
                self.query.unsettled = true;
                return;
            }
            let polynomial = self.polynomial.over(cell.middle, cell.half);
            let (jet, ranges) = (polynomial.jet_at_middle(), polynomial.ranges());
            let size: [f64; 2] = std::array::from_fn(|axis| cell.half[axis] * self.width[axis]);
            let Some(reached) = self.reach(&cell, &jet, &ranges, size) else { continue };
            let law = self.law(&cell, [0.0; 2], &jet);
            let verdict = match self.judge(&cell, &law, &jet, &ranges, size) {
                Verdict::Open if (0..2).any(|axis| reached.half[axis] < CONTRACT * cell.half[axis]) => {
                    Verdict::Shrunk(reached)
                }
                decided => decided,
            };
            let contraction = match verdict {
                Verdict::Empty => continue,
                Verdict::Newton(contraction) => contraction,
                Verdict::Shrunk(whole) if count < MOST_WAITING => {
                    self.query.waiting[count] = Waiting { whole, leaf: Some(leaf), left: 1, ..Waiting::NONE };
                    count += 1;
                    continue;
                }
                Verdict::Open if 2.0 * size[0].max(size[1]) > self.query.tolerance && count < MOST_WAITING => {
                    self.query.waiting[count] = self.divide(cell, size, &polynomial);
                    count += usize::from(self.query.waiting[count].left != 0);
                    continue;
                }
                Verdict::Shrunk(_) | Verdict::Open => {
                    // Nothing is proven here: try once, and say that it is not settled. This rate lets the iteration
                    // wander over the cell and no further.
                    self.query.unsettled = true;
                    NEWTON
                }
            };
            self.iterate(&polynomial, &cell, &leaf, law, contraction);
        }
    }

    /// Part of the cell where a ray from the point can be bent to a light at infinity, from what heights and slopes there are
    /// alone; `None` if there is none. The whole cell where that says nothing.
    ///
    /// With q = -h_y and the slopes p, n d + w = h says that the ray's way along x is (w_x - q p_x) / (w_y + q) of its way
    /// up, z alike, and q = (√(n² - 1 + cos²) - cos) N_y with the cosine between the light and the unit normal N. All are
    /// ranges over the cell. In water as shallow as the cell is wide this says much where the bounds of `judge` say nothing.
    #[inline(always)]
    fn reach(&self, cell: &Cell, jet: &Jet<f64>, ranges: &Jet<f64>, size: [f64; 2]) -> Option<Cell> {
        let Light::Direction(light) = self.light else { return Some(*cell) };
        let n = self.query.ior;
        let rise = jet.height - self.from.y;
        let [low, high] = [(rise - ranges.height).max(0.0), rise + ranges.height];
        if !(self.query.event == Event::Refraction && n >= 1.0 && high > 0.0) {
            return Some(*cell);
        }
        let slope: [f64; 2] = std::array::from_fn(|i| jet.first[i] / size[i] + self.query.tilt[i]);
        let room: [f64; 2] = std::array::from_fn(|i| ranges.first[i] / size[i]);
        let steep: [f64; 2] = std::array::from_fn(|i| slope[i].abs() + room[i]);
        let flat: [f64; 2] = std::array::from_fn(|i| (slope[i].abs() - room[i]).max(0.0));
        let longest = (1.0 + steep[0] * steep[0] + steep[1] * steep[1]).sqrt();
        let shortest = (1.0 + flat[0] * flat[0] + flat[1] * flat[1]).sqrt();
        let towards = light.y - light.x * slope[0] - light.z * slope[1];
        let spread = light.x.abs() * room[0] + light.z.abs() * room[1];
        let most = ((towards + spread) / shortest).clamp(0.0, 1.0);
        let least = ((towards - spread) / longest).clamp(0.0, 1.0);
        let bend = |cosine: f64| (n * n - 1.0 + cosine * cosine).sqrt() - cosine;
        let q = [bend(most) / longest, bend(least) / shortest];
        let up = [light.y + q[0], light.y + q[1]];
        if !(up[0] > 0.0) {
            return Some(*cell);
        }
        let mut shrunk = *cell;
        for axis in 0..2 {
            let (along, from) = if axis == 0 { (light.x, self.from.x) } else { (light.z, self.from.z) };
            let (p, r) = (slope[axis], room[axis]);
            // Products and quotients of ranges: their ends are among the ends'.
            let [a, b] = [p - r, p + r];
            let bent =
                [along - if b > 0.0 { q[1] * b } else { q[0] * b }, along - if a > 0.0 { q[0] * a } else { q[1] * a }];
            let ways = [
                bent[0] / if bent[0] > 0.0 { up[1] } else { up[0] },
                bent[1] / if bent[1] > 0.0 { up[0] } else { up[1] },
            ];
            let ends = [
                from + ways[0] * if ways[0] > 0.0 { low } else { high },
                from + ways[1] * if ways[1] > 0.0 { high } else { low },
            ];
            let reach = 1.0 + BORDER / cell.half[axis];
            let middle = cell.middle[axis] * self.width[axis];
            // Rounding is far less than the border.
            let low = ((ends[0] - middle) / size[axis] - (reach - 1.0)).max(-reach);
            let high = ((ends[1] - middle) / size[axis] + (reach - 1.0)).min(reach);
            if low.is_nan() || high.is_nan() {
                return Some(*cell);
            }
            if low > high {
                return None;
            }
            shrunk.middle[axis] += 0.5 * (low + high) * cell.half[axis];
            shrunk.half[axis] *= 0.5 * (high - low);
        }
        Some(shrunk)
    }

    /// What bounds over the cell say of the roots in it.
    #[inline(always)]
    fn judge(&self, cell: &Cell, law: &Law, jet: &Jet<f64>, ranges: &Jet<f64>, size: [f64; 2]) -> Verdict {
        let radius = (size[0] * size[0] + size[1] * size[1] + ranges.height * ranges.height).sqrt();
        let reach: [f64; 2] = std::array::from_fn(|axis| 1.0 + BORDER / cell.half[axis]);
        let room = reach[0].max(reach[1]);
        let Some(change) = self.change(law, jet, ranges, radius) else { return Verdict::Open };
        let Law { f, j, .. } = *law;
        for i in 0..2 {
            if f[i].abs() > room * (j[i][0].abs() + change[i][0] + j[i][1].abs() + change[i][1]) {
                return Verdict::Empty;
            }
        }
        let determinant = law.determinant().abs();
        let adjugate = [[j[1][1].abs(), j[0][1].abs()], [j[1][0].abs(), j[0][0].abs()]];
        let step = law.adjugate_f();
        let doubt: [f64; 2] = std::array::from_fn(|i| {
            (0..2).map(|k| adjugate[i][0] * change[0][k] + adjugate[i][1] * change[1][k]).sum()
        });
        if (0..2).any(|i| step[i].abs() > room * (determinant + doubt[i])) {
            return Verdict::Empty;
        }
        let most = doubt[0].max(doubt[1]);
        if most <= NEWTON * determinant {
            return Verdict::Newton(most / determinant);
        }
        if most <= CONTRACT * determinant {
            let signed = law.determinant();
            let mut shrunk = *cell;
            for axis in 0..2 {
                // Around the root, and not beyond the cell.
                let (root, ball) = (-step[axis] / signed, room * doubt[axis] / determinant);
                let low = (root - ball).max(-reach[axis]);
                let high = (root + ball).min(reach[axis]);
                if !(low < high) {
                    return Verdict::Empty;
                }
                shrunk.middle[axis] += 0.5 * (low + high) * cell.half[axis];
                shrunk.half[axis] *= 0.5 * (high - low);
            }
            return Verdict::Shrunk(shrunk);
        }
        Verdict::Open
    }

    /// Parts of a cell that may hold a root: of sixteenths, or of halves or quarters where less is to be divided.
    #[inline(always)]
    fn divide(&self, whole: Cell, size: [f64; 2], polynomial: &Polynomial<f64, K>) -> Waiting {
        let [x, z] = size;
        if x.max(z) > self.query.tolerance && 2.0 * x.min(z) >= x.max(z) {
            let middle = [0, 1].map(|axis| whole.middle[axis] * self.width[axis]);
            let shift = DVec3::new(middle[0], polynomial.0[0][0], middle[1]);
            let screen = Screen {
                polynomial,
                half: size,
                from: (self.from - shift).to_array(),
                light: self.light.moved(shift),
                ior: self.query.ior,
                tilt: self.query.tilt,
            };
            return Waiting { whole, leaf: None, split: [screen::SIDE; 2], left: screen.survivors() };
        }
        let split = size.map(|size| 1 + usize::from(2.0 * size >= x.max(z)));
        Waiting { whole, leaf: None, split, left: (1 << (split[0] * split[1])) - 1 }
    }

    /// Newton's iteration from the cell's middle, held in the cell, where `contraction` is κ.
    ///
    /// Every root of the cell lies within a ball of the unheld step, which shrinks from step to step; a step that ends
    /// farther from the cell than that proves that there is none.
    #[inline(always)]
    fn iterate(&mut self, polynomial: &Polynomial<f64, K>, cell: &Cell, leaf: &Cell, mut law: Law, contraction: f64) {
        let reach: [f64; 2] = std::array::from_fn(|axis| 1.0 + BORDER / cell.half[axis]);
        let mut ball = reach[0].max(reach[1]);
        let mut rate = contraction;
        let mut at = [0.0; 2];
        // 2/3 to the hundredth is past any rounding.
        for _ in 0..100 {
            self.query.counts.iterations += 1;
            let (step, determinant) = (law.adjugate_f(), law.determinant());
            ball *= rate;
            rate = 2.0 * contraction / (1.0 - contraction);
            let mut largest = 0.0f64;
            for axis in 0..2 {
                let change = -step[axis] / determinant;
                let next = at[axis] + change;
                if !(next.abs() - reach[axis] <= ball) {
                    return;
                }
                at[axis] = next.clamp(-reach[axis], reach[axis]);
                largest = largest.max(change.abs() * cell.half[axis]);
            }
            let jet = polynomial.jet(at);
            law = self.law(cell, at, &jet);
            if largest <= LAST_STEP {
                self.keep(cell, leaf, at, &jet, &law);
                return;
            }
        }
        self.query.unsettled = true;
    }

    /// Adds a root if it is where the leaf ends at most, is new, and light really goes that way.
    #[inline(always)]
    fn keep(&mut self, cell: &Cell, leaf: &Cell, at: [f64; 2], jet: &Jet<f64>, law: &Law) {
        let place: [f64; 2] = std::array::from_fn(|axis| cell.middle[axis] + at[axis] * cell.half[axis]);
        let half: [f64; 2] = std::array::from_fn(|axis| cell.half[axis] * self.width[axis]);
        let mut on_border = false;
        for axis in 0..2 {
            let beyond = (place[axis] - leaf.middle[axis]).abs() - leaf.half[axis];
            // The iteration's own rounding is far under the border's width.
            if beyond > 1.5 * BORDER {
                return;
            }
            on_border |= beyond > -1.5 * BORDER;
        }
        let slope: [f64; 2] = std::array::from_fn(|axis| jet.first[axis] / half[axis]);
        let normal = DVec3::new(-slope[0], 1.0, -slope[1]);
        let facet = normal - DVec3::new(self.query.tilt[0], 0.0, self.query.tilt[1]);
        let side = match self.query.event {
            Event::Refraction => -1.0,
            Event::Reflection => 1.0,
        };
        // h along the facet's normal is the law's tangential half; these signs are the other, and also keep light that
        // would come through the surface itself.
        if [normal, facet].iter().any(|n| !(side * n.dot(law.to_point) > 0.0 && n.dot(law.to_light) > 0.0)) {
            return;
        }
        if on_border && !self.query.is_new([place[0] + self.cell[0] as f64, place[1] + self.cell[1] as f64]) {
            return;
        }
        let area = half[0] * half[1];
        let determinant = law.determinant() / (area * area);
        let mut spread = normal.dot(law.to_point) * facet.dot(law.to_light) * law.inverse * law.inverse / determinant;
        let mut light_distance = f64::INFINITY;
        if let Light::Point(_) = self.light {
            light_distance = 1.0 / law.light_inverse;
            spread *= law.light_inverse * law.light_inverse;
        }
        let spread = spread.abs() as f32;
        if !spread.is_finite() {
            self.query.unsettled = true;
            return;
        }
        let [x, z] = std::array::from_fn(|axis| self.middle[axis] + place[axis] * self.width[axis]);
        self.query.found.push(Connection {
            surface: DVec3::new(x, jet.height, z).as_vec3(),
            normal: normal.normalize().as_vec3(),
            facet: facet.normalize().as_vec3(),
            direction: (-law.to_point).as_vec3(),
            distance: (1.0 / law.inverse) as f32,
            to_light: law.to_light.as_vec3(),
            light_distance: light_distance as f32,
            spread,
        });
    }
}
