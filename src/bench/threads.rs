//! How speed grows with threads: batches through Embree and through the stream, on 1, 2, 4 … threads in turns.

use std::io::Write;
use std::sync::Arc;

use super::measure::{self, Checked, Turn};
use super::rows::Row;
use super::sheet::{Sheet, number};
use super::work::{self, RayClass};
use super::{BenchError, Settings, rivals, size_name};
use crate::scene::SolverKind;

/// Runs the table and prints it as it grows.
///
/// # Errors
/// Embree is missing, or a file of rows cannot be written.
pub fn run(settings: &Settings, out: &mut impl Write) -> Result<(), BenchError> {
    let mut sheet = Sheet::new(settings, out)?;
    let counts = counts(settings.threads);
    for &size in &settings.sizes {
        let lattice = work::surface(size, 3)?;
        let (surface, _) = rivals::spline(&lattice, SolverKind::default(), settings.simd);
        let all = rivals::ours(&lattice, settings, false)?;
        sheet.say(&format!("\n{} columns; ratios to one thread", size_name(size)))?;
        for class in RayClass::ALL {
            let rays = Arc::new(measure::split(&work::rays(class, &surface, settings.share())));
            sheet.table(&[class.name(), "threads", "Mray/s", "ratio", "of ideal"])?;
            for rival in all.iter().filter(|rival| rival.tracer.batch() && rival.name != "walk") {
                let turns: Vec<Turn> = counts.iter().map(|&threads| Turn::new(rival, &rays, threads)).collect();
                let speeds = measure::in_turns(&turns, class.any_hit(), settings);
                for (&threads, speed) in counts.iter().zip(speeds) {
                    let row = Row {
                        bench: "threads".to_owned(),
                        columns: size_name(size),
                        batch: true,
                        rays: class.name().to_owned(),
                        mrays_per_s: speed.mrays_per_s,
                        ratio: speed.ratio,
                        bytes_per_column: rival.bytes / (size[0] * size[1]) as f64,
                        threads,
                        ..measure::row(rival, &Checked::default())
                    };
                    let share = format!("{:.0}%", 100.0 * speed.ratio / threads as f64);
                    let figures = [threads.to_string(), number(speed.mrays_per_s), number(speed.ratio), share];
                    sheet.row(&[&[rival.title()], &figures[..]].concat(), row)?;
                }
            }
        }
    }
    Ok(())
}

/// 1, 2, 4 … and the most.
fn counts(most: usize) -> Vec<usize> {
    let mut counts: Vec<usize> = std::iter::successors(Some(1), |n| Some(n * 2)).take_while(|n| *n < most).collect();
    counts.push(most);
    counts
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn threads_double_up_to_what_there_is() {
        assert_eq!(counts(1), [1]);
        assert_eq!(counts(2), [1, 2]);
        assert_eq!(counts(6), [1, 2, 4, 6]);
    }
}
