//! The names of finished files: the default name, the frame number in `-o`, the name of a stopped picture.
//! No file is touched here.

use std::path::{Path, PathBuf};

use time::{OffsetDateTime, macros::format_description};

/// The name without `-o`: `SCENE_Frame ####_method REPRESENTATION_DATE-TIME.exr`, as the report's section 5.4 named
/// its files. SCENE is the scene file's stem, or its folder's name when the stem is `scene`.
pub fn default_name(scene: &Path, frame: i64, representation: &str, when: OffsetDateTime) -> String {
    let stem = |path: &Path| path.file_stem().map(|s| s.to_string_lossy().into_owned());
    let mut name = stem(scene).unwrap_or_else(|| "scene".into());
    if name == "scene" {
        // Absolute first, so that `scene.toml` in the current folder finds the folder's name.
        let folder = std::path::absolute(scene).ok().and_then(|p| p.parent().map(Path::to_path_buf));
        if let Some(folder) = folder.and_then(|f| f.file_name().map(|n| n.to_string_lossy().into_owned())) {
            name = folder;
        }
    }
    let stamp = when
        .format(format_description!("[year][month][day]-[hour][minute][second]"))
        .expect("a date has a year, month, day, hour, minute and second");
    format!("{name}_Frame {frame:04}_method {representation}_{stamp}.exr")
}

/// Puts the frame number in place of every run of `#` in the file's name, padded with zeros to the run's length.
/// Folders keep theirs.
pub fn with_frame(pattern: &Path, frame: i64) -> PathBuf {
    let Some(name) = pattern.file_name().map(|n| n.to_string_lossy().into_owned()) else {
        return pattern.to_path_buf();
    };
    if !name.contains('#') {
        return pattern.to_path_buf(); // Names that are not Unicode pass through unharmed.
    }
    let mut numbered = String::with_capacity(name.len());
    let mut rest = name.as_str();
    while let Some(start) = rest.find('#') {
        let run = rest[start..].len() - rest[start..].trim_start_matches('#').len();
        numbered.push_str(&rest[..start]);
        numbered.push_str(&format!("{frame:0run$}"));
        rest = &rest[start + run..];
    }
    numbered.push_str(rest);
    pattern.with_file_name(numbered)
}

/// The name of a picture that was stopped: `NAME.partial.exr` for `NAME.exr`.
pub fn partial(path: &Path) -> PathBuf {
    let mut name = path.file_stem().unwrap_or_default().to_os_string();
    name.push(".partial");
    if let Some(extension) = path.extension() {
        name.push(".");
        name.push(extension);
    }
    path.with_file_name(name)
}

/// The name of the deep picture beside a flat one: `NAME.deep.exr` for `NAME.exr`, `NAME.deep.####.exr` for `NAME.####.exr`.
pub fn deep(pattern: &Path) -> PathBuf {
    let Some(stem) = pattern.file_stem().map(|stem| stem.to_string_lossy().into_owned()) else {
        return pattern.to_path_buf();
    };
    let stem = match stem.rsplit_once('.') {
        Some((name, number)) if !number.is_empty() && number.chars().all(|c| c == '#') => {
            format!("{name}.deep.{number}")
        }
        _ => format!("{stem}.deep"),
    };
    let extension = pattern.extension().map(|e| format!(".{}", e.to_string_lossy())).unwrap_or_default();
    pattern.with_file_name(stem + &extension)
}

/// A name for several frames: `NAME.####.exr` for `NAME.exr`, unless the file's name says already where the number goes.
pub fn numbered(pattern: &Path) -> PathBuf {
    let Some(stem) = pattern.file_stem() else { return pattern.to_path_buf() };
    if pattern.file_name().is_some_and(|name| name.to_string_lossy().contains('#')) {
        return pattern.to_path_buf();
    }
    let mut name = stem.to_os_string();
    name.push(".####");
    if let Some(extension) = pattern.extension() {
        name.push(".");
        name.push(extension);
    }
    pattern.with_file_name(name)
}

#[cfg(test)]
mod tests {
    use super::*;
    use time::macros::datetime;

    #[test]
    fn the_default_name_says_scene_frame_method_and_time() {
        let when = datetime!(2026-11-22 04:05:06 +1);
        assert_eq!(
            default_name(Path::new("a/falls.toml"), 7, "spline", when),
            "falls_Frame 0007_method spline_20261122-040506.exr"
        );
        assert_eq!(
            default_name(Path::new("scenes/small/scene.toml"), 12345, "quads", when),
            "small_Frame 12345_method quads_20261122-040506.exr"
        );
        let here = std::env::current_dir().unwrap();
        let folder = here.file_name().unwrap().to_str().unwrap();
        assert!(default_name(Path::new("scene.toml"), 0, "spline", when).starts_with(&format!("{folder}_Frame 0000_")));
    }

    #[test]
    fn hashes_become_the_padded_frame() {
        assert_eq!(with_frame(Path::new("o/a.####.exr"), 42), Path::new("o/a.0042.exr"));
        assert_eq!(with_frame(Path::new("#_b##.exr"), 123), Path::new("123_b123.exr"));
        assert_eq!(with_frame(Path::new("shot#1/a.exr"), 5), Path::new("shot#1/a.exr"));
        assert_eq!(with_frame(Path::new("plain.exr"), 5), Path::new("plain.exr"));
    }

    #[test]
    fn stopped_pictures_have_a_name_of_their_own() {
        assert_eq!(partial(Path::new("o/a.0042.exr")), Path::new("o/a.0042.partial.exr"));
        assert_eq!(partial(Path::new("a.png")), Path::new("a.partial.png"));
    }

    #[test]
    fn deep_pictures_stand_beside_flat_ones() {
        assert_eq!(deep(Path::new("o/r.exr")), Path::new("o/r.deep.exr"));
        assert_eq!(deep(Path::new("o/r.####.exr")), Path::new("o/r.deep.####.exr"));
        assert_eq!(deep(Path::new("r_####.exr")), Path::new("r_####.deep.exr"));
        assert_eq!(deep(Path::new("r.0001.exr")), Path::new("r.0001.deep.exr"));
    }

    #[test]
    fn several_frames_never_share_a_name() {
        assert_eq!(numbered(Path::new("d#/a.exr")), Path::new("d#/a.####.exr"));
        assert_eq!(numbered(Path::new("a.##.exr")), Path::new("a.##.exr"));
        assert_eq!(numbered(Path::new("b")), Path::new("b.####"));
    }
}
