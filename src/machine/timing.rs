//! How exactly this machine wakes a thread up: what cycles that a program keeps by itself depend on.

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
        // What makes its sleeps exact is a thread's own, and this one's stays as it is.
        let sleeper = move || system::late(period, times);
        let late = crate::threads::spawn("ecmsk-sleeper", sleeper).ok()?.join().ok()?;
        Self::of(period, late)
    }
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
