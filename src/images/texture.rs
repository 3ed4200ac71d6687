//! Textures: images that are looked up over a footprint. One seam before two ways of keeping them: whole with all mip levels
//! in memory, or piece by piece through OpenImageIO's texture system, within a limit of memory.
//!
//! The file decides: `.tx`, and `.exr` and `.tif` that hold mip levels, are read piece by piece in builds with OpenImageIO;
//! all else is held whole. Where a texture lies, and what its colours mean, is the caller's matter.

use std::path::Path;
use std::sync::Arc;

use glam::{Vec2, Vec4};

use super::pyramid::{Pixel, Pyramid};
use super::{Alpha, Image, Unreadable};

#[cfg(feature = "oiio")]
use super::pieces::Pieces;

/// What is beyond an image's edge, along one of its axes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Wrap {
    /// The image again.
    Repeat,
    /// Its outermost pixels.
    Clamp,
    /// Its mirror image, and then the image again.
    Mirror,
}

impl Wrap {
    /// Where in 0..1 a place of a mirrored image is; any other is left as it is.
    #[inline]
    pub(super) fn folded(self, share: f32) -> f32 {
        if self != Self::Mirror {
            return share;
        }
        let turn = share - 2.0 * (0.5 * share).floor();
        if turn > 1.0 { 2.0 - turn } else { turn }
    }
}

/// The memory that all textures of a run that are read piece by piece share.
#[derive(Clone, Debug)]
pub struct TextureMemory {
    #[cfg_attr(
        not(feature = "oiio"),
        expect(dead_code, reason = "nothing is read piece by piece without OpenImageIO")
    )]
    pub(super) bytes: u64,
    #[cfg(feature = "oiio")]
    pub(super) system: Arc<std::sync::OnceLock<crate::ffi::oiio_texture::TextureSystem>>,
}

impl TextureMemory {
    /// At most so many bytes of pixels, rounded up to a megabyte.
    pub fn new(bytes: u64) -> Self {
        Self {
            bytes,
            #[cfg(feature = "oiio")]
            system: Arc::default(),
        }
    }
}

impl Default for TextureMemory {
    /// A gigabyte.
    fn default() -> Self {
        Self::new(1_000_000_000)
    }
}

/// An image to be looked up from any thread. A lookup's result depends on its arguments alone.
#[derive(Clone, Debug)]
pub struct Texture<T> {
    kind: Kind<T>,
}

#[derive(Clone, Debug)]
enum Kind<T> {
    Whole(Arc<Pyramid<T>>),
    #[cfg(feature = "oiio")]
    Pieces {
        file: Arc<Pieces>,
        pixel: fn(Vec4) -> T,
    },
}

impl<T: Pixel> Texture<T> {
    /// Opens a file: piece by piece if it is made for that, or else as the image that `whole` reads. `pixel` makes of red, green,
    /// blue (linear, multiplied by alpha) and alpha what a piecewise lookup returns.
    ///
    /// # Errors
    /// [`Unreadable`], also for `.tx` without OpenImageIO; what `whole` says.
    pub fn open<E: From<Unreadable>>(
        path: &Path,
        wrap: [Wrap; 2],
        memory: &TextureMemory,
        pixel: fn(Vec4) -> T,
        whole: impl FnOnce() -> Result<Image<T>, E>,
    ) -> Result<Self, E> {
        #[cfg(feature = "oiio")]
        if Pieces::serves(path) {
            let file = Arc::new(Pieces::open(path, wrap, memory)?);
            return Ok(Self { kind: Kind::Pieces { file, pixel } });
        }
        #[cfg(not(feature = "oiio"))]
        if super::has_extension(path, &["tx"]) {
            let _ = (memory, pixel);
            let reason = "expected .png, .jpg, .exr or .hdr: this program was built without OpenImageIO (feature oiio), \
                          which reads .tx";
            return Err(Unreadable { path: path.to_owned(), reason: reason.into() }.into());
        }
        Ok(Self::from_image(whole()?, wrap))
    }

    /// An image of at least one pixel, held whole.
    pub fn from_image(image: Image<T>, wrap: [Wrap; 2]) -> Self {
        Self { kind: Kind::Whole(Arc::new(Pyramid::new(image, wrap))) }
    }

    /// The mean about a place (0..1 from the left and from the top) over a footprint that two `spans` across it give, in the
    /// same units; without any, bilinear.
    ///
    /// What cannot be read any more is 0, and [`Texture::failure`] tells.
    #[inline]
    pub fn at(&self, place: Vec2, spans: [Vec2; 2]) -> T {
        match &self.kind {
            Kind::Whole(pyramid) => pyramid.at(place, spans),
            #[cfg(feature = "oiio")]
            Kind::Pieces { file, pixel } => pixel(file.at(place, spans)),
        }
    }

    /// Columns and rows.
    pub fn size(&self) -> [usize; 2] {
        match &self.kind {
            Kind::Whole(pyramid) => [pyramid.finest().width, pyramid.finest().height],
            #[cfg(feature = "oiio")]
            Kind::Pieces { file, .. } => file.size(),
        }
    }

    /// The pixels, row by row from the top, if the image is held whole.
    pub fn pixels(&self) -> Option<&[T]> {
        match &self.kind {
            Kind::Whole(pyramid) => Some(&pyramid.finest().pixels),
            #[cfg(feature = "oiio")]
            Kind::Pieces { .. } => None,
        }
    }

    /// What went wrong first in any lookup so far; `None` if nothing did.
    pub fn failure(&self) -> Option<Unreadable> {
        match &self.kind {
            Kind::Whole(_) => None,
            #[cfg(feature = "oiio")]
            Kind::Pieces { file, .. } => file.failure(),
        }
    }
}

/// A colour multiplied by its alpha.
#[inline]
pub fn premultiplied(color: Vec4, alpha: Alpha) -> Vec4 {
    match alpha {
        Alpha::Premultiplied => color,
        Alpha::Straight => (color.truncate() * color.w).extend(color.w),
    }
}

#[cfg(test)]
#[cfg(feature = "oiio")]
mod tests {
    use std::path::PathBuf;

    use super::*;
    use crate::images::{self, make_texture};

    /// A smooth picture with a sharp checker in its left half, as a PNG and as a texture with mip levels.
    fn files(folder: &Path, ending: &str) -> [PathBuf; 2] {
        let [png, tx] = [folder.join("image.png"), folder.join("image").with_extension(ending)];
        let level = |share: f32| (255.0 * share) as u8;
        let wave = |k: u32| level(0.5 + 0.4 * (k as f32 * std::f32::consts::TAU / 128.0).sin());
        let image = image::RgbaImage::from_fn(256, 128, |x, y| {
            let checker = 255 * ((x / 4 + y / 4) % 2) as u8;
            image::Rgba([if x < 128 { checker } else { wave(x) }, wave(x), wave(y), if y < 64 { 255 } else { 128 }])
        });
        image.save(&png).unwrap();
        make_texture(&png, &tx).unwrap();
        [png, tx]
    }

    fn open(path: &Path, memory: &TextureMemory) -> Result<Texture<Vec4>, Unreadable> {
        let whole = || images::read::<_, Unreadable>(path, |_, _| Ok(()), premultiplied);
        Texture::open(path, [Wrap::Repeat; 2], memory, |value| value, whole)
    }

    /// Places and footprints all over, from points to half of the image, round and long.
    fn lookups() -> impl Iterator<Item = (Vec2, [Vec2; 2])> {
        (0..4000).map(|k| {
            let share = |step: f32| (k as f32 * step).fract();
            let width = 0.5 * (share(0.618_034) * 9.0 - 9.0).exp2();
            let turn = Vec2::from_angle(share(0.754_877_7) * std::f32::consts::TAU);
            let long = width * (1.0 + 7.0 * share(0.569_84));
            (Vec2::new(share(0.819_172_5), share(0.671_043_6)), [turn * long, turn.perp() * width])
        })
    }

    #[test]
    fn openimageio_and_memory_see_the_same_of_the_same_image() {
        let folder = tempfile::tempdir().unwrap();
        for ending in ["tx", "exr"] {
            let [png, tx] = files(folder.path(), ending);
            let memory = TextureMemory::default();
            let (whole, pieces) = (open(&png, &memory).unwrap(), open(&tx, &memory).unwrap());
            assert!(whole.pixels().is_some() && pieces.pixels().is_none(), "{ending}");
            assert_eq!(whole.size(), pieces.size());
            let (mut squares, mut means, mut worst) = (0.0, [Vec4::ZERO; 2], 0.0_f32);
            for (place, spans) in lookups() {
                let [a, b] = [&whole, &pieces].map(|texture| texture.at(place, spans));
                squares += f64::from((a - b).length_squared()) / 16_000.0;
                means = [means[0] + a / 4000.0, means[1] + b / 4000.0];
                if spans == [Vec2::ZERO; 2] || spans[0].length() < 1e-3 {
                    worst = worst.max((a - b).abs().max_element());
                }
            }
            // OpenImageIO mixes by weights of its own rounding.
            assert!(worst < 0.02, "{ending}: {worst}");
            assert!((means[0] - means[1]).abs().max_element() < 0.002, "{ending}: {means:?}");
            assert!(squares.sqrt() < 0.01, "{ending}: {}", squares.sqrt());
            assert!(pieces.failure().is_none());
        }
    }

    #[test]
    fn lookups_are_the_same_bits_from_any_thread_and_with_any_memory() {
        let folder = tempfile::tempdir().unwrap();
        let [_, tx] = files(folder.path(), "tx");
        let seen = |memory: TextureMemory, threads: usize| -> Vec<[u32; 4]> {
            let texture = open(&tx, &memory).unwrap();
            let all: Vec<_> = lookups().collect();
            let one = |part: &[(Vec2, [Vec2; 2])]| -> Vec<[u32; 4]> {
                part.iter().map(|&(place, spans)| texture.at(place, spans).to_array().map(f32::to_bits)).collect()
            };
            std::thread::scope(|scope| {
                let parts = all.chunks(all.len().div_ceil(threads));
                let workers: Vec<_> = parts.map(|part| scope.spawn(move || one(part))).collect();
                workers.into_iter().flat_map(|worker| worker.join().unwrap()).collect()
            })
        };
        let once = seen(TextureMemory::default(), 1);
        for threads in [2, 4] {
            assert_eq!(once, seen(TextureMemory::default(), threads));
            assert_eq!(once, seen(TextureMemory::new(1), threads));
        }
    }

    #[test]
    fn integers_and_damage_are_refused_and_what_breaks_later_is_told() {
        let folder = tempfile::tempdir().unwrap();
        let [png, tx] = files(folder.path(), "tx");
        let told = |path: &Path| open(path, &TextureMemory::default()).unwrap_err().to_string();
        let encoded = folder.path().join("encoded.tx");
        std::fs::copy(&png, &encoded).unwrap();
        assert!(told(&encoded).contains("encoded.tx") && told(&encoded).contains("maketx"), "{}", told(&encoded));
        assert!(told(&folder.path().join("absent.tx")).contains("absent.tx"));
        // Cut off, it may open, but not all of it is there.
        let cut = folder.path().join("cut.tx");
        let bytes = std::fs::read(&tx).unwrap();
        std::fs::write(&cut, &bytes[..bytes.len() / 4]).unwrap();
        let failure = open(&cut, &TextureMemory::default()).map_or_else(Some, |texture| {
            lookups().for_each(|(place, spans)| assert!(texture.at(place, spans).is_finite()));
            texture.failure()
        });
        assert!(failure.is_some_and(|failure| failure.to_string().contains("cut.tx")));
        let [from, nan] = ["nan.exr", "nan.tx"].map(|name| folder.path().join(name));
        exr::prelude::write_rgb_file(&from, 64, 64, |x, y| {
            (if x == 9 && y == 7 { f32::NAN } else { 0.5 }, 0.5f32, 0.5f32)
        })
        .unwrap();
        make_texture(&from, &nan).unwrap();
        assert!(told(&nan).contains("nan.tx") && told(&nan).contains("finite"), "{}", told(&nan));
    }
}
