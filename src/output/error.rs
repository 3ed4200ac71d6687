//! Everything that can go wrong between a finished picture and a file, as data.
//! Sorted by whose fault it is: the request, the picture, what we do not support, the system.

use std::path::PathBuf;

/// Why a picture was not written or not read. Every variant says what was found and what was expected.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum OutputError {
    // You asked wrongly.
    /// The file's extension names no format that we write.
    #[error("{path}: unknown image extension; known are .exr .png .jpg .jpeg .bmp .tif .tiff")]
    UnknownExtension {
        /// The path asked for.
        path: PathBuf,
    },
    /// The path ends in no file name.
    #[error("{path:?} names no file; expected a path that ends in a file name such as picture.exr")]
    NoFileName {
        /// The path asked for.
        path: PathBuf,
    },
    /// The folder to write into is not there.
    #[error("{path}: the folder {directory} does not exist")]
    DirectoryMissing {
        /// The path asked for.
        path: PathBuf,
        /// The folder that is missing.
        directory: PathBuf,
    },
    /// The target is a folder.
    #[error("{path} is a folder; expected the name of a file to write")]
    IsDirectory {
        /// The path asked for.
        path: PathBuf,
    },
    /// The target exists and is neither file nor folder.
    #[error("{path} is not a regular file; a picture can only replace a regular file")]
    NotRegular {
        /// The path asked for.
        path: PathBuf,
    },
    /// The target exists and is read-only.
    #[error("{path} is read-only; make it writable or choose another name")]
    ReadOnly {
        /// The path asked for.
        path: PathBuf,
    },
    /// Another program is writing the target.
    #[error("{path} is being written by another render; wait for it or choose another name")]
    InUse {
        /// The path asked for.
        path: PathBuf,
    },
    /// `output.writer = "oiio"` in a program without OpenImageIO.
    #[error(
        "{path}: output.writer = \"oiio\" needs OpenImageIO, which this program was built without; build with \
         `--features oiio` (`make full`), or set output.writer = \"exr\""
    )]
    OiioNotBuilt {
        /// The path asked for.
        path: PathBuf,
    },
    /// A layer of that name does not exist.
    #[error("unknown layer `{name}`{}; known are {known}", nearest.as_ref().map(|n| format!(" (did you mean `{n}`?)")).unwrap_or_default())]
    UnknownLayer {
        /// The name given.
        name: String,
        /// The known name most like it, if one is.
        nearest: Option<String>,
        /// Every known name.
        known: String,
    },
    /// The layer exists, but this picture does not have it.
    #[error("this picture has no layer `{name}`; it has {present}")]
    AbsentLayer {
        /// The name given.
        name: String,
        /// The layers that the picture has.
        present: String,
    },

    // The picture is wrong.
    /// A channel is called something that a compositor would rename.
    #[error(
        "channel `{name}`: expected at most three parts joined by dots, each of letters, digits and underscores and \
         starting with a letter, 255 characters in all"
    )]
    ChannelName {
        /// The channel.
        name: String,
    },
    /// Two channels of one name.
    #[error("channel `{name}` is there twice")]
    DuplicateChannel {
        /// The channel.
        name: String,
    },
    /// A channel does not fill the data window.
    #[error("channel `{channel}` has {samples} samples; the data window has {expected}")]
    ChannelSize {
        /// The channel.
        channel: String,
        /// Samples found.
        samples: usize,
        /// Width times height.
        expected: usize,
    },
    /// A window without pixels, or beyond what the format can say.
    #[error("{what} of {width} x {height} pixels at ({x}, {y}); expected 1 to 2^30 pixels each way")]
    Window {
        /// Which window.
        what: &'static str,
        /// Left.
        x: i32,
        /// Top.
        y: i32,
        /// Width found.
        width: u32,
        /// Height found.
        height: u32,
    },
    /// A picture without channels.
    #[error("the picture has no channels")]
    NoChannels,
    /// A channel that the format needs is missing.
    #[error("{path}: needs channel `{channel}`, which the picture does not have")]
    MissingChannel {
        /// The path asked for.
        path: PathBuf,
        /// The channel.
        channel: &'static str,
    },
    /// A sample is infinite or not a number; nothing was written.
    #[error("channel `{channel}` is {value} at pixel ({x}, {y}); expected finite samples, nothing was written")]
    NonFinite {
        /// The channel.
        channel: String,
        /// Column, in the display window's pixels.
        x: i32,
        /// Row, in the display window's pixels.
        y: i32,
        /// The sample.
        value: f32,
    },
    /// The program that encodes films is missing, or has refused.
    #[error("{program}: {message}")]
    Encoder {
        /// The program.
        program: PathBuf,
        /// What it said.
        message: String,
    },
    /// A piece of metadata that no file can hold.
    #[error("attribute `{name}` is {value}; expected {expected}")]
    Attribute {
        /// The attribute.
        name: &'static str,
        /// What it was.
        value: String,
        /// What it has to be.
        expected: &'static str,
    },
    /// Nothing of the data window is inside the frame, so a display picture would be empty.
    #[error("{path}: nothing of the rendered window lies inside the frame")]
    OutsideFrame {
        /// The path asked for.
        path: PathBuf,
    },

    // We do not support that.
    /// A file that is whole but not of the kind we read, or a format that lacks something.
    #[error("{path}: {what}")]
    Unsupported {
        /// The file.
        path: PathBuf,
        /// What is not supported.
        what: String,
    },

    // The system failed.
    /// No viewer for a preview.
    #[error("{address}: no viewer answers ({source}); expected a running tev")]
    Viewer {
        /// Host and port.
        address: String,
        /// The system's answer.
        source: std::io::Error,
    },
    /// A file operation failed: disk full, no permission, …
    #[error("could not {action} {path}: {source}")]
    Io {
        /// What was being done.
        action: &'static str,
        /// The file or folder.
        path: PathBuf,
        /// The system's answer.
        source: std::io::Error,
    },
    /// The crate `exr` refused.
    #[error("{path}: {source}")]
    Exr {
        /// The file.
        path: PathBuf,
        /// Its answer.
        source: exr::error::Error,
    },
    /// The crate `image` refused.
    #[error("{path}: {source}")]
    Image {
        /// The file.
        path: PathBuf,
        /// Its answer.
        source: image::ImageError,
    },
    /// OpenImageIO refused.
    #[error("{path}: OpenImageIO: {message}")]
    Oiio {
        /// The file.
        path: PathBuf,
        /// Its answer.
        message: String,
    },
    /// What was read back is not what was written; the file was not put under its name.
    #[error("{path}: read back after writing, {what}; the file was discarded")]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What differs.
        what: String,
    },
}
