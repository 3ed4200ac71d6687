//! What share of a frame's time its own rays take: they are recorded as the frame asks for them, then replayed through
//! the accelerator alone. One thread, so that both times are of the same work.

use std::hint::black_box;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

use super::{across, pool};
use crate::accel::{AccelStats, Accelerator, HitBatch, RayBatch};
use crate::bench::pictures::{self, Built};
use crate::bench::rows::Row;
use crate::bench::sheet::{Sheet, number};
use crate::bench::{BenchError, Settings, median, size_name};
use crate::scene::{Caustics, Integrator, Scene};
use crate::state::Frame;
use crate::surface::SolveCounts;
use crate::surface::audit::Audit;

/// Calls in their order: whether any hit answers, and the rays.
type Calls = Vec<(bool, RayBatch)>;

/// Hands every call on, and keeps its rays.
struct Recorder {
    inner: Box<dyn Accelerator>,
    calls: Arc<Mutex<Calls>>,
}

impl Recorder {
    fn record(&self, any: bool, rays: &RayBatch) {
        // Only a panic of another thread while it pushes could poison it; what was pushed before is still right.
        self.calls.lock().unwrap_or_else(PoisonError::into_inner).push((any, rays.clone()));
    }
}

impl Accelerator for Recorder {
    fn closest(&self, rays: &RayBatch, hits: &mut HitBatch, counts: &mut SolveCounts) {
        self.record(false, rays);
        self.inner.closest(rays, hits, counts);
    }
    fn occluded(&self, rays: &RayBatch, occluded: &mut Vec<bool>, counts: &mut SolveCounts) {
        self.record(true, rays);
        self.inner.occluded(rays, occluded, counts);
    }
    fn stats(&self) -> AccelStats {
        self.inner.stats()
    }
    fn audit(&self) -> Option<Audit> {
        self.inner.audit()
    }
}

/// Seconds that an accelerator takes for the calls, one after the other.
fn replay(accel: &dyn Accelerator, calls: &Calls) -> f64 {
    let (mut hits, mut occluded, mut counts) = (HitBatch::default(), Vec::new(), SolveCounts::default());
    let start = Instant::now();
    for (any, rays) in calls {
        if *any {
            accel.occluded(rays, &mut occluded, &mut counts);
            black_box(&occluded);
        } else {
            accel.closest(rays, &mut hits, &mut counts);
            black_box(&hits);
        }
    }
    black_box(counts);
    start.elapsed().as_secs_f64()
}

/// A frame's time and where it goes.
struct Profile {
    rays: usize,
    calls: usize,
    /// Of the frame, and of its rays alone.
    seconds: [f64; 2],
    /// Seconds of the same with a single pixel: what a frame takes before its first ray, however large it is.
    set_up: f64,
    /// The latter over the former, median of the rounds'.
    share: f64,
    accel: String,
}

fn measure(scene: &Scene, frame: &Frame, settings: &Settings) -> Result<Profile, BenchError> {
    let settings = Settings { threads: 1, ..settings.clone() };
    let mut built = Built::new(scene, frame, &settings)?;
    let calls = Arc::new(Mutex::new(Calls::new()));
    let plain = Built::new(scene, frame, &settings)?;
    built.accel = Box::new(Recorder { inner: built.accel, calls: Arc::clone(&calls) });
    built.render(frame, &settings)?;
    let calls = std::mem::take(&mut *calls.lock().unwrap_or_else(PoisonError::into_inner));
    let mut pixel = scene.clone();
    (pixel.render.width, pixel.render.height, pixel.render.samples) = (1, 1, 1);
    let pixel = Built::new(&pixel, frame, &settings)?;
    let (mut frames, mut rays, mut shares, mut set_ups) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for round in 0..=settings.rounds() {
        let (_, whole) = plain.render(frame, &settings)?;
        let (_, set_up) = pixel.render(frame, &settings)?;
        let alone = replay(&*plain.accel, &calls);
        // The first round warms caches and clocks.
        if round > 0 {
            frames.push(whole);
            rays.push(alone);
            shares.push(alone / whole);
            set_ups.push(set_up);
        }
    }
    Ok(Profile {
        rays: calls.iter().map(|(_, rays)| rays.len()).sum(),
        calls: calls.len(),
        seconds: [median(&mut frames), median(&mut rays)],
        set_up: median(&mut set_ups),
        share: median(&mut shares),
        accel: plain.accel.stats().name,
    })
}

const CASES: [(&str, Integrator, Caustics); 3] = [
    ("whitted", Integrator::Whitted, Caustics::Off),
    ("path", Integrator::Path, Caustics::Off),
    ("path, manifold", Integrator::Path, Caustics::Manifold),
];

pub(super) fn run(settings: &Settings, sheet: &mut Sheet) -> Result<(), BenchError> {
    let across = across(settings, 96, 320);
    let size = [across, across * 9 / 16];
    let columns = settings.sizes.first().copied().unwrap_or([80, 20]);
    let river = pictures::frame(columns, 2_800);
    let scenes = [("small water", pictures::scene(&river, size), river), ("pool", pool::view(size), pool::frame())];
    sheet.say(&format!(
        "\nA frame's own rays replayed through the accelerator alone, {across} pixels across, four samples a pixel, one thread"
    ))?;
    sheet.table(&["frame", "integrator", "seconds", "set-up", "rays alone", "share", "rays", "rays a call"])?;
    for (name, scene, frame) in &scenes {
        for (case, integrator, caustics) in CASES {
            let mut scene = scene.clone();
            (scene.render.integrator, scene.render.caustics) = (integrator, Some(caustics));
            scene.render.samples = 4;
            let profile = measure(&scene, frame, settings)?;
            let row = Row {
                bench: "light-profile".to_owned(),
                columns: size_name([frame.columns.nx, frame.columns.nz]),
                accel: profile.accel,
                rays: (*name).to_owned(),
                dial: case.to_owned(),
                value: profile.rays as f64,
                seconds: profile.seconds[0],
                build_ms: 1e3 * profile.set_up,
                mrays_per_s: profile.rays as f64 / profile.seconds[1] / 1e6,
                ratio: profile.share,
                particles: frame.particles.position.len(),
                threads: 1,
                ..Row::default()
            };
            let mut cells = vec![(*name).to_owned(), case.to_owned()];
            cells.extend([profile.seconds[0], profile.set_up, profile.seconds[1]].map(number));
            cells.push(format!("{:.0}%", 100.0 * profile.share));
            cells.extend([profile.rays.to_string(), (profile.rays / profile.calls.max(1)).to_string()]);
            sheet.row(&cells, row)?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_of_a_frames_rays_are_replayed() {
        let settings = Settings { quick: true, ..Settings::default() };
        let frame = pictures::frame([40, 20], 300);
        let rays = |samples: u32, integrator: Integrator| {
            let mut scene = pictures::scene(&frame, [32, 16]);
            (scene.render.samples, scene.render.integrator) = (samples, integrator);
            let profile = measure(&scene, &frame, &settings).unwrap();
            assert!(profile.set_up > 0.0 && profile.share > 0.0 && profile.seconds[1] > 0.0 && profile.calls > 1);
            let built = Built::new(&scene, &frame, &settings).unwrap();
            let asked = built.render_counted(&frame, &settings).unwrap().1.rays;
            assert!(profile.rays as u64 >= asked.primary, "{asked:?}");
            profile.rays
        };
        let (one, four) = (rays(1, Integrator::Path), rays(4, Integrator::Path));
        assert!(one > 512 && (3 * one..5 * one).contains(&four), "{one} {four}");
    }
}
