//! The virtual clock of the process. It begins at 0 and never goes back.

use std::ffi::c_int;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, Ordering};

use crate::{counts, system, threads};

/// How far the virtual clock goes on when the program reads a clock \[OURS]: a loop that waits by reading a clock alone ends.
const READ_NS: u64 = 1_000;

/// No deadline.
pub const NEVER: u64 = u64::MAX;

/// The longest wait that has an end \[OURS], in nanoseconds: ten years. A longer one is how programs wait for ever, and no
/// board passes it.
const WAIT_MAX_NS: u64 = 10 * 365 * 86_400 * 1_000_000_000;

/// The virtual clock, in nanoseconds.
static NOW: AtomicU64 = AtomicU64::new(0);
/// The earliest deadline of a thread that waits, or [`NEVER`].
static EARLIEST: AtomicU64 = AtomicU64::new(NEVER);

/// The virtual clock.
pub fn now() -> u64 {
    NOW.load(Ordering::Acquire)
}

/// The virtual clock for a call of the program that reads a clock.
pub fn read() -> u64 {
    // The clock ends before it, so that it reaches no wait without a deadline.
    let on = |now: u64| now.saturating_add(READ_NS).min(NEVER - 1);
    let (Ok(before) | Err(before)) = NOW.fetch_update(Ordering::AcqRel, Ordering::Acquire, |now| Some(on(now)));
    let now = on(before);
    after(now);
    now
}

/// A board has reached this time: threads whose deadline it is go on.
pub fn reach(time: u64) {
    if NOW.fetch_max(time, Ordering::AcqRel) < time {
        after(time);
    }
}

/// Sets the clock on without a look at deadlines. Only for the code that knows them.
pub fn set_on(time: u64) {
    NOW.fetch_max(time, Ordering::AcqRel);
    counts::time(time);
}

/// Sets the earliest deadline, at which [`read`] and [`reach`] wake threads.
pub fn set_earliest(deadline: u64) {
    EARLIEST.store(deadline, Ordering::Release);
}

fn after(now: u64) {
    counts::time(now);
    if now >= EARLIEST.load(Ordering::Acquire) {
        threads::wake_due();
    }
}

/// When the process began on the clocks of the system, in nanoseconds.
struct Starts {
    realtime: u64,
    tai: u64,
    monotonic: u64,
    raw: u64,
    boottime: u64,
}

static STARTS: OnceLock<Starts> = OnceLock::new();

/// Reads the clocks of the system, from which those of the program go on.
pub fn begin() {
    starts();
}

/// Whole seconds \[OURS]: a program that waits for the next second of time() waits as long in every run.
fn starts() -> &'static Starts {
    STARTS.get_or_init(|| {
        let whole = |clock| system::real_ns(clock) / 1_000_000_000 * 1_000_000_000;
        Starts {
            realtime: whole(libc::CLOCK_REALTIME),
            tai: whole(libc::CLOCK_TAI),
            monotonic: whole(libc::CLOCK_MONOTONIC),
            raw: whole(libc::CLOCK_MONOTONIC_RAW),
            boottime: whole(libc::CLOCK_BOOTTIME),
        }
    })
}

/// What a clock of the program shows when the virtual clock is at 0. `None`: the clock measures no time that passes for all,
/// as those of the processor time do, and stays real.
pub fn start(clock: c_int) -> Option<u64> {
    let starts = starts();
    match clock {
        libc::CLOCK_REALTIME | libc::CLOCK_REALTIME_COARSE | libc::CLOCK_REALTIME_ALARM => Some(starts.realtime),
        libc::CLOCK_MONOTONIC | libc::CLOCK_MONOTONIC_COARSE => Some(starts.monotonic),
        libc::CLOCK_MONOTONIC_RAW => Some(starts.raw),
        libc::CLOCK_BOOTTIME | libc::CLOCK_BOOTTIME_ALARM => Some(starts.boottime),
        libc::CLOCK_TAI => Some(starts.tai),
        _ => None,
    }
}

/// The deadline on the virtual clock of a time that a clock of the program shows.
pub fn deadline(clock: c_int, shown_ns: u64) -> Option<u64> {
    let deadline = shown_ns.saturating_sub(start(clock)?);
    Some(if deadline.saturating_sub(now()) > WAIT_MAX_NS { NEVER } else { deadline })
}

/// The deadline of a wait that begins now.
pub fn in_ns(ns: u64) -> u64 {
    if ns > WAIT_MAX_NS { NEVER } else { now().saturating_add(ns).min(NEVER - 1) }
}
