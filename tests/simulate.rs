//! `whitewater simulate` as a person meets it: which files appear, how a run goes on, what it refuses, where the water is.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

use tempfile::TempDir;
use whitewater::state::{self, Encoding, FileKind, Frame};

/// A dam over a ledge in a closed basin: waves, spray, no water in or out.
const BASIN: &str = "
[frames]
files = 'frames/time###.state'
fps = 20
[simulation]
duration = 0.45
[simulation.terrain]
columns = [24, 12]
width = [0.25, 0.25]
[[simulation.terrain.ledge]]
at = 2
drop = 1
[simulation.water]
level = -0.8
[[simulation.water.body]]
rectangle = [-1, -1, 2, 4]
level = 0.6
[simulation.spray]
volume = 0.0005
least_height = 0.02
";

/// A scene in a folder of its own.
struct Scene {
    folder: TempDir,
}

impl Scene {
    fn new(text: &str) -> Self {
        let folder = tempfile::tempdir().expect("a temporary folder");
        fs::write(folder.path().join("scene.toml"), text).expect("written");
        Self { folder }
    }

    fn at(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn command(&self, command: &str, arguments: &[&str]) -> Command {
        let mut run = Command::new(env!("CARGO_BIN_EXE_whitewater"));
        run.arg(command).arg("scene.toml").args(arguments).current_dir(self.folder.path());
        run.env_remove("WHITEWATER_LOG").stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
        run
    }

    fn simulate(&self, arguments: &[&str]) -> Output {
        self.command("simulate", arguments).output().expect("the program starts")
    }

    /// Simulates and expects success; what was said.
    fn done(&self, arguments: &[&str]) -> String {
        let output = self.simulate(arguments);
        assert_eq!(output.status.code(), Some(0), "{arguments:?}: {}", said(&output));
        said(&output)
    }

    /// Simulates and expects exit code 2; the complaint.
    fn refused(&self, arguments: &[&str]) -> String {
        refused(&self.simulate(arguments))
    }

    fn frame(&self, name: &str) -> Frame {
        state::read_frame(self.at(name), 0.001).unwrap_or_else(|error| panic!("{error}"))
    }
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn refused(output: &Output) -> String {
    let said = said(output);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(said.contains("error: ") && !said.contains("panicked"), "{said}");
    said
}

/// Every file of a folder by its name.
fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    fs::read_dir(folder)
        .unwrap_or_else(|error| panic!("{}: {error}", folder.display()))
        .map(|entry| entry.expect("an entry"))
        .map(|entry| (entry.file_name().into_string().expect("Unicode"), fs::read(entry.path()).expect("read")))
        .collect()
}

fn names(folder: &Path) -> Vec<String> {
    files(folder).into_keys().collect()
}

fn assert_same_files(a: &Path, b: &Path) {
    let (a, b) = (files(a), files(b));
    assert!(a.keys().eq(b.keys()), "{:?} and {:?}", a.keys(), b.keys());
    let differing: Vec<&String> = a.keys().filter(|name| a[*name] != b[*name]).collect();
    assert!(differing.is_empty(), "{differing:?} differ");
}

/// Mass of all water in a frame (kg).
fn mass(frame: &Frame) -> f64 {
    let columns = &frame.columns;
    let depth: f64 = columns.top.iter().zip(&columns.base).map(|(top, base)| top - base).sum();
    1000.0 * depth * columns.width[0] * columns.width[1] + frame.particles.mass.iter().sum::<f64>()
}

fn wait_for(path: &Path, child: &mut Child) {
    let begin = Instant::now();
    while !path.exists() {
        assert!(child.try_wait().expect("a child").is_none(), "ended before {} was there", path.display());
        assert!(begin.elapsed() < Duration::from_secs(120), "{} never came", path.display());
        std::thread::sleep(Duration::from_millis(2));
    }
}

fn signal(child: &Child, name: &str) {
    let status = Command::new("kill").args(["-s", name, &child.id().to_string()]).status().expect("kill");
    assert!(status.success());
}

#[test]
fn frames_and_model_appear_where_the_scene_points() {
    let scene = Scene::new(BASIN);
    let said = scene.done(&["--stats", "stats.json"]);
    let mut expected = vec!["model.state".to_owned(), "simulation.checkpoint".to_owned()];
    // 0.45 s at 20 per second: 9 intervals.
    expected.extend((0..10).map(|number| format!("time{number:03}.state")));
    assert_eq!(names(&scene.at("frames")), expected);
    for number in 0..10 {
        let path = scene.at(&format!("frames/time{number:03}.state"));
        assert_eq!(state::detect(&path).unwrap(), FileKind::Frame(Encoding::Npz));
        let frame = state::read_frame(&path, 0.001).unwrap();
        assert_eq!(frame.time, f64::from(number) / 20.0);
        let extra: Vec<&str> = frame.extra.iter().map(|array| array.name.as_str()).collect();
        assert_eq!(extra, ["vorticity", "turbulence", "aeration"]);
        assert!(frame.extra.iter().all(|array| array.shape == [12, 24] && array.dtype == "<f4"));
    }
    let last = scene.frame("frames/time009.state");
    assert!(!last.particles.mass.is_empty(), "water falls over the ledge: there is spray");
    assert_eq!(last.particles.id.as_ref().map(Vec::len), Some(last.particles.mass.len()));
    assert!(said.contains("10 frames in ") && said.contains("water: "), "{said}");

    let stats: serde_json::Value = serde_json::from_slice(&fs::read(scene.at("stats.json")).unwrap()).unwrap();
    assert_eq!(stats["rows"].as_array().map(Vec::len), Some(10));
    for key in ["water", "spray", "turbulence", "writing", "prepare", "total"] {
        assert!(stats["seconds"][key].as_f64().is_some_and(|seconds| seconds > 0.0), "{key}: {stats:#}");
    }
    assert!(stats["ledger"]["relative"].as_f64().unwrap().abs() < 1e-6, "{:#}", stats["ledger"]);
    let (least, greatest) = (stats["least_dt"].as_f64().unwrap(), stats["greatest_dt"].as_f64().unwrap());
    assert!(0.0 < least && least <= greatest && greatest <= 0.05);
    let steps: u64 = stats["rows"].as_array().unwrap().iter().map(|row| row["steps"].as_u64().unwrap()).sum();
    assert_eq!(Some(steps), stats["steps"].as_u64());
    assert!(stats["spray"]["shed"].as_u64().unwrap() >= last.particles.mass.len() as u64);
    let bytes = fs::metadata(scene.at("frames/time004.state")).unwrap().len();
    assert_eq!(stats["rows"][4]["bytes"].as_u64(), Some(bytes));
}

#[test]
fn another_folder_keeps_the_names_and_quiet_says_nothing() {
    let scene = Scene::new(BASIN);
    let said = scene.done(&["-o", "there/a b", "--frames", "2", "-q", "--set", "frames.files='x/w_#.npz'"]);
    assert_eq!(said, "");
    assert_eq!(names(&scene.at("there/a b")), ["model.state", "simulation.checkpoint", "w_0.npz", "w_1.npz"]);
    assert!(!scene.at("x").exists());
    // What is in a .npz is NPZ.
    scene.done(&["-o", "text", "--frames", "1", "--text", "--set", "frames.files='w_##.npz'"]);
    assert_eq!(names(&scene.at("text")), ["model.state", "simulation.checkpoint", "w_00.state"]);
    // One frame needs no number.
    scene.done(&["-o", "one", "--frames", "1", "--set", "frames.files=still.state"]);
    assert_eq!(names(&scene.at("one")), ["model.state", "simulation.checkpoint", "still.state"]);
    scene.done(&["-o", "one", "--frames", "1", "--set", "frames.files=still.state"]);
    let complaint = scene.refused(&["-o", "two", "--frames", "2", "--set", "frames.files=still.state"]);
    assert!(complaint.contains("`still.state` is the name of one file"), "{complaint}");
}

#[test]
fn text_holds_the_same_numbers() {
    let scene = Scene::new(BASIN);
    scene.done(&["-o", "npz", "--frames", "8"]);
    scene.done(&["-o", "text", "--frames", "8", "--text"]);
    for number in 0..8 {
        let name = format!("time{number:03}.state");
        assert_eq!(state::detect(scene.at(&format!("text/{name}"))).unwrap(), FileKind::Frame(Encoding::Text));
        let mut npz = scene.frame(&format!("npz/{name}"));
        let text = scene.frame(&format!("text/{name}"));
        // Text has no place for these.
        npz.extra.clear();
        npz.particles.id = None;
        assert_eq!(text, npz);
    }
}

#[test]
fn a_run_in_parts_makes_the_same_bits_at_any_thread_count() {
    let scene = Scene::new(&BASIN.replace("duration = 0.45", "duration = 0.45\nsettle = 1.3"));
    scene.done(&["-o", "whole", "--threads", "2"]);
    let first = scene.at("parts/simulation.checkpoint");
    let mut before = None;
    for frames in ["1", "3", "4", "10"] {
        scene.done(&["-o", "parts", "--threads", "1", "--frames", frames]);
        if frames == "3" {
            before = Some(fs::read(&first).unwrap());
        }
        if frames == "4" {
            // As if it had been killed between frame 3 and its checkpoint.
            fs::write(&first, before.take().unwrap()).unwrap();
        }
    }
    assert_same_files(&scene.at("whole"), &scene.at("parts"));
    let said = scene.done(&["-o", "parts"]);
    assert!(said.contains("10 frames in ") && said.contains(" 0 steps"), "nothing is left to do: {said}");
    assert_same_files(&scene.at("whole"), &scene.at("parts"));
}

#[test]
fn whenever_it_is_killed_a_run_goes_on_to_the_same_bits() {
    let scene = Scene::new(&BASIN.replace("duration = 0.45", "duration = 0.95\nsettle = 2"));
    scene.done(&["-o", "whole"]);
    // Killed without a word, interrupted, terminated: at three moments each, the settling among them.
    for (signal_name, code) in [("KILL", None), ("INT", Some(130)), ("TERM", Some(143))] {
        for moment in ["simulation.checkpoint", "time000.state", "time007.state"] {
            let folder = scene.at(&format!("{signal_name} {moment}"));
            let name = folder.to_str().unwrap();
            let mut child = scene.command("simulate", &["-o", name]).spawn().unwrap();
            wait_for(&folder.join(moment), &mut child);
            signal(&child, signal_name);
            let output = child.wait_with_output().unwrap();
            // It may have been done before the signal came.
            if output.status.code() != Some(0) {
                assert_eq!(output.status.code(), code, "{}", said(&output));
                assert!(code.is_none() || said(&output).contains("goes on from here"), "{}", said(&output));
            }
            for (file, _) in files(&folder).iter().filter(|(file, _)| file.starts_with("time")) {
                state::read_frame(folder.join(file), 0.001).unwrap_or_else(|error| panic!("{error}"));
            }
            scene.done(&["-o", name]);
            // A killed run may leave the file that it was writing, under a hidden name.
            for file in names(&folder).iter().filter(|file| file.starts_with(".whitewater-")) {
                fs::remove_file(folder.join(file)).unwrap();
            }
            assert_same_files(&scene.at("whole"), &folder);
        }
    }
}

#[test]
fn frames_from_elsewhere_are_only_replaced_on_request() {
    let scene = Scene::new(BASIN);
    scene.done(&["-o", "a", "--frames", "2"]);
    fs::create_dir(scene.at("b")).unwrap();
    for name in ["b/time001.state", "b/time007.state"] {
        fs::copy(scene.at("a/time000.state"), scene.at(name)).unwrap();
    }
    let before = files(&scene.at("b"));
    let complaint = scene.refused(&["-o", "b", "--frames", "3"]);
    assert!(complaint.contains("time001.state") && complaint.contains("--restart"), "{complaint}");
    assert_eq!(files(&scene.at("b")), before);
    let said = scene.done(&["-o", "b", "--frames", "3", "--restart"]);
    assert!(said.contains("time007.state") && said.contains("stay behind"), "{said}");
    assert_eq!(files(&scene.at("b"))["time007.state"], before["time007.state"]);
    assert_ne!(files(&scene.at("b"))["time001.state"], before["time001.state"]);
    // Nor is a frame that came later, where the run would go on.
    fs::copy(scene.at("a/time000.state"), scene.at("a/time002.state")).unwrap();
    let complaint = scene.refused(&["-o", "a", "--frames", "4"]);
    assert!(complaint.contains("time002.state: not what this simulation makes of frame 2"), "{complaint}");
    fs::rename(scene.at("a/time002.state"), scene.at("a/time1.state")).unwrap();
    let complaint = scene.refused(&["-o", "a", "--frames", "4"]);
    assert!(complaint.contains("time1.state: this frame is not of those"), "{complaint}");
    let complaint = scene.refused(&["-o", "a", "--frames", "4", "--restart"]);
    assert!(complaint.contains("frame 1 would have two files"), "{complaint}");
}

#[test]
fn a_restart_takes_away_what_the_former_run_made() {
    let scene = Scene::new(BASIN);
    scene.done(&["--frames", "6"]);
    let before = files(&scene.at("frames"));
    let complaint = scene.refused(&["--frames", "6", "--set", "simulation.friction=0.9"]);
    assert!(complaint.contains("another simulation") && complaint.contains("--restart"), "{complaint}");
    let complaint = scene.refused(&["--frames", "6", "--set", "frames.fps=25"]);
    assert!(complaint.contains("another simulation"), "{complaint}");
    assert_eq!(files(&scene.at("frames")), before, "a refusal changes nothing");
    // How long it runs is no other simulation.
    scene.done(&["--set", "simulation.duration=0.3"]);
    scene.done(&["--frames", "3", "--restart", "--set", "simulation.friction=0.9"]);
    assert_eq!(
        names(&scene.at("frames")),
        ["model.state", "simulation.checkpoint", "time000.state", "time001.state", "time002.state"]
    );
    scene.done(&["-o", "fresh", "--frames", "3", "--set", "simulation.friction=0.9"]);
    assert_same_files(&scene.at("fresh"), &scene.at("frames"));
}

#[test]
fn a_checkpoint_that_cannot_be_gone_on_from_says_what_to_do() {
    let scene = Scene::new(BASIN);
    scene.done(&["--frames", "4"]);
    let checkpoint = scene.at("frames/simulation.checkpoint");
    let whole = fs::read(&checkpoint).unwrap();
    let mut flipped = whole.clone();
    let middle = flipped.len() / 2;
    flipped[middle] ^= 1;
    for damaged in [&whole[..whole.len() / 2], &flipped, b"", b"junk"] {
        fs::write(&checkpoint, damaged).unwrap();
        let complaint = scene.refused(&["--frames", "5"]);
        assert!(complaint.contains("simulation.checkpoint: damaged") && complaint.contains("--restart"), "{complaint}");
    }
    assert!(!scene.at("frames/time004.state").exists());
    // A frame passed off as a checkpoint.
    fs::copy(scene.at("frames/time000.state"), &checkpoint).unwrap();
    assert!(scene.refused(&["--frames", "5"]).contains("--restart"));
    fs::write(&checkpoint, &whole).unwrap();
    fs::remove_file(scene.at("frames/time001.state")).unwrap();
    let complaint = scene.refused(&["--frames", "5"]);
    assert!(complaint.contains("time001.state") && complaint.contains("--restart"), "{complaint}");
    fs::write(&checkpoint, &whole[..whole.len() / 2]).unwrap();
    let said = scene.done(&["--frames", "4", "--restart"]);
    assert!(said.contains("damaged"), "{said}");
    scene.done(&["-o", "fresh", "--frames", "4"]);
    assert_same_files(&scene.at("fresh"), &scene.at("frames"));
}

#[test]
fn a_changed_height_map_is_another_simulation() {
    let scene = Scene::new(
        "[frames]\nfiles = 'frames/time###.state'\n[simulation.terrain]\nkind = 'file'\nfile = 'bed.asc'\n\
         [simulation.water]\nlevel = 2\n",
    );
    let map = "ncols 4\nnrows 3\nxllcorner 0\nyllcorner 0\ncellsize 1\n0 0 0 1\n0 0 1 1\n0 1 1 3\n";
    fs::write(scene.at("bed.asc"), map).unwrap();
    scene.done(&["--frames", "2"]);
    fs::write(scene.at("bed.asc"), map.replace("1 3\n", "1 2.5\n")).unwrap();
    assert!(scene.refused(&["--frames", "3"]).contains("another simulation"));
    fs::write(scene.at("bed.asc"), map).unwrap();
    scene.done(&["--frames", "3"]);
    fs::write(scene.at("bed.asc"), "junk").unwrap();
    let complaint = scene.refused(&["--frames", "3"]);
    assert!(complaint.contains("bed.asc"), "{complaint}");
    fs::remove_file(scene.at("bed.asc")).unwrap();
    let complaint = scene.refused(&["--frames", "3"]);
    assert!(complaint.contains("bed.asc"), "{complaint}");
}

#[test]
fn the_model_goes_with_the_frames_and_finds_its_meshes() {
    let scene = Scene::new(&BASIN.replace("duration", "model = 'models/rocks.state'\nduration"));
    fs::create_dir(scene.at("models")).unwrap();
    let triangle = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
    fs::write(scene.at("models/rock.obj"), triangle).unwrap();
    let model = "whitewater-model 1\nsphere 3 0 1 0.4 0.5 0.5 0.5\nmesh rock.obj\nend\n";
    fs::write(scene.at("models/rocks.state"), model).unwrap();
    scene.done(&["--frames", "1"]);
    let there = state::read_model(scene.at("frames/model.state")).unwrap();
    assert_eq!((there.spheres.len(), there.meshes.as_slice()), (1, &["../models/rock.obj".to_owned()][..]));
    assert!(scene.at("frames").join(&there.meshes[0]).exists());
    // A moved sphere is another simulation.
    fs::write(scene.at("models/rocks.state"), model.replace("0.4", "0.45")).unwrap();
    assert!(scene.refused(&["--frames", "2"]).contains("another simulation"));
    // The environment's model stands in the water too.
    let other = Scene::new(&format!("{BASIN}[environment]\nmodel = 'rocks.state'\n"));
    fs::write(other.at("rocks.state"), model.replace("mesh rock.obj\n", "")).unwrap();
    other.done(&["--frames", "1"]);
    assert_eq!(state::read_model(other.at("frames/model.state")).unwrap().spheres.len(), 1);
    // Without either, somebody's own model is left alone.
    let plain = Scene::new(BASIN);
    fs::create_dir(plain.at("frames")).unwrap();
    fs::copy(other.at("rocks.state"), plain.at("frames/model.state")).unwrap();
    let complaint = plain.refused(&["--frames", "1"]);
    assert!(complaint.contains("model.state") && complaint.contains("simulation.model"), "{complaint}");
    // It can be the one beside the frames.
    plain.done(&["--frames", "1", "--set", "simulation.model=frames/model.state"]);
    assert_eq!(state::read_model(plain.at("frames/model.state")).unwrap().spheres.len(), 1);
}

#[test]
fn missing_frames_say_which_command_makes_them() {
    let scene = Scene::new(BASIN);
    let complaint = |command: &str, arguments: &[&str]| {
        refused(&scene.command(command, arguments).output().expect("the program starts"))
    };
    let trace = ["--rays", "rays.npz", "-o", "hits.npz"];
    write_rays(&scene.at("rays.npz"));
    for complaint in [complaint("render", &[]), complaint("trace", &trace)] {
        assert!(complaint.contains("`whitewater simulate scene.toml` makes them"), "{complaint}");
    }
    scene.done(&["--frames", "2"]);
    let render = complaint("render", &["--frames", "0-5"]);
    assert!(render.contains("no frame 2, 3, 4, 5;"), "{render}");
    let trace = complaint("trace", &[&trace[..], &["--frame", "5"]].concat());
    for complaint in [render, trace] {
        assert!(complaint.contains("`whitewater simulate scene.toml --frames 6` makes them"), "{complaint}");
    }
    let without = Scene::new("[frames]\nfiles = 'time###.state'\n");
    let output = without.command("render", &[]).output().unwrap();
    assert!(!refused(&output).contains("simulate"), "nothing makes frames of a scene without [simulation]");
}

fn write_rays(path: &Path) {
    state::write_arrays(path, |archive| {
        archive.array("origin", &[1, 3], [0.0_f64, 9.0, 0.0])?;
        archive.array("direction", &[1, 3], [0.0_f64, -1.0, 0.0])
    })
    .unwrap();
}

#[test]
fn what_cannot_be_done_is_refused_with_what_was_expected() {
    let without = Scene::new("[frames]\nfiles = 'time###.state'\n");
    let complaint = without.refused(&[]);
    assert!(complaint.contains("scene.toml: there is no [simulation] table"), "{complaint}");
    assert_eq!(names(without.folder.path()), ["scene.toml"]);

    let scene = Scene::new(BASIN);
    assert_eq!(scene.simulate(&["--frames", "0"]).status.code(), Some(2));
    fs::write(scene.at("file"), "").unwrap();
    let complaint = scene.refused(&["-o", "file"]);
    assert!(complaint.contains("file: cannot make the folder"), "{complaint}");
    let complaint = scene.refused(&["-o", "file/deeper"]);
    assert!(complaint.contains("file/deeper: cannot make the folder"), "{complaint}");
    let complaint = scene.refused(&["--set", "frames.files=model.state", "--frames", "1"]);
    assert!(complaint.contains("`model.state` is the name of another file"), "{complaint}");
    let complaint = scene.refused(&["--set", "simulation.duration=1e6", "--set", "frames.fps=1000"]);
    assert!(complaint.contains("1000000001 frames") && complaint.contains("--frames"), "{complaint}");
    let complaint = scene.refused(&["--set", "simulation.step=1e-6", "--set", "simulation.most_steps=100"]);
    assert!(complaint.contains("simulation.step") && complaint.contains("most_steps is 100"), "{complaint}");
    let complaint = scene.refused(&["--set", "simulation.most_steps=1"]);
    assert!(complaint.contains("most_steps is 1") && complaint.contains("column"), "{complaint}");
    let complaint = scene.refused(&["--set", "simulation.model=nowhere.state"]);
    assert!(complaint.contains("nowhere.state"), "{complaint}");
    // A name under which no file can be: writing fails after the first steps.
    fs::create_dir_all(scene.at("taken/time002.state")).unwrap();
    let complaint = scene.refused(&["-o", "taken", "--frames", "4"]);
    assert!(complaint.contains("time002.state"), "{complaint}");
    scene.frame("taken/time001.state");
    fs::remove_dir(scene.at("taken/time002.state")).unwrap();
    scene.done(&["-o", "taken", "--frames", "4"]);
    scene.done(&["-o", "fresh", "--frames", "4"]);
    assert_same_files(&scene.at("fresh"), &scene.at("taken"));
}

#[test]
fn a_closed_basin_keeps_its_mass_in_the_files_alone() {
    let scene = Scene::new(BASIN);
    scene.done(&["--set", "simulation.duration=3"]);
    let first = mass(&scene.frame("frames/time000.state"));
    let mut sprays = 0;
    for number in 0..=60 {
        let frame = scene.frame(&format!("frames/time{number:03}.state"));
        let now = mass(&frame);
        assert!(((now - first) / first).abs() < 1e-6, "frame {number}: {now} kg, not {first}");
        sprays += usize::from(!frame.particles.mass.is_empty());
    }
    assert!(sprays > 5, "{sprays} of 61 frames have spray");
}

#[test]
fn the_account_closes_with_sources_sinks_and_rain() {
    let scene = Scene::new(&format!(
        "{BASIN}[[simulation.source]]\nedge = 'west'\nlevel = 0.9\n\
         [[simulation.source]]\ncircle = [4, 1.5, 0.6]\ndischarge = 0.5\nbegin = 0.21\nend = 0.4\n\
         [[simulation.sink]]\nedge = 'east'\n"
    ));
    scene.done(&[
        "--set",
        "simulation.water.rain=36000",
        "--set",
        "simulation.duration=2",
        "--stats",
        "stats.json",
        "-q",
    ]);
    let stats: serde_json::Value = serde_json::from_slice(&fs::read(scene.at("stats.json")).unwrap()).unwrap();
    for row in stats["rows"].as_array().unwrap() {
        let ledger = &row["ledger"];
        let figure = |key: &str| ledger[key].as_f64().unwrap();
        assert!(figure("relative").abs() < 1e-9, "{row:#}");
        let water = figure("columns") + figure("particles");
        let frame = scene.frame(&format!("frames/time{:03}.state", row["frame"].as_u64().unwrap()));
        assert!((mass(&frame) / 1000.0 - water).abs() < 1e-6 * water, "{row:#}");
    }
    let last = &stats["ledger"];
    assert!(last["left"].as_f64().unwrap() > 0.0, "{last:#}");
}

#[test]
fn what_is_poured_in_is_what_the_scene_says_whenever_it_begins_and_ends() {
    // 10 mm/s of rain on 18 m2 for 0.33 s; 0.5 m3/s for 0.19 s.
    let scene = Scene::new(&format!(
        "{BASIN}[[simulation.source]]\ncircle = [4, 1.5, 0.6]\ndischarge = 0.5\nbegin = 0.21\nend = 0.4\n"
    ));
    let rain = ["--set", "simulation.water.rain=36000", "--set", "simulation.water.rain_end=0.33"];
    scene.done(&rain);
    let [first, last] = ["frames/time000.state", "frames/time009.state"].map(|name| mass(&scene.frame(name)));
    let poured = (last - first) / 1000.0;
    let expected = 0.01 * 18.0 * 0.33 + 0.5 * 0.19;
    assert!((poured - expected).abs() < 1e-6 * last / 1000.0, "{poured} m3, not {expected}");
}

#[test]
fn extremes_end_with_finite_frames_or_a_clear_error() {
    let small = "[frames]\nfiles = 'frames/time###.state'\n[simulation]\nduration = 0.125\n";
    let cases: [(&str, String); 9] = [
        ("dry", small.to_owned()),
        ("dry start and rain", format!("{small}settle = 100\n[simulation.water]\nrain = 100\n")),
        (
            "the least map",
            format!(
                "{small}[simulation.terrain]\ncolumns = [3, 3]\n[[simulation.water.body]]\ncircle = [0.25, 0.25, 0.1]\ndepth = 5\n"
            ),
        ),
        (
            "one wet column among dry ones",
            format!("{small}[[simulation.water.body]]\nrectangle = [1.9, 1.9, 2.1, 2.1]\ndepth = 3\n"),
        ),
        ("a huge source", format!("{small}[[simulation.source]]\ncircle = [2, 2, 0.5]\ndischarge = 1e9\n")),
        ("a source as high as a mountain", format!("{small}[[simulation.source]]\nedge = 'west'\ndepth = 1000000\n")),
        (
            "cliffs of 1 km",
            format!(
                "{small}[simulation.terrain]\n[[simulation.terrain.ledge]]\nat = 5\ndrop = 1000\n[[simulation.terrain.ledge]]\nat = 12\ndrop = -1000\n[simulation.water]\nlevel = 0.5\n"
            ),
        ),
        (
            "a step of 1000 s",
            format!(
                "{small}step = 1000\n[simulation.water]\ndepth = 0.4\n[[simulation.water.body]]\nedge = 'west'\ndepth = 2\n"
            ),
        ),
        (
            "pressure like a hammer",
            format!(
                "{small}[simulation.water]\ndepth = 0.5\n[[simulation.pressure]]\ncircle = [5, 2, 1]\npascal = 1e8\n"
            ),
        ),
    ];
    for (name, text) in cases {
        let scene = Scene::new(&text);
        // A million particles are stable too, but take their time.
        let output =
            scene.simulate(&["-q", "--set", "simulation.most_steps=2000", "--set", "simulation.spray.most=5000"]);
        match output.status.code() {
            Some(0) => {
                // Reading refuses every number that is not finite.
                for number in 0..4 {
                    let frame = scene.frame(&format!("frames/time{number:03}.state"));
                    assert!(frame.columns.top.iter().zip(&frame.columns.base).all(|(top, base)| top >= base), "{name}");
                }
            }
            _ => {
                let complaint = refused(&output);
                assert!(complaint.contains("most_steps"), "{name}: {complaint}");
                eprintln!("{name}: {complaint}");
            }
        }
    }
}

/// The foam that a frame's file carries.
fn foam(path: &Path) -> state::FoamArrays {
    let columns = state::read_frame(path, 0.001).unwrap_or_else(|error| panic!("{error}")).columns;
    state::read_foam(path, &columns).unwrap_or_else(|error| panic!("{error}"))
}

#[test]
fn foam_comes_into_the_frames_on_request_and_changes_nothing_else() {
    let scene = Scene::new(&BASIN.replace("duration = 0.45", "duration = 0.45\nsettle = 0.3"));
    let on = ["--set", "simulation.foam=true"];
    scene.done(&["-o", "off"]);
    scene.done(&[&["-o", "on"], &on[..]].concat());
    for number in 0..10 {
        let name = format!("time{number:03}.state");
        let (mut with, without) = (scene.frame(&format!("on/{name}")), scene.frame(&format!("off/{name}")));
        assert_eq!(with.extra.len(), without.extra.len() + 6);
        with.extra.retain(|array| !array.name.starts_with("foam"));
        assert_eq!(with, without, "{name}");
        assert_eq!(foam(&scene.at(&format!("off/{name}"))), state::FoamArrays::None);
    }
    let state::FoamArrays::Whole(last) = foam(&scene.at("on/time009.state")) else { panic!("no foam") };
    assert!(last.density.iter().any(|&density| density > 0.1), "a dam that breaks over a ledge is white");
    assert!(last.density.iter().all(|density| (0.0..=1.0).contains(density)));
    assert!(last.offset[0].iter().any(|offset| offset[0] < -0.1), "its pattern has moved with the water");
    // In parts, the same bits; another lifetime is another simulation; text has no place for it.
    for frames in ["1", "4", "10"] {
        scene.done(&[&["-o", "parts", "--threads", "1", "--frames", frames], &on[..]].concat());
    }
    assert_same_files(&scene.at("on"), &scene.at("parts"));
    let complaint = scene.refused(&[&["-o", "on", "--set", "foam.lifetime=1"], &on[..]].concat());
    assert!(complaint.contains("another simulation"), "{complaint}");
    let complaint = scene.refused(&[&["-o", "text", "--text"], &on[..]].concat());
    assert!(complaint.contains("no place for foam"), "{complaint}");
}

#[test]
fn a_frame_rendered_alone_has_the_foam_that_it_has_in_a_run() {
    let scene = Scene::new(BASIN);
    scene.done(&["--frames", "8"]);
    let render = |arguments: &[&str]| {
        let common =
            ["--reproducible", "-q", "--set", "render.width=64", "--set", "render.height=36", "--set", "foam.window=4"];
        let output = scene.command("render", &[&common, arguments].concat()).output().expect("the program starts");
        assert_eq!(output.status.code(), Some(0), "{arguments:?}: {}", said(&output));
    };
    render(&["--frames", "1,2,5,7", "-o", "run.####.exr"]);
    for number in ["1", "5", "7"] {
        render(&["--frames", number, "-o", "alone.####.exr"]);
        let [run, alone] = ["run", "alone"].map(|name| fs::read(scene.at(&format!("{name}.000{number}.exr"))).unwrap());
        assert!(run == alone, "frame {number}");
    }
    let picture = whitewater::output::read_exr(&scene.at("alone.0007.exr")).unwrap();
    let mask = &picture.channels.iter().find(|channel| channel.name == "mask.foam").unwrap().samples;
    assert!(mask.iter().any(|&share| share > 0.5) && mask.contains(&0.0));
    // A window that reaches over a frame which is damaged says so.
    fs::write(scene.at("frames/time006.state"), b"whitewater-frame 1\n").unwrap();
    let output = scene.command("render", &["--frames", "7", "-o", "x.exr", "--set", "foam.window=4"]).output().unwrap();
    let complaint = refused(&output);
    assert!(complaint.contains("foam.window = 4") && complaint.contains("time006.state"), "{complaint}");
}
