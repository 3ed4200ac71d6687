//! Benchmarks as part of the program: measured work, rivals, errors against the referee.
//!
//! A benchmark is a function from [`Settings`] to rows. `work` and `plumes` make what is measured, `tracer` asks, `measure`
//! times and judges, `sheet` and `rows` say and save, `plot` draws rows.

pub mod extremes;
pub mod kernels;
pub mod leaks;
pub mod light;
pub mod measure;
pub mod particles;
pub mod pictures;
mod plot;
pub mod plume;
pub mod report;
mod rivals;
pub mod rows;
pub mod sheet;
pub mod sim;
pub mod spray;
pub mod surface;
pub mod threads;
pub mod tracer;
pub mod trade;
pub mod work;

use std::path::{Path, PathBuf};

use crate::accel::AccelError;
use crate::lower::LowerError;
use crate::optics::OpticsError;
use crate::render::RenderError;
use crate::simd::SimdLevel;
use crate::surface::LatticeError;
use crate::surface::tessellate::MeshError;

/// What to measure with.
#[derive(Clone, Debug)]
pub struct Settings {
    /// A tenth of the rays, fewer rounds.
    pub quick: bool,
    /// Instruction set of our kernels.
    pub simd: SimdLevel,
    /// Instruction sets that promises are tried on: all that there are, or the one asked for.
    pub kernels: Vec<SimdLevel>,
    /// Threads.
    pub threads: usize,
    /// Sizes of the water.
    pub sizes: Vec<[usize; 2]>,
    /// Counts of particles; by default the benchmark's own.
    pub particles: Vec<usize>,
    /// Rays of each class, about; by default the design's, or a tenth of them.
    pub rays: Option<usize>,
    /// Rays of each class that are held against the referee.
    pub audit: Option<usize>,
    /// Rows as CSV.
    pub csv: Option<PathBuf>,
    /// Rows as JSON.
    pub json: Option<PathBuf>,
    /// Tables to paste into a document.
    pub markdown: Option<PathBuf>,
    /// Folder of plots.
    pub plot: Option<PathBuf>,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            quick: false,
            simd: SimdLevel::detect(),
            kernels: SimdLevel::ALL.into_iter().filter(|level| level.is_available()).collect(),
            threads: 1,
            sizes: Vec::new(),
            particles: Vec::new(),
            rays: None,
            audit: None,
            csv: None,
            json: None,
            markdown: None,
            plot: None,
        }
    }
}

impl Settings {
    /// Share of the design's count of rays.
    pub fn share(&self) -> f64 {
        match self.rays {
            Some(rays) => rays as f64 / 1e6,
            None if self.quick => 0.1,
            None => 1.0,
        }
    }

    /// Rounds that are measured.
    pub fn rounds(&self) -> usize {
        if self.quick { 3 } else { 7 }
    }

    /// Rays of a class to hold against the referee.
    pub fn checked(&self) -> usize {
        self.audit.unwrap_or_else(|| self.rays.unwrap_or(usize::MAX).min(if self.quick { 10_000 } else { 100_000 }))
    }
}

/// Why a benchmark stopped.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BenchError {
    /// Embree's or a rival's reason.
    #[error(transparent)]
    Accel(#[from] AccelError),
    /// The surface cannot be made.
    #[error(transparent)]
    Lattice(#[from] LatticeError),
    /// A rival's mesh cannot be made.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// A scene cannot be lowered.
    #[error(transparent)]
    Lower(#[from] LowerError),
    /// A sky.
    #[error(transparent)]
    Optics(#[from] OpticsError),
    /// A picture cannot be rendered.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// A file of rows.
    #[error("{path}: {source}")]
    File {
        /// Which.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// The terminal.
    #[error("cannot print: {0}")]
    Print(#[from] std::io::Error),
    /// A broken promise of ours.
    #[error("{0}")]
    Internal(String),
    /// A ray passed where none may.
    #[error("{0} rays leaked")]
    Leaks(u64),
}

/// A size as tables and files name it.
fn size_name([nx, nz]: [usize; 2]) -> String {
    format!("{nx}x{nz}")
}

/// The middle value; the upper one of two.
fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

impl BenchError {
    fn file(path: &Path, source: std::io::Error) -> Self {
        Self::File { path: path.to_owned(), source }
    }
}
