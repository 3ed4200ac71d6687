//! Particles → bricks: each brick gathers what lies in it and next to it, in one fixed order, so that the grid has the same
//! bits at any count of threads.

use glam::{DVec3, IVec3, Vec3};
use rayon::prelude::*;

use super::{
    BUDGET, DENSEST, Droplets, Mist, MistError, MistSettings,
    bricks::{BRICK_BYTES, Bricks, CORNERS, SIDE, VALUES},
    grid::Grid,
    kernel::{PER_DEVIATION, REACHED, Slope, corners, cross_section},
};
use crate::simd::{self, Kernel, Simd, SimdLevel};

/// Voxels from the scene's origin within which particles are taken: sums of two such places are whole numbers still.
const FARTHEST: f64 = (1u32 << 30) as f64;

/// A particle on the grid.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Cloud {
    /// The brick that it lies in, z first: the order of the bricks.
    home: [i32; 3],
    /// Its place in the file, which breaks ties.
    number: u32,
    /// Place (voxels).
    place: DVec3,
    /// Extinction of a voxel that had all of it (1/m).
    amount: f64,
    /// Velocity (m/s).
    velocity: Vec3,
}

/// What a particle gives the corners around it.
#[derive(Clone, Copy, Debug)]
struct Gift {
    slopes: [Slope; 3],
    /// Extinction of a voxel that had all of it (1/m).
    amount: f64,
    /// Velocity (m/s).
    velocity: DVec3,
}

impl Gift {
    fn new(cloud: &Cloud) -> Self {
        let slopes = cloud.place.to_array().map(Slope::new);
        Self { slopes, amount: cloud.amount, velocity: cloud.velocity.as_dvec3() }
    }
}

/// The gifts of a brick's own particles.
struct Group<'g> {
    home: [i32; 3],
    gifts: &'g [Gift],
}

impl Mist {
    /// The still mist of particles at `position` (m, in the files' frame) of `mass` kg each, around `origin`.
    ///
    /// # Errors
    /// [`MistError::TooLarge`], [`MistError::TooDense`].
    pub fn build(
        position: &[[f64; 3]],
        mass: &[f64],
        settings: &MistSettings,
        origin: DVec3,
    ) -> Result<Self, MistError> {
        Self::build_within(&Droplets { position, velocity: &[], mass }, settings, origin, BUDGET)
    }

    /// The mist of particles that move, within a budget in bytes.
    ///
    /// # Errors
    /// As [`Mist::build`].
    pub fn build_within(
        droplets: &Droplets,
        settings: &MistSettings,
        origin: DVec3,
        budget: u64,
    ) -> Result<Self, MistError> {
        let voxel = settings.width / (2.0 * PER_DEVIATION);
        let mut mist = Self::default();
        let mut clouds = Vec::with_capacity(droplets.mass.len());
        for (number, (position, &mass)) in droplets.position.iter().zip(droplets.mass).enumerate() {
            let velocity = droplets.velocity.get(number).map_or(Vec3::ZERO, |&v| DVec3::from_array(v).as_vec3());
            let mass = mass * settings.scale.powi(3);
            let amount = cross_section(mass, settings.droplet_radius) / voxel.powi(3);
            let place = (DVec3::from_array(*position) - origin) / voxel;
            // A comparison that is false for what is no number.
            if mass == 0.0 {
                mist.without_mass += 1;
            } else if !(place.abs().max_element() < FARTHEST
                && place.is_finite()
                && velocity.is_finite()
                && amount.is_finite()
                && amount > 0.0)
            {
                mist.out_of_range += 1;
            } else {
                let home = (place / f64::from(SIDE)).floor().as_ivec3();
                clouds.push(Cloud { home: [home.z, home.y, home.x], number: number as u32, place, amount, velocity });
            }
        }
        mist.particles = clouds.len() as u64;
        clouds.par_sort_unstable_by_key(|cloud| (cloud.home, cloud.number));
        // What lies in one place is one cloud: emitters may put thousands there.
        clouds.dedup_by(|next, kept| {
            let same = next.place == kept.place;
            if same {
                // Their momentum stays.
                let share = next.amount / (kept.amount + next.amount);
                kept.velocity = kept.velocity.lerp(next.velocity, share as f32);
                kept.amount += next.amount;
            }
            same
        });
        let groups: Vec<&[Cloud]> = clouds.chunk_by(|a, b| a.home == b.home).collect();
        let most = budget / BRICK_BYTES;
        let too_large = |bricks: usize| MistError::TooLarge {
            particles: mist.particles,
            bytes: bricks as u64 * BRICK_BYTES,
            budget,
            voxel,
        };
        // Each of these is a brick, so that not even the list of all bricks outgrows the budget.
        if groups.len() as u64 > most {
            return Err(too_large(groups.len()));
        }
        let bricks = touched(&groups);
        if bricks.len() as u64 > most {
            return Err(too_large(bricks.len()));
        }
        let gifts: Vec<Gift> = clouds.par_iter().map(Gift::new).collect();
        let mut left = &gifts[..];
        let givers: Vec<Group> = groups
            .iter()
            .map(|group| {
                let (gifts, rest) = left.split_at(group.len());
                left = rest;
                Group { home: group[0].home, gifts }
            })
            .collect();
        // Products and sums are the same ones in any width.
        let level = SimdLevel::detect();
        let mut values = vec![0.0f32; bricks.len() * VALUES];
        let mut velocities = vec![Vec3::ZERO; bricks.len()];
        let densest = values
            .par_chunks_exact_mut(VALUES)
            .zip(&mut velocities)
            .zip(&bricks)
            .map(|((values, velocity), &brick)| {
                simd::dispatch(level, Fill { values, velocity, brick, groups: &givers })
            })
            .reduce(|| 0.0, f64::max);
        // Sums that are no number any more are over any limit.
        if !(densest <= DENSEST) {
            return Err(MistError::TooDense { extinction: densest });
        }
        let bricks = Bricks::new(bricks.iter().map(|&[z, y, x]| IVec3::new(x, y, z)).collect(), values, velocities);
        mist.grids.push(Grid::even(voxel as f32, bricks));
        Ok(mist)
    }
}

/// The bricks with a corner that any cloud reaches, in order.
fn touched(groups: &[&[Cloud]]) -> Vec<[i32; 3]> {
    let mut bricks: Vec<[i32; 3]> = groups
        .par_iter()
        .flat_map_iter(|group| {
            let home = group[0].home;
            let mut reached = [false; 27];
            for cloud in *group {
                // A corner on a brick's near side is on the far side of the one before it.
                let around = |axis: usize, home: i32| {
                    corners(cloud.place[axis]).map(|corner| corner - home * SIDE).map(|corner| [corner - 1, corner])
                };
                let [x, y, z] = [around(0, home[2]), around(1, home[1]), around(2, home[0])]
                    .map(|[first, last]| first[0].div_euclid(SIDE)..=last[1].div_euclid(SIDE));
                for (dz, dy, dx) in z
                    .flat_map(|dz| y.clone().map(move |dy| (dz, dy)))
                    .flat_map(|(dz, dy)| x.clone().map(move |dx| (dz, dy, dx)))
                {
                    reached[((dz + 1) * 9 + (dy + 1) * 3 + dx + 1) as usize] = true;
                }
            }
            (0..27)
                .filter(move |&index| reached[index as usize])
                .map(move |index: i32| [home[0] + index / 9 - 1, home[1] + index / 3 % 3 - 1, home[2] + index % 3 - 1])
        })
        .collect();
    bricks.par_sort_unstable();
    bricks.dedup();
    bricks
}

/// One brick being filled, with the widest instructions of the processor.
struct Fill<'f> {
    values: &'f mut [f32],
    velocity: &'f mut Vec3,
    brick: [i32; 3],
    groups: &'f [Group<'f>],
}

impl Kernel for Fill<'_> {
    type Output = f64;

    #[inline(always)]
    fn run<S: Simd>(self, _: S) -> f64 {
        fill(self.values, self.velocity, self.brick, self.groups)
    }
}

/// Fills one brick from the clouds in it and around it, with the mean velocity of what they give it; its greatest value.
#[inline(always)]
fn fill(values: &mut [f32], velocity: &mut Vec3, brick: [i32; 3], groups: &[Group]) -> f64 {
    // Doubles: of a million clouds in one place each adds its share.
    let mut sums = [0.0f64; VALUES];
    let (mut momentum, mut amount) = (DVec3::ZERO, 0.0);
    for index in 0..27 {
        let home = [brick[0] + index / 9 - 1, brick[1] + index / 3 % 3 - 1, brick[2] + index % 3 - 1];
        let Ok(group) = groups.binary_search_by(|group| group.home.cmp(&home)) else { continue };
        for gift in groups[group].gifts {
            let given = add(&mut sums, brick, gift);
            momentum += given * gift.velocity;
            amount += given;
        }
    }
    // Where clouds end at a brick's very border nothing is given, or too little to be a number.
    *velocity = Some((momentum / amount).as_vec3()).filter(|mean| mean.is_finite()).unwrap_or_default();
    for (value, sum) in values.iter_mut().zip(sums) {
        *value = sum as f32;
    }
    sums.into_iter().fold(0.0, |most, sum| if sum <= most { most } else { sum })
}

/// Adds what a particle gives a brick's corners; all of it.
#[inline(always)]
fn add(sums: &mut [f64; VALUES], brick: [i32; 3], gift: &Gift) -> f64 {
    // Corners of the brick that it reaches, along each axis.
    let first = [brick[2], brick[1], brick[0]].map(|place| place * SIDE);
    let reached = |axis: usize| {
        let [low, high] = gift.slopes[axis].corners.map(|corner| corner - first[axis]);
        (low.max(0), high.min(CORNERS as i32 - 1))
    };
    let [x, y, z] = [reached(0), reached(1), reached(2)];
    if x.0 > x.1 || y.0 > y.1 || z.0 > z.1 {
        return 0.0;
    }
    // What each of the brick's corners along an axis has, 0 where nothing reaches.
    let shares = |axis: usize| {
        // Room for all that a particle reaches before and after the brick, so that lengths are known.
        let mut around = [0.0; REACHED - 1 + CORNERS + REACHED - 1];
        let slope = &gift.slopes[axis];
        let start = (slope.corners[0] - first[axis] + REACHED as i32 - 1) as usize;
        around[start..start + REACHED].copy_from_slice(&slope.shares());
        let mut along = [0.0; CORNERS];
        along.copy_from_slice(&around[REACHED - 1..REACHED - 1 + CORNERS]);
        along
    };
    let [along, across, up] = [shares(0), shares(1), shares(2)];
    let along_x: f64 = along.iter().sum();
    let mut given = 0.0;
    for k in z.0..=z.1 {
        let amount = gift.amount * up[k as usize];
        for j in y.0..=y.1 {
            let amount = amount * across[j as usize];
            given += amount * along_x;
            // A whole row, though some of it adds nothing: of a length that is known.
            let row = (k as usize * CORNERS + j as usize) * CORNERS;
            for (sum, share) in sums[row..row + CORNERS].iter_mut().zip(&along) {
                *sum += amount * share;
            }
        }
    }
    given
}
