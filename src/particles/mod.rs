//! Spray: radius from mass, colour and opacity from speed and age, discs that face the eye and what is on them, streaks along the flight and how they close up; what
//! each particle physically is, and the surface around those that hang together.
//!
//! Particles are single precision around the scene's origin, one array per field; where they are traced is not here.

mod appearance;
mod billboard;
mod classes;
mod detail;
mod nearest;
mod neighbours;
mod seed;
mod sheet;
mod store;
mod streak;
mod texture;
mod veil;

pub use appearance::{Appearance, appearance, mass, radius};
pub use billboard::{Facing, facing};
pub use classes::{Class, Judged, Shares, drawn_once, mean_radius, shares};
pub use detail::{Sight, covers, least_for};
pub use neighbours::{Nearness, nearness};
pub use seed::{Purpose, seed, size_factor, size_spreads, uniform};
pub use sheet::{Sheet, SheetError, sheet};
pub use store::Spray;
pub use streak::{Streaks, streaks};
pub use texture::{Texel, TextureError, Textures, billboard_turn, texture_files};
pub use veil::veils;
