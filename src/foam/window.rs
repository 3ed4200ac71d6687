//! Foam made anew from a window of frames, for frames that carry none: from no foam at the window's start to the frame that
//! is asked for. What comes of it depends on those frames alone, so a frame rendered alone has the foam that it has in a run.

use std::borrow::Borrow;

use super::potential::{WaterMap, impact_power};
use super::{FoamError, FoamState};
use crate::scene;
use crate::state::{Columns, Frame};

/// The foam of the last of `numbers`, from all of them in their order.
///
/// From frame to frame, foam moves in the mean of their flows and forms as at the later one. Layers of the pattern are renewed
/// after `renewal` seconds or a window's length, whichever is less: what a layer's coordinates lead back to is then never before
/// the window, but where the sequence itself begins.
///
/// # Errors
/// What `load` says; frames of different maps; a time that does not go on.
///
/// # Panics
/// If there are no numbers.
pub fn recompute<F: Borrow<Frame>, E: From<FoamError>>(
    settings: &scene::Foam,
    dry_threshold: f64,
    numbers: &[i64],
    mut load: impl FnMut(i64) -> Result<F, E>,
) -> Result<FoamState, E> {
    let (&last, before) = numbers.split_last().expect("a window holds the frame itself");
    let mut earlier = load(numbers[0])?;
    let mut renewal = settings.renewal;
    if let Some(&neighbour) = before.last() {
        let interval = load(last)?.borrow().time - load(neighbour)?.borrow().time;
        // A time that does not go on is an error below, by name.
        if interval > 0.0 {
            renewal = renewal.min(interval * f64::from(settings.window));
        }
    }
    let first = earlier.borrow();
    let columns = &first.columns;
    let mut foam = FoamState::new([columns.nx, columns.nz], columns.width, first.time, renewal);
    for pair in numbers.windows(2) {
        let later = load(pair[1])?;
        step(&mut foam, settings, dry_threshold, (pair[0], earlier.borrow()), (pair[1], later.borrow()))?;
        earlier = later;
    }
    Ok(foam)
}

fn step(
    foam: &mut FoamState,
    settings: &scene::Foam,
    dry_threshold: f64,
    (number, earlier): (i64, &Frame),
    (other, later): (i64, &Frame),
) -> Result<(), FoamError> {
    let (a, b) = (&earlier.columns, &later.columns);
    if (a.nx, a.nz, a.origin, a.width) != (b.nx, b.nz, b.origin, b.width) {
        return Err(FoamError::OtherMap {
            number,
            columns: [a.nx, a.nz],
            origin: a.origin,
            width: a.width,
            other,
            other_columns: [b.nx, b.nz],
            other_origin: b.origin,
            other_width: b.width,
        });
    }
    let dt = later.time - earlier.time;
    if !(dt > 0.0) {
        return Err(FoamError::Time { number, time: earlier.time, other, other_time: later.time });
    }
    let now = WaterMap::of(b, dry_threshold);
    let mut impact = impacts(later, dt);
    impact_power(&mut impact, &now, dt);
    let production = WaterMap { impact: &impact, ..now }.production(&settings.limits, &settings.rate);
    let before = WaterMap::of(a, dry_threshold);
    let mean = |column: usize| {
        let ([x, z], [other_x, other_z]) = (a.flow[column], b.flow[column]);
        // Water that has only come has the flow it came with.
        if before.wet(column) { [0.5 * x + 0.5 * other_x, 0.5 * z + 0.5 * other_z] } else { b.flow[column] }
    };
    let flow: Vec<[f64; 2]> = (0..b.flow.len()).map(mean).collect();
    foam.step(&WaterMap { flow: &flow, ..now }, &production, settings.lifetime, dt);
    Ok(())
}

/// Energy (J) that each column gets from the spray that falls in within `dt` seconds, flying on as it does now.
fn impacts(frame: &Frame, dt: f64) -> Vec<f64> {
    let Columns { origin, width, nx, nz, top, .. } = &frame.columns;
    let mut energy = vec![0.0; nx * nz];
    let spray = &frame.particles;
    for ((position, velocity), mass) in spray.position.iter().zip(&spray.velocity).zip(&spray.mass) {
        let [x, y, z] = *position;
        let [i, j] = [(x - origin[0]) / width[0], (z - origin[1]) / width[1]].map(f64::round);
        if !(i >= 0.0 && j >= 0.0 && i < *nx as f64 && j < *nz as f64) {
            continue;
        }
        let column = j as usize * nx + i as usize;
        // What is under the surface already has given its energy away.
        if y > top[column] && y + velocity[1] * dt <= top[column] {
            energy[column] += 0.5 * mass * velocity.iter().map(|v| v * v).sum::<f64>();
        }
    }
    energy
}

#[cfg(test)]
mod tests {
    use super::super::potential::tests::water;
    use super::*;

    /// A vortex that drifts eastward.
    fn frame(number: i64) -> Frame {
        let time = number as f64 / 24.0;
        let columns = water([32, 24], 0.25, |x, z| {
            let (x, z) = (x - 3.0 - time, z - 3.0);
            let spin = 6.0 * (-(x * x + z * z) / 2.0).exp();
            [1.0 + spin * z, -spin * x]
        });
        Frame { time, columns, ..Frame::default() }
    }

    fn alone(number: i64, window: u32) -> FoamState {
        let settings = scene::Foam { window, ..scene::Foam::default() };
        let numbers: Vec<i64> = ((number - i64::from(window)).max(0)..=number).collect();
        recompute(&settings, 0.001, &numbers, |number| Ok::<_, FoamError>(frame(number))).unwrap()
    }

    #[test]
    fn a_frame_alone_has_the_foam_that_it_has_in_a_run() {
        // A run that keeps the frames it has read, as the renderer does, and starts at the sequence's beginning.
        let frames: Vec<Frame> = (0..12).map(frame).collect();
        let settings = scene::Foam { window: 5, ..scene::Foam::default() };
        for number in 0..12 {
            let numbers: Vec<i64> = ((number - 5).max(0)..=number).collect();
            let run =
                recompute(&settings, 0.001, &numbers, |number| Ok::<_, FoamError>(&frames[number as usize])).unwrap();
            assert_eq!(run, alone(number, 5), "frame {number}");
        }
        assert!(alone(7, 5).density().iter().any(|&density| density > 0.1), "the vortex makes foam");
        assert!(alone(0, 5).density().iter().all(|&density| density == 0.0), "the first frame has none before it");
    }

    #[test]
    fn consecutive_windows_agree_on_where_the_pattern_is() {
        // Of each layer, what it leads back to must lie within the window: then a longer one changes nothing.
        let mut settings = scene::Foam { window: 48, ..scene::Foam::default() };
        settings.renewal = 0.25;
        let from = |first: i64| {
            let numbers: Vec<i64> = (first..=40).collect();
            recompute(&settings, 0.001, &numbers, |number| Ok::<_, FoamError>(frame(number))).unwrap()
        };
        let (long, short) = (from(10), from(32));
        assert_eq!([long.offset(0), long.offset(1)], [short.offset(0), short.offset(1)]);
        assert_ne!(long.density(), short.density());
    }

    #[test]
    fn spray_that_is_about_to_fall_in_counts_where_it_falls() {
        let mut frame = frame(0);
        frame.columns.origin = [10.0, -5.0];
        let at = |y: f64, x: f64| [x, y, -5.0 + 0.25 * 3.0];
        frame.particles.position = vec![at(1.05, 10.5), at(1.05, 10.5), at(0.9, 10.5), at(3.0, 10.5), at(1.05, 0.0)];
        frame.particles.velocity =
            vec![[0.0, -4.0, 3.0], [0.0, 4.0, 3.0], [0.0, -4.0, 3.0], [0.0, -4.0, 0.0], [0.0, -4.0, 0.0]];
        frame.particles.mass = vec![0.1; 5];
        let energy = impacts(&frame, 1.0 / 24.0);
        assert!((energy[3 * 32 + 2] - 0.5 * 0.1 * 25.0).abs() < 1e-12);
        assert_eq!(energy.iter().filter(|&&energy| energy != 0.0).count(), 1);
    }

    #[test]
    fn frames_that_do_not_follow_each_other_are_refused_by_name() {
        let recomputed = |change: &dyn Fn(&mut Frame)| {
            let settings = scene::Foam { window: 3, ..scene::Foam::default() };
            recompute(&settings, 0.001, &[4, 5, 6], |number| {
                let mut frame = frame(number);
                if number == 5 {
                    change(&mut frame);
                }
                Ok::<_, FoamError>(frame)
            })
            .unwrap_err()
            .to_string()
        };
        let time = recomputed(&|frame| frame.time = 4.0 / 24.0);
        assert!(time.contains("frame 4 is at") && time.contains("frame 5 at") && time.contains("later time"), "{time}");
        let map = recomputed(&|frame| frame.columns.width = [0.5, 0.25]);
        assert!(map.contains("frame 4 has 32 x 24 columns of 0.25") && map.contains("frame 5 has"), "{map}");
    }
}
