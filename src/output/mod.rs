//! Finished pictures → files: EXR with every layer and attribute, PNG/JPEG/BMP/TIFF through a view transform.
//!
//! The picture and its metadata are the contract with the render room; [`write()`] chooses the format by extension and
//! writes whole files only. Formats are fixed by docs/formats.md, section 3.

mod attributes;
mod claim;
mod colorspace;
pub mod cryptomatte;
mod deep;
#[cfg(feature = "oiio")]
mod deep_file;
mod display;
mod error;
mod exr_file;
mod exr_read;
pub mod layers;
pub mod naming;
#[cfg(feature = "oiio")]
mod oiio;
mod parts;
mod picture;
mod portion;
mod preview;
mod profile;
mod video;
mod view;
mod views;
pub(crate) mod whole_file;

use std::path::{Path, PathBuf};

pub use claim::Claim;
pub use cryptomatte::Cryptomatte;
pub use deep::{DeepPicture, DeepSample};
#[cfg(feature = "oiio")]
pub use deep_file::read_deep;
pub use error::OutputError;
pub use exr_read::{Encoding, encoding_of, read_exr};
#[cfg(feature = "oiio")]
pub use oiio::{OiioPart, read_with_oiio};
pub use portion::Portion;
pub use preview::Preview;
pub use video::{MovieOptions, MovieReport, write_movie};
pub use view::{aces, display_values, filmic, srgb_encode};
pub use views::{EYES, pair};

use crate::scene::{Colorspace, Compression, Profile, View, Writer};

/// How a channel's samples are stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SampleType {
    /// 16-bit float: light.
    Half,
    /// 32-bit float: data.
    Float,
}

/// One channel over the data window.
#[derive(Clone, Debug, PartialEq)]
pub struct Channel {
    /// Full name, as `R`, `N.x`, `reflection.G` (docs/formats.md, section 3).
    pub name: String,
    /// Storage.
    pub sample_type: SampleType,
    /// Row by row from the top, `width * height` of the data window.
    pub samples: Vec<f32>,
}

/// A rectangle of pixels: x to the right, y down, both from the display window's upper left.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Window {
    /// Left.
    pub x: i32,
    /// Top.
    pub y: i32,
    /// Width, at least 1.
    pub width: u32,
    /// Height, at least 1.
    pub height: u32,
}

/// A finished picture: channels and everything that a compositor may ask about them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Picture {
    /// Full frame: width, height.
    pub display: (u32, u32),
    /// What was rendered.
    pub data: Window,
    /// Channels, beauty first.
    pub channels: Vec<Channel>,
    /// Attributes.
    pub metadata: Metadata,
}

/// What is known about a picture (docs/formats.md, section 3, attributes).
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Metadata {
    /// World (files' frame, m) → camera: left-handed, +z forward, +x right, +y up; row vectors (p M), as OpenEXR stores it.
    pub world_to_camera: [[f64; 4]; 4],
    /// World → 0..1, y down, over the display window; row vectors.
    pub world_to_ndc: [[f64; 4]; 4],
    /// Camera (x right, y up, z backward) → world; row vectors.
    pub camera_to_world: [[f64; 4]; 4],
    /// Frames per second.
    pub fps: f64,
    /// Frame number.
    pub frame: i64,
    /// Exposure time (s).
    pub exposure_time: f64,
    /// f-number; 0 is a pinhole.
    pub f_number: f64,
    /// Distance in focus (m).
    pub focus: f64,
    /// Focal length (mm) for a 24 mm film back (height).
    pub focal_length: f64,
    /// Owner.
    pub owner: Option<String>,
    /// Comments.
    pub comments: Option<String>,
    /// SHA-256 of the resolved scene, hexadecimal.
    pub scene_hash: String,
    /// Samples per pixel.
    pub samples: u32,
    /// Solver by name.
    pub solver: String,
    /// Tolerance as text with its unit, as `0.02 px`.
    pub tolerance: String,
    /// Render time (s).
    pub seconds: f64,
    /// False for a picture that was stopped.
    pub complete: bool,
    /// What took the noise out of the beauty, with its version; empty if nothing did.
    pub denoiser: String,
    /// A pixel's width by its height.
    pub pixel_aspect: f64,
    /// Of a stereo pair, whose attributes are the left eye's: the right eye's world → camera, world → 0..1, camera → world.
    pub right_eye: Option<[[[f64; 4]; 4]; 3]>,
    /// Names of the things that Cryptomatte layers tell apart.
    pub cryptomattes: Vec<Cryptomatte>,
    /// The primaries of its colours.
    pub colorspace: Colorspace,
    /// Which part of a frame the picture is; `None` for a whole one.
    pub portion: Option<Portion>,
}

impl Default for Metadata {
    /// A whole picture at 24 frames per second (what OpenEXR assumes where nothing is said) from an unknown camera.
    fn default() -> Self {
        let identity = std::array::from_fn(|row| std::array::from_fn(|column| if row == column { 1.0 } else { 0.0 }));
        Self {
            world_to_camera: identity,
            world_to_ndc: identity,
            camera_to_world: identity,
            fps: 24.0,
            frame: 0,
            exposure_time: 0.0,
            f_number: 0.0,
            focus: 0.0,
            focal_length: 0.0,
            owner: None,
            comments: None,
            scene_hash: String::new(),
            samples: 0,
            solver: String::new(),
            tolerance: String::new(),
            seconds: 0.0,
            complete: true,
            denoiser: String::new(),
            pixel_aspect: 1.0,
            right_eye: None,
            cryptomattes: Vec::new(),
            colorspace: Colorspace::Rec709,
            portion: None,
        }
    }
}

/// How a picture is written.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct WriteOptions {
    /// Who writes EXR (and, for OpenImageIO, TIFF).
    pub writer: Writer,
    /// Primaries of the colours of EXR (and, for OpenImageIO, TIFF).
    pub colorspace: Colorspace,
    /// Compression of EXR.
    pub compression: Compression,
    /// Whose names the channels have, where all are written.
    pub profile: Profile,
    /// Curve for PNG, JPEG, BMP and 8-bit TIFF.
    pub view: View,
    /// Stops of exposure for PNG, JPEG, BMP and 8-bit TIFF.
    pub exposure: f64,
    /// Leave out dates and times, so that equal pictures are equal bytes.
    pub reproducible: bool,
    /// When the picture was rendered, in local time; now, if not given.
    pub captured: Option<time::OffsetDateTime>,
}

impl WriteOptions {
    /// What the scene's `[output]` asks for.
    pub fn from_scene(output: &crate::scene::Output) -> Self {
        Self {
            writer: output.writer,
            compression: output.compression,
            profile: output.profile,
            colorspace: output.colorspace,
            view: output.view,
            exposure: output.exposure,
            ..Self::default()
        }
    }
}

/// What was written.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct WriteReport {
    /// The file.
    pub path: PathBuf,
    /// Its size.
    pub bytes: u64,
    /// Half samples beyond +-65504, written as +-65504.
    pub saturated: u64,
    /// Pixels with at least one such sample.
    pub saturated_pixels: u64,
}

/// File formats, by extension.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Format {
    Exr,
    Png,
    Jpeg,
    Bmp,
    Tiff,
}

impl Format {
    fn of(path: &Path) -> Result<Self, OutputError> {
        let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
        match extension.as_str() {
            "exr" => Ok(Self::Exr),
            "png" => Ok(Self::Png),
            "jpg" | "jpeg" => Ok(Self::Jpeg),
            "bmp" => Ok(Self::Bmp),
            "tif" | "tiff" => Ok(Self::Tiff),
            _ => Err(OutputError::UnknownExtension { path: path.to_path_buf() }),
        }
    }
}

/// Whether a file of that name holds every layer rather than the beauty alone.
pub fn has_layers(path: &Path, options: &WriteOptions) -> bool {
    Format::of(path).is_ok_and(|format| format == Format::Exr || uses_oiio(format, options))
}

/// Everything about a target that can be known before hours of rendering: format, writer, folder, permission.
///
/// *Errors*: an unknown extension, OpenImageIO asked for but not built in, a target that cannot be written.
pub fn check(path: &Path, options: &WriteOptions) -> Result<(), OutputError> {
    let format = Format::of(path)?;
    if cfg!(not(feature = "oiio")) && uses_oiio(format, options) {
        return Err(OutputError::OiioNotBuilt { path: path.to_path_buf() });
    }
    whole_file::check_target(path).map(|_| ())
}

/// Writes a picture under its final name when, and only when, it is whole.
///
/// The extension chooses: `.exr` has all channels and attributes; `.png .jpg .jpeg .bmp .tif .tiff` show the beauty
/// through the view transform in 8 bits (with `Writer::Oiio`, TIFF too has all channels, scene-linear).
///
/// *Errors*: those of [`check`]; a picture that is not well formed or not finite (nothing is written then); metadata
/// that no file can hold; the system's. An older file under that name stays unless the new one is whole.
pub fn write(picture: &Picture, path: &Path, options: &WriteOptions) -> Result<WriteReport, OutputError> {
    check(path, options)?;
    picture.check()?;
    let format = Format::of(path)?;
    let all_channels = format == Format::Exr || uses_oiio(format, options);
    let primaries = if all_channels { options.colorspace } else { Colorspace::Rec709 };
    let picture = &*colorspace::converted(picture, primaries);
    let renamed = (all_channels && options.profile == Profile::Blender).then(|| profile::blender(picture));
    let picture = renamed.as_ref().unwrap_or(picture);
    let (saturated, saturated_pixels) = if all_channels { picture.count_saturated() } else { (0, 0) };
    let bytes = match format {
        #[cfg(feature = "oiio")]
        _ if uses_oiio(format, options) => oiio::write(picture, path, format, options)?,
        Format::Exr => exr_file::write(picture, path, options)?,
        _ => display::write(picture, path, format, options)?,
    };
    Ok(WriteReport { path: path.to_path_buf(), bytes, saturated, saturated_pixels })
}

/// Everything about a deep target that can be known before hours of rendering.
///
/// *Errors*: no EXR, OpenImageIO not built in, a target that cannot be written.
pub fn check_deep(path: &Path) -> Result<(), OutputError> {
    if Format::of(path)? != Format::Exr {
        let what = "only EXR has deep samples; give --deep an output that ends in .exr".into();
        return Err(OutputError::Unsupported { path: path.to_path_buf(), what });
    }
    if cfg!(not(feature = "oiio")) {
        return Err(OutputError::OiioNotBuilt { path: path.to_path_buf() });
    }
    whole_file::check_target(path).map(|_| ())
}

/// Writes a deep picture (`deepscanline`, ZIPS) under its final name when, and only when, it is whole.
///
/// *Errors*: those of [`check_deep`]; samples that are not finite or not tidy; metadata that no file can hold; the
/// system's. An older file under that name stays unless the new one is whole.
pub fn write_deep(picture: &DeepPicture, path: &Path, options: &WriteOptions) -> Result<WriteReport, OutputError> {
    check_deep(path)?;
    #[cfg(feature = "oiio")]
    let bytes = deep_file::write(picture, path, options)?;
    #[cfg(not(feature = "oiio"))]
    let bytes = {
        let _ = (picture, options);
        0
    };
    Ok(WriteReport { path: path.to_path_buf(), bytes, saturated: 0, saturated_pixels: 0 })
}

fn uses_oiio(format: Format, options: &WriteOptions) -> bool {
    options.writer == Writer::Oiio && matches!(format, Format::Exr | Format::Tiff)
}
