//! Discs that face the eye (the report's 3.2.3): orthogonal to the line from particle to eye.

use glam::Vec3;

use super::Spray;

/// Normals of a spray's discs, as seen from one eye.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Facing {
    /// Unit normals, one per particle of the spray, towards the eye.
    pub normal: Vec<Vec3>,
    /// Particles so near the eye that no direction is left; their discs lie level.
    pub at_eye: u64,
}

/// Turns every particle of a spray to the eye (local frame).
pub fn facing(spray: &Spray, eye: Vec3) -> Facing {
    let mut at_eye = 0;
    let normal = spray
        .position
        .iter()
        .map(|&position| {
            // Double precision, where neither far particles overflow nor near ones underflow when squared.
            (eye.as_dvec3() - position.as_dvec3()).try_normalize().map_or_else(
                || {
                    at_eye += 1;
                    Vec3::Y
                },
                |direction| direction.as_vec3(),
            )
        })
        .collect();
    Facing { normal, at_eye }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[allow(clippy::field_reassign_with_default)] // The packed look is private to the store.
    fn spray(position: Vec<Vec3>) -> Spray {
        let mut spray = Spray::default();
        spray.position = position;
        spray
    }

    #[test]
    fn discs_stand_square_to_the_line_of_sight() {
        let eye = Vec3::new(3.0, 2.0, -1.0);
        let places = vec![Vec3::ZERO, Vec3::new(3.0, 1.0, -1.0), Vec3::splat(1e-30), Vec3::splat(3e38)];
        let turned = facing(&spray(places.clone()), eye);
        assert_eq!(turned.at_eye, 0);
        assert_eq!(turned.normal[1], Vec3::Y);
        for (normal, place) in turned.normal.iter().zip(places) {
            assert!((normal.length() - 1.0).abs() < 1e-6);
            let line = (eye.as_dvec3() - place.as_dvec3()).normalize().as_vec3();
            assert!(normal.dot(line) > 1.0 - 1e-6);
        }
    }

    #[test]
    fn a_particle_in_the_eye_is_counted_and_lies_level() {
        let eye = Vec3::new(1.0, 2.0, 3.0);
        let turned = facing(&spray(vec![eye, Vec3::ZERO]), eye);
        assert_eq!((turned.at_eye, turned.normal[0]), (1, Vec3::Y));
    }
}
