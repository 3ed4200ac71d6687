//! The search for all places of the water that send a light to a point: a pool of gentle waves, by kind of event and light.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use glam::Vec3;
use whitewater::render::caustics::{Event, Manifold, ManifoldCounts, Target};
use whitewater::scene::SolverKind;
use whitewater::surface::{Lattice, SimdLevel, SplineSurface};

/// Points asked for in one turn.
const POINTS: u32 = 1000;

/// Eight metres of water in columns of 5 cm.
fn pool() -> Manifold {
    let (count, width) = (160, 0.05);
    let heights: Vec<f64> = (0..count * count)
        .map(|k| {
            let (x, z) = ((k % count) as f64 * width, (k / count) as f64 * width);
            0.015 * (6.0 * x + 2.0 * z).sin() + 0.012 * (7.0 * z - 3.0 * x).sin() + 0.006 * (13.0 * x + 9.0 * z).sin()
        })
        .collect();
    let lattice = Lattice::new(3, [count; 2], [-4.0; 2], [width; 2], &heights, |_| true).expect("a lattice");
    Manifold::new(&SplineSurface::new(lattice, SolverKind::Univariate, SimdLevel::detect()))
}

fn connections(criterion: &mut Criterion) {
    let manifold = pool();
    let sun = Target::Direction(Vec3::new(0.3, 0.8, 0.2).normalize());
    let lamp = Target::Point(Vec3::new(1.0, 2.5, 0.5));
    let mut group = criterion.benchmark_group("connect");
    group.throughput(Throughput::Elements(u64::from(POINTS)));
    for (name, event, target, height) in [
        ("sun through", Event::Refraction, sun, -1.5),
        ("lamp through", Event::Refraction, lamp, -1.5),
        ("sun through, deep", Event::Refraction, sun, -5.0),
        ("sun off", Event::Reflection, sun, 1.0),
    ] {
        let (mut found, mut counts) = (Vec::new(), ManifoldCounts::default());
        group.bench_function(name, |bencher| {
            bencher.iter(|| {
                for k in 0..POINTS {
                    // Points of Kronecker's lattice over the middle of the bed.
                    let [x, z] = [0.754_877_7f32, 0.569_840_3].map(|step| (k as f32 * step).fract() * 5.0 - 2.5);
                    let from = Vec3::new(x, height, z);
                    manifold.connect(from, event, target, 1.333, [0.0; 2], 1e-4, &mut found, &mut counts);
                }
                counts
            });
        });
    }
    group.finish();
}

criterion_group! {
    name = benches;
    config = Criterion::default()
        .sample_size(20)
        .warm_up_time(std::time::Duration::from_millis(200))
        .measurement_time(std::time::Duration::from_secs(1));
    targets = connections
}
criterion_main!(benches);
