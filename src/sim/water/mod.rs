//! Columns of water and the pipes between them: the body of the water (O'Brien and Hodgins 1995; Mould and Yang 1997).
//!
//! Here are the state, its settings and what others may ask of it or do to it; `layout` says where things lie, `step` moves
//! the flow, `limit` the volume, `cells` the slabs of columns that are divided. Spray, sources and sinks are elsewhere.

mod layout;
mod limit;
mod step;
#[cfg(test)]
mod tests;

use super::Grid;
use layout::{DENSITY, FAMILIES, Layout, OFFSETS, WALL};

/// What the water obeys.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WaterSettings {
    /// Acceleration due to gravity (m/s2).
    pub gravity: f64,
    /// Share of a pipe's flow that is left after `reference_step`; 0 stops all flow.
    pub friction: f64,
    /// The time (s) that `friction` belongs to.
    pub reference_step: f64,
    /// Manning's roughness of the bed (s/m^(1/3)); 0 leaves bed friction out.
    pub manning: f64,
    /// Height (m) of the cells that columns are divided in; `None`: a column is one cell.
    pub cell_height: Option<f64>,
    /// Share of a column that the fastest wave may cross in the largest step.
    pub courant: f64,
}

impl Default for WaterSettings {
    fn default() -> Self {
        Self { gravity: 9.81, friction: 0.995, reference_step: 0.01, manning: 0.0, cell_height: None, courant: 0.4 }
    }
}

/// What acts on the water during one step.
#[derive(Clone, Copy, Debug, Default)]
pub struct Forcing<'a> {
    /// External pressure above air's (Pa) on each column, finite; empty for none.
    pub pressure: &'a [f64],
    /// Faces over which a column sheds spray, bits E = 1, W = 2, S = 4, N = 8; empty for none. There the pipes above the
    /// neighbour's water are closed: a particle carries what they would. A diagonal pipe is closed with either of its faces.
    pub shedding: &'a [u8],
}

/// The longest step that is stable, and what asks for it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step {
    /// Its length (s); infinite where nothing is wet.
    pub seconds: f64,
    /// The column that allows no longer one.
    pub column: usize,
    /// Fastest wave there (m/s), flow and wave together.
    pub speed: f64,
}

/// The water on a map of columns.
#[derive(Clone, Debug)]
pub struct Water {
    grid: Grid,
    settings: WaterSettings,
    layout: Layout,
    base: Vec<f64>,
    depth: Vec<f64>,
    /// Base and top with margins.
    wall: Vec<f64>,
    top: Vec<f64>,
    /// External pressure as metres of water, with margins.
    pressure: Vec<f64>,
    /// Velocity in each pipe (m/s), positive away from its owner.
    pipes: Vec<f64>,
    next: Vec<f64>,
    /// Flow through each pipe (m3/s) at the start of the step, and the volume (m3) that it moved.
    flux: Vec<f64>,
    moved: Vec<f64>,
    /// Share of what its pipes ask for that a column can give.
    share: Vec<f64>,
    /// Volume (m3) that stayed in each column during the last step.
    kept: Vec<f64>,
}

impl Water {
    /// Water at rest: `base` and `depth` (m) of each column, index `z * nx + x`. A depth below 0 counts as 0.
    ///
    /// Panics unless both have one finite value for each column.
    pub fn new(grid: Grid, base: Vec<f64>, mut depth: Vec<f64>, settings: WaterSettings) -> Self {
        assert!(base.len() == grid.count() && depth.len() == grid.count(), "one base and one depth for each column");
        assert!(base.iter().chain(&depth).all(|height| height.is_finite()), "bases and depths are finite");
        for depth in &mut depth {
            *depth = depth.max(0.0);
        }
        let layout = Layout::new(&grid);
        let mut wall = vec![WALL; layout.padded_count()];
        let mut top = wall.clone();
        for column in 0..grid.count() {
            wall[layout.padded_index(column)] = base[column];
            top[layout.padded_index(column)] = base[column] + depth[column];
        }
        let pipes = vec![0.0; layout.padded_count() * FAMILIES];
        Self {
            grid,
            settings,
            pressure: vec![0.0; layout.padded_count()],
            next: pipes.clone(),
            flux: pipes.clone(),
            moved: pipes.clone(),
            share: vec![1.0; layout.padded_count()],
            kept: depth.iter().map(|depth| depth * grid.area()).collect(),
            layout,
            base,
            depth,
            wall,
            top,
            pipes,
        }
    }

    /// The map.
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// What the water obeys.
    pub fn settings(&self) -> &WaterSettings {
        &self.settings
    }

    /// Height of each column's bed (m).
    pub fn base(&self) -> &[f64] {
        &self.base
    }

    /// Depth of each column (m), never below 0.
    pub fn depth(&self) -> &[f64] {
        &self.depth
    }

    /// Height of a column's top (m).
    pub fn top(&self, column: usize) -> f64 {
        self.base[column] + self.depth[column]
    }

    /// Volume of all columns (m3), by a compensated sum in the order of the columns.
    pub fn volume(&self) -> f64 {
        let (mut sum, mut lost) = (0.0f64, 0.0);
        for &depth in &self.depth {
            // Neumaier's sum: what an addition rounds off is added at the end.
            let total = sum + depth;
            lost += if sum >= depth { (sum - total) + depth } else { (depth - total) + sum };
            sum = total;
        }
        (sum + lost) * self.layout.area
    }

    /// Takes up to `volume` (m3) out of a column; returns what was taken. A volume that is not above 0 takes nothing.
    pub fn take(&mut self, column: usize, volume: f64) -> f64 {
        if volume.is_nan() || volume <= 0.0 {
            return 0.0;
        }
        -self.set_depth(column, self.depth[column] - volume / self.layout.area)
    }

    /// Pours `volume` (m3) into a column, without momentum. A volume that is not above 0 pours nothing.
    pub fn give(&mut self, column: usize, volume: f64) {
        if volume > 0.0 {
            self.set_depth(column, self.depth[column] + volume / self.layout.area);
        }
    }

    /// Makes a column `depth` deep (m; below 0 counts as 0); returns the volume (m3) that this added, negative if it took.
    pub fn set_depth(&mut self, column: usize, depth: f64) -> f64 {
        assert!(!depth.is_nan(), "depth of column {column} is not a number");
        let before = std::mem::replace(&mut self.depth[column], depth.max(0.0));
        let padded = self.layout.padded_index(column);
        self.top[padded] = self.base[column] + self.depth[column];
        (self.depth[column] - before) * self.layout.area
    }

    /// Every pipe's velocity (m/s): with the depths, all that the next step depends on. The order is this type's own.
    pub fn pipes(&self) -> &[f64] {
        &self.pipes
    }

    /// Puts back what [`Self::pipes`] gave. Returns false, and changes nothing, for another number of pipes.
    #[must_use]
    pub fn set_pipes(&mut self, pipes: &[f64]) -> bool {
        if pipes.len() != self.pipes.len() {
            return false;
        }
        self.pipes.copy_from_slice(pipes);
        true
    }

    /// Depth-averaged velocity (m/s) along x and z: the momentum in half of each of a column's pipes over its volume, at
    /// most as fast as the fastest of them. 0 in a dry column.
    pub fn flow_at(&self, column: usize) -> [f64; 2] {
        let depth = self.depth[column];
        if depth <= 0.0 {
            return [0.0; 2];
        }
        let layout = &self.layout;
        let here = layout.padded_index(column);
        let mut momentum = [[0.0; 2]; FAMILIES];
        let mut fastest = 0.0f64;
        for (family, offset) in OFFSETS.into_iter().enumerate() {
            let behind = layout.moved(here, [-offset[0], -offset[1]]);
            let mut sum = 0.0;
            for owner in [here, behind] {
                let velocity = self.pipes[layout.pipe(owner, family)];
                let height = step::open_height(&self.top, &self.wall, owner, layout.moved(owner, offset), velocity);
                sum += velocity * height;
                fastest = fastest.max(velocity.abs());
            }
            let weight = 0.5 * layout.section[family] * layout.length[family] / (layout.area * depth);
            momentum[family] = layout.direction[family].map(|cosine| sum * weight * cosine);
        }
        // Axes before diagonals, so that a mirrored map gives the mirrored bits.
        let flow = [0, 1].map(|axis| (momentum[0][axis] + momentum[1][axis]) + (momentum[2][axis] + momentum[3][axis]));
        let speed = flow[0].hypot(flow[1]);
        if speed > fastest { flow.map(|part| part * (fastest / speed)) } else { flow }
    }

    /// [`Self::flow_at`] of every column.
    pub fn flow(&self) -> Vec<[f64; 2]> {
        (0..self.depth.len()).map(|column| self.flow_at(column)).collect()
    }

    /// Pressure at a column's bed (Pa above air): hydrostatic, dynamic and external.
    pub fn pressure_at_base(&self, column: usize, external: f64) -> f64 {
        let [x, z] = self.flow_at(column);
        DENSITY * self.settings.gravity * self.depth[column] + 0.5 * DENSITY * (x * x + z * z) + external
    }

    /// The longest step that is stable.
    ///
    /// A wave may cross `courant` of a column: 1 / dt = ((|v_x| + c) / dx + (|v_z| + c) / dz) / courant, c = sqrt(g h),
    /// v the fastest of the column's pipes along each axis. At courant 1 this is below the bound of the linear scheme,
    /// dt c sqrt(1 / dx^2 + 1 / dz^2) < 1.
    pub fn largest_step(&self) -> Step {
        let layout = &self.layout;
        let [dx, dz] = self.grid.width;
        let mut worst = Step { seconds: f64::INFINITY, column: 0, speed: 0.0 };
        let mut greatest = 0.0;
        for z in 0..layout.nz {
            for x in 0..layout.nx {
                let column = z * layout.nx + x;
                let depth = self.depth[column];
                if depth <= 0.0 {
                    continue;
                }
                let here = layout.padded(x, z);
                let mut along = [0.0f64; 2];
                for (family, offset) in OFFSETS.into_iter().enumerate() {
                    let behind = layout.moved(here, [-offset[0], -offset[1]]);
                    let fastest = self.pipes[layout.pipe(here, family)].abs();
                    let fastest = fastest.max(self.pipes[layout.pipe(behind, family)].abs());
                    for axis in 0..2 {
                        along[axis] = along[axis].max(fastest * layout.direction[family][axis].abs());
                    }
                }
                let wave = (self.settings.gravity * depth).sqrt();
                let rate = (along[0] + wave) / dx + (along[1] + wave) / dz;
                if rate > greatest {
                    greatest = rate;
                    worst =
                        Step { seconds: self.settings.courant / rate, column, speed: along[0].max(along[1]) + wave };
                }
            }
        }
        worst
    }
}
