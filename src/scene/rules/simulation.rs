//! Rules between the keys of `[simulation]`, as far as they can be told without opening a file.
//!
//! What needs the ground (regions that cover no column, levels under the ground) the simulation's room checks itself.

use crate::scene::{Landform, LandformKind, Simulation};

use super::Rules;

/// Endings of height maps whose samples may run from black to white.
const PICTURES: [&str; 4] = ["png", "exr", "tif", "tiff"];
/// Endings of height maps that never say how far their samples are apart.
const WITHOUT_SPACING: [&str; 2] = ["png", "exr"];

impl Rules<'_> {
    pub(super) fn simulation(&mut self, simulation: &Simulation) {
        for (key, path) in [
            ("simulation.model", &simulation.model),
            ("simulation.terrain.file", &simulation.terrain.file),
            ("simulation.water.depth_map", &simulation.water.depth_map),
        ] {
            if path.as_deref() == Some("") {
                self.inconsistent(key, "the name of a file");
            }
        }
        self.landform(&simulation.terrain);
        self.regions(simulation);

        let water = &simulation.water;
        let map = water.depth_map.as_deref();
        self.range("simulation.water.depths", water.depths, "simulation.water.depth_map", map);
        if water.rain_end.is_some() && water.rain == 0.0 && self.sound(&["simulation.water.rain"]) {
            self.inconsistent("simulation.water.rain_end", "simulation.water.rain above 0, whose end this is");
        }
    }

    fn landform(&mut self, terrain: &Landform) {
        let known_kind = self.sound(&["simulation.terrain.kind", "simulation.terrain.file"]);
        let file = terrain.file.as_deref();
        match (terrain.kind, file) {
            (LandformKind::File, None) if known_kind => {
                self.missing("simulation.terrain.file", "a height map, since simulation.terrain.kind is \"file\"");
            }
            (LandformKind::Plane | LandformKind::Valley, Some(_)) if known_kind => {
                self.inconsistent(
                    "simulation.terrain.file",
                    "simulation.terrain.kind = \"file\", for this file to be used",
                );
            }
            _ => {}
        }
        if terrain.crop.is_some_and(|[x0, z0, x1, z1]| x0 > x1 || z0 > z1) {
            self.inconsistent(
                "simulation.terrain.crop",
                "first column, first row, last column, last row, in this order",
            );
        }
        let map = file.filter(|_| terrain.kind == LandformKind::File);
        self.range("simulation.terrain.heights", terrain.heights, "simulation.terrain.file", map);
        let silent = map.and_then(ending).is_some_and(|ending| WITHOUT_SPACING.contains(&ending.as_str()));
        if silent && terrain.spacing.is_none() && self.sound(&["simulation.terrain.spacing"]) {
            self.missing("simulation.terrain.spacing", "metres between samples, x and z: a picture does not tell them");
        }
        if let (Some(size), Some([dx, dz])) = (terrain.detail_size, terrain.width)
            && terrain.detail > 0.0
            && size < 2.0 * dx.max(dz)
        {
            self.inconsistent("simulation.terrain.detail_size", "at least two columns: finer detail does not show");
        }
    }

    /// What black and white stand for: in order, of a picture, and there where a picture needs it.
    fn range(&mut self, key: &str, range: Option<[f64; 2]>, file_key: &str, file: Option<&str>) {
        if !self.sound(&[key, file_key]) {
            return;
        }
        let ending = file.and_then(ending);
        match (range, ending.as_deref()) {
            (None, Some("png")) => self.missing(key, "the heights (m) that black and white stand for"),
            (Some([black, white]), _) if black >= white => self.inconsistent(key, "a second number above the first"),
            (Some(_), Some(ending)) if PICTURES.contains(&ending) => {}
            (Some(_), _) => self.inconsistent(key, format!("{file_key} to be a picture (.png, .exr, .tif)")),
            (None, _) => {}
        }
    }

    fn regions(&mut self, simulation: &Simulation) {
        for (index, body) in simulation.water.body.iter().enumerate() {
            let key = format!("simulation.water.body.{index}");
            self.region(&key, body.rectangle.is_some() || body.edge.is_some(), body.circle);
            self.one_of(&key, &[("level", body.level), ("depth", body.depth)], true);
        }
        for (index, source) in simulation.source.iter().enumerate() {
            let key = format!("simulation.source.{index}");
            self.region(&key, source.rectangle.is_some() || source.edge.is_some(), source.circle);
            let kept = [("level", source.level), ("depth", source.depth), ("discharge", source.discharge)];
            self.one_of(&key, &kept, true);
            self.times(&key, source.begin, source.end);
        }
        for (index, sink) in simulation.sink.iter().enumerate() {
            let key = format!("simulation.sink.{index}");
            self.region(&key, sink.rectangle.is_some() || sink.edge.is_some(), sink.circle);
            self.one_of(&key, &[("level", sink.level), ("depth", sink.depth)], false);
        }
        for (index, pressed) in simulation.pressure.iter().enumerate() {
            let key = format!("simulation.pressure.{index}");
            self.region(&key, pressed.rectangle.is_some() || pressed.edge.is_some(), pressed.circle);
            self.times(&key, pressed.begin, pressed.end);
        }
    }

    fn region(&mut self, key: &str, other_shape: bool, circle: Option<[f64; 3]>) {
        if circle.is_some_and(|circle| circle[2] <= 0.0) {
            self.inconsistent(&format!("{key}.circle"), "x, z and a radius above 0");
        }
        if !other_shape && circle.is_none() && self.sound(&[key]) {
            self.missing(key, "a shape: rectangle, circle or edge");
        }
    }

    /// At most one of several keys, or exactly one.
    fn one_of(&mut self, key: &str, values: &[(&str, Option<f64>)], needed: bool) {
        if !self.sound(&[key]) {
            return;
        }
        let given: Vec<&str> = values.iter().filter(|(_, value)| value.is_some()).map(|(name, _)| *name).collect();
        let names: Vec<&str> = values.iter().map(|(name, _)| *name).collect();
        match given.as_slice() {
            [] if needed => self.missing(key, format!("one of {}", names.join(", "))),
            [_, second, ..] => {
                self.inconsistent(&format!("{key}.{second}"), format!("only one of {}", names.join(", ")))
            }
            _ => {}
        }
    }

    fn times(&mut self, key: &str, begin: Option<f64>, end: Option<f64>) {
        if let (Some(begin), Some(end)) = (begin, end)
            && begin >= end
        {
            self.inconsistent(&format!("{key}.end"), format!("a time after {key}.begin"));
        }
    }
}

/// A file's ending in small letters.
fn ending(file: &str) -> Option<String> {
    std::path::Path::new(file).extension()?.to_str().map(str::to_ascii_lowercase)
}

#[cfg(test)]
mod tests {
    use crate::scene::{SceneErrors, load};

    fn messages(text: &str) -> Vec<String> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("scene.toml");
        std::fs::write(&path, format!("[frames]\nfiles = 't###.state'\n{text}")).unwrap();
        let errors = load(&path, &[]).err().map(|errors: SceneErrors| errors.iter().map(ToString::to_string).collect());
        let folder = format!("{}/", folder.path().display());
        errors.into_iter().flat_map(|errors: Vec<String>| errors).map(|error| error.replace(&folder, "")).collect()
    }

    #[test]
    fn every_rule_names_its_place_and_key() {
        let text = "\
[simulation]
model = ''
[simulation.terrain]
kind = 'file'
crop = [3, 0, 2, 9]
detail = 1
detail_size = 0.3
width = [0.2, 0.1]
[simulation.water]
depth_map = 'deep.npz'
depths = [0, 1]
rain_end = 3
[[simulation.water.body]]
edge = 'west'
[[simulation.source]]
circle = [0, 0, 0]
level = 1
discharge = 2
begin = 2
end = 1
[[simulation.sink]]
level = 1
depth = 2
[[simulation.pressure]]
pascal = 5
";
        let starts = [
            "scene.toml:4:9: `simulation.model` = '': expected the name of a file",
            "scene.toml:5:1: `simulation.terrain.file` is missing: expected a height map",
            "scene.toml:7:8: `simulation.terrain.crop` = [3, 0, 2, 9]: expected first column, first row",
            "scene.toml:9:15: `simulation.terrain.detail_size` = 0.3: expected at least two columns",
            "scene.toml:13:10: `simulation.water.depths` = [0, 1]: expected simulation.water.depth_map to be a picture",
            "scene.toml:14:12: `simulation.water.rain_end` = 3: expected simulation.water.rain above 0",
            "scene.toml:15:1: `simulation.water.body.0` is missing: expected one of level, depth",
            "scene.toml:18:10: `simulation.source.0.circle` = [0, 0, 0]: expected x, z and a radius above 0",
            "scene.toml:20:13: `simulation.source.0.discharge` = 2: expected only one of level, depth, discharge",
            "scene.toml:22:7: `simulation.source.0.end` = 1: expected a time after simulation.source.0.begin",
            "scene.toml:23:1: `simulation.sink.0` is missing: expected a shape: rectangle, circle or edge",
            "scene.toml:25:9: `simulation.sink.0.depth` = 2: expected only one of level, depth",
            "scene.toml:26:1: `simulation.pressure.0` is missing: expected a shape",
        ];
        let messages = messages(text);
        assert_eq!(messages.len(), starts.len(), "{messages:#?}");
        for (message, start) in messages.iter().zip(starts) {
            assert!(message.starts_with(start), "{message}\ndoes not start with {start}");
        }
    }

    #[test]
    fn pictures_need_what_they_cannot_tell_and_others_do_not_take_it() {
        let terrain = |rest: &str| messages(&format!("[simulation.terrain]\nkind = 'file'\n{rest}"));
        let found = terrain("file = 'a.png'");
        assert!(found.len() == 2 && found.iter().any(|m| m.contains("heights` is missing")), "{found:?}");
        assert!(found.iter().any(|m| m.contains("spacing` is missing")), "{found:?}");
        assert_eq!(terrain("file = 'a.png'\nheights = [0, 9]\nspacing = [1, 1]"), [""; 0]);
        assert!(terrain("file = 'a.EXR'")[0].contains("spacing` is missing"));
        assert_eq!(terrain("file = 'a.tif'"), [""; 0]);
        assert_eq!(terrain("file = 'a.tif'\nheights = [0, 1]"), [""; 0]);
        assert!(terrain("file = 'a.tif'\nheights = [1, 1]")[0].contains("above the first"));
        assert!(terrain("file = 'a.asc'\nheights = [0, 1]")[0].contains("to be a picture"));
        assert!(messages("[simulation.terrain]\nfile = 'a.asc'")[0].contains("kind = \"file\""));
        assert!(messages("[simulation.water]\ndepth_map = 'a.png'")[0].contains("depths` is missing"));
    }

    #[test]
    fn a_rule_is_silent_where_its_keys_are_wrong_already() {
        let found = messages(
            "[[simulation.source]]\nedge = 'west'\nlevel = 'high'\n[simulation.terrain]\nkind = 'fiel'\nfile = 'a.asc'",
        );
        assert!(
            found.len() == 2 && found[0].contains("a finite number") && found[1].contains("nearest is `file`"),
            "{found:?}"
        );
        assert_eq!(messages("[simulation]\n"), [""; 0]);
    }
}
