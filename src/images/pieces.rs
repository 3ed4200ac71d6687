//! Textures that OpenImageIO's texture system reads piece by piece, and files made for that.
//!
//! A lookup depends on its arguments alone: what is in the cache only decides how long it takes.

use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use glam::{Vec2, Vec4};

use super::pyramid::Probes;
use super::texture::{TextureMemory, Wrap, premultiplied};
use super::{Unreadable, has_extension};
use crate::ffi::oiio_texture::{self, SystemTexture, TextureSystem};

/// One file of the texture system.
#[derive(Debug)]
pub(super) struct Pieces {
    path: PathBuf,
    texture: SystemTexture,
    wrap: [Wrap; 2],
    failure: OnceLock<String>,
}

impl Pieces {
    /// Whether a file is one for the texture system: by its ending, or since it holds mip levels. A file that cannot be looked
    /// into is not: the plain reader says what is wrong with it.
    pub(super) fn serves(path: &Path) -> bool {
        has_extension(path, &["tx"])
            || has_extension(path, &["exr", "tif", "tiff"])
                && path.to_str().is_some_and(|path| oiio_texture::levels(path).is_ok_and(|levels| levels > 1))
    }

    pub(super) fn open(path: &Path, wrap: [Wrap; 2], memory: &TextureMemory) -> Result<Self, Unreadable> {
        let broken = |reason: String| Unreadable { path: path.to_owned(), reason };
        let name = path.to_str().ok_or_else(|| broken("OpenImageIO takes only file names in Unicode".into()))?;
        // Two threads may both make one; the second is dropped.
        let system = match memory.system.get() {
            Some(system) => system,
            None => {
                let made = TextureSystem::new(memory.bytes.div_ceil(1_000_000) as f32).map_err(broken)?;
                memory.system.get_or_init(|| made)
            }
        };
        let texture = system.texture(name, wrap.map(|wrap| wrap == Wrap::Repeat)).map_err(broken)?;
        if !texture.holds_light() {
            return Err(broken(
                "it holds integers; expected half or float, which are linear light at every mip level: \
                 maketx --colorconvert sRGB linear -d float IMAGE -o NAME.tx"
                    .into(),
            ));
        }
        let pieces = Self { path: path.to_owned(), texture, wrap, failure: OnceLock::new() };
        // A file may open and yet have nothing to show: the finest level's middle and the mean of all must be there.
        pieces.at(Vec2::splat(0.5), [Vec2::ZERO; 2]);
        pieces.at(Vec2::splat(0.5), [Vec2::X, Vec2::Y]);
        pieces.failure().map_or(Ok(pieces), Err)
    }

    /// Linear, multiplied by alpha.
    ///
    /// OpenImageIO would place probes along a footprint by itself, but picks its level by the smaller side of an image: of
    /// one twice as wide as high, like a sky, half of the detail would be left to alias. It gets round lookups.
    pub(super) fn at(&self, place: Vec2, spans: [Vec2; 2]) -> Vec4 {
        let [width, height] = self.texture.size().map(|count| count as f32);
        let Some(probes) = Probes::new(Vec2::new(width, height), spans) else { return self.probe(place, 0.0) };
        // More than all is all.
        let round = (probes.width / width.min(height)).min(1.0);
        probes.mean(place, |place| self.probe(place, round))
    }

    fn probe(&self, place: Vec2, round: f32) -> Vec4 {
        let place = Vec2::new(self.wrap[0].folded(place.x), self.wrap[1].folded(place.y));
        match self.texture.lookup(place.to_array(), [round, 0.0, 0.0, round]) {
            Ok(color) if color.iter().all(|value| value.is_finite()) => Vec4::from_array(color),
            Ok(color) => {
                let about = format!("it holds {color:?} about ({}, {}); expected finite numbers", place.x, place.y);
                self.failure.get_or_init(|| about);
                Vec4::ZERO
            }
            Err(reason) => {
                self.failure.get_or_init(|| reason);
                Vec4::ZERO
            }
        }
    }

    pub(super) fn size(&self) -> [usize; 2] {
        self.texture.size().map(|count| count as usize)
    }

    pub(super) fn failure(&self) -> Option<Unreadable> {
        self.failure.get().map(|reason| Unreadable { path: self.path.clone(), reason: reason.clone() })
    }
}

/// Makes of any image that is read a texture with mip levels, of linear light, as `maketx` would: `.tx` or `.exr`.
///
/// # Errors
/// [`Unreadable`]: of the image, or of the texture that cannot be written.
pub fn make_texture(image: &Path, texture: &Path) -> Result<(), Unreadable> {
    let read = super::read::<_, Unreadable>(image, |_, _| Ok(()), premultiplied)?;
    let broken = |reason: String| Unreadable { path: texture.to_owned(), reason };
    let name = texture.to_str().ok_or_else(|| broken("OpenImageIO takes only file names in Unicode".into()))?;
    let pixels: Vec<f32> = read.pixels.iter().flat_map(|pixel| pixel.to_array()).collect();
    // The image crate reads no more than 2^32 either way, and memory has held all of it.
    oiio_texture::make_texture(name, [read.width as u32, read.height as u32], &pixels).map_err(broken)
}
