//! Unloading. Threads of an open board run code of this library, and no thread can be ended while Windows unloads it: each
//! open board holds a reference to the module, as if it had been loaded once more, and gives it back when it is closed and
//! its threads are gone.
//!
//! That reference may be the last one, if the program called FreeLibrary before. Then the module must not go while a thread
//! is in it. Who closes a board gives it back with the last instruction of the call, and returns from Windows' loader
//! straight to the program ([`leaving`](super::leaving)); if other calls are under way, a thread of its own does it when
//! they have left.

use std::ffi::c_void;
use std::ptr::null_mut;
use std::sync::atomic::{AtomicUsize, Ordering};

use windows_sys::Win32::Foundation::{CloseHandle, GetLastError, HMODULE, SetLastError};
use windows_sys::Win32::System::LibraryLoader::{
    FreeLibraryAndExitThread, GET_MODULE_HANDLE_EX_FLAG_FROM_ADDRESS, GET_MODULE_HANDLE_EX_FLAG_PIN,
    GET_MODULE_HANDLE_EX_FLAG_UNCHANGED_REFCOUNT, GetModuleHandleExW,
};
use windows_sys::Win32::System::Threading::{CreateThread, Sleep};

/// After the last call has said that it leaves, it needs this long for its last instructions, however busy the machine
/// is. \[OURS]
const LAST_INSTRUCTIONS_MS: u32 = 500;
/// How often is looked whether calls have left.
const LOOK_MS: u32 = 1;

/// Calls under way in this library.
static CALLS: AtomicUsize = AtomicUsize::new(0);
/// References of boards that are closed.
static TO_GIVE_BACK: AtomicUsize = AtomicUsize::new(0);

/// Keeps this library in memory until it is dropped; the reference itself is given back at the end of the call that
/// drops it.
pub struct Stay {
    taken: bool,
}

impl Stay {
    /// Takes a reference.
    pub fn begin() -> Self {
        keep_winsock();
        let taken = module(GET_MODULE_HANDLE_EX_FLAG_FROM_ADDRESS).is_some();
        if !taken {
            // It is a module, so this does not happen; it must then just not be unloaded while a board is open.
            log::warn!("Windows does not find this library among those loaded");
        }
        Self { taken }
    }
}

impl Drop for Stay {
    fn drop(&mut self) {
        if self.taken {
            TO_GIVE_BACK.fetch_add(1, Ordering::SeqCst);
        }
    }
}

/// What an exported function that closes a board leaves with: a code of the C ABI, or the module. Modules lie at multiples
/// of 64 KiB, where no code is.
pub type Leaving = usize;

/// The module that this code lies in: the DLL, or the program with the static library.
pub fn this_module() -> Option<HMODULE> {
    module(GET_MODULE_HANDLE_EX_FLAG_FROM_ADDRESS | GET_MODULE_HANDLE_EX_FLAG_UNCHANGED_REFCOUNT)
}

fn module(flags: u32) -> Option<HMODULE> {
    let mut module = null_mut();
    let here = (&raw const CALLS).cast();
    // SAFETY: with FROM_ADDRESS the name is an address, here one of this module; `module` has room for the answer.
    let found = unsafe { GetModuleHandleExW(flags, here, &raw mut module) } != 0;
    found.then_some(module)
}

/// Has Windows keep its sockets' library until the process ends. Sockets that were opened once belong to it; unloaded with this
/// library and loaded again, it opens none any more (under Wine).
fn keep_winsock() {
    let name: Vec<u16> = "ws2_32.dll\0".encode_utf16().collect();
    let mut module = null_mut();
    // SAFETY: the name ends with 0; `module` has room for the answer, which is of no interest: it is loaded, for this
    // library imports it.
    unsafe { GetModuleHandleExW(GET_MODULE_HANDLE_EX_FLAG_PIN, name.as_ptr(), &raw mut module) };
}

/// A call, from when it comes in until it is about to leave.
pub struct Call;

impl Call {
    /// It comes in.
    pub fn begin() -> Self {
        CALLS.fetch_add(1, Ordering::SeqCst);
        Self
    }
}

impl Drop for Call {
    fn drop(&mut self) {
        CALLS.fetch_sub(1, Ordering::SeqCst);
        give_back_by_threads();
    }
}

/// Windows' last error as the caller has it; it is put back when this is dropped. What a call of the vendor's functions leaves
/// there instead is set after that ([`last_error`](crate::last_error)).
pub struct LastError(u32);

impl LastError {
    /// Notes it.
    pub fn keep() -> Self {
        // SAFETY: it has no conditions.
        Self(unsafe { GetLastError() })
    }
}

impl Drop for LastError {
    fn drop(&mut self) {
        // SAFETY: as above.
        unsafe { SetLastError(self.0) };
    }
}

/// What the caller's GetLastError is to give, set as the last thing of a call.
pub fn set_last_error(code: u32) {
    // SAFETY: it has no conditions.
    unsafe { SetLastError(code) };
}

/// Runs `close` as a call. Gives its code, or instead of `ECMSK_OK` the module if the caller is to give back a reference
/// to it as its last deed.
///
/// Only a call that was alone all the time may do that: another one might have instructions of its own left to run.
pub fn close(close: impl FnOnce() -> i32) -> Leaving {
    let alone = CALLS.fetch_add(1, Ordering::SeqCst) == 0;
    let code = close();
    let alone = CALLS.fetch_sub(1, Ordering::SeqCst) == 1 && alone;
    let take_one = || TO_GIVE_BACK.fetch_update(Ordering::SeqCst, Ordering::SeqCst, |count| count.checked_sub(1));
    let module = if code == 0 && alone && take_one().is_ok() { this_module() } else { None };
    UNLOAD.store(LdrUnloadDll as *const () as usize, Ordering::SeqCst);
    give_back_by_threads();
    module.map_or(code as usize, |module| module.addr())
}

/// Has references given back by threads, if there are any.
fn give_back_by_threads() {
    if TO_GIVE_BACK.load(Ordering::SeqCst) == 0 {
        return;
    }
    for _ in 0..TO_GIVE_BACK.swap(0, Ordering::SeqCst) {
        // SAFETY: the function is of this library, which the reference keeps in memory until that thread ends.
        let thread = unsafe { CreateThread(null_mut(), 0, Some(when_all_have_left), null_mut(), 0, null_mut()) };
        // No thread, no unloading: better than unloading under somebody.
        if !thread.is_null() {
            // SAFETY: our own handle, used nowhere else.
            unsafe { CloseHandle(thread) };
        }
    }
}

unsafe extern "system" fn when_all_have_left(_: *mut c_void) -> u32 {
    while CALLS.load(Ordering::SeqCst) > 0 {
        // SAFETY: it has no conditions.
        unsafe { Sleep(LOOK_MS) };
    }
    // SAFETY: as above.
    unsafe { Sleep(LAST_INSTRUCTIONS_MS) };
    if let Some(module) = this_module() {
        // SAFETY: a reference of ours, given back once; it returns to no code of this module.
        unsafe { FreeLibraryAndExitThread(module, 0) };
    }
    0
}

#[cfg_attr(not(target_arch = "x86"), link(name = "ntdll", kind = "raw-dylib"))]
#[cfg_attr(target_arch = "x86", link(name = "ntdll", kind = "raw-dylib", import_name_type = "undecorated"))]
unsafe extern "system" {
    /// What FreeLibrary calls; it gives 0 if all is well, as this library's functions do.
    fn LdrUnloadDll(module: *mut c_void) -> i32;
}

/// Its address, from when there is a module to be unloaded: an import has none before the program runs.
pub static UNLOAD: AtomicUsize = AtomicUsize::new(0);

/// The body of an exported function that closes a board, given the function which does so and gives what
/// [`close`] gives.
#[cfg(target_arch = "x86_64")]
macro_rules! leaving {
    ($close:path $(, $_argument:ident)?) => {
        std::arch::naked_asm!(
            "sub rsp, 40", // the callee's home for arguments, and the stack aligned
            "call {close}",
            "add rsp, 40",
            "test ax, ax", // a code, and not 0?
            "jnz 2f",
            "test rax, rax", // 0?
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

/// As above. An argument is a word on the caller's stack, which is handed on.
#[cfg(target_arch = "x86")]
macro_rules! leaving {
    ($close:path) => {
        $crate::module::leaving!(@ $close, "nop", "nop")
    };
    ($close:path, $_argument:ident) => {
        $crate::module::leaving!(@ $close, "push dword ptr [esp + 4]", "pop ecx")
    };
    (@ $close:path, $before:literal, $after:literal) => {
        std::arch::naked_asm!(
            $before,
            "call {close}",
            $after,
            "test ax, ax", // a code, and not 0?
            "jnz 2f",
            "test eax, eax", // 0?
            "jz 2f",
            "pop ecx", // where to return to; the module goes in front of it
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

pub(crate) use leaving;
