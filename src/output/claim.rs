//! One render at a time into one file: a lock beside it, which the system frees when the program ends, however it ends.

use std::fs::{File, TryLockError};
use std::path::{Path, PathBuf};

use super::{
    OutputError,
    whole_file::{check_target, sweep},
};

/// The right to write a file, until dropped.
#[derive(Debug)]
pub struct Claim {
    /// Locked; `None` where the file system knows no locks.
    lock: Option<File>,
    path: PathBuf,
}

impl Claim {
    /// Claims the file of that name by the lock of `.NAME.lock` beside it, and removes what a killed writer of it has left.
    ///
    /// *Errors*: another program has claimed it; the lock cannot be made (a folder that is read-only, or missing).
    pub fn new(path: &Path) -> Result<Self, OutputError> {
        let target = check_target(path)?;
        let mut name = std::ffi::OsString::from(".");
        name.push(target.file_name().unwrap_or_default());
        name.push(".lock");
        let beside = target.with_file_name(name);
        let failed = |source| OutputError::Io { action: "lock", path: path.to_path_buf(), source };
        loop {
            let lock = File::options().create(true).truncate(false).write(true).open(&beside).map_err(failed)?;
            match lock.try_lock() {
                Ok(()) => {}
                Err(TryLockError::WouldBlock) => return Err(OutputError::InUse { path: path.to_path_buf() }),
                Err(TryLockError::Error(error)) if error.kind() == std::io::ErrorKind::Unsupported => {
                    tracing::warn!(
                        "{}: locks are not supported here; nothing keeps a second render away",
                        path.display()
                    );
                    return Ok(Self { lock: None, path: beside });
                }
                Err(TryLockError::Error(error)) => return Err(failed(error)),
            }
            // Whoever had it before may have removed the name between our opening and locking it: then the lock is of
            // a file that nobody else will find.
            if is_named(&lock, &beside) {
                sweep(path);
                return Ok(Self { lock: Some(lock), path: beside });
            }
        }
    }

    /// Removes what a killed writer has left of another file that only the holder of this claim writes: its checkpoint.
    pub fn sweep(&self, path: &Path) {
        if self.lock.is_some() {
            sweep(path);
        }
    }
}

#[cfg(unix)]
fn is_named(file: &File, path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    match (file.metadata(), std::fs::metadata(path)) {
        (Ok(ours), Ok(named)) => (ours.dev(), ours.ino()) == (named.dev(), named.ino()),
        _ => false,
    }
}

#[cfg(not(unix))]
fn is_named(_: &File, path: &Path) -> bool {
    path.exists()
}

impl Drop for Claim {
    fn drop(&mut self) {
        // Removed while still locked, so that nobody loses a name that they hold. What cannot be removed does no harm.
        let _ = std::fs::remove_file(&self.path);
        self.lock = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_claimed_once_and_again_when_it_is_free() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        let claim = Claim::new(&path).unwrap();
        let error = Claim::new(&path).unwrap_err();
        assert!(matches!(error, OutputError::InUse { .. }) && error.to_string().contains("a.exr"), "{error}");
        let other = Claim::new(&folder.path().join("b.exr")).unwrap();
        drop((claim, other));
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
        // What a killed render leaves is no claim.
        std::fs::write(folder.path().join(".a.exr.lock"), b"").unwrap();
        drop(Claim::new(&path).unwrap());
    }
}
