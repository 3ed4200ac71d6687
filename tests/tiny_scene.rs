//! The program from files to files, over the smallest scene: layers, determinism, representations, statistics, exit codes.

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use tempfile::TempDir;
use whitewater::output::{Picture, SampleType, read_exr};

const SCENE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/tiny/scene.toml");

/// Light layers that a Whitted picture has.
const LIGHT: [&str; 9] = ["reflection", "refraction", "volume", "caustics", "spray", "foam", "mist", "terrain", "sky"];

fn render(folder: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_whitewater"));
    command.arg("render").arg(SCENE).args(arguments).current_dir(folder).env_remove("WHITEWATER_LOG");
    command.stdin(Stdio::null());
    command
}

fn done(mut command: Command) -> Output {
    let output = command.output().expect("the program starts");
    assert_eq!(output.status.code(), Some(0), "{command:?}: {}", String::from_utf8_lossy(&output.stderr));
    output
}

/// Frame 0, rendered with further arguments.
fn frame_0(arguments: &[&str]) -> Picture {
    let folder = folder();
    done(render(folder.path(), &[&["--frame", "0", "-o", "a.exr", "-q"], arguments].concat()));
    picture(&folder.path().join("a.exr"))
}

fn folder() -> TempDir {
    tempfile::tempdir().expect("a temporary folder")
}

fn picture(path: &Path) -> Picture {
    read_exr(path).unwrap_or_else(|error| panic!("{error}"))
}

fn samples<'a>(picture: &'a Picture, name: &str) -> &'a [f32] {
    &picture.channels.iter().find(|channel| channel.name == name).unwrap_or_else(|| panic!("no channel {name}")).samples
}

fn colour(picture: &Picture, layer: &str, pixel: usize) -> [f64; 3] {
    let prefix = if layer == "beauty" { String::new() } else { format!("{layer}.") };
    ["R", "G", "B"].map(|c| f64::from(samples(picture, &format!("{prefix}{c}"))[pixel]))
}

/// Root of the mean square difference of the beauty (R, G, B).
fn distance(a: &Picture, b: &Picture) -> f64 {
    assert_eq!(a.data, b.data);
    let count = samples(a, "R").len();
    let square = |pixel| {
        let (a, b) = (colour(a, "beauty", pixel), colour(b, "beauty", pixel));
        (0..3).map(|c| (a[c] - b[c]).powi(2)).sum::<f64>()
    };
    ((0..count).map(square).sum::<f64>() / (3 * count) as f64).sqrt()
}

/// Every channel of the format that a Whitted picture has, with its type (`h` half, `f` float).
fn expected_channels() -> Vec<(String, SampleType)> {
    use SampleType::{Float, Half};
    let mut channels = Vec::new();
    let mut layer = |name: &str, parts: &str, sample_type| {
        let full = |c: char| if name.is_empty() { c.to_string() } else { format!("{name}.{c}") };
        channels.extend(parts.chars().map(|c| (full(c), sample_type)));
    };
    layer("", "RGBA", Half);
    layer("", "Z", Float);
    layer("N", "xyz", Half);
    layer("P", "xyz", Float);
    layer("forward", "uv", Float);
    layer("backward", "uv", Float);
    layer("albedo", "RGB", Half);
    layer("dnormal", "xyz", Half);
    for light in LIGHT.into_iter().chain(["light_sun", "light_sky"]) {
        layer(light, "RGB", Half);
    }
    layer("velocity", "xyz", Half);
    channels.push(("mask.foam".to_owned(), Half));
    channels.extend(["water.depth", "water.path", "sampleCount"].map(|name| (name.to_owned(), Float)));
    for set in ["CryptoBed", "CryptoMaterial", "CryptoObject"] {
        channels.extend(whitewater::output::cryptomatte::channels(set).map(|name| (name, Float)));
    }
    channels.sort_by(|a, b| a.0.cmp(&b.0));
    channels
}

#[test]
fn both_frames_have_every_layer_and_the_layers_add_up() {
    let folder = folder();
    done(render(folder.path(), &["-o", "out.####.exr", "-q"]));
    let frames = ["out.0000.exr", "out.0001.exr"].map(|name| picture(&folder.path().join(name)));
    for (number, picture) in frames.iter().enumerate() {
        let mut found: Vec<_> = picture.channels.iter().map(|c| (c.name.clone(), c.sample_type)).collect();
        found.sort_by(|a, b| a.0.cmp(&b.0));
        assert_eq!(found, expected_channels());
        assert_eq!((picture.display, picture.data.width, picture.data.height), ((64, 36), 64, 36));
        assert_eq!((picture.metadata.frame, picture.metadata.complete), (number as i64, true));
        for channel in &picture.channels {
            assert!(channel.samples.iter().all(|sample| sample.is_finite()), "{} of frame {number}", channel.name);
        }
        for pixel in 0..64 * 36 {
            let beauty = colour(picture, "beauty", pixel);
            let layers = LIGHT.map(|layer| colour(picture, layer, pixel));
            for c in 0..3 {
                let sum: f64 = layers.iter().map(|layer| layer[c]).sum();
                let size: f64 = layers.iter().map(|layer| layer[c].abs()).sum::<f64>() + beauty[c].abs();
                // Each of the ten numbers is rounded to 11 bits, or to a multiple of 2^-24 below 2^-14.
                let bound = size * 2f64.powi(-11) + 10.0 * 2f64.powi(-25);
                assert!((sum - beauty[c]).abs() <= bound, "pixel {pixel}: {beauty:?} against {layers:?}");
            }
        }
        // Each part of the scene is in the picture, so that the sums above are not sums of nothing.
        for light in LIGHT {
            let seen = (0..64 * 36).any(|pixel| colour(picture, light, pixel)[1] > 0.01);
            assert_eq!(
                seen,
                !["foam", "mist", "volume"].contains(&light),
                "{light} of frame {number}: all but foam and mist, which this scene does not have, and what only paths find"
            );
        }
        assert!(samples(picture, "water.path").iter().any(|path| *path > 0.1));
        assert!(samples(picture, "forward.u").iter().any(|u| u.abs() > 0.1), "the camera moves");
    }
    assert!(distance(&frames[0], &frames[1]) > 0.01, "two frames are two pictures");
}

#[test]
fn threads_and_crops_do_not_change_a_bit() {
    let one = frame_0(&["--threads", "1"]);
    let two = frame_0(&["--threads", "2"]);
    assert_eq!(one.channels, two.channels);
    let crop = frame_0(&["--crop", "17,5,50,30"]);
    assert_eq!((crop.display, crop.data.x, crop.data.y, crop.data.width, crop.data.height), ((64, 36), 17, 5, 33, 25));
    for channel in &crop.channels {
        let whole = samples(&one, &channel.name);
        for (y, row) in channel.samples.chunks(33).enumerate() {
            let start = (y + 5) * 64 + 17;
            assert_eq!(row, &whole[start..start + 33], "{} row {y}", channel.name);
        }
    }
}

#[test]
fn reproducible_runs_are_the_same_bytes() {
    let bytes = || {
        let folder = folder();
        done(render(folder.path(), &["--frame", "1", "-o", "a.exr", "-q", "--reproducible"]));
        std::fs::read(folder.path().join("a.exr")).expect("a file")
    };
    assert!(bytes() == bytes(), "the files differ");
}

#[test]
fn statistics_tell_seconds_and_rays() {
    let folder = folder();
    done(render(folder.path(), &["-o", "out.####.exr", "-q", "--stats", "stats.json"]));
    let text = std::fs::read_to_string(folder.path().join("stats.json")).expect("statistics");
    let stats: serde_json::Value = serde_json::from_str(&text).expect("JSON");
    for phase in ["load_s", "build_s", "render_s", "write_s"] {
        assert!(stats[phase].as_f64().is_some_and(|seconds| seconds > 0.0), "{phase}: {}", stats[phase]);
    }
    let rays = stats["rays"].as_object().expect("rays by kind");
    let total: u64 = rays.values().filter_map(serde_json::Value::as_u64).sum();
    // Two frames of 64x36 pixels and 4 samples have that many camera rays alone.
    assert!(total > 2 * 64 * 36 * 4, "{rays:?}");
    assert_eq!(stats["frames"].as_array().map(Vec::len), Some(2));
    assert_eq!((stats["gave_up"].as_u64(), stats["nonfinite"].as_u64()), (Some(0), Some(0)));
}

#[test]
fn representations_are_different_pictures_of_the_same_place() {
    let spline = frame_0(&[]);
    let tessellated = frame_0(&["--set", "surface.representation=tessellated"]);
    let quads = frame_0(&["--set", "surface.representation=quads"]);
    let (near, far) = (distance(&spline, &tessellated), distance(&spline, &quads));
    assert!(near > 0.0 && near < far && far < 0.3, "tessellated {near}, quads {far} from the spline");
}

#[test]
fn spray_is_drawn_as_spheres_discs_streaks_or_not_at_all() {
    let spray = |name: &str| {
        let picture = frame_0(&["--set", &format!("particles.representation={name}")]);
        (0..64 * 36).map(|pixel| colour(&picture, "spray", pixel)[1]).sum::<f64>()
    };
    let (spheres, billboards, none) = (spray("spheres"), spray("billboards"), spray("none"));
    let streaks = spray("streamlines");
    assert_eq!(none, 0.0);
    assert!(spheres > 1.0 && billboards > 1.0 && spheres != billboards, "{spheres} {billboards}");
    assert!(streaks > 1.0 && streaks != spheres, "{streaks} {spheres}");
}

#[test]
fn every_accelerator_draws_the_same_picture_as_embree() {
    let embree = frame_0(&["--accel", "embree"]);
    for arguments in [["--accel", "brute"], ["--set", "accel.objects=bsp"], ["--set", "accel.objects=bsp-sah"]] {
        let other = frame_0(&arguments);
        assert!(embree.metadata.scene_hash != other.metadata.scene_hash, "both must have run");
        // Water is solved alike by all; spheres and triangles differ in the last bits of t. That may turn half's rounding
        // (2^-11 of a pixel) and, rarely, one sample of an edge; quadrilaterals are a hundred times as far.
        let difference = distance(&embree, &other);
        assert!(difference < 2e-4, "{arguments:?}: root mean square difference {difference}");
    }
}

#[test]
fn the_reports_accelerators_draw_nearly_that_picture_and_tell_what_they_lose() {
    let folder = folder();
    // A tolerance under what the audit calls wrong: what it counts is the method's own.
    let accuracy = ["--accuracy", "0.0001px"];
    let arguments = ["--frame", "0", "-o", "a.exr", "--accel", "report", "--stats", "stats.json"];
    let arguments = [&arguments[..], &accuracy].concat();
    let output = done(render(folder.path(), &arguments));
    let told = String::from_utf8_lossy(&output.stderr);
    assert!(told.contains("columns: of ") && told.contains("traced again exactly"), "{told}");
    let text = std::fs::read_to_string(folder.path().join("stats.json")).expect("statistics");
    let stats: serde_json::Value = serde_json::from_str(&text).expect("JSON");
    let count = |name: &str| stats["audit"][name].as_u64().unwrap_or_else(|| panic!("{name}: {}", stats["audit"]));
    // One in 256 of the rays; some meet the water, and few of them are wrong.
    assert!(count("rays") > 100 && count("hits") > 20, "{}", stats["audit"]);
    assert!(count("lost") + count("false") + count("wrong") < count("rays") / 10, "{}", stats["audit"]);
    let difference = distance(&frame_0(&[]), &picture(&folder.path().join("a.exr")));
    assert!(difference > 0.0 && difference < 0.05, "root mean square difference {difference}");
}

#[test]
fn a_frame_that_is_not_there_ends_with_code_2() {
    let folder = folder();
    let output = render(folder.path(), &["--frame", "7", "-o", "a.exr"]).output().expect("the program starts");
    let complaint = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{complaint}");
    assert!(complaint.contains("there is no frame 7; there are 2 from 0 to 1"), "{complaint}");
    assert!(!folder.path().join("a.exr").exists());
}

/// Stops a long render by a signal once it runs; its exit code and the files it left.
#[cfg(unix)]
fn stopped_by(signal: &str) -> (Option<i32>, TempDir, Vec<PathBuf>) {
    let folder = folder();
    // Minutes of work in many tiles: it cannot be done before the signal, and no tile takes long.
    let size = ["--set", "render.width=1024", "--set", "render.height=576", "--set", "render.samples=256"];
    let mut command = render(folder.path(), &[&["--frame", "0", "-o", "a.exr"][..], &size].concat());
    let mut child = command.stderr(Stdio::piped()).spawn().expect("the program starts");
    let mut stderr = BufReader::new(child.stderr.take().expect("a pipe"));
    let mut line = String::new();
    stderr.read_line(&mut line).expect("a line");
    assert!(line.contains("1024x576"), "{line}");
    let status = Command::new("kill").args(["-s", signal, &child.id().to_string()]).status().expect("kill");
    assert!(status.success());
    // Read on, so that the program never waits for a full pipe.
    std::io::copy(&mut stderr, &mut std::io::sink()).expect("the rest");
    let code = child.wait().expect("an end").code();
    let files = std::fs::read_dir(folder.path()).expect("a folder").map(|entry| entry.expect("an entry").path());
    let mut files: Vec<PathBuf> = files.collect();
    files.sort();
    (code, folder, files)
}

#[cfg(unix)]
#[test]
fn a_stopped_render_keeps_what_is_done_under_a_name_that_says_so() {
    for (signal, expected) in [("TERM", 143), ("INT", 130)] {
        let (code, folder, files) = stopped_by(signal);
        assert_eq!(code, Some(expected), "{signal}");
        let expected = [".a.exr.checkpoint", "a.partial.exr"].map(|name| folder.path().join(name));
        assert_eq!(files, expected, "{signal}");
        let partial = picture(&files[1]);
        assert!(!partial.metadata.complete);
        assert_eq!(partial.display, (1024, 576));
        assert!(partial.channels.iter().all(|channel| channel.samples.iter().all(|sample| sample.is_finite())));
    }
}

#[test]
fn denoising_changes_the_beauty_alone_and_keeps_what_it_was() {
    let plain = frame_0(&["--set", "camera.f_number=1.4"]);
    let folder = folder();
    let arguments = ["--frame", "0", "-q", "--denoise", "--set", "camera.f_number=1.4"];
    done(render(folder.path(), &[&arguments[..], &["-o", "a.exr", "--stats", "stats.json"]].concat()));
    let clean = picture(&folder.path().join("a.exr"));
    for c in ["R", "G", "B"] {
        assert_eq!(samples(&clean, &format!("noisy.{c}")), samples(&plain, c));
    }
    assert!(distance(&clean, &plain) > 1e-3, "nothing was filtered");
    for channel in plain.channels.iter().filter(|channel| !["R", "G", "B"].contains(&channel.name.as_str())) {
        assert_eq!(samples(&clean, &channel.name), channel.samples, "{}", channel.name);
    }
    assert_eq!(clean.channels.len(), plain.channels.len() + 3);
    assert!(clean.metadata.denoiser.starts_with("Open Image Denoise 2."), "{}", clean.metadata.denoiser);
    let stats = std::fs::read(folder.path().join("stats.json")).expect("statistics");
    let stats: serde_json::Value = serde_json::from_slice(&stats).expect("JSON");
    assert_eq!(stats["frames"][0]["denoise"]["pixels"], 64 * 36);
    assert_eq!(stats["frames"][0]["denoise"]["seconds"], stats["denoise_s"]);
    // Its guides need not be among the layers that are written.
    done(render(folder.path(), &[&arguments[..], &["-o", "b.exr", "--layers", "beauty"]].concat()));
    let beauty = picture(&folder.path().join("b.exr"));
    assert_eq!(beauty.channels.len(), 4);
    for channel in &beauty.channels {
        assert_eq!(channel.samples, samples(&clean, &channel.name));
    }
}

#[test]
fn a_denoiser_that_is_missing_is_told_before_anything_is_rendered() {
    let folder = folder();
    let nowhere = folder.path().join("libOpenImageDenoise.so.2");
    let arguments = ["--frame", "0", "-q", "-o", "a.exr"];
    let mut command = render(folder.path(), &[&arguments[..], &["--denoise"]].concat());
    let output = command.env("WHITEWATER_OIDN", &nowhere).output().expect("the program starts");
    let complaint = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{complaint}");
    for part in ["error: --denoise", nowhere.to_str().expect("a path"), "no such file", "make denoiser"] {
        assert!(complaint.contains(part), "{part:?} is missing in {complaint}");
    }
    assert_eq!(std::fs::read_dir(folder.path()).expect("a folder").count(), 0);
    // Whoever does not ask for it does not need it.
    let mut command = render(folder.path(), &arguments);
    command.env("WHITEWATER_OIDN", &nowhere);
    done(command);
}

#[test]
fn motion_blur_between_different_columns_is_refused_with_both_files() {
    use whitewater::state::{Encoding, read_frame, save_frame};
    let folder = folder();
    let mut frame = read_frame(Path::new(SCENE).with_file_name("time000.state"), 1e-3).expect("a frame");
    save_frame(&frame, folder.path().join("time000.state"), Encoding::Text).expect("written");
    frame.columns.width[0] *= 1.25;
    save_frame(&frame, folder.path().join("time001.state"), Encoding::Text).expect("written");
    let scene = std::fs::read_to_string(SCENE).expect("a scene");
    std::fs::write(folder.path().join("scene.toml"), scene).expect("written");
    let run = |arguments: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_whitewater"));
        command.args(["render", "scene.toml", "--frame", "0", "-q", "-o", "a.exr"]).args(arguments);
        command.current_dir(folder.path()).stdin(Stdio::null()).output().expect("the program starts")
    };
    assert_eq!(run(&[]).status.code(), Some(0));
    let output = run(&["--set", "camera.motion_steps=2"]);
    let complaint = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{complaint}");
    for part in ["time000.state", "time001.state", "width", "camera.motion_steps"] {
        assert!(complaint.contains(part), "{part:?} is missing in {complaint}");
    }
}
