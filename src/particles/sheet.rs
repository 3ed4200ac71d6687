//! One closed surface around drops that are close together (the report's "surfaces around close particles").
//!
//! Densities of smoothed particles, marching cubes where they reach a share of water's, then smoothing: crate
//! `splashsurf_lib` (F. Löschner et al., Weighted Laplacian smoothing for surface reconstruction of particle-based fluids,
//! 2023). A drop that is in the sheet by a share of itself adds that share of its water, so that a sheet thins out and is
//! gone before its last drop is: nothing pops. What the surface is made of is not here.

use glam::Vec3;
use splashsurf_lib::nalgebra::Vector3;
use splashsurf_lib::{
    DensityMap, density_map, grid_for_reconstruction, marching_cubes,
    mesh::{Mesh3d, TriMesh3d},
    neighborhood_search, postprocessing,
};

use crate::scene;

/// A triangle mesh in the local frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Sheet {
    /// Vertices (m).
    pub position: Vec<Vec3>,
    /// Unit normals per vertex, outward.
    pub normal: Vec<Vec3>,
    /// Vertices of each triangle, counter-clockwise seen from outside.
    pub index: Vec<[u32; 3]>,
}

/// Why particles cannot be joined.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SheetError {
    /// The grid cannot be numbered, or something in it is no number.
    #[error(
        "particles.sheet: {count} drops of {radius:e} m over {extent:e} m cannot be joined ({reason}); expected a grid that \
         fits: a greater particles.sheet.resolution, or another particles.representation"
    )]
    Grid {
        /// Drops.
        count: usize,
        /// Their mean radius (m).
        radius: f32,
        /// Width of the box around them (m).
        extent: f32,
        /// What was wrong.
        reason: String,
    },
}

/// Cells of the surface's grid along the box around all particles: what single precision can number to a thousandth of a
/// cell.
const MOST_CELLS: f32 = 16_384.0;

/// Joins particles (m, local frame), each taken for a drop of the given radius (m), of which a share (0..1, more than 0) is
/// in the sheet. No shares: all of it.
///
/// The same to the bit at any count of threads: what is summed is summed by one.
///
/// # Errors
/// [`SheetError::Grid`].
pub fn sheet(position: &[Vec3], share: &[f32], radius: f32, settings: &scene::Sheet) -> Result<Sheet, SheetError> {
    if position.is_empty() {
        return Ok(Sheet::default());
    }
    let (low, high) = position.iter().fold((position[0], position[0]), |(low, high), &p| (low.min(p), high.max(p)));
    let extent = (high - low).max_element();
    let refuse = |reason: String| SheetError::Grid { count: position.len(), radius, extent, reason };
    let cell = radius * settings.resolution as f32;
    if !(cell > 0.0 && extent / cell <= MOST_CELLS) {
        return Err(refuse(format!("{:.0} cells along it, at most {MOST_CELLS}", extent / cell)));
    }
    // Around the middle, where coordinates keep their digits.
    let middle = 0.5 * (low + high);
    let kept = apart(position, low, 0.5 * radius);
    let places: Vec<Vector3<f32>> =
        kept.iter().map(|&index| Vector3::from((position[index as usize] - middle).to_array())).collect();
    let reach = radius * settings.reach as f32;
    let grid = grid_for_reconstruction::<i64, f32>(&places, radius, reach, cell, None, false)
        .map_err(|error| refuse(std::error::Error::source(&error).map_or(error.to_string(), ToString::to_string)))?;
    // By one thread: the order of neighbours is the order of their sum.
    let mut around = Vec::new();
    neighborhood_search::search_inplace::<i64, f32>(grid.aabb(), &places, reach, false, &mut around);
    // The crate's own measure of a drop: a cube of water as wide, of density 1, since mass is only ever divided by density.
    let mass = (2.0 * radius).powi(3);
    let mut dense = density_map::compute_particle_densities::<i64, f32>(&places, &around, reach, mass, true);
    if !share.is_empty() {
        // A drop's volume is its mass by its density.
        for (dense, &index) in dense.iter_mut().zip(&kept) {
            *dense /= share[index as usize];
        }
    }
    let mut map = DensityMap::default();
    density_map::generate_sparse_density_map(&grid, &places, &dense, None, mass, reach, cell, false, &mut map)
        .map_err(|error| refuse(error.to_string()))?;
    let mut mesh = marching_cubes::triangulate_density_map(&grid, &map, settings.threshold as f32)
        .map_err(|error| refuse(error.to_string()))?;
    smooth(&mut mesh, settings.smoothing as usize);
    let normal = mesh.vertex_normals();
    Ok(Sheet {
        position: mesh.vertices.iter().map(|p| Vec3::from_array((*p).into()) + middle).collect(),
        normal: normal.iter().map(|n| Vec3::from_array(n.into_inner().into()).normalize_or(Vec3::Y)).collect(),
        index: mesh.triangles.iter().map(|triangle| triangle.map(|vertex| vertex as u32)).collect(),
    })
}

/// Numbers of particles, one of each cell of a grid from `low` on: those in one place add nothing to the surface, and a
/// crowd of them would each have all others for neighbours.
fn apart(position: &[Vec3], low: Vec3, width: f32) -> Vec<u32> {
    let cell = |p: Vec3| ((p - low) / width).as_ivec3().to_array();
    let mut cells: Vec<([i32; 3], u32)> = (0..).zip(position).map(|(index, &p)| (cell(p), index)).collect();
    cells.sort_unstable();
    cells.dedup_by_key(|(cell, _)| *cell);
    let mut kept: Vec<u32> = cells.into_iter().map(|(_, index)| index).collect();
    // In the order of the file, whatever the order of cells is.
    kept.sort_unstable();
    kept
}

/// Takes away the grid's steps.
fn smooth(mesh: &mut TriMesh3d<f32>, times: usize) {
    if times == 0 || mesh.vertices.is_empty() {
        return;
    }
    let around = mesh.vertex_vertex_connectivity();
    let weights = vec![1.0; mesh.vertices.len()];
    postprocessing::par_laplacian_smoothing_inplace(mesh, &around, times, 1.0, &weights);
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A ball of drops on a grid of their own volumes.
    fn ball(size: f32, radius: f32) -> Vec<Vec3> {
        let step = radius * (4.0 / 3.0 * std::f32::consts::PI).cbrt();
        let count = (size / step) as i32 + 1;
        let line = -count..=count;
        let mut places = Vec::new();
        for x in line.clone() {
            for y in line.clone() {
                for z in line.clone() {
                    let place = step * Vec3::new(x as f32, y as f32, z as f32);
                    if place.length() <= size {
                        places.push(place);
                    }
                }
            }
        }
        places
    }

    #[test]
    fn a_ball_of_drops_is_a_closed_ball_of_water() {
        let radius = 0.02;
        let shift = Vec3::new(10.0, -3.0, 7.0);
        let drops: Vec<Vec3> = ball(0.3, radius).into_iter().map(|p| p + shift).collect();
        let sheet = sheet(&drops, &[], radius, &scene::Sheet::default()).unwrap();
        // Volume by the divergence theorem: closed, and outward.
        let volume: f32 = sheet
            .index
            .iter()
            .map(|corners| {
                let [a, b, c] = corners.map(|corner| sheet.position[corner as usize] - shift);
                a.dot(b.cross(c)) / 6.0
            })
            .sum();
        let expected = drops.len() as f32 * 4.0 / 3.0 * std::f32::consts::PI * radius.powi(3);
        assert!((volume / expected - 1.0).abs() < 0.1, "{volume} {expected}");
        for (place, normal) in sheet.position.iter().zip(&sheet.normal) {
            let out = *place - shift;
            assert!((out.length() - 0.3).abs() < 0.05, "{out}");
            assert!(normal.dot(out.normalize()) > 0.8, "{out} {normal}");
        }
    }

    #[test]
    fn the_same_bits_in_a_pool_of_threads() {
        let drops = ball(0.2, 0.02);
        let once = || sheet(&drops, &[], 0.02, &scene::Sheet::default()).unwrap();
        let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().unwrap();
        let first = once();
        assert!((0..3).all(|_| pool.install(once) == first));
    }

    #[test]
    fn a_sheet_thins_out_with_the_shares_of_its_drops_and_is_gone_before_they_are() {
        let drops = ball(0.2, 0.02);
        let width = |share: f32| {
            let sheet = sheet(&drops, &vec![share; drops.len()], 0.02, &scene::Sheet::default()).unwrap();
            sheet.position.iter().map(|p| p.length()).fold(0.0, f32::max)
        };
        let whole = width(1.0);
        let mut before = whole;
        for step in 1..=32 {
            let now = width(1.0 - step as f32 / 33.0);
            // It shrinks (up to what marching cubes and smoothing make of it), by no more than two drops at once.
            assert!(now <= before + 0.005, "{step}: {now} {before}");
            assert!(now == 0.0 || before - now < 0.04, "{step}: {now} {before}");
            before = now;
        }
        assert_eq!(before, 0.0);
        let unweighted = sheet(&drops, &[], 0.02, &scene::Sheet::default()).unwrap();
        assert_eq!(whole, unweighted.position.iter().map(|p| p.length()).fold(0.0, f32::max));
    }

    #[test]
    fn what_cannot_be_joined_says_so() {
        let settings = scene::Sheet::default();
        assert_eq!(sheet(&[], &[], 0.1, &settings).unwrap(), Sheet::default());
        let message = sheet(&[Vec3::ZERO, Vec3::splat(1e6)], &[], 1e-6, &settings).unwrap_err().to_string();
        assert!(message.contains("2 drops of 1e-6 m over 1e6 m"), "{message}");
        let million = vec![Vec3::ONE; 100_000];
        assert!(sheet(&million, &[], 0.01, &settings).unwrap().position.iter().all(|p| p.is_finite()));
        assert!(sheet(&million[..1], &[], 1e-6, &settings).is_ok());
    }
}
