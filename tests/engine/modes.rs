//! CSV and CST: velocities and torques, when they are accepted, and the process data before.

use ecmsk::cia402::Mode;
use ecmsk::coe::SdoSize;
use ecmsk::engine::{EngineConfig, Reason};
use ecmsk::fieldbus::sim::SimBus;
use ecmsk::sk::{DriveSync, Motion, RawSlot, SlaveCommand, SlotSize};

use crate::drives::{discarded, walk_up};
use crate::host::Host;
use crate::probe::{Bench, drives};
use crate::puppet::{DISABLED, ENABLED, FAULT, Puppet, READY, SWITCHED_ON};

const MODES: [Mode; 3] = [Mode::Csp, Mode::Csv, Mode::Cst];

fn motion(mode: Mode, target: i16) -> SlaveCommand {
    match mode {
        Mode::Csp => SlaveCommand::Csp(Motion::to(target.into())),
        Mode::Csv => SlaveCommand::Csv(Motion::to(target.into())),
        _ => SlaveCommand::Cst(target),
    }
}

fn drive_mode(host: &mut Host, mode: Mode) {
    host.slave(1, SlaveCommand::DriveMode { mode, sync: DriveSync::DcSync });
}

/// A board in OP with one puppet drive in that mode, at 1000 counts, Switch on disabled.
fn board(mode: Mode) -> (Host, Puppet) {
    let puppet = Puppet::new();
    puppet.stand(1000);
    puppet.strings().objects.insert((0x6060, 0), (1, 8));
    let mut host = Host::new(EngineConfig::default(), SimBus::new(vec![puppet.boxed()]));
    drive_mode(&mut host, mode);
    host.op(1).cycles(3);
    puppet.forget();
    (host, puppet)
}

fn rejected(host: &Host) -> u64 {
    host.counters().rejected[Reason::WrongMode.kind()]
}

/// SK-7.33 CSV and CST are accepted only in the mode that DRIVE_MODE chose. SK-7.31 So is CSP.
#[test]
fn a_motion_command_needs_its_drive_mode() {
    for mode in MODES {
        for wanted in MODES {
            let (mut host, puppet) = board(mode);
            walk_up(&mut host, &puppet);
            let still = if mode == Mode::Csp { 1000 } else { 0 };
            host.slave(1, motion(wanted, 77)).drained();
            let accepted = mode == wanted;
            assert_eq!(rejected(&host), u64::from(!accepted), "{wanted} in {mode}");
            assert_eq!(puppet.last().target, if accepted { 77 } else { still }, "{wanted} in {mode}");
            let id = motion(wanted, 0).id().code();
            assert_eq!(host.drive(1).head.id, if accepted { id } else { 0 }, "{wanted} in {mode}");
            assert_eq!(discarded(&host), 0, "{wanted} in {mode}");
        }
    }
}

/// SK-7.33 CSV and CST are accepted only while 0x6060 was last written 9 or 10, by the board or by an SDO of the host.
/// SK-7.17 Until the mode is back and a motion command has come, the target is 0.
#[test]
fn a_motion_command_needs_its_mode_in_0x6060() {
    for mode in [Mode::Csv, Mode::Cst] {
        let (mut host, puppet) = board(mode);
        walk_up(&mut host, &puppet);
        host.slave(1, motion(mode, 500)).drained();
        for code in [6, 8, 9, 10, 0].into_iter().filter(|code| *code != u32::from(mode.code())) {
            let before = rejected(&host);
            assert_eq!(host.write_object(1, 0x6060, 0, SdoSize::One, code), Ok(code));
            host.slave(1, motion(mode, 700)).drained().cycles(3);
            assert_eq!((rejected(&host), puppet.last().target), (before + 1, 0), "{mode}, 0x6060 = {code}");
            let own = u32::from(mode.code());
            assert_eq!(host.write_object(1, 0x6060, 0, SdoSize::One, own), Ok(own));
            host.cycles(50);
            assert_eq!(puppet.last().target, 0, "{mode}");
            host.slave(1, motion(mode, -600)).drained();
            assert_eq!((rejected(&host), puppet.last().target), (before + 1, -600), "{mode}");
        }
    }
}

/// SK-7.17 While the drive is not in Operation enabled 0x60FF and 0x6071 are 0, wherever its shaft is, and they stay 0
/// until the first motion command. SK-7.18 Targets that come before are discarded and counted.
#[test]
fn velocity_and_torque_are_0_until_the_first_motion_command() {
    for mode in [Mode::Csv, Mode::Cst] {
        let (mut host, puppet) = board(mode);
        let mut count = 0;
        for shown in [DISABLED, READY, SWITCHED_ON] {
            if shown != DISABLED {
                host.slave(1, SlaveCommand::ServoOn).drained();
            }
            puppet.show(shown);
            host.cycles(3);
            for n in 0..20 {
                puppet.stand(n * 1000);
                host.slave(1, motion(mode, 300)).drained();
                count += 1;
                assert_eq!(discarded(&host), count, "{mode} {shown:04x}");
            }
        }
        puppet.show(ENABLED);
        for n in 0..200 {
            puppet.stand(-n);
            host.idle().cycle();
        }
        assert_eq!(puppet.targets(), [0], "{mode}");
        host.slave(1, motion(mode, -250)).drained().cycles(50);
        assert_eq!((puppet.targets(), discarded(&host)), (vec![0, -250], count), "{mode}");

        // An old target is not used again.
        puppet.show(FAULT);
        host.cycles(3);
        puppet.show(DISABLED);
        host.cycles(3);
        walk_up(&mut host, &puppet);
        host.cycles(50);
        assert_eq!(puppet.targets(), [0], "{mode}");
        assert_eq!(host.counters().rejected_total(), 0);
    }
}

/// SK-4.26 CSV: Data1 is the target velocity, with its sign; Data2 is ignored by a plain drive.
/// SK-4.27 CST: the low 16 bits of Data1 are the target torque, with their sign.
#[test]
fn data1_is_the_target() {
    for size in SlotSize::ALL {
        for (mode, id, words) in [
            (Mode::Csv, 0x16, [(1, 1), (u32::MAX, -1), (0x8000_0000, i32::MIN), (0x7FFF_FFFF, i32::MAX), (0, 0)]),
            (Mode::Cst, 0x17, [(1, 1), (0xFFFF, -1), (0xABCD_8000, -32768), (0x8000_7FFF, 32767), (0, 0)]),
        ] {
            let puppet = Puppet::obedient();
            let config = EngineConfig { slot: size, ..EngineConfig::default() };
            let mut host = Host::new(config, SimBus::new(vec![puppet.boxed()]));
            drive_mode(&mut host, mode);
            host.op(1).servo_on(1);
            for (data1, target) in words {
                let slot = RawSlot { id, index: 7, data1, data2: 0xDEAD_BEEF, parm: 0xFFFF, ..RawSlot::ZERO };
                host.raw(1, slot).drained();
                assert_eq!(puppet.last().target, target, "{size:?} {mode} {data1:08X}");
                assert_eq!(puppet.last().outputs, 0, "{size:?} {mode}");
                let head = host.drive(1).head;
                assert_eq!((head.id, head.index), (id, 7), "{size:?} {mode}");
            }
        }
    }
}

/// SK-5.5 An empty FIFO repeats the last process data: a velocity keeps running, and frames that ask for nothing do not
/// stop it. SK-4.26 The target is a velocity: the shaft moves equally far in every second.
#[test]
fn a_velocity_keeps_running() {
    for velocity in [20_000, -150_000] {
        let Bench { mut host, network, .. } = Bench::new(EngineConfig::default(), drives(1));
        drive_mode(&mut host, Mode::Csv);
        host.op(1).servo_on(1).slave(1, SlaveCommand::Csv(Motion::to(velocity))).drained().cycles(500);
        let executed = host.counters().executed;
        for silent in [true, true, false] {
            let before = network.shaft(1, 0).unwrap();
            for _ in 0..1000 {
                if !silent {
                    host.idle();
                }
                host.cycle();
            }
            let way = network.shaft(1, 0).unwrap() - before;
            let error = way - i64::from(velocity);
            assert!(error.abs() <= i64::from(velocity.abs() / 100), "{way} counts in a second at {velocity}");
        }
        assert_eq!(host.counters().executed, executed + 1000);
        host.slave(1, SlaveCommand::Csv(Motion::to(0))).drained().cycles(500);
        let stopped = network.shaft(1, 0);
        host.cycles(1000);
        assert_eq!(network.shaft(1, 0), stopped, "a velocity of 0 stops it");
    }
}

/// SK-4.27 CST is in 0.1 % of the rated torque: the answer's actual torque reaches it, and the shaft moves. SK-5.5 An
/// empty FIFO repeats it.
#[test]
fn a_torque_is_reached_and_kept() {
    for torque in [200, -350] {
        let Bench { mut host, network, .. } = Bench::new(EngineConfig::default(), drives(1));
        drive_mode(&mut host, Mode::Cst);
        host.op(1).servo_on(1).slave(1, SlaveCommand::Cst(torque)).drained().cycles(30);
        for _ in 0..5 {
            let before = network.shaft(1, 0).unwrap();
            host.cycles(5);
            let way = network.shaft(1, 0).unwrap() - before;
            assert_eq!((host.drive(1).torque, way.signum()), (torque, i64::from(torque.signum())));
        }
        assert_eq!(host.drive(1).head.id, 0x17);
    }
}

/// SK-7.16 SK-7.17 No shaft moves by being switched on, in any mode.
#[test]
fn no_shaft_moves_by_being_switched_on() {
    for mode in MODES {
        let Bench { mut host, network, .. } = Bench::new(EngineConfig::default(), drives(1));
        drive_mode(&mut host, mode);
        host.op(1).slave(1, motion(mode, 900)).drained().servo_on(1).cycles(1000);
        assert_eq!(network.shaft(1, 0), Some(0), "{mode}");
        host.slave(1, SlaveCommand::ServoOff).cycles(300);
        assert_eq!((network.shaft(1, 0), discarded(&host)), (Some(0), 1), "{mode}");
    }
}
