//! Panels and spheres of the model file, checked and ready to be lowered.

use glam::{DVec3, Vec3};

use crate::state;

use super::{Mesh, MeshAlbedo, TerrainError};

/// A sphere in the local frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ball {
    /// Centre (m).
    pub center: Vec3,
    /// Radius (m), positive.
    pub radius: f32,
    /// Linear albedo.
    pub albedo: Vec3,
}

/// Two triangles for a quadrilateral, counter-clockwise seen from outside like its corners.
///
/// It is cut along the diagonal whose halves agree better, so that a quadrilateral with an inward corner keeps its shape.
///
/// # Errors
/// Corners that span no area.
pub fn panel(panel: &state::Panel) -> Result<Mesh, TerrainError> {
    let corner = panel.corners.map(DVec3::from_array);
    let halves = |first: usize| {
        let [a, b, c, d] = [0, 1, 2, 3].map(|i| corner[(first + i) % 4]);
        ((b - a).cross(c - a), (c - a).cross(d - a))
    };
    let agreement = |(one, other): (DVec3, DVec3)| one.normalize_or_zero().dot(other.normalize_or_zero());
    let first = if agreement(halves(1)) > agreement(halves(0)) { 1 } else { 0 };
    let (one, other) = halves(first);
    let area = (one + other).length();
    // Written so that corners which are not numbers are refused too.
    if area.is_nan() || area == 0.0 {
        return Err(TerrainError::FlatPanel { corners: panel.corners });
    }
    let [a, b, c, d] = [0, 1, 2, 3].map(|i| (first + i) as u32 % 4);
    Ok(Mesh {
        position: corner.to_vec(),
        normal: Vec::new(),
        index: vec![[a, b, c], [a, c, d]],
        albedo: MeshAlbedo::Uniform(Vec3::from_array(panel.albedo.map(|value| value as f32))),
        images: None,
    })
}

/// A sphere of the model file around `origin`.
///
/// # Errors
/// A radius that is not a finite number above 0, in the file or in single precision.
pub fn ball(sphere: &state::Sphere, origin: DVec3) -> Result<Ball, TerrainError> {
    let radius = sphere.radius as f32;
    if !(radius > 0.0 && radius.is_finite()) {
        return Err(TerrainError::Sphere { center: sphere.center, radius: sphere.radius });
    }
    Ok(Ball {
        center: (DVec3::from_array(sphere.center) - origin).as_vec3(),
        radius,
        albedo: Vec3::from_array(sphere.albedo.map(|value| value as f32)),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn quad(corners: [[f64; 3]; 4]) -> state::Panel {
        state::Panel { corners, albedo: [0.1, 0.2, 0.3] }
    }

    fn area_normal(mesh: &Mesh) -> Vec<DVec3> {
        let p = |i: u32| mesh.position[i as usize];
        mesh.index.iter().map(|&[a, b, c]| (p(b) - p(a)).cross(p(c) - p(a)) * 0.5).collect()
    }

    #[test]
    fn a_floor_faces_up_and_keeps_its_area() {
        // Counter-clockwise seen from above, y up: north-west, south-west, south-east, north-east.
        let mesh = panel(&quad([[0.0, 1.0, 0.0], [0.0, 1.0, 3.0], [2.0, 1.0, 3.0], [2.0, 1.0, 0.0]])).unwrap();
        let normals = area_normal(&mesh);
        assert_eq!(normals.len(), 2);
        assert!(normals.iter().all(|n| n.y > 0.0));
        assert_eq!(normals.iter().sum::<DVec3>(), DVec3::new(0.0, 6.0, 0.0));
        assert_eq!(mesh.albedo, MeshAlbedo::Uniform(Vec3::new(0.1, 0.2, 0.3)));
    }

    #[test]
    fn an_inward_corner_stays_inward() {
        // An arrowhead: cutting it along the wrong diagonal would turn one half over.
        let arrow = [[0.0, 0.0, 0.0], [2.0, 0.0, -1.0], [0.5, 0.0, 0.0], [2.0, 0.0, 1.0]];
        for turn in 0..4 {
            let mut corners = arrow;
            corners.rotate_left(turn);
            let normals = area_normal(&panel(&quad(corners)).unwrap());
            assert!(normals[0].dot(normals[1]) > 0.0, "{turn}");
        }
    }

    #[test]
    fn nothing_is_no_panel_and_no_sphere() {
        let line = quad([[0.0; 3], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0], [3.0, 0.0, 0.0]]);
        assert!(matches!(panel(&line), Err(TerrainError::FlatPanel { .. })));
        for radius in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e-300, 1e300] {
            let sphere = state::Sphere { center: [0.0; 3], radius, albedo: [0.5; 3] };
            assert!(ball(&sphere, DVec3::ZERO).is_err(), "{radius}");
        }
    }

    #[test]
    fn a_distant_boulder_keeps_its_place() {
        let sphere = state::Sphere { center: [4e6 + 0.125, 2.0, 5e5], radius: 0.5, albedo: [0.5; 3] };
        let ball = ball(&sphere, DVec3::new(4e6, 0.0, 5e5)).unwrap();
        assert_eq!((ball.center, ball.radius), (Vec3::new(0.125, 2.0, 0.0), 0.5));
    }
}
