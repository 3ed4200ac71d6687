//! Who watches a render: the progress on the terminal, and a viewer where `--tev` names one.

use super::progress::Progress;
use crate::output::{Preview, Window};
use crate::render::observer::Observer;

/// Both, told from any thread.
pub(super) struct Watch<'a> {
    pub(super) progress: &'a Progress,
    pub(super) preview: Option<&'a Preview>,
}

impl Observer for Watch<'_> {
    fn tiles(&self, done: u64, total: u64, rays: u64) {
        self.progress.tiles(done, total, rays);
    }

    fn time(&self, elapsed: f64, limit: f64, rays: u64) {
        self.progress.time(elapsed, limit, rays);
    }

    fn wants_pixels(&self) -> bool {
        self.preview.is_some()
    }

    fn pixels(&self, window: Window, pixels: Vec<[f32; 4]>) {
        if let Some(preview) = self.preview {
            preview.leave(window, pixels);
        }
    }
}
