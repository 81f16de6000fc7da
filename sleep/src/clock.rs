//! The virtual clock of the process. It begins at 0 and never goes back.

use std::ffi::c_int;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, Ordering};

use crate::{counts, system, threads};

/// How far the virtual clock advances when the program reads a clock, in nanoseconds \[OURS]. Without it a loop that
/// waits only by reading a clock would never end.
const READ_NS: u64 = 1_000;

/// The deadline of a wait that has none.
pub const NEVER: u64 = u64::MAX;

/// The longest wait that has a deadline \[OURS], in nanoseconds: ten years. Programs use a longer wait to wait for
/// ever, so it has no deadline, and no board has to advance that far.
const WAIT_MAX_NS: u64 = 10 * 365 * 86_400 * 1_000_000_000;

/// The virtual clock, in nanoseconds.
static NOW: AtomicU64 = AtomicU64::new(0);
/// The earliest deadline of a thread that waits, or [`NEVER`].
static EARLIEST: AtomicU64 = AtomicU64::new(NEVER);

/// The time of the virtual clock, in nanoseconds.
pub fn now() -> u64 {
    NOW.load(Ordering::Acquire)
}

/// Advances the virtual clock by [`READ_NS`], for a call of the program that reads a clock, and returns its time.
pub fn read() -> u64 {
    // The clock stops before [`NEVER`], so that it never reaches the deadline of a wait that has none.
    let on = |now: u64| now.saturating_add(READ_NS).min(NEVER - 1);
    let (Ok(before) | Err(before)) = NOW.fetch_update(Ordering::AcqRel, Ordering::Acquire, |now| Some(on(now)));
    let now = on(before);
    after(now);
    now
}

/// Advances the clock to a time that a board has reached, and wakes the threads whose deadline has come.
pub fn reach(time: u64) {
    if NOW.fetch_max(time, Ordering::AcqRel) < time {
        after(time);
    }
}

/// Advances the clock and wakes no thread. Only for code that ends the waits itself.
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

/// The times of the system's clocks when the process began, in whole seconds, as nanoseconds.
struct Starts {
    realtime: u64,
    tai: u64,
    monotonic: u64,
    raw: u64,
    boottime: u64,
}

static STARTS: OnceLock<Starts> = OnceLock::new();

/// Reads the clocks of the system, at whose times the clocks of the program begin.
pub fn begin() {
    starts();
}

/// Rounds the times down to whole seconds \[OURS], so that a program that waits for the next second of time() waits
/// equally long in every run.
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

/// The time that a clock of the program shows when the virtual clock is at 0, in nanoseconds. `None`: the clock stays
/// real, because it does not measure elapsed time, as the processor-time clocks.
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

/// Converts a time that a clock of the program shows to a deadline on the virtual clock; `None` if the clock stays
/// real.
pub fn deadline(clock: c_int, shown_ns: u64) -> Option<u64> {
    let deadline = shown_ns.saturating_sub(start(clock)?);
    Some(if deadline.saturating_sub(now()) > WAIT_MAX_NS { NEVER } else { deadline })
}

/// The deadline of a wait that begins now and lasts `ns` nanoseconds.
pub fn in_ns(ns: u64) -> u64 {
    if ns > WAIT_MAX_NS { NEVER } else { now().saturating_add(ns).min(NEVER - 1) }
}
