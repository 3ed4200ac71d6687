//! Where the camera stands when the scene does not say: everything wet in the picture, seen from low in the south-east.

use glam::{DVec2, DVec3};

use super::{Pose, RenderError};

/// Share of the picture's half width and height that the water fills; the rest is air around it.
const FILL: f64 = 0.92;

/// Heights of the eye above the horizontal as seen from the water (degrees), lowest and most pleasant first.
const ELEVATIONS: [f64; 6] = [24.0, 30.0, 38.0, 50.0, 65.0, 85.0];

/// Sides that the eye may stand on (degrees from north, eastward). The default sun stands in the south-east: from about
/// there it lights what is seen, and from its flanks its glitter shows.
const SIDES: [f64; 6] = [155.0, 130.0, 180.0, 105.0, 205.0, 230.0];

/// Eye and point looked at (files' frame, m) from which all `points` are in a picture of `aspect` (width over height) and
/// vertical field of view `fov` (degrees).
///
/// `points` are the wet columns' tops, or if nothing is wet any points of the land. `ground` is the height of the
/// terrain at x, z, where there is any; the eye stands clear above it and sees most of the points.
///
/// *Errors*: [`RenderError::NothingToFrame`] if there is not one finite point, [`RenderError::CameraValue`] for an
/// impossible `fov`.
pub fn frame_points(
    points: &[DVec3],
    ground: &dyn Fn(f64, f64) -> Option<f64>,
    aspect: f64,
    fov: f64,
) -> Result<[DVec3; 2], RenderError> {
    let finite = || points.iter().copied().filter(|point| point.is_finite());
    let first = finite().next().ok_or(RenderError::NothingToFrame)?;
    let (low, high) = finite().fold((first, first), |(low, high), point| (low.min(point), high.max(point)));
    let centre = (low + high) / 2.0;
    let extent = (high - low).length();
    // A single point has no size of its own: it is looked at as if it were a metre wide.
    let size = if extent > 0.0 { extent } else { 1.0 };
    let half = fov.to_radians() / 2.0;
    let tangent = DVec2::new(half.tan() * aspect, half.tan()) * FILL;
    let clearance = 0.03 * size;

    // Of the lowest elevation from which most of the water shows, the side from which it fills most of the picture; if
    // there is none, whatever shows most.
    let mut fallback: Option<(f64, [DVec3; 2])> = None;
    for elevation in ELEVATIONS {
        let mut best: Option<(f64, [DVec3; 2])> = None;
        for side in SIDES {
            let towards_eye = direction(elevation, side);
            let pose = Pose::looking(centre + towards_eye, centre, DVec3::Y, fov, None)?;
            let mut eye = fit(finite(), &pose, tangent);
            if extent == 0.0 {
                eye -= size / (2.0 * tangent.min_element()) * pose.forward;
            }
            let placed = [eye, eye + pose.forward * (centre - eye).dot(pose.forward)];
            if ground(eye.x, eye.z).is_some_and(|height| eye.y < height + clearance) {
                continue;
            }
            let seen = visible_share(points, eye, ground);
            let filled = covered_area(points, &Pose { eye, ..pose }, tangent);
            if seen >= 0.8 && best.is_none_or(|(most, _)| filled > most) {
                best = Some((filled, placed));
            }
            if fallback.is_none_or(|(most, _)| seen > most) {
                fallback = Some((seen, placed));
            }
        }
        if let Some((_, placed)) = best {
            return Ok(placed);
        }
    }
    if let Some((_, placed)) = fallback {
        return Ok(placed);
    }
    // Only a deep narrow gorge gets here: stand straight above the ground's rim over the centre.
    let pose = Pose::looking(centre + direction(85.0, SIDES[0]), centre, DVec3::Y, fov, None)?;
    let eye = fit(finite(), &pose, tangent);
    let floor = ground(eye.x, eye.z).map_or(eye.y, |height| height + clearance);
    let back = ((floor - eye.y) / -pose.forward.y).max(0.0);
    let eye = eye - back * pose.forward;
    Ok([eye, eye + pose.forward * (centre - eye).dot(pose.forward)])
}

/// Unit direction at `elevation` above the horizontal, `azimuth` from north (-z) towards east (+x), in degrees.
fn direction(elevation: f64, azimuth: f64) -> DVec3 {
    let (sin_elevation, cos_elevation) = elevation.to_radians().sin_cos();
    let (sin_azimuth, cos_azimuth) = azimuth.to_radians().sin_cos();
    DVec3::new(sin_azimuth * cos_elevation, sin_elevation, -cos_azimuth * cos_elevation)
}

/// The nearest eye with the axes of `pose` that has all points within `tangent` of its axis, the points centred.
///
/// Each side of the frustum bounds the eye by the point that reaches farthest across it, so the answer is exact.
fn fit(points: impl Iterator<Item = DVec3>, pose: &Pose, tangent: DVec2) -> DVec3 {
    let anchor = pose.eye;
    let mut reach = [f64::NEG_INFINITY; 4];
    for point in points {
        let offset = point - anchor;
        let (x, y, depth) = (offset.dot(pose.right), offset.dot(pose.up), offset.dot(pose.forward));
        let across = [x - tangent.x * depth, -x - tangent.x * depth, y - tangent.y * depth, -y - tangent.y * depth];
        for (reach, across) in reach.iter_mut().zip(across) {
            *reach = reach.max(across);
        }
    }
    let depth = (-(reach[0] + reach[1]) / (2.0 * tangent.x)).min(-(reach[2] + reach[3]) / (2.0 * tangent.y));
    anchor + pose.right * ((reach[0] - reach[1]) / 2.0) + pose.up * ((reach[2] - reach[3]) / 2.0) + pose.forward * depth
}

/// Share of the picture inside the convex hull of a sample of `points`, seen from `pose`.
///
/// *Source*: A. Andrew, Another efficient algorithm for convex hulls in two dimensions, 1979.
fn covered_area(points: &[DVec3], pose: &Pose, tangent: DVec2) -> f64 {
    let step = (points.len() / 1024).max(1);
    let mut film: Vec<DVec2> = points
        .iter()
        .step_by(step)
        .map(|&point| point - pose.eye)
        .map(|offset| DVec2::new(offset.dot(pose.right), offset.dot(pose.up)) / (offset.dot(pose.forward) * tangent))
        .filter(|point| point.is_finite())
        .collect();
    film.sort_by(|left, right| left.x.total_cmp(&right.x).then(left.y.total_cmp(&right.y)));
    let chain = |points: &mut dyn Iterator<Item = DVec2>| {
        let mut hull: Vec<DVec2> = Vec::new();
        for point in points {
            while let [.., before, last] = hull[..] {
                if (last - before).perp_dot(point - last) > 0.0 {
                    break;
                }
                hull.pop();
            }
            hull.push(point);
        }
        // Twice the area between the chain and the origin.
        hull.windows(2).map(|pair| pair[0].perp_dot(pair[1])).sum::<f64>()
    };
    let twice = chain(&mut film.iter().copied()) + chain(&mut film.iter().rev().copied());
    // The picture is a square of side 2 in these coordinates.
    twice / 2.0 / 4.0
}

/// Share of a sample of `points` that no ground hides from `eye`.
fn visible_share(points: &[DVec3], eye: DVec3, ground: &dyn Fn(f64, f64) -> Option<f64>) -> f64 {
    let step = (points.len() / 64).max(1);
    let (mut seen, mut total) = (0.0, 0.0);
    for &point in points.iter().step_by(step).filter(|point| point.is_finite()) {
        total += 1.0;
        // The last eighth of the way is the point's own bank: waves and bed there do not hide a river.
        let hidden = (1..28).any(|index| {
            let on_way = point.lerp(eye, 1.0 - f64::from(index) / 32.0);
            ground(on_way.x, on_way.z).is_some_and(|height| height > on_way.y)
        });
        if !hidden {
            seen += 1.0;
        }
    }
    seen / total
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::Camera;

    fn grid(origin: DVec3, size: [f64; 2]) -> Vec<DVec3> {
        (0..=20)
            .flat_map(|z| (0..=20).map(move |x| (f64::from(x) / 20.0, f64::from(z) / 20.0)))
            .map(|(u, v)| origin + DVec3::new(u * size[0], (6.0 * u).sin() * 0.01 * size[0], v * size[1]))
            .collect()
    }

    fn check(points: &[DVec3], ground: &dyn Fn(f64, f64) -> Option<f64>, aspect: f64) {
        let [eye, look_at] = frame_points(points, ground, aspect, 40.0).unwrap();
        assert!(eye.is_finite() && look_at.is_finite());
        let pose = Pose::looking(eye, look_at, DVec3::Y, 40.0, None).unwrap();
        let camera = Camera::new(pose, ((1000.0 * aspect) as u32, 1000), 0.0);
        let mut extent = (f64::INFINITY, f64::NEG_INFINITY, f64::INFINITY, f64::NEG_INFINITY);
        for &point in points {
            let raster = camera.project(point).expect("in front of the eye");
            extent = (extent.0.min(raster.x), extent.1.max(raster.x), extent.2.min(raster.y), extent.3.max(raster.y));
        }
        let width = 1000.0 * aspect;
        assert!(extent.0 > 0.0 && extent.1 < width && extent.2 > 0.0 && extent.3 < 1000.0, "{extent:?}");
        // It fills the frame one way or the other.
        assert!((extent.1 - extent.0) > 0.85 * width || (extent.3 - extent.2) > 850.0, "{extent:?}");
        assert!(ground(eye.x, eye.z).is_none_or(|height| eye.y > height));
    }

    #[test]
    fn everything_wet_is_inside_at_any_size_and_shape() {
        let open = |_: f64, _: f64| None;
        for (origin, size) in [
            (DVec3::ZERO, [20.0, 5.0]),
            (DVec3::new(5.0e5, 310.0, 3.6e6), [30_000.0, 28_000.0]),
            (DVec3::ONE, [0.002, 0.004]),
            (DVec3::ZERO, [1.0, 400.0]),
        ] {
            check(&grid(origin, size), &open, 16.0 / 9.0);
            check(&grid(origin, size), &open, 0.5);
        }
    }

    #[test]
    fn eye_stands_above_a_hill_in_the_south() {
        // A wall of hills on every side but the north-west hides low views.
        let hill = |x: f64, z: f64| Some(if z > 12.0 || x > 25.0 { 60.0 } else { -1.0 });
        check(&grid(DVec3::ZERO, [20.0, 10.0]), &hill, 1.5);
    }

    #[test]
    fn a_gorge_is_seen_from_above_its_rim() {
        let gorge = |x: f64, z: f64| {
            let inside = (0.0..=4.0).contains(&x) && (0.0..=4.0).contains(&z);
            Some(if inside { 0.0 } else { 500.0 })
        };
        let points = grid(DVec3::ZERO, [4.0, 4.0]);
        let [eye, look_at] = frame_points(&points, &gorge, 1.5, 40.0).unwrap();
        assert!(gorge(eye.x, eye.z).is_none_or(|height| eye.y > height), "{eye}");
        assert!(look_at.y < eye.y);
    }

    #[test]
    fn hull_of_a_level_square_from_above_is_its_share_of_the_picture() {
        let pose = Pose::looking(DVec3::new(0.0, 2.0, 0.0), DVec3::ZERO, DVec3::NEG_Z, 90.0, None).unwrap();
        let points: Vec<DVec3> =
            grid(DVec3::new(-1.0, 0.0, -1.0), [2.0, 2.0]).into_iter().map(|p| p.with_y(0.0)).collect();
        assert!((covered_area(&points, &pose, DVec2::ONE) - 0.25).abs() < 1e-12);
        assert_eq!(covered_area(&points[..1], &pose, DVec2::ONE), 0.0);
    }

    #[test]
    fn a_long_channel_is_seen_along_rather_than_across() {
        let points = grid(DVec3::ZERO, [80.0, 10.0]);
        let [eye, look_at] = frame_points(&points, &|_, _| None, 16.0 / 9.0, 40.0).unwrap();
        let view = (look_at - eye).normalize();
        assert!(view.x.abs() > view.z.abs(), "{view}");
    }

    #[test]
    fn one_point_and_no_point() {
        let open = |_: f64, _: f64| None;
        let [eye, look_at] = frame_points(&[DVec3::new(3.0, 1.0, 2.0)], &open, 1.0, 40.0).unwrap();
        assert!((eye - look_at).length() > 1e-4 && eye.is_finite());
        assert_eq!(frame_points(&[DVec3::NAN], &open, 1.0, 40.0), Err(RenderError::NothingToFrame));
    }
}
