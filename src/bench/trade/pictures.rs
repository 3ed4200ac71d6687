//! Dials of a whole picture: x is the seconds of a render, y the difference of linear light to the dial's finest setting.
//!
//! A small made-up scene. A new dial is one entry: how it is set, its places, and the place that the others are held
//! against.

use crate::bench::pictures::{self, Built};
use crate::bench::rows::Row;
use crate::bench::sheet::{Sheet, number};
use crate::bench::{BenchError, Settings, median, size_name};
use crate::scene::{Fresnel, Representation, Scene};

/// A dial and where it stands.
struct Dial {
    name: &'static str,
    /// The place that the others are held against.
    finest: f64,
    /// The others.
    values: &'static [f64],
    set: fn(&mut Scene, f64),
    show: fn(f64) -> String,
}

const DIALS: &[Dial] = &[
    Dial {
        name: "recursion depth",
        finest: 24.0,
        values: &[0.0, 1.0, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0],
        set: |scene, value| scene.render.depth = value as u32,
        show: |value| value.to_string(),
    },
    Dial {
        name: "samples per pixel",
        finest: 256.0,
        values: &[1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0],
        set: |scene, value| scene.render.samples = value as u32,
        show: |value| value.to_string(),
    },
    Dial {
        name: "Fresnel",
        finest: 1.0,
        values: &[0.0, 1.0],
        set: |scene, value| scene.water.fresnel = if value == 0.0 { Fresnel::Schlick } else { Fresnel::Exact },
        show: |value| if value == 0.0 { "Schlick".to_owned() } else { "exact".to_owned() },
    },
    Dial {
        name: "accuracy in pixels",
        finest: 1e-6,
        values: &[10.0, 3.0, 1.0, 0.3, 0.1, 0.03, 0.01, 0.001],
        set: |scene, value| scene.surface.accuracy = value,
        show: |value| format!("{value} px"),
    },
    Dial {
        name: "accuracy of secondary rays",
        finest: 1.0,
        values: &[1000.0, 100.0, 16.0, 4.0, 1.0],
        set: |scene, value| scene.surface.secondary_accuracy = value,
        show: |value| format!("{value} times"),
    },
    Dial {
        name: "tessellation of the water",
        finest: 0.0,
        values: &[1.0, 2.0, 4.0, 8.0, 16.0],
        set: |scene, value| {
            if value > 0.0 {
                scene.surface.representation = Representation::Tessellated;
                scene.surface.samples = value as u32;
            }
        },
        show: |value| if value == 0.0 { "exact".to_owned() } else { format!("{value}x{value}") },
    },
];

pub(super) fn run(settings: &Settings, sheet: &mut Sheet) -> Result<(), BenchError> {
    let (columns, particles) = ([80, 20], 2_800);
    let across = match settings.rays {
        Some(rays) => (rays.isqrt() as u32).clamp(8, 320),
        None if settings.quick => 96,
        None => 320,
    };
    let frame = pictures::frame(columns, particles);
    let mut base = pictures::scene(&frame, [across, across * 9 / 16]);
    base.render.samples = 4;
    sheet.say(&format!(
        "\nPictures of {across} pixels across: difference of linear light to each dial's finest setting"
    ))?;
    sheet.table(&["dial", "setting", "seconds", "rms", "max"])?;
    for dial in DIALS {
        let build = |value: f64| {
            let mut scene = base.clone();
            (dial.set)(&mut scene, value);
            Built::new(&scene, &frame, settings)
        };
        // With few samples asked for, the finest is four times the finest of the others: enough to judge them by.
        let finest = build(dial.finest)?.render(&frame, settings)?.0;
        let places = dial.values.iter().map(|&value| build(value)).collect::<Result<Vec<_>, _>>()?;
        let mut seconds = vec![Vec::new(); places.len()];
        let mut errors = vec![[0.0; 2]; places.len()];
        for _ in 0..settings.rounds().min(3) {
            for (index, place) in places.iter().enumerate() {
                let (picture, took) = place.render(&frame, settings)?;
                seconds[index].push(took);
                errors[index] = pictures::difference(&picture, &finest);
            }
        }
        for (index, &value) in dial.values.iter().enumerate() {
            let row = Row {
                bench: "trade".to_owned(),
                columns: size_name(columns),
                order: 3,
                accel: places[index].accel.stats().name,
                solver: base.surface.solver.name().to_owned(),
                rays: "picture".to_owned(),
                dial: dial.name.to_owned(),
                setting: (dial.show)(value),
                value,
                seconds: median(&mut seconds[index]),
                error_rms: errors[index][0],
                error_max: errors[index][1],
                particles,
                threads: settings.threads,
                ..Row::default()
            };
            let figures = [row.seconds, row.error_rms, row.error_max].map(number);
            sheet.row(&[&[dial.name.to_owned(), row.setting.clone()], &figures[..]].concat(), row)?;
        }
    }
    Ok(())
}
