//! Camera, sampler, film, tiles and integrators.

pub mod observer;
