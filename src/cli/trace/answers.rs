//! The answers as an NPZ that has its name only when it is whole.

use std::path::Path;

use crate::state::{StateError, write_arrays};

/// No object was hit.
pub(super) const NO_OBJECT: i32 = -1;

/// The answer to one ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Answer {
    /// Where on the ray as given, in lengths of its direction; +inf for a miss.
    pub(super) t: f64,
    /// Unit normal; 0 for a miss.
    pub(super) normal: [f32; 3],
    /// Index into the names; [`NO_OBJECT`] for a miss.
    pub(super) object: i32,
    /// The solver could not decide somewhere on the way.
    pub(super) gave_up: bool,
}

impl Answer {
    /// Nothing there.
    pub(super) const MISS: Self = Self { t: f64::INFINITY, normal: [0.0; 3], object: NO_OBJECT, gave_up: false };
}

/// Writes `t` (n, f8), `normal` (n, 3, f4), `object` (n, i4), `objects` (names) and `gave_up` (n, bool).
///
/// # Errors
/// What the system says.
pub(super) fn write(path: &Path, answers: &[Answer], objects: &[String]) -> Result<(), StateError> {
    let count = answers.len() as u64;
    write_arrays(path, |archive| {
        archive.array("t", &[count], answers.iter().map(|answer| answer.t))?;
        archive.array("normal", &[count, 3], answers.iter().flat_map(|answer| answer.normal))?;
        archive.array("object", &[count], answers.iter().map(|answer| answer.object))?;
        archive.names("objects", objects)?;
        archive.array("gave_up", &[count], answers.iter().map(|answer| answer.gave_up))
    })
}
