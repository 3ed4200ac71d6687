//! `[simulation]` → what a simulation starts from: ground, water, and who is held, poured and pressed when.
//!
//! Everything that depends on files or on the columns is settled and checked here, before the first step.

use std::path::{Path, PathBuf};

use crate::scene::Simulation;
use crate::state::{self, Model};
use crate::terrain::{HeightMap, Reading, land};

use super::regions::Region;
use super::{Grid, SimError};

/// A column that keeps its depth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Held {
    /// The column.
    pub column: usize,
    /// The depth that it keeps (m), at least 0.
    pub depth: f64,
    /// When it begins (s; frame 0 is at 0); `-inf` if it is always there.
    pub begin: f64,
    /// When it ends (s); `inf` if never.
    pub end: f64,
    /// Whether it is a sink: spray that falls in leaves.
    pub sink: bool,
}

/// Water that is poured on columns, the same on each.
#[derive(Clone, Debug, PartialEq)]
pub struct Inflow {
    /// The columns, at least one.
    pub columns: Vec<usize>,
    /// Water over all of them together (m3/s).
    pub rate: f64,
    /// When it begins (s); `-inf` if it is always there.
    pub begin: f64,
    /// When it ends (s); `inf` if never.
    pub end: f64,
}

/// External pressure on columns.
#[derive(Clone, Debug, PartialEq)]
pub struct Pressed {
    /// The columns, at least one.
    pub columns: Vec<usize>,
    /// Pressure above air's (Pa).
    pub pascal: f64,
    /// When it begins (s); `-inf` if it is always there.
    pub begin: f64,
    /// When it ends (s); `inf` if never.
    pub end: f64,
}

/// What a simulation starts from.
#[derive(Clone, Debug)]
pub struct Setup {
    /// Where the columns stand.
    pub grid: Grid,
    /// Height of the ground under each column (m).
    pub base: Vec<f64>,
    /// Depth of water at the start (m): the highest of what the scene asks for, at least 0.
    pub depth: Vec<f64>,
    /// Columns that keep their depth, sources in the scene's order, then sinks. Where several hold one column at one time,
    /// the last of them does; no source holds a sink's column, nor one whose ground is above the source's level.
    pub held: Vec<Held>,
    /// Water that is poured in; none of it on a sink's columns.
    pub inflows: Vec<Inflow>,
    /// Rain on every column (m/s).
    pub rain_rate: f64,
    /// When the rain ends (s); `inf` if never.
    pub rain_end: f64,
    /// External pressure.
    pub pressures: Vec<Pressed>,
    /// What spray bounces off besides the ground.
    pub solids: Model,
    /// The file that the solids came from.
    pub model_path: Option<PathBuf>,
}

/// Reads and resolves everything that `[simulation]` says of ground, water, sources, sinks, pressure and solids.
///
/// `directory` is where the scene's paths start.
///
/// # Errors
/// A file that cannot be read or does not fit; a region that covers no column; a setting that has no effect on the ground
/// that it meets. Each names its key.
pub fn prepare(settings: &Simulation, directory: &Path) -> Result<Setup, SimError> {
    let ground = land(&settings.terrain, directory, settings.seed)?;
    let HeightMap { nx, nz, spacing, origin, heights: base } = ground;
    let grid = Grid { nx, nz, width: spacing, origin };
    let depth = initial_depth(settings, directory, &grid, &base)?;

    let mut is_sink = vec![false; grid.count()];
    let mut sinks = Vec::new();
    for entry in settings.sink.iter().enumerate() {
        let (_, sink) = entry;
        let region = Region::from(entry);
        if sink.level.is_some() && sink.depth.is_some() {
            return Err(region.wrong("both level and depth", "one of them, or neither for no water at all"));
        }
        for column in region.columns(&grid)? {
            is_sink[column] = true;
            let depth = sink.level.map_or(sink.depth.unwrap_or(0.0), |level| (level - base[column]).max(0.0));
            sinks.push(Held { column, depth, begin: f64::NEG_INFINITY, end: f64::INFINITY, sink: true });
        }
    }

    let (mut held, mut inflows) = (Vec::new(), Vec::new());
    for entry in settings.source.iter().enumerate() {
        let (_, source) = entry;
        let region = Region::from(entry);
        let (begin, end) = span(&region, source.begin, source.end)?;
        let mut columns = region.columns(&grid)?;
        columns.retain(|column| !is_sink[*column]);
        if columns.is_empty() {
            return Err(region.wrong("every column of this source is a sink's", "a source beside the sinks"));
        }
        match (source.level, source.depth, source.discharge) {
            (Some(level), None, None) => {
                let lowest = columns.iter().map(|column| base[*column]).fold(f64::INFINITY, f64::min);
                if level <= lowest {
                    let found = format!(
                        "level {level} m, while the lowest ground of its {} columns is at {lowest} m",
                        columns.len()
                    );
                    return Err(region.wrong(found, "a level above some of its ground"));
                }
                // Banks above the level stay free: held dry, they would drink what washes over them.
                let wet = columns.into_iter().filter(|column| base[*column] < level);
                held.extend(wet.map(|column| Held { column, depth: level - base[column], begin, end, sink: false }));
            }
            (None, Some(depth), None) => {
                held.extend(columns.into_iter().map(|column| Held { column, depth, begin, end, sink: false }));
            }
            (None, None, Some(rate)) => inflows.push(Inflow { columns, rate, begin, end }),
            _ => return Err(region.wrong("a source", "exactly one of level, depth and discharge")),
        }
    }
    held.append(&mut sinks);

    let mut pressures = Vec::new();
    for entry in settings.pressure.iter().enumerate() {
        let region = Region::from(entry);
        let (begin, end) = span(&region, entry.1.begin, entry.1.end)?;
        pressures.push(Pressed { columns: region.columns(&grid)?, pascal: entry.1.pascal, begin, end });
    }

    let model_path = settings.model.as_ref().map(|model| directory.join(model));
    let solids = model_path.as_ref().map(state::read_model).transpose()?.unwrap_or_default();
    Ok(Setup {
        grid,
        base,
        depth,
        held,
        inflows,
        // Millimetres per hour.
        rain_rate: settings.water.rain / 3.6e6,
        rain_end: settings.water.rain_end.unwrap_or(f64::INFINITY),
        pressures,
        solids,
        model_path,
    })
}

/// When something begins and ends.
fn span(region: &Region, begin: Option<f64>, end: Option<f64>) -> Result<(f64, f64), SimError> {
    let (begin, end) = (begin.unwrap_or(f64::NEG_INFINITY), end.unwrap_or(f64::INFINITY));
    if begin < end {
        Ok((begin, end))
    } else {
        Err(region.wrong(format!("begin {begin} s, end {end} s"), "an end after the beginning"))
    }
}

/// The highest water that the scene asks for in each column.
fn initial_depth(settings: &Simulation, directory: &Path, grid: &Grid, base: &[f64]) -> Result<Vec<f64>, SimError> {
    let water = &settings.water;
    let mut depth = vec![water.depth.unwrap_or(0.0); grid.count()];
    let fill = |depth: &mut f64, base: f64, level: f64| *depth = depth.max(level - base);
    if let Some(level) = water.level {
        depth.iter_mut().zip(base).for_each(|(depth, base)| fill(depth, *base, level));
    }
    if let Some(file) = &water.depth_map {
        let reading = Reading { crop: None, spacing: Some(grid.width), heights: water.depths };
        let map = HeightMap::read(&directory.join(file), &reading)?;
        let wrong = |found: String, expected: String| SimError::Setting {
            key: "simulation.water.depth_map".to_owned(),
            found: format!("{file}: {found}"),
            expected,
        };
        if [map.nx, map.nz] != [grid.nx, grid.nz] {
            let expected = format!("as many as columns, {} x {}", grid.nx, grid.nz);
            return Err(wrong(format!("{} x {} samples", map.nx, map.nz), expected));
        }
        if let Some(first) = map.heights.iter().position(|depth| *depth < 0.0) {
            let found =
                format!("a depth of {} m in column {}, row {}", map.heights[first], first % grid.nx, first / grid.nx);
            return Err(wrong(found, "depths of at least 0".to_owned()));
        }
        depth.iter_mut().zip(&map.heights).for_each(|(depth, mapped)| *depth = depth.max(*mapped));
    }
    for entry in water.body.iter().enumerate() {
        let (_, body) = entry;
        let region = Region::from(entry);
        let columns = region.columns(grid)?;
        for column in columns {
            match (body.level, body.depth) {
                (Some(level), None) => fill(&mut depth[column], base[column], level),
                (None, Some(body)) => depth[column] = depth[column].max(body),
                _ => return Err(region.wrong("a body of water", "exactly one of level and depth")),
            }
        }
    }
    Ok(depth)
}

#[cfg(test)]
mod tests;
