//! What a simulation took and where its water is, for `--stats` and the last line.

use std::path::Path;

use serde::Serialize;

use super::writer::Written;
use crate::cli::errors::CliError;
use crate::cli::look::duration;
use crate::cli::stats;
use crate::sim::{Balance, Phases, Simulator, SprayCounts};

/// Seconds of wall clock. Writing goes on beside the rest.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub(super) struct Seconds {
    /// Scene, terrain, checkpoint.
    pub(super) prepare: f64,
    /// Columns and pipes, spray, turbulence.
    #[serde(flatten)]
    pub(super) phases: Phases,
    /// Files.
    pub(super) writing: f64,
    /// For the writer, with nothing else to do.
    pub(super) waiting: f64,
    /// All of it.
    pub(super) total: f64,
}

/// One frame.
#[derive(Clone, Copy, Debug, Serialize)]
pub(super) struct Row {
    /// Its number.
    pub(super) frame: u64,
    /// Simulated time (s).
    pub(super) time: f64,
    /// Steps since the frame before; settling counts to frame 0.
    pub(super) steps: u64,
    /// Seconds of these steps by phase.
    pub(super) seconds: Phases,
    /// Particles in it.
    pub(super) particles: usize,
    /// Of its file.
    pub(super) bytes: u64,
    /// Seconds for its file and checkpoint.
    pub(super) writing: f64,
    /// The account of all water.
    pub(super) ledger: Balance,
}

/// A whole run.
#[derive(Clone, Debug, Default, Serialize)]
pub(super) struct Report {
    /// Program's version.
    pub(super) version: &'static str,
    /// The scene's hash.
    pub(super) scene: String,
    /// Threads.
    pub(super) threads: usize,
    /// Columns along x and z.
    pub(super) columns: [usize; 2],
    /// Frames that the sequence has now, those of former runs included.
    pub(super) frames: u64,
    /// Where the time went.
    pub(super) seconds: Seconds,
    /// Steps of this run.
    pub(super) steps: u64,
    /// Steps per second of simulating.
    pub(super) steps_per_s: Option<f64>,
    /// The shortest step (s).
    pub(super) least_dt: Option<f64>,
    /// The longest (s).
    pub(super) greatest_dt: Option<f64>,
    /// Particles at the end.
    pub(super) particles: usize,
    /// How spray came and went, former runs included.
    pub(super) spray: SprayCounts,
    /// The account of all water at the end.
    pub(super) ledger: Balance,
    /// Greatest memory of the process (bytes), where the system tells.
    pub(super) peak_memory_bytes: Option<u64>,
    /// Frames of this run.
    pub(super) rows: Vec<Row>,
}

impl Report {
    /// Takes up what the writer says.
    pub(super) fn written(&mut self, written: &[Written]) {
        for written in written {
            self.seconds.writing += written.seconds;
            if let Some(row) = self.rows.iter_mut().find(|row| row.frame == written.number) {
                (row.bytes, row.writing) = (written.bytes, written.seconds);
            }
            self.frames = self.frames.max(written.number + 1);
        }
    }

    /// What can be said once nothing more happens.
    pub(super) fn close(&mut self, simulator: &Simulator, total: f64) {
        let work = simulator.work();
        self.seconds.phases = work.seconds;
        self.seconds.total = total;
        self.steps = work.steps;
        if work.steps > 0 {
            let Phases { water, spray, turbulence } = work.seconds;
            self.steps_per_s = Some(work.steps as f64 / (water + spray + turbulence));
            (self.least_dt, self.greatest_dt) = (Some(work.least_step), Some(work.greatest_step));
        }
        self.particles = simulator.particles();
        self.spray = simulator.counts();
        self.ledger = simulator.balance();
    }

    /// The run in a sentence or two.
    pub(super) fn sentence(&self, directory: &Path) -> String {
        let Balance { entered, left, columns, particles, relative, .. } = self.ledger;
        let relative = relative.abs();
        let rate = match (self.steps_per_s, self.least_dt, self.greatest_dt) {
            (Some(rate), Some(least), Some(greatest)) => {
                format!(" ({rate:.1} steps/s, {least:.3e} to {greatest:.3e} s each)")
            }
            _ => String::new(),
        };
        format!(
            "{} frames in {}: took {}, {} steps{rate}, {} particles\n\
             water: {entered:.6} m3 came in, {left:.6} left, {columns:.6} in columns, {particles:.6} in spray; \
             balanced to {relative:.1e}",
            self.frames,
            directory.strip_prefix(".").unwrap_or(directory).display(),
            duration(self.seconds.total),
            self.steps,
            self.particles,
        )
    }

    /// Writes the JSON file.
    ///
    /// # Errors
    /// The file cannot be written.
    pub(super) fn save(&mut self, path: &Path) -> Result<(), CliError> {
        self.peak_memory_bytes = stats::peak_memory();
        stats::write_json(self, path)
    }
}
