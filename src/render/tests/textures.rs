//! Images on the ground and in the sky, seen over the width of a pixel: detail finer than that is its mean, not its alias.

use super::*;
use crate::{
    scene::{Integrator, PixelFilter, Terrain},
    state::Columns,
    terrain::GroundTexture,
};

/// Black and white squares of `cell` pixels.
fn checker(path: &Path, [width, height]: [u32; 2], cell: u32) {
    let image = image::GrayImage::from_fn(width, height, |x, y| image::Luma([255 * ((x / cell + y / cell) % 2) as u8]));
    image.save(path).unwrap();
}

/// Mean and standard deviation.
fn spread(values: &[f32]) -> [f64; 2] {
    let count = values.len() as f64;
    let mean = values.iter().map(|&value| f64::from(value)).sum::<f64>() / count;
    let square = values.iter().map(|&value| (f64::from(value) - mean).powi(2)).sum::<f64>() / count;
    [mean, square.sqrt()]
}

#[test]
fn a_checker_at_a_grazing_angle_is_its_mean_far_away_and_itself_near_by() {
    let folder = tempfile::tempdir().unwrap();
    checker(&folder.path().join("checker.png"), [64, 64], 8);
    let terrain = Terrain {
        texture: Some("checker.png".into()),
        texture_extent: Some([0.0, 0.0, 1.0, 1.0]),
        ..Terrain::default()
    };
    let texture = GroundTexture::load(&terrain, folder.path(), &Default::default()).unwrap().unwrap();
    let placed = texture.placed(&Columns::default(), DVec3::ZERO);
    let picture = |filtered: bool, look_at: [f64; 3]| {
        let mut scene = uniform(1.0, 48);
        (scene.render.samples, scene.render.filter, scene.render.filter_width) = (1, PixelFilter::Box, 1.0);
        scene.camera.fov = 2.0;
        let ground = part("terrain", Material::Ground, mesh(level(0.0, 1000.0)));
        let mut setup = Setup::new(scene, vec![ground], [0.3, 1.5, 0.2], look_at);
        let placed = placed.clone();
        setup.matter.ground_image = Some(Box::new(move |position: Vec3, spans: [Vec3; 2]| {
            placed.at(position, if filtered { spans } else { [Vec3::ZERO; 2] })
        }));
        samples(&setup.render().0, "R").to_vec()
    };
    // 40 m away a pixel is 3 cm wide and 0.8 m deep, of squares of 12.5 cm.
    let far = [3.0, 0.0, -40.0];
    let [mean, deviation] = spread(&picture(true, far));
    assert!((mean - 0.5).abs() < 0.01 && deviation < 0.06, "{mean} {deviation}");
    let [mean, deviation] = spread(&picture(false, far));
    assert!((mean - 0.5).abs() < 0.1 && deviation > 0.4, "{mean} {deviation}");
    // Straight down, a pixel is a millimetre wide: nothing is lost.
    let near = [0.3, 0.0, 0.2001];
    let (filtered, plain) = (picture(true, near), picture(false, near));
    assert!(filtered.iter().zip(&plain).all(|(a, b)| (a - b).abs() < 1e-3));
}

#[test]
fn a_mesh_shows_its_image_as_the_ground_does() {
    let folder = tempfile::tempdir().unwrap();
    checker(&folder.path().join("checker.png"), [64, 64], 8);
    // An image to a metre, as u = x and v = z; upwards in an OBJ.
    let text = "mtllib m.mtl\nv -99 0 -99\nv 99 0 -99\nv 99 0 99\nv -99 0 99\nvt -99 100\nvt 99 100\nvt 99 -98\n\
                vt -99 -98\nusemtl m\nf 1/1 4/4 3/3 2/2\n";
    std::fs::write(folder.path().join("plate.obj"), text).unwrap();
    std::fs::write(folder.path().join("m.mtl"), "newmtl m\nKd 0.5 1 1\nmap_Kd checker.png\n").unwrap();
    let plate = crate::terrain::load_mesh(&folder.path().join("plate.obj")).unwrap();
    let shape = Triangles {
        position: plate.positions_around(DVec3::ZERO),
        normal: plate.normal.clone(),
        index: plate.index.clone(),
    };
    let images = Material::Images { albedo: Arc::new(plate.albedo.clone()), images: plate.images.clone().unwrap() };
    let terrain = Terrain {
        texture: Some("checker.png".into()),
        texture_extent: Some([0.0, 0.0, 1.0, 1.0]),
        ..Terrain::default()
    };
    let texture = GroundTexture::load(&terrain, folder.path(), &Default::default()).unwrap().unwrap();
    let placed = texture.placed(&Columns::default(), DVec3::ZERO);
    for integrator in [Integrator::Whitted, Integrator::Path] {
        let picture = |material: &Material, look_at: [f64; 3], fov: f64| {
            let mut scene = uniform(1.0, 48);
            (scene.render.samples, scene.render.filter, scene.render.filter_width) = (1, PixelFilter::Box, 1.0);
            (scene.camera.fov, scene.render.integrator) = (fov, integrator);
            let parts = vec![part("plate", material.clone(), Shape::Triangles(Arc::new(shape.clone())))];
            let mut setup = Setup::new(scene, parts, [0.3, 1.5, 0.2], look_at);
            let placed = placed.clone();
            setup.matter.ground_image =
                Some(Box::new(move |position: Vec3, spans: [Vec3; 2]| placed.at(position, spans)));
            setup.render().0
        };
        // Far off at a grazing angle, where a lookup of the finest level would be noise, and near by.
        for (look_at, fov, flat) in [([3.0, 0.0, -40.0], 2.0, true), ([0.3, 0.0, 0.2001], 30.0, false)] {
            let [mesh, ground] = [&images, &Material::Ground].map(|material| picture(material, look_at, fov));
            for (a, b) in samples(&mesh, "albedo.G").iter().zip(samples(&ground, "albedo.G")) {
                assert!((a - b).abs() < 0.02, "{integrator:?} {look_at:?}: {a} {b}");
            }
            for (red, green) in samples(&mesh, "albedo.R").iter().zip(samples(&mesh, "albedo.G")) {
                assert!((red - 0.5 * green).abs() < 1e-3);
            }
            let [mean, deviation] = spread(samples(&mesh, "albedo.G"));
            assert!((mean - 0.5).abs() < 0.2 && (deviation < 0.06) == flat, "{integrator:?}: {mean} {deviation}");
            assert!(spread(samples(&mesh, "G"))[0] > 0.3);
        }
    }
}

#[test]
fn an_image_covers_the_ground_by_its_alpha() {
    for (alpha, seen) in [(1.0, 0.2), (0.5, 0.2 + 0.5 * 0.5), (0.0, 0.2 + 0.5)] {
        let ground = part("terrain", Material::Ground, mesh(level(0.0, 100.0)));
        let mut setup = Setup::new(uniform(1.0, 8), vec![ground], [0.0, 5.0, 0.0], [0.1, 0.0, 0.0]);
        setup.matter.ground_image = Some(Box::new(move |_, _| Vec3::splat(0.2).extend(alpha)));
        assert!((mean(&setup.render().0, "R") - seen).abs() < 1e-3, "{alpha}");
    }
}

/// A picture of water under a sky: one sample a pixel, so that nothing but the lookup can average.
fn water_under(sky: &Path, integrator: Integrator, wavy: bool, eye: [f64; 3], look_at: [f64; 3]) -> Picture {
    let mut scene = uniform(0.5, 40);
    if sky.file_name().is_some() {
        scene.sky.kind = SkyKind::Latlong;
        scene.sky.image = Some(sky.to_str().unwrap().to_owned());
    }
    (scene.render.samples, scene.render.integrator) = (1, integrator);
    scene.water.roughness = 0.0;
    scene.camera.fov = 60.0;
    let water = waves(33, 0.25, |x, z| if wavy { 0.05 * (2.0 * x).sin() * (1.5 * z).cos() } else { 0.0 });
    let parts = vec![part("water", Material::Water, Shape::Surface(water))];
    Setup::new(scene, parts, eye, look_at).render().0
}

#[test]
fn a_sky_finer_than_pixels_and_its_mirror_image_are_as_bright_and_as_smooth_as_its_mean() {
    let folder = tempfile::tempdir().unwrap();
    let sky = folder.path().join("sky.png");
    checker(&sky, [2048, 1024], 1);
    for integrator in [Integrator::Whitted, Integrator::Path] {
        for (wavy, eye, look_at) in [
            (false, [0.0, 2.0, 3.0], [0.0, 0.0, 0.0]),
            (true, [0.0, 2.0, 3.0], [0.0, 0.0, 0.0]),
            (false, [0.0, 2.0, 3.0], [0.0, 3.5, 0.0]),
        ] {
            let seen = |sky: &Path| water_under(sky, integrator, wavy, eye, look_at);
            let (detailed, even) = (seen(&sky), seen(Path::new("")));
            for layer in ["reflection.R", "sky.R"] {
                let [a, b] = [&detailed, &even].map(|picture| samples(picture, layer));
                let scale = b.iter().fold(0.0_f32, |greatest, &value| greatest.max(value));
                if scale > 0.0 {
                    let difference: Vec<f32> = a.iter().zip(b).map(|(a, b)| (a - b) / scale).collect();
                    let [mean, deviation] = spread(&difference);
                    // A lookup of the finest level alone would deviate by a third.
                    assert!(mean.abs() < 2e-3 && deviation < 0.01, "{integrator:?} {wavy} {layer}: {mean} {deviation}");
                }
            }
        }
    }
}

#[test]
fn curved_water_and_ripples_mirror_a_wider_part_of_the_sky() {
    let folder = tempfile::tempdir().unwrap();
    let sky = folder.path().join("sky.png");
    // Squares of 1.4 degrees; a pixel is a quarter of that.
    checker(&sky, [512, 256], 2);
    let mirrored = |image: bool, curved: bool, roughness: f64| {
        let mut scene = uniform(1.0, 40);
        if image {
            (scene.sky.kind, scene.sky.image) = (SkyKind::Latlong, Some(sky.to_str().unwrap().to_owned()));
        }
        (scene.render.samples, scene.water.roughness, scene.camera.fov) = (1, roughness, 14.0);
        let water = waves(33, 0.25, |x, z| if curved { 0.2 * (x * x + z * z) } else { 0.0 });
        let parts = vec![part("water", Material::Water, Shape::Surface(water))];
        let setup = Setup::new(scene, parts, [0.0, 9.0, 9.0], [0.0, 0.0, 0.0]);
        samples(&setup.render().0, "reflection.R").to_vec()
    };
    let deviation = |curved: bool, roughness: f64| {
        // What the water mirrors, without how much of it.
        let [image, even] = [true, false].map(|image| mirrored(image, curved, roughness));
        let shares: Vec<f32> = image.iter().zip(&even).filter(|(_, b)| **b > 0.0).map(|(a, b)| a / b).collect();
        let [mean, deviation] = spread(&shares);
        assert!((mean - 0.5).abs() < 0.05, "{curved} {roughness}: {mean}");
        deviation
    };
    let flat = deviation(false, 0.0);
    let (curved, rippled) = (deviation(true, 0.0), deviation(false, 0.05));
    assert!(flat > 0.2 && curved < 0.35 * flat && rippled < 0.35 * flat, "{flat} {curved} {rippled}");
}

#[test]
fn no_image_costs_no_bits() {
    // What an image of nothing changes is nothing.
    let ground = || part("terrain", Material::Ground, mesh(level(0.0, 100.0)));
    let setup = |image: bool| {
        let mut setup = Setup::new(uniform(1.0, 8), vec![ground()], [0.0, 5.0, 0.0], [0.1, 0.0, 0.0]);
        if image {
            setup.matter.ground_image = Some(Box::new(|_, _| Vec4::ZERO));
        }
        setup.render().0
    };
    assert_eq!(setup(true).channels, setup(false).channels);
}
