//! `whitewater convert IN OUT`: a frame from text to NPZ or back, every number to the bit.
//!
//! What the other form has no place for is named to the caller, never dropped in silence.

use std::path::{Path, PathBuf};

use crate::state::{self, Encoding, FileKind, StateError};

/// Why a file was not converted.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ConvertError {
    /// Only frames have two forms.
    #[error("{}: a model has only one form, text; only frames are converted", .0.display())]
    Model(PathBuf),
    /// The name of the output does not say what it shall be.
    #[error("{}: expected a name in .npz, .state or .txt, or --text or --npz", .0.display())]
    Extension(PathBuf),
    /// Reading or writing failed.
    #[error(transparent)]
    State(#[from] StateError),
}

/// What was done.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Conversion {
    /// The form of the input.
    pub from: Encoding,
    /// The form of the output.
    pub to: Encoding,
    /// Arrays of the input that the output does not hold.
    pub left_out: Vec<String>,
}

/// Converts `input` into `output`. Without `encoding`, a name in `.npz` makes NPZ, one in `.state` or `.txt` the form that
/// the input has not. Both may be one file: the output replaces it only when it is whole.
///
/// # Errors
/// A model, a name that says nothing, a damaged input, what the system says.
pub fn run(
    input: &Path,
    output: &Path,
    encoding: Option<Encoding>,
    dry_threshold: f64,
) -> Result<Conversion, ConvertError> {
    let from = match state::detect(input)? {
        FileKind::Frame(encoding) => encoding,
        FileKind::Model => return Err(ConvertError::Model(input.to_path_buf())),
    };
    let extension = output.extension().and_then(|extension| extension.to_str());
    let to = match (encoding, extension) {
        (Some(encoding), _) => encoding,
        (None, Some("npz")) => Encoding::Npz,
        (None, Some("state" | "txt")) => match from {
            Encoding::Text => Encoding::Npz,
            Encoding::Npz => Encoding::Text,
        },
        (None, _) => return Err(ConvertError::Extension(output.to_path_buf())),
    };
    let frame = state::read_frame(input, dry_threshold)?;
    state::save_frame(&frame, output, to)?;
    let mut left_out: Vec<String> = frame.extra.into_iter().map(|array| array.name).collect();
    if frame.particles.id.is_some() && to == Encoding::Text {
        left_out.push("id".to_string());
    }
    Ok(Conversion { from, to, left_out })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::state::{Columns, Frame, Particles, read_frame, save_frame};

    fn frame() -> Frame {
        let flow = (0..9).map(|i| [f64::from(i), -0.0]).collect();
        Frame {
            time: 0.1,
            columns: Columns {
                origin: [1e6 + 0.1, -3.0],
                width: [0.1, 0.3],
                nx: 3,
                nz: 3,
                base: vec![0.1; 9],
                top: (0..9).map(|i| 0.1 + f64::from(i) / 3.0).collect(),
                pressure: vec![1e-300; 9],
                flow,
            },
            particles: Particles {
                position: vec![[0.1, 2.0, 3.0]],
                velocity: vec![[0.5, 0.25, -8.0]],
                mass: vec![1e-9],
                age: vec![0.0],
                id: None,
            },
            extra: vec![],
        }
    }

    #[test]
    fn text_to_npz_to_text_keeps_every_bit() {
        let directory = tempfile::tempdir().unwrap();
        let at = |name: &str| directory.path().join(name);
        save_frame(&frame(), at("a.state"), Encoding::Text).unwrap();
        let there = run(&at("a.state"), &at("b.npz"), None, 0.001).unwrap();
        let back = run(&at("b.npz"), &at("c.state"), None, 0.001).unwrap();
        assert_eq!((there.from, there.to, back.to), (Encoding::Text, Encoding::Npz, Encoding::Text));
        assert_eq!(read_frame(at("b.npz"), 0.001).unwrap(), frame());
        assert_eq!(std::fs::read(at("a.state")).unwrap(), std::fs::read(at("c.state")).unwrap());
    }

    #[test]
    fn a_frame_can_replace_itself() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("time0.state");
        save_frame(&frame(), &path, Encoding::Text).unwrap();
        assert_eq!(run(&path, &path, None, 0.001).unwrap().to, Encoding::Npz);
        assert_eq!(state::detect(&path).unwrap(), FileKind::Frame(Encoding::Npz));
        assert_eq!(run(&path, &path, Some(Encoding::Npz), 0.001).unwrap().to, Encoding::Npz);
        assert_eq!(read_frame(&path, 0.001).unwrap(), frame());
    }

    #[test]
    fn identities_have_no_place_in_text_and_are_named() {
        let directory = tempfile::tempdir().unwrap();
        let at = |name: &str| directory.path().join(name);
        let mut frame = frame();
        frame.particles.id = Some(vec![u64::MAX]);
        save_frame(&frame, at("a.npz"), Encoding::Npz).unwrap();
        assert_eq!(read_frame(at("a.npz"), 0.001).unwrap(), frame);
        assert_eq!(run(&at("a.npz"), &at("b.state"), None, 0.001).unwrap().left_out, ["id"]);
        assert_eq!(run(&at("a.npz"), &at("c.npz"), None, 0.001).unwrap().left_out, [""; 0]);
    }

    #[test]
    fn models_and_names_that_say_nothing_are_refused() {
        let directory = tempfile::tempdir().unwrap();
        let at = |name: &str| directory.path().join(name);
        std::fs::write(at("model.state"), "whitewater-model 1\nend\n").unwrap();
        save_frame(&frame(), at("a.state"), Encoding::Text).unwrap();
        assert!(matches!(run(&at("model.state"), &at("m.npz"), None, 0.001), Err(ConvertError::Model(_))));
        assert!(matches!(run(&at("a.state"), &at("a.exr"), None, 0.001), Err(ConvertError::Extension(_))));
        assert!(matches!(run(&at("gone.state"), &at("a.npz"), None, 0.001), Err(ConvertError::State(_))));
        assert!(!at("a.npz").exists() && !at("m.npz").exists() && !at("a.exr").exists());
        assert!(run(&at("a.state"), &at("a.bin"), Some(Encoding::Npz), 0.001).is_ok());
    }
}
