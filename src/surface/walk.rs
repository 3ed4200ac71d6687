//! Rays in lanes down the pyramid of bounds: blocks that a ray passes over or under are skipped whole, the patches that
//! are left go to the solver.
//!
//! Each lane keeps its own block, level and place along its ray; the lanes of a packet share only the program. A ray's
//! place is kept as an integer cell plus an offset from the cell it started in, and every packet is moved in double
//! precision to where its rays enter the surface's box: a far origin costs no accuracy.
//!
//! The sign of (ray - surface) is carried from block to block. Bounds are padded (see the pyramid), so a skip proves a
//! sign; a patch that begins with the other sign than the ray brought along is hit at its border. Together they make
//! the walk watertight. It follows Tevs, Ihrke and Seidel, "Maximum Mipmaps for Fast, Accurate, and Scalable Dynamic
//! Height Field Rendering", 2008, with a solver at the leaves instead of a bilinear patch.

use super::SolveCounts;
use super::lanes::{LANES, LaneHits, LaneRays};
use super::lattice::Lattice;
use super::pyramid::{HOLE, Pyramid};
use super::solve::{PatchSolver, Segment};
use crate::simd::{Kernel, Simd};

/// An expression for x (0) and for z (1). A closure would be a function of its own, which compilers may leave outside the
/// kernel's instruction set: each vector operation would then be a call.
macro_rules! per_axis {
    ($axis:ident => $value:expr) => {
        [
            {
                let $axis = 0usize;
                $value
            },
            {
                let $axis = 1usize;
                $value
            },
        ]
    };
}

/// Level at which a ray that enters from outside begins: it descends sooner than it would climb.
const ENTRY_LEVEL: i32 = 5;
/// Level at which a ray that begins within the bounds begins: it has just left the surface, or is about to hit it.
const INSIDE_LEVEL: i32 = 2;

/// Idle lanes that are worth a refill.
const REFILL: u32 = 4;

/// Packets of rays against one surface, at most `N` rays; lanes that are done take the next ray until none is left.
pub(super) struct Walk<'a, P, const K: usize, const D: usize, const ANY: bool, const N: usize> {
    pub lattice: &'a Lattice,
    pub pyramid: &'a Pyramid,
    pub range: [f64; 2],
    pub solver: P,
    /// All with one growth of the tolerance.
    pub rays: &'a [LaneRays],
    /// As many as `rays`.
    pub hits: &'a mut [LaneHits],
    pub counts: &'a mut SolveCounts,
}

/// Where some rays of a packet start, in the surface's own terms.
struct Start<const L: usize> {
    /// Cell of the start: whole numbers.
    cell: [[f32; L]; 2],
    /// Offset within it, 0..1.
    offset: [[f32; L]; 2],
    /// Cells per t.
    slope: [[f32; L]; 2],
    /// Height (m), leading and trailing part.
    height: [[f32; L]; 2],
    /// Height in steps of the pyramid.
    step: [f32; L],
    /// Steps per t.
    rise: [f32; L],
    /// t of the start on the ray as given.
    base: [f64; L],
    /// Length of the walk, in t; negative for a ray that misses the surface's box.
    length: [f32; L],
    /// Tolerance at the start.
    tolerance: [f32; L],
    /// Positive where the ray entered the box from outside.
    entered: [f32; L],
}

/// Fields of a waiting ray, each an array over the rays that meet the surface's box.
const CELL: usize = 0;
const OFFSET: usize = 2;
const SLOPE: usize = 4;
const HEIGHT: usize = 6;
const STEP: usize = 8;
const RISE: usize = 9;
const LENGTH: usize = 10;
const TOLERANCE: usize = 11;
const ENTERED: usize = 12;
const VERTICAL: usize = 13;
const RAY: usize = 14;
const FIELDS: usize = 15;

/// Fields of a found hit.
const AT: usize = 1;
const PLACE: usize = 2;
const PATCH: usize = 4;

/// Rays that wait for a lane, and hits that wait to be written.
struct Queue<const N: usize> {
    waiting: [[f32; N]; FIELDS],
    count: usize,
    /// Place among the waiting, t, place in the patch, cell.
    found: [[f32; N]; 6],
    hits: usize,
    /// Number of each waiting ray: packet and lane.
    number: [usize; N],
    /// t of its start on the ray as given.
    base: [f64; N],
}

impl<P: PatchSolver, const K: usize, const D: usize, const ANY: bool, const N: usize> Kernel
    for Walk<'_, P, K, D, ANY, N>
{
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(mut self, simd: S) {
        let mut queue = Queue {
            waiting: [[0.0; N]; FIELDS],
            count: 0,
            found: [[0.0; N]; 6],
            hits: 0,
            number: [0; N],
            base: [0.0; N],
        };
        for packet in 0..self.rays.len() {
            self.enqueue(simd, packet, &mut queue);
        }
        if queue.count > 0 {
            self.walk(simd, &mut queue);
            self.record(simd, &queue);
        }
    }
}

impl<P: PatchSolver, const K: usize, const D: usize, const ANY: bool, const N: usize> Walk<'_, P, K, D, ANY, N> {
    /// Puts the rays of a packet that meet the surface's box in the queue.
    #[inline(always)]
    fn enqueue<S: Simd>(&self, s: S, packet: usize, queue: &mut Queue<N>) {
        if S::LANES == 1 {
            for lane in (0..LANES).filter(|lane| self.rays[packet].active >> lane & 1 == 1) {
                self.enqueue_lanes::<S, 1>(s, packet, lane, queue);
            }
        } else {
            self.enqueue_lanes::<S, LANES>(s, packet, 0, queue);
        }
    }

    /// The lanes `from..from + L` of a packet; `L` is at least the width of the vectors.
    #[inline(always)]
    fn enqueue_lanes<S: Simd, const L: usize>(&self, s: S, packet: usize, from: usize, queue: &mut Queue<N>) {
        let rays = &self.rays[packet];
        let start = self.start::<L>(rays, from);
        for first in (0..L).step_by(S::LANES) {
            let asked = s.from_bits(u32::from(rays.active) >> (from + first));
            let lanes = asked & s.le(s.splat(0.0), s.load(&start.length[first..]));
            let count = queue.count;
            for axis in 0..2 {
                s.compress(s.load(&start.cell[axis][first..]), lanes, &mut queue.waiting[CELL + axis][count..]);
                s.compress(s.load(&start.offset[axis][first..]), lanes, &mut queue.waiting[OFFSET + axis][count..]);
                s.compress(s.load(&start.slope[axis][first..]), lanes, &mut queue.waiting[SLOPE + axis][count..]);
                s.compress(s.load(&start.height[axis][first..]), lanes, &mut queue.waiting[HEIGHT + axis][count..]);
            }
            s.compress(s.load(&start.step[first..]), lanes, &mut queue.waiting[STEP][count..]);
            s.compress(s.load(&start.rise[first..]), lanes, &mut queue.waiting[RISE][count..]);
            s.compress(s.load(&start.length[first..]), lanes, &mut queue.waiting[LENGTH][count..]);
            s.compress(s.load(&start.tolerance[first..]), lanes, &mut queue.waiting[TOLERANCE][count..]);
            s.compress(s.load(&start.entered[first..]), lanes, &mut queue.waiting[ENTERED][count..]);
            s.compress(s.load(&rays.direction[1][from + first..]), lanes, &mut queue.waiting[VERTICAL][count..]);
            let mut bits = s.bits(lanes);
            while bits != 0 {
                let lane = bits.trailing_zeros() as usize;
                queue.waiting[RAY][queue.count] = queue.count as f32;
                queue.number[queue.count] = packet * LANES + from + first + lane;
                queue.base[queue.count] = start.base[first + lane];
                queue.count += 1;
                bits &= bits - 1;
            }
        }
    }

    /// Clips each ray to the surface's box and moves it there, in double precision. Loops over lanes, one plain
    /// expression each, that compilers turn into vectors.
    #[inline(always)]
    fn start<const L: usize>(&self, rays: &LaneRays, from: usize) -> Start<L> {
        let lattice = self.lattice;
        let inverse_width = [1.0 / lattice.width[0], 1.0 / lattice.width[1]];
        let (mut near, mut far) = ([0.0; L], [0.0; L]);
        let (mut origin, mut direction) = ([[0.0; L]; 3], [[0.0; L]; 3]);
        for lane in 0..L {
            near[lane] = f64::from(rays.tnear[from + lane]);
            far[lane] = f64::from(rays.tfar[from + lane]);
            origin[0][lane] = (f64::from(rays.origin[0][from + lane]) - lattice.corner[0]) * inverse_width[0];
            origin[1][lane] = (f64::from(rays.origin[2][from + lane]) - lattice.corner[1]) * inverse_width[1];
            origin[2][lane] = f64::from(rays.origin[1][from + lane]);
            direction[0][lane] = f64::from(rays.direction[0][from + lane]) * inverse_width[0];
            direction[1][lane] = f64::from(rays.direction[2][from + lane]) * inverse_width[1];
            direction[2][lane] = f64::from(rays.direction[1][from + lane]);
        }
        let tnear = near;
        let low = [lattice.domain[0][0], lattice.domain[0][1], self.range[0]];
        let high = [lattice.domain[1][0], lattice.domain[1][1], self.range[1]];
        for axis in 0..3 {
            clip(&mut near, &mut far, &origin[axis], &direction[axis], [low[axis], high[axis]]);
        }
        let mut start = Start {
            cell: [[0.0; L]; 2],
            offset: [[0.0; L]; 2],
            slope: [[0.0; L]; 2],
            height: [[0.0; L]; 2],
            step: [0.0; L],
            rise: [0.0; L],
            base: [0.0; L],
            length: [0.0; L],
            tolerance: [0.0; L],
            entered: [0.0; L],
        };
        for lane in 0..L {
            // Rounding of a slab's quotient: a few units in the last place, so that water at the very edge stays.
            let speed = direction[0][lane].abs() + direction[1][lane].abs() + f64::MIN_POSITIVE;
            let slack = 4.0 * f64::EPSILON * (near[lane].abs() + 1.0 / speed);
            let back = near[lane] - slack;
            let base = if back > tnear[lane] { back } else { tnear[lane] };
            let length = far[lane] - base;
            // Not finite: a ray that never leaves, because it is none.
            let meets = (0.0..f64::INFINITY).contains(&length);
            start.base[lane] = if meets { base } else { 0.0 };
            start.length[lane] = if meets { length as f32 } else { -1.0 };
            start.entered[lane] = (base - tnear[lane]) as f32;
        }
        for axis in 0..2 {
            let last = (lattice.cells[axis] - 1) as f64;
            for lane in 0..L {
                let at = origin[axis][lane] + start.base[lane] * direction[axis][lane];
                let cell = at.floor();
                let cell = if cell > 0.0 { cell } else { 0.0 };
                let cell = if cell < last { cell } else { last };
                start.cell[axis][lane] = cell as f32;
                start.offset[axis][lane] = (at - cell) as f32;
                start.slope[axis][lane] = direction[axis][lane] as f32;
            }
        }
        let mut plumb = false;
        for lane in 0..L {
            plumb |= (direction[0][lane] == 0.0) & (direction[1][lane] == 0.0) & (start.length[lane] >= 0.0);
        }
        if plumb {
            self.settle_plumb(rays.active >> from, &mut start, &origin, &direction);
        }
        let inverse_step = 1.0 / self.pyramid.step;
        for lane in 0..L {
            let height = origin[2][lane] + start.base[lane] * direction[2][lane];
            let leading = height as f32;
            start.height[0][lane] = leading;
            start.height[1][lane] = (height - f64::from(leading)) as f32;
            start.step[lane] = ((height - self.pyramid.floor) * inverse_step) as f32;
            start.rise[lane] = (direction[2][lane] * inverse_step) as f32;
            start.tolerance[lane] = rays.tolerance[from + lane] + rays.tolerance_growth * start.base[lane] as f32;
        }
        start
    }

    /// Plumb rays stay in one cell: on a border, in one that has a patch.
    #[cold]
    fn settle_plumb<const L: usize>(
        &self,
        active: u16,
        start: &mut Start<L>,
        origin: &[[f64; L]; 3],
        direction: &[[f64; L]; 3],
    ) {
        for lane in (0..L).filter(|&lane| direction[0][lane] == 0.0 && direction[1][lane] == 0.0) {
            if start.length[lane] >= 0.0 && active >> lane & 1 == 1 {
                let at = [origin[0][lane], origin[1][lane]];
                let cell = self.lattice.closed_cell(at, [0, 1].map(|axis| start.cell[axis][lane] as usize));
                for axis in 0..2 {
                    start.cell[axis][lane] = cell[axis] as f32;
                    // Within the cell: a whole 1 would be the next one's 0.
                    let offset = (at[axis] - cell[axis] as f64).clamp(0.0, 1.0);
                    start.offset[axis][lane] = (offset as f32).min(1.0f32.next_down());
                }
            }
        }
    }

    /// Walks all rays of the queue.
    #[inline(always)]
    fn walk<S: Simd>(&mut self, simd: S, queue: &mut Queue<N>) {
        let s = simd;
        let (lattice, pyramid) = (self.lattice, self.pyramid);
        let (zero, one) = (s.splat(0.0), s.splat(1.0));
        let infinity = s.splat(f32::INFINITY);
        let (int_zero, int_one) = (s.splat_int(0), s.splat_int(1));
        let bound_bits = s.splat_int(0x7fff);
        let hole_bit = s.splat_int(HOLE as i32);
        let sixteen = s.splat_int(16);
        let top_level = s.splat_int(pyramid.levels as i32 - 1);
        let last_cell = per_axis!(axis => s.splat_int(lattice.cells[axis] as i32 - 1));
        let growth = s.splat(self.rays[0].tolerance_growth);

        let mut base_cell = [int_zero; 2];
        let mut offset = [zero; 2];
        let mut slope = [zero; 2];
        let mut height = [zero; 2];
        let (mut step, mut rise, mut end, mut tolerance, mut vertical, mut ray) = (zero, zero, zero, zero, zero, zero);
        let mut inverse_rise = zero;
        let mut forward = [s.from_bits(0); 2];
        let mut still = [s.from_bits(0); 2];
        let mut far_border = [int_zero; 2];
        let mut inverse = [zero; 2];
        let mut cell = [int_zero; 2];
        let mut level = int_zero;
        let mut t = zero;
        let mut above = zero;
        let mut active = s.from_bits(0);
        let mut next = 0;

        loop {
            // Lanes that are done take the next rays.
            let idle = s.bits(!active) & ((1u64 << S::LANES) - 1) as u32;
            let left = (queue.count - next) as u32;
            if left > 0 && (idle.count_ones() >= REFILL.min(left) || s.none(active)) {
                let mut taken = idle;
                while taken.count_ones() > left {
                    taken &= taken - 1;
                }
                let fresh = s.from_bits(taken);
                for axis in 0..2 {
                    let start = s.expand(&queue.waiting[CELL + axis][next..], fresh, zero);
                    base_cell[axis] = s.select_int(fresh, s.floor_int(start), base_cell[axis]);
                    cell[axis] = s.select_int(fresh, base_cell[axis], cell[axis]);
                    offset[axis] = s.expand(&queue.waiting[OFFSET + axis][next..], fresh, offset[axis]);
                    slope[axis] = s.expand(&queue.waiting[SLOPE + axis][next..], fresh, slope[axis]);
                    height[axis] = s.expand(&queue.waiting[HEIGHT + axis][next..], fresh, height[axis]);
                    // Steps forward cross the far border of a block, steps backward the near one.
                    forward[axis] = s.lt(zero, slope[axis]);
                    still[axis] = s.le(s.abs(slope[axis]), s.splat(f32::MIN_POSITIVE));
                    far_border[axis] = s.select_int(forward[axis], int_one, int_zero);
                    inverse[axis] = one / slope[axis];
                }
                step = s.expand(&queue.waiting[STEP][next..], fresh, step);
                rise = s.expand(&queue.waiting[RISE][next..], fresh, rise);
                end = s.expand(&queue.waiting[LENGTH][next..], fresh, end);
                tolerance = s.expand(&queue.waiting[TOLERANCE][next..], fresh, tolerance);
                vertical = s.expand(&queue.waiting[VERTICAL][next..], fresh, vertical);
                ray = s.expand(&queue.waiting[RAY][next..], fresh, ray);
                inverse_rise = one / rise;
                let entered = s.lt(zero, s.expand(&queue.waiting[ENTERED][next..], fresh, zero));
                let first = s.select_int(entered, s.splat_int(ENTRY_LEVEL), s.splat_int(INSIDE_LEVEL));
                level = s.select_int(fresh, s.min_int(first, top_level), level);
                t = s.select(fresh, zero, t);
                above = s.select(fresh, zero, above);
                active = active | fresh;
                next += taken.count_ones() as usize;
            }
            if s.none(active) {
                break;
            }
            // Skip and descend until enough lanes stand at a patch.
            let mut waiting = s.from_bits(0);
            let mut leave = t;
            let mut crosses_x = s.from_bits(0);
            loop {
                let stepping = active & !waiting;
                if s.none(stepping) {
                    break;
                }
                let block = per_axis!(axis => s.shift_right(cell[axis], level));
                let index = s.lookup(&pyramid.start, level) + block[1] * s.lookup(&pyramid.row, level) + block[0];
                let word = s.gather(&pyramid.words, index, stepping);
                let low = s.to_float(word & bound_bits);
                let high = s.to_float(s.shift_right(word, sixteen));
                let whole = s.eq_int(word & hole_bit, int_zero);
                let exit = per_axis!(axis => {
                    let border = s.shift_left(block[axis] + far_border[axis], level) - base_cell[axis];
                    let quotient = (s.to_float(border) - offset[axis]) * inverse[axis];
                    s.select(still[axis], infinity, quotient)
                });
                let to = s.max(s.min(s.min(exit[0], exit[1]), end), t);
                let (y0, y1) = (s.fma(t, rise, step), s.fma(to, rise, step));
                let (y_low, y_high) = (s.min(y0, y1), s.max(y0, y1));
                let overlaps = s.le(low, high) & s.le(low, y_high) & s.le(y_low, high) & stepping;
                let coarse = s.gt_int(level, int_zero);

                // Down: on to where the ray enters the block's slab, and one level finer.
                let down = overlaps & coarse;
                let over = s.lt(high, y0);
                let under = s.lt(y0, low);
                let bound = s.select(over, high, low);
                let enter = s.min(s.max((bound - step) * inverse_rise, t), to);
                let moves = down & (over | under);
                // Passed over, or under; over a hole there is no side.
                let skip = stepping & !overlaps;
                let side = s.select(s.lt(high, s.select(skip, y_low, y0)), one, s.splat(-1.0));
                above = s.select(moves | skip, s.select(whole, side, zero), above);
                let at = s.select(down, s.select(moves, enter, t), to);
                let x_first = s.le(exit[0], exit[1]);
                let across = [x_first, !x_first];
                let mut climbs = s.from_bits(0);
                let up = level + int_one;
                for axis in 0..2 {
                    let least = s.shift_left(block[axis], level);
                    let most = s.min_int(s.shift_left(block[axis] + int_one, level) - int_one, last_cell[axis]);
                    let place = s.floor_int(s.fma(at, slope[axis], offset[axis])) + base_cell[axis];
                    let within = s.max_int(s.min_int(place, most), least);
                    let beyond = s.select_int(forward[axis], most + int_one, least - int_one);
                    let crossing = skip & across[axis];
                    let next = s.select_int(crossing, beyond, within);
                    let changed = crossing & !s.eq_int(s.shift_right(next, up), s.shift_right(cell[axis], up));
                    climbs = climbs | changed;
                    cell[axis] = s.select_int(skip | moves, next, cell[axis]);
                }
                let finished = skip & (s.le(end, to) | self.outside(s, &cell, &last_cell));
                active = active & !finished;
                t = s.select(skip | moves, at, t);
                level = s.select_int(down, level - int_one, s.select_int(climbs, s.min_int(up, top_level), level));
                let arrives = overlaps & !coarse;
                waiting = waiting | arrives;
                leave = s.select(arrives, to, leave);
                crosses_x = (crosses_x & !arrives) | (x_first & arrives);
                let count = s.bits(waiting).count_ones();
                let walking = s.bits(active).count_ones();
                if count * 3 > walking * 2 || (next < queue.count && walking + REFILL <= S::LANES as u32) {
                    break;
                }
            }
            if s.none(waiting) {
                continue;
            }

            // Solve the patches that lanes stand at.
            self.counts.patches += u64::from(s.bits(waiting).count_ones());
            let corner = cell[1] * s.splat_int(lattice.stride as i32) + cell[0];
            let mut window = s.gather_window::<K>(&lattice.heights, lattice.stride, corner, waiting);
            let reference = window[K / 2][K / 2];
            for row in &mut window {
                for height in row {
                    *height = *height - reference;
                }
            }
            let cells = per_axis!(axis => s.to_float(base_cell[axis] - cell[axis]));
            let from = per_axis!(axis => s.fma_exact(t, slope[axis], cells[axis]) + offset[axis]);
            let to = per_axis!(axis => s.fma_exact(leave, slope[axis], cells[axis]) + offset[axis]);
            let heights = [
                (s.fma_exact(t, vertical, height[0]) - reference) + height[1],
                (s.fma_exact(leave, vertical, height[0]) - reference) + height[1],
            ];
            let segment = Segment {
                window,
                u: [from[0], to[0]],
                v: [from[1], to[1]],
                y: heights,
                above,
                length: leave - t,
                tolerance: s.fma(growth, t, tolerance),
                mask: waiting,
            };
            let answer = self.solver.solve::<S, K, D, ANY>(s, &segment, self.counts);
            let hits = answer.hit & waiting;
            if s.any(hits) {
                let count = queue.hits;
                s.compress(ray, hits, &mut queue.found[0][count..]);
                if !ANY {
                    s.compress(s.fma(answer.s, segment.length, t), hits, &mut queue.found[AT][count..]);
                    for axis in 0..2 {
                        let ends = [segment.u, segment.v][axis];
                        let place = s.fma(answer.s, ends[1] - ends[0], ends[0]);
                        s.compress(place, hits, &mut queue.found[PLACE + axis][count..]);
                        s.compress(s.to_float(cell[axis]), hits, &mut queue.found[PATCH + axis][count..]);
                    }
                }
                queue.hits += s.bits(hits).count_ones() as usize;
            }
            let doubtful = answer.gave_up & waiting;
            if s.any(doubtful) {
                self.doubt(s, queue, ray, doubtful);
            }
            active = active & !hits & !doubtful;

            // On to the next patch.
            let missed = waiting & active;
            above = s.select(missed, answer.above, above);
            let mut climbs = s.from_bits(0);
            let across = [crosses_x, !crosses_x];
            for axis in 0..2 {
                let beyond = s.select_int(forward[axis], cell[axis] + int_one, cell[axis] - int_one);
                let next = s.select_int(missed & across[axis], beyond, cell[axis]);
                climbs =
                    climbs | (missed & !s.eq_int(s.shift_right(next, int_one), s.shift_right(cell[axis], int_one)));
                cell[axis] = next;
            }
            level = s.select_int(climbs, s.min_int(int_one, top_level), level);
            t = s.select(missed, leave, t);
            active = active & !(missed & (s.le(end, leave) | self.outside(s, &cell, &last_cell)));
        }
    }

    /// Notes the rays for which the solver gave up.
    #[cold]
    fn doubt<S: Simd>(&mut self, s: S, queue: &Queue<N>, ray: S::F, doubtful: S::M) {
        let mut rays = [0.0; LANES];
        s.store(ray, &mut rays);
        let doubtful = s.bits(doubtful);
        for lane in (0..S::LANES).filter(|lane| doubtful >> lane & 1 == 1) {
            let ray = queue.number[rays[lane] as usize];
            self.hits[ray / LANES].gave_up |= 1 << (ray % LANES);
            self.counts.gave_up += 1;
        }
    }

    /// Lanes whose cell lies outside the grid.
    #[inline(always)]
    fn outside<S: Simd>(&self, s: S, cell: &[S::I; 2], last_cell: &[S::I; 2]) -> S::M {
        let zero = s.splat_int(0);
        s.gt_int(zero, cell[0])
            | s.gt_int(zero, cell[1])
            | s.gt_int(cell[0], last_cell[0])
            | s.gt_int(cell[1], last_cell[1])
    }

    /// Writes the hits as the packets' caller wants them.
    #[inline(always)]
    fn record<S: Simd>(&mut self, s: S, queue: &Queue<N>) {
        if ANY {
            for &ray in &queue.found[0][..queue.hits] {
                let ray = queue.number[ray as usize];
                self.hits[ray / LANES].hit |= 1 << (ray % LANES);
            }
            return;
        }
        let (zero, one) = (s.splat(0.0), s.splat(1.0));
        for first in (0..queue.hits).step_by(S::LANES) {
            let count = S::LANES.min(queue.hits - first);
            let mask = s.from_bits(((1u64 << count) - 1) as u32);
            let [u, v] = per_axis!(axis => {
                s.min(s.max(s.expand(&queue.found[PLACE + axis][first..], mask, zero), zero), one)
            });
            let cell = per_axis!(axis => s.floor_int(s.expand(&queue.found[PATCH + axis][first..], mask, zero)));
            let corner = cell[1] * s.splat_int(self.lattice.stride as i32) + cell[0];
            let window = s.gather_window::<K>(&self.lattice.heights, self.lattice.stride, corner, mask);
            let (along_u, along_v) = slopes::<S, K>(s, &window, u, v);
            let patch = cell[1] * s.splat_int(self.lattice.cells[0] as i32) + cell[0];
            let mut patches = [0i32; LANES];
            let mut fields = [[0.0f32; LANES]; 4];
            s.store_int(patch, &mut patches);
            s.store(u, &mut fields[0]);
            s.store(v, &mut fields[1]);
            s.store(along_u * s.splat((-1.0 / self.lattice.width[0]) as f32), &mut fields[2]);
            s.store(along_v * s.splat((-1.0 / self.lattice.width[1]) as f32), &mut fields[3]);
            for lane in 0..count {
                let waited = queue.found[0][first + lane] as usize;
                let ray = queue.number[waited];
                let (packet, to) = (ray / LANES, ray % LANES);
                let far = f64::from(self.rays[packet].tfar[to]);
                let hits = &mut self.hits[packet];
                hits.hit |= 1 << to;
                hits.t[to] = (queue.base[waited] + f64::from(queue.found[AT][first + lane])).min(far) as f32;
                hits.primitive[to] = patches[lane] as u32;
                hits.u[to] = fields[0][lane];
                hits.v[to] = fields[1][lane];
                hits.normal[0][to] = fields[2][lane];
                hits.normal[1][to] = 1.0;
                hits.normal[2][to] = fields[3][lane];
            }
        }
    }
}

/// Clips the intervals `near..far` of each lane to a slab; the border belongs to it.
#[inline(always)]
fn clip<const L: usize>(
    near: &mut [f64; L],
    far: &mut [f64; L],
    origin: &[f64; L],
    direction: &[f64; L],
    [low, high]: [f64; 2],
) {
    for lane in 0..L {
        let d = direction[lane];
        // A ray along the slab: its quotients are infinite and say inside or outside, but for one that lies in a border,
        // 0 * inf. That one is inside.
        let inverse = if d == 0.0 { f64::INFINITY } else { 1.0 / d };
        let a = (low - origin[lane]) * inverse;
        let b = (high - origin[lane]) * inverse;
        let a = if a.is_nan() { f64::NEG_INFINITY } else { a };
        let b = if b.is_nan() { f64::INFINITY } else { b };
        let (least, most) = (if a < b { a } else { b }, if a < b { b } else { a });
        near[lane] = if least > near[lane] { least } else { near[lane] };
        far[lane] = if most < far[lane] { most } else { far[lane] };
    }
}

/// Slopes of the patch per unit of u and v.
#[inline(always)]
fn slopes<S: Simd, const K: usize>(s: S, window: &[[S::F; K]; K], u: S::F, v: S::F) -> (S::F, S::F) {
    let ((bu, du), (bv, dv)) = (lane_basis::<S, K>(s, u), lane_basis::<S, K>(s, v));
    let (mut along_u, mut along_v) = (s.splat(0.0), s.splat(0.0));
    for b in 0..K {
        let (mut value, mut slope) = (s.splat(0.0), s.splat(0.0));
        for a in 0..K {
            value = s.fma(window[b][a], bu[a], value);
            slope = s.fma(window[b][a], du[a], slope);
        }
        along_u = s.fma(slope, bv[b], along_u);
        along_v = s.fma(value, dv[b], along_v);
    }
    (along_u, along_v)
}

/// [`super::lattice::basis`] in lanes.
#[inline(always)]
fn lane_basis<S: Simd, const K: usize>(s: S, u: S::F) -> ([S::F; K], [S::F; K]) {
    let one = s.splat(1.0);
    let w = one - u;
    let half = s.splat(0.5);
    let zero = s.splat(0.0);
    let (value, slope) = match K {
        2 => ([w, u, zero, zero], [zero - one, one, zero, zero]),
        3 => ([half * w * w, s.fma(u, w, half), half * u * u, zero], [zero - w, w - u, u, zero]),
        _ => {
            let sixth = s.splat(1.0 / 6.0);
            let two_thirds = s.splat(2.0 / 3.0);
            let (one_and_half, two) = (s.splat(1.5), s.splat(2.0));
            (
                [
                    sixth * w * w * w,
                    two_thirds - u * u * (one - half * u),
                    two_thirds - w * w * (one - half * w),
                    sixth * u * u * u,
                ],
                [zero - half * w * w, u * (one_and_half * u - two), zero - w * (one_and_half * w - two), half * u * u],
            )
        }
    };
    let (mut values, mut slopes) = ([zero; K], [zero; K]);
    // Registers, not memory: a loop of known length leaves them there.
    #[allow(clippy::manual_memcpy)]
    for index in 0..K {
        values[index] = value[index];
        slopes[index] = slope[index];
    }
    (values, slopes)
}
