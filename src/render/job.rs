//! One picture from end to end: everything it needs in one plain struct, a picture and what it took out.

use std::{
    sync::{
        Mutex,
        atomic::{AtomicBool, AtomicU64, Ordering},
    },
    time::Instant,
};

use super::{
    Camera, CameraPath, Matter, Mattes, Observer, PathCounts, RayCounts, RenderError,
    batches::Scratch,
    cryptomatte::Names,
    film::{Film, FilmTile, View},
    tiles,
    wave::Frame,
    world::{Shared, World, groups},
};
use crate::{
    accel::Accelerator,
    lower::Lowered,
    optics::Sky,
    output::{Metadata, Picture, Window},
    scene::Scene,
    surface::{SolveCounts, SplineSurface},
};

/// Everything that a picture is made of.
#[derive(Clone, Copy)]
pub struct Job<'a> {
    /// Settings: water, sun, lights, sky's visibility, camera's lens, tolerance, size, samples, filter, seed, depth.
    pub scene: &'a Scene,
    /// What there is at the moments of the shutter, at least one; samples are shared out among them.
    pub moments: &'a [Moment<'a>],
    /// The sky.
    pub sky: &'a Sky,
    /// The camera over frames.
    pub path: &'a CameraPath,
    /// Frame number.
    pub frame: i64,
    /// Part of the full frame to render, or beyond it (overscan); `None` is all of it.
    pub crop: Option<Window>,
    /// Threads; 0 is one per processor.
    pub threads: usize,
    /// Cryptomatte layers.
    pub mattes: Mattes,
    /// Metres to the right of the camera's path at which the eye is: one of a pair.
    pub aside: f64,
}

impl Job<'_> {
    /// The camera so many frames after the frame's own time.
    pub(super) fn camera(&self, time: f64) -> Camera {
        let (lens, settings) = (&self.scene.camera, &self.scene.render);
        Camera::new(self.path.pose(self.frame as f64 + time), (settings.width, settings.height), lens.f_number)
            .with_pixel_aspect(lens.pixel_aspect)
            .aside(self.aside)
    }
}

/// What there is at one moment of the shutter.
#[derive(Clone, Copy)]
pub struct Moment<'a> {
    /// Frames after the frame's own time.
    pub time: f64,
    /// What can be hit.
    pub lowered: &'a Lowered,
    /// Who finds the hits; built over the same `lowered`.
    pub accelerator: &'a dyn Accelerator,
    /// The look of ground and spray, the heights of water and bed.
    pub matter: &'a dyn Matter,
    /// The water as a spline, for what bends light to a point; `None` without water.
    pub water: Option<&'a SplineSurface>,
}

/// What a picture took.
#[derive(Clone, Debug, Default, serde::Serialize)]
pub struct RenderStats {
    /// Rays by kind.
    pub rays: RayCounts,
    /// The surface solver's work.
    pub solve: SolveCounts,
    /// Contributions dropped since they were not finite; 0 unless something is wrong.
    pub nonfinite: u64,
    /// What the path tracer counted.
    pub paths: PathCounts,
    /// Samples of all pixels.
    pub samples: u64,
    /// Passes over the whole picture; more than one only under a time limit.
    pub passes: u32,
    /// Tiles finished.
    pub tiles_done: u64,
    /// Tiles in all.
    pub tiles: u64,
    /// Threads that worked.
    pub threads: usize,
    /// Seconds from the first ray to the last pixel.
    pub seconds: f64,
}

/// Renders one picture.
///
/// When `stop` becomes true, tiles under way are finished, the rest of the pixels stay 0 in every channel, and the
/// picture says that it is not complete. Everything but the seconds is the same to the bit for any count of threads, and
/// a crop has the bits of the same pixels of the full frame.
///
/// The metadata that the renderer does not know (owner, comments, the scene's hash) is left empty.
///
/// With `render.seconds` the time decides how many samples each pixel gets, and only that.
///
/// *Errors*: [`RenderError::EmptyWindow`], [`RenderError::NoMoment`], [`RenderError::Threads`].
pub fn render_frame(
    job: &Job,
    stop: &AtomicBool,
    observer: &dyn Observer,
) -> Result<(Picture, RenderStats), RenderError> {
    let start = Instant::now();
    let settings = &job.scene.render;
    let size = (settings.width, settings.height);
    let data = job.crop.unwrap_or(Window { x: 0, y: 0, width: size.0, height: size.1 });
    if data.width == 0 || data.height == 0 {
        let Window { x, y, width, height } = data;
        return Err(RenderError::EmptyWindow { x, y, width, height });
    }
    if job.moments.is_empty() {
        return Err(RenderError::NoMoment);
    }
    let camera = |time: f64| job.camera(time);
    let shared = Shared::new(job.scene, job.sky);
    let mut names = Names::new(job.mattes);
    let moments = job
        .moments
        .iter()
        .map(|moment| World::new(job.scene, &shared, moment, job.sky, camera(moment.time), &mut names));
    let frame = Frame {
        moments: moments.collect::<Result<_, _>>()?,
        first: if settings.seconds.is_some() { 1 } else { settings.samples },
        least: settings.samples,
        noise: settings.noise,
    };
    let view = View {
        camera: camera(0.0),
        next: camera(1.0),
        previous: camera(-1.0),
        origin: job.moments[0].lowered.origin,
        fps: job.scene.frames.fps,
        names,
    };
    let groups = groups(job.scene);
    let windows = tiles::tiles(data);
    let film = Mutex::new(Film::new(data, &groups, job.mattes));
    let place = |scratch: &mut Scratch| {
        scratch.film.resolve(&view, &mut scratch.pixels);
        // Poisoned only if another thread panicked, and then that panic is on its way to the caller anyway.
        film.lock().unwrap_or_else(|poison| poison.into_inner()).place(scratch.film.window, &scratch.pixels);
    };
    let stats = match settings.seconds {
        None => whole_tiles(job, &frame, &windows, groups.len(), stop, observer, place)?,
        Some(seconds) => {
            let deadline = Deadline { start, seconds };
            passes(job, &frame, &windows, groups.len(), deadline, stop, observer, place)?
        }
    };
    let stats = RenderStats { seconds: start.elapsed().as_secs_f64(), ..stats };
    let film = film.into_inner().unwrap_or_else(|poison| poison.into_inner());
    let metadata = Metadata { cryptomattes: view.names.cryptomattes(), ..metadata(job, &view.camera, &stats) };
    Ok((Picture { display: size, data, channels: film.into_channels(), metadata }, stats))
}

/// Every tile to its end, one after another.
fn whole_tiles(
    job: &Job,
    frame: &Frame,
    windows: &[Window],
    groups: usize,
    stop: &AtomicBool,
    observer: &dyn Observer,
    place: impl Fn(&mut Scratch) + Sync,
) -> Result<RenderStats, RenderError> {
    let total = windows.len() as u64;
    let (done, rays) = (AtomicU64::new(0), AtomicU64::new(0));
    let scratches = tiles::for_each(windows, job.threads, stop, Scratch::default, |window, scratch| {
        let before = scratch.counts.total();
        scratch.film.reset(*window, groups);
        for range in frame.steps() {
            if !frame.render(range, scratch) {
                break;
            }
        }
        place(scratch);
        scratch.tally();
        let traced = scratch.counts.total() - before;
        let rays = rays.fetch_add(traced, Ordering::Relaxed) + traced;
        observer.tiles(done.fetch_add(1, Ordering::Relaxed) + 1, total, rays);
    })?;
    let mut stats = RenderStats { tiles_done: done.into_inner(), tiles: total, passes: 1, ..RenderStats::default() };
    stats.add(&scratches);
    Ok(stats)
}

/// A time limit.
#[derive(Clone, Copy)]
struct Deadline {
    start: Instant,
    seconds: f64,
}

/// Pass after pass over all tiles, until every pixel is good enough or the time is over. The first pass is always
/// finished, so that every pixel has a sample.
#[allow(clippy::too_many_arguments)]
fn passes(
    job: &Job,
    frame: &Frame,
    windows: &[Window],
    groups: usize,
    deadline: Deadline,
    stop: &AtomicBool,
    observer: &dyn Observer,
    place: impl Fn(&mut Scratch) + Sync,
) -> Result<RenderStats, RenderError> {
    let total = windows.len() as u64;
    let films: Vec<Mutex<FilmTile>> = windows
        .iter()
        .map(|window| {
            let mut film = FilmTile::default();
            film.reset(*window, groups);
            Mutex::new(film)
        })
        .collect();
    let swap = |tile: usize, scratch: &mut Scratch| {
        std::mem::swap(&mut scratch.film, &mut *films[tile].lock().unwrap_or_else(|poison| poison.into_inner()));
    };
    let tiles: Vec<usize> = (0..films.len()).collect();
    let (rays, mut stats) = (AtomicU64::new(0), RenderStats { tiles: total, ..RenderStats::default() });
    for (pass, range) in frame.steps().enumerate() {
        let (done, work) = (AtomicU64::new(0), AtomicBool::new(false));
        let scratches = tiles::for_each(&tiles, job.threads, stop, Scratch::default, |&tile, scratch| {
            let elapsed = deadline.start.elapsed().as_secs_f64();
            if pass > 0 && elapsed >= deadline.seconds {
                return;
            }
            let before = scratch.counts.total();
            swap(tile, scratch);
            if frame.render(range.clone(), scratch) {
                work.store(true, Ordering::Relaxed);
            }
            swap(tile, scratch);
            done.fetch_add(1, Ordering::Relaxed);
            let traced = scratch.counts.total() - before;
            let rays = rays.fetch_add(traced, Ordering::Relaxed) + traced;
            observer.time(elapsed.min(deadline.seconds), deadline.seconds, rays);
        })?;
        stats.add(&scratches);
        stats.passes += 1;
        if pass == 0 {
            stats.tiles_done = done.into_inner();
        }
        let over = deadline.start.elapsed().as_secs_f64() >= deadline.seconds;
        if over || stop.load(Ordering::Relaxed) || !work.into_inner() {
            break;
        }
    }
    let scratches =
        tiles::for_each(&tiles, job.threads, &AtomicBool::new(false), Scratch::default, |&tile, scratch| {
            swap(tile, scratch);
            place(scratch);
            scratch.tally();
        })?;
    let threads = stats.threads;
    stats.add(&scratches);
    // A picture whose user stopped it is not what was asked for, though every pixel has something.
    if stop.load(Ordering::Relaxed) {
        stats.tiles_done = stats.tiles_done.min(total - 1);
    }
    Ok(RenderStats { threads, ..stats })
}

impl std::ops::AddAssign for RenderStats {
    /// Another picture of the same frame.
    fn add_assign(&mut self, other: Self) {
        self.rays += other.rays;
        self.solve += other.solve;
        self.nonfinite += other.nonfinite;
        self.paths += other.paths;
        self.samples += other.samples;
        self.passes = self.passes.max(other.passes);
        self.tiles_done += other.tiles_done;
        self.tiles += other.tiles;
        self.threads = self.threads.max(other.threads);
        self.seconds += other.seconds;
    }
}

impl RenderStats {
    fn add(&mut self, scratches: &[Scratch]) {
        self.threads = scratches.len();
        for scratch in scratches {
            self.rays += scratch.counts;
            self.solve += scratch.solve;
            self.paths += scratch.paths;
            self.nonfinite += scratch.nonfinite;
            self.samples += scratch.taken;
        }
    }
}

fn metadata(job: &Job, camera: &Camera, stats: &RenderStats) -> Metadata {
    let scene = job.scene;
    Metadata {
        world_to_camera: camera.world_to_camera(),
        world_to_ndc: camera.world_to_ndc(),
        camera_to_world: camera.camera_to_world(),
        fps: scene.frames.fps,
        frame: job.frame,
        exposure_time: scene.camera.shutter / scene.frames.fps,
        f_number: camera.f_number,
        focus: camera.pose.focus,
        focal_length: camera.focal_length(),
        pixel_aspect: scene.camera.pixel_aspect,
        samples: scene.render.most_samples(),
        solver: scene.surface.solver.name().to_owned(),
        tolerance: match scene.surface.tolerance {
            Some(metres) => format!("{metres} m"),
            None => format!("{} px", scene.surface.accuracy),
        },
        seconds: stats.seconds,
        complete: stats.tiles_done == stats.tiles,
        ..Metadata::default()
    }
}
