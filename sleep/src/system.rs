//! The functions of the C library that this library replaces, and system calls.

use std::ffi::{CStr, c_void};
use std::sync::atomic::{AtomicPtr, AtomicU32, Ordering};
use std::time::Duration;

/// The version of condition variables in the GNU C library for x86-64 since 2003. Without a version, dlsym may find the
/// older one, which has another layout.
const CONDITION_VERSION: &CStr = c"GLIBC_2.3.2";

/// The function of this name in the libraries that are searched after this one, cached in `found`; null if there is
/// none.
pub fn next(found: &AtomicPtr<c_void>, name: &CStr) -> *mut c_void {
    let known = found.load(Ordering::Acquire);
    if !known.is_null() {
        return known;
    }
    let mut function = std::ptr::null_mut();
    if name.to_bytes().starts_with(b"pthread_cond_") {
        // SAFETY: both are texts that end with 0.
        function = unsafe { libc::dlvsym(libc::RTLD_NEXT, name.as_ptr(), CONDITION_VERSION.as_ptr()) };
    }
    if function.is_null() {
        // SAFETY: the name is a text that ends with 0.
        function = unsafe { libc::dlsym(libc::RTLD_NEXT, name.as_ptr()) };
    }
    found.store(function, Ordering::Release);
    function
}

/// Calls the C library's function: `real!(usleep(micros: libc::useconds_t) -> c_int)`. If the C library does not have
/// it, as an older one may, the value is -1.
macro_rules! real {
    ($name:ident($($argument:ident: $kind:ty),*) -> $result:ty) => {{
        static FOUND: std::sync::atomic::AtomicPtr<std::ffi::c_void> =
            std::sync::atomic::AtomicPtr::new(std::ptr::null_mut());
        const NAME: &std::ffi::CStr =
            match std::ffi::CStr::from_bytes_with_nul(concat!(stringify!($name), "\0").as_bytes()) {
                Ok(name) => name,
                Err(_) => panic!("a name with 0 in it"),
            };
        let function = $crate::system::next(&FOUND, NAME);
        if function.is_null() {
            (-1_i32) as $result
        } else {
            type Function = unsafe extern "C-unwind" fn($($kind),*) -> $result;
            // SAFETY: the C library's function of that name has this type, as its headers declare it. The arguments are
            // those of this library's function of the same name, whose caller keeps to the rules of the C library's.
            unsafe { std::mem::transmute::<*mut std::ffi::c_void, Function>(function)($($argument),*) }
        }
    }};
}
pub(crate) use real;

/// The time of a clock of the system in nanoseconds; 0 if there is no such clock.
pub fn real_ns(clock: libc::clockid_t) -> u64 {
    let mut time = libc::timespec { tv_sec: 0, tv_nsec: 0 };
    let to = &raw mut time;
    real!(clock_gettime(clock: libc::clockid_t, to: *mut libc::timespec) -> std::ffi::c_int);
    nanoseconds(&time).unwrap_or(0)
}

/// A time in nanoseconds, at most 2^64 - 1. `None` if the time is negative, or if its nanoseconds are not less than a
/// second.
pub fn nanoseconds(time: &libc::timespec) -> Option<u64> {
    let part = u64::try_from(time.tv_nsec).ok().filter(|part| *part < 1_000_000_000)?;
    Some(u64::try_from(time.tv_sec).ok()?.saturating_mul(1_000_000_000).saturating_add(part))
}

/// Converts nanoseconds to a `timespec`.
pub fn timespec(ns: u64) -> libc::timespec {
    // Both fit into 64 bits with a sign: seconds of 2^64 ns are fewer than 2^35.
    libc::timespec { tv_sec: (ns / 1_000_000_000) as libc::time_t, tv_nsec: (ns % 1_000_000_000) as libc::c_long }
}

/// Waits on the real clock until [`wake`] is called for the word, at most `limit`. Does not wait if the word is no
/// longer `seen`. Returns whether a signal handler has run.
pub fn wait_on(word: &AtomicU32, seen: u32, limit: Duration) -> bool {
    let limit = timespec(u64::try_from(limit.as_nanos()).unwrap_or(u64::MAX));
    let operation = libc::FUTEX_WAIT | libc::FUTEX_PRIVATE_FLAG;
    // SAFETY: the word and the limit exist during the call.
    let done = unsafe { libc::syscall(libc::SYS_futex, word.as_ptr(), operation, seen, &raw const limit) };
    done == -1 && crate::mode::errno() == libc::EINTR
}

/// Ends the wait of the thread that waits on the word.
pub fn wake(word: &AtomicU32) {
    word.fetch_add(1, Ordering::Release);
    // SAFETY: the word exists during the call.
    unsafe { libc::syscall(libc::SYS_futex, word.as_ptr(), libc::FUTEX_WAKE | libc::FUTEX_PRIVATE_FLAG, 1) };
}

/// The word at an address at which a thread of the program waits, as for futex(2).
pub fn word_at(address: usize) -> u32 {
    // SAFETY: by the rules of futex(2), the waiting thread has given the address of an aligned word, which exists while
    // it waits.
    unsafe { (*(address as *const AtomicU32)).load(Ordering::Acquire) }
}

/// The kernel's id of this thread.
pub fn thread_number() -> i32 {
    // SAFETY: the call has no arguments and cannot fail. The id is a positive number of 32 bits.
    unsafe { libc::syscall(libc::SYS_gettid) as i32 }
}
