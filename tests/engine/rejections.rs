//! Bad arguments, each with its reason, and the counters and log lines of rejections.

use ecmsk::coe::ObjectAddress;
use ecmsk::engine::{EngineConfig, Event, EventKind, Reason};
use ecmsk::sk::{
    CommandId, CycleTime, DcShift, FIFO_ENTRIES, FifoAction, InvalidArgument, MasterCommand, MasterState, RawSlot,
    SdoCommand, SlaveCommand, SlotSize,
};

use crate::host::Host;
use crate::probe::{Bench, any_slaves, drives};

fn board(slot: SlotSize) -> Bench {
    Bench::new(EngineConfig { slot, ..EngineConfig::default() }, any_slaves(2))
}

fn slot_0(id: u8, byte_2: u8, data1: u32) -> RawSlot {
    RawSlot { id, parm: byte_2.into(), data1, data2: 0xFFFF, ..RawSlot::ZERO }
}

/// Sends one command and returns its rejection.
fn reject(host: &mut Host, slot: usize, command: RawSlot) -> Option<Reason> {
    let (mark, before) = (host.mark(), host.counters());
    host.raw(slot, command).cycle();
    let counters = host.counters();
    match host.rejections(mark)[..] {
        [] => {
            assert_eq!(counters.rejected, before.rejected, "{command:?}");
            None
        }
        [(at, id, reason)] => {
            assert_eq!((usize::from(at), id.code()), (slot, command.id), "{command:?}");
            let mut rejected = before.rejected;
            rejected[reason.kind()] += 1;
            assert_eq!(counters.rejected, rejected, "{command:?}: counted by its reason");
            Some(reason)
        }
        ref several => panic!("{command:?}: {several:?}"),
    }
}

fn assert_bad(host: &mut Host, slot: usize, command: RawSlot, why: InvalidArgument) {
    assert_eq!(reject(host, slot, command), Some(Reason::BadArgument(why)), "{:?} {command:?}", host.size);
}

/// SK-4.4 SET_STATE: Data1 is 1, 2, 4 or 8.
/// SK-4.36 SK-4.39
#[test]
fn set_state() {
    for size in SlotSize::ALL {
        let Bench { mut host, .. } = board(size);
        for state in [MasterState::Init, MasterState::PreOp, MasterState::SafeOp, MasterState::Op] {
            if state == MasterState::SafeOp {
                host.go(MasterState::PreOp);
            }
            host.go(state);
            for data1 in [0, 3, 5, 6, 7, 9, 0x10, 0x12, 0x18, 0x102, 0x0002_0000, u32::MAX] {
                assert_bad(&mut host, 0, slot_0(0x01, 0, data1), InvalidArgument::State(data1));
            }
            host.cycles(500);
            assert_eq!(host.state().0, state.code(), "{size:?}");
        }
    }
}

/// SK-4.6 SET_AXIS: byte 2 is a group, 0..=4 in both modes.
/// SK-4.9 Nibbles 4..14 reject the whole command.
/// SK-4.8 Nibbles of slaves above 40 (30) are ignored.
#[test]
fn set_axis() {
    for size in SlotSize::ALL {
        let Bench { mut host, jobs, .. } = board(size);
        for group in [5, 6, 0x80, 0xFF] {
            assert_bad(&mut host, 0, slot_0(0x02, group, 0x1111_1111), InvalidArgument::Group(group));
        }
        for group in 0..=4u8 {
            for k in 0..8u8 {
                let slave = group * 8 + k + 1;
                for nibble in 0..=0xFu8 {
                    // All are drives except one.
                    let command = slot_0(0x02, group, u32::from(nibble) << (4 * k));
                    let known = matches!(nibble, 0..=3 | 0xF) || usize::from(slave) > size.max_slaves();
                    let expected = (!known).then_some(Reason::BadArgument(InvalidArgument::Kind { slave, nibble }));
                    host.raw(0, slot_0(0x02, group, 0x1111_1111));
                    assert_eq!(reject(&mut host, 0, command), expected, "{size:?} slave {slave} nibble {nibble:X}");
                }
            }
        }
        // The last accepted command declared slaves 1 to 8 as IO slaves; a bad one changes none of them.
        host.raw(0, slot_0(0x02, 0, 0x1111_1111));
        assert_bad(&mut host, 0, slot_0(0x02, 0, 0x5000_0000), InvalidArgument::Kind { slave: 8, nibble: 5 });
        host.go(MasterState::SafeOp);
        assert!(jobs.configured().slaves[..2].iter().all(|slave| slave.role == ecmsk::fieldbus::Role::Io));
    }
}

/// SK-4.11 SET_DC: 250 us * 2^n, n >= 0, up to 1 s.
/// SK-4.12 Data2 = 0xFFFF and 0xFFFF0000 are both accepted.
/// SK-4.13 Any other is accepted and logged.
#[test]
fn set_dc() {
    let Bench { mut host, .. } = board(SlotSize::Bytes12);
    for n in 0..=11 {
        assert_eq!(reject(&mut host, 0, slot_0(0x03, 0, 250 << n)), None, "{}", 250 << n);
    }
    for us in [0, 1, 125, 249, 251, 750, 999, 1250, 3000, 1_000_000, 1_024_000, 250 << 23, u32::MAX] {
        assert_bad(&mut host, 0, slot_0(0x03, 0, us), InvalidArgument::CycleTime(us));
    }
    for (data2, odd) in
        [(0xFFFF, false), (0xFFFF_0000, false), (0, true), (1, true), (0xFFFF_FFFF, true), (0xFFFE, true)]
    {
        let mark = host.mark();
        let command = RawSlot { data2, ..slot_0(0x03, 0, 2000) };
        assert_eq!(reject(&mut host, 0, command), None);
        assert_eq!(host.answer().id, 0x03);
        let events: Vec<Event> = host.board.engine().events_since(mark).collect();
        match events[..] {
            [] => assert!(!odd, "{data2:X}"),
            [event @ Event { at, kind: EventKind::OddDcShift { data2: logged } }] => {
                assert!(odd && logged == data2 && at <= host.board.now(), "{data2:X} {event:?}");
                assert!(event.to_string().contains(&format!("{data2:08X}")), "{event}");
            }
            _ => panic!("{data2:X}: {events:?}"),
        }
    }
}

/// SK-4.15 SET_FIFO: byte 2 is 1 or 2.
/// SK-5.23 Threshold 0 is rejected.
#[test]
fn set_fifo() {
    for size in SlotSize::ALL {
        let Bench { mut host, .. } = board(size);
        host.go(MasterState::Op);
        for action in [0, 3, 4, 0x10, 0xFF] {
            assert_bad(&mut host, 0, slot_0(0x05, action, 100), InvalidArgument::FifoAction(action));
        }
        assert_bad(&mut host, 0, slot_0(0x05, 2, 0), InvalidArgument::ZeroThreshold);
        for (action, data1) in [(1, 0), (1, 7), (2, 1), (1, 0), (2, 160), (2, 161), (2, u32::MAX)] {
            assert_eq!(reject(&mut host, 0, slot_0(0x05, action, data1)), None, "{action} {data1}");
        }
    }
}

/// SK-4.16 DRIVE_MODE: Data1 is 8, 9 or 10, Data2 0 or 1, or a value that an earlier command has left there. SK-4.41 In
/// the slot of any slave, present or not.
#[test]
fn drive_mode() {
    for size in SlotSize::ALL {
        let Bench { mut host, .. } = board(size);
        for state in [MasterState::PreOp, MasterState::Init] {
            host.go(state);
            for slave in [1, 2, 3, size.max_slaves()] {
                let mode = |data1, data2| RawSlot { id: 0x06, data1, data2, ..RawSlot::ZERO };
                for data1 in [8, 9, 10] {
                    assert_eq!(reject(&mut host, slave, mode(data1, 0)), None);
                    assert_eq!(reject(&mut host, slave, mode(data1, 1)), None);
                }
                for data1 in [0, 1, 3, 6, 7, 11, 0x108, 0x0008_0000, u32::MAX] {
                    assert_bad(&mut host, slave, mode(data1, 1), InvalidArgument::DriveMode(data1));
                }
                // SK-4.81 A value left by an earlier command does not invalidate the mode; it is logged.
                for data2 in [2, 0xFFFF, 0x1_0000, u32::MAX] {
                    let mark = host.board.engine().events_total();
                    assert_eq!(reject(&mut host, slave, mode(8, data2)), None);
                    let told: Vec<_> = host.board.engine().events_since(mark).map(|event| event.to_string()).collect();
                    let words = [format!("slave {slave}"), format!("0x{data2:08X}"), "DC sync".to_owned()];
                    assert!(told.len() == 1 && words.iter().all(|word| told[0].contains(word)), "{told:?}");
                }
            }
        }
    }
}

/// SK-4.17 SDO_RD: Parm low is a slave, 1..=40 (30). SK-4.18 SDO_WR: the high byte of Parm is a size, 1, 2 or 4.
/// SK-6.6 Slave 0 and one above 40 (30) are rejected.
/// SK-4.38 The slot keeps its answer.
#[test]
fn sdo() {
    for size in SlotSize::ALL {
        let Bench { mut host, .. } = board(size);
        host.read_object(2, 0x1018, 1).unwrap();
        let (place, last) = (size.sdo_slot(), size.max_slaves() as u16);
        let answer = host.slot(place);
        for state in [MasterState::PreOp, MasterState::SafeOp, MasterState::Op] {
            host.go(state);
            let command = |id, parm| RawSlot { id, parm, data1: 0x1018_0001, ..RawSlot::ZERO };
            for parm in [0, last + 1, 0xFF, 0x100, 0x200 | (last + 1), 0x8000] {
                assert_bad(&mut host, place, command(0x07, parm), InvalidArgument::SdoSlave(parm & 0xFF));
            }
            for slave in [0, last + 1, 0xFF] {
                assert_bad(&mut host, place, command(0x08, 0x0400 | slave), InvalidArgument::SdoSlave(slave));
            }
            for bytes in [0, 3, 5, 8, 0x80, 0xFF] {
                assert_bad(&mut host, place, command(0x08, u16::from(bytes) << 8 | 1), InvalidArgument::SdoSize(bytes));
            }
            for id in [0x07, 0x08] {
                let command = RawSlot { data1: 0x1018_0100, ..command(id, 0x0001 | u16::from(id == 8) << 8) };
                assert_bad(&mut host, place, command, InvalidArgument::SubIndex(0x100));
            }
            host.cycles(100);
            assert_eq!(host.slot(place), answer, "{size:?} {state}");
        }
    }
}

/// SK-4.39 The log names the rejected command, its slot, the time and the reason.
#[test]
fn the_log_speaks() {
    let Bench { mut host, .. } = board(SlotSize::Bytes12);
    let busy = SdoCommand::Read { slave: 1, object: ObjectAddress::new(0x1000, 0) }.encode();
    let of = |id: u8, data1: u32| RawSlot { id, data1, ..RawSlot::ZERO };
    let said = [
        (0, of(0x01, 0x33), ["SET_STATE", "slot 0", "51"]),
        (0, of(0x05, 0), ["SET_FIFO", "slot 0", "state"]),
        (0, of(0x11, 0), ["SV_ON", "slot 0", "slot"]),
        (9, of(0xEE, 0), ["0xEE", "slot 9", "no such command"]),
        (41, of(0x07, 0), ["SDO_RD", "slot 41", "slave 0"]),
    ];
    host.cycles(3);
    for (slot, command, words) in said {
        let (mark, now) = (host.mark(), host.board.now());
        host.raw(slot, command);
        let texts: Vec<String> = host.board.engine().events_since(mark).map(|event| event.to_string()).collect();
        assert_eq!(texts.len(), 1, "{texts:?}");
        let at = format!("{:.3} s", (now + 125_000) as f64 / 1e9);
        for word in words.into_iter().chain([at.as_str()]) {
            assert!(texts[0].contains(word), "{word}: {}", texts[0]);
        }
    }
    let mark = host.mark();
    let other = RawSlot { data1: 0x1018_0001, ..busy };
    host.raw(41, busy).raw(41, other).raw(41, RawSlot { data1: 0x1018_0002, ..busy });
    assert_eq!(host.rejections(mark), [(41, CommandId::SdoRead, Reason::SdoBusy)]);
}

/// SK-4.44 Nothing is lost uncounted: rejected by reason, discarded before Operation enabled, cleared, full.
/// SK-4.39
#[test]
fn counters() {
    let Bench { mut host, .. } = Bench::new(EngineConfig::default(), drives(2));
    let cycle = CycleTime::from_us(512_000).unwrap();
    host.master(MasterCommand::SetDc { cycle, shift: DcShift::Auto }).op(1);
    let start = host.counters();
    assert_eq!((start.rejected_total(), start.executed, start.cleared, start.full), (0, 0, 0, 0));

    // Three entries, one of them with a target for a drive that is off, and three rejections.
    host.csp(1, 1000).build(|frame, size| {
        frame.put(size, 0, &RawSlot { id: 0x03, ..RawSlot::ZERO });
        frame.put(size, 1, &RawSlot { id: 0x99, ..RawSlot::ZERO });
        frame.put(size, 2, &RawSlot { id: 0x11, ..RawSlot::ZERO });
    });
    host.idle().cycles(3);
    let counters = host.counters();
    assert_eq!((counters.executed, counters.discarded_before_enabled, counters.rejected_total()), (3, 1, 3));
    for reason in [Reason::WrongState, Reason::UnknownId, Reason::NoSlave] {
        assert_eq!(counters.rejected[reason.kind()], 1, "{reason}");
    }

    (0..165).for_each(|_| {
        host.slave(1, SlaveCommand::GetStatus);
    });
    assert_eq!((host.counters().full, host.counters().cleared), (5, 0));
    host.master(MasterCommand::SetFifo(FifoAction::Clear));
    assert_eq!((host.counters().full, host.counters().cleared), (5, 160));
    assert_eq!(host.board.engine().fifo_free(), FIFO_ENTRIES - 1);
    host.cycle();
    assert_eq!((host.counters().executed, host.counters().idle_cycles > 0), (4, true));
}
