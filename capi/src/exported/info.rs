//! The exported functions that return information: version, last error, counters, name of the link.

use std::ffi::{CStr, CString, c_char};

use ecmsk::engine::{Counters, Reason};
use ecmsk::link::fault::FaultCounts;

use crate::buffer::{TextBuffer, Versioned, copy_out};
use crate::error::{self, CallError};
use crate::exported::boards::{EcmskBoard, EcmskResult, code, find};
use crate::exported::entry::entry;

/// The number of entries of `rejected` in `ecmsk_counters`. There are fewer reasons, so that a later version can add some.
pub const ECMSK_REJECT_KINDS: usize = 16;
const _: () = assert!(Reason::KINDS <= ECMSK_REJECT_KINDS);

/// The faults that a link has injected in one direction since it was opened (keys `fault.` of its URI).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(C)]
pub struct EcmskFaults {
    /// Frames that were dropped.
    pub dropped: u64,
    /// Frames in which a bit was inverted.
    pub corrupted: u64,
    /// Frames that were delivered twice.
    pub duplicated: u64,
    /// Frames that were delayed.
    pub delayed: u64,
}

impl From<FaultCounts> for EcmskFaults {
    fn from(FaultCounts { dropped, corrupted, duplicated, delayed }: FaultCounts) -> Self {
        Self { dropped, corrupted, duplicated, delayed }
    }
}

/// The statistics of a link since it was opened. Set `size` to the sizeof of the structure before the call. After the call,
/// `size` is the number of bytes that were filled in.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(C)]
pub struct EcmskStats {
    /// The size of this structure in bytes.
    pub size: u32,
    /// Always 0. It aligns the counters to 8 bytes.
    pub reserved: u32,
    /// Command frames written.
    pub written: u64,
    /// Reports read.
    pub read: u64,
    /// Reports dropped because nobody read them in time. The oldest is dropped first.
    pub reports_dropped: u64,
    /// Writes that ended with an error.
    pub write_errors: u64,
    /// Reads that ended with an error.
    pub read_errors: u64,
    /// Frames missing in a recording because it could not be written fast enough.
    pub record_dropped: u64,
    /// Faults injected into command frames.
    pub write_faults: EcmskFaults,
    /// Faults injected into reports.
    pub read_faults: EcmskFaults,
    /// 1 if an injected fault has disconnected the board, otherwise 0.
    pub disconnected: u64,
}

/// The counters of the board since it booted. `size` is used as in `ecmsk_stats`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(C)]
pub struct EcmskCounters {
    /// The size of this structure in bytes.
    pub size: u32,
    /// Always 0. It aligns the counters to 8 bytes.
    pub reserved: u32,
    /// Command frames received.
    pub frames: u64,
    /// Reports sent.
    pub reports: u64,
    /// Commands rejected, by reason. `ecmsk_reject_name` names the reason of an index.
    pub rejected: [u64; ECMSK_REJECT_KINDS],
    /// Commands for a slave that were ignored because it was homing.
    pub ignored_homing: u64,
    /// Targets discarded because the drive was not in Operation enabled yet.
    pub discarded_before_enabled: u64,
    /// FIFO entries dropped by SET_FIFO 1 or by leaving OP.
    pub cleared: u64,
    /// Command frames lost because the FIFO was full.
    pub full: u64,
    /// Command frames refused because of a wrong CRC.
    pub crc: u64,
    /// Command frames of which only a part was received.
    pub incomplete: u64,
    /// FIFO entries executed.
    pub executed: u64,
    /// Cycles in OP that executed no entry: the FIFO was empty, or below its threshold.
    pub idle_cycles: u64,
    /// Command frames lost because the board was booting; not counted in `frames`.
    pub while_booting: u64,
    /// Commands for slaves that had left the network.
    pub for_lost: u64,
    /// How often the mode of operation could not be written back after homing, so that the drive stays in mode 6.
    pub modes_not_restored: u64,
    /// SDO requests that repeat the one under way; nothing is lost by them.
    pub sdo_repeated: u64,
    /// SDO transfers that the slave has aborted, or that were not answered in time.
    pub sdo_aborted: u64,
    /// Cycles without a report because a chip or a network card lost their answers.
    pub answers_lost: u64,
    /// FIFO entries that a chip or a network card had accepted and that a slave has missed, or may have missed.
    pub outputs_lost: u64,
    /// Cycles that were skipped on a network card because the machine was too late for them. Moving axes stood still meanwhile.
    pub cycles_left_out: u64,
    /// Cycles in OP in which the ring of cables between two network cards was broken. No data are lost by that.
    pub ring_broken: u64,
    /// Cycles in OP in which a slave kept its previous inputs because the working counter of the new ones was wrong.
    pub inputs_held: u64,
    /// How often the inputs of a slave were missing for so long that the slave counts as lost.
    pub inputs_stale: u64,
}

// SAFETY: declared as u32, u32, then only u64 and structures of u64. `size` is set where a value is made.
unsafe impl Versioned for EcmskStats {}
// SAFETY: declared like `EcmskStats`: u32, u32, then only u64.
unsafe impl Versioned for EcmskCounters {}

/// The version of this library, such as `0.1.0`.
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

/// The error text of the last call of this thread that failed, including calls of the vendor's functions. If no call of this
/// thread has failed, it is the text of the last OpenECMUSB that failed in any thread. If none has failed, it is an empty
/// text. A call that succeeds does not change the text.
///
/// # Safety
/// None. The text has at most 2047 bytes and stays at the same address as long as the thread lives; the next call of this
/// thread that fails overwrites it.
#[unsafe(no_mangle)]
pub extern "C" fn ecmsk_last_error() -> *const c_char {
    std::panic::catch_unwind(error::last).unwrap_or(c"".as_ptr())
}

/// Gets the statistics of a board's link since it was opened.
///
/// # Safety
/// `stats` is NULL or points to `stats->size` writable bytes. `board` may be any value.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecmsk_get_stats(board: *mut EcmskBoard, stats: *mut EcmskStats) -> EcmskResult {
    let handle = board.addr();
    code(entry!(ecmsk_get_stats(handle), {
        let link = find(handle)?.link.stats();
        let value = EcmskStats {
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
        // SAFETY: the caller's promise for `stats`.
        unsafe { copy_out(value, stats, "stats") }
    }))
}

impl From<&Counters> for EcmskCounters {
    fn from(board: &Counters) -> Self {
        let mut rejected = [0; ECMSK_REJECT_KINDS];
        rejected[..Reason::KINDS].copy_from_slice(&board.rejected);
        Self {
            size: size_of::<Self>() as u32,
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
            sdo_repeated: board.sdo_repeated,
            sdo_aborted: board.sdo_aborted,
            answers_lost: board.answers_lost,
            outputs_lost: board.outputs_lost,
            cycles_left_out: board.cycles_left_out,
            ring_broken: board.ring_broken,
            inputs_held: board.inputs_held,
            inputs_stale: board.inputs_stale,
        }
    }
}

/// Gets the counters of the board since it booted. Only the modelled board has them; on other links, such as `usb:`, the
/// result is `ECMSK_ERROR_UNSUPPORTED`.
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
        // SAFETY: the caller's promise for `counters`.
        unsafe { copy_out(EcmskCounters::from(&board), counters, "counters") }
    }))
}

/// The name of the reason with index `kind` in `rejected` of `ecmsk_counters`; NULL if there is no such reason.
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

/// Copies the URI of a board's link, in its normal form and with a terminating 0, to the `length` bytes at `buffer`; a longer
/// URI is cut. The number of bytes that the whole URI needs, including the 0, is written to `*needed` unless `needed` is NULL.
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
        // SAFETY: the caller's promise for `buffer` and `needed`.
        let buffer = unsafe { TextBuffer::new(buffer, length, needed) }?;
        buffer.fill(&find(handle)?.link.info().name);
        Ok(())
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Each counter of the board is in the field of its name.
    #[test]
    fn each_counter_has_its_field() {
        let mut board =
            Counters { frames: 1, reports: 2, ignored_homing: 3, discarded_before_enabled: 4, ..Counters::default() };
        (board.cleared, board.full, board.crc, board.incomplete, board.executed) = (5, 6, 7, 8, 9);
        (board.idle_cycles, board.while_booting, board.for_lost, board.modes_not_restored) = (10, 11, 12, 13);
        (board.sdo_repeated, board.sdo_aborted, board.answers_lost, board.outputs_lost) = (14, 15, 16, 17);
        (board.cycles_left_out, board.ring_broken, board.inputs_held, board.inputs_stale) = (18, 19, 20, 21);
        board.rejected[Reason::KINDS - 1] = 22;
        let shown = EcmskCounters::from(&board);
        assert_eq!([shown.frames, shown.reports, shown.ignored_homing, shown.discarded_before_enabled], [1, 2, 3, 4]);
        assert_eq!([shown.cleared, shown.full, shown.crc, shown.incomplete, shown.executed], [5, 6, 7, 8, 9]);
        let waited = [shown.idle_cycles, shown.while_booting, shown.for_lost, shown.modes_not_restored];
        assert_eq!(waited, [10, 11, 12, 13]);
        assert_eq!([shown.sdo_repeated, shown.sdo_aborted, shown.answers_lost, shown.outputs_lost], [14, 15, 16, 17]);
        assert_eq!([shown.cycles_left_out, shown.ring_broken, shown.inputs_held, shown.inputs_stale], [18, 19, 20, 21]);
        assert_eq!((shown.rejected[Reason::KINDS - 1], shown.size), (22, size_of::<EcmskCounters>() as u32));
    }
}
