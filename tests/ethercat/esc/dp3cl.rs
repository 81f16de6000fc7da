//! A DP3CL as the network sees it: its controller, its mailbox, and the alarms that only a controller can cause.

use ecmsk::ethercat::registers::{self, SmControl, SyncManager};
use ecmsk::ethercat::{AlState, AlStatus, Command};
use ecmsk::slave::esc::EscSlave;
use ecmsk::slave::{Dp3cl, Dp3clConfig, Slave};

use super::rig::{FIRST, INPUTS, MS, OUTPUTS, Rig};

/// A DP3CL behind its own controller, in Init.
fn rig() -> Rig {
    let device = Box::new(Dp3cl::new(Dp3clConfig::default()));
    let settings = device.controller_settings();
    let mut rig = Rig::new([EscSlave::describe(device, settings, 0).expect("it can be described")]);
    rig.give_stations();
    rig
}

/// One in PreOP, with its process data and SYNC0 of 1 ms that begins that much later.
fn with_sync0(begins_ms: i64, activation: u8) -> Rig {
    let mut rig = rig();
    rig.bring_to_preop(FIRST);
    rig.set_process_data(FIRST, 0);
    let start = rig.read_u64(FIRST, registers::SYSTEM_TIME).wrapping_add_signed(begins_ms * MS as i64);
    rig.write(FIRST, registers::SYNC0_START, &start.to_le_bytes());
    rig.write(FIRST, registers::SYNC0_CYCLE, &1_000_000_u32.to_le_bytes());
    rig.write(FIRST, registers::SYNC_ACTIVATION, &[activation]);
    rig
}

/// DP3CL-1.11 Its controller reads as the manual prints.
#[test]
fn registers_of_the_manual() {
    let mut rig = rig();
    for (address, value) in [
        (0x0000, &[0x04, 0x02, 0x40, 0x00, 0x03, 0x04, 0x08, 0x0F, 0x84, 0x01][..]),
        (0x0140, &[0x08, 0x0C]),
        (0x0151, &[0x66]),
    ] {
        assert_eq!(rig.read(FIRST, address, value.len()), value, "0x{address:04X}");
    }
    // 3 FMMUs and 4 sync managers, and no more.
    assert_eq!(rig.one(Command::Fprd, FIRST, registers::fmmu(3), &[0]).wkc, 0);
    assert_eq!(rig.one(Command::Fprd, FIRST, registers::sync_manager(4), &[0]).wkc, 0);
}

/// DP3CL-5.9 The shortest mailboxes that the manual allows, 32 and 40 bytes, work; shorter ones are E-811.
#[test]
fn the_shortest_mailboxes() {
    for (out, back, answer) in [
        (32, 40, (0x02, AlStatus::NONE)),
        (31, 40, (0x11, AlStatus::INVALID_MAILBOX)),
        (32, 39, (0x11, AlStatus::INVALID_MAILBOX)),
    ] {
        let mut rig = rig();
        rig.set_manager(FIRST, 0, SyncManager::enabled(0x1000, out, SmControl::MAILBOX_OUT));
        rig.set_manager(FIRST, 1, SyncManager::enabled(0x1080, back, SmControl::MAILBOX_IN));
        assert_eq!(rig.request(FIRST, 0x02), answer, "{out} and {back}");
        if answer.1 == AlStatus::NONE {
            let mut mailbox = vec![0; 32];
            mailbox[..12].copy_from_slice(&[10, 0, 0, 0, 0, 0x03, 0, 0x20, 0x40, 0x18, 0x10, 1]);
            assert_eq!(rig.one(Command::Fpwr, FIRST, 0x1000, &mailbox).wkc, 1);
            let read = rig.one(Command::Fprd, FIRST, 0x1080, &[0; 40]);
            assert_eq!((read.wkc, &read.data[8..16]), (1, &[0x43, 0x18, 0x10, 1, 0x56, 0x05, 0, 0][..]));
        }
    }
}

/// DP3CL-5.5 E-803: SYNC0 that has not come 1 s after SafeOP, and is not to come, leads to PreOP with 0x002D; one that is still to
/// come is waited for.
#[test]
fn sync0_that_does_not_come() {
    let mut rig = with_sync0(-5, 0x03);
    rig.reach(FIRST, AlState::SafeOp);
    rig.now += 990 * MS;
    assert_eq!(rig.al_status(FIRST), (0x04, AlStatus::NONE));
    rig.now += 20 * MS;
    assert_eq!(rig.al_status(FIRST), (0x12, AlStatus::NO_SYNC));

    let mut rig = with_sync0(1_500, 0x03);
    rig.reach(FIRST, AlState::SafeOp);
    rig.now += 5_000 * MS;
    assert_eq!(rig.al_status(FIRST), (0x04, AlStatus::NONE));
}

/// DP3CL-5.21 Inputs come once SYNC0 has come: until then they read 0.
#[test]
fn inputs_wait_for_sync0() {
    let mut rig = with_sync0(100, 0x03);
    rig.reach(FIRST, AlState::SafeOp);
    let inputs = |rig: &mut Rig| rig.logical(Command::Lrd, 8, &[0xEE; 19]);
    rig.now += 50 * MS;
    let before = inputs(&mut rig);
    assert_eq!((before.wkc, before.data), (1, vec![0; 19]));
    rig.now += 100 * MS;
    let after = inputs(&mut rig);
    assert_eq!((after.wkc, after.data[2] & 0x4F), (1, 0x40), "the statusword of Switch on disabled");
}

/// DP3CL-5.6 E-804: outputs that stop lead to SafeOP with 0x001B, in SafeOP too, where the watchdog runs from the first outputs on.
#[test]
fn outputs_that_stop() {
    for state in [AlState::SafeOp, AlState::Op] {
        let mut rig = rig();
        rig.bring_to_preop(FIRST);
        rig.set_process_data(FIRST, 0);
        rig.reach(FIRST, AlState::SafeOp);
        rig.now += 5_000 * MS;
        assert_eq!(rig.al_status(FIRST), (0x04, AlStatus::NONE), "none have come yet");
        assert_eq!(rig.logical(Command::Lrw, 0, &[0; 27]).wkc, 3);
        if state == AlState::Op {
            rig.reach(FIRST, AlState::Op);
        }
        rig.now += 101 * MS;
        assert_eq!(rig.al_status(FIRST), (0x14, AlStatus::WATCHDOG), "{state:?}");
        assert_eq!(rig.request(FIRST, 0x14), (0x04, AlStatus::NONE));
    }
}

/// DP3CL-5.7 E-806: SYNC0 that is switched off leads from SafeOP and from OP to SafeOP with 0x0032.
#[test]
fn sync0_that_is_switched_off() {
    for state in [AlState::SafeOp, AlState::Op] {
        let mut rig = with_sync0(2, 0x03);
        rig.reach(FIRST, AlState::SafeOp);
        rig.now += 20 * MS;
        if state == AlState::Op {
            rig.logical(Command::Lrw, 0, &[0; 27]);
            rig.reach(FIRST, AlState::Op);
        }
        rig.write(FIRST, registers::SYNC_ACTIVATION, &[0]);
        assert_eq!(rig.al_status(FIRST), (0x14, AlStatus::PLL), "{state:?}");
    }
}

/// DP3CL-5.8, DP3CL-5.10, DP3CL-5.11, DP3CL-5.12, DP3CL-5.13 E-810, E-814 to E-817 on the way to SafeOP, by the registers of the
/// controller.
#[test]
fn mistakes_on_the_way_to_safeop() {
    type Mistake = fn(&mut Rig);
    let mistakes: [(Mistake, AlStatus); 8] = [
        (|rig| rig.write(FIRST, registers::SYNC0_CYCLE, &3_000_000_u32.to_le_bytes()), AlStatus::INVALID_DC_CYCLE),
        (|rig| rig.write(FIRST, registers::WATCHDOG_PROCESS_DATA, &[19, 0]), AlStatus::INVALID_WATCHDOG),
        (|rig| rig.write(FIRST, registers::SYNC_ACTIVATION, &[0x07]), AlStatus::INVALID_DC_SYNC),
        (|rig| rig.write(FIRST, registers::SYNC_ACTIVATION, &[0x05]), AlStatus::INVALID_DC_SYNC),
        (|rig| drop(rig.coe(FIRST, &[0, 0x20, 0x2B, 0x32, 0x1C, 1, 3, 0, 0, 0])), AlStatus::SYNC_MODE_UNSUPPORTED),
        (|rig| replace(rig, 2, SyncManager::enabled(0x1101, 8, SmControl::OUTPUTS)), AlStatus::INVALID_OUTPUTS),
        (|rig| replace(rig, 2, SyncManager::enabled(0x1040, 8, SmControl::OUTPUTS)), AlStatus::INVALID_OUTPUTS),
        (|rig| replace(rig, 3, SyncManager::enabled(OUTPUTS + 4, 19, SmControl::INPUTS)), AlStatus::INVALID_OUTPUTS),
    ];
    for (number, (mistake, code)) in mistakes.into_iter().enumerate() {
        let mut rig = with_sync0(2, 0x03);
        mistake(&mut rig);
        assert_eq!(rig.request(FIRST, 0x04), (0x12, code), "{number}");
    }
    let mut rig = with_sync0(2, 0x03);
    rig.reach(FIRST, AlState::SafeOp);
    assert!(rig.lens(FIRST) == (8, 19) && INPUTS > OUTPUTS);
}

fn replace(rig: &mut Rig, n: u8, manager: SyncManager) {
    rig.write(FIRST, registers::sync_manager_activate(n), &[0]);
    rig.set_manager(FIRST, n, manager);
}

/// DP3CL-5.20 An alarm sends no emergency.
#[test]
fn no_emergencies() {
    let mut rig = rig();
    rig.bring_to_preop(FIRST);
    assert_eq!(rig.request(FIRST, 0x08), (0x12, AlStatus::INVALID_CHANGE), "E-800");
    rig.now += 50 * MS;
    assert_eq!(rig.coe(FIRST, &[0, 0x20, 0x40, 0x3F, 0x60, 0, 0, 0, 0, 0])[6..8], [0x50, 0xFF]);
    rig.now += 50 * MS;
    assert_eq!(rig.collect(FIRST), None);
}
