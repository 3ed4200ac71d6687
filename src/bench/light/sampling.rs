//! The sampler against independent random numbers: mean square error of pixels, and of means over 4x4 pixels, where blue
//! noise pays.
//!
//! There is no independent sampler in the program. What one would come to is known without it: the variance of a single
//! sample over the count of samples, with the former from the reference's many samples.

use super::{Judge, REFERENCE_SEED, across, luminance, pool};
use crate::bench::pictures::{self, Built};
use crate::bench::rows::Row;
use crate::bench::sheet::{Sheet, number};
use crate::bench::{BenchError, Settings, size_name};
use crate::output::Picture;
use crate::scene::{PixelFilter, Scene};
use crate::state::Frame;

/// Pixels along each side of a block.
const BLOCK: usize = 4;

/// Samples a pixel.
const SAMPLES: [u32; 2] = [4, 16];

/// Means over blocks, row by row; the width is a multiple of the block's.
fn blocks(pixels: &[f64], width: usize) -> Vec<f64> {
    let mut means = vec![0.0; pixels.len() / (BLOCK * BLOCK)];
    for (index, value) in pixels.iter().enumerate() {
        let (x, y) = (index % width, index / width);
        means[y / BLOCK * (width / BLOCK) + x / BLOCK] += value / (BLOCK * BLOCK) as f64;
    }
    means
}

/// Mean over the pixels of the variance of one sample.
fn variance_of_a_sample(reference: &Picture, samples: u32) -> f64 {
    let variances = reference.channel("variance").map_or(&[][..], |channel| &channel.samples[..]);
    let sum: f64 = variances.iter().map(|&of_mean| f64::from(of_mean)).sum();
    sum / variances.len().max(1) as f64 * f64::from(samples)
}

/// What came, and what independent samples would come to: mean squares, of pixels and of blocks.
struct Measured {
    samples: u32,
    /// The root over the mean, of pixels and of blocks.
    relative: [f64; 2],
    ours: [f64; 2],
    independent: [f64; 2],
}

fn measure(
    scene: &Scene,
    frame: &Frame,
    reference: u32,
    seeds: u32,
    settings: &Settings,
) -> Result<Vec<Measured>, BenchError> {
    let width = scene.render.width as usize;
    let render = |samples: u32, seed: u32| {
        let mut scene = scene.clone();
        (scene.render.samples, scene.render.seed) = (samples, seed);
        Ok::<_, BenchError>(Built::new(&scene, frame, settings)?.render(frame, settings)?.0)
    };
    let many = render(reference, REFERENCE_SEED)?;
    let variance = variance_of_a_sample(&many, reference);
    let truth = luminance(&many);
    let truth = [Judge::new(truth.clone())?, Judge::new(blocks(&truth, width))?];
    let one = |samples: u32| {
        let mut judges = truth.clone();
        for seed in 1..=seeds {
            let pixels = luminance(&render(samples, seed)?);
            judges[1].add(&blocks(&pixels, width));
            judges[0].add(&pixels);
        }
        let each = variance / f64::from(samples);
        Ok(Measured {
            samples,
            relative: judges.each_ref().map(Judge::relative),
            ours: judges.each_ref().map(Judge::mean_square),
            independent: [each, each / (BLOCK * BLOCK) as f64],
        })
    };
    SAMPLES.into_iter().map(one).collect()
}

pub(super) fn run(settings: &Settings, sheet: &mut Sheet) -> Result<(), BenchError> {
    // Whole blocks on the full frame's grid.
    let size = across(settings, 24, 128).next_multiple_of(BLOCK as u32);
    let columns = settings.sizes.first().copied().unwrap_or([80, 20]);
    let river = pictures::frame(columns, 2_800);
    let (reference, seeds) = if settings.quick { (256, 4) } else { (4096, 8) };
    let mut paths = pictures::scene(&river, [size, size]);
    paths.render.integrator = crate::scene::Integrator::Path;
    let scenes = [("small water, path", paths, &river), ("pool, path", pool::view([size, size]), &pool::frame())];
    sheet.say(&format!(
        "\nThe sampler, {size}x{size} pixels: mean square error of independent samples over its own, against {reference} \
         samples"
    ))?;
    sheet.table(&["picture, and the mean of", "samples", "relative error", "independent/ours"])?;
    for (name, mut scene, frame) in scenes {
        scene.render.filter = PixelFilter::Box;
        for measured in measure(&scene, frame, reference, seeds, settings)? {
            for (k, of) in ["pixels", "4x4 pixels"].into_iter().enumerate() {
                let ours = measured.ours[k];
                let row = Row {
                    bench: "light-samplers".to_owned(),
                    columns: size_name([frame.columns.nx, frame.columns.nz]),
                    rays: name.to_owned(),
                    dial: of.to_owned(),
                    setting: format!("{} samples", measured.samples),
                    value: measured.samples.into(),
                    error_rms: measured.relative[k],
                    ratio: if ours > 0.0 { measured.independent[k] / ours } else { 0.0 },
                    threads: settings.threads,
                    ..Row::default()
                };
                let mut cells = vec![format!("{name}, {of}"), measured.samples.to_string()];
                cells.extend([row.error_rms, row.ratio].map(number));
                sheet.row(&cells, row)?;
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_are_means() {
        let pixels: Vec<f64> = (0..64).map(|k| if k % 8 < 4 { 1.0 } else { f64::from(k / 32) }).collect();
        assert_eq!(blocks(&pixels, 8), [1.0, 0.0, 1.0, 1.0]);
    }

    #[test]
    fn more_samples_and_greater_blocks_have_less_error() {
        let settings = Settings { quick: true, ..Settings::default() };
        let frame = pictures::frame([40, 20], 300);
        let mut scene = pictures::scene(&frame, [24, 24]);
        scene.render.integrator = crate::scene::Integrator::Path;
        scene.render.filter = PixelFilter::Box;
        let [few, many] = &measure(&scene, &frame, 256, 2, &settings).unwrap()[..] else { panic!("two counts") };
        assert!(many.ours[0] < few.ours[0] && few.ours[1] < few.ours[0] / 8.0, "{:?} {:?}", few.ours, many.ours);
        // Independent samples: a quarter of the error for four times as many, a sixteenth over a block.
        assert!((few.independent[0] / many.independent[0] - 4.0).abs() < 1e-9);
        assert!((few.independent[0] / few.independent[1] - 16.0).abs() < 1e-9);
        assert!(few.independent[0] > 0.5 * few.ours[0], "{:?} {:?}", few.independent, few.ours);
    }
}
