//! Which faces of which columns shed spray, how much, and the particles that this makes.
//!
//! A crest breaks where it stands higher over the water before it than a share (0.78) of that water's depth (appendix A of
//! the report; McCowan 1894). What then goes over the face is the discharge of a weir, Cd 2/3 B e^(3/2) sqrt(2 g), with e
//! the height of the face over the water before it or over its own bed. It is gathered until it makes a whole particle, so
//! that neither their number nor their moments depend on the step.

use glam::DVec3;
use rayon::prelude::*;

use super::Spray;
use super::flight::DENSITY;
use super::random::{Purpose, uniform};
use super::surroundings::Surroundings;
use crate::sim::{Grid, Water};

/// The four faces: bit of the mask, step along x and z to the column before the face.
pub(super) const FACES: [(u8, [isize; 2]); 4] = [(1, [1, 0]), (2, [-1, 0]), (4, [0, 1]), (8, [0, -1])];

/// Columns that one task takes: enough work to be worth a task.
const COLUMNS_PER_TASK: usize = 8192;

/// What a face is like at this moment.
#[derive(Clone, Copy, Debug)]
pub(super) struct Face {
    /// Height that stands free (m); 0 or less if none does.
    pub(super) exposed: f64,
    /// Height of the free part's foot (m).
    pub(super) sill: f64,
    /// Whether it sheds.
    pub(super) breaks: bool,
}

/// When a face sheds, and at what rate.
#[derive(Clone, Copy, Debug)]
pub(super) struct Weir {
    pub(super) gravity: f64,
    pub(super) threshold: f64,
    pub(super) least_height: f64,
    pub(super) discharge: f64,
}

impl Weir {
    /// Volume per second (m3/s) over a face of a width (m).
    pub(super) fn rate(&self, width: f64, exposed: f64) -> f64 {
        self.speed(exposed) * width * exposed.max(0.0)
    }

    /// Speed (m/s) through a face: the rate over the face's area.
    pub(super) fn speed(&self, exposed: f64) -> f64 {
        self.discharge * (2.0 / 3.0) * (2.0 * self.gravity * exposed.max(0.0)).sqrt()
    }

    /// A face between a column and the one before it, each as base and depth (m).
    pub(super) fn face(&self, own: [f64; 2], before: [f64; 2]) -> Face {
        let (top, level) = (own[0] + own[1], before[0] + before[1]);
        let sill = level.max(own[0]);
        let exposed = top - sill;
        let breaks =
            own[1] > 0.0 && exposed > 0.0 && exposed >= self.least_height && top - level > self.threshold * before[1];
        Face { exposed, sill, breaks }
    }

    /// Upward speed, and what is left along the ground, of water that comes to a face at `speed` from a column behind it.
    ///
    /// v² = u² + 2 a s, with s the height that the water lost on its way (gained, if negative) over a distance of `run`. It
    /// only counts as far as the two columns' waters touch: what falls from a ledge behind falls as spray of its own and
    /// brings its speed itself, and no water climbs a ledge.
    pub(super) fn turn(&self, speed: f64, own: [f64; 2], behind: [f64; 2], run: f64) -> [f64; 2] {
        let (top, level) = (own[0] + own[1], behind[0] + behind[1]);
        if !(behind[1] > 0.0) || level <= own[0] {
            return [0.0, speed];
        }
        if level >= top {
            let fall = level - top.max(behind[0]);
            return [-(2.0 * self.gravity * fall).sqrt(), speed];
        }
        let climb = top - level;
        let left = (speed * speed - 2.0 * self.gravity * climb).max(0.0).sqrt();
        let slope = climb.hypot(run);
        [left * climb / slope, left * run / slope]
    }
}

/// The neighbour of a column across a face or behind it.
pub(super) fn neighbour(grid: &Grid, column: usize, step: [isize; 2]) -> Option<usize> {
    let x = (column % grid.nx).checked_add_signed(step[0]).filter(|x| *x < grid.nx)?;
    let z = (column / grid.nx).checked_add_signed(step[1]).filter(|z| *z < grid.nz)?;
    Some(z * grid.nx + x)
}

impl Spray {
    /// Lets crests break for `dt` seconds: takes their water out of the columns and puts it in particles.
    ///
    /// *Shape*: `sink` and `turbulence` one per column; columns of a sink shed nothing. `turbulence` is the rms velocity (m/s)
    /// that spreads the directions of what breaks free, or empty for none.
    ///
    /// # Panics
    /// If the slices do not have one value per column (or none, for `turbulence`).
    pub fn shed(&mut self, water: &mut Water, dt: f64, sink: &[bool], turbulence: &[f64]) {
        assert_eq!(sink.len(), self.grid.count(), "one flag per column");
        assert!(turbulence.is_empty() || turbulence.len() == sink.len(), "one turbulence per column");
        if !self.enabled {
            return;
        }
        self.gather(water, dt, sink);
        let columns = self.grid.count();
        // Where there is no room for all, each step begins elsewhere: no corner of the map is served first for ever.
        let room = self.most - self.state.mass.len().min(self.most);
        let first = if room < self.due_particles() {
            (uniform(self.seed, self.state.counts.refused, Purpose::Moment) * columns as f64) as usize
        } else {
            0
        };
        for column in (first..columns).chain(0..first) {
            if self.due[column] != 0 {
                self.shed_column(water, column, dt, turbulence);
            }
        }
        if self.state.mass.len() >= self.most {
            self.state.shedding.fill(0);
        }
    }

    /// Adds up what goes over each face; marks those with a particle due, and those that have come to rest.
    fn gather(&mut self, water: &Water, dt: f64, sink: &[bool]) {
        let (grid, weir, volume) = (self.grid, self.weir, self.volume);
        let (base, depth) = (water.base(), water.depth());
        let chunks = self
            .state
            .demand
            .par_chunks_mut(COLUMNS_PER_TASK)
            .zip(self.state.shedding.par_chunks_mut(COLUMNS_PER_TASK))
            .zip(self.state.gathering.par_chunks_mut(COLUMNS_PER_TASK))
            .zip(self.due.par_chunks_mut(COLUMNS_PER_TASK));
        chunks.enumerate().for_each(|(chunk, (((demand, shedding), gathering), due))| {
            for index in 0..demand.len() {
                let column = chunk * COLUMNS_PER_TASK + index;
                (due[index], shedding[index]) = (0, 0);
                if gathering[index] == 0 && (!(depth[column] > 0.0) || sink[column]) {
                    continue;
                }
                let own = [base[column], depth[column]];
                let mut open = 0;
                for (slot, (bit, step)) in FACES.into_iter().enumerate() {
                    let Some(before) = neighbour(&grid, column, step) else { continue };
                    let face = weir.face(own, [base[before], depth[before]]);
                    if face.breaks && !sink[column] {
                        open |= bit;
                        demand[index][slot] += dt * weir.rate(breadth(&grid, step), face.exposed);
                        if demand[index][slot] >= volume {
                            due[index] |= bit;
                        }
                    } else if gathering[index] & bit != 0 {
                        due[index] |= bit;
                    }
                }
                (gathering[index], shedding[index]) = (open, open);
            }
        });
    }

    /// How many particles are due this step, the last ones of events that end included.
    fn due_particles(&self) -> usize {
        let due = self.due.iter().zip(&self.state.demand).filter(|(due, _)| **due != 0);
        due.map(|(due, demand)| {
            let faces = FACES.into_iter().zip(demand).filter(|((bit, _), _)| due & bit != 0);
            faces.fold(0usize, |sum, (_, demand)| sum.saturating_add((demand / self.volume).ceil() as usize))
        })
        .fold(0, usize::saturating_add)
    }

    fn shed_column(&mut self, water: &mut Water, column: usize, dt: f64, turbulence: &[f64]) {
        let area = self.grid.area();
        let own = [water.base()[column], water.depth()[column]];
        let gust = turbulence.get(column).copied().unwrap_or(0.0);
        let mut taken = 0.0;
        for (slot, (bit, step)) in FACES.into_iter().enumerate() {
            if self.due[column] & bit == 0 {
                continue;
            }
            let Some(before) = neighbour(&self.grid, column, step) else { continue };
            let face = self.weir.face(own, [water.base()[before], water.depth()[before]]);
            let rate = self.weir.rate(breadth(&self.grid, step), face.exposed);
            let ends = self.state.shedding[column] & bit == 0;
            // While it breaks, a crest gives what stands free; the last of it is owed by the whole column.
            let holds = if ends { own[1] * area } else { (face.exposed * area).max(0.0) } - taken;
            let gathered = self.state.demand[column][slot];
            let demand = gathered.min(holds.max(0.0));
            // More than a column holds: what there is goes, and this is the end of it.
            let all = ends || demand < gathered;
            let whole = (demand / self.volume).floor();
            let rest = if all { demand - whole * self.volume } else { 0.0 };
            self.state.demand[column][slot] = if all { 0.0 } else { gathered - whole * self.volume };

            let birth = self.birth(water, column, step, face, gust);
            let count = whole as u64 + u64::from(rest > 0.0);
            for index in 0..count {
                if self.state.mass.len() >= self.most {
                    self.state.counts.refused = self.state.counts.refused.saturating_add(count - index);
                    break;
                }
                let last = index as f64 == whole;
                let volume = water.take(column, if last { rest } else { self.volume });
                if !(volume > 0.0) {
                    break;
                }
                taken += volume;
                // Since it was whole, and then some: the moments are spread over the time each took to gather, or all the
                // faces of a straight ledge would shed in step.
                let since = if last || rate == 0.0 {
                    dt
                } else {
                    let whole_since = (gathered - (index + 1) as f64 * self.volume) / rate;
                    whole_since + uniform(self.seed, self.state.next_id, Purpose::Moment) * self.volume / rate
                };
                self.add(&birth, volume, since - dt);
            }
        }
    }

    /// What the particles of one face have in common.
    fn birth(&self, water: &Water, column: usize, step: [isize; 2], face: Face, gust: f64) -> Birth {
        let grid = &self.grid;
        let axis = usize::from(step[1] != 0);
        let toward = step[0] + step[1];
        let mut normal = DVec3::ZERO;
        normal[2 * axis] = toward as f64;

        let [x, z] = [(column % grid.nx) as isize, (column / grid.nx) as isize];
        let around = (-1..=1).flat_map(|dz| (-1..=1).map(move |dx| [dx, dz]));
        let flow = around.filter_map(|step| neighbour(grid, column, step)).fold(DVec3::ZERO, |sum, near| {
            let [x, z] = water.flow_at(near);
            sum + DVec3::new(x, 0.0, z)
        });
        let direction = flow.try_normalize().filter(|direction| direction.dot(normal) > 0.0).unwrap_or(normal);

        let speed = self.weir.speed(face.exposed);
        let own = [water.base()[column], water.depth()[column]];
        let [up, along] = match neighbour(grid, column, step.map(|step| -step)) {
            Some(behind) => self.weir.turn(speed, own, [water.base()[behind], water.depth()[behind]], grid.width[axis]),
            None => [0.0, speed],
        };

        let [low, high] = grid.extent();
        let index = if axis == 0 { x } else { z };
        // Half a column from the centre, and so much further that no rounding puts it back into its own column.
        let border = low[axis] + (index + isize::from(toward > 0)) as f64 * grid.width[axis];
        let rounding = 16.0 * f64::EPSILON * (low[axis].abs().max(high[axis].abs()) + grid.width[axis]);
        let place = border + toward as f64 * rounding;
        let (centre, breadth) = (grid.centre(column)[1 - axis], grid.width[1 - axis]);
        let around =
            Surroundings { grid: *grid, base: water.base(), depth: water.depth(), sink: &[], solids: &self.solids };
        let bank = [-0.5, 0.0, 0.5].map(|share| {
            let mut point = DVec3::ZERO;
            point[2 * axis] = place;
            point[2 - 2 * axis] = centre + share * breadth;
            around.ground(point)
        });
        Birth {
            normal,
            across: 2 * axis,
            place,
            centre,
            breadth,
            bank,
            heights: [face.sill.min(own[0] + own[1]), own[0] + own[1]],
            velocity: direction * along + DVec3::Y * up,
            gust,
        }
    }

    /// Puts a particle before a face; `age` is its age at the step's end less the step (s).
    fn add(&mut self, birth: &Birth, volume: f64, age: f64) {
        let id = self.state.next_id;
        self.state.next_id += 1;
        let random = |purpose| uniform(self.seed, id, purpose);
        let mut position = DVec3::ZERO;
        position[birth.across] = birth.place;
        position.y = birth.heights[0] + random(Purpose::Height) * (birth.heights[1] - birth.heights[0]);
        let along = birth.clear(random(Purpose::Along) - 0.5, position.y);
        position[2 - birth.across] = birth.centre + along * birth.breadth;
        let gust = [Purpose::GustX, Purpose::GustY, Purpose::GustZ].map(|purpose| random(purpose) - 0.5);
        let velocity = birth.spread(gust);
        let mass = volume * DENSITY;
        let state = &mut self.state;
        state.position.push(position.to_array());
        state.velocity.push(velocity.to_array());
        state.mass.push(mass);
        state.first_mass.push(mass);
        state.age.push(age);
        state.id.push(id);
        state.counts.shed += 1;
    }
}

/// What the particles of one face have in common.
struct Birth {
    normal: DVec3,
    /// The coordinate across the face (0 x, 2 z) and its value.
    across: usize,
    place: f64,
    /// The face's middle and breadth along the other coordinate.
    centre: f64,
    breadth: f64,
    /// Height of the ground at its two ends and in its middle, between which it is straight.
    bank: [f64; 3],
    heights: [f64; 2],
    velocity: DVec3,
    /// Root mean square of the turbulent velocity (m/s).
    gust: f64,
}

impl Birth {
    /// A place along the face (-1/2 to 1/2) at a height, moved towards the middle until it is out of a bank that slopes
    /// across the face. In the middle the ground lies midway between two bases, and not above the free part of the face.
    fn clear(&self, along: f64, height: f64) -> f64 {
        let [low, middle, high] = self.bank;
        let rise = 2.0 * (if along < 0.0 { low } else { high } - middle);
        if middle + rise * along.abs() <= height {
            return along;
        }
        along.signum() * ((height - middle).max(0.0) / rise)
    }

    /// The velocity with a turbulent one added, at its old speed: turbulence turns spray aside, but its energy is the flow's.
    ///
    /// `gust` is uniform over ±1/2 in each component, of variance 1/12, so that sqrt(12) makes its rms that of the flow.
    fn spread(&self, gust: [f64; 3]) -> DVec3 {
        let speed = self.velocity.length();
        let mut velocity = self.velocity + DVec3::from_array(gust) * (12f64.sqrt() * self.gust);
        let back = velocity.dot(self.normal);
        if back < 0.0 {
            velocity -= self.normal * (2.0 * back);
        }
        if self.gust > 0.0 { velocity.try_normalize().map_or(self.velocity, |way| way * speed) } else { self.velocity }
    }
}

/// The width (m) of a face that is crossed along a step.
fn breadth(grid: &Grid, step: [isize; 2]) -> f64 {
    grid.width[usize::from(step[0] != 0)]
}
