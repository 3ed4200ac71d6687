//! The foam of one frame of a scene: what its file carries or what its window of frames gives, and what its bubbles add.

use std::rc::Rc;

use anyhow::Context;

use super::errors::CliError;
use super::load;
use crate::foam::{self, FoamState};
use crate::scene::LoadedScene;
use crate::state::{self, FoamArrays, Frame, FrameSequence};

/// The foam of frame `number`, which is `frame`, with that of its particles under water; `None` where the scene shows none or
/// nothing gives any.
///
/// Stored foam wins over a window. A frame that says how much foam there is but not how its pattern has moved takes that from
/// the window; without one its pattern stands still.
///
/// # Errors
/// Foam arrays that are damaged; frames of the window that cannot be read or do not follow each other.
pub(super) fn of_frame(
    loaded: &LoadedScene,
    frames: &FrameSequence,
    number: i64,
    frame: &Frame,
) -> Result<Option<FoamState>, CliError> {
    let scene = &loaded.scene;
    let settings = &scene.foam;
    if !settings.visible || settings.amount == 0.0 || !scene.water.visible {
        return Ok(None);
    }
    let mut foam = without_bubbles(loaded, frames, number, frame)?;
    let columns = &frame.columns;
    if settings.bubbles > 0.0 && !frame.particles.mass.is_empty() {
        let still = || FoamState::new([columns.nx, columns.nz], columns.width, frame.time, settings.renewal);
        foam.get_or_insert_with(still).add_bubbles(columns, &frame.particles, settings, scene.particles.scale);
    }
    Ok(foam)
}

/// What the frame's file carries, or what the window gives.
fn without_bubbles(
    loaded: &LoadedScene,
    frames: &FrameSequence,
    number: i64,
    frame: &Frame,
) -> Result<Option<FoamState>, CliError> {
    let settings = &loaded.scene.foam;
    let columns = &frame.columns;
    let (count, width) = ([columns.nx, columns.nz], columns.width);
    let path = frames.path(number).with_context(|| format!("there is no frame {number}"))?;
    let stored = state::read_foam(path, columns).map_err(anyhow::Error::from)?;
    let density = match stored {
        FoamArrays::Whole(stored) => return Ok(Some(FoamState::stored(count, width, frame.time, stored))),
        FoamArrays::Density(density) => Some(density),
        FoamArrays::None => None,
    };
    let made = if settings.window > 0 { Some(recompute(loaded, frames, number)?) } else { None };
    Ok(match density {
        None => made,
        Some(density) => {
            let still = || FoamState::new(count, width, frame.time, settings.renewal);
            let mut stored = made.unwrap_or_else(still).to_stored();
            stored.density = density;
            Some(FoamState::stored(count, width, frame.time, stored))
        }
    })
}

fn recompute(loaded: &LoadedScene, frames: &FrameSequence, number: i64) -> Result<FoamState, anyhow::Error> {
    let scene = &loaded.scene;
    let first = number.saturating_sub(i64::from(scene.foam.window));
    let numbers: Vec<i64> = frames.iter().map(|(number, _)| number).filter(|n| (first..=number).contains(n)).collect();
    // The first three that are asked for (the window's two ends and the last but one) are asked for again.
    let mut ends: Vec<(i64, Rc<Frame>)> = Vec::new();
    let load = |number: i64| {
        if let Some((_, frame)) = ends.iter().find(|(other, _)| *other == number) {
            return Ok(Rc::clone(frame));
        }
        let frame = Rc::new(load::frame(loaded, frames, number).map_err(Stop::Load)?);
        if ends.len() < 3 {
            ends.push((number, Rc::clone(&frame)));
        }
        Ok(frame)
    };
    match foam::recompute(&scene.foam, scene.surface.dry_threshold, &numbers, load) {
        Ok(foam) => Ok(foam),
        Err(Stop::Foam(error)) => Err(error.into()),
        Err(Stop::Load(error)) => Err(anyhow::anyhow!("foam.window = {}: {error}", scene.foam.window)),
    }
}

/// Why a window ends.
enum Stop {
    Load(CliError),
    Foam(foam::FoamError),
}

impl From<foam::FoamError> for Stop {
    fn from(error: foam::FoamError) -> Self {
        Self::Foam(error)
    }
}
