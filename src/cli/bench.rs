//! TEMPORARY: `whitewater bench` has not landed yet. This file is to be replaced whole.

use super::args::BenchArgs;
use super::errors::{CliError, Outcome};

/// Runs the command.
///
/// # Errors
/// Always, until the command lands.
pub fn run(_arguments: &BenchArgs) -> Result<Outcome, CliError> {
    Err(CliError::NotBuilt { command: "bench" })
}
