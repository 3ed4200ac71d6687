//! The scene file: TOML → plain data, its JSON Schema, and errors with file, line and column.
//!
//! [`load()`] is the way in. Whether the files that a scene names exist is not looked at here: the rooms that read them say so.

mod bytes;
mod check;
mod deep;
mod document;
mod errors;
mod foam;
mod load;
mod mist;
mod overrides;
mod overscan;
mod rendering;
mod rules;
mod shape;
mod simulation;
mod spray;
mod types;
mod water;
mod water_types;

pub use bytes::{BYTE_UNITS, EXPECTED_BYTES, bytes};
pub use deep::{Deep, DeepWater};
pub use errors::{Place, SceneError, SceneErrors};
pub use foam::{Foam, FoamLimits, FoamRate};
pub use load::{LoadedScene, MOST_BYTES, load};
pub use mist::{Mist, UpAxis};
pub use overrides::Override;
pub use overscan::Overscan;
pub use rendering::*;
pub use shape::{names_of, schema};
pub use simulation::*;
pub use spray::{Billboard, Classes, DropMatter, Facing, Sheet, SizeSpreads};
pub use types::*;
pub use water::*;
pub use water_types::{Coefficients, WAVELENGTHS, absorption_of, diffuse_attenuation};
