//! Files that lie, as the command line meets them: exit code 2, a message with its place, within a second.

use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use whitewater::bench::work::Random;
use whitewater::state::{Columns, Encoding, Frame, save_frame};

/// Runs the program in a folder; its complaint. It must end with code 2 in under a second and leave no file behind.
fn refused(folder: &Path, arguments: &[&str]) -> String {
    let files = || std::fs::read_dir(folder).unwrap().count();
    let (before, start) = (files(), Instant::now());
    let mut command = Command::new(env!("CARGO_BIN_EXE_whitewater"));
    let output = command.args(arguments).current_dir(folder).stdin(Stdio::null()).env_remove("WHITEWATER_LOG").output();
    let (output, took) = (output.unwrap(), start.elapsed());
    let complaint = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{arguments:?}: {complaint}");
    assert!(took < Duration::from_secs(1), "{arguments:?} took {took:?}");
    assert!(complaint.contains("time001.state") && !complaint.contains("panicked"), "{complaint}");
    assert_eq!(files(), before, "{arguments:?} left a file behind");
    complaint
}

fn frame() -> Frame {
    let columns = Columns {
        origin: [0.0; 2],
        width: [1.0; 2],
        nx: 40,
        nz: 30,
        base: (0..1200).map(|k| f64::from(k % 17) * 0.1).collect(),
        top: vec![2.0; 1200],
        pressure: vec![0.0; 1200],
        flow: vec![[0.0; 2]; 1200],
    };
    Frame { columns, ..Frame::default() }
}

/// A folder with a scene and these bytes as its only frame.
fn folder(bytes: &[u8]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("scene.toml"), "[frames]\nfiles = \"time###.state\"\n").unwrap();
    std::fs::write(folder.path().join("time001.state"), bytes).unwrap();
    folder
}

/// That every command which reads frames refuses these bytes.
fn refused_everywhere(bytes: &[u8], says: &str) {
    let folder = folder(bytes);
    for arguments in [
        ["inspect", "time001.state"].as_slice(),
        &["render", "scene.toml", "-o", "out.exr"],
        &["convert", "time001.state", "out.npz", "--npz"],
    ] {
        let complaint = refused(folder.path(), arguments);
        assert!(complaint.contains(says), "{arguments:?}: {says} is not in\n{complaint}");
    }
}

fn encoded(encoding: Encoding) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("whole");
    save_frame(&frame(), &path, encoding).unwrap();
    std::fs::read(path).unwrap()
}

#[test]
fn truncated_files_are_refused() {
    let text = encoded(Encoding::Text);
    refused_everywhere(&text[..text.len() / 2], "time001.state:");
    refused_everywhere(&text[..text.len() - 4], "expected `end`");
    refused_everywhere(&[], "time001.state");
    let npz = encoded(Encoding::Npz);
    refused_everywhere(&npz[..npz.len() / 2], "cut off");
    refused_everywhere(&npz[..npz.len() - 1], "cut off");
}

#[test]
fn random_bytes_are_refused() {
    let mut random = Random::new(7);
    let mut bytes: Vec<u8> = (0..1 << 20).map(|_| random.within(0.0, 256.0) as u8).collect();
    refused_everywhere(&bytes, "time001.state");
    bytes[..4].copy_from_slice(b"PK\x03\x04");
    refused_everywhere(&bytes, "directory");
    bytes[..19].copy_from_slice(b"whitewater-frame 1\n");
    refused_everywhere(&bytes, "time001.state");
}

#[test]
fn a_count_of_columns_that_no_machine_holds_is_refused_before_memory_is_taken() {
    let text = String::from_utf8(encoded(Encoding::Text)).unwrap();
    for size in ["2147483648 3", "65536 65536", "2147483648 2147483648", "18446744073709551616 3"] {
        let lying = text.replacen("columns 40 30", &format!("columns {size}"), 1);
        assert_ne!(lying, text, "the writer's own wording has changed");
        refused_everywhere(lying.as_bytes(), "time001.state:5");
    }
}
