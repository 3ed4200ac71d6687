//! The moments of a frame at which motion blur looks: water, spray and camera within the time that the shutter is open.
//!
//! The shutter opens at the frame's own time; of `n` moments the k-th stands in the middle of the k-th n-th of the
//! exposure. Which state the simulation has in between is in `state::between`; who samples which moment is the renderer's.

use anyhow::Context;

use super::errors::CliError;
use super::load;
use super::render::MatterOfFrame;
use super::values::Bytes;
use crate::accel::{self, Accelerator};
use crate::foam::FoamState;
use crate::lower::{self, Environment, LoweredFrame, Thinning, View, Volume};
use crate::render::{Camera, CameraPath};
use crate::scene::{self, LoadedScene};
use crate::simd::SimdLevel;
use crate::state::{self, Frame, FrameSequence};
use crate::terrain::GroundTexture;

/// Everything that can be hit at one moment, with its looks.
pub(super) struct MomentOfFrame {
    /// Frames after the frame's own number.
    pub(super) time: f64,
    /// Parts around the scene origin, which all moments of a frame share.
    pub(super) lowered: LoweredFrame,
    /// Who finds the hits.
    pub(super) accelerator: Box<dyn Accelerator>,
    /// Ground and waterline.
    pub(super) matter: MatterOfFrame,
}

/// When the moments are, in frames after the frame's own number.
///
/// Without motion blur it is the frame's own time.
fn times(camera: &scene::Camera) -> Vec<f64> {
    if camera.motion_steps <= 1 || camera.shutter == 0.0 {
        return vec![0.0];
    }
    let steps = f64::from(camera.motion_steps);
    (0..camera.motion_steps).map(|step| (f64::from(step) + 0.5) / steps * camera.shutter).collect()
}

/// The state at each moment of a frame, in order of time.
///
/// The next frame is read only if a moment lies after the frame's own. Where there is none, the water stands still, and a
/// warning says so: nothing is extrapolated. The spray needs no next frame.
///
/// # Errors
/// A frame that is not there or damaged; two frames of different columns.
pub(super) fn states(loaded: &LoadedScene, frames: &FrameSequence, number: i64) -> Result<Vec<(f64, Frame)>, CliError> {
    let now = load::frame(loaded, frames, number)?;
    let times = times(&loaded.scene.camera);
    if times == [0.0] {
        return Ok(vec![(0.0, now)]);
    }
    let fps = loaded.scene.frames.fps;
    let after = number.checked_add(1).and_then(|after| Some((after, frames.path(after)?)));
    let Some((after, path)) = after else {
        tracing::warn!("frame {number} is followed by none: its water stands still while the shutter is open");
        let carried_on = |time| {
            let particles = state::carried_on(&now.particles, time, fps)?;
            // The time goes on with the particles' ages: when each broke free stays the same.
            Ok((time, Frame { time: now.time + time / fps, particles, ..now.clone() }))
        };
        let states: Result<Vec<_>, state::StateError> = times.into_iter().map(carried_on).collect();
        return Ok(states.map_err(anyhow::Error::from)?);
    };
    let next = load::frame(loaded, frames, after)?;
    let between = |time| Ok((time, state::between(&now, &next, time, fps)?));
    let states: Result<Vec<_>, state::StateError> = times.into_iter().map(between).collect();
    Ok(states.with_context(|| {
        let file = frames.path(number).unwrap_or(path);
        format!("{} and {}: no motion blur (camera.motion_steps) between them", file.display(), path.display())
    })?)
}

impl MomentOfFrame {
    /// Builds what can be hit from the states of [`states`].
    ///
    /// # Errors
    /// A state that cannot be lowered; an accelerator that cannot be built.
    pub(super) fn build_all(
        states: &[(f64, Frame)],
        foam: Option<&FoamState>,
        number: i64,
        settings: &scene::Scene,
        environment: &Environment,
        path: &CameraPath,
        simd: SimdLevel,
        budget: Option<u64>,
        volume: Option<&Volume>,
        ground_texture: Option<&GroundTexture>,
    ) -> Result<Vec<Self>, CliError> {
        let budget = lower::within_budget(volume, budget, states.len()).map_err(anyhow::Error::from)?;
        let size = (settings.render.width, settings.render.height);
        let Some((_, first)) = states.first() else { return Ok(Vec::new()) };
        // The film adds up samples of all moments: they must speak of one local frame.
        let origin = lower::scene_origin(&first.columns);
        let moment = |(time, state): &(f64, Frame)| {
            let camera = Camera::new(path.pose(number as f64 + time), size, settings.camera.f_number)
                .with_pixel_aspect(settings.camera.pixel_aspect);
            let view = View { eye: camera.pose.eye, pixel_angle: camera.pixel_angle() };
            let mut lowered = lower::lower_within(budget, origin, settings, state, environment, Some(view), simd)
                .map_err(anyhow::Error::from)?;
            if let Some(volume) = volume {
                lowered.add_volume(volume, time / settings.frames.fps).map_err(anyhow::Error::from)?;
            }
            let accelerator = accel::build(&lowered.lowered, &settings.accel, simd).map_err(anyhow::Error::from)?;
            let matter = MatterOfFrame::new(settings, state, &lowered, foam, ground_texture);
            Ok(Self { time: *time, lowered, accelerator, matter })
        };
        let moments: Result<Vec<Self>, CliError> = states.iter().map(moment).collect();
        if let Ok([first, ..]) = moments.as_deref() {
            tell(&first.lowered.thinning, settings);
        }
        moments
    }
}

/// Says what was thinned: a warning where memory was the reason.
fn tell(thinning: &Thinning, settings: &scene::Scene) {
    let Thinning { found, drawn, least_pixels, over_budget } = *thinning;
    if let Some([budget, all]) = over_budget {
        tracing::warn!(
            "--memory {}: {found} particles would take {} more than all else leaves; drew {drawn} of them, each wider \
             (those under {least_pixels:.3} pixels of radius)",
            Bytes(budget),
            Bytes(all),
        );
    } else if drawn < found {
        tracing::info!(
            "drew {drawn} of {found} particles, those under {} pixels of radius (particles.least_pixels) wider for all",
            settings.particles.least_pixels
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::state::{Encoding, Particles, read_frame, save_frame};

    /// The scene `tiny` (two frames, spray, a camera that moves) with overrides.
    fn tiny(overrides: &[&str]) -> (LoadedScene, FrameSequence) {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/tiny/scene.toml");
        let overrides: Vec<_> = overrides.iter().map(|text| text.parse().unwrap()).collect();
        let loaded = scene::load(path.as_ref(), &overrides).unwrap();
        let frames = load::frames(&loaded).unwrap();
        (loaded, frames)
    }

    const BLUR: [&str; 2] = ["camera.motion_steps=4", "camera.shutter=0.5"];

    #[test]
    fn moments_stand_in_the_middle_of_equal_parts_of_the_exposure() {
        let (loaded, _) = tiny(&BLUR);
        assert_eq!(times(&loaded.scene.camera), [0.0625, 0.1875, 0.3125, 0.4375]);
        for still in [&["camera.shutter=0.5"][..], &["camera.motion_steps=8", "camera.shutter=0"]] {
            assert_eq!(times(&tiny(still).0.scene.camera), [0.0]);
        }
    }

    #[test]
    fn without_motion_blur_there_is_the_frame_itself() {
        let (loaded, frames) = tiny(&[]);
        let states = states(&loaded, &frames, 0).unwrap();
        assert_eq!(states, [(0.0, load::frame(&loaded, &frames, 0).unwrap())]);
    }

    #[test]
    fn a_moment_has_water_on_its_way_and_spray_moved_by_its_velocity() {
        let (loaded, frames) = tiny(&BLUR);
        let (now, next) = (load::frame(&loaded, &frames, 0).unwrap(), load::frame(&loaded, &frames, 1).unwrap());
        let wet = |frame: &Frame, column: usize| frame.columns.top[column] - frame.columns.base[column] > 0.01;
        let column = (0..now.columns.top.len())
            .find(|&column| {
                wet(&now, column)
                    && wet(&next, column)
                    && (next.columns.top[column] - now.columns.top[column]).abs() > 1e-3
            })
            .expect("water that moves");
        let mut moved = 0;
        for (time, state) in states(&loaded, &frames, 0).unwrap() {
            let expected = now.columns.top[column] + time * (next.columns.top[column] - now.columns.top[column]);
            assert!((state.columns.top[column] - expected).abs() < 1e-12, "{time}");
            // Those of the frame come first; who breaks free on the way stands behind them.
            let count = now.particles.position.len();
            assert!(state.particles.position.len() >= count);
            for (index, position) in state.particles.position.iter().enumerate().take(count) {
                for axis in 0..3 {
                    let way = now.particles.velocity[index][axis] * time / loaded.scene.frames.fps;
                    assert!((position[axis] - now.particles.position[index][axis] - way).abs() < 1e-12);
                    moved += usize::from(way.abs() > 1e-3);
                }
            }
        }
        assert!(moved > 40, "only {moved} of the ways are longer than a millimetre");
    }

    #[test]
    fn after_the_last_frame_the_water_stands_and_the_spray_flies() {
        let (loaded, frames) = tiny(&BLUR);
        let now = load::frame(&loaded, &frames, 1).unwrap();
        let states = states(&loaded, &frames, 1).unwrap();
        assert_eq!(states.len(), 4);
        for (time, state) in states {
            assert_eq!(state.columns, now.columns);
            assert_eq!(state.particles, state::carried_on(&now.particles, time, 24.0).unwrap());
            assert_ne!(state.particles, now.particles);
        }
    }

    #[test]
    fn moments_share_one_origin_and_the_first_alone_is_as_without_blur() {
        let (loaded, frames) = tiny(&BLUR);
        let first = load::frame(&loaded, &frames, 0).unwrap();
        let mut risen = first.clone();
        risen.columns.top.iter_mut().for_each(|top| *top += 40.0);
        let path = CameraPath::from_scene(&loaded.scene.camera, || unreachable!("the path has keys")).unwrap();
        let environment = Environment::default();
        let states = [(0.0, first.clone()), (0.5, risen)];
        let settings = &loaded.scene;
        let build = |states: &[_]| {
            let simd = SimdLevel::Portable;
            MomentOfFrame::build_all(states, None, 0, settings, &environment, &path, simd, None, None, None).unwrap()
        };
        let moments = build(&states);
        assert_eq!(moments[0].lowered.lowered.origin, moments[1].lowered.lowered.origin);
        assert_eq!([moments[0].time, moments[1].time], [0.0, 0.5]);
        let alone = lower::lower(settings, &first, &environment, None, SimdLevel::Portable).unwrap();
        assert_eq!(moments[0].lowered.lowered.origin, alone.lowered.origin);
        // Water that has risen by 40 m stands 40 m higher around the same origin.
        let height = |moment: &MomentOfFrame| moment.lowered.water.as_ref().unwrap().point(0.0, 0.0).unwrap().0;
        let rise = height(&moments[1]) - height(&moments[0]);
        assert!((rise - 40.0).abs() < 1e-3, "{rise}");
    }

    #[test]
    fn frames_of_different_columns_are_refused_by_the_names_of_both_files() {
        let folder = tempfile::tempdir().unwrap();
        let (loaded, frames) = tiny(&BLUR);
        let mut frame = read_frame(frames.path(0).unwrap(), 1e-3).unwrap();
        frame.particles = Particles::default();
        save_frame(&frame, folder.path().join("time000.state"), Encoding::Text).unwrap();
        frame.columns.origin[0] += 0.5;
        save_frame(&frame, folder.path().join("time001.npz"), Encoding::Npz).unwrap();
        let other = FrameSequence::find("time###.state", folder.path()).unwrap();
        let CliError::Other(error) = states(&loaded, &other, 0).unwrap_err() else { panic!("another error") };
        let text = format!("{error:#}");
        for part in ["time000.state", "time001.npz", "origin"] {
            assert!(text.contains(part), "{part} is missing in {text}");
        }
    }
}
