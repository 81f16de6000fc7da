//! The slots of slaves and the SDO slot in a response.

use ecmsk::cia402::Mode;
use ecmsk::coe::{ObjectAddress, SdoSize};
use ecmsk::engine::{EngineConfig, Firmware};
use ecmsk::sk::{
    DriveSync, FIFO_ENTRIES, IoResponse, MasterCommand, MasterState, RawSlot, SdoCommand, SdoResponse, SlaveCommand,
    SlaveKind, SlotSize, StateByte,
};

use crate::host::Host;
use crate::probe::{Bench, MEASURED, any_slaves, drives};

/// Slaves 1 to 3 in CSP, CSV and CST, 4 an IO slave; the board is in PreOP.
fn board(slot: SlotSize, firmware: Firmware) -> Host {
    let config = EngineConfig { slot, firmware, ..EngineConfig::default() };
    let Bench { mut host, .. } = Bench::new(config, any_slaves(4));
    let mut kinds = [SlaveKind::Drive; 8];
    kinds[3] = SlaveKind::Io;
    host.master(MasterCommand::SetAxis { group: 0, kinds });
    for (slave, mode) in [(1, Mode::Csp), (2, Mode::Csv), (3, Mode::Cst)] {
        host.slave(slave, SlaveCommand::DriveMode { mode, sync: DriveSync::DcSync });
    }
    host
}

fn with_index(id: u8, index: u8) -> RawSlot {
    RawSlot { id, index, ..RawSlot::ZERO }
}

fn head(host: &Host, slave: usize) -> (u8, u8) {
    let slot = host.slot(slave);
    (slot.id, slot.index)
}

/// SK-3.1 Byte 0 is the id of the command executed last for the slave.
/// SK-3.4 In profile 1.7 byte 1 is the index of the command answered.
/// SK-3.6 Profile 1.7 is the default.
#[test]
fn id_and_index_of_the_command_executed_last() {
    assert_eq!(EngineConfig::default().firmware, Firmware::V17);
    for size in SlotSize::ALL {
        let mut host = board(size, EngineConfig::default().firmware);
        host.raw(1, RawSlot { data1: 8, data2: 1, ..with_index(0x06, 0xFF) }).cycle();
        assert_eq!(head(&host, 1), (0x06, 0xFF), "{size:?}");
        host.go(MasterState::Op).raw(1, with_index(0x12, 0x5A)).cycle();
        assert_eq!((head(&host, 1), head(&host, 2)), ((0x12, 0x5A), (0x00, 0x00)), "{size:?}");

        // Two frames wait in the FIFO: each is shown when it is executed, and the last one stays.
        host.raw(1, with_index(0x11, 1)).raw(1, with_index(0x12, 2));
        assert_eq!(head(&host, 1), (0x12, 0x5A), "{size:?}");
        for expected in [(0x11, 1), (0x12, 2), (0x12, 2), (0x12, 2)] {
            host.cycle();
            assert_eq!(head(&host, 1), expected, "{size:?}");
        }
    }
}

/// SK-3.2 Byte 0 of a slave's slot is 0 for GET_STATUS, in every state.
#[test]
fn get_status_shows_id_0() {
    for firmware in [Firmware::V17, Firmware::V15] {
        let mut host = board(SlotSize::Bytes12, firmware);
        host.cycle();
        assert_eq!(host.slot(3).id, 0x06);
        for state in [MasterState::PreOp, MasterState::Init, MasterState::PreOp, MasterState::SafeOp, MasterState::Op] {
            host.go(state);
            if state < MasterState::SafeOp {
                host.slave(1, SlaveCommand::DriveMode { mode: Mode::Csp, sync: DriveSync::DcSync }).cycle();
                assert_eq!(host.slot(1).id, 0x06, "{state}");
            }
            host.idle().cycle();
            (1..=40).for_each(|slave| assert_eq!(host.slot(slave).id, 0, "{state} slave {slave}"));
        }
        host.slave(1, SlaveCommand::ServoOff).cycle();
        assert_eq!(host.slot(1).id, 0x12);
        host.idle().cycle();
        assert_eq!(host.slot(1).id, 0x00);
    }
}

/// SK-3.5 In profile 1.5 byte 1 is the drive's mode of operation, 0 for an IO slave, whatever the index.
/// SK-3.6 The profile selects.
#[test]
fn profile_1_5_shows_the_mode() {
    for size in SlotSize::ALL {
        let mut host = board(size, Firmware::V15);
        for (data1, state) in [(10, MasterState::PreOp), (9, MasterState::Init), (8, MasterState::Init)] {
            host.go(state).raw(1, RawSlot { data1, ..with_index(0x06, 0x77) }).cycle();
            assert_eq!(head(&host, 1), (0x06, data1 as u8), "{size:?} {state}: the answer to DRIVE_MODE");
        }
        host.go(MasterState::PreOp).go(MasterState::Op);
        for id in [0x00, 0x12] {
            host.build(|frame, size| (1..=4).for_each(|slave| frame.put(size, slave, &with_index(id, 0x77)))).cycle();
            assert_eq!([1, 2, 3, 4].map(|slave| head(&host, slave).1), [8, 9, 10, 0], "{size:?} {id:X}");
        }
        host.write_object(2, 0x6060, 0, SdoSize::One, 6).unwrap();
        assert_eq!([1, 2, 3, 4].map(|slave| head(&host, slave).1), [8, 6, 10, 0], "{size:?}");
    }
}

/// SK-3.32 Outside OP GET_STATUS keeps all of a slave's slot but its id: in PreOP the result of DRIVE_MODE, below OP
/// the last values of OP. In profile 1.5 byte 1 is the mode of the command executed last, whatever is declared later.
#[test]
fn get_status_outside_op_keeps_the_last_result() {
    for (firmware, of_drive_mode, in_op) in [(Firmware::V17, 0x21, 0x43), (Firmware::V15, 9, 8)] {
        for size in SlotSize::ALL {
            let mut host = board(size, firmware);
            let drive_mode = |data1: u32| RawSlot { data1, data2: 1, ..with_index(0x06, 0x21) };
            host.raw(1, drive_mode(9)).cycle();
            let answered = host.slot(1);
            assert_eq!((answered.id, answered.index), (0x06, of_drive_mode), "{firmware:?}");
            for asked in [0x00, 0x77] {
                host.raw(1, with_index(0x00, asked)).cycle();
                assert_eq!(host.slot(1), RawSlot { id: 0, ..answered }, "{firmware:?} {size:?} {asked:x}");
            }
            host.master(MasterCommand::SetAxis { group: 0, kinds: [SlaveKind::Io; 8] }).cycle();
            assert_eq!(host.slot(1), RawSlot { id: 0, ..answered }, "{firmware:?}: no command was executed for it");
            host.master(MasterCommand::SetAxis { group: 0, kinds: [SlaveKind::Drive; 8] });
            host.raw(1, drive_mode(8)).go(MasterState::Op).build(|frame, size| {
                frame.put(size, 1, &with_index(0x12, 0x43));
                frame.put_master(size, &MasterCommand::SetState(MasterState::SafeOp));
            });
            host.until("SafeOP", |host| host.state() == StateByte::reached(MasterState::SafeOp));
            let left = host.slot(1);
            assert!((left.id, left.index) == (0x12, in_op) && left.parm != 0, "{firmware:?}: {left:?}");
            host.raw(1, with_index(0x00, 0x77)).cycle();
            assert_eq!(host.slot(1), RawSlot { id: 0, ..left }, "{firmware:?} {size:?}");
        }
    }
}

/// SK-3.11 A drive's slot is refreshed in every cycle, whatever the command was, and without one.
/// SK-3.12 Parm is 0x6041, Data1 0x6064, Data2 low 0x6077, Data2 high 0x603F.
/// SK-1.7 Data3 is 0.
#[test]
fn a_drive_slot_is_refreshed_every_cycle() {
    for size in SlotSize::ALL {
        let mut host = board(size, Firmware::V17);
        host.go(MasterState::Op);
        let ids = [0x00, 0x10, 0x11, 0x12, 0x15, 0x16, 0x17, 0x18, 0x19];
        let mut last = host.drive(1).position;
        for id in ids {
            for sent in [true, false, false] {
                if sent {
                    host.raw(1, with_index(id, 0));
                }
                host.cycle();
                let slot = host.slot(1);
                assert_eq!(slot.data1 as i32, last + 1, "{size:?} {id:X}: one cycle has passed");
                assert_eq!(slot.parm, MEASURED.statusword.0, "{size:?} {id:X}");
                assert_eq!(slot.data2_low() as i16, MEASURED.torque, "{size:?} {id:X}");
                assert_eq!(slot.data2_high(), MEASURED.error_code, "{size:?} {id:X}");
                assert_eq!(slot.data3, 0, "{size:?} {id:X}");
                last += 1;
            }
        }
        assert_eq!(IoResponse::decode(&host.slot(4)).bits, MEASURED.inputs, "{size:?}");
    }
}

/// SK-1.7 Data3 of a command is ignored, in the board's slot, a drive's and the SDO slot.
/// SK-1.8 Byte 3 of slot 0 is no argument.
#[test]
fn data3_and_byte_3_are_no_arguments() {
    let mut host = board(SlotSize::Bytes16, Firmware::V17);
    let mark = host.mark();
    let with_data3 = |slot: RawSlot| RawSlot { data3: 0xDEAD_BEEF, ..slot };
    for byte_3 in [0x00, 0x01, 0xFF] {
        let mut frame = ecmsk::sk::Frame::new();
        frame.put(
            host.size,
            0,
            &with_data3(RawSlot { id: 0x02, parm: byte_3 << 8 | 4, data1: u32::MAX, ..RawSlot::ZERO }),
        );
        frame.put(host.size, 1, &with_data3(RawSlot { data1: 8, data2: 1, ..with_index(0x06, 3) }));
        host.send(&frame).cycle();
        assert_eq!((host.answer().id, host.answer().result), (0x02, 4));
        assert_eq!(head(&host, 1), (0x06, 3));
    }
    host.raw(31, with_data3(RawSlot { id: 0x07, parm: 1, data1: 0x1000 << 16, ..RawSlot::ZERO }));
    host.until("the SDO", |host| host.sdo_answer() != SdoResponse::Empty);
    assert_eq!((host.slot(31).data2, host.slot(31).data3), (0x1000, 0));
    assert_eq!(host.mark(), mark);
}

/// SK-1.9 A frame carries a command for every slot at once.
/// SK-4.43 Outside OP each frame is executed on arrival, in order, and the next report answers the last one.
#[test]
fn a_frame_speaks_to_every_slot() {
    for size in SlotSize::ALL {
        let mut host = board(size, Firmware::V17);
        let sdo = SdoCommand::Read { slave: 4, object: ObjectAddress::new(0x6041, 0) };
        host.cycle();
        let reports = host.reports;
        host.build(|frame, size| {
            frame.put_master(size, &MasterCommand::LocalWrite(0x3F));
            for slave in 1..=size.max_slaves() {
                frame.put(size, slave, &RawSlot { data1: 8, data2: 1, ..with_index(0x06, slave as u8) });
            }
            frame.put_sdo(size, &sdo);
        });
        host.master(MasterCommand::LocalRead);
        host.raw(2, RawSlot { data1: 10, ..with_index(0x06, 0xEE) });
        assert_eq!(host.reports, reports, "{size:?}: three frames in one cycle");
        host.cycle();
        assert_eq!((host.answer().id, host.board.engine().local_outputs()), (0x00, 0x3F), "{size:?}");
        for slave in 1..=size.max_slaves() {
            let expected = if slave == 2 { (0x06, 0xEE) } else { (0x00, slave as u8) };
            assert_eq!(head(&host, slave), expected, "{size:?} slave {slave}");
        }
        host.until("the SDO", |host| host.sdo_answer() != SdoResponse::Empty);
        assert_eq!(host.slot(size.sdo_slot()).data2, 0x6041, "{size:?}");
    }
}

/// SK-3.3 The SDO slot keeps 7 or 8 in byte 0 under GET_STATUS, in every state.
/// SK-3.7 Its byte 1 is 0.
/// SK-4.3 GET_STATUS in it answers the result of the last SDO.
/// SK-4.17 SDO_RD answers Parm = slave, Data1 the same, Data2 = the value.
/// SK-4.18 SDO_WR answers Parm = slave with the high byte 0, Data1 the same, Data2 = the value.
#[test]
fn the_sdo_slot_keeps_its_answer() {
    for size in SlotSize::ALL {
        let mut host = board(size, Firmware::V17);
        let place = size.sdo_slot();
        let read = RawSlot { parm: 3, data1: 0x6041_0000, data2: 0x55, ..with_index(0x07, 0x99) };
        let write = RawSlot { parm: 0x0404, data1: 0x607C_0001, data2: 0x8765_4321, ..with_index(0x08, 0x99) };
        // [OURS] The answer to a write of one byte shows all four bytes of the command, those beyond the object too.
        let byte = RawSlot { parm: 0x0104, data1: 0x6060_0000, data2: 0x8765_4308, ..write };
        let answers = [
            (read, RawSlot { data2: 0x6041, ..RawSlot { index: 0, ..read } }),
            (write, RawSlot { parm: 4, index: 0, ..write }),
            (byte, RawSlot { parm: 4, index: 0, ..byte }),
        ];
        for (request, answer) in answers {
            host.raw(place, request).until("the SDO", |host| {
                let RawSlot { id, data1, .. } = host.slot(place);
                (id, data1) == (request.id, request.data1)
            });
            assert_eq!(host.slot(place), answer, "{size:?}");
            for state in [MasterState::SafeOp, MasterState::Op, MasterState::Init, MasterState::PreOp] {
                if state == MasterState::SafeOp {
                    host.go(MasterState::PreOp);
                }
                host.go(state).idle().cycles(2);
                assert_eq!(host.slot(place), answer, "{size:?} {state}");
            }
        }
    }
}

/// SK-4.37 After a rejection outside OP the slot's answer stays as it was; in OP it becomes GET_STATUS's. SK-4.38 The
/// SDO slot keeps its answer, in OP too. SK-4.40 A rejection affects no other command of the frame, and in OP the frame
/// takes its entry.
#[test]
fn a_rejection_harms_its_own_answer_alone() {
    for size in SlotSize::ALL {
        let mut host = board(size, Firmware::V17);
        let sdo = size.sdo_slot();
        host.read_object(1, 0x1000, 0).unwrap();
        let sdo_answer = host.slot(sdo);
        let drive_mode = RawSlot { data1: 8, data2: 1, ..with_index(0x06, 4) };

        host.build(|frame, size| {
            frame.put_master(size, &MasterCommand::LocalWrite(9));
            (1..=3).for_each(|slave| frame.put(size, slave, &drive_mode));
        });
        host.cycle();
        let before = host.report.clone();
        let mark = host.mark();
        host.build(|frame, size| {
            frame.put(size, 0, &RawSlot { id: 0x05, parm: 1, ..RawSlot::ZERO });
            frame.put(size, 1, &with_index(0x11, 9));
            frame.put(size, 2, &RawSlot { index: 5, ..drive_mode });
            frame.put(size, 3, &with_index(0x77, 9));
            frame.put(size, sdo, &RawSlot { id: 0x07, ..RawSlot::ZERO });
        });
        host.cycle();
        assert_eq!(host.rejections(mark).len(), 4, "{size:?}");
        assert_eq!((host.answer().id, host.answer().result), (0x22, 0), "{size:?}");
        assert_eq!([head(&host, 1), head(&host, 2), head(&host, 3)], [(0x06, 4), (0x06, 5), (0x06, 4)], "{size:?}");
        (3..size.slots()).for_each(|n| assert_eq!(host.slot(n), before.slot(size, n), "{size:?} slot {n}"));

        host.go(MasterState::Op);
        host.build(|frame, size| (1..=3).for_each(|slave| frame.put(size, slave, &with_index(0x12, 6))));
        host.cycle();
        let (mark, executed) = (host.mark(), host.counters().executed);
        host.build(|frame, size| {
            frame.put_master(size, &MasterCommand::LocalWrite(0x15));
            frame.put(size, 1, &drive_mode);
            frame.put(size, 2, &with_index(0x11, 7));
            frame.put(size, 3, &with_index(0x77, 9));
            frame.put(size, sdo, &RawSlot { id: 0x07, ..RawSlot::ZERO });
        });
        assert_eq!(host.board.engine().fifo_free(), FIFO_ENTRIES - 1, "{size:?}");
        host.cycle();
        assert_eq!((host.rejections(mark).len(), host.counters().executed), (3, executed + 1), "{size:?}");
        assert_eq!([host.slot(1).id, host.slot(2).id, host.slot(3).id], [0x00, 0x11, 0x00], "{size:?}");
        assert_eq!(host.slot(2).index, 7, "{size:?}");
        assert_eq!(host.board.engine().local_outputs(), 0x15, "{size:?}");
        assert_eq!(host.slot(sdo), sdo_answer, "{size:?}");
        assert_eq!(host.slot(1).parm, MEASURED.statusword.0, "{size:?}: the slot's data stay current");
    }
}

/// SK-4.25 CSP: Data1 is the absolute target position; Data2 low is ignored by a plain drive.
/// SK-4.21 SK-4.22 SV_ON and SV_OFF are answered with the drive's slot.
#[test]
fn csp_moves_a_drive_to_an_absolute_position() {
    for size in SlotSize::ALL {
        let config = EngineConfig { slot: size, ..EngineConfig::default() };
        let Bench { mut host, network, .. } = Bench::new(config, drives(2));
        host.op(2).servo_on(1);
        assert_eq!((host.slot(1).id, host.drive(1).statusword.0 & 0xFF), (0x11, 0x37));
        for step in 1..=200u32 {
            let slot = RawSlot { data1: (-50i32 * step as i32) as u32, data2: 0xFFFF_FFFF, ..with_index(0x15, 1) };
            host.raw(1, slot).cycle();
        }
        host.cycles(200);
        assert_eq!((network.shaft(1, 0), network.shaft(2, 0)), (Some(-10_000), Some(0)), "{size:?}");
        assert_eq!((head(&host, 1), host.drive(1).position), ((0x15, 1), -10_000), "{size:?}");
        host.slave(1, SlaveCommand::ServoOff);
        host.until("off", |host| host.drive(1).statusword.0 & 1 == 0);
        assert_eq!(host.slot(1).id, 0x12);
    }
}
