//! The position of every field of a frame, byte by byte, as in the guide's tables.

use ecmsk::cia402::Statusword;
use ecmsk::coe::{AbortCode, ObjectAddress};
use ecmsk::sk::{
    AxisTarget, CommandId, DriveResponse, Frame, HspAxis, HspResponse, IoResponse, MASTER_CYCLIC, MasterCommand,
    MasterResponse, MasterState, Motion, RawSlot, SdoResponse, SlaveCommand, SlaveResponse, SlotCommand, SlotSize,
    StateByte,
};
use vectors::rubbish;

const NARROW: SlotSize = SlotSize::Bytes12;
const WIDE: SlotSize = SlotSize::Bytes16;

/// The bytes a slot takes on the wire.
fn bytes(size: SlotSize, slot: &RawSlot) -> Vec<u8> {
    let mut frame = rubbish();
    frame.put(size, 1, slot);
    frame.bytes()[size.bytes()..2 * size.bytes()].to_vec()
}

/// The slot with those bytes.
fn slot(size: SlotSize, bytes: &[u8]) -> RawSlot {
    let mut frame = rubbish();
    frame.bytes_mut()[size.bytes()..2 * size.bytes()].copy_from_slice(bytes);
    frame.slot(size, 1)
}

/// SK-1.1 42 slots of 12 bytes, 504 in all, the default; SK-1.2 32 slots of 16 bytes, 512 in all.
#[test]
fn frames_have_42_slots_of_12_or_32_slots_of_16_bytes() {
    assert_eq!((NARROW.slots(), NARROW.bytes(), NARROW.frame_len()), (42, 12, 504));
    assert_eq!((WIDE.slots(), WIDE.bytes(), WIDE.frame_len()), (32, 16, 512));
    assert_eq!(SlotSize::default(), NARROW);
    for n in 0..=512 {
        assert_eq!(SlotSize::from_bytes(n).map(SlotSize::bytes), [12, 16].into_iter().find(|size| *size == n));
    }
    assert_eq!((rubbish().wire(NARROW).len(), rubbish().wire(WIDE).len()), (504, 512));
}

/// SK-1.3 Slot 0 is the ECM, 1..=40 (1..=30) are the slaves, the last is the SDO slot; each starts where the one
/// before ends.
#[test]
fn slots_lie_one_behind_the_other() {
    assert_eq!((NARROW.max_slaves(), NARROW.sdo_slot()), (40, 41));
    assert_eq!((WIDE.max_slaves(), WIDE.sdo_slot()), (30, 31));
    for size in SlotSize::ALL {
        for i in 0..size.slots() {
            let mut frame = rubbish();
            frame.put(size, i, &RawSlot { id: 0x11, ..RawSlot::ZERO });
            let mut expected = [0xA5; 512];
            let own = &mut expected[i * size.bytes()..(i + 1) * size.bytes()];
            own.fill(0);
            own[0] = 0x11;
            assert_eq!(frame.bytes(), &expected, "slot {i} of {} bytes", size.bytes());
        }
    }
}

/// SK-1.4 Little endian: CMD, Parm, Data1, Data2, Data3; SK-1.5 each at its bytes; SK-1.6 under these names.
#[test]
fn the_fields_of_a_slot_are_little_endian_at_their_bytes() {
    let wide: Vec<u8> = (0x10..0x20).collect();
    let fields = RawSlot { id: 0x10, index: 0x11, parm: 0x1312, data1: 0x1716_1514, data2: 0x1B1A_1918, data3: 0 };
    let all = RawSlot { data3: 0x1F1E_1D1C, ..fields };
    assert_eq!(slot(NARROW, &wide[..12]), fields);
    assert_eq!(slot(WIDE, &wide), all);
    assert_eq!(bytes(NARROW, &fields), wide[..12]);
    assert_eq!(bytes(WIDE, &all), wide);
    assert_eq!((all.data2_low(), all.data2_high()), (0x1918, 0x1B1A));
}

/// SK-1.7 A 12-byte slot has no Data3: it is not written, and read as 0.
#[test]
fn data3_needs_sixteen_bytes() {
    let raw = RawSlot { data3: u32::MAX, ..RawSlot::ZERO };
    assert_eq!(bytes(NARROW, &raw), [0; 12]);
    assert_eq!(slot(NARROW, &[0xFF; 12]).data3, 0);
}

/// SK-1.8 In slot 0 byte 2 alone is an argument: byte 3, the CRC, changes no command, known or not, and none sets it.
#[test]
fn byte_3_of_slot_0_is_no_argument() {
    for id in 0..=255 {
        let plain = RawSlot { id, index: 0, parm: 2, data1: 8, data2: 1, data3: 0 };
        let with_crc = RawSlot { parm: 0xE702, ..plain };
        let decoded = MasterCommand::decode(&plain, NARROW);
        assert_eq!(MasterCommand::decode(&with_crc, NARROW), decoded, "id 0x{id:02X}");
        if let Ok(command) = decoded {
            let mut frame = rubbish();
            frame.put_master(NARROW, &command);
            assert_eq!(frame.crc_byte(), 0, "id 0x{id:02X}");
        }
    }
    let other = MasterCommand::Other(RawSlot { id: 0x77, parm: 0xE702, ..RawSlot::ZERO });
    assert_eq!(other.encode().parm, 0x0002);
    assert_eq!(MasterResponse::decode(&RawSlot { parm: 0xE708, ..RawSlot::ZERO }).state, StateByte(8));
}

/// Byte 1 of a command that is not in the guides is also the index given with it, whatever its original slot had.
#[test]
fn index_of_an_unknown_command() {
    let raw = RawSlot { id: 0x77, index: 5, parm: 1, data1: 2, data2: 3, data3: 0 };
    let command = SlotCommand { index: 2, command: SlaveCommand::Other(raw) };
    assert_eq!(command.encode(NARROW), RawSlot { index: 2, ..raw });
}

/// SK-2.8 Byte 2 is the state; SK-2.10 byte 3 the CRC; SK-2.11 bytes 4..7 the result; SK-2.14 bytes 8..9 the free
/// entries; SK-2.15 bytes 10..11 the full count. Byte 0 is an id, byte 1 the error code.
#[test]
fn slot_0_of_a_response_has_state_crc_result_and_fifo_counts() {
    let response = MasterResponse {
        id: MASTER_CYCLIC,
        error: 0x21,
        state: StateByte::reached(MasterState::Op),
        result: 0x4433_2211,
        fifo_free: 0x009F,
        full_count: 0x7E01,
    };
    for size in SlotSize::ALL {
        let mut frame = rubbish();
        frame.put(size, 0, &response.encode());
        assert_eq!(frame.bytes()[..12], [0xBF, 0x21, 0x08, 0, 0x11, 0x22, 0x33, 0x44, 0x9F, 0x00, 0x01, 0x7E]);
        frame.fill_crc(size);
        assert_eq!(frame.bytes()[3], frame.crc(size));
        assert_eq!(MasterResponse::decode(&frame.slot(size, 0)), response);
    }
    assert_eq!(bytes(WIDE, &response.encode())[12..], [0; 4]);
}

/// SK-2.12 After LIO_RD the inputs are in bytes 4..7, SK-4.31 under its id.
#[test]
fn lio_rd_is_answered_with_the_inputs_in_the_result() {
    let raw = slot(NARROW, &[0x21, 0, 0x02, 0, 0b10_1101, 0, 0, 0, 0, 0, 0, 0]);
    let response = MasterResponse::decode(&raw);
    assert_eq!((response.id, response.result), (CommandId::LocalRead.code(), 0b10_1101));
}

/// SK-2.3 A decoder accepts the ids of SET_FIFO and LIO in OP as well as 0xBF.
#[test]
fn any_id_is_accepted_in_slot_0_of_a_response() {
    for id in [MASTER_CYCLIC, 0x05, 0x21, 0x22] {
        let raw = slot(NARROW, &[id, 0, 0x08, 0, 0x15, 0, 0, 0, 0xA0, 0, 0, 0]);
        let response = MasterResponse::decode(&raw);
        assert_eq!((response.id, response.state.state(), response.fifo_free), (id, Some(MasterState::Op), 160));
    }
}

/// SK-3.12 Statusword in 2..3, position in 4..7, torque in 8..9, error code in 10..11; SK-3.19 a stepper's slot is the
/// same. Byte 0 is an id, byte 1 an index or a mode.
#[test]
fn the_slot_of_a_drive_has_statusword_position_torque_and_error_code() {
    let drive = DriveResponse {
        head: SlaveResponse { id: 0x15, index: 7 },
        statusword: Statusword(0x1637),
        position: -2,
        torque: -37,
        error_code: 0xFF10,
    };
    let wire = [0x15, 7, 0x37, 0x16, 0xFE, 0xFF, 0xFF, 0xFF, 0xDB, 0xFF, 0x10, 0xFF];
    assert_eq!(bytes(NARROW, &drive.encode()), wire);
    assert_eq!(bytes(WIDE, &drive.encode()), [wire.as_slice(), &[0; 4]].concat());
    assert_eq!(DriveResponse::decode(&slot(NARROW, &wire)), drive);
}

/// SK-3.13 IO_RD: inputs in Data1; SK-3.14 IO_WR: the output image there; SK-3.15 GET_STATUS: CMD 0, inputs;
/// SK-3.16 the upper half is 0, and not read; SK-4.23, SK-4.24 under these ids.
#[test]
fn the_slot_of_an_io_slave_has_inputs_or_outputs_in_data1() {
    for (id, index) in [(0x13, 9), (0x14, 255), (0x00, 0)] {
        let io = IoResponse { head: SlaveResponse { id, index }, bits: 0xBEEF };
        let mut wire = [id, index, 0, 0, 0xEF, 0xBE, 0, 0, 0, 0, 0, 0];
        assert_eq!(bytes(NARROW, &io.encode()), wire);
        assert_eq!(IoResponse::decode(&slot(NARROW, &wire)), io);
        wire[6..8].fill(0xFF);
        assert_eq!(IoResponse::decode(&slot(NARROW, &wire)), io);
    }
}

fn hsp(second: HspAxis) -> HspResponse {
    HspResponse {
        head: SlaveResponse { id: 0x15, index: 2 },
        statusword: Statusword(0x1637),
        first: HspAxis { position: 0x1122_3344, inputs: 0x5566 },
        second,
    }
}

/// SK-3.21 HSP in 12-byte mode: inputs in 8..9, bytes 10..11 are 0 and axis 2 does not travel;
/// SK-3.24 one channel in 16-byte mode: bytes 10..15 are 0.
#[test]
fn the_slot_of_a_one_channel_hsp_has_inputs_in_bytes_8_and_9() {
    let wire = [0x15, 2, 0x37, 0x16, 0x44, 0x33, 0x22, 0x11, 0x66, 0x55, 0, 0];
    let two = hsp(HspAxis { position: -1, inputs: 0xFFFF });
    let one = hsp(HspAxis::default());
    assert_eq!(bytes(NARROW, &two.encode(NARROW)), wire);
    assert_eq!(bytes(WIDE, &one.encode(WIDE)), [wire.as_slice(), &[0; 4]].concat());
    assert_eq!(HspResponse::decode(&slot(NARROW, &wire), NARROW), one);
    let mut odd = wire;
    odd[10..].fill(0xFF);
    assert_eq!(HspResponse::decode(&slot(NARROW, &odd), NARROW), one);
}

/// SK-3.22 Two-channel HSP: position 2 is the unaligned field at byte 10, inputs 2 are in 14..15; SK-3.25 whatever
/// command is answered, and of commands CSP and CSV alone read bytes 8..15.
#[test]
fn the_slot_of_a_two_channel_hsp_has_position_2_at_byte_10() {
    for id in [0x00, 0x10, 0x11, 0x12, 0x15, 0x16, 0x18, 0x19] {
        let mut two = hsp(HspAxis { position: i32::from_le_bytes([0xA1, 0xA2, 0xA3, 0xA4]), inputs: 0xB2B1 });
        two.head.id = id;
        let wire = [id, 2, 0x37, 0x16, 0x44, 0x33, 0x22, 0x11, 0x66, 0x55, 0xA1, 0xA2, 0xA3, 0xA4, 0xB1, 0xB2];
        assert_eq!(bytes(WIDE, &two.encode(WIDE)), wire);
        assert_eq!(HspResponse::decode(&slot(WIDE, &wire), WIDE), two);

        let short = RawSlot { data2: 0, data3: 0, ..slot(WIDE, &wire) };
        let reads_them = SlotCommand::decode(&slot(WIDE, &wire), WIDE) != SlotCommand::decode(&short, WIDE);
        assert_eq!(reads_them, matches!(id, 0x15 | 0x16), "0x{id:02X}");
    }
}

/// SK-3.23 CSP and CSV of a two-channel HSP: target 1 in 4..7, outputs 1 in 8..9, target 2 in 10..13 (unaligned),
/// outputs 2 in 14..15; in 12-byte mode axis 2 does not travel.
#[test]
fn csp_and_csv_of_a_two_channel_hsp_have_target_2_at_byte_10() {
    let first = AxisTarget { target: 0x1122_3344, outputs: 0x5566 };
    let second = AxisTarget { target: i32::from_le_bytes([0xA1, 0xA2, 0xA3, 0xA4]), outputs: 0xB2B1 };
    for (id, command) in [(0x15, SlaveCommand::Csp as fn(Motion) -> _), (0x16, SlaveCommand::Csv)] {
        let both = command(Motion { first, second }).with_index(3);
        let wire = [id, 3, 0, 0, 0x44, 0x33, 0x22, 0x11, 0x66, 0x55, 0xA1, 0xA2, 0xA3, 0xA4, 0xB1, 0xB2];
        assert_eq!(bytes(WIDE, &both.encode(WIDE)), wire);
        assert_eq!(SlotCommand::decode(&slot(WIDE, &wire), WIDE), Ok(both));

        let mut frame = rubbish();
        frame.put_slave(NARROW, 1, &both);
        assert_eq!(frame.bytes()[12..24], [&wire[..10], &[0, 0]].concat());
        let one = command(Motion { first, second: AxisTarget::default() }).with_index(3);
        assert_eq!(SlotCommand::decode(&slot(NARROW, &wire[..12]), NARROW), Ok(one));
    }
}

/// SK-4.17, SK-4.18 The answer: Parm = slave with high byte 0, Data1 = index << 16 | sub-index, Data2 = value;
/// under id 7 or 8, SK-3.7 byte 1 being 0.
#[test]
fn an_sdo_answer_repeats_slave_and_object_with_the_value() {
    for (id, command) in [(CommandId::SdoRead, 7), (CommandId::SdoWrite, 8)] {
        let done = SdoResponse::Done { id, slave: 40, object: ObjectAddress::new(0x6099, 2), value: 0xFE };
        let wire = [command, 0, 40, 0, 2, 0, 0x99, 0x60, 0xFE, 0, 0, 0];
        assert_eq!(bytes(NARROW, &done.encode()), wire);
        assert_eq!(SdoResponse::decode(&slot(NARROW, &wire)), done);
    }
    assert_eq!(SdoResponse::decode(&RawSlot::ZERO), SdoResponse::Empty);
    assert_eq!(SdoResponse::Empty.encode(), RawSlot::ZERO);
}

/// SK-6.13 A failed transfer: Parm = slave | 0x8000, Data1 the same, Data2 = the abort code, so no program that waits
/// for Parm == slave takes the code for a value.
#[test]
fn an_aborted_sdo_has_bit_15_of_parm_and_the_abort_code() {
    for (id, command) in [(CommandId::SdoRead, 7), (CommandId::SdoWrite, 8)] {
        let (slave, object) = (3, ObjectAddress::new(0x5FFF, 1));
        let aborted = SdoResponse::Aborted { id, slave, object, code: AbortCode::NO_OBJECT };
        let wire = [command, 0, 3, 0x80, 1, 0, 0xFF, 0x5F, 0, 0, 0x02, 0x06];
        assert_eq!(bytes(NARROW, &aborted.encode()), wire);
        assert_eq!(SdoResponse::decode(&slot(NARROW, &wire)), aborted);
        assert_ne!(slot(NARROW, &wire).parm, u16::from(slave));
    }
}

/// SK-4.17, SK-4.18, SK-6.13 A slot that is not exactly such an answer is none, and is kept unchanged: any other bit of
/// Parm or of the sub-index's half, any other id, and an empty slot in which a single bit is set.
#[test]
fn a_slot_that_is_not_exactly_an_sdo_answer_is_kept_as_none() {
    let answer = RawSlot { id: 0x07, index: 0, parm: 3, data1: 0x6041_0000, data2: 5, data3: 0 };
    assert!(matches!(SdoResponse::decode(&answer), SdoResponse::Done { .. }));
    let parms = (8..15).map(|bit| RawSlot { parm: 3 | 1 << bit, ..answer });
    let subs = (8..16).map(|bit| RawSlot { data1: answer.data1 | 1 << bit, ..answer });
    let ids = (0..=255).filter(|id| !matches!(id, 7 | 8)).map(|id| RawSlot { id, ..answer });
    let nearly_empty = [
        RawSlot { index: 1, ..RawSlot::ZERO },
        RawSlot { parm: 0x8000, ..RawSlot::ZERO },
        RawSlot { data1: 1, ..RawSlot::ZERO },
        RawSlot { data2: 1, ..RawSlot::ZERO },
        RawSlot { data3: 1, ..RawSlot::ZERO },
    ];
    for raw in parms.chain(subs).chain(ids).chain(nearly_empty) {
        let other = SdoResponse::decode(&raw);
        assert_eq!(other, SdoResponse::Other(raw));
        assert_eq!(other.encode(), raw);
    }
}

/// A frame is built from fewer or more bytes than it has; missing bytes are 0.
#[test]
fn a_frame_is_made_of_any_number_of_bytes() {
    assert_eq!(Frame::from_prefix(&[]), Frame::new());
    assert_eq!(Frame::from_prefix(&[0xA5; 600]), rubbish());
    let short = Frame::from_prefix(&[0xA5; 504]);
    assert_eq!((&short.bytes()[..504], &short.bytes()[504..]), ([0xA5; 504].as_slice(), [0; 8].as_slice()));
}

/// A frame shows its first bytes where a test or a program prints it.
#[test]
fn a_frame_is_shown_by_its_first_bytes() {
    let mut frame = Frame::new();
    frame.bytes_mut()[..3].copy_from_slice(&[0xBF, 0x00, 0x18]);
    assert_eq!(format!("{frame:?}"), "Frame[bf001800000000000000000000000000..]");
}
