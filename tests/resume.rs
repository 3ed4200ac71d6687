//! Going on where several frames, or the two eyes of one, were stopped: what is whole is left out, what was under way goes on, and
//! every file has the bytes of a run that was never disturbed.

use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::Duration;

use tempfile::TempDir;

const TINY: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/tiny");

/// A folder with the scene `tiny`, its two frames going on to four, and an image on a mesh.
fn folder() -> TempDir {
    let folder = tempfile::tempdir().expect("a temporary folder");
    for (from, to) in [
        ("scene.toml", "scene.toml"),
        ("model.state", "model.state"),
        ("time000.state", "time000.state"),
        ("time001.state", "time001.state"),
        ("time000.state", "time002.state"),
        ("time001.state", "time003.state"),
    ] {
        std::fs::copy(Path::new(TINY).join(from), folder.path().join(to)).unwrap();
    }
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    write("moss.mtl", "newmtl moss\nmap_Kd moss.png\n");
    write(
        "moss.obj",
        "mtllib moss.mtl\nv 0 1 0\nv 1 1 0\nv 0 1 1\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl moss\nf 1/1 3/3 2/2\n",
    );
    moss(&folder, 90);
    folder
}

fn moss(folder: &TempDir, green: u8) {
    image::RgbImage::from_pixel(2, 2, image::Rgb([30, green, 10])).save(folder.path().join("moss.png")).unwrap();
}

fn render(folder: &TempDir, into: &str, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_whitewater"));
    std::fs::create_dir_all(folder.path().join(into)).unwrap();
    command.args(["render", "scene.toml", "--reproducible", "--threads", "1", "-o"]).arg(format!("{into}/out.exr"));
    command.args(["--set", "environment.meshes=['moss.obj']"]).args(arguments);
    command.current_dir(folder.path()).env_remove("WHITEWATER_LOG").stdin(Stdio::null());
    command
}

/// What a command that must succeed says.
fn done(mut command: Command) -> String {
    let Output { status, stdout, stderr } = command.output().expect("the program starts");
    let said = String::from_utf8_lossy(&stdout).into_owned() + &String::from_utf8_lossy(&stderr);
    assert_eq!(status.code(), Some(0), "{command:?}: {said}");
    said
}

/// Kills a render as soon as `begun` is there and before `ended` is. A machine that is busy elsewhere may see it too late: then once
/// more, from nothing.
fn killed_between(folder: &TempDir, arguments: &[&str], begun: &str, ended: &str) {
    for _ in 0..20 {
        let _ = std::fs::remove_dir_all(folder.path().join("o"));
        let mut command = render(folder, "o", arguments);
        let mut child = command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
        while !folder.path().join(begun).exists() && child.try_wait().unwrap().is_none() {
            std::thread::sleep(Duration::from_millis(1));
        }
        child.kill().unwrap();
        child.wait().unwrap();
        if folder.path().join(begun).exists() && !folder.path().join(ended).exists() {
            return;
        }
    }
    panic!("{begun} was never there without {ended}");
}

fn bytes(folder: &TempDir, name: &str) -> Vec<u8> {
    std::fs::read(folder.path().join(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
}

fn names(folder: &TempDir, into: &str) -> Vec<String> {
    let entries = std::fs::read_dir(folder.path().join(into)).expect("a folder");
    let mut names: Vec<String> = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

const FRAMES: [&str; 4] = ["out.0000.exr", "out.0001.exr", "out.0002.exr", "out.0003.exr"];

/// The frames that a run says to have left out.
fn left_out(said: &str) -> Vec<usize> {
    let whole = |name: &str| said.lines().any(|line| line.contains(name) && line.contains("whole already"));
    (0..4).filter(|&frame| whole(FRAMES[frame])).collect()
}

#[test]
fn a_stopped_sequence_goes_on_with_the_frame_that_was_under_way() {
    let folder = folder();
    let settings = ["--frames", "0-3", "--set", "render.samples=32", "--checkpoint", "0.02"];
    done(render(&folder, "whole", &settings));
    let resume = |further: &[&str]| done(render(&folder, "o", &[&settings[..], &["--resume"], further].concat()));
    let all_as_undisturbed = |why: &str| {
        for name in FRAMES {
            assert!(bytes(&folder, &format!("o/{name}")) == bytes(&folder, &format!("whole/{name}")), "{why}: {name}");
        }
        let left = names(&folder, "o");
        assert!(!left.iter().any(|name| name.ends_with(".checkpoint") || name.ends_with(".lock")), "{why}: {left:?}");
    };
    killed_between(&folder, &settings, "o/.out.0001.exr.checkpoint", "o/out.0001.exr");
    let said = resume(&["--stats", "stats.json"]);
    assert_eq!(left_out(&said), [0], "{said}");
    all_as_undisturbed("killed");
    let stats: serde_json::Value = serde_json::from_slice(&bytes(&folder, "stats.json")).unwrap();
    assert_eq!(stats["skipped"], serde_json::json!([0]));
    let rays = |index: usize| stats["frames"][index]["render"]["rays"]["primary"].as_u64().unwrap();
    assert!(rays(0) < rays(1), "frame 1 began anew: {stats}");

    assert_eq!(left_out(&resume(&[])), [0, 1, 2, 3]);
    // Another file under the name, one that is gone, and a record that is none.
    let old = bytes(&folder, "o/out.0001.exr");
    let mut damaged = old.clone();
    damaged[old.len() / 2] ^= 1;
    std::fs::write(folder.path().join("o/out.0001.exr"), damaged).unwrap();
    std::fs::remove_file(folder.path().join("o/out.0002.exr")).unwrap();
    std::fs::write(folder.path().join("o/.out.0003.exr.whole"), "yes").unwrap();
    let said = resume(&[]);
    assert_eq!(left_out(&said), [0], "{said}");
    assert!(said.contains("out.0001.exr is not as it was written"), "{said}");
    all_as_undisturbed("damaged");
    // Without being asked, nothing is left out.
    assert_eq!(left_out(&done(render(&folder, "o", &settings))), [0; 0]);
    all_as_undisturbed("again");

    // What decides about a bit of a file makes other frames of them.
    for further in [&["--set", "sun.elevation=33"][..], &["--layers", "beauty"], &["--compression", "piz"]] {
        let said = resume(further);
        assert_eq!(left_out(&said), [0; 0], "{further:?}: {said}");
        assert!(said.contains("has changed"), "{said}");
    }
    resume(&[]);
    // So does what they read.
    moss(&folder, 91);
    let said = resume(&[]);
    assert_eq!(left_out(&said), [0; 0], "an image on a mesh: {said}");
}

#[test]
fn both_eyes_of_a_pair_go_on_to_the_same_bytes() {
    let folder = folder();
    let settings = ["-q", "--frame", "0", "--stereo", "0.065", "--set", "render.samples=128", "--checkpoint", "0.02"];
    done(render(&folder, "whole", &[&settings[..], &["--stats", "all.json"]].concat()));
    assert_eq!(names(&folder, "whole"), ["out.exr"]);
    let expected = bytes(&folder, "whole/out.exr");
    let rays = |name: &str| {
        let stats: serde_json::Value = serde_json::from_slice(&bytes(&folder, name)).unwrap();
        stats["frames"][0]["render"]["rays"]["primary"].as_u64().unwrap()
    };
    let all = rays("all.json");
    for (eye, most) in [("left", all), ("right", all / 2)] {
        killed_between(&folder, &settings, &format!("o/.out.exr.{eye}.checkpoint"), "o/out.exr");
        assert!(folder.path().join("o/.out.exr.left.checkpoint").exists());
        done(render(&folder, "o", &[&settings[..], &["--resume", "--stats", "s.json"]].concat()));
        assert!(rays("s.json") < most, "{eye}: {} of {all} camera rays again", rays("s.json"));
        assert!(bytes(&folder, "o/out.exr") == expected, "{eye}");
        assert_eq!(names(&folder, "o"), ["out.exr"], "{eye}");
        std::fs::remove_file(folder.path().join("o/out.exr")).unwrap();
    }
    // Kept, they are refined as one eye's is; and an eye is not the other.
    let kept = ["-q", "--frame", "0", "--stereo", "0.065", "--set", "render.samples=64", "--keep-checkpoint"];
    done(render(&folder, "o", &kept));
    let [left, right] = ["left", "right"].map(|eye| folder.path().join(format!("o/.out.exr.{eye}.checkpoint")));
    done(render(&folder, "o", &[&kept[..7], &["--resume", "--checkpoint", "1000"]].concat()));
    assert!(!left.exists() && !right.exists());
    done(render(&folder, "o", &kept));
    std::fs::copy(&left, &right).unwrap();
    let output = render(&folder, "o", &[&kept[..], &["--resume"]].concat()).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(said.contains(".out.exr.right.checkpoint is of another picture"), "{said}");
}
