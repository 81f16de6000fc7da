//! Programs that run with more rights than the user who starts them: set-user-ID, set-group-ID, file capabilities. A link
//! may have a file made (`record=`) or read (`script=`), so what that user makes or sets decides nothing there.
//!
//! \[OURS] The rule: no variable counts that this library reads, and an `ecmsk.toml` counts only if nobody but root can have
//! written it ([`made_by_others`]).

use std::env;
use std::ffi::OsString;
use std::path::Path;

/// Whether this process has more rights than the user who started it. It stays so, whatever rights it gives up.
///
/// Source: `AT_SECURE` of getauxval(3) on Linux, which is what the dynamic linker and `secure_getenv` go by.
pub fn is_privileged() -> bool {
    #[cfg(any(target_os = "linux", target_os = "android"))]
    {
        // SAFETY: it has no conditions.
        (unsafe { libc::getauxval(libc::AT_SECURE) }) != 0
    }
    #[cfg(all(unix, not(any(target_os = "linux", target_os = "android"))))]
    {
        // SAFETY: none of them has conditions.
        unsafe { libc::getuid() != libc::geteuid() || libc::getgid() != libc::getegid() }
    }
    #[cfg(not(unix))]
    {
        false
    }
}

/// A variable of the environment; in a privileged process none is set. The library reads its variables by this alone.
pub fn variable(name: &str) -> Option<OsString> {
    variable_for(is_privileged(), name)
}

fn variable_for(privileged: bool, name: &str) -> Option<OsString> {
    if privileged { None } else { env::var_os(name) }
}

/// Why somebody else than root can have written a file which is there, or decided which file of root's that is; `None`:
/// nobody can.
///
/// The file has to be a regular one (no link: who made it would choose the file), it and its folder must be root's and
/// writable by root alone. The folders above have to be root's; they may be writable by others if these can neither rename
/// nor remove what is in them (the sticky bit, as `/tmp` has it).
#[cfg(unix)]
pub fn made_by_others(file: &Path) -> Option<String> {
    use std::fs::symlink_metadata;
    use std::os::unix::fs::MetadataExt;

    const WRITABLE_BY_OTHERS: u32 = 0o022;
    const STICKY: u32 = 0o1000;

    // Below folders that are root's alone nothing changes between this look and the reading of the file.
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

/// There are no such programs.
#[cfg(not(unix))]
pub fn made_by_others(_: &Path) -> Option<String> {
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    /// LIB-58 In a privileged process no variable is set.
    #[test]
    fn a_privileged_process_has_no_variables() {
        assert!(env::var_os("PATH").is_some());
        assert_eq!(variable_for(false, "PATH"), env::var_os("PATH"));
        assert_eq!(variable_for(true, "PATH"), None);
        assert!(!is_privileged(), "tests do not run set-user-ID");
    }
}
