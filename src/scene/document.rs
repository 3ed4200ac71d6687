//! TOML text → a tree of values that remember where they were written.
//!
//! The parser recovers from syntax errors, so that all of them, and the wrong values around them, are reported at once.
//! What a key may hold is not known here (see `shape`).

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

use toml::de::{DeTable, DeValue};

use super::errors::{Place, SceneError, SceneErrors};

/// A value and where it was written.
#[derive(Clone, Debug)]
pub(super) struct Node {
    pub(super) place: Place,
    /// The value as written, shortened.
    pub(super) shown: String,
    pub(super) data: Data,
}

/// What was written, before anything is known of what belongs there.
#[derive(Clone, Debug)]
pub(super) enum Data {
    Text(String),
    /// TOML promises 64 bits; what exceeds even 128 is kept as a float and is out of range everywhere.
    Integer(i128),
    Float(f64),
    Boolean(bool),
    Datetime,
    Array(Vec<Node>),
    Table(BTreeMap<String, Entry>),
}

/// A key of a table, which has a place of its own.
#[derive(Clone, Debug)]
pub(super) struct Entry {
    pub(super) key_place: Place,
    pub(super) node: Node,
}

impl Node {
    /// The node at a dotted path, with array entries by index.
    pub(super) fn find(&self, path: &str) -> Option<&Node> {
        path.split('.').try_fold(self, |node, segment| match &node.data {
            Data::Table(entries) => entries.get(segment).map(|entry| &entry.node),
            Data::Array(items) => items.get(segment.parse::<usize>().ok()?),
            _ => None,
        })
    }

    /// The place of the deepest part of a dotted path that was written at all.
    pub(super) fn place_of(&self, path: &str) -> &Place {
        let mut rest = path;
        loop {
            if let Some(node) = self.find(rest) {
                return &node.place;
            }
            match rest.rfind('.') {
                Some(end) => rest = &rest[..end],
                None => return &self.place,
            }
        }
    }
}

/// Reads a whole file's text: its root table and its syntax errors (the first hundred).
pub(super) fn parse(file: &Path, text: &str) -> (Node, Vec<SceneError>) {
    let source = Source { text, lines: Lines::new(text), file: Arc::from(file) };
    let (root, errors) = DeTable::parse_recoverable(text);
    let errors = errors
        .into_iter()
        .take(SceneErrors::MOST)
        .map(|error| {
            let span = error.span().unwrap_or(0..0);
            let shown = source.shown(span.clone());
            let message = match error.message() {
                "duplicate key" => format!("the key `{shown}` is given twice"),
                // Any bare word that begins with t or f: more likely a string without quotes than a misspelt boolean.
                message if message.starts_with("invalid boolean") => {
                    "not TOML: string values must be quoted, and booleans are true or false".to_owned()
                }
                message => format!("not TOML: {}", message.trim_end_matches(", expected nothing")),
            };
            SceneError::Syntax { place: source.place(span.start), message }
        })
        .collect();
    let data = convert_table(root.into_inner(), &|offset| source.place(offset), &|span| source.shown(span));
    (Node { place: source.place(0), shown: String::new(), data }, errors)
}

/// Reads one value typed on a command line; `None` if it is not TOML.
pub(super) fn parse_value(place: &Place, text: &str) -> Option<Node> {
    let value = DeValue::parse(text).ok()?;
    Some(convert(value.into_inner(), 0..text.len(), &|_| place.clone(), &|span| shorten(&text[span])))
}

fn convert(
    value: DeValue<'_>,
    span: Range<usize>,
    place: &dyn Fn(usize) -> Place,
    shown: &dyn Fn(Range<usize>) -> String,
) -> Node {
    let data = match value {
        DeValue::String(text) => Data::Text(text.into_owned()),
        DeValue::Integer(integer) => match i128::from_str_radix(integer.as_str(), integer.radix()) {
            Ok(integer) => Data::Integer(integer),
            Err(_) => Data::Float(f64::INFINITY),
        },
        // The parser only lets through what Rust's own parser takes; after a syntax error there may be anything.
        DeValue::Float(float) => Data::Float(float.as_str().parse().unwrap_or(f64::NAN)),
        DeValue::Boolean(boolean) => Data::Boolean(boolean),
        DeValue::Datetime(_) => Data::Datetime,
        DeValue::Array(array) => Data::Array(
            array
                .into_iter()
                .map(|item| {
                    let span = item.span();
                    convert(item.into_inner(), span, place, shown)
                })
                .collect(),
        ),
        DeValue::Table(table) => convert_table(table, place, shown),
    };
    Node { place: place(span.start), shown: shown(span), data }
}

fn convert_table(table: DeTable<'_>, place: &dyn Fn(usize) -> Place, shown: &dyn Fn(Range<usize>) -> String) -> Data {
    let entries = table.into_iter().map(|(key, value)| {
        let key_place = place(key.span().start);
        let span = value.span();
        let node = convert(value.into_inner(), span, place, shown);
        (key.into_inner().into_owned(), Entry { key_place, node })
    });
    Data::Table(entries.collect())
}

struct Source<'a> {
    text: &'a str,
    lines: Lines,
    file: Arc<Path>,
}

impl Source<'_> {
    fn place(&self, offset: usize) -> Place {
        let (line, column) = self.lines.locate(self.text, offset);
        Place::File { file: self.file.clone(), line, column }
    }

    fn shown(&self, span: Range<usize>) -> String {
        shorten(self.text.get(span).unwrap_or_default())
    }
}

/// One line of at most forty characters.
pub(super) fn shorten(text: &str) -> String {
    const MOST: usize = 40;
    let line = text.trim().lines().next().unwrap_or_default();
    if line.len() == text.trim().len() && line.chars().count() <= MOST {
        line.to_owned()
    } else {
        line.chars().take(MOST).chain("...".chars()).collect()
    }
}

/// Byte offset → line and column, without walking a long line for each of its values.
struct Lines {
    starts: Vec<usize>,
    /// Characters before every `STEP`th byte.
    characters: Vec<usize>,
}

impl Lines {
    const STEP: usize = 1024;

    fn new(text: &str) -> Self {
        let mut starts = vec![if text.starts_with('\u{feff}') { '\u{feff}'.len_utf8() } else { 0 }];
        let mut characters = vec![0];
        let mut count = 0;
        for (offset, byte) in text.bytes().enumerate() {
            if offset > 0 && offset % Self::STEP == 0 {
                characters.push(count);
            }
            count += usize::from(starts_character(byte));
            if byte == b'\n' {
                starts.push(offset + 1);
            }
        }
        Self { starts, characters }
    }

    fn locate(&self, text: &str, offset: usize) -> (u32, u32) {
        let offset = offset.min(text.len());
        let line = self.starts.partition_point(|start| *start <= offset).max(1);
        let start = self.starts[line - 1].min(offset);
        (number(line), number(self.count(text, offset) - self.count(text, start) + 1))
    }

    fn count(&self, text: &str, offset: usize) -> usize {
        let step = (offset / Self::STEP).min(self.characters.len() - 1);
        let rest = &text.as_bytes()[step * Self::STEP..offset];
        self.characters[step] + rest.iter().filter(|byte| starts_character(**byte)).count()
    }
}

/// Lines and columns of a text that is never larger than a scene file may be.
fn number(count: usize) -> u32 {
    u32::try_from(count).unwrap_or(u32::MAX)
}

fn starts_character(byte: u8) -> bool {
    byte & 0b1100_0000 != 0b1000_0000
}

/// Line and column (from 1, in bytes of valid text before it) of the byte at which UTF-8 ends.
pub(super) fn locate_byte(bytes: &[u8], offset: usize) -> (u32, u32) {
    let before = &bytes[..offset];
    let start = before.iter().rposition(|byte| *byte == b'\n').map_or(0, |newline| newline + 1);
    let line = before.iter().filter(|byte| **byte == b'\n').count() + 1;
    (number(line), number(before[start..].iter().filter(|byte| starts_character(**byte)).count() + 1))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_count_characters_however_long_the_line() {
        for length in [0, 1, 1022, 1023, 1024, 1025, 2048, 5000] {
            let text = format!("first\n{}x", "é".repeat(length));
            let lines = Lines::new(&text);
            assert_eq!(lines.locate(&text, text.len() - 1), (2, number(length + 1)));
            assert_eq!(lines.locate(&text, text.len()), (2, number(length + 2)));
        }
        let text = "\u{feff}a = 1";
        assert_eq!(Lines::new(text).locate(text, 3), (1, 1), "a byte order mark is no column");
    }

    #[test]
    fn values_know_their_places_in_every_kind_of_table() {
        let text = "a.b = 1\n[c]\nd = { e = [2,\n  3.5] }\n[[f]]\ng = true\n[[f]]\ng = 'x'\n";
        let (root, errors) = parse(Path::new("scene.toml"), text);
        assert!(errors.is_empty());
        let place = |path: &str| root.find(path).unwrap_or_else(|| panic!("{path}")).place.to_string();
        assert_eq!(place("a.b"), "scene.toml:1:7");
        assert_eq!(place("c.d.e.0"), "scene.toml:3:12");
        assert_eq!(place("c.d.e.1"), "scene.toml:4:3");
        assert_eq!(place("f.1.g"), "scene.toml:8:5");
        assert_eq!(root.place_of("f.0.nothing").to_string(), "scene.toml:5:1");
        assert_eq!(root.place_of("nothing").to_string(), "scene.toml:1:1");
    }
}
