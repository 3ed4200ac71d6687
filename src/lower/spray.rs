//! Particles → parts: what each class of spray is drawn as.

use std::ops::Range;
use std::sync::Arc;

use glam::{DVec3, Vec3};

use super::{Discs, LowerError, Material, Shape, Spheres, Triangles};
use crate::particles::{self, Class, Judged, Spray};
use crate::scene::{DropMatter, ParticleRepresentation, Scene};
use crate::state::Frame;
use crate::surface::SplineSurface;

/// Metres that a place lies under the water's surface; negative above it and where there is none.
fn depth(water: Option<&SplineSurface>, place: Vec3) -> f32 {
    let level = water.and_then(|water| water.height(place.x, place.z));
    level.map_or(f32::NEG_INFINITY, |level| level - place.y)
}

/// The particles that are drawn, sorted by class where the scene leaves the choice to them.
pub(super) fn gather(scene: &Scene, frame: &Frame, origin: DVec3, water: Option<&SplineSurface>) -> Spray {
    let settings = &scene.particles;
    if settings.representation == ParticleRepresentation::None {
        return Spray::default();
    }
    let spray = Spray::build(&frame.particles, settings, origin);
    if settings.representation != ParticleRepresentation::Auto {
        return spray;
    }
    let exposure = (scene.camera.shutter / scene.frames.fps) as f32;
    let judged = Judged { position: &spray.position, velocity: &spray.velocity, radius: &spray.radius, exposure };
    let shares = particles::shares(&judged, &settings.classes, |place| depth(water, place));
    spray.sorted(&shares)
}

/// The parts of a spray, each by its class's name. `eye` (local frame, m) is what billboards face.
pub(super) fn parts(
    scene: &Scene,
    spray: &Spray,
    eye: Option<Vec3>,
    water: Option<&SplineSurface>,
    add: &mut impl FnMut(&str, Material, Shape),
) -> Result<(), LowerError> {
    let mut balls = |class: Class, range: Range<usize>| {
        if range.is_empty() {
            return;
        }
        // Air in water stays bright: a bubble is no drop.
        let water = scene.particles.matter == DropMatter::Water && class != Class::Bubble;
        let spray_material = Material::Spray { first: range.start as u32 };
        let (center, radius) = (spray.position[range.clone()].to_vec(), spray.radius[range.clone()].to_vec());
        let (material, shape) = match (scene.particles.representation, eye) {
            (ParticleRepresentation::Billboards, Some(eye)) => {
                let normal = particles::facing(spray, eye).normal[range].to_vec();
                (spray_material, Shape::Discs(Arc::new(Discs { center, radius, normal })))
            }
            _ => {
                let material = if water { Material::Sheet } else { spray_material };
                (material, Shape::Spheres(Arc::new(Spheres { center, radius })))
            }
        };
        add(class.name(), material, shape);
    };
    let joined = if scene.particles.representation == ParticleRepresentation::Surface {
        0..spray.len()
    } else {
        spray.of(Class::Sheet)
    };
    if scene.particles.representation != ParticleRepresentation::Surface {
        for class in [Class::Drop, Class::Streak, Class::Mist, Class::Bubble] {
            balls(class, spray.of(class));
        }
    }
    // What is under water is water already.
    let drops: Vec<usize> = joined.filter(|&index| depth(water, spray.position[index]) <= 0.0).collect();
    if !drops.is_empty() {
        let position: Vec<Vec3> = drops.iter().map(|&index| spray.position[index]).collect();
        let radius: Vec<f32> = drops.iter().map(|&index| spray.radius[index]).collect();
        let sheet = particles::sheet(&position, particles::mean_radius(&radius), &scene.particles.sheet)?;
        let particles::Sheet { position, normal, index } = sheet;
        let triangles = Triangles { position, normal, index };
        add(Class::Sheet.name(), Material::Sheet, Shape::Triangles(Arc::new(triangles)));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lower::{Environment, lower};
    use crate::simd::SimdLevel;
    use crate::state::{Columns, Particles};

    /// Level water a metre deep, with one particle of every kind: a drop, a streak, mist, a bubble, and a crowd.
    fn frame() -> Frame {
        let (nx, nz) = (8, 8);
        let columns = Columns {
            origin: [0.0; 2],
            width: [0.5; 2],
            nx,
            nz,
            base: vec![0.0; nx * nz],
            top: vec![1.0; nx * nz],
            pressure: vec![0.0; nx * nz],
            flow: vec![[0.0; 2]; nx * nz],
        };
        let drop = |radius: f64| 4.0 / 3.0 * std::f64::consts::PI * radius.powi(3) * 1000.0;
        let mut particles = Particles {
            position: vec![[1.0, 3.0, 1.0], [2.0, 3.0, 1.0], [1.0, 3.0, 2.0], [2.0, 0.5, 2.0]],
            velocity: vec![[0.0; 3], [6.0, 0.0, 0.0], [0.0; 3], [0.0; 3]],
            mass: vec![drop(0.01), drop(0.01), drop(0.0002), drop(0.01)],
            age: vec![0.0; 4],
            id: None,
        };
        for k in 0..512 {
            let place = [k % 8, k / 8 % 8, k / 64].map(|step| 2.5 + 0.016 * f64::from(step));
            particles.position.push(place);
            particles.velocity.push([0.0; 3]);
            particles.mass.push(drop(0.01));
            particles.age.push(0.0);
        }
        Frame { columns, particles, ..Frame::default() }
    }

    fn parts_of(representation: ParticleRepresentation, matter: DropMatter) -> Vec<(String, Material, usize)> {
        let mut scene = Scene::default();
        (scene.particles.representation, scene.particles.matter) = (representation, matter);
        let lowered = lower(&scene, &frame(), &Environment::default(), None, SimdLevel::Portable).unwrap();
        let spray = lowered
            .lowered
            .parts
            .into_iter()
            .filter(|part| matches!(part.material, Material::Spray { .. } | Material::Sheet));
        spray
            .map(|part| {
                let count = match &part.shape {
                    Shape::Spheres(spheres) => spheres.center.len(),
                    Shape::Triangles(mesh) => mesh.index.len(),
                    _ => 0,
                };
                (part.name, part.material, count)
            })
            .collect()
    }

    #[test]
    fn every_class_is_a_part_of_its_own_name() {
        let parts = parts_of(ParticleRepresentation::Auto, DropMatter::Diffuse);
        let names: Vec<&str> = parts.iter().map(|(name, ..)| name.as_str()).collect();
        assert_eq!(names, ["spray", "streaks", "mist", "bubbles", "sheet"]);
        let mut first = 0;
        for (name, material, count) in &parts[..4] {
            let Material::Spray { first: begins } = *material else { panic!("{name}") };
            assert!(begins >= first && *count > 0, "{name}");
            first = begins + *count as u32;
        }
        // The crowd's edge is on its way between drops and sheet, its middle is all sheet.
        assert!(parts[0].2 < 500 && parts[4].2 > 100, "{parts:?}");
    }

    #[test]
    fn drops_may_be_of_water_and_all_may_be_joined() {
        let water = parts_of(ParticleRepresentation::Spheres, DropMatter::Water);
        assert!(matches!(&water[..], [(name, Material::Sheet, 516)] if name == "spray"), "{water:?}");
        let joined = parts_of(ParticleRepresentation::Surface, DropMatter::Diffuse);
        assert!(matches!(&joined[..], [(name, Material::Sheet, 1000..)] if name == "sheet"), "{joined:?}");
    }
}
