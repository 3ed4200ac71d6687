//! `whitewater trace` from rays in a file to answers in a file, held against closed forms and the referee.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use glam::DVec3;
use whitewater::bench::work::Random;
use whitewater::lower::scene_origin;
use whitewater::scene::{SolverKind, Surface};
use whitewater::simd::SimdLevel;
use whitewater::state::{
    Columns, Encoding, Frame, Model, Panel, Particles, Sphere, read_frame, save_frame, save_model, write_arrays,
};
use whitewater::surface::audit::Audit;
use whitewater::surface::{SplineSurface, control, referee};

const ALL: [f64; 2] = [0.0, f64::INFINITY];

/// Dry columns' control heights short in binary too.
const DRY_DEPTH: (&str, f64) = ("surface.dry_depth=0.03125", 0.03125);

/// Rays of a file.
#[derive(Clone, Default)]
struct Rays {
    origin: Vec<[f64; 3]>,
    direction: Vec<[f64; 3]>,
    tmax: Option<Vec<f64>>,
}

impl Rays {
    fn push(&mut self, origin: impl Into<[f64; 3]>, direction: impl Into<[f64; 3]>) {
        self.origin.push(origin.into());
        self.direction.push(direction.into());
    }

    fn save(&self, path: &Path) {
        write_arrays(path, |archive| {
            archive.array("origin", &[self.origin.len() as u64, 3], self.origin.as_flattened().iter().copied())?;
            let direction = self.direction.as_flattened().iter().copied();
            archive.array("direction", &[self.direction.len() as u64, 3], direction)?;
            match &self.tmax {
                Some(tmax) => archive.array("tmax", &[tmax.len() as u64], tmax.iter().copied()),
                None => Ok(()),
            }
        })
        .unwrap();
    }
}

/// Answers of a file.
struct Answers {
    t: Vec<f64>,
    normal: Vec<f32>,
    object: Vec<i32>,
    objects: Vec<String>,
    gave_up: Vec<bool>,
}

impl Answers {
    fn read(path: &Path) -> Self {
        let mut archive = npyz::npz::NpzArchive::open(path).unwrap();
        Self {
            t: archive.by_name("t").unwrap().unwrap().into_vec().unwrap(),
            normal: archive.by_name("normal").unwrap().unwrap().into_vec().unwrap(),
            object: archive.by_name("object").unwrap().unwrap().into_vec().unwrap(),
            objects: archive.by_name("objects").unwrap().unwrap().into_vec().unwrap(),
            gave_up: archive.by_name("gave_up").unwrap().unwrap().into_vec().unwrap(),
        }
    }

    fn name(&self, ray: usize) -> Option<&str> {
        usize::try_from(self.object[ray]).ok().map(|index| self.objects[index].as_str())
    }

    fn normal(&self, ray: usize) -> [f32; 3] {
        [0, 1, 2].map(|axis| self.normal[3 * ray + axis])
    }
}

/// A scene in a folder of its own.
struct Setup {
    folder: tempfile::TempDir,
}

impl Setup {
    fn new(frame: &Frame, model: &Model) -> Self {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("scene.toml"), "[frames]\nfiles = \"time###.state\"\n").unwrap();
        save_frame(frame, folder.path().join("time001.state"), Encoding::Npz).unwrap();
        save_model(model, folder.path().join("model.state")).unwrap();
        Self { folder }
    }

    fn at(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn run(&self, more: &[&str]) -> Output {
        let mut command = Command::new(env!("CARGO_BIN_EXE_whitewater"));
        command.arg("trace").arg(self.at("scene.toml")).arg("--rays").arg(self.at("rays.npz"));
        command.arg("-o").arg(self.at("out.npz")).args(more).env_remove("WHITEWATER_LOG").output().unwrap()
    }

    fn trace(&self, rays: &Rays, more: &[&str]) -> Answers {
        rays.save(&self.at("rays.npz"));
        let output = self.run(more);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let answers = Answers::read(&self.at("out.npz"));
        assert_eq!(answers.t.len(), rays.origin.len());
        for ray in 0..answers.t.len() {
            let normal = answers.normal(ray).map(f64::from);
            let length = DVec3::from(normal).length();
            match answers.object[ray] {
                -1 => assert_eq!((answers.t[ray], length), (f64::INFINITY, 0.0), "ray {ray}"),
                _ => assert!(answers.t[ray].is_finite() && (length - 1.0).abs() < 1e-6, "ray {ray}: {normal:?}"),
            }
        }
        answers
    }

    /// That the program refuses, with code 2 and a message that says all of this.
    fn refused(&self, more: &[&str], says: &[&str]) {
        let output = self.run(more);
        let complaint = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{complaint}");
        for part in says {
            assert!(complaint.contains(part), "{part} is not in\n{complaint}");
        }
        assert!(!self.at("out.npz").exists() && !complaint.contains("panicked"), "{complaint}");
    }
}

/// A level lake 2 m deep over level ground at 0, 6 x 5 columns of 0.5 x 0.25 m, its first centre at (offset, offset).
fn lake(offset: f64) -> Frame {
    Frame { columns: Columns::level([offset, offset], [0.5, 0.25], [6, 5], 0.0, 2.0), ..Frame::default() }
}

/// Waves over an uneven bed, with dry columns, around (offset, offset).
fn waves(offset: f64) -> Frame {
    let (nx, nz) = (30, 24);
    let mut random = Random::new(5);
    // Heights of few binary digits: the files' and the scene's frame then hold the same surface.
    let snap = |height: f64| (height * 1024.0).round() / 1024.0;
    let place = |index: usize| ((index % nx) as f64, (index / nx) as f64);
    let base: Vec<f64> = (0..nx * nz).map(|k| snap(0.8 * (0.2 * place(k).0 - 0.3 * place(k).1).sin())).collect();
    let top = (0..nx * nz)
        .map(|k| {
            let level = 0.5 + 0.2 * (0.7 * place(k).0).sin() + 0.1 * random.unit();
            snap(level).max(base[k])
        })
        .collect();
    let columns = Columns {
        origin: [offset, offset],
        width: [1.0, 0.5],
        nx,
        nz,
        base,
        top,
        pressure: vec![0.0; nx * nz],
        flow: vec![[0.0; 2]; nx * nz],
    };
    Frame { columns, ..Frame::default() }
}

#[test]
fn level_water_is_hit_where_algebra_says() {
    let setup = Setup::new(&lake(10.0), &Model::default());
    let mut rays = Rays::default();
    rays.push([11.0, 5.0, 10.5], [0.0, -1.0, 0.0]);
    rays.push([11.0, 5.0, 10.5], [0.25, -2.0, 0.0]);
    rays.push([11.0, 1.0, 10.5], [0.0, 3.0, 0.0]); // From inside.
    rays.push([11.0, 1.0, 10.5], [0.0, -1.0, 0.0]); // To the bed.
    rays.push([0.0, 1.0, 10.5], [0.5, 0.0, 0.0]); // Onto the western wall at x = 9.75.
    rays.push([11.0, 1.0, 10.5], [0.0, 0.0, 2.0]); // The southern wall from inside, at z = 11.125.
    rays.push([11.0, 5.0, 10.5], [0.0, 1.0, 0.0]); // Away.
    rays.push([11.0, 2.0, 10.5], [0.3, 1.0, 0.0]); // Begins on the surface.
    let answers = setup.trace(&rays, &[]);
    assert_eq!(answers.objects, ["water", "water_sides", "terrain"]);
    assert_eq!(answers.t, [3.0, 1.5, 1.0 / 3.0, 1.0, 19.5, 0.3125, f64::INFINITY, 0.0]);
    let names: Vec<_> = (0..8).map(|ray| answers.name(ray)).collect();
    let (water, sides) = (Some("water"), Some("water_sides"));
    assert_eq!(names, [water, water, water, Some("terrain"), sides, sides, None, water]);
    assert_eq!(answers.normal(2), [0.0, 1.0, 0.0]);
    assert_eq!(answers.normal(4), [-1.0, 0.0, 0.0]);
    assert_eq!(answers.normal(5), [0.0, 0.0, 1.0]);
    assert_eq!(answers.gave_up, [false; 8]);
}

#[test]
fn tmax_is_inclusive_to_the_last_bit() {
    let setup = Setup::new(&waves(0.0), &Model::default());
    let mut random = Random::new(1);
    let mut rays = Rays::default();
    for _ in 0..2000 {
        let origin = DVec3::new(random.within(0.0, 29.0), random.within(-3.0, 4.0), random.within(0.0, 11.0));
        rays.push(origin, random.direction() * random.within(0.1, 5.0));
    }
    let free = setup.trace(&rays, &[]);
    let hits = free.t.iter().filter(|t| t.is_finite()).count();
    assert!(hits > 700, "{hits} hits");
    rays.tmax = Some(free.t.clone());
    let same = setup.trace(&rays, &[]);
    for ray in 0..2000 {
        assert_eq!(same.t[ray], free.t[ray], "ray {ray}");
    }
    rays.tmax = Some(free.t.iter().map(|t| if *t == 0.0 { 0.0 } else { t.next_down() }).collect());
    let short = setup.trace(&rays, &[]);
    for ray in 0..2000 {
        assert!(short.object[ray] == -1 || free.t[ray] == 0.0, "ray {ray} hits at {} of {}", short.t[ray], free.t[ray]);
    }
}

#[test]
fn answers_are_the_referees_to_nine_digits_here_and_in_utm() {
    for order in 2..=4 {
        let mut expected: Option<Vec<f64>> = None;
        for offset in [0.0, 1_048_576.0] {
            let frame = waves(offset);
            let setup = Setup::new(&frame, &Model::default());
            let mut random = Random::new(order.into());
            let mut rays = Rays::default();
            for k in 0..4000 {
                let far = if k % 4 == 0 { 1e4 } else { 8.0 };
                let target = DVec3::new(random.within(0.0, 29.0), random.within(-0.5, 0.7), random.within(0.0, 11.0));
                let direction = random.direction();
                // Short in binary, so that the same ray can be had a million metres away.
                let snap = |v: f64| (v * 65536.0).round() / 65536.0;
                let origin = (target - direction * random.within(0.1, 1.0) * far).map(snap);
                rays.push(origin + DVec3::new(offset, 0.0, offset), (direction * 3.0).map(snap));
            }
            let set = format!("surface.order={order}");
            let answers = setup.trace(&rays, &["--set", &set, "--set", DRY_DEPTH.0, "--only", "water"]);
            let settings = Surface { order, dry_depth: Some(DRY_DEPTH.1), ..Surface::default() };
            let origin = scene_origin(&frame.columns);
            let lattice = control::water(&frame.columns, &settings, origin.to_array()).unwrap().unwrap();
            let (mut hits, mut doubtful) = (0, 0);
            for ray in 0..4000 {
                let (o, d) = (DVec3::from(rays.origin[ray]) - origin, DVec3::from(rays.direction[ray]));
                let exact = referee::first_hit(&lattice, o, d, ALL).map_or(f64::INFINITY, |hit| hit.t);
                hits += usize::from(exact.is_finite());
                // A graze may be decided by the rounding of the ray to single precision.
                let near = (exact - answers.t[ray]).abs() <= 1e-9 * exact.max(1.0);
                if exact != answers.t[ray] && !near {
                    doubtful += 1;
                }
            }
            assert!(hits > 1000, "{hits} hits");
            assert!(doubtful <= 4, "order {order}, offset {offset}: {doubtful} of {hits} differ");
            match &expected {
                None => expected = Some(answers.t),
                Some(near) => {
                    let changed = near.iter().zip(&answers.t).filter(|(near, far)| near != far).count();
                    assert_eq!(changed, 0, "order {order}: a world offset changes answers");
                }
            }
        }
    }
}

#[test]
fn no_ray_over_the_shipped_scenes_is_lost_false_or_wrong() {
    for name in ["small", "jacksboro"] {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes").join(name).join("time000.state");
        let frame = read_frame(path, 0.001).unwrap();
        let setup = Setup::new(&frame, &Model::default());
        let origin = scene_origin(&frame.columns);
        for (part, lattice) in [
            ("water", control::water(&frame.columns, &Surface::default(), origin.to_array()).unwrap().unwrap()),
            ("terrain", control::bed(&frame.columns, &Surface::default(), origin.to_array()).unwrap()),
        ] {
            let surface = SplineSurface::new(lattice.clone(), SolverKind::Reference, SimdLevel::Portable);
            let [low, high] = lattice.domain.map(|corner| lattice.from_cell(corner));
            let (wide, column) = (high[0] - low[0], lattice.width[0]);
            let mut random = Random::new(17);
            let mut rays = Rays::default();
            while rays.origin.len() < 12_000 {
                let (x, z) = (random.within(low[0], high[0]), random.within(low[1], high[1]));
                let Some((y, slope)) = surface.point(x, z) else { continue };
                let point = DVec3::new(x, y, z);
                let normal = DVec3::new(-slope[0], 1.0, -slope[1]).normalize();
                let (from, direction) = match rays.origin.len() % 4 {
                    // From the side, a camera's distance away.
                    0 => {
                        let eye = DVec3::new(0.0, lattice.extent[1] + 0.3 * wide, -wide);
                        (eye, point - eye)
                    }
                    // Grazing.
                    1 => {
                        let along = random.direction().cross(normal).normalize();
                        let lift = normal * random.within(-2e-3, 2e-3) * column;
                        (point - along * 20.0 * column + lift, along)
                    }
                    // From nearby, to anywhere.
                    2 => (point + normal * random.within(-5.0, 5.0) * column, random.direction()),
                    // Plumb, through corners of columns.
                    _ => {
                        let corner = lattice.to_cell(x, z).map(f64::floor);
                        // At the very border of what is wet, rounding decides in whose column the ray falls.
                        let there = |dx: f64, dz: f64| {
                            let [x, z] = lattice.from_cell([corner[0] + dx, corner[1] + dz]);
                            surface.point(x, z).is_some()
                        };
                        if ![(-0.5, -0.5), (0.5, -0.5), (-0.5, 0.5), (0.5, 0.5)].iter().all(|&(x, z)| there(x, z)) {
                            continue;
                        }
                        let [x, z] = lattice.from_cell(corner);
                        (DVec3::new(x, lattice.extent[1] + column, z), DVec3::NEG_Y)
                    }
                };
                rays.push(from + origin, direction);
            }
            let answers = setup.trace(&rays, &["--only", part]);
            let mut audit = Audit::default();
            for ray in 0..rays.origin.len() {
                let (o, d) = (DVec3::from(rays.origin[ray]) - origin, DVec3::from(rays.direction[ray]));
                audit.check(&lattice, o, d, ALL, Some(answers.t[ray]).filter(|t| t.is_finite()));
            }
            assert_eq!((audit.lost, audit.false_hits, audit.wrong), (0, 0, 0), "{name} {part}: {audit:?}");
            assert!(audit.hits > 6000 && audit.tangent < 120, "{name} {part}: {audit:?}");
            assert!(answers.gave_up.iter().all(|gave_up| !gave_up), "{name} {part}");
        }
    }
}

#[test]
fn t_counts_lengths_of_the_direction_however_long_it_is() {
    let setup = Setup::new(&waves(0.0), &Model::default());
    let mut random = Random::new(3);
    let mut unit = Rays::default();
    for _ in 0..500 {
        let origin = DVec3::new(random.within(0.0, 29.0), 6.0, random.within(0.0, 11.0));
        unit.push(origin, (random.direction() - DVec3::Y).as_vec3().as_dvec3());
    }
    let expected = setup.trace(&unit, &[]);
    assert!(expected.t.iter().filter(|t| t.is_finite()).count() > 250);
    for power in [-1000, -500, -140, -100, 100, 130, 500, 1000] {
        let factor = 2f64.powi(power);
        let mut rays = unit.clone();
        rays.direction.iter_mut().flatten().for_each(|component| *component *= factor);
        let answers = setup.trace(&rays, &[]);
        assert_eq!(answers.object, expected.object, "2^{power}");
        for (found, expected) in answers.t.iter().zip(&expected.t) {
            assert_eq!(*found, expected / factor, "2^{power}");
        }
    }
    // Denormal directions: too far in their lengths for any number, but hit.
    let mut rays = Rays::default();
    rays.push([10.0, 6.0, 5.0], [0.0, -5e-324, 0.0]);
    rays.push([10.0, 6.0, 5.0], [0.0, -1e-310, 0.0]);
    rays.push([10.0, 6.0, 5.0], [5e-324, -1.0, -5e-324]);
    rays.push([10.0, 6.0, 5.0], [0.0, -1.0, 0.0]);
    let answers = setup.trace(&rays, &[]);
    assert!(answers.object.iter().all(|&object| object == answers.object[3] && object >= 0));
    assert_eq!((answers.t[0], answers.t[1], answers.t[2]), (f64::MAX, f64::MAX, answers.t[3]));
}

#[test]
fn origins_a_million_columns_away_keep_their_digits() {
    let frame = waves(0.0);
    let setup = Setup::new(&frame, &Model::default());
    let mut random = Random::new(8);
    let mut rays = Rays::default();
    for _ in 0..2000 {
        let target = DVec3::new(random.within(1.0, 28.0), 0.5, random.within(1.0, 10.0));
        let mut direction = random.direction();
        direction.y = -0.2 - direction.y.abs();
        rays.push(target - direction * 1e6, direction);
    }
    // From where a column is less than the spacing of numbers there is nothing to find, and nothing to fear.
    rays.push([1e300, 0.0, 1e300], [-1.0, 0.0, -1.0]);
    rays.push([f64::MAX, f64::MAX, f64::MAX], [-1e300, -1e300, -1e300]);
    let answers = setup.trace(&rays, &["--set", DRY_DEPTH.0, "--only", "water"]);
    let origin = scene_origin(&frame.columns);
    let settings = Surface { dry_depth: Some(DRY_DEPTH.1), ..Surface::default() };
    let lattice = control::water(&frame.columns, &settings, origin.to_array()).unwrap().unwrap();
    let mut hits = 0;
    for ray in 0..2000 {
        let (o, d) = (DVec3::from(rays.origin[ray]) - origin, DVec3::from(rays.direction[ray]));
        let exact = referee::first_hit(&lattice, o, d, ALL).map_or(f64::INFINITY, |hit| hit.t);
        hits += usize::from(exact.is_finite());
        // Double precision itself holds positions a million metres away to 1e-10.
        assert!(exact == answers.t[ray] || (exact - answers.t[ray]).abs() < 1e-8, "{exact} {}", answers.t[ray]);
    }
    assert!(hits > 1000, "{hits} hits");
    assert_eq!(answers.object[2000..], [-1, -1]);
}

#[test]
fn a_ray_that_begins_beside_the_surface_is_judged_in_double_precision() {
    let setup = Setup::new(&lake(0.0), &Model::default());
    let mut rays = Rays::default();
    for beside in [1e-3, 1e-7, 1e-9, 1e-12] {
        for (side, way) in [(1.0, -1.0), (1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0)] {
            rays.push([0.6, 2.0 + side * beside, 0.4], [0.0, way, 0.0]);
        }
    }
    let answers = setup.trace(&rays, &["--only", "water"]);
    for ray in 0..16 {
        let towards = ray % 2 == 0;
        assert_eq!(answers.object[ray], if towards { 0 } else { -1 }, "ray {ray}");
        if towards {
            let expected = (rays.origin[ray][1] - 2.0).abs();
            assert!((answers.t[ray] - expected).abs() < 1e-15, "ray {ray}: {} for {expected}", answers.t[ray]);
        }
    }
}

#[test]
fn objects_are_named_as_the_format_has_them_and_only_chooses() {
    let mut frame = lake(0.0);
    frame.particles = Particles {
        position: vec![[0.5, 4.0, 0.5]],
        velocity: vec![[0.0; 3]],
        mass: vec![100.0],
        age: vec![0.0],
        id: None,
    };
    // A panel over the lake, facing up; a ball above it.
    let panel = [[-1.0, 3.0, -1.0], [-1.0, 3.0, 2.0], [4.0, 3.0, 2.0], [4.0, 3.0, -1.0]];
    let model = Model {
        panels: vec![Panel { corners: panel, albedo: [0.5; 3] }],
        spheres: vec![Sphere { center: [2.1, 5.3, 0.7], radius: 0.4, albedo: [0.5; 3] }],
        meshes: vec!["rock.obj".into()],
    };
    let setup = Setup::new(&frame, &model);
    std::fs::write(setup.at("rock.obj"), "v 1 7.1 0\nv 1 7.1 1\nv 1.5 7.1 0\nf 1 2 3\n").unwrap();
    let mut rays = Rays::default();
    rays.push([2.1, 9.0, 0.7], [0.0, -2.0, 0.0]); // The ball.
    rays.push([0.5, 9.0, 0.5], [0.0, -1.0, 0.0]); // Spray.
    rays.push([0.1, 9.0, 0.1], [0.0, -1.0, 0.0]); // The panel.
    rays.push([1.1, 9.0, 0.1], [0.0, -1.0, 0.0]); // The rock.
    rays.push([2.1, 5.3, 0.7], [0.0, 0.0, 0.5]); // The ball from inside.
    let answers = setup.trace(&rays, &["--threads", "1"]);
    assert_eq!(answers.objects, ["water", "water_sides", "terrain", "spray", "sphere_0", "panel_0", "rock"]);
    let names: Vec<_> = (0..5).map(|ray| answers.name(ray).unwrap()).collect();
    assert_eq!(names, ["sphere_0", "spray", "panel_0", "rock", "sphere_0"]);
    let radius = (3.0 * 100.0 / (4.0 * std::f64::consts::PI * 1000.0f64)).cbrt();
    for (ray, t) in [(0, (9.0 - 5.7) / 2.0), (2, 6.0), (3, 9.0 - 7.1), (4, 0.8)] {
        assert!((answers.t[ray] - t).abs() < 1e-14, "ray {ray}: {} for {t}", answers.t[ray]);
    }
    // A particle's radius is drawn in single precision.
    assert!((answers.t[1] - (5.0 - radius)).abs() < 1e-7);
    assert_eq!((answers.normal(0), answers.normal(4)), ([0.0, 1.0, 0.0], [0.0, 0.0, 1.0]));
    assert_eq!((answers.normal(2), answers.normal(3)), ([0.0, 1.0, 0.0], [0.0, 1.0, 0.0]));

    // A streak without a flight is the ball that it was.
    let streaks = setup.trace(&rays, &["--set", "particles.representation=streamlines", "--only", "streaks,terrain"]);
    assert_eq!((streaks.objects.len(), streaks.name(1)), (2, Some("streaks")));
    assert!((streaks.t[1] - (5.0 - radius)).abs() < 1e-7);

    let only = setup.trace(&rays, &["--only", "terrain,water"]);
    assert_eq!(only.objects, ["water", "terrain"]);
    assert_eq!((only.t[0], only.t[1]), (3.5, 7.0));
    assert!(only.object[..4].iter().all(|&object| object == 0));
    assert_eq!(only.t[4], f64::INFINITY);
    std::fs::remove_file(setup.at("out.npz")).unwrap();
    setup.refused(&["--only", "water,boat"], &["`boat`", "water_sides, terrain, spray, sphere_0, panel_0, rock"]);
}

#[test]
fn a_dry_frame_has_no_water_to_hit() {
    let mut frame = lake(0.0);
    frame.columns.top = frame.columns.base.clone();
    let setup = Setup::new(&frame, &Model::default());
    let mut rays = Rays::default();
    rays.push([1.0, 5.0, 0.5], [0.0, -1.0, 0.0]);
    let answers = setup.trace(&rays, &["--only", "water,water_sides,spray"]);
    assert_eq!((answers.objects.len(), answers.object[0]), (0, -1));
    assert_eq!(setup.trace(&rays, &[]).name(0), Some("terrain"));
    assert_eq!(setup.trace(&Rays::default(), &[]).t, [0.0; 0]);
}

#[test]
fn solvers_representations_and_accelerators_are_the_scenes() {
    let setup = Setup::new(&waves(0.0), &Model::default());
    let mut random = Random::new(4);
    let mut rays = Rays::default();
    for _ in 0..300 {
        let lean = DVec3::new(random.within(-0.3, 0.3), -1.0, random.within(-0.3, 0.3));
        rays.push([random.within(2.0, 27.0), 4.0, random.within(2.0, 10.0)], lean);
    }
    let expected = setup.trace(&rays, &[]);
    for set in ["surface.solver=newton", "surface.solver=reference", "accel.water=brute", "surface.tolerance=0.01"] {
        let answers = setup.trace(&rays, &["--set", set, "--simd", "portable"]);
        assert_eq!(answers.objects, expected.objects);
        for ray in 0..300 {
            let (found, expected) = (answers.t[ray], expected.t[ray]);
            assert!((found - expected).abs() < 1e-9, "{set}, ray {ray}: {found} for {expected}");
        }
    }
    let quads = setup.trace(&rays, &["--set", "surface.representation=quads"]);
    assert_eq!(quads.objects, ["water", "terrain"]);
    assert!((0..300).any(|ray| quads.name(ray) == Some("water") && quads.t[ray] != expected.t[ray]));
}

#[test]
fn what_is_no_ray_is_refused_with_its_place() {
    let setup = Setup::new(&lake(0.0), &Model::default());
    let rays = setup.at("rays.npz");
    let two = [0.0, 1.0, 0.0, 0.0, -1.0, 0.0];
    let save = |origin: &[f64], direction: &[f64], tmax: Option<&[f64]>| {
        write_arrays(&rays, |archive| {
            archive.array("origin", &[origin.len() as u64 / 3, 3], origin.iter().copied())?;
            archive.array("direction", &[direction.len() as u64 / 3, 3], direction.iter().copied())?;
            tmax.map_or(Ok(()), |tmax| archive.array("tmax", &[tmax.len() as u64], tmax.iter().copied()))
        })
        .unwrap();
    };
    setup.refused(&[], &["rays.npz", "No such file"]);
    std::fs::write(&rays, "junk").unwrap();
    setup.refused(&[], &["rays.npz", "zip archive"]);
    save(&[0.0, f64::NAN, 0.0, 0.0, 0.0, f64::INFINITY], &two, None);
    setup.refused(&[], &["`origin`[0][1]", "NaN", "`origin`[1][2]", "inf"]);
    save(&two, &[0.0, 0.0, 0.0, 0.0, f64::NEG_INFINITY, 1.0], None);
    setup.refused(&[], &["`direction`[0]", "`direction`[1][1]", "-inf"]);
    save(&two, &two[..3], None);
    setup.refused(&[], &["`direction`", "shape (1, 3)", "shape (2, 3)"]);
    save(&two, &two, Some(&[-1.0, f64::NAN]));
    setup.refused(&[], &["`tmax`[0]", "-1", "`tmax`[1]", "NaN"]);
    save(&two, &two, Some(&[1.0]));
    setup.refused(&[], &["`tmax`", "shape (1,)", "shape (2,)"]);
    write_arrays(&rays, |archive| archive.array("origin", &[2, 3], two)).unwrap();
    setup.refused(&[], &["no array `direction`"]);
    write_arrays(&rays, |archive| {
        archive.array("origin", &[6], two)?;
        archive.array("direction", &[2, 3], two.map(|value| value as i32))
    })
    .unwrap();
    setup.refused(&[], &["`direction`", "f4 or f8"]);
    save(&two, &[1.0; 6], None);
    setup.refused(&["--frame", "7"], &["no frame 7"]);
    setup.refused(&["--set", "surface.order=9"], &["surface.order"]);
}
