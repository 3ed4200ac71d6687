//! EXR read back through the crate `exr`: whole pictures, and the check that a file just written is all there.

use std::{fs::File, io::BufReader, path::Path};

use exr::{
    image::FlatSamples,
    meta::{MetaData, attribute, header::Header},
    prelude::{ReadChannels, ReadLayers, read},
};

use super::{
    Channel, OutputError, Picture, SampleType, Window,
    attributes::{metadata, string},
    parts::Part,
};
use crate::scene::Compression;

/// Reads a flat EXR file: the channels of all its parts, the windows, and the metadata that its attributes tell of.
///
/// Beauty comes first, the other channels in the file's order.
///
/// *Errors*: no EXR file, damaged, deep, with integer channels, or with parts that cover different windows.
pub fn read_exr(path: &Path) -> Result<Picture, OutputError> {
    let failed = |source| OutputError::Exr { path: path.to_path_buf(), source };
    let unsupported = |what: String| OutputError::Unsupported { path: path.to_path_buf(), what };
    let file =
        || File::open(path).map_err(|source| OutputError::Io { action: "read", path: path.to_path_buf(), source });

    let meta = MetaData::read_from_unbuffered(file()?, false).map_err(failed)?;
    let first = meta.headers.first().ok_or_else(|| unsupported("the file has no parts".into()))?;
    if let Some(deep) = meta.headers.iter().find(|h| h.deep) {
        return Err(unsupported(format!("part `{}` is deep; expected flat samples", part_name(deep))));
    }
    let data = window(first);
    if let Some(other) = meta.headers.iter().find(|h| window(h) != data) {
        return Err(unsupported(format!("part `{}` covers another window than the first part", part_name(other))));
    }
    let size = first.shared_attributes.display_window.size;
    let mut picture = Picture {
        display: (size.width() as u32, size.height() as u32),
        data,
        channels: Vec::new(),
        metadata: metadata(first.all_named_attributes()),
    };

    picture.metadata.pixel_aspect = first.shared_attributes.pixel_aspect.into();

    let image = read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .all_layers()
        .all_attributes()
        .from_buffered(BufReader::new(file()?))
        .map_err(failed)?;
    for channel in image.layer_data.into_iter().flat_map(|layer| layer.channel_data.list) {
        let name = string(&channel.name);
        let (sample_type, samples) = match channel.sample_data {
            FlatSamples::F16(samples) => (SampleType::Half, samples.into_iter().map(|s| s.to_f32()).collect()),
            FlatSamples::F32(samples) => (SampleType::Float, samples),
            FlatSamples::U32(_) => {
                return Err(unsupported(format!("channel `{name}` holds whole numbers; expected half or float")));
            }
        };
        picture.channels.push(Channel { name, sample_type, samples });
    }
    // Stable, so that all but these four stay in the file's order.
    picture.channels.sort_by_key(|c| ["R", "G", "B", "A"].iter().position(|n| *n == c.name).unwrap_or(4));
    Ok(picture)
}

/// How a file was written, beyond what a picture says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Encoding {
    /// Compression of its first part.
    pub compression: Compression,
    /// It has no date.
    pub reproducible: bool,
}

/// How an EXR file was written.
///
/// *Errors*: no EXR file.
pub fn encoding_of(path: &Path) -> Result<Encoding, OutputError> {
    let file =
        File::open(path).map_err(|source| OutputError::Io { action: "read", path: path.to_path_buf(), source })?;
    let meta = MetaData::read_from_unbuffered(file, false)
        .map_err(|source| OutputError::Exr { path: path.to_path_buf(), source })?;
    let first = meta.headers.first();
    let compression = match first.map(|header| header.compression) {
        Some(attribute::Compression::Uncompressed) => Compression::None,
        Some(attribute::Compression::ZIP1) => Compression::Zips,
        Some(attribute::Compression::PIZ) => Compression::Piz,
        Some(attribute::Compression::DWAA(_)) => Compression::Dwaa,
        // What we do not write is kept without loss.
        _ => Compression::Zip,
    };
    let reproducible = first.is_none_or(|header| header.own_attributes.capture_date.is_none());
    Ok(Encoding { compression, reproducible })
}

/// Checks a file just written: its parts, windows and channels are the picture's, and every chunk is there and whole,
/// at the place that the offset table names. `name` is what the file will be called.
pub(super) fn verify(written: &Path, name: &Path, picture: &Picture, parts: &[Part]) -> Result<(), OutputError> {
    let damaged = |what: String| OutputError::Damaged { path: name.to_path_buf(), what };
    let unreadable = |source: exr::error::Error| damaged(source.to_string());
    let file = File::open(written).map_err(|source| OutputError::Io { action: "reopen", path: name.into(), source })?;
    let reader = exr::block::read(BufReader::new(file), true).map_err(unreadable)?;

    let headers = reader.headers().to_vec();
    if headers.len() != parts.len() {
        return Err(damaged(format!("it has {} parts instead of {}", headers.len(), parts.len())));
    }
    for (header, part) in headers.iter().zip(parts) {
        let found = header.channels.list.iter().map(|c| (string(&c.name), c.sample_type));
        let expected = part.channels.iter().map(|index| {
            let channel = &picture.channels[*index];
            let sample_type = match channel.sample_type {
                SampleType::Half => attribute::SampleType::F16,
                SampleType::Float => attribute::SampleType::F32,
            };
            (channel.name.clone(), sample_type)
        });
        if !found.eq(expected) {
            return Err(damaged(format!("part `{}` has other channels", part_name(header))));
        }
        let size = header.shared_attributes.display_window.size;
        if window(header) != picture.data || (size.width() as u32, size.height() as u32) != picture.display {
            return Err(damaged(format!("part `{}` has other windows", part_name(header))));
        }
    }

    // Following the offset tables, not the order in the file: this is how compositors find their rows.
    let mut missing: Vec<Vec<bool>> = headers.iter().map(|h| vec![true; h.chunk_count]).collect();
    for chunk in reader.filter_chunks(true, |_, _, _| true).map_err(unreadable)? {
        let chunk = chunk.map_err(unreadable)?;
        let tile = headers[chunk.layer_index].get_block_data_indices(&chunk.compressed_block).map_err(unreadable)?;
        match missing[chunk.layer_index].get_mut(tile.tile_index.y()) {
            Some(flag) if *flag => *flag = false,
            _ => return Err(damaged(format!("chunk {} is there twice or out of range", tile.tile_index.y()))),
        }
    }
    match missing.iter().flatten().filter(|m| **m).count() {
        0 => Ok(()),
        count => Err(damaged(format!("{count} chunks are missing"))),
    }
}

fn part_name(header: &Header) -> String {
    header.own_attributes.layer_name.as_ref().map(string).unwrap_or_default()
}

fn window(header: &Header) -> Window {
    let bounds = header.data_window();
    Window {
        x: bounds.position.x(),
        y: bounds.position.y(),
        width: bounds.size.width() as u32,
        height: bounds.size.height() as u32,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::output::{WriteOptions, parts::parts};

    /// A picture of 40 rows (three chunks of 16 lines) and its file's bytes.
    fn written(folder: &Path) -> (Picture, Vec<Part>, Vec<u8>) {
        let data = Window { x: 0, y: 0, width: 8, height: 40 };
        let channel = |name: &str| Channel {
            name: name.into(),
            sample_type: SampleType::Float,
            samples: (0..data.area()).map(|i| i as f32).collect(),
        };
        let channels = vec![channel("Z"), channel("sampleCount")];
        let picture = Picture { display: (8, 40), data, channels, ..Picture::default() };
        let path = folder.join("whole.exr");
        crate::output::write(&picture, &path, &WriteOptions::default()).unwrap();
        let parts = parts(&picture, Compression::Zip);
        (picture, parts, std::fs::read(path).unwrap())
    }

    #[test]
    fn any_damage_to_chunks_or_their_table_is_found() {
        let folder = tempfile::tempdir().unwrap();
        let (picture, parts, whole) = written(folder.path());
        let check = |bytes: &[u8]| {
            let path = folder.path().join("damaged.exr");
            std::fs::write(&path, bytes).unwrap();
            verify(&path, Path::new("final.exr"), &picture, &parts)
        };
        assert!(check(&whole).is_ok());
        for keep in [whole.len() - 1, whole.len() / 2, 20, 0] {
            let error = check(&whole[..keep]).unwrap_err();
            assert!(
                matches!(error, OutputError::Damaged { ref path, .. } if path == Path::new("final.exr")),
                "{error}"
            );
        }
        // The table of three offsets stands right before the first chunk, whose place its first entry names.
        let table = (8..whole.len())
            .find(|at| u64::from_le_bytes(whole[*at..*at + 8].try_into().unwrap()) == *at as u64 + 24)
            .unwrap();
        for second in [0, whole.len() as u64 * 2, table as u64 + 24, table as u64 + 25] {
            let mut bytes = whole.clone();
            bytes[table + 8..table + 16].copy_from_slice(&second.to_le_bytes());
            assert!(check(&bytes).is_err(), "an offset of {second} was accepted");
        }
    }

    #[test]
    fn another_picture_is_not_taken_for_this_one() {
        let folder = tempfile::tempdir().unwrap();
        let (picture, parts, _) = written(folder.path());
        let check = |picture: &Picture| verify(&folder.path().join("whole.exr"), Path::new("a"), picture, &parts);
        assert!(check(&picture).is_ok());
        let changes: [fn(&mut Picture); 4] = [
            |p| p.data.y = 1,
            |p| p.display.0 = 9,
            |p| p.channels[0].name = "z".into(),
            |p| p.channels[0].sample_type = SampleType::Half,
        ];
        for change in changes {
            let mut other = picture.clone();
            change(&mut other);
            assert!(matches!(check(&other), Err(OutputError::Damaged { .. })));
        }
    }
}
