//! The CiA 402 helper leads drives.

use ecmsk::cia402::DriveState;
use ecmsk::slave::{DeviceFault, Fault};
use ecmsk::xf::chip::Profile;
use ecmsk::xf::request::{
    HelperConfigSet, HelperControl, HelperControlGet, HelperControlSet, HelperStateGet, HelperStateSet,
    HelperStatuswordGet, PdoData, PdoOperation,
};
use ecmsk::xf::{Errors, EtherCatState};

use super::{Host, MS};
use crate::{motor, slave};

/// Both words stand at the beginning of the drives' process data. Motor 5 is slave 1.
fn configure(host: &mut Host, control: HelperControl) {
    host.run(&HelperConfigSet {
        motor: motor(5),
        controlword_offset: 0,
        statusword_offset: 0,
        control,
        slave: slave(1),
    });
}

fn state(host: &mut Host) -> Option<DriveState> {
    let request = HelperStateGet { motor: motor(5) };
    host.call(&request).to(&request).state()
}

fn lead_to(host: &mut Host, state: DriveState) {
    host.run(&HelperStateSet { motor: motor(5), state });
    host.pass(500 * MS);
}

/// What slave 1 gets: its controlword, as the drive has it in 0x6040.
fn controlword(host: &mut Host) -> u16 {
    let drive = host.chip.network_mut().slave_mut(1).expect("slave 1");
    drive.upload(ecmsk::coe::ObjectAddress::new(0x6040, 0)).expect("0x6040").bits as u16
}

/// The host's own controlword for slave 1.
fn write_controlword(host: &mut Host, word: u16) {
    let mut outputs = [0; 14];
    outputs[6..8].copy_from_slice(&word.to_le_bytes());
    host.run(&PdoData { operation: PdoOperation::VALID | PdoOperation::WRITE, data: &outputs });
    host.pass(5 * MS);
}

/// XF-11.42 402_STATE_SET leads a drive up and down; 402_STATE_GET and 402_GET_STATUSWORD tell where it is.
#[test]
fn states() {
    use DriveState::{OperationEnabled, QuickStopActive, ReadyToSwitchOn, SwitchOnDisabled, SwitchedOn};
    let mut host = Host::in_state(EtherCatState::Op);
    configure(&mut host, HelperControl::ON);
    host.pass(500 * MS);
    assert_eq!(state(&mut host), Some(SwitchOnDisabled));
    for target in [OperationEnabled, SwitchedOn, ReadyToSwitchOn, SwitchedOn, OperationEnabled, SwitchOnDisabled] {
        lead_to(&mut host, target);
        assert_eq!(state(&mut host), Some(target));
    }
    lead_to(&mut host, OperationEnabled);
    let word = HelperStatuswordGet { motor: motor(5) };
    assert_eq!(host.call(&word).to(&word).0 & 0x6F, 0x27);
    host.run(&HelperStateSet { motor: motor(5), state: QuickStopActive });
    host.pass(20 * MS);
    assert!(matches!(state(&mut host), Some(QuickStopActive | SwitchOnDisabled)));
    lead_to(&mut host, OperationEnabled);
    assert_eq!(state(&mut host), Some(OperationEnabled));
}

/// XF-11.43 The helper overwrites bits 0 to 3 of the controlword, and bit 7 only if a fault reset is chosen; without ON
/// it overwrites nothing.
#[test]
fn bits_that_are_overwritten() {
    let mut host = Host::in_state(EtherCatState::Op);
    configure(&mut host, HelperControl::NONE);
    write_controlword(&mut host, 0x0186);
    assert_eq!(controlword(&mut host), 0x0186);
    configure(&mut host, HelperControl::ON);
    write_controlword(&mut host, 0x018F);
    assert_eq!(controlword(&mut host), 0x0180);
    configure(&mut host, HelperControl::ON | HelperControl::RESET_ALWAYS);
    write_controlword(&mut host, 0x018F);
    assert_eq!(controlword(&mut host), 0x0100);
}

/// XF-11.44 A fault is reset whenever there is one, or once, or not at all; then the drive is led on.
#[test]
fn fault_resets() {
    use DriveState::{Fault as InFault, OperationEnabled};
    let fault = Fault::Alarm { axis: 0, fault: DeviceFault { code: 0x2310, resettable: true } };
    let cases = [(HelperControl::NONE, [false, false]), (HelperControl::RESET_ONCE, [true, false])];
    for (reset, is_reset) in cases.into_iter().chain([(HelperControl::RESET_ALWAYS, [true, true])]) {
        let mut host = Host::in_state(EtherCatState::Op);
        configure(&mut host, HelperControl::ON | reset);
        lead_to(&mut host, OperationEnabled);
        for is_reset in is_reset {
            assert!(host.chip.network_mut().slave_mut(1).expect("slave 1").apply_fault(fault));
            host.pass(1000 * MS);
            assert_eq!(state(&mut host), Some(if is_reset { OperationEnabled } else { InFault }), "{reset:?}");
        }
    }
}

/// XF-11.72 Firmware before 0x22 takes its defaults where 402_CTL_SET comes without 402_CONFIG_SET, as the vendor's driver 0.1 sends
/// it: both words stand first in the slave's PDOs. The drive is led then.
#[test]
fn defaults_of_old_firmware() {
    let mut host = Host::new(Profile::OLD, vec![super::drive(), super::drive()]);
    host.bring_to(EtherCatState::Op);
    let set = HelperControlSet { motor: motor(5), control: HelperControl::ON, motors: 2, slave: slave(1) };
    host.run(&set);
    lead_to(&mut host, DriveState::OperationEnabled);
    assert_eq!(state(&mut host), Some(DriveState::OperationEnabled));
}

/// XF-11.45 402_CTL_SET changes the control byte of an axis, 402_CTL_GET tells it; an axis that is not configured is a
/// command error with any of the commands.
#[test]
fn control_byte() {
    let mut host = Host::in_state(EtherCatState::Op);
    configure(&mut host, HelperControl::ON);
    lead_to(&mut host, DriveState::OperationEnabled);
    let set = |n, control| HelperControlSet { motor: motor(n), control, motors: 1, slave: slave(1) };
    host.run(&set(5, HelperControl::RESET_ALWAYS));
    let get = HelperControlGet { motor: motor(5) };
    assert_eq!(host.call(&get).to(&get), HelperControl::RESET_ALWAYS);
    host.pass(100 * MS);
    assert_ne!(state(&mut host), Some(DriveState::OperationEnabled), "the host's controlword is 0");

    let fails = |host: &mut Host, request: &dyn Fn(&mut Host) -> Errors| {
        assert_eq!(request(host), Errors::COMMAND);
        *host = Host::in_state(EtherCatState::PreOp);
    };
    let mut host = Host::in_state(EtherCatState::PreOp);
    fails(&mut host, &|host| host.call(&HelperStateGet { motor: motor(5) }).errors());
    let enabled = HelperStateSet { motor: motor(5), state: DriveState::OperationEnabled };
    fails(&mut host, &|host| host.call(&enabled).errors());
    fails(&mut host, &|host| host.call(&set(5, HelperControl::ON)).errors());
    fails(&mut host, &|host| host.call(&HelperControlGet { motor: motor(5) }).errors());
    fails(&mut host, &|host| host.call(&HelperStatuswordGet { motor: motor(5) }).errors());
}
