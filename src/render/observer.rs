//! How a render in progress is watched. Who watches, and how it looks, is not known here.

/// Is told of finished tiles, or under a time limit of time that has passed, from any thread.
pub trait Observer: Sync {
    /// `done` of `total` tiles of the current frame are finished; `rays` have been traced for it so far.
    ///
    /// Threads race: a call may come after one with a greater `done`.
    fn tiles(&self, done: u64, total: u64, rays: u64);

    /// `elapsed` of at most `limit` seconds have passed for the current frame; `rays` have been traced for it so far.
    fn time(&self, elapsed: f64, limit: f64, rays: u64);
}

/// Nobody watches.
impl Observer for () {
    fn tiles(&self, _done: u64, _total: u64, _rays: u64) {}
    fn time(&self, _elapsed: f64, _limit: f64, _rays: u64) {}
}
