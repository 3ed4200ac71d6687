//! Whole pictures of small scenes whose light is known, and the scenes themselves.

mod analytic;
mod cryptomatte;
mod deep;
mod drops;
mod mist;
mod paths;
mod promises;
mod sampling;
mod spray;
mod streaks;
mod textures;

use std::{path::Path, sync::Arc, sync::atomic::AtomicBool};

use glam::{DVec3, Vec3, Vec4};

use super::*;
use crate::{
    accel::{self, Accelerator},
    foam::FoamLook,
    lower::{Lowered, Material, Part, Shape, Spheres, Triangles},
    mist::Mist,
    optics::{Rainbow, Sky},
    output::{DeepPicture, Picture},
    particles::Texel,
    scene::{Accel, ObjectsAccel, Scene, SkyKind, SolverKind, WaterAccel},
    simd::SimdLevel,
    surface::{Lattice, SplineSurface},
};

/// The image on the ground at a place, over two spans across what is seen.
pub(super) type GroundImage = Box<dyn Fn(Vec3, [Vec3; 2]) -> Vec4 + Sync>;

/// One albedo, one particle look, level water over a level bed.
pub(super) struct Flat {
    pub(super) water: Option<f32>,
    pub(super) bed: Option<f32>,
    pub(super) albedo: Vec3,
    pub(super) spray: SprayLook,
    pub(super) foam: Option<FoamLook>,
    pub(super) mist: Option<Mist>,
    /// Radius of every drop.
    pub(super) drop_radius: Option<f32>,
    pub(super) rainbow: Option<Rainbow>,
    pub(super) texture: Option<fn([f32; 2]) -> Texel>,
    pub(super) ground_image: Option<GroundImage>,
}

impl Default for Flat {
    fn default() -> Self {
        let spray =
            SprayLook { albedo: Vec3::splat(0.8), opacity: 0.7, share: 1.0, velocity: Vec3::new(3.0, 1.0, 0.5) };
        Self {
            water: None,
            bed: None,
            albedo: Vec3::splat(0.5),
            spray,
            foam: None,
            mist: None,
            drop_radius: None,
            rainbow: None,
            texture: None,
            ground_image: None,
        }
    }
}

impl Matter for Flat {
    fn ground(&self, _position: Vec3, normal: Vec3, _depth: f32, _footprint: f32) -> GroundLook {
        GroundLook { albedo: self.albedo, normal, sky_view: 1.0 }
    }
    fn spray(&self, _index: u32) -> SprayLook {
        self.spray
    }
    fn water_level(&self, _x: f32, _z: f32) -> Option<f32> {
        self.water
    }
    fn bed_level(&self, _x: f32, _z: f32) -> Option<f32> {
        self.bed
    }
    fn foam(&self, _position: Vec3, _footprint: f32) -> Option<FoamLook> {
        self.foam
    }
    fn has_foam(&self) -> bool {
        self.foam.is_some()
    }
    fn mist(&self) -> Option<&Mist> {
        self.mist.as_ref()
    }
    fn drop_radius(&self, _index: u32) -> Option<f32> {
        self.drop_radius
    }
    fn rainbow(&self) -> Option<&Rainbow> {
        self.rainbow.as_ref()
    }
    fn texture(&self, _index: u32, place: [f32; 2], _footprint: f32) -> Option<Texel> {
        self.texture.map(|texture| texture(place))
    }
    fn ground_image(&self, position: Vec3, spans: [Vec3; 2]) -> Option<Vec4> {
        self.ground_image.as_ref().map(|image| image(position, spans))
    }
    fn has_ground_image(&self) -> bool {
        self.ground_image.is_some()
    }
}

/// A scene with a uniform sky of radiance `sky` and no sun.
pub(super) fn uniform(sky: f64, size: u32) -> Scene {
    let mut scene = Scene::default();
    scene.sky.kind = SkyKind::Constant;
    scene.sky.radiance = [sky; 3];
    scene.sun.irradiance = 0.0;
    scene.render.width = size;
    scene.render.height = size;
    scene.render.samples = 4;
    scene.render.depth = 16;
    scene.accel = Accel { water: WaterAccel::Brute, objects: ObjectsAccel::Brute, ..Accel::default() };
    scene
}

/// A spline surface of order 3 over `count` x `count` columns of `width` around the origin.
pub(super) fn waves(count: usize, width: f64, height: impl Fn(f64, f64) -> f64) -> Arc<SplineSurface> {
    let corner = -0.5 * width * (count - 1) as f64;
    let at = |index: usize| corner + width * index as f64;
    let heights: Vec<f64> = (0..count * count).map(|i| height(at(i % count), at(i / count))).collect();
    let lattice = Lattice::new(3, [count; 2], [corner; 2], [width; 2], &heights, |_| true).unwrap();
    Arc::new(SplineSurface::new(lattice, SolverKind::Univariate, SimdLevel::detect()))
}

pub(super) fn part(name: &str, material: Material, shape: Shape) -> Part {
    Part { name: name.into(), material, shape }
}

/// The six faces of a box, normals outward.
pub(super) fn cuboid(low: Vec3, high: Vec3) -> Triangles {
    let corner = |index: usize| {
        let pick = |axis: usize| if index >> axis & 1 == 0 { low[axis] } else { high[axis] };
        Vec3::new(pick(0), pick(1), pick(2))
    };
    let quads = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    let index = quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    Triangles { position: (0..8).map(corner).collect(), normal: Vec::new(), index }
}

/// A level square of half side `half` at height `y`, facing up.
pub(super) fn level(y: f32, half: f32) -> Triangles {
    let position = [(-1.0, -1.0), (-1.0, 1.0), (1.0, 1.0), (1.0, -1.0)].map(|(x, z)| Vec3::new(x * half, y, z * half));
    Triangles { position: position.to_vec(), normal: Vec::new(), index: vec![[0, 1, 2], [0, 2, 3]] }
}

pub(super) fn ball(center: Vec3, radius: f32) -> Shape {
    Shape::Spheres(Arc::new(Spheres { center: vec![center], radius: vec![radius] }))
}

pub(super) fn mesh(triangles: Triangles) -> Shape {
    Shape::Triangles(Arc::new(triangles))
}

/// Everything of one picture.
pub(super) struct Setup {
    pub(super) scene: Scene,
    pub(super) lowered: Lowered,
    /// What is there at later moments of the shutter.
    pub(super) later: Vec<Lowered>,
    pub(super) water: Option<Arc<SplineSurface>>,
    pub(super) matter: Flat,
    pub(super) eye: [f64; 3],
    pub(super) look_at: [f64; 3],
    pub(super) crop: Option<crate::output::Window>,
    pub(super) threads: usize,
    pub(super) mattes: Mattes,
}

impl Setup {
    pub(super) fn new(scene: Scene, parts: Vec<Part>, eye: [f64; 3], look_at: [f64; 3]) -> Self {
        let lowered = Lowered { origin: DVec3::ZERO, parts };
        Self {
            scene,
            lowered,
            later: Vec::new(),
            water: None,
            matter: Flat::default(),
            eye,
            look_at,
            crop: None,
            threads: 1,
            mattes: Mattes::default(),
        }
    }

    pub(super) fn path(&self) -> CameraPath {
        let camera = &self.scene.camera;
        let up = DVec3::from(camera.up);
        let pose = Pose::looking(self.eye.into(), self.look_at.into(), up, camera.fov, camera.focus).unwrap();
        CameraPath::fixed(pose, up)
    }

    pub(super) fn accelerator(&self, lowered: &Lowered) -> Box<dyn Accelerator> {
        accel::build(lowered, &self.scene.accel, SimdLevel::detect()).unwrap()
    }

    pub(super) fn render(&self) -> (Picture, RenderStats) {
        self.render_until(&AtomicBool::new(false), &())
    }

    pub(super) fn render_until(&self, stop: &AtomicBool, observer: &dyn Observer) -> (Picture, RenderStats) {
        self.with_job(|job| render_frame(job, stop, observer).unwrap())
    }

    /// The picture and the deep one that belongs to it.
    pub(super) fn render_deep(&self) -> (Picture, DeepPicture) {
        self.with_job(|job| {
            let stop = AtomicBool::new(false);
            let flat = render_frame(job, &stop, &()).unwrap().0;
            let deep = super::render_deep(job, &flat, &stop, &()).unwrap();
            (flat, deep)
        })
    }

    fn with_job<T>(&self, run: impl FnOnce(&Job) -> T) -> T {
        let sky = Sky::build(&self.scene.sky, &self.scene.sun, Path::new(".")).unwrap();
        let path = self.path();
        let all: Vec<&Lowered> = std::iter::once(&self.lowered).chain(&self.later).collect();
        let accelerators: Vec<_> = all.iter().map(|lowered| self.accelerator(lowered)).collect();
        let moments: Vec<Moment> = all
            .iter()
            .zip(&accelerators)
            .enumerate()
            .map(|(index, (lowered, accelerator))| Moment {
                time: index as f64 * 0.1,
                lowered,
                accelerator: &**accelerator,
                matter: &self.matter,
                water: self.water.as_deref(),
            })
            .collect();
        let job = Job {
            scene: &self.scene,
            moments: &moments,
            sky: &sky,
            path: &path,
            frame: 7,
            crop: self.crop,
            threads: self.threads,
            mattes: self.mattes,
            aside: 0.0,
        };
        run(&job)
    }
}

/// The mean of a channel.
pub(super) fn mean(picture: &Picture, name: &str) -> f64 {
    let values = samples(picture, name);
    values.iter().map(|&value| f64::from(value)).sum::<f64>() / values.len() as f64
}

pub(super) fn samples<'a>(picture: &'a Picture, name: &str) -> &'a [f32] {
    &picture.channels.iter().find(|channel| channel.name == name).unwrap_or_else(|| panic!("no channel {name}")).samples
}
