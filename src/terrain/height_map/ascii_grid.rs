//! ESRI ASCII grids: a header of keys and values, then rows of numbers from north to south.
//!
//! The format says nothing of its units; `in_degrees` says how they are told. Source: Esri, ArcGIS documentation, Esri
//! ASCII raster format; `dx` and `dy` as GDAL writes them.

use std::io::Read;
use std::path::Path;

use super::super::TerrainError;
use super::degrees::metres_in_a_degree;
use super::{Raster, counts, open};

/// The largest file that is read (bytes): the most samples with some twenty characters each.
const MOST_BYTES: u64 = 3 << 30;

pub(super) fn read(path: &Path) -> Result<Raster, TerrainError> {
    let (mut file, bytes) = open(path)?;
    if bytes > MOST_BYTES {
        return Err(TerrainError::Map {
            path: path.to_path_buf(),
            place: "size".to_owned(),
            found: format!("{bytes} bytes"),
            expected: format!("at most {MOST_BYTES}"),
        });
    }
    let mut text = Vec::new();
    file.read_to_end(&mut text).map_err(|source| TerrainError::Io { path: path.to_path_buf(), source })?;
    let mut grid = parse(path, &text)?;
    let declared = declared_degrees(path)?;
    grid.project(path, declared);
    Ok(grid.raster)
}

/// What a header says so far.
#[derive(Default)]
struct Header {
    counts: [Option<u64>; 2],
    /// Place and whether it is the centre of the south-western sample instead of its corner.
    corner: [Option<(f64, bool)>; 2],
    size: [Option<f64>; 2],
    missing: Option<f64>,
}

/// A grid whose unit is not settled yet.
struct Grid {
    raster: Raster,
    /// Distance of samples along x and y, in the file's unit.
    cell: [f64; 2],
    /// West, south, east, north in the file's unit.
    extent: [f64; 4],
}

fn parse(path: &Path, text: &[u8]) -> Result<Grid, TerrainError> {
    let wrong = |place: String, found: String, expected: &str| TerrainError::Map {
        path: path.to_path_buf(),
        place,
        found,
        expected: expected.to_owned(),
    };
    let line = |number: usize| format!("line {}", number + 1);
    let shown = |word: &[u8]| format!("`{}`", String::from_utf8_lossy(&word[..word.len().min(40)]).escape_debug());
    let mut header = Header::default();
    let mut lines = text.split(|byte| *byte == b'\n').enumerate().peekable();
    let mut data_starts = 0;
    while let Some((number, row)) = lines.peek().copied() {
        let mut words = row.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty());
        match words.next() {
            None => {}
            Some(key) if key[0].is_ascii_alphabetic() && !key.eq_ignore_ascii_case(b"nan") => {
                let value = words.next().unwrap_or_default();
                header
                    .take(&key.to_ascii_lowercase(), value)
                    .map_err(|expected| wrong(line(number), format!("{} {}", shown(key), shown(value)), expected))?;
                if let Some(surplus) = words.next() {
                    return Err(wrong(
                        line(number),
                        shown(surplus),
                        "one key and one value in each line of the header",
                    ));
                }
            }
            Some(_) => break,
        }
        data_starts = row.as_ptr() as usize - text.as_ptr() as usize + row.len();
        lines.next();
    }
    let header_wrong = |what: &str| {
        wrong(
            "header".to_owned(),
            format!("no {what}"),
            "ncols, nrows, xllcorner or xllcenter, yllcorner or yllcenter, and cellsize (or dx and dy) before the heights",
        )
    };
    let count = |axis: usize, name| header.counts[axis].ok_or_else(|| header_wrong(name));
    let (nx, nz) = (count(0, "ncols")?, count(1, "nrows")?);
    let cell = |axis: usize, name| header.size[axis].ok_or_else(|| header_wrong(name));
    let cell = [cell(0, "cellsize or dx")?, cell(1, "cellsize or dy")?];
    let corner = |axis: usize, name| header.corner[axis].ok_or_else(|| header_wrong(name));
    let corner = [corner(0, "xllcorner or xllcenter")?, corner(1, "yllcorner or yllcenter")?];
    // A sample takes a digit and what parts it from the next; the last needs nothing after it.
    let room = (text.len() - data_starts.min(text.len())) as u64 + 1;
    let [nx, nz] = counts(path, nx, nz, 16, 1, room)?;

    let mut values = Vec::with_capacity(nx * nz);
    for (number, row) in lines {
        for word in row.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty()) {
            if values.len() == nx * nz {
                return Err(wrong(
                    line(number),
                    shown(word),
                    &format!("the end of the file after {nx} x {nz} heights"),
                ));
            }
            let number_here = std::str::from_utf8(word).ok().and_then(|word| word.parse::<f64>().ok());
            let Some(value) = number_here else {
                let place = format!("{}, column {}, row {}", line(number), values.len() % nx, values.len() / nx);
                return Err(wrong(place, shown(word), "a height, as 12.5"));
            };
            values.push(if header.missing == Some(value) { f64::NAN } else { value });
        }
    }
    if values.len() < nx * nz {
        let found = format!("{} heights", values.len());
        return Err(wrong("end of file".to_owned(), found, &format!("{nx} x {nz} = {} heights", nx * nz)));
    }
    let low = [0, 1].map(|axis| corner[axis].0 - if corner[axis].1 { 0.5 * cell[axis] } else { 0.0 });
    let extent = [low[0], low[1], low[0] + nx as f64 * cell[0], low[1] + nz as f64 * cell[1]];
    Ok(Grid { raster: Raster { nx, nz, values, spacing: None, origin: [0.0; 2] }, cell, extent })
}

impl Header {
    /// Notes one line; what was expected if it is wrong.
    fn take(&mut self, key: &[u8], value: &[u8]) -> Result<(), &'static str> {
        let value = std::str::from_utf8(value).unwrap_or_default();
        let number = || value.parse::<f64>();
        let place = || number().ok().filter(|place| place.is_finite()).ok_or("a finite number");
        let size = || number().ok().filter(|size| size.is_finite() && *size > 0.0).ok_or("a finite number above 0");
        let count = || value.parse::<u64>().map_err(|_| "a whole number");
        match key {
            b"ncols" => self.counts[0] = Some(count()?),
            b"nrows" => self.counts[1] = Some(count()?),
            b"xllcorner" => self.corner[0] = Some((place()?, false)),
            b"yllcorner" => self.corner[1] = Some((place()?, false)),
            b"xllcenter" => self.corner[0] = Some((place()?, true)),
            b"yllcenter" => self.corner[1] = Some((place()?, true)),
            b"cellsize" => self.size = [Some(size()?); 2],
            b"dx" => self.size[0] = Some(size()?),
            b"dy" => self.size[1] = Some(size()?),
            b"nodata_value" => self.missing = Some(number().map_err(|_| "a number")?),
            _ => {
                return Err(
                    "ncols, nrows, xllcorner, yllcorner, xllcenter, yllcenter, cellsize, dx, dy or nodata_value",
                );
            }
        }
        Ok(())
    }
}

impl Grid {
    /// Settles what the numbers of the header are: degrees or metres.
    fn project(&mut self, path: &Path, declared: Option<bool>) {
        let [west, south, east, north] = self.extent;
        let guessed = declared.is_none();
        if !declared.unwrap_or_else(|| self.in_degrees()) {
            self.raster.spacing = Some(self.cell);
            self.raster.origin = [west + 0.5 * self.cell[0], -(north - 0.5 * self.cell[1])];
            return;
        }
        let latitude = 0.5 * (south + north);
        let metres = metres_in_a_degree(latitude);
        let spacing = [0, 1].map(|axis| self.cell[axis] * metres[axis]);
        if guessed {
            tracing::info!(
                file = %path.display(), west, south, east, north, ?spacing,
                "this grid's cells are taken for degrees; `spacing` or a .prj file beside it would say otherwise"
            );
        }
        // Its plan starts at its north-western corner: a degree's length is only right at the map itself.
        self.raster.spacing = Some(spacing);
        self.raster.origin = spacing.map(|step| 0.5 * step);
    }

    /// Whether the cells are degrees: fine ones on the globe, and read as metres the map would be a tower, higher than wide.
    ///
    /// Degrees make a landscape of kilometres look metres wide; no scan of a real bed is as high as it is wide.
    fn in_degrees(&self) -> bool {
        let [west, south, east, north] = self.extent;
        let on_globe = west >= -180.0 && east <= 360.0 && south >= -90.0 && north <= 90.0;
        // Coarser than an arc-minute there is no landform left to run water down.
        let fine = self.cell.iter().all(|cell| *cell <= 1.0 / 60.0);
        let finite = self.raster.values.iter().filter(|value| value.is_finite());
        let (low, high) =
            finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| (value.min(low), value.max(high)));
        fine && on_globe && high - low > (east - west).max(north - south)
    }
}

/// Whether a projection file beside the grid says degrees (`Some(true)`) or metres; `None` without one.
///
/// Well-known text opens with GEOGCS or PROJCS; Arc's own form has a line `Projection GEOGRAPHIC`.
fn declared_degrees(path: &Path) -> Result<Option<bool>, TerrainError> {
    let path = path.with_extension("prj");
    if !path.is_file() {
        return Ok(None);
    }
    let mut text = Vec::new();
    let (file, _) = open(&path)?;
    file.take(1 << 16).read_to_end(&mut text).map_err(|source| TerrainError::Io { path: path.clone(), source })?;
    let text = String::from_utf8_lossy(&text).to_ascii_uppercase();
    let projection = text.lines().find_map(|line| line.trim().strip_prefix("PROJECTION").map(str::trim));
    let wrong = |found: String, expected: &str| TerrainError::Map {
        path: path.clone(),
        place: "projection".to_owned(),
        found,
        expected: expected.to_owned(),
    };
    let start = text.trim_start();
    if start.starts_with("GEOGCS") || projection == Some("GEOGRAPHIC") {
        return Ok(Some(true));
    }
    if start.starts_with("PROJCS") {
        // The last unit is the map's own; the ones before it belong to its parts.
        return match text.rfind("UNIT[").map(|at| text[at + 5..].trim_start_matches(['"', ' '])) {
            Some(unit) if unit.starts_with("MET") => Ok(Some(false)),
            Some(unit) => Err(wrong(
                format!("unit {:?}", unit.chars().take(20).collect::<String>()),
                "metres (or simulation.terrain.spacing in the scene, and no .prj beside the grid)",
            )),
            None => Err(wrong("no unit".to_owned(), "UNIT[\"metre\",1]")),
        };
    }
    let found = format!("{:?}", start.chars().take(40).collect::<String>());
    Err(wrong(found, "GEOGCS[…], PROJCS[…] or a line `Projection GEOGRAPHIC`"))
}

#[cfg(test)]
mod tests;
