//! The inner loops in time: polynomials, pyramid, walk and stream, trees over particles. The same work in counted
//! instructions is `benches/count.rs`.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use whitewater::bench::kernels;
use whitewater::surface::SimdLevel;

fn every_kernel(criterion: &mut Criterion) {
    for simd in SimdLevel::ALL.into_iter().filter(|level| level.is_available()) {
        for mut kernel in kernels::all(simd).expect("work of fixed size") {
            // Trees are the same at any instruction set.
            if kernel.name.starts_with("bsp") && simd != SimdLevel::detect() {
                continue;
            }
            let mut group = criterion.benchmark_group(kernel.name.clone());
            group.throughput(Throughput::Elements(kernel.units as u64));
            group.bench_function(simd.name(), |bencher| bencher.iter(|| kernels::counted(&mut kernel)));
            group.finish();
        }
    }
}

criterion_group! {
    name = benches;
    config = Criterion::default()
        .sample_size(20)
        .warm_up_time(std::time::Duration::from_millis(200))
        .measurement_time(std::time::Duration::from_secs(1));
    targets = every_kernel
}
criterion_main!(benches);
