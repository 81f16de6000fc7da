//! The connection to NEXTWUSBLib, whose boards advance with the virtual clock.

use std::sync::atomic::{AtomicPtr, Ordering};

use crate::mode::Own;
use crate::table::{GetTable, NAME, Table, VERSION};
use crate::{clock, counts, mode, threads};

static TABLE: Table = Table { version: VERSION, enter, leave, turn, now, reached, use_boards, opened };

/// The function that NEXTWUSBLib registers with [`Table::use_boards`]; null before.
static PASS: AtomicPtr<()> = AtomicPtr::new(std::ptr::null_mut());

/// Returns the table of functions for NEXTWUSBLib.
#[unsafe(no_mangle)]
pub extern "C" fn ecmsk_sleep_table() -> *const Table {
    &raw const TABLE
}

// NEXTWUSBLib looks the function up by this name and calls it by this type.
const _: (&std::ffi::CStr, GetTable) = (NAME, ecmsk_sleep_table);

extern "C" fn enter() {
    mode::count_library(1);
}

extern "C" fn leave() {
    mode::count_library(-1);
}

extern "C" fn turn() {
    let _own = Own::begin();
    threads::turn();
}

extern "C" fn now() -> u64 {
    clock::now()
}

extern "C" fn reached(time: u64) {
    let _own = Own::begin();
    clock::reach(time);
}

extern "C" fn use_boards(pass: extern "C" fn(u64)) {
    PASS.store(pass as *mut (), Ordering::Release);
}

extern "C" fn opened(is_virtual: bool) {
    counts::board(is_virtual);
}

/// Lets the time of all boards pass up to `time`, in nanoseconds of the virtual clock.
pub fn pass_to(time: u64) {
    let pass = PASS.load(Ordering::Acquire);
    if pass.is_null() {
        return;
    }
    // SAFETY: stored by `use_boards`, from a function of this type in a library that is never unloaded.
    let pass = unsafe { std::mem::transmute::<*mut (), extern "C" fn(u64)>(pass) };
    mode::count_library(1);
    pass(time);
    mode::count_library(-1);
}
