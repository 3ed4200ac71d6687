//! Ctrl-C and SIGTERM: the first asks the render to stop cleanly, the second ends the program at once.

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag;

/// A signal that stops the program.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StopSignal {
    /// Ctrl-C.
    Interrupt,
    /// SIGTERM, what a queue sends before it kills.
    Terminate,
}

impl StopSignal {
    const ALL: [Self; 2] = [Self::Interrupt, Self::Terminate];

    fn number(self) -> i32 {
        match self {
            Self::Interrupt => SIGINT,
            Self::Terminate => SIGTERM,
        }
    }

    /// 128 and the signal's number, as shells have it: 130 or 143.
    pub fn exit_code(self) -> u8 {
        match self {
            Self::Interrupt => 130,
            Self::Terminate => 143,
        }
    }
}

/// Set once a signal has come. Clones share one flag.
#[derive(Clone, Debug, Default)]
pub struct StopFlag {
    stop: Arc<AtomicBool>,
    /// The first signal's number; 0 for none. Written before `stop`.
    signal: Arc<AtomicUsize>,
}

impl StopFlag {
    /// A flag that follows Ctrl-C and SIGTERM from here on.
    ///
    /// # Errors
    /// What the system says.
    pub fn install() -> io::Result<Self> {
        let this = Self::default();
        for signal in StopSignal::ALL {
            let number = signal.number();
            // Handlers run in this order: only a signal that finds the flag set by an earlier one ends the program.
            flag::register_conditional_shutdown(number, i32::from(signal.exit_code()), this.stop.clone())?;
            flag::register_usize(number, this.signal.clone(), number.unsigned_abs() as usize)?;
            flag::register(number, this.stop.clone())?;
        }
        Ok(this)
    }

    /// True once a signal has come.
    pub fn is_set(&self) -> bool {
        self.stop.load(Ordering::SeqCst)
    }

    /// The flag itself, for rooms that know nothing of signals.
    pub fn flag(&self) -> &AtomicBool {
        &self.stop
    }

    /// Which signal came first.
    pub fn signal(&self) -> Option<StopSignal> {
        let number = self.signal.load(Ordering::SeqCst);
        StopSignal::ALL.into_iter().find(|signal| signal.number().unsigned_abs() as usize == number)
    }
}

#[cfg(test)]
mod tests {
    use std::process::Command;

    use signal_hook::low_level::raise;

    use super::*;

    /// Signals belong to the whole process, so each case runs in one of its own: this test, started again by itself.
    fn in_a_child(case: &str) -> Option<i32> {
        let program = std::env::current_exe().expect("the test program");
        let child = Command::new(program)
            .args(["--exact", "--ignored", "cli::signals::tests::child"])
            .env("WHITEWATER_SIGNAL_CASE", case)
            .output();
        child.expect("a child process").status.code()
    }

    #[test]
    fn the_first_signal_asks_and_the_second_ends_the_program() {
        assert_eq!(in_a_child("interrupt"), Some(40), "goes on after the first, knowing which it was");
        assert_eq!(in_a_child("terminate"), Some(41));
        assert_eq!(in_a_child("interrupt interrupt"), Some(130));
        assert_eq!(in_a_child("interrupt terminate"), Some(143));
        assert_eq!(in_a_child("terminate terminate"), Some(143));
        assert_eq!(in_a_child(""), Some(42), "no signal, no stop");
    }

    #[test]
    #[ignore = "a child of the test above"]
    fn child() {
        // Run by hand among other tests it would end them all.
        let Ok(case) = std::env::var("WHITEWATER_SIGNAL_CASE") else { return };
        let stop = StopFlag::install().expect("signals");
        for name in case.split_whitespace() {
            raise(if name == "interrupt" { SIGINT } else { SIGTERM }).expect("raised");
        }
        let code = match stop.signal() {
            Some(StopSignal::Interrupt) => 40,
            Some(StopSignal::Terminate) => 41,
            None => 42,
        };
        assert_eq!(stop.is_set() && stop.flag().load(Ordering::SeqCst), code != 42);
        std::process::exit(code);
    }
}
