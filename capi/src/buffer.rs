//! Access to frames, texts and structures in the caller's memory.

use std::ffi::{CStr, c_char};

use ecmsk::sk::{FRAME_LEN, Frame};

use crate::error::CallError;

/// Copies the `length` bytes at `data`, at most 512, into `frame` and sets the other bytes of `frame` to 0.
///
/// \[OURS] The vendor's library sets the other bytes to 0xCC. It also accepts a length of 0, and then writes a frame of
/// 0xCC only.
///
/// # Errors
/// [`CallError::Null`]: `data` is NULL. [`CallError::NoBytes`]: `length` is 0.
///
/// # Safety
/// `data` is NULL or points to `length` readable bytes (if `length` is above 512, to 512 readable bytes).
pub unsafe fn fill_frame(frame: &mut Frame, data: *const u8, length: usize) -> Result<(), Box<CallError>> {
    let length = checked(data, length)?;
    // SAFETY: not NULL, and the caller guarantees `length` bytes, which need no alignment. The slice is used in this
    // statement only.
    frame.set_prefix(unsafe { std::slice::from_raw_parts(data, length) });
    Ok(())
}

/// The caller's buffer for a report, of at most 512 bytes.
pub struct ReportBuffer {
    data: *mut u8,
    length: usize,
}

impl ReportBuffer {
    /// Uses the `length` bytes at `data` as the buffer; if they are more than 512, only the first 512.
    ///
    /// # Errors
    /// [`CallError::Null`]: `data` is NULL. [`CallError::NoBytes`]: `length` is 0.
    ///
    /// # Safety
    /// `data` is NULL or points to `length` writable bytes (if `length` is above 512, to 512 writable bytes), for as
    /// long as this lives.
    pub unsafe fn new(data: *mut u8, length: usize) -> Result<Self, Box<CallError>> {
        Ok(Self { data, length: checked(data, length)? })
    }

    /// Copies the report into the buffer; of a report that is longer than the buffer, only the beginning.
    pub fn fill(self, report: &Frame) {
        // SAFETY: the caller of `new` guarantees `length` writable bytes, and `length` is at most 512, the size of the
        // report. The report is not in the caller's memory, so the two do not overlap.
        unsafe { std::ptr::copy_nonoverlapping(report.bytes().as_ptr(), self.data, self.length) }
    }
}

/// The caller's buffer for a text.
pub struct TextBuffer {
    buffer: *mut c_char,
    length: usize,
    needed: *mut usize,
}

impl TextBuffer {
    /// Uses the `length` bytes at `buffer` for a text, and `*needed` for the number of bytes that the whole text needs.
    ///
    /// # Errors
    /// [`CallError::Null`]: `buffer` is NULL and `length` is not 0.
    ///
    /// # Safety
    /// `buffer` is NULL or points to `length` writable bytes, and `needed` is NULL or points to room for a `usize`, for as
    /// long as this lives.
    pub unsafe fn new(buffer: *mut c_char, length: usize, needed: *mut usize) -> Result<Self, Box<CallError>> {
        if buffer.is_null() && length > 0 {
            return Err(CallError::Null { argument: "buffer", expected: "`length` bytes" }.into());
        }
        Ok(Self { buffer, length, needed })
    }

    /// Copies the text with a terminating 0 into the buffer. A longer text is cut between two characters.
    pub fn fill(self, text: &str) {
        if !self.needed.is_null() {
            // SAFETY: not NULL, and the caller of `new` guarantees room.
            unsafe { self.needed.write(text.len() + 1) };
        }
        if self.length > 0 {
            let cut = text.floor_char_boundary(self.length - 1);
            // SAFETY: `cut` is at most `length - 1`, so text and 0 fit into the `length` bytes that the caller of `new`
            // guarantees; `text` is not in the caller's memory.
            unsafe {
                std::ptr::copy_nonoverlapping(text.as_ptr(), self.buffer.cast(), cut);
                self.buffer.add(cut).write(0);
            }
        }
    }
}

/// A structure that begins with its own size. A later version of the library may append fields; the size shows how many
/// of them the caller's structure has.
///
/// # Safety
/// The type is `repr(C)` and consists of numbers without padding. Its first four bytes are `size`, which holds the size of
/// the type.
pub unsafe trait Versioned: Copy {}

/// The length of `size` and of the number after it, in bytes: the smallest structure that a caller may pass. Fields are
/// copied in multiples of this length.
const HEAD: usize = 8;

/// Copies as many fields of `value` as the caller's structure has room for, and sets its `size` to the bytes that were
/// copied. A field that does not fit completely is left out.
///
/// # Errors
/// [`CallError::Null`]: `target` is NULL. [`CallError::StructSize`]: the caller has set `size` to less than 8.
///
/// # Safety
/// `target` is NULL or points to a `u32` that holds the number of writable bytes there.
pub unsafe fn copy_out<T: Versioned>(value: T, target: *mut T, argument: &'static str) -> Result<(), Box<CallError>> {
    if target.is_null() {
        return Err(CallError::Null { argument, expected: "a structure whose `size` is set" }.into());
    }
    let size = target.cast::<u32>();
    // SAFETY: not NULL, and the caller guarantees the leading `size`, which need not be aligned.
    let found = unsafe { size.read_unaligned() };
    let filled = (found as usize).min(size_of::<T>()) / HEAD * HEAD;
    if filled < HEAD {
        return Err(CallError::StructSize { found, least: HEAD }.into());
    }
    // SAFETY: `filled` is at most the size of `value` and the number of bytes that the caller guarantees; `value` is
    // local.
    unsafe {
        std::ptr::copy_nonoverlapping((&raw const value).cast::<u8>(), target.cast::<u8>(), filled);
        size.write_unaligned(filled as u32);
    }
    Ok(())
}

/// Writes the result of a call to the caller's `target`. Errors name the argument of the exported function, `argument`.
///
/// # Errors
/// [`CallError::Null`]: `target` is NULL.
///
/// # Safety
/// `target` is NULL or points to room for a value of its type.
pub unsafe fn put<T>(value: T, target: *mut T, argument: &'static str) -> Result<(), Box<CallError>> {
    if target.is_null() {
        return Err(CallError::Null { argument, expected: "room for the result" }.into());
    }
    // SAFETY: not NULL, and the caller guarantees room; nothing is read from it.
    unsafe { target.write(value) };
    Ok(())
}

/// Reads the C string at `text`. Errors name the argument of the exported function, `argument`.
///
/// # Errors
/// [`CallError::Null`]: `text` is NULL. [`CallError::NotText`]: `text` is not UTF-8.
///
/// # Safety
/// `text` is NULL or points to bytes that end with a 0 and stay unchanged while the result is used.
pub unsafe fn text_from<'a>(text: *const c_char, argument: &'static str) -> Result<&'a str, Box<CallError>> {
    if text.is_null() {
        return Err(CallError::Null { argument, expected: "a text that ends with 0" }.into());
    }
    // SAFETY: `text` is not NULL, and the caller guarantees that it ends with a 0 and stays unchanged.
    unsafe { CStr::from_ptr(text) }.to_str().map_err(|_| CallError::NotText { argument }.into())
}

fn checked(data: *const u8, length: usize) -> Result<usize, Box<CallError>> {
    if data.is_null() {
        return Err(CallError::Null { argument: "data", expected: "a buffer of 504 or 512 bytes" }.into());
    }
    if length == 0 {
        return Err(CallError::NoBytes.into());
    }
    Ok(length.min(FRAME_LEN))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// LIB-50 A frame that is too short is filled up with 0; LIB-28 of a frame that is too long, only the first 512 bytes
    /// are written.
    #[test]
    fn a_frame_has_the_callers_bytes_and_then_zeros() {
        let bytes: Vec<u8> = (0..1000_u32).map(|n| 1 + (n % 255) as u8).collect();
        for length in [1, 11, 12, 503, 504, 511, 512, 513, 1000] {
            let mut frame = Frame::from_bytes([0xA5; FRAME_LEN]);
            // SAFETY: `bytes` has at least `length` of them.
            unsafe { fill_frame(&mut frame, bytes.as_ptr(), length) }.expect("neither NULL nor empty");
            let counts = length.min(FRAME_LEN);
            assert_eq!(frame.bytes()[..counts], bytes[..counts], "{length}");
            assert!(frame.bytes()[counts..].iter().all(|byte| *byte == 0), "{length}");
        }
    }

    /// LIB-52 A read copies as many bytes as there is room for, and no more than a report has.
    #[test]
    fn a_report_fills_the_buffer_and_nothing_else() {
        let report = Frame::from_bytes([0x11; FRAME_LEN]);
        for length in [1, 503, 504, 511, 512, 513, 1000] {
            let mut bytes = [0xA5_u8; 1100];
            // SAFETY: `bytes` has more than `length` of them and outlives the buffer.
            let buffer = unsafe { ReportBuffer::new(bytes.as_mut_ptr(), length) }.expect("neither NULL nor empty");
            buffer.fill(&report);
            let counts = length.min(FRAME_LEN);
            assert!(bytes[..counts].iter().all(|byte| *byte == 0x11), "{length}");
            assert!(bytes[counts..].iter().all(|byte| *byte == 0xA5), "{length}");
        }
    }

    /// LIB-27, LIB-51, LIB-53 NULL as an address and 0 as a length are errors, each with an error of its own.
    #[test]
    fn null_and_nothing_are_errors() {
        let mut byte = 0_u8;
        let mut frame = Frame::new();
        // SAFETY: NULL is allowed, and of `byte` nothing is used.
        unsafe {
            let null = fill_frame(&mut frame, std::ptr::null(), 512);
            assert!(matches!(null.map_err(|error| *error), Err(CallError::Null { argument: "data", .. })));
            assert_eq!(fill_frame(&mut frame, &raw const byte, 0), Err(CallError::NoBytes.into()));
            assert_eq!(frame, Frame::new());
            assert!(ReportBuffer::new(std::ptr::null_mut(), 512).is_err());
            assert!(ReportBuffer::new(&raw mut byte, 0).is_err());
        }
    }
}
