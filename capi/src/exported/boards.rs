//! The exported functions for boards that are opened by URI, several at once if need be, and the result codes.

use std::ffi::{c_char, c_uchar};
use std::sync::Arc;
use std::time::Duration;

use ecmsk::link::{LinkError, Wait};
use ecmsk::machine_file::MachineFileError;
use ecmsk::sk::Frame;

use crate::board::OpenBoard;
use crate::buffer::{ReportBuffer, fill_frame, text_from};
use crate::error::CallError;
use crate::exported::entry::{entry, guard};
use crate::module::{self, CloseResult, close_and_unload};
use crate::open_boards::{HANDLES, VENDOR_BOARD};
use crate::{connect, memory, shutdown};

/// The result of a call: `ECMSK_OK`, or a negative error code. `ecmsk_last_error` has a text for every error.
pub type EcmskResult = i32;

/// The call has succeeded.
pub const ECMSK_OK: i32 = 0;
/// An argument is NULL, has the length 0 or an invalid value, or the URI or the machine file is invalid.
pub const ECMSK_ERROR_ARGUMENT: i32 = -1;
/// No open board has this handle, or no open machine file.
pub const ECMSK_ERROR_HANDLE: i32 = -2;
/// The call has reached its timeout.
pub const ECMSK_ERROR_TIMEOUT: i32 = -3;
/// The link has virtual time, which advances only inside calls, and the board sends no reports, for example because the cable
/// to its first slave is unplugged. No report would come however long the call waits. Connect the first slave again, then read
/// again.
pub const ECMSK_ERROR_SILENT: i32 = -4;
/// The board was unplugged or does not answer any more. Close it and open it again.
pub const ECMSK_ERROR_LOST: i32 = -5;
/// The board is not open, or was closed during the call.
pub const ECMSK_ERROR_CLOSED: i32 = -6;
/// There is no board that the link could open.
pub const ECMSK_ERROR_NO_BOARD: i32 = -7;
/// Another program uses the board.
pub const ECMSK_ERROR_IN_USE: i32 = -8;
/// This build of the library, or this link, does not support the call.
pub const ECMSK_ERROR_UNSUPPORTED: i32 = -9;
/// A call of the operating system has failed, or it has no memory left.
pub const ECMSK_ERROR_IO: i32 = -10;
/// A defect of this library.
pub const ECMSK_ERROR_INTERNAL: i32 = -11;

/// A handle of an open board. It is not an address: a handle that was closed or made up gives `ECMSK_ERROR_HANDLE`.
pub struct EcmskBoard {
    _private: [u8; 0],
}

/// As a timeout: wait until the call is done or the board is lost or closed.
pub const ECMSK_WAIT_FOREVER: i64 = -1;
/// As a timeout: the timeout of the link's URI, `read_timeout_ms` or `write_timeout_ms`.
pub const ECMSK_WAIT_LINK: i64 = -2;

/// The handle that `ecmsk_vendor_board` returns, for the board of OpenECMUSB. It is constant, since there is one such
/// board.
const VENDOR: usize = 1;
const _: () = assert!(VENDOR < *crate::handles::OF_BOARDS.start());

/// Opens the board that a link's URI names, such as `sim:?slaves=drive*2` or `usb:`. Writes the handle of the board to
/// `*board`, or NULL if the call fails. Two links to simulated boards lead to the same board only if they have the same
/// `name=`. A board that is open already gives `ECMSK_ERROR_IN_USE`.
///
/// # Safety
/// `uri` is NULL or a text that ends with 0. `board` is NULL or points to room for a pointer.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecmsk_open(uri: *const c_char, board: *mut *mut EcmskBoard) -> EcmskResult {
    if !board.is_null() {
        // NULL is written before anything else: if there is no memory for the call, the block of `entry!` below does not
        // run.
        // SAFETY: not NULL, and the caller vouches for room; nothing is read from it.
        unsafe { board.write(std::ptr::null_mut()) };
    }
    code(entry!(ecmsk_open(), {
        if board.is_null() {
            return Err(CallError::Null { argument: "board", expected: "a pointer for the handle" }.into());
        }
        // SAFETY: the caller's promise for `uri`; the text is not kept.
        let uri = unsafe { text_from(uri, "uri") }?;
        memory::check(memory::OPEN_BYTES)?;
        shutdown::end_at_exit();
        let handle = HANDLES.insert(OpenBoard::new(connect::named(uri)?));
        // SAFETY: `board` is not NULL, and the caller vouches for room for a pointer.
        unsafe { board.write(std::ptr::without_provenance_mut(handle)) };
        Ok(handle)
    }))
}

/// Closes a board. Calls under way in other threads end with `ECMSK_ERROR_CLOSED`. The handle is invalid afterwards.
///
/// # Safety
/// None: any value may be passed.
#[unsafe(no_mangle)]
#[cfg_attr(windows, unsafe(naked))]
pub extern "C" fn ecmsk_close(board: *mut EcmskBoard) -> EcmskResult {
    close_and_unload!(close, board)
}

extern "C" fn close(board: *mut EcmskBoard) -> CloseResult {
    let handle = board.addr();
    let call = || match handle {
        VENDOR => {
            VENDOR_BOARD.close();
            Ok(())
        }
        other => {
            HANDLES.remove(other).ok_or(CallError::Handle { handle: other })?.close();
            Ok(())
        }
    };
    module::close(|| code(guard(format_args!("ecmsk_close(handle={handle})"), call)))
}

/// A handle of the board of `OpenECMUSB`, for the functions below. It always has the same value. While that board is not
/// open, the functions return `ECMSK_ERROR_CLOSED`.
///
/// # Safety
/// None.
#[unsafe(no_mangle)]
pub extern "C" fn ecmsk_vendor_board() -> *mut EcmskBoard {
    std::ptr::without_provenance_mut(VENDOR)
}

/// Writes a command frame of `length` bytes. If `length` is over 512, only the first 512 bytes are written; a shorter frame is
/// filled up with 0. `timeout_ms` is the longest wait in milliseconds, `ECMSK_WAIT_FOREVER` or `ECMSK_WAIT_LINK`; with 0 the
/// call does not wait.
///
/// # Safety
/// `data` is NULL or points to `length` readable bytes (512 if it is more). `board` may be any value.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecmsk_write(
    board: *mut EcmskBoard,
    data: *const c_uchar,
    length: usize,
    timeout_ms: i64,
) -> EcmskResult {
    let handle = board.addr();
    code(entry!(ecmsk_write(handle, length, timeout_ms), {
        let mut frame = Frame::new();
        // SAFETY: the caller's promise for `data`.
        unsafe { fill_frame(&mut frame, data, length) }?;
        let board = find(handle)?;
        board.write(&frame, wait(timeout_ms, board.write_wait)?)?;
        Ok(())
    }))
}

/// Waits for a report and copies its first `length` bytes, at most 512, to `data`, which is unchanged if the call fails.
/// `timeout_ms` is used as in `ecmsk_write`.
///
/// # Safety
/// `data` is NULL or points to `length` writable bytes (512 if it is more). `board` may be any value.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecmsk_read(
    board: *mut EcmskBoard,
    data: *mut c_uchar,
    length: usize,
    timeout_ms: i64,
) -> EcmskResult {
    let handle = board.addr();
    code(entry!(ecmsk_read(handle, length, timeout_ms), {
        // SAFETY: the caller's promise for `data`.
        let buffer = unsafe { ReportBuffer::new(data, length) }?;
        let board = find(handle)?;
        let mut report = Frame::new();
        board.read(&mut report, wait(timeout_ms, board.read_wait)?)?;
        buffer.fill(&report);
        Ok(())
    }))
}

/// The board of a handle.
///
/// # Errors
/// [`CallError::Handle`]: no open board has this handle. [`CallError::NotOpen`]: it is the handle of the vendor's board,
/// which is not open.
pub fn find(handle: usize) -> Result<Arc<OpenBoard>, Box<CallError>> {
    match handle {
        VENDOR => VENDOR_BOARD.get(),
        other => HANDLES.get(other).ok_or_else(|| CallError::Handle { handle: other }.into()),
    }
}

fn wait(timeout_ms: i64, link: Wait) -> Result<Wait, Box<CallError>> {
    match timeout_ms {
        ECMSK_WAIT_FOREVER => Ok(Wait::Forever),
        ECMSK_WAIT_LINK => Ok(link),
        0 => Ok(Wait::Now),
        ms => match u64::try_from(ms) {
            Ok(ms) => Ok(Wait::For(Duration::from_millis(ms))),
            Err(_) => Err(CallError::Timeout { found: timeout_ms }.into()),
        },
    }
}

/// Converts the result of a call of [`entry!`] to its result code. An error is dropped here: `entry!` has kept its text
/// for `ecmsk_last_error`.
pub fn code<T>(result: Result<T, Box<CallError>>) -> EcmskResult {
    match result {
        Ok(_) => ECMSK_OK,
        Err(error) => match *error {
            CallError::Null { .. }
            | CallError::NoBytes
            | CallError::NotText { .. }
            | CallError::StructSize { .. }
            | CallError::NotInMachine { .. }
            | CallError::NotANumber { .. }
            | CallError::Timeout { .. } => ECMSK_ERROR_ARGUMENT,
            CallError::Machine(MachineFileError::Unreadable { .. }) => ECMSK_ERROR_IO,
            CallError::Machine(_) => ECMSK_ERROR_ARGUMENT,
            CallError::Handle { .. } | CallError::MachineHandle { .. } => ECMSK_ERROR_HANDLE,
            CallError::NotOpen | CallError::Forked => ECMSK_ERROR_CLOSED,
            CallError::NoCounters { .. } => ECMSK_ERROR_UNSUPPORTED,
            CallError::Memory => ECMSK_ERROR_IO,
            CallError::Panic(_) => ECMSK_ERROR_INTERNAL,
            CallError::Configured { error, .. } => link_code(&error),
            CallError::Link(error) => link_code(&error),
        },
    }
}

fn link_code(error: &LinkError) -> EcmskResult {
    match error {
        LinkError::Uri(_)
        | LinkError::ManufacturerObjects(_)
        | LinkError::Script(_)
        | LinkError::Config(_)
        | LinkError::WrongSlot { .. } => ECMSK_ERROR_ARGUMENT,
        LinkError::Unsupported { .. } => ECMSK_ERROR_UNSUPPORTED,
        LinkError::NoBoard { .. } => ECMSK_ERROR_NO_BOARD,
        LinkError::InUse { .. } => ECMSK_ERROR_IN_USE,
        LinkError::Timeout { .. } => ECMSK_ERROR_TIMEOUT,
        LinkError::Silent { .. } => ECMSK_ERROR_SILENT,
        LinkError::Lost { .. } | LinkError::Unsure { .. } => ECMSK_ERROR_LOST,
        LinkError::Closed | LinkError::Cancelled { .. } => ECMSK_ERROR_CLOSED,
        LinkError::Io { .. } | LinkError::BeyondLimit { .. } => ECMSK_ERROR_IO,
    }
}
