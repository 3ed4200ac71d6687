//! Which files are the frames of a scene: a pattern with `###` ↔ frame numbers and paths.
//!
//! Only names are looked at; no file is opened.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::path::{Path, PathBuf};

use super::StateError;

/// The extensions that a frame's file may have, whichever of them the pattern names.
const EXTENSIONS: [&str; 2] = ["state", "npz"];

/// The frames of a scene by their number.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FrameSequence {
    frames: BTreeMap<i64, PathBuf>,
}

impl FrameSequence {
    /// Finds the files that a pattern means, see [`FramePattern::new`].
    ///
    /// # Errors
    /// Two files of one number, no file at all, a pattern that cannot be understood, a directory that cannot be read.
    pub fn find(pattern: &str, base_directory: &Path) -> Result<FrameSequence, StateError> {
        let names = FramePattern::new(pattern, base_directory)?;
        let mut frames = BTreeMap::new();
        for (number, path) in names.existing()? {
            match frames.entry(number) {
                Entry::Vacant(vacant) => {
                    vacant.insert(path);
                }
                Entry::Occupied(first) => {
                    return Err(StateError::TwoFiles { number, first: first.get().clone(), second: path });
                }
            }
        }
        if frames.is_empty() {
            let example = match Marked::new(&names.name) {
                Some(Marked { before, after }) => format!("`{before}0{after}`, `{before}001{after}`"),
                None => format!("`{}`", names.name),
            };
            return Err(StateError::NoFrames { pattern: pattern.into(), directory: names.directory, example });
        }
        Ok(FrameSequence { frames })
    }

    /// The file of a frame.
    pub fn path(&self, number: i64) -> Option<&Path> {
        self.frames.get(&number).map(PathBuf::as_path)
    }

    /// Numbers and files, by number.
    pub fn iter(&self) -> impl DoubleEndedIterator<Item = (i64, &Path)> + ExactSizeIterator {
        self.frames.iter().map(|(&number, path)| (number, path.as_path()))
    }

    /// How many frames there are; at least one.
    #[expect(clippy::len_without_is_empty, reason = "a sequence is never empty: finding none is an error")]
    pub fn len(&self) -> usize {
        self.frames.len()
    }

    /// The least frame number.
    pub fn first(&self) -> i64 {
        *self.frames.first_key_value().expect("a sequence holds a frame").0
    }

    /// The greatest frame number.
    pub fn last(&self) -> i64 {
        *self.frames.last_key_value().expect("a sequence holds a frame").0
    }
}

/// The names that a scene's frames have, or will have once they are written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FramePattern {
    directory: PathBuf,
    name: String,
}

impl FramePattern {
    /// In the pattern's file name one run of `#` stands for the frame number in any count of digits; `.state` and `.npz`
    /// stand for each other. Without `#` the pattern is one file, whose number is the last run of digits in its name, or 0.
    ///
    /// # Errors
    /// A pattern that cannot be understood.
    pub fn new(pattern: &str, base_directory: &Path) -> Result<FramePattern, StateError> {
        let bad = |expected| StateError::Pattern { pattern: pattern.to_string(), expected };
        let path = base_directory.join(pattern);
        let Some(name) = path.file_name().and_then(|name| name.to_str()) else {
            return Err(bad("expected the name of a file"));
        };
        let folders = pattern.strip_suffix(name).unwrap_or_default();
        if folders.contains('#') {
            return Err(bad("`#` stands for the frame number only in the file's name, not in a folder's"));
        }
        if name.contains('#') && Marked::new(name).is_none() {
            return Err(bad("expected one run of `#`, as in `time###.state`"));
        }
        let directory = match path.parent() {
            Some(directory) if !directory.as_os_str().is_empty() => directory.to_path_buf(),
            _ => PathBuf::from("."),
        };
        Ok(FramePattern { directory, name: name.to_string() })
    }

    /// The same names in another folder.
    pub fn in_directory(self, directory: &Path) -> FramePattern {
        FramePattern { directory: directory.to_path_buf(), ..self }
    }

    /// The same names with another extension.
    pub fn with_extension(self, extension: &str) -> FramePattern {
        let name = Path::new(&self.name).with_extension(extension).to_string_lossy().into_owned();
        FramePattern { name, ..self }
    }

    /// The folder of the frames.
    pub fn directory(&self) -> &Path {
        &self.directory
    }

    /// The name within the folder, with its `#`.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Whether it is a name for more than one frame.
    pub fn is_marked(&self) -> bool {
        self.name.contains('#')
    }

    /// Where frame `number` is written: the number has as many digits as there are `#`, or more if it needs them.
    pub fn path(&self, number: u64) -> PathBuf {
        let name = match Marked::new(&self.name) {
            Some(Marked { before, after }) => {
                let digits = self.name.len() - before.len() - after.len();
                format!("{before}{number:0digits$}{after}")
            }
            None => self.name.clone(),
        };
        self.directory.join(name)
    }

    /// The number of a frame whose file has this name, if it fits.
    ///
    /// # Errors
    /// The number is beyond 63 bits.
    pub fn number(&self, name: &str) -> Result<Option<i64>, StateError> {
        let digits = match Marked::new(&self.name) {
            Some(marked) => marked.digits(name),
            None if name == self.name => {
                let stem = Path::new(name).file_stem().and_then(|stem| stem.to_str()).unwrap_or(name);
                let digits = stem.rsplit(|c: char| !c.is_ascii_digit()).find(|digits| !digits.is_empty());
                Some(digits.unwrap_or("0"))
            }
            None => None,
        };
        match digits.map(str::parse) {
            None => Ok(None),
            Some(Ok(number)) => Ok(Some(number)),
            Some(Err(_)) => Err(StateError::FrameNumber { path: self.directory.join(name) }),
        }
    }

    /// Numbers and paths of the files that fit, by name.
    ///
    /// # Errors
    /// The folder cannot be read; a number beyond 63 bits.
    pub fn existing(&self) -> Result<Vec<(i64, PathBuf)>, StateError> {
        let mut names = vec![self.name.clone()];
        if self.is_marked() {
            names.clear();
            for entry in std::fs::read_dir(&self.directory).map_err(StateError::at(&self.directory))? {
                let entry = entry.map_err(StateError::at(&self.directory))?;
                if let Ok(name) = entry.file_name().into_string() {
                    names.push(name);
                }
            }
            // A directory comes in any order; messages should not.
            names.sort_unstable();
        }
        let mut found = Vec::new();
        for name in names {
            let path = self.directory.join(&name);
            // One file that was named is taken as it is: opening it will tell what is wrong with it.
            let there = if self.is_marked() { !path.is_dir() } else { path.exists() };
            if there && let Some(number) = self.number(&name)? {
                found.push((number, path));
            }
        }
        Ok(found)
    }
}

/// A file name with a number in it.
struct Marked<'a> {
    before: &'a str,
    after: &'a str,
}

impl<'a> Marked<'a> {
    fn new(name: &'a str) -> Option<Marked<'a>> {
        let (before, rest) = name.split_once('#')?;
        let after = rest.trim_start_matches('#');
        (!after.contains('#')).then_some(Marked { before, after })
    }

    /// The digits of a name that fits.
    fn digits<'n>(&self, name: &'n str) -> Option<&'n str> {
        let rest = name.strip_prefix(self.before)?;
        let all_digits = |digits: &&str| !digits.is_empty() && digits.bytes().all(|byte| byte.is_ascii_digit());
        if let Some(digits) = rest.strip_suffix(self.after).filter(all_digits) {
            return Some(digits);
        }
        let (stem, extension) = self.after.rsplit_once('.')?;
        if !EXTENSIONS.contains(&extension) {
            return None;
        }
        let (rest, other) = rest.rsplit_once('.')?;
        if !EXTENSIONS.contains(&other) {
            return None;
        }
        rest.strip_suffix(stem).filter(all_digits)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn folder(names: &[&str]) -> tempfile::TempDir {
        let directory = tempfile::tempdir().unwrap();
        for name in names {
            std::fs::write(directory.path().join(name), b"").unwrap();
        }
        directory
    }

    fn numbers(names: &[&str], pattern: &str) -> Result<Vec<i64>, StateError> {
        let directory = folder(names);
        FrameSequence::find(pattern, directory.path()).map(|found| found.iter().map(|(number, _)| number).collect())
    }

    #[test]
    fn any_count_of_digits_and_either_extension_fit_in_order_of_number() {
        let names = [
            "time10.state",
            "time9.npz",
            "time0011.state",
            "time.state",
            "time1x.state",
            "atime5.state",
            "time7.state.part",
            "model.state",
        ];
        assert_eq!(numbers(&names, "time###.state").unwrap(), [9, 10, 11]);
        assert_eq!(numbers(&names, "time#.npz").unwrap(), [9, 10, 11]);
        assert_eq!(numbers(&["a1_v2.txt", "a1_v3.state"], "a#_v2.txt").unwrap(), [1]);
        assert_eq!(numbers(&["2024.01.state", "2024.02.npz"], "2024.##.state").unwrap(), [1, 2]);
    }

    #[test]
    fn two_files_of_one_number_are_both_named() {
        for pair in [["time1.state", "time001.state"], ["time001.npz", "time001.state"]] {
            let message = numbers(&pair, "time###.state").unwrap_err().to_string();
            assert!(message.starts_with("frame 1 has two files"), "{message}");
            assert!(pair.iter().all(|name| message.contains(name)), "{message}");
        }
    }

    #[test]
    fn no_frame_names_the_pattern_and_the_folder() {
        let directory = folder(&["model.state"]);
        for pattern in ["time###.state", "time000.state"] {
            let message = FrameSequence::find(pattern, directory.path()).unwrap_err().to_string();
            assert!(message.contains(pattern) && message.contains(directory.path().to_str().unwrap()), "{message}");
        }
        let missing = FrameSequence::find("nowhere/time###.state", directory.path()).unwrap_err();
        assert!(matches!(missing, StateError::Io { .. }) && missing.to_string().contains("nowhere"));
    }

    #[test]
    fn a_plain_name_is_one_frame_numbered_by_its_digits() {
        let names = ["run2_time013.state", "still.npz"];
        assert_eq!(numbers(&names, "run2_time013.state").unwrap(), [13]);
        assert_eq!(numbers(&names, "still.npz").unwrap(), [0]);
    }

    #[test]
    fn patterns_and_numbers_that_mean_nothing_are_refused() {
        assert!(matches!(numbers(&["a1b2.state"], "a#b#.state"), Err(StateError::Pattern { .. })));
        assert!(matches!(numbers(&[], "take#/time.state"), Err(StateError::Pattern { .. })));
        assert!(matches!(numbers(&[], ".."), Err(StateError::Pattern { .. })));
        let long = "time99999999999999999999.state";
        assert!(matches!(numbers(&[long], "time#.state"), Err(StateError::FrameNumber { .. })));
        assert!(matches!(numbers(&[long], long), Err(StateError::FrameNumber { .. })));
    }

    #[test]
    fn frames_are_reached_by_number() {
        let directory = folder(&["time003.state", "time005.state"]);
        let found = FrameSequence::find("time###.state", directory.path()).unwrap();
        assert_eq!((found.len(), found.first(), found.last()), (2, 3, 5));
        assert_eq!(found.path(5), Some(directory.path().join("time005.state").as_path()));
        assert_eq!(found.path(4), None);
    }

    #[test]
    fn frames_are_named_as_they_are_found() {
        let directory = folder(&["time004.state", "time5.npz", "model.state"]);
        let names = FramePattern::new("time###.state", directory.path()).unwrap();
        assert_eq!(names.path(7), directory.path().join("time007.state"));
        assert_eq!(names.path(12345), directory.path().join("time12345.state"));
        assert_eq!(names.existing().unwrap().iter().map(|(number, _)| *number).collect::<Vec<_>>(), [4, 5]);
        for number in [0, 9, 1000] {
            let path = names.path(number);
            let name = path.file_name().unwrap().to_str().unwrap();
            assert_eq!(names.number(name).unwrap(), Some(number as i64));
        }
        let moved = names.clone().in_directory(Path::new("elsewhere")).with_extension("npz");
        assert_eq!((moved.path(1), moved.name()), (PathBuf::from("elsewhere/time001.npz"), "time###.npz"));
        let single = FramePattern::new("still.state", directory.path()).unwrap();
        assert_eq!((single.path(0), single.is_marked()), (directory.path().join("still.state"), false));
        assert!(single.existing().unwrap().is_empty());
    }
}
