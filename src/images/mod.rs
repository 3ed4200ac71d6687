//! Images that scenes name (skies, textures): files → linear pixels, and lookups of them over a footprint. What is on them,
//! and how many pixels are too many, is the caller's matter; heights of ground have a reader of their own in `terrain`.

#[cfg(feature = "oiio")]
mod pieces;
mod pyramid;
mod texture;

use std::io::{BufRead, Cursor, Seek};
use std::path::{Path, PathBuf};

use glam::Vec4;
use image::ImageReader;

#[cfg(feature = "oiio")]
pub use pieces::make_texture;
pub use pyramid::Pixel;
pub use texture::{Texture, TextureMemory, Wrap, premultiplied};

/// An image, row by row from the top.
#[derive(Clone, Debug)]
pub struct Image<T> {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `width * height` pixels.
    pub pixels: Vec<T>,
}

/// What colours have to do with alpha.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Alpha {
    /// They do not know of it.
    Straight,
    /// They are multiplied by it: OpenEXR's convention.
    Premultiplied,
}

/// A file that holds no image.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{} cannot be read: {reason}", path.display())]
pub struct Unreadable {
    /// The file.
    pub path: PathBuf,
    /// What the reader said.
    pub reason: String,
}

/// Reads .exr, .hdr, .png and the other formats of the crate `image`. `pixel` makes of red, green, blue (linear; sRGB is
/// decoded) and alpha (1 without a channel) what is kept.
///
/// `claim` hears the size that a header claims before memory is taken for it.
///
/// # Errors
/// [`Unreadable`], also for an image of no pixels; what `claim` says.
pub fn read<T: Copy + Default, E: From<Unreadable>>(
    path: &Path,
    claim: impl FnMut(usize, usize) -> Result<(), E>,
    pixel: impl Fn(Vec4, Alpha) -> T,
) -> Result<Image<T>, E> {
    let image = if has_extension(path, &["exr"]) {
        exr_file(path, claim, pixel)?
    } else {
        decode(path, || ImageReader::open(path), claim, pixel)?
    };
    not_empty(path, image)
}

/// As [`read`], of a file's bytes (not OpenEXR's); `path` is what errors name.
///
/// # Errors
/// As [`read`].
pub fn read_bytes<T, E: From<Unreadable>>(
    path: &Path,
    bytes: &[u8],
    claim: impl FnMut(usize, usize) -> Result<(), E>,
    pixel: impl Fn(Vec4, Alpha) -> T,
) -> Result<Image<T>, E> {
    not_empty(path, decode(path, || Ok(ImageReader::new(Cursor::new(bytes))), claim, pixel)?)
}

fn not_empty<T, E: From<Unreadable>>(path: &Path, image: Image<T>) -> Result<Image<T>, E> {
    if image.pixels.is_empty() {
        let reason = format!("it holds {} x {} pixels", image.width, image.height);
        return Err(Unreadable { path: path.to_owned(), reason }.into());
    }
    Ok(image)
}

/// Whether a path ends in one of these, in any case.
fn has_extension(path: &Path, endings: &[&str]) -> bool {
    let ending = path.extension().unwrap_or_default();
    endings.iter().any(|other| ending.eq_ignore_ascii_case(other))
}

fn exr_file<T: Copy + Default, E: From<Unreadable>>(
    path: &Path,
    mut claim: impl FnMut(usize, usize) -> Result<(), E>,
    pixel: impl Fn(Vec4, Alpha) -> T,
) -> Result<Image<T>, E> {
    use exr::prelude::*;
    let broken = |error: exr::error::Error| Unreadable { path: path.to_owned(), reason: error.to_string() };
    // The header first: a file that claims a huge picture must not make us reserve one.
    let meta = exr::meta::MetaData::read_from_file(path, false).map_err(broken)?;
    for header in &meta.headers {
        claim(header.layer_size.width(), header.layer_size.height())?;
    }
    let read = read_first_rgba_layer_from_file(
        path,
        |size, _| (size.width(), vec![Vec4::ZERO; size.area()]),
        |(width, pixels): &mut (usize, Vec<Vec4>), at: Vec2<usize>, (r, g, b, a): (f32, f32, f32, f32)| {
            pixels[at.y() * *width + at.x()] = Vec4::new(r, g, b, a);
        },
    )
    .map_err(broken)?;
    let size = read.layer_data.size;
    let pixels = read.layer_data.channel_data.pixels.1.into_iter();
    let pixels = pixels.map(|value| pixel(value, Alpha::Premultiplied)).collect();
    Ok(self::Image { width: size.width(), height: size.height(), pixels })
}

/// What the crate `image` makes of a file that can be opened twice.
fn decode<T, E: From<Unreadable>, R: BufRead + Seek>(
    path: &Path,
    open: impl Fn() -> std::io::Result<ImageReader<R>>,
    mut claim: impl FnMut(usize, usize) -> Result<(), E>,
    pixel: impl Fn(Vec4, Alpha) -> T,
) -> Result<Image<T>, E> {
    let broken = |reason: String| Unreadable { path: path.to_owned(), reason };
    let open = || open().and_then(ImageReader::with_guessed_format).map_err(|error| broken(error.to_string()));
    let (width, height) = open()?.into_dimensions().map_err(|error| broken(error.to_string()))?;
    let (width, height) = (width as usize, height as usize);
    claim(width, height)?;
    let mut reader = open()?;
    // `claim` has judged; the crate's own ceiling of 512 MB would refuse 8k panoramas.
    reader.no_limits();
    let decoded = reader.decode().map_err(|error| broken(error.to_string()))?;
    let linear = matches!(decoded, image::DynamicImage::ImageRgb32F(_) | image::DynamicImage::ImageRgba32F(_));
    let pixels = decoded
        .into_rgba32f()
        .pixels()
        .map(|value| {
            let value = Vec4::from_array(value.0);
            let color = value.truncate();
            let color = if linear { color } else { color.map(srgb_to_linear) };
            pixel(color.extend(value.w), Alpha::Straight)
        })
        .collect();
    Ok(Image { width, height, pixels })
}

/// sRGB's decoding (IEC 61966-2-1), 0..1.
pub fn srgb_to_linear(value: f32) -> f32 {
    if value <= 0.04045 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn any(path: &Path) -> Result<Image<Vec4>, Unreadable> {
        read(path, |_, _| Ok(()), |value, _| value)
    }

    #[test]
    fn srgb_decodes_by_its_definition() {
        assert_eq!(srgb_to_linear(0.0), 0.0);
        assert_eq!(srgb_to_linear(1.0), 1.0);
        assert!((srgb_to_linear(0.5) - 0.214_041_14).abs() < 1e-6);
    }

    #[test]
    fn low_range_images_are_decoded_and_float_ones_are_not() {
        let folder = tempfile::tempdir().unwrap();
        let png = folder.path().join("grey.png");
        image::RgbaImage::from_pixel(4, 2, image::Rgba([188, 188, 188, 51])).save(&png).unwrap();
        let told = read::<_, Unreadable>(
            &png,
            |_, _| Ok(()),
            |value, alpha| {
                assert_eq!(alpha, Alpha::Straight);
                value
            },
        );
        let seen = told.unwrap();
        assert_eq!((seen.width, seen.height, seen.pixels.len()), (4, 2, 8));
        let bytes = std::fs::read(&png).unwrap();
        let held = read_bytes::<_, Unreadable>(&png, &bytes, |_, _| Ok(()), |value, _| value).unwrap();
        assert_eq!(held.pixels, seen.pixels);
        let cut = read_bytes::<_, Unreadable>(&png, &bytes[..20], |_, _| Ok(()), |value, _| value);
        assert!(cut.unwrap_err().to_string().contains("grey.png"));
        assert!((seen.pixels[5] - Vec4::new(0.502_886_5, 0.502_886_5, 0.502_886_5, 0.2)).abs().max_element() < 1e-4);
        let hdr = folder.path().join("bright.hdr");
        image::Rgb32FImage::from_pixel(4, 2, image::Rgb([4.0, 2.0, 0.5])).save(&hdr).unwrap();
        assert!((any(&hdr).unwrap().pixels[3] - Vec4::new(4.0, 2.0, 0.5, 1.0)).abs().max_element() < 0.02);
        let exr = folder.path().join("bright.exr");
        exr::prelude::write_rgb_file(&exr, 4, 2, |x, y| (x as f32, y as f32, 7.5f32)).unwrap();
        assert_eq!(any(&exr).unwrap().pixels[7], Vec4::new(3.0, 1.0, 7.5, 1.0));
    }

    #[test]
    fn damaged_images_are_errors_with_their_path_and_claims_come_first() {
        let folder = tempfile::tempdir().unwrap();
        let good = folder.path().join("good.exr");
        exr::prelude::write_rgb_file(&good, 64, 32, |x, _| (x as f32, 1.0f32, 2.0f32)).unwrap();
        let bytes = std::fs::read(&good).unwrap();
        for name in ["cut.exr", "cut.png", "cut.hdr"] {
            let path = folder.path().join(name);
            std::fs::write(&path, &bytes[..bytes.len() / 3]).unwrap();
            assert!(any(&path).unwrap_err().to_string().contains(name));
            assert!(any(&folder.path().join("absent").with_extension(&name[4..])).is_err());
        }
        // A header that claims 2^31 x 2^31 pixels.
        let huge = folder.path().join("huge.hdr");
        std::fs::write(&huge, b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2147483647 +X 2147483647\n").unwrap();
        let refuse = |width: usize, height: usize| {
            assert_eq!((width, height), (2_147_483_647, 2_147_483_647));
            Err(Unreadable { path: PathBuf::new(), reason: "too large".into() })
        };
        assert_eq!(read(&huge, refuse, |value, _| value).unwrap_err().reason, "too large");
    }
}
