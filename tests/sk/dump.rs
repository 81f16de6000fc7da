//! The readable dump: its texts, its completeness, and the same data as types.

use ecmsk::cia402::Mode;
use ecmsk::coe::{ObjectAddress, SdoSize};
use ecmsk::sk::dump::{ByteOne, KindEvidence, SlaveData, SlotMeaning, SlotRole};
use ecmsk::sk::{
    CommandDump, CommandId, CrcStatus, CycleTime, DcShift, DriveSync, FifoAction, Frame, InvalidArgument,
    MasterCommand, Motion, RawSlot, ResponseDump, SdoCommand, SlaveCommand, SlaveKind, SlotCommand, SlotSize,
};
use vectors::vector_named;

const NARROW: SlotSize = SlotSize::Bytes12;
const WIDE: SlotSize = SlotSize::Bytes16;

/// The line of slot `i` of a command frame that holds `slot` there.
fn command(size: SlotSize, i: usize, slot: RawSlot) -> String {
    let mut frame = Frame::new();
    frame.put(size, i, &slot);
    CommandDump::new(&frame, size).line(i).expect("a slot").to_string()
}

/// The line of slot `i` of a response frame in OP that holds `slot` there.
fn response(size: SlotSize, i: usize, slot: RawSlot, kinds: Option<SlaveKind>) -> String {
    let mut frame = Frame::new();
    frame.put(size, 0, &RawSlot { id: 0xBF, parm: 0x08, ..RawSlot::ZERO });
    frame.put(size, i, &slot);
    let kinds = kinds.map(|kind| [kind; 40]);
    let dump = ResponseDump::new(&frame, size);
    let dump = kinds.as_ref().map_or(dump, |kinds| dump.kinds(kinds));
    dump.line(i).expect("a slot").to_string()
}

/// SK-4.6, SK-4.17, SK-4.18, SK-4.25 The lines of the golden command frames.
#[test]
fn golden_command_frames_have_these_lines() {
    for (name, lines) in [
        ("all-zero-12", vec!["ECM      GET_STATUS, CRC 0x59 ok"]),
        ("set-state-preop", vec!["ECM      SET_STATE PreOP, CRC 0xE7 ok"]),
        (
            "set-axis-group0",
            vec!["ECM      SET_AXIS group 0: 1 DRIVE, 2 IO, 3 HSP, 4 DRIVE, 5 DRIVE, 6..8 none, CRC 0x40 ok"],
        ),
        ("set-axis-group4", vec!["ECM      SET_AXIS group 4: 33..40 none, CRC 0x53 ok"]),
        ("set-dc-2000", vec!["ECM      SET_DC 2000 us, auto shift, CRC 0x74 ok"]),
        ("set-ex-both", vec!["ECM      SET_EX command CRC check on, response CRC on, CRC 0xF1 ok"]),
        ("set-fifo-threshold", vec!["ECM      SET_FIFO threshold 120, CRC 0xAB ok"]),
        (
            "drive-mode-csp-1-4-5",
            vec![
                "ECM      GET_STATUS, CRC 0x2D ok",
                "slave 1  DRIVE_MODE CSP, DC sync",
                "slave 4  DRIVE_MODE CSP, DC sync",
                "slave 5  DRIVE_MODE CSP, DC sync",
            ],
        ),
        ("sdo-wr-6060-homing", vec!["ECM      GET_STATUS, CRC 0x3B ok", "SDO      SDO_WR slave 1 0x6060:0 u8 = 6"]),
        ("sdo-rd-603f-16", vec!["ECM      GET_STATUS, CRC 0xB6 ok", "SDO      SDO_RD slave 3 0x603F:0"]),
        ("csp-index-7", vec!["ECM      GET_STATUS, CRC 0xFA ok", "slave 1  CSP #7 target -1234567"]),
        (
            "csp-hsp-2ch-16",
            vec![
                "ECM      GET_STATUS, CRC 0x48 ok",
                "slave 1  CSP target -5, outputs 0x00FF; axis 2 target 123456789, outputs 0xAA55",
            ],
        ),
        ("io-wr", vec!["ECM      GET_STATUS, CRC 0xF0 ok", "slave 2  IO_WR outputs 0xA5C3"]),
        ("lio-wr", vec!["ECM      LIO_WR outputs 0b101010, CRC 0xA7 ok"]),
        ("sw-reset", vec!["ECM      SW_RESET, CRC 0xD2 ok"]),
        ("go-home-2", vec!["ECM      GET_STATUS, CRC 0x2D ok", "slave 2  GO_HOME"]),
        ("cst-negative", vec!["ECM      GET_STATUS, CRC 0x92 ok", "slave 1  CST torque -30.0 %"]),
        ("sv-on-index-255", vec!["ECM      GET_STATUS, CRC 0x99 ok", "slave 40 SV_ON #255"]),
        ("crc-wrong", vec!["ECM      SET_STATE Init, CRC 0x81 wrong (expected 0x7E)"]),
    ] {
        let vector = vector_named(name);
        assert_eq!(CommandDump::new(&vector.frame(), vector.size).to_string(), lines.join("\n"), "{name}");
    }
}

/// SK-2.15, SK-3.12, SK-3.22, SK-6.13 The lines of the golden response frames, with the slaves' kinds given.
#[test]
fn golden_response_frames_have_these_lines() {
    use SlaveKind::{Drive, Hsp, Io};
    let io_behind = |first| {
        let mut kinds = [Io; 40];
        kinds[0] = first;
        kinds[29] = first;
        kinds
    };
    for (name, kinds, lines) in [
        (
            "resp-op-fw17",
            io_behind(Drive),
            vec![
                "ECM      CYCLIC state OP, CRC errors 0, FIFO free 159, full count 1, CRC 0xFC ok",
                "slave 1  CSP #7 DRIVE statusword 0x1637 Operation enabled, position -1234560, torque 3.7 %, error code 0x0000",
                "slave 2  IO_RD IO inputs 0xBEEF",
            ],
        ),
        (
            "resp-op-16",
            io_behind(Drive),
            vec![
                "ECM      CYCLIC state OP, CRC errors 0, FIFO free 160, full count 0, CRC 0xAF ok",
                "slave 1  GO_HOME #1 DRIVE statusword 0x1437 Operation enabled, position 2147483647, torque 0.0 %, error code 0x0000",
                "slave 30 ABORT_HOME DRIVE statusword 0x0250 Switch on disabled, position -2147483648, torque 0.0 %, error code 0x0000",
            ],
        ),
        (
            "resp-hsp-2ch-16",
            io_behind(Hsp),
            vec![
                "ECM      CYCLIC state OP, CRC errors 0, FIFO free 160, full count 0, CRC 0xDE ok",
                "slave 1  CSV #3 HSP statusword 0x1637 Operation enabled, position 70000, inputs 0x0001; axis 2 position -70000, inputs 0x8000",
            ],
        ),
        (
            "resp-sdo-rd",
            io_behind(Drive),
            vec![
                "ECM      GET_STATUS state PreOP, CRC errors 0, CRC 0xC4 ok",
                "SDO      SDO_RD slave 3 0x6041:0 = 592 (0x00000250)",
            ],
        ),
        (
            "resp-sdo-abort",
            io_behind(Drive),
            vec![
                "ECM      GET_STATUS state PreOP, CRC errors 0, CRC 0x74 ok",
                "SDO      SDO_RD slave 3 0x5FFF:0 aborted: 0x06020000 (object does not exist in the object dictionary)",
            ],
        ),
        (
            "resp-preop-nocrc",
            io_behind(Drive),
            vec!["ECM      SET_AXIS state PreOP, 5 slaves found, CRC errors 0, CRC absent"],
        ),
    ] {
        let vector = vector_named(name);
        let frame = vector.frame();
        assert_eq!(ResponseDump::new(&frame, vector.size).kinds(&kinds).to_string(), lines.join("\n"), "{name}");
    }
}

/// SK-3.5 Firmware 1.5 has the mode in byte 1.
#[test]
fn firmware_1_5_shows_the_mode_of_byte_1() {
    let vector = vector_named("resp-op-fw15");
    let frame = vector.frame();
    let dump = ResponseDump::new(&frame, vector.size).kinds(&[SlaveKind::Drive; 40]).mode_in_byte_1();
    let line = dump.line(1).expect("slave 1");
    assert_eq!(
        line.to_string(),
        "slave 1  CSP mode CSP DRIVE statusword 0x9637 Operation enabled, position -1234560, torque -3.7 %, error code 0xFF10"
    );
    let SlotMeaning::SlaveResponse(reading) = line.meaning else { panic!("{line:?}") };
    assert_eq!(reading.byte_one, ByteOne::Mode(Mode::Csp.code()));
    assert_eq!(dump.line(2).expect("slave 2").to_string().split_whitespace().nth(2), Some("IO_RD"));
}

/// SK-4.36 A malformed argument shows the raw fields and the reason; so does an id that is unknown or out of place.
#[test]
fn what_has_no_meaning_shows_its_fields() {
    let slot = |id, parm, data1| RawSlot { id, index: 0x0A, parm, data1, data2: 2, data3: 0 };
    let fields = "data1 0x00000003 data2 0x00000002";
    for (i, slot, line) in [
        (
            0,
            slot(0x01, 0xE7, 3),
            format!(
                "ECM      SET_STATE byte 1 0x0A byte 2 0xE7 {fields}: state 3 is none of 1 Init, 2 PreOP, 4 SafeOP, 8 OP, CRC absent"
            ),
        ),
        (
            0,
            slot(0x15, 0, 3),
            format!("ECM      CSP byte 1 0x0A byte 2 0x00 {fields}: not a command for the ECM, CRC absent"),
        ),
        (
            0,
            slot(0xBF, 0, 3),
            format!("ECM      UNKNOWN(0xBF) byte 1 0x0A byte 2 0x00 {fields}: no such command, CRC absent"),
        ),
        (
            7,
            slot(0x06, 0, 3),
            format!("slave 7  DRIVE_MODE index 0x0A parm 0x0000 {fields}: mode 3 is none of 8 CSP, 9 CSV, 10 CST"),
        ),
        (
            7,
            slot(0x01, 0, 3),
            format!("slave 7  SET_STATE #10 index 0x0A parm 0x0000 {fields}: not a command for a slave"),
        ),
        (
            7,
            slot(0x77, 0x1234, 3),
            format!("slave 7  UNKNOWN(0x77) #10 index 0x0A parm 0x1234 {fields}: no such command"),
        ),
        (
            41,
            slot(0x08, 0x0301, 3),
            format!("SDO      SDO_WR index 0x0A parm 0x0301 {fields}: object size 3 is none of 1, 2, 4 bytes"),
        ),
        (
            41,
            slot(0x11, 0, 3),
            format!("SDO      SV_ON index 0x0A parm 0x0000 {fields}: not a command for the SDO slot"),
        ),
    ] {
        assert_eq!(command(NARROW, i, slot), line);
    }
    assert_eq!(
        command(WIDE, 2, RawSlot { data3: 9, ..slot(0x77, 0, 3) }),
        "slave 2  UNKNOWN(0x77) #10 index 0x0A parm 0x0000 data1 0x00000003 data2 0x00000002 data3 0x00000009: no such command"
    );
    assert_eq!(
        response(NARROW, 41, slot(0x15, 1, 3), None),
        format!("SDO      CSP index 0x0A parm 0x0001 {fields}: no answer to an SDO command")
    );
}

/// SK-1.7 Bytes that a command does not use are shown, too.
#[test]
fn bytes_that_a_command_does_not_use_are_shown() {
    assert_eq!(
        command(NARROW, 3, RawSlot { data2: 0x0001_0000, ..RawSlot::ZERO }),
        "slave 3  GET_STATUS (more bytes are set: index 0x00 parm 0x0000 data1 0x00000000 data2 0x00010000)"
    );
    assert_eq!(
        command(WIDE, 3, RawSlot { id: 0x11, data3: 1, ..RawSlot::ZERO }),
        "slave 3  SV_ON (more bytes are set: index 0x00 parm 0x0000 data1 0x00000000 data2 0x00000000 data3 0x00000001)"
    );
    assert_eq!(
        command(NARROW, 0, RawSlot { id: 0x05, parm: 1, data1: 9, ..RawSlot::ZERO }),
        "ECM      SET_FIFO clear (more bytes are set: byte 1 0x00 byte 2 0x01 data1 0x00000009 data2 0x00000000), CRC absent"
    );
    let line = response(NARROW, 5, RawSlot { id: 0x13, data1: 0x1_0001, ..RawSlot::ZERO }, Some(SlaveKind::Io));
    assert!(line.starts_with("slave 5  IO_RD IO inputs 0x0001 (more bytes are set: "), "{line}");
}

/// SK-4.8, SK-4.13, SK-4.16 The texts of the other commands.
#[test]
fn the_other_commands_have_these_words() {
    let master = |command: MasterCommand| self::command(WIDE, 0, command.encode());
    let slave = |command: SlaveCommand| self::command(NARROW, 12, SlotCommand::from(command).encode(NARROW));
    let axes = MasterCommand::SetAxis { group: 3, kinds: [SlaveKind::Step; 8] };
    let dc = |shift| MasterCommand::SetDc { cycle: CycleTime::DEFAULT, shift };
    let write = |size, value| {
        let object = ObjectAddress::new(0x607C, 1);
        self::command(NARROW, 41, SdoCommand::Write { slave: 40, object, size, value }.encode())
    };
    for (line, words) in [
        (master(axes), "ECM      SET_AXIS group 3: 25..30 STEP, 31..32 ignored, CRC absent"),
        (
            master(MasterCommand::SetAxis { group: 4, kinds: [SlaveKind::None; 8] }),
            "ECM      SET_AXIS group 4: 33..40 ignored, CRC absent",
        ),
        (master(dc(DcShift::AutoHigh)), "ECM      SET_DC 1000 us, auto shift (0xFFFF0000), CRC absent"),
        (master(dc(DcShift::Other(1))), "ECM      SET_DC 1000 us, shift 0x00000001 (without effect), CRC absent"),
        (master(MasterCommand::SetFifo(FifoAction::Clear)), "ECM      SET_FIFO clear, CRC absent"),
        (master(MasterCommand::LocalRead), "ECM      LIO_RD, CRC absent"),
        (
            slave(SlaveCommand::DriveMode { mode: Mode::Cst, sync: DriveSync::FreeRun }),
            "slave 12 DRIVE_MODE CST, free run",
        ),
        (slave(SlaveCommand::Csv(Motion::to(-9))), "slave 12 CSV velocity -9"),
        (slave(SlaveCommand::Cst(-5)), "slave 12 CST torque -0.5 %"),
        (slave(SlaveCommand::Cst(i16::MIN)), "slave 12 CST torque -3276.8 %"),
        (write(SdoSize::Two, 300), "SDO      SDO_WR slave 40 0x607C:1 u16 = 300"),
        (write(SdoSize::Four, 70_000), "SDO      SDO_WR slave 40 0x607C:1 u32 = 70000"),
        (write(SdoSize::One, 300), "SDO      SDO_WR slave 40 0x607C:1 u8 = 44 (of 0x0000012C)"),
    ] {
        assert_eq!(line, words);
    }
}

/// SK-3.13, SK-3.12 Without kinds a slot is interpreted as far as its bytes determine it, and a guess is marked as one.
#[test]
fn a_guessed_kind_is_marked_as_a_guess() {
    let raw = |id, parm, data1, data2, data3| RawSlot { id, index: 0, parm, data1, data2, data3 };
    let status = "statusword 0x0250 Switch on disabled, position 5";
    for (slot, rest) in [
        (raw(0x13, 0, 5, 0, 0), "IO_RD IO inputs 0x0005".to_owned()),
        (raw(0x14, 0, 5, 0, 0), "IO_WR IO outputs 0x0005".to_owned()),
        (raw(0x17, 0x0250, 5, 1, 0), format!("CST DRIVE {status}, torque 0.1 %, error code 0x0000")),
        (raw(0x15, 0x0250, 5, 1, 0), format!("CSP DRIVE? {status}, torque 0.1 %, error code 0x0000")),
        (raw(0x00, 0x0250, 5, 1, 0), format!("GET_STATUS DRIVE? {status}, torque 0.1 %, error code 0x0000")),
        (
            raw(0x15, 0, 0, 0, 0),
            "CSP DRIVE? statusword 0x0000 Not ready to switch on, position 0, torque 0.0 %, error code 0x0000".to_owned(),
        ),
        (raw(0x00, 0x0250, 5, 1, 0x0001_0000), format!("GET_STATUS HSP? {status}, inputs 0x0001; axis 2 position 0, inputs 0x0001")),
        (raw(0x00, 0, 5, 0, 0), "GET_STATUS IO? inputs 0x0005".to_owned()),
        (raw(0x00, 0, 0, 0, 0), "GET_STATUS".to_owned()),
        (
            raw(0x00, 0, 0x1_0000, 0, 0),
            "GET_STATUS index 0x00 parm 0x0000 data1 0x00010000 data2 0x00000000 data3 0x00000000: kind of slave unknown"
                .to_owned(),
        ),
    ] {
        assert_eq!(response(WIDE, 9, slot, None), format!("slave 9  {rest}"));
    }
    assert_eq!(
        response(NARROW, 9, raw(0x00, 0, 5, 0, 0), Some(SlaveKind::None)),
        "slave 9  GET_STATUS none index 0x00 parm 0x0000 data1 0x00000005 data2 0x00000000: there should be no slave"
    );
    assert_eq!(
        response(NARROW, 9, raw(0x16, 0x004F, 5, 0, 0), Some(SlaveKind::Step)),
        "slave 9  CSV STEP statusword 0x004F (no CiA 402 state), position 5, torque 0.0 %, error code 0x0000"
    );
}

/// Axis 2 of an HSP is shown only if it is not 0.
#[test]
fn axis_2_of_an_hsp_is_shown_only_if_it_is_not_0() {
    let slot = |data3| RawSlot { id: 0x15, parm: 0x0250, data1: 5, data2: 1, data3, ..RawSlot::ZERO };
    let line = |size, data3| response(size, 9, slot(data3), Some(SlaveKind::Hsp));
    let first = "slave 9  CSP HSP statusword 0x0250 Switch on disabled, position 5, inputs 0x0001";
    assert_eq!(line(NARROW, 0), first);
    assert_eq!(line(WIDE, 0), first);
    assert_eq!(line(WIDE, 0x0001_0000), format!("{first}; axis 2 position 0, inputs 0x0001"));
}

/// SK-2.14, SK-2.15 In OP both counts of the FIFO are shown, elsewhere if one of them is not 0.
#[test]
fn fifo_counts_are_shown_in_op_or_if_they_are_not_0() {
    let line = |state, free: u32, full: u32| {
        response(NARROW, 0, RawSlot { id: 0xBF, parm: state, data2: full << 16 | free, ..RawSlot::ZERO }, None)
    };
    assert_eq!(line(8, 0, 0), "ECM      CYCLIC state OP, CRC errors 0, FIFO free 0, full count 0, CRC absent");
    assert_eq!(line(4, 0, 0), "ECM      CYCLIC state SafeOP, CRC errors 0, CRC absent");
    assert_eq!(line(4, 7, 0), "ECM      CYCLIC state SafeOP, CRC errors 0, FIFO free 7, full count 0, CRC absent");
    assert_eq!(line(4, 0, 7), "ECM      CYCLIC state SafeOP, CRC errors 0, FIFO free 0, full count 7, CRC absent");
}

/// SK-4.1 Before OP an answer may hold its id and index only: zeros are no values then, in OP they are.
#[test]
fn zeros_are_values_in_op_alone() {
    let mut frame = Frame::new();
    frame.put(NARROW, 0, &RawSlot { id: 0, parm: 0x02, ..RawSlot::ZERO });
    frame.put(NARROW, 1, &RawSlot { id: 0x06, index: 3, ..RawSlot::ZERO });
    let kinds = [SlaveKind::Drive; 40];
    let line = |frame: &Frame| ResponseDump::new(frame, NARROW).kinds(&kinds).line(1).expect("slave 1").to_string();
    assert_eq!(line(&frame), "slave 1  DRIVE_MODE #3 DRIVE");
    frame.put(NARROW, 0, &RawSlot { id: 0xBF, parm: 0x18, ..RawSlot::ZERO });
    assert!(line(&frame).starts_with("slave 1  DRIVE_MODE #3 DRIVE statusword 0x0000 "));
    assert_eq!(
        ResponseDump::new(&frame, NARROW).line(0).expect("slot 0").to_string(),
        "ECM      CYCLIC state OP (a slave failed), CRC errors 0, FIFO free 0, full count 0, CRC absent"
    );
}

/// SK-2.12 Inputs of the chip, and the result of another command.
#[test]
fn the_result_of_slot_0_is_shown_as_inputs_or_as_a_number() {
    let line = |id, data1| response(NARROW, 0, RawSlot { id, index: 255, parm: 0x02, data1, ..RawSlot::ZERO }, None);
    assert_eq!(line(0x21, 5), "ECM      LIO_RD state PreOP, inputs 0b000101, CRC errors 255, CRC absent");
    assert_eq!(line(0x00, 5), "ECM      GET_STATUS state PreOP, result 5, CRC errors 255, CRC absent");
    assert_eq!(line(0x77, 0), "ECM      UNKNOWN(0x77) state PreOP, CRC errors 255, CRC absent");
}

/// SK-1.3 Lines come with their slot's number and role, the idle ones on demand; slot 0 is always there.
#[test]
fn idle_slots_are_shown_only_on_demand() {
    for size in SlotSize::ALL {
        let mut frame = Frame::new();
        frame.put_slave(size, 2, &SlaveCommand::ServoOn.into());
        let command = CommandDump::new(&frame, size);
        let response = ResponseDump::new(&frame, size);
        let numbers = |lines: &mut dyn Iterator<Item = (usize, ecmsk::sk::dump::SlotLine)>| -> Vec<usize> {
            lines.map(|(i, _)| i).collect()
        };
        assert_eq!(numbers(&mut command.lines()), [0, 2]);
        assert_eq!(numbers(&mut response.lines()), [0, 2]);
        let every: Vec<usize> = (0..size.slots()).collect();
        assert_eq!(numbers(&mut command.all().lines()), every);
        assert_eq!(numbers(&mut response.all().lines()), every);
        for i in every {
            let role = match i {
                0 => SlotRole::Master,
                i if i == size.slots() - 1 => SlotRole::Sdo,
                i => SlotRole::Slave(i as u8),
            };
            assert_eq!(command.line(i).map(|line| line.role), Some(role));
            assert_eq!(response.line(i).map(|line| line.role), Some(role));
            assert_eq!(command.line(i).and_then(|line| line.crc).is_some(), i == 0);
        }
        assert_eq!((command.line(size.slots()), response.line(size.slots())), (None, None));
        assert_eq!(SlotRole::of(size, usize::MAX), None);
    }
    assert_eq!(
        CommandDump::new(&Frame::new(), NARROW).all().line(41).expect("the SDO slot").to_string(),
        "SDO      GET_STATUS"
    );
    assert_eq!(
        ResponseDump::new(&Frame::new(), NARROW).all().line(41).expect("the SDO slot").to_string(),
        "SDO      no transfer yet"
    );
}

/// SK-4.17 The high byte that programs put into Parm of SDO_RD is shown, and is no mistake.
#[test]
fn a_read_with_a_size_in_parm() {
    let slot = RawSlot { id: 0x07, parm: 0x0201, data1: 0x6041_0000, ..RawSlot::ZERO };
    let line = "SDO      SDO_RD slave 1 0x6041:0 (0x02 above the slave's number is not looked at)";
    assert_eq!(command(NARROW, 41, slot), line);
    assert_eq!(command(NARROW, 41, RawSlot { parm: 1, ..slot }), "SDO      SDO_RD slave 1 0x6041:0");
    let more = command(NARROW, 41, RawSlot { data2: 9, ..slot });
    assert!(more.starts_with(line) && more.contains("more bytes are set"), "{more}");
}

/// SK-3.12, SK-4.25 The same as types, for tools with other output formats than text.
#[test]
fn the_lines_of_a_dump_are_available_as_types() {
    let vector = vector_named("csp-index-7");
    let frame = vector.frame();
    let lines: Vec<_> = CommandDump::new(&frame, vector.size).lines().map(|(_, line)| line).collect();
    assert_eq!(lines[0].meaning, SlotMeaning::MasterCommand(MasterCommand::GetStatus));
    assert_eq!(lines[0].crc, Some(CrcStatus::Right(0xFA)));
    assert_eq!(lines[1].meaning, SlotMeaning::SlaveCommand(SlaveCommand::Csp(Motion::to(-1_234_567)).with_index(7)));
    assert_eq!(lines[1].raw, vector.slots[1]);

    let mut frame = Frame::new();
    frame.put(NARROW, 41, &RawSlot { id: 0x07, parm: 41, ..RawSlot::ZERO });
    let line = CommandDump::new(&frame, NARROW).line(41).expect("the SDO slot");
    assert_eq!(line.meaning, SlotMeaning::Malformed(InvalidArgument::SdoSlave(41)));
    assert_eq!(line.meaning.encode(NARROW), None);

    let vector = vector_named("resp-op-fw17");
    let frame = vector.frame();
    let line = ResponseDump::new(&frame, vector.size).line(1).expect("slave 1");
    let SlotMeaning::SlaveResponse(reading) = line.meaning else { panic!("{line:?}") };
    assert_eq!((reading.id, reading.byte_one), (CommandId::Csp, ByteOne::Index(7)));
    assert_eq!((reading.kind, reading.kind.kind()), (KindEvidence::Guessed(SlaveKind::Drive), Some(SlaveKind::Drive)));
    let SlaveData::Drive(drive) = reading.data else { panic!("{line:?}") };
    assert_eq!((drive.position, drive.torque), (-1_234_560, 37));
}
