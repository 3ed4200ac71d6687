//! Skies from files: latitude-longitude images and the report's pair of textures, bilinear and seam-free.
//!
//! Convention, the one of OpenEXR's and Mitsuba's latitude-longitude maps in this frame: the top row looks up; the left
//! edge looks north (-z), a quarter east (+x), the middle south (+z), three quarters west. So u = azimuth / 360.

use std::path::Path;

use glam::Vec3;

use super::{Irradiance, OpticsError};
use crate::images::{self, Image};

/// Most pixels that a sky may have: 32768 x 16384, 6 GB as read, is beyond any panorama in use.
const LIMIT: usize = 32_768 * 16_384;

/// A latitude-longitude image of linear radiance.
#[derive(Clone, Debug)]
pub(super) struct LatLong {
    width: usize,
    height: usize,
    pixels: Vec<Vec3>,
}

impl LatLong {
    /// Reads .exr, .hdr or any of the low-range formats; the latter are decoded from sRGB.
    pub(super) fn read(path: &Path) -> Result<Self, OpticsError> {
        let claim = |width: usize, height: usize| {
            if width.saturating_mul(height) > LIMIT {
                return Err(OpticsError::TooLarge { path: path.to_owned(), width, height, limit: LIMIT });
            }
            Ok(())
        };
        // A sky covers all that is behind it, whatever its alpha says.
        let Image { width, height, pixels } = images::read(path, claim, |value, _| value.truncate())?;
        let mut image = Self { width, height, pixels };
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
    pub(super) fn from_pixels(width: usize, height: usize, pixels: Vec<Vec3>) -> Self {
        assert_eq!(pixels.len(), width * height);
        Self { width, height, pixels }
    }

    /// Radiance at u (0..1 eastward from north, any value wraps) and v (0 zenith, 1 nadir).
    #[inline]
    pub(super) fn at(&self, u: f32, v: f32) -> Vec3 {
        let x = (u - u.floor()) * self.width as f32 - 0.5;
        let y = (v * self.height as f32 - 0.5).clamp(0.0, (self.height - 1) as f32);
        let (left, top) = (x.floor(), y.floor());
        let (fx, fy) = (x - left, y - top);
        // left is -1 .. width - 1.
        let x0 = if left < 0.0 { self.width - 1 } else { (left as usize).min(self.width - 1) };
        let x1 = if x0 + 1 == self.width { 0 } else { x0 + 1 };
        let y0 = top as usize;
        let y1 = (y0 + 1).min(self.height - 1);
        let upper = self.pixel(x0, y0).lerp(self.pixel(x1, y0), fx);
        let lower = self.pixel(x0, y1).lerp(self.pixel(x1, y1), fx);
        upper.lerp(lower, fy)
    }

    #[inline]
    fn pixel(&self, x: usize, y: usize) -> Vec3 {
        self.pixels[y * self.width + x]
    }

    /// Irradiance of the whole image; column 0 in the north.
    pub(super) fn irradiance(&self) -> Irradiance {
        Irradiance::from_map(self.width, self.height, |x, y| self.pixel(x, y))
    }

    pub(super) fn width(&self) -> usize {
        self.width
    }
    pub(super) fn height(&self) -> usize {
        self.height
    }
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
                assert!((value - map.pixel(x, y)).abs().max_element() < 1e-5);
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
        assert!((LatLong::read(&png).unwrap().at(0.3, 0.4) - Vec3::splat(0.502_886_5)).abs().max_element() < 1e-4);
        let hdr = folder.path().join("bright.hdr");
        image::Rgb32FImage::from_pixel(4, 2, image::Rgb([4.0, 2.0, 0.5])).save(&hdr).unwrap();
        assert!((LatLong::read(&hdr).unwrap().at(0.3, 0.4) - Vec3::new(4.0, 2.0, 0.5)).abs().max_element() < 0.02);
        let exr = folder.path().join("bright.exr");
        exr::prelude::write_rgb_file(&exr, 4, 2, |x, y| (x as f32, y as f32, 7.5f32)).unwrap();
        let map = LatLong::read(&exr).unwrap();
        assert_eq!((map.width(), map.height()), (4, 2));
        assert_eq!(map.pixel(3, 1), Vec3::new(3.0, 1.0, 7.5));
    }

    #[test]
    fn damaged_images_are_errors_with_their_path() {
        let folder = tempfile::tempdir().unwrap();
        let good = folder.path().join("good.exr");
        exr::prelude::write_rgb_file(&good, 64, 32, |x, _| (x as f32, 1.0f32, f32::from(x == 9) / 0.0)).unwrap();
        let error = LatLong::read(&good).unwrap_err();
        assert!(matches!(error, OpticsError::NotFinite { x: 0, y: 0, .. }), "{error}");
        let bytes = std::fs::read(&good).unwrap();
        for name in ["cut.exr", "cut.png", "cut.hdr"] {
            let path = folder.path().join(name);
            std::fs::write(&path, &bytes[..bytes.len() / 3]).unwrap();
            assert!(LatLong::read(&path).unwrap_err().to_string().contains(name));
            assert!(LatLong::read(&folder.path().join("absent").with_extension(&name[4..])).is_err());
        }
        // A header that claims 2^31 x 2^31 pixels.
        let huge = folder.path().join("huge.hdr");
        std::fs::write(&huge, b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2147483647 +X 2147483647\n").unwrap();
        assert!(matches!(LatLong::read(&huge).unwrap_err(), OpticsError::TooLarge { .. }));
    }

    proptest! {
        #[test]
        fn any_place_gives_a_mixture_of_pixels(u in -3.0f32..3.0, v in -0.5f32..1.5) {
            let value = ramp().at(u, v);
            prop_assert!(value.is_finite() && value.x >= 0.0 && value.x <= 31.0);
        }
    }
}
