//! Embree 4 as safe types: device, scene under construction, committed scene, user geometry, packets of 16 rays.
//!
//! The library is found and loaded at run time ([`loader`]); the bindings are made by bindgen from the 4.3.3 headers and
//! checked in (`make bindings`). Nothing here knows of water, parts or batches: that is `accel::embree`.
//!
//! Floating-point control: Embree's manual recommends flush-to-zero and denormals-are-zero in MXCSR for speed. Neither is
//! set: the same bits are promised whatever ran before on a thread, and other code on it expects IEEE arithmetic.

#[allow(
    missing_docs,
    dead_code,
    non_camel_case_types,
    non_snake_case,
    non_upper_case_globals,
    unreachable_pub,
    clippy::undocumented_unsafe_blocks,
    clippy::upper_case_acronyms,
    reason = "made by bindgen from C headers: the names are Embree's and the whole interface is there"
)]
mod bindings;
mod device;
mod error;
mod loader;
mod packet;
mod scene;

pub(crate) use bindings::{RTCRay as Ray, RTCRay16 as Ray16, RTCRayHit as RayHit, RTCRayHit16 as RayHit16};
pub(crate) use device::Device;
pub use error::EmbreeError;
pub(crate) use packet::{PacketGeometry, PacketHits, PacketRays};
pub(crate) use scene::{CommittedScene, SceneBuilder, Valid16};

/// What Embree writes into a hit for "nothing".
pub(crate) const INVALID_GEOMETRY: u32 = u32::MAX;

// Embree 4.2 and older write past (or short of) these; bindings made from the wrong headers must not compile.
const _: () = {
    assert!(size_of::<bindings::RTCRayHit>() == 96 && align_of::<bindings::RTCRayHit>() == 16);
    assert!(size_of::<bindings::RTCRayHit16>() == 1344 && align_of::<bindings::RTCRayHit16>() == 64);
    assert!(size_of::<bindings::RTCRay16>() == 768 && align_of::<bindings::RTCRay16>() == 64);
    assert!(size_of::<bindings::RTCRayQueryContext>() == 8);
    assert!(size_of::<bindings::RTCIntersectArguments>() == 32);
    assert!(size_of::<bindings::RTCOccludedArguments>() == 32);
};

#[cfg(all(test, feature = "regen"))]
mod tests {
    #[test]
    fn checked_in_bindings_are_what_bindgen_makes() {
        let made = include_str!(concat!(env!("OUT_DIR"), "/embree_bindings.rs"));
        let checked_in = include_str!("bindings.rs");
        let difference = made.lines().zip(checked_in.lines()).position(|(new, old)| new != old);
        assert!(made == checked_in, "ffi/embree/bindings.rs is stale from line {difference:?} on: run `make bindings`");
    }
}
