//! The look of everything diffuse at a hit: ground, objects, spray. Both integrators light it, each in its own way.

use glam::Vec3;

use super::{film::Layer, wave::Arrival, world::World};
use crate::lower::{Material, Shape};

/// Spray that a ray passes before it takes the next for opaque; a ball counts twice, in and out.
pub(super) const PASSES: u16 = 64;

/// A diffuse thing where a ray met it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Matte {
    /// Linear Rec.709 albedo.
    pub(super) albedo: Vec3,
    /// Unit normal to shade with, towards the viewer.
    pub(super) normal: Vec3,
    /// Unit geometric normal towards the viewer; `None` for what light reaches from both sides.
    pub(super) facing: Option<Vec3>,
    /// Share of the sky that what stands around leaves free, where that is known without asking rays.
    pub(super) sky_view: f32,
    /// Share of the light that it stops.
    pub(super) opacity: f32,
    /// Velocity (m/s).
    pub(super) velocity: Vec3,
    /// Layer of what the camera's own rays see of it.
    pub(super) own_layer: Layer,
    /// Depth (m) under the water's surface; 0 in the air.
    pub(super) depth: f32,
}

impl Matte {
    /// Cosine of light from `direction`; 0 where the thing's own surface is in the way: a smooth shading normal may see
    /// what the flat surface under it turns its back to.
    #[inline]
    pub(super) fn cosine(&self, direction: Vec3) -> f32 {
        let seen = self.facing.is_none_or(|facing| facing.dot(direction) > 0.0);
        if seen { self.normal.dot(direction).max(0.0) } else { 0.0 }
    }
}

impl World<'_> {
    /// The diffuse look of what a ray met; `None` where it leaves a droplet from inside and nothing is there.
    pub(super) fn matte(&self, arrival: &Arrival) -> Option<Matte> {
        let Arrival { carrier, direction, part, primitive, contact, .. } = arrival;
        let towards_viewer = |normal: Vec3| if direction.dot(normal) > 0.0 { -normal } else { normal };
        let mut matte = Matte {
            albedo: Vec3::ZERO,
            normal: if direction.dot(contact.normal) > 0.0 { -contact.shading } else { contact.shading },
            facing: Some(towards_viewer(contact.normal)),
            sky_view: 1.0,
            opacity: 1.0,
            velocity: Vec3::ZERO,
            own_layer: Layer::Terrain,
            depth: if carrier.in_water { self.depth_at(contact.position) } else { 0.0 },
        };
        match &part.material {
            Material::Ground => {
                let footprint = carrier.distance * self.camera.pixel_angle() as f32;
                let look = self.matter.ground(contact.position, contact.shading, matte.depth, footprint);
                matte.normal = if direction.dot(contact.normal) > 0.0 { -look.normal } else { look.normal };
                matte.sky_view = look.sky_view;
                matte.albedo = look.albedo;
            }
            Material::Spray { first } => {
                let ball = matches!(part.shape, Shape::Spheres(_));
                if ball && direction.dot(contact.normal) > 0.0 && carrier.passed < PASSES {
                    return None;
                }
                let look = self.matter.spray(first + *primitive);
                matte.own_layer = Layer::Spray;
                matte.velocity = look.velocity;
                matte.opacity = look.opacity;
                if !ball {
                    matte.facing = None;
                }
                matte.albedo = look.albedo;
            }
            Material::Diffuse(albedo) => matte.albedo = *albedo,
            Material::VertexColours(colours) => matte.albedo = vertex_colour(arrival, colours),
            // Water has a shading of its own.
            Material::Water => {}
        }
        Some(matte)
    }

    /// Depth (m) of a point under the water's surface above it; 0 where the water's height is not known.
    fn depth_at(&self, position: Vec3) -> f32 {
        self.matter.water_level(position.x, position.z).map_or(0.0, |level| (level - position.y).max(0.0))
    }
}

fn vertex_colour(arrival: &Arrival, colours: &[Vec3]) -> Vec3 {
    let Shape::Triangles(triangles) = &arrival.part.shape else { return Vec3::ZERO };
    let [a, b, c] = triangles.index[arrival.primitive as usize].map(|corner| colours[corner as usize]);
    let [u, v] = arrival.place;
    a * (1.0 - u - v) + b * u + c * v
}
