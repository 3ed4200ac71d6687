//! `[particles.billboard]`, `[particles.classes]`, `[particles.size_spreads]` and `[particles.sheet]`: what spray looks like, what it
//! is taken for, how its sizes differ and how it is joined, as plain data. Part of the list of keys in `types`.
//!
//! What the keys do is in the room `particles`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// What drops are made of.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum DropMatter {
    /// Bright and diffuse, by speed and age: each stands for many.
    #[default]
    Diffuse,
    /// The water's own: each is a drop.
    Water,
}

/// Where billboards look.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Facing {
    /// To the camera, from wherever they are seen.
    Eye,
    /// To where each ray comes from: to the eye, to its mirror image, to the light that is asked for.
    #[default]
    Ray,
}

/// `[particles.billboard]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Billboard {
    /// `ray` or `eye`.
    pub facing: Facing,
    /// `none`: opaque discs; `droplet`: soft drops, broken up; or the name of an image (.png, .exr), or of many with `####`.
    pub texture: String,
    /// Numbered images to a second of a particle's age; it keeps the last one.
    #[schemars(range(min = 0.0, max = 100000.0))]
    pub image_fps: f64,
}
impl Default for Billboard {
    fn default() -> Self {
        Self { facing: Facing::Ray, texture: "none".into(), image_fps: 24.0 }
    }
}

/// `[particles.classes]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Classes {
    /// Radius (m) from which on a drop is seen as one; half as wide is mist.
    #[schemars(range(min = 0.0, max = 1000.0))]
    pub mist_radius: f64,
    /// Share of a mist particle's water that is in droplets of `particles.droplet_radius`: a particle then stands for a
    /// puff of them. The rest is in drops of its own size.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub atomised: f64,
    /// How far a particle's neighbours may be, in radii of a drop of the mean volume.
    #[schemars(range(min = 0.0, max = 1000.0))]
    pub reach: f64,
    /// So many neighbours, and one that touches, make a sheet of water; half as many do not at all.
    #[schemars(range(min = 1.0, max = 64.0))]
    pub sheet_neighbours: f64,
}
impl Default for Classes {
    fn default() -> Self {
        Self { mist_radius: 0.0015, atomised: 0.0, reach: 4.0, sheet_neighbours: 16.0 }
    }
}

/// `[particles.size_spreads]`: `particles.size_spread` of one class, where that is another one than all the others'.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct SizeSpreads {
    /// Of drops.
    #[schemars(range(min = 0.0, max = 2.0))]
    pub spray: Option<f64>,
    /// Of streaks.
    #[schemars(range(min = 0.0, max = 2.0))]
    pub streaks: Option<f64>,
    /// Of what is mist: of how much water is in each particle's cloud.
    #[schemars(range(min = 0.0, max = 2.0))]
    pub mist: Option<f64>,
    /// Of bubbles.
    #[schemars(range(min = 0.0, max = 2.0))]
    pub bubbles: Option<f64>,
}

/// `[particles.sheet]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Sheet {
    /// How far a particle reaches, in radii of a drop of the mean volume.
    #[schemars(range(min = 1.0, max = 100.0))]
    pub reach: f64,
    /// Width of the grid that the surface is found on, in the same radii.
    #[schemars(range(min = 0.05, max = 10.0))]
    pub resolution: f64,
    /// Share of water's density at which the surface lies.
    #[schemars(range(min = 0.01, max = 1.0))]
    pub threshold: f64,
    /// Times that the surface is smoothed: each vertex goes to the middle of its neighbours.
    #[schemars(range(min = 0, max = 1000))]
    pub smoothing: u32,
}
impl Default for Sheet {
    fn default() -> Self {
        Self { reach: 4.0, resolution: 1.0, threshold: 0.6, smoothing: 5 }
    }
}
