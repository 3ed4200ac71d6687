//! Camera, sampler, film, tiles and integrators.
