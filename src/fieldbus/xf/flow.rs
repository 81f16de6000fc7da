//! Process data: the sets of outputs that each exchange writes, the cycles that it reads, and their results.
//!
//! In OP each exchange writes as many of the waiting sets as the packet, the chip's FIFO and [`ChipBus::depth`] allow,
//! and reads the same number of cycles. If more cycles wait in the chip, every other exchange only reads. Below OP the
//! newest inputs are read directly, without the FIFO.
//!
//! Usually one exchange of process data is in flight at a time. Its result is then known before the next one begins, so
//! a set that the chip has not accepted can be written again before later sets. If the cycle is too short for that, a
//! second exchange follows at once ([`Network::in_flight`]). A set that then turns out not to be written counts as
//! lost, because a later set has already been sent to the chip.

use super::chip_bus::ChipBus;
use super::tick_ns;
use crate::ethercat::{AlState, Ns, SlaveSet};
use crate::fieldbus::{AxisIn, MAX_AXES, Outputs};
use crate::xf::host::{HostError, HostState, ProcessKind, ProcessOutcome, ProcessRequest, Wires};

use super::answers::IMAGE_MAX;
use super::clear::Clearing;
use super::network::Network;

/// The backlog of cycles in the chip from which the bus reads faster. If this many cycles would remain in the chip
/// after an exchange with outputs, every other exchange only reads, because such an exchange reads more cycles. If no
/// outputs wait, a backlog of this size is read at once instead of at the next due time. \[OURS]
const BACKLOG: u8 = 4;
/// The maximum number of sets of outputs in one exchange, and of cycles that one exchange reads. \[OURS]
const IN_ONE_EXCHANGE: usize = 32;

/// A set of outputs in the layout of the chip's RxPDO.
#[derive(Clone, Debug)]
pub(super) struct Set {
    pub(super) id: u64,
    image: [u8; IMAGE_MAX],
}

impl Set {
    pub(super) fn of(outputs: &Outputs, network: &Network) -> Self {
        let mut image = [0; IMAGE_MAX];
        let slaves = network.process_data.iter().zip(&network.places).zip(&outputs.slaves);
        for ((data, place), outputs) in slaves.take(network.found.into()) {
            if let Some(data) = data {
                data.put_outputs(outputs, &mut image[place.outputs_at..]);
            }
        }
        Self { id: outputs.id, image }
    }
}

/// What an exchange of process data in flight carries.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Load {
    /// Outputs that keep the axes at a standstill, written directly, without the FIFO, before slaves enter OP.
    Hold,
    /// The newest inputs, read directly, without the FIFO.
    Inputs,
    /// An exchange through the FIFOs: it writes this number of waiting sets of outputs, and reads cycles that wait in
    /// the chip.
    Cycles(usize),
}

/// An exchange of process data that the driver has, or that it will get next.
#[derive(Clone, Copy, Debug)]
pub(super) struct Flying {
    load: Load,
    sequence: Option<u32>,
}

impl Flying {
    const fn sets(&self) -> usize {
        match self.load {
            Load::Cycles(sets) => sets,
            _ => 0,
        }
    }
}

impl<W: Wires> ChipBus<W> {
    /// Converts a set of outputs to the chip's layout. Lost slaves get outputs that keep their axes at a standstill.
    pub(super) fn set_of(&self, outputs: &Outputs) -> Set {
        let mut set = Set::of(outputs, &self.network);
        self.hold(self.network.lost, &mut set.image);
        set
    }

    /// In all sets of outputs that were not written yet, replaces the outputs of these slaves by outputs that keep
    /// their axes at a standstill. If no such set follows, the newest set is written once more with these outputs: the
    /// chip repeats its newest set, and a slave that answers again would get its old outputs (SK-4.62). Sets that are
    /// already in the chip are still sent.
    pub(super) fn hold_lost(&mut self, slaves: SlaveSet) {
        let mut queue = std::mem::take(&mut self.queue);
        queue.iter_mut().for_each(|set| self.hold(slaves, &mut set.image));
        self.queue = queue;
        self.repeat_is_due = self.runs;
    }

    /// The id of the newest outputs that were accepted and are not known to be sent.
    pub(super) fn newest_taken(&self) -> Option<u64> {
        let repeated = self.newest_written.as_ref().filter(|_| self.repeat_is_due).map(|set| set.id);
        self.queue.back().map(|set| set.id).or(self.ledger.newest_unsent().max(repeated))
    }

    /// The number of sets of outputs in flight to the chip. The queue still contains them.
    pub(super) fn sets_under_way(&self) -> usize {
        self.flying.iter().map(Flying::sets).sum()
    }

    /// Drops the waiting sets of outputs that were not given to the driver yet.
    pub(super) fn drop_queue(&mut self) {
        self.queue.truncate(self.sets_under_way());
    }

    /// Requests that outputs that keep all axes at a standstill are written directly, without the FIFO.
    pub(super) fn send_holding(&mut self) {
        self.flying.push_back(Flying { load: Load::Hold, sequence: None });
    }

    pub(super) fn is_holding(&self) -> bool {
        self.flying.iter().any(|flying| flying.load == Load::Hold)
    }

    /// Gives the driver the next exchange of process data.
    pub(super) fn feed(&mut self, now: Ns) {
        if self.host.state() != HostState::Running {
            return;
        }
        match self.flying.front() {
            Some(Flying { load: Load::Hold, sequence: None }) => {
                let image = self.holding();
                let outputs = &image[..self.network.rx_bytes];
                let sequence = self.host.process(ProcessRequest::DirectExchange { outputs }).ok();
                self.flying[0].sequence = sequence;
            }
            Some(Flying { load: Load::Hold | Load::Inputs, .. }) => {}
            // The condition is `runs`, not the state of the slaves: cycles are exchanged as long as the engine polls
            // them, also while slaves leave OP.
            _ if self.runs && self.flying.len() < self.network.in_flight => self.feed_cycles(now),
            _ if !self.network.mapped || self.network.at_least(AlState::SafeOp).is_empty() => {}
            None if !self.runs && now >= self.next_read => {
                self.next_read = now.saturating_add(tick_ns());
                let taken = self.host.process(ProcessRequest::DirectRead);
                self.fly(Load::Inputs, taken);
            }
            _ => {}
        }
    }

    /// Outputs that keep the axes of all slaves at a standstill: every motor is off, and in CSP the target is the
    /// actual position, if the inputs are known.
    fn holding(&self) -> [u8; IMAGE_MAX] {
        let mut image = [0; IMAGE_MAX];
        self.hold(SlaveSet::first(self.network.found), &mut image);
        image
    }

    /// Replaces the outputs of these slaves by outputs that keep their axes at a standstill. Slaves with stale inputs
    /// get a quick stop.
    fn hold(&self, slaves: SlaveSet, image: &mut [u8; IMAGE_MAX]) {
        for slave in slaves.intersection(SlaveSet::first(self.network.found)).iter() {
            let n = usize::from(slave) - 1;
            if let Some(data) = &self.network.process_data[n] {
                let place = self.network.places[n];
                let mut inputs = [AxisIn::default(); MAX_AXES];
                data.take_inputs(&self.newest_inputs[place.inputs_at..], &mut inputs);
                let is_stale = self.network.stale.contains(slave);
                let outputs = if is_stale { data.stopping(&inputs) } else { data.holding(&inputs) };
                data.put_outputs(&outputs, &mut image[place.outputs_at..]);
            }
        }
    }

    /// Records an exchange of process data that was given to the driver. Returns false if the driver has not accepted it: a
    /// later turn tries again.
    fn fly(&mut self, load: Load, taken: Result<u32, HostError>) -> bool {
        let sequence = taken.ok();
        if sequence.is_some() {
            self.flying.push_back(Flying { load, sequence });
        }
        sequence.is_some()
    }

    fn feed_cycles(&mut self, now: Ns) {
        let Network { rx_bytes, tx_bytes, cycle, .. } = self.network;
        let fits = |bytes: usize| (self.host.size().bytes() / bytes.max(1)).clamp(1, IN_ONE_EXCHANGE);
        let (both_fit, cycles_fit) = (fits(rx_bytes.max(tx_bytes)), fits(tx_bytes));
        let backlog = self.host.header().map_or(0, |header| header.tx_fifo);
        let may_write = matches!(self.clearing, Clearing::Idle);
        if may_write && std::mem::take(&mut self.repeat_is_due) {
            self.repeat_with_lost_holding();
        }
        let under_way = self.sets_under_way();
        let room = usize::from(self.depth())
            .saturating_sub(self.level.sets(now, cycle.ns()) as usize + under_way)
            .min(self.host.rx_free().into());
        let waiting = self.queue.len().saturating_sub(under_way);
        let sets = if may_write { waiting.min(both_fit).min(room) } else { 0 };
        let reads_alone = sets == 0 || self.wrote_last && usize::from(backlog) >= usize::from(BACKLOG) + sets;
        if !reads_alone {
            let going = self.queue.iter().skip(under_way).take(sets);
            let kind = ProcessKind::Exchange { count: sets as u8 };
            let taken = self.host.process_in_place(kind, sets * rx_bytes, |outputs| {
                for (set, place) in going.zip(outputs.chunks_exact_mut(rx_bytes.max(1))) {
                    place.copy_from_slice(&set.image[..rx_bytes]);
                }
            });
            if self.fly(Load::Cycles(sets), taken) {
                (self.wrote_last, self.next_read) = (true, now.saturating_add(cycle.ns()));
            }
        } else if now >= self.next_read || backlog >= BACKLOG {
            let taken = self.host.process(ProcessRequest::Read { count: cycles_fit as u8 });
            if self.fly(Load::Cycles(0), taken) {
                (self.wrote_last, self.next_read) = (false, now.saturating_add(cycle.ns() / 2));
            }
        }
    }

    /// If no set of outputs waits to be written, queues the newest one once more. In it lost slaves get outputs that
    /// keep their axes at a standstill.
    fn repeat_with_lost_holding(&mut self) {
        if self.queue.is_empty()
            && let Some(mut set) = self.newest_written.clone()
        {
            self.hold(self.network.lost, &mut set.image);
            self.queue.push_back(set);
        }
    }

    /// Evaluates the driver's reports about the exchanges of process data in flight.
    pub(super) fn take_reports(&mut self, now: Ns) {
        while let Some(report) = self.host.take_report() {
            let Some(Flying { load, .. }) = self.flying.pop_front_if(|flying| flying.sequence == Some(report.sequence))
            else {
                continue;
            };
            self.reported_at = self.host.counters().answers;
            match (load, report.outcome) {
                (Load::Cycles(sets), ProcessOutcome::Done { read }) => self.exchanged(now, sets, read),
                (Load::Cycles(sets), ProcessOutcome::AnswerLost) => {
                    self.gap = true;
                    self.exchanged(now, sets, false);
                }
                (Load::Cycles(sets), ProcessOutcome::Unknown) => {
                    self.gap = true;
                    self.ledger.doubt(self.queue.iter().take(sets).map(|set| set.id));
                    self.doubt(sets);
                }
                (Load::Cycles(sets), _) => {
                    if self.sets_under_way() > 0 {
                        self.give_up(sets);
                    }
                    // Without a later exchange in flight the sets of outputs stay in the queue and are written again.
                    // The ledger counts an exchange that has written and read nothing.
                    self.ledger.exchanged(std::iter::empty(), 0);
                }
                (Load::Inputs, ProcessOutcome::Done { read: true }) => {
                    let inputs = self.host.inputs();
                    self.newest_inputs[..inputs.len()].copy_from_slice(inputs);
                }
                (Load::Inputs, _) => {}
                (Load::Hold, ProcessOutcome::Done { .. } | ProcessOutcome::AnswerLost | ProcessOutcome::Refused) => {}
                (Load::Hold, _) => self.send_holding(),
            }
        }
    }

    /// Called when it is not known whether an exchange has written its sets of outputs, the oldest `sets` of the queue,
    /// to the chip. These sets count as lost. The newest of them may be the set that the chip repeats now. If no other
    /// set follows, the newest is written once more \[OURS]: otherwise the slaves might never get the last outputs, for
    /// example an SV_OFF, and the command frame would stay in the board's FIFO. If the chip already had that set, the
    /// slaves get it twice in a row, as they do when the chip repeats a set.
    fn doubt(&mut self, sets: usize) {
        if let Some(newest) = sets.checked_sub(1).and_then(|newest| self.queue.get(newest)) {
            self.newest_written = Some(newest.clone());
            self.repeat_is_due = self.runs;
        }
        self.give_up(sets);
    }

    /// Removes the oldest sets of outputs from the queue and counts them as lost: either they were certainly not
    /// written, or it is not known whether they were.
    fn give_up(&mut self, sets: usize) {
        let sets = self.queue.drain(..sets.min(self.queue.len())).len();
        self.lose_sets(sets as u64);
    }

    /// Counts accepted sets of outputs as lost: as far as is known they reach no slave.
    pub(super) fn lose_sets(&mut self, sets: u64) {
        self.counters.sets_lost += sets;
        self.outputs_lost += sets as u32;
    }

    /// Records an exchange in which the chip has accepted `sets` sets of outputs. `read`: whether the answer contains
    /// cycles.
    fn exchanged(&mut self, now: Ns, sets: usize, read: bool) {
        let (tx_bytes, cycle_ns) = (self.network.tx_bytes.max(1), self.network.cycle.ns());
        let cycles = if read { self.host.inputs().len() / tx_bytes } else { 0 };
        let first = self.ledger.cycles() + 1;
        let sets = sets.min(self.queue.len());
        if let Some(newest) = sets.checked_sub(1).and_then(|newest| self.queue.get(newest)) {
            self.newest_written = Some(newest.clone());
            self.level.wrote(now, sets as u64, cycle_ns);
        }
        self.ledger.exchanged(self.queue.drain(..sets).map(|set| set.id), cycles as u64);
        self.look_at_header();
        let waiting = self.host.header().map_or(0, |header| header.tx_fifo);
        self.gap |= waiting >= self.network.entries;
        for place in 0..cycles {
            let behind = (cycles - 1 - place) as u64;
            self.keep_cycle(now, first + place as u64, behind, place * tx_bytes);
        }
    }
}
