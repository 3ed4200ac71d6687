//! Mist from OpenVDB files, as the command line draws it and refuses it.

use std::path::Path;
use std::process::{Command, Output, Stdio};

use tempfile::TempDir;
use whitewater::output::{Picture, read_exr};

const VOLUMES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/volumes");
const TINY: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/tiny");

/// A folder with a scene that looks at the ball of mist in a file, with nothing but sky and water around it.
fn folder(file: &str) -> TempDir {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let scene = format!(
        "[frames]\nfiles = '{TINY}/time###.state'\n[mist]\nfile = '{file}'\nextinction = 0.03\n\
         [particles]\nrepresentation = 'none'\n[camera]\neye = [2.2, 3.2, 7.2]\nlook_at = [2.2, 3.2, 4.2]\nfov = 25\n\
         [render]\nwidth = 33\nheight = 21\nsamples = 16\n"
    );
    std::fs::write(folder.path().join("scene.toml"), scene).expect("written");
    folder
}

fn render(folder: &TempDir, arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_whitewater"));
    command
        .args(["render", "scene.toml", "-q", "--reproducible", "--layers", "all", "--checkpoint", "0"])
        .args(arguments);
    command.current_dir(folder.path()).env_remove("WHITEWATER_LOG").stdin(Stdio::null());
    command.output().expect("the program starts")
}

/// Frame 0 as it is drawn.
fn picture(folder: &TempDir, arguments: &[&str]) -> Picture {
    let arguments: Vec<&str> = ["--frame", "0", "-o", "o.exr"].iter().chain(arguments).copied().collect();
    let output = render(folder, &arguments);
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    read_exr(&folder.path().join("o.exr")).unwrap_or_else(|error| panic!("{error}"))
}

fn samples<'a>(picture: &'a Picture, name: &str) -> &'a [f32] {
    let channel = picture.channels.iter().find(|channel| channel.name == name);
    &channel.unwrap_or_else(|| panic!("no channel {name}")).samples
}

/// Mean of a channel.
fn mean(picture: &Picture, name: &str) -> f32 {
    let samples = samples(picture, name);
    samples.iter().sum::<f32>() / samples.len() as f32
}

/// The pixel in the middle.
fn middle(picture: &Picture, name: &str) -> f32 {
    samples(picture, name)[33 * 10 + 16]
}

/// What a command that must be refused says.
fn refused(folder: &TempDir, arguments: &[&str]) -> String {
    let output = render(folder, arguments);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{arguments:?}: {said}");
    assert!(!said.contains("panicked"), "{said}");
    said
}

#[test]
fn a_files_mist_is_its_own_layer_for_both_integrators_without_any_particle() {
    let folder = folder(&format!("{VOLUMES}/blosc.vdb"));
    let [path, whitted] =
        ["path", "whitted"].map(|name| picture(&folder, &["--integrator", name, "--set", "render.samples=64"]));
    let [one, other] = [&path, &whitted].map(|picture| mean(picture, "mist.G"));
    assert!(one > 0.0 && (one / other - 1.0).abs() < 0.1, "{one} {other}");
    for picture in [&path, &whitted] {
        assert!(middle(picture, "mist.G") > 4.0 * one && samples(picture, "mist.G")[0] == 0.0);
    }
    assert!(format!("{:?}", path.metadata.cryptomattes).contains("\"mist\""), "{:?}", path.metadata.cryptomattes);
    let none = picture(&folder, &["--set", "mist.extinction=0"]);
    assert_eq!(mean(&none, "mist.G"), 0.0);
    // What it scatters it takes from what is behind.
    let left = middle(&whitted, "sky.G") / middle(&none, "sky.G");
    let depth = -left.ln() / (0.03 * 12.0 * 0.2 * std::f32::consts::TAU.sqrt());
    assert!((0.2..1.1).contains(&depth), "{left}");
}

#[test]
fn thick_mist_gives_depth_and_motion_and_is_blurred_by_its_velocity() {
    let folder = folder(&format!("{VOLUMES}/half.vdb"));
    let thick = ["--integrator", "path", "--set", "mist.extinction=3"];
    let still = picture(&folder, &thick);
    let depth = middle(&still, "Z");
    assert!((2.4..3.0).contains(&depth), "{depth}");
    assert!((middle(&still, "velocity.x") - 3.0).abs() < 0.01 && (middle(&still, "velocity.z") + 1.0).abs() < 0.01);
    // A tenth of a second to the right: three voxels, in four steps.
    let blurred = ["--set", "camera.motion_steps=4", "--set", "camera.shutter=1", "--set", "frames.fps=10"];
    let column = |picture: &Picture, x: usize| samples(picture, "mist.G")[33 * 10 + x];
    let blurred: Vec<&str> = thick.iter().chain(&blurred).copied().collect();
    let moved = picture(&folder, &blurred);
    let edge = |picture: &Picture| (0..33).map(|x| column(picture, x) * x as f32).sum::<f32>();
    let sum = |picture: &Picture| (0..33).map(|x| column(picture, x)).sum::<f32>();
    let way = edge(&moved) / sum(&moved) - edge(&still) / sum(&still);
    // 33 pixels see 2 tan(12.5 degrees) 33 / 21 times 3 m: 16 of them a metre, and the mean moment is at 0.05 s.
    assert!((1.5..3.5).contains(&way), "{way}");
    let held: Vec<&str> = blurred.iter().chain(&["--set", "mist.velocity_scale=0"]).copied().collect();
    let held = picture(&folder, &held);
    assert!((edge(&held) / sum(&held) - edge(&still) / sum(&still)).abs() < 0.5);
}

#[cfg(feature = "oiio")]
#[test]
fn deep_pictures_have_the_files_mist_in_spans() {
    let folder = folder(&format!("{VOLUMES}/plain.vdb"));
    let with = |extinction: &str| {
        picture(&folder, &["--deep", "--set", &format!("mist.extinction={extinction}")]);
        std::fs::metadata(folder.path().join("o.deep.exr")).expect("a deep picture").len()
    };
    let (none, some) = (with("0"), with("0.05"));
    assert!(some > none + 1000, "{some} bytes with mist, {none} without");
}

#[test]
fn files_that_are_missing_or_no_mist_end_before_the_first_frame() {
    let folder = folder("none.vdb");
    let said = refused(&folder, &["--frame", "0", "-o", "o.exr"]);
    assert!(said.contains("mist.file") && said.contains("none.vdb"), "{said}");
    std::fs::write(folder.path().join("text.vdb"), "not a volume").expect("written");
    let said = refused(&folder, &["--frame", "0", "-o", "o.exr", "--set", "mist.file=text.vdb"]);
    assert!(said.contains("text.vdb: not a VDB file") && said.contains("220 to 225"), "{said}");
    let others = format!("mist.file={VOLUMES}/others.vdb");
    let said = refused(&folder, &["--frame", "0", "-o", "o.exr", "--set", &others, "--set", "mist.grid=fog"]);
    assert!(said.contains("no grid `fog` (mist.grid)") && said.contains("`density` (double)"), "{said}");
    let said = refused(&folder, &["--frame", "0", "-o", "o.exr", "--set", "mist.file="]);
    assert!(said.contains("mist.file"), "{said}");
    // Of a numbered one each frame must be there, which is told before any is drawn.
    let blosc = Path::new(VOLUMES).join("blosc.vdb");
    std::fs::copy(blosc, folder.path().join("cloud.0000.vdb")).expect("copied");
    let numbered = ["--set", "mist.file=cloud.####.vdb"];
    assert!(mean(&picture(&folder, &numbered), "mist.G") > 0.0);
    std::fs::remove_file(folder.path().join("o.exr")).expect("there");
    let said = refused(&folder, &["--frames", "0-1", "-o", "o.exr", numbered[0], numbered[1]]);
    assert!(said.contains("none for frame 1") && said.contains("0 to 0"), "{said}");
    assert_eq!(std::fs::read_dir(folder.path()).expect("a folder").count(), 3);
    let said = refused(&folder, &["--frame", "0", "-o", "o.exr", numbered[0], numbered[1], "--memory", "1k"]);
    assert!(said.contains("--memory"), "{said}");
}
