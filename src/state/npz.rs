//! An NPZ archive as named arrays: sizes checked before anything is read, numbers handed out in C order.
//!
//! Knows nothing of water. A declared size is believed only as far as the archive's own bytes can bear it out, and an
//! array must hold exactly what its shape says, with the archive's checksum.

use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use zip::ZipArchive;
use zip::read::{ArchiveOffset, Config};
use zip::result::ZipError;

use super::StateError;
use super::error::{Place, Problem, Problems, Stop, quote};
use super::npy::{Header, show_shape};

/// Most bytes that one byte of deflate can stand for (zlib's technical notes: 1032 : 1), and room for an empty block.
const DEFLATE_RATIO: u64 = 1032;
/// Most arrays taken: far more than any simulator writes, few enough to look at all their headers at once.
const MAX_ARRAYS: usize = 4096;
/// Bytes decoded at a time, a multiple of every element's size.
const CHUNK: usize = 65536;

/// An open archive.
pub struct Archive {
    path: PathBuf,
    zip: ZipArchive<BufReader<File>>,
    arrays: Vec<Array>,
}

/// One array that an archive holds.
#[derive(Clone, Debug)]
pub struct Array {
    /// Its name, without `.npy`.
    pub name: String,
    /// What its header says, or why it could not be read.
    pub header: Result<Header, String>,
    entry: usize,
    declared_bytes: u64,
    packed_bytes: u64,
}

/// Numbers that an element can be read as.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Element {
    F4,
    F8,
    U4,
    U8,
}

impl Element {
    /// The element and whether it is big-endian.
    fn from_dtype(dtype: &str) -> Option<(Element, bool)> {
        let big_endian = match dtype.get(..1)? {
            "<" => false,
            ">" => true,
            _ => return None,
        };
        let element = match &dtype[1..] {
            "f4" => Element::F4,
            "f8" => Element::F8,
            "u4" => Element::U4,
            "u8" => Element::U8,
            _ => return None,
        };
        Some((element, big_endian))
    }

    /// Its name in messages and in the format's description.
    fn name(self) -> &'static str {
        match self {
            Element::F4 => "f4",
            Element::F8 => "f8",
            Element::U4 => "u4",
            Element::U8 => "u8",
        }
    }

    /// Bytes.
    fn size(self) -> usize {
        match self {
            Element::F4 | Element::U4 => 4,
            Element::F8 | Element::U8 => 8,
        }
    }
}

impl Archive {
    /// Opens an archive and reads every array's header, but no element yet.
    ///
    /// # Errors
    /// A file that is no zip archive, was cut off or has something after its end; what the system says.
    pub fn open(path: impl AsRef<Path>) -> Result<Archive, StateError> {
        let path = path.as_ref();
        Problems::default().settle(path, Archive::open_or_stop(path))
    }

    pub(super) fn open_or_stop(path: &Path) -> Result<Archive, Stop> {
        let mut file = File::open(path)?;
        find_end(&mut file)?;
        let config = Config { archive_offset: ArchiveOffset::Known(0) };
        let mut zip =
            ZipArchive::with_config(config, BufReader::new(file)).map_err(|error| bad_zip(Place::File, error))?;
        if zip.len() > MAX_ARRAYS {
            let found = format!("{} arrays", zip.len());
            return Err(Problem::new(Place::File, found, format!("at most {MAX_ARRAYS}")).into());
        }
        let mut arrays = Vec::new();
        for entry in 0..zip.len() {
            let Some(name) = zip.name_for_index(entry).and_then(|name| name.strip_suffix(".npy")).map(str::to_string)
            else {
                continue;
            };
            let mut file = zip.by_index(entry).map_err(|error| bad_zip(Place::Array(name.clone()), error))?;
            let (declared_bytes, packed_bytes) = (file.size(), file.compressed_size());
            let header = Header::read(&mut file).map_err(|error| error.to_string());
            arrays.push(Array { name, header, entry, declared_bytes, packed_bytes });
        }
        Ok(Archive { path: path.to_path_buf(), zip, arrays })
    }

    /// The arrays, in the archive's order.
    pub fn arrays(&self) -> &[Array] {
        &self.arrays
    }

    /// The shape of an array, if it is there and readable.
    pub fn shape(&self, name: &str) -> Option<&[u64]> {
        let header = self.find(name)?.header.as_ref().ok()?;
        Some(&header.shape)
    }

    /// All elements of an f4 or f8 array in C order (last index fastest).
    ///
    /// # Errors
    /// [`StateError::Damaged`] if there is no such array, it is of another type, or holds other than its shape says.
    pub fn read_f64(&mut self, name: &str) -> Result<Vec<f64>, StateError> {
        let read = self.checked(name, &[Element::F4, Element::F8]).and_then(|()| self.floats(name));
        Problems::default().settle(&self.path, read)
    }

    /// As [`Archive::read_f64`], and refuses what is not finite.
    ///
    /// # Errors
    /// As [`Archive::read_f64`]; [`StateError::Damaged`] with the element for a number that is not finite.
    pub fn read_finite(&mut self, name: &str) -> Result<Vec<f64>, StateError> {
        let values = self.read_f64(name)?;
        match values.iter().position(|value| !value.is_finite()) {
            None => Ok(values),
            Some(i) => {
                let place = Place::Element(name.to_string(), vec![i as u64]);
                let problem = Problem::new(place, values[i].to_string(), "a finite number");
                Problems::default().settle(&self.path, Err(problem.into()))
            }
        }
    }

    /// All elements of a u4 or u8 array in C order.
    ///
    /// # Errors
    /// As [`Archive::read_f64`].
    pub fn read_u64(&mut self, name: &str) -> Result<Vec<u64>, StateError> {
        let read = self.checked(name, &[Element::U4, Element::U8]).and_then(|()| self.unsigned(name));
        Problems::default().settle(&self.path, read)
    }

    pub(super) fn find(&self, name: &str) -> Option<&Array> {
        self.arrays.iter().find(|array| array.name == name)
    }

    /// That an array is there, of one of these types, and that the archive has room for what its shape says.
    pub(super) fn checked(&self, name: &str, accepted: &[Element]) -> Result<(), Stop> {
        let expected_types = || accepted.iter().map(|e| e.name()).collect::<Vec<_>>().join(" or ");
        let place = || Place::Array(name.to_string());
        let Some(array) = self.find(name) else {
            let found = format!("no array {}", quote(name));
            return Err(Problem::new(Place::File, found, format!("one of {}", expected_types())).into());
        };
        let header = match &array.header {
            Ok(header) => header,
            Err(why) => return Err(Problem::new(place(), why, "a numpy array").into()),
        };
        let element = match Element::from_dtype(&header.dtype) {
            Some((element, _)) if accepted.contains(&element) => element,
            _ => return Err(Problem::new(place(), format!("type {}", quote(&header.dtype)), expected_types()).into()),
        };
        let bytes = header.count().and_then(|n| n.checked_mul(element.size() as u64)?.checked_add(header.bytes));
        if bytes != Some(array.declared_bytes) {
            let shape = show_shape(&header.shape);
            let found = format!("shape {shape} in {} bytes", array.declared_bytes);
            let expected = match bytes {
                Some(bytes) => format!("{bytes} bytes for that shape"),
                None => "a shape that memory can hold".to_string(),
            };
            return Err(Problem::new(place(), found, expected).into());
        }
        // A deflated block is at least two bytes.
        if array.declared_bytes > array.packed_bytes.saturating_add(2).saturating_mul(DEFLATE_RATIO) {
            let found = format!("{} bytes packed into {}", array.declared_bytes, array.packed_bytes);
            return Err(Problem::new(place(), found, format!("at most {DEFLATE_RATIO} bytes from each")).into());
        }
        Ok(())
    }

    /// The elements of a float array that `checked` has passed, in C order.
    pub(super) fn floats(&mut self, name: &str) -> Result<Vec<f64>, Stop> {
        self.elements(name, |element, big_endian, bytes| match (element, big_endian) {
            (Element::F4, false) => f64::from(f32::from_le_bytes(fixed(bytes))),
            (Element::F4, true) => f64::from(f32::from_be_bytes(fixed(bytes))),
            (_, false) => f64::from_le_bytes(fixed(bytes)),
            (_, true) => f64::from_be_bytes(fixed(bytes)),
        })
    }

    /// The elements of an unsigned array that `checked` has passed, in C order.
    pub(super) fn unsigned(&mut self, name: &str) -> Result<Vec<u64>, Stop> {
        self.elements(name, |element, big_endian, bytes| match (element, big_endian) {
            (Element::U4, false) => u64::from(u32::from_le_bytes(fixed(bytes))),
            (Element::U4, true) => u64::from(u32::from_be_bytes(fixed(bytes))),
            (_, false) => u64::from_le_bytes(fixed(bytes)),
            (_, true) => u64::from_be_bytes(fixed(bytes)),
        })
    }

    fn elements<T: Copy>(&mut self, name: &str, decode: impl Fn(Element, bool, &[u8]) -> T) -> Result<Vec<T>, Stop> {
        let array = self.find(name).expect("checked has found this array").clone();
        let header = array.header.expect("checked has read this header");
        let (element, big_endian) = Element::from_dtype(&header.dtype).expect("checked has seen this type");
        let count = header.count().expect("checked has counted this shape");
        let damaged = |found: String, expected: String| Problem::new(Place::Array(name.to_string()), found, expected);

        let mut file =
            self.zip.by_index(array.entry).map_err(|error| bad_zip(Place::Array(name.to_string()), error))?;
        let unpacking = |error: io::Error| Stop::from(damaged(error.to_string(), "an undamaged archive".to_string()));
        io::copy(&mut (&mut file).take(header.bytes), &mut io::sink()).map_err(unpacking)?;
        // Packed data rarely shrinks below an eighth; what does grows the vector as it really arrives.
        let mut values = Vec::with_capacity(count.min(array.packed_bytes) as usize);
        let mut chunk = vec![0_u8; CHUNK];
        let mut left = count * element.size() as u64;
        while left > 0 {
            let wanted = left.min(CHUNK as u64) as usize;
            let read = fill(&mut file, &mut chunk[..wanted]).map_err(unpacking)?;
            values.extend(chunk[..read].chunks_exact(element.size()).map(|bytes| decode(element, big_endian, bytes)));
            if read < wanted {
                let expected = format!("{count} elements for shape {}", show_shape(&header.shape));
                return Err(damaged(format!("{} elements", values.len()), expected).into());
            }
            left -= wanted as u64;
        }
        // Reading past the end also makes the archive compare its checksum.
        if fill(&mut file, &mut chunk[..1]).map_err(unpacking)? > 0 {
            let expected = format!("{count} for shape {}", show_shape(&header.shape));
            return Err(damaged(format!("more than {count} elements"), expected).into());
        }
        Ok(if header.fortran_order { c_order(&values, &header.shape) } else { values })
    }
}

fn fixed<const N: usize>(bytes: &[u8]) -> [u8; N] {
    bytes.try_into().expect("chunks have the element's size")
}

/// Reads until the buffer is full or the data ends; how many bytes there were.
fn fill(reader: &mut impl Read, buffer: &mut [u8]) -> io::Result<usize> {
    let mut filled = 0;
    while filled < buffer.len() {
        match reader.read(&mut buffer[filled..]) {
            Ok(0) => break,
            Ok(read) => filled += read,
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
    Ok(filled)
}

/// From first index fastest to last index fastest.
fn c_order<T: Copy>(values: &[T], shape: &[u64]) -> Vec<T> {
    let mut strides = Vec::with_capacity(shape.len());
    let mut stride = 1;
    for &length in shape {
        strides.push(stride);
        stride *= length as usize;
    }
    let mut index = vec![0_u64; shape.len()];
    let mut at = 0;
    let mut out = Vec::with_capacity(values.len());
    while out.len() < values.len() {
        out.push(values[at]);
        for axis in (0..shape.len()).rev() {
            index[axis] += 1;
            at += strides[axis];
            if index[axis] < shape[axis] {
                break;
            }
            at -= strides[axis] * shape[axis] as usize;
            index[axis] = 0;
        }
    }
    out
}

/// Checks that the archive's directory closes the file. The zip crate would search the whole file for one, and would
/// pass over what follows it.
fn find_end(file: &mut File) -> Result<(), Stop> {
    const SIGNATURE: &[u8] = b"PK\x05\x06";
    const RECORD: usize = 22;
    let length = file.seek(SeekFrom::End(0))?;
    // The record and the longest comment.
    let tail_length = length.min(RECORD as u64 + u64::from(u16::MAX));
    file.seek(SeekFrom::Start(length - tail_length))?;
    let mut tail = Vec::new();
    file.take(tail_length).read_to_end(&mut tail)?;
    file.seek(SeekFrom::Start(0))?;

    let mut after = None;
    for start in (0..(tail.len() + 1).saturating_sub(RECORD)).rev() {
        if !tail[start..].starts_with(SIGNATURE) {
            continue;
        }
        let comment = usize::from(u16::from_le_bytes([tail[start + 20], tail[start + 21]]));
        match tail.len().checked_sub(start + RECORD + comment) {
            Some(0) => return Ok(()),
            Some(surplus) => after = after.or(Some(surplus)),
            None => {}
        }
    }
    let found = match after {
        Some(surplus) => format!("{surplus} bytes after the archive's directory"),
        None => "a zip archive without its directory".to_string(),
    };
    let expected = if after.is_some() { "the file to end there" } else { "a whole file (this one was cut off)" };
    Err(Problem::new(Place::File, found, expected).into())
}

fn bad_zip(place: Place, error: ZipError) -> Stop {
    match error {
        // The zip crate reports a file that ends too early as an end of file.
        ZipError::Io(error) if !matches!(error.kind(), io::ErrorKind::UnexpectedEof | io::ErrorKind::InvalidInput) => {
            Stop::Io(error)
        }
        error => Problem::new(place, error.to_string(), "an undamaged zip archive, stored or deflated").into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fortran_order_is_turned_into_c_order() {
        // Element (i, j, k) holds 100 i + 10 j + k.
        let shape = [2_u64, 3, 4];
        let mut fortran = Vec::new();
        for k in 0..4 {
            for j in 0..3 {
                for i in 0..2 {
                    fortran.push(100 * i + 10 * j + k);
                }
            }
        }
        let c = c_order(&fortran, &shape);
        let expected: Vec<i32> =
            (0..2).flat_map(|i| (0..3).flat_map(move |j| (0..4).map(move |k| 100 * i + 10 * j + k))).collect();
        assert_eq!(c, expected);
        assert_eq!(c_order(&[7], &[]), [7]);
        assert_eq!(c_order::<i32>(&[], &[0, 3]), [0_i32; 0]);
    }

    #[test]
    fn types_are_told_apart_with_their_byte_order() {
        assert_eq!(Element::from_dtype("<f4"), Some((Element::F4, false)));
        assert_eq!(Element::from_dtype(">u8"), Some((Element::U8, true)));
        for other in ["", "f4", "|f4", "<f2", "<i8", "<f44", "é", "[('a', '<f4')]"] {
            assert_eq!(Element::from_dtype(other), None, "{other}");
        }
    }
}
