//! EXR files as a compositor finds them: what is written is read back by the crate `exr`, by OpenEXR's and
//! OpenImageIO's own tools where they are installed, and (feature `oiio`) through the bridge, each checking the other.

use std::{path::Path, process::Command};

use whitewater::{
    output::{self, Channel, Cryptomatte, Metadata, OutputError, Picture, SampleType, Window, WriteOptions},
    scene::{Colorspace, Compression, Profile, View, Writer},
};

/// A picture with every kind of channel, over a data window that is neither the frame nor inside it.
fn picture() -> Picture {
    let data = Window { x: -3, y: 5, width: 37, height: 41 };
    let mut state = 1u32;
    let mut noise = move || {
        // Marsaglia's xorshift: any numbers will do, as long as they are the same ones each time.
        state ^= state << 13;
        state ^= state >> 17;
        state ^= state << 5;
        state as f32 / u32::MAX as f32 - 0.25
    };
    let mut channel = |name: &str, sample_type, scale: f32| {
        let samples = (0..data.area()).map(|_| noise() * scale).collect();
        Channel { name: name.into(), sample_type, samples }
    };
    use SampleType::{Float, Half};
    let mut channels = Vec::new();
    for name in ["R", "G", "B", "A", "N.x", "N.y", "N.z", "reflection.R", "reflection.G", "reflection.B", "mask.foam"] {
        channels.push(channel(name, Half, 2.0));
    }
    for name in ["Z", "P.x", "P.y", "P.z", "forward.u", "forward.v", "water.depth", "CryptoObject00.r", "sampleCount"] {
        channels.push(channel(name, Float, 1e6));
    }
    // Ids fill the whole range of single precision, both signs and all exponents.
    let ids = (0..data.area()).map(|index| output::cryptomatte::id(&format!("particle{index}"))).collect();
    channels.push(Channel { name: "CryptoObject00.b".into(), sample_type: Float, samples: ids });
    let rows = |add: f64| std::array::from_fn(|r| std::array::from_fn(|c| (4 * r + c) as f64 + add));
    let metadata = Metadata {
        world_to_camera: rows(0.25),
        world_to_ndc: rows(-7.5),
        camera_to_world: rows(100.0),
        fps: 24000.0 / 1001.0,
        frame: 1234,
        exposure_time: 0.0625,
        f_number: 2.5,
        focus: 12.5,
        focal_length: 32.5,
        owner: Some("Sigríður & Søn".into()),
        comments: Some("a comment".into()),
        scene_hash: "0123456789abcdef".into(),
        samples: 16,
        solver: "univariate".into(),
        tolerance: "0.02 px".into(),
        seconds: 3.5,
        complete: true,
        denoiser: "Open Image Denoise 2.5.1".into(),
        pixel_aspect: 1.0,
        right_eye: None,
        cryptomattes: vec![Cryptomatte {
            layer: "CryptoObject".into(),
            names: ["water", "равнина", "panel_\"0\""].map(str::to_owned).to_vec(),
        }],
        colorspace: Colorspace::Rec709,
        portion: None,
    };
    Picture { display: (32, 48), data, channels, metadata }
}

/// The picture as a file can hold it: half channels rounded to half.
fn as_stored(mut picture: Picture) -> Picture {
    for channel in picture.channels.iter_mut().filter(|c| c.sample_type == SampleType::Half) {
        for sample in &mut channel.samples {
            *sample = half::f16::from_f32(sample.clamp(-65504.0, 65504.0)).to_f32();
        }
    }
    picture
}

fn options(compression: Compression) -> WriteOptions {
    WriteOptions {
        compression,
        captured: Some(time::macros::datetime!(2026-11-22 10:20:30 +2)),
        ..WriteOptions::default()
    }
}

/// Every channel, found by name, is bit for bit the same.
fn assert_same_channels(found: &Picture, expected: &Picture, names: impl Fn(&str) -> bool) {
    assert_eq!(found.channels.len(), expected.channels.len());
    for channel in expected.channels.iter().filter(|c| names(&c.name)) {
        let other = found.channel(&channel.name).unwrap_or_else(|| panic!("{} is missing", channel.name));
        assert_eq!(other.sample_type, channel.sample_type, "{}", channel.name);
        let bits = |c: &Channel| c.samples.iter().map(|s| s.to_bits()).collect::<Vec<_>>();
        assert!(bits(other) == bits(channel), "{} differs", channel.name);
    }
}

/// Runs a tool if it is installed; says so if it is not.
fn tool(name: &str, arguments: &[&str], file: &Path) -> Option<String> {
    match Command::new(name).args(arguments).arg(file).output() {
        Ok(output) => {
            let text = String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr);
            assert!(output.status.success(), "{name} refused {file:?}: {text}");
            Some(text)
        }
        Err(error) => {
            eprintln!(
                "SKIPPED: {name} is not installed ({error}); install openimageio-tools and openexr to check with it"
            );
            None
        }
    }
}

/// Every attribute with its value as `exrheader` or OpenImageIO would know it, by OpenEXR's names.
fn assert_every_attribute(path: &Path, picture: &Picture) {
    use exr::meta::attribute::AttributeValue as V;
    let meta = exr::meta::MetaData::read_from_file(path, true).unwrap();
    let m = &picture.metadata;
    let flat = |rows: &[[f64; 4]; 4]| V::Matrix4x4(std::array::from_fn(|i| rows[i / 4][i % 4] as f32));
    let text = |t: &str| V::Text(exr::meta::attribute::Text::from_slice_unchecked(t.as_bytes()));
    for header in &meta.headers {
        let find = |name: &str| header.all_named_attributes().find(|(n, _)| *n == name.as_bytes()).map(|(_, v)| v);
        let expected = [
            ("worldToCamera", flat(&m.world_to_camera)),
            ("worldToNDC", flat(&m.world_to_ndc)),
            ("whitewater:cameraToWorld", flat(&m.camera_to_world)),
            ("framesPerSecond", V::Rational((24000, 1001))),
            ("imageCounter", V::I32(1234)),
            ("expTime", V::F32(0.0625)),
            ("aperture", V::F32(2.5)),
            ("focus", V::F32(12.5)),
            ("pinholeFocalLength", V::F32(32.5)),
            ("sensorOverallDimensions", V::FloatVec2(exr::math::Vec2(16.0, 24.0))),
            ("capDate", text("2026:11:22 10:20:30")),
            ("utcOffset", V::F32(-7200.0)),
            ("owner", text("Sigríður & Søn")),
            ("comments", text("a comment")),
            ("whitewater:version", text(env!("CARGO_PKG_VERSION"))),
            ("whitewater:scene", text("0123456789abcdef")),
            ("whitewater:samples", V::I32(16)),
            ("whitewater:solver", text("univariate")),
            ("whitewater:tolerance", text("0.02 px")),
            ("whitewater:seconds", V::F32(3.5)),
            ("whitewater:complete", V::I32(1)),
            ("cryptomatte/3ae39a5/name", text("CryptoObject")),
            ("cryptomatte/3ae39a5/hash", text("MurmurHash3_32")),
            ("cryptomatte/3ae39a5/conversion", text("uint32_to_float32")),
            ("cryptomatte/3ae39a5/manifest", text(&m.cryptomattes[0].manifest())),
            ("pixelAspectRatio", V::F32(1.0)),
            ("screenWindowCenter", V::FloatVec2(exr::math::Vec2(0.0, 0.0))),
            ("screenWindowWidth", V::F32(1.0)),
        ];
        for (name, value) in expected {
            assert_eq!(find(name), Some(value), "{name}");
        }
        let Some(V::Chromaticities(c)) = find("chromaticities") else { panic!("no chromaticities") };
        let all = [c.red.0, c.red.1, c.green.0, c.green.1, c.blue.0, c.blue.1, c.white.0, c.white.1];
        assert_eq!(all, [0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290]);
        let Some(V::TimeCode(t)) = find("timeCode") else { panic!("no time code") };
        assert_eq!((t.hours, t.minutes, t.seconds, t.frame), (0, 0, 51, 10));
    }
}

#[test]
fn every_lossless_compression_gives_back_every_bit_and_attribute() {
    let directory = tempfile::tempdir().unwrap();
    let expected = as_stored(picture());
    for compression in [Compression::Zip, Compression::Zips, Compression::Piz, Compression::None] {
        let path = directory.path().join(format!("{compression:?}.exr"));
        let report = output::write(&picture(), &path, &options(compression)).unwrap();
        assert_eq!(report.bytes, std::fs::metadata(&path).unwrap().len());
        let found = output::read_exr(&path).unwrap();
        assert_eq!((found.display, found.data), (expected.display, expected.data));
        assert_same_channels(&found, &expected, |_| true);
        assert_eq!(found.channels[0].name, "R");
        assert_every_attribute(&path, &expected);
        let close = |a: f64, b: f64| (a - b).abs() < 1e-6;
        assert!(close(found.metadata.fps, expected.metadata.fps));
        assert_eq!(found.metadata, Metadata { fps: found.metadata.fps, ..expected.metadata.clone() });
    }
}

#[test]
fn blender_s_names_keep_every_bit_under_every_compression() {
    let directory = tempfile::tempdir().unwrap();
    let expected = as_stored(picture());
    for compression in [Compression::Zip, Compression::Dwaa] {
        let path = directory.path().join("a.exr");
        let options = WriteOptions { profile: Profile::Blender, ..options(compression) };
        output::write(&picture(), &path, &options).unwrap();
        let found = output::read_exr(&path).unwrap();
        assert_eq!(found.channels.len(), expected.channels.len());
        for (ours, theirs, sign) in [
            ("Z", "ViewLayer.Depth.Z", 1.0),
            ("P.y", "ViewLayer.Position.Y", 1.0),
            ("N.y", "ViewLayer.Normal.Y", 1.0),
            ("A", "ViewLayer.Combined.A", 1.0),
            ("forward.u", "ViewLayer.Vector.Z", -1.0),
            ("forward.v", "ViewLayer.Vector.W", -1.0),
            ("CryptoObject00.b", "ViewLayer.CryptoObject00.b", 1.0),
            ("water.depth", "ViewLayer.water_depth.X", 1.0),
            ("sampleCount", "ViewLayer.Debug Sample Count.X", 1.0),
        ] {
            let [a, b] =
                [expected.channel(ours), found.channel(theirs)].map(|c| c.unwrap_or_else(|| panic!("{theirs}")));
            assert_eq!(a.sample_type, b.sample_type);
            assert!(a.samples.iter().zip(&b.samples).all(|(a, b)| sign * a == *b), "{theirs} {compression:?}");
        }
        assert!(found.channel("ViewLayer.Combined.R").is_some());
        assert_eq!(found.metadata.cryptomattes[0].layer, "ViewLayer.CryptoObject");
        assert_eq!(found.metadata.cryptomattes[0].names, expected.metadata.cryptomattes[0].names);
    }
    // What shows the beauty alone is the same by any name.
    let [one, other] = [Profile::Nuke, Profile::Blender].map(|profile| {
        let path = directory.path().join("a.png");
        output::write(&picture(), &path, &WriteOptions { profile, ..WriteOptions::default() }).unwrap();
        std::fs::read(path).unwrap()
    });
    assert!(one == other);
}

#[test]
fn two_eyes_share_a_file_and_keep_their_places() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.exr");
    let left = picture();
    let mut right = picture();
    right.metadata.world_to_camera[3][0] = 99.0;
    for (index, channel) in right.channels.iter_mut().enumerate() {
        channel.samples[3] = 0.5 + index as f32;
    }
    let both = output::pair(left.clone(), right.clone());
    let write = |options: &WriteOptions| {
        output::write(&both, &path, options).unwrap();
        let meta = exr::meta::MetaData::read_from_file(&path, true).unwrap();
        let views = meta.headers[0].own_attributes.multi_view_names.clone().unwrap();
        assert_eq!(views.iter().map(|view| view.to_string()).collect::<Vec<_>>(), ["left", "right"]);
        output::read_exr(&path).unwrap()
    };
    let found = write(&options(Compression::Zip));
    let (left, right) = (as_stored(left), as_stored(right));
    assert_eq!(found.channels.len(), 2 * left.channels.len());
    for channel in &left.channels {
        let name = |view: &str| match channel.name.rsplit_once('.') {
            Some((layer, last)) => format!("{layer}.{view}.{last}"),
            None if view == "left" => channel.name.clone(),
            None => format!("{view}.{}", channel.name),
        };
        assert_eq!(found.channel(&name("left")).unwrap().samples, channel.samples);
        assert_eq!(found.channel(&name("right")).unwrap().samples, right.channel(&channel.name).unwrap().samples);
    }
    assert_eq!(found.metadata.world_to_camera, left.metadata.world_to_camera);
    let right = &right.metadata;
    assert_eq!(found.metadata.right_eye, Some([right.world_to_camera, right.world_to_ndc, right.camera_to_world]));
    let blender = write(&WriteOptions { profile: Profile::Blender, ..options(Compression::Zip) });
    assert!(
        blender.channel("ViewLayer.Combined.left.R").is_some() && blender.channel("ViewLayer.Depth.right.Z").is_some()
    );
    #[cfg(feature = "oiio")]
    assert_eq!(write(&WriteOptions { writer: Writer::Oiio, ..options(Compression::Zip) }).channels, found.channels);

    // OpenEXR's own tool makes the same names of two files of one view. It leaves the chunk counts of the first file in its
    // header, whatever compression it writes, so that OpenImageIO has to read it.
    #[cfg(feature = "oiio")]
    {
        let single = |name: &str, picture: &Picture| {
            let path = directory.path().join(name);
            output::write(picture, &path, &options(Compression::Zip)).unwrap();
            path.to_str().unwrap().to_owned()
        };
        let (one, other) = (single("l.exr", &left), single("r.exr", &picture()));
        let theirs = directory.path().join("theirs.exr");
        if tool("exrmultiview", &["left", &one, "right", &other], &theirs).is_some() {
            let names = |path: &Path| {
                let parts = output::read_with_oiio(path).unwrap();
                let mut names: Vec<_> = parts.into_iter().flat_map(|part| part.channels).map(|c| c.0).collect();
                names.sort();
                names
            };
            write(&options(Compression::Zip));
            assert_eq!(names(&theirs), names(&path));
        }
    }
}

#[test]
fn dwaa_splits_the_file_and_leaves_data_untouched() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.exr");
    let expected = as_stored(picture());
    output::write(&picture(), &path, &options(Compression::Dwaa)).unwrap();
    let found = output::read_exr(&path).unwrap();
    let colour = |name: &str| matches!(name.rsplit('.').next(), Some("R" | "G" | "B"));
    assert_same_channels(&found, &expected, |name| !colour(name));
    // Lossy, but a picture still, and really lossy: else the part would not be DWA.
    let red = |p: &Picture| p.channel("R").unwrap().samples.clone();
    let worst = red(&found).iter().zip(red(&expected)).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(worst > 0.0 && worst < 0.5, "{worst}");
    assert_every_attribute(&path, &expected);

    use exr::meta::attribute::Compression as C;
    let meta = exr::meta::MetaData::read_from_file(&path, true).unwrap();
    let parts: Vec<_> = meta
        .headers
        .iter()
        .map(|h| (h.own_attributes.layer_name.clone().unwrap().to_string(), h.compression))
        .collect();
    let expected = [("rgba".into(), C::DWAA(Some(45.0))), ("data".into(), C::ZIP16), ("crypto".to_string(), C::ZIP16)];
    assert_eq!(parts, expected);
    if let Some(text) = tool("exrinfo", &["-v"], &path) {
        assert!(text.contains("rgba") && text.contains("crypto"), "{text}");
    }
}

#[test]
fn reproducible_files_are_equal_to_the_byte_and_tell_no_time() {
    let directory = tempfile::tempdir().unwrap();
    for compression in [Compression::Zip, Compression::Dwaa] {
        let write = |name: &str, seconds: f64, captured| {
            let path = directory.path().join(name);
            let mut picture = picture();
            picture.metadata.seconds = seconds;
            let options = WriteOptions { compression, reproducible: true, captured, ..WriteOptions::default() };
            output::write(&picture, &path, &options).unwrap();
            std::fs::read(&path).unwrap()
        };
        let first = write("a.exr", 1.0, None);
        let second = write("b.exr", 2.0, Some(time::macros::datetime!(1999-01-02 03:04:05 UTC)));
        assert!(first == second);
        let contains = |word: &[u8]| first.windows(word.len()).any(|w| w == word);
        assert!(contains(b"whitewater:version") && !contains(b"capDate") && !contains(b"whitewater:seconds"));
    }
}

#[test]
fn attributes_are_sorted_in_every_header() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.exr");
    output::write(&picture(), &path, &options(Compression::Zip)).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    let mut rest = &bytes[8..];
    let mut names = Vec::new();
    while rest[0] != 0 {
        let word = |rest: &mut &[u8]| {
            let end = rest.iter().position(|b| *b == 0).unwrap();
            let word = String::from_utf8(rest[..end].to_vec()).unwrap();
            *rest = &rest[end + 1..];
            word
        };
        names.push(word(&mut rest));
        word(&mut rest);
        let size = u32::from_le_bytes(rest[..4].try_into().unwrap()) as usize;
        rest = &rest[4 + size..];
    }
    assert!(names.len() > 30 && names.is_sorted(), "{names:?}");
}

#[test]
fn what_half_cannot_hold_is_written_as_its_largest_value_and_counted() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.exr");
    let mut picture = picture();
    picture.channels[0].samples[7] = 1e9;
    picture.channels[1].samples[7] = -1e9;
    picture.channels[1].samples[8] = 65510.0;
    picture.channels[2].samples[9] = 65504.0;
    let report = output::write(&picture, &path, &options(Compression::Zip)).unwrap();
    assert_eq!((report.saturated, report.saturated_pixels), (3, 2));
    let found = output::read_exr(&path).unwrap();
    assert_eq!(found.channel("R").unwrap().samples[7], 65504.0);
    assert_eq!(found.channel("G").unwrap().samples[7..9], [-65504.0, 65504.0]);
    assert_same_channels(&found, &as_stored(picture), |_| true);
}

#[test]
fn a_refused_picture_leaves_the_old_file_alone() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.exr");
    std::fs::write(&path, b"an older picture").unwrap();
    let mut bad = picture();
    bad.channels[3].samples[40] = f32::NAN;
    let error = output::write(&bad, &path, &options(Compression::Zip)).unwrap_err();
    assert!(matches!(error, OutputError::NonFinite { ref channel, x: 0, y: 6, .. } if channel == "A"), "{error}");
    bad = picture();
    bad.metadata.fps = 0.0;
    let error = output::write(&bad, &path, &options(Compression::Zip)).unwrap_err().to_string();
    assert!(error.contains("framesPerSecond"), "{error}");
    assert_eq!(std::fs::read(&path).unwrap(), b"an older picture");
    assert_eq!(std::fs::read_dir(&directory).unwrap().count(), 1);
}

#[test]
fn targets_are_checked_before_anything_is_rendered() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name);
    let check = |path: &Path, options: &WriteOptions| output::check(path, options).map_err(|e| e.to_string());
    let plain = WriteOptions::default();
    assert_eq!(check(&at("a.exr"), &plain), Ok(()));
    let error = check(&at("a.gif"), &plain).unwrap_err();
    assert!(error.contains("a.gif") && error.contains(".exr .png"), "{error}");
    let error = check(&at("none/a.exr"), &plain).unwrap_err();
    assert!(error.contains("none does not exist"), "{error}");
    std::fs::create_dir(at("folder.exr")).unwrap();
    assert!(check(&at("folder.exr"), &plain).unwrap_err().contains("is a folder"));
    let oiio = check(&at("a.exr"), &WriteOptions { writer: Writer::Oiio, ..plain });
    if cfg!(feature = "oiio") {
        assert_eq!(oiio, Ok(()));
    } else {
        assert!(oiio.unwrap_err().contains("built without"));
    }
}

#[test]
fn files_that_are_no_picture_are_refused_by_name() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.exr");
    assert!(matches!(output::read_exr(&path), Err(OutputError::Io { .. })));
    std::fs::write(&path, b"no picture").unwrap();
    assert!(output::read_exr(&path).unwrap_err().to_string().contains("a.exr"));
    output::write(&picture(), &path, &options(Compression::Zip)).unwrap();
    let whole = std::fs::read(&path).unwrap();
    for keep in [0, 4, 100, whole.len() / 2, whole.len() - 1] {
        std::fs::write(&path, &whole[..keep]).unwrap();
        assert!(output::read_exr(&path).is_err(), "{keep} of {} bytes were accepted", whole.len());
    }
}

#[test]
fn openexrs_own_tools_read_the_file() {
    let directory = tempfile::tempdir().unwrap();
    for compression in [Compression::Zip, Compression::Dwaa] {
        let path = directory.path().join(format!("{compression:?}.exr"));
        output::write(&picture(), &path, &options(compression)).unwrap();
        if let Some(text) = tool("exrinfo", &["-v"], &path) {
            for expected in ["dataWindow", "[ -3, 5 - 33 45", "[ 0, 0 - 31 47", "whitewater:tolerance"] {
                assert!(text.contains(expected), "exrinfo does not say `{expected}`:\n{text}");
            }
        }
        if let Some(text) = tool("exrheader", &[], &path) {
            for expected in ["24000/1001 (23.976", "time 00:00:51:10", "red   (0.64 0.33)", "increasing y"] {
                assert!(text.contains(expected), "exrheader does not say `{expected}`:\n{text}");
            }
        }
        if let Some(text) = tool("oiiotool", &["--info", "-v", "-a", "--stats"], &path) {
            for expected in [
                "37 x   41",
                "pixel data origin: x=-3, y=5",
                "full/display size: 32 x 48",
                "whitewater:solver: \"univariate\"",
                "NanCount: 0 0",
            ] {
                assert!(text.contains(expected), "oiiotool does not say `{expected}`:\n{text}");
            }
        }
    }
}

#[test]
fn a_png_beside_shows_the_same_window() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.png");
    output::write(&picture(), &path, &WriteOptions { view: View::Filmic, ..WriteOptions::default() }).unwrap();
    let image = image::open(&path).unwrap();
    // 37 columns from -3 clipped to 32; 41 rows from 5 clipped to 43.
    assert_eq!((image.width(), image.height()), (32, 41));
}

#[cfg(feature = "oiio")]
mod openimageio {
    use super::*;
    use whitewater::output::{OiioPart, read_with_oiio};

    const ALL: [Compression; 5] =
        [Compression::Zip, Compression::Zips, Compression::Piz, Compression::Dwaa, Compression::None];

    fn attribute<'a>(part: &'a OiioPart, name: &str) -> Option<&'a str> {
        part.attributes.iter().find(|(n, _)| n.eq_ignore_ascii_case(name)).map(|(_, text)| text.as_str())
    }

    /// What OpenImageIO read, as a picture.
    fn merged(parts: &[OiioPart]) -> Picture {
        let mut picture = Picture { display: parts[0].display, data: parts[0].data, ..Picture::default() };
        for part in parts {
            assert_eq!((part.display, part.data), (picture.display, picture.data));
            let count = part.channels.len();
            for (c, (name, sample_type)) in part.channels.iter().enumerate() {
                let samples = part.samples.iter().skip(c).step_by(count).copied().collect();
                picture.channels.push(Channel { name: name.clone(), sample_type: *sample_type, samples });
            }
        }
        picture
    }

    fn lossless(compression: Compression) -> impl Fn(&str) -> bool {
        move |name| compression != Compression::Dwaa || !matches!(name.rsplit('.').next(), Some("R" | "G" | "B"))
    }

    #[test]
    fn openimageio_reads_what_the_crate_wrote() {
        let directory = tempfile::tempdir().unwrap();
        let expected = as_stored(picture());
        for compression in ALL {
            let path = directory.path().join(format!("{compression:?}.exr"));
            output::write(&picture(), &path, &options(compression)).unwrap();
            let parts = read_with_oiio(&path).unwrap();
            let found = merged(&parts);
            assert_eq!((found.display, found.data), (expected.display, expected.data));
            assert_same_channels(&found, &expected, lossless(compression));
            let names: Vec<_> = parts.iter().map(|p| p.name.as_str()).collect();
            if compression == Compression::Dwaa {
                assert_eq!(names, ["rgba", "data", "crypto"]);
                assert!(parts[0].compression.starts_with("dwaa") && parts[1].compression == "zip");
            } else {
                assert_eq!(names, [""]);
                assert_eq!(parts[0].compression, format!("{compression:?}").to_lowercase());
            }
            for part in &parts {
                for (name, text) in [
                    ("DateTime", "2026:11:22 10:20:30"),
                    ("Copyright", "Sigríður & Søn"),
                    ("ImageDescription", "a comment"),
                    ("ExposureTime", "0.0625"),
                    ("FNumber", "2.5"),
                    ("focus", "12.5"),
                    ("FramesPerSecond", "24000/1001"),
                    ("smpte:TimeCode", "00:00:51:10"),
                    ("imageCounter", "1234"),
                    ("utcOffset", "-7200"),
                    ("pinholeFocalLength", "32.5"),
                    ("whitewater:version", env!("CARGO_PKG_VERSION")),
                    ("whitewater:scene", "0123456789abcdef"),
                    ("whitewater:samples", "16"),
                    ("whitewater:solver", "univariate"),
                    ("whitewater:tolerance", "0.02 px"),
                    ("whitewater:seconds", "3.5"),
                    ("whitewater:complete", "1"),
                    ("cryptomatte/3ae39a5/name", "CryptoObject"),
                    ("cryptomatte/3ae39a5/hash", "MurmurHash3_32"),
                    ("cryptomatte/3ae39a5/conversion", "uint32_to_float32"),
                    ("cryptomatte/3ae39a5/manifest", &picture().metadata.cryptomattes[0].manifest()),
                    ("PixelAspectRatio", "1"),
                    ("screenWindowWidth", "1"),
                    ("sensorOverallDimensions", "16, 24"),
                    ("chromaticities", "0.64, 0.33, 0.3, 0.6, 0.15, 0.06, 0.3127, 0.329"),
                ] {
                    assert_eq!(attribute(part, name), Some(text), "{name}");
                }
                for (name, first) in
                    [("worldtocamera", "0.25"), ("worldtoNDC", "-7.5"), ("whitewater:cameraToWorld", "100")]
                {
                    let text = attribute(part, name).unwrap_or_default();
                    let values: Vec<f64> =
                        text.split([',', ' ']).filter(|v| !v.is_empty()).map(|v| v.parse().unwrap()).collect();
                    let start: f64 = first.parse().unwrap();
                    assert!(values.iter().enumerate().all(|(i, v)| *v == start + i as f64), "{name}: {text}");
                    assert_eq!(values.len(), 16);
                }
            }
        }
    }

    #[test]
    fn the_crate_reads_what_openimageio_wrote() {
        let directory = tempfile::tempdir().unwrap();
        let expected = as_stored(picture());
        for compression in ALL {
            let path = directory.path().join(format!("{compression:?}.exr"));
            let options = WriteOptions { writer: Writer::Oiio, ..options(compression) };
            output::write(&picture(), &path, &options).unwrap();
            let found = output::read_exr(&path).unwrap();
            assert_eq!((found.display, found.data), (expected.display, expected.data));
            assert_same_channels(&found, &expected, lossless(compression));
            assert_every_attribute(&path, &expected);
            let ours: Vec<_> = exr::meta::MetaData::read_from_file(&path, true).unwrap().headers.to_vec();
            let names: Vec<_> =
                ours.iter().filter_map(|h| h.own_attributes.layer_name.as_ref().map(|n| n.to_string())).collect();
            let expected: &[&str] = if compression == Compression::Dwaa { &["rgba", "data", "crypto"] } else { &[] };
            assert_eq!(names, expected);
        }
    }

    #[test]
    fn channels_of_one_type_keep_it() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.exr");
        for kept in [SampleType::Half, SampleType::Float] {
            let mut picture = picture();
            picture.channels.retain(|c| c.sample_type == kept);
            let options = WriteOptions { writer: Writer::Oiio, ..options(Compression::Zip) };
            output::write(&picture, &path, &options).unwrap();
            assert_same_channels(&output::read_exr(&path).unwrap(), &as_stored(picture), |_| true);
        }
    }

    #[test]
    fn reproducible_files_carry_no_date_of_openimageios_own() {
        let directory = tempfile::tempdir().unwrap();
        let write = |name: &str| {
            let path = directory.path().join(name);
            let options = WriteOptions { writer: Writer::Oiio, reproducible: true, ..WriteOptions::default() };
            let mut picture = picture();
            picture.data.x = 0;
            output::write(&picture, &path, &options).unwrap();
            std::fs::read(&path).unwrap()
        };
        let (exr, tiff) = (write("a.exr"), write("a.tif"));
        for (bytes, what) in [(&exr, "capDate"), (&exr, "DateTime"), (&exr, "whitewater:seconds"), (&tiff, "20")] {
            // A TIFF's date starts with the century and has colons after the year.
            let found = bytes.windows(what.len() + 3).any(|w| {
                w.starts_with(what.as_bytes())
                    && (what != "20" || (w[4] == b':' && w[2..4].iter().all(u8::is_ascii_digit)))
            });
            assert!(!found, "{what}");
        }
        assert!(write("b.exr") == exr && write("b.tif") == tiff);
    }

    #[test]
    fn half_is_saturated_here_too() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.exr");
        let mut picture = picture();
        picture.channels[0].samples[7] = 1e9;
        picture.channels[1].samples[7] = -1e9;
        let options = WriteOptions { writer: Writer::Oiio, ..options(Compression::Zip) };
        assert_eq!(output::write(&picture, &path, &options).unwrap().saturated, 2);
        let found = output::read_exr(&path).unwrap();
        assert_eq!(found.channel("R").unwrap().samples[7], 65504.0);
        assert_eq!(found.channel("G").unwrap().samples[7], -65504.0);
    }

    #[test]
    fn tiff_has_every_channel_scene_linear() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.tif");
        let mut picture = picture();
        picture.data = Window { x: 2, y: 3, ..picture.data };
        let options = WriteOptions { writer: Writer::Oiio, ..options(Compression::Dwaa) };
        output::write(&picture, &path, &options).unwrap();
        let parts = read_with_oiio(&path).unwrap();
        assert_eq!((parts.len(), parts[0].channels.len(), parts[0].data), (1, picture.channels.len(), picture.data));
        // TIFF does not keep names: channels stand in the order of their names.
        let mut sorted = picture.channels.clone();
        sorted.sort_by(|a, b| a.name.cmp(&b.name));
        for (c, channel) in sorted.iter().enumerate() {
            let found: Vec<f32> = parts[0].samples.iter().skip(c).step_by(sorted.len()).copied().collect();
            assert!(found == channel.samples, "{}", channel.name);
        }
        assert_eq!(attribute(&parts[0], "Copyright"), Some("Sigríður & Søn"));
    }

    #[test]
    fn what_openimageio_refuses_is_an_error_and_leaves_nothing() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.exr");
        std::fs::write(&path, b"no picture").unwrap();
        assert!(matches!(read_with_oiio(&path), Err(OutputError::Oiio { .. })));
        // TIFF knows no pixels left of the frame; OpenImageIO would lose the window without a word.
        let path = directory.path().join("a.tif");
        let options = WriteOptions { writer: Writer::Oiio, ..WriteOptions::default() };
        assert!(matches!(output::write(&picture(), &path, &options), Err(OutputError::Unsupported { .. })));
        assert_eq!(std::fs::read_dir(&directory).unwrap().count(), 1);
    }
}

/// A deep picture as it comes from a scene, read by OpenImageIO and by the flat picture beside it.
#[cfg(feature = "oiio")]
#[test]
fn a_deep_file_flattens_to_the_flat_picture_beside_it() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("s.exr");
    let render = |more: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_whitewater"));
        command.args(["render", "scenes/small/scene.toml", "-q", "--deep", "--set", "sky.visible=false"]);
        command.args(["--set", "render.width=64", "--set", "render.height=40", "--set", "output.deep.color=true"]);
        command.args(more).output().unwrap()
    };
    let done = render(&["-o", out.to_str().unwrap()]);
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let flat = output::read_exr(&out).unwrap();
    let deep = output::read_deep(&folder.path().join("s.deep.exr")).unwrap();
    assert_eq!((deep.display, deep.data), (flat.display, flat.data));
    let mut several = 0;
    for index in 0..64 * 40 {
        let pixel = deep.pixel(index);
        several += usize::from(pixel.len() > 1);
        let (alpha, light) = output::DeepSample::flatten(pixel);
        let value = |name: &str| flat.channel(name).unwrap().samples[index];
        assert!((alpha - value("A")).abs() < 1e-3, "{index}: {alpha} {}", value("A"));
        for (light, name) in light.into_iter().zip(["R", "G", "B"]) {
            // Half rounds the flat value once, and each sample's.
            assert!(
                (light - value(name)).abs() < 2e-3 * value(name).max(1.0),
                "{index} {name}: {light} {}",
                value(name)
            );
        }
    }
    assert!(several > 20, "{several}");

    let refused = render(&["-o", folder.path().join("s.png").to_str().unwrap()]);
    assert_eq!(refused.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&refused.stderr).contains("--deep"));
}

/// ACEScg by both writers: the colours are converted, the data are not, and what is shown stays what it was.
#[test]
fn acescg_is_another_way_to_say_the_same_colours() {
    let folder = tempfile::tempdir().unwrap();
    let plain = picture();
    let shown = |picture: &Picture, name: &str| {
        let path = folder.path().join(name);
        let mut whole = picture.clone();
        // A display format shows what lies in the frame.
        whole.display = (40, 60);
        output::write(&whole, &path, &WriteOptions::default()).unwrap();
        std::fs::read(path).unwrap()
    };
    let expected = shown(&plain, "plain.bmp");
    let mut writers = vec![Writer::Exr];
    if cfg!(feature = "oiio") {
        writers.push(Writer::Oiio);
    }
    for writer in writers {
        let path = folder.path().join(format!("{writer:?}.exr"));
        let options = WriteOptions { writer, colorspace: Colorspace::Acescg, ..WriteOptions::default() };
        output::write(&plain, &path, &options).unwrap();
        let read = output::read_exr(&path).unwrap();
        assert_eq!(read.metadata.colorspace, Colorspace::Acescg);
        let value = |picture: &Picture, name: &str| picture.channel(name).unwrap().samples[77];
        let [r, g, b] = ["R", "G", "B"].map(|name| value(&plain, name));
        let red = 0.613_097 * r + 0.339_523 * g + 0.047_379 * b;
        assert!((value(&read, "R") - red).abs() < 2e-3, "{} {red}", value(&read, "R"));
        assert_eq!(value(&read, "Z"), value(&plain, "Z"));
        let seen = shown(&read, "seen.bmp");
        let pixels = |bytes: &[u8]| image::load_from_memory(bytes).unwrap().into_rgba8().into_raw();
        // Half rounds twice.
        let far = pixels(&seen).into_iter().zip(pixels(&expected)).filter(|(a, b)| a.abs_diff(*b) > 2).count();
        assert!(far <= 8, "{writer:?}: {far} samples differ");
    }
}
