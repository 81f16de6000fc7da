//! The four functions of the vendor's library. Existing programs link these names.
//!
//! Their `bool` is returned as a `u32` of 0 or 1: C++ looks at the lowest byte alone, .NET at one byte or all four.

use std::cell::Cell;
use std::ffi::{c_uchar, c_ulong};

use ecmsk::sk::Frame;

use crate::board::VendorBoard;
use crate::boards::ECMSK_OK;
use crate::buffer::{ReportBuffer, fill_frame};
use crate::entry::{entry, guard};
use crate::error::{CallError, remember_open};
use crate::module::{self, Leaving, leaving};
use crate::{connect, last_error, shutdown};

/// The board of these four functions.
pub static BOARD: VendorBoard = VendorBoard::new();

/// Opens the board that `ECMSK_LINK`, an `ecmsk.toml` or the default `usb:` names. 1 if it is open, also if it was
/// already; 0 if not (`ecmsk_last_error` says why). A board that was lost is opened anew, without CloseECMUSB. On Windows
/// GetLastError gives 0 after success.
///
/// Source: UG17 4.2.1.
#[unsafe(no_mangle)]
pub extern "system" fn OpenECMUSB() -> u32 {
    let result = entry!(OpenECMUSB(), {
        shutdown::end_at_exit();
        BOARD.open(connect::configured)
    });
    if let Err(error) = &result
        && !shutdown::is_forked()
    {
        remember_open(error);
    }
    last_error::after_open(&result);
    truth(&result)
}

/// Closes the board. Reads and writes under way in other threads return 0 at once. Harmless when nothing is open.
///
/// Source: UG17 4.2.2.
#[unsafe(no_mangle)]
#[cfg_attr(windows, unsafe(naked))]
pub extern "system" fn CloseECMUSB() {
    leaving!(close_board)
}

extern "C" fn close_board() -> Leaving {
    module::close(|| {
        // Nothing in it fails, and the caller would not learn of it.
        let _ = guard(format_args!("CloseECMUSB()"), || {
            BOARD.close();
            Ok(())
        });
        ECMSK_OK
    })
}

/// Writes a command frame of `dwlength` bytes: of more than 512 the first 512, fewer are filled up with 0. 1 if the
/// board took it; 0 if `data` is NULL, `dwlength` 0, nothing is open, the board is lost, or does not take it within
/// the link's `write_timeout_ms`. On Windows GetLastError then gives 6 if nothing is open, 5 if the board is lost, 31 if it
/// did not take the frame, 87 for `data` and `dwlength`; after success it gives what it gave before.
///
/// Source: UG17 4.2.3.
///
/// # Safety
/// `data` is NULL or points to `dwlength` readable bytes (512 if it is more).
#[unsafe(no_mangle)]
pub unsafe extern "system" fn ECMUSBWrite(data: *const c_uchar, dwlength: c_ulong) -> u32 {
    let result = entry!(ECMUSBWrite(dwlength), {
        with_frame(|frame| {
            // SAFETY: as this function's own.
            unsafe { fill_frame(frame, data, length(dwlength)) }?;
            BOARD.write(frame, length(dwlength))
        })
    });
    last_error::after_transfer(&result);
    truth(&result)
}

/// Waits for a report and copies its first `dwlength` bytes (at most 512) to `data`. 1 if there was one; 0, and `data`
/// as it was, if `data` is NULL, `dwlength` 0, nothing is open, the board is lost or closed meanwhile, or the link's
/// `read_timeout_ms` has passed (by default there is no limit). On Windows GetLastError then gives 6 if nothing is open, 5 if
/// the board is lost or closed meanwhile, 31 after the limit, 87 for `data` and `dwlength`; after success it gives what it
/// gave before.
///
/// Source: UG17 4.2.4.
///
/// # Safety
/// `data` is NULL or points to `dwlength` writable bytes (512 if it is more).
#[unsafe(no_mangle)]
pub unsafe extern "system" fn ECMUSBRead(data: *mut c_uchar, dwlength: c_ulong) -> u32 {
    let result = entry!(ECMUSBRead(dwlength), {
        // SAFETY: as this function's own.
        let buffer = unsafe { ReportBuffer::new(data, length(dwlength)) }?;
        with_frame(|report| {
            BOARD.read(report)?;
            buffer.fill(report);
            Ok(())
        })
    });
    last_error::after_transfer(&result);
    truth(&result)
}

/// Works with a frame of this thread's, whatever stands in it: a new one would have to be cleared.
fn with_frame<T>(work: impl FnOnce(&mut Frame) -> T) -> T {
    thread_local! {
        static FRAME: Cell<Option<Box<Frame>>> = const { Cell::new(None) };
    }
    let mut frame = FRAME.try_with(Cell::take).ok().flatten().unwrap_or_default();
    let result = work(&mut frame);
    // A thread that is ending keeps nothing any more.
    let _ = FRAME.try_with(|kept| kept.set(Some(frame)));
    result
}

fn truth(result: &Result<(), Box<CallError>>) -> u32 {
    u32::from(result.is_ok())
}

fn length(dwlength: c_ulong) -> usize {
    usize::try_from(dwlength).unwrap_or(usize::MAX)
}
