//! Eight lanes of AVX2 with FMA.

use std::arch::x86_64::*;
use std::ops::{Add, BitAnd, BitOr, BitXor, Div, Mul, Not, Sub};

use super::{Kernel, Simd};

/// Proof that the processor has AVX2 and FMA: made only by [`enter`].
#[derive(Clone, Copy)]
pub(super) struct Avx2(());

/// Runs a kernel with AVX2.
///
/// # Safety
/// The processor must have every feature named here.
#[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
pub(super) unsafe fn enter<K: Kernel>(kernel: K) -> K::Output {
    kernel.run(Avx2(()))
}

/// Eight floats.
#[derive(Clone, Copy)]
pub(super) struct F(__m256);
/// Eight integers.
#[derive(Clone, Copy)]
pub(super) struct I(__m256i);
/// Eight truths: all bits of a lane, or none.
#[derive(Clone, Copy)]
pub(super) struct M(__m256);

/// A value of these types proves that the processor has AVX2, so their operators may use it.
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
operator!(Add, add, F, _mm256_add_ps);
operator!(Sub, sub, F, _mm256_sub_ps);
operator!(Mul, mul, F, _mm256_mul_ps);
operator!(Div, div, F, _mm256_div_ps);
operator!(Add, add, I, _mm256_add_epi32);
operator!(Sub, sub, I, _mm256_sub_epi32);
operator!(Mul, mul, I, _mm256_mullo_epi32);
operator!(BitAnd, bitand, I, _mm256_and_si256);
operator!(BitOr, bitor, I, _mm256_or_si256);
operator!(BitXor, bitxor, I, _mm256_xor_si256);
operator!(BitAnd, bitand, M, _mm256_and_ps);
operator!(BitOr, bitor, M, _mm256_or_ps);

impl Not for M {
    type Output = Self;
    #[inline(always)]
    fn not(self) -> Self {
        // SAFETY: a value of this type can only come from a token, and a token only from `enter`.
        unsafe { Self(_mm256_xor_ps(self.0, _mm256_castsi256_ps(_mm256_set1_epi32(-1)))) }
    }
}

/// One intrinsic under the token's promise.
macro_rules! with_token {
    ($expression:expr) => {
        // SAFETY: the token exists, so the processor has these instructions; loads and stores are checked beside.
        unsafe { $expression }
    };
}

impl Simd for Avx2 {
    const LANES: usize = 8;
    type F = F;
    type I = I;
    type M = M;

    #[inline(always)]
    fn splat(self, value: f32) -> F {
        with_token!(F(_mm256_set1_ps(value)))
    }
    #[inline(always)]
    fn load(self, from: &[f32]) -> F {
        let from = &from[..8];
        with_token!(F(_mm256_loadu_ps(from.as_ptr())))
    }
    #[inline(always)]
    fn store(self, value: F, to: &mut [f32]) {
        let to = &mut to[..8];
        with_token!(_mm256_storeu_ps(to.as_mut_ptr(), value.0))
    }
    #[inline(always)]
    fn expand(self, from: &[f32], mask: M, old: F) -> F {
        let mut lanes = [0.0; 8];
        self.store(old, &mut lanes);
        let bits = self.bits(mask);
        let mut next = 0;
        for lane in 0..8 {
            if bits >> lane & 1 == 1 {
                lanes[lane] = from[next];
                next += 1;
            }
        }
        self.load(&lanes)
    }
    #[inline(always)]
    fn compress(self, value: F, mask: M, to: &mut [f32]) {
        let mut lanes = [0.0; 8];
        self.store(value, &mut lanes);
        let bits = self.bits(mask);
        let mut next = 0;
        for lane in 0..8 {
            if bits >> lane & 1 == 1 {
                to[next] = lanes[lane];
                next += 1;
            }
        }
    }
    #[inline(always)]
    fn splat_int(self, value: i32) -> I {
        with_token!(I(_mm256_set1_epi32(value)))
    }
    #[inline(always)]
    fn store_int(self, value: I, to: &mut [i32]) {
        let to = &mut to[..8];
        with_token!(_mm256_storeu_si256(to.as_mut_ptr().cast(), value.0))
    }
    #[inline(always)]
    fn fma(self, a: F, b: F, c: F) -> F {
        with_token!(F(_mm256_fmadd_ps(a.0, b.0, c.0)))
    }
    #[inline(always)]
    fn fma_exact(self, a: F, b: F, c: F) -> F {
        self.fma(a, b, c)
    }
    #[inline(always)]
    fn min(self, a: F, b: F) -> F {
        with_token!(F(_mm256_min_ps(a.0, b.0)))
    }
    #[inline(always)]
    fn max(self, a: F, b: F) -> F {
        with_token!(F(_mm256_max_ps(a.0, b.0)))
    }
    #[inline(always)]
    fn abs(self, a: F) -> F {
        with_token!(F(_mm256_andnot_ps(_mm256_set1_ps(-0.0), a.0)))
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
        with_token!(F(_mm256_sqrt_ps(a.0)))
    }
    #[inline(always)]
    fn flip_by_sign(self, a: F, sign: F) -> F {
        with_token!(F(_mm256_xor_ps(a.0, _mm256_and_ps(sign.0, _mm256_set1_ps(-0.0)))))
    }
    #[inline(always)]
    fn lt(self, a: F, b: F) -> M {
        with_token!(M(_mm256_cmp_ps::<_CMP_LT_OQ>(a.0, b.0)))
    }
    #[inline(always)]
    fn le(self, a: F, b: F) -> M {
        with_token!(M(_mm256_cmp_ps::<_CMP_LE_OQ>(a.0, b.0)))
    }
    #[inline(always)]
    fn select(self, mask: M, yes: F, no: F) -> F {
        with_token!(F(_mm256_blendv_ps(no.0, yes.0, mask.0)))
    }
    #[inline(always)]
    fn floor_int(self, a: F) -> I {
        with_token!(I(_mm256_cvttps_epi32(_mm256_floor_ps(a.0))))
    }
    #[inline(always)]
    fn to_float(self, a: I) -> F {
        with_token!(F(_mm256_cvtepi32_ps(a.0)))
    }
    #[inline(always)]
    fn shift_left(self, a: I, count: I) -> I {
        with_token!(I(_mm256_sllv_epi32(a.0, count.0)))
    }
    #[inline(always)]
    fn shift_right(self, a: I, count: I) -> I {
        with_token!(I(_mm256_srav_epi32(a.0, count.0)))
    }
    #[inline(always)]
    fn and_not(self, a: I, b: I) -> I {
        with_token!(I(_mm256_andnot_si256(b.0, a.0)))
    }
    #[inline(always)]
    fn min_int(self, a: I, b: I) -> I {
        with_token!(I(_mm256_min_epi32(a.0, b.0)))
    }
    #[inline(always)]
    fn max_int(self, a: I, b: I) -> I {
        with_token!(I(_mm256_max_epi32(a.0, b.0)))
    }
    #[inline(always)]
    fn eq_int(self, a: I, b: I) -> M {
        with_token!(M(_mm256_castsi256_ps(_mm256_cmpeq_epi32(a.0, b.0))))
    }
    #[inline(always)]
    fn gt_int(self, a: I, b: I) -> M {
        with_token!(M(_mm256_castsi256_ps(_mm256_cmpgt_epi32(a.0, b.0))))
    }
    #[inline(always)]
    fn select_int(self, mask: M, yes: I, no: I) -> I {
        with_token!(I(_mm256_blendv_epi8(no.0, yes.0, _mm256_castps_si256(mask.0))))
    }
    #[inline(always)]
    fn bits(self, mask: M) -> u32 {
        with_token!(_mm256_movemask_ps(mask.0) as u32)
    }
    #[inline(always)]
    fn from_bits(self, bits: u32) -> M {
        with_token!({
            let lane = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
            let here = _mm256_and_si256(_mm256_set1_epi32(bits as i32), lane);
            M(_mm256_castsi256_ps(_mm256_cmpeq_epi32(here, lane)))
        })
    }
    #[inline(always)]
    fn lookup(self, table: &[i32; 16], index: I) -> I {
        // SAFETY: the mask keeps every index within the table's sixteen entries.
        unsafe {
            let index = _mm256_and_si256(index.0, _mm256_set1_epi32(15));
            I(_mm256_i32gather_epi32::<4>(table.as_ptr(), index))
        }
    }
    #[inline(always)]
    fn gather(self, data: &[u32], index: I, mask: M) -> I {
        assert!(!data.is_empty() && data.len() <= i32::MAX as usize);
        // SAFETY: the unsigned minimum keeps every lane's index inside `data`, which is not empty.
        unsafe {
            let index = _mm256_min_epu32(index.0, _mm256_set1_epi32((data.len() - 1) as i32));
            let mask = _mm256_castps_si256(mask.0);
            I(_mm256_mask_i32gather_epi32::<4>(_mm256_setzero_si256(), data.as_ptr().cast(), index, mask))
        }
    }
    #[inline(always)]
    fn gather_window<const K: usize>(self, data: &[f32], stride: usize, index: I, mask: M) -> [[F; K]; K] {
        let reach = (K - 1) * stride + K;
        assert!(data.len() >= reach && data.len() <= i32::MAX as usize);
        // SAFETY: the unsigned minimum keeps index + reach within `data`; every offset added below is under `reach`.
        unsafe {
            let index = _mm256_min_epu32(index.0, _mm256_set1_epi32((data.len() - reach) as i32));
            let mut window = [[F(_mm256_setzero_ps()); K]; K];
            for j in 0..K {
                for i in 0..K {
                    let start = data.as_ptr().add(j * stride + i);
                    window[j][i] = F(_mm256_mask_i32gather_ps::<4>(_mm256_setzero_ps(), start, index, mask.0));
                }
            }
            window
        }
    }
}
