//! A surface that answers sixteen lanes, as user geometry of Embree.
//!
//! This is the hot seam: for a whole packet it is a handful of fixed-size copies each way. Embree may also ask with fewer
//! lanes (narrower machines, single rays); a ray's `id` then says which of the query's lanes it is.

use std::sync::Arc;

use crate::ffi::embree::{PacketGeometry, PacketHits, PacketRays};
use crate::surface::{LANES, LaneHits, LaneRays, LaneSurface, SolveCounts};

/// What a query carries to surfaces and back; lanes are numbered by ray id.
pub(super) struct LanePayload {
    /// Tolerance of each lane, in t.
    pub(super) tolerance: [f32; LANES],
    /// Growth of the tolerance per unit of t.
    pub(super) tolerance_growth: f32,
    /// The solvers' work.
    pub(super) counts: SolveCounts,
    /// Bit per lane that a solver could not decide.
    pub(super) gave_up: u16,
}

impl LanePayload {
    pub(super) const EMPTY: Self = Self {
        tolerance: [0.0; LANES],
        tolerance_growth: 0.0,
        counts: SolveCounts { patches: 0, iterations: 0, gave_up: 0 },
        gave_up: 0,
    };
}

/// The lanes' numbers in the query's order.
pub(super) const IDENTITY: [u32; LANES] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15];

/// A surface behind Embree's callbacks.
pub(super) struct LaneGeometry(pub(super) Arc<dyn LaneSurface>);

/// Copies up to 16 values; the rest stays 0.
#[inline]
fn sixteen<T: Copy + Default>(values: &[T]) -> [T; LANES] {
    if let Ok(all) = values.try_into() {
        return all;
    }
    let mut out = [T::default(); LANES];
    out[..values.len()].copy_from_slice(values);
    out
}

/// Embree's packet as ours.
#[inline]
fn take(rays: &PacketRays<'_>, payload: &LanePayload) -> LaneRays {
    let valid = sixteen(rays.valid);
    let mut active = 0;
    for lane in 0..LANES {
        active |= u16::from(valid[lane] < 0) << lane;
    }
    let id = sixteen(rays.id);
    let tolerance = if id == IDENTITY {
        payload.tolerance
    } else {
        // An invalid lane's id may be anything: the mask keeps the lookup in range, and nobody reads the result.
        id.map(|id| payload.tolerance[id as usize % LANES])
    };
    LaneRays {
        origin: rays.origin.map(sixteen),
        direction: rays.direction.map(sixteen),
        tnear: sixteen(rays.tnear),
        tfar: sixteen(rays.tfar),
        tolerance,
        tolerance_growth: payload.tolerance_growth,
        active,
    }
}

/// Replaces the lanes whose bit is set.
#[inline]
fn put<T: Copy>(to: &mut [T], from: &[T; LANES], lanes: u16) {
    if let Ok(to) = <&mut [T; LANES]>::try_from(&mut *to) {
        // Selecting instead of branching: the compiler turns this into blends.
        for lane in 0..LANES {
            to[lane] = if lanes >> lane & 1 != 0 { from[lane] } else { to[lane] };
        }
        return;
    }
    for (lane, to) in to.iter_mut().enumerate() {
        if lanes >> lane & 1 != 0 {
            *to = from[lane];
        }
    }
}

impl PacketGeometry for LaneGeometry {
    type Payload = LanePayload;

    fn bounds(&self) -> [[f32; 3]; 2] {
        self.0.bounds().map(Into::into)
    }

    fn intersect(&self, rays: PacketRays<'_>, hits: PacketHits<'_>, payload: &mut LanePayload) {
        let packet = take(&rays, payload);
        let mut found = LaneHits::EMPTY;
        self.0.closest(&packet, &mut found, &mut payload.counts);
        let gave_up = found.gave_up & packet.active;
        if gave_up != 0 {
            for (lane, &id) in rays.id.iter().enumerate() {
                payload.gave_up |= (gave_up >> lane & 1) << (id as usize % LANES);
            }
        }
        let hit = found.hit & packet.active;
        if hit == 0 {
            return;
        }
        put(rays.tfar, &found.t, hit);
        put(hits.u, &found.u, hit);
        put(hits.v, &found.v, hit);
        for axis in 0..3 {
            put(hits.normal[axis], &found.normal[axis], hit);
        }
        put(hits.primitive, &found.primitive, hit);
        put(hits.geometry, &[hits.own_geometry; LANES], hit);
        put(hits.instance, &[hits.own_instance[0]; LANES], hit);
        put(hits.instance_primitive, &[hits.own_instance[1]; LANES], hit);
    }

    fn occluded(&self, rays: PacketRays<'_>, payload: &mut LanePayload) {
        let packet = take(&rays, payload);
        let hit = self.0.occluded(&packet, &mut payload.counts) & packet.active;
        put(rays.tfar, &[f32::NEG_INFINITY; LANES], hit);
    }
}
