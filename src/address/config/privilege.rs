//! Programs that run with more rights than the user who starts them: set-user-ID, set-group-ID, file capabilities. A link
//! may create a file (`record=`) or read one (`script=`), so nothing that this user can write or set may determine the
//! link.
//!
//! \[OURS] In such a program the library ignores its environment variables, and accepts an `ecmsk.toml` only if nobody but
//! root can have written it ([`writable_by_others`]).

use std::env;
use std::ffi::OsString;
use std::path::Path;

/// Whether this process was started with more rights than its user has. The result does not change when the process drops
/// these rights.
///
/// Source: `AT_SECURE` of getauxval(3) on Linux, which the dynamic linker and `secure_getenv` use as well.
pub fn is_privileged() -> bool {
    #[cfg(any(target_os = "linux", target_os = "android"))]
    {
        // SAFETY: getauxval has no preconditions.
        (unsafe { libc::getauxval(libc::AT_SECURE) }) != 0
    }
    #[cfg(all(unix, not(any(target_os = "linux", target_os = "android"))))]
    {
        // SAFETY: these functions have no preconditions.
        unsafe { libc::getuid() != libc::geteuid() || libc::getgid() != libc::getegid() }
    }
    #[cfg(not(unix))]
    {
        false
    }
}

/// The value of an environment variable; always `None` in a privileged process. The library reads environment variables
/// only through this function.
pub fn variable(name: &str) -> Option<OsString> {
    variable_for(is_privileged(), name)
}

fn variable_for(privileged: bool, name: &str) -> Option<OsString> {
    if privileged { None } else { env::var_os(name) }
}

/// The reason why an existing file is not trusted: somebody other than root may have written it or put another file at
/// this path, or that cannot be checked. `None` if only root can have done so.
#[cfg(unix)]
pub fn writable_by_others(file: &Path) -> Option<String> {
    use std::fs::symlink_metadata;
    use std::os::unix::fs::MetadataExt;

    const WRITABLE_BY_OTHERS: u32 = 0o022;
    const STICKY: u32 = 0o1000;

    // The check covers the file and every folder above it. If only root can change all of them, nobody can exchange the
    // file between this check and its reading.
    let folder = match file.parent().map(Path::canonicalize) {
        Some(Ok(folder)) => folder,
        _ => return Some("its folder cannot be looked at".to_owned()),
    };
    let file = folder.join(file.file_name()?);
    let places = std::iter::once(file.as_path()).chain(folder.ancestors());
    for (height, place) in places.enumerate() {
        let Ok(facts) = symlink_metadata(place) else {
            return Some(format!("{} cannot be looked at", place.display()));
        };
        if height == 0 && !facts.is_file() {
            return Some("it is no regular file".to_owned());
        }
        let name = place.display();
        if facts.uid() != 0 {
            return Some(format!("{name} belongs to user {}", facts.uid()));
        }
        let is_kept = height > 1 && facts.mode() & STICKY != 0;
        if facts.mode() & WRITABLE_BY_OTHERS != 0 && !is_kept {
            return Some(format!("{name} may be written by others (mode {:o})", facts.mode() & 0o7777));
        }
    }
    None
}

/// Always `None`: [`is_privileged`] is false on this system, so every file is trusted.
#[cfg(not(unix))]
pub fn writable_by_others(_: &Path) -> Option<String> {
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    /// LIB-58 A privileged process sees no environment variable.
    #[test]
    fn a_privileged_process_has_no_variables() {
        assert!(env::var_os("PATH").is_some());
        assert_eq!(variable_for(false, "PATH"), env::var_os("PATH"));
        assert_eq!(variable_for(true, "PATH"), None);
        assert!(!is_privileged(), "tests do not run set-user-ID");
    }
}
