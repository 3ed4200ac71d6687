//! Deep EXR files (`deepscanline`) through OpenImageIO, and the one attribute that it cannot write: `deepImageState`.

use std::path::Path;

use glam::Vec3;

use super::{
    DeepPicture, DeepSample, Metadata, OutputError, Picture, Window, WriteOptions, colorspace,
    oiio::{oiio_attributes, part_over, text_of},
    whole_file::write_whole,
};
use crate::ffi::oiio::bridge::{OiioChannel, OiioDeep, OiioPart, oiio_read_deep, oiio_write_deep};

/// OpenEXR's value for samples in order of depth, none over another.
const TIDY: u8 = 3;

/// The attribute's name and type.
const STATE: &[u8] = b"deepImageState\0deepImageState\0";

/// Magic number and version, before the first attribute.
const HEADER: usize = 8;

/// Writes a deep picture; returns the file's size.
pub(super) fn write(picture: &DeepPicture, path: &Path, options: &WriteOptions) -> Result<u64, OutputError> {
    check(picture)?;
    let channels = picture.channels();
    // The attributes of the flat picture: they speak of windows and metadata alone. Mattes have no channels here.
    let metadata = Metadata { colorspace: options.colorspace, cryptomattes: Vec::new(), ..picture.metadata.clone() };
    let flat = Picture { display: picture.display, data: picture.data, channels: Vec::new(), metadata };
    let primaries = colorspace::matrix(picture.metadata.colorspace, options.colorspace).as_mat3();
    let part = OiioPart {
        channels: channels.iter().map(|&name| OiioChannel { name: name.into(), half: is_color(name) }).collect(),
        compression: "zips".into(),
        attributes: oiio_attributes(&flat, options)?,
        ..part_over(picture.display, picture.data)
    };
    let counts: Vec<u32> = picture.first.windows(2).map(|pair| (pair[1] - pair[0]) as u32).collect();
    let mut samples = Vec::with_capacity(picture.samples.len() * channels.len());
    for sample in &picture.samples {
        if picture.colored {
            let limit = super::picture::HALF_MAX;
            let mut color = sample.color.unwrap_or_default();
            if options.colorspace != picture.metadata.colorspace {
                color = (primaries * Vec3::from_array(color)).to_array();
            }
            samples.extend(color.map(|light| light.clamp(-limit, limit)));
        }
        samples.extend([sample.alpha, sample.front, sample.back]);
    }
    let failed = |e: cxx::Exception| OutputError::Oiio { path: path.to_path_buf(), message: e.what().to_string() };
    write_whole(
        path,
        |_, temporary| {
            oiio_write_deep(text_of(temporary)?, &part, &counts, &samples).map_err(failed)?;
            if !picture.state {
                return Ok(());
            }
            let failed = |action| move |source| OutputError::Io { action, path: path.to_path_buf(), source };
            let bytes = std::fs::read(temporary).map_err(failed("reopen the file for"))?;
            let bytes = with_state(&bytes).ok_or_else(|| OutputError::Damaged {
                path: path.to_path_buf(),
                what: "OpenImageIO wrote a header that is none".into(),
            })?;
            std::fs::write(temporary, bytes).map_err(failed("write"))
        },
        |written| {
            let damaged = |what: String| OutputError::Damaged { path: path.to_path_buf(), what };
            let found = oiio_read_deep(text_of(written)?).map_err(|e| damaged(e.what().to_string()))?;
            if found.counts == counts && found.samples.len() == samples.len() {
                Ok(())
            } else {
                Err(damaged("its samples are not those that were written".into()))
            }
        },
    )
}

/// Reads a deep picture back: windows, samples, whether they have colour and are said to be tidy; no metadata.
///
/// *Errors*: those of OpenImageIO, and a file without the channels `A Z ZBack`.
pub fn read_deep(path: &Path) -> Result<DeepPicture, OutputError> {
    let failed = |e: cxx::Exception| OutputError::Oiio { path: path.to_path_buf(), message: e.what().to_string() };
    let OiioDeep { part, counts, samples } = oiio_read_deep(text_of(path)?).map_err(failed)?;
    let place = |name: &str| part.channels.iter().position(|channel| channel.name == name);
    let [Some(alpha), Some(front), Some(back)] = ["A", "Z", "ZBack"].map(place) else {
        let what = "a deep picture without the channels A, Z and ZBack".into();
        return Err(OutputError::Unsupported { path: path.to_path_buf(), what });
    };
    let color = match ["R", "G", "B"].map(place) {
        [Some(r), Some(g), Some(b)] => Some([r, g, b]),
        _ => None,
    };
    let samples: Vec<DeepSample> = samples
        .chunks_exact(part.channels.len())
        .map(|values| DeepSample {
            front: values[front],
            back: values[back],
            alpha: values[alpha],
            color: color.map(|color| color.map(|channel| values[channel])),
        })
        .collect();
    let mut first = vec![0];
    first.extend(counts.iter().scan(0, |sum, &count| {
        *sum += u64::from(count);
        Some(*sum)
    }));
    let data = Window { x: part.x, y: part.y, width: part.width, height: part.height };
    let display = (part.display_width, part.display_height);
    let state = begins_with_state(path).map_err(|source| OutputError::Io {
        action: "read",
        path: path.to_path_buf(),
        source,
    })?;
    Ok(DeepPicture { display, data, first, samples, colored: color.is_some(), state, metadata: Default::default() })
}

/// Whether a file has the attribute where [`with_state`] puts it: OpenImageIO passes it over.
fn begins_with_state(path: &Path) -> std::io::Result<bool> {
    use std::io::Read;
    let mut start = Vec::new();
    std::fs::File::open(path)?.take((HEADER + STATE.len()) as u64).read_to_end(&mut start)?;
    Ok(start.ends_with(STATE))
}

fn is_color(name: &str) -> bool {
    matches!(name, "R" | "G" | "B")
}

/// Nothing that is not finite, not in order or over another gets into a file.
fn check(picture: &DeepPicture) -> Result<(), OutputError> {
    for (index, pair) in picture.first.windows(2).enumerate() {
        let samples = &picture.samples[pair[0] as usize..pair[1] as usize];
        let width = picture.data.width as usize;
        let (x, y) = (picture.data.x + (index % width) as i32, picture.data.y + (index / width) as i32);
        for sample in samples {
            let color = sample.color.unwrap_or_default();
            let all = [sample.front, sample.back, sample.alpha, color[0], color[1], color[2]];
            if let Some(&value) = all.iter().find(|value| !value.is_finite()) {
                return Err(OutputError::NonFinite { channel: "deep".into(), x, y, value });
            }
        }
        let tidy = samples.iter().all(|s| s.front >= 0.0 && s.front <= s.back && (0.0..=1.0).contains(&s.alpha))
            && samples.windows(2).all(|pair| pair[0].back <= pair[1].front);
        assert!(tidy, "deep pixel {x} {y} is tidy");
    }
    Ok(())
}

/// The bytes of a single-part deep file with the attribute `deepImageState` put into its header, and the table of chunks moved
/// by as much (OpenEXR File Layout); `None` if the header cannot be read.
fn with_state(bytes: &[u8]) -> Option<Vec<u8>> {
    let attribute = [STATE, &1u32.to_le_bytes(), &[TIDY]].concat();
    let text = |at: usize| bytes.get(at..)?.iter().position(|&byte| byte == 0).map(|length| (at, at + length));
    let (mut at, mut chunks) = (HEADER, None);
    loop {
        let (start, end) = text(at)?;
        if start == end {
            at = end + 1;
            break;
        }
        let (_, type_end) = text(end + 1)?;
        let size = i32::from_le_bytes(bytes.get(type_end + 1..type_end + 5)?.try_into().ok()?);
        let value = type_end + 5;
        if &bytes[start..end] == b"chunkCount" {
            chunks = Some(i32::from_le_bytes(bytes.get(value..value + 4)?.try_into().ok()?));
        }
        at = value + usize::try_from(size).ok()?;
    }
    let table = at..at + 8 * usize::try_from(chunks?).ok()?;
    let mut out = Vec::with_capacity(bytes.len() + attribute.len());
    out.extend_from_slice(bytes.get(..HEADER)?);
    out.extend_from_slice(&attribute);
    out.extend_from_slice(bytes.get(HEADER..table.start)?);
    for offset in bytes.get(table.clone())?.chunks_exact(8) {
        let moved = u64::from_le_bytes(offset.try_into().ok()?) + attribute.len() as u64;
        out.extend_from_slice(&moved.to_le_bytes());
    }
    out.extend_from_slice(bytes.get(table.end..)?);
    Some(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(colored: bool) -> DeepPicture {
        let color = |light: f32| colored.then_some([light, 0.5 * light, 0.25 * light]);
        let sample = |front, back, alpha| DeepSample { front, back, alpha, color: color(alpha) };
        DeepPicture {
            display: (3, 2),
            data: Window { x: -1, y: 0, width: 2, height: 2 },
            first: vec![0, 2, 2, 3, 6],
            samples: vec![
                sample(1.0, 2.5, 0.25),
                sample(4.0, 4.0, 1.0),
                sample(1e10, 1e10, 1.0),
                sample(0.125, 0.125, 0.5),
                sample(7.0, 9.0, 0.75),
                sample(9.0, 9.0, 0.0625),
            ],
            colored,
            state: colored,
            metadata: Default::default(),
        }
    }

    #[test]
    fn a_deep_file_holds_what_was_written_and_says_that_it_is_tidy() {
        let folder = tempfile::tempdir().unwrap();
        for colored in [false, true] {
            let path = folder.path().join("a.deep.exr");
            let picture = picture(colored);
            let report = super::super::write_deep(&picture, &path, &WriteOptions::default()).unwrap();
            let bytes = std::fs::read(&path).unwrap();
            assert_eq!(report.bytes, bytes.len() as u64);
            assert_eq!(read_deep(&path).unwrap(), picture);
            let state = b"deepImageState\0deepImageState\0\x01\0\0\0\x03";
            assert_eq!(bytes.windows(state.len()).any(|window| window == state), picture.state);
        }
    }

    #[test]
    fn what_is_not_finite_and_what_cannot_be_deep_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let mut broken = picture(false);
        broken.samples[2].front = f32::NAN;
        let path = folder.path().join("a.exr");
        let error = super::super::write_deep(&broken, &path, &WriteOptions::default()).unwrap_err();
        assert!(matches!(error, OutputError::NonFinite { x: -1, y: 1, .. }), "{error}");
        assert!(!path.exists());
        let error = super::super::check_deep(&folder.path().join("a.png")).unwrap_err().to_string();
        assert!(error.contains("--deep"), "{error}");
        assert!(read_deep(&path).is_err());
        assert_eq!(with_state(b"no EXR at all"), None);
    }
}
