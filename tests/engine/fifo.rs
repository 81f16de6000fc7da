//! The command FIFO of OP: capacity, order, full count, threshold, and commands that do not wait in it.

use ecmsk::engine::{EngineConfig, Firmware, Reason};
use ecmsk::fieldbus::sim::SimBus;
use ecmsk::sk::{
    CommandId, FifoAction, Frame, InvalidArgument, MasterCommand, MasterState, RawSlot, SlotSize, StateByte,
};

use crate::entries::MARKED;
use crate::host::Host;
use crate::puppet::Puppet;

/// Entries of the FIFO, as UG15n has them.
const CAPACITY: u16 = 160;

/// A board in OP with an empty FIFO, and its one drive.
fn board_of(config: EngineConfig) -> (Host, Puppet) {
    let puppet = Puppet::new();
    let mut host = Host::new(config, SimBus::new(vec![puppet.boxed()]));
    host.op(1);
    puppet.forget();
    (host, puppet)
}

fn board() -> (Host, Puppet) {
    board_of(EngineConfig::default())
}

fn of_master(size: SlotSize, command: MasterCommand) -> Frame {
    let mut frame = Frame::new();
    frame.put_master(size, &command);
    frame
}

fn threshold(free: u32) -> Frame {
    of_master(SlotSize::Bytes12, MasterCommand::SetFifo(FifoAction::Threshold(free)))
}

/// SET_FIFO 1 and a marked command in one frame.
fn clear_with(host: &Host, mark: u8) -> Frame {
    let mut frame = host.marked(mark);
    frame.put_master(host.size, &MasterCommand::SetFifo(FifoAction::Clear));
    frame
}

/// Runs cycles until the FIFO is empty, and returns the executed marks, one for each cycle.
fn drain(host: &mut Host) -> Vec<u8> {
    let mut marks = Vec::new();
    loop {
        host.cycle();
        marks.push(host.mark_shown());
        if host.fifo().0 == CAPACITY {
            return marks;
        }
    }
}

/// SK-5.1 The FIFO has 160 entries.
/// SK-5.3 Each cycle takes one entry out and executes it, in order.
/// SK-5.14 Without a threshold taking starts with the first entry.
/// SK-2.14 Bytes 8..9 count the free entries.
#[test]
fn a_full_fifo_is_executed_one_entry_a_cycle() {
    let (mut host, _) = board();
    assert_eq!(host.fifo(), (CAPACITY, 0));
    host.arrive_marked(1..=160);
    for n in 1..=160 {
        host.cycle();
        assert_eq!((host.mark_shown(), host.fifo()), (n, (u16::from(n), 0)));
    }
    let counts = host.counters();
    assert_eq!((counts.executed, counts.full, counts.cleared), (160, 0, 0), "the frame that asked for OP was no entry");
}

/// SK-5.2 A frame of GET_STATUS only takes an entry too, and so does one whose commands are all rejected.
#[test]
fn every_frame_takes_an_entry() {
    let (mut host, _) = board();
    let mut nonsense = Frame::new();
    nonsense.put(host.size, 0, &RawSlot { id: 0x77, ..RawSlot::ZERO });
    for _ in 0..10 {
        host.arrive(&Frame::new()).arrive(&nonsense);
    }
    for left in (0..20).rev() {
        host.cycle();
        assert_eq!(host.fifo(), (CAPACITY - left, 0));
    }
}

/// SK-5.4 An empty FIFO repeats the last process data: the position holds, the slot keeps id and index.
#[test]
fn an_empty_fifo_repeats() {
    let puppet = Puppet::obedient();
    let mut host = Host::new(EngineConfig::default(), SimBus::new(vec![puppet.boxed()]));
    host.op(1).servo_on(MARKED);
    host.arrive_marked([77]).cycle();
    puppet.forget();
    for _ in 0..500 {
        assert!(host.cycle(), "a report every cycle");
        assert_eq!((host.drive(MARKED).head.id, host.mark_shown()), (CommandId::Csp.code(), 77));
        assert_eq!(host.fifo(), (CAPACITY, 0));
    }
    assert_eq!((puppet.targets(), puppet.controlwords()), (vec![77], vec![0x0F]));
}

/// SK-5.6 A frame that finds the FIFO full takes no entry and is lost, and the full count goes up.
/// SK-5.7 Firmware 1.7 adds 1 for each.
/// SK-5.8 Firmware 1.5 adds 126 in 12-byte mode and 128 in 16-byte mode.
/// SK-2.15 Bytes 10..11 show the count.
/// SK-4.44 The counter outside the wire counts frames whatever the firmware.
#[test]
fn a_full_fifo_loses_frames_and_counts_them() {
    let cases = [
        (SlotSize::Bytes12, Firmware::V17, 1),
        (SlotSize::Bytes16, Firmware::V17, 1),
        (SlotSize::Bytes12, Firmware::V15, 126),
        (SlotSize::Bytes16, Firmware::V15, 128),
    ];
    for (slot, firmware, step) in cases {
        let config = EngineConfig { slot, firmware, ..EngineConfig::default() };
        let (mut host, _) = board_of(config);
        let before = host.counters();
        host.arrive_marked(1..=163).cycle();
        assert_eq!(host.fifo(), (1, 3 * step), "{config:?}");
        host.arrive_marked([164]);
        assert_eq!(host.counters().full, 3, "there was room for one again");
        host.arrive_marked([165]).cycle();
        assert_eq!(host.fifo(), (1, 4 * step), "{config:?}");
        host.cycles(200);
        assert_eq!(host.fifo(), (CAPACITY, 4 * step), "the count stays");
        let counts = host.counters();
        assert_eq!((counts.full, counts.executed - before.executed), (4, 161));
        if firmware == Firmware::V17 {
            assert_eq!(host.mark_shown(), 164, "the lost ones are not executed");
        }
    }
}

/// SK-5.9 The full count is a u16 and wraps.
#[test]
fn the_full_count_wraps() {
    let cases = [
        (SlotSize::Bytes12, Firmware::V17, 65_535 + 4, 3),
        (SlotSize::Bytes12, Firmware::V15, 521, 110),
        (SlotSize::Bytes16, Firmware::V15, 513, 128),
    ];
    for (slot, firmware, lost, shown) in cases {
        let (mut host, _) = board_of(EngineConfig { slot, firmware, ..EngineConfig::default() });
        let frame = host.marked(0);
        for _ in 0..u64::from(CAPACITY) + lost {
            host.arrive(&frame);
        }
        host.cycle();
        assert_eq!((host.fifo(), host.counters().full), ((1, shown), lost), "{firmware:?}");
    }
}

/// SK-5.12 Threshold T: nothing is taken out until the free space falls below T, then one entry a cycle.
/// SK-5.13 Once it has fallen below, the threshold returns to 160 by itself.
/// SK-5.19 The frame that carries SET_FIFO takes an entry itself.
#[test]
fn a_threshold_holds_entries_back_until_it_is_passed() {
    let (mut host, _) = board();
    for t in [1u16, 2, 100, 159] {
        host.arrive(&threshold(t.into()));
        // The free space falls to T, not below.
        host.arrive_marked((0..CAPACITY - t - 1).map(|n| n as u8));
        let executed = host.counters().executed;
        for _ in 0..300 {
            host.cycle();
            assert_eq!(host.fifo().0, t, "T = {t}: nothing is taken out");
        }
        assert_eq!(host.counters().executed, executed);
        host.arrive_marked([200]);
        for taken in 1..=CAPACITY - t + 1 {
            host.cycle();
            assert_eq!(host.fifo().0, t - 1 + taken, "T = {t}: one entry a cycle");
        }
        assert_eq!((host.fifo().0, host.mark_shown()), (CAPACITY, 200));
        // The threshold is the default again: a single entry is taken at once.
        host.arrive_marked([201]).cycle();
        assert_eq!((host.fifo().0, host.mark_shown()), (CAPACITY, 201), "T = {t}");
    }
    assert_eq!(host.fifo().1, 0);
}

/// SK-5.12 A threshold that is set when the free space is below it already holds nothing back.
/// SK-5.17 It is in force from the frame's arrival on: entries queued before it wait too.
#[test]
fn a_threshold_acts_from_its_arrival_on() {
    let (mut host, _) = board();
    host.arrive_marked(1..=50).arrive(&threshold(100)).cycles(20);
    assert_eq!((host.fifo().0, host.mark_shown()), (CAPACITY - 51, 0), "109 is not below 100");
    host.arrive_marked(51..=60).cycle();
    assert_eq!((host.fifo().0, host.mark_shown()), (CAPACITY - 60, 1));
    host.drained();
    host.arrive_marked(1..=50).arrive(&threshold(150)).cycle();
    assert_eq!((host.fifo().0, host.mark_shown()), (CAPACITY - 50, 1), "109 is below 150");
}

/// SK-5.14 160 is the default: taking starts with the first entry.
/// SK-5.24 A threshold above 160 counts as 160.
#[test]
fn a_threshold_of_160_and_above_holds_nothing_back() {
    let (mut host, _) = board();
    for t in [160, 161, 1000, u32::MAX] {
        host.arrive(&threshold(t)).cycle();
        assert_eq!(host.fifo(), (CAPACITY, 0), "T = {t}");
        host.arrive_marked([9]).cycle();
        assert_eq!((host.fifo().0, host.mark_shown()), (CAPACITY, 9), "T = {t}");
    }
}

/// SK-5.23 Threshold 0 is rejected, and the one in force stays.
/// SK-4.40 The frame takes its entry.
#[test]
fn a_threshold_of_0_is_rejected() {
    let (mut host, _) = board();
    let zero = RawSlot { id: 0x05, parm: 2, data1: 0, ..RawSlot::ZERO };
    let kind = Reason::BadArgument(InvalidArgument::ZeroThreshold).kind();
    host.raw(0, zero).drained();
    assert_eq!(host.counters().rejected[kind], 1, "once, though it acts on arrival and waits in the queue");

    host.arrive(&threshold(158)).raw(0, zero).cycles(50);
    assert_eq!(host.fifo().0, 158, "158 is still in force and not passed by two entries");
    host.idle().drained();
    assert_eq!(host.counters().rejected[kind], 2);
}

/// SK-5.18 SET_FIFO 1 acts when the FIFO is full, which it is not any more then.
/// SK-5.19 Its frame queues as the first entry, with what else it holds.
/// SK-5.22 Clear drops the earlier entries, not the full count.
/// SK-4.44 What was dropped is counted.
#[test]
fn clear_acts_on_a_full_fifo() {
    let (mut host, _) = board();
    host.arrive_marked(1..=165);
    let before = host.counters();
    let clear = clear_with(&host, 200);
    host.arrive(&clear).arrive_marked([201, 202]);
    assert_eq!(drain(&mut host), [200, 201, 202]);
    let after = host.counters();
    assert_eq!(host.fifo(), (CAPACITY, 5), "the count stays, and the clear itself is not lost");
    assert_eq!((after.cleared - before.cleared, after.full, after.executed - before.executed), (160, 5, 3));
}

/// SK-5.17 SET_FIFO 1 acts on arrival: not when its entry is taken out.
/// SK-5.22 Clear drops the threshold too.
#[test]
fn clear_drops_the_threshold() {
    let (mut host, _) = board();
    host.arrive(&threshold(20)).arrive_marked(1..=30).cycles(10);
    assert_eq!(host.fifo().0, CAPACITY - 31);
    let clear = clear_with(&host, 99);
    host.arrive(&clear);
    assert_eq!(drain(&mut host), [99]);
    assert_eq!(host.counters().cleared, 31);
}

/// SK-5.18 SET_FIFO 2 acts when the FIFO is full, although its frame is lost.
#[test]
fn a_threshold_acts_on_a_full_fifo() {
    let (mut host, _) = board();
    host.board.engine_mut().set_local_inputs(0b10_1010);
    host.master(MasterCommand::LocalRead).drained();
    assert_eq!(host.answer().result, 0b10_1010);
    host.arrive_marked(1..=160).arrive(&threshold(50)).cycle();
    assert_eq!(host.answer().result, 0, "the answer of a command without a result");
    assert_eq!((host.fifo(), host.mark_shown()), ((1, 1), 1));
    host.drained();
    assert_eq!(host.mark_shown(), 160);
}

/// SK-5.17 SET_STATE acts on arrival, also behind a threshold that holds all entries back. SK-5.19 Its frame queues
/// with what else it holds. SK-5.25 Leaving OP empties the FIFO; what is dropped is counted (SK-4.44), and it is not
/// executed in the next OP.
#[test]
fn set_state_does_not_wait_and_leaving_op_empties_the_fifo() {
    let (mut host, _) = board();
    host.arrive(&threshold(1)).arrive_marked(1..=20);
    let mut leave = host.marked(21);
    leave.put_master(host.size, &MasterCommand::SetState(MasterState::SafeOp));
    host.arrive(&leave).cycle();
    assert_eq!(host.fifo().0, CAPACITY - 22, "the frame queues as usual");
    host.until("SafeOP", |host| host.state() == StateByte::reached(MasterState::SafeOp));
    assert_eq!((host.counters().cleared, host.fifo()), (22, (0, 0)), "bytes 8..11 are 0 outside OP");

    host.go(MasterState::Op).cycles(10);
    assert_eq!((host.mark_shown(), host.fifo().0), (0, CAPACITY));
    host.arrive_marked([30]).cycle();
    assert_eq!(host.mark_shown(), 30, "the threshold went with the content");
}

/// SK-5.18 SET_STATE acts when the FIFO is full, although its frame is lost.
/// SK-4.44 Every accepted entry is executed or counted as cleared.
#[test]
fn set_state_acts_on_a_full_fifo() {
    let (mut host, _) = board();
    let before = host.counters();
    host.arrive_marked(1..=160);
    host.arrive(&of_master(host.size, MasterCommand::SetState(MasterState::PreOp)));
    host.until("PreOP", |host| host.state() == StateByte::reached(MasterState::PreOp));
    let after = host.counters();
    assert_eq!(after.full, 1);
    assert!(after.executed - before.executed < 160, "it did not wait for the entries: {after:?}");
    assert_eq!(after.executed - before.executed + after.cleared, 160);
    assert_eq!(host.answer().id, 0, "SET_STATE was not in the FIFO: the id is that of the entries before");
}

/// SK-5.18 SW_RESET acts when the FIFO is full.
/// SK-4.44 What it drops is counted.
#[test]
fn soft_reset_acts_on_a_full_fifo() {
    let (mut host, _) = board();
    host.arrive_marked(1..=163);
    host.arrive(&of_master(host.size, MasterCommand::SoftReset));
    assert_eq!((host.board.engine().boots(), host.board.engine().talks()), (2, false));
    assert_eq!((host.counters().cleared, host.counters().full), (160, 3));
    assert!(host.board.boot(60_000_000_000));
    host.op(1);
    assert_eq!((host.fifo(), host.mark_shown()), ((CAPACITY, 0), 0), "the full count is a variable too");
}

/// SK-5.4 The first reports of OP show the command executed last for the slot, here DRIVE_MODE.
#[test]
fn op_begins_with_the_heads_of_the_commands_before() {
    let puppet = Puppet::new();
    let mut host = Host::new(EngineConfig::default(), SimBus::new(vec![puppet.boxed()]));
    host.declare_drives(1);
    let mode = RawSlot { id: 0x06, index: 0x5A, data1: 8, data2: 1, ..RawSlot::ZERO };
    let mut frame = Frame::new();
    frame.put(host.size, MARKED, &mode);
    host.arrive(&of_master(host.size, MasterCommand::SetState(MasterState::Op))).arrive(&frame);
    host.until("OP", |host| host.state() == StateByte::reached(MasterState::Op));
    assert_eq!((host.drive(MARKED).head.id, host.mark_shown()), (0x06, 0x5A));
}
