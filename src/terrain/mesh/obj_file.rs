//! Wavefront OBJ with its materials' diffuse colour, through `tobj`.

use std::path::Path;

use glam::{DVec3, Vec3};

use super::{DEFAULT_ALBEDO, Raw, TerrainError, broken};

pub(super) fn read(path: &Path) -> Result<Raw, TerrainError> {
    let options = tobj::LoadOptions { triangulate: true, single_index: true, ..Default::default() };
    let (models, materials) = tobj::load_obj(path, &options).map_err(|error| broken(path, error))?;
    let materials = materials.unwrap_or_else(|error| {
        // An OBJ without its .mtl is common and still a shape.
        tracing::warn!("{}: its materials cannot be read ({error}); taken as grey", path.display());
        Vec::new()
    });
    let mut raw = Raw::default();
    let with_normals = models.iter().all(|model| model.mesh.normals.len() == model.mesh.positions.len());
    for model in models {
        let mesh = model.mesh;
        let first = u32::try_from(raw.position.len()).map_err(|_| broken(path, "more than 2^32 vertices"))?;
        let count = mesh.positions.len() / 3;
        let vector = |values: &[f64]| DVec3::new(values[0], values[1], values[2]);
        raw.position.extend(mesh.positions.chunks_exact(3).map(vector));
        if with_normals {
            raw.normal.extend(mesh.normals.chunks_exact(3).map(|values| vector(values).as_vec3()));
        }
        let diffuse = mesh.material_id.and_then(|id| materials.get(id)).and_then(|material| material.diffuse);
        let albedo = diffuse.map_or(DEFAULT_ALBEDO, |color| DVec3::from_array(color).as_vec3());
        if mesh.vertex_color.len() == mesh.positions.len() {
            raw.albedo.extend(mesh.vertex_color.chunks_exact(3).map(|values| vector(values).as_vec3()));
        } else {
            raw.albedo.extend(std::iter::repeat_n::<Vec3>(albedo, count));
        }
        for corners in mesh.indices.chunks_exact(3) {
            // Relative to the model's own vertices; a sum beyond u32 is out of range and said so by the checks.
            raw.index.push([0, 1, 2].map(|i| corners[i].saturating_add(first)));
        }
    }
    Ok(raw)
}
