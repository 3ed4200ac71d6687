//! Every format's good files, and files that lie.

use std::path::PathBuf;

use super::*;

struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }
    fn write(&self, name: &str, bytes: impl AsRef<[u8]>) -> PathBuf {
        let path = self.0.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        path
    }
    fn load(&self, name: &str, bytes: impl AsRef<[u8]>) -> Result<Mesh, TerrainError> {
        load_mesh(&self.write(name, bytes))
    }
}

const ASCII_PLY: &str = "ply\nformat ascii 1.0\ncomment a square\nelement vertex 4\nproperty double x\nproperty float y\n\
    property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nelement face 1\n\
    property list uchar int vertex_indices\nelement note 1\nproperty int code\nend_header\n\
    500000.125 0 0 255 0 188\n500001 0 0 255 0 188\n500001 1 0 255 0 188\n500000.125 1 0 0 0 188\n4 0 1 2 3\n7\n";

fn binary_ply(big: bool) -> Vec<u8> {
    let order = if big { "big" } else { "little" };
    let mut bytes = format!(
        "ply\nformat binary_{order}_endian 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
         property float nx\nproperty float ny\nproperty float nz\nelement face 1\nproperty list uchar uint vertex_index\nend_header\n"
    )
    .into_bytes();
    let mut put = |word: [u8; 4]| {
        let mut word = word;
        if big {
            word.reverse();
        }
        bytes.extend(word);
    };
    for vertex in [[0.0f32, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 3.0, 0.0]] {
        vertex.into_iter().chain([0.0, 0.0, 4.0]).for_each(|value| put(value.to_le_bytes()));
    }
    bytes.push(3);
    for index in [0u32, 1, 2] {
        let word = if big { index.to_be_bytes() } else { index.to_le_bytes() };
        bytes.extend(word);
    }
    bytes
}

#[test]
fn ply_reads_ascii_and_both_binary_orders() {
    let folder = Folder::new();
    let square = folder.load("square.ply", ASCII_PLY).unwrap();
    assert_eq!(square.index, vec![[0, 1, 2], [0, 2, 3]]);
    assert_eq!(square.position[0], DVec3::new(500_000.125, 0.0, 0.0));
    assert_eq!(square.positions_around(DVec3::new(5e5, 0.0, 0.0))[0], Vec3::new(0.125, 0.0, 0.0));
    let MeshAlbedo::PerVertex(albedo) = &square.albedo else { panic!("{:?}", square.albedo) };
    assert!((albedo[0] - Vec3::new(1.0, 0.0, 0.502_886_5)).length() < 1e-5);
    for big in [false, true] {
        let mesh = folder.load("triangle.ply", binary_ply(big)).unwrap();
        assert_eq!(mesh.position[2], DVec3::new(0.0, 3.0, 0.0));
        assert_eq!(mesh.normal, vec![Vec3::Z; 3]);
        assert_eq!(mesh.albedo, MeshAlbedo::Uniform(DEFAULT_ALBEDO));
    }
    let floats = ASCII_PLY
        .replace("uchar red", "float red")
        .replace(" 255 0 188", " 0.25 0 188")
        .replace(" 0 0 188\n4", " 0.25 0 188\n4");
    let MeshAlbedo::Uniform(albedo) = folder.load("float.ply", floats).unwrap().albedo else { panic!("not uniform") };
    assert_eq!(albedo.x, 0.25);
}

#[test]
fn obj_reads_polygons_normals_and_materials() {
    let folder = Folder::new();
    folder.write("stones.mtl", "newmtl red\nKd 0.5 0.25 0.125\nnewmtl blue\nKd 0.1 0.2 0.3\n");
    let text = "mtllib stones.mtl\no one\nv 4000000.125 0 0\nv 4000001 0 0\nv 4000001 0 -1\nv 4000000 0 -1\nvn 0 2 0\nusemtl red\n\
                f 1//1 2//1 3//1 4//1\no two\nv 0 1 0\nv 1 1 0\nv 0 1 -1\nusemtl blue\nf 5//1 6//1 7//1\n";
    let mesh = folder.load("stones.obj", text).unwrap();
    assert_eq!(mesh.index.len(), 3);
    assert_eq!(mesh.position.len(), 7);
    assert_eq!(mesh.position[0].x, 4_000_000.125);
    assert!(mesh.normal.iter().all(|n| *n == Vec3::Y));
    let MeshAlbedo::PerVertex(albedo) = &mesh.albedo else { panic!("{:?}", mesh.albedo) };
    assert_eq!(albedo[0], Vec3::new(0.5, 0.25, 0.125));
    assert_eq!(albedo[6], Vec3::new(0.1, 0.2, 0.3));
    // Without its materials it is grey, and still a shape.
    let grey = folder.load("grey.OBJ", "mtllib absent.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
    assert_eq!(grey.albedo, MeshAlbedo::Uniform(DEFAULT_ALBEDO));
    assert!(grey.normal.is_empty());
}

/// A binary glTF: one right triangle with 16-bit indices under two nodes, the inner one mirrored in x.
fn glb(edit: impl Fn(String) -> String) -> Vec<u8> {
    let mut data = Vec::new();
    for value in [0.0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0] {
        data.extend(value.to_le_bytes());
    }
    for index in [0u16, 1, 2, 0] {
        data.extend(index.to_le_bytes());
    }
    let json = r#"{"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],
        "nodes":[{"translation":[10,0,0],"children":[1]},{"scale":[-2,1,1],"mesh":0}],
        "materials":[{"pbrMetallicRoughness":{"baseColorFactor":[0.25,0.5,0.75,1]}}],
        "meshes":[{"primitives":[{"attributes":{"POSITION":0,"NORMAL":1},"indices":2,"material":0}]}],
        "accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,1,0]},
          {"bufferView":0,"byteOffset":36,"componentType":5126,"count":3,"type":"VEC3"},
          {"bufferView":1,"componentType":5123,"count":3,"type":"SCALAR"}],
        "bufferViews":[{"buffer":0,"byteLength":72},{"buffer":0,"byteOffset":72,"byteLength":8}],
        "buffers":[{"byteLength":80}]}"#;
    let mut json = edit(json.to_string()).into_bytes();
    while !json.len().is_multiple_of(4) {
        json.push(b' ');
    }
    let mut out = b"glTF".to_vec();
    out.extend(2u32.to_le_bytes());
    out.extend((12 + 8 + json.len() as u32 + 8 + data.len() as u32).to_le_bytes());
    out.extend((json.len() as u32).to_le_bytes());
    out.extend(b"JSON");
    out.extend(json);
    out.extend((data.len() as u32).to_le_bytes());
    out.extend(b"BIN\0");
    out.extend(data);
    out
}

#[test]
fn gltf_applies_transforms_and_keeps_outsides_outside() {
    let folder = Folder::new();
    let mesh = folder.load("part.glb", glb(|json| json)).unwrap();
    assert_eq!(mesh.position, vec![DVec3::new(10.0, 0.0, 0.0), DVec3::new(8.0, 0.0, 0.0), DVec3::new(10.0, 1.0, 0.0)]);
    assert_eq!(mesh.normal, vec![Vec3::Z; 3]);
    // Mirrored, the winding turns so that triangle and normal still agree.
    let [a, b, c] = mesh.index[0].map(|i| mesh.position[i as usize]);
    assert!((b - a).cross(c - a).z > 0.0);
    assert_eq!(mesh.albedo, MeshAlbedo::Uniform(Vec3::new(0.25, 0.5, 0.75)));
    let strip = folder.load("strip.glb", glb(|json| json.replace(r#""material":0"#, r#""mode":5"#))).unwrap();
    assert_eq!(strip.index.len(), 1);
    assert_eq!(strip.albedo, MeshAlbedo::Uniform(DEFAULT_ALBEDO));
}

#[test]
fn gltf_that_lies_is_an_error() {
    let folder = Folder::new();
    for (from, to) in [
        (r#""count":3,"type":"SCALAR""#, r#""count":300,"type":"SCALAR""#),
        (r#""count":3,"type":"SCALAR""#, r#""count":0,"type":"SCALAR""#),
        (r#""count":3,"type":"VEC3","min""#, r#""count":0,"type":"VEC3","min""#),
        (r#""count":3,"type":"VEC3","min""#, r#""count":2147483648,"type":"VEC3","min""#),
        (r#""count":3,"type":"VEC3","min""#, r#""count":18446744073709551615,"type":"VEC3","min""#),
        (
            r#""componentType":5126,"count":3,"type":"VEC3","min""#,
            r#""componentType":5121,"count":3,"type":"VEC3","min""#,
        ),
        (r#""byteOffset":72,"byteLength":8"#, r#""byteOffset":76,"byteLength":8"#),
        (r#""byteOffset":72"#, r#""byteOffset":18446744073709551615"#),
        (r#""byteOffset":36"#, r#""byteOffset":18446744073709551600"#),
        (r#""scale":[-2,1,1]"#, r#""scale":[-2,1,1],"children":[0]"#),
        (r#""scale":[-2,1,1]"#, r#""scale":[1e39,1,1]"#),
        (r#""mesh":0"#, r#""mesh":7"#),
        (r#""baseColorFactor":[0.25"#, r#""baseColorFactor":[25"#),
        (r#""buffers":[{"byteLength":80}]"#, r#""buffers":[{"byteLength":80,"uri":"absent.bin"}]"#),
        (r#""buffers":[{"byteLength":80}]"#, r#""buffers":[{"byteLength":80,"uri":"%ff%fe.bin"}]"#),
        (r#""POSITION":0,"#, ""),
        (r#""POSITION":0,"#, r#""POSITION":9,"#),
    ] {
        let result = folder.load(
            "bad.glb",
            glb(|json| {
                assert!(json.contains(from), "{from}");
                json.replace(from, to)
            }),
        );
        assert!(result.is_err(), "{to}: {result:?}");
        assert!(result.unwrap_err().to_string().contains("bad.glb"));
    }
}

#[test]
fn ply_that_lies_is_an_error() {
    let folder = Folder::new();
    for (from, to) in [
        ("vertex 4", "vertex 2147483648"),
        ("vertex 4", "vertex 18446744073709551615"),
        ("face 1", "face 2147483648"),
        ("vertex 4", "vertex 3"),
        ("vertex 4", "vertex 5"),
        ("4 0 1 2 3", "4 0 1 2 4"),
        ("4 0 1 2 3", "4 0 1 2 -1"),
        ("4 0 1 2 3", "2 0 1"),
        ("4 0 1 2 3", "2000000000 0 1 2 3"),
        ("500001 1 0", "nan 1 0"),
        ("500001 1 0", "inf 1 0"),
        ("property double x\n", ""),
        ("property list uchar int vertex_indices", "property int vertex_indices"),
        ("uchar red", "float red"),
        ("4 0 1 2 3\n7\n", ""),
        ("element face 1", "element face 0"),
    ] {
        assert!(ASCII_PLY.contains(from));
        let result = folder.load("bad.ply", ASCII_PLY.replace(from, to));
        assert!(result.is_err(), "{to}: {result:?}");
        assert!(result.unwrap_err().to_string().contains("bad.ply"), "{to}");
    }
}

#[test]
fn obj_that_lies_is_an_error() {
    let folder = Folder::new();
    for text in [
        "",
        "v 0 0 0\nv 1 0 0\nv 0 1 0\n",
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n",
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 -4\n",
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 99999999999999999999\n",
        "v 0 0 0\nv 1 0 nan\nv 0 1 0\nf 1 2 3\n",
        "v 0 0 0\nv 1 0\nv 0 1 0\nf 1 2 3\n",
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 0\nf 1//1 2//1 3//1\n",
        "\u{0}\u{1}garbage\n",
    ] {
        let result = folder.load("bad.obj", text);
        assert!(result.is_err(), "{text:?}: {result:?}");
        assert!(result.unwrap_err().to_string().contains("bad.obj"));
    }
}

#[test]
fn other_endings_and_absent_files_are_errors() {
    let folder = Folder::new();
    assert!(matches!(folder.load("thing.fbx", "x"), Err(TerrainError::UnknownFormat { .. })));
    for name in ["absent.obj", "absent.ply", "absent.glb", "absent.gltf"] {
        let error = load_mesh(&folder.0.path().join(name)).unwrap_err();
        assert!(error.to_string().contains(name), "{error}");
    }
}

#[test]
fn cut_and_scrambled_files_never_panic() {
    let folder = Folder::new();
    let files = [
        ("a.ply", ASCII_PLY.as_bytes().to_vec()),
        ("b.ply", binary_ply(false)),
        ("c.glb", glb(|json| json)),
        ("d.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nf 1 2 4 3\nf -1 -2 -3\n".to_vec()),
    ];
    // A fixed xorshift: the same damage on every run.
    let mut state = 0x2545_f491_4f6c_dd1du64;
    let mut random = move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        state as usize
    };
    for (name, bytes) in files {
        for length in (0..bytes.len()).step_by(7) {
            // Text may be cut at its last blank or comment and still be whole; nothing may panic.
            let result = folder.load(name, &bytes[..length]);
            assert!(result.is_err() || length + 8 > bytes.len() || name == "d.obj", "{name} {length}");
        }
        for _ in 0..600 {
            let mut damaged = bytes.clone();
            for _ in 0..1 + random() % 4 {
                let at = random() % damaged.len();
                damaged[at] = random() as u8;
            }
            if let Ok(mesh) = folder.load(name, damaged) {
                assert!(mesh.index.iter().flatten().all(|&i| (i as usize) < mesh.position.len()));
            }
        }
    }
}
