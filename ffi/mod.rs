//! Foreign libraries, loaded at run time: all the unsafe code there is, but for `simd`.
//!
//! What leaves this room is safe to call; only the rooms that wrap a foreign library (accel, output) may name it.

pub(crate) mod embree;
