//! User geometry: a trait that is asked packets of rays, and the callbacks between it and Embree.
//!
//! Embree keeps a packet as one array per component, N lanes long (N = 1, 4, 8, 16); the views here lend those arrays as
//! slices. Lanes may come in any order or number: `id` is what the caller of the query gave each ray.

use std::ffi::c_int;

use super::bindings::{
    RTCBoundsFunctionArguments, RTCIntersectFunctionNArguments, RTCOccludedFunctionNArguments, RTCRayQueryContext,
};

/// Geometry of our own: one primitive that answers for all of itself.
///
/// A panic inside any of these ends the program: it must not travel through Embree's frames.
pub(crate) trait PacketGeometry: Send + Sync + 'static {
    /// What each query carries to the geometry and back: tolerances there, counts back.
    type Payload;
    /// Least and greatest corner of a box that holds everything; an empty one (least > greatest) is never asked.
    fn bounds(&self) -> [[f32; 3]; 2];
    /// Writes the first hit within `tnear..=tfar` of each valid lane.
    fn intersect(&self, rays: PacketRays<'_>, hits: PacketHits<'_>, payload: &mut Self::Payload);
    /// Sets `tfar` to -inf on each valid lane that hits anything within `tnear..=tfar`.
    fn occluded(&self, rays: PacketRays<'_>, payload: &mut Self::Payload);
}

/// The rays of a packet; every slice is as long as `valid`.
pub(crate) struct PacketRays<'a> {
    /// -1 for lanes that ask, 0 for lanes to leave alone.
    pub(crate) valid: &'a [i32],
    /// Origins: x, y, z.
    pub(crate) origin: [&'a [f32]; 3],
    /// Directions: x, y, z.
    pub(crate) direction: [&'a [f32]; 3],
    /// Least t.
    pub(crate) tnear: &'a [f32],
    /// Greatest t so far; written when a lane hits.
    pub(crate) tfar: &'a mut [f32],
    /// What the caller numbered the ray.
    pub(crate) id: &'a [u32],
}

/// The hits of a packet, undefined where nothing was hit yet; write all of a lane that hits.
pub(crate) struct PacketHits<'a> {
    /// Normals: x, y, z.
    pub(crate) normal: [&'a mut [f32]; 3],
    /// First coordinate.
    pub(crate) u: &'a mut [f32],
    /// Second coordinate.
    pub(crate) v: &'a mut [f32],
    /// Primitive, as we number them.
    pub(crate) primitive: &'a mut [u32],
    /// Geometry: write `own_geometry`.
    pub(crate) geometry: &'a mut [u32],
    /// Instance: write `own_instance[0]`.
    pub(crate) instance: &'a mut [u32],
    /// Primitive of an instance array: write `own_instance[1]`.
    pub(crate) instance_primitive: &'a mut [u32],
    /// What to write into `geometry`.
    pub(crate) own_geometry: u32,
    /// What to write into `instance` and `instance_primitive`.
    pub(crate) own_instance: [u32; 2],
}

/// Embree's query context with ours behind it: Embree hands the pointer through to the callbacks.
#[repr(C)]
pub(super) struct Context<P> {
    pub(super) embree: RTCRayQueryContext,
    pub(super) payload: *mut P,
}

impl<P> Context<P> {
    pub(super) fn new(payload: &mut P) -> Self {
        Self { embree: RTCRayQueryContext { instID: [u32::MAX], instPrimID: [u32::MAX] }, payload }
    }
}

/// The arrays of a packet's rays, from Embree's N-lane block (`rtcore_ray.h`: component k of lane i is at k N + i).
///
/// # Safety
/// `valid` points to `lanes` integers and `base` to at least 12 `lanes` four-byte values, both exclusively ours for `'a`.
unsafe fn rays<'a>(valid: *mut c_int, base: *mut f32, lanes: usize) -> PacketRays<'a> {
    // SAFETY: the caller's promise; arrays are disjoint. Any bits are a valid f32, u32 or i32.
    unsafe {
        let read = |component: usize| std::slice::from_raw_parts(base.add(component * lanes).cast_const(), lanes);
        PacketRays {
            valid: std::slice::from_raw_parts(valid, lanes),
            origin: [read(0), read(1), read(2)],
            tnear: read(3),
            direction: [read(4), read(5), read(6)],
            tfar: std::slice::from_raw_parts_mut(base.add(8 * lanes), lanes),
            id: std::slice::from_raw_parts(base.add(10 * lanes).cast::<u32>(), lanes),
        }
    }
}

/// Embree asks for the box of the one primitive.
pub(super) unsafe extern "C" fn bounds_callback<G: PacketGeometry>(arguments: *const RTCBoundsFunctionArguments) {
    // SAFETY: Embree passes its own arguments, alive for this call.
    let arguments = unsafe { &*arguments };
    // SAFETY: the user pointer is the geometry that `SceneBuilder` keeps alive as long as the scene.
    let geometry = unsafe { &*arguments.geometryUserPtr.cast_const().cast::<G>() };
    let [least, greatest] = geometry.bounds();
    // SAFETY: Embree lends the box for this call.
    let bounds = unsafe { &mut *arguments.bounds_o };
    [bounds.lower_x, bounds.lower_y, bounds.lower_z] = least;
    [bounds.upper_x, bounds.upper_y, bounds.upper_z] = greatest;
}

/// Embree asks for hits.
pub(super) unsafe extern "C" fn intersect_callback<G: PacketGeometry>(
    arguments: *const RTCIntersectFunctionNArguments,
) {
    // SAFETY: Embree passes its own arguments, alive for this call.
    let arguments = unsafe { &*arguments };
    // SAFETY: as in `bounds_callback`.
    let geometry = unsafe { &*arguments.geometryUserPtr.cast_const().cast::<G>() };
    // SAFETY: every query goes through `CommittedScene<G::Payload>`, which passes a `Context<G::Payload>`; one thread
    // runs the query and its callbacks, one after the other, and holds no other reference to the payload meanwhile.
    let context = unsafe { &*arguments.context.cast_const().cast::<Context<G::Payload>>() };
    // SAFETY: as above.
    let payload = unsafe { &mut *context.payload };
    let lanes = arguments.N as usize;
    let base = arguments.rayhit.cast::<f32>();
    // SAFETY: Embree lends `N` lanes of rays, then `N` lanes of hits (9 components), exclusively for this call.
    let (rays, hits) = unsafe {
        let floats = |component: usize| std::slice::from_raw_parts_mut(base.add((12 + component) * lanes), lanes);
        let integers =
            |component: usize| std::slice::from_raw_parts_mut(base.add((12 + component) * lanes).cast::<u32>(), lanes);
        let hits = PacketHits {
            normal: [floats(0), floats(1), floats(2)],
            u: floats(3),
            v: floats(4),
            primitive: integers(5),
            geometry: integers(6),
            instance: integers(7),
            instance_primitive: integers(8),
            own_geometry: arguments.geomID,
            own_instance: [context.embree.instID[0], context.embree.instPrimID[0]],
        };
        (rays(arguments.valid, base, lanes), hits)
    };
    geometry.intersect(rays, hits, payload);
}

/// Embree asks for occlusion.
pub(super) unsafe extern "C" fn occluded_callback<G: PacketGeometry>(arguments: *const RTCOccludedFunctionNArguments) {
    // SAFETY: Embree passes its own arguments, alive for this call.
    let arguments = unsafe { &*arguments };
    // SAFETY: as in `bounds_callback`.
    let geometry = unsafe { &*arguments.geometryUserPtr.cast_const().cast::<G>() };
    // SAFETY: as in `intersect_callback`.
    let context = unsafe { &*arguments.context.cast_const().cast::<Context<G::Payload>>() };
    // SAFETY: as in `intersect_callback`.
    let payload = unsafe { &mut *context.payload };
    // SAFETY: Embree lends `N` lanes of rays exclusively for this call.
    let rays = unsafe { rays(arguments.valid, arguments.ray.cast::<f32>(), arguments.N as usize) };
    geometry.occluded(rays, payload);
}
