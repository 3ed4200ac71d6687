//! Every solver on every instruction set against the referee.

use glam::{DVec3, Vec3};

use super::*;
use crate::scene::SolverKind;
use crate::simd::SimdLevel;

/// A seeded sequence of numbers in 0..1.
pub(super) struct Random(pub u64);
impl Random {
    pub(super) fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        (z ^ z >> 31) as f64 / (u64::MAX as f64 + 1.0)
    }
    fn within(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.next()
    }
}

/// Waves with noise, partly dry where asked: a column is absent where the noise says so.
fn waves(order: u32, n: usize, dry: bool, seed: u64) -> Lattice {
    let mut random = Random(seed);
    let present: Vec<bool> = (0..n * n).map(|_| !dry || random.next() > 0.3).collect();
    let heights: Vec<f64> = (0..n * n)
        .map(|k| {
            let (x, z) = ((k % n) as f64, (k / n) as f64);
            1.5 * (0.3 * x + 0.2 * z).sin() + 0.5 * (0.9 * x - 0.4 * z).cos() + random.within(-0.3, 0.3)
        })
        .collect();
    Lattice::new(order, [n, n], [0.5, 0.5], [1.0, 1.0], &heights, |k| present[k]).unwrap()
}

struct Tally {
    rays: usize,
    hits: usize,
    lost: usize,
    false_hits: usize,
    wrong: usize,
    tangent: usize,
    gave_up: u64,
}

/// Traces rays (rounded to single precision) and compares with the referee as DESIGN section 3 defines the errors.
fn compare(surface: &SplineSurface, rays: &[(Vec3, Vec3)]) -> Tally {
    let lattice = surface.lattice();
    let mut tally = Tally { rays: rays.len(), hits: 0, lost: 0, false_hits: 0, wrong: 0, tangent: 0, gave_up: 0 };
    let mut counts = SolveCounts::default();
    for packet in rays.chunks(LANES) {
        let mut lanes = LaneRays::EMPTY;
        for (lane, (origin, direction)) in packet.iter().enumerate() {
            for axis in 0..3 {
                lanes.origin[axis][lane] = origin[axis];
                lanes.direction[axis][lane] = direction[axis];
            }
            lanes.tfar[lane] = f32::INFINITY;
            lanes.tolerance[lane] = 1e-6;
            lanes.active |= 1 << lane;
        }
        let mut hits = LaneHits::EMPTY;
        surface.closest(&lanes, &mut hits, &mut counts);
        let any = surface.occluded(&lanes, &mut counts);
        for (lane, (origin, direction)) in packet.iter().enumerate() {
            let (origin, direction) = (origin.as_dvec3(), direction.as_dvec3());
            let exact = referee::first_hit(lattice, origin, direction, [0.0, f64::INFINITY]);
            let ours = (hits.hit >> lane & 1 == 1).then(|| f64::from(hits.t[lane]));
            let tangent = |from: f64, to: f64| {
                let (from, to) = (from.min(to), from.max(to));
                let slack = 1e-3 / direction.length();
                referee::stays_within(lattice, origin, direction, [(from - slack).max(0.0), to + slack], 1e-4)
            };
            let grazes = |t: f64| {
                let slack = 0.05 / direction.length();
                referee::closest_approach(lattice, origin, direction, [(t - slack).max(0.0), t + slack]) < 1e-5
            };
            assert_eq!(any >> lane & 1 == 1, ours.is_some(), "any-hit and first-hit must agree");
            match (exact, ours) {
                (None, None) => {}
                (Some(exact), None) if exact.touch || tangent(exact.t, exact.t) => tally.tangent += 1,
                (Some(_), None) => tally.lost += 1,
                (None, Some(t)) if grazes(t) => tally.tangent += 1,
                (None, Some(_)) => tally.false_hits += 1,
                (Some(exact), Some(t)) => {
                    tally.hits += 1;
                    let (cell, uv) = (exact.patch as usize, exact.uv);
                    let (_, slope) = lattice.evaluate(cell % lattice.cells[0], cell / lattice.cells[0], uv[0], uv[1]);
                    let normal = DVec3::new(-slope[0], 1.0, -slope[1]).normalize();
                    let cosine = normal.dot(direction.normalize()).abs().max(0.02);
                    if (t - exact.t).abs() * direction.length() > 1e-4 / cosine {
                        if tangent(exact.t, t) || grazes(t.min(exact.t)) {
                            tally.tangent += 1;
                        } else {
                            tally.wrong += 1;
                        }
                    }
                }
            }
        }
    }
    tally.gave_up = counts.gave_up;
    tally
}

/// Rays of every kind over an n x n surface.
fn rays(n: usize, count: usize, seed: u64) -> Vec<(Vec3, Vec3)> {
    let mut random = Random(seed);
    let size = n as f64;
    (0..count)
        .map(|k| {
            let x = random.within(0.0, size);
            let z = random.within(0.0, size);
            let sphere = |random: &mut Random| {
                let (y, turn) = (random.within(-1.0, 1.0), random.within(0.0, std::f64::consts::TAU));
                let r = (1.0 - y * y).sqrt();
                DVec3::new(r * turn.cos(), y, r * turn.sin())
            };
            let (origin, direction) = match k % 8 {
                0 => (DVec3::new(size / 2.0, 8.0, -5.0), DVec3::new(x, 0.0, z) - DVec3::new(size / 2.0, 8.0, -5.0)),
                1 => (DVec3::new(x, random.within(-6.0, 6.0), z), sphere(&mut random)),
                // Grazing.
                2 => (DVec3::new(x, random.within(1.0, 2.5), z), {
                    let mut d = sphere(&mut random);
                    d.y *= 0.02;
                    d
                }),
                // Plumb, through borders and corners of columns.
                3 => (DVec3::new(x.floor(), 5.0, z.floor()), DVec3::NEG_Y),
                4 => (DVec3::new(x.floor(), 5.0, z), DVec3::NEG_Y),
                // Along the axes.
                5 => (DVec3::new(-3.0, random.within(-2.0, 2.0), z), DVec3::X),
                6 => (DVec3::new(x.floor() + 0.5, random.within(-2.0, 2.0), size + 4.0), DVec3::NEG_Z * 3.0),
                // From afar, through corners.
                _ => {
                    let target = DVec3::new(x.floor(), 0.0, z.floor());
                    let from = sphere(&mut random) * 300.0;
                    (target + from, -from / 300.0)
                }
            };
            (origin.as_vec3(), direction.as_vec3())
        })
        .collect()
}

#[test]
fn no_ray_is_lost_false_or_wrong() {
    for order in 2..=4 {
        for dry in [false, true] {
            let lattice = waves(order, 40, dry, 7 + u64::from(order));
            let rays = rays(40, 16_000, 99);
            for (solver, level) in SimdLevel::ALL
                .into_iter()
                .map(|level| (SolverKind::Univariate, level))
                .chain([(SolverKind::Newton, SimdLevel::Portable), (SolverKind::Reference, SimdLevel::Portable)])
            {
                let surface = SplineSurface::new(lattice.clone(), solver, level);
                let tally = compare(&surface, &rays);
                let what = format!("{} {} order {order} dry {dry}", solver.name(), level.name());
                assert!(tally.hits > tally.rays / 4, "{what}: {} hits", tally.hits);
                assert_eq!((tally.lost, tally.false_hits, tally.wrong), (0, 0, 0), "{what}");
                assert!(tally.tangent <= tally.rays / 200, "{what}: {} tangent", tally.tangent);
                assert!(tally.gave_up <= tally.rays as u64 / 1000, "{what}: {} gave up", tally.gave_up);
            }
        }
    }
}
