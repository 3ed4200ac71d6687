//! Packets of a batch that go through a surface together: enough that its lanes rarely idle, few enough to stay in cache.
//!
//! A packet of sixteen runs until its slowest ray is done; a block refills lanes as rays finish. What a ray hits does not
//! depend on its neighbours, so the answers are the same bits in any company.

use super::{HitBatch, RayBatch};
use crate::surface::{LANES, LaneHits, LaneRays, LaneSurface, SolveCounts};

/// Packets of a block.
pub(super) const BLOCK: usize = 32;

/// A block of packets, and how many of them hold rays.
pub(super) struct Block {
    pub(super) packets: [LaneRays; BLOCK],
    pub(super) used: usize,
    /// Number in the batch of the first packet's first ray.
    start: usize,
    found: [LaneHits; BLOCK],
}

impl Block {
    pub(super) const EMPTY: Self =
        Self { packets: [LaneRays::EMPTY; BLOCK], used: 0, start: 0, found: [LaneHits::EMPTY; BLOCK] };

    /// The places in a batch of `count` rays at which blocks begin.
    pub(super) fn starts(count: usize) -> impl Iterator<Item = usize> {
        (0..count).step_by(BLOCK * LANES)
    }

    /// Takes the rays from `start` on; what is no ray (see [`RayBatch`]) stays out.
    pub(super) fn load(&mut self, rays: &RayBatch, start: usize) {
        self.start = start;
        self.used = (rays.len() - start).div_ceil(LANES).min(BLOCK);
        for (packet, start) in self.packets[..self.used].iter_mut().zip((start..).step_by(LANES)) {
            for axis in 0..3 {
                packet.origin[axis] = sixteen(&rays.origin[axis], start);
                packet.direction[axis] = sixteen(&rays.direction[axis], start);
            }
            packet.tnear = sixteen(&rays.tnear, start);
            packet.tfar = sixteen(&rays.tfar, start);
            packet.tolerance = sixteen(&rays.tolerance, start);
            packet.tolerance_growth = rays.tolerance_growth;
            packet.active = packet.sound();
        }
    }

    /// Asks a surface for the first hits of the active lanes; nearer ones than `hits` holds take their place. Of two
    /// surfaces in one place, the first asked stays.
    pub(super) fn closest(
        &mut self,
        part: u32,
        surface: &dyn LaneSurface,
        hits: &mut HitBatch,
        counts: &mut SolveCounts,
    ) {
        let used = self.used;
        surface.closest_stream(&self.packets[..used], &mut self.found[..used], counts);
        for (index, (packet, found)) in self.packets[..used].iter_mut().zip(&self.found).enumerate() {
            let at = self.start + index * LANES;
            if found.gave_up != 0 {
                put(&mut hits.gave_up, at, found.gave_up, |_| true);
            }
            let mut nearer = found.hit;
            for lane in 0..LANES {
                let before = hits.t.get(at + lane).copied().unwrap_or(f32::INFINITY);
                nearer &= !(u16::from(found.t[lane] >= before) << lane);
            }
            if nearer == 0 {
                continue;
            }
            // The rays end at their nearest hit so far.
            put(&mut packet.tfar, 0, nearer, |lane| found.t[lane]);
            put(&mut hits.t, at, nearer, |lane| found.t[lane]);
            put(&mut hits.part, at, nearer, |_| part);
            put(&mut hits.primitive, at, nearer, |lane| found.primitive[lane]);
            put(&mut hits.u, at, nearer, |lane| found.u[lane]);
            put(&mut hits.v, at, nearer, |lane| found.v[lane]);
            for axis in 0..3 {
                put(&mut hits.normal[axis], at, nearer, |lane| found.normal[axis][lane]);
            }
        }
    }

    /// Asks a surface whether it stands in the way of the active lanes; those that it does are not asked again.
    pub(super) fn occluded(&mut self, surface: &dyn LaneSurface, occluded: &mut [bool], counts: &mut SolveCounts) {
        let used = self.used;
        surface.occluded_stream(&self.packets[..used], &mut self.found[..used], counts);
        for (index, (packet, found)) in self.packets[..used].iter_mut().zip(&self.found).enumerate() {
            packet.active &= !found.hit;
            put(occluded, self.start + index * LANES, found.hit, |_| true);
        }
    }
}

/// Values from `start` on, 0 behind their end.
#[inline]
pub(super) fn sixteen(values: &[f32], start: usize) -> [f32; LANES] {
    match values[start..].first_chunk() {
        Some(whole) => *whole,
        None => {
            let mut out = [0.0; LANES];
            out[..values.len() - start].copy_from_slice(&values[start..]);
            out
        }
    }
}

/// Replaces the lanes of `lanes` in the entries from `start` on.
#[inline]
fn put<T: Copy>(to: &mut [T], start: usize, lanes: u16, value: impl Fn(usize) -> T) {
    if let Some(to) = to[start..].first_chunk_mut::<LANES>() {
        // Selecting instead of branching: the compiler turns this into blends.
        for lane in 0..LANES {
            to[lane] = if lanes >> lane & 1 != 0 { value(lane) } else { to[lane] };
        }
        return;
    }
    for (lane, to) in to[start..].iter_mut().enumerate() {
        if lanes >> lane & 1 != 0 {
            *to = value(lane);
        }
    }
}
