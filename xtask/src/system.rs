//! Operations on files and processors that exist only on Unix. `cargo xtask ci --fast` and the parts that it runs do not use
//! them, so that they run on Windows too.

#[cfg(unix)]
pub use unix::{lead_a_group, mode_of, path_of, set_mode, stay_on_one_processor, symlink};
#[cfg(not(unix))]
pub use without::{lead_a_group, mode_of, path_of, set_mode, stay_on_one_processor, symlink};

#[cfg(unix)]
mod unix {
    use std::ffi::OsStr;
    use std::fs::{self, Permissions};
    use std::io;
    use std::os::unix::ffi::OsStrExt;
    use std::os::unix::fs::PermissionsExt;
    use std::os::unix::process::CommandExt;
    use std::path::{Path, PathBuf};
    use std::process::Command;

    use rustix::thread::{CpuSet, sched_getaffinity, sched_setaffinity};

    pub use std::os::unix::fs::symlink;

    /// The mode of a file, as chmod has it.
    pub fn mode_of(metadata: &fs::Metadata) -> u32 {
        metadata.permissions().mode() & 0o7777
    }

    /// Sets the mode of a file, as chmod does.
    pub fn set_mode(path: &Path, mode: u32) -> io::Result<()> {
        fs::set_permissions(path, Permissions::from_mode(mode))
    }

    /// Makes the command the leader of a new process group.
    pub fn lead_a_group(command: &mut Command) {
        command.process_group(0);
    }

    /// Converts bytes from the output of a program to a path.
    pub fn path_of(bytes: &[u8]) -> PathBuf {
        PathBuf::from(OsStr::from_bytes(bytes))
    }

    /// Restricts this program, and all that it starts from now on, to the first processor that it may use.
    pub fn stay_on_one_processor() -> io::Result<()> {
        let allowed = sched_getaffinity(None)?;
        let mut one = CpuSet::new();
        (0..CpuSet::MAX_CPU).find(|cpu| allowed.is_set(*cpu)).into_iter().for_each(|cpu| one.set(cpu));
        Ok(sched_setaffinity(None, &one)?)
    }
}

#[cfg(not(unix))]
mod without {
    use std::fs;
    use std::io;
    use std::path::{Path, PathBuf};

    fn unsupported() -> io::Error {
        io::Error::new(io::ErrorKind::Unsupported, "this chore runs on Linux")
    }

    pub fn mode_of(_: &fs::Metadata) -> u32 {
        0o644
    }

    pub fn set_mode(_: &Path, _: u32) -> io::Result<()> {
        Err(unsupported())
    }

    pub fn symlink(_: impl AsRef<Path>, _: impl AsRef<Path>) -> io::Result<()> {
        Err(unsupported())
    }

    pub fn lead_a_group(_: &mut std::process::Command) {}

    pub fn path_of(bytes: &[u8]) -> PathBuf {
        PathBuf::from(String::from_utf8_lossy(bytes).into_owned())
    }

    pub fn stay_on_one_processor() -> io::Result<()> {
        Err(unsupported())
    }
}
