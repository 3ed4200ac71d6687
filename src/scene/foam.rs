//! `[foam]`: where water is white, as plain data. Part of the list of keys in `types`.
//!
//! What the keys do is in the room `foam`; whether a simulation carries foam is `simulation.foam`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// `[foam]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Foam {
    /// Whether foam is drawn, where the frames carry it or `window` makes it.
    pub visible: bool,
    /// Factor on the density of foam when it is drawn.
    #[schemars(range(min = 0.0, max = 1000.0))]
    pub amount: f64,
    /// Frames before the one that is rendered from which foam is made anew, where the frame carries none; 0: only what frames carry.
    #[schemars(range(min = 0, max = 100000))]
    pub window: u32,
    /// Factor on the area that particles under the surface cover with foam when they come up: each stands for so many
    /// bubbles of its size; 0: none.
    #[schemars(range(min = 0.0, max = 1000000000.0))]
    pub bubbles: f64,
    /// Seconds in which foam that gets no air falls to 1/e.
    #[schemars(range(min = 0.001, max = 1000000.0))]
    pub lifetime: f64,
    /// Seconds for which a layer of the pattern is carried with the flow before it starts anew; at most the window's.
    #[schemars(range(min = 0.001, max = 1000000.0))]
    pub renewal: f64,
    /// From where to where each potential grows from 0 to 1.
    pub limits: FoamLimits,
    /// How fast foam forms where a potential is 1.
    pub rate: FoamRate,
    /// Width (m) of the lace's meshes; by default the smaller width of a column.
    #[schemars(range(min = 0.000001, max = 1000000.0))]
    pub pattern: Option<f64>,
    /// Width (m) of the bubbles that grain the foam; by default a twelfth of `pattern`.
    #[schemars(range(min = 0.000001, max = 1000000.0))]
    pub bubble: Option<f64>,
    /// How soft the foam's edges are: 0.01 is cut out, 1 is a haze.
    #[schemars(range(min = 0.01, max = 4.0))]
    pub softness: f64,
    /// Diffuse albedo of closed foam.
    #[schemars(inner(range(min = 0.0, max = 1.0)))]
    pub albedo: [f64; 3],
    /// Extinction (1/m) by bubbles just under closed foam; 0: none.
    #[schemars(range(min = 0.0, max = 1000000.0))]
    pub aeration: f64,
    /// Depth (m) in which bubbles thin out to 1/e.
    #[schemars(range(min = 0.000001, max = 1000000.0))]
    pub aeration_depth: f64,
}
impl Default for Foam {
    fn default() -> Self {
        Self {
            visible: true,
            amount: 1.0,
            window: 0,
            bubbles: 1.0,
            lifetime: 2.5,
            renewal: 2.0,
            limits: FoamLimits::default(),
            rate: FoamRate::default(),
            pattern: None,
            bubble: None,
            softness: 0.25,
            albedo: [0.94, 0.95, 0.96],
            aeration: 20.0,
            aeration_depth: 0.15,
        }
    }
}

/// `[foam.limits]`: below the first number a potential is 0, above the second 1 (Ihmsen et al. 2012).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct FoamLimits {
    /// Convergence of the flow (1/s), which traps air.
    #[schemars(inner(range(min = 0.0, max = 1000000.0)))]
    pub convergence: [f64; 2],
    /// Vorticity, either way (1/s).
    #[schemars(inner(range(min = 0.0, max = 1000000.0)))]
    pub vorticity: [f64; 2],
    /// Loss of total pressure along the flow, and of falling spray (W for each kg of water).
    #[schemars(inner(range(min = 0.0, max = 1000000.0)))]
    pub pressure: [f64; 2],
    /// Curvature (1/m) of a crest that runs forward.
    #[schemars(inner(range(min = 0.0, max = 1000000.0)))]
    pub crest: [f64; 2],
    /// Energy of the flow (J/kg), a factor on all of the above but pressure.
    #[schemars(inner(range(min = 0.0, max = 1000000.0)))]
    pub energy: [f64; 2],
    /// Depth of the water (m), a factor on all: films hold no air.
    #[schemars(inner(range(min = 0.0, max = 1000000.0)))]
    pub depth: [f64; 2],
}
impl Default for FoamLimits {
    fn default() -> Self {
        Self {
            convergence: [1.0, 6.0],
            vorticity: [3.0, 12.0],
            pressure: [4.0, 30.0],
            crest: [1.0, 5.0],
            energy: [0.15, 2.0],
            depth: [0.01, 0.06],
        }
    }
}

/// `[foam.rate]`: density of foam formed in a second where a potential is 1 (1/s).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct FoamRate {
    /// By convergence.
    #[schemars(range(min = 0.0, max = 1000000.0))]
    pub convergence: f64,
    /// By vorticity.
    #[schemars(range(min = 0.0, max = 1000000.0))]
    pub vorticity: f64,
    /// By loss of pressure.
    #[schemars(range(min = 0.0, max = 1000000.0))]
    pub pressure: f64,
    /// By crests.
    #[schemars(range(min = 0.0, max = 1000000.0))]
    pub crest: f64,
}
impl Default for FoamRate {
    fn default() -> Self {
        Self { convergence: 4.0, vorticity: 2.0, pressure: 4.0, crest: 4.0 }
    }
}
