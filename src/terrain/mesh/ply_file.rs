//! PLY, ascii and binary of both byte orders, through `ply-rs-bw`: polygons become fans of triangles.

use std::{fs::File, io::BufReader, path::Path};

use glam::{DVec3, Vec3};
use ply_rs_bw::{
    parser::{Parser, Reader},
    ply::{DefaultElement, Property, PropertyAccess, PropertyAccessResult, PropertyType},
};

use super::{DEFAULT_ALBEDO, Raw, TerrainError, broken};
use crate::images::srgb_to_linear;

struct Vertex {
    position: DVec3,
    normal: Vec3,
    color: Vec3,
}

impl PropertyAccess for Vertex {
    fn new() -> Self {
        Self { position: DVec3::NAN, normal: Vec3::ZERO, color: DEFAULT_ALBEDO }
    }
    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        let Some(value) = scalar(&property) else { return PropertyAccessResult::Ignored };
        let share = match property {
            Property::UChar(byte) => srgb_to_linear(f32::from(byte) / 255.0),
            Property::UShort(word) => srgb_to_linear(f32::from(word) / 65535.0),
            _ => value as f32,
        };
        match name {
            "x" => self.position.x = value,
            "y" => self.position.y = value,
            "z" => self.position.z = value,
            "nx" => self.normal.x = value as f32,
            "ny" => self.normal.y = value as f32,
            "nz" => self.normal.z = value as f32,
            "red" | "diffuse_red" => self.color.x = share,
            "green" | "diffuse_green" => self.color.y = share,
            "blue" | "diffuse_blue" => self.color.z = share,
            _ => return PropertyAccessResult::Ignored,
        }
        PropertyAccessResult::Set
    }
}

struct Face(Option<Vec<u32>>);

impl PropertyAccess for Face {
    fn new() -> Self {
        Self(None)
    }
    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        if !matches!(name, "vertex_indices" | "vertex_index") {
            return PropertyAccessResult::Ignored;
        }
        // A negative index leaves `None` behind, which is an error later.
        self.0 = property.to_u32_list();
        PropertyAccessResult::Set
    }
}

pub(super) fn read(path: &Path) -> Result<Raw, TerrainError> {
    let file = File::open(path).map_err(|error| broken(path, error))?;
    let bytes = file.metadata().map_err(|error| broken(path, error))?.len();
    let mut reader = Reader::new(BufReader::new(file));
    let header = Parser::<DefaultElement>::new().read_header(&mut reader).map_err(|error| broken(path, error))?;
    let mut raw = Raw::default();
    for (name, element) in &header.elements {
        // An element takes at least a byte: a count beyond the file is a lie, told before anything is reserved for it.
        if element.count as u64 > bytes {
            return Err(broken(path, format!("it claims {} of element \"{name}\" in {bytes} bytes", element.count)));
        }
        let has = |property: &str| element.properties.contains_key(property);
        match name.as_str() {
            "vertex" => {
                if let Some(missing) = ["x", "y", "z"].into_iter().find(|axis| !has(axis)) {
                    return Err(broken(path, format!("its vertices have no property \"{missing}\"")));
                }
                let vertices = Parser::<Vertex>::new()
                    .read_payload_for_element(&mut reader, element, &header)
                    .map_err(|error| broken(path, error))?;
                raw.position = vertices.iter().map(|vertex| vertex.position).collect();
                if has("nx") && has("ny") && has("nz") {
                    raw.normal = vertices.iter().map(|vertex| vertex.normal).collect();
                }
                raw.albedo = vertices.iter().map(|vertex| vertex.color).collect();
            }
            "face" => {
                let list = ["vertex_indices", "vertex_index"].into_iter().find_map(|name| element.properties.get(name));
                if !matches!(list.map(|property| &property.data_type), Some(PropertyType::List(..))) {
                    return Err(broken(path, "its faces have no list \"vertex_indices\""));
                }
                let faces = Parser::<Face>::new()
                    .read_payload_for_element(&mut reader, element, &header)
                    .map_err(|error| broken(path, error))?;
                for (number, face) in faces.into_iter().enumerate() {
                    let corners = face
                        .0
                        .ok_or_else(|| broken(path, format!("face {number} has a negative or fractional index")))?;
                    if corners.len() < 3 {
                        return Err(broken(
                            path,
                            format!("face {number} has {} corners; expected at least 3", corners.len()),
                        ));
                    }
                    raw.index.extend((1..corners.len() - 1).map(|i| [corners[0], corners[i], corners[i + 1]]));
                }
            }
            _ => {
                Parser::<DefaultElement>::new()
                    .read_payload_for_element(&mut reader, element, &header)
                    .map_err(|error| broken(path, error))?;
            }
        }
    }
    Ok(raw)
}

fn scalar(property: &Property) -> Option<f64> {
    Some(match *property {
        Property::Char(v) => f64::from(v),
        Property::UChar(v) => f64::from(v),
        Property::Short(v) => f64::from(v),
        Property::UShort(v) => f64::from(v),
        Property::Int(v) => f64::from(v),
        Property::UInt(v) => f64::from(v),
        Property::Float(v) => f64::from(v),
        Property::Double(v) => v,
        _ => return None,
    })
}
