//! `whitewater movie` as a user runs it: what goes to the encoder, and what happens when there is none or it fails.

#![cfg(unix)]

use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use tempfile::TempDir;
use whitewater::output::{self, Channel, Picture, SampleType, Window, WriteOptions};

/// A grey EXR.
fn frame(path: &Path, width: u32, height: u32, light: f32) {
    let channel = |name: &str| Channel {
        name: name.into(),
        sample_type: SampleType::Half,
        samples: vec![light; (width * height) as usize],
    };
    let data = Window { x: 0, y: 0, width, height };
    let channels = ["R", "G", "B", "A"].map(channel).to_vec();
    let picture = Picture { display: (width, height), data, channels, ..Picture::default() };
    output::write(&picture, path, &WriteOptions::default()).unwrap();
}

fn frames(numbers: &[u32]) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    for &number in numbers {
        frame(&folder.path().join(format!("f.{number:04}.exr")), 6, 4, 0.1 * number as f32);
    }
    folder
}

/// An encoder that is a line of shell; the file to write is its last argument.
fn encoder(folder: &TempDir, line: &str) -> PathBuf {
    let path = folder.path().join("encoder.sh");
    std::fs::write(&path, format!("#!/bin/sh\nfor last; do :; done\n{line}\n")).unwrap();
    std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o755)).unwrap();
    path
}

fn movie(folder: &TempDir, encoder: &Path, arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_whitewater"));
    command.arg("movie").args(arguments).current_dir(folder.path()).env("WHITEWATER_FFMPEG", encoder);
    command.output().unwrap()
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

const USUAL: [&str; 3] = ["f.####.exr", "-o", "out.mp4"];

#[test]
fn every_picture_goes_to_the_encoder_once_as_it_is_shown_in_order() {
    let folder = frames(&[2, 0, 1]);
    let cat = encoder(&folder, "echo \"$@\" > arguments; cat > \"$last\"");
    let output = movie(&folder, &cat, &[&USUAL[..], &["--fps", "30", "--view", "srgb", "--quality", "7"]].concat());
    assert_eq!(output.status.code(), Some(0), "{}", said(&output));
    let film = std::fs::read(folder.path().join("out.mp4")).unwrap();
    assert_eq!(film.len(), 3 * 6 * 4 * 3);
    let shown: Vec<u8> =
        (0..3).map(|k| output::display_values([0.1 * k as f32; 3], 1.0, whitewater::scene::View::Srgb)[0]).collect();
    for (picture, shown) in film.chunks(6 * 4 * 3).zip(shown) {
        // Half rounds the light once.
        assert!(picture.iter().all(|value| value.abs_diff(shown) <= 1), "{picture:?} {shown}");
    }
    let arguments = std::fs::read_to_string(folder.path().join("arguments")).unwrap();
    for part in ["-video_size 6x4", "-framerate 30", "-crf 7", "libx264"] {
        assert!(arguments.contains(part), "{arguments}");
    }
}

#[test]
fn without_an_encoder_or_with_one_that_fails_the_old_film_stays() {
    let folder = frames(&[1, 2]);
    let film = folder.path().join("out.mp4");
    std::fs::write(&film, "an old film").unwrap();
    let absent = folder.path().join("absent");
    let broken = encoder(&folder, "echo 'no such codec' >&2; exit 3");
    for (encoder, expected) in [(&absent, "install ffmpeg"), (&broken, "no such codec")] {
        let output = movie(&folder, encoder, &USUAL);
        assert_eq!(output.status.code(), Some(2));
        assert!(said(&output).contains(expected), "{}", said(&output));
        assert_eq!(std::fs::read_to_string(&film).unwrap(), "an old film");
    }
    let left = std::fs::read_dir(folder.path()).unwrap().filter_map(|entry| entry.ok()?.file_name().into_string().ok());
    assert!(!left.into_iter().any(|name| name.starts_with('.')), "nothing half-written is left");
}

#[test]
fn pictures_that_make_no_film_are_named() {
    let folder = frames(&[1, 2, 5]);
    let cat = encoder(&folder, "cat > \"$last\"");
    let refused = |arguments: &[&str], expected: &str| {
        let output = movie(&folder, &cat, arguments);
        assert_eq!(output.status.code(), Some(2), "{}", said(&output));
        assert!(said(&output).contains(expected), "{}", said(&output));
        assert!(!folder.path().join("out.mp4").exists());
    };
    refused(&USUAL, "frames 3, 4 are missing between 1 and 5");
    refused(&["g.####.exr", "-o", "out.mp4"], "no such files");
    refused(&["f.0001.exr", "-o", "out.gif"], ".webm");
    frame(&folder.path().join("wide.exr"), 8, 4, 0.5);
    refused(&["f.0001.exr", "wide.exr", "-o", "out.mp4"], "8x4 pixels; expected 6x4");
    std::fs::write(folder.path().join("f.0003.exr"), "no picture").unwrap();
    frame(&folder.path().join("f.0004.exr"), 6, 4, 0.5);
    refused(&USUAL, "f.0003.exr");
}

#[test]
fn ffmpeg_itself_takes_them_where_it_is_installed() {
    if Command::new("ffmpeg").arg("-version").output().is_err() {
        eprintln!("no ffmpeg: not tried");
        return;
    }
    let folder = frames(&[1, 2, 3]);
    for name in ["out.mp4", "out.mkv", "out.webm"] {
        let output = movie(&folder, Path::new("ffmpeg"), &["f.####.exr", "-o", name, "-q"]);
        assert_eq!(output.status.code(), Some(0), "{name}: {}", said(&output));
        assert!(std::fs::metadata(folder.path().join(name)).unwrap().len() > 200, "{name}");
    }
}
