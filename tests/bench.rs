//! `whitewater bench` from end to end at tiny sizes: fields, names and errors of its rows. Never its times.

use std::path::Path;
use std::process::{Command, Output};

use serde_json::Value;

/// What every row says, whichever benchmark wrote it.
const FIELDS: [&str; 19] = [
    "bench",
    "columns",
    "order",
    "accel",
    "solver",
    "batch",
    "rays",
    "mrays_per_s",
    "ratio",
    "lost",
    "false",
    "wrong",
    "tangent",
    "bytes_per_column",
    "build_ms",
    "threads",
    "machine",
    "commit",
    "cpu_features",
];

fn bench(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_whitewater")).arg("bench").args(arguments).output().expect("the program starts")
}

/// The rows of a benchmark, checked as far as all are alike.
fn rows(arguments: &[&str], more: &[&Path]) -> Vec<Value> {
    let directory = tempfile::tempdir().expect("a folder");
    let (json, csv) = (directory.path().join("rows.json"), directory.path().join("rows.csv"));
    let paths = [json.to_str().expect("a plain path"), csv.to_str().expect("a plain path")];
    let more = more.iter().flat_map(|path| ["--plot", path.to_str().expect("a plain path")]);
    let mut all: Vec<&str> = arguments.to_vec();
    all.extend(["--quick", "--json", paths[0], "--csv", paths[1]]);
    all.extend(more);
    let output = bench(&all);
    assert!(output.status.success(), "{all:?}: {}", String::from_utf8_lossy(&output.stderr));
    let rows: Vec<Value> = serde_json::from_str(&std::fs::read_to_string(&json).expect("rows")).expect("JSON");
    assert!(!rows.is_empty());
    let lines = std::fs::read_to_string(&csv).expect("rows").lines().count();
    assert_eq!(lines, rows.len() + 1, "a head and every row");
    for row in &rows {
        let row = row.as_object().expect("flat objects");
        assert!(FIELDS.iter().all(|field| row.contains_key(*field)), "{row:?}");
        assert!(row.values().all(|value| !value.is_object() && !value.is_array()), "{row:?}");
        for (field, value) in row {
            if let Some(number) = value.as_f64() {
                assert!(number >= 0.0, "{field}: {number}");
            }
            // NaN and infinity would be null.
            assert!(!value.is_null(), "{field} of {row:?}");
        }
    }
    rows
}

fn text<'a>(row: &'a Value, field: &str) -> &'a str {
    row[field].as_str().expect("text")
}

fn number(row: &Value, field: &str) -> f64 {
    row[field].as_f64().expect("a number")
}

/// Solvers and accelerators that promise right answers; the report's own do not.
fn is_right(row: &Value) -> bool {
    let (solver, accel) = (text(row, "solver"), text(row, "accel"));
    solver != "report" && !matches!(accel, "columns" | "bsp-report") && !accel.starts_with("triangles")
}

fn no_errors(row: &Value) {
    for field in ["lost", "false", "wrong"] {
        assert_eq!(number(row, field), 0.0, "{field}: {row}");
    }
}

#[test]
fn surface_has_every_solver_accelerator_and_class() {
    let directory = tempfile::tempdir().expect("a folder");
    let rows = rows(&["surface", "--columns", "24x16", "--rays", "2000", "--threads", "2"], &[directory.path()]);
    for class in ["primary", "incoherent", "grazing", "occlusion", "sun"] {
        let of_class: Vec<&Value> = rows.iter().filter(|row| text(row, "rays") == class).collect();
        let first = of_class[0];
        assert_eq!(
            (text(first, "accel"), first["batch"].as_bool(), number(first, "ratio")),
            ("triangles", Some(false), 1.0)
        );
        for solver in ["univariate", "newton", "reference"] {
            for accel in ["embree", "stream"] {
                let is = |row: &&&Value| text(row, "solver") == solver && text(row, "accel") == accel;
                let row = of_class.iter().find(is).unwrap_or_else(|| panic!("{solver} through {accel}, {class}"));
                assert!(number(row, "mrays_per_s") > 0.0 && number(row, "checked") > 500.0, "{row}");
            }
        }
        assert!(of_class.iter().any(|row| text(row, "accel") == "brute"));
        of_class.iter().filter(|row| is_right(row)).for_each(|row| no_errors(row));
    }
    assert!(rows.iter().all(|row| text(row, "columns") == "24x16"));
    assert!(rows.iter().any(|row| text(row, "bench") == "surface-build" && number(row, "bytes_per_column") > 1.0));
    for name in ["surface.svg", "surface.png"] {
        assert!(directory.path().join(name).metadata().expect(name).len() > 5000, "{name}");
    }
}

#[test]
fn any_count_of_rays_is_audited() {
    let rows = rows(&["surface", "--columns", "16x16", "--rays", "1000", "--audit", "4321"], &[]);
    let checked: Vec<f64> = rows
        .iter()
        .filter(|row| text(row, "accel") == "stream" && text(row, "solver") == "univariate")
        .map(|row| number(row, "checked"))
        .filter(|checked| *checked > 0.0)
        .collect();
    assert_eq!(checked.len(), 10, "five classes, sixteen at a time and one");
    assert!(checked.iter().all(|checked| *checked == 4321.0), "{checked:?}");
}

#[test]
fn particles_have_every_structure_and_the_reports_tree_loses() {
    let rows = rows(&["particles", "--particles", "20000", "--rays", "5000"], &[]);
    let of = |accel: &str, shape: &str| {
        let is = |row: &&Value| text(row, "accel") == accel && text(row, "shape") == shape;
        rows.iter().filter(is).collect::<Vec<_>>()
    };
    for shape in ["spheres", "discs"] {
        for accel in ["embree", "bsp", "bsp-sah", "bsp-report", "brute"] {
            assert!(of(accel, shape).len() >= 3, "{accel} {shape}");
        }
        for accel in ["bsp", "bsp-sah", "brute"] {
            of(accel, shape).into_iter().for_each(no_errors);
        }
    }
    let lost: f64 = of("bsp-report", "spheres").iter().map(|row| number(row, "lost") + number(row, "wrong")).sum();
    assert!(lost > 0.0, "straddlers are not missed");
    let bytes = number(of("embree", "spheres")[0], "bytes_per_particle");
    assert!((20.0..100.0).contains(&bytes), "{bytes}");
}

#[test]
fn trade_shows_errors_falling_along_every_dial() {
    let rows = rows(&["trade", "--columns", "16x16", "--rays", "1000"], &[]);
    let dial = |name: &str| rows.iter().filter(|row| text(row, "dial") == name).collect::<Vec<_>>();
    for name in ["tolerance, univariate", "triangles", "grid", "subdivision", "samples per pixel", "recursion depth"] {
        let curve = dial(name);
        let [first, last] = [curve[0], curve[curve.len() - 1]].map(|row| number(row, "error_rms"));
        assert!(first > 3.0 * last, "{name}: {first} {last}");
        assert!(curve.iter().all(|row| number(row, "seconds") > 0.0));
    }
    // What was asked for is what comes, down to single precision's end at these distances.
    for row in dial("tolerance, univariate") {
        assert!(number(row, "error_max") <= number(row, "value").max(2e-5), "{row}");
    }
    let fresnel = dial("Fresnel");
    assert!(number(fresnel[0], "error_rms") > 0.0 && number(fresnel[1], "error_rms") == 0.0);
    assert_eq!(dial("order").len(), 3);
    assert_eq!(dial("precision").len(), 2);
}

#[test]
fn report_has_table_6_1_row_by_row() {
    let sizes = ["--columns", "24x16", "--columns", "32x24", "--particles", "50", "--particles", "80"];
    let rows = rows(&[&["report", "--rays", "400"], &sizes[..]].concat(), &[]);
    let their = |dial: &str, setting: &str| {
        let is = |row: &&Value| text(row, "dial") == dial && text(row, "setting") == setting;
        let row = rows.iter().find(is).unwrap_or_else(|| panic!("{dial}, {setting}"));
        let (theirs, ours, ratio) = (number(row, "their_ms"), number(row, "our_ms"), number(row, "ratio"));
        assert!(ours > 0.0 && (ratio - theirs / ours).abs() < 1e-9 * ratio, "{row}");
        theirs
    };
    for (dial, setting, milliseconds) in [
        ("original representation", "small first", 60.0),
        ("original representation", "large next", 500.0),
        ("gluNURBS", "small next", 1400.0),
        ("new implementation", "large first", 9000.0),
        ("raytracing", "small", 380_000.0),
        ("raytracing", "large", 540_000.0),
        ("raytracing (surface only)", "large", 4_780_000.0),
        ("raytracing (spheres only)", "small", 104_000.0),
        ("raytracing (billboards only)", "large", 1_400_000.0),
    ] {
        assert_eq!(their(dial, setting), milliseconds);
    }
}

#[test]
fn extremes_lose_nothing_where_single_precision_reaches() {
    let rows = rows(&["extremes", "--columns", "16x16", "--rays", "300"], &[]);
    for axis in ["scale", "offset", "distance", "steepness"] {
        assert!(rows.iter().filter(|row| text(row, "dial") == axis).count() > 20, "{axis}");
    }
    for row in rows.iter().filter(|row| text(row, "dial") == "scale" && is_right(row)) {
        no_errors(row);
        assert!(number(row, "error_rms") < 1e-5, "{row}");
    }
}

#[test]
fn threads_and_leaks_say_what_ran() {
    let on_threads = rows(&["threads", "--columns", "16x16", "--rays", "500", "--threads", "3"], &[]);
    let counts: Vec<f64> = on_threads.iter().take(3).map(|row| number(row, "threads")).collect();
    assert_eq!(counts, [1.0, 2.0, 3.0]);
    assert_eq!(number(&on_threads[0], "ratio"), 1.0);
    let leaks = rows(&["leaks", "--columns", "16x16", "--rays", "9000", "--simd", "portable"], &[]);
    assert_eq!(leaks.len(), 9, "three waters, three orders, the one kernel asked for");
    for row in leaks {
        assert_eq!((text(&row, "simd"), number(&row, "checked"), number(&row, "lost")), ("portable", 1000.0, 0.0));
    }
}

#[test]
fn light_has_every_table_and_the_manifold_beats_chance() {
    let directory = tempfile::tempdir().expect("a folder");
    let rows = rows(&["light", "--columns", "40x20", "--rays", "300"], &[directory.path()]);
    let of = |bench: &str| rows.iter().filter(|row| text(row, "bench") == bench).collect::<Vec<_>>();
    for surface in ["caustics, smooth", "caustics, roughness 0.03"] {
        let caustics: Vec<&Value> =
            of("light-caustics").into_iter().filter(|row| text(row, "rays") == surface).collect();
        let best = |dial: &str| {
            let of_method = caustics.iter().filter(|row| text(row, "dial") == dial);
            of_method.map(|row| number(row, "error_rms")).fold(f64::INFINITY, f64::min)
        };
        assert!(best("manifold") < 0.5 * best("off") && best("beams") < best("off"), "{surface}: {caustics:?}");
        for row in caustics.iter().filter(|row| text(row, "dial") == "manifold") {
            let (ratio, error) = (number(row, "mean_ratio"), number(row, "mean_ratio_error"));
            assert!((ratio - 1.0).abs() < 4.0 * error + 0.03, "{row}");
        }
    }
    for row in of("light-frames") {
        match text(row, "dial") {
            "off" => assert_eq!(number(row, "queries"), 0.0, "{row}"),
            "manifold" => assert!(number(row, "queries") > 0.0 && number(row, "solutions") > 0.0, "{row}"),
            _ => {}
        }
        assert!(number(row, "seconds") > 0.0 && number(row, "ratio") > 0.0);
    }
    let path: Vec<&Value> = of("light-integrators").into_iter().filter(|row| text(row, "dial") == "path").collect();
    assert!(number(path[1], "error_rms") > number(path[path.len() - 1], "error_rms"));
    assert!(number(path[path.len() - 1], "falls_as") > 0.2);
    assert_eq!(of("light-samplers").len(), 8, "two pictures, two counts, pixels and blocks");
    assert!(of("light-samplers").iter().all(|row| number(row, "ratio") > 0.0));
    assert_eq!(of("light-profile").len(), 6, "two frames, three integrators");
    assert!(of("light-profile").iter().all(|row| number(row, "value") > 300.0 && number(row, "ratio") > 0.0));
    assert!(directory.path().join("light.svg").metadata().expect("light.svg").len() > 5000);
}

#[test]
fn options_without_use_are_refused() {
    for (arguments, message) in [
        (
            ["leaks", "--plot", "somewhere"],
            "--plot: expected one of the benchmarks surface, particles, trade, extremes",
        ),
        (["sim", "--rays", "5"], "--rays: expected one of"),
        (["threads", "--audit", "5"], "--audit: expected one of"),
        (
            ["surface", "--particles", "5"],
            "--particles: expected one of the benchmarks particles, report, spray, not surface",
        ),
    ] {
        let output = bench(&arguments);
        assert_eq!(output.status.code(), Some(2));
        let error = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(error.contains(message), "{error}");
    }
}
