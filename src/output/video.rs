//! Pictures in a row → a film, through the program `ffmpeg`: it has every codec, and no library of it comes with systems.
//!
//! Pictures go to it as they are shown (view transform, 8 bits), one after the other; what it writes gets its name only when
//! it is whole.

use std::ffi::OsString;
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};

use super::{OutputError, WriteOptions, display, naming, read_exr, whole_file::write_whole};

/// How a film is made.
#[derive(Clone, Debug)]
pub struct MovieOptions {
    /// Pictures per second.
    pub fps: f64,
    /// Curve and exposure for EXR; other pictures are shown as they are.
    pub view: WriteOptions,
    /// ffmpeg's constant rate factor: 0 is without loss, each 6 more about half the size.
    pub quality: u8,
}

/// What was written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MovieReport {
    /// The file: another name than was asked for if it was stopped.
    pub path: PathBuf,
    /// Its size.
    pub bytes: u64,
    /// Pictures in it.
    pub frames: usize,
}

/// The codec's arguments by the file's extension.
fn codec(path: &Path, quality: u8) -> Result<Vec<String>, OutputError> {
    let extension = path.extension().and_then(|extension| extension.to_str()).unwrap_or_default().to_ascii_lowercase();
    let (name, more): (&str, &[&str]) = match extension.as_str() {
        "mp4" | "mov" => ("libx264", &["-movflags", "+faststart"]),
        "mkv" => ("libx264", &[]),
        "webm" => ("libvpx-vp9", &["-b:v", "0"]),
        _ => {
            let what = "a film's name ends in .mp4, .mov, .mkv or .webm".to_owned();
            return Err(OutputError::Unsupported { path: path.to_path_buf(), what });
        }
    };
    let mut arguments = vec!["-c:v".to_owned(), name.to_owned(), "-crf".to_owned(), quality.to_string()];
    arguments.extend(more.iter().map(|argument| (*argument).to_owned()));
    Ok(arguments)
}

/// `WHITEWATER_FFMPEG`, or `ffmpeg` on the search path.
fn encoder() -> OsString {
    std::env::var_os("WHITEWATER_FFMPEG").filter(|name| !name.is_empty()).unwrap_or_else(|| "ffmpeg".into())
}

/// A picture as it is shown: width, height and RGB of 8 bits.
fn shown(path: &Path, view: &WriteOptions) -> Result<(u32, u32, Vec<u8>), OutputError> {
    if path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("exr")) {
        return display::rgb(&read_exr(path)?, path, view);
    }
    let failed = |source| OutputError::Image { path: path.to_path_buf(), source };
    let reader = image::ImageReader::open(path).map_err(|source| OutputError::Io {
        action: "read",
        path: path.to_path_buf(),
        source,
    })?;
    let picture = reader.decode().map_err(failed)?.into_rgb8();
    Ok((picture.width(), picture.height(), picture.into_raw()))
}

/// Makes a film of pictures (EXR, or what else is shown as it is), in their order. `told` hears how many are in it so far. When
/// `stop` becomes true, the film ends there and is called `NAME.partial.mp4`.
///
/// *Errors*: a picture that cannot be read or is of another size than the first; an ending that means no film; ffmpeg is
/// missing or refuses; the system's. An older file under that name stays then.
pub fn write_movie(
    pictures: &[PathBuf],
    path: &Path,
    options: &MovieOptions,
    stop: &AtomicBool,
    mut told: impl FnMut(usize),
) -> Result<MovieReport, OutputError> {
    let codec = codec(path, options.quality)?;
    super::whole_file::check_target(path)?;
    let unsupported = |what: &str| OutputError::Unsupported { path: path.to_path_buf(), what: what.to_owned() };
    let (first, _) = pictures.split_first().ok_or_else(|| unsupported("a film of no pictures"))?;
    let (width, height, _) = shown(first, &options.view)?;
    let encoder = encoder();
    let refused = |message: String| OutputError::Encoder { program: encoder.clone().into(), message };
    let io = |action| move |source| OutputError::Io { action, path: path.to_path_buf(), source };
    // Whether it is there is known before an hour of pictures; and what it writes has a name of its own until it is whole.
    let mut frames = 0;
    let mut stopped = false;
    let mut encode = |temporary: &Path| {
        let mut command = Command::new(&encoder);
        command
            .args(["-v", "error", "-f", "rawvideo", "-pixel_format", "rgb24"])
            .args(["-video_size", &format!("{width}x{height}"), "-framerate", &options.fps.to_string(), "-i", "pipe:0"])
            // Codecs want even sides; colours are television's, and the file says so.
            .args(["-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2,scale=out_color_matrix=bt709:out_range=tv"])
            .args(["-pix_fmt", "yuv420p", "-colorspace", "bt709", "-color_primaries", "bt709", "-color_trc", "bt709"])
            .args(&codec)
            .arg("-y")
            .arg(temporary)
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .stderr(Stdio::piped());
        // Ctrl-C is for us: the encoder then gets the end of its input, and finishes the file.
        #[cfg(unix)]
        std::os::unix::process::CommandExt::process_group(&mut command, 0);
        let mut child = command.spawn().map_err(|error| match error.kind() {
            std::io::ErrorKind::NotFound => refused(
                "not found; install ffmpeg (Debian: apt install ffmpeg), or say where it is by WHITEWATER_FFMPEG"
                    .into(),
            ),
            _ => refused(error.to_string()),
        })?;
        let mut errors = child.stderr.take();
        let listener = std::thread::spawn(move || {
            let mut said = String::new();
            if let Some(errors) = &mut errors {
                // What is no text is left out of the message.
                let _ = errors.read_to_string(&mut said);
            }
            said
        });
        let mut input = child.stdin.take();
        let mut fed = Ok(());
        for picture in pictures {
            if stop.load(Ordering::Relaxed) {
                stopped = true;
                break;
            }
            fed = shown(picture, &options.view).and_then(|(w, h, samples)| {
                if (w, h) != (width, height) {
                    let what = format!(
                        "{w}x{h} pixels; expected {width}x{height}, as {} has: a film has one size",
                        first.display()
                    );
                    return Err(OutputError::Unsupported { path: picture.clone(), what });
                }
                // An encoder that has ended says why on its own.
                let written = input.as_mut().map(|input| input.write_all(&samples));
                written.transpose().map(drop).map_err(io("write"))
            });
            if fed.is_err() {
                break;
            }
            frames += 1;
            told(frames);
        }
        drop(input);
        let status = child.wait().map_err(io("write"))?;
        let said = listener.join().unwrap_or_default();
        match fed {
            Err(OutputError::Io { action: "write", .. }) if !status.success() => Err(refused(said.trim().to_owned())),
            Err(error) => Err(error),
            Ok(()) if !status.success() => Err(refused(said.trim().to_owned())),
            Ok(()) => Ok(()),
        }
    };
    // Encoded beside its name, so that whether it was stopped is known before it is named.
    let directory = path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let extension = path.extension().map(|e| format!(".{}", e.to_string_lossy())).unwrap_or_default();
    let mut builder = tempfile::Builder::new();
    let temporary =
        builder.prefix(".whitewater-").suffix(&extension).tempfile_in(directory).map_err(io("create a file for"))?;
    encode(temporary.path())?;
    if frames == 0 {
        return Err(unsupported("it was stopped before its first picture"));
    }
    let name = if stopped { naming::partial(path) } else { path.to_path_buf() };
    let bytes = write_whole(
        &name,
        |file, _| {
            let mut source = std::fs::File::open(temporary.path()).map_err(io("read"))?;
            std::io::copy(&mut source, file).map(drop).map_err(io("write"))
        },
        |written| {
            let size = std::fs::metadata(written).map_err(io("measure"))?.len();
            if size > 0 { Ok(()) } else { Err(refused("it wrote an empty file".into())) }
        },
    )?;
    Ok(MovieReport { path: name, bytes, frames })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ending_chooses_the_codec() {
        assert_eq!(codec(Path::new("a.MP4"), 18).unwrap()[..4], ["-c:v", "libx264", "-crf", "18"]);
        assert_eq!(codec(Path::new("a.webm"), 30).unwrap()[1], "libvpx-vp9");
        let error = codec(Path::new("a.avi"), 18).unwrap_err().to_string();
        assert!(error.contains(".mp4") && error.contains("a.avi"), "{error}");
    }

    #[test]
    fn a_film_of_nothing_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let options = MovieOptions { fps: 24.0, view: WriteOptions::default(), quality: 18 };
        let path = folder.path().join("a.mp4");
        let none = write_movie(&[], &path, &options, &AtomicBool::new(false), |_| {});
        assert!(none.unwrap_err().to_string().contains("no pictures"));
        let missing = [folder.path().join("a.0001.exr")];
        let error = write_movie(&missing, &path, &options, &AtomicBool::new(false), |_| {}).unwrap_err();
        assert!(error.to_string().contains("a.0001.exr"), "{error}");
        assert!(!path.exists());
    }
}
