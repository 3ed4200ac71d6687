//! Splines without Embree: whole batches go through the surfaces' own walk, whose lanes are refilled as rays finish.
//!
//! It serves surfaces only; everything else of the water's axis goes to the objects' accelerator.

use std::sync::Arc;
use std::time::Instant;

use super::{AccelStats, Accelerator, HitBatch, NO_PART, RayBatch};
use crate::surface::{LANES, LaneHits, LaneRays, LaneSurface, SolveCounts};

/// Packets that go through a surface at a time: what they hold stays in cache.
const BLOCK: usize = 32;

/// Surfaces with their parts' indices.
pub(super) struct Stream {
    surfaces: Vec<(u32, Arc<dyn LaneSurface>)>,
    build_seconds: f64,
}

impl Stream {
    /// Takes the surfaces as they are: their bounds were built with them.
    pub(super) fn new(surfaces: Vec<(u32, Arc<dyn LaneSurface>)>) -> Self {
        let start = Instant::now();
        Self { surfaces, build_seconds: start.elapsed().as_secs_f64() }
    }
}

/// A block of packets, and how many of them hold rays.
struct Block {
    packets: [LaneRays; BLOCK],
    used: usize,
}

impl Block {
    const EMPTY: Self = Self { packets: [LaneRays::EMPTY; BLOCK], used: 0 };

    /// Takes the rays from `start` on; what is no ray (see [`RayBatch`]) stays out.
    fn load(&mut self, rays: &RayBatch, start: usize) {
        let left = rays.len() - start;
        self.used = left.div_ceil(LANES).min(BLOCK);
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
}

/// Values from `start` on, 0 behind their end.
#[inline]
fn sixteen(values: &[f32], start: usize) -> [f32; LANES] {
    match values[start..].first_chunk() {
        Some(whole) => *whole,
        None => {
            let mut out = [0.0; LANES];
            out[..values.len() - start].copy_from_slice(&values[start..]);
            out
        }
    }
}

/// Replaces the lanes of `hit` in the entries from `start` on.
#[inline]
fn put<T: Copy>(to: &mut [T], start: usize, hit: u16, value: impl Fn(usize) -> T) {
    if let Some(to) = to[start..].first_chunk_mut::<LANES>() {
        // Selecting instead of branching: the compiler turns this into blends.
        for lane in 0..LANES {
            to[lane] = if hit >> lane & 1 != 0 { value(lane) } else { to[lane] };
        }
        return;
    }
    for (lane, to) in to[start..].iter_mut().enumerate() {
        if hit >> lane & 1 != 0 {
            *to = value(lane);
        }
    }
}

impl Accelerator for Stream {
    fn closest(&self, rays: &RayBatch, hits: &mut HitBatch, counts: &mut SolveCounts) {
        hits.reset(rays.len());
        let mut block = Block::EMPTY;
        let mut found = [LaneHits::EMPTY; BLOCK];
        for start in (0..rays.len()).step_by(BLOCK * LANES) {
            block.load(rays, start);
            for (part, surface) in &self.surfaces {
                let used = block.used;
                surface.closest_stream(&block.packets[..used], &mut found[..used], counts);
                for (index, (packet, found)) in block.packets[..used].iter_mut().zip(&found).enumerate() {
                    let at = start + index * LANES;
                    if found.gave_up != 0 {
                        put(&mut hits.gave_up, at, found.gave_up, |_| true);
                    }
                    // The rays end at their nearest hit so far; of two surfaces in one place, the first stays.
                    let mut nearer = found.hit;
                    for lane in 0..LANES {
                        let before = hits.t.get(at + lane).copied().unwrap_or(f32::INFINITY);
                        nearer &= !(u16::from(found.t[lane] >= before) << lane);
                    }
                    if nearer == 0 {
                        continue;
                    }
                    put(&mut packet.tfar, 0, nearer, |lane| found.t[lane]);
                    put(&mut hits.t, at, nearer, |lane| found.t[lane]);
                    put(&mut hits.part, at, nearer, |_| *part);
                    put(&mut hits.primitive, at, nearer, |lane| found.primitive[lane]);
                    put(&mut hits.u, at, nearer, |lane| found.u[lane]);
                    put(&mut hits.v, at, nearer, |lane| found.v[lane]);
                    for axis in 0..3 {
                        put(&mut hits.normal[axis], at, nearer, |lane| found.normal[axis][lane]);
                    }
                }
            }
        }
        debug_assert!(hits.part.iter().zip(&hits.t).all(|(&part, &t)| (part == NO_PART) == (t == f32::INFINITY)));
    }

    fn occluded(&self, rays: &RayBatch, occluded: &mut Vec<bool>, counts: &mut SolveCounts) {
        occluded.clear();
        occluded.resize(rays.len(), false);
        let mut block = Block::EMPTY;
        let mut found = [LaneHits::EMPTY; BLOCK];
        for start in (0..rays.len()).step_by(BLOCK * LANES) {
            block.load(rays, start);
            for (_, surface) in &self.surfaces {
                let used = block.used;
                surface.occluded_stream(&block.packets[..used], &mut found[..used], counts);
                for (index, (packet, found)) in block.packets[..used].iter_mut().zip(&found).enumerate() {
                    packet.active &= !found.hit;
                    put(occluded, start + index * LANES, found.hit, |_| true);
                }
            }
        }
    }

    fn stats(&self) -> AccelStats {
        AccelStats {
            name: "stream".to_owned(),
            build_seconds: self.build_seconds,
            bytes: self.surfaces.iter().map(|(_, surface)| surface.bytes()).sum(),
            primitives: vec![("surfaces".to_owned(), self.surfaces.len() as u64)],
        }
    }
}
