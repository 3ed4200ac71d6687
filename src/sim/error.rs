//! What can be wrong with a simulation.

/// Why a simulation cannot be set up or go on.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SimError {
    /// The waves of one column ask for more steps than the scene allows.
    #[error(
        "column {column:?} at {time} s moves at {speed:.3e} m/s: one frame would take {steps:.0} steps, \
         and simulation.most_steps is {most}"
    )]
    TooManySteps {
        /// Simulated time (s).
        time: f64,
        /// Column along x and z.
        column: [usize; 2],
        /// Fastest wave there (m/s).
        speed: f64,
        /// Steps that a frame would take.
        steps: f64,
        /// Steps that it may take.
        most: u32,
    },
    /// A sphere or panel of the model that spray cannot bounce off.
    #[error("the model: {0}")]
    Solid(#[source] crate::terrain::TerrainError),
    /// The ground cannot be built.
    #[error(transparent)]
    Ground(#[from] crate::terrain::TerrainError),
    /// A file of the simulation cannot be read or written.
    #[error(transparent)]
    File(#[from] crate::state::StateError),
    /// A key, or several together, say what cannot be.
    #[error("{key}: {found}; expected {expected}")]
    Setting {
        /// The key's full path.
        key: String,
        /// What it says.
        found: String,
        /// What would fit.
        expected: String,
    },
}
