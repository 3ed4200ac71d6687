//! `[simulation.terrain]` → one height for each column: height maps, planes and valleys, their ledges and fractal detail.
//!
//! What files hold is read in `height_map`; the water over the ground is the simulation's.

use std::f64::consts::TAU;
use std::path::Path;

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use crate::scene::{Landform, LandformKind, Ledge};

use super::TerrainError;
use super::height_map::{Axis, HeightMap, Reading, resample};
use super::noise::{Field, PLAN_RMS};

/// Most columns of a simulation: as many as a frame's file may hold.
pub const LARGEST_NUMBER_OF_COLUMNS: u64 = crate::state::MAX_ROWS;

/// Columns and their width where neither scene nor file says more.
const COLUMNS: [u32; 2] = [80, 20];
const WIDTH: f64 = 0.25;

/// Builds the ground: a map whose samples are the columns, `origin` the centre of column (0, 0).
///
/// `directory` is where the scene's paths start; `seed` picks the fractal detail, which belongs to the plan of the
/// landform: finer columns add octaves and leave the coarser ones in place.
///
/// # Errors
/// A file that cannot be read or has holes, columns that the map cannot fill, detail without an octave.
pub fn land(landform: &Landform, directory: &Path, seed: u32) -> Result<HeightMap, TerrainError> {
    let (mut ground, plan, coarsest) = match landform.kind {
        LandformKind::File => from_file(landform, directory)?,
        LandformKind::Plane | LandformKind::Valley => procedural(landform)?,
    };
    if landform.detail > 0.0 {
        let size = landform.detail_size.unwrap_or(coarsest);
        add_detail(&mut ground, plan, landform.detail, size, landform.detail_gain, seed)?;
    }
    for ledge in &landform.ledge {
        drop_at(&mut ground, ledge);
    }
    if let Some(lowest) = landform.lowest {
        let shift = lowest - ground.heights.iter().copied().fold(f64::INFINITY, f64::min);
        ground.heights.iter_mut().for_each(|height| *height += shift);
    }
    Ok(ground)
}

/// Columns, place of column (0, 0) in the landform's own plan (m), wavelength of the coarsest detail by default (m).
type Ground = (HeightMap, [f64; 2], f64);

fn from_file(landform: &Landform, directory: &Path) -> Result<Ground, TerrainError> {
    let file = landform.file.as_deref().unwrap_or_default();
    if file.is_empty() {
        return Err(TerrainError::Landform {
            key: "file",
            found: "no name".to_owned(),
            expected: "the name of a height map, since kind is \"file\"".to_owned(),
        });
    }
    let reading = Reading { crop: landform.crop, spacing: landform.spacing, heights: landform.heights };
    let map = HeightMap::read(&directory.join(file), &reading)?;
    let samples = [map.nx, map.nz];
    let spacing = map.spacing.map(|spacing| spacing * landform.scale);
    let extent = [0, 1].map(|axis| samples[axis] as f64 * spacing[axis]);
    let columns: [f64; 2] = match (landform.columns, landform.width) {
        (Some(columns), _) => columns.map(f64::from),
        // The nearest whole number of columns: up to half a column is left over or goes on beyond the border.
        (None, Some(width)) => [0, 1].map(|axis| (extent[axis] / width[axis]).round()),
        (None, None) => samples.map(|samples| samples as f64),
    };
    let width = landform.width.unwrap_or([0, 1].map(|axis| extent[axis] / columns[axis]));
    let [nx, nz] = counts(columns)?;
    let axes = [0, 1].map(|axis| {
        let step = width[axis] / spacing[axis];
        // Columns take the middle of the map.
        let margin = 0.5 * (samples[axis] as f64 - columns[axis] * step);
        Axis { samples: samples[axis], results: columns[axis] as usize, first: margin + 0.5 * step - 0.5, step }
    });
    for axis in 0..2 {
        // Half a column beyond the map's border is what rounding to whole columns may take.
        if columns[axis] * width[axis] > extent[axis] + 0.5 * width[axis] {
            return Err(TerrainError::Landform {
                key: "columns",
                found: format!(
                    "{} columns of {} m are {} m along {}",
                    columns[axis],
                    width[axis],
                    columns[axis] * width[axis],
                    ["x", "z"][axis]
                ),
                expected: format!(
                    "at most {} m, the height map's part times simulation.terrain.scale (a greater scale or a wider crop \
                     makes room)",
                    extent[axis]
                ),
            });
        }
    }
    let plan = [0, 1].map(|axis| map.origin[axis] * landform.scale + axes[axis].first * spacing[axis]);
    let factor = landform.vertical_scale.unwrap_or(landform.scale);
    let mut heights = resample(&map.heights, axes[0], axes[1]);
    heights.iter_mut().for_each(|height| *height *= factor);
    let ground = HeightMap { nx, nz, spacing: width, origin: landform.origin, heights };
    Ok((ground, plan, spacing[0].max(spacing[1])))
}

fn procedural(landform: &Landform) -> Result<Ground, TerrainError> {
    let columns = landform.columns.unwrap_or(COLUMNS).map(f64::from);
    let [nx, nz] = counts(columns)?;
    let width = landform.width.unwrap_or([WIDTH; 2]);
    let valley = Valley::new(landform, nz as f64 * width[1]);
    let height = |index: usize| {
        let [x, z] = [(index % nx) as f64 + 0.5, (index / nx) as f64 + 0.5];
        let [x, z] = [x * width[0], z * width[1]];
        let side = if landform.kind == LandformKind::Valley { valley.side([x, z]) } else { 0.0 };
        side - landform.slope * (x - 0.5 * width[0])
    };
    let heights = (0..nx * nz).into_par_iter().map(height).collect();
    let ground = HeightMap { nx, nz, spacing: width, origin: landform.origin, heights };
    Ok((ground, width.map(|width| 0.5 * width), 8.0 * width[0].max(width[1])))
}

/// Whole numbers of columns that a simulation may have.
fn counts(columns: [f64; 2]) -> Result<[usize; 2], TerrainError> {
    let sound =
        columns.iter().all(|count| *count >= 3.0) && columns[0] * columns[1] <= LARGEST_NUMBER_OF_COLUMNS as f64;
    if sound {
        return Ok(columns.map(|count| count as usize));
    }
    Err(TerrainError::Landform {
        key: "columns",
        found: format!("{} x {} columns", columns[0], columns[1]),
        expected: format!("at least 3 along each side, at most {LARGEST_NUMBER_OF_COLUMNS} together"),
    })
}

/// A winding valley that runs eastward through the middle of its landform.
struct Valley {
    middle: f64,
    swing: f64,
    /// Length of a meander (m).
    length: f64,
    half_floor: f64,
    /// Distance from the middle of the floor (m) at which the sides are at their full height.
    reach: f64,
    relief: f64,
}

impl Valley {
    fn new(landform: &Landform, across: f64) -> Self {
        let floor = landform.floor.unwrap_or(across / 3.0);
        Self {
            middle: 0.5 * across,
            swing: landform.meander * across,
            // Meanders are eleven channel widths long (Leopold and Wolman, River meanders, 1960).
            length: 11.0 * if floor > 0.0 { floor } else { across / 3.0 },
            half_floor: 0.5 * floor,
            reach: 0.5 * across,
            relief: landform.relief,
        }
    }

    /// Height over the floor (m) at x, z from the landform's north-western corner.
    fn side(&self, [x, z]: [f64; 2]) -> f64 {
        // Two waves whose lengths have no common measure: no bend is like another. Their shares keep the swing.
        let (slow, fast) = (TAU * x / (1.618_034 * self.length), TAU * x / self.length);
        let line = self.middle + self.swing * (0.7 * fast.sin() + 0.3 * slow.sin());
        let slope =
            self.swing * (0.7 * fast.cos() * TAU / self.length + 0.3 * slow.cos() * TAU / (1.618_034 * self.length));
        // Across the flow, not along z: the floor keeps its width in the bends.
        let distance = (z - line).abs() / (1.0 + slope * slope).sqrt();
        let rise = self.reach - self.half_floor;
        let t = if rise > 0.0 { ((distance - self.half_floor) / rise).clamp(0.0, 1.0) } else { 0.0 };
        self.relief * t * t * (3.0 - 2.0 * t)
    }
}

/// Lays octaves of noise over the ground, `rms` (m) strong together if there were no end to them.
///
/// The sum over all octaves sets the amplitude, so that it is the same at every resolution; with a gain of 0.5 the ones
/// that columns are too coarse for would add less than a hundredth after three. Wavelengths run from `size` (m) down to
/// two columns, a cell of the noise being half a wavelength.
fn add_detail(
    ground: &mut HeightMap,
    plan: [f64; 2],
    rms: f64,
    size: f64,
    gain: f64,
    seed: u32,
) -> Result<(), TerrainError> {
    let field = Field::new(0.5 * size, DVec3::new(plan[0], 0.0, plan[1]), seed);
    let [dx, dz] = ground.spacing;
    let octaves = field.octaves_down_to(dx.max(dz));
    if octaves == 0 {
        return Err(TerrainError::Landform {
            key: "detail_size",
            found: format!("detail of {size} m on columns of {dx} x {dz} m"),
            expected: "at least two columns, or simulation.terrain.detail = 0".to_owned(),
        });
    }
    let all: f64 = (0..Field::MOST).map(|octave| gain.powi(2 * octave as i32)).sum();
    let amplitude = rms / (PLAN_RMS * all.sqrt());
    ground.heights.par_chunks_exact_mut(ground.nx).enumerate().for_each(|(z, row)| {
        for (x, height) in row.iter_mut().enumerate() {
            let place = Vec3::new((x as f64 * dx) as f32, 0.0, (z as f64 * dz) as f32);
            *height += amplitude * f64::from(field.plan(place, 0.0, 0, octaves, gain as f32));
        }
    });
    Ok(())
}

/// Lowers what lies east of a ledge.
fn drop_at(ground: &mut HeightMap, ledge: &Ledge) {
    let ([x0, _], [dx, _]) = (ground.origin, ground.spacing);
    for row in ground.heights.chunks_exact_mut(ground.nx) {
        for (x, height) in row.iter_mut().enumerate() {
            let past = x0 + x as f64 * dx - ledge.at;
            let share = if past < ledge.run { past / ledge.run } else { 1.0 };
            *height -= ledge.drop * share.max(0.0);
        }
    }
}

#[cfg(test)]
mod tests;
