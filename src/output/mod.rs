//! Finished pictures → files: EXR with every layer and attribute, PNG/JPEG/BMP through a view transform. Whole files only.

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
    /// Full name, as `R`, `N.x`, `reflection.G` (FORMATS section 3).
    pub name: String,
    /// Storage.
    pub sample_type: SampleType,
    /// Row by row from the top, `width * height` of the data window.
    pub samples: Vec<f32>,
}

/// A rectangle of pixels: x to the right, y down, both from the display window's upper left.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
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
#[derive(Clone, Debug, Default)]
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

/// What is known about a picture (FORMATS section 3, attributes).
#[derive(Clone, Debug, Default)]
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
}
