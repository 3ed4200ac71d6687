//! What can be wrong with the simulation's files, and where in the file it is wrong.
//!
//! A damaged file is read on as far as that means anything, so that one run names its first [`MAX_LISTED`] problems.

use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

/// How many problems of one file are listed; the rest are counted.
pub const MAX_LISTED: usize = 20;

/// Why a simulation file could not be found, read or written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum StateError {
    /// The caller's dry threshold is not a finite length of at least zero.
    #[error("dry threshold {0} m: expected a finite length, at least 0")]
    DryThreshold(f64),
    /// A moment that does not lie between two frames.
    #[error("{0} of a frame: expected a share from 0 to 1")]
    Share(f64),
    /// A rate at which no frame follows another.
    #[error("{0} frames per second: expected a positive, finite rate")]
    Fps(f64),
    /// Two frames whose columns are not the same columns.
    #[error("{what} {now} and {next}: expected two frames of the same columns")]
    Grids {
        /// Which line of a frame differs: `columns`, `width` or `origin`.
        what: &'static str,
        /// What it says in the frame.
        now: String,
        /// What it says in the next.
        next: String,
    },
    /// A frame pattern that does not say which files are meant.
    #[error("frames `{pattern}`: {expected}")]
    Pattern {
        /// The pattern as given.
        pattern: String,
        /// What a pattern looks like.
        expected: &'static str,
    },
    /// No file has a name that fits the pattern.
    #[error("no frame fits `{pattern}` in {}; expected names like {example}", directory.display())]
    NoFrames {
        /// The pattern as given.
        pattern: String,
        /// Where it was looked for.
        directory: PathBuf,
        /// A name that would fit.
        example: String,
    },
    /// Two files claim one frame number.
    #[error("frame {number} has two files, {} and {}; keep one of them", first.display(), second.display())]
    TwoFiles {
        /// The frame number.
        number: i64,
        /// The file whose name sorts first.
        first: PathBuf,
        /// The other.
        second: PathBuf,
    },
    /// The name of a frame has more digits than a frame number holds.
    #[error("{}: the frame number is beyond {}", path.display(), i64::MAX)]
    FrameNumber {
        /// The file.
        path: PathBuf,
    },
    /// A directory, pipe or device.
    #[error("{}: not a regular file", path.display())]
    NotAFile {
        /// What was named.
        path: PathBuf,
    },
    /// The file's content is wrong.
    #[error("{}", list(path, problems, *more))]
    Damaged {
        /// The file.
        path: PathBuf,
        /// The first problems, in the order of the file.
        problems: Vec<Problem>,
        /// How many more there are.
        more: u64,
    },
    /// A value that no file of this kind can hold, and that its reader would refuse.
    #[error("cannot be written: {0}")]
    Unwritable(Problem),
    /// Opening, reading, writing or renaming failed.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// A writer that is no named file failed.
    #[error("writing failed: {0}")]
    Write(#[from] io::Error),
}

impl StateError {
    /// Makes the error of a system call speak of its file.
    pub(super) fn at(path: &Path) -> impl FnOnce(io::Error) -> StateError {
        move |source| StateError::Io { path: path.to_path_buf(), source }
    }
}

/// One thing that is wrong.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Problem {
    /// Where.
    pub place: Place,
    /// What stands there.
    pub found: String,
    /// What should.
    pub expected: String,
}

impl Problem {
    /// `found` at `place` where there should be `expected`.
    pub(super) fn new(place: Place, found: impl Into<String>, expected: impl Into<String>) -> Problem {
        Problem { place, found: found.into(), expected: expected.into() }
    }
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.place {
            Place::File => write!(f, "{}; expected {}", self.found, self.expected),
            place => write!(f, "{place}: {}; expected {}", self.found, self.expected),
        }
    }
}

/// A place in a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Place {
    /// The file as a whole.
    File,
    /// A line, counted from 1.
    Line(u64),
    /// An array of an NPZ.
    Array(String),
    /// One element of an array, by its indices from 0, slowest first.
    Element(String, Vec<u64>),
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Place::File => f.write_str("the file"),
            Place::Line(line) => write!(f, "line {line}"),
            Place::Array(name) => write!(f, "array `{}`", name.escape_debug()),
            Place::Element(name, index) => {
                write!(f, "array `{}`", name.escape_debug())?;
                for i in index {
                    write!(f, "[{i}]")?;
                }
                Ok(())
            }
        }
    }
}

/// One line per problem, each opening with the file (and line, as compilers write it).
fn list(path: &Path, problems: &[Problem], more: u64) -> String {
    let path = path.display();
    let mut lines: Vec<String> = problems
        .iter()
        .map(|p| match p.place {
            Place::Line(line) => format!("{path}:{line}: {}; expected {}", p.found, p.expected),
            _ => format!("{path}: {p}"),
        })
        .collect();
    if more > 0 {
        lines.push(format!("{path}: and {more} more"));
    }
    lines.join("\n")
}

/// The problems of one file while it is read.
#[derive(Debug, Default)]
pub(super) struct Problems {
    listed: Vec<Problem>,
    more: u64,
}

impl Problems {
    /// Notes one problem. The words are only made for those that will be listed.
    pub(super) fn note(&mut self, problem: impl FnOnce() -> Problem) {
        if self.listed.len() < MAX_LISTED {
            self.listed.push(problem());
        } else {
            self.more += 1;
        }
    }

    /// Whether nothing was wrong so far.
    pub(super) fn is_empty(&self) -> bool {
        self.listed.is_empty()
    }

    /// What was read, unless something was wrong with it.
    pub(super) fn settle<T>(mut self, path: &Path, read: Result<T, Stop>) -> Result<T, StateError> {
        let value = match read {
            Ok(value) => Some(value),
            Err(Stop::Io(source)) => return Err(StateError::Io { path: path.to_path_buf(), source }),
            Err(Stop::Damage(problem)) => {
                self.note(|| *problem);
                None
            }
            Err(Stop::Noted) => {
                assert!(!self.is_empty(), "reading {} stopped without a reason", path.display());
                None
            }
        };
        match value {
            Some(value) if self.is_empty() => Ok(value),
            _ => Err(StateError::Damaged { path: path.to_path_buf(), problems: self.listed, more: self.more }),
        }
    }
}

/// Why reading a file cannot go on.
#[derive(Debug)]
pub(super) enum Stop {
    /// The system failed.
    Io(io::Error),
    /// What follows cannot be understood after this.
    Damage(Box<Problem>),
    /// The problems noted so far make the rest meaningless.
    Noted,
}

impl From<io::Error> for Stop {
    fn from(error: io::Error) -> Stop {
        Stop::Io(error)
    }
}

impl From<Problem> for Stop {
    fn from(problem: Problem) -> Stop {
        Stop::Damage(Box::new(problem))
    }
}

/// A piece of a file in back quotes, escaped and cut to what fits a message.
pub(super) fn quote(text: &str) -> String {
    const SHOWN: usize = 60;
    let mut shown = String::new();
    for c in text.chars().take(SHOWN) {
        match c {
            // These would be escaped too, but do no harm within back quotes.
            '\'' | '"' | '\\' => shown.push(c),
            _ => shown.extend(c.escape_debug()),
        }
    }
    if text.chars().nth(SHOWN).is_some() {
        shown.push('…');
    }
    format!("`{shown}`")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_list_names_the_file_on_every_line_and_counts_the_rest() {
        let mut problems = Problems::default();
        for line in 1..=25 {
            problems.note(|| Problem::new(Place::Line(line), "top = NaN", "a finite number"));
        }
        let error = problems.settle(Path::new("a.state"), Ok(())).unwrap_err();
        let text = error.to_string();
        assert_eq!(text.lines().count(), MAX_LISTED + 1);
        assert!(text.starts_with("a.state:1: top = NaN; expected a finite number\na.state:2: "));
        assert!(text.ends_with("a.state: and 5 more"));
    }

    #[test]
    fn a_quote_is_short_and_shows_control_characters() {
        assert_eq!(quote("a\u{7}b"), "`a\\u{7}b`");
        assert_eq!(quote(&"x".repeat(100)).chars().count(), 63);
    }
}
