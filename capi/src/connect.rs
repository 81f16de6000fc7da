//! Where a link comes from: the user's configuration, or a URI of the program's.

use std::path::PathBuf;
use std::sync::Arc;

use ecmsk::link::config::{self, Environment};
use ecmsk::link::{self, Link, LinkError, Share};

use crate::error::CallError;

/// The link that `ECMSK_LINK` or a configuration file names, else `usb:`. The C ABI's board of the same URI is found
/// again as it was left.
///
/// # Errors
/// [`CallError::Link`], [`CallError::Configured`].
pub fn configured() -> Result<Arc<dyn Link>, Box<CallError>> {
    say_opened();
    let configured = config::find(&Environment::from_process(library_dir())).map_err(LinkError::from)?;
    log::info!("link {}: {}", configured.source, configured.link);
    link::open(&configured.link, Share::ByUri)
        .map_err(|error| CallError::Configured { from: configured.source, error: error.into() }.into())
}

/// The link of that URI. Boards are shared by their `name=` only.
///
/// # Errors
/// [`CallError::Link`].
pub fn named(uri: &str) -> Result<Arc<dyn Link>, Box<CallError>> {
    say_opened();
    Ok(link::open(uri, Share::ByName)?)
}

/// Tells `ecmsk exec`, if that started the program.
fn say_opened() {
    if let Some(file) = std::env::var_os(config::OPENED)
        && let Err(error) = std::fs::File::create(&file)
    {
        // Nobody but the tool asks for it, and its folder may be gone by now.
        log::debug!("{}: {error}", file.display());
    }
}

/// The folder that this library was loaded from, as the loader names it; for the static library the program's.
#[cfg(unix)]
fn library_dir() -> Option<PathBuf> {
    use std::ffi::{CStr, OsStr};
    use std::os::unix::ffi::OsStrExt;

    let mut info = std::mem::MaybeUninit::<libc::Dl_info>::zeroed();
    let here = library_dir as *const ();
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

/// The folder of this library, where the system's loader tells it.
#[cfg(not(unix))]
fn library_dir() -> Option<PathBuf> {
    None
}
