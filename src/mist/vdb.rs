//! OpenVDB files: density and velocity as one of them holds them, checked value by value.
//!
//! The file's form is the library's; what is asked of a grid before it may be mist is said here. A broken file is told of,
//! whatever it makes of the library.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

use glam::{DMat3, DVec3, IVec3};
use openvdb::io::{File, GridDescriptor};
use openvdb::math::Vec3 as Triple;
use openvdb::tree::{Node, Tree};
use openvdb::{AnyGrid, Coord, Grid, Transform, Value, Vec3DGrid, Vec3SGrid};

use super::bricks::{BRICK_BYTES, SIDE};
use super::volume::VolumeError;
use crate::scene;

/// Values of a cell: a leaf's 8x8x8 voxels.
pub(super) const CELL: usize = (SIDE * SIDE * SIDE) as usize;

/// A leaf's place (in leaves) and values, x fastest.
pub(super) type Cell = (IVec3, [f32; CELL]);

/// Names of grids of velocity, the first that a file has counts.
const VELOCITIES: [&str; 3] = ["velocity", "vel", "v"];

/// What a file holds of a mist.
#[derive(Debug)]
pub(super) struct Contents {
    /// Extinction (1/m) of its voxels, at whole coordinates.
    pub(super) cells: Vec<Cell>,
    /// Where voxels lie along the file's axes: (m) of one step along each, and of the zeroth.
    pub(super) axes: DMat3,
    pub(super) start: DVec3,
    /// How they move, if the file says.
    pub(super) velocity: Option<Velocity>,
}

/// A grid of velocities (m/s along the file's axes), before the scene's factor.
#[derive(Debug)]
pub(super) enum Velocity {
    Single(Vec3SGrid),
    Double(Vec3DGrid),
}

impl Velocity {
    /// What asks it for the velocity at a point (m): linear between voxels that have one; `None` where none has.
    pub(super) fn sampler(&self) -> Box<dyn Fn(DVec3) -> Option<DVec3> + '_> {
        match self {
            Self::Single(grid) => sampler(grid),
            Self::Double(grid) => sampler(grid),
        }
    }
}

fn sampler<T: Value + Into<f64>>(grid: &Grid<Triple<T>>) -> Box<dyn Fn(DVec3) -> Option<DVec3> + '_> {
    let values = grid.accessor();
    Box::new(move |point| {
        let place = DVec3::from_array(grid.world_to_index(Triple(point.to_array())).0);
        let low = place.floor();
        let share = place - low;
        let (mut sum, mut all) = (DVec3::ZERO, 0.0);
        for corner in 0..8 {
            let aside = IVec3::new(corner & 1, corner >> 1 & 1, corner >> 2);
            let weight: f64 =
                (0..3).map(|axis| if aside[axis] == 1 { share[axis] } else { 1.0 - share[axis] }).product();
            if weight > 0.0 {
                let (value, active) = values.probe_value(&Coord((low.as_ivec3().saturating_add(aside)).to_array()));
                if active {
                    sum += weight * DVec3::from_array(value.0.map(Into::into));
                    all += weight;
                }
            }
        }
        (all > 0.0).then(|| sum / all)
    })
}

/// Reads a file's mist of at most `budget` bytes.
pub(super) fn read(path: &Path, settings: &scene::Mist, budget: u64) -> Result<Contents, VolumeError> {
    let broken = |told: String| VolumeError::Broken { path: path.into(), told };
    // Read before anything is made of it: a file that does not fit cannot become what fits.
    let bytes = std::fs::metadata(path).map_err(|error| broken(error.to_string()))?.len();
    if bytes > budget {
        return Err(VolumeError::TooLarge { path: path.into(), bytes, budget });
    }
    // The library may trust a number of a broken file that it should not: arithmetic is checked by the language then.
    let read = catch_unwind(AssertUnwindSafe(|| Reader { path, settings, budget }.read()));
    read.unwrap_or_else(|_| Err(broken("its numbers contradict each other".into())))
}

struct Reader<'a> {
    path: &'a Path,
    settings: &'a scene::Mist,
    budget: u64,
}

impl Reader<'_> {
    fn read(&self) -> Result<Contents, VolumeError> {
        let file = File::open(self.path).map_err(|error| self.broken(&error))?;
        let name = self.settings.grid.as_str();
        let (axes, start, cells) = match self.grid(&file, "mist.grid", name, &["float", "double"])? {
            AnyGrid::Float(grid) => self.density(name, &grid)?,
            AnyGrid::Double(grid) => self.density(name, &grid)?,
            other => return Err(self.broken(&format!("its grid `{name}` became {}", other.grid_type()))),
        };
        Ok(Contents { cells, axes, start, velocity: self.velocity(&file)? })
    }

    fn broken(&self, told: &dyn ToString) -> VolumeError {
        VolumeError::Broken { path: self.path.into(), told: told.to_string() }
    }

    fn wrong(&self, grid: &str, place: impl Into<String>, value: impl ToString, expected: &'static str) -> VolumeError {
        let (grid, value) = (grid.to_owned(), value.to_string());
        VolumeError::Wrong { path: self.path.into(), grid, place: place.into(), value, expected }
    }

    /// The grid that a key names, of one of some types.
    fn grid(&self, file: &File, key: &'static str, name: &str, types: &[&str]) -> Result<AnyGrid, VolumeError> {
        let grids = file.descriptors();
        let Some(found) = grids.iter().find(|grid| grid.unique_name == name || grid.grid_name == name) else {
            let there: Vec<_> =
                grids.iter().map(|grid| format!("`{}` ({})", grid.display_name(), kind(grid))).collect();
            let there = if there.is_empty() { "a file that has any".to_owned() } else { there.join(", ") };
            return Err(VolumeError::NoGrid { path: self.path.into(), key, name: name.to_owned(), there });
        };
        if !types.contains(&kind(found)) {
            let (name, expected) = (name.to_owned(), types.join(" or "));
            let found = kind(found).to_owned();
            return Err(VolumeError::WrongType { path: self.path.into(), key, name, found, expected });
        }
        // Asked for before the values, which the library does not read under a transform that it does not know.
        let head = file.read_grid_metadata(name).map_err(|error| self.broken(&error))?;
        if !head.transform.is_some_and(|transform| transform.is_linear()) {
            let expected = "a linear one: translation, scale, rotation, shear";
            return Err(self.wrong(name, "its transform", head.map_type, expected));
        }
        file.read_grid(name).map_err(|error| self.broken(&error))
    }

    fn density<T: Value + Into<f64>>(
        &self,
        name: &str,
        grid: &Grid<T>,
    ) -> Result<(DMat3, DVec3, Vec<Cell>), VolumeError> {
        let background: f64 = (*grid.background()).into();
        if background != 0.0 {
            let expected = "0: beyond its voxels there is no mist (a level set is none)";
            return Err(self.wrong(name, "its background", background, expected));
        }
        let (axes, start) = self.placing(name, grid.transform())?;
        Ok((axes, start, self.cells(name, grid.tree())?))
    }

    /// Where voxels lie.
    fn placing(&self, name: &str, transform: &Transform) -> Result<(DMat3, DVec3), VolumeError> {
        let map = |x, y, z| DVec3::from_array(transform.index_to_world(Triple([x, y, z])).0);
        let along = |x, y, z| DVec3::from_array(transform.map().apply_jacobian(Triple([x, y, z])).0);
        let axes = DMat3::from_cols(along(1.0, 0.0, 0.0), along(0.0, 1.0, 0.0), along(0.0, 0.0, 1.0));
        let start = map(0.0, 0.0, 0.0);
        // Single precision holds what is left of it in the local frame.
        let sound = axes.as_mat3().is_finite() && axes.inverse().as_mat3().is_finite() && start.is_finite();
        if !sound || axes.determinant() == 0.0 {
            return Err(self.wrong(name, "its transform", axes, "one whose voxels have a volume"));
        }
        Ok((axes, start))
    }

    /// Extinction (1/m) of the voxels that are active, leaf by leaf; tiles become as many leaves as they cover.
    fn cells<T: Value + Into<f64>>(&self, name: &str, tree: &Tree<T>) -> Result<Vec<Cell>, VolumeError> {
        let most = (self.budget / BRICK_BYTES) as usize;
        let too_large = |count: usize| VolumeError::TooLarge {
            path: self.path.into(),
            bytes: count as u64 * BRICK_BYTES,
            budget: self.budget,
        };
        let extinction = |at: Coord, value: T| {
            let value: f64 = value.into();
            // Not a number is not at least 0, either.
            if value >= 0.0 && value.is_finite() {
                Ok((value * self.settings.extinction) as f32)
            } else {
                Err(self.wrong(name, format!("its voxel {:?}", at.0), value, "a density of 0 or more"))
            }
        };
        let mut cells = Vec::new();
        for leaf in tree.leaves() {
            let mut values = [0.0; CELL];
            for n in leaf.value_mask().iter_on() {
                let value = extinction(leaf.offset_to_global_coord(n), *leaf.get_value_at(n))?;
                // The library's leaves have z fastest.
                values[(n >> 6) | (n & 0o70) | (n & 7) << 6] = value;
            }
            if values.iter().any(|value| *value > 0.0) {
                cells.push((IVec3::from_array(leaf.origin().0) >> 3, values));
            }
            if cells.len() > most {
                return Err(too_large(cells.len()));
            }
        }
        let mut tiles = Vec::new();
        tree.visit_tiles(&mut |within, value, active, _| {
            if active && (*value).into() != 0.0 {
                tiles.push((within.min, within.max, *value));
            }
        });
        for (low, high, value) in tiles {
            let values = [extinction(low, value)?; CELL];
            let [low, high]: [IVec3; 2] = [low, high].map(|corner| IVec3::from_array(corner.0) >> 3);
            let count = (high - low + IVec3::ONE).as_i64vec3().element_product() as usize;
            if cells.len() + count > most {
                return Err(too_large(cells.len() + count));
            }
            for (z, y) in (low.z..=high.z).flat_map(|z| (low.y..=high.y).map(move |y| (z, y))) {
                cells.extend((low.x..=high.x).map(|x| (IVec3::new(x, y, z), values)));
            }
        }
        Ok(cells)
    }

    fn velocity(&self, file: &File) -> Result<Option<Velocity>, VolumeError> {
        let vector = ["vec3s", "vec3d"];
        let fits = |name: &str| {
            let mut grids = file.descriptors().iter();
            grids.any(|grid| grid.grid_name == name && vector.contains(&kind(grid)))
        };
        let by_default = || VELOCITIES.into_iter().find(|name| fits(name));
        let Some(name) = self.settings.velocity.as_deref().or_else(by_default) else { return Ok(None) };
        Ok(Some(match self.grid(file, "mist.velocity", name, &vector)? {
            AnyGrid::Vec3S(grid) => {
                self.all_finite(name, &grid)?;
                Velocity::Single(grid)
            }
            AnyGrid::Vec3D(grid) => {
                self.all_finite(name, &grid)?;
                Velocity::Double(grid)
            }
            other => return Err(self.broken(&format!("its grid `{name}` became {}", other.grid_type()))),
        }))
    }

    fn all_finite<T: Value + Into<f64>>(&self, name: &str, grid: &Grid<Triple<T>>) -> Result<(), VolumeError> {
        self.placing(name, grid.transform())?;
        // Within single precision, in which they go on.
        let finite = |at: Coord, value: &Triple<T>| {
            let value = DVec3::from_array(value.0.map(Into::into));
            if (value * self.settings.velocity_scale).as_vec3().is_finite() {
                return Ok(());
            }
            Err(self.wrong(name, format!("its voxel {:?}", at.0), value, "three finite numbers"))
        };
        for leaf in grid.tree().leaves() {
            for n in leaf.value_mask().iter_on() {
                finite(leaf.offset_to_global_coord(n), leaf.get_value_at(n))?;
            }
        }
        let mut told = Ok(());
        grid.tree().visit_tiles(&mut |within, value, active, _| {
            if active && told.is_ok() {
                told = finite(within.min, value);
            }
        });
        told
    }
}

/// The type of a grid's values.
fn kind(grid: &GridDescriptor) -> &str {
    grid.value_type().unwrap_or(&grid.grid_type)
}
