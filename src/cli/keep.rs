//! Where a frame's checkpoints lie, and whose they are: a hash of everything that its pixels depend on.

use std::ffi::OsString;
use std::io::Read;
use std::path::{Path, PathBuf};

use anyhow::Context;
use sha2::{Digest, Sha256};

use super::errors::CliError;
use super::finished;
use super::load;
use super::prepare::{Run, is_exr};
use super::values::Bytes;
use crate::lower::Environment;
use crate::output::naming;
use crate::particles;
use crate::render::Keeping;
use crate::scene::{self, LoadedScene};
use crate::state::FrameSequence;
use crate::terrain::{Mesh, MeshAlbedo};

/// `.NAME.checkpoint` beside the picture `NAME`; of a pair of eyes, `.NAME.left.checkpoint` and `.NAME.right.checkpoint`.
pub(super) fn checkpoint_path(picture: &Path, eye: Option<&str>) -> PathBuf {
    let mut name = OsString::from(".");
    name.push(picture.file_name().unwrap_or_default());
    for part in eye.into_iter().chain(["checkpoint"]) {
        name.push(".");
        name.push(part);
    }
    picture.with_file_name(name)
}

/// The identity of one eye's pixels, of those of a pair.
pub(super) fn of_eye(identity: &str, eye: &str) -> String {
    hexadecimal(&Sha256::digest(format!("{identity} {eye}")))
}

/// Bytes in hexadecimal digits.
pub(super) fn hexadecimal(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// What of a frame is kept on the way, and recorded of it at the end.
pub(super) struct Kept {
    /// The state of every pixel, for each eye.
    pub(super) eyes: Vec<Keeping>,
    /// Where the record of a finished frame lies.
    pub(super) record: PathBuf,
    /// What is recorded as wanted.
    pub(super) wanted: String,
}

/// The eyes of a frame: metres to the right of the camera's path, and the name of one of a pair.
pub(super) fn eyes(settings: &scene::Scene) -> Vec<(f64, Option<&'static str>)> {
    match settings.camera.stereo {
        None => vec![(0.0, None)],
        Some(apart) => vec![(-0.5 * apart, Some("left")), (0.5 * apart, Some("right"))],
    }
}

/// How the state of a frame is kept, if it is.
///
/// # Errors
/// A file that decides on its pixels cannot be read.
pub(super) fn kept(run: &Run, number: i64) -> Result<Option<Kept>, CliError> {
    let arguments = run.arguments;
    let Some(pattern) = run.outputs.iter().find(|path| is_exr(path)).filter(|_| !arguments.checkpoint.is_zero()) else {
        return Ok(None);
    };
    let further =
        [run.simd.name().to_owned(), arguments.memory.map_or_else(String::new, |Bytes(bytes)| bytes.to_string())];
    let inputs = Inputs { loaded: &run.loaded, frames: &run.frames, environment: &run.environment };
    let identity = inputs.identity(number, &further)?;
    let picture = naming::with_frame(pattern, number);
    let output = &run.loaded.scene.output;
    let names: Vec<Option<&str>> = eyes(&run.loaded.scene).into_iter().map(|(_, name)| name).collect();
    // Of several pictures most have no checkpoint: they were not begun.
    let alone = names.len() == 1 && run.numbers.len() == 1;
    let eyes = names.iter().enumerate().map(|(index, &eye)| {
        let path = checkpoint_path(&picture, eye);
        Keeping {
            resume: arguments.resume && (alone || path.exists()),
            path,
            every: arguments.checkpoint,
            // The first eye's is all there is of it while the second is rendered.
            keep: arguments.keep_checkpoint || index + 1 < names.len(),
            identity: eye.map_or_else(|| identity.clone(), |eye| of_eye(&identity, eye)),
            scene_hash: run.loaded.hash.clone(),
            owner: output.owner.clone(),
            comments: output.comments.clone(),
        }
    });
    Ok(Some(Kept {
        eyes: eyes.collect(),
        record: finished::record_path(&picture),
        wanted: finished::wanted(run, number, &identity),
    }))
}

impl Kept {
    /// Removes the checkpoints of a finished picture.
    pub(super) fn remove_checkpoints(&self) {
        for Keeping { path, .. } in &self.eyes {
            match std::fs::remove_file(path) {
                Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
                    tracing::warn!("{} was not removed: {error}", path.display());
                }
                _ => {}
            }
        }
    }
}

/// What the pixels of a run's frames depend on.
#[derive(Clone, Copy)]
pub(super) struct Inputs<'a> {
    pub(super) loaded: &'a LoadedScene,
    pub(super) frames: &'a FrameSequence,
    pub(super) environment: &'a Environment,
}

impl Inputs<'_> {
    /// A hash of what frame `number`'s pixels depend on: the scene, but for what is done with finished pictures and for how many
    /// samples they get (the checkpoint compares those itself); what is in every file that it reads; and `further` words that
    /// decide on bits.
    ///
    /// # Errors
    /// A file that cannot be read.
    pub(super) fn identity(&self, number: i64, further: &[String]) -> Result<String, CliError> {
        let mut hash = Sha256::new();
        hash.update(serde_json::to_vec(&self.scene()).expect("a scene is plain data with string keys"));
        for word in further {
            hash.update([0]);
            hash.update(word);
        }
        for path in self.files(number)? {
            let own = of_file(&path).with_context(|| format!("could not read {}", path.display()))?;
            hash.update(own);
        }
        for (name, mesh) in &self.environment.meshes {
            hash.update(name);
            hash.update(of_mesh(mesh));
        }
        for sphere in &self.environment.spheres {
            let [x, y, z] = sphere.center;
            [x, y, z, sphere.radius]
                .into_iter()
                .chain(sphere.albedo)
                .for_each(|value| hash.update(value.to_le_bytes()));
        }
        Ok(hexadecimal(&hash.finalize()))
    }

    /// The scene as far as it decides on pixels.
    fn scene(&self) -> scene::Scene {
        let mut scene = self.loaded.scene.clone();
        scene.water.preset = None;
        scene.output = scene::Output::default();
        let plain = scene::Render::default();
        let render = &mut scene.render;
        (render.noise, render.seconds, render.max_samples) = (plain.noise, plain.seconds, plain.max_samples);
        render.texture_memory = plain.texture_memory;
        if render.caustic_samples.is_none() {
            // Otherwise it says in which of them caustics are looked for.
            render.samples = plain.samples;
        }
        scene
    }

    /// The files besides the environment's, each time in the same order.
    fn files(&self, number: i64) -> Result<Vec<PathBuf>, CliError> {
        let Self { loaded, frames, .. } = self;
        let scene = &loaded.scene;
        // Foam comes out of the frames before, and the frame after is seen while the shutter is open. A camera without a place
        // stands where it sees the sequence's first frame.
        let first = number.saturating_sub(i64::from(scene.foam.window));
        let near = first..=number.saturating_add(1);
        let read = frames.iter().filter(|(other, _)| near.contains(other) || *other == frames.first());
        let mut files: Vec<PathBuf> = read.map(|(_, path)| path.to_owned()).collect();
        let sky = &scene.sky;
        let images = [&sky.image, &sky.above, &sky.below, &scene.terrain.texture]
            .into_iter()
            .flatten()
            .map(|name| loaded.resolve(name));
        // One that this kind of sky, or a frame without ground, does not show need not be there.
        files.extend(images.filter(|path| path.is_file()));
        files.extend(particles::texture_files(&scene.particles, &loaded.directory).map_err(anyhow::Error::from)?);
        files.extend(load::mist_file(loaded, number)?);
        Ok(files)
    }
}

type Digest32 = sha2::digest::Output<Sha256>;

/// A hash of a file's bytes.
///
/// # Errors
/// The system's.
pub(super) fn of_file(path: &Path) -> std::io::Result<Digest32> {
    let mut file = std::fs::File::open(path)?;
    let mut buffer = vec![0; 1 << 16];
    let mut hash = Sha256::new();
    loop {
        match file.read(&mut buffer)? {
            0 => return Ok(hash.finalize()),
            count => hash.update(&buffer[..count]),
        }
    }
}

/// What is in a mesh rather than its file's bytes: glTF may keep them in several files.
fn of_mesh(mesh: &Mesh) -> Digest32 {
    let mut hash = Sha256::new();
    mesh.position.iter().flat_map(|point| point.to_array()).for_each(|value| hash.update(value.to_le_bytes()));
    mesh.normal.iter().flat_map(|normal| normal.to_array()).for_each(|value| hash.update(value.to_le_bytes()));
    mesh.index.iter().flatten().for_each(|index| hash.update(index.to_le_bytes()));
    let albedo = match &mesh.albedo {
        MeshAlbedo::Uniform(albedo) => std::slice::from_ref(albedo),
        MeshAlbedo::PerVertex(albedo) => albedo,
    };
    albedo.iter().flat_map(|albedo| albedo.to_array()).for_each(|value| hash.update(value.to_le_bytes()));
    if let Some(images) = &mesh.images {
        hash.update(images.digest());
    }
    hash.finalize()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_checkpoint_hides_beside_its_picture() {
        let path = |eye| checkpoint_path(Path::new("o/a.0001.exr"), eye);
        assert_eq!(path(None), Path::new("o/.a.0001.exr.checkpoint"));
        assert_eq!(path(Some("left")), Path::new("o/.a.0001.exr.left.checkpoint"));
        assert_ne!(of_eye("0a", "left"), of_eye("0a", "right"));
    }

    const ROCK: &str =
        "mtllib rock.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl moss\nf 1/1 2/2 3/3\n";

    /// An image of one pixel.
    fn moss(green: u8) -> Vec<u8> {
        let mut bytes = std::io::Cursor::new(Vec::new());
        image::RgbImage::from_pixel(1, 1, image::Rgb([50, green, 0]))
            .write_to(&mut bytes, image::ImageFormat::Bmp)
            .unwrap();
        bytes.into_inner()
    }

    /// A folder with a scene of five frames, and what else its pictures may depend on.
    fn folder() -> tempfile::TempDir {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
        for number in 0..5 {
            write(&format!("time{number:03}.state"), "a frame");
        }
        write("sky.exr", "a sky");
        write("ground.exr", "a ground");
        write("bank.vdb", "a bank of mist");
        write("drop.01.png", "a drop");
        write("rock.obj", ROCK);
        write("rock.mtl", "newmtl moss\nmap_Kd moss.bmp\n");
        std::fs::write(folder.path().join("moss.bmp"), moss(100)).unwrap();
        let scene = r#"
            frames.files = "time###.state"
            foam.window = 1
            sky = { kind = "latlong", image = "sky.exr" }
            terrain.texture = "ground.exr"
            mist.file = "bank.vdb"
            particles = { representation = "billboards", billboard.texture = "drop.##.png" }
            environment.meshes = ["rock.obj"]
        "#;
        write("scene.toml", scene);
        folder
    }

    fn identity(folder: &Path) -> String {
        let loaded = scene::load(&folder.join("scene.toml"), &[]).unwrap();
        let frames = load::frames(&loaded).unwrap();
        let environment = load::environment(&loaded, &frames).unwrap();
        Inputs { loaded: &loaded, frames: &frames, environment: &environment }.identity(3, &[]).unwrap()
    }

    #[test]
    fn whatever_a_frame_reads_is_part_of_its_identity_and_nothing_else_is() {
        let folder = folder();
        let before = identity(folder.path());
        assert_eq!(before, identity(folder.path()));
        let changed = |name: &str, text: &[u8]| {
            let path = folder.path().join(name);
            let old = std::fs::read(&path).unwrap();
            std::fs::write(&path, text).unwrap();
            let after = identity(folder.path());
            std::fs::write(&path, old).unwrap();
            after != before
        };
        let larger = ROCK.replace("v 1 0 0", "v 2 0 0");
        let turned = ROCK.replace("vt 1 0", "vt 2 0");
        let greener = moss(101);
        for name in ["time003.state", "time004.state", "time002.state", "time000.state", "sky.exr", "ground.exr"] {
            assert!(changed(name, b"x"), "{name}");
        }
        for (name, bytes) in [
            ("bank.vdb", &b"x"[..]),
            ("drop.01.png", b"x"),
            ("rock.obj", larger.as_bytes()),
            ("rock.obj", turned.as_bytes()),
            ("moss.bmp", &greener),
            ("rock.mtl", b"newmtl moss\nKd 0.5 0.5 0.5\nmap_Kd moss.bmp\n"),
        ] {
            assert!(changed(name, bytes), "{name}");
        }
        assert!(!changed("time001.state", b"x"), "two frames before, with a window of one");
        assert_eq!(before, identity(folder.path()));
    }
}
