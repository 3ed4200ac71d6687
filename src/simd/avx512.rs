//! Sixteen lanes of AVX-512.

use std::arch::x86_64::*;
use std::ops::{Add, BitAnd, BitOr, BitXor, Div, Mul, Not, Sub};

use super::{Kernel, Simd};

/// Proof that the processor has AVX-512 F, DQ, BW and VL: made only by [`enter`].
#[derive(Clone, Copy)]
pub(super) struct Avx512(());

/// Runs a kernel with AVX-512.
///
/// # Safety
/// The processor must have every feature named here.
#[target_feature(enable = "avx512f,avx512dq,avx512bw,avx512vl,avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
pub(super) unsafe fn enter<K: Kernel>(kernel: K) -> K::Output {
    kernel.run(Avx512(()))
}

/// Sixteen floats.
#[derive(Clone, Copy)]
pub(super) struct F(__m512);
/// Sixteen integers.
#[derive(Clone, Copy)]
pub(super) struct I(__m512i);
/// Sixteen truths.
#[derive(Clone, Copy)]
pub(super) struct M(__mmask16);

/// A value of these types proves that the processor has AVX-512, so their operators may use it.
macro_rules! operator {
    ($trait:ident, $method:ident, $type:ident, $intrinsic:ident) => {
        impl $trait for $type {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                // SAFETY: a value of this type can only come from a token, and a token only from `enter`.
                unsafe { Self($intrinsic(self.0, other.0)) }
            }
        }
    };
}
operator!(Add, add, F, _mm512_add_ps);
operator!(Sub, sub, F, _mm512_sub_ps);
operator!(Mul, mul, F, _mm512_mul_ps);
operator!(Div, div, F, _mm512_div_ps);
operator!(Add, add, I, _mm512_add_epi32);
operator!(Sub, sub, I, _mm512_sub_epi32);
operator!(Mul, mul, I, _mm512_mullo_epi32);
operator!(BitAnd, bitand, I, _mm512_and_si512);
operator!(BitOr, bitor, I, _mm512_or_si512);
operator!(BitXor, bitxor, I, _mm512_xor_si512);

impl BitAnd for M {
    type Output = Self;
    #[inline(always)]
    fn bitand(self, other: Self) -> Self {
        Self(self.0 & other.0)
    }
}
impl BitOr for M {
    type Output = Self;
    #[inline(always)]
    fn bitor(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}
impl Not for M {
    type Output = Self;
    #[inline(always)]
    fn not(self) -> Self {
        Self(!self.0)
    }
}

/// One intrinsic under the token's promise.
macro_rules! with_token {
    ($expression:expr) => {
        // SAFETY: the token exists, so the processor has these instructions; loads and stores are checked beside.
        unsafe { $expression }
    };
}

impl Simd for Avx512 {
    const LANES: usize = 16;
    type F = F;
    type I = I;
    type M = M;

    #[inline(always)]
    fn splat(self, value: f32) -> F {
        with_token!(F(_mm512_set1_ps(value)))
    }
    #[inline(always)]
    fn load(self, from: &[f32]) -> F {
        let from = &from[..16];
        with_token!(F(_mm512_loadu_ps(from.as_ptr())))
    }
    #[inline(always)]
    fn store(self, value: F, to: &mut [f32]) {
        let to = &mut to[..16];
        with_token!(_mm512_storeu_ps(to.as_mut_ptr(), value.0))
    }
    #[inline(always)]
    fn expand(self, from: &[f32], mask: M, old: F) -> F {
        assert!(from.len() >= mask.0.count_ones() as usize);
        with_token!(F(_mm512_mask_expandloadu_ps(old.0, mask.0, from.as_ptr())))
    }
    #[inline(always)]
    fn compress(self, value: F, mask: M, to: &mut [f32]) {
        let count = mask.0.count_ones();
        assert!(to.len() >= count as usize);
        let front = ((1u32 << count) - 1) as __mmask16;
        // By way of a register: compressing straight to memory is slow on some processors.
        with_token!(_mm512_mask_storeu_ps(to.as_mut_ptr(), front, _mm512_maskz_compress_ps(mask.0, value.0)))
    }
    #[inline(always)]
    fn splat_int(self, value: i32) -> I {
        with_token!(I(_mm512_set1_epi32(value)))
    }
    #[inline(always)]
    fn store_int(self, value: I, to: &mut [i32]) {
        let to = &mut to[..16];
        with_token!(_mm512_storeu_si512(to.as_mut_ptr().cast(), value.0))
    }
    #[inline(always)]
    fn fma(self, a: F, b: F, c: F) -> F {
        with_token!(F(_mm512_fmadd_ps(a.0, b.0, c.0)))
    }
    #[inline(always)]
    fn fma_exact(self, a: F, b: F, c: F) -> F {
        self.fma(a, b, c)
    }
    #[inline(always)]
    fn min(self, a: F, b: F) -> F {
        with_token!(F(_mm512_min_ps(a.0, b.0)))
    }
    #[inline(always)]
    fn max(self, a: F, b: F) -> F {
        with_token!(F(_mm512_max_ps(a.0, b.0)))
    }
    #[inline(always)]
    fn abs(self, a: F) -> F {
        with_token!(F(_mm512_abs_ps(a.0)))
    }
    #[inline(always)]
    fn prefetch<T>(self, soon: &T) {
        let start = std::ptr::from_ref(soon).cast::<i8>();
        for line in 0..size_of::<T>().div_ceil(64) {
            // SAFETY: a prefetch reads nothing, whatever the address; the token proves that there is the instruction.
            unsafe { _mm_prefetch::<_MM_HINT_T0>(start.wrapping_add(64 * line)) };
        }
    }
    #[inline(always)]
    fn sqrt(self, a: F) -> F {
        with_token!(F(_mm512_sqrt_ps(a.0)))
    }
    #[inline(always)]
    fn flip_by_sign(self, a: F, sign: F) -> F {
        with_token!(F(_mm512_xor_ps(a.0, _mm512_and_ps(sign.0, _mm512_set1_ps(-0.0)))))
    }
    #[inline(always)]
    fn lt(self, a: F, b: F) -> M {
        with_token!(M(_mm512_cmp_ps_mask::<_CMP_LT_OQ>(a.0, b.0)))
    }
    #[inline(always)]
    fn le(self, a: F, b: F) -> M {
        with_token!(M(_mm512_cmp_ps_mask::<_CMP_LE_OQ>(a.0, b.0)))
    }
    #[inline(always)]
    fn select(self, mask: M, yes: F, no: F) -> F {
        with_token!(F(_mm512_mask_blend_ps(mask.0, no.0, yes.0)))
    }
    #[inline(always)]
    fn floor_int(self, a: F) -> I {
        with_token!(I(_mm512_cvt_roundps_epi32::<{ _MM_FROUND_TO_NEG_INF | _MM_FROUND_NO_EXC }>(a.0)))
    }
    #[inline(always)]
    fn to_float(self, a: I) -> F {
        with_token!(F(_mm512_cvtepi32_ps(a.0)))
    }
    #[inline(always)]
    fn shift_left(self, a: I, count: I) -> I {
        with_token!(I(_mm512_sllv_epi32(a.0, count.0)))
    }
    #[inline(always)]
    fn shift_right(self, a: I, count: I) -> I {
        with_token!(I(_mm512_srav_epi32(a.0, count.0)))
    }
    #[inline(always)]
    fn and_not(self, a: I, b: I) -> I {
        with_token!(I(_mm512_andnot_si512(b.0, a.0)))
    }
    #[inline(always)]
    fn min_int(self, a: I, b: I) -> I {
        with_token!(I(_mm512_min_epi32(a.0, b.0)))
    }
    #[inline(always)]
    fn max_int(self, a: I, b: I) -> I {
        with_token!(I(_mm512_max_epi32(a.0, b.0)))
    }
    #[inline(always)]
    fn eq_int(self, a: I, b: I) -> M {
        with_token!(M(_mm512_cmpeq_epi32_mask(a.0, b.0)))
    }
    #[inline(always)]
    fn gt_int(self, a: I, b: I) -> M {
        with_token!(M(_mm512_cmpgt_epi32_mask(a.0, b.0)))
    }
    #[inline(always)]
    fn select_int(self, mask: M, yes: I, no: I) -> I {
        with_token!(I(_mm512_mask_blend_epi32(mask.0, no.0, yes.0)))
    }
    #[inline(always)]
    fn bits(self, mask: M) -> u32 {
        u32::from(mask.0)
    }
    #[inline(always)]
    fn from_bits(self, bits: u32) -> M {
        M(bits as u16)
    }
    #[inline(always)]
    fn lookup(self, table: &[i32; 16], index: I) -> I {
        with_token!(I(_mm512_permutexvar_epi32(index.0, _mm512_loadu_si512(table.as_ptr().cast()))))
    }
    #[inline(always)]
    fn gather(self, data: &[u32], index: I, mask: M) -> I {
        assert!(!data.is_empty() && data.len() <= i32::MAX as usize);
        // SAFETY: the unsigned minimum keeps every lane's index inside `data`, which is not empty.
        unsafe {
            let index = _mm512_min_epu32(index.0, _mm512_set1_epi32((data.len() - 1) as i32));
            I(_mm512_mask_i32gather_epi32::<4>(_mm512_setzero_si512(), mask.0, index, data.as_ptr().cast()))
        }
    }
    #[inline(always)]
    fn gather_window<const K: usize>(self, data: &[f32], stride: usize, index: I, mask: M) -> [[F; K]; K] {
        let reach = (K - 1) * stride + K;
        assert!(data.len() >= reach && data.len() <= i32::MAX as usize);
        // SAFETY: the unsigned minimum keeps index + reach within `data`; every offset added below is under `reach`.
        unsafe {
            let index = _mm512_min_epu32(index.0, _mm512_set1_epi32((data.len() - reach) as i32));
            let mut window = [[F(_mm512_setzero_ps()); K]; K];
            for j in 0..K {
                for i in 0..K {
                    let start = data.as_ptr().add(j * stride + i);
                    window[j][i] = F(_mm512_mask_i32gather_ps::<4>(_mm512_setzero_ps(), mask.0, index, start));
                }
            }
            window
        }
    }
}
