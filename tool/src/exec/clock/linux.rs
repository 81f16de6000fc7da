//! Preloads the library for the virtual clock on Linux.

use std::fs::{self, File};
use std::io::Read;
use std::os::unix::ffi::OsStrExt;
use std::os::unix::fs::{MetadataExt, symlink};
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::exec::ExecError;
use crate::exec::library::LibraryFolder;
use crate::exec::link::program_file;
use crate::stderr::say;

/// The file name of the preloaded library.
pub const FILE_NAME: &str = "libecmsk_sleep.so";
/// The environment variable with the libraries that the dynamic linker loads before all others.
const PRELOAD: &str = "LD_PRELOAD";
/// The environment variable with the path of the file of counts, which the library reads.
const COUNTS_VARIABLE: &str = "ECMSK_SLEEP_COUNTS";
/// The number of 64-bit counts in that file: how often the library was loaded, the waits that it has passed on, the
/// time of the virtual clock in nanoseconds, the number of opened boards that follow the virtual clock, and of those
/// that do not. Must agree with `counts.rs` of the library.
const COUNTS: usize = 5;

/// The preloaded library and the file with its counts.
pub struct Preloaded {
    counts: PathBuf,
}

impl Preloaded {
    /// Makes `command` preload the library.
    pub fn set(command: &mut Command, library: &LibraryFolder) -> Result<Self, ExecError> {
        let failed = |source| ExecError::Folder { place: library.folder().to_owned(), source };
        // The entries of the variable are separated by whitespace or colons, so the path must not contain whitespace.
        if library.folder().as_os_str().as_bytes().iter().any(u8::is_ascii_whitespace) {
            return Err(ExecError::UnlinkableFolder { folder: library.folder().to_owned() });
        }
        let file = library.folder().join(FILE_NAME);
        symlink(find(library.library())?, &file).map_err(failed)?;
        let counts = library.folder().join(".slept");
        fs::write(&counts, [0; COUNTS * size_of::<u64>()]).map_err(failed)?;
        let mut all = file.into_os_string();
        if let Some(others) = std::env::var_os(PRELOAD).filter(|others| !others.is_empty()) {
            all.push(":");
            all.push(others);
        }
        command.env(PRELOAD, all).env(COUNTS_VARIABLE, &counts);
        Ok(Self { counts })
    }

    /// Prints messages after the end of the program: why the library had no effect, which boards did not follow the
    /// virtual clock, and with `is_verbose` what it has passed on. `is_opened`: NEXTWUSBLib was asked to open a board.
    pub fn say(self, program: &Path, is_verbose: bool, is_opened: bool) {
        let bytes = fs::read(&self.counts).unwrap_or_default();
        let mut numbers = bytes.as_chunks().0.iter().map(|bytes| u64::from_ne_bytes(*bytes));
        let [loads, waits, time_ns, boards, others] = [(); COUNTS].map(|()| numbers.next().unwrap_or(0));
        if loads == 0 {
            say("warning", &format_args!("{} {}: its waits take real time", program.display(), not_loaded(program)));
            return;
        }
        let shown = program.display();
        if others > 0 {
            let what = "that are not on virtual time, and do not follow its waits; give their links clock=virtual";
            say("warning", &format_args!("{shown} has opened boards ({others}) {what}"));
        }
        if waits == 0 {
            say(
                "note",
                &format_args!("{shown}: no wait was put on the virtual clock; if it has waited, that took real time"),
            );
        } else if boards + others == 0 && !is_opened {
            let what = "a board that the Rust crate or the Python package opens does not follow its waits";
            say("warning", &format_args!("{shown}: {what}"));
        }
        if is_verbose {
            let (seconds, micros) = (time_ns / 1_000_000_000, time_ns / 1_000 % 1_000_000);
            say("clock", &format_args!("{waits} waits, {seconds}.{micros:06} s of virtual time"));
        }
    }
}

/// Finds the preloaded library, which is in the folder of NEXTWUSBLib or in its sub-folder `ecmsk`. NEXTWUSBLib may be
/// a symbolic link.
fn find(library: &Path) -> Result<PathBuf, ExecError> {
    let files = [Some(library.to_owned()), fs::canonicalize(library).ok()];
    let mut places = files
        .into_iter()
        .flatten()
        .flat_map(|library| [library.with_file_name(FILE_NAME), library.with_file_name("ecmsk").join(FILE_NAME)]);
    places.find(|file| file.is_file()).ok_or_else(|| ExecError::NoSleepLibrary { library: library.to_owned() })
}

/// Why the dynamic linker did not load the library into the program.
fn not_loaded(program: &Path) -> &'static str {
    let file = program_file(program);
    let mode = file.as_ref().and_then(|file| fs::metadata(file).ok()).map_or(0, |about| about.mode());
    // The set-user-id and set-group-id bits.
    if mode & 0o6000 != 0 {
        return "runs with the rights of another user, into which nothing is preloaded";
    }
    match file.as_deref().and_then(is_static) {
        Some(true) => "is statically linked",
        _ => "has not loaded the library for --clock virtual",
    }
}

/// Whether a program is statically linked, so that it names no dynamic linker. `None` if it is no ELF program of this
/// width.
///
/// Source: the System V ABI, chapters 4 and 5 (ELF header, program header).
fn is_static(file: &Path) -> Option<bool> {
    /// The type of a program header that names the dynamic linker (PT_INTERP).
    const INTERPRETER: u32 = 3;
    let mut bytes = Vec::new();
    File::open(file).ok()?.take(64 << 10).read_to_end(&mut bytes).ok()?;
    // The ELF class must be 64-bit, as on this machine.
    if !bytes.starts_with(b"\x7fELF\x02") {
        return None;
    }
    let word = |at: usize| Some(u16::from_ne_bytes(*bytes.get(at..)?.first_chunk()?));
    let first = usize::try_from(u64::from_ne_bytes(*bytes.get(32..)?.first_chunk()?)).ok()?;
    let (size, count) = (usize::from(word(54)?), usize::from(word(56)?));
    let kind =
        |number: usize| Some(u32::from_ne_bytes(*bytes.get(first.checked_add(number * size)?..)?.first_chunk()?));
    Some((0..count).all(|number| kind(number) != Some(INTERPRETER)))
}
