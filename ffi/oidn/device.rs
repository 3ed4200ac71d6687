//! A device that filters on the processor, and one run of the filter `RT` over pictures in our memory.
//!
//! Every call is followed by [`Device::check`], which turns the library's error code and words into ours.

use std::ffi::{CStr, c_char, c_int};

use super::OidnError;
use super::bindings::{DEVICE_TYPE_CPU, DeviceHandle, ERROR_NONE, FORMAT_FLOAT3, FilterHandle, Oidn};
use super::loader::{Library, library};

/// Oldest version whose functions are ours (`oidnSetFilterBool` and its kin came with 2.0), and the first that is not.
const VERSIONS: std::ops::Range<c_int> = 20000..30000;

/// A device on the processor. Not for sharing between threads: the library keeps its errors by thread.
#[derive(Debug)]
pub(crate) struct Device {
    library: &'static Library,
    handle: DeviceHandle,
    version: c_int,
}

/// What one run of the filter reads. Every picture is packed rows of `red, green, blue` (or x, y, z) from the top.
///
/// With a colour the guides help to filter it; without one, the filter is trained for the one guide that is given.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Images<'a> {
    /// Pixels across and down.
    pub(crate) size: (usize, usize),
    /// Scene-linear light, at least 0, without an upper limit.
    pub(crate) colour: Option<&'a [f32]>,
    /// Albedo, 0 to 1.
    pub(crate) albedo: Option<&'a [f32]>,
    /// Normal, each part -1 to 1.
    pub(crate) normal: Option<&'a [f32]>,
    /// The guides hold no noise.
    pub(crate) clean_guides: bool,
}

impl Device {
    /// A device that works with `threads` threads (0: all).
    ///
    /// # Errors
    /// No library, one of another version, or a processor that it cannot work on.
    pub(crate) fn new(threads: usize) -> Result<Self, OidnError> {
        let library = library()?;
        // SAFETY: the type is one of the interface's.
        let handle = unsafe { (library.functions.new_device)(DEVICE_TYPE_CPU) };
        if handle.is_null() {
            return Err(error(library, handle, "oidnNewDevice").unwrap_or_else(|| OidnError::Call {
                library: library.path.clone(),
                call: "oidnNewDevice",
                code: "no device".to_owned(),
                message: String::new(),
            }));
        }
        // Released by this on every way out.
        let mut device = Self { library, handle, version: 0 };
        // SAFETY: the device lives; the name is terminated.
        device.version = unsafe { (library.functions.get_device_int)(handle, c"version".as_ptr()) };
        device.check("oidnGetDeviceInt")?;
        if !VERSIONS.contains(&device.version) {
            return Err(OidnError::Version { library: library.path.clone(), found: device.version() });
        }
        let threads = c_int::try_from(threads).unwrap_or(c_int::MAX);
        // SAFETY: as above. Pinning threads to processors is left off: they are the renderer's threads too.
        unsafe {
            (library.functions.set_device_int)(handle, c"numThreads".as_ptr(), threads);
            (library.functions.set_device_bool)(handle, c"setAffinity".as_ptr(), false);
        }
        device.check("oidnSetDeviceInt, oidnSetDeviceBool")?;
        // SAFETY: the device lives.
        unsafe { (library.functions.commit_device)(handle) };
        device.check("oidnCommitDevice")?;
        Ok(device)
    }

    /// The library's version, as `2.5.1`.
    pub(crate) fn version(&self) -> String {
        format!("{}.{}.{}", self.version / 10000, self.version / 100 % 100, self.version % 100)
    }

    /// Filters `images` into `output`, which has their size.
    ///
    /// # Errors
    /// What the library refuses, or memory that it does not get.
    ///
    /// # Panics
    /// If a picture does not have `3 * width * height` numbers: the library would read beyond it.
    pub(crate) fn filter(&self, images: &Images, output: &mut [f32]) -> Result<(), OidnError> {
        let (width, height) = images.size;
        let numbers =
            width.checked_mul(height).and_then(|pixels| pixels.checked_mul(3)).expect("a picture fits memory");
        let oidn = &self.library.functions;
        let filter = Filter::new(self)?;
        let inputs = [(c"color", images.colour), (c"albedo", images.albedo), (c"normal", images.normal)];
        for (name, pixels) in inputs.into_iter().filter_map(|(name, pixels)| Some((name, pixels?))) {
            assert_eq!(pixels.len(), numbers, "{name:?} has not the size of the picture");
            // The interface knows only pointers to what may be written; inputs are only read.
            filter.set_image(name, pixels.as_ptr().cast_mut(), images.size)?;
        }
        assert_eq!(output.len(), numbers, "the output has not the size of the picture");
        filter.set_image(c"output", output.as_mut_ptr(), images.size)?;
        for (name, value) in [(c"hdr", images.colour.is_some()), (c"cleanAux", images.clean_guides)] {
            // SAFETY: the filter lives; the name is terminated.
            unsafe { (oidn.set_filter_bool)(filter.handle, name.as_ptr(), value) };
            self.check("oidnSetFilterBool")?;
        }
        // SAFETY: the filter lives, and so do the pictures.
        unsafe { (oidn.commit_filter)(filter.handle) };
        self.check("oidnCommitFilter")?;
        // SAFETY: each picture is borrowed until this returns, and has the size that was told (checked above); the output
        // is borrowed alone. The call returns when all is written.
        unsafe { (oidn.execute_filter)(filter.handle) };
        self.check("oidnExecuteFilter")
    }

    /// The error of the last calls on this thread, if one failed.
    fn check(&self, call: &'static str) -> Result<(), OidnError> {
        error(self.library, self.handle, call).map_or(Ok(()), Err)
    }
}

impl Drop for Device {
    fn drop(&mut self) {
        // SAFETY: this is our one reference; filters hold their own until they are released.
        unsafe { (self.library.functions.release_device)(self.handle) }
    }
}

/// A filter `RT` (for ray tracing), released on every way out.
struct Filter<'a> {
    device: &'a Device,
    handle: FilterHandle,
}

impl<'a> Filter<'a> {
    fn new(device: &'a Device) -> Result<Self, OidnError> {
        // SAFETY: the device lives and is committed; the name is terminated.
        let handle = unsafe { (device.library.functions.new_filter)(device.handle, c"RT".as_ptr()) };
        let filter = Self { device, handle };
        device.check("oidnNewFilter")?;
        Ok(filter)
    }

    /// Tells the filter where a picture of packed triples of floats lies. Nothing is read before the filter is run.
    fn set_image(
        &self,
        name: &'static CStr,
        pixels: *mut f32,
        (width, height): (usize, usize),
    ) -> Result<(), OidnError> {
        let Oidn { set_shared_filter_image, .. } = &self.device.library.functions;
        // SAFETY: the filter lives; the name is terminated; `filter` keeps the picture alive through the run.
        unsafe {
            set_shared_filter_image(self.handle, name.as_ptr(), pixels.cast(), FORMAT_FLOAT3, width, height, 0, 0, 0);
        }
        self.device.check("oidnSetSharedFilterImage")
    }
}

impl Drop for Filter<'_> {
    fn drop(&mut self) {
        // SAFETY: our one reference (null is ignored).
        unsafe { (self.device.library.functions.release_filter)(self.handle) }
    }
}

/// The error that waits on this thread for a device, or for the creation of one if it is null; reading clears it.
fn error(library: &Library, device: DeviceHandle, call: &'static str) -> Option<OidnError> {
    let mut message: *const c_char = std::ptr::null();
    // SAFETY: the device lives or is null, which asks for the error of a failed creation; the message is only written.
    let code = unsafe { (library.functions.get_device_error)(device, &raw mut message) };
    if code == ERROR_NONE {
        return None;
    }
    let message = if message.is_null() {
        String::new()
    } else {
        // SAFETY: the library gives a terminated string that lives until the next call on this thread.
        unsafe { CStr::from_ptr(message) }.to_string_lossy().into_owned()
    };
    let code = match code {
        2 => "invalid argument".to_owned(),
        3 => "invalid operation".to_owned(),
        4 => "out of memory".to_owned(),
        5 => "unsupported hardware".to_owned(),
        6 => "cancelled".to_owned(),
        other => format!("error {other}"),
    };
    Some(OidnError::Call { library: library.path.clone(), call, code, message })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failed_call_carries_the_librarys_code_and_words() {
        let device = Device::new(1).unwrap();
        // Nothing to filter.
        let mut output = vec![0.0; 3 * 64];
        let images = Images { size: (8, 8), ..Images::default() };
        let error = device.filter(&images, &mut output).unwrap_err().to_string();
        assert!(error.contains("oidnCommitFilter failed: invalid operation: "), "{error}");
        // The error was taken with its report.
        device.check("nothing").unwrap();
    }

    #[test]
    fn the_version_is_told_as_people_write_it() {
        let device = Device::new(1).unwrap();
        assert!(device.version().starts_with("2."), "{}", device.version());
        assert_eq!(device.version().split('.').count(), 3);
    }
}
