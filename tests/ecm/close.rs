//! The native API's closing: ramps, what stays on, how long it takes, by call, by drop and after a stream.

use std::time::Duration;

use crate::common::{SECOND, SIZE, Tap, cycles, enable, follow, open, script, uri};
use ecmsk::ecm::{Axis, Close, Config, Ecm, EcmError, Options, Slave};
use ecmsk::link::{self, Link, Share};
use ecmsk::sk::{CommandId, MasterState, StateByte};

/// docs/SAFETY.md: closing ends within 2 s, to 8 cycles.
const CLOSING_MAX: Duration = Duration::from_millis(2_008);

/// The time of a board of that name, whose link is closed.
fn clock(keys: &str) -> Duration {
    let link = link::open(&uri(keys), Share::ByName).unwrap();
    Duration::from_nanos(link.pass(Duration::ZERO).unwrap().unwrap().0)
}

/// Two axes that move: 1 forwards, 2 backwards, 50 counts a cycle.
fn moving(ecm: &Ecm, frames: i32) {
    let mut stream = ecm.stream(16).unwrap();
    for n in 0..frames {
        stream.csp(1, n * 50).unwrap();
        stream.csp(2, -n * 50).unwrap();
        stream.step().unwrap();
    }
}

fn targets(tap: &Tap, slave: usize) -> Vec<i32> {
    let frames = tap.take();
    let slots = frames.iter().map(|frame| frame.slot(SIZE, slave));
    slots.filter(|slot| slot.id == CommandId::Csp.code()).map(|slot| slot.data1 as i32).collect()
}

/// API-9 API-10 A stream that ends in CSP at full speed: its axes go to their last targets and hold them, enabled. No frame leads
/// beyond them.
#[test]
fn a_stream_that_ends_holds_its_last_targets() {
    let (tap, ecm) = Tap::enabled("slaves=drive*2", &Config::drives(2));
    tap.take();
    moving(&ecm, 300);
    let targets = targets(&tap, 1);
    assert_eq!(targets, (0..300).map(|n| n * 50).collect::<Vec<_>>(), "those of the program and no more");
    let rest = ecm.snapshot().unwrap();
    cycles(&ecm, 100);
    let later = ecm.snapshot().unwrap();
    for (slave, sign) in [(1, 1), (2, -1)] {
        let end = later.position(slave).unwrap();
        assert!((end - sign * *targets.last().unwrap()).abs() < 20, "slave {slave} is at {end}");
        assert!((end - rest.position(slave).unwrap()).abs() < 50);
        assert!(later.drive(slave).unwrap().statusword.is_enabled());
    }
}

/// API-9 SK-7.10 SK-4.65 Closing and dropping hold, switch off or leave, as asked for.
#[test]
fn closing_holds_switches_off_or_leaves_as_asked() {
    for (how, dropped, on) in [
        (Close::Hold, false, true),
        (Close::Hold, true, true),
        (Close::ServoOff, false, false),
        (Close::ServoOff, true, false),
        (Close::Leave, false, true),
        (Close::Leave, true, true),
    ] {
        let keys = format!("slaves=drive*2&name=close-{how:?}-{dropped}");
        let tap = Tap::open(&keys);
        let ecm = enable(tap.ecm(Options { close: how, ..Options::default() }).unwrap(), &Config::drives(2));
        moving(&ecm, 100);
        tap.take();
        if dropped {
            drop(ecm)
        } else {
            ecm.close(how).unwrap()
        }
        let written = tap.take();
        assert_eq!(written.is_empty(), how != Close::ServoOff, "{how:?}: a board at rest needs nothing");
        let ecm = open(&keys);
        assert_eq!(ecm.state().unwrap(), StateByte::reached(MasterState::Op), "the network goes on");
        ecm.adopt(&Config::drives(2)).unwrap();
        for slave in [1, 2] {
            let drive = ecm.next_cycle(SECOND).unwrap().drive(slave).unwrap();
            assert_eq!(drive.statusword.is_enabled(), on, "{how:?} {dropped}");
        }
    }
}

/// API-10 SK-5.5 CSV ramps its velocity to 0 and CST keeps the torque of an axis at rest.
#[test]
fn closing_ramps_a_velocity_to_0_and_keeps_a_holding_torque() {
    let slaves = vec![Slave::Drive(Axis::CSV), Slave::Drive(Axis::CST), Slave::Drive(Axis::CST)];
    let (tap, ecm) = Tap::enabled("slaves=drive*3", &Config { slaves, ..Config::default() });
    let mut stream = ecm.stream(8).unwrap();
    for _ in 0..300 {
        stream.csv(1, 100_000).unwrap();
        // Less than dry friction takes, and more.
        stream.cst(2, 10).unwrap();
        stream.cst(3, 100).unwrap();
        stream.step().unwrap();
    }
    tap.take();
    // The motor of axis 3 has to run out on friction: that may take longer than the limit.
    let now = || tap.now();
    let began = now();
    let ended = stream.finish();
    assert!(now() - began <= CLOSING_MAX, "docs/SAFETY.md: 2 s, {:?}", now() - began);
    assert!(matches!(ended, Ok(_) | Err(EcmError::Timeout { what: "a standstill", .. })), "{ended:?}");
    let frames = tap.take();
    let of = |slave| frames.iter().map(move |frame| frame.slot(SIZE, slave));
    let velocities: Vec<i32> = of(1).map(|slot| slot.data1 as i32).collect();
    // 400 counts/s in each frame, "linearly".
    assert!(velocities.windows(2).all(|pair| (0..=410).contains(&(pair[0] - pair[1]))), "{velocities:?}");
    let ramp = velocities.iter().filter(|velocity| (1..100_000).contains(*velocity)).count();
    assert!((240..=260).contains(&ramp), "docs/SAFETY.md: 250 ms, {ramp} frames");
    assert_eq!(velocities.last(), Some(&0));
    assert!(of(2).all(|slot| slot.data1 == 10), "a standing axis keeps its torque");
    assert_eq!(of(3).next_back().unwrap().data1, 0);
    let first = ecm.next_cycle(SECOND).unwrap().position(1).unwrap();
    cycles(&ecm, 50);
    assert!((ecm.snapshot().unwrap().position(1).unwrap() - first).abs() <= 2);
}

/// API-10 SK-5.4 If the board's FIFO ran empty its axes are at rest: the end of the stream does not start them again.
#[test]
fn the_end_of_a_stream_does_not_move_a_board_that_ran_dry() {
    let (tap, ecm) = Tap::enabled("slaves=drive*2&queue=4", &Config::drives(2));
    let mut stream = ecm.stream(8).unwrap();
    follow(&mut stream, 1, 0, 50, 300);
    tap.pass(SECOND).unwrap();
    tap.take();
    stream.finish().unwrap();
    assert!(tap.take().is_empty());
}

/// API-9 SK-4.59 Closing ends within 2 s whatever the board does: full, silent, cut. So does the end of a stream.
#[test]
fn closing_is_bounded() {
    for (name, text) in [("full", "at 1s full\n"), ("silent", "at 1s silent\n"), ("cut", "at 1s cut 1\n")] {
        let file = script(&format!("close-{name}"), text);
        for how in [Close::Hold, Close::ServoOff] {
            let keys = format!("slaves=drive*2&script={file}&name=close-{name}-{how:?}");
            let (tap, ecm) = Tap::enabled(&keys, &Config::drives(2));
            let mut stream = ecm.stream(100).unwrap();
            let mut n = 0;
            while tap.pass(Duration::ZERO).unwrap().unwrap().0 - tap.info().opened_at.0 < 1_050_000_000 {
                n += 1;
                let aimed = stream.csp(1, n * 50);
                if aimed.and_then(|()| stream.step().map(|_| ())).is_err() {
                    break;
                }
            }
            let now = || tap.now();
            let began = now();
            let ended = stream.finish();
            assert!(now() - began <= CLOSING_MAX, "docs/SAFETY.md: 2 s, {name}: {:?}", now() - began);
            assert!(ended.is_err(), "{name}");
            // A board that makes no report is given up after 1 s.
            let (took, silent) = (now() - began, SECOND..=SECOND + SECOND / 5);
            assert!(name == "full" || silent.contains(&took), "docs/SAFETY.md: 1 s, {name}: {took:?}");
            let began = now();
            let errors = ecm.close(how);
            assert!(errors.is_err(), "{name} {how:?}");
            let took = clock(&keys) - began;
            assert!(took <= CLOSING_MAX, "docs/SAFETY.md: 2 s, {name} {how:?}: {took:?}");
        }
    }
}

/// API-9 A board with a long cycle that makes no report is given up after three cycles, if those are longer than 1 s.
#[test]
fn a_silent_board_with_a_long_cycle_is_given_up_after_three_cycles() {
    let file = script("close-slow", "at 60s silent\n");
    let config = Config { cycle_us: 512_000, ..Config::drives(2) };
    let (tap, ecm) = Tap::enabled(&format!("slaves=drive*2&script={file}"), &config);
    let mut stream = ecm.stream(1).unwrap();
    let mut n = 0;
    while stream.csp(1, n * 50).and_then(|()| stream.step().map(|_| ())).is_ok() {
        n += 1;
    }
    let began = tap.now();
    assert!(matches!(stream.finish(), Err(EcmError::NoReport { .. })));
    let took = tap.now() - began;
    let three = 3 * Duration::from_micros(config.cycle_us.into());
    assert!((three..=2 * SECOND).contains(&took), "docs/SAFETY.md: three cycles, {took:?}");
}

/// API-9 A ramp that would not fit into the limit is refused when the board is opened.
#[test]
fn a_ramp_longer_than_the_limit_is_refused_when_opening() {
    let long = Options { ramp: Duration::from_secs(3), ..Options::default() };
    let error = Ecm::open_with("sim:?clock=virtual", long).map(|_| ()).unwrap_err();
    assert!(matches!(error, EcmError::Setting { what: "ramp", .. }), "{error}");
}

/// API-27 Nothing is done to axes that were neither configured nor adopted.
#[test]
fn axes_that_were_not_configured_or_adopted_are_left_alone() {
    let keys = "slaves=drive*2&name=foreign";
    let ecm = enable(open(keys), &Config::drives(2));
    ecm.close(Close::Leave).unwrap();
    let tap = Tap::open(keys);
    tap.ecm(Options::default()).unwrap().close(Close::ServoOff).unwrap();
    assert!(tap.take().is_empty());
}
