//! The extra arrays of an NPZ that this project documents: what they mean, and how `inspect` knows them.
//!
//! All of them are maps (nz, nx) and optional; only those of foam are read by `render` (see `foam`). Whoever brings an array of one of these names that
//! is no such map keeps it: then it is an array like any other.

use serde::Serialize;

use super::npz::Archive;
use super::{Frame, StateError, summary::Range};

/// A documented map.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct KnownMap {
    /// Its name in the archive.
    pub name: &'static str,
    /// Its unit.
    pub unit: &'static str,
    /// What it says of a column.
    pub meaning: &'static str,
}

/// Every documented map.
pub const KNOWN: [KnownMap; 8] = [
    KnownMap { name: "vorticity", unit: "1/s", meaning: "curl of the flow about the vertical" },
    KnownMap {
        name: "turbulence",
        unit: "m/s",
        meaning: "root mean square of one component of the turbulent velocity",
    },
    KnownMap { name: "aeration", unit: "", meaning: "share of air in the water's volume, 0 to 1" },
    KnownMap { name: "foam", unit: "", meaning: "share of the column's area under foam, 0 to 1" },
    KnownMap { name: "foam_x0", unit: "m", meaning: "from x to the foam's pattern, layer 0" },
    KnownMap { name: "foam_z0", unit: "m", meaning: "from z to the foam's pattern, layer 0" },
    KnownMap { name: "foam_x1", unit: "m", meaning: "from x to the foam's pattern, layer 1" },
    KnownMap { name: "foam_z1", unit: "m", meaning: "from z to the foam's pattern, layer 1" },
];

/// A documented map in figures.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct MapSummary {
    /// Which one.
    #[serde(flatten)]
    pub map: KnownMap,
    /// Least and greatest value.
    pub range: Range,
}

/// Moves the documented maps from a frame's extra arrays to their figures, which are read from the archive at `path`.
///
/// # Errors
/// A map that is damaged or holds a number that is not finite.
pub fn summarise(frame: &mut Frame, path: &std::path::Path) -> Result<Vec<MapSummary>, StateError> {
    let shape = [frame.columns.nz as u64, frame.columns.nx as u64];
    let is_map = |known: &KnownMap, extra: &super::ExtraArray| {
        extra.name == known.name && extra.shape == shape && matches!(extra.dtype.get(1..), Some("f4" | "f8"))
    };
    let known: Vec<KnownMap> =
        KNOWN.into_iter().filter(|known| frame.extra.iter().any(|extra| is_map(known, extra))).collect();
    if known.is_empty() {
        return Ok(Vec::new());
    }
    let mut archive = Archive::open(path)?;
    let mut summaries = Vec::new();
    for map in known {
        let values = archive.read_finite(map.name)?;
        summaries.extend(Range::of(values).map(|range| MapSummary { map, range }));
    }
    frame.extra.retain(|extra| !KNOWN.iter().any(|known| is_map(known, extra)));
    Ok(summaries)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::state::{Columns, Encoding, Packing, Particles, Place, read_frame, save_frame_with};

    fn frame() -> Frame {
        Frame {
            time: 0.1,
            columns: Columns {
                origin: [1e6 + 0.1, -3.0],
                width: [0.1, 0.3],
                nx: 4,
                nz: 3,
                base: vec![0.1; 12],
                top: (0..12).map(|i| 0.1 + f64::from(i) / 3.0).collect(),
                pressure: vec![0.5; 12],
                flow: vec![[0.25, -0.0]; 12],
            },
            particles: Particles {
                position: vec![[0.1, 2.0, 3.0]],
                velocity: vec![[0.5, 0.25, -8.0]],
                mass: vec![1e-9],
                age: vec![0.0],
                id: Some(vec![7]),
            },
            extra: vec![],
        }
    }

    #[test]
    fn a_frame_with_maps_reads_back_to_the_bit_however_it_is_packed() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("time0.state");
        let map: Vec<f32> = (0..12_u8).map(|i| f32::from(i) - 4.0).collect();
        for packing in [Packing::Small, Packing::Quick, Packing::Stored] {
            save_frame_with(&frame(), &[("vorticity", &map)], &path, Encoding::Npz, packing).unwrap();
            let mut read = read_frame(&path, 0.001).unwrap();
            assert_eq!(read.extra[0].shape, [3, 4]);
            let summaries = summarise(&mut read, &path).unwrap();
            assert_eq!((summaries.len(), summaries[0].map.name), (1, "vorticity"));
            assert_eq!(summaries[0].range, Range { min: -4.0, max: 7.0 });
            assert_eq!(read, frame(), "nothing but the map was extra");
        }
        save_frame_with(&frame(), &[("vorticity", &map)], &path, Encoding::Text, Packing::Quick).unwrap();
        assert!(read_frame(&path, 0.001).unwrap().extra.is_empty());
    }

    #[test]
    fn an_array_of_a_documented_name_that_is_no_map_stays_an_other_array() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("time0.state");
        save_frame_with(&frame(), &[("vorticity", &[0.0; 12])], &path, Encoding::Npz, Packing::Stored).unwrap();
        let mut read = read_frame(&path, 0.001).unwrap();
        read.extra[0].shape = vec![3, 4, 3];
        assert_eq!(summarise(&mut read, &path).unwrap(), []);
        assert_eq!(read.extra.len(), 1);
    }

    #[test]
    fn a_map_with_a_number_that_is_none_is_not_written() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("time0.state");
        let mut map = [0.0_f32; 12];
        map[6] = f32::NAN;
        match save_frame_with(&frame(), &[("aeration", &map)], &path, Encoding::Npz, Packing::Quick) {
            Err(StateError::Unwritable(problem)) => {
                assert_eq!(problem.place, Place::Element("aeration".into(), vec![1, 2]));
            }
            other => panic!("{other:?}"),
        }
        assert!(!path.exists());
    }
}
