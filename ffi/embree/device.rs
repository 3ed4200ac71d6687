//! A device: Embree's settings, its errors and its memory.
//!
//! Every set-up call is followed by [`Device::check`], which turns Embree's error code and words into ours.

use std::ffi::{CStr, CString, c_char, c_void};
use std::sync::atomic::{AtomicI64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use super::EmbreeError;
use super::bindings::{Embree, RTC_VERSION_MAJOR, RTCDevice, RTCDeviceProperty, RTCError};
use super::loader::{Library, library};

/// Oldest version whose structures are ours: 4.3 added `instPrimID` to hits.
const OLDEST: isize = 40300;

/// An Embree device; clones share it.
#[derive(Clone, Debug)]
pub(crate) struct Device {
    inner: Arc<Inner>,
}

#[derive(Debug)]
struct Inner {
    library: &'static Library,
    handle: RTCDevice,
    packet_width: PacketWidth,
    /// Where the callbacks write; boxed, so that its place stays while they may run.
    record: Box<Record>,
}

/// Rays that Embree traces as one packet on this processor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum PacketWidth {
    /// AVX-512.
    Sixteen,
    /// AVX, AVX2.
    Eight,
    /// SSE, NEON.
    Four,
}

/// What Embree told us through its callbacks.
#[derive(Debug, Default)]
struct Record {
    messages: Mutex<Vec<String>>,
    bytes: AtomicI64,
}

// SAFETY: Embree's device handle is reference-counted and its functions may be called from any thread; the record is
// locked or atomic.
unsafe impl Send for Inner {}
// SAFETY: as above.
unsafe impl Sync for Inner {}

impl Device {
    /// A device whose builds use up to `threads` threads (0: all), with further Embree settings (`isa=avx2`).
    ///
    /// # Errors
    /// No library, one that is too old or unsuitably built, or a setting that Embree refuses.
    pub(crate) fn new(threads: usize, settings: &str) -> Result<Self, EmbreeError> {
        let library = library()?;
        let call = "rtcNewDevice";
        let refused = |message: &str| EmbreeError::Call {
            call,
            code: "RTC_ERROR_INVALID_ARGUMENT".to_owned(),
            message: message.to_owned(),
        };
        let text =
            if settings.is_empty() { format!("threads={threads}") } else { format!("threads={threads},{settings}") };
        let text = CString::new(text).map_err(|_| refused("a setting holds a zero byte"))?;
        let embree = &library.functions;
        // SAFETY: the text is terminated and outlives the call; Embree copies it.
        let handle = unsafe { embree.rtcNewDevice(text.as_ptr()) };
        if handle.is_null() {
            // SAFETY: a null device asks for the error of the failed creation on this thread.
            let code = unsafe { embree.rtcGetDeviceError(std::ptr::null_mut()) };
            // SAFETY: as above; the returned text is valid until the next call on this thread.
            let message = unsafe { owned(embree.rtcGetDeviceLastErrorMessage(std::ptr::null_mut())) };
            return Err(EmbreeError::Call { call, code: name(embree, code), message });
        }
        // Released by this on every way out; its functions' table is `library`'s.
        let mut inner = Inner { library, handle, packet_width: PacketWidth::Four, record: Box::default() };
        inner.packet_width = inner.suitable()?;
        let device = Self { inner: Arc::new(inner) };
        let record = std::ptr::from_ref::<Record>(&device.inner.record).cast_mut().cast::<c_void>();
        // SAFETY: the record is boxed in `Inner`, which releases the device (and with it every callback) before the box.
        unsafe {
            embree.rtcSetDeviceErrorFunction(handle, Some(on_error), record);
            embree.rtcSetDeviceMemoryMonitorFunction(handle, Some(on_memory), record);
        }
        device.check("rtcSetDeviceMemoryMonitorFunction")?;
        Ok(device)
    }

    /// Bytes that Embree holds for this device now.
    pub(crate) fn memory(&self) -> u64 {
        self.inner.record.bytes.load(Ordering::Relaxed).max(0).unsigned_abs()
    }

    /// How many rays to ask at once.
    pub(super) fn packet_width(&self) -> PacketWidth {
        self.inner.packet_width
    }

    /// Embree's functions.
    pub(super) fn embree(&self) -> &'static Embree {
        &self.inner.library.functions
    }

    /// Embree's handle, valid as long as this device.
    pub(super) fn handle(&self) -> RTCDevice {
        self.inner.handle
    }

    /// The error of the last call on this thread, if it failed.
    pub(super) fn check(&self, call: &'static str) -> Result<(), EmbreeError> {
        // SAFETY: the device lives; reading its error clears it.
        let code = unsafe { self.embree().rtcGetDeviceError(self.handle()) };
        if code == RTCError::RTC_ERROR_NONE {
            return Ok(());
        }
        let mut messages = self.inner.record.messages.lock().unwrap_or_else(PoisonError::into_inner);
        let message = std::mem::take(&mut *messages).join("; ");
        Err(EmbreeError::Call { call, code: name(self.embree(), code), message })
    }
}

impl Inner {
    fn property(&self, property: RTCDeviceProperty) -> isize {
        // SAFETY: the device lives, and every property is one of Embree's own.
        unsafe { self.library.functions.rtcGetDeviceProperty(self.handle, property) }
    }

    /// The widest packets; or why the library will not do: its version against the headers', and choices made when it was
    /// compiled that would change pictures.
    fn suitable(&self) -> Result<PacketWidth, EmbreeError> {
        use RTCDeviceProperty as P;
        let library = || self.library.path.clone();
        let version = self.property(P::RTC_DEVICE_PROPERTY_VERSION);
        if !version_fits(version) {
            let found = format!("{}.{}.{}", version / 10000, version / 100 % 100, version % 100);
            return Err(EmbreeError::Version { library: library(), found });
        }
        for (property, wanted, what) in [
            (P::RTC_DEVICE_PROPERTY_TRIANGLE_GEOMETRY_SUPPORTED, true, "without triangles"),
            (P::RTC_DEVICE_PROPERTY_POINT_GEOMETRY_SUPPORTED, true, "without points"),
            (P::RTC_DEVICE_PROPERTY_USER_GEOMETRY_SUPPORTED, true, "without user geometry"),
            (P::RTC_DEVICE_PROPERTY_BACKFACE_CULLING_ENABLED, false, "with back-face culling"),
            (P::RTC_DEVICE_PROPERTY_BACKFACE_CULLING_SPHERES_ENABLED, false, "with back-face culling of spheres"),
        ] {
            if (self.property(property) != 0) != wanted {
                return Err(EmbreeError::Build { library: library(), what });
            }
        }
        [
            (P::RTC_DEVICE_PROPERTY_NATIVE_RAY16_SUPPORTED, PacketWidth::Sixteen),
            (P::RTC_DEVICE_PROPERTY_NATIVE_RAY8_SUPPORTED, PacketWidth::Eight),
            (P::RTC_DEVICE_PROPERTY_NATIVE_RAY4_SUPPORTED, PacketWidth::Four),
        ]
        .into_iter()
        .find_map(|(property, width)| (self.property(property) != 0).then_some(width))
        .ok_or_else(|| EmbreeError::Build { library: library(), what: "without ray packets" })
    }
}

impl Drop for Inner {
    fn drop(&mut self) {
        // SAFETY: this is our one reference; scenes and geometries hold their own until they are released.
        unsafe { self.library.functions.rtcReleaseDevice(self.handle) }
    }
}

fn version_fits(version: isize) -> bool {
    version >= OLDEST && version / 10000 == RTC_VERSION_MAJOR as isize
}

fn name(embree: &Embree, code: RTCError) -> String {
    // SAFETY: any code is allowed; the text is a constant of the library.
    unsafe { owned(embree.rtcGetErrorString(code)) }
}

/// A C string as ours.
///
/// # Safety
/// `text` is null or points to a terminated string that lives through the call.
unsafe fn owned(text: *const c_char) -> String {
    if text.is_null() {
        return String::new();
    }
    // SAFETY: the caller's promise.
    unsafe { CStr::from_ptr(text) }.to_string_lossy().into_owned()
}

/// Collects Embree's words.
unsafe extern "C" fn on_error(record: *mut c_void, _code: RTCError, message: *const c_char) {
    // SAFETY: Embree passes back the record given with this function, which outlives the device.
    let record = unsafe { &*record.cast::<Record>() };
    // SAFETY: Embree passes a terminated string or null.
    let message = unsafe { owned(message) };
    record.messages.lock().unwrap_or_else(PoisonError::into_inner).push(message);
}

/// Counts bytes; always lets Embree go on.
unsafe extern "C" fn on_memory(record: *mut c_void, bytes: isize, _post: bool) -> bool {
    // SAFETY: as in `on_error`.
    let record = unsafe { &*record.cast::<Record>() };
    record.bytes.fetch_add(bytes as i64, Ordering::Relaxed);
    true
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn versions_before_4_3_and_other_majors_are_refused() {
        for (version, fits) in
            [(30000, false), (40200, false), (40299, false), (40300, true), (40400, true), (50000, false)]
        {
            assert_eq!(version_fits(version), fits, "{version}");
        }
    }

    #[test]
    fn packets_are_as_wide_as_the_instruction_set() {
        let width = |settings| Device::new(1, settings).unwrap().packet_width();
        assert_eq!(width("isa=sse4.2"), PacketWidth::Four);
        #[cfg(target_arch = "x86_64")]
        if std::arch::is_x86_feature_detected!("avx2") {
            assert_eq!(width("isa=avx2"), PacketWidth::Eight);
        }
        #[cfg(target_arch = "x86_64")]
        if std::arch::is_x86_feature_detected!("avx512f") {
            assert_eq!(width(""), PacketWidth::Sixteen);
        }
    }

    #[test]
    fn a_failed_call_carries_embrees_code_and_words() {
        let device = Device::new(1, "").unwrap();
        // SAFETY: a device that lives; the count is out of range on purpose, which Embree answers by an error.
        unsafe {
            let geometry = device
                .embree()
                .rtcNewGeometry(device.handle(), super::super::bindings::RTCGeometryType::RTC_GEOMETRY_TYPE_USER);
            device.embree().rtcSetGeometryTimeStepCount(geometry, 1_000_000);
            device.embree().rtcReleaseGeometry(geometry);
        }
        let error = device.check("rtcSetGeometryTimeStepCount").unwrap_err().to_string();
        assert!(error.contains("rtcSetGeometryTimeStepCount") && error.contains("Invalid"), "{error}");
        assert!(error.contains("time"), "Embree's own words are missing: {error}");
        device.check("nothing").unwrap();
    }
}
