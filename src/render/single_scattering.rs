//! Mist for the integrator without noise: transmittance by quadrature, sun and lamps scattered once towards the eye, and the
//! sky's light as if nothing stood around it.
//!
//! What scatters on a ray is taken from a few points of it, spread so that each stands for an equal share. Light that is
//! scattered more than once is the path tracer's.

use std::f32::consts::{FRAC_1_PI, PI};

use glam::Vec3;

use super::{
    batches::{Carrier, Scratch, ShadowCarrier},
    film::Layer,
    whitted::LEAST_THROUGHPUT,
    world::{SKY, SUN, World},
};
use crate::optics::{Phase, Sky};

/// Mean cosine of the deflection by water droplets of some tens of micrometres in visible light (Y. Hu and K. Stamnes, An
/// accurate parameterization of the radiative properties of water clouds, 1993: 0.85 to 0.88).
const MEAN_COSINE: f32 = 0.85;

/// Into which directions mist scatters.
pub(super) const PHASE: Phase = Phase::HenyeyGreenstein { g: MEAN_COSINE };

/// Share of the peak: the square of the mean cosine.
const PEAK: f32 = MEAN_COSINE * MEAN_COSINE;

/// Points of a ray that ask for light.
const POINTS: usize = 4;

/// Mean radiance from all around. Irradiance on six cards, one to each side, weighs a direction by the sum of its cosines, which
/// is 3/2 in the mean: right for a uniform sky, and for any that does not crowd about the axes.
pub(super) fn mean_radiance(sky: &Sky) -> Vec3 {
    let sides = [Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::NEG_Y, Vec3::Z, Vec3::NEG_Z];
    sides.into_iter().map(|side| sky.irradiance(side)).sum::<Vec3>() / (6.0 * PI)
}

impl World<'_> {
    /// What mist does to a ray through `reach` metres of air: the light that it scatters to the eye, and what is left of
    /// the rest. An infinite reach ends in the sky.
    ///
    /// The sky's light takes a droplet's phase function as a peak straight on and what is left, linear in the cosine (the
    /// delta-Eddington approximation: J. Joseph, W. Wiscombe, J. Weinman, 1976). What only peaks have scattered is what is
    /// seen behind; the rest is as bright as what is all around.
    pub(super) fn look_through_mist(
        &self,
        carrier: &mut Carrier,
        origin: Vec3,
        direction: Vec3,
        reach: f32,
        scratch: &mut Scratch,
    ) {
        let Some(mist) = self.mist.filter(|_| !carrier.in_water) else { return };
        let depth = mist.optical_depth(origin, direction, reach);
        let (left, taken) = ((-depth).exp(), -(-depth).exp_m1());
        let straight_on = (-(1.0 - PEAK) * depth).exp();
        if taken <= 0.0 {
            return;
        }
        let layer = carrier.layer.unwrap_or(Layer::Mist);
        let weight = carrier.throughput * taken;
        let mut sky = (1.0 - straight_on) * self.sky_around(direction);
        let left = if reach == f32::INFINITY {
            sky += (straight_on - left).max(0.0) * self.sky.radiance(direction);
            left
        } else {
            straight_on
        };
        scratch.film.add(carrier.place, layer, SKY, carrier.throughput * sky);
        let depths: [f32; POINTS] =
            std::array::from_fn(|point| -(-taken * (point as f32 + 0.5) / POINTS as f32).ln_1p());
        let share = weight / POINTS as f32;
        let from = *carrier;
        mist.places(origin, direction, reach, &depths, |t| {
            let at = Carrier { distance: from.distance + t, ..from };
            let position = origin + t * direction;
            if from.primary {
                let share = from.throughput.x * taken / POINTS as f32;
                scratch.film.add_mist(from.place.pixel, share, position, mist.velocity(position));
            }
            self.ask_in_mist(&at, position, direction, share, layer, scratch);
        });
        scratch.film.add_guide(carrier.place.pixel, carrier.guide * (1.0 - left), Vec3::ONE, Vec3::ZERO);
        carrier.sight = self.cover(carrier, self.things.mist(), 1.0 - left, scratch);
        carrier.throughput *= left;
        carrier.guide *= left;
    }

    /// Sun and lamps at a point of a ray, of which `share` is scattered there.
    fn ask_in_mist(
        &self,
        carrier: &Carrier,
        position: Vec3,
        direction: Vec3,
        share: Vec3,
        layer: Layer,
        scratch: &mut Scratch,
    ) {
        let mut ask = |to_light: Vec3, reach: f32, irradiance: Vec3, group: u16| {
            let (bow, drops) = self.bow(self.mist_drops(direction).as_ref(), to_light);
            let share = share * (Vec3::splat((1.0 - bow) * PHASE.value(direction.dot(to_light))) + drops);
            let light = share * irradiance;
            if light.max_element() <= 0.0 {
                return;
            }
            // Under half's rounding of a white card in the same light, what stands in its way does not show.
            if share.max_element() < LEAST_THROUGHPUT * FRAC_1_PI {
                scratch.film.add(carrier.place, layer, group, light);
                return;
            }
            let shadow = ShadowCarrier::in_air(light, carrier.distance, carrier.place, layer, group);
            self.push_shadow_from(position, to_light, reach, shadow, scratch);
        };
        ask(self.sun.direction, f32::INFINITY, self.sun.irradiance, SUN);
        for lamp in &self.lamps {
            let to_lamp = lamp.position - position;
            let distance = to_lamp.length();
            if distance > 0.0 {
                // The lamp is a point: nothing at its very place stands in the way.
                let reach = distance * (1.0 - 4.0 * f32::EPSILON);
                ask(to_lamp / distance, reach, lamp.intensity / (distance * distance), lamp.group);
            }
        }
    }

    /// The sky's light that a droplet sends on along the eye's ray but for the peak: by the mean and the net flux.
    fn sky_around(&self, direction: Vec3) -> Vec3 {
        let cosine = MEAN_COSINE / (1.0 + MEAN_COSINE);
        let flux = self.sky.irradiance(direction) - self.sky.irradiance(-direction);
        (self.mean_sky + 0.75 * FRAC_1_PI * cosine * flux).max(Vec3::ZERO)
    }

    /// Share of light that mist leaves over `reach` metres of air.
    pub(super) fn clear_of_mist(&self, origin: Vec3, direction: Vec3, reach: f32) -> f32 {
        self.mist.map_or(1.0, |mist| (-mist.optical_depth(origin, direction, reach)).exp())
    }
}
