//! Images on meshes: the right colour at known places, beyond the edges, from far away; and files that lie about them.

use std::path::Path;

use super::*;
use crate::images::srgb_to_linear;

/// Rows of grey levels as a PNG, the green always 102.
fn png(rows: &[&[u8]]) -> Vec<u8> {
    let (width, height) = (rows[0].len() as u32, rows.len() as u32);
    let image = image::RgbImage::from_fn(width, height, |x, y| {
        let grey = rows[y as usize][x as usize];
        image::Rgb([grey, 102, grey])
    });
    let mut bytes = std::io::Cursor::new(Vec::new());
    image.write_to(&mut bytes, image::ImageFormat::Png).unwrap();
    bytes.into_inner()
}

const JSON: &str = r#"{"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],"nodes":[{"mesh":0}],
    "materials":[{"name":"bark","pbrMetallicRoughness":{"baseColorFactor":[0.5,1,0.25,1],"baseColorTexture":{"index":0}}}],
    "textures":[{"source":0,"sampler":0}],"samplers":[{"wrapS":33648,"wrapT":33071}],
    "images":[{"bufferView":3,"mimeType":"image/png"}],
    "meshes":[{"primitives":[{"attributes":{"POSITION":0,"TEXCOORD_0":1},"indices":2,"material":0}]}],
    "accessors":[{"bufferView":0,"componentType":5126,"count":4,"type":"VEC3","min":[0,0,0],"max":[1,0,1]},
      {"bufferView":1,"componentType":5126,"count":4,"type":"VEC2"},
      {"bufferView":2,"componentType":5123,"count":6,"type":"SCALAR"}],
    "bufferViews":[{"buffer":0,"byteLength":48},{"buffer":0,"byteOffset":48,"byteLength":32},
      {"buffer":0,"byteOffset":80,"byteLength":12},{"buffer":0,"byteOffset":92,"byteLength":PNG}],
    "buffers":[{"byteLength":ALL}]}"#;

/// A level square metre, seen from above: its north-western corner has the coordinates `first`, its south-eastern `last`.
fn glb(json: &str, [first, last]: [[f32; 2]; 2], png: &[u8]) -> Vec<u8> {
    let mut data: Vec<u8> = Vec::new();
    let mut put = |values: &[f32]| values.iter().for_each(|value| data.extend(value.to_le_bytes()));
    put(&[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 1.0]);
    put(&[first[0], first[1], last[0], first[1], last[0], last[1], first[0], last[1]]);
    [0_u16, 2, 1, 0, 3, 2].iter().for_each(|index| data.extend(index.to_le_bytes()));
    data.extend(png);
    data.resize(data.len().next_multiple_of(4), 0);
    let json = json.replace("PNG", &png.len().to_string()).replace("ALL", &data.len().to_string());
    let mut json = json.into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut out = b"glTF\x02\0\0\0".to_vec();
    out.extend((28 + json.len() as u32 + data.len() as u32).to_le_bytes());
    for (kind, chunk) in [(b"JSON", &json), (b"BIN\0", &data)] {
        out.extend((chunk.len() as u32).to_le_bytes());
        out.extend(kind);
        out.extend(chunk);
    }
    out
}

fn load(folder: &Path, name: &str, bytes: impl AsRef<[u8]>) -> Result<Mesh, TerrainError> {
    std::fs::write(folder.join(name), bytes).unwrap();
    load_mesh(&folder.join(name))
}

/// The albedo of a mesh of one colour at x, z over a square of `width` (m).
fn seen(mesh: &Mesh, [x, z]: [f32; 2], width: f32) -> Vec3 {
    let MeshAlbedo::Uniform(albedo) = mesh.albedo else { panic!("{:?}", mesh.albedo) };
    for (triangle, &corners) in mesh.index.iter().enumerate() {
        let position = corners.map(|corner| mesh.position[corner as usize].as_vec3());
        let flat = position.map(|p| Vec2::new(p.x, p.z));
        let whole = (flat[1] - flat[0]).perp_dot(flat[2] - flat[0]);
        let at = Vec2::new(x, z) - flat[0];
        let (u, v) = (at.perp_dot(flat[2] - flat[0]) / whole, (flat[1] - flat[0]).perp_dot(at) / whole);
        if u >= 0.0 && v >= 0.0 && u + v <= 1.0 {
            let images = mesh.images.as_ref().unwrap();
            return albedo * images.at(triangle as u32, corners, position, [u, v], [Vec3::X * width, Vec3::Z * width]);
        }
    }
    panic!("nothing at {x} {z}");
}

const WHOLE: [[f32; 2]; 2] = [[0.0, 0.0], [1.0, 1.0]];

fn assert_near(seen: Vec3, expected: Vec3, what: &str) {
    assert!((seen - expected).abs().max_element() < 1e-5, "{what}: {seen} instead of {expected}");
}

/// What the factor leaves of a grey level.
fn bark(grey: u8) -> Vec3 {
    let linear = srgb_to_linear(f32::from(grey) / 255.0);
    Vec3::new(0.5 * linear, srgb_to_linear(0.4), 0.25 * linear)
}

#[test]
fn a_square_shows_its_image_times_the_factor_and_the_mean_from_afar() {
    let folder = tempfile::tempdir().unwrap();
    let rows: [&[u8]; 2] = [&[0, 50, 100, 150], &[200, 255, 30, 80]];
    let mesh = load(folder.path(), "square.glb", glb(JSON, WHOLE, &png(&rows))).unwrap();
    assert_eq!(mesh.albedo, MeshAlbedo::Uniform(Vec3::new(0.5, 1.0, 0.25)));
    let mut mean = Vec3::ZERO;
    for (y, row) in rows.iter().enumerate() {
        for (x, &grey) in row.iter().enumerate() {
            let place = [(x as f32 + 0.5) / 4.0, (y as f32 + 0.5) / 2.0];
            assert_near(seen(&mesh, place, 0.0), bark(grey), &format!("pixel {x} {y}"));
            mean += bark(grey) / 8.0;
        }
    }
    for width in [8.0, 1e3, 1e30] {
        assert_near(seen(&mesh, [0.4, 0.7], width), mean, "far away");
    }
    // Half as large on the ground: a footprint covers twice as much of the image.
    let small = load(folder.path(), "small.glb", glb(JSON, [[0.0, 0.0], [2.0, 1.0]], &png(&rows))).unwrap();
    assert_near(seen(&small, [0.0625, 0.25], 0.125), seen(&mesh, [0.125, 0.25], 0.25), "by the scale");
    assert!(mesh.images.as_ref().unwrap().bytes() >= 8 * 12 && mesh != small);
}

#[test]
fn beyond_its_edges_an_image_goes_on_as_the_file_says() {
    let folder = tempfile::tempdir().unwrap();
    let rows: [&[u8]; 2] = [&[0, 50, 100, 150], &[200, 255, 30, 80]];
    // Columns at u = -1.875, -0.125 and 1.375: mirrored, the edge's own, again and again.
    for (wrap, columns) in [("33648", [0, 0, 2]), ("33071", [0, 0, 3]), ("10497", [0, 3, 1])] {
        let json = JSON.replace("33648", wrap);
        let mesh = load(folder.path(), "wide.glb", glb(&json, [[-2.0, -2.0], [2.0, 2.0]], &png(&rows))).unwrap();
        for (u, column) in [-1.875, -0.125, 1.375].into_iter().zip(columns) {
            // v = 1.25 is below the image, which ends there with its last row.
            let place = [(u + 2.0) / 4.0, 3.25 / 4.0];
            assert_near(seen(&mesh, place, 0.0), bark(rows[1][column]), &format!("wrap {wrap} at {u}"));
        }
    }
}

#[test]
fn a_transform_picks_a_part_and_turns_it_as_the_extensions_example_says() {
    let folder = tempfile::tempdir().unwrap();
    // Its lower left quadrant alone, turned by a quarter.
    let transform = r#""baseColorTexture":{"index":0,"extensions":{"KHR_texture_transform":
        {"offset":[0,1],"rotation":1.57079632679,"scale":[0.5,0.5]}}}"#;
    let json = JSON.replace(r#""baseColorTexture":{"index":0}"#, transform);
    let rows: [&[u8]; 4] = [&[0; 4], &[0; 4], &[10, 60, 0, 0], &[110, 160, 0, 0]];
    let mesh = load(folder.path(), "turned.glb", glb(&json, WHOLE, &png(&rows))).unwrap();
    for (place, grey) in [([0.25, 0.25], 110), ([0.75, 0.25], 10), ([0.25, 0.75], 160), ([0.75, 0.75], 60)] {
        assert_near(seen(&mesh, place, 0.0), bark(grey), &format!("{place:?}"));
    }
}

#[test]
fn materials_keep_their_own_images_from_files_and_addresses() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("light moss.png"), png(&[&[255]])).unwrap();
    let json = JSON
        .replace(r#""materials":["#, r#""materials":[{"pbrMetallicRoughness":{"baseColorTexture":{"index":1}}},{},"#)
        .replace(r#""textures":["#, r#""textures":[{"source":1,"sampler":0},{"source":0},"#)
        .replace(r#""images":["#, r#""images":[{"uri":"light%20moss.png"},"#)
        .replace(
            r#""indices":2,"material":0}"#,
            r#""indices":2,"material":0},{"attributes":{"POSITION":0},"indices":2,"material":1},
               {"attributes":{"POSITION":0,"TEXCOORD_0":1},"indices":2,"material":2}"#,
        );
    let mesh = load(folder.path(), "three.glb", glb(&json, WHOLE, &png(&[&[100]]))).unwrap();
    assert_eq!(mesh.index.len(), 6);
    let MeshAlbedo::PerVertex(albedo) = &mesh.albedo else { panic!("{:?}", mesh.albedo) };
    let images = mesh.images.as_ref().unwrap();
    let green = srgb_to_linear(0.4);
    // Texture 1 is image 0, the file; texture 0 is image 1, the embedded one; the second material has none.
    for (triangle, expected) in [
        (0, Vec3::new(1.0, green, 1.0)),
        (2, Vec3::ONE),
        (5, Vec3::new(srgb_to_linear(100.0 / 255.0), green, srgb_to_linear(100.0 / 255.0))),
    ] {
        let corners = mesh.index[triangle];
        let position = corners.map(|corner| mesh.position[corner as usize].as_vec3());
        let shown = images.at(triangle as u32, corners, position, [0.3, 0.3], [Vec3::ZERO; 2]);
        assert_near(shown, expected, &format!("triangle {triangle}"));
    }
    assert_eq!([albedo[0], albedo[4], albedo[8]], [Vec3::ONE, Vec3::ONE, Vec3::new(0.5, 1.0, 0.25)]);
    // The file's contents, not its name, make the mesh what it is.
    std::fs::write(folder.path().join("light moss.png"), png(&[&[254]])).unwrap();
    assert_ne!(load_mesh(&folder.path().join("three.glb")).unwrap(), mesh);
}

#[test]
fn obj_shows_its_map_the_right_way_up() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("moss.png"), png(&[&[10, 60], &[110, 160]])).unwrap();
    std::fs::write(folder.path().join("m.mtl"), "newmtl bark\nKd 0.5 1 0.25\nmap_Kd moss.png\n").unwrap();
    let text = "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 1 0 1\nv 0 0 1\nvt 0 1\nvt 1 1\nvt 1 0\nvt 0 0\nusemtl bark\n\
                f 1/1 4/4 3/3 2/2\n";
    let mesh = load(folder.path(), "square.obj", text).unwrap();
    for (place, grey) in [([0.25, 0.25], 10), ([0.75, 0.25], 60), ([0.25, 0.75], 110), ([0.75, 0.75], 160)] {
        assert_near(seen(&mesh, place, 0.0), bark(grey), &format!("{place:?}"));
    }
    for (material, text, expected) in [
        ("map_Kd absent.png", text, "absent.png"),
        ("map_Kd -s 2 2 2 moss.png", text, "options"),
        ("map_Kd moss.png", "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 1 0 1\nusemtl bark\nf 1 2 3\n", "coordinates"),
        ("map_Kd moss.png", &text.replace("vt 1 1", "vt nan 1"), "NaN"),
        ("map_Kd m.mtl", text, "m.mtl"),
    ] {
        std::fs::write(folder.path().join("m.mtl"), format!("newmtl bark\n{material}\n")).unwrap();
        let told = load(folder.path(), "bad.obj", text).unwrap_err().to_string();
        assert!(told.contains("bad.obj") && told.contains("bark") && told.contains(expected), "{told}");
    }
}

#[test]
fn images_and_coordinates_that_lie_are_errors_with_file_and_material() {
    let folder = tempfile::tempdir().unwrap();
    let good = png(&[&[100, 200]]);
    let told = |json: &str, coordinates, png: &[u8]| {
        let told = load(folder.path(), "bad.glb", glb(json, coordinates, png)).unwrap_err().to_string();
        assert!(told.contains("bad.glb"), "{told}");
        told
    };
    for (from, to, expected) in [
        (r#""bufferView":3,"mimeType":"image/png""#, r#""uri":"absent.png""#, "absent.png"),
        (r#""bufferView":3,"mimeType":"image/png""#, r#""uri":"data:image/png;base64,!!""#, "embedded image 0"),
        (r#""bufferView":3,"mimeType":"image/png""#, r#""uri":"%ff.png""#, "address"),
        (r#""bufferView":3,"mimeType":"image/png""#, r#""name":"none""#, "address"),
        (r#""byteOffset":92"#, r#""byteOffset":9200"#, "beyond its buffer"),
        (r#""byteOffset":92"#, r#""byteOffset":18446744073709551615"#, "beyond its buffer"),
        (r#""byteOffset":92"#, r#""byteOffset":0"#, "embedded image 0"),
        (r#","TEXCOORD_0":1"#, "", "TEXCOORD_0"),
        (r#"{"index":0}"#, r#"{"index":0,"texCoord":1}"#, "TEXCOORD_1"),
    ] {
        assert!(JSON.contains(from), "{from}");
        let told = told(&JSON.replace(from, to), WHOLE, &good);
        assert!(told.contains(r#"material "bark""#) && told.contains(expected), "{to}: {told}");
    }
    for (from, to) in [
        (r#"{"index":0}"#, r#"{"index":7}"#),
        (r#""source":0"#, r#""source":7"#),
        (r#""sampler":0"#, r#""sampler":7"#),
        (r#""bufferView":3"#, r#""bufferView":7"#),
        ("33648", "12"),
        (r#""count":4,"type":"VEC2""#, r#""count":3,"type":"VEC2""#),
        (r#""count":4,"type":"VEC2""#, r#""count":4,"type":"VEC3""#),
        (r#""POSITION":0,"TEXCOORD_0":1"#, r#""POSITION":0,"TEXCOORD_0":9"#),
    ] {
        assert!(JSON.contains(from), "{from}");
        told(&JSON.replace(from, to), WHOLE, &good);
    }
    for wrong in [f32::NAN, f32::INFINITY, 1e30] {
        let told = told(JSON, [[wrong, 0.0], [1.0, 1.0]], &good);
        assert!(told.contains(r#"material "bark""#) && told.contains("vertex 0"), "{told}");
    }
    // Without a kind of its own, an image's bytes say what it is.
    let json = JSON.replace(r#","mimeType":"image/png""#, "");
    assert!(load(folder.path(), "plain.glb", glb(&json, WHOLE, &good)).is_ok());
    // A header that claims more pixels than are read.
    let mut huge = good.clone();
    huge[16..24].copy_from_slice(&[0, 1, 0, 0, 0, 1, 0, 0]);
    let told = told(JSON, WHOLE, &huge);
    assert!(told.contains("bark") && told.contains("embedded image 0"), "{told}");
}

#[test]
fn scrambled_files_never_panic_and_show_numbers() {
    let folder = tempfile::tempdir().unwrap();
    let bytes = glb(JSON, WHOLE, &png(&[&[0, 50, 100, 150], &[200, 255, 30, 80]]));
    let mut state = 0x9e37_79b9_7f4a_7c15_u64;
    let mut random = move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        state as usize
    };
    for _ in 0..800 {
        let mut damaged = bytes.clone();
        for _ in 0..1 + random() % 4 {
            let at = random() % damaged.len();
            damaged[at] = random() as u8;
        }
        let Ok(mesh) = load(folder.path(), "damaged.glb", damaged) else { continue };
        let Some(images) = &mesh.images else { continue };
        for (triangle, &corners) in mesh.index.iter().enumerate() {
            let position = corners.map(|corner| mesh.position[corner as usize].as_vec3());
            for span in [0.0, 1e-20, 1.0, 1e30] {
                let spans = [Vec3::X * span, Vec3::Z * span];
                let shown = images.at(triangle as u32, corners, position, [0.4, 0.5], spans);
                assert!(shown.cmpge(Vec3::ZERO).all() && shown.cmple(Vec3::splat(1.0 + 1e-5)).all(), "{shown}");
            }
        }
    }
}
