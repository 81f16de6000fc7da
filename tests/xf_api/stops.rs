//! The stop at the end of a program, with many kinds of failures.

use std::sync::{Arc, Mutex};

use ecmsk::cia402::DriveState;
use ecmsk::coe::ObjectAddress;
use ecmsk::xf::host::{HostError, HostState};
use ecmsk::xf::request::{FifoEnable, HelperStateSet, MotorNumber, Reconfig, SdoOperation, SdoRequest, Slaves};
use ecmsk::xf::{CommandCode, EtherCatState};
use ecmsk::xf_api::{NetworkConfig, XfError};

use super::ends::{S, drive_state, moving, stands_and_is_off};
use super::{Exchange, POSITION, enabled, safe_op, started};

/// A quick stop's deceleration in counts/s\u{b2}.
const QUICK_STOP_DECELERATION: ObjectAddress = ObjectAddress::new(0x6085, 0);

fn motor(number: u8) -> MotorNumber {
    MotorNumber::decode(number).expect("a motor")
}

/// XF-17.11 A refused stop of one axis does not prevent the stop of the others; `close` returns the refusal.
#[test]
fn an_axis_that_cannot_be_stopped() {
    let (mut xf, chip) = started("drive*2");
    xf.start_network(&NetworkConfig::default()).unwrap();
    xf.set_state(Slaves::All, EtherCatState::PreOp).unwrap();
    for slave in 0..2 {
        xf.sdo_write(slave, super::MODE, 8_i8).unwrap();
    }
    xf.run(&Reconfig).unwrap();
    xf.set_state(Slaves::All, EtherCatState::SafeOp).unwrap();
    let mut data = xf.process_data().unwrap();
    for slave in 0..2 {
        xf.add_axis(slave + 1, slave, &data).unwrap();
    }
    xf.set_state(Slaves::All, EtherCatState::Op).unwrap();
    xf.run(&FifoEnable { on: true }).unwrap();
    xf.cycle(&mut data).unwrap();
    // The helper has no axis 0, which is stopped before the others.
    let refused = xf.run(&HelperStateSet { motor: motor(0), state: DriveState::OperationEnabled });
    assert!(matches!(refused, Err(XfError::Chip(HostError::Refused { .. }))), "{refused:?}");
    for number in 1..3 {
        xf.enable(number).unwrap();
    }
    let begin = super::Wires::now(&chip);
    let error = xf.close().unwrap_err();
    let expected = HostError::Refused { code: CommandCode::HelperStateSet };
    assert_eq!(error, XfError::Chip(expected));
    // In SafeOP drives would be off as well, after the time that axes have to come to rest.
    let waited = super::Wires::now(&chip) - begin;
    assert!(waited < S, "{waited}");
    stands_and_is_off(&chip);
}

/// XF-17.11 Exchanges that fail at times, or all of them for a second, delay the stop and do not end it.
#[test]
fn exchanges_that_fail_are_tried_again() {
    for every in [2, 5] {
        let (xf, chip, _) = moving();
        let mut n = 0;
        chip.behaves(move |_, _| {
            n += 1;
            if n % every == 0 { Exchange::Fails } else { Exchange::Passes }
        });
        xf.close().unwrap_or_else(|error| panic!("one in {every}: {error}"));
        stands_and_is_off(&chip);
    }
    let (xf, chip, _) = moving();
    let begin = super::Wires::now(&chip);
    chip.behaves(move |now, _| if now < begin + S { Exchange::Fails } else { Exchange::Passes });
    xf.close().unwrap();
    stands_and_is_off(&chip);
}

/// XF-17.11 A link that is cut permanently ends the stop after 2 s, with the wires' error.
#[test]
fn a_cut_link_ends_the_stop() {
    let (xf, chip, _) = moving();
    let begin = super::Wires::now(&chip);
    chip.cut_after(0);
    assert!(matches!(xf.close(), Err(XfError::Link(_))));
    let waited = super::Wires::now(&chip) - begin;
    assert!((2 * S..3 * S).contains(&waited), "{waited}");
}

/// XF-17.11 A driver that has stopped, since the chip was silent, is started once more for the stop.
#[test]
fn a_driver_that_has_stopped() {
    let (mut xf, chip, mut data) = moving();
    chip.behaves(|_, _| Exchange::Silent);
    (0..1000).find_map(|_| xf.cycle(&mut data).err()).expect("it ends");
    while !matches!(xf.host().state(), HostState::Stopped(_)) {
        let _ = xf.pass(std::time::Duration::from_secs(1));
    }
    chip.behaves(|_, _| Exchange::Passes);
    xf.close().unwrap();
    stands_and_is_off(&chip);

    // Once only: a chip that stays silent ends the stop.
    let (xf, chip, _) = moving();
    let begin = super::Wires::now(&chip);
    chip.behaves(|_, _| Exchange::Silent);
    assert!(matches!(xf.close(), Err(XfError::Chip(_))));
    let waited = super::Wires::now(&chip) - begin;
    assert!(waited < 30 * S, "{waited}");
}

/// XF-17.11 All axes share the time to come to rest; axes that do not are reported and switched off.
#[test]
fn axes_that_do_not_come_to_rest() {
    let (mut xf, chip) = started("drive*3");
    xf.start_network(&NetworkConfig::default()).unwrap();
    xf.set_state(Slaves::All, EtherCatState::PreOp).unwrap();
    for slave in 0..3 {
        xf.sdo_write(slave, QUICK_STOP_DECELERATION, 1_u32).unwrap();
    }
    let mut data = enabled(&mut xf).unwrap();
    for n in 1..=200 {
        for slave in 0..3 {
            data.set(data.output::<i32>(slave, super::TARGET).unwrap(), 10 * n);
        }
        xf.cycle(&mut data).unwrap();
    }
    let begin = super::Wires::now(&chip);
    let error = xf.close().unwrap_err();
    assert!(matches!(error, XfError::AxisStuck { wanted: "standstill", .. }), "{error}");
    let waited = super::Wires::now(&chip) - begin;
    assert!((3 * S..5 * S).contains(&waited), "{waited}");
    chip.alone(S);
    for slave in 0..3 {
        assert_eq!(drive_state(&chip, slave), Some(DriveState::SwitchOnDisabled));
    }
}

/// XF-17.11 An axis counts as on until a report shows it off: also after a reset of a fault, and after switching off
/// without an answer.
#[test]
fn an_axis_that_was_not_seen_off_is_on() {
    for exchanges in [0, 1, 4] {
        for resets in [false, true] {
            let (mut xf, chip, _) = moving();
            chip.cut_after(exchanges);
            let done = if resets { xf.reset_fault(0) } else { xf.disable(0) };
            assert!(matches!(done, Err(XfError::Link(_))), "{done:?}");
            chip.behaves(|_, _| Exchange::Passes);
            let data = xf.process_data().unwrap();
            assert_eq!(xf.add_axis(0, 0, &data), Err(XfError::AxisOn { motor: 0 }));
            drop(xf);
            stands_and_is_off(&chip);
        }
    }
}

/// XF-17.11 An axis that is switched on by the chip's own command is stopped like one of `enable`.
#[test]
fn an_axis_that_was_switched_on_raw() {
    let (mut xf, chip) = started("drive*2");
    let mut data = safe_op(&mut xf, 8).unwrap();
    xf.set_state(Slaves::All, EtherCatState::Op).unwrap();
    xf.run(&FifoEnable { on: true }).unwrap();
    xf.cycle(&mut data).unwrap();
    for number in 0..2 {
        xf.run(&HelperStateSet { motor: motor(number), state: DriveState::OperationEnabled }).unwrap();
    }
    xf.pass(std::time::Duration::from_secs(1)).unwrap();
    assert_eq!(drive_state(&chip, 0), Some(DriveState::OperationEnabled));
    // SafeOP alone would leave them in their state.
    let mut states = Vec::new();
    let seen = chip.clone();
    xf.run(&FifoEnable { on: true }).unwrap();
    drop(xf);
    states.extend((0..2).map(|slave| drive_state(&seen, slave)));
    stands_and_is_off(&chip);
}

/// XF-17.11 Waiting commands, and results that were not fetched, do not delay the stop.
#[test]
fn the_stop_goes_before_what_waits() {
    let (mut xf, chip, _) = moving();
    let now = super::Wires::now(&chip);
    let sdo = SdoRequest {
        slave: ecmsk::xf::request::SlaveNumber::new(0).unwrap(),
        object: POSITION,
        scope: ecmsk::coe::SdoScope::Entry,
        timeout_us: 100_000,
        operation: SdoOperation::Read { bytes: 4 },
    };
    while xf.host_mut().submit(now, &sdo).is_ok() {}
    while xf.host_mut().submit(now, &ecmsk::xf::request::FirmwareVersionGet).is_ok() {}
    xf.close().unwrap();
    stands_and_is_off(&chip);
}

/// XF-17.11 Axes are stopped before their network is started again.
#[test]
fn a_network_that_is_started_anew() {
    let (mut xf, chip, _) = moving();
    let codes = Arc::new(Mutex::new(Vec::new()));
    let seen = Arc::clone(&codes);
    chip.behaves(move |_, packet| {
        // The command code of a packet.
        seen.lock().unwrap().push(packet[12]);
        Exchange::Passes
    });
    assert_eq!(xf.start_network(&NetworkConfig::default()).unwrap(), 2);
    let place = |code: CommandCode| codes.lock().unwrap().iter().position(|seen| *seen == code.code());
    let stop = place(CommandCode::HelperStateSet).expect("the axes are stopped");
    assert!(Some(stop) < place(CommandCode::FifoEnable) && Some(stop) < place(CommandCode::StateSet));
    let data = enabled(&mut xf).unwrap();
    drop(data);
    xf.close().unwrap();
    stands_and_is_off(&chip);
}

/// XF-17.9 A slave has one axis.
#[test]
fn a_slave_has_one_axis() {
    let (mut xf, _) = started("drive*2");
    let data = safe_op(&mut xf, 8).unwrap();
    assert_eq!(xf.add_axis(5, 1, &data), Err(XfError::SlaveHasAxis { slave: 1, motor: 1 }));
    xf.add_axis(1, 1, &data).unwrap();
}

/// XF-17.5 After calls that ended with an error of the wires the next one goes on, and the process data submitted
/// before are sent first.
#[test]
fn process_data_behind_those_that_the_wires_have_ended() {
    for exchanges in 0..3 {
        let (mut xf, chip, mut data) = moving();
        chip.cut_after(exchanges);
        // More calls than the driver takes process data for.
        let ended = (0..20).filter(|_| matches!(xf.read_inputs(&mut data), Err(XfError::Link(_)))).count();
        assert!(ended > 10, "{ended}");
        chip.behaves(|_, _| Exchange::Passes);
        for _ in 0..50 {
            xf.cycle(&mut data).unwrap();
        }
        xf.close().unwrap();
        stands_and_is_off(&chip);
    }
}
