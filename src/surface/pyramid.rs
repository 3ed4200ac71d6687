//! Least and greatest height of every cell and of every block of 2x2, 4x4, … cells: what lets a ray skip water.
//!
//! Bounds are those of the Bézier hull of each patch, rounded outward to steps of one 32,700th of the whole range and
//! padded by one step more: the pad covers the rounding of a ray's height in single precision and gives flat water a
//! thickness. Both fit one 32-bit word, so that one gather fetches them: 5.3 bytes per cell with all levels. A bit of
//! the word tells whether a patch of the block is missing: then passing over the block says nothing of the side on
//! which a ray arrives at the next patch.

use super::lattice::{Lattice, to_bezier};

/// Greatest bound that fits.
const MOST: u32 = 0x7fff;
/// Set where a patch of the block is missing.
pub(super) const HOLE: u32 = 0x8000;
/// A cell without patch: its least is above its greatest.
const EMPTY: u32 = HOLE | MOST;

/// Levels at most: a grid of 2^15 cells a side has a single block on top; larger ones have more.
pub(super) const MAX_LEVELS: usize = 16;

/// The pyramid of bounds.
#[derive(Clone, Debug)]
pub(super) struct Pyramid {
    /// Words of all levels, finest first: bits 0..15 the least, bit 15 a hole, bits 16..31 the greatest, in steps.
    pub words: Vec<u32>,
    /// Start of each level in `words`.
    pub start: [i32; MAX_LEVELS],
    /// Blocks along x of each level.
    pub row: [i32; MAX_LEVELS],
    /// Levels.
    pub levels: usize,
    /// Height of step 0 (m).
    pub floor: f64,
    /// Height of one step (m), positive.
    pub step: f64,
}

impl Pyramid {
    /// Bounds of a lattice.
    pub(super) fn build(lattice: &Lattice) -> Self {
        let [cx, cz] = lattice.cells;
        let hulls = hulls(lattice);
        let (least, greatest) = (0..cx * cz)
            .filter(|&cell| lattice.exists(cell % cx, cell / cx))
            .map(|cell| hulls[cell])
            .fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), hull| (low.min(hull[0]), high.max(hull[1])));
        let (least, greatest) = if least <= greatest { (f64::from(least), f64::from(greatest)) } else { (0.0, 0.0) };
        let magnitude = least.abs().max(greatest.abs());
        let narrow = lattice.width[0].min(lattice.width[1]);
        // A step is at least a few units in the last place of a single-precision height, and never zero.
        let step = ((greatest - least) / 32_700.0).max(4e-7 * magnitude).max(1e-6 * narrow);
        let floor = least - 3.0 * step;
        let mut words = Vec::with_capacity(cx * cz * 4 / 3 + 64);
        for j in 0..cz {
            for i in 0..cx {
                words.push(if lattice.exists(i, j) {
                    let [low, high] = hulls[j * cx + i];
                    let low = ((f64::from(low) - floor) / step).floor() - 1.0;
                    let high = ((f64::from(high) - floor) / step).ceil() + 1.0;
                    (low.max(0.0) as u32) | (high.min(f64::from(MOST)) as u32) << 16
                } else {
                    EMPTY
                });
            }
        }
        let mut pyramid = Self { words, start: [0; MAX_LEVELS], row: [0; MAX_LEVELS], levels: 1, floor, step };
        pyramid.row[0] = cx as i32;
        let mut size = [cx, cz];
        while pyramid.levels < MAX_LEVELS && (size[0] > 1 || size[1] > 1) {
            let below = pyramid.start[pyramid.levels - 1] as usize;
            let above = size.map(|n| n.div_ceil(2));
            pyramid.start[pyramid.levels] = pyramid.words.len() as i32;
            pyramid.row[pyramid.levels] = above[0] as i32;
            for j in 0..above[1] {
                for i in 0..above[0] {
                    let mut block = MOST;
                    for (di, dj) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                        let (a, b) = (2 * i + di, 2 * j + dj);
                        if a < size[0] && b < size[1] {
                            let word = pyramid.words[below + b * size[0] + a];
                            block = (block & MOST).min(word & MOST)
                                | (block | word) & HOLE
                                | (block & !0xffff).max(word & !0xffff);
                        }
                    }
                    pyramid.words.push(block);
                }
            }
            size = above;
            pyramid.levels += 1;
        }
        pyramid.words.shrink_to_fit();
        pyramid
    }

    /// Least and greatest height of everything (m), padded; `None` where no patch exists.
    pub(super) fn range(&self) -> Option<[f64; 2]> {
        let top = self.start[self.levels - 1] as usize;
        let (low, high) =
            self.words[top..].iter().fold((MOST, 0), |(low, high), &w| (low.min(w & MOST), high.max(w >> 16)));
        (low <= high).then(|| [self.floor + f64::from(low) * self.step, self.floor + f64::from(high) * self.step])
    }

    /// Bytes held.
    pub(super) fn bytes(&self) -> u64 {
        (self.words.capacity() * size_of::<u32>() + size_of::<Self>()) as u64
    }
}

/// Least and greatest Bézier height of every cell.
fn hulls(lattice: &Lattice) -> Vec<[f32; 2]> {
    let [cx, cz] = lattice.cells;
    let order = lattice.order;
    if order == 3 {
        return hulls_biquadratic(lattice);
    }
    (0..cx * cz)
        .map(|cell| {
            let window = lattice.window(cell % cx, cell / cx);
            let mut rows = [[0.0; 4]; 4];
            for b in 0..order {
                rows[b] = to_bezier(order, window[b]);
            }
            let mut hull = [f64::INFINITY, f64::NEG_INFINITY];
            for a in 0..order {
                let column = to_bezier(order, [rows[0][a], rows[1][a], rows[2][a], rows[3][a]]);
                for &height in &column[..order] {
                    hull = [hull[0].min(height), hull[1].max(height)];
                }
            }
            [hull[0] as f32, hull[1] as f32]
        })
        .collect()
}

/// The same for order 3, row by row so that compilers turn it into vectors; single precision is covered by the pad.
fn hulls_biquadratic(lattice: &Lattice) -> Vec<[f32; 2]> {
    let [cx, cz] = lattice.cells;
    let stride = lattice.stride;
    let mut hulls = vec![[0.0; 2]; cx * cz];
    // Least and greatest along x of three rows: the middle one, and its means with the rows before and after.
    for j in 0..cz {
        let before = &lattice.heights[j * stride..][..stride];
        let here = &lattice.heights[(j + 1) * stride..][..stride];
        let after = &lattice.heights[(j + 2) * stride..][..stride];
        for (i, hull) in hulls[j * cx..][..cx].iter_mut().enumerate() {
            let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
            let columns = [0, 1, 2].map(|a| {
                let (p, q, r) = (before[i + a], here[i + a], after[i + a]);
                [0.5 * (p + q), q, 0.5 * (q + r)]
            });
            for b in 0..3 {
                let (p, q, r) = (columns[0][b], columns[1][b], columns[2][b]);
                let (p, r) = (0.5 * (p + q), 0.5 * (q + r));
                low = low.min(p.min(q).min(r));
                high = high.max(p.max(q).max(r));
            }
            *hull = [low, high];
        }
    }
    hulls
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
            let pyramid = Pyramid::build(&lattice);
            for j in 0..lattice.cells[1] {
                for i in 0..lattice.cells[0] {
                    for k in 0..25 {
                        let (height, _) = lattice.evaluate(i, j, f64::from(k % 5) / 4.0, f64::from(k / 5) / 4.0);
                        let step = (height - pyramid.floor) / pyramid.step;
                        for level in 0..pyramid.levels {
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
        let [low, high] = Pyramid::build(&flat).range().unwrap();
        assert!(low < 7.0 && high > 7.0 && high - low < 1e-4);
        let dry = Lattice::new(3, [5, 5], [0.0; 2], [1.0; 2], &[7.0; 25], |_| false).unwrap();
        assert_eq!(Pyramid::build(&dry).range(), None);
    }

    #[test]
    fn bounds_take_under_six_bytes_a_cell() {
        let lattice = Lattice::new(3, [400, 400], [0.0; 2], [1.0; 2], &vec![0.0; 160_000], |_| true).unwrap();
        assert!(Pyramid::build(&lattice).bytes() < 6 * 160_000);
    }
}
