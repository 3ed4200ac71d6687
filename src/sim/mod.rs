//! The simulation that makes frames: columns and pipes for the body of water, particles for spray.
//!
//! After O'Brien and Hodgins, Dynamic simulation of splashing fluids, 1995, Mould and Yang, Modeling water for computer
//! graphics, 1997, and appendix A of the report. Double precision throughout; metres, seconds, y up.
//! Nothing here draws, and nothing below `cli` and `bench` knows of it: its frames reach the renderer as files.

pub mod analytic;
mod checkpoint;
mod error;
mod foam;
mod grid;
mod ledger;
mod regions;
mod setup;
mod simulator;
mod solids;
mod spray;
pub mod trials;
mod turbulence;
mod water;

pub use checkpoint::{CHECKPOINT_NAME, Checkpoint, Identity, Made};
pub use error::SimError;
pub use grid::Grid;
pub use ledger::{Balance, Ledger, Sum};
pub use setup::{Held, Inflow, Pressed, Setup, prepare};
pub use simulator::{Advance, Moment, Phases, Simulator, SimulatorState, Work};
pub use solids::Solids;
pub use spray::{Spray, SprayCounts, SprayState};
pub use turbulence::Turbulence;
pub use water::{Forcing, Step, Water, WaterSettings};
