//! Work on whole rows: in parallel where that pays, in the widest instructions that the processor has.
//!
//! Loops over a row are plain ones that the compiler turns into vectors; all that they call must be `#[inline(always)]`.
//! No sum is contracted or reordered, so neither threads nor instruction set show in the bits.

use crate::simd::{self, Kernel, Simd, SimdLevel};
use rayon::prelude::*;

/// Fewer columns than this are not worth a second thread.
const PARALLEL_FROM: usize = 4096;

/// The greater of two numbers. Unlike `f64::max` it does not look for what is not a number, which costs half the speed.
#[inline(always)]
pub(super) fn greater(a: f64, b: f64) -> f64 {
    if a > b { a } else { b }
}

/// Whether a map of so many columns is worth more than one thread, and has it.
pub(super) fn is_parallel(count: usize) -> bool {
    count >= PARALLEL_FROM && rayon::current_num_threads() > 1
}

/// Plain work as a kernel.
pub(super) struct Run<F>(pub F);

impl<F: FnOnce()> Kernel for Run<F> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        (self.0)();
    }
}

/// Calls `work` for each row of `field`, in parallel where that pays: every row has its own output, so the bits do not
/// depend on who makes them.
pub(super) fn each_row<T: Send>(
    field: &mut [T],
    chunk: usize,
    parallel: bool,
    work: impl Fn(usize, &mut [T]) + Sync + Send,
) {
    let level = SimdLevel::detect();
    let work = |(z, row): (usize, &mut [T])| simd::dispatch(level, Run(|| work(z, row)));
    if parallel {
        field.par_chunks_mut(chunk).enumerate().for_each(work);
    } else {
        field.chunks_mut(chunk).enumerate().for_each(work);
    }
}

/// The same for two fields with equal rows.
pub(super) fn each_row_of_two<T: Send>(
    first: &mut [T],
    second: &mut [T],
    chunk: usize,
    parallel: bool,
    work: impl Fn(usize, &mut [T], &mut [T]) + Sync + Send,
) {
    let level = SimdLevel::detect();
    let work =
        |(z, (first, second)): (usize, (&mut [T], &mut [T]))| simd::dispatch(level, Run(|| work(z, first, second)));
    if parallel {
        let rows = first.par_chunks_mut(chunk).zip(second.par_chunks_mut(chunk));
        rows.enumerate().for_each(work);
    } else {
        let rows = first.chunks_mut(chunk).zip(second.chunks_mut(chunk));
        rows.enumerate().for_each(work);
    }
}
