//! The functions that this library offers to NEXTWUSBLib, which finds them by [`NAME`]. Both libraries compile this file.

use std::ffi::CStr;

/// The name of the exported function of type [`GetTable`].
pub const NAME: &CStr = c"ecmsk_sleep_table";

/// Changes with every change of [`Table`]. A NEXTWUSBLib of another version does not use the table: its boards then keep
/// their own time, as without this library.
pub const VERSION: u32 = 2;

/// Returns the table, which is never freed.
pub type GetTable = extern "C" fn() -> *const Table;

/// Times are nanoseconds of the virtual clock, which begins with the process at 0.
#[repr(C)]
pub struct Table {
    /// [`VERSION`].
    pub version: u32,
    /// From here to `leave` the calling thread's clocks and waits are real ones, and threads that it makes are no threads
    /// of the program. Calls may be nested.
    pub enter: extern "C" fn(),
    /// The end of `enter`.
    pub leave: extern "C" fn(),
    /// Waits until every other thread of the program waits. Called before a call that lets a board's time pass.
    pub turn: extern "C" fn(),
    /// The virtual clock.
    pub now: extern "C" fn() -> u64,
    /// A board has reached this time; an earlier one than now changes nothing.
    pub reached: extern "C" fn(u64),
    /// Registers the function that lets the time of all boards pass up to a time. It must call none of this table.
    pub use_boards: extern "C" fn(extern "C" fn(u64)),
    /// A board was opened. True: its time passes with the virtual clock; false: it is not on virtual time.
    pub opened: extern "C" fn(bool),
}
