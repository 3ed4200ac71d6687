//! Polynomials in Bernstein form over an interval, in double precision: bounds by the control polygon, roots by
//! sign variations (Descartes' rule in this basis) and bisection. Nothing here is tuned for speed.

/// Greatest degree held: a ray against a bicubic patch gives 6.
pub const MAX_DEGREE: usize = 6;

/// A polynomial p(s) on [0, 1] by its Bernstein coefficients.
///
/// The graph lies within the convex hull of the points (k / degree, c_k); the count of sign variations of the
/// coefficients is at least the count of roots and has the same parity (Farouki and Rajan 1987).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bernstein {
    degree: usize,
    coefficients: [f64; MAX_DEGREE + 1],
}

/// What is known about the first root of an interval.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Root {
    /// No root.
    None,
    /// The first root lies at this s, to the tolerance asked for.
    At(f64),
    /// The polynomial touches zero to within rounding here: a double root that arithmetic cannot tell from a miss.
    Touch(f64),
}

impl Bernstein {
    /// From coefficients c_0 … c_degree, at most [`MAX_DEGREE`] + 1 of them and at least one.
    pub fn new(coefficients: &[f64]) -> Self {
        assert!((1..=MAX_DEGREE + 1).contains(&coefficients.len()), "a polynomial has 1 to 7 coefficients");
        let mut kept = [0.0; MAX_DEGREE + 1];
        kept[..coefficients.len()].copy_from_slice(coefficients);
        Self { degree: coefficients.len() - 1, coefficients: kept }
    }

    /// c_0 … c_degree.
    pub fn coefficients(&self) -> &[f64] {
        &self.coefficients[..=self.degree]
    }

    /// p(s), by de Casteljau's algorithm.
    pub fn value(&self, s: f64) -> f64 {
        let mut row = self.coefficients;
        for level in (1..=self.degree).rev() {
            for k in 0..level {
                row[k] += s * (row[k + 1] - row[k]);
            }
        }
        row[0]
    }

    /// p'(s).
    pub fn slope(&self, s: f64) -> f64 {
        if self.degree == 0 {
            return 0.0;
        }
        let mut derivative = Self { degree: self.degree - 1, coefficients: [0.0; MAX_DEGREE + 1] };
        for k in 0..self.degree {
            derivative.coefficients[k] = self.degree as f64 * (self.coefficients[k + 1] - self.coefficients[k]);
        }
        derivative.value(s)
    }

    /// The same polynomial over [0, s] and over [s, 1], each rescaled to [0, 1].
    pub fn split(&self, s: f64) -> (Self, Self) {
        let mut right = *self;
        let mut left = *self;
        for level in 1..=self.degree {
            for k in 0..=self.degree - level {
                right.coefficients[k] += s * (right.coefficients[k + 1] - right.coefficients[k]);
            }
            left.coefficients[level] = right.coefficients[0];
        }
        (left, right)
    }

    /// Sign variations of the coefficients, zeros left out.
    pub fn variations(&self) -> usize {
        let mut count = 0;
        let mut last = 0.0;
        for &c in self.coefficients() {
            if c != 0.0 {
                if last * c < 0.0 {
                    count += 1;
                }
                last = c;
            }
        }
        count
    }

    /// The first root in [0, 1], bracketed to `tolerance` (in s), with no root before it.
    ///
    /// *Accuracy:* every interval before the answer was proven free of roots by its sign variations.
    /// *At tangency:* where subdivision reaches the resolution of double precision undecided, the answer is
    /// [`Root::Touch`].
    pub fn first_root(&self, tolerance: f64) -> Root {
        self.first_root_within(0.0, 1.0, tolerance)
    }

    fn first_root_within(&self, start: f64, end: f64, tolerance: f64) -> Root {
        if self.coefficients[0] == 0.0 {
            return Root::At(start);
        }
        match self.variations() {
            0 if self.coefficients[self.degree] == 0.0 => Root::At(end),
            0 => Root::None,
            1 => Root::At(start + (end - start) * self.single_root(tolerance / (end - start))),
            _ => {
                let middle = 0.5 * (start + end);
                // Below a few units in the last place of s there is nothing left to split.
                if end - start <= 8.0 * f64::EPSILON {
                    return Root::Touch(middle);
                }
                let (left, right) = self.split(0.5);
                match left.first_root_within(start, middle, tolerance) {
                    Root::None => right.first_root_within(middle, end, tolerance),
                    found => found,
                }
            }
        }
    }

    /// The only root of an interval with one sign variation: Newton, kept inside a bracket that bisection shrinks.
    fn single_root(&self, tolerance: f64) -> f64 {
        let rising = self.coefficients[0] < 0.0;
        let (mut low, mut high) = (0.0, 1.0);
        let mut s = 0.5;
        // Bisection alone needs 53 steps; Newton makes it 5 to 8.
        for _ in 0..120 {
            let value = self.value(s);
            if value == 0.0 {
                return s;
            }
            if (value < 0.0) == rising {
                low = s;
            } else {
                high = s;
            }
            let slope = self.slope(s);
            let newton = s - value / slope;
            let next = if newton > low && newton < high { newton } else { 0.5 * (low + high) };
            if (next - s).abs() <= tolerance.min(0.25) * 0.25 || high - low <= 2.0 * f64::EPSILON {
                return next;
            }
            s = next;
        }
        s
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Bernstein coefficients of the product of (s - r) over the roots, times a factor.
    fn from_roots(roots: &[f64], factor: f64) -> Bernstein {
        let mut coefficients = vec![factor];
        for &root in roots {
            let n = coefficients.len();
            let mut next = vec![0.0; n + 1];
            for (k, slot) in next.iter_mut().enumerate() {
                let degree = n as f64;
                let (a, b) = (-root, 1.0 - root);
                let from_left = if k < n { coefficients[k] * a * (degree - k as f64) / degree } else { 0.0 };
                let from_right = if k > 0 { coefficients[k - 1] * b * k as f64 / degree } else { 0.0 };
                *slot = from_left + from_right;
            }
            coefficients = next;
        }
        Bernstein::new(&coefficients)
    }

    #[test]
    fn value_and_split_agree_with_the_product_form() {
        let p = from_roots(&[0.3, -0.5, 1.7, 0.9], 2.0);
        let exact = |s: f64| 2.0 * (s - 0.3) * (s + 0.5) * (s - 1.7) * (s - 0.9);
        let (left, right) = p.split(0.4);
        for k in 0..=10 {
            let s = f64::from(k) / 10.0;
            assert!((p.value(s) - exact(s)).abs() < 1e-14);
            assert!((left.value(s) - exact(0.4 * s)).abs() < 1e-14);
            assert!((right.value(s) - exact(0.4 + 0.6 * s)).abs() < 1e-14);
        }
        assert!((p.slope(0.3) - 2.0 * 0.8 * (0.3 - 1.7) * (0.3 - 0.9)).abs() < 1e-13);
    }

    #[test]
    fn a_double_root_is_found_or_reported_as_a_touch() {
        match from_roots(&[0.4, 0.4], 1.0).first_root(1e-12) {
            Root::At(s) | Root::Touch(s) => assert!((s - 0.4).abs() < 1e-7),
            Root::None => {
                // Rounding may lift the double root off zero; then the least value must be of rounding's size.
                assert!(from_roots(&[0.4, 0.4], 1.0).value(0.4).abs() < 1e-15);
            }
        }
    }

    proptest! {
        #[test]
        fn planted_first_root_is_found(
            first in 0.01..0.99f64, gap in 1e-6..0.5f64, third in 1.1..3.0f64, factor in prop_oneof![-3.0..-0.1f64, 0.1..3.0f64],
        ) {
            let p = from_roots(&[first, first + gap, third, -0.7], factor);
            match p.first_root(1e-12) {
                Root::At(s) => prop_assert!((s - first).abs() < 1e-8, "{s} for {first}"),
                other => prop_assert!(false, "{other:?}"),
            }
        }

        #[test]
        fn no_root_is_invented(roots in proptest::collection::vec(1.01..5.0f64, 1..=6)) {
            prop_assert_eq!(from_roots(&roots, 1.0).first_root(1e-12), Root::None);
        }
    }
}
