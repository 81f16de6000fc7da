//! Distributed clocks.

use std::time::Duration;

use ecmsk::bus::clocks;
use ecmsk::ethercat::registers::SYSTEM_TIME_OFFSET;

use crate::network;

/// Clocks are judged once they have converged. The first slave with a clock is the reference; the others are measured,
/// those without a clock are left out. Crystals drift, and the clocks stay synchronous.
#[test]
fn clocks_are_measured_against_the_reference() {
    let (mut network, slaves) = network("io,drive*3,io");
    let clocks = clocks::measure(&mut *network, &slaves, Duration::from_millis(500)).expect("it is measured");
    let who: Vec<_> = clocks.iter().map(|clock| (clock.slave, clock.is_reference, clock.delay_ns)).collect();
    assert_eq!(who, [(2, true, 0), (3, false, 310), (4, false, 620)]);
    assert_eq!(clocks[0].ahead, None);
    for clock in &clocks[1..] {
        let ahead = clock.ahead.expect("it is measured");
        assert!(ahead.is_good() && ahead.count == 50, "{ahead:?}");
        assert!(ahead.min_ns <= ahead.mean_ns && ahead.mean_ns <= ahead.max_ns && ahead.max_ns < 0, "{ahead:?}");
    }
    let (mut network, slaves) = crate::network("drive*2");
    // An offset for which a clock needs some seconds: it is slewed by 1 us each time it gets the reference's time.
    let mut offset = [0; 8];
    network.read(2, SYSTEM_TIME_OFFSET, &mut offset).expect("it is read");
    let offset = u64::from_le_bytes(offset) + 5_000_000;
    network.write(2, SYSTEM_TIME_OFFSET, &offset.to_le_bytes()).expect("it is written");
    let clocks = clocks::measure(&mut *network, &slaves, Duration::from_millis(500)).expect("it is measured");
    assert!(clocks[1].ahead.is_some_and(|ahead| ahead.is_good() && ahead.count == 50), "{:?}", clocks[1]);
    // A clock that never converges is measured, too.
    network.write(2, SYSTEM_TIME_OFFSET, &(offset + 50_000_000).to_le_bytes()).expect("it is written");
    let clocks = clocks::measure(&mut *network, &slaves, Duration::from_millis(100)).expect("it is measured");
    assert!(clocks[1].ahead.is_some_and(|ahead| !ahead.is_good()), "{:?}", clocks[1]);
    let (mut network, slaves) = crate::network("io");
    assert_eq!(clocks::measure(&mut *network, &slaves, Duration::from_millis(10)).expect("there is none"), []);
}
