//! The simulation's files: `model.state`, `time###.state` as text and as NPZ.
//!
//! Everything here is double precision in the file's own frame; nothing is recentred or repaired.
//! [`read_frame`] and [`read_model`] are the ways in, [`FrameSequence`] finds a scene's frames, [`save_frame`] and
//! [`save_model`] the ways out. A file that is wrong is a [`StateError::Damaged`] that lists what and where.

use std::fs::File;
use std::io::{BufReader, Read};
use std::path::Path;

pub mod maps;
pub mod summary;

mod arrays;
mod between;
mod check;
mod error;
mod foam;
mod frame_npz;
mod frame_text;
mod lines;
mod lives;
mod model_text;
mod npy;
mod npz;
mod sequence;
mod whole_file;

pub use arrays::{ArchiveWriter, Packing, write_arrays};
pub use between::between;
pub use check::MAX_ROWS;
pub use error::{MAX_LISTED, Place, Problem, StateError};
pub use foam::{FoamArrays, StoredFoam, read_foam};
pub use frame_npz::write_frame_npz;
pub use frame_text::write_frame_text;
pub use lives::carried_on;
pub use model_text::write_model;
pub use npy::Header;
pub use npz::{Archive, Array};
pub use sequence::{FramePattern, FrameSequence};

use error::Problems;

/// What a file is, by its first bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FileKind {
    /// A frame.
    Frame(Encoding),
    /// A model.
    Model,
}

/// The two forms of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Encoding {
    /// Decimal text.
    Text,
    /// An archive of numpy arrays.
    Npz,
}

/// What a file is, whatever its name.
///
/// # Errors
/// A file that cannot be opened, is not a regular one, or opens as neither a frame nor a model.
pub fn detect(path: impl AsRef<Path>) -> Result<FileKind, StateError> {
    let path = path.as_ref();
    let mut file = open(path)?;
    if is_zip(&mut file).map_err(StateError::at(path))? {
        return Ok(FileKind::Frame(Encoding::Npz));
    }
    let first = lines::Lines::new(BufReader::new(file)).and_then(|lines| match lines.keyword() {
        Some(frame_text::MAGIC) => Ok(FileKind::Frame(Encoding::Text)),
        Some(model_text::MAGIC) => Ok(FileKind::Model),
        _ => {
            let expected = format!("`{} 1`, `{} 1` or an NPZ archive", frame_text::MAGIC, model_text::MAGIC);
            Err(lines.unexpected(expected).into())
        }
    });
    Problems::default().settle(path, first)
}

/// Reads one time step, text or NPZ by the file's first bytes.
///
/// *Units*: metres, seconds, kilograms in the file's own frame; `dry_threshold` (m) is how far `top` may lie under `base`.
///
/// # Errors
/// [`StateError::Damaged`] with every problem that could be told apart (up to [`MAX_LISTED`]), or what the system says.
/// No size that a file claims is believed beyond what its bytes can hold.
pub fn read_frame(path: impl AsRef<Path>, dry_threshold: f64) -> Result<Frame, StateError> {
    let path = path.as_ref();
    if !(dry_threshold.is_finite() && dry_threshold >= 0.0) {
        return Err(StateError::DryThreshold(dry_threshold));
    }
    let mut file = open(path)?;
    let mut problems = Problems::default();
    let frame = if is_zip(&mut file).map_err(StateError::at(path))? {
        frame_npz::read(path, dry_threshold, &mut problems)
    } else {
        let bytes = file.metadata().map_err(StateError::at(path))?.len();
        frame_text::read(BufReader::with_capacity(1 << 16, file), bytes, dry_threshold, &mut problems)
    };
    problems.settle(path, frame)
}

/// Reads what does not move.
///
/// # Errors
/// As [`read_frame`].
pub fn read_model(path: impl AsRef<Path>) -> Result<Model, StateError> {
    let path = path.as_ref();
    let file = open(path)?;
    let mut problems = Problems::default();
    let model = model_text::read(BufReader::new(file), &mut problems);
    problems.settle(path, model)
}

/// Writes a frame into a file that has its name only when it is whole.
///
/// # Errors
/// A value that the reader would refuse, or what the system says.
///
/// # Panics
/// If the frame's arrays differ in length.
pub fn save_frame(frame: &Frame, path: impl AsRef<Path>, encoding: Encoding) -> Result<(), StateError> {
    whole_file::write_whole(path.as_ref(), |writer| match encoding {
        Encoding::Text => write_frame_text(frame, writer),
        Encoding::Npz => write_frame_npz(frame, writer),
    })
}

/// As [`save_frame`], with extra maps (nz, nx) and single numbers, f4, which text has no place for; an archive is packed as `packing` says.
/// What the documented maps mean is in [`maps`].
///
/// # Errors
/// As [`save_frame`]; a map's number that is not finite.
///
/// # Panics
/// If the frame's arrays or the maps differ in length, or a map has the name of one of the frame's own arrays.
pub fn save_frame_with(
    frame: &Frame,
    maps: &[(&str, &[f32])],
    path: impl AsRef<Path>,
    encoding: Encoding,
    packing: Packing,
) -> Result<(), StateError> {
    whole_file::write_whole(path.as_ref(), |writer| match encoding {
        Encoding::Text => write_frame_text(frame, writer),
        Encoding::Npz => frame_npz::write(frame, maps, packing, writer),
    })
}

/// Writes a model into a file that has its name only when it is whole.
///
/// # Errors
/// As [`write_model`], or what the system says.
pub fn save_model(model: &Model, path: impl AsRef<Path>) -> Result<(), StateError> {
    whole_file::write_whole(path.as_ref(), |writer| write_model(model, writer))
}

/// Opens a regular file: a pipe cannot be sought in, a device may never end.
fn open(path: &Path) -> Result<File, StateError> {
    let metadata = std::fs::metadata(path).map_err(StateError::at(path))?;
    if !metadata.is_file() {
        return Err(StateError::NotAFile { path: path.to_path_buf() });
    }
    File::open(path).map_err(StateError::at(path))
}

/// Whether a file opens as a zip archive (with an entry, or empty); leaves it at its start.
fn is_zip(file: &mut File) -> std::io::Result<bool> {
    use std::io::Seek;
    let mut start = Vec::new();
    file.by_ref().take(4).read_to_end(&mut start)?;
    file.rewind()?;
    Ok(start == b"PK\x03\x04" || start == b"PK\x05\x06")
}

/// One time step.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Frame {
    /// Time (s).
    pub time: f64,
    /// The body of water.
    pub columns: Columns,
    /// The spray.
    pub particles: Particles,
    /// Arrays of an NPZ that are not ours: kept out of the way, named by `inspect`.
    pub extra: Vec<ExtraArray>,
}

/// An array that a frame carries and we do not read.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct ExtraArray {
    /// Its name in the archive.
    pub name: String,
    /// Its shape.
    pub shape: Vec<u64>,
    /// Its numpy type string, as `<f4`.
    pub dtype: String,
}

/// A map of columns. Index `z * nx + x`; row 0 is the northern edge (least z).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Columns {
    /// x, z of the centre of column (0, 0) (m).
    pub origin: [f64; 2],
    /// dx, dz of every column (m), positive.
    pub width: [f64; 2],
    /// Columns along x, at least 3.
    pub nx: usize,
    /// Columns along z, at least 3.
    pub nz: usize,
    /// Height of the terrain (m).
    pub base: Vec<f64>,
    /// Height of the water's upper side (m).
    pub top: Vec<f64>,
    /// Pressure above air (Pa).
    pub pressure: Vec<f64>,
    /// Depth-averaged velocity, x and z (m/s).
    pub flow: Vec<[f64; 2]>,
}

impl Columns {
    /// Water at rest without pressure: `count` columns of a `width` (m) over level ground at `base` (m), filled to `top` (m); the first
    /// one's centre (x, z) is at `origin` (m).
    pub fn level(origin: [f64; 2], width: [f64; 2], [nx, nz]: [usize; 2], base: f64, top: f64) -> Self {
        let count = nx * nz;
        let (base, top) = (vec![base; count], vec![top; count]);
        Self { origin, width, nx, nz, base, top, pressure: vec![0.0; count], flow: vec![[0.0; 2]; count] }
    }
}

/// Spray, one array per field.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Particles {
    /// x, y, z (m).
    pub position: Vec<[f64; 3]>,
    /// Velocity (m/s).
    pub velocity: Vec<[f64; 3]>,
    /// Mass of water (kg).
    pub mass: Vec<f64>,
    /// Time since it broke free (s).
    pub age: Vec<f64>,
    /// Stable identities, where the file has them.
    pub id: Option<Vec<u64>>,
}

/// What does not move.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Model {
    /// Quadrilaterals.
    pub panels: Vec<Panel>,
    /// Spheres.
    pub spheres: Vec<Sphere>,
    /// Paths of meshes, relative to the model file, as written.
    pub meshes: Vec<String>,
}

/// A quadrilateral, corners counter-clockwise seen from outside.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Panel {
    /// Corners (m).
    pub corners: [[f64; 3]; 4],
    /// Linear Rec.709 albedo.
    pub albedo: [f64; 3],
}

/// A sphere.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sphere {
    /// Centre (m).
    pub center: [f64; 3],
    /// Radius (m).
    pub radius: f64,
    /// Linear Rec.709 albedo.
    pub albedo: [f64; 3],
}
