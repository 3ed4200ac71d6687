//! Spray between two frames: flown on by its velocity, with those that break free or end on the way.
//!
//! Where the water is in between is not here.

use std::collections::HashSet;

use super::{Particles, StateError};
use crate::math::scramble;

/// A salt for when particles end, apart from all else that is drawn by their numbers.
const END: u64 = 0x656e_6400;

/// Particles a share of a frame later, by their velocities alone.
///
/// # Errors
/// [`StateError::Fps`].
pub fn carried_on(particles: &Particles, share: f64, fps: f64) -> Result<Particles, StateError> {
    let seconds = seconds(share, fps)?;
    let Particles { position, velocity, mass, age, id } = particles;
    Ok(Particles {
        position: position.iter().zip(velocity).map(|(place, velocity)| moved(place, velocity, seconds)).collect(),
        velocity: velocity.clone(),
        mass: mass.clone(),
        age: age.iter().map(|age| age + seconds).collect(),
        id: id.clone(),
    })
}

/// Particles a share (0..1) of a frame after `now`, on the way to `next`; at 0 those of `now` to the bit.
///
/// Those of `now` fly on; first they stand, in their order. *Births*: those of `next` that broke free after `now` (younger than a frame, and,
/// where both have an `id`, new) are there once they are born, flown back from where they are found. *Deaths*: where both have an
/// `id` and one of `now` is missing in `next`, it ends at a time that is drawn from its `id`, as likely at one as at another, so that no two
/// end together and half of the time is lost in the mean. Without `id` who ends is not known, and everybody flies on.
///
/// # Errors
/// [`StateError::Fps`].
pub(super) fn between(now: &Particles, next: &Particles, share: f64, fps: f64) -> Result<Particles, StateError> {
    let mut all = carried_on(now, share, fps)?;
    let frame = 1.0 / fps;
    let known: Option<(HashSet<u64>, HashSet<u64>)> =
        now.id.as_ref().zip(next.id.as_ref()).map(|(now, next)| (set(now), set(next)));
    if let Some((_, later)) = &known {
        let ids = all.id.iter().flatten();
        let stays: Vec<bool> = ids.map(|id| later.contains(id) || end(*id) > share).collect();
        keep(&mut all, &stays);
    }
    let back = seconds(share, fps)? - frame;
    for index in 0..next.age.len() {
        // Ages are single precision in most files: one that is a frame old, but for its rounding, is in `now` already.
        let young = next.age[index] * (1.0 + f64::from(f32::EPSILON)) < frame;
        let age = next.age[index] + back;
        let fresh = match (&known, &next.id) {
            (Some((before, _)), Some(id)) => !before.contains(&id[index]),
            _ => true,
        };
        if !(young && fresh && age >= 0.0) {
            continue;
        }
        all.position.push(moved(&next.position[index], &next.velocity[index], back));
        all.velocity.push(next.velocity[index]);
        all.mass.push(next.mass[index]);
        all.age.push(age);
        if let (Some(all), Some(id)) = (&mut all.id, &next.id) {
            all.push(id[index]);
        }
    }
    // Numbers of some are numbers of none.
    if all.id.as_ref().is_some_and(|id| id.len() != all.age.len()) {
        all.id = None;
    }
    Ok(all)
}

/// When, as a share of the frame, a particle ends that the next frame does not have.
fn end(id: u64) -> f64 {
    ((scramble(scramble(id) ^ END) >> 11) as f64 + 0.5) / (1u64 << 53) as f64
}

fn set(ids: &[u64]) -> HashSet<u64> {
    ids.iter().copied().collect()
}

fn seconds(share: f64, fps: f64) -> Result<f64, StateError> {
    if fps > 0.0 && fps.is_finite() { Ok(share / fps) } else { Err(StateError::Fps(fps)) }
}

fn moved(position: &[f64; 3], velocity: &[f64; 3], seconds: f64) -> [f64; 3] {
    std::array::from_fn(|axis| position[axis] + velocity[axis] * seconds)
}

fn keep(particles: &mut Particles, stays: &[bool]) {
    fn kept<T>(values: &mut Vec<T>, stays: &[bool]) {
        let mut index = 0..stays.len();
        values.retain(|_| index.next().is_some_and(|index| stays[index]));
    }
    // Named one by one, so that a new field cannot be forgotten here.
    let Particles { position, velocity, mass, age, id } = particles;
    kept(position, stays);
    kept(velocity, stays);
    kept(mass, stays);
    kept(age, stays);
    if let Some(id) = id {
        kept(id, stays);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FPS: f64 = 25.0;

    fn particles(age: &[f64], id: Option<&[u64]>) -> Particles {
        let count = age.len();
        Particles {
            position: (0..count).map(|index| [index as f64, 2.0, -1.0]).collect(),
            velocity: vec![[50.0, 0.0, -25.0]; count],
            mass: vec![0.1; count],
            age: age.to_vec(),
            id: id.map(<[u64]>::to_vec),
        }
    }

    /// How many of some moments, in the middle of equal parts of a frame, have so many particles.
    fn share_with(now: &Particles, next: &Particles, count: usize) -> f64 {
        let moments = 64;
        let with = (0..moments).filter(|moment| {
            let share = (f64::from(*moment) + 0.5) / f64::from(moments);
            between(now, next, share, FPS).unwrap().age.len() == count
        });
        with.count() as f64 / f64::from(moments)
    }

    #[test]
    fn who_breaks_free_half_way_is_there_for_half_of_the_time_and_where_it_came_from() {
        for id in [None, Some(&[7][..])] {
            let (now, next) = (particles(&[], id.map(|_| &[][..])), particles(&[0.02], id));
            assert_eq!(share_with(&now, &next, 1), 0.5);
            let late = between(&now, &next, 0.75, FPS).unwrap();
            assert!((late.age[0] - 0.01).abs() < 1e-12 && (late.position[0][0] + 0.5).abs() < 1e-12);
            assert_eq!(late.id.as_deref(), id);
        }
        // Who is a frame old or more was there before, and is not there twice.
        let old = particles(&[f64::from(0.04_f32), 1.0], None);
        assert_eq!(between(&particles(&[], None), &old, 0.9, FPS).unwrap(), particles(&[], None));
        let (now, next) = (particles(&[0.0], Some(&[7])), particles(&[0.039], Some(&[7])));
        assert_eq!(share_with(&now, &next, 1), 1.0);
    }

    #[test]
    fn who_is_missing_in_the_next_frame_ends_on_the_way() {
        let ids: Vec<u64> = (0..1000).collect();
        let (now, next) = (particles(&[1.0; 1000], Some(&ids)), particles(&[1.04], Some(&[500])));
        let mut last = 1000;
        for step in 0..=10 {
            let share = f64::from(step) / 10.0;
            let all = between(&now, &next, share, FPS).unwrap();
            let left = all.age.len();
            assert!(left <= last && (left as f64 - (1.0 + 999.0 * (1.0 - share))).abs() < 50.0, "{share}: {left}");
            assert!(all.id.as_ref().unwrap().contains(&500) && all.position.len() == left && all.mass.len() == left);
            last = left;
        }
        assert_eq!(last, 1);
        // Without numbers nobody is known to end.
        let nameless = Particles { id: None, ..now };
        assert_eq!(between(&nameless, &next, 0.9, FPS).unwrap().age.len(), 1000);
    }

    #[test]
    fn at_the_frame_s_own_time_there_are_its_own_particles_to_the_bit() {
        let (now, next) = (particles(&[1.0, 0.0], Some(&[1, 2])), particles(&[0.04, 0.01], Some(&[3, 4])));
        assert_eq!(between(&now, &next, 0.0, FPS).unwrap(), now);
        assert!(matches!(between(&now, &next, 0.5, 0.0), Err(StateError::Fps(_))));
    }
}
