//! A scene's files, as every command that needs them reads them: frames, environment.

use std::path::PathBuf;

use anyhow::Context;

use super::errors::CliError;
use crate::lower::Environment;
use crate::scene::LoadedScene;
use crate::state::{self, Frame, FrameSequence, Model, StateError};

/// The scene's frames by number.
///
/// # Errors
/// No file fits the pattern (then what makes them, if the scene says), or two have one number.
pub fn frames(loaded: &LoadedScene) -> Result<FrameSequence, CliError> {
    FrameSequence::find(&loaded.scene.frames.files, &loaded.directory).map_err(|error| {
        let absent = match &error {
            StateError::NoFrames { .. } => true,
            StateError::Io { source, .. } => source.kind() == std::io::ErrorKind::NotFound,
            _ => false,
        };
        let hint = if absent { how_to_make(loaded, None) } else { String::new() };
        anyhow::anyhow!("{error}{hint}").into()
    })
}

/// What to add to an error about frames that are not there: the command that makes them, if the scene has a simulation.
/// `greatest` is the number of the last frame that is asked for, if it is known.
pub fn how_to_make(loaded: &LoadedScene, greatest: Option<i64>) -> String {
    if loaded.scene.simulation.is_none() {
        return String::new();
    }
    let path = loaded.path.display().to_string();
    let plain = |letter: char| letter.is_alphanumeric() || "/._-".contains(letter);
    let path = if path.chars().all(plain) { path } else { format!("'{}'", path.replace('\'', r"'\''")) };
    let frames = greatest.and_then(|last| last.checked_add(1)).map(|count| format!(" --frames {count}"));
    format!("; `whitewater simulate {path}{}` makes them", frames.unwrap_or_default())
}

/// One frame by number.
///
/// # Errors
/// There is none of that number, or its file is damaged.
pub fn frame(loaded: &LoadedScene, frames: &FrameSequence, number: i64) -> Result<Frame, CliError> {
    let path = frames.path(number).with_context(|| {
        let (files, first, last) = (&loaded.scene.frames.files, frames.first(), frames.last());
        format!("there is no frame {number}; {files} has {first} to {last}{}", how_to_make(loaded, Some(number)))
    })?;
    Ok(state::read_frame(path, loaded.scene.surface.dry_threshold).map_err(anyhow::Error::from)?)
}

/// What stands in and around the water: the model file (by default `model.state` beside the frames, if there is one) and
/// the scene's meshes.
///
/// # Errors
/// A file is missing or damaged.
pub fn environment(loaded: &LoadedScene, frames: &FrameSequence) -> Result<Environment, CliError> {
    let environment = &loaded.scene.environment;
    let beside = || {
        let folder = frames.path(frames.first())?.parent()?;
        Some(folder.join("model.state")).filter(|path| path.exists())
    };
    let path = environment.model.as_ref().map(|model| loaded.resolve(model)).or_else(beside);
    let (model, directory) = match path {
        Some(path) => {
            let model = state::read_model(&path).map_err(anyhow::Error::from)?;
            (model, path.parent().map(PathBuf::from).unwrap_or_default())
        }
        None => (Model::default(), loaded.directory.clone()),
    };
    let meshes: Vec<PathBuf> = environment.meshes.iter().map(|mesh| loaded.resolve(mesh)).collect();
    Ok(Environment::load(&model, &directory, &meshes).map_err(anyhow::Error::from)?)
}
