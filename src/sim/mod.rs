//! The simulation that makes frames: columns and pipes for the body of water, particles for spray.
//!
//! After O'Brien and Hodgins, Dynamic simulation of splashing fluids, 1995, Mould and Yang, Modeling water for computer
//! graphics, 1997, and appendix A of the report. Double precision throughout; metres, seconds, y up.
//! Nothing here draws, and nothing below `cli` and `bench` knows of it: its frames reach the renderer as files.

pub mod analytic;
mod error;
mod grid;
mod water;

pub use error::SimError;
pub use grid::Grid;
pub use water::{Forcing, Step, Water, WaterSettings};
