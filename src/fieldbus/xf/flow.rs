//! Process data: which sets are written and read in which exchange, and what has come back.
//!
//! One exchange of process data is under way at a time, so that its end is known before the next one begins and a set that
//! the chip did not take is written again in its place. In OP it writes as many of the sets that wait as the packet and
//! the chip's FIFO hold, and reads as many cycles; where more cycles wait, they are read alone. Below OP the newest inputs
//! are read past the FIFO.

use super::{XfBus, tick_ns};
use crate::ethercat::{AlState, Ns, SlaveSet};
use crate::fieldbus::{AxisIn, Cleared, CycleDone, Inputs, MAX_AXES, Outputs};
use crate::xf::host::{HostState, ProcessData, ProcessOutcome, Wires};
use crate::xf::request::Fifos;

use super::ask::{Ask, Asked};
use super::network::Network;

/// The most bytes of process data in a direction.
pub(super) const IMAGE_MAX: usize = crate::xf::DataSize::MAX.bytes();
/// Cycles that are kept until they are polled; then the oldest is lost. \[OURS]
pub(super) const ANSWERS: usize = 128;
/// Answers of the chip after which a header tells the fill levels behind a command (OBS: they lag two exchanges).
const SETTLED: u64 = 3;
/// So many cycles waiting in the chip are read at once, whatever there is to write.
const BACKLOG: u8 = 4;

/// A set of outputs as the chip's RxPDO.
#[derive(Clone, Debug)]
pub(super) struct Set {
    id: u64,
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

/// A cycle of the chip.
#[derive(Clone, Debug)]
pub(super) struct Answer {
    /// When it ran, in time of the wires.
    at: Ns,
    sent: Option<u64>,
    cycles_lost: u32,
    image: Vec<u8>,
}

impl Default for Answer {
    fn default() -> Self {
        Self { at: 0, sent: None, cycles_lost: 0, image: vec![0; IMAGE_MAX] }
    }
}

/// What the process data under way are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Load {
    /// Outputs past the FIFO with which nothing moves.
    Hold,
    /// The newest inputs past the FIFO.
    Inputs,
    /// So many of the sets that wait, and cycles.
    Cycles(usize),
}

/// Process data that were handed to the driver, or are to be.
#[derive(Clone, Copy, Debug)]
pub(super) struct Flying {
    load: Load,
    sequence: Option<u32>,
}

impl Flying {
    pub(super) const fn hold() -> Self {
        Self { load: Load::Hold, sequence: None }
    }

    pub(super) fn is_hold(&self) -> bool {
        self.load == Load::Hold
    }

    const fn sets(&self) -> usize {
        match self.load {
            Load::Cycles(sets) => sets,
            _ => 0,
        }
    }
}

/// How far a clear is.
#[derive(Clone, Copy, Debug)]
pub(super) enum Clearing {
    Idle,
    /// The sets under way are to be known first.
    Begun,
    /// The chip is told to stop taking sets out of its FIFO.
    Stopping(Asked),
    /// So many answers are to be there, so that the fill level of the stopped FIFO is known.
    Settling(u64),
    /// The FIFO is emptied; it had that level.
    Emptying(Asked, u8),
    /// The chip goes on.
    GoingOn(Asked, Option<u64>),
    Ended(Option<u64>),
}

impl<W: Wires> XfBus<W> {
    /// These outputs as a set in which lost slaves hold.
    pub(super) fn set_of(&self, outputs: &Outputs) -> Set {
        let mut set = Set::of(outputs, &self.network);
        self.hold(self.network.lost, &mut set.image);
        set
    }

    /// What was not written yet holds these slaves, and something is written for it: the chip repeats its newest set, and
    /// a slave that answers again would get the outputs that it had (SK-4.62). What lies in the chip already is sent.
    pub(super) fn hold_lost(&mut self, slaves: SlaveSet) {
        let mut queue = std::mem::take(&mut self.queue);
        queue.iter_mut().for_each(|set| self.hold(slaves, &mut set.image));
        self.queue = queue;
        self.hold_is_due = self.runs;
    }

    /// The id of the newest outputs that were taken and are not known to be sent.
    pub(super) fn newest_taken(&self) -> Option<u64> {
        self.queue.back().map(|set| set.id).or(self.ledger.newest_unsent())
    }

    /// Sets that are under way to the chip. They still stand in the queue.
    fn sets_under_way(&self) -> usize {
        self.flying.as_ref().map_or(0, Flying::sets)
    }

    /// The sets that have not been handed to the driver are dropped.
    pub(super) fn drop_queue(&mut self) {
        self.queue.truncate(self.sets_under_way());
    }

    /// Hands the driver the next process data.
    pub(super) fn feed(&mut self, now: Ns) {
        if self.host.state() != HostState::Running {
            return;
        }
        match self.flying {
            Some(Flying { load: Load::Hold, sequence: None }) => {
                let image = self.holding();
                let outputs = &image[..self.network.rx_bytes];
                let sequence = self.host.process(ProcessData::DirectExchange { outputs }).ok();
                self.flying = Some(Flying { load: Load::Hold, sequence });
            }
            Some(_) => {}
            None if !self.network.mapped || self.network.at_least(AlState::SafeOp).is_empty() => {}
            None if self.runs => self.feed_cycles(now),
            None if now >= self.next_read => {
                self.next_read = now.saturating_add(tick_ns());
                self.fly(Load::Inputs, ProcessData::DirectRead);
            }
            None => {}
        }
    }

    /// Outputs with which no motor is on and every axis in CSP is where its target is, if its inputs are known.
    fn holding(&self) -> [u8; IMAGE_MAX] {
        let mut image = [0; IMAGE_MAX];
        self.hold(SlaveSet::first(self.network.found), &mut image);
        image
    }

    /// These slaves' outputs become those with which nothing moves.
    fn hold(&self, slaves: SlaveSet, image: &mut [u8; IMAGE_MAX]) {
        for slave in slaves.intersection(SlaveSet::first(self.network.found)).iter() {
            let n = usize::from(slave) - 1;
            if let Some(data) = &self.network.process_data[n] {
                let place = self.network.places[n];
                let mut inputs = [AxisIn::default(); MAX_AXES];
                data.take_inputs(&self.newest_inputs[place.inputs_at..], &mut inputs);
                data.put_outputs(&data.holding(&inputs), &mut image[place.outputs_at..]);
            }
        }
    }

    fn fly(&mut self, load: Load, data: ProcessData<'_>) {
        // A driver that takes none now takes them in a later turn.
        self.flying = self.host.process(data).ok().map(|sequence| Flying { load, sequence: Some(sequence) });
    }

    fn feed_cycles(&mut self, now: Ns) {
        let (rx_bytes, tx_bytes) = (self.network.rx_bytes, self.network.tx_bytes);
        let fits = (self.host.size().bytes() / rx_bytes.max(tx_bytes).max(1)).clamp(1, ANSWER_MOST);
        let backlog = self.host.header().map_or(0, |header| header.tx_fifo);
        let room = (u64::from(self.options.ahead).saturating_sub(self.ledger.ahead()) as usize)
            .min(self.host.rx_free().into());
        let may_write = matches!(self.clearing, Clearing::Idle);
        if may_write
            && std::mem::take(&mut self.hold_is_due)
            && self.queue.is_empty()
            && let Some(mut set) = self.newest_written.clone()
        {
            self.hold(self.network.lost, &mut set.image);
            self.queue.push_back(set);
        }
        let sets = if may_write { self.queue.len().min(fits).min(room) } else { 0 };
        let is_due = now >= self.next_read;
        if sets > 0 && backlog < BACKLOG + sets as u8 {
            let mut outputs = [0; IMAGE_MAX];
            for (set, place) in self.queue.iter().zip(outputs.chunks_exact_mut(rx_bytes.max(1))).take(sets) {
                place.copy_from_slice(&set.image[..rx_bytes]);
            }
            let outputs = &outputs[..sets * rx_bytes];
            self.next_read = now.saturating_add(self.network.cycle.ns());
            self.fly(Load::Cycles(sets), ProcessData::Exchange { count: sets as u8, outputs });
        } else if is_due || backlog >= BACKLOG {
            self.next_read = now.saturating_add(self.network.cycle.ns() / 2);
            self.fly(Load::Cycles(0), ProcessData::Read { count: fits as u8 });
        }
    }

    /// Takes what has become of the process data under way.
    pub(super) fn take_reports(&mut self, now: Ns) {
        while let Some(report) = self.host.take_report() {
            let Some(Flying { load, sequence }) = self.flying else { continue };
            if sequence != Some(report.sequence) {
                continue;
            }
            self.flying = None;
            match (load, report.outcome) {
                (Load::Cycles(sets), ProcessOutcome::Done { read }) => self.exchanged(now, sets, read),
                (Load::Cycles(sets), ProcessOutcome::AnswerLost) => {
                    self.gap = true;
                    self.exchanged(now, sets, false);
                }
                (Load::Cycles(sets), ProcessOutcome::Unknown) => {
                    self.counters.sets_lost += sets as u64;
                    self.queue.drain(..sets.min(self.queue.len()));
                    self.gap = true;
                    self.ledger.doubt(sets as u64);
                }
                // They still stand in the queue.
                (Load::Cycles(_), _) => self.ledger.exchanged(std::iter::empty(), 0),
                (Load::Inputs, ProcessOutcome::Done { read: true }) => {
                    let inputs = self.host.inputs();
                    self.newest_inputs[..inputs.len()].copy_from_slice(inputs);
                }
                (Load::Inputs, _) => {}
                (Load::Hold, ProcessOutcome::Done { .. } | ProcessOutcome::AnswerLost | ProcessOutcome::Refused) => {}
                (Load::Hold, _) => self.flying = Some(Flying::hold()),
            }
        }
    }

    /// The chip has taken so many sets, and gives cycles if it says so.
    fn exchanged(&mut self, now: Ns, sets: usize, read: bool) {
        let tx_bytes = self.network.tx_bytes.max(1);
        let cycles = if read { self.host.inputs().len() / tx_bytes } else { 0 };
        let first = self.ledger.cycles() + 1;
        if let Some(newest) = sets.checked_sub(1).and_then(|newest| self.queue.get(newest)) {
            self.newest_written = Some(newest.clone());
        }
        self.ledger.exchanged(self.queue.drain(..sets.min(self.queue.len())).map(|set| set.id), cycles as u64);
        self.look_at_header();
        let waiting = self.host.header().map_or(0, |header| header.tx_fifo);
        self.gap |= waiting >= self.network.entries;
        for place in 0..cycles {
            let behind = (cycles - 1 - place) as u64;
            self.keep_cycle(now, first + place as u64, behind, place * tx_bytes);
        }
    }

    /// Keeps a cycle behind which so many others were read in the same exchange.
    fn keep_cycle(&mut self, now: Ns, cycle: u64, behind: u64, from: usize) {
        let period_ns = self.network.cycle.ns();
        let estimate = now.saturating_sub(behind * period_ns);
        let due = self.newest_cycle.saturating_add(period_ns);
        let cycles_lost =
            if std::mem::take(&mut self.gap) { (estimate.saturating_sub(due) / period_ns) as u32 } else { 0 };
        let at = due.clamp(estimate.saturating_sub(period_ns), estimate).max(self.newest_cycle + 1).min(now);
        self.newest_cycle = at;
        self.counters.cycles_lost += u64::from(cycles_lost);
        let sent = self.ledger.sent_in(cycle);
        let mut answer = match self.spare.pop() {
            Some(answer) => answer,
            None => {
                // Nobody polls: the oldest goes.
                let Some(oldest) = self.answers.pop_front() else { return };
                self.lost_cycles += oldest.cycles_lost + 1;
                self.counters.cycles_lost += 1;
                oldest
            }
        };
        let tx_bytes = self.network.tx_bytes;
        answer.image[..tx_bytes].copy_from_slice(&self.host.inputs()[from..from + tx_bytes]);
        (answer.at, answer.sent, answer.cycles_lost) = (at, sent, cycles_lost);
        self.answers.push_back(answer);
    }

    /// The next cycle of the chip.
    pub(super) fn next_answer(&mut self, now: Ns) -> Option<CycleDone> {
        let at = self.engine_time(self.answers.front()?.at);
        if at > now {
            return None;
        }
        let answer = self.answers.pop_front()?;
        let tx_bytes = self.network.tx_bytes;
        self.newest_inputs[..tx_bytes].copy_from_slice(&answer.image[..tx_bytes]);
        let answers_lost = answer.cycles_lost + std::mem::take(&mut self.lost_cycles);
        let at = at.max(self.told_at + 1).min(now);
        let done = self.done(at, answer.sent, answers_lost);
        self.spare.push(answer);
        Some(done)
    }

    /// A cycle while the chip has none to tell.
    pub(super) fn next_tick(&mut self, now: Ns) -> Option<CycleDone> {
        let at = self.told_at.saturating_add(tick_ns());
        if at > now {
            return None;
        }
        // A network that has been lost takes outputs, and nobody gets them.
        let set = self.queue.pop_front();
        self.counters.sets_lost += u64::from(set.is_some());
        if let Some(set) = set {
            self.dropped = Some(set.id);
        }
        let newest = self.dropped.or(self.ledger.newest_sent());
        let lost = std::mem::take(&mut self.lost_cycles);
        Some(self.done(at, newest, lost))
    }

    fn done(&mut self, at: Ns, outputs: Option<u64>, answers_lost: u32) -> CycleDone {
        self.told_at = at;
        CycleDone { at, outputs, answers_lost, working_counter: 0, expected_working_counter: 0, next_deadline: None }
    }

    /// What the slaves sent in the newest cycle.
    pub(super) fn fill(&self, inputs: &mut Inputs) {
        let network = &self.network;
        let in_safe_op = network.at_least(AlState::SafeOp);
        for (n, slave) in (1..=network.found).enumerate() {
            if let Some(data) = &network.process_data[n]
                && in_safe_op.contains(slave)
                && !network.lost.contains(slave)
            {
                data.take_inputs(&self.newest_inputs[network.places[n].inputs_at..], &mut inputs.slaves[n]);
            }
        }
        let found = SlaveSet::first(network.found);
        (inputs.lost, inputs.lost_from) = (network.lost, network.lost_from);
        inputs.without_outputs = found.difference(network.in_op());
        inputs.without_inputs = found.difference(in_safe_op);
    }

    pub(super) fn begin_clear(&mut self) {
        self.drop_queue();
        // What was to hold lost slaves may be among what is dropped.
        self.hold_is_due = self.runs && !self.network.lost.is_empty();
        self.clearing = Clearing::Begun;
    }

    /// A clear goes on.
    pub(super) fn clear_on(&mut self, now: Ns) {
        let answers = self.host.counters().answers;
        self.clearing = match self.clearing {
            Clearing::Begun if !self.runs => Clearing::Ended(self.dropped.or(self.ledger.newest_sent())),
            Clearing::Begun if self.sets_under_way() == 0 => {
                match (Ask::Fifo { on: false }).submit(&mut self.host, now) {
                    Ok(asked) => Clearing::Stopping(asked),
                    Err(_) => Clearing::Begun,
                }
            }
            Clearing::Stopping(asked) => match asked.reply(&mut self.host) {
                None => Clearing::Stopping(asked),
                Some(Ok(_)) => Clearing::Settling(answers + SETTLED),
                Some(Err(_)) => Clearing::Ended(self.ledger.lost()),
            },
            Clearing::Settling(until) if answers >= until && self.flying.is_none() => {
                let level = self.host.header().map_or(0, |header| header.rx_fifo);
                match Ask::Clear(Fifos::Rx).submit(&mut self.host, now) {
                    Ok(asked) => Clearing::Emptying(asked, level),
                    Err(_) => Clearing::Settling(until),
                }
            }
            Clearing::Emptying(asked, level) => match asked.reply(&mut self.host) {
                None => Clearing::Emptying(asked, level),
                Some(Ok(_)) => {
                    let newest_sent = self.ledger.cleared(level);
                    match (Ask::Fifo { on: true }).submit(&mut self.host, now) {
                        Ok(asked) if self.runs => Clearing::GoingOn(asked, newest_sent),
                        _ => Clearing::Ended(newest_sent),
                    }
                }
                Some(Err(_)) => Clearing::Ended(self.ledger.lost()),
            },
            Clearing::GoingOn(asked, newest_sent) => match asked.reply(&mut self.host) {
                None => Clearing::GoingOn(asked, newest_sent),
                Some(_) => Clearing::Ended(newest_sent),
            },
            other => other,
        };
    }

    pub(super) fn is_clearing(&self) -> bool {
        !matches!(self.clearing, Clearing::Idle)
    }

    pub(super) fn take_cleared(&mut self) -> Option<Cleared> {
        let Clearing::Ended(newest_sent) = self.clearing else { return None };
        self.clearing = Clearing::Idle;
        Some(Cleared { newest_sent })
    }
}

/// The most cycles of one exchange.
const ANSWER_MOST: usize = 32;
