//! `whitewater bench`: benchmarks by name, rows to files.

use std::io::{self, Write};
use std::num::NonZeroUsize;

use clap::ValueEnum;

use super::args::{BenchArgs, Benchmark, SimdChoice};
use super::errors::{CliError, Outcome};
use super::values::Malformed;
use crate::bench::{self, BenchError, Settings};

/// Runs the command.
///
/// # Errors
/// Embree is missing, a file of rows cannot be written, or a benchmark found what must not be.
pub fn run(arguments: &BenchArgs) -> Result<Outcome, CliError> {
    refuse(arguments)?;
    let simd = arguments.simd.level()?;
    let sizes = arguments.columns.iter().map(|size| [size.nx as usize, size.nz as usize]).collect::<Vec<_>>();
    let what = arguments.what;
    let settings = Settings {
        quick: arguments.quick,
        simd,
        kernels: match arguments.simd {
            SimdChoice::Auto => Settings::default().kernels,
            _ => vec![simd],
        },
        threads: arguments.threads.or_else(|| threads(what)).map_or(1, std::num::NonZero::get),
        sizes: if sizes.is_empty() { by_default(what, arguments.quick) } else { sizes },
        particles: arguments.particles.iter().map(|count| count.get()).collect(),
        rays: arguments.rays.map(std::num::NonZero::get),
        audit: arguments.audit.map(std::num::NonZero::get),
        csv: arguments.csv.clone(),
        json: arguments.json.clone(),
        markdown: arguments.markdown.clone(),
        plot: arguments.plot.clone(),
    };
    let mut out = io::stdout().lock();
    let result = match what {
        Benchmark::Surface => bench::surface::run(&settings, &mut out),
        Benchmark::Particles => bench::particles::run(&settings, &mut out),
        Benchmark::Trade => bench::trade::run(&settings, &mut out),
        Benchmark::Report => bench::report::run(&settings, &mut out),
        Benchmark::Extremes => bench::extremes::run(&settings, &mut out),
        Benchmark::Threads => bench::threads::run(&settings, &mut out),
        Benchmark::Leaks => bench::leaks::run(&settings, &mut out),
        Benchmark::Sim => bench::sim::run(&settings, &mut out),
        Benchmark::Light => bench::light::run(&settings, &mut out),
        Benchmark::Spray => bench::spray::run(&settings, &mut out),
    };
    match result {
        Err(BenchError::Print(error)) if error.kind() == io::ErrorKind::BrokenPipe => return Ok(Outcome::Done),
        other => other.map_err(anyhow::Error::from)?,
    }
    out.flush().map_err(CliError::Output)?;
    Ok(Outcome::Done)
}

/// Refuses options that the benchmark has no use for.
fn refuse(arguments: &BenchArgs) -> Result<(), CliError> {
    use Benchmark::{Extremes, Leaks, Light, Particles, Report, Spray, Surface, Threads, Trade};
    let options: [(&str, bool, &[Benchmark]); 4] = [
        ("--plot", arguments.plot.is_some(), &[Surface, Particles, Trade, Extremes, Light]),
        ("--rays", arguments.rays.is_some(), &[Surface, Particles, Trade, Report, Extremes, Threads, Leaks, Light]),
        ("--audit", arguments.audit.is_some(), &[Surface, Particles, Trade, Extremes]),
        ("--particles", !arguments.particles.is_empty(), &[Particles, Report, Spray]),
    ];
    for (option, given, takers) in options {
        if given && !takers.contains(&arguments.what) {
            let name =
                |what: &Benchmark| what.to_possible_value().map_or_else(String::new, |v| v.get_name().to_owned());
            let names = takers.iter().map(name).collect::<Vec<_>>().join(", ");
            let problem =
                Malformed { expected: format!("one of the benchmarks {names}, not {}", name(&arguments.what)) };
            return Err(CliError::Option { option, problem });
        }
    }
    Ok(())
}

/// Threads where none are named: rays are compared thread by thread; what simulates, leaks, scales or is lit has all processors.
fn threads(what: Benchmark) -> Option<NonZeroUsize> {
    match what {
        Benchmark::Sim | Benchmark::Leaks | Benchmark::Threads | Benchmark::Light | Benchmark::Spray => {
            std::thread::available_parallelism().ok()
        }
        _ => None,
    }
}

/// Sizes of the water where none are named.
fn by_default(what: Benchmark, quick: bool) -> Vec<[usize; 2]> {
    match what {
        Benchmark::Sim => vec![[80, 20], [200, 200], [400, 400], [1000, 1000], [2000, 2000]],
        Benchmark::Surface => vec![[80, 20], [400, 400], [2000, 2000]],
        // The report's small scene, and what stands for its large one.
        Benchmark::Report => vec![[80, 20], [400, 400]],
        // The small scene; the pool of the caustics has its own size.
        Benchmark::Light => vec![[80, 20]],
        // As many as 16x16 samples of each fit in memory.
        Benchmark::Trade if quick => vec![[64, 64]],
        Benchmark::Trade => vec![[160, 160]],
        Benchmark::Extremes => vec![[64, 64]],
        Benchmark::Particles | Benchmark::Threads | Benchmark::Spray => vec![[400, 400]],
        Benchmark::Leaks => vec![[64, 64]],
    }
}
