//! Finds `libembree4` and loads it once per process. Where it looks is in [`crate::ffi::search`].

use std::path::PathBuf;

use super::EmbreeError;
use super::bindings::Embree;
use crate::ffi::search::{self, Loaded, Search};

/// Its name carries the interface's version.
const SEARCH: Search = Search {
    variable: "WHITEWATER_EMBREE",
    folder: "third_party/embree/lib",
    file: if cfg!(target_os = "macos") {
        "libembree4.4.dylib"
    } else if cfg!(windows) {
        "embree4.dll"
    } else {
        "libembree4.so.4"
    },
};

/// The functions and where they came from.
pub(super) type Library = search::Library<Embree>;

// bindgen's table of functions is `Send + Sync` by its parts (function pointers and a library handle) but not `Debug`.
impl std::fmt::Debug for Embree {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.write_str("Embree")
    }
}

/// The library, loaded at the first call.
pub(super) fn library() -> Result<&'static Library, EmbreeError> {
    static LOADED: Loaded<Embree> = Loaded::new();
    LOADED.get(|| load(&SEARCH.places()))
}

fn load(places: &[PathBuf]) -> Result<Library, EmbreeError> {
    // SAFETY: we promise that a library of this name runs nothing harmful when it is loaded, and that its functions have
    // the signatures of the headers; the device checks its version before anything else is called.
    search::first(places, |path| unsafe { Embree::new(path) }).map_err(|tried| EmbreeError::NotFound { tried })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_missing_library_names_every_place_and_the_cure() {
        let folder = tempfile::tempdir().unwrap();
        let absent = folder.path().join("absent").join(SEARCH.file);
        let broken = folder.path().join(SEARCH.file);
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
