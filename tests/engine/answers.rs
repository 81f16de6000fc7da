//! The slots of a response: the board's own, those of slaves, and the SDO slot.

use ecmsk::cia402::Mode;
use ecmsk::coe::ObjectAddress;
use ecmsk::engine::{EngineConfig, Event, EventKind, Firmware};
use ecmsk::fieldbus::AlState;
use ecmsk::sk::{
    CycleTime, DcShift, DriveSync, FIFO_ENTRIES, FifoAction, MasterCommand, MasterState, RawSlot, SdoCommand,
    SlaveCommand, SlaveKind, SlotSize, StateByte,
};
use ecmsk::slave::AlStatus;

use crate::host::Host;
use crate::probe::{Bench, any_slaves, drives};

const STATES: [MasterState; 4] = [MasterState::Init, MasterState::PreOp, MasterState::SafeOp, MasterState::Op];

fn config(slot: SlotSize, firmware: Firmware) -> EngineConfig {
    EngineConfig { slot, firmware, ..EngineConfig::default() }
}

/// Two drives; the board is in PreOP.
fn board(slot: SlotSize) -> Bench {
    let mut bench = Bench::new(config(slot, Firmware::V17), drives(2));
    bench.host.declare_drives(2);
    bench
}

/// A command of the board with a known result: its six inputs.
fn read_inputs(host: &mut Host, bits: u8) {
    host.board.engine_mut().set_local_inputs(bits);
    host.master(MasterCommand::LocalRead).cycle();
}

fn set_dc(us: u32) -> MasterCommand {
    MasterCommand::SetDc { cycle: CycleTime::from_us(us).unwrap(), shift: DcShift::Auto }
}

fn bad_slot_0() -> RawSlot {
    RawSlot { id: 0x01, data1: 3, ..RawSlot::ZERO }
}

/// SK-2.1 Outside OP byte 0 is the id of the command answered.
/// SK-2.4 It is 0 for GET_STATUS.
/// SK-2.13 Bytes 4..7 are 0 after a command without a result.
/// SK-2.21 Bytes 8..11 are 0 outside OP.
/// SK-1.10 A frame is answered by the report after it.
#[test]
fn outside_op_each_command_shows_its_id() {
    for size in SlotSize::ALL {
        let Bench { mut host, .. } = board(size);
        let kinds = [SlaveKind::Drive; 8];
        let set_ex = MasterCommand::SetEx { check_commands: false, fill_responses: true };
        for state in [MasterState::PreOp, MasterState::Init, MasterState::SafeOp] {
            if state == MasterState::SafeOp {
                host.go(MasterState::PreOp);
            }
            host.go(state);
            let mut commands = vec![
                (MasterCommand::SetState(state), 0x01, 0),
                (set_ex, 0x04, 0),
                (MasterCommand::LocalWrite(0x2A), 0x22, 0),
                (MasterCommand::LocalRead, 0x21, 0x15),
                (MasterCommand::GetStatus, 0x00, 0x15),
            ];
            if state != MasterState::SafeOp {
                commands.push((
                    MasterCommand::SetAxis { group: 0, kinds },
                    0x02,
                    if state == MasterState::Init { 0 } else { 2 },
                ));
                commands.push((set_dc(1000), 0x03, 0));
            }
            for (command, id, result) in commands {
                read_inputs(&mut host, 0x15);
                assert_eq!((host.answer().id, host.answer().result), (0x21, 0x15), "{size:?} {state}");
                host.master(command);
                assert_eq!(host.answer().id, 0x21, "{size:?} {state}: answered before a report came");
                assert!(host.cycle());
                let answer = host.answer();
                assert_eq!((answer.id, answer.result), (id, result), "{size:?} {state} {command:?}");
                assert_eq!((answer.fifo_free, answer.full_count), (0, 0), "{size:?} {state} {command:?}");
                assert_eq!(answer.state, StateByte::reached(state), "{size:?} {state} {command:?}");
            }
        }
    }
}

/// SK-2.11 SK-4.10 SET_AXIS answers the slaves found; in Init it answers 0.
#[test]
fn set_axis_counts_slaves() {
    for (size, n, found) in [(SlotSize::Bytes12, 40, 40), (SlotSize::Bytes16, 40, 30), (SlotSize::Bytes12, 3, 3)] {
        let Bench { mut host, .. } = Bench::new(config(size, Firmware::V17), any_slaves(n));
        for group in 0..=4 {
            let command = MasterCommand::SetAxis { group, kinds: Default::default() };
            host.go(MasterState::PreOp).master(command).cycle();
            assert_eq!(host.answer().result, found, "{size:?} group {group}");
            host.go(MasterState::Init).master(command).cycle();
            assert_eq!(host.answer().result, 0, "{size:?} group {group}");
        }
    }
}

/// SK-2.2 In OP byte 0 is 0xBF, whatever the command.
/// SK-2.14 Bytes 8..9 are the free entries of the FIFO.
/// SK-2.15 Bytes 10..11 are the full count.
/// SK-2.20 State, error code and CRC are current, whatever the command.
#[test]
fn in_op_slot_0_is_cyclic() {
    for size in SlotSize::ALL {
        let Bench { mut host, .. } = board(size);
        host.op(2);
        let commands = [
            RawSlot::ZERO,
            MasterCommand::SetState(MasterState::Op).encode(),
            MasterCommand::SetFifo(FifoAction::Clear).encode(),
            MasterCommand::SetFifo(FifoAction::Threshold(FIFO_ENTRIES.into())).encode(),
            MasterCommand::LocalWrite(1).encode(),
            MasterCommand::LocalRead.encode(),
            set_dc(1000).encode(),
            bad_slot_0(),
            RawSlot { id: 0xBF, ..RawSlot::ZERO },
            RawSlot { id: 0xEE, ..RawSlot::ZERO },
        ];
        for command in commands {
            host.raw(0, command).cycle();
            let answer = host.answer();
            assert_eq!((answer.id, answer.state.0, answer.error), (0xBF, 8, 0), "{size:?} {command:?}");
            assert_eq!((answer.fifo_free, answer.full_count), (FIFO_ENTRIES, 0), "{size:?} {command:?}");
            assert_eq!(host.report.crc_byte(), crate::crc::crc8(host.report.wire(size)), "{size:?} {command:?}");
        }
        host.master(MasterCommand::SetFifo(FifoAction::Threshold(1)));
        for sent in 2..=10 {
            host.idle();
            assert_eq!(host.board.engine().fifo_free(), FIFO_ENTRIES - sent, "{size:?}");
        }
        host.cycle();
        assert_eq!(host.answer().fifo_free, FIFO_ENTRIES - 10, "{size:?}");
        while host.counters().full < 3 {
            host.idle();
        }
        host.cycle();
        assert_eq!((host.answer().fifo_free, host.answer().full_count), (1, 3), "{size:?}");
    }
}

/// SK-2.13 A result stays until the next command of the board.
/// SK-2.19 GET_STATUS and a rejected command do not change bytes 4..7, in any state.
#[test]
fn a_result_stays() {
    for size in SlotSize::ALL {
        for state in STATES {
            let Bench { mut host, .. } = board(size);
            host.go(state);
            host.board.engine_mut().set_local_inputs(0x2B);
            host.master(MasterCommand::LocalRead).cycles(2);
            for slot_0 in [RawSlot::ZERO, bad_slot_0(), RawSlot { id: 0x99, data1: 5, ..RawSlot::ZERO }] {
                host.board.engine_mut().set_local_inputs(0x11);
                host.raw(0, slot_0).cycles(2);
                assert_eq!(host.answer().result, 0x2B, "{size:?} {state} {slot_0:?}");
                host.slave(1, SlaveCommand::Other(RawSlot { id: 0x99, ..RawSlot::ZERO })).cycles(2);
                assert_eq!(host.answer().result, 0x2B, "{size:?} {state} {slot_0:?}");
            }
            host.master(MasterCommand::LocalWrite(0)).cycles(2);
            assert_eq!(host.answer().result, 0, "{size:?} {state}");
        }
    }
}

/// SK-2.22 The answer to SET_STATE shows the state of that moment.
/// SK-4.5 It comes at once; the change takes several cycles.
#[test]
fn set_state_is_answered_with_the_old_state() {
    let Bench { mut host, .. } = board(SlotSize::Bytes12);
    for (from, to) in [(2, MasterState::SafeOp), (4, MasterState::Op), (8, MasterState::PreOp), (2, MasterState::Init)]
    {
        host.cycle();
        host.master(MasterCommand::SetState(to));
        for cycle in 1..=3 {
            assert!(host.cycle());
            let id = if from == 8 { 0xBF } else { 0x01 };
            assert_eq!((host.answer().id, host.answer().state.0), (id, from), "to {to}, cycle {cycle}");
        }
        host.until("the state", |host| host.state() == StateByte::reached(to));
    }
}

/// SK-2.9 A slave that does not reach the state asked for: byte 2 is 0x10 | the last good state.
/// SK-2.16 Byte 0, bytes 8..11 and the allowed commands go by its low nibble.
/// SK-2.17 SET_STATE to that same state clears 0x10.
#[test]
fn a_failed_change_goes_by_the_low_nibble() {
    use MasterState::{Init, Op, PreOp, SafeOp};
    for size in SlotSize::ALL {
        for (good, wanted, refused) in [
            (Init, PreOp, AlState::PreOp),
            (PreOp, SafeOp, AlState::SafeOp),
            (SafeOp, Op, AlState::Op),
            (Op, PreOp, AlState::PreOp),
        ] {
            let Bench { mut host, network, .. } = board(size);
            host.go(good).idle().cycles(2);
            network.refuse(2, Some((refused, AlStatus(0x0011))));
            host.master(MasterCommand::SetState(wanted));
            host.until("0x10", |host| host.state() == StateByte(0x10 | good.code()));

            let op = good == Op;
            host.master(MasterCommand::LocalWrite(1)).cycles(2);
            let answer = host.answer();
            assert_eq!(answer.id, if op { 0xBF } else { 0x22 }, "{size:?} {good}");
            assert_eq!(answer.fifo_free, if op { FIFO_ENTRIES } else { 0 }, "{size:?} {good}");
            let allowed = [
                (0, set_dc(1000).encode(), good <= PreOp),
                (0, MasterCommand::SetEx { check_commands: false, fill_responses: true }.encode(), good < Op),
                (0, MasterCommand::SetFifo(FifoAction::Clear).encode(), op),
                (1, RawSlot { id: 0x12, ..RawSlot::ZERO }, op),
                (
                    size.sdo_slot(),
                    SdoCommand::Read { slave: 1, object: ObjectAddress::new(0x1000, 0) }.encode(),
                    good > Init,
                ),
            ];
            for (slot, command, allowed) in allowed {
                let mark = host.mark();
                host.raw(slot, command).cycles(2);
                // An SDO that is carried out may end in an abort code.
                let is_rejection = |event: Event| matches!(event.kind, EventKind::Rejected(_));
                let rejected = host.board.engine().events_since(mark).any(is_rejection);
                assert_eq!(!rejected, allowed, "{size:?} {good} {command:?}");
            }

            network.refuse(2, None);
            host.go(good).cycles(5);
            assert_eq!(host.state(), StateByte::reached(good), "{size:?}");
        }
    }
}

/// SK-3.1 SK-4.56 A slot without a slave, and one that is declared as none, shows the command executed there, too:
/// DRIVE_MODE and its index.
#[test]
fn a_slot_without_a_slave_shows_what_it_was_told() {
    for size in SlotSize::ALL {
        let Bench { mut host, .. } = board(size);
        let mut kinds = [SlaveKind::Drive; 8];
        kinds[2] = SlaveKind::None;
        host.master(MasterCommand::SetAxis { group: 0, kinds });
        let mode = SlaveCommand::DriveMode { mode: Mode::Csv, sync: DriveSync::DcSync }.with_index(0x5A);
        let shown = RawSlot { id: 0x06, index: 0x5A, ..RawSlot::ZERO };
        for slave in [3, size.max_slaves()] {
            host.go(MasterState::PreOp);
            assert_eq!(host.slot(slave), RawSlot::ZERO);
            host.build(|frame, size| frame.put_slave(size, slave, &mode)).cycle();
            assert_eq!(host.slot(slave), shown, "{size:?} slot {slave}");
            // In OP, too, where it is not executed again, until another frame has come.
            host.build(|frame, size| {
                frame.put_master(size, &MasterCommand::SetState(MasterState::Op));
                frame.put_slave(size, slave, &mode);
            });
            host.until("OP", |host| host.state() == StateByte(8)).cycles(3);
            assert_eq!(host.slot(slave), shown, "{size:?} slot {slave} in OP");
        }
    }
}
