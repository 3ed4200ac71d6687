//! Building and tracing as two types: [`SceneBuilder`] takes geometry, [`CommittedScene`] answers rays from any thread.

use std::any::Any;
use std::ffi::c_void;
use std::marker::PhantomData;
use std::sync::Arc;

use glam::Vec3;

use super::EmbreeError;
use super::bindings::{
    RTCBufferType, RTCBuildQuality, RTCFeatureFlags, RTCFormat, RTCGeometry, RTCGeometryType, RTCIntersectArguments,
    RTCOccludedArguments, RTCRay, RTCRay4, RTCRay8, RTCRay16, RTCRayHit, RTCRayHit4, RTCRayHit8, RTCRayHit16,
    RTCRayQueryFlags, RTCScene, RTCSceneFlags, RTCSubdivisionMode,
};
use super::device::{Device, PacketWidth};
use super::packet::{Context, PacketGeometry, bounds_callback, intersect_callback, occluded_callback};

/// Which of 16 lanes hold a ray: -1 or 0 each.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(crate) struct Valid16(pub(crate) [i32; 16]);

/// A scene that takes geometry. `P` is what each query carries to user geometry.
pub(crate) struct SceneBuilder<P> {
    scene: Scene<P>,
}

/// A scene that answers rays; clones share it.
pub(crate) struct CommittedScene<P> {
    scene: Arc<Scene<P>>,
    rays: RTCRayQueryFlags,
}

impl<P> Clone for CommittedScene<P> {
    fn clone(&self) -> Self {
        Self { scene: Arc::clone(&self.scene), rays: self.rays }
    }
}

/// The handle and everything that Embree points to from it.
struct Scene<P> {
    device: Device,
    handle: RTCScene,
    /// User geometry, at the addresses that Embree has.
    kept: Vec<Arc<dyn Any + Send + Sync>>,
    payload: PhantomData<fn(&mut P)>,
}

// SAFETY: Embree's handles may be used from any thread; what is kept is `Send + Sync`. While building, only the one
// owner calls; after the commit, queries are read-only and Embree allows them from many threads at once.
unsafe impl<P> Send for Scene<P> {}
// SAFETY: as above; a `SceneBuilder` has no `&self` method that changes the scene.
unsafe impl<P> Sync for Scene<P> {}

impl<P> Drop for Scene<P> {
    fn drop(&mut self) {
        // SAFETY: our one reference. Geometries go with the scene; what they point to (`kept`) is dropped after this.
        unsafe { self.device.embree().rtcReleaseScene(self.handle) }
    }
}

impl<P: 'static> SceneBuilder<P> {
    /// An empty scene of high build quality, with watertight (robust) traversal.
    pub(crate) fn new(device: &Device) -> Result<Self, EmbreeError> {
        let embree = device.embree();
        // SAFETY: the device lives.
        let handle = unsafe { embree.rtcNewScene(device.handle()) };
        device.check("rtcNewScene")?;
        let scene = Scene { device: device.clone(), handle, kept: Vec::new(), payload: PhantomData };
        // SAFETY: the scene lives, and is not committed.
        unsafe {
            embree.rtcSetSceneFlags(handle, RTCSceneFlags::RTC_SCENE_FLAG_ROBUST);
            embree.rtcSetSceneBuildQuality(handle, RTCBuildQuality::RTC_BUILD_QUALITY_HIGH);
        }
        device.check("rtcSetSceneBuildQuality")?;
        Ok(Self { scene })
    }

    /// Triangles; u and v of a hit are the weights of the second and third vertex.
    ///
    /// # Errors
    /// An index outside the vertices.
    pub(crate) fn triangles(&mut self, id: u32, position: &[Vec3], index: &[[u32; 3]]) -> Result<(), EmbreeError> {
        for (triangle, corners) in index.iter().enumerate() {
            if let Some(&corner) = corners.iter().find(|&&corner| corner as usize >= position.len()) {
                return Err(EmbreeError::Geometry {
                    geometry: id,
                    what: format!("a vertex index of triangle {triangle}"),
                    value: corner.into(),
                    expected: format!("less than the count of vertices, {}", position.len()),
                });
            }
        }
        let geometry = self.geometry(id, RTCGeometryType::RTC_GEOMETRY_TYPE_TRIANGLE, index.len())?;
        let (float3, uint3) = (RTCFormat::RTC_FORMAT_FLOAT3, RTCFormat::RTC_FORMAT_UINT3);
        geometry.buffer(RTCBufferType::RTC_BUFFER_TYPE_VERTEX, float3, position.iter().map(Vec3::to_array))?;
        geometry.buffer(RTCBufferType::RTC_BUFFER_TYPE_INDEX, uint3, index.iter().copied())?;
        geometry.attach(&self.scene, id)
    }

    /// Spheres, as points with a radius.
    pub(crate) fn spheres(&mut self, id: u32, center: &[Vec3], radius: &[f32]) -> Result<(), EmbreeError> {
        same_length(id, "the count of radii", radius.len(), center.len())?;
        let geometry = self.geometry(id, RTCGeometryType::RTC_GEOMETRY_TYPE_SPHERE_POINT, center.len())?;
        let points = center.iter().zip(radius).map(|(center, &radius)| center.extend(radius).to_array());
        geometry.buffer(RTCBufferType::RTC_BUFFER_TYPE_VERTEX, RTCFormat::RTC_FORMAT_FLOAT4, points)?;
        geometry.attach(&self.scene, id)
    }

    /// Discs with normals of their own. (Embree's other discs, which face the ray, ignore rays that start within a
    /// radius of them, by a default of the library's build.)
    pub(crate) fn discs(
        &mut self,
        id: u32,
        center: &[Vec3],
        radius: &[f32],
        normal: &[Vec3],
    ) -> Result<(), EmbreeError> {
        same_length(id, "the count of radii", radius.len(), center.len())?;
        same_length(id, "the count of normals", normal.len(), center.len())?;
        let geometry = self.geometry(id, RTCGeometryType::RTC_GEOMETRY_TYPE_ORIENTED_DISC_POINT, center.len())?;
        let points = center.iter().zip(radius).map(|(center, &radius)| center.extend(radius).to_array());
        let normals = normal.iter().map(Vec3::to_array);
        geometry.buffer(RTCBufferType::RTC_BUFFER_TYPE_VERTEX, RTCFormat::RTC_FORMAT_FLOAT4, points)?;
        geometry.buffer(RTCBufferType::RTC_BUFFER_TYPE_NORMAL, RTCFormat::RTC_FORMAT_FLOAT3, normals)?;
        geometry.attach(&self.scene, id)
    }

    /// Round straight curves: the hull of two spheres each, single pieces that join no other. `sound` tells those that can
    /// be hit; the others are not there. A ray that begins inside hits the way out.
    pub(crate) fn curves(
        &mut self,
        id: u32,
        ends: &[[Vec3; 2]],
        radius: &[[f32; 2]],
        sound: impl Iterator<Item = bool>,
    ) -> Result<(), EmbreeError> {
        same_length(id, "the count of pairs of radii", radius.len(), ends.len())?;
        let geometry = self.geometry(id, RTCGeometryType::RTC_GEOMETRY_TYPE_ROUND_LINEAR_CURVE, ends.len())?;
        // Embree numbers vertices in 32 bits.
        let Some(last) = (ends.len() as u32).checked_mul(2).filter(|_| ends.len() <= u32::MAX as usize / 2) else {
            return Err(EmbreeError::Geometry {
                geometry: id,
                what: "the count of curves".to_owned(),
                value: ends.len() as u64,
                expected: format!("at most {}", u32::MAX / 2),
            });
        };
        // Embree leaves out what has a vertex that is not finite.
        let vertices: Vec<[f32; 4]> = ends
            .iter()
            .zip(radius)
            .zip(sound)
            .flat_map(|((ends, radius), sound)| {
                let vertex = |end: usize| ends[end].extend(radius[end]).to_array();
                if sound { [vertex(0), vertex(1)] } else { [[f32::NAN; 4]; 2] }
            })
            .collect();
        let (float4, uint) = (RTCFormat::RTC_FORMAT_FLOAT4, RTCFormat::RTC_FORMAT_UINT);
        let first: Vec<[u32; 1]> = (0..last).step_by(2).map(|first| [first]).collect();
        geometry.buffer(RTCBufferType::RTC_BUFFER_TYPE_VERTEX, float4, vertices.into_iter())?;
        geometry.buffer(RTCBufferType::RTC_BUFFER_TYPE_INDEX, uint, first.into_iter())?;
        // No neighbours: left to itself, Embree would not say which it assumes.
        let alone = ends.iter().map(|_| [0_u8]);
        geometry.buffer(RTCBufferType::RTC_BUFFER_TYPE_FLAGS, RTCFormat::RTC_FORMAT_UCHAR, alone)?;
        geometry.attach(&self.scene, id)
    }

    /// A rectangle of `size` vertices, row by row, as Embree's compact grid of quadrilaterals; numbered by quadrilateral.
    ///
    /// # Errors
    /// A count of vertices that is not the rectangle's, or sides outside 2..=32767.
    pub(crate) fn grid(&mut self, id: u32, position: &[Vec3], size: [u32; 2]) -> Result<(), EmbreeError> {
        rectangle(id, position.len(), size)?;
        let geometry = self.geometry(id, RTCGeometryType::RTC_GEOMETRY_TYPE_GRID, 1)?;
        // struct RTCGrid: first vertex, vertices per row, then both sides in 16 bits each.
        let [wide, high] = size.map(|side| (side as u16).to_ne_bytes());
        let sides = u32::from_ne_bytes([wide[0], wide[1], high[0], high[1]]);
        let (float3, grid) = (RTCFormat::RTC_FORMAT_FLOAT3, RTCFormat::RTC_FORMAT_GRID);
        geometry.buffer(RTCBufferType::RTC_BUFFER_TYPE_VERTEX, float3, position.iter().map(Vec3::to_array))?;
        geometry.buffer(RTCBufferType::RTC_BUFFER_TYPE_GRID, grid, [[0, size[0], sides]].into_iter())?;
        geometry.attach(&self.scene, id)
    }

    /// A rectangle of `size` control points, row by row, as a Catmull-Clark surface of quadrilaterals without those at
    /// its edge: inside, where all is regular, the uniform bicubic B-spline of these points. Embree cuts each
    /// quadrilateral's edges into `level` pieces.
    ///
    /// # Errors
    /// As [`Self::grid`].
    pub(crate) fn subdivision(
        &mut self,
        id: u32,
        position: &[Vec3],
        size: [u32; 2],
        level: f32,
    ) -> Result<(), EmbreeError> {
        rectangle(id, position.len(), size)?;
        let [across, down] = size.map(|side| side as usize - 1);
        let geometry = self.geometry(id, RTCGeometryType::RTC_GEOMETRY_TYPE_SUBDIVISION, across * down)?;
        let (float3, uint) = (RTCFormat::RTC_FORMAT_FLOAT3, RTCFormat::RTC_FORMAT_UINT);
        // Counter-clockwise from above, as our triangles: along z first.
        let corner = |k: usize| {
            let (face, corner) = (k / 4, k % 4);
            let (a, b) = (face % across, face / across);
            let (a, b) = [(a, b), (a, b + 1), (a + 1, b + 1), (a + 1, b)][corner];
            [(b * size[0] as usize + a) as u32]
        };
        geometry.buffer(RTCBufferType::RTC_BUFFER_TYPE_FACE, uint, (0..across * down).map(|_| [4u32]))?;
        geometry.buffer(RTCBufferType::RTC_BUFFER_TYPE_INDEX, uint, (0..4 * across * down).map(corner))?;
        geometry.buffer(RTCBufferType::RTC_BUFFER_TYPE_VERTEX, float3, position.iter().map(Vec3::to_array))?;
        let embree = self.scene.device.embree();
        // SAFETY: the geometry lives and is a subdivision surface; topology 0 is the one that it starts with.
        unsafe {
            embree.rtcSetGeometryTessellationRate(geometry.handle, level);
            embree.rtcSetGeometrySubdivisionMode(
                geometry.handle,
                0,
                RTCSubdivisionMode::RTC_SUBDIVISION_MODE_NO_BOUNDARY,
            );
        }
        self.scene.device.check("rtcSetGeometrySubdivisionMode")?;
        geometry.attach(&self.scene, id)
    }

    /// Geometry of our own, as one primitive.
    pub(crate) fn user<G: PacketGeometry<Payload = P>>(&mut self, id: u32, own: Arc<G>) -> Result<(), EmbreeError> {
        let geometry = self.geometry(id, RTCGeometryType::RTC_GEOMETRY_TYPE_USER, 1)?;
        let embree = self.scene.device.embree();
        let pointer = Arc::as_ptr(&own).cast_mut().cast::<c_void>();
        self.scene.kept.push(own);
        // SAFETY: the geometry lives; `pointer` is a `G` that the scene keeps, which is what the callbacks take it for.
        unsafe {
            embree.rtcSetGeometryUserPrimitiveCount(geometry.handle, 1);
            embree.rtcSetGeometryUserData(geometry.handle, pointer);
            embree.rtcSetGeometryBoundsFunction(geometry.handle, Some(bounds_callback::<G>), std::ptr::null_mut());
            embree.rtcSetGeometryIntersectFunction(geometry.handle, Some(intersect_callback::<G>));
            embree.rtcSetGeometryOccludedFunction(geometry.handle, Some(occluded_callback::<G>));
        }
        self.scene.device.check("rtcSetGeometryOccludedFunction")?;
        geometry.attach(&self.scene, id)
    }

    /// Builds the hierarchy.
    pub(crate) fn commit(self) -> Result<CommittedScene<P>, EmbreeError> {
        // SAFETY: the scene lives and we are its only owner.
        unsafe { self.scene.device.embree().rtcCommitScene(self.scene.handle) };
        self.scene.device.check("rtcCommitScene")?;
        Ok(CommittedScene { scene: Arc::new(self.scene), rays: RTCRayQueryFlags::RTC_RAY_QUERY_FLAG_INCOHERENT })
    }

    fn geometry(&self, id: u32, kind: RTCGeometryType, count: usize) -> Result<Geometry, EmbreeError> {
        // The greatest u32 means "no primitive" in a hit.
        if count >= u32::MAX as usize {
            return Err(EmbreeError::Geometry {
                geometry: id,
                what: "the count of primitives".to_owned(),
                value: count as u64,
                expected: format!("less than {}", u32::MAX),
            });
        }
        let device = self.scene.device.clone();
        // SAFETY: the device lives.
        let handle = unsafe { device.embree().rtcNewGeometry(device.handle(), kind) };
        device.check("rtcNewGeometry")?;
        Ok(Geometry { device, handle })
    }
}

/// Refuses a rectangle of vertices that a grid cannot number.
fn rectangle(geometry: u32, count: usize, size: [u32; 2]) -> Result<(), EmbreeError> {
    let problem = |what: &str, value: u64, expected: String| {
        Err(EmbreeError::Geometry { geometry, what: what.to_owned(), value, expected })
    };
    if let Some(&side) = size.iter().find(|side| !(2..=32767).contains(*side)) {
        return problem("a side of the grid", side.into(), "2 to 32767 vertices".to_owned());
    }
    let expected = size.iter().map(|&side| side as usize).product::<usize>();
    if count != expected {
        return problem("the count of vertices", count as u64, format!("{expected}, as the grid's sides say"));
    }
    Ok(())
}

fn same_length(geometry: u32, what: &str, value: usize, expected: usize) -> Result<(), EmbreeError> {
    if value == expected {
        return Ok(());
    }
    Err(EmbreeError::Geometry {
        geometry,
        what: what.to_owned(),
        value: value as u64,
        expected: format!("{expected}, one per centre"),
    })
}

/// A geometry before it is attached; releases its reference when it goes.
struct Geometry {
    device: Device,
    handle: RTCGeometry,
}

impl Geometry {
    /// Copies items into a buffer that Embree owns (and pads as its vector loads need).
    fn buffer<T: Copy, const N: usize>(
        &self,
        kind: RTCBufferType,
        format: RTCFormat,
        items: impl ExactSizeIterator<Item = [T; N]>,
    ) -> Result<(), EmbreeError> {
        let (count, stride) = (items.len(), size_of::<[T; N]>());
        // SAFETY: the geometry lives; Embree allocates `count` items of `stride` bytes, or fails and says so.
        let start =
            unsafe { self.device.embree().rtcSetNewGeometryBuffer(self.handle, kind, 0, format, stride, count) };
        self.device.check("rtcSetNewGeometryBuffer")?;
        if start.is_null() {
            return Ok(()); // No items.
        }
        let start = start.cast::<[T; N]>();
        for (index, item) in items.take(count).enumerate() {
            // SAFETY: `index < count`, inside what Embree has just allocated, 16-byte aligned; T is a plain number.
            unsafe { start.add(index).write(item) };
        }
        Ok(())
    }

    fn attach<P>(self, scene: &Scene<P>, id: u32) -> Result<(), EmbreeError> {
        let embree = self.device.embree();
        // SAFETY: both live and are of one device; the scene takes a reference of its own.
        unsafe { embree.rtcCommitGeometry(self.handle) };
        self.device.check("rtcCommitGeometry")?;
        // SAFETY: as above.
        unsafe { embree.rtcAttachGeometryByID(scene.handle, self.handle, id) };
        self.device.check("rtcAttachGeometryByID")
    }
}

impl Drop for Geometry {
    fn drop(&mut self) {
        // SAFETY: our one reference.
        unsafe { self.device.embree().rtcReleaseGeometry(self.handle) }
    }
}

/// `C` components of `N` lanes, as Embree lays out packets, aligned for the widest.
#[repr(C, align(64))]
struct Lanes<const C: usize, const N: usize>([[u32; N]; C]);

/// Asks for 16 lanes in parts of `N`, leaving out parts without a valid lane.
fn in_parts<const C: usize, const N: usize>(
    valid: &Valid16,
    wide: &mut [[u32; 16]; C],
    mut ask: impl FnMut(*const i32, *mut Lanes<C, N>),
) {
    for start in (0..16).step_by(N) {
        let mut part_valid = Valid16([0; 16]);
        part_valid.0[..N].copy_from_slice(&valid.0[start..start + N]);
        if part_valid.0 == [0; 16] {
            continue;
        }
        let mut part = Lanes([[0; N]; C]);
        for (to, from) in part.0.iter_mut().zip(wide.iter()) {
            to.copy_from_slice(&from[start..start + N]);
        }
        ask(part_valid.0.as_ptr(), &mut part);
        for (from, to) in part.0.iter().zip(wide.iter_mut()) {
            to[start..start + N].copy_from_slice(from);
        }
    }
}

// A ray has 12 components, a hit 9 more; each is four bytes in every lane, without padding.
const RAY: usize = 12;
const RAY_HIT: usize = 21;
const _: () = {
    assert!(size_of::<RTCRay16>() == RAY * 64 && size_of::<RTCRayHit16>() == RAY_HIT * 64);
    assert!(size_of::<RTCRay8>() == RAY * 32 && size_of::<RTCRayHit8>() == RAY_HIT * 32);
    assert!(size_of::<RTCRay4>() == RAY * 16 && size_of::<RTCRayHit4>() == RAY_HIT * 16);
};

impl<P> CommittedScene<P> {
    /// The same scene, asked with Embree's flag for rays that lie side by side. By default it is told that they do not.
    pub(crate) fn coherent(&self) -> Self {
        Self { scene: Arc::clone(&self.scene), rays: RTCRayQueryFlags::RTC_RAY_QUERY_FLAG_COHERENT }
    }

    /// Nearest hits of up to 16 rays.
    ///
    /// On processors that are narrower than 16 lanes the packet goes in parts of 8 or 4: given 16, Embree 4.4 falls back
    /// to single rays there, which takes about ten times as long with user geometry.
    pub(crate) fn intersect16(&self, valid: &Valid16, rays: &mut RTCRayHit16, payload: &mut P) {
        let mut context = Context::new(payload);
        let mut arguments = intersect_arguments(&mut context, self.rays);
        let (embree, scene) = (self.scene.device.embree(), self.scene.handle);
        // SAFETY: the scene is committed; all blocks are ours, aligned by their types and as large as Embree's (asserted
        // above), and live through the call. The callbacks of this scene take a `Context<P>`, as `SceneBuilder<P>::user`
        // demands.
        unsafe {
            let wide = std::ptr::from_mut(rays).cast::<[[u32; 16]; RAY_HIT]>();
            match self.scene.device.packet_width() {
                PacketWidth::Sixteen => embree.rtcIntersect16(valid.0.as_ptr(), scene, rays, &mut arguments),
                PacketWidth::Eight => in_parts::<RAY_HIT, 8>(valid, &mut *wide, |valid, part| {
                    embree.rtcIntersect8(valid, scene, part.cast(), &mut arguments);
                }),
                PacketWidth::Four => in_parts::<RAY_HIT, 4>(valid, &mut *wide, |valid, part| {
                    embree.rtcIntersect4(valid, scene, part.cast(), &mut arguments);
                }),
            }
        }
    }

    /// Nearest hit of one ray.
    pub(crate) fn intersect1(&self, ray: &mut RTCRayHit, payload: &mut P) {
        let mut context = Context::new(payload);
        let mut arguments = intersect_arguments(&mut context, self.rays);
        // SAFETY: as in `intersect16`.
        unsafe { self.scene.device.embree().rtcIntersect1(self.scene.handle, ray, &mut arguments) };
    }

    /// Whether one ray hits anything: `tfar` becomes -inf where it does.
    pub(crate) fn occluded1(&self, ray: &mut RTCRay, payload: &mut P) {
        let mut context = Context::new(payload);
        let mut arguments = occluded_arguments(&mut context, self.rays);
        // SAFETY: as in `intersect16`.
        unsafe { self.scene.device.embree().rtcOccluded1(self.scene.handle, ray, &mut arguments) };
    }

    /// Whether up to 16 rays hit anything: `tfar` becomes -inf where they do. In parts, as `intersect16`.
    pub(crate) fn occluded16(&self, valid: &Valid16, rays: &mut RTCRay16, payload: &mut P) {
        let mut context = Context::new(payload);
        let mut arguments = occluded_arguments(&mut context, self.rays);
        let (embree, scene) = (self.scene.device.embree(), self.scene.handle);
        // SAFETY: as in `intersect16`.
        unsafe {
            let wide = std::ptr::from_mut(rays).cast::<[[u32; 16]; RAY]>();
            match self.scene.device.packet_width() {
                PacketWidth::Sixteen => embree.rtcOccluded16(valid.0.as_ptr(), scene, rays, &mut arguments),
                PacketWidth::Eight => in_parts::<RAY, 8>(valid, &mut *wide, |valid, part| {
                    embree.rtcOccluded8(valid, scene, part.cast(), &mut arguments);
                }),
                PacketWidth::Four => in_parts::<RAY, 4>(valid, &mut *wide, |valid, part| {
                    embree.rtcOccluded4(valid, scene, part.cast(), &mut arguments);
                }),
            }
        }
    }
}

fn occluded_arguments<P>(context: &mut Context<P>, flags: RTCRayQueryFlags) -> RTCOccludedArguments {
    RTCOccludedArguments {
        flags,
        feature_mask: RTCFeatureFlags::RTC_FEATURE_FLAG_ALL,
        context: std::ptr::from_mut(context).cast(),
        filter: None,
        occluded: None,
    }
}

fn intersect_arguments<P>(context: &mut Context<P>, flags: RTCRayQueryFlags) -> RTCIntersectArguments {
    RTCIntersectArguments {
        flags,
        feature_mask: RTCFeatureFlags::RTC_FEATURE_FLAG_ALL,
        // The whole context, not only its first field: the callbacks read what lies behind it.
        context: std::ptr::from_mut(context).cast(),
        filter: None,
        intersect: None,
    }
}
