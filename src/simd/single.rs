//! One lane: plain scalar code, for rays that come alone.

use std::ops::{Add, BitAnd, BitOr, BitXor, Div, Mul, Not, Sub};

use super::{Kernel, Simd};

/// The token. `FUSED`: the code around it may use fused multiply-add.
#[derive(Clone, Copy)]
pub(super) struct Single<const FUSED: bool>(());

/// Runs a kernel a lane at a time, with fused multiply-add.
///
/// # Safety
/// The processor must have every feature named here.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
pub(super) unsafe fn enter_fused<K: Kernel>(kernel: K) -> K::Output {
    kernel.run(Single::<true>(()))
}

/// Runs a kernel a lane at a time, with plain arithmetic.
pub(super) fn enter<K: Kernel>(kernel: K) -> K::Output {
    kernel.run(Single::<false>(()))
}

/// A float.
#[derive(Clone, Copy)]
pub(super) struct F(f32);
/// An integer.
#[derive(Clone, Copy)]
pub(super) struct I(i32);
/// A truth.
#[derive(Clone, Copy)]
pub(super) struct M(bool);

macro_rules! operator {
    ($trait:ident, $method:ident, $type:ident, $a:ident, $b:ident => $value:expr) => {
        impl $trait for $type {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                let ($a, $b) = (self.0, other.0);
                Self($value)
            }
        }
    };
}
operator!(Add, add, F, a, b => a + b);
operator!(Sub, sub, F, a, b => a - b);
operator!(Mul, mul, F, a, b => a * b);
operator!(Div, div, F, a, b => a / b);
operator!(Add, add, I, a, b => a.wrapping_add(b));
operator!(Sub, sub, I, a, b => a.wrapping_sub(b));
operator!(Mul, mul, I, a, b => a.wrapping_mul(b));
operator!(BitAnd, bitand, I, a, b => a & b);
operator!(BitOr, bitor, I, a, b => a | b);
operator!(BitXor, bitxor, I, a, b => a ^ b);
operator!(BitAnd, bitand, M, a, b => a & b);
operator!(BitOr, bitor, M, a, b => a | b);

impl Not for M {
    type Output = Self;
    #[inline(always)]
    fn not(self) -> Self {
        Self(!self.0)
    }
}

impl<const FUSED: bool> Simd for Single<FUSED> {
    const LANES: usize = 1;
    type F = F;
    type I = I;
    type M = M;

    #[inline(always)]
    fn splat(self, value: f32) -> F {
        F(value)
    }
    #[inline(always)]
    fn load(self, from: &[f32]) -> F {
        F(from[0])
    }
    #[inline(always)]
    fn store(self, value: F, to: &mut [f32]) {
        to[0] = value.0;
    }
    #[inline(always)]
    fn expand(self, from: &[f32], mask: M, old: F) -> F {
        if mask.0 { F(from[0]) } else { old }
    }
    #[inline(always)]
    fn compress(self, value: F, mask: M, to: &mut [f32]) {
        if mask.0 {
            to[0] = value.0;
        }
    }
    #[inline(always)]
    fn splat_int(self, value: i32) -> I {
        I(value)
    }
    #[inline(always)]
    fn store_int(self, value: I, to: &mut [i32]) {
        to[0] = value.0;
    }
    #[inline(always)]
    fn fma(self, a: F, b: F, c: F) -> F {
        if FUSED { F(a.0.mul_add(b.0, c.0)) } else { F(a.0 * b.0 + c.0) }
    }
    #[inline(always)]
    fn fma_exact(self, a: F, b: F, c: F) -> F {
        if FUSED {
            return F(a.0.mul_add(b.0, c.0));
        }
        // The product of two singles is exact in double precision.
        F((f64::from(a.0) * f64::from(b.0) + f64::from(c.0)) as f32)
    }
    #[inline(always)]
    fn min(self, a: F, b: F) -> F {
        if a.0 < b.0 { a } else { b }
    }
    #[inline(always)]
    fn max(self, a: F, b: F) -> F {
        if a.0 > b.0 { a } else { b }
    }
    #[inline(always)]
    fn abs(self, a: F) -> F {
        F(a.0.abs())
    }
    #[inline(always)]
    fn sqrt(self, a: F) -> F {
        F(a.0.sqrt())
    }
    #[inline(always)]
    fn flip_by_sign(self, a: F, sign: F) -> F {
        F(f32::from_bits(a.0.to_bits() ^ (sign.0.to_bits() & 0x8000_0000)))
    }
    #[inline(always)]
    fn lt(self, a: F, b: F) -> M {
        M(a.0 < b.0)
    }
    #[inline(always)]
    fn le(self, a: F, b: F) -> M {
        M(a.0 <= b.0)
    }
    #[inline(always)]
    fn select(self, mask: M, yes: F, no: F) -> F {
        if mask.0 { yes } else { no }
    }
    #[inline(always)]
    fn floor_int(self, a: F) -> I {
        let toward_zero = a.0 as i32;
        I(toward_zero.wrapping_sub(i32::from(toward_zero as f32 > a.0)))
    }
    #[inline(always)]
    fn to_float(self, a: I) -> F {
        F(a.0 as f32)
    }
    #[inline(always)]
    fn shift_left(self, a: I, count: I) -> I {
        I(a.0.wrapping_shl(count.0 as u32))
    }
    #[inline(always)]
    fn shift_right(self, a: I, count: I) -> I {
        I(a.0.wrapping_shr(count.0 as u32))
    }
    #[inline(always)]
    fn and_not(self, a: I, b: I) -> I {
        I(a.0 & !b.0)
    }
    #[inline(always)]
    fn min_int(self, a: I, b: I) -> I {
        I(a.0.min(b.0))
    }
    #[inline(always)]
    fn max_int(self, a: I, b: I) -> I {
        I(a.0.max(b.0))
    }
    #[inline(always)]
    fn eq_int(self, a: I, b: I) -> M {
        M(a.0 == b.0)
    }
    #[inline(always)]
    fn gt_int(self, a: I, b: I) -> M {
        M(a.0 > b.0)
    }
    #[inline(always)]
    fn select_int(self, mask: M, yes: I, no: I) -> I {
        if mask.0 { yes } else { no }
    }
    #[inline(always)]
    fn bits(self, mask: M) -> u32 {
        u32::from(mask.0)
    }
    #[inline(always)]
    fn from_bits(self, bits: u32) -> M {
        M(bits & 1 == 1)
    }
    #[inline(always)]
    fn lookup(self, table: &[i32; 16], index: I) -> I {
        I(table[(index.0 & 15) as usize])
    }
    #[inline(always)]
    fn gather(self, data: &[u32], index: I, mask: M) -> I {
        if mask.0 { I(data[(index.0 as u32 as usize).min(data.len() - 1)] as i32) } else { I(0) }
    }
    #[inline(always)]
    fn gather_window<const K: usize>(self, data: &[f32], stride: usize, index: I, _mask: M) -> [[F; K]; K] {
        let reach = (K - 1) * stride + K;
        let start = (index.0 as u32 as usize).min(data.len() - reach);
        let cells = &data[start..start + reach];
        let mut window = [[F(0.0); K]; K];
        for j in 0..K {
            for i in 0..K {
                window[j][i] = F(cells[j * stride + i]);
            }
        }
        window
    }
}
