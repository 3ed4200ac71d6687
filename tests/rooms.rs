//! Data runs one way through the rooms: every `crate::room` path in `src/` and `ffi/` is an edge that this table allows.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Each room with the rooms that it may name, besides itself and `math`, which lies under everything.
const EDGES: &[(&str, &[&str])] = &[
    ("math", &[]),
    ("simd", &[]),
    ("ffi", &[]),
    ("scene", &[]),
    ("images", &["ffi"]),
    ("state", &["scene"]),
    ("surface", &["simd", "scene", "state"]),
    ("particles", &["scene", "images", "state"]),
    ("foam", &["scene", "state", "particles"]),
    ("mist", &["scene", "simd"]),
    ("terrain", &["scene", "images", "state", "surface"]),
    ("sim", &["simd", "scene", "state", "foam", "terrain"]),
    ("lower", &["simd", "scene", "state", "surface", "particles", "mist", "terrain"]),
    ("accel", &["simd", "ffi", "scene", "surface", "lower"]),
    ("optics", &["scene", "images"]),
    ("output", &["ffi", "scene"]),
    ("denoise", &["ffi", "output"]),
    (
        "render",
        &[
            "simd",
            "scene",
            "state",
            "foam",
            "surface",
            "particles",
            "mist",
            "terrain",
            "lower",
            "accel",
            "optics",
            "output",
        ],
    ),
    ("merge", &["output", "render"]),
    (
        "bench",
        &[
            "simd",
            "scene",
            "state",
            "sim",
            "surface",
            "particles",
            "terrain",
            "lower",
            "accel",
            "optics",
            "output",
            "render",
        ],
    ),
    (
        "cli",
        &[
            "simd",
            "scene",
            "images",
            "state",
            "foam",
            "sim",
            "surface",
            "particles",
            "terrain",
            "lower",
            "accel",
            "optics",
            "output",
            "denoise",
            "render",
            "merge",
            "bench",
        ],
    ),
];

/// Files that belong to no room: they name all of them, and are read by eye.
const ROOTS: [&str; 2] = ["lib.rs", "main.rs"];

fn is_room(name: &str) -> bool {
    EDGES.iter().any(|(room, _)| *room == name)
}

/// The text without comments, as far as lines show them (a path in a link of a comment is no edge).
fn code(text: &str) -> String {
    text.lines()
        .map(|line| if line.trim_start().starts_with("//") { "" } else { line.split(" // ").next().unwrap_or("") })
        .fold(String::new(), |all, line| all + line + "\n")
}

fn identifier(text: &str) -> &str {
    let end = text.find(|letter: char| !letter.is_alphanumeric() && letter != '_').unwrap_or(text.len());
    &text[..end]
}

/// First names of a path's rest: one, or those of `{a::b, c}` at its outermost level.
fn first_names(rest: &str) -> Vec<String> {
    let Some(group) = rest.trim_start().strip_prefix('{') else {
        return vec![identifier(rest.trim_start()).to_owned()];
    };
    let (mut depth, mut start, mut names) = (0, 0, Vec::new());
    for (at, letter) in group.char_indices() {
        let closes = letter == '}' && depth == 0;
        if closes || (letter == ',' && depth == 0) {
            names.push(identifier(group[start..at].trim()).to_owned());
            start = at + 1;
        }
        match letter {
            _ if closes => break,
            '{' => depth += 1,
            '}' => depth -= 1,
            _ => {}
        }
    }
    names.retain(|name| !name.is_empty());
    names
}

/// Names that stand right under the crate in a file whose module is `depth` levels below it.
fn names_under_crate(text: &str, depth: usize) -> BTreeSet<String> {
    let code = code(text);
    let mut names = BTreeSet::new();
    for (at, _) in code.match_indices("crate::") {
        let before = code[..at].chars().next_back();
        if !before.is_some_and(|letter| letter.is_alphanumeric() || letter == '_' || letter == '$') {
            names.extend(first_names(&code[at + "crate::".len()..]));
        }
    }
    // The long way round: `super::super::room`. Modules inside a file only make the climb longer, never shorter.
    let climb = "super::".repeat(depth);
    for (at, _) in code.match_indices(&climb) {
        let rest = code[at..].trim_start_matches("super::");
        names.extend(first_names(rest).into_iter().filter(|name| is_room(name)));
    }
    names
}

fn rust_files(folder: &Path, files: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            rust_files(&path, files);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            files.push(path);
        }
    }
}

/// Room and depth of a file, by its path under `src/` or `ffi/`.
fn place(folder: &str, path: &Path) -> (String, usize) {
    let parts: Vec<_> = path.iter().map(|part| part.to_str().unwrap().trim_end_matches(".rs")).collect();
    let depth = parts.len() - usize::from(parts.last() == Some(&"mod"));
    if folder == "ffi" { ("ffi".to_owned(), depth + 1) } else { (parts[0].to_owned(), depth) }
}

#[test]
fn rooms_name_only_the_rooms_below_them() {
    let project = Path::new(env!("CARGO_MANIFEST_DIR"));
    let (mut wrong, mut edges) = (Vec::new(), 0);
    for folder in ["src", "ffi"] {
        let mut files = Vec::new();
        rust_files(&project.join(folder), &mut files);
        for file in files {
            let path = file.strip_prefix(project.join(folder)).unwrap();
            if folder == "src" && ROOTS.iter().any(|root| path == Path::new(root)) {
                continue;
            }
            let (room, depth) = place(folder, path);
            let Some((_, allowed)) = EDGES.iter().find(|(name, _)| *name == room) else {
                wrong.push(format!("{}: {room} is not in the table of rooms", path.display()));
                continue;
            };
            for name in names_under_crate(&std::fs::read_to_string(&file).unwrap(), depth) {
                edges += 1;
                if name != room && name != "math" && !allowed.contains(&name.as_str()) {
                    wrong.push(format!("{folder}/{}: {room} names {name}", path.display()));
                }
            }
        }
    }
    assert!(wrong.is_empty(), "edges that the table does not allow:\n{}", wrong.join("\n"));
    assert!(edges > 5, "only {edges} edges found: the search is broken");
}

#[test]
fn every_edge_points_down() {
    for (position, (room, allowed)) in EDGES.iter().enumerate() {
        for name in *allowed {
            let below = EDGES.iter().position(|(other, _)| other == name);
            assert!(
                below.is_some_and(|below| below < position),
                "{room} -> {name} does not point to a room above it here"
            );
        }
        assert!(
            !allowed.contains(&"ffi") || ["images", "accel", "output", "denoise"].contains(room),
            "{room} names ffi"
        );
    }
}

#[test]
fn the_search_finds_paths_and_groups_and_leaves_comments() {
    let text = "
        //! See [`crate::cli`].
        use crate::surface::{LANES, LaneRays};
        use crate::{scene::Scene, lower::{Part, Shape}};
        fn f() { crate::render::g(); $crate::bench::h(); } // not crate::simd
        use super::super::output::Window; use super::sibling::Thing; use super::accel::Local;
    ";
    let names: Vec<_> = names_under_crate(text, 2).into_iter().collect();
    assert_eq!(names, ["lower", "output", "render", "scene", "surface"]);
}
