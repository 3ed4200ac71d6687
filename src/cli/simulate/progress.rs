//! What a simulation says of its progress: how far, how fast, how long still.

use std::time::Instant;

use crate::cli::look::{LONGEST_SILENCE, Look, duration};
use crate::sim::Moment;

/// Parts that the bar counts in: no frame is shorter than what is seen.
const PARTS: f64 = 10_000.0;

/// Shows how far a simulation is.
pub(super) struct Progress {
    look: Look,
    frames: u64,
    /// Simulated times (s) at which this run began and the whole will end.
    begin: f64,
    start: f64,
    end: f64,
    began: Instant,
    tenth: u64,
    spoke: Instant,
}

impl Progress {
    /// Of a simulation from `start` to `end` (s, simulated), `frames` in all, that goes on from `begin`.
    pub(super) fn new(quiet: bool, frames: u64, [start, begin, end]: [f64; 3]) -> Self {
        let look = Look::new(quiet, "{prefix} [{wide_bar}] {percent:>3} % {msg}");
        Self::with(look, frames, [start, begin, end])
    }

    fn with(look: Look, frames: u64, [start, begin, end]: [f64; 3]) -> Self {
        if let Look::Bar(bar) = &look {
            bar.set_length(PARTS as u64);
            bar.set_message("preparing");
        }
        look.show();
        let now = Instant::now();
        let mut this = Self { look, frames, begin, start, end, began: now, tenth: 0, spoke: now };
        this.tenth = (this.share(begin) * 10.0) as u64;
        this
    }

    /// Share of the whole that is over at a time.
    fn share(&self, time: f64) -> f64 {
        if self.end > self.start { (time - self.start) / (self.end - self.start) } else { 1.0 }
    }

    /// A step towards frame `frame` has been taken.
    pub(super) fn moment(&mut self, frame: u64, moment: Moment) {
        if matches!(self.look, Look::Quiet) {
            return;
        }
        let share = self.share(moment.time);
        let seconds = self.began.elapsed().as_secs_f64();
        let done = moment.time - self.begin;
        let left = if done > 0.0 { seconds * (self.end - moment.time) / done } else { 0.0 };
        let rate = if seconds > 0.0 { moment.steps as f64 / seconds } else { 0.0 };
        let title = match moment.time < 0.0 {
            true => "settling".to_owned(),
            false => format!("frame {frame} ({} of {})", frame + 1, self.frames),
        };
        let message = format!("{} left, {rate:.1} steps/s, {} particles", duration(left), moment.particles);
        match &self.look {
            Look::Quiet => {}
            Look::Bar(bar) => {
                bar.set_position((share * PARTS) as u64);
                bar.set_prefix(title);
                bar.set_message(message);
            }
            Look::Lines(_) => {
                let tenth = (share * 10.0) as u64;
                if tenth > self.tenth || self.spoke.elapsed() >= LONGEST_SILENCE {
                    self.tenth = tenth;
                    self.spoke = Instant::now();
                    self.look.say(&format!("{title}: {} %, {message}", (share * 100.0) as u64));
                }
            }
        }
    }

    /// A line of its own.
    pub(super) fn say(&self, line: &str) {
        self.look.say(line);
    }

    /// Takes the bar away before the last lines.
    pub(super) fn end(&self) {
        self.look.hide();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::look::page::Page;

    #[test]
    fn lines_come_at_each_tenth_of_the_whole() {
        let page = Page::default();
        let mut progress = Progress::with(Look::lines(page.clone()), 49, [-2.0, -1.0, 2.0]);
        for step in 1..=300_u64 {
            let time = -1.0 + step as f64 / 100.0;
            progress.moment((time.max(0.0) * 24.0).ceil() as u64, Moment { time, steps: step, particles: 7 });
        }
        let lines = page.lines();
        // A quarter was over before: the tenths from 30 % on.
        assert_eq!(lines.len(), 8, "{lines:#?}");
        assert!(
            lines[0].starts_with("settling: 30 %, ") && lines[0].ends_with(" steps/s, 7 particles"),
            "{}",
            lines[0]
        );
        assert!(lines[7].starts_with("frame 48 (49 of 49): 100 %, 0.0 s left, "), "{}", lines[7]);
    }
}
