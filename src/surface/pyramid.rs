//! Least and greatest height of every cell and of every block of 4x4, 16x16, … cells: what lets a ray skip water.
//!
//! Blocks of 4x4 have half the levels of blocks of 2x2: fewer steps down and up, for some more along.
//!
//! Bounds are those of the Bézier hull of each patch, rounded outward to steps of one 32,700th of the whole range and
//! padded by one step more: the pad covers the rounding of a ray's height in single precision and gives flat water a
//! thickness. Both fit one 32-bit word, so that one gather fetches them: 4.3 bytes per cell with all levels. A bit of
//! the word tells whether a patch of the block is missing: then passing over the block says nothing of the side on
//! which a ray arrives at the next patch.

use super::lattice::{Lattice, to_bezier};
use crate::simd::{Kernel, Simd, SimdLevel, dispatch};

/// Greatest bound that fits, and the bits of the least in a word.
pub(super) const MOST: u32 = 0x7fff;
/// Set where a patch of the block is missing.
pub(super) const HOLE: u32 = 0x8000;
/// A cell without patch: its least is above its greatest.
const EMPTY: u32 = HOLE | MOST;

/// Binary digits of a cell's number that a level up drops: blocks of 4x4.
pub(super) const DIGITS: usize = 2;
/// Entries of the tables over levels, which are indexed by the digits dropped. A grid of 2^14 cells a side has a single
/// block on top; larger ones have more.
pub(super) const ENTRIES: usize = 16;

/// The pyramid of bounds.
#[derive(Clone, Debug)]
pub(super) struct Pyramid {
    /// Words of all levels, finest first: bits 0..15 the least, bit 15 a hole, bits 16..31 the greatest, in steps.
    pub words: Vec<u32>,
    /// Start of each level in `words`, by the digits dropped.
    pub start: [i32; ENTRIES],
    /// Blocks along x of each level, by the digits dropped.
    pub row: [i32; ENTRIES],
    /// Digits dropped on the coarsest level.
    pub top: usize,
    /// Height of step 0 (m).
    pub floor: f64,
    /// Height of one step (m), positive.
    pub step: f64,
}

impl Pyramid {
    /// Bounds of a lattice, by the instruction set that rays will be traced with.
    pub(super) fn build(lattice: &Lattice, simd: SimdLevel) -> Self {
        dispatch(simd, Build(lattice))
    }

    #[inline(always)]
    fn of(lattice: &Lattice) -> Self {
        let [cx, cz] = lattice.cells;
        let (mut low, mut high) = (vec![0.0; cx], vec![0.0; cx]);
        let (mut least, mut greatest) = (f32::INFINITY, f32::NEG_INFINITY);
        for j in 0..cz {
            row_hulls(lattice, j, &mut low, &mut high);
            for i in 0..cx {
                let exists = lattice.exists(i, j);
                least = if exists & (low[i] < least) { low[i] } else { least };
                greatest = if exists & (high[i] > greatest) { high[i] } else { greatest };
            }
        }
        let (least, greatest) = if least <= greatest { (f64::from(least), f64::from(greatest)) } else { (0.0, 0.0) };
        let magnitude = least.abs().max(greatest.abs());
        let narrow = lattice.width[0].min(lattice.width[1]);
        // A step is at least a few units in the last place of a single-precision height, and never zero.
        let step = ((greatest - least) / 32_700.0).max(4e-7 * magnitude).max(1e-6 * narrow);
        let floor = least - 3.0 * step;
        let inverse_step = 1.0 / step;
        let mut words = vec![0; cx * cz];
        for j in 0..cz {
            row_hulls(lattice, j, &mut low, &mut high);
            let row = &mut words[j * cx..][..cx];
            for i in 0..cx {
                // Not negative but for rounding, which the pad covers: truncation goes down, and one more up.
                let least = (f64::from(low[i]) - floor) * inverse_step - 1.0;
                let greatest = (f64::from(high[i]) - floor) * inverse_step + 2.0;
                let least = if least > 0.0 { least } else { 0.0 };
                let greatest = if greatest < f64::from(MOST) { greatest } else { f64::from(MOST) };
                // What does not exist may lie anywhere: the conversion saturates, and the word is not used.
                row[i] = least as i32 as u32 & MOST | (greatest as i32 as u32 & MOST) << 16;
            }
            for i in 0..cx {
                row[i] = if lattice.exists(i, j) { row[i] } else { EMPTY };
            }
        }
        words.reserve(cx * cz / 15 + cx + cz + 64);
        let mut pyramid = Self { words, start: [0; ENTRIES], row: [0; ENTRIES], top: 0, floor, step };
        pyramid.row[0] = cx as i32;
        let mut size = [cx, cz];
        while pyramid.top + DIGITS < ENTRIES && (size[0] > 1 || size[1] > 1) {
            let below = pyramid.start[pyramid.top] as usize;
            let above = size.map(|n| n.div_ceil(1 << DIGITS));
            pyramid.top += DIGITS;
            pyramid.start[pyramid.top] = pyramid.words.len() as i32;
            pyramid.row[pyramid.top] = above[0] as i32;
            for j in 0..above[1] {
                for i in 0..above[0] {
                    let mut block = MOST;
                    for b in j << DIGITS..((j + 1) << DIGITS).min(size[1]) {
                        for &word in
                            &pyramid.words[below + b * size[0]..][i << DIGITS..((i + 1) << DIGITS).min(size[0])]
                        {
                            block = (block & MOST).min(word & MOST)
                                | (block | word) & HOLE
                                | (block & !0xffff).max(word & !0xffff);
                        }
                    }
                    pyramid.words.push(block);
                }
            }
            size = above;
        }
        pyramid.words.shrink_to_fit();
        pyramid
    }

    /// Least and greatest height of everything (m), padded; `None` where no patch exists.
    pub(super) fn range(&self) -> Option<[f64; 2]> {
        let top = self.start[self.top] as usize;
        let (low, high) =
            self.words[top..].iter().fold((MOST, 0), |(low, high), &w| (low.min(w & MOST), high.max(w >> 16)));
        (low <= high).then(|| [self.floor + f64::from(low) * self.step, self.floor + f64::from(high) * self.step])
    }

    /// Bytes held.
    pub(super) fn bytes(&self) -> u64 {
        (self.words.capacity() * size_of::<u32>() + size_of::<Self>()) as u64
    }
}

/// The building as a kernel: its loops over rows are plain, so that compilers turn them into vectors.
struct Build<'a>(&'a Lattice);

impl Kernel for Build<'_> {
    type Output = Pyramid;
    #[inline(always)]
    fn run<S: Simd>(self, _: S) -> Pyramid {
        Pyramid::of(self.0)
    }
}

/// Least and greatest Bézier height of a row of cells.
#[inline(always)]
fn row_hulls(lattice: &Lattice, j: usize, low: &mut [f32], high: &mut [f32]) {
    if lattice.order == 3 {
        return row_hulls_biquadratic(lattice, j, low, high);
    }
    let order = lattice.order;
    for i in 0..lattice.cells[0] {
        let window = lattice.window(i, j);
        let mut rows = [[0.0; 4]; 4];
        for b in 0..order {
            rows[b] = to_bezier(order, window[b]);
        }
        let (mut least, mut greatest) = (f64::INFINITY, f64::NEG_INFINITY);
        for a in 0..order {
            let column = to_bezier(order, [rows[0][a], rows[1][a], rows[2][a], rows[3][a]]);
            for &height in &column[..order] {
                (least, greatest) = (least.min(height), greatest.max(height));
            }
        }
        (low[i], high[i]) = (least as f32, greatest as f32);
    }
}

/// The same for order 3 in single precision, whose rounding the pad covers.
#[inline(always)]
fn row_hulls_biquadratic(lattice: &Lattice, j: usize, low: &mut [f32], high: &mut [f32]) {
    let count = lattice.cells[0];
    let row = |number: usize| &lattice.heights[number * lattice.stride..][..count + 2];
    let (before, here, after) = (row(j), row(j + 1), row(j + 2));
    let (low, high) = (&mut low[..count], &mut high[..count]);
    // NaN-free, so a plain comparison will do: it is one instruction.
    let less = |a: f32, b: f32| if a < b { a } else { b };
    let more = |a: f32, b: f32| if a > b { a } else { b };
    for i in 0..count {
        // The middle row, and its means with the rows before and after.
        let (p0, q0, r0) = (0.5 * (before[i] + here[i]), here[i], 0.5 * (here[i] + after[i]));
        let (p1, q1, r1) = (0.5 * (before[i + 1] + here[i + 1]), here[i + 1], 0.5 * (here[i + 1] + after[i + 1]));
        let (p2, q2, r2) = (0.5 * (before[i + 2] + here[i + 2]), here[i + 2], 0.5 * (here[i + 2] + after[i + 2]));
        let ends =
            [0.5 * (p0 + p1), 0.5 * (p1 + p2), 0.5 * (q0 + q1), 0.5 * (q1 + q2), 0.5 * (r0 + r1), 0.5 * (r1 + r2)];
        let (mut least, mut greatest) = (less(p1, less(q1, r1)), more(p1, more(q1, r1)));
        for end in ends {
            (least, greatest) = (less(least, end), more(greatest, end));
        }
        (low[i], high[i]) = (least, greatest);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn noise(k: usize) -> f64 {
        let mut state = k as u64 + 1;
        state = state.wrapping_mul(0x9e37_79b9_7f4a_7c15);
        state ^= state >> 29;
        state = state.wrapping_mul(0xbf58_476d_1ce4_e5b9);
        (state >> 40) as f64 / (1u64 << 24) as f64
    }

    #[test]
    fn every_block_holds_its_surface() {
        for order in 2..=4 {
            let heights: Vec<f64> = (0..13 * 7).map(|k| 3.0 * noise(k) - 40.0).collect();
            let lattice = Lattice::new(order, [13, 7], [0.0; 2], [1.0; 2], &heights, |_| true).unwrap();
            let pyramid = Pyramid::build(&lattice, SimdLevel::detect());
            for j in 0..lattice.cells[1] {
                for i in 0..lattice.cells[0] {
                    for k in 0..25 {
                        let (height, _) = lattice.evaluate(i, j, f64::from(k % 5) / 4.0, f64::from(k / 5) / 4.0);
                        let step = (height - pyramid.floor) / pyramid.step;
                        for level in (0..=pyramid.top).step_by(DIGITS) {
                            let word = pyramid.words[pyramid.start[level] as usize
                                + (j >> level) * pyramid.row[level] as usize
                                + (i >> level)];
                            assert!(f64::from(word & MOST) <= step && step <= f64::from(word >> 16));
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn flat_water_has_a_thickness_and_dry_land_is_empty() {
        let flat = Lattice::new(3, [5, 5], [0.0; 2], [0.001; 2], &[7.0; 25], |_| true).unwrap();
        let [low, high] = Pyramid::build(&flat, SimdLevel::detect()).range().unwrap();
        assert!(low < 7.0 && high > 7.0 && high - low < 1e-4);
        let dry = Lattice::new(3, [5, 5], [0.0; 2], [1.0; 2], &[7.0; 25], |_| false).unwrap();
        assert_eq!(Pyramid::build(&dry, SimdLevel::detect()).range(), None);
    }

    #[test]
    fn bounds_take_under_five_bytes_a_cell() {
        let lattice = Lattice::new(3, [400, 400], [0.0; 2], [1.0; 2], &vec![0.0; 160_000], |_| true).unwrap();
        assert!(Pyramid::build(&lattice, SimdLevel::detect()).bytes() < 5 * 160_000);
    }
}
