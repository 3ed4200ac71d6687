//! One picture from end to end: everything it needs in one plain struct, a picture and what it took out.

use std::{
    sync::{
        Mutex,
        atomic::{AtomicBool, AtomicU64, Ordering},
    },
    time::Instant,
};

use super::{
    Camera, CameraPath, Matter, Observer, RayCounts, RenderError,
    batches::Scratch,
    film::{Film, View},
    tiles,
    world::World,
};
use crate::{
    accel::Accelerator,
    lower::Lowered,
    optics::Sky,
    output::{Metadata, Picture, Window},
    scene::Scene,
    surface::SolveCounts,
};

/// Everything that a picture is made of.
#[derive(Clone, Copy)]
pub struct Job<'a> {
    /// Settings: water, sun, lights, sky's visibility, camera's lens, tolerance, size, samples, filter, seed, depth.
    pub scene: &'a Scene,
    /// What can be hit.
    pub lowered: &'a Lowered,
    /// Who finds the hits; built over the same `lowered`.
    pub accelerator: &'a dyn Accelerator,
    /// The look of ground and spray, the heights of water and bed.
    pub matter: &'a dyn Matter,
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
/// *Errors*: [`RenderError::EmptyWindow`], [`RenderError::Threads`].
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
    let camera = |frame: i64| Camera::new(job.path.pose(frame as f64), size, job.scene.camera.f_number);
    let world = World::new(job.scene, job.lowered, job.accelerator, job.matter, job.sky, camera(job.frame));
    let view = View {
        camera: world.camera,
        next: camera(job.frame + 1),
        previous: camera(job.frame - 1),
        origin: job.lowered.origin,
        fps: job.scene.frames.fps,
        samples: world.sampler.samples(),
    };

    let windows = tiles::tiles(data);
    let total = windows.len() as u64;
    let film = Mutex::new(Film::new(data));
    let (done, rays) = (AtomicU64::new(0), AtomicU64::new(0));
    let scratches = tiles::for_each(&windows, job.threads, stop, Scratch::default, |window, scratch| {
        let before = scratch.counts.total();
        world.render_tile(*window, scratch);
        scratch.film.resolve(&view, &mut scratch.pixels);
        scratch.nonfinite += scratch.film.nonfinite;
        // Poisoned only if another thread panicked, and then that panic is on its way to the caller anyway.
        film.lock().unwrap_or_else(|poison| poison.into_inner()).place(*window, &scratch.pixels);
        let traced = scratch.counts.total() - before;
        let rays = rays.fetch_add(traced, Ordering::Relaxed) + traced;
        observer.tiles(done.fetch_add(1, Ordering::Relaxed) + 1, total, rays);
    })?;

    let mut stats = RenderStats {
        tiles_done: done.into_inner(),
        tiles: total,
        threads: scratches.len(),
        seconds: start.elapsed().as_secs_f64(),
        ..RenderStats::default()
    };
    for scratch in scratches {
        stats.rays += scratch.counts;
        stats.solve += scratch.solve;
        stats.nonfinite += scratch.nonfinite;
    }
    let film = film.into_inner().unwrap_or_else(|poison| poison.into_inner());
    let complete = stats.tiles_done == total;
    let metadata = metadata(job, &world.camera, stats.seconds, complete);
    Ok((Picture { display: size, data, channels: film.into_channels(), metadata }, stats))
}

fn metadata(job: &Job, camera: &Camera, seconds: f64, complete: bool) -> Metadata {
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
        samples: scene.render.samples,
        solver: scene.surface.solver.name().to_owned(),
        tolerance: match scene.surface.tolerance {
            Some(metres) => format!("{metres} m"),
            None => format!("{} px", scene.surface.accuracy),
        },
        seconds,
        complete,
        ..Metadata::default()
    }
}
