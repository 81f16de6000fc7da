//! Findings about how exactly the machine can keep cycles: the resolution of its timers, and how late threads are woken.

use std::time::Duration;

use super::Finding;
use crate::machine::timing::{COARSE, FINER, TimerLateness};
use crate::span::Span;

/// \[OURS] If one wake-up in a hundred is later than this, half a cycle of 1 ms, real-time priority is advised.
const P99_LATENESS_MAX: Duration = Duration::from_micros(500);

/// Judges the resolution of the machine's timers: a resolution coarser than 100 us on Linux or 1 ms on Windows is
/// wrong, because such a timer cannot keep cycles.
pub fn timer(resolution: Duration) -> Finding {
    const CHECK: &str = "timer";
    let nanoseconds = i64::try_from(resolution.as_nanos()).unwrap_or(i64::MAX);
    let finding = if resolution <= COARSE {
        Finding::fine(CHECK, format!("resolution {}", Span(resolution)))
    } else {
        let found = format!("resolution {}: cycles cannot be kept", Span(resolution));
        Finding::wrong(CHECK, found, FINER)
    };
    finding.figure("resolution_ns", nanoseconds)
}

/// Judges how late threads are woken. `measured` is `None` if it could not be measured.
pub fn lateness(measured: Option<TimerLateness>) -> Finding {
    judge(measured, |TimerLateness { period, max, .. }| {
        let cycles = max.as_nanos().div_ceil(period.as_nanos().max(1)) + 1;
        format!("at a cycle of {} a program that is {cycles} cycles ahead is never too late", Span(period))
    })
}

/// Judges how late threads are woken if this machine itself sends the EtherCAT frames. A late thread then makes cycles
/// late, however far ahead the program has filled the FIFO. `measured` is `None` if it could not be measured.
pub fn lateness_of_own_cycles(measured: Option<TimerLateness>) -> Finding {
    judge(measured, |TimerLateness { period, .. }| {
        format!(
            "so late are the frames of a link nic:, however far ahead a program is; at a cycle of {} one that is late by more than half \
             of it is left out, and slaves without frames for 100 ms leave OP",
            Span(period)
        )
    })
}

fn judge(measured: Option<TimerLateness>, means: impl FnOnce(TimerLateness) -> String) -> Finding {
    const CHECK: &str = "wake-up";
    let Some(lateness @ TimerLateness { p50, p99, max, .. }) = measured else {
        return Finding::advice(CHECK, "not measured: the system gave no thread", "free some of the system's threads");
    };
    let found = format!(
        "late by {} (half of the times), {} (99 of 100), {} (the worst): {}",
        Span(p50),
        Span(p99),
        Span(max),
        means(lateness)
    );
    let finding = if p99 <= P99_LATENESS_MAX {
        Finding::fine(CHECK, found)
    } else {
        Finding::advice(CHECK, found, "give the program real-time priority, or the machine less to do")
    };
    let us = |time: Duration| i64::try_from(time.as_micros()).unwrap_or(i64::MAX);
    finding.figure("p50_us", us(p50)).figure("p99_us", us(p99)).figure("max_us", us(max))
}

#[cfg(test)]
mod tests {
    use super::super::FindingVerdict;
    use super::*;

    /// A timer resolution as coarse as a tick of the kernel counts as wrong.
    #[test]
    fn timers() {
        assert_eq!(timer(Duration::from_nanos(1)).verdict, FindingVerdict::Fine);
        assert_eq!(timer(Duration::from_nanos(1)).found, "resolution 1ns");
        let coarse = timer(Duration::from_millis(4));
        assert_eq!(
            (coarse.verdict, coarse.found.as_str()),
            (FindingVerdict::Wrong, "resolution 4ms: cycles cannot be kept")
        );
        assert!(coarse.next.is_some_and(|next| next == FINER));
    }

    /// The finding about a lateness of several cycles states how many cycles a program has to write ahead. A lateness
    /// of more than half a cycle of 1 ms gets advice.
    #[test]
    fn what_a_lateness_means() {
        let us = Duration::from_micros;
        let measured = |p99, max| Some(TimerLateness { period: us(1000), p50: us(58), p99, max });
        let good = lateness(measured(us(120), us(900)));
        assert_eq!(good.verdict, FindingVerdict::Fine);
        assert!(
            good.found.contains("58us (half of the times), 120us (99 of 100), 900us (the worst)"),
            "{}",
            good.found
        );
        assert!(good.found.contains("a cycle of 1ms a program that is 2 cycles ahead"), "{}", good.found);
        assert_eq!(good.figures, [("p50_us", 58), ("p99_us", 120), ("max_us", 900)]);
        let bad = lateness(measured(us(501), us(7250)));
        assert_eq!(bad.verdict, FindingVerdict::Advice);
        assert!(bad.found.contains("7.25ms (the worst)") && bad.found.contains("9 cycles ahead"), "{}", bad.found);
        assert_eq!(lateness(None).verdict, FindingVerdict::Advice);
        let own = lateness_of_own_cycles(measured(us(501), us(7250)));
        assert_eq!((own.verdict, &own.figures), (FindingVerdict::Advice, &bad.figures));
        assert!(own.found.contains("7.25ms (the worst)") && own.found.contains("however far ahead"), "{}", own.found);
        assert!(!own.found.contains("never too late"), "{}", own.found);
    }
}
