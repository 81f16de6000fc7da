//! Without BUSY: the time between the begins of exchanges.

use super::bench::{Answers, Bench, Setup};
use super::frames::target;

/// SK-10.6 Without BUSY no exchange begins sooner than 800 us after the one before, not even those beyond one per
/// cycle; motion is complete all the same.
#[test]
fn exchanges_are_800_us_apart() {
    for answers in [Answers::Newest, Answers::Older] {
        for host_is_faster in [-2000, 0, 2000] {
            let setup = Setup { period: 800_000, answers, host_is_faster, ..Setup::default() };
            let mut bench = Bench::on(setup);
            (0..2000).for_each(|n| bench.held.push_back(target(1, n)));
            bench.until(|bench| bench.held.is_empty() && bench.free == 160);
            assert_eq!(bench.check(2000), 0, "{setup:?}");
            let least = bench.begins.windows(2).map(|pair| pair[1].0 - pair[0].0).min();
            assert!(least >= Some(800_000), "{least:?}");
        }
    }
}
