//! Deep pictures: several samples a pixel, each with a depth or a span of depths, an alpha, and colour on request
//! (OpenEXR, Interpreting OpenEXR Deep Pixels, 2013). What the samples are is the renderer's matter; the file is written by
//! OpenImageIO, which the exr crate cannot do.

use super::{Metadata, Window};

/// What a span of depths stops, by itself: as if nothing stood before it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DeepSample {
    /// Planar depth (m) where it begins.
    pub front: f32,
    /// Where it ends; where it begins, for a surface.
    pub back: f32,
    /// Share of what lies behind that it stops, 0..1.
    pub alpha: f32,
    /// Its light (linear Rec.709, premultiplied by its alpha), where that was asked for.
    pub color: Option<[f32; 3]>,
}

impl DeepSample {
    /// Its alpha as far as a depth: the front part of it, cut there. A' = 1 - (1 - A)^((z - front) / (back - front)).
    pub fn alpha_before(&self, depth: f32) -> f32 {
        if depth <= self.front {
            return 0.0;
        }
        if depth >= self.back || self.alpha >= 1.0 {
            return self.alpha;
        }
        let part = f64::from(depth - self.front) / f64::from(self.back - self.front);
        (-((-f64::from(self.alpha)).ln_1p() * part).exp_m1()) as f32
    }

    /// Alpha and light of samples from front to back, one over the other.
    pub fn flatten(samples: &[Self]) -> (f32, [f32; 3]) {
        let (mut left, mut light) = (1.0f64, [0.0f64; 3]);
        for sample in samples {
            for (sum, color) in light.iter_mut().zip(sample.color.unwrap_or_default()) {
                *sum += left * f64::from(color);
            }
            left *= 1.0 - f64::from(sample.alpha);
        }
        ((1.0 - left) as f32, light.map(|sum| sum as f32))
    }
}

/// A deep picture. Pixels are tidy: samples in order of depth, none over another.
#[derive(Clone, Debug, PartialEq)]
pub struct DeepPicture {
    /// Width and height of the display window, whose corner is 0, 0.
    pub display: (u32, u32),
    /// The pixels that there are.
    pub data: Window,
    /// Index of each pixel's first sample, row by row, and after the last pixel the count of all.
    pub first: Vec<u64>,
    /// All samples.
    pub samples: Vec<DeepSample>,
    /// Whether samples have colour.
    pub colored: bool,
    /// Whether the file says that its pixels are tidy.
    pub state: bool,
    /// What the flat picture says of itself as well.
    pub metadata: Metadata,
}

impl DeepPicture {
    /// The samples of pixel `index` of the data window, row by row.
    pub fn pixel(&self, index: usize) -> &[DeepSample] {
        &self.samples[self.first[index] as usize..self.first[index + 1] as usize]
    }

    /// Channels of each sample, in the file's order.
    #[cfg_attr(not(feature = "oiio"), allow(dead_code))]
    pub(super) fn channels(&self) -> &'static [&'static str] {
        if self.colored { &["R", "G", "B", "A", "Z", "ZBack"] } else { &["A", "Z", "ZBack"] }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sample_cut_in_two_stops_what_it_stopped_whole() {
        let sample = DeepSample { front: 2.0, back: 4.0, alpha: 0.96, color: None };
        assert_eq!((sample.alpha_before(1.0), sample.alpha_before(2.0), sample.alpha_before(5.0)), (0.0, 0.0, 0.96));
        // Half of the way lets the root of it through.
        assert!((sample.alpha_before(3.0) - 0.8).abs() < 1e-6);
        let surface = DeepSample { back: 2.0, ..sample };
        assert_eq!((surface.alpha_before(2.0), surface.alpha_before(2.0001)), (0.0, 0.96));
    }

    #[test]
    fn flattened_samples_lie_one_over_the_other() {
        let sample =
            |alpha, light: f32| DeepSample { front: 1.0, back: 1.0, alpha, color: Some([light, 0.0, 2.0 * light]) };
        let (alpha, light) = DeepSample::flatten(&[sample(0.5, 0.5), sample(0.25, 1.0), sample(1.0, 8.0)]);
        assert_eq!((alpha, light), (1.0, [0.5 + 0.5 + 3.0, 0.0, 8.0]));
        assert_eq!(DeepSample::flatten(&[]), (0.0, [0.0; 3]));
    }
}
