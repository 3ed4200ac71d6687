//! whitewater: a production ray tracer for turbulent water over natural terrain.
//!
//! Data flows one way through the rooms of this crate:
//!
//! ```text
//! files → scene → state (or sim) → surface, particles, terrain → lower → accel → render → output
//! ```
//!
//! | room | what lives there |
//! |---|---|
//! | [`math`] | intervals, Bernstein polynomials, sequences: knows nothing of water |
//! | [`simd`] | 16- and 8-lane vectors, the choice of instruction set at start |
//! | [`scene`] | the TOML file → plain data, its schema, its errors |
//! | [`images`] | skies and textures: files → linear pixels |
//! | [`state`] | `model.state`, `time###.state`, NPZ |
//! | [`foam`] | where water is white: potentials, carried with the flow, its look |
//! | [`sim`] | the simulation that makes frames: columns, pipes, spray |
//! | [`surface`] | the water and the bed as B-splines: lattice, bounds, solvers, the other representations |
//! | [`particles`] | spray: radius, colour, opacity |
//! | [`mist`] | fine spray as a medium: a sparse grid of extinction, and light's ways through it |
//! | [`terrain`] | meshes, panels, boulders, the look of the ground |
//! | [`lower`] | all of these → backend-neutral parts |
//! | [`accel`] | the accelerators behind one seam |
//! | [`optics`] | Fresnel, rough surfaces, absorption and scattering, sky, sun |
//! | [`render`] | camera, sampler, film, tiles, integrators |
//! | [`output`] | EXR, metadata, PNG/JPEG/BMP, whole files only |
//! | [`denoise`] | a finished picture without its noise |
//! | [`merge`] | parts of a picture that were rendered apart → the picture |
//! | [`mod@cli`], [`mod@bench`] | sit on top; nothing imports them |
//!
//! Frame: metres, right-handed, y up, x east, z south. Files are double precision; everything below [`lower`] is single
//! precision around a scene origin chosen there.

#[allow(unsafe_code)] // The foreign libraries: every block in it carries a SAFETY line.
#[path = "../ffi/mod.rs"]
mod ffi;
#[allow(unsafe_code)] // Vector intrinsics behind a run-time check of the processor.
pub mod simd;

pub mod accel;
pub mod bench;
pub mod cli;
pub mod denoise;
pub mod foam;
pub mod images;
pub mod lower;
pub mod math;
pub mod merge;
pub mod mist;
pub mod optics;
pub mod output;
pub mod particles;
pub mod render;
pub mod scene;
pub mod sim;
pub mod state;
pub mod surface;
pub mod terrain;
