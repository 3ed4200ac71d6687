//! Scene and state → backend-neutral parts around a scene origin: the last place where anything is double precision.

mod frame;
mod memory;
mod spray;
mod volume;

pub use frame::{
    Environment, LowerError, LoweredFrame, TERRAIN_SIDES, View, lower, lower_within, points_to_frame, scene_origin,
};

pub use spray::{Thinning, class_counts};
pub use volume::within_budget;

pub use crate::mist::Volume;

use std::sync::Arc;

use glam::{DVec3, Vec3};

use crate::math::RoundCone;
use crate::surface::{DisplacedSurface, Sides, SplineSurface};
use crate::terrain::{MeshAlbedo, MeshImages};

/// Everything that can be hit, ready for an accelerator.
#[derive(Clone, Debug, Default)]
pub struct Lowered {
    /// Where the local frame's zero lies in the files' frame (m).
    pub origin: DVec3,
    /// Parts; a hit's part is an index into this.
    pub parts: Vec<Part>,
}

/// One named thing with one shape.
#[derive(Clone, Debug)]
pub struct Part {
    /// The name that users see: `water`, `water_sides`, `terrain`, `spray`, `panel_0`, `sphere_0`, a mesh's file stem.
    pub name: String,
    /// What it is made of.
    pub material: Material,
    /// Its geometry.
    pub shape: Shape,
}

/// What a part is made of.
#[derive(Clone, Debug)]
pub enum Material {
    /// The dielectric surface of the water, or one of its sides.
    Water,
    /// Water joined from spray. Inside of the other water it has no border, nor has the other's surface inside of it.
    Sheet,
    /// The ground, coloured by the terrain room.
    Ground,
    /// Diffuse spray, coloured per particle.
    Spray {
        /// The particle that the part's first primitive is.
        first: u32,
    },
    /// Diffuse, one albedo.
    Diffuse(Vec3),
    /// Diffuse, one albedo per triangle vertex.
    VertexColours(Arc<Vec<Vec3>>),
    /// Diffuse: one albedo, or one per triangle vertex, times what the images show.
    Images {
        /// Linear Rec.709 albedo.
        albedo: Arc<MeshAlbedo>,
        /// Images over the same triangles.
        images: Arc<MeshImages>,
    },
}

/// Geometry in the local frame (m).
#[derive(Clone, Debug)]
pub enum Shape {
    /// The water or the bed as a spline.
    Surface(Arc<SplineSurface>),
    /// The water as a spline whose control points are displaced sideways.
    Displaced(Arc<DisplacedSurface>),
    /// The water's walls at the domain's edge.
    Sides(Arc<Sides>),
    /// Spheres: the spray, or one boulder.
    Spheres(Arc<Spheres>),
    /// Discs: billboards.
    Discs(Arc<Discs>),
    /// Round curves: streaks of spray.
    Curves(Arc<Curves>),
    /// Triangles.
    Triangles(Arc<Triangles>),
}

/// Spheres, one array per field.
#[derive(Clone, Debug, Default)]
pub struct Spheres {
    /// Centres.
    pub center: Vec<Vec3>,
    /// Radii, positive.
    pub radius: Vec<f32>,
}

/// Discs, one array per field.
#[derive(Clone, Debug, Default)]
pub struct Discs {
    /// Centres.
    pub center: Vec<Vec3>,
    /// Radii, positive.
    pub radius: Vec<f32>,
    /// Unit normals; `None`: each disc faces the origin of the ray that asks, and a ray that starts within a disc's radius of
    /// its centre does not meet it.
    pub normal: Option<Vec<Vec3>>,
}

/// Round, straight curves, one array per field: each the hull of the balls at its two ends.
#[derive(Clone, Debug, Default)]
pub struct Curves {
    /// Centres of both ends: head, tail.
    pub ends: Vec<[Vec3; 2]>,
    /// Radii at both ends; a curve without a positive one is not there.
    pub radius: Vec<[f32; 2]>,
}

impl Curves {
    /// Curve `index` in double precision.
    #[inline]
    pub fn cone(&self, index: usize) -> RoundCone {
        RoundCone::new(self.ends[index].map(|end| end.as_dvec3()), self.radius[index].map(f64::from))
    }

    /// Whether curve `index` can be hit: finite ends and radii, none negative and one of them positive.
    #[inline]
    pub fn is_sound(&self, index: usize) -> bool {
        let [head, tail] = self.radius[index];
        let finite = self.ends[index].iter().all(|end| end.is_finite()) && head.is_finite() && tail.is_finite();
        finite && head >= 0.0 && tail >= 0.0 && head.max(tail) > 0.0
    }
}

/// An indexed triangle mesh.
#[derive(Clone, Debug, Default)]
pub struct Triangles {
    /// Vertices.
    pub position: Vec<Vec3>,
    /// Unit shading normals per vertex, or empty for flat triangles.
    pub normal: Vec<Vec3>,
    /// Vertex indices, counter-clockwise seen from outside.
    pub index: Vec<[u32; 3]>,
}
