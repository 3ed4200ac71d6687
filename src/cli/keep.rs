//! Where a frame's checkpoint lies, and whose it is: a hash of everything that its pixels depend on.

use std::ffi::OsString;
use std::io::Read;
use std::path::{Path, PathBuf};

use anyhow::Context;
use sha2::{Digest, Sha256};

use super::errors::CliError;
use crate::scene::{self, LoadedScene};
use crate::state::FrameSequence;

/// `.NAME.checkpoint` beside the picture `NAME`.
pub(super) fn checkpoint_path(picture: &Path) -> PathBuf {
    let mut name = OsString::from(".");
    name.push(picture.file_name().unwrap_or_default());
    name.push(".checkpoint");
    picture.with_file_name(name)
}

/// A hash of what a frame's pixels depend on: the scene, but for what is done with finished pictures and for how many samples
/// they get (the checkpoint compares those itself); the frame's files; and `further` words that decide on bits.
///
/// # Errors
/// A file that cannot be read.
pub(super) fn identity(
    loaded: &LoadedScene,
    frames: &FrameSequence,
    number: i64,
    further: &[String],
) -> Result<String, CliError> {
    let mut scene = loaded.scene.clone();
    scene.water.preset = None;
    scene.output = scene::Output::default();
    let plain = scene::Render::default();
    let render = &mut scene.render;
    (render.noise, render.seconds, render.max_samples) = (plain.noise, plain.seconds, plain.max_samples);
    if render.caustic_samples.is_none() {
        // Otherwise it says in which of them caustics are looked for.
        render.samples = plain.samples;
    }
    let mut hash = Sha256::new();
    hash.update(serde_json::to_vec(&scene).expect("a scene is plain data with string keys"));
    for word in further {
        hash.update([0]);
        hash.update(word);
    }
    // The frame after is seen while the shutter is open.
    let files = [Some(number), number.checked_add(1)].into_iter().flatten().filter_map(|number| frames.path(number));
    for path in files {
        let of_file = || -> std::io::Result<_> {
            let mut file = std::fs::File::open(path)?;
            let mut buffer = vec![0; 1 << 16];
            let mut own = Sha256::new();
            loop {
                match file.read(&mut buffer)? {
                    0 => return Ok(own.finalize()),
                    count => own.update(&buffer[..count]),
                }
            }
        };
        hash.update(of_file().with_context(|| format!("could not read {}", path.display()))?);
    }
    Ok(hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_checkpoint_hides_beside_its_picture() {
        assert_eq!(checkpoint_path(Path::new("o/a.0001.exr")), Path::new("o/.a.0001.exr.checkpoint"));
    }
}
