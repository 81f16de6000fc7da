//! The native API's axes and IO: on, off, alarms, homing, inputs and outputs.

use std::time::Duration;

use crate::common::{SECOND, SIZE, Tap, cycles, enable, enabled, follow, in_op, open, script};
use ecmsk::cia402::{MODES_OF_OPERATION, Mode};
use ecmsk::coe::{AbortCode, ObjectAddress};
use ecmsk::ecm::{Axis, Config, EcmError, Homing, HomingPhase, Options, Slave};
use ecmsk::link::Link;
use ecmsk::sk::{CommandId, MasterState};

/// SK-7.15 SK-7.8 SK-7.10 Axes are on when servo_on returns and off when servo_off does, one or many.
#[test]
fn axes_are_on_after_servo_on_and_off_after_servo_off() {
    for keys in ["slaves=drive*3", "slaves=drive*3&fw=1.5", "slaves=drive*3&slot=16"] {
        let ecm = open(keys);
        in_op(&ecm, &Config::drives(3));
        let on = |slave| ecm.snapshot().unwrap().drive(slave).unwrap().statusword.is_enabled();
        ecm.servo_on(&[1, 3]).unwrap();
        assert_eq!([on(1), on(2), on(3)], [true, false, true]);
        ecm.servo_on(&[1, 2, 3]).unwrap();
        ecm.servo_off(&[3]).unwrap();
        assert_eq!([on(1), on(2), on(3)], [true, true, false]);
    }
}

/// API-23 A call that an axis or a state does not allow is refused before anything is sent.
#[test]
fn calls_that_an_axis_or_state_forbids_send_nothing() {
    let tap = Tap::open("slaves=drive,io");
    let ecm = tap.ecm(Options::default()).unwrap();
    let config = Config { slaves: vec![Slave::Drive(Axis::CSP), Slave::Io], ..Config::default() };
    ecm.configure(&config).unwrap();
    tap.take();
    assert!(matches!(ecm.servo_on(&[1]), Err(EcmError::WrongState { what: "servo_on", needs: "OP", .. })));
    assert!(matches!(ecm.inputs(2), Err(EcmError::WrongState { .. })));
    assert!(tap.take().is_empty());
    ecm.set_state(MasterState::Op).unwrap();
    tap.take();
    assert!(matches!(ecm.servo_on(&[1, 2]), Err(EcmError::WrongKind { slave: 2, kind: "IO", .. })));
    assert!(matches!(ecm.servo_on(&[3]), Err(EcmError::NoSuchSlave { slave: 3, declared: 2 })));
    assert!(matches!(ecm.inputs(1), Err(EcmError::WrongKind { slave: 1, kind: "DRIVE", .. })));
    assert!(matches!(ecm.set_local_outputs(0x40), Err(EcmError::Setting { .. })));
    let not_on = ecm.home(1, &Homing::method(35), |_| {});
    assert!(matches!(not_on, Err(EcmError::NotEnabled { slave: 1, .. })), "{not_on:?}");
    assert!(tap.take().is_empty());
    assert_eq!(tap.stats().board.unwrap().rejected_total(), 0);
}

/// SK-7.9 SK-7.11 SK-7.12 An alarm ends switching on with its code; cleared, if it can be.
#[test]
fn an_alarm_ends_servo_on_with_its_code_until_it_is_cleared() {
    let file = script("axes-alarm", "at 500ms alarm 1 0x7500 stays\n");
    let ecm = open(&format!("slaves=drive*2&script={file}"));
    in_op(&ecm, &Config::drives(2));
    ecm.servo_on(&[1, 2]).unwrap();
    while ecm.next_cycle(SECOND).unwrap().drive(1).unwrap().statusword.is_enabled() {}
    // This alarm stays: no reset clears it.
    while ecm.next_cycle(SECOND).unwrap().drive(1).unwrap().error_code == 0 {}
    let alarm = EcmError::Alarm { slave: 1, code: 0x7500 };
    assert_eq!(ecm.clear_alarm(&[1]), Err(alarm.clone()));
    assert_eq!(ecm.servo_on(&[1]), Err(alarm.clone()));
    assert!(alarm.to_string().contains("0x7500") && alarm.to_string().ends_with("clear_alarm and servo_on"));
    ecm.servo_on(&[2]).unwrap();

    // Its cause ends: the alarm stays until it is cleared, and then it is.
    let file = script("axes-alarm-ends", "at 500ms alarm 1 0x7500 stays\nat 600ms end alarm 1\n");
    let ecm = open(&format!("slaves=drive&script={file}"));
    in_op(&ecm, &Config::drives(1));
    ecm.servo_on(&[1]).unwrap();
    (0..1000).for_each(|_| _ = ecm.next_cycle(SECOND).unwrap());
    assert_eq!(ecm.servo_on(&[1]), Err(alarm));
    ecm.clear_alarm(&[1]).unwrap();
    ecm.servo_on(&[1]).unwrap();

    // A following error is an alarm that a reset clears.
    let ecm = enabled("slaves=drive", &Config::drives(1));
    ecm.sdo_write(1, ObjectAddress::new(0x6065, 0), 10_u32).unwrap();
    let mut stream = ecm.stream(4).unwrap();
    let mut n = 0;
    let code = loop {
        n += 1;
        match stream.csp(1, n * 100) {
            Ok(()) => stream.step().map(|_| ()).unwrap(),
            Err(EcmError::Alarm { slave: 1, code }) => break code,
            Err(EcmError::NotEnabled { .. }) => stream.step().map(|_| ()).unwrap(),
            Err(other) => panic!("{other}"),
        }
        assert!(n < 10_000, "no following error");
    };
    drop(stream);
    assert_eq!(code, 0x8611, "following error of CiA 402");
    assert!(matches!(ecm.servo_on(&[1]), Err(EcmError::Alarm { .. })));
    ecm.clear_alarm(&[1]).unwrap();
    ecm.servo_on(&[1]).unwrap();
}

/// SK-7.19 SK-7.20 SK-7.24 Homing by both firmwares: progress in order, home is 0, the axis takes targets again.
#[test]
fn homing_reports_its_progress_and_ends_at_0() {
    for keys in ["slaves=drive*2", "slaves=drive*2&fw=1.5", "slaves=drive*2&slot=16"] {
        let (tap, ecm) = Tap::enabled(keys, &Config::drives(2));
        let mut stream = ecm.stream(4).unwrap();
        follow(&mut stream, 1, 0, 50, 200);
        stream.finish().unwrap();
        for round in 0..2 {
            let mut phases = Vec::new();
            let homing = Homing { offset: Some(0), ..Homing::method(33) };
            ecm.home(1, &homing, |progress| {
                if phases.last() != Some(&progress.phase) {
                    phases.push(progress.phase);
                }
            })
            .unwrap_or_else(|error| panic!("{keys}: {error}"));
            assert_eq!(phases, [HomingPhase::Preparing, HomingPhase::Moving, HomingPhase::Restoring], "{keys} {round}");
            let position = ecm.snapshot().unwrap().position(1).unwrap();
            assert!(position.abs() < 200, "{keys}: {position}");
            let mode = ecm.sdo_read::<u8>(1, ObjectAddress::new(MODES_OF_OPERATION, 0)).unwrap();
            assert_eq!(mode, Mode::Csp.code());
            let mut stream = ecm.stream(4).unwrap();
            follow(&mut stream, 1, position, 50, 100);
            assert!(stream.snapshot().unwrap().position(1).unwrap() > position + 3_000, "{keys}: it moves again");
        }
        assert_eq!(tap.stats().board.unwrap().rejected_total(), 0, "{keys}");
    }
}

/// SK-7.21 SK-6.5 An unsupported method, and a home that is not found, are errors; the axis is in its mode afterwards.
#[test]
fn an_unknown_method_and_a_home_not_found_are_errors() {
    let ecm = enabled("slaves=drive", &Config::drives(1));
    let error = ecm.home(1, &Homing::method(99), |_| {}).unwrap_err();
    assert!(matches!(error, EcmError::HomingFailed { slave: 1, .. }), "{error}");
    assert!(error.to_string().contains("bit 13"), "{error}");
    assert_eq!(ecm.sdo_read::<u8>(1, ObjectAddress::new(MODES_OF_OPERATION, 0)).unwrap(), 8);

    // So slow that the switch is not reached in time.
    let slow = Homing { switch_speed: Some(1), limit: SECOND, ..Homing::method(17) };
    let error = ecm.home(1, &slow, |_| {}).unwrap_err();
    assert!(matches!(error, EcmError::Timeout { what: "homing", .. }), "{error}");
    assert_eq!(ecm.sdo_read::<u8>(1, ObjectAddress::new(MODES_OF_OPERATION, 0)).unwrap(), 8);
    let mut stream = ecm.stream(4).unwrap();
    let at = stream.snapshot().unwrap().position(1).unwrap();
    follow(&mut stream, 1, at, 50, 100);
    assert!(stream.snapshot().unwrap().position(1).unwrap() > at + 3_000);
    drop(stream);

    let file = script("home-abort", "sdo-abort 1 0x6098:0 0x06020000\n");
    let ecm = enabled(&format!("slaves=drive&script={file}"), &Config::drives(1));
    let error = ecm.home(1, &Homing::method(33), |_| {}).unwrap_err();
    assert!(matches!(error, EcmError::SdoAborted { code: AbortCode::NO_OBJECT, .. }), "{error}");
}

/// SK-7.20 Bits 10 and 12 that are still set from an earlier homing are not taken for a home.
#[test]
fn home_bits_of_an_earlier_homing_do_not_end_a_new_one() {
    let (tap, ecm) = Tap::enabled("slaves=drive", &Config::drives(1));
    let mut old = 5;
    tap.bend(move |_, frame| {
        let mut slot = frame.slot(SIZE, 1);
        if slot.id == CommandId::GoHome.code() && old > 0 {
            old -= 1;
            slot.parm |= 1 << 10 | 1 << 12;
            frame.put(SIZE, 1, &slot);
            frame.fill_crc(SIZE);
        }
    });
    let mut moving = 0;
    ecm.home(1, &Homing::method(33), |progress| moving += u32::from(progress.phase == HomingPhase::Moving)).unwrap();
    assert!(moving > 20, "it ended after {moving} reports");
}

/// API-15 SK-7.21 SK-7.27 Another thread aborts homing; while it runs another homing and targets are refused.
#[test]
fn homing_is_aborted_by_another_thread() {
    let ecm = enabled("slaves=drive*2", &Config::drives(2));
    ecm.abort_homing().unwrap();
    let slow = Homing { switch_speed: Some(1), limit: Duration::from_secs(3600), ..Homing::method(17) };
    let (moving, is_moving) = std::sync::mpsc::channel();
    std::thread::scope(|scope| {
        let homing = scope.spawn(|| {
            ecm.home(1, &slow, |progress| {
                if progress.phase == HomingPhase::Moving {
                    moving.send(()).ok();
                }
            })
        });
        is_moving.recv().unwrap();
        assert!(matches!(ecm.home(2, &Homing::method(35), |_| {}), Err(EcmError::Busy { what: "homing" })));
        let mut stream = ecm.stream(4).unwrap();
        assert_eq!(stream.csp(1, 0), Err(EcmError::IsHoming { slave: 1 }));
        stream.csp(2, 0).unwrap();
        drop(stream);
        ecm.abort_homing().unwrap();
        let error = homing.join().unwrap().unwrap_err();
        assert!(matches!(error, EcmError::HomingFailed { slave: 1, why: "it was aborted" }), "{error}");
    });
    assert!(ecm.snapshot().unwrap().drive(1).unwrap().statusword.is_enabled());
}

/// SK-3.17 SK-3.18 Inputs are the present ones, whatever was answered before; output k is wired to input k.
#[test]
fn io_reads_present_inputs_and_writes_outputs() {
    for keys in ["slaves=io,drive", "slaves=io,drive&fw=1.5", "slaves=io,drive&slot=16"] {
        let ecm = open(keys);
        in_op(&ecm, &Config { slaves: vec![Slave::Io, Slave::Drive(Axis::CSP)], ..Config::default() });
        for bits in [0x0000, 0xFFFF, 0x8001, 0x5A5A, 0x5A5A, 0x0001] {
            ecm.set_outputs(1, bits).unwrap();
            cycles(&ecm, 3);
            assert_eq!(ecm.inputs(1).unwrap(), bits, "{keys}");
            assert_eq!(ecm.inputs(1).unwrap(), bits, "{keys}");
        }
    }
}

/// SK-8.2 SK-8.3 SK-5.21 The board's own IO, in PreOP, in OP and behind a deep FIFO.
#[test]
fn the_boards_own_io_works_in_preop_in_op_and_behind_a_deep_fifo() {
    let file = script("local", "inputs 0x15\nat 3s inputs 0x2A\n");
    let tap = Tap::open(&format!("slaves=drive&script={file}"));
    let ecm = tap.ecm(Options::default()).unwrap();
    ecm.set_local_outputs(0x3F).unwrap();
    assert_eq!(ecm.local_inputs().unwrap(), 0x15);
    let ecm = enable(ecm, &Config::drives(1));
    ecm.set_local_outputs(0x01).unwrap();
    assert_eq!(ecm.local_inputs().unwrap(), 0x15);
    while ecm.next_cycle(SECOND).unwrap().meta.at.0 - tap.info().opened_at.0 < 3_000_000_000 {}
    let mut stream = ecm.stream(100).unwrap();
    for _ in 0..200 {
        stream.csp(1, 0).unwrap();
        stream.step().unwrap();
    }
    assert_eq!(ecm.local_inputs().unwrap(), 0x2A);
}
