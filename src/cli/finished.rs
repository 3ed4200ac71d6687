//! Frames of a sequence that an earlier run has finished: what is recorded of them beside their pictures, and whether it holds.
//!
//! A picture's name alone says little: it may be of another scene, of fewer samples, or half of a pair of files. So a record names
//! what was wanted and the very bytes that were written, and a frame is only left out where both are as they were.

use std::ffi::OsString;
use std::io::Write;
use std::path::{Path, PathBuf};

use sha2::{Digest, Sha256};

use super::keep;
use super::prepare::{Run, deep_outputs};
use crate::output::{OutputError, WriteOptions, WriteReport, naming, whole_file::write_whole};

/// What is written of a finished frame.
#[derive(Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct Record {
    /// A hash of what its files depend on.
    wanted: String,
    /// Its files by name, each with the SHA-256 of its bytes.
    files: Vec<(String, String)>,
}

/// `.NAME.whole` beside the picture `NAME`.
pub(super) fn record_path(picture: &Path) -> PathBuf {
    let mut name = OsString::from(".");
    name.push(picture.file_name().unwrap_or_default());
    name.push(".whole");
    picture.with_file_name(name)
}

/// A hash of what a frame's files depend on: its pixels' `identity`, how many samples they get, and how pictures are written.
pub(super) fn wanted(run: &Run, number: i64, identity: &str) -> String {
    let arguments = run.arguments;
    let mut hash = Sha256::new();
    // Dates are of no frame's making.
    let options = WriteOptions { captured: None, ..run.options.clone() };
    let words = [
        env!("CARGO_PKG_VERSION").to_owned(),
        identity.to_owned(),
        number.to_string(),
        run.loaded.hash.clone(),
        format!("{options:?}"),
        format!("{:?}", run.crop),
        format!("{:?} {:?} {:?}", arguments.layers, arguments.tile, arguments.sample_range),
        arguments.denoise.to_string(),
    ];
    for word in words {
        hash.update((word.len() as u64).to_le_bytes());
        hash.update(word);
    }
    keep::hexadecimal(&hash.finalize())
}

/// The files that a finished frame has.
fn files(run: &Run, number: i64) -> Vec<PathBuf> {
    let deep = if run.loaded.scene.output.deep.enabled { deep_outputs(&run.outputs) } else { Vec::new() };
    run.outputs.iter().chain(&deep).map(|pattern| naming::with_frame(pattern, number)).collect()
}

fn name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// The files of a frame, if all are those of a run that wanted the same; `None` if nothing is recorded of it.
///
/// # Errors
/// Why a record does not hold, for who wonders that a frame is rendered again.
pub(super) fn whole(run: &Run, number: i64, record: &Path, wanted: &str) -> Result<Option<Vec<PathBuf>>, String> {
    let text = match std::fs::read(record) {
        Ok(text) => text,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(None),
        Err(error) => return Err(format!("{} cannot be read: {error}", record.display())),
    };
    let found: Record =
        serde_json::from_slice(&text).map_err(|error| format!("{} is no record: {error}", record.display()))?;
    if found.wanted != wanted {
        return Err("the scene, one of its files, or what is asked for has changed".to_owned());
    }
    let files = files(run, number);
    if files.len() != found.files.len() {
        return Err(format!("it had {} files; {} are asked for", found.files.len(), files.len()));
    }
    for (path, (known, sum)) in files.iter().zip(&found.files) {
        if name(path) != *known {
            return Err(format!("{} stood in the place of {}", known, path.display()));
        }
        let bytes = keep::of_file(path).map_err(|error| format!("{} cannot be read: {error}", path.display()))?;
        if keep::hexadecimal(&bytes) != *sum {
            return Err(format!("{} is not as it was written", path.display()));
        }
    }
    Ok(Some(files))
}

/// Records that a frame's files are whole.
///
/// # Errors
/// A file that cannot be read again; the record cannot be written.
pub(super) fn record(path: &Path, wanted: String, written: &[WriteReport]) -> Result<(), OutputError> {
    let mut files = Vec::new();
    for report in written {
        let failed = |source| OutputError::Io { action: "read again", path: report.path.clone(), source };
        files.push((name(&report.path), keep::hexadecimal(&keep::of_file(&report.path).map_err(failed)?)));
    }
    let text = serde_json::to_string(&Record { wanted, files }).expect("a record is plain data") + "\n";
    let failed = |source| OutputError::Io { action: "write", path: path.to_owned(), source };
    write_whole(path, |file, _| file.write_all(text.as_bytes()).map_err(failed), |_| Ok(()))?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_record_hides_beside_its_picture_and_names_the_bytes() {
        assert_eq!(record_path(Path::new("o/a.0001.exr")), Path::new("o/.a.0001.exr.whole"));
        let folder = tempfile::tempdir().unwrap();
        let picture = folder.path().join("a.exr");
        std::fs::write(&picture, b"abc").unwrap();
        let beside = record_path(&picture);
        let written = [WriteReport { path: picture, bytes: 3, saturated: 0, saturated_pixels: 0 }];
        record(&beside, "what".to_owned(), &written).unwrap();
        let found: Record = serde_json::from_slice(&std::fs::read(&beside).unwrap()).unwrap();
        // SHA-256 of abc, as FIPS 180-2 has it.
        let sum = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad".to_owned();
        assert_eq!(found, Record { wanted: "what".to_owned(), files: vec![("a.exr".to_owned(), sum)] });
    }
}
