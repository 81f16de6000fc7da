//! Outputs: how commands get from the entries of the command FIFO into the process image and to the bus. If SET_FIFO 1
//! clears entries whose outputs a bus has queued and not sent, these outputs are taken back.
//!
//! **Which outputs were sent** is known from the ids that polled cycles report, some cycles later, and from the end of
//! a clear. When the outputs of an entry are known to be sent, the entry counts as executed. Only then the commands in
//! its slots for the board itself (slot 0 and the SDO slot) are executed.
//!
//! **How many sets of outputs a bus holds** can only be estimated. Each cycle since the newest polled one is assumed to
//! have sent one set, if a set was in the queue by then. The estimate decides how many sets are pushed, never which were
//! sent.
//!
//! **An axis that is being switched on** is held at the position that was measured last. Outputs that a bus holds have an
//! older position: an axis that sags while its brake opens would be pulled back to it when it is enabled. So while an
//! axis is being switched on only a few sets are pushed ahead \[OURS]: [`AHEAD_MAX_SWITCHING_ON`], or
//! [`AHEAD_MAX_BESIDE_MOTION`] while other axes follow targets, so that these do not stop.

use super::axis::AllAxes;
use super::outputs_record::OutputsRecord;
use super::volatile::Volatile;
use super::{Engine, Event, EventKind};
use crate::ethercat::cia402::Mode;
use crate::fieldbus::{Cleared, CycleDone, Fieldbus, Ns, Outputs, Pacing, SlaveSet};
use crate::sk::RawSlot;

/// How many sets of outputs a bus may hold while an axis is being switched on and no axis follows targets \[OURS].
const AHEAD_MAX_SWITCHING_ON: u64 = 1;
/// How many sets of outputs a bus may hold while an axis is being switched on and other axes follow targets \[OURS]:
/// enough to leave no gap in their motion when the runner is a few cycles late.
const AHEAD_MAX_BESIDE_MOTION: u64 = 4;

/// The progress of a clear of the outputs that a bus has queued and not sent. No outputs are pushed during a clear.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Clearing {
    Idle,
    /// A clear is requested; it starts with the next cycle.
    Requested,
    /// The bus is discarding its queued outputs.
    Running,
}

/// A FIFO entry that was taken out of the FIFO and whose outputs are not known to be sent yet.
#[derive(Clone, Copy, Debug)]
pub(super) struct EntryAhead {
    /// The id of the outputs that carry the commands of the entry.
    id: u64,
    /// The slots of the entry that act only when the outputs are sent; `None`: the entry has none, or they have acted
    /// already.
    deferred: Option<DeferredSlots>,
}

/// The slots of a FIFO entry that are for the board itself: slot 0 and the SDO slot. On a bus that queues outputs they
/// act when the outputs of the entry are sent (SK-5), and not at all if a clear takes the entry back.
#[derive(Clone, Copy, Debug)]
pub(super) struct DeferredSlots {
    pub(super) master: RawSlot,
    pub(super) sdo: RawSlot,
}

impl Engine {
    /// Passes sets of outputs to the bus, each with the commands of one FIFO entry, as long as the bus has room for
    /// more.
    pub(super) fn push_outputs(&mut self, now: Ns, bus: &mut dyn Fieldbus) {
        if self.is_clearing() {
            return;
        }
        let most = self.ahead_max();
        for _ in 0..bus.room() {
            let ahead = bus.held_estimate().unwrap_or_else(|| self.estimated_ahead(now));
            if ahead >= most || self.unconfirmed() >= self.unconfirmed_max {
                return;
            }
            let (has_entry, deferred) = self.take_entry(now);
            // A bus that runs its own cycle repeats the last outputs by itself. Without a FIFO entry nothing is pushed to
            // it, as long as its queue is not empty or the outputs are unchanged.
            let repeats = self.pacing != Pacing::Runner && (ahead > 0 || !self.outputs_left && !self.outputs_changed());
            if repeats && !has_entry {
                return;
            }
            let id = self.next_output_id;
            self.outputs.id = id;
            self.hold_go_home();
            let record = self.records.of_mut(id);
            refresh_outputs(&mut self.outputs, &self.volatile, &mut self.axes, record);
            record.heads = self.volatile.heads;
            *self.commanded_by.of_mut(id) = self.commanded;
            record.pushed_at = now;
            record.test = self.volatile.test;
            self.outputs_left = bus.push(&self.outputs).is_err();
            if self.outputs_left {
                // The bus has just gone down (a cut cable) and has not taken the outputs. The FIFO entry that they
                // were made from counts as executed all the same: its commands have changed the state of the axes, and the
                // next outputs are made from that state.
                self.counters.executed += u64::from(has_entry);
                self.run_deferred(deferred, now);
                return;
            }
            self.next_output_id += 1;
            self.commanded = SlaveSet::EMPTY;
            if has_entry {
                self.entries_ahead.push_back(EntryAhead { id, deferred });
            }
        }
    }

    /// Executes the next FIFO entry. Returns whether there was an entry, and the slots of the entry that act only when
    /// its outputs are sent.
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

    /// Executes the slots of an entry that act only when its outputs are sent: slot 0 and the SDO slot.
    fn run_deferred(&mut self, deferred: Option<DeferredSlots>, at: Ns) {
        let Some(DeferredSlots { master, sdo }) = deferred else { return };
        let shown = (self.volatile.master_id, self.volatile.master_result);
        self.execute_queued_master(&master, at);
        self.execute_sdo(&sdo, at);
        if !self.network().in_op() {
            // The network has left OP before it was known that the entry was sent. Slot 0 already shows the answers to
            // newer commands, so these are kept.
            (self.volatile.master_id, self.volatile.master_result) = shown;
        }
    }

    /// How many sets of outputs were pushed to the bus and are not known to be sent.
    pub(super) const fn unconfirmed(&self) -> u64 {
        self.next_output_id - self.unconfirmed_from
    }

    /// The estimated number of sets of outputs that the bus holds: each cycle of the bus since the newest one whose answer was
    /// polled is assumed to have sent the oldest set that had been pushed by then.
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

    /// The maximum number of sets of outputs that the bus may hold at present: few while an axis in CSP is being switched
    /// on, and without a limit otherwise.
    fn ahead_max(&self) -> u64 {
        let found = usize::from(self.network().found());
        let axes = || self.axes[..found].iter().enumerate();
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

    /// Called when all outputs with an id below `unconfirmed_from` are known to be sent: their FIFO entries count as
    /// executed. Returns the number of these entries.
    fn confirm_sent(&mut self, unconfirmed_from: u64, at: Ns) -> u64 {
        let mut entries = 0;
        while let Some(EntryAhead { deferred, .. }) =
            self.entries_ahead.pop_front_if(|ahead| ahead.id < unconfirmed_from)
        {
            entries += 1;
            self.run_deferred(deferred, at);
        }
        self.unconfirmed_from = self.unconfirmed_from.max(unconfirmed_from);
        self.counters.executed += entries;
        entries
    }

    /// Called by SW_RESET: drops the commands in slot 0 and in the SDO slot that wait until the outputs of their
    /// entries are sent.
    pub(super) fn drop_deferred(&mut self) {
        self.entries_ahead.iter_mut().for_each(|ahead| ahead.deferred = None);
    }

    /// Whether the outputs of any axis differ from those that were pushed last.
    fn outputs_changed(&self) -> bool {
        let axes = self.axes.iter().zip(&self.outputs.slaves).take(self.network().found().into());
        axes.flat_map(|(axes, image)| axes.iter().zip(image)).any(|(axis, out)| axis.differs_from(out))
    }

    /// Records which outputs were sent: `done`, a cycle of the bus that has passed, has the id of the newest sent
    /// outputs.
    pub(super) fn note_confirmed(&mut self, done: &CycleDone) {
        let sent = done.outputs.map_or(0, |id| (id + 1).min(self.next_output_id));
        let entries = self.confirm_sent(sent, done.at);
        if entries == 0 && self.network().in_op() {
            self.counters.idle_cycles += 1;
        }
        if done.outputs_lost > 0 {
            self.counters.outputs_lost += u64::from(done.outputs_lost);
            self.log.push(Event {
                at: done.at,
                kind: EventKind::OutputsLost {
                    sets: done.outputs_lost,
                    has_chip: matches!(self.pacing, Pacing::Bus { .. }),
                },
            });
        }
        if done.answers_lost > 0 && self.network().in_op() {
            self.counters.answers_lost += u64::from(done.answers_lost);
            self.log.push(Event { at: done.at, kind: EventKind::AnswersLost { cycles: done.answers_lost } });
        }
    }

    /// Called when OP begins: records the state of the axes before the first outputs of this OP, so that a clear can return to
    /// it.
    pub(super) fn begin_op_outputs(&mut self) {
        self.op_from = self.next_output_id;
        let op_start = &mut self.op_start;
        op_start.heads = self.volatile.heads;
        op_start.test = self.volatile.test;
        op_start.homing_active = SlaveSet::EMPTY;
        for (n, axes) in self.axes.iter().enumerate() {
            for (checkpoint, axis) in op_start.axes.iter_mut().zip(axes) {
                checkpoint[n] = axis.checkpoint();
            }
        }
    }

    pub(super) fn is_clearing(&self) -> bool {
        self.clearing != Clearing::Idle
    }

    /// Requests a clear of the outputs that the bus has queued and not sent. Does nothing if a clear is requested or
    /// running: no outputs are pushed until it ends, so it covers all of them.
    pub(super) fn clear_ahead(&mut self) {
        if self.clearing == Clearing::Idle && self.unconfirmed() > 0 {
            self.clearing = Clearing::Requested;
        }
    }

    /// Starts a requested clear, and handles the end of a running one.
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

    /// Called when the bus has dropped the outputs that were not sent: their entries count as cleared. The axes return
    /// to their state at the newest outputs that were sent, and the next outputs get the ids after it.
    fn cleared(&mut self, Cleared { newest_sent }: Cleared, at: Ns) {
        let next = newest_sent.map_or(0, |id| id + 1).clamp(self.unconfirmed_from, self.next_output_id);
        self.confirm_sent(next, at);
        self.counters.cleared += self.entries_ahead.len() as u64;
        self.entries_ahead.clear();
        // The axes are rolled back only for outputs that were pushed in this OP: the end of OP has reset the axes
        // anyway.
        let takes_back = self.network().in_op() && self.next_output_id > next.max(self.op_from);
        self.next_output_id = next;
        self.op_from = self.op_from.min(next);
        if takes_back {
            self.roll_back();
        }
    }

    /// Returns the axes to the state from which the newest outputs that were sent had been made.
    fn roll_back(&mut self) {
        let sent = match self.next_output_id.checked_sub(1) {
            Some(newest) if newest >= self.op_from => self.records.of(newest),
            _ => &*self.op_start,
        };
        let lost = self.network().lost();
        self.volatile.test = sent.test;
        // The dropped outputs are gone, and the newest outputs that were sent may differ from what the axes request
        // after the rollback: new outputs have to be pushed.
        self.outputs_left = true;
        let next = self.next_output_id;
        for (slave, (n, axes)) in (1..).zip(self.axes.iter_mut().enumerate()) {
            if lost.contains(slave) {
                continue;
            }
            self.volatile.heads[n] = sent.heads[n];
            let then = sent.axes.iter().map(|axes| &axes[n]).zip(&sent.homing[n]);
            let used = used_axes(self.volatile.second_axes, slave);
            for ((axis, (then, homing)), input) in axes.iter_mut().zip(then).zip(&self.inputs.slaves[n]).take(used) {
                let newest = input.statusword.state();
                axis.roll_back_to(then, newest, sent.homing_active.contains(slave).then_some(homing), next);
            }
            if axes.iter().any(|axis| !axis.homing.is_idle()) {
                self.volatile.homing_active.insert(slave);
            }
        }
    }
}

/// Writes the next outputs of all axes into the process image, and the state of the axes into `record`.
fn refresh_outputs(outputs: &mut Outputs, volatile: &Volatile, all: &mut AllAxes, record: &mut OutputsRecord) {
    let Outputs { id, slaves } = outputs;
    let [first, second] = &mut record.axes;
    let found = usize::from(volatile.network.found());
    for ((n, axes), image) in all[..found].iter_mut().enumerate().zip(slaves) {
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
        let kept = record.homing[n].iter_mut().zip(&all[n]);
        kept.take(used_axes(volatile.second_axes, slave)).for_each(|(then, axis)| *then = axis.homing);
    }
}

/// The number of axes in use in the outputs of a slave. The outputs of an unused second axis stay zero.
pub(super) const fn used_axes(second_axes: SlaveSet, slave: u8) -> usize {
    1 + second_axes.contains(slave) as usize
}
