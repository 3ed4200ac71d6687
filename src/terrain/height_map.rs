//! Height maps from files → samples on a regular lattice, in metres, whole.
//!
//! One reader per format beside this file; here is what they have in common: which reader, the crop, and what every map
//! must keep to. Between the samples the spline is in `spline`, detail and landforms are in `landform`.

mod ascii_grid;
mod degrees;
mod frame;
mod geotiff;
mod picture;
mod spline;

pub(super) use spline::{Axis, resample};

use std::path::Path;

use super::TerrainError;

/// Most samples taken of one file: 1 GB in double precision. It bounds what a file of nothing but zeros, which the
/// compressed formats pack a thousandfold, can ask for.
const MOST_SAMPLES: u64 = 1 << 27;
/// Greatest height (m) up or down: beyond it a number is a mark for missing data that the file forgot to declare.
const GREATEST: f64 = 1e6;

/// Heights on a lattice. Index `z * nx + x`; row 0 is the northern edge.
#[derive(Clone, Debug, PartialEq)]
pub struct HeightMap {
    /// Samples along x (eastward), at least 1.
    pub nx: usize,
    /// Samples along z (southward), at least 1.
    pub nz: usize,
    /// Metres between samples, x and z.
    pub spacing: [f64; 2],
    /// x, z of sample (0, 0) in the file's own plan (m): what a crop leaves keeps its place there.
    pub origin: [f64; 2],
    /// Heights (m), all finite.
    pub heights: Vec<f64>,
}

/// What a scene says about a height map's file.
#[derive(Clone, Copy, Debug, Default)]
pub struct Reading {
    /// First column, first row, last column, last row.
    pub crop: Option<[u32; 4]>,
    /// Metres between samples, instead of what the file says.
    pub spacing: Option<[f64; 2]>,
    /// What an image's black and white stand for (m).
    pub heights: Option<[f64; 2]>,
}

/// A file's samples before the checks.
#[derive(Clone, Debug)]
struct Raster {
    nx: usize,
    nz: usize,
    /// NaN where the file has no data.
    values: Vec<f64>,
    /// Metres, where the file tells.
    spacing: Option<[f64; 2]>,
    origin: [f64; 2],
}

impl HeightMap {
    /// Reads a height map; the file's ending says which format: .tif (GeoTIFF), .png (16 bit), .exr,
    /// .asc (ESRI ASCII grid), .npz or .state (a frame, or any archive with an array `base`).
    ///
    /// # Errors
    /// A file that cannot be read or understood, a crop that leaves the map, samples without data in what the crop
    /// leaves, no distance between samples from either side.
    pub fn read(path: &Path, reading: &Reading) -> Result<Self, TerrainError> {
        let ending = path.extension().and_then(|ending| ending.to_str()).map(str::to_ascii_lowercase);
        let raster = match ending.as_deref() {
            Some("asc") => ascii_grid::read(path)?,
            Some("tif" | "tiff") => geotiff::read(path, reading.heights, reading.spacing.is_some())?,
            Some("png") => picture::read_png(path, reading.heights)?,
            Some("exr") => picture::read_exr(path, reading.heights)?,
            Some("npz" | "state") => frame::read(path)?,
            _ => return Err(TerrainError::UnknownMap { path: path.to_path_buf() }),
        };
        raster.checked(path, reading)
    }
}

impl Raster {
    fn checked(self, path: &Path, reading: &Reading) -> Result<HeightMap, TerrainError> {
        let spacing = reading.spacing.or(self.spacing);
        let spacing = spacing.ok_or_else(|| TerrainError::NoSpacing { path: path.to_path_buf() })?;
        let whole = [0, 0, self.nx - 1, self.nz - 1];
        let crop = reading.crop.map_or(whole, |crop| crop.map(|place| place as usize));
        let [x0, z0, x1, z1] = crop;
        if x0 > x1 || z0 > z1 || x1 >= self.nx || z1 >= self.nz {
            return Err(TerrainError::Crop { path: path.to_path_buf(), crop, nx: self.nx, nz: self.nz });
        }
        let rows = self.values.chunks_exact(self.nx);
        let heights: Vec<f64> = rows.skip(z0).take(z1 - z0 + 1).flat_map(|row| &row[x0..=x1]).copied().collect();
        let (nx, nz) = (x1 - x0 + 1, z1 - z0 + 1);
        let place = |index: usize| [x0 + index % nx, z0 + index / nx];
        if let Some(first) = heights.iter().position(|height| !height.is_finite()) {
            return Err(TerrainError::Holes {
                path: path.to_path_buf(),
                count: heights.iter().filter(|height| !height.is_finite()).count(),
                samples: heights.len(),
                first: place(first),
            });
        }
        if let Some(first) = heights.iter().position(|height| height.abs() > GREATEST) {
            let [x, z] = place(first);
            return Err(TerrainError::Map {
                path: path.to_path_buf(),
                place: format!("column {x}, row {z}"),
                found: format!("a height of {} m", heights[first]),
                expected: format!("at most {GREATEST} m up or down (a mark for missing data must be declared as such)"),
            });
        }
        let origin = [self.origin[0] + x0 as f64 * spacing[0], self.origin[1] + z0 as f64 * spacing[1]];
        Ok(HeightMap { nx, nz, spacing, origin, heights })
    }
}

/// Counts that a file claims → counts, if samples of at least `bits` each can be in its bytes at `ratio` to one.
fn counts(path: &Path, nx: u64, nz: u64, bits: u64, ratio: u64, bytes: u64) -> Result<[usize; 2], TerrainError> {
    let wrong = |expected: String| TerrainError::Map {
        path: path.to_path_buf(),
        place: "size".to_owned(),
        found: format!("{nx} x {nz} samples"),
        expected,
    };
    let samples = nx.checked_mul(nz).filter(|samples| *samples > 0 && *samples <= MOST_SAMPLES);
    let Some(samples) = samples else {
        return Err(wrong(format!(
            "at least one, at most {MOST_SAMPLES} together (cut larger maps to the part in use)"
        )));
    };
    if samples.saturating_mul(bits) / 8 > bytes.saturating_mul(ratio) {
        return Err(wrong(format!("no more than {bytes} bytes of data can hold")));
    }
    Ok([nx as usize, nz as usize])
}

/// Opens a regular file: a pipe cannot be sought in, a device may never end.
fn open(path: &Path) -> Result<(std::fs::File, u64), TerrainError> {
    let failed = |source| TerrainError::Io { path: path.to_path_buf(), source };
    let metadata = std::fs::metadata(path).map_err(failed)?;
    if !metadata.is_file() {
        return Err(failed(std::io::Error::other("not a regular file")));
    }
    Ok((std::fs::File::open(path).map_err(failed)?, metadata.len()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn raster(values: &[f64], nx: usize) -> Raster {
        Raster { nx, nz: values.len() / nx, values: values.to_vec(), spacing: Some([2.0, 3.0]), origin: [10.0, 20.0] }
    }

    #[test]
    fn a_crop_keeps_its_place_and_leaves_holes_outside_alone() {
        let raster = raster(&[f64::NAN, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0], 3);
        let read =
            |crop, spacing| raster.clone().checked(Path::new("a.asc"), &Reading { crop, spacing, heights: None });
        let map = read(Some([1, 1, 2, 2]), None).unwrap();
        assert_eq!((map.nx, map.nz, map.heights.as_slice()), (2, 2, [4.0, 5.0, 7.0, 8.0].as_slice()));
        assert_eq!((map.origin, map.spacing), ([12.0, 23.0], [2.0, 3.0]));
        assert_eq!(read(Some([1, 1, 1, 1]), Some([5.0, 7.0])).unwrap().spacing, [5.0, 7.0]);

        let error = read(None, None).unwrap_err().to_string();
        assert!(error.contains("1 of 9") && error.contains("column 0, row 0") && error.contains("crop"), "{error}");
        for crop in [[2, 0, 1, 2], [0, 2, 2, 1], [0, 0, 3, 2], [0, 0, 2, u32::MAX]] {
            let error = read(Some(crop), None).unwrap_err().to_string();
            assert!(error.contains("3 x 3"), "{error}");
        }
    }

    #[test]
    fn a_forgotten_mark_for_missing_data_is_no_height() {
        let error = raster(&[1.0, -3.4e38, 0.0, 0.0], 2).checked(Path::new("a.asc"), &Reading::default()).unwrap_err();
        assert!(error.to_string().contains("column 1, row 0"), "{error}");
    }

    #[test]
    fn a_size_must_fit_in_the_file() {
        let path = Path::new("a.tif");
        assert!(counts(path, 100, 100, 16, 1, 20_000).is_ok());
        assert!(counts(path, 100, 100, 16, 1, 19_999).is_err());
        assert!(counts(path, 0, 100, 16, 1, 20_000).is_err());
        assert!(counts(path, u64::MAX, 3, 16, 1000, u64::MAX).is_err());
        assert!(counts(path, 1 << 14, 1 << 14, 1, 1000, u64::MAX).is_err());
    }

    #[test]
    fn an_unknown_ending_is_named() {
        let error = HeightMap::read(Path::new("ground.jpg"), &Reading::default()).unwrap_err().to_string();
        assert!(error.contains("ground.jpg") && error.contains(".asc"), "{error}");
    }
}
