//! Files that appear under their name only when they are whole: write beside the target, sync, reopen and check,
//! rename, sync the folder. Whatever fails, the temporary file goes and an older file under the name stays.
//! What is written, and how it is checked, the caller brings along.

use std::{
    fs::{self, File},
    path::{Path, PathBuf},
};

use sha2::{Digest, Sha256};

use super::OutputError;

/// Where a file of that name would really go: links followed, folder present, nothing unwritable in the way.
///
/// *Errors*: no file name, the folder is missing, the target is a folder, no regular file, or read-only.
pub(crate) fn check_target(path: &Path) -> Result<PathBuf, OutputError> {
    let owned = || path.to_path_buf();
    if path.is_dir() {
        return Err(OutputError::IsDirectory { path: owned() });
    }
    if path.file_name().is_none() {
        return Err(OutputError::NoFileName { path: owned() });
    }
    // A link keeps pointing where it points: its target is replaced, not the link.
    let target = match fs::canonicalize(path) {
        Ok(real) => real,
        Err(_) => owned(),
    };
    let directory = directory_of(&target);
    if !directory.is_dir() {
        return Err(OutputError::DirectoryMissing { path: owned(), directory });
    }
    if let Ok(found) = fs::metadata(&target) {
        if !found.is_file() {
            return Err(OutputError::NotRegular { path: owned() });
        }
        // A rename would replace it all the same: the permission says that someone wants to keep it.
        if found.permissions().readonly() {
            return Err(OutputError::ReadOnly { path: owned() });
        }
    }
    Ok(target)
}

/// Writes a whole file or none; returns its size in bytes.
///
/// `write` fills the temporary file (given open and by path; its extension is the target's); `check` reopens it by
/// path and says whether it holds what it should. Both see a hidden name in the target's folder.
///
/// *Errors*: those of [`check_target`], of `write` and `check`, and the system's; then the target is as it was.
pub(crate) fn write_whole(
    path: &Path,
    write: impl FnOnce(&mut File, &Path) -> Result<(), OutputError>,
    check: impl FnOnce(&Path) -> Result<(), OutputError>,
) -> Result<u64, OutputError> {
    let target = check_target(path)?;
    let directory = directory_of(&target);
    let failed = |action| move |source| OutputError::Io { action, path: path.to_path_buf(), source };

    let suffix = target.extension().map(|e| format!(".{}", e.to_string_lossy())).unwrap_or_default();
    let mut builder = tempfile::Builder::new();
    let prefix = prefix(&target);
    builder.prefix(&prefix).suffix(&suffix);
    // Temporary files are private by default; a finished picture has the permissions that any new file gets.
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    let mut temporary = builder.tempfile_in(&directory).map_err(failed("create a file for"))?;

    let temporary_path = temporary.path().to_path_buf();
    write(temporary.as_file_mut(), &temporary_path)?;
    // Opened anew, since a foreign writer may have put another file under the temporary name.
    let written =
        File::options().read(true).write(true).open(&temporary_path).map_err(failed("reopen the file for"))?;
    written.sync_all().map_err(failed("write"))?;
    let bytes = written.metadata().map_err(failed("measure"))?.len();
    drop(written);
    check(&temporary_path)?;

    temporary.persist(&target).map_err(|e| failed("put in place")(e.error))?;
    sync_directory(&directory).map_err(failed("sync the folder of"))?;
    Ok(bytes)
}

/// How the temporary files of a target begin: short, however long its name is.
fn prefix(target: &Path) -> String {
    let name = target.file_name().unwrap_or_default();
    let hash = Sha256::digest(name.as_encoded_bytes());
    format!(".whitewater-{:02x}{:02x}{:02x}{:02x}-", hash[0], hash[1], hash[2], hash[3])
}

/// Removes what a writer of that file has left that was killed. Only whoever alone may write it may ask for that.
pub(crate) fn sweep(path: &Path) {
    let Ok(target) = check_target(path) else { return };
    let prefix = prefix(&target);
    let Ok(entries) = fs::read_dir(directory_of(&target)) else { return };
    for entry in entries.flatten() {
        if entry.file_name().to_str().is_some_and(|name| name.starts_with(&prefix)) {
            // What cannot be removed does no harm.
            let _ = fs::remove_file(entry.path());
        }
    }
}

fn directory_of(path: &Path) -> PathBuf {
    match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent.to_path_buf(),
        _ => PathBuf::from("."),
    }
}

/// Makes the rename itself survive a power cut.
#[cfg(unix)]
fn sync_directory(directory: &Path) -> std::io::Result<()> {
    match File::open(directory).and_then(|d| d.sync_all()) {
        // Some network file systems cannot sync folders and say so; there is nothing more to do then.
        Err(e) if matches!(e.kind(), std::io::ErrorKind::InvalidInput | std::io::ErrorKind::Unsupported) => Ok(()),
        other => other,
    }
}

#[cfg(not(unix))]
fn sync_directory(_: &Path) -> std::io::Result<()> {
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;

    fn names(directory: &Path) -> Vec<String> {
        let mut names: Vec<_> =
            fs::read_dir(directory).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    fn put(bytes: &'static [u8]) -> impl FnOnce(&mut File, &Path) -> Result<(), OutputError> {
        move |file, path| {
            file.write_all(bytes).map_err(|source| OutputError::Io { action: "write", path: path.into(), source })
        }
    }

    fn broken(path: &Path) -> OutputError {
        OutputError::Damaged { path: path.into(), what: "broken on purpose".into() }
    }

    #[test]
    fn a_whole_file_appears_alone() {
        let directory = tempfile::tempdir().unwrap();
        let target = directory.path().join("a.bin");
        let seen = std::cell::Cell::new(0);
        let check = |path: &Path| {
            // The final name must not exist before the check has passed.
            assert!(!target.exists());
            assert!(path.file_name().unwrap().to_str().unwrap().starts_with('.'));
            seen.set(fs::read(path).unwrap().len());
            Ok(())
        };
        assert_eq!(write_whole(&target, put(b"whole"), check).unwrap(), 5);
        assert_eq!(seen.get(), 5);
        assert_eq!(fs::read(&target).unwrap(), b"whole");
        assert_eq!(names(directory.path()), ["a.bin"]);
    }

    #[test]
    fn a_failing_writer_or_check_leaves_the_old_file_and_nothing_else() {
        let directory = tempfile::tempdir().unwrap();
        let target = directory.path().join("a.bin");
        fs::write(&target, b"old").unwrap();
        let half = |file: &mut File, path: &Path| {
            file.write_all(b"half a fi").unwrap();
            Err(broken(path))
        };
        assert!(write_whole(&target, half, |_| Ok(())).is_err());
        assert_eq!(fs::read(&target).unwrap(), b"old");
        assert!(write_whole(&target, put(b"new"), |path| Err(broken(path))).is_err());
        assert_eq!(fs::read(&target).unwrap(), b"old");
        assert_eq!(names(directory.path()), ["a.bin"]);
        write_whole(&target, put(b"new"), |_| Ok(())).unwrap();
        assert_eq!(fs::read(&target).unwrap(), b"new");
    }

    #[test]
    fn what_a_killed_writer_left_is_swept_and_nothing_else() {
        let directory = tempfile::tempdir().unwrap();
        let target = directory.path().join("a.bin");
        let left = directory.path().join(prefix(&target) + "Ab12.bin");
        let other = directory.path().join(prefix(&directory.path().join("b.bin")) + "Ab12.bin");
        for path in [&left, &other, &target] {
            fs::write(path, b"x").unwrap();
        }
        sweep(&target);
        assert!(!left.exists() && other.exists() && target.exists());
    }

    #[test]
    fn bad_targets_are_named() {
        let directory = tempfile::tempdir().unwrap();
        let d = directory.path();
        assert!(matches!(check_target(d), Err(OutputError::IsDirectory { .. })));
        let Err(OutputError::DirectoryMissing { directory: missing, .. }) = check_target(&d.join("no/such/a.exr"))
        else {
            panic!("a missing folder was accepted");
        };
        assert_eq!(missing, d.join("no/such"));
        let locked = d.join("locked.exr");
        fs::write(&locked, b"x").unwrap();
        let mut permissions = fs::metadata(&locked).unwrap().permissions();
        permissions.set_readonly(true);
        fs::set_permissions(&locked, permissions).unwrap();
        assert!(matches!(check_target(&locked), Err(OutputError::ReadOnly { .. })));
        assert!(matches!(check_target(Path::new("")), Err(OutputError::NoFileName { .. })));
        assert_eq!(check_target(Path::new("plain-new-name.exr")).unwrap(), Path::new("plain-new-name.exr"));
    }

    #[cfg(unix)]
    #[test]
    fn links_are_followed_and_devices_refused() {
        let directory = tempfile::tempdir().unwrap();
        let real = directory.path().join("real.bin");
        let link = directory.path().join("link.bin");
        fs::write(&real, b"old").unwrap();
        std::os::unix::fs::symlink(&real, &link).unwrap();
        write_whole(&link, put(b"new"), |_| Ok(())).unwrap();
        assert_eq!(fs::read(&real).unwrap(), b"new");
        assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
        assert!(matches!(check_target(Path::new("/dev/null")), Err(OutputError::NotRegular { .. })));
    }

    #[cfg(unix)]
    #[test]
    fn a_finished_file_has_the_permissions_of_any_new_file() {
        use std::os::unix::fs::PermissionsExt;
        let directory = tempfile::tempdir().unwrap();
        let (ours, plain) = (directory.path().join("ours"), directory.path().join("plain"));
        write_whole(&ours, put(b"x"), |_| Ok(())).unwrap();
        fs::write(&plain, b"x").unwrap();
        let mode = |p: &Path| fs::metadata(p).unwrap().permissions().mode();
        assert_eq!(mode(&ours), mode(&plain));
    }
}
