//! One frame as an NPZ archive: which arrays it must hold and of what shape, read and written.
//!
//! Headers come first: no element is read before every array's type and shape agree with the others.

use std::io::{Seek, Write};
use std::path::Path;

use super::arrays::{ArchiveWriter, Packing};
use super::check::{self, stop_if_damaged};
use super::error::{Place, Problem, Problems, Stop};
use super::npy::show_shape;
use super::npz::{Archive, Element};
use super::{Columns, ExtraArray, Frame, Particles, StateError};

const FLOAT: &[Element] = &[Element::F4, Element::F8];
const DOUBLE: &[Element] = &[Element::F8];
const UNSIGNED: &[Element] = &[Element::U4, Element::U8];

/// Every array that is ours.
const OURS: [&str; 12] =
    ["time", "origin", "width", "base", "top", "pressure", "flow", "position", "velocity", "mass", "age", "id"];
/// The four that come together or not at all.
const PARTICLES: [&str; 4] = ["position", "velocity", "mass", "age"];

/// Reads a frame, noting what is wrong with it.
pub(super) fn read(path: &Path, dry_threshold: f64, problems: &mut Problems) -> Result<Frame, Stop> {
    let mut archive = Archive::open_or_stop(path)?;
    let sizes = layout(&archive, problems)?;
    let (nx, nz) = (sizes.nx, sizes.nz);
    let single = |values: Vec<f64>| values[0];
    let pair = |values: Vec<f64>| [values[0], values[1]];

    let mut reader = Reader { archive: &mut archive, problems };
    let time = single(reader.finite("time", &[])?);
    let origin = pair(reader.finite("origin", &[2])?);
    let width = pair(reader.finite("width", &[2])?);
    if let Some((found, expected)) = check::width(width) {
        reader.problems.note(|| Problem::new(Place::Array("width".into()), found, expected));
    }
    let map = [nz as u64, nx as u64];
    let base = reader.finite("base", &map)?;
    let top = reader.finite("top", &map)?;
    for i in 0..base.len() {
        if let Some((found, expected)) = check::heights(base[i], top[i], dry_threshold) {
            reader.problems.note(|| Problem::new(element("top", &map, i), found, expected));
        }
    }
    let pressure = if sizes.pressure { reader.finite("pressure", &map)? } else { vec![0.0; nx * nz] };
    let flow =
        if sizes.flow { grouped(&reader.finite("flow", &[map[0], map[1], 2])?) } else { vec![[0.0; 2]; nx * nz] };

    let mut particles = Particles::default();
    if let Some(n) = sizes.particles {
        particles.position = grouped(&reader.finite("position", &[n, 3])?);
        particles.velocity = grouped(&reader.finite("velocity", &[n, 3])?);
        particles.mass = reader.at_least_zero("mass", n)?;
        particles.age = reader.at_least_zero("age", n)?;
        if sizes.id {
            particles.id = Some(reader.archive.unsigned("id")?);
        }
    }
    let columns = Columns { origin, width, nx, nz, base, top, pressure, flow };
    Ok(Frame { time, columns, particles, extra: extra(&archive) })
}

/// What the headers say.
struct Sizes {
    nx: usize,
    nz: usize,
    pressure: bool,
    flow: bool,
    /// `None` if there are no particle arrays.
    particles: Option<u64>,
    id: bool,
}

/// Compares every array's presence, type and shape with what a frame must have.
fn layout(archive: &Archive, problems: &mut Problems) -> Result<Sizes, Stop> {
    let here = |name: &str| archive.find(name).is_some();
    require(archive, "time", DOUBLE, &Lengths::Exactly(vec![]), problems)?;
    require(archive, "origin", DOUBLE, &Lengths::Exactly(vec![2]), problems)?;
    require(archive, "width", DOUBLE, &Lengths::Exactly(vec![2]), problems)?;
    let map = require(archive, "base", FLOAT, &Lengths::Map, problems)?;
    let as_base = |more: &[u64]| match &map {
        Some(map) => Lengths::Exactly([map, more].concat()),
        None => Lengths::Axes(2 + more.len()),
    };
    require(archive, "top", FLOAT, &as_base(&[]), problems)?;
    let (pressure, flow) = (here("pressure"), here("flow"));
    if pressure {
        require(archive, "pressure", FLOAT, &as_base(&[]), problems)?;
    }
    if flow {
        require(archive, "flow", FLOAT, &as_base(&[2]), problems)?;
    }

    let mut particles = None;
    let id = here("id");
    if id || PARTICLES.iter().any(|name| here(name)) {
        let position = require(archive, "position", FLOAT, &Lengths::Points, problems)?;
        particles = position.map(|shape| shape[0]);
        let each = |more: &[u64]| match particles {
            Some(n) => Lengths::Exactly([&[n], more].concat()),
            None => Lengths::Axes(1 + more.len()),
        };
        require(archive, "velocity", FLOAT, &each(&[3]), problems)?;
        require(archive, "mass", FLOAT, &each(&[]), problems)?;
        require(archive, "age", FLOAT, &each(&[]), problems)?;
        if id {
            require(archive, "id", UNSIGNED, &each(&[]), problems)?;
        }
    }
    stop_if_damaged(problems)?;
    let map = map.expect("a layout without problems has a base");
    let (nx, nz) = check::grid(map[1], map[0]).expect("Lengths::Map has checked the grid");
    Ok(Sizes { nx, nz, pressure, flow, particles, id })
}

/// What a shape must be.
enum Lengths {
    Exactly(Vec<u64>),
    /// (nz, nx), within the limits of a grid.
    Map,
    /// (n, 3), within the limit of particles.
    Points,
    /// As many axes; their lengths cannot be judged, because the array that sets them is damaged.
    Axes(usize),
}

/// Notes what is wrong with an array; its shape if nothing is.
fn require(
    archive: &Archive,
    name: &str,
    types: &[Element],
    lengths: &Lengths,
    problems: &mut Problems,
) -> Result<Option<Vec<u64>>, Stop> {
    match archive.checked(name, types) {
        Ok(()) => {}
        Err(Stop::Damage(problem)) => {
            problems.note(|| *problem);
            return Ok(None);
        }
        Err(stop) => return Err(stop),
    }
    let shape = archive.shape(name).expect("a checked array has a shape");
    let expected = match lengths {
        Lengths::Exactly(expected) => (shape != expected).then(|| format!("shape {}", show_shape(expected))),
        Lengths::Map => {
            let sound = matches!(shape, &[nz, nx] if check::grid(nx, nz).is_some());
            (!sound).then(|| format!("shape (nz, nx) with {}", check::grid_expected()))
        }
        Lengths::Points => {
            let sound = matches!(shape, &[n, 3] if n <= check::MAX_ROWS);
            (!sound).then(|| format!("shape (n, 3) with n at most {}", check::MAX_ROWS))
        }
        Lengths::Axes(axes) => (shape.len() != *axes).then(|| format!("{axes} axes")),
    };
    match expected {
        None => Ok(Some(shape.to_vec())),
        Some(expected) => {
            problems.note(|| Problem::new(Place::Array(name.into()), format!("shape {}", show_shape(shape)), expected));
            Ok(None)
        }
    }
}

/// Element `flat` (C order) of an array of this shape.
pub(super) fn element(name: &str, shape: &[u64], flat: usize) -> Place {
    let mut index = vec![0; shape.len()];
    let mut rest = flat as u64;
    for axis in (0..shape.len()).rev() {
        index[axis] = rest % shape[axis];
        rest /= shape[axis];
    }
    Place::Element(name.into(), index)
}

/// Reads arrays and notes the numbers that no frame may hold.
struct Reader<'a> {
    archive: &'a mut Archive,
    problems: &'a mut Problems,
}

impl Reader<'_> {
    fn finite(&mut self, name: &str, shape: &[u64]) -> Result<Vec<f64>, Stop> {
        let values = self.archive.floats(name)?;
        for (i, value) in values.iter().enumerate() {
            if !value.is_finite() {
                self.problems.note(|| Problem::new(element(name, shape, i), value.to_string(), "a finite number"));
            }
        }
        Ok(values)
    }

    fn at_least_zero(&mut self, name: &str, n: u64) -> Result<Vec<f64>, Stop> {
        let values = self.finite(name, &[n])?;
        for (i, &value) in values.iter().enumerate() {
            if let Some((found, expected)) = check::at_least_zero(name, value) {
                self.problems.note(|| Problem::new(element(name, &[n], i), found, expected));
            }
        }
        Ok(values)
    }
}

fn grouped<const N: usize>(values: &[f64]) -> Vec<[f64; N]> {
    values.as_chunks().0.to_vec()
}

fn extra(archive: &Archive) -> Vec<ExtraArray> {
    let theirs = archive.arrays().iter().filter(|array| !OURS.contains(&array.name.as_str()));
    theirs
        .map(|array| match &array.header {
            Ok(header) => {
                ExtraArray { name: array.name.clone(), shape: header.shape.clone(), dtype: header.dtype.clone() }
            }
            // It is not ours to judge; `inspect` shows that nobody will read it.
            Err(why) => ExtraArray { name: array.name.clone(), shape: Vec::new(), dtype: format!("unreadable: {why}") },
        })
        .collect()
}

/// Writes a frame as a deflated NPZ archive. An array is f4 if that keeps every bit of its numbers, else f8.
/// Extra arrays are not written: the frame holds only their names.
///
/// # Errors
/// A value that the reader would refuse, or what the writer says.
///
/// # Panics
/// If the frame's arrays differ in length.
pub fn write_frame_npz(frame: &Frame, writer: impl Write + Seek) -> Result<(), StateError> {
    write(frame, &[], Packing::Small, writer)
}

/// As [`write_frame_npz`], with maps (nz, nx) and single numbers beside the frame's own arrays, packed as the caller says.
pub(super) fn write(
    frame: &Frame,
    maps: &[(&str, &[f32])],
    packing: Packing,
    writer: impl Write + Seek,
) -> Result<(), StateError> {
    check::writable(frame).map_err(StateError::Unwritable)?;
    let Columns { origin, width, nx, nz, base, top, pressure, flow } = &frame.columns;
    let Particles { position, velocity, mass, age, id } = &frame.particles;
    let (nx, nz, n) = (*nx as u64, *nz as u64, position.len() as u64);
    let map = [nz, nx];
    // A map has at least 9 columns: one value alone is a number.
    let shape = |values: &[f32]| -> &[u64] { if values.len() == 1 { &[] } else { &map } };
    for (name, values) in maps {
        assert!(!OURS.contains(name), "a map cannot take the name of the frame's own array {name}");
        let fits = values.len() == base.len() || values.len() == 1;
        assert!(fits, "the map {name} has {} values, there are {} columns", values.len(), base.len());
        if let Some(i) = values.iter().position(|value| !value.is_finite()) {
            let problem = Problem::new(element(name, shape(values), i), values[i].to_string(), "a finite number");
            return Err(StateError::Unwritable(problem));
        }
    }
    let mut archive = ArchiveWriter::new(writer);
    archive.pack(packing);
    archive.array("time", &[], [frame.time])?;
    archive.array("origin", &[2], *origin)?;
    archive.array("width", &[2], *width)?;
    floats(&mut archive, "base", &map, base)?;
    floats(&mut archive, "top", &map, top)?;
    floats(&mut archive, "pressure", &map, pressure)?;
    floats(&mut archive, "flow", &[nz, nx, 2], flow.as_flattened())?;
    for (name, values) in maps {
        archive.array(name, shape(values), values.iter().copied())?;
    }
    // Places and speeds of spray are noise, which deflate shrinks by a tenth in most of the time that it takes.
    archive.pack(if packing == Packing::Quick { Packing::Stored } else { packing });
    floats(&mut archive, "position", &[n, 3], position.as_flattened())?;
    floats(&mut archive, "velocity", &[n, 3], velocity.as_flattened())?;
    archive.pack(packing);
    floats(&mut archive, "mass", &[n], mass)?;
    floats(&mut archive, "age", &[n], age)?;
    if let Some(id) = id {
        archive.array("id", &[n], id.iter().copied())?;
    }
    archive.finish()
}

fn floats<W: Write + Seek>(
    archive: &mut ArchiveWriter<W>,
    name: &str,
    shape: &[u64],
    values: &[f64],
) -> Result<(), StateError> {
    // Bits, not values: -0 must stay -0.
    let exact = values.iter().all(|&value| f64::from(value as f32).to_bits() == value.to_bits());
    if exact {
        archive.array(name, shape, values.iter().map(|&value| value as f32))
    } else {
        archive.array(name, shape, values.iter().copied())
    }
}
