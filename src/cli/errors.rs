//! How the program ends: its errors as a person reads them, its outcomes as exit codes.

use std::error::Error;
use std::io::{self, Write};
use std::process::ExitCode;

use super::signals::StopSignal;
use super::values::Malformed;
use crate::scene::SceneErrors;

/// Why a command could not run; exit code 2.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CliError {
    /// The scene, its file or its overrides are wrong.
    #[error(transparent)]
    Scene(#[from] SceneErrors),
    /// An option does not fit the scene.
    #[error("{option}: {problem}")]
    Option {
        /// The option, as `--crop`.
        option: &'static str,
        /// What was expected of it.
        problem: Malformed,
    },
    /// Standard output could not be written.
    #[error("cannot write to standard output")]
    Output(#[source] io::Error),
    /// The system would not tell of signals.
    #[error("cannot listen for Ctrl-C and SIGTERM")]
    Signals(#[source] io::Error),
    /// WHITEWATER_LOG is no filter.
    #[error("WHITEWATER_LOG={value}: expected a filter as info or whitewater=debug")]
    LogFilter {
        /// What it holds.
        value: String,
    },
    /// An instruction set that is not there.
    #[error("--simd {name}: this processor does not have it; expected another, or auto")]
    NoSimd {
        /// The one asked for.
        name: &'static str,
    },
    /// What another room could not do.
    #[error(transparent)]
    Other(#[from] anyhow::Error),
}

/// How a command that ran has ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// Everything was done.
    Done,
    /// It came to its end, but some frames were lost; each has been reported.
    FramesLost,
    /// A signal stopped it; what was done has been written.
    Stopped(StopSignal),
}

impl Outcome {
    /// The program's exit code (docs/formats.md, section 3).
    pub fn code(self) -> u8 {
        match self {
            Self::Done => 0,
            Self::FramesLost => 1,
            Self::Stopped(signal) => signal.exit_code(),
        }
    }
}

impl From<Outcome> for ExitCode {
    fn from(outcome: Outcome) -> Self {
        Self::from(outcome.code())
    }
}

/// The error as lines: `error: …`, its causes under it; one `error:` for each of a scene's errors.
pub fn report(error: &CliError, out: &mut impl Write) -> io::Result<()> {
    match error {
        CliError::Scene(errors) => {
            for error in errors.iter() {
                chain(error, out)?;
            }
            let count = errors.iter().count();
            match count {
                1 => Ok(()),
                SceneErrors::MOST => writeln!(out, "{count} errors or more"),
                _ => writeln!(out, "{count} errors"),
            }
        }
        CliError::Other(error) => chain(error.as_ref(), out),
        error => chain(error, out),
    }
}

fn chain(error: &dyn Error, out: &mut impl Write) -> io::Result<()> {
    let mut last = error.to_string();
    writeln!(out, "error: {last}")?;
    let mut cause = error.source();
    while let Some(error) = cause {
        let text = error.to_string();
        // Many errors end with their cause's own words already.
        if !last.ends_with(&text) {
            writeln!(out, "  caused by: {text}")?;
        }
        last = text;
        cause = error.source();
    }
    Ok(())
}

/// Prints a command's answer. A reader that has gone (`… | head`) is no error.
///
/// # Errors
/// What the system says.
pub fn print(text: &str) -> Result<(), CliError> {
    let mut out = io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(error) if error.kind() == io::ErrorKind::BrokenPipe => Ok(()),
        result => result.map_err(CliError::Output),
    }
}

#[cfg(test)]
mod tests {
    use anyhow::Context;

    use super::*;

    fn reported(error: CliError) -> String {
        let mut out = Vec::new();
        report(&error, &mut out).expect("a vector takes everything");
        String::from_utf8(out).expect("text")
    }

    #[test]
    fn causes_stand_under_the_error_once() {
        let cause = io::Error::other("disk on fire");
        let error = Err::<(), _>(cause).context("out.exr: cannot be written").context("frame 7").expect_err("an error");
        assert_eq!(
            reported(error.into()),
            "error: frame 7\n  caused by: out.exr: cannot be written\n  caused by: disk on fire\n"
        );
        let said_already = anyhow::Error::new(CliError::LogFilter { value: "x".into() })
            .context("a: WHITEWATER_LOG=x: expected a filter as info or whitewater=debug");
        assert_eq!(reported(said_already.into()).lines().count(), 1);
    }

    #[test]
    fn every_error_of_a_scene_has_a_line() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("s.toml");
        std::fs::write(&path, "a = 1\nb = 2\n").expect("written");
        let text = reported(crate::scene::load(&path, &[]).expect_err("errors").into());
        assert_eq!(text.matches("error: ").count(), 3, "{text}");
        assert!(text.ends_with("\n3 errors\n"), "{text}");
    }

    #[test]
    fn outcomes_have_the_fixed_exit_codes() {
        let codes = [Outcome::Done, Outcome::FramesLost, Outcome::Stopped(StopSignal::Interrupt)].map(Outcome::code);
        assert_eq!(codes, [0, 1, 130]);
        assert_eq!(Outcome::Stopped(StopSignal::Terminate).code(), 143);
    }
}
