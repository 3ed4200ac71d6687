//! Meshes from files: OBJ, glTF and PLY → one list of triangles with albedo, checked.
//!
//! One reader per format beside this file; what they have in common, and what every mesh must keep to, is here.

mod gltf_file;
mod images;
mod obj_file;
mod ply_file;

use std::path::Path;
use std::sync::Arc;

use glam::{DVec3, Vec2, Vec3};

use super::TerrainError;
pub use images::MeshImages;

/// Albedo of meshes whose file says nothing about colour: a mid grey.
pub const DEFAULT_ALBEDO: Vec3 = Vec3::splat(0.5);

/// Triangles in the file's own frame (m, y up), checked: finite, indices in range, at least one.
#[derive(Clone, Debug, PartialEq)]
pub struct Mesh {
    /// Vertices.
    pub position: Vec<DVec3>,
    /// Unit shading normals per vertex, or empty for flat triangles.
    pub normal: Vec<Vec3>,
    /// Vertex indices, counter-clockwise seen from outside.
    pub index: Vec<[u32; 3]>,
    /// Linear Rec.709 albedo.
    pub albedo: MeshAlbedo,
    /// What multiplies it on triangles that show an image; `None` if none does.
    pub images: Option<Arc<MeshImages>>,
}

/// One albedo, or one per vertex.
#[derive(Clone, Debug, PartialEq)]
pub enum MeshAlbedo {
    /// The same everywhere.
    Uniform(Vec3),
    /// As many as vertices.
    PerVertex(Vec<Vec3>),
}

impl Mesh {
    /// Vertices in single precision around `origin`.
    pub fn positions_around(&self, origin: DVec3) -> Vec<Vec3> {
        self.position.iter().map(|&position| (position - origin).as_vec3()).collect()
    }
}

/// Vertices as a file gives them, before the checks.
#[derive(Debug, Default)]
struct Raw {
    position: Vec<DVec3>,
    /// As many as vertices, or not used.
    normal: Vec<Vec3>,
    index: Vec<[u32; 3]>,
    albedo: Vec<Vec3>,
    /// As many as vertices where there are images, 0 on what shows none.
    place: Vec<Vec2>,
    /// As many as triangles where there are images: the number of one, or [`images::NO_IMAGE`].
    shown: Vec<u32>,
    images: images::Gathered,
}

/// Reads a mesh; the file's ending says which format (.obj, .gltf, .glb, .ply).
///
/// Base colours of materials and vertex colours become albedo, 8- and 16-bit vertex colours of PLY are decoded from sRGB.
/// They are multiplied by the materials' images (base colour of glTF, `map_Kd` of OBJ), which are held whole, with mip levels.
///
/// # Errors
/// An unknown ending; a file that is missing, cut off or broken; numbers that are not finite; an index beyond the vertices; no
/// triangle; an albedo outside 0..1; an image that is missing, broken or too large, or whose coordinates are missing or wrong.
pub fn load_mesh(path: &Path) -> Result<Mesh, TerrainError> {
    let ending = path.extension().and_then(|ending| ending.to_str()).unwrap_or("").to_ascii_lowercase();
    let raw = match ending.as_str() {
        "obj" => obj_file::read(path)?,
        "gltf" | "glb" => gltf_file::read(path)?,
        "ply" => ply_file::read(path)?,
        _ => return Err(TerrainError::UnknownFormat { path: path.to_owned() }),
    };
    check(path, raw)
}

fn broken(path: &Path, reason: impl ToString) -> TerrainError {
    TerrainError::Mesh { path: path.to_owned(), reason: reason.to_string() }
}

fn check(path: &Path, raw: Raw) -> Result<Mesh, TerrainError> {
    let Raw { position, mut normal, index, albedo, place, shown, images } = raw;
    let vertices = position.len();
    let wrong = |what, vertex, value: DVec3, expected| {
        Err(TerrainError::Vertex { path: path.to_owned(), what, vertex, value: value.to_array(), expected })
    };
    if index.is_empty() {
        return Err(TerrainError::Empty { path: path.to_owned(), vertices });
    }
    if let Some((vertex, value)) = position.iter().enumerate().find(|(_, value)| !value.is_finite()) {
        return wrong("the position", vertex, *value, "finite numbers");
    }
    if let Some((triangle, &index)) = index
        .iter()
        .enumerate()
        .find_map(|(i, corners)| corners.iter().find(|&&c| c as usize >= vertices).map(|c| (i, c)))
    {
        return Err(TerrainError::Index { path: path.to_owned(), triangle, index, vertices });
    }
    if normal.len() != vertices {
        normal.clear();
    }
    for (vertex, value) in normal.iter_mut().enumerate() {
        // Double precision: a normal may be of any length.
        match value.as_dvec3().try_normalize() {
            Some(unit) if value.is_finite() => *value = unit.as_vec3(),
            _ => return wrong("the normal", vertex, value.as_dvec3(), "a finite vector other than 0"),
        }
    }
    let albedo = if albedo.len() == vertices { albedo } else { vec![DEFAULT_ALBEDO] };
    if let Some((vertex, value)) =
        albedo.iter().enumerate().find(|(_, value)| !(value.cmpge(Vec3::ZERO).all() && value.cmple(Vec3::ONE).all()))
    {
        return wrong("the albedo", vertex, value.as_dvec3(), "0..1");
    }
    let albedo = if albedo.iter().all(|value| *value == albedo[0]) {
        MeshAlbedo::Uniform(albedo[0])
    } else {
        MeshAlbedo::PerVertex(albedo)
    };
    let images = images.over(shown, place).map(Arc::new);
    Ok(Mesh { position, normal, index, albedo, images })
}

#[cfg(test)]
mod image_tests;
#[cfg(test)]
mod tests;
