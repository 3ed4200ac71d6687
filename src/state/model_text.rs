//! `model.state`: panels, spheres and meshes, read and written.
//!
//! Meshes are only named here; the terrain room opens them.

use std::io::{BufRead, Write};

use super::error::{Place, Problem, Problems, Stop, quote};
use super::frame_text::line;
use super::lines::{Lines, numbers};
use super::{Model, Panel, Sphere, StateError};

/// The first word of the file.
pub(super) const MAGIC: &str = "whitewater-model";

const PANEL: [&str; 15] = ["x0", "y0", "z0", "x1", "y1", "z1", "x2", "y2", "z2", "x3", "y3", "z3", "r", "g", "b"];
const SPHERE: [&str; 7] = ["x", "y", "z", "radius", "r", "g", "b"];
const MESHES: [&str; 4] = ["glb", "gltf", "obj", "ply"];

/// Reads a model, noting what is wrong with it.
pub(super) fn read(reader: impl BufRead, problems: &mut Problems) -> Result<Model, Stop> {
    let mut lines = Lines::new(reader)?;
    lines.magic(MAGIC)?;
    let mut model = Model::default();
    while let Some(text) = lines.text() {
        let place = lines.place();
        let word = lines.keyword().unwrap_or_default();
        let rest = text[word.len()..].trim_ascii();
        let read = match word {
            "end" => break,
            "panel" => panel(rest).map(|panel| model.panels.push(panel)),
            "sphere" => sphere(rest).map(|sphere| model.spheres.push(sphere)),
            "mesh" => mesh(rest).map(|path| model.meshes.push(path)),
            _ => Err((quote(text), "`panel`, `sphere`, `mesh` or `end`".to_string())),
        };
        if let Err((found, expected)) = read {
            problems.note(|| Problem::new(place, found, expected));
        }
        lines.advance()?;
    }
    lines.end()?;
    Ok(model)
}

fn panel(text: &str) -> Result<Panel, (String, String)> {
    let v = numbers(text, &PANEL)?;
    let corner = |i: usize| [v[3 * i], v[3 * i + 1], v[3 * i + 2]];
    Ok(Panel { corners: [corner(0), corner(1), corner(2), corner(3)], albedo: albedo([v[12], v[13], v[14]])? })
}

fn sphere(text: &str) -> Result<Sphere, (String, String)> {
    let [x, y, z, radius, r, g, b] = numbers(text, &SPHERE)?;
    if radius <= 0.0 {
        return Err((format!("radius = {radius}"), "a radius above 0".to_string()));
    }
    Ok(Sphere { center: [x, y, z], radius, albedo: albedo([r, g, b])? })
}

/// More than 1 would give back more light than it gets, less than 0 would take light away.
fn albedo(rgb: [f64; 3]) -> Result<[f64; 3], (String, String)> {
    match rgb.iter().all(|c| (0.0..=1.0).contains(c)) {
        true => Ok(rgb),
        false => Err((format!("albedo {} {} {}", rgb[0], rgb[1], rgb[2]), "r g b from 0 to 1, linear".to_string())),
    }
}

fn mesh(path: &str) -> Result<String, (String, String)> {
    let extension = path.rsplit_once('.').map_or("", |(_, extension)| extension);
    match MESHES.iter().any(|known| known.eq_ignore_ascii_case(extension)) {
        true => Ok(path.to_string()),
        false => Err((format!("mesh {}", quote(path)), "a path that ends in .glb, .gltf, .obj or .ply".to_string())),
    }
}

/// Writes a model as text; every number reads back to the same bits.
///
/// # Errors
/// A value that the reader would refuse, a mesh path that the format has no way to say, or what the writer says.
pub fn write_model(model: &Model, mut writer: impl Write) -> Result<(), StateError> {
    let mut out = format!("{MAGIC} 1\n").into_bytes();
    for panel in &model.panels {
        let values: Vec<f64> = panel.corners.as_flattened().iter().chain(&panel.albedo).copied().collect();
        line(&mut out, "panel", &values)?;
    }
    for Sphere { center: [x, y, z], radius, albedo: [r, g, b] } in &model.spheres {
        line(&mut out, "sphere", &[*x, *y, *z, *radius, *r, *g, *b])?;
    }
    for path in &model.meshes {
        writeln!(out, "mesh {path}")?;
    }
    out.extend_from_slice(b"end\n");
    // Few lines: what was just written is read again, which finds every value and path that would not survive.
    let unwritable = |found: String| Problem::new(Place::File, found, "a model that reads back as it was");
    let mut problems = Problems::default();
    let again = read(out.as_slice(), &mut problems);
    match problems.settle(std::path::Path::new("model"), again) {
        Ok(again) if again == *model => {}
        Ok(_) => return Err(StateError::Unwritable(unwritable("a mesh path with `#` or outer blanks".to_string()))),
        Err(StateError::Damaged { mut problems, .. }) => return Err(StateError::Unwritable(problems.swap_remove(0))),
        Err(error) => return Err(error),
    }
    writer.write_all(&out)?;
    writer.flush()?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    const GOOD: &str = "\
whitewater-model 1
mesh a folder/rocks 2.glb   # with blanks
sphere 1 2 3 0.5  0.1 0.2 0.3
panel  0 0 0  1 0 0  1 1 0  0 1 0  1 0 0.5
end
";

    fn parse(text: &str) -> Result<Model, StateError> {
        let mut problems = Problems::default();
        let model = read(text.as_bytes(), &mut problems);
        problems.settle(Path::new("m"), model)
    }

    fn damage(from: &str, to: &str) -> String {
        assert!(GOOD.contains(from), "{from}");
        match parse(&GOOD.replacen(from, to, 1)) {
            Err(StateError::Damaged { problems, .. }) => problems[0].to_string(),
            other => panic!("{from} -> {to}: {other:?}"),
        }
    }

    #[test]
    fn lines_come_in_any_order() {
        let model = parse(GOOD).unwrap();
        assert_eq!(model.meshes, ["a folder/rocks 2.glb"]);
        assert_eq!(model.spheres, [Sphere { center: [1.0, 2.0, 3.0], radius: 0.5, albedo: [0.1, 0.2, 0.3] }]);
        assert_eq!(model.panels[0].corners[2], [1.0, 1.0, 0.0]);
        assert_eq!(model.panels[0].albedo, [1.0, 0.0, 0.5]);
    }

    #[test]
    fn each_kind_of_damage_names_its_line() {
        for (from, to, expected) in [
            ("model 1", "model 2", "line 1: version `2`; expected `whitewater-model 1`"),
            (
                "whitewater-model",
                "whitewater-frame",
                "line 1: found `whitewater-frame 1`; expected `whitewater-model 1`",
            ),
            ("0.5  0.1", "0  0.1", "line 3: radius = 0; expected a radius above 0"),
            (
                "0.1 0.2 0.3",
                "0.1 0.2",
                "line 3: 6 numbers in `1 2 3 0.5  0.1 0.2`; expected 7 numbers: x y z radius r g b",
            ),
            ("0.1 0.2 0.3", "0.1 255 0.3", "line 3: albedo 0.1 255 0.3; expected r g b from 0 to 1, linear"),
            ("1 0 0.5", "1 0 inf", "line 4: b = `inf`; expected a finite number"),
            ("rocks 2.glb", "rocks.blend", "line 2: mesh `a folder/rocks.blend`; expected a path that ends in"),
            ("panel", "pannel", "line 4: `pannel  0 0 0"),
            ("end\n", "", "line 4: the file ends here; expected `end`"),
            (
                "end\n",
                "end\nsphere 1 1 1 1 1 1 1\n",
                "line 6: found `sphere 1 1 1 1 1 1 1`; expected nothing after `end`",
            ),
        ] {
            let found = damage(from, to);
            assert!(found.starts_with(expected), "{from} -> {to}: {found}");
        }
    }

    #[test]
    fn a_written_model_reads_back_the_same() {
        let mut model = parse(GOOD).unwrap();
        model.spheres[0].radius = 0.1 + 0.2;
        let mut out = Vec::new();
        write_model(&model, &mut out).unwrap();
        assert_eq!(parse(std::str::from_utf8(&out).unwrap()).unwrap(), model);
    }

    #[test]
    fn what_would_not_read_back_is_not_written() {
        for path in ["rocks#1.glb", " rocks.glb", "rocks.glb\nend", "rocks.stl", ""] {
            let model = Model { meshes: vec![path.to_string()], ..Model::default() };
            let mut out = Vec::new();
            assert!(matches!(write_model(&model, &mut out), Err(StateError::Unwritable(_))), "{path}");
            assert!(out.is_empty());
        }
    }
}
