//! GeoTIFF: one band of heights, whole or floating-point numbers, in strips or tiles, plain, deflated or LZW.
//!
//! Sources: OGC 19-008r4, GeoTIFF standard 1.1, 2019; the tag for missing data is GDAL's. Only the distance between samples
//! and the place on the globe are taken from the reference system: no map is projected anew.

use std::io::BufReader;
use std::path::Path;

use tiff::decoder::{Decoder, DecodingResult, Limits};
use tiff::tags::Tag;
use tiff::{ColorType, TiffError};

use super::super::TerrainError;
use super::degrees::metres_in_a_degree;
use super::{MOST_SAMPLES, Raster, counts, open};

/// Most bytes that one byte of LZW can stand for: a code of at least nine bits, a string of at most 4096; deflate has less.
const RATIO: u64 = 4096;
/// Void samples of SRTM's 16-bit files, which often lack the tag that would say so (USGS, SRTM topography, 2015).
const SHORT_VOID: f64 = -32768.0;

// Keys of the directory (GeoTIFF standard, annex B) and the values that are known here.
const MODEL_TYPE: u16 = 1024;
const PROJECTED: u16 = 1;
const GEOGRAPHIC: u16 = 2;
const RASTER_TYPE: u16 = 1025;
const PIXEL_IS_POINT: u16 = 2;
const ANGULAR_UNIT: u16 = 2054;
const DEGREE: u16 = 9102;
const LINEAR_UNIT: u16 = 3076;
const VERTICAL_UNIT: u16 = 4099;

type File = Decoder<BufReader<std::fs::File>>;

/// `range`: what black and white stand for, where the scene says so; `spacing`: whether the scene says how far samples are apart.
pub(super) fn read(path: &Path, range: Option<[f64; 2]>, spacing: bool) -> Result<Raster, TerrainError> {
    let (file, bytes) = open(path)?;
    let failed = |error| failed(path, error);
    let mut file = Decoder::new(BufReader::new(file)).map_err(failed)?;
    let (nx, nz) = file.dimensions().map_err(failed)?;
    let color = file.colortype().map_err(failed)?;
    let ColorType::Gray(bits) = color else {
        return Err(wrong(path, "samples", format!("{color:?}"), "one band of heights"));
    };
    let [nx, nz] = counts(path, nx.into(), nz.into(), bits.into(), RATIO, bytes)?;
    let mut limits = Limits::default();
    limits.decoding_buffer_size = MOST_SAMPLES as usize * 8;
    limits.intermediate_buffer_size = limits.decoding_buffer_size;
    // Offsets of strips and tiles, eight bytes each, stand in the file themselves.
    limits.ifd_value_size = bytes.min(1 << 30) as usize;
    let mut file = file.with_limits(limits);

    // A scene that says how far samples are apart may use any file, whatever its reference system.
    let placed = if spacing { None } else { Placed::read(path, &mut file, nz)? };
    let missing = missing(path, &mut file)?;
    let vertical = unit(path, "vertical unit", keys(path, &mut file)?.get(VERTICAL_UNIT))?;
    let (mut values, greatest) = numbers(file.read_image().map_err(failed)?);
    if values.len() != nx * nz {
        let expected = format!("{nx} x {nz} = {} of them", nx * nz);
        return Err(wrong(path, "samples", format!("{} samples", values.len()), expected));
    }
    // The tag is text, and the samples may be single precision.
    let is_missing = |value: f64| missing.is_some_and(|missing| value == missing || value as f32 == missing as f32);
    let short = matches!(greatest, Greatest::Signed(16));
    let range = range.map(|range| greatest.scale(path, range)).transpose()?;
    for value in &mut values {
        *value = match range {
            _ if is_missing(*value) || (short && *value == SHORT_VOID) => f64::NAN,
            Some([black, step]) => black + step * *value,
            None => *value * vertical,
        };
    }
    let mut raster = Raster { nx, nz, values, spacing: None, origin: [0.0; 2] };
    if let Some(placed) = placed {
        if placed.from_south {
            raster.values = raster.values.chunks_exact(nx).rev().flatten().copied().collect();
        }
        raster.spacing = Some(placed.spacing);
        raster.origin = placed.origin;
    }
    Ok(raster)
}

/// What the greatest sample is.
#[derive(Clone, Copy)]
enum Greatest {
    /// 1 stands for white.
    Float,
    /// Bits of a sample; all of them set stand for white.
    Unsigned(u32),
    /// Bits; nothing stands for black.
    Signed(u32),
}

impl Greatest {
    /// Black, and metres for each step of a sample.
    fn scale(self, path: &Path, [black, white]: [f64; 2]) -> Result<[f64; 2], TerrainError> {
        let steps = match self {
            Self::Float => 1.0,
            Self::Unsigned(bits) if bits > 8 => 2.0_f64.powi(bits as i32) - 1.0,
            Self::Unsigned(bits) => {
                let found = format!("{bits} bits, at most 256 steps of height");
                return Err(wrong(path, "samples", found, "at least 16 bits where black and white stand for heights"));
            }
            Self::Signed(_) => {
                let expected = "unsigned or floating-point ones where black and white stand for heights";
                return Err(wrong(path, "samples", "signed numbers", expected));
            }
        };
        Ok([black, (white - black) / steps])
    }
}

fn numbers(image: DecodingResult) -> (Vec<f64>, Greatest) {
    fn all<T: Copy>(values: Vec<T>, number: impl Fn(T) -> f64) -> Vec<f64> {
        values.into_iter().map(number).collect()
    }
    match image {
        DecodingResult::U8(values) => (all(values, f64::from), Greatest::Unsigned(8)),
        DecodingResult::U16(values) => (all(values, f64::from), Greatest::Unsigned(16)),
        DecodingResult::U32(values) => (all(values, f64::from), Greatest::Unsigned(32)),
        DecodingResult::U64(values) => (all(values, |value| value as f64), Greatest::Unsigned(64)),
        DecodingResult::I8(values) => (all(values, f64::from), Greatest::Signed(8)),
        DecodingResult::I16(values) => (all(values, f64::from), Greatest::Signed(16)),
        DecodingResult::I32(values) => (all(values, f64::from), Greatest::Signed(32)),
        DecodingResult::I64(values) => (all(values, |value| value as f64), Greatest::Signed(64)),
        DecodingResult::F16(values) => (all(values, |value| value.to_f64()), Greatest::Float),
        DecodingResult::F32(values) => (all(values, f64::from), Greatest::Float),
        DecodingResult::F64(values) => (values, Greatest::Float),
    }
}

/// The number that marks missing data.
fn missing(path: &Path, file: &mut File) -> Result<Option<f64>, TerrainError> {
    let Some(value) = file.find_tag(Tag::GdalNodata).map_err(|error| failed(path, error))? else { return Ok(None) };
    let text = value.into_string().map_err(|error| failed(path, error))?;
    let number = text.trim_matches(|c: char| c.is_ascii_whitespace() || c == '\0');
    let wrong = |_| wrong(path, "tag GDAL_NODATA", format!("`{}`", number.escape_debug()), "a number");
    number.parse().map(Some).map_err(wrong)
}

/// Where the file says that its samples lie.
struct Placed {
    /// Metres.
    spacing: [f64; 2],
    /// x, z of the north-western sample (m).
    origin: [f64; 2],
    /// Whether the first row is the southernmost.
    from_south: bool,
}

impl Placed {
    /// `None` if the file does not say.
    fn read(path: &Path, file: &mut File, nz: usize) -> Result<Option<Self>, TerrainError> {
        let keys = keys(path, file)?;
        // Samples stand for areas unless the file says that they are points.
        let half = if keys.get(RASTER_TYPE) == Some(PIXEL_IS_POINT) { 0.0 } else { 0.5 };
        let Some(Affine { west, first, step }) = Affine::read(path, file)? else { return Ok(None) };
        let spacing = [step[0], step[1].abs()];
        let from_south = step[1] > 0.0;
        let row = |row: f64| first + step[1] * (row + half);
        let last = (nz - 1) as f64;
        let north = if from_south { row(last) } else { row(0.0) };
        match keys.get(MODEL_TYPE) {
            Some(PROJECTED) => {
                let unit = unit(path, "linear unit", keys.get(LINEAR_UNIT))?;
                let origin = [(west + step[0] * half) * unit, -north * unit];
                Ok(Some(Self { spacing: spacing.map(|step| step * unit), origin, from_south }))
            }
            Some(GEOGRAPHIC) => {
                if let Some(other) = keys.get(ANGULAR_UNIT).filter(|unit| *unit != DEGREE) {
                    return Err(wrong(path, "angular unit", format!("{other}"), "9102, degrees"));
                }
                let latitude = row(0.5 * last);
                if !(-90.0..=90.0).contains(&latitude) {
                    return Err(wrong(path, "middle latitude", format!("{latitude}"), "-90 to 90 degrees"));
                }
                let metres = metres_in_a_degree(latitude);
                let spacing = [0, 1].map(|axis| spacing[axis] * metres[axis]);
                // Its plan starts at its north-western corner: a degree's length is only right at the map itself.
                Ok(Some(Self { spacing, origin: spacing.map(|step| 0.5 * step), from_south }))
            }
            other => {
                let found =
                    other.map_or("no GTModelTypeGeoKey".to_owned(), |model| format!("GTModelTypeGeoKey {model}"));
                let expected = "1 (projected) or 2 (geographic), or simulation.terrain.spacing in the scene";
                Err(wrong(path, "reference system", found, expected))
            }
        }
    }
}

/// How columns and rows become eastings and northings, in the file's unit.
struct Affine {
    /// Of the outermost border or point of column 0.
    west: f64,
    /// Of row 0.
    first: f64,
    /// Eastward for each column, above 0; northward for each row, not 0.
    step: [f64; 2],
}

impl Affine {
    fn read(path: &Path, file: &mut File) -> Result<Option<Self>, TerrainError> {
        let mut numbers = |tag: Tag, name: &str, least: usize| -> Result<Option<Vec<f64>>, TerrainError> {
            let Some(value) = file.find_tag(tag).map_err(|error| failed(path, error))? else { return Ok(None) };
            let values = value.into_f64_vec().map_err(|error| failed(path, error))?;
            if values.len() < least || values.iter().any(|value| !value.is_finite()) {
                let found = format!("{:?}", &values[..values.len().min(16)]);
                return Err(wrong(path, name, found, format!("at least {least} finite numbers")));
            }
            Ok(Some(values))
        };
        let matrix = numbers(Tag::ModelTransformationTag, "ModelTransformationTag", 16)?;
        let scale = numbers(Tag::ModelPixelScaleTag, "ModelPixelScaleTag", 2)?;
        let tie = numbers(Tag::ModelTiepointTag, "ModelTiepointTag", 6)?;
        let affine = if let Some(m) = matrix {
            if m[1] != 0.0 || m[4] != 0.0 {
                let found = format!("rows and columns turned by {} and {}", m[1], m[4]);
                return Err(wrong(path, "ModelTransformationTag", found, "a map with north up (warp it first)"));
            }
            Self { west: m[3], first: m[7], step: [m[0], m[5]] }
        } else {
            let Some(scale) = scale else { return Ok(None) };
            // Without a tie point only the place is unknown.
            let tie = tie.unwrap_or_else(|| vec![0.0; 6]);
            Self { west: tie[3] - tie[0] * scale[0], first: tie[4] + tie[1] * scale[1], step: [scale[0], -scale[1]] }
        };
        if !(affine.step[0] > 0.0 && affine.step[1] != 0.0) {
            let found = format!("{} and {} from sample to sample", affine.step[0], -affine.step[1]);
            return Err(wrong(path, "scale", found, "a distance above 0 eastward, and one other than 0 southward"));
        }
        Ok(Some(affine))
    }
}

/// Metres in a unit of length, by its code in the EPSG registry; metres where there is none.
fn unit(path: &Path, place: &str, code: Option<u16>) -> Result<f64, TerrainError> {
    match code {
        None | Some(9001) => Ok(1.0),
        Some(9002) => Ok(0.3048),
        Some(9003) => Ok(1200.0 / 3937.0),
        Some(other) => {
            Err(wrong(path, place, format!("{other}"), "9001 (metre), 9002 (foot) or 9003 (US survey foot)"))
        }
    }
}

/// The short values of the key directory.
struct Keys(Vec<[u16; 4]>);

impl Keys {
    fn get(&self, key: u16) -> Option<u16> {
        // Where the second number is 0, the fourth is the value itself.
        self.0.iter().find(|entry| entry[0] == key && entry[1] == 0).map(|entry| entry[3])
    }
}

fn keys(path: &Path, file: &mut File) -> Result<Keys, TerrainError> {
    let directory = file.find_tag(Tag::GeoKeyDirectoryTag).map_err(|error| failed(path, error))?;
    let Some(directory) = directory else { return Ok(Keys(Vec::new())) };
    let words = directory.into_u16_vec().map_err(|error| failed(path, error))?;
    let (entries, _) = words.as_chunks::<4>();
    // The first four are the directory's own version and count.
    Ok(Keys(entries.iter().skip(1).copied().collect()))
}

fn wrong(path: &Path, place: &str, found: impl Into<String>, expected: impl Into<String>) -> TerrainError {
    TerrainError::Map {
        path: path.to_path_buf(),
        place: place.to_owned(),
        found: found.into(),
        expected: expected.into(),
    }
}

fn failed(path: &Path, error: TiffError) -> TerrainError {
    match error {
        TiffError::IoError(source) if source.kind() != std::io::ErrorKind::UnexpectedEof => {
            TerrainError::Io { path: path.to_path_buf(), source }
        }
        error => wrong(path, "TIFF", error.to_string(), "a whole TIFF of one band, plain, deflated, LZW or PackBits"),
    }
}

#[cfg(test)]
mod tests;
