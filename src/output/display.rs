//! PNG, JPEG, BMP and 8-bit TIFF: the beauty through the view transform, written by the crate `image`.
//! These formats know one window: what was rendered, as far as it lies inside the frame.

use std::{
    fs::File,
    io::{BufWriter, Write},
    path::Path,
};

use image::{
    ExtendedColorType, ImageEncoder, ImageError,
    codecs::{bmp::BmpEncoder, jpeg::JpegEncoder, png, tiff::TiffEncoder},
};
use rayon::prelude::*;

use super::{Format, OutputError, Picture, WriteOptions, colorspace, view::display_values, whole_file::write_whole};
use crate::scene::Colorspace;

/// JPEG's quality: the point past which files grow faster than any difference can be seen on water.
const JPEG_QUALITY: u8 = 95;

/// Eight-bit pixels, three or four samples each.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Pixels {
    width: u32,
    height: u32,
    alpha: bool,
    samples: Vec<u8>,
}

/// Writes the beauty as it looks; returns the file's size.
pub(super) fn write(
    picture: &Picture,
    path: &Path,
    format: Format,
    options: &WriteOptions,
) -> Result<u64, OutputError> {
    // Only PNG and TIFF can say what is transparent; elsewhere the picture stands before black.
    let pixels = pixels(picture, path, matches!(format, Format::Png | Format::Tiff), options)?;
    let failed = |source| OutputError::Image { path: path.to_path_buf(), source };
    write_whole(
        path,
        |file, _| encode(&pixels, format, file).map_err(failed),
        |written| {
            let decoded = image::ImageReader::open(written).map_err(ImageError::from).and_then(|r| r.decode());
            let decoded = decoded.map_err(failed)?;
            let size = (decoded.width(), decoded.height()) == (pixels.width, pixels.height);
            let same = if pixels.alpha { decoded.into_rgba8().into_raw() } else { decoded.into_rgb8().into_raw() };
            // JPEG cannot give back the same samples.
            if size && (format == Format::Jpeg || same == pixels.samples) {
                Ok(())
            } else {
                Err(OutputError::Damaged { path: path.to_path_buf(), what: "its pixels differ".into() })
            }
        },
    )
}

/// The visible pixels as they are shown before black: width, height, and RGB row by row.
pub(super) fn rgb(picture: &Picture, path: &Path, options: &WriteOptions) -> Result<(u32, u32, Vec<u8>), OutputError> {
    // Views are made for Rec.709.
    let picture = colorspace::converted(picture, Colorspace::Rec709);
    let Pixels { width, height, samples, .. } = pixels(&picture, path, false, options)?;
    Ok((width, height, samples))
}

fn encode(pixels: &Pixels, format: Format, file: &mut File) -> Result<(), ImageError> {
    let color = if pixels.alpha { ExtendedColorType::Rgba8 } else { ExtendedColorType::Rgb8 };
    let (samples, width, height) = (&pixels.samples, pixels.width, pixels.height);
    let mut file = BufWriter::new(file);
    match format {
        Format::Png => {
            png::PngEncoder::new_with_quality(&mut file, png::CompressionType::Default, png::FilterType::Adaptive)
                .write_image(samples, width, height, color)?
        }
        Format::Jpeg => {
            JpegEncoder::new_with_quality(&mut file, JPEG_QUALITY).write_image(samples, width, height, color)?
        }
        Format::Bmp => BmpEncoder::new(&mut file).write_image(samples, width, height, color)?,
        Format::Tiff => TiffEncoder::new(&mut file).write_image(samples, width, height, color)?,
        Format::Exr => unreachable!("EXR is written from scene-linear channels"),
    }
    file.flush()?;
    Ok(())
}

/// The visible pixels, in display values. With transparency allowed and present, unpremultiplied and with alpha.
fn pixels(picture: &Picture, path: &Path, transparency: bool, options: &WriteOptions) -> Result<Pixels, OutputError> {
    let channel = |name: &'static str| {
        let found = picture.channel(name).map(|c| c.samples.as_slice());
        found.ok_or(OutputError::MissingChannel { path: path.to_path_buf(), channel: name })
    };
    let color = [channel("R")?, channel("G")?, channel("B")?];
    let opacity = picture.channel("A").map(|c| c.samples.as_slice()).filter(|_| transparency);

    let window = &picture.data;
    let clip = |start: i32, size: u32, limit: u32| {
        let first = (-i64::from(start)).max(0);
        let end = (i64::from(limit) - i64::from(start)).min(size.into());
        (first, end)
    };
    let ((left, right), (top, bottom)) =
        (clip(window.x, window.width, picture.display.0), clip(window.y, window.height, picture.display.1));
    if left >= right || top >= bottom {
        return Err(OutputError::OutsideFrame { path: path.to_path_buf() });
    }
    let rows = || (top..bottom).map(|y| y as usize * window.width as usize);
    let columns = left as usize..right as usize;
    let alpha = opacity.filter(|a| rows().any(|row| a[row..][columns.clone()].iter().any(|a| *a < 1.0)));

    let gain = options.exposure.exp2();
    let samples = rows()
        .collect::<Vec<_>>()
        .into_par_iter()
        .flat_map_iter(|row| {
            let mut line = Vec::with_capacity(columns.len() * 4);
            for at in columns.clone().map(|x| row + x) {
                let a = alpha.map_or(1.0, |a| a[at].clamp(0.0, 1.0));
                // Light without coverage has no colour to divide out: it is shown as it is.
                let scale = if a > 0.0 { gain / f64::from(a) } else { gain };
                line.extend(display_values(color.map(|c| c[at]), scale, options.view));
                if alpha.is_some() {
                    line.push((a * 255.0).round() as u8);
                }
            }
            line
        })
        .collect();
    Ok(Pixels { width: (right - left) as u32, height: (bottom - top) as u32, alpha: alpha.is_some(), samples })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        output::{Channel, SampleType, Window, srgb_encode},
        scene::View,
    };

    fn picture(data: Window, display: (u32, u32), alpha: f32) -> Picture {
        let channel = |name: &str, value: fn(usize) -> f32| Channel {
            name: name.into(),
            sample_type: SampleType::Half,
            samples: (0..data.area()).map(value).collect(),
        };
        let mut picture = Picture {
            display,
            data,
            channels: vec![
                channel("R", |i| i as f32 / 16.0),
                channel("G", |_| 0.5),
                channel("B", |_| 0.25),
                channel("A", |_| 1.0),
            ],
            ..Picture::default()
        };
        picture.channels[3].samples[0] = alpha;
        picture
    }

    fn srgb() -> WriteOptions {
        WriteOptions { view: View::Srgb, ..WriteOptions::default() }
    }

    #[test]
    fn png_holds_the_srgb_curve() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.png");
        let whole = Window { x: 0, y: 0, width: 4, height: 4 };
        crate::output::write(&picture(whole, (4, 4), 1.0), &path, &srgb()).unwrap();
        let image = image::open(&path).unwrap();
        assert_eq!(image.color(), image::ColorType::Rgb8);
        for (i, pixel) in image.to_rgb8().pixels().enumerate() {
            let closed = |v: f64| (srgb_encode(v) * 255.0).round() as u8;
            assert_eq!(pixel.0, [closed(i as f64 / 16.0), closed(0.5), closed(0.25)]);
        }
        // 0.5 and 0.25 are 188 and 137 in every table of sRGB.
        assert_eq!(image.to_rgb8()[(0, 0)].0, [0, 188, 137]);
    }

    #[test]
    fn transparency_is_kept_unpremultiplied_where_it_can_be() {
        let directory = tempfile::tempdir().unwrap();
        let whole = Window { x: 0, y: 0, width: 4, height: 4 };
        let picture = picture(whole, (4, 4), 0.5);
        for (name, expected) in
            [("a.png", [0, 255, 188, 128]), ("a.tif", [0, 255, 188, 128]), ("a.bmp", [0, 188, 137, 255])]
        {
            let path = directory.path().join(name);
            crate::output::write(&picture, &path, &srgb()).unwrap();
            assert_eq!(image::open(&path).unwrap().to_rgba8()[(0, 0)].0, expected, "{name}");
        }
    }

    #[test]
    fn every_display_format_is_written_and_jpeg_is_near() {
        let directory = tempfile::tempdir().unwrap();
        let whole = Window { x: 0, y: 0, width: 40, height: 30 };
        let mut flat = picture(whole, (40, 30), 1.0);
        flat.channels[0].samples.fill(0.5);
        for name in ["a.png", "a.jpg", "b.jpeg", "a.bmp", "a.tif", "b.TIFF"] {
            let path = directory.path().join(name);
            let report = crate::output::write(&flat, &path, &srgb()).unwrap();
            assert_eq!(report.bytes, std::fs::metadata(&path).unwrap().len());
            let pixel = image::open(&path).unwrap().to_rgb8()[(20, 15)].0;
            for (ours, expected) in pixel.into_iter().zip([188u8, 188, 137]) {
                assert!(ours.abs_diff(expected) <= 2, "{name} {pixel:?}");
            }
        }
    }

    #[test]
    fn a_crop_is_small_and_overscan_is_cut() {
        let size = |data, display| {
            let p = pixels(&picture(data, display, 1.0), Path::new("a.png"), true, &srgb()).unwrap();
            assert_eq!(p.samples.len(), (p.width * p.height * 3) as usize);
            (p.width, p.height, p.samples[0])
        };
        assert_eq!(size(Window { x: 5, y: 6, width: 4, height: 3 }, (20, 10)), (4, 3, 0));
        let first_inside = (srgb_encode(9.0 / 16.0) * 255.0).round() as u8;
        assert_eq!(size(Window { x: -1, y: -1, width: 8, height: 6 }, (6, 4)), (6, 4, first_inside));
        let outside = picture(Window { x: 9, y: 0, width: 2, height: 2 }, (8, 8), 1.0);
        assert!(matches!(pixels(&outside, Path::new("a.png"), true, &srgb()), Err(OutputError::OutsideFrame { .. })));
    }

    #[test]
    fn a_picture_without_beauty_has_no_look() {
        let mut picture = picture(Window { x: 0, y: 0, width: 2, height: 2 }, (2, 2), 1.0);
        picture.channels.remove(1);
        let error = pixels(&picture, Path::new("a.png"), true, &srgb()).unwrap_err();
        assert!(matches!(error, OutputError::MissingChannel { channel: "G", .. }));
    }
}
