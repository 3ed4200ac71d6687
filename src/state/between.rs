//! A moment between two frames, for motion blur: the water between its two states, the spray carried on by its velocity.
//!
//! Water is never extrapolated, and particles are never matched by index: they are born and die between frames, which is the
//! matter of `lives`. Which moments a picture needs is decided by whoever renders it.

use super::{Columns, Frame, StateError, lives};

/// The state a share of a frame after `now`: 0 is `now` to the bit, 1 has the water of `next`.
///
/// *Water*: `base`, depth and pressure go linearly from one frame to the other, and `flow` so that momentum (depth times
/// flow) does. A column that is dry in one frame has a depth of 0 there, whatever its `top` says within the threshold:
/// the water rises from the bed or sinks into it, and moves as it does in the frame where there is any. So no column ever
/// stands above both of its depths or below the bed.
///
/// *Spray*: the particles of `now`, each moved on by its velocity for `share / fps` seconds and as much older; those of `next`
/// that have broken free by then; without those that end by then, where both frames have `id`s (see `lives`).
///
/// The arrays that we do not read are those of `now`.
///
/// # Errors
/// [`StateError::Share`], [`StateError::Fps`]; [`StateError::Grids`] if the frames' columns are not the same columns.
pub fn between(now: &Frame, next: &Frame, share: f64, fps: f64) -> Result<Frame, StateError> {
    if !(0.0..=1.0).contains(&share) {
        return Err(StateError::Share(share));
    }
    same_grid(&now.columns, &next.columns)?;
    // Named one by one, so that a new field of a frame cannot be forgotten here.
    let Frame { time, columns, particles, extra } = now;
    Ok(Frame {
        time: mix(*time, next.time, share),
        columns: if share == 0.0 { columns.clone() } else { columns_between(columns, &next.columns, share) },
        particles: lives::between(particles, &next.particles, share, fps)?,
        extra: extra.clone(),
    })
}

/// From `a` to `b`; `a` itself where nothing changes, however it is rounded.
fn mix(a: f64, b: f64, share: f64) -> f64 {
    a + (b - a) * share
}

fn columns_between(now: &Columns, next: &Columns, share: f64) -> Columns {
    let map = |now: &[f64], next: &[f64]| now.iter().zip(next).map(|(&a, &b)| mix(a, b, share)).collect::<Vec<f64>>();
    let base = map(&now.base, &next.base);
    let mut top = map(&now.top, &next.top);
    let mut flow = now.flow.clone();
    for column in 0..base.len() {
        let depth = [now, next].map(|state| (state.top[column] - state.base[column]).max(0.0));
        if depth.contains(&0.0) {
            // A dry column's top may lie a threshold under its base: it must not pull the water under the bed.
            top[column] = base[column] + mix(depth[0], depth[1], share);
        }
        let weight = [(1.0 - share) * depth[0], share * depth[1]];
        let water = weight[0] + weight[1];
        for axis in 0..2 {
            let (a, b) = (now.flow[column][axis], next.flow[column][axis]);
            flow[column][axis] = if water > 0.0 { mix(a, b, weight[1] / water) } else { mix(a, b, share) };
        }
    }
    let pressure = map(&now.pressure, &next.pressure);
    Columns { origin: now.origin, width: now.width, nx: now.nx, nz: now.nz, base, top, pressure, flow }
}

/// Checks that column by column the two frames speak of the same places.
fn same_grid(now: &Columns, next: &Columns) -> Result<(), StateError> {
    let differ = |what, now: String, next: String| Err(StateError::Grids { what, now, next });
    let pair = |[x, z]: [f64; 2]| format!("{x} {z}");
    if (now.nx, now.nz) != (next.nx, next.nz) {
        return differ("columns", format!("{} {}", now.nx, now.nz), format!("{} {}", next.nx, next.nz));
    }
    if now.width != next.width {
        return differ("width", pair(now.width), pair(next.width));
    }
    if now.origin != next.origin {
        return differ("origin", pair(now.origin), pair(next.origin));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::state::Particles;

    const FPS: f64 = 24.0;

    /// 3x3 columns over a bed at 1 m, all of one depth and flow.
    fn frame(time: f64, depth: f64, flow: f64) -> Frame {
        let columns = Columns {
            origin: [5.0, -2.0],
            width: [0.5, 0.25],
            nx: 3,
            nz: 3,
            base: vec![1.0; 9],
            top: vec![1.0 + depth; 9],
            pressure: vec![9810.0 * depth; 9],
            flow: vec![[flow, -flow]; 9],
        };
        Frame { time, columns, ..Frame::default() }
    }

    fn spray(count: usize) -> Particles {
        let number = |index: usize| index as f64;
        Particles {
            position: (0..count).map(|index| [number(index), 2.0, -1.0]).collect(),
            velocity: (0..count).map(|index| [3.0, number(index), -12.0]).collect(),
            mass: vec![0.1; count],
            age: (0..count).map(|index| 0.5 * number(index)).collect(),
            id: Some((0..count as u64).rev().collect()),
        }
    }

    fn close(a: f64, b: f64) {
        assert!((a - b).abs() <= 1e-12 * (1.0 + b.abs()), "{a} against {b}");
    }

    #[test]
    fn halfway_the_water_is_halfway() {
        let (now, next) = (frame(2.0, 0.5, 1.0), frame(2.5, 1.5, 3.0));
        let middle = between(&now, &next, 0.5, FPS).unwrap();
        assert_eq!(middle.time, 2.25);
        close(middle.columns.top[4], 2.0);
        close(middle.columns.pressure[4], 9810.0);
        // Momentum: (0.5 * 1 + 1.5 * 3) / 2 over a depth of 1.
        close(middle.columns.flow[4][0], 2.5);
        close(middle.columns.flow[4][1], -2.5);
        let quarter = between(&now, &next, 0.25, FPS).unwrap();
        close(quarter.columns.top[0], 1.75);
        let end = between(&now, &next, 1.0, FPS).unwrap();
        for (column, top) in end.columns.top.iter().enumerate() {
            close(*top, next.columns.top[column]);
            close(end.columns.flow[column][0], 3.0);
        }
    }

    #[test]
    fn at_the_start_nothing_has_changed_to_the_bit() {
        let mut now = frame(0.1, 0.3, 0.7);
        now.particles = spray(5);
        // What a dry column may look like.
        now.columns.top[3] = 0.9995;
        assert_eq!(between(&now, &frame(0.3, 0.8, 0.1), 0.0, FPS).unwrap(), now);
    }

    #[test]
    fn still_ground_and_water_stay_to_the_bit() {
        let mut now = frame(0.0, 0.1, 0.3);
        now.columns.base[2] = 0.1;
        let moved = between(&now, &Frame { time: 1.0, ..now.clone() }, 0.3, FPS).unwrap();
        assert_eq!(moved.columns, now.columns);
    }

    #[test]
    fn water_comes_out_of_the_bed_and_goes_into_it() {
        let (wet, mut dry) = (frame(0.0, 0.8, 2.0), frame(1.0, 0.0, 0.0));
        // A dry column may lie a threshold under its base, on ground that is moving, with any flow.
        dry.columns.base.fill(1.2);
        dry.columns.top.fill(1.1995);
        dry.columns.flow.fill([-7.0, 0.0]);
        dry.columns.pressure.fill(0.0);
        for step in 1..10 {
            let share = f64::from(step) / 10.0;
            for (state, depth) in [
                (between(&wet, &dry, share, FPS).unwrap(), 0.8 * (1.0 - share)),
                (between(&dry, &wet, 1.0 - share, FPS).unwrap(), 0.8 * (1.0 - share)),
            ] {
                close(state.columns.base[4], 1.0 + 0.2 * share);
                close(state.columns.top[4] - state.columns.base[4], depth);
                close(state.columns.flow[4][0], 2.0);
            }
        }
        // Dry in both: dry between them.
        let still = between(&dry, &dry, 0.5, FPS).unwrap();
        assert_eq!(still.columns.top[4], still.columns.base[4]);
    }

    #[test]
    fn particles_fly_on_by_their_velocity_whoever_is_there_next() {
        let mut now = frame(0.0, 1.0, 0.0);
        now.particles = spray(4);
        for others in [0, 3, 4, 9] {
            let mut next = frame(1.0, 1.0, 0.0);
            // All of them older than a frame, and without numbers: nobody is born or known to end.
            next.particles = Particles { id: None, ..spray(others) };
            next.particles.age.iter_mut().for_each(|age| *age += 1.0);
            next.particles.position.iter_mut().for_each(|position| position[0] += 100.0);
            let moved = between(&now, &next, 0.75, FPS).unwrap().particles;
            assert_eq!(moved.position.len(), 4);
            for index in 0..4 {
                let seconds = 0.75 / FPS;
                close(moved.position[index][0], index as f64 + 3.0 * seconds);
                close(moved.position[index][1], 2.0 + index as f64 * seconds);
                close(moved.position[index][2], -1.0 - 12.0 * seconds);
                close(moved.age[index], 0.5 * index as f64 + seconds);
            }
            assert_eq!((&moved.mass, &moved.id), (&now.particles.mass, &now.particles.id));
            assert_eq!(moved.velocity, now.particles.velocity);
        }
    }

    #[test]
    fn other_grids_and_senseless_numbers_are_refused() {
        let now = frame(0.0, 1.0, 0.0);
        let refused = |change: &dyn Fn(&mut Columns), expected: &str| {
            let mut next = now.clone();
            change(&mut next.columns);
            let error = between(&now, &next, 0.5, FPS).unwrap_err().to_string();
            assert!(error.contains(expected), "{error}");
        };
        refused(&|columns| (columns.nx, columns.nz) = (1, 9), "columns 3 3 and 1 9");
        refused(&|columns| columns.width[1] = 0.26, "width 0.5 0.25 and 0.5 0.26");
        refused(&|columns| columns.origin[0] = 5.25, "origin 5 -2 and 5.25 -2");
        assert!(matches!(between(&now, &now, 1.5, FPS), Err(StateError::Share(share)) if share == 1.5));
        assert!(matches!(between(&now, &now, f64::NAN, FPS), Err(StateError::Share(_))));
        assert!(matches!(between(&now, &now, 0.5, 0.0), Err(StateError::Fps(_))));
    }
}
