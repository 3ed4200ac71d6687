//! The spray of one frame, one array per field, around the scene's origin.

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use crate::{math::scramble, scene, state};

use super::{Appearance, Class, Shares, appearance, radius, seed, size_factor, texture};

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
    /// Share of each particle of class sheet in it.
    sheet: Vec<f32>,
    /// What each is drawn by where chance decides (see [`seed()`]).
    seed: Vec<u32>,
    /// Factor on each cross section, for those that stand for their neighbours as well; empty where all are 1.
    cover: Vec<f32>,
    /// Part of its flight that each is drawn along as a streak; empty where all are drawn along all of it.
    stretch: Vec<f32>,
    /// Radius (m) by which each closes up with its neighbours as a streak; empty where none does.
    veil: Vec<f32>,
    /// Seconds since each broke free, by which textures go. Empty where none is drawn.
    age: Vec<f32>,
    /// Particles left out because their radius is 0 (no mass, or a scale of 0).
    pub without_size: u64,
    /// Particles left out because their position, velocity or radius is beyond single precision.
    pub out_of_range: u64,
    /// Particles not drawn since they are one with another: of the same place, velocity and size.
    pub coincident: u64,
    /// Particles not drawn since others stand for them, each counted in every class that it is of.
    pub thinned: u64,
}

impl Spray {
    /// Takes over the particles of a frame at no certain time around `origin` (m, in the file's frame).
    pub fn build(particles: &state::Particles, settings: &scene::Particles, origin: DVec3) -> Self {
        Self::build_at(0.0, particles, settings, origin)
    }

    /// Takes over a frame's particles around `origin` (m, in the file's frame); `time` (s) is the frame's.
    ///
    /// Radii are spread as `particles.size_spread` says. Particles of one place, velocity and size are one, as opaque as all of
    /// them: emitters may put a million there, and a ray would meet each.
    pub fn build_at(time: f64, particles: &state::Particles, settings: &scene::Particles, origin: DVec3) -> Self {
        let count = particles.position.len();
        let mut spray = Self {
            position: Vec::with_capacity(count),
            velocity: Vec::with_capacity(count),
            radius: Vec::with_capacity(count),
            look: Vec::with_capacity(count),
            seed: Vec::with_capacity(count),
            ..Self::default()
        };
        let varied = texture::wanted(settings);
        for index in 0..count {
            let own = seed(particles, index, time);
            let spread = size_factor(own, settings.size_spread);
            let size = (radius(particles.mass[index], settings.scale) * spread) as f32;
            let position = (DVec3::from_array(particles.position[index]) - origin).as_vec3();
            let velocity = DVec3::from_array(particles.velocity[index]);
            if size == 0.0 {
                spray.without_size += 1;
            } else if !(size.is_finite() && position.is_finite() && velocity.as_vec3().is_finite()) {
                spray.out_of_range += 1;
            } else {
                let look = appearance(velocity.length(), particles.age[index], settings);
                if varied {
                    spray.age.push(particles.age[index] as f32);
                }
                spray.position.push(position);
                spray.velocity.push(velocity.as_vec3());
                spray.radius.push(size);
                spray.seed.push(own);
                spray
                    .look
                    .push(look.albedo.extend(look.opacity).to_array().map(|share| (share * 65535.0).round() as u16));
            }
        }
        spray.join_coincident();
        spray.all_drops();
        spray
    }

    /// Nothing is sorted yet.
    fn all_drops(&mut self) {
        let end = self.len();
        self.first = [0, end, end, end, end, end];
    }

    /// Leaves one of all particles of the same place, velocity and size: the first, with the light that all of them stop.
    fn join_coincident(&mut self) {
        let bits = |vector: Vec3| vector.to_array().map(f32::to_bits);
        let hash = |index: usize| {
            let ([x, y, z], [u, v, w]) = (bits(self.position[index]), bits(self.velocity[index]));
            let pairs = [[x, y], [z, u], [v, w], [self.radius[index].to_bits(), 0]];
            let word = |[low, high]: [u32; 2]| u64::from(low) | u64::from(high) << 32;
            (pairs.into_iter().fold(0, |hash, pair| scramble(hash ^ word(pair))), index as u32)
        };
        let mut by_place: Vec<(u64, u32)> = (0..self.len()).into_par_iter().map(hash).collect();
        by_place.par_sort_unstable();
        // Of two that differ and have one hash both stay.
        let same = |a: u32, b: u32| {
            let [a, b] = [a, b].map(|index| index as usize);
            bits(self.position[a]) == bits(self.position[b])
                && bits(self.velocity[a]) == bits(self.velocity[b])
                && self.radius[a].to_bits() == self.radius[b].to_bits()
        };
        let mut gone = Vec::new();
        let mut clear = Vec::new();
        for run in by_place.chunk_by(|a, b| a.0 == b.0 && same(a.1, b.1)).filter(|run| run.len() > 1) {
            let through = |index: u32| 1.0 - f32::from(self.look[index as usize][3]) * (1.0 / 65535.0);
            clear.push((run[0].1, run.iter().map(|&(_, index)| through(index)).product::<f32>()));
            gone.extend(run[1..].iter().map(|&(_, index)| index));
        }
        drop(by_place);
        for (index, clear) in clear {
            self.look[index as usize][3] = ((1.0 - clear) * 65535.0).round() as u16;
        }
        if gone.is_empty() {
            return;
        }
        self.coincident = gone.len() as u64;
        let mut stays = vec![true; self.len()];
        gone.into_iter().for_each(|index| stays[index as usize] = false);
        self.retain(|index| stays[index]);
    }

    /// Keeps some of the particles, in their order.
    fn retain(&mut self, stays: impl Fn(usize) -> bool) {
        fn kept<T>(values: &mut Vec<T>, stays: &impl Fn(usize) -> bool) {
            let mut index = 0..values.len();
            values.retain(|_| index.next().is_some_and(stays));
        }
        kept(&mut self.position, &stays);
        kept(&mut self.velocity, &stays);
        kept(&mut self.radius, &stays);
        kept(&mut self.look, &stays);
        kept(&mut self.seed, &stays);
        kept(&mut self.cover, &stays);
        kept(&mut self.share, &stays);
        kept(&mut self.veil, &stays);
        kept(&mut self.age, &stays);
    }

    /// Draws the radii anew, of particles whose logarithms deviate by `spread(index)` instead of `before`, each by the number that it
    /// keeps: larger ones stay larger. Returns which of them are left, if not all are, as those beyond single precision are not.
    pub fn spread(&mut self, before: f64, spread: impl Fn(usize) -> f64) -> Option<Vec<bool>> {
        for index in 0..self.len() {
            let own = self.seed[index];
            let radius = f64::from(self.radius[index]) / size_factor(own, before) * size_factor(own, spread(index));
            self.radius[index] = radius as f32;
        }
        let stays: Vec<bool> = self.radius.iter().map(|&radius| radius > 0.0 && radius.is_finite()).collect();
        if stays.iter().all(|&stays| stays) {
            return None;
        }
        self.without_size += self.radius.iter().filter(|&&radius| radius == 0.0).count() as u64;
        self.out_of_range += self.radius.iter().filter(|radius| radius.is_infinite()).count() as u64;
        self.retain(|index| stays[index]);
        self.all_drops();
        Some(stays)
    }

    /// Leaves out the particles whose factor on their cross section is 0, and notes that of the others; before they are
    /// sorted.
    pub fn thin(&mut self, covers: Vec<f32>) {
        let before = self.len();
        self.cover = covers.clone();
        self.retain(|index| covers[index] > 0.0);
        self.thinned += (before - self.len()) as u64;
        self.all_drops();
    }

    /// Sorts the particles by class. One that belongs to several stands in each, as opaque as its share there, and has that
    /// share of itself in a sheet. Mist is no particle any more.
    pub fn sorted(&self, shares: &[Shares]) -> Self {
        self.sorted_and_thinned(shares, &[], &[])
    }

    /// As [`Spray::sorted`], without those whose factor on their cross section is 0, but for sheets, which stay whole; no
    /// factors for none. `stretch` is the part of its flight that each is drawn along as a streak, none where it is all.
    pub fn sorted_and_thinned(&self, shares: &[Shares], covers: &[f32], stretch: &[f32]) -> Self {
        let mut sorted = Self {
            without_size: self.without_size,
            out_of_range: self.out_of_range,
            coincident: self.coincident,
            thinned: self.thinned,
            ..Self::default()
        };
        for class in Class::ALL {
            sorted.first[class as usize] = sorted.len();
            for (index, shares) in shares.iter().enumerate() {
                let share = shares[class as usize];
                if !class.holds(share) {
                    continue;
                }
                let cover = if class == Class::Sheet { 1.0 } else { covers.get(index).copied().unwrap_or(1.0) };
                if cover > 0.0 {
                    let [r, g, b, opacity] = self.look[index];
                    sorted.position.push(self.position[index]);
                    sorted.velocity.push(self.velocity[index]);
                    sorted.radius.push(self.radius[index]);
                    sorted.seed.push(self.seed[index]);
                    sorted.look.push([r, g, b, (f32::from(opacity) * share).round() as u16]);
                    if class == Class::Sheet {
                        sorted.sheet.push(share);
                    }
                    if !covers.is_empty() {
                        sorted.cover.push(cover);
                    }
                    sorted.stretch.extend(stretch.get(index));
                    sorted.veil.extend(self.veil.get(index));
                } else {
                    sorted.thinned += 1;
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
        let some = |values: &[f32]| if values.is_empty() { Vec::new() } else { values[range.clone()].to_vec() };
        let (share, cover, stretch) = (some(&self.share), some(&self.cover), some(&self.stretch));
        let veil = some(&self.veil);
        let end = range.len();
        Self {
            position: self.position[range.clone()].to_vec(),
            velocity: self.velocity[range.clone()].to_vec(),
            radius: self.radius[range.clone()].to_vec(),
            seed: self.seed[range.clone()].to_vec(),
            look: self.look[range].to_vec(),
            share,
            cover,
            stretch,
            veil,
            first: [0, end, end, end, end, end],
            ..Self::default()
        }
    }

    /// How much of each particle of a sheet is in it, 0..1; empty where all are.
    pub fn sheet_shares(&self) -> &[f32] {
        &self.sheet
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

    /// Colour and opacity of particle `index`, within 1/131070 of what [`appearance()`] says, and its share.
    #[inline]
    pub fn appearance(&self, index: usize) -> Appearance {
        let [r, g, b, opacity] = self.look[index].map(|share| f32::from(share) * (1.0 / 65535.0));
        let share = self.share.get(index).copied().unwrap_or(1.0);
        Appearance { albedo: Vec3::new(r, g, b), opacity, share }
    }

    /// What particle `index` is drawn by where chance decides.
    #[inline]
    pub fn seed(&self, index: usize) -> u32 {
        self.seed[index]
    }

    /// Factor on the cross section of particle `index`: over 1 where it stands for its neighbours as well.
    #[inline]
    pub fn cover(&self, index: usize) -> f32 {
        self.cover.get(index).copied().unwrap_or(1.0)
    }

    /// Part of its flight that particle `index` is drawn along as a streak.
    #[inline]
    pub fn stretch(&self, index: usize) -> f32 {
        self.stretch.get(index).copied().unwrap_or(1.0)
    }

    /// Radius (m) by which particle `index` closes up with its neighbours as a streak; 0 for one on its own.
    #[inline]
    pub fn veil(&self, index: usize) -> f32 {
        self.veil.get(index).copied().unwrap_or(0.0)
    }

    /// Sets the radius (m) by which each particle closes up with its neighbours as a streak (see [`veils`](super::veils)).
    pub fn set_veils(&mut self, veils: Vec<f32>) {
        self.veil = veils;
    }

    /// Radii (m) of the balls and discs that some of the particles are drawn as.
    pub fn drawn_radius(&self, range: std::ops::Range<usize>) -> Vec<f32> {
        range.map(|index| self.radius[index] * self.cover(index).sqrt()).collect()
    }

    /// Seed and age (s) of particle `index`, where the spray was built for billboards with a texture.
    #[inline]
    pub fn variation(&self, index: usize) -> Option<(u32, f32)> {
        self.age.get(index).map(|&age| (self.seed[index], age))
    }

    /// Bytes held.
    pub fn bytes(&self) -> u64 {
        let each = 2 * size_of::<Vec3>() + size_of::<f32>() + size_of::<[u16; 4]>() + size_of::<u32>();
        (self.len() * each
            + size_of_val(&*self.share)
            + size_of_val(&*self.cover)
            + size_of_val(&*self.stretch)
            + size_of_val(&*self.veil)
            + size_of_val(&*self.sheet)
            + size_of_val(&*self.age)) as u64
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
        assert_eq!(spray.bytes(), 2 * 40);
    }

    #[test]
    fn a_particle_of_two_classes_stands_in_both_by_its_shares() {
        let mut particles = three();
        particles.mass[1] = 0.25;
        let spray = Spray::build(&particles, &scene::Particles::default(), DVec3::new(500_000.0, 10.0, 4_000_000.0));
        assert_eq!((spray.of(Class::Drop), spray.of(Class::Bubble)), (0..3, 3..3));
        let half = [0.25, 0.0, 0.0, 0.0, 0.75];
        let sorted = spray.sorted(&[half, [0.0, 1.0, 0.0, 0.0, 0.0], [0.6, 0.0, 0.0, 0.4, 0.0]]);
        let ranges = [Class::Drop, Class::Streak, Class::Sheet, Class::Bubble].map(|class| sorted.of(class));
        assert_eq!(ranges, [0..2, 2..3, 3..4, 4..5]);
        assert_eq!(sorted.sheet_shares(), [0.4]);
        assert_eq!([0, 2, 3, 4].map(|place| sorted.position[place]), [0, 1, 2, 0].map(|index| spray.position[index]));
        let opacity = |spray: &Spray, place: usize| spray.appearance(place).opacity;
        assert!((opacity(&sorted, 0) + opacity(&sorted, 4) - opacity(&spray, 0)).abs() < 4e-5);
        assert!((opacity(&sorted, 0) / opacity(&spray, 0) - 0.25).abs() < 1e-4);
    }

    #[test]
    fn particles_in_one_place_are_one_and_stop_as_much_light() {
        let mut particles = state::Particles {
            position: vec![[1.0, 2.0, 3.0]; 5],
            velocity: vec![[0.5, 0.0, 0.0]; 5],
            mass: vec![0.01; 5],
            age: vec![0.3; 5],
            id: None,
        };
        particles.velocity[1] = [-0.5, 0.0, 0.0];
        particles.mass[2] = 0.02;
        let settings = scene::Particles { opacity: 0.5, fade_age: 1e9, ..Default::default() };
        let spray = Spray::build(&particles, &settings, DVec3::ZERO);
        assert_eq!((spray.len(), spray.coincident), (3, 2));
        assert_eq!((spray.velocity[1].x, spray.radius[2]), (-0.5, radius(0.02, 1.0) as f32));
        let opacity = [0, 1, 2].map(|index| spray.appearance(index).opacity);
        assert!((opacity[0] - 0.875).abs() < 1e-4 && (opacity[1] - 0.5).abs() < 1e-4, "{opacity:?}");
    }

    #[test]
    fn thinning_leaves_sheets_and_counts() {
        let mut particles = three();
        particles.mass[1] = 0.25;
        let spray = Spray::build(&particles, &scene::Particles::default(), DVec3::new(500_000.0, 10.0, 4_000_000.0));
        let sheet = [0.25, 0.0, 0.0, 0.75, 0.0];
        let drop = [1.0, 0.0, 0.0, 0.0, 0.0];
        let sorted = spray.sorted_and_thinned(&[sheet, drop, drop], &[0.0, 4.0, 1.0], &[]);
        assert_eq!((sorted.of(Class::Drop), sorted.of(Class::Sheet), sorted.thinned), (0..2, 2..3, 1));
        let drawn = sorted.drawn_radius(0..3);
        assert_eq!(drawn, [2.0 * spray.radius[1], spray.radius[2], spray.radius[0]]);
        let mut all = spray.clone();
        all.thin(vec![0.0, 4.0, 1.0]);
        assert_eq!((all.of(Class::Drop), all.thinned, all.cover(0), all.seed(1)), (0..2, 1, 4.0, spray.seed(2)));
        assert_eq!(all.part(1..2).cover(0), 1.0);
    }

    #[test]
    fn each_streak_keeps_the_part_of_its_flight() {
        let mut particles = three();
        particles.mass[1] = 0.25;
        let spray = Spray::build(&particles, &scene::Particles::default(), DVec3::new(500_000.0, 10.0, 4_000_000.0));
        let (drop, streak) = ([1.0, 0.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0, 0.0]);
        let sorted = spray.sorted_and_thinned(&[streak, drop, streak], &[], &[0.25, 1.0, 0.5]);
        assert_eq!(sorted.of(Class::Streak), 1..3);
        assert_eq!([0, 1, 2].map(|index| sorted.stretch(index)), [1.0, 0.25, 0.5]);
        assert_eq!(sorted.part(2..3).stretch(0), 0.5);
        assert_eq!(spray.stretch(0), 1.0);
    }

    #[test]
    fn sizes_are_spread_anew_and_what_has_none_then_is_left_out() {
        let settings = scene::Particles { size_spread: 0.2, ..Default::default() };
        let mut particles = three();
        particles.mass = vec![0.5, 1.0, 1.0];
        particles.id = Some(vec![1, 2, 3]);
        let wide = Spray::build(&particles, &scene::Particles { size_spread: 0.4, ..Default::default() }, DVec3::ZERO);
        let mut spray = Spray::build(&particles, &settings, DVec3::ZERO);
        assert_eq!(spray.spread(0.2, |index| if index == 0 { 0.2 } else { 0.4 }), None);
        assert!(
            (spray.radius[1] / wide.radius[1] - 1.0).abs() < 1e-6
                && (spray.radius[0] / wide.radius[0] - 1.0).abs() > 1e-3
        );
        spray.radius[1] = 1e-45;
        // Of a deviation of two the middle is exp(-6).
        assert_eq!(spray.spread(0.0, |index| if index == 1 { 2.0 } else { 0.0 }), Some(vec![true, false, true]));
        assert_eq!((spray.len(), spray.without_size, spray.of(Class::Drop)), (2, 1, 0..2));
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
