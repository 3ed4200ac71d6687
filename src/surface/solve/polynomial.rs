//! The spline along a ray as one polynomial in Bernstein form: y(s) - S(u(s), v(s)), s in 0..1 over a stretch.
//!
//! u and v are linear in s, so a tensor product of degree n x n becomes a polynomial of degree 2n. Its coefficients come
//! from the blossom (Ramshaw 1989): w_kl = S(u0^(n-k) u1^k, v0^(n-l) v1^l), summed over k + l = m with the weights
//! C(n,k) C(n,l) / C(2n,m).

use super::{PatchRay, Segment};
use crate::math::Bernstein;
use crate::simd::Simd;

/// Weights of the K control values in the blossom with `k` arguments `b` and the others `a`, for each `k` (K = order).
#[inline(always)]
fn blossom_weights<S: Simd, const K: usize>(simd: S, a: S::F, b: S::F) -> [[S::F; K]; K] {
    let one = simd.splat(1.0);
    let (not_a, not_b) = (one - a, one - b);
    let mut weights = [[one; K]; K];
    match K {
        2 => {
            weights[0][0] = not_a;
            weights[0][1] = a;
            weights[1][0] = not_b;
            weights[1][1] = b;
        }
        3 => {
            let half = simd.splat(0.5);
            let first = [half * not_a * not_a, half * not_a * not_b, half * not_b * not_b];
            let last = [half * a * a, half * a * b, half * b * b];
            for k in 0..3 {
                weights[k][0] = first[k];
                weights[k][1] = one - first[k] - last[k];
                weights[k][2] = last[k];
            }
        }
        _ => {
            let rows = [
                cubic_row(simd, [a, a, a], [not_a, not_a, not_a]),
                cubic_row(simd, [a, a, b], [not_a, not_a, not_b]),
                cubic_row(simd, [a, b, b], [not_a, not_b, not_b]),
                cubic_row(simd, [b, b, b], [not_b, not_b, not_b]),
            ];
            for k in 0..4 {
                for i in 0..4 {
                    weights[k][i] = rows[k][i];
                }
            }
        }
    }
    weights
}

/// Weights of four control values in the cubic blossom with arguments `p` (and `q` = 1 - p): the Bézier weights, carried
/// to the uniform B-spline's control values.
#[inline(always)]
fn cubic_row<S: Simd>(simd: S, p: [S::F; 3], q: [S::F; 3]) -> [S::F; 4] {
    let b0 = q[0] * q[1] * q[2];
    let b1 = simd.fma(p[0] * q[1], q[2], simd.fma(q[0] * p[1], q[2], q[0] * q[1] * p[2]));
    let b2 = simd.fma(p[0] * p[1], q[2], simd.fma(p[0] * q[1], p[2], q[0] * p[1] * p[2]));
    let b3 = p[0] * p[1] * p[2];
    let (sixth, third, two_thirds) = (simd.splat(1.0 / 6.0), simd.splat(1.0 / 3.0), simd.splat(2.0 / 3.0));
    [
        sixth * b0,
        simd.fma(two_thirds, b0, simd.fma(two_thirds, b1, simd.fma(third, b2, sixth * b3))),
        simd.fma(two_thirds, b3, simd.fma(two_thirds, b2, simd.fma(third, b1, sixth * b0))),
        sixth * b3,
    ]
}

/// C(n,k) C(n,l) / C(2n,k+l) for n = K - 1: worked out by the compiler, for kernels must not call functions.
struct ProductWeights<const K: usize>;

impl<const K: usize> ProductWeights<K> {
    const TABLE: [[f32; K]; K] = {
        let mut table = [[0.0; K]; K];
        let mut k = 0;
        while k < K {
            let mut l = 0;
            while l < K {
                table[k][l] = (choose(K - 1, k) * choose(K - 1, l)) as f32 / choose(2 * (K - 1), k + l) as f32;
                l += 1;
            }
            k += 1;
        }
        table
    };
}

/// Binomial coefficient.
const fn choose(n: usize, k: usize) -> usize {
    match k {
        0 => 1,
        _ => choose(n, k - 1) * (n + 1 - k) / k,
    }
}

/// Bernstein coefficients of height above the surface along each lane; entries past D are zero.
#[inline(always)]
pub(in crate::surface) fn lane_polynomial<S: Simd, const K: usize, const D: usize>(
    simd: S,
    segment: &Segment<S, K>,
) -> [S::F; 7] {
    let along_u = blossom_weights::<S, K>(simd, segment.u[0], segment.u[1]);
    let along_v = blossom_weights::<S, K>(simd, segment.v[0], segment.v[1]);
    // Rows first: the blossom in u of every row of control heights.
    let mut rows = [[simd.splat(0.0); K]; K];
    for b in 0..K {
        for k in 0..K {
            let mut sum = along_u[k][0] * segment.window[b][0];
            for a in 1..K {
                sum = simd.fma(along_u[k][a], segment.window[b][a], sum);
            }
            rows[b][k] = sum;
        }
    }
    let rise = (segment.y[1] - segment.y[0]) * simd.splat(1.0 / D as f32);
    let mut coefficients = [simd.splat(0.0); 7];
    for m in 0..=D {
        coefficients[m] = simd.fma(rise, simd.splat(m as f32), segment.y[0]);
    }
    for k in 0..K {
        for l in 0..K {
            let mut sum = along_v[l][0] * rows[0][k];
            for b in 1..K {
                sum = simd.fma(along_v[l][b], rows[b][k], sum);
            }
            let weight = ProductWeights::<K>::TABLE[k][l];
            coefficients[k + l] = simd.fma(simd.splat(-weight), sum, coefficients[k + l]);
        }
    }
    coefficients
}

/// The same for one ray in double precision, by another way: interpolation is not needed, the products are exact.
pub(in crate::surface) fn ray_polynomial(ray: &PatchRay) -> Bernstein {
    let n = ray.order - 1;
    let blossom = |values: [f64; 4], ends: [f64; 2], k: usize| {
        let mut row = super::super::lattice::to_bezier(ray.order, values);
        for level in 0..n {
            // The last k arguments are the far end.
            let argument = if level < n - k { ends[0] } else { ends[1] };
            for a in 0..n - level {
                row[a] += argument * (row[a + 1] - row[a]);
            }
        }
        row[0]
    };
    let choose = |n: usize, k: usize| (0..k).fold(1.0, |c, i| c * (n - i) as f64 / (i + 1) as f64);
    let degree = 2 * n;
    let mut coefficients = [0.0; 7];
    for (m, slot) in coefficients.iter_mut().enumerate().take(degree + 1) {
        *slot = ray.y[0] + (ray.y[1] - ray.y[0]) * m as f64 / degree as f64;
    }
    for k in 0..=n {
        let mut column = [0.0; 4];
        for (b, slot) in column.iter_mut().enumerate().take(ray.order) {
            *slot = blossom(ray.window[b], ray.u, k);
        }
        for l in 0..=n {
            let weight = choose(n, k) * choose(n, l) / choose(degree, k + l);
            coefficients[k + l] -= weight * blossom(column, ray.v, l);
        }
    }
    Bernstein::new(&coefficients[..=degree])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::{Kernel, SimdLevel, dispatch};

    fn example(order: usize) -> PatchRay {
        let mut window = [[0.0; 4]; 4];
        for b in 0..order {
            for a in 0..order {
                window[b][a] = ((a * 7 + b * 5) % 11) as f64 * 0.3 - 1.0;
            }
        }
        PatchRay { order, window, u: [0.125, 0.875], v: [0.75, 0.0], y: [1.5, -0.5] }
    }

    #[test]
    fn polynomial_is_the_height_above_the_surface() {
        for order in 2..=4 {
            let ray = example(order);
            let polynomial = ray_polynomial(&ray);
            for step in 0..=8 {
                let s = f64::from(step) / 8.0;
                let at = |ends: [f64; 2]| ends[0] + s * (ends[1] - ends[0]);
                let (bu, _) = super::super::super::lattice::basis(order, at(ray.u));
                let (bv, _) = super::super::super::lattice::basis(order, at(ray.v));
                let mut surface = 0.0;
                for b in 0..order {
                    for a in 0..order {
                        surface += ray.window[b][a] * bu[a] * bv[b];
                    }
                }
                assert!((polynomial.value(s) - (at(ray.y) - surface)).abs() < 1e-13, "order {order} s {s}");
            }
        }
    }

    struct Lanes<const K: usize, const D: usize>(PatchRay);
    impl<const K: usize, const D: usize> Kernel for Lanes<K, D> {
        type Output = Vec<f64>;
        #[inline(always)]
        fn run<S: Simd>(self, simd: S) -> Vec<f64> {
            let ray = self.0;
            let splat = |value: f64| simd.splat(value as f32);
            let mut window = [[splat(0.0); K]; K];
            for b in 0..K {
                for a in 0..K {
                    window[b][a] = splat(ray.window[b][a]);
                }
            }
            let segment = Segment {
                window,
                u: ray.u.map(splat),
                v: ray.v.map(splat),
                y: ray.y.map(splat),
                above: splat(0.0),
                length: splat(1.0),
                tolerance: splat(1e-6),
                mask: simd.from_bits(1),
            };
            let mut lane = [0.0; 16];
            lane_polynomial::<S, K, D>(simd, &segment)[..=D]
                .iter()
                .map(|&c| {
                    simd.store(c, &mut lane);
                    f64::from(lane[0])
                })
                .collect()
        }
    }

    #[test]
    fn lanes_compute_the_same_coefficients() {
        for level in SimdLevel::ALL {
            for (order, lanes) in [
                (2, dispatch(level, Lanes::<2, 2>(example(2)))),
                (3, dispatch(level, Lanes::<3, 4>(example(3)))),
                (4, dispatch(level, Lanes::<4, 6>(example(4)))),
            ] {
                for (lane, exact) in lanes.iter().zip(ray_polynomial(&example(order)).coefficients()) {
                    assert!((lane - exact).abs() < 1e-6, "order {order}: {lane} {exact}");
                }
            }
        }
    }
}
