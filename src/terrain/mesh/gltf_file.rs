//! glTF 2.0 (.gltf with its buffers, .glb), through the crate `gltf`: node transforms, base colour factors and images, vertex
//! colours. What is on an image is opaque, whatever its alpha; between its pixels it is mixed, whatever filter the file names.
//!
//! The crate's readers index and add without checks, so every accessor is checked here before it is read.

use std::path::Path;

use glam::{DMat4, DVec3, Vec2, Vec3};
use gltf::{Accessor, Material, Node, Primitive, Semantic, accessor::DataType, accessor::Dimensions, mesh::Mode};

use super::images::{NO_IMAGE, placed};
use super::{DEFAULT_ALBEDO, Raw, TerrainError, broken};
use crate::images::Wrap;

pub(super) fn read(path: &Path) -> Result<Raw, TerrainError> {
    let bytes = std::fs::read(path).map_err(|error| broken(path, error))?;
    let gltf::Gltf { document, blob } =
        gltf::Gltf::from_slice_without_validation(&bytes).map_err(|error| broken(path, error))?;
    // The crate's validation takes it for granted that these exist, and panics where they do not (gltf-json 1.4.1).
    let json = document.into_json();
    for primitive in json.meshes.iter().flat_map(|mesh| &mesh.primitives) {
        if let Some(missing) = primitive.attributes.values().find(|index| index.value() >= json.accessors.len()) {
            return Err(broken(
                path,
                format!("a primitive names accessor {missing}; there are {}", json.accessors.len()),
            ));
        }
    }
    let document = gltf::Document::from_json(json).map_err(|error| broken(path, error))?;
    for buffer in document.buffers() {
        if let gltf::buffer::Source::Uri(uri) = buffer.source()
            && !decodes(uri)
        {
            return Err(broken(path, format!("buffer {} has a malformed address", buffer.index())));
        }
    }
    let buffers = gltf::import_buffers(&document, path.parent(), blob).map_err(|error| broken(path, error))?;
    let mut reader = Reader {
        path,
        document: &document,
        buffers: &buffers,
        visited: vec![false; document.nodes().count()],
        raw: Raw::default(),
        flat: false,
    };
    // Without a scene every node that is no one's child stands in it.
    match document.default_scene().or_else(|| document.scenes().next()) {
        Some(scene) => {
            for node in scene.nodes() {
                reader.add(node, DMat4::IDENTITY)?;
            }
        }
        None => {
            let mut is_child = vec![false; document.nodes().count()];
            for child in document.nodes().flat_map(|node| node.children()) {
                is_child[child.index()] = true;
            }
            for node in document.nodes().filter(|node| !is_child[node.index()]) {
                reader.add(node, DMat4::IDENTITY)?;
            }
        }
    }
    if reader.flat {
        // Some primitive has no normals: those that have would be the exception, and a mesh has either all or none.
        reader.raw.normal.clear();
    }
    Ok(reader.raw)
}

/// Whether an address is percent-encoded UTF-8, as the crate takes for granted.
fn decodes(uri: &str) -> bool {
    let bytes = uri.as_bytes();
    let mut out = Vec::with_capacity(bytes.len());
    let mut i = 0;
    while i < bytes.len() {
        let code = (bytes[i] == b'%')
            .then(|| uri.get(i + 1..i + 3))
            .flatten()
            .and_then(|hex| u8::from_str_radix(hex, 16).ok());
        out.push(code.unwrap_or(bytes[i]));
        i += if code.is_some() { 3 } else { 1 };
    }
    std::str::from_utf8(&out).is_ok()
}

/// A material's image and where it lies.
struct Painted {
    material: String,
    /// Its number among the gathered ones.
    image: u32,
    /// Which of a primitive's sets of coordinates.
    set: u32,
    offset: Vec2,
    scale: Vec2,
    /// Radians.
    rotation: f32,
}

impl Painted {
    /// Coordinates by `KHR_texture_transform`, whose example says which way it turns: with the third axis towards the viewer and
    /// v down, from v to u.
    fn place(&self, coordinates: [f32; 2]) -> Vec2 {
        let Vec2 { x, y } = Vec2::from_array(coordinates) * self.scale;
        let (sine, cosine) = self.rotation.sin_cos();
        self.offset + Vec2::new(cosine * x + sine * y, cosine * y - sine * x)
    }
}

struct Reader<'a> {
    path: &'a Path,
    document: &'a gltf::Document,
    buffers: &'a [gltf::buffer::Data],
    visited: Vec<bool>,
    raw: Raw,
    flat: bool,
}

impl Reader<'_> {
    /// Adds a node and all under it. An explicit stack: a chain of nodes may be longer than ours is deep.
    fn add(&mut self, root: Node<'_>, transform: DMat4) -> Result<(), TerrainError> {
        let mut stack = vec![(root, transform)];
        while let Some((node, parent)) = stack.pop() {
            // A node has one parent at most; a second visit is a cycle or a bomb.
            if std::mem::replace(&mut self.visited[node.index()], true) {
                return Err(broken(self.path, format!("node {} has two parents or is its own ancestor", node.index())));
            }
            let local = node.transform().matrix().map(|column| column.map(f64::from));
            let transform = parent * DMat4::from_cols_array_2d(&local);
            for primitive in node.mesh().iter().flat_map(gltf::Mesh::primitives) {
                self.primitive(&primitive, transform)?;
            }
            stack.extend(node.children().map(|child| (child, transform)));
        }
        Ok(())
    }

    fn primitive(&mut self, primitive: &Primitive<'_>, transform: DMat4) -> Result<(), TerrainError> {
        if !matches!(primitive.mode(), Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan) {
            return Ok(());
        }
        let wrong = |what: &str| broken(self.path, what);
        let Some(positions) = primitive.get(&Semantic::Positions) else {
            return Err(wrong("a primitive has no positions"));
        };
        let count = positions.count();
        self.check(&positions, Dimensions::Vec3, &[DataType::F32], count)?;
        let reader = primitive.reader(|buffer| self.buffers.get(buffer.index()).map(|data| &data.0[..]));
        let first = u32::try_from(self.raw.position.len()).map_err(|_| wrong("more than 2^32 vertices"))?;
        let positions = reader.read_positions().ok_or_else(|| wrong("positions cannot be read"))?;
        self.raw.position.extend(positions.map(|p| transform.transform_point3(Vec3::from_array(p).as_dvec3())));

        if let Some(normals) = primitive.get(&Semantic::Normals) {
            self.check(&normals, Dimensions::Vec3, &[DataType::F32], count)?;
            // Normals go by the cofactors, which a flattening transform still has.
            let m = glam::DMat3::from_mat4(transform);
            let cofactor =
                glam::DMat3::from_cols(m.y_axis.cross(m.z_axis), m.z_axis.cross(m.x_axis), m.x_axis.cross(m.y_axis));
            let side = if transform.determinant() < 0.0 { -1.0 } else { 1.0 };
            let normals = reader.read_normals().ok_or_else(|| wrong("normals cannot be read"))?;
            let turn = |n: [f32; 3]| {
                let turned: DVec3 = side * (cofactor * Vec3::from_array(n).as_dvec3());
                turned.normalize_or_zero().as_vec3()
            };
            self.raw.normal.extend(normals.map(turn));
        } else {
            self.flat = true;
        }

        let material = primitive.material();
        let base = if material.index().is_some() {
            let [r, g, b, _] = material.pbr_metallic_roughness().base_color_factor();
            Vec3::new(r, g, b)
        } else {
            DEFAULT_ALBEDO
        };
        if let Some(colors) = primitive.get(&Semantic::Colors(0)) {
            let size = if colors.dimensions() == Dimensions::Vec4 { Dimensions::Vec4 } else { Dimensions::Vec3 };
            self.check(&colors, size, &[DataType::F32, DataType::U8, DataType::U16], count)?;
            let colors = reader.read_colors(0).ok_or_else(|| wrong("colours cannot be read"))?;
            // Without a material the vertex colour alone counts.
            let base = if material.index().is_some() { base } else { Vec3::ONE };
            self.raw.albedo.extend(colors.into_rgb_f32().map(|color| base * Vec3::from_array(color)));
        } else {
            self.raw.albedo.extend(std::iter::repeat_n(base, count));
        }

        let painted = self.painted(&material)?;
        match &painted {
            Some(painted) => {
                let Some(places) = primitive.get(&Semantic::TexCoords(painted.set)) else {
                    return Err(wrong(&format!(
                        "{} has an image, but a primitive has no TEXCOORD_{}",
                        painted.material, painted.set
                    )));
                };
                self.check(&places, Dimensions::Vec2, &[DataType::F32, DataType::U8, DataType::U16], count)?;
                let places =
                    reader.read_tex_coords(painted.set).ok_or_else(|| wrong("texture coordinates cannot be read"))?;
                for (vertex, place) in places.into_f32().enumerate() {
                    let place = placed(self.path, &painted.material, vertex, painted.place(place))?;
                    self.raw.place.push(place);
                }
            }
            None => self.raw.place.extend(std::iter::repeat_n(Vec2::ZERO, count)),
        }

        let corners: Vec<u32> = match primitive.indices() {
            Some(indices) => {
                self.check(
                    &indices,
                    Dimensions::Scalar,
                    &[DataType::U8, DataType::U16, DataType::U32],
                    indices.count(),
                )?;
                reader.read_indices().ok_or_else(|| wrong("indices cannot be read"))?.into_u32().collect()
            }
            None => (0..count as u32).collect(),
        };
        if let Some(bad) = corners.iter().find(|&&corner| corner as usize >= count) {
            return Err(broken(self.path, format!("an index names vertex {bad} of a primitive that has {count}")));
        }
        let mirrored = transform.determinant() < 0.0;
        let mut push = |a: u32, b: u32, c: u32| {
            let [a, b, c] = [a, b, c].map(|corner| corner.saturating_add(first));
            self.raw.index.push(if mirrored { [a, c, b] } else { [a, b, c] });
        };
        match primitive.mode() {
            Mode::TriangleStrip => {
                for (i, t) in corners.windows(3).enumerate() {
                    if i % 2 == 0 { push(t[0], t[1], t[2]) } else { push(t[1], t[0], t[2]) }
                }
            }
            Mode::TriangleFan => corners.windows(2).skip(1).for_each(|t| push(corners[0], t[0], t[1])),
            _ => corners.chunks_exact(3).for_each(|t| push(t[0], t[1], t[2])),
        }
        self.raw.shown.resize(self.raw.index.len(), painted.map_or(NO_IMAGE, |painted| painted.image));
        Ok(())
    }

    /// The image of a material's base colour, read; `None` if it has none.
    fn painted(&mut self, material: &Material<'_>) -> Result<Option<Painted>, TerrainError> {
        let Some(info) = material.pbr_metallic_roughness().base_color_texture() else { return Ok(None) };
        let number = material.index().map_or_else(String::new, |index| index.to_string());
        let material = format!("material {}", material.name().map_or(number, |name| format!("{name:?}")));
        let texture = info.texture();
        let wrap = |mode| match mode {
            gltf::texture::WrappingMode::ClampToEdge => Wrap::Clamp,
            gltf::texture::WrappingMode::MirroredRepeat => Wrap::Mirror,
            gltf::texture::WrappingMode::Repeat => Wrap::Repeat,
        };
        let wrap = [texture.sampler().wrap_s(), texture.sampler().wrap_t()].map(wrap);
        let index = texture.source().index();
        // As the file has it: the crate takes it for granted that an image in a view says what kind of image it is.
        let source = &self.document.as_json().images[index];
        let address = source.uri.as_deref().filter(|uri| !uri.starts_with("data:"));
        // No address has a blank.
        let name = address.map_or_else(|| format!("embedded image {index}"), str::to_owned);
        let (path, buffers, document) = (self.path, self.buffers, self.document);
        let bytes = || match (&source.uri, source.buffer_view) {
            (Some(uri), None) if decodes(uri) => {
                let read = gltf::buffer::Data::from_source(gltf::buffer::Source::Uri(uri), path.parent());
                read.map(|data| data.0).map_err(|error| error.to_string())
            }
            (None, Some(view)) => {
                let view = document.views().nth(view.value()).ok_or("its buffer view is not there")?;
                let data = buffers.get(view.buffer().index()).map_or(&[][..], |data| &data.0);
                let end = view.offset().checked_add(view.length());
                let within = end.and_then(|end| data.get(view.offset()..end));
                within.map(<[u8]>::to_vec).ok_or_else(|| "its buffer view reaches beyond its buffer".to_owned())
            }
            _ => Err("expected either an address or a buffer view".to_owned()),
        };
        let image = self.raw.images.image(path, &material, &name, wrap, bytes)?;
        let transform = info.texture_transform();
        let transform = transform.as_ref();
        Ok(Some(Painted {
            material,
            image,
            set: transform.and_then(|transform| transform.tex_coord()).unwrap_or(info.tex_coord()),
            offset: transform.map_or(Vec2::ZERO, |transform| transform.offset().into()),
            scale: transform.map_or(Vec2::ONE, |transform| transform.scale().into()),
            rotation: transform.map_or(0.0, |transform| transform.rotation()),
        }))
    }

    /// That an accessor is of this shape and lies within its view and its buffer.
    fn check(
        &self,
        accessor: &Accessor<'_>,
        size: Dimensions,
        types: &[DataType],
        count: usize,
    ) -> Result<(), TerrainError> {
        let number = accessor.index();
        let wrong = |reason: String| Err(broken(self.path, format!("accessor {number}: {reason}")));
        if accessor.dimensions() != size || !types.contains(&accessor.data_type()) {
            return wrong(format!(
                "{:?} of {:?}; expected {size:?} of {types:?}",
                accessor.dimensions(),
                accessor.data_type()
            ));
        }
        if accessor.count() != count || count == 0 {
            return wrong(format!("{} values; expected {}", accessor.count(), count.max(1)));
        }
        if accessor.sparse().is_some() {
            return wrong("sparse; only dense accessors are read".into());
        }
        let Some(view) = accessor.view() else { return wrong("no buffer view".into()) };
        let item = accessor.size();
        let stride = view.stride().unwrap_or(item);
        let end = stride.checked_mul(count - 1).and_then(|last| last.checked_add(item)?.checked_add(accessor.offset()));
        let view_end = view.offset().checked_add(view.length());
        let buffer = self.buffers.get(view.buffer().index()).map_or(0, |data| data.0.len());
        match (end, view_end) {
            (Some(end), Some(view_end)) if stride >= item && end <= view.length() && view_end <= buffer => Ok(()),
            _ => wrong(format!(
                "{count} values of {item} bytes, {stride} apart, reach beyond its view or buffer of {buffer} bytes"
            )),
        }
    }
}
