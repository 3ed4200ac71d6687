//! `whitewater inspect FILE…`: what simulation files hold, for people or as JSON.
//!
//! The figures are made in [`crate::state::summary`]; only their look lives here.

use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use crate::lower::{self, LowerError};
use crate::particles::Class;
use crate::scene::Scene;
use crate::simd::SimdLevel;
use crate::state::summary::{Extent, FrameSummary, ModelSummary, Range};
use crate::state::{self, Encoding, FileKind, StateError};

/// Why `inspect` did not show everything.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum InspectError {
    /// Some files could not be read; their errors have been printed, the other files were shown.
    #[error("{failed} of {all} files could not be read")]
    Unreadable {
        /// How many.
        failed: usize,
        /// Of how many.
        all: usize,
    },
    /// The answer could not be printed.
    #[error("printing failed: {0}")]
    Output(#[from] io::Error),
}

/// Prints what each file holds to standard output, and what is wrong with those that cannot be read to standard error.
///
/// # Errors
/// After all files were tried, if any could not be read. A reader that has gone (`inspect … | head`) is no error.
pub fn run(paths: &[PathBuf], dry_threshold: f64, json: bool, classes: bool) -> Result<(), InspectError> {
    let mut out = BufWriter::new(io::stdout().lock());
    match inspect(paths, dry_threshold, json, classes, &mut out, &mut io::stderr().lock()) {
        Err(InspectError::Output(error)) if error.kind() == io::ErrorKind::BrokenPipe => Ok(()),
        result => result,
    }
}

fn inspect(
    paths: &[PathBuf],
    dry_threshold: f64,
    as_json: bool,
    classes: bool,
    out: &mut impl Write,
    complaints: &mut impl Write,
) -> Result<(), InspectError> {
    let mut failed = 0;
    let mut list = Vec::new();
    let table = (!as_json && paths.len() > MOST_IN_FULL).then(|| Table::new(paths));
    if let Some(table) = &table {
        table.head(out)?;
    }
    for (i, path) in paths.iter().enumerate() {
        match look(path, dry_threshold, classes) {
            Ok(content) if as_json => list.push(content.json(path)),
            Ok(content) if let Some(table) = &table => table.row(path, &content, out)?,
            Ok(content) => {
                if i > 0 {
                    writeln!(out)?;
                }
                writeln!(out, "{}", path.display())?;
                for (label, text) in content.lines() {
                    writeln!(out, "  {label:<16}{text}")?;
                }
            }
            Err(error) => {
                failed += 1;
                list.push(json!({ "path": path, "error": error.to_string() }));
                // What was shown so far comes before the complaint, where both go to one terminal.
                out.flush()?;
                writeln!(complaints, "{error}")?;
            }
        }
    }
    if as_json {
        serde_json::to_writer_pretty(&mut *out, &list).map_err(io::Error::from)?;
        writeln!(out)?;
    }
    out.flush()?;
    match failed {
        0 => Ok(()),
        _ => Err(InspectError::Unreadable { failed, all: paths.len() }),
    }
}

/// More files than this get a line each.
const MOST_IN_FULL: usize = 3;

/// One line for each of many files.
struct Table<'a> {
    /// Of all files, if they have one.
    folder: Option<&'a Path>,
    /// Of the longest name.
    width: usize,
}

/// The columns of the table after the file's name: a title of two lines, and how wide it is.
const TITLES: [(&str, &str, usize); 9] = [
    ("time", "s", 9),
    ("columns", "", 11),
    ("wet", "%", 6),
    ("mean depth", "m", 11),
    ("greatest", "m", 9),
    ("fastest", "m/s", 9),
    ("water", "m3", 12),
    ("particles", "", 10),
    ("spray", "kg", 10),
];

impl<'a> Table<'a> {
    fn new(paths: &'a [PathBuf]) -> Self {
        let folder = paths[0].parent().filter(|folder| !folder.as_os_str().is_empty());
        let folder = folder.filter(|folder| paths.iter().all(|path| path.parent() == Some(*folder)));
        let mut table = Self { folder, width: 0 };
        table.width = paths.iter().map(|path| table.name(path).chars().count()).max().unwrap_or(0);
        table
    }

    fn name(&self, path: &Path) -> String {
        match (self.folder, path.file_name()) {
            (Some(_), Some(name)) => Path::new(name).display().to_string(),
            _ => path.display().to_string(),
        }
    }

    fn head(&self, out: &mut impl Write) -> io::Result<()> {
        if let Some(folder) = self.folder {
            writeln!(out, "{}", folder.display())?;
        }
        for line in [0, 1] {
            write!(out, "{:<width$}", "", width = self.width)?;
            for (title, unit, width) in TITLES {
                write!(out, " {:>width$}", if line == 0 { title } else { unit })?;
            }
            writeln!(out)?;
        }
        Ok(())
    }

    fn row(&self, path: &Path, content: &Content, out: &mut impl Write) -> io::Result<()> {
        write!(out, "{:<width$}", self.name(path), width = self.width)?;
        match content {
            Content::Model(model) => {
                let (panels, spheres, meshes) = (model.panels, model.spheres, model.meshes.len());
                writeln!(out, "   model: {panels} panels, {spheres} spheres, {meshes} meshes")
            }
            Content::Frame(_, frame, _) => {
                let [nx, nz] = frame.columns;
                let short = |value: f64| figure(four_digits(value));
                let texts = [
                    short(frame.time),
                    format!("{nx}x{nz}"),
                    format!("{:.1}", 100.0 * frame.wet_share),
                    short(frame.mean_depth.unwrap_or(0.0)),
                    short(frame.depth.map_or(0.0, |depth| depth.max)),
                    short(frame.flow_speed.map_or(0.0, |speed| speed.max)),
                    figure(frame.volume),
                    frame.particles.count.to_string(),
                    short(frame.particles.total_mass),
                ];
                for (text, (_, _, width)) in texts.iter().zip(TITLES) {
                    write!(out, " {text:>width$}")?;
                }
                writeln!(out)
            }
        }
    }
}

/// The nearest number of four significant digits.
fn four_digits(value: f64) -> f64 {
    format!("{value:.3e}").parse().unwrap_or(value)
}

/// What one file holds.
enum Content {
    Frame(Encoding, Box<FrameSummary>, Option<[f64; 5]>),
    Model(ModelSummary),
}

fn look(path: &Path, dry_threshold: f64, classes: bool) -> Result<Content, LookError> {
    Ok(match state::detect(path)? {
        FileKind::Frame(encoding) => {
            let summary = Box::new(FrameSummary::of_file(path, dry_threshold)?);
            let counts = if classes { Some(count_classes(path, dry_threshold)?) } else { None };
            Content::Frame(encoding, summary, counts)
        }
        FileKind::Model => Content::Model(ModelSummary::new(&state::read_model(path)?)),
    })
}

/// As a scene of nothing but this frame would have them.
fn count_classes(path: &Path, dry_threshold: f64) -> Result<[f64; 5], LookError> {
    let mut scene = Scene::default();
    scene.surface.dry_threshold = dry_threshold;
    let frame = state::read_frame(path, dry_threshold)?;
    lower::class_counts(&scene, &frame, SimdLevel::detect())
        .map_err(|error| LookError::Classes { path: path.to_path_buf(), error: Box::new(error) })
}

/// Why a file cannot be shown.
#[derive(Debug, thiserror::Error)]
enum LookError {
    #[error(transparent)]
    State(#[from] StateError),
    #[error("{}: --classes: {error}", path.display())]
    Classes { path: PathBuf, error: Box<LowerError> },
}

impl Content {
    fn json(&self, path: &Path) -> Value {
        match self {
            Content::Frame(encoding, frame, counts) => {
                let encoding = if *encoding == Encoding::Text { "text" } else { "npz" };
                let mut value = json!({ "path": path, "kind": "frame", "encoding": encoding, "frame": frame });
                if let Some(counts) = counts {
                    let named = Class::ALL.iter().zip(counts).map(|(class, &count)| (class.name(), count));
                    value["classes"] = named.collect();
                }
                value
            }
            Content::Model(model) => json!({ "path": path, "kind": "model", "model": model }),
        }
    }

    /// Labels and what stands after them.
    fn lines(&self) -> Vec<(&'static str, String)> {
        match self {
            Content::Frame(encoding, frame, counts) => {
                let mut lines = frame_lines(*encoding, frame);
                for (class, &count) in Class::ALL.iter().zip(counts.iter().flatten()) {
                    lines.push((class.name(), format!("{} of the particles", figure(count))));
                }
                lines
            }
            Content::Model(model) => model_lines(model),
        }
    }
}

fn frame_lines(encoding: Encoding, frame: &FrameSummary) -> Vec<(&'static str, String)> {
    let [nx, nz] = frame.columns;
    let mut lines = vec![
        (
            "kind",
            match encoding {
                Encoding::Text => "frame, text".to_string(),
                Encoding::Npz => "frame, NPZ".to_string(),
            },
        ),
        ("time", format!("{} s", figure(frame.time))),
        ("columns", format!("{nx} x {nz} = {}", nx * nz)),
        ("width", format!("{} x {} m", figure(frame.width[0]), figure(frame.width[1]))),
        ("origin", format!("x {}, z {} m", figure(frame.origin[0]), figure(frame.origin[1]))),
    ];
    lines.extend(extent_lines(&frame.extent, ["x", "y", "z"]));
    lines.push(("base", range(&frame.base, "m")));
    lines.push(("top", range(&frame.top, "m")));
    lines.push(("pressure", range(&frame.pressure, "Pa")));
    lines.push((
        "wet columns",
        format!("{} ({:.1} %, from {} m of depth)", frame.wet_columns, 100.0 * frame.wet_share, frame.dry_threshold),
    ));
    if let (Some(depth), Some(mean), Some(speed)) = (&frame.depth, frame.mean_depth, &frame.flow_speed) {
        lines.push(("depth", format!("{}, mean {} m", range(depth, "m"), figure(mean))));
        lines.push(("flow", range(speed, "m/s")));
    }
    lines.push(("water", format!("{} m3", figure(frame.volume))));
    let particles = &frame.particles;
    let identified = if particles.identified { ", with identities" } else { "" };
    lines.push(("particles", format!("{}{identified}", particles.count)));
    if let (Some(mass), Some(speed), Some(age), Some(extent)) =
        (&particles.mass, &particles.speed, &particles.age, &particles.extent)
    {
        lines.push(("  mass", format!("{} kg together, {} each", figure(particles.total_mass), range(mass, "kg"))));
        lines.push(("  speed", range(speed, "m/s")));
        lines.push(("  age", range(age, "s")));
        lines.extend(extent_lines(extent, ["  x", "  y", "  z"]));
    }
    for summary in &frame.maps {
        let map = &summary.map;
        lines.push((map.name, format!("{} ({})", range(&summary.range, map.unit).trim_end(), map.meaning)));
    }
    for array in &frame.extra {
        let shape = array.shape.iter().map(u64::to_string).collect::<Vec<_>>().join(" x ");
        let shape = if shape.is_empty() { "single".to_string() } else { shape };
        lines.push(("other array", format!("{}: {shape}, {}", array.name.escape_debug(), array.dtype.escape_debug())));
    }
    lines
}

fn model_lines(model: &ModelSummary) -> Vec<(&'static str, String)> {
    let mut lines = vec![
        ("kind", "model".to_string()),
        ("panels", model.panels.to_string()),
        ("spheres", model.spheres.to_string()),
        ("meshes", model.meshes.len().to_string()),
    ];
    lines.extend(model.meshes.iter().map(|path| ("  mesh", path.escape_debug().to_string())));
    if let Some(extent) = &model.extent {
        lines.extend(extent_lines(extent, ["x", "y", "z"]));
    }
    lines
}

fn extent_lines(extent: &Extent, labels: [&'static str; 3]) -> [(&'static str, String); 3] {
    let [x, y, z] = labels;
    [(x, range(&extent.x, "m")), (y, range(&extent.y, "m")), (z, range(&extent.z, "m"))]
}

fn range(range: &Range, unit: &str) -> String {
    format!("{} to {} {unit}", figure(range.min), figure(range.max))
}

/// Six significant digits, but never coarser than a thousandth (UTM coordinates have more before the point), without
/// trailing zeros.
fn figure(value: f64) -> String {
    let rounded = if (1e3..1e9).contains(&value.abs()) { format!("{value:.3}") } else { format!("{value:.5e}") };
    let rounded: f64 = rounded.parse().unwrap_or(value);
    if rounded == 0.0 {
        return "0".to_string();
    }
    if (1e-4..1e9).contains(&rounded.abs()) { rounded.to_string() } else { format!("{rounded:e}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FRAME: &str = "whitewater-frame 1\ntime 0.25\norigin 1 2\nwidth 1 2\ncolumns 3 3\n\
        0 2 10 3 4\n0 0 0 0 0\n0 0 0 0 0\n0 0 0 0 0\n0 0 0 0 0\n0 0 0 0 0\n0 0 0 0 0\n0 0 0 0 0\n0 0 0 0 0\n\
        particles 1\n1 2 3 0 0 7 0.5 0.1\nend\n";
    const MODEL: &str = "whitewater-model 1\nsphere 0 0 0 1 0.5 0.5 0.5\nmesh rocks.obj\nend\n";

    fn shown(contents: &[&str], json: bool) -> (String, String, Result<(), InspectError>) {
        let directory = tempfile::tempdir().unwrap();
        let paths: Vec<PathBuf> = (0..contents.len()).map(|i| directory.path().join(format!("file{i}"))).collect();
        for (path, content) in paths.iter().zip(contents) {
            std::fs::write(path, content).unwrap();
        }
        let (mut out, mut complaints) = (Vec::new(), Vec::new());
        let result = inspect(&paths, 0.001, json, false, &mut out, &mut complaints);
        (String::from_utf8(out).unwrap(), String::from_utf8(complaints).unwrap(), result)
    }

    #[test]
    fn classes_are_counted_on_request() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("time000.state");
        std::fs::write(&path, FRAME).unwrap();
        let text = |json: bool| {
            let mut out = Vec::new();
            inspect(std::slice::from_ref(&path), 0.001, json, true, &mut out, &mut Vec::new()).unwrap();
            String::from_utf8(out).unwrap()
        };
        let value: Value = serde_json::from_str(&text(true)).unwrap();
        let counts = value[0]["classes"].as_object().unwrap();
        assert_eq!(counts.keys().map(String::as_str).collect::<Vec<_>>(), Class::ALL.map(Class::name));
        // The one particle, of however many classes.
        assert!((counts.values().filter_map(Value::as_f64).sum::<f64>() - 1.0).abs() < 1e-6, "{value}");
        assert!(text(false).contains("of the particles"), "{}", text(false));
    }

    #[test]
    fn a_frame_and_a_model_are_shown_in_aligned_lines() {
        let (out, complaints, result) = shown(&[FRAME, MODEL], false);
        result.unwrap();
        assert_eq!(complaints, "");
        for line in [
            "  kind            frame, text",
            "  columns         3 x 3 = 9",
            "  x               0.5 to 3.5 m",
            "  wet columns     1 (11.1 %, from 0.001 m of depth)",
            "  depth           2 to 2 m, mean 2 m",
            "  flow            5 to 5 m/s",
            "  water           4 m3",
            "    mass          0.5 kg together, 0.5 to 0.5 kg each",
            "    z             3 to 3 m",
            "  kind            model",
            "    mesh          rocks.obj",
        ] {
            assert!(out.lines().any(|shown| shown == line), "{line}\n{out}");
        }
    }

    #[test]
    fn a_bad_file_does_not_hide_the_others() {
        let (out, complaints, result) = shown(&["junk", FRAME], false);
        assert!(matches!(result, Err(InspectError::Unreadable { failed: 1, all: 2 })));
        assert!(complaints.contains("file0:1: found `junk`"), "{complaints}");
        assert!(out.contains("3 x 3 = 9"));
    }

    #[test]
    fn json_holds_every_file_and_error() {
        let (out, _, _) = shown(&[FRAME, MODEL, "junk"], true);
        let json: Value = serde_json::from_str(&out).unwrap();
        assert_eq!(json[0]["frame"]["volume"], 4.0);
        assert_eq!(json[0]["encoding"], "text");
        assert_eq!(json[0]["frame"]["particles"]["extent"]["z"]["max"], 3.0);
        assert_eq!(json[1]["model"]["spheres"], 1);
        assert!(json[2]["error"].as_str().unwrap().contains("junk"));
    }

    #[test]
    fn many_files_get_a_line_each() {
        let (out, complaints, result) = shown(&[FRAME, FRAME, "junk", MODEL, FRAME], false);
        assert!(matches!(result, Err(InspectError::Unreadable { failed: 1, all: 5 })));
        assert!(complaints.contains("file2:1: found `junk`"), "{complaints}");
        let lines: Vec<&str> = out.lines().collect();
        assert_eq!(lines.len(), 7, "{out}");
        let words = |line: &str| line.split_whitespace().map(str::to_owned).collect::<Vec<_>>();
        assert_eq!(words(lines[3]), ["file0", "0.25", "3x3", "11.1", "2", "2", "5", "4", "1", "0.5"]);
        assert_eq!(words(lines[5]), ["file3", "model:", "0", "panels,", "1", "spheres,", "1", "meshes"]);
        assert!(lines[1..4].iter().all(|line| line.chars().count() == lines[1].chars().count()), "{out}");
    }

    #[test]
    fn documented_maps_are_shown_with_unit_and_meaning_and_others_by_name() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("time0.state");
        std::fs::write(&path, FRAME).unwrap();
        let frame = state::read_frame(&path, 0.001).unwrap();
        let map: Vec<f32> = (0..9_u8).map(|i| f32::from(i) - 4.0).collect();
        let maps: [(&str, &[f32]); 3] = [("vorticity", &map), ("aeration", &[0.25; 9]), ("murk", &map)];
        state::save_frame_with(&frame, &maps, &path, Encoding::Npz, state::Packing::Quick).unwrap();
        let mut out = Vec::new();
        inspect(std::slice::from_ref(&path), 0.001, false, false, &mut out, &mut Vec::new()).unwrap();
        let out = String::from_utf8(out).unwrap();
        for line in [
            "  vorticity       -4 to 4 1/s (curl of the flow about the vertical)",
            "  aeration        0.25 to 0.25 (share of air in the water's volume, 0 to 1)",
            "  other array     murk: 3 x 3, <f4",
        ] {
            assert!(out.lines().any(|shown| shown == line), "{line}\n{out}");
        }
        let mut out = Vec::new();
        inspect(&[path], 0.001, true, false, &mut out, &mut Vec::new()).unwrap();
        let json: Value = serde_json::from_slice(&out).unwrap();
        assert_eq!(json[0]["frame"]["maps"][0]["unit"], "1/s");
        assert_eq!(json[0]["frame"]["maps"][0]["range"]["max"], 4.0);
    }

    #[test]
    fn figures_are_short() {
        let shown = [0.1 + 0.2, -0.0, 4123456.2504, 1e-7, 1e300, 74.48475548871764, -1e5].map(figure);
        assert_eq!(shown, ["0.3", "0", "4123456.25", "1e-7", "1e300", "74.4848", "-100000"]);
    }
}
