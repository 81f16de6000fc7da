//! A PC that stalls again and again, with the board over an ECM-XF in it: the chip's FIFO bridges the stalls, and
//! cycles that it does not bridge are counted.

use ecmsk::sk::CycleTime;
use support::late_host::{LateHost, Outcome, Stalls};

/// Stalls of that many cycles, one every 100 ms, begun at all times of a cycle, for 3 s.
fn lead(drives: usize, ahead: u16, cycles: u64) -> Outcome {
    let outcome = LateHost::new(drives, ahead).lead(3000, Stalls { cycles, every: 100 });
    assert!(outcome.targets > 2500 && outcome.stalls >= 28, "{drives} drives, ahead {ahead}: {outcome:?}");
    // Whatever the stalls cost: each target reaches each drive, once and in order, and the drives move together.
    let Outcome { lost, out_of_order, counted_lost, repeated, repeated_least, .. } = outcome;
    assert_eq!((lost, out_of_order, counted_lost), (0, 0, 0), "{drives} drives, ahead {ahead}: {outcome:?}");
    assert_eq!(repeated, repeated_least, "{drives} drives, ahead {ahead}: {outcome:?}");
    outcome
}

/// XF-19.14 XF-19.15 A stall of no more than `ahead` cycles costs no cycle, however often it comes: no target is sent twice,
/// and the board is not behind afterwards.
#[test]
fn stalls_that_the_chip_bridges_cost_no_cycle() {
    for (drives, ahead) in [(2, 1), (2, 4), (2, 20), (8, 8), (40, 4), (40, 8), (40, 12)] {
        let outcome = lead(drives, ahead, ahead.into());
        assert_eq!(outcome.repeated, 0, "{drives} drives, ahead {ahead}: {outcome:?}");
    }
}

/// XF-19.14 A longer stall loses no target, either. The drives get the newest one again until the next one comes, once
/// for each cycle that is not bridged, and the board counts no fewer idle cycles.
#[test]
fn what_a_longer_stall_costs_is_counted() {
    let repeated = [9, 14, 20].map(|cycles| {
        let outcome = lead(40, 4, cycles);
        let Outcome { repeated, idle_cycles, stalls, .. } = outcome;
        // A cycle whose answer is late counts as one without outputs until the answer comes.
        assert!((repeated..=repeated + 3 * stalls).contains(&idle_cycles), "{outcome:?}");
        (repeated, stalls)
    });
    let [(of_9, stalls), (of_14, _), (of_20, _)] = repeated;
    assert!(of_9 > 0 && (of_14 - of_9).abs_diff(5 * stalls) <= 1, "{repeated:?}");
    assert!((of_20 - of_14).abs_diff(6 * stalls) <= 1, "{repeated:?}");
}

/// XF-19.15 With a cycle of 4 ms, and a program that has hardly more in the board than the chip takes, the board
/// catches up at once: a stall costs no more cycles than the chip did not bridge.
#[test]
fn a_long_cycle_is_caught_up_with_at_once() {
    const AHEAD: u64 = 8;
    let cycle = CycleTime::from_us(4000).expect("a cycle");
    let mut host = LateHost::with_cycle(4, AHEAD as u16, cycle, 20);
    for cycles in [8, 16, 20] {
        let outcome = host.lead(1000, Stalls { cycles, every: 100 });
        assert!(outcome.stalls >= 8 && outcome.targets > 700, "{outcome:?}");
        assert_eq!((outcome.lost, outcome.out_of_order, outcome.counted_lost), (0, 0, 0), "{outcome:?}");
        assert!(outcome.repeated <= (cycles - AHEAD) * outcome.stalls, "{cycles}: {outcome:?}");
    }
}
