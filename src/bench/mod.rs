//! Benchmarks as part of the program.
