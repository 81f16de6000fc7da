//! The caller's memory: the only place where its pointers are followed.

use std::ffi::{CStr, c_char};

use ecmsk::sk::{FRAME_LEN, Frame};

use crate::error::CallError;

/// A command frame from the first `length` bytes at `data`: more than 512 count as 512, the rest of fewer is 0.
///
/// [OURS] The vendor's library fills with 0xCC and takes a length of 0 for one of those frames.
///
/// # Errors
/// [`CallError::Null`], [`CallError::NoBytes`].
///
/// # Safety
/// `data` is NULL or points to `length` readable bytes (512 of them if it is more).
pub unsafe fn frame_from(data: *const u8, length: usize) -> Result<Frame, CallError> {
    let length = checked(data, length)?;
    // SAFETY: not NULL, and the caller vouches for `length` bytes; bytes have no alignment. The slice lives in this
    // statement alone.
    Ok(Frame::from_prefix(unsafe { std::slice::from_raw_parts(data, length) }))
}

/// Room for a report at `data`, of at most 512 bytes.
pub struct ReportBuffer {
    data: *mut u8,
    length: usize,
}

impl ReportBuffer {
    /// The buffer of `length` bytes at `data`; of more than 512 the first 512 are used.
    ///
    /// # Errors
    /// [`CallError::Null`], [`CallError::NoBytes`].
    ///
    /// # Safety
    /// `data` is NULL or points to `length` writable bytes (512 of them if it is more), for as long as this lives.
    pub unsafe fn new(data: *mut u8, length: usize) -> Result<Self, CallError> {
        Ok(Self { data, length: checked(data, length)? })
    }

    /// Copies the report into it, as much as there is room for.
    pub fn fill(self, report: &Frame) {
        // SAFETY: `new`'s caller vouches for `length` writable bytes, which is at most 512, the size of the report;
        // the report is a local of ours, so the two do not overlap.
        unsafe { std::ptr::copy_nonoverlapping(report.bytes().as_ptr(), self.data, self.length) }
    }
}

/// The text at `text`.
///
/// # Errors
/// [`CallError::Null`], [`CallError::NotText`].
///
/// # Safety
/// `text` is NULL or points to bytes that end with a 0 and stay unchanged while the result is used.
pub unsafe fn text_from<'a>(text: *const c_char, argument: &'static str) -> Result<&'a str, CallError> {
    if text.is_null() {
        return Err(CallError::Null { argument, expected: "a text that ends with 0" });
    }
    // SAFETY: not NULL, and the caller vouches for the rest.
    unsafe { CStr::from_ptr(text) }.to_str().map_err(|_| CallError::NotText { argument })
}

fn checked(data: *const u8, length: usize) -> Result<usize, CallError> {
    if data.is_null() {
        return Err(CallError::Null { argument: "data", expected: "a buffer of 504 or 512 bytes" });
    }
    if length == 0 {
        return Err(CallError::NoBytes);
    }
    Ok(length.min(FRAME_LEN))
}
