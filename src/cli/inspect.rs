//! `whitewater inspect FILE…`: what simulation files hold, for people or as JSON.
//!
//! The figures are made in [`crate::state::summary`]; only their look lives here.

use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use serde_json::{Value, json};

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
pub fn run(paths: &[PathBuf], dry_threshold: f64, json: bool) -> Result<(), InspectError> {
    let mut out = BufWriter::new(io::stdout().lock());
    match inspect(paths, dry_threshold, json, &mut out, &mut io::stderr().lock()) {
        Err(InspectError::Output(error)) if error.kind() == io::ErrorKind::BrokenPipe => Ok(()),
        result => result,
    }
}

fn inspect(
    paths: &[PathBuf],
    dry_threshold: f64,
    as_json: bool,
    out: &mut impl Write,
    complaints: &mut impl Write,
) -> Result<(), InspectError> {
    let mut failed = 0;
    let mut list = Vec::new();
    for (i, path) in paths.iter().enumerate() {
        match look(path, dry_threshold) {
            Ok(content) if as_json => list.push(content.json(path)),
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

/// What one file holds.
enum Content {
    Frame(Encoding, Box<FrameSummary>),
    Model(ModelSummary),
}

fn look(path: &Path, dry_threshold: f64) -> Result<Content, StateError> {
    Ok(match state::detect(path)? {
        FileKind::Frame(encoding) => {
            let frame = state::read_frame(path, dry_threshold)?;
            Content::Frame(encoding, Box::new(FrameSummary::new(&frame, dry_threshold)))
        }
        FileKind::Model => Content::Model(ModelSummary::new(&state::read_model(path)?)),
    })
}

impl Content {
    fn json(&self, path: &Path) -> Value {
        match self {
            Content::Frame(Encoding::Text, frame) => {
                json!({ "path": path, "kind": "frame", "encoding": "text", "frame": frame })
            }
            Content::Frame(Encoding::Npz, frame) => {
                json!({ "path": path, "kind": "frame", "encoding": "npz", "frame": frame })
            }
            Content::Model(model) => json!({ "path": path, "kind": "model", "model": model }),
        }
    }

    /// Labels and what stands after them.
    fn lines(&self) -> Vec<(&'static str, String)> {
        match self {
            Content::Frame(encoding, frame) => frame_lines(*encoding, frame),
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
        let result = inspect(&paths, 0.001, json, &mut out, &mut complaints);
        (String::from_utf8(out).unwrap(), String::from_utf8(complaints).unwrap(), result)
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
    fn figures_are_short() {
        let shown = [0.1 + 0.2, -0.0, 4123456.2504, 1e-7, 1e300, 74.48475548871764, -1e5].map(figure);
        assert_eq!(shown, ["0.3", "0", "4123456.25", "1e-7", "1e300", "74.4848", "-100000"]);
    }
}
