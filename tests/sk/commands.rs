//! The 22 commands byte by byte, as in tables 2.1 to 2.24 of the guide, encoded and decoded.

use ecmsk::cia402::Mode;
use ecmsk::coe::{ObjectAddress, SdoSize};
use ecmsk::sk::{
    AxisTarget, CommandId, CycleTime, DcShift, DriveSync, FifoAction, MasterCommand, MasterState, Motion, RawSlot,
    SdoCommand, SlaveCommand, SlaveKind, SlotCommand, SlotKind, SlotSize, TargetEffect,
};
use support::guide::{self, Column};
use vectors::rubbish;

type Bytes = [u8; 12];

/// The twelve bytes of a slot, in either frame; the four behind them in a wide one must be 0.
fn check(size: SlotSize, i: usize, frame: &ecmsk::sk::Frame, wire: &Bytes, what: &dyn std::fmt::Debug) {
    let slot = &frame.bytes()[i * size.bytes()..(i + 1) * size.bytes()];
    assert_eq!(slot[..12], wire[..], "{what:?}");
    assert!(slot[12..].iter().all(|byte| *byte == 0), "{what:?}");
}

fn master(wire: Bytes, command: MasterCommand) {
    for size in SlotSize::ALL {
        let mut frame = rubbish();
        frame.put_master(size, &command);
        check(size, 0, &frame, &wire, &command);
        assert_eq!(MasterCommand::decode(&frame.slot(size, 0), size), Ok(command));
        assert_eq!(command.id().code(), wire[0]);
    }
}

fn slave(wire: Bytes, command: impl Into<SlotCommand>) {
    let command = command.into();
    for size in SlotSize::ALL {
        for n in [1, size.max_slaves()] {
            let mut frame = rubbish();
            frame.put_slave(size, n, &command);
            check(size, n, &frame, &wire, &command);
            assert_eq!(SlotCommand::decode(&frame.slot(size, n), size), Ok(command));
        }
    }
    assert_eq!(command.command.id().code(), wire[0]);
}

fn sdo(wire: Bytes, command: SdoCommand) {
    for size in SlotSize::ALL {
        let mut frame = rubbish();
        frame.put_sdo(size, &command);
        check(size, size.sdo_slot(), &frame, &wire, &command);
        assert_eq!(SdoCommand::decode(&frame.slot(size, size.sdo_slot()), size), Ok(command));
        assert_eq!(command.id().code(), wire[0]);
    }
}

/// SK-4.1 There are 22 commands, with these codes and names; every other code is kept as unknown.
#[test]
fn the_22_commands_have_their_codes_and_names() {
    let table = guide::TABLE.map(|(code, name, ..)| (code, name));
    assert_eq!(CommandId::ALL.map(|id| (id.code(), id.name())).as_slice(), table);
    for code in 0..=255 {
        let id = CommandId::from_code(code);
        assert_eq!(id.code(), code);
        let known = table.iter().any(|(listed, _)| *listed == code);
        assert_eq!(id == CommandId::Unknown(code), !known, "0x{code:02X}");
    }
    assert_eq!(CommandId::Csp.to_string(), "CSP");
    assert_eq!(CommandId::Unknown(0x77).to_string(), "UNKNOWN(0x77)");
}

/// SK-4.2 GET_STATUS is all zero in any slot (SK-1.11).
#[test]
fn get_status_is_all_zero() {
    master([0; 12], MasterCommand::GetStatus);
    slave([0; 12], SlaveCommand::GetStatus);
    sdo([0; 12], SdoCommand::GetStatus);
}

/// SK-4.4 SET_STATE: Data1 = 1, 2, 4 or 8.
#[test]
fn set_state_has_the_state_in_data1() {
    let states = [(1, MasterState::Init), (2, MasterState::PreOp), (4, MasterState::SafeOp), (8, MasterState::Op)];
    for (code, state) in states {
        master([0x01, 0, 0, 0, code, 0, 0, 0, 0, 0, 0, 0], MasterCommand::SetState(state));
        assert_eq!(state.code(), code);
    }
}

/// SK-4.6 SET_AXIS: byte 2 the group, nibble k of Data1 slave group * 8 + k + 1; SK-4.7 the nibbles.
#[test]
fn set_axis_has_the_group_in_byte_2_and_kinds_in_data1() {
    use SlaveKind::{Drive, Hsp, Io, None, Step};
    let kinds = [Drive, Io, Hsp, Step, None, Io, Hsp, Step];
    master([0x02, 0, 3, 0, 0x10, 0x32, 0x1F, 0x32, 0, 0, 0, 0], MasterCommand::SetAxis { group: 3, kinds });
}

/// SK-4.11 SET_DC: Data1 = cycle time in us; SK-4.12 Data2 = 0xFFFF or 0xFFFF0000, SK-4.13 or anything else.
#[test]
fn set_dc_has_the_cycle_time_in_data1_and_the_shift_in_data2() {
    let dc = |us, shift| MasterCommand::SetDc { cycle: CycleTime::from_us(us).expect("250 * 2^n"), shift };
    master([0x03, 0, 0, 0, 0xE8, 0x03, 0, 0, 0xFF, 0xFF, 0, 0], dc(1000, DcShift::Auto));
    master([0x03, 0, 0, 0, 0xFA, 0x00, 0, 0, 0, 0, 0xFF, 0xFF], dc(250, DcShift::AutoHigh));
    master([0x03, 0, 0, 0, 0x00, 0xD0, 0x07, 0, 1, 2, 3, 4], dc(512_000, DcShift::Other(0x0403_0201)));
}

/// SK-4.14 SET_EX: bit 0 = check command CRC, bit 4 = fill response CRC.
#[test]
fn set_ex_has_the_crc_switches_in_bits_0_and_4() {
    for (byte, check_commands, fill_responses) in
        [(0x00, false, false), (0x01, true, false), (0x10, false, true), (0x11, true, true)]
    {
        let command = MasterCommand::SetEx { check_commands, fill_responses };
        master([0x04, 0, 0, 0, byte, 0, 0, 0, 0, 0, 0, 0], command);
    }
}

/// SK-4.15 SET_FIFO: byte 2 = 1 clear, 2 threshold = Data1.
#[test]
fn set_fifo_has_the_action_in_byte_2() {
    master([0x05, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0], MasterCommand::SetFifo(FifoAction::Clear));
    let threshold = MasterCommand::SetFifo(FifoAction::Threshold(0x1234_5678));
    master([0x05, 0, 2, 0, 0x78, 0x56, 0x34, 0x12, 0, 0, 0, 0], threshold);
}

/// SK-4.16 DRIVE_MODE: Data1 = 8, 9, 10; Data2 = 0 free run, 1 DC sync.
#[test]
fn drive_mode_has_the_mode_in_data1() {
    for (code, mode) in [(8, Mode::Csp), (9, Mode::Csv), (10, Mode::Cst)] {
        for (drive_type, sync) in [(0, DriveSync::FreeRun), (1, DriveSync::DcSync)] {
            let wire = [0x06, 5, 0, 0, code, 0, 0, 0, drive_type, 0, 0, 0];
            slave(wire, SlaveCommand::DriveMode { mode, sync }.with_index(5));
        }
    }
}

/// SK-4.17 SDO_RD: Parm = slave, Data1 = index << 16 | sub-index.
#[test]
fn sdo_rd_has_the_slave_in_parm_and_the_object_in_data1() {
    let object = ObjectAddress::new(0x6099, 2);
    sdo([0x07, 0, 30, 0, 2, 0, 0x99, 0x60, 0, 0, 0, 0], SdoCommand::Read { slave: 30, object });
}

/// SK-4.18 SDO_WR: Parm low = slave, Parm high = size, Data1 as in SDO_RD, Data2 = value.
#[test]
fn sdo_wr_has_slave_and_size_in_parm_object_and_value_in_data() {
    let object = ObjectAddress::new(0x6099, 255);
    for (bytes, size) in [(1, SdoSize::One), (2, SdoSize::Two), (4, SdoSize::Four)] {
        let wire = [0x08, 0, 1, bytes, 255, 0, 0x99, 0x60, 0x44, 0x33, 0x22, 0x11];
        sdo(wire, SdoCommand::Write { slave: 1, object, size, value: 0x1122_3344 });
    }
}

/// SK-4.19 ALM_CLR, SK-4.21 SV_ON, SK-4.22 SV_OFF, SK-4.23 IO_RD, SK-4.28 GO_HOME, SK-4.29 ABORT_HOME: no argument,
/// byte 1 the index.
#[test]
fn commands_without_argument_have_only_an_index() {
    for (code, command) in [
        (0x10, SlaveCommand::AlarmClear),
        (0x11, SlaveCommand::ServoOn),
        (0x12, SlaveCommand::ServoOff),
        (0x13, SlaveCommand::IoRead),
        (0x18, SlaveCommand::GoHome),
        (0x19, SlaveCommand::AbortHome),
    ] {
        slave([code, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0], command);
        slave([code, 255, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0], command.with_index(255));
    }
}

/// SK-4.24 IO_WR: Data1 = outputs.
#[test]
fn io_wr_has_the_outputs_in_data1() {
    slave([0x14, 1, 0, 0, 0xC3, 0xA5, 0, 0, 0, 0, 0, 0], SlaveCommand::IoWrite(0xA5C3).with_index(1));
}

/// SK-4.25 CSP: Data1 = target position, i32, Data2 low = outputs; SK-4.26 CSV: Data1 = target velocity, outputs alike.
#[test]
fn csp_and_csv_have_target_and_outputs() {
    for (target, data1) in [(-2, [0xFE, 0xFF, 0xFF, 0xFF]), (i32::MAX, [0xFF, 0xFF, 0xFF, 0x7F]), (1, [1, 0, 0, 0])] {
        let to = Motion { first: AxisTarget { target, outputs: 0x55AA }, second: AxisTarget::default() };
        let wire = |id| [id, 0, 0, 0, data1[0], data1[1], data1[2], data1[3], 0xAA, 0x55, 0, 0];
        slave(wire(0x15), SlaveCommand::Csp(to));
        slave(wire(0x16), SlaveCommand::Csv(to));
    }
}

/// SK-4.27 CST: Data1 low 16 = target torque, i16; the upper half is written 0.
#[test]
fn cst_has_the_torque_in_the_low_half_of_data1() {
    slave([0x17, 0, 0, 0, 0xD4, 0xFE, 0, 0, 0, 0, 0, 0], SlaveCommand::Cst(-300));
    slave([0x17, 0, 0, 0, 0x00, 0x80, 0, 0, 0, 0, 0, 0], SlaveCommand::Cst(i16::MIN));
}

/// SK-4.31 LIO_RD: no argument; SK-4.32 LIO_WR: Data1 = 6 output bits.
#[test]
fn lio_rd_has_no_argument_and_lio_wr_six_output_bits() {
    master([0x21, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0], MasterCommand::LocalRead);
    master([0x22, 0, 0, 0, 0x2A, 0, 0, 0, 0, 0, 0, 0], MasterCommand::LocalWrite(0b10_1010));
}

/// SK-4.33 SW_RESET: no argument.
#[test]
fn sw_reset_has_no_argument() {
    master([0xBB, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0], MasterCommand::SoftReset);
}

/// SK-4.1 SK-4.2 The slots in which a command is allowed: the table's column, by codes; and the kind of each slot.
#[test]
fn each_command_belongs_in_one_kind_of_slot() {
    for code in 0..=u8::MAX {
        let expected: &[SlotKind] = match guide::row(code).map(|(column, _)| column) {
            Some(Column::Any) => &SlotKind::ALL,
            Some(Column::Board) => &[SlotKind::Master],
            Some(Column::Sdo) => &[SlotKind::Sdo],
            Some(Column::AnySlave | Column::Kinds(_)) => &[SlotKind::Slave],
            None => &[],
        };
        let id = CommandId::from_code(code);
        let found: Vec<_> = SlotKind::ALL.into_iter().filter(|slot| id.belongs_in(*slot)).collect();
        assert_eq!(found, expected, "{id}");
    }
    for (size, last) in [(SlotSize::Bytes12, 41), (SlotSize::Bytes16, 31)] {
        for slot in 0..=last {
            let expected = match slot {
                0 => SlotKind::Master,
                _ if slot == last => SlotKind::Sdo,
                _ => SlotKind::Slave,
            };
            assert_eq!(size.kind_of(slot), expected, "slot {slot}");
        }
    }
}

/// SK-4.1 In each kind of slot exactly the commands allowed there are decoded: one missing in `command/` fails.
#[test]
fn each_command_is_decoded_in_its_slots() {
    for (code, size) in (0..=u8::MAX).flat_map(|code| SlotSize::ALL.map(|size| (code, size))) {
        let id = CommandId::from_code(code);
        let slot = RawSlot { id: code, ..RawSlot::ZERO };
        // A command whose arguments must not be 0 is malformed, and not another one.
        let master = MasterCommand::decode(&slot, size)
            .map(|command| (matches!(command, MasterCommand::Other(_)), command.id()));
        let slave = SlotCommand::decode(&slot, size)
            .map(|slot| (matches!(slot.command, SlaveCommand::Other(_)), slot.command.id()));
        let sdo =
            SdoCommand::decode(&slot, size).map(|command| (matches!(command, SdoCommand::Other(_)), command.id()));
        for (kind, decoded) in SlotKind::ALL.into_iter().zip([master, slave, sdo]) {
            match decoded {
                Ok((is_other, found)) => assert_eq!((is_other, found), (!id.belongs_in(kind), id), "{id} in {kind:?}"),
                Err(_) => assert!(id.belongs_in(kind), "{id} in {kind:?}"),
            }
        }
    }
}

/// SK-7 The effect of each command on the target of an axis: CSP, CSV and CST bring one, a slot that reads or writes IO, or
/// nothing at all, keeps it, and every other command to a slave ends it.
#[test]
fn each_command_has_its_effect_on_a_target() {
    for id in CommandId::ALL {
        let effect = match id.name() {
            "CSP" => TargetEffect::Position,
            "CSV" | "CST" => TargetEffect::VelocityOrTorque,
            "DRIVE_MODE" | "ALM_CLR" | "SV_ON" | "SV_OFF" | "GO_HOME" | "ABORT_HOME" => TargetEffect::Ends,
            _ => TargetEffect::Keeps,
        };
        assert_eq!(id.target_effect(), effect, "{id}");
        assert_eq!(id.is_motion(), ["CSP", "CSV", "CST"].contains(&id.name()), "{id}");
    }
    assert_eq!(CommandId::Unknown(0x77).target_effect(), TargetEffect::Keeps);
}

/// SK-4.1 The kinds of slaves that accept a command, and the result for a slot with an unknown slave.
#[test]
fn each_command_is_for_some_kinds_of_slaves() {
    let kinds = [SlaveKind::Drive, SlaveKind::Hsp, SlaveKind::Step, SlaveKind::Io, SlaveKind::None];
    for id in CommandId::ALL {
        let takers: Vec<_> = kinds.into_iter().filter(|kind| id.is_for(*kind)).collect();
        let expected = match guide::row(id.code()).map(|(column, _)| column) {
            Some(Column::Any) => &kinds[..4],
            Some(Column::AnySlave) => &kinds[..],
            Some(Column::Kinds(kinds)) => kinds,
            _ => &[],
        };
        assert_eq!(takers, expected, "{id}");
        assert_eq!(id.only_kind(), (takers.len() == 1).then(|| takers[0]), "{id}");
        let is_for_axes = takers.contains(&SlaveKind::Drive) && !takers.contains(&SlaveKind::Io);
        assert_eq!(id.is_for_axes(), is_for_axes, "{id}");
    }
    assert!(kinds.into_iter().all(|kind| !CommandId::Unknown(0x77).is_for(kind)));
}
