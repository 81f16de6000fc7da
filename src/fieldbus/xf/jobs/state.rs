//! A change of state: slaves that are behind move by one state, until all are there.

use super::{Steps, TOLD_LATE};
use crate::ethercat::{AlState, AlStatus, Ns, SlaveSet};
use crate::fieldbus::xf::ask::Ask;
use crate::fieldbus::xf::chip_bus::ChipBus;
use crate::fieldbus::{Refusal, leaving_op_ns};
use crate::xf::host::{HostError, Wires};
use crate::xf::request::{Fifos, SlaveInfoItem};

/// Between two attempts to bring slaves to a state. \[OURS]
const RETRY_NS: Ns = 10_000_000;

/// A change of state under way.
struct Change {
    target: AlState,
    slaves: SlaveSet,
    /// All were asked together to enter this state.
    all_tried: Option<AlState>,
    /// All slaves have left OP, and its last cycles were told.
    has_told_op: bool,
    /// Slaves that are not used, and were told to go back to PreOP.
    brought_back: SlaveSet,
}

/// Outputs that are to be sent before slaves leave OP.
#[derive(Clone, Copy, Debug)]
struct SentFirst {
    /// The id of the newest ones.
    newest: u64,
    /// How long they are waited for.
    until: Ns,
}

impl<W: Wires> Steps<W> {
    pub(super) async fn change(&mut self, target: AlState, slaves: SlaveSet) -> Result<(), Refusal> {
        let cycle = self.with(|bus| bus.network.cycle);
        self.start_unless_known(cycle).await?;
        if self.with(|bus| bus.runs) && target < AlState::Op {
            self.send_first(slaves).await;
        }
        let slaves = slaves.intersection(SlaveSet::first(self.with(|bus| bus.network.found)));
        let mut change = Change { target, slaves, all_tried: None, has_told_op: false, brought_back: SlaveSet::EMPTY };
        loop {
            self.read_states().await?;
            self.with(|bus| bus.note_reached(&change))?;
            while let Some(slave) = self.with(|bus| bus.strayed(&change)) {
                self.bring_back(slave).await;
                change.brought_back.insert(slave);
                self.with(|bus| bus.note_reached(&change))?;
            }
            if self.step(&mut change).await? {
                return Ok(());
            }
        }
    }

    /// Waits until the outputs that were taken are known to be sent: a frame that asks for a lower state may switch outputs off
    /// too, and the board executes it first. If all leave OP, so it does with those that wait before it, as far as the time
    /// of [`leaving_op_ns`] goes, and that which answers take, as the second step of SV_OFF waits for one. What is taken later
    /// is sent too while the slaves are on their way, since an axis may have to be stopped then; nobody knows what still
    /// reaches them, and it counts as lost for them.
    async fn send_first(&self, slaves: SlaveSet) {
        let (mut first, mut sends_until) = (None, 0);
        while let Some(next) = self.with(|bus| bus.sent_first(slaves, first, &mut sends_until)) {
            first = Some(next);
            self.wait_cycles(1).await;
        }
    }

    /// A slave that is not used goes back to PreOP. If it refuses the way down it stays where it is, and nobody waits for it.
    async fn bring_back(&self, slave: u8) {
        if self.ask(Ask::Enter(Some(slave), AlState::PreOp)).await.is_ok() {
            let n = usize::from(slave) - 1;
            self.with(|bus| (bus.network.commanded[n], bus.states[n]) = (AlState::PreOp, Some(AlState::PreOp)));
        }
    }

    /// The next step, when the states are known. Whether all are there.
    async fn step(&self, change: &mut Change) -> Result<bool, Refusal> {
        let (in_op, runs) = self.with(|bus| (bus.network.in_op(), bus.runs));
        if !in_op.is_empty() && !runs {
            let _ = self.ask(Ask::Clear(Fifos::Tx)).await;
            let _ = self.ask(Ask::Fifo { on: true }).await;
            self.with(ChipBus::enter_op);
            return Ok(false);
        }
        if in_op.is_empty() {
            if runs && !change.has_told_op {
                change.has_told_op = true;
                self.wait_cycles(TOLD_LATE).await;
                return Ok(false);
            }
            self.with(ChipBus::leave_op);
        }
        let Some(lowest) = self.with(|bus| bus.lowest_behind(change)) else {
            let Some(slave) = self.with(|bus| change.slaves.iter().find(|slave| bus.state(*slave).is_none())) else {
                return Ok(true);
            };
            // It may come back until the deadline.
            self.tell_refusal(slave).await?;
            return Ok(false);
        };
        let to = if lowest > change.target { change.target } else { lowest.above().min(change.target) };
        if to == AlState::Op && in_op.is_empty() {
            self.with(ChipBus::leave_op);
            let _ = self.ask(Ask::Fifo { on: false }).await;
            let _ = self.ask(Ask::Clear(Fifos::Both)).await;
            self.with(ChipBus::send_holding);
            self.wait(0).await;
        }
        self.enter(change, to).await?;
        Ok(false)
    }

    /// A slave that does not say why it is not there is tried again later.
    async fn tell_refusal(&self, slave: u8) -> Result<(), Refusal> {
        match self.ask(Ask::Info(slave, SlaveInfoItem::AlStatus)).await {
            Ok(al_status) if al_status != 0 => Err(Refusal::of(slave, AlStatus(al_status as u16))),
            _ => {
                self.wait(RETRY_NS).await;
                Ok(())
            }
        }
    }

    /// The slaves that are behind go to a state. The chip moves one slave or all of them, and all together take no longer
    /// than one.
    ///
    /// \[OURS] Slaves that are declared none (SK-4.57) go to SafeOP with the others and come back to PreOP at once: one by one, 39
    /// slaves that take 300 ms each would need more than the 10 s that SET_STATE has. They go no further, since in OP outputs act.
    async fn enter(&self, change: &mut Change, to: AlState) -> Result<(), Refusal> {
        let behind = self.with(|bus| bus.behind(change, to));
        let Some(unused) = self.with(|bus| bus.unused_beside(change, behind, to)) else {
            return self.enter_one_by_one(behind, to).await;
        };
        change.all_tried = Some(to);
        self.with(|bus| bus.note_commanded(behind.union(unused), to, AlState::SafeOp));
        // If that has failed, the states tell who has moved all the same; the others are asked one by one.
        if self.ask(Ask::Enter(None, to)).await.is_ok() {
            self.with(|bus| bus.note_commanded(SlaveSet::first(bus.network.found), to, AlState::Op));
        }
        Ok(())
    }

    async fn enter_one_by_one(&self, behind: SlaveSet, to: AlState) -> Result<(), Refusal> {
        for slave in behind.iter() {
            self.with(|bus| bus.note_commanded([slave].into_iter().collect(), to, AlState::SafeOp));
            match self.ask(Ask::Enter(Some(slave), to)).await {
                Ok(_) => self.with(|bus| bus.network.commanded[usize::from(slave) - 1] = to),
                Err(HostError::Failed { .. }) => {
                    self.with(|bus| bus.stay_up(slave));
                    return self.tell_refusal(slave).await;
                }
                Err(_) => return Err(Refusal::no_answer(slave)),
            }
        }
        Ok(())
    }
}

impl<W: Wires> ChipBus<W> {
    /// What is to be sent first; `None`: it was, or is not waited for any longer.
    fn sent_first(&self, slaves: SlaveSet, first: Option<SentFirst>, sends_until: &mut Ns) -> Option<SentFirst> {
        let (now, cycle_ns) = (self.wires.now(), self.network.cycle.ns());
        let until = now.saturating_add((u64::from(self.depth()) + 2 * TOLD_LATE) * cycle_ns);
        let in_op = self.network.in_op();
        let all_leave = in_op.difference(slaves).is_empty();
        if first.is_none() && all_leave && !in_op.is_empty() {
            *sends_until = now.saturating_add(leaving_op_ns(in_op.len()) + 2 * TOLD_LATE * cycle_ns);
        }
        let more = |first: &SentFirst| all_leave && now < *sends_until && self.newest_taken() > Some(first.newest);
        let newest = self.newest_taken().map(|newest| SentFirst { newest, until });
        let first = first.filter(|first| !more(first)).or(newest)?;
        let is_sent = self.ledger.newest_sent() >= Some(first.newest);
        (now < first.until && !is_sent && !self.is_clearing()).then_some(first)
    }

    /// Notes which slaves are where they are to be.
    fn note_reached(&mut self, change: &Change) -> Result<(), Refusal> {
        let unconfigured = change.slaves.difference(self.network.with_process_data());
        if change.target > AlState::PreOp
            && let Some(slave) = unconfigured.iter().next()
        {
            // The chip was reset since the configuration, which has to be done again first, also if a slave is still in the
            // state to which the chip before that has brought it \[OURS].
            self.network.lost = self.network.lost.union(unconfigured);
            return Err(Refusal::no_answer(slave));
        }
        (1..=self.network.found).for_each(|slave| self.stay_up(slave));
        for slave in change.slaves.iter().filter(|slave| self.states[usize::from(*slave) - 1] == Some(change.target)) {
            self.network.commanded[usize::from(slave) - 1] = change.target;
            self.network.found_again(slave);
            self.network.lost_from[usize::from(slave) - 1] = None;
        }
        Ok(())
    }

    /// A slave that is not used, and has gone to SafeOP with the others.
    fn strayed(&self, change: &Change) -> Option<u8> {
        let unused = self.network.unused().difference(change.slaves).difference(change.brought_back);
        unused.iter().find(|slave| self.state(*slave) > Some(AlState::PreOp))
    }

    /// The lowest state of those that are not where they are to be; `None`: all that answer are there.
    fn lowest_behind(&self, change: &Change) -> Option<AlState> {
        let states = change.slaves.iter().filter_map(|slave| self.state(slave));
        states.filter(|state| *state != change.target).min()
    }

    /// The slaves that go along unused where all together go to a state; `None`: one by one goes who is behind.
    fn unused_beside(&self, change: &Change, behind: SlaveSet, to: AlState) -> Option<SlaveSet> {
        let goes_along = |slave: &u8| to == AlState::SafeOp && self.state(*slave) == Some(AlState::PreOp);
        let unused: SlaveSet = self.network.unused().difference(behind).iter().filter(goes_along).collect();
        let stays = |slave: u8| unused.contains(slave) || self.state(slave).is_none_or(|state| state == to);
        let others = SlaveSet::first(self.network.found).difference(behind);
        let together = behind.len() >= 2 && change.all_tried != Some(to) && others.iter().all(stays);
        together.then_some(unused)
    }

    /// The slaves of a change of state that are not where they are to be, and go to this state now.
    fn behind(&self, change: &Change, to: AlState) -> SlaveSet {
        let stays = |state: AlState| (to..=change.target.max(to)).contains(&state);
        let moves = |slave: &u8| self.state(*slave).is_some_and(|state| !stays(state));
        change.slaves.iter().filter(moves).collect()
    }

    /// Slaves are about to enter a state, if it is one up to `most`: a slave that leaves OP is no lost one.
    fn note_commanded(&mut self, slaves: SlaveSet, to: AlState, most: AlState) {
        if to <= most {
            slaves.iter().for_each(|slave| self.network.commanded[usize::from(slave) - 1] = to);
        }
    }

    /// A slave that has refused the way down is where it was. One that is up there for a chip that was reset since is not.
    fn stay_up(&mut self, slave: u8) {
        let Some(state) = self.state(slave) else { return };
        if state <= AlState::PreOp || self.network.with_process_data().contains(slave) {
            let commanded = &mut self.network.commanded[usize::from(slave) - 1];
            *commanded = state.max(*commanded);
        }
    }
}
