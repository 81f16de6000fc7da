//! The key `prefill=`: entries in the board's FIFO for a host that is late at times.

use super::bench::{Answers, Bench, Setup};
use super::frames::target;

const COUNT: u32 = 3000;

/// A program that writes a frame for each cycle by its own clock, and pauses for `away` cycles at times; then it
/// catches up at once.
fn late_at_times(setup: Setup, away: u64) -> usize {
    let mut bench = Bench::on(setup);
    let cycle = u64::from(setup.cycle_us) * 1000;
    let begin = bench.now;
    let mut written = 0;
    while written < COUNT {
        let due = (bench.now - begin) / cycle + 1;
        let is_away = (due % 150) < away && due > 150;
        // Never more than it needs: one frame per cycle.
        while !is_away && u64::from(written) < due.min(u64::from(COUNT)) {
            bench.held.push_back(target(1, written));
            written += 1;
        }
        let next = begin + due * cycle;
        while bench.exchange(next) {
            if bench.now >= next {
                break;
            }
        }
    }
    bench.until(|bench| bench.held.is_empty() && bench.free == 160);
    bench.check(COUNT)
}

/// With a prefill a host may pause for nearly that many cycles and the axes never stop; without one they do. SK-5.9 The
/// prefill is the FIFO's threshold.
#[test]
fn a_prefill_bridges_what_the_host_misses() {
    for answers in [Answers::Newest, Answers::Older] {
        let setup = Setup { prefill: 16, answers, ..Setup::default() };
        assert_eq!(late_at_times(setup, 10), 0, "{answers:?}");
        assert!(late_at_times(Setup { prefill: 0, ..setup }, 10) >= 8, "{answers:?}: it is needed");
        assert!(late_at_times(Setup { prefill: 4, ..setup }, 10) >= 4, "{answers:?}: it has to be long enough");
    }
}

/// A program that waits for its two frames before it writes more is slowed down, not stopped.
#[test]
fn a_program_that_writes_less_than_the_prefill_goes_on() {
    for answers in [Answers::Newest, Answers::Older] {
        let mut bench = Bench::on(Setup { prefill: 16, answers, ..Setup::default() });
        for n in 0..20 {
            bench.held.extend([target(1, 2 * n), target(1, 2 * n + 1)]);
            bench.exchange(u64::MAX);
            bench.until(|bench| bench.held.is_empty() && bench.free == 160);
        }
        bench.check(40);
    }
}

/// The first motion waits for the prefill; other commands do not.
#[test]
fn the_first_motion_waits_for_the_prefill() {
    let mut bench = Bench::on(Setup { prefill: 30, ..Setup::default() });
    (0..20).for_each(|n| bench.held.push_back(target(1, n)));
    bench.until(|bench| bench.held.is_empty());
    assert!(bench.targets().0.is_empty(), "20 and SET_FIFO's own are fewer than 30");
    (20..60).for_each(|n| bench.held.push_back(target(1, n)));
    bench.until(|bench| bench.free == 160);
    bench.check(60);
}
