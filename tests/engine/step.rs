//! STEP slaves: drives with CSP only.

use ecmsk::cia402::Mode;
use ecmsk::coe::SdoSize;
use ecmsk::engine::{EngineConfig, Reason};
use ecmsk::fieldbus::AxisIn;
use ecmsk::fieldbus::sim::SimBus;
use ecmsk::sk::{
    DriveResponse, DriveSync, MasterCommand, MasterState, Motion, RawSlot, SlaveCommand, SlaveKind, SlotSize,
};
use ecmsk::slave::{DeviceFault, Drive, DriveConfig, Fault};

use crate::drives::{discarded, walk_up};
use crate::host::Host;
use crate::probe::Bench;
use crate::puppet::{DISABLED, FAULT, Puppet};

fn config(slot: SlotSize) -> EngineConfig {
    EngineConfig { slot, ..EngineConfig::default() }
}

fn declare(host: &mut Host) -> &mut Host {
    let mut kinds = [SlaveKind::None; 8];
    kinds[0] = SlaveKind::Step;
    host.master(MasterCommand::SetAxis { group: 0, kinds })
}

/// A board in OP with a puppet stepper, at 1000 counts.
fn board(slot: SlotSize) -> (Host, Puppet) {
    let puppet = Puppet::new();
    puppet.stand(1000);
    puppet.strings().objects.insert((0x6060, 0), (1, 8));
    let mut host = Host::new(config(slot), SimBus::new(vec![puppet.boxed()]));
    declare(&mut host).go(MasterState::Op).cycles(3);
    puppet.forget();
    (host, puppet)
}

fn mode(mode: Mode) -> SlaveCommand {
    SlaveCommand::DriveMode { mode, sync: DriveSync::DcSync }
}

/// SK-3.20 SV_ON walks a stepper up step by step, and SV_OFF down. SK-3.19 Its slot is a drive's: statusword, position,
/// torque, error code.
#[test]
fn it_is_switched_as_a_drive() {
    for size in SlotSize::ALL {
        let (mut host, puppet) = board(size);
        walk_up(&mut host, &puppet);
        let shows = puppet.strings().shows;
        puppet.strings().shows = AxisIn { torque: -77, error_code: 0x7305, inputs: 9, ..shows };
        host.slave(1, SlaveCommand::Csp(Motion::to(1001))).drained().cycles(3);
        assert_eq!(puppet.last().controlword.0, 0x0F, "{size:?}");
        let DriveResponse { head, statusword, position, torque, error_code } = host.drive(1);
        assert!(statusword.is_enabled());
        assert_eq!((head.id, position, torque, error_code), (0x15, 1000, -77, 0x7305), "{size:?}");
        assert_eq!(host.slot(1).data3, 0);
        host.slave(1, SlaveCommand::ServoOff).cycles(3);
        assert_eq!(puppet.last().controlword.0, 0x07, "{size:?}");
        puppet.show(FAULT);
        host.cycles(3).slave(1, SlaveCommand::AlarmClear).cycles(2);
        assert_eq!(puppet.last().controlword.0 & 0x80, 0x80, "{size:?}");
        assert_eq!(host.counters().rejected_total(), 0);
    }
}

/// SK-3.20 CSP is its motion command; targets before Operation enabled are discarded and counted (SK-7.18), and until
/// then it holds its position (SK-7.16). Data2 is ignored (SK-4.25).
#[test]
fn it_follows_positions() {
    for size in SlotSize::ALL {
        let (mut host, puppet) = board(size);
        host.slave(1, SlaveCommand::Csp(Motion::to(5))).drained();
        assert_eq!((puppet.last().target, discarded(&host)), (1000, 1), "{size:?}");
        walk_up(&mut host, &puppet);
        let words = RawSlot { id: 0x15, data1: -5i32 as u32, data2: u32::MAX, data3: u32::MAX, ..RawSlot::ZERO };
        host.raw(1, words).drained();
        assert_eq!((puppet.last().target, puppet.last().outputs, discarded(&host)), (-5, 0, 1), "{size:?}");
        puppet.show(DISABLED);
        puppet.stand(2000);
        host.cycles(3);
        assert_eq!(puppet.last().target, 2000, "{size:?}: it fell, and is held where it is");
    }
}

/// SK-4.26 SK-4.27 CSV and CST are no commands for a stepper.
/// SK-7.32 CSP needs 0x6060 = 8.
#[test]
fn csp_is_its_only_motion_command() {
    let (mut host, puppet) = board(SlotSize::Bytes12);
    walk_up(&mut host, &puppet);
    let mark = host.mark();
    host.slave(1, SlaveCommand::Csv(Motion::to(3))).slave(1, SlaveCommand::Cst(3)).drained().cycles(3);
    let reasons: Vec<Reason> = host.rejections(mark).into_iter().map(|(.., reason)| reason).collect();
    assert_eq!(reasons, [Reason::WrongSlot; 2]);
    assert_eq!((puppet.last().target, host.slot(1).id), (1000, 0));

    host.write_object(1, 0x6060, 0, SdoSize::One, 6).unwrap();
    let mark = host.mark();
    host.slave(1, SlaveCommand::Csp(Motion::to(3))).drained().cycles(3);
    assert_eq!(host.rejections(mark)[0].2, Reason::WrongMode);
    assert_eq!(puppet.last().target, 1000);
}

/// SK-7.36 DRIVE_MODE other than 8 for a STEP fails PreOP to SafeOP, whatever the slave would take.
#[test]
fn no_other_drive_mode() {
    for slave in [Puppet::new().boxed(), Box::new(Drive::new(DriveConfig::stepper()))] {
        let Bench { mut host, .. } = Bench::new(EngineConfig::default(), vec![slave]);
        declare(&mut host);
        for (bad, target) in [(Mode::Csv, MasterState::SafeOp), (Mode::Cst, MasterState::Op)] {
            host.slave(1, mode(bad)).master(MasterCommand::SetState(target));
            host.until("the failure", |host| host.state().0 == 0x12).cycles(500);
            assert_eq!(host.state().0, 0x12, "{bad}: without retries");
            host.slave(1, mode(Mode::Csp)).go(MasterState::Op).go(MasterState::PreOp);
        }
    }
}

/// SK-3.20 A simulated stepper follows CSP, and its alarm is shown and cleared.
#[test]
fn a_stepper_moves() {
    for size in SlotSize::ALL {
        let stepper = Box::new(Drive::new(DriveConfig::stepper()));
        let Bench { mut host, network, .. } = Bench::new(config(size), vec![stepper]);
        declare(&mut host).go(MasterState::Op).drained().servo_on(1);
        for n in 1..=1000 {
            host.csp(1, n * 20).cycle();
        }
        host.drained().cycles(200);
        let at = network.shaft(1, 0).unwrap();
        assert!((at - 20_000).abs() <= 10, "{at}");
        assert_eq!(i64::from(host.drive(1).position), at);
        network.apply_fault(1, Fault::Alarm { axis: 0, fault: DeviceFault { code: 0x7500, resettable: true } });
        host.until("the alarm", |host| host.drive(1).error_code == 0x7500).cycles(50);
        host.slave(1, SlaveCommand::AlarmClear).until("no alarm", |host| host.drive(1).error_code == 0);
        host.cycles(20).servo_on(1);
    }
}
