//! The functions of Open Image Denoise's C interface that are called, as its manual declares them (version 2.0 to 2.5:
//! within a major version the interface only grows).

use std::ffi::{OsStr, c_char, c_int, c_void};

/// `OIDNDevice`: a reference-counted object of the library.
pub(super) type DeviceHandle = *mut c_void;
/// `OIDNFilter`: likewise.
pub(super) type FilterHandle = *mut c_void;

/// `OIDN_DEVICE_TYPE_CPU`.
pub(super) const DEVICE_TYPE_CPU: c_int = 1;
/// `OIDN_FORMAT_FLOAT3`: three single-precision numbers.
pub(super) const FORMAT_FLOAT3: c_int = 3;
/// `OIDN_ERROR_NONE`.
pub(super) const ERROR_NONE: c_int = 0;

/// Declares the table of functions, and how it is filled from a library.
macro_rules! functions {
    ($($name:ident: $symbol:literal, fn($($argument:ty),*) $(-> $result:ty)?;)*) => {
        /// The functions, valid as long as the library that they came from is loaded.
        pub(super) struct Oidn {
            $(pub(super) $name: unsafe extern "C" fn($($argument),*) $(-> $result)?,)*
            /// Keeps the code mapped.
            _library: libloading::Library,
        }

        impl Oidn {
            /// Opens a library and finds every function in it.
            ///
            /// # Safety
            /// What runs when the library is loaded is harmless, and functions of these names have these signatures.
            pub(super) unsafe fn new(path: impl AsRef<OsStr>) -> Result<Self, libloading::Error> {
                // SAFETY: the caller's promise.
                let library = unsafe { libloading::Library::new(path.as_ref()) }?;
                Ok(Self {
                    // SAFETY: the caller's promise on the signatures; the library is kept beside the pointers.
                    $($name: *unsafe { library.get($symbol) }?,)*
                    _library: library,
                })
            }
        }
    };
}

functions! {
    new_device: b"oidnNewDevice\0", fn(c_int) -> DeviceHandle;
    release_device: b"oidnReleaseDevice\0", fn(DeviceHandle);
    set_device_bool: b"oidnSetDeviceBool\0", fn(DeviceHandle, *const c_char, bool);
    set_device_int: b"oidnSetDeviceInt\0", fn(DeviceHandle, *const c_char, c_int);
    get_device_int: b"oidnGetDeviceInt\0", fn(DeviceHandle, *const c_char) -> c_int;
    get_device_error: b"oidnGetDeviceError\0", fn(DeviceHandle, *mut *const c_char) -> c_int;
    commit_device: b"oidnCommitDevice\0", fn(DeviceHandle);
    new_filter: b"oidnNewFilter\0", fn(DeviceHandle, *const c_char) -> FilterHandle;
    release_filter: b"oidnReleaseFilter\0", fn(FilterHandle);
    // Filter, name, first byte, format, width, height, offset, bytes from pixel to pixel and from row to row (0: packed).
    set_shared_filter_image: b"oidnSetSharedFilterImage\0",
        fn(FilterHandle, *const c_char, *mut c_void, c_int, usize, usize, usize, usize, usize);
    set_filter_bool: b"oidnSetFilterBool\0", fn(FilterHandle, *const c_char, bool);
    commit_filter: b"oidnCommitFilter\0", fn(FilterHandle);
    execute_filter: b"oidnExecuteFilter\0", fn(FilterHandle);
}

impl std::fmt::Debug for Oidn {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.write_str("Oidn")
    }
}
