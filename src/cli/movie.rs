//! `whitewater movie`: rendered frames to a film.

use std::path::PathBuf;

use anyhow::Context;

use super::args::MovieArgs;
use super::errors::{CliError, Outcome};
use super::look::Look;
use super::signals::StopFlag;
use crate::output::{self, MovieOptions, WriteOptions};
use crate::scene::View;
use crate::state::FramePattern;

/// Runs the command.
///
/// # Errors
/// Frames that are missing, damaged or of two sizes; ffmpeg is missing or refuses; what the system says.
pub(super) fn run(arguments: &MovieArgs) -> Result<Outcome, CliError> {
    let pictures = pictures(&arguments.frames)?;
    let view = WriteOptions { view: named(&arguments.view), exposure: arguments.exposure, ..WriteOptions::default() };
    let options = MovieOptions { fps: arguments.fps, view, quality: arguments.quality };
    let stop = StopFlag::install().context("signals cannot be caught")?;
    let look = Look::new(arguments.quiet, "film [{wide_bar}] {percent:>3} % {pos} of {len}, {eta} left");
    if let Look::Bar(bar) = &look {
        bar.set_length(pictures.len() as u64);
    }
    look.show();
    let mut tenth = 0;
    let made = output::write_movie(&pictures, &arguments.output, &options, stop.flag(), |done| {
        if let Look::Bar(bar) = &look {
            bar.set_position(done as u64);
        } else if 10 * done / pictures.len() > tenth {
            tenth = 10 * done / pictures.len();
            look.say(&format!("{} % ({done} of {} pictures)", 10 * tenth, pictures.len()));
        }
    });
    look.hide();
    let made = made.map_err(anyhow::Error::from)?;
    look.say(&format!("wrote {}: {} pictures, {} bytes", made.path.display(), made.frames, made.bytes));
    Ok(stop.signal().map_or(Outcome::Done, Outcome::Stopped))
}

/// A view by its name, which has been checked.
fn named(name: &str) -> View {
    serde_json::from_value(name.into()).unwrap_or_default()
}

/// The pictures in order: those of a pattern with `####`, or files one by one.
fn pictures(frames: &[PathBuf]) -> Result<Vec<PathBuf>, CliError> {
    let mut all = Vec::new();
    for given in frames {
        let name = given.to_string_lossy();
        if !given.file_name().is_some_and(|name| name.to_string_lossy().contains('#')) {
            all.push(given.clone());
            continue;
        }
        let pattern = FramePattern::new(&name, std::path::Path::new("")).map_err(anyhow::Error::from)?;
        let mut found = pattern.existing().map_err(anyhow::Error::from)?;
        // Other kinds of files of the same numbers are none of it.
        found.retain(|(_, path)| path.extension() == given.extension());
        found.sort();
        let (Some(first), Some(last)) = (found.first(), found.last()) else {
            return Err(anyhow::anyhow!("{name}: there are no such files; expected one for each frame").into());
        };
        let missing: Vec<String> = (first.0..=last.0)
            .filter(|number| found.binary_search_by_key(number, |(found, _)| *found).is_err())
            .take(10)
            .map(|number| number.to_string())
            .collect();
        if !missing.is_empty() {
            let (first, last) = (first.0, last.0);
            return Err(anyhow::anyhow!(
                "{name}: frames {} are missing between {first} and {last}; expected every one",
                missing.join(", ")
            )
            .into());
        }
        all.extend(found.into_iter().map(|(_, path)| path));
    }
    Ok(all)
}
