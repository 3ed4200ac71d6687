//! TEMPORARY: `whitewater trace` has not landed yet. This file is to be replaced whole.

use super::args::TraceArgs;
use super::errors::{CliError, Outcome};
use crate::scene;

/// Reads the scene.
///
/// # Errors
/// Those of the scene; without any, that the command has not landed.
pub fn run(arguments: &TraceArgs) -> Result<Outcome, CliError> {
    scene::load(&arguments.scene.scene, &arguments.scene.set)?;
    Err(anyhow::anyhow!("trace has not landed").into())
}
