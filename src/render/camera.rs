//! The eye: pose, thin lens, rays into the scene, projection of points, and the matrices that a compositor reads.
//!
//! Double precision in the files' frame; a ray becomes single precision only around the scene origin. How the eye moves
//! over frames lives in `path`, where it stands when nobody says so in `framing`.

use glam::{DVec2, DVec3, Vec3};

use super::RenderError;

/// Height of the film back (mm), to which focal length and f-number refer (docs/formats.md, section 3).
pub const FILM_BACK_MM: f64 = 24.0;

/// Where the eye is and what it looks at, at one moment.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Pose {
    /// Eye (files' frame, m).
    pub eye: DVec3,
    /// Unit vector to the picture's right.
    pub right: DVec3,
    /// Unit vector to the picture's top.
    pub up: DVec3,
    /// Unit direction of view.
    pub forward: DVec3,
    /// Vertical field of view (degrees).
    pub fov: f64,
    /// Distance in focus along the view (m).
    pub focus: f64,
}

impl Pose {
    /// A pose at `eye` that looks at `look_at` with `up` upward in the picture.
    ///
    /// `focus` is the distance in focus (m), by default the distance to `look_at`.
    ///
    /// *Errors*: [`RenderError::EyeAtTarget`], [`RenderError::UpAlongView`], [`RenderError::CameraValue`].
    pub fn looking(eye: DVec3, look_at: DVec3, up: DVec3, fov: f64, focus: Option<f64>) -> Result<Self, RenderError> {
        for (key, vector) in [("eye", eye), ("look_at", look_at), ("up", up)] {
            if let Some(value) = vector.to_array().into_iter().find(|value| !value.is_finite()) {
                return Err(RenderError::CameraValue { key, value, expected: "finite numbers" });
            }
        }
        if !(fov > 0.0 && fov < 180.0) {
            return Err(RenderError::CameraValue { key: "fov", value: fov, expected: "between 0 and 180 degrees" });
        }
        let view = look_at - eye;
        let forward = view.try_normalize().ok_or(RenderError::EyeAtTarget { eye: eye.to_array() })?;
        // Below about a micro-radian between up and view the rounding of the two decides how the picture turns.
        let across = forward.cross(up.normalize_or_zero());
        if across.length() < 1e-6 {
            return Err(RenderError::UpAlongView { up: up.to_array(), forward: forward.to_array() });
        }
        let right = across.normalize();
        let focus = focus.unwrap_or(view.length());
        if !(focus > 0.0 && focus.is_finite()) {
            return Err(RenderError::CameraValue { key: "focus", value: focus, expected: "a positive distance" });
        }
        Ok(Self { eye, right, up: right.cross(forward), forward, fov, focus })
    }
}

/// A pose with a lens and a film of `width` by `height` pixels.
#[derive(Clone, Copy, Debug, serde::Serialize, serde::Deserialize)]
pub struct Camera {
    /// Where it is.
    pub pose: Pose,
    /// Pixels across and down, of the full frame.
    pub size: (u32, u32),
    /// f-number; 0 is a pinhole.
    pub f_number: f64,
    /// A pixel's width by its height.
    pub pixel_aspect: f64,
    /// Tangents of half the field of view: horizontal, vertical.
    tangent: DVec2,
    /// How far the film is shifted to the right, in tangents.
    shift: f64,
    /// Radius of the lens (m).
    lens_radius: f64,
}

impl Camera {
    /// A camera whose full frame has `size` pixels (square ones).
    pub fn new(pose: Pose, size: (u32, u32), f_number: f64) -> Self {
        let vertical = (pose.fov.to_radians() / 2.0).tan();
        let tangent = DVec2::new(vertical * f64::from(size.0) / f64::from(size.1), vertical);
        let camera = Self { pose, size, f_number, pixel_aspect: 1.0, tangent, shift: 0.0, lens_radius: 0.0 };
        let lens_radius = if f_number > 0.0 { camera.focal_length() * 1e-3 / (2.0 * f_number) } else { 0.0 };
        Self { lens_radius, ..camera }
    }

    /// The same with pixels that are `aspect` times as wide as they are high.
    pub fn with_pixel_aspect(mut self, aspect: f64) -> Self {
        self.pixel_aspect = aspect;
        self.tangent.x = self.tangent.y * aspect * f64::from(self.size.0) / f64::from(self.size.1);
        self
    }

    /// The same camera so many metres to its right: one eye of a pair. It looks the same way, and its film is shifted so that
    /// what lies in the plane of focus stays where it is in the picture; there both eyes' pictures meet.
    pub fn aside(mut self, metres: f64) -> Self {
        self.pose.eye += metres * self.pose.right;
        self.shift = -metres / self.pose.focus;
        self
    }

    /// Focal length (mm) for a film back of [`FILM_BACK_MM`].
    pub fn focal_length(&self) -> f64 {
        FILM_BACK_MM / (2.0 * self.tangent.y)
    }

    /// Angle of a pixel's shorter side (radians, in the middle of the picture): the growth of its footprint per metre.
    pub fn pixel_angle(&self) -> f64 {
        2.0 * self.tangent.y / f64::from(self.size.1) * self.pixel_aspect.min(1.0)
    }

    /// Ray through the raster point `raster` (pixels, y down, (0,0) the upper left corner of the full frame).
    ///
    /// `lens` is a point of the unit square that picks a point of the lens; the middle is its centre.
    /// Returns origin relative to `scene_origin` and unit direction.
    pub fn ray(&self, raster: DVec2, lens: DVec2, scene_origin: DVec3) -> (Vec3, Vec3) {
        let film = self.film_direction(raster);
        let pose = &self.pose;
        let mut offset = DVec3::ZERO;
        let mut direction = film.x * pose.right + film.y * pose.up + pose.forward;
        if self.lens_radius > 0.0 {
            let disc = self.lens_radius * concentric_disc(lens);
            offset = disc.x * pose.right + disc.y * pose.up;
            direction = direction * pose.focus - offset;
        }
        ((pose.eye - scene_origin + offset).as_vec3(), direction.normalize().as_vec3())
    }

    /// Direction (files' frame, not normalised, planar depth 1) through a raster point.
    pub fn direction(&self, raster: DVec2) -> DVec3 {
        let film = self.film_direction(raster);
        film.x * self.pose.right + film.y * self.pose.up + self.pose.forward
    }

    fn film_direction(&self, raster: DVec2) -> DVec2 {
        DVec2::new(
            (2.0 * raster.x / f64::from(self.size.0) - 1.0) * self.tangent.x + self.shift,
            (1.0 - 2.0 * raster.y / f64::from(self.size.1)) * self.tangent.y,
        )
    }

    /// Planar depth (m along the view) of a point in the files' frame.
    pub fn depth(&self, point: DVec3) -> f64 {
        (point - self.pose.eye).dot(self.pose.forward)
    }

    /// Raster point (pixels, y down) of a point in the files' frame, `None` at or behind the eye.
    pub fn project(&self, point: DVec3) -> Option<DVec2> {
        self.project_direction(point - self.pose.eye)
    }

    /// Raster point of a direction, that is of a point at infinity; `None` across or behind the view.
    pub fn project_direction(&self, direction: DVec3) -> Option<DVec2> {
        let depth = direction.dot(self.pose.forward);
        if depth <= 0.0 {
            return None;
        }
        let x = (direction.dot(self.pose.right) / depth - self.shift) / self.tangent.x;
        let y = direction.dot(self.pose.up) / (depth * self.tangent.y);
        Some(DVec2::new((1.0 + x) / 2.0 * f64::from(self.size.0), (1.0 - y) / 2.0 * f64::from(self.size.1)))
    }

    /// World → camera: left-handed, +z forward, +x right, +y up; row vectors (p M).
    ///
    /// *Source*: OpenEXR, Standard Attributes, `worldToCamera`.
    pub fn world_to_camera(&self) -> [[f64; 4]; 4] {
        let Pose { eye, right, up, forward, .. } = self.pose;
        [
            [right.x, up.x, forward.x, 0.0],
            [right.y, up.y, forward.y, 0.0],
            [right.z, up.z, forward.z, 0.0],
            [-eye.dot(right), -eye.dot(up), -eye.dot(forward), 1.0],
        ]
    }

    /// World → 0..1 over the display window, y down; row vectors. After the division z is 0 one metre before the eye
    /// and 1 at infinity, so that the matrix can be inverted.
    ///
    /// *Source*: OpenEXR, Standard Attributes, `worldToNDC`.
    pub fn world_to_ndc(&self) -> [[f64; 4]; 4] {
        // Camera → NDC: x' = (x - shift z) / (2 tan_x) + z / 2, y' = -y / (2 tan_y) + z / 2, z' = z - 1, w' = z.
        self.world_to_camera().map(|[x, y, z, w]| {
            let across = (x - self.shift * z) / (2.0 * self.tangent.x);
            [across + z / 2.0, -y / (2.0 * self.tangent.y) + z / 2.0, z - w, z]
        })
    }

    /// Camera (x right, y up, z backward) → world; row vectors.
    pub fn camera_to_world(&self) -> [[f64; 4]; 4] {
        let Pose { eye, right, up, forward, .. } = self.pose;
        let row = |vector: DVec3, w: f64| [vector.x, vector.y, vector.z, w];
        [row(right, 0.0), row(up, 0.0), row(-forward, 0.0), row(eye, 1.0)]
    }
}

/// Unit square → unit disc, area and neighbourhood kept.
///
/// *Source*: P. Shirley, K. Chiu, A low distortion map between disk and square, 1997.
pub fn concentric_disc(square: DVec2) -> DVec2 {
    let point = 2.0 * square - DVec2::ONE;
    if point == DVec2::ZERO {
        return DVec2::ZERO;
    }
    let quarter = std::f64::consts::FRAC_PI_4;
    let (radius, angle) = if point.x.abs() > point.y.abs() {
        (point.x, quarter * point.y / point.x)
    } else {
        (point.y, 2.0 * quarter - quarter * point.x / point.y)
    };
    radius * DVec2::new(angle.cos(), angle.sin())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera(f_number: f64) -> Camera {
        let pose =
            Pose::looking(DVec3::new(500_003.0, 40.0, -7.0), DVec3::new(500_010.0, 36.0, -30.0), DVec3::Y, 47.0, None)
                .unwrap();
        Camera::new(pose, (640, 360), f_number)
    }

    fn transform(point: DVec3, matrix: [[f64; 4]; 4]) -> [f64; 4] {
        let row = [point.x, point.y, point.z, 1.0];
        std::array::from_fn(|column| (0..4).map(|index| row[index] * matrix[index][column]).sum())
    }

    #[test]
    fn display_window_corners_map_to_zero_and_one() {
        let camera = camera(0.0);
        for (raster, expected) in [
            ((0.0, 0.0), (0.0, 0.0)),
            ((640.0, 0.0), (1.0, 0.0)),
            ((0.0, 360.0), (0.0, 1.0)),
            ((640.0, 360.0), (1.0, 1.0)),
        ] {
            let point = camera.pose.eye + 12.5 * camera.direction(DVec2::new(raster.0, raster.1));
            let [x, y, z, w] = transform(point, camera.world_to_ndc());
            assert!((x / w - expected.0).abs() < 1e-8 && (y / w - expected.1).abs() < 1e-8, "{raster:?}: {x} {y} {w}");
            assert!((z / w - (1.0 - 1.0 / 12.5)).abs() < 1e-8);
        }
    }

    #[test]
    fn camera_space_is_left_handed_with_z_forward() {
        let camera = camera(0.0);
        let pose = camera.pose;
        let point = pose.eye + 2.0 * pose.right + 3.0 * pose.up + 5.0 * pose.forward;
        let [x, y, z, w] = transform(point, camera.world_to_camera());
        for (value, expected) in [(x, 2.0), (y, 3.0), (z, 5.0), (w, 1.0)] {
            assert!((value - expected).abs() < 1e-8);
        }
        // Back again through the right-handed camera frame, whose z points backward.
        let [x, y, z, _] = transform(DVec3::new(2.0, 3.0, -5.0), camera.camera_to_world());
        assert!((DVec3::new(x, y, z) - point).length() < 1e-8);
        assert!(pose.right.cross(pose.up).dot(pose.forward) < 0.0);
    }

    #[test]
    fn wide_pixels_see_more_to_the_sides_and_as_much_above() {
        let (square, wide) = (camera(0.0), camera(0.0).with_pixel_aspect(2.0));
        // The tangent of half the horizontal field is twice as large: the border of the one is half way in the other.
        for y in [0.0, 77.0, 360.0] {
            let (narrow, half) = (square.direction(DVec2::new(640.0, y)), wide.direction(DVec2::new(480.0, y)));
            assert!((narrow - half).length() < 1e-12);
        }
        assert_eq!(square.focal_length(), wide.focal_length());
        let raster = DVec2::new(123.25, 301.5);
        assert!((wide.project(wide.pose.eye + 3.0 * wide.direction(raster)).unwrap() - raster).length() < 1e-6);
        // The accuracy of hits goes by a pixel's shorter side.
        assert_eq!(wide.pixel_angle(), square.pixel_angle());
        assert_eq!(square.with_pixel_aspect(0.5).pixel_angle(), 0.5 * square.pixel_angle());
        let corner = wide.pose.eye + 12.5 * wide.direction(DVec2::new(640.0, 0.0));
        let [x, y, _, w] = transform(corner, wide.world_to_ndc());
        assert!((x / w - 1.0).abs() < 1e-8 && (y / w).abs() < 1e-8);
    }

    #[test]
    fn two_eyes_agree_in_the_plane_of_focus_and_nowhere_else() {
        let middle = camera(0.0);
        let [left, right] = [-0.0325, 0.0325].map(|aside| middle.aside(aside));
        assert!((right.pose.eye - left.pose.eye - 0.065 * middle.pose.right).length() < 1e-6);
        for raster in [DVec2::new(12.0, 30.0), DVec2::new(320.0, 180.0), DVec2::new(600.5, 333.0)] {
            let along = middle.direction(raster);
            let at = |share: f64| {
                let point = middle.pose.eye + share * middle.pose.focus * along;
                [left, right].map(|eye| eye.project(point).unwrap())
            };
            let [a, b] = at(1.0);
            assert!((a - raster).length() < 1e-6 && (b - raster).length() < 1e-6, "{a} {b}");
            // What is near lies further right for the left eye, what is far further left; heights agree.
            let ([near_left, near_right], [far_left, far_right]) = (at(0.5), at(2.0));
            assert!(near_left.x > near_right.x + 0.1 && far_left.x < far_right.x - 0.1);
            assert!((near_left.y - near_right.y).abs() < 1e-6);
        }
        for eye in [left, right] {
            let raster = DVec2::new(123.25, 301.5);
            assert!((eye.project(eye.pose.eye + 7.0 * eye.direction(raster)).unwrap() - raster).length() < 1e-6);
            let [x, y, _, w] =
                transform(eye.pose.eye + 12.5 * eye.direction(DVec2::new(640.0, 0.0)), eye.world_to_ndc());
            assert!((x / w - 1.0).abs() < 1e-8 && (y / w).abs() < 1e-8);
        }
    }

    #[test]
    fn projection_undoes_the_ray() {
        let camera = camera(0.0);
        let origin = DVec3::new(500_000.0, 0.0, 0.0);
        let raster = DVec2::new(123.25, 301.5);
        let (start, direction) = camera.ray(raster, DVec2::splat(0.5), origin);
        let point = origin + start.as_dvec3() + 20.0 * direction.as_dvec3();
        assert!((camera.project(point).unwrap() - raster).length() < 1e-3);
        assert_eq!(camera.project(camera.pose.eye - camera.pose.forward), None);
    }

    #[test]
    fn lens_rays_meet_in_the_plane_of_focus_and_start_on_the_lens() {
        let camera = camera(1.4);
        let radius = camera.focal_length() * 1e-3 / 2.8;
        let raster = DVec2::new(80.0, 200.0);
        let expected = camera.pose.eye + camera.pose.focus * camera.direction(raster);
        for lens in [(0.0, 0.3), (0.9, 0.9), (0.5, 0.02), (0.5, 0.5)] {
            let (start, direction) = camera.ray(raster, DVec2::new(lens.0, lens.1), camera.pose.eye);
            assert!(f64::from(start.length()) <= radius * (1.0 + 1e-6));
            let t = camera.pose.focus / direction.as_dvec3().dot(camera.pose.forward);
            let met = camera.pose.eye + start.as_dvec3() + t * direction.as_dvec3();
            assert!((met - expected).length() < 1e-4, "{lens:?}");
        }
    }

    #[test]
    fn concentric_map_keeps_area() {
        // The share of a regular grid that lands within radius r must be r squared.
        let count = 400;
        for radius in [0.3, 0.7] {
            let inside = (0..count * count)
                .filter(|index| {
                    let square = DVec2::new(f64::from(index % count) + 0.5, f64::from(index / count) + 0.5);
                    concentric_disc(square / f64::from(count)).length() < radius
                })
                .count();
            let share = inside as f64 / f64::from(count * count);
            assert!((share - radius * radius).abs() < 2e-3, "{share}");
        }
    }

    #[test]
    fn impossible_poses_are_refused() {
        let eye = DVec3::ONE;
        assert!(matches!(Pose::looking(eye, eye, DVec3::Y, 40.0, None), Err(RenderError::EyeAtTarget { .. })));
        let below = DVec3::new(1.0, -5.0, 1.0);
        assert!(matches!(Pose::looking(eye, below, DVec3::Y, 40.0, None), Err(RenderError::UpAlongView { .. })));
        let nan = DVec3::new(f64::NAN, 0.0, 0.0);
        assert!(matches!(Pose::looking(nan, below, DVec3::Y, 40.0, None), Err(RenderError::CameraValue { .. })));
    }
}
