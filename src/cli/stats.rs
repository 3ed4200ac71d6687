//! What a run took, for `--stats`: seconds by phase, rays, solver work, memory, what was built.

use std::path::Path;

use serde::Serialize;

use super::errors::CliError;
use crate::accel::AccelStats;
use crate::denoise::DenoiseReport;
use crate::lower::{Lowered, Thinning};
use crate::output::WriteReport;
use crate::render::{RayCounts, RenderStats};
use crate::surface::SolveCounts;
use crate::surface::audit::Audit;

/// One frame.
#[derive(Clone, Debug, Serialize)]
pub struct FrameStats {
    /// Number.
    pub frame: i64,
    /// Reading its file (s).
    pub load_s: f64,
    /// Lowering and acceleration structures (s).
    pub build_s: f64,
    /// First ray to last pixel (s).
    pub render_s: f64,
    /// Denoising, if it was asked for.
    pub denoise: Option<DenoiseReport>,
    /// Files (s).
    pub write_s: f64,
    /// The renderer's own counts.
    pub render: RenderStats,
    /// Parts by name that were built; what a scene does not have is not here.
    pub parts: Vec<String>,
    /// The acceleration structure.
    pub accelerator: AccelStats,
    /// Rays traced again exactly and how many of them differ, for accelerators that lose rays.
    pub audit: Option<Audit>,
    /// Files written.
    pub files: Vec<WriteReport>,
    /// Particles left out: no size, or out of single precision's range.
    pub particles_left_out: u64,
    /// How many are drawn for how many.
    pub particles: Thinning,
}

/// A whole run.
#[derive(Clone, Debug, Default, Serialize)]
pub struct RunStats {
    /// Program's version.
    pub version: String,
    /// The scene's hash.
    pub scene: String,
    /// Instruction set of the surface kernels.
    pub simd: String,
    /// Threads.
    pub threads: usize,
    /// Scene, environment, sky and frames: reading (s).
    pub load_s: f64,
    /// Lowering and acceleration structures (s).
    pub build_s: f64,
    /// First ray to last pixel, all frames (s).
    pub render_s: f64,
    /// Denoising, all frames (s).
    pub denoise_s: f64,
    /// Files (s).
    pub write_s: f64,
    /// Rays by kind, all frames.
    pub rays: RayCounts,
    /// The solver's work, all frames.
    pub solve: SolveCounts,
    /// Rays on which a solver gave up, all frames.
    pub gave_up: u64,
    /// Rays traced again exactly and how many of them differ, all frames, for accelerators that lose rays.
    pub audit: Option<Audit>,
    /// Pixels with a value beyond half's range, all files.
    pub saturated_pixels: u64,
    /// Contributions that were not finite and were dropped.
    pub nonfinite: u64,
    /// Greatest memory of the process (bytes), where the system tells.
    pub peak_memory_bytes: Option<u64>,
    /// Frames that an earlier run has finished.
    pub skipped: Vec<i64>,
    /// Frames that could not be rendered, with the reason.
    pub lost: Vec<(i64, String)>,
    /// Each frame.
    pub frames: Vec<FrameStats>,
}

impl RunStats {
    /// Adds a finished frame.
    pub fn add(&mut self, frame: FrameStats) {
        self.load_s += frame.load_s;
        self.build_s += frame.build_s;
        self.render_s += frame.render_s;
        self.denoise_s += frame.denoise.as_ref().map_or(0.0, |report| report.seconds);
        self.write_s += frame.write_s;
        self.rays += frame.render.rays;
        self.solve += frame.render.solve;
        self.gave_up += frame.render.solve.gave_up;
        if let Some(audit) = frame.audit {
            *self.audit.get_or_insert_default() += audit;
        }
        self.nonfinite += frame.render.nonfinite;
        self.saturated_pixels += frame.files.iter().map(|file| file.saturated_pixels).sum::<u64>();
        self.frames.push(frame);
    }

    /// Writes the JSON file.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn save(&mut self, path: &Path) -> Result<(), CliError> {
        self.peak_memory_bytes = peak_memory();
        write_json(self, path)
    }
}

/// Writes what `--stats` asks for.
///
/// # Errors
/// The file cannot be written.
pub(super) fn write_json(stats: &impl Serialize, path: &Path) -> Result<(), CliError> {
    let text = serde_json::to_string_pretty(stats).map_err(anyhow::Error::from)?;
    std::fs::write(path, text + "\n").map_err(|error| anyhow::anyhow!("--stats {}: {error}", path.display()).into())
}

/// Names of the parts.
pub fn part_names(lowered: &Lowered) -> Vec<String> {
    lowered.parts.iter().map(|part| part.name.clone()).collect()
}

/// Peak resident memory of this process (bytes).
pub(super) fn peak_memory() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok().map(|kilobytes| kilobytes * 1024)
}
