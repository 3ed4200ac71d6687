//! What a command writes on standard error while it works: a bar on a terminal, plain lines without one, nothing if quiet.
//!
//! What the lines say is each command's own.

use std::io::{self, IsTerminal, Write};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use time::OffsetDateTime;
use time::macros::format_description;

/// Without a terminal, a line is written at each tenth, and after this long without one.
pub(super) const LONGEST_SILENCE: Duration = Duration::from_secs(10);

/// The bar on screen, if there is one: what else is written to standard error must not cut through it.
static BAR: Mutex<Option<ProgressBar>> = Mutex::new(None);

/// How progress looks.
pub(super) enum Look {
    Quiet,
    Bar(ProgressBar),
    Lines(Mutex<Box<dyn Write + Send>>),
}

impl Look {
    /// On standard error: a bar of this template if it is a terminal, lines if not.
    pub(super) fn new(quiet: bool, template: &str) -> Self {
        if quiet {
            Look::Quiet
        } else if io::stderr().is_terminal() {
            let style = ProgressStyle::with_template(template).expect("the template is well formed");
            let bar = ProgressBar::with_draw_target(Some(0), ProgressDrawTarget::stderr());
            Look::Bar(bar.with_style(style.progress_chars("=> ")))
        } else {
            Self::lines(io::stderr())
        }
    }

    /// Lines to anywhere.
    pub(super) fn lines(out: impl Write + Send + 'static) -> Self {
        Look::Lines(Mutex::new(Box::new(out)))
    }

    /// A line of its own, above the bar.
    pub(super) fn say(&self, line: &str) {
        match self {
            Look::Quiet => {}
            Look::Bar(bar) => bar.suspend(|| write_line(&mut io::stderr(), line)),
            Look::Lines(out) => write_line(&mut **lock(out), line),
        }
    }

    /// Shows the bar, if it is one.
    pub(super) fn show(&self) {
        if let Look::Bar(bar) = self {
            bar.enable_steady_tick(Duration::from_millis(250));
            *lock(&BAR) = Some(bar.clone());
        }
    }

    /// Takes the bar away.
    pub(super) fn hide(&self) {
        if let Look::Bar(bar) = self {
            bar.disable_steady_tick();
            bar.finish_and_clear();
            *lock(&BAR) = None;
        }
    }
}

impl Drop for Look {
    /// Work that ends by an error leaves no bar behind it.
    fn drop(&mut self) {
        self.hide();
    }
}

/// Now, by the local clock where the system tells its offset, else by UTC.
pub(super) fn local_now() -> OffsetDateTime {
    OffsetDateTime::now_local().unwrap_or_else(|_| OffsetDateTime::now_utc())
}

/// Standard error for the log: each message above the bar.
pub(super) fn log_writer() -> impl Write {
    struct Log;
    impl Write for Log {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            let bar = lock(&BAR).clone();
            match bar {
                Some(bar) => bar.suspend(|| io::stderr().write_all(bytes))?,
                None => io::stderr().write_all(bytes)?,
            }
            Ok(bytes.len())
        }
        fn flush(&mut self) -> io::Result<()> {
            io::stderr().flush()
        }
    }
    Log
}

/// A closed standard error must not end the work.
fn write_line(out: &mut dyn Write, line: &str) {
    let _ = out.write_all(format!("{line}\n").as_bytes()).and_then(|()| out.flush());
}

/// A thread that panicked while it held the lock left nothing half done: counts are plain numbers.
pub(super) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

pub(super) fn clock(time: OffsetDateTime) -> String {
    let format = format_description!("[year]-[month]-[day] [hour]:[minute]:[second]");
    time.format(&format).unwrap_or_else(|_| "at an unknown time".to_owned())
}

pub(super) fn duration(seconds: f64) -> String {
    let whole = seconds.round() as u64;
    match whole {
        0..60 => format!("{seconds:.1} s"),
        60..3600 => format!("{} min {:02} s", whole / 60, whole % 60),
        _ => format!("{} h {:02} min", whole / 3600, whole % 3600 / 60),
    }
}

#[cfg(test)]
pub(super) mod page {
    use std::io::{self, Write};
    use std::sync::{Arc, Mutex};

    use super::lock;

    /// Lines as they were written.
    #[derive(Clone, Default)]
    pub(in crate::cli) struct Page(Arc<Mutex<Vec<u8>>>);
    impl Write for Page {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            lock(&self.0).extend_from_slice(bytes);
            Ok(bytes.len())
        }
        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }
    impl Page {
        pub(in crate::cli) fn lines(&self) -> Vec<String> {
            String::from_utf8_lossy(&lock(&self.0)).lines().map(str::to_owned).collect()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn durations_read_as_a_person_says_them() {
        assert_eq!(duration(0.25), "0.2 s");
        assert_eq!(duration(59.4), "59.4 s");
        assert_eq!(duration(59.7), "1 min 00 s");
        assert_eq!(duration(3725.0), "1 h 02 min");
    }
}
