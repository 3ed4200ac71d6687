//! A noisy picture → the same picture without its noise, by Intel Open Image Denoise; the noisy beauty stays as a layer.
//!
//! The filter looks at the beauty and at two guides that the renderer writes through the water: `albedo` and `dnormal`.
//! The guides are filtered first, each by itself, and the beauty is then told that they are clean: noise in them (spray,
//! ripples, defocus) would otherwise stay in the picture.
//!
//! *Source*: A. T. Áfra, Intel Open Image Denoise, 2019-2026, manual: "Prefiltering".

mod error;

use std::time::Instant;

pub use crate::ffi::oidn::OidnError;
pub use error::DenoiseError;

use crate::ffi::oidn::{Device, Images};
use crate::output::{Channel, Picture, SampleType};

/// The beauty's channels, and the layer that keeps them as they were rendered.
const BEAUTY: [&str; 3] = ["R", "G", "B"];
const NOISY: [&str; 3] = ["noisy.R", "noisy.G", "noisy.B"];
const ALBEDO: [&str; 3] = ["albedo.R", "albedo.G", "albedo.B"];
const NORMAL: [&str; 3] = ["dnormal.x", "dnormal.y", "dnormal.z"];
/// Samples of each pixel: 0 where a render was stopped before it came there.
const SAMPLES: &str = "sampleCount";

/// The loaded library, ready to filter pictures.
#[derive(Debug)]
pub struct Denoiser {
    device: Device,
}

/// What denoising took.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct DenoiseReport {
    /// Version of Open Image Denoise.
    pub version: String,
    /// Pixels.
    pub pixels: u64,
    /// Filtering the guides (s).
    pub guides_s: f64,
    /// All of it (s).
    pub seconds: f64,
}

impl Denoiser {
    /// Finds and loads the library; it will filter with `threads` threads (0: all).
    ///
    /// # Errors
    /// [`DenoiseError::Library`]: it is nowhere (the message lists the places and how to get it), too old, or cannot work
    /// on this processor.
    pub fn new(threads: usize) -> Result<Self, DenoiseError> {
        Ok(Self { device: Device::new(threads)? })
    }

    /// Replaces the beauty `R G B` by a filtered one and keeps what it was as the layer `noisy`; all else stays as it is.
    ///
    /// Only the data window is seen: near its edge a crop has other bits than the full frame. The same picture becomes the
    /// same bits at any count of threads (on processors with the same instructions). A pixel without a sample stays 0.
    ///
    /// # Errors
    /// A channel that is missing, of the wrong length or not finite; a picture that has been denoised before; what the
    /// library says. The picture is then as it was.
    pub fn denoise(&self, picture: &mut Picture) -> Result<DenoiseReport, DenoiseError> {
        let start = Instant::now();
        if picture.channel(NOISY[0]).is_some() {
            return Err(DenoiseError::Twice);
        }
        let size = (picture.data.width as usize, picture.data.height as usize);
        let colour = interleave(picture, BEAUTY, 0.0, f32::MAX)?;
        // Rounding may carry a guide a little out of its range, where the filter was never trained.
        let albedo = interleave(picture, ALBEDO, 0.0, 1.0)?;
        let normal = interleave(picture, NORMAL, -1.0, 1.0)?;
        let albedo = self.filtered(&Images { size, albedo: Some(&albedo), ..Images::default() })?;
        let normal = self.filtered(&Images { size, normal: Some(&normal), ..Images::default() })?;
        let guides_s = start.elapsed().as_secs_f64();
        let filtered = self.filtered(&Images {
            size,
            colour: Some(&colour),
            albedo: Some(&albedo),
            normal: Some(&normal),
            clean_guides: true,
        })?;
        if let Some(index) = filtered.iter().position(|value| !value.is_finite()) {
            return Err(not_finite(picture, BEAUTY[index % 3], index / 3, filtered[index]));
        }
        let seen = picture.channel(SAMPLES).map(|channel| channel.samples.clone());
        for (part, (name, kept)) in BEAUTY.into_iter().zip(NOISY).enumerate() {
            let channel = picture.channels.iter_mut().find(|channel| channel.name == name).expect("read above");
            let clean = filtered.iter().skip(part).step_by(3).enumerate().map(|(pixel, &value)| {
                let empty = seen.as_ref().is_some_and(|seen| seen.get(pixel) == Some(&0.0));
                if empty { 0.0 } else { value }
            });
            let noisy = std::mem::replace(&mut channel.samples, clean.collect());
            picture.channels.push(Channel { name: kept.to_owned(), sample_type: SampleType::Half, samples: noisy });
        }
        let version = self.device.version();
        picture.metadata.denoiser = format!("Open Image Denoise {version}");
        let pixels = (size.0 * size.1) as u64;
        Ok(DenoiseReport { version, pixels, guides_s, seconds: start.elapsed().as_secs_f64() })
    }

    /// What the filter makes of a guide alone, or of light and its guides.
    fn filtered(&self, images: &Images) -> Result<Vec<f32>, DenoiseError> {
        let mut output = vec![0.0; 3 * images.size.0 * images.size.1];
        self.device.filter(images, &mut output)?;
        Ok(output)
    }
}

/// Three channels as one picture of triples, held within a range.
fn interleave(picture: &Picture, names: [&str; 3], least: f32, most: f32) -> Result<Vec<f32>, DenoiseError> {
    let mut triples = vec![0.0; 3 * picture.data.area()];
    for (part, name) in names.into_iter().enumerate() {
        let channel = picture.channel(name).ok_or_else(|| DenoiseError::NoChannel { name: name.to_owned() })?;
        if channel.samples.len() != picture.data.area() {
            return Err(DenoiseError::ChannelSize {
                name: name.to_owned(),
                samples: channel.samples.len(),
                expected: picture.data.area(),
            });
        }
        for (pixel, (triple, &value)) in triples.chunks_exact_mut(3).zip(&channel.samples).enumerate() {
            if !value.is_finite() {
                return Err(not_finite(picture, name, pixel, value));
            }
            triple[part] = value.clamp(least, most);
        }
    }
    Ok(triples)
}

fn not_finite(picture: &Picture, name: &str, pixel: usize, value: f32) -> DenoiseError {
    let width = picture.data.width as usize;
    let (x, y) = (picture.data.x + (pixel % width) as i32, picture.data.y + (pixel / width) as i32);
    DenoiseError::NonFinite { name: name.to_owned(), x, y, value }
}

#[cfg(test)]
mod tests;
