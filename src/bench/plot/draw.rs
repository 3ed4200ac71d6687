//! Panels of curves or bars as SVG and PNG, with a legend beside them. Knows numbers and names, not what they mean.
//!
//! The font of the PNG is part of the program, so that no system library or file is needed.

use std::path::Path;
use std::sync::Once;

use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{FontStyle, register_font};

use crate::bench::BenchError;

/// Named points: x, y, and what is written beside.
pub(super) struct Series {
    pub name: String,
    pub points: Vec<(f64, f64, String)>,
}

/// One diagram.
pub(super) struct Panel {
    title: String,
    x: String,
    y: String,
    /// Names of the groups of bars; none for curves.
    groups: Vec<String>,
    series: Vec<Series>,
}

impl Panel {
    /// Curves on logarithmic axes.
    pub(super) fn curves(title: impl Into<String>, x: &str, y: &str, series: Vec<Series>) -> Self {
        Self { title: title.into(), x: x.to_owned(), y: y.to_owned(), groups: Vec::new(), series }
    }

    /// Bars side by side: in each series one point per group, in their order.
    pub(super) fn bars(title: String, y: String, groups: Vec<String>, series: Vec<Series>) -> Self {
        Self { title, x: String::new(), y, groups, series }
    }

    fn is_bars(&self) -> bool {
        !self.groups.is_empty()
    }
}

/// Okabe and Ito's colours, which the colour-blind can tell apart, then darker ones of other hues.
const COLOURS: [RGBColor; 14] = [
    RGBColor(0x55, 0x55, 0x55),
    RGBColor(0xe6, 0x9f, 0x00),
    RGBColor(0x56, 0xb4, 0xe9),
    RGBColor(0x00, 0x9e, 0x73),
    RGBColor(0xd5, 0x5e, 0x00),
    RGBColor(0x00, 0x72, 0xb2),
    RGBColor(0xcc, 0x79, 0xa7),
    RGBColor(0xb8, 0xa8, 0x00),
    RGBColor(0x7b, 0x3f, 0x00),
    RGBColor(0x6a, 0x3d, 0x9a),
    RGBColor(0x1b, 0x4d, 0x1b),
    RGBColor(0xb0, 0x00, 0x30),
    RGBColor(0x00, 0x40, 0x40),
    RGBColor(0xa0, 0xa0, 0xa0),
];

const INK: RGBColor = RGBColor(0x22, 0x22, 0x22);
const GRID: RGBColor = RGBColor(0xdd, 0xdd, 0xdd);
const LEGEND: u32 = 290;

/// Writes `NAME.svg` and `NAME.png` into the folder, which is made if it is not there.
pub(super) fn save(directory: &Path, name: &str, title: &str, panels: &[Panel]) -> Result<(), BenchError> {
    static FONT: Once = Once::new();
    FONT.call_once(|| {
        // The one error is a font that cannot be read, and this one is part of the program; text would be missing.
        let _ = register_font("sans-serif", FontStyle::Normal, epaint_default_fonts::UBUNTU_LIGHT);
    });
    if panels.is_empty() {
        return Ok(());
    }
    std::fs::create_dir_all(directory).map_err(|source| BenchError::file(directory, source))?;
    let bars = panels.iter().any(Panel::is_bars);
    let across = if bars || panels.len() == 1 { 1 } else { 2 };
    let down = panels.len().div_ceil(across);
    let cell = if bars {
        (1250, 430)
    } else if panels.len() == 1 {
        (950, 700)
    } else {
        (640, 470)
    };
    let size = (cell.0 * across as u32 + LEGEND, cell.1 * down as u32 + 50);

    let mut text = String::new();
    draw(SVGBackend::with_string(&mut text, size).into_drawing_area(), title, panels, (down, across))?;
    let path = directory.join(format!("{name}.svg"));
    std::fs::write(&path, text).map_err(|source| BenchError::file(&path, source))?;

    let mut pixels = vec![0; (size.0 * size.1 * 3) as usize];
    draw(BitMapBackend::with_buffer(&mut pixels, size).into_drawing_area(), title, panels, (down, across))?;
    let path = directory.join(format!("{name}.png"));
    image::save_buffer(&path, &pixels, size.0, size.1, image::ColorType::Rgb8)
        .map_err(|error| BenchError::Internal(format!("{}: {error}", path.display())))
}

fn failed(error: impl std::fmt::Display) -> BenchError {
    BenchError::Internal(format!("cannot draw: {error}"))
}

fn draw<B: DrawingBackend>(
    root: DrawingArea<B, Shift>,
    title: &str,
    panels: &[Panel],
    (down, across): (usize, usize),
) -> Result<(), BenchError> {
    root.fill(&WHITE).map_err(failed)?;
    let (head, body) = root.split_vertically(50);
    head.draw(&Text::new(title.to_owned(), (20, 14), ("sans-serif", 26).into_font().color(&INK))).map_err(failed)?;
    let width = body.dim_in_pixel().0 - LEGEND;
    let (left, right) = body.split_horizontally(width);
    // One colour per name over all panels.
    let mut names: Vec<&str> = Vec::new();
    for series in panels.iter().flat_map(|panel| &panel.series) {
        if !names.contains(&series.name.as_str()) {
            names.push(&series.name);
        }
    }
    for (panel, area) in panels.iter().zip(left.split_evenly((down, across))) {
        if panel.is_bars() { bars(&area, panel, &names)? } else { curves(&area, panel, &names)? }
    }
    for (k, name) in names.iter().enumerate() {
        let y = 40 + 24 * k as i32;
        if panels[0].is_bars() {
            right.draw(&Rectangle::new([(12, y), (30, y + 13)], colour(k).filled())).map_err(failed)?;
        } else {
            right.draw(&PathElement::new(vec![(8, y + 6), (34, y + 6)], colour(k).stroke_width(3))).map_err(failed)?;
            marker(&right, (21, y + 6), k, 5)?;
        }
        let style = ("sans-serif", 16).into_font().color(&INK);
        right.draw(&Text::new((*name).to_owned(), (40, y - 1), style)).map_err(failed)?;
    }
    root.present().map_err(failed)
}

/// The k-th colour; a second round is half as strong.
fn colour(k: usize) -> RGBColor {
    let RGBColor(r, g, b) = COLOURS[k % COLOURS.len()];
    let pale = |part: u8| if k < COLOURS.len() { part } else { part / 2 + 127 };
    RGBColor(pale(r), pale(g), pale(b))
}

/// A shape per series, beside its colour.
fn marker<B: DrawingBackend>(
    area: &DrawingArea<B, Shift>,
    at: (i32, i32),
    k: usize,
    size: i32,
) -> Result<(), BenchError> {
    // A white one under it: an edge that keeps crossing curves apart.
    for (size, colour) in [(size + 1, WHITE), (size, colour(k))] {
        let style = colour.filled();
        match k % 3 {
            0 => area.draw(&Circle::new(at, size, style)).map_err(failed)?,
            1 => area.draw(&TriangleMarker::new(at, size + 1, style)).map_err(failed)?,
            _ => {
                let corners = [(at.0 - size, at.1 - size), (at.0 + size, at.1 + size)];
                area.draw(&Rectangle::new(corners, style)).map_err(failed)?;
            }
        }
    }
    Ok(())
}

/// Text around a point.
fn label<B: DrawingBackend>(
    area: &DrawingArea<B, Shift>,
    text: &str,
    at: (i32, i32),
    size: u32,
    anchor: (HPos, VPos),
    turned: bool,
) -> Result<(), BenchError> {
    let font = ("sans-serif", size).into_font();
    let font = if turned { font.transform(FontTransform::Rotate270) } else { font };
    let style = font.color(&INK).pos(Pos::new(anchor.0, anchor.1));
    area.draw(&Text::new(text.to_owned(), at, style)).map_err(failed)
}

/// Where a panel's diagram lies within its area, in pixels: left, top, right, bottom.
struct Frame {
    left: i32,
    top: i32,
    right: i32,
    bottom: i32,
}

impl Frame {
    fn of<B: DrawingBackend>(area: &DrawingArea<B, Shift>, panel: &Panel) -> Result<Self, BenchError> {
        let (width, height) = area.dim_in_pixel();
        let frame = Self { left: 82, top: 42, right: width as i32 - 30, bottom: height as i32 - 62 };
        let middle = (frame.left + frame.right) / 2;
        label(area, &panel.title, (middle, 14), 19, (HPos::Center, VPos::Top), false)?;
        label(area, &panel.x, (middle, frame.bottom + 32), 16, (HPos::Center, VPos::Top), false)?;
        let side = (16, (frame.top + frame.bottom) / 2);
        label(area, &panel.y, side, 16, (HPos::Center, VPos::Center), true)?;
        Ok(frame)
    }

    fn border<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>) -> Result<(), BenchError> {
        let corners = [(self.left, self.top), (self.right, self.bottom)];
        area.draw(&Rectangle::new(corners, INK.stroke_width(1))).map_err(failed)
    }

    fn line<B: DrawingBackend>(
        &self,
        area: &DrawingArea<B, Shift>,
        from: (i32, i32),
        to: (i32, i32),
        colour: RGBColor,
        width: u32,
    ) -> Result<(), BenchError> {
        area.draw(&PathElement::new(vec![from, to], colour.stroke_width(width))).map_err(failed)
    }
}

/// A logarithmic axis over whole decades, or 1, 2, 5 of them where there are few.
struct LogAxis {
    low: f64,
    high: f64,
    ticks: Vec<f64>,
}

impl LogAxis {
    fn over(values: impl Iterator<Item = f64>) -> Self {
        let (mut low, mut high) = (f64::INFINITY, 0.0f64);
        for value in values.filter(|value| *value > 0.0 && value.is_finite()) {
            (low, high) = (low.min(value), high.max(value));
        }
        if low > high {
            (low, high) = (1.0, 10.0);
        }
        let room = (high / low).powf(0.05).max(1.1);
        let (low, high) = ((low / room).log10(), (high * room).log10());
        let decades = high - low;
        let step = (decades / 9.0).ceil().max(1.0) as i32;
        let parts: &[f64] = if decades < 2.5 { &[1.0, 2.0, 5.0] } else { &[1.0] };
        let mut ticks = Vec::new();
        for decade in (low.floor() as i32..=high.ceil() as i32).filter(|decade| decade % step == 0) {
            ticks.extend(parts.iter().map(|part| part * 10f64.powi(decade)));
        }
        ticks.retain(|tick| (low..=high).contains(&tick.log10()));
        Self { low, high, ticks }
    }

    /// Place between two pixels; what is not positive stands at the low end.
    fn place(&self, value: f64, from: i32, to: i32) -> i32 {
        let share = if value > 0.0 { (value.log10() - self.low) / (self.high - self.low) } else { 0.0 };
        from + (share.clamp(0.0, 1.0) * f64::from(to - from)).round() as i32
    }
}

/// A tick's name: a plain number near 1, else a power of ten.
fn tick(value: f64) -> String {
    if (0.01..100_000.0).contains(&value) {
        let digits = (-value.log10().floor()).max(0.0) as usize;
        return format!("{value:.digits$}");
    }
    format!("{value:.0e}")
}

fn curves<B: DrawingBackend>(area: &DrawingArea<B, Shift>, panel: &Panel, names: &[&str]) -> Result<(), BenchError> {
    let frame = Frame::of(area, panel)?;
    let points = || panel.series.iter().flat_map(|series| &series.points);
    let x = LogAxis::over(points().map(|point| point.0));
    let y = LogAxis::over(points().map(|point| point.1));
    for &value in &x.ticks {
        let at = x.place(value, frame.left, frame.right);
        frame.line(area, (at, frame.top), (at, frame.bottom), GRID, 1)?;
        label(area, &tick(value), (at, frame.bottom + 8), 14, (HPos::Center, VPos::Top), false)?;
    }
    for &value in &y.ticks {
        let at = y.place(value, frame.bottom, frame.top);
        frame.line(area, (frame.left, at), (frame.right, at), GRID, 1)?;
        label(area, &tick(value), (frame.left - 8, at), 14, (HPos::Right, VPos::Center), false)?;
    }
    frame.border(area)?;
    let place = |point: &(f64, f64, String)| {
        (x.place(point.0, frame.left, frame.right), y.place(point.1, frame.bottom, frame.top))
    };
    // Boxes that are taken by text: what would lie on one is left out, the table has it.
    let mut taken: Vec<[i32; 4]> = Vec::new();
    for (above, series) in panel.series.iter().enumerate() {
        // The first are the widest: where curves coincide, each is still seen beside the ones drawn over it.
        let width = 2 + (panel.series.len() - 1 - above).min(3) as u32;
        let k = names.iter().position(|name| *name == series.name).unwrap_or(0);
        let path: Vec<(i32, i32)> = series.points.iter().map(place).collect();
        // Piece by piece: a wide path's corners stick out where it doubles back.
        for piece in path.windows(2) {
            frame.line(area, piece[0], piece[1], colour(k), width)?;
        }
        for at in path {
            marker(area, at, k, 4)?;
        }
    }
    for series in &panel.series {
        for point in series.points.iter().filter(|point| !point.2.is_empty()) {
            let (px, py) = place(point);
            let width = 7 * point.2.chars().count() as i32 + 6;
            let end = px + 8 + width > frame.right;
            let (from, anchor) = if end { (px - 8 - width, HPos::Right) } else { (px + 8, HPos::Left) };
            let place = [from, py - 16, from + width, py - 3];
            if taken.iter().any(|t| t[0] < place[2] && place[0] < t[2] && t[1] < place[3] && place[1] < t[3]) {
                continue;
            }
            taken.push(place);
            let at = (if end { px - 8 } else { px + 8 }, py - 3);
            label(area, &point.2, at, 12, (anchor, VPos::Bottom), false)?;
        }
    }
    Ok(())
}

fn bars<B: DrawingBackend>(area: &DrawingArea<B, Shift>, panel: &Panel, names: &[&str]) -> Result<(), BenchError> {
    let frame = Frame::of(area, panel)?;
    let highest = panel.series.iter().flat_map(|series| &series.points).map(|point| point.1).fold(1.0, f64::max);
    let top = highest * 1.15;
    let step = [0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0].into_iter().find(|s| top / s <= 8.0).unwrap_or(100.0);
    let height = |value: f64| frame.bottom - (value / top * f64::from(frame.bottom - frame.top)).round() as i32;
    for k in 0..=(top / step) as u32 {
        let value = f64::from(k) * step;
        frame.line(area, (frame.left, height(value)), (frame.right, height(value)), GRID, 1)?;
        let text = if step < 1.0 { format!("{value:.1}") } else { format!("{value:.0}") };
        label(area, &text, (frame.left - 8, height(value)), 14, (HPos::Right, VPos::Center), false)?;
    }
    let group = f64::from(frame.right - frame.left) / panel.groups.len() as f64;
    let bar = group * 0.9 / panel.series.len().max(1) as f64;
    for (g, name) in panel.groups.iter().enumerate() {
        let start = f64::from(frame.left) + group * (g as f64 + 0.05);
        let middle = (start + group * 0.45) as i32;
        label(area, name, (middle, frame.bottom + 8), 16, (HPos::Center, VPos::Top), false)?;
        for (s, series) in panel.series.iter().enumerate() {
            let Some(point) = series.points.get(g) else { continue };
            let k = names.iter().position(|name| *name == series.name).unwrap_or(0);
            let from = (start + bar * s as f64) as i32;
            let to = ((start + bar * (s + 1) as f64) as i32 - 1).max(from + 1);
            let rectangle = Rectangle::new([(from, height(point.1)), (to, frame.bottom)], colour(k).filled());
            area.draw(&rectangle).map_err(failed)?;
            let at = ((from + to) / 2, height(point.1) - 4);
            let digits = if point.1 >= 1.0 { 1 } else { 2 };
            // Upwards, so that neighbours do not run into each other.
            label(area, &format!("{:.digits$}", point.1), at, 12, (HPos::Left, VPos::Center), true)?;
        }
    }
    // The baseline's height.
    frame.line(area, (frame.left, height(1.0)), (frame.right, height(1.0)), INK, 1)?;
    frame.border(area)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_hold_their_values_and_round_numbers() {
        let axis = LogAxis::over([3e-4, 0.0, 70.0].into_iter());
        assert_eq!(axis.ticks, [1e-3, 1e-2, 0.1, 1.0, 10.0, 100.0]);
        assert_eq!(axis.place(0.0, 10, 110), 10);
        let [low, high] = [3e-4, 70.0].map(|value| axis.place(value, 10, 110));
        assert!(10 < low && low < high && high < 110);
        let short = LogAxis::over([1.5, 6.0].into_iter());
        assert_eq!(short.ticks, [2.0, 5.0]);
        assert_eq!([1e-7, 0.05, 2.0, 1e7].map(tick), ["1e-7", "0.05", "2", "1e7"]);
    }

    #[test]
    fn curves_and_bars_become_files_with_their_names_in_them() {
        let directory = tempfile::tempdir().unwrap();
        let series = |name: &str| Series {
            name: name.to_owned(),
            points: vec![(1.0, 1e-3, "coarse".to_owned()), (20.0, 0.0, "fine".to_owned())],
        };
        let curve = Panel::curves("errors", "time", "error", vec![series("one"), series("two")]);
        let bar = Panel::bars(
            "ratios".to_owned(),
            "ratio".to_owned(),
            vec!["a".to_owned(), "b".to_owned()],
            vec![series("one")],
        );
        for (name, panel) in [("curves", curve), ("bars", bar)] {
            save(directory.path(), name, "A plot", &[panel]).unwrap();
            let text = std::fs::read_to_string(directory.path().join(format!("{name}.svg"))).unwrap();
            assert!(text.contains("A plot") && text.contains("one"));
            let picture = image::open(directory.path().join(format!("{name}.png"))).unwrap().to_rgb8();
            let ink = picture.pixels().filter(|pixel| pixel.0.iter().all(|&value| value < 80)).count();
            assert!(ink > 500, "no text or lines: {ink}");
        }
    }
}
