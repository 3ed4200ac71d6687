//! How the path tracer's error falls with samples, over kinds of light: caustics, spray, murky and rough water, mist.
//!
//! There is no reference that would have to be far better than what it judges: two pictures with a seed each differ by √2
//! of what either is off its mean by. One sample stands in the pixel's middle and is no estimate of its mean, so the law is
//! taken from two up.

use super::{across, falls_as, luminance, pool};
use crate::bench::pictures::{self, Built};
use crate::bench::rows::Row;
use crate::bench::sheet::{Sheet, number};
use crate::bench::{BenchError, Settings, size_name};
use crate::scene::{Integrator, ParticleRepresentation, Scene, WaterPreset};
use crate::state::Frame;

/// Seeds of the two pictures.
const SEEDS: [u32; 2] = [1, 2];

/// What is rendered, and of which frame.
struct View {
    name: &'static str,
    scene: Scene,
    frame: Frame,
}

/// The scenes, `across` pixels wide.
fn views(across: u32, columns: [usize; 2]) -> [View; 4] {
    let size = [across, across * 9 / 16];
    let river = pictures::frame(columns, 2_800);
    let mut water = pictures::scene(&river, size);
    water.render.integrator = Integrator::Path;
    let mut mist = water.clone();
    mist.particles.representation = ParticleRepresentation::Mist;
    let mut murky = pool::view(size);
    murky.water.preset = Some(WaterPreset::Harbour);
    murky.water.roughness = 0.05;
    [
        View { name: "pool, its caustics", scene: pool::view(size), frame: pool::frame() },
        View { name: "rough pool of harbour water", scene: murky, frame: pool::frame() },
        View { name: "small water, its spray", scene: water, frame: river.clone() },
        View { name: "small water, its spray as mist", scene: mist, frame: river },
    ]
}

/// Samples, seconds of both pictures, and their error over their mean.
fn measure(view: &View, counts: &[u32], settings: &Settings) -> Result<Vec<(u32, f64, f64)>, BenchError> {
    let one = |&samples: &u32| {
        let mut pictures = Vec::new();
        let mut took = 0.0;
        for seed in SEEDS {
            let mut scene = view.scene.clone();
            (scene.render.samples, scene.render.seed) = (samples, seed);
            let (picture, seconds) = Built::new(&scene, &view.frame, settings)?.render(&view.frame, settings)?;
            pictures.push(luminance(&picture));
            took += seconds;
        }
        let count = pictures[0].len().max(1) as f64;
        let mean = pictures.iter().flatten().sum::<f64>() / (2.0 * count);
        if !(mean > 0.0) {
            return Err(BenchError::Internal(format!("{}: a mean luminance of {mean}, not above 0", view.name)));
        }
        let squares: f64 = pictures[0].iter().zip(&pictures[1]).map(|(a, b)| (a - b).powi(2)).sum();
        Ok((samples, took, (0.5 * squares / count).sqrt() / mean))
    };
    counts.iter().map(one).collect()
}

/// The power of samples that error falls with.
fn law(lines: &[(u32, f64, f64)]) -> f64 {
    let many = lines.iter().filter(|(samples, ..)| *samples > 1);
    falls_as(&many.map(|&(samples, _, error)| (f64::from(samples), error)).collect::<Vec<_>>())
}

pub(super) fn run(settings: &Settings, sheet: &mut Sheet) -> Result<(), BenchError> {
    let across = across(settings, 48, 48);
    let columns = settings.sizes.first().copied().unwrap_or([80, 20]);
    let counts: &[u32] =
        if settings.quick { &[1, 4, 16, 64, 256] } else { &[1, 2, 4, 8, 16, 32, 64, 128, 256, 512, 1024, 2048, 4096] };
    sheet.say(&format!(
        "\nConvergence of paths, {across} pixels across: error of luminance over its mean, from two pictures that differ in \
         their seed"
    ))?;
    sheet.table(&["scene", "samples", "seconds", "relative error", "error x samples^0.5", "falls as samples^-"])?;
    for view in views(across, columns) {
        let lines = measure(&view, counts, settings)?;
        let law = law(&lines);
        for (k, &(samples, seconds, error)) in lines.iter().enumerate() {
            let is_last = k + 1 == lines.len();
            let row = Row {
                bench: "light-convergence".to_owned(),
                columns: size_name([view.frame.columns.nx, view.frame.columns.nz]),
                rays: "convergence of paths".to_owned(),
                dial: view.name.to_owned(),
                setting: format!("{samples} samples"),
                value: f64::from(samples),
                seconds,
                error_rms: error,
                falls_as: if is_last { law } else { 0.0 },
                particles: view.frame.particles.position.len(),
                threads: settings.threads,
                ..Row::default()
            };
            let mut cells = vec![view.name.to_owned(), samples.to_string()];
            cells.extend([seconds, error, error * f64::from(samples).sqrt()].map(number));
            cells.push(if is_last { format!("{law:.2}") } else { String::new() });
            sheet.row(&cells, row)?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn error_falls_as_the_root_of_the_samples_or_faster_on_every_scene() {
        let settings = Settings { quick: true, ..Settings::default() };
        for view in views(16, [40, 20]) {
            let lines = measure(&view, &[1, 4, 16, 64], &settings).unwrap();
            // 144 pixels: their errors' own spread leaves the power uncertain by about 0.1.
            assert!(law(&lines) > 0.4, "{}: {lines:?}", view.name);
            assert!(lines.iter().all(|&(_, _, error)| error > 0.0), "{}: {lines:?}", view.name);
        }
    }

    #[test]
    #[ignore = "minutes: 4096 samples of every scene"]
    fn error_falls_as_the_root_of_up_to_4096_samples_or_faster() {
        for view in views(32, [80, 20]) {
            let lines = measure(&view, &[1, 4, 16, 64, 256, 1024, 4096], &Settings::default()).unwrap();
            assert!(law(&lines) > 0.47, "{}: {lines:?}", view.name);
        }
    }
}
