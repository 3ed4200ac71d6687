//! The first representation: the report's flat quadrilaterals between column centres (section 2.1).
//!
//! A strip ends at a column with less water than the threshold, as in the report: a quadrilateral needs four wet
//! corners. Each is flat-shaded by the cross product of two adjacent edges, so its two triangles share one normal.

use glam::{DVec3, Vec3};

use super::control;
use super::tessellate::SurfaceMesh;
use crate::state::Columns;

/// Quadrilaterals over the wet columns, in the local frame around `origin`, counter-clockwise seen from above.
pub fn strips(columns: &Columns, dry_threshold: f64, origin: DVec3) -> SurfaceMesh {
    let wet = control::wet(columns, dry_threshold);
    let corner = |x: usize, z: usize| {
        let index = z * columns.nx + x;
        let at = DVec3::new(
            columns.origin[0] + columns.width[0] * x as f64,
            columns.top[index],
            columns.origin[1] + columns.width[1] * z as f64,
        );
        (at - origin).as_vec3()
    };
    let mut mesh = SurfaceMesh::default();
    for z in 0..columns.nz - 1 {
        for x in 0..columns.nx - 1 {
            let at = [(x, z), (x, z + 1), (x + 1, z + 1), (x + 1, z)];
            if !at.iter().all(|&(x, z)| wet[z * columns.nx + x]) {
                continue;
            }
            let first = mesh.position.len() as u32;
            let corners = at.map(|(x, z)| corner(x, z));
            let normal = (corners[1] - corners[0]).cross(corners[3] - corners[0]).normalize_or(Vec3::Y);
            mesh.position.extend(corners);
            mesh.normal.extend([normal; 4]);
            mesh.index.push([first, first + 1, first + 2]);
            mesh.index.push([first, first + 2, first + 3]);
        }
    }
    mesh
}

#[cfg(test)]
mod tests {
    use super::super::control::tests::lake;
    use super::*;

    #[test]
    fn strips_lie_between_wet_centres_only() {
        let mesh = strips(&lake(), 1e-3, DVec3::new(0.0, 1.0, 0.0));
        // Six by seven wet columns have five by six quadrilaterals between them.
        assert_eq!(mesh.index.len(), 2 * 5 * 6);
        for position in &mesh.position {
            assert!(position.y == 0.0 && (0.5..=5.5).contains(&position.x) && (0.5..=6.5).contains(&position.z));
        }
        assert!(mesh.normal.iter().all(|&normal| normal == Vec3::Y));
    }

    #[test]
    fn the_threshold_decides_what_is_wet() {
        assert!(strips(&lake(), 1.5, DVec3::ZERO).index.is_empty());
    }
}
