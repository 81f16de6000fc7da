//! Lost slaves (SK-4, "Cable"): a slave that does not answer in SafeOP or OP is lost until a SET_STATE brings it back.
//! Its slot keeps its values, what comes for it is counted, and the others go on.

use super::axis::Driven;
use super::execute::suits;
use super::network::Step;
use super::outputs::used_axes;
use super::{Engine, Event};
use crate::cia402::Mode;
use crate::fieldbus::{CycleDone, Inputs, MAX_SLAVES, Ns, Pacing, Role, SlaveSet};
use crate::sk::{CommandId, MasterState, RawSlot, SlaveCommand, SlotCommand, SlotKind};

/// Since when answers of each slave are newer than its newest move: those that a bus had still under way then say
/// nothing of where it is.
pub(super) type FreshFrom = [Ns; MAX_SLAVES];

impl Engine {
    /// Slaves that the outputs of the newest cycle have not reached. One that is declared as none is not in OP, and its
    /// slot answers for nobody: it shows what came last, as that of an empty place does.
    fn unreached(&self) -> SlaveSet {
        let unreached = self.inputs.lost.union(self.inputs.deaf);
        if unreached.is_empty() { unreached } else { unreached.intersection(self.used_slaves()) }
    }

    /// The answer of a cycle has come, whose outputs were new ones if they are `carried`. Counts the commands that went
    /// with them, and with those before them whose answers were lost, and have not reached their slaves; and of slaves
    /// that the bus names as lost only now, though they have been for longer, those that went meanwhile.
    pub(super) fn count_unreached(&mut self, carried: Option<u64>) {
        let Inputs { lost, deaf, .. } = self.inputs;
        let named_before = std::mem::replace(&mut self.named_lost, lost);
        if lost.union(deaf).is_empty() {
            return;
        }
        let heard = self.heard.map_or(0, |id| id + 1);
        let news = lost.difference(named_before);
        let starts = news.iter().map(|slave| self.inputs.lost_from[usize::from(slave) - 1]);
        let oldest = starts.flatten().fold(heard, u64::min);
        let n = self.executed.len() as u64;
        for id in oldest.max(self.next_output_id.saturating_sub(n))..carried.map_or(heard, |id| id + 1) {
            let is_newest = Some(id) == carried;
            let was_lost = |slave| match self.inputs.lost_from[usize::from(slave) - 1] {
                _ if !news.contains(slave) => id >= heard && lost.contains(slave),
                Some(from) => from <= id,
                None => is_newest,
            };
            let unreached = self.executed[(id % n) as usize].commanded.intersection(lost.union(deaf));
            let missed = unreached.iter().filter(|slave| was_lost(*slave) || is_newest && deaf.contains(*slave));
            self.counters.for_lost += missed.count() as u64;
        }
    }

    /// Says once that slaves do not answer, while the bus does not name them.
    pub(super) fn note_short_answers(&mut self, done: &CycleDone) {
        let CycleDone { at, working_counter: counted, expected_working_counter: expected, .. } = *done;
        let short = counted < expected && self.inputs.lost.is_empty();
        if short && !self.answers_short {
            self.log.push(Event::WorkingCounter { at, counted, expected });
        }
        self.answers_short = short;
    }

    /// Slaves that are not in the network's state although no change moves any: one that failed has left them in a lower
    /// one, while others refused it.
    fn left_behind(&self) -> SlaveSet {
        // A bus says at the end of a Configure whom it has disturbed.
        if self.job.is_some_and(|work| matches!(work.step, Step::Move(_) | Step::Reconfigure)) {
            return SlaveSet::EMPTY;
        }
        match self.v.network.state() {
            Some(MasterState::Op) => self.inputs.deaf,
            Some(MasterState::SafeOp) => self.inputs.mute,
            _ => SlaveSet::EMPTY,
        }
    }

    /// The cable before the first slave is cut, and the bus passes no cycle that would say so.
    pub(super) fn note_silence(&mut self, at: Ns) {
        self.inputs.lost = self.used_slaves();
        self.note_lost(at);
    }

    /// Looks who did not answer the cycle that has passed, or has left the others.
    ///
    /// SK-4 \[OURS]: a change that fails on the way down may leave slaves below the state that it ends in. Those are lost
    /// as well: nobody drives them, and they come back as lost ones do, configured again and with their outputs off.
    pub(super) fn note_lost(&mut self, at: Ns) {
        if !self.v.network.notices_losses() {
            return;
        }
        let gone = self.inputs.lost.union(self.left_behind());
        if gone.is_empty() {
            return;
        }
        let mut news = gone.intersection(self.used_slaves()).difference(self.v.network.lost());
        for slave in news.iter() {
            if at < self.v.fresh_from[usize::from(slave) - 1] {
                news.remove(slave);
            }
        }
        if news.is_empty() {
            return;
        }
        self.v.network.lose(news);
        for slave in news.iter() {
            self.v.failure = Some(super::StateFailure::Lost { slave });
            self.lose_slave(slave.into(), at);
            let silent = self.inputs.lost.contains(slave);
            self.log.push(if silent { Event::SlaveLost { at, slave } } else { Event::SlaveLeft { at, slave } });
        }
        // On the way down nobody waits for them: that step begins anew without them.
        if let Some(work) = self.job
            && let Step::Move(to) = work.step
            && Some(to) < self.v.network.state()
        {
            self.cancel_job = true;
        }
    }

    /// Slaves that have left OP because the bus configured others: they come back with those, as lost ones do.
    pub(super) fn note_disturbed(&mut self, disturbed: SlaveSet, at: Ns) {
        let disturbed = disturbed.intersection(self.used_slaves());
        for slave in self.present(disturbed).iter() {
            self.lose_slave(slave.into(), at);
            self.log.push(Event::SlaveDisturbed { at, slave });
        }
        self.v.network.disturb(disturbed);
    }

    /// What was under way for a slave ends with its loss.
    fn lose_slave(&mut self, slave: usize, at: Ns) {
        self.end_homing_of_lost(slave, at);
        if self.v.network.in_op() {
            // Commands that a bus had taken ahead do not reach it.
            self.v.heads[slave - 1] = self.shown[slave - 1];
        }
        // Its slot keeps its values; once it is back it shows what is really output.
        self.v.heads[slave - 1].outputs_off();
        self.shown[slave - 1].outputs_off();
        let mode = self.role(slave).mode();
        let used = used_axes(self.v.second_axes, slave as u8);
        for (axis, input) in self.v.axes[slave - 1].iter_mut().zip(&self.inputs.slaves[slave - 1]).take(used) {
            axis.lose(input, mode);
        }
    }

    /// The report shows the commands behind the outputs with that id, but for slaves that they have not reached.
    pub(super) fn show_heads(&mut self, id: u64) {
        let n = self.executed.len() as u64;
        let heads = &self.executed[(id % n) as usize].heads;
        let lost = self.v.network.lost().union(self.unreached());
        if lost.is_empty() {
            self.shown = *heads;
            return;
        }
        for (slave, (shown, head)) in (1..).zip(self.shown.iter_mut().zip(heads)) {
            if !lost.contains(slave) {
                *shown = *head;
            }
        }
    }

    /// Whether what comes for a slave passes it over. Outside OP its settings are taken all the same.
    pub(super) fn is_lost_in_op(&self, slave: usize) -> bool {
        let lost = self.v.network.lost();
        !lost.is_empty() && self.v.network.in_op() && lost.contains(slave as u8)
    }

    /// A command for a lost slave: its slot keeps its values, so it is counted alone. What would be rejected anyway is.
    /// SK-4 \[OURS]
    pub(super) fn pass_over_lost(&mut self, slave: usize, slot: &RawSlot, at: Ns) {
        let id = CommandId::from_code(slot.id);
        if id == CommandId::GetStatus {
            return;
        }
        let right = self.admit(id, SlotKind::Slave).and_then(|()| {
            let command = SlotCommand::decode(slot, self.config.slot).map_err(super::Reason::BadArgument)?.command;
            suits(&command, self.role(slave))?;
            match command {
                SlaveCommand::Csp(_) => self.follows_in(slave, Mode::Csp),
                SlaveCommand::Csv(_) => self.follows_in(slave, Mode::Csv),
                SlaveCommand::Cst(_) => self.follows_in(slave, Mode::Cst),
                _ => Ok(()),
            }
        });
        match right {
            // It is for all slaves, wherever it stands.
            Ok(()) if id == CommandId::AbortHome => self.abort_home(at),
            Ok(()) => self.counters.for_lost += 1,
            Err(reason) => self.reject(slave, id, reason, at),
        }
    }

    /// A command for a slave goes with the next outputs.
    pub(super) fn mark_commanded(&mut self, slave: usize) {
        if self.commanded.contains(slave as u8) {
            // The bus was down when the one before was to go.
            self.counters.for_lost += 1;
        }
        // One that is declared as none is not in OP, and nothing reaches it.
        if self.v.network.in_op() && self.role(slave) != Role::Unused {
            self.commanded.insert(slave as u8);
        }
    }

    /// The next outputs are none that carry what was executed: OP begins or ends.
    pub(super) fn forget_commanded(&mut self) {
        self.counters.for_lost += u64::from(std::mem::take(&mut self.commanded).len());
    }

    /// Whether a step may begin. Lost slaves go to OP only when a bus that takes outputs ahead has none left from
    /// before their loss: no motor starts and no output comes on by what was sent for another time \[OURS].
    pub(super) fn may_begin(&mut self, step: Step) -> bool {
        if step != Step::Return(MasterState::Op) {
            return true;
        }
        let alone = self.present(self.used_slaves()).is_empty();
        // A bus repeats the newest ones that it has sent, unless nobody was left in OP.
        let oldest = if alone { self.unsent_from } else { self.unsent_from.saturating_sub(1) };
        let n = self.executed.len() as u64;
        let returning = self.v.network.returning();
        let at_rest = (oldest..self.next_output_id).all(|id| {
            let axes = &self.executed[(id % n) as usize].axes;
            returning.iter().all(|slave| {
                let used = used_axes(self.v.second_axes, slave);
                axes[..used].iter().map(|axes| &axes[usize::from(slave) - 1]).all(Driven::is_at_rest)
            })
        });
        // With nobody in OP a bus may send nothing, and there is nobody to take it from.
        if alone && !at_rest {
            self.clear_ahead();
        }
        at_rest && !self.is_clearing()
    }

    /// Cycles from this time on were after something that has ended by `now`.
    pub(super) fn fresh_from(&self, now: Ns) -> Ns {
        match self.pacing {
            Pacing::Runner => now,
            // Its clock is not quite ours.
            Pacing::Bus { .. } => now.saturating_add(self.longest_period_ns()),
        }
    }

    /// A step has moved slaves.
    pub(super) fn slaves_moved(&mut self, step: Step, now: Ns) {
        let who = match step {
            Step::Return(to) if to > MasterState::PreOp => self.v.network.returning(),
            Step::Move(to) if to > MasterState::PreOp => self.used_slaves(),
            _ => return,
        };
        let fresh_from = self.fresh_from(now);
        who.iter().for_each(|slave| self.v.fresh_from[usize::from(slave) - 1] = fresh_from);
        if step == Step::Return(MasterState::Op) {
            // What they measure now goes into their first outputs: those hold them where they are.
            who.iter().for_each(|slave| self.answer_slave(slave.into()));
        }
    }
}
