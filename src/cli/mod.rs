//! What was typed → a checked job.

pub mod convert;
pub mod inspect;

use std::ffi::OsString;
use std::process::ExitCode;

/// Runs the program.
pub fn run(_arguments: impl Iterator<Item = OsString>) -> ExitCode {
    ExitCode::SUCCESS
}
