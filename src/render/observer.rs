//! What a render tells whoever watches it. Drawing progress on a terminal or in a window lives elsewhere.

/// Someone who watches a render.
pub trait Observer: Sync {
    /// `done` of `total` tiles are finished, `rays` were traced so far. Called from any thread, once per finished tile.
    fn tiles(&self, done: u64, total: u64, rays: u64);
}
