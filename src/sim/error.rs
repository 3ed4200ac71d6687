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
}
