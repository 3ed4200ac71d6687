//! The questions: rays of an NPZ, checked number by number. Nothing here knows of scenes.

use std::path::Path;

use crate::state::{Archive, MAX_LISTED, Place, Problem, StateError};

/// Rays as a file gives them, in the files' frame (m).
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Rays {
    /// Origins.
    pub(super) origin: Vec<[f64; 3]>,
    /// Directions, of any length but zero.
    pub(super) direction: Vec<[f64; 3]>,
    /// Greatest t that counts, inclusive; +inf without an array.
    pub(super) tmax: Option<Vec<f64>>,
}

/// Reads `origin` (n, 3), `direction` (n, 3) and, where there is one, `tmax` (n), each f4 or f8.
///
/// # Errors
/// [`StateError::Damaged`] with the array and the index of everything that is no ray: a missing array, one of another
/// shape or type, a number that is not finite, a direction of zero length, a `tmax` that is negative or not a number.
pub(super) fn read(path: &Path) -> Result<Rays, StateError> {
    let mut archive = Archive::open(path)?;
    let mut problems = Problems { path, listed: Vec::new(), more: 0 };
    let mut grouped = |problems: &mut Problems, name: &str| -> Result<Vec<[f64; 3]>, StateError> {
        let values = archive.read_f64(name)?;
        let shape = archive.shape(name).unwrap_or_default();
        if shape.len() != 2 || shape[1] != 3 {
            problems.note(Place::Array(name.into()), show(shape), "shape (n, 3)".into());
            return Ok(Vec::new());
        }
        Ok(values.as_chunks().0.to_vec())
    };
    let origin = grouped(&mut problems, "origin")?;
    let direction = grouped(&mut problems, "direction")?;
    let tmax = match archive.arrays().iter().any(|array| array.name == "tmax") {
        true => Some((archive.read_f64("tmax")?, archive.shape("tmax").unwrap_or_default().to_vec())),
        false => None,
    };
    problems.settle()?;
    let count = origin.len();
    if direction.len() != count {
        let expected = format!("shape ({count}, 3) as `origin` has");
        problems.note(Place::Array("direction".into()), show(&[direction.len() as u64, 3]), expected);
    }
    if let Some((_, shape)) = tmax.as_ref().filter(|(_, shape)| shape[..] != [count as u64]) {
        problems.note(Place::Array("tmax".into()), show(shape), format!("shape ({count},), one for each ray"));
    }
    for (name, rows) in [("origin", &origin), ("direction", &direction)] {
        for (ray, row) in rows.iter().enumerate() {
            for (axis, value) in row.iter().enumerate().filter(|(_, value)| !value.is_finite()) {
                let place = Place::Element(name.into(), vec![ray as u64, axis as u64]);
                problems.note(place, value.to_string(), "a finite number".into());
            }
        }
    }
    for (ray, _) in direction.iter().enumerate().filter(|(_, row)| row.iter().all(|&value| value == 0.0)) {
        let place = Place::Element("direction".into(), vec![ray as u64]);
        problems.note(place, "(0, 0, 0)".into(), "a direction that is not zero".into());
    }
    let tmax = tmax.map(|(values, _)| values);
    for (ray, value) in tmax.iter().flatten().enumerate() {
        if value.is_nan() || *value < 0.0 {
            let place = Place::Element("tmax".into(), vec![ray as u64]);
            problems.note(place, value.to_string(), "at least 0, or inf".into());
        }
    }
    problems.settle()?;
    Ok(Rays { origin, direction, tmax })
}

fn show(shape: &[u64]) -> String {
    let lengths: Vec<String> = shape.iter().map(u64::to_string).collect();
    format!("shape ({}{})", lengths.join(", "), if shape.len() == 1 { "," } else { "" })
}

/// What is wrong, the first few by name.
struct Problems<'a> {
    path: &'a Path,
    listed: Vec<Problem>,
    more: u64,
}

impl Problems<'_> {
    fn note(&mut self, place: Place, found: String, expected: String) {
        if self.listed.len() < MAX_LISTED {
            self.listed.push(Problem { place, found, expected });
        } else {
            self.more += 1;
        }
    }

    fn settle(&mut self) -> Result<(), StateError> {
        if self.listed.is_empty() {
            return Ok(());
        }
        let problems = std::mem::take(&mut self.listed);
        Err(StateError::Damaged { path: self.path.to_path_buf(), problems, more: self.more })
    }
}
