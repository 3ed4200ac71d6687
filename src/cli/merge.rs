//! `whitewater merge`: parts of a picture into one file.

use anyhow::Context;

use super::args::MergeArgs;
use super::errors::{CliError, Outcome};
use super::look::local_now;
use crate::merge::merge;
use crate::output::{self, Claim, WriteOptions, layers};
use crate::scene::{Colorspace, Compression};

/// Runs the command.
///
/// # Errors
/// Parts that do not make a picture, and what the system says; nothing is written then.
pub fn run(arguments: &MergeArgs) -> Result<Outcome, CliError> {
    let path = &arguments.output;
    output::check(path, &WriteOptions::default()).map_err(anyhow::Error::from)?;
    if let Some(names) = &arguments.layers {
        layers::check(names).map_err(anyhow::Error::from)?;
    }
    let _claim = Claim::new(path).map_err(anyhow::Error::from)?;
    let merged = merge(&arguments.parts, arguments.partial).map_err(anyhow::Error::from)?;
    let mut picture = merged.picture;
    // Pictures have the layers that their renders were asked for; checkpoints have all there are.
    if arguments.layers.is_some() || merged.encoding.is_none() {
        let names = arguments.layers.clone().unwrap_or_default();
        layers::select(&mut picture, &names).map_err(anyhow::Error::from)?;
    }
    let colorspace = |name: &String| serde_json::from_value::<Colorspace>(name.clone().into()).ok();
    let named = |name: &String| serde_json::from_value::<Compression>(name.clone().into()).ok();
    let options = WriteOptions {
        compression: arguments
            .compression
            .as_ref()
            .and_then(named)
            .or(merged.encoding.map(|encoding| encoding.compression))
            .unwrap_or_default(),
        colorspace: arguments.colorspace.as_ref().and_then(colorspace).unwrap_or(picture.metadata.colorspace),
        reproducible: arguments.reproducible || merged.encoding.is_some_and(|encoding| encoding.reproducible),
        captured: Some(local_now()),
        ..WriteOptions::default()
    };
    output::write(&picture, path, &options).with_context(|| format!("cannot write {}", path.display()))?;
    if !picture.metadata.complete {
        tracing::warn!("{}: parts are missing; `whitewater:complete` is 0", path.display());
    }
    Ok(Outcome::Done)
}
