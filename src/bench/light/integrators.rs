//! Both integrators on the small water: seconds for a sample of every pixel, and how error falls with samples.
//!
//! Each is held against a reference of its own, since they do not show the same light. One sample stands in the pixel's
//! middle and is no estimate of its mean, so the law is taken from two samples up.

use super::{Judge, REFERENCE_SEED, across, falls_as, luminance};
use crate::bench::pictures::{self, Built};
use crate::bench::rows::Row;
use crate::bench::sheet::{Sheet, number};
use crate::bench::{BenchError, Settings, median, size_name};
use crate::scene::{Integrator, Scene};
use crate::state::Frame;

const INTEGRATORS: [(&str, Integrator); 2] = [("path", Integrator::Path), ("whitted", Integrator::Whitted)];

/// Seconds and judged pictures for each count of samples, against `reference` samples.
fn measure(
    scene: &Scene,
    frame: &Frame,
    counts: &[u32],
    reference: u32,
    settings: &Settings,
) -> Result<Vec<(u32, f64, Judge)>, BenchError> {
    let render = |samples: u32, seed: u32| {
        let mut scene = scene.clone();
        (scene.render.samples, scene.render.seed) = (samples, seed);
        let (picture, seconds) = Built::new(&scene, frame, settings)?.render(frame, settings)?;
        Ok::<_, BenchError>((luminance(&picture), seconds))
    };
    let truth = Judge::new(render(reference, REFERENCE_SEED)?.0)?;
    let one = |&samples: &u32| {
        let (mut judge, mut seconds) = (truth.clone(), Vec::new());
        for round in 0..settings.rounds().min(3) {
            let (picture, took) = render(samples, 1 + round as u32)?;
            judge.add(&picture);
            seconds.push(took);
        }
        Ok((samples, median(&mut seconds), judge))
    };
    counts.iter().map(one).collect()
}

/// The power of samples that error falls with.
fn law(lines: &[(u32, f64, Judge)]) -> f64 {
    let many = lines.iter().filter(|(samples, ..)| *samples > 1);
    falls_as(&many.map(|(samples, _, judge)| (f64::from(*samples), judge.relative())).collect::<Vec<_>>())
}

pub(super) fn run(settings: &Settings, sheet: &mut Sheet) -> Result<(), BenchError> {
    let across = across(settings, 48, 128);
    let columns = settings.sizes.first().copied().unwrap_or([80, 20]);
    let frame = pictures::frame(columns, 2_800);
    let (counts, reference): (&[u32], _) =
        if settings.quick { (&[1, 4, 16, 64], 512) } else { (&[1, 2, 4, 8, 16, 32, 64, 128, 256], 4096) };
    sheet.say(&format!(
        "\nIntegrators on the small water, {across} pixels across: error of luminance over its mean against {reference} \
         samples of the same integrator"
    ))?;
    sheet.table(&["integrator", "samples", "seconds", "ms a sample", "relative error", "falls as samples^-"])?;
    for (name, integrator) in INTEGRATORS {
        let mut scene = pictures::scene(&frame, [across, across * 9 / 16]);
        scene.render.integrator = integrator;
        let lines = measure(&scene, &frame, counts, reference, settings)?;
        let falls_as = law(&lines);
        for (k, (samples, seconds, judge)) in lines.iter().enumerate() {
            let is_last = k + 1 == lines.len();
            let row = Row {
                bench: "light-integrators".to_owned(),
                columns: size_name(columns),
                rays: "integrators, small water".to_owned(),
                dial: name.to_owned(),
                setting: format!("{samples} samples"),
                value: f64::from(*samples),
                seconds: *seconds,
                error_rms: judge.relative(),
                falls_as: if is_last { falls_as } else { 0.0 },
                particles: frame.particles.position.len(),
                threads: settings.threads,
                ..Row::default()
            };
            let mut cells = vec![name.to_owned(), samples.to_string()];
            cells.extend([*seconds, 1e3 * seconds / f64::from(*samples), row.error_rms].map(number));
            cells.push(if is_last { format!("{falls_as:.2}") } else { String::new() });
            sheet.row(&cells, row)?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn error_falls_with_samples_by_the_measured_law() {
        let settings = Settings { quick: true, ..Settings::default() };
        let frame = pictures::frame([40, 20], 300);
        let mut scene = pictures::scene(&frame, [16, 9]);
        scene.render.integrator = Integrator::Path;
        let lines = measure(&scene, &frame, &[1, 4, 32], 256, &settings).unwrap();
        assert!(lines[2].2.relative() < lines[1].2.relative() && lines[1].2.relative() > 0.0);
        let expected = (lines[1].2.relative() / lines[2].2.relative()).ln() / 8.0_f64.ln();
        assert!((law(&lines) - expected).abs() < 1e-12, "{expected}");
        assert!(law(&lines) > 0.2, "{}", law(&lines));
    }
}
