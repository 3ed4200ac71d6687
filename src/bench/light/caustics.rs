//! Caustics by the manifold, by beams and by paths that meet the sun's disc by chance: error, bias and seconds, and what
//! that makes at equal time.
//!
//! Only light that has gone through the surface twice is in the picture. The reference is the manifold with many samples;
//! whether that is right itself shows in the mean of paths that know nothing of it.

use super::{Judge, REFERENCE_SEED, across, luminance, pool};
use crate::bench::pictures::Built;
use crate::bench::rows::Row;
use crate::bench::sheet::{Sheet, number};
use crate::bench::{BenchError, Settings, median, size_name};
use crate::scene::{Caustics, Scene};
use crate::state::Frame;

/// A method and how many samples it gets: quick, and in full.
struct Method {
    name: &'static str,
    caustics: Caustics,
    quick: &'static [u32],
    full: &'static [u32],
}

const METHODS: [Method; 3] = [
    // First: efficiency is against the last of these.
    Method { name: "off", caustics: Caustics::Off, quick: &[16, 128, 512], full: &[16, 64, 256, 1024, 4096] },
    Method { name: "manifold", caustics: Caustics::Manifold, quick: &[1, 4], full: &[1, 4, 16, 64] },
    Method { name: "beams", caustics: Caustics::Beams, quick: &[4], full: &[1, 4, 16, 64] },
];

/// What one method at one count of samples comes to.
struct Measured {
    judge: Judge,
    seconds: f64,
}

impl Measured {
    /// Mean square times seconds: the same for any count of samples where error is independent noise.
    fn cost(&self) -> f64 {
        self.judge.mean_square() * self.seconds
    }
}

/// The manifold with so many samples.
fn reference(scene: &Scene, frame: &Frame, samples: u32, settings: &Settings) -> Result<Judge, BenchError> {
    let mut scene = scene.clone();
    scene.render.caustics = Some(Caustics::Manifold);
    (scene.render.samples, scene.render.seed) = (samples, REFERENCE_SEED);
    Judge::new(luminance(&Built::new(&scene, frame, settings)?.render(frame, settings)?.0))
}

/// Renders a scene `rounds` times, each with a seed of its own.
fn measure(scene: &Scene, frame: &Frame, truth: &Judge, settings: &Settings) -> Result<Measured, BenchError> {
    let (mut judge, mut seconds) = (truth.clone(), Vec::new());
    for round in 0..if settings.quick { 2 } else { 3 } {
        let mut scene = scene.clone();
        scene.render.seed = 1 + round;
        let (picture, took) = Built::new(&scene, frame, settings)?.render(frame, settings)?;
        judge.add(&luminance(&picture));
        seconds.push(took);
    }
    Ok(Measured { judge, seconds: median(&mut seconds) })
}

pub(super) fn run(settings: &Settings, sheet: &mut Sheet) -> Result<(), BenchError> {
    let size = across(settings, 32, 64);
    let frame = pool::frame();
    let columns = size_name([frame.columns.nx, frame.columns.nz]);
    sheet.say(&format!(
        "\nCaustics on a pool's floor, {size}x{size} pixels, the sun alone: error of luminance over its mean, the mean over \
         the reference's, and 1 / (mean square * seconds) against the last line of `off`"
    ))?;
    for (surface, roughness) in [("smooth", 0.0), ("roughness 0.03", 0.03)] {
        let mut scene = pool::sun_only(size, roughness);
        let truth = reference(&scene, &frame, if settings.quick { 128 } else { 1024 }, settings)?;
        sheet.table(&[surface, "samples", "seconds", "relative error", "mean ratio", "+-", "at equal time"])?;
        let mut baseline = None;
        for method in &METHODS {
            let counts = if settings.quick { method.quick } else { method.full };
            let mut lines = Vec::new();
            for &samples in counts {
                scene.render.caustics = Some(method.caustics);
                scene.render.samples = samples;
                lines.push((samples, measure(&scene, &frame, &truth, settings)?));
            }
            let cost = *baseline.get_or_insert_with(|| lines.last().map_or(0.0, |(_, last)| last.cost()));
            for (samples, measured) in lines {
                let [mean_ratio, mean_ratio_error] = measured.judge.mean_ratio();
                let row = Row {
                    bench: "light-caustics".to_owned(),
                    columns: columns.clone(),
                    rays: format!("caustics, {surface}"),
                    dial: method.name.to_owned(),
                    setting: format!("{samples} samples"),
                    value: samples.into(),
                    seconds: measured.seconds,
                    error_rms: measured.judge.relative(),
                    mean_ratio,
                    mean_ratio_error,
                    ratio: if measured.cost() > 0.0 { cost / measured.cost() } else { 0.0 },
                    threads: settings.threads,
                    ..Row::default()
                };
                let mut cells = vec![method.name.to_owned(), samples.to_string(), number(row.seconds)];
                cells.extend([number(row.error_rms), format!("{mean_ratio:.4}")]);
                cells.extend([mean_ratio_error, row.ratio].map(number));
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
    fn the_manifold_is_far_better_than_chance_and_both_are_right() {
        let settings = Settings { quick: true, ..Settings::default() };
        let frame = pool::frame();
        let mut scene = pool::sun_only(16, 0.03);
        let truth = reference(&scene, &frame, 128, &settings).unwrap();
        let mut measured = |caustics: Caustics, samples: u32, truth: &Judge| {
            (scene.render.caustics, scene.render.samples) = (Some(caustics), samples);
            measure(&scene, &frame, truth, &settings).unwrap()
        };
        let (blind, exact) = (measured(Caustics::Off, 128, &truth), measured(Caustics::Manifold, 8, &truth));
        assert!(
            exact.judge.relative() < 0.5 * blind.judge.relative(),
            "{} {}",
            exact.judge.relative(),
            blind.judge.relative()
        );
        for measured in [blind, exact] {
            let [ratio, error] = measured.judge.mean_ratio();
            assert!((ratio - 1.0).abs() < 4.0 * error + 0.02, "{ratio} +- {error}");
            assert!(measured.seconds > 0.0);
        }
    }
}
