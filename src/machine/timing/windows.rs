//! Measures with Windows how late a sleeping thread is woken, and reads the resolution of the timers.

use std::time::{Duration, Instant};

use libloading::os::windows::Library;

/// \[OURS] The coarsest resolution that allows cycles of 1 ms. Windows 10 and later wakes threads at multiples of 500 us.
pub const COARSE: Duration = Duration::from_millis(1);
/// The next step for a user whose timers are coarser than `COARSE`.
pub const FINER: &str = "motion of boards behind usb: and tcp: links is timed by the board itself; simulate with clock=virtual, or on Linux";

/// Windows states resolutions in units of 100 ns.
const UNIT_NS: u64 = 100;

/// Sleeps `times` times for `period`, and returns how late this thread was woken each time.
pub fn late(period: Duration, times: usize) -> Vec<Duration> {
    let mut late = Vec::with_capacity(times);
    for _ in 0..times {
        let deadline = Instant::now() + period;
        // The thread that runs the cycles of a modelled board sleeps in the same way, so the lateness measured here
        // also holds for that thread.
        std::thread::sleep(period);
        late.push(Instant::now().saturating_duration_since(deadline));
    }
    late
}

/// The finest resolution of this machine's timers; zero if Windows does not report it.
pub fn timer_resolution() -> Duration {
    let (mut coarsest, mut finest, mut current) = (0_u32, 0_u32, 0_u32);
    let asked = Library::open_already_loaded("ntdll.dll").and_then(|ntdll| {
        // SAFETY: the signature is the documented one; each pointer receives a number.
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
