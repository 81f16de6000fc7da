//! A bus that owns its cycle and takes outputs ahead: a program sees the same as on a bus that the runner paces.

use ecmsk::cia402::{Controlword, DriveState};
use ecmsk::coe::ObjectAddress;
use ecmsk::engine::{Board, EngineConfig, Stepped, Stop};
use ecmsk::fieldbus::sim::SimBus;
use ecmsk::sk::{
    CycleTime, DcShift, FIFO_ENTRIES, FifoAction, Frame, MasterCommand, MasterState, Motion, RawSlot, SdoCommand,
    SlaveCommand, SlotSize, StateByte,
};
use ecmsk::slave::{Drive, DriveConfig, Slave};

use crate::host::Host;
use crate::puppet::{DISABLED, ENABLED, FAULT, Puppet, READY};
use crate::rig::{Rig, ahead};
use support::ahead_bus::{Ahead, AheadBus};

const SIZE: SlotSize = SlotSize::Bytes12;

fn clear() -> MasterCommand {
    MasterCommand::SetFifo(FifoAction::Clear)
}

fn host(how: Option<Ahead>, slaves: Vec<Box<dyn Slave>>) -> Host {
    let bus = SimBus::new(slaves);
    match how {
        None => Host::new(EngineConfig::default(), bus),
        Some(how) => Host::new(EngineConfig::default(), AheadBus::new(bus, how)),
    }
}

/// A typical program: configuration, motors on, a stream of targets by the free space, an SDO and nonsense meanwhile, a
/// burst that is too long, motors off. Returns the last report.
fn program(host: &mut Host) -> Frame {
    host.declare_drives(2);
    host.master(MasterCommand::SetDc { cycle: CycleTime::from_us(2000).unwrap(), shift: DcShift::Auto });
    host.go(MasterState::Op).drained().servo_on(1).servo_on(2);
    for n in 1..=600 {
        host.csp(1, n * 3).until("room", |host| host.answer().fifo_free > 20);
        match n {
            100 => host.sdo(SdoCommand::Read { slave: 2, object: ObjectAddress::new(0x1000, 0) }),
            200 => host.slave(2, SlaveCommand::IoRead),
            300 => host.cycles(500),
            400 => host.csp(2, -5000),
            _ => host,
        };
    }
    host.drained();
    let frame = Frame::new();
    for _ in 0..170 {
        host.arrive(&frame);
    }
    host.drained().slave(1, SlaveCommand::ServoOff).cycles(300);
    assert_eq!(host.drive(1).statusword.state(), Some(DriveState::SwitchOnDisabled));
    host.report.clone()
}

/// SK-5.3 The same program ends the same, to the byte, on every bus: every target once and in order, the SDO answered,
/// nonsense rejected, 10 of 170 frames lost.
#[test]
fn a_program_ends_the_same_on_every_bus() {
    let run = |how| {
        let puppets = [Puppet::obedient(), Puppet::obedient()];
        puppets[1].strings().objects.insert((0x1000, 0), (4, 0x0002_0192));
        let mut host = host(how, puppets.iter().map(Puppet::boxed).collect());
        let end = program(&mut host);
        (end, puppets.map(|puppet| puppet.targets()), host.counters())
    };
    let (end, targets, counts) = run(None);
    assert_eq!(targets, [(0..=600).map(|n| n * 3).collect::<Vec<_>>(), vec![0, -5000]]);
    assert_eq!((counts.full, counts.rejected_total()), (10, 1));
    for how in ahead() {
        let (its_end, its_targets, its_counts) = run(Some(how));
        assert_eq!(its_targets, targets, "{how:?}");
        for slot in 0..SIZE.slots() {
            assert_eq!(its_end.slot(SIZE, slot), end.slot(SIZE, slot), "{how:?}, slot {slot}");
        }
        assert_eq!(its_end.bytes(), end.bytes(), "{how:?}");
        assert_eq!(its_counts.full + its_counts.executed, counts.full + counts.executed, "{how:?}");
    }
}

/// SK-5.3 The same program moves servo drives to the same place.
#[test]
fn a_program_moves_drives_to_the_same_place() {
    let run = |how| {
        let drive = || Box::new(Drive::new(DriveConfig::default())) as Box<dyn Slave>;
        let mut host = host(how, vec![drive(), drive()]);
        program(&mut host);
        host.cycles(500);
        [host.drive(1), host.drive(2)].map(|drive| (drive.head, drive.position, drive.error_code, drive.statusword.0))
    };
    let end = run(None);
    assert_eq!((end[0].1, end[1].1), (1800, -5000));
    for how in ahead() {
        assert_eq!(run(Some(how)), end, "{how:?}");
    }
}

/// SK-2.14 The free space counts entries wherever they lie: 160 when idle, and never wrong in between.
/// SK-3.1 An answer belongs to its outputs, however late it comes.
/// SK-5.3 Every target reaches the slave once and in order.
/// SK-9.9 Each cycle of the bus makes a report: several in one poll, none in another.
#[test]
fn reports_are_right_however_cycles_and_polls_fall() {
    for how in ahead() {
        let mut rig = Rig::new(how);
        let mut seed = 1u32;
        let (mut several, mut none) = (0, 0);
        rig.target();
        rig.drained();
        rig.check_reports();
        for _ in 0..3000 {
            seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let random = seed >> 16;
            if rig.engine.fifo_free() > 8 {
                (0..random % 5).for_each(|_| rig.target());
            }
            let us = [1, 250, 900, 1000, 1000, 1100, 2500, 7000][random as usize / 8 % 8];
            rig.poll_after(us * 1000);
            several += u32::from(rig.news > 1);
            none += u32::from(rig.news == 0);
        }
        rig.drained();
        assert!(several > 100 && none > 100, "{several} and {none}");
        let targets = rig.puppet.targets();
        assert_eq!(targets, (0..=rig.targets).collect::<Vec<_>>(), "{how:?}");
        assert_eq!(rig.answer().fifo_free, FIFO_ENTRIES);
        assert_eq!((rig.engine.counters().cleared, rig.engine.counters().full), (0, 0));
    }
}

/// SK-5.22 SET_FIFO 1 drops the entries that the bus has taken ahead, too; SK-4.44 all of it is counted. SK-5.19 Its
/// frame is the first entry after it. SK-7.16 The axis stays at the last target that was sent, also when later frames
/// move others.
#[test]
fn clear_takes_back_what_lies_ahead() {
    for how in ahead() {
        let mut rig = Rig::new(how);
        let before = *rig.engine.counters();
        (0..100).for_each(|_| rig.target());
        rig.run(20);
        rig.send(|frame| frame.put_master(SIZE, &clear()));
        rig.run(300);
        let reached = *rig.puppet.targets().last().unwrap();
        assert!((18..=20).contains(&reached), "{how:?}: {reached}");
        let after = *rig.engine.counters();
        let (executed, cleared) = (after.executed - before.executed, after.cleared - before.cleared);
        assert_eq!((executed, cleared), (reached as u64 + 1, 100 - reached as u64), "{how:?}");
        assert_eq!((rig.answer().fifo_free, rig.drive(1).position), (FIFO_ENTRIES, reached), "{how:?}");
        assert_eq!((rig.drive(1).head.id, rig.drive(1).head.index), (0, 0), "the clear's own frame was executed");

        let csp = SlaveCommand::Csp(Motion::to(-7));
        rig.send(|frame| frame.put_slave(SIZE, 2, &csp.into()));
        rig.run(50);
        assert_eq!((rig.drive(1).position, rig.drive(2).position), (reached, -7), "{how:?}");
        assert_eq!(*rig.puppet.targets().last().unwrap(), reached, "{how:?}");
    }
}

/// SK-5.22 An SV_ON or SV_OFF that the bus has taken ahead when the FIFO is cleared has no effect.
#[test]
fn clear_takes_back_walks() {
    for how in ahead() {
        for (command, on) in [(SlaveCommand::ServoOff, true), (SlaveCommand::ServoOn, false)] {
            let mut rig = Rig::new(how);
            if !on {
                rig.send(|frame| frame.put_slave(SIZE, 1, &SlaveCommand::ServoOff.into()));
                rig.run(100);
            }
            rig.puppet.forget();
            (0..40).for_each(|_| rig.send(|_| {}));
            rig.send(|frame| frame.put_slave(SIZE, 1, &command.into()));
            (0..20).for_each(|_| rig.send(|_| {}));
            rig.run(10);
            rig.send(|frame| frame.put_master(SIZE, &clear()));
            rig.run(200);
            assert_eq!(rig.puppet.controlwords(), [if on { 0x0F } else { 0x00 }], "{how:?}");
            assert_eq!(rig.drive(1).statusword.is_enabled(), on, "{how:?}");
        }
    }
}

/// SK-5.22 [OURS] An axis that has left Operation enabled by itself stays off when entries are taken back: nothing that is sent
/// after the clear asks for its motor, though what was sent before it does; also if a threshold holds all entries back.
#[test]
fn clear_starts_no_motor() {
    for (how, held) in ahead().filter(|how| how.depth > 8).flat_map(|how| [(how, false), (how, true)]) {
        let mut rig = Rig::new(how);
        (0..100).for_each(|_| rig.target());
        rig.run(10);
        rig.puppet.strings().freeze(FAULT);
        rig.run(how.pipeline + 5);
        rig.send(|frame| frame.put_master(SIZE, &clear()));
        if held {
            rig.send(|frame| frame.put_master(SIZE, &MasterCommand::SetFifo(FifoAction::Threshold(20))));
        }
        rig.run(1);
        assert_eq!(rig.puppet.last().controlword, Controlword::ENABLE_OPERATION, "{how:?}");
        rig.puppet.forget();
        rig.run(50);
        assert_eq!(rig.puppet.controlwords(), [0], "{how:?}, held: {held}");
    }
}

/// SK-5.22 [OURS] An SV_ON that was sent and that the drive has ended is not brought back when a later SV_ON is taken back, and
/// neither is one whose drive has stopped while an SV_OFF and an SV_ON lay ahead: no motor is on by an SV_ON that was not sent.
#[test]
fn clear_brings_back_no_sv_on_that_has_ended() {
    let on_again = |rig: &mut Rig| rig.send(|frame| frame.put_slave(SIZE, 1, &SlaveCommand::ServoOn.into()));
    let stops = [(Some(FAULT), DISABLED), (Some(FAULT), ENABLED), (None, READY)];
    for (how, (fault, shows)) in ahead().filter(|how| how.depth > 8).flat_map(|how| stops.map(|stop| (how, stop))) {
        let mut rig = Rig::new(how);
        (0..50).for_each(|_| rig.target());
        if let Some(fault) = fault {
            rig.run(5);
            rig.puppet.strings().freeze(fault);
            rig.run(how.pipeline + 3);
            rig.puppet.strings().freeze(shows);
            rig.run(how.pipeline + 3);
        } else {
            rig.send(|frame| frame.put_slave(SIZE, 1, &SlaveCommand::ServoOff.into()));
            rig.run(5);
            rig.puppet.strings().freeze(shows);
        }
        on_again(&mut rig);
        rig.run(how.pipeline + 3);
        rig.send(|frame| frame.put_master(SIZE, &clear()));
        rig.run(1);
        assert_eq!(rig.puppet.last().controlword, Controlword::ENABLE_OPERATION, "{how:?}, {shows:04X}");
        rig.puppet.forget();
        rig.run(50);
        assert_eq!(rig.puppet.controlwords(), [0], "{how:?}, {shows:04X}");
    }
}

/// SK-5.12 A threshold holds entries back from the bus too, and all are executed once it is passed.
#[test]
fn a_threshold_holds_back_what_could_lie_ahead() {
    for how in ahead() {
        let mut rig = Rig::new(how);
        let threshold = MasterCommand::SetFifo(FifoAction::Threshold(100));
        rig.send(|frame| frame.put_master(SIZE, &threshold));
        (0..59).for_each(|_| rig.target());
        rig.run(200);
        assert_eq!((rig.answer().fifo_free, rig.puppet.targets().len()), (100, 1), "{how:?}");
        rig.target();
        rig.run(1);
        let before = rig.puppet.strings().sent.len();
        rig.run(19);
        let cycles = (rig.puppet.strings().sent.len() - before) as i32;
        assert_eq!(rig.puppet.last().target, cycles - 1, "{how:?}: one entry a cycle, SET_FIFO's frame first");
        assert_eq!(i32::from(rig.answer().fifo_free), 100 + rig.answered().target, "{how:?}: those answered are free");
        rig.drained();
        assert_eq!(rig.puppet.targets(), (0..=60).collect::<Vec<_>>(), "{how:?}");
    }
}

/// SK-5.6 Entries that the bus has taken ahead count: a frame that finds 160 in all is lost. SK-5.12 They count against
/// a threshold too.
#[test]
fn what_lies_ahead_counts() {
    for how in ahead() {
        let mut rig = Rig::new(how);
        (0..100).for_each(|_| rig.target());
        rig.run(1);
        let free = rig.engine.fifo_free();
        assert!((60..=62).contains(&free), "{how:?}: {free}");
        let before = rig.engine.counters().full;
        (0..100).for_each(|_| rig.target());
        let lost = rig.engine.counters().full - before;
        assert_eq!((rig.engine.fifo_free(), lost), (0, 100 - u64::from(free)), "{how:?}");
        rig.drained();

        (0..50).for_each(|_| rig.target());
        rig.run(2);
        let threshold = MasterCommand::SetFifo(FifoAction::Threshold(100));
        rig.send(|frame| frame.put_master(SIZE, &threshold));
        (0..20).for_each(|_| rig.target());
        assert!(rig.engine.fifo_free() < 100);
        rig.run(150);
        assert_eq!(rig.answer().fifo_free, FIFO_ENTRIES, "{how:?}: it was passed already");
    }
}

/// SK-5.3 Process data that follow a shaft by themselves do not pile up before the next entry.
/// SK-7.16 They do follow it.
#[test]
fn idle_outputs_do_not_pile_up() {
    for how in ahead() {
        let mut rig = Rig::new(how);
        rig.send(|frame| frame.put_slave(SIZE, 2, &SlaveCommand::ServoOff.into()));
        rig.run(100);
        (0..60).for_each(|_| rig.target());
        for n in 0..500 {
            rig.other.stand(n);
            rig.poll_after(250_000);
        }
        let target = rig.other.last().target;
        assert!((400..500).contains(&target), "{how:?}: {target}");
        rig.target();
        rig.run(4);
        assert_eq!(rig.puppet.last().target, 61, "{how:?}");
    }
}

/// SK-5.4 The first reports of OP show the command executed last for the slot, though nothing was sent to it yet.
#[test]
fn op_begins_with_the_heads_of_the_commands_before() {
    for how in ahead() {
        let mut host = host(Some(how), vec![Puppet::new().boxed()]);
        host.declare_drives(1).master(MasterCommand::SetState(MasterState::Op));
        host.raw(1, RawSlot { id: 0x06, index: 0x5A, data1: 8, data2: 1, ..RawSlot::ZERO });
        host.until("OP", |host| host.state() == StateByte::reached(MasterState::Op));
        assert_eq!((host.drive(1).head.id, host.drive(1).head.index), (0x06, 0x5A), "{how:?}");
    }
}

/// SK-7.14 A walk of SV_ON goes on behind entries and when no more come.
#[test]
fn a_walk_needs_no_more_frames() {
    for how in ahead() {
        let mut rig = Rig::new(how);
        rig.send(|frame| frame.put_slave(SIZE, 1, &SlaveCommand::ServoOff.into()));
        rig.run(100);
        assert_eq!(rig.drive(1).statusword.state(), Some(DriveState::SwitchOnDisabled), "{how:?}");
        for behind in 0..8 {
            rig.send(|frame| frame.put_slave(SIZE, 1, &SlaveCommand::ServoOn.into()));
            (0..behind).for_each(|_| rig.send(|_| {}));
            rig.run(100);
            assert!(rig.drive(1).statusword.is_enabled(), "{how:?}, {behind} entries behind");
            rig.send(|frame| frame.put_slave(SIZE, 1, &SlaveCommand::ServoOff.into()));
            (0..behind).for_each(|_| rig.send(|_| {}));
            rig.run(100);
            assert!(!rig.drive(1).statusword.is_enabled(), "{how:?}, {behind} entries behind");
        }
    }
}

/// SK-5.25 Leaving OP drops the entries that the bus has taken ahead; SK-4.44 it is counted. SK-4.66 The slot keeps its
/// last values: those of the last entry that was answered. SK-4.33 SW_RESET resets all of it.
#[test]
fn leaving_op_drops_what_lies_ahead() {
    for how in ahead() {
        let mut rig = Rig::new(how);
        let before = *rig.engine.counters();
        (0..150).for_each(|_| rig.target());
        rig.send(|frame| frame.put_master(SIZE, &MasterCommand::SetState(MasterState::SafeOp)));
        let mut answered = 0;
        while rig.engine.state() == StateByte::reached(MasterState::Op) {
            answered = rig.answered().target;
            rig.run(1);
        }
        rig.run(10);
        assert_eq!(rig.answer().state, StateByte::reached(MasterState::SafeOp));
        let after = *rig.engine.counters();
        let reached = rig.puppet.strings().sent.last().unwrap().target;
        let gone = after.executed - before.executed + after.cleared - before.cleared;
        assert_eq!((gone, after.executed - before.executed), (151, reached as u64), "{how:?}");
        assert_eq!(rig.drive(1).head.index, answered as u8, "{how:?}: the newest that was answered in OP");

        rig.go(MasterState::Op);
        // SK-3.32 SET_STATE's frame had GET_STATUS for this slave.
        assert_eq!((rig.answer().fifo_free, rig.drive(1).head.id), (FIFO_ENTRIES, 0), "{how:?}");
        assert_eq!(rig.drive(1).head.index, answered as u8, "{how:?}");
        assert!(!rig.drive(1).statusword.is_enabled(), "the board switches nothing on by itself");
        rig.servo_on();
        (0..50).for_each(|_| rig.target());
        rig.run(5);
        rig.send(|frame| frame.put_master(SIZE, &MasterCommand::SoftReset));
        rig.run(1000);
        assert_eq!(rig.answer().state, StateByte::reached(MasterState::PreOp));
        assert_eq!(rig.drive(1), Default::default(), "{how:?}");
        rig.go(MasterState::Op);
        assert_eq!(rig.answer().fifo_free, FIFO_ENTRIES, "{how:?}");
    }
}

/// SK-9.8 A report comes every cycle: a poll that falls between two cycles of the bus is no silence.
#[test]
fn a_phase_is_no_silence() {
    for how in ahead() {
        let bus = SimBus::new(vec![Puppet::new().boxed()]);
        let network = bus.handle();
        let mut board = Board::new(EngineConfig::default(), Box::new(AheadBus::new(bus, how)));
        assert!(board.boot(60_000_000_000));
        let stepped = Stepped::new(board, 125_000, 32);
        let mut report = Frame::new();
        let slower = MasterCommand::SetDc { cycle: CycleTime::from_us(32_000).unwrap(), shift: DcShift::Auto };
        let states = [MasterState::Op, MasterState::PreOp, MasterState::Op];
        for command in [slower].into_iter().chain(states.map(MasterCommand::SetState)) {
            let mut frame = Frame::new();
            frame.put_master(SIZE, &command);
            stepped.write(&frame).unwrap();
            for _ in 0..1000 {
                stepped.read(&mut report, None).expect("a report");
            }
        }
        network.cut_after(0);
        let end = std::iter::repeat_with(|| stepped.read(&mut report, None)).find_map(Result::err);
        assert!(matches!(end, Some(Stop::Silent { .. })), "{how:?}: {end:?}");
    }
}
