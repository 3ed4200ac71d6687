//! Parts of a picture, rendered apart or one after another: tiles, samples, checkpoints. Whatever the division, the order, the
//! count of threads, or how often the render was killed, the picture has the same bits.

use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::Duration;

use tempfile::TempDir;
use whitewater::output::{Picture, read_exr};

const SMALL: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/small/scene.toml");
const TINY: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/tiny/scene.toml");

/// Small pictures of a scene, every layer, no dates.
fn render(folder: &Path, scene: &str, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_whitewater"));
    command.args(["render", scene, "-q", "--reproducible", "--frame", "0", "--layers", "all"]);
    command.args(["--set", "render.width=150", "--set", "render.height=100"]).args(arguments);
    command.current_dir(folder).env_remove("WHITEWATER_LOG").stdin(Stdio::null());
    command
}

fn merge(folder: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_whitewater"));
    command.arg("merge").args(arguments).current_dir(folder).env_remove("WHITEWATER_LOG").stdin(Stdio::null());
    command
}

fn done(mut command: Command) -> Output {
    let output = command.output().expect("the program starts");
    assert_eq!(output.status.code(), Some(0), "{command:?}: {}", String::from_utf8_lossy(&output.stderr));
    output
}

/// What a command that must be refused says.
fn refused(mut command: Command) -> String {
    let output = command.output().expect("the program starts");
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{command:?}: {said}");
    said
}

fn folder() -> TempDir {
    tempfile::tempdir().expect("a temporary folder")
}

fn bytes(folder: &TempDir, name: &str) -> Vec<u8> {
    std::fs::read(folder.path().join(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
}

fn picture(folder: &TempDir, name: &str) -> Picture {
    read_exr(&folder.path().join(name)).unwrap_or_else(|error| panic!("{error}"))
}

/// The pictures' channels are the same bit for bit.
fn assert_same(one: &Picture, other: &Picture) {
    assert_eq!((one.display, one.data, one.channels.len()), (other.display, other.data, other.channels.len()));
    for (a, b) in one.channels.iter().zip(&other.channels) {
        assert_eq!((&a.name, a.sample_type), (&b.name, b.sample_type));
        let same = a.samples.iter().zip(&b.samples).all(|(a, b)| a.to_bits() == b.to_bits());
        assert!(same, "{}", a.name);
    }
}

fn names(folder: &TempDir) -> Vec<String> {
    let entries = std::fs::read_dir(folder.path()).expect("a folder");
    let mut names: Vec<String> = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

#[test]
fn tiles_in_any_order_by_any_threads_merge_to_the_whole_file() {
    let folder = folder();
    done(render(folder.path(), SMALL, &["-o", "w.exr", "--set", "render.samples=4"]));
    for (index, threads) in [(3, "1"), (1, "2"), (4, "2"), (2, "1")] {
        let (tile, name) = (format!("{index}/4"), format!("t{index}.exr"));
        let threads = ["--threads", threads];
        let tile = ["--tile", &tile, "-o", &name, "--set", "render.samples=4"];
        done(render(folder.path(), SMALL, &[&tile[..], &threads].concat()));
    }
    done(merge(folder.path(), &["t4.exr", "t2.exr", "t1.exr", "t3.exr", "-o", "m.exr"]));
    assert_same(&picture(&folder, "m.exr"), &picture(&folder, "w.exr"));
    assert!(bytes(&folder, "m.exr") == bytes(&folder, "w.exr"), "the same pixels in other bytes");
    // 150 x 100 are 5 x 4 tiles: a share has 5, which lie in one row here.
    let part = picture(&folder, "t2.exr");
    assert_eq!((part.display, part.data.y, part.data.width, part.data.height), ((150, 100), 32, 150, 32));

    let said = refused(merge(folder.path(), &["t1.exr", "t2.exr", "t4.exr", "-o", "x.exr"]));
    assert!(said.contains("5 of 20 tiles are missing, the first at 0,64"), "{said}");
    let said = refused(merge(folder.path(), &["t1.exr", "t2.exr", "t3.exr", "t4.exr", "t2.exr", "-o", "x.exr"]));
    assert!(said.contains("t2.exr") && said.contains("expected each once"), "{said}");
    done(merge(folder.path(), &["t1.exr", "t2.exr", "t4.exr", "-o", "p.exr", "--partial"]));
    let partial = picture(&folder, "p.exr");
    assert!(!partial.metadata.complete && partial.data.height == 100);
    assert!(partial.channel("A").unwrap().samples[70 * 150..96 * 150].iter().all(|alpha| *alpha == 0.0));

    done(render(folder.path(), SMALL, &["-o", "other.exr", "--tile", "3/4", "--set", "render.samples=5"]));
    let said = refused(merge(folder.path(), &["t1.exr", "t2.exr", "other.exr", "t4.exr", "-o", "x.exr"]));
    assert!(said.contains("other.exr has `whitewater:scene`"), "{said}");
    let mut depth = Command::new(env!("CARGO_BIN_EXE_whitewater"));
    depth.args([
        "render",
        SMALL,
        "-q",
        "--reproducible",
        "--frame",
        "0",
        "--layers",
        "z",
        "-o",
        "z.exr",
        "--tile",
        "3/4",
    ]);
    for set in ["width=150", "height=100", "samples=4"] {
        depth.arg("--set").arg(format!("render.{set}"));
    }
    depth.current_dir(folder.path());
    done(depth);
    let said = refused(merge(folder.path(), &["t1.exr", "t2.exr", "z.exr", "t4.exr", "-o", "x.exr"]));
    assert!(said.contains("z.exr has the channels Z:Float; expected"), "{said}");
    std::fs::write(folder.path().join("text.exr"), "no picture").unwrap();
    assert!(refused(merge(folder.path(), &["text.exr", "-o", "x.exr"])).contains("text.exr"));
    assert!(!folder.path().join("x.exr").exists());
    let left = names(&folder);
    assert!(!left.iter().any(|name| name.starts_with('.')), "{left:?}");
}

#[test]
fn parts_that_could_not_be_joined_are_refused_before_anything_is_rendered() {
    let folder = folder();
    for (arguments, expected) in [
        (&["-o", "a.exr", "--tile", "1/21"][..], "at most 20"),
        (&["-o", "a.png", "--tile", "1/2"], "only EXR"),
        (&["-o", "a.exr", "--tile", "1/2", "--compression", "dwaa"], "whitewater merge"),
        (&["-o", "a.exr", "--sample-range", "0-8"], "multiples of 16"),
        (&["-o", "a.exr", "--sample-range", "0-32", "--noise", "0.1"], "--noise"),
        (&["-o", "a.exr", "--resume", "--checkpoint", "0"], "--checkpoint 0"),
        (&["-o", "a.png", "--resume"], "NAME.exr"),
    ] {
        let said = refused(render(folder.path(), SMALL, arguments));
        assert!(said.contains(expected), "{arguments:?}: {said}");
    }
    assert_eq!(names(&folder), [""; 0]);
}

#[test]
fn samples_join_to_the_bit_from_checkpoints_and_nearly_from_pictures() {
    let folder = folder();
    let size = ["--set", "render.samples=48", "--set", "render.width=64", "--set", "render.height=40"];
    done(render(folder.path(), TINY, &[&size[..], &["-o", "w.exr"]].concat()));
    for (range, tile, name) in [("0-16", "1/1", "a.exr"), ("16-48", "2/2", "c.exr"), ("16-48", "1/2", "b.exr")] {
        let part = ["--sample-range", range, "--tile", tile, "-o", name, "--keep-checkpoint"];
        done(render(folder.path(), TINY, &[&size[..], &part].concat()));
    }
    let checkpoints = [".c.exr.checkpoint", ".a.exr.checkpoint", ".b.exr.checkpoint"];
    let all = ["--layers", "all", "--reproducible", "-o", "exact.exr"];
    done(merge(folder.path(), &[&checkpoints[..], &all].concat()));
    assert!(bytes(&folder, "exact.exr") == bytes(&folder, "w.exr"), "joined from checkpoints");
    let said = refused(merge(folder.path(), &[".a.exr.checkpoint", ".b.exr.checkpoint", "-o", "x.exr"]));
    assert!(said.contains("of 4 tiles are missing"), "{said}");

    done(merge(folder.path(), &["b.exr", "c.exr", "a.exr", "-o", "near.exr"]));
    let (near, whole) = (picture(&folder, "near.exr"), picture(&folder, "w.exr"));
    let mut compared = 0;
    let covered = |picture: &Picture, pixel: usize| -> f32 {
        let of = |name: &str| picture.channel(name).unwrap().samples[pixel];
        ["CryptoObject00.g", "CryptoObject00.a", "CryptoObject01.g", "CryptoObject01.a"].map(of).iter().sum()
    };
    for pixel in 0..64 * 40 {
        let (a, b) = (covered(&near, pixel), covered(&whole, pixel));
        assert!((a - b).abs() < 1e-5, "mattes of pixel {pixel}: {a} {b}");
    }
    for (a, b) in near.channels.iter().zip(&whole.channels) {
        assert_eq!(a.name, b.name);
        // Things that cover as much as each other may change places.
        if a.name.starts_with("Crypto") {
            continue;
        }
        let exact = ["Z", "N.", "P.", "forward", "backward", "water", "velocity", "sampleCount"];
        for (pixel, (a_value, b_value)) in a.samples.iter().zip(&b.samples).enumerate() {
            if exact.iter().any(|start| a.name.starts_with(start)) {
                assert_eq!(a_value, b_value, "{} of pixel {pixel}", a.name);
            } else if a.name != "variance" {
                // Each part is rounded to 11 bits (or a multiple of 2^-24), so is their mean, and so is the whole.
                // Normals cancel: their rounding is that of numbers up to 1.
                let size = if a.name.starts_with("dnormal") { 2.0 } else { a_value.abs() + b_value.abs() };
                let bound = 2f32.powi(-11) * size + 2f32.powi(-24);
                assert!((a_value - b_value).abs() <= bound, "{} of pixel {pixel}: {a_value} {b_value}", a.name);
            } else {
                // Its means are of rounded light: an error of the means' own rounding, squared and to first order.
                let light = whole.channel("R").unwrap().samples[pixel].abs().max(1.0) * 3.0;
                let bound = 0.02 * b_value + (light * 2f32.powi(-10)).powi(2);
                assert!((a_value - b_value).abs() <= bound, "variance of pixel {pixel}: {a_value} {b_value}");
            }
            compared += 1;
        }
    }
    assert!(compared > 64 * 40 * 40);
    assert!(whole.channel("sampleCount").unwrap().samples.iter().all(|count| *count == 48.0));
}

/// A render that takes a second or so.
fn long(folder: &Path, arguments: &[&str]) -> Command {
    let settings = ["-o", "out.exr", "--set", "render.samples=64"];
    render(folder, TINY, &[&settings[..], arguments].concat())
}

/// Kills renders at odd moments, looks each time at what lies under the name, and goes on to the end.
fn killed(times: u32, threads: &str) {
    let folder = folder();
    let whole = folder.path().join("whole");
    std::fs::create_dir(&whole).unwrap();
    let start = std::time::Instant::now();
    done(long(&whole, &["--threads", threads, "--checkpoint", "0.02"]));
    let took = start.elapsed();
    let expected = std::fs::read(whole.join("out.exr")).unwrap();
    let target = folder.path().join("out.exr");
    let old = b"an old file".to_vec();
    let mut resumed = 0;
    let mut state = 0x2545_f491_4f6c_dd1d_u64 ^ u64::from(times);
    for round in 0..times {
        std::fs::write(&target, &old).unwrap();
        let mut goes_on = false;
        // Until it comes to its end: killed at a random moment at first, ever later, so that the end is reached.
        for attempt in 0u32.. {
            let checkpoint = folder.path().join(".out.exr.checkpoint");
            goes_on |= checkpoint.exists();
            let arguments = ["--threads", threads, "--resume", "--checkpoint", "0.02"];
            let mut child = long(folder.path(), &arguments).stderr(Stdio::null()).spawn().unwrap();
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            let share = (state >> 11) as f64 / (1u64 << 53) as f64;
            let wait = took.mul_f64(share * 1.1 + 0.3 * f64::from(attempt.saturating_sub(2)));
            let deadline = std::time::Instant::now() + wait;
            let ended = loop {
                if let Some(status) = child.try_wait().unwrap() {
                    break Some(status);
                }
                if std::time::Instant::now() >= deadline {
                    break None;
                }
                // All the while the name holds the old file or the whole new one.
                let found = std::fs::read(&target).unwrap();
                assert!(found == old || found == expected, "round {round}: {} bytes", found.len());
                std::thread::sleep(Duration::from_millis(2));
            };
            if ended.is_none() {
                child.kill().unwrap();
                child.wait().unwrap();
            }
            let found = std::fs::read(&target).unwrap();
            assert!(found == old || found == expected, "round {round}: {} bytes", found.len());
            if let Some(status) = ended {
                assert_eq!(status.code(), Some(0));
                break;
            }
            if found == expected {
                break;
            }
        }
        assert!(std::fs::read(&target).unwrap() == expected, "round {round}");
        resumed += u32::from(goes_on);
        let _ = std::fs::remove_file(folder.path().join(".out.exr.checkpoint"));
        done(long(folder.path(), &["--set", "render.samples=1"]));
        assert_eq!(names(&folder), ["out.exr", "whole"], "what killed renders leave is swept by the next");
    }
    assert!(resumed > 0, "no render went on from a checkpoint");
    eprintln!("{times} rounds of killed renders on {threads} threads, {resumed} went on from checkpoints");
}

#[test]
fn killed_renders_go_on_to_the_same_bytes() {
    killed(5, "2");
    killed(3, "1");
}

#[test]
#[ignore = "minutes: scripts/kill-test.sh"]
fn fifty_killed_renders_go_on_to_the_same_bytes() {
    killed(25, "2");
    killed(25, "1");
}

#[test]
fn four_scenes_have_the_same_bits_however_they_are_divided_and_resumed() {
    for (scene, further) in [
        ("small", &[][..]),
        ("pool", &["--set", "camera.motion_steps=2"]),
        ("valley", &[]),
        ("jacksboro", &["--set", "render.integrator=path"]),
    ] {
        let scene = format!("{}/scenes/{scene}/scene.toml", env!("CARGO_MANIFEST_DIR"));
        let folder = folder();
        let size = ["--set", "render.width=72", "--set", "render.height=48", "--set", "render.samples=4"];
        let fine = ["--noise", "0.1", "--set", "render.max_samples=16"];
        let coarse = ["--noise", "0.5", "--set", "render.max_samples=16"];
        let run = |arguments: &[&[&str]]| {
            done(render(folder.path(), &scene, &[&size[..], further, &arguments.concat()].concat()));
        };
        run(&[&fine, &["-o", "one.exr", "--threads", "1"]]);
        run(&[&fine, &["-o", "two.exr", "--threads", "2"]]);
        for index in ["3", "1", "2"] {
            let (tile, name) = (format!("{index}/3"), format!("t{index}.exr"));
            run(&[&fine, &["-o", &name, "--tile", &tile]]);
        }
        done(merge(folder.path(), &["t2.exr", "t3.exr", "t1.exr", "-o", "merged.exr"]));
        run(&[&coarse, &["-o", "resumed.exr", "--keep-checkpoint", "--threads", "2"]]);
        let early = picture(&folder, "resumed.exr");
        run(&[&fine, &["-o", "resumed.exr", "--resume", "--threads", "1"]]);
        let expected = bytes(&folder, "one.exr");
        for name in ["two.exr", "merged.exr", "resumed.exr"] {
            assert!(bytes(&folder, name) == expected, "{scene}: {name}");
        }
        assert_ne!(early.channels, picture(&folder, "one.exr").channels, "{scene}: there was nothing left to resume");
    }
}

/// A folder with a checkpoint of a finished render, and that render's file.
fn checkpoint(arguments: &[&str]) -> (TempDir, Vec<u8>) {
    let folder = folder();
    let settings = ["-o", "out.exr", "--keep-checkpoint", "--set", "render.width=64", "--set", "render.height=40"];
    done(render(folder.path(), TINY, &[&settings[..], arguments].concat()));
    let found = bytes(&folder, ".out.exr.checkpoint");
    (folder, found)
}

#[test]
fn a_noisy_frame_is_refined_to_the_bits_of_one_render() {
    let (coarse, fine) = (["--noise", "0.2"], ["--noise", "0.05"]);
    let max = ["--set", "render.max_samples=64", "--set", "render.samples=8"];
    let (folder, _) = checkpoint(&[&coarse[..], &max].concat());
    let size = ["-o", "out.exr", "--set", "render.width=64", "--set", "render.height=40"];
    let first = picture(&folder, "out.exr");
    done(render(folder.path(), TINY, &[&size[..], &fine, &max, &["--resume"]].concat()));
    let resumed = bytes(&folder, "out.exr");
    assert!(!folder.path().join(".out.exr.checkpoint").exists(), "the frame is done");
    done(render(folder.path(), TINY, &[&size[..], &fine, &max].concat()));
    assert!(bytes(&folder, "out.exr") == resumed);
    let taken = |picture: &Picture| picture.channel("sampleCount").unwrap().samples.iter().sum::<f32>();
    assert!(taken(&picture(&folder, "out.exr")) > 1.2 * taken(&first));

    // More samples, within one power of two.
    let (folder, _) = checkpoint(&["--set", "render.samples=48"]);
    let more = ["--set", "render.samples=64"];
    done(render(folder.path(), TINY, &[&size[..], &more, &["--resume"]].concat()));
    let resumed = bytes(&folder, "out.exr");
    done(render(folder.path(), TINY, &[&size[..], &more].concat()));
    assert!(bytes(&folder, "out.exr") == resumed);
}

#[test]
fn a_stopped_frame_goes_on() {
    let folder = folder();
    done(long(folder.path(), &["--set", "render.samples=256"]));
    let expected = bytes(&folder, "out.exr");
    std::fs::remove_file(folder.path().join("out.exr")).unwrap();
    // The interval never comes: what Ctrl-C leaves is written at the end.
    let mut child = long(folder.path(), &["--set", "render.samples=256", "--checkpoint", "1000"]).spawn().unwrap();
    while !folder.path().join(".out.exr.lock").exists() {
        assert!(child.try_wait().unwrap().is_none(), "the render ended by itself");
        std::thread::sleep(Duration::from_millis(2));
    }
    std::thread::sleep(Duration::from_millis(300));
    let id = child.id().to_string();
    assert!(Command::new("kill").args(["-INT", &id]).status().unwrap().success());
    let code = child.wait().unwrap().code();
    if code == Some(130) {
        assert!(folder.path().join(".out.exr.checkpoint").exists());
        done(long(folder.path(), &["--set", "render.samples=256", "--resume"]));
    } else {
        assert_eq!(code, Some(0), "done before the signal came");
    }
    assert!(bytes(&folder, "out.exr") == expected);
}

#[test]
fn checkpoints_that_are_damaged_or_of_another_picture_are_refused_with_the_reason() {
    let (folder, whole) = checkpoint(&[]);
    let path: PathBuf = folder.path().join(".out.exr.checkpoint");
    let size = ["-o", "out.exr", "--resume", "--set", "render.width=64", "--set", "render.height=40"];
    let old = bytes(&folder, "out.exr");
    let resume = |further: &[&str]| {
        let said = refused(render(folder.path(), TINY, &[&size[..], further].concat()));
        assert!(said.contains(".out.exr.checkpoint"), "{said}");
        assert!(bytes(&folder, "out.exr") == old);
        said
    };
    for keep in [0, 20, 40, 70, whole.len() / 2, whole.len() - 1] {
        std::fs::write(&path, &whole[..keep]).unwrap();
        let said = resume(&[]);
        assert!(said.contains("damaged") || said.contains("is not a checkpoint"), "{keep}: {said}");
    }
    // The version ends with the first line.
    let start = whole.iter().position(|&byte| byte == b'\n').unwrap() + 1;
    for at in (start..whole.len()).step_by(whole.len() / 30) {
        let mut bytes = whole.clone();
        bytes[at] ^= 1 << (at % 8);
        std::fs::write(&path, &bytes).unwrap();
        assert!(resume(&[]).contains("checksum"), "byte {at}");
    }
    let mut longer = whole.clone();
    longer.push(0);
    std::fs::write(&path, &longer).unwrap();
    assert!(resume(&[]).contains("checksum"));
    let mut other = whole.clone();
    other[start - 2] = b'x';
    std::fs::write(&path, &other).unwrap();
    assert!(resume(&[]).contains("version"));

    std::fs::write(&path, &whole).unwrap();
    for (further, expected) in [
        (&["--set", "sun.elevation=33"][..], "of the scene"),
        (&["--frame", "1"], "frame 0; expected 1"),
        (&["--set", "render.width=65"], "64x40 pixels; expected 65x40"),
        (&["--tile", "1/2"], "expected 1/2"),
        (&["--crop", "0,0,32,32"], "expected 1/1 0,0,32,32"),
        (&["--set", "render.samples=32"], "random numbers"),
        (&["--simd", "portable"], "--simd"),
    ] {
        let mut command = Command::new(env!("CARGO_BIN_EXE_whitewater"));
        command.args(["render", TINY, "-q"]).args(size).args(further).current_dir(folder.path());
        if !further.contains(&"--frame") {
            command.args(["--frame", "0"]);
        }
        let said = refused(command);
        assert!(said.contains(expected), "{further:?}: {said}");
    }
    // Whole, of this picture: nothing is left to do.
    done(render(folder.path(), TINY, &size));
    assert!(bytes(&folder, "out.exr") == old);
    // Without --resume an old one does not matter.
    std::fs::write(&path, b"rubbish").unwrap();
    done(render(folder.path(), TINY, &["-o", "out.exr"]));
    assert!(!path.exists());
}

/// A user who may not write everywhere.
#[cfg(unix)]
const NOBODY: u32 = 65534;

/// For tests that run as root, to whom no folder is read-only: the program and a scene where [`NOBODY`] reaches them, in a folder
/// of ours that is opened for it if they are out of its reach. `None` for anybody else.
#[cfg(unix)]
fn nobody(folder: &Path) -> Option<(PathBuf, String)> {
    use std::os::unix::fs::{MetadataExt, PermissionsExt};
    use std::os::unix::process::CommandExt;
    if std::fs::metadata(folder).unwrap().uid() != 0 {
        return None;
    }
    let open = |path: &Path, mode: u32| std::fs::set_permissions(path, std::fs::Permissions::from_mode(mode)).unwrap();
    open(folder, 0o755);
    let reaches = |program: &Path, scene: &Path| {
        let state = scene.with_file_name("time000.state");
        let inspect = Command::new(program).arg("inspect").arg(state).uid(NOBODY).gid(NOBODY).output();
        inspect.is_ok_and(|output| output.status.success())
    };
    let (program, scene) = (Path::new(env!("CARGO_BIN_EXE_whitewater")), Path::new(TINY));
    if reaches(program, scene) {
        return Some((program.to_owned(), TINY.to_owned()));
    }
    let open_folder = folder.join("reachable");
    std::fs::create_dir(&open_folder).unwrap();
    for file in std::fs::read_dir(scene.parent().unwrap()).unwrap() {
        let file = file.unwrap();
        let copy = open_folder.join(file.file_name());
        std::fs::copy(file.path(), &copy).unwrap();
        open(&copy, 0o644);
    }
    let copy = open_folder.join("program");
    std::fs::copy(program, &copy).unwrap();
    for path in [&open_folder, &copy] {
        open(path, 0o755);
    }
    let scene = open_folder.join("scene.toml");
    assert!(reaches(&copy, &scene), "{} cannot be run by another user", copy.display());
    Some((copy, scene.to_str().unwrap().to_owned()))
}

#[cfg(unix)]
#[test]
fn what_cannot_be_written_is_told_and_the_old_file_stays() {
    use std::os::unix::fs::PermissionsExt;
    use std::os::unix::process::CommandExt;
    let folder = folder();
    let old = folder.path().join("old.exr");
    std::fs::write(&old, b"an old file").unwrap();
    std::fs::create_dir(folder.path().join("folder.exr")).unwrap();
    let said = refused(render(folder.path(), TINY, &["-o", "folder.exr"]));
    assert!(said.contains("folder.exr is a folder"), "{said}");

    // A disk that is full after 16 blocks: the limit stands for it, and its signal is ignored as on a full disk.
    let mut full = Command::new("sh");
    full.args(["-c", "trap '' XFSZ; ulimit -f 16; exec \"$0\" \"$@\""]).arg(env!("CARGO_BIN_EXE_whitewater"));
    full.args(["render", TINY, "-q", "--frame", "0", "-o", "old.exr"]).current_dir(folder.path());
    let said = refused(full);
    assert!(said.contains("old.exr") && said.contains("File too large"), "{said}");
    assert_eq!(std::fs::read(&old).unwrap(), b"an old file");

    // Two renders into one file.
    let mut first = render(folder.path(), TINY, &["-o", "old.exr", "--set", "render.samples=4096"]).spawn().unwrap();
    let lock = folder.path().join(".old.exr.lock");
    while !lock.exists() {
        assert!(first.try_wait().unwrap().is_none(), "the first render ended by itself");
        std::thread::sleep(Duration::from_millis(2));
    }
    std::thread::sleep(Duration::from_millis(20));
    let said = refused(render(folder.path(), TINY, &["-o", "old.exr"]));
    first.kill().unwrap();
    first.wait().unwrap();
    assert!(said.contains("old.exr is being written by another render"), "{said}");
    assert_eq!(std::fs::read(&old).unwrap(), b"an old file");

    let locked = folder.path().join("locked");
    std::fs::create_dir(&locked).unwrap();
    std::fs::write(locked.join("a.exr"), b"an old file").unwrap();
    let nobody = nobody(folder.path());
    if let Some((program, scene)) = &nobody {
        // Its own folder, so that only the missing permission is in the way.
        std::os::unix::fs::chown(&locked, Some(NOBODY), Some(NOBODY)).unwrap();
        let mut writable = Command::new(program);
        writable.args(["render", scene, "-q", "--frame", "0", "-o", "b.exr"]).current_dir(&locked).uid(NOBODY);
        done(writable);
    }
    std::fs::set_permissions(&locked, std::fs::Permissions::from_mode(0o555)).unwrap();
    let mut command = render(&locked, TINY, &["-o", "a.exr"]);
    if let Some((program, scene)) = &nobody {
        command = Command::new(program);
        command.args(["render", scene, "-q", "--frame", "0", "-o", "a.exr"]).current_dir(&locked).uid(NOBODY);
    }
    let said = refused(command);
    assert!(said.contains("a.exr") && said.contains("ermission"), "{said}");
    std::fs::set_permissions(&locked, std::fs::Permissions::from_mode(0o755)).unwrap();
    assert_eq!(std::fs::read(locked.join("a.exr")).unwrap(), b"an old file");
}
