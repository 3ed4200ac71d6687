//! `[mist]`: mist from files, besides that of particles, as plain data. Part of the list of keys in `types`.
//!
//! What mist does to light is by the keys of `[particles]`; who reads the files is the room `mist`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Which axis of a file points up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum UpAxis {
    /// The second, as in scenes: x east, y up, z south.
    #[default]
    Y,
    /// The third: x east, y north, z up.
    Z,
}

/// `[mist]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Mist {
    /// An OpenVDB file (.vdb), or one for each frame with `####` for its number, relative to the scene file.
    pub file: Option<String>,
    /// The grid of density in it.
    pub grid: String,
    /// Extinction (1/m) where the density is 1.
    #[schemars(range(min = 0.0, max = 1000000000.0))]
    pub extinction: f64,
    /// The grid of velocity (m/s along the file's axes); by default the first of `velocity`, `vel` and `v` that is there, and
    /// mist that stands still without.
    pub velocity: Option<String>,
    /// Factor on the velocities.
    #[schemars(range(min = -1000000.0, max = 1000000.0))]
    pub velocity_scale: f64,
    /// `y` or `z`: which of the file's axes points up.
    pub up: UpAxis,
}
impl Default for Mist {
    fn default() -> Self {
        Self { file: None, grid: "density".into(), extinction: 1.0, velocity: None, velocity_scale: 1.0, up: UpAxis::Y }
    }
}
