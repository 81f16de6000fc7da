//! Measures how late this machine wakes threads, which limits how short a cycle a program can keep by itself.

#[cfg(target_os = "linux")]
mod linux;
#[cfg(windows)]
mod windows;

use std::time::Duration;

#[cfg(target_os = "linux")]
use linux as system;
#[cfg(windows)]
use windows as system;

pub use system::timer_resolution;
pub(crate) use system::{COARSE, FINER};

/// How much later than requested a thread was woken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TimerLateness {
    /// The sleep that the thread requested each time.
    pub period: Duration,
    /// The median of the lateness.
    pub p50: Duration,
    /// The 99th percentile of the lateness.
    pub p99: Duration,
    /// The greatest lateness.
    pub max: Duration,
}

impl TimerLateness {
    /// The median, the 99th percentile and the maximum of the measured latenesses `late`; `None` if there are none.
    pub fn of(period: Duration, mut late: Vec<Duration>) -> Option<Self> {
        late.sort_unstable();
        let max = *late.last()?;
        // The nearest rank, so that each percentile is a measured value.
        let rank = |percent: usize| late[(late.len() * percent).div_ceil(100).max(1) - 1];
        Some(Self { period, p50: rank(50), p99: rank(99), max })
    }

    /// Measures the lateness of `times` sleeps of one period each. The thread sleeps in the same way as the thread that
    /// runs the cycles of a board modelled in this process, so the result also holds for that thread. `None` if the
    /// system cannot create the measuring thread.
    pub fn measure(period: Duration, times: usize) -> Option<Self> {
        // The measurement runs in a thread of its own, because the timer slack that makes sleeps exact is a setting of
        // the thread.
        let sleeper = move || system::late(period, times);
        let late = crate::threads::spawn("ecmsk-sleeper", sleeper).ok()?.join().ok()?;
        Self::of(period, late)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The percentiles are nearest ranks of the measured values.
    #[test]
    fn figures_of_lateness() {
        const MS: Duration = Duration::from_millis(1);
        let us = |us| Duration::from_micros(us);
        let lateness = TimerLateness::of(MS, (1..=1000).rev().map(us).collect()).expect("a thousand");
        assert_eq!((lateness.p50, lateness.p99, lateness.max), (us(500), us(990), us(1000)));
        let one = TimerLateness::of(MS, vec![us(7)]).expect("one");
        assert_eq!((one.p50, one.p99, one.max), (us(7), us(7), us(7)));
        let outlier = [vec![us(1); 99], vec![us(900)]].concat();
        let lateness = TimerLateness::of(MS, outlier).expect("a hundred");
        assert_eq!((lateness.p99, lateness.max), (us(1), us(900)));
        assert_eq!(TimerLateness::of(MS, Vec::new()), None);
    }

    /// The thread really sleeps and is never woken early.
    #[test]
    fn a_measured_lateness() {
        let began = std::time::Instant::now();
        let lateness = TimerLateness::measure(Duration::from_millis(1), 20).expect("a thread");
        assert!(began.elapsed() >= Duration::from_millis(20), "{lateness:?}");
        assert!(lateness.p50 <= lateness.p99 && lateness.p99 <= lateness.max, "{lateness:?}");
    }
}
