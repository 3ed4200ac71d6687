//! `[water]`: what the water's surface and body do to light, as plain data.
//!
//! The numbers that the named waters stand for are in `water_types`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Reflectance of the water's surface, by name.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Fresnel {
    /// The dielectric's Fresnel equations, unpolarised.
    #[default]
    Exact,
    /// Schlick 1994.
    Schlick,
}

/// The sun's mirror image on the water.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Highlight {
    /// A GGX lobe of `water.roughness`.
    #[default]
    Ggx,
    /// Phong's lobe of `water.phong_exponent` (the report's table 4.1).
    Phong,
    /// No highlight.
    None,
}

/// A named set of water properties.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum WaterPreset {
    /// The report's table 4.1: diffuse, specular, Phong 1000, Schlick with `r0`.
    Report,
    /// Pure water, which scatters by its molecules alone.
    Pure,
    /// Jerlov's clearest ocean water.
    JerlovI,
    /// Jerlov's oceanic type IA.
    JerlovIa,
    /// Jerlov's oceanic type IB.
    JerlovIb,
    /// Jerlov's oceanic type II.
    JerlovIi,
    /// Jerlov's oceanic type III.
    JerlovIii,
    /// Jerlov's clearest coastal water.
    #[serde(rename = "jerlov-1c")]
    Jerlov1c,
    /// Jerlov's coastal type 3.
    #[serde(rename = "jerlov-3c")]
    Jerlov3c,
    /// Jerlov's coastal type 5.
    #[serde(rename = "jerlov-5c")]
    Jerlov5c,
    /// Jerlov's coastal type 7.
    #[serde(rename = "jerlov-7c")]
    Jerlov7c,
    /// Jerlov's most turbid coastal water.
    #[serde(rename = "jerlov-9c")]
    Jerlov9c,
    /// Premoze and Ashikhmin's clearest ocean.
    PremozeI,
    /// Their clear ocean.
    PremozeIi,
    /// Their turbid ocean.
    PremozeIii,
    /// Their clearest coastal water.
    #[serde(rename = "premoze-1")]
    Premoze1,
    /// Their clear coastal water.
    #[serde(rename = "premoze-3")]
    Premoze3,
    /// Their semi-clear coastal water.
    #[serde(rename = "premoze-5")]
    Premoze5,
    /// Their turbid coastal water.
    #[serde(rename = "premoze-7")]
    Premoze7,
    /// Their most turbid coastal water.
    #[serde(rename = "premoze-9")]
    Premoze9,
    /// A river that carries silt.
    River,
    /// Petzold's turbid harbour.
    Harbour,
}

/// Into which directions water scatters, by name.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum PhaseKind {
    /// Henyey and Greenstein 1941, of mean cosine `asymmetry`.
    #[default]
    HenyeyGreenstein,
    /// Two of them: `asymmetry`, and a share of `back_share` with `back_asymmetry`.
    TwoLobe,
    /// Molecules alone (Morel 1974).
    Pure,
}

/// `[water]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Water {
    /// Start from a named set; keys given beside it still win.
    pub preset: Option<WaterPreset>,
    /// Index of refraction.
    #[schemars(range(min = 1.0, max = 4.0))]
    pub ior: f64,
    /// Absorption per metre: red, green, blue.
    #[schemars(inner(range(min = 0.0, max = 1000000.0)))]
    pub absorption: [f64; 3],
    /// Scattering per metre: red, green, blue.
    #[schemars(inner(range(min = 0.0, max = 1000000.0)))]
    pub scattering: [f64; 3],
    /// `henyey-greenstein`, `two-lobe` or `pure`: into which directions it scatters.
    pub phase: PhaseKind,
    /// Mean cosine of the deflection, or of the first of two lobes.
    #[schemars(range(min = -0.99, max = 0.99))]
    pub asymmetry: f64,
    /// Mean cosine of the second of two lobes.
    #[schemars(range(min = -0.99, max = 0.99))]
    pub back_asymmetry: f64,
    /// Share of the second of two lobes.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub back_share: f64,
    /// `exact` or `schlick`.
    pub fresnel: Fresnel,
    /// Schlick's reflectance at normal incidence; by default ((n-1)/(n+1))^2.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub r0: Option<f64>,
    /// Diffuse reflectance of the surface itself (0: clear water); `whitted` only.
    #[schemars(inner(range(min = 0.0, max = 1.0)))]
    pub diffuse: [f64; 3],
    /// Scale of the mirror reflection and of the highlight; `whitted` only.
    #[schemars(inner(range(min = 0.0, max = 1.0)))]
    pub specular: [f64; 3],
    /// `ggx`, `phong` or `none`.
    pub highlight: Highlight,
    /// GGX roughness (alpha) of the surface, 0 for a mirror: of the sun's highlight, and of what is traced by `path`.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub roughness: f64,
    /// Exponent of the Phong highlight.
    #[schemars(range(min = 1.0, max = 1000000.0))]
    pub phong_exponent: f64,
    /// Whether the water is there at all.
    pub visible: bool,
}
impl Default for Water {
    fn default() -> Self {
        Self {
            preset: None,
            ior: 1.333,
            absorption: [0.34, 0.05, 0.009],
            scattering: [0.0; 3],
            phase: PhaseKind::HenyeyGreenstein,
            asymmetry: 0.92,
            back_asymmetry: -0.5,
            back_share: 0.02,
            fresnel: Fresnel::Exact,
            r0: None,
            diffuse: [0.0; 3],
            specular: [1.0; 3],
            highlight: Highlight::Ggx,
            roughness: 0.03,
            phong_exponent: 1000.0,
            visible: true,
        }
    }
}
