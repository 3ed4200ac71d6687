//! What may be typed: the subcommands and their options. What the words mean is in `values`; what a scene's key may hold
//! is known to the scene room alone, so that options which set one become overrides here.

use std::num::NonZeroUsize;
use std::path::PathBuf;
use std::time::Duration;

use clap::builder::PossibleValuesParser;
use clap::{Args, Parser, Subcommand, ValueEnum};

use super::errors::CliError;
use super::values::{Accuracy, Bytes, Crop, FrameSelection, GridSize, SampleRange, Share, Viewer};
use crate::scene::{Override, Surface, names_of};
use crate::simd::SimdLevel;

/// The program's command line.
#[derive(Clone, Debug, Parser)]
#[command(name = "whitewater", version, about = "Renders turbulent water over natural terrain", max_term_width = 110)]
#[command(after_help = "\
Examples:
  whitewater render scenes/small/scene.toml -o out.exr
  whitewater simulate scenes/river/scene.toml --frames 48
  whitewater inspect scenes/small/time000.state
  whitewater COMMAND --help

Exit codes: 0 done, 1 finished but frames were lost, 2 could not run, 130 Ctrl-C, 143 SIGTERM.")]
pub struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

/// The subcommands.
#[derive(Clone, Debug, Subcommand)]
pub enum Command {
    /// Render frames of a scene to EXR, PNG, JPEG or BMP
    Render(Box<RenderArgs>),
    /// Join parts of a picture that were rendered apart
    Merge(MergeArgs),
    /// Make a film of rendered frames (by ffmpeg)
    Movie(MovieArgs),
    /// Make the frames of a scene: simulate its water
    Simulate(SimulateArgs),
    /// Show what simulation files hold
    Inspect(InspectArgs),
    /// Convert a frame between text and NPZ
    Convert(ConvertArgs),
    /// Answer single rays from a file
    Trace(TraceArgs),
    /// Print the JSON Schema of scene files
    #[command(after_help = "Example:\n  whitewater schema > scene.schema.json")]
    Schema,
    /// Measure speed and correctness on this machine
    Bench(BenchArgs),
}

/// Instruction sets by name.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum SimdChoice {
    /// The widest that the processor has
    #[default]
    Auto,
    /// 16 lanes in AVX-512
    Avx512,
    /// 8 lanes in AVX2
    Avx2,
    /// No vector instructions beyond the target's own
    Portable,
}

impl SimdChoice {
    /// The instruction set to run with.
    ///
    /// # Errors
    /// The processor does not have the one asked for.
    pub fn level(self) -> Result<SimdLevel, CliError> {
        let level = match self {
            Self::Auto => SimdLevel::detect(),
            Self::Avx512 => SimdLevel::Avx512,
            Self::Avx2 => SimdLevel::Avx2,
            Self::Portable => SimdLevel::Portable,
        };
        if level.is_available() { Ok(level) } else { Err(CliError::NoSimd { name: level.name() }) }
    }
}

/// What a scene is made of: its file and everything laid over it.
#[derive(Clone, Debug, Args)]
pub struct SceneArgs {
    /// The scene file (TOML)
    #[arg(value_name = "SCENE")]
    pub scene: PathBuf,
    /// Override a key of the scene; VALUE is TOML or a bare string (repeatable)
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub set: Vec<Override>,
}

/// `whitewater render`.
#[derive(Clone, Debug, Args)]
#[command(after_help = "\
Examples:
  whitewater render scene.toml -o out.exr --set render.width=500 --set render.height=500
  whitewater render scene.toml -o 'frames/out.####.exr' --frames 1-48x2
  whitewater render scene.toml -o out.png --crop 0,0,640,360 --accuracy 0.05px
  whitewater render scene.toml --set 'water.absorption=[0,0,0]' --stats stats.json
  whitewater render scene.toml -o t2.exr --tile 2/4
  whitewater render scene.toml -o out.exr --resume

An option that stands for a key of the scene (--accel, --solver, --accuracy, --compression) wins over --set.")]
pub struct RenderArgs {
    /// The scene and its overrides.
    #[command(flatten)]
    pub scene: SceneArgs,
    /// The picture: .exr .png .jpg .bmp .tif; #### is the frame number, put before the ending of a name without one when
    /// there are several frames (repeatable) [default: an EXR named after the scene, in this folder]
    #[arg(short, long, value_name = "OUT")]
    pub output: Vec<PathBuf>,
    /// Render one frame [default: all]
    #[arg(long, value_name = "N", conflicts_with = "frames", value_parser = clap::value_parser!(i64).range(0..))]
    pub frame: Option<i64>,
    /// Render some frames: 1-48, 1-48x2 (every second), lists with commas
    #[arg(long, value_name = "LIST")]
    pub frames: Option<FrameSelection>,
    /// Threads [default: all processors]
    #[arg(long, value_name = "N", value_parser = threads)]
    pub threads: Option<NonZeroUsize>,
    /// Draw fewer particles, each wider, until a picture is estimated to fit in so many bytes: 512M, 8G (powers of 1000)
    #[arg(long, value_name = "BYTES")]
    pub memory: Option<Bytes>,
    /// Render a part: pixels from the upper left, X1 and Y1 exclusive
    #[arg(long, value_name = "X0,Y0,X1,Y1")]
    pub crop: Option<Crop>,
    /// Render the I-th of N shares of the picture's tiles, for `whitewater merge`
    #[arg(long, value_name = "I/N")]
    pub tile: Option<Share>,
    /// Render some samples of each pixel, for `whitewater merge`: from A on, B exclusive, multiples of 16
    #[arg(long, value_name = "A-B")]
    pub sample_range: Option<SampleRange>,
    /// Keep the state of every pixel in .NAME.checkpoint beside NAME.exr so often; 0 never
    #[arg(long, value_name = "S", default_value = "60", value_parser = seconds)]
    pub checkpoint: Duration,
    /// Leave the checkpoint of a finished frame, to refine it later (--resume with less --noise) or to merge it
    #[arg(long)]
    pub keep_checkpoint: bool,
    /// Go on from the checkpoint of a frame that was stopped, killed, or is to be refined, to the same bits; of several frames,
    /// leave out those that are whole
    #[arg(long)]
    pub resume: bool,
    /// Write seconds, rays, solver work and memory as JSON
    #[arg(long, value_name = "FILE")]
    pub stats: Option<PathBuf>,
    /// Leave dates and times out, for identical bytes
    #[arg(long)]
    pub reproducible: bool,
    /// Instruction set
    #[arg(long, value_enum, default_value_t, value_name = "NAME")]
    pub simd: SimdChoice,
    /// Accelerators by preset: one name for both accel.water and accel.objects
    #[arg(long, value_name = "NAME", value_parser = accelerators())]
    pub accel: Option<String>,
    /// Ray/patch solver (surface.solver)
    #[arg(long, value_name = "NAME", value_parser = names("surface.solver"))]
    pub solver: Option<String>,
    /// How light is followed: whitted or path (render.integrator)
    #[arg(long, value_name = "NAME", value_parser = names("render.integrator"))]
    pub integrator: Option<String>,
    /// Go on until a pixel's error is this share of its light (render.noise)
    #[arg(long, value_name = "SHARE")]
    pub noise: Option<String>,
    /// Go on until so many seconds have passed for a frame (render.seconds)
    #[arg(long, value_name = "S")]
    pub seconds: Option<String>,
    /// How near a hit must be: 0.05px (surface.accuracy) or 1e-4m (surface.tolerance)
    #[arg(long, value_name = "NUMBER")]
    pub accuracy: Option<Accuracy>,
    /// Layers of the EXR: beauty,z,n,... [default: all]
    #[arg(long, value_name = "A,B,C", value_delimiter = ',')]
    pub layers: Option<Vec<String>>,
    /// Take the noise out of the beauty (Open Image Denoise); what it was stays as the layer `noisy`
    #[arg(long)]
    pub denoise: bool,
    /// Write a deep EXR beside each EXR: NAME.deep.exr (output.deep.enabled; needs OpenImageIO)
    #[arg(long)]
    pub deep: bool,

    /// Primaries of the EXR's colours: rec709 or acescg (output.colorspace)
    #[arg(long, value_name = "NAME", value_parser = names("output.colorspace"))]
    pub colorspace: Option<String>,

    /// Compression of the EXR (output.compression)
    #[arg(long, value_name = "NAME", value_parser = names("output.compression"))]
    pub compression: Option<String>,
    /// Render for two eyes so many metres apart, both into one EXR (camera.stereo); other files show the left eye
    #[arg(long, value_name = "M")]
    pub stereo: Option<String>,
    /// Names of the EXR's channels: nuke or blender (output.profile)
    #[arg(long, value_name = "NAME", value_parser = names("output.profile"))]
    pub profile: Option<String>,
    /// Render beyond the frame, or the crop, on every side: 5% of the frame, or 64px (output.overscan)
    #[arg(long, value_name = "MARGIN")]
    pub overscan: Option<String>,
    /// Show the picture as it is rendered in the image viewer tev, which runs there [default port: 14158]
    #[arg(long, value_name = "HOST[:PORT]")]
    pub tev: Option<Viewer>,
    /// Show errors only
    #[arg(short, long, conflicts_with = "verbose")]
    pub quiet: bool,
    /// Say what is being done
    #[arg(short, long)]
    pub verbose: bool,
}

impl RenderArgs {
    /// Everything that is laid over the scene file, in order: `--set`, then the options that stand for keys.
    pub fn overrides(&self) -> Vec<Override> {
        let mut overrides = self.scene.set.clone();
        let mut option = |option: &str, key: &str, value: Option<&str>| {
            overrides.extend(value.map(|value| Override::by_option(option, key, value)));
        };
        let pair = self.accel.as_deref().and_then(|name| presets().find(|preset| preset.0 == name));
        option("--accel", "accel.water", pair.map(|preset| preset.1));
        option("--accel", "accel.objects", pair.map(|preset| preset.2));
        option("--solver", "surface.solver", self.solver.as_deref());
        option("--integrator", "render.integrator", self.integrator.as_deref());
        option("--noise", "render.noise", self.noise.as_deref());
        option("--seconds", "render.seconds", self.seconds.as_deref());
        option("--compression", "output.compression", self.compression.as_deref());
        option("--profile", "output.profile", self.profile.as_deref());
        option("--stereo", "camera.stereo", self.stereo.as_deref());
        option("--overscan", "output.overscan", self.overscan.as_deref());
        option("--colorspace", "output.colorspace", self.colorspace.as_deref());
        option("--deep", "output.deep.enabled", self.deep.then_some("true"));
        overrides.extend(self.accuracy.iter().flat_map(Accuracy::overrides));
        overrides
    }

    /// The frames that were asked for; `None` means all there are.
    pub fn selection(&self) -> Option<FrameSelection> {
        self.frame.map(FrameSelection::one).or_else(|| self.frames.clone())
    }
}

/// `whitewater merge`.
#[derive(Clone, Debug, Args)]
#[command(after_help = "\
Examples:
  for i in 1 2 3 4; do whitewater render scene.toml --tile $i/4 -o t$i.exr; done; whitewater merge t?.exr -o out.exr
  whitewater merge a.exr b.exr -o out.exr                          # --sample-range 0-32 and 32-64: weighted by sampleCount
  whitewater merge .a.exr.checkpoint .b.exr.checkpoint -o out.exr  # the same, to the bit (--keep-checkpoint)")]
pub struct MergeArgs {
    /// Pictures (EXR), or checkpoints, of all parts of one picture, in any order
    #[arg(value_name = "PART", required = true)]
    pub parts: Vec<PathBuf>,
    /// The whole picture
    #[arg(short, long, value_name = "OUT")]
    pub output: PathBuf,
    /// Write what there is, though parts are missing; the picture says so
    #[arg(long)]
    pub partial: bool,
    /// Layers of the EXR: beauty,z,n,... [default: those of the parts; of checkpoints, all]
    #[arg(long, value_name = "A,B,C", value_delimiter = ',')]
    pub layers: Option<Vec<String>>,
    /// Primaries of the EXR's colours [default: those of the parts; of checkpoints, rec709]
    #[arg(long, value_name = "NAME", value_parser = names("output.colorspace"))]
    pub colorspace: Option<String>,
    /// Compression of the EXR [default: that of the parts; of checkpoints, zip]
    #[arg(long, value_name = "NAME", value_parser = names("output.compression"))]
    pub compression: Option<String>,
    /// Leave dates and times out, for identical bytes [default: as the parts have it]
    #[arg(long)]
    pub reproducible: bool,
}

fn within(text: &str, low: f64, high: f64) -> Result<f64, String> {
    let value: f64 = text.parse().map_err(|error| format!("{error}"))?;
    if value >= low && value <= high { Ok(value) } else { Err(format!("expected {low} to {high}")) }
}

fn frames_per_second(text: &str) -> Result<f64, String> {
    within(text, 0.01, 1000.0)
}

fn stops(text: &str) -> Result<f64, String> {
    within(text, -100.0, 100.0)
}

/// `whitewater movie`.
#[derive(Clone, Debug, Args)]
#[command(after_help = "\
Examples:
  whitewater movie 'river/frame.####.exr' -o river.mp4
  whitewater movie 'frame.####.exr' -o out.webm --fps 30 --exposure 0.5 --quality 30

ffmpeg is found by WHITEWATER_FFMPEG, or on the search path.")]
pub struct MovieArgs {
    /// The frames: a name with #### for the number, or files one by one (EXR through the view; PNG and JPEG as they are)
    #[arg(value_name = "FRAMES", required = true)]
    pub frames: Vec<PathBuf>,
    /// The film: .mp4, .mov, .mkv or .webm
    #[arg(short, long, value_name = "OUT")]
    pub output: PathBuf,
    /// Frames per second
    #[arg(long, value_name = "N", default_value_t = 24.0, value_parser = frames_per_second)]
    pub fps: f64,
    /// Curve for EXR: filmic, srgb or aces
    #[arg(long, value_name = "NAME", default_value = "filmic", value_parser = names("output.view"))]
    pub view: String,
    /// Stops of exposure for EXR
    #[arg(long, value_name = "STOPS", default_value_t = 0.0, allow_negative_numbers = true, value_parser = stops)]
    pub exposure: f64,
    /// Constant rate factor: smaller is better and larger
    #[arg(long, value_name = "N", default_value_t = 18, value_parser = clap::value_parser!(u8).range(0..=51))]
    pub quality: u8,
    /// Show errors only
    #[arg(short, long)]
    pub quiet: bool,
}

/// `whitewater simulate`.
#[derive(Clone, Debug, Args)]
#[command(after_help = "\
Examples:
  whitewater simulate scenes/river/scene.toml --frames 48
  whitewater simulate scene.toml -o /tmp/try --set simulation.spray.enabled=false --stats stats.json

Writes model.state, time000.state to time<N-1>.state, and simulation.checkpoint, from which the same command goes on
where it was stopped (Ctrl-C), to the same bits. More --frames continue a finished run.")]
pub struct SimulateArgs {
    /// The scene and its overrides.
    #[command(flatten)]
    pub scene: SceneArgs,
    /// The folder of the frames [default: where the scene's frames.files points]
    #[arg(short, long, value_name = "DIR")]
    pub output: Option<PathBuf>,
    /// How many frames, from 0 on [default: simulation.duration * frames.fps + 1]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=FrameSelection::MOST as u64))]
    pub frames: Option<u64>,
    /// Write text [default: NPZ]
    #[arg(long)]
    pub text: bool,
    /// Begin anew: replace the frames that are there
    #[arg(long)]
    pub restart: bool,
    /// Threads [default: all processors]
    #[arg(long, value_name = "N", value_parser = threads)]
    pub threads: Option<NonZeroUsize>,
    /// Write seconds, steps, spray and the account of all water as JSON
    #[arg(long, value_name = "FILE")]
    pub stats: Option<PathBuf>,
    /// Show errors only
    #[arg(short, long, conflicts_with = "verbose")]
    pub quiet: bool,
    /// Say what is being done
    #[arg(short, long)]
    pub verbose: bool,
}

/// `whitewater trace`.
#[derive(Clone, Debug, Args)]
#[command(after_help = "\
Example:
  whitewater trace scene.toml --rays rays.npz --only water,terrain -o hits.npz

IN:  origin (n,3), direction (n,3), f4 or f8; optional tmax (n), inclusive.
OUT: t (n, f8, +inf for a miss), normal (n,3, f4), object (n, i4, -1 for a miss), objects (names), gave_up (n, bool).")]
pub struct TraceArgs {
    /// The scene and its overrides.
    #[command(flatten)]
    pub scene: SceneArgs,
    /// The rays (NPZ)
    #[arg(long, value_name = "IN.npz")]
    pub rays: PathBuf,
    /// The answers (NPZ)
    #[arg(short, long, value_name = "OUT.npz")]
    pub output: PathBuf,
    /// Trace against some objects: water, water_sides, terrain, spray, panel_0, ... [default: all]
    #[arg(long, value_name = "A,B,C", value_delimiter = ',')]
    pub only: Option<Vec<String>>,
    /// The frame [default: the first]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(i64).range(0..))]
    pub frame: Option<i64>,
    /// Ray/patch solver (surface.solver)
    #[arg(long, value_name = "NAME", value_parser = names("surface.solver"))]
    pub solver: Option<String>,
    /// Threads [default: all processors]
    #[arg(long, value_name = "N", value_parser = threads)]
    pub threads: Option<NonZeroUsize>,
    /// Instruction set
    #[arg(long, value_enum, default_value_t, value_name = "NAME")]
    pub simd: SimdChoice,
}

impl TraceArgs {
    /// Everything that is laid over the scene file, in order: `--set`, then the options that stand for keys.
    pub fn overrides(&self) -> Vec<Override> {
        let mut overrides = self.scene.set.clone();
        let solver = self.solver.as_deref();
        overrides.extend(solver.map(|name| Override::by_option("--solver", "surface.solver", name)));
        overrides
    }
}

/// `whitewater inspect`.
#[derive(Clone, Debug, Args)]
#[command(after_help = "\
Examples:
  whitewater inspect time000.state model.state
  whitewater inspect --json time*.npz | jq '.[].frame'")]
pub struct InspectArgs {
    /// Frames (text or NPZ) and models
    #[arg(value_name = "FILE", required = true)]
    pub files: Vec<PathBuf>,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
    /// A column with less water than this is dry (m)
    #[arg(long, value_name = "M", default_value_t = Surface::default().dry_threshold, value_parser = metres)]
    pub dry_threshold: f64,
    /// Say how many particles are drops, streaks, mist, sheets of water and bubbles (particles.representation = "auto")
    #[arg(long)]
    pub classes: bool,
}

/// `whitewater convert`.
#[derive(Clone, Debug, Args)]
#[command(after_help = "\
Examples:
  whitewater convert time000.state time000.npz
  whitewater convert time000.npz time000.state --text")]
pub struct ConvertArgs {
    /// The frame to read
    #[arg(value_name = "IN")]
    pub input: PathBuf,
    /// The file to write
    #[arg(value_name = "OUT")]
    pub output: PathBuf,
    /// Write text [default: by OUT's ending]
    #[arg(long, conflicts_with = "npz")]
    pub text: bool,
    /// Write NPZ
    #[arg(long)]
    pub npz: bool,
    /// Refuse a top that is further than this under its base (m)
    #[arg(long, value_name = "M", default_value_t = Surface::default().dry_threshold, value_parser = metres)]
    pub dry_threshold: f64,
}

/// What is measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Benchmark {
    /// Rays per second, memory and errors of every way to draw the water
    Surface,
    /// Rays per second and memory of every structure over spray
    Particles,
    /// Error against time, one curve per dial
    Trade,
    /// The 2003 report's table 6.1, row by row
    Report,
    /// Errors against scale, offset, distance and steepness
    Extremes,
    /// Rays per second by threads
    Threads,
    /// Rays aimed at borders, corners and flat water: none may pass
    Leaks,
    /// Milliseconds a step of the simulation, by size
    Sim,
    /// Error against time of light: caustics, integrators, samplers
    Light,
    /// Whole frames by every representation of spray, and what a million particles take to build
    Spray,
}

/// `whitewater bench`.
#[derive(Clone, Debug, Args)]
#[command(after_help = "\
Examples:
  whitewater bench surface --quick
  whitewater bench surface --columns 80x20 --columns 400x400 --threads 1 --csv surface.csv
  whitewater bench surface --audit 10000000
  whitewater bench trade --plot out
  whitewater bench leaks --simd portable")]
pub struct BenchArgs {
    /// What to measure
    #[arg(value_enum, value_name = "WHAT")]
    pub what: Benchmark,
    /// Fewer rays and rounds: a minute instead of many
    #[arg(long)]
    pub quick: bool,
    /// Write the rows as CSV
    #[arg(long, value_name = "FILE")]
    pub csv: Option<PathBuf>,
    /// Write the rows as JSON
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// Write the tables as Markdown
    #[arg(long, value_name = "FILE")]
    pub markdown: Option<PathBuf>,
    /// Draw plots (SVG and PNG) into this folder
    #[arg(long, value_name = "DIR")]
    pub plot: Option<PathBuf>,
    /// Instruction set
    #[arg(long, value_enum, default_value_t, value_name = "NAME")]
    pub simd: SimdChoice,
    /// Count of particles (repeatable) [default: of particles, 2800 to 10 million; of report, 2800 and 100000]
    #[arg(long, value_name = "N")]
    pub particles: Vec<NonZeroUsize>,
    /// About how many rays of each class are timed [default: 500000 to 2000000, a tenth with --quick]
    #[arg(long, value_name = "N")]
    pub rays: Option<NonZeroUsize>,
    /// How many rays of each class are held against the referee [default: 100000, 10000 with --quick]
    #[arg(long, value_name = "N")]
    pub audit: Option<NonZeroUsize>,
    /// Threads [default: 1; of sim, leaks and threads, all processors]
    #[arg(long, value_name = "N", value_parser = threads)]
    pub threads: Option<NonZeroUsize>,
    /// Size of the water (repeatable) [default: by benchmark, 64x64 to 2000x2000]
    #[arg(long, value_name = "NXxNZ")]
    pub columns: Vec<GridSize>,
}

/// The names that a key of the scene takes, from its type.
fn names(key: &str) -> PossibleValuesParser {
    PossibleValuesParser::new(names_of(key).iter().map(String::as_str))
}

/// `--accel` by name, with what it sets: `accel.water` and `accel.objects`.
const PRESETS: [(&str, &str, &str); 4] = [
    ("embree", "embree", "embree"),
    ("stream", "stream", "embree"),
    ("report", "columns", "bsp-report"),
    ("brute", "brute", "brute"),
];

/// The presets whose names both keys take.
fn presets() -> impl Iterator<Item = (&'static str, &'static str, &'static str)> {
    let takes = |key, name| names_of(key).iter().any(|known| known == name);
    PRESETS
        .into_iter()
        .filter(move |&(_, water, objects)| takes("accel.water", water) && takes("accel.objects", objects))
}

/// The names of the presets.
fn accelerators() -> PossibleValuesParser {
    PossibleValuesParser::new(presets().map(|preset| preset.0))
}

fn threads(text: &str) -> Result<NonZeroUsize, String> {
    // More threads than any machine has are a slip of the hand, and each costs a stack.
    let threads = text.parse().ok().filter(|threads: &NonZeroUsize| threads.get() <= 4096);
    threads.ok_or_else(|| "expected a whole number from 1 to 4096".to_owned())
}

fn seconds(text: &str) -> Result<Duration, String> {
    let seconds = text.parse().ok().and_then(|seconds| Duration::try_from_secs_f64(seconds).ok());
    seconds.ok_or_else(|| "expected seconds, at least 0".to_owned())
}

fn metres(text: &str) -> Result<f64, String> {
    let metres = text.parse().ok().filter(|metres: &f64| metres.is_finite() && *metres >= 0.0);
    metres.ok_or_else(|| "expected metres, at least 0".to_owned())
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use clap::CommandFactory;

    use super::*;
    use crate::scene;

    fn render(arguments: &[&str]) -> Result<RenderArgs, String> {
        let arguments = ["whitewater", "render", "scene.toml"].iter().chain(arguments);
        match Cli::try_parse_from(arguments).map_err(|error| error.to_string())?.command {
            Command::Render(arguments) => Ok(*arguments),
            other => Err(format!("{other:?}")),
        }
    }

    #[test]
    fn the_command_line_is_consistent() {
        Cli::command().debug_assert();
    }

    #[test]
    fn options_that_stand_for_keys_become_overrides_and_win() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("scene.toml");
        std::fs::write(&path, "[frames]\nfiles = 'time###.state'\n[surface]\ntolerance = 0.5\n").expect("written");
        let load = |arguments: &[&str]| {
            let overrides = render(arguments).expect("arguments").overrides();
            scene::load(Path::new(&path), &overrides).map_err(|errors| errors.to_string())
        };
        let plain = load(&[]).expect("a scene");
        let both = load(&[
            "--accel",
            "brute",
            "--solver",
            "newton",
            "--compression",
            "piz",
            "--set",
            "surface.solver=reference",
        ]);
        let both = both.expect("a scene");
        assert_eq!(
            (both.scene.accel.water, both.scene.accel.objects),
            (scene::WaterAccel::Brute, scene::ObjectsAccel::Brute)
        );
        assert_eq!(both.scene.surface.solver, scene::SolverKind::Newton);
        assert_eq!(both.scene.output.compression, scene::Compression::Piz);
        assert_ne!(both.hash, plain.hash);
        let wide = load(&["--profile", "blender", "--overscan", "5%", "--stereo", "0.065"]).expect("a scene").scene;
        assert_eq!((wide.output.profile, wide.output.overscan.as_deref()), (scene::Profile::Blender, Some("5%")));
        assert_eq!(wide.camera.stereo, Some(0.065));
        for (arguments, expected) in [
            (&["--overscan", "5"][..], "--overscan: `output.overscan` = 5: expected a share of the frame up to 100%"),
            (&["--stereo", "0.065", "--compression", "dwaa"], "since camera.stereo puts both eyes into one part"),
        ] {
            let error = load(arguments).expect_err("refused");
            assert!(error.contains(expected), "{error}");
        }
        let pixels = load(&["--accuracy", "0.05px"]).expect("a scene").scene.surface;
        assert_eq!((pixels.accuracy, pixels.tolerance), (0.05, None));
        let metres = load(&["--accuracy", "1e-4m"]).expect("a scene").scene.surface;
        assert_eq!(metres.tolerance, Some(1e-4));
        let error = load(&["--accuracy", "1000px"]).expect_err("out of range");
        assert!(error.starts_with("--accuracy: `surface.accuracy` = 1000.0 is out of range"), "{error}");
    }

    #[test]
    fn one_frame_some_frames_or_all() {
        let numbers =
            |arguments: &[&str]| render(arguments).expect("arguments").selection().map(|s| s.numbers().to_vec());
        assert_eq!(numbers(&[]), None);
        assert_eq!(numbers(&["--frame", "7"]), Some(vec![7]));
        assert_eq!(numbers(&["--frames", "1-3,9"]), Some(vec![1, 2, 3, 9]));
        assert!(render(&["--frame", "1", "--frames", "2"]).is_err());
    }

    #[test]
    fn wrong_words_are_refused_with_what_was_expected() {
        for (arguments, expected) in [
            (&["--frames", "5-1"][..], "1-5 instead of 5-1"),
            (&["--crop", "1,2,3"], "X0,Y0,X1,Y1"),
            (&["--threads", "0"], "from 1 to 4096"),
            (&["--memory", "lots"], "512M or 8G"),
            (&["--solver", "newtn"], "'newton'"),
            (&["--accel", "bvh"], "[possible values: embree, stream, report, brute]"),
            (&["--accuracy", "3"], "0.05px or 1e-4m"),
            (&["--set", "render.width"], "expected KEY=VALUE"),
            (&["--simd", "sse"], "portable"),
            (&["--quiet", "--verbose"], "cannot be used with"),
        ] {
            let message = render(arguments).expect_err("refused");
            assert!(message.contains(expected), "{arguments:?}: {message}");
        }
    }
}
