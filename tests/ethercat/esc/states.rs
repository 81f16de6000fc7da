//! The AL state machine: its checks and the codes of its answers; the watchdog.

use ecmsk::coe::{ObjectAddress, SdoRequest, SdoScope, SdoValuePart};
use ecmsk::ethercat::registers::{self, SmControl, SyncManager};
use ecmsk::ethercat::{AlState, AlStatus, Command};
use ecmsk::slave::esc::{EscSettings, OP_WAIT_NS};
use ecmsk::slave::{Dp3cl, Dp3clConfig, Io};

use super::rig::{FIRST, INPUTS, MAILBOX, MS, OUTPUTS, Rig, drive, slave};

/// ECAT-11.1 PreOP without a mailbox is refused with 0x16; then only Init and requests with the acknowledge bit are
/// accepted.
#[test]
fn s26_an_error_has_to_be_acknowledged() {
    let mut rig = Rig::drives(1);
    assert_eq!(rig.request(FIRST, 0x02), (0x11, AlStatus::INVALID_MAILBOX));
    rig.set_mailbox(FIRST);
    assert_eq!(rig.request(FIRST, 0x02), (0x11, AlStatus::INVALID_MAILBOX));
    assert_eq!(rig.request(FIRST, 0x11), (0x01, AlStatus::NONE));
    assert_eq!(rig.request(FIRST, 0x02), (0x02, AlStatus::NONE));
}

/// ECAT-11.1 Each fault of a mailbox's settings is refused.
#[test]
fn s26_a_mailbox_has_to_be_right() {
    let (out, back) = (SmControl::MAILBOX_OUT, SmControl::MAILBOX_IN);
    let right = [SyncManager::enabled(0x1000, MAILBOX, out), SyncManager::enabled(0x1080, MAILBOX, back)];
    let wrong = [
        [SyncManager { activate: registers::SmActivate::NONE, ..right[0] }, right[1]],
        [right[0], SyncManager { activate: registers::SmActivate::NONE, ..right[1] }],
        [SyncManager::enabled(0x1000, 33, out), right[1]],
        [right[0], SyncManager::enabled(0x1080, 1487, back)],
        [SyncManager::enabled(0x1000, MAILBOX, SmControl::OUTPUTS), right[1]],
        [SyncManager::enabled(0x1000, MAILBOX, back), right[1]],
        [SyncManager::enabled(0x0F80, MAILBOX, out), right[1]],
        [right[0], SyncManager::enabled(0x2FC0, MAILBOX, back)],
        [right[0], SyncManager::enabled(0x1040, MAILBOX, back)],
    ];
    for managers in wrong {
        let mut rig = Rig::drives(1);
        let set = |rig: &mut Rig, managers: [SyncManager; 2]| {
            for (n, manager) in (0..).zip(managers) {
                rig.write(FIRST, registers::sync_manager_activate(n), &[0]);
                rig.set_manager(FIRST, n, manager);
            }
        };
        set(&mut rig, managers);
        assert_eq!(rig.request(FIRST, 0x02), (0x11, AlStatus::INVALID_MAILBOX), "{managers:?}");
        set(&mut rig, right);
        assert_eq!(rig.request(FIRST, 0x12), (0x02, AlStatus::NONE));
        // Again while the slave is in PreOP: it falls back.
        set(&mut rig, managers);
        assert_eq!(rig.al_status(FIRST), (0x11, AlStatus::INVALID_MAILBOX), "{managers:?}");
    }
}

/// ECAT-11.2 Steps that leave out a state are refused with 0x11, states that are not known with 0x12; Init is reached from any
/// error.
#[test]
fn s27_wrong_requests_have_their_codes() {
    let mut rig = Rig::drives(1);
    for (control, code) in [
        (0x04, AlStatus::INVALID_CHANGE),
        (0x08, AlStatus::INVALID_CHANGE),
        (0x07, AlStatus::UNKNOWN_STATE),
        (0x00, AlStatus::UNKNOWN_STATE),
        (0x03, AlStatus::INVALID_BOOT_MAILBOX),
    ] {
        assert_eq!(rig.request(FIRST, control), (0x11, code), "0x{control:02X}");
        assert_eq!(rig.request(FIRST, 0x01), (0x01, AlStatus::NONE), "Init without the bit that acknowledges");
    }
    // A device without files has no bootstrap.
    let mut io = Rig::with_stations([slave(Box::new(Io::default()), EscSettings::default())]);
    assert_eq!(io.request(FIRST, 0x03), (0x11, AlStatus::BOOT_UNSUPPORTED));
    rig.bring_to_preop(FIRST);
    assert_eq!(rig.request(FIRST, 0x08), (0x12, AlStatus::INVALID_CHANGE));
    assert_eq!(rig.request(FIRST, 0x13), (0x12, AlStatus::INVALID_CHANGE), "bootstrap is entered from Init alone");
    assert_eq!(rig.request(FIRST, 0x12), (0x02, AlStatus::NONE));
    assert_eq!(rig.request(FIRST, 0x02), (0x02, AlStatus::NONE), "the same state");
}

/// ECAT-11.3 Sync managers that are not as long as the mapped process data are refused, 0x1D for outputs and 0x1E for inputs.
#[test]
fn s28_process_data_have_to_fit() {
    let mut rig = Rig::drives(1);
    let (outputs, inputs) = rig.lens(FIRST);
    rig.bring_to_preop(FIRST);
    let set = |rig: &mut Rig, outputs: SyncManager, inputs: SyncManager| {
        for (n, manager) in [(2, outputs), (3, inputs)] {
            rig.write(FIRST, registers::sync_manager_activate(n), &[0]);
            rig.set_manager(FIRST, n, manager);
        }
    };
    let out = SyncManager::enabled(OUTPUTS, outputs, SmControl::OUTPUTS);
    let back = SyncManager::enabled(INPUTS, inputs, SmControl::INPUTS);
    let off = |manager| SyncManager { activate: registers::SmActivate::NONE, ..manager };
    for (outputs, inputs, code) in [
        (SyncManager { len: outputs + 1, ..out }, back, AlStatus::INVALID_OUTPUTS),
        (off(out), back, AlStatus::INVALID_OUTPUTS),
        (SyncManager { control: SmControl::INPUTS, ..out }, back, AlStatus::INVALID_OUTPUTS),
        (SyncManager { start: 0x0F80, ..out }, back, AlStatus::INVALID_OUTPUTS),
        (out, SyncManager { len: inputs - 1, ..back }, AlStatus::INVALID_INPUTS),
        (out, off(back), AlStatus::INVALID_INPUTS),
        (out, SyncManager { control: SmControl::OUTPUTS, ..back }, AlStatus::INVALID_INPUTS),
        (out, SyncManager { start: 0x3000 - 2 * inputs, ..back }, AlStatus::INVALID_INPUTS),
        (SyncManager { control: SmControl(0x66), ..out }, back, AlStatus::NEEDS_THREE_BUFFERS),
    ] {
        set(&mut rig, outputs, inputs);
        assert_eq!(rig.request(FIRST, 0x14), (0x12, code), "{outputs:?} {inputs:?}");
    }
    set(&mut rig, out, back);
    assert_eq!(rig.request(FIRST, 0x14), (0x04, AlStatus::NONE));
    // In SafeOP a change is noticed at once.
    rig.write(FIRST, registers::sync_manager_activate(3), &[0]);
    assert_eq!(rig.al_status(FIRST), (0x12, AlStatus::INVALID_INPUTS));
    set(&mut rig, out, back);
    assert_eq!(rig.request(FIRST, 0x14), (0x04, AlStatus::NONE));
    rig.write(FIRST, registers::sync_manager_activate(2), &[0]);
    assert_eq!(rig.al_status(FIRST), (0x12, AlStatus::INVALID_OUTPUTS));
}

/// ECAT-11.3 A direction without a mapping needs no sync manager.
#[test]
fn s28_a_direction_without_data_is_off() {
    let mut rig = Rig::drives(1);
    let inputs = rig.lens(FIRST).1;
    rig.bring_to_preop(FIRST);
    rig.coe(FIRST, &[0, 0x20, 0x2F, 0x12, 0x1C, 0, 0, 0, 0, 0]);
    rig.set_manager(FIRST, 3, SyncManager::enabled(INPUTS, inputs, SmControl::INPUTS));
    rig.reach(FIRST, AlState::SafeOp);
    rig.reach(FIRST, AlState::Op);
    rig.now += 500 * MS;
    assert_eq!(rig.al_status(FIRST), (0x08, AlStatus::NONE), "without outputs there is no watchdog");
}

/// ECAT-11.4 If no outputs come for the time of the watchdog, the slave goes to SafeOP with 0x1B, its outputs are safe, and
/// the watchdog has counted; with the time 0 it stays in OP.
#[test]
fn s29_the_watchdog_ends_op() {
    let mut rig = Rig::drives(1);
    let len = rig.bring_to_op(FIRST, 0);
    for _ in 0..30 {
        rig.now += 10 * MS;
        assert_eq!(rig.logical(Command::Lrw, 0, &vec![0; len]).wkc, 3);
    }
    assert_eq!(rig.al_status(FIRST), (0x08, AlStatus::NONE));
    assert_eq!(rig.read(FIRST, registers::WATCHDOG_STATUS, 3), [1, 0, 0]);

    rig.now += 101 * MS;
    assert_eq!(rig.al_status(FIRST), (0x14, AlStatus::WATCHDOG));
    assert_eq!(rig.read(FIRST, registers::WATCHDOG_STATUS, 3), [0, 0, 1]);
    assert_eq!(rig.chain.slave(0).device().state(), AlState::SafeOp, "the device has lost its outputs");
    assert_eq!(
        rig.logical(Command::Lrw, 0, &vec![0; len]).wkc,
        1,
        "outputs are not taken before the error is acknowledged"
    );
    assert_eq!(rig.request(FIRST, 0x14), (0x04, AlStatus::NONE));
    assert_eq!(rig.logical(Command::Lrw, 0, &vec![0; len]).wkc, 3);
    rig.reach(FIRST, AlState::Op);

    rig.write(FIRST, registers::WATCHDOG_COUNTER_PROCESS_DATA, &[0]);
    rig.write(FIRST, registers::WATCHDOG_PROCESS_DATA, &[0, 0]);
    rig.now += 5_000 * MS;
    assert_eq!(rig.al_status(FIRST), (0x08, AlStatus::NONE));
    assert_eq!(rig.read(FIRST, registers::WATCHDOG_STATUS, 3), [1, 0, 0]);
}

/// ECAT-11.4 Another time than 100 ms can be set.
#[test]
fn s29_the_time_of_the_watchdog_is_set() {
    let mut rig = Rig::drives(1);
    // Units of 1 ms, 30 of them.
    rig.write(FIRST, registers::WATCHDOG_DIVIDER, &24_998u16.to_le_bytes());
    rig.write(FIRST, registers::WATCHDOG_PROCESS_DATA, &[30, 0]);
    let len = rig.bring_to_op(FIRST, 0);
    rig.logical(Command::Lrw, 0, &vec![0; len]);
    rig.now += 29 * MS;
    assert_eq!(rig.al_status(FIRST).0, 0x08);
    rig.now += MS;
    assert_eq!(rig.al_status(FIRST), (0x14, AlStatus::WATCHDOG));
}

/// ECAT-11.5 AL status and its code are read together, always those of one moment.
#[test]
fn s30_status_and_code_belong_together() {
    let mut rig = Rig::drives(1);
    for (control, bytes) in [(0x08, [0x11, 0, 0, 0, 0x11, 0]), (0x11, [0x01, 0, 0, 0, 0, 0])] {
        rig.write(FIRST, registers::AL_CONTROL, &[control, 0]);
        assert_eq!(rig.read(FIRST, registers::AL_STATUS, 6), bytes);
    }
    assert_eq!(rig.one(Command::Brd, 0, registers::AL_STATUS, &[0, 0]).data, [1, 0]);
}

/// ECAT-11.6 On the way to OP a slave waits for outputs; if none come, it stays in SafeOP with 0x1B.
#[test]
fn op_needs_outputs() {
    let mut rig = Rig::in_preop();
    let len = rig.set_process_data(FIRST, 0);
    rig.reach(FIRST, AlState::SafeOp);
    assert_eq!(rig.request(FIRST, 0x08), (0x04, AlStatus::NONE));
    rig.now += OP_WAIT_NS - 10 * MS;
    assert_eq!(rig.al_status(FIRST), (0x04, AlStatus::NONE));
    rig.now += 10 * MS;
    assert_eq!(rig.al_status(FIRST), (0x14, AlStatus::WATCHDOG));
    assert_eq!(rig.request(FIRST, 0x14), (0x04, AlStatus::NONE));
    assert_eq!(rig.request(FIRST, 0x08), (0x04, AlStatus::NONE));
    rig.logical(Command::Lrw, 0, &vec![0; len]);
    assert_eq!(rig.al_status(FIRST), (0x08, AlStatus::NONE));
}

/// ECAT-11.7 Every state can be left downwards; outputs of a state below OP are not used.
#[test]
fn states_are_left_downwards() {
    for target in [AlState::SafeOp, AlState::PreOp, AlState::Init] {
        let mut rig = Rig::drives(1);
        rig.bring_to_op(FIRST, 0);
        rig.reach(FIRST, target);
        assert_eq!(rig.chain.slave(0).device().state(), target);
    }
    let mut rig = Rig::drives(1);
    rig.bring_to_op(FIRST, 0);
    rig.reach(FIRST, AlState::SafeOp);
    rig.reach(FIRST, AlState::Init);
}

/// ECAT-11.8 A change of state may take time; meanwhile AL status stays.
#[test]
fn a_change_of_state_takes_its_time() {
    let mut rig = Rig::with_stations([drive(EscSettings { state_change_ns: 20 * MS, ..EscSettings::default() })]);
    rig.set_mailbox(FIRST);
    assert_eq!(rig.request(FIRST, 0x02), (0x01, AlStatus::NONE));
    rig.now += 19 * MS;
    assert_eq!(rig.al_status(FIRST), (0x01, AlStatus::NONE));
    rig.now += MS;
    assert_eq!(rig.al_status(FIRST), (0x02, AlStatus::NONE));
}

/// ECAT-11.8 Until the device has read AL control, the controller refuses further writes to it; not with device emulation.
#[test]
fn al_control_is_read_before_it_is_written_again() {
    let mut rig = Rig::with_stations([drive(EscSettings { state_change_ns: 5 * MS, ..EscSettings::default() })]);
    rig.set_mailbox(FIRST);
    let ask = |rig: &mut Rig, state| rig.one(Command::Fpwr, FIRST, registers::AL_CONTROL, &[state, 0]).wkc;
    assert_eq!([2, 4].map(|state| ask(&mut rig, state)), [1, 0]);
    rig.now += 4 * MS;
    assert_eq!(ask(&mut rig, 1), 0);
    rig.now += MS;
    assert_eq!(rig.al_status(FIRST), (0x02, AlStatus::NONE));
    assert_eq!(ask(&mut rig, 1), 1);
    let settings = EscSettings { state_change_ns: 5 * MS, pdi_control: 0x0105, ..EscSettings::default() };
    let mut rig = Rig::with_stations([drive(settings)]);
    assert_eq!([2, 4].map(|state| ask(&mut rig, state)), [1, 1]);
}

/// ECAT-11.9 The identification is shown as AL status code while a master asks for it.
#[test]
fn the_identification_is_told() {
    let mut rig = Rig::with_stations([drive(EscSettings { device_id: 0x1234, ..EscSettings::default() })]);
    rig.bring_to_preop(FIRST);
    assert_eq!(rig.request(FIRST, 0x22), (0x22, AlStatus(0x1234)));
    assert_eq!(rig.request(FIRST, 0x02), (0x02, AlStatus::NONE));
    // One without an identification does not answer.
    let mut rig = Rig::in_preop();
    assert_eq!(rig.request(FIRST, 0x22), (0x02, AlStatus::NONE));
}

/// ECAT-11.10 A device that checks its registers itself answers with its own code, and may fall further back: a DP3CL
/// in OP that is asked for a state that is not known goes to SafeOP, and to Init if it is asked for bootstrap.
#[test]
fn a_device_has_its_own_reasons() {
    let dp3cl = || slave(Box::new(Dp3cl::new(Dp3clConfig::default())), EscSettings::default());
    for (control, state) in [(0x07, AlState::SafeOp), (0x03, AlState::Init)] {
        let mut rig = Rig::with_stations([dp3cl()]);
        rig.bring_to_op(FIRST, 0);
        let (status, code) = rig.request(FIRST, control);
        assert_eq!(status, 0x10 | state as u16);
        assert_eq!((rig.chain.slave(0).device().state(), rig.chain.slave(0).device().al_status()), (state, code));
        assert_ne!(code, AlStatus::NONE);
    }
    // Its own limits of a mailbox: it begins at an even address.
    let mut rig = Rig::with_stations([dp3cl()]);
    rig.set_manager(FIRST, 0, SyncManager::enabled(0x1001, 100, SmControl::MAILBOX_OUT));
    rig.set_manager(FIRST, 1, SyncManager::enabled(0x1080, 100, SmControl::MAILBOX_IN));
    let (status, code) = rig.request(FIRST, 0x02);
    assert_eq!((status, code), (0x11, rig.chain.slave(0).device().al_status()));
}

/// ECAT-11.14 A drive that a master has set to SYNC0 (0x1C32:1 or 0x1C33:1 = 2) refuses OP without SYNC0, with 0x30;
/// with SYNC0, with another type, or without that setting it reaches OP.
#[test]
fn a_drive_told_to_run_by_sync0_needs_it() {
    for (object, code, has_sync0, expected) in [
        (Some(0x1C32), 2, false, (0x14, AlStatus::INVALID_DC_SYNC)),
        (Some(0x1C33), 2, false, (0x14, AlStatus::INVALID_DC_SYNC)),
        (Some(0x1C32), 2, true, (0x08, AlStatus::NONE)),
        (Some(0x1C32), 1, false, (0x08, AlStatus::NONE)),
        (Some(0x1C33), 0x22, false, (0x08, AlStatus::NONE)),
        (Some(0x1C32), 0, false, (0x08, AlStatus::NONE)),
        (None, 0, false, (0x08, AlStatus::NONE)),
        (None, 0, true, (0x08, AlStatus::NONE)),
    ] {
        let mut rig = Rig::in_preop();
        if let Some(index) = object {
            let (object, value) = (ObjectAddress::new(index, 1), SdoValuePart::Expedited(&[code, 0]));
            let answer = rig.sdo(FIRST, SdoRequest::Download { object, scope: SdoScope::Entry, value });
            assert_eq!(answer[2], 0x60, "0x{index:04X}:1 = {code}");
        }
        let len = rig.set_process_data(FIRST, 0);
        if has_sync0 {
            let start = rig.read_u64(FIRST, registers::SYSTEM_TIME) + 5 * MS;
            rig.write(FIRST, registers::SYNC0_CYCLE, &1_000_000_u32.to_le_bytes());
            rig.write(FIRST, registers::SYNC0_START, &start.to_le_bytes());
            rig.write(FIRST, registers::SYNC_ACTIVATION, &[3]);
        }
        rig.reach(FIRST, AlState::SafeOp);
        rig.logical(Command::Lrw, 0, &vec![0; len]);
        rig.request(FIRST, 0x08);
        for _ in 0..20 {
            rig.now += MS;
            rig.logical(Command::Lrw, 0, &vec![0; len]);
        }
        assert_eq!(rig.al_status(FIRST), expected, "{object:04X?} = {code}, SYNC0: {has_sync0}");
        if expected.0 == 0x14 {
            // The error is corrected: the drive reaches OP.
            rig.request(FIRST, 0x12);
            let (object, value) = (ObjectAddress::new(object.unwrap_or_default(), 1), SdoValuePart::Expedited(&[1, 0]));
            rig.sdo(FIRST, SdoRequest::Download { object, scope: SdoScope::Entry, value });
            rig.reach(FIRST, AlState::SafeOp);
            rig.logical(Command::Lrw, 0, &vec![0; len]);
            rig.reach(FIRST, AlState::Op);
        }
    }
}

/// ECAT-11.13 A terminal of inputs and outputs goes to OP without outputs, as those of makers do, and stays there; from the first
/// outputs on its watchdog runs.
#[test]
fn a_terminal_reaches_op_without_outputs() {
    let mut rig = Rig::with_stations([slave(Box::new(Io::default()), EscSettings::default())]);
    rig.bring_to_preop(FIRST);
    let len = rig.set_process_data(FIRST, 0);
    rig.reach(FIRST, AlState::SafeOp);
    rig.reach(FIRST, AlState::Op);
    for _ in 0..500 {
        rig.now += MS;
        assert_eq!(rig.al_status(FIRST), (0x08, AlStatus::NONE));
    }
    let mut outputs = vec![0; len];
    outputs[0] = 0xA5;
    for _ in 0..3 {
        rig.logical(Command::Lrw, 0, &outputs);
        rig.now += 2 * MS;
    }
    assert_eq!(rig.logical(Command::Lrw, 0, &outputs).data[2], 0xA5, "what is wired to its inputs");
    rig.now += 200 * MS;
    assert_eq!(rig.al_status(FIRST), (0x14, AlStatus::WATCHDOG));
}
