//! The spray of one frame, one array per field, around the scene's origin.

use glam::{DVec3, Vec3};

use crate::{scene, state};

use super::{Appearance, appearance, radius};

/// Particles that can be drawn, in the order of the file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Spray {
    /// Centres in the local frame (m).
    pub position: Vec<Vec3>,
    /// Velocities (m/s).
    pub velocity: Vec<Vec3>,
    /// Radii (m), positive.
    pub radius: Vec<f32>,
    /// Albedo and opacity in 65535ths.
    look: Vec<[u16; 4]>,
    /// Factor on each opacity; empty where all are 1.
    share: Vec<f32>,
    /// Particles left out because their radius is 0 (no mass, or a scale of 0).
    pub without_size: u64,
    /// Particles left out because their position, velocity or radius is beyond single precision.
    pub out_of_range: u64,
}

impl Spray {
    /// Takes over a frame's particles around `origin` (m, in the file's frame).
    pub fn build(particles: &state::Particles, settings: &scene::Particles, origin: DVec3) -> Self {
        let count = particles.position.len();
        let mut spray = Self {
            position: Vec::with_capacity(count),
            velocity: Vec::with_capacity(count),
            radius: Vec::with_capacity(count),
            look: Vec::with_capacity(count),
            ..Self::default()
        };
        for index in 0..count {
            let size = radius(particles.mass[index], settings.scale) as f32;
            let position = (DVec3::from_array(particles.position[index]) - origin).as_vec3();
            let velocity = DVec3::from_array(particles.velocity[index]);
            if size == 0.0 {
                spray.without_size += 1;
            } else if !(size.is_finite() && position.is_finite() && velocity.as_vec3().is_finite()) {
                spray.out_of_range += 1;
            } else {
                let look = appearance(velocity.length(), particles.age[index], settings);
                spray.position.push(position);
                spray.velocity.push(velocity.as_vec3());
                spray.radius.push(size);
                spray
                    .look
                    .push(look.albedo.extend(look.opacity).to_array().map(|share| (share * 65535.0).round() as u16));
            }
        }
        spray
    }

    /// With a factor (0..1) on each particle's opacity, as many as particles: for shapes that were made wider than the
    /// particle. `out_of_range` more are left out.
    pub fn with_shares(self, share: Vec<f32>, out_of_range: u64) -> Self {
        Self { share, out_of_range: self.out_of_range + out_of_range, ..self }
    }

    /// Count of particles that can be drawn.
    #[inline]
    pub fn len(&self) -> usize {
        self.radius.len()
    }

    /// True for none.
    #[inline]
    pub fn is_empty(&self) -> bool {
        self.radius.is_empty()
    }

    /// Colour and opacity of particle `index`, within 1/131070 of what [`appearance()`] says, times its share.
    #[inline]
    pub fn appearance(&self, index: usize) -> Appearance {
        let [r, g, b, opacity] = self.look[index].map(|share| f32::from(share) * (1.0 / 65535.0));
        let share = self.share.get(index).copied().unwrap_or(1.0);
        Appearance { albedo: Vec3::new(r, g, b), opacity: opacity * share }
    }

    /// Bytes held.
    pub fn bytes(&self) -> u64 {
        let each = 2 * size_of::<Vec3>() + size_of::<f32>() + size_of::<[u16; 4]>();
        (self.len() * each + size_of_val(&*self.share)) as u64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn three() -> state::Particles {
        state::Particles {
            position: vec![[500_000.25, 12.0, 4_000_000.5], [500_001.0, 12.0, 4_000_001.0], [0.0; 3]],
            velocity: vec![[1.0, 2.0, -2.0], [0.0; 3], [0.0; 3]],
            mass: vec![0.5, 0.0, 1.0],
            age: vec![0.5, 0.0, 0.0],
            id: None,
        }
    }

    #[test]
    fn distant_particles_keep_their_places_around_the_origin() {
        let settings = scene::Particles::default();
        let spray = Spray::build(&three(), &settings, DVec3::new(500_000.0, 10.0, 4_000_000.0));
        assert_eq!(spray.len(), 2);
        assert_eq!(spray.without_size, 1);
        assert_eq!(spray.position[0], Vec3::new(0.25, 2.0, 0.5));
        assert_eq!(spray.velocity[0], Vec3::new(1.0, 2.0, -2.0));
        assert!((spray.radius[0] - radius(0.5, 1.0) as f32).abs() < 1e-9);
        let (packed, exact) = (spray.appearance(0), appearance(3.0, 0.5, &settings));
        assert!((packed.albedo - exact.albedo).abs().max_element() < 8e-6);
        assert!((packed.opacity - exact.opacity).abs() < 8e-6);
        assert_eq!(spray.bytes(), 2 * 36);
    }

    #[test]
    fn what_cannot_be_drawn_is_counted() {
        let mut particles = three();
        particles.mass[0] = 1e300;
        particles.position[2] = [1e300, 0.0, 0.0];
        let spray = Spray::build(&particles, &scene::Particles::default(), DVec3::ZERO);
        assert!(spray.is_empty());
        assert_eq!((spray.without_size, spray.out_of_range), (1, 2));
        let none = Spray::build(&three(), &scene::Particles { scale: 0.0, ..Default::default() }, DVec3::ZERO);
        assert_eq!((none.len(), none.without_size), (0, 3));
    }
}
