//! Error against time of light: caustics by three methods, both integrators, how paths converge, the sampler, and what of a
//! frame's time its rays take.
//!
//! Here are the pictures' judges; each table has a file of its own. What is rendered comes from `pool` and from
//! `bench::pictures`.

mod caustics;
mod convergence;
mod frames;
mod integrators;
mod pool;
mod profile;
mod sampling;

use std::io::Write;

use super::sheet::Sheet;
use super::{BenchError, Settings};
use crate::output::Picture;

/// Runs the tables and prints them as they grow.
///
/// # Errors
/// Embree is missing, a picture cannot be rendered or shows nothing, or a file of rows cannot be written.
pub fn run(settings: &Settings, out: &mut impl Write) -> Result<(), BenchError> {
    let mut sheet = Sheet::new(settings, out)?;
    caustics::run(settings, &mut sheet)?;
    frames::run(settings, &mut sheet)?;
    integrators::run(settings, &mut sheet)?;
    convergence::run(settings, &mut sheet)?;
    sampling::run(settings, &mut sheet)?;
    profile::run(settings, &mut sheet)?;
    sheet.plot(settings, super::plot::light)
}

/// Seed of every reference. Pictures that are judged have seeds from 1 up, so that none shares a reference's samples.
const REFERENCE_SEED: u32 = 1000;

/// Pixels across: by the rays that were asked for, or as many as the benchmark likes.
fn across(settings: &Settings, quick: u32, full: u32) -> u32 {
    match settings.rays {
        Some(rays) => (rays.isqrt() as u32).clamp(8, full),
        None if settings.quick => quick,
        None => full,
    }
}

/// Luminance (Rec. 709) of every pixel.
fn luminance(picture: &Picture) -> Vec<f64> {
    let samples = |name: &str| picture.channel(name).map_or(&[][..], |channel| &channel.samples[..]);
    let (red, green, blue) = (samples("R"), samples("G"), samples("B"));
    let pixel =
        |((r, g), b): ((&f32, &f32), &f32)| 0.2126 * f64::from(*r) + 0.7152 * f64::from(*g) + 0.0722 * f64::from(*b);
    red.iter().zip(green).zip(blue).map(pixel).collect()
}

/// What pictures of the same view, each with its own seed, differ by from the truth.
#[derive(Clone, Debug)]
struct Judge {
    truth: Vec<f64>,
    mean: f64,
    differences: Vec<f64>,
}

impl Judge {
    /// A judge who holds pictures against `truth`, luminances pixel by pixel.
    ///
    /// # Errors
    /// The truth is black: nothing is relative to it.
    fn new(truth: Vec<f64>) -> Result<Self, BenchError> {
        let mean = truth.iter().sum::<f64>() / truth.len().max(1) as f64;
        if mean.is_nan() || mean <= 0.0 {
            return Err(BenchError::Internal(format!("the reference has a mean luminance of {mean}, not above 0")));
        }
        Ok(Self { truth, mean, differences: Vec::new() })
    }

    /// Takes another picture into account.
    fn add(&mut self, picture: &[f64]) {
        self.differences.extend(picture.iter().zip(&self.truth).map(|(a, b)| a - b));
    }

    /// Mean square of the error.
    fn mean_square(&self) -> f64 {
        self.differences.iter().map(|d| d * d).sum::<f64>() / self.differences.len().max(1) as f64
    }

    /// Its root over the truth's mean.
    fn relative(&self) -> f64 {
        self.mean_square().sqrt() / self.mean
    }

    /// The pictures' mean over the truth's, and its standard error, with pixels taken as independent: the sampler makes
    /// neighbours differ more than by chance, so it is an upper bound.
    fn mean_ratio(&self) -> [f64; 2] {
        let count = self.differences.len().max(2) as f64;
        let mean = self.differences.iter().sum::<f64>() / count;
        let variance = self.differences.iter().map(|d| (d - mean).powi(2)).sum::<f64>() / (count - 1.0);
        // A black picture's differences add up to the truth's mean but for rounding.
        [(1.0 + mean / self.mean).max(0.0), (variance / count).sqrt() / self.mean]
    }
}

/// The power of minus which y falls with x: least squares over logarithms; 0 for fewer than two points above 0.
fn falls_as(points: &[(f64, f64)]) -> f64 {
    let logs: Vec<(f64, f64)> =
        points.iter().filter(|(x, y)| *x > 0.0 && *y > 0.0).map(|(x, y)| (x.ln(), y.ln())).collect();
    let count = logs.len() as f64;
    let middle = logs.iter().fold([0.0; 2], |sum, (x, y)| [sum[0] + x / count, sum[1] + y / count]);
    let (mut along, mut both) = (0.0, 0.0);
    for (x, y) in &logs {
        along += (x - middle[0]).powi(2);
        both += (x - middle[0]) * (y - middle[1]);
    }
    if along > 0.0 { -both / along } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_judge_knows_bias_from_noise() {
        let truth = vec![1.0, 3.0, 2.0, 2.0];
        let mut noisy = Judge::new(truth.clone()).unwrap();
        noisy.add(&[1.5, 2.5, 2.5, 1.5]);
        noisy.add(&[0.5, 3.5, 1.5, 2.5]);
        assert_eq!((noisy.mean_square(), noisy.relative()), (0.25, 0.25));
        let [ratio, error] = noisy.mean_ratio();
        assert!((ratio - 1.0).abs() < 1e-12 && (error - (2.0_f64 / 7.0 / 8.0).sqrt() / 2.0).abs() < 1e-12, "{error}");
        let mut biased = Judge::new(truth).unwrap();
        biased.add(&[1.5, 3.5, 2.5, 2.5]);
        assert_eq!((biased.mean_square(), biased.mean_ratio()), (0.25, [1.25, 0.0]));
        assert!(Judge::new(vec![0.0; 4]).is_err());
    }

    #[test]
    fn the_power_of_a_law_is_found() {
        let law = |power: f64| [1.0_f64, 4.0, 16.0, 64.0].map(|x| (x, 3.0 * x.powf(-power)));
        for power in [0.0, 0.5, 1.0] {
            assert!((falls_as(&law(power)) - power).abs() < 1e-12);
        }
        assert_eq!(falls_as(&[(2.0, 0.5), (4.0, 0.0)]), 0.0);
    }
}
