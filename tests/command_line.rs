//! The program as a person meets it: what it prints where, and its exit codes. Pictures and figures are tested elsewhere.

use std::path::PathBuf;
use std::process::{Command, Output, Stdio};

fn whitewater(arguments: &[&str]) -> Output {
    command(arguments).output().expect("the program starts")
}

fn command(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_whitewater"));
    command.args(arguments).env_remove("WHITEWATER_LOG").env("RUST_BACKTRACE", "1").stdin(Stdio::null());
    command
}

fn out(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned()
}

fn complaint(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// A scene file in a folder of its own.
fn scene(text: &str) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("scene.toml");
    std::fs::write(&path, text).expect("written");
    (folder, path)
}

/// Exit code 2, nothing on standard output, every error on a line of its own, no backtrace.
fn refused(output: &Output) -> Vec<String> {
    let complaint = complaint(output);
    assert_eq!(output.status.code(), Some(2), "{complaint}");
    assert_eq!(out(output), "");
    assert!(!complaint.contains("panicked") && !complaint.contains("backtrace"), "{complaint}");
    complaint.lines().filter_map(|line| line.strip_prefix("error: ")).map(str::to_owned).collect()
}

#[test]
fn help_names_every_command_and_shows_examples() {
    let output = whitewater(&["--help"]);
    assert_eq!(output.status.code(), Some(0));
    for part in ["render", "simulate", "inspect", "convert", "trace", "schema", "bench", "Examples:", "Exit codes:"] {
        assert!(out(&output).contains(part), "{part} is not in\n{}", out(&output));
    }
    for command in ["render", "simulate", "inspect", "convert", "trace", "schema", "bench"] {
        let output = whitewater(&[command, "--help"]);
        assert_eq!(output.status.code(), Some(0));
        assert!(out(&output).contains("Example"), "{command}");
    }
    let render = out(&whitewater(&["render", "--help"]));
    for option in [
        "--output",
        "--set",
        "--frame ",
        "--frames",
        "--threads",
        "--crop",
        "--memory",
        "--stats",
        "--reproducible",
        "--simd",
        "--accel",
        "--solver",
        "--accuracy",
        "--layers",
        "--denoise",
        "--compression",
        "--quiet",
        "--verbose",
    ] {
        assert!(render.contains(option), "{option}");
    }
}

#[test]
fn version_is_the_crates() {
    let output = whitewater(&["--version"]);
    assert_eq!((output.status.code(), out(&output)), (Some(0), format!("whitewater {}\n", env!("CARGO_PKG_VERSION"))));
}

#[test]
fn usage_errors_end_with_code_2() {
    for arguments in
        [&[][..], &["rendr"], &["render"], &["render", "a.toml", "--frames", "x"], &["schema", "--nonsense"]]
    {
        let output = whitewater(arguments);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
        assert_eq!(out(&output), "", "{arguments:?}");
        assert!(complaint(&output).contains("--help"), "{arguments:?}: {}", complaint(&output));
    }
    assert!(complaint(&whitewater(&["rendr"])).contains("'render'"));
}

#[test]
fn schema_is_json_that_describes_every_table() {
    let output = whitewater(&["schema"]);
    assert_eq!(output.status.code(), Some(0));
    let schema: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
    assert_eq!(schema["$schema"], "https://json-schema.org/draft/2020-12/schema");
    for table in ["frames", "environment", "surface", "water", "particles", "camera", "sky", "sun", "render", "accel"] {
        assert!(schema["properties"][table]["description"].is_string(), "{table}");
    }
    assert_eq!(schema["$defs"]["Render"]["properties"]["width"]["default"], 1280);
}

#[test]
fn all_errors_of_a_scene_and_its_overrides_are_printed_with_their_places() {
    let (_folder, path) = scene("[frames]\nfiles = 'time###.state'\n[camera]\nfow = 40\n[render]\n  width = 'big'\n");
    let path = path.to_str().expect("a path");
    for command in ["render", "trace"] {
        let mut arguments = vec![command, path, "--set", "water.ior=0.5", "--set", "sky.kind=starry"];
        if command == "trace" {
            arguments.extend(["--rays", "in.npz", "-o", "out.npz"]);
        }
        let errors = refused(&whitewater(&arguments));
        assert_eq!(errors.len(), 4, "{errors:#?}");
        let place = |line, column| format!("{path}:{line}:{column}: ");
        assert_eq!(errors[0], place(4, 1) + "unknown key `camera.fow`; the nearest known key is `camera.fov`");
        assert_eq!(errors[1], place(6, 11) + "`render.width` = 'big': expected an integer from 1 to 65536");
        assert_eq!(
            errors[2],
            "--set water.ior: `water.ior` = 0.5 is out of range: expected a finite number from 1 to 4"
        );
        assert!(
            errors[3]
                .starts_with("--set sky.kind: `sky.kind` = starry: expected one of `analytic`, `preetham`, `skybox`")
        );
    }
}

#[test]
fn a_missing_file_or_a_folder_is_named() {
    let (folder, _) = scene("");
    let missing = folder.path().join("nowhere.toml");
    let errors = refused(&whitewater(&["render", missing.to_str().expect("a path")]));
    assert_eq!(errors, [format!("{}: there is no such scene file", missing.display())]);
    let errors = refused(&whitewater(&["render", folder.path().to_str().expect("a path")]));
    assert!(errors[0].contains("this is a folder"), "{errors:?}");
    let frame = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/small/time000.state");
    let errors = refused(&whitewater(&["render", frame]));
    assert!(errors.len() == 1 && errors[0].contains("this is a simulation file"), "{errors:?}");
}

#[test]
fn an_override_without_a_value_is_a_usage_error() {
    let output = whitewater(&["render", "scene.toml", "--set", "render.width"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(complaint(&output).contains("expected KEY=VALUE, as in --set render.width=500"), "{}", complaint(&output));
}

#[test]
fn a_log_filter_that_is_none_is_refused() {
    let output = command(&["schema"]).env("WHITEWATER_LOG", "whitewater=loudly").output().expect("the program starts");
    assert!(refused(&output)[0].starts_with("WHITEWATER_LOG=whitewater=loudly: expected a filter"));
}

#[test]
fn a_reader_that_has_gone_is_no_error() {
    let closed = || {
        let (reader, writer) = std::io::pipe().expect("a pipe");
        drop(reader);
        writer
    };
    for arguments in [&["schema"][..], &["--help"]] {
        let output = command(arguments).stdout(closed()).stderr(Stdio::piped()).output().expect("the program starts");
        assert_eq!((output.status.code(), complaint(&output)), (Some(0), String::new()), "{arguments:?}");
    }
    let status = command(&["render", "nowhere.toml"]).stderr(closed()).status().expect("the program starts");
    assert_eq!(status.code(), Some(2), "an error keeps its code even if nobody reads it");
}

#[test]
fn what_blender_cannot_read_is_warned_of() {
    let folder = tempfile::tempdir().unwrap();
    let tiny = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/tiny/scene.toml");
    let path = folder.path().join("a.exr");
    let said = |compression: &str| {
        let arguments = ["render", tiny, "--frame", "0", "--profile", "blender", "--compression", compression, "-o"];
        let output = command(&arguments).arg(&path).output().unwrap();
        assert!(output.status.success(), "{}", complaint(&output));
        complaint(&output)
    };
    let lossy = said("dwaa");
    assert!(lossy.contains("Blender") && lossy.contains("leave it out"), "{lossy}");
    assert!(!said("zip").contains("Blender"));
}

#[test]
fn memory_thins_the_spray_until_it_fits_and_refuses_what_cannot() {
    use whitewater::state::{Columns, Encoding, Frame, Particles, save_frame};
    let (folder, path) = scene(
        "[frames]\nfiles = 'time###.npz'\n[camera]\neye = [4.0, 4.0, 12.0]\nlook_at = [1.0, 1.0, 1.0]\n[render]\nwidth = 16\n\
         height = 9\nsamples = 1\n[particles]\nrepresentation = 'spheres'\nleast_pixels = 0.0\n",
    );
    let columns = Columns::level([0.0; 2], [0.5; 2], [6, 6], 0.0, 1.0);
    let count = 200_000;
    let place = |k: u32| [k % 50, k / 50 % 50, k / 2500].map(|step| f64::from(step) * 0.04 + 1.5);
    let particles = Particles {
        position: (0..count).map(place).collect(),
        velocity: vec![[0.0; 3]; count as usize],
        mass: vec![1e-6; count as usize],
        age: vec![0.1; count as usize],
        id: None,
    };
    let frame = Frame { columns, particles, ..Frame::default() };
    save_frame(&frame, folder.path().join("time000.npz"), Encoding::Npz).expect("written");
    let at = |name: &str| folder.path().join(name).to_str().expect("a path").to_owned();
    let render = |more: &[&str]| {
        let (picture, stats) = (at("out.exr"), at("stats.json"));
        let arguments = ["render", path.to_str().expect("a path"), "-o", &picture, "--stats", &stats];
        whitewater(&[&arguments[..], more].concat())
    };
    let drawn = || {
        let stats = std::fs::read_to_string(at("stats.json")).expect("statistics");
        let stats: serde_json::Value = serde_json::from_str(&stats).expect("JSON");
        let particles = &stats["frames"][0]["particles"];
        [particles["found"].as_u64(), particles["drawn"].as_u64()].map(Option::unwrap_or_default)
    };
    let plenty = render(&["--memory", "8G"]);
    assert_eq!((plenty.status.code(), drawn()), (Some(0), [200_000; 2]), "{}", complaint(&plenty));
    let little = render(&["--memory", "180M"]);
    assert_eq!(little.status.code(), Some(0), "{}", complaint(&little));
    let [found, left] = drawn();
    assert!(found == 200_000 && (10_000..60_000).contains(&left), "{left}");
    let told = complaint(&little);
    assert!(told.contains("--memory 180 MB: 200000 particles would take 18 MB"), "{told}");
    assert!(told.contains(&format!("drew {left} of them, each wider")), "{told}");
    let errors = refused(&render(&["--memory", "100M"]));
    assert!(errors[0].contains("--memory") && errors[0].contains("100 MB"), "{errors:?}");
    for nonsense in ["0", "-1G", "plenty", "8X"] {
        let output = render(&[&format!("--memory={nonsense}")]);
        assert_eq!(output.status.code(), Some(2), "{nonsense}");
        assert!(complaint(&output).contains("512M or 8G"), "{}", complaint(&output));
    }
}
