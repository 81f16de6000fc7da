//! Windows' timers and sleeps.

use std::time::{Duration, Instant};

use libloading::os::windows::Library;

/// \[OURS] Timers that are coarser keep no cycle of 1 ms. Those of Windows 10 and later wake up at multiples of 500 us.
pub const COARSE: Duration = Duration::from_millis(1);
/// What to do about timers that are coarse.
pub const FINER: &str = "motion of boards behind usb: and tcp: links is timed by the board itself; simulate with clock=virtual, or on Linux";

/// Units of 100 ns in which Windows tells resolutions.
const UNIT_NS: u64 = 100;

/// How late this thread was each time.
pub fn late(period: Duration, times: usize) -> Vec<Duration> {
    let mut late = Vec::with_capacity(times);
    for _ in 0..times {
        let deadline = Instant::now() + period;
        // As the runner's thread.
        std::thread::sleep(period);
        late.push(Instant::now().saturating_duration_since(deadline));
    }
    late
}

/// How fine the timers of this machine can be; zero if Windows does not say.
pub fn timer_resolution() -> Duration {
    let (mut coarsest, mut finest, mut current) = (0_u32, 0_u32, 0_u32);
    let asked = Library::open_already_loaded("ntdll.dll").and_then(|ntdll| {
        // SAFETY: the signature is that of Windows' documentation; each place takes a number.
        unsafe {
            let ask = ntdll
                .get::<unsafe extern "system" fn(*mut u32, *mut u32, *mut u32) -> i32>("NtQueryTimerResolution\0")?;
            Ok(ask(&raw mut coarsest, &raw mut finest, &raw mut current))
        }
    });
    match asked {
        Ok(0) => Duration::from_nanos(u64::from(finest) * UNIT_NS),
        _ => Duration::ZERO,
    }
}
