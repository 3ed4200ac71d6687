//! Scenes at the edge of what numbers hold: sizes, offsets, flatness, emptiness, crowds, rays along axes, denormals.
//!
//! Surfaces are held against the referee, for every order, solver and instruction set; whole frames must end with every
//! sample of every channel finite.

use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

use glam::{DVec3, Vec3};
use whitewater::bench::work::Random;
use whitewater::lower::scene_origin;
use whitewater::output::read_exr;
use whitewater::scene::{SolverKind, Surface};
use whitewater::simd::SimdLevel;
use whitewater::state::{Columns, Encoding, Frame, Particles, save_frame};
use whitewater::surface::audit::Audit;
use whitewater::surface::{
    LANES, LaneHits, LaneRays, LaneSurface, Lattice, SolveCounts, SplineSurface, control, referee,
};

// ---- Surfaces ----

const N: usize = 24;
const EVERYWHERE: [f64; 2] = [0.0, f64::INFINITY];

/// Choppy water over N x N columns.
fn choppy(width: f64, height: f64) -> Columns {
    let mut random = Random::new(9);
    let wave = |k: usize| (0.5 * (k % N) as f64).sin() + (0.4 * (k / N) as f64).cos();
    let top = (0..N * N).map(|k| height * (wave(k) + random.within(-0.3, 0.3))).collect();
    columns(width, top, -4.0 * height)
}

/// Columns with these tops over a level bed, centred around 0.
fn columns(width: f64, top: Vec<f64>, bed: f64) -> Columns {
    let first = -width * (N - 1) as f64 / 2.0;
    Columns {
        origin: [first; 2],
        width: [width; 2],
        nx: N,
        nz: N,
        base: vec![bed; N * N],
        top,
        pressure: vec![0.0; N * N],
        flow: vec![[0.0; 2]; N * N],
    }
}

fn lattice(columns: &Columns, order: u32) -> Lattice {
    let settings = Surface { order, dry_threshold: 0.0, ..Surface::default() };
    control::water(columns, &settings, scene_origin(columns).to_array()).unwrap().unwrap()
}

/// Rays from around and within the surface, some of them along axes; a third of the domain's size away at most.
fn near_rays(lattice: &Lattice, count: usize) -> Vec<(Vec3, Vec3)> {
    let mut random = Random::new(21);
    let [low, high] = lattice.domain.map(|corner| lattice.from_cell(corner));
    let size = high[0] - low[0];
    let [bottom, top] = lattice.extent;
    let tall = (top - bottom).max(0.05 * size);
    (0..count)
        .map(|k| {
            let x = random.within(low[0], high[0]);
            let z = random.within(low[1], high[1]);
            let above = DVec3::new(x, top + random.within(0.05, 0.6) * tall, z);
            let (origin, direction) = match k % 6 {
                0 => (above, DVec3::NEG_Y),
                1 => {
                    let goal = DVec3::new(random.within(low[0], high[0]), bottom, random.within(low[1], high[1]));
                    (above, goal - above)
                }
                2 => (DVec3::new(low[0] - 0.3 * size, random.within(bottom, top), z), DVec3::X),
                3 => (DVec3::new(x, random.within(bottom, top), high[1] + 0.3 * size), DVec3::NEG_Z),
                4 => (DVec3::new(x, bottom - 0.5 * tall, z), DVec3::Y),
                _ => (DVec3::new(x, random.within(bottom, top), z), random.direction() * size),
            };
            (origin.as_vec3(), direction.as_vec3())
        })
        .collect()
}

/// Every solver with every instruction set that it uses here.
fn solvers() -> Vec<(SolverKind, SimdLevel)> {
    let univariate = SimdLevel::ALL.into_iter().filter(|level| level.is_available());
    let others = [(SolverKind::Newton, SimdLevel::Portable), (SolverKind::Reference, SimdLevel::Portable)];
    univariate.map(|level| (SolverKind::Univariate, level)).chain(others).collect()
}

/// Holds every solver's answers against the referee; at least a share of `hits` of the rays must hit.
fn audit(name: &str, columns: &Columns, rays_of: impl Fn(&Lattice) -> Vec<(Vec3, Vec3)>, hits_share: f64) {
    for order in 2..=4 {
        let lattice = lattice(columns, order);
        let rays = rays_of(&lattice);
        for (solver, level) in solvers() {
            let what = format!("{name}, order {order}, {} {}", solver.name(), level.name());
            let surface = SplineSurface::new(lattice.clone(), solver, level);
            let (mut audit, mut counts) = (Audit::default(), SolveCounts::default());
            for packet in rays.chunks(LANES) {
                let mut lanes = LaneRays::unbounded(packet, 0.0);
                for (lane, (_, direction)) in packet.iter().enumerate() {
                    // A millionth of a column, in lengths of the direction.
                    let length = direction.as_dvec3().length();
                    lanes.tolerance[lane] = (1e-6 * columns.width[0] / length).min(f32::MAX.into()) as f32;
                }
                let mut hits = LaneHits::EMPTY;
                surface.closest(&lanes, &mut hits, &mut counts);
                assert_eq!(surface.occluded(&lanes, &mut counts), hits.hit, "{what}: any-hit and first-hit differ");
                for (lane, (origin, direction)) in packet.iter().enumerate() {
                    let (origin, direction) = (origin.as_dvec3(), direction.as_dvec3());
                    let found = (hits.hit >> lane & 1 == 1).then(|| f64::from(hits.t[lane]));
                    // Single precision cannot say t of a far hit finer than this; to within it, it is the exact answer.
                    let found = found.map(|t| match referee::first_hit(&lattice, origin, direction, EVERYWHERE) {
                        Some(exact) if (exact.t - t).abs() <= f64::from(f32::EPSILON) * t.abs() => exact.t,
                        _ => t,
                    });
                    audit.check(&lattice, origin, direction, EVERYWHERE, found);
                }
            }
            assert!(audit.hits as f64 >= hits_share * audit.rays as f64, "{what}: {audit:?}");
            assert_eq!((audit.lost, audit.false_hits, audit.wrong), (0, 0, 0), "{what}: {audit:?}");
            assert!(audit.tangent <= audit.rays / 100, "{what}: {audit:?}");
            assert!(counts.gave_up <= audit.rays / 500, "{what}: gave up on {}", counts.gave_up);
        }
    }
}

#[test]
fn columns_of_a_millimetre_and_of_ten_kilometres() {
    for width in [1e-3, 1e4] {
        audit(&format!("{width} m"), &choppy(width, 0.4 * width), |lattice| near_rays(lattice, 1800), 0.5);
    }
}

#[test]
fn one_column_a_thousand_times_higher_than_its_neighbours() {
    let spike = choppy_with_spike();
    // The scene origin lies half way up the spike.
    let down = DVec3::Y * scene_origin(&spike).y;
    // Rays across the spike, and over the water beside it.
    let rays = |lattice: &Lattice| {
        let mut rays = near_rays(lattice, 900);
        let mut random = Random::new(4);
        rays.extend((0..900).map(|_| {
            let goal = DVec3::new(random.within(-11.0, 11.0), random.within(-1.0, 1.0), random.within(-11.0, 11.0));
            let origin = goal + DVec3::new(random.within(-3.0, 3.0), 4.0, random.within(-3.0, 3.0));
            ((origin - down).as_vec3(), (goal - origin).as_vec3())
        }));
        rays
    };
    audit("spike", &spike, rays, 0.3);
}

fn choppy_with_spike() -> Columns {
    let mut spike = choppy(1.0, 0.3);
    spike.top[N * N / 2 + N / 2] = 1000.0;
    spike
}

#[test]
fn perfectly_flat_water_and_water_of_denormal_height() {
    for height in [0.0, 1.0, 1e-40, -1e-44] {
        let flat = columns(1.0, vec![height; N * N], -1.0);
        audit(&format!("level at {height}"), &flat, |lattice| near_rays(lattice, 1200), 0.3);
    }
    // Ripples that only denormals can tell apart are as good as flat.
    let top = (0..N * N).map(|k| 1e-42 * (k % 7) as f64).collect();
    audit("denormal ripples", &columns(1.0, top, -1.0), |lattice| near_rays(lattice, 1200), 0.3);
}

#[test]
fn a_world_offset_of_a_million_metres() {
    let mut far = choppy(0.5, 0.3);
    far.origin = [1_000_000.3, 4_123_456.7];
    audit("offset", &far, |lattice| near_rays(lattice, 1800), 0.5);
}

#[test]
fn origins_a_million_columns_away() {
    let rays = |lattice: &Lattice| {
        let mut random = Random::new(6);
        let [low, high] = lattice.domain.map(|corner| lattice.from_cell(corner));
        (0..1200)
            .map(|k| {
                let goal = DVec3::new(random.within(low[0], high[0]), 0.0, random.within(low[1], high[1]));
                let mut away = random.direction() * if k % 2 == 0 { 1.0 } else { 1e-3 };
                away.y = away.y.abs() + 0.3 * away.length();
                let away = away / away.length() * 1e6;
                // The rounded origin decides where the ray goes: aim from there.
                let origin = (goal + away).as_vec3();
                (origin, (goal - origin.as_dvec3()).as_vec3() * if k % 3 == 0 { 1e-6 } else { 1.0 })
            })
            .collect()
    };
    audit("far", &choppy(1.0, 0.4), rays, 0.5);
}

#[test]
fn directions_with_denormal_components_and_of_any_length() {
    let rays = |lattice: &Lattice| {
        let mut rays = near_rays(lattice, 1800);
        for (k, (_, direction)) in rays.iter_mut().enumerate() {
            *direction = match k % 3 {
                // As good as along an axis, on either side of it.
                0 => *direction + Vec3::new(1e-40, -1e-42, -1e-45) * if k % 2 == 0 { 1.0 } else { -1.0 },
                1 => *direction * 1e-12,
                _ => *direction * 1e12,
            };
        }
        rays
    };
    audit("denormal directions", &choppy(1.0, 0.4), rays, 0.5);
}

#[test]
fn directions_of_denormal_length_end_without_a_false_hit() {
    // t of such a ray is beyond single precision: a miss is as right as a hit, a wrong hit or no end is not.
    let lattice = lattice(&choppy(1.0, 0.4), 3);
    for (solver, level) in solvers() {
        let surface = SplineSurface::new(lattice.clone(), solver, level);
        let mut lanes = LaneRays::EMPTY;
        for lane in 0..LANES {
            let length = [1e-45, 1e-40, 1.2e-38, 1e-30][lane % 4];
            lanes.origin[1][lane] = 5.0;
            lanes.origin[0][lane] = lane as f32 * 0.3;
            lanes.direction[lane / 4 % 3][lane] = -length;
            lanes.tfar[lane] = f32::INFINITY;
            lanes.tolerance[lane] = 1e-6;
        }
        lanes.active = u16::MAX;
        let mut hits = LaneHits::EMPTY;
        surface.closest(&lanes, &mut hits, &mut SolveCounts::default());
        for lane in (0..LANES).filter(|lane| hits.hit >> lane & 1 == 1) {
            let component = |from: &[[f32; LANES]; 3]| DVec3::from([0, 1, 2].map(|axis| f64::from(from[axis][lane])));
            let (origin, direction) = (component(&lanes.origin), component(&lanes.direction));
            let exact = referee::first_hit(&lattice, origin, direction, EVERYWHERE).expect("a false hit").t;
            let t = f64::from(hits.t[lane]);
            assert!(t == f64::from(f32::MAX) || t.is_infinite() || (t / exact - 1.0).abs() < 1e-4, "{t} for {exact}");
        }
    }
}

// ---- Whole frames ----

/// Renders a frame as a small picture with the program itself and looks at every sample of every channel.
fn render(frame: &Frame, settings: &str) {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let scene = format!(
        "{settings}\n[frames]\nfiles = \"time###.state\"\n[render]\nwidth = 32\nheight = 18\nsamples = 2\ndepth = 4\n"
    );
    std::fs::write(at("scene.toml"), scene).unwrap();
    save_frame(frame, at("time000.state"), Encoding::Npz).unwrap();
    run(folder.path());
    let picture = read_exr(&at("out.exr")).unwrap();
    assert!(picture.channels.len() > 20);
    for channel in &picture.channels {
        assert_eq!(channel.samples.len(), 32 * 18);
        let wrong = channel.samples.iter().filter(|sample| !sample.is_finite()).count();
        assert_eq!(wrong, 0, "{} samples of {} are not finite; {settings}", wrong, channel.name);
    }
}

/// Runs the program, which must end by itself, with success and without dropping a contribution.
fn run(folder: &Path) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_whitewater"));
    command.args(["render", "scene.toml", "-o", "out.exr", "--stats", "stats.json"]).current_dir(folder);
    let log = std::fs::File::create(folder.join("log")).unwrap();
    let mut child = command.env_remove("WHITEWATER_LOG").stderr(log).spawn().unwrap();
    let start = Instant::now();
    let status = loop {
        if let Some(status) = child.try_wait().unwrap() {
            break status;
        }
        if start.elapsed() > Duration::from_secs(60) {
            child.kill().unwrap();
            panic!("no end after a minute");
        }
        std::thread::sleep(Duration::from_millis(10));
    };
    assert!(status.success(), "{}", std::fs::read_to_string(folder.join("log")).unwrap());
    let stats = std::fs::read_to_string(folder.join("stats.json")).unwrap();
    let stats: serde_json::Value = serde_json::from_str(&stats).unwrap();
    assert_eq!(stats["nonfinite"], 0, "contributions were not finite: {stats}");
}

fn still(columns: Columns) -> Frame {
    Frame { columns, ..Frame::default() }
}

fn particles(count: usize, position: [f64; 3]) -> Particles {
    Particles {
        position: vec![position; count],
        velocity: vec![[1.0, 2.0, 3.0]; count],
        mass: vec![0.5; count],
        age: vec![0.1; count],
        id: None,
    }
}

#[test]
fn frames_of_every_size_are_finite() {
    for width in [1e-3, 1.0, 1e4] {
        let mut frame = still(choppy(width, 0.4 * width));
        frame.particles = particles(3, [0.0, width, 0.0]);
        render(&frame, "");
    }
    render(&still(choppy_with_spike()), "");
    let mut pit = choppy_with_spike();
    pit.base[N + 1] = -1e6;
    render(&still(pit), "");
}

#[test]
fn frames_far_from_the_worlds_origin_and_from_the_eye_are_finite() {
    let mut far = choppy(0.5, 0.3);
    far.origin = [1_000_000.3, 4_123_456.7];
    render(&still(far), "");
    let eye = "[camera]\neye = [1e6, 8e5, 0.0]\nlook_at = [0.0, 0.0, 0.0]\nfov = 0.01\n";
    render(&still(choppy(1.0, 0.3)), eye);
}

#[test]
fn flat_dry_and_empty_frames_are_finite() {
    let flat = columns(1.0, vec![0.25; N * N], -1.0);
    render(&still(flat.clone()), "");
    for representation in ["quads", "tessellated"] {
        render(&still(flat.clone()), &format!("[surface]\nrepresentation = \"{representation}\"\n"));
    }
    let dry = Columns { top: flat.base.clone(), ..flat.clone() };
    render(&still(dry.clone()), "");
    render(&still(dry), "[terrain]\nvisible = false\n");
    render(&still(columns(1.0, vec![1e-40; N * N], -1e-3)), "");
    // Water of no depth at all over a bed in the same place.
    render(&still(Columns { base: flat.top.clone(), ..flat }), "[surface]\ndry_threshold = 0.0\n");
}

#[test]
fn eyes_on_edges_and_rays_along_axes_are_finite() {
    let flat = || still(columns(1.0, vec![0.25; N * N], -1.0));
    let camera = |eye: [f64; 3], look_at: [f64; 3], up: [f64; 3]| {
        format!("[camera]\neye = {eye:?}\nlook_at = {look_at:?}\nup = {up:?}\n")
    };
    // Straight down, through the water's surface from within it, along the surface, from below, on the bed, on a wall.
    render(&flat(), &camera([0.0, 5.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, -1.0]));
    render(&flat(), &camera([0.0, -0.5, 0.0], [0.0, 5.0, 0.0], [1.0, 0.0, 0.0]));
    render(&flat(), &camera([0.0, 0.25, 0.0], [1.0, 0.25, 0.0], [0.0, 1.0, 0.0]));
    render(&flat(), &camera([0.0, -0.5, 0.0], [1.0, -0.5, 0.0], [0.0, 1.0, 0.0]));
    render(&flat(), &camera([0.0, -1.0, 0.0], [0.0, -1.0, 1.0], [0.0, 1.0, 0.0]));
    render(&flat(), &camera([-12.0, -0.5, 0.0], [-12.0, -0.5, 1.0], [0.0, 1.0, 0.0]));
}

#[test]
fn a_million_particles_in_one_point_are_a_picture() {
    let mut frame = still(choppy(1.0, 0.3));
    frame.particles = particles(1_000_000, [0.5, 1.0, 0.5]);
    render(&frame, "");
}
