//! Two accelerators over one scene: one for the water and the bed, one for everything else; the nearer hit wins.

use super::{AccelStats, Accelerator, HitBatch, RayBatch};
use crate::surface::SolveCounts;
use crate::surface::audit::Audit;

/// Water and objects, each in an accelerator of its own. Both number their hits by the full list of parts.
pub(super) struct Pair {
    pub(super) water: Box<dyn Accelerator>,
    pub(super) objects: Box<dyn Accelerator>,
}

impl Accelerator for Pair {
    fn closest(&self, rays: &RayBatch, hits: &mut HitBatch, counts: &mut SolveCounts) {
        self.water.closest(rays, hits, counts);
        // Objects need only be looked for in front of the water. A miss has t = +inf and keeps its ray's end; a ray that
        // is none stays none, since f32::min would hide a NaN.
        let mut nearer = rays.clone();
        for (tfar, &t) in nearer.tfar.iter_mut().zip(&hits.t) {
            if t < *tfar {
                *tfar = t;
            }
        }
        let mut objects = HitBatch::default();
        self.objects.closest(&nearer, &mut objects, counts);
        for index in 0..rays.len() {
            hits.gave_up[index] |= objects.gave_up[index];
            if objects.t[index] < hits.t[index] {
                hits.t[index] = objects.t[index];
                hits.part[index] = objects.part[index];
                hits.primitive[index] = objects.primitive[index];
                hits.u[index] = objects.u[index];
                hits.v[index] = objects.v[index];
                for axis in 0..3 {
                    hits.normal[axis][index] = objects.normal[axis][index];
                }
            }
        }
    }

    fn occluded(&self, rays: &RayBatch, occluded: &mut Vec<bool>, counts: &mut SolveCounts) {
        self.water.occluded(rays, occluded, counts);
        let mut objects = Vec::new();
        self.objects.occluded(rays, &mut objects, counts);
        for (either, object) in occluded.iter_mut().zip(objects) {
            *either |= object;
        }
    }

    fn stats(&self) -> AccelStats {
        let (water, objects) = (self.water.stats(), self.objects.stats());
        AccelStats {
            name: format!("{} + {}", water.name, objects.name),
            build_seconds: water.build_seconds + objects.build_seconds,
            bytes: water.bytes + objects.bytes,
            primitives: water.primitives.into_iter().chain(objects.primitives).collect(),
        }
    }

    fn audit(&self) -> Option<Audit> {
        let mut audits = self.water.audit().into_iter().chain(self.objects.audit());
        let mut sum = audits.next()?;
        audits.for_each(|audit| sum += audit);
        Some(sum)
    }
}
