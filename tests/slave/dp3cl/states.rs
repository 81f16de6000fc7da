//! The alarms of a DP3CL that come with a change of the AL state or end one, and how alarms are cleared.

use ecmsk::cia402::DriveState;
use ecmsk::coe::AbortCode;
use ecmsk::ethercat::AlState;
use ecmsk::ethercat::registers::RequestedState;
use ecmsk::slave::dp3cl::{Dp3cl, Dp3clAlarm, Dp3clConfig};
use ecmsk::slave::{AlStatus, AxisFault, Slave, SyncEvent};

use super::bench::{Bench, MS, read, usual};
use crate::wired::{alarm, force};

/// Checks that the drive has that alarm, with its AL status code, error code and error register, and is in that state.
fn has_alarm(drive: &mut Dp3cl, alarm: Dp3clAlarm, state: AlState, codes: (u16, i64, i64)) {
    let (status, error_code, register) = codes;
    assert_eq!((drive.alarm(), drive.state()), (Some(alarm), state));
    if status != 0 {
        assert_eq!(drive.al_status(), AlStatus(status));
    }
    for _ in 0..3 {
        drive.step(MS);
    }
    assert_eq!(drive.statusword().state(), Some(DriveState::Fault), "{alarm:?}");
    if state != AlState::Init {
        assert_eq!((read(drive, 0x603F, 0), read(drive, 0x1001, 0)), (Ok(error_code), Ok(register)), "{alarm:?}");
    }
}

/// DP3CL-5.2 E-800. DP3CL-5.1 The objects of an alarm.
#[test]
fn invalid_changes() {
    for (states, target) in [(&[][..], AlState::SafeOp), (&[], AlState::Op), (&[AlState::PreOp], AlState::Op)] {
        let mut drive = Dp3cl::default();
        drive.step(200 * MS);
        for state in states {
            drive.enter(*state).unwrap();
        }
        let was = drive.state();
        assert_eq!(drive.enter(target), Err(AlStatus(0x0011)));
        has_alarm(&mut drive, Dp3clAlarm::InvalidChange, was, (0x0011, 0xFF50, 0x10));
    }
}

/// DP3CL-5.2 All valid changes: IP, PI, PS, SP, SO, OS, SI, OP, OI, and to the same state; the others are E-800.
#[test]
fn changes() {
    use AlState::{Init, Op, PreOp, SafeOp};
    const STATES: [AlState; 4] = [Init, PreOp, SafeOp, Op];
    for from in STATES {
        for to in STATES {
            let mut drive = Dp3cl::default();
            drive.step(200 * MS);
            for state in STATES.into_iter().filter(|state| *state > Init && *state <= from) {
                drive.set_sync_managers(8, 19);
                drive.enter(state).unwrap();
            }
            drive.set_sync_managers(8, 19);
            let exists = to <= from || to == from.above();
            let answer = drive.enter(to);
            let expected = if exists { Ok(()) } else { Err(AlStatus(0x0011)) };
            assert_eq!((answer, drive.state()), (expected, if exists { to } else { from }), "{from:?} {to:?}");
            assert_eq!(drive.alarm(), (!exists).then_some(Dp3clAlarm::InvalidChange), "{from:?} {to:?}");
        }
    }
}

/// DP3CL-5.23 In Init no object is read, in PreOP objects are; inputs come in SafeOP and OP, and outputs are taken in OP alone.
#[test]
fn what_each_state_allows() {
    let mut drive = Dp3cl::default();
    drive.step(200 * MS);
    assert_eq!(read(&mut drive, 0x6041, 0), Err(AbortCode::TIMEOUT), "there is no mailbox");
    drive.enter(AlState::PreOp).unwrap();
    let status = read(&mut drive, 0x6041, 0).unwrap();
    drive.set_sync_managers(8, 19);
    let outputs = [0x06, 0, 1, 0, 0, 0, 0x11, 0];
    for (state, is_taken) in [(AlState::SafeOp, false), (AlState::Op, true)] {
        drive.enter(state).unwrap();
        let mut inputs = [0xEE; 19];
        drive.exchange(Some(&outputs), &mut inputs);
        assert_eq!(i64::from(u16::from_le_bytes([inputs[2], inputs[3]])), status, "{state:?}");
        for (index, value) in [(0x6040, 0x06), (0x607A, 1), (0x60B8, 0x11)] {
            assert_eq!(read(&mut drive, index, 0), Ok(if is_taken { value } else { 0 }), "{state:?} {index:04X}");
        }
    }
}

/// DP3CL-6.19 The bits of the statusword that do not depend on the mode, in each state on the way to Operation enabled
/// and in Fault.
#[test]
fn statuswords() {
    let mut bench = Bench::in_op(Dp3clConfig::default(), 3, MS);
    for (word, bits, name) in [
        (0x00, 0x0240, "Switch on disabled"),
        (0x06, 0x0221, "Ready to switch on"),
        (0x07, 0x0223, "Switched on"),
        (0x0F, 0x0227, "Operation enabled"),
        (0x02, 0x0240, "Switch on disabled"),
    ] {
        bench.word = word;
        bench.run_for(200 * MS);
        // Bit 4 shows whether the power stage has voltage, bit 5 is 1 except in a quick stop; bits 10, 12 and 13 are
        // those of the mode.
        let status = bench.status().0;
        let own = if bits & 0x40 != 0 { 0x4F } else { 0x6F };
        assert_eq!(status & (0xCB80 | own), bits, "{name}: {status:04X}");
        assert_eq!(status & 0x0010, 0x0010, "{name}: {status:04X}");
    }
    bench.write(0x605A, 0, 6);
    bench.enable();
    bench.word = 0x02;
    bench.run_for(50 * MS);
    assert_eq!(bench.status().0 & 0xCBEF, 0x0207, "Quick stop active");
    bench.drive.apply_fault(alarm(0x3220));
    bench.run_for(50 * MS);
    assert_eq!(bench.status().0 & 0xCBCF, 0x0208, "Fault");
}

/// DP3CL-6.19 Bits 9 to 15 of the controlword do nothing.
#[test]
fn reserved_bits_of_the_controlword() {
    for mode in [1, 3, 6, 8] {
        let mut benches = [Bench::enabled(mode), Bench::enabled(mode)];
        for (bench, reserved) in benches.iter_mut().zip([0, 0xFE00]) {
            bench.write(0x6081, 0, 5000);
            bench.write(0x60FF, 0, 300);
            for word in [0x0F, 0x1F, 0x0F, 0x07, 0x0F] {
                bench.word = word | reserved;
                bench.target += 50;
                bench.run_for(30 * MS);
            }
        }
        let [without, with] = benches.each_ref().map(|bench| (bench.status(), bench.shaft()));
        assert_eq!(without, with, "mode {mode}");
        assert!(mode == 6 || without.1 != 0, "mode {mode}: it has moved");
    }
}

/// DP3CL-5.3 E-801: Init, PreOP and SafeOP stay, OP falls to SafeOP.
/// DP3CL-5.4 E-802: always Init.
#[test]
fn states_that_do_not_exist() {
    let unknown = [0, 5, 6, 7, 9, 10, 11, 12, 13, 14, 15].map(|code| (code, Dp3clAlarm::UnknownState, 0x0012));
    for (code, alarm, status) in unknown.into_iter().chain([(3, Dp3clAlarm::Bootstrap, 0x0013)]) {
        for state in [AlState::Init, AlState::PreOp, AlState::SafeOp, AlState::Op] {
            let mut bench = Bench::in_op(Dp3clConfig::default(), 8, MS);
            bench.enter(state).unwrap();
            assert_eq!(bench.drive.request_state(RequestedState::from_code(code)), Err(AlStatus(status)));
            let after = if code == 3 { AlState::Init } else { state.min(AlState::SafeOp) };
            has_alarm(&mut bench.drive, alarm, after, (status, 0xFF50, 0x10));
        }
    }
    let mut drive = Dp3cl::default();
    assert_eq!((drive.request_state(RequestedState::from_code(2)), drive.state()), (Ok(()), AlState::PreOp));
}

/// DP3CL-5.5 E-803. DP3CL-5.7 E-806 and E-807. Only successive bad cycles count.
#[test]
fn synchronization() {
    let in_op = || {
        let mut drive = usual();
        drive.set_sync_managers(8, 19);
        drive.set_sync_cycle(Some(MS));
        drive.write(ecmsk::coe::ObjectAddress::new(0x1C32, 1), ecmsk::coe::SdoScope::Entry, &[2, 0]).unwrap();
        drive.step(200 * MS);
        for state in [AlState::SafeOp, AlState::Op] {
            drive.enter(state).unwrap();
        }
        drive
    };
    let mut drive = in_op();
    drive.report_sync(SyncEvent::NotLocked);
    has_alarm(&mut drive, Dp3clAlarm::NotSynchronized, AlState::PreOp, (0x002D, 0xFF50, 0x10));
    let mut drive = in_op();
    drive.report_sync(SyncEvent::LockLost);
    has_alarm(&mut drive, Dp3clAlarm::PhaseLost, AlState::SafeOp, (0x0032, 0xFF50, 0x10));
    let mut drive = in_op();
    for event in [SyncEvent::Deviation, SyncEvent::Deviation, SyncEvent::Deviation, SyncEvent::InTime] {
        drive.report_sync(event);
    }
    for _ in 0..3 {
        drive.report_sync(SyncEvent::Deviation);
    }
    assert_eq!(drive.alarm(), None);
    drive.report_sync(SyncEvent::Deviation);
    has_alarm(&mut drive, Dp3clAlarm::SyncDeviation, AlState::SafeOp, (0x002C, 0xFF50, 0x10));
    // 0x10F1:2 is their number.
    let mut drive = in_op();
    drive.write(ecmsk::coe::ObjectAddress::new(0x10F1, 2), ecmsk::coe::SdoScope::Entry, &[2, 0]).unwrap();
    drive.report_sync(SyncEvent::Deviation);
    assert_eq!(drive.alarm(), None);
    drive.report_sync(SyncEvent::Deviation);
    assert_eq!(drive.alarm(), Some(Dp3clAlarm::SyncDeviation));
    let mut free = Bench::in_op(Dp3clConfig::default(), 8, MS).drive;
    free.report_sync(SyncEvent::LockLost);
    assert_eq!((free.alarm(), free.state()), (None, AlState::Op), "it does not run by SYNC0");
}

/// DP3CL-5.6 E-804, by the device's own time and by the controller's.
#[test]
fn watchdog() {
    let mut bench = Bench::in_op(Dp3clConfig::default(), 8, MS);
    for _ in 0..99 {
        bench.drive.step(MS);
    }
    assert_eq!((bench.drive.alarm(), bench.drive.state()), (None, AlState::Op));
    bench.drive.step(2 * MS);
    has_alarm(&mut bench.drive, Dp3clAlarm::Watchdog, AlState::SafeOp, (0x001B, 0xFF50, 0x10));
    let mut bench = Bench::enabled(8);
    bench.drive.expire_watchdog();
    has_alarm(&mut bench.drive, Dp3clAlarm::Watchdog, AlState::SafeOp, (0x001B, 0xFF50, 0x10));
    let mut bench = Bench::in_op(Dp3clConfig::default(), 8, MS);
    bench.enter(AlState::SafeOp).unwrap();
    bench.drive.expire_watchdog();
    has_alarm(&mut bench.drive, Dp3clAlarm::Watchdog, AlState::SafeOp, (0x001B, 0xFF50, 0x10));
    let mut drive = usual();
    drive.expire_watchdog();
    assert_eq!((drive.alarm(), drive.state()), (None, AlState::PreOp));
}

/// DP3CL-5.14 E-881.
#[test]
fn modes() {
    for (mode, later) in [(0, None), (4, None), (9, None), (8, Some(10)), (1, Some(-1))] {
        let mut bench = Bench::in_op(Dp3clConfig::default(), mode, MS);
        bench.word = 0x06;
        bench.run_for(50 * MS);
        bench.word = 0x07;
        bench.run_for(50 * MS);
        assert_eq!(bench.drive.alarm(), None, "{mode}");
        bench.word = 0x0F;
        bench.run_for(50 * MS);
        if let Some(later) = later {
            assert_eq!(bench.drive.alarm(), None, "{mode}");
            bench.write(0x6060, 0, later);
            bench.run_for(2 * MS);
            assert_eq!(bench.read(0x6061, 0), mode, "the mode stays");
        }
        has_alarm(&mut bench.drive, Dp3clAlarm::Mode, AlState::Op, (0, 0xFF58, 0x80));
    }
}

/// DP3CL-5.14 Each mode that the drive does not have raises the alarm, including torque, cyclic velocity and
/// interpolation; its own modes do not.
#[test]
fn each_mode() {
    for mode in i8::MIN..=i8::MAX {
        let mut bench = Bench::in_op(Dp3clConfig::default(), mode.into(), MS);
        for word in [0x06, 0x07, 0x0F] {
            bench.word = word;
            bench.run_for(50 * MS);
        }
        let has_mode = matches!(mode, 1 | 3 | 6 | 8);
        assert_eq!(bench.drive.alarm(), (!has_mode).then_some(Dp3clAlarm::Mode), "{mode}");
    }
}

/// DP3CL-5.15 E-882: the change is made.
#[test]
fn changes_while_enabled() {
    for state in [AlState::SafeOp, AlState::PreOp, AlState::Init] {
        let mut bench = Bench::enabled(8);
        assert_eq!(bench.enter(state), Ok(()));
        has_alarm(&mut bench.drive, Dp3clAlarm::ChangeWhileEnabled, state, (0, 0xFF58, 0x80));
    }
    let mut bench = Bench::enabled(8);
    bench.write(0x605A, 0, 6);
    bench.word = 0x02;
    bench.run_for(50 * MS);
    assert_eq!(bench.state(), Some(DriveState::QuickStopActive));
    assert_eq!(bench.enter(AlState::SafeOp), Ok(()));
    has_alarm(&mut bench.drive, Dp3clAlarm::ChangeWhileEnabled, AlState::SafeOp, (0, 0xFF58, 0x80));
    let mut bench = Bench::in_op(Dp3clConfig::default(), 8, MS);
    assert_eq!((bench.enter(AlState::SafeOp), bench.drive.alarm()), (Ok(()), None), "it is not enabled");
}

/// ECAT-15.20 Alarms that share an error code are distinguished by their texts, which have the number of the manual.
#[test]
fn alarms_have_words() {
    for alarm in Dp3clAlarm::ALL {
        let number = alarm.meaning().split("E-").nth(1).map(|number| number.parse().expect("a number"));
        assert_eq!(number, (alarm.number() >= 800).then_some(alarm.number()), "{alarm:?}");
    }
    let shown = |bench: &Bench| bench.drive.fault(0).map(|AxisFault { code, meaning }| (code, meaning));
    let mut without_mode = Bench::in_op(Dp3clConfig::default(), 0, MS);
    assert_eq!(shown(&without_mode), None);
    for word in [0x06, 0x07, 0x0F] {
        without_mode.word = word;
        without_mode.run_for(50 * MS);
    }
    assert_eq!(shown(&without_mode), Some((0xFF58, Dp3clAlarm::Mode.meaning())));
    let mut changed = Bench::enabled(8);
    assert_eq!(changed.enter(AlState::SafeOp), Ok(()));
    assert_eq!(shown(&changed), Some((0xFF58, Dp3clAlarm::ChangeWhileEnabled.meaning())));
    assert_eq!(changed.drive.fault(1), None, "it has one axis");
    changed.drive.restart();
    assert_eq!(shown(&changed), None);
    assert!(changed.drive.apply_fault(alarm(0x7500)));
    assert_eq!(shown(&changed), Some((0x7500, "communication")), "not one of its own");
}

/// DP3CL-5.16 Three ways to clear an alarm, and alarms that need a restart.
#[test]
fn clearing() {
    let alarmed = |code| {
        let mut bench = Bench::in_op(Dp3clConfig::default(), 8, MS);
        assert!(bench.drive.apply_fault(alarm(code)));
        bench.run_for(2 * MS);
        assert_eq!((bench.state(), bench.read(0x603F, 0)), (Some(DriveState::Fault), code.into()));
        bench
    };
    let by_command = |bench: &mut Bench| bench.write(0x4000, 0, 1);
    let by_input = |bench: &mut Bench| {
        bench.drive.apply_fault(force(1));
    };
    let by_word = |bench: &mut Bench| bench.word = 0x80;
    let ways: [fn(&mut Bench); 3] = [by_command, by_input, by_word];
    for clear in ways {
        for (code, clears) in [(0xFF50, true), (0x3220, true), (0x2310, false), (0x3210, false), (0x7120, false)] {
            let mut bench = alarmed(code);
            bench.run_for(5 * MS);
            clear(&mut bench);
            bench.run_for(3 * MS);
            assert_eq!(bench.drive.alarm().is_none(), clears, "{code:04X}");
            assert_eq!(bench.state() == Some(DriveState::SwitchOnDisabled), clears, "{code:04X}");
            bench.drive.restart();
            assert_eq!(bench.drive.alarm(), None);
        }
    }
}
