//! The foam that a frame may carry: arrays of an NPZ that this project documents, read and checked only where foam is drawn.
//!
//! What they mean is in `maps`; who makes and carries foam is the room `foam`.

use std::path::Path;

use super::check::stop_if_damaged;
use super::error::{Place, Problem, Problems, Stop};
use super::frame_npz::element;
use super::npy::show_shape;
use super::npz::{Archive, Element};
use super::{Columns, Encoding, FileKind, StateError, detect};

/// Foam as it is stored.
#[derive(Clone, Debug, PartialEq)]
pub struct StoredFoam {
    /// Share of each column's area under foam, 0..1.
    pub density: Vec<f32>,
    /// For each layer of the pattern, what to add to x and z (m) of a column to get its place in the pattern.
    pub offset: [Vec<[f32; 2]>; StoredFoam::LAYERS],
    /// Seconds after which a layer starts anew.
    pub renewal: f64,
}

/// The offsets' names, by layer and axis.
const OFFSETS: [[&str; 2]; StoredFoam::LAYERS] = [["foam_x0", "foam_z0"], ["foam_x1", "foam_z1"]];
/// The renewal's.
const RENEWAL: &str = "foam_renewal";
/// The density's.
const DENSITY: &str = "foam";

/// What a frame's archive holds of foam.
#[derive(Clone, Debug, PartialEq)]
pub enum FoamArrays {
    /// Nothing.
    None,
    /// How much there is, but not how its pattern has moved.
    Density(Vec<f32>),
    /// All.
    Whole(StoredFoam),
}

impl StoredFoam {
    /// Layers of texture coordinates.
    pub const LAYERS: usize = 2;

    /// The arrays as [`super::save_frame_with`] takes them: maps, and the renewal as a single number.
    pub fn arrays(&self) -> Vec<(&'static str, Vec<f32>)> {
        let mut arrays = vec![(DENSITY, self.density.clone())];
        for (names, layer) in OFFSETS.iter().zip(&self.offset) {
            arrays.extend((0..2).map(|axis| (names[axis], layer.iter().map(|offset| offset[axis]).collect())));
        }
        arrays.push((RENEWAL, vec![self.renewal as f32]));
        arrays
    }
}

/// Reads the foam arrays beside a frame's own; a text frame has none.
///
/// # Errors
/// [`StateError::Damaged`] with array and index for a wrong type or shape, a number that is not finite, a density outside
/// 0..1, offsets without density or not all of them; what the system says.
pub fn read_foam(path: impl AsRef<Path>, columns: &Columns) -> Result<FoamArrays, StateError> {
    let path = path.as_ref();
    if detect(path)? != FileKind::Frame(Encoding::Npz) {
        return Ok(FoamArrays::None);
    }
    let mut problems = Problems::default();
    let read = read(path, columns, &mut problems);
    problems.settle(path, read)
}

fn read(path: &Path, columns: &Columns, problems: &mut Problems) -> Result<FoamArrays, Stop> {
    let mut archive = Archive::open_or_stop(path)?;
    let pattern: Vec<&str> = OFFSETS.as_flattened().iter().copied().chain([RENEWAL]).collect();
    let any = pattern.iter().any(|name| archive.find(name).is_some());
    if archive.find(DENSITY).is_none() && !any {
        return Ok(FoamArrays::None);
    }
    let map = [columns.nz as u64, columns.nx as u64];
    let wanted: Vec<&str> = [DENSITY].into_iter().chain(pattern.into_iter().filter(|_| any)).collect();
    for name in &wanted {
        let expected: &[u64] = if *name == RENEWAL { &[] } else { &map };
        match archive.checked(name, &[Element::F4, Element::F8]) {
            Ok(()) => {
                let shape = archive.shape(name).unwrap_or_default();
                if shape != expected {
                    let found = format!("shape {}", show_shape(shape));
                    let expected = format!("shape {}", show_shape(expected));
                    problems.note(|| Problem::new(Place::Array((*name).into()), found, expected));
                }
            }
            Err(Stop::Damage(problem)) => problems.note(|| *problem),
            Err(stop) => return Err(stop),
        }
    }
    stop_if_damaged(problems)?;
    let mut single = |name: &str, sound: &dyn Fn(f32) -> bool, expected: &str| -> Result<Vec<f32>, Stop> {
        let values: Vec<f32> = archive.floats(name)?.into_iter().map(|value| value as f32).collect();
        let shape: &[u64] = if name == RENEWAL { &[] } else { &map };
        for (i, &value) in values.iter().enumerate() {
            if !sound(value) {
                problems.note(|| Problem::new(element(name, shape, i), value.to_string(), expected));
            }
        }
        Ok(values)
    };
    let density = single(DENSITY, &|value| (0.0..=1.0).contains(&value), "a share from 0 to 1")?;
    if !any {
        stop_if_damaged(problems)?;
        return Ok(FoamArrays::Density(density));
    }
    let mut offset = [const { Vec::new() }; StoredFoam::LAYERS];
    for (layer, names) in offset.iter_mut().zip(OFFSETS) {
        let x = single(names[0], &|value| value.is_finite(), "a finite number")?;
        let z = single(names[1], &|value| value.is_finite(), "a finite number")?;
        *layer = x.into_iter().zip(z).map(|(x, z)| [x, z]).collect();
    }
    let renewal = single(RENEWAL, &|value| value > 0.0 && value.is_finite(), "seconds above 0")?;
    stop_if_damaged(problems)?;
    Ok(FoamArrays::Whole(StoredFoam { density, offset, renewal: f64::from(renewal[0]) }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::state::{Frame, Packing, read_frame, save_frame_with};

    fn frame() -> Frame {
        let columns = Columns::level([1.0, -3.0], [0.5, 0.25], [4, 3], 0.0, 1.0);
        Frame { time: 1.5, columns, ..Frame::default() }
    }

    fn foam() -> StoredFoam {
        let ramp = |scale: f32| (0..12_u8).map(move |i| scale * f32::from(i) / 11.0);
        StoredFoam {
            density: ramp(1.0).collect(),
            offset: [0.3, -7.5].map(|scale| ramp(scale).zip(ramp(2.0)).map(|(x, z)| [x, z]).collect()),
            renewal: 1.75,
        }
    }

    fn saved(arrays: &[(&str, Vec<f32>)], encoding: Encoding) -> Result<FoamArrays, StateError> {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("time0.state");
        let arrays: Vec<(&str, &[f32])> = arrays.iter().map(|(name, values)| (*name, values.as_slice())).collect();
        save_frame_with(&frame(), &arrays, &path, encoding, Packing::Quick).unwrap();
        let read = read_frame(&path, 0.001).unwrap();
        read_foam(&path, &read.columns)
    }

    #[test]
    fn foam_reads_back_to_the_bit_and_text_has_none() {
        assert_eq!(saved(&foam().arrays(), Encoding::Npz).unwrap(), FoamArrays::Whole(foam()));
        assert_eq!(saved(&foam().arrays()[..1], Encoding::Npz).unwrap(), FoamArrays::Density(foam().density));
        assert_eq!(saved(&[], Encoding::Npz).unwrap(), FoamArrays::None);
        assert_eq!(saved(&foam().arrays(), Encoding::Text).unwrap(), FoamArrays::None);
    }

    #[test]
    fn bad_foam_is_refused_by_array_and_index() {
        let changed = |name: &str, index: usize, value: f32| {
            let mut arrays = foam().arrays();
            arrays.iter_mut().find(|(other, _)| *other == name).unwrap().1[index] = value;
            saved(&arrays, Encoding::Npz).unwrap_err().to_string()
        };
        for (name, index, value, expected) in [
            ("foam", 6, -0.25, "`foam`[1][2]"),
            ("foam", 6, 1.5, "`foam`[1][2]"),
            ("foam_renewal", 0, 0.0, "foam_renewal"),
        ] {
            let message = changed(name, index, value);
            assert!(message.contains(expected) && message.contains(&value.to_string()), "{message}");
        }
        let mut arrays = foam().arrays();
        arrays.remove(3);
        let message = saved(&arrays, Encoding::Npz).unwrap_err().to_string();
        assert!(message.contains("foam_x1"), "{message}");
        arrays.remove(0);
        let message = saved(&arrays, Encoding::Npz).unwrap_err().to_string();
        assert!(message.contains("no array `foam`"), "{message}");
    }

    #[test]
    fn foam_of_another_shape_or_not_finite_is_refused() {
        use crate::state::{ArchiveWriter, write_arrays};
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("time0.state");
        let written = |shape: [u64; 2], value: f32| {
            write_arrays(&path, |archive: &mut ArchiveWriter<_>| {
                let count = (shape[0] * shape[1]) as usize;
                archive.array("foam", &shape, (0..count).map(|i| if i == 7 { value } else { 0.5 }))
            })
            .unwrap();
            read_foam(&path, &frame().columns).unwrap_err().to_string()
        };
        let message = written([4, 3], 0.5);
        assert!(message.contains("foam") && message.contains("(4, 3)") && message.contains("(3, 4)"), "{message}");
        for value in [f32::NAN, f32::INFINITY] {
            let message = written([3, 4], value);
            assert!(message.contains("`foam`[1][3]"), "{message}");
        }
    }
}
