//! Pictures written by the crates that read them, and damaged.

use exr::prelude::{AnyChannel, AnyChannels, Encoding, Image, Layer, LayerAttributes, WritableImage};
use image::{ExtendedColorType, ImageEncoder, codecs::png::PngEncoder};

use super::*;
use crate::terrain::{HeightMap, Reading};

fn png(path: &Path, samples: &[u8], color: ExtendedColorType, nx: u32) {
    let mut bytes = Vec::new();
    let nz = samples.len() as u32 * 8 / u32::from(color.bits_per_pixel()) / nx;
    PngEncoder::new(&mut bytes).write_image(samples, nx, nz, color).unwrap();
    std::fs::write(path, bytes).unwrap();
}

fn exr_file(path: &Path, names: &[&str], samples: impl Fn(usize) -> FlatSamples) {
    let list = names.iter().enumerate().map(|(i, name)| AnyChannel::new(*name, samples(i))).collect();
    let channels = AnyChannels::sort(list);
    let layer = Layer::new((5, 3), LayerAttributes::default(), Encoding::SMALL_LOSSLESS, channels);
    Image::from_layer(layer).write().to_file(path).unwrap();
}

const READING: Reading = Reading { crop: None, spacing: Some([2.0, 3.0]), heights: Some([100.0, 165.535]) };

#[test]
fn sixteen_bits_of_grey_run_from_black_to_white() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("ground.png");
    let samples: Vec<u16> = vec![0, 65535, 1000, 2000, 30000, 7];
    png(&path, &samples.iter().flat_map(|sample| sample.to_ne_bytes()).collect::<Vec<_>>(), ExtendedColorType::L16, 3);
    let map = HeightMap::read(&path, &READING).unwrap();
    assert_eq!((map.nx, map.nz, map.spacing), (3, 2, [2.0, 3.0]));
    for (height, sample) in map.heights.iter().zip(samples) {
        assert!((height - (100.0 + 0.001 * f64::from(sample))).abs() < 1e-9);
    }
    let error = HeightMap::read(&path, &Reading { heights: None, ..READING }).unwrap_err().to_string();
    assert!(error.contains("simulation.terrain.heights"), "{error}");
    let error = HeightMap::read(&path, &Reading { spacing: None, ..READING }).unwrap_err().to_string();
    assert!(error.contains("simulation.terrain.spacing"), "{error}");

    png(&path, &[0; 6], ExtendedColorType::L8, 3);
    assert!(HeightMap::read(&path, &READING).unwrap_err().to_string().contains("8 bits; expected 16 bits"));
    png(&path, &[0; 36], ExtendedColorType::Rgb16, 3);
    assert!(HeightMap::read(&path, &READING).unwrap_err().to_string().contains("expected grey alone"));
}

#[test]
fn an_exr_holds_metres_in_the_first_channel_of_its_kind() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("ground.exr");
    let metres = |channel: usize| FlatSamples::F32((0..15).map(|i| (100 * channel + i) as f32 + 0.25).collect());
    let reading = Reading { heights: None, ..READING };
    for (names, first) in [(&["A", "R", "Y", "Z"][..], 200.25), (&["A", "R", "Z"], 200.25), (&["R"], 0.25)] {
        exr_file(&path, names, metres);
        let map = HeightMap::read(&path, &reading).unwrap();
        assert_eq!((map.nx, map.nz, map.heights[0], map.heights[14]), (5, 3, first, first + 14.0), "{names:?}");
    }
    exr_file(&path, &["G"], metres);
    assert!(HeightMap::read(&path, &reading).unwrap_err().to_string().contains("channels: `G`; expected heights"));
    exr_file(&path, &["Y"], |_| FlatSamples::F32(vec![0.5; 15]));
    assert!((HeightMap::read(&path, &READING).unwrap().heights[3] - 132.7675).abs() < 1e-9);
    exr_file(&path, &["Y"], |_| FlatSamples::F16(vec![half::f16::from_f32(1.5); 15]));
    assert_eq!(HeightMap::read(&path, &reading).unwrap().heights, [1.5; 15]);
    exr_file(&path, &["Y"], |_| FlatSamples::F32((0..15).map(|i| if i == 7 { f32::NAN } else { 0.0 }).collect()));
    let error = HeightMap::read(&path, &reading).unwrap_err().to_string();
    assert!(error.contains("1 of 15") && error.contains("column 2, row 1"), "{error}");
}

#[test]
fn damaged_pictures_are_errors_or_other_heights_but_never_panics() {
    let folder = tempfile::tempdir().unwrap();
    let (whole_png, whole_exr) = (folder.path().join("a.png"), folder.path().join("a.exr"));
    let samples: Vec<u8> = (0..600_u32).flat_map(|i| (i as u16 * 97).to_ne_bytes()).collect();
    png(&whole_png, &samples, ExtendedColorType::L16, 30);
    exr_file(&whole_exr, &["Y"], |_| FlatSamples::F32((0..15).map(|i| i as f32).collect()));
    for path in [whole_png, whole_exr] {
        let whole = std::fs::read(&path).unwrap();
        for keep in (0..whole.len()).step_by(whole.len() / 25 + 1) {
            std::fs::write(&path, &whole[..keep]).unwrap();
            let error = HeightMap::read(&path, &READING).expect_err("half a file").to_string();
            assert!(error.contains(path.to_str().unwrap()), "{error}");
        }
        for at in (0..whole.len().min(700)).step_by(2) {
            for value in [0xff, whole[at] ^ 1] {
                let mut bytes = whole.clone();
                bytes[at] = value;
                std::fs::write(&path, &bytes).unwrap();
                let _ = HeightMap::read(&path, &READING);
            }
        }
    }
}

#[test]
fn claimed_sizes_are_held_against_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.png");
    png(&path, &[0; 12], ExtendedColorType::L16, 3);
    let mut bytes = std::fs::read(&path).unwrap();
    // Width and height stand behind the signature and the first chunk's length and name; its checksum follows it.
    bytes[16..24].copy_from_slice(&[0, 0, 0xff, 0xff, 0, 0, 0x01, 0xff]);
    let checksum = crc32(&bytes[12..29]);
    bytes[29..33].copy_from_slice(&checksum.to_be_bytes());
    std::fs::write(&path, &bytes).unwrap();
    let error = HeightMap::read(&path, &READING).unwrap_err().to_string();
    assert!(error.contains("65535 x 511 samples"), "{error}");
}

/// The checksum of PNG's chunks (ISO 3309).
fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(u32::MAX, |crc, byte| {
        (0..8).fold(crc ^ u32::from(*byte), |crc, _| (crc >> 1) ^ (0xedb8_8320 & (crc & 1).wrapping_neg()))
    })
}
