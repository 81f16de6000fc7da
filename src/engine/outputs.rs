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
//! is. So while an axis is on its way to Operation enabled hardly anything is pushed ahead \[OURS]: [`AHEAD_MAX_SWITCHING_ON`], or
//! [`AHEAD_MAX_BESIDE_MOTION`] while other axes follow targets, which are not to stand still for it.

use super::outputs_record::OutputsRecord;
use super::volatile::Volatile;
use super::{Engine, Event};
use crate::cia402::Mode;
use crate::fieldbus::{Cleared, CycleDone, Fieldbus, Ns, Outputs, Pacing, SlaveSet};
use crate::sk::RawSlot;

/// Sets of outputs that may lie ahead while an axis is being switched on and none follows targets \[OURS].
const AHEAD_MAX_SWITCHING_ON: u64 = 1;
/// And while others follow targets \[OURS]: enough that a look which is a few cycles late leaves no gap in their motion.
const AHEAD_MAX_BESIDE_MOTION: u64 = 4;

/// Whether what lies ahead is being thrown away. Nothing is pushed meanwhile.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Clearing {
    Idle,
    /// With the next cycle.
    Requested,
    /// The bus is at it.
    Running,
}

/// A FIFO entry on its way.
#[derive(Clone, Copy, Debug)]
pub(super) struct EntryAhead {
    /// The outputs that carry it.
    id: u64,
    /// What of it acts when they are sent, and not before: `None` once it has.
    held: Option<DeferredSlots>,
}

/// What a FIFO entry holds for the board itself: the chip's inputs and outputs, and the SDO slot. On a bus that takes
/// outputs ahead it acts with the entry's outputs (SK-5): with what it stands beside, and not at all if a clear takes it
/// back.
#[derive(Clone, Copy, Debug)]
pub(super) struct DeferredSlots {
    pub(super) master: RawSlot,
    pub(super) sdo: RawSlot,
}

impl Engine {
    /// Hands the bus what it takes: one FIFO entry in each set of outputs.
    pub(super) fn push_outputs(&mut self, now: Ns, bus: &mut dyn Fieldbus) {
        if self.is_clearing() {
            return;
        }
        let most = self.ahead_max();
        for _ in 0..bus.room() {
            let ahead = self.estimated_ahead(now);
            if ahead >= most || self.unconfirmed() >= self.unconfirmed_max {
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
            let record = self.records.of_mut(id);
            refresh_outputs(&mut self.outputs, &mut self.volatile, record);
            record.heads = self.volatile.heads;
            record.commanded = self.commanded;
            record.pushed_at = now;
            record.test = self.volatile.test;
            self.outputs_left = bus.push(&self.outputs).is_err();
            if self.outputs_left {
                // The cable was cut this moment: what was executed goes with the next outputs.
                self.counters.executed += u64::from(has_entry);
                self.run_deferred(held, now);
                return;
            }
            self.next_output_id += 1;
            self.commanded = SlaveSet::EMPTY;
            if has_entry {
                self.entries_ahead.push_back(EntryAhead { id, held });
            }
        }
    }

    /// Executes the next entry, if there is one to take; what of it does not act yet is handed back.
    fn take_entry(&mut self, now: Ns) -> (bool, Option<DeferredSlots>) {
        let Some(entry) = self.fifo.take(self.entries_ahead.len() as u16) else { return (false, None) };
        let size = self.config.slot;
        if self.pacing == Pacing::Runner {
            self.execute(&entry, now);
            return (true, None);
        }
        self.execute_slaves(&entry, now);
        (true, Some(DeferredSlots { master: entry.slot(size, 0), sdo: entry.slot(size, size.sdo_slot()) }))
    }

    fn run_deferred(&mut self, held: Option<DeferredSlots>, at: Ns) {
        let Some(DeferredSlots { master, sdo }) = held else { return };
        let shown = (self.volatile.master_id, self.volatile.master_result);
        self.execute_queued_master(&master, at);
        self.execute_sdo(&sdo, at);
        if !self.volatile.network.in_op() {
            // Known to be sent when OP is over already: slot 0 answers what has come since.
            (self.volatile.master_id, self.volatile.master_result) = shown;
        }
    }

    /// Sets of outputs pushed that are not known to be sent.
    pub(super) const fn unconfirmed(&self) -> u64 {
        self.next_output_id - self.unconfirmed_from
    }

    /// Sets of outputs that the bus seems to hold: each cycle since the newest one polled has taken the oldest set that had
    /// been pushed by then.
    fn estimated_ahead(&self, now: Ns) -> u64 {
        if self.pacing == Pacing::Runner {
            return self.unconfirmed();
        }
        let period_ns = self.period_ns();
        let mut cycles = 0;
        for id in self.unconfirmed_from..self.next_output_id {
            let pushed_after = self.records.of(id).pushed_at.saturating_sub(self.last_passed) / period_ns;
            cycles = (cycles + 1).max(pushed_after + 1);
            if self.last_passed + cycles * period_ns > now {
                return self.next_output_id - id;
            }
        }
        0
    }

    /// Sets of outputs that may lie ahead.
    fn ahead_max(&self) -> u64 {
        let found = usize::from(self.volatile.network.found());
        let axes = || self.volatile.axes[..found].iter().enumerate();
        let rises = |(n, axes): (usize, &[super::Axis; 2])| {
            axes.iter().any(super::Axis::is_switching_on) && self.volatile.roles[n].mode() == Some(Mode::Csp)
        };
        if self.pacing == Pacing::Runner || !axes().any(rises) {
            u64::MAX
        } else if axes().flat_map(|(_, axes)| axes).any(super::Axis::follows) {
            AHEAD_MAX_BESIDE_MOTION
        } else {
            AHEAD_MAX_SWITCHING_ON
        }
    }

    /// The outputs before that id have been sent: their entries are executed. Says how many entries those are.
    fn confirm_sent(&mut self, unconfirmed_from: u64, at: Ns) -> u64 {
        let mut entries = 0;
        while let Some(EntryAhead { held, .. }) = self.entries_ahead.pop_front_if(|ahead| ahead.id < unconfirmed_from) {
            entries += 1;
            self.run_deferred(held, at);
        }
        self.unconfirmed_from = self.unconfirmed_from.max(unconfirmed_from);
        self.counters.executed += entries;
        entries
    }

    /// SW_RESET: entries whose outputs are on their way do nothing any more for the board itself.
    pub(super) fn drop_deferred(&mut self) {
        self.entries_ahead.iter_mut().for_each(|ahead| ahead.held = None);
    }

    /// Whether the axes ask for something else than the outputs pushed last.
    fn outputs_changed(&self) -> bool {
        let axes = self.volatile.axes.iter().zip(&self.outputs.slaves).take(self.volatile.network.found().into());
        axes.flat_map(|(axes, image)| axes.iter().zip(image)).any(|(axis, out)| axis.differs_from(out))
    }

    /// A cycle has passed: what it says of outputs that were sent.
    pub(super) fn note_confirmed(&mut self, done: &CycleDone) {
        let sent = done.outputs.map_or(0, |id| (id + 1).min(self.next_output_id));
        let entries = self.confirm_sent(sent, done.at);
        if entries == 0 && self.volatile.network.in_op() {
            self.counters.idle_cycles += 1;
        }
        if done.answers_lost > 0 && self.volatile.network.in_op() {
            self.counters.answers_lost += u64::from(done.answers_lost);
            self.log.push(Event::AnswersLost { at: done.at, cycles: done.answers_lost });
        }
    }

    /// OP begins: its first outputs are the next ones.
    pub(super) fn begin_op_outputs(&mut self) {
        self.op_from = self.next_output_id;
        let op_start = &mut self.op_start;
        op_start.heads = self.volatile.heads;
        op_start.test = self.volatile.test;
        op_start.homing_active = SlaveSet::EMPTY;
        for (n, axes) in self.volatile.axes.iter().enumerate() {
            for (checkpoint, axis) in op_start.axes.iter_mut().zip(axes) {
                checkpoint[n] = axis.checkpoint();
            }
        }
    }

    pub(super) fn is_clearing(&self) -> bool {
        self.clearing != Clearing::Idle
    }

    /// What the bus has taken and not sent is to go. One clear that is under way is enough: nothing was pushed since.
    pub(super) fn clear_ahead(&mut self) {
        if self.clearing == Clearing::Idle && self.unconfirmed() > 0 {
            self.clearing = Clearing::Requested;
        }
    }

    /// Starts a clear, and takes its end.
    pub(super) fn run_clear(&mut self, now: Ns, bus: &mut dyn Fieldbus) {
        if self.clearing == Clearing::Requested {
            bus.clear_ahead(now);
            self.clearing = Clearing::Running;
        }
        if self.clearing == Clearing::Running
            && let Some(cleared) = bus.poll_clear(now)
        {
            self.clearing = Clearing::Idle;
            self.cleared(cleared, now);
        }
    }

    /// The outputs that were not sent are gone: their entries count as cleared, the axes are checkpoint as by the newest
    /// outputs that were sent, and the next ones have the ids that come after those.
    fn cleared(&mut self, Cleared { newest_sent }: Cleared, at: Ns) {
        let next = newest_sent.map_or(0, |id| id + 1).clamp(self.unconfirmed_from, self.next_output_id);
        self.confirm_sent(next, at);
        self.counters.cleared += self.entries_ahead.len() as u64;
        self.entries_ahead.clear();
        // What was pushed in an earlier OP has nothing to do with this one.
        let takes_back = self.volatile.network.in_op() && self.next_output_id > next.max(self.op_from);
        self.next_output_id = next;
        self.op_from = self.op_from.min(next);
        if takes_back {
            self.roll_back();
        }
    }

    /// Goes back to how the newest outputs that were sent have left it.
    fn roll_back(&mut self) {
        let sent = match self.next_output_id.checked_sub(1) {
            Some(newest) if newest >= self.op_from => self.records.of(newest),
            _ => &*self.op_start,
        };
        let lost = self.volatile.network.lost();
        self.volatile.test = sent.test;
        // What was pushed last is gone, and what was sent before it may be what no axis asks for any more.
        self.outputs_left = true;
        for (slave, (n, axes)) in (1..).zip(self.volatile.axes.iter_mut().enumerate()) {
            if lost.contains(slave) {
                continue;
            }
            self.volatile.heads[n] = sent.heads[n];
            let then = sent.axes.iter().map(|axes| &axes[n]).zip(&sent.homing[n]);
            for (axis, (then, homing)) in axes.iter_mut().zip(then).take(used_axes(self.volatile.second_axes, slave)) {
                axis.roll_back_to(then, sent.homing_active.contains(slave).then_some(homing));
            }
            if axes.iter().any(|axis| !axis.homing.is_idle()) {
                self.volatile.homing_active.insert(slave);
            }
        }
    }
}

/// Copies the axes' outputs to the process image, and what stands behind them to `executed`.
fn refresh_outputs(outputs: &mut Outputs, volatile: &mut Volatile, record: &mut OutputsRecord) {
    let Outputs { id, slaves } = outputs;
    let [first, second] = &mut record.axes;
    let found = usize::from(volatile.network.found());
    for ((n, axes), image) in volatile.axes[..found].iter_mut().enumerate().zip(slaves) {
        image[0] = axes[0].next_out(*id);
        first[n] = axes[0].checkpoint();
        if volatile.second_axes.contains(n as u8 + 1) {
            image[1] = axes[1].next_out(*id);
            second[n] = axes[1].checkpoint();
        }
    }
    record.homing_active = volatile.homing_active;
    for slave in volatile.homing_active.iter() {
        let n = usize::from(slave) - 1;
        let kept = record.homing[n].iter_mut().zip(&volatile.axes[n]);
        kept.take(used_axes(volatile.second_axes, slave)).for_each(|(then, axis)| *then = axis.homing);
    }
}

/// How many axes of a slave's outputs something can be asked of; what lies behind them stays zero.
pub(super) const fn used_axes(second_axes: SlaveSet, slave: u8) -> usize {
    1 + second_axes.contains(slave) as usize
}
