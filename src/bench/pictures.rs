//! Made-up scenes in memory and their pictures: what benchmarks of whole pictures render. No files.
//!
//! The scene: a channel that falls along x between banks, water with waves in it, and spray over the water; columns half a
//! metre wide, as the report's small scene has 80x20 of.

use std::sync::atomic::AtomicBool;
use std::time::Instant;

use glam::DVec3;

use super::work::{self, Random};
use super::{BenchError, Settings};
use crate::accel::{self, Accelerator};
use crate::lower::{self, Environment, LoweredFrame, View};
use crate::optics::Sky;
use crate::output::Picture;
use crate::render::{self, Camera, CameraPath, Job, Looks, Moment, RenderStats};
use crate::scene::Scene;
use crate::state::{Columns, Frame, Particles};
use crate::terrain::{Ground, SkyView, Waterline};

/// Width of a column (m).
const WIDTH: f64 = 0.5;

/// Water, bed and spray over `size` columns.
pub fn frame([nx, nz]: [usize; 2], particles: usize) -> Frame {
    let waves = work::heights([nx, nz]);
    let (mut base, mut top) = (Vec::with_capacity(nx * nz), Vec::with_capacity(nx * nz));
    for k in 0..nx * nz {
        let (x, z) = ((k % nx) as f64 * WIDTH, (k / nx) as f64);
        let across = 2.0 * z / (nz - 1) as f64 - 1.0;
        let meander = 0.25 * (x * 0.15).sin();
        let ground = 1.6 * (across - meander).powi(2) - 0.02 * x + 0.02 * waves[k];
        let level = 0.55 - 0.02 * x + 0.04 * waves[k];
        base.push(ground);
        top.push(if level > ground + 0.02 { level } else { ground });
    }
    let wet: Vec<usize> = (0..nx * nz).filter(|&k| top[k] > base[k]).collect();
    let mut random = Random::new(41);
    let mut spray = Particles::default();
    for _ in 0..if wet.is_empty() { 0 } else { particles } {
        let column = wet[(random.unit() * wet.len() as f64) as usize];
        let (i, j) = ((column % nx) as f64, (column / nx) as f64);
        let place = [i + random.within(-0.5, 0.5), j + random.within(-0.5, 0.5)];
        let height = top[column] + 0.05 + 1.5 * random.unit().powi(3);
        spray.position.push([place[0] * WIDTH, height, place[1] * WIDTH]);
        spray.velocity.push([random.within(0.0, 4.0), random.within(-1.0, 3.0), random.within(-1.0, 1.0)]);
        // Drops of 1 to 2.5 cm radius.
        spray.mass.push(0.005 + 0.06 * random.unit().powi(3));
        spray.age.push(random.within(0.0, 1.0));
    }
    let columns = Columns {
        origin: [0.0; 2],
        width: [WIDTH; 2],
        nx,
        nz,
        pressure: vec![0.0; nx * nz],
        flow: vec![[0.0; 2]; nx * nz],
        base,
        top,
    };
    Frame { columns, particles: spray, ..Frame::default() }
}

/// Settings for its picture: from above the near bank along the water, one sample a pixel.
pub fn scene(frame: &Frame, [width, height]: [u32; 2]) -> Scene {
    let columns = &frame.columns;
    let (length, breadth) = (columns.nx as f64 * WIDTH, columns.nz as f64 * WIDTH);
    let mut scene = Scene::default();
    scene.camera.eye = Some([0.95 * length, 1.5 + 0.3 * breadth, 0.95 * breadth]);
    scene.camera.look_at = Some([0.35 * length, -0.02 * length, 0.45 * breadth]);
    (scene.render.width, scene.render.height, scene.render.samples) = (width, height, 1);
    scene
}

/// Everything between a frame and its picture, kept.
pub struct Built {
    scene: Scene,
    /// Parts, water, bed, spray.
    pub lowered: LoweredFrame,
    /// Over these parts.
    pub accel: Box<dyn Accelerator>,
    path: CameraPath,
    /// Seconds that lowering and building took.
    pub seconds: f64,
}

impl Built {
    /// Lowers a frame and builds what the scene names over it.
    ///
    /// # Errors
    /// It cannot be lowered, or Embree is missing.
    pub fn new(scene: &Scene, frame: &Frame, settings: &Settings) -> Result<Self, BenchError> {
        let path = CameraPath::from_scene(&scene.camera, || render::frame_points(&[], &|_, _| None, 1.0, 40.0))?;
        let start = Instant::now();
        let size = (scene.render.width, scene.render.height);
        let camera = Camera::new(path.pose(0.0), size, 0.0);
        let view = View { eye: camera.pose.eye, pixel_angle: camera.pixel_angle() };
        let lowered = lower::lower(scene, frame, &Environment::default(), Some(view), settings.simd)?;
        let accel = accel::build(&lowered.lowered, &scene.accel, settings.simd)?;
        Ok(Self { scene: scene.clone(), lowered, accel, path, seconds: start.elapsed().as_secs_f64() })
    }

    /// The camera.
    pub fn camera(&self) -> Camera {
        Camera::new(self.path.pose(0.0), (self.scene.render.width, self.scene.render.height), 0.0)
    }

    /// Renders the picture; also the seconds that it took.
    ///
    /// # Errors
    /// The sky or the picture cannot be made.
    pub fn render(&self, frame: &Frame, settings: &Settings) -> Result<(Picture, f64), BenchError> {
        let (picture, stats) = self.render_counted(frame, settings)?;
        Ok((picture, stats.seconds))
    }

    /// Renders the picture; also all that it took.
    ///
    /// # Errors
    /// The sky or the picture cannot be made.
    pub fn render_counted(&self, frame: &Frame, settings: &Settings) -> Result<(Picture, RenderStats), BenchError> {
        let origin: DVec3 = self.lowered.lowered.origin;
        let columns = &frame.columns;
        let sky = Sky::build(&self.scene.sky, &self.scene.sun, std::path::Path::new("."))?;
        let ground = Ground::build(&self.scene.terrain, columns.width[0].min(columns.width[1]), origin);
        let waterline = Waterline::build(columns, self.scene.surface.dry_threshold, origin);
        let sky_view = SkyView::build(columns, origin);
        let looks = Looks {
            ground: &ground,
            ground_texture: None,
            waterline: &waterline,
            sky_view: &sky_view,
            spray: &self.lowered.spray,
            water: self.lowered.water.as_deref(),
            bed: self.lowered.bed.as_deref(),
            foam: None,
            mist: self.lowered.mist.as_deref(),
            rainbow: None,
            textures: None,
        };
        let moments = [Moment {
            time: 0.0,
            lowered: &self.lowered.lowered,
            accelerator: &*self.accel,
            matter: &looks,
            water: self.lowered.water.as_deref(),
        }];
        let job = Job {
            scene: &self.scene,
            moments: &moments,
            sky: &sky,
            path: &self.path,
            frame: 0,
            crop: None,
            threads: settings.threads,
            mattes: render::Mattes::default(),
            aside: 0.0,
        };
        Ok(render::render_frame(&job, &AtomicBool::new(false), &())?)
    }
}

/// Root mean square and greatest difference of two pictures' linear light, over red, green and blue.
pub fn difference(picture: &Picture, other: &Picture) -> [f64; 2] {
    let (mut squares, mut greatest, mut count) = (0.0, 0.0f64, 0usize);
    for name in ["R", "G", "B"] {
        let [a, b] = [picture, other].map(|picture| picture.channel(name).map_or(&[][..], |c| &c.samples[..]));
        for (a, b) in a.iter().zip(b) {
            let error = f64::from((a - b).abs());
            squares += error * error;
            greatest = greatest.max(error);
            count += 1;
        }
    }
    [(squares / count.max(1) as f64).sqrt(), greatest]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_made_up_scene_has_water_banks_and_spray_and_is_seen() {
        let frame = frame([40, 20], 300);
        let wet = (0..800).filter(|&k| frame.columns.top[k] > frame.columns.base[k]).count();
        assert!((200..700).contains(&wet), "{wet}");
        assert_eq!(frame.particles.position.len(), 300);
        let settings = Settings::default();
        let scene = scene(&frame, [48, 32]);
        let render = |scene: &Scene| Built::new(scene, &frame, &settings).unwrap().render(&frame, &settings).unwrap().0;
        let picture = render(&scene);
        assert_eq!(difference(&picture, &picture), [0.0; 2]);
        let mut dry = scene.clone();
        dry.water.visible = false;
        let mut clear = scene;
        clear.particles.representation = crate::scene::ParticleRepresentation::None;
        for other in [dry, clear] {
            assert!(difference(&picture, &render(&other))[0] > 1e-3, "nothing of it is in the picture");
        }
    }
}
