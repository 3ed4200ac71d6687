//! A scene's files, as every command that needs them reads them: frames, environment.

use std::path::PathBuf;

use anyhow::Context;

use super::errors::CliError;
use crate::lower::{Environment, Volume};
use crate::scene::LoadedScene;
use crate::state::{self, Frame, FramePattern, FrameSequence, Model, StateError};

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

/// The file of a frame's mist (`mist.file`), if the scene has one.
///
/// # Errors
/// There is none of that number.
pub fn mist_file(loaded: &LoadedScene, number: i64) -> Result<Option<PathBuf>, CliError> {
    let Some(file) = &loaded.scene.mist.file else { return Ok(None) };
    if !file.contains('#') {
        let path = loaded.resolve(file);
        if !path.is_file() {
            return Err(
                anyhow::anyhow!("mist.file: there is no file {}; expected an OpenVDB file", path.display()).into()
            );
        }
        return Ok(Some(path));
    }
    let existing = FramePattern::new(file, &loaded.directory).and_then(|pattern| pattern.existing());
    let mut existing = existing.context("mist.file").map_err(CliError::from)?;
    existing.sort();
    if let Some((_, path)) = existing.iter().find(|(of, _)| *of == number) {
        return Ok(Some(path.clone()));
    }
    let has = match (existing.first(), existing.last()) {
        (Some((first, _)), Some((last, _))) => format!("{file} has {first} to {last}"),
        _ => format!("no file is named {file} in {}", loaded.directory.display()),
    };
    Err(anyhow::anyhow!("mist.file: there is none for frame {number}; {has}").into())
}

/// A frame's mist from its file, if the scene has one.
///
/// # Errors
/// There is none of that number, or it is damaged or no mist.
pub fn volume(loaded: &LoadedScene, number: i64) -> Result<Option<Volume>, CliError> {
    let Some(path) = mist_file(loaded, number)? else { return Ok(None) };
    Ok(Some(Volume::read(&path, &loaded.scene.mist).map_err(anyhow::Error::from)?))
}
