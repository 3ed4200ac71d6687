//! What water takes from light on its way. Scattering is not here.

use glam::Vec3;

/// Share of light that is left after `distance` metres of a medium with `absorption` per metre (Beer-Lambert).
///
/// 1 at distance 0 whatever the absorption; without absorption 1 at any distance, infinite ones too.
#[inline]
pub fn transmittance(absorption: Vec3, distance: f32) -> Vec3 {
    // 0 * inf would be NaN: a clear channel stays clear over any distance.
    let depth = |a: f32| if a == 0.0 || distance == 0.0 { 1.0 } else { (-a * distance).exp() };
    Vec3::new(depth(absorption.x), depth(absorption.y), depth(absorption.z))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn ten_metres_of_water_leave_green_and_blue() {
        let t = transmittance(Vec3::new(0.34, 0.05, 0.009), 10.0);
        assert!((t - Vec3::new(0.033_373_27, 0.606_530_66, 0.913_931_2)).length() < 1e-6);
    }

    #[test]
    fn limits_are_clean() {
        assert_eq!(transmittance(Vec3::splat(0.3), 0.0), Vec3::ONE);
        assert_eq!(transmittance(Vec3::ZERO, f32::INFINITY), Vec3::ONE);
        assert_eq!(transmittance(Vec3::new(0.0, 1e-9, 1.0), f32::INFINITY), Vec3::X);
        assert_eq!(transmittance(Vec3::splat(f32::MAX), 0.0), Vec3::ONE);
    }

    proptest! {
        #[test]
        fn two_legs_multiply(a in 0.0f32..5.0, x in 0.0f32..5.0, y in 0.0f32..5.0) {
            let a = Vec3::splat(a);
            let whole = transmittance(a, x + y);
            prop_assert!((transmittance(a, x) * transmittance(a, y) - whole).abs().max_element() <= 1e-5 * whole.x + 1e-30);
        }
    }
}
