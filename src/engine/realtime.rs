//! Services of the operating system for the runner's thread: exact sleeps and, if configured, real-time priority, a
//! processor of its own and locked memory.

#[cfg(target_os = "linux")]
use std::num::NonZeroU64;
use std::time::{Duration, Instant};

/// Real-time settings of the runner's thread. If the system refuses one, that is a warning and no error.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RealTime {
    /// The SCHED_FIFO priority of the thread, 1..=99; `None`: the thread keeps the normal scheduling.
    pub priority: Option<u8>,
    /// The processor that the thread runs on, from 0; `None`: any that the process may use.
    pub cpu: Option<u16>,
    /// Whether the memory of the process is locked (mlockall), so that no page fault delays a cycle.
    pub lock_memory: bool,
}

impl RealTime {
    /// Applies the settings to the calling thread. Returns a warning for each refused one, with what to do.
    #[cfg(target_os = "linux")]
    pub(crate) fn apply(self) -> Vec<String> {
        use rustix::mm::{MlockAllFlags, mlockall};
        use thread_priority::{
            RealtimeThreadSchedulePolicy, ThreadPriority, ThreadPriorityValue, ThreadSchedulePolicy,
            set_thread_priority_and_policy, thread_native_id,
        };

        // By default a thread may sleep 50 us longer than requested (timer slack). A slack of 1 ns needs no privilege;
        // if the call fails, sleeps are just less exact.
        let _ = rustix::thread::set_current_timer_slack(NonZeroU64::new(1));
        let mut warnings = Vec::new();
        if let Some(priority) = self.priority {
            let set = ThreadPriorityValue::try_from(priority).map_err(|e| e.to_string()).and_then(|value| {
                set_thread_priority_and_policy(
                    thread_native_id(),
                    ThreadPriority::Crossplatform(value),
                    ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo),
                )
                .map_err(|e| format!("{e:?}"))
            });
            if let Err(e) = set {
                warnings.push(format!(
                    "a priority of {priority} was refused ({e}): cycles may be late; allow it with `ulimit -r {priority}` or CAP_SYS_NICE"
                ));
            }
        }
        if let Some(cpu) = self.cpu
            && let Err(e) = run_on(cpu)
        {
            warnings.push(format!(
                "cpu={cpu} was refused ({e}): name a processor that `nproc --all` and the process's limits allow"
            ));
        }
        if self.lock_memory
            && let Err(e) = mlockall(MlockAllFlags::CURRENT | MlockAllFlags::FUTURE)
        {
            warnings.push(format!(
                "lock_memory was refused ({e}): page faults may delay cycles; allow it with `ulimit -l unlimited` or CAP_IPC_LOCK"
            ));
        }
        warnings
    }

    /// Applies the settings to the calling thread. Returns a warning for each refused one, with what to do.
    #[cfg(not(target_os = "linux"))]
    pub(crate) fn apply(self) -> Vec<String> {
        let asked =
            [("priority", self.priority.is_some()), ("cpu", self.cpu.is_some()), ("lock_memory", self.lock_memory)];
        asked
            .into_iter()
            .filter(|(_, asked)| *asked)
            .map(|(key, _)| format!("{key} is not available on this system and was left out"))
            .collect()
    }
}

/// Binds the calling thread to one processor.
#[cfg(target_os = "linux")]
fn run_on(cpu: u16) -> std::io::Result<()> {
    use rustix::thread::{CpuSet, sched_setaffinity};

    let mut set = CpuSet::new();
    if usize::from(cpu) >= CpuSet::MAX_CPU {
        return Err(std::io::ErrorKind::InvalidInput.into());
    }
    set.set(usize::from(cpu));
    Ok(sched_setaffinity(None, &set)?)
}

/// The speed of the runner's clock relative to the machine's clock, in billionths: 1..=1 000 000 000. Less than the
/// maximum runs a board in slow motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rate(u32);

impl Default for Rate {
    /// The runner's clock runs as fast as the machine's clock.
    fn default() -> Self {
        Self::billionths(Self::ONE)
    }
}

impl Rate {
    const ONE: u32 = 1_000_000_000;

    /// A speed in billionths of that of the machine's clock. 0 counts as 1, and more than a billion as a billion.
    pub const fn billionths(billionths: u32) -> Self {
        Self(match billionths {
            0 => 1,
            1..=Self::ONE => billionths,
            _ => Self::ONE,
        })
    }

    /// Converts a span of the machine's time to the runner's clock. It is rounded down, so that the runner's clock is
    /// never ahead of the exact time.
    pub(crate) fn slowed(self, span: Duration) -> Duration {
        if self.0 == Self::ONE {
            return span;
        }
        nanos(span.as_nanos() * u128::from(self.0) / u128::from(Self::ONE))
    }

    /// Converts a span of the runner's clock to machine time. It is rounded up, so that the span has passed on the
    /// runner's clock, too, when the result has passed on the machine.
    pub(super) fn real(self, span: Duration) -> Duration {
        if self.0 == Self::ONE {
            return span;
        }
        nanos((span.as_nanos() * u128::from(Self::ONE)).div_ceil(u128::from(self.0)))
    }
}

fn nanos(nanos: u128) -> Duration {
    Duration::from_nanos(u64::try_from(nanos).unwrap_or(u64::MAX))
}

/// The runner's clock, which starts at 0, and absolute sleeps on it. All times except the result of [`Clock::instant`]
/// are times of this clock.
pub(super) struct Clock {
    rate: Rate,
    #[cfg(target_os = "linux")]
    zero: rustix::time::Timespec,
    start: Instant,
}

impl Clock {
    pub(super) fn start(rate: Rate) -> Self {
        Self {
            rate,
            #[cfg(target_os = "linux")]
            zero: rustix::time::clock_gettime(rustix::time::ClockId::Monotonic),
            start: Instant::now(),
        }
    }

    pub(super) const fn rate(&self) -> Rate {
        self.rate
    }

    /// The time on the runner's clock: the machine time since its start, at its rate.
    pub(super) fn now(&self) -> Duration {
        self.rate.slowed(self.start.elapsed())
    }

    /// Converts a time of this clock to an instant of the machine.
    pub(super) fn instant(&self, at: Duration) -> Instant {
        self.start + self.rate.real(at)
    }

    /// Sleeps until the time `at` of this clock. Returns at once if it has passed.
    #[cfg(target_os = "linux")]
    pub(super) fn sleep_until(&self, at: Duration) {
        use rustix::thread::{ClockId, clock_nanosleep_absolute};
        let at = self.rate.real(at);
        let nanos = self.zero.tv_nsec + i64::from(at.subsec_nanos());
        let request = rustix::time::Timespec {
            tv_sec: self.zero.tv_sec + at.as_secs() as i64 + nanos / 1_000_000_000,
            tv_nsec: (nanos % 1_000_000_000) as _,
        };
        while clock_nanosleep_absolute(ClockId::Monotonic, &request) == Err(rustix::io::Errno::INTR) {}
    }

    /// Sleeps until the time `at` of this clock. Returns at once if it has passed.
    #[cfg(not(target_os = "linux"))]
    pub(super) fn sleep_until(&self, at: Duration) {
        if let Some(left) = at.checked_sub(self.now()) {
            std::thread::sleep(self.rate.real(left));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECOND: Duration = Duration::from_secs(1);

    /// With a slower clock, machine time is converted rounded down and runner time rounded up, so that neither ends too
    /// soon.
    #[test]
    fn spans_at_a_rate() {
        let [half, third] = [500_000_000, 300_000_000].map(Rate::billionths);
        assert_eq!((half.slowed(2 * SECOND), half.real(SECOND)), (SECOND, 2 * SECOND));
        let ns = Duration::from_nanos;
        assert_eq!((third.slowed(ns(10)), third.slowed(ns(13)), third.real(ns(3))), (ns(3), ns(3), ns(10)));
        assert_eq!((third.real(ns(1)), third.real(ns(2))), (ns(4), ns(7)));
        let machine = Rate::default();
        assert_eq!((machine.slowed(ns(7)), machine.real(ns(7))), (ns(7), ns(7)));
        assert_eq!((Rate::billionths(0), Rate::billionths(u32::MAX)), (Rate::billionths(1), machine));
        // The result would be 10^20 ns, more than a `u64` holds.
        assert_eq!(Rate::billionths(1).real(100 * SECOND), ns(u64::MAX));
    }

    /// A sleep never ends before its time, also when it ends in another second.
    #[test]
    fn sleeps_are_long_enough() {
        let clock = Clock::start(Rate::default());
        for ms in [1, 300, 600, 900, 1200] {
            let at = Duration::from_millis(ms);
            clock.sleep_until(at);
            assert!(clock.now() >= at, "{at:?}: {:?}", clock.now());
            assert!(clock.instant(at) <= Instant::now() && clock.instant(at) == clock.instant(Duration::ZERO) + at);
        }
    }

    /// At half the rate a sleep takes twice as long.
    #[test]
    fn sleeps_at_a_rate() {
        let clock = Clock::start(Rate::billionths(500_000_000));
        clock.sleep_until(Duration::from_millis(10));
        assert!(clock.start.elapsed() >= Duration::from_millis(20));
        assert!(clock.now() <= clock.start.elapsed() / 2);
    }
}
