//! Directions drawn by the light that comes from them: a table of mean luminance over azimuth and elevation.
//!
//! Piecewise constant over solid angle, so the density is exact in every cell (M. Pharr, W. Jakob and G. Humphreys, Physically
//! Based Rendering, 3rd edition, 14.2.4; here cells are even in solid angle within themselves, so no sine is left over).
//! What the sky sends is in `sky`; the sun's disc draws its own directions.

use std::f64::consts::PI;

use glam::Vec3;
use rayon::prelude::*;

use super::{Kind, Sky, place};
use crate::optics::luminance;

/// Most columns and rows of the table: half a million cells, 5 MB, which a processor can keep near. A larger image's pixels
/// are averaged: those of a cell are drawn evenly.
const MOST_COLUMNS: usize = 1024;
const MOST_ROWS: usize = 512;

/// Cells of a sky that is a formula, one look each: its steepest slope, at the horizon, spans several.
const FORMULA_COLUMNS: usize = 512;
const FORMULA_ROWS: usize = 256;

/// Share of directions that are drawn evenly over the sphere, so that no light is ever without density.
///
/// A cell's mean can be far under what its brightest corner sends, since images are interpolated across the cells' borders; this
/// bounds the radiance over the density by 4 pi / share, at the price of `share` of the samples.
const EVEN_SHARE: f64 = 0.02;

/// Draws directions with a density close to the sky's luminance.
#[derive(Clone, Debug)]
pub struct SkySampler {
    columns: usize,
    rows: usize,
    /// Height (as half of 1 - cosine with the zenith) of each row's upper border, and of the last one's lower border.
    borders: Vec<f64>,
    /// Sum of the shares of all rows up to and with this one; the last is 1.
    row_sums: Vec<f32>,
    /// The same for the cells of each row, row after row.
    column_sums: Vec<f32>,
    /// For each of these lists, where to look in it for a number.
    row_guide: Vec<u16>,
    column_guide: Vec<u16>,
    /// Density (1/sr) of each cell, row after row.
    density: Vec<f32>,
}

impl SkySampler {
    /// Tabulates a sky.
    pub fn new(sky: &Sky) -> Self {
        let (columns, rows, looks) = resolution(sky);
        // Solid angle of a cell: width times the difference of heights, which for thin rows only a product gives exactly.
        let solid = |row: usize| {
            let (top, bottom) = (PI * row as f64 / rows as f64, PI * (row + 1) as f64 / rows as f64);
            4.0 * PI / columns as f64 * (0.5 * (top + bottom)).sin() * (0.5 * (bottom - top)).sin()
        };
        let headings: Vec<Heading> =
            (0..columns * looks).map(|look| Heading::new((look as f64 + 0.5) / (columns * looks) as f64)).collect();
        let mut power: Vec<f64> = vec![0.0; columns * rows];
        power.par_chunks_mut(columns).enumerate().for_each(|(row, cells)| {
            for y in 0..looks {
                let slope = Slope::new((row as f64 + (y as f64 + 0.5) / looks as f64) / rows as f64);
                for (cell, headings) in cells.iter_mut().zip(headings.chunks(looks)) {
                    *cell +=
                        headings.iter().map(|heading| f64::from(luminance(look(sky, heading, &slope)))).sum::<f64>();
                }
            }
            let weight = solid(row) / (looks * looks) as f64;
            cells.iter_mut().for_each(|cell| *cell *= weight);
        });
        // Row by row, in order: the same bits whoever filled the rows.
        let total: f64 = power.chunks(columns).map(|row| row.iter().sum::<f64>()).sum();
        let even = if total > 0.0 { EVEN_SHARE } else { 1.0 };
        let mut row_sums = Vec::with_capacity(rows);
        let mut column_sums = Vec::with_capacity(columns * rows);
        let mut density = Vec::with_capacity(columns * rows);
        let mut above = 0.0;
        for (row, cells) in power.chunks(columns).enumerate() {
            let share = |power: f64| {
                even * solid(row) / (4.0 * PI) + if total > 0.0 { (1.0 - even) * power / total } else { 0.0 }
            };
            let of_row: f64 = cells.iter().map(|&power| share(power)).sum();
            let mut left = 0.0;
            for &power in cells {
                left += share(power);
                column_sums.push((left / of_row) as f32);
                density.push((share(power) / solid(row)) as f32);
            }
            above += of_row;
            row_sums.push(above as f32);
        }
        let row_guide = guide(&row_sums);
        let column_guide = column_sums.chunks(columns).flat_map(guide).collect();
        let borders = (0..=rows).map(|row| (0.5 * PI * row as f64 / rows as f64).sin().powi(2)).collect();
        Self { columns, rows, borders, row_sums, column_sums, row_guide, column_guide, density }
    }

    /// A direction and its density (1/sr), always over 0. `u` is uniform in the unit square.
    #[inline]
    pub fn sample(&self, u: [f32; 2]) -> (Vec3, f32) {
        let (row, y) = pick(&self.row_sums, &self.row_guide, u[1]);
        let cells = row * self.columns..(row + 1) * self.columns;
        let (column, x) = pick(&self.column_sums[cells.clone()], &self.column_guide[cells], u[0]);
        // Even in 1 - cos from the zenith, which is 2 sin^2 of half the angle: near both poles no digits are lost.
        let sin2 = self.borders[row] + y * (self.borders[row + 1] - self.borders[row]);
        let side = 2.0 * (sin2 * (1.0 - sin2)).max(0.0).sqrt() as f32;
        let (sin, cos) = (2.0 * PI * (column as f64 + x) / self.columns as f64).sin_cos();
        let (sin, cos) = (sin as f32, cos as f32);
        let direction = Vec3::new(side * sin, (1.0 - 2.0 * sin2) as f32, -side * cos);
        (direction, self.density[row * self.columns + column])
    }

    /// Density (1/sr) with which `sample` gives a unit direction.
    ///
    /// On a border between cells, rounding decides which of the two it is.
    #[inline]
    pub fn pdf(&self, direction: Vec3) -> f32 {
        let (u, v) = place(direction);
        let column = ((u - u.floor()) * self.columns as f32) as usize;
        let row = (v * self.rows as f32) as usize;
        self.density[row.min(self.rows - 1) * self.columns + column.min(self.columns - 1)]
    }

    /// Columns (eastward from north) and rows (zenith first) of the table.
    #[cfg(test)]
    fn resolution(&self) -> (usize, usize) {
        (self.columns, self.rows)
    }
}

/// Columns, rows, and looks per cell and axis, that a sky deserves.
fn resolution(sky: &Sky) -> (usize, usize, usize) {
    let (width, height) = match &sky.kind {
        Kind::Constant(_) => return (1, 1, 1),
        Kind::Analytic(_) => return (FORMULA_COLUMNS, FORMULA_ROWS, 1),
        Kind::LatLong { image, .. } => (image.width(), image.height()),
        // Even, so that a row's border lies on the horizon, where one texture ends.
        Kind::Skybox { above, below, .. } => {
            (above.width().max(below.width()), above.height().max(below.height()).next_multiple_of(2))
        }
    };
    let (columns, rows) = (width.clamp(1, MOST_COLUMNS), height.clamp(2, MOST_ROWS));
    // Two looks at a quarter and three quarters give the exact mean of what is linear on either side of a pixel's middle;
    // in coarser cells one per pixel lets each pixel count once.
    let pixels = width.div_ceil(columns).max(height.div_ceil(rows));
    (columns, rows, if pixels == 1 { 2 } else { pixels })
}

/// An azimuth as a share of 360 degrees from north, eastward, with its sine and cosine.
struct Heading {
    u: f64,
    sine: f64,
    cosine: f64,
}

impl Heading {
    fn new(u: f64) -> Self {
        let (sine, cosine) = (2.0 * PI * u).sin_cos();
        Self { u, sine, cosine }
    }
}

/// An angle from the zenith as a share of 180 degrees, with its sine and cosine.
struct Slope {
    v: f64,
    sine: f64,
    cosine: f64,
}

impl Slope {
    fn new(v: f64) -> Self {
        let (sine, cosine) = (PI * v).sin_cos();
        Self { v, sine, cosine }
    }
}

/// Unit direction of a place in the table.
fn direction(heading: &Heading, slope: &Slope) -> Vec3 {
    let (x, z) = (slope.sine * heading.sine, -slope.sine * heading.cosine);
    Vec3::new(x as f32, slope.cosine as f32, z as f32)
}

/// Radiance at a place of the table; images are asked without the way through a direction.
fn look(sky: &Sky, heading: &Heading, slope: &Slope) -> Vec3 {
    let (u, v) = (heading.u as f32, slope.v as f32);
    match &sky.kind {
        Kind::LatLong { image, turn } => image.look(u - turn, v) * sky.scale,
        Kind::Skybox { above, below, turn } => {
            (if slope.v < 0.5 { above } else { below }).look(u - turn, v) * sky.scale
        }
        Kind::Constant(_) | Kind::Analytic(_) => sky.radiance(direction(heading, slope)),
    }
}

/// For each of as many equal steps of 0 to 1 as there are entries, the first entry whose running sum lies beyond the step's
/// start (H. Chen and Y. Asau, On generating random variates from an empirical distribution, 1974).
fn guide(sums: &[f32]) -> Vec<u16> {
    let mut index = 0;
    (0..sums.len())
        .map(|step| {
            let start = step as f32 / sums.len() as f32;
            while index + 1 < sums.len() && sums[index] <= start {
                index += 1;
            }
            index as u16
        })
        .collect()
}

/// Entry of a running sum into which a uniform number falls, and how far into it (0 to 1).
#[inline]
fn pick(sums: &[f32], guide: &[u16], u: f32) -> (usize, f64) {
    let step = ((u * guide.len() as f32) as usize).min(guide.len() - 1);
    // The product may be rounded up into the next step: look from one step before, to where the one after begins.
    let first = usize::from(guide[step.saturating_sub(1)]);
    let last = guide.get(step + 1).map_or(sums.len() - 1, |&index| usize::from(index));
    // The last sum may be rounded to under 1: what is beyond it belongs to the last entry.
    let index = first + sums[first..last].partition_point(|&sum| sum <= u);
    let below = if index == 0 { 0.0 } else { f64::from(sums[index - 1]) };
    let width = f64::from(sums[index]) - below;
    let inside = if width > 0.0 { (f64::from(u) - below) / width } else { 0.5 };
    (index, inside.clamp(0.0, 1.0))
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::super::super::testing::{Mean, Uniform, directions};
    use super::*;
    use crate::optics::{Irradiance, environment::LatLong};
    use crate::scene;

    fn from_pixels(width: usize, height: usize, turn: f32, pixel: impl Fn(usize, usize) -> Vec3) -> Sky {
        let pixels = (0..width * height).map(|index| pixel(index % width, index / width)).collect();
        let image = LatLong::from_pixels(width, height, pixels);
        let irradiance = super::super::integrate(&image, &image, turn);
        Sky { kind: Kind::LatLong { image, turn }, scale: 1.0, irradiance }
    }

    /// A dim sky of some colour with a sun of a few pixels.
    fn with_sun(turn: f32) -> Sky {
        from_pixels(256, 128, turn, |x, y| {
            let sun = (70..72).contains(&x) && (30..32).contains(&y);
            let sky = Vec3::new(0.2, 0.3, 0.5) * (1.0 - y as f32 / 128.0);
            if sun { Vec3::splat(2e4) } else { sky }
        })
    }

    fn skybox() -> Sky {
        let image = |value: f32| {
            LatLong::from_pixels(32, 15, (0..480).map(|index| Vec3::splat(value * (index % 7) as f32)).collect())
        };
        let kind = Kind::Skybox { above: image(1.0), below: image(0.1), turn: 0.3 };
        Sky { kind, scale: 2.0, irradiance: Irradiance::constant(Vec3::ONE) }
    }

    fn built(kind: scene::SkyKind) -> Sky {
        let sky = scene::Sky { kind, ..Default::default() };
        Sky::build(&sky, &scene::Sun::default(), Path::new("")).unwrap()
    }

    fn all() -> Vec<(&'static str, Sky)> {
        vec![
            ("constant", built(scene::SkyKind::Constant)),
            ("analytic", built(scene::SkyKind::Analytic)),
            ("sun", with_sun(0.0)),
            ("turned sun", with_sun(0.123)),
            ("skybox", skybox()),
            (
                "larger than the table",
                from_pixels(1500, 750, 0.2, |x, y| {
                    Vec3::splat(if (400..404).contains(&x) && (200..204).contains(&y) { 3e4 } else { 0.5 })
                }),
            ),
            ("night", from_pixels(8, 4, 0.0, |_, _| Vec3::ZERO)),
            ("one pixel", from_pixels(1, 1, 0.0, |_, _| Vec3::ONE)),
            ("one light", from_pixels(64, 32, 0.0, |x, y| Vec3::splat(if (x, y) == (3, 8) { 1e6 } else { 0.0 }))),
        ]
    }

    #[test]
    fn the_density_adds_up_to_one() {
        for (name, sky) in all() {
            let sampler = SkySampler::new(&sky);
            let (columns, rows) = sampler.resolution();
            let mut sum = 0.0;
            for row in 0..rows {
                let height = |row: usize| (PI * row as f64 / rows as f64).cos();
                let solid = (height(row) - height(row + 1)) * 2.0 * PI / columns as f64;
                for column in 0..columns {
                    let d = direction(
                        &Heading::new((column as f64 + 0.5) / columns as f64),
                        &Slope::new((row as f64 + 0.5) / rows as f64),
                    );
                    let density = sampler.pdf(d);
                    assert!(density > 0.0 && density.is_finite(), "{name} {column} {row}");
                    sum += f64::from(density) * solid;
                }
            }
            assert!((sum - 1.0).abs() < 1e-5, "{name}: {sum}");
        }
    }

    #[test]
    fn samples_have_the_density_that_is_asked_for() {
        for (name, sky) in all() {
            let sampler = SkySampler::new(&sky);
            let mut random = Uniform::new(2);
            let count = 20_000;
            let (mut apart, mut sphere) = (0, Mean::default());
            for _ in 0..count {
                let (d, density) = sampler.sample(random.two());
                assert!((d.length() - 1.0).abs() < 1e-6, "{name}");
                apart += u32::from((sampler.pdf(d) / density - 1.0).abs() > 1e-5);
                // The mean of 1 / density is the solid angle of the sphere, if samples are where the density says.
                sphere.add(1.0 / f64::from(density));
            }
            // Cells' borders, missed by rounding.
            assert!(apart < 20, "{name}: {apart}");
            assert!(sphere.agrees(4.0 * PI, 4.0), "{name}: {} +- {}", sphere.value(), sphere.error());
            for u in [[0.0, 0.0], [1.0 - f32::EPSILON / 2.0; 2], [0.0, 1.0 - f32::EPSILON / 2.0]] {
                let (d, density) = sampler.sample(u);
                assert!(d.is_finite() && density > 0.0, "{name}");
            }
        }
    }

    #[test]
    fn the_guide_finds_what_a_search_of_the_whole_finds() {
        let mut random = Uniform::new(14);
        for count in [1usize, 2, 3, 17, 1000] {
            for power in [1, 40] {
                // Shares from even to a few that hold nearly all.
                let shares: Vec<f64> = (0..count).map(|_| f64::from(random.one()).powi(power) + 1e-12).collect();
                let total: f64 = shares.iter().sum();
                let sums: Vec<f32> = shares
                    .iter()
                    .scan(0.0, |sum, share| {
                        *sum += share / total;
                        Some(*sum as f32)
                    })
                    .collect();
                let guide = guide(&sums);
                let borders: Vec<f32> = sums.iter().flat_map(|&sum| [sum, sum.next_down(), sum.next_up()]).collect();
                let steps = (0..count).map(|step| step as f32 / count as f32);
                let ends = [0.0, 1.0 - f32::EPSILON / 2.0];
                for u in borders.into_iter().chain(steps).chain(ends).filter(|u| (0.0..1.0).contains(u)) {
                    let whole = sums.partition_point(|&sum| sum <= u).min(count - 1);
                    assert_eq!(pick(&sums, &guide, u).0, whole, "{count} {power} {u}");
                }
            }
        }
    }

    #[test]
    fn every_light_has_a_density() {
        for (name, sky) in all() {
            let sampler = SkySampler::new(&sky);
            let brightest = directions(20_000).map(|d| luminance(sky.radiance(d))).fold(0.0, f32::max);
            let mean = directions(20_000).map(|d| f64::from(luminance(sky.radiance(d)))).sum::<f64>() / 20_000.0;
            for d in directions(20_000) {
                let radiance = luminance(sky.radiance(d));
                // 1/16 is the least that a cell's mean may be of its corner's light, interpolated on both axes.
                let ratio = f64::from(radiance / sampler.pdf(d));
                assert!(ratio <= 1.2 * 16.0 * 4.0 * PI * mean.max(1e-30), "{name}: {ratio} {brightest}");
            }
        }
    }

    #[test]
    fn irradiance_of_a_sky_with_a_spot_comes_out_without_fireflies() {
        for turn in [0.0, 0.123] {
            let sky = with_sun(turn);
            let sampler = SkySampler::new(&sky);
            let mut random = Uniform::new(9);
            let (mut drawn, mut even) = (Mean::default(), Mean::default());
            for _ in 0..40_000 {
                let (d, density) = sampler.sample(random.two());
                drawn.add(f64::from(sky.radiance(d).y * d.y.max(0.0) / density));
                let (y, azimuth) = (2.0 * f64::from(random.one()) - 1.0, random.one());
                let d = direction(&Heading::new(f64::from(azimuth)), &Slope::new(y.acos() / PI));
                even.add(f64::from(sky.radiance(d).y * d.y.max(0.0)) * 4.0 * PI);
            }
            // The irradiance upward is exact for the image's cells; interpolation spreads the spot, 4 pixels, over 36.
            let truth = f64::from(sky.irradiance(Vec3::Y).y);
            assert!(
                (drawn.value() - truth).abs() < 4.0 * drawn.error() + 2e-3 * truth,
                "{turn}: {} +- {} {truth}",
                drawn.value(),
                drawn.error()
            );
            assert!(drawn.error() < 0.01 * truth, "{} of {truth}", drawn.error());
            assert!(even.error() > 20.0 * drawn.error(), "{} {}", even.error(), drawn.error());
        }
    }

    #[test]
    fn irradiance_of_the_default_sky_comes_out() {
        let sky = built(scene::SkyKind::Analytic);
        let sampler = SkySampler::new(&sky);
        let mut random = Uniform::new(11);
        for normal in [Vec3::Y, -Vec3::Y] {
            let mut drawn = Mean::default();
            for _ in 0..20_000 {
                let (d, density) = sampler.sample(random.two());
                drawn.add(f64::from(sky.radiance(d).y * d.dot(normal).max(0.0) / density));
            }
            let truth = f64::from(sky.irradiance(normal).y);
            assert!((drawn.value() - truth).abs() < 3.5 * drawn.error() + 1e-3 * truth, "{} {truth}", drawn.value());
        }
    }
}
