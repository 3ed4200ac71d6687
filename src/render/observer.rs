//! How a render in progress is watched. Who watches, and how it looks, is not known here.

use crate::output::Window;

/// Is told of finished tiles, or under a time limit of time that has passed, from any thread.
pub trait Observer: Sync {
    /// `done` of `total` tiles of the current frame are finished; `rays` have been traced for it so far.
    ///
    /// Threads race: a call may come after one with a greater `done`.
    fn tiles(&self, done: u64, total: u64, rays: u64);

    /// `elapsed` of at most `limit` seconds have passed for the current frame; `rays` have been traced for it so far.
    fn time(&self, elapsed: f64, limit: f64, rays: u64);

    /// Whether it wants to see pixels as well.
    fn wants_pixels(&self) -> bool {
        false
    }

    /// A tile of the full frame is finished, or has had another pass: the beauty and its alpha (linear, premultiplied), row by
    /// row. They are those of the picture, or under a time limit its best so far. It must not be long about it.
    fn pixels(&self, _window: Window, _pixels: Vec<[f32; 4]>) {}
}

/// Nobody watches.
impl Observer for () {
    fn tiles(&self, _done: u64, _total: u64, _rays: u64) {}
    fn time(&self, _elapsed: f64, _limit: f64, _rays: u64) {}
}
