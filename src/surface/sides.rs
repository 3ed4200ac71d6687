//! Walls at the domain's edge: upright, from below to a surface, never tessellated. They close the body of water, so that
//! a ray inside always has a way out, and the block of ground under the bed.
//!
//! A wall is hit where the ray crosses its plane between its lower and its upper end, both evaluated from their splines
//! there. The edge itself belongs to the wall, with a little room for rounding, so that no ray
//! slips out between wall and surface.

use std::sync::Arc;

use glam::Vec3;

use super::{LANES, LaneHits, LaneRays, LaneSurface, SolveCounts, SplineSurface};

/// Axis (0: x, 1: z), end of the domain (0: least, 1: greatest) and outward normal of each wall: west, east, north, south.
const WALLS: [(usize, usize, Vec3); 4] = [(0, 0, Vec3::NEG_X), (0, 1, Vec3::X), (1, 0, Vec3::NEG_Z), (1, 1, Vec3::Z)];

/// The lower end of walls.
#[derive(Clone, Debug)]
enum Foot {
    Surface(Arc<SplineSurface>),
    Level(f64),
}

/// The four walls; primitive 0 west, 1 east, 2 north, 3 south.
#[derive(Clone, Debug)]
pub struct Sides {
    top: Arc<SplineSurface>,
    foot: Foot,
    /// Room for rounding along the walls (m).
    slack: f64,
    /// Box around the walls.
    bounds: [Vec3; 2],
}

impl Sides {
    /// Walls between a water surface and its bed; without a bed they reach down to the water's lowest height.
    pub fn new(water: Arc<SplineSurface>, bed: Option<Arc<SplineSurface>>) -> Self {
        match bed {
            Some(bed) => {
                let floor = bed.bounds()[0].y;
                Self::between(water, Foot::Surface(bed), floor)
            }
            None => {
                let floor = water.bounds()[0].y;
                Self::between(water, Foot::Level(f64::from(floor)), floor)
            }
        }
    }

    /// Walls of the block of ground under a bed: a twelfth of the domain's shorter side deeper than its lowest point.
    pub fn of_ground(bed: Arc<SplineSurface>) -> Self {
        let [low, high] = bed.bounds();
        let floor = low.y - (high.x - low.x).min(high.z - low.z) / 12.0;
        Self::between(bed, Foot::Level(f64::from(floor)), floor)
    }

    fn between(top: Arc<SplineSurface>, foot: Foot, floor: f32) -> Self {
        // Single-precision rays are rounded to this much at the domain's far corner.
        let [low, high] = top.bounds();
        let slack = 4.0 * f64::from(f32::EPSILON) * f64::from(low.abs().max(high.abs()).max_element());
        let room = Vec3::splat(slack as f32);
        let bounds = [low.with_y(low.y.min(floor)) - room, high + room];
        Self { top, foot, slack, bounds }
    }

    /// Lower and upper end over a point of the domain's edge; `None` where there is no wall.
    fn span(&self, x: f64, z: f64) -> Option<[f64; 2]> {
        let (top, _) = self.top.point(x, z)?;
        let bottom = match &self.foot {
            Foot::Surface(surface) => surface.point(x, z)?.0,
            Foot::Level(level) => *level,
        };
        (bottom <= top).then_some([bottom, top])
    }

    /// The first wall that a ray hits within `range`: t, wall, and place along and up the wall.
    fn first(&self, origin: [f64; 3], direction: [f64; 3], range: [f64; 2]) -> Option<(f64, u32, [f64; 2])> {
        let domain = self.top.lattice().domain.map(|corner| self.top.lattice().from_cell(corner));
        let mut first: Option<(f64, u32, [f64; 2])> = None;
        for (wall, &(axis, end, _)) in WALLS.iter().enumerate() {
            let (across, along) = if axis == 0 { (0, 2) } else { (2, 0) };
            let t = (domain[end][axis] - origin[across]) / direction[across];
            // A ray within the plane, or parallel to it, crosses nowhere.
            if !t.is_finite() || t < range[0] || t > range[1] || first.is_some_and(|(nearest, ..)| nearest <= t) {
                continue;
            }
            let (low, high) = (domain[0][1 - axis], domain[1][1 - axis]);
            let place = origin[along] + t * direction[along];
            if place < low - self.slack || place > high + self.slack {
                continue;
            }
            let place = place.clamp(low, high);
            let at = if axis == 0 { [domain[end][0], place] } else { [place, domain[end][1]] };
            let height = origin[1] + t * direction[1];
            if let Some([bottom, top]) = self.span(at[0], at[1])
                && (bottom - self.slack..=top + self.slack).contains(&height)
            {
                let share = if top > bottom { ((height - bottom) / (top - bottom)).clamp(0.0, 1.0) } else { 0.0 };
                first = Some((t, wall as u32, [(place - low) / (high - low), share]));
            }
        }
        first
    }

    /// Lanes that may hit a wall, in single precision with room to spare: most rays meet none, and this sees it sixteen
    /// at a time.
    fn candidates(&self, rays: &LaneRays) -> u16 {
        let [low, high] = self.bounds;
        // A ten-thousandth of the body is far more than single precision loses on the way from its edge; rays from
        // afar lose in proportion to their way.
        let room = 1e-4 * (high - low).max_element();
        let mut near = [false; LANES];
        for (axis, end, _) in WALLS {
            let (across, along) = if axis == 0 { (0, 2) } else { (2, 0) };
            let plane = if end == 0 { low[across] + self.slack as f32 } else { high[across] - self.slack as f32 };
            for lane in 0..LANES {
                let t = (plane - rays.origin[across][lane]) / rays.direction[across][lane];
                let (rise, run) = (t * rays.direction[1][lane], t * rays.direction[along][lane]);
                let (y, place) = (rays.origin[1][lane] + rise, rays.origin[along][lane] + run);
                let give = room + 1e-6 * (rise.abs() + run.abs());
                near[lane] |= (t >= 0.0)
                    & (t * 0.999 <= rays.tfar[lane])
                    & (y >= low.y - give)
                    & (y <= high.y + give)
                    & (place >= low[along] - give)
                    & (place <= high[along] + give);
            }
        }
        (0..LANES).fold(0, |bits, lane| bits | u16::from(near[lane]) << lane) & rays.active
    }

    fn lanes(&self, rays: &LaneRays) -> impl Iterator<Item = (usize, (f64, u32, [f64; 2]))> {
        let candidates = self.candidates(rays);
        (0..LANES).filter(move |lane| candidates >> lane & 1 == 1).filter_map(|lane| {
            let axes = [0, 1, 2];
            let origin = axes.map(|axis| f64::from(rays.origin[axis][lane]));
            let direction = axes.map(|axis| f64::from(rays.direction[axis][lane]));
            let range = [f64::from(rays.tnear[lane]), f64::from(rays.tfar[lane])];
            self.first(origin, direction, range).map(|hit| (lane, hit))
        })
    }
}

impl LaneSurface for Sides {
    fn bounds(&self) -> [Vec3; 2] {
        self.bounds
    }

    fn closest(&self, rays: &LaneRays, hits: &mut LaneHits, _counts: &mut SolveCounts) {
        hits.hit = 0;
        hits.gave_up = 0;
        for (lane, (t, wall, place)) in self.lanes(rays) {
            hits.hit |= 1 << lane;
            hits.t[lane] = t as f32;
            hits.primitive[lane] = wall;
            hits.u[lane] = place[0] as f32;
            hits.v[lane] = place[1] as f32;
            let normal = WALLS[wall as usize].2;
            for axis in 0..3 {
                hits.normal[axis][lane] = normal[axis];
            }
        }
    }

    fn occluded(&self, rays: &LaneRays, _counts: &mut SolveCounts) -> u16 {
        self.lanes(rays).fold(0, |hit, (lane, _)| hit | 1 << lane)
    }

    fn bytes(&self) -> u64 {
        size_of::<Self>() as u64
    }
}

#[cfg(test)]
mod tests {
    use super::super::control::{self, tests::lake};
    use super::super::tests::Random;
    use super::*;
    use crate::scene::{SolverKind, Surface};
    use crate::simd::SimdLevel;

    fn body(order: u32) -> (Arc<SplineSurface>, Arc<SplineSurface>, Sides) {
        let settings = Surface { order, ..Default::default() };
        let build = |lattice| Arc::new(SplineSurface::new(lattice, SolverKind::Univariate, SimdLevel::detect()));
        let water = build(control::water(&lake(), &settings, [0.0; 3]).unwrap().unwrap());
        let bed = build(control::bed(&lake(), &settings, [0.0; 3]).unwrap());
        (water.clone(), bed.clone(), Sides::new(water, Some(bed)))
    }

    #[test]
    fn a_wall_reaches_from_bed_to_surface() {
        let (.., sides) = body(3);
        // Columns are 1 m, the domain is 0..8; at z = 2.5 in the west the bed is 0 and the water 1.
        let west = sides.first([-3.0, 0.5, 2.5], [1.0, 0.0, 0.0], [0.0, 100.0]).unwrap();
        assert_eq!((west.0, west.1), (3.0, 0));
        assert_eq!(sides.first([-3.0, 1.01, 2.5], [1.0, 0.0, 0.0], [0.0, 2.0]), None);
        assert_eq!(sides.first([-3.0, 1.01, 2.5], [1.0, 0.0, 0.0], [0.0, 100.0]).map(|hit| hit.1), None);
        // From inside it is hit as well, with the outward normal.
        let mut rays = LaneRays::EMPTY;
        rays.active = 1;
        rays.tfar[0] = 100.0;
        (rays.origin[0][0], rays.origin[1][0], rays.origin[2][0]) = (2.0, 0.5, 2.5);
        rays.direction[2][0] = -2.0;
        let mut hits = LaneHits::EMPTY;
        sides.closest(&rays, &mut hits, &mut SolveCounts::default());
        assert_eq!((hits.hit, hits.t[0], hits.primitive[0], hits.normal[2][0]), (1, 1.25, 2, -1.0));
    }

    #[test]
    fn no_wall_is_missing_where_widths_are_not_short_in_binary() {
        for (width, order) in
            [0.1, 0.37, 0.81, 1.0 / 3.0].into_iter().flat_map(|w| (2..=4).map(move |order| (w, order)))
        {
            let (nx, nz) = (12, 10);
            let columns = crate::state::Columns {
                origin: [0.0; 2],
                width: [width, 1.7 * width],
                nx,
                nz,
                base: vec![0.0; nx * nz],
                top: vec![1.0; nx * nz],
                ..Default::default()
            };
            let settings = Surface { order, ..Default::default() };
            let build = |lattice| Arc::new(SplineSurface::new(lattice, SolverKind::Univariate, SimdLevel::Portable));
            let water = build(control::water(&columns, &settings, [0.0; 3]).unwrap().unwrap());
            let bed = build(control::bed(&columns, &settings, [0.0; 3]).unwrap());
            let sides = Sides::new(water, Some(bed));
            for (wall, (_, _, normal)) in WALLS.iter().enumerate() {
                let from = [5.3 * width, 0.5, 4.4 * 1.7 * width];
                let hit = sides.first(from, normal.as_dvec3().to_array(), [0.0, 1e3]);
                assert_eq!(hit.map(|hit| hit.1), Some(wall as u32), "width {width} order {order}");
            }
        }
    }

    #[test]
    fn no_ray_leaves_the_closed_body() {
        for order in 2..=4 {
            let (water, bed, sides) = body(order);
            let mut random = Random(order.into());
            let mut rays = 0;
            while rays < 70_000 {
                let mut lanes = LaneRays::EMPTY;
                for lane in 0..LANES {
                    let (x, z) = (8.0 * random.next(), 8.0 * random.next());
                    let (Some((top, _)), Some((bottom, _))) = (water.point(x, z), bed.point(x, z)) else { continue };
                    // Not within rounding of a surface: there inside and outside cannot be told.
                    let y = bottom + (top - bottom) * random.next();
                    if y < bottom + 1e-4 || y > top - 1e-4 {
                        continue;
                    }
                    let (rise, turn) = (2.0 * random.next() - 1.0, std::f64::consts::TAU * random.next());
                    let level = (1.0f64 - rise * rise).sqrt();
                    let mut direction = [level * turn.cos(), rise, level * turn.sin()];
                    // One in four aims at an edge between a wall and the rest.
                    if lane % 4 == 0 {
                        let edge = 8.0 * random.next();
                        let height = water.point(0.0, edge).map_or(0.5, |(height, _)| height);
                        direction = [-x, height - y, edge - z];
                    }
                    for axis in 0..3 {
                        lanes.origin[axis][lane] = [x, y, z][axis] as f32;
                        lanes.direction[axis][lane] = direction[axis] as f32;
                    }
                    lanes.tfar[lane] = f32::INFINITY;
                    lanes.tolerance[lane] = 1e-6;
                    lanes.active |= 1 << lane;
                    rays += 1;
                }
                let mut counts = SolveCounts::default();
                let closed = [&*water as &dyn LaneSurface, &*bed, &sides]
                    .iter()
                    .fold(0, |hit, surface| hit | surface.occluded(&lanes, &mut counts));
                assert_eq!(closed, lanes.active, "order {order}: {lanes:?}");
            }
        }
    }
}
