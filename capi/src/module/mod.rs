//! This library as a file that a program has loaded: its folder, and how long it stays in memory. `unloadable.rs` is for
//! Windows, where a program may unload it at any time; `permanent.rs` is for systems that never unload it.

#[cfg(not(windows))]
mod permanent;
#[cfg(windows)]
mod unloadable;

use std::path::PathBuf;

#[cfg(windows)]
pub use imp::UNLOAD;
pub(crate) use imp::close_and_unload;
pub use imp::{Call, CloseResult, LastError, ModuleReference, close, set_last_error};
#[cfg(not(windows))]
use permanent as imp;
#[cfg(windows)]
use unloadable as imp;

/// The folder that this library was loaded from, as the loader names it. In a program that links the static library it is
/// the folder of the program.
#[cfg(unix)]
pub fn folder() -> Option<PathBuf> {
    use std::ffi::{CStr, OsStr};
    use std::os::unix::ffi::OsStrExt;

    let mut info = std::mem::MaybeUninit::<libc::Dl_info>::zeroed();
    let here = folder as *const ();
    // SAFETY: `here` is an address in this library, `info` receives the answer.
    let found = unsafe { libc::dladdr(here.cast(), info.as_mut_ptr()) } != 0;
    // SAFETY: a zeroed `Dl_info` is valid, and so is what `dladdr` writes.
    let info = unsafe { info.assume_init() };
    if !found || info.dli_fname.is_null() {
        return None;
    }
    // SAFETY: the loader's text lives as long as the library is loaded.
    let file = unsafe { CStr::from_ptr(info.dli_fname) };
    let file = std::path::absolute(OsStr::from_bytes(file.to_bytes())).ok()?;
    Some(file.parent()?.to_path_buf())
}

/// The folder that this library was loaded from. In a program that links the static library it is the folder of the
/// program.
#[cfg(windows)]
pub fn folder() -> Option<PathBuf> {
    use std::ffi::OsString;
    use std::os::windows::ffi::OsStringExt;

    use windows_sys::Win32::System::LibraryLoader::GetModuleFileNameW;

    /// The length of the longest path in Windows, in UTF-16 units.
    const PATH_LEN_MAX: usize = 0x8000;

    let mut path = vec![0_u16; PATH_LEN_MAX];
    // SAFETY: the buffer has room for `PATH_LEN_MAX` characters.
    let length = unsafe { GetModuleFileNameW(imp::this_module()?, path.as_mut_ptr(), PATH_LEN_MAX as u32) };
    path.truncate(length as usize);
    Some(PathBuf::from(OsString::from_wide(&path)).parent()?.to_path_buf())
}

/// Other systems have no function that returns the folder of a library, so it is not known.
#[cfg(not(any(unix, windows)))]
pub fn folder() -> Option<PathBuf> {
    None
}
