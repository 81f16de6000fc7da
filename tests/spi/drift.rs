//! Different clocks never fill the FIFO nor lose a frame.

use super::bench::{Answers, Bench, Setup};
use super::frames::target;

/// A program that is always ten frames ahead.
fn stream(bench: &mut Bench, count: u32) {
    let mut written = 0;
    while written < count {
        while bench.held.len() < 10 && written < count {
            bench.held.push_back(target(bench.setup.slaves, written));
            written += 1;
        }
        bench.exchange(u64::MAX);
    }
    bench.until(|bench| bench.held.is_empty() && bench.free == 160);
}

/// SK-5.4, SK-5.6 A host with a faster clock skips exchanges, one with a slower clock makes some more. The FIFO stays
/// nearly empty, each frame is executed once and in order, and the axes never stop between two.
#[test]
fn clocks_that_differ_never_fill_the_fifo_nor_lose_a_frame() {
    for answers in [Answers::Newest, Answers::Older] {
        for host_is_faster in [-20_000, -2000, -100, 0, 100, 2000, 20_000] {
            let mut bench = Bench::on(Setup { host_is_faster, answers, ..Setup::default() });
            stream(&mut bench, 3000);
            let gaps = bench.check(3000);
            assert_eq!(gaps, 0, "{:?}", bench.setup);
            assert!(bench.highest <= 8, "{:?}: level {}", bench.setup, bench.highest);
            let counts = bench.pacer.counts();
            match host_is_faster {
                2000.. => assert!(counts.skipped >= 3000 * host_is_faster as u64 / 1_000_000 - 4, "{counts:?}"),
                ..=-2000 => assert!(counts.extra >= 3000 * -host_is_faster as u64 / 1_000_000 - 4, "{counts:?}"),
                _ => assert!(counts.skipped <= 3, "{counts:?}"),
            }
        }
    }
}

/// A machine that is late at times, while the program is ahead: after the first time the board has the needed frames in
/// advance, and the axes do not stop again. For a program that is not ahead, answers do not take longer.
#[test]
fn a_machine_that_is_late_at_times_keeps_more_entries_in_the_fifo() {
    for answers in [Answers::Newest, Answers::Older] {
        let mut bench = Bench::on(Setup { answers, ..Setup::default() });
        let mut written = 0;
        while written < 3000 {
            while bench.held.len() < 20 && written < 3000 {
                bench.held.push_back(target(1, written));
                written += 1;
            }
            bench.exchange(u64::MAX);
            if written % 100 == 50 {
                bench.now += 8_000_000;
            }
        }
        bench.until(|bench| bench.held.is_empty() && bench.free == 160);
        let gaps = bench.check(3000);
        assert!(gaps <= 12, "{answers:?}: {gaps}");
        for _ in 0..40 {
            bench.exchange(u64::MAX);
        }
        assert!(bench.board.engine().fifo_free() >= 156, "what is the link's own does not stay");
    }
}

/// With a silent network, when the board executes no entry, the host's frames stop before the FIFO is full: they wait
/// in the link.
#[test]
fn a_board_that_takes_nothing_out_gets_no_frame_that_it_cannot_keep() {
    let mut bench = Bench::on(Setup::default());
    let handle = bench.board.handle();
    handle.hold_fifo(true);
    for n in 0..400 {
        bench.held.push_back(target(1, n));
    }
    let end = bench.now + 3_000_000_000;
    while bench.exchange(end) {}
    assert!(bench.held.len() >= 400 - 160, "{} are held", bench.held.len());
    handle.hold_fifo(false);
    bench.until(|bench| bench.held.is_empty() && bench.free == 160);
    let (indexes, _) = bench.targets();
    assert_eq!(indexes, (0..400).map(super::frames::index).collect::<Vec<_>>());
}
