//! What a render says of its progress.
//!
//! Rates and remaining times are of the current frame. Clock times are local.

use std::sync::Mutex;
use std::time::Instant;

use time::OffsetDateTime;

use super::look::{LONGEST_SILENCE, Look, clock, duration, local_now, lock};
use crate::render::observer::Observer;

/// Shows how far a render is. Told from any thread.
pub struct Progress {
    look: Look,
    frames: usize,
    frame: Mutex<Option<Frame>>,
}

/// The frame that is being rendered.
struct Frame {
    title: String,
    size: (u32, u32),
    began: Instant,
    began_at: OffsetDateTime,
    done: u64,
    total: u64,
    rays: u64,
    tenth: u64,
    spoke: Instant,
}

impl Progress {
    /// For `frames` frames, on standard error: a bar if it is a terminal, lines if not.
    pub fn new(quiet: bool, frames: usize) -> Self {
        let look = Look::new(quiet, "{prefix} [{wide_bar}] {percent:>3} % {msg}");
        Self { look, frames, frame: Mutex::new(None) }
    }

    /// Lines to anywhere.
    pub fn lines(frames: usize, out: impl std::io::Write + Send + 'static) -> Self {
        Self { look: Look::lines(out), frames, frame: Mutex::new(None) }
    }

    /// Frame `number`, the `index`th (from 1) of all, begins.
    pub fn start(&self, index: usize, number: i64, width: u32, height: u32) {
        let title = format!("frame {number} ({index} of {})", self.frames);
        let (began, began_at) = (Instant::now(), local_now());
        if let Look::Bar(bar) = &self.look {
            bar.reset();
            // The first tile tells how many there are; a bar of none would stand at 100 %.
            bar.set_length(1);
            bar.set_prefix(title.clone());
            bar.set_message("preparing");
        }
        self.say(&format!("{title}: {width}x{height}, started {}", clock(began_at)));
        self.look.show();
        let size = (width, height);
        *lock(&self.frame) =
            Some(Frame { title, size, began, began_at, done: 0, total: 0, rays: 0, tenth: 0, spoke: began });
    }

    /// The frame has ended; `result` says how, as `wrote out.exr`.
    pub fn finish(&self, result: &str) {
        let Some(frame) = lock(&self.frame).take() else { return };
        self.look.hide();
        let seconds = frame.began.elapsed().as_secs_f64();
        self.say(&format!(
            "{}: {}x{}, started {}, ended {}, took {}, {:.2} Mrays, {}; {result}",
            frame.title,
            frame.size.0,
            frame.size.1,
            clock(frame.began_at),
            clock(local_now()),
            duration(seconds),
            frame.rays as f64 * 1e-6,
            rate(frame.rays, seconds),
        ));
    }

    /// A line of its own, above the bar.
    pub fn say(&self, line: &str) {
        self.look.say(line);
    }
}

impl Observer for Progress {
    fn tiles(&self, done: u64, total: u64, rays: u64) {
        self.advance(done, total, rays, "tiles");
    }

    fn time(&self, elapsed: f64, limit: f64, rays: u64) {
        // A bar counts whole things: milliseconds.
        self.advance((elapsed * 1000.0) as u64, (limit * 1000.0) as u64, rays, "ms");
    }
}

impl Progress {
    fn advance(&self, done: u64, total: u64, rays: u64, unit: &str) {
        if matches!(self.look, Look::Quiet) {
            return;
        }
        let mut current = lock(&self.frame);
        let Some(frame) = current.as_mut() else { return };
        // Threads race: what is shown only grows.
        frame.done = frame.done.max(done);
        frame.rays = frame.rays.max(rays);
        frame.total = total.max(1);
        let seconds = frame.began.elapsed().as_secs_f64();
        let left = seconds * frame.total.saturating_sub(frame.done) as f64 / frame.done.max(1) as f64;
        let rate = rate(frame.rays, seconds);
        match &self.look {
            Look::Quiet => {}
            Look::Bar(bar) => {
                bar.set_length(frame.total);
                bar.set_position(frame.done);
                bar.set_message(format!("{}/{} {unit}, {} left, {rate}", frame.done, frame.total, duration(left)));
            }
            Look::Lines(_) => {
                let tenth = frame.done * 10 / frame.total;
                if tenth > frame.tenth || frame.spoke.elapsed() >= LONGEST_SILENCE {
                    frame.tenth = tenth;
                    frame.spoke = Instant::now();
                    let percent = frame.done * 100 / frame.total;
                    let (done, total, left) = (frame.done, frame.total, duration(left));
                    let line = format!("{}: {percent} %, {done}/{total} {unit}, {left} left, {rate}", frame.title);
                    self.look.say(&line);
                }
            }
        }
    }
}

fn rate(rays: u64, seconds: f64) -> String {
    // Before the clock has moved there is no rate.
    format!("{:.2} Mrays/s", if seconds > 0.0 { rays as f64 * 1e-6 / seconds } else { 0.0 })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::look::page::Page;

    #[test]
    fn lines_say_start_tenths_and_end() {
        let page = Page::default();
        let progress = Progress::lines(3, page.clone());
        progress.start(2, 17, 640, 360);
        for done in 1..=40 {
            progress.tiles(done, 40, done * 1000);
        }
        progress.finish("wrote out.exr");
        let lines = page.lines();
        assert_eq!(lines.len(), 12, "{lines:#?}");
        assert!(lines[0].starts_with("frame 17 (2 of 3): 640x360, started 2"), "{}", lines[0]);
        assert!(lines[1].starts_with("frame 17 (2 of 3): 10 %, 4/40 tiles, "), "{}", lines[1]);
        assert!(lines[1].contains(" left, ") && lines[1].ends_with(" Mrays/s"), "{}", lines[1]);
        assert!(lines[10].contains(": 100 %, 40/40 tiles"), "{}", lines[10]);
        let end = &lines[11];
        for part in ["640x360, started 2", ", ended 2", ", took 0.", ", 0.04 Mrays, ", "; wrote out.exr"] {
            assert!(end.contains(part), "{end}");
        }
    }

    #[test]
    fn racing_threads_never_turn_the_count_back() {
        let page = Page::default();
        let progress = Progress::lines(1, page.clone());
        progress.start(1, 0, 1, 1);
        std::thread::scope(|scope| {
            for thread in 0..4 {
                let progress = &progress;
                scope.spawn(move || (0..250).for_each(|tile| progress.tiles(tile * 4 + thread + 1, 1000, 0)));
            }
        });
        let percents: Vec<u64> = page.lines()[1..]
            .iter()
            .map(|line| line.split(&[':', '%'][..]).nth(1).unwrap().trim().parse().unwrap())
            .collect();
        assert!(percents.is_sorted() && percents.len() <= 10 && percents.last() == Some(&100), "{percents:?}");
    }

    #[test]
    fn tiles_outside_a_frame_are_nobodys() {
        let page = Page::default();
        let progress = Progress::lines(1, page.clone());
        progress.tiles(1, 2, 3);
        progress.finish("nothing");
        assert!(page.lines().is_empty());
    }
}
