//! Wavefront OBJ with its materials' diffuse colour and image (`map_Kd`, beside the OBJ, without options), through `tobj`.

use std::path::Path;

use glam::{DVec2, DVec3, Vec2, Vec3};

use super::images::{NO_IMAGE, placed};
use super::{DEFAULT_ALBEDO, Raw, TerrainError, broken};
use crate::images::Wrap;

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
        let material = mesh.material_id.and_then(|id| materials.get(id));
        let map = material.and_then(|material| material.diffuse_texture.as_deref().map(|map| (&material.name, map)));
        let diffuse = material.and_then(|material| material.diffuse);
        let plain = if map.is_some() { Vec3::ONE } else { DEFAULT_ALBEDO };
        let albedo = diffuse.map_or(plain, |color| DVec3::from_array(color).as_vec3());
        if mesh.vertex_color.len() == mesh.positions.len() {
            raw.albedo.extend(mesh.vertex_color.chunks_exact(3).map(|values| vector(values).as_vec3()));
        } else {
            raw.albedo.extend(std::iter::repeat_n::<Vec3>(albedo, count));
        }
        let image = match map {
            Some((name, file)) => {
                let material = format!("material {name:?}");
                if file.starts_with('-') {
                    return Err(broken(
                        path,
                        format!("{material}: map_Kd {file}: expected a file's name without options"),
                    ));
                }
                if mesh.texcoords.len() != 2 * count {
                    let found = mesh.texcoords.len() / 2;
                    return Err(broken(
                        path,
                        format!("{material} has an image, but only {found} of {count} vertices have coordinates on it"),
                    ));
                }
                for (vertex, place) in mesh.texcoords.chunks_exact(2).enumerate() {
                    // Upwards here, downwards in images.
                    let place = DVec2::new(place[0], 1.0 - place[1]).as_vec2();
                    raw.place.push(placed(path, &material, vertex, place)?);
                }
                let bytes = || std::fs::read(path.with_file_name(file)).map_err(|error| error.to_string());
                raw.images.image(path, &material, file, [Wrap::Repeat; 2], bytes)?
            }
            None => {
                raw.place.extend(std::iter::repeat_n(Vec2::ZERO, count));
                NO_IMAGE
            }
        };
        for corners in mesh.indices.chunks_exact(3) {
            // Relative to the model's own vertices; a sum beyond u32 is out of range and said so by the checks.
            raw.index.push([0, 1, 2].map(|i| corners[i].saturating_add(first)));
        }
        raw.shown.resize(raw.index.len(), image);
    }
    Ok(raw)
}
