//! A change of state: slaves that are behind move by one state, until all are there.

use super::{Kind, Running, SentFirst, Stage, Todo, no_answer};
use crate::ethercat::{AlState, Ns, SlaveSet};
use crate::fieldbus::xf::XfBus;
use crate::fieldbus::xf::ask::{Ask, Reply};
use crate::fieldbus::{JobDone, leaving_op_ns};
use crate::xf::host::{HostError, Wires};
use crate::xf::request::{Fifos, SlaveInfoItem};

/// After so many cycles it is known that a set was sent, and told: levels lag three exchanges of two packets each. The same
/// holds for what the last cycles in OP sent. \[OURS]
pub(super) const TOLD_LATE: Ns = 6;

impl<W: Wires> XfBus<W> {
    /// Waits until the outputs that were taken are known to be sent: a frame that asks for a lower state may switch outputs off
    /// too, and the board executes it first. If all leave OP, so it does with those that wait before it, as far as the time
    /// of [`leaving_op_ns`] goes, and that which answers take, as the second step of SV_OFF waits for one. What is taken later
    /// is sent too while the slaves are on their way, since an axis may have to be stopped then; nobody knows what still
    /// reaches them, and it counts as lost for them.
    pub(super) fn send_first(&mut self, job: &mut Running, now: Ns) -> Todo {
        let cycle_ns = self.network.cycle.ns();
        let until = now.saturating_add((u64::from(self.depth()) + 2 * TOLD_LATE) * cycle_ns);
        let in_op = self.network.in_op();
        let all_leave = matches!(job.kind, Kind::State { slaves, .. } if in_op.difference(slaves).is_empty());
        if job.sent_first.is_none() && all_leave && !in_op.is_empty() {
            job.sends_until = now.saturating_add(leaving_op_ns(in_op.len()) + 2 * TOLD_LATE * cycle_ns);
        }
        let more = |first: &SentFirst| all_leave && now < job.sends_until && self.newest_taken() > Some(first.newest);
        let newest = self.newest_taken().map(|newest| SentFirst { newest, until });
        let Some(first) = job.sent_first.take().filter(|first| !more(first)).or(newest) else {
            return self.read_states(job);
        };
        if now >= first.until || self.ledger.newest_sent() >= Some(first.newest) || self.is_clearing() {
            return self.read_states(job);
        }
        job.sent_first = Some(first);
        job.stage = Stage::SendFirst;
        Todo::Wait(now.saturating_add(cycle_ns))
    }

    /// The next step of a change of state, when the states are known.
    pub(super) fn move_on(&mut self, job: &mut Running, now: Ns) -> Todo {
        let Kind::State { target, slaves } = job.kind else { return self.configured(job) };
        let found = SlaveSet::first(self.network.found);
        let slaves = slaves.intersection(found);
        let unconfigured = slaves.difference(self.network.with_process_data());
        if target > AlState::PreOp
            && let Some(slave) = unconfigured.iter().next()
        {
            // The chip was reset since the configuration, which has to be done again first, also if a slave is still in the
            // state to which the chip before that has brought it \[OURS].
            self.network.lost = self.network.lost.union(unconfigured);
            return job.failed(no_answer(slave));
        }
        (1..=self.network.found).for_each(|slave| self.stay_up(job, slave));
        for slave in slaves.iter().filter(|slave| job.state(*slave) == Some(target)) {
            self.network.commanded[usize::from(slave) - 1] = target;
            self.network.found_again(slave);
            self.network.lost_from[usize::from(slave) - 1] = None;
        }
        if let Some(slave) = self.strayed(job) {
            job.brought_back.insert(slave);
            return job.ask(Stage::BringBack(slave), Ask::Enter(Some(slave), AlState::PreOp));
        }
        if self.network.in_op().is_empty() {
            if self.runs && !job.has_told_op {
                job.has_told_op = true;
                job.stage = Stage::Retry;
                return Todo::Wait(now.saturating_add(TOLD_LATE * self.network.cycle.ns()));
            }
            self.leave_op();
        } else if !self.runs {
            return job.ask(Stage::EmptyTxFifo, Ask::Clear(Fifos::Tx));
        }
        let behind = slaves.iter().filter(|slave| job.state(*slave) != Some(target));
        let Some(lowest) = behind.filter_map(|slave| job.state(slave)).min() else {
            return match slaves.iter().find(|slave| job.state(*slave).is_none()) {
                Some(slave) => {
                    // It may come back until the deadline.
                    job.ask(Stage::AlStatus(slave), Ask::Info(slave, SlaveInfoItem::AlStatus))
                }
                None => Todo::Done(JobDone::State(Ok(()))),
            };
        };
        let to = if lowest > target { target } else { lowest.above().min(target) };
        if to == AlState::Op && self.network.in_op().is_empty() {
            self.leave_op();
            return job.ask(Stage::StopFifo, Ask::Fifo { on: false });
        }
        self.enter(job, to)
    }

    /// A slave that is not used, and has gone to SafeOP with the others.
    fn strayed(&self, job: &Running) -> Option<u8> {
        let Kind::State { slaves, .. } = job.kind else { return None };
        let unused = self.network.unused().difference(slaves).difference(job.brought_back);
        unused.iter().find(|slave| job.state(*slave) > Some(AlState::PreOp))
    }

    /// If it refuses the way down it stays where it is, and nobody waits for it.
    pub(super) fn brought_back(&mut self, job: &mut Running, slave: u8, reply: Reply, now: Ns) -> Todo {
        if reply.is_ok() {
            let n = usize::from(slave) - 1;
            (self.network.commanded[n], job.states[n]) = (AlState::PreOp, Some(AlState::PreOp));
        }
        self.move_on(job, now)
    }

    /// The slaves that are behind go to a state. The chip moves one slave or all of them, and all together take no longer
    /// than one.
    ///
    /// \[OURS] Slaves that are declared none (SK-4.57) go to SafeOP with the others and come back to PreOP at once: one by one, 39
    /// slaves that take 300 ms each would need more than the 10 s that SET_STATE has. They go no further, since in OP outputs act.
    pub(super) fn enter(&mut self, job: &mut Running, to: AlState) -> Todo {
        let found = SlaveSet::first(self.network.found);
        let behind = self.behind(job, to);
        let goes_along = |slave: &u8| to == AlState::SafeOp && job.state(*slave) == Some(AlState::PreOp);
        let unused: SlaveSet = self.network.unused().difference(behind).iter().filter(goes_along).collect();
        let stays = |slave: &u8| unused.contains(*slave) || job.state(*slave).is_none_or(|state| state == to);
        if behind.len() < 2 || job.all_tried == Some(to) || !found.difference(behind).iter().all(|slave| stays(&slave))
        {
            return self.enter_from(job, to, 1);
        }
        job.all_tried = Some(to);
        self.note_commanded(behind.union(unused), to, AlState::SafeOp);
        job.ask(Stage::EnterAll(to), Ask::Enter(None, to))
    }

    /// The slaves of a change of state that are not where they are to be, and go to this state now.
    pub(super) fn behind(&self, job: &Running, to: AlState) -> SlaveSet {
        let Kind::State { target, slaves } = job.kind else { return SlaveSet::EMPTY };
        let mut behind = slaves.intersection(SlaveSet::first(self.network.found));
        let stays = |slave: &u8| job.state(*slave).is_none_or(|state| (to..=target.max(to)).contains(&state));
        behind.iter().filter(stays).for_each(|slave| behind.remove(slave));
        behind
    }

    /// Slaves are about to enter a state, if it is one up to `most`: a slave that leaves OP is no lost one.
    pub(super) fn note_commanded(&mut self, slaves: SlaveSet, to: AlState, most: AlState) {
        if to <= most {
            slaves.iter().for_each(|slave| self.network.commanded[usize::from(slave) - 1] = to);
        }
    }

    pub(super) fn enter_from(&mut self, job: &mut Running, to: AlState, from: u8) -> Todo {
        let behind = self.behind(job, to);
        match behind.iter().find(|slave| *slave >= from) {
            Some(slave) => {
                let mut one = SlaveSet::EMPTY;
                one.insert(slave);
                self.note_commanded(one, to, AlState::SafeOp);
                job.ask(Stage::Enter(to, slave), Ask::Enter(Some(slave), to))
            }
            None => self.read_states(job),
        }
    }

    pub(super) fn entered(&mut self, job: &mut Running, to: AlState, slave: u8, reply: Reply) -> Todo {
        match reply {
            Ok(_) => {
                self.network.commanded[usize::from(slave) - 1] = to;
                self.enter_from(job, to, slave + 1)
            }
            Err(HostError::Failed { .. }) => {
                self.stay_up(job, slave);
                job.ask(Stage::AlStatus(slave), Ask::Info(slave, SlaveInfoItem::AlStatus))
            }
            Err(_) => job.failed(no_answer(slave)),
        }
    }

    /// If that has failed, the states tell who has moved all the same; the others are asked one by one.
    pub(super) fn all_entered(&mut self, job: &mut Running, to: AlState, reply: Reply) -> Todo {
        if reply.is_ok() {
            self.note_commanded(SlaveSet::first(self.network.found), to, AlState::Op);
        }
        self.read_states(job)
    }

    /// A slave that has refused the way down is where it was. One that is up there for a chip that was reset since is not.
    pub(super) fn stay_up(&mut self, job: &Running, slave: u8) {
        let Some(state) = job.state(slave) else { return };
        if state <= AlState::PreOp || self.network.with_process_data().contains(slave) {
            let commanded = &mut self.network.commanded[usize::from(slave) - 1];
            *commanded = state.max(*commanded);
        }
    }
}
