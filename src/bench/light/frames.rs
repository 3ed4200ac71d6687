//! What caustics add to a frame's time, and what their search does for it.

use super::{across, pool};
use crate::bench::pictures::{self, Built};
use crate::bench::rows::Row;
use crate::bench::sheet::{Sheet, number};
use crate::bench::{BenchError, Settings, median, size_name};
use crate::render::RenderStats;
use crate::scene::{Caustics, Integrator, Scene};
use crate::state::Frame;

const INTEGRATORS: [(&str, Integrator); 2] = [("path", Integrator::Path), ("whitted", Integrator::Whitted)];

/// Without, by the manifold with one search a pixel and with one a sample, by beams.
const CAUSTICS: [(&str, Caustics, Option<u32>); 4] = [
    ("off", Caustics::Off, None),
    ("manifold, 1 a pixel", Caustics::Manifold, Some(1)),
    ("manifold", Caustics::Manifold, None),
    ("beams", Caustics::Beams, None),
];

/// The camera's samples of a pixel.
const SAMPLES: u32 = 16;

/// Frames of each of [`CAUSTICS`] in turns: median seconds, median of the rounds' ratios to the first, and the last
/// frame's counts.
fn measure(scene: &Scene, frame: &Frame, settings: &Settings) -> Result<[(f64, f64, RenderStats); 4], BenchError> {
    let mut taken = [const { (Vec::new(), Vec::new()) }; 4];
    let mut stats = [const { None }; 4];
    let mut built = Vec::new();
    for (_, caustics, searches) in CAUSTICS {
        let mut scene = scene.clone();
        scene.render.samples = SAMPLES;
        scene.render.caustic_samples = searches;
        scene.render.caustics = Some(caustics);
        built.push(Built::new(&scene, frame, settings)?);
    }
    // The map of beams takes long for its few samples: a quick run cannot wait for it often.
    for round in 0..=if settings.quick { 2 } else { settings.rounds() } {
        let mut without = 1.0;
        for (k, built) in built.iter().enumerate() {
            let (_, took) = built.render_counted(frame, settings)?;
            if k == 0 {
                without = took.seconds;
            }
            // The first round warms caches and clocks.
            if round > 0 {
                taken[k].0.push(took.seconds);
                taken[k].1.push(took.seconds / without);
            }
            stats[k] = Some(took);
        }
    }
    let mut stats = stats.into_iter();
    Ok(taken.map(|(mut seconds, mut ratios)| {
        (median(&mut seconds), median(&mut ratios), stats.next().flatten().unwrap_or_default())
    }))
}

pub(super) fn run(settings: &Settings, sheet: &mut Sheet) -> Result<(), BenchError> {
    let across = across(settings, 48, 320);
    let size = [across, across * 9 / 16];
    let river = settings.sizes.first().copied().unwrap_or([80, 20]);
    let river = pictures::frame(river, 2_800);
    let scenes = [("pool", pool::view(size), pool::frame()), ("small water", pictures::scene(&river, size), river)];
    sheet.say(&format!(
        "\nFrames of {across} pixels across at {SAMPLES} samples a pixel: time against the same frame without caustics, and the \
         search for a point"
    ))?;
    sheet.table(&["frame", "caustics", "seconds", "to off", "queries", "cells each", "ways each", "gave up each"])?;
    for (name, scene, frame) in &scenes {
        for (integrator_name, integrator) in INTEGRATORS {
            let mut scene = scene.clone();
            scene.render.integrator = integrator;
            let measured = measure(&scene, frame, settings)?;
            for ((caustics, ..), (seconds, ratio, stats)) in CAUSTICS.into_iter().zip(measured) {
                let found = stats.paths.manifold;
                let row = Row {
                    bench: "light-frames".to_owned(),
                    columns: size_name([frame.columns.nx, frame.columns.nz]),
                    rays: format!("{name}, {integrator_name}"),
                    dial: caustics.to_owned(),
                    seconds,
                    ratio,
                    queries: found.queries,
                    cells: found.cells,
                    solutions: found.solutions,
                    gave_up: found.gave_up,
                    particles: frame.particles.position.len(),
                    threads: settings.threads,
                    ..Row::default()
                };
                let each = |count: u64| number(count as f64 / found.queries.max(1) as f64);
                let mut cells = vec![row.rays.clone(), caustics.to_owned(), number(seconds), number(ratio)];
                cells.push(found.queries.to_string());
                cells.extend([found.cells, found.solutions, found.gave_up].map(each));
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
    fn only_caustics_search_and_the_manifold_finds() {
        let settings = Settings { quick: true, ..Settings::default() };
        let [off, one, manifold, beams] = measure(&pool::view([16, 9]), &pool::frame(), &settings).unwrap();
        assert_eq!(off.1, 1.0);
        assert!(manifold.0 > 0.0 && beams.0 > 0.0);
        let searched = |stats: &RenderStats| stats.paths.manifold.queries;
        // Beams serve the bed; points elsewhere (walls, spray) are still searched for.
        assert!(searched(&off.2) == 0 && searched(&beams.2) < searched(&manifold.2));
        assert!(0 < searched(&one.2) && searched(&one.2) < searched(&manifold.2));
        let found = manifold.2.paths.manifold;
        assert!(
            found.queries >= 144 && found.solutions > found.queries / 4 && found.cells > found.queries,
            "{found:?}"
        );
    }
}
