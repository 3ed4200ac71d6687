//! Columns of water and the pipes between them: the body of the water (O'Brien and Hodgins 1995; Mould and Yang 1997).
//!
//! Here are the state, its settings and what others may ask of it or do to it; `layout` says where things lie, `step` what
//! moves the flow and `flow` does it, `limit` moves the volume, `velocity` makes columns' velocities of it, `cells` divides
//! columns. Spray, sources and sinks are elsewhere.
//!
//! # What it can and cannot do
//!
//! On a level bed without friction the pipes solve the shallow-water equations to first order: waves run at sqrt(g h) in
//! every direction, bores as fast as Stoker's, a broad crest passes critical flow. They know no vertical acceleration:
//! short waves do not disperse, crests do not curl (spray stands in for that), a jet over a ledge leaves it level. Ground is
//! one height for each column, so that slopes are stairs; a bank that shuts a diagonal pipe takes its share of the flow
//! along that bank. Divided columns exchange no momentum between their cells, which makes bores run ahead, by up to a
//! quarter.

mod cells;
mod flow;
mod layout;
mod limit;
mod rows;
mod step;
#[cfg(test)]
mod tests;
mod velocity;

use super::Grid;
use cells::Cells;
use layout::{Layout, Pipes, WALL};

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
    /// The pipes as the last step left them, and as this one makes them; the length of the last step (s).
    pipes: Pipes,
    next: Pipes,
    last_step: f64,
    /// Depth of still water (m) that was poured into each column since the last step, with margins, and whether any was.
    given: Vec<f64>,
    is_given: bool,
    /// The flow of every cell, if columns are divided.
    cells: Option<Cells>,
    /// Share of what its pipes ask for that a column can give.
    share: Vec<f64>,
    /// Velocity of each column along x and z (m/s), and where the bed is rough its drag for each metre per second (1/m), at
    /// the start of the step, with margins.
    velocity: [Vec<f64>; 2],
    drag: Vec<f64>,
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
        let pipes = Pipes::new(&layout);
        Self {
            grid,
            settings,
            pressure: vec![0.0; layout.padded_count()],
            next: pipes.clone(),
            last_step: 0.0,
            given: vec![0.0; layout.padded_count()],
            is_given: false,
            cells: settings.cell_height.map(Cells::new),
            share: vec![1.0; layout.padded_count()],
            velocity: [0, 1].map(|_| vec![0.0; layout.padded_count()]),
            drag: vec![0.0; if settings.manning == 0.0 { 0 } else { layout.padded_count() }],
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

    /// Pours `volume` (m3) into a column, without momentum: what flows there is slowed as it mixes with it. A volume that is
    /// not above 0 pours nothing.
    pub fn give(&mut self, column: usize, volume: f64) {
        if volume > 0.0 {
            let metres = volume / self.layout.area;
            self.set_depth(column, self.depth[column] + metres);
            self.given[self.layout.padded_index(column)] += metres;
            self.is_given = true;
        }
    }

    /// Makes a column `depth` deep (m; below 0 counts as 0); returns the volume (m3) that this added, negative if it took.
    /// What is added moves as the column does: a stream that runs into the map.
    pub fn set_depth(&mut self, column: usize, depth: f64) -> f64 {
        assert!(!depth.is_nan(), "depth of column {column} is not a number");
        let before = std::mem::replace(&mut self.depth[column], depth.max(0.0));
        let padded = self.layout.padded_index(column);
        self.top[padded] = self.base[column] + self.depth[column];
        (self.depth[column] - before) * self.layout.area
    }

    /// What the pipes remember: with the depths, all that the next step depends on. Its order is this type's own; without
    /// cells its length is that of every water of this map.
    pub fn pipes(&self) -> Vec<f64> {
        let mut all = Vec::with_capacity(2 * self.pipes.eta.len() + self.given.len() + 1);
        all.extend_from_slice(&self.pipes.eta);
        all.extend_from_slice(&self.pipes.moved);
        all.extend_from_slice(&self.given);
        all.push(self.last_step);
        if let Some(cells) = &self.cells {
            all.extend_from_slice(&cells.eta);
            all.extend_from_slice(&cells.moved);
        }
        all
    }

    /// Puts back what [`Self::pipes`] gave. Returns false, and changes nothing, for another number of values.
    #[must_use]
    pub fn set_pipes(&mut self, pipes: &[f64]) -> bool {
        let count = self.pipes.eta.len();
        let whole = 2 * count + self.given.len() + 1;
        if pipes.len() < whole {
            return false;
        }
        let (pipes, divided) = pipes.split_at(whole);
        if !self.cells.as_mut().map_or(divided.is_empty(), |cells| cells.restore(&self.layout, divided)) {
            return false;
        }
        self.pipes.eta.copy_from_slice(&pipes[..count]);
        self.pipes.moved.copy_from_slice(&pipes[count..2 * count]);
        self.given.copy_from_slice(&pipes[2 * count..whole - 1]);
        self.is_given = self.given.iter().any(|given| *given != 0.0);
        self.last_step = pipes[whole - 1];
        true
    }
}
