//! What must hold between keys, each of which is right by itself; and the named sets of values.

mod simulation;

use std::collections::HashMap;

use serde::Deserialize;
use serde_json::{Value, json};

use super::document::Node;
use super::errors::SceneError;
use super::{
    Caustics, Coefficients, Compression, EXPECTED_BYTES, Overscan, PhaseKind, Representation, Scene, SkyKind,
    SolverKind, WaterAccel, WaterPreset, bytes,
};

/// Schlick's reflectance of water at normal incidence in the report's preset: ((1.333 - 1) / (1.333 + 1))^2, rounded.
const REPORT_R0: f64 = 0.02;

/// Fills in the keys of `water.preset` that were not given.
pub(super) fn apply_presets(scene: &mut Value) {
    let Some(water) = scene.get_mut("water").and_then(Value::as_object_mut) else { return };
    let Some(preset) = water.get("preset").and_then(|name| WaterPreset::deserialize(name).ok()) else { return };
    let values = match preset.coefficients() {
        Some(Coefficients { absorption, scattering }) => {
            let phase = if preset == WaterPreset::Pure { PhaseKind::Pure } else { PhaseKind::default() };
            json!({ "absorption": absorption, "scattering": scattering, "phase": phase })
        }
        // The report's table 4.1.
        None => json!({
            "diffuse": [0.1, 0.1, 0.3],
            "specular": [0.7, 0.7, 0.8],
            "highlight": "phong",
            "phong_exponent": 1000.0,
            "absorption": [0.34, 0.05, 0.009],
            "fresnel": "schlick",
            "r0": REPORT_R0,
        }),
    };
    for (key, value) in values.as_object().into_iter().flatten() {
        water.entry(key).or_insert_with(|| value.clone());
    }
}

/// Checks the rules between keys. A rule is silent where one of its keys is wrong already.
pub(super) fn check(scene: &Scene, root: &Node, known: &[SceneError]) -> Vec<SceneError> {
    let wrong = known.iter().filter_map(|error| error.key()).map(str::to_owned).collect();
    let mut rules = Rules { root, wrong, errors: Vec::new() };
    rules.frames(scene);
    rules.displacement(scene);
    rules.paths(scene);
    rules.camera(scene);
    rules.sky(scene);
    rules.sun(scene);
    rules.lights(scene);
    rules.caustics(scene);
    rules.accelerators(scene);
    rules.foam(scene);
    rules.overscan(scene);
    rules.textures(scene);
    rules.stereo(scene);
    if let Some(simulation) = &scene.simulation {
        rules.simulation(simulation);
    }
    rules.errors
}

struct Rules<'a> {
    root: &'a Node,
    wrong: Vec<String>,
    errors: Vec<SceneError>,
}

impl Rules<'_> {
    /// True if nothing that a rule reads has been reported.
    fn sound(&self, keys: &[&str]) -> bool {
        let under = |long: &str, short: &str| {
            long.strip_prefix(short).is_some_and(|rest| rest.is_empty() || rest.starts_with('.'))
        };
        !self.wrong.iter().any(|wrong| keys.iter().any(|key| under(wrong, key) || under(key, wrong)))
    }

    fn missing(&mut self, key: &str, expected: impl Into<String>) {
        let place = self.root.place_of(key).clone();
        self.errors.push(SceneError::Missing { place, key: key.to_owned(), expected: expected.into() });
    }

    fn inconsistent(&mut self, key: &str, expected: impl Into<String>) {
        let node = self.root.find(key);
        let value = node.map_or("(by default)", |node| node.shown.as_str()).to_owned();
        let place = self.root.place_of(key).clone();
        self.errors.push(SceneError::Inconsistent { place, key: key.to_owned(), value, expected: expected.into() });
    }

    fn frames(&mut self, scene: &Scene) {
        if scene.frames.files.is_empty() && self.sound(&["frames.files"]) {
            self.missing(
                "frames.files",
                "the pattern of the frames' names, as in files = \"time###.state\" under [frames]",
            );
        }
    }

    /// Who draws points that are moved sideways.
    fn displacement(&mut self, scene: &Scene) {
        let surface = &scene.surface;
        if surface.displacement.is_none() || !self.sound(&["surface.displacement"]) {
            return;
        }
        let why = "since surface.displacement moves control points sideways";
        if !surface.solver.takes_displaced() && self.sound(&["surface.solver"]) {
            let expected = format!(
                "\"newton\", \"bezier-clip\" or \"reference\", {why}: the water is no polynomial along a ray any more, \
                 which univariate solves, and leaves the columns that report solves"
            );
            self.inconsistent("surface.solver", expected);
        }
        if !scene.accel.water.takes_displaced() && self.sound(&["accel.water"]) {
            let expected =
                format!("\"embree\", \"stream\" or \"brute\", {why}: patches leave the columns that it walks");
            self.inconsistent("accel.water", expected);
        }
        if surface.representation != Representation::Spline && self.sound(&["surface.representation"]) {
            let expected = format!("\"spline\", {why}: the others leave them where they are");
            self.inconsistent("surface.representation", expected);
        }
    }

    /// Two eyes share one part of a file, which then has one compression.
    fn stereo(&mut self, scene: &Scene) {
        let both = self.sound(&["camera.stereo", "output.compression"]);
        if both && scene.camera.stereo.is_some() && scene.output.compression == Compression::Dwaa {
            let expected = "\"zip\", \"zips\", \"piz\" or \"none\", since camera.stereo puts both eyes into one part";
            self.inconsistent("output.compression", expected);
        }
        let both = self.sound(&["camera.stereo", "output.deep"]);
        if both && scene.camera.stereo.is_some() && scene.output.deep.enabled {
            self.inconsistent(
                "output.deep.enabled",
                "false, since camera.stereo renders for two eyes and a deep file holds one",
            );
        }
    }

    fn overscan(&mut self, scene: &Scene) {
        let Some(text) = &scene.output.overscan else { return };
        if Overscan::parse(text).is_none() {
            self.inconsistent("output.overscan", Overscan::EXPECTED);
        }
    }

    fn textures(&mut self, scene: &Scene) {
        if bytes(&scene.render.texture_memory).is_none() {
            self.inconsistent("render.texture_memory", EXPECTED_BYTES);
        }
        if scene.terrain.texture_extent.is_some_and(|[x0, z0, x1, z1]| x0 >= x1 || z0 >= z1) {
            let expected = "x and z of the north-western corner and, greater than those, of the south-eastern corner";
            self.inconsistent("terrain.texture_extent", expected);
        }
        if scene.terrain.texture.is_none() && scene.terrain.texture_extent.is_some() {
            self.missing("terrain.texture", "an image, since terrain.texture_extent says where it lies");
        }
    }

    /// A potential grows from its first limit to its second.
    fn foam(&mut self, scene: &Scene) {
        let limits = &scene.foam.limits;
        for (name, [least, most]) in [
            ("convergence", limits.convergence),
            ("vorticity", limits.vorticity),
            ("pressure", limits.pressure),
            ("crest", limits.crest),
            ("energy", limits.energy),
            ("depth", limits.depth),
        ] {
            let key = format!("foam.limits.{name}");
            if least >= most && self.sound(&[&key]) {
                self.inconsistent(&key, "two limits, the second above the first");
            }
        }
    }

    /// A path that is given is not empty.
    fn paths(&mut self, scene: &Scene) {
        let sky = &scene.sky;
        let single = [
            ("environment.model", &scene.environment.model),
            ("mist.file", &scene.mist.file),
            ("terrain.texture", &scene.terrain.texture),
            ("sky.image", &sky.image),
            ("sky.above", &sky.above),
            ("sky.below", &sky.below),
        ];
        let single = single.into_iter().filter_map(|(key, path)| Some((key.to_owned(), path.as_deref()?)));
        let single =
            single.chain([("particles.billboard.texture".to_owned(), scene.particles.billboard.texture.as_str())]);
        let meshes = scene.environment.meshes.iter().enumerate();
        let meshes = meshes.map(|(index, path)| (format!("environment.meshes.{index}"), path.as_str()));
        for (key, _) in single.chain(meshes).filter(|(_, path)| path.is_empty()) {
            self.inconsistent(&key, "the name of a file");
        }
    }

    fn camera(&mut self, scene: &Scene) {
        let camera = &scene.camera;
        let up_is_zero = camera.up == [0.0; 3];
        if up_is_zero {
            self.inconsistent("camera.up", "a direction, not all zero");
        }
        let known_up = (!up_is_zero && self.sound(&["camera.up"])).then_some(camera.up);
        if let (Some(eye), Some(look_at)) = (camera.eye, camera.look_at) {
            self.view("camera", eye, look_at, known_up);
        }
        let mut by_frame = HashMap::new();
        for (index, key) in camera.key.iter().enumerate() {
            let path = format!("camera.key.{index}");
            self.view(&path, key.eye, key.look_at, known_up);
            // Equal bits are equal frames: the checker leaves no NaN and one zero.
            let earlier = *by_frame.entry(key.frame.to_bits()).or_insert(index);
            if earlier < index {
                let place = self.root.place_of(&format!("camera.key.{earlier}.frame")).clone();
                let expected = format!("a frame that no other key has; the key at {place} has it");
                self.inconsistent(&format!("{path}.frame"), expected);
            }
        }
    }

    fn view(&mut self, path: &str, eye: [f64; 3], look_at: [f64; 3], up: Option<[f64; 3]>) {
        let (eye_key, look_at_key) = (format!("{path}.eye"), format!("{path}.look_at"));
        let [eye, look_at] = [eye, look_at].map(glam::DVec3::from);
        if eye == look_at {
            self.inconsistent(&look_at_key, format!("another point than {eye_key}, to have a direction of view"));
            return;
        }
        let Some(up) = up.map(glam::DVec3::from) else { return };
        let (view, up) = ((look_at - eye).normalize(), up.normalize());
        // Nearer to parallel than single precision can tell, the picture's horizon would be noise.
        if view.cross(up).length() < f64::from(f32::EPSILON) {
            self.inconsistent(&look_at_key, "a direction of view that is not parallel to camera.up");
        }
    }

    fn sky(&mut self, scene: &Scene) {
        let sky = &scene.sky;
        let needs: &[(&str, &Option<String>, &str)] = match sky.kind {
            SkyKind::Latlong => &[("sky.image", &sky.image, "an image (.hdr or .exr), since sky.kind is \"latlong\"")],
            SkyKind::Skybox => &[
                ("sky.above", &sky.above, "the texture of the sky, since sky.kind is \"skybox\""),
                ("sky.below", &sky.below, "the texture of the ground, since sky.kind is \"skybox\""),
            ],
            SkyKind::Analytic | SkyKind::Preetham | SkyKind::Constant => &[],
        };
        for (key, path, expected) in needs {
            if path.is_none() && self.sound(&[key, "sky.kind"]) {
                self.missing(key, *expected);
            }
        }
    }

    /// The report's walk has a solver of its own; a scene that names another asks for what cannot be.
    fn accelerators(&mut self, scene: &Scene) {
        let solver = scene.surface.solver;
        if scene.accel.water != WaterAccel::Columns
            || solver == SolverKind::default()
            || solver.name() == "report"
            || !self.sound(&["accel.water", "surface.solver"])
        {
            return;
        }
        let expected = format!(
            "another accelerator for surface.solver = \"{}\": columns walks with the report's own solver alone",
            solver.name()
        );
        self.inconsistent("accel.water", expected);
    }

    fn caustics(&mut self, scene: &Scene) {
        let plain = scene.surface.representation == Representation::Spline && scene.surface.displacement.is_none();
        let wanted = scene.render.caustics.is_some_and(|caustics| caustics != Caustics::Off);
        if wanted && !plain && self.sound(&["render.caustics", "surface.representation", "surface.displacement"]) {
            let expected = "off, or surface.representation = \"spline\" without surface.displacement: light is followed \
                            through the plain spline";
            self.inconsistent("render.caustics", expected);
        }
    }

    fn lights(&mut self, scene: &Scene) {
        for (index, light) in scene.light.iter().enumerate() {
            let group = &light.group;
            let plain = !group.is_empty() && group.chars().all(|c| c.is_ascii_alphanumeric() || c == '_');
            if !plain {
                let expected = "letters, digits and underscores: it becomes the layer light_<group>";
                self.inconsistent(&format!("light.{index}.group"), expected);
            }
        }
    }

    fn sun(&mut self, scene: &Scene) {
        if scene.sun.color == Some([0.0; 3]) {
            self.inconsistent("sun.color", "a colour that is not all zero (sun.irradiance = 0 puts the sun out)");
        }
    }
}
