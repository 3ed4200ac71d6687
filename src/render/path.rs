//! The camera over frames: a fixed pose, or keys joined by a path that is smooth in position and direction.
//!
//! Eye: cubic Hermite in the frame number. Orientation: the cumulative quaternion Bézier curve of M.-J. Kim, M.-S. Kim,
//! S. Shin, A general construction scheme for unit quaternion curves with simple high order derivatives, 1995.

use glam::{DQuat, DVec3};

use super::{Pose, RenderError};
use crate::scene;

/// Poses by frame number, continuous with their first derivative everywhere; exact at the keys, at rest outside them.
#[derive(Clone, Debug)]
pub struct CameraPath {
    keys: Vec<Key>,
    /// Upward in the picture: the horizon stays level between keys.
    up: DVec3,
}

#[derive(Clone, Copy, Debug)]
struct Key {
    frame: f64,
    pose: Pose,
    rotation: DQuat,
    /// Change per frame of the eye, of the orientation (in the camera's own axes), of the lens.
    velocity: DVec3,
    spin: DVec3,
    zoom: [f64; 2],
}

impl CameraPath {
    /// A camera that never moves.
    pub fn fixed(pose: Pose, up: DVec3) -> Self {
        Self { keys: vec![Key::new(0.0, pose)], up }
    }

    /// The path that `camera` describes: its keys, or else its eye and look-at, completed where missing from `framed`
    /// (asked for eye and look-at, files' frame, only when needed).
    ///
    /// *Errors*: whatever [`Pose::looking`] refuses, [`RenderError::TwoKeys`], and the errors of `framed`.
    pub fn from_scene(
        camera: &scene::Camera,
        framed: impl FnOnce() -> Result<[DVec3; 2], RenderError>,
    ) -> Result<Self, RenderError> {
        let up = DVec3::from(camera.up);
        if !camera.key.is_empty() {
            let mut keys = Vec::with_capacity(camera.key.len());
            for key in &camera.key {
                if !key.frame.is_finite() {
                    let expected = "a finite frame number";
                    return Err(RenderError::CameraValue { key: "key.frame", value: key.frame, expected });
                }
                let fov = key.fov.unwrap_or(camera.fov);
                keys.push((key.frame, Pose::looking(key.eye.into(), key.look_at.into(), up, fov, camera.focus)?));
            }
            return Self::keyed(keys, up);
        }
        let (eye, look_at) = match (camera.eye, camera.look_at) {
            (Some(eye), Some(look_at)) => (eye.into(), look_at.into()),
            (eye, look_at) => {
                let [framed_eye, framed_look_at] = framed()?;
                (eye.map_or(framed_eye, DVec3::from), look_at.map_or(framed_look_at, DVec3::from))
            }
        };
        Ok(Self::fixed(Pose::looking(eye, look_at, up, camera.fov, camera.focus)?, up))
    }

    /// A path through `keys` (frame number, pose), in any order.
    ///
    /// *Errors*: [`RenderError::TwoKeys`].
    pub fn keyed(mut keys: Vec<(f64, Pose)>, up: DVec3) -> Result<Self, RenderError> {
        keys.sort_by(|left, right| left.0.total_cmp(&right.0));
        if let Some(pair) = keys.windows(2).find(|pair| pair[0].0 == pair[1].0) {
            return Err(RenderError::TwoKeys { frame: pair[0].0 });
        }
        let mut keys: Vec<Key> = keys.into_iter().map(|(frame, pose)| Key::new(frame, pose)).collect();
        for index in 1..keys.len() {
            // q and -q turn alike: take the one that is nearer, so that the camera turns the short way.
            if keys[index].rotation.dot(keys[index - 1].rotation) < 0.0 {
                keys[index].rotation = -keys[index].rotation;
            }
        }
        for index in 1..keys.len().saturating_sub(1) {
            let [before, here, after] = [keys[index - 1], keys[index], keys[index + 1]];
            let (first, second) = (here.frame - before.frame, after.frame - here.frame);
            // Slope of the parabola through three keys: the nearer key weighs more.
            let (first_weight, second_weight) = (second / (first + second), first / (first + second));
            let [lens_before, lens, lens_after] = [before.pose, here.pose, after.pose].map(lens_coordinates);
            let key = &mut keys[index];
            // A camera that rests between two equal keys must not swing back before it leaves: rest stays rest.
            if before.pose.eye != here.pose.eye && here.pose.eye != after.pose.eye {
                key.velocity = (here.pose.eye - before.pose.eye) * (first_weight / first)
                    + (after.pose.eye - here.pose.eye) * (second_weight / second);
            }
            let (turn_in, turn_out) = (turn(before.rotation, here.rotation), turn(here.rotation, after.rotation));
            if turn_in != DVec3::ZERO && turn_out != DVec3::ZERO {
                key.spin = turn_in * (first_weight / first) + turn_out * (second_weight / second);
            }
            for axis in 0..2 {
                let (slope_in, slope_out) =
                    ((lens[axis] - lens_before[axis]) / first, (lens_after[axis] - lens[axis]) / second);
                // A zoom never overshoots its keys.
                if slope_in * slope_out > 0.0 {
                    key.zoom[axis] = slope_in * first_weight + slope_out * second_weight;
                }
            }
        }
        // First and last key keep a velocity of zero: outside them the camera stands still, and it must not jerk there.
        Ok(Self { keys, up })
    }

    /// The pose at a frame number, which need not be whole.
    pub fn pose(&self, frame: f64) -> Pose {
        let after = self.keys.partition_point(|key| key.frame <= frame);
        if after == 0 {
            return self.keys[0].pose;
        }
        let start = &self.keys[after - 1];
        if after == self.keys.len() || frame == start.frame {
            return start.pose;
        }
        let end = &self.keys[after];
        let span = end.frame - start.frame;
        let s = (frame - start.frame) / span;
        let hermite = Hermite::at(s);
        let eye = start.pose.eye * hermite.start
            + end.pose.eye * hermite.end
            + (start.velocity * hermite.leave + end.velocity * hermite.arrive) * span;

        let (first, last) = (start.spin * (span / 3.0), end.spin * (span / 3.0));
        let inner_start = start.rotation * DQuat::from_scaled_axis(first);
        let inner_end = end.rotation * DQuat::from_scaled_axis(-last);
        let middle = turn(inner_start, inner_end);
        let rotation = start.rotation
            * DQuat::from_scaled_axis(first * (1.0 - (1.0 - s).powi(3)))
            * DQuat::from_scaled_axis(middle * (s * s * (3.0 - 2.0 * s)))
            * DQuat::from_scaled_axis(last * s.powi(3));
        let (right, up, forward) = self.level(rotation);

        let (lens_start, lens_end) = (lens_coordinates(start.pose), lens_coordinates(end.pose));
        let lens: [f64; 2] = std::array::from_fn(|axis| {
            lens_start[axis] * hermite.start
                + lens_end[axis] * hermite.end
                + (start.zoom[axis] * hermite.leave + end.zoom[axis] * hermite.arrive) * span
        });
        Pose { eye, right, up, forward, fov: (2.0 * lens[0].exp().atan()).to_degrees(), focus: lens[1].exp() }
    }

    /// Axes of a rotation with the horizon level, unless the view is within about ten degrees of straight up or down,
    /// where level turns ever faster: there it eases over into the rotation's own.
    fn level(&self, rotation: DQuat) -> (DVec3, DVec3, DVec3) {
        let forward = rotation * DVec3::NEG_Z;
        let own_right = rotation * DVec3::X;
        let across = forward.cross(self.up.normalize_or_zero());
        let s = ((across.length() - 0.02) / 0.15).clamp(0.0, 1.0);
        let weight = s * s * (3.0 - 2.0 * s);
        let mut mixed = across.normalize_or_zero() * weight + own_right * (1.0 - weight);
        if weight > 0.0 && across.dot(own_right) < 0.0 {
            // Only when keys stand on their heads: level would be upside down.
            mixed = own_right;
        }
        let right = (mixed - forward * mixed.dot(forward)).normalize();
        (right, right.cross(forward), forward)
    }
}

impl Key {
    fn new(frame: f64, pose: Pose) -> Self {
        let axes = glam::DMat3::from_cols(pose.right, pose.up, -pose.forward);
        let rotation = DQuat::from_mat3(&axes).normalize();
        Self { frame, pose, rotation, velocity: DVec3::ZERO, spin: DVec3::ZERO, zoom: [0.0; 2] }
    }
}

/// Logarithms of the lens' tangent and of its focus: equal steps look equal, and no value leaves its range.
fn lens_coordinates(pose: Pose) -> [f64; 2] {
    [(pose.fov.to_radians() / 2.0).tan().ln(), pose.focus.ln()]
}

/// Turn from one orientation to another, as axis times angle in the camera's own axes.
fn turn(from: DQuat, to: DQuat) -> DVec3 {
    let step = from.conjugate() * to;
    let step = if step.w < 0.0 { -step } else { step };
    if step.w >= 1.0 { DVec3::ZERO } else { step.to_scaled_axis() }
}

struct Hermite {
    start: f64,
    end: f64,
    leave: f64,
    arrive: f64,
}

impl Hermite {
    fn at(s: f64) -> Self {
        let end = s * s * (3.0 - 2.0 * s);
        Self { start: 1.0 - end, end, leave: s * (1.0 - s) * (1.0 - s), arrive: s * s * (s - 1.0) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pose(eye: [f64; 3], look_at: [f64; 3], fov: f64) -> Pose {
        Pose::looking(eye.into(), look_at.into(), DVec3::Y, fov, None).unwrap()
    }

    fn keys() -> Vec<(f64, Pose)> {
        vec![
            (1.0, pose([0.0, 2.0, 0.0], [5.0, 1.0, 0.0], 40.0)),
            (10.0, pose([8.0, 3.0, 1.0], [9.0, 1.0, 9.0], 30.0)),
            (14.0, pose([9.0, 1.0, 6.0], [-3.0, 1.5, 7.0], 30.0)),
            (40.0, pose([20.0, 9.0, -4.0], [0.0, 0.0, 0.0], 70.0)),
        ]
    }

    fn flatten(pose: Pose) -> [f64; 14] {
        let Pose { eye, right, up, forward, fov, focus } = pose;
        let mut values = [fov, focus, 0., 0., 0., 0., 0., 0., 0., 0., 0., 0., 0., 0.];
        for (place, vector) in [eye, right, up, forward].into_iter().enumerate() {
            values[2 + 3 * place..5 + 3 * place].copy_from_slice(&vector.to_array());
        }
        values
    }

    #[test]
    fn path_passes_exactly_through_its_keys_and_rests_outside() {
        let path = CameraPath::keyed(keys(), DVec3::Y).unwrap();
        for (frame, pose) in keys() {
            assert_eq!(path.pose(frame), pose);
        }
        assert_eq!(path.pose(-100.0), keys()[0].1);
        assert_eq!(path.pose(1e9), keys()[3].1);
    }

    #[test]
    fn position_and_direction_have_no_kink_anywhere() {
        let path = CameraPath::keyed(keys(), DVec3::Y).unwrap();
        // Velocity just before and just after each key, by one-sided differences; a kink would show as a jump that
        // does not shrink with the step.
        for (frame, _) in keys() {
            let step = 1e-4;
            let [before, here, after] = [frame - step, frame, frame + step].map(|frame| flatten(path.pose(frame)));
            for index in 0..before.len() {
                let (arrive, leave) = ((here[index] - before[index]) / step, (after[index] - here[index]) / step);
                assert!((arrive - leave).abs() < 2e-3, "frame {frame} value {index}: {arrive} then {leave}");
            }
        }
        // It does move: the inner keys are passed at speed.
        let speed = (path.pose(10.001).eye - path.pose(10.0).eye).length() / 0.001;
        assert!(speed > 0.5, "{speed}");
    }

    #[test]
    fn axes_stay_orthonormal_and_the_horizon_level() {
        let path = CameraPath::keyed(keys(), DVec3::Y).unwrap();
        for index in 0..400 {
            let pose = path.pose(index as f64 * 0.1);
            assert!((pose.right.cross(pose.up) + pose.forward).length() < 1e-12);
            assert!(pose.right.y.abs() < 1e-12, "frame {}: rolled by {}", index as f64 * 0.1, pose.right.y);
        }
    }

    #[test]
    fn camera_that_rests_does_not_swing_back() {
        let still = pose([0.0, 2.0, 0.0], [5.0, 1.0, 0.0], 40.0);
        let keys = vec![(0.0, still), (10.0, still), (20.0, pose([9.0, 2.0, 0.0], [14.0, 1.0, 0.0], 40.0))];
        let path = CameraPath::keyed(keys, DVec3::Y).unwrap();
        for index in 0..=200 {
            assert!(path.pose(index as f64 * 0.1).eye.x >= 0.0);
        }
        assert_eq!(path.pose(5.0).eye, still.eye);
    }

    #[test]
    fn turning_half_around_on_the_spot_stays_finite() {
        let keys = vec![(0.0, pose([0.0; 3], [10.0, 0.0, 0.0], 40.0)), (8.0, pose([0.0; 3], [-10.0, 0.0, 0.0], 40.0))];
        let path = CameraPath::keyed(keys, DVec3::Y).unwrap();
        for index in 0..=80 {
            let pose = path.pose(index as f64 * 0.1);
            assert!(pose.forward.is_finite() && (pose.forward.length() - 1.0).abs() < 1e-9);
        }
    }

    #[test]
    fn scene_without_a_camera_asks_for_a_frame_and_keys_do_not() {
        let mut camera = scene::Camera::default();
        let path = CameraPath::from_scene(&camera, || Ok([DVec3::new(0.0, 4.0, 9.0), DVec3::ZERO])).unwrap();
        assert_eq!(path.pose(3.0).eye, DVec3::new(0.0, 4.0, 9.0));
        camera.key = vec![scene::CameraKey { frame: 2.0, eye: [1.0; 3], look_at: [0.0, 1.0, 0.0], fov: None }; 2];
        let refuse = || Err(RenderError::NothingToFrame);
        assert!(matches!(CameraPath::from_scene(&camera, refuse), Err(RenderError::TwoKeys { frame: 2.0 })));
        camera.key.pop();
        assert_eq!(CameraPath::from_scene(&camera, refuse).unwrap().pose(77.0).eye, DVec3::ONE);
    }
}
