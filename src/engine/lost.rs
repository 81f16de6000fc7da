//! Lost slaves (SK-4, "Cable"). A slave that no longer answers in SafeOP or OP, or whose inputs are stale, is lost
//! until a SET_STATE brings it back. Meanwhile its slot keeps its values, and commands for it are counted but not
//! executed. The other slaves continue.

use super::axis::AxisCheckpoint;
use super::commands::check_kind;
use super::network::Step;
use super::outputs::used_axes;
use super::state_failure::SlaveFall;
use super::{Engine, Event, EventKind};
use crate::ethercat::AlStatus;
use crate::ethercat::cia402::Mode;
use crate::fieldbus::{CycleDone, Inputs, Ns, Pacing, Role, SlaveSet};
use crate::sk::{CommandId, MasterState, RawSlot, SlaveCommand, SlotCommand, SlotKind};

impl Engine {
    /// The used slaves that the outputs of the newest cycle have not reached. A slave that is not used is never in OP
    /// and never counts as unreached: its slot shows the newest command, like the slot of a number without a slave.
    fn unreached(&self) -> SlaveSet {
        let unreached = self.inputs.lost.union(self.inputs.without_outputs);
        if unreached.is_empty() { unreached } else { unreached.intersection(self.used_slaves()) }
    }

    /// Called with the answer of a cycle: counts the commands that may not have reached their slaves. These are commands
    /// in the outputs of the cycle (`carried`: the id of these outputs, if they were new), in earlier outputs whose
    /// answers were lost, and in outputs that were sent to a slave after its loss, before the bus noticed the loss. The
    /// count is an upper bound \[OURS]: each set of outputs that is no longer in the history counts as a command.
    pub(super) fn count_unreached(&mut self, carried: Option<u64>) {
        let Inputs { lost, without_outputs, .. } = self.inputs;
        let lost_before = std::mem::replace(&mut self.lost_before, lost);
        let unanswered = self.newest_answered.map_or(0, |id| id + 1);
        let end = carried.map_or(unanswered, |id| id + 1);
        let kept_from = self.next_output_id.saturating_sub(self.commanded_by.len());
        for slave in lost.union(without_outputs).iter() {
            let named_from = self.inputs.lost_from[usize::from(slave) - 1].filter(|_| !lost_before.contains(slave));
            let from = named_from.map_or(unanswered, |from| from.min(unanswered));
            let commands = (from.max(kept_from)..end).filter(|id| self.commanded_by.of(*id).contains(slave)).count();
            self.counters.for_lost += kept_from.saturating_sub(from) + commands as u64;
        }
    }

    /// Evaluates the working counter of a cycle. Logs once that it is too low while the bus names no lost slave, or that
    /// it is too high. Counts the cycle if the inputs of a slave are ignored because of it.
    pub(super) fn note_working_counter(&mut self, done: &CycleDone) {
        let CycleDone { at, working_counter: counted, expected_working_counter: expected, .. } = *done;
        let is_held = !self.inputs.held.difference(self.network().lost()).is_empty();
        self.counters.inputs_held += u64::from(is_held);
        // If this machine has sent no frames for a while, slaves may have left OP by their watchdog. The bus names them
        // soon, when it has read their states; until then a low working counter is not logged.
        let is_low = counted < expected && self.inputs.lost.is_empty() && self.inputs.stood_still_ns == 0;
        let is_wrong = is_low || counted > expected && is_held;
        if is_wrong && expected > 0 && !self.working_counter_wrong {
            self.log.push(Event { at, kind: EventKind::WorkingCounter { counted, expected } });
        }
        self.working_counter_wrong = is_wrong;
    }

    /// Slaves that are in a lower state than the network while no change of state is under way: a failed change,
    /// refused by other slaves, has left them there.
    fn left_behind(&self) -> SlaveSet {
        // During a change of state some slaves change later than others, and a configuration names the slaves that it
        // has disturbed only at its end. So no slave counts as left behind meanwhile.
        if self.job.is_some_and(|work| matches!(work.step, Step::Move(_) | Step::RecoverConfigure)) {
            return SlaveSet::EMPTY;
        }
        match self.network().state() {
            Some(MasterState::Op) => self.inputs.without_outputs,
            Some(MasterState::SafeOp) => self.inputs.without_inputs,
            _ => SlaveSet::EMPTY,
        }
    }

    /// Called when the cable before the first slave is cut: all used slaves are lost. The bus cannot name them, since
    /// none of its cycles passes.
    pub(super) fn note_silence(&mut self, at: Ns) {
        self.inputs.lost = self.used_slaves();
        self.note_lost(at);
    }

    /// Finds the slaves that were lost since the last cycle.
    ///
    /// SK-4 \[OURS]: a failed change to a lower state may leave slaves in a state below that of the network. These
    /// slaves are lost, too: they take no outputs, and SET_STATE brings them back like other lost slaves, configured
    /// again and with their outputs off.
    pub(super) fn note_lost(&mut self, at: Ns) {
        if !self.network().notices_losses(self.volatile.left_shown_from.is_some()) {
            return;
        }
        let gone = self.inputs.lost.union(self.left_behind());
        if gone.is_empty() {
            return;
        }
        let mut newly_lost = gone.intersection(self.used_slaves()).difference(self.network().lost());
        for slave in newly_lost.iter() {
            if at < self.volatile.answers_valid_from[usize::from(slave) - 1] {
                newly_lost.remove(slave);
            }
        }
        if newly_lost.is_empty() {
            return;
        }
        self.volatile.network.mark_lost(newly_lost);
        for slave in newly_lost.iter() {
            let (is_silent, is_stale) = (self.inputs.lost.contains(slave), self.inputs.stale.contains(slave));
            let al_status = self.inputs.left_with[usize::from(slave) - 1];
            let (failure, event) = match (is_stale, is_silent) {
                (true, _) => {
                    (super::StateFailure::Stale { slave }, Event { at, kind: EventKind::InputsStale { slave } })
                }
                (_, true) if al_status != AlStatus::NONE.0 => {
                    let fall = SlaveFall { slave, al_status, stood_still_ns: self.inputs.stood_still_ns };
                    (super::StateFailure::Fell(fall), Event { at, kind: EventKind::SlaveFell { fall } })
                }
                (_, true) => (super::StateFailure::Lost { slave }, Event { at, kind: EventKind::SlaveLost { slave } }),
                _ => (super::StateFailure::Lost { slave }, Event { at, kind: EventKind::SlaveLeft { slave } }),
            };
            self.volatile.failure = Some(failure);
            self.counters.inputs_stale += u64::from(is_stale);
            self.lose_slave(slave.into(), at);
            self.log.push(event);
        }
        // A change to a lower state does not wait for lost slaves: the step starts again without those that were just
        // lost.
        if let Some(work) = self.job
            && let Step::Move(to) = work.step
            && Some(to) < self.network().state()
        {
            self.cancel_job = true;
        }
    }

    /// Called when slaves have left OP because the bus configured other slaves. The recovery in progress brings all of
    /// them back to OP together.
    pub(super) fn note_disturbed(&mut self, disturbed: SlaveSet, at: Ns) {
        let disturbed = disturbed.intersection(self.used_slaves());
        for slave in self.present(disturbed).iter() {
            self.lose_slave(slave.into(), at);
            self.log.push(Event { at, kind: EventKind::SlaveDisturbed { slave } });
        }
        self.volatile.network.mark_disturbed(disturbed);
    }

    /// Ends all requests for a slave that is lost: those of commands, and its homing.
    fn lose_slave(&mut self, slave: usize, at: Ns) {
        self.end_homing_of_lost(slave, at);
        if self.network().in_op() {
            // Commands in outputs that the bus has queued and not sent do not reach the slave, so its slot must not
            // show them.
            self.volatile.heads[slave - 1] = self.shown_heads[slave - 1];
        }
        // While the slave is lost, its slot keeps the values of the last report. From its return on, the slot has to show
        // that its outputs are off.
        self.volatile.heads[slave - 1].outputs_off();
        self.shown_heads[slave - 1].outputs_off();
        let mode = self.role(slave).mode();
        let used = used_axes(self.volatile.second_axes, slave as u8);
        for (axis, input) in self.axes[slave - 1].iter_mut().zip(&self.inputs.slaves[slave - 1]).take(used) {
            axis.lose(input, mode);
        }
    }

    /// Makes the slots in reports show the commands of the outputs with this id, which are now known to be sent. The slots of
    /// slaves that these outputs have not reached stay unchanged.
    pub(super) fn show_heads(&mut self, id: u64) {
        let heads = &self.records.of(id).heads;
        let lost = self.network().lost().union(self.unreached());
        if lost.is_empty() {
            self.shown_heads = *heads;
            return;
        }
        for (slave, (shown, head)) in (1..).zip(self.shown_heads.iter_mut().zip(heads)) {
            if !lost.contains(slave) {
                *shown = *head;
            }
        }
    }

    /// Whether commands for a slave are not executed because it is lost. Outside OP commands can still change the
    /// settings of a lost slave.
    pub(super) fn is_lost_in_op(&self, slave: usize) -> bool {
        let lost = self.network().lost();
        !lost.is_empty() && self.network().in_op() && lost.contains(slave as u8)
    }

    /// Handles a command for a lost slave: it is counted, and the slot keeps its values. An invalid command is rejected
    /// as for any slave. SK-4 \[OURS]
    pub(super) fn execute_for_lost(&mut self, slave: usize, slot: &RawSlot, at: Ns) {
        let id = CommandId::from_code(slot.id);
        if id == CommandId::GetStatus {
            return;
        }
        let right = self.admit(id, SlotKind::Slave).and_then(|()| {
            let command = SlotCommand::decode(slot, self.config.slot).map_err(super::Reason::BadArgument)?.command;
            check_kind(&command, self.role(slave))?;
            match command {
                SlaveCommand::Csp(_) => self.check_mode(slave, Mode::Csp),
                SlaveCommand::Csv(_) => self.check_mode(slave, Mode::Csv),
                SlaveCommand::Cst(_) => self.check_mode(slave, Mode::Cst),
                _ => Ok(()),
            }
        });
        match right {
            // ABORT_HOME concerns all slaves, so it is executed although this slave is lost. It keeps each GO_HOME of its
            // frame from starting, too (SK-7.56).
            Ok(()) if id == CommandId::AbortHome => self.abort_home_in_frame(at),
            Ok(()) => self.counters.for_lost += 1,
            Err(reason) => self.reject(slave, id, reason, at),
        }
    }

    /// Records that the next outputs carry a command for a slave, so that the command can be counted if these outputs do
    /// not reach the slave.
    pub(super) fn mark_commanded(&mut self, slave: usize) {
        if self.commanded.contains(slave as u8) {
            // The outputs with the previous command were never sent, because the bus was down: that command counts as
            // lost.
            self.counters.for_lost += 1;
        }
        // A slave that SET_AXIS declares as not used is not in OP, and no command reaches it.
        if self.network().in_op() && self.role(slave) != Role::Unused {
            self.commanded.insert(slave as u8);
        }
    }

    /// Counts executed commands that no outputs will carry to the slaves: OP begins or ends, which resets the requests of all
    /// axes.
    pub(super) fn drop_commanded(&mut self) {
        self.counters.for_lost += u64::from(std::mem::take(&mut self.commanded).len());
    }

    /// Whether the next step has to wait. After a failed change of state slaves may be in a lower state than the network,
    /// which the answer of a later cycle shows. They count as lost, and the next change has to bring them back, so its
    /// first step waits for this answer. It does not wait while the bus has no cycles.
    pub(super) fn awaits_who_was_left(&mut self, now: Ns) -> bool {
        let left_shown_from = self.volatile.left_shown_from;
        let awaits = left_shown_from.is_some_and(|from| self.last_passed < from) && !self.is_bus_silent(now);
        if !awaits {
            self.volatile.left_shown_from = None;
        }
        awaits
    }

    /// Whether a step may begin. On a bus that queues outputs, lost slaves return to OP only when no outputs from
    /// before their loss are queued: otherwise these could switch on a motor or a digital output \[OURS].
    pub(super) fn may_begin_step(&mut self, step: Step) -> bool {
        if step != Step::RecoverTo(MasterState::Op) {
            return true;
        }
        let alone = self.present(self.used_slaves()).is_empty();
        // The outputs from `oldest` on must switch on no motor and no digital output: these are all that may still be sent. A
        // bus also repeats the newest outputs that were sent, so that set is checked too, unless no slave is left in OP that
        // would get it.
        let oldest = if alone { self.unconfirmed_from } else { self.unconfirmed_from.saturating_sub(1) };
        let recovering = self.network().recovering();
        let at_rest = (oldest..self.next_output_id).all(|id| {
            let axes = &self.records.of(id).axes;
            recovering.iter().all(|slave| {
                let used = used_axes(self.volatile.second_axes, slave);
                axes[..used].iter().map(|axes| &axes[usize::from(slave) - 1]).all(AxisCheckpoint::is_at_rest)
            })
        });
        // With no slave in OP a bus may send no outputs, so old outputs would stay in its queue for ever: they are
        // cleared.
        if alone && !at_rest {
            self.clear_ahead();
        }
        at_rest && !self.is_clearing()
    }

    /// Clears the outputs that a bus has queued, if no slave is in OP any more. The bus may then send no outputs. Without the
    /// clear the FIFO entries of these outputs would wait until slaves are back, and then be executed, even an SV_ON of long
    /// ago.
    ///
    /// The clear begins when the bus has run cycles for two cycle times without sending the oldest of these outputs. While
    /// slaves are being brought back to OP there is no clear, because it would also take back the state of their axes.
    pub(super) fn clear_what_nobody_gets(&mut self) {
        let alone = self.present(self.used_slaves()).is_empty();
        let return_now = self.job.is_some_and(|work| matches!(work.step, Step::RecoverTo(_)));
        if self.entries_ahead.is_empty() || !alone || return_now {
            return;
        }
        let could_go_from = self.records.of(self.unconfirmed_from).pushed_at.max(self.last_carried);
        if self.last_passed > could_go_from + 2 * self.longest_period_ns() {
            self.clear_ahead();
        }
    }

    /// The time of the earliest cycle whose answers were certainly measured after `now`. The caller passes the time at
    /// which, for example, a change of state has ended.
    pub(super) fn answers_valid_from(&self, now: Ns) -> Ns {
        match self.pacing {
            Pacing::Runner => now,
            // The clock of the bus may differ from board time by up to a cycle.
            Pacing::Bus { .. } => now.saturating_add(self.longest_period_ns()),
        }
    }

    /// Called when a step has changed the state of slaves: their answers that were measured before do not show the new state
    /// and no longer count.
    pub(super) fn note_moved(&mut self, step: Step, now: Ns) {
        let who = match step {
            Step::RecoverTo(to) if to > MasterState::PreOp => self.network().recovering(),
            Step::Move(to) if to > MasterState::PreOp => self.used_slaves(),
            _ => return,
        };
        let answers_valid_from = self.answers_valid_from(now);
        who.iter().for_each(|slave| self.volatile.answers_valid_from[usize::from(slave) - 1] = answers_valid_from);
        if step == Step::RecoverTo(MasterState::Op) {
            // The present inputs of the slaves give the targets of their first outputs in OP, which hold the axes at
            // their positions.
            who.iter().for_each(|slave| self.answer_slave(slave.into()));
        }
    }
}
