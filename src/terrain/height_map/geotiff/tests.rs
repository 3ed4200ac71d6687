//! Files written by the crate's encoder and, where it cannot, byte by byte; then damaged.

use std::io::Cursor;

use tiff::encoder::{Compression, DeflateLevel, TiffEncoder, TiffValue, colortype};

use super::*;
use crate::terrain::{HeightMap, Reading};

/// Tags of a map: projected, north-western corner (500000, 4000100), samples 10 m by 20 m.
#[derive(Clone)]
struct Tags {
    scale: Option<Vec<f64>>,
    tie: Option<Vec<f64>>,
    matrix: Option<Vec<f64>>,
    keys: Vec<u16>,
    missing: Option<&'static str>,
}
impl Default for Tags {
    fn default() -> Self {
        Self {
            scale: Some(vec![10.0, 20.0, 0.0]),
            tie: Some(vec![0.0, 0.0, 0.0, 500_000.0, 4_000_100.0, 0.0]),
            matrix: None,
            keys: directory(&[[MODEL_TYPE, PROJECTED]]),
            missing: None,
        }
    }
}

fn directory(keys: &[[u16; 2]]) -> Vec<u16> {
    let head = [1, 1, 0, keys.len() as u16];
    head.into_iter().chain(keys.iter().flat_map(|[key, value]| [*key, 0, 1, *value])).collect()
}

/// A file of 4 x 3 samples in two strips.
fn written<C: colortype::ColorType>(samples: &[C::Inner], compression: Compression, tags: &Tags) -> Vec<u8>
where
    [C::Inner]: TiffValue,
{
    let mut file = Cursor::new(Vec::new());
    let mut encoder = TiffEncoder::new(&mut file).unwrap().with_compression(compression);
    let mut image = encoder.new_image::<C>(4, 3).unwrap();
    image.rows_per_strip(2).unwrap();
    let directory = image.encoder();
    for (tag, values) in [
        (Tag::ModelPixelScaleTag, &tags.scale),
        (Tag::ModelTiepointTag, &tags.tie),
        (Tag::ModelTransformationTag, &tags.matrix),
    ] {
        if let Some(values) = values {
            directory.write_tag(tag, values.as_slice()).unwrap();
        }
    }
    if !tags.keys.is_empty() {
        directory.write_tag(Tag::GeoKeyDirectoryTag, tags.keys.as_slice()).unwrap();
    }
    if let Some(missing) = tags.missing {
        directory.write_tag(Tag::GdalNodata, missing).unwrap();
    }
    image.write_data(samples).unwrap();
    file.into_inner()
}

fn read_bytes(bytes: &[u8], reading: &Reading) -> Result<HeightMap, TerrainError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("ground.tif");
    std::fs::write(&path, bytes).unwrap();
    HeightMap::read(&path, reading)
}

const HEIGHTS: [i16; 12] = [483, 487, -3, 488, 475, 486, 0, 490, 470, 484, 481, 12];

fn floats() -> Vec<f32> {
    HEIGHTS.iter().map(|height| f32::from(*height) + 0.25).collect()
}

#[test]
fn every_number_and_compression_that_is_promised_is_read() {
    let tags = Tags::default();
    let all =
        [Compression::Uncompressed, Compression::Lzw, Compression::Deflate(DeflateLevel::Fast), Compression::Packbits];
    for compression in all {
        let whole: Vec<f64> = HEIGHTS.iter().map(|height| f64::from(*height)).collect();
        let unsigned: Vec<u16> = HEIGHTS.iter().map(|height| height.unsigned_abs()).collect();
        let wide: Vec<i32> = HEIGHTS.iter().map(|height| i32::from(*height)).collect();
        let broken: Vec<f64> = floats().iter().map(|height| f64::from(*height)).collect();
        for (bytes, expected) in [
            (written::<colortype::GrayI16>(&HEIGHTS, compression, &tags), whole.clone()),
            (written::<colortype::Gray16>(&unsigned, compression, &tags), whole.iter().map(|h| h.abs()).collect()),
            (written::<colortype::GrayI32>(&wide, compression, &tags), whole),
            (written::<colortype::Gray32Float>(&floats(), compression, &tags), broken.clone()),
            (written::<colortype::Gray64Float>(&broken, compression, &tags), broken),
        ] {
            let map = read_bytes(&bytes, &Reading::default()).unwrap();
            assert_eq!((map.nx, map.nz, map.spacing), (4, 3, [10.0, 20.0]));
            assert_eq!(map.origin, [500_005.0, -4_000_090.0]);
            assert_eq!(map.heights, expected);
        }
    }
}

/// Two by two tiles of 16 x 16 for a map of 20 x 18, big-endian, written byte by byte.
fn tiled(sample: impl Fn(u32, u32) -> f32) -> Vec<u8> {
    let mut bytes = b"MM\x00\x2a\x00\x00\x00\x08".to_vec();
    let offsets_at = 8 + 2 + 14 * 12 + 4;
    let tiles_at = offsets_at + 32 + 24 + 16 * 2;
    let entries: [(u16, u16, u32, u32); 14] = [
        (256, 4, 1, 20),
        (257, 4, 1, 18),
        (258, 3, 1, 32 << 16),
        (259, 3, 1, 1 << 16),
        (262, 3, 1, 1 << 16),
        (277, 3, 1, 1 << 16),
        (322, 4, 1, 16),
        (323, 4, 1, 16),
        (324, 4, 4, offsets_at),
        (325, 4, 4, offsets_at + 16),
        (339, 3, 1, 3 << 16),
        (33550, 12, 3, offsets_at + 32),
        (34735, 3, 8, offsets_at + 56),
        (42113, 2, 3, u32::from_be_bytes(*b"-1\0\0")),
    ];
    bytes.extend((entries.len() as u16).to_be_bytes());
    for (tag, kind, count, value) in entries {
        bytes.extend(tag.to_be_bytes().into_iter().chain(kind.to_be_bytes()));
        bytes.extend(count.to_be_bytes().into_iter().chain(value.to_be_bytes()));
    }
    bytes.extend([0; 4]);
    (0..4).for_each(|tile| bytes.extend((tiles_at + 1024 * tile).to_be_bytes()));
    (0..4).for_each(|_| bytes.extend(1024_u32.to_be_bytes()));
    [5.0_f64, 5.0, 0.0].iter().for_each(|value| bytes.extend(value.to_be_bytes()));
    directory(&[[MODEL_TYPE, PROJECTED]]).iter().for_each(|word| bytes.extend(word.to_be_bytes()));
    bytes.resize(tiles_at as usize, 0);
    for tile in 0..4 {
        for row in 0..16 {
            (0..16)
                .for_each(|column| bytes.extend(sample(16 * (tile % 2) + column, 16 * (tile / 2) + row).to_be_bytes()));
        }
    }
    bytes
}

#[test]
fn tiles_and_the_other_byte_order_are_read() {
    let map = read_bytes(&tiled(|column, row| (100 * row + column) as f32), &Reading::default()).unwrap();
    assert_eq!((map.nx, map.nz, map.spacing), (20, 18, [5.0, 5.0]));
    for (index, height) in map.heights.iter().enumerate() {
        assert_eq!(*height, (100 * (index / 20) + index % 20) as f64);
    }
    let holed = tiled(|column, row| if (column, row) == (17, 3) { -1.0 } else { 1.0 });
    let error = read_bytes(&holed, &Reading::default()).unwrap_err().to_string();
    assert!(error.contains("1 of 360") && error.contains("column 17, row 3"), "{error}");
}

#[test]
fn reference_systems_become_metres() {
    let read = |tags: &Tags| {
        read_bytes(&written::<colortype::Gray32Float>(&floats(), Compression::Uncompressed, tags), &Reading::default())
    };
    let geographic = Tags {
        scale: Some(vec![1.0 / 1200.0, 1.0 / 1200.0, 0.0]),
        tie: Some(vec![0.0, 0.0, 0.0, -84.4, 36.5 + 1.5 / 1200.0, 0.0]),
        keys: directory(&[[MODEL_TYPE, GEOGRAPHIC], [RASTER_TYPE, 1], [ANGULAR_UNIT, DEGREE]]),
        ..Tags::default()
    };
    let [x, z] = metres_in_a_degree(36.5).map(|metres| metres / 1200.0);
    let [dx, dz] = read(&geographic).unwrap().spacing;
    assert!((dx - x).abs() < 1e-9 && (dz - z).abs() < 1e-9, "{dx} {dz}");

    // Feet, across and up.
    let keys = directory(&[[MODEL_TYPE, PROJECTED], [LINEAR_UNIT, 9003], [VERTICAL_UNIT, 9002]]);
    let feet = read(&Tags { keys, ..Tags::default() }).unwrap();
    assert!((feet.spacing[0] - 10.0 * 0.304_800_609_601).abs() < 1e-9);
    assert!((feet.heights[0] - 483.25 * 0.3048).abs() < 1e-9);

    // A matrix instead of scale and tie point, rows from the south.
    let matrix = vec![10.0, 0.0, 0.0, 7.0, 0.0, 20.0, 0.0, 1000.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0];
    let keys = directory(&[[MODEL_TYPE, PROJECTED], [RASTER_TYPE, PIXEL_IS_POINT]]);
    let turned = read(&Tags { scale: None, tie: None, matrix: Some(matrix.clone()), keys, ..Tags::default() }).unwrap();
    assert_eq!((turned.spacing, turned.origin), ([10.0, 20.0], [7.0, -1040.0]));
    assert_eq!(turned.heights[..4], [470.25, 484.25, 481.25, 12.25]);

    for (tags, word) in [
        (Tags { keys: Vec::new(), ..Tags::default() }, "GTModelTypeGeoKey"),
        (Tags { keys: directory(&[[MODEL_TYPE, 3]]), ..Tags::default() }, "GTModelTypeGeoKey 3"),
        (
            Tags { keys: directory(&[[MODEL_TYPE, PROJECTED], [LINEAR_UNIT, 9030]]), ..Tags::default() },
            "linear unit: 9030",
        ),
        (Tags { keys: directory(&[[MODEL_TYPE, GEOGRAPHIC], [ANGULAR_UNIT, 9105]]), ..Tags::default() }, "9102"),
        (Tags { keys: directory(&[[MODEL_TYPE, GEOGRAPHIC]]), ..Tags::default() }, "middle latitude"),
        (Tags { scale: Some(vec![0.0, 20.0, 0.0]), ..Tags::default() }, "scale"),
        (Tags { scale: Some(vec![10.0, f64::NAN, 0.0]), ..Tags::default() }, "finite"),
        (Tags { scale: None, ..Tags::default() }, "simulation.terrain.spacing"),
        (Tags { matrix: Some([&[1.0, 0.5], &matrix[2..]].concat()), ..Tags::default() }, "north up"),
        (Tags { missing: Some("none"), ..Tags::default() }, "GDAL_NODATA: `none`"),
    ] {
        let error = read(&tags).unwrap_err().to_string();
        assert!(error.contains("ground.tif") && error.contains(word), "{error} without {word}");
    }
}

#[test]
fn missing_data_is_counted_in_whole_and_in_single_precision() {
    let tags = Tags { missing: Some("-3.4028234663852886e+38"), ..Tags::default() };
    let mut samples = floats();
    (samples[5], samples[9]) = (f32::MIN, f32::NAN);
    let bytes = written::<colortype::Gray32Float>(&samples, Compression::Uncompressed, &tags);
    let error = read_bytes(&bytes, &Reading::default()).unwrap_err().to_string();
    assert!(error.contains("2 of 12") && error.contains("column 1, row 1"), "{error}");
    let crop = Reading { crop: Some([2, 0, 3, 2]), ..Reading::default() };
    assert_eq!(read_bytes(&bytes, &crop).unwrap().heights.len(), 6);
    // The void of 16-bit files needs no tag.
    let mut short = HEIGHTS;
    short[2] = i16::MIN;
    let bytes = written::<colortype::GrayI16>(&short, Compression::Uncompressed, &Tags::default());
    assert!(read_bytes(&bytes, &Reading::default()).unwrap_err().to_string().contains("column 2, row 0"));
}

#[test]
fn a_scene_may_say_what_black_and_white_and_distances_are() {
    let bare = Tags { scale: None, tie: None, keys: Vec::new(), ..Tags::default() };
    let reading = Reading { crop: None, spacing: Some([1.0, 2.0]), heights: Some([10.0, 75.535]) };
    let samples: Vec<u16> = (0..12).map(|i| i * 5000).collect();
    let map = read_bytes(&written::<colortype::Gray16>(&samples, Compression::Uncompressed, &bare), &reading).unwrap();
    assert!(map.spacing == [1.0, 2.0] && (map.heights[3] - 25.0).abs() < 1e-9);
    let map =
        read_bytes(&written::<colortype::Gray32Float>(&[0.5; 12], Compression::Uncompressed, &bare), &reading).unwrap();
    assert!((map.heights[3] - 42.7675).abs() < 1e-9);
    for bytes in [
        written::<colortype::Gray8>(&[7; 12], Compression::Uncompressed, &bare),
        written::<colortype::GrayI16>(&HEIGHTS, Compression::Uncompressed, &bare),
        written::<colortype::RGB16>(&[7; 36], Compression::Uncompressed, &bare),
    ] {
        assert!(read_bytes(&bytes, &reading).unwrap_err().to_string().contains("samples: "));
    }
}

#[test]
fn damaged_files_are_errors_or_other_heights_but_never_panics() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("ground.tif");
    for (compression, stride) in
        [(Compression::Uncompressed, 1), (Compression::Lzw, 5), (Compression::Deflate(DeflateLevel::Fast), 5)]
    {
        let whole = written::<colortype::Gray32Float>(&floats(), compression, &Tags::default());
        for keep in (0..whole.len()).step_by(stride + 6) {
            std::fs::write(&path, &whole[..keep]).unwrap();
            // The directory stands at the end, so that every cut takes something in use.
            let error = HeightMap::read(&path, &Reading::default()).expect_err("half a file").to_string();
            assert!(error.contains("ground.tif"), "{error}");
        }
        for at in (0..whole.len()).step_by(stride) {
            for value in [0, 0xff, whole[at] ^ 1] {
                let mut bytes = whole.clone();
                bytes[at] = value;
                std::fs::write(&path, &bytes).unwrap();
                let _ = HeightMap::read(&path, &Reading::default());
            }
        }
    }
}
