//! A file's density → a grid at a moment: the file's own voxels, or, where it has velocities, what they have moved there.
//!
//! The voxels stay where the file puts them (turned, stretched), and bricks are its leaves with their neighbours' first
//! layers: so nothing is resampled, a line through the grid has the optical depth of the file's own linear interpolation, and
//! the sum of density times volume is the file's.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::{DMat3, DVec3, IVec3, Vec3};
use rayon::prelude::*;

use super::{
    DENSEST,
    bricks::{BRICK_BYTES, Bricks, CORNERS, SIDE, VALUES},
    grid::Grid,
    vdb::{self, CELL, Cell, Contents, Velocity},
};
use crate::scene::{self, UpAxis};

/// Bytes of a brick's velocities.
const VELOCITY_BYTES: u64 = (VALUES * size_of::<Vec3>()) as u64;

/// Times that a place is looked for from which a velocity leads to a corner. Each leaves the share of the error by which
/// velocities differ over their own way, a few tenths in a shutter's time at most where they are smooth on the grid: four leave
/// thousandths of a voxel.
const STEPS: usize = 4;

/// Why a file's mist cannot be had.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum VolumeError {
    /// The file cannot be read.
    #[error("{path}: {told}; expected an OpenVDB file (mist.file) of format 220 to 225", path = path.display())]
    Broken {
        /// The file.
        path: PathBuf,
        /// What its reader says.
        told: String,
    },
    /// It has no such grid.
    #[error("{path} has no grid `{name}` ({key}); expected one of {there}", path = path.display())]
    NoGrid {
        /// The file.
        path: PathBuf,
        /// The key that names the grid.
        key: &'static str,
        /// The grid.
        name: String,
        /// Those that there are.
        there: String,
    },
    /// The grid is of another kind.
    #[error("{path}: the grid `{name}` ({key}) holds {found}; expected {expected}", path = path.display())]
    WrongType {
        /// The file.
        path: PathBuf,
        /// The key that names the grid.
        key: &'static str,
        /// The grid.
        name: String,
        /// What it holds.
        found: String,
        /// What it should hold.
        expected: String,
    },
    /// Something in the grid is no mist's.
    #[error("{path}: the grid `{grid}`: {place} is {value}; expected {expected}", path = path.display())]
    Wrong {
        /// The file.
        path: PathBuf,
        /// The grid.
        grid: String,
        /// Where in it.
        place: String,
        /// What is there.
        value: String,
        /// What should be.
        expected: &'static str,
    },
    /// It takes more than a mist may.
    #[error("{path}: its mist takes at least {bytes} bytes; expected at most {budget} bytes", path = path.display())]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// Bytes needed at least.
        bytes: u64,
        /// Bytes that it may take.
        budget: u64,
    },
    /// Light would not get anywhere in it.
    #[error(
        "{path}: the extinction of its mist reaches {extinction:e} 1/m; expected at most {DENSEST:e} 1/m: lower \
         mist.extinction",
        path = path.display()
    )]
    TooDense {
        /// The file.
        path: PathBuf,
        /// The greatest extinction (1/m).
        extinction: f32,
    },
}

/// The mist that a file holds.
#[derive(Debug)]
pub struct Volume {
    path: PathBuf,
    still: Arc<Bricks>,
    /// Velocity (m/s) at the bricks' corners; empty where nothing moves.
    velocity: Vec<Vec3>,
    /// Their mean by what stops light there: the whole moves with it, voxels and all.
    drift: Vec3,
    /// A voxel's steps along the grid's axes in the files' frame (m), and where the voxel at 0 lies.
    axes: DMat3,
    start: DVec3,
}

impl Volume {
    /// Reads a frame's file.
    ///
    /// # Errors
    /// See [`VolumeError`].
    pub fn read(path: &Path, settings: &scene::Mist) -> Result<Self, VolumeError> {
        Self::of(vdb::read(path, settings, super::BUDGET)?, path, settings)
    }

    pub(super) fn of(contents: Contents, path: &Path, settings: &scene::Mist) -> Result<Self, VolumeError> {
        let Contents { mut cells, axes, start, velocity } = contents;
        let upright = match settings.up {
            UpAxis::Y => DMat3::IDENTITY,
            UpAxis::Z => DMat3::from_cols(DVec3::X, DVec3::NEG_Z, DVec3::Y),
        };
        // Around the volume's middle, so that single precision holds its voxels wherever the file has put them.
        let low = cells.iter().fold(IVec3::MAX, |low, (place, _)| low.min(*place));
        let high = cells.iter().fold(IVec3::MIN, |high, (place, _)| high.max(*place));
        let middle = if cells.is_empty() { IVec3::ZERO } else { (low + high) / 2 };
        for (place, _) in &mut cells {
            *place -= middle;
        }
        let start = start + axes * (middle * SIDE).as_dvec3();
        let mut volume = Self {
            path: path.into(),
            still: Arc::default(),
            velocity: Vec::new(),
            drift: Vec3::ZERO,
            axes: upright * axes,
            start: upright * start,
        };
        let (place, values) = volume.joined(cells, super::BUDGET)?;
        let greatest = values.iter().copied().fold(0.0, f32::max);
        if !(f64::from(greatest) <= DENSEST) {
            return Err(VolumeError::TooDense { path: path.into(), extinction: greatest });
        }
        let mut means = vec![Vec3::ZERO; place.len()];
        if let Some(velocity) = velocity.filter(|_| settings.velocity_scale != 0.0) {
            let bytes = place.len() as u64 * (BRICK_BYTES + VELOCITY_BYTES);
            if bytes > super::BUDGET {
                return Err(VolumeError::TooLarge { path: path.into(), bytes, budget: super::BUDGET });
            }
            volume.velocity = vec![Vec3::ZERO; values.len()];
            let turn = settings.velocity_scale * upright;
            let to_file = |corner: IVec3| axes * corner.as_dvec3() + start;
            let bricks = volume.velocity.par_chunks_exact_mut(VALUES).zip(values.par_chunks_exact(VALUES));
            bricks.zip(&mut means).zip(&place).for_each(|(((velocities, values), mean), place)| {
                *mean = sampled(velocities, values, *place * SIDE, &velocity, to_file, turn);
            });
            let (mut sum, mut all) = (DVec3::ZERO, 0.0);
            for (velocity, value) in volume.velocity.iter().zip(&values) {
                sum += f64::from(*value) * velocity.as_dvec3();
                all += f64::from(*value);
            }
            volume.drift = if all > 0.0 { (sum / all).as_vec3() } else { Vec3::ZERO };
        }
        volume.still = Arc::new(Bricks::new(place, values, means));
        Ok(volume)
    }

    /// Bytes that it takes with the grids of so many moments.
    pub fn held(&self, moments: u64) -> u64 {
        let moved = if self.velocity.is_empty() { 0 } else { moments };
        self.still.bytes() * (1 + moved) + size_of_val(self.velocity.as_slice()) as u64
    }

    /// The grid around a scene's origin (files' frame, m), `seconds` after the file's time; of at most `budget` bytes.
    ///
    /// # Errors
    /// [`VolumeError::TooLarge`] where its velocities spread it.
    pub fn at(&self, seconds: f64, origin: DVec3, budget: u64) -> Result<Grid, VolumeError> {
        let bricks = if self.velocity.is_empty() || seconds == 0.0 {
            Arc::clone(&self.still)
        } else {
            Arc::new(self.moved(seconds, budget)?)
        };
        let inverse = self.axes.inverse();
        let start = self.start + seconds * self.drift.as_dvec3();
        Ok(Grid::affine(inverse, inverse * (origin - start), bricks))
    }

    /// What the velocities make of it in some seconds, as seen from what drifts with their mean: each corner gets what was where
    /// they lead from (J. Stam, Stable fluids, 1999). Of a cloud that moves as one nothing is resampled.
    ///
    /// The sum stays as far as the velocities have no divergence, as those of water and air at such speeds have not.
    fn moved(&self, seconds: f64, budget: u64) -> Result<Bricks, VolumeError> {
        // Voxels of way to a metre per second.
        let way = (self.axes.inverse() * seconds).as_mat3();
        let still = &*self.still;
        // Bricks that any corner of another may get to, with the mean velocity of those: where there was no mist before there
        // is no velocity, either.
        let mut reached = HashMap::<[i32; 3], (Vec3, f32)>::new();
        for (brick, &place) in still.places().iter().enumerate() {
            let own = &self.velocity[brick * VALUES..(brick + 1) * VALUES];
            let (mut least, mut most) = (Vec3::ZERO, Vec3::ZERO);
            for velocity in own {
                let way = way * (*velocity - self.drift);
                (least, most) = (least.min(way), most.max(way));
            }
            let first = (place.as_dvec3() + (least.as_dvec3() - 1.0) / f64::from(SIDE)).floor();
            let last = (place.as_dvec3() + 1.0 + (most.as_dvec3() + 1.0) / f64::from(SIDE)).floor();
            let count = (last - first + 1.0).element_product() + reached.len() as f64;
            let most = (budget / BRICK_BYTES) as f64;
            // As many times over: each lies in the reach of 27 and more.
            if !(count < 8.0 * most && last.abs().max_element() < 1e8 && first.abs().max_element() < 1e8) {
                return Err(self.too_large(count, budget));
            }
            let (first, last) = (first.as_ivec3(), last.as_ivec3());
            let weight = still.most(brick as u32);
            for (z, y) in (first.z..=last.z).flat_map(|z| (first.y..=last.y).map(move |y| (z, y))) {
                for x in first.x..=last.x {
                    let (momentum, amount) = reached.entry([z, y, x]).or_default();
                    *momentum += weight * still.velocity(brick as u32);
                    *amount += weight;
                }
            }
        }
        let mut reached: Vec<_> = reached.into_iter().collect();
        reached.par_sort_unstable_by_key(|(place, _)| *place);
        let cells: Vec<(Cell, Vec3)> = reached
            .par_iter()
            .filter_map(|&([z, y, x], (momentum, amount))| {
                let place = IVec3::new(x, y, z);
                let (mut values, mut sum, mut all) = ([0.0; CELL], Vec3::ZERO, 0.0);
                for (index, value) in values.iter_mut().enumerate() {
                    let corner = (place * SIDE + of_cell(index)).as_vec3();
                    let mut velocity = momentum / amount;
                    let mut from = corner - way * (velocity - self.drift);
                    for _ in 0..STEPS {
                        let Some(brick) = still.find(from) else { break };
                        velocity = still.between(&self.velocity, brick, from);
                        from = corner - way * (velocity - self.drift);
                    }
                    *value = still.find(from).map_or(0.0, |brick| still.value(brick, from));
                    sum += *value * velocity;
                    all += *value;
                }
                (all > 0.0).then(|| ((place, values), sum / all))
            })
            .collect();
        let means: HashMap<IVec3, Vec3> = cells.iter().map(|((place, _), mean)| (*place, *mean)).collect();
        let (place, values) = self.joined(cells.into_iter().map(|(cell, _)| cell).collect(), budget)?;
        // A brick that has only its far sides has what is there of the next one.
        let mean =
            |place: &IVec3| (0..8).find_map(|next| means.get(&(*place + aside(next)))).copied().unwrap_or_default();
        let velocity = place.iter().map(mean).collect();
        Ok(Bricks::new(place, values, velocity))
    }

    fn too_large(&self, bricks: f64, budget: u64) -> VolumeError {
        VolumeError::TooLarge { path: self.path.clone(), bytes: (bricks * BRICK_BYTES as f64) as u64, budget }
    }

    /// Cells → bricks in order: each has its cell's values, and the next cells' first layers on its far sides.
    fn joined(&self, cells: Vec<Cell>, budget: u64) -> Result<(Vec<IVec3>, Vec<f32>), VolumeError> {
        let mut place: Vec<[i32; 3]> = cells
            .par_iter()
            .flat_map_iter(|(place, values)| {
                // By which near sides a value lies on: 1 for x, 2 for y, 4 for z.
                let mut sides = [false; 8];
                for (index, _) in values.iter().enumerate().filter(|(_, value)| **value > 0.0) {
                    let corner = of_cell(index);
                    sides[(0..3).map(|axis| usize::from(corner[axis] == 0) << axis).sum::<usize>()] = true;
                }
                let needed = move |before: usize| (0..8).any(|side| sides[side] && side & before == before);
                let before = (0..8).filter(move |&before| needed(before)).map(|before| *place - aside(before));
                before.map(|IVec3 { x, y, z }| [z, y, x])
            })
            .collect();
        place.par_sort_unstable();
        place.dedup();
        if place.len() as u64 * BRICK_BYTES > budget {
            return Err(self.too_large(place.len() as f64, budget));
        }
        let place: Vec<IVec3> = place.into_iter().map(|[z, y, x]| IVec3::new(x, y, z)).collect();
        let known: HashMap<IVec3, usize> =
            cells.iter().enumerate().map(|(index, (place, _))| (*place, index)).collect();
        let mut values = vec![0.0; place.len() * VALUES];
        values.par_chunks_exact_mut(VALUES).zip(&place).for_each(|(values, place)| {
            let near: [Option<&Cell>; 8] =
                std::array::from_fn(|next| known.get(&(*place + aside(next))).map(|&index| &cells[index]));
            for (index, value) in values.iter_mut().enumerate() {
                let corner = of_brick(index);
                let next: usize = (0..3).map(|axis| usize::from(corner[axis] == SIDE) << axis).sum();
                if let Some((_, cell)) = near[next] {
                    let within = corner & (SIDE - 1);
                    *value = cell[((within.z * SIDE + within.y) * SIDE + within.x) as usize];
                }
            }
        });
        Ok((place, values))
    }
}

/// One of eight neighbours: 1 for x, 2 for y, 4 for z.
fn aside(next: usize) -> IVec3 {
    IVec3::new(next as i32 & 1, next as i32 >> 1 & 1, next as i32 >> 2)
}

/// The corner of a cell's value.
fn of_cell(index: usize) -> IVec3 {
    let index = index as i32;
    IVec3::new(index % SIDE, index / SIDE % SIDE, index / (SIDE * SIDE))
}

/// The corner of a brick's value.
fn of_brick(index: usize) -> IVec3 {
    let at = |step: usize| (index / step % CORNERS) as i32;
    IVec3::new(at(1), at(CORNERS), at(CORNERS * CORNERS))
}

/// Fills in a brick's velocities, each turned; their mean by what stops light there. What has none moves as that.
fn sampled(
    velocities: &mut [Vec3],
    values: &[f32],
    first: IVec3,
    velocity: &Velocity,
    to_file: impl Fn(IVec3) -> DVec3,
    turn: DMat3,
) -> Vec3 {
    let sampler = velocity.sampler();
    let (mut sum, mut all) = (DVec3::ZERO, 0.0);
    let mut without = Vec::new();
    for (index, (velocity, value)) in velocities.iter_mut().zip(values).enumerate() {
        match sampler(to_file(first + of_brick(index))) {
            Some(found) => {
                let found = turn * found;
                *velocity = found.as_vec3();
                sum += f64::from(*value) * found;
                all += f64::from(*value);
            }
            None => without.push(index),
        }
    }
    let mean = if all > 0.0 { (sum / all).as_vec3() } else { Vec3::ZERO };
    for index in without {
        velocities[index] = mean;
    }
    mean
}
