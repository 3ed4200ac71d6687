//! Frames and checkpoints to disk, on a thread of their own: the next frame is simulated meanwhile.
//!
//! One job at a time waits and one is written, so that memory stays bounded. Files come in their order: a checkpoint never
//! speaks of a frame that is not there.

use std::path::PathBuf;
use std::sync::mpsc::{self, Receiver, SyncSender};
use std::thread::JoinHandle;
use std::time::Instant;

use crate::sim::Checkpoint;
use crate::state::{self, Encoding, Frame, Packing};

/// What is written together.
pub(super) struct Job {
    /// A frame, unless the simulation is still settling.
    pub(super) frame: Option<FrameFile>,
    /// Where to go on after it.
    pub(super) checkpoint: Checkpoint,
}

/// A frame and where it goes.
pub(super) struct FrameFile {
    pub(super) number: u64,
    pub(super) frame: Frame,
    pub(super) maps: Vec<(&'static str, Vec<f32>)>,
    pub(super) path: PathBuf,
}

/// A frame that is on disk.
#[derive(Clone, Copy, Debug)]
pub(super) struct Written {
    pub(super) number: u64,
    pub(super) bytes: u64,
    /// For the frame and its checkpoint.
    pub(super) seconds: f64,
}

/// The thread that writes.
pub(super) struct Writer {
    jobs: SyncSender<Job>,
    written: Receiver<Written>,
    thread: JoinHandle<anyhow::Result<()>>,
}

impl Writer {
    /// Frames in this form, and the checkpoint at this place.
    pub(super) fn start(encoding: Encoding, checkpoint: PathBuf) -> anyhow::Result<Self> {
        // No queue: who brings a job waits until the one before is written.
        let (jobs, take) = mpsc::sync_channel::<Job>(0);
        let (tell, written) = mpsc::channel();
        let thread = std::thread::Builder::new().name("writer".to_owned()).spawn(move || {
            for job in take {
                let clock = Instant::now();
                let mut done = None;
                if let Some(FrameFile { number, frame, maps, path }) = &job.frame {
                    let maps: Vec<_> = maps.iter().map(|(name, values)| (*name, values.as_slice())).collect();
                    state::save_frame_with(frame, &maps, path, encoding, Packing::Quick)?;
                    done = Some((*number, std::fs::metadata(path).map_or(0, |metadata| metadata.len())));
                }
                job.checkpoint.save(&checkpoint)?;
                if let Some((number, bytes)) = done {
                    // Nobody listens any more once the run has failed: the files count.
                    let _ = tell.send(Written { number, bytes, seconds: clock.elapsed().as_secs_f64() });
                }
            }
            Ok(())
        })?;
        Ok(Self { jobs, written, thread })
    }

    /// Hands a job over as soon as the one before is written. False if the writer has failed; [`Writer::finish`] says why.
    #[must_use]
    pub(super) fn write(&self, job: Job) -> bool {
        self.jobs.send(job).is_ok()
    }

    /// What was written since this was asked before.
    pub(super) fn written(&self) -> Vec<Written> {
        self.written.try_iter().collect()
    }

    /// Waits for the last job.
    ///
    /// # Errors
    /// Why a file could not be written; those before it are whole.
    pub(super) fn finish(self) -> (Vec<Written>, anyhow::Result<()>) {
        drop(self.jobs);
        let result = match self.thread.join() {
            Ok(result) => result,
            Err(panic) => std::panic::resume_unwind(panic),
        };
        (self.written.try_iter().collect(), result)
    }
}
