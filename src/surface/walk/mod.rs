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
//!
//! Rooms: `start` moves rays to the surface's box, `step` skips and descends, `patch` solves what is left, `single` is the
//! whole walk for a ray that comes alone.

mod patch;
mod single;
mod start;
mod step;

pub(super) use single::SingleWalk;
use start::{Given, Ground};
use step::{Grid, Lanes};

use super::SolveCounts;
use super::lanes::{LANES, LaneHits, LaneRays};
use super::lattice::Lattice;
use super::pyramid::Pyramid;
use super::solve::PatchSolver;
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

use per_axis;

/// Level (digits dropped) at which a ray that enters from outside begins: it descends sooner than it would climb.
const ENTRY_LEVEL: i32 = 4;
/// Level at which a ray that begins within the bounds begins: it has just left the surface, or is about to hit it.
const INSIDE_LEVEL: i32 = 2;

/// Idle lanes that are worth a refill.
const REFILL: u32 = 4;

/// Packets of rays against one surface, at most `N` rays; lanes that are done take the next ray until none is left.
///
/// `G` vectors of lanes take turns: while one waits for its bounds to come from memory, the other has work to do.
pub(super) struct Walk<'a, P, const K: usize, const D: usize, const ANY: bool, const N: usize, const G: usize> {
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

impl<P: PatchSolver, const K: usize, const D: usize, const ANY: bool, const N: usize, const G: usize> Kernel
    for Walk<'_, P, K, D, ANY, N, G>
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

impl<P: PatchSolver, const K: usize, const D: usize, const ANY: bool, const N: usize, const G: usize>
    Walk<'_, P, K, D, ANY, N, G>
{
    /// Puts the rays of a packet that meet the surface's box in the queue.
    #[inline(always)]
    fn enqueue<S: Simd>(&self, s: S, packet: usize, queue: &mut Queue<N>) {
        let rays = &self.rays[packet];
        let ground = Ground { lattice: self.lattice, pyramid: self.pyramid, range: self.range };
        let start = ground.start(&Given::packet(rays));
        for first in (0..LANES).step_by(S::LANES) {
            let asked = s.from_bits(u32::from(rays.active) >> first);
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
            s.compress(s.load(&rays.direction[1][first..]), lanes, &mut queue.waiting[VERTICAL][count..]);
            let mut bits = s.bits(lanes);
            while bits != 0 {
                let lane = bits.trailing_zeros() as usize;
                queue.waiting[RAY][queue.count] = queue.count as f32;
                queue.number[queue.count] = packet * LANES + first + lane;
                queue.base[queue.count] = start.base[first + lane];
                queue.count += 1;
                bits &= bits - 1;
            }
        }
    }

    /// Walks all rays of the queue.
    #[inline(always)]
    fn walk<S: Simd>(&mut self, s: S, queue: &mut Queue<N>) {
        let grid = Grid::new(s, self.lattice, self.pyramid);
        let mut groups = [Lanes::empty(s); G];
        let mut next = 0;
        loop {
            let mut walking = false;
            for group in &mut groups {
                // Lanes that are done take the next rays.
                let idle = s.bits(!group.active) & ((1u64 << S::LANES) - 1) as u32;
                let left = (queue.count - next) as u32;
                if left > 0 && (idle.count_ones() >= REFILL.min(left) || s.none(group.active)) {
                    next += self.refill(s, &grid, group, queue, next, idle);
                }
                walking |= s.any(group.active);
            }
            if !walking {
                break;
            }
            for group in &mut groups {
                self.step(s, &grid, group);
            }
            for group in &mut groups {
                let waiting = s.bits(group.waiting).count_ones();
                if waiting * 3 > s.bits(group.active).count_ones() * 2 {
                    self.solve(s, &grid, group, queue);
                }
            }
        }
    }

    /// Gives the lanes of `idle` the rays from `next` on, as far as there are any; how many it took.
    #[inline(always)]
    fn refill<S: Simd>(
        &self,
        s: S,
        grid: &Grid<S>,
        lanes: &mut Lanes<S>,
        queue: &Queue<N>,
        next: usize,
        idle: u32,
    ) -> usize {
        let (zero, one) = (s.splat(0.0), s.splat(1.0));
        let left = (queue.count - next) as u32;
        let mut taken = idle;
        while taken.count_ones() > left {
            taken &= taken - 1;
        }
        let fresh = s.from_bits(taken);
        for axis in 0..2 {
            let start = s.expand(&queue.waiting[CELL + axis][next..], fresh, zero);
            lanes.base_cell[axis] = s.select_int(fresh, s.floor_int(start), lanes.base_cell[axis]);
            lanes.cell[axis] = s.select_int(fresh, lanes.base_cell[axis], lanes.cell[axis]);
            lanes.offset[axis] = s.expand(&queue.waiting[OFFSET + axis][next..], fresh, lanes.offset[axis]);
            lanes.slope[axis] = s.expand(&queue.waiting[SLOPE + axis][next..], fresh, lanes.slope[axis]);
            lanes.height[axis] = s.expand(&queue.waiting[HEIGHT + axis][next..], fresh, lanes.height[axis]);
            // Steps forward cross the far border of a block, steps backward the near one.
            lanes.forward[axis] = s.le(zero, lanes.slope[axis]);
            lanes.back[axis] = s.select_int(lanes.forward[axis], s.splat_int(0), s.splat_int(1));
            // Finite, so that a lane that stands on a border gets no NaN from it.
            let most = s.splat(f32::MAX);
            let inverse = s.min(s.max(one / lanes.slope[axis], zero - most), most);
            let still = s.le(s.abs(lanes.slope[axis]), zero);
            lanes.inverse[axis] = s.select(still, most, inverse);
        }
        lanes.step = s.expand(&queue.waiting[STEP][next..], fresh, lanes.step);
        lanes.rise = s.expand(&queue.waiting[RISE][next..], fresh, lanes.rise);
        lanes.end = s.expand(&queue.waiting[LENGTH][next..], fresh, lanes.end);
        lanes.tolerance = s.expand(&queue.waiting[TOLERANCE][next..], fresh, lanes.tolerance);
        lanes.vertical = s.expand(&queue.waiting[VERTICAL][next..], fresh, lanes.vertical);
        lanes.ray = s.expand(&queue.waiting[RAY][next..], fresh, lanes.ray);
        lanes.inverse_rise = one / lanes.rise;
        let entered = s.lt(zero, s.expand(&queue.waiting[ENTERED][next..], fresh, zero));
        let first = s.select_int(entered, s.splat_int(ENTRY_LEVEL), s.splat_int(INSIDE_LEVEL));
        lanes.level = s.select_int(fresh, s.min_int(first, grid.top_level), lanes.level);
        lanes.t = s.select(fresh, zero, lanes.t);
        lanes.above = s.select(fresh, zero, lanes.above);
        lanes.active = lanes.active | fresh;
        taken.count_ones() as usize
    }
}
