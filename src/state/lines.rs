//! The lines of a text file, without comments and blanks: what frames and models have in common as text.
//!
//! Reads as it goes, so that a file which lies about its size costs no more than what it really holds.

use std::io::{BufRead, Read};

use super::error::{Place, Problem, Stop, quote};

/// The longest line taken (bytes, with its comment). A row is below 3 kB at its longest; what goes past this is no text.
const LONGEST: u64 = 65536;

/// A cursor on the lines that say something. The current line stays until [`Lines::advance`] leaves it.
pub(super) struct Lines<R> {
    reader: R,
    buffer: Vec<u8>,
    /// The current line's content in `buffer`, or `None` past the end.
    content: Option<(usize, usize)>,
    number: u64,
}

impl<R: BufRead> Lines<R> {
    /// Stands on the first line that says something.
    pub(super) fn new(reader: R) -> Result<Lines<R>, Stop> {
        let mut lines = Lines { reader, buffer: Vec::new(), content: None, number: 0 };
        lines.advance()?;
        Ok(lines)
    }

    /// Goes to the next line that says something.
    pub(super) fn advance(&mut self) -> Result<(), Stop> {
        loop {
            self.buffer.clear();
            self.content = None;
            let read = (&mut self.reader).take(LONGEST + 1).read_until(b'\n', &mut self.buffer)?;
            if read == 0 {
                return Ok(());
            }
            self.number += 1;
            if self.buffer.len() as u64 > LONGEST {
                let found = format!("a line of more than {LONGEST} bytes");
                return Err(Problem::new(self.place(), found, "lines of text").into());
            }
            let end = self.buffer.iter().position(|&byte| byte == b'#').unwrap_or(self.buffer.len());
            let said = &self.buffer[..end];
            let start = end - said.trim_ascii_start().len();
            let end = start + said.trim_ascii().len();
            if start == end {
                continue;
            }
            if let Err(error) = std::str::from_utf8(&self.buffer[start..end]) {
                let byte = self.buffer[start + error.valid_up_to()];
                return Err(Problem::new(self.place(), format!("the byte 0x{byte:02x}"), "text").into());
            }
            self.content = Some((start, end));
            return Ok(());
        }
    }

    /// The current line without comment and outer blanks, or `None` past the last.
    pub(super) fn text(&self) -> Option<&str> {
        let (start, end) = self.content?;
        Some(std::str::from_utf8(&self.buffer[start..end]).expect("advance has checked this line"))
    }

    /// The current line's first word.
    pub(super) fn keyword(&self) -> Option<&str> {
        self.text()?.split_ascii_whitespace().next()
    }

    /// Where the cursor stands; past the end, the last line.
    pub(super) fn place(&self) -> Place {
        Place::Line(self.number)
    }

    /// That something else stands here.
    pub(super) fn unexpected(&self, expected: impl Into<String>) -> Problem {
        let found =
            self.text().map_or_else(|| "the file ends here".to_string(), |text| format!("found {}", quote(text)));
        Problem::new(self.place(), found, expected)
    }

    /// Takes the opening line of a file: its kind and version 1.
    pub(super) fn magic(&mut self, kind: &str) -> Result<(), Stop> {
        let expected = format!("`{kind} 1`");
        let mut words = self.text().unwrap_or_default().split_ascii_whitespace();
        match (words.next(), words.next(), words.next()) {
            (Some(word), Some("1"), None) if word == kind => self.advance(),
            (Some(word), Some(version), None) if word == kind => {
                Err(Problem::new(self.place(), format!("version {}", quote(version)), expected).into())
            }
            _ => Err(self.unexpected(expected).into()),
        }
    }

    /// Takes the closing `end` and checks that nothing follows it.
    pub(super) fn end(&mut self) -> Result<(), Stop> {
        if self.text() != Some("end") {
            return Err(self.unexpected("`end`").into());
        }
        self.advance()?;
        match self.text() {
            None => Ok(()),
            Some(_) => Err(self.unexpected("nothing after `end`").into()),
        }
    }
}

/// Exactly `N` finite numbers, or what was found and expected instead.
pub(super) fn numbers<const N: usize>(text: &str, names: &[&str; N]) -> Result<[f64; N], (String, String)> {
    let mut values = [0.0; N];
    let mut words = text.split_ascii_whitespace();
    for i in 0..N {
        let Some(word) = words.next() else { return Err(wrong_count(text, names)) };
        values[i] = match word.parse::<f64>() {
            Ok(value) if value.is_finite() => value,
            Ok(_) => return Err((format!("{} = {}", names[i], quote(word)), "a finite number".to_string())),
            Err(_) => return Err((format!("{} = {}", names[i], quote(word)), "a number".to_string())),
        };
    }
    if words.next().is_some() {
        return Err(wrong_count(text, names));
    }
    Ok(values)
}

fn wrong_count<const N: usize>(text: &str, names: &[&str; N]) -> (String, String) {
    let count = text.split_ascii_whitespace().count();
    let plural = |n: usize| if n == 1 { "" } else { "s" };
    (
        format!("{count} number{} in {}", plural(count), quote(text)),
        format!("{N} number{}: {}", plural(N), names.join(" ")),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all(bytes: &[u8]) -> Vec<(Place, String)> {
        let mut lines = Lines::new(bytes).unwrap();
        let mut out = Vec::new();
        while let Some(text) = lines.text() {
            out.push((lines.place(), text.to_string()));
            lines.advance().unwrap();
        }
        out
    }

    #[test]
    fn comments_blank_lines_and_carriage_returns_say_nothing() {
        let lines = all(b"# caf\xe9\r\n\r\n  time 1 # s\r\n\tend");
        assert_eq!(lines, [(Place::Line(3), "time 1".to_string()), (Place::Line(4), "end".to_string())]);
    }

    #[test]
    fn a_line_without_an_end_is_given_up_before_it_is_read_whole() {
        let endless = std::io::BufReader::new(std::io::repeat(b'x'));
        let Err(Stop::Damage(problem)) = Lines::new(endless) else { panic!("accepted an endless line") };
        assert_eq!(problem.place, Place::Line(1));
    }

    #[test]
    fn bytes_that_are_not_text_are_named_by_line() {
        let Err(Stop::Damage(problem)) = Lines::new(&b"\n\n12 \xff\n"[..]) else { panic!("accepted 0xff") };
        assert_eq!((&problem.place, problem.found.as_str()), (&Place::Line(3), "the byte 0xff"));
    }

    #[test]
    fn numbers_name_the_field_that_is_wrong() {
        assert_eq!(numbers("1 -2.5e3", &["x", "z"]), Ok([1.0, -2500.0]));
        assert_eq!(numbers("1 inf", &["x", "z"]).unwrap_err().0, "z = `inf`");
        assert_eq!(numbers("1 1e999", &["x", "z"]).unwrap_err().1, "a finite number");
        assert_eq!(numbers("1 2 3", &["x", "z"]).unwrap_err().1, "2 numbers: x z");
        assert_eq!(numbers("1,5 2", &["x", "z"]).unwrap_err(), ("x = `1,5`".into(), "a number".into()));
    }
}
