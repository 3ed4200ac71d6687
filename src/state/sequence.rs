//! Which files are the frames of a scene: a pattern with `###` → frame numbers and paths.
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
    /// Finds the files that a pattern means. In the pattern's file name one run of `#` stands for the frame number in any
    /// count of digits; `.state` and `.npz` stand for each other. Without `#` the pattern is one file, whose number is
    /// the last run of digits in its name, or 0.
    ///
    /// # Errors
    /// Two files of one number, no file at all, a pattern that cannot be understood, a directory that cannot be read.
    pub fn find(pattern: &str, base_directory: &Path) -> Result<FrameSequence, StateError> {
        let bad = |expected| StateError::Pattern { pattern: pattern.to_string(), expected };
        let path = base_directory.join(pattern);
        let Some(name) = path.file_name().and_then(|name| name.to_str()) else {
            return Err(bad("expected the name of a file"));
        };
        let directory = match path.parent() {
            Some(directory) if !directory.as_os_str().is_empty() => directory.to_path_buf(),
            _ => PathBuf::from("."),
        };
        let folders = pattern.strip_suffix(name).unwrap_or_default();
        if folders.contains('#') {
            return Err(bad("`#` stands for the frame number only in the file's name, not in a folder's"));
        }
        if name.contains('#') {
            let pattern_name = Name::new(name).ok_or_else(|| bad("expected one run of `#`, as in `time###.state`"))?;
            pattern_name.search(pattern, &directory)
        } else {
            if !path.exists() {
                return Err(StateError::NoFrames { pattern: pattern.into(), directory, example: format!("`{name}`") });
            }
            let stem = Path::new(name).file_stem().and_then(|stem| stem.to_str()).unwrap_or(name);
            let digits = stem.rsplit(|c: char| !c.is_ascii_digit()).find(|digits| !digits.is_empty());
            let number = match digits.map(str::parse) {
                None => 0,
                Some(Ok(number)) => number,
                Some(Err(_)) => return Err(StateError::FrameNumber { path }),
            };
            Ok(FrameSequence { frames: BTreeMap::from([(number, path)]) })
        }
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

/// A file name with a number in it.
struct Name<'a> {
    before: &'a str,
    after: &'a str,
}

impl<'a> Name<'a> {
    fn new(name: &'a str) -> Option<Name<'a>> {
        let (before, rest) = name.split_once('#')?;
        let after = rest.trim_start_matches('#');
        (!after.contains('#')).then_some(Name { before, after })
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

    fn search(&self, pattern: &str, directory: &Path) -> Result<FrameSequence, StateError> {
        let mut names = Vec::new();
        for entry in std::fs::read_dir(directory).map_err(StateError::at(directory))? {
            let entry = entry.map_err(StateError::at(directory))?;
            if let Ok(name) = entry.file_name().into_string() {
                names.push(name);
            }
        }
        // A directory comes in any order; messages should not.
        names.sort_unstable();
        let mut frames = BTreeMap::new();
        for name in names {
            let Some(digits) = self.digits(&name) else { continue };
            let path = directory.join(&name);
            if path.is_dir() {
                continue;
            }
            let Ok(number) = digits.parse::<i64>() else { return Err(StateError::FrameNumber { path }) };
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
            let example = format!("`{}0{}`, `{}001{}`", self.before, self.after, self.before, self.after);
            return Err(StateError::NoFrames { pattern: pattern.into(), directory: directory.into(), example });
        }
        Ok(FrameSequence { frames })
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
}
