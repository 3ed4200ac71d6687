//! Foam as the renderer asks for it: how much of a point's surroundings is covered, what it looks like, how much air is below.
//!
//! The density is a quadratic B-spline over columns, smooth as the water is; the pattern is drawn in coordinates that the flow
//! has carried, so that it moves with the water. The mean of the cover over the pattern is the density, at any footprint.

use glam::{DVec3, Vec2, Vec3};

use super::carry::{FoamState, LAYERS};
use super::pattern::{bubbles, lace, normal_quantile, normal_share};
use crate::scene;

/// Density under which there is no foam: half's last place (11 bits) of a white pixel; and half a percent of the pattern's own
/// filaments are wider than what it would leave of them.
const LEAST: f32 = 1.0 / 4096.0;
/// Stretch of the coordinates at which a layer counts half.
const STRETCH: f32 = 3.0;
/// Albedo of single scattering by bubbles: air does not absorb, and the film of water around it hardly.
const BUBBLE_ALBEDO: f32 = 0.9995;
/// Share of closed foam's albedo that is lost between its bubbles, and at its thin rims.
const GRAIN: f32 = 0.20;
const RIM: f32 = 0.20;

/// Foam at a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FoamLook {
    /// Share of the footprint that is foam, 0..1.
    pub cover: f32,
    /// Diffuse albedo of that foam, linear Rec.709.
    pub albedo: Vec3,
    /// The cover's mean around here, without the pattern.
    pub density: f32,
}

/// Bubbles under the surface: extinction falls off as exp(-depth below the surface / depth).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Aeration {
    /// Extinction just under the surface (1/m).
    pub extinction: f32,
    /// Depth (m) in which it falls to 1/e.
    pub depth: f32,
    /// Albedo of single scattering.
    pub albedo: f32,
}

/// The foam of one frame, in the local frame.
#[derive(Clone, Debug)]
pub struct FoamField {
    /// Centre of column (0, 0), x and z.
    corner: Vec2,
    width: Vec2,
    count: [usize; 2],
    density: Vec<f32>,
    offset: [Vec<[f32; 2]>; LAYERS],
    /// Weight by age, and seed, of each layer.
    layers: [(f32, u32); LAYERS],
    amount: f32,
    /// Width of the lace's meshes, and of bubbles (m).
    pattern: f32,
    bubble: f32,
    softness: f32,
    albedo: Vec3,
    aeration: f32,
    aeration_depth: f32,
}

/// Value and derivatives along x and z of a quadratic B-spline's nine basis functions.
struct Basis {
    column: [usize; 9],
    value: [f32; 9],
    slope: [Vec2; 9],
}

impl FoamField {
    /// The foam of a frame whose column (0, 0) is centred at `origin` (x, z), around the local frame's own `local` origin.
    /// `None` if there is none to see.
    pub fn build(state: &FoamState, settings: &scene::Foam, origin: [f64; 2], local: DVec3) -> Option<Self> {
        let amount = settings.amount as f32;
        if !settings.visible || !state.density().iter().any(|&density| density * amount >= LEAST) {
            return None;
        }
        let width = state.width();
        let pattern = settings.pattern.unwrap_or(width[0].min(width[1]));
        Some(Self {
            corner: Vec2::new((origin[0] - local.x) as f32, (origin[1] - local.z) as f32),
            width: Vec2::new(width[0] as f32, width[1] as f32),
            count: state.count(),
            density: state.density().to_vec(),
            offset: std::array::from_fn(|layer| state.offset(layer).to_vec()),
            layers: std::array::from_fn(|layer| {
                let (starts, passed) = state.phase(layer);
                // 0 where it starts anew, so that nothing is seen of that; those of both layers add up to 1.
                let weight = (std::f64::consts::PI * passed).sin().powi(2) as f32;
                (weight, (starts as u32).wrapping_mul(LAYERS as u32).wrapping_add(layer as u32))
            }),
            amount,
            pattern: pattern as f32,
            bubble: settings.bubble.unwrap_or(pattern / 12.0) as f32,
            softness: settings.softness as f32,
            albedo: Vec3::from_array(settings.albedo.map(|value| value as f32)),
            aeration: settings.aeration as f32,
            aeration_depth: settings.aeration_depth as f32,
        })
    }

    fn basis(&self, x: f32, z: f32) -> Basis {
        let at = (Vec2::new(x, z) - self.corner) / self.width;
        let near = at.round();
        let f = at - near;
        let weights = |f: f32| [0.5 * (0.5 - f) * (0.5 - f), 0.75 - f * f, 0.5 * (0.5 + f) * (0.5 + f)];
        let slopes = |f: f32| [f - 0.5, -2.0 * f, f + 0.5];
        let (along_x, along_z) = ((weights(f.x), slopes(f.x)), (weights(f.y), slopes(f.y)));
        // Outside, the edge repeats, as the water's own control points do.
        let clamp =
            |place: f32, step: usize, count: usize| (place + step as f32 - 1.0).clamp(0.0, (count - 1) as f32) as usize;
        let each = |k: usize| (k % 3, k / 3);
        Basis {
            column: std::array::from_fn(|k| {
                let (i, j) = each(k);
                clamp(near.y, j, self.count[1]) * self.count[0] + clamp(near.x, i, self.count[0])
            }),
            value: std::array::from_fn(|k| along_x.0[each(k).0] * along_z.0[each(k).1]),
            slope: std::array::from_fn(|k| {
                let (i, j) = each(k);
                Vec2::new(along_x.1[i] * along_z.0[j], along_x.0[i] * along_z.1[j]) / self.width
            }),
        }
    }

    fn density_on(&self, basis: &Basis) -> f32 {
        let sum: f32 = (0..9).map(|k| basis.value[k] * self.density[basis.column[k]]).sum();
        // Not `min`, which would make 1 of what is no number.
        if sum * self.amount > 1.0 { 1.0 } else { sum * self.amount }
    }

    /// The foam at x, z of the local frame, averaged over a footprint (m); `None` where there is none.
    ///
    /// cover = Phi((G - q) / sqrt(s^2 + 1 - v)), q = -sqrt(1 + s^2) Phi^-1(density): G is the resolved part, of variance v, of
    /// a standard normal field, s the softness. Its mean over G and over what is not resolved is the density, for any v.
    pub fn at(&self, x: f32, z: f32, footprint: f32) -> Option<FoamLook> {
        let basis = self.basis(x, z);
        let density = self.density_on(&basis);
        // Written so that a place which is no number has none.
        if !(density >= LEAST) {
            return None;
        }
        let here = Vec2::new(x, z) - self.corner;
        let (mut field, mut variance, mut norm, mut grain) = (0.0, 0.0, 0.0, 0.0);
        for (layer, (age_weight, seed)) in self.layers.into_iter().enumerate() {
            let (mut place, mut along_x, mut along_z) = (here, Vec2::X, Vec2::Y);
            for k in 0..9 {
                let offset = Vec2::from_array(self.offset[layer][basis.column[k]]);
                place += basis.value[k] * offset;
                along_x += basis.slope[k].x * offset;
                along_z += basis.slope[k].y * offset;
            }
            let strain =
                ((along_x - Vec2::X).length_squared() + (along_z - Vec2::Y).length_squared()) / (STRETCH * STRETCH);
            let weight = age_weight / (1.0 + strain);
            if !(weight > 0.0) {
                continue;
            }
            let squeezed = footprint * stretch(along_x, along_z);
            let (value, resolved) = lace(place / self.pattern, squeezed / self.pattern, seed);
            field += weight * value;
            variance += weight * weight * resolved;
            norm += weight * weight;
            grain += age_weight * bubbles(place / self.bubble, squeezed / self.bubble, !seed);
        }
        if norm > 0.0 {
            field /= norm.sqrt();
            variance /= norm;
        }
        let soft = self.softness * self.softness;
        let threshold = -(1.0 + soft).sqrt() * normal_quantile(density);
        let spread = (soft + (1.0 - variance).max(0.0)).sqrt();
        let cover = normal_share((field - threshold) / spread);
        // How far inside the foam's rim.
        let inside = normal_share((field - threshold - self.softness) / (2.0 * spread));
        let shade = 1.0 - RIM * (1.0 - inside) - GRAIN * (1.0 - grain.clamp(0.0, 1.0));
        Some(FoamLook { cover, albedo: self.albedo * shade, density })
    }

    /// Greatest extinction (1/m) of bubbles anywhere: a spline does not leave the range of its heights.
    pub fn most_bubbles(&self) -> f32 {
        self.aeration * self.density.iter().copied().fold(0.0, f32::max)
    }

    /// The bubbles under the surface at x, z of the local frame; `None` where there are none.
    pub fn bubbles(&self, x: f32, z: f32) -> Option<Aeration> {
        let density = self.density_on(&self.basis(x, z));
        let extinction = self.aeration * density;
        (density >= LEAST && extinction > 0.0).then_some(Aeration {
            extinction,
            depth: self.aeration_depth,
            albedo: BUBBLE_ALBEDO,
        })
    }
}

/// How long a metre of water is in the pattern, for a matrix with these columns: between its largest singular value, by which
/// streaks would blur that a pixel still shows lengthwise, and the root of its determinant, by which they would alias.
fn stretch(a: Vec2, b: Vec2) -> f32 {
    let half = 0.5 * (a.length_squared() + b.length_squared());
    let area = a.perp_dot(b).abs();
    let largest = (half + (half * half - area * area).max(0.0).sqrt()).sqrt();
    (largest * area.sqrt()).sqrt()
}

#[cfg(test)]
mod tests {
    use super::super::potential::{WaterMap, tests::water};
    use super::*;

    const COUNT: [usize; 2] = [40, 30];

    fn settings() -> scene::Foam {
        scene::Foam { pattern: Some(0.4), ..scene::Foam::default() }
    }

    /// Even foam on water that has moved for `time` seconds.
    fn field(density: f32, flow: [f64; 2], time: f64, settings: &scene::Foam) -> FoamField {
        let columns = water(COUNT, 0.25, |_, _| flow);
        let mut state = FoamState::new(COUNT, [0.25; 2], 0.4, 4.0);
        let steps = (time / 0.05).round().max(1.0);
        let map = WaterMap::of(&columns, 0.001);
        if time > 0.0 {
            (0..steps as usize).for_each(|_| state.step(&map, &[0.0; 1200], 1.0, time / steps));
        }
        let mut stored = state.to_stored();
        stored.density.fill(density);
        let state = FoamState::stored(COUNT, [0.25; 2], state.time(), stored);
        FoamField::build(&state, settings, [10.0, -5.0], DVec3::new(12.0, 3.0, -1.0)).unwrap()
    }

    /// A picture of the cover, metres from the map's north-western corner.
    fn picture(field: &FoamField, from: [f32; 2], size: usize, step: f32, footprint: f32) -> Vec<f32> {
        let at = |i: usize| {
            let place = field.corner + Vec2::from_array(from) + step * Vec2::new((i % size) as f32, (i / size) as f32);
            field.at(place.x, place.y, footprint).map_or(0.0, |look| look.cover)
        };
        (0..size * size).map(at).collect()
    }

    fn correlation(a: &[f32], b: &[f32]) -> f32 {
        let mean = |values: &[f32]| values.iter().sum::<f32>() / values.len() as f32;
        let (mean_a, mean_b) = (mean(a), mean(b));
        let sum = |f: &dyn Fn(f32, f32) -> f32| a.iter().zip(b).map(|(&a, &b)| f(a - mean_a, b - mean_b)).sum::<f32>();
        sum(&|a, b| a * b) / (sum(&|a, _| a * a) * sum(&|_, b| b * b)).sqrt()
    }

    #[test]
    fn the_mean_of_the_cover_is_the_density_at_any_footprint() {
        for density in [0.03, 0.2, 0.5, 0.85] {
            let field = field(density, [0.0; 2], 0.0, &settings());
            for footprint in [0.0, 0.03, 0.1, 0.2, 0.4, 3.0] {
                let covers = picture(&field, [0.3, 0.3], 200, 0.033, footprint);
                let mean = covers.iter().sum::<f32>() / covers.len() as f32;
                assert!((mean - density).abs() < 0.01 + 0.03 * density, "{density}, {footprint} m: {mean}");
                let spread = covers.iter().map(|cover| (cover - mean).powi(2)).sum::<f32>() / covers.len() as f32;
                if footprint == 3.0 {
                    assert!(spread < 1e-6, "{spread}");
                } else if footprint == 0.0 {
                    // Of the variance d (1 - d) of what is either foam or not, most: it is no fog.
                    assert!(spread > 0.5 * density * (1.0 - density), "{density}, {footprint} m: {spread}");
                }
            }
        }
    }

    #[test]
    fn the_pattern_moves_with_the_water() {
        let flow = [1.5, 0.5];
        let (before, after) = (field(0.4, flow, 0.5, &settings()), field(0.4, flow, 0.6, &settings()));
        let still = picture(&before, [2.0, 2.0], 100, 0.02, 0.0);
        let moved = picture(&after, [2.0 + 0.15, 2.0 + 0.05], 100, 0.02, 0.0);
        let stuck = picture(&after, [2.0, 2.0], 100, 0.02, 0.0);
        let (with_water, with_world) = (correlation(&still, &moved), correlation(&still, &stuck));
        assert!(with_water > 0.95 && with_world < 0.4, "{with_water} {with_world}");
    }

    #[test]
    fn nothing_jumps_where_a_layer_starts_anew() {
        let flow = [1.0, 0.0];
        // At 4 s the first layer starts anew; the field's time begins at 0.4 s.
        let [before, after] = [3.598_f32, 3.602]
            .map(|time| picture(&field(0.4, flow, f64::from(time), &settings()), [4.0 + time, 2.0], 60, 0.03, 0.0));
        // A filament between points two cells off may come or go by a rounding of its place, in one pixel of thousands.
        let jumps = before.iter().zip(&after).filter(|(a, b)| (**a - **b).abs() > 0.01).count();
        assert!(jumps < 4, "{jumps}");
    }

    #[test]
    fn density_is_smooth_across_columns_and_absent_foam_is_none() {
        let mut state = FoamState::new(COUNT, [0.25; 2], 0.0, 4.0).to_stored();
        assert!(
            FoamField::build(
                &FoamState::stored(COUNT, [0.25; 2], 0.0, state.clone()),
                &settings(),
                [0.0; 2],
                DVec3::ZERO
            )
            .is_none()
        );
        state.density[15 * 40 + 20] = 0.8;
        let state = FoamState::stored(COUNT, [0.25; 2], 0.0, state);
        assert!(
            FoamField::build(&state, &scene::Foam { visible: false, ..settings() }, [0.0; 2], DVec3::ZERO).is_none()
        );
        let field = FoamField::build(&state, &settings(), [0.0; 2], DVec3::ZERO).unwrap();
        let density = |x: f32| field.bubbles(x, 15.0 * 0.25).map_or(0.0, |bubbles| bubbles.extinction / field.aeration);
        assert!((density(5.0) - 0.8 * 0.75 * 0.75).abs() < 1e-5);
        let slope = |x: f32| (density(x + 0.005) - density(x - 0.005)) / 0.01;
        let steepest =
            (0..200).map(|i| 4.6 + 0.004 * i as f32).map(|x| (slope(x + 0.004) - slope(x)).abs()).fold(0.0, f32::max);
        assert!(steepest < 0.2, "the slope jumps by {steepest}");
        assert!(field.at(1.0, 1.0, 0.01).is_none() && field.at(f32::NAN, 1.0, 0.01).is_none());
        assert!(field.bubbles(1.0, 1.0).is_none());
    }

    #[test]
    fn looks_are_sound_everywhere() {
        let mut stored = field(0.5, [3.0, -2.0], 1.3, &settings());
        for (column, density) in stored.density.iter_mut().enumerate() {
            *density = [0.0, 1e-4, 0.02, 0.5, 1.0][column % 5];
        }
        for (i, offset) in stored.offset[1].iter_mut().enumerate() {
            *offset = [1e30, -(i as f32)];
        }
        for i in 0..4000_u32 {
            let [a, b, c, _] = sobol_burley::sample_4d(i, 0, 1);
            let place = stored.corner + Vec2::new(a, b) * 10.0 - 0.5;
            if let Some(look) = stored.at(place.x, place.y, 0.5 * c * c) {
                assert!((0.0..=1.0).contains(&look.cover) && (0.0..=1.0).contains(&look.density), "{look:?}");
                assert!(look.albedo.min_element() > 0.0 && look.albedo.max_element() <= 0.96);
            }
        }
    }
}
