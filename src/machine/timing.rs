//! How exactly this machine wakes a thread up: what cycles that a program keeps by itself depend on.

use std::time::Duration;

use rustix::thread::{ClockId, clock_nanosleep_absolute};
use rustix::time::{Timespec, clock_getres, clock_gettime};

/// How late a thread was woken up, against what it asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Lateness {
    /// How long it slept each time.
    pub period: Duration,
    /// Half of the times it was less late.
    pub p50: Duration,
    /// 99 of 100 times it was less late.
    pub p99: Duration,
    /// The latest.
    pub max: Duration,
}

impl Lateness {
    /// From how late it was each time; `None`: it never slept.
    pub fn of(period: Duration, mut late: Vec<Duration>) -> Option<Self> {
        late.sort_unstable();
        let max = *late.last()?;
        // The nearest rank, so that each figure is one that was measured.
        let rank = |percent: usize| late[(late.len() * percent).div_ceil(100).max(1) - 1];
        Some(Self { period, p50: rank(50), p99: rank(99), max })
    }

    /// Sleeps so many times, one period after the other, each to a deadline of its own as the runners of boards do.
    pub fn measure(period: Duration, times: usize) -> Option<Self> {
        let now = || duration(clock_gettime(rustix::time::ClockId::Monotonic));
        let sleeper = move || {
            // As the runner's thread: an ordinary one may sleep 50 us longer than it asked for.
            let _ = rustix::thread::set_current_timer_slack(std::num::NonZeroU64::new(1));
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
        };
        // The slack is a thread's own, and this one's stays.
        let late = crate::threads::spawn("ecmsk-sleeper", sleeper).ok()?.join().ok()?;
        Self::of(period, late)
    }
}

/// How fine the timers of this machine are; without high-resolution timers it is a tick of the kernel, 1 to 10 ms.
pub fn timer_resolution() -> Duration {
    duration(clock_getres(rustix::time::ClockId::Monotonic))
}

fn duration(time: Timespec) -> Duration {
    Duration::new(u64::try_from(time.tv_sec).unwrap_or(0), u32::try_from(time.tv_nsec).unwrap_or(0))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// TOOL-106 The figures are nearest ranks of what was measured.
    #[test]
    fn figures_of_lateness() {
        const MS: Duration = Duration::from_millis(1);
        let us = |us| Duration::from_micros(us);
        let lateness = Lateness::of(MS, (1..=1000).rev().map(us).collect()).expect("a thousand");
        assert_eq!((lateness.p50, lateness.p99, lateness.max), (us(500), us(990), us(1000)));
        let one = Lateness::of(MS, vec![us(7)]).expect("one");
        assert_eq!((one.p50, one.p99, one.max), (us(7), us(7), us(7)));
        let outlier = [vec![us(1); 99], vec![us(900)]].concat();
        let lateness = Lateness::of(MS, outlier).expect("a hundred");
        assert_eq!((lateness.p99, lateness.max), (us(1), us(900)));
        assert_eq!(Lateness::of(MS, Vec::new()), None);
    }

    /// TOOL-106 It really sleeps, and no thread is woken up before its time.
    #[test]
    fn a_measured_lateness() {
        let began = std::time::Instant::now();
        let lateness = Lateness::measure(Duration::from_millis(1), 20).expect("a thread");
        assert!(began.elapsed() >= Duration::from_millis(20), "{lateness:?}");
        assert!(lateness.p50 <= lateness.p99 && lateness.p99 <= lateness.max, "{lateness:?}");
    }
}
