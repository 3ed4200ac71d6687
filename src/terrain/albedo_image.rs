//! Images of albedo: how large they may be, and what may be on them. Reading is the images room's; where they lie, and on what,
//! is known to the ground and to meshes.

use std::path::Path;

use glam::{Vec3, Vec4};

use crate::images::{Image, Unreadable};

/// Most pixels of images that are held whole: 16384 x 16384, 6 GB with their mip levels.
pub(super) const LIMIT: usize = 1 << 28;

/// An albedo: nothing below 0 or above its own cover.
pub(super) fn held(pixel: Vec4) -> Vec4 {
    let alpha = pixel.w.clamp(0.0, 1.0);
    pixel.truncate().clamp(Vec3::ZERO, Vec3::splat(alpha)).extend(alpha)
}

/// Holds every pixel to an albedo, and warns of those that were none; `name` is what is told.
///
/// # Errors
/// A pixel that is not finite.
pub(super) fn hold(name: &Path, image: &mut Image<Vec4>) -> Result<(), Unreadable> {
    let mut beyond = 0_usize;
    for (index, pixel) in image.pixels.iter_mut().enumerate() {
        if !pixel.is_finite() {
            let (x, y) = (index % image.width, index / image.width);
            let reason = format!("pixel ({x}, {y}) is {:?}; expected finite numbers", pixel.to_array());
            return Err(Unreadable { path: name.to_owned(), reason });
        }
        let albedo = held(*pixel);
        // Half's rounding is no excess.
        beyond += usize::from((albedo - *pixel).abs().max_element() > 1e-3);
        *pixel = albedo;
    }
    if beyond > 0 {
        // An albedo above 1 would make light.
        tracing::warn!("{}: {beyond} pixels are beyond 0 to alpha; taken as the nearest in it", name.display());
    }
    Ok(())
}
