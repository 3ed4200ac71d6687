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
    /// The longest step that the scene allows makes too many of them.
    #[error(
        "simulation.step = {step} s: one frame of {frame} s would take {steps:.0} steps, and simulation.most_steps is {most}"
    )]
    StepTooShort {
        /// The longest step (s).
        step: f64,
        /// Time between frames (s).
        frame: f64,
        /// Steps that a frame would take.
        steps: f64,
        /// Steps that it may take.
        most: u32,
    },
    /// The state has a number that is none.
    #[error("column {column:?} at {time} s is not finite; expected a smaller simulation.step or simulation.courant")]
    NotFinite {
        /// Simulated time (s).
        time: f64,
        /// Column along x and z.
        column: [usize; 2],
    },
    /// A checkpoint of another simulation.
    #[error(
        "{}: made by another simulation (its [simulation] table, frames.fps, the files that it names, or the program's \
         version differ); --restart makes all frames anew, -o puts them into another folder", path.display()
    )]
    OtherSimulation {
        /// The checkpoint.
        path: std::path::PathBuf,
    },
    /// A checkpoint that cannot be gone on from.
    #[error("{}: damaged: {problem}; --restart makes all frames anew", path.display())]
    BadCheckpoint {
        /// The checkpoint.
        path: std::path::PathBuf,
        /// What is wrong with it.
        problem: String,
    },
}
