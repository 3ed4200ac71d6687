//! Benchmarks as part of the program: measured work, rivals, errors against the referee.

pub mod leaks;
pub mod rows;
pub mod sim;
pub mod surface;
pub mod work;

use std::path::{Path, PathBuf};

use crate::accel::AccelError;
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
    /// Threads.
    pub threads: usize,
    /// Sizes of the water.
    pub sizes: Vec<[usize; 2]>,
    /// Rows as CSV.
    pub csv: Option<PathBuf>,
    /// Rows as JSON.
    pub json: Option<PathBuf>,
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
