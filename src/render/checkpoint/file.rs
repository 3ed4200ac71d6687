//! The file: a line with its version, a checksum (SHA-256) of all that follows, a header, the tiles.
//!
//! Header and sums are written by serde in the form of the crate `postcard`, numbers as their own bits; tiles are packed
//! (LZ4), since most of the layers of most pixels are 0.

use std::io::Write;
use std::path::Path;
use std::sync::Arc;

use sha2::{Digest, Sha256};

use super::{
    super::film::{FilmTile, View},
    super::plan::Plan,
    super::shares::tiles_of,
    CheckpointError,
};
use crate::output::{Metadata, OutputError, Portion, whole_file::write_whole};

const MAGIC: &[u8] = b"whitewater render checkpoint ";

/// Of the form below: the version of the program and of its sums. Change the second with what films hold.
const VERSION: &str = concat!(env!("CARGO_PKG_VERSION"), "-2");

/// Everything but the sums.
#[derive(Clone, Debug, serde::Serialize, serde::Deserialize)]
pub(in crate::render) struct Header {
    /// A hash of what pixels depend on.
    pub(in crate::render) identity: String,
    pub(in crate::render) frame: i64,
    /// Full frame (pixels).
    pub(in crate::render) size: [u32; 2],
    pub(in crate::render) portion: Portion,
    pub(in crate::render) plan: Plan,
    /// Light groups by name.
    pub(in crate::render) groups: Vec<String>,
    pub(in crate::render) view: View,
    /// Of the picture so far.
    pub(in crate::render) metadata: Metadata,
}

/// A tile's sums, packed; `None` until it has any.
pub(super) type Packed = Option<Arc<[u8]>>;

/// A whole checkpoint.
#[derive(Clone, Debug)]
pub struct Checkpoint {
    pub(super) header: Header,
    /// One of each tile of the portion.
    pub(super) tiles: Vec<Packed>,
}

/// Sums to bytes: those of each block of samples, or of all of them.
pub(super) fn pack(blocks: &[FilmTile]) -> Arc<[u8]> {
    let plain = postcard::to_allocvec(blocks).expect("sums are plain data that fits the memory");
    lz4_flex::compress_prepend_size(&plain).into()
}

impl Checkpoint {
    /// Whether a file begins as one does; false also if it cannot be read.
    pub fn is_one(path: &Path) -> bool {
        use std::io::Read;
        let mut start = [0; MAGIC.len()];
        std::fs::File::open(path).and_then(|mut file| file.read_exact(&mut start)).is_ok() && start == *MAGIC
    }

    /// The sums of a tile of the portion, by its place there; `None` if it has none yet.
    ///
    /// *Errors*: they are not those of that tile.
    pub(super) fn blocks(&self, path: &Path, tile: usize) -> Result<Option<Vec<FilmTile>>, CheckpointError> {
        let Some(packed) = self.tiles.get(tile).cloned().flatten() else { return Ok(None) };
        let damaged =
            |what: String| CheckpointError::Damaged { path: path.to_owned(), what: format!("tile {tile}: {what}") };
        let windows = tiles_of(&self.header.portion).map_err(|error| damaged(error.to_string()))?;
        let plain = lz4_flex::decompress_size_prepended(&packed).map_err(|error| damaged(error.to_string()))?;
        let blocks: Vec<FilmTile> = postcard::from_bytes(&plain).map_err(|error| damaged(error.to_string()))?;
        let fit = |block: &FilmTile| block.fits(windows[tile], self.header.groups.len(), &self.header.view.names);
        if blocks.is_empty() || !blocks.iter().all(fit) {
            return Err(damaged("its sums are not one for each pixel".to_owned()));
        }
        Ok(Some(blocks))
    }

    /// Writes the file whole, in place of the one before.
    ///
    /// *Errors*: the system's.
    pub(super) fn save(&self, path: &Path) -> Result<(), OutputError> {
        let lengths: Vec<u64> =
            self.tiles.iter().map(|tile| tile.as_ref().map_or(0, |bytes| bytes.len() as u64)).collect();
        let header = postcard::to_allocvec(&(&self.header, &lengths)).expect("a header is plain data");
        let length = (header.len() as u64).to_le_bytes();
        let mut sum = Sha256::new();
        let parts = [&length[..], &header].into_iter().chain(self.tiles.iter().flatten().map(|tile| &**tile));
        parts.clone().for_each(|part| sum.update(part));
        let sum = sum.finalize();
        write_whole(
            path,
            |file, _| {
                let mut write = || {
                    let mut file = std::io::BufWriter::new(&mut *file);
                    file.write_all(MAGIC)?;
                    file.write_all(VERSION.as_bytes())?;
                    file.write_all(b"\n")?;
                    file.write_all(&sum)?;
                    parts.clone().try_for_each(|part| file.write_all(part))?;
                    file.flush()
                };
                write().map_err(|source| OutputError::Io { action: "write", path: path.to_owned(), source })
            },
            |written| match Self::load(written) {
                Ok(_) => Ok(()),
                Err(error) => Err(OutputError::Damaged { path: path.to_owned(), what: error.to_string() }),
            },
        )?;
        Ok(())
    }

    /// Reads a file back.
    ///
    /// *Errors*: [`CheckpointError`]; a file that is not to the bit what was written is refused.
    pub fn load(path: &Path) -> Result<Self, CheckpointError> {
        let damaged = |what: &str| CheckpointError::Damaged { path: path.to_owned(), what: what.to_owned() };
        let bytes = std::fs::read(path)
            .map_err(|error| CheckpointError::Read { path: path.to_owned(), reason: error.to_string() })?;
        let rest = bytes.strip_prefix(MAGIC).ok_or_else(|| CheckpointError::NotOne { path: path.to_owned() })?;
        // A version is short; what is longer is none.
        let line = rest.iter().take(64).position(|&byte| byte == b'\n').ok_or_else(|| damaged("it has no version"))?;
        let (version, rest) = (&rest[..line], &rest[line + 1..]);
        if version != VERSION.as_bytes() {
            let found = String::from_utf8_lossy(version).escape_debug().to_string();
            return Err(CheckpointError::Version { path: path.to_owned(), found, expected: VERSION.to_owned() });
        }
        let (sum, rest) = rest.split_at_checked(32).ok_or_else(|| damaged("it ends in its checksum"))?;
        if Sha256::digest(rest).as_slice() != sum {
            return Err(damaged("its checksum is not that of its contents"));
        }
        let (length, rest) = rest.split_first_chunk().ok_or_else(|| damaged("it has no header"))?;
        let length = usize::try_from(u64::from_le_bytes(*length)).unwrap_or(usize::MAX);
        let (header, mut rest) = rest.split_at_checked(length).ok_or_else(|| damaged("its header is cut off"))?;
        let (header, lengths): (Header, Vec<u64>) =
            postcard::from_bytes(header).map_err(|error| damaged(&format!("its header: {error}")))?;
        let mut tiles = Vec::with_capacity(lengths.len());
        for length in lengths {
            let length = usize::try_from(length).unwrap_or(usize::MAX);
            let (tile, after) = rest.split_at_checked(length).ok_or_else(|| damaged("its tiles are cut off"))?;
            tiles.push((length > 0).then(|| tile.into()));
            rest = after;
        }
        let expected = tiles_of(&header.portion).map_err(|error| damaged(&error.to_string()))?.len();
        if tiles.len() != expected || !rest.is_empty() {
            return Err(damaged(&format!("it has {} tiles instead of {expected}", tiles.len())));
        }
        Ok(Self { header, tiles })
    }

    /// Why this is not what a render with the header `now` would have made so far; `None` if it is.
    pub(super) fn differs(&self, now: &Header) -> Option<String> {
        let old = &self.header;
        if old.frame != now.frame {
            return Some(format!("it is of frame {}; expected {}", old.frame, now.frame));
        }
        if old.size != now.size {
            let [[a, b], [c, d]] = [old.size, now.size];
            return Some(format!("its frame has {a}x{b} pixels; expected {c}x{d}"));
        }
        let part = |portion: &Portion| portion.tiles();
        if part(&old.portion) != part(&now.portion) {
            return Some(format!("it has the tiles {}; expected {}", part(&old.portion), part(&now.portion)));
        }
        let mattes = [old, now].map(|header| header.view.names.mattes());
        if mattes[0] != mattes[1] {
            return Some(format!(
                "it has the sets of mattes {}; expected {}, as --layers asks for",
                mattes[0], mattes[1]
            ));
        }
        if old.identity != now.identity || old.groups != now.groups {
            let short = |identity: &str| identity.chars().take(12).collect::<String>();
            return Some(format!(
                "it is of the scene {} and this is {}: the scene, one of its files, --memory or --simd has changed",
                short(&old.identity),
                short(&now.identity)
            ));
        }
        now.plan.breaks(&old.plan)
    }
}
