//! The limits of every argument: values that a command's decoder accepts, values that it refuses and the reason, bit by
//! bit.

use ecmsk::cia402::Mode;
use ecmsk::coe::{ObjectAddress, SdoSize};
use ecmsk::sk::{
    CycleTime, DcShift, DriveSync, FifoAction, InvalidArgument, MasterCommand, MasterState, RawSlot, SdoCommand,
    SlaveCommand, SlaveKind, SlotCommand, SlotSize, StateByte,
};
use support::guide::{self, Column};

fn master(slot: RawSlot) -> Result<MasterCommand, InvalidArgument> {
    let narrow = MasterCommand::decode(&slot, SlotSize::Bytes12);
    if slot.id != 0x02 {
        assert_eq!(MasterCommand::decode(&slot, SlotSize::Bytes16), narrow, "the slot size counts for SET_AXIS alone");
    }
    narrow
}

fn slave(slot: RawSlot) -> Result<SlaveCommand, InvalidArgument> {
    SlotCommand::decode(&slot, SlotSize::Bytes12).map(|slot| slot.command)
}

/// Every value with one bit set, 0, and all bits set.
fn bits() -> impl Iterator<Item = u32> {
    (0..32).map(|bit| 1 << bit).chain([0, u32::MAX])
}

/// SK-4.4 SET_STATE takes 1, 2, 4, 8 and nothing else, in no other bit of Data1 either.
#[test]
fn set_state_takes_1_2_4_and_8_only() {
    for value in bits().chain(0..0x200).chain([0x0102_0304, 0x8000_0008]) {
        let wanted = match value {
            1 => Ok(MasterState::Init),
            2 => Ok(MasterState::PreOp),
            4 => Ok(MasterState::SafeOp),
            8 => Ok(MasterState::Op),
            other => Err(InvalidArgument::State(other)),
        };
        let slot = RawSlot { id: 0x01, data1: value, ..RawSlot::ZERO };
        assert_eq!(master(slot), wanted.map(MasterCommand::SetState));
    }
}

fn set_axis(group: u8, data1: u32, size: SlotSize) -> Result<MasterCommand, InvalidArgument> {
    MasterCommand::decode(&RawSlot { id: 0x02, parm: group.into(), data1, ..RawSlot::ZERO }, size)
}

/// SK-4.6 Group is 0..=4 in both modes.
#[test]
fn set_axis_takes_groups_0_to_4_only() {
    for size in SlotSize::ALL {
        for group in 0..=255 {
            let kinds = [SlaveKind::Io; 8];
            let wanted = if group <= 4 {
                Ok(MasterCommand::SetAxis { group, kinds })
            } else {
                Err(InvalidArgument::Group(group))
            };
            assert_eq!(set_axis(group, 0x1111_1111, size), wanted);
        }
    }
}

/// SK-4.7 A nibble is 0, 1, 2, 3 or 0xF, at its slave's place; SK-4.9 4..=14 reject the whole command and the reason
/// names the slave; SK-4.8 nibbles of slaves above 40 (30) are ignored, whatever they are.
#[test]
fn set_axis_takes_nibbles_0_to_3_and_f_only() {
    for size in SlotSize::ALL {
        for (group, place, nibble) in (0..=4).flat_map(|g| (0..8).flat_map(move |p| (0..16).map(move |n| (g, p, n)))) {
            let slave = group * 8 + place + 1;
            let data1 = !(0xF << (4 * place)) | (u32::from(nibble) << (4 * place));
            let mut kinds = [SlaveKind::None; 8];
            let wanted = match nibble {
                0 => Ok(SlaveKind::Drive),
                1 => Ok(SlaveKind::Io),
                2 => Ok(SlaveKind::Hsp),
                3 => Ok(SlaveKind::Step),
                15 => Ok(SlaveKind::None),
                _ if usize::from(slave) > size.max_slaves() => Ok(SlaveKind::None),
                _ => Err(InvalidArgument::Kind { slave, nibble }),
            };
            let wanted = wanted.map(|kind| {
                kinds[usize::from(place)] = kind;
                MasterCommand::SetAxis { group, kinds }
            });
            assert_eq!(set_axis(group, data1, size), wanted, "group {group} place {place} nibble {nibble}");
        }
    }
    for nibble in 0..=255 {
        let kind = SlaveKind::from_nibble(nibble);
        assert_eq!(kind.map(SlaveKind::nibble), matches!(nibble, 0..=3 | 15).then_some(nibble));
    }
}

/// SK-4.11 The cycle time is 250 us * 2^n up to 1 s: twelve values and no other below, at or beyond the limit.
#[test]
fn set_dc_takes_the_twelve_cycle_times_only() {
    let allowed = [250, 500, 1000, 2000, 4000, 8000, 16_000, 32_000, 64_000, 128_000, 256_000, 512_000];
    let taken: Vec<u32> = (0..=1_100_000).filter(|us| CycleTime::from_us(*us).is_some()).collect();
    assert_eq!(taken, allowed);
    for beyond in (12..25).map(|n| 250 << n).chain([u32::MAX]) {
        assert_eq!(CycleTime::from_us(beyond), None, "{beyond}");
        let slot = RawSlot { id: 0x03, data1: beyond, data2: 0xFFFF, ..RawSlot::ZERO };
        assert_eq!(master(slot), Err(InvalidArgument::CycleTime(beyond)));
    }
    assert_eq!((CycleTime::DEFAULT.us(), CycleTime::DEFAULT.ns()), (1000, 1_000_000));
}

/// SK-4.12 Data2 of SET_DC is 0xFFFF or 0xFFFF0000; SK-4.13 anything else is taken too, and kept to be reported.
#[test]
fn set_dc_keeps_any_shift() {
    for value in bits().chain([0xFFFF, 0xFFFF_0000, 0xFFFE, 0xFFFF_0001]) {
        let shift = match value {
            0xFFFF => DcShift::Auto,
            0xFFFF_0000 => DcShift::AutoHigh,
            other => DcShift::Other(other),
        };
        let slot = RawSlot { id: 0x03, data1: 1000, data2: value, ..RawSlot::ZERO };
        assert_eq!(master(slot), Ok(MasterCommand::SetDc { cycle: CycleTime::DEFAULT, shift }));
    }
}

/// SK-4.14 Of SET_EX bits 0 and 4 count, each on its own (SK-1.15); the others are reserved and change nothing.
#[test]
fn set_ex_uses_bits_0_and_4_only() {
    for value in bits() {
        let slot = RawSlot { id: 0x04, data1: value, ..RawSlot::ZERO };
        let (check_commands, fill_responses) = (value & 1 == 1, value & 16 == 16);
        assert_eq!(master(slot), Ok(MasterCommand::SetEx { check_commands, fill_responses }));
    }
}

/// SK-4.15 Byte 2 of SET_FIFO is 1 or 2; a threshold is any number but 0, SK-5.23 which could never fire.
#[test]
fn set_fifo_takes_clear_and_a_threshold_other_than_0() {
    for action in 0..=255 {
        for value in bits().chain([159, 160, 161]) {
            let slot = RawSlot { id: 0x05, parm: u16::from(action), data1: value, ..RawSlot::ZERO };
            let wanted = match (action, value) {
                (1, _) => Ok(FifoAction::Clear),
                (2, 0) => Err(InvalidArgument::ZeroThreshold),
                (2, free) => Ok(FifoAction::Threshold(free)),
                (other, _) => Err(InvalidArgument::FifoAction(other)),
            };
            assert_eq!(master(slot), wanted.map(MasterCommand::SetFifo), "action {action} value {value}");
        }
    }
}

/// SK-4.16 DRIVE_MODE takes modes 8, 9, 10, and 0 or 1 beside it, in all 32 bits of each.
#[test]
fn drive_mode_takes_modes_8_to_10_with_0_or_1() {
    let decode = |data1, data2| slave(RawSlot { id: 0x06, data1, data2, ..RawSlot::ZERO });
    for value in bits().chain(0..0x120) {
        let mode = match value {
            8 => Ok(Mode::Csp),
            9 => Ok(Mode::Csv),
            10 => Ok(Mode::Cst),
            other => Err(InvalidArgument::DriveMode(other)),
        };
        let command = |mode| SlaveCommand::DriveMode { mode, sync: DriveSync::DcSync };
        assert_eq!(decode(value, 1), mode.map(command), "mode {value}");

        let sync = match value {
            0 => Ok(DriveSync::FreeRun),
            1 => Ok(DriveSync::DcSync),
            // Programs leave the value of an earlier command there.
            _ => Ok(DriveSync::DcSync),
        };
        assert_eq!(decode(8, value), sync.map(|sync| SlaveCommand::DriveMode { mode: Mode::Csp, sync }), "{value}");
    }
}

const OBJECT: ObjectAddress = ObjectAddress::new(0x6041, 0);

/// SK-4.17 The low byte of Parm of SDO_RD is a slave 1..=40, in 16-byte mode 1..=30, with any high byte: programs put
/// the object's size there. SK-6.6 Any other slave is refused.
#[test]
fn sdo_rd_takes_a_slave_whatever_the_high_byte_of_parm_is() {
    for (size, last) in [(SlotSize::Bytes12, 40), (SlotSize::Bytes16, 30)] {
        for parm in 0..=u16::MAX {
            let slot = RawSlot { id: 0x07, parm, data1: 0x6041_0000, ..RawSlot::ZERO };
            let wanted = match parm % 0x100 {
                slave if (1..=last).contains(&slave) => Ok(SdoCommand::Read { slave: slave as u8, object: OBJECT }),
                other => Err(InvalidArgument::SdoSlave(other)),
            };
            assert_eq!(SdoCommand::decode(&slot, size), wanted);
        }
    }
}

/// SK-4.18 Parm of SDO_WR is a slave (SK-6.6) in the low byte and a size of 1, 2 or 4 in the high byte.
#[test]
fn sdo_wr_takes_a_slave_and_a_size_of_1_2_or_4() {
    for (slot_size, last) in [(SlotSize::Bytes12, 40), (SlotSize::Bytes16, 30)] {
        for parm in 0..=u16::MAX {
            let [slave, bytes] = parm.to_le_bytes();
            let slot = RawSlot { id: 0x08, parm, data1: 0x6041_0000, data2: u32::MAX, ..RawSlot::ZERO };
            let write = |size| SdoCommand::Write { slave, object: OBJECT, size, value: u32::MAX };
            let wanted = match bytes {
                _ if slave == 0 || slave > last => Err(InvalidArgument::SdoSlave(slave.into())),
                1 => Ok(write(SdoSize::One)),
                2 => Ok(write(SdoSize::Two)),
                4 => Ok(write(SdoSize::Four)),
                other => Err(InvalidArgument::SdoSize(other)),
            };
            assert_eq!(SdoCommand::decode(&slot, slot_size), wanted, "parm 0x{parm:04X}");
        }
    }
}

/// SK-4.17, SK-4.18 Data1 is index << 16 | sub-index; a sub-index has 8 bits, an index 16.
#[test]
fn an_object_is_index_times_65536_plus_sub_index() {
    for low in 0..=u16::MAX {
        for (id, parm) in [(0x07, 40), (0x08, 0x0428)] {
            let slot = RawSlot { id, parm, data1: 0xFFFF_0000 | u32::from(low), ..RawSlot::ZERO };
            let object = |command| match command {
                SdoCommand::Read { object, .. } | SdoCommand::Write { object, .. } => object,
                other => panic!("{other:?}"),
            };
            let wanted = match low {
                sub if sub <= 255 => Ok(ObjectAddress::new(0xFFFF, sub as u8)),
                other => Err(InvalidArgument::SubIndex(other)),
            };
            assert_eq!(SdoCommand::decode(&slot, SlotSize::Bytes12).map(object), wanted);
        }
    }
}

/// SK-3.16 IO_WR: the upper half is ignored; SK-4.27 so is CST's; SK-4.32 LIO_WR has six outputs, both ways.
#[test]
fn unused_bits_of_outputs_and_torques_are_ignored() {
    for value in bits() {
        assert_eq!(
            slave(RawSlot { id: 0x14, data1: value, ..RawSlot::ZERO }),
            Ok(SlaveCommand::IoWrite((value & 0xFFFF) as u16))
        );
        let torque = i16::from_le_bytes([value as u8, (value >> 8) as u8]);
        assert_eq!(slave(RawSlot { id: 0x17, data1: value, ..RawSlot::ZERO }), Ok(SlaveCommand::Cst(torque)));
        assert_eq!(
            master(RawSlot { id: 0x22, data1: value, ..RawSlot::ZERO }),
            Ok(MasterCommand::LocalWrite((value & 0x3F) as u8))
        );
    }
    assert_eq!(MasterCommand::LocalWrite(0xFF).encode().data1, 0x3F);
}

/// SK-2.8 States 0, 1, 2, 4, 8; SK-2.9 any other value means that a slave was not found or did not follow;
/// SK-2.16 with 0x10 in it the allowed commands go by the low nibble.
#[test]
fn a_state_byte_other_than_0_1_2_4_8_means_a_failed_change() {
    let state = |nibble| match nibble {
        1 => Some(MasterState::Init),
        2 => Some(MasterState::PreOp),
        4 => Some(MasterState::SafeOp),
        8 => Some(MasterState::Op),
        _ => None,
    };
    for value in 0..=255 {
        let byte = StateByte(value);
        assert_eq!(byte.state(), if value < 0x20 { state(value & 0xF) } else { None }, "0x{value:02X}");
        assert_eq!(byte.is_failed(), !matches!(value, 0 | 1 | 2 | 4 | 8), "0x{value:02X}");
    }
    assert_eq!(StateByte::NETWORK_INIT, StateByte(0));
    for good in [MasterState::Init, MasterState::PreOp, MasterState::SafeOp, MasterState::Op] {
        assert_eq!(StateByte::reached(good), StateByte(good.code()));
        assert_eq!(StateByte::failed(Some(good)), StateByte(0x10 | good.code()));
    }
    assert_eq!(StateByte::failed(None), StateByte(0x10));
    for (value, text) in [
        (0x00, "network initialising"),
        (0x02, "PreOP"),
        (0x10, "no slave found"),
        (0x18, "OP (a slave failed)"),
        (0x13, "unknown 0x13 (no slave found, or a slave failed)"),
        (0x28, "unknown 0x28 (no slave found, or a slave failed)"),
    ] {
        assert_eq!(StateByte(value).to_string(), text);
    }
}

/// SK-4.36 A known id in the wrong kind of slot is no command there, and neither is an unknown one: both are kept.
#[test]
fn a_command_in_the_wrong_kind_of_slot_is_kept_as_no_command() {
    let in_slots = |is_there: fn(Column) -> bool| -> Vec<u8> {
        guide::TABLE.iter().filter(|(_, _, column, _)| is_there(*column)).map(|(code, ..)| *code).collect()
    };
    let masters = in_slots(|column| matches!(column, Column::Any | Column::Board));
    let slaves = in_slots(|column| matches!(column, Column::Any | Column::AnySlave | Column::Kinds(_)));
    let sdo = in_slots(|column| matches!(column, Column::Any | Column::Sdo));
    for id in 0..=255 {
        // Arguments that every command takes: state 8, group 1, clear, mode 8, slave 1 with size 1, sub-index 8.
        let parm = if id == 0x08 { 0x0101 } else { 1 };
        let data1 = if id == 0x03 { 1000 } else { 8 };
        let slot = RawSlot { id, index: 0, parm, data1, data2: 1, data3: 0 };
        let foreign = |found, known: &[u8]| assert_eq!(found, !known.contains(&id), "0x{id:02X}");
        foreign(matches!(master(slot), Ok(MasterCommand::Other(_))), &masters);
        foreign(slave(slot) == Ok(SlaveCommand::Other(slot)), &slaves);
        foreign(SdoCommand::decode(&slot, SlotSize::Bytes12) == Ok(SdoCommand::Other(slot)), &sdo);
    }
}

/// SK-4.4, SK-4.9, SK-4.11, SK-6.6 The reason of a refusal names the value found and the allowed ones.
#[test]
fn the_reason_of_a_refusal_says_what_was_found_and_what_is_allowed() {
    for (reason, text) in [
        (InvalidArgument::State(3), "state 3 is none of 1 Init, 2 PreOP, 4 SafeOP, 8 OP"),
        (InvalidArgument::Group(5), "group 5 is above 4"),
        (
            InvalidArgument::Kind { slave: 9, nibble: 14 },
            "slave 9 has kind 0xE: none of 0 drive, 1 IO, 2 HSP, 3 STEP, F none",
        ),
        (InvalidArgument::CycleTime(750), "cycle time 750 us is not 250 us * 2^n up to 1 s"),
        (InvalidArgument::FifoAction(3), "FIFO action 3 is neither 1 clear nor 2 threshold"),
        (InvalidArgument::ZeroThreshold, "FIFO threshold 0 could never be reached"),
        (InvalidArgument::DriveMode(6), "mode 6 is none of 8 CSP, 9 CSV, 10 CST"),
        (InvalidArgument::SdoSlave(41), "the board has no slave 41"),
        (InvalidArgument::SubIndex(256), "sub-index 256 is above 255"),
        (InvalidArgument::SdoSize(3), "object size 3 is none of 1, 2, 4 bytes"),
    ] {
        assert_eq!(reason.to_string(), text);
    }
}
