//! Skies from files: latitude-longitude images and the report's pair of textures, seam-free, over a footprint.
//!
//! Convention, the one of OpenEXR's and Mitsuba's latitude-longitude maps in this frame: the top row looks up; the left
//! edge looks north (-z), a quarter east (+x), the middle south (+z), three quarters west. So u = azimuth / 360.

use std::path::Path;

use glam::{Vec2, Vec3, Vec4};

use super::{Irradiance, OpticsError};
use crate::images::{self, Image, Texture, TextureMemory, Wrap};

/// Most pixels that a sky may have: 32768 x 16384, 8 GB with its mip levels, is beyond any panorama in use.
const LIMIT: usize = 32_768 * 16_384;

/// Most columns and rows that are looked at to integrate a sky that is not held whole: its mip levels tell the rest.
const MOST_CELLS: [usize; 2] = [2048, 1024];

/// Round in u, and ending in v.
const WRAP: [Wrap; 2] = [Wrap::Repeat, Wrap::Clamp];

/// A latitude-longitude image of linear radiance.
#[derive(Clone, Debug)]
pub(super) struct LatLong {
    texture: Texture<Vec3>,
    /// Columns and rows of the cells that integrals go over: the pixels, if the image is held whole.
    cells: [usize; 2],
    /// How wide and high a look at a cell is: a point, if the image is held whole, since between two pixels it is linear.
    look: [Vec2; 2],
}

impl LatLong {
    /// Reads .exr, .hdr or any of the low-range formats, which are decoded from sRGB; .tx and what else has mip levels where
    /// OpenImageIO is built in.
    pub(super) fn read(path: &Path, memory: &TextureMemory) -> Result<Self, OpticsError> {
        // A mixture of pixels that ring below zero beside a bright sun.
        let light = |value: Vec4| value.truncate().max(Vec3::ZERO);
        let texture = Texture::open(path, WRAP, memory, light, || whole(path))?;
        Ok(Self::of(texture))
    }

    fn of(texture: Texture<Vec3>) -> Self {
        let size = texture.size();
        if texture.pixels().is_some() {
            return Self { texture, cells: size, look: [Vec2::ZERO; 2] };
        }
        let cells = [size[0].min(MOST_CELLS[0]), size[1].min(MOST_CELLS[1])];
        let look = [Vec2::new(1.0 / cells[0] as f32, 0.0), Vec2::new(0.0, 1.0 / cells[1] as f32)];
        Self { texture, cells, look }
    }

    #[cfg(test)]
    pub(super) fn from_pixels(width: usize, height: usize, pixels: Vec<Vec3>) -> Self {
        assert_eq!(pixels.len(), width * height);
        Self::of(Texture::from_image(Image { width, height, pixels }, WRAP))
    }

    /// Radiance at u (0..1 eastward from north, any value wraps) and v (0 zenith, 1 nadir).
    #[inline]
    pub(super) fn at(&self, u: f32, v: f32) -> Vec3 {
        self.texture.at(Vec2::new(u, v), [Vec2::ZERO; 2])
    }

    /// Mean radiance over so much of u and of v about a place.
    #[inline]
    pub(super) fn mean(&self, u: f32, v: f32, [across, down]: [f32; 2]) -> Vec3 {
        self.texture.at(Vec2::new(u, v), [Vec2::new(across, 0.0), Vec2::new(0.0, down)])
    }

    /// What an integral over cells sees at a place.
    #[inline]
    pub(super) fn look(&self, u: f32, v: f32) -> Vec3 {
        self.texture.at(Vec2::new(u, v), self.look)
    }

    fn cell(&self, column: usize, row: usize) -> Vec3 {
        match self.texture.pixels() {
            Some(pixels) => pixels[row * self.cells[0] + column],
            None => {
                let [columns, rows] = self.cells;
                self.look((column as f32 + 0.5) / columns as f32, (row as f32 + 0.5) / rows as f32)
            }
        }
    }

    /// Irradiance of the whole image; column 0 in the north.
    pub(super) fn irradiance(&self) -> Irradiance {
        Irradiance::from_map(self.cells[0], self.cells[1], |x, y| self.cell(x, y))
    }

    /// Columns of the cells that integrals go over.
    pub(super) fn width(&self) -> usize {
        self.cells[0]
    }

    /// Rows of them.
    pub(super) fn height(&self) -> usize {
        self.cells[1]
    }

    /// What went wrong first in any lookup so far.
    pub(super) fn failure(&self) -> Option<OpticsError> {
        self.texture.failure().map(OpticsError::Image)
    }
}

/// An image as a whole, of numbers from 0 up.
fn whole(path: &Path) -> Result<Image<Vec3>, OpticsError> {
    let claim = |width: usize, height: usize| {
        if width.saturating_mul(height) > LIMIT {
            return Err(OpticsError::TooLarge { path: path.to_owned(), width, height, limit: LIMIT });
        }
        Ok(())
    };
    // A sky covers all that is behind it, whatever its alpha says.
    let mut image = images::read(path, claim, |value, _| value.truncate())?;
    let mut negative = 0usize;
    for (index, pixel) in image.pixels.iter_mut().enumerate() {
        if !pixel.is_finite() {
            let (x, y) = (index % image.width, index / image.width);
            return Err(OpticsError::NotFinite { path: path.to_owned(), x, y, value: pixel.to_array() });
        }
        if pixel.min_element() < 0.0 {
            negative += 1;
            *pixel = pixel.max(Vec3::ZERO);
        }
    }
    if negative > 0 {
        // Resampling filters leave these beside bright suns; radiance below zero has no meaning.
        tracing::warn!("{}: {negative} pixels of the sky's image are negative; taken as 0", path.display());
    }
    Ok(image)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn ramp() -> LatLong {
        LatLong::from_pixels(8, 4, (0..32).map(|i| Vec3::new(i as f32, (i * i % 7) as f32, 1.0)).collect())
    }

    #[test]
    fn pixel_centres_return_the_pixels() {
        let map = ramp();
        for y in 0..4 {
            for x in 0..8 {
                let value = map.at((x as f32 + 0.5) / 8.0, (y as f32 + 0.5) / 4.0);
                assert!((value - map.cell(x, y)).abs().max_element() < 1e-5);
            }
        }
    }

    #[test]
    fn the_seam_in_the_north_is_not_seen() {
        let map = ramp();
        for v in [0.0, 0.3, 0.5, 0.99, 1.0] {
            let (west, east) = (map.at(1.0 - 1e-6, v), map.at(1e-6, v));
            assert!((west - east).abs().max_element() < 1e-3, "{west} {east}");
            assert_eq!(map.at(1.0, v), map.at(0.0, v));
        }
        // Halfway between the last and the first column.
        assert!((map.at(0.0, 0.125).x - 3.5).abs() < 1e-5);
    }

    #[test]
    fn low_range_images_are_decoded_and_float_ones_are_not() {
        let folder = tempfile::tempdir().unwrap();
        let png = folder.path().join("grey.png");
        image::RgbImage::from_pixel(4, 2, image::Rgb([188, 188, 188])).save(&png).unwrap();
        assert!(
            (LatLong::read(&png, &TextureMemory::default()).unwrap().at(0.3, 0.4) - Vec3::splat(0.502_886_5))
                .abs()
                .max_element()
                < 1e-4
        );
        let hdr = folder.path().join("bright.hdr");
        image::Rgb32FImage::from_pixel(4, 2, image::Rgb([4.0, 2.0, 0.5])).save(&hdr).unwrap();
        assert!(
            (LatLong::read(&hdr, &TextureMemory::default()).unwrap().at(0.3, 0.4) - Vec3::new(4.0, 2.0, 0.5))
                .abs()
                .max_element()
                < 0.02
        );
        let exr = folder.path().join("bright.exr");
        exr::prelude::write_rgb_file(&exr, 4, 2, |x, y| (x as f32, y as f32, 7.5f32)).unwrap();
        let map = LatLong::read(&exr, &TextureMemory::default()).unwrap();
        assert_eq!((map.width(), map.height()), (4, 2));
        assert_eq!(map.cell(3, 1), Vec3::new(3.0, 1.0, 7.5));
    }

    #[test]
    fn damaged_images_are_errors_with_their_path() {
        let folder = tempfile::tempdir().unwrap();
        let good = folder.path().join("good.exr");
        exr::prelude::write_rgb_file(&good, 64, 32, |x, _| (x as f32, 1.0f32, f32::from(x == 9) / 0.0)).unwrap();
        let error = LatLong::read(&good, &TextureMemory::default()).unwrap_err();
        assert!(matches!(error, OpticsError::NotFinite { x: 0, y: 0, .. }), "{error}");
        let bytes = std::fs::read(&good).unwrap();
        for name in ["cut.exr", "cut.png", "cut.hdr"] {
            let path = folder.path().join(name);
            std::fs::write(&path, &bytes[..bytes.len() / 3]).unwrap();
            assert!(LatLong::read(&path, &TextureMemory::default()).unwrap_err().to_string().contains(name));
            assert!(
                LatLong::read(&folder.path().join("absent").with_extension(&name[4..]), &TextureMemory::default())
                    .is_err()
            );
        }
        // A header that claims 2^31 x 2^31 pixels.
        let huge = folder.path().join("huge.hdr");
        std::fs::write(&huge, b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2147483647 +X 2147483647\n").unwrap();
        assert!(matches!(LatLong::read(&huge, &TextureMemory::default()).unwrap_err(), OpticsError::TooLarge { .. }));
    }

    proptest! {
        #[test]
        fn any_place_gives_a_mixture_of_pixels(u in -3.0f32..3.0, v in -0.5f32..1.5) {
            let value = ramp().at(u, v);
            prop_assert!(value.is_finite() && value.x >= 0.0 && value.x <= 31.0);
        }
    }
}
