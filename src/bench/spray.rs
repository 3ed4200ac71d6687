//! What each representation of spray costs: whole frames against the same frame with plain spheres, in turns, and what a
//! million particles take to build.
//!
//! The scene is `bench::pictures`', made up in memory. How particles are traced, ray by ray, is `bench::particles`'.

use std::io::Write;

use super::pictures::{self, Built};
use super::rows::Row;
use super::sheet::{Sheet, number};
use super::{BenchError, Settings, median, size_name};
use crate::lower::Shape;
use crate::scene::{ParticleRepresentation, Scene};
use crate::state::Frame;

/// Every representation; spheres first, which the others are held against.
const ALL: [(&str, ParticleRepresentation); 6] = [
    ("spheres", ParticleRepresentation::Spheres),
    ("billboards", ParticleRepresentation::Billboards),
    ("streamlines", ParticleRepresentation::Streamlines),
    ("mist", ParticleRepresentation::Mist),
    ("surface", ParticleRepresentation::Surface),
    ("auto", ParticleRepresentation::Auto),
];

/// Runs both tables and prints them as they grow.
///
/// # Errors
/// Embree is missing, a picture cannot be rendered, or a file of rows cannot be written.
pub fn run(settings: &Settings, out: &mut impl Write) -> Result<(), BenchError> {
    let mut sheet = Sheet::new(settings, out)?;
    let counts = |quick: usize, full: usize| match &settings.particles[..] {
        [] if settings.quick => vec![quick],
        [] => vec![full],
        given => given.to_vec(),
    };
    let size = settings.sizes.first().copied().unwrap_or([400, 400]);
    for count in counts(20_000, 100_000) {
        frames(&pictures::frame(size, count), settings, &mut sheet)?;
    }
    for count in counts(100_000, 1_000_000) {
        builds(size, count, settings, &mut sheet)?;
    }
    Ok(())
}

fn represented(scene: &Scene, representation: ParticleRepresentation) -> Scene {
    let mut scene = scene.clone();
    scene.particles.representation = representation;
    scene
}

fn row(frame: &Frame, name: &str, settings: &Settings) -> Row {
    let columns = &frame.columns;
    Row {
        columns: size_name([columns.nx, columns.nz]),
        particles: frame.particles.position.len(),
        dial: name.to_owned(),
        threads: settings.threads,
        ..Row::default()
    }
}

/// Seconds of whole frames, each representation in turn, round by round.
fn frames(frame: &Frame, settings: &Settings, sheet: &mut Sheet) -> Result<(), BenchError> {
    let (across, samples) = if settings.quick { (120, 4) } else { (500, 16) };
    let mut scene = pictures::scene(frame, [across, across]);
    scene.render.samples = samples;
    let built: Vec<Built> = ALL
        .iter()
        .map(|&(_, representation)| Built::new(&represented(&scene, representation), frame, settings))
        .collect::<Result<_, _>>()?;
    let mut seconds = vec![Vec::new(); ALL.len()];
    let mut ratios = seconds.clone();
    // The first round warms caches and clocks.
    for round in 0..=settings.rounds().min(3) {
        let mut spheres = 0.0;
        for (k, built) in built.iter().enumerate() {
            let (_, taken) = built.render(frame, settings)?;
            if k == 0 {
                spheres = taken;
            }
            if round > 0 {
                seconds[k].push(taken);
                ratios[k].push(taken / spheres);
            }
        }
    }
    sheet.say(&format!(
        "\n{} particles, {across}x{across} pixels, {samples} samples, whitted; ratios to spheres",
        frame.particles.position.len()
    ))?;
    sheet.table(&["representation", "frame s", "ratio", "build s"])?;
    for (k, &(name, _)) in ALL.iter().enumerate() {
        let row = Row {
            bench: "spray-frame".to_owned(),
            seconds: median(&mut seconds[k]),
            ratio: median(&mut ratios[k]),
            build_ms: 1e3 * built[k].seconds,
            ..row(frame, name, settings)
        };
        let cells = [name.to_owned(), number(row.seconds), number(row.ratio), number(built[k].seconds)];
        sheet.row(&cells, row)?;
    }
    Ok(())
}

/// Particles that are joined at most: drops apart from each other take ten kilobytes of grid each, and no one joins a million
/// of them.
const MOST_JOINED: usize = 100_000;

/// Seconds from particles to something that rays can be sent into, water and ground with it; and the parts' primitives.
/// None are thinned.
fn builds(size: [usize; 2], count: usize, settings: &Settings, sheet: &mut Sheet) -> Result<(), BenchError> {
    let whole = pictures::frame(size, count);
    let few = (count > MOST_JOINED).then(|| pictures::frame(size, MOST_JOINED));
    sheet.say(&format!("\n{count} particles (of `surface` at most {MOST_JOINED}); seconds to build"))?;
    sheet.table(&["representation", "build s", "primitives"])?;
    for (name, representation) in ALL {
        let joined = representation == ParticleRepresentation::Surface;
        let frame = few.as_ref().filter(|_| joined).unwrap_or(&whole);
        let mut scene = represented(&pictures::scene(frame, [500, 500]), representation);
        (scene.particles.least_pixels, scene.particles.least_opacity) = (0.0, 0.0);
        let (mut seconds, mut primitives) = (Vec::new(), 0);
        for _ in 0..settings.rounds().min(3) {
            let built = Built::new(&scene, frame, settings)?;
            primitives = built.lowered.lowered.parts.iter().map(|part| primitives_of(&part.shape)).sum();
            seconds.push(built.seconds);
        }
        let row = Row {
            bench: "spray-build".to_owned(),
            value: primitives as f64,
            build_ms: 1e3 * median(&mut seconds),
            ..row(frame, name, settings)
        };
        let cells = [name.to_owned(), number(row.build_ms / 1e3), primitives.to_string()];
        sheet.row(&cells, row)?;
    }
    Ok(())
}

fn primitives_of(shape: &Shape) -> usize {
    match shape {
        Shape::Spheres(spheres) => spheres.center.len(),
        Shape::Discs(discs) => discs.center.len(),
        Shape::Curves(curves) => curves.ends.len(),
        Shape::Triangles(mesh) => mesh.index.len(),
        _ => 0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_representation_has_a_line_in_both_tables() {
        let settings = Settings { quick: true, particles: vec![500], sizes: vec![[40, 20]], ..Settings::default() };
        let mut out = Vec::new();
        run(&settings, &mut out).unwrap();
        let out = String::from_utf8(out).unwrap();
        for (name, _) in ALL {
            assert_eq!(out.lines().filter(|line| line.starts_with(&format!("{name} "))).count(), 2, "{name}\n{out}");
        }
        let spheres = out.lines().find(|line| line.starts_with("spheres ")).unwrap();
        assert_eq!(spheres.split_whitespace().nth(2), Some("1.00"), "{spheres}");
    }
}
