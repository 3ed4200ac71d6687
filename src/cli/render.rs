//! `whitewater render`: a scene's frames, one after another, each to its files.

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::Context;
use glam::DVec3;

use super::args::RenderArgs;
use super::errors::{CliError, Outcome};
use super::finished;
use super::foam;
use super::keep;
use super::load;
use super::look::local_now;
use super::moments::{self, MomentOfFrame};
use super::prepare::{Run, deep_outputs, prepare};
use super::progress::Progress;
use super::signals::StopFlag;
use super::stats::{FrameStats, RunStats, part_names};
use super::values::Bytes;
use super::watch::Watch;
use crate::denoise::DenoiseReport;
use crate::foam::{FoamField, FoamState};
use crate::lower::LoweredFrame;
use crate::output::{self, Claim, DeepPicture, Metadata, Picture, Window, WriteOptions, WriteReport, layers, naming};
use crate::particles::Textures;
use crate::render::{self, Job, Looks, Mattes, RenderStats, Task};
use crate::scene::{self};
use crate::state::Frame;
use crate::terrain::{Ground, GroundTexture, PlacedTexture, SkyView, Waterline};

/// Runs the command.
///
/// # Errors
/// Whatever can be known before the first frame; and a frame's own error if it was the only one.
pub fn run(arguments: &RenderArgs) -> Result<Outcome, CliError> {
    let stop = StopFlag::install().map_err(CliError::Signals)?;
    let start = Instant::now();
    let run = prepare(arguments)?;
    let mut stats = RunStats {
        version: env!("CARGO_PKG_VERSION").to_owned(),
        scene: run.loaded.hash.clone(),
        simd: run.simd.name().to_owned(),
        threads: run.threads,
        load_s: start.elapsed().as_secs_f64(),
        ..RunStats::default()
    };
    let progress = Progress::new(arguments.quiet, run.numbers.len());
    let size = &run.loaded.scene.render;
    let mut outcome = Outcome::Done;
    for (index, &number) in run.numbers.iter().enumerate() {
        if let Some(signal) = stop.signal() {
            outcome = Outcome::Stopped(signal);
            break;
        }
        progress.start(index + 1, number, size.width, size.height);
        match frame(&run, number, &stop, &progress) {
            Ok(Rendered::Before(files)) => {
                progress.finish(&format!("whole already: {}", files.join(", ")));
                stats.skipped.push(number);
            }
            Ok(Rendered::Now(frame)) => {
                let names: Vec<String> = frame.files.iter().map(|file| file.path.display().to_string()).collect();
                progress.finish(&format!("wrote {}", names.join(", ")));
                stats.add(*frame);
            }
            Err(error) if run.numbers.len() == 1 => {
                progress.finish("lost");
                return Err(error);
            }
            Err(error) => {
                progress.finish("lost");
                tracing::error!("frame {number} is lost: {error}");
                stats.lost.push((number, error.to_string()));
                outcome = Outcome::FramesLost;
            }
        }
        if let Some(signal) = stop.signal() {
            outcome = Outcome::Stopped(signal);
            break;
        }
    }
    if stats.gave_up > 0 {
        tracing::warn!("the solver gave up on {} rays; they count as misses", stats.gave_up);
    }
    if let Some(audit) = stats.audit {
        tracing::warn!(
            "columns: of {} rays that were traced again exactly, {} lost, {} false, {} misplaced",
            audit.rays,
            audit.lost,
            audit.false_hits,
            audit.wrong
        );
    }
    if stats.nonfinite > 0 {
        tracing::warn!("{} contributions were not finite and were dropped", stats.nonfinite);
    }
    if let Some(path) = &arguments.stats {
        stats.save(path)?;
    }
    Ok(outcome)
}

/// How a frame came to be.
enum Rendered {
    /// In an earlier run: its files by name.
    Before(Vec<String>),
    Now(Box<FrameStats>),
}

/// One frame from its file to its pictures.
fn frame(run: &Run, number: i64, stop: &StopFlag, progress: &Progress) -> Result<Rendered, CliError> {
    let settings = &run.loaded.scene;
    // Until the frame is written: two renders into one file would each undo the other's work.
    let claims = run.outputs.iter().map(|pattern| Claim::new(&naming::with_frame(pattern, number)));
    let claims: Vec<Claim> = claims.collect::<Result<_, _>>().map_err(anyhow::Error::from)?;
    let kept = keep::kept(run, number)?;
    if let (Some(claim), Some(kept)) = (claims.first(), &kept) {
        kept.eyes.iter().for_each(|keeping| claim.sweep(&keeping.path));
        claim.sweep(&kept.record);
    }
    if let Some(kept) = kept.as_ref().filter(|_| run.arguments.resume) {
        match finished::whole(run, number, &kept.record, &kept.wanted) {
            Ok(None) => {}
            Ok(Some(files)) => {
                if !run.arguments.keep_checkpoint {
                    // Killed between its record and this.
                    kept.remove_checkpoints();
                }
                return Ok(Rendered::Before(files.iter().map(|path| path.display().to_string()).collect()));
            }
            Err(why) => progress.say(&format!("frame {number} was whole, but is rendered again: {why}")),
        }
    }
    let clock = Instant::now();
    let states = moments::states(&run.loaded, &run.frames, number)?;
    let volume = load::volume(&run.loaded, number)?;
    let load_s = clock.elapsed().as_secs_f64();

    let clock = Instant::now();
    // One frame's foam for all moments of its shutter: it moves by less than its own detail.
    let foam = foam::of_frame(&run.loaded, &run.frames, number, &states[0].1)?;
    let budget = run.arguments.memory.map(|Bytes(bytes)| bytes);
    let moments = MomentOfFrame::build_all(
        &states,
        foam.as_ref(),
        number,
        settings,
        &run.environment,
        &run.path,
        run.simd,
        budget,
        volume.as_ref(),
        run.ground_texture.as_ref(),
    )?;
    drop((states, volume));
    let first = moments.first().context("a frame has a moment")?;
    let build_s = clock.elapsed().as_secs_f64();

    let clock = Instant::now();
    let looks: Vec<_> = moments
        .iter()
        .map(|moment| Looks {
            rainbow: run.rainbow.as_ref(),
            textures: run.textures.as_ref(),
            ..moment.matter.looks(&moment.lowered)
        })
        .collect();
    let shown: Vec<_> = moments
        .iter()
        .zip(&looks)
        .map(|(moment, looks)| render::Moment {
            time: moment.time,
            lowered: &moment.lowered.lowered,
            accelerator: &*moment.accelerator,
            matter: looks,
            water: moment.lowered.water.as_deref(),
        })
        .collect();
    let (mut pictures, mut render, mut denoise, mut deep) = (Vec::new(), RenderStats::default(), None, None);
    for (eye, (aside, _)) in keep::eyes(settings).into_iter().enumerate() {
        let job = Job {
            scene: settings,
            moments: &shown,
            sky: &run.sky,
            path: &run.path,
            frame: number,
            crop: run.crop,
            threads: run.threads,
            mattes: mattes(run),
            aside,
        };
        let task = Task {
            tile: run.arguments.tile.map(|share| (share.index, share.count)),
            samples: run.arguments.sample_range.map(|range| range.ends),
            keeping: kept.as_ref().map(|kept| &kept.eyes[eye]),
        };
        if let Some(preview) = &run.preview {
            preview.begin(&preview_name(run, number, aside), window(run));
        }
        let watch = Watch { progress, preview: run.preview.as_ref() };
        let part = render::render_part(&job, &task, stop.flag(), &watch);
        let (mut picture, stats) = part.map_err(anyhow::Error::from)?;
        render += stats;
        // Before layers are picked, so that the guides are there whichever are wanted.
        let report = run.denoiser.as_ref().map(|denoiser| denoiser.denoise(&mut picture));
        let report = report.transpose().map_err(anyhow::Error::from)?;
        if let Some(preview) = &run.preview {
            if report.is_some() {
                preview.leave(picture.data, beauty(&picture));
            }
            preview.finish();
        }
        denoise = match (denoise, report) {
            (Some(one), Some(other)) => Some(both_eyes(one, other)),
            (one, other) => other.or(one),
        };
        // Its colour is the finished picture's, before layers of that are left out. No scene has both eyes and deep samples.
        if settings.output.deep.enabled && picture.metadata.complete {
            let samples = render::render_deep(&job, &picture, stop.flag(), progress);
            deep = Some(samples.map_err(anyhow::Error::from)?);
        }
        let mut names = run.arguments.layers.clone().unwrap_or_default();
        if run.arguments.sample_range.is_some() && !names.is_empty() {
            // Samples are joined by them.
            names.extend(["samplecount", "z"].map(str::to_owned));
        }
        layers::select(&mut picture, &names).map_err(anyhow::Error::from)?;
        pictures.push(picture);
    }
    check_textures(run)?;
    let mut pictures = pictures.into_iter();
    let left = pictures.next().context("a frame has an eye")?;
    let mut picture = match pictures.next() {
        Some(right) => output::pair(left, right),
        None => left,
    };
    let complete = picture.metadata.complete;
    let render_s = clock.elapsed().as_secs_f64();

    let clock = Instant::now();
    let files = write(run, number, &mut picture, deep)?;
    if let Some(kept) = kept.filter(|_| complete) {
        if run.numbers.len() > 1
            && let Err(error) = finished::record(&kept.record, kept.wanted.clone(), &files)
        {
            tracing::warn!("that frame {number} is whole was not recorded, --resume would render it again: {error}");
        }
        // Only now: until the picture has its name, the checkpoint is all there is.
        if !run.arguments.keep_checkpoint {
            kept.remove_checkpoints();
        }
    }
    Ok(Rendered::Now(Box::new(FrameStats {
        frame: number,
        load_s,
        build_s,
        render_s,
        denoise,
        write_s: clock.elapsed().as_secs_f64(),
        parts: part_names(&first.lowered.lowered),
        accelerator: first.accelerator.stats(),
        audit: first.accelerator.audit(),
        particles_left_out: first.lowered.particles_left_out(),
        particles: first.lowered.thinning,
        render,
        files,
    })))
}

/// What is rendered of the frame.
fn window(run: &Run) -> Window {
    let size = &run.loaded.scene.render;
    run.crop.unwrap_or(Window { x: 0, y: 0, width: size.width, height: size.height })
}

/// What a viewer calls a picture.
fn preview_name(run: &Run, number: i64, aside: f64) -> String {
    let path = &run.loaded.path;
    // Most scenes are called scene.toml: their folder tells them apart.
    let stem = path.file_stem().filter(|stem| *stem != "scene").or_else(|| path.parent()?.file_name());
    let scene = stem.map_or_else(|| "scene".into(), |stem| stem.to_string_lossy());
    let eye = match aside {
        aside if aside < 0.0 => " left",
        aside if aside > 0.0 => " right",
        _ => "",
    };
    format!("{scene} {number:04}{eye}")
}

/// Red, green, blue and alpha of every pixel.
fn beauty(picture: &Picture) -> Vec<[f32; 4]> {
    let channels = ["R", "G", "B", "A"].map(|name| picture.channel(name).map_or(&[][..], |c| &c.samples[..]));
    (0..picture.data.area()).map(|at| channels.map(|samples| samples.get(at).copied().unwrap_or(0.0))).collect()
}

/// Whether every look at a texture so far has found it: a file that is read piece by piece may go away or break.
fn check_textures(run: &Run) -> Result<(), CliError> {
    run.sky.check().map_err(anyhow::Error::from)?;
    run.ground_texture.as_ref().map_or(Ok(()), GroundTexture::check).map_err(anyhow::Error::from)?;
    Ok(run.textures.as_ref().map_or(Ok(()), Textures::check).map_err(anyhow::Error::from)?)
}

/// The mattes that any file of the picture holds, or that were asked for by name.
fn mattes(run: &Run) -> Mattes {
    let names = run.arguments.layers.as_deref().unwrap_or_default();
    let has_layers = |path: &PathBuf| output::has_layers(path, &run.options);
    if names.is_empty() && !run.outputs.is_empty() && !run.outputs.iter().any(has_layers) {
        return Mattes::default();
    }
    Mattes::wanted(|channel| layers::wants(names, channel))
}

/// What denoising took for a pair.
fn both_eyes(one: DenoiseReport, other: DenoiseReport) -> DenoiseReport {
    DenoiseReport {
        pixels: one.pixels + other.pixels,
        guides_s: one.guides_s + other.guides_s,
        seconds: one.seconds + other.seconds,
        ..one
    }
}

/// Writes the picture to all its files; a picture that was stopped goes to names that say so.
fn write(
    run: &Run,
    number: i64,
    picture: &mut Picture,
    deep: Option<DeepPicture>,
) -> Result<Vec<WriteReport>, CliError> {
    let settings = &run.loaded.scene;
    picture.metadata.owner = settings.output.owner.clone();
    picture.metadata.comments = settings.output.comments.clone();
    picture.metadata.scene_hash = run.loaded.hash.clone();
    let when = run.options.captured.unwrap_or_else(local_now);
    let by_default =
        [PathBuf::from(naming::default_name(&run.loaded.path, number, settings.surface.representation.name(), when))];
    let patterns: &[PathBuf] = if run.outputs.is_empty() { &by_default } else { &run.outputs };
    let mut files = Vec::new();
    for pattern in patterns {
        let path = naming::with_frame(pattern, number);
        let path = if picture.metadata.complete { path } else { naming::partial(&path) };
        files.push(write_one(picture, &path, &run.options)?);
    }
    if let Some(mut deep) = deep {
        deep.metadata = Metadata { complete: deep.metadata.complete, ..picture.metadata.clone() };
        for pattern in deep_outputs(patterns) {
            let path = naming::with_frame(&pattern, number);
            let path = if deep.metadata.complete { path } else { naming::partial(&path) };
            let written = output::write_deep(&deep, &path, &run.options);
            files.push(written.with_context(|| format!("cannot write {}", path.display()))?);
        }
    }
    Ok(files)
}

fn write_one(picture: &Picture, path: &Path, options: &WriteOptions) -> Result<WriteReport, CliError> {
    Ok(output::write(picture, path, options).with_context(|| format!("cannot write {}", path.display()))?)
}

/// The looks of one frame, owned.
pub(super) struct MatterOfFrame {
    ground: Ground,
    ground_texture: Option<PlacedTexture>,
    waterline: Waterline,
    sky_view: SkyView,
    foam: Option<FoamField>,
}

impl MatterOfFrame {
    pub(super) fn new(
        settings: &scene::Scene,
        state: &Frame,
        lowered: &LoweredFrame,
        foam: Option<&FoamState>,
        ground_texture: Option<&GroundTexture>,
    ) -> Self {
        let columns = &state.columns;
        let origin: DVec3 = lowered.lowered.origin;
        let width = columns.width[0].min(columns.width[1]);
        Self {
            ground: Ground::build(&settings.terrain, width, origin),
            ground_texture: ground_texture.map(|texture| texture.placed(columns, origin)),
            waterline: Waterline::build(columns, settings.surface.dry_threshold, origin),
            sky_view: SkyView::build(columns, origin),
            foam: foam.and_then(|foam| FoamField::build(foam, &settings.foam, columns.origin, origin)),
        }
    }

    pub(super) fn looks<'a>(&'a self, lowered: &'a LoweredFrame) -> Looks<'a> {
        Looks {
            ground: &self.ground,
            ground_texture: self.ground_texture.as_ref(),
            waterline: &self.waterline,
            sky_view: &self.sky_view,
            spray: &lowered.spray,
            water: lowered.water.as_deref(),
            bed: lowered.bed.as_deref(),
            foam: self.foam.as_ref(),
            mist: lowered.mist.as_deref(),
            rainbow: None,
            textures: None,
        }
    }
}
