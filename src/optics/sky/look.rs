//! Pictures of the sky, to be looked at: `cargo test --lib optics::sky::look -- --ignored` writes `target/look/`.

use super::*;

/// A filmic curve (Hable's shape by Narkowicz's fit) and sRGB, only so that a person can judge.
pub(crate) fn to_display(radiance: Vec3) -> image::Rgb<u8> {
    let value = radiance.map(|x| {
        let x = x * 0.7;
        let filmic = (x * (2.51 * x + 0.03)) / (x * (2.43 * x + 0.59) + 0.14);
        let filmic = filmic.clamp(0.0, 1.0);
        if filmic <= 0.003_130_8 { 12.92 * filmic } else { 1.055 * filmic.powf(1.0 / 2.4) - 0.055 }
    });
    image::Rgb(value.to_array().map(|x| (x * 255.0 + 0.5) as u8))
}

#[test]
#[ignore = "writes pictures for a person to look at"]
fn skies_by_elevation() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("target/look");
    std::fs::create_dir_all(&folder).unwrap();
    let elevations = [60.0, 35.0, 12.0, 4.0, 0.5, -4.0, -10.0];
    let size = 220u32;
    let mut sheet = image::RgbImage::new(size * 4, size * elevations.len() as u32);
    for (index, elevation) in elevations.into_iter().enumerate() {
        let sun = scene::Sun { elevation, azimuth: 90.0, ..Default::default() };
        let sky = Sky::build(&scene::Sky::default(), &sun, Path::new("")).unwrap();
        println!(
            "{elevation}: up {} zenith {} horizon {} away {} sun {}",
            sky.average_up(),
            sky.radiance(Vec3::Y),
            sky.radiance(super::super::sun::direction(0.5, 90.0)),
            sky.radiance(super::super::sun::direction(0.5, 270.0)),
            Sun::build(&sun, &scene::Sky::default()).irradiance
        );
        for y in 0..size {
            for x in 0..size * 4 {
                let radiance = if x < size {
                    let (px, py) =
                        ((x as f32 + 0.5) / size as f32 * 2.0 - 1.0, (y as f32 + 0.5) / size as f32 * 2.0 - 1.0);
                    let r = (px * px + py * py).sqrt();
                    if r > 1.0 {
                        Vec3::ZERO
                    } else {
                        let (height, side) = ((1.0 - r) * std::f32::consts::FRAC_PI_2).sin_cos();
                        let flat = side / r.max(1e-6);
                        sky.radiance(Vec3::new(px * flat, height, py * flat))
                    }
                } else {
                    // From 20 degrees north of the sun, over south, 180 degrees wide; 45 degrees high, a fifth below.
                    let azimuth = 70.0 + 180.0 * f64::from(x - size) / f64::from(size * 3);
                    let elevation = 36.0 - 45.0 * f64::from(y) / f64::from(size);
                    sky.radiance(super::super::sun::direction(elevation, azimuth))
                };
                sheet.put_pixel(x, index as u32 * size + y, to_display(radiance));
            }
        }
    }
    sheet.save(folder.join("skies.png")).unwrap();
}
