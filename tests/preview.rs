//! `--tev`: what a viewer is sent while a picture is rendered, against the picture that is written.

use std::io::Read;
use std::net::TcpListener;
use std::path::Path;
use std::process::{Command, Output, Stdio};

use whitewater::output::read_exr;

const TINY: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/tiny/scene.toml");

fn command(folder: &Path, tev: &str, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_whitewater"));
    command.args(["render", TINY, "--checkpoint", "0", "--threads", "2", "--tev", tev, "-o", "out.exr"]);
    command.args(["--set", "render.width=100", "--set", "render.height=60"]).args(arguments);
    command.current_dir(folder).env_remove("WHITEWATER_LOG").stdin(Stdio::null());
    command.stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// A cursor over a packet.
struct Packet<'a>(&'a [u8]);

impl Packet<'_> {
    fn bytes<const N: usize>(&mut self) -> [u8; N] {
        let (head, rest) = self.0.split_first_chunk().expect("as many bytes as the packet says");
        self.0 = rest;
        *head
    }
    fn int(&mut self) -> usize {
        u32::from_le_bytes(self.bytes()) as usize
    }
    fn text(&mut self) -> String {
        let end = self.0.iter().position(|&byte| byte == 0).expect("a text's end");
        let text = String::from_utf8(self.0[..end].to_vec()).expect("Unicode");
        self.0 = &self.0[end + 1..];
        text
    }
}

/// A picture as a viewer shows it.
struct Shown {
    name: String,
    size: [usize; 2],
    pixels: Vec<[f32; 4]>,
    updates: usize,
}

/// What a viewer makes of all that it was sent (tev's Ipc.cpp).
fn shown(mut sent: &[u8]) -> Vec<Shown> {
    let mut pictures: Vec<Shown> = Vec::new();
    while !sent.is_empty() {
        let length = u32::from_le_bytes(sent[..4].try_into().unwrap()) as usize;
        let mut packet = Packet(&sent[4..length]);
        sent = &sent[length..];
        let [kind, _focus] = packet.bytes();
        let name = packet.text();
        match kind {
            4 => {
                let size = [packet.int(), packet.int()];
                let channels: Vec<String> = (0..packet.int()).map(|_| packet.text()).collect();
                assert_eq!(channels, ["R", "G", "B", "A"]);
                pictures.push(Shown { name, size, pixels: vec![[0.0; 4]; size[0] * size[1]], updates: 0 });
            }
            6 => {
                let picture =
                    pictures.iter_mut().rfind(|picture| picture.name == name).expect("a picture of that name");
                let count = packet.int();
                let channels: Vec<String> = (0..count).map(|_| packet.text()).collect();
                assert_eq!(channels, ["R", "G", "B", "A"]);
                let [x, y, width, height] = std::array::from_fn(|_| packet.int());
                let mut longs = || -> Vec<u64> { (0..count).map(|_| u64::from_le_bytes(packet.bytes())).collect() };
                assert_eq!((longs(), longs()), (vec![0, 1, 2, 3], vec![4; 4]));
                for row in y..y + height {
                    for column in x..x + width {
                        let pixel = std::array::from_fn(|_| f32::from_le_bytes(packet.bytes()));
                        picture.pixels[row * picture.size[0] + column] = pixel;
                    }
                }
                picture.updates += 1;
            }
            other => panic!("a packet of kind {other}"),
        }
        assert!(packet.0.is_empty(), "{} bytes too many", packet.0.len());
    }
    pictures
}

/// Runs a render with a viewer that reads everything.
fn watched(folder: &Path, arguments: &[&str]) -> Vec<Shown> {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap().to_string();
    let child = command(folder, &address, arguments).arg("-q").spawn().expect("the program starts");
    let mut sent = Vec::new();
    listener.accept().unwrap().0.read_to_end(&mut sent).unwrap();
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", said(&output));
    shown(&sent)
}

fn assert_is_written(shown: &Shown, path: &Path) {
    let picture = read_exr(path).unwrap();
    assert_eq!(shown.size, [picture.data.width as usize, picture.data.height as usize]);
    for (channel, name) in ["R", "G", "B", "A"].into_iter().enumerate() {
        let written = &picture.channel(name).unwrap().samples;
        for (pixel, written) in shown.pixels.iter().zip(written) {
            // Half has 11 bits, and 2^-25 under its least number.
            let room = pixel[channel].abs() / 2048.0 + 3e-8;
            assert!((pixel[channel] - written).abs() <= room, "{name}: {} {written}", pixel[channel]);
        }
    }
    assert!(shown.pixels.iter().any(|pixel| pixel[0] > 0.05));
}

#[test]
fn a_viewer_sees_the_picture_that_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let pictures = watched(folder.path(), &["--frame", "0"]);
    assert_eq!(pictures.len(), 1);
    assert!(pictures[0].name.contains("tiny") && pictures[0].updates >= 8, "{}", pictures[0].name);
    assert_is_written(&pictures[0], &folder.path().join("out.exr"));

    let crop = watched(folder.path(), &["--frame", "0", "--crop", "30,20,77,59"]);
    assert_eq!(crop[0].size, [47, 39]);
    assert_is_written(&crop[0], &folder.path().join("out.exr"));
}

#[test]
fn each_frame_is_a_picture_and_each_pass_an_update() {
    let folder = tempfile::tempdir().unwrap();
    let pictures = watched(folder.path(), &["-o", "f.####.exr"]);
    assert_eq!(pictures.len(), 2);
    assert_ne!(pictures[0].name, pictures[1].name);
    for (frame, picture) in pictures.iter().enumerate() {
        assert_is_written(picture, &folder.path().join(format!("f.{frame:04}.exr")));
    }
    let passes = watched(folder.path(), &["--frame", "0", "--seconds", "1.5"]);
    // Eight tiles, several times each.
    assert!(passes[0].updates > 16, "{}", passes[0].updates);
    assert_is_written(&passes[0], &folder.path().join("out.exr"));
}

#[test]
fn without_a_viewer_nothing_is_rendered_and_one_that_goes_away_is_missed_once() {
    let folder = tempfile::tempdir().unwrap();
    let free = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().to_string();
    let output = command(folder.path(), &free, &["-q", "--frame", "0"]).output().unwrap();
    assert_eq!(output.status.code(), Some(2), "{}", said(&output));
    assert!(said(&output).contains("--tev") && said(&output).contains(&free), "{}", said(&output));
    assert!(!folder.path().join("out.exr").exists());
    let output = command(folder.path(), "a:b:c", &["-q"]).output().unwrap();
    assert_eq!(output.status.code(), Some(2));
    assert!(said(&output).contains("HOST"), "{}", said(&output));

    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap().to_string();
    let child = command(folder.path(), &address, &["--frame", "0", "--seconds", "2"]).spawn().unwrap();
    drop(listener.accept().unwrap());
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", said(&output));
    assert_eq!(said(&output).matches("the viewer has gone").count(), 1, "{}", said(&output));
    assert!(folder.path().join("out.exr").exists());
}
