//! EXR through the crate `exr`: headers, rows of samples, and the order of attributes. Reading back is in `exr_read`.

use std::{
    fs::File,
    io::{BufWriter, Seek, SeekFrom, Write},
    path::Path,
};

use exr::{
    block::{
        UncompressedBlock, enumerate_ordered_header_block_indices,
        lines::LineRefMut,
        writer::{ChunksWriter, ParallelBlocksCompressor},
    },
    error::UnitResult,
    math::Vec2,
    meta::{
        BlockDescription, Headers,
        attribute::{self, AttributeValue, ChannelDescription, IntegerBounds, LineOrder, Text},
        header::{Header, ImageAttributes, LayerAttributes},
    },
};

use super::{
    OutputError, Picture, SampleType, WriteOptions, attributes, exr_read,
    parts::{DWA_LEVEL, Part, parts},
    picture::to_half,
    whole_file::write_whole,
};
use crate::scene::Compression;

/// Writes every channel and attribute; returns the file's size.
pub(super) fn write(picture: &Picture, path: &Path, options: &WriteOptions) -> Result<u64, OutputError> {
    let parts = parts(picture, options.compression);
    let headers = headers(picture, &parts, options)?;
    write_whole(
        path,
        |file, _| {
            let failed = |source| OutputError::Exr { path: path.to_path_buf(), source };
            write_samples(picture, &parts, &headers, &mut BufWriter::new(&mut *file)).map_err(failed)?;
            sort_attributes(&headers, file).map_err(failed)
        },
        |written| exr_read::verify(written, path, picture, &parts),
    )
}

/// One header per part. All attributes stand in each, so that no reader of a single part misses any.
fn headers(picture: &Picture, parts: &[Part], options: &WriteOptions) -> Result<Headers, OutputError> {
    let window = &picture.data;
    let display = IntegerBounds::from_dimensions((picture.display.0 as usize, picture.display.1 as usize));
    let mut shared = ImageAttributes::new(display);
    shared.pixel_aspect = picture.metadata.pixel_aspect as f32;
    let mut own = LayerAttributes::default().with_position(Vec2(window.x, window.y));
    for (name, value) in attributes::attributes(picture, options)? {
        use AttributeValue as V;
        match (&*name, value) {
            ("chromaticities", V::Chromaticities(v)) => shared.chromaticities = Some(v),
            ("timeCode", V::TimeCode(v)) => shared.time_code = Some(v),
            ("worldToCamera", V::Matrix4x4(v)) => own.world_to_camera = Some(v),
            ("worldToNDC", V::Matrix4x4(v)) => own.world_to_normalized_device = Some(v),
            ("framesPerSecond", V::Rational(v)) => own.frames_per_second = Some(v),
            ("expTime", V::F32(v)) => own.exposure = Some(v),
            ("aperture", V::F32(v)) => own.aperture = Some(v),
            ("focus", V::F32(v)) => own.focus = Some(v),
            ("utcOffset", V::F32(v)) => own.utc_offset = Some(v),
            ("capDate", V::Text(v)) => own.capture_date = Some(v),
            ("multiView", V::TextVector(v)) => own.multi_view_names = Some(v),
            ("owner", V::Text(v)) => own.owner = Some(v),
            ("comments", V::Text(v)) => own.comments = Some(v),
            (name, value) => {
                own.other.insert(Text::from(name), value);
            }
        }
    }
    let header = |part: &Part| {
        let channels = part.channels.iter().map(|index| {
            let channel = &picture.channels[*index];
            let sample_type = match channel.sample_type {
                SampleType::Half => exr::meta::attribute::SampleType::F16,
                SampleType::Float => exr::meta::attribute::SampleType::F32,
            };
            // The last argument is B44's hint alone; OpenImageIO leaves it unset as well.
            ChannelDescription::new(channel.name.as_str(), sample_type, false)
        });
        let size = (window.width as usize, window.height as usize);
        let mut own = own.clone();
        own.layer_name = part.name.map(Text::from);
        Header::new(Text::default(), size, channels.collect())
            .with_encoding(compression(part.compression), BlockDescription::ScanLines, LineOrder::Increasing)
            .with_shared_attributes(shared.clone())
            .with_attributes(own)
    };
    Ok(parts.iter().map(header).collect())
}

fn compression(compression: Compression) -> attribute::Compression {
    match compression {
        Compression::Zip => attribute::Compression::ZIP16,
        Compression::Zips => attribute::Compression::ZIP1,
        Compression::Piz => attribute::Compression::PIZ,
        Compression::Dwaa => attribute::Compression::DWAA(Some(DWA_LEVEL)),
        Compression::None => attribute::Compression::Uncompressed,
    }
}

/// Headers, offset tables and every chunk, in increasing order whatever thread finishes first.
fn write_samples(picture: &Picture, parts: &[Part], headers: &Headers, file: &mut BufWriter<&mut File>) -> UnitResult {
    let width = picture.data.width as usize;
    let fill = |line: LineRefMut| {
        let place = line.location;
        let channel = &picture.channels[parts[place.layer].channels[place.channel]];
        let row = &channel.samples[place.position.y() * width..][..place.sample_count];
        let filled = match channel.sample_type {
            SampleType::Half => line.write_samples(|x| to_half(row[x])),
            SampleType::Float => line.write_samples_from_slice(row),
        };
        filled.expect("a row fits the memory that was measured for it");
    };
    exr::block::write(file, headers.clone(), true, |meta, chunks| {
        let mut blocks = enumerate_ordered_header_block_indices(&meta.headers).map(|(index, block)| {
            (index, UncompressedBlock::from_lines(&meta.headers[block.layer].channels, block, fill))
        });
        // As many threads as the rest of the program may use, not as many as the machine has.
        let pool = || rayon::ThreadPoolBuilder::new().num_threads(rayon::current_num_threads()).build();
        match ParallelBlocksCompressor::new_with_thread_pool(&meta, chunks, pool) {
            Some(mut compressor) => {
                blocks.try_for_each(|(index, block)| compressor.add_block_to_compression_queue(index, block))
            }
            None => {
                let mut compressor = chunks.sequential_blocks_compressor(&meta);
                blocks.try_for_each(|(index, block)| compressor.compress_block(index, block))
            }
        }
    })
}

/// Writes the headers once more with their attributes sorted by name, as OpenEXR itself stores them.
///
/// The crate keeps custom attributes in a hash map of random order, so that no two files would have the same bytes.
/// Another order has the same length: everything behind the headers stays where it is.
fn sort_attributes(headers: &Headers, file: &mut File) -> UnitResult {
    let mut bytes = Vec::new();
    for header in headers {
        let mut list: Vec<_> = header.all_named_attributes().collect();
        list.sort_by_key(|(name, _)| *name);
        for (name, value) in &list {
            attribute::write(name, value, &mut bytes)?;
        }
        bytes.push(0);
    }
    if headers.len() > 1 {
        bytes.push(0);
    }
    // Behind the magic number and the version, four bytes each.
    file.seek(SeekFrom::Start(8))?;
    file.write_all(&bytes)?;
    Ok(())
}
