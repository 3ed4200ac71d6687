//! Error against time, one curve per dial: what a user buys with every turn.
//!
//! `rays` holds the dials of a ray against the water, `pictures` those of a whole picture. Each is a list that a new dial
//! adds one entry to.

mod pictures;
mod rays;

use std::io::Write;

use super::sheet::Sheet;
use super::{BenchError, Settings};

/// Runs the tables and prints them as they grow.
///
/// # Errors
/// Embree is missing, memory ran out, or a file of rows cannot be written.
pub fn run(settings: &Settings, out: &mut impl Write) -> Result<(), BenchError> {
    let mut sheet = Sheet::new(settings, out)?;
    for &size in &settings.sizes {
        rays::run(size, settings, &mut sheet)?;
    }
    pictures::run(settings, &mut sheet)?;
    sheet.plot(settings, super::plot::trade)
}
