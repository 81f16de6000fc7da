//! The four functions of the vendor's library, which existing programs link by these names.
//!
//! Their `bool` is returned as a `u32` of 0 or 1: C++ programs look at the lowest byte only, .NET programs at one byte or all
//! four.

use std::cell::Cell;
use std::ffi::{c_uchar, c_ulong};

use ecmsk::sk::Frame;

use crate::buffer::{ReportBuffer, fill_frame};
use crate::error::{CallError, remember_open};
use crate::exported::boards::ECMSK_OK;
use crate::exported::entry::{entry, guard};
use crate::last_frame::LAST_FRAME;
use crate::module::{self, CloseResult, close_and_unload};
use crate::open_boards::VENDOR_BOARD;
use crate::{connect, forked, last_error, memory, shutdown};

/// Opens the board that `ECMSK_LINK` or an `ecmsk.toml` names, or else `usb:`. Returns 1 if the board is open, also if it was
/// open before, and 0 if not (`ecmsk_last_error` says why). A board that was lost is opened again without CloseECMUSB. On
/// Windows GetLastError returns 0 after this call, whether it succeeds or fails.
///
/// Source: UG17 4.2.1.
#[unsafe(no_mangle)]
pub extern "system" fn OpenECMUSB() -> u32 {
    let result = entry!(OpenECMUSB(), {
        memory::check(memory::OPEN_BYTES)?;
        shutdown::end_at_exit();
        VENDOR_BOARD.open(connect::configured)
    });
    if let Err(error) = &result
        && !forked::is_forked()
    {
        remember_open(error);
    }
    last_error::after_open();
    as_bool(&result)
}

/// Closes the board. Reads and writes under way in other threads return 0 at once. Does nothing if no board is open. A board
/// that another thread is just opening is open after the call.
///
/// Source: UG17 4.2.2.
#[unsafe(no_mangle)]
#[cfg_attr(windows, unsafe(naked))]
pub extern "system" fn CloseECMUSB() {
    close_and_unload!(close_board)
}

extern "C" fn close_board() -> CloseResult {
    module::close(|| {
        // CloseECMUSB returns nothing, so an error is dropped here. Its text is kept for `ecmsk_last_error`.
        let _ = guard(format_args!("CloseECMUSB()"), || {
            VENDOR_BOARD.close();
            Ok(())
        });
        ECMSK_OK
    })
}

/// Writes a command frame of `dwlength` bytes. If `dwlength` is over 512, only the first 512 bytes are written; a shorter frame
/// is filled up with 0. Returns 1 if the board took the frame, and 0 if `data` is NULL, `dwlength` is 0, no board is open, the
/// board is lost, or it did not take the frame within the link's `write_timeout_ms`. On Windows GetLastError then returns 6 if
/// no board is open, 5 if the board is lost, 31 if it did not take the frame, 87 for `data` and `dwlength`; success does not
/// change it.
///
/// Source: UG17 4.2.3.
///
/// # Safety
/// `data` is NULL or points to `dwlength` readable bytes (512 if it is more).
#[unsafe(no_mangle)]
pub unsafe extern "system" fn ECMUSBWrite(data: *const c_uchar, dwlength: c_ulong) -> u32 {
    let result = entry!(ECMUSBWrite(dwlength), {
        with_frame(|frame| {
            // SAFETY: the caller's promise for `data`.
            unsafe { fill_frame(frame, data, length(dwlength)) }?;
            // \[OURS] The frame is kept even if the write fails: after the board is lost, a program that writes and then reads
            // gets its own command back.
            LAST_FRAME.keep(frame);
            VENDOR_BOARD.write(frame, length(dwlength))
        })
    });
    last_error::after_transfer(&result);
    as_bool(&result)
}

/// Waits for a report and copies its first `dwlength` bytes, at most 512, to `data`. Returns 1 if there was one, and 0 if
/// `data` is NULL, `dwlength` is 0, no board is open, the board is lost or closed meanwhile, or the link's `read_timeout_ms`
/// has passed (by default there is no limit). If the result is 0, `data` gets the first `dwlength` bytes of the frame that was
/// moved last, by ECMUSBWrite or by ECMUSBRead, as with the vendor's library; before the first frame these are 0. On Windows
/// GetLastError then returns 6 if no board is open, 5 if the board is lost or closed meanwhile, 31 after the limit, 87 for
/// `data` and `dwlength`; success does not change it.
///
/// Source: UG17 4.2.4.
///
/// # Safety
/// `data` is NULL or points to `dwlength` writable bytes (512 if it is more).
#[unsafe(no_mangle)]
pub unsafe extern "system" fn ECMUSBRead(data: *mut c_uchar, dwlength: c_ulong) -> u32 {
    let result = entry!(ECMUSBRead(dwlength), {
        // SAFETY: the caller's promise for `data`.
        let buffer = unsafe { ReportBuffer::new(data, length(dwlength)) }?;
        with_frame(|report| {
            VENDOR_BOARD.read(report)?;
            LAST_FRAME.keep(report);
            buffer.fill(report);
            Ok(())
        })
    });
    if result.is_err() {
        // SAFETY: the caller's promise for `data`.
        unsafe { fill_with_last_frame(data, length(dwlength)) };
    }
    last_error::after_transfer(&result);
    as_bool(&result)
}

/// Copies the frame that was moved last to the first `length` bytes of `data`, unless `data` is NULL or `length` is 0. A
/// function of its own, so that a read that succeeds needs no stack for that frame.
///
/// # Safety
/// As that of [`ECMUSBRead`].
#[cold]
#[inline(never)]
unsafe fn fill_with_last_frame(data: *mut c_uchar, length: usize) {
    // SAFETY: the caller's promise for `data`.
    if let Ok(buffer) = unsafe { ReportBuffer::new(data, length) } {
        buffer.fill(&LAST_FRAME.get());
    }
}

/// Runs `work` with a frame that this thread keeps from call to call, so that no call has to clear a new one. Its content at
/// the beginning is that of an earlier call.
fn with_frame<T>(work: impl FnOnce(&mut Frame) -> Result<T, Box<CallError>>) -> Result<T, Box<CallError>> {
    thread_local! {
        static FRAME: Cell<Option<Box<Frame>>> = const { Cell::new(None) };
    }
    let mut frame = match FRAME.try_with(Cell::take).ok().flatten() {
        Some(frame) => frame,
        None => {
            memory::check(memory::FIRST_CALL_BYTES)?;
            new_frame()
        }
    };
    let result = work(&mut frame);
    // In a thread that is ending, its thread-local variables are gone and this fails: the frame is dropped.
    let _ = FRAME.try_with(|kept| kept.set(Some(frame)));
    result
}

/// A function of its own, so that calls after a thread's first one need no stack for a frame.
#[cold]
#[inline(never)]
fn new_frame() -> Box<Frame> {
    Box::default()
}

fn as_bool(result: &Result<(), Box<CallError>>) -> u32 {
    u32::from(result.is_ok())
}

fn length(dwlength: c_ulong) -> usize {
    usize::try_from(dwlength).unwrap_or(usize::MAX)
}
