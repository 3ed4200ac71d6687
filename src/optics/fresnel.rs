//! Mirror, refraction and reflectance at the border of two dielectrics.
//!
//! The normal always stands on the side that the light comes from. Unpolarised light, real indices. The report's
//! refraction formula (its section 4.2) lacks the normal in its last term, and its Schlick takes the wrong cosine inside
//! water; both are right here.

use glam::Vec3;

/// Reflectance of unpolarised light at a smooth dielectric border.
///
/// `cos_incident` is the cosine between the normal and the way back to where the light comes from, 0..1 (values outside by
/// rounding are taken as the nearest of these); `eta_from` and `eta_to` are the indices on the incident and the far side.
/// 1 at total internal reflection, 0 between equal indices.
///
/// Source: Born and Wolf, Principles of Optics, section 1.5.2, mean of the two polarisations.
#[inline]
pub fn reflectance_exact(cos_incident: f32, eta_from: f32, eta_to: f32) -> f32 {
    if eta_from == eta_to {
        return 0.0;
    }
    let cos_incident = cos_incident.clamp(0.0, 1.0);
    let Some(cos_transmitted) = cos_transmitted(cos_incident, eta_from / eta_to) else { return 1.0 };
    let across =
        (eta_from * cos_incident - eta_to * cos_transmitted) / (eta_from * cos_incident + eta_to * cos_transmitted);
    let along =
        (eta_to * cos_incident - eta_from * cos_transmitted) / (eta_to * cos_incident + eta_from * cos_transmitted);
    0.5 * (across * across + along * along)
}

/// Schlick's approximation of [`reflectance_exact`].
///
/// From the denser side it takes the cosine of the transmitted ray, so that it meets 1 at the critical angle and stays
/// there. `r0` is the reflectance at normal incidence, by default ((a - b) / (a + b))^2.
///
/// Source: Schlick, An Inexpensive BRDF Model for Physically-based Rendering, 1994, eq. 15.
#[inline]
pub fn reflectance_schlick(cos_incident: f32, eta_from: f32, eta_to: f32, r0: Option<f32>) -> f32 {
    let cos_incident = cos_incident.clamp(0.0, 1.0);
    let cosine = if eta_from > eta_to {
        match cos_transmitted(cos_incident, eta_from / eta_to) {
            Some(cosine) => cosine,
            None => return 1.0,
        }
    } else {
        cos_incident
    };
    let r0 = r0.unwrap_or_else(|| {
        let root = (eta_from - eta_to) / (eta_from + eta_to);
        root * root
    });
    let x = 1.0 - cosine;
    let x2 = x * x;
    r0 + (1.0 - r0) * x2 * x2 * x
}

/// Direction of the mirrored ray: `d` arrives, `n` is the unit normal.
#[inline]
pub fn reflect(d: Vec3, n: Vec3) -> Vec3 {
    d - 2.0 * d.dot(n) * n
}

/// Unit direction of the refracted ray, or `None` at total internal reflection.
///
/// `d` arrives (unit), `n` is the unit normal on the incident side, so that d.n <= 0.
#[inline]
pub fn refract(d: Vec3, n: Vec3, eta_from: f32, eta_to: f32) -> Option<Vec3> {
    let ratio = eta_from / eta_to;
    let cos_incident = (-d.dot(n)).clamp(0.0, 1.0);
    let cos_transmitted = cos_transmitted(cos_incident, ratio)?;
    // Rounding in d and n leaves a length off by a few ulp; over many bounces that would add up.
    Some((ratio * d + (ratio * cos_incident - cos_transmitted) * n).normalize())
}

/// Cosine of the refracted ray with the inward normal, by Snell's law; `None` beyond the critical angle.
#[inline]
fn cos_transmitted(cos_incident: f32, ratio: f32) -> Option<f32> {
    let sin2 = ratio * ratio * ((1.0 - cos_incident) * (1.0 + cos_incident));
    if sin2 > 1.0 { None } else { Some((1.0 - sin2).sqrt()) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    use std::f32::consts::{FRAC_PI_2 as QUARTER, TAU as TURN};

    const WATER: f32 = 1.333;

    fn unit(theta: f32, phi: f32) -> Vec3 {
        Vec3::new(theta.sin() * phi.cos(), theta.cos(), theta.sin() * phi.sin())
    }

    #[test]
    fn normal_incidence_is_the_textbook_square() {
        let expected = ((WATER - 1.0) / (WATER + 1.0)).powi(2);
        for (from, to) in [(1.0, WATER), (WATER, 1.0)] {
            assert!((reflectance_exact(1.0, from, to) - expected).abs() < 1e-7);
            assert!((reflectance_schlick(1.0, from, to, None) - expected).abs() < 1e-7);
        }
        assert_eq!(reflectance_schlick(1.0, 1.0, WATER, Some(0.3)), 0.3);
    }

    #[test]
    fn grazing_light_is_all_reflected() {
        for (from, to) in [(1.0, WATER), (WATER, 1.0)] {
            assert_eq!(reflectance_exact(0.0, from, to), 1.0);
            assert_eq!(reflectance_schlick(0.0, from, to, None), 1.0);
        }
        assert!(reflectance_exact(1e-4, 1.0, WATER) > 0.999);
    }

    #[test]
    fn parallel_polarisation_vanishes_at_brewsters_angle() {
        // There the mean is half of the other polarisation: ((n^2-1)/(n^2+1))^2 / 2.
        let n = f64::from(WATER);
        let cosine = (1.0 / (1.0 + n * n)).sqrt() as f32;
        let expected = (0.5 * ((n * n - 1.0) / (n * n + 1.0)).powi(2)) as f32;
        assert!((reflectance_exact(cosine, 1.0, WATER) - expected).abs() < 1e-6);
    }

    #[test]
    fn beyond_the_critical_angle_nothing_passes() {
        let critical = (1.0f32 / WATER).asin();
        let n = Vec3::Y;
        for (angle, passes) in [(critical - 1e-3, true), (critical + 1e-3, false), (1.5, false)] {
            let d = -unit(angle, 0.3);
            assert_eq!(refract(d, n, WATER, 1.0).is_some(), passes, "{angle}");
            assert_eq!(reflectance_exact(angle.cos(), WATER, 1.0) < 1.0, passes);
            assert_eq!(reflectance_schlick(angle.cos(), WATER, 1.0, None) < 1.0, passes);
        }
    }

    #[test]
    fn schlick_inside_water_follows_the_transmitted_cosine() {
        // Just under the critical angle nearly all is reflected; the incident cosine (0.66) would say 3 %.
        let angle = (1.0f32 / WATER).asin() - 1e-5;
        assert!(reflectance_schlick(angle.cos(), WATER, 1.0, None) > 0.9);
        // The reciprocal ray has the same reflectance.
        let inside = 0.5f32;
        let outside = (WATER * inside.sin()).asin();
        let a = reflectance_schlick(inside.cos(), WATER, 1.0, None);
        let b = reflectance_schlick(outside.cos(), 1.0, WATER, None);
        assert!((a - b).abs() < 1e-5);
    }

    #[test]
    fn equal_indices_are_no_border() {
        for cosine in [0.0, 1e-6, 0.5, 1.0] {
            assert_eq!(reflectance_exact(cosine, WATER, WATER), 0.0);
        }
        let d = -unit(1.2, 2.0);
        assert!((refract(d, Vec3::Y, WATER, WATER).unwrap() - d).length() < 1e-6);
    }

    #[test]
    fn straight_down_goes_straight_on() {
        assert_eq!(refract(-Vec3::Y, Vec3::Y, 1.0, WATER), Some(-Vec3::Y));
        assert_eq!(reflect(-Vec3::Y, Vec3::Y), Vec3::Y);
    }

    proptest! {
        #[test]
        fn refraction_obeys_snell_and_stays_in_the_plane(theta in 0.0f32..QUARTER, phi in 0.0f32..TURN,
            tilt in 0.0f32..3.1, turn in 0.0f32..TURN, from in 1.0f32..2.5, to in 1.0f32..2.5) {
            let n = unit(tilt, turn);
            let rotation = glam::Quat::from_rotation_arc(Vec3::Y, n);
            let d = -(rotation * unit(theta, phi));
            if let Some(t) = refract(d, n, from, to) {
                prop_assert!((t.length() - 1.0).abs() < 1e-6);
                prop_assert!(t.dot(n) <= 1e-6);
                // n1 (d x n) = n2 (t x n) is Snell's law and coplanarity at once.
                prop_assert!((from * d.cross(n) - to * t.cross(n)).length() < 3e-6 * to.max(from));
                // Where both cosines are well away from the edge, the way back is the way out: a cosine is the root of a
                // difference from 1, and what the sines' rounding leaves of it is divided by the cosine.
                if t.dot(n) < -0.05 && d.dot(n) < -0.05 {
                    let back = refract(-t, -n, to, from).unwrap();
                    prop_assert!((back + d).length() < 1e-4);
                }
            } else {
                prop_assert!(from / to * theta.sin() > 1.0 - 1e-5);
            }
        }

        #[test]
        fn mirroring_keeps_length_and_angle(theta in 0.0f32..QUARTER, phi in 0.0f32..TURN) {
            let d = -unit(theta, phi);
            let r = reflect(d, Vec3::Y);
            prop_assert!((r.length() - 1.0).abs() < 1e-6);
            prop_assert!((r.y + d.y).abs() < 1e-6 && (r.x - d.x).abs() < 1e-6 && (r.z - d.z).abs() < 1e-6);
        }

        #[test]
        fn reflectance_is_a_share_and_reciprocal(cosine in -0.1f32..1.1, from in 1.0f32..4.0, to in 1.0f32..4.0) {
            for r in [reflectance_exact(cosine, from, to), reflectance_schlick(cosine, from, to, None)] {
                prop_assert!((0.0..=1.0).contains(&r), "{r}");
            }
            let c = cosine.clamp(0.05, 1.0);
            let sin_to = from / to * (1.0 - c * c).sqrt();
            if sin_to < 0.99 {
                let back = reflectance_exact((1.0 - sin_to * sin_to).sqrt(), to, from);
                prop_assert!((reflectance_exact(c, from, to) - back).abs() < 1e-4);
            }
        }

        #[test]
        fn both_polarisations_conserve_energy(cosine in 0.01f32..1.0) {
            // T from its own formula (Born and Wolf 1.5.2, eq. 21), not as 1 - R.
            let (ci, n) = (f64::from(cosine), f64::from(WATER));
            let ct = (1.0 - (1.0 - ci * ci) / (n * n)).sqrt();
            let ts = 2.0 * ci / (ci + n * ct);
            let tp = 2.0 * ci / (n * ci + ct);
            let transmitted = n * ct / ci * 0.5 * (ts * ts + tp * tp);
            prop_assert!((f64::from(reflectance_exact(cosine, 1.0, WATER)) + transmitted - 1.0).abs() < 2e-6);
        }
    }
}
