//! The order in which a batch's rays go into packets: rays that travel alike travel together.
//!
//! A packet of sixteen runs until its slowest ray is done, so sixteen rays in random directions mostly wait for one. Rays
//! are sorted by how far they may run over the surface before they meet its middle height or leave its slab, and by the
//! quadrant they run into. What a ray hits does not depend on its neighbours, so the answers are the same bits in any
//! order. Batches that are coherent as they come keep their order.

use glam::Vec3;

use super::RayBatch;

/// Lengths that are told apart, in powers of two.
const LENGTHS: usize = 16;
/// Lengths times quadrants.
const BUCKETS: usize = LENGTHS * 4;
/// A batch in which fewer than one ray in this many (one in two) differs from the one before is coherent enough.
const COHERENT: usize = 2;

/// The surfaces' common box, as far as the order of rays needs it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Slab {
    low: f32,
    high: f32,
    /// Diagonal of its footprint (m), positive.
    reach: f32,
}

impl Slab {
    /// The slab of a box from `low` to `high`; `None` for an empty one.
    pub(super) fn new(low: Vec3, high: Vec3) -> Option<Self> {
        let reach = (high.x - low.x).hypot(high.z - low.z);
        (reach > 0.0 && reach.is_finite() && low.y <= high.y).then_some(Self { low: low.y, high: high.y, reach })
    }

    /// How a ray is classed.
    #[inline]
    fn bucket(&self, y: f32, dx: f32, dy: f32, dz: f32) -> u8 {
        let middle = 0.5 * (self.low + self.high);
        let towards = (middle - y) * dy > 0.0;
        let goal = if towards {
            middle
        } else if dy > 0.0 {
            self.high
        } else {
            self.low
        };
        let level = (dx * dx + dz * dz).sqrt();
        // Relative to the footprint; a level ray runs all of it, one that has left the slab nothing.
        let run = ((goal - y) / dy * level / self.reach).clamp(0.0, 1.0);
        let run = if dy == 0.0 { 1.0 } else { run };
        // The exponent: 2^-15 and less, …, 1/2, 1.
        let length = (run.to_bits() >> 23).saturating_sub(127 - 15).min(15) as u8;
        length * 4 + u8::from(dx < 0.0) * 2 + u8::from(dz < 0.0)
    }

    /// The order for a batch; `None` to keep it as it comes.
    pub(super) fn order(&self, rays: &RayBatch) -> Option<Vec<u32>> {
        let count = rays.len();
        if count < 64 {
            return None;
        }
        let (y, dx, dy, dz) = (&rays.origin[1], &rays.direction[0], &rays.direction[1], &rays.direction[2]);
        let keys: Vec<u8> = (0..count).map(|ray| self.bucket(y[ray], dx[ray], dy[ray], dz[ray])).collect();
        let changes = keys.windows(2).filter(|pair| pair[0] != pair[1]).count();
        if changes * COHERENT < count {
            return None;
        }
        // A counting sort: stable, so that neighbours within a class stay neighbours.
        let mut place = [0u32; BUCKETS];
        for &key in &keys {
            place[usize::from(key)] += 1;
        }
        let mut sum = 0;
        for slot in &mut place {
            (*slot, sum) = (sum, sum + *slot);
        }
        let mut order = vec![0; count];
        for (ray, &key) in (0..).zip(&keys) {
            let slot = &mut place[usize::from(key)];
            order[*slot as usize] = ray;
            *slot += 1;
        }
        Some(order)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_order_holds_every_ray_once_and_short_runs_come_first() {
        let slab = Slab::new(Vec3::new(0.0, -1.0, 0.0), Vec3::new(100.0, 1.0, 100.0)).unwrap();
        let mut rays = RayBatch::default();
        for k in 0..1000u32 {
            let turn = k as f32 * 2.4;
            let dy = ((k * 37 % 100) as f32 / 50.0 - 0.99) * 2.0;
            rays.push(Vec3::new(50.0, 0.5, 50.0), Vec3::new(turn.cos(), dy, turn.sin()), 0.0, 1e9, 0.0);
        }
        let order = slab.order(&rays).unwrap();
        let mut seen = order.clone();
        seen.sort_unstable();
        assert!(seen.into_iter().eq(0..1000));
        let steep = |ray: u32| rays.direction[1][ray as usize].abs();
        assert!(steep(order[0]) > 1.0 && steep(order[999]) < 0.1);
    }

    #[test]
    fn coherent_batches_keep_their_order() {
        let slab = Slab::new(Vec3::ZERO, Vec3::new(100.0, 1.0, 100.0)).unwrap();
        let mut rays = RayBatch::default();
        for k in 0..1000 {
            rays.push(Vec3::new(50.0, 30.0, -20.0), Vec3::new(k as f32 * 1e-3, -0.5, 1.0), 0.0, 1e9, 0.0);
        }
        assert!(slab.order(&rays).is_none());
        assert!(Slab::new(Vec3::ZERO, Vec3::ZERO).is_none());
    }

    #[test]
    fn numbers_that_are_none_find_a_bucket() {
        let slab = Slab::new(Vec3::ZERO, Vec3::ONE).unwrap();
        for odd in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 0.0, f32::MIN_POSITIVE / 2.0] {
            assert!(usize::from(slab.bucket(odd, odd, odd, odd)) < BUCKETS);
        }
    }
}
