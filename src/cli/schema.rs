//! `whitewater schema`: the JSON Schema of scene files, for editors that complete and check keys.

use super::errors::{CliError, Outcome, print};
use crate::scene;

/// Prints the schema.
///
/// # Errors
/// Standard output cannot be written.
pub fn run() -> Result<Outcome, CliError> {
    print(&format!("{:#}\n", scene::schema()))?;
    Ok(Outcome::Done)
}
