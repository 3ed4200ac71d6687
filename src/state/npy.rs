//! The header of one `.npy` array: its type, order and shape.
//!
//! npyz writes our archives; it does not read them, because in 0.9 it multiplies the shape out unchecked (a panic, or a
//! wrapped size) and its parser for Python literals takes exponential time and unbounded stack on nested brackets, so
//! that a file which lies could stop the program. This reader takes exactly what numpy writes, in one pass.
//! Source: NumPy Enhancement Proposal 1, and `numpy.lib.format`.

use std::io::{self, Read};

/// The longest header taken (bytes): the limit that numpy's own reader sets.
const LONGEST: usize = 10_000;

/// What the header says.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Header {
    /// numpy's type string, as `<f4`; of a structured type, the Python list as written.
    pub dtype: String,
    /// Whether the first index runs fastest.
    pub fortran_order: bool,
    /// Length along each axis; empty for a single value.
    pub shape: Vec<u64>,
    /// Bytes of the header itself: where the elements start.
    pub bytes: u64,
}

impl Header {
    /// Reads a header and leaves the reader on the first element.
    ///
    /// # Errors
    /// What the system says; `InvalidData` with the reason for a header that is not numpy's.
    pub(super) fn read(reader: &mut impl Read) -> io::Result<Header> {
        let mut start = [0_u8; 8];
        reader.read_exact(&mut start).map_err(short)?;
        if &start[..6] != b"\x93NUMPY" {
            return Err(invalid("does not start as a numpy array"));
        }
        let length = match start[6] {
            1 => {
                let mut bytes = [0_u8; 2];
                reader.read_exact(&mut bytes).map_err(short)?;
                u32::from(u16::from_le_bytes(bytes))
            }
            2 | 3 => {
                let mut bytes = [0_u8; 4];
                reader.read_exact(&mut bytes).map_err(short)?;
                u32::from_le_bytes(bytes)
            }
            version => return Err(invalid(format!("numpy array format {version}, known are 1 to 3"))),
        };
        let length = length as usize;
        if length > LONGEST {
            return Err(invalid(format!("a header of {length} bytes, at most {LONGEST} are taken")));
        }
        let mut text = vec![0_u8; length];
        reader.read_exact(&mut text).map_err(short)?;
        let text = std::str::from_utf8(&text).map_err(|_| invalid("a header that is not text"))?;
        let (dtype, fortran_order, shape) = Literal { text }.dictionary().map_err(invalid)?;
        let before = if start[6] == 1 { 10 } else { 12 };
        Ok(Header { dtype, fortran_order, shape, bytes: (before + length) as u64 })
    }

    /// Number of elements, unless it exceeds 64 bits.
    pub(super) fn count(&self) -> Option<u64> {
        // A zero anywhere makes the array empty, however long the other axes claim to be.
        if self.shape.contains(&0) {
            return Some(0);
        }
        self.shape.iter().try_fold(1_u64, |count, &length| count.checked_mul(length))
    }
}

/// The shape as Python shows it: `()`, `(2,)`, `(3, 4)`.
pub(super) fn show_shape(shape: &[u64]) -> String {
    match shape {
        [one] => format!("({one},)"),
        _ => format!("({})", shape.iter().map(u64::to_string).collect::<Vec<_>>().join(", ")),
    }
}

fn invalid(reason: impl Into<String>) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, reason.into())
}

fn short(error: io::Error) -> io::Error {
    match error.kind() {
        io::ErrorKind::UnexpectedEof => invalid("ends within its header"),
        _ => error,
    }
}

/// What is left of the Python dictionary that describes the array.
struct Literal<'a> {
    text: &'a str,
}

impl<'a> Literal<'a> {
    /// `{'descr': …, 'fortran_order': …, 'shape': …}` in any order, each once, and nothing after.
    fn dictionary(mut self) -> Result<(String, bool, Vec<u64>), String> {
        let (mut dtype, mut fortran_order, mut shape) = (None, None, None);
        self.token("{")?;
        while !self.taken("}") {
            let key = self.string()?;
            self.token(":")?;
            let fresh = match key {
                "descr" if self.upcoming("[") => dtype.replace(self.bracketed()?.to_string()).is_none(),
                "descr" => dtype.replace(self.string()?.to_string()).is_none(),
                "fortran_order" => fortran_order.replace(self.boolean()?).is_none(),
                "shape" => shape.replace(self.tuple()?).is_none(),
                _ => false,
            };
            if !fresh {
                return Err(format!("an unknown or repeated key {key:?} in its header"));
            }
            if !self.taken(",") && !self.upcoming("}") {
                return Err(self.expected(","));
            }
        }
        if !self.text.trim_ascii().is_empty() {
            return Err(self.expected("the header's end"));
        }
        match (dtype, fortran_order, shape) {
            (Some(dtype), Some(fortran_order), Some(shape)) => Ok((dtype, fortran_order, shape)),
            _ => Err("a header without 'descr', 'fortran_order' or 'shape'".to_string()),
        }
    }

    fn upcoming(&mut self, token: &str) -> bool {
        self.text = self.text.trim_ascii_start();
        self.text.starts_with(token)
    }

    fn taken(&mut self, token: &str) -> bool {
        let here = self.upcoming(token);
        if here {
            self.text = &self.text[token.len()..];
        }
        here
    }

    fn token(&mut self, token: &str) -> Result<(), String> {
        if self.taken(token) { Ok(()) } else { Err(self.expected(token)) }
    }

    fn expected(&self, what: &str) -> String {
        let rest: String = self.text.chars().take(20).collect();
        format!("a header with {rest:?} where there should be {what}")
    }

    /// A quoted string. numpy's keys and types hold no escapes.
    fn string(&mut self) -> Result<&'a str, String> {
        let quote = if self.upcoming("\"") { "\"" } else { "'" };
        self.token(quote)?;
        let (string, rest) = self.text.split_once(quote).ok_or_else(|| self.expected("a closed string"))?;
        self.text = rest;
        Ok(string)
    }

    /// A list with all that it holds, as written.
    fn bracketed(&mut self) -> Result<&'a str, String> {
        let mut depth = 0_usize;
        let mut within: Option<char> = None;
        for (i, c) in self.text.char_indices() {
            match (within, c) {
                (Some(quote), _) if c == quote => within = None,
                (Some(_), _) => {}
                (None, '\'' | '"') => within = Some(c),
                (None, '[' | '(') => depth += 1,
                (None, ']' | ')') => {
                    depth = depth.saturating_sub(1);
                    if depth == 0 {
                        let (list, rest) = self.text.split_at(i + 1);
                        self.text = rest;
                        return Ok(list);
                    }
                }
                _ => {}
            }
        }
        Err(self.expected("a closed list"))
    }

    fn boolean(&mut self) -> Result<bool, String> {
        match (self.taken("True"), self.taken("False")) {
            (true, false) => Ok(true),
            (false, true) => Ok(false),
            _ => Err(self.expected("True or False")),
        }
    }

    fn tuple(&mut self) -> Result<Vec<u64>, String> {
        let mut shape = Vec::new();
        self.token("(")?;
        while !self.taken(")") {
            self.text = self.text.trim_ascii_start();
            let digits = self.text.find(|c: char| !c.is_ascii_digit()).unwrap_or(self.text.len());
            let length = self.text[..digits].parse().map_err(|_| self.expected("a length of 64 bits"))?;
            shape.push(length);
            self.text = &self.text[digits..];
            if !self.taken(",") && !self.upcoming(")") {
                return Err(self.expected(","));
            }
        }
        Ok(shape)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> io::Result<Header> {
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend((text.len() as u16).to_le_bytes());
        bytes.extend(text.as_bytes());
        Header::read(&mut bytes.as_slice())
    }

    #[test]
    fn takes_what_numpy_writes() {
        let header = read("{'descr': '<f4', 'fortran_order': False, 'shape': (3, 4), }          \n").unwrap();
        assert_eq!((header.dtype.as_str(), header.fortran_order, header.shape), ("<f4", false, vec![3, 4]));
        assert_eq!(read("{'descr': '>f8', 'fortran_order': True, 'shape': (), }\n").unwrap().shape, [0_u64; 0]);
        assert_eq!(read("{'descr': '<f8', 'fortran_order': False, 'shape': (7,)}").unwrap().count(), Some(7));
        let structured =
            read("{'descr': [('a]', '<f4', (2,)), ('b', '|S3')], 'fortran_order': False, 'shape': (2,), }");
        assert_eq!(structured.unwrap().dtype, "[('a]', '<f4', (2,)), ('b', '|S3')]");
    }

    #[test]
    fn a_shape_beyond_64_bits_is_no_count() {
        let shape = |shape: &str| read(&format!("{{'descr': '<f4', 'fortran_order': False, 'shape': {shape}}}"));
        assert_eq!(shape("(9223372036854775808, 2)").unwrap().count(), None);
        assert_eq!(shape("(9223372036854775808, 2, 0)").unwrap().count(), Some(0));
        assert!(shape("(18446744073709551616,)").is_err());
        assert!(shape("(-1,)").is_err());
    }

    #[test]
    fn nested_brackets_take_neither_time_nor_stack() {
        for open in ["{", "[", "(", "{'descr': ["] {
            assert!(read(&open.repeat(9_900 / open.len())).is_err());
        }
        assert!(read(&format!("{{'descr': {}", "[".repeat(9_000))).is_err());
    }

    #[test]
    fn damaged_headers_say_why() {
        for (text, why) in [
            ("{'descr': '<f4', 'shape': ()}", "without"),
            ("{'descr': '<f4', 'descr': '<f4'}", "repeated"),
            ("{'descr': '<f4' 'shape': ()}", "should be ,"),
            ("{'descr': '<f4', 'fortran_order': 1, 'shape': ()}", "True or False"),
            ("{'descr': '<f4', 'fortran_order': True, 'shape': ()} x", "the header's end"),
        ] {
            let error = read(text).unwrap_err().to_string();
            assert!(error.contains(why), "{text}: {error}");
        }
        let mut bytes = b"\x93NUMPY\x02\x00\xff\xff\xff\xff{".as_slice();
        assert!(Header::read(&mut bytes).unwrap_err().to_string().contains("4294967295 bytes"));
        assert!(Header::read(&mut &b"\x93NUMPY\x04\x00"[..]).unwrap_err().to_string().contains("format 4"));
        assert!(Header::read(&mut &b"PK"[..]).unwrap_err().to_string().contains("ends within"));
    }
}
