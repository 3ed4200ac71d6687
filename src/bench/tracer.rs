//! Whatever answers rays, asked the same way: accelerators behind the seam, Embree a ray a call, and splines by themselves.
//!
//! Here is no timing and no judging.

use std::sync::Arc;

use crate::accel::embree::EmbreeAccel;
use crate::accel::{Accelerator, HitBatch, RayBatch, Stream};
use crate::surface::{LANES, LaneHits, LaneRays, LaneSurface, SingleAnswer, SingleRay, SolveCounts, SplineSurface};

/// Something that answers rays.
pub enum Tracer {
    /// An accelerator as the renderer asks it.
    Seam(Box<dyn Accelerator>),
    /// Embree, 16 rays a call.
    Packets(Arc<EmbreeAccel>),
    /// Embree, one ray a call.
    Singles(Arc<EmbreeAccel>),
    /// A spline without Embree, packet by packet.
    Walk(Arc<SplineSurface>),
    /// The same, a ray at a time.
    One(Arc<SplineSurface>),
}

/// Answers of one batch; which of the two fields holds depends on what was asked.
#[derive(Debug, Default)]
pub struct Answers {
    /// Nearest hits.
    pub hits: HitBatch,
    /// Whether anything was hit.
    pub occluded: Vec<bool>,
}

impl Tracer {
    /// A spline without Embree, as the renderer asks it.
    pub fn stream(surface: &Arc<SplineSurface>) -> Self {
        Self::Seam(Box::new(Stream::alone(surface.clone())))
    }

    /// Whether it takes many rays a call.
    pub fn batch(&self) -> bool {
        !matches!(self, Self::Singles(_) | Self::One(_))
    }

    /// Answers a batch: nearest hits, or with `any` whether there is one.
    pub fn trace(&self, any: bool, rays: &RayBatch, answers: &mut Answers, counts: &mut SolveCounts) {
        let Answers { hits, occluded } = answers;
        match (self, any) {
            (Self::Seam(accel), false) => accel.closest(rays, hits, counts),
            (Self::Seam(accel), true) => accel.occluded(rays, occluded, counts),
            (Self::Packets(embree), false) => embree.closest(rays, hits, counts),
            (Self::Packets(embree), true) => embree.occluded(rays, occluded, counts),
            (Self::Singles(embree), false) => embree.closest_single(rays, hits, counts),
            (Self::Singles(embree), true) => embree.occluded_single(rays, occluded, counts),
            (Self::Walk(surface), _) => walk(surface, any, rays, answers, counts),
            (Self::One(surface), _) => one_by_one(surface, any, rays, answers, counts),
        }
    }
}

/// Rays from `start` on as a packet.
fn load(packet: &mut LaneRays, rays: &RayBatch, start: usize) {
    let count = LANES.min(rays.len() - start);
    for axis in 0..3 {
        packet.origin[axis][..count].copy_from_slice(&rays.origin[axis][start..start + count]);
        packet.direction[axis][..count].copy_from_slice(&rays.direction[axis][start..start + count]);
    }
    packet.tnear[..count].copy_from_slice(&rays.tnear[start..start + count]);
    packet.tfar[..count].copy_from_slice(&rays.tfar[start..start + count]);
    packet.tolerance[..count].copy_from_slice(&rays.tolerance[start..start + count]);
    packet.tolerance_growth = rays.tolerance_growth;
    packet.active = (u32::MAX >> (32 - count)) as u16;
}

fn reset(answers: &mut Answers, any: bool, count: usize) {
    if any {
        answers.occluded.clear();
        answers.occluded.resize(count, false);
    } else {
        answers.hits.reset(count);
    }
}

/// Writes down a packet's hits from `start` on.
fn store(hits: &mut HitBatch, start: usize, found: &LaneHits) {
    for lane in (0..LANES).filter(|lane| found.hit >> lane & 1 == 1) {
        hits.t[start + lane] = found.t[lane];
        hits.part[start + lane] = 0;
    }
}

fn walk(surface: &SplineSurface, any: bool, rays: &RayBatch, answers: &mut Answers, counts: &mut SolveCounts) {
    reset(answers, any, rays.len());
    let mut packet = LaneRays::EMPTY;
    let mut found = LaneHits::EMPTY;
    for start in (0..rays.len()).step_by(LANES) {
        load(&mut packet, rays, start);
        if any {
            let answer = surface.occluded(&packet, counts);
            for lane in 0..LANES.min(rays.len() - start) {
                answers.occluded[start + lane] = answer >> lane & 1 == 1;
            }
        } else {
            surface.closest(&packet, &mut found, counts);
            store(&mut answers.hits, start, &found);
        }
    }
}

fn one_by_one(surface: &SplineSurface, any: bool, rays: &RayBatch, answers: &mut Answers, counts: &mut SolveCounts) {
    reset(answers, any, rays.len());
    for index in 0..rays.len() {
        let ray = SingleRay {
            origin: rays.origin(index).to_array(),
            direction: rays.direction(index).to_array(),
            range: [rays.tnear[index], rays.tfar[index]],
            tolerance: rays.tolerance[index],
            tolerance_growth: rays.tolerance_growth,
        };
        match surface.single(&ray, any, counts) {
            SingleAnswer::Hit(_) if any => answers.occluded[index] = true,
            SingleAnswer::Hit(hit) => {
                answers.hits.t[index] = hit.t;
                answers.hits.part[index] = 0;
            }
            SingleAnswer::Miss | SingleAnswer::GaveUp => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accel::{Geometry, NO_PART};
    use crate::bench::work::{self, RayClass};
    use crate::scene::SolverKind;
    use crate::simd::SimdLevel;

    #[test]
    fn every_way_to_ask_a_spline_gives_the_same_answers() {
        let lattice = work::surface([40, 40], 3).unwrap();
        let surface = Arc::new(SplineSurface::new(lattice, SolverKind::Univariate, SimdLevel::detect()));
        let embree = Arc::new(EmbreeAccel::new(&[(0, Geometry::Lanes(surface.clone()))]).unwrap());
        let rays = work::rays(RayClass::Incoherent, &surface, 1004.5e-6);
        assert!(rays.len() == 1005, "a block that is not full");
        let ask = |tracer: Tracer| {
            let mut answers = Answers::default();
            tracer.trace(false, &rays, &mut answers, &mut SolveCounts::default());
            tracer.trace(true, &rays, &mut answers, &mut SolveCounts::default());
            answers
        };
        let expected = ask(Tracer::Packets(embree.clone()));
        assert!(expected.hits.part.iter().filter(|&&part| part != NO_PART).count() > 100);
        for tracer in
            [Tracer::Singles(embree), Tracer::Walk(surface.clone()), Tracer::stream(&surface), Tracer::One(surface)]
        {
            let found = ask(tracer);
            assert_eq!(found.hits.part, expected.hits.part);
            assert_eq!(found.occluded, expected.occluded);
            for (t, exact) in found.hits.t.iter().zip(&expected.hits.t) {
                assert!(t == exact || (t - exact).abs() < 1e-4, "{t} {exact}");
            }
        }
    }
}
