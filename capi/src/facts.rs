//! What the library and an open board say of themselves: version, last error, counters, name of the link.

use std::ffi::{CStr, CString, c_char};

use ecmsk::engine::Reason;
use ecmsk::link::fault::FaultCounts;

use crate::boards::{EcmskBoard, EcmskResult, code, find};
use crate::entry::entry;
use crate::error::{self, CallError};

/// Room for kinds of rejection: more than there are, so that a later version can count more.
pub const ECMSK_REJECT_KINDS: usize = 16;
const _: () = assert!(Reason::KINDS <= ECMSK_REJECT_KINDS);

/// Faults that a link injected in one direction (`fault.` keys), since it was opened.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(C)]
pub struct EcmskFaults {
    /// Frames lost on the way.
    pub dropped: u64,
    /// Frames with a bit turned over.
    pub corrupted: u64,
    /// Frames that arrived twice.
    pub duplicated: u64,
    /// Frames that were held up.
    pub delayed: u64,
}

impl From<FaultCounts> for EcmskFaults {
    fn from(FaultCounts { dropped, corrupted, duplicated, delayed }: FaultCounts) -> Self {
        Self { dropped, corrupted, duplicated, delayed }
    }
}

/// What a link moved since it was opened. Set `size` to sizeof of the structure before the call; afterwards it is the
/// number of bytes filled in.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(C)]
pub struct EcmskStats {
    /// Bytes of this structure.
    pub size: u32,
    /// 0.
    pub reserved: u32,
    /// Frames written.
    pub written: u64,
    /// Reports handed out.
    pub read: u64,
    /// Reports dropped because nobody read them; the oldest goes first.
    pub reports_dropped: u64,
    /// Writes that ended with an error.
    pub write_errors: u64,
    /// Reads that ended with an error.
    pub read_errors: u64,
    /// Frames that a recording could not take.
    pub record_dropped: u64,
    /// Faults injected into command frames.
    pub write_faults: EcmskFaults,
    /// Faults injected into reports.
    pub read_faults: EcmskFaults,
    /// 1: a fault took the board away; else 0.
    pub disconnected: u64,
}

/// What happened to commands on the board since it booted. `size` as in `ecmsk_stats`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(C)]
pub struct EcmskCounters {
    /// Bytes of this structure.
    pub size: u32,
    /// 0.
    pub reserved: u32,
    /// Command frames that arrived.
    pub frames: u64,
    /// Reports made.
    pub reports: u64,
    /// Commands rejected, by reason; `ecmsk_reject_name` names the reasons.
    pub rejected: [u64; ECMSK_REJECT_KINDS],
    /// Commands that came for a slave while it was homing.
    pub ignored_homing: u64,
    /// Targets that came before Operation enabled.
    pub discarded_before_enabled: u64,
    /// FIFO entries dropped by SET_FIFO 1 or by leaving OP.
    pub cleared: u64,
    /// Frames that found the FIFO full.
    pub full: u64,
    /// Frames with a wrong CRC.
    pub crc: u64,
    /// Frames that did not arrive completely.
    pub incomplete: u64,
    /// FIFO entries executed.
    pub executed: u64,
    /// Cycles in OP that took no entry: the FIFO was empty, or waited for its threshold.
    pub idle_cycles: u64,
    /// Command frames that arrived while the board booted; not among `frames`.
    pub while_booting: u64,
    /// Commands for slaves that were lost.
    pub for_lost: u64,
    /// Times the mode after homing could not be written back: the drive has stayed in mode 6.
    pub modes_not_restored: u64,
}

/// A structure that begins with its own size.
///
/// # Safety
/// `repr(C)`, made of integers without padding; the first four bytes are the `size`, set to that of the type.
unsafe trait Versioned: Copy {}
// SAFETY: see the declarations: u32, u32, then u64 and structures of u64 only; `size` is set where they are made.
unsafe impl Versioned for EcmskStats {}
// SAFETY: as above.
unsafe impl Versioned for EcmskCounters {}

/// `size` and `reserved`: with less than that a structure holds nothing.
const HEAD: usize = 8;

/// The version of this library, as `0.1.0`.
///
/// # Safety
/// None. The text lives as long as the library.
#[unsafe(no_mangle)]
pub extern "C" fn ecmsk_version() -> *const c_char {
    const VERSION: &CStr = match CStr::from_bytes_with_nul(concat!(env!("CARGO_PKG_VERSION"), "\0").as_bytes()) {
        Ok(version) => version,
        Err(_) => panic!("a version holds no 0"),
    };
    VERSION.as_ptr()
}

/// Why the last call of this thread that failed did so, in words, those of the vendor's functions included; if none
/// failed in this thread, why OpenECMUSB failed last in any; else an empty text. A call that succeeds changes nothing.
///
/// # Safety
/// None. The text is at one address for as long as the thread lives, at most 2047 bytes; the next call of this thread
/// that fails writes its own text there.
#[unsafe(no_mangle)]
pub extern "C" fn ecmsk_last_error() -> *const c_char {
    std::panic::catch_unwind(error::last).unwrap_or(c"".as_ptr())
}

/// Statistics of the link since it was opened.
///
/// # Safety
/// `stats` is NULL or points to `stats->size` writable bytes. `board` may be any value.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecmsk_get_stats(board: *mut EcmskBoard, stats: *mut EcmskStats) -> EcmskResult {
    let handle = board.addr();
    code(entry!(ecmsk_get_stats(handle), {
        let link = find(handle)?.link.stats();
        let ours = EcmskStats {
            size: size_of::<EcmskStats>() as u32,
            reserved: 0,
            written: link.written,
            read: link.read,
            reports_dropped: link.reports_dropped,
            write_errors: link.write_errors,
            read_errors: link.read_errors,
            record_dropped: link.record_dropped,
            write_faults: link.faults.write.into(),
            read_faults: link.faults.read.into(),
            disconnected: link.faults.disconnected.into(),
        };
        // SAFETY: as this function's own.
        unsafe { give(ours, stats, "stats") }
    }))
}

/// The board's own counters since it booted. A link that does not see them, such as `usb:`, gives
/// `ECMSK_ERROR_UNSUPPORTED`.
///
/// # Safety
/// `counters` is NULL or points to `counters->size` writable bytes. `board` may be any value.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecmsk_get_counters(board: *mut EcmskBoard, counters: *mut EcmskCounters) -> EcmskResult {
    let handle = board.addr();
    code(entry!(ecmsk_get_counters(handle), {
        let link = &find(handle)?.link;
        let Some(board) = link.stats().board else {
            return Err(CallError::NoCounters { link: link.info().name }.into());
        };
        let mut rejected = [0; ECMSK_REJECT_KINDS];
        rejected[..Reason::KINDS].copy_from_slice(&board.rejected);
        let ours = EcmskCounters {
            size: size_of::<EcmskCounters>() as u32,
            reserved: 0,
            frames: board.frames,
            reports: board.reports,
            rejected,
            ignored_homing: board.ignored_homing,
            discarded_before_enabled: board.discarded_before_enabled,
            cleared: board.cleared,
            full: board.full,
            crc: board.crc,
            incomplete: board.incomplete,
            executed: board.executed,
            idle_cycles: board.idle_cycles,
            while_booting: board.while_booting,
            for_lost: board.for_lost,
            modes_not_restored: board.modes_not_restored,
        };
        // SAFETY: as this function's own.
        unsafe { give(ours, counters, "counters") }
    }))
}

/// The name of a reason for rejection, an index into `rejected` of `ecmsk_counters`, or NULL if there is none.
///
/// # Safety
/// None. The text lives as long as the library.
#[unsafe(no_mangle)]
pub extern "C" fn ecmsk_reject_name(kind: u32) -> *const c_char {
    static NAMES: std::sync::LazyLock<Vec<CString>> =
        std::sync::LazyLock::new(|| Reason::NAMES.iter().filter_map(|name| CString::new(*name).ok()).collect());
    let name = entry!(ecmsk_reject_name(kind), { Ok(usize::try_from(kind).ok().and_then(|kind| NAMES.get(kind))) });
    name.ok().flatten().map_or(std::ptr::null(), |name| name.as_ptr())
}

/// Copies the link's URI in its normal form to `buffer`, at most `length` bytes, the last of them 0; a longer one is cut.
/// The bytes that it needs whole, the 0 included, go to `*needed` if that is not NULL.
///
/// # Safety
/// `buffer` is NULL (then `length` must be 0) or points to `length` writable bytes. `needed` is NULL or points to room
/// for a `size_t`. `board` may be any value.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecmsk_get_link_name(
    board: *mut EcmskBoard,
    buffer: *mut c_char,
    length: usize,
    needed: *mut usize,
) -> EcmskResult {
    let handle = board.addr();
    code(entry!(ecmsk_get_link_name(handle, length), {
        if buffer.is_null() && length > 0 {
            return Err(CallError::Null { argument: "buffer", expected: "`length` bytes" }.into());
        }
        let name = find(handle)?.link.info().name;
        if !needed.is_null() {
            // SAFETY: not NULL, and the caller vouches for room.
            unsafe { needed.write(name.len() + 1) };
        }
        if length > 0 {
            let cut = name.floor_char_boundary(length - 1);
            // SAFETY: `cut` is at most `length - 1`, so text and 0 fit into the `length` bytes vouched for; the name is
            // a local of ours.
            unsafe {
                std::ptr::copy_nonoverlapping(name.as_ptr(), buffer.cast(), cut);
                buffer.add(cut).write(0);
            }
        }
        Ok(())
    }))
}

/// Copies as much of `ours` as the caller has room for, in whole counters.
///
/// # Safety
/// `theirs` is NULL or points to a `u32` with the number of writable bytes there.
unsafe fn give<T: Versioned>(ours: T, theirs: *mut T, argument: &'static str) -> Result<(), Box<CallError>> {
    if theirs.is_null() {
        return Err(CallError::Null { argument, expected: "a structure whose `size` is set" }.into());
    }
    let size = theirs.cast::<u32>();
    // SAFETY: not NULL; the caller vouches for the `size` in front, at whatever address.
    let found = unsafe { size.read_unaligned() };
    let filled = (found as usize).min(size_of::<T>()) / HEAD * HEAD;
    if filled < HEAD {
        return Err(CallError::StructSize { found, least: HEAD }.into());
    }
    // SAFETY: `filled` is within `ours` and within the bytes that the caller vouches for; `ours` is a local.
    unsafe {
        std::ptr::copy_nonoverlapping((&raw const ours).cast::<u8>(), theirs.cast::<u8>(), filled);
        size.write_unaligned(filled as u32);
    }
    Ok(())
}
