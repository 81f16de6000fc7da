//! Measures with Linux how late a sleeping thread is woken, and reads the resolution of the timers.

use std::num::NonZeroU64;
use std::time::Duration;

use rustix::thread::{ClockId, clock_nanosleep_absolute};
use rustix::time::{Timespec, clock_getres, clock_gettime};

/// \[OURS] The coarsest resolution that counts as high-resolution timers. Without these the resolution is a tick of the
/// kernel, 1 ms or more.
pub const COARSE: Duration = Duration::from_micros(100);
/// The next step for a user whose timers are coarser than `COARSE`.
pub const FINER: &str = "start a kernel with high-resolution timers (CONFIG_HIGH_RES_TIMERS, no highres=off)";

/// Sleeps `times` times for `period`, and returns how late this thread was woken each time.
pub fn late(period: Duration, times: usize) -> Vec<Duration> {
    let now = || duration(clock_gettime(rustix::time::ClockId::Monotonic));
    // The thread that runs the cycles of a modelled board sets the same timer slack. With the default of 50 us Linux
    // may let a thread sleep that much longer.
    let _ = rustix::thread::set_current_timer_slack(NonZeroU64::new(1));
    let mut late = Vec::with_capacity(times);
    for _ in 0..times {
        let deadline = now() + period;
        let request = Timespec {
            tv_sec: i64::try_from(deadline.as_secs()).unwrap_or(i64::MAX),
            tv_nsec: deadline.subsec_nanos().into(),
        };
        while clock_nanosleep_absolute(ClockId::Monotonic, &request) == Err(rustix::io::Errno::INTR) {}
        late.push(now().saturating_sub(deadline));
    }
    late
}

/// The resolution of this machine's timers; without high-resolution timers a tick of the kernel, 1 to 10 ms.
pub fn timer_resolution() -> Duration {
    duration(clock_getres(rustix::time::ClockId::Monotonic))
}

fn duration(time: Timespec) -> Duration {
    Duration::new(u64::try_from(time.tv_sec).unwrap_or(0), u32::try_from(time.tv_nsec).unwrap_or(0))
}
