//! What a simulation may write where: which files are there, whose they are, what a restart takes away.
//!
//! The rule: no file is overwritten that a former run of the same simulation did not make, unless `--restart` says so, and
//! frames of two simulations never stand side by side unnoticed.

use std::fs::{self, File, TryLockError};
use std::path::{Component, Path, PathBuf};

use anyhow::{Context, bail, ensure};

use crate::sim::{CHECKPOINT_NAME, Checkpoint, Identity, Setup};
use crate::state::{self, FramePattern};

/// The model's name beside the frames, where `render` looks for it.
const MODEL_NAME: &str = "model.state";
/// What to do about files that are in the way.
const WAY_OUT: &str = "--restart replaces it, -o puts the frames into another folder";

/// Where frames go, held against other runs while it exists.
pub(super) struct Folder {
    pattern: FramePattern,
    checkpoint: PathBuf,
    _lock: Option<File>,
}

impl Folder {
    /// Makes the folder if there is none.
    ///
    /// # Errors
    /// A name that cannot hold `frames` frames, a folder that cannot be made, another run that writes there.
    pub(super) fn open(pattern: FramePattern, frames: u64) -> anyhow::Result<Self> {
        let name = pattern.name();
        ensure!(
            pattern.is_marked() || frames == 1,
            "frames.files: `{name}` is the name of one file, and {frames} frames are to be made; \
             expected `#` for the frame number, as in time###.state, or --frames 1"
        );
        ensure!(
            ![MODEL_NAME, CHECKPOINT_NAME].contains(&name),
            "frames.files: `{name}` is the name of another file of the simulation; expected a name like time###.state"
        );
        let directory = pattern.directory();
        fs::create_dir_all(directory).with_context(|| format!("{}: cannot make the folder", directory.display()))?;
        let lock = lock(directory)?;
        Ok(Self { checkpoint: Checkpoint::path(directory), pattern, _lock: lock })
    }

    /// The file of a frame.
    pub(super) fn frame(&self, number: u64) -> PathBuf {
        self.pattern.path(number)
    }

    /// The name of the frames, with its `#`.
    pub(super) fn files(&self) -> &str {
        self.pattern.name()
    }

    /// The folder.
    pub(super) fn directory(&self) -> &Path {
        self.pattern.directory()
    }

    /// The file to go on from.
    pub(super) fn checkpoint(&self) -> &Path {
        &self.checkpoint
    }

    /// Where a former run of this simulation stopped; `None` to begin at the start.
    ///
    /// # Errors
    /// Frames that no checkpoint speaks of, a checkpoint of another simulation or a damaged one, a frame that it counts and
    /// that is gone.
    pub(super) fn former(&self, identity: Identity) -> anyhow::Result<Option<Checkpoint>> {
        let existing = existing(&self.pattern)?;
        if !self.checkpoint.exists() {
            if let Some((_, path)) = existing.first() {
                bail!(
                    "{}: there is a frame already, and no {CHECKPOINT_NAME} beside it says that `simulate` made it; {WAY_OUT}",
                    path.display()
                );
            }
            return Ok(None);
        }
        let checkpoint = Checkpoint::load(&self.checkpoint, identity)?;
        let (at, files) = (self.checkpoint.display(), self.files());
        ensure!(
            checkpoint.files == files,
            "{at}: its frames are named {}, not {files}; {WAY_OUT}",
            checkpoint.files.escape_debug()
        );
        for number in 0..checkpoint.frames {
            let path = self.frame(number);
            ensure!(
                path.is_file(),
                "{}: {at} counts this frame as made, but it is not there; --restart makes all anew",
                path.display()
            );
        }
        for (number, path) in existing {
            // The next frame may have been written just before the run was ended; whether it is ours, its content will tell.
            let ours = u64::try_from(number).is_ok_and(|n| n <= checkpoint.frames && path == self.frame(n));
            ensure!(ours, "{}: this frame is not of those that {at} speaks of; {WAY_OUT}", path.display());
        }
        Ok(Some(checkpoint))
    }

    /// Takes away what a former run made, and only that. Frames from elsewhere will be replaced as their turn comes.
    ///
    /// # Errors
    /// A file that cannot be removed; one that would give a frame two files.
    pub(super) fn restart(&self, frames: u64) -> anyhow::Result<()> {
        let directory = self.directory();
        if self.checkpoint.exists() {
            match Checkpoint::made(&self.checkpoint) {
                Ok(made) if is_plain(&made.files) => {
                    let former = FramePattern::new(&made.files, directory)?;
                    for (number, path) in existing(&former)? {
                        let theirs = u64::try_from(number).is_ok_and(|n| n < made.frames && path == former.path(n));
                        let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
                        // Frames of another name are not in the way: `render` takes them for nobody's or another scene's.
                        if theirs && self.pattern.number(name)?.is_some() {
                            remove(&path)?;
                        }
                    }
                }
                Ok(made) => {
                    tracing::warn!("{}: `{}` is no file's name", self.checkpoint.display(), made.files.escape_debug())
                }
                Err(error) => tracing::warn!("{error}; which frames it made is lost, so none are removed"),
            }
            // Last, so that a restart which is stopped here still knows what is to be removed.
            remove(&self.checkpoint)?;
        }
        let mut beyond = Vec::new();
        for (number, path) in existing(&self.pattern)? {
            match u64::try_from(number) {
                Ok(n) if n >= frames => beyond.push(path),
                Ok(n) if path == self.frame(n) => {}
                _ => bail!("{}: frame {number} would have two files; move this one away", path.display()),
            }
        }
        if let (Some(first), Some(last)) = (beyond.first(), beyond.last()) {
            let count = beyond.len();
            tracing::warn!(
                "{} to {}: {count} frames from elsewhere stay behind the new ones",
                first.display(),
                last.display()
            );
        }
        Ok(())
    }

    /// Writes `model.state`: the simulation's solids, or an empty model.
    ///
    /// # Errors
    /// Another model is there and neither a former run (`resumed`) nor `restart` excuses it; it cannot be written.
    pub(super) fn write_model(&self, setup: &Setup, resumed: bool, restart: bool) -> anyhow::Result<()> {
        let path = self.directory().join(MODEL_NAME);
        let mut model = setup.solids.clone();
        if let Some(source) = &setup.model_path {
            if same_file(source, &path) {
                return Ok(());
            }
            let from = source.parent().unwrap_or(Path::new("."));
            for mesh in &mut model.meshes {
                *mesh = rebased(mesh, from, self.directory())?;
            }
        }
        if path.exists() {
            match state::read_model(&path) {
                Ok(there) if there == model => return Ok(()),
                _ if restart => {}
                _ if resumed => {
                    tracing::warn!("{}: changed since `simulate` wrote it; it stays as it is", path.display());
                    return Ok(());
                }
                _ => bail!(
                    "{}: there is another model already; simulation.model names one to simulate with, {WAY_OUT}",
                    path.display()
                ),
            }
        }
        Ok(state::save_model(&model, &path)?)
    }

    /// Whether a frame that is there holds what the simulation has just made again.
    ///
    /// # Errors
    /// It does not, or cannot be read.
    pub(super) fn verify(&self, number: u64, frame: &state::Frame) -> anyhow::Result<()> {
        let path = self.frame(number);
        // A frame of ours never has a top under its base.
        let mut there = state::read_frame(&path, 0.0)?;
        there.extra.clear();
        // Text has no place for identities.
        if there.particles.id.is_none() {
            there.particles.id.clone_from(&frame.particles.id);
        }
        ensure!(there == *frame, "{}: not what this simulation makes of frame {number}; {WAY_OUT}", path.display());
        Ok(())
    }
}

/// Holds the folder against other runs, where the system can.
#[cfg(unix)]
fn lock(directory: &Path) -> anyhow::Result<Option<File>> {
    let folder = File::open(directory).with_context(|| format!("{}: cannot open the folder", directory.display()))?;
    match folder.try_lock() {
        Ok(()) => Ok(Some(folder)),
        Err(TryLockError::WouldBlock) => bail!("{}: another `simulate` is writing frames there", directory.display()),
        // Some network file systems have no locks: then two runs at once are up to the user.
        Err(TryLockError::Error(error)) => {
            tracing::debug!("{}: {error}", directory.display());
            Ok(None)
        }
    }
}

#[cfg(not(unix))]
fn lock(_: &Path) -> anyhow::Result<Option<File>> {
    Ok(None)
}

/// The frames that are there. A name without `#` is that of frame 0 here, whatever digits it has.
fn existing(pattern: &FramePattern) -> anyhow::Result<Vec<(i64, PathBuf)>> {
    let mut existing = pattern.existing()?;
    if !pattern.is_marked() {
        existing.iter_mut().for_each(|(number, _)| *number = 0);
    }
    Ok(existing)
}

fn remove(path: &Path) -> anyhow::Result<()> {
    fs::remove_file(path).with_context(|| format!("{}: cannot be removed", path.display()))
}

/// Whether this is a file's name and no path: a damaged checkpoint must not lead a removal elsewhere.
fn is_plain(name: &str) -> bool {
    let mut components = Path::new(name).components();
    matches!((components.next(), components.next()), (Some(Component::Normal(_)), None))
}

fn same_file(a: &Path, b: &Path) -> bool {
    matches!((fs::canonicalize(a), fs::canonicalize(b)), (Ok(a), Ok(b)) if a == b)
}

/// A path relative to the folder `from` → the same file relative to the folder `to`.
fn rebased(path: &str, from: &Path, to: &Path) -> anyhow::Result<String> {
    if Path::new(path).is_absolute() {
        return Ok(path.to_owned());
    }
    let real = |folder: &Path| {
        let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
        fs::canonicalize(folder).with_context(|| format!("{}: cannot be found", folder.display()))
    };
    let (from, to) = (real(from)?, real(to)?);
    let shared = from.components().zip(to.components()).take_while(|(a, b)| a == b).count();
    let up = to.components().skip(shared).map(|_| Component::ParentDir);
    let relative: PathBuf = up.chain(from.components().skip(shared)).collect();
    let rebased = relative.join(path);
    rebased
        .to_str()
        .map(str::to_owned)
        .with_context(|| format!("{}: the path of a mesh is not Unicode", rebased.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mesh_is_found_from_the_frames_as_from_its_model() {
        let directory = tempfile::tempdir().unwrap();
        let at = |name: &str| directory.path().join(name);
        fs::create_dir_all(at("scene/models")).unwrap();
        fs::create_dir_all(at("scene/frames/a")).unwrap();
        fs::write(at("scene/models/rock.obj"), "").unwrap();
        for to in ["scene/frames/a", "scene/models", "scene"] {
            let path = rebased("rock.obj", &at("scene/models"), &at(to)).unwrap();
            assert!(at(to).join(&path).exists(), "{to}: {path}");
        }
        assert_eq!(rebased("rock.obj", &at("scene/models"), &at("scene/frames/a")).unwrap(), "../../models/rock.obj");
        assert_eq!(rebased("rock.obj", &at("scene"), &at("scene")).unwrap(), "rock.obj");
        assert_eq!(rebased("/a/b.ply", &at("nowhere"), &at("nowhere")).unwrap(), "/a/b.ply");
    }

    #[test]
    fn only_plain_names_are_names() {
        assert!(is_plain("time###.state"));
        for path in ["../time###.state", "/time###.state", "a/b", "", ".", ".."] {
            assert!(!is_plain(path), "{path}");
        }
    }

    #[cfg(unix)]
    #[test]
    fn two_runs_do_not_write_into_one_folder() {
        let directory = tempfile::tempdir().unwrap();
        let pattern = || FramePattern::new("frames/time###.state", directory.path()).unwrap();
        let first = Folder::open(pattern(), 2).unwrap();
        let refused = Folder::open(pattern(), 2).err().unwrap().to_string();
        assert!(refused.contains("another `simulate`"), "{refused}");
        drop(first);
        Folder::open(pattern(), 2).unwrap();
    }
}
