//! Finds `libOpenImageDenoise` and loads it once per process. Where it looks is in [`crate::ffi::search`].

use std::path::PathBuf;

use super::OidnError;
use super::bindings::Oidn;
use crate::ffi::search::{self, Loaded, Search};

/// Its name carries the interface's version.
const SEARCH: Search = Search {
    variable: "WHITEWATER_OIDN",
    folder: "third_party/oidn/lib",
    file: if cfg!(target_os = "macos") {
        "libOpenImageDenoise.2.dylib"
    } else if cfg!(windows) {
        "OpenImageDenoise.dll"
    } else {
        "libOpenImageDenoise.so.2"
    },
};

/// The functions and where they came from.
pub(super) type Library = search::Library<Oidn>;

/// The library, loaded at the first call.
pub(super) fn library() -> Result<&'static Library, OidnError> {
    static LOADED: Loaded<Oidn> = Loaded::new();
    LOADED.get(|| load(&SEARCH.places()))
}

fn load(places: &[PathBuf]) -> Result<Library, OidnError> {
    // SAFETY: we promise that a library of this name runs nothing harmful when it is loaded, and that its functions have
    // the signatures of the manual; the device checks its version before anything is filtered.
    search::first(places, |path| unsafe { Oidn::new(path) }).map_err(|tried| OidnError::NotFound { tried })
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
        let text = load(&[absent.clone(), broken.clone()]).unwrap_err().to_string();
        let (absent, broken) = (absent.to_str().unwrap(), broken.to_str().unwrap());
        for part in [absent, broken, "no such file", "make denoiser", "WHITEWATER_OIDN"] {
            assert!(text.contains(part), "{part:?} is missing in {text}");
        }
    }

    #[test]
    fn a_library_that_is_not_the_denoiser_is_refused() {
        let error = load(&[PathBuf::from("libc.so.6")]).unwrap_err();
        assert!(error.to_string().contains("oidnNewDevice"), "{error}");
    }
}
