//! The rooms' answers to what the integrator asks about matter: ground, waterline, sky view, spray, heights.

use glam::{Vec3, Vec4};

use super::{GroundLook, Matter, SprayLook};
use crate::{
    foam::{Aeration, FoamField, FoamLook},
    mist::Mist,
    optics::Rainbow,
    particles::{self, Texel, Textures},
    surface::SplineSurface,
    terrain::{Ground, GroundPoint, PlacedTexture, SkyView, Waterline},
};

/// The matter of one frame, borrowed from the rooms that made it, all in the local frame.
#[derive(Clone, Copy, Debug)]
pub struct Looks<'a> {
    /// Colour and relief of the ground.
    pub ground: &'a Ground,
    /// The image that lies on it; `None` without one.
    pub ground_texture: Option<&'a PlacedTexture>,
    /// Levels of the nearest water, for the ground's colour.
    pub waterline: &'a Waterline,
    /// Share of the sky that the ground sees.
    pub sky_view: &'a SkyView,
    /// The spray, in the order of the lowered spheres or discs.
    pub spray: &'a particles::Spray,
    /// The water as a spline, whatever it is drawn as; `None` without water.
    pub water: Option<&'a SplineSurface>,
    /// The bed as a spline, whatever it is drawn as; `None` without a bed.
    pub bed: Option<&'a SplineSurface>,
    /// The foam; `None` without any.
    pub foam: Option<&'a FoamField>,
    /// The mist; `None` without any.
    pub mist: Option<&'a Mist>,
    /// How drops scatter sunlight; `None` where the scene does not ask.
    pub rainbow: Option<&'a Rainbow>,
    /// What is on billboards; `None` for plain discs.
    pub textures: Option<&'a Textures>,
}

impl Matter for Looks<'_> {
    fn ground(&self, position: Vec3, normal: Vec3, depth: f32, footprint: f32) -> GroundLook {
        let height_above_water = self.waterline.height_above(position);
        let point = GroundPoint { position, normal, height_above_water, water_depth: depth };
        let (albedo, normal) = self.ground.look(&point, footprint);
        GroundLook { albedo, normal, sky_view: self.sky_view.at(position.x, position.z) }
    }

    fn spray(&self, index: u32) -> SprayLook {
        let look = self.spray.appearance(index as usize);
        let velocity = self.spray.velocity[index as usize];
        SprayLook { albedo: look.albedo, opacity: look.opacity, share: look.share, velocity }
    }

    fn water_level(&self, x: f32, z: f32) -> Option<f32> {
        self.water?.height(x, z)
    }

    fn bed_level(&self, x: f32, z: f32) -> Option<f32> {
        self.bed?.height(x, z)
    }

    fn foam(&self, position: Vec3, footprint: f32) -> Option<FoamLook> {
        self.foam?.at(position.x, position.z, footprint)
    }

    fn has_foam(&self) -> bool {
        self.foam.is_some()
    }

    fn mist(&self) -> Option<&Mist> {
        self.mist
    }

    fn drop_radius(&self, index: u32) -> Option<f32> {
        Some(self.spray.radius[index as usize])
    }

    fn rainbow(&self) -> Option<&Rainbow> {
        self.rainbow
    }

    fn texture(&self, index: u32, place: [f32; 2], footprint: f32) -> Option<Texel> {
        let (seed, age) = self.spray.variation(index as usize)?;
        Some(self.textures?.at(seed, age, place, footprint))
    }

    fn ground_image(&self, position: Vec3, spans: [Vec3; 2]) -> Option<Vec4> {
        Some(self.ground_texture?.at(position, spans))
    }

    fn has_ground_image(&self) -> bool {
        self.ground_texture.is_some()
    }

    fn most_bubbles(&self) -> f32 {
        self.foam.map_or(0.0, FoamField::most_bubbles)
    }

    fn bubbles(&self, x: f32, z: f32) -> Option<Aeration> {
        self.foam?.bubbles(x, z)
    }
}
