//! What a render needs, read and checked before its first ray: whatever can be wrong is said before hours have gone by. The frames
//! themselves are in `render`.

use std::path::{Path, PathBuf};

use anyhow::Context;

use super::args::RenderArgs;
use super::errors::CliError;
use super::load;
use super::look::local_now;
use super::values::Viewer;
use crate::denoise::Denoiser;
use crate::images::TextureMemory;
use crate::lower::{self, Environment};
use crate::optics::{Rainbow, Sky};
use crate::output::{self, Preview, Window, WriteOptions, layers, naming};
use crate::particles::Textures;
use crate::render::{self, CameraPath};
use crate::scene::{self, LoadedScene, Overscan};
use crate::simd::SimdLevel;
use crate::state::{Columns, FrameSequence};
use crate::surface::{SplineSurface, control};
use crate::terrain::GroundTexture;

/// What all frames of a run share.
pub(super) struct Run<'a> {
    pub(super) arguments: &'a RenderArgs,
    pub(super) loaded: LoadedScene,
    pub(super) frames: FrameSequence,
    pub(super) numbers: Vec<i64>,
    pub(super) outputs: Vec<PathBuf>,
    pub(super) options: WriteOptions,
    pub(super) environment: Environment,
    pub(super) sky: Sky,
    /// How drops scatter sunlight, where the scene asks.
    pub(super) rainbow: Option<Rainbow>,
    /// What is on billboards.
    pub(super) textures: Option<Textures>,
    /// What lies on the ground.
    pub(super) ground_texture: Option<GroundTexture>,
    pub(super) path: CameraPath,
    pub(super) crop: Option<Window>,
    pub(super) simd: SimdLevel,
    pub(super) threads: usize,
    pub(super) denoiser: Option<Denoiser>,
    /// A viewer that watches.
    pub(super) preview: Option<Preview>,
}

/// Everything that can be read and checked before the first frame.
pub(super) fn prepare(arguments: &RenderArgs) -> Result<Run<'_>, CliError> {
    let simd = arguments.simd.level()?;
    let loaded = scene::load(&arguments.scene.scene, &arguments.overrides())?;
    let settings = &loaded.scene;
    let crop = match arguments.crop {
        Some(crop) => Some(
            crop.window(settings.render.width, settings.render.height)
                .map_err(|problem| CliError::Option { option: "--crop", problem })?,
        ),
        None => None,
    };
    let crop = overscanned(crop, settings);
    let threads = arguments.threads.or(std::thread::available_parallelism().ok()).map_or(1, std::num::NonZero::get);
    // Embree's builds and EXR's compression follow the global pool; a program that calls twice keeps its first.
    let _ = rayon::ThreadPoolBuilder::new().num_threads(threads).build_global();
    let options = WriteOptions {
        reproducible: arguments.reproducible,
        captured: Some(local_now()),
        ..WriteOptions::from_scene(&settings.output)
    };
    if options.profile == scene::Profile::Blender && options.compression == scene::Compression::Dwaa {
        tracing::warn!(
            "--compression dwaa: Blender 5 takes each part of such a file for a layer, and finds no matte: leave it out for Blender"
        );
    }
    if let Some(names) = &arguments.layers {
        layers::check(names).map_err(anyhow::Error::from)?;
    }
    let frames = load::frames(&loaded)?;
    let numbers = match arguments.selection() {
        Some(selection) => selection.numbers().to_vec(),
        None => frames.iter().map(|(number, _)| number).collect(),
    };
    let missing: Vec<i64> = numbers.iter().copied().filter(|&number| frames.path(number).is_none()).collect();
    if let Some(&greatest) = missing.iter().max() {
        const LISTED: usize = 10;
        let (first, last) = (frames.first(), frames.last());
        let listed: Vec<String> = missing.iter().take(LISTED).map(i64::to_string).collect();
        let more = missing.len() - listed.len();
        return Err(anyhow::anyhow!(
            "{}: there is no frame {}{}; there are {} from {first} to {last}{}",
            settings.frames.files,
            listed.join(", "),
            if more > 0 { format!(" and {more} more") } else { String::new() },
            frames.len(),
            load::how_to_make(&loaded, Some(greatest))
        )
        .into());
    }
    for &number in &numbers {
        load::mist_file(&loaded, number)?;
    }
    let mut outputs = arguments.output.clone();
    // Several frames under one name would overwrite one another.
    for output in &mut outputs {
        if numbers.len() > 1 {
            *output = naming::numbered(output);
        }
        for &number in &numbers {
            output::check(&naming::with_frame(output, number), &options).map_err(anyhow::Error::from)?;
        }
    }
    if settings.output.deep.enabled {
        let by_default = [PathBuf::from("scene.exr")];
        for output in deep_outputs(if outputs.is_empty() { &by_default } else { &outputs }) {
            for &number in &numbers {
                output::check_deep(&naming::with_frame(&output, number)).map_err(anyhow::Error::from)?;
            }
        }
    }
    check_parts(arguments, settings, &options)?;
    // Loaded before the first ray: a library that is missing must not cost hours.
    let denoiser = arguments
        .denoise
        .then(|| Denoiser::new(threads))
        .transpose()
        .map_err(|error| anyhow::Error::new(error).context("--denoise"))?;
    let viewer = arguments.tev.as_ref().map(|Viewer { host, port }| Preview::connect(host, *port));
    let preview = viewer.transpose().map_err(|error| anyhow::Error::new(error).context("--tev"))?;
    let environment = load::environment(&loaded, &frames)?;
    let bytes = scene::bytes(&settings.render.texture_memory).context("render.texture_memory was checked")?;
    let memory = TextureMemory::new(bytes);
    let sky = Sky::build_within(&memory, &settings.sky, &settings.sun, &loaded.directory);
    let sky = sky.map_err(anyhow::Error::from)?;
    let ground_texture = GroundTexture::load(&settings.terrain, &loaded.directory, &memory);
    let ground_texture = ground_texture.map_err(anyhow::Error::from)?;
    let particles = &settings.particles;
    let rainbow = (particles.rainbow > 0.0).then(|| Rainbow::build(particles.rainbow_spread));
    let textures = Textures::load(particles, &loaded.directory, &memory).map_err(anyhow::Error::from)?;
    let path = camera_path(&loaded, &frames)?;
    Ok(Run {
        arguments,
        outputs,
        frames,
        numbers,
        options,
        environment,
        sky,
        rainbow,
        textures,
        ground_texture,
        path,
        crop,
        simd,
        threads,
        denoiser,
        preview,
        loaded,
    })
}

/// A crop, or the whole frame, with the overscan that the scene asks for around it.
fn overscanned(crop: Option<Window>, settings: &scene::Scene) -> Option<Window> {
    let Some(overscan) = settings.output.overscan.as_deref().and_then(Overscan::parse) else { return crop };
    let (width, height) = (settings.render.width, settings.render.height);
    let [across, down] = overscan.margins(width, height);
    let inner = crop.unwrap_or(Window { x: 0, y: 0, width, height });
    // Frame and overscan are at most some ten thousand pixels each (the scene's schema): nothing overflows.
    Some(Window {
        x: inner.x - across as i32,
        y: inner.y - down as i32,
        width: inner.width + 2 * across,
        height: inner.height + 2 * down,
    })
}

/// Whether a part of a picture was asked for that can be joined later, and checkpoints that can be found again.
fn check_parts(arguments: &RenderArgs, settings: &scene::Scene, options: &WriteOptions) -> Result<(), CliError> {
    let option = match (&arguments.tile, &arguments.sample_range) {
        (Some(_), _) => Some("--tile"),
        (None, Some(_)) => Some("--sample-range"),
        _ => None,
    };
    if let Some(option) = option {
        let problem = if arguments.denoise {
            Some("--denoise looks at the whole picture: leave it out")
        } else if settings.output.deep.enabled {
            Some("deep pictures (--deep, output.deep.enabled) cannot be joined: render them whole")
        } else if settings.camera.stereo.is_some() {
            Some("a pair of eyes (--stereo, camera.stereo) cannot be joined: render one eye at a time")
        } else if arguments.output.iter().any(|path| !is_exr(path)) {
            Some("expected -o NAME.exr: only EXR says which part of a picture it is")
        } else if options.compression == scene::Compression::Dwaa {
            Some("--compression dwaa would lose bits twice: give it to `whitewater merge` instead")
        } else {
            None
        };
        if let Some(problem) = problem {
            return Err(anyhow::anyhow!("{option}: {problem}").into());
        }
    }
    let wanted = [("--resume", arguments.resume), ("--keep-checkpoint", arguments.keep_checkpoint)];
    if let Some((option, _)) = wanted.iter().find(|(_, given)| *given) {
        if !arguments.output.iter().any(|path| is_exr(path)) {
            return Err(anyhow::anyhow!("{option}: expected -o NAME.exr, beside which the checkpoint lies").into());
        }
        if arguments.checkpoint.is_zero() {
            return Err(anyhow::anyhow!("{option}: --checkpoint 0 keeps none; expected some seconds").into());
        }
    }
    Ok(())
}

pub(super) fn is_exr(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("exr"))
}

/// The camera over all frames. Without a place of its own it is framed on the sequence's first frame, whichever frames
/// are asked for: so it stands still, and a frame rendered alone looks the same.
fn camera_path(loaded: &LoadedScene, frames: &FrameSequence) -> Result<CameraPath, CliError> {
    let camera = &loaded.scene.camera;
    let settings = &loaded.scene.render;
    let placed = !camera.key.is_empty() || (camera.eye.is_some() && camera.look_at.is_some());
    let first = if placed { None } else { Some(load::frame(loaded, frames, frames.first())?) };
    let path = CameraPath::from_scene(camera, || {
        let columns = first.as_ref().map_or_else(Columns::default, |frame| frame.columns.clone());
        let points = lower::points_to_frame(&columns, loaded.scene.surface.dry_threshold);
        let bed = control::bed(&columns, &loaded.scene.surface, [0.0; 3])
            .ok()
            .map(|lattice| SplineSurface::new(lattice, scene::SolverKind::Reference, SimdLevel::Portable));
        let ground = |x: f64, z: f64| bed.as_ref()?.point(x, z).map(|(height, _)| height);
        let aspect = camera.pixel_aspect * f64::from(settings.width) / f64::from(settings.height);
        render::frame_points(&points, &ground, aspect, camera.fov)
    });
    Ok(path.map_err(anyhow::Error::from)?)
}

/// The names of the deep pictures beside those of flat ones: of EXRs, or, where there are none, of all, which will be refused.
pub(super) fn deep_outputs(outputs: &[PathBuf]) -> Vec<PathBuf> {
    let exr: Vec<PathBuf> = outputs.iter().filter(|path| is_exr(path)).map(|path| naming::deep(path)).collect();
    if exr.is_empty() { outputs.iter().map(|path| naming::deep(path)).collect() } else { exr }
}
