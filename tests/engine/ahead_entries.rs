//! Commands for the board itself in an entry, on a bus that takes outputs ahead: they act with the entry's outputs.

use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

use ecmsk::coe::ObjectAddress;
use ecmsk::engine::EngineConfig;
use ecmsk::fieldbus::sim::SimBus;
use ecmsk::fieldbus::{BusError, Fieldbus, Outputs};
use ecmsk::sk::{
    CommandId, FIFO_ENTRIES, FifoAction, Frame, MasterCommand, MasterState, Motion, RawSlot, SdoCommand, SdoResponse,
    SlaveCommand,
};

use crate::host::Host;
use crate::network_rig::Net;
use crate::puppet::Puppet;
use crate::rig::ahead;
use support::ahead_bus::{Ahead, AheadBus};
use support::hand_on;

/// Buses that take several outputs ahead.
fn deep() -> impl Iterator<Item = Ahead> {
    ahead().filter(|how| how.depth > 1)
}

/// `n` frames arrive: the k-th one holds target k and LIO_WR k.
fn arrive(net: &mut Net, n: u8) {
    for k in 1..=n {
        let mut frame = Frame::new();
        frame.put_master(net.host.size, &MasterCommand::LocalWrite(k));
        frame.put_slave(net.host.size, 1, &SlaveCommand::Csp(Motion::to(k.into())).with_index(k));
        net.host.arrive(&frame);
    }
}

/// The newest target that slave 1 was sent.
fn sent(net: &Net) -> i32 {
    net.puppets[0].strings().sent.last().map_or(0, |out| out.target)
}

/// The same with the chip's outputs.
fn target_and_outputs(net: &Net) -> (i32, u8) {
    (sent(net), net.host.board.engine().local_outputs())
}

/// SK-5.21 LIO_WR acts with the target that stands beside it, in every cycle. SK-8.3 LIO_RD answers once its entry has run.
#[test]
fn lio_acts_with_its_outputs() {
    for how in deep() {
        let mut net = Net::on(Some(how), 1);
        arrive(&mut net, 50);
        let mut seen = vec![];
        for _ in 0..80 {
            net.host.cycle();
            // The marker is known when the entry is answered.
            let answered = net.host.drive(1).head.index;
            assert_eq!(answered, net.host.board.engine().local_outputs(), "{how:?}");
            seen.push(answered);
        }
        seen.dedup();
        assert!(seen.len() > 40 && seen.ends_with(&[50]), "{how:?}: {seen:?}");

        net.host.board.engine_mut().set_local_inputs(0x2A);
        arrive(&mut net, 20);
        net.host.master(MasterCommand::LocalRead);
        while sent(&net) < 20 {
            assert_eq!(net.host.answer().result, 0, "{how:?}");
            net.host.cycle();
        }
        net.settle();
        assert_eq!(net.host.answer().result, 0x2A, "{how:?}");
    }
}

/// SK-5.20 An SDO starts when its entry's outputs go. SK-6.3 Until then the slot is free for others.
#[test]
fn an_sdo_starts_with_its_outputs() {
    for how in deep() {
        let mut net = Net::on(Some(how), 1);
        net.puppets[0].strings().objects.insert((0x2000, 0), (4, 77));
        arrive(&mut net, 40);
        let transfers = net.jobs.transfers().len();
        let mut frame = Frame::new();
        frame.put_sdo(net.host.size, &SdoCommand::Read { slave: 1, object: ObjectAddress::new(0x2000, 0) });
        net.host.arrive(&frame);
        while sent(&net) < 40 {
            assert_eq!(net.jobs.transfers().len(), transfers, "{how:?}");
            net.host.cycle();
        }
        net.settle();
        assert!(matches!(net.host.sdo_answer(), SdoResponse::Done { value: 77, .. }), "{how:?}");
        assert_eq!(net.jobs.transfers().len(), transfers + 1, "{how:?}");
    }
}

/// SK-5.22 SK-4.44 Entries that a clear takes back have not acted, and entries that have acted are not counted as
/// cleared: outputs, SDO, a rejection. SK-5.25 They do not act when OP is left, either.
#[test]
fn what_is_taken_back_has_not_acted() {
    for how in deep() {
        for leaves in [false, true] {
            let mut net = Net::on(Some(how), 1);
            let (before, mark, transfers) = (net.host.counters(), net.host.mark(), net.jobs.transfers().len());
            arrive(&mut net, 30);
            let mut frame = Frame::new();
            frame.put_sdo(net.host.size, &SdoCommand::Read { slave: 1, object: ObjectAddress::new(0x2000, 0) });
            frame.put(net.host.size, 0, &RawSlot { id: 0x77, ..RawSlot::ZERO });
            net.host.arrive(&frame).cycles(29 - usize::from(how.depth.min(12)));
            let end = match leaves {
                false => MasterCommand::SetFifo(FifoAction::Clear),
                true => MasterCommand::SetState(MasterState::SafeOp),
            };
            if leaves {
                net.host.master(end).until("SafeOP", |host| host.state().0 == 4).cycles(50);
            } else {
                net.host.master(end).cycles(50);
                assert_eq!(net.host.answer().fifo_free, FIFO_ENTRIES);
            }
            let counters = net.host.counters();
            let (target, outputs) = target_and_outputs(&net);
            if !leaves {
                assert_eq!(target, i32::from(outputs), "{how:?}");
                assert!(outputs < 30, "{how:?}: {outputs}");
                assert_eq!((net.host.rejections(mark), net.jobs.transfers().len()), (vec![], transfers), "{how:?}");
                let executed = counters.executed - before.executed;
                assert_eq!(executed, u64::from(outputs) + 1, "{how:?}: and the clear's own");
            }
            let gone = counters.executed + counters.cleared - before.executed - before.cleared;
            assert_eq!(gone, 32, "{how:?}");
        }
    }
}

/// SK-4.39 The rejection of a command in slot 0 or in the SDO slot comes with its entry as well.
#[test]
fn rejections_come_with_their_entry() {
    for how in deep() {
        let mut net = Net::on(Some(how), 1);
        arrive(&mut net, 20);
        let mark = net.host.mark();
        let mut frame = Frame::new();
        frame.put(net.host.size, 0, &RawSlot { id: 0x02, ..RawSlot::ZERO });
        frame.put(net.host.size, net.host.size.sdo_slot(), &RawSlot { id: 0x15, ..RawSlot::ZERO });
        net.host.arrive(&frame);
        while sent(&net) < 20 {
            assert_eq!(net.host.rejections(mark), [], "{how:?}");
            net.host.cycle();
        }
        net.settle();
        let rejected: Vec<(u8, CommandId)> =
            net.host.rejections(mark).into_iter().map(|(slot, id, _)| (slot, id)).collect();
        assert_eq!(rejected, [(0, CommandId::SetAxis), (41, CommandId::Csp)], "{how:?}");
    }
}

/// A bus whose cable is cut, as often as the test sets, between its report of free room and taking outputs.
struct Torn<B> {
    bus: B,
    cuts: Arc<AtomicU32>,
}

impl<B: Fieldbus> Fieldbus for Torn<B> {
    hand_on!(bus: pacing, start, start_sdo, poll_job, poll_sdo, cancel_job, cancel_sdo, room, clear_ahead, poll_clear, poll);

    fn push(&mut self, outputs: &Outputs) -> Result<(), BusError> {
        match self.cuts.fetch_update(Relaxed, Relaxed, |n| n.checked_sub(1)) {
            Ok(_) => Err(BusError::Down),
            Err(_) => self.bus.push(outputs),
        }
    }
}

/// Boards in OP whose drive is on, on every kind of bus, each with its number of cuts.
fn torn() -> impl Iterator<Item = (Host, Puppet, Arc<AtomicU32>, Option<Ahead>)> {
    std::iter::once(None).chain(deep().map(Some)).map(|how| {
        let (puppet, cuts) = (Puppet::obedient(), Arc::new(AtomicU32::new(0)));
        let (bus, torn) = (SimBus::new(vec![puppet.boxed()]), Arc::clone(&cuts));
        let mut host = match how {
            None => Host::new(EngineConfig::default(), Torn { bus, cuts: torn }),
            Some(how) => Host::new(EngineConfig::default(), Torn { bus: AheadBus::new(bus, how), cuts: torn }),
        };
        host.op(1).servo_on(1).cycles(30);
        (host, puppet, cuts, how)
    })
}

/// SK-5.21 SK-4.59 An entry whose outputs the bus does not take any more has been executed: its LIO has acted, once.
#[test]
fn a_cable_that_is_cut_this_moment() {
    for (mut host, puppet, cuts, how) in torn() {
        let before = host.counters();
        cuts.store(1, Relaxed);
        let mut frame = Frame::new();
        frame.put_master(host.size, &MasterCommand::LocalWrite(0x15));
        frame.put_slave(host.size, 1, &SlaveCommand::Csp(Motion::to(9)).into());
        host.arrive(&frame).cycle();
        assert_eq!((host.board.engine().local_outputs(), cuts.load(Relaxed)), (0x15, 0), "{how:?}");
        host.cycles(30);
        assert_eq!((host.counters().executed, puppet.last().target), (before.executed + 1, 9), "{how:?}");
    }
}

/// SK-4.44 [OURS] A command that no outputs have carried is counted: when another one for the slave takes its place, and
/// when OP ends.
#[test]
fn what_a_cut_cable_has_not_carried_is_counted() {
    for (mut host, puppet, cuts, how) in torn() {
        let before = host.counters().for_lost;
        cuts.store(2, Relaxed);
        for target in [9, 10] {
            let mut frame = Frame::new();
            frame.put_slave(host.size, 1, &SlaveCommand::Csp(Motion::to(target)).into());
            host.arrive(&frame).cycle();
        }
        host.cycles(30);
        assert_eq!((host.counters().for_lost - before, puppet.last().target), (1, 10), "{how:?}");

        cuts.store(u32::MAX, Relaxed);
        host.csp(1, 11).cycle();
        assert_eq!(host.counters().for_lost - before, 1, "{how:?}: it may still go");
        host.go(MasterState::SafeOp);
        assert_eq!(host.counters().for_lost - before, 2, "{how:?}");
    }
}
