//! The seam of the accelerators: batches of rays in, nearest hits or occlusion out.
//!
//! A batch is a structure of arrays, sized for a tile. Accelerators stand behind one trait and are chosen by name at
//! run time; whichever is chosen, the picture is the same.

mod block;
mod brute;
pub mod bsp;
mod clusters;
pub mod columns;
#[cfg(test)]
mod curve_tests;
pub mod embree;
#[cfg(test)]
mod facing_tests;
mod lanes;
mod pair;
mod patches;
mod stream;
#[cfg(test)]
mod testing;

use std::sync::Arc;

use brute::Brute;
use bsp::{Bsp, Plan};
use columns::Columns;
pub use embree::EmbreeAccel;
use pair::Pair;
pub use stream::Stream;

pub use crate::ffi::embree::EmbreeError;
use crate::lower::{Curves, Discs, Lowered, Material, Part, Shape, Spheres, Triangles};
use crate::scene::{Accel, ObjectsAccel, WaterAccel};
use crate::simd::SimdLevel;
use crate::surface::audit::Audit;
use crate::surface::{BruteDisplaced, BruteSurface, LaneSurface, SolveCounts};

/// No part was hit.
pub const NO_PART: u32 = u32::MAX;

/// Rays in the scene's local frame (metres around the scene origin), one array per component.
///
/// A direction need not be of unit length; `t` counts its lengths. What is no ray misses everything and never reaches a
/// solver: a component that is not finite, a zero direction, a negative `tnear`, `tnear >= tfar`, a negative
/// tolerance (`tfar` may be +inf).
#[derive(Clone, Debug, Default)]
pub struct RayBatch {
    /// Origins: x, y, z.
    pub origin: [Vec<f32>; 3],
    /// Directions: x, y, z.
    pub direction: [Vec<f32>; 3],
    /// Least t that counts.
    pub tnear: Vec<f32>,
    /// Greatest t that counts, inclusive.
    pub tfar: Vec<f32>,
    /// Tolerance of a surface hit (in t) at the origin.
    pub tolerance: Vec<f32>,
    /// Growth of the tolerance per unit of t, for the whole batch.
    pub tolerance_growth: f32,
}

impl RayBatch {
    /// Count of rays.
    pub fn len(&self) -> usize {
        self.tnear.len()
    }
    /// True for no rays.
    pub fn is_empty(&self) -> bool {
        self.tnear.is_empty()
    }
    /// Forgets the rays, keeps the memory.
    pub fn clear(&mut self) {
        for axis in self.origin.iter_mut().chain(self.direction.iter_mut()) {
            axis.clear();
        }
        self.tnear.clear();
        self.tfar.clear();
        self.tolerance.clear();
    }
    /// Appends one ray.
    pub fn push(&mut self, origin: glam::Vec3, direction: glam::Vec3, tnear: f32, tfar: f32, tolerance: f32) {
        for axis in 0..3 {
            self.origin[axis].push(origin[axis]);
            self.direction[axis].push(direction[axis]);
        }
        self.tnear.push(tnear);
        self.tfar.push(tfar);
        self.tolerance.push(tolerance);
    }
    /// Origin of ray `index`.
    pub fn origin(&self, index: usize) -> glam::Vec3 {
        glam::Vec3::new(self.origin[0][index], self.origin[1][index], self.origin[2][index])
    }
    /// Direction of ray `index`.
    pub fn direction(&self, index: usize) -> glam::Vec3 {
        glam::Vec3::new(self.direction[0][index], self.direction[1][index], self.direction[2][index])
    }
}

/// Nearest hits of a batch, one array per field, in the order of the rays.
#[derive(Clone, Debug, Default)]
pub struct HitBatch {
    /// Distance in lengths of the direction; +inf for a miss.
    pub t: Vec<f32>,
    /// Index of the part ([`crate::lower::Lowered::parts`]), [`NO_PART`] for a miss.
    pub part: Vec<u32>,
    /// Primitive within the part: patch, sphere, disc, curve, triangle, side.
    pub primitive: Vec<u32>,
    /// First surface coordinate: within the patch (0..1 along x), or a triangle's weight of its second vertex; how
    /// far the ball that a curve touches there is from its head (0) to its tail (1), in shares of the axis; 0 for spheres
    /// and discs.
    pub u: Vec<f32>,
    /// Second surface coordinate: within the patch (0..1 along z), or a triangle's weight of its third vertex.
    pub v: Vec<f32>,
    /// Geometric normal, not normalised: x, y, z. A surface's own; outward for spheres (hit - centre), curves and for triangles
    /// that are counter-clockwise seen from outside; a disc's as given, or to the ray's origin from its centre.
    pub normal: [Vec<f32>; 3],
    /// The solver could not decide: counted, and reported to whoever asked.
    pub gave_up: Vec<bool>,
}

impl HitBatch {
    /// Room for `count` rays with whatever was there: for those who write every entry.
    fn resize(&mut self, count: usize) {
        self.t.resize(count, f32::INFINITY);
        self.part.resize(count, NO_PART);
        self.primitive.resize(count, 0);
        self.u.resize(count, 0.0);
        self.v.resize(count, 0.0);
        for axis in &mut self.normal {
            axis.resize(count, 0.0);
        }
        self.gave_up.resize(count, false);
    }
    /// Makes room for `count` rays, all missing.
    pub fn reset(&mut self, count: usize) {
        fn fill<T: Clone>(values: &mut Vec<T>, count: usize, value: T) {
            values.clear();
            values.resize(count, value);
        }
        fill(&mut self.t, count, f32::INFINITY);
        fill(&mut self.part, count, NO_PART);
        fill(&mut self.primitive, count, 0);
        fill(&mut self.u, count, 0.0);
        fill(&mut self.v, count, 0.0);
        for axis in &mut self.normal {
            fill(axis, count, 0.0);
        }
        fill(&mut self.gave_up, count, false);
    }
}

/// What an accelerator can be built over.
#[derive(Clone)]
pub enum Geometry {
    /// A surface that answers lanes of rays.
    Lanes(Arc<dyn LaneSurface>),
    /// Spheres.
    Spheres(Arc<Spheres>),
    /// Discs.
    Discs(Arc<Discs>),
    /// Round curves.
    Curves(Arc<Curves>),
    /// Triangles.
    Triangles(Arc<Triangles>),
}

impl From<&Shape> for Geometry {
    fn from(shape: &Shape) -> Self {
        match shape {
            Shape::Surface(surface) => Self::Lanes(Arc::clone(surface) as Arc<dyn LaneSurface>),
            Shape::Displaced(surface) => Self::Lanes(Arc::clone(surface) as Arc<dyn LaneSurface>),
            Shape::Sides(sides) => Self::Lanes(Arc::clone(sides) as Arc<dyn LaneSurface>),
            Shape::Spheres(spheres) => Self::Spheres(Arc::clone(spheres)),
            Shape::Discs(discs) => Self::Discs(Arc::clone(discs)),
            Shape::Curves(curves) => Self::Curves(Arc::clone(curves)),
            Shape::Triangles(triangles) => Self::Triangles(Arc::clone(triangles)),
        }
    }
}

/// Geometry with its parts' indices. Brute force gets splines without their walk: every patch is asked.
fn geometry_of(parts: &[Part], water: WaterAccel, chosen: impl Fn(&Part) -> bool) -> Vec<(u32, Geometry)> {
    let geometry = |part: &Part| match (&part.shape, water) {
        (Shape::Surface(surface), WaterAccel::Brute) => Geometry::Lanes(Arc::new(BruteSurface(Arc::clone(surface)))),
        (Shape::Displaced(surface), WaterAccel::Brute) => {
            Geometry::Lanes(Arc::new(BruteDisplaced(Arc::clone(surface))))
        }
        (shape, _) => shape.into(),
    };
    (0..).zip(parts).filter(|(_, part)| chosen(part)).map(|(index, part)| (index, geometry(part))).collect()
}

/// Counts by kind, of the kinds that are there.
fn count_primitives(geometry: &[(u32, Geometry)]) -> Vec<(String, u64)> {
    let mut counts = [("surfaces", 0), ("spheres", 0), ("discs", 0), ("curves", 0), ("triangles", 0)];
    for (_, geometry) in geometry {
        let (kind, count) = match geometry {
            Geometry::Lanes(_) => (0, 1),
            Geometry::Spheres(spheres) => (1, spheres.center.len()),
            Geometry::Discs(discs) => (2, discs.center.len()),
            Geometry::Curves(curves) => (3, curves.ends.len()),
            Geometry::Triangles(triangles) => (4, triangles.index.len()),
        };
        counts[kind].1 += count as u64;
    }
    counts.into_iter().filter(|&(_, count)| count > 0).map(|(kind, count)| (kind.to_owned(), count)).collect()
}

/// Why an accelerator could not be built.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum AccelError {
    /// Embree's reason.
    #[error(transparent)]
    Embree(#[from] EmbreeError),
    /// A triangle names a vertex that is not there.
    #[error("part {part}, triangle {triangle}: vertex {vertex}, expected less than the count of vertices, {count}")]
    Vertex {
        /// The part.
        part: u32,
        /// The triangle.
        triangle: usize,
        /// What it names.
        vertex: u32,
        /// Vertices that there are.
        count: usize,
    },
    /// More primitives than an accelerator can number.
    #[error("{count} objects, expected at most {most}")]
    TooMany {
        /// How many there are.
        count: u64,
        /// How many there may be.
        most: u64,
    },
    /// A surface was given to an accelerator of objects.
    #[error("part {part} is a surface, expected spheres, discs, curves or triangles")]
    Surface {
        /// The part.
        part: u32,
    },
    /// Something else was given to an accelerator of surfaces.
    #[error("part {part} is no surface; expected a surface or its side walls")]
    NoSurface {
        /// The part.
        part: u32,
    },
    /// The report's walk was asked to work with a solver that is not its own.
    #[error(
        "part {part}: surface.solver is \"{solver}\", but accel.water = \"columns\" walks with the report's own solver; \
         expected no solver, or another accelerator"
    )]
    Solver {
        /// The part.
        part: u32,
        /// The solver's name.
        solver: &'static str,
    },
    /// Arrays that belong together differ in length.
    #[error("part {part}: {count} {what}, expected one per centre, {expected}")]
    Length {
        /// The part.
        part: u32,
        /// The array.
        what: &'static str,
        /// Its length.
        count: usize,
        /// The length of the others.
        expected: usize,
    },
}

/// Refuses arrays that do not fit each other, for every accelerator alike.
fn check(geometry: &[(u32, Geometry)]) -> Result<(), AccelError> {
    let same = |part, what, count, expected| {
        if count == expected { Ok(()) } else { Err(AccelError::Length { part, what, count, expected }) }
    };
    for &(part, ref geometry) in geometry {
        match geometry {
            Geometry::Lanes(_) => {}
            Geometry::Spheres(spheres) => same(part, "radii", spheres.radius.len(), spheres.center.len())?,
            Geometry::Discs(discs) => {
                same(part, "radii", discs.radius.len(), discs.center.len())?;
                if let Some(normal) = &discs.normal {
                    same(part, "normals", normal.len(), discs.center.len())?;
                }
            }
            Geometry::Curves(curves) => same(part, "pairs of radii", curves.radius.len(), curves.ends.len())?,
            Geometry::Triangles(mesh) => {
                let count = mesh.position.len();
                for (triangle, corners) in mesh.index.iter().enumerate() {
                    if let Some(&vertex) = corners.iter().find(|&&vertex| vertex as usize >= count) {
                        return Err(AccelError::Vertex { part, triangle, vertex, count });
                    }
                }
            }
        }
    }
    Ok(())
}

/// What an accelerator says of itself.
#[derive(Clone, Debug, Default, serde::Serialize)]
pub struct AccelStats {
    /// Name, as in the scene file.
    pub name: String,
    /// Seconds to build.
    pub build_seconds: f64,
    /// Bytes held, without the scene's own arrays.
    pub bytes: u64,
    /// Primitives by kind.
    pub primitives: Vec<(String, u64)>,
}

/// An acceleration structure over lowered parts, ready to be asked from any thread.
pub trait Accelerator: Send + Sync {
    /// Nearest hit of each ray. `hits` is reset first. Adds the solver's work to `counts`.
    fn closest(&self, rays: &RayBatch, hits: &mut HitBatch, counts: &mut SolveCounts);
    /// Whether each ray hits anything at all. `occluded` is resized to the batch.
    fn occluded(&self, rays: &RayBatch, occluded: &mut Vec<bool>, counts: &mut SolveCounts);
    /// Name, memory, build time.
    fn stats(&self) -> AccelStats;
    /// Rays so far that were traced again exactly, and how many of them differ; `None` where no ray can.
    fn audit(&self) -> Option<Audit> {
        None
    }
}

/// Builds the accelerators that a scene names over all parts; a hit's part is the index in `lowered.parts`.
///
/// Where one accelerator serves both axes, it is built once over everything; where an axis has no parts, nothing is built
/// for it.
///
/// # Errors
/// Embree is asked for and missing, or a part cannot be given to an accelerator.
pub fn build(lowered: &Lowered, settings: &Accel, simd: SimdLevel) -> Result<Box<dyn Accelerator>, AccelError> {
    let all = |chosen: &dyn Fn(&Part) -> bool| geometry_of(&lowered.parts, settings.water, chosen);
    match (settings.water, settings.objects) {
        (WaterAccel::Embree, ObjectsAccel::Embree) => return embree(&all(&|_| true), simd),
        (WaterAccel::Brute, ObjectsAccel::Brute) => return brute(all(&|_| true)),
        _ => {}
    }
    // The stream serves surfaces only: triangles that stand in for them are objects to it.
    let is_surface = |part: &Part| matches!(part.shape, Shape::Surface(_) | Shape::Displaced(_) | Shape::Sides(_));
    let serves = |part: &Part| match settings.water {
        WaterAccel::Stream => is_surface(part),
        WaterAccel::Columns => columns::serves(part),
        _ => on_water_axis(part),
    };
    let (on_water, others) = (all(&serves), all(&|part| !serves(part)));
    let water = |geometry: Vec<_>| match settings.water {
        WaterAccel::Embree => embree(&geometry, simd),
        WaterAccel::Stream => Stream::new(&geometry).map(|stream| Box::new(stream) as Box<dyn Accelerator>),
        WaterAccel::Brute => brute(geometry),
        WaterAccel::Columns => {
            let parts = (0..).zip(&lowered.parts).filter(|(_, part)| serves(part));
            Columns::new(parts).map(|columns| Box::new(columns) as Box<dyn Accelerator>)
        }
    };
    let objects = |geometry: Vec<_>| match settings.objects {
        ObjectsAccel::Embree => embree(&geometry, simd),
        ObjectsAccel::Brute => brute(geometry),
        kind @ (ObjectsAccel::Bsp | ObjectsAccel::BspSah | ObjectsAccel::BspReport) => {
            let plan = Plan::new(kind, settings.bsp_depth, settings.bsp_leaf);
            Bsp::new(geometry, plan).map(|bsp| Box::new(bsp) as Box<dyn Accelerator>)
        }
    };
    match (on_water.is_empty(), others.is_empty()) {
        (false, true) => water(on_water),
        (true, _) => objects(others),
        _ => Ok(Box::new(Pair { water: water(on_water)?, objects: objects(others)? })),
    }
}

fn embree(geometry: &[(u32, Geometry)], simd: SimdLevel) -> Result<Box<dyn Accelerator>, AccelError> {
    Ok(Box::new(EmbreeAccel::with_simd(geometry, simd)?))
}

fn brute(geometry: Vec<(u32, Geometry)>) -> Result<Box<dyn Accelerator>, AccelError> {
    check(&geometry)?;
    Ok(Box::new(Brute::new(geometry)))
}

/// `accel.water` serves the water, its sides and the bed, also where triangles stand in for the splines.
fn on_water_axis(part: &Part) -> bool {
    matches!(part.shape, Shape::Surface(_) | Shape::Displaced(_) | Shape::Sides(_))
        || matches!(part.material, Material::Water | Material::Ground)
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::testing::{random_rays, random_scene};
    use super::*;

    fn trace(accel: &dyn Accelerator, rays: &RayBatch) -> (HitBatch, Vec<bool>) {
        let (mut hits, mut occluded) = (HitBatch::default(), Vec::new());
        accel.closest(rays, &mut hits, &mut SolveCounts::default());
        accel.occluded(rays, &mut occluded, &mut SolveCounts::default());
        (hits, occluded)
    }

    #[test]
    fn embree_agrees_with_brute_force() {
        let (mut hits_seen, mut ties) = ([0; 4], 0);
        for seed in 0..4 {
            let scene = random_scene(seed);
            let embree = EmbreeAccel::new(&scene).unwrap();
            let brute = Brute::new(scene);
            let rays = random_rays(3000, 100 + seed);
            let ((ours, shadow), (truth, true_shadow)) = (trace(&embree, &rays), trace(&brute, &rays));
            for index in 0..rays.len() {
                let place = format!("seed {seed}, ray {index}");
                let part = truth.part[index];
                // Positions are within 25 m and rounded to 24 bits; a sphere's or a triangle's t in single precision
                // loses a factor of 1 / cos at grazing, which 64 units in the last place leave room for.
                let speed = rays.direction(index).length();
                let bound = 64.0 * 25.0 * f32::EPSILON / speed;
                if ours.part[index] != part || ours.primitive[index] != truth.primitive[index] {
                    // A graze, or two things in one place: either the edge decides or the next hit is as near.
                    ties += 1;
                    continue;
                }
                assert_eq!(shadow[index], part != NO_PART, "{place}");
                assert_eq!(true_shadow[index], part != NO_PART, "{place}");
                if part == NO_PART {
                    assert_eq!(ours.t[index], f32::INFINITY, "{place}");
                    continue;
                }
                hits_seen[part as usize] += 1;
                let normal = |hits: &HitBatch| Vec3::from(hits.normal.each_ref().map(|axis| axis[index]));
                let (found, expected) = (normal(&ours), normal(&truth));
                let cosine = expected.normalize().dot(rays.direction(index) / speed).abs();
                assert!((ours.t[index] - truth.t[index]).abs() <= bound / cosine.max(0.01), "{place}: t");
                assert!((found - expected).length() <= 0.01 * expected.length(), "{place}: {found} for {expected}");
                assert!((ours.u[index] - truth.u[index]).abs() < 0.01, "{place}: u");
                assert!((ours.v[index] - truth.v[index]).abs() < 0.01, "{place}: v");
            }
        }
        assert!(hits_seen.iter().all(|&count| count > 300), "hits by part: {hits_seen:?}");
        assert!(ties <= 3, "{ties} rays hit other things");
    }

    #[test]
    fn a_ray_inside_a_sphere_or_near_a_disc_hits_it() {
        let spheres = Spheres { center: vec![Vec3::ZERO], radius: vec![2.0] };
        let discs = Discs { center: vec![Vec3::ZERO], radius: vec![3.0], normal: Some(vec![Vec3::Z]) };
        for (geometry, t, normal) in
            [(Geometry::Spheres(Arc::new(spheres)), 2.5, 2.0), (Geometry::Discs(Arc::new(discs)), 0.5, 1.0)]
        {
            let scene = vec![(7, geometry)];
            let mut rays = RayBatch::default();
            rays.push(Vec3::new(0.0, 0.0, -0.5), Vec3::Z, 0.0, f32::INFINITY, 0.0);
            let embree = EmbreeAccel::new(&scene).unwrap();
            for accel in [&embree as &dyn Accelerator, &Brute::new(scene)] {
                let (hits, occluded) = trace(accel, &rays);
                let name = accel.stats().name;
                assert_eq!((hits.t[0], hits.part[0], hits.normal[2][0], occluded[0]), (t, 7, normal, true), "{name}");
            }
        }
    }

    #[test]
    fn a_pair_finds_what_one_accelerator_finds() {
        let scene = random_scene(3);
        let (water, objects): (Vec<_>, Vec<_>) = scene.iter().cloned().partition(|(part, _)| *part == 3);
        let one = EmbreeAccel::new(&scene).unwrap();
        let rays = random_rays(2000, 4);
        let expected = trace(&one, &rays);
        let pairs = [
            Pair { water: Box::new(Brute::new(water.clone())), objects: Box::new(EmbreeAccel::new(&objects).unwrap()) },
            Pair {
                water: Box::new(EmbreeAccel::new(&water).unwrap()),
                objects: Box::new(EmbreeAccel::new(&objects).unwrap()),
            },
        ];
        for pair in pairs {
            let found = trace(&pair, &rays);
            assert_eq!(found.0.part, expected.0.part);
            assert_eq!(found.0.t, expected.0.t);
            assert_eq!(found.0.primitive, expected.0.primitive);
            assert_eq!(found.0.normal, expected.0.normal);
            assert_eq!((found.0.u, found.0.v), (expected.0.u.clone(), expected.0.v.clone()));
            assert_eq!(found.1, expected.1);
            assert_eq!(pair.stats().primitives.len(), 4);
        }
    }

    #[test]
    fn kinds_choose_accelerators_and_parts_keep_their_index() {
        let sphere = |x: f32| Spheres { center: vec![Vec3::new(x, 0.0, 0.0)], radius: vec![1.0] };
        let part = |material, shape| Part { name: String::new(), material, shape };
        let mesh = Triangles {
            position: vec![Vec3::new(-9.0, -5.0, -9.0), Vec3::new(9.0, -5.0, -9.0), Vec3::new(0.0, -5.0, 9.0)],
            normal: Vec::new(),
            index: vec![[0, 1, 2]],
        };
        let lowered = Lowered {
            parts: vec![
                part(Material::Spray { first: 0 }, Shape::Spheres(Arc::new(sphere(-3.0)))),
                part(Material::Water, Shape::Triangles(Arc::new(mesh))),
                part(Material::Spray { first: 0 }, Shape::Spheres(Arc::new(sphere(3.0)))),
            ],
            ..Lowered::default()
        };
        let mut rays = RayBatch::default();
        for x in [-3.0, 0.0, 3.0] {
            rays.push(Vec3::new(x, 5.0, 0.0), Vec3::NEG_Y, 0.0, f32::INFINITY, 0.0);
        }
        use ObjectsAccel as Objects;
        for (water, objects, name) in [
            (WaterAccel::Embree, Objects::Embree, "embree"),
            (WaterAccel::Brute, Objects::Brute, "brute"),
            (WaterAccel::Embree, Objects::Brute, "embree + brute"),
            (WaterAccel::Brute, Objects::Embree, "brute + embree"),
            (WaterAccel::Embree, Objects::Bsp, "embree + bsp"),
            (WaterAccel::Brute, Objects::BspSah, "brute + bsp-sah"),
            (WaterAccel::Brute, Objects::BspReport, "brute + bsp-report"),
            // The water is triangles here, which the walk leaves to the objects' accelerator.
            (WaterAccel::Columns, Objects::BspReport, "bsp-report"),
        ] {
            let settings = Accel { water, objects, ..Accel::default() };
            let accel = build(&lowered, &settings, SimdLevel::detect()).unwrap();
            assert_eq!(accel.stats().name, name);
            assert_eq!(trace(accel.as_ref(), &rays).0.part, [0, 1, 2], "{name}");
        }
    }

    #[test]
    fn displaced_water_is_the_same_under_every_accelerator_that_takes_it() {
        use crate::scene::SolverKind;
        use crate::surface::{DisplacedSurface, Lattice, SimdLevel, SplineSurface};
        let heights: Vec<f64> = (0..100).map(|k| f64::from(k % 7) * 0.3 + f64::from(k / 10 % 3) * 0.2).collect();
        let shifts: Vec<[f64; 2]> = (0..100usize)
            .map(|k| match (k % 10, k / 10) {
                (1..9, 1..9) => [0.2 - 0.1 * (k % 4) as f64, 0.02 * (k % 11) as f64],
                _ => [0.0; 2],
            })
            .collect();
        let lattice = Lattice::new(3, [10, 10], [0.5; 2], [1.0; 2], &heights, |_| true).unwrap();
        let flat = Arc::new(SplineSurface::new(lattice, SolverKind::Newton, SimdLevel::detect()));
        let water = DisplacedSurface::new(flat, &heights, &shifts, SolverKind::Newton).unwrap();
        let part =
            Part { name: "water".to_owned(), material: Material::Water, shape: Shape::Displaced(Arc::new(water)) };
        let lowered = Lowered { parts: vec![part], ..Lowered::default() };
        let mut rays = RayBatch::default();
        for k in 0..400 {
            let (x, z) = ((k % 20) as f32 * 0.5 + 0.1, (k / 20) as f32 * 0.5 + 0.2);
            rays.push(Vec3::new(x, 6.0, z), Vec3::new(0.3, -1.0, 0.2 - 0.001 * k as f32), 0.0, f32::INFINITY, 1e-6);
        }
        let settings = |water| Accel { water, ..Accel::default() };
        let [embree, brute] = [WaterAccel::Embree, WaterAccel::Brute]
            .map(|water| build(&lowered, &settings(water), SimdLevel::detect()).unwrap());
        let (ours, truth) = (trace(&*embree, &rays), trace(&*brute, &rays));
        assert_eq!((&ours.0.part, &ours.1), (&truth.0.part, &truth.1));
        assert!(truth.1.iter().filter(|&&hit| hit).count() > 300);
        for index in (0..rays.len()).filter(|&index| truth.1[index]) {
            assert!((ours.0.t[index] - truth.0.t[index]).abs() < 1e-5, "ray {index}");
        }
    }

    #[test]
    fn arrays_that_do_not_fit_are_refused_by_every_accelerator() {
        let part = |shape| Part { name: String::new(), material: Material::Spray { first: 0 }, shape };
        let mesh = Triangles { position: vec![Vec3::ZERO; 3], normal: Vec::new(), index: vec![[0, 1, 2], [0, 1, 3]] };
        let spheres = Spheres { center: vec![Vec3::ZERO; 2], radius: vec![1.0] };
        let discs = Discs { center: vec![Vec3::ZERO], radius: vec![1.0], normal: Some(Vec::new()) };
        for (shape, expected) in [
            (
                Shape::Triangles(Arc::new(mesh)),
                "part 0, triangle 1: vertex 3, expected less than the count of vertices, 3",
            ),
            (Shape::Spheres(Arc::new(spheres)), "part 0: 1 radii, expected one per centre, 2"),
            (Shape::Discs(Arc::new(discs)), "part 0: 0 normals, expected one per centre, 1"),
        ] {
            let lowered = Lowered { parts: vec![part(shape)], ..Lowered::default() };
            for objects in ObjectsAccel::ALL {
                let settings = Accel { water: WaterAccel::Brute, objects, ..Accel::default() };
                let error = build(&lowered, &settings, SimdLevel::detect()).err().expect(expected).to_string();
                assert_eq!(error, expected);
            }
        }
    }
}
