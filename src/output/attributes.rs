//! A picture's metadata ↔ named, typed attributes as OpenEXR defines them (docs/formats.md, section 3).
//! Both EXR writers put down this one list; each spells and places it in its own way.

use std::borrow::Cow;

use exr::{
    math::Vec2,
    meta::attribute::{AttributeValue, Text, TimeCode},
};
use time::{OffsetDateTime, UtcOffset, macros::format_description};

use super::{Cryptomatte, EYES, Metadata, OutputError, Picture, Portion, WriteOptions, colorspace, cryptomatte};

/// Height of the film back that focal lengths refer to (mm).
const FILM_HEIGHT: f64 = 24.0;

/// Where the right eye of a pair is: for the picture as a whole OpenEXR has no place for a second camera.
const RIGHT_EYE: [&str; 3] =
    ["whitewater:right:worldToCamera", "whitewater:right:worldToNDC", "whitewater:right:cameraToWorld"];

/// Every attribute of a picture beyond those that a header cannot be without.
///
/// *Errors*: a number that is not finite or does not fit its type.
pub(super) fn attributes(
    picture: &Picture,
    options: &WriteOptions,
) -> Result<Vec<(Cow<'static, str>, AttributeValue)>, OutputError> {
    use AttributeValue::{F32, FloatVec2, I32, Matrix4x4, Rational};
    let m = &picture.metadata;
    let mut list = vec![
        ("chromaticities", AttributeValue::Chromaticities(colorspace::chromaticities(m.colorspace))),
        ("colorInteropID", text(colorspace::interop_id(m.colorspace))),
        ("worldToCamera", Matrix4x4(matrix("worldToCamera", &m.world_to_camera)?)),
        ("worldToNDC", Matrix4x4(matrix("worldToNDC", &m.world_to_ndc)?)),
        ("whitewater:cameraToWorld", Matrix4x4(matrix("whitewater:cameraToWorld", &m.camera_to_world)?)),
        ("framesPerSecond", Rational(rational_fps(m.fps)?)),
        ("imageCounter", I32(integer("imageCounter", m.frame)?)),
        ("expTime", F32(number("expTime", m.exposure_time)?)),
        ("pinholeFocalLength", F32(number("pinholeFocalLength", m.focal_length)?)),
        ("sensorOverallDimensions", {
            let width = FILM_HEIGHT * m.pixel_aspect * f64::from(picture.display.0) / f64::from(picture.display.1);
            FloatVec2(Vec2(width as f32, FILM_HEIGHT as f32))
        }),
        ("whitewater:samples", I32(integer("whitewater:samples", m.samples.into())?)),
        ("whitewater:complete", I32(m.complete.into())),
    ];
    if let Some(matrices) = &m.right_eye {
        for (name, rows) in RIGHT_EYE.into_iter().zip(matrices) {
            list.push((name, Matrix4x4(matrix(name, rows)?)));
        }
        let views = EYES.map(|view| Text::from_slice_unchecked(view.as_bytes()));
        list.push(("multiView", AttributeValue::TextVector(views.to_vec())));
    }
    if let Some(code) = time_code(m.frame, m.fps) {
        list.push(("timeCode", AttributeValue::TimeCode(code)));
    }
    if m.f_number != 0.0 {
        list.push(("aperture", F32(number("aperture", m.f_number)?)));
        list.push(("focus", F32(number("focus", m.focus)?)));
    }
    if !options.reproducible {
        let (date, offset) = capture_date(options.captured)?;
        list.push(("capDate", text(&date)));
        list.push(("utcOffset", F32(offset)));
        list.push(("whitewater:seconds", F32(number("whitewater:seconds", m.seconds)?)));
    }
    let texts = [
        ("owner", m.owner.as_deref().unwrap_or_default()),
        ("comments", m.comments.as_deref().unwrap_or_default()),
        ("whitewater:version", env!("CARGO_PKG_VERSION")),
        ("whitewater:scene", &m.scene_hash),
        ("whitewater:solver", &m.solver),
        ("whitewater:tolerance", &m.tolerance),
        ("whitewater:denoiser", &m.denoiser),
    ];
    if let Some(portion) = &m.portion {
        list.push(("whitewater:tiles", text(&portion.tiles())));
        if let Some(samples) = portion.sample_range() {
            list.push(("whitewater:sampleRange", text(&samples)));
        }
    }
    // Empty strings say nothing, and OpenImageIO 3 drops them.
    list.extend(texts.into_iter().filter(|(_, t)| !t.is_empty()).map(|(name, t)| (name, text(t))));
    let mut list: Vec<_> = list.into_iter().map(|(name, value)| (Cow::Borrowed(name), value)).collect();
    let sets = m.cryptomattes.iter().flat_map(Cryptomatte::attributes);
    list.extend(sets.map(|(name, value)| (Cow::Owned(name), value)));
    Ok(list)
}

/// The metadata that a list of attributes tells of; what it does not say stays at its default.
pub(super) fn metadata<'a>(attributes: impl Iterator<Item = (&'a [u8], AttributeValue)>) -> Metadata {
    use AttributeValue::{F32, I32, Matrix4x4, Rational};
    let mut m = Metadata::default();
    let list: Vec<_> = attributes.collect();
    m.cryptomattes = cryptomatte::read(list.iter().filter_map(|(name, value)| match value {
        AttributeValue::Text(text) => Some((*name, text)),
        _ => None,
    }));
    let (mut tiles, mut range) = (None, None);
    let rows = |v: [f32; 16]| std::array::from_fn(|r| std::array::from_fn(|c| f64::from(v[4 * r + c])));
    for (name, value) in list {
        if let (Some(at), Matrix4x4(v)) = (RIGHT_EYE.iter().position(|known| known.as_bytes() == name), &value) {
            m.right_eye.get_or_insert_default()[at] = rows(*v);
        }
        match (name, value) {
            (b"worldToCamera", Matrix4x4(v)) => m.world_to_camera = rows(v),
            (b"worldToNDC", Matrix4x4(v)) => m.world_to_ndc = rows(v),
            (b"whitewater:cameraToWorld", Matrix4x4(v)) => m.camera_to_world = rows(v),
            (b"framesPerSecond", Rational((n, d))) => m.fps = f64::from(n) / f64::from(d),
            (b"imageCounter", I32(v)) => m.frame = v.into(),
            (b"expTime", F32(v)) => m.exposure_time = v.into(),
            (b"pinholeFocalLength", F32(v)) => m.focal_length = v.into(),
            (b"aperture", F32(v)) => m.f_number = v.into(),
            (b"focus", F32(v)) => m.focus = v.into(),
            (b"whitewater:samples", I32(v)) => m.samples = v.try_into().unwrap_or(0),
            (b"whitewater:complete", I32(v)) => m.complete = v != 0,
            (b"whitewater:seconds", F32(v)) => m.seconds = v.into(),
            (b"colorInteropID", AttributeValue::Text(v)) => m.colorspace = colorspace::by_interop_id(&string(&v)),
            (b"owner", AttributeValue::Text(v)) => m.owner = Some(string(&v)),
            (b"comments", AttributeValue::Text(v)) => m.comments = Some(string(&v)),
            (b"whitewater:scene", AttributeValue::Text(v)) => m.scene_hash = string(&v),
            (b"whitewater:solver", AttributeValue::Text(v)) => m.solver = string(&v),
            (b"whitewater:tolerance", AttributeValue::Text(v)) => m.tolerance = string(&v),
            (b"whitewater:denoiser", AttributeValue::Text(v)) => m.denoiser = string(&v),
            (b"whitewater:tiles", AttributeValue::Text(v)) => tiles = Some(string(&v)),
            (b"whitewater:sampleRange", AttributeValue::Text(v)) => range = Some(string(&v)),
            _ => {}
        }
    }
    m.portion = tiles.and_then(|tiles| Portion::parse(&tiles, range.as_deref()));
    m
}

/// Text as its UTF-8 bytes, which is how other programs read EXR strings (the crate itself would store Latin-1).
pub(super) fn text(value: &str) -> AttributeValue {
    AttributeValue::Text(Text::from_slice_unchecked(value.as_bytes()))
}

/// The UTF-8 text of an EXR string.
pub(super) fn string(value: &Text) -> String {
    String::from_utf8_lossy(value.as_slice()).into_owned()
}

fn number(name: &'static str, value: f64) -> Result<f32, OutputError> {
    let single = value as f32;
    if single.is_finite() {
        Ok(single)
    } else {
        Err(OutputError::Attribute { name, value: value.to_string(), expected: "a finite 32-bit number" })
    }
}

fn integer(name: &'static str, value: i64) -> Result<i32, OutputError> {
    value.try_into().map_err(|_| OutputError::Attribute {
        name,
        value: value.to_string(),
        expected: "a whole number of 32 bits",
    })
}

fn matrix(name: &'static str, rows: &[[f64; 4]; 4]) -> Result<[f32; 16], OutputError> {
    let mut flat = [0.0; 16];
    for (to, from) in flat.iter_mut().zip(rows.iter().flatten()) {
        *to = number(name, *from)?;
    }
    Ok(flat)
}

/// Frames per second as an exact ratio: whole rates over 1, the NTSC rates over 1001, else the nearest simple fraction.
///
/// *Source*: OpenEXR's `guessExactFps`, which takes a rate within 0.002 of an NTSC rate to mean it (23.976 → 24000/1001).
fn rational_fps(fps: f64) -> Result<(i32, u32), OutputError> {
    let refused = || OutputError::Attribute {
        name: "framesPerSecond",
        value: fps.to_string(),
        expected: "a rate above 0 and below 2^31",
    };
    if !(fps > 0.0 && fps < f64::from(i32::MAX)) {
        return Err(refused());
    }
    if fps.fract() == 0.0 {
        return Ok((fps as i32, 1));
    }
    if let Some(n) = [24, 30, 48, 60, 120].into_iter().find(|n| (fps - f64::from(*n) / 1.001).abs() < 0.002) {
        return Ok((n * 1000, 1001));
    }
    // Continued fraction, until it is as near as single precision could tell.
    let (mut h, mut k) = ([0.0, 1.0], [1.0, 0.0]);
    let mut x = fps;
    loop {
        let a = x.floor();
        h = [h[1], a * h[1] + h[0]];
        k = [k[1], a * k[1] + k[0]];
        if h[1] > f64::from(i32::MAX) || k[1] > f64::from(u32::MAX) {
            return if h[0] > 0.0 { Ok((h[0] as i32, k[0] as u32)) } else { Err(refused()) };
        }
        if h[1] > 0.0 && (h[1] / k[1] - fps).abs() <= fps * f64::from(f32::EPSILON) / 8.0 {
            return Ok((h[1] as i32, k[1] as u32));
        }
        x = 1.0 / (x - a);
    }
}

/// The frame as hours, minutes, seconds and frames at the whole rate nearest to `fps`, without dropping; wraps at a day.
///
/// A time code counts 30 frames at most. Rates up to 60 count pairs and mark the second of each by the field phase
/// (SMPTE ST 12-1); for higher ones there is no time code, and none is written.
fn time_code(frame: i64, fps: f64) -> Option<TimeCode> {
    let rate = (fps.round() as i64).max(1);
    let per_count = match rate {
        1..=30 => 1,
        31..=60 => 2,
        _ => return None,
    };
    let frame = frame.rem_euclid(rate * 86_400);
    let (second, within) = (frame / rate, frame % rate);
    Some(TimeCode {
        hours: (second / 3600) as u8,
        minutes: (second / 60 % 60) as u8,
        seconds: (second % 60) as u8,
        frame: (within / per_count) as u8,
        field_phase: within % per_count == 1,
        ..TimeCode::default()
    })
}

/// `YYYY:MM:DD hh:mm:ss` in local time, and what to add to it to get UTC (s), as OpenEXR defines `utcOffset`.
fn capture_date(captured: Option<OffsetDateTime>) -> Result<(String, f32), OutputError> {
    let when = captured.unwrap_or_else(|| {
        let now = OffsetDateTime::now_utc();
        // A machine without a known time zone keeps UTC, and says so by an offset of 0.
        now.to_offset(UtcOffset::local_offset_at(now).unwrap_or(UtcOffset::UTC))
    });
    let date = when.format(format_description!("[year]:[month]:[day] [hour]:[minute]:[second]")).map_err(|e| {
        OutputError::Attribute { name: "capDate", value: e.to_string(), expected: "a date of this calendar" }
    })?;
    Ok((date, -when.offset().whole_seconds() as f32))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Colorspace;
    use time::macros::datetime;

    #[test]
    fn frame_rates_are_exact_ratios() {
        let cases = [
            (24.0, (24, 1)),
            (23.976, (24000, 1001)),
            (24000.0 / 1001.0, (24000, 1001)),
            (29.97, (30000, 1001)),
            (59.94, (60000, 1001)),
            (12.5, (25, 2)),
            (0.001, (1, 1000)),
            (100_000.0, (100_000, 1)),
            (1.0 / 3.0, (1, 3)),
        ];
        for (fps, expected) in cases {
            assert_eq!(rational_fps(fps).unwrap(), expected, "{fps}");
        }
        let (n, d) = rational_fps(std::f64::consts::PI).unwrap();
        assert!((f64::from(n) / f64::from(d) - std::f64::consts::PI).abs() < 1e-6);
        for fps in [0.0, -24.0, f64::NAN, f64::INFINITY, 1e-300] {
            assert!(rational_fps(fps).is_err(), "{fps}");
        }
    }

    #[test]
    fn time_codes_count_frames() {
        let digits =
            |frame, fps| time_code(frame, fps).map(|t| (t.hours, t.minutes, t.seconds, t.frame, t.field_phase));
        assert_eq!(digits(0, 24.0), Some((0, 0, 0, 0, false)));
        assert_eq!(digits(24 * 3661 + 23, 24.0), Some((1, 1, 1, 23, false)));
        assert_eq!(digits(30, 29.97), Some((0, 0, 1, 0, false)));
        assert_eq!(digits(59, 60.0), Some((0, 0, 0, 29, true)));
        assert_eq!(digits(24 * 86_400, 24.0), Some((0, 0, 0, 0, false)));
        assert_eq!(digits(-1, 24.0), Some((23, 59, 59, 23, false)));
        assert_eq!(digits(5, 0.25), Some((0, 0, 5, 0, false)));
        assert_eq!(digits(5, 120.0), None);
    }

    #[test]
    fn the_capture_date_is_local_and_its_offset_leads_to_utc() {
        let (date, offset) = capture_date(Some(datetime!(2026-03-04 05:06:07 +2))).unwrap();
        assert_eq!((date.as_str(), offset), ("2026:03:04 05:06:07", -7200.0));
    }

    #[test]
    fn metadata_survives_the_list() {
        let mut picture = Picture { display: (16, 9), ..Picture::default() };
        picture.metadata = Metadata {
            world_to_camera: std::array::from_fn(|r| std::array::from_fn(|c| (4 * r + c) as f64)),
            world_to_ndc: std::array::from_fn(|r| std::array::from_fn(|c| -((4 * r + c) as f64))),
            camera_to_world: std::array::from_fn(|r| std::array::from_fn(|c| (r * c) as f64 + 0.5)),
            fps: 24000.0 / 1001.0,
            frame: 77,
            exposure_time: 0.25,
            f_number: 2.5,
            focus: 12.0,
            focal_length: 32.0,
            owner: Some("Þóra".into()),
            comments: Some("two\nlines".into()),
            scene_hash: "abc123".into(),
            samples: 16,
            solver: "univariate".into(),
            tolerance: "0.02 px".into(),
            seconds: 1.5,
            complete: false,
            denoiser: "Open Image Denoise 2.5.1".into(),
            pixel_aspect: 1.0,
            right_eye: Some(std::array::from_fn(|m| {
                std::array::from_fn(|r| std::array::from_fn(|c| (m + r * c) as f64))
            })),
            cryptomattes: vec![Cryptomatte { layer: "CryptoBed".into(), names: vec!["terrain".into(), "mist".into()] }],
            colorspace: Colorspace::Acescg,
            portion: Some(Portion {
                index: 2,
                count: 3,
                whole: crate::output::Window { x: -4, y: 5, width: 60, height: 7 },
                samples: Some([16, 48]),
            }),
        };
        let list = attributes(&picture, &WriteOptions::default()).unwrap();
        let back = metadata(list.iter().map(|(n, v)| (n.as_bytes(), v.clone())));
        assert_eq!(back, picture.metadata);
        let has = |list: &[(Cow<str>, AttributeValue)], name: &str| list.iter().any(|(n, _)| *n == name);
        assert!(has(&list, "capDate") && has(&list, "utcOffset") && has(&list, "aperture"));
        // A pinhole has no aperture; a reproducible file no times.
        picture.metadata.f_number = 0.0;
        let list = attributes(&picture, &WriteOptions { reproducible: true, ..Default::default() }).unwrap();
        for absent in ["aperture", "focus", "capDate", "utcOffset", "whitewater:seconds"] {
            assert!(!has(&list, absent), "{absent}");
        }
        picture.metadata.world_to_ndc[3][1] = f64::NAN;
        let error = attributes(&picture, &WriteOptions::default()).unwrap_err().to_string();
        assert!(error.contains("worldToNDC") && error.contains("NaN"), "{error}");
    }
}
