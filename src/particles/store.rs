//! The spray of one frame, one array per field, around the scene's origin.

use glam::{DVec3, Vec3};

use crate::{math::scramble, scene, state};

use super::{Appearance, Class, Shares, appearance, radius, texture};

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
    /// Where each class begins, and after the last one where it ends; all are drops until they are sorted.
    first: [usize; 6],
    /// Factor on each opacity; empty where all are 1.
    share: Vec<f32>,
    /// What each texture goes by: seed and age (s). Empty where none is drawn.
    variation: Vec<(u32, f32)>,
    /// Particles left out because their radius is 0 (no mass, or a scale of 0).
    pub without_size: u64,
    /// Particles left out because their position, velocity or radius is beyond single precision.
    pub out_of_range: u64,
}

/// A number that a particle keeps over all frames: of its id, or of its mass where files have none.
fn particle_seed(particles: &state::Particles, index: usize) -> u32 {
    let own = particles.id.as_ref().map_or(particles.mass[index].to_bits(), |id| id[index]);
    (scramble(own) >> 32) as u32
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
        let varied = texture::wanted(settings);
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
                if varied {
                    spray.variation.push((particle_seed(particles, index), particles.age[index] as f32));
                }
                spray.position.push(position);
                spray.velocity.push(velocity.as_vec3());
                spray.radius.push(size);
                spray
                    .look
                    .push(look.albedo.extend(look.opacity).to_array().map(|share| (share * 65535.0).round() as u16));
            }
        }
        spray.first = [0, spray.len(), spray.len(), spray.len(), spray.len(), spray.len()];
        spray
    }

    /// Sorts the particles by class. One that belongs to several stands in each, as opaque as its share there; in sheets from
    /// one half on. Mist is no particle any more.
    pub fn sorted(&self, shares: &[Shares]) -> Self {
        let mut sorted = Self { without_size: self.without_size, out_of_range: self.out_of_range, ..Self::default() };
        for class in Class::ALL {
            sorted.first[class as usize] = sorted.len();
            for (index, shares) in shares.iter().enumerate() {
                let share = shares[class as usize];
                let stands = match class {
                    Class::Mist => false,
                    // There are no halves of a surface; what a particle is besides still fades.
                    Class::Sheet => share >= 0.5,
                    Class::Drop | Class::Streak | Class::Bubble => share > 0.0,
                };
                if stands {
                    let [r, g, b, opacity] = self.look[index];
                    sorted.position.push(self.position[index]);
                    sorted.velocity.push(self.velocity[index]);
                    sorted.radius.push(self.radius[index]);
                    sorted.look.push([r, g, b, (f32::from(opacity) * share).round() as u16]);
                }
            }
        }
        sorted.first[Class::ALL.len()] = sorted.len();
        sorted
    }

    /// The particles of a class.
    #[inline]
    pub fn of(&self, class: Class) -> std::ops::Range<usize> {
        self.first[class as usize]..self.first[class as usize + 1]
    }

    /// Sets a factor (0..1) on the opacity of the particles from `first` on: for shapes that were made wider than the
    /// particle.
    pub fn set_shares(&mut self, first: usize, shares: &[f32]) {
        self.share.resize(self.len(), 1.0);
        self.share[first..first + shares.len()].copy_from_slice(shares);
    }

    /// Some of the particles, as drops.
    pub fn part(&self, range: std::ops::Range<usize>) -> Self {
        let share = if self.share.is_empty() { Vec::new() } else { self.share[range.clone()].to_vec() };
        let end = range.len();
        Self {
            position: self.position[range.clone()].to_vec(),
            velocity: self.velocity[range.clone()].to_vec(),
            radius: self.radius[range.clone()].to_vec(),
            look: self.look[range].to_vec(),
            share,
            first: [0, end, end, end, end, end],
            ..Self::default()
        }
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

    /// Seed and age (s) of particle `index`, where the spray was built for billboards with a texture.
    #[inline]
    pub fn variation(&self, index: usize) -> Option<(u32, f32)> {
        self.variation.get(index).copied()
    }

    /// Bytes held.
    pub fn bytes(&self) -> u64 {
        let each = 2 * size_of::<Vec3>() + size_of::<f32>() + size_of::<[u16; 4]>();
        (self.len() * each + size_of_val(&*self.share) + size_of_val(&*self.variation)) as u64
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
    fn a_particle_of_two_classes_stands_in_both_by_its_shares() {
        let mut particles = three();
        particles.mass[1] = 0.25;
        let spray = Spray::build(&particles, &scene::Particles::default(), DVec3::new(500_000.0, 10.0, 4_000_000.0));
        assert_eq!((spray.of(Class::Drop), spray.of(Class::Bubble)), (0..3, 3..3));
        let half = [0.25, 0.0, 0.0, 0.0, 0.75];
        let sorted = spray.sorted(&[half, [0.0, 1.0, 0.0, 0.0, 0.0], [0.6, 0.0, 0.0, 0.4, 0.0]]);
        assert_eq!((sorted.of(Class::Drop), sorted.of(Class::Streak), sorted.of(Class::Bubble)), (0..2, 2..3, 3..4));
        assert!(sorted.of(Class::Sheet).is_empty());
        assert_eq!([0, 2, 3].map(|place| sorted.position[place]), [0, 1, 0].map(|index| spray.position[index]));
        let opacity = |spray: &Spray, place: usize| spray.appearance(place).opacity;
        assert!((opacity(&sorted, 0) + opacity(&sorted, 3) - opacity(&spray, 0)).abs() < 4e-5);
        assert!((opacity(&sorted, 0) / opacity(&spray, 0) - 0.25).abs() < 1e-4);
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
