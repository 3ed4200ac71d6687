//! Reading a scene file whole: text, syntax, values, overrides, presets, rules; all errors of all steps together.

use std::collections::HashSet;
use std::fmt::Write as _;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use sha2::{Digest, Sha256};

use super::document;
use super::errors::{Place, SceneError, SceneErrors};
use super::overrides::{self, Override};
use super::shape::SCENE;
use super::{Scene, check, rules};

/// The largest scene file that is read, in bytes. A camera key takes about 100, so this holds more frames than a film's
/// shot has; a hostile file of this size costs the TOML parser a second and 500 MB, and both grow with it.
pub const MOST_BYTES: u64 = 4 << 20;

/// A scene with every default filled in, and where it came from.
#[derive(Clone, Debug)]
pub struct LoadedScene {
    /// The scene.
    pub scene: Scene,
    /// The file as it was named.
    pub path: PathBuf,
    /// The file's folder: paths in the scene start here.
    pub directory: PathBuf,
    /// SHA-256, hexadecimal, of the scene's values: the same for the same values, however they were written.
    pub hash: String,
}

impl LoadedScene {
    /// A path in the scene → a path that can be opened.
    pub fn resolve(&self, path: impl AsRef<Path>) -> PathBuf {
        self.directory.join(path)
    }
}

/// Reads a scene file and lays the overrides over it, in their order.
///
/// # Errors
/// All that is wrong with the file and the overrides, each with its place.
pub fn load(path: &Path, overrides: &[Override]) -> Result<LoadedScene, SceneErrors> {
    let text = read(path)?;
    // Named by mistake, it would be a syntax error on each of its lines.
    if let Some(signature) = ["whitewater-frame", "whitewater-model"].into_iter().find(|word| text.starts_with(word)) {
        return Err(SceneError::Simulation { path: path.to_owned(), signature }.into());
    }
    let scene = parse(path, &text, overrides)?;
    let directory = match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent.to_owned(),
        _ => PathBuf::from("."),
    };
    let hash = hash(&scene);
    tracing::debug!(file = %path.display(), overrides = overrides.len(), hash, "scene read");
    Ok(LoadedScene { scene, path: path.to_owned(), directory, hash })
}

fn read(path: &Path) -> Result<String, SceneError> {
    let unreadable = |source: std::io::Error| match source.kind() {
        std::io::ErrorKind::NotFound => SceneError::NotFound { path: path.to_owned() },
        std::io::ErrorKind::IsADirectory => SceneError::Directory { path: path.to_owned() },
        _ => SceneError::Unreadable { path: path.to_owned(), source },
    };
    let too_large = || SceneError::TooLarge { path: path.to_owned(), limit: MOST_BYTES };
    let file = File::open(path).map_err(unreadable)?;
    let metadata = file.metadata().map_err(unreadable)?;
    if metadata.is_dir() {
        return Err(SceneError::Directory { path: path.to_owned() });
    }
    if metadata.len() > MOST_BYTES {
        return Err(too_large());
    }
    let mut bytes = Vec::new();
    // A device or a pipe has no length: never read more than one byte too many.
    file.take(MOST_BYTES + 1).read_to_end(&mut bytes).map_err(unreadable)?;
    if bytes.len() as u64 > MOST_BYTES {
        return Err(too_large());
    }
    String::from_utf8(bytes).map_err(|error| {
        let offset = error.utf8_error().valid_up_to();
        let (line, column) = document::locate_byte(error.as_bytes(), offset);
        SceneError::NotText { place: Place::File { file: path.into(), line, column }, byte: error.as_bytes()[offset] }
    })
}

/// Text → scene.
fn parse(path: &Path, text: &str, changes: &[Override]) -> Result<Scene, SceneErrors> {
    let (mut root, syntax) = document::parse(path, text);
    let (_, mut errors) = check::check(&root, &SCENE);
    for change in changes {
        if let Err(error) = overrides::apply(&mut root, change) {
            errors.push(error);
        }
    }
    // The file was checked by itself first, so that an override does not hide what is wrong in it.
    let (mut value, more) = check::check(&root, &SCENE);
    errors.extend(more);
    rules::apply_presets(&mut value);
    let scene: Scene = serde_json::from_value(value).expect("what the checker lets through, the types take");
    errors.extend(rules::check(&scene, &root, &errors));
    if !syntax.is_empty() {
        // Around a syntax error the parser guesses: what seems wrong on its line, or seems not to be there, may be fine.
        let lines: HashSet<u32> = syntax.iter().filter_map(line).collect();
        errors.retain(|error| {
            !matches!(error, SceneError::Missing { .. }) && line(error).is_none_or(|line| !lines.contains(&line))
        });
        errors.extend(syntax);
    }
    let mut seen = HashSet::new();
    errors.retain(|error| seen.insert(error.to_string()));
    let typed = |error: &SceneError| match error.place() {
        Some(Place::Argument(option)) => changes.iter().position(|change| change.option() == &**option),
        _ => None,
    };
    errors.sort_by_key(typed);
    if errors.is_empty() { Ok(scene) } else { Err(SceneErrors::new(errors)) }
}

fn line(error: &SceneError) -> Option<u32> {
    match error.place() {
        Some(Place::File { line, .. }) => Some(*line),
        _ => None,
    }
}

/// SHA-256 of the values. The preset's name is left out: its values are all there.
fn hash(scene: &Scene) -> String {
    let mut scene = scene.clone();
    scene.water.preset = None;
    let text = serde_json::to_vec(&scene).expect("a scene is plain data with string keys");
    Sha256::digest(text).iter().fold(String::new(), |mut hash, byte| {
        let _ = write!(hash, "{byte:02x}");
        hash
    })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use serde_json::{Value, json};

    use super::*;
    use crate::scene::{Fresnel, Highlight, PhaseKind, WaterPreset};

    const COMPLETE: &str = "[frames]\nfiles = \"time###.state\"\n";

    fn read_text(text: &str, set: &[&str]) -> Result<Scene, SceneErrors> {
        let changes: Vec<Override> = set.iter().map(|set| set.parse().expect("KEY=VALUE")).collect();
        parse(Path::new("scene.toml"), text, &changes)
    }

    fn messages(text: &str, set: &[&str]) -> Vec<String> {
        let errors = read_text(text, set).expect_err("a scene with errors");
        errors.iter().map(ToString::to_string).collect()
    }

    fn good(text: &str, set: &[&str]) -> Scene {
        read_text(&format!("{COMPLETE}{text}"), set).unwrap_or_else(|errors| panic!("{text} {set:?}:\n{errors}"))
    }

    /// The table of docs/formats.md, section 2, key by key; null stands for "found out later" (from the frames or the pixel).
    #[test]
    fn every_fixed_key_has_its_fixed_default() {
        let defaults = json!({
            "frames.files": "time###.state", "frames.fps": 24.0,
            "environment.model": null, "environment.meshes": [],
            "surface.order": 3, "surface.representation": "spline",
            "surface.solver": "univariate", "surface.tolerance": null,
            "surface.dry_threshold": 0.001, "surface.dry_depth": null,
            "water.ior": 1.333, "water.absorption": [0.34, 0.05, 0.009], "water.fresnel": "exact",
            "water.scattering": [0.0, 0.0, 0.0], "water.phase": "henyey-greenstein", "water.asymmetry": 0.92,
            "particles.representation": "auto", "particles.scale": 1.0,
            "camera.eye": null, "camera.look_at": null, "camera.up": [0.0, 1.0, 0.0], "camera.fov": 40.0, "camera.key": [],
            "sky.kind": "analytic", "sky.visible": true,
            "sun.elevation": 35.0, "sun.azimuth": 130.0, "sun.irradiance": 2.2,
            "render.width": 1280, "render.height": 720, "render.samples": 16, "render.integrator": "whitted",
            "render.seed": 0, "render.depth": 8,
            "accel.water": "embree", "accel.objects": "embree", "accel.bsp_depth": null, "accel.bsp_leaf": null,
        });
        let scene = serde_json::to_value(good("", &[])).expect("JSON");
        for (key, value) in defaults.as_object().expect("an object") {
            assert_eq!(scene.pointer(&format!("/{}", key.replace('.', "/"))), Some(value), "{key}");
        }
    }

    #[test]
    fn displaced_points_go_only_where_they_are_drawn() {
        let table = format!("{COMPLETE}[surface]\ndisplacement = {{ adhesion = 0.1, shear = 0.05 }}\n");
        for solver in ["newton", "bezier-clip", "reference"] {
            let scene = read_text(&table, &[&format!("surface.solver={solver}")]).expect("a sound scene");
            assert_eq!((scene.surface.displacement.adhesion, scene.surface.displacement.shear), (0.1, 0.05));
        }
        // The default solver is refused too, with the reason.
        let told = messages(&table, &[]);
        assert!(told.len() == 1 && told[0].contains("`surface.solver` = (by default)"), "{told:?}");
        assert!(told[0].contains("\"bezier-clip\"") && told[0].contains("surface.displacement"), "{told:?}");
        let told = messages(&table, &["surface.solver=report", "surface.representation=quads"]);
        assert!(told.len() == 2 && told[0].contains("= report:") && told[1].contains("representation"), "{told:?}");
        // No displacement, no rule; and none beyond what cannot fold.
        good("[surface]\nsolver = 'report'\ndisplacement = { adhesion = 0.0 }\n", &[]);
        assert!(messages(COMPLETE, &["surface.displacement.adhesion=0.25"])[0].contains("from 0 to 0.24"));
        assert!(messages(COMPLETE, &["surface.displacement.shaer=0.1"])[0].contains("surface.displacement.shear"));
    }

    #[test]
    fn a_potential_of_foam_grows_from_its_first_limit_to_its_second() {
        let scene = good("[foam]\nwindow = 12\nlimits = { crest = [0.5, 2.0] }\nrate = { vorticity = 0.0 }\n", &[]);
        assert_eq!((scene.foam.window, scene.foam.limits.crest, scene.foam.rate.vorticity), (12, [0.5, 2.0], 0.0));
        assert_eq!(
            scene.foam.limits.depth,
            crate::scene::FoamLimits::default().depth,
            "keys beside it keep their defaults"
        );
        for limits in ["[2.0, 2.0]", "[3.0, 2.0]"] {
            let told = messages(COMPLETE, &[&format!("foam.limits.energy={limits}")]);
            assert!(
                told.len() == 1 && told[0].contains("foam.limits.energy") && told[0].contains("second above"),
                "{told:?}"
            );
        }
        assert!(messages(COMPLETE, &["foam.lifetime=0"])[0].contains("foam.lifetime"));
    }

    #[test]
    fn each_class_of_spray_may_have_sizes_of_its_own() {
        let scene =
            good("[particles]\nsize_spread = 0.2\n[particles.size_spreads]\nstreaks = 0.4\n", &["particles.merging=0"]);
        assert_eq!((scene.particles.size_spreads.streaks, scene.particles.size_spreads.mist), (Some(0.4), None));
        assert!(
            messages(COMPLETE, &["particles.size_spreads.streak=0.1"])[0].contains("particles.size_spreads.streaks")
        );
        assert!(messages(COMPLETE, &["particles.size_spreads.mist=3"])[0].contains("particles.size_spreads.mist"));
        assert!(messages(COMPLETE, &["particles.merging=-1"])[0].contains("particles.merging"));
    }

    #[test]
    fn every_fixed_name_is_taken() {
        for (key, names) in [
            ("surface.representation", &["quads", "tessellated", "spline"][..]),
            ("surface.solver", &["univariate", "newton", "report", "bezier-clip", "reference"]),
            ("water.fresnel", &["exact", "schlick"]),
            ("water.phase", &["henyey-greenstein", "two-lobe", "pure"]),
            ("sky.kind", &["analytic", "preetham", "constant"]),
            ("particles.representation", &["spheres", "billboards", "streamlines", "none"]),
            ("accel.water", &["embree", "columns", "brute"]),
            ("accel.objects", &["embree", "bsp", "bsp-sah", "bsp-report", "brute"]),
        ] {
            for name in names {
                let scene = serde_json::to_value(good("", &[&format!("{key}={name}")])).expect("JSON");
                assert_eq!(scene.pointer(&format!("/{}", key.replace('.', "/"))), Some(&Value::from(*name)));
            }
        }
        for order in 2..=4 {
            assert_eq!(good(&format!("[surface]\norder = {order}"), &[]).surface.order, order);
        }
    }

    #[test]
    fn the_reports_walk_takes_no_solver_but_its_own() {
        assert_eq!(good("", &["accel.water=columns"]).surface.solver, crate::scene::SolverKind::Univariate);
        let text = format!("{COMPLETE}[surface]\nsolver = \"newton\"\n[accel]\nwater = \"columns\"\n");
        let messages = messages(&text, &[]);
        assert_eq!(messages.len(), 1, "{messages:?}");
        let expected = "`accel.water` = \"columns\": expected another accelerator for surface.solver = \"newton\"";
        assert!(messages[0].contains(expected), "{messages:?}");
    }

    #[test]
    fn all_errors_of_a_file_are_reported_with_line_and_column() {
        let text = "\
[frames]
files = \"time###.state\"
fps = \"fast\"

[surface]
  order = 7
solver = 'newtn'
[watr]
ior = 1.3
[camera]
up = [0, 1]
[[camera.key]]
frame = 1
eye = [0, nan, 0]
look_at = [0, 0, 0]
[[camera.key]]
frame = 2
eye = [0, 0, 0]
";
        let messages = messages(text, &[]);
        assert_eq!(
            messages,
            [
                "scene.toml:3:7: `frames.fps` = \"fast\": expected a finite number from 0.001 to 100000",
                "scene.toml:6:11: `surface.order` = 7 is out of range: expected an integer from 2 to 4",
                "scene.toml:7:10: `surface.solver` = 'newtn': expected one of `univariate`, `newton`, `report`, `bezier-clip`, `reference`; the nearest is `newton`",
                "scene.toml:8:2: unknown key `watr`; the nearest known key is `water`",
                "scene.toml:11:6: `camera.up` = [0, 1]: expected an array of 3: each a finite number from -1e12 to 1e12, not 2",
                "scene.toml:14:11: `camera.key.0.eye.1` = nan is out of range: expected a finite number from -1e12 to 1e12",
                "scene.toml:16:1: `camera.key.1.look_at` is missing: expected an array of 3: each a finite number from -1e12 to 1e12",
            ]
        );
    }

    #[test]
    fn syntax_errors_are_reported_together_and_beside_wrong_values() {
        let messages = messages("[frames]\nfiles = time\nfps = 1\nfps = 2\n[render]\nwidth = 0\n", &[]);
        assert_eq!(messages.len(), 3, "{messages:#?}");
        assert!(messages[0].starts_with("scene.toml:2:9: not TOML: string values must be quoted"), "{}", messages[0]);
        assert_eq!(messages[1], "scene.toml:4:1: the key `fps` is given twice");
        assert!(messages[2].starts_with("scene.toml:6:9: `render.width` = 0 is out of range"), "{}", messages[2]);
    }

    #[test]
    fn tables_may_be_written_in_every_way_that_toml_has() {
        let scene = good("[camera]\nfov = 40\n[[camera.key]]\nframe = 1\neye = [1,2,3]\nlook_at = [0.0,0,0]\n", &[]);
        assert_eq!((scene.camera.key[0].eye, scene.camera.fov), ([1.0, 2.0, 3.0], 40.0));
        let text = "frames.files = 'a#'\nrender = { width = 5, height = 6 }\nlight = [{ position = [1,1,1], intensity = [1,1,1] }]\n";
        let scene = read_text(text, &[]).expect("a scene");
        assert_eq!((scene.render.width, scene.light.len()), (5, 1));
    }

    #[test]
    fn an_override_is_toml_or_else_a_bare_string() {
        let scene = good(
            "[sky]\nimage = 'a.hdr'\n[[camera.key]]\nframe = 1\neye = [1,2,3]\nlook_at = [0,0,0]\n",
            &[
                "surface.representation=quads",
                "water.absorption=[0,0,0]",
                "render.width=500",
                "sky.image=2",
                "output.comments = 2003-11-05",
                "output.owner='x y'",
                "camera.key.0.frame=7",
                "camera.key.1={frame=9, eye=[1,1,1], look_at=[0,0,0]}",
                "sun={elevation=10}",
                "sun.azimuth=-0.0",
            ],
        );
        assert_eq!(scene.surface.representation, crate::scene::Representation::Quads);
        assert_eq!(scene.water.absorption, [0.0; 3]);
        assert_eq!(scene.render.width, 500);
        assert_eq!(scene.sky.image.as_deref(), Some("2"));
        assert_eq!(scene.output.comments.as_deref(), Some("2003-11-05"));
        assert_eq!(scene.output.owner.as_deref(), Some("x y"));
        assert_eq!((scene.camera.key[0].frame, scene.camera.key[1].frame), (7.0, 9.0));
        assert_eq!((scene.sun.elevation, scene.sun.irradiance), (10.0, 2.2));
    }

    #[test]
    fn errors_of_overrides_name_the_option() {
        let messages = messages(
            COMPLETE,
            &[
                "render.widht=5",
                "render.width=wide",
                "camera.key.3.frame=1",
                "water.absorption=[1,2]",
                "surface.solver.x=1",
            ],
        );
        let starts = [
            "--set render.widht: unknown key `render.widht`; the nearest known key is `render.width`",
            "--set render.width: `render.width` = wide: expected an integer from 1 to 65536",
            "--set camera.key.3.frame: `camera.key.3.frame` = 1 is out of range: expected an index of at most 0",
            "--set water.absorption: `water.absorption` = [1,2]: expected an array of 3",
            "--set surface.solver.x: unknown key `surface.solver.x`; the nearest known key is `surface.solver`",
        ];
        assert_eq!(messages.len(), starts.len(), "{messages:#?}");
        for (message, start) in messages.iter().zip(starts) {
            assert!(message.starts_with(start), "{message}\ndoes not start with {start}");
        }
        assert!("render.width".parse::<Override>().is_err());
        assert!("=5".parse::<Override>().is_err());
    }

    #[test]
    fn an_override_does_not_hide_what_is_wrong_in_the_file() {
        let messages = messages(&format!("{COMPLETE}[render]\nwidth = 'x'\n"), &["render.width=5"]);
        assert_eq!(messages.len(), 1);
        assert!(messages[0].starts_with("scene.toml:4:9:"), "{messages:?}");
    }

    #[test]
    fn an_override_can_take_a_value_away() {
        let text = format!("{COMPLETE}[surface]\ntolerance = 0.5\n");
        let scene =
            parse(Path::new("x"), &text, &[Override::unset("--accuracy", "surface.tolerance")]).expect("a scene");
        assert_eq!(scene.surface.tolerance, None);
    }

    #[test]
    fn keys_must_agree_with_each_other() {
        let key =
            |frame: f64, eye: &str| format!("[[camera.key]]\nframe = {frame}\neye = {eye}\nlook_at = [0, 0, 0]\n");
        for (text, expected) in [
            ("[sky]\nkind = 'latlong'\n".to_owned(), vec!["scene.toml:3:1: `sky.image` is missing"]),
            (
                "[sky]\nkind = 'skybox'\n".to_owned(),
                vec!["scene.toml:3:1: `sky.above` is missing", "scene.toml:3:1: `sky.below` is missing"],
            ),
            (
                "[sky]\nkind = 'skybox'\nabove = 3\nbelow = 'b'".to_owned(),
                vec!["scene.toml:5:9: `sky.above` = 3: expected a string"],
            ),
            (
                "[sun]\ncolor = [0, 0.0, -0.0]".to_owned(),
                vec!["scene.toml:4:9: `sun.color` = [0, 0.0, -0.0]: expected a colour"],
            ),
            ("[camera]\nup = [0,0,0]".to_owned(), vec!["scene.toml:4:6: `camera.up` = [0,0,0]: expected a direction"]),
            (
                "[camera]\neye = [1,2,3]\nlook_at = [1,2,3]".to_owned(),
                vec!["scene.toml:5:11: `camera.look_at` = [1,2,3]: expected another point than camera.eye"],
            ),
            (
                "[camera]\neye = [1,2,3]\nlook_at = [1,-2,3]".to_owned(),
                vec!["scene.toml:5:11: `camera.look_at` = [1,-2,3]: expected a direction of view that is not parallel"],
            ),
            (
                key(1.0, "[1,1,1]") + &key(2.0, "[0,0,0]") + &key(1.0, "[1,2,1]"),
                vec![
                    "scene.toml:10:11: `camera.key.1.look_at` = [0, 0, 0]: expected another point",
                    "scene.toml:12:9: `camera.key.2.frame` = 1: expected a frame that no other key has; the key at scene.toml:4:9",
                ],
            ),
            (
                "[environment]\nmeshes = ['a.obj', '']".to_owned(),
                vec!["scene.toml:4:20: `environment.meshes.1` = '': expected the name"],
            ),
        ] {
            let messages = messages(&format!("{COMPLETE}{text}"), &[]);
            assert_eq!(messages.len(), expected.len(), "{messages:#?}");
            for (message, expected) in messages.iter().zip(expected) {
                assert!(message.starts_with(expected), "{message}\ndoes not start with {expected}");
            }
        }
        assert_eq!(
            messages("", &[]),
            [
                "scene.toml:1:1: `frames.files` is missing: expected the pattern of the frames' names, as in files = \"time###.state\" under [frames]"
            ]
        );
        assert!(
            messages("[frames]\nfiles=''", &["render.width=0"]).len() == 2,
            "rules and values are reported together"
        );
    }

    #[test]
    fn numbers_must_be_finite_and_in_range() {
        for (key, value) in [
            ("camera.fov", "nan"),
            ("camera.fov", "inf"),
            ("sun.azimuth", "-inf"),
            ("sun.azimuth", "1e400"),
            ("render.width", "99999999999999999999999"),
            ("render.width", "9999999999999999999999999999999999999999"),
            ("render.width", "-1"),
            ("render.seed", "4294967296"),
            ("camera.fov", "1e39"),
        ] {
            let messages = messages(COMPLETE, &[&format!("{key}={value}")]);
            assert!(messages.len() == 1 && messages[0].contains(&format!("`{key}` = {value}")), "{messages:?}");
        }
        assert!(messages(COMPLETE, &["render.width=500.0"])[0].contains("expected an integer"));
        assert_eq!(good("", &["render.seed=0xFFFF_FFFF"]).render.seed, u32::MAX);
    }

    #[test]
    fn the_reports_preset_gives_way_to_keys_that_are_given() {
        let water = good("[water]\npreset = 'report'\n", &[]).water;
        assert_eq!((water.diffuse, water.specular), ([0.1, 0.1, 0.3], [0.7, 0.7, 0.8]));
        assert_eq!((water.highlight, water.phong_exponent), (Highlight::Phong, 1000.0));
        assert_eq!((water.absorption, water.fresnel, water.r0), ([0.34, 0.05, 0.009], Fresnel::Schlick, Some(0.02)));
        assert_eq!((water.preset, water.ior), (Some(WaterPreset::Report), 1.333));
        let text = "[water]\npreset = 'report'\nfresnel = 'exact'\ndiffuse = [0, 0, 0]\n";
        let water = good(text, &["water.r0=0.5", "water.highlight=none"]).water;
        assert_eq!((water.fresnel, water.r0, water.highlight), (Fresnel::Exact, Some(0.5), Highlight::None));
        assert_eq!((water.diffuse, water.specular), ([0.0; 3], [0.7, 0.7, 0.8]));
    }

    #[test]
    fn named_waters_fill_in_what_is_not_given() {
        let names = "pure jerlov-i jerlov-ia jerlov-ib jerlov-ii jerlov-iii jerlov-1c jerlov-3c jerlov-5c jerlov-7c \
                     jerlov-9c premoze-i premoze-ii premoze-iii premoze-1 premoze-3 premoze-5 premoze-7 premoze-9 river harbour";
        for name in names.split_whitespace() {
            let water = good("", &[&format!("water.preset={name}")]).water;
            let values = water.preset.and_then(WaterPreset::coefficients).expect("coefficients");
            assert_eq!((water.absorption, water.scattering), (values.absorption, values.scattering), "{name}");
            assert_eq!((water.phase == PhaseKind::Pure, water.ior), (name == "pure", 1.333), "{name}");
            let given = ["water.scattering=[1, 2, 3]", "water.phase=two-lobe"];
            let water = good("", &[&format!("water.preset={name}"), given[0], given[1]]).water;
            assert_eq!((water.absorption, water.scattering), (values.absorption, [1.0, 2.0, 3.0]), "{name}");
            assert_eq!(water.phase, PhaseKind::TwoLobe);
        }
        assert_eq!(names.split_whitespace().count() + 1, crate::scene::names_of("water.preset").len());
        assert!(messages(COMPLETE, &["water.preset=jerlov-4"])[0].contains("the nearest is `jerlov-"));
    }

    #[test]
    fn the_hash_is_of_the_values_not_of_the_text() {
        let one = hash(&good("[render]\nwidth = 500\n", &[]));
        assert_eq!(
            one,
            hash(&good(
                "render.width = 0x1F4 # pixels\n".replace("render", "[render]\nheight = 720\n#").as_str(),
                &["render.width=500"]
            ))
        );
        assert_eq!(one, hash(&good("[sun]\nelevation = 35\n", &["render.width=500", "particles.scale=1"])));
        assert_ne!(one, hash(&good("", &[])));
        assert_ne!(one, hash(&good("", &["render.width=501"])));
        assert_eq!(one.len(), 64);
        let report = "diffuse=[0.1,0.1,0.3]\nspecular=[0.7,0.7,0.8]\nhighlight='phong'\nfresnel='schlick'\nr0=0.02\n";
        assert_eq!(hash(&good("[water]\npreset='report'\n", &[])), hash(&good(&format!("[water]\n{report}"), &[])));
    }

    #[test]
    fn files_that_are_no_scene_are_named_with_the_reason() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("scene.toml");
        let error = |path: &Path| {
            load(path, &[]).expect_err("no scene").iter().next().map(ToString::to_string).unwrap_or_default()
        };
        assert!(error(&path).ends_with("scene.toml: there is no such scene file"));
        assert!(error(folder.path()).ends_with("this is a folder; expected a scene file (TOML)"));
        std::fs::write(&path, b"[frames]\n\xc3\xa9\xff").expect("written");
        assert!(error(&path).contains("scene.toml:2:2: byte 0xff is not UTF-8"), "{}", error(&path));
        std::fs::write(&path, "whitewater-frame 1\ntime 0\n").expect("written");
        assert!(error(&path).contains("this is a simulation file (whitewater-frame)"), "{}", error(&path));
        File::create(&path).and_then(|file| file.set_len(MOST_BYTES + 1)).expect("a sparse file");
        assert!(error(&path).contains("larger than 4194304 bytes"), "{}", error(&path));
    }

    #[test]
    fn a_file_of_nothing_but_errors_reports_a_hundred() {
        let unknown = |count: usize| (0..count).map(|index| format!("a{index} = 1\n")).collect::<String>();
        // The hundredth is met within a table that has required keys.
        let within = unknown(99) + "[[camera.key]]\na = 1\nb = 1\nframe = 1\neye = [1,1,1]\nlook_at = [0,0,0]\n";
        for text in ["a\n".repeat(5000), unknown(5000), within] {
            let errors = read_text(&text, &[]).expect_err("errors");
            assert_eq!(errors.iter().count(), 100);
        }
    }

    #[test]
    fn paths_start_at_the_scene_file() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("scene.toml");
        std::fs::write(&path, COMPLETE).expect("written");
        let loaded = load(&path, &["render.width=9".parse().expect("an override")]).expect("a scene");
        assert_eq!(loaded.resolve("a/b.obj"), folder.path().join("a/b.obj"));
        assert_eq!(loaded.resolve("/b.obj"), Path::new("/b.obj"));
        assert_eq!((loaded.scene.render.width, loaded.hash), (9, hash(&loaded.scene)));
    }

    /// Text in which TOML's own signs and our keys are common.
    fn almost_toml() -> impl Strategy<Value = String> {
        let words = prop::sample::select(vec![
            "[",
            "]",
            "[[",
            "]]",
            "{",
            "}",
            "=",
            ".",
            ",",
            "\n",
            "\n",
            " ",
            "\"",
            "'",
            "\"\"\"",
            "#",
            "\\",
            "nan",
            "inf",
            "-",
            "1",
            "1e9",
            "0x",
            "_",
            "true",
            "1979-05-27",
            "frames",
            "files",
            "camera",
            "key",
            "frame",
            "eye",
            "look_at",
            "up",
            "water",
            "preset",
            "report",
            "sky",
            "kind",
            "latlong",
            "light",
            "position",
            "render",
            "width",
            "\u{feff}",
            "é",
            "\0",
            "\r",
        ]);
        prop::collection::vec(words, 0..60).prop_map(|words| words.concat())
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(400))]

        #[test]
        fn no_text_makes_the_reader_panic(text in almost_toml(), noise in any::<String>(), set in almost_toml()) {
            for text in [&text, &noise, &format!("{COMPLETE}{text}")] {
                let changes: Vec<Override> = set.parse().into_iter().chain(["camera.key.0.frame=1".parse().expect("one")]).collect();
                if let Err(errors) = parse(Path::new("scene.toml"), text, &changes) {
                    prop_assert!(errors.iter().count() > 0 && !errors.to_string().is_empty());
                }
            }
        }

        /// Right keys with random values: either a scene, whose numbers are all finite, or errors.
        #[test]
        fn no_value_of_a_known_key_makes_the_reader_panic(
            key in prop::sample::select(SCENE.keys()),
            value in prop_oneof![
                any::<f64>().prop_map(|number| format!("{number:?}")),
                any::<i64>().prop_map(|number| number.to_string()),
                any::<[f64; 3]>().prop_map(|numbers| format!("{numbers:?}")),
                Just("{}".to_owned()), Just("[]".to_owned()), Just("[{}]".to_owned()), "[a-z]{0,8}",
            ],
        ) {
            let _ = read_text(COMPLETE, &[&format!("{key}={value}")]);
            let _ = read_text(&format!("{COMPLETE}\n[x]\n{key} = {value}\n"), &[]);
            let _ = read_text(&format!("{key} = {value}\n"), &["frames.files=a#"]);
        }
    }
}
