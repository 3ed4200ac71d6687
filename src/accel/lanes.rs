//! A surface as user geometry of Embree.
//!
//! Embree's tree finds out who reaches the surface's box. For batches the callback only notes them, and the surface is asked
//! for many packets at once; for a query of its own ray it solves. Embree may ask with fewer lanes than the query has
//! (narrower machines, single rays); a ray's `id` says which of the query's lanes it is.

use std::sync::Arc;

use crate::ffi::embree::{PacketGeometry, PacketHits, PacketRays};
use crate::surface::{LANES, LaneSurface, SingleAnswer, SingleRay, SolveCounts};

/// What a query carries to surfaces and back; lanes are numbered by ray id.
pub(super) struct LanePayload {
    /// Bit per lane that has reached a surface's box, for each surface. Where there are as many as surfaces, that is all
    /// that callbacks note; where there are none, they solve.
    pub(super) reached: Vec<u16>,
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
    /// Callbacks solve at once.
    pub(super) const SOLVING: Self = Self {
        reached: Vec::new(),
        tolerance: [0.0; LANES],
        tolerance_growth: 0.0,
        counts: SolveCounts { patches: 0, iterations: 0, gave_up: 0 },
        gave_up: 0,
    };

    /// Callbacks note who came.
    pub(super) fn deferring(surfaces: usize) -> Self {
        Self { reached: vec![0; surfaces], ..Self::SOLVING }
    }
}

/// The lanes' numbers in the query's order.
pub(super) const IDENTITY: [u32; LANES] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15];

/// A surface behind Embree's callbacks.
pub(super) struct LaneGeometry {
    /// Its place among the scene's surfaces.
    pub(super) number: usize,
    pub(super) surface: Arc<dyn LaneSurface>,
}

impl LaneGeometry {
    /// Notes the lanes that came; false if the query wants them solved at once.
    #[inline]
    fn note(&self, rays: &PacketRays<'_>, payload: &mut LanePayload) -> bool {
        let Some(reached) = payload.reached.get_mut(self.number) else { return false };
        for (&valid, &id) in rays.valid.iter().zip(rays.id) {
            *reached |= u16::from(valid < 0) << (id as usize % LANES);
        }
        true
    }
}

/// A lane of Embree's as a ray of ours.
#[inline]
fn ray(rays: &PacketRays<'_>, lane: usize, payload: &LanePayload) -> SingleRay {
    SingleRay {
        origin: rays.origin.map(|axis| axis[lane]),
        direction: rays.direction.map(|axis| axis[lane]),
        range: [rays.tnear[lane], rays.tfar[lane]],
        tolerance: payload.tolerance[rays.id[lane] as usize % LANES],
        tolerance_growth: payload.tolerance_growth,
    }
}

impl PacketGeometry for LaneGeometry {
    type Payload = LanePayload;

    fn bounds(&self) -> [[f32; 3]; 2] {
        self.surface.bounds().map(Into::into)
    }

    fn intersect(&self, rays: PacketRays<'_>, hits: PacketHits<'_>, payload: &mut LanePayload) {
        if self.note(&rays, payload) {
            return;
        }
        for lane in (0..rays.valid.len()).filter(|&lane| rays.valid[lane] < 0) {
            match self.surface.single(&ray(&rays, lane, payload), false, &mut payload.counts) {
                SingleAnswer::Hit(hit) => {
                    rays.tfar[lane] = hit.t;
                    hits.u[lane] = hit.uv[0];
                    hits.v[lane] = hit.uv[1];
                    for axis in 0..3 {
                        hits.normal[axis][lane] = hit.normal[axis];
                    }
                    hits.primitive[lane] = hit.primitive;
                    hits.geometry[lane] = hits.own_geometry;
                    hits.instance[lane] = hits.own_instance[0];
                    hits.instance_primitive[lane] = hits.own_instance[1];
                }
                SingleAnswer::Miss => {}
                SingleAnswer::GaveUp => payload.gave_up |= 1 << (rays.id[lane] as usize % LANES),
            }
        }
    }

    fn occluded(&self, rays: PacketRays<'_>, payload: &mut LanePayload) {
        if self.note(&rays, payload) {
            return;
        }
        for lane in (0..rays.valid.len()).filter(|&lane| rays.valid[lane] < 0) {
            let answer = self.surface.single(&ray(&rays, lane, payload), true, &mut payload.counts);
            if matches!(answer, SingleAnswer::Hit(_)) {
                rays.tfar[lane] = f32::NEG_INFINITY;
            }
        }
    }
}
