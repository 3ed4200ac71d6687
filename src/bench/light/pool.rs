//! A pool in memory: waves over a level floor under a high sun, seen from above. What caustics are measured on.

use std::f64::consts::TAU;

use crate::scene::{Ground, Integrator, PixelFilter, Scene, SkyKind, Sun};
use crate::state::{Columns, Frame};

/// Width of a column (m).
const WIDTH: f64 = 0.05;
/// Columns along each side: the floor that is seen lies two depths from the walls, so that no sun comes through them.
const SIDE: usize = 128;
/// Mean depth (m).
const DEPTH: f64 = 1.6;
/// Columns of the rim, which stands above the water.
const RIM: usize = 3;

/// Water whose crests are curved by up to 2.5 /m: as lenses they focus the sun n / (n - 1) / 2.5 = 1.6 m below them.
pub(super) fn frame() -> Frame {
    let (mut base, mut top) = (Vec::with_capacity(SIDE * SIDE), Vec::with_capacity(SIDE * SIDE));
    for k in 0..SIDE * SIDE {
        let (i, j) = (k % SIDE, k / SIDE);
        let (x, z) = (i as f64 * WIDTH, j as f64 * WIDTH);
        let is_rim = [i, j].into_iter().any(|place| !(RIM..SIDE - RIM).contains(&place));
        let wave = |kx: f64, kz: f64, length: f64, phase: f64| (TAU * (kx * x + kz * z) / length + phase).sin();
        let waves = 0.020 * wave(0.8, 0.6, 1.3, 0.0)
            + 0.014 * wave(-0.4, 0.9165, 0.83, 1.0)
            + 0.007 * wave(0.97, -0.243, 0.47, 2.0);
        base.push(if is_rim { DEPTH + 0.3 } else { 0.0 });
        top.push(if is_rim { DEPTH + 0.3 } else { DEPTH + waves });
    }
    let columns = Columns {
        origin: [0.0; 2],
        width: [WIDTH; 2],
        nx: SIDE,
        nz: SIDE,
        pressure: vec![0.0; SIDE * SIDE],
        flow: vec![[0.0; 2]; SIDE * SIDE],
        base,
        top,
    };
    Frame { columns, ..Frame::default() }
}

/// The sun alone, through clear water of this roughness, straight to the floor: light that only caustics bring.
pub(super) fn sun_only(size: u32, roughness: f64) -> Scene {
    let mut scene = view([size, size]);
    scene.sky.kind = SkyKind::Constant;
    scene.sky.radiance = [0.0; 3];
    scene.water.roughness = roughness;
    scene.render.diffuse_depth = 1;
    scene.render.filter = PixelFilter::Box;
    scene
}

/// The pool under sun and sky, as a scene file would have it: paths, one sample a pixel.
pub(super) fn view([width, height]: [u32; 2]) -> Scene {
    let mut scene = Scene::default();
    let middle = 0.5 * (SIDE - 1) as f64 * WIDTH;
    // Nearly from above: the sun's mirror image goes elsewhere.
    scene.camera.eye = Some([middle, DEPTH + 3.5, middle + 1.2]);
    scene.camera.look_at = Some([middle, DEPTH, middle]);
    scene.camera.fov = 16.0;
    scene.sun = Sun { elevation: 60.0, azimuth: 70.0, irradiance: 3.0, color: Some([1.0; 3]) };
    scene.terrain.ground = Ground::Plain;
    scene.terrain.albedo = [0.6; 3];
    scene.render.integrator = Integrator::Path;
    (scene.render.width, scene.render.height, scene.render.samples) = (width, height, 1);
    scene
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::Settings;
    use crate::bench::light::luminance;
    use crate::bench::pictures::Built;
    use crate::scene::Caustics;

    #[test]
    fn the_floor_has_caustics_and_nothing_else() {
        let frame = frame();
        let render = |caustics: Caustics, sun: f64| {
            let mut scene = sun_only(24, 0.0);
            scene.render.caustics = Some(caustics);
            scene.render.samples = 4;
            scene.sun.irradiance = sun;
            let settings = Settings::default();
            luminance(&Built::new(&scene, &frame, &settings).unwrap().render(&frame, &settings).unwrap().0)
        };
        let lit = render(Caustics::Manifold, 3.0);
        let mean = lit.iter().sum::<f64>() / lit.len() as f64;
        let contrast = (lit.iter().map(|v| (v / mean - 1.0).powi(2)).sum::<f64>() / lit.len() as f64).sqrt();
        assert!(mean > 0.05 && contrast > 0.3, "{mean} {contrast}");
        assert!(render(Caustics::Manifold, 0.0).iter().all(|&v| v == 0.0));
    }
}
