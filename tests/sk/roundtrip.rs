//! Round trips: every value of a type decodes to itself, and any bytes decode without a panic.

use ecmsk::cia402::{Mode, Statusword};
use ecmsk::coe::{AbortCode, ObjectAddress, SdoSize};
use ecmsk::sk::{
    AxisTarget, CommandDump, CommandId, CycleTime, DcShift, DriveResponse, DriveSync, FifoAction, Frame, HspAxis,
    HspResponse, IoResponse, MasterCommand, MasterResponse, MasterState, Motion, RawSlot, ResponseDump, SdoCommand,
    SdoResponse, SlaveCommand, SlaveKind, SlaveResponse, SlotCommand, SlotKind, SlotSize, StateByte,
};
use proptest::array::{uniform8, uniform32};
use proptest::prelude::*;

fn size() -> impl Strategy<Value = SlotSize> {
    proptest::sample::select(&SlotSize::ALL)
}

fn kind() -> impl Strategy<Value = SlaveKind> {
    use SlaveKind::{Drive, Hsp, Io, None, Step};
    proptest::sample::select(&[Drive, Io, Hsp, Step, None])
}

/// A slot with an id that is not allowed there; byte 3 and Data3 are 0 so that it fits everywhere.
fn foreign(kind: SlotKind) -> impl Strategy<Value = RawSlot> {
    let id = any::<u8>().prop_filter("a command of this slot", move |id| !CommandId::from_code(*id).belongs_in(kind));
    (id, any::<(u8, u8, u32, u32)>()).prop_map(|(id, (index, parm, data1, data2))| RawSlot {
        id,
        index,
        parm: parm.into(),
        data1,
        data2,
        data3: 0,
    })
}

fn master_command() -> impl Strategy<Value = MasterCommand> {
    use MasterCommand as M;
    let state =
        proptest::sample::select(&[MasterState::Init, MasterState::PreOp, MasterState::SafeOp, MasterState::Op]);
    let cycle = (0u32..=11).prop_map(|n| CycleTime::from_us(250 << n).expect("250 * 2^n"));
    let shift = prop_oneof![
        Just(DcShift::Auto),
        Just(DcShift::AutoHigh),
        any::<u32>().prop_filter("auto", |raw| !matches!(raw, 0xFFFF | 0xFFFF_0000)).prop_map(DcShift::Other),
    ];
    prop_oneof![
        Just(M::GetStatus),
        state.prop_map(M::SetState),
        (0u8..=4, uniform8(kind())).prop_map(|(group, kinds)| M::SetAxis { group, kinds }),
        (cycle, shift).prop_map(|(cycle, shift)| M::SetDc { cycle, shift }),
        any::<(bool, bool)>().prop_map(|(check_commands, fill_responses)| M::SetEx { check_commands, fill_responses }),
        Just(M::SetFifo(FifoAction::Clear)),
        (1..=u32::MAX).prop_map(|free| M::SetFifo(FifoAction::Threshold(free))),
        Just(M::LocalRead),
        (0u8..64).prop_map(M::LocalWrite),
        Just(M::SoftReset),
        foreign(SlotKind::Master).prop_map(M::Other),
    ]
}

fn motion(size: SlotSize) -> impl Strategy<Value = Motion> {
    any::<(i32, u16, i32, u16)>().prop_map(move |(target, outputs, target2, outputs2)| {
        let second = AxisTarget { target: target2, outputs: outputs2 };
        let travels = size == SlotSize::Bytes16;
        Motion { first: AxisTarget { target, outputs }, second: if travels { second } else { AxisTarget::default() } }
    })
}

fn slave_command(size: SlotSize) -> impl Strategy<Value = SlotCommand> {
    use SlaveCommand as S;
    let mode = proptest::sample::select(&[Mode::Csp, Mode::Csv, Mode::Cst]);
    let sync = proptest::sample::select(&[DriveSync::FreeRun, DriveSync::DcSync]);
    let plain = proptest::sample::select(&[
        S::GetStatus,
        S::AlarmClear,
        S::ServoOn,
        S::ServoOff,
        S::IoRead,
        S::GoHome,
        S::AbortHome,
    ]);
    let command = prop_oneof![
        plain,
        (mode, sync).prop_map(|(mode, sync)| S::DriveMode { mode, sync }),
        any::<u16>().prop_map(S::IoWrite),
        motion(size).prop_map(S::Csp),
        motion(size).prop_map(S::Csv),
        any::<i16>().prop_map(S::Cst),
    ];
    let known = (command, any::<u8>()).prop_map(|(command, index)| command.with_index(index));
    let foreign = foreign(SlotKind::Slave).prop_map(|raw| S::Other(raw).with_index(raw.index));
    prop_oneof![12 => known, 1 => foreign]
}

fn object() -> impl Strategy<Value = ObjectAddress> {
    any::<(u16, u8)>().prop_map(|(index, sub)| ObjectAddress::new(index, sub))
}

fn sdo_command(size: SlotSize) -> impl Strategy<Value = SdoCommand> {
    let slave = 1..=size.max_slaves() as u8;
    let bytes = proptest::sample::select(&[SdoSize::One, SdoSize::Two, SdoSize::Four]);
    prop_oneof![
        Just(SdoCommand::GetStatus),
        (slave.clone(), object()).prop_map(|(slave, object)| SdoCommand::Read { slave, object }),
        (slave, object(), bytes, any::<u32>()).prop_map(|(slave, object, size, value)| SdoCommand::Write {
            slave,
            object,
            size,
            value
        }),
        foreign(SlotKind::Sdo).prop_map(SdoCommand::Other),
    ]
}

fn head() -> impl Strategy<Value = SlaveResponse> {
    any::<(u8, u8)>().prop_map(|(id, index)| SlaveResponse { id, index })
}

fn sdo_response() -> impl Strategy<Value = SdoResponse> {
    let id = proptest::sample::select(&[CommandId::SdoRead, CommandId::SdoWrite]);
    (id, any::<(u8, bool, u32)>(), object()).prop_map(|(id, (slave, done, data2), object)| match done {
        true => SdoResponse::Done { id, slave, object, value: data2 },
        false => SdoResponse::Aborted { id, slave, object, code: AbortCode(data2) },
    })
}

fn frame() -> impl Strategy<Value = Frame> {
    uniform32(any::<[u8; 16]>()).prop_map(|rows| Frame::from_prefix(rows.as_flattened()))
}

/// A frame of slots that are often valid: ids from the list, small numbers.
fn likely_frame(size: SlotSize) -> impl Strategy<Value = Frame> {
    let id = prop_oneof![proptest::sample::select(&CommandId::ALL).prop_map(CommandId::code), any::<u8>()];
    let small = || prop_oneof![Just(0u32), 0u32..12, any::<u32>()];
    let slot = (id, any::<u8>(), 0u16..0x500, small(), small(), small())
        .prop_map(|(id, index, parm, data1, data2, data3)| RawSlot { id, index, parm, data1, data2, data3 });
    proptest::collection::vec(slot, size.slots()).prop_map(move |slots| {
        let mut frame = Frame::new();
        slots.iter().enumerate().for_each(|(i, slot)| frame.put(size, i, slot));
        frame
    })
}

/// The size and frames for it, any bytes or likely ones.
fn any_frame() -> impl Strategy<Value = (SlotSize, Frame)> {
    size().prop_flat_map(|size| (Just(size), prop_oneof![frame(), likely_frame(size)]))
}

proptest! {
    /// SK-4.1 Every command of slot 0 decodes to itself, ids that are not allowed there too; SK-1.8 with any CRC.
    #[test]
    fn every_command_of_slot_0_decodes_to_itself(command in master_command(), size in size(), crc: u8) {
        let mut frame = Frame::from_bytes([0xA5; 512]);
        frame.put_master(size, &command);
        frame.bytes_mut()[3] = crc;
        prop_assert_eq!(MasterCommand::decode(&frame.slot(size, 0), size), Ok(command));
    }

    /// SK-4.1 Every command of a slave decodes to itself with its index, in every slave's slot, unknown ids too;
    /// SK-3.23 in 16-byte mode with both axes.
    #[test]
    fn every_command_of_a_slave_decodes_to_itself(
        (size, command) in size().prop_flat_map(|size| (Just(size), slave_command(size))),
        place: prop::sample::Index,
    ) {
        let slave = 1 + place.index(size.max_slaves());
        let mut frame = Frame::from_bytes([0xA5; 512]);
        frame.put_slave(size, slave, &command);
        prop_assert_eq!(SlotCommand::decode(&frame.slot(size, slave), size), Ok(command));
    }

    /// SK-4.17, SK-4.18 Every SDO command decodes to itself, unknown ids too.
    #[test]
    fn every_sdo_command_decodes_to_itself((size, command) in size().prop_flat_map(|size| (Just(size), sdo_command(size)))) {
        let mut frame = Frame::from_bytes([0xA5; 512]);
        frame.put_sdo(size, &command);
        prop_assert_eq!(SdoCommand::decode(&frame.slot(size, size.sdo_slot()), size), Ok(command));
    }

    /// SK-2.11, SK-2.14, SK-2.15 The master slot of a response decodes to itself, with any content.
    #[test]
    fn every_response_in_slot_0_decodes_to_itself(
        (id, error, state) in any::<(u8, u8, u8)>(),
        (result, fifo_free, full_count) in any::<(u32, u16, u16)>(),
        size in size(),
        crc: u8,
    ) {
        let response = MasterResponse { id, error, state: StateByte(state), result, fifo_free, full_count };
        let mut frame = Frame::from_bytes([0xA5; 512]);
        frame.put(size, 0, &response.encode());
        frame.bytes_mut()[3] = crc;
        prop_assert_eq!(MasterResponse::decode(&frame.slot(size, 0)), response);
    }

    /// SK-3.12 A drive's slot decodes to itself, SK-3.19 a stepper's too; SK-3.13 an IO slave's; SK-3.21, SK-3.22 an
    /// HSP's.
    #[test]
    fn every_response_of_a_slave_decodes_to_itself(
        head in head(),
        (statusword, position, torque, error_code) in any::<(u16, i32, i16, u16)>(),
        (position2, inputs, inputs2) in any::<(i32, u16, u16)>(),
        size in size(),
    ) {
        let statusword = Statusword(statusword);
        let through = |slot: RawSlot| {
            let mut frame = Frame::from_bytes([0xA5; 512]);
            frame.put(size, 1, &slot);
            frame.slot(size, 1)
        };
        let drive = DriveResponse { head, statusword, position, torque, error_code };
        prop_assert_eq!(DriveResponse::decode(&through(drive.encode())), drive);
        let io = IoResponse { head, bits: inputs };
        prop_assert_eq!(IoResponse::decode(&through(io.encode())), io);
        let first = HspAxis { position, inputs };
        let second = match size {
            SlotSize::Bytes12 => HspAxis::default(),
            SlotSize::Bytes16 => HspAxis { position: position2, inputs: inputs2 },
        };
        let hsp = HspResponse { head, statusword, first, second };
        prop_assert_eq!(HspResponse::decode(&through(hsp.encode(size)), size), hsp);
    }

    /// SK-4.17, SK-4.18, SK-6.13 Every answer in the SDO slot decodes to itself; SK-3.7 byte 1 is written as 0 and not
    /// checked.
    #[test]
    fn every_sdo_answer_decodes_to_itself(response in sdo_response(), index: u8) {
        let slot = response.encode();
        prop_assert_eq!(slot.index, 0);
        prop_assert_eq!(SdoResponse::decode(&RawSlot { index, ..slot }), response);
    }

    /// SK-1.4 Any 512 bytes are a frame of raw slots, which writes the same bytes again.
    #[test]
    fn raw_slots_keep_every_byte(frame in frame(), size in size()) {
        let mut again = Frame::from_bytes([0xA5; 512]);
        for (i, slot) in frame.slots(size).iter().enumerate() {
            again.put(size, i, &slot);
            prop_assert_eq!(*frame.slots(size).head(i), slot.to_narrow());
        }
        prop_assert_eq!(again.wire(size), frame.wire(size));
    }

    /// SK-4.36 Any bytes decode without a panic: a valid slot has the same meaning when it is encoded again, an invalid
    /// one has a readable reason.
    #[test]
    fn any_command_frame_decodes((size, frame) in any_frame()) {
        for (i, slot) in frame.slots(size).iter().enumerate() {
            if let Ok(command) = MasterCommand::decode(&slot, size) {
                prop_assert_eq!(MasterCommand::decode(&command.encode(), size), Ok(command));
            }
            if let Ok(command) = SlotCommand::decode(&slot, size) {
                prop_assert_eq!(SlotCommand::decode(&command.encode(size), size), Ok(command));
            }
            if let Ok(command) = SdoCommand::decode(&slot, size) {
                prop_assert_eq!(SdoCommand::decode(&command.encode(), size), Ok(command));
            }
            prop_assert!(CommandDump::new(&frame, size).line(i).is_some());
        }
        prop_assert_eq!(CommandDump::new(&frame, size).all().to_string().lines().count(), size.slots());
    }

    /// SK-2.9, SK-3.12 Any bytes of a response decode without a panic, with any kinds of the slaves.
    #[test]
    fn any_response_frame_decodes((size, frame) in any_frame(), kinds in uniform8(kind()), mode_in_byte_1: bool) {
        for slot in frame.slots(size).iter() {
            let sdo = SdoResponse::decode(&slot);
            prop_assert_eq!(SdoResponse::decode(&sdo.encode()), sdo);
            let hsp = HspResponse::decode(&slot, size);
            prop_assert_eq!(HspResponse::decode(&hsp.encode(size), size), hsp);
            let drive = DriveResponse::decode(&slot);
            prop_assert_eq!(RawSlot { data3: slot.data3, ..drive.encode() }, slot);
        }
        let kinds: [SlaveKind; 40] = std::array::from_fn(|i| kinds[i % 8]);
        for dump in [ResponseDump::new(&frame, size), ResponseDump::new(&frame, size).kinds(&kinds)] {
            let dump = if mode_in_byte_1 { dump.mode_in_byte_1() } else { dump };
            prop_assert_eq!(dump.all().to_string().lines().count(), size.slots());
        }
    }
}
