//! Scenes with everything in them, resolved.

use super::*;
use crate::scene::{Body, Edge, PressedRegion, Sink, Source};

fn flat() -> Simulation {
    let mut settings = Simulation::default();
    settings.terrain.columns = Some([6, 4]);
    settings.terrain.width = Some([1.0, 1.0]);
    settings.terrain.slope = 0.1;
    settings.terrain.lowest = Some(0.0);
    settings
}

fn setup(settings: &Simulation) -> Setup {
    prepare(settings, Path::new("nowhere")).unwrap()
}

fn message(settings: &Simulation) -> String {
    prepare(settings, Path::new("nowhere")).unwrap_err().to_string()
}

#[test]
fn the_start_is_the_highest_water_asked_for_and_never_below_the_ground() {
    let mut settings = flat();
    settings.water.level = Some(0.3);
    settings.water.depth = Some(0.05);
    settings.water.body = vec![
        Body { edge: Some(Edge::West), level: Some(0.6), ..Body::default() },
        Body { rectangle: Some([0.9, -0.1, 1.1, 0.1]), depth: Some(2.0), ..Body::default() },
        Body { rectangle: Some([4.9, -0.1, 5.1, 0.1]), depth: Some(0.01), ..Body::default() },
    ];
    let Setup { grid, base, depth, .. } = setup(&settings);
    assert_eq!((grid.nx, grid.nz, grid.width, grid.origin), (6, 4, [1.0, 1.0], [0.0, 0.0]));
    for (found, expected) in base[..6].iter().zip([0.5, 0.4, 0.3, 0.2, 0.1, 0.0]) {
        assert!((found - expected).abs() < 1e-12);
    }
    for (found, expected) in depth[..6].iter().zip([0.1, 2.0, 0.05, 0.1, 0.2, 0.3]) {
        assert!((found - expected).abs() < 1e-12, "{depth:?}");
    }
    assert_eq!(depth[7], 0.05);
    // Water without a word about it: none.
    assert!(setup(&flat()).depth.iter().all(|depth| *depth == 0.0));
}

#[test]
fn sources_sinks_rain_and_pressure_arrive_with_their_times() {
    let mut settings = flat();
    settings.water.rain = 36.0;
    settings.water.rain_end = Some(7.0);
    settings.source = vec![
        Source { edge: Some(Edge::West), level: Some(0.75), begin: Some(-1.0), ..Source::default() },
        Source { edge: Some(Edge::North), discharge: Some(3.0), end: Some(5.0), ..Source::default() },
    ];
    settings.sink = vec![Sink { edge: Some(Edge::East), ..Sink::default() }];
    settings.sink.push(Sink { circle: Some([0.0, 3.0, 0.5]), level: Some(0.7), ..Sink::default() });
    settings.pressure = vec![PressedRegion { circle: Some([2.0, 1.0, 1.0]), pascal: 50.0, ..PressedRegion::default() }];
    let setup = setup(&settings);
    // The sink at the source's foot takes that column from it.
    let columns: Vec<_> = setup.held.iter().map(|held| (held.column, held.sink)).collect();
    assert_eq!(
        columns,
        [(0, false), (6, false), (12, false), (5, true), (11, true), (17, true), (23, true), (18, true)]
    );
    assert!((setup.held[0].depth - 0.25).abs() < 1e-12);
    assert_eq!((setup.held[0].begin, setup.held[0].end), (-1.0, f64::INFINITY));
    assert_eq!((setup.held[3].depth, setup.held[3].begin), (0.0, f64::NEG_INFINITY));
    assert!((setup.held[7].depth - 0.2).abs() < 1e-12);
    let inflow = Inflow { columns: vec![0, 1, 2, 3, 4], rate: 3.0, begin: f64::NEG_INFINITY, end: 5.0 };
    assert_eq!(setup.inflows, [inflow]);
    assert!((setup.rain_rate - 1e-5).abs() < 1e-18 && setup.rain_end == 7.0);
    assert_eq!(setup.pressures[0].columns, [2, 7, 8, 9, 14]);
    assert_eq!(setup.pressures[0].pascal, 50.0);
}

#[test]
fn a_source_leaves_ground_above_its_level_alone_and_a_sink_drains_it() {
    let mut settings = flat();
    settings.source = vec![Source { edge: Some(Edge::North), level: Some(0.25), ..Source::default() }];
    settings.sink = vec![Sink { edge: Some(Edge::South), level: Some(0.25), ..Sink::default() }];
    let held = setup(&settings).held;
    assert_eq!(held.iter().map(|held| held.column).collect::<Vec<_>>(), [3, 4, 5, 18, 19, 20, 21, 22, 23]);
    assert!(held[..3].iter().all(|held| held.depth > 0.0));
    assert!(held[3..6].iter().all(|held| held.depth == 0.0));
}

#[test]
fn what_cannot_be_names_its_key() {
    let source = |source: Source| Simulation { source: vec![source], ..flat() };
    let west = Source { edge: Some(Edge::West), ..Source::default() };
    for (settings, words) in [
        (source(west.clone()), ["simulation.source.0", "exactly one of"]),
        (
            source(Source { level: Some(1.0), depth: Some(1.0), ..west.clone() }),
            ["simulation.source.0", "exactly one of"],
        ),
        (source(Source { level: Some(0.2), ..west.clone() }), ["simulation.source.0: level 0.2 m", "is at 0.5 m"]),
        (
            source(Source { depth: Some(1.0), begin: Some(2.0), end: Some(2.0), ..west.clone() }),
            ["simulation.source.0", "begin 2 s"],
        ),
        (source(Source { edge: None, depth: Some(1.0), ..west.clone() }), ["simulation.source.0", "without a shape"]),
        (
            Simulation {
                sink: vec![Sink { edge: Some(Edge::West), ..Sink::default() }],
                ..source(Source { depth: Some(1.0), ..west })
            },
            ["simulation.source.0", "sink"],
        ),
        (
            Simulation {
                pressure: vec![PressedRegion { circle: Some([99.0, 0.0, 1.0]), ..PressedRegion::default() }],
                ..flat()
            },
            ["simulation.pressure.0", "circle [99.0, 0.0, 1.0]"],
        ),
        (
            Simulation {
                sink: vec![Sink { edge: Some(Edge::West), level: Some(0.0), depth: Some(0.0), ..Sink::default() }],
                ..flat()
            },
            ["simulation.sink.0", "both"],
        ),
        (Simulation { model: Some("rocks.state".to_owned()), ..flat() }, ["rocks.state", "nowhere"]),
    ] {
        let message = message(&settings);
        assert!(words.iter().all(|word| message.contains(word)), "{message} without {words:?}");
    }
    let mut body = flat();
    body.water.body = vec![Body { edge: Some(Edge::West), ..Body::default() }];
    assert!(message(&body).contains("simulation.water.body.0"), "{}", message(&body));
}

#[test]
fn a_depth_map_has_a_sample_for_each_column() {
    let folder = tempfile::tempdir().unwrap();
    let header = "xllcorner 0\nyllcorner 0\ncellsize 50\n";
    let write =
        |size: &str, rows: &str| std::fs::write(folder.path().join("d.asc"), format!("{size}{header}{rows}")).unwrap();
    let mut settings = flat();
    settings.water.depth_map = Some("d.asc".to_owned());
    settings.water.depth = Some(0.1);
    let found = |settings: &Simulation| prepare(settings, folder.path());

    write("ncols 6\nnrows 4\n", &"0 0 0 0.25 0 1\n".repeat(4));
    assert_eq!(found(&settings).unwrap().depth[6..12], [0.1, 0.1, 0.1, 0.25, 0.1, 1.0]);
    write("ncols 6\nnrows 4\n", &"0 0 0 0.25 0 -1\n".repeat(4));
    let error = found(&settings).unwrap_err().to_string();
    assert!(error.contains("simulation.water.depth_map") && error.contains("column 5, row 0"), "{error}");
    write("ncols 4\nnrows 6\n", &"0 0 0 0\n".repeat(6));
    let error = found(&settings).unwrap_err().to_string();
    assert!(error.contains("4 x 6") && error.contains("6 x 4"), "{error}");
}
