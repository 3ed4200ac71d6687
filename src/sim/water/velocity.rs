//! Velocities of columns, from the volumes that their pipes moved, and the drag of the bed.

use super::flow::BLOCK;
use super::layout::{DENSITY, FAMILIES, Layout, MARGIN, pipes};
use super::limit::PAIRS;
use super::rows::{each_row, each_row_of_two, greater, is_parallel};
use super::{Step, Water};
use rayon::prelude::*;

/// What a column's velocity follows from, for all of a map.
#[derive(Clone, Copy)]
struct Momentum {
    width: [f64; 2],
    /// Half of one over footprint and time: a pipe's volume lies half in each of its columns.
    scale: f64,
}

impl Momentum {
    /// Velocity (m/s) of a column `depth` m deep (above 0): `moved` holds the sums over both pipes of each family, `fastest`
    /// is the greatest speed in any of them.
    #[inline(always)]
    fn velocity(&self, moved: [f64; FAMILIES], fastest: f64, depth: f64) -> [f64; 2] {
        let per_metre = self.scale / depth;
        // Length times cosine is the column's width for axes and diagonals alike. Axes before diagonals: mirrored bits.
        let x = self.width[0] * (moved[0] + (moved[2] - moved[3])) * per_metre;
        let z = self.width[1] * (moved[1] + (moved[2] + moved[3])) * per_metre;
        let speed = (x * x + z * z).sqrt();
        let share = if speed > fastest { fastest / speed } else { 1.0 };
        [x * share, z * share]
    }
}

/// The column of a row that allows the shortest step.
#[derive(Clone, Copy, Default)]
struct Fastest {
    /// Columns that a wave crosses in a second.
    pub rate: f64,
    pub column: usize,
    pub speed: f64,
}

/// The fastest column of row `z`; rate 0 where all are dry.
fn fastest(eta: &[f64], layout: &Layout, z: usize, depth: &[f64], gravity: f64, [dx, dz]: [f64; 2]) -> Fastest {
    let stride = layout.stride;
    let [cos_x, cos_z] = layout.direction[2];
    let mut worst = Fastest::default();
    for x in (0..layout.nx).step_by(BLOCK) {
        let width = BLOCK.min(layout.nx - x);
        let depth = &depth[z * layout.nx + x..][..width];
        let at = |family, shift, row| pipes(eta, stride, row, family, x, shift, width);
        let (e, w, s, n) = (at(0, 0, z + 1), at(0, -1, z + 1), at(1, 0, z + 1), at(1, 0, z));
        let (se, nw, sw, ne) = (at(2, 0, z + 1), at(2, -1, z), at(3, 0, z + 1), at(3, 1, z));
        let mut rates = [0.0; BLOCK];
        let mut greatest = 0.0f64;
        for i in 0..width {
            let diagonal = greater(greater(se[i].abs(), nw[i].abs()), greater(sw[i].abs(), ne[i].abs()));
            let along_x = greater(greater(e[i].abs(), w[i].abs()), diagonal * cos_x);
            let along_z = greater(greater(s[i].abs(), n[i].abs()), diagonal * cos_z);
            let wave = (gravity * depth[i]).sqrt();
            let rate = (along_x + wave) / dx + (along_z + wave) / dz;
            rates[i] = if depth[i] > 0.0 { rate } else { 0.0 };
            greatest = greater(rates[i], greatest);
        }
        if greatest > worst.rate {
            let i = rates[..width].iter().position(|&rate| rate == greatest).unwrap_or(0);
            let around = [e[i], w[i], s[i], n[i], se[i], nw[i], sw[i], ne[i]];
            let flow = around.into_iter().fold(0.0f64, |fastest, velocity| fastest.max(velocity.abs()));
            let column = z * layout.nx + x + i;
            worst = Fastest { rate: greatest, column, speed: flow + (gravity * depth[i]).sqrt() };
        }
    }
    worst
}

impl Water {
    fn momentum(&self) -> Momentum {
        let scale = if self.last_step > 0.0 { 0.5 / (self.layout.area * self.last_step) } else { 0.0 };
        Momentum { width: self.grid.width, scale }
    }

    /// Depth-averaged velocity (m/s) along x and z: the momentum in the column's halves of its pipes, as the last step moved
    /// their water, over its volume; at most as fast as the fastest of them. 0 in a dry column.
    pub fn flow_at(&self, column: usize) -> [f64; 2] {
        let depth = self.depth[column];
        if depth <= 0.0 {
            return [0.0; 2];
        }
        let layout = &self.layout;
        let here = layout.padded_index(column);
        let mut moved = [0.0; FAMILIES];
        let mut fastest = 0.0f64;
        for (sum, pair) in moved.iter_mut().zip(PAIRS) {
            let [head, tail] = pair.map(|(family, shift, _)| layout.pipe(layout.moved(here, shift), family));
            *sum = self.pipes.moved[head] + self.pipes.moved[tail];
            fastest = fastest.max(self.pipes.eta[head].abs()).max(self.pipes.eta[tail].abs());
        }
        self.momentum().velocity(moved, fastest, depth)
    }

    /// [`Self::flow_at`] of every column, the same bits.
    pub fn flow(&self) -> Vec<[f64; 2]> {
        let mut flow = vec![[0.0; 2]; self.depth.len()];
        self.flow_into(&mut flow);
        flow
    }

    /// [`Self::flow`] without allocating; `flow` has one value for each column.
    pub fn flow_into(&self, flow: &mut [[f64; 2]]) {
        assert_eq!(flow.len(), self.depth.len(), "one velocity for each column");
        let parallel = is_parallel(self.grid.count());
        each_row(flow, self.layout.nx, parallel, |z, flow| {
            self.flow_row(z, |column, velocity| flow[column] = velocity)
        });
    }

    /// Velocity of each column of row `z`.
    #[inline(always)]
    fn flow_row(&self, z: usize, mut put: impl FnMut(usize, [f64; 2])) {
        let (layout, momentum) = (&self.layout, self.momentum());
        let (stride, nx) = (layout.stride, layout.nx);
        let depth = &self.depth[z * nx..][..nx];
        let pair = |field, pair: usize| {
            PAIRS[pair]
                .map(|(family, [dx, dz], _)| pipes(field, stride, (z + 1).wrapping_add_signed(dz), family, 0, dx, nx))
        };
        let [moved_x, moved_z, moved_se, moved_sw] = [0, 1, 2, 3].map(|family| pair(&self.pipes.moved, family));
        let [eta_x, eta_z, eta_se, eta_sw] = [0, 1, 2, 3].map(|family| pair(&self.pipes.eta, family));
        let fastest = |of: [&[f64]; 2], i: usize| greater(of[0][i].abs(), of[1][i].abs());
        let sum = |of: [&[f64]; 2], i: usize| of[0][i] + of[1][i];
        for i in 0..nx {
            let moved = [sum(moved_x, i), sum(moved_z, i), sum(moved_se, i), sum(moved_sw, i)];
            let axial = greater(fastest(eta_x, i), fastest(eta_z, i));
            let fastest = greater(axial, greater(fastest(eta_se, i), fastest(eta_sw, i)));
            let velocity = momentum.velocity(moved, fastest, depth[i]);
            put(i, if depth[i] > 0.0 { velocity } else { [0.0; 2] });
        }
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
        let row = |z: usize| fastest(&self.pipes.eta, layout, z, &self.depth, self.settings.gravity, self.grid.width);
        let greater = |a: Fastest, b: Fastest| if b.rate > a.rate { b } else { a };
        let worst = if is_parallel(self.grid.count()) {
            // Rows come back in order, and of equals the first wins, whoever made them.
            (0..layout.nz)
                .into_par_iter()
                .map(row)
                .reduce(Fastest::default, |a, b| if (b.rate, a.column) > (a.rate, b.column) { b } else { a })
        } else {
            (0..layout.nz).map(row).fold(Fastest::default(), greater)
        };
        Step { seconds: self.settings.courant / worst.rate, column: worst.column, speed: worst.speed }
    }

    /// Refreshes the velocity of each column, and where Manning's roughness asks for it the bed's drag.
    ///
    /// *Source*: R. Manning 1891: the bed slows water by g n^2 v |v| / h^(4/3) (m/s2).
    pub(super) fn refresh_columns(&mut self, parallel: bool) {
        let (stride, nx) = (self.layout.stride, self.layout.nx);
        let inner = stride..stride * (self.layout.nz + 1);
        let [mut along_x, mut along_z] = std::mem::take(&mut self.velocity);
        each_row_of_two(&mut along_x[inner.clone()], &mut along_z[inner.clone()], stride, parallel, |z, x, y| {
            let (x, y) = (&mut x[MARGIN..][..nx], &mut y[MARGIN..][..nx]);
            self.flow_row(z, |column, velocity| [x[column], y[column]] = velocity);
        });
        self.velocity = [along_x, along_z];
        if self.settings.manning == 0.0 {
            return;
        }
        let (depth, rough) = (&self.depth, self.settings.gravity * self.settings.manning * self.settings.manning);
        each_row(&mut self.drag[inner], stride, parallel, |z, drag| {
            for (drag, &depth) in drag[MARGIN..].iter_mut().zip(&depth[z * nx..][..nx]) {
                *drag = if depth > 0.0 { rough / (depth * depth.cbrt()) } else { 0.0 };
            }
        });
    }
}
