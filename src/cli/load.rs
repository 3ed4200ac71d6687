//! A scene's files, as every command that needs them reads them: frames, environment.

use std::path::PathBuf;

use anyhow::Context;

use super::errors::CliError;
use crate::lower::Environment;
use crate::scene::LoadedScene;
use crate::state::{self, Frame, FrameSequence, Model};

/// The scene's frames by number.
///
/// # Errors
/// No file fits the pattern, or two have one number.
pub fn frames(loaded: &LoadedScene) -> Result<FrameSequence, CliError> {
    Ok(FrameSequence::find(&loaded.scene.frames.files, &loaded.directory).map_err(anyhow::Error::from)?)
}

/// One frame by number.
///
/// # Errors
/// There is none of that number, or its file is damaged.
pub fn frame(loaded: &LoadedScene, frames: &FrameSequence, number: i64) -> Result<Frame, CliError> {
    let path = frames.path(number).with_context(|| {
        format!("there is no frame {number}; {} has {} to {}", loaded.scene.frames.files, frames.first(), frames.last())
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
