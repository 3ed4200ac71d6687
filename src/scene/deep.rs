//! `[output.deep]`: the deep picture beside the flat one, as plain data. Part of the list of keys in `types`.
//!
//! What the keys do is in `render::deep`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// What water is to a deep picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum DeepWater {
    /// Opaque at its surface.
    #[default]
    Front,
    /// A span along the straight line down to the bed, by what it absorbs and scatters.
    Span,
}

/// `[output.deep]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Deep {
    /// Write a deep EXR beside each EXR.
    pub enabled: bool,
    /// Its samples have colour as well.
    pub color: bool,
    /// `front` or `span`.
    pub water: DeepWater,
    /// Say in the file that its samples are tidy (OpenEXR's attribute `deepImageState`). OpenEXR's package for Python, as of
    /// 3.5, reads no file that has it.
    pub state: bool,
    /// How far its samples may be off in what is left to be seen at any depth, 0..1.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub alpha_tolerance: f64,
    /// Share of its depth within which surfaces of a pixel are one.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub depth_tolerance: f64,
}
impl Default for Deep {
    fn default() -> Self {
        Self {
            enabled: false,
            color: false,
            state: true,
            water: DeepWater::Front,
            alpha_tolerance: 0.002,
            depth_tolerance: 0.002,
        }
    }
}
