//! Ways to trace the water against each other: rays per second as ratios to one baseline, errors against the referee.
//!
//! The baseline is the obvious alternative: the same surface as 8x8 quadrilaterals per column in Embree triangles, one
//! ray a call (1x1 where that does not fit in memory). Who takes part is listed in `rivals`.

use std::io::Write;

use super::measure::{self, Checked, Rival};
use super::rivals;
use super::rows::Row;
use super::sheet::{Sheet, number};
use super::work::{self, RayClass};
use super::{BenchError, Settings, size_name};
use crate::scene::SolverKind;
use crate::surface::{Lattice, SplineSurface};

/// The size at which order 4 is measured beside order 3.
const ORDERS_AT: [usize; 2] = [400, 400];

/// Runs the tables and prints them as they grow.
///
/// # Errors
/// Embree is missing, memory ran out, or a file of rows cannot be written.
pub fn run(settings: &Settings, out: &mut impl Write) -> Result<(), BenchError> {
    let mut sheet = Sheet::new(settings, out)?;
    for &size in &settings.sizes {
        one_size(size, settings, &mut sheet)?;
    }
    sheet.say(&format!(
        "Errors are per {} checked rays of each class, fewer for those who take long (`checked` in the rows).",
        settings.checked()
    ))?;
    sheet.plot(settings, super::plot::surface)
}

fn one_size(size: [usize; 2], settings: &Settings, sheet: &mut Sheet) -> Result<(), BenchError> {
    let mut lattices = vec![work::surface(size, 3)?];
    if size == ORDERS_AT {
        lattices.push(work::surface(size, 4)?);
    }
    let (plain, _) = rivals::spline(&lattices[0], SolverKind::default(), settings.simd);
    let mut rivals = rivals::baselines(&plain)?;
    for (index, lattice) in lattices.iter().enumerate() {
        rivals.extend(rivals::ours(lattice, settings, index == 0)?);
    }
    let columns = (size[0] * size[1]) as f64;
    sheet.say(&format!("\n{} columns; ratios to {}", size_name(size), rivals[0].title()))?;
    for class in RayClass::ALL {
        let rays = work::rays(class, &plain, settings.share());
        let speeds = measure::speeds(&rivals, class.any_hit(), &rays, settings);
        let checked = audit(&rivals, &lattices, class, &plain, settings);
        sheet.table(&[class.name(), "Mray/s", "ratio", "lost", "false", "wrong", "tangent", "gave up"])?;
        for ((rival, speed), checked) in rivals.iter().zip(speeds).zip(checked) {
            let audit = checked.audit;
            let row = Row {
                bench: "surface".to_owned(),
                columns: size_name(size),
                rays: class.name().to_owned(),
                mrays_per_s: speed.mrays_per_s,
                ratio: speed.ratio,
                bytes_per_column: rival.bytes / columns,
                threads: settings.threads,
                ..measure::row(rival, &checked)
            };
            let counts = [audit.lost, audit.false_hits, audit.wrong, audit.tangent, checked.gave_up];
            let mut cells = vec![rival.title(), number(speed.mrays_per_s), number(speed.ratio)];
            cells.extend(counts.map(|count| count.to_string()));
            sheet.row(&cells, row)?;
        }
    }
    sheet.table(&["memory and building", "bytes per column", "ms"])?;
    for rival in &rivals {
        let cells = [rival.title(), number(rival.bytes / columns), number(rival.build_ms)];
        let row = Row {
            bench: "surface-build".to_owned(),
            columns: size_name(size),
            bytes_per_column: rival.bytes / columns,
            ..measure::row(rival, &Checked::default())
        };
        sheet.row(&cells, row)?;
    }
    Ok(())
}

/// Holds as many rays of the class against the referee as asked for: an even sample, or turn after turn of other rays of
/// the class. On all processors: the referee takes longer than what it judges.
fn audit(
    rivals: &[Rival],
    lattices: &[Lattice],
    class: RayClass,
    surface: &SplineSurface,
    settings: &Settings,
) -> Vec<Checked> {
    let pairs: Vec<(&Rival, &Lattice)> = rivals
        .iter()
        .filter_map(|rival| lattices.iter().find(|l| l.order as u32 == rival.order).map(|lattice| (rival, lattice)))
        .collect();
    let mut sum = vec![Checked::default(); rivals.len()];
    let mut left = settings.checked();
    for turn in 0.. {
        if left == 0 {
            break;
        }
        // No more than a million at once, which is what they take in memory.
        let rays = work::more_rays(class, surface, settings.share().min(1.0), turn);
        let rays = if rays.len() > left { measure::sample(&rays, left) } else { rays };
        if rays.is_empty() {
            break;
        }
        left -= rays.len().min(left);
        for (sum, one) in sum.iter_mut().zip(measure::check(&pairs, class.any_hit(), &rays)) {
            *sum += one;
        }
        if settings.audit.is_none() {
            break;
        }
    }
    sum
}
