//! The drop-in `NEXTWUSBLib`: the four functions of the vendor's library, which existing programs call, and the `ecmsk_*`
//! functions beside them.
//!
//! A new exported function goes into a file of `exported/`, into the imports below, and to the end of `exports.txt`, whose
//! order is that of the DLL's ordinals; `include/ecmsk.h` is generated. How to read this crate:
//!
//! | file | what it holds |
//! | --- | --- |
//! | `exported/` | the exported functions |
//! | `buffer.rs` | the caller's memory |
//! | `board.rs`, `open_boards.rs` | an open board, all of this process |
//! | `handles.rs` | the tables of boards that were opened by URI, and of machine files |
//! | `connect.rs` | which link is opened |
//! | `last_frame.rs` | the frame that was moved last, which a failed read leaves to the program |
//! | `error.rs`, `last_error.rs` | why a call failed, as text and for Windows' GetLastError |
//! | `logger.rs` | the log |
//! | `memory.rs` | a system without memory |
//! | `program_clock.rs` | the clock of a program whose waits take virtual time |
//! | `module/` | the library as a file: its folder, and how it is unloaded on Windows |
//! | `shutdown.rs`, `forked.rs`, `cancellation.rs`, `floating_point.rs` | the end of the process, fork, cancelled threads, the caller's floating-point state |
#![allow(non_snake_case, reason = "the library is named as the vendor's is")]

mod board;
mod buffer;
mod cancellation;
mod connect;
mod error;
mod exported;
mod floating_point;
mod forked;
mod handles;
mod last_error;
mod last_frame;
mod logger;
mod memory;
mod module;
mod open_boards;
mod program_clock;
mod shutdown;

use exported::boards::{ecmsk_close, ecmsk_open, ecmsk_read, ecmsk_vendor_board, ecmsk_write};
use exported::info::{
    ecmsk_get_counters, ecmsk_get_link_name, ecmsk_get_stats, ecmsk_last_error, ecmsk_reject_name, ecmsk_version,
};
use exported::machine::{
    ecmsk_machine_close, ecmsk_machine_find_axis, ecmsk_machine_find_input, ecmsk_machine_find_output,
    ecmsk_machine_get_axis, ecmsk_machine_get_axis_count, ecmsk_machine_get_axis_name, ecmsk_machine_get_axis_unit,
    ecmsk_machine_get_link, ecmsk_machine_open, ecmsk_machine_to_counts, ecmsk_machine_to_units,
};
use exported::vendor::{CloseECMUSB, ECMUSBRead, ECMUSBWrite, OpenECMUSB};

// Names every function of `exports.txt`, so that a listed function that does not exist is an error of the compiler.
include!(concat!(env!("OUT_DIR"), "/exports.rs"));
