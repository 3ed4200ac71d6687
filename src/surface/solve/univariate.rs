//! The default solver: one polynomial per lane in Bernstein form, bracketed.
//!
//! Coefficients of one sign prove a miss; one sign variation proves a single root, which Newton inside a shrinking
//! bracket then finds; more variations halve the stretch, nearer half first (Collins and Akritas 1976). So the first
//! root is found whatever the patch looks like.
//!
//! *At tangency:* a stretch shorter than 2^-12 of the segment whose ends have one sign counts as passed by: there the
//! second difference of the coefficients is 2^-24 of the first, below single precision's own rounding.

use super::polynomial::lane_polynomial;
use super::{Answer, PatchSolver, Segment};
use crate::simd::Simd;
use crate::surface::SolveCounts;

/// Shortest stretch that is still halved, as a share of the segment.
const SHORTEST: f32 = 1.0 / 4096.0;
/// Rounds of halving and clearing before a lane gives up. Twelve halvings isolate a root; a lane that crawls along
/// many near-touches needs a few dozen rounds.
const ROUNDS: usize = 200;
/// Steps inside a bracket: 24 halvings exhaust single precision, Newton usually needs 3.
const STEPS: usize = 32;

/// The univariate bracketed solver.
#[derive(Clone, Copy, Debug)]
pub(in crate::surface) struct Univariate;

impl PatchSolver for Univariate {
    #[inline(always)]
    fn solve<S: Simd, const K: usize, const D: usize, const ANY: bool>(
        self,
        simd: S,
        segment: &Segment<S, K>,
        counts: &mut SolveCounts,
    ) -> Answer<S> {
        let zero = simd.splat(0.0);
        let one = simd.splat(1.0);
        let mut whole = lane_polynomial::<S, K, D>(simd, segment);
        // Turn the lanes that come from below upside down: from here on every ray comes in above.
        let unknown = simd.le(simd.abs(segment.above), zero);
        let from_first = simd.flip_by_sign(one, whole[0]);
        let side = simd.select(unknown, from_first, segment.above);
        for c in &mut whole[..=D] {
            *c = simd.flip_by_sign(*c, side);
        }
        let mut least = whole[0];
        for &c in &whole[1..=D] {
            least = simd.min(least, c);
        }
        // On the surface, or past it since the last patch: the border itself is the hit.
        let at_border = segment.mask & simd.le(whole[0], zero);
        let mut open = segment.mask & simd.le(least, zero) & !at_border;
        let mut hit = at_border;
        let mut s = zero;
        let mut gave_up = simd.from_bits(0);
        if simd.any(open) {
            let mut part = whole;
            let (mut start, mut end) = (zero, one);
            let mut rounds = 0;
            loop {
                let (some, single) = variations::<S, D>(simd, &part);
                let single = single & open;
                if simd.any(single) {
                    hit = hit | single;
                    open = open & !single;
                    if !ANY {
                        let width = end - start;
                        let stretch = width * segment.length;
                        let within = single_root::<S, D>(simd, &part, single, stretch, segment.tolerance, counts);
                        s = simd.select(single, simd.fma(within, width, start), s);
                    }
                }
                // Proven clear, or too short to split with both ends above: go on behind it.
                let short = simd.le(end - start, simd.splat(SHORTEST));
                let below_at_end = simd.le(part[D], zero);
                let pinned = open & some & short & below_at_end;
                hit = hit | pinned;
                s = simd.select(pinned, end, s);
                open = open & !pinned;
                let clear = open & (!some | short);
                open = open & !(clear & simd.le(one, end));
                if simd.none(open) {
                    break;
                }
                rounds += 1;
                if rounds == ROUNDS {
                    gave_up = open;
                    break;
                }
                let middle = (start + end) * simd.splat(0.5);
                let (next_start, next_end) = (simd.select(clear, end, start), simd.select(clear, one, middle));
                start = next_start;
                end = next_end;
                part = restrict::<S, D>(simd, &whole, start, end);
            }
        }
        Answer { hit, s, gave_up, above: side }
    }
}

/// Share of the largest coefficient under which the last one's sign says nothing: a few times single precision's rounding
/// of the coefficients.
const NOISE: f32 = 1.0 / (1 << 20) as f32;

/// Whether any coefficient is not positive, and whether the signs change exactly once (the first is positive) and the
/// last is negative beyond doubt: a ray that leaves the surface again by the border of its patch has two crossings there,
/// the second of which rounding may hide.
#[inline(always)]
fn variations<S: Simd, const D: usize>(simd: S, part: &[S::F; 7]) -> (S::M, S::M) {
    let zero = simd.splat(0.0);
    let mut below = simd.le(part[0], zero);
    let mut some = below;
    let mut rises = simd.from_bits(0);
    let mut largest = part[0];
    for k in 1..=D {
        let here = simd.le(part[k], zero);
        rises = rises | (below & !here);
        some = some | here;
        below = here;
        largest = simd.max(largest, simd.abs(part[k]));
    }
    let sure = simd.lt(simd.fma(largest, simd.splat(NOISE), part[D]), zero);
    (some, sure & !rises)
}

/// The polynomial over [start, end], by de Casteljau's algorithm twice.
#[inline(always)]
fn restrict<S: Simd, const D: usize>(simd: S, whole: &[S::F; 7], start: S::F, end: S::F) -> [S::F; 7] {
    // Left part of a split at `end` …
    let mut row = *whole;
    let mut left = *whole;
    for level in 1..=D {
        for k in 0..=D - level {
            row[k] = simd.fma(end, row[k + 1] - row[k], row[k]);
        }
        left[level] = row[0];
    }
    // … then the right part of that at start / end.
    let ratio = start / end;
    for level in 1..=D {
        for k in 0..=D - level {
            left[k] = simd.fma(ratio, left[k + 1] - left[k], left[k]);
        }
    }
    left
}

/// The single root of a stretch: Newton on the power form, kept inside its bracket by halving.
#[inline(always)]
fn single_root<S: Simd, const D: usize>(
    simd: S,
    part: &[S::F; 7],
    lanes: S::M,
    stretch: S::F,
    tolerance: S::F,
    counts: &mut SolveCounts,
) -> S::F {
    // Power coefficients: binomial times forward differences.
    let mut power = *part;
    for level in 1..=D {
        for k in (level..=D).rev() {
            power[k] = power[k] - power[k - 1];
        }
    }
    let mut factor = 1.0;
    for k in 1..=D {
        factor = factor * (D + 1 - k) as f32 / k as f32;
        power[k] = power[k] * simd.splat(factor);
    }
    let zero = simd.splat(0.0);
    let half = simd.splat(0.5);
    let (mut low, mut high) = (zero, simd.splat(1.0));
    // Regula falsi as the first guess.
    let mut x = simd.min(simd.max(part[0] / (part[0] - part[D]), zero), high);
    // Finer than a few units in the last place of the stretch there is nothing to find.
    let enough = simd.max(tolerance, stretch * simd.splat(1.0 / (1 << 22) as f32));
    let mut open = lanes;
    for _ in 0..STEPS {
        counts.iterations += u64::from(simd.bits(open).count_ones());
        let mut value = power[D];
        let mut slope = zero;
        for k in (0..D).rev() {
            slope = simd.fma(slope, x, value);
            value = simd.fma(value, x, power[k]);
        }
        let before = simd.lt(zero, value);
        low = simd.select(before, x, low);
        high = simd.select(before, high, x);
        let newton = x - value / slope;
        let inside = simd.le(low, newton) & simd.le(newton, high);
        let next = simd.select(inside, newton, (low + high) * half);
        let moved = simd.abs(next - x) * stretch;
        x = simd.select(open, next, x);
        open = open & simd.lt(enough, moved);
        if simd.none(open) {
            break;
        }
    }
    x
}
