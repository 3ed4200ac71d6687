//! Heights between samples: the natural cubic spline through them, as a tensor product.
//!
//! It is the twice differentiable curve of least bending through the samples, linear beyond the outermost ones, so that
//! refined ground has no creases along the lattice. It may swing past its samples beside a cliff, by 11 % of a lone step;
//! monotone schemes do not, but crease there. Source: de Boor, A practical guide to splines, 1978, chapter IV.

use rayon::prelude::*;

/// Where the results of one axis lie.
#[derive(Clone, Copy, Debug)]
pub(in super::super) struct Axis {
    /// Samples that there are, at least 1.
    pub samples: usize,
    /// Results that are wanted.
    pub results: usize,
    /// Place of the first result and distance between results, counted in samples.
    pub first: f64,
    /// See `first`.
    pub step: f64,
}

impl Axis {
    fn place(&self, result: f64) -> f64 {
        self.first + result * self.step
    }

    /// Points that are averaged for one result: none is left out when results lie further apart than samples.
    fn points(&self) -> usize {
        (self.step.ceil() as usize).max(1)
    }
}

/// Samples (`x.samples` by `z.samples`, row by row) → results (`x.results` by `z.results`).
///
/// A result is the spline's value; where results lie further apart than samples, its mean over the result's footprint.
pub(in super::super) fn resample(samples: &[f64], x: Axis, z: Axis) -> Vec<f64> {
    assert_eq!(samples.len(), x.samples * z.samples, "the samples of a map are a rectangle");
    let rows = along_rows(samples, x);
    let columns = along_rows(&transposed(&rows, x.results), z);
    transposed(&columns, z.results)
}

fn transposed(values: &[f64], nx: usize) -> Vec<f64> {
    let nz = values.len() / nx;
    let mut out = vec![0.0; values.len()];
    out.par_chunks_exact_mut(nz).enumerate().for_each(|(x, column)| {
        for (z, value) in column.iter_mut().enumerate() {
            *value = values[z * nx + x];
        }
    });
    out
}

fn along_rows(values: &[f64], axis: Axis) -> Vec<f64> {
    let system = System::new(axis.samples);
    let mut out = vec![0.0; values.len() / axis.samples * axis.results];
    let rows = out.par_chunks_exact_mut(axis.results).zip(values.par_chunks_exact(axis.samples));
    rows.for_each_init(
        || vec![0.0; axis.samples],
        |curvatures, (results, row)| {
            system.solve(row, curvatures);
            let points = axis.points();
            for (index, result) in results.iter_mut().enumerate() {
                let value = |point: usize| {
                    let within = (2 * point + 1) as f64 / (2 * points) as f64 - 0.5;
                    at(row, curvatures, axis.place(index as f64 + within))
                };
                *result = (0..points).map(value).sum::<f64>() / points as f64;
            }
        },
    );
    out
}

/// The spline at a place (in samples).
fn at(values: &[f64], curvatures: &[f64], place: f64) -> f64 {
    let last = values.len() - 1;
    if last == 0 {
        return values[0];
    }
    let low = (place.floor().max(0.0) as usize).min(last - 1);
    let t = place - low as f64;
    let (y0, y1, m0, m1) = (values[low], values[low + 1], curvatures[low], curvatures[low + 1]);
    if t < 0.0 {
        return y0 + t * (y1 - y0 - (2.0 * m0 + m1) / 6.0);
    }
    if t > 1.0 {
        return y1 + (t - 1.0) * (y1 - y0 + (m0 + 2.0 * m1) / 6.0);
    }
    let s = 1.0 - t;
    s * y0 + t * y1 - s * t * ((1.0 + s) * m0 + (1.0 + t) * m1) / 6.0
}

/// The equations of the second derivatives, factored once for all rows: `m[i-1] + 4 m[i] + m[i+1] = 6 (y[i-1] - 2 y[i] + y[i+1])`.
struct System {
    /// Upper factor of each inner row.
    upper: Vec<f64>,
}

impl System {
    fn new(samples: usize) -> Self {
        let mut upper = Vec::with_capacity(samples.saturating_sub(2));
        let mut before = 0.0;
        for _ in 2..samples {
            before = 1.0 / (4.0 - before);
            upper.push(before);
        }
        Self { upper }
    }

    /// Second derivatives at the samples; 0 at both ends.
    fn solve(&self, values: &[f64], curvatures: &mut [f64]) {
        curvatures.fill(0.0);
        for i in 1..values.len().saturating_sub(1) {
            let bend = 6.0 * (values[i - 1] - 2.0 * values[i] + values[i + 1]);
            curvatures[i] = (bend - curvatures[i - 1]) * self.upper[i - 1];
        }
        for i in (1..values.len().saturating_sub(1)).rev() {
            curvatures[i] -= self.upper[i - 1] * curvatures[i + 1];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refined(samples: &[f64], nx: usize, times: usize) -> (Vec<f64>, usize) {
        let axis =
            |samples: usize| Axis { samples, results: (samples - 1) * times + 1, first: 0.0, step: 1.0 / times as f64 };
        let (x, z) = (axis(nx), axis(samples.len() / nx));
        (resample(samples, x, z), x.results)
    }

    #[test]
    fn samples_are_kept_and_planes_go_on_beyond_them() {
        let samples: Vec<f64> = (0..35).map(|i| f64::from(i * i * 37 % 101)).collect();
        let (fine, nx) = refined(&samples, 7, 8);
        for (index, sample) in samples.iter().enumerate() {
            assert_eq!(fine[index / 7 * 8 * nx + index % 7 * 8], *sample);
        }
        let plane: Vec<f64> = (0..35).map(|i| 3.0 * f64::from(i % 7) - 2.0 * f64::from(i / 7)).collect();
        let axis = |samples| Axis { samples, results: 40, first: -1.3, step: 0.25 };
        for (index, height) in resample(&plane, axis(7), axis(5)).into_iter().enumerate() {
            let [x, z] = [index % 40, index / 40].map(|result| -1.3 + 0.25 * result as f64);
            assert!((height - (3.0 * x - 2.0 * z)).abs() < 1e-12);
        }
    }

    #[test]
    fn a_smooth_hill_is_met_to_fourth_order() {
        let hill = |x: f64, z: f64| (0.7 * x).sin() * (0.5 * z).cos();
        let worst = |per: usize| {
            let n = 12 * per + 1;
            let samples: Vec<f64> =
                (0..n * n).map(|i| hill((i % n) as f64 / per as f64, (i / n) as f64 / per as f64)).collect();
            // Half way between samples, away from the natural ends.
            let axis = Axis { samples: n, results: 4 * per, first: 4.0 * per as f64 + 0.5, step: 1.0 };
            let results = resample(&samples, axis, axis);
            let place = |index: usize| 4.0 + (index as f64 + 0.5) / per as f64;
            let error = |i: usize| (results[i] - hill(place(i % (4 * per)), place(i / (4 * per)))).abs();
            (0..results.len()).map(error).fold(0.0, f64::max)
        };
        let (coarse, fine) = (worst(2), worst(4));
        assert!(coarse < 2e-3 && fine < coarse / 12.0, "{coarse} {fine}");
    }

    #[test]
    fn a_cliff_swings_no_further_than_the_header_says() {
        let samples: Vec<f64> = (0..40).map(|i| f64::from(i >= 20)).collect();
        let x = Axis { samples: 40, results: 3901, first: 0.0, step: 0.01 };
        let z = Axis { samples: 1, results: 1, first: 0.0, step: 1.0 };
        let most = resample(&samples, x, z).into_iter().fold(0.0, f64::max);
        assert!((1.10..1.11).contains(&most), "{most}");
    }

    #[test]
    fn coarser_columns_are_means_of_what_they_cover() {
        // A comb of alternating heights must vanish, not alias.
        let samples: Vec<f64> = (0..64).map(|i| 5.0 + f64::from(i % 2)).collect();
        let x = Axis { samples: 64, results: 8, first: 3.5, step: 8.0 };
        let z = Axis { samples: 1, results: 1, first: 0.0, step: 1.0 };
        for mean in resample(&samples, x, z) {
            assert!((mean - 5.5).abs() < 0.02, "{mean}");
        }
    }

    #[test]
    fn one_sample_or_two_are_enough() {
        let axis = |samples| Axis { samples, results: 3, first: -0.25, step: 0.5 };
        assert_eq!(resample(&[7.0], axis(1), axis(1)), [7.0; 9]);
        assert_eq!(resample(&[0.0, 4.0], axis(2), axis(1))[..3], [-1.0, 1.0, 3.0]);
    }
}
