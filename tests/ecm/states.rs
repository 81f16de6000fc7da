//! The native API's opening, configuring and changing of states, and its handling of odd reports.

use std::time::Duration;

use crate::common::{SECOND, SIZE, Tap, cycles, enable, enabled, follow, in_op, open, script, uri};
use ecmsk::cia402::Mode;
use ecmsk::coe::ObjectAddress;
use ecmsk::ecm::{Axis, Close, Config, ConfigError, Ecm, EcmError, Guard, News, Options, Scale, Slave, Suspect};
use ecmsk::link::{Link, LinkError, Wait};
use ecmsk::sk::{Frame, MasterState, SlotSize, StateByte};

/// SK-4.49 SK-4.50 SK-4.51 From PreOP to OP with the configuration, by either firmware and slot size, and back.
#[test]
fn configure_and_reach_op() {
    for keys in ["slaves=drive*2,io", "slaves=drive*2,io&fw=1.5", "slaves=drive*2,io&slot=16"] {
        let ecm = open(keys);
        assert_eq!(ecm.state().unwrap(), StateByte::reached(MasterState::PreOp));
        let slaves = vec![Slave::Drive(Axis::CSP), Slave::Drive(Axis::CSV), Slave::Io];
        ecm.configure(&Config { slaves, cycle_us: 500 }).unwrap();
        for state in [MasterState::SafeOp, MasterState::Op, MasterState::PreOp, MasterState::Op, MasterState::Init] {
            ecm.set_state(state).unwrap();
            assert_eq!(ecm.state().unwrap(), StateByte::reached(state), "{keys}");
        }
    }
    let ecm = open("slaves=drive");
    in_op(&ecm, &Config { cycle_us: 500, ..Config::drives(1) });
    let first = ecm.next_cycle(SECOND).unwrap();
    let second = ecm.next_cycle(SECOND).unwrap();
    assert_eq!((second.meta.at.0 - first.meta.at.0, second.meta.sequence - first.meta.sequence), (500_000, 1));
}

/// A wrong configuration is refused before a byte is sent, with the slave and what is allowed.
#[test]
fn a_wrong_configuration_sends_nothing() {
    let tap = Tap::open("slaves=drive");
    let ecm = tap.ecm(Options::default()).unwrap();
    let one = |slave| Config { slaves: vec![Slave::Io, slave], ..Config::default() };
    let axis = |mode| Axis { mode, ..Axis::CSP };
    let wrong = [
        Config { cycle_us: 300, ..Config::drives(1) },
        Config { cycle_us: 0, ..Config::drives(1) },
        Config::drives(0),
        Config::drives(41),
        one(Slave::Drive(axis(Mode::Homing))),
        one(Slave::Step(Axis::CSV)),
        one(Slave::Hsp(Axis::CST)),
        one(Slave::Drive(Axis { guard: Guard::Within(0), ..Axis::CSP })),
        one(Slave::Drive(Axis { scale: Scale::per_unit(0.0), ..Axis::CSP })),
        one(Slave::Drive(Axis { scale: Scale::per_unit(f64::NAN), ..Axis::CSP })),
    ];
    for config in &wrong {
        assert!(matches!(ecm.configure(config), Err(EcmError::Config(_))), "{config:?}");
        assert!(matches!(ecm.adopt(config), Err(EcmError::Config(_))), "{config:?}");
    }
    assert!(tap.take().is_empty());
    let error = one(Slave::Hsp(Axis::CST)).check(SIZE).unwrap_err();
    assert_eq!(error.to_string(), "slave 2 is a HSP in CST: set its mode to CSP, CSV");
    assert!(matches!(Config::drives(31).check(SlotSize::Bytes16), Err(ConfigError::Count { found: 31, max: 30, .. })));
}

/// SK-4.10 The number of slaves has to be that of the network.
#[test]
fn another_number_of_slaves_is_an_error() {
    let ecm = open("slaves=drive*2");
    assert_eq!(ecm.configure(&Config::drives(3)), Err(EcmError::SlaveCount { declared: 3, found: 2 }));
    assert_eq!(ecm.configure(&Config::drives(1)), Err(EcmError::SlaveCount { declared: 1, found: 2 }));
    ecm.configure(&Config::drives(2)).unwrap();
}

/// SK-4.55 SK-4.58 The error of a change that gets stuck names the state and, as far as the reports show it, the slave.
#[test]
fn a_stuck_change_says_where_and_on_whom() {
    // Both are declared as drives, but the second one is an IO slave.
    let ecm = open("slaves=drive,io");
    ecm.configure(&Config::drives(2)).unwrap();
    let found = StateByte::failed(Some(MasterState::PreOp));
    let missing = ObjectAddress::new(0x6041, 0);
    let suspect = Suspect::NotOfKind { slave: 2, kind: "DRIVE", missing };
    let error = ecm.set_state(MasterState::Op).unwrap_err();
    assert_eq!(error, EcmError::StateStuck { wanted: MasterState::Op, found, suspect });
    assert_eq!(
        error.to_string(),
        "OP was not reached, the board is in PreOP (a slave failed): slave 2 is no DRIVE, it has no object 0x6041:0; \
         correct the configuration"
    );
    // It is the same the second time, and after the correction an old failure does not count as a new one.
    assert!(matches!(ecm.set_state(MasterState::Op), Err(EcmError::StateStuck { .. })));
    let right = Config { slaves: vec![Slave::Drive(Axis::CSP), Slave::Io], ..Config::default() };
    ecm.configure(&right).unwrap();
    ecm.set_state(MasterState::Op).unwrap();

    let file = script("mute", "at 100ms mute 2\n");
    let ecm = open(&format!("slaves=drive*2&script={file}&state_timeout_ms=500&sdo_timeout_ms=100"));
    ecm.configure(&Config::drives(2)).unwrap();
    while ecm.next_cycle(SECOND).unwrap().meta.sequence < 200 {}
    let error = ecm.set_state(MasterState::Op).unwrap_err();
    assert!(matches!(error, EcmError::StateStuck { suspect: Suspect::Silent { slave: 2 }, .. }), "{error}");

    let file = script("refuse", "refuse 1 op 0x001B\n");
    let ecm = open(&format!("slaves=drive*2&script={file}&state_timeout_ms=500"));
    ecm.configure(&Config::drives(2)).unwrap();
    let error = ecm.set_state(MasterState::Op).unwrap_err();
    let found = StateByte::failed(Some(MasterState::SafeOp));
    assert_eq!(error, EcmError::StateStuck { wanted: MasterState::Op, found, suspect: Suspect::Unknown });

    // Nothing is configured: the board treats the drives as IO slaves.
    let error = open("slaves=drive").set_state(MasterState::Op).unwrap_err();
    assert!(matches!(error, EcmError::StateStuck { suspect: Suspect::Undeclared, .. }), "{error}");
    assert!(error.to_string().ends_with("call configure first"), "{error}");
}

/// SK-4.62 A slave that was lost and is there again comes back with the first change of state, also with one down: the board
/// shows a failure until it is back, which is none of the change. A slave that is not there fails the change.
#[test]
fn a_lost_slave_comes_back_with_the_first_change_down() {
    for (script_of, comes_back) in [("at 1s lose 2\nat 2s find 2\n", true), ("at 1s lose 2\n", false)] {
        let file = script(if comes_back { "lost-back" } else { "lost-gone" }, script_of);
        let ecm = enabled(&format!("slaves=drive*2&script={file}"), &Config::drives(2));
        let failed = StateByte::failed(Some(MasterState::Op));
        while ecm.next_cycle(SECOND).unwrap().state() != failed {}
        cycles(&ecm, 1500);
        assert_eq!(ecm.state().unwrap(), failed);
        let changed = ecm.set_state(MasterState::PreOp);
        if !comes_back {
            let suspect = Suspect::Silent { slave: 2 };
            let found = StateByte::failed(Some(MasterState::PreOp));
            assert_eq!(changed, Err(EcmError::StateStuck { wanted: MasterState::PreOp, found, suspect }));
            continue;
        }
        changed.unwrap();
        ecm.configure(&Config::drives(2)).unwrap();
        ecm.set_state(MasterState::Op).unwrap();
        ecm.servo_on(&[1, 2]).unwrap();
    }
}

/// API-27 SK-5.5 A board found in OP is adopted unchanged: nothing is sent, its axes go on, and configuring it is
/// refused.
#[test]
fn a_board_in_op_is_attached_to() {
    let keys = "slaves=drive&name=attach";
    let config = Config { slaves: vec![Slave::Drive(Axis::CSV)], ..Config::default() };
    let ecm = enabled(keys, &config);
    let mut stream = ecm.stream(4).unwrap();
    for _ in 0..200 {
        stream.csv(1, 50_000).unwrap();
        stream.step().unwrap();
    }
    std::mem::forget(stream);
    ecm.close(Close::Leave).unwrap();

    let tap = Tap::open(keys);
    let ecm = tap.ecm(Options::default()).unwrap();
    assert_eq!(ecm.state().unwrap(), StateByte::reached(MasterState::Op));
    assert!(matches!(ecm.configure(&config), Err(EcmError::WrongState { needs: "PreOP", .. })));
    assert!(matches!(ecm.servo_off(&[1]), Err(EcmError::NoSuchSlave { slave: 1, declared: 0 })));
    ecm.adopt(&config).unwrap();
    let from = ecm.next_cycle(SECOND).unwrap();
    cycles(&ecm, 99);
    let to = ecm.next_cycle(SECOND).unwrap();
    let moved = to.position(1).unwrap() - from.position(1).unwrap();
    assert!((4_500..5_500).contains(&moved), "it goes on: {moved}");
    assert!(tap.take().is_empty());
    // An axis that another program has set in motion is ramped to a standstill, and stays enabled.
    ecm.close(Close::Hold).unwrap();
    let ecm = open(keys);
    ecm.adopt(&config).unwrap();
    let rest = ecm.next_cycle(SECOND).unwrap();
    cycles(&ecm, 50);
    let still = ecm.snapshot().unwrap();
    assert!((still.position(1).unwrap() - rest.position(1).unwrap()).abs() <= 2);
    assert!(still.drive(1).unwrap().statusword.is_enabled());
}

/// SK-2.7 A change of byte 1 is an event and no error, whatever the value.
#[test]
fn a_change_of_byte_1_is_an_event_and_no_error() {
    let (tap, ecm) = Tap::enabled("slaves=drive", &Config::drives(1));
    ecm.take_news().unwrap();
    tap.bend(|n, frame| {
        frame.bytes_mut()[1] = [0, 0, 255, 255, 0, 7][(n as usize).min(5)];
        frame.fill_crc(SIZE);
    });
    cycles(&ecm, 10);
    let told = |from, to| News::ErrorByte { from, to };
    assert_eq!(ecm.take_news().unwrap(), [told(0, 255), told(255, 0), told(0, 7)]);
    assert_eq!(ecm.stats().unwrap().error_byte_changes, 3);
    ecm.sdo_read::<u32>(1, ObjectAddress::new(0x1000, 0)).unwrap();
    ecm.servo_off(&[1]).unwrap();
}

/// SK-1.20 SK-1.21 CRC 0 counts as absent, anything else must match; the strict option checks always.
#[test]
fn a_wrong_crc_of_a_report_is_refused_and_0_counts_as_absent() {
    let bent = |byte: u8, strict_crc| {
        let tap = Tap::open("slaves=drive");
        let ecm = tap.ecm(Options { strict_crc, ..Options::default() }).unwrap();
        tap.bend(move |n, frame| {
            if n % 2 == 0 {
                // Never the right one.
                frame.bytes_mut()[7] ^= 0x40;
                frame.bytes_mut()[3] = if byte == 0 || frame.crc(SIZE) != byte { byte } else { byte ^ 1 };
            }
        });
        cycles(&ecm, 10);
        ecm.stats().unwrap().bad_crc
    };
    assert_eq!((bent(0, false), bent(0, true)), (0, 10));
    assert_eq!((bent(0x5C, false), bent(0x5C, true)), (10, 10));

    // A board without CRCs is valid, and only wrong CRCs without a good report are an error.
    let tap = Tap::open("slaves=drive");
    let ecm = tap.ecm(Options::default()).unwrap();
    tap.bend(|_, frame| frame.bytes_mut()[9] ^= 1);
    let error = ecm.next_cycle(SECOND).unwrap_err();
    assert!(matches!(error, EcmError::NoReport { bad_crc, .. } if bad_crc > 900), "{error}");
}

/// SK-1.13 If the link does not give the slot size, the CRC of its reports shows it.
#[test]
fn the_slot_size_is_found() {
    for (keys, size) in [("slaves=drive", SlotSize::Bytes12), ("slaves=drive&slot=16", SlotSize::Bytes16)] {
        let ecm = Tap::without_slot(keys).ecm(Options::default()).unwrap();
        assert_eq!(ecm.slot_size().unwrap(), size);
        in_op(&ecm, &Config::drives(1));
    }
    let tap = Tap::without_slot("slaves=drive");
    tap.bend(|_, frame| frame.bytes_mut()[3] = 0);
    assert!(matches!(tap.ecm(Options::default()).map(|_| ()), Err(EcmError::SlotUnknown { .. })));
    let given = Options { slot: Some(SlotSize::Bytes12), ..Options::default() };
    Tap::without_slot("slaves=drive").ecm(given).unwrap();
}

/// LIB-37 Every read and write of every call has a limit, even if the link's own default waits for ever.
#[test]
fn every_wait_has_a_limit() {
    let tap = Tap::open("slaves=drive,io");
    assert_eq!(tap.info().read_wait, Wait::Forever);
    let config = Config { slaves: vec![Slave::Drive(Axis::CSP), Slave::Io], ..Config::default() };
    let ecm = enable(tap.ecm(Options::default()).unwrap(), &config);
    ecm.sdo_read::<u32>(1, ObjectAddress::new(0x1000, 0)).unwrap();
    ecm.set_outputs(2, 1).unwrap();
    ecm.local_inputs().unwrap();
    let mut stream = ecm.stream(4).unwrap();
    follow(&mut stream, 1, 0, 10, 20);
    stream.finish().unwrap();
    ecm.close(Close::ServoOff).unwrap();
    let waits = tap.waits.lock().unwrap();
    assert!(waits.len() > 100);
    assert!(!waits.contains(&Wait::Forever));
    let longest = waits.iter().filter_map(|wait| if let Wait::For(limit) = wait { Some(*limit) } else { None }).max();
    assert!(longest <= Some(SECOND), "{longest:?}");
}

/// LIB-37 SK-9.12 A silent board ends every call with an error that says what to do.
#[test]
fn a_silent_board_ends_calls() {
    let file = script("silent", "at 50ms silent\n");
    let ecm = open(&format!("slaves=drive&script={file}"));
    while ecm.next_cycle(SECOND).is_ok() {}
    let silent = |done: Result<(), EcmError>| {
        let error = done.unwrap_err();
        assert!(matches!(error, EcmError::NoReport { .. }), "{error:?}");
    };
    silent(ecm.set_state(MasterState::Op));
    silent(ecm.configure(&Config::drives(1)));
    silent(ecm.sdo_read::<u32>(1, ObjectAddress::new(0x1000, 0)).map(|_| ()));
    silent(ecm.local_inputs().map(|_| ()));
}

/// SK-9.11 Lost reports are reported, and the others are not affected.
#[test]
fn lost_reports_are_told() {
    let tap = Tap::open("slaves=drive&queue=4");
    let ecm = tap.ecm(Options::default()).unwrap();
    ecm.next_cycle(SECOND).unwrap();
    tap.pass(Duration::from_millis(50)).unwrap();
    let now = ecm.next_cycle(SECOND).unwrap();
    assert_eq!(ecm.stats().unwrap().reports_lost, now.meta.dropped);
    assert_eq!(ecm.take_news().unwrap(), [News::ReportsLost { count: now.meta.dropped }]);
    assert!(now.meta.dropped >= 45);
}

/// A line that loses, doubles, corrupts and delays frames in both directions: all calls succeed.
#[test]
fn a_bad_line_is_lived_with() {
    for seed in 1..4 {
        let keys = "fault.drop=0.05&fault.corrupt.read=0.05&fault.duplicate.read=0.05&fault.delay=0.01";
        let ecm = open(&format!("slaves=drive*2,io&{keys}&fault.seed={seed}"));
        let slaves = vec![Slave::Drive(Axis::CSP), Slave::Drive(Axis::CSP), Slave::Io];
        ecm.configure(&Config { slaves, ..Config::default() }).unwrap();
        // A SET_STATE that is lost shows as a timeout: nothing repeats it by itself.
        while ecm.set_state_within(MasterState::Op, SECOND * 5).is_err() {}
        ecm.servo_on(&[1, 2]).unwrap();
        for n in 0..30_u32 {
            ecm.sdo_write(1, ObjectAddress::new(0x6065, 0), 1000 + n).unwrap();
            assert_eq!(ecm.sdo_read::<u32>(1, ObjectAddress::new(0x6065, 0)).unwrap(), 1000 + n);
            ecm.set_outputs(3, n as u16).unwrap();
            assert_eq!(ecm.inputs(3).unwrap(), n as u16);
        }
        let stats = ecm.stats().unwrap();
        assert!(stats.bad_crc > 0 && stats.reports_lost > 0 && stats.stale > 0, "{stats:?}");
    }
}

/// API-17 A board that goes away is an error of the link; it is not opened again automatically.
#[test]
fn a_lost_board_stays_lost() {
    let ecm = Ecm::open(&uri("slaves=drive&fault.disconnect_ms=100")).unwrap();
    ecm.configure(&Config::drives(1)).unwrap();
    let lost = loop {
        if let Err(error) = ecm.next_cycle(SECOND) {
            break error;
        }
    };
    assert!(matches!(lost, EcmError::Link(LinkError::Lost { .. })), "{lost}");
    assert!(lost.to_string().ends_with("open it again"), "{lost}");
    assert!(matches!(ecm.set_state(MasterState::Op), Err(EcmError::Link(LinkError::Lost { .. }))));
    assert!(matches!(ecm.close(Close::Hold), Err(EcmError::Link(LinkError::Lost { .. }))));
}

/// SK-9.9 On the real clock: to OP, a stream without a loss, closed.
#[test]
fn a_stream_on_the_real_clock_has_no_loss() {
    let ecm = Ecm::open("sim:?slaves=drive*2").unwrap();
    let ecm = enable(ecm, &Config { cycle_us: 4000, ..Config::drives(2) });
    let mut stream = ecm.stream(100).unwrap();
    follow(&mut stream, 2, 0, 5, 300);
    let stats = stream.finish().unwrap();
    assert_eq!((stats.frames, stats.losses), (300, 0));
    assert!(ecm.snapshot().unwrap().position(2).unwrap() > 1_400);
    ecm.close(Close::ServoOff).unwrap();
}

/// SK-3.12 The snapshot shows the received report.
#[test]
fn a_snapshot_is_the_report() {
    let ecm =
        enabled("slaves=drive,io", &Config { slaves: vec![Slave::Drive(Axis::CSP), Slave::Io], ..Config::default() });
    let shot = ecm.next_cycle(SECOND).unwrap();
    assert_eq!(shot.slaves(), 2);
    assert_eq!(shot.drive(1).unwrap().position, shot.position(1).unwrap());
    assert_eq!((shot.drive(2), shot.position(2), shot.slave(3)), (None, None, None));
    assert_eq!(shot.frame().crc_byte(), shot.frame().crc(SIZE));
    assert_ne!(*shot.frame(), Frame::new());
}
