//! Foam: where water is white, carried with it, and what it looks like.
//!
//! `bubbles` makes foam of particles under the surface; [`potential`] says where air is taken in, [`FoamState`] carries the foam from step to step, [`recompute`] does so over a
//! window of frames, [`FoamField`] answers the renderer. Nothing here draws, nothing acts back on the water.

mod bubbles;
mod carry;
mod error;
mod field;
mod pattern;
pub mod potential;
mod window;

pub use carry::{FoamState, LAYERS};
pub use error::FoamError;
pub use field::{Aeration, FoamField, FoamLook};
pub use potential::WaterMap;
pub use window::recompute;
