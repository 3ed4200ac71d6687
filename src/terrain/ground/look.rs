//! Swatches of ground, to be looked at: `cargo test --lib terrain::ground::look -- --ignored` writes `target/look/`.

use super::*;

fn to_display(radiance: Vec3) -> image::Rgb<u8> {
    image::Rgb(radiance.to_array().map(|x| {
        let x = x.clamp(0.0, 1.0);
        let s = if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 };
        (s * 255.0 + 0.5) as u8
    }))
}

/// A bank that rises from under water on the left to a hill on the right, with boulders, lit from the north-west.
fn swatch(width: f64, metres: f32, size: u32) -> image::RgbImage {
    let ground = Ground::build(&scene::Terrain::default(), width, DVec3::new(1000.0, 0.0, 500.0));
    let detail = 20.0 * width as f32;
    let relief = Field::new(0.5 * f64::from(detail), DVec3::ZERO, 77);
    let band = 0.06 * detail.powf(0.6);
    let pixel = metres / size as f32;
    let height = |x: f32, z: f32| {
        let across = x / metres;
        let p = Vec3::new(x, 0.0, z);
        let hills = relief.value(p, 0.0, 0, 4, 0.5);
        let bank = band * (-3.0 + 14.0 * across);
        let boulder = (relief.value(p * 1.9 + Vec3::splat(9.0), 0.0, 0, 2, 0.5) - 0.28).max(0.0);
        bank + 2.5 * band * hills + boulder.sqrt() * 0.16 * detail
    };
    let sun = Vec3::new(-0.5, 0.65, -0.55).normalize();
    image::RgbImage::from_fn(size, size, |px, py| {
        let (x, z) = (px as f32 * pixel, py as f32 * pixel);
        let y = height(x, z);
        let e = pixel;
        let normal =
            Vec3::new(height(x - e, z) - height(x + e, z), 2.0 * e, height(x, z - e) - height(x, z + e)).normalize();
        let point =
            GroundPoint { position: Vec3::new(x, y, z), normal, height_above_water: y, water_depth: (-y).max(0.0) };
        let (albedo, bumped) = ground.look(&point, pixel);
        let light = 0.42 * Vec3::new(0.8, 0.95, 1.15) * (0.5 + 0.5 * bumped.y)
            + 1.1 * bumped.dot(sun).max(0.0) * Vec3::new(1.1, 1.0, 0.85);
        to_display(1.6 * albedo * light)
    })
}

#[test]
#[ignore = "writes pictures for a person to look at"]
fn swatches() {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("target/look");
    std::fs::create_dir_all(&folder).unwrap();
    for (name, width, metres) in
        [("brook_near", 0.25, 4.0), ("brook", 0.25, 20.0), ("river_far", 0.25, 100.0), ("county", 90.0, 12_000.0)]
    {
        let start = std::time::Instant::now();
        swatch(width, metres, 700).save(folder.join(format!("ground_{name}.png"))).unwrap();
        println!("{name}: {:.0} ns per pixel with its relief", start.elapsed().as_secs_f64() * 1e9 / 490_000.0);
    }
}
