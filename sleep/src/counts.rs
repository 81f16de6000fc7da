//! The counters that `ecmsk exec` reports at the end: five numbers of 8 bytes, in the machine's byte order, in a file
//! that the tool has created. All processes of the program share the file.

use std::ffi::CString;
use std::os::unix::ffi::OsStringExt;
use std::sync::atomic::{AtomicPtr, AtomicU64, Ordering};

/// The environment variable with the path of the file with the counters.
const VARIABLE: &str = "ECMSK_SLEEP_COUNTS";

/// The counters in the file.
#[repr(C)]
struct Counts {
    /// How many processes have loaded this library.
    loads: AtomicU64,
    /// How many waits were passed on the virtual clock.
    waits: AtomicU64,
    /// The latest virtual time that any process has reached, in nanoseconds.
    time: AtomicU64,
    /// The number of opened boards that run on virtual time.
    boards: AtomicU64,
    /// The number of opened boards that do not run on virtual time.
    others: AtomicU64,
}

static COUNTS: AtomicPtr<Counts> = AtomicPtr::new(std::ptr::null_mut());

/// Maps the file into memory. Without a file nothing is counted.
pub fn open() {
    let Some(path) = std::env::var_os(VARIABLE).and_then(|path| CString::new(path.into_vec()).ok()) else { return };
    // SAFETY: the path ends with 0.
    let file = unsafe { libc::open(path.as_ptr(), libc::O_RDWR | libc::O_CLOEXEC | libc::O_NOFOLLOW) };
    if file < 0 {
        return;
    }
    let length = size_of::<Counts>();
    // SAFETY: the structure and the file exist. An error leaves the size 0.
    let is_whole = unsafe {
        let mut about: libc::stat = std::mem::zeroed();
        libc::fstat(file, &raw mut about) == 0 && about.st_size >= length as libc::off_t
    };
    if is_whole {
        let access = libc::PROT_READ | libc::PROT_WRITE;
        // SAFETY: the system chooses the address, and the file has that length.
        let place = unsafe { libc::mmap(std::ptr::null_mut(), length, access, libc::MAP_SHARED, file, 0) };
        if place != libc::MAP_FAILED {
            COUNTS.store(place.cast(), Ordering::Release);
        }
    }
    // SAFETY: opened above, and the mapping does not need it.
    unsafe { libc::close(file) };
    if let Some(counts) = counts() {
        counts.loads.fetch_add(1, Ordering::Relaxed);
    }
}

fn counts() -> Option<&'static Counts> {
    // SAFETY: null, or the mapping, which stays until the process ends; all of it is atomic.
    unsafe { COUNTS.load(Ordering::Acquire).as_ref() }
}

/// Counts a wait on the virtual clock.
pub fn wait() {
    if let Some(counts) = counts() {
        counts.waits.fetch_add(1, Ordering::Relaxed);
    }
}

/// Records that the virtual clock has reached `now`, in nanoseconds.
pub fn time(now: u64) {
    if let Some(counts) = counts() {
        counts.time.fetch_max(now, Ordering::Relaxed);
    }
}

/// Counts a board that was opened.
pub fn board(is_virtual: bool) {
    if let Some(counts) = counts() {
        let count = if is_virtual { &counts.boards } else { &counts.others };
        count.fetch_add(1, Ordering::Relaxed);
    }
}
