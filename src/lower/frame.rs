//! One frame of a scene → parts: the scene origin is chosen, everything is moved around it, and what the scene does not
//! have is not built.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::DVec3;

use super::{Lowered, Material, Part, Shape, Spheres, Thinning, Triangles, spray};
use crate::mist::{Mist, MistError, VolumeError};
use crate::particles::{self, Spray};
use crate::scene::{Representation, Scene};
use crate::simd::SimdLevel;
use crate::state::{Columns, Frame, Model};
use crate::surface::displaced::DisplacedError;
use crate::surface::tessellate::{self, MeshError, SurfaceMesh};
use crate::surface::{LatticeError, Sides, SplineSurface, control, quads};
use crate::terrain::{self, Mesh, MeshAlbedo, TerrainError};

/// The name of the ground's walls at the domain's edge: there for pictures, asked for by name in `trace`.
pub const TERRAIN_SIDES: &str = "terrain_sides";

/// Why a frame cannot be lowered.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LowerError {
    /// The water or the bed cannot be a spline.
    #[error(transparent)]
    Lattice(#[from] LatticeError),
    /// The solver takes no displaced points.
    #[error(transparent)]
    Displaced(#[from] DisplacedError),
    /// The tessellated water is too large.
    #[error("surface.samples: {0}")]
    Mesh(#[from] MeshError),
    /// Particles cannot be joined.
    #[error(transparent)]
    Sheet(#[from] particles::SheetError),
    /// A mesh, panel or sphere.
    #[error(transparent)]
    Terrain(#[from] TerrainError),
    /// The mist takes too much memory, or no light gets into it.
    #[error(transparent)]
    Mist(#[from] MistError),
    /// A file's mist.
    #[error(transparent)]
    Volume(#[from] VolumeError),
    /// What cannot be thinned does not fit.
    #[error(
        "--memory: water, terrain, picture and what cannot be thinned of the spray take at least {} MB; expected at most \
         {} MB",
        needed.div_ceil(1_000_000),
        budget / 1_000_000
    )]
    Memory {
        /// Bytes that may be taken.
        budget: u64,
        /// Bytes that are needed at least.
        needed: u64,
    },
    /// Something lies too far from the scene origin for single precision.
    #[error("{name} reaches {distance:e} m from the middle of the columns; expected less than 1e15 m")]
    TooFar {
        /// The part.
        name: String,
        /// How far (m).
        distance: f64,
    },
}

/// What does not move, read once for all frames.
#[derive(Clone, Debug, Default)]
pub struct Environment {
    /// Named meshes in the files' frame: `panel_0` …, mesh files by their stem.
    pub meshes: Vec<(String, Mesh)>,
    /// Spheres.
    pub spheres: Vec<crate::state::Sphere>,
}

impl Environment {
    /// Reads the model's meshes (relative to `model_directory`) and the scene's own.
    ///
    /// # Errors
    /// A mesh that cannot be read, a panel without area.
    pub fn load(model: &Model, model_directory: &Path, meshes: &[PathBuf]) -> Result<Self, LowerError> {
        let mut environment = Self { meshes: Vec::new(), spheres: model.spheres.clone() };
        for (index, panel) in model.panels.iter().enumerate() {
            environment.meshes.push((format!("panel_{index}"), terrain::panel(panel)?));
        }
        let files = model.meshes.iter().map(|path| model_directory.join(path)).chain(meshes.iter().cloned());
        for path in files {
            let stem = path.file_stem().map_or_else(|| "mesh".to_owned(), |stem| stem.to_string_lossy().into_owned());
            let taken = |name: &str| environment.meshes.iter().any(|(other, _)| other == name);
            // Two files of one stem keep apart by a number.
            let name = (1..)
                .map(|n| if n == 1 { stem.clone() } else { format!("{stem}_{n}") })
                .find(|name| !taken(name))
                .unwrap_or(stem.clone());
            environment.meshes.push((name, terrain::load_mesh(&path)?));
        }
        Ok(environment)
    }
}

/// From where the frame is seen, for what depends on it: billboards and the screen error of a tessellation.
#[derive(Clone, Copy, Debug)]
pub struct View {
    /// The eye in the files' frame (m).
    pub eye: DVec3,
    /// Width of a pixel (radians).
    pub pixel_angle: f64,
}

/// A lowered frame and what was made on the way, for shading and statistics.
#[derive(Clone, Debug)]
pub struct LoweredFrame {
    /// The parts.
    pub lowered: Lowered,
    /// The water as a spline, whatever it is drawn as; `None` if all is dry or water is not visible. Its control points
    /// are never displaced: who asks for a height (wet banks, depth, an eye under water) is answered by this one, which
    /// is right to within the displacement; so do the walls, whose upper ends stay in place.
    pub water: Option<Arc<SplineSurface>>,
    /// The bed as a spline; `None` if terrain is not visible.
    pub bed: Option<Arc<SplineSurface>>,
    /// The spray that is drawn.
    pub spray: Arc<Spray>,
    /// The medium in the air: spray, and what a file holds; `None` unless the scene asks for it.
    pub mist: Option<Arc<Mist>>,
    /// How many particles are drawn for how many.
    pub thinning: Thinning,
}

impl LoweredFrame {
    /// Particles that are not drawn since they have no size, or no place or mass that single precision knows.
    pub fn particles_left_out(&self) -> u64 {
        let mist = self.mist.as_ref().map_or(0, |mist| mist.without_mass + mist.out_of_range);
        self.spray.without_size + self.spray.out_of_range + mist
    }
}

/// The scene origin for a map of columns: its middle, on a grid of powers of two near the column width, so that
/// coordinates which are short in binary stay short.
pub fn scene_origin(columns: &Columns) -> DVec3 {
    let narrow = columns.width[0].min(columns.width[1]);
    let grain = narrow.log2().floor().exp2();
    let snap = |value: f64| {
        let snapped = (value / grain).round() * grain;
        if snapped.is_finite() { snapped } else { value }
    };
    let middle = |axis: usize, count: usize| columns.origin[axis] + columns.width[axis] * (count - 1) as f64 * 0.5;
    let (low, high) = columns
        .base
        .iter()
        .chain(&columns.top)
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), &height| (low.min(height), high.max(height)));
    let level = if low <= high { low + (high - low) * 0.5 } else { 0.0 };
    DVec3::new(snap(middle(0, columns.nx)), snap(level), snap(middle(1, columns.nz)))
}

/// Lowers a frame around its own [`scene_origin`].
///
/// # Errors
/// See [`LowerError`].
pub fn lower(
    scene: &Scene,
    frame: &Frame,
    environment: &Environment,
    view: Option<View>,
    simd: SimdLevel,
) -> Result<LoweredFrame, LowerError> {
    lower_within(None, scene_origin(&frame.columns), scene, frame, environment, view, simd)
}

/// As [`lower`], around an origin in the files' frame (m), since moments of one picture share the first one's; and with spray thinned
/// until all of them are estimated to take no more than `budget` bytes, if there is one.
///
/// # Errors
/// See [`LowerError`].
pub fn lower_within(
    budget: Option<u64>,
    origin: DVec3,
    scene: &Scene,
    frame: &Frame,
    environment: &Environment,
    view: Option<View>,
    simd: SimdLevel,
) -> Result<LoweredFrame, LowerError> {
    let columns = &frame.columns;
    let settings = &scene.surface;
    let spline = |lattice| Arc::new(SplineSurface::new(lattice, settings.solver, simd));
    let water =
        if scene.water.visible { control::water(columns, settings, origin.to_array())?.map(spline) } else { None };
    let bed =
        if scene.terrain.visible { Some(spline(control::bed(columns, settings, origin.to_array())?)) } else { None };
    let mut parts = Vec::new();
    let mut add = |name: &str, material: Material, shape: Shape| {
        parts.push(Part { name: name.to_owned(), material, shape });
    };
    if let Some(water) = &water {
        let local_eye = view.map(|view| (view.eye - origin, view.pixel_angle));
        match settings.representation {
            Representation::Spline if settings.displacement.is_none() => {
                add("water", Material::Water, Shape::Surface(Arc::clone(water)));
            }
            Representation::Spline => {
                let displaced = control::displaced_water(water, columns, settings, origin.to_array())?;
                add("water", Material::Water, Shape::Displaced(Arc::new(displaced)));
            }
            Representation::Quads => {
                let mesh = quads::strips(columns, settings.dry_threshold, origin);
                add("water", Material::Water, Shape::Triangles(Arc::new(triangles(mesh))));
            }
            Representation::Tessellated => {
                let mesh = match (settings.screen_error, local_eye) {
                    (Some(pixels), Some((eye, angle))) => {
                        let size = |x: f64, y: f64, z: f64| (DVec3::new(x, y, z) - eye).length() * angle;
                        let samples = tessellate::screen_samples(water, pixels, 64, size);
                        tessellate::adaptive(water, samples)?
                    }
                    _ => tessellate::uniform(water, settings.samples)?,
                };
                add("water", Material::Water, Shape::Triangles(Arc::new(triangles(mesh))));
            }
        }
        // The report's quadrilaterals end between column centres: walls at the domain's edge would stand apart.
        if settings.representation != Representation::Quads {
            let sides = Sides::new(Arc::clone(water), bed.clone());
            add("water_sides", Material::Water, Shape::Sides(Arc::new(sides)));
        }
    }
    if let Some(bed) = &bed {
        add("terrain", Material::Ground, Shape::Surface(Arc::clone(bed)));
        if scene.terrain.sides {
            add(TERRAIN_SIDES, Material::Ground, Shape::Sides(Arc::new(Sides::of_ground(Arc::clone(bed)))));
        }
    }
    let eye = view.map(|view| (view.eye - origin, view.pixel_angle));
    let images = environment.meshes.iter().filter_map(|(_, mesh)| mesh.images.as_ref());
    let images = images.map(|images| images.bytes()).sum();
    let (mut spray, mist, thinning) = spray::gather(scene, frame, origin, water.as_deref(), eye, budget, images)?;
    spray::parts(scene, &mut spray, eye, water.as_deref(), &mut add)?;
    let spray = Arc::new(spray);
    for (index, sphere) in environment.spheres.iter().enumerate() {
        let ball = terrain::ball(sphere, origin)?;
        let shape = Spheres { center: vec![ball.center], radius: vec![ball.radius] };
        add(&format!("sphere_{index}"), Material::Diffuse(ball.albedo), Shape::Spheres(Arc::new(shape)));
    }
    for (name, mesh) in &environment.meshes {
        let farthest = mesh.position.iter().map(|&p| (p - origin).abs().max_element()).fold(0.0, f64::max);
        // Beyond this, products of three single-precision coordinates overflow.
        if farthest >= 1e15 {
            return Err(LowerError::TooFar { name: name.clone(), distance: farthest });
        }
        let material = match (&mesh.images, &mesh.albedo) {
            (Some(images), albedo) => Material::Images { albedo: Arc::new(albedo.clone()), images: Arc::clone(images) },
            (None, MeshAlbedo::Uniform(albedo)) => Material::Diffuse(*albedo),
            (None, MeshAlbedo::PerVertex(albedo)) => Material::VertexColours(Arc::new(albedo.clone())),
        };
        let shape = Triangles {
            position: mesh.positions_around(origin),
            normal: mesh.normal.clone(),
            index: mesh.index.clone(),
        };
        add(name, material, Shape::Triangles(Arc::new(shape)));
    }
    Ok(LoweredFrame { lowered: Lowered { origin, parts }, water, bed, spray, mist, thinning })
}

fn triangles(mesh: SurfaceMesh) -> Triangles {
    Triangles { position: mesh.position, normal: mesh.normal, index: mesh.index }
}

/// Points that a camera without a place of its own should see (files' frame, m): the wet columns' tops, or all bases
/// where everything is dry.
pub fn points_to_frame(columns: &Columns, dry_threshold: f64) -> Vec<DVec3> {
    let wet = control::wet(columns, dry_threshold);
    let any = wet.contains(&true);
    let point = |index: usize, height: f64| {
        let (x, z) = (index % columns.nx, index / columns.nx);
        DVec3::new(
            columns.origin[0] + columns.width[0] * x as f64,
            height,
            columns.origin[1] + columns.width[1] * z as f64,
        )
    };
    (0..wet.len())
        .filter(|&index| wet[index] || !any)
        .map(|index| point(index, if any { columns.top[index] } else { columns.base[index] }))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::ParticleRepresentation;
    use crate::state::{Panel, Particles, Sphere};
    use crate::surface::LaneSurface;

    fn frame(offset: f64) -> Frame {
        Frame {
            columns: Columns::level([offset, offset], [0.5, 0.25], [6, 5], 0.0, 1.0),
            particles: Particles {
                position: vec![[offset, 2.0, offset]],
                velocity: vec![[0.0; 3]],
                mass: vec![0.1],
                age: vec![0.0],
                id: None,
            },
            ..Frame::default()
        }
    }

    fn names(lowered: &Lowered) -> Vec<&str> {
        lowered.parts.iter().map(|part| part.name.as_str()).collect()
    }

    #[test]
    fn parts_carry_the_names_of_the_format() {
        let square = [[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 1.0], [1.0, 0.0, 0.0]];
        let model = Model {
            panels: vec![Panel { corners: square, albedo: [0.5; 3] }],
            spheres: vec![Sphere { center: [0.0; 3], radius: 1.0, albedo: [0.5; 3] }],
            meshes: Vec::new(),
        };
        let environment = Environment::load(&model, Path::new("."), &[]).unwrap();
        let lowered = lower(&Scene::default(), &frame(0.0), &environment, None, SimdLevel::Portable).unwrap();
        assert_eq!(
            names(&lowered.lowered),
            ["water", "water_sides", "terrain", TERRAIN_SIDES, "spray", "sphere_0", "panel_0"]
        );
    }

    #[test]
    fn what_a_scene_does_not_have_is_not_built() {
        let mut scene = Scene::default();
        scene.terrain.visible = false;
        scene.particles.representation = ParticleRepresentation::None;
        let mut dry = frame(0.0);
        dry.columns.top = dry.columns.base.clone();
        let lowered = lower(&scene, &dry, &Environment::default(), None, SimdLevel::Portable).unwrap();
        assert!(lowered.lowered.parts.is_empty() && lowered.water.is_none() && lowered.bed.is_none());
    }

    #[test]
    fn streaks_are_a_part_of_their_own_as_long_as_the_flight() {
        let mut scene = Scene::default();
        scene.particles.representation = ParticleRepresentation::Streamlines;
        let mut flying = frame(1e6);
        flying.particles.velocity[0] = [0.0, -6.0, 8.0];
        let lower = |scene: &Scene, view| lower(scene, &flying, &Environment::default(), view, SimdLevel::Portable);
        let length = |lowered: &LoweredFrame| {
            let part = lowered.lowered.parts.iter().find(|part| part.name == "streaks").unwrap();
            assert!(matches!(part.material, Material::Spray { first: 0 }));
            let Shape::Curves(curves) = &part.shape else { panic!("streaks are curves") };
            assert_eq!(curves.ends[0][0], lowered.spray.position[0]);
            (curves.ends[0][0] - curves.ends[0][1]).length()
        };
        let still = lower(&scene, None).unwrap();
        assert!(!names(&still.lowered).contains(&"spray"));
        assert!((length(&still) - 0.2).abs() < 1e-5);
        // Four moments of half a frame at 24 frames a second.
        (scene.camera.motion_steps, scene.camera.shutter) = (4, 0.5);
        assert!((length(&lower(&scene, None).unwrap()) - 10.0 / 24.0 / 8.0).abs() < 1e-5);
        scene.particles.streak = Some(0.1);
        assert!((length(&lower(&scene, None).unwrap()) - 1.0).abs() < 1e-5);
        // From far away it is wider than its water, and lets as much light through; alone it stands for nobody else.
        (scene.particles.least_pixels, scene.particles.least_opacity) = (0.0, 0.0);
        let view = View { eye: DVec3::new(1e6, 1000.0, 1e6), pixel_angle: 1e-3 };
        let far = lower(&scene, Some(view)).unwrap();
        let share = |lowered: &LoweredFrame| lowered.spray.appearance(0).share;
        assert!(share(&far) < 0.1 * share(&still) && share(&far) > 0.0);
    }

    #[test]
    fn mist_is_no_part_but_a_medium_around_the_same_origin() {
        let mut scene = Scene::default();
        scene.particles.representation = ParticleRepresentation::Mist;
        let lower =
            |scene: &Scene, offset| lower(scene, &frame(offset), &Environment::default(), None, SimdLevel::Portable);
        let lowered = lower(&scene, 1e6).unwrap();
        assert!(!names(&lowered.lowered).contains(&"spray") && lowered.spray.is_empty());
        let mist = lowered.mist.clone().unwrap();
        assert_eq!((mist.particles, lowered.particles_left_out()), (1, 0));
        let place = (DVec3::new(1e6, 2.0, 1e6) - lowered.lowered.origin).as_vec3();
        assert!(mist.extinction(place) > 0.9 * mist.greatest() && mist.extinction(place + glam::Vec3::X) == 0.0);
        // Finer droplets of the same water stop more light.
        scene.particles.droplet_radius *= 0.5;
        let finer = lower(&scene, 1e6).unwrap().mist.unwrap();
        assert!((finer.greatest() / mist.greatest() - 2.0).abs() < 1e-5);
        scene.particles.droplet_radius = 1e-6;
        scene.particles.scale = 1e6;
        let told = lower(&scene, 0.0).unwrap_err().to_string();
        assert!(told.contains("particles.droplet_radius"), "{told}");
        assert!(lower(&Scene::default(), 0.0).unwrap().mist.is_none());
    }

    #[test]
    fn displacement_moves_the_water_alone() {
        let mut scene = Scene::default();
        scene.surface.displacement.shear = 0.1;
        scene.surface.solver = crate::scene::SolverKind::Newton;
        let lower = |scene: &Scene| lower(scene, &frame(0.0), &Environment::default(), None, SimdLevel::Portable);
        let lowered = lower(&scene).unwrap();
        let displaced = |part: &Part| matches!(part.shape, Shape::Displaced(_));
        let moved: Vec<&str> =
            lowered.lowered.parts.iter().filter(|part| displaced(part)).map(|part| part.name.as_str()).collect();
        assert_eq!(moved, ["water"]);
        assert!(lowered.water.is_some(), "heights are asked of the undisplaced spline");
        // Without the check of scene files in between, too.
        scene.surface.solver = crate::scene::SolverKind::Univariate;
        assert!(lower(&scene).unwrap_err().to_string().starts_with("surface.solver is univariate"));
    }

    #[test]
    fn utm_offsets_do_not_move_the_local_frame() {
        let near = lower(&Scene::default(), &frame(0.0), &Environment::default(), None, SimdLevel::Portable).unwrap();
        let far = lower(&Scene::default(), &frame(1e6), &Environment::default(), None, SimdLevel::Portable).unwrap();
        assert_eq!(near.water.unwrap().bounds(), far.water.unwrap().bounds());
        assert_eq!(near.spray.position, far.spray.position);
        assert_eq!(far.lowered.origin.x - near.lowered.origin.x, 1e6);
    }
}
