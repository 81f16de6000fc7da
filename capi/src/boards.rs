//! Boards by URI: several at once, each behind a handle.

use std::ffi::{c_char, c_uchar};
use std::sync::Arc;
use std::time::Duration;

use ecmsk::link::{LinkError, Wait};
use ecmsk::sk::Frame;

use crate::board::OpenBoard;
use crate::buffer::{ReportBuffer, fill_frame, text_from};
use crate::entry::{entry, guard};
use crate::error::CallError;
use crate::handles::Handles;
use crate::module::{self, Leaving, leaving};
use crate::{connect, shutdown, vendor};

/// How a call ended: `ECMSK_OK`, or a negative number, and then `ecmsk_last_error` says why in words.
pub type EcmskResult = i32;

/// Done.
pub const ECMSK_OK: i32 = 0;
/// An argument is NULL, of length 0, or not what the function takes; a URI that is wrong.
pub const ECMSK_ERROR_ARGUMENT: i32 = -1;
/// The handle is of no open board.
pub const ECMSK_ERROR_HANDLE: i32 = -2;
/// The limit of the wait has passed.
pub const ECMSK_ERROR_TIMEOUT: i32 = -3;
/// On a virtual clock: no report will come by waiting.
pub const ECMSK_ERROR_SILENT: i32 = -4;
/// The board is gone: close it and open it again.
pub const ECMSK_ERROR_LOST: i32 = -5;
/// The board was closed, by this or another thread, or never opened.
pub const ECMSK_ERROR_CLOSED: i32 = -6;
/// No board answers.
pub const ECMSK_ERROR_NO_BOARD: i32 = -7;
/// Somebody else has the board.
pub const ECMSK_ERROR_IN_USE: i32 = -8;
/// This build, or this link, cannot do that.
pub const ECMSK_ERROR_UNSUPPORTED: i32 = -9;
/// The operating system said no.
pub const ECMSK_ERROR_IO: i32 = -10;
/// A defect of this library.
pub const ECMSK_ERROR_INTERNAL: i32 = -11;

/// An open board. Never followed as a pointer: a handle that was closed or made up gives `ECMSK_ERROR_HANDLE`.
pub struct EcmskBoard {
    _private: [u8; 0],
}

/// A timeout: wait until it is done, the board is lost or closed.
pub const ECMSK_WAIT_FOREVER: i64 = -1;
/// A timeout: as the link says, by `read_timeout_ms` and `write_timeout_ms`.
pub const ECMSK_WAIT_LINK: i64 = -2;

/// The handle that `ecmsk_vendor_board` gives.
const VENDOR: usize = 1;
const _: () = assert!(VENDOR < crate::handles::FIRST);

static HANDLES: Handles = Handles::new();

/// Opens the board of a link such as `sim:?slaves=drive*2` or `usb:` and puts its handle into `*board` (NULL if it
/// fails). A simulated board is shared by its `name=` only; one that is open already gives `ECMSK_ERROR_IN_USE`.
///
/// # Safety
/// `uri` is NULL or a text that ends with 0. `board` is NULL or points to room for a pointer.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecmsk_open(uri: *const c_char, board: *mut *mut EcmskBoard) -> EcmskResult {
    code(entry!(ecmsk_open(), {
        if board.is_null() {
            return Err(CallError::Null { argument: "board", expected: "a pointer for the handle" }.into());
        }
        // SAFETY: not NULL, and the caller vouches for room; nothing is read from it.
        unsafe { board.write(std::ptr::null_mut()) };
        // SAFETY: as this function's own; the text is not kept.
        let uri = unsafe { text_from(uri, "uri") }?;
        shutdown::end_at_exit();
        let handle = HANDLES.insert(OpenBoard::new(connect::named(uri)?));
        // SAFETY: as above.
        unsafe { board.write(std::ptr::without_provenance_mut(handle)) };
        Ok(handle)
    }))
}

/// Closes a board. Calls under way in other threads end with `ECMSK_ERROR_CLOSED`; the handle is of no use afterwards.
///
/// # Safety
/// None: any value may be passed.
#[unsafe(no_mangle)]
#[cfg_attr(windows, unsafe(naked))]
pub extern "C" fn ecmsk_close(board: *mut EcmskBoard) -> EcmskResult {
    leaving!(close, board)
}

extern "C" fn close(board: *mut EcmskBoard) -> Leaving {
    let handle = board.addr();
    let call = || match handle {
        VENDOR => {
            vendor::BOARD.close();
            Ok(())
        }
        other => {
            HANDLES.remove(other)?.close();
            Ok(())
        }
    };
    module::close(|| code(guard(format_args!("ecmsk_close(handle={handle})"), call)))
}

/// The board of `OpenECMUSB` as a handle for the functions below. Always the same value; while that board is not open
/// they give `ECMSK_ERROR_CLOSED`.
///
/// # Safety
/// None.
#[unsafe(no_mangle)]
pub extern "C" fn ecmsk_vendor_board() -> *mut EcmskBoard {
    std::ptr::without_provenance_mut(VENDOR)
}

/// Writes a command frame of `length` bytes: of more than 512 the first 512, fewer are filled up with 0.
/// `timeout_ms`: 0 does not wait, else that many milliseconds, `ECMSK_WAIT_FOREVER` or `ECMSK_WAIT_LINK`.
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
        // SAFETY: as this function's own.
        unsafe { fill_frame(&mut frame, data, length) }?;
        let board = find(handle)?;
        board.link.write(&frame, wait(timeout_ms, board.write_wait)?)?;
        Ok(())
    }))
}

/// Waits for a report and copies its first `length` bytes (at most 512) to `data`, which is left as it was if there is
/// none. `timeout_ms` as for `ecmsk_write`.
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
        // SAFETY: as this function's own.
        let buffer = unsafe { ReportBuffer::new(data, length) }?;
        let board = find(handle)?;
        let mut report = Frame::new();
        board.link.read(&mut report, wait(timeout_ms, board.read_wait)?)?;
        buffer.fill(&report);
        Ok(())
    }))
}

/// The board of a handle.
///
/// # Errors
/// [`CallError::Handle`], [`CallError::NotOpen`].
pub fn find(handle: usize) -> Result<Arc<OpenBoard>, Box<CallError>> {
    match handle {
        VENDOR => vendor::BOARD.get(),
        other => HANDLES.get(other),
    }
}

/// Gives every board back that this process has not closed, at its end.
#[cfg(unix)]
pub fn vanish_all() {
    vendor::BOARD.vanish();
    for board in HANDLES.drain() {
        board.vanish();
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

/// The code of a result; the error itself is kept already.
pub fn code<T>(result: Result<T, Box<CallError>>) -> EcmskResult {
    match result {
        Ok(_) => ECMSK_OK,
        Err(error) => match *error {
            CallError::Null { .. }
            | CallError::NoBytes
            | CallError::NotText { .. }
            | CallError::StructSize { .. }
            | CallError::Timeout { .. } => ECMSK_ERROR_ARGUMENT,
            CallError::Handle { .. } => ECMSK_ERROR_HANDLE,
            CallError::NotOpen | CallError::Forked => ECMSK_ERROR_CLOSED,
            CallError::NoCounters { .. } => ECMSK_ERROR_UNSUPPORTED,
            CallError::Panic(_) => ECMSK_ERROR_INTERNAL,
            CallError::Configured { error, .. } => link_code(&error),
            CallError::Link(error) => link_code(&error),
        },
    }
}

fn link_code(error: &LinkError) -> EcmskResult {
    match error {
        LinkError::Uri(_)
        | LinkError::Makers(_)
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
        LinkError::Io { .. } => ECMSK_ERROR_IO,
    }
}
