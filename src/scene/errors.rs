//! What can be wrong with a scene: each error carries its place, the key's full path, the value and what was expected.
//!
//! A file is read to its end before any of this is reported, so errors travel as a list, [`SceneErrors`].

use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Where a value was written.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub enum Place {
    /// In a file; line and column count from 1, columns in characters.
    File {
        /// The scene file as it was named.
        file: Arc<Path>,
        /// Line.
        line: u32,
        /// Column.
        column: u32,
    },
    /// On the command line, as `--set camera.fov` or `--solver`.
    Argument(Arc<str>),
}

impl fmt::Display for Place {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::File { file, line, column } => write!(formatter, "{}:{line}:{column}", file.display()),
            Self::Argument(option) => formatter.write_str(option),
        }
    }
}

impl Place {
    /// Orders errors as a reader meets them: down the file, then along the command line.
    fn rank(&self) -> (u32, u32) {
        match self {
            Self::File { line, column, .. } => (*line, *column),
            Self::Argument(_) => (u32::MAX, 0),
        }
    }
}

/// One thing that is wrong with a scene.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SceneError {
    /// There is no such file.
    #[error("{}: there is no such scene file", path.display())]
    NotFound {
        /// The file as it was named.
        path: PathBuf,
    },
    /// A folder was named instead of a file.
    #[error("{}: this is a folder; expected a scene file (TOML)", path.display())]
    Directory {
        /// The folder.
        path: PathBuf,
    },
    /// The system could not read it.
    #[error("{}: cannot be read", path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// Too much to be a scene file.
    #[error("{}: larger than {limit} bytes; expected a scene file (TOML), not the simulation's data", path.display())]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// The most that is read, in bytes.
        limit: u64,
    },
    /// TOML is UTF-8.
    #[error("{place}: byte 0x{byte:02x} is not UTF-8; expected a scene file (TOML text)")]
    NotText {
        /// The first such byte.
        place: Place,
        /// Its value.
        byte: u8,
    },
    /// A file of the simulation.
    #[error("{}: this is a simulation file ({signature}); expected a scene file (TOML), which names such files", path.display())]
    Simulation {
        /// The file.
        path: PathBuf,
        /// Its first word.
        signature: &'static str,
    },
    /// Not TOML.
    #[error("{place}: {message}")]
    Syntax {
        /// Where.
        place: Place,
        /// What the TOML parser says.
        message: String,
    },
    /// A key that no scene has.
    #[error("{place}: unknown key `{key}`; the nearest known key is `{nearest}`")]
    UnknownKey {
        /// Where.
        place: Place,
        /// The full path as it was written.
        key: String,
        /// The full path of the known key that is nearest.
        nearest: String,
    },
    /// A text where a number belongs, a wrong count of numbers, and the like.
    #[error("{place}: `{key}` = {value}: expected {expected}")]
    WrongType {
        /// Where.
        place: Place,
        /// The full path.
        key: String,
        /// The value as written.
        value: String,
        /// What belongs there.
        expected: String,
    },
    /// A number outside its range, or not finite.
    #[error("{place}: `{key}` = {value} is out of range: expected {expected}")]
    OutOfRange {
        /// Where.
        place: Place,
        /// The full path.
        key: String,
        /// The value as written.
        value: String,
        /// The range.
        expected: String,
    },
    /// A name that is not in the key's list.
    #[error("{place}: `{key}` = {value}: expected one of {}; the nearest is `{nearest}`", quoted(allowed))]
    UnknownName {
        /// Where.
        place: Place,
        /// The full path.
        key: String,
        /// The value as written.
        value: String,
        /// The names that the key takes.
        allowed: &'static [String],
        /// The one that is nearest.
        nearest: String,
    },
    /// A key without which there is no scene.
    #[error("{place}: `{key}` is missing: expected {expected}")]
    Missing {
        /// The table in which it is missing, or the file's beginning.
        place: Place,
        /// The full path.
        key: String,
        /// What to write.
        expected: String,
    },
    /// A value that is right by itself, but not beside another.
    #[error("{place}: `{key}` = {value}: expected {expected}")]
    Inconsistent {
        /// Where.
        place: Place,
        /// The full path.
        key: String,
        /// The value as written.
        value: String,
        /// What would fit.
        expected: String,
    },
    /// An override without `=`.
    #[error("--set {text}: expected KEY=VALUE, as in --set render.width=500")]
    MalformedOverride {
        /// What was typed.
        text: String,
    },
}

fn quoted(names: &[String]) -> String {
    names.iter().map(|name| format!("`{name}`")).collect::<Vec<_>>().join(", ")
}

impl SceneError {
    /// Where it is, if it is at one place.
    pub fn place(&self) -> Option<&Place> {
        match self {
            Self::NotFound { .. }
            | Self::Directory { .. }
            | Self::Unreadable { .. }
            | Self::TooLarge { .. }
            | Self::Simulation { .. }
            | Self::MalformedOverride { .. } => None,
            Self::NotText { place, .. }
            | Self::Syntax { place, .. }
            | Self::UnknownKey { place, .. }
            | Self::WrongType { place, .. }
            | Self::OutOfRange { place, .. }
            | Self::UnknownName { place, .. }
            | Self::Missing { place, .. }
            | Self::Inconsistent { place, .. } => Some(place),
        }
    }

    /// The full path of the key it is about, if it is about one.
    pub fn key(&self) -> Option<&str> {
        match self {
            Self::UnknownKey { key, .. }
            | Self::WrongType { key, .. }
            | Self::OutOfRange { key, .. }
            | Self::UnknownName { key, .. }
            | Self::Missing { key, .. }
            | Self::Inconsistent { key, .. } => Some(key),
            _ => None,
        }
    }
}

/// Everything that is wrong with a scene, in the order of the file; at least one error, at most [`SceneErrors::MOST`].
#[derive(Debug)]
pub struct SceneErrors {
    errors: Vec<SceneError>,
}

impl SceneErrors {
    /// The most errors that are kept of one scene: whoever has more has named the wrong file.
    pub const MOST: usize = 100;

    /// Sorts the errors by place.
    pub(super) fn new(mut errors: Vec<SceneError>) -> Self {
        assert!(!errors.is_empty(), "a list of scene errors holds at least one");
        errors.sort_by_key(|error| error.place().map_or((0, 0), Place::rank));
        errors.truncate(Self::MOST);
        Self { errors }
    }

    /// The errors, in the order of the file.
    pub fn iter(&self) -> std::slice::Iter<'_, SceneError> {
        self.errors.iter()
    }
}

impl From<SceneError> for SceneErrors {
    fn from(error: SceneError) -> Self {
        Self { errors: vec![error] }
    }
}

impl fmt::Display for SceneErrors {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (index, error) in self.errors.iter().enumerate() {
            if index > 0 {
                writeln!(formatter)?;
            }
            write!(formatter, "{error}")?;
        }
        Ok(())
    }
}

impl std::error::Error for SceneErrors {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        // A list has no one cause; a single error passes its own on.
        if let [error] = self.errors.as_slice() { error.source() } else { None }
    }
}
