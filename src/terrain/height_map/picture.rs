//! Height maps that are pictures: 16-bit PNG and EXR.
//!
//! A PNG's samples only become heights by what the scene says of black and white; an EXR's are metres unless it does.

use std::io::BufReader;
use std::path::Path;

use exr::image::FlatSamples;
use exr::meta::MetaData;
use exr::prelude::{ReadChannels, ReadLayers};
use image::codecs::png::PngDecoder;
use image::{ColorType, ImageDecoder, ImageError, Limits};

use super::super::TerrainError;
use super::{MOST_SAMPLES, Raster, counts, open};

/// Most bytes that one byte of deflate can stand for (zlib's technical notes).
const DEFLATE_RATIO: u64 = 1032;
/// The same for EXR's methods, which have no such proof: a block of up to 256 rows in a few dozen bytes.
const EXR_RATIO: u64 = 1 << 16;
/// Channels that may hold the heights of an EXR, the first of them that it has.
const CHANNELS: [&str; 3] = ["Y", "Z", "R"];

/// One channel of 16 bits, from black to white.
pub(super) fn read_png(path: &Path, range: Option<[f64; 2]>) -> Result<Raster, TerrainError> {
    let Some([black, white]) = range else { return Err(TerrainError::NoHeights { path: path.to_path_buf() }) };
    let (file, bytes) = open(path)?;
    let failed = |error| match error {
        ImageError::IoError(source) if source.kind() != std::io::ErrorKind::UnexpectedEof => {
            TerrainError::Io { path: path.to_path_buf(), source }
        }
        error => wrong(path, "PNG", error.to_string(), "a whole PNG of 16-bit grey"),
    };
    let mut limits = Limits::default();
    limits.max_alloc = Some(MOST_SAMPLES * 4);
    let decoder = PngDecoder::with_limits(BufReader::new(file), limits).map_err(failed)?;
    let (nx, nz) = decoder.dimensions();
    match decoder.color_type() {
        ColorType::L16 => {}
        ColorType::L8 => {
            let expected = "16 bits: 256 steps of height would run through the water as terraces";
            return Err(wrong(path, "samples", "8 bits", expected));
        }
        other => return Err(wrong(path, "samples", format!("{other:?}"), "grey alone, 16 bits")),
    }
    let [nx, nz] = counts(path, nx.into(), nz.into(), 16, DEFLATE_RATIO, bytes)?;
    let mut samples = vec![0; 2 * nx * nz];
    decoder.read_image(&mut samples).map_err(failed)?;
    let height = |sample: &[u8; 2]| black + (white - black) * f64::from(u16::from_ne_bytes(*sample)) / 65535.0;
    let values = samples.as_chunks().0.iter().map(height).collect();
    Ok(Raster { nx, nz, values, spacing: None, origin: [0.0; 2] })
}

/// Channel Y, Z or R of the first part that has one.
pub(super) fn read_exr(path: &Path, range: Option<[f64; 2]>) -> Result<Raster, TerrainError> {
    let (file, bytes) = open(path)?;
    let failed = |error: exr::error::Error| match error {
        exr::error::Error::Io(source) if source.kind() != std::io::ErrorKind::UnexpectedEof => {
            TerrainError::Io { path: path.to_path_buf(), source }
        }
        error => wrong(path, "EXR", error.to_string(), "a whole, flat EXR"),
    };
    // Sizes first: the reader makes room for all that the headers claim.
    let meta = MetaData::read_from_buffered(BufReader::new(file), false).map_err(failed)?;
    let mut samples = 0;
    for header in &meta.headers {
        let [nx, nz] = [header.layer_size.width(), header.layer_size.height()].map(|count| count as u64);
        let bits = 8 * header.channels.bytes_per_pixel as u64;
        let [nx, nz] = counts(path, nx, nz, bits, EXR_RATIO, bytes)?;
        samples += (nx * nz) as u64 * header.channels.list.len() as u64;
    }
    if samples > MOST_SAMPLES {
        let expected = format!("at most {MOST_SAMPLES} in all channels together");
        return Err(wrong(path, "size", format!("{samples} samples"), expected));
    }
    let (file, _) = open(path)?;
    let image = exr::prelude::read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .all_layers()
        .all_attributes()
        .from_buffered(BufReader::new(file))
        .map_err(failed)?;
    let found = CHANNELS.iter().find_map(|name| {
        image.layer_data.iter().find_map(|layer| {
            let channel = layer.channel_data.list.iter().find(|channel| channel.name == **name)?;
            Some((layer.size, channel))
        })
    });
    let Some((size, channel)) = found else {
        let names = image.layer_data.iter().flat_map(|layer| &layer.channel_data.list);
        let names: Vec<String> = names.take(20).map(|channel| format!("`{}`", channel.name)).collect();
        return Err(wrong(path, "channels", names.join(", "), "heights in a channel `Y`, `Z` or `R`"));
    };
    let [nx, nz] = [size.width(), size.height()];
    let mut values: Vec<f64> = match &channel.sample_data {
        FlatSamples::F16(samples) => {
            tracing::warn!(file = %path.display(), "half-precision heights: eleven bits, steps of 0.25 m at a height of 500 m");
            samples.iter().map(|sample| sample.to_f64()).collect()
        }
        FlatSamples::F32(samples) => samples.iter().copied().map(f64::from).collect(),
        FlatSamples::U32(samples) => samples.iter().copied().map(f64::from).collect(),
    };
    if values.len() != nx * nz {
        let found = format!("{} samples for {nx} x {nz} pixels", values.len());
        return Err(wrong(path, "channels", found, "one sample for each pixel"));
    }
    if let Some([black, white]) = range {
        values.iter_mut().for_each(|value| *value = black + (white - black) * *value);
    }
    Ok(Raster { nx, nz, values, spacing: None, origin: [0.0; 2] })
}

fn wrong(path: &Path, place: &str, found: impl Into<String>, expected: impl Into<String>) -> TerrainError {
    TerrainError::Map {
        path: path.to_path_buf(),
        place: place.to_owned(),
        found: found.into(),
        expected: expected.into(),
    }
}

#[cfg(test)]
mod tests;
