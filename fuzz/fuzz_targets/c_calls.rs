//! Any sequence of calls of the C functions, on boards of this process and with arguments of every kind: each gives what its
//! documentation says, touches no byte beyond what it was given, counts, and at the end no board is left open.

#![no_main]

#[path = "support/board.rs"]
mod board;
#[path = "support/frames.rs"]
mod frames;

use std::collections::BTreeMap;
use std::ffi::{CStr, CString, c_char, c_ulong};
use std::panic;
use std::ptr::{null, null_mut};
use std::sync::OnceLock;

use ecmsk::engine::Reason;
use ecmsk::link::forget_parked;
use ecmsk::sk::{CommandId, FRAME_LEN, Frame, SlotSize};
use libfuzzer_sys::fuzz_target;
// Brings the C functions in, which the linker finds by their names.
use NEXTWUSBLib as _;

/// Steps of an input at most.
const STEPS_MAX: usize = 500;
/// Bytes of a step.
const STEP: usize = 16;
/// Boards open at the same time at most.
const BOARDS_MAX: usize = 6;

/// Links that open, and then some that do not. The last one is none for the environment, where it would mean a real board.
const LINKS: [&str; 8] = [
    "sim:?slaves=drive*3,io&clock=virtual",
    "sim:?slaves=drive,hsp2&clock=virtual&slot=16&queue=2",
    "sim:?slaves=drive&clock=virtual&name=shared",
    "sim:?slaves=drive&clock=virtual&name=shared",
    "sim:?slaves=io&clock=virtual&queue=1&fw=1.5",
    "sim:?slaves=none&clock=virtual",
    "sim:?slaves=drive&clok=virtual",
    "",
];
const OPEN: usize = 5;
const SHARED: std::ops::Range<usize> = 2..4;

const OK: i32 = 0;
const ARGUMENT: i32 = -1;
const HANDLE: i32 = -2;
const TIMEOUT: i32 = -3;
const LOST: i32 = -5;
const CLOSED: i32 = -6;
const NO_BOARD: i32 = -7;
const IN_USE: i32 = -8;

/// `ecmsk_stats` and `ecmsk_counters` in numbers of 8 bytes, the first of them `size` and 0.
const STATS: usize = 16;
const COUNTERS: usize = 30;

unsafe extern "system" {
    safe fn OpenECMUSB() -> u32;
    safe fn CloseECMUSB();
    fn ECMUSBWrite(data: *const u8, length: c_ulong) -> u32;
    fn ECMUSBRead(data: *mut u8, length: c_ulong) -> u32;
}

unsafe extern "C" {
    safe fn ecmsk_version() -> *const c_char;
    safe fn ecmsk_last_error() -> *const c_char;
    fn ecmsk_open(uri: *const c_char, board: *mut usize) -> i32;
    safe fn ecmsk_close(board: usize) -> i32;
    safe fn ecmsk_vendor_board() -> usize;
    fn ecmsk_write(board: usize, data: *const u8, length: usize, timeout_ms: i64) -> i32;
    fn ecmsk_read(board: usize, data: *mut u8, length: usize, timeout_ms: i64) -> i32;
    fn ecmsk_get_stats(board: usize, stats: *mut u64) -> i32;
    fn ecmsk_get_counters(board: usize, counters: *mut u64) -> i32;
    safe fn ecmsk_reject_name(kind: u32) -> *const c_char;
    fn ecmsk_get_link_name(board: usize, buffer: *mut u8, length: usize, needed: *mut usize) -> i32;
}

fuzz_target!(|bytes: &[u8]| {
    set_up();
    let Some((&kind, bytes)) = bytes.split_first() else { return };
    let link = usize::from(kind) % (LINKS.len() - 1);
    // SAFETY: no other thread looks at the environment; the library does in calls of this one.
    unsafe { std::env::set_var("ECMSK_LINK", LINKS[link]) };
    let mut program = Program { link, vendor: None, boards: BTreeMap::new(), frame: Frame::new() };
    for step in bytes.chunks_exact(STEP).take(STEPS_MAX) {
        program.step(step);
    }
    for handle in std::mem::take(&mut program.boards).into_keys() {
        assert_eq!(ecmsk_close(handle), OK);
        assert_eq!(ecmsk_close(handle), HANDLE);
    }
    CloseECMUSB();
    CloseECMUSB();
    assert_eq!(forget_parked(), 0, "boards are open that nobody has");
});

/// The library makes panics errors of calls: here they are failures, as anywhere else.
fn set_up() {
    static ONCE: OnceLock<()> = OnceLock::new();
    ONCE.get_or_init(|| {
        let hook = panic::take_hook();
        assert!(!ecmsk_reject_name(0).is_null());
        panic::set_hook(hook);
    });
}

/// A board that is open.
#[derive(Default)]
struct Open {
    /// Frames that it has taken, reports that it has given, since it was opened.
    written: u64,
    read: u64,
    /// SW_RESET went there: it may be lost, and boot.
    is_reset: bool,
    is_shared: bool,
}

struct Program {
    link: usize,
    vendor: Option<Open>,
    boards: BTreeMap<usize, Open>,
    /// What is written.
    frame: Frame,
}

impl Program {
    fn step(&mut self, step: &[u8]) {
        let [what, a, b, c, ..] = *step else { return };
        let length = [0, 1, 3, 12, 503, 504, 511, 512, 513, 5000, usize::MAX][usize::from(b) % 11];
        match what % 14 {
            0 => self.open_vendor(),
            1 if a & 3 == 0 => {
                CloseECMUSB();
                self.vendor = None;
            }
            1 | 2 => (0..=a % 32).for_each(|_| self.vendor_write(length, c & 15 == 0)),
            3 | 4 => (0..=a).for_each(|_| self.vendor_read(length, c & 15 == 0)),
            5 => self.open(usize::from(a), b),
            6 => self.close(a),
            7 => (0..=a % 32).for_each(|_| self.write(a, length, step)),
            8 => (0..=a % 64).for_each(|_| self.read(a, length, step)),
            9 => self.counts(a, b, c & 15 == 0),
            10 => self.name(a, length.min(300), c),
            11 => {
                texts(u32::from_le_bytes([a, b, c, 0]));
            }
            12 => self.frame = board::set_up(self.size(a), b)[usize::from(c) % 3].clone(),
            _ if a & 0x80 != 0 => self.frame = Frame::new(),
            _ => self.frame.put(self.size(b), usize::from(a) % 32, &frames::slot(&step[4..])),
        }
    }

    fn size(&self, of: u8) -> SlotSize {
        SlotSize::ALL[usize::from(of) % 2]
    }

    /// A handle: an open one, or one that is none.
    fn handle(&self, of: u8) -> usize {
        let n = usize::from(of >> 5);
        match self.boards.keys().nth(n) {
            Some(handle) => *handle,
            None => [ecmsk_vendor_board(), 0, usize::MAX, 0x10, usize::from(of)][n % 5],
        }
    }

    fn found(&mut self, handle: usize) -> Result<&mut Open, i32> {
        if handle == ecmsk_vendor_board() {
            return self.vendor.as_mut().ok_or(CLOSED);
        }
        self.boards.get_mut(&handle).ok_or(HANDLE)
    }

    fn is_shared(&self) -> bool {
        self.boards.values().chain(&self.vendor).any(|board| board.is_shared)
    }

    fn open_vendor(&mut self) {
        let may_open =
            self.link < OPEN && (self.vendor.is_some() || !(SHARED.contains(&self.link) && self.is_shared()));
        let is_open = OpenECMUSB();
        match &mut self.vendor {
            Some(board) if !board.is_reset => assert_eq!(is_open, 1, "it was open: {}", last_error()),
            _ if is_open == 1 => {
                assert!(may_open);
                // One that was lost is another one now, or the same that refused to be reset.
                let is_reset = self.vendor.is_some();
                let stats = Self::stats(ecmsk_vendor_board());
                let is_shared = SHARED.contains(&self.link);
                self.vendor = Some(Open { written: stats[1], read: stats[2], is_reset, is_shared });
            }
            // Given back, and not opened: it boots. Or it is open, and lost.
            Some(_) => self.vendor = None,
            None => assert!(!may_open || !last_error().is_empty()),
        }
    }

    fn vendor_write(&mut self, length: usize, is_null: bool) {
        let is_right = !is_null && length > 0;
        let data = if is_null { null() } else { Edge::of(self.frame.bytes(), length) };
        // SAFETY: NULL, or as many readable bytes as the function looks at.
        let written = unsafe { ECMUSBWrite(data, length as c_ulong) };
        self.wrote(ecmsk_vendor_board(), written == 1, is_right, length);
    }

    fn wrote(&mut self, handle: usize, is_done: bool, is_right: bool, length: usize) {
        let resets = is_right && self.frame.bytes()[0] == CommandId::SoftReset.code();
        let Ok(board) = self.found(handle) else { return assert!(!is_done, "nothing is open") };
        assert!(is_done || !is_right || board.is_reset, "{length} bytes: {}", last_error());
        assert!(!is_done || is_right);
        board.written += u64::from(is_done);
        board.is_reset |= resets;
    }

    fn vendor_read(&mut self, length: usize, is_null: bool) {
        let mut room = Room::new();
        let data = if is_null { null_mut() } else { room.bytes.as_mut_ptr() };
        let is_right = !is_null && length > 0;
        // SAFETY: NULL, or room for as many bytes as the function writes, 512 at most.
        let read = unsafe { ECMUSBRead(data, length as c_ulong) };
        room.check(if read == 1 { length } else { 0 });
        self.was_read(ecmsk_vendor_board(), read == 1, is_right);
    }

    fn was_read(&mut self, handle: usize, is_done: bool, is_right: bool) {
        let Ok(board) = self.found(handle) else { return assert!(!is_done, "nothing is open") };
        assert!(is_done || !is_right || board.is_reset, "{}", last_error());
        assert!(!is_done || is_right);
        board.read += u64::from(is_done);
    }

    fn open(&mut self, which: usize, how: u8) {
        let link = which % LINKS.len();
        let mut handle = usize::MAX;
        let uri = CString::new(LINKS[link]).expect("without a 0");
        let (uri, odd) = match how & 15 {
            0 => (null(), true),
            1 => (c"\xFF\xFE".as_ptr(), true),
            _ => (uri.as_ptr(), false),
        };
        if how & 0xF0 == 0 {
            // SAFETY: a text that ends with 0 or NULL; the handle has no room.
            assert_eq!(unsafe { ecmsk_open(uri, null_mut()) }, ARGUMENT);
            return;
        }
        if self.boards.len() == BOARDS_MAX {
            return;
        }
        // SAFETY: a text that ends with 0 or NULL, and room for a handle.
        let opened = unsafe { ecmsk_open(uri, &raw mut handle) };
        let is_shared = SHARED.contains(&link);
        let expected: &[i32] = match link {
            _ if odd => &[ARGUMENT],
            _ if is_shared && self.is_shared() => &[IN_USE],
            // One that was reset and closed may still boot.
            _ if is_shared => &[OK, NO_BOARD],
            0..OPEN => &[OK],
            5 => &[NO_BOARD],
            _ => &[ARGUMENT],
        };
        assert!(expected.contains(&opened), "{} gives {opened}: {}", LINKS[link], last_error());
        assert_eq!(opened == OK, handle != 0, "NULL where it fails");
        if opened == OK {
            assert!(handle != ecmsk_vendor_board());
            let board = Open { is_shared, ..Open::default() };
            assert!(self.boards.insert(handle, board).is_none(), "a handle that is in use");
        }
    }

    fn close(&mut self, which: u8) {
        let handle = self.handle(which);
        let expected = if handle == ecmsk_vendor_board() || self.boards.contains_key(&handle) { OK } else { HANDLE };
        assert_eq!(ecmsk_close(handle), expected);
        if handle == ecmsk_vendor_board() {
            self.vendor = None;
        }
        self.boards.remove(&handle);
    }

    fn write(&mut self, which: u8, length: usize, step: &[u8]) {
        let (handle, timeout) = (self.handle(which), timeout(step[3], step[4]));
        let is_null = step[5] & 15 == 1;
        let data = if is_null { null() } else { Edge::of(self.frame.bytes(), length) };
        // SAFETY: NULL, or as many readable bytes as the function looks at.
        let result = unsafe { ecmsk_write(handle, data, length, timeout) };
        let is_right = !is_null && length > 0;
        self.check(handle, is_right, timeout, result);
        self.wrote(handle, result == OK, is_right && timeout >= -2, length);
    }

    fn read(&mut self, which: u8, length: usize, step: &[u8]) {
        let (handle, timeout) = (self.handle(which), timeout(step[3], step[4]));
        let is_null = step[5] & 15 == 1;
        let mut room = Room::new();
        let data = if is_null { null_mut() } else { room.bytes.as_mut_ptr() };
        // SAFETY: NULL, or room for as many bytes as the function writes, 512 at most.
        let result = unsafe { ecmsk_read(handle, data, length, timeout) };
        room.check(if result == OK { length } else { 0 });
        let is_right = !is_null && length > 0;
        self.check(handle, is_right, timeout, result);
        if result == TIMEOUT {
            assert!((0..1000).contains(&timeout), "a report comes each cycle");
            return;
        }
        self.was_read(handle, result == OK, is_right && timeout >= -2);
    }

    /// The codes that a read or a write may give.
    fn check(&mut self, handle: usize, is_right: bool, timeout: i64, result: i32) {
        let expected: &[i32] = match self.found(handle) {
            _ if !is_right => &[ARGUMENT],
            Err(code) => &[code],
            _ if timeout < -2 => &[ARGUMENT],
            Ok(board) if board.is_reset => &[OK, TIMEOUT, LOST],
            Ok(_) => &[OK, TIMEOUT],
        };
        assert!(expected.contains(&result), "{result}: {}", last_error());
        assert!(result == OK || !last_error().is_empty());
    }

    fn counts(&mut self, which: u8, room: u8, is_null: bool) {
        let handle = self.handle(which);
        let size = usize::from(room) * 2;
        for is_stats in [true, false] {
            let whole = if is_stats { STATS } else { COUNTERS } * 8;
            let mut numbers = [0xA5A5_A5A5_A5A5_A5A5_u64; 70];
            numbers[0] = size as u64;
            let to = if is_null { null_mut() } else { numbers.as_mut_ptr() };
            // SAFETY: NULL, or a structure that begins with the number of its writable bytes, of which there are more.
            let result = unsafe { if is_stats { ecmsk_get_stats(handle, to) } else { ecmsk_get_counters(handle, to) } };
            let filled = size.min(whole) / 8;
            let expected = match self.found(handle) {
                Err(code) => code,
                Ok(_) if is_null || filled == 0 => ARGUMENT,
                Ok(_) => OK,
            };
            assert_eq!(result, expected, "{}", last_error());
            let filled = if result == OK { filled } else { 1 };
            assert!(numbers[filled..].iter().all(|number| *number == 0xA5A5_A5A5_A5A5_A5A5), "beyond {filled}");
            assert_eq!(numbers[0], if result == OK { filled as u64 * 8 } else { size as u64 });
            if let (true, OK, 3.., Ok(board)) = (is_stats, result, filled, self.found(handle)) {
                assert_eq!((numbers[1], numbers[2]), (board.written, board.read), "written and read");
            }
        }
    }

    fn stats(handle: usize) -> [u64; STATS] {
        let mut stats = [0; STATS];
        stats[0] = STATS as u64 * 8;
        // SAFETY: it begins with its own size.
        assert_eq!(unsafe { ecmsk_get_stats(handle, stats.as_mut_ptr()) }, OK);
        assert_eq!(stats[0], STATS as u64 * 8, "the structure has another size");
        stats
    }

    fn name(&mut self, which: u8, length: usize, how: u8) {
        let handle = self.handle(which);
        let mut room = Room::new();
        let mut needed = usize::MAX;
        let buffer = if how & 1 == 0 { room.bytes.as_mut_ptr() } else { null_mut() };
        let to = if how & 2 == 0 { &raw mut needed } else { null_mut() };
        // SAFETY: NULL, or room for as many bytes as it says; NULL, or room for a number.
        let result = unsafe { ecmsk_get_link_name(handle, buffer, length, to) };
        let expected = match self.found(handle) {
            _ if buffer.is_null() && length > 0 => ARGUMENT,
            Err(code) => code,
            Ok(_) => OK,
        };
        assert_eq!(result, expected, "{}", last_error());
        room.check(if result == OK && !buffer.is_null() { length } else { 0 });
        if result == OK && !to.is_null() {
            assert!((5..300).contains(&needed), "{needed}");
        }
        if result == OK && length > 0 {
            let text = CStr::from_bytes_until_nul(&room.bytes[..length]).expect("it ends with a 0");
            assert!(
                text.to_bytes().len() < length && "sim:?".starts_with(&text.to_string_lossy()[..length.min(6) - 1])
            );
        }
    }
}

fn timeout(kind: u8, of: u8) -> i64 {
    match kind % 6 {
        0 => 0,
        1 => -1,
        2 => -2,
        3 => -3 - i64::from(of),
        4 => i64::MAX,
        _ => i64::from(of),
    }
}

fn texts(kind: u32) {
    let text = |text: *const c_char| {
        // SAFETY: the library's own text, which ends with a 0 and lives as long as it.
        (!text.is_null()).then(|| unsafe { CStr::from_ptr(text) }.to_str().expect("UTF-8"))
    };
    assert!(text(ecmsk_version()).is_some_and(|version| version.split('.').count() == 3));
    let is_known = usize::try_from(kind).is_ok_and(|kind| kind < Reason::KINDS);
    assert_eq!(text(ecmsk_reject_name(kind)).is_some_and(|name| !name.is_empty()), is_known);
    assert!(last_error().len() < 2048);
}

fn last_error() -> String {
    // SAFETY: it ends with a 0; this thread makes no call before it is copied.
    unsafe { CStr::from_ptr(ecmsk_last_error()) }.to_str().expect("UTF-8").to_owned()
}

/// Bytes before a page that nobody may touch.
struct Edge;

impl Edge {
    /// The first bytes of a frame where that page begins, as many as a call may look at.
    fn of(frame: &[u8; FRAME_LEN], length: usize) -> *const u8 {
        const PAGE: usize = 4096;
        static PAGES: OnceLock<usize> = OnceLock::new();
        let end = PAGES.get_or_init(|| {
            let access = libc::PROT_READ | libc::PROT_WRITE;
            let how = libc::MAP_PRIVATE | libc::MAP_ANONYMOUS;
            // SAFETY: new pages of this process's own, of which the second one is closed.
            let pages = unsafe { libc::mmap(null_mut(), 2 * PAGE, access, how, -1, 0) };
            assert_ne!(pages, libc::MAP_FAILED);
            // SAFETY: as above.
            assert_eq!(unsafe { libc::mprotect(pages.byte_add(PAGE), PAGE, libc::PROT_NONE) }, 0);
            pages.expose_provenance() + PAGE
        });
        let count = length.min(FRAME_LEN);
        let place = std::ptr::with_exposed_provenance_mut::<u8>(end - count);
        // SAFETY: so many bytes before the second page, and nobody else uses the first one.
        unsafe { std::ptr::copy_nonoverlapping(frame.as_ptr(), place, count) };
        place
    }
}

/// Room that is greater than what a call may write.
struct Room {
    bytes: [u8; 2 * FRAME_LEN],
}

impl Room {
    const fn new() -> Self {
        Self { bytes: [0xA5; 2 * FRAME_LEN] }
    }

    /// Nothing was written beyond so many bytes.
    fn check(&self, length: usize) {
        let beyond = &self.bytes[length.min(FRAME_LEN)..];
        assert!(beyond.iter().all(|byte| *byte == 0xA5), "more than {length} bytes were written");
    }
}
