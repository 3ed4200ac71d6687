//! `whitewater simulate`: a scene's frames, made one after another, each with a checkpoint to go on from.
//!
//! What may be written where is in `folder`, the thread that writes in `writer`, the looks in `progress` and `report`.

mod folder;
mod progress;
mod report;
mod writer;

use std::time::Instant;

use anyhow::{anyhow, ensure};

use self::folder::Folder;
use self::progress::Progress;
use self::report::{Report, Row};
use self::writer::{FrameFile, Job, Writer};
use super::args::SimulateArgs;
use super::errors::{CliError, Outcome};
use super::signals::StopFlag;
use super::values::FrameSelection;
use crate::scene::{self, LoadedScene};
use crate::sim::{self, Advance, Checkpoint, Identity, Phases, Simulator};
use crate::state::{Encoding, FramePattern};

/// Runs the command.
///
/// # Errors
/// The scene or what it names is wrong; files are in the way; waves outrun the steps; a file cannot be written.
pub fn run(arguments: &SimulateArgs) -> Result<Outcome, CliError> {
    let stop = StopFlag::install().map_err(CliError::Signals)?;
    let clock = Instant::now();
    let loaded = scene::load(&arguments.scene.scene, &arguments.scene.set)?;
    let threads = arguments.threads.or(std::thread::available_parallelism().ok()).map_or(1, std::num::NonZero::get);
    // A program that calls twice keeps its first pool; which one never shows in the frames.
    let _ = rayon::ThreadPoolBuilder::new().num_threads(threads).build_global();
    let mut run = Run::prepare(arguments, &loaded)?;
    run.report.scene.clone_from(&loaded.hash);
    run.report.threads = threads;
    run.report.seconds.prepare = clock.elapsed().as_secs_f64();

    let advance = run.simulate(&stop)?;
    run.report.close(&run.simulator, clock.elapsed().as_secs_f64());
    run.progress.end();
    run.progress.say(&run.report.sentence(run.folder.directory()));
    if let Some(path) = &arguments.stats {
        run.report.save(path)?;
    }
    match (advance, stop.signal()) {
        (Advance::Stopped, Some(signal)) => {
            run.progress.say("stopped; the same command goes on from here");
            Ok(Outcome::Stopped(signal))
        }
        _ => Ok(Outcome::Done),
    }
}

/// When pieces of the settling and frames end.
#[derive(Clone, Copy, Debug)]
struct Schedule {
    /// Seconds before frame 0.
    settle: f64,
    /// Pieces that they are cut into, each with a checkpoint at its end.
    pieces: u64,
    /// Frames per second.
    rate: f64,
    /// How many frames there shall be.
    frames: u64,
}

impl Schedule {
    fn new(settle: f64, rate: f64, frames: u64) -> Self {
        // A second each, but never so many that checkpoints take longer than what is between them.
        Self { settle, pieces: settle.ceil().min(100.0) as u64, rate, frames }
    }

    /// The end (s) of piece `piece`, from 1 on; that of the last is 0.
    fn piece(&self, piece: u64) -> f64 {
        // Not the negative of it, which would make the last -0.
        0.0 - self.settle * (1.0 - piece as f64 / self.pieces as f64)
    }

    /// The time (s) of a frame.
    fn frame(&self, number: u64) -> f64 {
        number as f64 / self.rate
    }
}

/// The number of frames that `duration` seconds have at `rate` per second, both ends counted.
fn frames_in(duration: f64, rate: f64) -> f64 {
    let last = duration * rate;
    // 0.29 s at 100 per second are 29 frames, though the product is an ulp less: both factors are rounded, and it is too.
    let nearest = last.round();
    let last = if (last - nearest).abs() <= 2.0 * f64::EPSILON * nearest { nearest } else { last.floor() };
    last + 1.0
}

/// One run of the command.
struct Run {
    folder: Folder,
    encoding: Encoding,
    identity: Identity,
    simulator: Simulator,
    schedule: Schedule,
    /// Frames on disk, and pieces of the settling that are over.
    made: u64,
    settled: u64,
    /// Whether there is no checkpoint yet.
    fresh: bool,
    report: Report,
    progress: Progress,
}

impl Run {
    /// Everything that can be read and checked before the first step.
    fn prepare(arguments: &SimulateArgs, loaded: &LoadedScene) -> anyhow::Result<Self> {
        let scene = &loaded.scene;
        let Some(mut settings) = scene.simulation.clone() else {
            return Err(anyhow!(
                "{}: there is no [simulation] table, which says how the frames are made; \
                 `whitewater schema` lists its keys",
                loaded.path.display()
            ));
        };
        if settings.model.is_none() {
            settings.model.clone_from(&scene.environment.model);
        }
        let rate = scene.frames.fps;
        let frames = match arguments.frames {
            Some(frames) => frames,
            None => {
                let frames = frames_in(settings.duration, rate);
                ensure!(
                    frames <= FrameSelection::MOST as f64,
                    "simulation.duration = {} s at {rate} frames per second are {frames:.0} frames; \
                     expected at most {}, or --frames",
                    settings.duration,
                    FrameSelection::MOST
                );
                frames as u64
            }
        };
        let mut pattern = FramePattern::new(&scene.frames.files, &loaded.directory)?;
        if arguments.text && pattern.name().ends_with(".npz") {
            pattern = pattern.with_extension("state");
        }
        if let Some(directory) = &arguments.output {
            pattern = pattern.in_directory(directory);
        }

        let setup = sim::prepare(&settings, &loaded.directory)?;
        let mut identity = Identity::new(&setup, &settings, 1.0 / rate);
        let mut simulator = Simulator::new(setup.clone(), &settings, 1.0 / rate)?;
        if settings.foam {
            ensure!(
                !arguments.text,
                "simulation.foam = true with --text: text frames have no place for foam; leave out --text, or say \
                 --set simulation.foam=false"
            );
            let dry = scene.surface.dry_threshold;
            (identity, simulator) = (identity.with_foam(&scene.foam, dry), simulator.with_foam(&scene.foam, dry));
        }
        let schedule = Schedule::new(settings.settle, rate, frames);
        let folder = Folder::open(pattern, frames)?;
        let former = if arguments.restart { None } else { folder.former(identity)? };
        if arguments.restart {
            folder.restart(frames)?;
        }
        folder.write_model(&setup, former.is_some(), arguments.restart)?;
        let fresh = former.is_none();
        let (mut made, mut settled) = (0, 0);
        if let Some(checkpoint) = former {
            (made, settled) = (checkpoint.frames, checkpoint.settled);
            let expected = if made > 0 { schedule.frame(made - 1) } else { schedule.piece(settled) };
            let sound = made > 0 || settled <= schedule.pieces;
            let sound = sound && (settled == 0 && made == 0 || checkpoint.state.time == expected);
            ensure!(
                sound && simulator.resume(checkpoint.state),
                "{}: damaged: its state is not one of this simulation; --restart makes all frames anew",
                folder.checkpoint().display()
            );
            tracing::debug!(made, settled, "going on from {}", folder.checkpoint().display());
        }
        let times = [-settings.settle, simulator.time(), schedule.frame(frames - 1)];
        Ok(Self {
            encoding: if arguments.text { Encoding::Text } else { Encoding::Npz },
            progress: Progress::new(arguments.quiet, frames, times),
            report: Report {
                version: env!("CARGO_PKG_VERSION"),
                columns: [setup.grid.nx, setup.grid.nz],
                frames: made,
                ..Report::default()
            },
            folder,
            identity,
            simulator,
            schedule,
            made,
            settled,
            fresh,
        })
    }

    /// Makes the frames that are not there yet.
    fn simulate(&mut self, stop: &StopFlag) -> anyhow::Result<Advance> {
        if self.made >= self.schedule.frames {
            return Ok(Advance::Reached);
        }
        let writer = Writer::start(self.encoding, self.folder.checkpoint().to_owned())?;
        let result = self.make(&writer, stop);
        let (written, wrote) = writer.finish();
        self.report.written(&written);
        // If the writer failed, that is why the rest ended.
        wrote?;
        result
    }

    fn make(&mut self, writer: &Writer, stop: &StopFlag) -> anyhow::Result<Advance> {
        // From the first frame on, the folder must say whose frames are in it.
        if self.fresh && !self.hand_over(writer, None) {
            return Ok(Advance::Stopped);
        }
        while self.made == 0 && self.settled < self.schedule.pieces {
            if self.advance_to(self.schedule.piece(self.settled + 1), 0, stop)? == Advance::Stopped {
                return Ok(Advance::Stopped);
            }
            self.settled += 1;
            if !self.hand_over(writer, None) {
                return Ok(Advance::Stopped);
            }
        }
        let mut before = (0, Phases::default());
        for number in self.made..self.schedule.frames {
            if self.advance_to(self.schedule.frame(number), number, stop)? == Advance::Stopped {
                return Ok(Advance::Stopped);
            }
            let path = self.folder.frame(number);
            let frame = self.simulator.frame();
            // Only the first can be there: the run before was ended between a frame and its checkpoint.
            if number == self.made && path.exists() && !self.fresh {
                self.folder.verify(number, &frame)?;
            }
            let work = self.simulator.work();
            self.report.rows.push(Row {
                frame: number,
                time: self.simulator.time(),
                steps: work.steps - before.0,
                seconds: work.seconds - before.1,
                particles: self.simulator.particles(),
                bytes: 0,
                writing: 0.0,
                ledger: self.simulator.balance(),
            });
            before = (work.steps, work.seconds);
            self.made = number + 1;
            let file = FrameFile { number, frame, maps: self.simulator.maps(), path };
            if !self.hand_over(writer, Some(file)) {
                return Ok(Advance::Stopped);
            }
            self.report.written(&writer.written());
        }
        Ok(Advance::Reached)
    }

    fn advance_to(&mut self, time: f64, frame: u64, stop: &StopFlag) -> anyhow::Result<Advance> {
        let progress = &mut self.progress;
        Ok(self.simulator.advance_to(time, stop.flag(), &mut |moment| progress.moment(frame, moment))?)
    }

    /// Gives the writer a frame, if there is one, and the state after it; false if the writer has failed.
    fn hand_over(&mut self, writer: &Writer, frame: Option<FrameFile>) -> bool {
        let checkpoint = Checkpoint {
            identity: self.identity,
            files: self.folder.files().to_owned(),
            frames: self.made,
            settled: self.settled,
            state: self.simulator.state(),
        };
        let clock = Instant::now();
        let taken = writer.write(Job { frame, checkpoint });
        self.report.seconds.waiting += clock.elapsed().as_secs_f64();
        taken
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_duration_has_one_frame_more_than_intervals() {
        for (duration, rate, frames) in [
            (2.0, 24.0, 49.0),
            (0.0, 24.0, 1.0),
            (0.29, 100.0, 30.0),
            (0.7, 10.0, 8.0),
            (0.99, 1.0, 1.0),
            (1e6, 0.001, 1001.0),
        ] {
            assert_eq!(frames_in(duration, rate), frames, "{duration} s at {rate}");
        }
    }

    #[test]
    fn pieces_of_the_settling_end_at_zero() {
        for (settle, pieces) in [(0.0, 0), (0.5, 1), (2.5, 3), (1000.0, 100)] {
            let schedule = Schedule::new(settle, 24.0, 2);
            assert_eq!(schedule.pieces, pieces);
            if pieces > 0 {
                assert_eq!(schedule.piece(pieces).to_bits(), 0.0_f64.to_bits());
                let ends: Vec<f64> = (0..=pieces).map(|piece| schedule.piece(piece)).collect();
                assert!(ends[0] == -settle && ends.is_sorted(), "{ends:?}");
            }
        }
    }
}
