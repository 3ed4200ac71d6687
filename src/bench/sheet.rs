//! Where figures go as they are measured: the terminal, rows in files, and tables to paste into documents.

use std::io::Write;
use std::path::{Path, PathBuf};

use super::rows::{Row, Rows};
use super::{BenchError, Settings};

/// A benchmark's output.
pub struct Sheet<'a> {
    out: &'a mut dyn Write,
    rows: Rows,
    markdown: Option<(PathBuf, String)>,
    widths: Vec<usize>,
}

impl<'a> Sheet<'a> {
    /// Opens the files, and says on which machine it runs.
    ///
    /// # Errors
    /// A file cannot be made.
    pub fn new(settings: &Settings, out: &'a mut dyn Write) -> Result<Self, BenchError> {
        let rows = Rows::new(settings.csv.as_deref(), settings.json.as_deref())?;
        let machine = format!("{}; {} thread(s)", rows.machine(), settings.threads);
        let markdown = settings.markdown.clone().map(|path| (path, String::new()));
        let mut sheet = Self { out, rows, markdown, widths: Vec::new() };
        sheet.say(&machine)?;
        Ok(sheet)
    }

    /// A paragraph.
    ///
    /// # Errors
    /// A file, or the terminal.
    pub fn say(&mut self, text: &str) -> Result<(), BenchError> {
        writeln!(self.out, "{text}")?;
        self.out.flush()?;
        self.write(&format!("\n{text}\n"))
    }

    /// The heads of a table's columns; the first is the widest and stands to the left.
    ///
    /// # Errors
    /// A file, or the terminal.
    pub fn table(&mut self, heads: &[&str]) -> Result<(), BenchError> {
        self.widths =
            heads.iter().enumerate().map(|(k, head)| if k == 0 { 36 } else { head.len().max(7) + 2 }).collect();
        let cells: Vec<String> = heads.iter().map(|head| (*head).to_owned()).collect();
        writeln!(self.out)?;
        self.line(&cells)?;
        let rule: String = (0..heads.len()).map(|k| if k == 0 { "|---|" } else { "---:|" }).collect();
        self.write(&format!("\n{}{rule}\n", bars(&cells)))
    }

    /// A line of the table and the row that it shows part of.
    ///
    /// # Errors
    /// A file, or the terminal.
    pub fn row(&mut self, cells: &[String], row: Row) -> Result<(), BenchError> {
        self.line(cells)?;
        self.write(&bars(cells))?;
        self.rows.push(row)
    }

    /// Draws all rows so far, where a folder for plots was named.
    ///
    /// # Errors
    /// A file.
    pub(super) fn plot(
        &mut self,
        settings: &Settings,
        draw: fn(&[Row], &Path) -> Result<(), BenchError>,
    ) -> Result<(), BenchError> {
        settings.plot.as_deref().map_or(Ok(()), |directory| draw(self.rows.all(), directory))
    }

    /// All rows so far.
    pub fn rows(&self) -> &[Row] {
        self.rows.all()
    }

    fn line(&mut self, cells: &[String]) -> Result<(), BenchError> {
        for (k, (cell, &width)) in cells.iter().zip(&self.widths).enumerate() {
            if k == 0 { write!(self.out, "{cell:<width$}")? } else { write!(self.out, "{cell:>width$}")? }
        }
        writeln!(self.out)?;
        Ok(self.out.flush()?)
    }

    fn write(&mut self, text: &str) -> Result<(), BenchError> {
        let Some((path, all)) = &mut self.markdown else { return Ok(()) };
        all.push_str(text);
        std::fs::write(&path, all.trim_start()).map_err(|source| BenchError::file(path, source))
    }
}

fn bars(cells: &[String]) -> String {
    format!("| {} |\n", cells.join(" | "))
}

/// A number in a table: three digits or more, without a tail of zeros.
pub fn number(value: f64) -> String {
    match value.abs() {
        0.0 => "0".to_owned(),
        size if !(1e-2..1e6).contains(&size) => format!("{value:.1e}"),
        size if size >= 100.0 => format!("{value:.0}"),
        size if size >= 10.0 => format!("{value:.1}"),
        size if size >= 1.0 => format!("{value:.2}"),
        _ => format!("{value:.3}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_go_to_the_terminal_and_to_a_document() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("table.md");
        let settings = Settings { markdown: Some(path.clone()), ..Settings::default() };
        let mut out = Vec::new();
        let mut sheet = Sheet::new(&settings, &mut out).unwrap();
        sheet.table(&["what", "value"]).unwrap();
        sheet.row(&["a".to_owned(), number(0.5)], Row::default()).unwrap();
        assert_eq!(sheet.rows().len(), 1);
        let text = String::from_utf8(out).unwrap();
        assert!(text.ends_with(&format!("a{:35}    0.500\n", "")), "{text}");
        let document = std::fs::read_to_string(path).unwrap();
        assert!(document.ends_with("\n\n| what | value |\n|---|---:|\n| a | 0.500 |\n"), "{document}");
    }

    #[test]
    fn numbers_keep_three_digits() {
        for (value, text) in [(0.0, "0"), (1234.5, "1234"), (12.34, "12.3"), (0.0123, "0.012"), (1.5e-7, "1.5e-7")] {
            assert_eq!(number(value), text);
        }
    }
}
