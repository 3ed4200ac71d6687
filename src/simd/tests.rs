//! Every level computes what plain Rust computes.

use super::*;

/// Runs each operation on a few values and returns all results as bits, lane by lane in the order of the inputs.
struct Operations<'a> {
    a: &'a [f32; 16],
    b: &'a [f32; 16],
    i: &'a [f32; 16],
    table: &'a [i32; 16],
    data: &'a [u32],
    heights: &'a [f32],
}

impl Kernel for Operations<'_> {
    type Output = Vec<Vec<u32>>;
    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> Self::Output {
        let mut out = vec![Vec::new(); 24];
        for start in (0..16).step_by(S::LANES) {
            let (a, b) = (s.load(&self.a[start..]), s.load(&self.b[start..]));
            let i = s.floor_int(s.load(&self.i[start..]));
            let mut floats = vec![0.0; S::LANES];
            let mut ints = vec![0; S::LANES];
            let mut slot = 0;
            let mut keep_float = |value: S::F, out: &mut Vec<Vec<u32>>| {
                s.store(value, &mut floats);
                out[slot].extend(floats.iter().map(|f| f.to_bits()));
                slot += 1;
            };
            let less = s.lt(a, b);
            keep_float(a + b, &mut out);
            keep_float(a - b, &mut out);
            keep_float(a * b, &mut out);
            keep_float(a / b, &mut out);
            keep_float(s.min(a, b), &mut out);
            keep_float(s.max(a, b), &mut out);
            keep_float(s.abs(a), &mut out);
            keep_float(s.flip_by_sign(a, b), &mut out);
            keep_float(s.select(less, a, b), &mut out);
            keep_float(s.select(!s.le(a, b), a, b), &mut out);
            keep_float(s.fma_exact(a, b, s.splat(0.25)), &mut out);
            keep_float(s.to_float(s.floor_int(a)), &mut out);
            let everywhere = s.from_bits(u32::MAX);
            let window = s.gather_window::<2>(self.heights, 5, i, everywhere);
            keep_float(window[0][1] + window[1][0], &mut out);
            let mut keep_int = |value: S::I, out: &mut Vec<Vec<u32>>| {
                s.store_int(value, &mut ints);
                out[slot].extend(ints.iter().map(|&int| int as u32));
                slot += 1;
            };
            let one = s.splat_int(1);
            keep_int(s.shift_left(i, one), &mut out);
            keep_int(s.shift_right(i, one), &mut out);
            keep_int(i + one, &mut out);
            keep_int(s.min_int(i, one), &mut out);
            keep_int(s.max_int(i, one), &mut out);
            keep_int(s.select_int(s.eq_int(i, one) | s.gt_int(i, one), i, i * i), &mut out);
            keep_int(s.lookup(self.table, i & s.splat_int(15)), &mut out);
            keep_int(s.gather(self.data, i, less), &mut out);
            keep_int(s.gather(self.data, i, s.from_bits(0b0101_0101_0101_0101)), &mut out);
            let bits = s.bits(less);
            out[22].extend((0..S::LANES).map(|lane| bits >> lane & 1));
            out[23].extend((0..S::LANES).map(|lane| u32::from(s.any(less & s.from_bits(1 << lane)))));
        }
        out
    }
}

#[test]
fn every_level_agrees_with_the_portable_one_bit_for_bit() {
    let a: [f32; 16] = std::array::from_fn(|i| (i as f32 - 7.5) * 1.37);
    let b: [f32; 16] = std::array::from_fn(|i| ((i * 7 + 3) % 16) as f32 - 6.25);
    let i: [f32; 16] = std::array::from_fn(|i| if i % 5 == 4 { -(i as f32) } else { i as f32 * 3.0 });
    let table = std::array::from_fn(|i| i as i32 * 11 - 40);
    let data: Vec<u32> = (0..20).map(|k| k * k + 1).collect();
    let heights: Vec<f32> = (0..25).map(|k| k as f32 * 0.5).collect();
    let run =
        |level| dispatch(level, Operations { a: &a, b: &b, i: &i, table: &table, data: &data, heights: &heights });
    let portable = run(SimdLevel::Portable);
    assert_eq!(f32::from_bits(portable[0][0]), a[0] + b[0]);
    assert_eq!(f32::from_bits(portable[11][0]), a[0].floor());
    assert_eq!(portable[20].iter().zip(&a).zip(&b).filter(|((v, a), b)| (**v == 0) != (**a >= **b)).count(), 0);
    for level in SimdLevel::ALL.into_iter().filter(|level| level.is_available()) {
        assert_eq!(run(level), portable, "{}", level.name());
    }
}
