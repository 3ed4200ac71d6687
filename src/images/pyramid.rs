//! An image with its mip levels in memory, looked up over a footprint: trilinear, with several probes along a long one.
//!
//! Levels are box filtered with fractional weights, so that every level has the image's own mean whatever its size. Bilinear
//! places: pixel centres at half-integers.

use std::ops::{Add, Mul};

use glam::Vec2;

use super::{Image, Wrap};

/// Most probes along a footprint, whose narrow side is widened where it is more than this many times as long as wide: the
/// limit that OpenImageIO has by default.
const MOST_PROBES: f32 = 32.0;

/// Pixels of a footprint that counts as everything.
const FARTHEST: f32 = 1e7;

/// A pixel: anything that can be mixed.
pub trait Pixel: Copy + Default + Send + Sync + Add<Output = Self> + Mul<f32, Output = Self> {}
impl<T: Copy + Default + Send + Sync + Add<Output = T> + Mul<f32, Output = T>> Pixel for T {}

/// An image and its halvings, the last of one pixel.
#[derive(Clone, Debug)]
pub(super) struct Pyramid<T> {
    levels: Vec<Image<T>>,
    wrap: [Wrap; 2],
}

impl<T: Pixel> Pyramid<T> {
    /// Builds every level of an image of at least one pixel.
    pub(super) fn new(image: Image<T>, wrap: [Wrap; 2]) -> Self {
        let mut levels = vec![image];
        while let Some(last) = levels.last().filter(|last| last.width > 1 || last.height > 1) {
            levels.push(halved(last));
        }
        Self { levels, wrap }
    }

    /// The image itself.
    pub(super) fn finest(&self) -> &Image<T> {
        &self.levels[0]
    }

    /// The mean about a place (0..1 from the left and from the top) over a footprint that two `spans` across it give, in the
    /// same units; without any, bilinear.
    #[inline]
    pub(super) fn at(&self, place: Vec2, spans: [Vec2; 2]) -> T {
        let size = Vec2::new(self.finest().width as f32, self.finest().height as f32);
        let Some(probes) = Probes::new(size, spans) else { return bilinear(&self.levels[0], self.wrap, place) };
        let top = self.levels.len() - 1;
        let finer = (probes.width.log2() as usize).min(top);
        // Of the next level as much as the width is beyond this one's pixel.
        let coarser = if finer == top { 0.0 } else { (probes.width / (finer as f32).exp2() - 1.0).clamp(0.0, 1.0) };
        probes.mean(place, |place| {
            let value = bilinear(&self.levels[finer], self.wrap, place);
            if coarser > 0.0 {
                value * (1.0 - coarser) + bilinear(&self.levels[finer + 1], self.wrap, place) * coarser
            } else {
                value
            }
        })
    }
}

/// Round lookups in a row that together cover a footprint.
#[derive(Clone, Copy, Debug)]
pub(super) struct Probes {
    count: u32,
    /// From one end of the footprint to the other.
    along: Vec2,
    /// Of each lookup, in pixels of the finest level, from 1 up.
    pub(super) width: f32,
}

impl Probes {
    /// Those of two spans across a footprint on an image of a size (pixels); `None` for a footprint within a pixel.
    #[inline]
    pub(super) fn new(size: Vec2, spans: [Vec2; 2]) -> Option<Self> {
        let [a, b] = spans.map(|span| (span * size).length());
        let (long, short, along) = if a >= b { (a, b, spans[0]) } else { (b, a, spans[1]) };
        // Also without a number.
        if !(long > 1.0) {
            return None;
        }
        // So far beyond every pixel that single precision would not tell places in it apart.
        if !(long < FARTHEST) {
            return Some(Self { count: 1, along: Vec2::ZERO, width: FARTHEST });
        }
        let width = short.max(long / MOST_PROBES).max(1.0);
        let count = (long / width).ceil().clamp(1.0, MOST_PROBES) as u32;
        Some(Self { count, along, width })
    }

    /// The mean of lookups about a place.
    #[inline]
    pub(super) fn mean<T: Pixel>(&self, place: Vec2, at: impl Fn(Vec2) -> T) -> T {
        if self.count == 1 {
            return at(place);
        }
        let count = self.count as f32;
        let probe = |index: u32| at(place + self.along * ((index as f32 + 0.5) / count - 0.5));
        (0..self.count).fold(T::default(), |sum, index| sum + probe(index)) * count.recip()
    }
}

/// The two pixels that a place lies between, and how far it is from the first to the second.
#[inline]
fn between(share: f32, count: usize, wrap: Wrap) -> (usize, usize, f32) {
    match wrap {
        Wrap::Repeat => {
            let place = (share - share.floor()) * count as f32 - 0.5;
            let low = place.floor();
            // low is -1 .. count - 1.
            let first = if low < 0.0 { count - 1 } else { (low as usize).min(count - 1) };
            (first, if first + 1 == count { 0 } else { first + 1 }, place - low)
        }
        // Beyond the edge of a mirrored image is the pixel at its edge once more.
        Wrap::Clamp | Wrap::Mirror => {
            let place = (wrap.folded(share) * count as f32 - 0.5).clamp(0.0, (count - 1) as f32);
            let low = place.floor();
            (low as usize, (low as usize + 1).min(count - 1), place - low)
        }
    }
}

#[inline]
fn bilinear<T: Pixel>(image: &Image<T>, wrap: [Wrap; 2], place: Vec2) -> T {
    let (x0, x1, fx) = between(place.x, image.width, wrap[0]);
    let (y0, y1, fy) = between(place.y, image.height, wrap[1]);
    let mix = |a: T, b: T, share: f32| a * (1.0 - share) + b * share;
    let row = |y: usize| mix(image.pixels[y * image.width + x0], image.pixels[y * image.width + x1], fx);
    mix(row(y0), row(y1), fy)
}

/// Pixels of a row of `from` that each of `to` covers: the first, and shares of it and those after it, which add up to 1.
fn shares(from: usize, to: usize) -> Vec<(usize, Vec<f32>)> {
    let step = from as f64 / to as f64;
    (0..to)
        .map(|index| {
            let (start, end) = (index as f64 * step, (index + 1) as f64 * step);
            let first = start as usize;
            // Rounding must not reach for a pixel behind the last.
            let last = (end.ceil() as usize).min(from);
            let share = |pixel: usize| (end.min((pixel + 1) as f64) - start.max(pixel as f64)).max(0.0) / step;
            (first, (first..last).map(|pixel| share(pixel) as f32).collect())
        })
        .collect()
}

fn halved<T: Pixel>(image: &Image<T>) -> Image<T> {
    let (width, height) = ((image.width / 2).max(1), (image.height / 2).max(1));
    let (across, down) = (shares(image.width, width), shares(image.height, height));
    let mut pixels = Vec::with_capacity(width * height);
    for (top, rows) in &down {
        for (left, columns) in &across {
            let mut sum = T::default();
            for (row, share) in rows.iter().enumerate() {
                let start = (top + row) * image.width + left;
                let line = image.pixels[start..start + columns.len()].iter().zip(columns);
                sum = sum + line.fold(T::default(), |sum, (&pixel, &weight)| sum + pixel * weight) * *share;
            }
            pixels.push(sum);
        }
    }
    Image { width, height, pixels }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const REPEAT: [Wrap; 2] = [Wrap::Repeat; 2];

    fn image(width: usize, height: usize, pixel: impl Fn(usize, usize) -> f32) -> Image<f32> {
        Image { width, height, pixels: (0..width * height).map(|k| pixel(k % width, k / width)).collect() }
    }

    fn checker(size: usize) -> Pyramid<f32> {
        Pyramid::new(image(size, size, |x, y| ((x + y) % 2) as f32), REPEAT)
    }

    #[test]
    fn every_level_has_the_images_mean() {
        for (width, height) in [(64, 64), (37, 5), (1, 9), (1, 1), (100, 3)] {
            let pyramid = Pyramid::new(image(width, height, |x, y| ((x * x + 3 * y) % 11) as f32), REPEAT);
            let mean = |level: &Image<f32>| level.pixels.iter().sum::<f32>() / level.pixels.len() as f32;
            for level in &pyramid.levels {
                assert!((mean(level) - mean(pyramid.finest())).abs() < 1e-4, "{width} {height}");
            }
            let last = pyramid.levels.last().unwrap();
            assert_eq!((last.width, last.height), (1, 1));
        }
    }

    #[test]
    fn without_a_footprint_pixel_centres_give_the_pixels() {
        let pyramid = Pyramid::new(image(8, 4, |x, y| (8 * y + x) as f32), [Wrap::Repeat, Wrap::Clamp]);
        for (index, &pixel) in pyramid.finest().pixels.iter().enumerate() {
            let place = Vec2::new(((index % 8) as f32 + 0.5) / 8.0, ((index / 8) as f32 + 0.5) / 4.0);
            assert!((pyramid.at(place, [Vec2::ZERO; 2]) - pixel).abs() < 1e-4);
            assert!((pyramid.at(place + Vec2::new(3.0, 0.0), [Vec2::ZERO; 2]) - pixel).abs() < 1e-4);
        }
        // Half way between the last and the first column; beyond the top and the bottom the outermost rows.
        assert!((pyramid.at(Vec2::new(0.0, 0.125), [Vec2::ZERO; 2]) - 3.5).abs() < 1e-5);
        assert_eq!(pyramid.at(Vec2::new(0.0625, -4.0), [Vec2::ZERO; 2]), 0.0);
        assert_eq!(pyramid.at(Vec2::new(0.0625, 9.0), [Vec2::ZERO; 2]), 24.0);
    }

    #[test]
    fn a_mirrored_image_goes_back_and_forth() {
        let pyramid = Pyramid::new(image(4, 1, |x, _| x as f32), [Wrap::Mirror, Wrap::Clamp]);
        for (place, pixel) in [(0.125, 0.0), (0.875, 3.0), (1.125, 3.0), (1.875, 0.0), (2.125, 0.0), (-0.125, 0.0)] {
            let seen = pyramid.at(Vec2::new(place, 0.5), [Vec2::ZERO; 2]);
            assert!((seen - pixel).abs() < 1e-5, "{place}: {seen}");
        }
        // Half way over an edge there is the edge's own pixel on both sides.
        assert_eq!([-1.0, 0.0, 1.0].map(|x| pyramid.at(Vec2::new(x, 0.5), [Vec2::ZERO; 2])), [3.0, 0.0, 3.0]);
        assert!((pyramid.at(Vec2::splat(-0.3), [Vec2::new(2.0, 0.0), Vec2::ZERO]) - 1.5).abs() < 0.01);
    }

    #[test]
    fn a_wide_footprint_sees_the_mean_and_a_long_one_only_along_itself() {
        let pyramid = checker(256);
        let stripes = Pyramid::new(image(256, 256, |x, _| ((x / 8) % 2) as f32), REPEAT);
        for step in 0..50 {
            let place = Vec2::new(step as f32 * 0.0171, step as f32 * 0.0313);
            let wide = [Vec2::new(4.0 / 256.0, 0.0), Vec2::new(0.0, 4.0 / 256.0)];
            assert!((pyramid.at(place, wide) - 0.5).abs() < 1e-6);
            // Down the stripes nothing is mixed, across them everything.
            let down = [Vec2::new(0.5 / 256.0, 0.0), Vec2::new(0.0, 24.0 / 256.0)];
            assert!((stripes.at(place, down) - stripes.at(place, [Vec2::ZERO; 2])).abs() < 1e-6);
            let across = [Vec2::new(32.0 / 256.0, 0.0), Vec2::new(0.0, 1.0 / 256.0)];
            assert!((stripes.at(place, across) - 0.5).abs() < 0.05, "{}", stripes.at(place, across));
        }
    }

    proptest! {
        #[test]
        fn any_place_and_footprint_gives_a_mixture(
            x in prop::num::f32::NORMAL, y in -2.0f32..3.0, a in prop::array::uniform4(prop::num::f32::ANY),
            mirrored in prop::bool::ANY,
        ) {
            let wrap = if mirrored { Wrap::Mirror } else { Wrap::Repeat };
            let pyramid = Pyramid::new(image(7, 12, |x, y| ((x + y) % 3) as f32), [wrap, Wrap::Clamp]);
            let value = pyramid.at(Vec2::new(x, y), [Vec2::new(a[0], a[1]), Vec2::new(a[2], a[3])]);
            prop_assert!((-1e-5..=2.0 + 1e-5).contains(&value), "{}", value);
        }
    }
}
