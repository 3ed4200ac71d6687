//! Sun and lamps through and off the water's spline surface: where on it light turns towards a given point, and how
//! much of it comes together there.
//!
//! [`Manifold`] finds every such place for one point, exactly and without noise; [`BeamMap`] spreads the sun's light over
//! the whole bed at once, for previews. Neither asks what stands in the way above: whoever calls traces that. What the
//! light then does at the point is the integrator's matter.

mod beams;
mod bounds;
mod folds;
mod manifold;
mod polynomial;
mod raster;
mod screen;
mod search;

pub use beams::{BeamError, BeamMap, BeamSun};
pub use folds::Disc;
pub use manifold::Manifold;

use glam::Vec3;

/// Where light comes from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Target {
    /// From infinity: the unit vector to the light.
    Direction(Vec3),
    /// From a place (m).
    Point(Vec3),
}

/// What light does at the surface on its way.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Event {
    /// The point is in water, the light in the air above.
    Refraction,
    /// Both are in the air.
    Reflection,
}

/// A place of the surface that sends light to a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Connection {
    /// The place on the water (m).
    pub surface: Vec3,
    /// Unit upward normal of the surface there.
    pub normal: Vec3,
    /// Unit upward normal that the law of refraction or reflection holds for: the normal with its slopes tilted.
    pub facet: Vec3,
    /// Unit vector from the point to the place.
    pub direction: Vec3,
    /// Metres in that direction.
    pub distance: f32,
    /// Unit vector from the place to the light.
    pub to_light: Vec3,
    /// Metres in that direction; infinite for a light at infinity.
    pub light_distance: f32,
    /// Solid angle at the point per solid angle of the light's directions, |dΩ_from / dΩ_light|; for a light at a place,
    /// per area across the beam there, |dΩ_from / dA_light| (1/m²).
    ///
    /// Irradiance on a card with the cosine c to `direction`: E · T · n² · c · spread through the surface, E · R · c ·
    /// spread off it, with the sun's irradiance E or a lamp's intensity, and Fresnel's T or R.
    pub spread: f32,
}

/// What the search did, and what it could not settle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct ManifoldCounts {
    /// Points asked for.
    pub queries: u64,
    /// Patches and parts of patches that were looked at.
    pub cells: u64,
    /// Steps of the iteration.
    pub iterations: u64,
    /// Connections found.
    pub solutions: u64,
    /// Points for which some part of the surface could not be settled.
    pub gave_up: u64,
}

impl std::ops::AddAssign for ManifoldCounts {
    fn add_assign(&mut self, other: Self) {
        self.queries += other.queries;
        self.cells += other.cells;
        self.iterations += other.iterations;
        self.solutions += other.solutions;
        self.gave_up += other.gave_up;
    }
}

#[cfg(test)]
mod tests;
