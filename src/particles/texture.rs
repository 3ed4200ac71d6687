//! What is on a billboard: colour and alpha over its disc, from images by the particle's age, or of a drop that is breaking up.
//!
//! Colours multiply the particle's own, alpha its opacity. Images are linear and premultiplied inside.

use std::f32::consts::TAU;
use std::path::{Path, PathBuf};

use glam::{Vec2, Vec3, Vec4};

use super::seed::{Purpose, several};
use crate::images::{self, Image, Texture, TextureMemory, Wrap, premultiplied};
use crate::scene;
use crate::state::{FramePattern, StateError};

/// Most pixels of all images together: 2 GB as kept.
const LIMIT: usize = 1 << 27;

/// A point of a texture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Texel {
    /// Linear Rec.709, 0 to 1: a factor on the albedo.
    pub color: Vec3,
    /// A factor on the opacity, 0 to 1.
    pub alpha: f32,
}

/// Why a texture cannot be had.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TextureError {
    /// The name with `#` is not understood, or its folder cannot be read.
    #[error("particles.billboard.texture: {0}")]
    Pattern(#[from] StateError),
    /// Nothing is called so.
    #[error("particles.billboard.texture = \"{pattern}\": {directory} has no such images", directory = directory.display())]
    None {
        /// The name as given.
        pattern: String,
        /// Where they should be.
        directory: PathBuf,
    },
    /// An image cannot be read.
    #[error("particles.billboard.texture: {0}")]
    Image(#[from] images::Unreadable),
    /// An image holds a number that is not one.
    #[error(
        "particles.billboard.texture: pixel ({x}, {y}) of {path} is {value:?}; expected finite numbers",
        path = path.display()
    )]
    NotFinite {
        /// The file.
        path: PathBuf,
        /// Column, from the left.
        x: usize,
        /// Row, from the top.
        y: usize,
        /// Red, green, blue, alpha.
        value: [f32; 4],
    },
    /// The images take too much memory.
    #[error("particles.billboard.texture: {path} and those before it have {pixels} pixels; at most {LIMIT} are read", path = path.display())]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// Pixels so far.
        pixels: usize,
    },
}

/// The texture of a scene's billboards.
#[derive(Clone, Debug)]
pub struct Textures {
    /// Empty for drops.
    images: Vec<Texture<Vec4>>,
    /// Images to a second of age.
    rate: f64,
}

/// In-plane rotation (radians) of a billboard.
pub fn billboard_turn(seed: u32) -> f32 {
    TAU * uniform(seed, 0)
}

/// Uniform numbers in 0..1 of a particle.
fn uniform(seed: u32, which: u32) -> f32 {
    several(seed, Purpose::Texture, which)
}

impl Textures {
    /// Reads what `particles.billboard.texture` names, relative to `directory`; `None` for plain discs, and where no particle
    /// is a billboard.
    ///
    /// # Errors
    /// Images that are missing, broken, not finite or too large.
    pub fn load(
        particles: &scene::Particles,
        directory: &Path,
        memory: &TextureMemory,
    ) -> Result<Option<Self>, TextureError> {
        if !wanted(particles) {
            return Ok(None);
        }
        let mut textures = Self { images: Vec::new(), rate: particles.billboard.image_fps };
        let mut pixels = 0;
        for path in texture_files(particles, directory)? {
            textures.images.push(Texture::open(&path, [Wrap::Clamp; 2], memory, held, || read(&path, &mut pixels))?);
        }
        Ok(Some(textures))
    }

    /// The texture at x, y (-1 to 1 over the disc) of a particle of an age (s), averaged over a `footprint` of the same unit
    /// where it is an image.
    pub fn at(&self, seed: u32, age: f32, place: [f32; 2], footprint: f32) -> Texel {
        let place = Vec2::from_angle(-billboard_turn(seed)).rotate(Vec2::from(place));
        let Some(last) = self.images.len().checked_sub(1) else { return droplet(seed, place) };
        // A negative age is as 0, and what is beyond all images the last.
        sample(&self.images[((f64::from(age) * self.rate) as usize).min(last)], place, footprint)
    }

    /// What went wrong first in any look at the images so far; the colour of that look is missing.
    ///
    /// # Errors
    /// That.
    pub fn check(&self) -> Result<(), TextureError> {
        self.images.iter().find_map(Texture::failure).map_or(Ok(()), |failure| Err(failure.into()))
    }
}

/// The images that billboards show, in the order of their numbers: none for droplets, and where no particle is a billboard.
///
/// # Errors
/// A pattern that no file fits, or that cannot be understood.
pub fn texture_files(particles: &scene::Particles, directory: &Path) -> Result<Vec<PathBuf>, TextureError> {
    let texture = &particles.billboard.texture;
    if !wanted(particles) || texture == "droplet" {
        return Ok(Vec::new());
    }
    if !texture.contains('#') {
        return Ok(vec![directory.join(texture)]);
    }
    let pattern = FramePattern::new(texture, directory)?;
    let mut existing = pattern.existing()?;
    existing.sort();
    if existing.is_empty() {
        return Err(TextureError::None { pattern: texture.clone(), directory: pattern.directory().to_owned() });
    }
    Ok(existing.into_iter().map(|(_, path)| path).collect())
}

/// Whether particles are billboards with something on them.
pub(super) fn wanted(particles: &scene::Particles) -> bool {
    particles.representation == scene::ParticleRepresentation::Billboards && particles.billboard.texture != "none"
}

/// A few drops in place of one, each with a soft edge, a bright rim and a highlight.
fn droplet(seed: u32, place: Vec2) -> Texel {
    let count = 3 + (uniform(seed, 1) * 3.0) as u32;
    let (mut light, mut clear) = (0.0, 1.0);
    for drop in 0..count {
        let number = |which: u32| uniform(seed, 2 + 3 * drop + which);
        // The first is the largest and in the middle; the others are about it.
        let radius = if drop == 0 { 0.5 + 0.2 * number(0) } else { 0.12 + 0.18 * number(0) };
        let away = if drop == 0 { 0.25 * number(1) } else { (1.0 - radius) * (0.5 + 0.5 * number(1)) };
        let offset = (place - away * Vec2::from_angle(TAU * number(2))) / radius;
        let distance = offset.length();
        if distance >= 1.0 {
            continue;
        }
        // Smoothsteps: the edge fades over the outer third.
        let smooth = |t: f32| t * t * (3.0 - 2.0 * t);
        let alpha = smooth(((1.0 - distance) * 3.0).min(1.0));
        let rim = smooth((distance / 0.75).min(1.0));
        let glint = smooth((1.0 - 3.0 * (offset - Vec2::new(-0.3, 0.35)).length()).max(0.0));
        let bright = (0.7 + 0.3 * rim).max(glint);
        light += clear * alpha * bright;
        clear *= 1.0 - alpha;
    }
    let alpha = 1.0 - clear;
    Texel { color: Vec3::splat(if alpha > 0.0 { (light / alpha).min(1.0) } else { 1.0 }), alpha }
}

/// Reads an image, premultiplied; `pixels` counts those of all images so far.
fn read(path: &Path, pixels: &mut usize) -> Result<Image<Vec4>, TextureError> {
    let claim = |width: usize, height: usize| {
        *pixels = pixels.saturating_add(width.saturating_mul(height));
        if *pixels > LIMIT { Err(TextureError::TooLarge { path: path.to_owned(), pixels: *pixels }) } else { Ok(()) }
    };
    let mut image = images::read(path, claim, premultiplied)?;
    let mut beyond = 0_usize;
    for (index, pixel) in image.pixels.iter_mut().enumerate() {
        if !pixel.is_finite() {
            let (x, y) = (index % image.width, index / image.width);
            return Err(TextureError::NotFinite { path: path.to_owned(), x, y, value: pixel.to_array() });
        }
        let held = held(*pixel);
        // Half's rounding is no excess.
        beyond += usize::from((held - *pixel).abs().max_element() > 1e-3);
        *pixel = held;
    }
    if beyond > 0 {
        // An albedo above 1 would make light.
        tracing::warn!("{}: {beyond} pixels are beyond 0 to alpha; taken as the nearest in it", path.display());
    }
    Ok(image)
}

/// Shares: nothing below 0 or above alpha.
fn held(pixel: Vec4) -> Vec4 {
    let alpha = pixel.w.clamp(0.0, 1.0);
    pixel.truncate().clamp(Vec3::ZERO, Vec3::splat(alpha)).extend(alpha)
}

/// Over the square around the disc; at its edges the outermost pixels go on.
fn sample(image: &Texture<Vec4>, place: Vec2, footprint: f32) -> Texel {
    // The square is two wide.
    let spans = [Vec2::X, Vec2::Y].map(|side| side * (0.5 * footprint));
    let pixel = image.at(Vec2::new(0.5 + 0.5 * place.x, 0.5 - 0.5 * place.y), spans);
    let color = if pixel.w > 0.0 { (pixel.truncate() / pixel.w).min(Vec3::ONE) } else { Vec3::ONE };
    Texel { color, alpha: pixel.w.min(1.0) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::images::srgb_to_linear;
    use proptest::prelude::*;

    fn settings(texture: &str) -> scene::Particles {
        let billboard = scene::Billboard { texture: texture.into(), image_fps: 10.0, ..scene::Billboard::default() };
        scene::Particles {
            representation: scene::ParticleRepresentation::Billboards,
            billboard,
            ..scene::Particles::default()
        }
    }

    /// A seed that is turned by next to nothing, so that places are those of the image.
    fn upright() -> u32 {
        (0..100_000_000).find(|&seed| billboard_turn(seed) < 1e-5).unwrap()
    }

    #[test]
    fn images_are_picked_by_age_and_the_last_one_stays() {
        let folder = tempfile::tempdir().unwrap();
        for (number, gray) in [(8, 50_u8), (9, 100), (10, 200)] {
            let image = image::RgbaImage::from_pixel(2, 2, image::Rgba([gray, gray, gray, 255]));
            image.save(folder.path().join(format!("drop{number}.png"))).unwrap();
        }
        let textures =
            Textures::load(&settings("drop####.png"), folder.path(), &TextureMemory::default()).unwrap().unwrap();
        for (age, gray) in [(0.0, 50.0), (0.05, 50.0), (0.15, 100.0), (0.25, 200.0), (1e9, 200.0), (-1.0, 50.0)] {
            let texel = textures.at(7, age, [0.2, -0.3], 0.0);
            assert!((texel.color.x - srgb_to_linear(gray / 255.0)).abs() < 1e-5, "{age}");
            assert_eq!(texel.alpha, 1.0);
        }
    }

    #[test]
    fn straight_and_premultiplied_images_of_the_same_thing_are_the_same() {
        let folder = tempfile::tempdir().unwrap();
        // Left a red of alpha 0.2, right nothing; the top row first. 188 is 0.5 in sRGB, 51 a fifth.
        let mut straight = image::RgbaImage::new(2, 2);
        straight.put_pixel(0, 0, image::Rgba([188, 0, 0, 51]));
        straight.put_pixel(0, 1, image::Rgba([188, 0, 0, 51]));
        straight.put_pixel(1, 0, image::Rgba([0, 255, 0, 0]));
        straight.save(folder.path().join("a.png")).unwrap();
        let red = srgb_to_linear(188.0 / 255.0);
        let of = |x: usize| if x == 0 { (0.2 * red, 0.0, 0.0, 0.2_f32) } else { (0.0, 0.0, 0.0, 0.0) };
        let written = exr::prelude::write_rgba_file(folder.path().join("a.exr"), 2, 2, |x, _| of(x));
        written.unwrap();
        for name in ["a.png", "a.exr"] {
            let textures = Textures::load(&settings(name), folder.path(), &TextureMemory::default()).unwrap().unwrap();
            let seed = upright();
            // Half way to what is not there: half of the alpha, and the same red, not a darker one nor the hidden green.
            for (x, alpha) in [(-0.9, 0.2), (-0.5, 0.2), (0.0, 0.1), (0.25, 0.05)] {
                let texel = textures.at(seed, 0.0, [x, 0.1], 0.0);
                assert!((texel.alpha - alpha).abs() < 1e-4, "{name} {x}: {texel:?}");
                assert!((texel.color - Vec3::new(red, 0.0, 0.0)).length() < 1e-3, "{name} {x}: {texel:?}");
            }
            assert_eq!(textures.at(seed, 0.0, [0.9, 0.0], 0.0).alpha, 0.0);
        }
    }

    #[test]
    fn what_is_missing_or_broken_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let told = |texture: &str| {
            Textures::load(&settings(texture), folder.path(), &TextureMemory::default()).unwrap_err().to_string()
        };
        assert!(told("a##.png").contains("a##.png") && told("b.png").contains("b.png"), "{}", told("b.png"));
        std::fs::write(folder.path().join("c.png"), b"no picture").unwrap();
        assert!(told("c.png").contains("c.png"));
        let nan =
            exr::prelude::write_rgba_file(folder.path().join("d.exr"), 2, 1, |x, _| (f32::NAN, 0.0, 0.0, x as f32));
        nan.unwrap();
        assert!(told("d.exr").contains("pixel (0, 0)"), "{}", told("d.exr"));
        assert!(Textures::load(&settings("none"), folder.path(), &TextureMemory::default()).unwrap().is_none());
        let spheres = scene::Particles { representation: scene::ParticleRepresentation::Spheres, ..settings("e.png") };
        assert!(Textures::load(&spheres, folder.path(), &TextureMemory::default()).unwrap().is_none());
    }

    #[test]
    fn drops_are_soft_differ_by_seed_and_turn() {
        let drops = Textures { images: Vec::new(), rate: 24.0 };
        let grid = |seed: u32| -> Vec<Texel> {
            (0..2500)
                .map(|k| drops.at(seed, 0.0, [(k % 50) as f32 / 25.0 - 0.98, (k / 50) as f32 / 25.0 - 0.98], 0.0))
                .collect()
        };
        let cover = |seed: u32| grid(seed).iter().map(|texel| texel.alpha).sum::<f32>() / 2500.0;
        for seed in 0..50 {
            let drop = grid(seed);
            // Of the square, of which the disc itself is 0.785.
            assert!((0.1..0.5).contains(&cover(seed)), "{seed}: {}", cover(seed));
            let soft = drop.iter().filter(|texel| texel.alpha > 0.05 && texel.alpha < 0.95).count();
            assert!(soft > 100, "{seed}: {soft}");
            let (dark, bright) = drop
                .iter()
                .filter(|texel| texel.alpha > 0.0)
                .fold((1.0_f32, 0.0_f32), |(a, b), texel| (a.min(texel.color.x), b.max(texel.color.x)));
            assert!(dark < 0.8 && bright > 0.95 && bright <= 1.0, "{seed}: {dark} {bright}");
            assert_ne!(drop, grid(seed + 1));
        }
        let turns: Vec<f32> = (0..1000).map(billboard_turn).collect();
        assert!(turns.iter().all(|turn| (0.0..TAU).contains(turn)));
        assert!((turns.iter().sum::<f32>() / 1000.0 - TAU / 2.0).abs() < 0.2);
    }

    proptest! {
        #[test]
        fn any_place_and_age_gives_shares(
            seed in 0u32.., age in prop::num::f32::ANY, x in -1.0f32..=1.0, y in -1.0f32..=1.0,
            footprint in 0.0f32..100.0,
        ) {
            let image = Image { width: 1, height: 3, pixels: vec![Vec4::splat(0.5), Vec4::ZERO, Vec4::ONE] };
            for images in [Vec::new(), vec![Texture::from_image(image, [Wrap::Clamp; 2])]] {
                let texel = Textures { images, rate: 24.0 }.at(seed, age, [x, y], footprint);
                prop_assert!((0.0..=1.0).contains(&texel.alpha));
                prop_assert!(texel.color.min_element() >= 0.0 && texel.color.max_element() <= 1.0);
            }
        }
    }
}
