//! Rivals against each other: rays per second in turns, and answers against the referee.
//!
//! Rivals take turns round by round; each figure is the median over the rounds, each ratio the median of the rounds' own
//! ratios to the first rival, so that a machine whose speed drifts does not bend them.

use std::hint::black_box;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

use rayon::prelude::*;

use super::rows::Row;
use super::tracer::{Answers, Tracer};
use super::{Settings, median};
use crate::accel::{NO_PART, RayBatch};
use crate::surface::audit::Audit;
use crate::surface::{LANES, Lattice, SolveCounts, referee};

/// Rays in one call of a batch: a tile's worth.
const BATCH: usize = 4096;

/// Something that answers rays, with what tables say of it.
pub struct Rival {
    /// Accelerator, or what stands for one.
    pub name: String,
    /// Solver, if it has one.
    pub solver: String,
    /// Instruction set of our kernels, if they are asked.
    pub simd: String,
    /// Order of the surface; 0 where there is none.
    pub order: u32,
    /// Who answers.
    pub tracer: Tracer,
    /// Milliseconds to build.
    pub build_ms: f64,
    /// Bytes held above the heights.
    pub bytes: f64,
    /// Timed and checked over no more rays than this: for those that take long.
    pub most_rays: usize,
}

impl Rival {
    /// `embree univariate x16`, and the order where it is not 3.
    pub fn title(&self) -> String {
        let order = if matches!(self.order, 0 | 3) { String::new() } else { format!(", order {}", self.order) };
        let solver = if self.solver.is_empty() { String::new() } else { format!(" {}", self.solver) };
        format!("{}{solver} {}{order}", self.name, if self.tracer.batch() { "x16" } else { "x1" })
    }
}

/// What a row says of a rival and of its answers; the rest is its benchmark's to fill.
pub fn row(rival: &Rival, checked: &Checked) -> Row {
    let audit = checked.audit;
    Row {
        order: rival.order,
        accel: rival.name.clone(),
        solver: rival.solver.clone(),
        simd: rival.simd.clone(),
        batch: rival.tracer.batch(),
        checked: audit.rays,
        lost: audit.lost,
        false_hits: audit.false_hits,
        wrong: audit.wrong,
        tangent: audit.tangent,
        gave_up: checked.gave_up,
        error_rms: checked.error_rms(),
        error_max: checked.error_max,
        build_ms: rival.build_ms,
        ..Row::default()
    }
}

/// Cuts rays into calls.
pub fn split(rays: &RayBatch) -> Vec<RayBatch> {
    chunks(rays, BATCH, 0..rays.len())
}

/// Some of the rays in batches of `size`.
fn chunks(rays: &RayBatch, size: usize, indices: impl Iterator<Item = usize>) -> Vec<RayBatch> {
    let mut batches: Vec<RayBatch> = Vec::new();
    for index in indices {
        if batches.last().is_none_or(|batch| batch.len() == size) {
            batches.push(RayBatch { tolerance_growth: rays.tolerance_growth, ..RayBatch::default() });
        }
        if let Some(batch) = batches.last_mut() {
            let (origin, direction) = (rays.origin(index), rays.direction(index));
            batch.push(origin, direction, rays.tnear[index], rays.tfar[index], rays.tolerance[index]);
        }
    }
    batches
}

/// An even sample of about `most` rays, in whole packets, so that neighbours stay together.
pub fn sample(rays: &RayBatch, most: usize) -> RayBatch {
    let packets = rays.len().div_ceil(LANES);
    let step = packets.div_ceil(most.div_ceil(LANES).max(1)).max(1);
    let indices = (0..packets).step_by(step).flat_map(|packet| packet * LANES..rays.len().min(packet * LANES + LANES));
    chunks(rays, usize::MAX, indices.take(most)).pop().unwrap_or_default()
}

/// Speed of one rival.
#[derive(Clone, Copy, Debug, Default)]
pub struct Speed {
    /// Millions of rays per second.
    pub mrays_per_s: f64,
    /// Against the first rival.
    pub ratio: f64,
}

/// Times the rivals in turns over the rays.
pub fn speeds(rivals: &[Rival], any: bool, rays: &RayBatch, settings: &Settings) -> Vec<Speed> {
    let all = Arc::new(split(rays));
    let turns: Vec<Turn> = rivals.iter().map(|rival| Turn::new(rival, &all, settings.threads)).collect();
    in_turns(&turns, any, settings)
}

/// One rival's share of a round.
pub struct Turn<'a> {
    rival: &'a Rival,
    batches: Arc<Vec<RayBatch>>,
    threads: usize,
    few: bool,
}

impl<'a> Turn<'a> {
    /// All rays, or as many as the rival takes.
    pub fn new(rival: &'a Rival, all: &Arc<Vec<RayBatch>>, threads: usize) -> Self {
        let count: usize = all.iter().map(RayBatch::len).sum();
        let few = rival.most_rays < count;
        let batches = if few { Arc::new(few_of(all, rival.most_rays)) } else { all.clone() };
        Self { rival, batches, threads, few }
    }
}

/// An even sample of batches' packets, in batches that all threads find work in.
fn few_of(all: &[RayBatch], most: usize) -> Vec<RayBatch> {
    let each = most.div_ceil(all.len().max(1));
    let step = all.len().div_ceil(most.div_ceil(LANES).max(1)).max(1);
    all.iter().step_by(step).map(|batch| sample(batch, each.max(LANES.min(most)))).collect()
}

/// Times the rivals in turns, each with its own rays and threads; ratios are to the first.
pub fn in_turns(turns: &[Turn], any: bool, settings: &Settings) -> Vec<Speed> {
    let mut taken: Vec<(Vec<f64>, Vec<f64>)> = vec![Default::default(); turns.len()];
    for round in 0..=settings.rounds() {
        let mut baseline = 1.0;
        for (index, turn) in turns.iter().enumerate() {
            // Those who are slow are slow by far more than a few rounds' noise.
            if turn.few && round > 3 {
                continue;
            }
            let count: usize = turn.batches.iter().map(RayBatch::len).sum();
            let rate = count as f64 / seconds(&turn.rival.tracer, any, &turn.batches, turn.threads) / 1e6;
            if index == 0 {
                baseline = rate;
            }
            // The first round warms caches and clocks.
            if round > 0 {
                taken[index].0.push(rate);
                taken[index].1.push(rate / baseline);
            }
        }
    }
    taken
        .into_iter()
        .map(|(mut rates, mut ratios)| Speed { mrays_per_s: median(&mut rates), ratio: median(&mut ratios) })
        .collect()
}

/// Seconds to answer all batches; threads take the next batch when they are done with one.
pub fn seconds(tracer: &Tracer, any: bool, batches: &[RayBatch], threads: usize) -> f64 {
    let next = AtomicUsize::new(0);
    let work = || {
        let (mut answers, mut counts) = (Answers::default(), SolveCounts::default());
        while let Some(rays) = batches.get(next.fetch_add(1, Ordering::Relaxed)) {
            tracer.trace(any, rays, &mut answers, &mut counts);
            black_box(&answers);
        }
        black_box(counts);
    };
    let start = Instant::now();
    std::thread::scope(|scope| {
        for _ in 1..threads {
            scope.spawn(work);
        }
        work();
    });
    start.elapsed().as_secs_f64()
}

/// One rival's answers against the referee's.
#[derive(Clone, Copy, Debug, Default)]
pub struct Checked {
    /// Lost, false, wrong, tangent.
    pub audit: Audit,
    /// Rays on which the solver gave up.
    pub gave_up: u64,
    /// Rays whose crossing is the referee's: |dt| is no more than a column.
    pub same: u64,
    squares: f64,
    /// Greatest |dt| over these, in columns.
    pub error_max: f64,
}

impl Checked {
    /// Root of the mean square of dt over rays whose crossing is the referee's, in columns.
    pub fn error_rms(&self) -> f64 {
        (self.squares / self.same.max(1) as f64).sqrt()
    }
}

impl std::ops::AddAssign for Checked {
    fn add_assign(&mut self, other: Self) {
        self.audit += other.audit;
        self.gave_up += other.gave_up;
        self.same += other.same;
        self.squares += other.squares;
        self.error_max = self.error_max.max(other.error_max);
    }
}

/// Checks every ray of every rival against the referee on that rival's lattice, on all threads of the current pool.
pub fn check(rivals: &[(&Rival, &Lattice)], any: bool, rays: &RayBatch) -> Vec<Checked> {
    let totals = chunks(rays, 1024, 0..rays.len())
        .par_iter()
        .enumerate()
        .map(|(block, rays)| {
            let mut exact: Vec<(u32, Vec<_>)> = Vec::new();
            let one = |&(rival, lattice): &(&Rival, &Lattice)| {
                if block * 1024 >= most_checked(rival) {
                    return Checked::default();
                }
                let known = exact.iter().position(|(order, _)| *order == rival.order).unwrap_or_else(|| {
                    let ask = |index| {
                        let (origin, direction, range) = in_double(rays, index);
                        referee::first_hit(lattice, origin, direction, range)
                    };
                    exact.push((rival.order, (0..rays.len()).map(ask).collect()));
                    exact.len() - 1
                });
                check_block(rival, lattice, any, rays, &exact[known].1)
            };
            rivals.iter().map(one).collect::<Vec<_>>()
        })
        .collect::<Vec<_>>();
    let mut sum = vec![Checked::default(); rivals.len()];
    for block in totals {
        for (sum, one) in sum.iter_mut().zip(block) {
            *sum += one;
        }
    }
    sum
}

fn in_double(rays: &RayBatch, index: usize) -> (glam::DVec3, glam::DVec3, [f64; 2]) {
    let range = [f64::from(rays.tnear[index]), f64::from(rays.tfar[index])];
    (rays.origin(index).as_dvec3(), rays.direction(index).as_dvec3(), range)
}

/// Solvers answer for every ray, however slowly; brute force, which has none, only for as many as it is timed over.
fn most_checked(rival: &Rival) -> usize {
    if rival.solver.is_empty() { rival.most_rays } else { usize::MAX }
}

fn check_block(
    rival: &Rival,
    lattice: &Lattice,
    any: bool,
    rays: &RayBatch,
    exact: &[Option<referee::RefereeHit>],
) -> Checked {
    let (mut answers, mut counts, mut checked) = (Answers::default(), SolveCounts::default(), Checked::default());
    let most = most_checked(rival);
    let few = if rays.len() > most { Some(sample_front(rays, most)) } else { None };
    let rays = few.as_ref().unwrap_or(rays);
    rival.tracer.trace(any, rays, &mut answers, &mut counts);
    let column = lattice.width[0].min(lattice.width[1]);
    for (index, &exact) in exact.iter().enumerate().take(rays.len()) {
        let (origin, direction, range) = in_double(rays, index);
        if any {
            let answer = answers.occluded[index];
            checked.audit.check_any_against(exact, lattice, origin, direction, range, answer);
            continue;
        }
        let answer = (answers.hits.part[index] != NO_PART).then(|| f64::from(answers.hits.t[index]));
        checked.audit.check_against(exact, lattice, origin, direction, range, answer);
        if let (Some(exact), Some(t)) = (exact, answer) {
            let error = (t - exact.t).abs() * direction.length() / column;
            if error <= 1.0 {
                checked.same += 1;
                checked.squares += error * error;
                checked.error_max = checked.error_max.max(error);
            }
        }
    }
    checked.gave_up = counts.gave_up;
    checked
}

fn sample_front(rays: &RayBatch, count: usize) -> RayBatch {
    chunks(rays, usize::MAX, 0..count.min(rays.len())).pop().unwrap_or_default()
}
