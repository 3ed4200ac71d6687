//! Spray: radius from mass, colour and opacity from speed and age, discs that face the eye, streaks along the flight.
//!
//! Particles are single precision around the scene's origin, one array per field; where they are traced is not here.

mod appearance;
mod billboard;
mod store;
mod streak;

pub use appearance::{Appearance, appearance, radius};
pub use billboard::{Facing, facing};
pub use store::Spray;
pub use streak::{Streaks, streaks};
