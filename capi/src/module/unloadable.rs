//! Unloading of this library's module by Windows. The threads of an open board run code of the module, and they cannot be
//! ended while Windows unloads it. So each open board holds a reference to the module, as if it had been loaded once more, and
//! releases it when the board is closed and its threads have ended.
//!
//! If the program has called FreeLibrary before, that reference is the last one, and releasing it unloads the module, in which
//! no thread may be then. The call that closes the board therefore releases the reference with its last instruction, a jump
//! into Windows' loader, which returns straight to the program ([`close_and_unload`](super::close_and_unload)). If other
//! calls are under way a separate thread releases it after they have returned.

use std::ffi::c_void;
use std::ptr::null_mut;
use std::sync::atomic::{AtomicUsize, Ordering};

use windows_sys::Win32::Foundation::{CloseHandle, GetLastError, HMODULE, SetLastError};
use windows_sys::Win32::System::LibraryLoader::{
    FreeLibraryAndExitThread, GET_MODULE_HANDLE_EX_FLAG_FROM_ADDRESS, GET_MODULE_HANDLE_EX_FLAG_PIN,
    GET_MODULE_HANDLE_EX_FLAG_UNCHANGED_REFCOUNT, GetModuleHandleExW,
};
use windows_sys::Win32::System::Threading::{CreateThread, Sleep};

/// How long a call takes at most, on a busy machine, to execute its last instructions in this module after it was counted
/// as ended. The module must not be unloaded before. \[OURS]
const RETURN_MS: u32 = 500;
/// The interval at which a waiting thread checks whether all calls have returned.
const CHECK_INTERVAL_MS: u32 = 1;
/// The maximum number of checks, one per ms, of a thread that waits until all calls have returned. After 10 s it gives up, and
/// the module stays loaded: a call whose thread was ended by force never returns. \[OURS]
const CHECKS_MAX: u32 = 10_000;

/// How many calls are under way in this module, which must not be unloaded meanwhile.
static CALLS: AtomicUsize = AtomicUsize::new(0);
/// How many references of closed boards are still to be released.
static REFERENCES_TO_RELEASE: AtomicUsize = AtomicUsize::new(0);

/// A reference to this module, which keeps it in memory. After this is dropped, the reference is released at the end of
/// the call that closes the board.
pub struct ModuleReference {
    taken: bool,
}

impl ModuleReference {
    /// Acquires a reference to this module.
    pub fn begin() -> Self {
        pin_winsock();
        let taken = module(GET_MODULE_HANDLE_EX_FLAG_FROM_ADDRESS).is_some();
        if !taken {
            // This cannot happen, since this code is in a module. If it did, the module must not be unloaded while a board is
            // open.
            log::warn!("Windows does not find this library among those loaded");
        }
        Self { taken }
    }
}

impl Drop for ModuleReference {
    fn drop(&mut self) {
        if self.taken {
            REFERENCES_TO_RELEASE.fetch_add(1, Ordering::SeqCst);
        }
    }
}

/// What the inner function of an exported function that closes a board returns: a result code of the C ABI, or the address of
/// this module if it is to be unloaded. The addresses of modules are multiples of 64 KiB, and no result code is.
pub type CloseResult = usize;

/// The module that contains this code: the DLL, or the program that links the static library.
pub fn this_module() -> Option<HMODULE> {
    module(GET_MODULE_HANDLE_EX_FLAG_FROM_ADDRESS | GET_MODULE_HANDLE_EX_FLAG_UNCHANGED_REFCOUNT)
}

fn module(flags: u32) -> Option<HMODULE> {
    let mut module = null_mut();
    let here = (&raw const CALLS).cast();
    // SAFETY: with FROM_ADDRESS the name is an address, here one in this module; `module` receives the answer.
    let found = unsafe { GetModuleHandleExW(flags, here, &raw mut module) } != 0;
    found.then_some(module)
}

/// Keeps Windows' socket library loaded until the process ends. Under Wine, if it is unloaded together with this module and
/// loaded again, it opens no more sockets.
fn pin_winsock() {
    let name: Vec<u16> = "ws2_32.dll\0".encode_utf16().collect();
    let mut module = null_mut();
    // SAFETY: the name ends with 0; `module` receives the answer. This module imports that library, so it is loaded.
    unsafe { GetModuleHandleExW(GET_MODULE_HANDLE_EX_FLAG_PIN, name.as_ptr(), &raw mut module) };
}

/// A call of an exported function that is under way.
pub struct Call;

impl Call {
    /// Counts a call as under way until the returned value is dropped.
    pub fn begin() -> Self {
        CALLS.fetch_add(1, Ordering::SeqCst);
        Self
    }
}

impl Drop for Call {
    fn drop(&mut self) {
        CALLS.fetch_sub(1, Ordering::SeqCst);
        release_references_by_threads();
    }
}

/// The last error of Windows at the beginning of a call. It is restored when this is dropped, so that the functions that the
/// call uses do not change it. The error code of a vendor's function is set after that ([`last_error`](crate::last_error)).
pub struct LastError(u32);

impl LastError {
    /// Remembers the last error at the beginning of a call.
    pub fn keep() -> Self {
        // SAFETY: the function has no conditions.
        Self(unsafe { GetLastError() })
    }
}

impl Drop for LastError {
    fn drop(&mut self) {
        // SAFETY: as above.
        unsafe { SetLastError(self.0) };
    }
}

/// Sets what GetLastError returns to the caller. This must be the last step of a call, because functions of Windows that are
/// called after it may change the code.
pub fn set_last_error(code: u32) {
    // SAFETY: the function has no conditions.
    unsafe { SetLastError(code) };
}

/// Runs `close`, the body of an exported function that closes a board, and counts it as a call under way. Returns its result
/// code or, instead of `ECMSK_OK`, the address of the module if the exported function has to release a reference to the module
/// with its last instruction.
///
/// That is allowed only if no other call was under way at the beginning and at the end of this one: another call might
/// still have instructions in this module to execute.
pub fn close(close: impl FnOnce() -> i32) -> CloseResult {
    let alone = CALLS.fetch_add(1, Ordering::SeqCst) == 0;
    let code = close();
    let alone = CALLS.fetch_sub(1, Ordering::SeqCst) == 1 && alone;
    let take_one =
        || REFERENCES_TO_RELEASE.fetch_update(Ordering::SeqCst, Ordering::SeqCst, |count| count.checked_sub(1));
    let module = if code == 0 && alone && take_one().is_ok() { this_module() } else { None };
    UNLOAD.store(LdrUnloadDll as *const () as usize, Ordering::SeqCst);
    release_references_by_threads();
    module.map_or(code as usize, |module| module.addr())
}

/// Starts a thread for each reference that is to be released. The thread releases it when all calls have returned.
fn release_references_by_threads() {
    if REFERENCES_TO_RELEASE.load(Ordering::SeqCst) == 0 {
        return;
    }
    for _ in 0..REFERENCES_TO_RELEASE.swap(0, Ordering::SeqCst) {
        // SAFETY: the function is in this module, which the reference keeps in memory until the thread ends.
        let thread = unsafe { CreateThread(null_mut(), 0, Some(release_when_calls_ended), null_mut(), 0, null_mut()) };
        // If the system gives no thread the module stays loaded, which is better than unloading it under a running call.
        if !thread.is_null() {
            // SAFETY: the handle is closed here only.
            unsafe { CloseHandle(thread) };
        }
    }
}

unsafe extern "system" fn release_when_calls_ended(_: *mut c_void) -> u32 {
    for checks in 0.. {
        if CALLS.load(Ordering::SeqCst) == 0 {
            break;
        }
        if checks == CHECKS_MAX {
            return 0;
        }
        // SAFETY: the function has no conditions.
        unsafe { Sleep(CHECK_INTERVAL_MS) };
    }
    // SAFETY: as above.
    unsafe { Sleep(RETURN_MS) };
    if let Some(module) = this_module() {
        // SAFETY: the reference was acquired by `ModuleReference` and is released once; the function does not return.
        unsafe { FreeLibraryAndExitThread(module, 0) };
    }
    0
}

#[cfg_attr(not(target_arch = "x86"), link(name = "ntdll", kind = "raw-dylib"))]
#[cfg_attr(target_arch = "x86", link(name = "ntdll", kind = "raw-dylib", import_name_type = "undecorated"))]
unsafe extern "system" {
    /// The function of Windows' loader that FreeLibrary calls. It returns 0 for success, as the functions of this library
    /// do, so that a closing function can jump to it instead of returning.
    fn LdrUnloadDll(module: *mut c_void) -> i32;
}

/// The address of `LdrUnloadDll`, for the assembly code of `close_and_unload!`. [`close`] sets it before that code reads
/// it, since the address of an import is known only at run time.
pub static UNLOAD: AtomicUsize = AtomicUsize::new(0);

/// The body of an exported function that closes a board. It calls `$close`, which returns what [`close`] returns, and jumps
/// to `LdrUnloadDll` if that is a module.
#[cfg(target_arch = "x86_64")]
macro_rules! close_and_unload {
    ($close:path $(, $_argument:ident)?) => {
        std::arch::naked_asm!(
            "sub rsp, 40", // the callee's shadow space for arguments, and alignment of the stack
            "call {close}",
            "add rsp, 40",
            "test ax, ax", // an error code?
            "jnz 2f",
            "test rax, rax", // ECMSK_OK?
            "jz 2f",
            "mov rcx, rax",
            "jmp qword ptr [rip + {unload}]",
            "2:",
            "ret",
            close = sym $close,
            unload = sym $crate::module::UNLOAD,
        )
    };
}

/// `close_and_unload!` for 32-bit x86. An argument of the exported function is a word on the caller's stack, which is
/// pushed again for `$close`.
#[cfg(target_arch = "x86")]
macro_rules! close_and_unload {
    ($close:path) => {
        $crate::module::close_and_unload!(@ $close, "nop", "nop")
    };
    ($close:path, $_argument:ident) => {
        $crate::module::close_and_unload!(@ $close, "push dword ptr [esp + 4]", "pop ecx")
    };
    (@ $close:path, $before:literal, $after:literal) => {
        std::arch::naked_asm!(
            $before,
            "call {close}",
            $after,
            "test ax, ax", // an error code?
            "jnz 2f",
            "test eax, eax", // ECMSK_OK?
            "jz 2f",
            "pop ecx", // the return address; the module becomes the argument after it
            "push eax",
            "push ecx",
            "jmp dword ptr [{unload}]",
            "2:",
            "ret",
            close = sym $close,
            unload = sym $crate::module::UNLOAD,
        )
    };
}

pub(crate) use close_and_unload;
