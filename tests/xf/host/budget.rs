//! The time of an exchange, and n for process data.

use ecmsk::xf::DataSize;
use ecmsk::xf::host::{Budget, BudgetError};

const BUDGET: Budget =
    Budget { process_bytes: 100, clock_hz: 24_000_000, idle_ns: 150_000, cycle_ns: 1_000_000, exchanges: 2 };

/// XF-12.12 1056 bytes take 352 us at 24 MHz; a cycle takes that and the idle time for each of its exchanges.
#[test]
fn an_exchange_costs_its_bits_and_the_idle_time() {
    assert_eq!(BUDGET.transfer_ns(DataSize::NEWER), 352_000);
    assert_eq!(BUDGET.needed_ns(DataSize::NEWER), 2 * (352_000 + 150_000));
    assert_eq!(Budget { clock_hz: 96_000_000, ..BUDGET }.transfer_ns(DataSize::NEWER), 88_000);
    assert_eq!(Budget { clock_hz: 7, ..BUDGET }.transfer_ns(DataSize::MIN), 73_142_857_143, "rounded up");
}

/// XF-12.12 n is the size that the process data need, but at least 112 if there is time for it.
#[test]
fn n_is_chosen() {
    let size = |budget: Budget| budget.choose_size().map(DataSize::bytes);
    assert_eq!(size(BUDGET), Ok(112));
    assert_eq!(size(Budget { process_bytes: 113, ..BUDGET }), Ok(113));
    let tight = Budget { process_bytes: 20, clock_hz: 2_000_000, exchanges: 1, cycle_ns: 500_000, ..BUDGET };
    assert_eq!(size(tight), Ok(32), "144 bytes would take 576 us");
    assert_eq!(size(Budget { process_bytes: 1408, cycle_ns: 2_000_000, ..BUDGET }), Ok(1408));
}

/// XF-12.12 A cycle that is too short is refused with the needed time, in words as well.
#[test]
fn a_cycle_that_is_too_short() {
    let refused = Budget { process_bytes: 1024, cycle_ns: 500_000, exchanges: 1, ..BUDGET }.choose_size();
    let Err(error) = refused else { panic!("{refused:?}") };
    let BudgetError::CycleTooShort { size, transfer_ns, needed_ns, cycle_ns, .. } = error else { panic!("{error:?}") };
    assert_eq!((size, transfer_ns, needed_ns, cycle_ns), (DataSize::NEWER, 352_000, 502_000, 500_000));
    let text = error.to_string();
    for part in ["a cycle of 500 us", "1056 bytes", "24000 kHz", "352 us", "150 us", "together 502 us", "take a longer"]
    {
        assert!(text.contains(part), "{part} in {text}");
    }
    let many = Budget { process_bytes: 1409, ..BUDGET }.choose_size();
    assert_eq!(many, Err(BudgetError::TooManyBytes { process_bytes: 1409, most: 1408 }));
    for budget in [Budget { clock_hz: 0, ..BUDGET }, Budget { exchanges: 0, ..BUDGET }] {
        assert_eq!(budget.choose_size(), Err(BudgetError::NoExchange));
    }
}
