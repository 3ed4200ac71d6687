//! Level of detail: of particles much smaller than a pixel some are drawn for all.
//!
//! A particle whose radius is a share s of the least that is drawn (in pixels) is kept with chance s^2 and has 1 / s^2 times its
//! cross section, so that as much light meets the kept ones as met all (R. Cook, J. Halstead, M. Planck, D. Ryu, Stochastic
//! simplification of aggregate detail, 2007). Its seed decides, in each frame the same way; around the chance at which it goes it shrinks
//! rather than vanishes. Distance alone counts: what is behind the eye is seen in mirrors.

use glam::DVec3;
use rayon::prelude::*;

use super::{
    Spray,
    seed::{Purpose, uniform},
};

/// Share of the chance over which a particle fades, to either side: from a cross section of 1 / chance down to none.
const FADE: f64 = 0.25;

/// Where particles are seen from: the eye (m, local frame) and the width of a pixel (radians).
pub type Sight = (DVec3, f64);

/// Factor on the cross section of a particle of so many `pixels` of radius, whose number is `chance` (0..1): 1 from `least`
/// pixels on, 0 if it is not drawn. Its mean over all chances is 1.
fn cover(pixels: f64, least: f64, chance: f64) -> f64 {
    if !(pixels < least) {
        return 1.0;
    }
    let kept = (pixels / least).powi(2);
    // The fade's two ends lie about the chance, so that their mean is it.
    let high = (kept * (1.0 + FADE)).min(1.0);
    if !(chance < high) {
        return 0.0;
    }
    let low = 2.0 * kept - high;
    ((high - chance) / (high - low)).min(1.0) / kept
}

/// Factor on the opacity of what would be drawn with `share` of its own, whose number is `chance`, so that none has less than
/// `least`: some are drawn for all, as those that are too small. 0 if it is not drawn.
pub(super) fn strengthened(share: f64, least: f64, chance: f64) -> f64 {
    if share < least { cover((share / least).sqrt(), 1.0, chance) } else { 1.0 }
}

/// The least radius (pixels) from which on a particle is not drawn any more: what [`cover`] says the other way round.
fn vanishes_at(pixels: f64, chance: f64) -> f64 {
    pixels * ((1.0 + FADE) / chance).sqrt()
}

/// Radius in pixels and number of a particle.
fn seen(spray: &Spray, index: usize, (eye, pixel_angle): Sight) -> (f64, f64) {
    let distance = (spray.position[index].as_dvec3() - eye).length();
    (f64::from(spray.radius[index]) / (pixel_angle * distance), uniform(spray.seed(index), Purpose::Detail))
}

/// Factor on each particle's cross section where radii under `least` pixels are thinned; 0 for those that are not drawn.
pub fn covers(spray: &Spray, sight: Sight, least: f64) -> Vec<f32> {
    (0..spray.len())
        .into_par_iter()
        .map(|index| {
            let (pixels, chance) = seen(spray, index, sight);
            cover(pixels, least, chance) as f32
        })
        .collect()
}

/// The least radius (pixels) with which at most `most` stay, where particle k is drawn `times[k]` times.
pub fn least_for(spray: &Spray, sight: Sight, times: impl Fn(usize) -> usize, most: usize) -> f64 {
    let mut ends: Vec<f32> = Vec::with_capacity(spray.len());
    for index in 0..spray.len() {
        let (pixels, chance) = seen(spray, index, sight);
        ends.extend(std::iter::repeat_n(vanishes_at(pixels, chance) as f32, times(index)));
    }
    if ends.len() <= most {
        return 0.0;
    }
    let out = ends.len() - most - 1;
    let (_, last, _) = ends.select_nth_unstable_by(out, f32::total_cmp);
    // The next number up, since this one was rounded: the one that must go is gone with it.
    f64::from(last.next_up())
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::{math::scramble, scene, state};

    /// A cloud of drops of several sizes, from one to a hundred metres from the eye.
    fn cloud(count: u64) -> Spray {
        let mut particles = state::Particles::default();
        for k in 0..count {
            let share = |salt: u64| (scramble(k ^ salt << 40) >> 40) as f64 / f64::from(1 << 24);
            particles.position.push([100.0 * share(1), 10.0 * share(2) - 5.0, 10.0 * share(3) - 5.0]);
            particles.velocity.push([0.0; 3]);
            particles.mass.push(1e-3 * (share(4) + 0.01));
            particles.age.push(0.0);
        }
        particles.id = Some((0..count).collect());
        Spray::build(&particles, &scene::Particles::default(), DVec3::ZERO)
    }

    const SIGHT: Sight = (DVec3::new(-1.0, 0.0, 0.0), 2e-3);

    #[test]
    fn the_mean_cover_is_one_at_any_size() {
        for pixels in [0.0009, 0.01, 0.1, 0.3, 0.44, 0.46, 0.499, 0.5, 3.0] {
            let count = 4_000_000;
            let mean = (0..count).map(|k| cover(pixels, 0.5, (f64::from(k) + 0.5) / f64::from(count))).sum::<f64>()
                / f64::from(count);
            assert!((mean - 1.0).abs() < 2e-3, "{pixels}: {mean}");
        }
        for nothing in [0.0, 1e-200, f64::NAN] {
            assert!(cover(nothing, 0.5, 0.3) <= 1.0 && vanishes_at(nothing, 0.3).is_nan() == nothing.is_nan());
        }
        assert_eq!((cover(0.1, 0.0, 0.9), cover(f64::INFINITY, 0.5, 0.9)), (1.0, 1.0));
    }

    #[test]
    fn what_is_too_faint_is_drawn_by_some_for_all() {
        for share in [0.01, 0.2, 0.39, 0.4, 0.9] {
            let count = 1_000_000;
            let at = |k: i32| strengthened(share, 0.4, (f64::from(k) + 0.5) / f64::from(count));
            let mean = (0..count).map(at).sum::<f64>() / f64::from(count);
            assert!((mean - 1.0).abs() < 2e-3, "{share}: {mean}");
            assert!((0..count).all(|k| share * at(k) <= f64::max(share, 0.4 + 1e-9)));
        }
    }

    #[test]
    fn a_thinned_set_has_the_cross_section_of_the_full_one() {
        let spray = cloud(200_000);
        let covers = covers(&spray, SIGHT, 1.0);
        let area = |index: usize| f64::from(spray.radius[index]).powi(2);
        let (mut full, mut thin) = (0.0, 0.0);
        for index in 0..spray.len() {
            full += area(index);
            thin += area(index) * f64::from(covers[index]);
        }
        let kept = covers.iter().filter(|cover| **cover > 0.0).count();
        assert!(kept < 60_000, "{kept}");
        assert!((thin / full - 1.0).abs() < 0.01, "{thin} for {full}");
        // Nobody becomes wider than the least radius.
        for index in 0..spray.len() {
            let (pixels, _) = seen(&spray, index, SIGHT);
            assert!(pixels * f64::from(covers[index]).sqrt() <= pixels.max(1.0) * 1.000_001);
        }
    }

    #[test]
    fn particles_fade_as_they_recede_and_never_come_back() {
        let mut last = vec![0.5; 64];
        for step in 0..20_000 {
            let pixels = 0.6 * 0.9997_f64.powi(step);
            for (number, last) in last.iter_mut().enumerate() {
                let drawn = pixels * cover(pixels, 0.5, (number as f64 + 0.5) / 64.0).sqrt();
                assert!(drawn <= 0.6 && (step == 0 || drawn <= f64::max(*last, 0.5) + 1e-9));
                // From the least radius to none no step is large, not even of the first to go: the fade is by area.
                assert!(step == 0 || (drawn * drawn - *last * *last).abs() < 0.03, "{pixels}: {last} to {drawn}");
                *last = drawn;
            }
        }
        assert!(last.iter().filter(|drawn| **drawn > 0.0).count() <= 2);
    }

    #[test]
    fn a_count_is_kept_to_by_the_least_radius() {
        let spray = cloud(20_000);
        let drawn = |least: f64| covers(&spray, SIGHT, least).iter().filter(|cover| **cover > 0.0).count();
        for most in [0, 1, 137, 10_000, 19_999] {
            let count = drawn(least_for(&spray, SIGHT, |_| 1, most));
            assert!(count <= most && count + 2 > most, "{count} for {most}");
        }
        assert_eq!(least_for(&spray, SIGHT, |_| 1, 20_000), 0.0);
        let twice = drawn(least_for(&spray, SIGHT, |_| 2, 10_000));
        assert!((4_998..=5_000).contains(&twice), "{twice}");
    }
}
