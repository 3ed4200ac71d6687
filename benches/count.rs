//! One inner loop under callgrind: `count LEVEL KERNEL` runs it once, without names it lists what there is. `make count`
//! runs all of them and prints instructions per unit.
//!
//! Counted, not timed: the same on every machine of one kind, busy or not, to about one in a thousand.

use whitewater::bench::kernels;
use whitewater::surface::SimdLevel;

#[allow(clippy::print_stdout, reason = "the list is what it is asked for")]
fn main() {
    // Cargo may add `--bench`.
    let arguments: Vec<String> = std::env::args().skip(1).filter(|word| word != "--bench").collect();
    let level = |name: &str| SimdLevel::ALL.into_iter().find(|level| level.name() == name);
    let simd = arguments.first().and_then(|name| level(name)).unwrap_or(SimdLevel::Portable);
    // One thread, this work on it: callgrind collects a thread at a time.
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
    pool.install(|| {
        let mut all = kernels::all(simd).expect("work of fixed size");
        match arguments.get(1) {
            None => {
                for kernel in &all {
                    println!("{} {} {}", kernel.name, kernel.units, kernel.unit);
                }
            }
            Some(name) => {
                let kernel = all.iter_mut().find(|kernel| kernel.name == *name).expect("a kernel of that name");
                kernels::counted(kernel);
            }
        }
    });
}
