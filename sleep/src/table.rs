//! The functions that this library offers to NEXTWUSBLib, which finds them by [`NAME`]. Both libraries compile this file.

use std::ffi::CStr;

/// The name of the exported function of type [`GetTable`].
pub const NAME: &CStr = c"ecmsk_sleep_table";

/// Changes with every change of [`Table`]. A NEXTWUSBLib of another version does not use the table: its boards then keep
/// their own time, as without this library.
pub const VERSION: u32 = 2;

/// Returns the table, which is never freed.
pub type GetTable = extern "C" fn() -> *const Table;

/// The functions of this library for NEXTWUSBLib. Times are nanoseconds of the virtual clock, which is 0 when the
/// process begins.
#[repr(C)]
pub struct Table {
    /// The version of this table: [`VERSION`].
    pub version: u32,
    /// The calling thread enters NEXTWUSBLib. Until `leave` its clocks and waits are real, and threads that it makes
    /// are no threads of the program. Calls may be nested.
    pub enter: extern "C" fn(),
    /// The calling thread leaves NEXTWUSBLib, which ends the effect of `enter`.
    pub leave: extern "C" fn(),
    /// Waits until every other thread of the program waits. Called before a call that lets a board's time pass.
    pub turn: extern "C" fn(),
    /// Returns the time of the virtual clock.
    pub now: extern "C" fn() -> u64,
    /// Reports that a board has reached this time. An earlier time than now changes nothing.
    pub reached: extern "C" fn(u64),
    /// Registers the function that lets the time of all boards pass up to a time. That function must not call the
    /// functions of this table.
    pub use_boards: extern "C" fn(extern "C" fn(u64)),
    /// Reports that a board was opened. True: its time passes with the virtual clock; false: it is not on virtual time.
    pub opened: extern "C" fn(bool),
}
