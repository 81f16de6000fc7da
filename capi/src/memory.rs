//! A system that has no memory left. Rust ends a process whose request for memory fails, and a program that moves axes must
//! not end because of that. So the calls that need much memory, which are Open and the first write and the first read of a
//! thread, first check whether there is enough, and fail if there is not. Later calls need none.

use std::alloc::{Layout, alloc, dealloc};
use std::ptr::null_mut;
use std::sync::atomic::{AtomicPtr, Ordering};

use crate::error::CallError;

/// The maximum memory that opening a board takes, in bytes: its queues, its slaves, the connection to a server, and the
/// stacks of its threads. \[OURS]
pub(crate) const OPEN_BYTES: usize = 16 * 1024 * 1024;
/// The maximum memory that the first call of a thread takes, in bytes. \[OURS]
pub(crate) const FIRST_CALL_BYTES: usize = 256 * 1024;

/// Memory that is reserved for a call that fails because there is no more: for its error and the error's text. \[OURS]
const KEPT: Layout = Layout::new::<[u8; 64 * 1024]>();
static KEPT_AT: AtomicPtr<u8> = AtomicPtr::new(null_mut());

/// Checks that `bytes` bytes of memory are available.
///
/// # Errors
/// [`CallError::Memory`]: the system has less. The memory that was reserved for errors is released then.
pub fn check(bytes: usize) -> Result<(), Box<CallError>> {
    if keep() && can_be_had(bytes) {
        return Ok(());
    }
    let kept = KEPT_AT.swap(null_mut(), Ordering::AcqRel);
    if !kept.is_null() {
        // SAFETY: it came from `keep` with this layout, and nobody else has it now.
        unsafe { dealloc(kept, KEPT) };
    }
    Err(CallError::Memory.into())
}

#[cfg(not(windows))]
fn can_be_had(bytes: usize) -> bool {
    let mut wanted = Vec::<u8>::new();
    let can_be = wanted.try_reserve_exact(bytes).is_ok();
    // Keeps the compiler from removing the allocation.
    std::hint::black_box(wanted.as_ptr());
    can_be
}

/// Requests the memory from the system and not from the heap. The heap would give freed pages back to the system, and the
/// allocations of the call would have to request them again.
#[cfg(windows)]
fn can_be_had(bytes: usize) -> bool {
    use std::ptr::null;
    use windows_sys::Win32::System::Memory::{
        MEM_COMMIT, MEM_RELEASE, MEM_RESERVE, PAGE_READWRITE, VirtualAlloc, VirtualFree,
    };

    // SAFETY: memory anywhere, which is given back and was used by nobody.
    unsafe {
        let wanted = VirtualAlloc(null(), bytes, MEM_RESERVE | MEM_COMMIT, PAGE_READWRITE);
        !wanted.is_null() && VirtualFree(wanted, 0, MEM_RELEASE) != 0
    }
}

/// Reserves the memory for errors. Returns false if there is not enough memory to reserve.
fn keep() -> bool {
    if !KEPT_AT.load(Ordering::Acquire).is_null() {
        return true;
    }
    // SAFETY: the layout has a size.
    let new = unsafe { alloc(KEPT) };
    if new.is_null() {
        return false;
    }
    if KEPT_AT.compare_exchange(null_mut(), new, Ordering::AcqRel, Ordering::Acquire).is_err() {
        // Another thread has reserved the memory at the same time, so the memory of this thread is not needed.
        // SAFETY: it was made above and nobody else has it.
        unsafe { dealloc(new, KEPT) };
    }
    true
}

/// The loader calls the functions in the section `.init_array` when it loads the library, while there is still memory.
#[cfg(target_os = "linux")]
#[used]
#[unsafe(link_section = ".init_array")]
static AT_START: extern "C" fn() = at_start;

#[cfg(target_os = "linux")]
extern "C" fn at_start() {
    keep();
}

#[cfg(test)]
mod tests {
    use super::*;

    /// LIB-72 More memory than there can be is an error, and the next call checks again.
    #[test]
    fn what_is_not_there_is_an_error() {
        for _ in 0..3 {
            assert_eq!(check(usize::MAX / 4), Err(CallError::Memory.into()));
            assert_eq!(check(FIRST_CALL_BYTES), Ok(()));
        }
    }
}
