//! OpenImageIO's texture system: the types and functions that cross into `oiio_texture.cc`, by cxx, and what makes them safe
//! to share between threads. What the rest of the crate sees is in `images`.

use cxx::{SharedPtr, UniquePtr};

#[allow(unreachable_pub)] // cxx makes the types public, whatever is written here.
#[cxx::bridge(namespace = "whitewater")]
mod bridge {
    unsafe extern "C++" {
        include!("whitewater/ffi/oiio_texture.hh");

        type OiioTextures;
        fn oiio_textures(megabytes: f32) -> Result<SharedPtr<OiioTextures>>;

        type OiioTexture;
        fn oiio_texture(
            textures: &SharedPtr<OiioTextures>,
            path: &str,
            repeat_s: bool,
            repeat_t: bool,
        ) -> Result<UniquePtr<OiioTexture>>;
        fn width(self: &OiioTexture) -> u32;
        fn height(self: &OiioTexture) -> u32;
        fn is_float(self: &OiioTexture) -> bool;
        fn lookup(self: &OiioTexture, place: &[f32; 2], spans: &[f32; 4], color: &mut [f32; 4]) -> Result<()>;

        fn oiio_levels(path: &str) -> Result<u32>;
        fn oiio_make_texture(path: &str, width: u32, height: u32, pixels: &[f32]) -> Result<()>;
    }
}

// SAFETY: OpenImageIO's texture system may be used from any thread at a time (its documentation, "TextureSystem API"), and
// the object around it is not changed once it is made.
unsafe impl Send for bridge::OiioTextures {}
// SAFETY: as above.
unsafe impl Sync for bridge::OiioTextures {}
// SAFETY: a handle belongs to its texture system, which the object keeps alive, and not to a thread; nothing in the object
// is changed once it is made, and lookups copy its options.
unsafe impl Send for bridge::OiioTexture {}
// SAFETY: as above.
unsafe impl Sync for bridge::OiioTexture {}

/// A texture system with a cache of its own.
pub(crate) struct TextureSystem(SharedPtr<bridge::OiioTextures>);

impl TextureSystem {
    /// Keeps at most so many megabytes of pixels.
    pub(crate) fn new(megabytes: f32) -> Result<Self, String> {
        bridge::oiio_textures(megabytes).map(Self).map_err(|error| error.what().to_owned())
    }

    /// Opens a file, which repeats itself along its axes or goes on with its outermost pixels.
    pub(crate) fn texture(&self, path: &str, [s, t]: [bool; 2]) -> Result<SystemTexture, String> {
        bridge::oiio_texture(&self.0, path, s, t).map(SystemTexture).map_err(|error| error.what().to_owned())
    }
}

impl std::fmt::Debug for TextureSystem {
    fn fmt(&self, out: &mut std::fmt::Formatter) -> std::fmt::Result {
        out.write_str("TextureSystem")
    }
}

/// One file of a texture system.
pub(crate) struct SystemTexture(UniquePtr<bridge::OiioTexture>);

impl SystemTexture {
    /// Columns and rows.
    pub(crate) fn size(&self) -> [u32; 2] {
        [self.0.width(), self.0.height()]
    }

    /// Whether its samples are half or float.
    pub(crate) fn holds_light(&self) -> bool {
        self.0.is_float()
    }

    /// Red, green, blue and alpha about s, t over the footprint of ds/dx, dt/dx, ds/dy, dt/dy.
    pub(crate) fn lookup(&self, place: [f32; 2], spans: [f32; 4]) -> Result<[f32; 4], String> {
        let mut color = [0.0; 4];
        self.0.lookup(&place, &spans, &mut color).map_err(|error| error.what().to_owned())?;
        Ok(color)
    }
}

impl std::fmt::Debug for SystemTexture {
    fn fmt(&self, out: &mut std::fmt::Formatter) -> std::fmt::Result {
        write!(out, "SystemTexture {:?}", self.size())
    }
}

/// Mip levels of a file.
pub(crate) fn levels(path: &str) -> Result<u32, String> {
    bridge::oiio_levels(path).map_err(|error| error.what().to_owned())
}

/// Writes red, green, blue and alpha of every pixel as a texture with all mip levels.
pub(crate) fn make_texture(path: &str, [width, height]: [u32; 2], pixels: &[f32]) -> Result<(), String> {
    bridge::oiio_make_texture(path, width, height, pixels).map_err(|error| error.what().to_owned())
}
