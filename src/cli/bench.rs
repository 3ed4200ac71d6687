//! `whitewater bench`: benchmarks by name, rows to files.

use std::io::{self, Write};

use super::args::{BenchArgs, Benchmark};
use super::errors::{CliError, Outcome};
use crate::bench::{self, BenchError, Settings};

/// Runs the command.
///
/// # Errors
/// Embree is missing, a file of rows cannot be written, or a benchmark found what must not be.
pub fn run(arguments: &BenchArgs) -> Result<Outcome, CliError> {
    let simd = arguments.simd.level()?;
    let sizes = arguments.columns.iter().map(|size| [size.nx as usize, size.nz as usize]).collect::<Vec<_>>();
    // Rays are compared thread by thread; a simulation runs on what the machine has, over a range of sizes.
    let (by_default, some_sizes): (_, &[[usize; 2]]) = match arguments.what {
        Benchmark::Sim => {
            (std::thread::available_parallelism().ok(), &[[80, 20], [200, 200], [400, 400], [1000, 1000], [2000, 2000]])
        }
        Benchmark::Surface | Benchmark::Leaks => (None, &[[400, 400]]),
    };
    let settings = Settings {
        quick: arguments.quick,
        simd,
        threads: arguments.threads.or(by_default).map_or(1, std::num::NonZero::get),
        sizes: if sizes.is_empty() { some_sizes.to_vec() } else { sizes },
        csv: arguments.csv.clone(),
        json: arguments.json.clone(),
    };
    let mut out = io::stdout().lock();
    let result = match arguments.what {
        Benchmark::Surface => bench::surface::run(&settings, &mut out),
        Benchmark::Leaks => bench::leaks::run(&settings, &mut out),
        Benchmark::Sim => bench::sim::run(&settings, &mut out),
    };
    match result {
        Err(BenchError::Print(error)) if error.kind() == io::ErrorKind::BrokenPipe => return Ok(Outcome::Done),
        other => other.map_err(anyhow::Error::from)?,
    }
    out.flush().map_err(CliError::Output)?;
    Ok(Outcome::Done)
}
