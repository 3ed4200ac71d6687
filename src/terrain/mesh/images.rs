//! Images on meshes: what each triangle shows, where on the image its vertices lie, and the mean over what a ray covers.
//!
//! Readers gather the images here, each once, whole and decoded; the format of the mesh is theirs.

use std::collections::HashMap;
use std::path::Path;

use glam::{DVec3, Vec2, Vec3, Vec4};
use sha2::{Digest, Sha256};

use super::super::albedo_image::{LIMIT, hold};
use super::{TerrainError, broken};
use crate::images::{Alpha, Texture, Unreadable, Wrap, read_bytes};

/// What a triangle without an image shows.
pub(super) const NO_IMAGE: u32 = u32::MAX;

/// Coordinates from here on, single precision tells no place within an image apart.
const FARTHEST: f32 = (1 << f32::MANTISSA_DIGITS) as f32;

/// The base colour images of a mesh, multiplied by its colours.
#[derive(Clone, Debug)]
pub struct MeshImages {
    images: Vec<Texture<Vec3>>,
    /// Per triangle: which image, or none.
    shown: Vec<u32>,
    /// Per vertex: its place on the image, 0..1 from the left and from the top.
    place: Vec<Vec2>,
    /// Of all that its colours depend on.
    digest: [u8; 32],
}

impl PartialEq for MeshImages {
    fn eq(&self, other: &Self) -> bool {
        self.digest == other.digest
    }
}

impl MeshImages {
    /// The image's linear Rec.709 colour on a triangle; white on one without an image. `corners` are its vertices, `position`
    /// theirs (m); `u` and `v` are the weights of the second and the third; two `spans` across it (m) give the footprint.
    pub fn at(
        &self,
        triangle: u32,
        corners: [u32; 3],
        position: [Vec3; 3],
        [u, v]: [f32; 2],
        spans: [Vec3; 2],
    ) -> Vec3 {
        let image = self.shown.get(triangle as usize).and_then(|&image| self.images.get(image as usize));
        let Some(image) = image else { return Vec3::ONE };
        let [a, b, c] = corners.map(|corner| self.place[corner as usize]);
        // In double precision the square of the area of any triangle that can be hit is a number.
        let [p, q, r] = position.map(Vec3::as_dvec3);
        let (along, aside) = (q - p, r - p);
        let normal = along.cross(aside);
        let on_image = |span: Vec3| {
            let span: DVec3 = span.as_dvec3();
            // A triangle without area has no spans; the lookup is then of a point.
            let share = |way: DVec3| (way.dot(normal) / normal.length_squared()) as f32;
            (b - a) * share(span.cross(aside)) + (c - a) * share(along.cross(span))
        };
        image.at(a * (1.0 - u - v) + b * u + c * v, spans.map(on_image))
    }

    /// A hash of the images' files, how they go on beyond their edges, and where they lie.
    pub fn digest(&self) -> [u8; 32] {
        self.digest
    }

    /// Bytes of memory.
    pub fn bytes(&self) -> u64 {
        // Every level has a quarter of the pixels of the one before.
        let image = |[width, height]: [usize; 2]| (width * height * size_of::<Vec3>()) as u64 * 4 / 3;
        let images: u64 = self.images.iter().map(|texture| image(texture.size())).sum();
        images + (self.place.len() * size_of::<Vec2>() + self.shown.len() * size_of::<u32>()) as u64
    }
}

/// The images of a mesh that is being read.
#[derive(Debug, Default)]
pub(super) struct Gathered {
    images: Vec<Texture<Vec3>>,
    known: HashMap<(String, [Wrap; 2]), u32>,
    pixels: usize,
    hash: Sha256,
}

impl Gathered {
    /// The number of an image, which is read unless it has been. `name` tells one image from another and stands in errors, as
    /// `material` does.
    ///
    /// # Errors
    /// The bytes cannot be had; they are no image; too many pixels; a pixel that is not finite.
    pub(super) fn image(
        &mut self,
        path: &Path,
        material: &str,
        name: &str,
        wrap: [Wrap; 2],
        bytes: impl FnOnce() -> Result<Vec<u8>, String>,
    ) -> Result<u32, TerrainError> {
        if let Some(&known) = self.known.get(&(name.to_owned(), wrap)) {
            return Ok(known);
        }
        let wrong = |reason: String| broken(path, format!("{material}: {name}: {reason}"));
        let bytes = bytes().map_err(wrong)?;
        let told = path.with_file_name(name);
        let pixels = &mut self.pixels;
        let claim = |width: usize, height: usize| {
            *pixels = pixels.saturating_add(width.saturating_mul(height));
            if *pixels > LIMIT {
                let reason = format!(
                    "it claims {width} x {height} pixels, {pixels} with those before it; expected at most {LIMIT}"
                );
                return Err(Unreadable { path: told.clone(), reason });
            }
            Ok(())
        };
        // A mesh is opaque: what its image covers nothing with has its colour all the same.
        let opaque = |pixel: Vec4, alpha: Alpha| match alpha {
            Alpha::Premultiplied if pixel.w > 0.0 => (pixel.truncate() / pixel.w).extend(1.0),
            _ => pixel.truncate().extend(1.0),
        };
        let mut image = read_bytes(&told, &bytes, claim, opaque).map_err(|error| wrong(error.reason))?;
        hold(&told, &mut image).map_err(|error| wrong(error.reason))?;
        self.hash.update((bytes.len() as u64).to_le_bytes());
        self.hash.update(&bytes);
        self.hash.update(format!("{wrap:?}"));
        let pixels = image.pixels.into_iter().map(Vec4::truncate).collect();
        let image = crate::images::Image { width: image.width, height: image.height, pixels };
        let number = self.images.len() as u32;
        self.images.push(Texture::from_image(image, wrap));
        self.known.insert((name.to_owned(), wrap), number);
        Ok(number)
    }

    /// All of them, over triangles that show them at the places of their vertices; `None` without any.
    pub(super) fn over(self, shown: Vec<u32>, place: Vec<Vec2>) -> Option<MeshImages> {
        if self.images.is_empty() {
            return None;
        }
        let mut hash = self.hash;
        place.iter().flat_map(|place| place.to_array()).for_each(|value| hash.update(value.to_le_bytes()));
        shown.iter().for_each(|image| hash.update(image.to_le_bytes()));
        Some(MeshImages { images: self.images, shown, place, digest: hash.finalize().into() })
    }
}

/// Where a vertex lies on an image.
///
/// # Errors
/// The coordinates are not finite, or so large that they tell no place.
pub(super) fn placed(path: &Path, material: &str, vertex: usize, place: Vec2) -> Result<Vec2, TerrainError> {
    if !(place.abs().max_element() < FARTHEST && place.is_finite()) {
        return Err(broken(
            path,
            format!(
                "{material}: the texture coordinates of vertex {vertex} are {:?}; expected finite numbers below {FARTHEST}",
                place.to_array()
            ),
        ));
    }
    Ok(place)
}
