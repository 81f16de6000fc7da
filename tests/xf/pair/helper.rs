//! The CiA 402 helper with a drive.

use ecmsk::cia402::DriveState;
use ecmsk::slave::{DeviceFault, Fault};
use ecmsk::xf::EtherCatState;
use ecmsk::xf::chip::Profile;
use ecmsk::xf::host::{HostConfig, ProcessOutcome, ProcessRequest};
use ecmsk::xf::request::{
    FifoEnable, HelperConfigSet, HelperControl, HelperControlGet, HelperControlSet, HelperStateGet, HelperStateSet,
    HelperStatuswordGet,
};

use super::{MS, Pair, drive};
use crate::{motor, slave};

/// In OP, the drives in CSP, the FIFO on. Motor 5 is slave 1.
fn configured(control: HelperControl) -> Pair {
    let mut pair = Pair::running();
    pair.bring_to(EtherCatState::PreOp);
    pair.write(1, 0x6060, 0, &[8]);
    pair.bring_to(EtherCatState::Op);
    pair.run(&FifoEnable { on: true });
    pair.run(&HelperConfigSet {
        motor: motor(5),
        controlword_offset: 0,
        statusword_offset: 0,
        control,
        slave: slave(1),
    });
    pair
}

/// The drive's own state, 0x6041.
fn real_state(pair: &mut Pair) -> Option<DriveState> {
    ecmsk::cia402::Statusword(pair.object(1, 0x6041, 0) as u16).state()
}

fn lead_to(pair: &mut Pair, state: DriveState) {
    pair.run(&HelperStateSet { motor: motor(5), state });
    pair.pass(500 * MS);
}

/// An RxPDO with a controlword and a target for slave 1.
fn outputs(controlword: u16, target: i32) -> [u8; 14] {
    let mut pdo = [0; 14];
    pdo[6..8].copy_from_slice(&controlword.to_le_bytes());
    pdo[8..12].copy_from_slice(&target.to_le_bytes());
    pdo
}

/// XF-13.1 XF-11.42 402_CONFIG_SET (XF EN 750) and 402_STATE_SET (XF EN 767) bring a drive to Operation enabled, where
/// it moves by process data; 402_STATE_GET (XF EN 778) and 402_GET_STATUSWORD (XF EN 1432) return the drive's state.
#[test]
pub fn a_drive_is_led() {
    use DriveState::{OperationEnabled, QuickStopActive, ReadyToSwitchOn, SwitchOnDisabled, SwitchedOn};
    let mut pair = configured(HelperControl::ON);
    pair.pass(500 * MS);
    assert_eq!(real_state(&mut pair), Some(SwitchOnDisabled));
    lead_to(&mut pair, OperationEnabled);
    assert_eq!(real_state(&mut pair), Some(OperationEnabled));
    let shaft = |pair: &mut Pair| pair.chip().network().slave(1).and_then(|slave| slave.shaft(0)).expect("an axis");
    let from = shaft(&mut pair);
    for n in 1..=100 {
        let written = ProcessRequest::Exchange { count: 1, outputs: &outputs(0, n * 50) };
        assert!(matches!(pair.process(written), ProcessOutcome::Done { .. }));
    }
    pair.pass(300 * MS);
    assert!((shaft(&mut pair) - from - 5000).abs() < 10, "{}", shaft(&mut pair));
    for target in [SwitchedOn, ReadyToSwitchOn, SwitchedOn, OperationEnabled, SwitchOnDisabled, OperationEnabled] {
        lead_to(&mut pair, target);
        assert_eq!(real_state(&mut pair), Some(target));
        assert_eq!(pair.get(&HelperStateGet { motor: motor(5) }, |state| state.state()), Some(target));
        let word = pair.get(&HelperStatuswordGet { motor: motor(5) }, |word| word.0);
        assert_eq!(u32::from(word), pair.object(1, 0x6041, 0));
    }
    pair.run(&HelperStateSet { motor: motor(5), state: QuickStopActive });
    pair.pass(20 * MS);
    assert!(matches!(real_state(&mut pair), Some(QuickStopActive | SwitchOnDisabled)));
}

/// XF-11.43 The helper overwrites bits 0 to 3 of the controlword, and bit 7 only if a fault reset is chosen; without ON
/// it overwrites nothing.
#[test]
fn bits_that_are_overwritten() {
    let resets = HelperControl::ON | HelperControl::RESET_ALWAYS;
    for (control, sent, word) in
        [(HelperControl::NONE, 0x0186, 0x0186), (HelperControl::ON, 0x018F, 0x0180), (resets, 0x018F, 0x0100)]
    {
        let mut pair = configured(control);
        pair.process(ProcessRequest::DirectExchange { outputs: &outputs(sent, 0) });
        pair.pass(5 * MS);
        assert_eq!(pair.object(1, 0x6040, 0), word, "{control:?}");
    }
}

/// XF-11.44 A fault is reset whenever there is one, or once, or not at all; then the drive is brought up again.
#[test]
fn fault_resets() {
    let fault = Fault::Alarm { axis: 0, fault: DeviceFault { code: 0x2310, resettable: true } };
    for (reset, is_reset) in [
        (HelperControl::NONE, [false, false]),
        (HelperControl::RESET_ONCE, [true, false]),
        (HelperControl::RESET_ALWAYS, [true, true]),
    ] {
        let mut pair = configured(HelperControl::ON | reset);
        lead_to(&mut pair, DriveState::OperationEnabled);
        for is_reset in is_reset {
            assert!(pair.device(1).apply_fault(fault));
            pair.pass(1000 * MS);
            let state = if is_reset { DriveState::OperationEnabled } else { DriveState::Fault };
            assert_eq!(real_state(&mut pair), Some(state), "{reset:?}");
        }
    }
}

/// XF-11.72 Firmware before 0x22 takes its defaults where 402_CTL_SET comes without 402_CONFIG_SET, as the vendor's
/// driver 0.1 sends it: both words are first in the slave's PDOs. Then the drive is controlled.
///
/// Row: 402_CTL_SET without 402_CONFIG_SET.
#[test]
fn defaults_of_old_firmware() {
    let mut pair = Pair::running_with(Profile::OLD, HostConfig::DEFAULT, vec![drive(), drive()]);
    pair.bring_to(EtherCatState::Op);
    pair.run(&HelperControlSet { motor: motor(5), control: HelperControl::ON, motors: 2, slave: slave(1) });
    lead_to(&mut pair, DriveState::OperationEnabled);
    assert_eq!(real_state(&mut pair), Some(DriveState::OperationEnabled));
}

/// XF-13.1 XF-11.45 402_CTL_SET (XF EN 795) changes the control byte, and 402_CTL_GET (XF EN 813) returns it: without
/// bit 4 the controlword is the host's.
#[test]
pub fn control_byte() {
    let mut pair = configured(HelperControl::ON);
    let get = HelperControlGet { motor: motor(5) };
    assert_eq!(pair.get(&get, |control| control), HelperControl::ON);
    let set = |control| HelperControlSet { motor: motor(5), control, motors: 1, slave: slave(1) };
    pair.process(ProcessRequest::DirectExchange { outputs: &outputs(0x0106, 0) });
    pair.pass(5 * MS);
    assert_eq!(pair.object(1, 0x6040, 0), 0x0100, "bits 0 to 3 are the helper's");
    pair.run(&set(HelperControl::RESET_ALWAYS));
    assert_eq!(pair.get(&get, |control| control), HelperControl::RESET_ALWAYS);
    pair.pass(5 * MS);
    assert_eq!(pair.object(1, 0x6040, 0), 0x0106);
}

/// XF-13.1 XF-11.45 [OURS] Commands for a motor that 402_CONFIG_SET has not set end with the chip's refusal.
///
/// Row: 402_CTL_SET without 402_CONFIG_SET.
#[test]
fn motors_that_are_not_configured() {
    let mut pair = Pair::in_state(EtherCatState::PreOp);
    pair.is_refused(&HelperStateGet { motor: motor(5) });
    pair.is_refused(&HelperStateSet { motor: motor(5), state: DriveState::OperationEnabled });
    pair.is_refused(&HelperControlGet { motor: motor(5) });
    pair.is_refused(&HelperControlSet { motor: motor(5), control: HelperControl::ON, motors: 1, slave: slave(1) });
    pair.is_refused(&HelperStatuswordGet { motor: motor(5) });
}
