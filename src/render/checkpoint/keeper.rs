//! Tiles as they are done or under way, and the file that is written of them from time to time by whichever thread finds
//! that it is due.

use std::sync::Mutex;
use std::time::Instant;

use super::file::{Packed, pack};
use super::{Checkpoint, CheckpointError, Header, Keeping};
use crate::render::film::FilmTile;

/// Keeps what is done of one picture.
pub(in crate::render) struct Keeper<'a> {
    keeping: &'a Keeping,
    header: Header,
    /// What the file had, if the picture goes on from one.
    before: Option<Checkpoint>,
    tiles: Mutex<Vec<Packed>>,
    /// When each tile was taken.
    taken: Mutex<Vec<Instant>>,
    last: Mutex<Instant>,
    /// Held by whoever writes.
    writing: Mutex<()>,
    start: Instant,
    /// Seconds that the picture took before.
    pub(in crate::render) spent: f64,
}

fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    // Poisoned only if another thread panicked, and then that panic is on its way to the caller anyway.
    mutex.lock().unwrap_or_else(|poison| poison.into_inner())
}

impl<'a> Keeper<'a> {
    /// Goes on from the file, if that is wanted and there is one; otherwise from nothing.
    ///
    /// *Errors*: the file is damaged, or of another picture than `header` tells of.
    pub(in crate::render) fn new(keeping: &'a Keeping, header: Header, tiles: usize) -> Result<Self, CheckpointError> {
        let mut before = None;
        if keeping.resume {
            if keeping.path.exists() {
                let found = Checkpoint::load(&keeping.path)?;
                if let Some(what) = found.differs(&header) {
                    return Err(CheckpointError::Other { path: keeping.path.clone(), what });
                }
                before = Some(found);
            } else {
                tracing::warn!("{}: there is no checkpoint; the frame begins anew", keeping.path.display());
            }
        }
        let kept = before.as_ref().map_or_else(|| vec![None; tiles], |before| before.tiles.clone());
        let now = Instant::now();
        Ok(Self {
            keeping,
            header,
            spent: before.as_ref().map_or(0.0, |before| before.header.metadata.seconds),
            before,
            tiles: Mutex::new(kept),
            taken: Mutex::new(vec![now; tiles]),
            last: Mutex::new(now),
            writing: Mutex::new(()),
            start: now,
        })
    }

    /// The sums that a tile goes on from, if it has any.
    ///
    /// *Errors*: they are not those of that tile.
    pub(in crate::render) fn blocks(&self, tile: usize) -> Result<Option<Vec<FilmTile>>, CheckpointError> {
        self.before.as_ref().map_or(Ok(None), |before| before.blocks(&self.keeping.path, tile))
    }

    /// Whether it is time to write.
    pub(in crate::render) fn is_due(&self) -> bool {
        lock(&self.last).elapsed() >= self.keeping.every
    }

    /// Whether what is kept of a tile is so old that the next file should have newer sums.
    pub(in crate::render) fn is_old(&self, tile: usize) -> bool {
        2 * lock(&self.taken)[tile].elapsed() >= self.keeping.every
    }

    /// Whether the file stays when the picture is done.
    pub(in crate::render) fn keeps(&self) -> bool {
        self.keeping.keep
    }

    /// Takes a tile's sums as they are, and writes the file if it is time.
    pub(in crate::render) fn keep(&self, tile: usize, blocks: &[FilmTile]) {
        let packed = pack(blocks);
        lock(&self.tiles)[tile] = Some(packed);
        lock(&self.taken)[tile] = Instant::now();
        if self.is_due() {
            // Another thread that writes already has all that was kept until it began.
            if let Ok(_writing) = self.writing.try_lock() {
                self.save();
            }
        }
    }

    /// Writes the file at the end: a picture that was stopped must go on from all there is.
    pub(in crate::render) fn finish(&self, complete: bool) {
        if !complete || self.keeping.keep {
            let _writing = lock(&self.writing);
            self.save();
        }
    }

    fn save(&self) {
        let mut header = self.header.clone();
        header.metadata.seconds = self.spent + self.start.elapsed().as_secs_f64();
        let checkpoint = Checkpoint { header, tiles: lock(&self.tiles).clone() };
        // The picture is worth more than its checkpoint: it goes on without, and the file before is still there.
        if let Err(error) = checkpoint.save(&self.keeping.path) {
            tracing::warn!("the checkpoint was not written: {error}");
        }
        *lock(&self.last) = Instant::now();
    }
}
