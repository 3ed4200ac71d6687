//! The solvers through their public interface: solver x tolerance x kind of patch, in packets of sixteen seeded rays.
//!
//! Kinds: `calm` (long, low waves: nearly plane patches), `breaking` (crests steeper than rays: several crossings), and
//! `degenerate` (flat water with one column a thousand times higher, met at grazing angles: double roots, flat boxes).
//! Rays per second of whole surfaces, with errors beside them, are `whitewater bench surface`.

use std::hint::black_box;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use glam::DVec3;
use whitewater::bench::work::Random;
use whitewater::scene::SolverKind;
use whitewater::surface::{LANES, LaneHits, LaneRays, LaneSurface, Lattice, SimdLevel, SolveCounts, SplineSurface};

/// Columns of width 1 along each axis.
const SIZE: usize = 32;
/// Packets in one measured batch.
const PACKETS: usize = 64;
/// Metres along the ray, from a coarse preview to single precision's end at this size.
const TOLERANCES: [f32; 3] = [1e-2, 1e-4, 1e-6];

#[derive(Clone, Copy)]
enum Kind {
    Calm,
    Breaking,
    Degenerate,
}

impl Kind {
    const ALL: [Self; 3] = [Self::Calm, Self::Breaking, Self::Degenerate];

    fn name(self) -> &'static str {
        match self {
            Self::Calm => "calm",
            Self::Breaking => "breaking",
            Self::Degenerate => "degenerate",
        }
    }

    fn lattice(self, order: u32) -> Lattice {
        let mut random = Random::new(11);
        let heights: Vec<f64> = (0..SIZE * SIZE)
            .map(|k| {
                let (x, z) = ((k % SIZE) as f64, (k / SIZE) as f64);
                match self {
                    Self::Calm => 0.2 * (0.31 * x + 0.17 * z).sin(),
                    Self::Breaking => 2.0 * (1.1 * x + 0.4 * z).sin() + random.within(-0.5, 0.5),
                    Self::Degenerate if (x, z) == (16.0, 16.0) => 1000.0,
                    Self::Degenerate => 1.0,
                }
            })
            .collect();
        Lattice::new(order, [SIZE; 2], [0.5; 2], [1.0; 2], &heights, |_| true).expect("a lattice of a known order")
    }

    /// A ray towards the surface, or along it.
    fn ray(self, random: &mut Random) -> (DVec3, DVec3) {
        let target = DVec3::new(random.within(2.0, 30.0), 0.0, random.within(2.0, 30.0));
        let turn = random.direction();
        match self {
            Self::Calm | Self::Breaking => {
                let direction = DVec3::new(turn.x, -0.2 - random.unit(), turn.z).normalize();
                (target - direction * 12.0, direction)
            }
            Self::Degenerate => {
                let direction = DVec3::new(turn.x, -1e-3 * random.unit(), turn.z).normalize();
                (target + DVec3::Y * 1.0 - direction * 12.0, direction)
            }
        }
    }

    fn packets(self, tolerance: f32) -> Vec<LaneRays> {
        let mut random = Random::new(12);
        let packet = |_| {
            let mut packet = LaneRays { active: u16::MAX, ..LaneRays::EMPTY };
            packet.tfar = [f32::INFINITY; LANES];
            packet.tolerance = [tolerance; LANES];
            for lane in 0..LANES {
                let (origin, direction) = self.ray(&mut random);
                for axis in 0..3 {
                    packet.origin[axis][lane] = origin[axis] as f32;
                    packet.direction[axis][lane] = direction[axis] as f32;
                }
            }
            packet
        };
        (0..PACKETS).map(packet).collect()
    }
}

/// Every solver with every instruction set that it has kernels for.
fn surfaces(kind: Kind, order: u32) -> Vec<(String, SplineSurface)> {
    let mut surfaces = Vec::new();
    for solver in SolverKind::ALL {
        let levels = match solver {
            SolverKind::Univariate => vec![SimdLevel::Avx512, SimdLevel::Avx2, SimdLevel::Portable],
            // These work a ray at a time, whatever the instruction set.
            _ => vec![SimdLevel::Portable],
        };
        for level in levels.into_iter().filter(|level| level.is_available()) {
            let name = format!("{}/{}", solver.name(), level.name());
            surfaces.push((name, SplineSurface::new(kind.lattice(order), solver, level)));
        }
    }
    surfaces
}

fn solvers(criterion: &mut Criterion) {
    for kind in Kind::ALL {
        let mut group = criterion.benchmark_group(format!("closest/{}", kind.name()));
        group.throughput(Throughput::Elements((PACKETS * LANES) as u64));
        for (name, surface) in surfaces(kind, 3) {
            for tolerance in TOLERANCES {
                let packets = kind.packets(tolerance);
                group.bench_function(BenchmarkId::new(&name, format!("{tolerance:e}")), |bencher| {
                    bencher.iter(|| {
                        let (mut hits, mut counts) = (LaneHits::EMPTY, SolveCounts::default());
                        for packet in &packets {
                            surface.closest(black_box(packet), &mut hits, &mut counts);
                            black_box(&hits);
                        }
                        counts
                    });
                });
            }
        }
        group.finish();
    }
}

/// Orders 2 to 4 of the default solver, closest and any hit.
fn orders(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("order");
    group.throughput(Throughput::Elements((PACKETS * LANES) as u64));
    let packets = Kind::Breaking.packets(1e-4);
    for order in 2..=4 {
        let surface = SplineSurface::new(Kind::Breaking.lattice(order), SolverKind::Univariate, SimdLevel::detect());
        group.bench_function(BenchmarkId::new("closest", order), |bencher| {
            bencher.iter(|| {
                let (mut hits, mut counts) = (LaneHits::EMPTY, SolveCounts::default());
                for packet in &packets {
                    surface.closest(black_box(packet), &mut hits, &mut counts);
                    black_box(&hits);
                }
                counts
            });
        });
        group.bench_function(BenchmarkId::new("occluded", order), |bencher| {
            bencher.iter(|| {
                let mut counts = SolveCounts::default();
                packets.iter().map(|packet| surface.occluded(black_box(packet), &mut counts).count_ones()).sum::<u32>()
            });
        });
    }
    group.finish();
}

criterion_group! {
    name = benches;
    // Sixteen rays take microseconds: a second's measurement per case is steady, and all cases end in minutes.
    config = Criterion::default()
        .sample_size(20)
        .warm_up_time(std::time::Duration::from_millis(200))
        .measurement_time(std::time::Duration::from_secs(1));
    targets = solvers, orders
}
criterion_main!(benches);
