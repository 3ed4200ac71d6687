//! Where a foreign library is looked for when it is loaded at run time: the same order for each of them.
//!
//! Order: the library's variable (a file or its folder; if set, nothing else is tried), `../lib` beside the program, the
//! library's folder under the current folder and under the project, then the system's own search. What is in the library
//! and whether its version will do is known to the rooms of each (`embree`, `oidn`).

use std::ffi::OsString;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

/// A library by the places that may hold it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Search {
    /// Environment variable that names the library or its folder.
    pub(super) variable: &'static str,
    /// Folder under the project that `make` fetches it into.
    pub(super) folder: &'static str,
    /// File name, with the version of the interface.
    pub(super) file: &'static str,
}

impl Search {
    /// Where to look, in order.
    pub(super) fn places(&self) -> Vec<PathBuf> {
        let program = std::env::current_exe().ok();
        let current = std::env::current_dir().ok();
        self.places_for(std::env::var_os(self.variable), program.as_deref(), current.as_deref())
    }

    fn places_for(&self, named: Option<OsString>, program: Option<&Path>, current: Option<&Path>) -> Vec<PathBuf> {
        if let Some(named) = named {
            let named = PathBuf::from(named);
            return vec![if named.is_dir() { named.join(self.file) } else { named }];
        }
        let fetched = Path::new(self.folder).join(self.file);
        let above = program.and_then(Path::parent).and_then(Path::parent);
        let mut places = Vec::new();
        places.extend(above.map(|above| above.join("lib").join(self.file)));
        places.extend(current.map(|folder| folder.join(&fetched)));
        places.push(Path::new(env!("CARGO_MANIFEST_DIR")).join(&fetched));
        places.dedup();
        // A bare name: the system's search, by cache and configuration.
        places.push(PathBuf::from(self.file));
        places
    }
}

/// A library's functions and where they came from.
#[derive(Debug)]
pub(super) struct Library<F> {
    pub(super) functions: F,
    pub(super) path: PathBuf,
}

/// A library of the process: loaded at the first call and never unloaded, since its worker threads may outlive any device.
#[derive(Debug)]
pub(super) struct Loaded<F: 'static>(Mutex<Option<&'static Library<F>>>);

impl<F> Loaded<F> {
    pub(super) const fn new() -> Self {
        Self(Mutex::new(None))
    }

    /// The library; `load` is asked until it has succeeded once.
    pub(super) fn get<E>(&self, load: impl FnOnce() -> Result<Library<F>, E>) -> Result<&'static Library<F>, E> {
        let mut loaded = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(library) = *loaded {
            return Ok(library);
        }
        let library: &'static Library<F> = Box::leak(Box::new(load()?));
        tracing::debug!(library = %library.path.display(), "loaded");
        *loaded = Some(library);
        Ok(library)
    }
}

/// The first place whose library opens; or each place with the reason why it did not serve.
pub(super) fn first<T>(
    places: &[PathBuf],
    open: impl Fn(&Path) -> Result<T, libloading::Error>,
) -> Result<Library<T>, Vec<(PathBuf, String)>> {
    let mut tried = Vec::new();
    for path in places {
        let bare = path.components().count() == 1;
        if !bare && !path.is_file() {
            tried.push((path.clone(), "no such file".to_owned()));
            continue;
        }
        match open(path) {
            Ok(functions) => return Ok(Library { functions, path: path.clone() }),
            Err(error) => tried.push((path.clone(), full_reason(&error))),
        }
    }
    Err(tried)
}

/// The places that were tried as lines under an error's first.
pub(super) fn list(tried: &[(PathBuf, String)]) -> String {
    let mut text = String::new();
    for (place, reason) in tried {
        let _ = write!(text, "\n  {}: {reason}", place.display());
    }
    text
}

/// An error with what caused it: the dynamic linker's words are in the source.
fn full_reason(error: &dyn std::error::Error) -> String {
    match error.source() {
        Some(source) => format!("{error}: {}", full_reason(source)),
        None => error.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SEARCH: Search = Search { variable: "NO_SUCH_VARIABLE", folder: "third_party/foo/lib", file: "libfoo.so.4" };

    #[test]
    fn a_named_library_is_the_only_place() {
        let (program, current) = (Path::new("/a/bin/w"), Path::new("/c"));
        let places = SEARCH.places_for(Some("/nowhere/libbar.so".into()), Some(program), Some(current));
        assert_eq!(places, [PathBuf::from("/nowhere/libbar.so")]);
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(SEARCH.places_for(Some(folder.path().into()), None, None), [folder.path().join(SEARCH.file)]);
    }

    #[test]
    fn places_come_in_the_documented_order() {
        let places = SEARCH.places_for(None, Some(Path::new("/a/bin/whitewater")), Some(Path::new("/current")));
        assert_eq!(places[0], Path::new("/a/lib/libfoo.so.4"));
        assert_eq!(places[1], Path::new("/current/third_party/foo/lib/libfoo.so.4"));
        assert_eq!(places[2], Path::new(env!("CARGO_MANIFEST_DIR")).join("third_party/foo/lib/libfoo.so.4"));
        assert_eq!(places[3], Path::new("libfoo.so.4"));
    }

    #[test]
    fn a_library_is_loaded_once_and_asked_for_again_after_a_failure() {
        static LOADED: Loaded<u32> = Loaded::new();
        let library = |functions| Ok::<_, String>(Library { functions, path: PathBuf::from("libfoo.so.4") });
        assert_eq!(LOADED.get(|| Err("not there".to_owned())).unwrap_err(), "not there");
        assert_eq!(LOADED.get(|| library(1)).unwrap().functions, 1);
        assert_eq!(LOADED.get(|| library(2)).unwrap().functions, 1);
    }
}
