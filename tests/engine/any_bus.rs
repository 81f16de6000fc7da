//! Rules that other files show cycle by cycle, which only a simulated bus allows. Here they are shown on any bus, and
//! `over` runs them over all buses.

use ecmsk::cia402::Mode;
use ecmsk::coe::{ObjectAddress, SdoSize};
use ecmsk::engine::EngineConfig;
use ecmsk::fieldbus::sim::SimBus;
use ecmsk::fieldbus::{AlState, Role};
use ecmsk::sk::{
    CrcStatus, DriveSync, FIFO_ENTRIES, FifoAction, Frame, MasterCommand, MasterState, RawSlot, SdoCommand,
    SdoResponse, SlaveCommand, SlaveKind, StateByte,
};

use crate::host::Host;
use crate::probe::{Bench, any_slaves, drives};
use crate::puppet::Puppet;
use crate::watch::Started;

use MasterState::{Init, Op, PreOp, SafeOp};

/// No bus takes longer to show what has happened.
const SETTLES: usize = 40;

fn puppet_in_op(kind: SlaveKind) -> (Host, Puppet) {
    let puppet = Puppet::new();
    let mut host = Host::new(EngineConfig::default(), SimBus::new(vec![puppet.boxed()]));
    let mut kinds = [SlaveKind::None; 8];
    kinds[0] = kind;
    host.master(MasterCommand::SetAxis { group: 0, kinds }).go(Op).drained();
    (host, puppet)
}

/// SK-4.47 After power-up the board looks for slaves and goes to PreOP by itself. SK-4.48 It begins to report in PreOP:
/// the first report shows PreOP.
#[test]
fn a_board_starts_in_preop() {
    let puppet = Puppet::new();
    let mut host = Host::new(EngineConfig::default(), SimBus::new(vec![puppet.boxed()]));
    assert_eq!(puppet.strings().al_state(), AlState::PreOp);
    host.until("a report", |host| host.reports > 0);
    assert_eq!(host.state(), StateByte::reached(PreOp));
}

/// SK-2.8 Byte 2 is the state. SK-2.22 SK-4.5 SET_STATE is answered at once, with the old one; the change takes several
/// cycles. SK-4.49 The steps up. SK-4.51 PreOP to OP goes through SafeOP. SK-4.53 That takes many cycles, from PreOP to
/// SafeOP the most.
/// SK-4.2 GET_STATUS is taken in each state, in any slot.
#[test]
fn states_and_the_ways_between() {
    let Bench { mut host, jobs, .. } = Bench::new(EngineConfig::default(), drives(2));
    host.declare_drives(2).cycle();
    let mut took = Vec::new();
    for (from, to, byte) in
        [(PreOp, Init, 1), (Init, PreOp, 2), (PreOp, SafeOp, 4), (SafeOp, Op, 8), (Op, PreOp, 2), (PreOp, Op, 8)]
    {
        let (moves, reports) = (jobs.moves().len(), host.reports);
        host.master(MasterCommand::SetState(to)).until("its answer", |host| host.reports > reports);
        if to > from {
            assert_eq!(host.state(), StateByte::reached(from), "{from} to {to}");
        }
        host.until("the state", |host| host.state() == StateByte::reached(to));
        assert_eq!(host.state().0, byte);
        took.push((from, to, host.reports - reports));
        if (from, to) == (PreOp, Op) {
            let through: Vec<AlState> = jobs.moves()[moves..].iter().map(|(target, _)| *target).collect();
            assert!(through.contains(&AlState::SafeOp) && through.ends_with(&[AlState::Op]), "{through:?}");
        }
        let rejected = host.counters().rejected_total();
        host.idle().cycles(SETTLES);
        assert_eq!((host.state().0, host.counters().rejected_total()), (byte, rejected));
    }
    let [_, up, safe, op, _, _] = took[..] else { panic!("{took:?}") };
    assert!(up.2 > 2 && op.2 > 2 && safe.2 > up.2 && safe.2 > op.2, "{took:?}");
}

/// SK-4.7 The kinds that SET_AXIS's nibbles name: 0 a drive, 1 IO, 2 HSP, 3 STEP, F none.
#[test]
fn nibbles_name_kinds() {
    let Bench { mut host, jobs, .. } = Bench::new(EngineConfig::default(), any_slaves(5));
    host.raw(0, RawSlot { id: 0x02, data1: 0xFFFF_3210 | 0xF_0000, ..RawSlot::ZERO }).go(SafeOp);
    let roles: Vec<Role> = jobs.configured().slaves[..5].iter().map(|slave| slave.role).collect();
    assert_eq!(roles, [Role::Drive(Mode::Csp), Role::Io, Role::Hsp(Mode::Csp), Role::Step(Mode::Csp), Role::Unused]);
}

/// SK-7.54 The board's writes on the way to SafeOP: the assigned PDOs, in each mode, and the mode. SK-7.3 SK-7.4 Their
/// entries: 0x60FF in CSV, 0x6071 in CST, with their lengths.
#[test]
fn process_data_are_mapped() {
    for (mode, pdo, value, target) in
        [(Mode::Csp, 0x1600, 8, 0x607A_0020), (Mode::Csv, 0x1601, 9, 0x60FF_0020), (Mode::Cst, 0x1602, 10, 0x6071_0010)]
    {
        let Bench { mut host, .. } = Bench::new(EngineConfig::default(), drives(1));
        host.declare_drives(1).slave(1, SlaveCommand::DriveMode { mode, sync: DriveSync::DcSync }).go(SafeOp);
        for (index, sub, expected) in [
            (0x1C12, 0, 1),
            (0x1C12, 1, pdo),
            (0x1C13, 0, 1),
            (0x1C13, 1, 0x1A00),
            (pdo as u16, 1, 0x6040_0010),
            (pdo as u16, 2, target),
            (0x6060, 0, value),
        ] {
            assert_eq!(host.read_object(1, index, sub), Ok(expected), "{mode:?} {index:04X}:{sub}");
        }
    }
}

/// SK-2.2 In OP byte 0 of slot 0 is 0xBF whatever the command.
/// SK-2.20 State, error code and CRC are current.
/// SK-8.3 LIO_RD has no marker there: once its entry has run the inputs are its answer.
#[test]
fn slot_0_in_op() {
    let Bench { mut host, .. } = Bench::new(EngineConfig::default(), drives(1));
    host.op(1);
    let commands = [
        RawSlot::ZERO,
        RawSlot { id: 0x21, ..RawSlot::ZERO },
        RawSlot { id: 0x22, data1: 5, ..RawSlot::ZERO },
        RawSlot { id: 0x05, parm: 2, data1: 160, ..RawSlot::ZERO },
        RawSlot { id: 0x01, data1: 8, ..RawSlot::ZERO },
        RawSlot { id: 0x99, ..RawSlot::ZERO },
    ];
    for (command, inputs) in commands.into_iter().zip([0x2A, 0x15, 0x3F, 0, 1, 2]) {
        host.board.engine_mut().set_local_inputs(inputs);
        host.raw(0, command).drained().cycles(SETTLES);
        let answer = host.answer();
        assert_eq!((answer.id, answer.error, answer.state), (0xBF, 0, StateByte::reached(Op)), "{command:?}");
        assert!(matches!(host.report.crc_status(host.size), CrcStatus::Right(_)), "{command:?}");
        if command.id == 0x21 {
            assert_eq!(answer.result, u32::from(inputs));
        }
    }
}

/// SK-5.12 SET_FIFO 2: nothing is taken out until less than the threshold is free, then one after the other.
/// SK-5.1 There are 160 entries. SK-2.14 Bytes 8..9 say how many are free.
/// SK-5.13 The threshold is 160 again then: a single entry is taken.
/// SK-5.20 An SDO request in the queue begins when its entry is taken out.
#[test]
fn a_threshold_holds_entries_back() {
    let Bench { mut host, jobs, .. } = Bench::new(EngineConfig::default(), drives(1));
    host.op(1).cycles(SETTLES);
    let before = host.counters().executed;
    host.master(MasterCommand::SetFifo(FifoAction::Threshold(1)));
    host.sdo(SdoCommand::Read { slave: 1, object: ObjectAddress::new(0x1000, 0) });
    (2..100).for_each(|_| {
        host.idle();
    });
    host.cycles(200);
    assert_eq!((host.answer().fifo_free, host.counters().executed - before), (60, 0));
    assert!(jobs.transfers().is_empty());
    (100..159).for_each(|_| {
        host.idle();
    });
    host.cycles(SETTLES);
    assert_eq!((host.answer().fifo_free, host.counters().executed - before), (1, 0), "one is free: not less than 1");
    host.idle().drained().cycles(SETTLES);
    assert_eq!((host.answer().fifo_free, host.counters().executed - before), (FIFO_ENTRIES, 160));
    host.until("the answer", |host| matches!(host.sdo_answer(), SdoResponse::Done { .. }));
    host.idle().cycles(SETTLES);
    assert_eq!(host.counters().executed - before, 161);
}

/// SK-5.7 The full count adds 1 for each frame that is lost. SK-2.15 Bytes 10..11 show it. SK-5.9 It is a u16 and wraps.
#[test]
fn a_full_fifo_counts_what_it_loses() {
    let Bench { mut host, .. } = Bench::new(EngineConfig::default(), drives(1));
    host.op(1).cycles(SETTLES);
    let before = host.counters().executed;
    let mut sent = 0;
    for lost in [100, 0x1_0010] {
        while host.counters().full < lost {
            host.idle();
            sent += 1;
        }
        host.cycles(SETTLES);
        assert_eq!((host.counters().full, host.answer().full_count), (lost, lost as u16));
    }
    host.drained().cycles(SETTLES);
    assert_eq!(host.counters().executed - before, sent - host.counters().full);
}

/// SK-1.27 In OP a frame with a wrong CRC takes no entry and does not raise the full count; responses go on.
#[test]
fn a_wrong_frame_takes_no_entry() {
    let Bench { mut host, .. } = Bench::new(EngineConfig::default(), drives(1));
    host.master(MasterCommand::SetEx { check_commands: true, fill_responses: true }).soft_reset().op(1).cycles(SETTLES);
    let (before, reports) = (host.counters(), host.reports);
    let mut frame = Frame::new();
    frame.put_slave(host.size, 1, &SlaveCommand::ServoOn.into());
    frame.fill_crc(host.size);
    frame.bytes_mut()[3] ^= 0x55;
    (0..200).for_each(|_| {
        host.send(&frame);
    });
    host.cycles(SETTLES);
    let after = host.counters();
    assert_eq!((after.executed, after.full, after.crc), (before.executed, 0, before.crc + 200));
    assert_eq!((host.answer().id, host.answer().error, host.answer().fifo_free), (0xBF, 200, FIFO_ENTRIES));
    assert!(host.reports > reports && !host.drive(1).statusword.is_enabled());
}

/// SK-3.11 In OP a drive's slot is refreshed whatever its command was, and without any.
/// SK-3.12 It has the statusword, the position, the torque and the error code.
/// SK-3.19 A STEP's is the same. SK-7.13 The statusword of one that is on ends in 37h: nothing is added to it or taken away.
#[test]
fn a_drives_slot_is_what_it_measures() {
    for kind in [SlaveKind::Drive, SlaveKind::Step] {
        let (mut host, puppet) = puppet_in_op(kind);
        let commands =
            [None, Some(0x00), Some(0x10), Some(0x11), Some(0x12), Some(0x15), Some(0x18), Some(0x19), Some(0x99)];
        for (n, command) in (1..).zip(commands) {
            let shown = [0x1637, 0x9637, 0x2337, 0x0250][n as usize % 4];
            let mut strings = puppet.strings();
            strings.shows.statusword.0 = shown;
            (strings.shows.position, strings.shows.torque, strings.shows.error_code) =
                (-1000 * n, -7 * n as i16, 0x8600 + n as u16);
            drop(strings);
            if let Some(id) = command {
                host.raw(1, RawSlot { id, ..RawSlot::ZERO }).drained();
            }
            host.cycles(SETTLES);
            let slot = host.slot(1);
            let data2 = (0x8600 + n as u32) << 16 | u32::from((-7 * n as i16) as u16);
            assert_eq!((slot.parm, slot.data1 as i32, slot.data2), (shown, -1000 * n, data2), "{kind:?} {command:?}");
        }
    }
}

/// SK-6.16 A request that repeats the one under way is one with it: not rejected, and counted as repeated.
#[test]
fn a_request_that_is_repeated_is_one() {
    let Bench { mut host, network, jobs } = Bench::new(EngineConfig::default(), drives(1));
    network.delay_sdo(1, 300_000_000);
    let request = SdoCommand::Write { slave: 1, object: ObjectAddress::new(0x6065, 0), size: SdoSize::Four, value: 7 };
    host.sdo(request).cycles(20);
    for _ in 0..3 {
        assert!(matches!(jobs.under_way(), Some(Started::Sdo(_))));
        host.sdo(request).cycles(2);
    }
    host.until("the answer", |host| matches!(host.sdo_answer(), SdoResponse::Done { .. }));
    host.cycles(SETTLES);
    assert_eq!((host.counters().sdo_repeated, host.counters().rejected_total(), jobs.transfers().len()), (3, 0, 1));
}
