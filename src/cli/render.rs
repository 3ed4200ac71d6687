//! TEMPORARY: `whitewater render` has not landed yet. This file is to be replaced whole.

use super::args::RenderArgs;
use super::errors::{CliError, Outcome};
use crate::scene;

/// Reads the scene.
///
/// # Errors
/// Those of the scene; without any, that the command has not landed.
pub fn run(arguments: &RenderArgs) -> Result<Outcome, CliError> {
    scene::load(&arguments.scene.scene, &arguments.overrides())?;
    Err(anyhow::anyhow!("render has not landed").into())
}
