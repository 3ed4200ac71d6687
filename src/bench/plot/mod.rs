//! Rows as pictures: what each benchmark shows as curves or bars. How they are drawn is in `draw`.

mod draw;

use std::path::Path;

use self::draw::{Panel, Series, save};
use super::BenchError;
use super::rows::Row;

/// Values of a field in the order of their first appearance.
fn distinct<T: PartialEq>(rows: &[&Row], field: impl Fn(&Row) -> T) -> Vec<T> {
    let mut seen = Vec::new();
    for row in rows {
        let value = field(row);
        if !seen.contains(&value) {
            seen.push(value);
        }
    }
    seen
}

/// One series per title, from rows in their order.
fn series(rows: &[&Row], title: impl Fn(&Row) -> String, point: impl Fn(&Row) -> (f64, f64, String)) -> Vec<Series> {
    let of = |name: &String| rows.iter().filter(|row| title(row) == *name).map(|row| point(row)).collect();
    let names = distinct(rows, &title);
    names.iter().map(|name| Series { name: name.clone(), points: of(name) }).collect()
}

fn select(rows: &[Row], chosen: impl Fn(&Row) -> bool) -> Vec<&Row> {
    rows.iter().filter(|row| chosen(row)).collect()
}

/// Grouped bars of ratios, by class; a panel per size.
pub(super) fn surface(rows: &[Row], directory: &Path) -> Result<(), BenchError> {
    // Those who are slower by far would be no bars at all: the table has them.
    let rows = select(rows, |row| row.bench == "surface");
    let panels = distinct(&rows, |row| row.columns.clone()).into_iter().map(|columns| {
        let here: Vec<&Row> = rows.iter().copied().filter(|row| row.columns == columns).collect();
        // Whichever triangles fit in memory are the baseline, in one colour; the axis says which they are.
        let title = |row: &Row| row.title().replace("triangles-1x1", "triangles");
        let visible = |name: &String| here.iter().any(|row| title(row) == *name && row.ratio >= 0.3);
        let mut series = series(&here, title, |row| (0.0, row.ratio, String::new()));
        series.retain(|series| visible(&series.name));
        let baseline = here.first().map_or_else(String::new, |row| row.title());
        Panel::bars(
            format!("{columns} columns"),
            format!("speed against {baseline}"),
            distinct(&here, |row| row.rays.clone()),
            series,
        )
    });
    save(directory, "surface", "Rays against the water", &panels.collect::<Vec<_>>())
}

/// Speed against count; a panel per class.
pub(super) fn particles(rows: &[Row], directory: &Path) -> Result<(), BenchError> {
    let rows = select(rows, |row| row.bench == "particles");
    let panels = distinct(&rows, |row| row.rays.clone()).into_iter().map(|class| {
        let here: Vec<&Row> = rows.iter().copied().filter(|row| row.rays == class).collect();
        let point = |row: &Row| (row.particles as f64, row.mrays_per_s, String::new());
        Panel::curves(format!("{class} rays"), "particles", "million rays a second", series(&here, Row::title, point))
    });
    save(directory, "particles", "Rays against spray", &panels.collect::<Vec<_>>())
}

/// Error against time, a curve per dial: one plot for rays, one for pictures.
pub(super) fn trade(rows: &[Row], directory: &Path) -> Result<(), BenchError> {
    let rays = select(rows, |row| row.bench == "trade" && row.rays != "picture");
    let point = |row: &Row| (row.seconds * 1e9, row.error_rms, row.setting.clone());
    let panels = distinct(&rays, |row| row.columns.clone()).into_iter().map(|columns| {
        let here: Vec<&Row> = rays.iter().copied().filter(|row| row.columns == columns).collect();
        Panel::curves(
            format!("{columns} columns, incoherent rays"),
            "nanoseconds a ray",
            "rms error of t (columns)",
            series(&here, |row| row.dial.clone(), point),
        )
    });
    save(directory, "trade-rays", "What a ray's accuracy costs", &panels.collect::<Vec<_>>())?;
    let pictures = select(rows, |row| row.bench == "trade" && row.rays == "picture");
    let point = |row: &Row| (row.seconds, row.error_rms, row.setting.clone());
    let panel = Panel::curves(
        "a small scene; each dial against its own finest setting",
        "seconds a picture",
        "rms error of linear light",
        series(&pictures, |row| row.dial.clone(), point),
    );
    save(directory, "trade-pictures", "What a picture's accuracy costs", &[panel])
}

/// Error against each axis.
pub(super) fn extremes(rows: &[Row], directory: &Path) -> Result<(), BenchError> {
    let rows = select(rows, |row| row.bench == "extremes");
    let panels = distinct(&rows, |row| row.dial.clone()).into_iter().map(|axis| {
        // On a logarithmic axis nothing stands at 0.
        let here: Vec<&Row> = rows.iter().copied().filter(|row| row.dial == axis && row.value > 0.0).collect();
        let unit = here.first().and_then(|row| row.setting.split_once(' ')).map_or("", |(_, unit)| unit).to_owned();
        let point = |row: &Row| (row.value, row.error_rms, String::new());
        let title = |row: &Row| row.title().replace(" x16", "");
        Panel::curves(
            axis.clone(),
            &format!("{axis} ({unit})"),
            "rms error of t (columns)",
            series(&here, title, point),
        )
    });
    save(directory, "extremes", "Where precision ends", &panels.collect::<Vec<_>>())
}

/// Error against time of light: a panel per surface for caustics, one for integrators, one for convergence.
pub(super) fn light(rows: &[Row], directory: &Path) -> Result<(), BenchError> {
    // On a logarithmic axis nothing stands at 0.
    let rows = select(rows, |row| {
        matches!(row.bench.as_str(), "light-caustics" | "light-integrators" | "light-convergence")
            && row.error_rms > 0.0
    });
    let panels = distinct(&rows, |row| row.rays.clone()).into_iter().map(|scene| {
        let here: Vec<&Row> = rows.iter().copied().filter(|row| row.rays == scene).collect();
        let point = |row: &Row| (row.seconds, row.error_rms, row.value.to_string());
        let series = series(&here, |row| row.dial.clone(), point);
        Panel::curves(scene.clone(), "seconds a picture", "rms error of luminance over its mean", series)
    });
    save(directory, "light", "What light's accuracy costs, by samples a pixel", &panels.collect::<Vec<_>>())
}
