//! Libraries in C that are opened as the program runs.

use std::ffi::{CStr, OsStr, c_char, c_void};
use std::ptr::NonNull;

/// Opens the first of these that there is; it stays open until the process ends.
///
/// # Errors
/// Where none can be opened: what the loader says of the last.
pub(crate) fn open(names: impl IntoIterator<Item = impl AsRef<OsStr>>) -> Result<&'static libloading::Library, String> {
    let mut said = String::new();
    for name in names {
        // SAFETY: loading runs the library's initialisers; its name is the maker's own, or the operator's word for it.
        match unsafe { libloading::Library::new(name.as_ref()) } {
            Ok(library) => return Ok(Box::leak(Box::new(library))),
            Err(error) => {
                said = std::error::Error::source(&error).map_or_else(|| error.to_string(), ToString::to_string)
            }
        }
    }
    Err(said)
}

/// A table of a library's functions by their names.
macro_rules! functions {
    ($(#[$doc:meta])* $table:ident { $($name:ident($($argument:ty),*) $(-> $result:ty)?;)* }) => {
        $(#[$doc])*
        #[derive(Debug)]
        struct $table {
            $($name: unsafe extern "C" fn($($argument),*) $(-> $result)?,)*
        }

        impl $table {
            /// # Safety
            /// The functions of these names are declared as in the library's headers.
            ///
            /// # Errors
            /// Where the library lacks one: what the loader says.
            unsafe fn of(library: &'static libloading::Library) -> Result<Self, String> {
                let missing = |error: libloading::Error| error.to_string();
                Ok(Self {
                    // SAFETY: as promised by who calls; the library stays open.
                    $($name: *unsafe { library.get(concat!(stringify!($name), "\0").as_bytes()) }.map_err(missing)?,)*
                })
            }
        }
    };
}
pub(crate) use functions;

/// Something of a library's, which is given back when this is dropped.
#[derive(Debug)]
pub(crate) struct Handle {
    it: NonNull<c_void>,
    give_back: unsafe extern "C" fn(*mut c_void),
}

// SAFETY: what handles are made of here (reference-counted objects of GStreamer, librealsense's frames, ALSA's streams)
// may be used and given back by any thread, one at a time, by their libraries' word.
unsafe impl Send for Handle {}

impl Handle {
    /// Takes it over; none where it is null.
    ///
    /// # Safety
    /// It is the caller's own, and `give_back` is what its library wants called once for it.
    pub unsafe fn new(it: *mut c_void, give_back: unsafe extern "C" fn(*mut c_void)) -> Option<Self> {
        NonNull::new(it).map(|it| Self { it, give_back })
    }

    /// It stays this handle's.
    pub fn get(&self) -> *mut c_void {
        self.it.as_ptr()
    }
}

impl Drop for Handle {
    fn drop(&mut self) {
        // SAFETY: as promised to `new`; it is given back here alone.
        unsafe { (self.give_back)(self.it.as_ptr()) }
    }
}

/// A text of a library's; empty where there is none.
///
/// # Safety
/// It is null, or ends in zero and lives until this returns.
pub(crate) unsafe fn text(from: *const c_char) -> String {
    // SAFETY: as promised by who calls.
    if from.is_null() { String::new() } else { unsafe { CStr::from_ptr(from) }.to_string_lossy().into_owned() }
}
