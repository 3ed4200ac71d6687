//! Files that appear under their final name only when they are whole: written beside it, synced, renamed.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

use super::StateError;

/// Lets `write` fill a file that then takes the name `path`, replacing what was there.
pub(super) fn write_whole(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<&mut File>) -> Result<(), StateError>,
) -> Result<(), StateError> {
    let at = || StateError::at(path);
    // Only within one directory is a rename a single step.
    let directory = match path.parent() {
        Some(directory) if !directory.as_os_str().is_empty() => directory,
        _ => Path::new("."),
    };
    let mut builder = tempfile::Builder::new();
    builder.prefix(".whitewater-").suffix(".part");
    #[cfg(unix)]
    {
        // The usual permissions of a new file, under the user's mask: others on a farm must read it.
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(std::fs::Permissions::from_mode(0o666));
    }
    let mut beside = builder.tempfile_in(directory).map_err(at())?;
    let mut buffer = BufWriter::with_capacity(1 << 16, beside.as_file_mut());
    write(&mut buffer).map_err(|error| match error {
        StateError::Write(source) => at()(source),
        error => error,
    })?;
    buffer.flush().map_err(at())?;
    drop(buffer);
    beside.as_file().sync_all().map_err(at())?;
    beside.persist(path).map_err(|error| at()(error.error))?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_that_fails_leaves_the_old_one_and_nothing_beside_it() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.state");
        write_whole(&path, |w| Ok(w.write_all(b"old")?)).unwrap();
        let failed = write_whole(&path, |w| {
            w.write_all(b"half")?;
            Err(std::io::Error::other("disk full").into())
        });
        assert!(matches!(failed, Err(StateError::Io { path: p, .. }) if p == path));
        assert_eq!(std::fs::read(&path).unwrap(), b"old");
        assert_eq!(std::fs::read_dir(directory.path()).unwrap().count(), 1);
        write_whole(&path, |w| Ok(w.write_all(b"new")?)).unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"new");
    }

    #[cfg(unix)]
    #[test]
    fn a_new_file_has_the_usual_permissions() {
        use std::os::unix::fs::PermissionsExt;
        let directory = tempfile::tempdir().unwrap();
        let mode = |path: &Path| std::fs::metadata(path).unwrap().permissions().mode() & 0o777;
        let (ours, plain) = (directory.path().join("ours"), directory.path().join("plain"));
        write_whole(&ours, |w| Ok(w.write_all(b"x")?)).unwrap();
        std::fs::write(&plain, b"x").unwrap();
        assert_eq!(mode(&ours), mode(&plain));
    }
}
