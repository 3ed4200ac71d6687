//! What can go wrong before the first ray: a camera or a picture that cannot be.

/// Why a picture cannot be rendered.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RenderError {
    /// The eye is at the point it looks at.
    #[error("camera.eye and camera.look_at are the same point {eye:?}: they must differ")]
    EyeAtTarget {
        /// The point (m).
        eye: [f64; 3],
    },
    /// Up is along the view, so the picture could turn any way.
    #[error("camera.up {up:?} is along the direction of view {forward:?}: choose an up across it, such as [0, 0, -1]")]
    UpAlongView {
        /// Up as given.
        up: [f64; 3],
        /// Unit direction of view.
        forward: [f64; 3],
    },
    /// A number of the camera is not finite or out of range.
    #[error("camera.{key} is {value}: expected {expected}")]
    CameraValue {
        /// Key.
        key: &'static str,
        /// Value.
        value: f64,
        /// Allowed range in words.
        expected: &'static str,
    },
    /// Two keys of the path claim one frame.
    #[error("camera.key has two keys for frame {frame}: each frame may have one")]
    TwoKeys {
        /// Frame number.
        frame: f64,
    },
    /// Nothing to frame the camera on.
    #[error("camera.eye and camera.look_at are not set and there is nothing to frame: set both")]
    NothingToFrame,
    /// The beams of the caustics cannot be.
    #[error("render.beam_samples: {0}")]
    Beams(#[from] super::caustics::BeamError),
    /// A frame without a moment has nothing to show.
    #[error("a frame needs at least one moment of its shutter")]
    NoMoment,
    /// The crop is empty.
    #[error("the data window {width}x{height} at {x},{y} is empty: it must be at least one pixel wide and high")]
    EmptyWindow {
        /// Left.
        x: i32,
        /// Top.
        y: i32,
        /// Width.
        width: u32,
        /// Height.
        height: u32,
    },
    /// More shares than tiles, or no share of that number.
    #[error("--tile {index}/{count}: expected shares from 1 to at most {tiles}, the tiles of this picture")]
    EmptyShare {
        /// The share, from 1.
        index: u32,
        /// How many there should be.
        count: u32,
        /// Tiles.
        tiles: u64,
    },
    /// A range of samples that cannot be rendered by itself.
    #[error("--sample-range {start}-{end}: expected {expected}")]
    SampleRange {
        /// First sample.
        start: u32,
        /// One after the last.
        end: u32,
        /// What it has to be.
        expected: String,
    },
    /// A checkpoint cannot be gone on from.
    #[error(transparent)]
    Checkpoint(#[from] super::CheckpointError),
    /// The threads could not be started.
    #[error("could not start {threads} threads: {reason}")]
    Threads {
        /// Count asked for.
        threads: usize,
        /// The system's reason.
        reason: String,
    },
}
