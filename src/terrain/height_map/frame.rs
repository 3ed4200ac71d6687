//! A frame of a simulation as a height map, and any other NPZ with an array `base`; `width` and `origin` may be missing.

use std::path::Path;

use crate::state::{self, Archive, Encoding, FileKind};

use super::super::TerrainError;
use super::{Raster, counts, open};

/// Most bytes that one byte of deflate can stand for (zlib's technical notes).
const DEFLATE_RATIO: u64 = 1032;

pub(super) fn read(path: &Path) -> Result<Raster, TerrainError> {
    let (_, bytes) = open(path)?;
    let wrong = |place: &str, found: String, expected: &str| TerrainError::Map {
        path: path.to_path_buf(),
        place: place.to_owned(),
        found,
        expected: expected.to_owned(),
    };
    match state::detect(path)? {
        FileKind::Frame(Encoding::Npz) => {}
        FileKind::Frame(Encoding::Text) => {
            // Only the ground is used: where the water's upper side lies does not matter.
            let columns = state::read_frame(path, f64::MAX)?.columns;
            let state::Columns { origin, width, nx, nz, base, .. } = columns;
            return Ok(Raster { nx, nz, values: base, spacing: Some(width), origin });
        }
        FileKind::Model => return Err(wrong("file", "a model".to_owned(), "a frame, or an NPZ with an array `base`")),
    }
    let mut archive = Archive::open(path)?;
    let sizes = match archive.shape("base") {
        Some(&[nz, nx]) => Some([nx, nz]),
        Some(shape) => return Err(wrong("array `base`", format!("shape {shape:?}"), "two axes, (nz, nx)")),
        None => None,
    };
    // Before the numbers are read; an array that is not there is the archive's to tell.
    let sizes = sizes.map(|[nx, nz]| counts(path, nx, nz, 32, DEFLATE_RATIO, bytes)).transpose()?;
    let values = archive.read_f64("base")?;
    let [nx, nz] = sizes.expect("an array that was read has a shape");
    let mut pair = |name: &str| -> Result<Option<[f64; 2]>, TerrainError> {
        if !archive.arrays().iter().any(|array| array.name == name) {
            return Ok(None);
        }
        // Its length before its numbers, so that nothing large is read.
        let place = format!("array `{name}`");
        let shape = archive.shape(name).map(<[u64]>::to_vec);
        if shape.as_deref().is_some_and(|shape| shape != [2]) {
            return Err(wrong(&place, format!("shape {shape:?}"), "shape (2,): x and z"));
        }
        let values = archive.read_f64(name)?;
        match <[f64; 2]>::try_from(values) {
            Ok(pair) if pair.iter().all(|value| value.is_finite()) => Ok(Some(pair)),
            Ok(pair) => Err(wrong(&place, format!("{pair:?}"), "finite numbers")),
            Err(values) => Err(wrong(&place, format!("{} numbers", values.len()), "shape (2,): x and z")),
        }
    };
    let (spacing, origin) = (pair("width")?, pair("origin")?);
    if let Some(width) = spacing.filter(|width| width.iter().any(|width| *width <= 0.0)) {
        return Err(wrong("array `width`", format!("{width:?}"), "numbers above 0"));
    }
    Ok(Raster { nx, nz, values, spacing, origin: origin.unwrap_or_default() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::state::{Columns, Frame};
    use crate::terrain::{HeightMap, Reading};

    #[test]
    fn our_own_frames_are_height_maps_in_both_forms() {
        let folder = tempfile::tempdir().unwrap();
        let columns = Columns {
            origin: [3.0, -4.0],
            width: [0.5, 0.25],
            nx: 4,
            nz: 3,
            base: (0..12).map(|i| 0.1 * f64::from(i * i)).collect(),
            top: vec![20.0; 12],
            pressure: vec![0.0; 12],
            flow: vec![[0.0; 2]; 12],
        };
        let frame = Frame { columns: columns.clone(), ..Frame::default() };
        for (name, encoding) in [("a.state", Encoding::Text), ("b.state", Encoding::Npz), ("c.npz", Encoding::Npz)] {
            let path = folder.path().join(name);
            state::save_frame(&frame, &path, encoding).unwrap();
            let map = HeightMap::read(&path, &Reading::default()).unwrap();
            assert_eq!((map.nx, map.nz, map.spacing, map.origin), (4, 3, columns.width, columns.origin), "{name}");
            assert_eq!(map.heights, columns.base, "{name}");
        }
    }

    #[test]
    fn a_bare_array_needs_a_spacing_and_wrong_shapes_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("base.npz");
        let read = |reading: &Reading| HeightMap::read(&path, reading);
        let write = |shape: &[u64], width: &[f64]| {
            state::write_arrays(&path, |archive| {
                archive.array("base", shape, (0..shape.iter().product()).map(|i: u64| i as f32))?;
                if width.is_empty() { Ok(()) } else { archive.array("width", &[width.len() as u64], width.to_vec()) }
            })
            .unwrap();
        };
        write(&[2, 3], &[]);
        let error = read(&Reading::default()).unwrap_err().to_string();
        assert!(error.contains("simulation.terrain.spacing"), "{error}");
        let map = read(&Reading { spacing: Some([2.0, 1.0]), ..Reading::default() }).unwrap();
        assert_eq!((map.nx, map.heights.as_slice()), (3, [0.0, 1.0, 2.0, 3.0, 4.0, 5.0].as_slice()));
        for (shape, width, word) in [
            (&[6][..], &[1.0, 1.0][..], "two axes"),
            (&[2, 3], &[1.0], "shape (2,)"),
            (&[2, 3], &[1.0, 0.0], "above 0"),
            (&[2, 3], &[1.0, f64::NAN], "finite"),
            (&[0, 3], &[1.0, 1.0], "0 samples"),
        ] {
            write(shape, width);
            let error = read(&Reading::default()).unwrap_err().to_string();
            assert!(error.contains(word) && error.contains("base.npz"), "{error} without {word}");
        }
        std::fs::write(&path, "PK").unwrap();
        assert!(read(&Reading::default()).is_err());
    }
}
