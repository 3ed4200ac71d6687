//! Four lanes of plain arithmetic: what every processor has, in a shape that compilers turn into vectors.

use std::array::from_fn;
use std::ops::{Add, BitAnd, BitOr, BitXor, Div, Mul, Not, Sub};

use super::{Kernel, Simd};

/// Lanes: as many as the baseline of x86-64 and AArch64 hold in one register.
const N: usize = 4;

/// The token; no promise is needed.
#[derive(Clone, Copy)]
pub(super) struct Portable;

/// Runs a kernel with plain arithmetic.
pub(super) fn enter<K: Kernel>(kernel: K) -> K::Output {
    kernel.run(Portable)
}

/// Floats.
#[derive(Clone, Copy)]
pub(super) struct F([f32; N]);
/// Integers.
#[derive(Clone, Copy)]
pub(super) struct I([i32; N]);
/// Truths: all bits of a lane, or none.
#[derive(Clone, Copy)]
pub(super) struct M([u32; N]);

macro_rules! operator {
    ($trait:ident, $method:ident, $type:ident, $operation:expr) => {
        impl $trait for $type {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                let operation = $operation;
                Self(from_fn(|lane| operation(self.0[lane], other.0[lane])))
            }
        }
    };
}
operator!(Add, add, F, |a: f32, b: f32| a + b);
operator!(Sub, sub, F, |a: f32, b: f32| a - b);
operator!(Mul, mul, F, |a: f32, b: f32| a * b);
operator!(Div, div, F, |a: f32, b: f32| a / b);
operator!(Add, add, I, i32::wrapping_add);
operator!(Sub, sub, I, i32::wrapping_sub);
operator!(Mul, mul, I, i32::wrapping_mul);
operator!(BitAnd, bitand, I, |a: i32, b: i32| a & b);
operator!(BitOr, bitor, I, |a: i32, b: i32| a | b);
operator!(BitXor, bitxor, I, |a: i32, b: i32| a ^ b);
operator!(BitAnd, bitand, M, |a: u32, b: u32| a & b);
operator!(BitOr, bitor, M, |a: u32, b: u32| a | b);

impl Not for M {
    type Output = Self;
    #[inline(always)]
    fn not(self) -> Self {
        Self(self.0.map(|lane| !lane))
    }
}

#[inline(always)]
fn truth(value: bool) -> u32 {
    if value { u32::MAX } else { 0 }
}

impl Simd for Portable {
    const LANES: usize = N;
    type F = F;
    type I = I;
    type M = M;

    #[inline(always)]
    fn splat(self, value: f32) -> F {
        F([value; N])
    }
    #[inline(always)]
    fn load(self, from: &[f32]) -> F {
        let from = &from[..N];
        F(from_fn(|lane| from[lane]))
    }
    #[inline(always)]
    fn store(self, value: F, to: &mut [f32]) {
        to[..N].copy_from_slice(&value.0);
    }
    #[inline(always)]
    fn expand(self, from: &[f32], mask: M, old: F) -> F {
        let mut lanes = [0.0; N];
        self.store(old, &mut lanes);
        let bits = self.bits(mask);
        let mut next = 0;
        for lane in 0..N {
            if bits >> lane & 1 == 1 {
                lanes[lane] = from[next];
                next += 1;
            }
        }
        self.load(&lanes)
    }
    #[inline(always)]
    fn compress(self, value: F, mask: M, to: &mut [f32]) {
        let mut lanes = [0.0; N];
        self.store(value, &mut lanes);
        let bits = self.bits(mask);
        let mut next = 0;
        for lane in 0..N {
            if bits >> lane & 1 == 1 {
                to[next] = lanes[lane];
                next += 1;
            }
        }
    }
    #[inline(always)]
    fn splat_int(self, value: i32) -> I {
        I([value; N])
    }
    #[inline(always)]
    fn store_int(self, value: I, to: &mut [i32]) {
        to[..N].copy_from_slice(&value.0);
    }
    #[inline(always)]
    fn fma(self, a: F, b: F, c: F) -> F {
        a * b + c
    }
    #[inline(always)]
    fn fma_exact(self, a: F, b: F, c: F) -> F {
        // The product of two singles is exact in double precision.
        F(from_fn(|lane| (f64::from(a.0[lane]) * f64::from(b.0[lane]) + f64::from(c.0[lane])) as f32))
    }
    #[inline(always)]
    fn min(self, a: F, b: F) -> F {
        F(from_fn(|lane| if a.0[lane] < b.0[lane] { a.0[lane] } else { b.0[lane] }))
    }
    #[inline(always)]
    fn max(self, a: F, b: F) -> F {
        F(from_fn(|lane| if a.0[lane] > b.0[lane] { a.0[lane] } else { b.0[lane] }))
    }
    #[inline(always)]
    fn abs(self, a: F) -> F {
        F(a.0.map(f32::abs))
    }
    #[inline(always)]
    fn sqrt(self, a: F) -> F {
        F(a.0.map(f32::sqrt))
    }
    #[inline(always)]
    fn flip_by_sign(self, a: F, sign: F) -> F {
        F(from_fn(|lane| f32::from_bits(a.0[lane].to_bits() ^ (sign.0[lane].to_bits() & 0x8000_0000))))
    }
    #[inline(always)]
    fn lt(self, a: F, b: F) -> M {
        M(from_fn(|lane| truth(a.0[lane] < b.0[lane])))
    }
    #[inline(always)]
    fn le(self, a: F, b: F) -> M {
        M(from_fn(|lane| truth(a.0[lane] <= b.0[lane])))
    }
    #[inline(always)]
    fn select(self, mask: M, yes: F, no: F) -> F {
        F(from_fn(|lane| {
            f32::from_bits((yes.0[lane].to_bits() & mask.0[lane]) | (no.0[lane].to_bits() & !mask.0[lane]))
        }))
    }
    #[inline(always)]
    fn floor_int(self, a: F) -> I {
        I(from_fn(|lane| {
            let toward_zero = a.0[lane] as i32;
            toward_zero.wrapping_sub(i32::from(toward_zero as f32 > a.0[lane]))
        }))
    }
    #[inline(always)]
    fn to_float(self, a: I) -> F {
        F(a.0.map(|lane| lane as f32))
    }
    #[inline(always)]
    fn shift_left(self, a: I, count: I) -> I {
        I(from_fn(|lane| a.0[lane].wrapping_shl(count.0[lane] as u32)))
    }
    #[inline(always)]
    fn shift_right(self, a: I, count: I) -> I {
        I(from_fn(|lane| a.0[lane].wrapping_shr(count.0[lane] as u32)))
    }
    #[inline(always)]
    fn and_not(self, a: I, b: I) -> I {
        I(from_fn(|lane| a.0[lane] & !b.0[lane]))
    }
    #[inline(always)]
    fn min_int(self, a: I, b: I) -> I {
        I(from_fn(|lane| a.0[lane].min(b.0[lane])))
    }
    #[inline(always)]
    fn max_int(self, a: I, b: I) -> I {
        I(from_fn(|lane| a.0[lane].max(b.0[lane])))
    }
    #[inline(always)]
    fn eq_int(self, a: I, b: I) -> M {
        M(from_fn(|lane| truth(a.0[lane] == b.0[lane])))
    }
    #[inline(always)]
    fn gt_int(self, a: I, b: I) -> M {
        M(from_fn(|lane| truth(a.0[lane] > b.0[lane])))
    }
    #[inline(always)]
    fn select_int(self, mask: M, yes: I, no: I) -> I {
        I(from_fn(|lane| (yes.0[lane] & mask.0[lane] as i32) | (no.0[lane] & !mask.0[lane] as i32)))
    }
    #[inline(always)]
    fn bits(self, mask: M) -> u32 {
        let mut bits = 0;
        for lane in 0..N {
            bits |= (mask.0[lane] & 1) << lane;
        }
        bits
    }
    #[inline(always)]
    fn from_bits(self, bits: u32) -> M {
        M(from_fn(|lane| truth(bits >> lane & 1 == 1)))
    }
    #[inline(always)]
    fn lookup(self, table: &[i32; 16], index: I) -> I {
        I(index.0.map(|lane| table[(lane & 15) as usize]))
    }
    #[inline(always)]
    fn gather(self, data: &[u32], index: I, mask: M) -> I {
        let last = data.len() - 1;
        I(from_fn(|lane| (data[(index.0[lane] as u32 as usize).min(last)] & mask.0[lane]) as i32))
    }
    #[inline(always)]
    fn gather_window<const K: usize>(self, data: &[f32], stride: usize, index: I, _mask: M) -> [[F; K]; K] {
        let reach = (K - 1) * stride + K;
        let last = data.len() - reach;
        let starts: [usize; N] = from_fn(|lane| (index.0[lane] as u32 as usize).min(last));
        let mut window = [[F([0.0; N]); K]; K];
        for lane in 0..N {
            let cells = &data[starts[lane]..starts[lane] + reach];
            for j in 0..K {
                for i in 0..K {
                    window[j][i].0[lane] = cells[j * stride + i];
                }
            }
        }
        window
    }
}
