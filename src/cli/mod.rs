//! What was typed → a checked job; progress, signals, errors and exit codes. Nothing imports this room.

pub mod args;
pub mod bench;
pub mod errors;
mod finished;
mod foam;
mod keep;
pub mod load;
mod look;
pub mod merge;
mod moments;
mod movie;
mod prepare;
pub mod progress;
pub mod render;
pub mod schema;
pub mod signals;
pub mod simulate;
pub mod stats;
pub mod trace;
pub mod values;
mod watch;

pub mod convert;
pub mod inspect;

use std::ffi::OsString;
use std::io::Write;
use std::process::ExitCode;

use clap::Parser;
use tracing_subscriber::EnvFilter;

use args::{Cli, Command};
use errors::{CliError, Outcome};

use crate::state::Encoding;

/// Runs the program: arguments (the program's own name first) in, exit code out.
pub fn run(arguments: impl Iterator<Item = OsString>) -> ExitCode {
    let cli = match Cli::try_parse_from(arguments) {
        Ok(cli) => cli,
        Err(error) => {
            // Help and version go to standard output with code 0, usage errors to standard error with 2. Where neither
            // can be written there is nobody left to tell.
            let _ = error.print();
            return ExitCode::from(if error.use_stderr() { 2 } else { 0 });
        }
    };
    match start_log(&cli.command).and_then(|()| dispatch(&cli.command)) {
        Ok(outcome) => outcome.into(),
        Err(error) => {
            let mut text = Vec::new();
            let _ = errors::report(&error, &mut text);
            let _ = std::io::stderr().lock().write_all(&text);
            ExitCode::from(2)
        }
    }
}

fn dispatch(command: &Command) -> Result<Outcome, CliError> {
    match command {
        Command::Render(arguments) => render::run(arguments),
        Command::Merge(arguments) => merge::run(arguments),
        Command::Movie(arguments) => movie::run(arguments),
        Command::Simulate(arguments) => simulate::run(arguments),
        Command::Trace(arguments) => trace::run(arguments),
        Command::Schema => schema::run(),
        Command::Bench(arguments) => bench::run(arguments),
        Command::Inspect(arguments) => {
            inspect::run(&arguments.files, arguments.dry_threshold, arguments.json, arguments.classes)
                .map_err(anyhow::Error::from)?;
            Ok(Outcome::Done)
        }
        Command::Convert(arguments) => convert_frame(arguments),
    }
}

fn convert_frame(arguments: &args::ConvertArgs) -> Result<Outcome, CliError> {
    let encoding = match (arguments.text, arguments.npz) {
        (true, _) => Some(Encoding::Text),
        (_, true) => Some(Encoding::Npz),
        _ => None,
    };
    let done = convert::run(&arguments.input, &arguments.output, encoding, arguments.dry_threshold)
        .map_err(anyhow::Error::from)?;
    for name in &done.left_out {
        tracing::warn!("{}: left out the array {name}", arguments.output.display());
    }
    Ok(Outcome::Done)
}

/// Warnings go to standard error; `--verbose` adds what is being done, `--quiet` leaves errors. `WHITEWATER_LOG` is a
/// filter in the form of the crate tracing-subscriber, and wins.
fn start_log(command: &Command) -> Result<(), CliError> {
    let level = match command {
        Command::Render(arguments) if arguments.quiet => "error",
        Command::Render(arguments) if arguments.verbose => "warn,whitewater=debug",
        Command::Simulate(arguments) if arguments.quiet => "error",
        Command::Simulate(arguments) if arguments.verbose => "warn,whitewater=debug",
        _ => "warn",
    };
    let filter = match std::env::var("WHITEWATER_LOG") {
        Ok(value) if !value.is_empty() => {
            EnvFilter::try_new(&value).map_err(|_| CliError::LogFilter { value: value.clone() })?
        }
        _ => EnvFilter::new(level),
    };
    let subscriber = tracing_subscriber::fmt().with_env_filter(filter).with_target(false).without_time();
    // A program that calls this twice keeps its first log.
    let _ = subscriber.with_ansi(false).with_writer(look::log_writer).try_init();
    Ok(())
}
