//! The drop-in `NEXTWUSBLib`: the four functions that existing programs call (`vendor`) and the `ecmsk_*` functions
//! beside them (`boards`, `facts`).
//!
//! Every exported function runs inside `entry`: a boundary that no panic crosses, and a trace of calls for
//! `ECMSK_LOG`. What the functions do lies behind them in safe code: `board` is one open board, `handles` the table
//! of those opened by URI.
#![allow(non_snake_case, reason = "the library is named as the vendor's is")]

mod board;
mod boards;
mod buffer;
mod cancellation;
mod connect;
mod entry;
mod error;
mod facts;
mod floats;
mod handles;
mod last_error;
mod logger;
mod module;
mod shutdown;
mod vendor;

use boards::{ecmsk_close, ecmsk_open, ecmsk_read, ecmsk_vendor_board, ecmsk_write};
use facts::{
    ecmsk_get_counters, ecmsk_get_link_name, ecmsk_get_stats, ecmsk_last_error, ecmsk_reject_name, ecmsk_version,
};
use vendor::{CloseECMUSB, ECMUSBRead, ECMUSBWrite, OpenECMUSB};

// Names every function of `exports.txt`, so that one which is listed and not there does not compile.
include!(concat!(env!("OUT_DIR"), "/exports.rs"));
