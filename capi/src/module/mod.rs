//! This library as a file that a program has loaded: where it lies and how long it stays.

#[cfg(not(windows))]
mod forever;
#[cfg(windows)]
mod stay;

use std::path::PathBuf;

#[cfg(not(windows))]
use forever as stay;
#[cfg(windows)]
pub use stay::UNLOAD;
pub(crate) use stay::leaving;
pub use stay::{Call, LastError, Leaving, Stay, close, set_last_error};

/// The folder that this library was loaded from, as the loader names it; for the static library the program's.
#[cfg(unix)]
pub fn folder() -> Option<PathBuf> {
    use std::ffi::{CStr, OsStr};
    use std::os::unix::ffi::OsStrExt;

    let mut info = std::mem::MaybeUninit::<libc::Dl_info>::zeroed();
    let here = folder as *const ();
    // SAFETY: `here` is an address of this library, `info` has room for the answer.
    let found = unsafe { libc::dladdr(here.cast(), info.as_mut_ptr()) } != 0;
    // SAFETY: zeroed is a valid `Dl_info`, and `dladdr` leaves a valid one.
    let info = unsafe { info.assume_init() };
    if !found || info.dli_fname.is_null() {
        return None;
    }
    // SAFETY: the loader's own text, which lives as long as the library is loaded.
    let file = unsafe { CStr::from_ptr(info.dli_fname) };
    let file = std::path::absolute(OsStr::from_bytes(file.to_bytes())).ok()?;
    Some(file.parent()?.to_path_buf())
}

/// The folder that this library was loaded from; for the static library the program's.
#[cfg(windows)]
pub fn folder() -> Option<PathBuf> {
    use std::ffi::OsString;
    use std::os::windows::ffi::OsStringExt;

    use windows_sys::Win32::System::LibraryLoader::GetModuleFileNameW;

    /// No path of Windows is longer.
    const LONGEST: usize = 0x8000;

    let mut path = vec![0_u16; LONGEST];
    // SAFETY: the buffer has room for as many characters as it says.
    let length = unsafe { GetModuleFileNameW(stay::this_module()?, path.as_mut_ptr(), LONGEST as u32) };
    path.truncate(length as usize);
    Some(PathBuf::from(OsString::from_wide(&path)).parent()?.to_path_buf())
}

/// The folder of this library, where the system's loader tells it.
#[cfg(not(any(unix, windows)))]
pub fn folder() -> Option<PathBuf> {
    None
}
