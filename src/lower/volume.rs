//! A file's mist in a lowered frame, besides the particles', and its place in a budget of memory.

use std::sync::Arc;

use super::{LowerError, LoweredFrame};
use crate::mist::{self, Mist, Volume};

/// What a budget (bytes) leaves for all else where a file's mist is held at so many moments; all of it without.
///
/// # Errors
/// [`LowerError::Memory`] if it leaves nothing.
pub fn within_budget(volume: Option<&Volume>, budget: Option<u64>, moments: usize) -> Result<Option<u64>, LowerError> {
    let (Some(volume), Some(budget)) = (volume, budget) else { return Ok(budget) };
    let needed = volume.held(moments as u64);
    match budget.checked_sub(needed) {
        Some(left) => Ok(Some(left)),
        None => Err(LowerError::Memory { budget, needed }),
    }
}

impl LoweredFrame {
    /// Adds a file's mist, `seconds` after its own time, to the particles'.
    ///
    /// # Errors
    /// [`LowerError::Volume`] if what its velocities make of it is too large.
    pub fn add_volume(&mut self, volume: &Volume, seconds: f64) -> Result<(), LowerError> {
        let grid = volume.at(seconds, self.lowered.origin, mist::BUDGET)?;
        let own = self.mist.take().map_or_else(Mist::default, Arc::unwrap_or_clone);
        self.mist = Some(Arc::new(own.and(grid)));
        Ok(())
    }
}
