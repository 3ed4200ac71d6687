//! What a particle flies among: the ground, the columns' tops, the solids and the map's edges, and which of them its path
//! meets first.
//!
//! The ground is bilinear between the bases at the columns' centres and level beyond the outermost ones; water is as high
//! as its column's top over all its footprint. A path is therefore followed through *half* columns, in each of which the
//! ground is one bilinear patch and the water one level: both are quadratics in time there, and nothing is stepped over.

use glam::DVec3;

use crate::sim::Grid;
use crate::sim::solids::{Path, Solids};

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
    /// Above the top of its column, or over a dry one.
    Air,
    /// Under the top of its column.
    Water,
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
    /// It goes on into another column, under water.
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

    /// Height of a column's water, or nothing over a dry one.
    pub(super) fn top(&self, column: usize) -> Option<f64> {
        (self.depth[column] > 0.0).then(|| self.base[column] + self.depth[column])
    }

    /// What a point in a half column is in.
    pub(super) fn medium(&self, half: Half, height: f64) -> Medium {
        match self.top(self.column(half)) {
            Some(top) if height < top => Medium::Water,
            _ => Medium::Air,
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
        let [[west, east], [north, south]] = self.stencil(half);
        let around = [[west, north], [east, north], [west, south], [east, south]].map(|[x, z]| z * self.grid.nx + x);
        around.into_iter().fold(own, |low, column| if self.base[column] < self.base[low] { column } else { low })
    }

    /// The nearest point within the map.
    pub(super) fn within(&self, point: DVec3) -> DVec3 {
        let [low, high] = self.grid.extent();
        DVec3::new(point.x.clamp(low[0], high[0]), point.y, point.z.clamp(low[1], high[1]))
    }

    /// The first event on a path that starts in a half column, solids left out.
    pub(super) fn first_event(&self, path: &Path, mut half: Half, medium: Medium) -> Stop {
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
            if let Some((time, event)) = self.event_within(path, half, medium, entered, until) {
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
            let changes = next / 2 != half[axis] / 2;
            half[axis] = next;
            leave[axis] = exit(axis, next);
            if changes && medium == Medium::Water {
                return Stop { time: until, event: Event::Passed, half };
            }
            entered = until;
        }
    }

    /// The first event inside one half column.
    fn event_within(&self, path: &Path, half: Half, medium: Medium, from: f64, until: f64) -> Option<(f64, Event)> {
        let span = until - from;
        let (point, velocity) = (path.at(from), path.velocity_at(from));
        let bend = 0.5 * path.acceleration;
        let patch = self.patch(half);
        let [u, v] = self.place(&patch, point);
        let [du, dv] = [velocity.x / self.grid.width[0], velocity.z / self.grid.width[1]];
        let (slope_u, slope_v) = patch.slopes(u, v);
        let ground = first_fall(
            point.y - patch.value(u, v),
            velocity.y - (slope_u * du + slope_v * dv),
            bend - patch.twist * du * dv,
            span,
        );
        let water = self.top(self.column(half)).and_then(|top| match medium {
            Medium::Air => first_fall(point.y - top, velocity.y, bend, span),
            Medium::Water => first_fall(top - point.y, -velocity.y, -bend, span),
        });
        match (ground, water) {
            (Some(strike), water) if water.is_none_or(|time| strike < time) => {
                let (slope_u, slope_v) = patch.slopes(u + du * strike, v + dv * strike);
                let normal = DVec3::new(-slope_u / self.grid.width[0], 1.0, -slope_v / self.grid.width[1]);
                Some((from + strike, Event::Ground(normal.normalize())))
            }
            (_, Some(time)) => {
                let event = if medium == Medium::Air { Event::Immersed } else { Event::Emerged };
                Some((from + time, event))
            }
            _ => None,
        }
    }
}

impl Patch {
    fn value(&self, u: f64, v: f64) -> f64 {
        self.height + self.along_x * u + self.along_z * v + self.twist * (u * v)
    }

    fn slopes(&self, u: f64, v: f64) -> (f64, f64) {
        (self.along_x + self.twist * v, self.along_z + self.twist * u)
    }
}

/// The first time of [0, span] at which a clearance c0 + c1 t + c2 t² is used up and not growing.
///
/// A clearance that is gone at the start but grows is one that was just left: then the next time it is used up.
fn first_fall(c0: f64, c1: f64, c2: f64, span: f64) -> Option<f64> {
    let falls = c1 < 0.0 || (c1 == 0.0 && c2 <= 0.0);
    if c0 <= 0.0 && falls && (c0 < 0.0 || c1 < 0.0 || c2 < 0.0) {
        return Some(0.0);
    }
    // Most flights end here: a path that bends downward and ends above stays above.
    if c2 <= 0.0 && c0 + (c1 + c2 * span) * span > 0.0 {
        return None;
    }
    let discriminant = c1 * c1 - 4.0 * c0 * c2;
    let root = if c0 <= 0.0 {
        if !(c2 < 0.0) {
            return None;
        }
        if discriminant < 0.0 {
            // It turns round before it is out.
            return Some(0.0);
        }
        (c1 + discriminant.sqrt()) / (-2.0 * c2)
    } else {
        if c1 >= 0.0 && c2 >= 0.0 || !(discriminant > 0.0) {
            return None;
        }
        if c1 > 0.0 { (c1 + discriminant.sqrt()) / (-2.0 * c2) } else { 2.0 * c0 / (discriminant.sqrt() - c1) }
    };
    (root <= span).then_some(root.max(0.0))
}
