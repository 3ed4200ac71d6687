//! What a particle flies among: the ground, the columns' tops, the solids and the map's edges, and which of them its path
//! meets first.
//!
//! The ground is bilinear between the bases at the columns' centres and level beyond the outermost ones. Water is as high
//! as its column's top, but a sheet of its column's depth along ground that falls away to columns whose water does not
//! reach up to it: no drop that strikes a cliff is in the water above. And it is only there for particles whose radius is
//! less than its depth: others strike the ground under it. A path is followed through *half* columns, in each
//! of which the ground is one bilinear patch and the water one level or sheet: both are quadratics in time there, and
//! nothing is stepped over.

use glam::DVec3;

use crate::sim::Grid;
use crate::sim::solids::{Path, Solids, first_fall};

/// What does not change while particles fly.
pub(super) struct Surroundings<'a> {
    pub(super) grid: Grid,
    pub(super) base: &'a [f64],
    pub(super) depth: &'a [f64],
    pub(super) sink: &'a [bool],
    pub(super) solids: &'a Solids,
}

/// What a particle is in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Medium {
    /// Above the water, or over a dry column.
    Air,
    /// Under water.
    Water,
}

/// The water over a half column.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Surface {
    Dry,
    /// At this height (m).
    Level(f64),
    /// This far (m) over the ground.
    Sheet(f64),
}

/// A half column, counted along x and z.
pub(super) type Half = [usize; 2];

/// What ends a part of a flight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Event {
    /// Its time is up.
    End,
    /// It strikes the ground, whose upward unit normal this is.
    Ground(DVec3),
    /// It falls into the water, or runs into the side of a higher column.
    Immersed,
    /// It comes out of the water through the column's top.
    Emerged,
    /// It goes on into another half column, under water.
    Passed,
    /// It comes to the edge of the map along this axis (0 x, 1 z).
    Edge(usize),
}

/// The first event on a path.
#[derive(Clone, Copy, Debug)]
pub(super) struct Stop {
    pub(super) time: f64,
    pub(super) event: Event,
    pub(super) half: Half,
}

/// One half column's bilinear patch: its corner heights and how a place becomes (u, v).
struct Patch {
    corner: [f64; 2],
    height: f64,
    along_x: f64,
    along_z: f64,
    twist: f64,
}

impl Surroundings<'_> {
    /// The half column that holds a point; points outside the map count to its outermost ones.
    pub(super) fn half_at(&self, point: DVec3) -> Half {
        let place = |axis: usize, value: f64, count: usize| {
            let width = self.grid.width[axis];
            let low = self.grid.origin[axis] - 0.5 * width;
            // A cast takes what lies below 0, and what is no number, to 0.
            (((value - low) / (0.5 * width)) as usize).min(2 * count - 1)
        };
        [place(0, point.x, self.grid.nx), place(1, point.z, self.grid.nz)]
    }

    /// The column that a half belongs to.
    pub(super) fn column(&self, half: Half) -> usize {
        half[1] / 2 * self.grid.nx + half[0] / 2
    }

    /// The four columns between whose centres a half lies; at the map's edges some are the same.
    fn stencil(&self, half: Half) -> [[usize; 2]; 2] {
        let pair = |half: usize, count: usize| {
            let high = half.div_ceil(2);
            [high.saturating_sub(1), high.min(count - 1)]
        };
        [pair(half[0], self.grid.nx), pair(half[1], self.grid.nz)]
    }

    fn around(&self, half: Half) -> [usize; 4] {
        let [[west, east], [north, south]] = self.stencil(half);
        [[west, north], [east, north], [west, south], [east, south]].map(|[x, z]| z * self.grid.nx + x)
    }

    fn patch(&self, half: Half) -> Patch {
        let [[west, east], [north, south]] = self.stencil(half);
        let base = |x: usize, z: usize| self.base[z * self.grid.nx + x];
        let height = base(west, north);
        let (along_x, along_z) = (base(east, north) - height, base(west, south) - height);
        let twist = (base(east, south) - base(west, south)) - along_x;
        Patch { corner: self.grid.centre(north * self.grid.nx + west), height, along_x, along_z, twist }
    }

    /// The height of the ground (m) at a point of the map.
    pub(super) fn ground(&self, point: DVec3) -> f64 {
        let patch = self.patch(self.half_at(point));
        let [u, v] = self.place(&patch, point);
        patch.value(u, v)
    }

    fn place(&self, patch: &Patch, point: DVec3) -> [f64; 2] {
        [(point.x - patch.corner[0]) / self.grid.width[0], (point.z - patch.corner[1]) / self.grid.width[1]]
    }

    fn surface(&self, half: Half, radius: f64) -> Surface {
        let own = self.column(half);
        let (base, depth) = (self.base[own], self.depth[own]);
        if !(depth > radius) {
            return Surface::Dry;
        }
        let falls = self.around(half).into_iter().any(|column| self.falls_away(own, column));
        if falls { Surface::Sheet(depth) } else { Surface::Level(base + depth) }
    }

    /// Whether a column's ground lies under another's, and its water does not reach up to that.
    fn falls_away(&self, own: usize, column: usize) -> bool {
        let base = self.base[own];
        self.base[column] < base && self.base[column] + self.depth[column] <= base
    }

    /// Height of the water (m) at a point of a half column, or nothing over a dry one.
    pub(super) fn water_height(&self, half: Half, point: DVec3, radius: f64) -> Option<f64> {
        match self.surface(half, radius) {
            Surface::Dry => None,
            Surface::Level(top) => Some(top),
            Surface::Sheet(depth) => {
                let patch = self.patch(half);
                let [u, v] = self.place(&patch, point);
                Some(patch.value(u, v) + depth)
            }
        }
    }

    /// What a point in a half column is in.
    pub(super) fn medium(&self, half: Half, point: DVec3, radius: f64) -> Medium {
        match self.water_height(half, point, radius) {
            Some(top) if point.y < top => Medium::Water,
            _ => Medium::Air,
        }
    }

    /// What gravity leaves of its pull (m/s2) on what is in the water over a half column: nothing in a pool, where buoyancy
    /// bears it all; its part along the ground in a column beside one that its water falls to, and runs down that ground.
    pub(super) fn pull_in_water(&self, half: Half, point: DVec3, gravity: f64) -> DVec3 {
        let own = self.column(half);
        let [x, z] = [half[0] / 2, half[1] / 2];
        let mut near = (z.saturating_sub(1)..(z + 2).min(self.grid.nz))
            .flat_map(|z| (x.saturating_sub(1)..(x + 2).min(self.grid.nx)).map(move |x| z * self.grid.nx + x));
        if !near.any(|column| self.falls_away(own, column)) {
            return DVec3::ZERO;
        }
        let patch = self.patch(half);
        let [u, v] = self.place(&patch, point);
        along(DVec3::NEG_Y * gravity, self.normal(&patch, u, v))
    }

    fn normal(&self, patch: &Patch, u: f64, v: f64) -> DVec3 {
        let (slope_u, slope_v) = patch.slopes(u, v);
        DVec3::new(-slope_u / self.grid.width[0], 1.0, -slope_v / self.grid.width[1]).normalize()
    }

    /// The column that water at a height in the water over a half column joins.
    pub(super) fn taker(&self, half: Half, height: f64, radius: f64) -> usize {
        match self.surface(half, radius) {
            Surface::Sheet(_) => self.receiver(half, height),
            _ => self.column(half),
        }
    }

    /// The column that water gets that comes to lie on the ground at a point.
    ///
    /// Its own, unless that one's base is higher: then the lowest around, so that water never climbs by being laid down.
    pub(super) fn receiver(&self, half: Half, height: f64) -> usize {
        let own = self.column(half);
        if self.base[own] <= height {
            return own;
        }
        self.around(half)
            .into_iter()
            .fold(own, |low, column| if self.base[column] < self.base[low] { column } else { low })
    }

    /// The nearest point within the map.
    pub(super) fn within(&self, point: DVec3) -> DVec3 {
        let [low, high] = self.grid.extent();
        DVec3::new(point.x.clamp(low[0], high[0]), point.y, point.z.clamp(low[1], high[1]))
    }

    /// The first event on a path that starts in a half column, solids left out.
    pub(super) fn first_event(&self, path: &Path, mut half: Half, medium: Medium, radius: f64) -> Stop {
        let velocity = [path.velocity.x, path.velocity.z];
        let start = [path.start.x, path.start.z];
        let counts = [2 * self.grid.nx, 2 * self.grid.nz];
        // When the path leaves the half along an axis.
        let exit = |axis: usize, half: usize| {
            let border = half + usize::from(velocity[axis] > 0.0);
            let width = self.grid.width[axis];
            let border = self.grid.origin[axis] - 0.5 * width + border as f64 * (0.5 * width);
            if velocity[axis] == 0.0 { f64::INFINITY } else { (border - start[axis]) / velocity[axis] }
        };
        let mut leave = [exit(0, half[0]), exit(1, half[1])];
        let mut entered = 0.0;
        loop {
            let axis = usize::from(leave[1] < leave[0]);
            let until = leave[axis].min(path.duration).max(entered);
            if let Some((time, event)) = self.event_within(path, half, medium, radius, entered, until) {
                return Stop { time, event, half };
            }
            // Written so that a time that is no number ends the path.
            if !(leave[axis] < path.duration) {
                return Stop { time: path.duration, event: Event::End, half };
            }
            let next = if velocity[axis] > 0.0 { half[axis] + 1 } else { half[axis].wrapping_sub(1) };
            if next >= counts[axis] {
                return Stop { time: until, event: Event::Edge(axis), half };
            }
            half[axis] = next;
            leave[axis] = exit(axis, next);
            if medium == Medium::Water {
                return Stop { time: until, event: Event::Passed, half };
            }
            entered = until;
        }
    }

    /// The first event inside one half column.
    fn event_within(
        &self,
        path: &Path,
        half: Half,
        medium: Medium,
        radius: f64,
        from: f64,
        until: f64,
    ) -> Option<(f64, Event)> {
        let span = until - from;
        let (point, velocity) = (path.at(from), path.velocity_at(from));
        let bend = 0.5 * path.acceleration;
        let patch = self.patch(half);
        let [u, v] = self.place(&patch, point);
        let [du, dv] = [velocity.x / self.grid.width[0], velocity.z / self.grid.width[1]];
        let (slope_u, slope_v) = patch.slopes(u, v);
        let over_ground =
            [point.y - patch.value(u, v), velocity.y - (slope_u * du + slope_v * dv), bend - patch.twist * du * dv];
        let ground = first_fall(over_ground, span);
        let over_water = match self.surface(half, radius) {
            Surface::Dry => None,
            Surface::Level(top) => Some([point.y - top, velocity.y, bend]),
            Surface::Sheet(depth) => Some([over_ground[0] - depth, over_ground[1], over_ground[2]]),
        };
        let water = over_water.and_then(|clearance| match medium {
            Medium::Air => first_fall(clearance, span),
            Medium::Water => first_fall(clearance.map(|part| -part), span),
        });
        match (ground, water) {
            (Some(strike), water) if water.is_none_or(|time| strike < time) => {
                let normal = self.normal(&patch, u + du * strike, v + dv * strike);
                Some((from + strike, Event::Ground(normal)))
            }
            (_, Some(time)) => {
                let event = if medium == Medium::Air { Event::Immersed } else { Event::Emerged };
                Some((from + time, event))
            }
            _ => None,
        }
    }
}

/// The part of a vector along a surface.
pub(super) fn along(vector: DVec3, normal: DVec3) -> DVec3 {
    vector - normal * vector.dot(normal)
}

impl Patch {
    fn value(&self, u: f64, v: f64) -> f64 {
        self.height + self.along_x * u + self.along_z * v + self.twist * (u * v)
    }

    fn slopes(&self, u: f64, v: f64) -> (f64, f64) {
        (self.along_x + self.twist * v, self.along_z + self.twist * u)
    }
}
