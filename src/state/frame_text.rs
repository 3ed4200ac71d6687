//! One frame as text: `whitewater-frame 1` … `end`, read and written.
//!
//! Rows are kept as they arrive. Counts are believed only as far as the file's own size can bear them out.

use std::io::{BufRead, Write};

use super::check;
use super::error::{Place, Problem, Problems, Stop, quote};
use super::lines::{Lines, numbers};
use super::{Columns, Frame, Particles, StateError};

/// The first word of the file.
pub(super) const MAGIC: &str = "whitewater-frame";

/// `0 0 0 0 0` and a line feed: no row of a column is shorter (bytes).
const SHORTEST_COLUMN: u64 = 10;
/// The same for a particle's eight numbers.
const SHORTEST_PARTICLE: u64 = 16;

const COLUMN: [&str; 5] = ["base", "top", "pressure", "flow_x", "flow_z"];
const PARTICLE: [&str; 8] = ["x", "y", "z", "vx", "vy", "vz", "mass", "age"];

/// Reads a frame of `file_bytes` bytes, noting what is wrong with it.
pub(super) fn read(
    reader: impl BufRead,
    file_bytes: u64,
    dry_threshold: f64,
    problems: &mut Problems,
) -> Result<Frame, Stop> {
    let mut lines = Lines::new(reader)?;
    lines.magic(MAGIC)?;
    let [time] = setting(&mut lines, "time", &["t"], problems)?;
    let origin = setting(&mut lines, "origin", &["x", "z"], problems)?;
    let width = setting(&mut lines, "width", &["dx", "dz"], problems)?;
    let (nx, nz) = grid(&mut lines, file_bytes)?;

    let mut columns = Columns { origin, width, nx, nz, ..Columns::default() };
    for heights in [&mut columns.base, &mut columns.top, &mut columns.pressure] {
        heights.reserve_exact(nx * nz);
    }
    columns.flow.reserve_exact(nx * nz);
    rows(&mut lines, nx * nz, "columns", &COLUMN, problems, |[base, top, pressure, x, z], place, problems| {
        if let Some((found, expected)) = check::heights(base, top, dry_threshold) {
            problems.note(|| Problem::new(place(), found, expected));
        }
        columns.base.push(base);
        columns.top.push(top);
        columns.pressure.push(pressure);
        columns.flow.push([x, z]);
    })?;

    let count = particle_count(&mut lines, file_bytes)?;
    let mut particles = Particles::default();
    particles.position.reserve_exact(count);
    particles.velocity.reserve_exact(count);
    particles.mass.reserve_exact(count);
    particles.age.reserve_exact(count);
    rows(&mut lines, count, "particles", &PARTICLE, problems, |[x, y, z, vx, vy, vz, mass, age], place, problems| {
        for (name, value) in [("mass", mass), ("age", age)] {
            if let Some((found, expected)) = check::at_least_zero(name, value) {
                problems.note(|| Problem::new(place(), found, expected));
            }
        }
        particles.position.push([x, y, z]);
        particles.velocity.push([vx, vy, vz]);
        particles.mass.push(mass);
        particles.age.push(age);
    })?;
    lines.end()?;
    Ok(Frame { time, columns, particles, extra: Vec::new() })
}

/// Takes the line that must open with `keyword`.
fn keyword<R: BufRead>(lines: &mut Lines<R>, keyword: &str, arguments: &str) -> Result<(), Stop> {
    if lines.keyword() == Some(keyword) {
        return Ok(());
    }
    Err(lines.unexpected(format!("`{keyword} {arguments}` (the order of a frame's lines is fixed)")).into())
}

/// What stands after the keyword of the current line.
fn arguments<'a>(text: &'a str, keyword: &str) -> &'a str {
    text[keyword.len()..].trim_ascii()
}

/// `time`, `origin` or `width`. A wrong number is noted and reading goes on: the lines after it keep their meaning.
fn setting<const N: usize, R: BufRead>(
    lines: &mut Lines<R>,
    name: &str,
    names: &[&str; N],
    problems: &mut Problems,
) -> Result<[f64; N], Stop> {
    keyword(lines, name, &names.join(" "))?;
    let place = lines.place();
    let values = match numbers(arguments(lines.text().unwrap_or_default(), name), names) {
        Ok(values) => values,
        Err((found, expected)) => {
            problems.note(|| Problem::new(place, format!("{name}: {found}"), expected));
            lines.advance()?;
            return Ok([0.0; N]);
        }
    };
    if name == "width"
        && let Some((found, expected)) = check::width([values[0], values[N - 1]])
    {
        problems.note(|| Problem::new(place, found, expected));
    }
    lines.advance()?;
    Ok(values)
}

/// `columns nx nz`. Without it the rows mean nothing, so that anything wrong here stops.
fn grid<R: BufRead>(lines: &mut Lines<R>, file_bytes: u64) -> Result<(usize, usize), Stop> {
    keyword(lines, "columns", "nx nz")?;
    let text = lines.text().unwrap_or_default();
    let counts: Option<Vec<u64>> =
        arguments(text, "columns").split_ascii_whitespace().map(|word| word.parse().ok()).collect();
    let sound = match counts.as_deref() {
        Some(&[nx, nz]) => check::grid(nx, nz),
        _ => None,
    };
    let Some((nx, nz)) = sound else {
        return Err(Problem::new(lines.place(), quote(text), check::grid_expected()).into());
    };
    believable((nx * nz) as u64, "rows of columns", SHORTEST_COLUMN, file_bytes, lines.place())?;
    lines.advance()?;
    Ok((nx, nz))
}

/// `particles n`.
fn particle_count<R: BufRead>(lines: &mut Lines<R>, file_bytes: u64) -> Result<usize, Stop> {
    keyword(lines, "particles", "n")?;
    let text = lines.text().unwrap_or_default();
    let count = match arguments(text, "particles").parse::<u64>() {
        Ok(count) if count <= check::MAX_ROWS => count,
        _ => {
            let expected = format!("the number of particles, from 0 to {}", check::MAX_ROWS);
            return Err(Problem::new(lines.place(), quote(text), expected).into());
        }
    };
    believable(count, "rows of particles", SHORTEST_PARTICLE, file_bytes, lines.place())?;
    lines.advance()?;
    Ok(count as usize)
}

/// Refuses a count that the whole file is too small for, before anything is reserved for it.
fn believable(count: u64, what: &str, shortest: u64, file_bytes: u64, place: Place) -> Result<(), Stop> {
    // The last line may lack its line feed.
    let most = (file_bytes + 1) / shortest;
    if count <= most {
        return Ok(());
    }
    let found = format!("{count} {what}");
    Err(Problem::new(place, found, format!("at most {most}: the file has only {file_bytes} bytes")).into())
}

/// Takes `count` rows. Every bad row is noted; missing and surplus rows are each noted once.
fn rows<const N: usize, R: BufRead>(
    lines: &mut Lines<R>,
    count: usize,
    what: &str,
    names: &[&str; N],
    problems: &mut Problems,
    mut take: impl FnMut([f64; N], &dyn Fn() -> Place, &mut Problems),
) -> Result<(), Stop> {
    let section_over = |word: &str| word == "particles" || word == "end";
    for row in 0..count {
        let expected = || format!("row {} of {count} of the {what}: {}", row + 1, names.join(" "));
        let Some(text) = lines.text() else { return Err(lines.unexpected(expected()).into()) };
        if lines.keyword().is_some_and(section_over) {
            problems.note(|| lines.unexpected(expected()));
            return Ok(());
        }
        match numbers(text, names) {
            Ok(values) => take(values, &|| lines.place(), problems),
            Err((found, expected)) => problems.note(|| Problem::new(lines.place(), found, expected)),
        }
        lines.advance()?;
    }
    // Rows too many: the first is named, the rest passed over, so that the next section is still read.
    let starts_like_a_number =
        |word: &str| word.starts_with(|c: char| c.is_ascii_digit() || matches!(c, '-' | '+' | '.'));
    if lines.keyword().is_some_and(starts_like_a_number) {
        let (first, place) = (lines.text().map(quote).unwrap_or_default(), lines.place());
        let mut surplus = 0_u64;
        while lines.keyword().is_some_and(starts_like_a_number) {
            surplus += 1;
            lines.advance()?;
        }
        problems.note(|| {
            let plural = if surplus == 1 { "" } else { "s" };
            let found = format!("{surplus} row{plural} too many, from {first} on");
            Problem::new(place, found, format!("the {what} to end after {count} rows"))
        });
    }
    Ok(())
}

/// Writes a frame as text. Every number reads back to the same bits; identities and extra arrays have no place in text.
///
/// # Errors
/// A value that the reader would refuse, or what the writer says.
///
/// # Panics
/// If the frame's arrays differ in length.
pub fn write_frame_text(frame: &Frame, mut writer: impl Write) -> Result<(), StateError> {
    check::writable(frame).map_err(StateError::Unwritable)?;
    let Columns { origin, width, nx, nz, base, top, pressure, flow } = &frame.columns;
    let w = &mut writer;
    writeln!(w, "{MAGIC} 1")?;
    line(w, "time", &[frame.time])?;
    line(w, "origin", origin)?;
    line(w, "width", width)?;
    writeln!(w, "columns {nx} {nz}")?;
    for i in 0..base.len() {
        line(w, "", &[base[i], top[i], pressure[i], flow[i][0], flow[i][1]])?;
    }
    let Particles { position, velocity, mass, age, id: _ } = &frame.particles;
    writeln!(w, "particles {}", position.len())?;
    for i in 0..position.len() {
        let ([x, y, z], [vx, vy, vz]) = (position[i], velocity[i]);
        line(w, "", &[x, y, z, vx, vy, vz, mass[i], age[i]])?;
    }
    writeln!(w, "end")?;
    w.flush()?;
    Ok(())
}

/// One line: a keyword, or none, and numbers.
pub(super) fn line(w: &mut impl Write, keyword: &str, values: &[f64]) -> std::io::Result<()> {
    let mut separator = if keyword.is_empty() { "" } else { " " };
    w.write_all(keyword.as_bytes())?;
    for &value in values {
        w.write_all(separator.as_bytes())?;
        number(w, value)?;
        separator = " ";
    }
    w.write_all(b"\n")
}

/// The shortest decimal that reads back to the same double; with an exponent where plain digits would be mostly zeros.
fn number(w: &mut impl Write, value: f64) -> std::io::Result<()> {
    let plain = value == 0.0 || (1e-5..1e16).contains(&value.abs());
    if plain { write!(w, "{value}") } else { write!(w, "{value:e}") }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    /// 3 x 3 columns, of which two hold water, and one particle.
    pub(in crate::state) const GOOD: &str = "\
whitewater-frame 1
# a comment
time     0.28          # s
origin   -3.0 12.5
width    0.25 0.5
columns  3 3
0 0 0 0 0
0 0.5 10 1 -1
0 0 0 0 0
1 1 0 0 0
1 1.25 0 0 0
1 1 0 0 0
2 2 0 0 0
2 1.9995 0 0 0
2 2 0 0 -0
particles 1
1 2 3  -4 5e-1 .5  0.5 0
end
";

    fn parse(text: &str) -> Result<Frame, StateError> {
        let mut problems = Problems::default();
        let frame = read(text.as_bytes(), text.len() as u64, 0.001, &mut problems);
        problems.settle(Path::new("f"), frame)
    }

    /// The problems of GOOD with one passage replaced.
    fn damage(from: &str, to: &str) -> Vec<String> {
        assert!(GOOD.contains(from), "{from}");
        match parse(&GOOD.replacen(from, to, 1)) {
            Err(StateError::Damaged { problems, .. }) => problems.iter().map(ToString::to_string).collect(),
            other => panic!("{from} -> {to}: {other:?}"),
        }
    }

    #[test]
    fn reads_every_field_in_its_place() {
        let frame = parse(GOOD).unwrap();
        assert_eq!(frame.time, 0.28);
        let columns = &frame.columns;
        assert_eq!((columns.origin, columns.width, columns.nx, columns.nz), ([-3.0, 12.5], [0.25, 0.5], 3, 3));
        assert_eq!(columns.base, [0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 2.0, 2.0, 2.0]);
        assert_eq!((columns.top[1], columns.pressure[1], columns.flow[1]), (0.5, 10.0, [1.0, -1.0]));
        let particles = &frame.particles;
        assert_eq!((particles.position[0], particles.velocity[0]), ([1.0, 2.0, 3.0], [-4.0, 0.5, 0.5]));
        assert_eq!((particles.mass[0], particles.age[0], &particles.id), (0.5, 0.0, &None));
    }

    #[test]
    fn a_size_that_the_file_cannot_hold_stops_at_once() {
        assert_eq!(
            damage("columns  3 3", "columns  2147483648 3"),
            [
                "line 6: `columns  2147483648 3`; expected nx nz, whole numbers of at least 3, at most 268435456 columns together"
            ]
        );
        let found = &damage("columns  3 3", "columns 10000 10000")[0];
        assert!(found.starts_with("line 6: 100000000 rows of columns; expected at most "), "{found}");
        let found = &damage("particles 1", "particles 18446744073709551615")[0];
        assert!(found.starts_with("line 16: `particles 18446744073709551615`"), "{found}");
        let found = &damage("particles 1", "particles 200000000")[0];
        assert!(found.starts_with("line 16: 200000000 rows of particles"), "{found}");
    }

    #[test]
    fn several_bad_rows_are_all_listed() {
        let text = GOOD
            .replace("0 0.5 10 1 -1", "0 nan 10 1 -1")
            .replace("1 1.25 0 0 0", "1 0.5 0 0 0")
            .replace("0.5 0\nend", "-0.5 0\nend");
        let Err(StateError::Damaged { problems, more: 0, .. }) = parse(&text) else { panic!() };
        let places: Vec<_> = problems.iter().map(|p| p.place.clone()).collect();
        assert_eq!(places, [Place::Line(8), Place::Line(11), Place::Line(17)]);
    }

    #[test]
    fn missing_and_surplus_rows_are_named_and_the_next_section_is_still_read() {
        let found = damage("2 2 0 0 -0\nparticles 1\n1 2 3", "particles 1\nnan 2 3");
        assert_eq!(
            found[0],
            "line 15: found `particles 1`; expected row 9 of 9 of the columns: base top pressure flow_x flow_z"
        );
        assert_eq!(found[1], "line 16: x = `nan`; expected a finite number");
        let found = damage("2 2 0 0 -0\n", "2 2 0 0 -0\n7 7 0 0 0\n8 8 0 0 0\n");
        assert_eq!(found, ["line 16: 2 rows too many, from `7 7 0 0 0` on; expected the columns to end after 9 rows"]);
        let found = damage("end\n", "1 1 1 0 0 0 1 1\nend\n");
        assert!(found[0].starts_with("line 18: 1 row too many"), "{found:?}");
    }

    #[test]
    fn numbers_are_written_short_and_exact() {
        let shown = |value| {
            let mut out = Vec::new();
            number(&mut out, value).unwrap();
            String::from_utf8(out).unwrap()
        };
        assert_eq!([shown(0.1), shown(-0.0), shown(1e300), shown(5e-324)], ["0.1", "-0", "1e300", "5e-324"]);
        for value in [0.1 + 0.2, 1e-5, 9.999e-6, 1e16, -123456789.123, f64::MAX, f64::MIN_POSITIVE, 0.1_f32 as f64] {
            assert_eq!(shown(value).parse::<f64>().unwrap().to_bits(), value.to_bits());
        }
    }
}
