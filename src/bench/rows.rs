//! One row per measurement, saved as soon as it is measured.

use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};

use serde::Serialize;

use super::BenchError;

/// One measured case; what does not apply is empty.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Row {
    /// Which benchmark.
    pub bench: String,
    /// Size of the water, as `400x400`.
    pub columns: String,
    /// Order of the spline.
    pub order: u32,
    /// Accelerator or rival.
    pub accel: String,
    /// Solver.
    pub solver: String,
    /// Instruction set of our kernels.
    pub simd: String,
    /// Sixteen rays a call, or one.
    pub batch: bool,
    /// What particles are: spheres or discs.
    pub shape: String,
    /// Class of rays.
    pub rays: String,
    /// Millions of rays per second, median over the rounds.
    pub mrays_per_s: f64,
    /// Against the baseline of the same run and class, median of the rounds' ratios.
    pub ratio: f64,
    /// Rays checked against the referee.
    pub checked: u64,
    /// Hits lost.
    pub lost: u64,
    /// Hits invented.
    #[serde(rename = "false")]
    pub false_hits: u64,
    /// Hits misplaced.
    pub wrong: u64,
    /// Differences at tangency.
    pub tangent: u64,
    /// Rays on which the solver gave up.
    pub gave_up: u64,
    /// Memory above the heights.
    pub bytes_per_column: f64,
    /// Time to build.
    pub build_ms: f64,
    /// What is turned up or down: solver and tolerance, order, samples; or the axis of an extreme.
    pub dial: String,
    /// Where it stands.
    pub setting: String,
    /// The same as a number, where it is one.
    pub value: f64,
    /// Seconds: per ray, or per picture.
    pub seconds: f64,
    /// Root mean square of the error: of t in columns, or of linear light.
    pub error_rms: f64,
    /// Greatest error, likewise.
    pub error_max: f64,
    /// Memory of a structure over particles.
    pub bytes_per_particle: f64,
    /// The report's own time for the same.
    pub their_ms: f64,
    /// Ours.
    pub our_ms: f64,
    /// A picture's mean over that of its reference.
    pub mean_ratio: f64,
    /// Standard error of that ratio.
    pub mean_ratio_error: f64,
    /// How error falls: with the samples to the power of minus this.
    pub falls_as: f64,
    /// Points that caustics were searched for, in one frame.
    pub queries: u64,
    /// Patches and parts of patches that were looked at for them.
    pub cells: u64,
    /// Ways of light found for them.
    pub solutions: u64,
    /// Count of particles.
    pub particles: usize,
    /// Simulation: a step, and its phases.
    pub ms_per_step: f64,
    /// Columns and pipes.
    pub water_ms: f64,
    /// Particles.
    pub spray_ms: f64,
    /// Turbulence and aeration.
    pub turbulence_ms: f64,
    /// Threads.
    pub threads: usize,
    /// Processor.
    pub machine: String,
    /// Its vector instructions.
    pub cpu_features: String,
    /// Revision of the program, where it is known.
    pub commit: String,
}

impl Row {
    /// Who was measured: `embree univariate x16`, and the order where it is not 3; `bsp spheres` over particles, where
    /// only Embree is asked in two ways.
    pub fn title(&self) -> String {
        let batch = match (self.batch, self.shape.is_empty()) {
            (false, _) => "x1",
            (true, true) => "x16",
            (true, false) => "",
        };
        let words = [self.accel.as_str(), &self.solver, &self.shape, batch];
        let title = words.into_iter().filter(|word| !word.is_empty()).collect::<Vec<_>>().join(" ");
        if matches!(self.order, 0 | 3) { title } else { format!("{title}, order {}", self.order) }
    }
}

/// Rows on their way to files and to the terminal.
#[derive(Debug)]
pub struct Rows {
    rows: Vec<Row>,
    csv: Option<(PathBuf, File)>,
    json: Option<PathBuf>,
    machine: String,
    cpu_features: String,
    commit: String,
}

impl Rows {
    /// Opens the files that rows go to.
    ///
    /// # Errors
    /// A file cannot be made.
    pub fn new(csv: Option<&Path>, json: Option<&Path>) -> Result<Self, BenchError> {
        let csv = match csv {
            Some(path) => Some((path.to_owned(), File::create(path).map_err(|e| BenchError::file(path, e))?)),
            None => None,
        };
        Ok(Self {
            rows: Vec::new(),
            csv,
            json: json.map(Path::to_owned),
            machine: machine(),
            cpu_features: cpu_features(),
            commit: commit(),
        })
    }

    /// Saves a row.
    ///
    /// # Errors
    /// A file cannot be written.
    pub fn push(&mut self, row: Row) -> Result<(), BenchError> {
        let row = Row {
            machine: self.machine.clone(),
            cpu_features: self.cpu_features.clone(),
            commit: self.commit.clone(),
            ..row
        };
        let value = serde_json::to_value(&row).map_err(|e| BenchError::Internal(e.to_string()))?;
        if let (Some((path, file)), Some(fields)) = (&mut self.csv, value.as_object()) {
            let line = |cells: Vec<String>| cells.join(",") + "\n";
            let mut text = String::new();
            if self.rows.is_empty() {
                text += &line(fields.keys().cloned().collect());
            }
            text += &line(fields.values().map(|v| v.as_str().map_or(v.to_string(), |s| s.replace(',', ";"))).collect());
            file.write_all(text.as_bytes()).and_then(|()| file.flush()).map_err(|e| BenchError::file(path, e))?;
        }
        self.rows.push(row);
        if let Some(path) = &self.json {
            let text = serde_json::to_string_pretty(&self.rows).map_err(|e| BenchError::Internal(e.to_string()))?;
            std::fs::write(path, text + "\n").map_err(|e| BenchError::file(path, e))?;
        }
        Ok(())
    }

    /// All rows so far.
    pub fn all(&self) -> &[Row] {
        &self.rows
    }

    /// The machine, for a table's heading.
    pub fn machine(&self) -> String {
        format!("{} ({})", self.machine, self.cpu_features)
    }
}

fn machine() -> String {
    let cpu = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let name = cpu.lines().find_map(|line| line.strip_prefix("model name")).and_then(|rest| rest.split(':').nth(1));
    name.map_or_else(|| std::env::consts::ARCH.to_owned(), |name| name.trim().to_owned())
}

fn cpu_features() -> String {
    match crate::simd::SimdLevel::detect() {
        crate::simd::SimdLevel::Avx512 => "AVX-512",
        crate::simd::SimdLevel::Avx2 => "AVX2, no AVX-512",
        crate::simd::SimdLevel::Portable => "no AVX2",
    }
    .to_owned()
}

fn commit() -> String {
    std::process::Command::new("git")
        .args(["describe", "--always", "--dirty"])
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .stderr(std::process::Stdio::null())
        .output()
        .ok()
        .filter(|output| output.status.success())
        .map(|output| String::from_utf8_lossy(&output.stdout).trim().to_owned())
        .unwrap_or_default()
}
