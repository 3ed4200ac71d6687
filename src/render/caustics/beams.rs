//! The sun's light on the bed by beams: the water's surface in small cells, each cell's light refracted to where it first
//! lands and spread over the area that it covers there. Fast and without noise, as sharp as its cells: for previews.
//!
//! *Source:* M. Watt, Light-water interaction using backward beam tracing, 1990; the spreading by exact area is ours
//! (`raster`).

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::raster::{self, Beam};
use crate::{
    accel::{Accelerator, HitBatch, NO_PART, RayBatch},
    lower::{Lowered, Material},
    optics::fresnel,
    surface::{SolveCounts, SplineSurface},
};

/// Spray that a beam passes before it counts as stopped; spray itself takes nothing from it.
const PASSES: usize = 64;

/// How far (m) a receiver may lie off the height where beams landed, besides a texel's width: tiles and pebbles on a bed.
const REACH: f32 = 0.05;

/// Rounding of a place, as for every ray that leaves a hit: three ulp for the place, as many in the accelerator, doubled.
const ULPS: f32 = 12.0 * f32::EPSILON;

/// Tolerance of a beam's landing, in widths of a beam: a hundredth of it cannot be seen. Rays leave the surface from as far
/// off it, so that no solver may take the place that they leave for a hit.
const TOLERANCE: f32 = 0.01;

/// Why there is no map.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum BeamError {
    /// No beams at all, or more than can be numbered.
    #[error("{resolution} beams along a column over {columns} columns; expected at least 1, and at most 2^28 beams")]
    Resolution {
        /// Beams along a column's side.
        resolution: u32,
        /// Columns.
        columns: u64,
    },
}

/// The sun above the water, and what water does to its light.
#[derive(Clone, Copy)]
pub struct BeamSun<'a> {
    /// Unit vector to the sun.
    pub direction: Vec3,
    /// Irradiance on a card that faces it.
    pub irradiance: Vec3,
    /// The water's index of refraction.
    pub ior: f32,
    /// What is lost per metre of water.
    pub attenuation: Vec3,
    /// Reflectance of the surface by the cosine of incidence.
    pub reflectance: &'a (dyn Fn(f32) -> f32 + Sync),
    /// Share of its light that the air lets through to a point of the surface (m).
    pub clear: &'a (dyn Fn(Vec3) -> f32 + Sync),
}

/// A corner of beams: where its light lands, and how much there is per horizontal area of the surface.
#[derive(Clone, Copy, Debug)]
struct Corner {
    landing: Vec3,
    flux: DVec3,
}

/// Light on the bed over x and z.
#[derive(Clone, Debug)]
pub struct BeamMap {
    size: [usize; 2],
    /// Local x, z of the map's corner and width of a texel (m).
    corner: [f64; 2],
    width: [f64; 2],
    /// Flux per horizontal area.
    light: Vec<Vec3>,
    /// Mean height at which it landed (m); NaN where none did.
    height: Vec<f32>,
    landed: DVec3,
    solve: SolveCounts,
}

impl BeamMap {
    /// Sends the sun through the surface, `resolution` beams along every column's side, and draws a map as fine as that
    /// over the surface's domain.
    ///
    /// A beam's light is the mean of its corners': irradiance · transmittance · cosine · area, less what the water on its
    /// way takes. A corner whose sun is hidden has none, by what stands above or by other waves. Beams end on the first
    /// thing that is neither spray nor water; a triangle of a beam with a corner that ends nowhere, or that meets the
    /// surface again from below, is left out. The same to the bit at any count of threads.
    ///
    /// *Errors:* [`BeamError::Resolution`].
    pub fn build(
        surface: &SplineSurface,
        lowered: &Lowered,
        accelerator: &dyn Accelerator,
        sun: &BeamSun,
        resolution: u32,
    ) -> Result<Self, BeamError> {
        let lattice = surface.lattice();
        let columns: [u64; 2] =
            std::array::from_fn(|axis| (lattice.domain[1][axis] - lattice.domain[0][axis]).round() as u64);
        let fine = u64::from(resolution);
        let beams = columns.map(|count| count.saturating_mul(fine));
        if resolution == 0 || (beams[0] + 1).saturating_mul(beams[1] + 1) > 1 << 28 {
            return Err(BeamError::Resolution { resolution, columns: columns[0] * columns[1] });
        }
        let size = beams.map(|count| count as usize);
        let width = lattice.width.map(|width| width / f64::from(resolution));
        let corner = lattice.from_cell(lattice.domain[0]);
        let lines: Vec<(Vec<Option<Corner>>, SolveCounts)> = (0..=size[1])
            .into_par_iter()
            .map(|row| {
                let places: Vec<[f64; 2]> = (0..=size[0])
                    .map(|column| [corner[0] + column as f64 * width[0], corner[1] + row as f64 * width[1]])
                    .collect();
                line(surface, lowered, accelerator, sun, &places, width)
            })
            .collect();
        let texels = |landing: Vec3| {
            let x = (f64::from(landing.x) - corner[0]) / width[0];
            [x, (f64::from(landing.z) - corner[1]) / width[1], f64::from(landing.y)]
        };
        let area = 0.5 * width[0] * width[1];
        let rows: Vec<Vec<Beam>> = lines
            .par_windows(2)
            .map(|pair| {
                let triangles = (0..size[0]).flat_map(|k| {
                    let (a, b) = (&pair[0].0[k..k + 2], &pair[1].0[k..k + 2]);
                    [[a[0], a[1], b[0]], [a[1], b[1], b[0]]]
                });
                triangles
                    .filter_map(|[a, b, c]| {
                        let (a, b, c) = (a?, b?, c?);
                        let flux = (a.flux + b.flux + c.flux) * (area / 3.0);
                        let corners = [a, b, c].map(|corner| texels(corner.landing));
                        (flux.max_element() > 0.0).then_some(Beam { corners, flux: flux.to_array() })
                    })
                    .collect()
            })
            .collect();
        let mut solve = SolveCounts::default();
        for (_, counts) in &lines {
            solve += *counts;
        }
        let map = raster::spread(&rows, size);
        let per_area = 1.0 / (width[0] * width[1]);
        let landed = map.iter().map(|texel| DVec3::from(texel.flux)).sum();
        let light = map.iter().map(|texel| (DVec3::from(texel.flux) * per_area).as_vec3()).collect();
        let height = map.iter().map(|texel| (texel.moment / texel.flux.iter().sum::<f64>()) as f32).collect();
        Ok(Self { size, corner, width, light, height, landed, solve })
    }

    /// The whole flux on the map, by channel: irradiance times square metres.
    pub fn landed(&self) -> DVec3 {
        self.landed
    }

    /// The surface solver's work on the beams, and the rays that it gave up on.
    pub fn solve(&self) -> SolveCounts {
        self.solve
    }

    /// Irradiance of the refracted sun at a point under water with the unit normal `normal`.
    ///
    /// Bilinear between the four nearest texels whose light landed within 5 cm and a texel's width of the point's tangent
    /// plane, so that tiles, pebbles and slopes are served, and rocks above a lit bed are not lit by what landed below.
    /// Zero for what faces down, for vertical walls, and beyond the map.
    pub fn irradiance(&self, position: Vec3, normal: Vec3) -> Vec3 {
        if !(normal.y > 0.0) {
            return Vec3::ZERO;
        }
        let place = [position.x, position.z];
        let at: [f64; 2] = std::array::from_fn(|axis| (f64::from(place[axis]) - self.corner[axis]) / self.width[axis]);
        if !(0..2).all(|axis| (0.0..=self.size[axis] as f64).contains(&at[axis])) {
            return Vec3::ZERO;
        }
        let room = REACH + self.width[0].max(self.width[1]) as f32;
        let (mut light, mut weights) = (Vec3::ZERO, 0.0);
        for corner in 0..4 {
            let (mut weight, mut index, mut offset) = (1.0, [0; 2], [0.0; 2]);
            for axis in 0..2 {
                let low = (at[axis] - 0.5).floor();
                let share = at[axis] - 0.5 - low;
                let upper = corner >> axis & 1;
                weight *= if upper == 1 { share } else { 1.0 - share };
                // At the map's edge the last texel stands for what is beyond.
                index[axis] = (low + f64::from(upper)).clamp(0.0, self.size[axis] as f64 - 1.0) as usize;
                offset[axis] = ((index[axis] as f64 + 0.5 - at[axis]) * self.width[axis]) as f32;
            }
            let texel = index[1] * self.size[0] + index[0];
            let plane = position.y - (normal.x * offset[0] + normal.z * offset[1]) / normal.y;
            // Where nothing landed it is dark at every height.
            if !((self.height[texel] - plane).abs() > room) {
                light += self.light[texel] * weight as f32;
                weights += weight as f32;
            }
        }
        if weights > 0.0 { light * (normal.y / weights) } else { Vec3::ZERO }
    }
}

/// A line of corners: their sun above, their landing below.
fn line(
    surface: &SplineSurface,
    lowered: &Lowered,
    accelerator: &dyn Accelerator,
    sun: &BeamSun,
    places: &[[f64; 2]],
    width: [f64; 2],
) -> (Vec<Option<Corner>>, SolveCounts) {
    let tolerance = TOLERANCE * width[0].min(width[1]) as f32;
    let mut owners = Vec::with_capacity(places.len());
    let (mut up, mut down) = (Vec::new(), Vec::new());
    for (index, &[x, z]) in places.iter().enumerate() {
        let Some((height, slope)) = surface.point(x, z) else { continue };
        let steep = DVec3::new(-slope[0], 1.0, -slope[1]);
        let normal = steep.normalize().as_vec3();
        let cosine = normal.dot(sun.direction);
        // A corner that turns its back to the sun still ends its neighbours' beams: along the surface, as the last ray.
        let incident = if cosine > 0.0 { -sun.direction } else { -(sun.direction - cosine * normal).normalize() };
        let Some(refracted) = fresnel::refract(incident, normal, 1.0, sun.ior) else { continue };
        let position = DVec3::new(x, height, z).as_vec3();
        let room = tolerance + ULPS * position.abs().max_element();
        let through = 1.0 - (sun.reflectance)(cosine.max(0.0));
        let flux = (sun.irradiance * through).as_dvec3() * steep.dot(sun.direction.as_dvec3()).max(0.0);
        owners.push((index, position, flux));
        up.push((position + room * normal, sun.direction));
        down.push((position - room * normal, refracted));
    }
    let mut counts = SolveCounts::default();
    let above = follow(accelerator, lowered, &mut up, tolerance, &mut counts);
    let below = follow(accelerator, lowered, &mut down, tolerance, &mut counts);
    let mut corners = vec![None; places.len()];
    for (k, (index, position, flux)) in owners.into_iter().enumerate() {
        let Some((landing, false)) = below[k] else { continue };
        let lit = if above[k].is_none() { f64::from((sun.clear)(position)) } else { 0.0 };
        let path = (landing - position).length();
        let left = (-sun.attenuation * path).exp().as_dvec3();
        corners[index] = Some(Corner { landing, flux: lit * flux * left });
    }
    (corners, counts)
}

/// Where each ray first meets anything but spray, and whether that is water; `None` for nothing.
fn follow(
    accelerator: &dyn Accelerator,
    lowered: &Lowered,
    rays: &mut [(Vec3, Vec3)],
    tolerance: f32,
    counts: &mut SolveCounts,
) -> Vec<Option<(Vec3, bool)>> {
    let mut ends = vec![None; rays.len()];
    let mut open: Vec<usize> = (0..rays.len()).collect();
    let (mut batch, mut hits) = (RayBatch::default(), HitBatch::default());
    for _ in 0..PASSES {
        if open.is_empty() {
            break;
        }
        batch.clear();
        for &ray in &open {
            batch.push(rays[ray].0, rays[ray].1, 0.0, f32::INFINITY, tolerance);
        }
        accelerator.closest(&batch, &mut hits, counts);
        let mut next = Vec::new();
        for (k, &ray) in open.iter().enumerate() {
            if hits.part[k] == NO_PART {
                continue;
            }
            let (origin, direction) = rays[ray];
            let place = origin + hits.t[k] * direction;
            match lowered.parts[hits.part[k] as usize].material {
                Material::Spray { .. } => {
                    rays[ray].0 = place + ULPS * place.abs().max_element() * direction;
                    next.push(ray);
                }
                Material::Water | Material::Sheet => ends[ray] = Some((place, true)),
                _ => ends[ray] = Some((place, false)),
            }
        }
        open = next;
    }
    // What still is in spray stays there: stopped, and nowhere that light would be looked for.
    for ray in open {
        ends[ray] = Some((rays[ray].0, true));
    }
    ends
}
