//! Named arrays → an NPZ archive; knows nothing of what they mean.

use std::io::{BufWriter, Seek, Write};
use std::path::Path;

use npyz::{AutoSerialize, DType, Serialize, TypeStr, WriterBuilder};
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

use super::StateError;
use super::whole_file::write_whole;

/// How an archive's bytes are packed; what reads it need not know.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Packing {
    /// Deflated for size.
    #[default]
    Small,
    /// Deflated with the least effort: for files that are made many at a time.
    Quick,
    /// Not at all: for noise, and for what is soon replaced.
    Stored,
}

/// An archive that is being written.
pub struct ArchiveWriter<W: Write + Seek> {
    zip: ZipWriter<W>,
    packing: Packing,
}

impl<W: Write + Seek> ArchiveWriter<W> {
    pub(super) fn new(writer: W) -> Self {
        Self { zip: ZipWriter::new(writer), packing: Packing::default() }
    }

    /// Packs the arrays that follow in this way.
    pub fn pack(&mut self, packing: Packing) {
        self.packing = packing;
    }

    /// Writes one array, C order; `values` must be as many as `shape` says.
    ///
    /// # Errors
    /// What the writer says.
    pub fn array<T: AutoSerialize>(
        &mut self,
        name: &str,
        shape: &[u64],
        values: impl IntoIterator<Item = T>,
    ) -> Result<(), StateError> {
        let bytes = shape.iter().product::<u64>() * size_of::<T>() as u64;
        self.typed(name, shape, T::default_dtype(), bytes, values)
    }

    /// Writes names as numpy's unicode text, one row.
    ///
    /// # Errors
    /// What the writer says.
    pub fn names(&mut self, name: &str, values: &[String]) -> Result<(), StateError> {
        // numpy itself has no text of zero characters in an array: it takes one.
        let longest = values.iter().map(|value| value.chars().count()).max().unwrap_or(0).max(1);
        let text: TypeStr = format!("<U{longest}").parse().map_err(std::io::Error::other)?;
        let bytes = (values.len() * longest * 4) as u64;
        self.typed(name, &[values.len() as u64], DType::Plain(text), bytes, values.iter().map(String::as_str))
    }

    fn typed<T: Serialize>(
        &mut self,
        name: &str,
        shape: &[u64],
        dtype: DType,
        bytes: u64,
        values: impl IntoIterator<Item = T>,
    ) -> Result<(), StateError> {
        // Past 4 GB an entry needs the archive's 64-bit form; the margin is for the header.
        let options = SimpleFileOptions::default().large_file(bytes > u64::from(u32::MAX) - 65536);
        let options = match self.packing {
            Packing::Small => options,
            Packing::Quick => options.compression_level(Some(1)),
            Packing::Stored => options.compression_method(CompressionMethod::Stored),
        };
        self.zip.start_file(format!("{name}.npy"), options).map_err(std::io::Error::from)?;
        let mut buffer = BufWriter::with_capacity(1 << 16, &mut self.zip);
        let mut npy = npyz::WriteOptions::new().dtype(dtype).shape(shape).writer(&mut buffer).begin_nd()?;
        npy.extend(values)?;
        npy.finish()?;
        buffer.flush()?;
        Ok(())
    }

    pub(super) fn finish(self) -> Result<(), StateError> {
        self.zip.finish().map_err(std::io::Error::from)?.flush()?;
        Ok(())
    }
}

/// Lets `write` fill an archive that has the name `path` only when it is whole.
///
/// # Errors
/// What `write` or the system says.
pub fn write_arrays(
    path: &Path,
    write: impl FnOnce(&mut ArchiveWriter<&mut BufWriter<&mut std::fs::File>>) -> Result<(), StateError>,
) -> Result<(), StateError> {
    write_whole(path, |writer| {
        let mut archive = ArchiveWriter::new(writer);
        write(&mut archive)?;
        archive.finish()
    })
}
