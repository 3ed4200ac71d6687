//! An image laid over the ground from above: where it lies, and its albedo over a footprint. Its light is the renderer's matter.

use std::path::Path;

use glam::{DVec3, Vec2, Vec3, Vec4};

use super::TerrainError;
use super::albedo_image::{LIMIT, held, hold};
use crate::images::{self, Image, Texture, TextureMemory, Wrap, premultiplied};
use crate::scene;
use crate::state::Columns;

/// The image of a scene's ground, wherever its frames lie.
#[derive(Clone, Debug)]
pub struct GroundTexture {
    texture: Texture<Vec4>,
    /// x and z of the north-western and of the south-eastern corner (m), files' frame.
    extent: Option<[f64; 4]>,
    wrap: scene::TextureWrap,
}

impl GroundTexture {
    /// Reads what `terrain.texture` names, relative to `directory`; `None` if it names nothing or no ground is seen.
    ///
    /// # Errors
    /// [`TerrainError::Texture`]: an image that is missing, broken or too large, or holds a number that is not one.
    pub fn load(
        terrain: &scene::Terrain,
        directory: &Path,
        memory: &TextureMemory,
    ) -> Result<Option<Self>, TerrainError> {
        let Some(name) = terrain.texture.as_ref().filter(|_| terrain.visible) else { return Ok(None) };
        let path = directory.join(name);
        let wrap = match terrain.texture_wrap {
            scene::TextureWrap::Repeat => Wrap::Repeat,
            scene::TextureWrap::Clamp | scene::TextureWrap::Once => Wrap::Clamp,
        };
        let texture = Texture::open(&path, [wrap; 2], memory, held, || whole(&path))?;
        Ok(Some(Self { texture, extent: terrain.texture_extent, wrap: terrain.texture_wrap }))
    }

    /// The image over the columns of a frame, whose local frame lies at `origin` (m).
    pub fn placed(&self, columns: &Columns, origin: DVec3) -> PlacedTexture {
        let edge =
            |axis: usize, columns_before: f64| columns.origin[axis] + (columns_before - 0.5) * columns.width[axis];
        let [x0, z0, x1, z1] = self
            .extent
            .unwrap_or_else(|| [edge(0, 0.0), edge(1, 0.0), edge(0, columns.nx as f64), edge(1, columns.nz as f64)]);
        let along = |origin: f64, low: f64, high: f64| {
            let start = (origin - low) / (high - low);
            // Far away, single precision would leave nothing of the place within the image.
            let start = if self.wrap == scene::TextureWrap::Repeat { start.rem_euclid(1.0) } else { start };
            (start as f32, (1.0 / (high - low)) as f32)
        };
        let ((s, across), (t, down)) = (along(origin.x, x0, x1), along(origin.z, z0, z1));
        PlacedTexture {
            texture: self.texture.clone(),
            start: Vec2::new(s, t),
            scale: Vec2::new(across, down),
            once: self.wrap == scene::TextureWrap::Once,
        }
    }

    /// What went wrong first in any look at it so far; the colour of that look is missing.
    ///
    /// # Errors
    /// That.
    pub fn check(&self) -> Result<(), TerrainError> {
        self.texture.failure().map_or(Ok(()), |failure| Err(failure.into()))
    }
}

/// The image of the ground in the local frame of one picture.
#[derive(Clone, Debug)]
pub struct PlacedTexture {
    texture: Texture<Vec4>,
    /// Place in the image of the local frame's origin.
    start: Vec2,
    /// Images to a metre.
    scale: Vec2,
    once: bool,
}

impl PlacedTexture {
    /// Albedo times cover, and cover (0 to 1), at a point of the local frame, over a footprint that two `spans` across it (m)
    /// give.
    pub fn at(&self, position: Vec3, spans: [Vec3; 2]) -> Vec4 {
        let flat = |v: Vec3| Vec2::new(v.x, v.z) * self.scale;
        let (place, spans) = (self.start + flat(position), spans.map(flat));
        let cover = if self.once { covered(place, spans) } else { 1.0 };
        if cover > 0.0 { self.texture.at(place, spans) * cover } else { Vec4::ZERO }
    }
}

/// Share of the upright box around a footprint that lies in the unit square.
fn covered(place: Vec2, [a, b]: [Vec2; 2]) -> f32 {
    let half = 0.5 * (a.abs() + b.abs());
    let along = |place: f32, half: f32| {
        if half > 0.0 {
            (((place + half).min(1.0) - (place - half).max(0.0)) / (2.0 * half)).clamp(0.0, 1.0)
        } else {
            f32::from((0.0..=1.0).contains(&place))
        }
    };
    along(place.x, half.x) * along(place.y, half.y)
}

fn whole(path: &Path) -> Result<Image<Vec4>, TerrainError> {
    let claim = |width: usize, height: usize| {
        if width.saturating_mul(height) > LIMIT {
            let reason =
                format!("it claims {width} x {height} pixels; expected at most {LIMIT}, or a .tx, read piece by piece");
            return Err(TerrainError::Texture(images::Unreadable { path: path.to_owned(), reason }));
        }
        Ok(())
    };
    let mut image = images::read(path, claim, premultiplied)?;
    hold(path, &mut image)?;
    Ok(image)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Four by two pixels, of red 0.1 to 0.8 by rows, laid over 8 m x 4 m.
    fn ground(wrap: scene::TextureWrap, extent: Option<[f64; 4]>) -> GroundTexture {
        let pixels = (1..=8).map(|k| Vec4::new(0.1 * k as f32, 0.0, 0.0, 1.0)).collect();
        let mode = if wrap == scene::TextureWrap::Repeat { Wrap::Repeat } else { Wrap::Clamp };
        let texture = Texture::from_image(Image { width: 4, height: 2, pixels }, [mode; 2]);
        GroundTexture { texture, extent, wrap }
    }

    const NONE: [Vec3; 2] = [Vec3::ZERO; 2];

    #[test]
    fn by_default_it_covers_all_columns_with_north_above() {
        let columns = Columns::level([101.0, 1001.0], [2.0, 2.0], [4, 2], 0.0, 1.0);
        let placed = ground(scene::TextureWrap::Once, None).placed(&columns, DVec3::new(104.0, 7.0, 1002.0));
        // The middle of the north-western column, and of the south-eastern one.
        for (x, z, red) in [(-3.0, -1.0, 0.1), (3.0, -1.0, 0.4), (-3.0, 1.0, 0.5), (3.0, 1.0, 0.8)] {
            let seen = placed.at(Vec3::new(x, 9.0, z), NONE);
            assert!((seen - Vec4::new(red, 0.0, 0.0, 1.0)).abs().max_element() < 1e-5, "{x} {z}: {seen}");
        }
        assert_eq!(placed.at(Vec3::new(5.0, 0.0, 0.0), NONE), Vec4::ZERO);
        // Half of what is seen lies on it.
        let spans = [Vec3::new(0.5, 0.0, 0.0), Vec3::new(0.0, 0.0, 0.5)];
        assert!((placed.at(Vec3::new(4.0, 0.0, 0.0), spans).w - 0.5).abs() < 1e-5);
    }

    #[test]
    fn an_extent_repeats_or_goes_on_far_from_the_origin() {
        let columns = Columns::level([0.0, 0.0], [1.0, 1.0], [3, 3], 0.0, 1.0);
        let extent = Some([0.0, 0.0, 8.0, 4.0]);
        let far = DVec3::new(8e7, 0.0, 4e7);
        let repeated = ground(scene::TextureWrap::Repeat, extent).placed(&columns, far);
        for (x, red) in [(1.0, 0.1), (3.0, 0.2), (9.0, 0.1), (-1.0, 0.4)] {
            assert!((repeated.at(Vec3::new(x, 0.0, 1.0), NONE).x - red).abs() < 1e-5, "{x}");
        }
        let clamped = ground(scene::TextureWrap::Clamp, extent).placed(&columns, DVec3::ZERO);
        assert!((clamped.at(Vec3::new(99.0, 0.0, 99.0), NONE) - Vec4::new(0.8, 0.0, 0.0, 1.0)).length() < 1e-5);
    }

    #[test]
    fn what_is_missing_or_broken_is_named_and_albedos_stay_below_one() {
        let folder = tempfile::tempdir().unwrap();
        let load = |name: &str| {
            let terrain = scene::Terrain { texture: Some(name.into()), ..scene::Terrain::default() };
            GroundTexture::load(&terrain, folder.path(), &TextureMemory::default())
        };
        std::fs::write(folder.path().join("broken.png"), b"no picture").unwrap();
        std::fs::write(folder.path().join("broken.tx"), b"no picture").unwrap();
        exr::prelude::write_rgb_file(folder.path().join("nan.exr"), 2, 1, |x, _| (f32::NAN, 0.0f32, x as f32)).unwrap();
        for name in ["absent.png", "broken.png", "absent.tx", "broken.tx", "nan.exr"] {
            let told = load(name).unwrap_err().to_string();
            assert!(told.contains("terrain.texture") && told.contains(name), "{told}");
        }
        exr::prelude::write_rgb_file(folder.path().join("bright.exr"), 2, 2, |_, _| (7.0f32, 0.5f32, -1.0f32)).unwrap();
        let placed = load("bright.exr").unwrap().unwrap().placed(&Columns::default(), DVec3::ZERO);
        assert_eq!(placed.texture.at(Vec2::splat(0.5), [Vec2::ZERO; 2]), Vec4::new(1.0, 0.5, 0.0, 1.0));
        let bare = scene::Terrain::default();
        assert!(GroundTexture::load(&bare, folder.path(), &TextureMemory::default()).unwrap().is_none());
    }
}
