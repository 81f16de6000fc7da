//! Outputs on their way: from the command FIFO into the process image, to the bus, and back again when SET_FIFO clears
//! what a bus has taken ahead.
//!
//! **What was sent** is known by the ids of polled cycles, some cycles late, and by the end of a clear. Entries count as
//! executed, and what they hold for the board itself acts, when their outputs are known to be sent.
//!
//! **How much lies ahead** can only be estimated: every cycle since the newest one polled has taken one set, if one had been
//! pushed by then. That estimate decides what is worth pushing, never what was sent.
//!
//! **An axis that is being switched on** is held where it was measured last. Outputs that lie ahead hold it where it was
//! before that: one that sags while its brake opens would be pulled back to there when it is enabled, however deep the bus
//! is. So while an axis is on its way to Operation enabled hardly anything is pushed ahead \[OURS]: [`AHEAD_AT_REST`], or
//! [`AHEAD_IN_MOTION`] while other axes follow targets, which are not to stand still for it.

use super::volatile::Volatile;
use super::{Engine, Event, Executed};
use crate::cia402::Mode;
use crate::fieldbus::{Cleared, CycleDone, Fieldbus, Ns, Outputs, Pacing, SlaveSet};
use crate::sk::RawSlot;

/// Sets of outputs that may lie ahead while an axis is being switched on and none follows targets \[OURS].
const AHEAD_AT_REST: u64 = 1;
/// And while others follow targets \[OURS]: enough that a look which is a few cycles late leaves no gap in their motion.
const AHEAD_IN_MOTION: u64 = 4;

/// Whether what lies ahead is being thrown away. Nothing is pushed meanwhile.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Clearing {
    No,
    /// With the next cycle.
    Wanted,
    /// The bus is at it.
    UnderWay,
}

/// A FIFO entry on its way.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ahead {
    /// The outputs that carry it.
    id: u64,
    /// What of it acts when they are sent, and not before: `None` once it has.
    held: Option<Held>,
}

/// What a FIFO entry holds for the board itself: the chip's inputs and outputs, and the SDO slot. On a bus that takes
/// outputs ahead it acts with the entry's outputs (SK-5): with what it stands beside, and not at all if a clear takes it
/// back.
#[derive(Clone, Copy, Debug)]
pub(super) struct Held {
    pub(super) master: RawSlot,
    pub(super) sdo: RawSlot,
}

impl Engine {
    /// Hands the bus what it takes: one FIFO entry in each set of outputs.
    pub(super) fn push_outputs(&mut self, now: Ns, bus: &mut dyn Fieldbus) {
        if self.is_clearing() {
            return;
        }
        let most = self.most_ahead();
        for _ in 0..bus.room() {
            let ahead = self.lies_ahead(now);
            if ahead >= most || self.unknown() >= self.most_unknown {
                return;
            }
            let (has_entry, held) = self.take_entry(now);
            // A bus that owns its cycle repeats the last outputs by itself.
            let repeats = self.pacing != Pacing::Runner && (ahead > 0 || !self.outputs_left && !self.outputs_changed());
            if repeats && !has_entry {
                return;
            }
            let id = self.next_output_id;
            self.outputs.id = id;
            let n = self.executed.len() as u64;
            let executed = &mut self.executed[(id % n) as usize];
            refresh_outputs(&mut self.outputs, &mut self.v, executed);
            executed.heads = self.v.heads;
            executed.commanded = self.commanded;
            executed.pushed_at = now;
            executed.test = self.v.test;
            self.outputs_left = bus.push(&self.outputs).is_err();
            if self.outputs_left {
                // The cable was cut this moment: what was executed goes with the next outputs.
                self.counters.executed += u64::from(has_entry);
                self.act(held, now);
                return;
            }
            self.next_output_id += 1;
            self.commanded = SlaveSet::EMPTY;
            if has_entry {
                self.ahead.push_back(Ahead { id, held });
            }
        }
    }

    /// Executes the next entry, if there is one to take; what of it does not act yet is handed back.
    fn take_entry(&mut self, now: Ns) -> (bool, Option<Held>) {
        let Some(entry) = self.fifo.take(self.ahead.len() as u16) else { return (false, None) };
        let size = self.config.slot;
        if self.pacing == Pacing::Runner {
            self.execute(&entry, now);
            return (true, None);
        }
        self.execute_slaves(&entry, now);
        (true, Some(Held { master: entry.slot(size, 0), sdo: entry.slot(size, size.sdo_slot()) }))
    }

    fn act(&mut self, held: Option<Held>, at: Ns) {
        let Some(Held { master, sdo }) = held else { return };
        let shown = (self.v.master_id, self.v.master_result);
        self.execute_queued_master(&master, at);
        self.execute_sdo(&sdo, at);
        if !self.v.network.in_op() {
            // Known to be sent when OP is over already: slot 0 answers what has come since.
            (self.v.master_id, self.v.master_result) = shown;
        }
    }

    /// Sets of outputs pushed that are not known to be sent.
    pub(super) const fn unknown(&self) -> u64 {
        self.next_output_id - self.unsent_from
    }

    /// Sets of outputs that the bus seems to hold: each cycle since the newest one polled has taken the oldest set that had
    /// been pushed by then.
    fn lies_ahead(&self, now: Ns) -> u64 {
        if self.pacing == Pacing::Runner {
            return self.unknown();
        }
        let (n, period_ns) = (self.executed.len() as u64, self.period_ns());
        let mut cycles = 0;
        for id in self.unsent_from..self.next_output_id {
            let pushed_after = self.executed[(id % n) as usize].pushed_at.saturating_sub(self.last_passed) / period_ns;
            cycles = (cycles + 1).max(pushed_after + 1);
            if self.last_passed + cycles * period_ns > now {
                return self.next_output_id - id;
            }
        }
        0
    }

    /// Sets of outputs that may lie ahead.
    fn most_ahead(&self) -> u64 {
        let found = usize::from(self.v.network.found());
        let axes = || self.v.axes[..found].iter().enumerate();
        let rises = |(n, axes): (usize, &[super::Axis; 2])| {
            axes.iter().any(super::Axis::is_rising) && self.v.roles[n].mode() == Some(Mode::Csp)
        };
        if self.pacing == Pacing::Runner || !axes().any(rises) {
            u64::MAX
        } else if axes().flat_map(|(_, axes)| axes).any(super::Axis::follows) {
            AHEAD_IN_MOTION
        } else {
            AHEAD_AT_REST
        }
    }

    /// The outputs before that id have been sent: their entries are executed. Says how many entries those are.
    fn entries_sent(&mut self, unsent_from: u64, at: Ns) -> u64 {
        let mut entries = 0;
        while let Some(Ahead { held, .. }) = self.ahead.pop_front_if(|ahead| ahead.id < unsent_from) {
            entries += 1;
            self.act(held, at);
        }
        self.unsent_from = self.unsent_from.max(unsent_from);
        self.counters.executed += entries;
        entries
    }

    /// SW_RESET: entries whose outputs are on their way do nothing any more for the board itself.
    pub(super) fn forget_held(&mut self) {
        self.ahead.iter_mut().for_each(|ahead| ahead.held = None);
    }

    /// Whether the axes ask for something else than the outputs pushed last.
    fn outputs_changed(&self) -> bool {
        let axes = self.v.axes.iter().zip(&self.outputs.slaves).take(self.v.network.found().into());
        axes.flat_map(|(axes, image)| axes.iter().zip(image)).any(|(axis, out)| axis.differs_from(out))
    }

    /// A cycle has passed: what it says of outputs that were sent.
    pub(super) fn note_sent(&mut self, done: &CycleDone) {
        let sent = done.outputs.map_or(0, |id| (id + 1).min(self.next_output_id));
        let entries = self.entries_sent(sent, done.at);
        if entries == 0 && self.v.network.in_op() {
            self.counters.idle_cycles += 1;
        }
        if done.answers_lost > 0 && self.v.network.in_op() {
            self.counters.answers_lost += u64::from(done.answers_lost);
            self.log.push(Event::AnswersLost { at: done.at, cycles: done.answers_lost });
        }
    }

    /// OP begins: its first outputs are the next ones.
    pub(super) fn begin_outputs(&mut self) {
        self.op_from = self.next_output_id;
        let begun = &mut self.begun;
        begun.heads = self.v.heads;
        begun.test = self.v.test;
        begun.homers = SlaveSet::EMPTY;
        for (n, axes) in self.v.axes.iter().enumerate() {
            for (driven, axis) in begun.axes.iter_mut().zip(axes) {
                driven[n] = axis.driven();
            }
        }
    }

    pub(super) fn is_clearing(&self) -> bool {
        self.clearing != Clearing::No
    }

    /// What the bus has taken and not sent is to go. One clear that is under way is enough: nothing was pushed since.
    pub(super) fn clear_ahead(&mut self) {
        if self.clearing == Clearing::No && self.unknown() > 0 {
            self.clearing = Clearing::Wanted;
        }
    }

    /// Starts a clear, and takes its end.
    pub(super) fn run_clear(&mut self, now: Ns, bus: &mut dyn Fieldbus) {
        if self.clearing == Clearing::Wanted {
            bus.clear_ahead(now);
            self.clearing = Clearing::UnderWay;
        }
        if self.clearing == Clearing::UnderWay
            && let Some(cleared) = bus.poll_clear(now)
        {
            self.clearing = Clearing::No;
            self.cleared(cleared, now);
        }
    }

    /// The outputs that were not sent are gone: their entries count as cleared, the axes are driven as by the newest
    /// outputs that were sent, and the next ones have the ids that come after those.
    fn cleared(&mut self, Cleared { newest_sent }: Cleared, at: Ns) {
        let next = newest_sent.map_or(0, |id| id + 1).clamp(self.unsent_from, self.next_output_id);
        self.entries_sent(next, at);
        self.counters.cleared += self.ahead.len() as u64;
        self.ahead.clear();
        // What was pushed in an earlier OP has nothing to do with this one.
        let takes_back = self.v.network.in_op() && self.next_output_id > next.max(self.op_from);
        self.next_output_id = next;
        self.op_from = self.op_from.min(next);
        if takes_back {
            self.take_back();
        }
    }

    /// Goes back to how the newest outputs that were sent have left it.
    fn take_back(&mut self) {
        let n = self.executed.len() as u64;
        let sent = match self.next_output_id.checked_sub(1) {
            Some(newest) if newest >= self.op_from => &self.executed[(newest % n) as usize],
            _ => &*self.begun,
        };
        let lost = self.v.network.lost();
        self.v.test = sent.test;
        // What was pushed last is gone, and what was sent before it may be what no axis asks for any more.
        self.outputs_left = true;
        for (slave, (n, axes)) in (1..).zip(self.v.axes.iter_mut().enumerate()) {
            if lost.contains(slave) {
                continue;
            }
            self.v.heads[n] = sent.heads[n];
            let then = sent.axes.iter().map(|axes| &axes[n]).zip(&sent.homing[n]);
            for (axis, (then, homing)) in axes.iter_mut().zip(then).take(used_axes(self.v.second_axes, slave)) {
                axis.go_back_to(then, sent.homers.contains(slave).then_some(homing));
            }
            if axes.iter().any(|axis| !axis.homing.is_idle()) {
                self.v.homers.insert(slave);
            }
        }
    }
}

/// Copies the axes' outputs to the process image, and what stands behind them to `executed`.
fn refresh_outputs(outputs: &mut Outputs, v: &mut Volatile, executed: &mut Executed) {
    let Outputs { id, slaves } = outputs;
    let [first, second] = &mut executed.axes;
    let found = usize::from(v.network.found());
    for ((n, axes), image) in v.axes[..found].iter_mut().enumerate().zip(slaves) {
        image[0] = axes[0].next_out(*id);
        first[n] = axes[0].driven();
        if v.second_axes.contains(n as u8 + 1) {
            image[1] = axes[1].next_out(*id);
            second[n] = axes[1].driven();
        }
    }
    executed.homers = v.homers;
    for slave in v.homers.iter() {
        let n = usize::from(slave) - 1;
        let kept = executed.homing[n].iter_mut().zip(&v.axes[n]);
        kept.take(used_axes(v.second_axes, slave)).for_each(|(then, axis)| *then = axis.homing);
    }
}

/// How many axes of a slave's outputs something can be asked of; what lies behind them stays zero.
pub(super) const fn used_axes(second_axes: SlaveSet, slave: u8) -> usize {
    1 + second_axes.contains(slave) as usize
}
