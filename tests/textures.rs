//! Textures on the command line: ground and sky from files, the same picture from a PNG and from a .tx made of it, the same bits
//! with any threads, and errors that name the file.

use std::path::Path;
use std::process::{Command, Output, Stdio};

use tempfile::TempDir;
use whitewater::output::{Picture, read_exr};

const TINY: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/tiny/scene.toml");

/// A small picture of the scene `tiny`, its ground and its sky from files of a folder.
fn render(folder: &Path, output: &str, arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_whitewater"));
    command.args(["render", TINY, "-q", "--reproducible", "--frame", "0", "-o", output]);
    if !arguments.contains(&"--threads") {
        command.args(["--threads", "2"]);
    }
    command.args(["--checkpoint", "0", "--set", "render.width=120", "--set", "render.height=68"]).args(arguments);
    command.current_dir(folder).env_remove("WHITEWATER_LOG").stdin(Stdio::null());
    command.output().expect("the program starts")
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// A folder with images of ground and sky.
fn folder() -> TempDir {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let wave = |k: u32, period: f32| 0.5 + 0.45 * (k as f32 * std::f32::consts::TAU / period).sin();
    let level = |share: f32| (255.0 * share) as u8;
    let ground = image::RgbImage::from_fn(256, 256, |x, y| {
        image::Rgb([level(wave(x, 16.0)), level(wave(y, 64.0)), 255 * ((x / 8 + y / 8) % 2) as u8])
    });
    ground.save(folder.path().join("ground.png")).unwrap();
    let sky = image::RgbImage::from_fn(512, 256, |x, y| {
        image::Rgb([level(wave(x, 32.0)), level(wave(y, 128.0)), level(1.0 - y as f32 / 256.0)])
    });
    sky.save(folder.path().join("sky.png")).unwrap();
    folder
}

/// The overrides that name images of the folder.
fn named(folder: &Path, ground: &str, sky: &str) -> Vec<String> {
    let file = |name: &str| folder.join(name).to_str().unwrap().to_owned();
    [format!("terrain.texture={}", file(ground)), "sky.kind=latlong".into(), format!("sky.image={}", file(sky))]
        .into_iter()
        .flat_map(|value| ["--set".to_owned(), value])
        .collect()
}

fn picture(folder: &TempDir, name: &str, ground: &str, sky: &str, further: &[&str]) -> Picture {
    let overrides = named(folder.path(), ground, sky);
    let arguments: Vec<&str> = overrides.iter().map(String::as_str).chain(further.iter().copied()).collect();
    let output = render(folder.path(), name, &arguments);
    assert_eq!(output.status.code(), Some(0), "{}", said(&output));
    read_exr(&folder.path().join(name)).unwrap()
}

fn assert_same(one: &Picture, other: &Picture) {
    assert_eq!(one.channels.len(), other.channels.len());
    for (a, b) in one.channels.iter().zip(&other.channels) {
        let same = a.samples.iter().zip(&b.samples).all(|(a, b)| a.to_bits() == b.to_bits());
        assert!(same, "{}", a.name);
    }
}

/// Mean of a channel, and root mean square difference to another picture's.
fn apart(one: &Picture, other: &Picture, name: &str) -> [f64; 2] {
    let [a, b] = [one, other].map(|picture| &picture.channel(name).unwrap().samples);
    let count = a.len() as f64;
    let squares: f64 = a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum();
    [a.iter().map(|&value| f64::from(value)).sum::<f64>() / count, (squares / count).sqrt()]
}

#[test]
fn ground_and_sky_come_from_images_with_the_same_bits_at_any_thread_count() {
    let folder = folder();
    for integrator in ["whitted", "path"] {
        let integrator = format!("render.integrator={integrator}");
        let further = ["--set", integrator.as_str()];
        let once = picture(&folder, "a.exr", "ground.png", "sky.png", &further);
        let again = picture(&folder, "b.exr", "ground.png", "sky.png", &[&further[..], &["--threads", "1"]].concat());
        assert_same(&once, &again);
        let output = render(folder.path(), "plain.exr", &further);
        assert_eq!(output.status.code(), Some(0), "{}", said(&output));
        let plain = read_exr(&folder.path().join("plain.exr")).unwrap();
        assert!(apart(&once, &plain, "terrain.G")[1] > 0.02 && apart(&once, &plain, "reflection.B")[1] > 0.01);
    }
}

#[cfg(feature = "oiio")]
#[test]
fn a_texture_made_of_an_image_gives_the_same_picture_in_any_memory_and_with_any_threads() {
    let folder = folder();
    for name in ["ground", "sky"] {
        let [png, tx] = ["png", "tx"].map(|ending| folder.path().join(name).with_extension(ending));
        whitewater::images::make_texture(&png, &tx).unwrap();
    }
    let whole = picture(&folder, "whole.exr", "ground.png", "sky.png", &[]);
    let pieces = picture(&folder, "pieces.exr", "ground.tx", "sky.tx", &[]);
    for name in ["R", "G", "B", "reflection.R", "terrain.G"] {
        let [mean, difference] = apart(&whole, &pieces, name);
        let [other, _] = apart(&pieces, &whole, name);
        assert!((other / mean - 1.0).abs() < 0.01, "{name}: {other} for {mean}");
        assert!(difference < 0.02 * mean, "{name}: {difference} of {mean}");
    }
    for further in [["--threads", "1"], ["--set", "render.texture_memory=1M"]] {
        assert_same(&pieces, &picture(&folder, "again.exr", "ground.tx", "sky.tx", &further));
    }
}

#[test]
fn images_that_are_missing_or_broken_are_named_before_anything_is_rendered() {
    let folder = folder();
    for ending in ["png", "exr", "tx"] {
        let broken = format!("broken.{ending}");
        std::fs::write(folder.path().join(&broken), b"no picture").unwrap();
        for wrong in [broken, format!("absent.{ending}")] {
            for (ground, sky) in [(wrong.as_str(), "sky.png"), ("ground.png", wrong.as_str())] {
                let overrides = named(folder.path(), ground, sky);
                let arguments: Vec<&str> = overrides.iter().map(String::as_str).collect();
                let output = render(folder.path(), "out.exr", &arguments);
                assert_eq!(output.status.code(), Some(2), "{wrong}");
                assert!(said(&output).contains(&wrong), "{wrong}: {}", said(&output));
                assert!(!folder.path().join("out.exr").exists());
            }
        }
    }
    for wrong in ["render.texture_memory=much", "terrain.texture_extent=[0, 0, 0, 1]"] {
        let output = render(folder.path(), "out.exr", &["--set", wrong]);
        assert_eq!(output.status.code(), Some(2));
        assert!(said(&output).contains(wrong.split('=').next().unwrap()), "{}", said(&output));
    }
}

/// A panel that faces the camera of `tiny`, 5 m east, as glTF with its numbers and its image in files of their own.
fn panel(folder: &Path, image: &str) -> Vec<String> {
    let corners = [[5.0_f32, 0.2, 0.5], [5.0, 0.2, -0.3], [5.0, 1.0, -0.3], [5.0, 1.0, 0.5]];
    let coordinates = [[0.0_f32, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]];
    let mut numbers: Vec<u8> = corners.as_flattened().iter().flat_map(|value| value.to_le_bytes()).collect();
    numbers.extend(coordinates.as_flattened().iter().flat_map(|value| value.to_le_bytes()));
    numbers.extend([0_u16, 1, 2, 0, 2, 3].iter().flat_map(|value| value.to_le_bytes()));
    std::fs::write(folder.join("panel.bin"), numbers).unwrap();
    let text = r#"{"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],"nodes":[{"mesh":0}],
        "materials":[{"name":"halves","pbrMetallicRoughness":{"baseColorFactor":[0.5,0.5,0.25,1],"baseColorTexture":{"index":0}}}],
        "textures":[{"source":0}],"images":[{"uri":"IMAGE"}],
        "meshes":[{"primitives":[{"attributes":{"POSITION":0,"TEXCOORD_0":1},"indices":2,"material":0}]}],
        "accessors":[{"bufferView":0,"componentType":5126,"count":4,"type":"VEC3","min":[5,0.2,-0.3],"max":[5,1,0.5]},
          {"bufferView":1,"componentType":5126,"count":4,"type":"VEC2"},
          {"bufferView":2,"componentType":5123,"count":6,"type":"SCALAR"}],
        "bufferViews":[{"buffer":0,"byteLength":48},{"buffer":0,"byteOffset":48,"byteLength":32},
          {"buffer":0,"byteOffset":80,"byteLength":12}],
        "buffers":[{"uri":"panel.bin","byteLength":92}]}"#;
    std::fs::write(folder.join("panel.gltf"), text.replace("IMAGE", image)).unwrap();
    vec!["--set".into(), format!("environment.meshes=['{}']", folder.join("panel.gltf").display())]
}

#[test]
fn a_mesh_shows_the_image_of_its_material_and_a_missing_one_is_named() {
    let folder = tempfile::tempdir().unwrap();
    // Red to the left, blue to the right.
    let halves = |x: u32| if x < 32 { [255, 0, 0] } else { [0, 0, 255] };
    image::RgbImage::from_fn(64, 64, |x, _| image::Rgb(halves(x))).save(folder.path().join("halves.png")).unwrap();
    let own = panel(folder.path(), "halves.png");
    let own: Vec<&str> = own.iter().map(String::as_str).collect();
    let shown = |name: &str, further: &[&str]| {
        let output = render(folder.path(), name, &[&own[..], further].concat());
        assert_eq!(output.status.code(), Some(0), "{}", said(&output));
        read_exr(&folder.path().join(name)).unwrap()
    };
    for integrator in ["render.integrator=whitted", "render.integrator=path"] {
        let one = shown("one.exr", &["--set", integrator]);
        assert_same(&one, &shown("two.exr", &["--set", integrator, "--threads", "1"]));
        let [place, side, red, blue] =
            ["P.x", "P.z", "albedo.R", "albedo.B"].map(|name| &one.channel(name).unwrap().samples);
        let (mut count, mut wrong) = ([0, 0], 0);
        for pixel in 0..place.len() {
            // By the image's middle a pixel sees both halves.
            if (place[pixel] - 5.0).abs() < 1e-3 && (side[pixel] - 0.1).abs() > 0.05 {
                let left = side[pixel] > 0.1;
                let expected = if left { [0.5, 0.0] } else { [0.0, 0.25] };
                count[usize::from(left)] += 1;
                let near = |seen: f32, expected: f32| (seen - expected).abs() < 0.01;
                wrong += usize::from(!(near(red[pixel], expected[0]) && near(blue[pixel], expected[1])));
            }
        }
        // Those at the panel's edges see what is behind as well.
        assert!(count[0] > 100 && count[1] > 100 && wrong * 5 < count[0] + count[1], "{count:?} {wrong}");
        let names: Vec<&str> = one.metadata.cryptomattes.iter().flat_map(|matte| &matte.names).map(|n| &**n).collect();
        assert!(names.contains(&"panel") && names.contains(&"diffuse"), "{names:?}");
    }
    for image in ["absent.png", "panel.bin"] {
        panel(folder.path(), image);
        let output = render(folder.path(), "never.exr", &own);
        assert_eq!(output.status.code(), Some(2), "{image}");
        for word in ["panel.gltf", "halves", image] {
            assert!(said(&output).contains(word), "{word}: {}", said(&output));
        }
        assert!(!folder.path().join("never.exr").exists());
    }
}
