//! The simulation's files through the library: what is read and written, and each kind of damage with its place.

use std::io::{Cursor, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use proptest::prelude::*;
use whitewater::state::{
    Columns, Encoding, Frame, MAX_LISTED, Particles, Place, Problem, StateError, read_frame, read_model, save_frame,
    save_model, write_frame_npz, write_frame_text,
};
use zip::write::SimpleFileOptions;

/// m; docs/formats.md: a column under it is dry.
const DRY: f64 = 0.001;

fn here(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(path)
}

/// Reads bytes as a frame, from a file whose name says nothing.
fn read(bytes: &[u8]) -> Result<Frame, StateError> {
    let mut file = tempfile::NamedTempFile::new().unwrap();
    file.write_all(bytes).unwrap();
    read_frame(file.path(), DRY)
}

/// The problems of a damaged file, which must be found quickly.
fn problems(bytes: &[u8]) -> Vec<Problem> {
    let start = Instant::now();
    let result = read(bytes);
    assert!(start.elapsed() < Duration::from_secs(1), "took {:?}", start.elapsed());
    match result {
        Err(StateError::Damaged { problems, .. }) => problems,
        other => panic!("not noticed: {other:?}"),
    }
}

fn shown(problems: &[Problem]) -> String {
    problems.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n")
}

// ---- Text ----

const TEXT: &str = "\
whitewater-frame 1
time     0.28                    # s
origin   -3.0 12.5
width    0.25 0.25
columns  4 3
0 1 0 0 0
1 2 0 0 0
2 3 0 0 0
3 4 0 0 0
4 5 0 0 0
5 6 0 0 0
6 7 0 0 0
7 8 0 0 0
8 9 0 0 0
9 10 0 0 0
10 11 0 0 0
11 12 4410 0.8 -0.5
particles 2
1 2 3 4 5 6 0.5 0.1
-1 -2 -3 -4 -5 -6 0.25 0
end
";

#[test]
fn text_is_read_row_by_row_with_x_fastest() {
    let frame = read(TEXT.as_bytes()).unwrap();
    assert_eq!((frame.columns.nx, frame.columns.nz), (4, 3));
    assert_eq!(frame.columns.base[4 + 2], 6.0);
    assert_eq!((frame.columns.pressure[11], frame.columns.flow[11]), (4410.0, [0.8, -0.5]));
    assert_eq!((frame.particles.position[1], frame.particles.age[0]), ([-1.0, -2.0, -3.0], 0.1));
}

#[test]
fn dos_lines_comments_and_a_missing_last_line_feed_change_nothing() {
    let frame = read(TEXT.as_bytes()).unwrap();
    let dos = TEXT.replace('\n', "  # comment\r\n\r\n");
    assert_eq!(read(dos.as_bytes()).unwrap(), frame);
    assert_eq!(read(TEXT.trim_end().as_bytes()).unwrap(), frame);
    assert_eq!(read(format!("# before\n\n{TEXT}\n# after\n").as_bytes()).unwrap(), frame);
}

#[test]
fn each_kind_of_damage_to_text_names_its_line() {
    let cases = [
        // Not a frame at all.
        ("whitewater-frame 1", "whitewater-frame 2", 1, "version `2`; expected `whitewater-frame 1`"),
        ("whitewater-frame 1", "whitewater-model 1", 1, "found `whitewater-model 1`; expected `whitewater-frame 1`"),
        (TEXT, "", 0, "the file ends here; expected `whitewater-frame 1`"),
        // The order of the lines.
        ("time     0.28", "width 1 1", 2, "found `width 1 1`; expected `time t`"),
        ("origin   -3.0 12.5\n", "", 3, "found `width    0.25 0.25`; expected `origin x z`"),
        ("columns  4 3\n", "", 5, "found `0 1 0 0 0`; expected `columns nx nz`"),
        ("particles 2\n", "", 18, "2 rows too many"),
        // Sizes.
        ("columns  4 3", "columns 2 6", 5, "`columns 2 6`; expected nx nz, whole numbers of at least 3"),
        ("columns  4 3", "columns 4 2", 5, "`columns 4 2`; expected nx nz, whole numbers of at least 3"),
        ("columns  4 3", "columns 4", 5, "`columns 4`; expected nx nz"),
        ("columns  4 3", "columns -4 3", 5, "`columns -4 3`; expected nx nz"),
        ("columns  4 3", "columns 4.0 3", 5, "`columns 4.0 3`; expected nx nz"),
        ("columns  4 3", "columns 2147483648 3", 5, "`columns 2147483648 3`; expected nx nz"),
        ("columns  4 3", "columns 4294967296 4294967296", 5, "`columns 4294967296 4294967296`; expected nx nz"),
        ("columns  4 3", "columns 16384 16384", 5, "268435456 rows of columns; expected at most "),
        ("particles 2", "particles 100000000", 18, "100000000 rows of particles; expected at most "),
        ("particles 2", "particles -1", 18, "`particles -1`; expected the number of particles"),
        ("width    0.25 0.25", "width 0.25 0", 4, "width 0.25 0; expected a width above 0"),
        ("width    0.25 0.25", "width -1 0.25", 4, "width -1 0.25; expected a width above 0"),
        ("width    0.25 0.25", "width 0.25", 4, "width: 1 number in `0.25`; expected 2 numbers: dx dz"),
        // Numbers.
        ("time     0.28", "time nan", 2, "time: t = `nan`; expected a finite number"),
        ("origin   -3.0", "origin inf", 3, "origin: x = `inf`; expected a finite number"),
        ("\n1 2 0 0 0", "\n1 2 NaN 0 0", 7, "pressure = `NaN`; expected a finite number"),
        ("\n1 2 0 0 0", "\n1 2 0 0 -inf", 7, "flow_z = `-inf`; expected a finite number"),
        ("\n1 2 0 0 0", "\n1 2 0 1e400 0", 7, "flow_x = `1e400`; expected a finite number"),
        ("\n1 2 0 0 0", "\n1 2 0 0", 7, "4 numbers in `1 2 0 0`; expected 5 numbers: base top pressure flow_x flow_z"),
        ("\n1 2 0 0 0", "\n1 2 0 0 0 0", 7, "6 numbers in `1 2 0 0 0 0`; expected 5 numbers"),
        ("\n1 2 0 0 0", "\n1 2 0x0 0 0", 7, "pressure = `0x0`; expected a number"),
        (
            "\n1 2 0 0 0",
            "\n1 0.99 0 0 0",
            7,
            "top 0.99 is 0.010000000000000009 m below base 1; expected top at most 0.001 m",
        ),
        ("0.5 0.1", "-0.5 0.1", 19, "mass = -0.5; expected at least 0"),
        ("0.25 0\n", "0.25 -1e-9\n", 20, "age = -0.000000001; expected at least 0"),
        ("1 2 3 4 5 6 0.5 0.1", "1 2 3 4 5 6 0.5", 19, "7 numbers in"),
        ("\n-1 -2 -3", "\n-1 infinity -3", 20, "y = `infinity`; expected a finite number"),
        // Short and long.
        ("11 12 4410 0.8 -0.5\n", "", 17, "found `particles 2`; expected row 12 of 12 of the columns"),
        ("particles 2\n", "7 7 0 0 0\nparticles 2\n", 18, "1 row too many, from `7 7 0 0 0` on"),
        ("-1 -2 -3 -4 -5 -6 0.25 0\n", "", 20, "found `end`; expected row 2 of 2 of the particles"),
        ("end\n", "1 1 1 1 1 1 1 1\nend\n", 21, "1 row too many"),
        ("end\n", "", 20, "the file ends here; expected `end`"),
        ("end\n", "en", 21, "found `en`; expected `end`"),
        ("end\n", "end\nend\n", 22, "found `end`; expected nothing after `end`"),
    ];
    for (from, to, line, expected) in cases {
        assert!(TEXT.contains(from), "{from:?}");
        let found = problems(TEXT.replacen(from, to, 1).as_bytes());
        assert_eq!(found[0].place, Place::Line(line), "{from:?} -> {to:?}: {}", shown(&found));
        assert!(found[0].to_string().contains(expected), "{from:?} -> {to:?}: {}", shown(&found));
    }
}

#[test]
fn text_that_is_cut_anywhere_never_passes_for_a_whole_file() {
    let whole = TEXT.trim_end().len();
    for length in 0..whole {
        assert!(!problems(&TEXT.as_bytes()[..length]).is_empty(), "cut at {length}");
    }
}

#[test]
fn every_bad_row_is_listed_up_to_a_limit_and_the_rest_counted() {
    let mut text = "whitewater-frame 1\ntime 0\norigin 0 0\nwidth 1 1\ncolumns 10 10\n".to_string();
    text.push_str(&"0 nan 0 0 0\n".repeat(100));
    text.push_str("particles 1\n0 0 0 0 0 0 -1 0\nend\n");
    let mut file = tempfile::NamedTempFile::new().unwrap();
    file.write_all(text.as_bytes()).unwrap();
    let error = read_frame(file.path(), DRY).unwrap_err();
    let message = error.to_string();
    let StateError::Damaged { problems, more, path } = error else { panic!("{error:?}") };
    assert_eq!((problems.len(), more), (MAX_LISTED, 81));
    assert_eq!(problems[3].place, Place::Line(9));
    assert!(message.contains(&format!("{}:9: top = `nan`", path.display())), "{message}");
}

#[test]
fn the_dry_threshold_decides_how_far_the_top_may_lie_under_the_base() {
    let text = TEXT.replacen("\n1 2 0 0 0", "\n1 0.9375 0 0 0", 1);
    let mut file = tempfile::NamedTempFile::new().unwrap();
    file.write_all(text.as_bytes()).unwrap();
    assert!(read_frame(file.path(), 0.0625).is_ok());
    assert!(matches!(read_frame(file.path(), 0.0624), Err(StateError::Damaged { .. })));
    for threshold in [f64::NAN, -1.0, f64::INFINITY] {
        assert!(matches!(read_frame(file.path(), threshold), Err(StateError::DryThreshold(_))));
    }
}

#[test]
fn huge_finite_numbers_are_read_as_they_are() {
    let text = TEXT.replacen("\n1 2 0 0 0", "\n-1e300 1e300 1e308 -1.7e308 5e-324", 1);
    let frame = read(text.as_bytes()).unwrap();
    assert_eq!((frame.columns.top[1], frame.columns.flow[1]), (1e300, [-1.7e308, 5e-324]));
    let mut out = Vec::new();
    write_frame_text(&frame, &mut out).unwrap();
    assert_eq!(read(&out).unwrap(), frame);
}

// ---- NPZ ----

/// One array as its `.npy` bytes.
fn npy(descr: &str, fortran_order: bool, shape: &str, data: &[u8]) -> Vec<u8> {
    let order = if fortran_order { "True" } else { "False" };
    let header = format!("{{'descr': {descr}, 'fortran_order': {order}, 'shape': {shape}, }}\n");
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.as_bytes());
    bytes.extend(data);
    bytes
}

fn f8(values: &[f64]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

fn f4(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

/// The arrays of a sound frame of 4 x 3 columns and 2 particles.
fn sound() -> Vec<(&'static str, Vec<u8>)> {
    let base: Vec<f32> = (0..12).map(|i| i as f32).collect();
    let top: Vec<f64> = (0..12).map(|i| f64::from(i) + 0.5).collect();
    vec![
        ("time", npy("'<f8'", false, "()", &f8(&[0.28]))),
        ("origin", npy("'<f8'", false, "(2,)", &f8(&[-3.0, 12.5]))),
        ("width", npy("'<f8'", false, "(2,)", &f8(&[0.25, 0.5]))),
        ("base", npy("'<f4'", false, "(3, 4)", &f4(&base))),
        ("top", npy("'<f8'", false, "(3, 4)", &f8(&top))),
        ("pressure", npy("'<f4'", false, "(3, 4)", &f4(&[7.0; 12]))),
        ("flow", npy("'<f4'", false, "(3, 4, 2)", &f4(&[1.5; 24]))),
        ("position", npy("'<f4'", false, "(2, 3)", &f4(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]))),
        ("velocity", npy("'<f8'", false, "(2, 3)", &f8(&[0.1; 6]))),
        ("mass", npy("'<f4'", false, "(2,)", &f4(&[0.5, 0.25]))),
        ("age", npy("'<f4'", false, "(2,)", &f4(&[0.0, 2.0]))),
        ("id", npy("'<u4'", false, "(2,)", &[9, 0, 0, 0, 255, 255, 255, 255])),
    ]
}

fn archive(arrays: &[(&str, Vec<u8>)]) -> Vec<u8> {
    let mut zip = zip::ZipWriter::new(Cursor::new(Vec::new()));
    for (name, bytes) in arrays {
        zip.start_file(format!("{name}.npy"), SimpleFileOptions::default()).unwrap();
        zip.write_all(bytes).unwrap();
    }
    zip.finish().unwrap().into_inner()
}

/// The sound archive with one array replaced, added, or (empty) left out.
fn with(name: &'static str, bytes: Vec<u8>) -> Vec<u8> {
    let mut arrays: Vec<_> = sound().into_iter().filter(|(other, _)| *other != name).collect();
    if !bytes.is_empty() {
        arrays.push((name, bytes));
    }
    archive(&arrays)
}

fn without(names: &[&str]) -> Vec<u8> {
    let arrays: Vec<_> = sound().into_iter().filter(|(name, _)| !names.contains(name)).collect();
    archive(&arrays)
}

#[test]
fn npz_is_read_with_either_precision() {
    let frame = read(&archive(&sound())).unwrap();
    assert_eq!((frame.time, frame.columns.nx, frame.columns.nz), (0.28, 4, 3));
    assert_eq!((frame.columns.origin, frame.columns.width), ([-3.0, 12.5], [0.25, 0.5]));
    assert_eq!((frame.columns.base[6], frame.columns.top[6]), (6.0, 6.5));
    assert_eq!((frame.particles.position[1], frame.particles.velocity[0]), ([4.0, 5.0, 6.0], [0.1; 3]));
    assert_eq!(frame.particles.id, Some(vec![9, u64::from(u32::MAX)]));
}

#[test]
fn optional_arrays_may_be_missing() {
    let frame = read(&without(&["pressure", "flow", "position", "velocity", "mass", "age", "id"])).unwrap();
    assert_eq!(frame.columns.pressure, [0.0; 12]);
    assert_eq!(frame.columns.flow, [[0.0; 2]; 12]);
    assert_eq!(frame.particles, Particles::default());
}

/// `tests/data/numpy_*.npz` were written by numpy 2.4: base[z, x] = 10 z + x, flow = (base, -base), position = 0 … 14.
#[test]
fn fortran_order_and_big_endian_arrays_by_numpy_are_read_in_place() {
    let frame = read_frame(here("tests/data/numpy_fortran_big_endian.npz"), DRY).unwrap();
    assert_eq!((frame.columns.nx, frame.columns.nz), (3, 4));
    for (z, x) in (0..4).flat_map(|z| (0..3).map(move |x| (z, x))) {
        let (base, i) = (f64::from(10 * z + x), (3 * z + x) as usize);
        assert_eq!((frame.columns.base[i], frame.columns.top[i]), (base, base + 0.5));
        assert_eq!(frame.columns.flow[i], [base, -base]);
    }
    assert_eq!(frame.particles.position[4], [12.0, 13.0, 14.0]);
    assert_eq!(frame.particles.velocity[1], [-3.0, -4.0, -5.0]);
    assert_eq!(frame.particles.id, Some(vec![7, 8, 9, 10, 11]));
    let extra: Vec<_> = frame.extra.iter().map(|a| (a.name.as_str(), a.shape.as_slice(), a.dtype.as_str())).collect();
    assert_eq!(extra, [("foam", &[4, 3][..], "<f2"), ("notes", &[2][..], "<U2")]);

    let bare = read_frame(here("tests/data/numpy_without_optional_arrays.npz"), DRY).unwrap();
    assert_eq!((bare.columns.base, bare.particles.mass.len()), (frame.columns.base, 0));
}

#[test]
fn each_kind_of_damage_to_npz_names_its_array() {
    let zeros = |descr: &str, shape: &str, bytes: usize| npy(&format!("'{descr}'"), false, shape, &vec![0; bytes]);
    let mut bad_top: Vec<f64> = (0..12).map(f64::from).collect();
    bad_top[6] = 5.5;
    let mut nan = [0.0_f32; 24];
    nan[13] = f32::NAN;
    let element = |name: &str, index: &[u64]| Place::Element(name.into(), index.to_vec());
    let array = |name: &str| Place::Array(name.into());
    let cases = [
        // Missing arrays.
        (without(&["base"]), Place::File, "no array `base`; expected one of f4 or f8"),
        (without(&["width"]), Place::File, "no array `width`; expected one of f8"),
        (without(&["age"]), Place::File, "no array `age`"),
        (without(&["position", "velocity", "mass", "age"]), Place::File, "no array `position`"),
        // Types.
        (with("time", zeros("<i8", "()", 8)), array("time"), "type `<i8`; expected f8"),
        (with("origin", zeros("<f4", "(2,)", 8)), array("origin"), "type `<f4`; expected f8"),
        (with("base", zeros("<f2", "(3, 4)", 24)), array("base"), "type `<f2`; expected f4 or f8"),
        (with("base", npy("[('a', '<f4')]", false, "(3, 4)", &[0; 48])), array("base"), "type `[('a', '<f4')]`"),
        (with("mass", zeros("|O", "(2,)", 16)), array("mass"), "type `|O`; expected f4 or f8"),
        (with("id", zeros("<i8", "(2,)", 16)), array("id"), "type `<i8`; expected u4 or u8"),
        (with("base", b"no numpy array".to_vec()), array("base"), "does not start as a numpy array"),
        // Shapes.
        (with("time", zeros("<f8", "(1,)", 8)), array("time"), "shape (1,); expected shape ()"),
        (with("base", zeros("<f4", "(12,)", 48)), array("base"), "shape (12,); expected shape (nz, nx)"),
        (with("base", zeros("<f4", "(2, 6)", 48)), array("base"), "shape (2, 6); expected shape (nz, nx)"),
        (with("top", zeros("<f4", "(4, 3)", 48)), array("top"), "shape (4, 3); expected shape (3, 4)"),
        (with("pressure", zeros("<f4", "(4, 4)", 64)), array("pressure"), "shape (4, 4); expected shape (3, 4)"),
        (with("flow", zeros("<f4", "(3, 4)", 48)), array("flow"), "shape (3, 4); expected shape (3, 4, 2)"),
        (with("position", zeros("<f4", "(3, 2)", 24)), array("position"), "shape (3, 2); expected shape (n, 3)"),
        (with("velocity", zeros("<f4", "(3, 3)", 36)), array("velocity"), "shape (3, 3); expected shape (2, 3)"),
        (with("mass", zeros("<f4", "(3,)", 12)), array("mass"), "shape (3,); expected shape (2,)"),
        (with("id", zeros("<u8", "(1,)", 8)), array("id"), "shape (1,); expected shape (2,)"),
        // Lengths.
        (with("base", zeros("<f4", "(3, 4)", 47)), array("base"), "shape (3, 4) in "),
        (with("base", zeros("<f4", "(3, 4)", 52)), array("base"), "shape (3, 4) in "),
        (with("base", zeros("<f4", "(2147483648, 2147483648)", 48)), array("base"), "shape (2147483648, 2147483648)"),
        (with("base", zeros("<f4", "(4611686018427387904, 4)", 0)), array("base"), "expected a shape that memory"),
        (with("position", zeros("<f4", "(2147483648, 3)", 24)), array("position"), "shape (2147483648, 3) in "),
        // Numbers.
        (
            with("time", npy("'<f8'", false, "()", &f8(&[f64::INFINITY]))),
            element("time", &[]),
            "inf; expected a finite",
        ),
        (with("width", npy("'<f8'", false, "(2,)", &f8(&[1.0, 0.0]))), array("width"), "width 1 0; expected a width"),
        (
            with("flow", npy("'<f4'", false, "(3, 4, 2)", &f4(&nan))),
            element("flow", &[1, 2, 1]),
            "NaN; expected a finite",
        ),
        (
            with("top", npy("'<f8'", false, "(3, 4)", &f8(&bad_top))),
            element("top", &[1, 2]),
            "top 5.5 is 0.5 m below base 6",
        ),
        (
            with("mass", npy("'<f4'", false, "(2,)", &f4(&[1.0, -2.0]))),
            element("mass", &[1]),
            "mass = -2; expected at least 0",
        ),
        (
            with("age", npy("'<f4'", false, "(2,)", &f4(&[-0.5, 0.0]))),
            element("age", &[0]),
            "age = -0.5; expected at least 0",
        ),
    ];
    for (bytes, place, expected) in cases {
        let found = problems(&bytes);
        assert_eq!(found[0].place, place, "{expected}: {}", shown(&found));
        assert!(found[0].to_string().contains(expected), "{expected}: {}", shown(&found));
    }
}

#[test]
fn an_index_counts_in_c_order_whatever_the_order_in_the_file() {
    // Fortran order of (3, 4): element 3 x + z. Place (2, 1) is number 5.
    let mut heights = [0.0_f32; 12];
    heights[5] = f32::NAN;
    let found = problems(&with("base", npy("'<f4'", true, "(3, 4)", &f4(&heights))));
    assert_eq!(found[0].place, Place::Element("base".into(), vec![2, 1]));
}

#[test]
fn problems_of_several_arrays_are_listed_together() {
    let mut arrays = sound();
    arrays.retain(|(name, _)| !["time", "age"].contains(name));
    arrays.push(("top2", vec![]));
    let found = shown(&problems(&archive(&arrays)));
    assert!(found.contains("`time`") && found.contains("`age`"), "{found}");
    let found = shown(&problems(&archive(&[])));
    assert!(["time", "origin", "width", "base", "top"].iter().all(|name| found.contains(name)), "{found}");
}

#[test]
fn arrays_of_others_are_named_and_never_judged() {
    let mut arrays = sound();
    arrays.push(("foam", npy("'<f4'", false, "(3, 4)", &[0; 48])));
    arrays.push(("broken", b"junk".to_vec()));
    let frame = read(&archive(&arrays)).unwrap();
    assert_eq!((frame.extra[0].name.as_str(), frame.extra[0].shape.as_slice()), ("foam", &[3, 4][..]));
    assert!(frame.extra[1].name == "broken" && frame.extra[1].dtype.starts_with("unreadable"));
}

/// Overwrites the size that the archive's directory declares for an array.
fn declare(bytes: &mut [u8], name: &str, size: u32) {
    let name = format!("{name}.npy");
    let entry = (0..bytes.len() - 46 - name.len())
        .find(|&i| bytes[i..].starts_with(b"PK\x01\x02") && bytes[i + 46..].starts_with(name.as_bytes()))
        .unwrap();
    bytes[entry + 24..entry + 28].copy_from_slice(&size.to_le_bytes());
}

#[test]
fn a_directory_that_lies_about_sizes_is_found_out() {
    // The header and the directory agree on 16384 x 16384 columns; a hundred bytes cannot hold them.
    let base = npy("'<f4'", false, "(16384, 16384)", &[0; 48]);
    let mut bytes = with("base", base.clone());
    declare(&mut bytes, "base", (1 << 30) + base.len() as u32 - 48);
    let found = shown(&problems(&bytes));
    assert!(found.contains("array `base`: 10737419") && found.contains(" bytes packed into "), "{found}");

    // Too little and too much for what was packed, within what deflate could reach.
    for (packed, expected) in [(44, "11 elements; expected 12"), (52, "more than 12 elements")] {
        let base = npy("'<f4'", false, "(3, 4)", &vec![0; packed]);
        let mut bytes = with("base", base.clone());
        declare(&mut bytes, "base", (base.len() - packed + 48) as u32);
        let found = shown(&problems(&bytes));
        assert!(found.contains(expected), "{expected}: {found}");
    }
}

#[test]
fn an_archive_cut_or_prolonged_or_changed_is_found_out() {
    let bytes = archive(&sound());
    for length in (4..bytes.len()).step_by(7) {
        let found = problems(&bytes[..length]);
        assert!(shown(&found).contains("cut off"), "cut at {length}: {}", shown(&found));
    }
    let found = shown(&problems(&[&bytes[..], b"more"].concat()));
    assert!(found.contains("4 bytes after the archive's directory"), "{found}");

    // One bit of packed data: the checksum knows.
    let mut arrays = sound();
    arrays.retain(|(name, _)| *name != "pressure");
    let mut zip = zip::ZipWriter::new(Cursor::new(Vec::new()));
    let stored = SimpleFileOptions::default().compression_method(zip::CompressionMethod::Stored);
    for (name, bytes) in &arrays {
        zip.start_file(format!("{name}.npy"), stored).unwrap();
        zip.write_all(bytes).unwrap();
    }
    let mut bytes = zip.finish().unwrap().into_inner();
    assert!(read(&bytes).is_ok());
    let flow = bytes.windows(4).position(|w| w == 1.5_f32.to_le_bytes()).unwrap();
    bytes[flow] ^= 1;
    let found = shown(&problems(&bytes));
    assert!(found.contains("array `flow`") && found.contains("checksum"), "{found}");
}

#[test]
fn files_that_are_neither_are_refused_quickly() {
    let noise: Vec<u8> = (0..4_000_000_u64).map(|i| (i.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 56) as u8).collect();
    assert_eq!(problems(&noise).len(), 1);
    assert_eq!(problems(&[b"PK\x03\x04", &noise[..]].concat()).len(), 1);
    assert_eq!(problems(&vec![b' '; 1_000_000]).len(), 1);
    assert!(matches!(read_frame(here("scenes"), DRY), Err(StateError::NotAFile { .. })));
    let gone = read_frame("gone.state", DRY).unwrap_err();
    assert!(matches!(gone, StateError::Io { .. }) && gone.to_string().contains("gone.state"));
}

// ---- What is shipped, and writing ----

#[test]
fn the_shipped_frames_and_model_are_read() {
    let small = read_frame(here("scenes/small/time000.state"), DRY).unwrap();
    assert_eq!((small.columns.nx, small.columns.nz, small.particles.mass.len()), (80, 20, 2800));
    assert_eq!((small.columns.base[0], small.columns.width), (0.8774576, [0.5, 0.5]));
    let valley = read_frame(here("scenes/valley/time000.state"), DRY).unwrap();
    assert_eq!((valley.columns.nx, valley.columns.nz, valley.particles.mass.len()), (400, 400, 100_000));
    let jacksboro = read_frame(here("scenes/jacksboro/time000.state"), DRY).unwrap();
    assert_eq!((jacksboro.columns.nx, jacksboro.columns.nz), (403, 344));
    let model = read_model(here("scenes/small/model.state")).unwrap();
    assert_eq!((model.panels.len(), model.spheres.len(), model.meshes.len()), (1, 2, 0));
    let directory = tempfile::tempdir().unwrap();
    save_model(&model, directory.path().join("model.state")).unwrap();
    assert_eq!(read_model(directory.path().join("model.state")).unwrap(), model);
}

#[test]
fn arrays_are_single_precision_only_where_that_keeps_every_bit() {
    let mut frame = read(&archive(&sound())).unwrap();
    frame.columns.pressure[3] = 1e39;
    let mut out = Cursor::new(Vec::new());
    write_frame_npz(&frame, &mut out).unwrap();
    out.set_position(0);
    // npyz is an independent reader here: ours does not use it.
    let mut archive = npyz::npz::NpzArchive::new(out).unwrap();
    let mut dtype = |name: &str| archive.by_name(name).unwrap().unwrap().dtype().descr();
    assert_eq!([dtype("base"), dtype("top"), dtype("position")], ["'<f4'"; 3]);
    assert_eq!([dtype("velocity"), dtype("pressure"), dtype("time"), dtype("origin")], ["'<f8'"; 4]);
    assert_eq!(dtype("id"), "'<u8'");
    let flow = archive.by_name("flow").unwrap().unwrap();
    assert_eq!(flow.shape(), [3, 4, 2]);
    assert_eq!(flow.into_vec::<f32>().unwrap(), [1.5; 24]);
}

#[test]
fn what_the_reader_would_refuse_is_not_written() {
    let sound = read(TEXT.as_bytes()).unwrap();
    let damage: [fn(&mut Frame); 6] = [
        |f| f.time = f64::NAN,
        |f| f.columns.width[1] = 0.0,
        |f| f.columns.flow[3][1] = f64::INFINITY,
        |f| f.particles.mass[0] = -1.0,
        |f| f.particles.position[1][2] = f64::NAN,
        |f| (f.columns.nx, f.columns.nz) = (2, 6),
    ];
    let directory = tempfile::tempdir().unwrap();
    for (i, damage) in damage.iter().enumerate() {
        let mut frame = sound.clone();
        damage(&mut frame);
        for encoding in [Encoding::Text, Encoding::Npz] {
            let result = save_frame(&frame, directory.path().join("time0.state"), encoding);
            assert!(matches!(result, Err(StateError::Unwritable(_))), "{i}: {result:?}");
        }
    }
    assert_eq!(std::fs::read_dir(directory.path()).unwrap().count(), 0, "a refused frame left a file");
}

// ---- Any frame, any bytes ----

fn number() -> impl Strategy<Value = f64> {
    prop_oneof![
        Just(0.0),
        Just(-0.0),
        any::<f32>().prop_filter_map("finite", |v| v.is_finite().then_some(f64::from(v))),
        any::<f64>().prop_filter("finite", |v| v.is_finite()),
        (-1000_i32..1000).prop_map(|v| f64::from(v) / 10.0),
    ]
}

fn any_frame() -> impl Strategy<Value = Frame> {
    (3_usize..6, 3_usize..6, 0_usize..5, any::<bool>()).prop_flat_map(|(nx, nz, n, identified)| {
        let columns = prop::collection::vec([number(), number(), number(), number(), number()], nx * nz);
        let particles = prop::collection::vec((prop::array::uniform8(number()), any::<u64>()), n);
        let width = (1e-9_f64..1e9, 1e-9_f64..1e9);
        (number(), [number(), number()], width, columns, particles).prop_map(
            move |(time, origin, (dx, dz), columns, particles)| {
                let mut frame = Frame {
                    time,
                    columns: Columns { origin, width: [dx, dz], nx, nz, ..Columns::default() },
                    particles: Particles { id: identified.then(Vec::new), ..Particles::default() },
                    extra: vec![],
                };
                for [a, b, pressure, x, z] in columns {
                    frame.columns.base.push(a.min(b));
                    frame.columns.top.push(a.max(b));
                    frame.columns.pressure.push(pressure);
                    frame.columns.flow.push([x, z]);
                }
                for ([x, y, z, vx, vy, vz, mass, age], id) in particles {
                    frame.particles.position.push([x, y, z]);
                    frame.particles.velocity.push([vx, vy, vz]);
                    frame.particles.mass.push(mass.abs());
                    frame.particles.age.push(age.abs());
                    frame.particles.id.iter_mut().for_each(|ids| ids.push(id));
                }
                frame
            },
        )
    })
}

/// Every number's bits: `==` takes 0 for -0.
fn bits(frame: &Frame) -> Vec<u64> {
    let (c, p) = (&frame.columns, &frame.particles);
    let singles = [&c.base, &c.top, &c.pressure, &p.mass, &p.age].into_iter().flatten();
    let all = singles.chain(c.flow.as_flattened()).chain(p.position.as_flattened()).chain(p.velocity.as_flattened());
    all.chain([&frame.time]).chain(&c.origin).chain(&c.width).map(|v| v.to_bits()).collect()
}

fn encoded(frame: &Frame, encoding: Encoding) -> Vec<u8> {
    let mut out = Cursor::new(Vec::new());
    match encoding {
        Encoding::Text => write_frame_text(frame, &mut out).unwrap(),
        Encoding::Npz => write_frame_npz(frame, &mut out).unwrap(),
    }
    out.into_inner()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn any_frame_survives_text_and_npz_bit_by_bit(frame in any_frame()) {
        let npz = read(&encoded(&frame, Encoding::Npz)).unwrap();
        prop_assert_eq!(bits(&npz), bits(&frame));
        prop_assert_eq!(&npz, &frame);
        let text = read(&encoded(&npz, Encoding::Text)).unwrap();
        prop_assert_eq!(bits(&text), bits(&frame));
    }

    #[test]
    fn any_bytes_are_an_error_and_no_panic(
        start in prop::sample::select(vec![&b""[..], b"PK\x03\x04", b"PK\x05\x06", b"whitewater-frame 1\n"]),
        bytes in prop::collection::vec(any::<u8>(), 0..300),
    ) {
        prop_assert!(read(&[start, &bytes].concat()).is_err());
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 512, failure_persistence: None, ..ProptestConfig::default() })]

    /// Some flips pass (a digit in a text, a date in an archive); none may panic or take long.
    #[test]
    fn flipped_bits_and_cut_files_never_panic(
        npz in any::<bool>(),
        flips in prop::collection::vec((any::<prop::sample::Index>(), 0_u32..8), 0..4),
        keep in prop::option::of(any::<prop::sample::Index>()),
    ) {
        let mut bytes = if npz { archive(&sound()) } else { TEXT.as_bytes().to_vec() };
        for (at, bit) in &flips {
            let at = at.index(bytes.len());
            bytes[at] ^= 1 << bit;
        }
        if let Some(keep) = keep {
            bytes.truncate(keep.index(bytes.len()));
        }
        let start = Instant::now();
        let result = read(&bytes);
        prop_assert!(start.elapsed() < Duration::from_secs(1));
        if let Err(error) = result {
            prop_assert!(matches!(error, StateError::Damaged { .. }), "{error:?}");
        }
    }
}
