//! One picture from end to end: everything it needs in one plain struct, a picture and what it took out.

use std::{
    sync::{
        Mutex,
        atomic::{AtomicBool, AtomicU64, Ordering},
    },
    time::Instant,
};

use super::{
    Camera, CameraPath, Keeping, Matter, Mattes, Observer, PathCounts, RayCounts, RenderError, Sampler,
    batches::Scratch,
    checkpoint::{Header, Keeper},
    cryptomatte::Names,
    film::{Film, FilmTile, View},
    plan::Plan,
    shares, tiles,
    wave::Frame,
    world::{Shared, World, groups},
};
use crate::{
    accel::Accelerator,
    lower::Lowered,
    optics::Sky,
    output::{Metadata, Picture, Portion, Window},
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

/// What of a frame is rendered, and how it is kept on the way. By default all of it, kept nowhere.
#[derive(Clone, Debug, Default)]
pub struct Task<'a> {
    /// Which share of the tiles, from 1, and of how many.
    pub tile: Option<(u32, u32)>,
    /// First sample of each pixel, and the one after the last.
    pub samples: Option<[u32; 2]>,
    /// Where the state of every pixel is kept.
    pub keeping: Option<&'a Keeping>,
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
    render_part(job, &Task::default(), stop, observer)
}

/// Renders a part of a picture as [`render_frame`] renders all of it. The data window is the least around the part's tiles;
/// pixels of other tiles in it are 0 in every channel.
///
/// With a checkpoint to go on from, the pixels are those of a render that was never stopped.
///
/// *Errors*: those of [`render_frame`]; [`RenderError::EmptyShare`], [`RenderError::SampleRange`],
/// [`RenderError::Checkpoint`].
pub fn render_part(
    job: &Job,
    task: &Task,
    stop: &AtomicBool,
    observer: &dyn Observer,
) -> Result<(Picture, RenderStats), RenderError> {
    let start = Instant::now();
    let settings = &job.scene.render;
    let size = (settings.width, settings.height);
    let whole = job.crop.unwrap_or(Window { x: 0, y: 0, width: size.0, height: size.1 });
    let (index, count) = task.tile.unwrap_or((1, 1));
    let portion = Portion { index, count, whole, samples: task.samples };
    let windows = shares::tiles_of(&portion)?;
    let data = shares::around(&windows).unwrap_or(whole);
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
    let frame = Frame { moments: moments.collect::<Result<_, _>>()?, plan: plan(job.scene, task.samples)? };
    let view = View {
        camera: camera(0.0),
        next: camera(1.0),
        previous: camera(-1.0),
        origin: job.moments[0].lowered.origin,
        fps: job.scene.frames.fps,
        names,
    };
    let groups = groups(job.scene);
    let metadata = Metadata {
        portion: (task.tile.is_some() || task.samples.is_some()).then_some(portion),
        cryptomattes: view.names.cryptomattes(),
        ..metadata(job, &view.camera)
    };
    let keeper = task.keeping.map(|keeping| {
        let header = Header {
            identity: keeping.identity.clone(),
            frame: job.frame,
            size: size.into(),
            portion,
            plan: frame.plan,
            groups: groups.clone(),
            view: view.clone(),
            metadata: Metadata {
                scene_hash: keeping.scene_hash.clone(),
                owner: keeping.owner.clone(),
                comments: keeping.comments.clone(),
                ..metadata.clone()
            },
        };
        Keeper::new(keeping, header, windows.len())
    });
    let keeper = keeper.transpose()?;
    if let Some(keeper) = &keeper {
        // Now, since a thread at work has nobody to tell.
        (0..windows.len()).try_for_each(|tile| keeper.blocks(tile).map(drop))?;
    }
    let spent = keeper.as_ref().map_or(0.0, |keeper| keeper.spent);
    let work = Work { job, frame, windows: &windows, groups: groups.len(), keeper: keeper.as_ref(), stop, observer };
    let film = Mutex::new(Film::new(data, &groups, job.mattes));
    let place = |scratch: &mut Scratch| {
        scratch.total.resolve(&view, &mut scratch.pixels);
        show(observer, &scratch.total);
        // Poisoned only if another thread panicked, and then that panic is on its way to the caller anyway.
        film.lock().unwrap_or_else(|poison| poison.into_inner()).place(scratch.total.window, &scratch.pixels);
    };
    let stats = match settings.seconds {
        None => work.whole_tiles(place)?,
        Some(seconds) => work.passes(Deadline { start, spent, seconds }, place)?,
    };
    let stats = RenderStats { seconds: start.elapsed().as_secs_f64(), ..stats };
    let complete = stats.tiles_done == stats.tiles;
    if let Some(keeper) = &keeper {
        keeper.finish(complete);
    }
    let film = film.into_inner().unwrap_or_else(|poison| poison.into_inner());
    let metadata = Metadata { seconds: spent + stats.seconds, complete, ..metadata };
    Ok((Picture { display: size, data, channels: film.into_channels(), metadata }, stats))
}

/// Gives a tile's pixels to who watches.
fn show(observer: &dyn Observer, tile: &FilmTile) {
    if observer.wants_pixels() {
        observer.pixels(tile.window, tile.beauties());
    }
}

/// When a pixel has had enough.
fn plan(scene: &Scene, samples: Option<[u32; 2]>) -> Result<Plan, RenderError> {
    let settings = &scene.render;
    let sampler = Sampler::new(settings);
    let most = sampler.samples();
    let plan = Plan {
        first: if settings.seconds.is_some() { 1 } else { settings.samples },
        least: settings.samples,
        most,
        noise: settings.noise,
        run: sampler.run_length(),
        range: [0, most],
    };
    samples.map_or(Ok(plan), |range| plan.within(range))
}

/// A picture under way.
struct Work<'a> {
    job: &'a Job<'a>,
    frame: Frame<'a>,
    windows: &'a [Window],
    /// Light groups.
    groups: usize,
    keeper: Option<&'a Keeper<'a>>,
    stop: &'a AtomicBool,
    observer: &'a dyn Observer,
}

/// A time limit.
#[derive(Clone, Copy)]
struct Deadline {
    start: Instant,
    /// Seconds that a render before this one took for the same picture.
    spent: f64,
    seconds: f64,
}

impl Deadline {
    fn elapsed(&self) -> f64 {
        self.spent + self.start.elapsed().as_secs_f64()
    }
}

impl Work<'_> {
    /// The sums that a tile goes on from.
    fn before(&self, tile: usize) -> Option<Vec<FilmTile>> {
        self.keeper.and_then(|keeper| keeper.blocks(tile).ok().flatten())
    }

    /// Every tile to its end, one after another.
    fn whole_tiles(&self, place: impl Fn(&mut Scratch) + Sync) -> Result<RenderStats, RenderError> {
        let tiles: Vec<usize> = (0..self.windows.len()).collect();
        let total = tiles.len() as u64;
        let plan = &self.frame.plan;
        // Blocks of later samples are joined to earlier ones one by one: until then they stay apart.
        let apart = plan.range[0] > 0;
        let (done, rays) = (AtomicU64::new(0), AtomicU64::new(0));
        let scratches = tiles::for_each(&tiles, self.job.threads, self.stop, Scratch::default, |&tile, scratch| {
            let before = scratch.counts.total();
            scratch.start(self.windows[tile], self.groups, self.before(tile));
            let mut worked = false;
            for range in plan.steps() {
                if self.frame.render(range.clone(), scratch) {
                    worked = true;
                    if apart {
                        scratch.blocks.push(scratch.film.clone());
                    }
                    if let Some(keeper) = self.keeper.filter(|keeper| keeper.is_due()) {
                        keeper.keep(tile, scratch.kept(apart));
                    }
                } else if plan.range[0] + scratch.total.greatest_samples() <= range.start {
                    break;
                }
            }
            if let Some(keeper) = self.keeper.filter(|_| worked) {
                keeper.keep(tile, scratch.kept(apart));
            }
            place(scratch);
            scratch.tally();
            let traced = scratch.counts.total() - before;
            let rays = rays.fetch_add(traced, Ordering::Relaxed) + traced;
            self.observer.tiles(done.fetch_add(1, Ordering::Relaxed) + 1, total, rays);
        })?;
        let mut stats =
            RenderStats { tiles_done: done.into_inner(), tiles: total, passes: 1, ..RenderStats::default() };
        stats.add(&scratches);
        Ok(stats)
    }

    /// Pass after pass over all tiles, until every pixel is good enough or the time is over. The first pass is always
    /// finished, so that every pixel has a sample.
    fn passes(&self, deadline: Deadline, place: impl Fn(&mut Scratch) + Sync) -> Result<RenderStats, RenderError> {
        let (job, stop, total) = (self.job, self.stop, self.windows.len() as u64);
        let mut reached = 0;
        let films: Vec<Mutex<FilmTile>> = (0..self.windows.len())
            .map(|tile| {
                let mut scratch = Scratch::default();
                scratch.start(self.windows[tile], self.groups, self.before(tile));
                reached = reached.max(scratch.total.greatest_samples());
                Mutex::new(scratch.total)
            })
            .collect();
        let swap = |tile: usize, scratch: &mut Scratch| {
            std::mem::swap(&mut scratch.total, &mut *films[tile].lock().unwrap_or_else(|poison| poison.into_inner()));
        };
        let tiles: Vec<usize> = (0..films.len()).collect();
        let (rays, mut stats) = (AtomicU64::new(0), RenderStats { tiles: total, ..RenderStats::default() });
        for (pass, range) in self.frame.plan.steps().enumerate() {
            let (done, work) = (AtomicU64::new(0), AtomicBool::new(false));
            let scratches = tiles::for_each(&tiles, job.threads, stop, Scratch::default, |&tile, scratch| {
                let elapsed = deadline.elapsed();
                if pass > 0 && elapsed >= deadline.seconds {
                    return;
                }
                let before = scratch.counts.total();
                swap(tile, scratch);
                if self.frame.render(range.clone(), scratch) {
                    work.store(true, Ordering::Relaxed);
                    if let Some(keeper) = self.keeper.filter(|keeper| keeper.is_old(tile)) {
                        keeper.keep(tile, scratch.kept(false));
                    }
                }
                show(self.observer, &scratch.total);
                swap(tile, scratch);
                done.fetch_add(1, Ordering::Relaxed);
                let traced = scratch.counts.total() - before;
                let rays = rays.fetch_add(traced, Ordering::Relaxed) + traced;
                self.observer.time(elapsed.min(deadline.seconds), deadline.seconds, rays);
            })?;
            stats.add(&scratches);
            stats.passes += 1;
            if pass == 0 {
                stats.tiles_done = done.into_inner();
            }
            let over = deadline.elapsed() >= deadline.seconds;
            if over || stop.load(Ordering::Relaxed) || !(work.into_inner() || range.start < reached) {
                break;
            }
        }
        let stopped = stop.load(Ordering::Relaxed);
        let scratches =
            tiles::for_each(&tiles, job.threads, &AtomicBool::new(false), Scratch::default, |&tile, scratch| {
                swap(tile, scratch);
                if let Some(keeper) = self.keeper.filter(|keeper| stopped || keeper.keeps()) {
                    keeper.keep(tile, scratch.kept(false));
                }
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

fn metadata(job: &Job, camera: &Camera) -> Metadata {
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
        ..Metadata::default()
    }
}
