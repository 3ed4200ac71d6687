//! Vector types over `std::arch` and the choice of instruction set at start.
//!
//! A kernel is written once, generic over `Simd`, and run through `dispatch`: one entry point per instruction set,
//! chosen by name at run time. Everything a kernel calls must be `#[inline(always)]`, or it leaves the entry point's
//! instruction set. The `unsafe` of the intrinsics stays in this room: values of a vector type can only be made from a
//! token, and a token only after the processor was asked.

#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;
mod portable;
mod single;

use std::ops::{Add, BitAnd, BitOr, BitXor, Div, Mul, Not, Sub};
use std::sync::OnceLock;

/// An instruction set by name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum SimdLevel {
    /// 16 lanes, AVX-512 F, DQ, BW and VL.
    Avx512,
    /// 8 lanes, AVX2 and FMA.
    Avx2,
    /// 4 lanes of plain arithmetic.
    Portable,
}

impl SimdLevel {
    /// Every level, widest first.
    pub const ALL: [Self; 3] = [Self::Avx512, Self::Avx2, Self::Portable];

    /// Whether this processor can run it.
    pub fn is_available(self) -> bool {
        match self {
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => {
                is_x86_feature_detected!("avx512f")
                    && is_x86_feature_detected!("avx512dq")
                    && is_x86_feature_detected!("avx512bw")
                    && is_x86_feature_detected!("avx512vl")
            }
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma"),
            #[cfg(not(target_arch = "x86_64"))]
            Self::Avx512 | Self::Avx2 => false,
            Self::Portable => true,
        }
    }

    /// The widest level this processor can run.
    pub fn detect() -> Self {
        static WIDEST: OnceLock<SimdLevel> = OnceLock::new();
        *WIDEST.get_or_init(|| Self::ALL.into_iter().find(|level| level.is_available()).unwrap_or(Self::Portable))
    }

    /// The name that the command line takes.
    pub fn name(self) -> &'static str {
        match self {
            Self::Avx512 => "avx512",
            Self::Avx2 => "avx2",
            Self::Portable => "portable",
        }
    }
}

/// A vector of 32-bit floats.
pub(crate) trait Float:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self>
{
}
impl<T> Float for T where T: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self> {}

/// A vector of 32-bit integers.
pub(crate) trait Int:
    Copy
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + BitAnd<Output = Self>
    + BitOr<Output = Self>
    + BitXor<Output = Self>
{
}
impl<T> Int for T where
    T: Copy
        + Add<Output = Self>
        + Sub<Output = Self>
        + Mul<Output = Self>
        + BitAnd<Output = Self>
        + BitOr<Output = Self>
        + BitXor<Output = Self>
{
}

/// One truth per lane.
pub(crate) trait Mask: Copy + BitAnd<Output = Self> + BitOr<Output = Self> + Not<Output = Self> {}
impl<T> Mask for T where T: Copy + BitAnd<Output = Self> + BitOr<Output = Self> + Not<Output = Self> {}

/// An instruction set: a token whose existence proves that the processor has it.
pub(crate) trait Simd: Copy + Send + Sync + 'static {
    /// Lanes of every vector.
    const LANES: usize;
    /// Floats.
    type F: Float;
    /// Integers.
    type I: Int;
    /// Truths.
    type M: Mask;

    /// One value in every lane.
    fn splat(self, value: f32) -> Self::F;
    /// The first `LANES` of a slice; panics on a shorter one.
    fn load(self, from: &[f32]) -> Self::F;
    /// Into the first `LANES` of a slice; panics on a shorter one.
    fn store(self, value: Self::F, to: &mut [f32]);
    /// The first values of `from`, one after the other, in the lanes of `mask`; `old` elsewhere. Panics where `from` is
    /// shorter than the mask has lanes.
    fn expand(self, from: &[f32], mask: Self::M, old: Self::F) -> Self::F;
    /// The lanes of `mask` one after the other to the front of `to`; panics where that is shorter.
    fn compress(self, value: Self::F, mask: Self::M, to: &mut [f32]);
    /// One integer in every lane.
    fn splat_int(self, value: i32) -> Self::I;
    /// Into the first `LANES` of a slice of integers.
    fn store_int(self, value: Self::I, to: &mut [i32]);

    /// `a * b + c`, in one rounding where the instruction set has it.
    fn fma(self, a: Self::F, b: Self::F, c: Self::F) -> Self::F;
    /// `a * b + c` in one rounding on every instruction set: for positions along a ray, where two roundings show.
    fn fma_exact(self, a: Self::F, b: Self::F, c: Self::F) -> Self::F;
    /// Lesser of two; the second where either is not a number.
    fn min(self, a: Self::F, b: Self::F) -> Self::F;
    /// Greater of two; the second where either is not a number.
    fn max(self, a: Self::F, b: Self::F) -> Self::F;
    /// Magnitude.
    fn abs(self, a: Self::F) -> Self::F;
    /// Square root, correctly rounded; not a number for what has none.
    fn sqrt(self, a: Self::F) -> Self::F;
    /// `a` with its sign turned where `sign` is negative (by the sign bit).
    fn flip_by_sign(self, a: Self::F, sign: Self::F) -> Self::F;
    /// `a < b`.
    fn lt(self, a: Self::F, b: Self::F) -> Self::M;
    /// `a <= b`.
    fn le(self, a: Self::F, b: Self::F) -> Self::M;
    /// `yes` where the mask is set, else `no`.
    fn select(self, mask: Self::M, yes: Self::F, no: Self::F) -> Self::F;
    /// Nearest integer at or below; the value must fit.
    fn floor_int(self, a: Self::F) -> Self::I;
    /// Integers as floats.
    fn to_float(self, a: Self::I) -> Self::F;

    /// `a << count` per lane, counts 0..32.
    fn shift_left(self, a: Self::I, count: Self::I) -> Self::I;
    /// `a >> count` per lane, arithmetic, counts 0..32.
    fn shift_right(self, a: Self::I, count: Self::I) -> Self::I;
    /// `a` without the bits of `b`.
    fn and_not(self, a: Self::I, b: Self::I) -> Self::I;
    /// Lesser of two.
    fn min_int(self, a: Self::I, b: Self::I) -> Self::I;
    /// Greater of two.
    fn max_int(self, a: Self::I, b: Self::I) -> Self::I;
    /// `a == b`.
    fn eq_int(self, a: Self::I, b: Self::I) -> Self::M;
    /// `a > b`.
    fn gt_int(self, a: Self::I, b: Self::I) -> Self::M;
    /// `yes` where the mask is set, else `no`.
    fn select_int(self, mask: Self::M, yes: Self::I, no: Self::I) -> Self::I;

    /// Bit `i` of the result is lane `i`.
    fn bits(self, mask: Self::M) -> u32;
    /// Lane `i` from bit `i`.
    // `self` is the instruction set, not the value made: every method of this trait takes it.
    #[allow(clippy::wrong_self_convention)]
    fn from_bits(self, bits: u32) -> Self::M;

    /// `table[index]` per lane, for indices 0..16.
    fn lookup(self, table: &[i32; 16], index: Self::I) -> Self::I;
    /// `data[index]` per lane of `mask` (0 elsewhere); an index past the end reads the last element.
    fn gather(self, data: &[u32], index: Self::I, mask: Self::M) -> Self::I;
    /// A K x K window of `data` per lane: element `[j][i]` is `data[index + j * stride + i]`; windows past the end are
    /// moved back to the last whole one. `data` must hold at least one whole window.
    fn gather_window<const K: usize>(
        self,
        data: &[f32],
        stride: usize,
        index: Self::I,
        mask: Self::M,
    ) -> [[Self::F; K]; K];

    /// Asks for the cache lines of something that is soon to be read; changes nothing.
    #[inline(always)]
    fn prefetch<T>(self, _soon: &T) {}

    /// Whether no lane is set.
    #[inline(always)]
    fn none(self, mask: Self::M) -> bool {
        self.bits(mask) == 0
    }
    /// Whether any lane is set.
    #[inline(always)]
    fn any(self, mask: Self::M) -> bool {
        self.bits(mask) != 0
    }
}

/// Work that is generic over the instruction set.
pub(crate) trait Kernel {
    /// What it returns.
    type Output;
    /// Does it; must be `#[inline(always)]`.
    fn run<S: Simd>(self, simd: S) -> Self::Output;
}

/// Runs a kernel with an instruction set; a level that the processor lacks runs as portable.
pub(crate) fn dispatch<K: Kernel>(level: SimdLevel, kernel: K) -> K::Output {
    match level {
        #[cfg(target_arch = "x86_64")]
        SimdLevel::Avx512 if available(SimdLevel::Avx512) => {
            // SAFETY: the guard has asked the processor for every feature that the entry point enables.
            unsafe { avx512::enter(kernel) }
        }
        #[cfg(target_arch = "x86_64")]
        SimdLevel::Avx2 if available(SimdLevel::Avx2) => {
            // SAFETY: the guard has asked the processor for every feature that the entry point enables.
            unsafe { avx2::enter(kernel) }
        }
        _ => portable::enter(kernel),
    }
}

/// Runs a kernel a lane at a time: for work that comes one by one, where wide lanes would idle.
pub(crate) fn dispatch_single<K: Kernel>(level: SimdLevel, kernel: K) -> K::Output {
    match level {
        #[cfg(target_arch = "x86_64")]
        SimdLevel::Avx512 | SimdLevel::Avx2 if available(SimdLevel::Avx2) => {
            // SAFETY: the guard has asked the processor for every feature that the entry point enables.
            unsafe { single::enter_fused(kernel) }
        }
        _ => single::enter(kernel),
    }
}

/// Runs a kernel with plain arithmetic, whatever the processor has: for one whose lanes are not its work.
pub(crate) fn portable<K: Kernel>(kernel: K) -> K::Output {
    portable::enter(kernel)
}

/// [`SimdLevel::is_available`], remembered: `dispatch` runs once per packet.
#[cfg(target_arch = "x86_64")]
#[inline]
fn available(level: SimdLevel) -> bool {
    match SimdLevel::detect() {
        SimdLevel::Avx512 => true,
        // A processor with AVX-512 but no AVX2 does not exist.
        SimdLevel::Avx2 => level != SimdLevel::Avx512,
        SimdLevel::Portable => false,
    }
}

#[cfg(test)]
mod tests;
