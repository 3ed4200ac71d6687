//! EXR and scene-linear TIFF through OpenImageIO (feature `oiio`): the second, independent writer and reader.
//! The same channels, parts and attributes as `exr_file` writes, in OpenImageIO's own spelling.

use std::path::Path;

use exr::meta::attribute::AttributeValue;

use super::{
    Format, OutputError, Picture, SampleType, Window, WriteOptions,
    attributes::{attributes, string},
    exr_read,
    parts::{DWA_LEVEL, Part, parts},
    picture::HALF_MAX,
    whole_file::write_whole,
};
use crate::{
    ffi::oiio::bridge::{OiioAttribute, OiioChannel, OiioKind, OiioPart as BridgePart, oiio_create, oiio_open},
    scene::Compression,
};

/// Rows handed over at a time: whole chunks of every compression (32 lines at most), and little memory.
const ROWS: usize = 64;

/// One part of a file, as OpenImageIO reads it.
#[derive(Clone, Debug, PartialEq)]
pub struct OiioPart {
    /// The part's name; empty in a file of one part.
    pub name: String,
    /// Display window: x, y of its corner are 0.
    pub display: (u32, u32),
    /// Data window.
    pub data: Window,
    /// Compression by OpenImageIO's name.
    pub compression: String,
    /// Names of the channels and whether they are half.
    pub channels: Vec<(String, SampleType)>,
    /// Samples pixel by pixel, channels in the order above.
    pub samples: Vec<f32>,
    /// Attributes by OpenImageIO's names, as text.
    pub attributes: Vec<(String, String)>,
}

/// Reads every part of an image through OpenImageIO, flat.
///
/// *Errors*: those of OpenImageIO.
pub fn read_with_oiio(path: &Path) -> Result<Vec<OiioPart>, OutputError> {
    let failed = |e: cxx::Exception| OutputError::Oiio { path: path.to_path_buf(), message: e.what().to_string() };
    let reader = oiio_open(text_of(path)?).map_err(failed)?;
    let count = reader.parts().map_err(failed)?;
    (0..count)
        .map(|index| {
            let part = reader.describe(index).map_err(failed)?;
            let samples = reader.samples(index).map_err(failed)?;
            let sample_type = |half| if half { SampleType::Half } else { SampleType::Float };
            Ok(OiioPart {
                name: part.name,
                display: (part.display_width, part.display_height),
                data: Window { x: part.x, y: part.y, width: part.width, height: part.height },
                compression: part.compression,
                channels: part.channels.into_iter().map(|c| (c.name, sample_type(c.half))).collect(),
                samples,
                attributes: part.attributes.into_iter().map(|a| (a.name, a.text)).collect(),
            })
        })
        .collect()
}

/// Writes every channel and attribute; returns the file's size.
pub(super) fn write(
    picture: &Picture,
    path: &Path,
    format: Format,
    options: &WriteOptions,
) -> Result<u64, OutputError> {
    if format == Format::Tiff && (picture.data.x < 0 || picture.data.y < 0) {
        return Err(OutputError::Unsupported {
            path: path.to_path_buf(),
            what: "TIFF knows no pixels left of the frame or above it; write overscan as .exr".into(),
        });
    }
    // TIFF has no DWA, and parts would only hide channels there.
    let compression = if format == Format::Exr { options.compression } else { Compression::Zip };
    let parts = parts(picture, compression);
    let attributes = oiio_attributes(picture, options)?;
    let specs: Vec<BridgePart> = parts.iter().map(|part| spec(picture, part, &attributes)).collect();
    let failed = |e: cxx::Exception| OutputError::Oiio { path: path.to_path_buf(), message: e.what().to_string() };
    write_whole(
        path,
        |_, temporary| {
            let mut writer = oiio_create(text_of(temporary)?, &specs).map_err(failed)?;
            let mut writer = writer.pin_mut();
            for (index, part) in parts.iter().enumerate() {
                if index > 0 {
                    writer.as_mut().next_part().map_err(failed)?;
                }
                write_part(picture, part, |first, samples| writer.as_mut().write_rows(first, samples).map_err(failed))?;
            }
            writer.close().map_err(failed)
        },
        |written| match format {
            // Checked by the other implementation, chunk by chunk.
            Format::Exr => exr_read::verify(written, path, picture, &parts),
            _ => verify(written, path, picture, &parts),
        },
    )
}

/// A part's samples in strips, pixel by pixel.
fn write_part(
    picture: &Picture,
    part: &Part,
    mut write_rows: impl FnMut(u32, &[f32]) -> Result<(), OutputError>,
) -> Result<(), OutputError> {
    let (width, height) = (picture.data.width as usize, picture.data.height as usize);
    let count = part.channels.len();
    let mut strip = vec![0.0; ROWS.min(height) * width * count];
    for first in (0..height).step_by(ROWS) {
        let rows = ROWS.min(height - first);
        for (c, index) in part.channels.iter().enumerate() {
            let channel = &picture.channels[*index];
            // Half's range is ours to keep: OpenImageIO would write infinity.
            let limit = if channel.sample_type == SampleType::Half { HALF_MAX } else { f32::MAX };
            let samples = &channel.samples[first * width..(first + rows) * width];
            for (to, from) in strip[c..].iter_mut().step_by(count).zip(samples) {
                *to = from.clamp(-limit, limit);
            }
        }
        write_rows(first as u32, &strip[..rows * width * count])?;
    }
    Ok(())
}

fn spec(picture: &Picture, part: &Part, attributes: &[OiioAttribute]) -> BridgePart {
    let channel = |index: &usize| {
        let channel = &picture.channels[*index];
        OiioChannel { name: channel.name.clone(), half: channel.sample_type == SampleType::Half }
    };
    BridgePart {
        name: part.name.unwrap_or_default().into(),
        channels: part.channels.iter().map(channel).collect(),
        compression: match part.compression {
            Compression::Zip => "zip".into(),
            Compression::Zips => "zips".into(),
            Compression::Piz => "piz".into(),
            Compression::Dwaa => format!("dwaa:{DWA_LEVEL}"),
            Compression::None => "none".into(),
        },
        attributes: attributes.iter().map(copy).collect(),
        ..part_over(picture.display, picture.data)
    }
}

/// A part of so many pixels of a frame, with nothing in it yet.
pub(super) fn part_over((display_width, display_height): (u32, u32), data: Window) -> BridgePart {
    let Window { x, y, width, height } = data;
    BridgePart {
        name: String::new(),
        x,
        y,
        width,
        height,
        display_width,
        display_height,
        channels: Vec::new(),
        compression: String::new(),
        attributes: Vec::new(),
    }
}

/// cxx does not derive `Clone` for structs of vectors.
fn copy(a: &OiioAttribute) -> OiioAttribute {
    OiioAttribute {
        name: a.name.clone(),
        kind: a.kind,
        text: a.text.clone(),
        integers: a.integers.clone(),
        floats: a.floats.clone(),
    }
}

/// The picture's attributes under the names that OpenImageIO translates for each format.
pub(super) fn oiio_attributes(picture: &Picture, options: &WriteOptions) -> Result<Vec<OiioAttribute>, OutputError> {
    use AttributeValue as V;
    let empty = |name: &str, kind| OiioAttribute {
        name: name.into(),
        kind,
        text: String::new(),
        integers: Vec::new(),
        floats: Vec::new(),
    };
    let mut list = Vec::new();
    for (name, value) in attributes(picture, options)? {
        let name = match &*name {
            "capDate" => "DateTime",
            "owner" => "Copyright",
            "comments" => "ImageDescription",
            "expTime" => "ExposureTime",
            "aperture" => "FNumber",
            "timeCode" => "smpte:TimeCode",
            "worldToCamera" => "worldtocamera",
            "worldToNDC" => "worldtoNDC",
            same => same,
        };
        let float = |kind, floats: &[f32]| OiioAttribute { floats: floats.to_vec(), ..empty(name, kind) };
        let integer = |kind, integers: &[i32]| OiioAttribute { integers: integers.to_vec(), ..empty(name, kind) };
        list.push(match value {
            V::Text(text) => OiioAttribute { text: string(&text), ..empty(name, OiioKind::Text) },
            V::TextVector(list) => {
                let lines: Vec<String> = list.iter().map(string).collect();
                OiioAttribute { text: lines.join("\n"), ..empty(name, OiioKind::Texts) }
            }
            V::I32(v) => integer(OiioKind::Integer, &[v]),
            V::Rational((n, d)) => integer(OiioKind::Rational, &[n, d as i32]),
            V::TimeCode(code) => {
                let packed = code.pack_time_as_tv60_u32();
                let packed = packed.expect("a time code made from a frame number is within its digits");
                integer(OiioKind::TimeCode, &[packed as i32, code.pack_user_data_as_u32() as i32])
            }
            V::F32(v) => float(OiioKind::Float, &[v]),
            V::FloatVec2(v) => float(OiioKind::Vector2, &[v.0, v.1]),
            V::Matrix4x4(v) => float(OiioKind::Matrix, &v),
            V::Chromaticities(c) => float(
                OiioKind::Chromaticities,
                &[c.red.0, c.red.1, c.green.0, c.green.1, c.blue.0, c.blue.1, c.white.0, c.white.1],
            ),
            other => unreachable!("{name} is of a type that no attribute of ours has: {other:?}"),
        });
    }
    let aspect = vec![picture.metadata.pixel_aspect as f32];
    list.push(OiioAttribute { floats: aspect, ..empty("PixelAspectRatio", OiioKind::Float) });
    if options.reproducible {
        list.push(empty("DateTime", OiioKind::Suppressed));
    }
    Ok(list)
}

/// Checks a file that only OpenImageIO can read: parts, windows and count of channels, and that every sample decodes.
fn verify(written: &Path, name: &Path, picture: &Picture, parts: &[Part]) -> Result<(), OutputError> {
    let damaged = |what: String| OutputError::Damaged { path: name.to_path_buf(), what };
    let found = read_with_oiio(written).map_err(|e| damaged(e.to_string()))?;
    let same = found.len() == parts.len()
        && found
            .iter()
            .zip(parts)
            .all(|(found, part)| found.data == picture.data && found.channels.len() == part.channels.len());
    if same { Ok(()) } else { Err(damaged("its parts, windows or channels differ".into())) }
}

/// OpenImageIO takes paths as UTF-8.
pub(super) fn text_of(path: &Path) -> Result<&str, OutputError> {
    path.to_str().ok_or_else(|| OutputError::Unsupported {
        path: path.to_path_buf(),
        what: "OpenImageIO takes only file names in Unicode".into(),
    })
}
