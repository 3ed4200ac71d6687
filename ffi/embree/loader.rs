//! Finds `libembree4` and loads it once per process.
//!
//! Order: `WHITEWATER_EMBREE` (a file or its folder; if set, nothing else is tried), `../lib` beside the program,
//! `third_party/embree/lib` under the current folder and under the project, then the system's own search.

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use super::EmbreeError;
use super::bindings::Embree;

/// The name that carries the interface's version.
const FILE: &str = if cfg!(target_os = "macos") {
    "libembree4.4.dylib"
} else if cfg!(windows) {
    "embree4.dll"
} else {
    "libembree4.so.4"
};

/// Embree's functions and where they came from.
#[derive(Debug)]
pub(super) struct Library {
    pub(super) functions: Embree,
    pub(super) path: PathBuf,
}

// bindgen's table of functions is `Send + Sync` by its parts (function pointers and a library handle) but not `Debug`.
impl std::fmt::Debug for Embree {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.write_str("Embree")
    }
}

/// The library, loaded at the first call and never unloaded: its worker threads may outlive any device.
pub(super) fn library() -> Result<&'static Library, EmbreeError> {
    static LOADED: Mutex<Option<&'static Library>> = Mutex::new(None);
    let mut loaded = LOADED.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
    if let Some(library) = *loaded {
        return Ok(library);
    }
    let library: &'static Library = Box::leak(Box::new(load(&places())?));
    tracing::debug!(library = %library.path.display(), "Embree loaded");
    *loaded = Some(library);
    Ok(library)
}

/// Where to look, in order.
fn places() -> Vec<PathBuf> {
    let program = std::env::current_exe().ok();
    let current = std::env::current_dir().ok();
    places_for(std::env::var_os("WHITEWATER_EMBREE"), program.as_deref(), current.as_deref())
}

fn places_for(named: Option<OsString>, program: Option<&Path>, current: Option<&Path>) -> Vec<PathBuf> {
    if let Some(named) = named {
        let named = PathBuf::from(named);
        return vec![if named.is_dir() { named.join(FILE) } else { named }];
    }
    let fetched = Path::new("third_party/embree/lib").join(FILE);
    let mut places = Vec::new();
    places.extend(program.and_then(Path::parent).and_then(Path::parent).map(|above| above.join("lib").join(FILE)));
    places.extend(current.map(|folder| folder.join(&fetched)));
    places.push(Path::new(env!("CARGO_MANIFEST_DIR")).join(&fetched));
    places.dedup();
    // A bare name: the system's search, by cache and configuration.
    places.push(PathBuf::from(FILE));
    places
}

fn load(places: &[PathBuf]) -> Result<Library, EmbreeError> {
    let mut tried = Vec::new();
    for path in places {
        let bare = path.components().count() == 1;
        if !bare && !path.is_file() {
            tried.push((path.clone(), "no such file".to_owned()));
            continue;
        }
        // SAFETY: we promise that a library of this name runs nothing harmful when it is loaded, and that its functions
        // have the signatures of the headers; the device checks its version before anything else is called.
        match unsafe { Embree::new(path) } {
            Ok(functions) => return Ok(Library { functions, path: path.clone() }),
            Err(error) => tried.push((path.clone(), full_reason(&error))),
        }
    }
    Err(EmbreeError::NotFound { tried })
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

    #[test]
    fn a_named_library_is_the_only_place() {
        let places = places_for(Some("/nowhere/libfoo.so".into()), Some(Path::new("/a/bin/w")), Some(Path::new("/c")));
        assert_eq!(places, [PathBuf::from("/nowhere/libfoo.so")]);
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(places_for(Some(folder.path().into()), None, None), [folder.path().join(FILE)]);
    }

    #[test]
    fn places_come_in_the_documented_order() {
        let places = places_for(None, Some(Path::new("/a/bin/whitewater")), Some(Path::new("/current")));
        assert_eq!(places[0], Path::new("/a/lib").join(FILE));
        assert_eq!(places[1], Path::new("/current/third_party/embree/lib").join(FILE));
        assert_eq!(places[2], Path::new(env!("CARGO_MANIFEST_DIR")).join("third_party/embree/lib").join(FILE));
        assert_eq!(places[3], Path::new(FILE));
    }

    #[test]
    fn a_missing_library_names_every_place_and_the_cure() {
        let folder = tempfile::tempdir().unwrap();
        let absent = folder.path().join("absent").join(FILE);
        let broken = folder.path().join(FILE);
        std::fs::write(&broken, b"not a library").unwrap();
        let error = load(&[absent.clone(), broken.clone()]).unwrap_err();
        let EmbreeError::NotFound { tried } = &error else { panic!("{error}") };
        assert_eq!(tried.len(), 2);
        let text = error.to_string();
        for part in [absent.to_str().unwrap(), broken.to_str().unwrap(), "no such file", "make build"] {
            assert!(text.contains(part), "{part:?} is missing in {text}");
        }
    }

    #[test]
    fn a_library_that_is_not_embree_is_refused() {
        let error = load(&[PathBuf::from("libc.so.6")]).unwrap_err();
        assert!(error.to_string().contains("rtc"), "{error}");
    }
}
