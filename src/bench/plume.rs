//! Measured spray: plumes of droplets over a map of 400x400 columns, and the rays that look for them.
//!
//! Lengths are columns of width 1. The generator is seeded: the same droplets and rays on every machine.

use glam::{DVec3, Vec3};

use super::work::{self, Random};
use crate::accel::RayBatch;
use crate::lower::{Discs, Spheres};

/// Sides of the map that the plumes stand on, in columns.
pub const MAP: [usize; 2] = [400, 400];

/// Classes of rays that are asked of particles.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PlumeRays {
    /// A camera's, as over the water.
    Primary,
    /// Uniform directions from near droplets.
    Incoherent,
    /// The same, any hit.
    Occlusion,
}

impl PlumeRays {
    /// Every class, in the table's order.
    pub const ALL: [Self; 3] = [Self::Primary, Self::Incoherent, Self::Occlusion];

    /// Name in tables and files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Primary => "primary",
            Self::Incoherent => "incoherent",
            Self::Occlusion => "occlusion",
        }
    }
}

/// `count` droplets in 48 plumes: each a jet that is thrown up and along, its droplets scattered over their flight.
///
/// Radii are 0.03 to 0.12 columns (drops of 0.02 to 0.9 kg/m3 of spray over half-metre columns), small ones more often.
pub fn spheres(count: usize) -> Spheres {
    let mut random = Random::new(21);
    let jets: Vec<(DVec3, DVec3)> = (0..48)
        .map(|_| {
            let foot = DVec3::new(random.within(30.0, 370.0), 0.0, random.within(30.0, 370.0));
            let turn = random.direction();
            (foot, DVec3::new(8.0 * turn.x, random.within(8.0, 22.0), 8.0 * turn.z))
        })
        .collect();
    let mut spheres = Spheres::default();
    for k in 0..count {
        let (foot, jet) = jets[k % jets.len()];
        // Half of them in the first third of their flight, where a plume is dense.
        let age = 3.0 * random.unit().powf(1.6);
        let velocity = jet + random.direction() * (0.25 * jet.length() * random.unit());
        let place = foot + velocity * age - DVec3::Y * (0.5 * 9.81 * age * age).min(0.95 * velocity.y.max(0.0) * age);
        spheres.center.push(place.as_vec3());
        spheres.radius.push((0.03 + 0.09 * random.unit().powi(3)) as f32);
    }
    spheres
}

/// The same droplets as discs that face the camera of [`PlumeRays::Primary`].
pub fn discs(spheres: &Spheres) -> Discs {
    let eye = work::eye(MAP.map(|n| n as f64)).as_vec3();
    let normal = spheres.center.iter().map(|&center| (eye - center).normalize_or(Vec3::Y)).collect();
    Discs { center: spheres.center.clone(), radius: spheres.radius.clone(), normal: Some(normal) }
}

/// The rays of a class, `share` of the full count.
pub fn rays(class: PlumeRays, spheres: &Spheres, share: f64) -> RayBatch {
    if class == PlumeRays::Primary {
        return work::camera_rays(MAP.map(|n| n as f64), share);
    }
    let mut random = Random::new(22);
    let mut batch = RayBatch::default();
    for _ in 0..(1e6 * share).ceil() as usize {
        let droplet = (random.unit() * spheres.center.len() as f64) as usize;
        let away = 0.2 + 15.0 * random.unit().powi(2);
        let origin = spheres.center[droplet].as_dvec3() + random.direction() * away;
        batch.push(origin.as_vec3(), random.direction().as_vec3(), 0.0, f32::INFINITY, 1e-6);
    }
    batch
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn plumes_stand_over_the_map_and_are_the_same_every_time() {
        let spray = spheres(5000);
        assert_eq!(spray.center, spheres(5000).center);
        let high = spray.center.iter().filter(|center| center.y > 5.0).count();
        assert!((500..4500).contains(&high), "{high}");
        for (center, radius) in spray.center.iter().zip(&spray.radius) {
            assert!(center.y >= 0.0 && (-50.0..450.0).contains(&center.x) && (-50.0..450.0).contains(&center.z));
            assert!((0.03..=0.12).contains(radius));
        }
    }
}
